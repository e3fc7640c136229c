//! What a depth camera saw of something above the pad, in place of a mesh and its pose.

use crate::grid::Grid;

/// A depth frame in the sensor's view.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Name of what is seen, as labels give it.
    pub id: String,
    /// Its class; empty if nobody named one.
    pub class: String,
    /// Height over the undeformed pad at each pixel of the view, mm, negative below it; infinite where nothing is, never
    /// NaN.
    pub above_mm: Grid<f32>,
    /// Pixels of the view that the camera could not see.
    pub unseen_px: u64,
}

impl Frame {
    /// How deep the lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub fn indentation_depth_mm(&self) -> f64 {
        let lowest = self.above_mm.data.iter().fold(0.0_f32, |lowest, mm| lowest.min(*mm));
        f64::from(0.0 - lowest)
    }
}
