//! Rasteriser of clusters into a height map that keeps the lowest value per pixel.
//!
//! A triangle covers a pixel if the pixel's centre lies in it or on its edge. The edge functions are computed relative
//! to the pixel's centre (Woop, Benthin and Wald 2013): for two triangles that share an edge they are exact negatives
//! of each other. As edges belong to both triangles, no centre falls between them. No fused multiply-add is used, so
//! the result is the same on every x86-64.

use pulp::{Scalar, Simd, WithSimd};

use super::Placement;
use crate::base::grid::Grid;
use crate::base::simd::{dispatch_kernel, larger, smaller};
use crate::base::view::View;
use crate::mesh::clusters::{ClusterPart, Clusters, MAX_VERTICES};
use samples::Tiles;

pub use samples::{SAMPLES, SampleLayout, rasterise_samples};

mod samples;

/// The image to fill.
#[derive(Clone, Copy, Debug)]
pub struct Canvas {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Height over the pad above which nothing is kept, mm.
    pub ceiling: f32,
    /// Columns to the left of the projection, and rows above it, that belong to the canvas.
    pub margin: usize,
}

impl Canvas {
    /// Returns the coordinate of the centre of the column or row `at`. Coordinates count from the projection's corner,
    /// so that no bit of the projection depends on the margin.
    #[inline(always)]
    fn pixel_centre(self, at: usize) -> f32 {
        (at as i32 - self.margin as i32) as f32 + 0.5
    }
}

/// Affine map from an object's vertices (mm, relative to its centre) to column px, row px and height over the pad mm.
/// The centre of the projection's pixel in column i, row j is at (i + 0.5, j + 0.5).
#[derive(Clone, Copy, Debug)]
pub struct OrthographicProjection {
    linear: [[f32; 3]; 3],
    offset: [f32; 3],
}

impl OrthographicProjection {
    /// Makes the projection of an object at `placement` onto the pixels of `view`.
    pub fn new(placement: &Placement, view: &View, centre_mm: [f64; 3]) -> Self {
        let per_mm = [1.0 / view.mm_per_px[0], 1.0 / view.mm_per_px[1], 1.0];
        let middle = [view.resolution_px[0] as f64 / 2.0, view.resolution_px[1] as f64 / 2.0, 0.0];
        let mut projection = Self { linear: [[0.0; 3]; 3], offset: [0.0; 3] };
        for k in 0..3 {
            let row = placement.rotation[k];
            // In f64, because the object's centre may be far from its origin.
            let centre: f64 = row.iter().zip(centre_mm).map(|(r, c)| r * c).sum();
            projection.linear[k] = row.map(|r| (r * per_mm[k]) as f32);
            projection.offset[k] = ((centre + placement.translation_mm[k]) * per_mm[k] + middle[k]) as f32;
        }
        projection
    }

    /// Moves the corner of the image to `corner_px`.
    pub fn with_corner_at(mut self, corner_px: [f64; 2]) -> Self {
        for (offset, px) in self.offset.iter_mut().zip(corner_px) {
            *offset = (f64::from(*offset) - px) as f32;
        }
        self
    }

    #[inline(always)]
    fn project_axis(&self, k: usize, x: f32, y: f32, z: f32) -> f32 {
        let [a, b, c] = self.linear[k];
        a * x + b * y + c * z + self.offset[k]
    }

