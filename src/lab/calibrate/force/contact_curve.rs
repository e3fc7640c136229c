//! How force, contact radius and tangential stiffness of an indenter grow with depth on a layer of Young's modulus 1.
//!
//! The layer is gelsim's own ([`gelsim_core::gelpad::elastic`]), solved at some depths. What is stored is the ratio to
//! a half-space, which changes slowly with the square root of the depth and is 1 at depth 0.

use std::f64::consts::PI;

use rayon::prelude::*;

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::view::View;
use gelsim_core::depth::Depth;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::gelpad::elastic::shear::{Friction, Motion, solve_shear};
use gelsim_core::gelpad::elastic::{Elastic, ElasticPad};
use gelsim_core::gelpad::material::Material;

/// Depths at which a ball's contact is solved.
const BALL_NODES: usize = 14;
/// Width and height of the grid on which a contact is solved, px, without its margin.
const VIEW_PX: usize = 96;
/// Width of that grid over what a ball's contact on a half-space is wide. A thin layer makes it 1.41 times as wide.
const BALL_ROOM: f64 = 1.6;
/// Width of that grid over the width of a punch.
const PUNCH_ROOM: f64 = 1.25;
/// Greatest depth over thickness at which contacts are solved.
pub const DEEPEST_SHARE: f64 = 0.95;
/// Thickness over the width of the grid from which on a layer is a half-space.
const HALF_SPACE: f64 = 200.0;
/// Depth over radius of a press on a half-space that tells the error of a grid.
const SHALLOW_SHARE: f64 = 1e-3;

/// What is pressed into the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ForceIndenter {
    /// A ball.
    Ball {
        /// Its radius, mm.
        radius_mm: f64,
    },
    /// A cylinder with a flat end, upright.
    Punch {
        /// Its radius, mm.
        radius_mm: f64,
    },
}

impl ForceIndenter {
    /// Radius of the ball or punch, mm.
    pub fn radius_mm(self) -> f64 {
        match self {
            Self::Ball { radius_mm } | Self::Punch { radius_mm } => radius_mm,
        }
    }

    /// Names it with its size.
    pub fn describe(self) -> String {
        match self {
            Self::Ball { radius_mm } => format!("a ball of {radius_mm} mm radius"),
            Self::Punch { radius_mm } => format!("a flat punch of {radius_mm} mm radius"),
        }
    }
}

/// Force, contact radius and stiffness of an indenter on a layer of Young's modulus 1.
#[derive(Clone, Debug)]
pub struct ContactCurve {
    indenter: ForceIndenter,
    poisson_ratio: f64,
    /// Square roots of the depths that were solved, from 0 up.
    nodes: Vec<f64>,
    /// Ratios to a half-space at these: force, contact radius, tangential stiffness.
    ratios: [Vec<f64>; 3],
}

/// A solved contact: force over Young's modulus (mm^2), contact radius (mm), tangential stiffness over Young's modulus
/// (mm).
type Solved = [f64; 3];

