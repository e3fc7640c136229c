//! How the triangles of a mesh hang together: parts, holes, crowded edges, triangles that face the wrong way.
//!
//! Everything follows from the sorted list of edges, in O(n log n) on any mesh. Which triangles face the same way is
//! kept in a union-find that carries a sign. Only equal positions count as one vertex (see [`gelsim_core::mesh`]): a seam
//! whose sides differ in the last bit is a hole.

use rayon::prelude::*;
use serde::Serialize;

use gelsim_core::mesh::Mesh;

/// What [`survey`] counts.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Surface {
    /// Parts: triangles joined by edges that exactly two of them share.
    pub parts: usize,
    /// Parts without an open or crowded edge.
    pub closed_parts: usize,
    /// Parts smaller than the size asked for, along all three axes.
    pub specks: usize,
    /// Edges of only one triangle.
    pub open_edges: usize,
    /// Holes: open edges that hang together count as the rim of one. The border of an open sheet is one, too.
    pub holes: usize,
    /// Length of the longest rim, mm; 0 without a hole.
    pub longest_rim_mm: f64,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles run along them in the same direction, and so face different ways.
    pub clashing_edges: usize,
    /// Triangles that face another way than most of their part.
    pub flipped_triangles: usize,
    /// Closed parts most of whose triangles face inwards: cavities, or turned inside out.
    pub inverted_parts: usize,
    /// Parts with no two sides, such as a Moebius strip.
    pub one_sided_parts: usize,
}

/// Counts what there is to know of a mesh's edges and parts; a part below `speck_mm` along every axis is a speck.
pub fn survey(mesh: &Mesh, speck_mm: f64) -> Surface {
    let mut surface = Surface::default();
    let mut sets = Sets::new(mesh.triangles.len());
    let mut open = Vec::new();
    let mut marks = Vec::new();
    for uses in edges(mesh).chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
        match uses {
            [only] => {
                open.push([only.low, only.high]);
                marks.push((only.triangle, Mark::Open));
            }
            [one, other] => {
                let clash = one.upwards == other.upwards;
                surface.clashing_edges += usize::from(clash);
                if !sets.join(one.triangle, other.triangle, clash) {
                    marks.push((one.triangle, Mark::OneSided));
                }
            }
            crowd => {
                surface.non_manifold_edges += 1;
                marks.extend(crowd.iter().map(|edge| (edge.triangle, Mark::Open)));
            }
        }
    }
    surface.open_edges = open.len();
    (surface.holes, surface.longest_rim_mm) = rims(mesh, &open);
    drop(open);

    for part in parts(mesh, &mut sets, &marks) {
        surface.parts += 1;
        surface.closed_parts += usize::from(!part.open);
        surface.specks += usize::from(part.size() < speck_mm);
        surface.flipped_triangles += part.triangles[0].min(part.triangles[1]);
        surface.inverted_parts += usize::from(!part.open && part.is_inverted());
        surface.one_sided_parts += usize::from(part.one_sided);
    }
    surface
}

/// An edge as one triangle has it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    low: u32,
    high: u32,
    triangle: u32,
    /// The triangle runs from the lower vertex to the higher one.
    upwards: bool,
}

/// Three per triangle, equal ones side by side.
fn edges(mesh: &Mesh) -> Vec<Edge> {
    let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
    for (triangle, [a, b, c]) in mesh.triangles.iter().enumerate() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (low, high, upwards) = (*from.min(to), *from.max(to), from < to);
            edges.push(Edge { low, high, triangle: triangle as u32, upwards });
        }
    }
    edges.par_sort_unstable();
    edges
}

/// How many rims the open edges make, and the length of the longest, mm.
fn rims(mesh: &Mesh, open: &[[u32; 2]]) -> (usize, f64) {
    if open.is_empty() {
        return (0, 0.0);
    }
    let mut sets = Sets::new(mesh.vertices.len());
    for [from, to] in open {
        sets.join(*from, *to, false);
    }
    let mut lengths_mm = vec![0.0; mesh.vertices.len()];
    for edge in open {
        let [from, to] = edge.map(|vertex| mesh.vertices[vertex as usize].map(f64::from));
        let squares: f64 = (0..3).map(|k| (to[k] - from[k]) * (to[k] - from[k])).sum();
        lengths_mm[sets.find(edge[0]).0 as usize] += squares.sqrt();
    }
    let rims = open.iter().flatten().filter(|vertex| sets.parent[**vertex as usize] == **vertex);
    let mut first: Vec<u32> = rims.copied().collect();
    first.sort_unstable();
    first.dedup();
    (first.len(), lengths_mm.into_iter().fold(0.0, f64::max))
}

/// What an edge says about the part of a triangle.
#[derive(Clone, Copy)]
enum Mark {
    Open,
    OneSided,
}

