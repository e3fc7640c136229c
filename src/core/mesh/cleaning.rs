//! A triangle mesh in millimetres, cleaned of everything that rays and rasters cannot use.
//!
//! Vertices are stored in f32 relative to the centre of their bounding box, so that an object modelled 1 km
//! from its origin keeps its micrometres; the centre itself is kept in f64. Equal positions become one vertex,
//! so that triangle soup (STL) and indexed files give the same mesh.

use serde::{Deserialize, Serialize};

use super::MeshError;

/// Triangles over shared vertices. Only [`Mesh::new`] makes one, so every mesh is finite and non-empty.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Positions in mm, relative to `centre_mm`. All are different, and each is used by a triangle.
    pub vertices: Vec<[f32; 3]>,
    /// Indices into `vertices`; the three of a triangle are different.
    pub triangles: Vec<[u32; 3]>,
    /// Centre of the bounding box in the object's own frame, mm.
    pub centre_mm: [f64; 3],
}

/// Longest side of a mesh's bounding box, mm. Coordinates have a relative precision of 1 in 10^7, here a millimetre.
pub const LARGEST_MM: f64 = 1e7;

/// Counts of what cleaning removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CleanupReport {
    /// Vertices with a NaN or infinite coordinate. Triangles that use them are removed too.
    pub non_finite_vertices: usize,
    /// Triangles without area: two equal corners, or three on a line.
    pub zero_area: usize,
    /// Triangles with the same three corners as an earlier one, in any order.
    pub duplicates: usize,
}

impl Mesh {
    /// Cleans and centres a mesh given in mm. Vertices and triangles keep the order in which the remaining triangles
    /// first name them.
    ///
    /// Removed are: vertices that are not finite in f32, with their triangles; triangles whose cross product is exactly
    /// zero, computed in f64 from the given positions or from those in f32 (there is no other threshold: slivers stay);
    /// triangles with the corners of an earlier one in any order; vertices that no triangle uses. The bounding box is
    /// that of the triangles that are finite and have area as given.
    ///
    /// # Errors
    ///
    /// No vertex or no triangle, before or after cleaning; an index without a vertex; more than u32 can count; an
    /// object larger than [`LARGEST_MM`].
    pub fn new(vertices_mm: Vec<[f64; 3]>, mut triangles: Vec<[u32; 3]>) -> Result<(Mesh, CleanupReport), MeshError> {
        let count = vertices_mm.len();
        for (what, count) in [("vertices", count), ("triangles", triangles.len())] {
            if count >= NO_INDEX as usize {
                return Err(MeshError::TooMany(what));
            }
        }
        if count == 0 {
            return Err(MeshError::NoVertex);
        }
        if triangles.is_empty() {
            return Err(MeshError::NoTriangle);
        }
        if let Some(&index) = triangles.as_flattened().iter().find(|&&index| index as usize >= count) {
            return Err(MeshError::NoSuchVertex { index: index.into(), count, note: ", counted from 0" });
        }
        let mut cleaned = CleanupReport {
            non_finite_vertices: vertices_mm.iter().filter(|vertex| !is_finite(vertex)).count(),
            ..CleanupReport::default()
        };
        if cleaned.non_finite_vertices == count {
            return Err(MeshError::NoFiniteVertex);
        }

        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        triangles.retain(|triangle| {
            let corners = triangle.map(|index| vertices_mm[index as usize]);
            if !corners.iter().all(is_finite) {
                return false;
            }
            if !has_area(corners) {
                cleaned.zero_area += 1;
                return false;
            }
            for corner in corners {
                for axis in 0..3 {
                    low[axis] = low[axis].min(corner[axis]);
                    high[axis] = high[axis].max(corner[axis]);
                }
            }
            true
        });
        let across = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        if across > LARGEST_MM {
            return Err(MeshError::TooLarge(across));
        }
        // Adding 0.0 turns -0.0 into 0.0, here and below: equal positions must have equal bits.
        let centre_mm = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]) + 0.0);

        // Initial capacity: a closed surface has about half as many vertices as triangles.
        let mut positions = DistinctKeys::with_capacity(count.min(triangles.len() / 2));
        let mut merged = vec![NO_INDEX; count];
        for corner in triangles.as_flattened_mut() {
            let index = *corner as usize;
            if merged[index] == NO_INDEX {
                let vertex = vertices_mm[index];
                let centred = [0, 1, 2].map(|axis| (vertex[axis] - centre_mm[axis]) as f32 + 0.0);
                merged[index] = positions.insert(centred.map(f32::to_bits));
            }
            *corner = merged[index];
        }
        drop(vertices_mm);
        let positions: Vec<[f32; 3]> = positions.keys.into_iter().map(|bits| bits.map(f32::from_bits)).collect();

        // Rounding to f32 can collapse further triangles.
        triangles.retain(|triangle| {
            let keep = has_area(triangle.map(|index| positions[index as usize].map(f64::from)));
            cleaned.zero_area += usize::from(!keep);
            keep
        });
        let mut is_duplicate = find_duplicates(&triangles, positions.len()).into_iter();
        triangles.retain(|_| {
            let keep = is_duplicate.next() != Some(true);
            cleaned.duplicates += usize::from(!keep);
            keep
        });
        if triangles.is_empty() {
            return Err(MeshError::NothingLeft(cleaned));
        }

        let mut vertices = Vec::with_capacity(positions.len());
        merged.clear();
        merged.resize(positions.len(), NO_INDEX);
        for corner in triangles.as_flattened_mut() {
            let index = *corner as usize;
            if merged[index] == NO_INDEX {
                merged[index] = vertices.len() as u32;
                vertices.push(positions[index]);
            }
            *corner = merged[index];
        }
        vertices.shrink_to_fit();
        triangles.shrink_to_fit();
        Ok((Mesh { vertices, triangles, centre_mm }, cleaned))
    }
}