    /// Returns false if a box contains no point below the ceiling within `reach` px of a pixel's centre of the canvas;
    /// with `tiles`, of a pixel's centre in one of the wanted tiles.
    #[inline(always)]
    fn may_touch(&self, canvas: Canvas, reach: f32, tiles: Option<&Tiles>, min: [f32; 3], max: [f32; 3]) -> bool {
        let low = |k: usize| {
            let reach: f32 = (0..3).map(|j| (self.linear[k][j] * min[j]).min(self.linear[k][j] * max[j])).sum();
            reach + self.offset[k]
        };
        let high = |k: usize| {
            let reach: f32 = (0..3).map(|j| (self.linear[k][j] * min[j]).max(self.linear[k][j] * max[j])).sum();
            reach + self.offset[k]
        };
        // Rounding of the box's corners and of the vertices differs: the slack is slightly larger than the error of
        // either.
        let slack = |k: usize| 1e-5 * (low(k).abs() + high(k).abs()) + 1e-5 + if k < 2 { reach } else { 0.0 };
        let inside = high(0) + slack(0) >= canvas.pixel_centre(0)
            && low(0) - slack(0) <= canvas.pixel_centre(canvas.width)
            && high(1) + slack(1) >= canvas.pixel_centre(0)
            && low(1) - slack(1) <= canvas.pixel_centre(canvas.height)
            && low(2) - slack(2) < canvas.ceiling;
        let Some(tiles) = tiles.filter(|_| inside) else { return inside };
        let columns = centre_range(low(0) - slack(0), high(0) + slack(0), canvas.width, canvas.margin);
        let rows = centre_range(low(1) - slack(1), high(1) + slack(1), canvas.height, canvas.margin);
        columns.0 < columns.1 && rows.0 < rows.1 && tiles.any_wanted(columns, rows)
    }
}

/// Lowers `heights` (mm over the pad, initially the ceiling) to the object wherever the object lies below.
pub fn rasterise(object: &Clusters, projection: &OrthographicProjection, canvas: Canvas, heights: &mut Grid<f32>) {
    dispatch_kernel(RasterKernel { object, projection, canvas, heights });
}

/// A kernel that names its vectors: the compiler on its own processes pixels one by one.
struct RasterKernel<'a> {
    object: &'a Clusters,
    projection: &'a OrthographicProjection,
    canvas: Canvas,
    heights: &'a mut Grid<f32>,
}

impl WithSimd for RasterKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { object, projection, canvas, heights } = self;
        let mut seen = ProjectedVertices::default();
        object.query(
            #[inline(always)]
            |min, max| projection.may_touch(canvas, 0.0, None, min, max),
            #[inline(always)]
            |part: ClusterPart<'_>| {
                seen.project_part(&part, projection, canvas);
                for corners in part.corners {
                    // The remainder changes nothing, but tells the compiler that the indices are in range.
                    let [a, b, c] = corners.map(|at| at as usize % MAX_VERTICES);
                    if seen.may_cover_centre(a, b, c) && seen.z[a].min(seen.z[b]).min(seen.z[c]) < canvas.ceiling {
                        rasterise_triangle(simd, [seen.vertex(a), seen.vertex(b), seen.vertex(c)], canvas, heights);
                    }
                }
            },
        );
    }
}

/// The vertices of a part, projected.
struct ProjectedVertices {
    /// Column, px.
    x: [f32; MAX_VERTICES],
    /// Row, px.
    y: [f32; MAX_VERTICES],
    /// Height over the pad, mm.
    z: [f32; MAX_VERTICES],
    /// Position of the vertex among the pixel centres: the column's [`centre_key`] in the upper half, the row's in the
    /// lower.
    key: [u32; MAX_VERTICES],
}

impl Default for ProjectedVertices {
    fn default() -> Self {
        let zeros = [0.0; MAX_VERTICES];
        Self { x: zeros, y: zeros, z: zeros, key: [0; MAX_VERTICES] }
    }
}

impl ProjectedVertices {
    #[inline(always)]
    fn project_part(&mut self, part: &ClusterPart<'_>, projection: &OrthographicProjection, canvas: Canvas) {
        let count = part.x.len().min(MAX_VERTICES);
        let (px, py, pz) = (&part.x[..count], &part.y[..count], &part.z[..count]);
        let (x, y) = (&mut self.x[..count], &mut self.y[..count]);
        let (z, key) = (&mut self.z[..count], &mut self.key[..count]);
        for i in 0..count {
            x[i] = projection.project_axis(0, px[i], py[i], pz[i]);
            y[i] = projection.project_axis(1, px[i], py[i], pz[i]);
            z[i] = projection.project_axis(2, px[i], py[i], pz[i]);
            key[i] =
                centre_key(x[i], canvas.width, canvas.margin) << 16 | centre_key(y[i], canvas.height, canvas.margin);
        }
    }

