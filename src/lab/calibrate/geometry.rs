//! Computes the pad's surface under a ball from the radius of its contact: what an annotated circle says about the
//! surface.
//!
//! The contact radius of a ball on a bonded layer grows with depth. It is tabulated by pressing the ball into gelsim's
//! own elastic pad at increasing depths, and the table is inverted. The contact is far smaller than the intersection of
//! ball and pad, so R - sqrt(R^2 - a^2) would not be the depth.

use rayon::prelude::*;

use gelsim_core::base::grid::Resolution;
use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::view::View;
use gelsim_core::depth::Depth;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::material::Material;
use gelsim_core::gelpad::{self, Contact, Pad};

/// Ratio of the depths at which the contact of a ball is measured.
const DEPTH_STEP: f64 = 1.2;
/// Shallowest depth, in ball radii.
const SHALLOWEST: f64 = 0.004;
/// Radius of a ball in pixels where its contact is measured.
const RADIUS_PX: f64 = 60.0;
/// Contact radius, in ball radii, from which on a ball touches almost up to its equator: the table ends there.
const WIDEST: f64 = 0.97;

/// Presses balls of one size into one pad.
pub struct Ball {
    radius_mm: f64,
    thickness_mm: f64,
    /// Contact radius and depth, mm, both increasing from 0.
    contact_depths: Vec<[f64; 2]>,
}

impl Ball {
    /// Measures how the contact of a ball grows with depth in a pad of this material.
    pub fn new(radius_mm: f64, material: &Material) -> Self {
        let mm_per_px = radius_mm / RADIUS_PX;
        let size = (2.0 * RADIUS_PX) as usize + 8;
        let camera = View { resolution_px: [size; 2], mm_per_px: [mm_per_px; 2] };
        let full = Elastic { resolution: Resolution::Full, ..Elastic::default() };
        let pad = Pad::new(&gelpad::Model::Elastic(full), material, &camera);
        let mut ball = Self { radius_mm, thickness_mm: material.thickness_mm, contact_depths: vec![[0.0; 2]] };
        let centre = [0.5 * (size as f64 - 1.0); 2];
        let mut depth_mm = SHALLOWEST * radius_mm;
        while depth_mm < 0.98 * ball.thickness_mm {
            let contact = ball.press(&pad, &camera, centre, depth_mm);
            let touching = contact.mask.data.iter().filter(|mask| **mask > 0).count();
            let contact_mm = mm_per_px * libm::sqrt(touching as f64 / std::f64::consts::PI);
            if ball.contact_depths.last().is_none_or(|[last, _]| *last < contact_mm) {
                ball.contact_depths.push([contact_mm, depth_mm]);
            }
            if contact_mm > WIDEST * radius_mm {
                break;
            }
            depth_mm *= DEPTH_STEP;
        }
        ball
    }

    /// Returns the depth of the press whose contact has this radius, mm; `None` if no press in this pad has a contact
    /// as large.
    pub fn depth_mm(&self, contact_mm: f64) -> Option<f64> {
        let above = self.contact_depths.iter().position(|[radius, _]| *radius >= contact_mm)?;
        let [[a0, d0], [a1, d1]] = [self.contact_depths[above.saturating_sub(1)], self.contact_depths[above]];
        // The depth is nearly proportional to the square of the radius.
        let fraction = if a1 > a0 { (contact_mm * contact_mm - a0 * a0) / (a1 * a1 - a0 * a0) } else { 1.0 };
        Some(d0 + fraction * (d1 - d0))
    }

    /// Depth of the deepest press in the table, mm.
    pub fn deepest_mm(&self) -> f64 {
        self.contact_depths.last().map_or(0.0, |[_, depth]| *depth)
    }

    /// Presses the ball into a pad. `centre_px` counts from the centre of the top left pixel.
    pub fn press(&self, pad: &Pad, camera: &View, centre_px: [f64; 2], depth_mm: f64) -> Contact {
        let window = pad.capture_window(depth_mm);
        let margin = window.margin_px;
        let [width, height] = camera.resolution_px.map(|size| size + 2 * margin);
        let mut penetration = Grid::new(width, height);
        let away = |at: usize, k: usize| (at as f64 - margin as f64 - centre_px[k]) * camera.mm_per_px[k];
        for y in 0..height {
            let down = away(y, 1);
            for (x, value) in penetration.row_mut(y).iter_mut().enumerate() {
                let across = away(x, 0);
                let below = self.radius_mm * self.radius_mm - across * across - down * down;
                let reach = if below > 0.0 { depth_mm - self.radius_mm + libm::sqrt(below) } else { f64::NEG_INFINITY };
                *value = reach.clamp(-window.above_mm, self.thickness_mm) as f32;
            }
        }
        let mut depth =
            Depth { penetration, margin_px: margin, touching: Rect::default(), deepest_mm: 0.0, over_thickness_px: 0 };
        depth.measure();
        pad.press(&depth)
    }
}

/// Balls of several sizes for one pad.
pub struct Balls(Vec<Ball>);

impl Balls {
    /// Measures a ball of every size that occurs.
    pub fn new(radii_mm: impl Iterator<Item = f64>, material: &Material) -> Self {
        let mut radii: Vec<f64> = radii_mm.collect();
        radii.sort_by(f64::total_cmp);
        radii.dedup();
        Self(radii.par_iter().map(|radius| Ball::new(*radius, material)).collect())
    }

    /// Returns the ball of this size, which must occur.
    pub fn of_radius(&self, radius_mm: f64) -> &Ball {
        &self.0[self.0.partition_point(|ball| ball.radius_mm < radius_mm)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MATERIAL: Material = Material { thickness_mm: 3.0, youngs_modulus_kpa: 145.0, poisson_ratio: 0.48 };

    #[test]
    fn depth_and_contact_radius_are_hertz_s_for_a_small_contact_on_a_thick_pad() {
        let sensor = Material { thickness_mm: 40.0, ..MATERIAL };
        let ball = Ball::new(4.0, &sensor);
        for contact_mm in [0.8, 1.0, 1.2] {
            let depth_mm = ball.depth_mm(contact_mm).expect("a small contact");
            let hertz_mm = contact_mm * contact_mm / 4.0;
            assert!((depth_mm / hertz_mm - 1.0).abs() < 0.06, "{contact_mm}: {depth_mm} against {hertz_mm}");
        }
        assert!(ball.depth_mm(4.0).is_none() && ball.depth_mm(0.0) == Some(0.0));
    }

    #[test]
    fn a_press_of_a_wanted_contact_radius_has_it() {
        let sensor = Material { thickness_mm: 3.5, ..MATERIAL };
        let (size, pitch) = ([160, 120], 0.05);
        let camera = View { resolution_px: size, mm_per_px: [pitch; 2] };
        let pad = Pad::new(&gelpad::Model::Elastic(Elastic::default()), &sensor, &camera);
        let ball = Ball::new(3.0, &sensor);
        for contact_mm in [0.4, 0.9, 1.6] {
            let depth_mm = ball.depth_mm(contact_mm).expect("not too large");
            let contact = ball.press(&pad, &camera, [70.3, 61.8], depth_mm);
            let touching = contact.mask.data.iter().filter(|mask| **mask > 0).count();
            let found_mm = pitch * libm::sqrt(touching as f64 / std::f64::consts::PI);
            assert!((found_mm - contact_mm).abs() < 0.4 * pitch, "{contact_mm}: {found_mm}");
        }
    }
}