impl CleanupReport {
    /// Describes what was removed, in words for a warning, such as `dropped 3 triangles without area and 12
    /// duplicates`; `None` if nothing was.
    pub fn warning(&self) -> Option<String> {
        let mut dropped = Vec::new();
        let mut add = |count: usize, one: &str, many: &str| match count {
            0 => {}
            1 => dropped.push(format!("1 {one}")),
            _ => dropped.push(format!("{count} {many}")),
        };
        add(
            self.non_finite_vertices,
            "vertex that is not finite (and its triangles)",
            "vertices that are not finite (and their triangles)",
        );
        add(self.zero_area, "triangle without area", "triangles without area");
        if self.zero_area == 0 {
            add(self.duplicates, "duplicate triangle", "duplicate triangles");
        } else {
            add(self.duplicates, "duplicate", "duplicates");
        }
        let last = dropped.pop()?;
        if dropped.is_empty() {
            Some(format!("dropped {last}"))
        } else {
            Some(format!("dropped {} and {last}", dropped.join(", ")))
        }
    }
}

/// No index. A mesh therefore has at most `u32::MAX - 1` vertices and triangles.
const NO_INDEX: u32 = u32::MAX;

fn is_finite(vertex: &[f64; 3]) -> bool {
    vertex.iter().all(|&coordinate| (coordinate as f32).is_finite())
}

/// Returns true if a triangle has an area. Differences and products of f32 values are exact in f64 (unless their
/// exponents lie far apart), so that zero means exactly zero.
fn has_area([a, b, c]: [[f64; 3]; 3]) -> bool {
    let [u, v] = [b, c].map(|corner| [0, 1, 2].map(|axis| corner[axis] - a[axis]));
    u[1] * v[2] != u[2] * v[1] || u[2] * v[0] != u[0] * v[2] || u[0] * v[1] != u[1] * v[0]
}

