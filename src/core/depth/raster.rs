//! Rasteriser of clusters into a height map that keeps the lowest value per pixel.
//!
//! A triangle covers a pixel if the pixel's centre lies in it or on its edge. The edge functions are taken relative to
//! the pixel's centre (Woop, Benthin and Wald 2013): for two triangles that share an edge they are exact negatives of
//! each other, so that, with edges counted in on both sides, no centre falls between them. No fused multiply-add: the
//! result is the same on every x86-64.

use pulp::{Scalar, Simd, WithSimd};

use super::Placement;
use crate::base::grid::Grid;
use crate::base::simd::dispatch;
use crate::base::view::View;
use crate::mesh::clusters::{Clusters, MAX_VERTICES, Part};
use samples::Tiles;

pub use samples::{SAMPLES, Sampled, raster_samples};

mod samples;

/// The image to fill.
#[derive(Clone, Copy, Debug)]
pub struct Canvas {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Height over the pad from which on nothing is kept, mm.
    pub ceiling: f32,
    /// Columns left of the projection, and rows above it, that are part of the canvas.
    pub margin: usize,
}

impl Canvas {
    /// Coordinate of the centre of the image's column or row number `at`. Coordinates count from the projection's corner, so
    /// that no bit of the projection depends on the margin.
    #[inline(always)]
    fn centre(self, at: usize) -> f32 {
        (at as i32 - self.margin as i32) as f32 + 0.5
    }
}

/// Affine map from an object's vertices (mm, relative to its centre) to column px, row px and height over the pad mm.
/// The centre of the projection's pixel in column i, row j is at (i + 0.5, j + 0.5).
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    linear: [[f32; 3]; 3],
    offset: [f32; 3],
}

impl Projection {
    /// The map for an object at `placement`, seen by `camera`.
    pub fn new(placement: &Placement, view: &View, centre_mm: [f64; 3]) -> Self {
        let per_mm = [1.0 / view.mm_per_px[0], 1.0 / view.mm_per_px[1], 1.0];
        let middle = [view.resolution_px[0] as f64 / 2.0, view.resolution_px[1] as f64 / 2.0, 0.0];
        let mut projection = Self { linear: [[0.0; 3]; 3], offset: [0.0; 3] };
        for k in 0..3 {
            let row = placement.rotation[k];
            // In f64: the object's centre may be far from its origin.
            let centre: f64 = row.iter().zip(centre_mm).map(|(r, c)| r * c).sum();
            projection.linear[k] = row.map(|r| (r * per_mm[k]) as f32);
            projection.offset[k] = ((centre + placement.translation_mm[k]) * per_mm[k] + middle[k]) as f32;
        }
        projection
    }

    /// The same with the picture's corner moved by so many pixels.
    pub fn seen_from(mut self, corner_px: [f64; 2]) -> Self {
        for (offset, px) in self.offset.iter_mut().zip(corner_px) {
            *offset = (f64::from(*offset) - px) as f32;
        }
        self
    }

    #[inline(always)]
    fn map(&self, k: usize, x: f32, y: f32, z: f32) -> f32 {
        let [a, b, c] = self.linear[k];
        a * x + b * y + c * z + self.offset[k]
    }

    /// False if a box cannot put a point below the ceiling within `reach` px of a pixel's centre of the canvas, in these tiles
    /// if it is not all of them.
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
        // Rounding of the box's corners and of the vertices differs: a hair more than either can be off.
        let slack = |k: usize| 1e-5 * (low(k).abs() + high(k).abs()) + 1e-5 + if k < 2 { reach } else { 0.0 };
        let inside = high(0) + slack(0) >= canvas.centre(0)
            && low(0) - slack(0) <= canvas.centre(canvas.width)
            && high(1) + slack(1) >= canvas.centre(0)
            && low(1) - slack(1) <= canvas.centre(canvas.height)
            && low(2) - slack(2) < canvas.ceiling;
        let Some(tiles) = tiles.filter(|_| inside) else { return inside };
        let columns = centres(low(0) - slack(0), high(0) + slack(0), canvas.width, canvas.margin);
        let rows = centres(low(1) - slack(1), high(1) + slack(1), canvas.height, canvas.margin);
        columns.0 < columns.1 && rows.0 < rows.1 && tiles.any(columns, rows)
    }
}

