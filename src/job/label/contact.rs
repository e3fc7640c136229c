//! The part of a label about the contact, the markers that it moved, and how well it was solved.

use gelsim_core::simulator::Stages;
use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::elastic::MAX_STRAIN;
use gelsim_core::gelpad::{Contact, Theory};
use gelsim_core::impression::Impression;

use super::share::ContactShare;

/// The contact, as far as it is in view. Without contact every number is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContactLabel {
    /// True if any pixel in view touches.
    pub in_contact: bool,
    /// Area in contact, mm^2.
    pub area_mm2: f64,
    /// Fraction of the view that is in contact.
    pub fraction: f64,
    /// Mean position of the pixels in contact, mm from the middle of the image; for a gel that is not flat, from its
    /// axis.
    pub centroid_mm: [f64; 2],
    /// Mean position of the pixels of the contact layer, px. The centre of the first pixel is at (0.5, 0.5).
    #[serde(default)]
    pub centroid_px: [f64; 2],
    /// Radius of a disc of the same area, mm.
    #[serde(default)]
    pub equivalent_radius_mm: f64,
    /// Radius of a disc of as many pixels as the contact layer has, px.
    #[serde(default)]
    pub equivalent_radius_px: f64,
    /// Smallest box around the pixels of the contact layer, px: x0, y0, x1, y1, half open.
    pub bbox_px: [u32; 4],
    /// Largest depth of the object below the undeformed pad, mm.
    pub max_depth_mm: f64,
    /// Normal force in view, N; null if the model has no forces, or if it depends on something unknown.
    pub force_n: Option<f64>,
    /// Normal force of the complete object, in view and beyond, N; null if it is not known.
    #[serde(default)]
    pub total_force_n: Option<f64>,
    /// Force that the complete object has at least, N: `total_force_n` where that is known, else that of the part that is
    /// known. Null if the model has no forces, or if a depth frame ends within the contact.
    #[serde(default)]
    pub total_force_at_least_n: Option<f64>,
    /// Why one of these forces is null; empty if both are known.
    #[serde(default)]
    pub force_unknown: String,
    /// True if the object also touches the pad beyond the view. For a depth frame: if it touches the pad at the frame's
    /// border.
    #[serde(default)]
    pub cut_by_view: bool,
    /// Fraction of the area of contact that is in view, 0 to 1; null for a depth frame, which shows nothing beyond the
    /// view.
    #[serde(default)]
    pub in_view_fraction: Option<f64>,
    /// Largest pressure, kPa; null if the model has no pressure.
    pub peak_pressure_kpa: Option<f64>,
    /// Force of the object on a gel that is not flat, in the sensor's frame, N; empty for a flat pad, whose normal
    /// force is along -z.
    #[serde(default)]
    pub force_vector_n: Vec<f64>,
    /// Moment of that force about the gel's tip, N mm; empty for a flat pad.
    #[serde(default)]
    pub torque_nmm: Vec<f64>,
}

/// How well the gelpad model solved its problem, and how much of the light is extrapolated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NumericsLabel {
    /// True if the tolerance was reached; also for models without iteration.
    pub converged: bool,
    /// Number of iterations.
    pub iterations: u32,
    /// Largest violation of the contact conditions in the image, um; null if the model has none.
    pub residual_um: Option<f64>,
    /// Indentation depth over pad thickness.
    pub strain: f64,
    /// True if the strain is over 0.5, beyond which the linear theory of the elastic pad does not hold.
    pub beyond_theory: bool,
    /// Expected largest error of the surface within 2 mm of the contact, um, due to linear theory, or to what is left
    /// where finite strain was solved; as a rule within a factor of two, or of 2.5 for most contacts that stick. 0 if no
    /// edge of a contact is in view, null if it is not known.
    pub model_error_um: Option<f64>,
    /// Why `model_error_um` is null; empty if it is known.
    #[serde(default)]
    pub model_error_unknown: String,
    /// The theory of elasticity by which the press was solved.
    #[serde(default)]
    pub theory: Theory,
    /// Radius by which the object's edges were rounded for the solution at finite strain, mm; 0 without it.
    #[serde(default)]
    pub opened_mm: f64,
    /// Number of iterations of the solution at finite strain; 0 without it.
    #[serde(default)]
    pub strain_iterations: u32,
    /// Largest error that the solution at finite strain left, um; 0 without it.
    #[serde(default)]
    pub strain_residual_um: f64,
    /// Fraction of the pixels in contact whose slope or displacement lies outside the presses on which the sensor's
    /// optics were calibrated, 0 to 1; 0 without contact, or if the optics are not calibrated.
    #[serde(default)]
    pub light_outside_range: f64,
    /// Expected mean error of the image within the contact and 1 mm around it due to what the model of the light leaves
    /// out, grey levels, as a rule within a factor of two; null if it is not known, else 0 without contact.
    #[serde(default)]
    pub light_error_levels: Option<f64>,
    /// Why `light_error_levels` is null; empty if it is known.
    #[serde(default)]
    pub light_error_unknown: String,
}