/// Numbers distinct keys in the order of their first appearance: an open-addressing hash table, several times as fast
/// as `HashMap` with its default hasher on the millions of keys of a large mesh.
struct DistinctKeys {
    keys: Vec<[u32; 3]>,
    /// Indices into `keys`, or `NO_INDEX`; the length is a power of two and at least twice that of `keys`.
    slots: Vec<u32>,
}

impl DistinctKeys {
    fn with_capacity(count: usize) -> Self {
        let slots = vec![NO_INDEX; (2 * (count + 1)).next_power_of_two()];
        DistinctKeys { keys: Vec::with_capacity(count), slots }
    }

    /// Returns the number of `key`, a new one at its first appearance.
    fn insert(&mut self, key: [u32; 3]) -> u32 {
        if self.slots.len() < 2 * (self.keys.len() + 1) {
            self.grow();
        }
        let mask = self.slots.len() - 1;
        let mut slot = hash_key(key) & mask;
        loop {
            match self.slots[slot] {
                NO_INDEX => {
                    let number = self.keys.len() as u32;
                    self.slots[slot] = number;
                    self.keys.push(key);
                    return number;
                }
                number if self.keys[number as usize] == key => return number,
                _ => slot = (slot + 1) & mask,
            }
        }
    }

    fn grow(&mut self) {
        let len = 4 * self.slots.len();
        self.slots.clear();
        self.slots.resize(len, NO_INDEX);
        for (number, &key) in self.keys.iter().enumerate() {
            let mut slot = hash_key(key) & (len - 1);
            while self.slots[slot] != NO_INDEX {
                slot = (slot + 1) & (len - 1);
            }
            self.slots[slot] = number as u32;
        }
    }
}

/// Hashes a key by two rounds of folded multiplication; the constants are the fractions of pi and of the golden ratio.
fn hash_key([a, b, c]: [u32; 3]) -> usize {
    let fold = |x: u64, y: u64| {
        let product = u128::from(x) * u128::from(y);
        product as u64 ^ (product >> 64) as u64
    };
    let first = fold((u64::from(a) | u64::from(b) << 32) ^ 0x243f_6a88_85a3_08d3, 0x9e37_79b9_7f4a_7c15);
    fold(first ^ u64::from(c), 0x9e37_79b9_7f4a_7c15) as usize
}

