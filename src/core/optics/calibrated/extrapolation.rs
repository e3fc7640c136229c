//! Light outside the range of the presses that a response was fitted to.
//!
//! A polynomial and a network say nothing of slopes and depths that they have not seen. Outside the range, the picture
//! changes as LEDs would change it that were fitted to the same presses: by their light at the normal less that at the
//! steepest normal of the same direction, scaled by the background as `stray_light` says ([`super::super::phong`]). It
//! also changes in proportion to the displacement, which saturates: it never adds more than the whole depth of the
//! range would. Both changes are 0 at the edge of the range, so the light is continuous; within the range nothing is
//! added.

use serde::{Deserialize, Serialize};

use super::response::{CalibrationResponse, SECTORS, SKY_DEG};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::view::{SURFACE_BORDER, View};
use crate::gelpad::Contact;
use crate::optics::background::BackgroundImage;
use crate::optics::coarse::CoarseValues;
use crate::optics::led::{Led, Normals, PlacedLed};
use crate::optics::phong::Phong;

/// Largest number of LEDs that a table may have.
const MAX_LEDS: usize = 64;

/// How the light goes on outside the range of the presses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationExtrapolation {
    /// LEDs at infinity that explain the presses best.
    pub leds: Vec<Led>,
    /// Light of the background that is not the LEDs', 0 to 1 in each channel.
    pub stray_light: [f64; 3],
    /// Change of each channel with the displacement, as a fraction of the background per mm.
    pub per_mm: [f64; 3],
}

impl CalibrationExtrapolation {
    /// Checks numbers that came from a file; an error says what is wrong with them.
    pub fn validate(&self) -> Result<(), String> {
        let sound = |led: &Led| {
            let within = (0.0..=90.0).contains(&led.elevation_deg) && (0.0..=1e6).contains(&led.intensity);
            within
                && led.pattern.is_none()
                && led.azimuth_deg.abs() <= 1e6
                && led.color.iter().all(|share| (0.0..=1.0).contains(share))
        };
        let shares = self.stray_light.iter().all(|share| (0.0..=1.0).contains(share));
        let slopes = self.per_mm.iter().all(|slope| slope.abs() <= 1e3);
        if self.leds.len() > MAX_LEDS || !self.leds.iter().all(sound) || !shares || !slopes {
            return Err(format!(
                "`beyond` has at most {MAX_LEDS} LEDs, without a pattern, with elevations of 0 to 90 degrees and colours of \
                 0 to 1, stray light of 0 to 1, and changes with the displacement within 1000 per mm"
            ));
        }
        Ok(())
    }
}

/// The range of the presses that a response was fitted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationRange {
    /// Largest length of (n_x, n_y).
    pub steepest: f32,
    /// Lowest and highest displacement, mm.
    pub heights_mm: [f32; 2],
}

impl From<&CalibrationResponse> for CalibrationRange {
    fn from(response: &CalibrationResponse) -> Self {
        Self { steepest: response.steepest, heights_mm: response.heights_mm }
    }
}

/// Saturates an excess past the edge of a range: a small one counts fully, a large one by less than `most`.
#[inline(always)]
fn saturate_excess(past: f32, most: f32) -> f32 {
    past * most / (most + past.abs())
}

impl CalibrationRange {
    /// Returns the square of the steepest slope, mm/mm.
    fn slope_squared(&self) -> f32 {
        let square = self.steepest * self.steepest;
        if square < 1.0 { square / (1.0 - square) } else { f32::INFINITY }
    }

    /// Returns true if the surface is surely within the range in a part of the view.
    pub(crate) fn contains_surface(&self, contact: &Contact, part: Rect, view: &View) -> bool {
        let [low, high] = contact.range_mm();
        if low < self.heights_mm[0] || high > self.heights_mm[1] {
            return false;
        }
        // Below the limit by more than rounding: a pixel may be taken for one outside the range, but never the other
        // way.
        let limit = self.slope_squared() * (1.0 - 1e-4);
        let mut outside = 0_u32;
        simd_dispatch(
            #[inline(always)]
            || {
                for y in part.y0..part.y1 {
                    let row = SurfaceRow::new(&contact.surface, part, y, view);
                    for x in 0..part.width() {
                        outside |= u32::from(row.slope_squared(x) > limit);
                    }
                }
            },
        );
        outside == 0
    }