struct Part {
    low: [f32; 3],
    high: [f32; 3],
    /// Triangles that face as the part's first one does, and those that face the other way.
    triangles: [usize; 2],
    /// Signed volume if all faced as the first one does, mm^3.
    volume: f64,
    open: bool,
    one_sided: bool,
}

impl Part {
    const EMPTY: Self = Self {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
        triangles: [0; 2],
        volume: 0.0,
        open: false,
        one_sided: false,
    };

    /// Largest extent, mm.
    fn size(&self) -> f64 {
        (0..3).map(|k| f64::from(self.high[k]) - f64::from(self.low[k])).fold(0.0, f64::max)
    }

    fn is_inverted(&self) -> bool {
        let volume = if self.triangles[1] > self.triangles[0] { -self.volume } else { self.volume };
        // A doubled sheet has none but for rounding.
        volume < -1e-9 * self.size() * self.size() * self.size()
    }
}

fn parts(mesh: &Mesh, sets: &mut Sets, marks: &[(u32, Mark)]) -> Vec<Part> {
    let mut number = vec![u32::MAX; mesh.triangles.len()];
    let mut parts = Vec::new();
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let (first, turned) = sets.find(triangle as u32);
        let number = &mut number[first as usize];
        if *number == u32::MAX {
            *number = parts.len() as u32;
            parts.push(Part::EMPTY);
        }
        let part = &mut parts[*number as usize];
        let corners = corners.map(|vertex| mesh.vertices[vertex as usize]);
        for corner in corners {
            for (k, at) in corner.into_iter().enumerate() {
                part.low[k] = part.low[k].min(at);
                part.high[k] = part.high[k].max(at);
            }
        }
        part.triangles[usize::from(turned)] += 1;
        let volume = six_volumes(corners.map(|corner| corner.map(f64::from))) / 6.0;
        part.volume += if turned { -volume } else { volume };
    }
    for (triangle, mark) in marks {
        let part = &mut parts[number[sets.find(*triangle).0 as usize] as usize];
        match mark {
            Mark::Open => part.open = true,
            Mark::OneSided => part.one_sided = true,
        }
    }
    parts
}