/// Returns for each triangle whether an earlier one has the same corners in any order.
///
/// Triangles that share their lowest corner are sorted together. This is faster than a hash table, since neighbours in
/// the list mostly are neighbours on the surface.
fn find_duplicates(triangles: &[[u32; 3]], vertices: usize) -> Vec<bool> {
    let sorted = |triangle: &[u32; 3]| {
        let mut corners = *triangle;
        corners.sort_unstable();
        corners
    };
    // A counting sort by the lowest corner: `ends` and `starts` delimit the triangles of each vertex.
    let mut ends = vec![0u32; vertices];
    for triangle in triangles {
        ends[sorted(triangle)[0] as usize] += 1;
    }
    let mut end = 0;
    for entry in &mut ends {
        end += *entry;
        *entry = end;
    }
    let mut starts = ends.clone();
    let mut others = vec![[0; 3]; triangles.len()];
    for (number, triangle) in triangles.iter().enumerate() {
        let [low, middle, high] = sorted(triangle);
        let start = &mut starts[low as usize];
        *start -= 1;
        others[*start as usize] = [middle, high, number as u32];
    }
    let mut is_duplicate = vec![false; triangles.len()];
    for (start, end) in starts.into_iter().zip(ends) {
        let others = &mut others[start as usize..end as usize];
        if others.len() > 1 {
            others.sort_unstable();
        }
        for pair in others.windows(2) {
            if pair[0][..2] == pair[1][..2] {
                is_duplicate[pair[1][2] as usize] = true;
            }
        }
    }
    is_duplicate
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]];

    fn failure(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> String {
        Mesh::new(vertices.to_vec(), triangles.to_vec()).unwrap_err().to_string()
    }

    #[test]
    fn a_mesh_is_centred_on_the_box_of_the_vertices_it_uses() {
        let mut vertices = SQUARE.to_vec();
        vertices.insert(0, [500.0, 0.0, 9.0]);
        let (mesh, cleaned) = Mesh::new(vertices, vec![[1, 2, 3], [1, 3, 4]]).unwrap();
        assert_eq!(mesh.centre_mm, [1.0, 1.0, 0.0]);
        assert_eq!(mesh.vertices, [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]);
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(cleaned, CleanupReport::default());
        assert_eq!(cleaned.warning(), None);
    }

    #[test]
    fn micrometres_survive_an_offset_of_a_kilometre() {
        let far: Vec<_> = SQUARE.iter().map(|v| v.map(|x| 1e6 + x * 1e-3)).collect();
        let (mesh, _) = Mesh::new(far, vec![[0, 1, 2]]).unwrap();
        for (vertex, expected) in mesh.vertices.iter().zip([[-1e-3, -1e-3], [1e-3, -1e-3], [1e-3, 1e-3]]) {
            assert!((f64::from(vertex[0]) - expected[0]).abs() < 1e-9, "{vertex:?}");
            assert!((f64::from(vertex[1]) - expected[1]).abs() < 1e-9, "{vertex:?}");
        }
    }

    #[test]
    fn equal_positions_become_one_vertex_whatever_the_sign_of_zero() {
        let soup = vec![SQUARE[0], SQUARE[1], SQUARE[2], [-0.0, 0.0, -0.0], SQUARE[2], SQUARE[3]];
        let (mesh, _) = Mesh::new(soup, vec![[0, 1, 2], [3, 4, 5]]).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert!(mesh.vertices.as_flattened().iter().all(|x| x.to_bits() != (-0.0f32).to_bits()));
    }

    #[test]
    fn vertices_that_are_not_finite_go_with_their_triangles_and_are_counted() {
        let mut vertices = SQUARE.to_vec();
        vertices.extend([[f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0], [0.0, 0.0, 1e39]]);
        let triangles = vec![[0, 1, 4], [0, 1, 2], [5, 1, 2], [0, 6, 2]];
        let (mesh, cleaned) = Mesh::new(vertices, triangles).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert_eq!(cleaned, CleanupReport { non_finite_vertices: 3, ..CleanupReport::default() });
        assert_eq!(cleaned.warning().unwrap(), "dropped 3 vertices that are not finite (and their triangles)");
    }

    #[test]
    fn a_mesh_of_10_km_is_the_largest() {
        let across = |mm: f64| vec![[-0.5 * mm, 0.0, 0.0], [0.5 * mm, 0.0, 0.0], [0.0, 0.5 * mm, -0.5 * mm]];
        assert!(Mesh::new(across(LARGEST_MM), vec![[0, 1, 2]]).is_ok());
        for mm in [1.001 * LARGEST_MM, f64::from(f32::MAX), 2.0 * f64::from(f32::MAX)] {
            let text = Mesh::new(across(mm), vec![[0, 1, 2]]).unwrap_err().to_string();
            assert!(text.contains("mm across, over 1e7 mm: is its unit right?"), "{text}");
        }
    }

    #[test]
    fn triangles_without_area_go_and_slivers_stay() {
        let mut vertices = SQUARE.to_vec();
        vertices.extend([[1.0, 0.0, 0.0], [1.0, 1e-30, 0.0], SQUARE[0]]);
        let triangles = vec![[0, 0, 1], [0, 1, 4], [0, 6, 2], [0, 1, 2], [0, 1, 5]];
        let (mesh, cleaned) = Mesh::new(vertices.clone(), triangles).unwrap();
        // The sliver is 1e-30 high, but in f32 its tip lies on the base once the mesh is centred on y = 1.
        assert_eq!(cleaned.zero_area, 4);
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        let (mesh, cleaned) = Mesh::new(vertices, vec![[0, 1, 5]]).unwrap();
        assert_eq!((mesh.triangles.len(), cleaned.zero_area), (1, 0));
    }

    #[test]
    fn ten_thousand_duplicates_become_one_triangle() {
        let orders = [[0, 1, 2], [1, 2, 0], [2, 1, 0], [0, 2, 1]];
        let triangles = (0..10_000).map(|i| orders[i % 4]).collect();
        let (mesh, cleaned) = Mesh::new(SQUARE.to_vec(), triangles).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert_eq!(mesh.vertices.len(), 3);
        assert_eq!(cleaned.warning().unwrap(), "dropped 9999 duplicate triangles");
    }

    #[test]
    fn the_warning_counts_in_plain_words() {
        let cleaned = CleanupReport { non_finite_vertices: 0, zero_area: 3, duplicates: 12 };
        assert_eq!(cleaned.warning().unwrap(), "dropped 3 triangles without area and 12 duplicates");
        let cleaned = CleanupReport { non_finite_vertices: 1, zero_area: 1, duplicates: 1 };
        assert_eq!(
            cleaned.warning().unwrap(),
            "dropped 1 vertex that is not finite (and its triangles), 1 triangle without area and 1 duplicate"
        );
    }

    #[test]
    fn meshes_with_nothing_in_them_are_refused() {
        assert_eq!(failure(&[], &[[0, 0, 0]]), "no vertex");
        assert_eq!(failure(&SQUARE, &[]), "no triangle");
        assert_eq!(failure(&[[f64::NAN; 3]; 3], &[[0, 1, 2]]), "no vertex with finite coordinates");
        assert_eq!(failure(&SQUARE, &[[0, 0, 1], [1, 1, 1]]), "no triangle left: dropped 2 triangles without area");
        assert_eq!(failure(&SQUARE, &[[0, 1, 4]]), "face refers to vertex 4, but the file has 4, counted from 0");
    }

    proptest! {
        /// A plain reference: quadratic searches instead of hash tables, on a small grid where much coincides.
        #[test]
        fn cleaning_agrees_with_a_plain_search(
            grid in prop::collection::vec(prop::array::uniform3(-1i8..=1), 1..40),
            picks in prop::collection::vec(prop::array::uniform3(0usize..40), 1..80),
        ) {
            let vertices: Vec<[f64; 3]> = grid.iter().map(|v| v.map(f64::from)).collect();
            let triangles: Vec<[u32; 3]> =
                picks.iter().map(|t| t.map(|i| (i % vertices.len()) as u32)).collect();
            let mut expected: Vec<[[f64; 3]; 3]> = Vec::new();
            let (mut zero_area, mut duplicates) = (0, 0);
            for triangle in &triangles {
                let corners = triangle.map(|i| vertices[i as usize]);
                if !has_area(corners) {
                    zero_area += 1;
                } else if expected.iter().any(|other| corners.iter().all(|c| other.contains(c))) {
                    duplicates += 1;
                } else {
                    expected.push(corners);
                }
            }
            match Mesh::new(vertices, triangles) {
                Err(_) => prop_assert!(expected.is_empty()),
                Ok((mesh, cleaned)) => {
                    prop_assert_eq!(cleaned, CleanupReport { non_finite_vertices: 0, zero_area, duplicates });
                    let got: Vec<_> = mesh
                        .triangles
                        .iter()
                        .map(|t| t.map(|i| {
                            let vertex = mesh.vertices[i as usize].map(f64::from);
                            [0, 1, 2].map(|axis| vertex[axis] + mesh.centre_mm[axis])
                        }))
                        .collect();
                    prop_assert_eq!(got, expected);
                    let mut distinct = mesh.vertices.clone();
                    distinct.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    distinct.dedup();
                    prop_assert_eq!(distinct.len(), mesh.vertices.len());
                    for axis in 0..3 {
                        let low = mesh.vertices.iter().map(|v| v[axis]).fold(f32::INFINITY, f32::min);
                        let high = mesh.vertices.iter().map(|v| v[axis]).fold(f32::NEG_INFINITY, f32::max);
                        prop_assert_eq!(low, -high);
                    }
                }
            }
        }
    }
}