    /// Returns the fraction of the pixels in contact that are outside the range; 0 without contact.
    pub(crate) fn outside_fraction(&self, contact: &Contact, view: &View) -> f64 {
        let [width, height] = view.resolution_px;
        let part = contact.region.in_window(SURFACE_BORDER, SURFACE_BORDER, width, height);
        let (limit, [low, high]) = (self.slope_squared(), self.heights_mm);
        let (mut outside, mut touching) = (0_u64, 0_u64);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in part.y0..part.y1 {
                    let row = SurfaceRow::new(&contact.surface, part, y, view);
                    let mask = &contact.mask.row(y)[part.x0..part.x1];
                    // A row's sums fit 32 bits, of which a vector holds eight.
                    let (mut outside_here, mut touching_here) = (0_u32, 0_u32);
                    for (x, mask) in mask.iter().enumerate() {
                        let w = row.here[x];
                        let touches = u32::from(*mask > 0);
                        let is_outside = (row.slope_squared(x) > limit) | (w < low) | (w > high);
                        touching_here += touches;
                        outside_here += touches & u32::from(is_outside);
                    }
                    touching += u64::from(touching_here);
                    outside += u64::from(outside_here);
                }
            },
        );
        if touching == 0 { 0.0 } else { outside as f64 / touching as f64 }
    }
}

/// A part of a row of the surface, and the neighbours that its slopes are taken from.
struct SurfaceRow<'a> {
    here: &'a [f32],
    left: &'a [f32],
    right: &'a [f32],
    above: &'a [f32],
    below: &'a [f32],
    per_slope: [f32; 2],
}

impl<'a> SurfaceRow<'a> {
    #[inline(always)]
    fn new(surface: &'a Grid<f32>, part: Rect, y: usize, view: &View) -> Self {
        let window = |dx: usize, dy: usize| &surface.row(y + dy)[part.x0 + dx..][..part.width()];
        let per_slope = view.mm_per_px.map(|pixel_mm| (0.5 / pixel_mm) as f32);
        let (here, left, right, above, below) = (window(1, 1), window(0, 1), window(2, 1), window(1, 0), window(1, 2));
        Self { here, left, right, above, below, per_slope }
    }

    #[inline(always)]
    fn slope_squared(&self, x: usize) -> f32 {
        let across = (self.left[x] - self.right[x]) * self.per_slope[0];
        let down = (self.above[x] - self.below[x]) * self.per_slope[1];
        across * across + down * down
    }
}

/// Pixels of a row that are checked together: is any outside the range?
const RUN_PX: usize = 64;

/// Range of elevations over which an LED sinks behind the horizon, degrees.
const HORIZON_WIDTH_DEG: f64 = 10.0;

/// A [`CalibrationExtrapolation`] in the shader's numbers.
pub struct PreparedExtrapolation {
    range: CalibrationRange,
    leds: Vec<SectorLed>,
    stray_light: [f32; 3],
    per_mm: [f32; 3],
}

/// An LED, and the sector of the sky in which it stands.
struct SectorLed {
    placed: PlacedLed,
    sector: usize,
    elevation_deg: f64,
}

impl SectorLed {
    fn new(led: &Led) -> Self {
        let turn = (led.azimuth_deg / 360.0).rem_euclid(1.0);
        let sector = (turn * SECTORS as f64).round() as usize % SECTORS;
        Self { placed: PlacedLed::new(led), sector, elevation_deg: led.elevation_deg }
    }

    /// Returns the fraction of it that is seen where this share of its sector is seen: the horizon hides the rest of
    /// the sector, from its lowest elevation up.
    #[inline(always)]
    fn visible_share(&self, share: f32) -> f32 {
        let [low, high] = SKY_DEG;
        let horizon_deg = high - (high - low) * f64::from(share);
        (0.5 + (self.elevation_deg - horizon_deg) / HORIZON_WIDTH_DEG).clamp(0.0, 1.0) as f32
    }
}

/// Scratch memory for the pixels of a row.
#[derive(Default)]
pub struct ExtrapolationScratch {
    /// The share of the sky that is seen around each LED along a row; empty where all of it is.
    sky: Vec<Vec<f32>>,
    line: Vec<f32>,
    /// Normals of a run; their excess over the range is saturated.
    here: Normals,
    /// The same normals, clamped to the range.
    edge: Normals,
    gain: Vec<f32>,
    edge_gain: Vec<f32>,
    added: [Vec<f32>; 3],
}

