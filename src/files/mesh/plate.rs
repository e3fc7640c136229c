//! Makes an object of a height map: a plate with the relief on its side towards -z, closed all around.
//!
//! Columns go along x and rows along y, as in the sensor's image, so that a plate with its side -z on the pad looks as
//! the map does. Samples are vertices. Each square is divided along the diagonal that is less steep.

use std::path::Path;

use super::{MeshFileError, MeshFileProblem, RawMesh};
use crate::{hash, heights, input};
use gelsim_core::base::grid::Grid;
use gelsim_core::mesh::{CleanupReport, Mesh};

/// Most samples of a height map. Each becomes two triangles.
const MAX_PX: usize = 2_000_000;

/// Thickness of the plate under the relief, as a multiple of the relief's height.
const BACK_PER_RELIEF: f64 = 1.0;
/// The least thickness of the plate under the relief, mm.
const MIN_BACK_MM: f64 = 1.0;

/// The size of a height map's object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateSize {
    /// Distance between samples, mm.
    pub mm_per_px: f64,
    /// Height of the largest value over the smallest that its type holds, mm.
    pub height_mm: f64,
}

/// Returns true if a file's extension is that of a height map.
pub fn is_height_map(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    ["png", "npy", "npz", "exr"].into_iter().any(|known| ending.as_deref() == Some(known.as_ref()))
}

/// Reads the height map at `path` as an object. Also returns the SHA-256 of the file's bytes.
///
/// # Errors
///
/// Those of [`super::load`], and what makes a file no height map.
pub fn load_plate(path: &Path, size: PlateSize) -> Result<(Mesh, CleanupReport, String), MeshFileError> {
    let in_file = |error: MeshFileError| error.in_file(path);
    let bytes = input::read(path, input::MAX_IMAGE_BYTES)
        .map_err(|error| in_file(MeshFileProblem::from_io_error(error).into()))?;
    let heights = heights::decode_height_map(&bytes)
        .map_err(|reason| in_file(MeshFileProblem::InvalidHeightMap(reason).into()))?;
    let raw =
        build_plate(&heights, size).map_err(|reason| in_file(MeshFileProblem::InvalidHeightMap(reason).into()))?;
    let (mesh, cleaned) = raw.into_mesh(1.0).map_err(in_file)?;
    Ok((mesh, cleaned, hash::sha256(&bytes)))
}

fn build_plate(heights: &Grid<f32>, size: PlateSize) -> Result<RawMesh, String> {
    let Grid { width, height, .. } = *heights;
    if width < 2 || height < 2 {
        return Err(format!("{width}x{height} px are no surface: it takes 2 at least on each side"));
    }
    if width * height > MAX_PX {
        return Err(format!("{width}x{height} px are more than {MAX_PX}: make it smaller, and mm_per_px larger"));
    }
    let PlateSize { mm_per_px, height_mm } = size;
    let back_mm = (BACK_PER_RELIEF * height_mm).max(MIN_BACK_MM);
    let place = |at: usize, count: usize| (at as f64 + 0.5 - count as f64 / 2.0) * mm_per_px;
    let mut raw = RawMesh::default();
    for y in 0..height {
        let row = heights.row(y).iter().enumerate();
        raw.vertices.extend(row.map(|(x, h)| [place(x, width), place(y, height), -f64::from(*h) * height_mm]));
    }
    let front = |x: usize, y: usize| (y * width + x) as u32;
    for y in 1..height {
        for x in 1..width {
            let [a, b, c, d] = [front(x - 1, y - 1), front(x, y - 1), front(x - 1, y), front(x, y)];
            let drop = |p: u32, q: u32| (heights.data[p as usize] - heights.data[q as usize]).abs();
            raw.triangles.extend(match drop(a, d) <= drop(b, c) {
                true => [[a, d, b], [a, c, d]],
                false => [[a, c, b], [b, c, d]],
            });
        }
    }
    // The rim once around, from x towards y; the same points follow on the back.
    let rim: Vec<u32> = (0..width - 1)
        .map(|x| front(x, 0))
        .chain((0..height - 1).map(|y| front(width - 1, y)))
        .chain((1..width).rev().map(|x| front(x, height - 1)))
        .chain((1..height).rev().map(|y| front(0, y)))
        .collect();
    let first = raw.vertices.len() as u32;
    for corner in &rim {
        let [x, y, _] = raw.vertices[*corner as usize];
        raw.vertices.push([x, y, back_mm]);
    }
    let middle = raw.vertices.len() as u32;
    raw.vertices.push([0.0, 0.0, back_mm]);
    for (i, corner) in rim.iter().enumerate() {
        let next = (i + 1) % rim.len();
        let (behind, behind_next) = (first + i as u32, first + next as u32);
        raw.triangles.extend([
            [*corner, rim[next], behind],
            [rim[next], behind_next, behind],
            [middle, behind, behind_next],
        ]);
    }
    Ok(raw)
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    const SIZE: PlateSize = PlateSize { mm_per_px: 0.5, height_mm: 2.0 };

    fn map(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Grid<f32> {
        let data = (0..width * height).map(|at| value(at % width, at / width)).collect();
        Grid { width, height, data }
    }

    #[test]
    fn a_plate_is_closed_and_its_faces_look_outwards() {
        let heights = map(5, 4, |x, y| ((3 * x + 7 * y) % 5) as f32 / 4.0);
        let raw = build_plate(&heights, SIZE).expect("a plate");
        let mut edges = HashMap::new();
        let mut volume = 0.0;
        for triangle in &raw.triangles {
            for k in 0..3 {
                *edges.entry((triangle[k], triangle[(k + 1) % 3])).or_insert(0) += 1;
            }
            let [a, b, c] = triangle.map(|corner| glam::DVec3::from_array(raw.vertices[corner as usize]));
            volume += a.dot(b.cross(c)) / 6.0;
        }
        assert!(edges.iter().all(|((a, b), count)| *count == 1 && edges.get(&(*b, *a)) == Some(&1)));
        // Between the plate without relief and one as high all over.
        let area = 4.0 * 3.0 * 0.25;
        assert!(volume > 2.0 * area && volume < 4.0 * area, "{volume}");
        let level = build_plate(&map(5, 4, |_, _| 0.25), SIZE).expect("a plate");
        let lowest = level.vertices.iter().map(|vertex| vertex[2]).fold(f64::INFINITY, f64::min);
        assert_eq!(lowest, -0.5);
    }

    #[test]
    fn a_map_is_seen_upright_with_its_peaks_towards_the_pad() {
        let raw = build_plate(&map(3, 2, |x, y| if (x, y) == (2, 0) { 1.0 } else { 0.0 }), SIZE).expect("a plate");
        assert_eq!(raw.vertices[2], [0.5, -0.25, -2.0]);
    }

    #[test]
    fn maps_that_are_no_surface_are_refused() {
        let refused = |width, height| build_plate(&map(width, height, |_, _| 0.0), SIZE).expect_err("no plate");
        assert_eq!(refused(1, 9), "1x9 px are no surface: it takes 2 at least on each side");
        assert!(refused(2001, 1000).starts_with("2001x1000 px are more than 2000000"));
    }
}
