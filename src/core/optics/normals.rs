//! Normals of the pad's surface.
//!
//! With w the displacement into the pad, the surface's height over the shell is f = thickness - w, growing away from
//! the camera, and N = (df/dx, df/dy, -1), normalised, faces the camera. Differences are centred, with the kernels [-1
//! 0 1] / (2 r) along rows and columns, r the pixel size (Gomes, Wilson and Luo 2019).

use super::led::Normals;
use crate::base::grid::{Grid, Rect};
use crate::base::view::{SURFACE_BORDER, View};
use crate::gelpad::Contact;

/// Computes the unit normals of the view, row-major; a flat pad has (0, 0, -1).
pub fn surface_normals(contact: &Contact, view: &View) -> Vec<[f32; 3]> {
    let [width, height] = view.resolution_px;
    let per_slope = view.mm_per_px.map(|pixel_mm| (0.5 / pixel_mm) as f32);
    let mut normals = Vec::with_capacity(width * height);
    for y in 0..height {
        let above = contact.surface.row(y);
        let here = contact.surface.row(y + SURFACE_BORDER);
        let below = contact.surface.row(y + 2 * SURFACE_BORDER);
        for x in 0..width {
            let fx = (here[x] - here[x + 2]) * per_slope[0];
            let fy = (above[x + 1] - below[x + 1]) * per_slope[1];
            let length = (fx * fx + fy * fy + 1.0).sqrt();
            // Adding 0 turns the -0.0 of a flat pad into 0.0.
            normals.push([fx / length + 0.0, fy / length + 0.0, -1.0 / length]);
        }
    }
    normals
}

/// Computes the normals along row `row` of a part of the view.
#[inline(always)]
pub(super) fn fill_row_normals(mm_per_px: [f64; 2], shape: &Grid<f32>, part: Rect, row: usize, normals: &mut Normals) {
    let width = part.width();
    let window = |dx: usize, dy: usize| &shape.row(part.y0 + row + dy)[part.x0 + dx..][..width];
    let (left, right, above, below) = (window(0, 1), window(2, 1), window(1, 0), window(1, 2));
    let [per_slope_x, per_slope_y] = mm_per_px.map(|pixel_mm| (0.5 / pixel_mm) as f32);
    let Normals { x: nx, y: ny, z: nz } = normals;
    for plane in [&mut *nx, &mut *ny, &mut *nz] {
        plane.resize(width, 0.0);
    }
    let (nx, ny, nz) = (&mut nx[..width], &mut ny[..width], &mut nz[..width]);
    for x in 0..width {
        let fx = (left[x] - right[x]) * per_slope_x;
        let fy = (above[x] - below[x]) * per_slope_y;
        [nx[x], ny[x], nz[x]] = unit_normal(fx, fy);
    }
}

/// Computes the normals at `count` pixels along a row of a surface, `spacing` pixels apart from pixel `first` on. Its
/// border is counted but not asked for.
#[inline(always)]
pub(super) fn fill_spaced_normals(
    mm_per_px: [f64; 2],
    shape: &Grid<f32>,
    [first_x, y]: [usize; 2],
    spacing: usize,
    count: usize,
    normals: &mut Normals,
) {
    let row = |y: usize| &shape.row(y)[first_x - SURFACE_BORDER..];
    let (above, here, below) = (row(y - SURFACE_BORDER), row(y), row(y + SURFACE_BORDER));
    let [per_slope_x, per_slope_y] = mm_per_px.map(|pixel_mm| (0.5 / pixel_mm) as f32);
    let Normals { x: nx, y: ny, z: nz } = normals;
    for plane in [&mut *nx, &mut *ny, &mut *nz] {
        plane.resize(count, 0.0);
    }
    for k in 0..count {
        let x = k * spacing;
        let fx = (here[x] - here[x + 2 * SURFACE_BORDER]) * per_slope_x;
        let fy = (above[x + SURFACE_BORDER] - below[x + SURFACE_BORDER]) * per_slope_y;
        [nx[k], ny[k], nz[k]] = unit_normal(fx, fy);
    }
}

/// Returns the unit vector of (fx, fy, -1).
#[inline(always)]
fn unit_normal(fx: f32, fy: f32) -> [f32; 3] {
    let inverse = 1.0 / (fx * fx + fy * fy + 1.0).sqrt();
    [fx * inverse, fy * inverse, -inverse]
}
