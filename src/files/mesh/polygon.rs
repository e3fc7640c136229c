//! Cuts the polygons of mesh files into triangles, concave ones too.
//!
//! A convex quad is cut along its shorter diagonal. Every other polygon is projected along the main axis of its normal
//! (Newell's method, as in Sutherland et al. 1974) and cut by ear clipping (crate `earcut`). A polygon without a normal
//! becomes a fan; [`Mesh::new`](gelsim_core::mesh::Mesh::new) drops those of its triangles that have no area.

use super::MeshFileProblem;
use earcut::Earcut;

/// Most corners of one polygon. Ear clipping is quadratic for polygons that cross themselves: a damaged file could keep
/// it busy for hours.
pub(super) const MAX_CORNERS: usize = 1 << 14;

/// Most work for the polygons of a mesh that are neither small nor convex, as the sum of their squared numbers of
/// corners: about a second of ear clipping if they cross themselves.
const MAX_WORK: usize = 1 << 25;
/// Most corners of a small polygon.
const FEW_CORNERS: usize = 16;

const TRIANGULATE_HELP: &str =
    "cut its faces into triangles when it is exported (Triangulate in Blender and in most CAD programs)";

/// Makes the error for a polygon with this many corners.
pub(super) fn too_many_corners(count: usize) -> MeshFileProblem {
    let what = format!("a face has {count} corners, more than the {MAX_CORNERS} allowed");
    MeshFileProblem::with_help(what, TRIANGULATE_HELP)
}

/// Cuts polygons. It keeps its buffers, so that a mesh needs only one of it.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    ears: Vec<u32>,
    corners_squared: usize,
}

impl Triangulator {
    pub(super) fn new() -> Self {
        Triangulator { earcut: Earcut::new(), flat: Vec::new(), ears: Vec::new(), corners_squared: 0 }
    }

    /// Appends the triangles of the polygon, with the same orientation. Every corner must be an index of `vertices`.
    ///
    /// One or two corners give one triangle without area, so that they are counted. A polygon with a corner that is not
    /// finite becomes a fan around that corner, all of which is dropped later.
    pub(super) fn triangulate(
        &mut self,
        vertices: &[[f64; 3]],
        corners: &[u32],
        triangles: &mut Vec<[u32; 3]>,
    ) -> Result<(), MeshFileProblem> {
        match *corners {
            [] => {}
            [a] => triangles.push([a, a, a]),
            [a, b] => triangles.push([a, b, b]),
            [a, b, c] => triangles.push([a, b, c]),
            _ if corners.len() > MAX_CORNERS => {
                return Err(too_many_corners(corners.len()));
            }
            _ => {
                let at = |corner: u32| vertices[corner as usize];
                let hub = corners.iter().position(|&corner| !at(corner).iter().all(|x| x.is_finite()));
                if let Some(hub) = hub {
                    push_fan(corners, hub, triangles);
                } else if let [a, b, c, d] = *corners
                    && let Some(two) = split_quad([a, b, c, d], [a, b, c, d].map(at))
                {
                    triangles.extend(two);
                } else if self.project_to_plane(vertices, corners) {
                    if corners.len() > FEW_CORNERS && !is_convex(&self.flat) {
                        self.corners_squared += corners.len().pow(2);
                    }
                    if self.corners_squared > MAX_WORK {
                        let what = "the concave faces up to here have too many corners";
                        return Err(MeshFileProblem::with_help(what, TRIANGULATE_HELP));
                    }
                    self.earcut.earcut_slice(&self.flat, &[], &mut self.ears);
                    if self.ears.is_empty() {
                        push_fan(corners, 0, triangles);
                    }
                    let ears = self.ears.as_chunks::<3>().0.iter();
                    triangles.extend(ears.map(|ear| ear.map(|corner| corners[corner as usize])));
                } else {
                    push_fan(corners, 0, triangles);
                }
            }
        }
        Ok(())
    }

