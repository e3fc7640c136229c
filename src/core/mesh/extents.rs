//! Sizes of a mesh and of its triangles.

use super::Mesh;

/// Returns half the extents of a mesh along x, y and z, mm. A mesh is centred: its bounding box has its middle at zero.
pub fn half_extents_mm(mesh: &Mesh) -> [f32; 3] {
    let mut half = [0.0_f32; 3];
    for vertex in &mesh.vertices {
        for k in 0..3 {
            half[k] = half[k].max(vertex[k].abs());
        }
    }
    half
}

/// Returns the distance of the farthest vertex from the middle of the bounding box, mm.
pub fn radius_mm(mesh: &Mesh) -> f64 {
    let square = |vertex: &[f32; 3]| vertex.iter().map(|at| f64::from(*at) * f64::from(*at)).sum::<f64>();
    mesh.vertices.iter().map(square).fold(0.0, f64::max).sqrt()
}

/// Returns the number of pixel rows that triangles fill in a capture of a side in the middle of the view, as the mean
/// of the six sides. Rows are `row_mm` apart.
pub fn count_capture_rows(mesh: &Mesh, field_of_view_mm: [f64; 2], row_mm: f64) -> f64 {
    // The object's axes along the image's x and y. Opposite sides have the same ones but for signs.
    const AXES: [[usize; 2]; 3] = [[2, 1], [0, 2], [0, 1]];
    let half = field_of_view_mm.map(|mm| (mm / 2.0) as f32);
    let mut mm = 0.0;
    for [a, b, c] in &mesh.triangles {
        let [a, b, c] = [a, b, c].map(|vertex| mesh.vertices[*vertex as usize]);
        let span = |axis: usize, half: f32| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            high.min(half) - low.max(-half)
        };
        for [x, y] in AXES {
            if span(x, half[0]) >= 0.0 {
                mm += f64::from(span(y, half[1]).max(0.0));
            }
        }
    }
    mm / row_mm / AXES.len() as f64
}
