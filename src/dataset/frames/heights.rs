//! What a depth camera's frame says of the view: heights over the undeformed pad, at the sensor's pixels.

use gelsim_core::base::grid::Grid;

/// Heights over the undeformed pad, mm, at each pixel of the view; infinite where nothing is. And how many pixels the
/// camera could not see.
pub struct Heights {
    /// Never NaN.
    pub above_mm: Grid<f32>,
    /// Hidden or out of the image.
    pub unseen_px: u64,
}
