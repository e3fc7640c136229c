//! The content of a sample's layers, in the geometry of the image with its lens distortion. Files and Python arrays are
//! both made from it.

use std::borrow::Cow;

use serde::Serialize;

use gelsim_core::optics::lamps;
use gelsim_job::layers::OutputLayer;
use gelsim_job::sample::Sample;

/// The content of a layer, in the form that the table of layers gives. Pixels are row-major, as many as the image has;
/// the values of a pixel stand together.
pub enum LayerContent<'a> {
    /// Values of a layer of floats.
    Floats(Vec<f32>),
    /// Values of a layer of bytes.
    Bytes(Cow<'a, [u8]>),
    /// Positions of markers or pins.
    Markers(Positions),
}

/// Positions of the markers or pin tips in view, px. The centre of the first pixel is at (0.5, 0.5).
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Positions {
    /// Positions on the untouched pad.
    pub rest_px: Vec<[f64; 2]>,
    /// Positions to which the pad has carried them.
    pub moved_px: Vec<[f64; 2]>,
    /// Positions of pin tips on the untouched gel in the sensor's frame, mm; empty for markers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rest_mm: Vec<[f64; 3]>,
    /// Positions of pin tips now in the sensor's frame, mm; empty for markers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub moved_mm: Vec<[f64; 3]>,
}

/// Returns the content of the layer `layer` of a sample.
pub fn layer_content<'a>(sample: &'a Sample, layer: OutputLayer) -> LayerContent<'a> {
    let impression = &sample.impression;
    match layer {
        OutputLayer::Depth => LayerContent::Floats(impression.depth_mm()),
        OutputLayer::Surface => LayerContent::Floats(impression.surface_mm()),
        OutputLayer::Normal => LayerContent::Floats(impression.normals().into_flattened()),
        OutputLayer::Pressure => {
            // No job asks for pressure from a model without it. Where models are exchanged for comparison it may be
            // missing.
            let none = || vec![0.0; impression.image.width * impression.image.height];
            LayerContent::Floats(impression.pressure_kpa().unwrap_or_else(none))
        }
        OutputLayer::Gap => LayerContent::Floats(impression.gap_mm()),
        OutputLayer::Lamps => {
            let planes = impression.lamps();
            let pixels = impression.image.width * impression.image.height;
            // No job asks for lamps on a sensor without them.
            let pixel = |at: usize| (0..lamps::LAMP_COUNT).map(move |k| (k, at));
            let value = |(k, at): (usize, usize)| planes.get(k).map_or(0.0, |plane: &Vec<f32>| plane[at]);
            LayerContent::Floats((0..pixels).flat_map(pixel).map(value).collect())
        }
        OutputLayer::Traction => {
            let none = || vec![[0.0; 3]; impression.image.width * impression.image.height];
            LayerContent::Floats(impression.traction_kpa().unwrap_or_else(none).into_flattened())
        }
        OutputLayer::Flow => LayerContent::Floats(impression.flow_mm().into_flattened()),
        OutputLayer::Points => LayerContent::Floats(impression.points_mm().into_flattened()),
        OutputLayer::Slip => LayerContent::Bytes(impression.slip().into()),
        OutputLayer::Instance => LayerContent::Bytes(sample.instance_map().into()),
        OutputLayer::Contact => LayerContent::Bytes(impression.contact_mask().into()),
        OutputLayer::Reference => LayerContent::Bytes((&sample.simulator.untouched().rgb).into()),
        OutputLayer::Untouched => LayerContent::Bytes(sample.simulator.untouched_beside(impression).rgb.into()),
        OutputLayer::Markers => {
            let (rest_px, moved_px) = impression.marker_positions().into_iter().unzip();
            LayerContent::Markers(Positions { rest_px, moved_px, ..Positions::default() })
        }
        OutputLayer::Pins => {
            let mut tips = Positions::default();
            let size = [impression.image.width, impression.image.height];
            for (rest, moved) in impression.pins.iter().flat_map(|pins| pins.in_view(size)) {
                // A tip that the camera cannot see has no position in the image.
                let [Some(rest_px), Some(moved_px)] = [rest.px, moved.px] else { continue };
                tips.rest_px.push(rest_px);
                tips.moved_px.push(moved_px);
                tips.rest_mm.push(rest.at_mm.to_array());
                tips.moved_mm.push(moved.at_mm.to_array());
            }
            LayerContent::Markers(tips)
        }
    }
}
