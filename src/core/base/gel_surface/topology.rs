//! Neighbours of the triangles of a surface, a consistent orientation, and the normals at the corners.

use glam::DVec3;

use super::GelSurfaceError;

/// No triangle: the surface ends here.
pub(super) const NO_TRIANGLE: u32 = u32::MAX;

/// Triangles in one piece, consistently oriented, with their neighbours.
pub(super) struct Topology {
    pub corners: Vec<[u32; 3]>,
    pub neighbours: Vec<[u32; 3]>,
}

impl Topology {
    pub fn new(points: &[DVec3], mut corners: Vec<[u32; 3]>) -> Result<Self, GelSurfaceError> {
        let middle = |[a, b]: [u32; 2]| 0.5 * (points[a as usize] + points[b as usize]);
        let mut neighbours = find_neighbours(&corners).map_err(|edge| GelSurfaceError::SheetsMeet(middle(edge)))?;
        // Flood fill from a first triangle: each neighbour gets the orientation of the one before it.
        let mut turned = vec![false; corners.len()];
        let mut known = vec![false; corners.len()];
        let (mut pieces, mut of_another) = (0, 0);
        for first in 0..corners.len() {
            if known[first] {
                continue;
            }
            pieces += 1;
            of_another = first;
            known[first] = true;
            let mut open = vec![first];
            while let Some(here) = open.pop() {
                for k in 0..3 {
                    let there = neighbours[here][k] as usize;
                    if neighbours[here][k] == NO_TRIANGLE {
                        continue;
                    }
                    let [from, to] = [corners[here][k], corners[here][(k + 1) % 3]];
                    let same_way = (0..3).any(|j| corners[there][j] == from && corners[there][(j + 1) % 3] == to);
                    let turn = turned[here] != same_way;
                    if !known[there] {
                        known[there] = true;
                        turned[there] = turn;
                        open.push(there);
                    } else if turned[there] != turn {
                        return Err(GelSurfaceError::Twisted(middle([from, to])));
                    }
                }
            }
        }
        if pieces > 1 {
            return Err(GelSurfaceError::Pieces { count: pieces, at: points[corners[of_another][0] as usize] });
        }
        for (number, _) in turned.iter().enumerate().filter(|(_, turned)| **turned) {
            flip_triangle(&mut corners[number], &mut neighbours[number]);
        }
        Ok(Self { corners, neighbours })
    }

    /// Reverses the orientation of all triangles.
    pub fn flip_orientation(&mut self) {
        self.corners.iter_mut().zip(&mut self.neighbours).for_each(|(corners, beside)| flip_triangle(corners, beside));
    }

    /// Computes the normals at the corners of each triangle, and counts the sharp edges: those where the cosine of the
    /// angle between the facets is below `crease`.
    pub fn corner_normals(&self, points: &[DVec3], facets: &[DVec3], crease: f64) -> (Vec<[DVec3; 3]>, usize) {
        // Corners at the same vertex share a normal unless a sharp edge lies between them.
        let mut group: Vec<u32> = (0..3 * self.corners.len() as u32).collect();
        let mut sharp = 0;
        for (here, beside) in self.neighbours.iter().enumerate() {
            for (k, there) in beside.iter().enumerate().filter(|(_, there)| **there != NO_TRIANGLE) {
                let there = *there as usize;
                // Both facets have the same orientation, whichever it is: their cosine does not depend on it.
                if facets[here].dot(facets[there]) < crease {
                    sharp += usize::from(here < there);
                    continue;
                }
                for vertex in [self.corners[here][k], self.corners[here][(k + 1) % 3]] {
                    let corner = |triangle: usize| {
                        let at = self.corners[triangle].iter().position(|corner| *corner == vertex);
                        at.map(|at| 3 * triangle + at)
                    };
                    if let (Some(a), Some(b)) = (corner(here), corner(there)) {
                        join_groups(&mut group, a, b);
                    }
                }
            }
        }
        let mut sums = vec![DVec3::ZERO; group.len()];
        for (number, corners) in self.corners.iter().enumerate() {
            for k in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|j| points[corners[(k + j) % 3] as usize]);
                let (along, other) = (b - a, c - a);
                // Max's weights: the sum is exact where the vertices lie on a ball.
                let weight = along.length_squared() * other.length_squared();
                if weight > 0.0 {
                    sums[find_root(&mut group, 3 * number + k)] += along.cross(other) / weight;
                }
            }
        }
        let normal = |number: usize, k: usize, group: &mut [u32]| {
            sums[find_root(group, 3 * number + k)].normalize_or(facets[number])
        };
        let normals = (0..self.corners.len()).map(|number| [0, 1, 2].map(|k| normal(number, k, &mut group)));
        (normals.collect(), sharp)
    }
}

fn flip_triangle(corners: &mut [u32; 3], beside: &mut [u32; 3]) {
    corners.swap(1, 2);
    // Before the swap edge 0 went from corner 0 to 1 and edge 2 from 2 to 0; now they go from 0 to 2 and from 1 to 0.
    beside.swap(0, 2);
}

/// Finds the triangle across each edge. The error is an edge of more than two triangles.
fn find_neighbours(corners: &[[u32; 3]]) -> Result<Vec<[u32; 3]>, [u32; 2]> {
    let mut edges: Vec<([u32; 2], u32, usize)> = Vec::with_capacity(3 * corners.len());
    for (number, corners) in corners.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            edges.push(([a.min(b), a.max(b)], number as u32, k));
        }
    }
    edges.sort_unstable();
    let mut beside = vec![[NO_TRIANGLE; 3]; corners.len()];
    for same in edges.chunk_by(|a, b| a.0 == b.0) {
        match same {
            [_] => {}
            [(_, a, k), (_, b, j)] => {
                beside[*a as usize][*k] = *b;
                beside[*b as usize][*j] = *a;
            }
            _ => return Err(same[0].0),
        }
    }
    Ok(beside)
}

/// Finds the closed lines of edges at which a surface ends, as vertices.
pub(super) fn find_borders(corners: &[[u32; 3]], beside: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut next: std::collections::BTreeMap<u32, Vec<u32>> = std::collections::BTreeMap::new();
    for (corners, beside) in corners.iter().zip(beside) {
        for k in (0..3).filter(|k| beside[*k] == NO_TRIANGLE) {
            next.entry(corners[k]).or_default().push(corners[(k + 1) % 3]);
        }
    }
    let mut found = Vec::new();
    while let Some((&first, _)) = next.iter().next() {
        let mut border = vec![first];
        let mut here = first;
        while let Some(ends) = next.get_mut(&here) {
            let there = ends.pop();
            if ends.is_empty() {
                next.remove(&here);
            }
            match there {
                Some(there) if there != first => {
                    border.push(there);
                    here = there;
                }
                _ => break,
            }
        }
        found.push(border);
    }
    found
}

fn find_root(group: &mut [u32], mut at: usize) -> usize {
    while group[at] as usize != at {
        group[at] = group[group[at] as usize];
        at = group[at] as usize;
    }
    at
}

fn join_groups(group: &mut [u32], a: usize, b: usize) {
    let (a, b) = (find_root(group, a), find_root(group, b));
    let (low, high) = (a.min(b), a.max(b));
    group[high] = low as u32;
}
