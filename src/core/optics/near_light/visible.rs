//! Which share of each point of the LEDs the places of the pad see.
//!
//! A point is compared with the horizon in its direction, which is linear between two azimuths. The share rises smoothly
//! from 0 to 1 over the slopes that the LED spans. Sixteen places of a row are compared at once.

use super::horizons::{BLOCK, Horizons, turns_from_x};
use super::points::LightPoint;
use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;

/// Places that are compared at once.
type Lanes = [f32; BLOCK];

/// What the surface hides.
#[derive(Default)]
pub(crate) struct Hidden {
    /// The part of the grid that the lists are for.
    pub part: Rect,
    /// What is seen of each point; nothing is listed without shadows.
    pub visible: VisibleShares,
    /// The share of the sky that is hidden; empty without a bounce.
    pub sky: Vec<f32>,
}

/// The share of each point that the places of a part see.
#[derive(Default)]
pub(crate) struct VisibleShares {
    /// For each point the shares, row-major; empty where all of it is seen.
    pub points: Vec<Vec<f32>>,
    /// The rectangle of all places that do not see some point entirely.
    extent: Rect,
}

impl Hidden {
    /// Returns the index of a place of the grid in the lists.
    pub fn index(&self, [x, y]: [usize; 2]) -> usize {
        (y - self.part.y0) * self.part.width() + x - self.part.x0
    }

    /// Returns the rectangle of the part in which anything is hidden.
    pub fn extent(&self) -> Rect {
        let mut extent = self.visible.extent;
        for (y, row) in self.sky.chunks_exact(self.part.width().max(1)).enumerate() {
            let first = row.iter().position(|share| *share != 0.0);
            let last = row.iter().rposition(|share| *share != 0.0);
            if let (Some(first), Some(last)) = (first, last) {
                extent = extent.union(Rect { x0: first, y0: y, x1: last + 1, y1: y + 1 });
            }
        }
        extent
    }
}

/// Some places of a row of the grid.
pub(super) struct Segment {
    y: usize,
    first: usize,
    count: usize,
    /// Where they are, mm from the middle of the view. Lanes beyond the last place repeat it.
    columns_mm: Lanes,
    y_mm: f32,
    heights_mm: Lanes,
    /// The steepest of each place's horizons; nothing is hidden beyond the last place.
    highest: Lanes,
    /// The steepest and the highest of all, mm.
    steepest: f32,
    highest_mm: f32,
}

/// Returns the segments of the horizons' rows in which anything stands up around some place. `row` gives the heights
/// along a row, and where it is.
pub(super) fn segments_that_rise<'a>(
    horizons: &Horizons,
    columns_mm: &[f32],
    row: impl Fn(usize) -> (&'a [f32], f32),
) -> Vec<Segment> {
    let (width, mut segments) = (horizons.part.width(), Vec::new());
    for y in 0..horizons.part.height() {
        let (highest, (heights_mm, y_mm)) = (horizons.highest_row(y), row(y));
        for first in (0..width).step_by(BLOCK) {
            let count = BLOCK.min(width - first);
            let largest = |values: &[f32]| values[first..][..count].iter().copied().fold(f32::MIN, f32::max);
            let steepest = largest(highest);
            if steepest > horizons.flattest {
                let place = |lane: usize| first + lane.min(count - 1);
                segments.push(Segment {
                    y,
                    first,
                    count,
                    columns_mm: std::array::from_fn(|lane| columns_mm[place(lane)]),
                    y_mm,
                    heights_mm: std::array::from_fn(|lane| heights_mm[place(lane)]),
                    highest: std::array::from_fn(|lane| if lane < count { highest[place(lane)] } else { f32::MIN }),
                    steepest,
                    highest_mm: largest(heights_mm),
                });
            }
        }
    }
    segments
}

/// Finds which share of each point the places of the horizons' part see; all shadows are softened by `blur` to either
/// side.
pub(super) fn find_visible_shares(
    points: &[&LightPoint],
    segments: &[Segment],
    horizons: &Horizons,
    blur: f32,
) -> VisibleShares {
    let (width, area) = (horizons.part.width(), horizons.part.area());
    let mut found = VisibleShares { points: vec![Vec::new(); points.len()], extent: Rect::default() };
    simd_dispatch(
        #[inline(always)]
        || {
            for (point, shares) in points.iter().zip(&mut found.points) {
                for segment in segments.iter().filter(|segment| segment.may_hide(point, blur)) {
                    let Some(seen) = segment.visible_shares(point, horizons, blur) else { continue };
                    let Segment { y, first, count, .. } = *segment;
                    for (lane, share) in seen.iter().enumerate().take(count) {
                        if *share < 1.0 {
                            let place = Rect { x0: first + lane, y0: y, x1: first + lane + 1, y1: y + 1 };
                            found.extent = found.extent.union(place);
                        }
                    }
                    if shares.is_empty() {
                        shares.resize(area, 1.0);
                    }
                    shares[y * width + first..][..count].copy_from_slice(&seen[..count]);
                }
            }
        },
    );
    found
}