impl ContactCurve {
    /// Solves for the contacts of an indenter down to a depth, mm.
    pub fn new(indenter: ForceIndenter, material: &Material, deepest_mm: f64) -> Self {
        let limit = DEEPEST_SHARE * material.thickness_mm;
        let limit = match indenter {
            ForceIndenter::Ball { radius_mm } => limit.min(0.9 * radius_mm),
            ForceIndenter::Punch { .. } => limit,
        };
        let deepest_mm = deepest_mm.clamp(1e-3 * limit, limit);
        let count = match indenter {
            ForceIndenter::Ball { .. } => BALL_NODES,
            // Everything is proportional to the depth under a punch.
            ForceIndenter::Punch { .. } => 1,
        };
        let depths: Vec<f64> = (1..=count).map(|k| deepest_mm * (k as f64 / count as f64).powi(2)).collect();
        let poisson_ratio = material.poisson_ratio;
        // Grids grow with their contacts, so that the error of their pixels is that of a shallow press on a half-space.
        let shallow_mm = SHALLOW_SHARE * indenter.radius_mm();
        let thick = Material { thickness_mm: HALF_SPACE * view_width_mm(indenter, shallow_mm), ..*material };
        let grid = solve_contact(indenter, &thick, shallow_mm);
        let exact = half_space(indenter, poisson_ratio, shallow_mm);
        let grid_error = [0, 1, 2].map(|k| ratio_or_one(grid[k], exact[k]));
        let solved: Vec<Solved> = depths
            .par_iter()
            .map(|depth_mm| {
                let found = solve_contact(indenter, material, *depth_mm);
                let expected = half_space(indenter, poisson_ratio, *depth_mm);
                [0, 1, 2].map(|k| ratio_or_one(found[k], expected[k] * grid_error[k]))
            })
            .collect();
        let first = match indenter {
            ForceIndenter::Ball { .. } => [1.0; 3],
            ForceIndenter::Punch { .. } => solved[0],
        };
        let nodes = [0.0].into_iter().chain(depths.iter().map(|depth| depth.sqrt())).collect();
        let ratios = [0, 1, 2].map(|k| [first[k]].into_iter().chain(solved.iter().map(|ratio| ratio[k])).collect());
        Self { indenter, poisson_ratio, nodes, ratios }
    }

    /// The indenter.
    pub fn indenter(&self) -> ForceIndenter {
        self.indenter
    }

    /// Greatest depth that was solved, mm. Beyond it the ratio to a half-space stays constant.
    pub fn deepest_mm(&self) -> f64 {
        self.nodes.last().map_or(0.0, |root| root * root)
    }

    /// Normal force over Young's modulus at a depth, mm^2; 0 above the pad.
    pub fn force(&self, depth_mm: f64) -> f64 {
        self.value(0, depth_mm)
    }

    /// Radius of the contact at a depth, mm; 0 above the pad.
    pub fn contact_radius_mm(&self, depth_mm: f64) -> f64 {
        match self.indenter {
            ForceIndenter::Punch { radius_mm } if depth_mm > 0.0 => radius_mm,
            _ => self.value(1, depth_mm),
        }
    }

    /// Tangential force over Young's modulus and displacement of an indenter that sticks, mm; 0 above the pad.
    pub fn shear_stiffness_mm(&self, depth_mm: f64) -> f64 {
        self.value(2, depth_mm)
    }

    /// Depth at which the contact has this radius, mm; `None` under a punch, whose contact does not grow, and for a
    /// contact larger than any that was solved.
    pub fn depth_for_radius_mm(&self, contact_radius_mm: f64) -> Option<f64> {
        let ForceIndenter::Ball { .. } = self.indenter else { return None };
        let (mut low, mut high) = (0.0, self.deepest_mm());
        if contact_radius_mm > self.contact_radius_mm(high) || contact_radius_mm.is_nan() {
            return None;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            match self.contact_radius_mm(middle) < contact_radius_mm {
                true => low = middle,
                false => high = middle,
            }
        }
        Some(0.5 * (low + high))
    }

    fn value(&self, which: usize, depth_mm: f64) -> f64 {
        if depth_mm.is_nan() || depth_mm <= 0.0 {
            return 0.0;
        }
        let root = depth_mm.sqrt();
        half_space(self.indenter, self.poisson_ratio, depth_mm)[which]
            * interpolate(&self.nodes, &self.ratios[which], root)
    }
}

fn ratio_or_one(found: f64, expected: f64) -> f64 {
    let ratio = found / expected;
    if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
}

