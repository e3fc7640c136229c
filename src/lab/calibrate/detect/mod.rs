//! Detects where a ball touched the pad, from a tactile image and the background image.
//!
//! From coarse to fine: the disc with the steepest change of colour (`search.rs`), the disc that leaves the least of
//! the change unexplained (`fit.rs`), the rim (`rim.rs`). Expects one ball whose contact takes 5 to 60 % of the smaller
//! side; part of the disc may be out of view. The constants were chosen on presses of six real sensors.
//!
//! [`align`] finds the shift between what two presses change in their pictures.

pub mod align;
pub mod change;
mod fit;
mod rim;
mod search;

use image::RgbImage;

use crate::presses::Circle;
use change::{BlockChange, change_energy};

/// Number of blocks in the radius of the disc for the fit.
const BLOCKS_PER_RADIUS: f64 = 16.0;

/// A disc that was detected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Visible edge of the disc, as a person would draw it: about that of the contact if the picture is sharp, up to a
    /// sixth larger if it is not.
    pub circle: Circle,
    /// Probability that the centre is within 3 px (of a picture of 320 px) of where a person would put it, 0 to 1.
    pub confidence: f64,
    /// Evidence from which the confidence is computed.
    pub evidence: Evidence,
}

/// Evidence for a detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Change in the disc over the typical change of the picture; about 1 where nothing was pressed.
    pub contrast: f64,
    /// Fraction of the change in and around the disc that a press of a ball explains, 0 to 1.
    pub explained: f64,
    /// Distance between the centres found by fit and by rim, in radii.
    pub disagreement: f64,
    /// Fraction of the disc that is in view, 0 to 1.
    pub in_view: f64,
}

/// Detects the disc of a ball's press. `background` is the background image of the same size. None if nothing changed,
/// or if the picture is only a few pixels wide.
///
/// # Panics
/// If the sizes differ.
pub fn detect_disc(image: &RgbImage, background: &RgbImage) -> Option<Detection> {
    assert_eq!(image.dimensions(), background.dimensions(), "image and background must be of one size");
    let coarse = BlockChange::on_coarse_blocks(image, background);
    let guesses: Vec<Circle> =
        search::search_discs(&coarse).into_iter().take(3).map(|disc| coarse.to_pixels(disc)).collect();
    let fine_px = ((guesses.first()?.radius_px / BLOCKS_PER_RADIUS).round() as usize).max(1);
    let fine = BlockChange::new(image, background, coarse.drift, fine_px);
    let explained = |circle: Circle| fit::explain_change(&fine, circle).explained;
    let fits = guesses.iter().map(|guess| {
        let start = fine.to_blocks(*guess);
        fit::climb_hill(start, 0.15 * start.radius_px, 0.1, explained)
    });
    let (fitted, _) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let quality = fit::explain_change(&fine, fitted);
    if quality.explained <= 0.0 {
        return None;
    }
    let smooth = fine.smooth();
    let refined = rim::RimRays::new().refine_circle(&smooth, fitted);

    let apart = (refined.centre_px[0] - fitted.centre_px[0]).hypot(refined.centre_px[1] - fitted.centre_px[1]);
    let inside = measure_disc(&smooth, refined);
    let evidence = Evidence {
        contrast: inside.mean_energy.sqrt() / coarse.typical_size(),
        explained: quality.explained / quality.total,
        disagreement: apart / refined.radius_px,
        in_view: inside.in_view,
    };
    Some(Detection { circle: smooth.to_pixels(refined), confidence: evidence.confidence(), evidence })
}

/// Contents of a disc within the view.
pub(crate) struct DiscContents {
    /// Fraction of the disc's area in view, 0 to 1.
    pub in_view: f64,
    /// Mean squared change in that part; 0 if there is none.
    pub mean_energy: f64,
}

/// Measures a disc, in blocks.
pub(crate) fn measure_disc(change: &BlockChange, circle: Circle) -> DiscContents {
    let Circle { centre_px: [cx, cy], radius_px } = circle;
    let (mut sum, mut covered) = (0.0, 0.0);
    for y in 0..change.levels.height {
        for (x, level) in change.levels.row(y).iter().enumerate() {
            // A soft rim as wide as a block: the area is exact to a few parts in a thousand.
            let fraction = (radius_px + 0.5 - (x as f64 - cx).hypot(y as f64 - cy)).clamp(0.0, 1.0);
            covered += fraction;
            sum += fraction * change_energy(*level);
        }
    }
    let area = std::f64::consts::PI * radius_px * radius_px;
    DiscContents { in_view: (covered / area).min(1.0), mean_energy: if covered > 0.0 { sum / covered } else { 0.0 } }
}

impl Evidence {
    /// Combines the evidence: every doubt lowers the confidence. Where real discs were detected within 3 px, 94 % of
    /// the change and more was explained and the two centres were within a tenth of a radius; failures missed one or
    /// the other. A correct disc may have a low confidence under further lights or deep shadows, which count as
    /// unexplained change.
    fn confidence(&self) -> f64 {
        let rising = |value: f64, half: f64, width: f64| 1.0 / (1.0 + libm::exp((half - value) / width));
        let agreed = libm::exp(-(self.disagreement / 0.15) * (self.disagreement / 0.15));
        let seen = (self.in_view / 0.6).min(1.0);
        rising(self.explained, 0.938, 0.006) * rising(self.contrast, 4.0, 0.5) * agreed * seen
    }
}