impl Segment {
    /// Returns false if the whole point stands above all horizons, wherever it is seen from.
    #[inline(always)]
    fn may_hide(&self, point: &LightPoint, blur: f32) -> bool {
        let [at_x, at_y, at_z] = point.at_mm;
        let across_mm = (at_x - self.columns_mm[0]).abs().max((at_x - self.columns_mm[BLOCK - 1]).abs());
        let dy = at_y - self.y_mm;
        let across_mm = (across_mm * across_mm + dy * dy).sqrt();
        let lowest_mm = -at_z - self.highest_mm - point.half_height_mm;
        lowest_mm < (self.steepest + blur) * across_mm * 1.000_01
    }

    /// Computes the share of a point that each place sees; `None` if all see all of it.
    #[inline(always)]
    fn visible_shares(&self, point: &LightPoint, horizons: &Horizons, blur: f32) -> Option<Lanes> {
        let lanes = || [0.0; BLOCK];
        let (mut to_x, mut to_y, mut across, mut half, mut up) = (lanes(), lanes(), lanes(), lanes(), lanes());
        let mut hides = [0; BLOCK];
        for k in 0..BLOCK {
            let ([x, y, z], inverse) = point.seen_from([self.columns_mm[k], self.y_mm], self.heights_mm[k]);
            (to_x[k], to_y[k]) = (x, y);
            across[k] = (x * x + y * y).sqrt();
            // The slope of a point is that of the middle of an LED; it spans as much as it is high. What stands lower
            // than any horizon counts as standing just above it, so that a flat pad sees it.
            half[k] = blur * across[k] + point.half_height_mm * inverse;
            up[k] = (-z).max(horizons.flattest * across[k] + half[k]);
            hides[k] = u32::from(up[k] < self.highest[k] * across[k] + half[k]);
        }
        if hides == [0; BLOCK] {
            return None;
        }
        let horizon = self.slopes_towards(horizons, &to_x, &to_y);
        let mut seen = [1.0; BLOCK];
        for k in 0..BLOCK {
            let t = (0.5 + 0.5 * (up[k] - horizon[k] * across[k]) / half[k]).clamp(0.0, 1.0);
            let is_clear = up[k] >= self.highest[k] * across[k] + half[k];
            seen[k] = if is_clear { 1.0 } else { t * t * (3.0 - 2.0 * t) };
        }
        Some(seen)
    }

    /// Computes the slope of the horizon at each place in its own direction.
    #[inline(always)]
    fn slopes_towards(&self, horizons: &Horizons, to_x: &Lanes, to_y: &Lanes) -> Lanes {
        let count = horizons.azimuths();
        let mut turns = [0.0; BLOCK];
        for k in 0..BLOCK {
            turns[k] = turns_from_x(to_x[k], to_y[k]) * count as f32;
        }
        let (least, most) = (fold_lanes(turns, f32::min), fold_lanes(turns, f32::max));
        // Each place takes two azimuths; all places together take a few that follow each other, or any.
        let azimuths = match most - least > 0.5 * count as f32 {
            true => 0..count,
            false => least as usize..most as usize + 2,
        };
        let mut slopes = [0.0; BLOCK];
        for azimuth in azimuths {
            let plane = horizons.block_row(azimuth % count, self.first, self.y);
            for k in 0..BLOCK {
                let apart = (turns[k] - azimuth as f32).abs();
                let apart = apart.min(count as f32 - apart);
                slopes[k] += plane[k] * (1.0 - apart).max(0.0);
            }
        }
        slopes
    }
}

/// Combines all lanes, half of them with the other half, so that the compiler keeps them in vectors.
#[inline(always)]
fn fold_lanes(mut lanes: Lanes, of: impl Fn(f32, f32) -> f32) -> f32 {
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            lanes[k] = of(lanes[k], lanes[k + half]);
        }
    }
    lanes[0]
}