/// The pad's markers, or the pins inside it, as far as they are in view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MarkersLabel {
    /// Number of markers or pins.
    pub count: u32,
    /// Mean distance from their rest positions, px.
    pub mean_motion_px: f64,
    /// Largest distance from their rest positions, px.
    pub max_motion_px: f64,
}

impl ContactLabel {
    pub(super) fn from_impression(impression: &Impression, total: &ContactShare, view: &View) -> Self {
        let (contact, [width, height]) = (&impression.contact, view.resolution_px);
        Self {
            in_contact: total.pixels > 0,
            area_mm2: total.area_mm2,
            fraction: total.pixels as f64 / (width * height) as f64,
            centroid_mm: total.centroid_mm,
            centroid_px: total.in_image.centroid_px,
            equivalent_radius_mm: libm::sqrt(total.area_mm2 / PI),
            equivalent_radius_px: libm::sqrt(total.in_image.pixels as f64 / PI),
            bbox_px: total.bbox_px,
            max_depth_mm: if total.pixels > 0 { f64::from(impression.depth.deepest_mm) } else { 0.0 },
            force_n: contact.force_n,
            total_force_n: contact.total.total_force_n,
            total_force_at_least_n: contact.total.total_force_at_least_n,
            force_unknown: contact.total.force_unknown.to_owned(),
            cut_by_view: contact.total.cut_by_view,
            in_view_fraction: contact.total.in_view_fraction,
            peak_pressure_kpa: contact.peak_pressure_kpa,
            force_vector_n: impression.wrench.iter().flat_map(|wrench| wrench.force_n).collect(),
            torque_nmm: impression.wrench.iter().flat_map(|wrench| wrench.torque_nmm).collect(),
        }
    }
}

impl NumericsLabel {
    pub(super) fn from_contact(plan: &Plan, scene: &Scene, contact: &Contact, thickness_mm: f64) -> Self {
        let light_error = plan.simulator.light_error();
        let reach_mm = scene.reach_mm(plan);
        Self {
            converged: contact.numerics.converged,
            iterations: contact.numerics.iterations,
            residual_um: contact.numerics.residual_um,
            strain: reach_mm / thickness_mm,
            beyond_theory: reach_mm > MAX_STRAIN * thickness_mm,
            model_error_um: contact.numerics.model_error_um.ok(),
            model_error_unknown: contact.numerics.model_error_um.err().unwrap_or_default().to_owned(),
            theory: contact.numerics.theory,
            opened_mm: contact.numerics.opened_mm,
            strain_iterations: contact.numerics.strain_iterations,
            strain_residual_um: contact.numerics.strain_residual_um,
            light_outside_range: plan.simulator.shader().extrapolated_fraction(contact),
            light_error_levels: light_error.ok().map(|error| error.levels(contact, plan.simulator.view())),
            light_error_unknown: light_error.err().unwrap_or_default().to_owned(),
        }
    }
}

impl MarkersLabel {
    pub(super) fn from_impression(impression: &Impression, view: &View) -> Self {
        let Impression { markers, pins, lens, .. } = impression;
        match (markers, pins) {
            (Some(markers), _) => Self::from_positions(markers.in_view(lens.as_ref(), view.resolution_px)),
            (None, Some(pins)) => {
                let places = pins.in_view(view.resolution_px);
                Self::from_positions(places.filter_map(|(rest, moved)| rest.px.zip(moved.px)))
            }
            (None, None) => Self::default(),
        }
    }

    /// Makes the label from pairs of positions at rest and now, px.
    fn from_positions(places: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> Self {
        let (mut label, mut sum) = (Self::default(), 0.0);
        for (rest, moved) in places {
            let distance = libm::hypot(moved[0] - rest[0], moved[1] - rest[1]);
            label.count += 1;
            sum += distance;
            label.max_motion_px = label.max_motion_px.max(distance);
        }
        label.mean_motion_px = sum / f64::from(label.count.max(1));
        label
    }
}
