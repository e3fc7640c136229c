//! What a frame of a depth camera gives: heights over the undeformed pad at the sensor's pixels.

use gelsim_core::base::grid::Grid;

/// Heights over the undeformed pad at each pixel of the view.
pub struct FrameHeights {
    /// The heights, mm; infinite in empty space, never NaN.
    pub above_mm: Grid<f32>,
    /// Number of pixels that the camera could not see, since they are hidden or out of the frame.
    pub unseen_px: u64,
}