/// Lowers `heights` (mm over the pad, the ceiling to begin with) to the object wherever that lies below.
pub fn raster(object: &Clusters, projection: &Projection, canvas: Canvas, heights: &mut Grid<f32>) {
    dispatch(Raster { object, projection, canvas, heights });
}

/// Names its vectors: left to the compiler, pixels are taken one by one.
struct Raster<'a> {
    object: &'a Clusters,
    projection: &'a Projection,
    canvas: Canvas,
    heights: &'a mut Grid<f32>,
}

impl WithSimd for Raster<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { object, projection, canvas, heights } = self;
        let mut seen = Seen::default();
        object.query(
            #[inline(always)]
            |min, max| projection.may_touch(canvas, 0.0, None, min, max),
            #[inline(always)]
            |part: Part<'_>| {
                seen.look(&part, projection, canvas);
                for corners in part.corners {
                    let [a, b, c] = corners.map(|at| at as usize % MAX_VERTICES);
                    if seen.covers_a_centre(a, b, c) && seen.z[a].min(seen.z[b]).min(seen.z[c]) < canvas.ceiling {
                        triangle(simd, [seen.corner(a), seen.corner(b), seen.corner(c)], canvas, heights);
                    }
                }
            },
        );
    }
}

/// The vertices of a part as the camera sees them.
struct Seen {
    /// Column, px.
    x: [f32; MAX_VERTICES],
    /// Row, px.
    y: [f32; MAX_VERTICES],
    /// Height over the pad, mm.
    z: [f32; MAX_VERTICES],
    /// Where the vertex lies among the pixel centres: column half, row half.
    key: [u32; MAX_VERTICES],
}

impl Default for Seen {
    fn default() -> Self {
        let zeros = [0.0; MAX_VERTICES];
        Self { x: zeros, y: zeros, z: zeros, key: [0; MAX_VERTICES] }
    }
}

impl Seen {
    #[inline(always)]
    fn look(&mut self, part: &Part<'_>, projection: &Projection, canvas: Canvas) {
        let count = part.x.len().min(MAX_VERTICES);
        let (px, py, pz) = (&part.x[..count], &part.y[..count], &part.z[..count]);
        let (x, y) = (&mut self.x[..count], &mut self.y[..count]);
        let (z, key) = (&mut self.z[..count], &mut self.key[..count]);
        for i in 0..count {
            x[i] = projection.map(0, px[i], py[i], pz[i]);
            y[i] = projection.map(1, px[i], py[i], pz[i]);
            z[i] = projection.map(2, px[i], py[i], pz[i]);
            key[i] = place(x[i], canvas.width, canvas.margin) << 16 | place(y[i], canvas.height, canvas.margin);
        }
    }

    /// False if all pixel centres lie outside the triangle's bounding box.
    #[inline(always)]
    fn covers_a_centre(&self, a: usize, b: usize, c: usize) -> bool {
        let differs = (self.key[a] ^ self.key[b]) | (self.key[a] ^ self.key[c]);
        (differs >> 16 != 0) & (differs & 0xffff != 0)
    }

    #[inline(always)]
    fn corner(&self, at: usize) -> [f32; 3] {
        [self.x[at], self.y[at], self.z[at]]
    }
}

/// Where a coordinate lies among the pixel centres: twice the number of centres below it, plus one if it is on a
/// centre itself. Coordinates with the same place have no centre between them. Exact: taking off the whole part of a
/// float leaves no rounding. With at most 8192 px and their margins it fits 16 bits.
#[inline(always)]
fn place(px: f32, size: usize, margin: usize) -> u32 {
    let margin = margin as i32;
    // NaN stays NaN and becomes 0 in the cast.
    let near = px.clamp((-margin - 1) as f32, (size as i32 - margin) as f32);
    let whole = near.floor();
    let rest = near - whole;
    (2 * (whole as i32 + margin + 1) + i32::from(rest > 0.5) + i32::from(rest >= 0.5)) as u32
}

