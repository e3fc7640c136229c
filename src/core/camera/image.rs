//! The image that a camera gives: 8 bits per channel.

use crate::base::grid::Rect;
use crate::base::light::Light;
use crate::base::light::quantise;
use crate::base::simd::simd_dispatch;

/// An 8-bit RGB image, and how many of its pixels are at their limits.
#[derive(Clone, Debug)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major RGB.
    pub rgb: Vec<u8>,
    /// Pixels with a channel that was below 0 or above full scale and was clipped.
    pub clipped_px: u64,
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
    /// False if the light was NaN or infinite somewhere.
    pub finite: bool,
}

impl Image {
    /// Makes a black image.
    pub fn black(width: usize, height: usize) -> Self {
        Self { width, height, rgb: vec![0; 3 * width * height], clipped_px: 0, saturated_px: 0, finite: true }
    }

    /// Rounds light to 8 bits and writes it over its region of the image.
    pub fn quantise(&mut self, light: &Light) {
        simd_dispatch(
            #[inline(always)]
            || {
                // Pixels that are about to be overwritten no longer count.
                if self.saturated_px > 0 {
                    self.saturated_px -= self.count_saturated_pixels(light.region);
                }
                quantise_region(light, self);
            },
        );
    }

    /// Makes a pixel white if the mean of its channels is at least `threshold` of full scale, and black if not. A
    /// threshold of 0 changes nothing.
    pub(crate) fn binarise(&mut self, threshold: f64) {
        if threshold <= 0.0 {
            return;
        }
        let least = threshold * 3.0 * 255.0;
        self.saturated_px = 0;
        for pixel in self.rgb.chunks_exact_mut(3) {
            let white = pixel.iter().map(|value| f64::from(*value)).sum::<f64>() >= least;
            pixel.fill(if white { 255 } else { 0 });
            self.saturated_px += u64::from(white);
        }
    }

    /// Counts the pixels of a part that have a channel at full scale.
    #[inline(always)]
    fn count_saturated_pixels(&self, part: Rect) -> u64 {
        let mut count = 0;
        for y in part.y0..part.y1 {
            let row = &self.rgb[(y * self.width + part.x0) * 3..][..part.width() * 3];
            let saturated = row.chunks_exact(3).map(|pixel| u32::from(pixel[0].max(pixel[1]).max(pixel[2]) == 255));
            count += u64::from(saturated.sum::<u32>());
        }
        count
    }
}

/// Rounds light to 8 bits row by row, and counts what was clipped, saturated or not finite.
#[inline(always)]
fn quantise_region(light: &Light, image: &mut Image) {
    let Rect { x0, y0, .. } = light.region;
    let width = light.region.width();
    let mut pixels = vec![0; width];
    for row in 0..light.region.height() {
        let [red, green, blue] = light.planes.each_ref().map(|plane| &plane[row * width..][..width]);
        let (mut clipped, mut not_finite, mut saturated) = (0_u32, 0_u32, 0_u32);
        for x in 0..width {
            let (low, high) = (red[x].min(green[x]).min(blue[x]), red[x].max(green[x]).max(blue[x]));
            clipped += u32::from((low < 0.0) | (high > 1.0));
            // A finite number times 0 is 0; infinity or NaN times 0 is NaN.
            not_finite += u32::from((red[x] + green[x] + blue[x]) * 0.0 != 0.0);
            let [red, green, blue] = [red[x], green[x], blue[x]].map(|brightness| u32::from(quantise(brightness)));
            saturated += u32::from((red == 255) | (green == 255) | (blue == 255));
            pixels[x] = red | green << 8 | blue << 16;
        }
        image.clipped_px += u64::from(clipped);
        image.finite &= not_finite == 0;

        pack_rgb(&pixels, &mut image.rgb[((y0 + row) * image.width + x0) * 3..][..width * 3]);
        image.saturated_px += u64::from(saturated);
    }
}

/// Writes the low three bytes of each number.
#[inline(always)]
fn pack_rgb(pixels: &[u32], rgb: &mut [u8]) {
    // Four pixels fill three words.
    let (fours, rest) = pixels.as_chunks::<4>();
    let (words, last) = rgb.split_at_mut(12 * fours.len());
    for ([a, b, c, d], words) in fours.iter().zip(words.as_chunks_mut::<12>().0) {
        let joined = [a | b << 24, b >> 8 | c << 16, c >> 16 | d << 8];
        words.as_chunks_mut().0.iter_mut().zip(joined).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
    }
    for (pixel, bytes) in rest.iter().zip(last.as_chunks_mut::<3>().0) {
        bytes.copy_from_slice(&pixel.to_le_bytes()[..3]);
    }
}
