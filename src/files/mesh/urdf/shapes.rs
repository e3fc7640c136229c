//! Makes boxes, cylinders and spheres around the origin, of triangles that face outwards.

use std::f64::consts::{PI, TAU};

use crate::mesh::raw::RawMesh;

/// Segments of a cylinder's or sphere's circle: its sides lie at most 0.0075 % of the radius inside it.
const CIRCLE_SEGMENTS: u32 = 256;

/// Makes a box of this size.
pub(super) fn create_box(size: [f64; 3]) -> RawMesh {
    let vertices = (0..8).map(|corner| {
        std::array::from_fn(|axis| if corner >> axis & 1 == 1 { 0.5 * size[axis] } else { -0.5 * size[axis] })
    });
    let faces: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    RawMesh { vertices: vertices.collect(), triangles, ..RawMesh::default() }
}

/// Makes a cylinder along z.
pub(super) fn create_cylinder(radius: f64, length: f64) -> RawMesh {
    revolve_outline(&[[0.0, -0.5 * length], [radius, -0.5 * length], [radius, 0.5 * length], [0.0, 0.5 * length]])
}

/// Makes a sphere.
pub(super) fn create_sphere(radius: f64) -> RawMesh {
    let rows = CIRCLE_SEGMENTS / 2;
    let outline = |row: u32| {
        let angle = PI * f64::from(row) / f64::from(rows);
        // sin(pi) is not quite 0: make the poles single points.
        let across = if row == 0 || row == rows { 0.0 } else { radius * angle.sin() };
        [across, -radius * angle.cos()]
    };
    revolve_outline(&(0..=rows).map(outline).collect::<Vec<_>>())
}

/// Makes the body of revolution of an outline about z. The outline is pairs of distance from z and height, from bottom
/// to top, and its ends lie on the axis.
fn revolve_outline(outline: &[[f64; 2]]) -> RawMesh {
    let mut raw = RawMesh::default();
    let last = outline.len() - 1;
    raw.vertices.push([0.0, 0.0, outline[0][1]]);
    for &[across, height] in &outline[1..last] {
        raw.vertices.extend((0..CIRCLE_SEGMENTS).map(|k| {
            let angle = TAU * f64::from(k) / f64::from(CIRCLE_SEGMENTS);
            [across * angle.cos(), across * angle.sin(), height]
        }));
    }
    let top = raw.vertices.len() as u32;
    raw.vertices.push([0.0, 0.0, outline[last][1]]);
    let rings = last as u32 - 1;
    let at = |ring: u32, k: u32| 1 + ring * CIRCLE_SEGMENTS + k % CIRCLE_SEGMENTS;
    for k in 0..CIRCLE_SEGMENTS {
        raw.triangles.push([0, at(0, k + 1), at(0, k)]);
        for ring in 1..rings {
            let [a, b, c, d] = [at(ring - 1, k), at(ring - 1, k + 1), at(ring, k + 1), at(ring, k)];
            raw.triangles.extend([[a, b, c], [a, c, d]]);
        }
        raw.triangles.push([at(rings - 1, k), at(rings - 1, k + 1), top]);
    }
    raw
}
