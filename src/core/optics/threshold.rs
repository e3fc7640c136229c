//! Where a press can be seen: the part of the view in which the surface is bent or raised enough to change a grey
//! level.
//!
//! A normal that turns by an angle d changes the diffuse term by at most k_d d and the specular one by at most k_s
//! alpha m^(alpha - 1) 2 d. Here m = sin(e + 2 d) is the largest mirrored share at a slope below d under an LED of
//! elevation e (the mirrored ray turns twice as fast as the normal). The slope bounds the angle. Depth takes a share of
//! the light that is proportional to it. What the LEDs leave unexplained has its own bounds. Outside the region, all of
//! these together stay below [`INVISIBLE_CHANGE`].
//!
//! A near LED's light also follows the surface's height. It comes from points. At a distance r a displacement dw turns
//! the direction to a point by at most dw / r, and brightness, which is F / r^2, changes by at most its 2 dw / r-th part,
//! with a lobe of exponent m by its m dw / r-th part more; so light changes by at most F / r^3 ((3 + m) k_d + (2 + m +
//! alpha) k_s) per mm. The share of it that a window reflects changes by a bounded amount per mm, too.

use super::Illumination;
use super::led::PlacedLed;
use super::near_light::NearLights;
use super::near_light::points::{LightPoint, NearLed};
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

    /// Returns the distance of a point that shines from the closest point of the pad, mm.
    fn distance_mm(self, point: &LightPoint) -> f64 {
        let [x, y, z] = point.at_mm.map(f64::from);
        let [low, high] = self.heights_mm;
        let outside = |at: f64, low: f64, high: f64| at - at.clamp(low, high);
        let [half_x, half_y] = self.half_mm;
        libm::hypot(libm::hypot(outside(x, -half_x, half_x), outside(y, -half_y, half_y)), outside(-z, low, high))
    }
}

/// What bounds the change of a light at intensity 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightBound {
    /// Colour times intensity.
    color: [f32; 3],
    /// Most light that a surface which faces it receives.
    strength: f64,
    /// Greatest elevation over the pad from which it comes, rad.
    elevation: f64,
    /// Largest change per mm of a surface's height.
    per_mm: f64,
    /// How much nearer the surface may come, mm.
    nearer_mm: f64,
}

impl LightBound {
    /// Returns the bound of an LED at infinity.
    pub fn of_distant_led(led: &PlacedLed) -> Self {
        let [x, y, z] = led.direction().map(f64::from);
        let elevation = libm::atan2(-z, libm::hypot(x, y));
        Self { color: led.color.most(), strength: 1.0, elevation, per_mm: 0.0, nearer_mm: f64::INFINITY }
    }

    /// Returns the bounds of the points of near LEDs.
    pub fn of_near_lights(lights: &NearLights, phong: &Phong, pad: PadExtent) -> Vec<Self> {
        let of_led = |led: &NearLed| {
            let color = led.color.most();
            led.points.iter().map(move |point| Self::of_point(point, color, lights, phong, pad)).collect::<Vec<_>>()
        };
        lights.leds.iter().flat_map(of_led).collect()
    }

    fn of_point(point: &LightPoint, color: [f32; 3], lights: &NearLights, phong: &Phong, pad: PadExtent) -> Self {
        let [half_x, half_y] = pad.half_mm;
        // The point of the view that it lights most strongly, and most steeply, is the one closest to it.
        let [x, y, _] = point.at_mm.map(f64::from);
        let closest = [x.clamp(-half_x, half_x) as f32, y.clamp(-half_y, half_y) as f32];
        let [x, y, z] = point.vector_from(closest).map(f64::from);
        let distance_mm = pad.distance_mm(point);
        // A raised surface may be nearer to it, and turned towards it.
        let nearest_mm = (1.0 - NEARER_FRACTION) * distance_mm;
        let strength = point.strength_at_distance(nearest_mm);
        let reflected = if point.is_mirrored { lights.most_reflected_per_cosine() } else { 0.0 };
        Self {
            color,
            strength,
            elevation: libm::atan2(-z, libm::hypot(x, y)) + libm::asin(NEARER_FRACTION),
            per_mm: change_per_mm(phong, point, nearest_mm)
                + strength / nearest_mm * reflected * (phong.diffuse + phong.specular),
            nearer_mm: NEARER_FRACTION * distance_mm,
        }
    }
}

