//! What the layers of a sample hold, in the image's geometry: lens distortion included. Files and Python's arrays are both
//! made from this.

use std::borrow::Cow;

use serde::Serialize;

use gelsim_core::optics::lamps;
use gelsim_job::layers::OutputLayer;
use gelsim_job::sample::Sample;

/// What one layer holds, in the form that its row says. Pixels are row-major, as many as the image has; the values of a
/// pixel stand together.
pub enum Content<'a> {
    /// Of a layer of floats.
    Floats(Vec<f32>),
    /// Of a layer of bytes.
    Bytes(Cow<'a, [u8]>),
    /// The markers.
    Markers(Positions),
}

/// Markers in view, px: the first pixel's centre is at (0.5, 0.5).
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Positions {
    /// Where each was printed.
    pub rest_px: Vec<[f64; 2]>,
    /// Where the pad carried it.
    pub moved_px: Vec<[f64; 2]>,
    /// Of the tips of pins also in the sensor's frame, mm.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rest_mm: Vec<[f64; 3]>,
    /// The same now.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub moved_mm: Vec<[f64; 3]>,
}

/// What `layer` of a sample holds.
pub fn content<'a>(sample: &'a Sample, layer: OutputLayer) -> Content<'a> {
    let impression = &sample.impression;
    match layer {
        OutputLayer::Depth => Content::Floats(impression.depth_mm()),
        OutputLayer::Surface => Content::Floats(impression.surface_mm()),
        OutputLayer::Normal => Content::Floats(impression.normals().into_flattened()),
        OutputLayer::Pressure => {
            // No job asks a model for pressure that knows none; where models are exchanged to compare them, there is none.
            let none = || vec![0.0; impression.image.width * impression.image.height];
            Content::Floats(impression.pressure_kpa().unwrap_or_else(none))
        }
        OutputLayer::Gap => Content::Floats(impression.gap_mm()),
        OutputLayer::Lamps => {
            let planes = impression.lamps();
            let pixels = impression.image.width * impression.image.height;
            // No job asks a sensor without lamps for them.
            let pixel = |at: usize| (0..lamps::COUNT).map(move |k| (k, at));
            let value = |(k, at): (usize, usize)| planes.get(k).map_or(0.0, |plane: &Vec<f32>| plane[at]);
            Content::Floats((0..pixels).flat_map(pixel).map(value).collect())
        }
        OutputLayer::Flow => Content::Floats(impression.flow_mm().into_flattened()),
        OutputLayer::Points => Content::Floats(impression.points_mm().into_flattened()),
        OutputLayer::Slip => Content::Bytes(impression.slip().into()),
        OutputLayer::Instance => Content::Bytes(sample.instances().into()),
        OutputLayer::Contact => Content::Bytes(impression.contact_mask().into()),
        OutputLayer::Reference => Content::Bytes((&sample.simulator.untouched().rgb).into()),
        OutputLayer::Untouched => Content::Bytes(sample.simulator.untouched_beside(impression).rgb.into()),
        OutputLayer::Markers => {
            let (rest_px, moved_px) = impression.marker_positions().into_iter().unzip();
            Content::Markers(Positions { rest_px, moved_px, ..Positions::default() })
        }
        OutputLayer::Pins => {
            let mut tips = Positions::default();
            let size = [impression.image.width, impression.image.height];
            for (rest, moved) in impression.pins.iter().flat_map(|pins| pins.in_view(size)) {
                // What the camera cannot see has no place in the image.
                let [Some(rest_px), Some(moved_px)] = [rest.px, moved.px] else { continue };
                tips.rest_px.push(rest_px);
                tips.moved_px.push(moved_px);
                tips.rest_mm.push(rest.at_mm.to_array());
                tips.moved_mm.push(moved.at_mm.to_array());
            }
            Content::Markers(tips)
        }
    }
}