    /// Fills `flat` with the polygon seen along the main axis of its normal, counterclockwise and about one unit wide,
    /// so that nothing overflows or underflows in ear clipping. Returns false if the polygon has no normal.
    fn project_to_plane(&mut self, vertices: &[[f64; 3]], corners: &[u32]) -> bool {
        let at = |corner: u32| vertices[corner as usize];
        let origin = at(corners[0]);
        let from_origin = |corner: u32| subtract(at(corner), origin);
        let reach =
            corners.iter().flat_map(|&corner| from_origin(corner)).fold(0.0, |reach: f64, x| reach.max(x.abs()));
        // Outside this range the squared lengths would overflow or vanish.
        if !(1e-200..1e200).contains(&reach) {
            return false;
        }
        // A power of two scales without rounding.
        let scale = reach.log2().floor().exp2().recip();
        let point = |corner: u32| from_origin(corner).map(|x| x * scale);

        // Newell's normal: the sum of the cross products of successive corners.
        let mut normal = [0.0; 3];
        let mut previous = point(corners[corners.len() - 1]);
        for &corner in corners {
            let next = point(corner);
            let area = cross(previous, next);
            normal = [0, 1, 2].map(|axis| normal[axis] + area[axis]);
            previous = next;
        }
        let axis = (0..3).fold(0, |best, axis| if normal[axis].abs() > normal[best].abs() { axis } else { best });
        let (right, up) = match (axis, normal[axis]) {
            (_, 0.0) => return false,
            (_, length) if length > 0.0 => ((axis + 1) % 3, (axis + 2) % 3),
            _ => ((axis + 2) % 3, (axis + 1) % 3),
        };
        self.flat.clear();
        self.flat.extend(corners.iter().map(|&corner| {
            let point = point(corner);
            [point[right], point[up]]
        }));
        true
    }
}

/// Returns true if a closed line turns left everywhere and goes around once.
fn is_convex(points: &[[f64; 2]]) -> bool {
    let count = points.len();
    let step = |i: usize| {
        let (from, to) = (points[i % count], points[(i + 1) % count]);
        [to[0] - from[0], to[1] - from[1]]
    };
    let turns_left = |i: usize| {
        let (u, v) = (step(i), step(i + 1));
        u[0] * v[1] >= u[1] * v[0]
    };
    // An outline that goes around once begins to go to the right only once.
    let is_start = |i: &usize| step(*i)[0] > 0.0 && step(*i + count - 1)[0] <= 0.0;
    (0..count).all(turns_left) && (0..count).filter(is_start).count() <= 1
}

/// Returns the two triangles of a convex quad, or `None` for any other.
fn split_quad([a, b, c, d]: [u32; 4], [p, q, r, s]: [[f64; 3]; 4]) -> Option<[[u32; 3]; 2]> {
    let normal = |p, q, r| cross(subtract(q, p), subtract(r, p));
    let is_valid_along_ac = dot(normal(p, q, r), normal(p, r, s)) > 0.0;
    let is_valid_along_bd = dot(normal(p, q, s), normal(q, r, s)) > 0.0;
    if !(is_valid_along_ac && is_valid_along_bd) {
        return None;
    }
    let [ac, bd] = [subtract(r, p), subtract(s, q)].map(|diagonal| dot(diagonal, diagonal));
    // The margin keeps rounding from choosing different diagonals for equal rectangles.
    if bd < ac * (1.0 - 1e-6) { Some([[a, b, d], [b, c, d]]) } else { Some([[a, b, c], [a, c, d]]) }
}

fn push_fan(corners: &[u32], hub: usize, triangles: &mut Vec<[u32; 3]>) {
    let (end, start) = corners.split_at(hub);
    let mut rim = start.iter().chain(end).copied();
    if let (Some(hub), Some(mut last)) = (rim.next(), rim.next()) {
        for corner in rim {
            triangles.push([hub, last, corner]);
            last = corner;
        }
    }
}

fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const L: [[f64; 2]; 6] = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
    const STAR: [[f64; 2]; 8] =
        [[0.0, 4.0], [-1.0, 1.0], [-4.0, 0.0], [-1.0, -1.0], [0.0, -4.0], [1.0, -1.0], [4.0, 0.0], [1.0, 1.0]];

    fn cut(vertices: &[[f64; 3]]) -> Vec<[u32; 3]> {
        let corners: Vec<u32> = (0..vertices.len() as u32).collect();
        let mut triangles = Vec::new();
        Triangulator::new().triangulate(vertices, &corners, &mut triangles).unwrap();
        triangles
    }

    /// Sum of the triangles' normals (twice their area), and of their lengths.
    fn areas(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> ([f64; 3], f64) {
        let mut sum = [0.0; 3];
        let mut length = 0.0;
        for triangle in triangles {
            let [a, b, c] = triangle.map(|corner| vertices[corner as usize]);
            let normal = cross(subtract(b, a), subtract(c, a));
            sum = [0, 1, 2].map(|axis| sum[axis] + normal[axis]);
            length += dot(normal, normal).sqrt();
        }
        (sum, length)
    }

    #[test]
    fn concave_polygons_keep_their_area_exactly_and_their_sense() {
        for (outline, twice_area) in [(&L[..], 12.0), (&STAR[..], 32.0)] {
            for axis in 0..3 {
                for (sense, from) in [(1.0, 0), (1.0, 3), (-1.0, 0), (-1.0, 2)] {
                    let mut vertices: Vec<[f64; 3]> = outline
                        .iter()
                        .map(|&[x, y]| {
                            let mut vertex = [0.0; 3];
                            vertex[(axis + 1) % 3] = x;
                            vertex[(axis + 2) % 3] = y;
                            vertex[axis] = 7.0;
                            vertex
                        })
                        .collect();
                    if sense < 0.0 {
                        vertices.reverse();
                    }
                    vertices.rotate_left(from);
                    let triangles = cut(&vertices);
                    let (sum, length) = areas(&vertices, &triangles);
                    assert_eq!(length, twice_area, "{triangles:?}");
                    assert_eq!(sum[axis], sense * twice_area);
                    assert_eq!(triangles.len(), vertices.len() - 2);
                }
            }
        }
    }

    #[test]
    fn a_tilted_star_keeps_its_area() {
        let vertices: Vec<[f64; 3]> = STAR.iter().map(|&[x, y]| [1e3 + 0.6 * x, y + 5.0, 0.8 * x - 2.0]).collect();
        let (sum, length) = areas(&vertices, &cut(&vertices));
        assert!((length - 32.0).abs() < 1e-9);
        assert!((dot(sum, sum).sqrt() - 32.0).abs() < 1e-9);
    }

    #[test]
    fn quads_are_cut_along_the_better_diagonal() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(cut(&square), [[0, 1, 2], [0, 2, 3]]);
        let mut kite = square;
        kite[2] = [3.0, 3.0, 0.0];
        assert_eq!(cut(&kite), [[0, 1, 3], [1, 2, 3]]);
        let mut dart = square;
        dart[2] = [0.25, 0.25, 0.0];
        assert_eq!(areas(&dart, &cut(&dart)).1, 0.5);
        let mut corner_on_an_edge = square;
        corner_on_an_edge[1] = [0.5, 0.5, 0.0];
        assert_eq!(areas(&corner_on_an_edge, &cut(&corner_on_an_edge)).1, 1.0);
    }

    #[test]
    fn polygons_without_a_normal_become_a_fan() {
        let line: Vec<[f64; 3]> = (0..5).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        assert_eq!(cut(&line), [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        assert_eq!(cut(&[[3.0; 3]; 4]), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn a_corner_that_is_not_finite_is_in_every_triangle() {
        let mut vertices: Vec<[f64; 3]> = L.iter().map(|&[x, y]| [x, y, 0.0]).collect();
        vertices[2][1] = f64::NAN;
        let triangles = cut(&vertices);
        assert_eq!(triangles.len(), 4);
        assert!(triangles.iter().all(|triangle| triangle.contains(&2)));
    }

    #[test]
    fn fewer_than_three_corners_are_a_triangle_without_area() {
        assert_eq!(cut(&[[0.0; 3]]), [[0, 0, 0]]);
        assert_eq!(cut(&[[0.0; 3], [1.0; 3]]), [[0, 1, 1]]);
        assert_eq!(cut(&[]), [[0u32; 3]; 0]);
    }

    #[test]
    fn a_polygon_with_too_many_corners_is_refused() {
        let vertices = vec![[0.0; 3]; MAX_CORNERS + 1];
        let corners: Vec<u32> = (0..vertices.len() as u32).collect();
        let problem = Triangulator::new().triangulate(&vertices, &corners, &mut Vec::new()).unwrap_err();
        assert_eq!(problem.to_string(), "a face has 16385 corners, more than the 16384 allowed");
    }

    #[test]
    fn large_polygons_that_cross_themselves_are_refused_before_they_take_minutes() {
        let circle = |count: u32, turns: u32| -> Vec<[f64; 3]> {
            let angle = |i: u32| std::f64::consts::TAU * f64::from(i * turns % count) / f64::from(count);
            (0..count).map(|i| [angle(i).cos(), angle(i).sin(), 0.0]).collect()
        };
        let cut_all = |vertices: &[[f64; 3]], times: usize| {
            let corners: Vec<u32> = (0..vertices.len() as u32).collect();
            let (mut cutter, mut triangles) = (Triangulator::new(), Vec::new());
            (0..times)
                .try_for_each(|_| cutter.triangulate(vertices, &corners, &mut triangles))
                .map(|()| triangles.len())
        };
        // A cap of many corners is cut however often it comes; a star of as many is not.
        assert_eq!(cut_all(&circle(9973, 1), 9).ok(), Some(9 * 9971));
        assert!(cut_all(&circle(9973, 2), 1).unwrap_err().to_string().contains("too many corners"));
        assert!(cut_all(&circle(997, 400), 4).is_ok());
        assert!(cut_all(&circle(997, 400), 40).is_err());
    }

    proptest! {
        #[test]
        fn star_shaped_polygons_keep_their_area(
            radii in prop::collection::vec(0.1f64..10.0, 5..200),
            tilt in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let n = radii.len() as f64;
            let vertices: Vec<[f64; 3]> = radii
                .iter()
                .enumerate()
                .map(|(i, r)| {
                    let angle = std::f64::consts::TAU * i as f64 / n;
                    let (x, y) = (r * angle.cos(), r * angle.sin());
                    [x, y + tilt[2] * x, tilt[0] * x + tilt[1] * y]
                })
                .collect();
            let (sum, length) = areas(&vertices, &cut(&vertices));
            let around = (0..vertices.len()).fold([0.0; 3], |sum: [f64; 3], i| {
                let area = cross(vertices[i], vertices[(i + 1) % vertices.len()]);
                [0, 1, 2].map(|axis| sum[axis] + area[axis])
            });
            let expected = dot(around, around).sqrt();
            prop_assert!((length - expected).abs() < 1e-9 * expected, "{length} for {expected}");
            prop_assert!(dot(sum, around) > 0.0);
        }

        #[test]
        fn any_polygon_gives_triangles_of_its_own_corners(
            vertices in prop::collection::vec(prop::array::uniform3(prop::num::f64::ANY), 0..120),
        ) {
            for triangle in cut(&vertices) {
                prop_assert!(triangle.iter().all(|&corner| (corner as usize) < vertices.len()));
            }
        }

        #[test]
        fn polygons_on_a_coarse_grid_never_hang(
            vertices in prop::collection::vec(prop::array::uniform3(-2i8..=2), 0..200),
        ) {
            let vertices: Vec<[f64; 3]> = vertices.iter().map(|v| v.map(f64::from)).collect();
            prop_assert!(cut(&vertices).len() <= vertices.len() + 1);
        }
    }
}
