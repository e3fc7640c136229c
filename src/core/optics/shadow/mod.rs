//! Shadows that low LEDs cast on the pad's surface: the fraction of an LED that each pixel sees.
//!
//! With w the displacement and d the distance towards the LED, the horizon's slope is the largest (w(d) - w(0)) / d.
//! The LED spans a range of elevations. The fraction of it that is seen falls linearly from 1 to 0 as the horizon
//! climbs from its lowest ray to its highest. A sweep away from the LED carries, on lines one pixel apart, the
//! obstacles that block these two rays, and how far off they stand (horizon sweeps: Max 1988; Timonen and Westerholm
//! 2010). The horizon is the steeper of the two. This is exact at both ends of a penumbra and behind a single obstacle;
//! where penumbras overlap, the fraction can be too large, and jump. Heights between pixels are linear.
//!
//! An LED has a width, too. So fractions are averaged across the lines, as widely as the LED appears past the highest
//! obstacle of all its azimuths (a penumbra estimated from the blocker's distance: Fernando 2005). This is exact behind
//! a single straight edge.

pub mod casting;
mod soften;
mod steepest;
mod sweep;
mod transpose;

use crate::base::angle::sin_cos_deg;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;

pub use steepest::SteepestSlopes;
use sweep::Rays;
use transpose::transpose;

/// Elevation of the lowest ray, degrees: parts of an LED below it are moved up to it, so that no shadow is endless.
const LOWEST_DEG: f64 = 0.5;
/// Elevation of the highest ray, degrees: a steeper one casts no shadow that is seen.
const HIGHEST_DEG: f64 = 89.9;
/// Smallest angular size of an LED, degrees: without any penumbra, shares would jump.
const SMALLEST_DEG: f64 = 0.1;
/// Widest fan, pixels to either side in a step; wider ones are narrowed to it.
const WIDEST_FAN: f64 = 1.0;

/// Whether the way to an LED leads over more rows or over more columns, counted in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SweepDirection {
    /// From one row to the next.
    OverRows,
    /// From one column to the next.
    OverColumns,
}

/// The shadows of one LED.
#[derive(Clone, Debug)]
pub struct ShadowCaster {
    sweep: SweepDirection,
    rays: Rays,
    mm_per_px: [f64; 2],
}

/// Scratch memory for shadows, used again by the next ones.
#[derive(Clone, Debug, Default)]
pub struct ShadowScratch {
    sweep: sweep::SweepScratch,
    /// The surface turned over its diagonal.
    transposed: Vec<f32>,
    /// Shares that were found on it.
    shares: Vec<f32>,
}

