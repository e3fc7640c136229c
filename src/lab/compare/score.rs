//! Distances between a simulated image and the real one of the same press: over the whole image, and around the
//! contact.
//!
//! The three measures are those of [`crate::metrics::image`]. Around the contact, SSIM is the mean of the whole image's
//! map over the disc, so that windows reach over its rim.

use image::RgbImage;
use serde::Serialize;

use crate::metrics::image::{mae, masked_mean, masked_pixels, psnr_db, ssim_map, ssim_mean};
use crate::presses::Circle;
use gelsim_core::base::grid::Grid;

/// Distance of two images, or of a part of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Mean absolute difference over pixels and channels, grey levels (0 to 255).
    pub mae: f64,
    /// Peak signal-to-noise ratio, dB; None where nothing differs.
    pub psnr_db: Option<f64>,
    /// Structural similarity, 1 where nothing differs.
    pub ssim: f64,
}

/// Distances of two images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// Over all pixels.
    #[serde(rename = "whole")]
    pub full_image: Score,
    /// Over the dilated circle; None without a circle, or if it holds no pixel.
    pub contact: Option<Score>,
}

/// Compares two images; the contact is `circle` with its radius times `dilate`.
///
/// # Panics
///
/// If the sizes differ.
pub fn score_images(real: &RgbImage, sim: &RgbImage, circle: Option<&Circle>, dilate: f64) -> Scores {
    assert_eq!(real.dimensions(), sim.dimensions(), "images of two sizes");
    let (width, height) = (real.width() as usize, real.height() as usize);
    let map = ssim_map(real, sim, width, height);
    let full_image = Score { mae: mae(real, sim), psnr_db: psnr_db(real, sim), ssim: ssim_mean(&map) };
    let contact = circle.and_then(|circle| {
        let mask = disc_mask(circle, dilate, [width, height]);
        let ssim = masked_mean(&map, &mask)?;
        let (real, sim) = (masked_pixels(real, &mask), masked_pixels(sim, &mask));
        Some(Score { mae: mae(&real, &sim), psnr_db: psnr_db(&real, &sim), ssim })
    });
    Scores { full_image, contact }
}

/// 255 at the pixels whose centres are at most `dilate` radii from the circle's centre, 0 elsewhere; `size_px` is width
/// and height.
pub fn disc_mask(circle: &Circle, dilate: f64, size_px: [usize; 2]) -> Grid<u8> {
    let mut mask = Grid::new(size_px[0], size_px[1]);
    let [x, y] = circle.centre_px;
    let reach = dilate * circle.radius_px;
    for row in 0..mask.height {
        let down = row as f64 - y;
        for (column, value) in mask.row_mut(row).iter_mut().enumerate() {
            let across = column as f64 - x;
            if across * across + down * down <= reach * reach {
                *value = 255;
            }
        }
    }
    mask
}

impl Score {
    /// Means over images; PSNR over those for which it is known. None without images.
    pub fn mean<'a>(scores: impl Iterator<Item = &'a Score>) -> Option<Self> {
        let scores: Vec<&Score> = scores.collect();
        let mean = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        Some(Self {
            mae: mean(scores.iter().map(|score| score.mae).collect())?,
            psnr_db: mean(scores.iter().filter_map(|score| score.psnr_db).collect()),
            ssim: mean(scores.iter().map(|score| score.ssim).collect())?,
        })
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn circle(x: f64, y: f64, radius_px: f64) -> Circle {
        Circle { centre_px: [x, y], radius_px }
    }

    #[test]
    fn the_contact_is_the_dilated_circle_and_nothing_else() {
        let real = RgbImage::from_fn(40, 30, |x, y| Rgb([(x * 5) as u8, (y * 7) as u8, 90]));
        let mut sim = real.clone();
        // Within 1.3 x 5 px of (20, 12), on its rim, and outside it.
        for (x, y, change) in [(20, 12, 30), (23, 12, 20), (0, 0, 99), (20, 19, 99)] {
            sim.get_pixel_mut(x, y).0[2] += change;
        }
        let near = |x: i32, y: i32| f64::from((x - 20).pow(2) + (y - 12).pow(2)) <= 6.5 * 6.5;
        let pixels = (0..30).flat_map(|y| (0..40).map(move |x| (x, y))).filter(|(x, y)| near(*x, *y)).count();
        let scores = score_images(&real, &sim, Some(&circle(20.0, 12.0, 5.0)), 1.3);
        let contact = scores.contact.expect("a contact in view");
        assert!((contact.mae - 50.0 / (3 * pixels) as f64).abs() < 1e-12);
        let square = f64::from(30 * 30 + 20 * 20) / (3 * pixels) as f64;
        let expected = 10.0 * (255.0_f64 * 255.0 / square).log10();
        assert!((contact.psnr_db.expect("a difference") - expected).abs() < 1e-9);
        assert!((scores.full_image.mae - 248.0 / 3600.0).abs() < 1e-12);
        let map = ssim_map(&real, &sim, 40, 30);
        let inside: Vec<f64> = (0..1200).filter(|at| near(at % 40, at / 40)).map(|at| map.data[at as usize]).collect();
        assert!((contact.ssim - inside.iter().sum::<f64>() / inside.len() as f64).abs() < 1e-12);
        assert_eq!(scores.full_image.ssim, crate::metrics::image::ssim(&real, &sim, 40, 30));
    }

    #[test]
    fn equal_images_and_circles_out_of_view_have_no_ratio_and_no_contact() {
        let image = RgbImage::from_pixel(20, 12, Rgb([1, 2, 3]));
        let scores = score_images(&image, &image, Some(&circle(-9.0, 5.0, 6.0)), 1.3);
        assert_eq!((scores.full_image.mae, scores.full_image.psnr_db, scores.contact), (0.0, None, None));
        assert!((scores.full_image.ssim - 1.0).abs() < 1e-12);
        // A circle cut by the border, one over everything, and one between pixels.
        let pixels = |circle| disc_mask(&circle, 1.0, [20, 12]).data.iter().filter(|value| **value > 0).count();
        assert_eq!(pixels(circle(0.0, 0.0, 1.0)), 3);
        assert_eq!(pixels(circle(1e300, 0.0, 1e308)), 240);
        assert_eq!(pixels(circle(3.5, 3.5, 0.5)), 0);
    }

    #[test]
    fn means_leave_out_ratios_that_are_not_known() {
        let scores =
            [(2.0, Some(30.0), 0.5), (4.0, None, 1.0)].map(|(mae, psnr_db, ssim)| Score { mae, psnr_db, ssim });
        let expected = Score { mae: 3.0, psnr_db: Some(30.0), ssim: 0.75 };
        assert_eq!(Score::mean(scores.iter()), Some(expected));
        assert_eq!(Score::mean(scores[1..].iter()).and_then(|mean| mean.psnr_db), None);
        assert_eq!(Score::mean([].iter()), None);
    }
}