/// First and one past the last of the image's columns (or rows) whose centre lies within `min..=max`, cut to `0..end`.
#[inline(always)]
fn centres(min: f32, max: f32, end: usize, margin: usize) -> (usize, usize) {
    let margin = margin as i32;
    let cut = |px: f32| px.clamp((-margin - 1) as f32, (end as i32 - margin) as f32);
    let (low, high) = (cut(min), cut(max));
    let first = low.floor() as i32 + margin + i32::from(low - low.floor() > 0.5);
    let last = high.floor() as i32 + margin + i32::from(high - high.floor() >= 0.5);
    (first.max(0) as usize, last.clamp(0, end as i32) as usize)
}

/// Rasterises one triangle: corners in px, px, mm.
#[inline(always)]
fn triangle<S: Simd>(simd: S, [a, b, c]: [[f32; 3]; 3], canvas: Canvas, heights: &mut Grid<f32>) {
    let (x0, x1) = centres(a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]), canvas.width, canvas.margin);
    let (y0, y1) = centres(a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]), canvas.height, canvas.margin);
    if x0 >= x1 || y0 >= y1 {
        return;
    }
    for y in y0..y1 {
        let py = canvas.centre(y);
        let (x0, x1) = match x1 - x0 {
            // Eight pixels at once take less time than a few one by one; those outside change nothing.
            3..=8 if x0 + 8 <= canvas.width => (x0, x0 + 8),
            0..=8 => (x0, x1),
            _ => span([a, b, c], py, 0.0, (x0, x1), canvas.margin),
        };
        let row = &mut heights.data[y * canvas.width..][..canvas.width][x0..x1];
        let mut x = canvas.centre(x0);
        let mut eights = row.chunks_exact_mut(8);
        for eight in &mut eights {
            let places = S::as_simd_f32s(&EIGHT).0;
            for (values, place) in S::as_mut_simd_f32s(eight).0.iter_mut().zip(places) {
                let point = [simd.add_f32s(simd.splat_f32s(x), *place), simd.splat_f32s(py)];
                *values = lowered(simd, *values, [a, b, c], point);
            }
            x += 8.0;
        }
        for value in eights.into_remainder() {
            *value = lowered(Scalar, *value, [a, b, c], [x, py]);
            x += 1.0;
        }
    }
}

/// Places of eight pixels after the first.
const EIGHT: [f32; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// Heights at points, lowered to a triangle where that covers them from below.
#[inline(always)]
fn lowered<S: Simd>(simd: S, heights: S::f32s, corners: [[f32; 3]; 3], point: [S::f32s; 2]) -> S::f32s {
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
    // A triangle seen edge-on gives 0 / 0: not below anything.
    let is_lower = simd.and_m32s(simd.or_m32s(left, right), simd.less_than_f32s(height, heights));
    simd.select_f32s(is_lower, height, heights)
}

/// Columns of a row at height `py` that a triangle can cover within `reach` of their centres, a little too many rather than
/// one too few.
#[inline(always)]
fn span([a, b, c]: [[f32; 3]; 3], py: f32, reach: f32, (x0, x1): (usize, usize), margin: usize) -> (usize, usize) {
    let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
    for (p, q) in [(a, b), (b, c), (c, a)] {
        let (low, high) = (p[1].min(q[1]), p[1].max(q[1]));
        if py + reach < low || py - reach > high {
            continue;
        }
        for y in [py - reach, py + reach] {
            let along = ((y - p[1]) / (q[1] - p[1])).clamp(0.0, 1.0);
            // NaN for a level edge: both of its ends count.
            let at = p[0] + along * (q[0] - p[0]);
            let (from, to) = if along.is_nan() { (p[0], q[0]) } else { (at, at) };
            min = min.min(from).min(to);
            max = max.max(from).max(to);
        }
    }
    let slack = 1.0 + 1e-5 * (min.abs() + max.abs());
    let (first, end) = centres(min - slack, max + slack, x1, margin);
    let first = first.max(x0);
    (first, end.max(first))
}