/// Six times the signed volume between a triangle and the mesh's centre.
fn six_volumes([a, b, c]: [[f64; 3]; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// Disjoint sets whose members either agree with each other or are opposed.
struct Sets {
    parent: Vec<u32>,
    /// Opposed to its parent.
    opposed: Vec<bool>,
}

impl Sets {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), opposed: vec![false; count] }
    }

    /// The first member of a member's set, and whether the two are opposed.
    fn find(&mut self, member: u32) -> (u32, bool) {
        let (mut at, mut opposed) = (member as usize, false);
        loop {
            let parent = self.parent[at] as usize;
            if parent == at {
                return (at as u32, opposed);
            }
            // Halves the path for those who come after.
            self.opposed[at] ^= self.opposed[parent];
            self.parent[at] = self.parent[parent];
            opposed ^= self.opposed[at];
            at = self.parent[at] as usize;
        }
    }

    /// Puts two members in one set. False if they are in one already and are opposed where they should agree, or agree
    /// where they should be opposed.
    fn join(&mut self, one: u32, other: u32, opposed: bool) -> bool {
        let ((a, a_opposed), (b, b_opposed)) = (self.find(one), self.find(other));
        if a == b {
            return (a_opposed ^ b_opposed) == opposed;
        }
        let (first, second) = (a.min(b), a.max(b) as usize);
        self.parent[second] = first;
        self.opposed[second] = a_opposed ^ b_opposed ^ opposed;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::mesh::cleaning::LARGEST_MM;

    /// A cube of 2 mm whose corner of lowest coordinates is at `at`.
    fn cube(at: [f64; 3]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let corner = |i: usize| [0, 1, 2].map(|k| at[k] + 2.0 * (i >> k & 1) as f64);
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        ((0..8).map(corner).collect(), triangles)
    }

    fn surveyed((vertices, triangles): (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> Surface {
        survey(&Mesh::new(vertices, triangles).expect("a mesh").0, 0.1)
    }

    fn both(one: (Vec<[f64; 3]>, Vec<[u32; 3]>), other: (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> Surface {
        let (mut vertices, mut triangles) = one;
        let shift = vertices.len() as u32;
        vertices.extend(other.0);
        triangles.extend(other.1.iter().map(|corners| corners.map(|vertex| vertex + shift)));
        surveyed((vertices, triangles))
    }

    const SOUND: Surface = Surface {
        parts: 1,
        closed_parts: 1,
        specks: 0,
        open_edges: 0,
        holes: 0,
        longest_rim_mm: 0.0,
        non_manifold_edges: 0,
        clashing_edges: 0,
        flipped_triangles: 0,
        inverted_parts: 0,
        one_sided_parts: 0,
    };

    #[test]
    fn a_cube_is_one_closed_part_that_faces_outwards() {
        assert_eq!(surveyed(cube([5.0, -3.0, 100.0])), SOUND);
    }

    #[test]
    fn a_cube_without_its_lid_has_one_hole_with_the_lids_perimeter() {
        let (vertices, mut triangles) = cube([0.0; 3]);
        triangles.drain(2..4);
        let open = Surface { closed_parts: 0, open_edges: 4, holes: 1, longest_rim_mm: 8.0, ..SOUND };
        assert_eq!(surveyed((vertices, triangles)), open);
    }

    #[test]
    fn two_opposite_sides_missing_are_two_holes_and_the_longest_rim_counts() {
        let (mut vertices, mut triangles) = cube([0.0; 3]);
        triangles.drain(0..4);
        for corner in &mut vertices[4..] {
            // A frustum: its upper side is 6 mm wide.
            corner[0] = 3.0 * corner[0] - 3.0;
            corner[1] = 3.0 * corner[1] - 3.0;
        }
        let open = Surface { closed_parts: 0, open_edges: 8, holes: 2, longest_rim_mm: 24.0, ..SOUND };
        assert_eq!(surveyed((vertices, triangles)), open);
    }

    #[test]
    fn flipped_triangles_are_counted_and_a_cube_turned_inside_out_is_told_from_them() {
        let (vertices, mut triangles) = cube([0.0; 3]);
        triangles[4].swap(0, 1);
        let flipped = Surface { clashing_edges: 3, flipped_triangles: 1, ..SOUND };
        assert_eq!(surveyed((vertices.clone(), triangles.clone())), flipped);
        // Which of them comes first must not matter.
        triangles.swap(0, 4);
        assert_eq!(surveyed((vertices.clone(), triangles)), flipped);

        let (_, mut triangles) = cube([0.0; 3]);
        triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        assert_eq!(surveyed((vertices.clone(), triangles.clone())), Surface { inverted_parts: 1, ..SOUND });
        triangles[4].swap(0, 1);
        assert_eq!(surveyed((vertices, triangles)), Surface { inverted_parts: 1, ..flipped });
    }

    #[test]
    fn cubes_apart_at_a_corner_and_at_an_edge_are_two_parts() {
        assert_eq!(both(cube([0.0; 3]), cube([5.0; 3])), Surface { parts: 2, closed_parts: 2, ..SOUND });
        assert_eq!(both(cube([0.0; 3]), cube([2.0; 3])), Surface { parts: 2, closed_parts: 2, ..SOUND });
        let at_an_edge = Surface { parts: 2, closed_parts: 0, non_manifold_edges: 1, ..SOUND };
        assert_eq!(both(cube([0.0; 3]), cube([2.0, 2.0, 0.0])), at_an_edge);
    }

    #[test]
    fn a_speck_beside_a_cube_is_counted() {
        let (mut vertices, triangles) = cube([0.0; 3]);
        vertices.iter_mut().flatten().for_each(|x| *x = 50.0 + *x * 0.04);
        let speck = Surface { parts: 2, closed_parts: 2, specks: 1, ..SOUND };
        assert_eq!(both(cube([0.0; 3]), (vertices, triangles)), speck);
    }

    #[test]
    fn a_strip_with_half_a_twist_has_one_side_and_one_rim() {
        let sections = 12;
        let mut vertices = Vec::new();
        for i in 0..sections {
            let turn = std::f64::consts::TAU * f64::from(i) / f64::from(sections);
            for side in [-1.0, 1.0] {
                let out = 5.0 + side * (turn / 2.0).cos();
                vertices.push([out * turn.cos(), out * turn.sin(), side * (turn / 2.0).sin()]);
            }
        }
        let count = 2 * sections as u32;
        // The last section meets the first one upside down.
        let at = |i: u32| if i < count { i } else { [1, 0][(i - count) as usize] };
        let quad = |i: u32| [[i, at(i + 2), i + 1], [i + 1, at(i + 2), at(i + 3)]];
        let triangles = (0..count).step_by(2).flat_map(quad).collect();
        let found = surveyed((vertices, triangles));
        assert_eq!((found.parts, found.one_sided_parts, found.holes), (1, 1, 1));
        assert_eq!((found.open_edges, found.closed_parts, found.inverted_parts), (count as usize, 0, 0));
    }

    #[test]
    fn a_lone_triangle_is_surveyed_however_large_or_small() {
        for size in [LARGEST_MM, 1e-40] {
            let found = surveyed((vec![[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]], vec![[0, 1, 2]]));
            assert_eq!((found.parts, found.holes, found.open_edges), (1, 1, 3));
            let rim = (2.0 + 2.0_f64.sqrt()) * size;
            assert!((found.longest_rim_mm / rim - 1.0).abs() < 1e-5, "{found:?}");
        }
    }
}