/// Returns the contact on a half-space of Young's modulus 1 (Hertz 1882, Sneddon 1965, Mindlin 1949).
fn half_space(indenter: ForceIndenter, poisson_ratio: f64, depth_mm: f64) -> Solved {
    let plane_modulus = 1.0 / (1.0 - poisson_ratio * poisson_ratio);
    let stiffness = |radius_mm: f64| 4.0 * radius_mm / ((1.0 + poisson_ratio) * (2.0 - poisson_ratio));
    match indenter {
        ForceIndenter::Ball { radius_mm } => {
            let contact_mm = (radius_mm * depth_mm).sqrt();
            [4.0 / 3.0 * plane_modulus * contact_mm * depth_mm, contact_mm, stiffness(contact_mm)]
        }
        ForceIndenter::Punch { radius_mm } => {
            [2.0 * plane_modulus * radius_mm * depth_mm, radius_mm, stiffness(radius_mm)]
        }
    }
}

/// Interpolates between nodes by the cubic whose slopes are those of the parabolas through three nodes; constant beyond
/// the last one.
fn interpolate(nodes: &[f64], values: &[f64], at: f64) -> f64 {
    let last = nodes.len() - 1;
    if at >= nodes[last] {
        return values[last];
    }
    let k = nodes.partition_point(|node| *node <= at).clamp(1, last) - 1;
    let secant = |k: usize| (values[k + 1] - values[k]) / (nodes[k + 1] - nodes[k]);
    let width = |k: usize| nodes[k + 1] - nodes[k];
    let slope = |j: usize| match j {
        0 => secant(0),
        j if j == last => secant(last - 1),
        j => (secant(j - 1) * width(j) + secant(j) * width(j - 1)) / (width(j - 1) + width(j)),
    };
    let (h, t) = (width(k), (at - nodes[k]) / width(k));
    let (t2, t3) = (t * t, t * t * t);
    values[k] * (2.0 * t3 - 3.0 * t2 + 1.0)
        + h * slope(k) * (t3 - 2.0 * t2 + t)
        + values[k + 1] * (3.0 * t2 - 2.0 * t3)
        + h * slope(k + 1) * (t3 - t2)
}

/// Width of the grid on which a contact is solved, mm.
fn view_width_mm(indenter: ForceIndenter, depth_mm: f64) -> f64 {
    match indenter {
        ForceIndenter::Ball { radius_mm } => 2.0 * BALL_ROOM * (radius_mm * depth_mm).sqrt(),
        ForceIndenter::Punch { radius_mm } => 2.0 * PUNCH_ROOM * radius_mm,
    }
}

