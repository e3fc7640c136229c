//! Heights at several places within a pixel, for pixels within which the surface bends.

use pulp::{Simd, WithSimd};

use crate::base::grid::Grid;
use crate::base::simd::dispatch;
use crate::mesh::clusters::{Clusters, MAX_VERTICES, Part};

use super::{Canvas, Projection, Seen, centres, lowered, span};

/// Samples of a pixel.
pub const SAMPLES: usize = 8;

/// Pixels along a tile.
const TILE: usize = 8;

/// Tiles of a canvas, some of which are looked at.
pub(super) struct Tiles {
    across: usize,
    wanted: Vec<bool>,
}

impl Tiles {
    /// Those of a canvas that hold one of these pixels.
    fn around(pixels: &[[u32; 2]], width: usize, height: usize) -> Self {
        let across = width.div_ceil(TILE);
        let mut wanted = vec![false; across * height.div_ceil(TILE)];
        for pixel in pixels {
            let [x, y] = pixel.map(|at| at as usize / TILE);
            wanted[y * across + x] = true;
        }
        Self { across, wanted }
    }

    /// The tiles of a row of them that pixels of these columns are in.
    #[inline(always)]
    fn row(&self, row: usize, (x0, x1): (usize, usize)) -> &[bool] {
        &self.wanted[row * self.across..][x0 / TILE..(x1 - 1) / TILE + 1]
    }

    /// True if a pixel of these columns and rows may be looked at.
    #[inline(always)]
    pub fn any(&self, columns: (usize, usize), (y0, y1): (usize, usize)) -> bool {
        (y0 / TILE..(y1 - 1) / TILE + 1).any(|row| self.row(row, columns).contains(&true))
    }

    /// Calls `visit` with the parts of a row's columns that are looked at.
    #[inline(always)]
    fn parts(&self, y: usize, (x0, x1): (usize, usize), mut visit: impl FnMut((usize, usize))) {
        let first = x0 / TILE;
        let mut from = None;
        for (k, wanted) in self.row(y / TILE, (x0, x1)).iter().enumerate() {
            let here = ((first + k) * TILE).max(x0);
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

/// Where a canvas is sampled: at some of its pixels, each with a number, at the same points around the centre of each.
pub struct Sampled {
    tiles: Tiles,
    /// The number of each pixel of the canvas; [`Self::NONE`] of one that is not sampled.
    numbers: Grid<u32>,
    /// Pixels that are sampled.
    pub count: usize,
    /// Columns from the centre to each sample, px.
    across: [f32; SAMPLES],
    /// Rows.
    down: [f32; SAMPLES],
    /// The largest of them.
    reach: f32,
}

impl Sampled {
    const NONE: u32 = u32::MAX;

    /// These pixels of a canvas, numbered in their order, at `offsets` from their centres, px.
    pub fn new(pixels: &[[u32; 2]], [width, height]: [usize; 2], offsets: &[[f64; 2]; SAMPLES]) -> Self {
        let mut numbers = Grid { width, height, data: vec![Self::NONE; width * height] };
        for (number, [x, y]) in pixels.iter().enumerate() {
            numbers.row_mut(*y as usize)[*x as usize] = number as u32;
        }
        let [across, down] = [0, 1].map(|k| offsets.map(|offset| offset[k] as f32));
        let reach = across.iter().chain(&down).fold(0.0_f32, |reach, offset| reach.max(offset.abs()));
        let tiles = Tiles::around(pixels, width, height);
        Self { tiles, numbers, count: pixels.len(), across, down, reach }
    }

    /// The number of a pixel that is sampled.
    pub fn number(&self, x: usize, y: usize) -> u32 {
        self.numbers.at(x, y)
    }
}

/// The same at the samples of pixels: `heights` are those of each sampled pixel.
pub fn raster_samples(
    object: &Clusters,
    projection: &Projection,
    canvas: Canvas,
    sampled: &Sampled,
    heights: &mut [[f32; SAMPLES]],
) {
    dispatch(RasterSamples { object, projection, canvas, sampled, heights });
}

/// Names its vectors as [`Raster`] does.
struct RasterSamples<'a> {
    object: &'a Clusters,
    projection: &'a Projection,
    canvas: Canvas,
    sampled: &'a Sampled,
    heights: &'a mut [[f32; SAMPLES]],
}

impl WithSimd for RasterSamples<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { object, projection, canvas, sampled, heights } = self;
        let mut seen = Seen::default();
        object.query(
            #[inline(always)]
            |min, max| projection.may_touch(canvas, sampled.reach, Some(&sampled.tiles), min, max),
            #[inline(always)]
            |part: Part<'_>| {
                seen.look(&part, projection, canvas);
                for corners in part.corners {
                    let [a, b, c] = corners.map(|at| at as usize % MAX_VERTICES);
                    if seen.z[a].min(seen.z[b]).min(seen.z[c]) < canvas.ceiling {
                        let corners = [seen.corner(a), seen.corner(b), seen.corner(c)];
                        triangle_samples(simd, corners, canvas, sampled, heights);
                    }
                }
            },
        );
    }
}

/// Rasterises one triangle at samples.
#[inline(always)]
fn triangle_samples<S: Simd>(
    simd: S,
    [a, b, c]: [[f32; 3]; 3],
    canvas: Canvas,
    Sampled { tiles, numbers, across, down, reach, .. }: &Sampled,
    heights: &mut [[f32; SAMPLES]],
) {
    let bounds = |k: usize, size: usize| {
        let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
        centres(low - reach, high + reach, size, canvas.margin)
    };
    let (columns, rows) = (bounds(0, canvas.width), bounds(1, canvas.height));
    if columns.0 >= columns.1 || rows.0 >= rows.1 || !tiles.any(columns, rows) {
        return;
    }
    for y in rows.0..rows.1 {
        let py = canvas.centre(y);
        // A span has a pixel to spare at each end, which is more than the samples' reach.
        let columns = match columns.1 - columns.0 {
            0..=TILE => columns,
            _ => span([a, b, c], py, *reach, columns, canvas.margin),
        };
        if columns.0 >= columns.1 {
            continue;
        }
        tiles.parts(
            y,
            columns,
            #[inline(always)]
            |(x0, x1)| {
                for (x, number) in (x0..x1).zip(&numbers.row(y)[x0..x1]) {
                    let Some(values) = heights.get_mut(*number as usize) else { continue };
                    let (px, row) = (simd.splat_f32s(canvas.centre(x)), simd.splat_f32s(py));
                    let places = S::as_simd_f32s(across).0.iter().zip(S::as_simd_f32s(down).0);
                    for (value, (across, down)) in S::as_mut_simd_f32s(values).0.iter_mut().zip(places) {
                        let point = [simd.add_f32s(px, *across), simd.add_f32s(row, *down)];
                        *value = lowered(simd, *value, [a, b, c], point);
                    }
                }
            },
        );
    }
}
