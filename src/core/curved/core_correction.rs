//! Corrects the model of a flat layer for a gel with a curved core, and computes a press's wrench from the pressure on
//! its chart.

use glam::{DVec2, DVec3};

use super::CurvedGel;
use crate::base::chart::Chart;
use crate::base::site::SurfaceFrame;
use crate::depth::Depth;
use crate::gelpad::Contact;
use crate::gelpad::elastic::in_plane::Load;
use crate::gelpad::elastic::model_error::{ContactEdge, error_on_core_mm, force_on_core};
use crate::gelpad::material::Material;
use crate::gelpad::sliding::Wrench;

/// Largest ratio of a contact's radius to its area per perimeter; a disc's is 2.
const MAX_RADIUS_RATIO: f64 = 3.0;

/// Variance of a round contact's pressure along an axis, as a share of its radius squared: between 1 / 5 on a
/// half-space and 1 / 6 on a layer much thinner than the contact is wide.
const PRESSURE_VARIANCE: f64 = 1.0 / 5.5;

/// The nodes of a chart where the gel is pressed.
pub(super) struct PressedNodes<'a> {
    chart: &'a Chart,
    mm_per_px: [f64; 2],
    nodes: Vec<Node>,
}

/// A pressed node of a chart.
struct Node {
    at: DVec2,
    /// Pressure, as a share of Young's modulus.
    pressure: f64,
    rest: SurfaceFrame,
    /// Area on the gel of 1 mm^2 of the chart.
    area: f64,
}

impl<'a> PressedNodes<'a> {
    /// Collects the nodes with a pressure above 0.
    pub fn new(load: &Load, chart: &'a Chart) -> Self {
        let mut nodes = Vec::new();
        for y in 0..load.pressure.height {
            for (x, pressure) in load.pressure.row(y).iter().enumerate().filter(|(_, pressure)| **pressure > 0.0) {
                let px = [x, y];
                let at = [0, 1].map(|k| load.origin_mm[k] + px[k] as f64 * load.mm_per_px[k]);
                let (rest, area) = chart.frame_and_area(at);
                nodes.push(Node { at: at.into(), pressure: f64::from(*pressure), rest, area });
            }
        }
        Self { chart, mm_per_px: load.mm_per_px, nodes }
    }

    /// Returns the contact's radius, mm (half the width of a long contact), and the gel's mean curvature there, per mm:
    /// half of how fast its normals part. Both are weighted by the pressure, which vanishes at the contact's edge. So
    /// neither jumps from pixel to pixel, nor where the contact passes from one part of the gel to another.
    fn radius_and_curvature(&self) -> (f64, f64) {
        let all: f64 = self.nodes.iter().map(|node| node.pressure).sum();
        let middle = self.nodes.iter().map(|node| node.pressure * node.at).sum::<DVec2>() / all;
        let centre = self.chart.surface_frame(middle.to_array());
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
        // The smaller variance along the contact's principal axes.
        let half = 0.5 * (along + down);
        let least = (half - libm::hypot(0.5 * (along - down), across)).max(0.0) / all;
        let curvature_per_mm = if squares > 0.0 { parted / squares } else { 0.0 };
        (libm::sqrt(least / PRESSURE_VARIANCE), curvature_per_mm)
    }

    /// Returns force and moment about the gel's tip, N and N mm, of the pressure; `stiffened` is the factor by which
    /// the gel is stiffer than in the model.
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

impl CurvedGel {
    /// Corrects the forces and the model's stated error for the core under the gel, which is curved as the gel is.
    pub(super) fn correct_for_core(
        &self,
        contact: &mut Contact,
        depth: &Depth,
        pressed: &PressedNodes<'_>,
        material: &Material,
    ) {
        if pressed.nodes.is_empty() {
            return;
        }
        let (radius_mm, curvature_per_mm) = pressed.radius_and_curvature();
        // With many small contacts, the width of one counts, not that of the area they are spread over.
        let edge = ContactEdge::from_mask(&contact.mask, &depth.penetration, depth.margin_px, self.view.mm_per_px);
        let radius_mm = edge.map_or(radius_mm, |edge| radius_mm.min(MAX_RADIUS_RATIO * edge.area_over_perimeter_mm));
        contact.scale_forces(force_on_core(radius_mm, curvature_per_mm, material.thickness_mm, material.poisson_ratio));
        if let Ok(error_um) = contact.numerics.model_error_um.as_mut() {
            let turn_rad = radius_mm * curvature_per_mm.abs();
            *error_um = 1e3 * error_on_core_mm(1e-3 * *error_um, f64::from(depth.deepest_mm), turn_rad);
        }
    }
}

/// Returns the wrench of the object on the gel in the sensor's frame about the gel's tip; `None` if the pressure is
/// unknown. `about_mm` is the point of the chart about which the object was turned.
pub(super) fn press_wrench(
    contact: &Contact,
    pressed: Option<&PressedNodes<'_>>,
    about_mm: [f64; 2],
    youngs_modulus_kpa: f64,
) -> Option<Wrench> {
    contact.force_n?;
    let Some(pressed) = pressed else { return Some(Wrench::default()) };
    let (mut force, mut torque) = pressed.force_and_torque(youngs_modulus_kpa, contact.stiffening_factor);
    // Tractions act in the chart's plane, at the point where the object was moved.
    if let Some(shear) = contact.tangential.as_ref().and_then(|tangential| tangential.shear.as_ref()) {
        let newtons = 1e-3 * youngs_modulus_kpa;
        let about = pressed.chart.surface_frame(about_mm);
        let [along, down] = about.tangents;
        let pulled = newtons * (shear.force[0] * along + shear.force[1] * down);
        force += pulled;
        torque += about.point_mm.cross(pulled) + newtons * shear.moment * about.normal;
    }
    Some(Wrench { force_n: force.to_array(), torque_nmm: torque.to_array() })
}