/// Returns the larger number; the second one if one is NaN. A single instruction, unlike `f32::max`.
#[inline(always)]
fn max_f32(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Computes the share of each LED, 0 to 1, that each pixel of `region` sees, row-major; empty for an LED that casts no
/// shadow.
///
/// `region` is a rectangle of the view. `surface` holds displacements in mm of the view and [`SURFACE_BORDER`] around
/// it. All of it casts shadows, and nothing outside it does.
pub fn compute_visible_shares(
    casters: &[Option<ShadowCaster>],
    surface: &Grid<f32>,
    region: Rect,
    scratch: &mut ShadowScratch,
) -> Vec<Vec<f32>> {
    let ShadowScratch { sweep, transposed, shares } = scratch;
    if casters.iter().flatten().any(|caster| caster.sweep == SweepDirection::OverColumns) {
        transposed.resize(surface.data.len(), 0.0);
        transpose(&surface.data, surface.width, transposed);
    }
    let seen = |caster: &Option<ShadowCaster>| {
        let mut visible = Vec::new();
        if let Some(caster) = caster.as_ref().filter(|_| !region.is_empty()) {
            visible.resize(region.area(), 1.0);
            caster.fill_visible_shares(surface, transposed, region, &mut visible, shares, sweep);
        }
        visible
    };
    casters.iter().map(seen).collect()
}

impl ShadowCaster {
    /// Prepares the shadows of an LED towards `azimuth_deg` (from +x towards +y), `elevation_deg` over the pad, seen
    /// from it under angles of `angular_size_deg`: width along the pad, height over it. Parts of it below 0.5 or above
    /// 89.9 degrees are moved there; an LED smaller than 0.1 degrees is taken to be that large.
    pub fn new(azimuth_deg: f64, elevation_deg: f64, angular_size_deg: [f64; 2], mm_per_px: [f64; 2]) -> Self {
        let (sin, cos) = sin_cos_deg(azimuth_deg);
        let [half_width_deg, half_deg] = angular_size_deg.map(|size| 0.5 * size.max(SMALLEST_DEG));
        let lowest_deg = (elevation_deg - half_deg).clamp(LOWEST_DEG, HIGHEST_DEG - SMALLEST_DEG);
        let highest_deg = (elevation_deg + half_deg).max(lowest_deg + SMALLEST_DEG).min(HIGHEST_DEG);
        let slopes = [lowest_deg, highest_deg].map(|elevation| libm::tan(elevation.to_radians()));

        // Pixels towards the LED for every mm of the way.
        let [right, down] = [cos / mm_per_px[0], sin / mm_per_px[1]];
        let (sweep, ahead, sideways) = if down.abs() >= right.abs() {
            (SweepDirection::OverRows, down, right)
        } else {
            (SweepDirection::OverColumns, right, down)
        };
        // A row is crossed at an angle: a ray that turns by a little moves on it by that much over the sine squared.
        let [line_mm, step_mm] = match sweep {
            SweepDirection::OverRows => mm_per_px,
            SweepDirection::OverColumns => [mm_per_px[1], mm_per_px[0]],
        };
        let sine = ahead * step_mm;
        let widening = libm::tan(half_width_deg.min(45.0).to_radians()) / (sine * sine) * step_mm / line_mm;
        let rays = Rays {
            from_end: ahead > 0.0,
            shear: -sideways / ahead.abs(),
            rise_mm: slopes.map(|slope| (slope / ahead.abs()) as f32),
            widening: widening.min(WIDEST_FAN),
        };
        Self { sweep, rays, mm_per_px }
    }

    /// Returns false only where [`compute_visible_shares`] gives 1 everywhere: no slope towards the LED is as steep as
    /// its lowest ray.
    pub fn casts_shadow(&self, steepest: &SteepestSlopes) -> bool {
        let SteepestSlopes { right, left, down, up, largest_mm, longest_px, .. } = *steepest;
        let (x, y) = ([left, right], [up, down]);
        let (ahead, sideways, pixel_mm) = match self.sweep {
            SweepDirection::OverRows => (y, x, self.mm_per_px),
            SweepDirection::OverColumns => (x, y, [self.mm_per_px[1], self.mm_per_px[0]]),
        };
        let [backward, forward] = sideways.map(|rise| f64::from(rise) * pixel_mm[0]);
        let towards_led = f64::from(ahead[usize::from(self.rays.from_end)]) * pixel_mm[1];
        // Lines shift away from the LED, so towards it they lead the other way.
        let aside = self.rays.shear.abs() * if self.rays.shear < 0.0 { forward } else { backward };
        let lowest = f64::from(self.rays.rise_mm[0]);
        // Heights are rounded to 32 bits: no shadow may be missed because of that.
        let rounding = 1e-6 * (f64::from(largest_mm) + lowest * longest_px as f64);
        towards_led + aside + rounding > lowest
    }

    /// Returns where a shadow can fall, px from what casts it, from where to where along x and along y. The surface's
    /// highest point is `highest_mm` over its lowest. Interpolation can carry a trace of the shadow one pixel further.
    pub fn shadow_extent_px(&self, highest_mm: f32) -> [[f64; 2]; 2] {
        let steps = f64::from(highest_mm.max(0.0)) / f64::from(self.rays.rise_mm[0]);
        let (end, aside) = (if self.rays.from_end { -steps } else { steps }, self.rays.fan_width() * steps);
        let ahead = [end.min(0.0), end.max(0.0)];
        let middle = self.rays.shear * steps;
        let sideways = [(middle - aside).min(0.0), (middle + aside).max(0.0)];
        match self.sweep {
            SweepDirection::OverRows => [sideways, ahead],
            SweepDirection::OverColumns => [ahead, sideways],
        }
    }

    /// Computes the share of the LED that each pixel of `region` sees.
    fn fill_visible_shares(
        &self,
        surface: &Grid<f32>,
        transposed: &[f32],
        region: Rect,
        visible: &mut [f32],
        shares: &mut Vec<f32>,
        scratch: &mut sweep::SweepScratch,
    ) {
        let columns = region.x0 + SURFACE_BORDER..region.x1 + SURFACE_BORDER;
        let rows = region.y0 + SURFACE_BORDER..region.y1 + SURFACE_BORDER;
        let [width, height] = [surface.width, surface.height];
        let mut sweep = |image, lines, steps, seen: &mut [f32]| {
            simd_dispatch(
                #[inline(always)]
                || sweep::sweep_shadows(self.rays, image, lines, steps, scratch, seen),
            );
        };
        match self.sweep {
            SweepDirection::OverRows => sweep((&surface.data, [width, height]), columns, rows, visible),
            SweepDirection::OverColumns => {
                shares.resize(visible.len(), 1.0);
                let wide = rows.len();
                sweep((transposed, [height, width]), rows, columns, shares);
                transpose(shares, wide, visible);
            }
        }
    }
}