/// Solves for a contact on a grid of its own.
fn solve_contact(indenter: ForceIndenter, material: &Material, depth_mm: f64) -> Solved {
    let mm_per_px = view_width_mm(indenter, depth_mm) / VIEW_PX as f64;
    let view = View { resolution_px: [VIEW_PX; 2], mm_per_px: [mm_per_px; 2] };
    // A tolerance relative to the depth, so that shallow contacts are as exact as deep ones.
    let elastic = Elastic { tolerance_um: (0.2 * depth_mm).clamp(0.01, 1000.0), ..Elastic::default() };
    let pad = ElasticPad::new(&elastic, material, &view);
    let window = pad.capture_window(depth_mm);
    let size = VIEW_PX + 2 * window.margin_px;
    let mut penetration = Grid::new(size, size);
    let away = |at: usize| (at as f64 + 0.5 - 0.5 * size as f64) * mm_per_px;
    for y in 0..size {
        for (x, value) in penetration.row_mut(y).iter_mut().enumerate() {
            let square = away(x).powi(2) + away(y).powi(2);
            let reach_mm = match indenter {
                ForceIndenter::Ball { radius_mm } if square < radius_mm * radius_mm => {
                    depth_mm - square / (radius_mm + (radius_mm * radius_mm - square).sqrt())
                }
                ForceIndenter::Punch { radius_mm } if square < radius_mm * radius_mm => depth_mm,
                _ => f64::NEG_INFINITY,
            };
            *value = reach_mm.clamp(-window.above_mm, material.thickness_mm) as f32;
        }
    }
    let mut depth = Depth {
        penetration,
        margin_px: window.margin_px,
        touching: Rect::default(),
        deepest_mm: 0.0,
        over_thickness_px: 0,
    };
    depth.measure();
    let Some(load) = pad.press(&depth).load else { return [0.0; 3] };
    let area = load.mm_per_px[0] * load.mm_per_px[1];
    let force = area * load.pressure.data.iter().map(|p| f64::from(*p)).sum::<f64>();
    let touching = load.pressure.data.iter().filter(|p| **p > 0.0).count();
    let motion = Motion { shift_mm: [1.0, 0.0], ..Motion::default() };
    let (_, outcome) = solve_shear(ElasticLayer::new(material), &load, motion, Friction::Stick);
    [force, (area * touching as f64 / PI).sqrt(), outcome.force[0].abs()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pad(thickness_mm: f64, poisson_ratio: f64) -> Material {
        Material { thickness_mm, youngs_modulus_kpa: 1.0, poisson_ratio }
    }

    #[test]
    fn thick_pads_have_the_forces_radii_and_stiffnesses_of_hertz_sneddon_and_mindlin() {
        for nu in [0.3, 0.48] {
            for indenter in [ForceIndenter::Ball { radius_mm: 4.0 }, ForceIndenter::Punch { radius_mm: 2.0 }] {
                let [depth_mm, thickness_mm] = [0.2, 400.0];
                let [force, radius, stiffness] = solve_contact(indenter, &pad(thickness_mm, nu), depth_mm);
                let expected = half_space(indenter, nu, depth_mm);
                assert!((force / expected[0] - 1.0).abs() < 0.02, "{force} {expected:?}");
                assert!((radius / expected[1] - 1.0).abs() < 0.02, "{radius} {expected:?}");
                assert!((stiffness / expected[2] - 1.0).abs() < 0.03, "{stiffness} {expected:?}");
            }
        }
    }

    #[test]
    fn thin_pads_are_stiffer_as_their_asymptote_says_and_curves_are_smooth_and_invertible() {
        let curve = ContactCurve::new(ForceIndenter::Ball { radius_mm: 4.0 }, &pad(2.0, 0.48), 0.8);
        let mut last = [0.0; 3];
        for k in 1..=200 {
            let depth_mm = 0.004 * f64::from(k);
            let found = [curve.force(depth_mm), curve.contact_radius_mm(depth_mm), curve.shear_stiffness_mm(depth_mm)];
            assert!((0..3).all(|k| found[k] > last[k]), "{depth_mm}: {found:?} after {last:?}");
            let back = curve.depth_for_radius_mm(found[1]).expect("a contact that was solved");
            assert!((back / depth_mm - 1.0).abs() < 1e-6);
            last = found;
        }
        // Dimitriadis et al. 2002 for a bonded layer at nu 0.48: the force over Hertz's grows with sqrt(R d) / h.
        let nu: f64 = 0.48;
        let alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
        let beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
        let depth_mm = 0.02;
        let chi = (4.0_f64 * depth_mm).sqrt() / 2.0;
        let series = 1.0 - 2.0 * alpha / PI * chi + 4.0 * alpha * alpha / PI.powi(2) * chi * chi
            - 8.0 / PI.powi(3) * (alpha.powi(3) + 4.0 * PI * PI / 15.0 * beta) * chi.powi(3)
            + 16.0 * alpha / PI.powi(4) * (alpha.powi(3) + 3.0 * PI * PI / 5.0 * beta) * chi.powi(4);
        let found = curve.force(depth_mm) / half_space(curve.indenter, nu, depth_mm)[0];
        assert!((found / series - 1.0).abs() < 0.02, "{found} against {series}");
        assert!(curve.depth_for_radius_mm(3.9).is_none() && curve.force(-1.0) == 0.0 && curve.force(f64::NAN) == 0.0);
    }
}
