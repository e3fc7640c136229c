//! Checks whether the circle that a table gives for a press can be right: a wrong one spoils a fit.
//!
//! The circle is compared with the change between image and background image, and with the disc that [`detect_disc`]
//! finds, if the detection is sure. Thresholds are such that good annotations of real sensors pass; one of these
//! sensors is saturated in a third of its discs.

use std::fmt;

use image::RgbImage;

use super::detect::change::{BlockChange, change_energy};
use super::detect::{detect_disc, measure_disc};
use crate::presses::Circle;
use gelsim_files::diagnostic::Diagnostic;

/// Confidence that a detection needs to count against a circle.
const SURE_CONFIDENCE: f64 = 0.5;
/// Limits that a good circle keeps; see [`CircleEvidence`] and [`OutlierReason`].
const FURTHEST: f64 = 0.13;
const RADII: std::ops::Range<f64> = 0.83..1.22;
const MIN_CONTRAST: f64 = 3.0;
const MAX_ELSEWHERE: f64 = 0.3;
const MAX_SATURATED: f64 = 0.5;
const MAX_OUT_OF_VIEW: f64 = 0.2;

/// Why a press may be unusable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OutlierReason {
    /// The visible disc is elsewhere: its centre is further away than 13 % of the circle's radius.
    FarFromChange {
        /// Distance of the centres.
        distance_px: f64,
    },
    /// The visible disc is a fifth larger or smaller.
    OtherSize {
        /// Radius of the visible disc.
        detected_px: f64,
    },
    /// The change in the circle is less than three times the usual change of the image.
    NoChange,
    /// More than 30 % of the change is outside 1.6 radii.
    Elsewhere {
        /// Fraction of the change's energy, 0 to 1.
        fraction: f64,
    },
    /// More than half of the circle's pixels are black or white in a channel without being so in the background image.
    Saturated {
        /// Fraction of the pixels in view, 0 to 1.
        fraction: f64,
    },
    /// More than a fifth of the circle is outside the image.
    OutOfView {
        /// Fraction of the circle's area, 0 to 1.
        fraction: f64,
    },
    /// The ball cannot make so large a contact.
    TooLarge,
    /// A fit to the other presses simulates this press far worse than the others.
    FarWorse {
        /// Error around the contact, grey levels.
        error: f64,
        /// Median error of all presses, grey levels.
        others: f64,
    },
}

impl fmt::Display for OutlierReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |fraction: f64| (100.0 * fraction).round();
        match *self {
            Self::FarFromChange { distance_px } => {
                write!(f, "the circle is {distance_px:.0} px from the disc that is seen")
            }
            Self::OtherSize { detected_px } => write!(f, "the disc that is seen has a radius of {detected_px:.0} px"),
            Self::NoChange => write!(f, "the image is no different from the background in the circle"),
            Self::Elsewhere { fraction } => {
                write!(f, "{} % of the change is far outside of the circle", percent(fraction))
            }
            Self::Saturated { fraction } => write!(f, "{} % of the circle is saturated", percent(fraction)),
            Self::OutOfView { fraction } => write!(f, "{} % of the circle is out of view", percent(fraction)),
            Self::TooLarge => write!(f, "its circle is too large for its ball"),
            Self::FarWorse { error, others } => write!(
                f,
                "it is simulated far worse than the others ({error:.1} levels, theirs {others:.1}): its circle or its ball may be \
                 wrong"
            ),
        }
    }
}

impl OutlierReason {
    /// Returns true for reasons that only a fit shows.
    pub fn is_of_fit(&self) -> bool {
        matches!(self, Self::TooLarge | Self::FarWorse { .. })
    }

    /// Makes the warning on the press of this file. Warnings of one cause are merged into one for many presses.
    pub fn to_warning(&self, file: &str) -> Diagnostic {
        let percent = |fraction: f64| (100.0 * fraction).round();
        let (cause, figure, help) = match *self {
            Self::FarFromChange { distance_px } => (
                "circles are away from the discs that are seen",
                format!(" ({distance_px:.0} px)"),
                "correct their centres",
            ),
            Self::OtherSize { detected_px } => (
                "circles are larger or smaller than the discs that are seen",
                format!(" ({detected_px:.0} px seen)"),
                "correct their radii",
            ),
            Self::NoChange => (
                "images are no different from the background in their circles",
                String::new(),
                "correct the circles, or name the images that show the presses",
            ),
            Self::Elsewhere { fraction } => (
                "images have changed far outside of their circles",
                format!(" ({} % of the change)", percent(fraction)),
                "correct the circles; a second contact, or a moved camera, spoils the image",
            ),
            Self::Saturated { fraction } => (
                "images are saturated in their circles",
                format!(" ({} %)", percent(fraction)),
                "take them at a shorter exposure",
            ),
            Self::OutOfView { fraction } => {
                ("circles are partly out of view", format!(" ({} %)", percent(fraction)), "press further inside")
            }
            Self::TooLarge => (
                "circles are too large for their balls",
                String::new(),
                "correct `radius_px`, the radius and not the diameter, `ball_radius_mm` or `mm_per_px`",
            ),
            Self::FarWorse { error, .. } => (
                "presses are simulated far worse than the others",
                format!(" ({error:.1} levels)"),
                "correct their circles and balls",
            ),
        };
        let help = format!("{help}; or leave such presses out with --drop-bad");
        Diagnostic::warning(format!("{file}: {self}")).about(format!("{file}{figure}"), cause).help(help)
    }
}

