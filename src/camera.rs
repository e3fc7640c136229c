//! From light to image: what the camera writes.

use crate::grid::Rect;
use crate::optics::Light;
use crate::optics::background::{Reference, quantise};

/// An 8-bit RGB image and what quantising cut.
#[derive(Clone, Debug)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major RGB.
    pub rgb: Vec<u8>,
    /// Pixels with a channel that was below 0 or above full scale and was cut.
    pub clipped_px: u64,
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
    /// True unless the light was NaN or infinite somewhere.
    pub finite: bool,
}

/// Quantises `light` over the picture of the untouched pad.
pub fn expose(light: &Light, rest: &Reference) -> Image {
    let (width, height) = (rest.width, rest.height);
    let mut image =
        Image { width, height, rgb: rest.rgb.clone(), clipped_px: 0, saturated_px: 0, finite: true };
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || quantise_region(light, &mut image),
    );
    image.saturated_px = image.rgb.chunks_exact(3).filter(|pixel| pixel.contains(&255)).count() as u64;
    image
}

#[inline(always)]
fn quantise_region(light: &Light, image: &mut Image) {
    let Rect { x0, y0, .. } = light.region;
    let width = light.region.width();
    let [red, green, blue] = &light.planes;
    for row in 0..light.region.height() {
        let rgb = &mut image.rgb[((y0 + row) * image.width + x0) * 3..][..width * 3];
        let range = row * width..(row + 1) * width;
        let (red, green, blue) = (&red[range.clone()], &green[range.clone()], &blue[range]);
        let mut clipped = 0_u32;
        let mut not_finite = 0_u32;
        for x in 0..width {
            let (low, high) = (red[x].min(green[x]).min(blue[x]), red[x].max(green[x]).max(blue[x]));
            clipped += u32::from((low < 0.0) | (high > 1.0));
            // NaN if any is NaN or infinite.
            let sum = (red[x] + green[x] + blue[x]) * 0.0;
            not_finite += u32::from(sum != 0.0);
        }
        image.clipped_px += u64::from(clipped);
        image.finite &= not_finite == 0;
        for (x, pixel) in rgb.chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&[quantise(red[x]), quantise(green[x]), quantise(blue[x])]);
        }
    }
}
