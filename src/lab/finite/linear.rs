//! The press that finite elements are compared with, by the elastic layer of the fidelity level `reference`.

use super::profile::Profile;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::{SURFACE_BORDER, View};
use gelsim_core::depth::rest_surface::{RestSurface, rest_drop_mm, subtract_drop};
use gelsim_core::depth::{CaptureWindow, Depth};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::elastic::model_error::curvature_error_mm;
use gelsim_core::gelpad::{Contact, Pad};
use gelsim_core::sensor::Sensor;

/// A press with the object's axis in the middle of a view.
pub struct LinearPress {
    /// Contact that the layer computes.
    pub contact: Contact,
    /// View: with the sensor's pixel size, and as wide as asked.
    pub view: View,
    /// Error that the label would state, um; `None` if it states none.
    pub stated_um: Option<f64>,
}

/// Presses a body `depth_mm` into a sensor's pad, in a view up to `radius_mm` from its axis.
pub fn press_linear(sensor: &Sensor, object: &Profile, depth_mm: f64, radius_mm: f64) -> LinearPress {
    let mm_per_px = sensor.view().mm_per_px;
    let view = View { resolution_px: mm_per_px.map(|mm| 2 * (radius_mm / mm).ceil() as usize + 1), mm_per_px };
    let pad = Pad::new(&Fidelity::Reference.models(sensor.light_source()).gelpad, &sensor.gelpad, &view);
    let drop = sensor.rest_surface.as_ref().map(|shape: &RestSurface| rest_drop_mm(shape, &view));
    let mut window = pad.capture_window(depth_mm);
    let contact = loop {
        let mut depth = capture_profile(object, depth_mm, &view, window);
        if let Some(drop) = &drop {
            subtract_drop(&mut depth, drop, window.above_mm);
        }
        depth.measure();
        let contact = pad.press(&depth);
        match pad.higher_window(window, &contact) {
            Some(higher) => window = higher,
            None => break contact,
        }
    };
    let curved_mm = drop.map_or(0.0, |drop| curvature_error_mm(depth_mm, &contact.mask, &drop, mm_per_px));
    let stated_um = contact.numerics.model_error_um.ok().map(|um| um + 1e3 * curved_mm);
    LinearPress { contact, view, stated_um }
}

/// Captures the body as [`gelsim_core::depth::capture_mesh`] captures a mesh.
fn capture_profile(object: &Profile, depth_mm: f64, view: &View, window: CaptureWindow) -> Depth {
    let margin = window.margin_px;
    let [width, height] = view.resolution_px.map(|px| px + 2 * margin);
    let mut penetration = Grid::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let centre = |at: usize| at as f64 + 0.5 - margin as f64;
            let [along, across] = view.point_mm([centre(x), centre(y)]);
            let mm = depth_mm - object.height_at(libm::hypot(along, across));
            penetration.row_mut(y)[x] = mm.max(-window.above_mm) as f32;
        }
    }
    Depth { penetration, margin_px: margin, ..Depth::no_contact(view) }
}

/// Samples a function of the radius at the pixels of a surface in a view, which is `border` pixels wider on every side.
pub fn grid_from_radii(view: &View, border: usize, of: impl Fn(f64) -> f64) -> Grid<f32> {
    let [width, height] = view.resolution_px.map(|px| px + 2 * border);
    let mut grid = Grid::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let centre = |at: usize| at as f64 + 0.5 - border as f64;
            let [along, across] = view.point_mm([centre(x), centre(y)]);
            grid.row_mut(y)[x] = of(libm::hypot(along, across)) as f32;
        }
    }
    grid
}

/// Pixels by which a surface is wider than its view.
pub const BORDER: usize = SURFACE_BORDER;
