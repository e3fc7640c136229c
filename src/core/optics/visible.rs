//! Where a press can be seen: the part of the view in which the surface is bent or raised enough to change a grey level.
//!
//! A normal that turns by an angle d changes the diffuse term by at most k_d d and the specular one by at most
//! k_s alpha m^(alpha - 1) 2 d, with m = sin(e + 2 d) the largest mirrored share at a slope below d under an LED of
//! elevation e (the mirrored ray turns twice as fast as the normal); the slope bounds the angle. Depth takes a share of
//! the light that is proportional to it. What the LEDs leave unexplained has its own bounds. Outside the region all together
//! stay below [`BOUND`].

use super::Illumination;
use super::led::PlacedLed;
use super::phong::{Phong, Shadows};
use super::residual::LightResidual;
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::simd::simd_dispatch;
use crate::core::base::view::SURFACE_BORDER;
use crate::core::base::view::View;
use crate::core::gelpad::Contact;

/// Largest change of a channel that is left out, as a share of full scale: under half a grey level.
pub const BOUND: f64 = 0.45 / 255.0;

/// Slope that casts no shadow, whatever the LED: half that of the lowest ray in [`super::shadow`]. A steeper one can be
/// too flat to be seen itself and yet take a bright LED's light from what lies behind it.
const FLATTEST_CASTER: f64 = 0.004;

/// What no pixel outside the region exceeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threshold {
    /// Slope along x and along y, mm/mm.
    pub slope: f32,
    /// Displacement, mm.
    pub height_mm: f32,
}

impl Threshold {
    /// For a light model and a sensor; `rough` if the pad itself is not flat.
    pub fn new(phong: &Phong, lamps: &[PlacedLed], rough: bool, light: &Illumination) -> Self {
        let [half_x, half_y] = light.field_of_view_mm.map(|mm| mm / 2.0);
        // The point of the view that a near LED lights most strongly, and most steeply, is the one closest to it.
        let closest = |lamp: &PlacedLed| {
            let [x, y, _] = lamp.seen_from([0.0, 0.0]).map(f64::from);
            [x.clamp(-half_x, half_x) as f32, y.clamp(-half_y, half_y) as f32]
        };
        // No background is brighter than white.
        let most = light.stray_light.map_or([1.0; 3], |stray| stray.map(|share| 1.0 - share));
        let change = |angle: f64| {
            let mut sums = [0.0; 3];
            for lamp in lamps {
                let at = closest(lamp);
                let [x, y, z] = lamp.seen_from(at).map(f64::from);
                let elevation = libm::atan2(-z, libm::hypot(x, y));
                let mirrored = match rough {
                    true => 1.0,
                    false => libm::sin((elevation + 2.0 * angle).min(std::f64::consts::FRAC_PI_2)),
                };
                let lobe = match phong.shininess {
                    alpha if alpha >= 1.0 => 2.0 * alpha * libm::pow(mirrored, alpha - 1.0),
                    alpha if alpha > 0.0 && phong.specular > 0.0 => f64::INFINITY,
                    _ => 0.0,
                };
                let change = f64::from(lamp.strength(at)) * (phong.diffuse + phong.specular * lobe) * angle;
                // A lobe that is infinitely steep times no light is no change.
                for ((sum, share), most) in
                    sums.iter_mut().zip(lamp.color).zip(most).filter(|((_, share), _)| *share > 0.0)
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
        let (mut low, mut high) = (0.0, 0.5);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if change(middle) <= BOUND * 2.0 / 3.0 { low = middle } else { high = middle }
        }
        if matches!(phong.shadows, Shadows::Soft(_)) {
            low = low.min(FLATTEST_CASTER);
        }
        let per_mm = light.darkening_per_mm(phong) + light.residual.map_or(0.0, LightResidual::change_per_mm);
        Self {
            // Slopes along x and y are compared one by one.
            slope: (low * std::f64::consts::FRAC_1_SQRT_2) as f32,
            height_mm: if per_mm > 0.0 { (BOUND / 3.0 / per_mm) as f32 } else { f32::MAX },
        }
    }

    /// The smallest rectangle of the view outside which no slope and no displacement exceeds the threshold.
    pub fn region(&self, contact: &Contact, view: &View) -> Rect {
        let [width, height] = view.resolution_px;
        // A pixel's slopes reach one pixel further than the displacement itself.
        let padded = contact.region.grown(1, contact.surface.width, contact.surface.height);
        let part = padded.seen_from(SURFACE_BORDER, SURFACE_BORDER, width, height);
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

/// In which rows and columns of a part of the view some pixel exceeds the threshold.
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
                        // What is not a number is not below the limit either.
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