    /// Returns false if all pixel centres lie outside the triangle's bounding box.
    #[inline(always)]
    fn may_cover_centre(&self, a: usize, b: usize, c: usize) -> bool {
        let differs = (self.key[a] ^ self.key[b]) | (self.key[a] ^ self.key[c]);
        (differs >> 16 != 0) & (differs & 0xffff != 0)
    }

    #[inline(always)]
    fn vertex(&self, at: usize) -> [f32; 3] {
        [self.x[at], self.y[at], self.z[at]]
    }
}

/// Returns the position of a coordinate among the pixel centres: twice the number of centres below it, plus one if it
/// is on a centre itself. Between coordinates with the same key there is no centre. The key is exact, as removing the
/// whole part of a float does not round. With at most 8192 px and their margins it fits in 16 bits.
#[inline(always)]
fn centre_key(px: f32, size: usize, margin: usize) -> u32 {
    let margin = margin as i32;
    // NaN remains NaN, and the cast turns it into 0.
    let near = px.clamp((-margin - 1) as f32, (size as i32 - margin) as f32);
    let whole = near.floor();
    let rest = near - whole;
    (2 * (whole as i32 + margin + 1) + i32::from(rest > 0.5) + i32::from(rest >= 0.5)) as u32
}

/// Returns the first column (or row) whose centre lies within `min..=max`, and one past the last, both cut to `0..end`.
#[inline(always)]
fn centre_range(min: f32, max: f32, end: usize, margin: usize) -> (usize, usize) {
    let margin = margin as i32;
    let cut = |px: f32| px.clamp((-margin - 1) as f32, (end as i32 - margin) as f32);
    let (low, high) = (cut(min), cut(max));
    let first = low.floor() as i32 + margin + i32::from(low - low.floor() > 0.5);
    let last = high.floor() as i32 + margin + i32::from(high - high.floor() >= 0.5);
    (first.max(0) as usize, last.clamp(0, end as i32) as usize)
}

/// Rasterises one triangle, whose corners are in px, px and mm.
#[inline(always)]
fn rasterise_triangle<S: Simd>(simd: S, [a, b, c]: [[f32; 3]; 3], canvas: Canvas, heights: &mut Grid<f32>) {
    let (x0, x1) = centre_range(a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]), canvas.width, canvas.margin);
    let (y0, y1) = centre_range(a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]), canvas.height, canvas.margin);
    if x0 >= x1 || y0 >= y1 {
        return;
    }
    let spans = (x1 - x0 > 8).then(|| EdgeSpans::new([a, b, c]));
    for y in y0..y1 {
        let py = canvas.pixel_centre(y);
        let (x0, x1) = match &spans {
            Some(spans) => spans.columns(py, 0.0, (x0, x1), canvas.margin),
            // Eight pixels at once take less time than a few one by one; the pixels outside the triangle do not change.
            None if x1 - x0 > 2 && x0 + 8 <= canvas.width => (x0, x0 + 8),
            None => (x0, x1),
        };
        let row = &mut heights.data[y * canvas.width..][..canvas.width][x0..x1];
        let mut x = canvas.pixel_centre(x0);
        let mut eights = row.chunks_exact_mut(8);
        for eight in &mut eights {
            let places = S::as_simd_f32s(&LANE_OFFSETS).0;
            for (values, place) in S::as_mut_simd_f32s(eight).0.iter_mut().zip(places) {
                let point = [simd.add_f32s(simd.splat_f32s(x), *place), simd.splat_f32s(py)];
                *values = lower_to_triangle(simd, *values, [a, b, c], point);
            }
            x += 8.0;
        }
        for value in eights.into_remainder() {
            *value = lower_to_triangle(Scalar, *value, [a, b, c], [x, py]);
            x += 1.0;
        }
    }
}