impl PreparedExtrapolation {
    /// Prepares what a table says about light outside its response's range.
    pub(crate) fn new(extrapolation: &CalibrationExtrapolation, range: CalibrationRange) -> Self {
        Self {
            range,
            leds: extrapolation.leds.iter().map(SectorLed::new).collect(),
            stray_light: extrapolation.stray_light.map(|share| share as f32),
            per_mm: extrapolation.per_mm.map(|share| share as f32),
        }
    }

    /// Adds what changes outside the range to row `row` of the light's region: exactly 0 where a pixel is within it.
    /// `normals` are those of the row, `shares` the fractions of each sector of the sky that are seen.
    #[expect(clippy::too_many_arguments, reason = "what the response's own row has, and memory")]
    pub(crate) fn add_row(
        &self,
        light: &mut Light,
        row: usize,
        normals: &Normals,
        surface: &Grid<f32>,
        rest: &BackgroundImage,
        shares: &[Option<CoarseValues>],
        memory: &mut ExtrapolationScratch,
    ) {
        let (region, width) = (light.region, light.region.width());
        let y = region.y0 + row;
        let heights = &surface.row(y + SURFACE_BORDER)[region.x0 + SURFACE_BORDER..][..width];
        let [low, high] = self.range.heights_mm;
        let depth_mm = (high - low).max(f32::MIN_POSITIVE);
        // Below the limit by more than rounding, so that no pixel outside the range is missed.
        let limit = self.range.steepest * self.range.steepest * (1.0 - 1e-5);
        memory.sky.clear();
        for x0 in (0..width).step_by(RUN_PX) {
            let run = x0..(x0 + RUN_PX).min(width);
            let (nx, ny, heights) = (&normals.x[run.clone()], &normals.y[run.clone()], &heights[run.clone()]);
            let is_steep = nx.iter().zip(ny).any(|(x, y)| x * x + y * y > limit);
            let is_deep = heights.iter().any(|w| (*w < low) | (*w > high));
            if !is_steep && !is_deep {
                continue;
            }
            for added in &mut memory.added {
                added.clear();
                added.resize(run.len(), 0.0);
            }
            if is_steep {
                if memory.sky.is_empty() {
                    self.look_up_sky(y, region.x0, width, shares, memory);
                }
                self.compute_led_excess([nx, ny, &normals.z[run.clone()]], run.clone(), memory);
            }
            for (channel, plane) in light.planes.iter_mut().enumerate() {
                let plane = &mut plane[row * width..][run.clone()];
                let rest = &rest.planes[channel][y * rest.width + region.x0..][run.clone()];
                let (stray_light, per_mm) = (self.stray_light[channel], self.per_mm[channel]);
                for (k, value) in plane.iter_mut().enumerate() {
                    let rest = f32::from(rest[k]) * (1.0 / 255.0);
                    let past_mm = heights[k] - heights[k].clamp(low, high);
                    let counted_mm = saturate_excess(past_mm, depth_mm);
                    *value += memory.added[channel][k] * (rest - stray_light).max(0.0) + rest * per_mm * counted_mm;
                }
            }
        }
    }

    /// Finds how much of the sky is seen around each LED along row `y` of the view.
    fn look_up_sky(
        &self,
        y: usize,
        x0: usize,
        width: usize,
        shares: &[Option<CoarseValues>],
        memory: &mut ExtrapolationScratch,
    ) {
        let ExtrapolationScratch { sky, line, .. } = memory;
        for led in &self.leds {
            let mut row = Vec::new();
            if let Some(Some(values)) = shares.get(led.sector) {
                row.resize(width, 1.0);
                values.interpolate_row(y, x0, line, &mut row);
            }
            sky.push(row);
        }
    }

