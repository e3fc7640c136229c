//! From object to depth map: how far the object reaches below the undeformed pad, at every pixel centre.
//!
//! Orthographic and exact: the value at a pixel is the lowest point of the object's triangles on the line through the
//! pixel's centre. Rays would give the same (they are the oracle in the tests); rasterising the triangles that a
//! bounding-volume query finds above the window is 8 to 25 times quicker and leaves no hole.

use crate::grid::Grid;
use crate::object::clusters::Clusters;

pub mod raster;

use raster::{View, Window};

/// The depth map of a press.
#[derive(Clone, Debug)]
pub struct Depth {
    /// mm below the undeformed pad surface, 0 where the object does not reach it; the view and a margin around it.
    pub overlap: Grid<f32>,
    /// Pixels around the view on every side.
    pub margin_px: usize,
    /// Pixels in view where the object would go through the shell and was limited to the pad's thickness.
    pub over_thickness_px: u64,
}

/// What the camera sees of the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Width and height of the view, px.
    pub resolution_px: [usize; 2],
    /// Distance between pixel centres along x and y, mm.
    pub mm_per_px: [f64; 2],
}

/// Where an object is: `sensor = rotation * object + translation`, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rows of the rotation matrix.
    pub rotation: [[f64; 3]; 3],
    /// In the sensor's frame, mm.
    pub translation_mm: [f64; 3],
}

/// Captures `object` at `placement`, `margin_px` beyond the view, limited to a pad of `thickness_mm`.
pub fn capture(
    object: &Clusters,
    placement: &Placement,
    camera: &Camera,
    margin_px: usize,
    thickness_mm: f64,
) -> Depth {
    let [width, height] = camera.resolution_px;
    let window = Window { width: width + 2 * margin_px, height: height + 2 * margin_px };
    let view = View::new(placement, camera, margin_px, object.centre_mm());
    let mut overlap = Grid::new(window.width, window.height);
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || raster::raster(object, &view, window, &mut overlap),
    );

    // The raster holds heights over the pad, cut at 0: the overlap is what is below.
    let thickness = thickness_mm as f32;
    let mut over_thickness_px = 0;
    for (y, row) in overlap.data.chunks_exact_mut(window.width).enumerate() {
        let in_view = (margin_px..margin_px + height).contains(&y);
        let mut over = 0;
        for (x, value) in row.iter_mut().enumerate() {
            let depth = 0.0 - *value;
            let visible = in_view & (x >= margin_px) & (x < margin_px + width);
            over += u64::from(visible & (depth > thickness));
            *value = depth.min(thickness);
        }
        over_thickness_px += over;
    }
    Depth { overlap, margin_px, over_thickness_px }
}
