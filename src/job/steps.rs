//! Encodes depth and surface as 16-bit grey PNG in whole steps. The label gives the size of a step and the value of 0
//! mm.
//!
//! The steps depend only on the pad's thickness: 65535 of them reach from 0 to the deepest object, or from the highest
//! to the deepest surface, that [`crate::health`] accepts. Values beyond become the first or last step. Values that are
//! not finite become 0, which no finite surface becomes; the label of such a sample says that it is not healthy.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::health;
use crate::layers::{DepthFormat, LayerCoding, OutputLayer, StepScale};
use gelsim_core::base::grid::Grid;
use gelsim_files::png;

/// The step for a surface of 0 mm, in the middle of the range.
const SURFACE_ZERO: u32 = 1 << 15;

/// Scales of 16-bit layers. All values are 0 if no layer is stored so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Steps {
    /// Depth in mm is the value times this.
    pub depth_mm_per_step: f64,
    /// The surface's displacement in mm is the value less `surface_zero`, times this.
    pub surface_mm_per_step: f64,
    /// Value that stands for a surface of 0 mm.
    pub surface_zero: u32,
}

impl Steps {
    /// Returns the steps of a sample that has `layers`, for a pad `thickness_mm` thick.
    pub fn new(layers: &[OutputLayer], format: DepthFormat, thickness_mm: f64) -> Self {
        let stored =
            |scale: StepScale| layers.iter().any(|layer| layer.coding_for(format) == LayerCoding::Png16(scale));
        let bound_mm = health::max_displacement_mm(thickness_mm);
        let mut steps = Self::default();
        if stored(StepScale::Depth) {
            steps.depth_mm_per_step = bound_mm / f64::from(u16::MAX);
        }
        if stored(StepScale::Surface) {
            steps.surface_mm_per_step = bound_mm / (f64::from(u16::MAX) - f64::from(SURFACE_ZERO));
            steps.surface_zero = SURFACE_ZERO;
        }
        steps
    }

    /// Returns the millimetres per step, and the value of 0 mm.
    fn step_and_zero(&self, scale: StepScale) -> (f64, f64) {
        match scale {
            StepScale::Surface => (self.surface_mm_per_step, f64::from(self.surface_zero)),
            StepScale::Depth => (self.depth_mm_per_step, 0.0),
        }
    }

    /// Encodes values in mm, row by row. The largest error is half a step.
    pub fn encode(&self, scale: StepScale, width: usize, height: usize, plane_mm: &[f32]) -> Vec<u8> {
        let (mm_per_step, zero) = self.step_and_zero(scale);
        png::encode_steps(width, height, plane_mm, mm_per_step, zero)
    }

    /// Decodes what [`Steps::encode`] encoded, in mm.
    pub fn decode(&self, scale: StepScale, bytes: &[u8]) -> Result<Grid<f32>, String> {
        let (mm_per_step, zero) = self.step_and_zero(scale);
        png::decode_steps(bytes, mm_per_step, zero)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [OutputLayer; 2] = [OutputLayer::Depth, OutputLayer::Surface];

    #[test]
    fn all_that_is_healthy_comes_back_within_half_a_step() {
        for thickness_mm in [0.1, 3.0, 4.25, 100.0] {
            let steps = Steps::new(&BOTH, DepthFormat::Png16, thickness_mm);
            let deepest = (thickness_mm * 1.001) as f32;
            for (scale, least) in [(StepScale::Depth, 0.0), (StepScale::Surface, -deepest)] {
                let mut plane: Vec<f32> = (0..=1000).map(|k| least + (deepest - least) * k as f32 / 1000.0).collect();
                plane.extend([0.0, f32::MIN_POSITIVE, 1e-7, thickness_mm as f32, deepest]);
                let read = steps.decode(scale, &steps.encode(scale, plane.len(), 1, &plane)).expect("a PNG");
                let half = 0.5 * steps.step_and_zero(scale).0 + 1e-7 * thickness_mm;
                for (mm, read) in plane.iter().zip(&read.data) {
                    assert!((f64::from(*mm) - f64::from(*read)).abs() <= half, "{scale:?} {thickness_mm}: {mm} {read}");
                }
                assert_eq!(read.data[1001], 0.0, "nothing stays nothing");
            }
        }
    }

    #[test]
    fn what_is_beyond_becomes_the_last_step_and_what_is_no_number_becomes_0() {
        let steps = Steps::new(&BOTH, DepthFormat::Png16, 3.0);
        let plane = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -4.0, -3.003, 0.0, 3.003, 4.0, f32::MAX, f32::MIN];
        let stored = |scale| png::decode_grey16(&steps.encode(scale, plane.len(), 1, &plane)).expect("a PNG").data;
        assert_eq!(stored(StepScale::Surface), [0, 0, 0, 1, 1, 32_768, 65_535, 65_535, 65_535, 1]);
        assert_eq!(stored(StepScale::Depth), [0, 0, 0, 0, 0, 0, 65_535, 65_535, 65_535, 0]);
    }

    #[test]
    fn what_is_not_stored_so_has_no_steps() {
        let steps = |layers: &[OutputLayer], format| Steps::new(layers, format, 3.0);
        for format in [DepthFormat::Exr, DepthFormat::Npy] {
            assert_eq!(steps(&OutputLayer::ALL, format), Steps::default());
        }
        assert_eq!(steps(&[OutputLayer::Normal, OutputLayer::Contact], DepthFormat::Png16), Steps::default());
        assert_eq!(steps(&[OutputLayer::Depth], DepthFormat::Png16).surface_zero, 0);
        assert_eq!(steps(&[OutputLayer::Surface], DepthFormat::Png16).depth_mm_per_step, 0.0);
    }
}
