//! How the triangles of a mesh are connected: parts, holes, crowded edges, triangles that face the wrong way.
//!
//! Everything follows from the sorted list of edges, in O(n log n) for any mesh. Which triangles face the same way is
//! kept in a union-find with signs. Only equal positions count as one vertex (see [`gelsim_core::mesh`]): a seam whose
//! sides differ in the last bit is a hole.

use rayon::prelude::*;
use serde::Serialize;

use gelsim_core::mesh::Mesh;

/// Counts of [`survey_mesh`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MeshSurvey {
    /// Parts: triangles joined by edges that exactly two of them share.
    pub parts: usize,
    /// Parts without an open or crowded edge.
    pub closed_parts: usize,
    /// Parts smaller than the size of a speck along all three axes.
    pub specks: usize,
    /// Edges that belong to a single triangle.
    pub open_edges: usize,
    /// Holes: connected open edges count as the rim of one. The border of an open sheet counts as one, too.
    pub holes: usize,
    /// Length of the longest rim, mm; 0 without a hole.
    pub longest_rim_mm: f64,
    /// Edges shared by more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles run along them in the same direction, and so face different ways.
    pub clashing_edges: usize,
    /// Triangles that face another way than most of their part.
    pub flipped_triangles: usize,
    /// Closed parts most of whose triangles face inwards: cavities, or parts turned inside out.
    pub inverted_parts: usize,
    /// Parts with no two sides, such as a Moebius strip.
    pub one_sided_parts: usize,
}

/// Counts edges and parts of a mesh; a part smaller than `speck_mm` along every axis is a speck.
pub fn survey_mesh(mesh: &Mesh, speck_mm: f64) -> MeshSurvey {
    let mut surface = MeshSurvey::default();
    let mut sets = DisjointSets::new(mesh.triangles.len());
    let mut open = Vec::new();
    let mut marks = Vec::new();
    for uses in list_edges(mesh).chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
        match uses {
            [only] => {
                open.push([only.low, only.high]);
                marks.push((only.triangle, EdgeMark::Open));
            }
            [one, other] => {
                let clash = one.upwards == other.upwards;
                surface.clashing_edges += usize::from(clash);
                if !sets.join(one.triangle, other.triangle, clash) {
                    marks.push((one.triangle, EdgeMark::OneSided));
                }
            }
            crowd => {
                surface.non_manifold_edges += 1;
                marks.extend(crowd.iter().map(|edge| (edge.triangle, EdgeMark::Open)));
            }
        }
    }
    surface.open_edges = open.len();
    (surface.holes, surface.longest_rim_mm) = measure_rims(mesh, &open);
    drop(open);

    for part in collect_parts(mesh, &mut sets, &marks) {
        surface.parts += 1;
        surface.closed_parts += usize::from(!part.open);
        surface.specks += usize::from(part.largest_extent() < speck_mm);
        surface.flipped_triangles += part.triangles[0].min(part.triangles[1]);
        surface.inverted_parts += usize::from(!part.open && part.is_inverted());
        surface.one_sided_parts += usize::from(part.one_sided);
    }
    surface
}

/// An edge as one of its triangles has it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    low: u32,
    high: u32,
    triangle: u32,
    /// Whether the triangle runs from the lower vertex to the higher one.
    upwards: bool,
}

