//! Heights at several points within a pixel, for pixels in which the surface bends.

use pulp::{Simd, WithSimd};

use crate::base::grid::Grid;
use crate::base::simd::dispatch_kernel;
use crate::mesh::clusters::{ClusterPart, Clusters, MAX_VERTICES};

use super::{Canvas, OrthographicProjection, ProjectedVertices, centre_range, lower_to_triangle, row_span};

/// Samples per pixel.
pub const SAMPLES: usize = 8;

/// Pixels along a side of a tile.
const TILE_PX: usize = 8;

/// The tiles of a canvas, with a flag for those that contain sampled pixels.
pub(super) struct Tiles {
    across: usize,
    wanted: Vec<bool>,
}

impl Tiles {
    /// Flags the tiles of a canvas that contain one of the pixels.
    fn of_pixels(pixels: &[[u32; 2]], width: usize, height: usize) -> Self {
        let across = width.div_ceil(TILE_PX);
        let mut wanted = vec![false; across * height.div_ceil(TILE_PX)];
        for pixel in pixels {
            let [x, y] = pixel.map(|at| at as usize / TILE_PX);
            wanted[y * across + x] = true;
        }
        Self { across, wanted }
    }

    /// Returns the flags of a row of tiles for a range of pixel columns.
    #[inline(always)]
    fn row_tiles(&self, row: usize, (x0, x1): (usize, usize)) -> &[bool] {
        &self.wanted[row * self.across..][x0 / TILE_PX..(x1 - 1) / TILE_PX + 1]
    }

    /// Returns true if a pixel within these columns and rows may be sampled.
    #[inline(always)]
    pub fn any_wanted(&self, columns: (usize, usize), (y0, y1): (usize, usize)) -> bool {
        (y0 / TILE_PX..(y1 - 1) / TILE_PX + 1).any(|row| self.row_tiles(row, columns).contains(&true))
    }

    /// Calls `visit` with the ranges of a row's columns that lie in flagged tiles.
    #[inline(always)]
    fn visit_wanted_spans(&self, y: usize, (x0, x1): (usize, usize), mut visit: impl FnMut((usize, usize))) {
        let first = x0 / TILE_PX;
        let mut from = None;
        for (k, wanted) in self.row_tiles(y / TILE_PX, (x0, x1)).iter().enumerate() {
            let here = ((first + k) * TILE_PX).max(x0);
            match (from, *wanted) {
                (None, true) => from = Some(here),
                (Some(start), false) => {
                    visit((start, here));
                    from = None;
                }
                _ => {}
            }
        }
        if let Some(start) = from {
            visit((start, x1));
        }
    }
}

/// Which pixels of a canvas are sampled, and where: at the same points around the centre of each.
pub struct SampleLayout {
    tiles: Tiles,
    /// The number of each pixel of the canvas; [`Self::NOT_SAMPLED`] for those that are not sampled.
    numbers: Grid<u32>,
    /// Number of sampled pixels.
    pub count: usize,
    /// Columns from the centre to each sample, px.
    across: [f32; SAMPLES],
    /// Rows from the centre to each sample, px.
    down: [f32; SAMPLES],
    /// The largest of these distances.
    reach: f32,
}

impl SampleLayout {
    const NOT_SAMPLED: u32 = u32::MAX;

    /// Samples these pixels of a canvas, numbered in their order, at `offsets` from their centres, px.
    pub fn new(pixels: &[[u32; 2]], [width, height]: [usize; 2], offsets: &[[f64; 2]; SAMPLES]) -> Self {
        let mut numbers = Grid { width, height, data: vec![Self::NOT_SAMPLED; width * height] };
        for (number, [x, y]) in pixels.iter().enumerate() {
            numbers.row_mut(*y as usize)[*x as usize] = number as u32;
        }
        let [across, down] = [0, 1].map(|k| offsets.map(|offset| offset[k] as f32));
        let reach = across.iter().chain(&down).fold(0.0_f32, |reach, offset| reach.max(offset.abs()));
        let tiles = Tiles::of_pixels(pixels, width, height);
        Self { tiles, numbers, count: pixels.len(), across, down, reach }
    }

