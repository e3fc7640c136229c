//! The view: the part of the pad that the image shows, and the only place that converts between pixels and millimetres.

/// The part of the pad that the image shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Width and height of the view, px.
    pub resolution_px: [usize; 2],
    /// Distance between pixel centres along x and y, mm.
    pub mm_per_px: [f64; 2],
}

impl View {
    /// Converts a point of the image to mm from the image's centre; the first pixel's centre is at (0.5, 0.5) px.
    pub fn point_mm(&self, px: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|k| (px[k] - self.resolution_px[k] as f64 / 2.0) * self.mm_per_px[k])
    }

    /// Converts a point of the pad to a point of the image; the inverse of [`View::point_mm`].
    pub fn point_px(&self, mm: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|k| mm[k] / self.mm_per_px[k] + self.resolution_px[k] as f64 / 2.0)
    }
}

/// Pixels by which the surface of the pad is wider than the view on every side, so that slopes at the image's border
/// are central differences like everywhere else.
pub const SURFACE_BORDER: usize = 1;

/// Most pixels on one side of an image.
pub const MOST_PX: usize = 8192;

/// Refuses an image without pixels, or with more than 8192 px on a side.
pub fn check_image_size([width, height]: [usize; 2]) -> Result<(), String> {
    match (1..=MOST_PX).contains(&width) && (1..=MOST_PX).contains(&height) {
        true => Ok(()),
        false => Err(format!("it says {width}x{height} px; allowed: 1 to {MOST_PX} px on a side")),
    }
}