/// Lists the edges, three per triangle, sorted so that equal ones are adjacent.
fn list_edges(mesh: &Mesh) -> Vec<Edge> {
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

/// Counts the rims that the open edges form, and measures the longest, mm.
fn measure_rims(mesh: &Mesh, open: &[[u32; 2]]) -> (usize, f64) {
    if open.is_empty() {
        return (0, 0.0);
    }
    let mut sets = DisjointSets::new(mesh.vertices.len());
    for [from, to] in open {
        sets.join(*from, *to, false);
    }
    let mut lengths_mm = vec![0.0; mesh.vertices.len()];
    for edge in open {
        let [from, to] = edge.map(|vertex| mesh.vertices[vertex as usize].map(f64::from));
        let squares: f64 = (0..3).map(|k| (to[k] - from[k]) * (to[k] - from[k])).sum();
        lengths_mm[sets.find_root(edge[0]).0 as usize] += squares.sqrt();
    }
    let rims = open.iter().flatten().filter(|vertex| sets.parent[**vertex as usize] == **vertex);
    let mut first: Vec<u32> = rims.copied().collect();
    first.sort_unstable();
    first.dedup();
    (first.len(), lengths_mm.into_iter().fold(0.0, f64::max))
}

/// Mark that an edge sets on the part of its triangle.
#[derive(Clone, Copy)]
enum EdgeMark {
    Open,
    OneSided,
}

struct MeshPart {
    low: [f32; 3],
    high: [f32; 3],
    /// Triangles that face as the part's first one does, and those that face the other way.
    triangles: [usize; 2],
    /// Signed volume if all faced as the first one does, mm^3.
    volume: f64,
    open: bool,
    one_sided: bool,
}

impl MeshPart {
    const EMPTY: Self = Self {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
        triangles: [0; 2],
        volume: 0.0,
        open: false,
        one_sided: false,
    };

    /// Largest extent, mm.
    fn largest_extent(&self) -> f64 {
        (0..3).map(|k| f64::from(self.high[k]) - f64::from(self.low[k])).fold(0.0, f64::max)
    }

    /// Returns true if most triangles face inwards.
    fn is_inverted(&self) -> bool {
        let volume = if self.triangles[1] > self.triangles[0] { -self.volume } else { self.volume };
        // Rounding gives a doubled sheet a tiny volume of either sign.
        volume < -1e-9 * self.largest_extent() * self.largest_extent() * self.largest_extent()
    }
}

/// Collects the parts: triangles in one set, with the marks of their edges.
fn collect_parts(mesh: &Mesh, sets: &mut DisjointSets, marks: &[(u32, EdgeMark)]) -> Vec<MeshPart> {
    let mut number = vec![u32::MAX; mesh.triangles.len()];
    let mut parts = Vec::new();
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let (first, turned) = sets.find_root(triangle as u32);
        let number = &mut number[first as usize];
        if *number == u32::MAX {
            *number = parts.len() as u32;
            parts.push(MeshPart::EMPTY);
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
        let part = &mut parts[number[sets.find_root(*triangle).0 as usize] as usize];
        match mark {
            EdgeMark::Open => part.open = true,
            EdgeMark::OneSided => part.one_sided = true,
        }
    }
    parts
}

/// Six times the signed volume between a triangle and the mesh's centre.
fn six_volumes([a, b, c]: [[f64; 3]; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// Disjoint sets whose members either agree with each other or are opposed.
struct DisjointSets {
    parent: Vec<u32>,
    /// Whether a member is opposed to its parent.
    opposed: Vec<bool>,
}

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), opposed: vec![false; count] }
    }

    /// Returns the root of a member's set, and whether the member is opposed to it.
    fn find_root(&mut self, member: u32) -> (u32, bool) {
        let (mut at, mut opposed) = (member as usize, false);
        loop {
            let parent = self.parent[at] as usize;
            if parent == at {
                return (at as u32, opposed);
            }
            // Path halving: later searches are shorter.
            self.opposed[at] ^= self.opposed[parent];
            self.parent[at] = self.parent[parent];
            opposed ^= self.opposed[at];
            at = self.parent[at] as usize;
        }
    }

    /// Joins the sets of two members, which are `opposed` or agree. Returns false if they are in one set already and
    /// contradict that.
    fn join(&mut self, one: u32, other: u32, opposed: bool) -> bool {
        let ((a, a_opposed), (b, b_opposed)) = (self.find_root(one), self.find_root(other));
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

    fn surveyed((vertices, triangles): (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> MeshSurvey {
        survey_mesh(&Mesh::new(vertices, triangles).expect("a mesh").0, 0.1)
    }

    fn both(one: (Vec<[f64; 3]>, Vec<[u32; 3]>), other: (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> MeshSurvey {
        let (mut vertices, mut triangles) = one;
        let shift = vertices.len() as u32;
        vertices.extend(other.0);
        triangles.extend(other.1.iter().map(|corners| corners.map(|vertex| vertex + shift)));
        surveyed((vertices, triangles))
    }

    const SOUND: MeshSurvey = MeshSurvey {
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
        let open = MeshSurvey { closed_parts: 0, open_edges: 4, holes: 1, longest_rim_mm: 8.0, ..SOUND };
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
        let open = MeshSurvey { closed_parts: 0, open_edges: 8, holes: 2, longest_rim_mm: 24.0, ..SOUND };
        assert_eq!(surveyed((vertices, triangles)), open);
    }

    #[test]
    fn flipped_triangles_are_counted_and_a_cube_turned_inside_out_is_told_from_them() {
        let (vertices, mut triangles) = cube([0.0; 3]);
        triangles[4].swap(0, 1);
        let flipped = MeshSurvey { clashing_edges: 3, flipped_triangles: 1, ..SOUND };
        assert_eq!(surveyed((vertices.clone(), triangles.clone())), flipped);
        // Which of them comes first must not matter.
        triangles.swap(0, 4);
        assert_eq!(surveyed((vertices.clone(), triangles)), flipped);

        let (_, mut triangles) = cube([0.0; 3]);
        triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
        assert_eq!(surveyed((vertices.clone(), triangles.clone())), MeshSurvey { inverted_parts: 1, ..SOUND });
        triangles[4].swap(0, 1);
        assert_eq!(surveyed((vertices, triangles)), MeshSurvey { inverted_parts: 1, ..flipped });
    }

    #[test]
    fn cubes_apart_at_a_corner_and_at_an_edge_are_two_parts() {
        assert_eq!(both(cube([0.0; 3]), cube([5.0; 3])), MeshSurvey { parts: 2, closed_parts: 2, ..SOUND });
        assert_eq!(both(cube([0.0; 3]), cube([2.0; 3])), MeshSurvey { parts: 2, closed_parts: 2, ..SOUND });
        let at_an_edge = MeshSurvey { parts: 2, closed_parts: 0, non_manifold_edges: 1, ..SOUND };
        assert_eq!(both(cube([0.0; 3]), cube([2.0, 2.0, 0.0])), at_an_edge);
    }

    #[test]
    fn a_speck_beside_a_cube_is_counted() {
        let (mut vertices, triangles) = cube([0.0; 3]);
        vertices.iter_mut().flatten().for_each(|x| *x = 50.0 + *x * 0.04);
        let speck = MeshSurvey { parts: 2, closed_parts: 2, specks: 1, ..SOUND };
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
