//! What of the model of a flat layer is corrected on a gel with a curved core, and the wrench of a press: of the pressure on its chart.

use glam::{DVec2, DVec3};

use super::Curved;
use crate::base::chart::Chart;
use crate::base::site::Rest;
use crate::depth::Depth;
use crate::gelpad::Contact;
use crate::gelpad::elastic::inplane::Load;
use crate::gelpad::elastic::model_error::{ContactEdge, error_on_core_mm, force_on_core};
use crate::gelpad::material::Material;
use crate::gelpad::sliding::Wrench;

/// A contact's radius over its area per perimeter, at most: a disc's is 2.
const WIDEST: f64 = 3.0;

/// Variance of a round contact's pressure along an axis, as a share of its radius squared: 1 / 5 on a half-space, 1 / 6 on a
/// layer much thinner than the contact is wide.
const SPREAD: f64 = 1.0 / 5.5;

/// Where the gel is pressed.
pub(super) struct Pressed<'a> {
    chart: &'a Chart,
    mm_per_px: [f64; 2],
    nodes: Vec<Node>,
}

/// A pressed node of a chart.
struct Node {
    at: DVec2,
    /// Over Young's modulus.
    pressure: f64,
    rest: Rest,
    /// Area on the gel of a mm^2 of the chart.
    area: f64,
}

impl<'a> Pressed<'a> {
    /// By a pressure on a chart.
    pub fn new(load: &Load, chart: &'a Chart) -> Self {
        let mut nodes = Vec::new();
        for y in 0..load.pressure.height {
            for (x, pressure) in load.pressure.row(y).iter().enumerate().filter(|(_, pressure)| **pressure > 0.0) {
                let px = [x, y];
                let at = [0, 1].map(|k| load.origin_mm[k] + px[k] as f64 * load.mm_per_px[k]);
                let (rest, area) = chart.rest_and_area(at);
                nodes.push(Node { at: at.into(), pressure: f64::from(*pressure), rest, area });
            }
        }
        Self { chart, mm_per_px: load.mm_per_px, nodes }
    }

    /// Radius of the contact, mm, or half the width of a long one; and the mean curvature of the gel there, per mm, half of how
    /// its normals part. By the pressure, which is nothing at the contact's edge: neither jumps from pixel to pixel, nor where
    /// the contact goes over from a part of the gel into another.
    fn radius_and_curvature(&self) -> (f64, f64) {
        let all: f64 = self.nodes.iter().map(|node| node.pressure).sum();
        let middle = self.nodes.iter().map(|node| node.pressure * node.at).sum::<DVec2>() / all;
        let centre = self.chart.rest(middle.to_array());
        let (mut along, mut across, mut down, mut parted, mut squares) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for Node { at, pressure: p, rest, .. } in &self.nodes {
            let [x, y] = (*at - middle).to_array();
            along += p * x * x;
            across += p * x * y;
            down += p * y * y;
            let away = rest.point_mm - centre.point_mm;
            parted += p * (rest.normal - centre.normal).dot(away);
            squares += p * away.length_squared();
        }
        // The smaller of the variances along the contact's own axes.
        let half = 0.5 * (along + down);
        let least = (half - libm::hypot(0.5 * (along - down), across)).max(0.0) / all;
        let curvature_per_mm = if squares > 0.0 { parted / squares } else { 0.0 };
        (libm::sqrt(least / SPREAD), curvature_per_mm)
    }

    /// Force and moment about the gel's tip, N and N mm, of the pressure on a gel so many times as stiff as it was taken to be.
    fn force_and_torque(&self, youngs_modulus_kpa: f64, stiffened: f64) -> (DVec3, DVec3) {
        // kPa mm^2 are mN.
        let per_node = 1e-3 * youngs_modulus_kpa * stiffened * self.mm_per_px[0] * self.mm_per_px[1];
        let (mut force, mut torque) = (DVec3::ZERO, DVec3::ZERO);
        for Node { pressure, rest, area, .. } in &self.nodes {
            let here = pressure * per_node * area * -rest.normal;
            force += here;
            torque += rest.point_mm.cross(here);
        }
        (force, torque)
    }
}

impl Curved {
    /// Corrects forces and the error that the model states for the core under the gel, which is curved as the gel is.
    pub(super) fn on_core(&self, contact: &mut Contact, depth: &Depth, pressed: &Pressed<'_>, material: &Material) {
        if pressed.nodes.is_empty() {
            return;
        }
        let (radius_mm, curvature_per_mm) = pressed.radius_and_curvature();
        // Of many small contacts each is as wide as it is, whatever they are spread over.
        let edge = ContactEdge::of(&contact.mask, &depth.penetration, depth.margin_px, self.view.mm_per_px);
        let radius_mm = edge.map_or(radius_mm, |edge| radius_mm.min(WIDEST * edge.area_over_perimeter_mm));
        contact.stiffen(force_on_core(radius_mm, curvature_per_mm, material.thickness_mm, material.poisson_ratio));
        if let Ok(error_um) = contact.numerics.model_error_um.as_mut() {
            let turn_rad = radius_mm * curvature_per_mm.abs();
            *error_um = 1e3 * error_on_core_mm(1e-3 * *error_um, f64::from(depth.deepest_mm), turn_rad);
        }
    }
}

/// What the object does to the gel, if the pressure is known: in the sensor's frame, about the gel's tip. Tractions are moved
/// about a point of the chart.
pub(super) fn wrench(
    contact: &Contact,
    pressed: Option<&Pressed<'_>>,
    about_mm: [f64; 2],
    youngs_modulus_kpa: f64,
) -> Option<Wrench> {
    contact.force_n?;
    let Some(pressed) = pressed else { return Some(Wrench::default()) };
    let (mut force, mut torque) = pressed.force_and_torque(youngs_modulus_kpa, contact.stiffened);
    // Tractions in the chart's plane, where the object was moved.
    if let Some(shear) = contact.tangential.as_ref().and_then(|tangential| tangential.shear.as_ref()) {
        let newtons = 1e-3 * youngs_modulus_kpa;
        let about = pressed.chart.rest(about_mm);
        let [along, down] = about.tangents;
        let pulled = newtons * (shear.force[0] * along + shear.force[1] * down);
        force += pulled;
        torque += about.point_mm.cross(pulled) + newtons * shear.moment * about.normal;
    }
    Some(Wrench { force_n: force.to_array(), torque_nmm: torque.to_array() })
}
