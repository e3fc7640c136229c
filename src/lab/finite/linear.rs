//! The same press by the elastic layer of the fidelity level `reference`.

use super::profile::Profile;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::{SURFACE_BORDER, View};
use gelsim_core::depth::rest::{RestSurface, drop_mm, lower};
use gelsim_core::depth::{Depth, Window};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::elastic::model_error::curvature_error_mm;
use gelsim_core::gelpad::{Contact, Pad};
use gelsim_core::sensor::Sensor;

/// A press with the object's axis in the middle of a view.
pub struct Linear {
    /// What the layer makes of it.
    pub contact: Contact,
    /// The view: as fine as the sensor's, as wide as asked.
    pub view: View,
    /// Error that the label would state, um.
    pub stated_um: Option<f64>,
}

/// Presses a body `depth_mm` into a sensor's pad, seen up to `radius_mm` from its axis.
pub fn press(sensor: &Sensor, object: &Profile, depth_mm: f64, radius_mm: f64) -> Linear {
    let mm_per_px = sensor.view().mm_per_px;
    let view = View { resolution_px: mm_per_px.map(|pitch| 2 * (radius_mm / pitch).ceil() as usize + 1), mm_per_px };
    let pad = Pad::new(&Fidelity::Reference.models(sensor.light_source()).gelpad, &sensor.gelpad, &view);
    let drop = sensor.rest_surface.as_ref().map(|shape: &RestSurface| drop_mm(shape, &view));
    let mut window = pad.window(depth_mm);
    let contact = loop {
        let mut depth = captured(object, depth_mm, &view, window);
        if let Some(drop) = &drop {
            lower(&mut depth, drop, window.above_mm);
        }
        depth.measure();
        let contact = pad.press(&depth);
        match pad.higher(window, &contact) {
            Some(higher) => window = higher,
            None => break contact,
        }
    };
    let curved_mm = drop.map_or(0.0, |drop| curvature_error_mm(depth_mm, &contact.mask, &drop, mm_per_px));
    let stated_um = contact.numerics.model_error_um.ok().map(|um| um + 1e3 * curved_mm);
    Linear { contact, view, stated_um }
}

/// What [`gelsim_core::depth::capture`] would give of the body.
fn captured(object: &Profile, depth_mm: f64, view: &View, window: Window) -> Depth {
    let margin = window.margin_px;
    let [width, height] = view.resolution_px.map(|px| px + 2 * margin);
    let mut penetration = Grid::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let centre = |at: usize| at as f64 + 0.5 - margin as f64;
            let [along, across] = view.point_mm([centre(x), centre(y)]);
            let mm = depth_mm - object.height(libm::hypot(along, across));
            penetration.row_mut(y)[x] = mm.max(-window.above_mm) as f32;
        }
    }
    Depth { penetration, margin_px: margin, ..Depth::clear(view) }
}

/// Values at the pixels of a surface in a view, from those at radii.
pub fn around(view: &View, border: usize, of: impl Fn(f64) -> f64) -> Grid<f32> {
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

/// As wide as a surface is beyond its view.
pub const BORDER: usize = SURFACE_BORDER;
