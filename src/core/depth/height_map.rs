//! An object that is known as heights over the pad instead of as a mesh and its pose: a simulator's depth frame, an
//! array.

use crate::base::grid::Grid;

/// Heights over the undeformed pad at the pixels of a view.
#[derive(Clone, Debug)]
pub struct HeightMap {
    /// Height over the undeformed pad at each pixel of the view, mm, negative below it; infinite where there is no
    /// object, never NaN.
    pub above_mm: Grid<f32>,
    /// Pixels of the view where nothing is known, such as those that a depth camera could not see.
    pub unseen_px: u64,
}

impl HeightMap {
    /// Returns how deep the lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub fn indentation_depth_mm(&self) -> f64 {
        let lowest = self.above_mm.data.iter().fold(0.0_f32, |lowest, mm| lowest.min(*mm));
        f64::from(0.0 - lowest)
    }
}