    /// Returns the number of a pixel that is sampled.
    pub fn pixel_number(&self, x: usize, y: usize) -> u32 {
        self.numbers.at(x, y)
    }
}

/// Lowers the heights at the samples of pixels to the object wherever the object lies below. `heights` has one entry
/// for each sampled pixel.
pub fn rasterise_samples(
    object: &Clusters,
    projection: &OrthographicProjection,
    canvas: Canvas,
    sampled: &SampleLayout,
    heights: &mut [[f32; SAMPLES]],
) {
    dispatch_kernel(SamplesKernel { object, projection, canvas, sampled, heights });
}

/// A kernel that names its vectors, like [`super::RasterKernel`].
struct SamplesKernel<'a> {
    object: &'a Clusters,
    projection: &'a OrthographicProjection,
    canvas: Canvas,
    sampled: &'a SampleLayout,
    heights: &'a mut [[f32; SAMPLES]],
}

impl WithSimd for SamplesKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { object, projection, canvas, sampled, heights } = self;
        let mut seen = ProjectedVertices::default();
        object.query(
            #[inline(always)]
            |min, max| projection.may_touch(canvas, sampled.reach, Some(&sampled.tiles), min, max),
            #[inline(always)]
            |part: ClusterPart<'_>| {
                seen.project_part(&part, projection, canvas);
                for corners in part.corners {
                    let [a, b, c] = corners.map(|at| at as usize % MAX_VERTICES);
                    if seen.z[a].min(seen.z[b]).min(seen.z[c]) < canvas.ceiling {
                        let corners = [seen.vertex(a), seen.vertex(b), seen.vertex(c)];
                        rasterise_triangle_samples(simd, corners, canvas, sampled, heights);
                    }
                }
            },
        );
    }
}

/// Rasterises one triangle at the samples of pixels.
#[inline(always)]
fn rasterise_triangle_samples<S: Simd>(
    simd: S,
    [a, b, c]: [[f32; 3]; 3],
    canvas: Canvas,
    SampleLayout { tiles, numbers, across, down, reach, .. }: &SampleLayout,
    heights: &mut [[f32; SAMPLES]],
) {
    let bounds = |k: usize, size: usize| {
        let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
        centre_range(low - reach, high + reach, size, canvas.margin)
    };
    let (columns, rows) = (bounds(0, canvas.width), bounds(1, canvas.height));
    if columns.0 >= columns.1 || rows.0 >= rows.1 || !tiles.any_wanted(columns, rows) {
        return;
    }
    for y in rows.0..rows.1 {
        let py = canvas.pixel_centre(y);
        // A span has a spare pixel at each end, which is more than the samples' reach.
        let columns = match columns.1 - columns.0 {
            0..=TILE_PX => columns,
            _ => row_span([a, b, c], py, *reach, columns, canvas.margin),
        };
        if columns.0 >= columns.1 {
            continue;
        }
        tiles.visit_wanted_spans(
            y,
            columns,
            #[inline(always)]
            |(x0, x1)| {
                for (x, number) in (x0..x1).zip(&numbers.row(y)[x0..x1]) {
                    // Pixels without samples have the number `NOT_SAMPLED`, which is out of range.
                    let Some(values) = heights.get_mut(*number as usize) else { continue };
                    let (px, row) = (simd.splat_f32s(canvas.pixel_centre(x)), simd.splat_f32s(py));
                    let places = S::as_simd_f32s(across).0.iter().zip(S::as_simd_f32s(down).0);
                    for (value, (across, down)) in S::as_mut_simd_f32s(values).0.iter_mut().zip(places) {
                        let point = [simd.add_f32s(px, *across), simd.add_f32s(row, *down)];
                        *value = lower_to_triangle(simd, *value, [a, b, c], point);
                    }
                }
            },
        );
    }
}
