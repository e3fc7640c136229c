//! Heights at several points within a pixel, for pixels in which the surface bends.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::base::simd::dispatch_kernel;
use crate::mesh::clusters::{ClusterPart, Clusters, MAX_VERTICES};

use super::{Canvas, EdgeSpans, OrthographicProjection, ProjectedVertices, centre_range, lower_to_triangle};

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
    /// Makes the tiles of a canvas, none of them flagged.
    fn new(width: usize, height: usize) -> Self {
        let across = width.div_ceil(TILE_PX);
        Self { across, wanted: vec![false; across * height.div_ceil(TILE_PX)] }
    }

    /// Flags the tiles that contain columns of a row.
    fn flag(&mut self, y: usize, columns: &Range<usize>) {
        let first = y / TILE_PX * self.across;
        self.wanted[first + columns.start / TILE_PX..=first + (columns.end - 1) / TILE_PX].fill(true);
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
}

/// Sampled pixels beside each other in a row of a canvas.
#[derive(Clone, Debug)]
pub struct SampledRun {
    /// Row.
    pub y: usize,
    /// Columns.
    pub columns: Range<usize>,
    /// Number of the first of the pixels; all runs are numbered one after the other.
    pub first: usize,
}

impl SampledRun {
    /// Returns the numbers of the run's pixels.
    pub fn numbers(&self) -> Range<usize> {
        self.first..self.first + self.columns.len()
    }
}

/// Which pixels of a canvas are sampled, and where: at the same points around the centre of each.
pub struct SampleLayout {
    tiles: Tiles,
    /// The sampled pixels, row by row.
    runs: Vec<SampledRun>,
    /// Index in `runs` where each row begins, and the end of the last one.
    rows: Vec<usize>,
    /// Columns from the centre to each sample, px.
    across: [f32; SAMPLES],
    /// Rows from the centre to each sample, px.
    down: [f32; SAMPLES],
    /// The largest of these distances.
    reach: f32,
}

impl SampleLayout {
    /// Makes a layout for a canvas, without any rows, with samples at `offsets` from pixels' centres, px.
    pub fn new([width, height]: [usize; 2], offsets: &[[f64; 2]; SAMPLES]) -> Self {
        let [across, down] = [0, 1].map(|k| offsets.map(|offset| offset[k] as f32));
        let reach = across.iter().chain(&down).fold(0.0_f32, |reach, offset| reach.max(offset.abs()));
        Self { tiles: Tiles::new(width, height), runs: Vec::new(), rows: vec![0], across, down, reach }
    }

    /// Adds the canvas's next row, in which these columns are sampled: ranges from left to right.
    pub fn push_row(&mut self, columns: impl IntoIterator<Item = Range<usize>>) {
        let y = self.rows.len() - 1;
        for columns in columns {
            self.tiles.flag(y, &columns);
            let first = self.pixel_count();
            self.runs.push(SampledRun { y, columns, first });
        }
        self.rows.push(self.runs.len());
    }

    /// Returns the number of sampled pixels.
    pub fn pixel_count(&self) -> usize {
        self.runs.last().map_or(0, |run| run.numbers().end)
    }

    /// Returns the sampled pixels, row by row.
    pub fn runs(&self) -> &[SampledRun] {
        &self.runs
    }

    /// Returns the sampled pixels of a row.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[SampledRun] {
        &self.runs[self.rows[y]..self.rows[y + 1]]
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
    layout: &SampleLayout,
    heights: &mut [[f32; SAMPLES]],
) {
    let SampleLayout { tiles, across, down, reach, .. } = layout;
    let bounds = |k: usize, size: usize| {
        let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
        centre_range(low - reach, high + reach, size, canvas.margin)
    };
    let (columns, rows) = (bounds(0, canvas.width), bounds(1, canvas.height));
    if columns.0 >= columns.1 || rows.0 >= rows.1 || !tiles.any_wanted(columns, rows) {
        return;
    }
    let spans = (columns.1 - columns.0 > TILE_PX).then(|| EdgeSpans::new([a, b, c]));
    for y in rows.0..rows.1 {
        let runs = layout.row(y);
        let runs = &runs[runs.partition_point(|run| run.columns.end <= columns.0)..];
        if runs.first().is_none_or(|run| run.columns.start >= columns.1) {
            continue;
        }
        let py = canvas.pixel_centre(y);
        // A span has a spare pixel at each end, which is more than the samples' reach.
        let columns = spans.as_ref().map_or(columns, |spans| spans.columns(py, *reach, columns, canvas.margin));
        for run in runs {
            let (start, end) = (run.columns.start.max(columns.0), run.columns.end.min(columns.1));
            if start >= end {
                continue;
            }
            let heights = &mut heights[run.first + (start - run.columns.start)..][..end - start];
            for (x, values) in (start..end).zip(heights) {
                let (px, row) = (simd.splat_f32s(canvas.pixel_centre(x)), simd.splat_f32s(py));
                let places = S::as_simd_f32s(across).0.iter().zip(S::as_simd_f32s(down).0);
                for (value, (across, down)) in S::as_mut_simd_f32s(values).0.iter_mut().zip(places) {
                    let point = [simd.add_f32s(px, *across), simd.add_f32s(row, *down)];
                    *value = lower_to_triangle(simd, *value, [a, b, c], point);
                }
            }
        }
    }
}