    /// Computes what the LEDs give at a run of normals less what they give at the steepest ones of the range, in each
    /// channel.
    fn compute_led_excess(
        &self,
        [nx, ny, nz]: [&[f32]; 3],
        run: std::ops::Range<usize>,
        memory: &mut ExtrapolationScratch,
    ) {
        let steepest = self.range.steepest;
        let ExtrapolationScratch { here, edge, gain, edge_gain, added, sky, .. } = memory;
        for (normals, plane) in [(&mut here.x, nx), (&mut here.y, ny), (&mut here.z, nz)] {
            normals.clear();
            normals.extend_from_slice(plane);
        }
        edge.clone_from(here);
        let edge_z = -(1.0 - steepest * steepest).max(0.0).sqrt();
        for k in 0..run.len() {
            let (x, y) = (nx[k], ny[k]);
            // The response clamps normals in the same way, so the two fit together.
            let length = (x * x + y * y).sqrt();
            if length > steepest {
                let kept = steepest / length;
                (edge.x[k], edge.y[k], edge.z[k]) = (x * kept, y * kept, edge_z);
                let counted = steepest + saturate_excess(length - steepest, steepest);
                let kept = counted / length;
                (here.x[k], here.y[k]) = (x * kept, y * kept);
                here.z[k] = -(1.0 - counted * counted).max(0.0).sqrt();
            }
        }
        gain.resize(run.len(), 0.0);
        edge_gain.resize(run.len(), 0.0);
        for (led, sky) in self.leds.iter().zip(&*sky) {
            led.placed.reflect(&Phong::default(), here, gain);
            led.placed.reflect(&Phong::default(), edge, edge_gain);
            for (gain, edge) in gain.iter_mut().zip(&*edge_gain) {
                *gain -= edge;
            }
            if !sky.is_empty() {
                for (gain, share) in gain.iter_mut().zip(&sky[run.clone()]) {
                    *gain *= led.visible_share(*share);
                }
            }
            for (added, color) in added.iter_mut().zip(led.placed.color.even) {
                for (added, gain) in added.iter_mut().zip(&*gain) {
                    *added += gain * color;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{EffectLog, EffectPolicy};
    use crate::gelpad::{Numerics, no_contact};
    use crate::optics::calibrated::response::{INPUTS, OUTPUTS, TERMS};
    use crate::optics::calibrated::{Calibrated, CalibratedShader, CalibrationColors, CalibrationTable};

    const VIEW: View = View { resolution_px: [100, 30], mm_per_px: [0.1; 2] };

    /// A pad that all touches, whose displacement at a place, mm, is given.
    fn pressed(height_mm: impl Fn(f64, f64) -> f64) -> Contact {
        let [width, height] = VIEW.resolution_px;
        let mut contact = no_contact(width, height, None, Numerics::DIRECT);
        contact.region = Rect::whole(contact.surface.width, contact.surface.height);
        contact.mask.data.fill(255);
        let columns = contact.surface.width;
        let place = |k: usize| [k % columns, k / columns].map(|at| at as f64 - SURFACE_BORDER as f64 + 0.5);
        contact.surface.data.iter_mut().enumerate().for_each(|(k, w)| {
            let [x_mm, y_mm] = VIEW.point_mm(place(k));
            *w = height_mm(x_mm, y_mm) as f32;
        });
        contact
    }

    fn shader(beyond: bool) -> CalibratedShader {
        let mut outputs = vec![vec![0.0; INPUTS + 1]; OUTPUTS];
        (0..3).for_each(|channel| outputs[channel * TERMS + 2][INPUTS] = 0.3);
        let response =
            CalibrationResponse { steepest: 0.5, heights_mm: [-0.1, 0.5], outputs, ..CalibrationResponse::default() };
        let table = CalibrationTable::new(CalibrationColors::Response(response), 1.0);
        let led = Led { elevation_deg: 60.0, intensity: 2.0, ..Led::default() };
        let more = CalibrationExtrapolation { leds: vec![led], stray_light: [0.0, 0.1, 0.9], per_mm: [0.0, 0.2, -0.2] };
        CalibratedShader::new(
            Calibrated::default(),
            Some(&if beyond { table.with_extrapolation(more) } else { table }),
            &VIEW,
        )
    }

    fn light(shader: &CalibratedShader, contact: &Contact, policy: EffectPolicy) -> Light {
        let [width, height] = VIEW.resolution_px;
        let rest = BackgroundImage::new(width, height, vec![128; 3 * width * height]);
        shader.shade(contact, &rest, &mut EffectLog::new(policy))
    }

    #[test]
    fn within_the_range_nothing_changes_and_beyond_it_light_goes_on_without_a_step() {
        // From level to a slope of 1.2 at the right side: the range ends at one of 0.577.
        let steepening = |scale: f64| pressed(move |x, _| scale * 0.06 * (x + 5.0) * (x + 5.0) - 0.05);
        let [with, without] = [true, false].map(shader);
        let gentle = steepening(0.0866);
        assert!(with.range.is_some_and(|range| range.contains_surface(&gentle, Rect::whole(100, 30), &VIEW)));
        let of = |shader: &CalibratedShader, contact: &Contact| light(shader, contact, EffectPolicy::WhereNeeded);
        assert_eq!(of(&with, &gentle).planes, of(&without, &gentle).planes);
        // Work that the policy skips would add exactly nothing.
        let everywhere = |shader: &CalibratedShader| light(shader, &gentle, EffectPolicy::All);
        assert_eq!(everywhere(&with).planes, everywhere(&without).planes);

        let steep = steepening(1.0);
        let (on, clamped) = (of(&with, &steep), of(&without, &steep));
        let row = |light: &Light, channel: usize| {
            let Rect { x0, y0, x1, y1 } = light.region;
            assert_eq!((y0, x1, y1), (0, 100, 30));
            let mut row = vec![0.0; 100];
            row[x0..].copy_from_slice(&light.planes[channel][15 * (x1 - x0)..][..x1 - x0]);
            row
        };
        for channel in 0..2 {
            let added: Vec<f32> = row(&on, channel).iter().zip(row(&clamped, channel)).map(|(a, b)| a - b).collect();
            // The slope is 0.012 a column, the displacement 0.5 mm from the middle of the view on, nearly.
            let first = added.iter().position(|added| *added != 0.0).expect("some are beyond");
            assert!((28..=50).contains(&first), "{channel}: {first}");
            let steps = added.windows(2).map(|pair| (pair[1] - pair[0]).abs());
            assert!(steps.fold(0.0, f32::max) < 0.03, "{channel}: {added:?}");
            assert!(added[99].abs() > 0.02, "{channel}: {added:?}");
        }
        // All of this channel is stray light: it follows the displacement alone.
        let (blue, before) = (row(&on, 2), row(&clamped, 2));
        let past_mm = steep.surface.row(15 + SURFACE_BORDER)[99 + SURFACE_BORDER] - 0.5;
        let counted_mm = past_mm * 0.6 / (0.6 + past_mm);
        assert!((blue[99] - before[99] + 0.2 * counted_mm * 128.0 / 255.0).abs() < 1e-5);
    }

    #[test]
    fn the_share_beyond_counts_what_touches_there() {
        let shader = shader(false);
        assert_eq!(shader.extrapolated_fraction(&pressed(|_, _| 0.4)), 0.0);
        assert_eq!(shader.extrapolated_fraction(&pressed(|_, _| 0.6)), 1.0);
        // A quarter of the view is deeper, and a third of what touches.
        let mut deep = pressed(|x, _| if x > 2.5 { 0.6 } else { 0.5 - 0.04 * (2.5 - x) });
        assert!((shader.extrapolated_fraction(&deep) - 0.25).abs() < 1e-9);
        let width = deep.mask.width;
        deep.mask.data.iter_mut().enumerate().filter(|(k, _)| k % width < 25).for_each(|(_, mask)| *mask = 0);
        assert!((shader.extrapolated_fraction(&deep) - 1.0 / 3.0).abs() < 1e-9);
        deep.mask.data.fill(0);
        assert_eq!(shader.extrapolated_fraction(&deep), 0.0);
        let steep = pressed(|x, _| if x > 0.0 { 0.2 } else { 0.2 + 0.7 * x });
        // Of the column in the fold half the slope is the level pad's.
        assert!((shader.extrapolated_fraction(&steep) - 0.5).abs() < 0.02, "{}", shader.extrapolated_fraction(&steep));
    }

    #[test]
    fn numbers_that_no_light_has_are_refused() {
        let good = CalibrationExtrapolation { leds: vec![Led::default()], stray_light: [0.0; 3], per_mm: [0.1; 3] };
        assert_eq!(good.validate(), Ok(()));
        let led = |led: Led| CalibrationExtrapolation { leds: vec![led], ..good.clone() };
        for bad in [
            led(Led { elevation_deg: 91.0, ..Led::default() }),
            led(Led { azimuth_deg: f64::NAN, ..Led::default() }),
            led(Led { intensity: -1.0, ..Led::default() }),
            led(Led { color: [0.0, 2.0, 0.0], ..Led::default() }),
            CalibrationExtrapolation { leds: vec![Led::default(); 65], ..good.clone() },
            CalibrationExtrapolation { stray_light: [0.0, 1.5, 0.0], ..good.clone() },
            CalibrationExtrapolation { per_mm: [0.0, 0.0, f64::INFINITY], ..good.clone() },
        ] {
            assert!(bad.validate().is_err(), "{bad:?}");
        }
    }
}
