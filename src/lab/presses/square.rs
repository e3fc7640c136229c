//! Resamples images whose pixels are not square: a disc is then a circle in them, which is what a calibration takes it
//! for.

use gelsim_files::diagnostic::Diagnostic;
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::{Circle, PressTable};

/// Largest ratio of the sides of a pixel.
pub const MAX_RATIO: f64 = 4.0;

/// The way from images of one size and pixel size to square pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquarePixels {
    from_px: [u32; 2],
    to_px: [u32; 2],
    mm_per_px: f64,
    /// Sides of a resampled pixel, in columns and rows of the image.
    step: [f64; 2],
}

impl SquarePixels {
    /// Returns the way to pixels as small as the smaller side, so that nothing is lost; `None` for pixels that are
    /// square, or too long. A rest of less than half a pixel is added or cut off at the borders, half of it at each.
    pub fn new((width, height): (u32, u32), mm_per_px: [f64; 2]) -> Option<Self> {
        let from_px = [width, height];
        let finest = mm_per_px[0].min(mm_per_px[1]);
        let step = mm_per_px.map(|mm| finest / mm);
        let to_px = [0, 1].map(|k| libm::round(f64::from(from_px[k]) / step[k]) as u32);
        let is_needed = step != [1.0; 2] && step[0].min(step[1]) >= 1.0 / MAX_RATIO;
        is_needed.then_some(Self { from_px, to_px, mm_per_px: finest, step })
    }

    /// Says what is done, and what the user has to do likewise.
    pub fn to_note(&self) -> Diagnostic {
        let [[width, height], [to_width, to_height]] = [self.from_px, self.to_px];
        let [x, y] = self.step.map(|step| self.mm_per_px / step);
        let message = format!(
            "pixels of {x} x {y} mm are not square: images are resampled from {width}x{height} px to \
             {to_width}x{to_height} px of {} mm, and the sensor is of this size",
            self.mm_per_px
        );
        let help = format!("resize real images to {to_width}x{to_height} px, too, before you compare or mix them");
        Diagnostic::note(message).help(help)
    }

    /// Resamples the images of a table, and moves its circles. Images of another size stay as they are.
    pub fn resample_presses(&self, table: &mut PressTable, images: &mut [Result<RgbImage, String>]) {
        for press in &mut table.presses {
            press.circle = press.circle.map(|circle| self.move_circle(circle));
            press.mm_per_px = press.mm_per_px.map(|_| [self.mm_per_px; 2]);
        }
        let of_size = images.par_iter_mut().filter_map(|image| image.as_mut().ok());
        of_size.filter(|image| image.dimensions() == self.from_px.into()).for_each(|image| {
            *image = self.resample_image(image);
        });
    }

    /// Resamples an image of the size, linearly.
    pub fn resample_image(&self, image: &RgbImage) -> RgbImage {
        // One axis keeps its pixels, where both weights are of one column or row.
        let near = |k: usize, to: u32| {
            let last = self.from_px[k] - 1;
            let at = (f64::from(to) + 0.5 - 0.5 * f64::from(self.to_px[k])) * self.step[k];
            let at = (at + 0.5 * f64::from(self.from_px[k]) - 0.5).clamp(0.0, f64::from(last));
            let first = at as u32;
            (first, (first + 1).min(last), at - f64::from(first))
        };
        RgbImage::from_fn(self.to_px[0], self.to_px[1], |x, y| {
            let ((left, right, across), (top, bottom, down)) = (near(0, x), near(1, y));
            let level = |x: u32, y: u32, channel: usize| f64::from(image.get_pixel(x, y).0[channel]);
            Rgb(std::array::from_fn(|channel| {
                let row = |y: u32| (1.0 - across) * level(left, y, channel) + across * level(right, y, channel);
                libm::round((1.0 - down) * row(top) + down * row(bottom)) as u8
            }))
        })
    }

    /// Returns a circle, whose radius is counted in columns, in the resampled image.
    fn move_circle(&self, circle: Circle) -> Circle {
        let place = |k: usize| {
            let from_middle = circle.centre_px[k] + 0.5 - 0.5 * f64::from(self.from_px[k]);
            from_middle / self.step[k] + 0.5 * f64::from(self.to_px[k]) - 0.5
        };
        Circle { centre_px: [place(0), place(1)], radius_px: circle.radius_px / self.step[0] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ellipse_becomes_the_circle_that_it_is_on_the_pad() {
        // Pixels of 0.1 mm by 0.15 mm and the other way round.
        for (mm_per_px, to_px) in [([0.1, 0.15], [60, 90]), ([0.15, 0.1], [90, 60])] {
            let square = SquarePixels::new((60, 60), mm_per_px).expect("not square");
            assert_eq!(square.to_px, to_px);
            let circle = Circle { centre_px: [25.0, 33.0], radius_px: 1.5 / mm_per_px[0] };
            let image = RgbImage::from_fn(60, 60, |x, y| {
                let [across, down] = [f64::from(x) - 25.0, f64::from(y) - 33.0];
                let is_in = (across * mm_per_px[0]).hypot(down * mm_per_px[1]) < 1.5;
                Rgb([if is_in { 200 } else { 0 }; 3])
            });
            let (resampled, moved) = (square.resample_image(&image), square.move_circle(circle));
            assert!((moved.radius_px - 15.0).abs() < 1e-9, "{moved:?}");
            for (x, y, pixel) in resampled.enumerate_pixels() {
                let away = (f64::from(x) - moved.centre_px[0]).hypot(f64::from(y) - moved.centre_px[1]);
                let expected = if away < moved.radius_px { 200 } else { 0 };
                assert!((away - moved.radius_px).abs() < 1.6 || pixel.0[0] == expected, "{x}, {y}: {pixel:?}");
            }
        }
        assert_eq!(SquarePixels::new((60, 60), [0.1; 2]), None);
    }
}
