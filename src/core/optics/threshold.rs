//! Where a press can be seen: the part of the view in which the surface is bent or raised enough to change a grey
//! level.
//!
//! A normal that turns by an angle d changes the diffuse term by at most k_d d and the specular one by at most k_s
//! alpha m^(alpha - 1) 2 d. Here m = sin(e + 2 d) is the largest mirrored share at a slope below d under an LED of
//! elevation e (the mirrored ray turns twice as fast as the normal). The slope bounds the angle. Depth takes a share of
//! the light that is proportional to it. What the LEDs leave unexplained has its own bounds. Outside the region, all of
//! these together stay below [`INVISIBLE_CHANGE`].
//!
//! A near LED's light also follows the surface's height. At a distance r a displacement dw turns the LED's direction by
//! at most dw / r, and brightness, which is (D / r)^2 with D the distance from the middle of the image, changes by at
//! most its 2 dw / r-th part; so light changes by at most D^2 / r^3 (3 k_d + (2 + alpha) k_s) per mm.

use super::Illumination;
use super::led::PlacedLed;
use super::phong::{Phong, Shadows};
use super::residual::LightResidual;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::gelpad::Contact;

/// Largest change of a channel that is left out, as a share of full scale: under half a grey level.
pub const INVISIBLE_CHANGE: f64 = 0.45 / 255.0;

/// Slope that casts no shadow, whatever the LED: half that of the lowest ray in [`super::shadow`]. A steeper one can be
/// too flat to be seen itself and yet take a bright LED's light from what lies behind it.
const FLATTEST_CASTER: f64 = 0.004;

/// Fraction of its distance from the pad at rest by which a near LED may come nearer to a surface outside the region.
const NEARER_FRACTION: f64 = 0.1;

/// Largest change of a channel, by all LEDs together, that may come of ignoring the surface's height, as a fraction of
/// full scale.
const FAR_LED_CHANGE: f64 = 0.05 / 255.0;

/// Extent of a pad's surface at rest.
#[derive(Clone, Copy, Debug)]
pub struct PadExtent {
    /// Half the width and height of the view, mm.
    pub half_mm: [f64; 2],
    /// Lowest and highest point, mm towards the camera.
    pub heights_mm: [f64; 2],
}

impl PadExtent {
    /// Measures a pad in a view of this size; `relief` is its own, if it is not flat.
    pub fn new(field_of_view_mm: [f64; 2], relief: Option<&Grid<f32>>) -> Self {
        let range = |heights: &Grid<f32>| {
            let all = || heights.data.iter().map(|mm| f64::from(*mm));
            [all().fold(0.0, f64::min), all().fold(0.0, f64::max)]
        };
        Self { half_mm: field_of_view_mm.map(|mm| mm / 2.0), heights_mm: relief.map_or([0.0; 2], range) }
    }

    /// Returns the distance of a near LED from the closest point of the pad, mm.
    fn distance_mm(self, led: &PlacedLed) -> f64 {
        let [x, y, z] = led.vector_from([0.0, 0.0]).map(f64::from);
        let [low, high] = self.heights_mm;
        let outside = |at: f64, low: f64, high: f64| at - at.clamp(low, high);
        let [half_x, half_y] = self.half_mm;
        libm::hypot(libm::hypot(outside(x, -half_x, half_x), outside(y, -half_y, half_y)), outside(-z, low, high))
    }
}

/// Lets those LEDs ignore the surface's height that are too far away for it to matter. A surface stays within
/// `thickness_mm` of the pad at rest.
pub fn ignore_height_of_far_leds(leds: &mut [PlacedLed], phong: &Phong, pad: PadExtent, thickness_mm: f64) {
    let each = FAR_LED_CHANGE / leds.len() as f64;
    let [low, high] = pad.heights_mm;
    let furthest_mm = thickness_mm + high.max(-low);
    for led in leds.iter_mut().filter(|led| led.follows_height()) {
        let brightest = led.color.into_iter().fold(0.0, f32::max);
        let nearest_mm = pad.distance_mm(led) - thickness_mm;
        let change = f64::from(brightest) * change_per_mm(phong, led, nearest_mm) * furthest_mm;
        if nearest_mm > 0.0 && change <= each {
            *led = led.regardless_of_height();
        }
    }
}

