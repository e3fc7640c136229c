//! Finds where a ball touched the pad, in a tactile image and the background image.
//!
//! Coarse to fine: the disc with the steepest change of colour, the disc that leaves least of the change unexplained
//! (`fit.rs`), the rim (`rim.rs`). One ball, in contact over 5 to 60 % of the smaller side; a part of the disc may be
//! out of view. Constants were chosen on presses of six real sensors.

pub mod change;
mod fit;
mod rim;
mod search;

use image::RgbImage;

use crate::presses::Circle;
use change::{Change, energy};

/// Blocks in the radius of the disc when it is fitted.
const FINE: f64 = 16.0;

/// A disc that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The visible edge of the disc, as a person would draw it: about the contact's where the picture is sharp, up to a
    /// sixth larger where it is not.
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
    /// Fraction of the change in and around the disc that a press of a ball explains, 0 to 1.
    pub explained: f64,
    /// Distance between the centres that fit and rim say, in radii.
    pub disagreement: f64,
    /// Fraction of the disc that is in view, 0 to 1.
    pub in_view: f64,
}

/// Finds the disc of a ball's press. `background` is the background image of the same size. None where nothing
/// changed, or where the picture is a few pixels wide.
///
/// # Panics
/// If the sizes differ.
pub fn detect(image: &RgbImage, background: &RgbImage) -> Option<Detection> {
    assert_eq!(image.dimensions(), background.dimensions(), "image and background must be of one size");
    let coarse = Change::coarse(image, background);
    let guesses: Vec<Circle> = search::discs(&coarse).into_iter().take(3).map(|disc| coarse.to_pixels(disc)).collect();
    let fine_px = ((guesses.first()?.radius_px / FINE).round() as usize).max(1);
    let fine = Change::new(image, background, coarse.drift, fine_px);
    let explained = |circle: Circle| fit::explained(&fine, circle).explained;
    let fits = guesses.iter().map(|guess| {
        let start = fine.to_blocks(*guess);
        fit::climb(start, 0.15 * start.radius_px, 0.1, explained)
    });
    let (fitted, _) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let quality = fit::explained(&fine, fitted);
    if quality.explained <= 0.0 {
        return None;
    }
    let smooth = fine.smoothed();
    let refined = rim::Rays::new().refine(&smooth, fitted);

    let apart = (refined.centre_px[0] - fitted.centre_px[0]).hypot(refined.centre_px[1] - fitted.centre_px[1]);
    let inside = contents(&smooth, refined);
    let evidence = Evidence {
        contrast: inside.mean_energy.sqrt() / coarse.usual(),
        explained: quality.explained / quality.total,
        disagreement: apart / refined.radius_px,
        in_view: inside.in_view,
    };
    Some(Detection { circle: smooth.to_pixels(refined), confidence: evidence.confidence(), evidence })
}

/// What of a disc is in view.
pub(crate) struct Contents {
    /// Fraction of its area, 0 to 1.
    pub in_view: f64,
    /// Mean squared change in that part; 0 if there is none.
    pub mean_energy: f64,
}

/// Looks into a disc, in blocks.
pub(crate) fn contents(change: &Change, circle: Circle) -> Contents {
    let Circle { centre_px: [cx, cy], radius_px } = circle;
    let (mut sum, mut covered) = (0.0, 0.0);
    for y in 0..change.levels.height {
        for (x, level) in change.levels.row(y).iter().enumerate() {
            // A rim of the width of a block: the area is exact to a few parts in a thousand.
            let fraction = (radius_px + 0.5 - (x as f64 - cx).hypot(y as f64 - cy)).clamp(0.0, 1.0);
            covered += fraction;
            sum += fraction * energy(*level);
        }
    }
    let area = std::f64::consts::PI * radius_px * radius_px;
    Contents { in_view: (covered / area).min(1.0), mean_energy: if covered > 0.0 { sum / covered } else { 0.0 } }
}

impl Evidence {
    /// Every doubt lowers it. Where real discs were found to 3 px, 94 % of the change and more were explained, and the
    /// two centres were within a tenth of a radius; where they were not, one or the other was missed.
    /// A right disc under more lights or deep shadows may be unsure, too: the light that is not understood counts against it.
    fn confidence(&self) -> f64 {
        let rising = |value: f64, half: f64, width: f64| 1.0 / (1.0 + libm::exp((half - value) / width));
        let agreed = libm::exp(-(self.disagreement / 0.15) * (self.disagreement / 0.15));
        let seen = (self.in_view / 0.6).min(1.0);
        rising(self.explained, 0.938, 0.006) * rising(self.contrast, 4.0, 0.5) * agreed * seen
    }
}