/// Offsets of eight pixels from the first.
const LANE_OFFSETS: [f32; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// Lowers heights at points to a triangle where it covers them and lies below.
#[inline(always)]
fn lower_to_triangle<S: Simd>(simd: S, heights: S::f32s, corners: [[f32; 3]; 3], point: [S::f32s; 2]) -> S::f32s {
    let from = |k: usize, corner: [f32; 3]| simd.sub_f32s(simd.splat_f32s(corner[k]), point[k]);
    let [[ax, ay], [bx, by], [cx, cy]] = corners.map(|corner| [from(0, corner), from(1, corner)]);
    let cross = |px, qy, py, qx| simd.sub_f32s(simd.mul_f32s(px, qy), simd.mul_f32s(py, qx));
    let edges = [cross(bx, cy, by, cx), cross(cx, ay, cy, ax), cross(ax, by, ay, bx)];
    let zero = simd.splat_f32s(0.0);
    let all = |[a, b, c]: [S::m32s; 3]| simd.and_m32s(simd.and_m32s(a, b), c);
    let left = all(edges.map(|edge| simd.less_than_or_equal_f32s(zero, edge)));
    let right = all(edges.map(|edge| simd.less_than_or_equal_f32s(edge, zero)));
    let sum = |[a, b, c]: [S::f32s; 3]| simd.add_f32s(simd.add_f32s(a, b), c);
    let of = |k: usize| simd.mul_f32s(edges[k], simd.splat_f32s(corners[k][2]));
    let height = simd.div_f32s(sum([of(0), of(1), of(2)]), sum(edges));
    // A triangle seen edge-on gives 0 / 0, and NaN is not below anything.
    let is_lower = simd.and_m32s(simd.or_m32s(left, right), simd.less_than_f32s(height, heights));
    simd.select_f32s(is_lower, height, heights)
}

/// The edges of a triangle, to find which columns of a row it covers.
struct EdgeSpans {
    /// Column and row of each edge's ends, px.
    from: [[f32; 3]; 3],
    to: [[f32; 3]; 3],
    /// One over the rows from end to end.
    per_row: [f32; 3],
    /// More than the rounding of a column, px.
    slack: f32,
}

impl EdgeSpans {
    #[inline(always)]
    fn new([a, b, c]: [[f32; 3]; 3]) -> Self {
        let per_row = [1.0 / (b[1] - a[1]), 1.0 / (c[1] - b[1]), 1.0 / (a[1] - c[1])];
        let widest = (b[0] - a[0]).abs() + (c[0] - b[0]).abs();
        Self { from: [a, b, c], to: [b, c, a], per_row, slack: 1.0 + 1e-6 * widest }
    }

    /// Returns the columns of a row at height `py` that the triangle can cover within `reach` of their centres; rather a
    /// few too many than one too few.
    #[inline(always)]
    fn columns(&self, py: f32, reach: f32, (x0, x1): (usize, usize), margin: usize) -> (usize, usize) {
        let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut include = |at: f32| {
            min = smaller(at, min);
            max = larger(at, max);
        };
        for edge in 0..3 {
            let (p, q) = (self.from[edge], self.to[edge]);
            let (low, high) = (smaller(p[1], q[1]), larger(p[1], q[1]));
            if py + reach < low || py - reach > high {
                continue;
            }
            for y in [py - reach, py + reach] {
                let along = ((y - p[1]) * self.per_row[edge]).clamp(0.0, 1.0);
                // NaN for a horizontal edge: then both of its ends count.
                let (from, to) = if along.is_nan() { (0.0, 1.0) } else { (along, along) };
                include(p[0] + from * (q[0] - p[0]));
                include(p[0] + to * (q[0] - p[0]));
            }
        }
        let slack = self.slack + 1e-5 * (min.abs() + max.abs());
        let (first, end) = centre_range(min - slack, max + slack, x1, margin);
        let first = first.max(x0);
        (first, end.max(first))
    }
}