/// Figures on how well a circle fits its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CircleEvidence {
    /// The visible disc; `None` if no detection is sure.
    pub detected: Option<Circle>,
    /// Change in the circle over the usual change of the image.
    pub contrast: f64,
    /// Fraction of the change's energy, above the usual, outside 1.6 radii.
    pub elsewhere: f64,
    /// Fraction of newly saturated pixels among the pixels of the circle in view.
    pub saturated: f64,
    /// Fraction of the circle's area out of view.
    pub out_of_view: f64,
}

/// Returns everything that speaks against a circle; empty if it is good. `background` is the background image.
///
/// # Panics
/// If the sizes differ.
pub fn outlier_reasons(image: &RgbImage, background: &RgbImage, circle: &Circle) -> Vec<OutlierReason> {
    examine_circle(image, background, circle).outlier_reasons(circle)
}

/// Compares a circle with its image. Panics if the sizes differ, as [`outlier_reasons`] does.
pub fn examine_circle(image: &RgbImage, background: &RgbImage, circle: &Circle) -> CircleEvidence {
    let found = detect_disc(image, background).filter(|found| found.confidence >= SURE_CONFIDENCE);
    examine_detected(image, background, circle, found.map(|found| found.circle))
}

/// Compares a circle with its image and with a disc that was detected before; `None` if no detection is sure.
pub fn examine_detected(
    image: &RgbImage,
    background: &RgbImage,
    circle: &Circle,
    detected: Option<Circle>,
) -> CircleEvidence {
    let change = BlockChange::on_coarse_blocks(image, background);
    let usual = change.typical_size();
    let near = change.to_blocks(*circle);
    let inside = measure_disc(&change, near);
    CircleEvidence {
        detected,
        contrast: inside.mean_energy.sqrt() / usual,
        elsewhere: fraction_elsewhere(&change, near, usual),
        saturated: saturated_fraction(image, background, circle),
        out_of_view: 1.0 - inside.in_view,
    }
}

impl CircleEvidence {
    /// Returns the reasons that these figures give against `circle`.
    pub fn outlier_reasons(&self, circle: &Circle) -> Vec<OutlierReason> {
        let mut all = Vec::new();
        if let Some(detected) = self.detected {
            let distance_px =
                (detected.centre_px[0] - circle.centre_px[0]).hypot(detected.centre_px[1] - circle.centre_px[1]);
            if distance_px > FURTHEST * circle.radius_px {
                all.push(OutlierReason::FarFromChange { distance_px });
            // A disc elsewhere is another disc, so that its size says nothing about this one.
            } else if !RADII.contains(&(detected.radius_px / circle.radius_px)) {
                all.push(OutlierReason::OtherSize { detected_px: detected.radius_px });
            }
        }
        if self.contrast < MIN_CONTRAST {
            all.push(OutlierReason::NoChange);
        } else if self.elsewhere > MAX_ELSEWHERE {
            all.push(OutlierReason::Elsewhere { fraction: self.elsewhere });
        }
        if self.saturated > MAX_SATURATED {
            all.push(OutlierReason::Saturated { fraction: self.saturated });
        }
        if self.out_of_view > MAX_OUT_OF_VIEW {
            all.push(OutlierReason::OutOfView { fraction: self.out_of_view });
        }
        all
    }
}

/// Computes the fraction of the change's energy outside 1.6 radii. Changes up to twice the usual do not count.
fn fraction_elsewhere(change: &BlockChange, circle: Circle, usual: f64) -> f64 {
    let [cx, cy] = circle.centre_px;
    let (mut all, mut outside) = (0.0, 0.0);
    for y in 0..change.levels.height {
        for (x, level) in change.levels.row(y).iter().enumerate() {
            // The energy is a square: twice the usual change is four times its energy.
            let above = (change_energy(*level) - 4.0 * usual * usual).max(0.0);
            all += above;
            if (x as f64 - cx).hypot(y as f64 - cy) > 1.6 * circle.radius_px {
                outside += above;
            }
        }
    }
    if all > 0.0 { outside / all } else { 0.0 }
}

fn saturated_fraction(image: &RgbImage, background: &RgbImage, circle: &Circle) -> f64 {
    let [cx, cy] = circle.centre_px;
    let (mut in_view, mut count) = (0.0, 0.0);
    for ((x, y, pixel), rest) in image.enumerate_pixels().zip(background.pixels()) {
        if (f64::from(x) - cx).hypot(f64::from(y) - cy) <= circle.radius_px {
            let full = |level: u8| level == 0 || level == 255;
            in_view += 1.0;
            count += f64::from(u8::from((0..3).any(|k| full(pixel.0[k]) && !full(rest.0[k]))));
        }
    }
    if in_view > 0.0 { count / in_view } else { 0.0 }
}