/// Returns the largest change of a near LED's light per mm of a surface's height, at intensity 1, if the surface is no
/// nearer than `nearest_mm`.
fn change_per_mm(phong: &Phong, led: &PlacedLed, nearest_mm: f64) -> f64 {
    let lobe = match phong.shininess {
        alpha if alpha >= 1.0 => alpha,
        alpha if alpha > 0.0 && phong.specular > 0.0 => f64::INFINITY,
        _ => 0.0,
    };
    led.strength_at_distance(nearest_mm) / nearest_mm * (3.0 * phong.diffuse + (2.0 + lobe) * phong.specular)
}

/// The slope and the displacement that no pixel outside the region exceeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threshold {
    /// Slope along x and along y, mm/mm.
    pub slope: f32,
    /// Displacement, mm.
    pub height_mm: f32,
}

impl Threshold {
    /// Computes the threshold for a light model and a sensor; `rough` if the pad itself is not flat.
    pub fn new(phong: &Phong, leds: &[PlacedLed], pad: PadExtent, rough: bool, light: &Illumination) -> Self {
        let [half_x, half_y] = pad.half_mm;
        // The point of the view that a near LED lights most strongly, and most steeply, is the one closest to it.
        let closest = |led: &PlacedLed| {
            let [x, y, _] = led.vector_from([0.0, 0.0]).map(f64::from);
            [x.clamp(-half_x, half_x) as f32, y.clamp(-half_y, half_y) as f32]
        };
        // No background is brighter than white.
        let most = light.stray_light.map_or([1.0; 3], |stray| stray.map(|share| 1.0 - share));
        let change = |angle: f64| {
            let mut sums = [0.0; 3];
            for led in leds {
                let at = closest(led);
                let [x, y, z] = led.vector_from(at).map(f64::from);
                let elevation = libm::atan2(-z, libm::hypot(x, y));
                // A raised surface may be nearer to the LED, and turned towards it.
                let (strength, turned) = match led.follows_height() {
                    true => (
                        led.strength_at_distance((1.0 - NEARER_FRACTION) * pad.distance_mm(led)),
                        libm::asin(NEARER_FRACTION),
                    ),
                    false => (f64::from(led.strength_at_point(at)), 0.0),
                };
                let mirrored = match rough {
                    true => 1.0,
                    false => libm::sin((elevation + turned + 2.0 * angle).min(std::f64::consts::FRAC_PI_2)),
                };
                let lobe = match phong.shininess {
                    alpha if alpha >= 1.0 => 2.0 * alpha * libm::pow(mirrored, alpha - 1.0),
                    alpha if alpha > 0.0 && phong.specular > 0.0 => f64::INFINITY,
                    _ => 0.0,
                };
                let change = strength * (phong.diffuse + phong.specular * lobe) * angle;
                // An infinitely steep lobe times no light would be NaN, but is no change.
                for ((sum, share), most) in
                    sums.iter_mut().zip(led.color).zip(most).filter(|((_, share), _)| *share > 0.0)
                {
                    *sum += f64::from(share) * most * change;
                }
            }
            if let Some(residual) = light.residual {
                let changes = residual.change_by_angle(angle).into_iter().zip(most);
                sums.iter_mut().zip(changes).for_each(|(sum, (change, most))| *sum += most * change);
            }
            sums.into_iter().fold(0.0, f64::max)
        };
        // Slopes may use two thirds of the bound, displacements the rest.
        let (mut low, mut high) = (0.0, 0.5);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if change(middle) <= INVISIBLE_CHANGE * 2.0 / 3.0 { low = middle } else { high = middle }
        }
        if matches!(phong.shadows, Shadows::Soft(_)) {
            low = low.min(FLATTEST_CASTER);
        }
        let per_mm = light.darkening_per_mm(phong) + light.residual.map_or(0.0, LightResidual::change_per_mm);
        let (mut by_height, mut nearer_mm) = ([0.0; 3], f64::INFINITY);
        for led in leds.iter().filter(|led| led.follows_height()) {
            let distance_mm = pad.distance_mm(led);
            let change = change_per_mm(phong, led, (1.0 - NEARER_FRACTION) * distance_mm);
            nearer_mm = nearer_mm.min(NEARER_FRACTION * distance_mm);
            for ((sum, share), most) in by_height.iter_mut().zip(led.color).zip(most).filter(|((_, c), _)| *c > 0.0) {
                *sum += f64::from(share) * most * change;
            }
        }
        let per_mm = per_mm + by_height.into_iter().fold(0.0, f64::max);
        Self {
            // Slopes along x and y are compared one by one, and may both be as large as this.
            slope: (low * std::f64::consts::FRAC_1_SQRT_2) as f32,
            height_mm: if per_mm > 0.0 { (INVISIBLE_CHANGE / 3.0 / per_mm).min(nearer_mm) as f32 } else { f32::MAX },
        }
    }

    /// Returns the smallest rectangle of the view outside which no slope and no displacement exceeds the threshold.
    pub fn visible_region(&self, contact: &Contact, view: &View) -> Rect {
        let [width, height] = view.resolution_px;
        // A pixel's slopes reach one pixel further than the displacement itself.
        let padded = contact.region.grown(1, contact.surface.width, contact.surface.height);
        let part = padded.in_window(SURFACE_BORDER, SURFACE_BORDER, width, height);
        if part.is_empty() {
            return part;
        }
        let limits = [self.slope * (2.0 * view.mm_per_px[0]) as f32, self.slope * (2.0 * view.mm_per_px[1]) as f32];
        let exceeds = |part: Rect| Excess::new(&contact.surface, part, limits, self.height_mm);
        let Excess { rows, columns } = exceeds(part);
        let first_and_end = |marks: &[u32]| {
            let first = marks.iter().position(|mark| *mark > 0)?;
            Some((first, marks.iter().rposition(|mark| *mark > 0)? + 1))
        };
        match (first_and_end(&columns), first_and_end(&rows)) {
            (Some((x0, x1)), Some((y0, y1))) => {
                Rect { x0: part.x0 + x0, y0: part.y0 + y0, x1: part.x0 + x1, y1: part.y0 + y1 }
            }
            _ => Rect::default(),
        }
    }
}