/// Returns the largest change of a point's light per mm of a surface's height, at intensity 1, if the surface is no
/// nearer than `nearest_mm`.
fn change_per_mm(phong: &Phong, point: &LightPoint, nearest_mm: f64) -> f64 {
    let lobe = match phong.shininess {
        alpha if alpha >= 1.0 => alpha,
        alpha if alpha > 0.0 && phong.specular > 0.0 => f64::INFINITY,
        _ => 0.0,
    };
    let beam = match f64::from(point.lobe) {
        exponent if exponent >= 1.0 => exponent,
        exponent if exponent > 0.0 => f64::INFINITY,
        _ => 0.0,
    };
    point.strength_at_distance(nearest_mm) / nearest_mm
        * ((3.0 + beam) * phong.diffuse + (2.0 + beam + lobe) * phong.specular)
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
    /// Computes the threshold for the light of a sensor; `rough` if the pad itself is not flat.
    pub fn new(phong: &Phong, lights: &[LightBound], rough: bool, light: &Illumination) -> Self {
        // No background is brighter than white.
        let most = light.stray_light.map_or([1.0; 3], |stray| stray.map(|share| 1.0 - share));
        let change = |angle: f64| {
            let mut sums = [0.0; 3];
            for led in lights {
                let mirrored = match rough {
                    true => 1.0,
                    false => libm::sin((led.elevation + 2.0 * angle).min(std::f64::consts::FRAC_PI_2)),
                };
                let lobe = match phong.shininess {
                    alpha if alpha >= 1.0 => 2.0 * alpha * libm::pow(mirrored, alpha - 1.0),
                    alpha if alpha > 0.0 && phong.specular > 0.0 => f64::INFINITY,
                    _ => 0.0,
                };
                let change = led.strength * (phong.diffuse + phong.specular * lobe) * angle;
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
        for led in lights {
            nearer_mm = nearer_mm.min(led.nearer_mm);
            for ((sum, share), most) in by_height.iter_mut().zip(led.color).zip(most).filter(|((_, c), _)| *c > 0.0) {
                *sum += f64::from(share) * most * led.per_mm;
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
    use crate::base::grid::{Grid, Rect};
    use crate::optics::led::{Led, Normals};
    use crate::optics::near_light::bounce::Coat;
    use crate::optics::near_light::field::LightVectors;
    use crate::optics::near_light::window::Window;

    const VIEW: View = View { resolution_px: [17, 13], mm_per_px: [0.5, 0.5] };
    const NORMALS: [[f32; 2]; 6] = [[0.0, 0.0], [0.3, 0.0], [-0.4, 0.2], [0.0, -0.7], [0.6, 0.6], [-0.9, 0.1]];

    /// The light at every pixel of a level pad at a height, with its normals turned.
    fn light(lights: &NearLights, phong: &Phong, height_mm: f32, normal: [f32; 2]) -> Vec<f32> {
        let surface = Grid { width: 19, height: 15, data: vec![height_mm; 19 * 15] };
        let field = lights.field_at_rest(&surface);
        let (mut normals, mut row, mut line, mut all) =
            (Normals::default(), LightVectors::default(), Vec::new(), Vec::new());
        (0..17).for_each(|_| normals.push(normal));
        for y in 0..13 {
            for led in 0..lights.leds.len() {
                let mut gain = vec![0.0; 17];
                field.fill_row(led, y, 0, &mut line, &mut row, 17);
                row.reflect(phong, &normals, &mut gain);
                all.extend(gain);
            }
        }
        all
    }

    #[test]
    fn no_height_changes_a_near_leds_light_by_more_than_the_bound() {
        let Rect { x1, y1, .. } = Rect::whole(17, 13);
        let pad = PadExtent { half_mm: [x1 as f64 * 0.25, y1 as f64 * 0.25], heights_mm: [-0.3, 1.2] };
        for (shininess, elevation_deg, lobe) in
            [(0.0, 10.0, 0.0), (1.0, 30.0, 1.0), (5.0, 45.0, 2.0), (5.0, 70.0, 1.0), (30.0, 80.0, 0.0)]
        {
            let phong = Phong { shininess, specular: 0.6, shadows: Shadows::None, ..Phong::default() };
            for distance_mm in [6.0, 8.0, 20.0] {
                for window_mm in [None, Some(9.0_f64.max(distance_mm))] {
                    let led = Led {
                        elevation_deg,
                        distance_mm,
                        lobe,
                        size_mm: Some([3.0, 0.5]),
                        azimuth_deg: 20.0,
                        ..Led::default()
                    };
                    let window = window_mm.map(|distance_mm| Window { distance_mm, refractive_index: 1.41 });
                    let lights = NearLights::new(&phong, &[led], window.as_ref(), Coat::default(), &VIEW);
                    let bounds = LightBound::of_near_lights(&lights, &phong, pad);
                    if bounds.iter().any(|bound| bound.nearer_mm < 0.05) {
                        continue;
                    }
                    let bound: f64 = bounds.iter().map(|bound| bound.per_mm).sum::<f64>() * 0.05;
                    let mut most = 0.0_f64;
                    for normal in NORMALS {
                        for k in 0..30 {
                            let [low, high] = [k, k + 1].map(|k| -0.3 + 0.05 * k as f32);
                            let [low, high] = [low, high].map(|height| light(&lights, &phong, height, normal));
                            let changes = low.iter().zip(&high).map(|(low, high)| f64::from((low - high).abs()));
                            most = changes.fold(most, f64::max);
                        }
                    }
                    assert!(most <= bound * 1.001 + 1e-5, "{most} over {bound}: {distance_mm} mm, alpha {shininess}");
                    assert!(most > 0.01 * bound, "{most} under {bound}: {distance_mm} mm, alpha {shininess}");
                }
            }
        }
    }
}
