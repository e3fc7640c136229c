//! What a label says of the contact, of the markers that it moved and of how well it was solved.

use gelsim_core::simulator::Stages;
use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::elastic::LARGEST_STRAIN;
use gelsim_core::impression::Impression;

use super::share::Share;

/// The contact, as far as it is in view. Without contact every number is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContactLabel {
    /// True if any pixel in view touches.
    pub in_contact: bool,
    /// Area that touches, mm^2.
    pub area_mm2: f64,
    /// Share of the view that touches.
    pub fraction: f64,
    /// Mean position of the pixels that touch, mm from the middle of the image; on a gel that is not flat from its axis.
    pub centroid_mm: [f64; 2],
    /// Mean position of the pixels of the contact layer, px: the first pixel's centre is at (0.5, 0.5).
    #[serde(default)]
    pub centroid_px: [f64; 2],
    /// Radius of a disc of that area, mm.
    #[serde(default)]
    pub equivalent_radius_mm: f64,
    /// Radius of a disc of as many pixels as the contact layer has, px.
    #[serde(default)]
    pub equivalent_radius_px: f64,
    /// Smallest box around them, px: x0, y0, x1, y1, half open.
    pub bbox_px: [u32; 4],
    /// Largest depth of the object below the undeformed pad, mm.
    pub max_depth_mm: f64,
    /// Normal force in view, N; null if the model knows none, or something that is not known decides it.
    pub force_n: Option<f64>,
    /// Normal force of the whole object, in view and beyond, N; null if it is not known.
    #[serde(default)]
    pub total_force_n: Option<f64>,
    /// Why one of these forces is null; empty if both are known.
    #[serde(default)]
    pub force_unknown: String,
    /// True if the object touches the pad beyond the view, too. Of a depth frame: if it touches the pad at the frame's border.
    #[serde(default)]
    pub cut_by_view: bool,
    /// Share of the area in which the object touches the pad that is in view, 0 to 1; null for a depth frame, of which
    /// nothing is known beyond the view.
    #[serde(default)]
    pub in_view_fraction: Option<f64>,
    /// Largest pressure, kPa; null if the model knows none.
    pub peak_pressure_kpa: Option<f64>,
    /// Force of the object on a gel that is not flat, in the sensor's frame, N; empty on a flat pad, whose normal force is
    /// along -z.
    #[serde(default)]
    pub force_vector_n: Vec<f64>,
    /// Its moment about the gel's tip, N mm; empty likewise.
    #[serde(default)]
    pub torque_nmm: Vec<f64>,
}

/// How well the gelpad model solved its problem, and how far the light is from what was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NumericsLabel {
    /// True if its tolerance was reached; also for models without iteration.
    pub converged: bool,
    /// Iterations.
    pub iterations: u32,
    /// Largest violation of the contact conditions in the image, um; null if the model has none.
    pub residual_um: Option<f64>,
    /// Indentation depth over pad thickness.
    pub strain: f64,
    /// True if the strain is over 0.5, where the linear theory of the elastic pad has ended.
    pub beyond_theory: bool,
    /// Largest error of the surface within 2 mm of the contact that the model's linear theory is expected to have,
    /// um, within a factor of two, or of 2.5 for most contacts that stick; 0 if no edge of a contact is in view, null if it is not known.
    pub model_error_um: Option<f64>,
    /// Why `model_error_um` is null; empty if it is known.
    #[serde(default)]
    pub model_error_unknown: String,
    /// Share of the pixels in contact whose slope or displacement lies beyond the presses that the sensor's optics were
    /// calibrated on, 0 to 1; 0 without contact and where the optics are not calibrated.
    #[serde(default)]
    pub light_outside_range: f64,
}

/// The pad's markers, or the pins inside it, as far as they are in view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MarkersLabel {
    /// How many there are.
    pub count: u32,
    /// Mean distance from where they rest, px.
    pub mean_motion_px: f64,
    /// Largest distance from where they rest, px.
    pub max_motion_px: f64,
}

impl ContactLabel {
    pub(super) fn of(impression: &Impression, whole: &Share, view: &View) -> Self {
        let (contact, [width, height]) = (&impression.contact, view.resolution_px);
        Self {
            in_contact: whole.pixels > 0,
            area_mm2: whole.area_mm2,
            fraction: whole.pixels as f64 / (width * height) as f64,
            centroid_mm: whole.centroid_mm,
            centroid_px: whole.in_image.centroid_px,
            equivalent_radius_mm: libm::sqrt(whole.area_mm2 / PI),
            equivalent_radius_px: libm::sqrt(whole.in_image.pixels as f64 / PI),
            bbox_px: whole.bbox_px,
            max_depth_mm: if whole.pixels > 0 { f64::from(impression.depth.deepest_mm) } else { 0.0 },
            force_n: contact.force_n,
            total_force_n: contact.total.total_force_n,
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
    pub(super) fn of(plan: &Plan, scene: &Scene, contact: &Contact, thickness_mm: f64) -> Self {
        Self {
            converged: contact.numerics.converged,
            iterations: contact.numerics.iterations,
            residual_um: contact.numerics.residual_um,
            strain: scene.deepest_mm() / thickness_mm,
            beyond_theory: scene.deepest_mm() > LARGEST_STRAIN * thickness_mm,
            model_error_um: contact.numerics.model_error_um.ok(),
            model_error_unknown: contact.numerics.model_error_um.err().unwrap_or_default().to_owned(),
            light_outside_range: plan.simulator.shader().share_beyond(contact),
        }
    }
}

impl MarkersLabel {
    pub(super) fn of(impression: &Impression, view: &View) -> Self {
        let Impression { markers, pins, lens, .. } = impression;
        match (markers, pins) {
            (Some(markers), _) => Self::between(markers.in_view(lens.as_ref(), view.resolution_px)),
            (None, Some(pins)) => {
                let places = pins.in_view(view.resolution_px);
                Self::between(places.filter_map(|(rest, moved)| rest.px.zip(moved.px)))
            }
            (None, None) => Self::default(),
        }
    }

    /// Of places at rest and now, px.
    fn between(places: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> Self {
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