/// The rows and columns of a part of the view in which some pixel exceeds the threshold.
struct Excess {
    rows: Vec<u32>,
    columns: Vec<u32>,
}

impl Excess {
    fn new(surface: &Grid<f32>, part: Rect, limits: [f32; 2], height_mm: f32) -> Self {
        let width = part.width();
        let (mut rows, mut columns) = (vec![0_u32; part.height()], vec![0_u32; width]);
        simd_dispatch(
            #[inline(always)]
            || {
                for (row, mark) in rows.iter_mut().enumerate() {
                    let window = |dx: usize, dy: usize| &surface.row(part.y0 + row + dy)[part.x0 + dx..][..width];
                    let (left, right, above) = (window(0, 1), window(2, 1), window(1, 0));
                    let (below, here, columns) = (window(1, 2), window(1, 1), &mut columns[..width]);
                    let mut any = 0;
                    for x in 0..width {
                        // NaN is not below the limit either.
                        let calm = ((left[x] - right[x]).abs() <= limits[0])
                            & ((above[x] - below[x]).abs() <= limits[1])
                            & (here[x].abs() <= height_mm);
                        let exceeds = u32::from(!calm);
                        columns[x] |= exceeds;
                        any |= exceeds;
                    }
                    *mark = any;
                }
            },
        );
        Self { rows, columns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::led::{Led, Normals, RowPositions};

    const NORMALS: [[f32; 2]; 6] = [[0.0, 0.0], [0.3, 0.0], [-0.4, 0.2], [0.0, -0.7], [0.6, 0.6], [-0.9, 0.1]];

    fn led(distance_mm: f64, elevation_deg: f64, intensity: f64) -> PlacedLed {
        PlacedLed::new(&Led { distance_mm, elevation_deg, azimuth_deg: 20.0, intensity, ..Led::default() }, true)
    }

    /// What it gives at intensity 1 where the surface has this height.
    fn light(phong: &Phong, led: &PlacedLed, [x_mm, y_mm]: [f32; 2], normal: [f32; 2], height_mm: f64) -> f64 {
        let mut normals = Normals::default();
        normals.push(normal);
        let row = RowPositions { x_mm: &[x_mm], y_mm, heights_mm: &[height_mm as f32] };
        let mut gain = [0.0];
        crate::optics::phong::reflect_row(phong, led, &normals, row, &mut gain);
        f64::from(gain[0])
    }

    fn places() -> impl Iterator<Item = ([f32; 2], [f32; 2])> {
        let across = [-4.0, -1.5, 0.0, 2.0, 4.0];
        let at = across.into_iter().flat_map(move |x| across.map(|y| [x, 0.75 * y]));
        at.flat_map(|at| NORMALS.map(|normal| (at, normal)))
    }

    #[test]
    fn no_height_changes_a_near_leds_light_by_more_than_the_bound() {
        let pad = PadExtent { half_mm: [4.0, 3.0], heights_mm: [-0.3, 1.2] };
        let step_mm = 0.05;
        for (shininess, elevation_deg) in [(0.0, 10.0), (1.0, 30.0), (5.0, 45.0), (5.0, 70.0), (30.0, 90.0)] {
            let phong = Phong { shininess, specular: 0.6, ..Phong::default() };
            for distance_mm in [5.0, 8.0, 20.0, 1e3] {
                let led = led(distance_mm, elevation_deg, 1.0);
                let nearest_mm = pad.distance_mm(&led);
                if nearest_mm < 0.5 {
                    continue;
                }
                let bound = change_per_mm(&phong, &led, nearest_mm) * step_mm;
                let mut most = 0.0_f64;
                for (at, normal) in places() {
                    for k in 0..30 {
                        let [low, high] = [k, k + 1].map(|k| -0.3 + step_mm * f64::from(k));
                        let change = light(&phong, &led, at, normal, high) - light(&phong, &led, at, normal, low);
                        most = most.max(change.abs());
                    }
                }
                assert!(most <= bound * 1.001 + 1e-5, "{most} over {bound}: {distance_mm} mm, alpha {shininess}");
                assert!(most > 0.03 * bound, "{most} under {bound}: {distance_mm} mm, alpha {shininess}");
            }
        }
    }

    #[test]
    fn leds_are_left_on_the_undeformed_pad_only_if_no_height_changes_their_light() {
        let (phong, thickness_mm) = (Phong::default(), 3.0);
        let pad = PadExtent { half_mm: [8.0, 6.0], heights_mm: [0.0; 2] };
        for (distance_mm, intensity, left) in
            [(20.0, 1.0, false), (2e3, 1.0, false), (2e3, 0.001, true), (1e6, 100.0, false), (1e6, 1.0, true)]
        {
            let mut leds = [10.0, 30.0, 80.0].map(|elevation| led(distance_mm, elevation, intensity));
            ignore_height_of_far_leds(&mut leds, &phong, pad, thickness_mm);
            assert!(leds.iter().all(|led| led.follows_height() != left), "{distance_mm} mm, intensity {intensity}");
            for (at, normal) in places().filter(|_| left) {
                for height_mm in [-thickness_mm, -0.1, 0.4, thickness_mm] {
                    let change = |elevation: f64| {
                        let led = led(distance_mm, elevation, intensity);
                        let there = light(&phong, &led, at, normal, height_mm);
                        intensity * (there - light(&phong, &led.regardless_of_height(), at, normal, height_mm)).abs()
                    };
                    let all: f64 = [10.0, 30.0, 80.0].map(change).iter().sum();
                    assert!(all <= FAR_LED_CHANGE, "{all} at a height of {height_mm}");
                }
            }
        }
    }
}
