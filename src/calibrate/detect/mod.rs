//! Finds where a ball touched the pad, in a tactile image and the picture of the untouched pad.
//!
//! Coarse to fine: the disc with the steepest change of colour, the disc that leaves least of the change unexplained
//! (`fit.rs`), the rim (`rim.rs`). One ball, in contact over 5 to 60 % of the smaller side; a part of the disc may be
//! out of view. Constants were chosen on presses of six real sensors.

pub(crate) mod change;
mod fit;
mod rim;
mod search;

use image::RgbImage;

use crate::presses::Circle;
use change::{Change, Drift, energy};

/// Blocks along the longer side when the disc is looked for.
const COARSE: usize = 80;
/// Blocks in the radius of the disc when it is fitted.
const FINE: f64 = 16.0;

/// A disc that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The visible edge of the disc, as a person would draw it; the contact itself ends about a sixth further inside.
    pub circle: Circle,
    /// How likely the centre is within 3 px (of a picture of 320 px) of where a person would put it, 0 to 1.
    pub confidence: f64,
    /// What the confidence is made of.
    pub evidence: Evidence,
}

/// What speaks for a detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Change in the disc over the usual change of the picture; about 1 where nothing was pressed.
    pub contrast: f64,
    /// Share of the change in and around the disc that a press of a ball explains, 0 to 1.
    pub explained: f64,
    /// Distance between the centres that fit and rim say, in radii.
    pub disagreement: f64,
    /// Share of the disc that is in view, 0 to 1.
    pub in_view: f64,
}

/// Finds the disc of a ball's press. `background` is the untouched pad's picture of the same size. None where nothing changed, or
/// the picture is too small to tell (under about 24 px).
///
/// # Panics
/// If the sizes differ.
pub fn detect(image: &RgbImage, background: &RgbImage) -> Option<Detection> {
    assert_eq!(image.dimensions(), background.dimensions(), "image and background must be of one size");
    let longer = image.width().max(image.height()) as usize;
    let block_px = longer.div_ceil(COARSE).max(1);
    let drift = Drift::between(image, background, block_px);
    let coarse = Change::new(image, background, drift, block_px);
    let usual = coarse.usual().max(0.25);

    let guesses: Vec<Circle> = search::discs(&coarse).into_iter().take(3).map(|disc| coarse.to_pixels(disc)).collect();
    let fine_px = ((guesses.first()?.radius_px / FINE).round() as usize).max(1);
    let fine = Change::new(image, background, drift, fine_px);
    let fits = guesses.iter().map(|guess| {
        let start = fine.to_blocks(*guess);
        fit::climb(start, 0.15 * start.radius_px, 0.1, |circle| fit::explained(&fine, circle).explained)
    });
    let (fitted, _) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let quality = fit::explained(&fine, fitted);
    if quality.explained <= 0.0 {
        return None;
    }
    let smooth = fine.smoothed();
    let refined = rim::Rays::new().refine(&smooth, fitted);

    let apart = (refined.centre_px[0] - fitted.centre_px[0]).hypot(refined.centre_px[1] - fitted.centre_px[1]);
    let (in_view, mean) = disc(&smooth, refined);
    let evidence = Evidence {
        contrast: mean.sqrt() / usual,
        explained: quality.explained / quality.total,
        disagreement: apart / refined.radius_px,
        in_view,
    };
    Some(Detection { circle: smooth.to_pixels(refined), confidence: evidence.confidence(), evidence })
}

/// Share of a disc that is in view, and the mean squared change in that part; both 0 if there is none.
pub(crate) fn disc(change: &Change, circle: Circle) -> (f64, f64) {
    let Circle { centre_px: [cx, cy], radius_px } = circle;
    let (mut seen, mut sum) = (0.0, 0.0);
    for y in 0..change.levels.height {
        for (x, level) in change.levels.row(y).iter().enumerate() {
            if (x as f64 - cx).hypot(y as f64 - cy) <= radius_px {
                seen += 1.0;
                sum += energy(*level);
            }
        }
    }
    let whole = std::f64::consts::PI * radius_px * radius_px;
    if seen > 0.0 { ((seen / whole).min(1.0), sum / seen) } else { (0.0, 0.0) }
}

impl Evidence {
    fn confidence(&self) -> f64 {
        self.explained
    }
}
