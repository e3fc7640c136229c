//! Whether the circle that a table gives for a press can be right: a wrong one spoils a fit.
//!
//! It is held against the change between the image and the untouched pad's, and against the disc that
//! [`detect`] finds, if that is sure. Thresholds are such that good annotations of real sensors pass, one of which is
//! saturated in a third of its discs.

use std::fmt;

use image::RgbImage;

use super::detect::change::{Change, energy};
use super::detect::{contents, detect};
use crate::presses::Circle;

/// A detection must be this sure to count against a circle.
const SURE: f64 = 0.5;
/// What a good circle keeps, see [`Suspicion`].
const FURTHEST: f64 = 0.13;
const RADII: std::ops::Range<f64> = 0.83..1.22;
const LEAST_CONTRAST: f64 = 3.0;
const MOST_ELSEWHERE: f64 = 0.3;
const MOST_SATURATED: f64 = 0.5;
const MOST_OUT_OF_VIEW: f64 = 0.2;

/// Why a press may be unusable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Suspicion {
    /// The disc that is seen is elsewhere, further than 13 % of the circle's radius.
    FarFromChange {
        /// Between the centres.
        distance_px: f64,
    },
    /// The disc that is seen is a fifth larger or smaller.
    OtherSize {
        /// Radius of the disc that is seen.
        seen_px: f64,
    },
    /// Less than three times the usual change of the picture is in the circle.
    NothingThere,
    /// More than 30 % of the change is beyond 1.6 radii.
    Elsewhere {
        /// Of the change's energy, 0 to 1.
        share: f64,
    },
    /// More than half of the circle's pixels are black or white in a channel, where the untouched pad's are not.
    Saturated {
        /// Of the pixels in view, 0 to 1.
        share: f64,
    },
    /// More than a fifth of the circle is beyond the picture's border.
    OutOfView {
        /// Of the circle's area, 0 to 1.
        share: f64,
    },
}

impl fmt::Display for Suspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| (100.0 * share).round();
        match *self {
            Self::FarFromChange { distance_px } => {
                write!(f, "the circle is {distance_px:.0} px from the disc that is seen")
            }
            Self::OtherSize { seen_px } => write!(f, "the disc that is seen has a radius of {seen_px:.0} px"),
            Self::NothingThere => write!(f, "the image is no different from the background in the circle"),
            Self::Elsewhere { share } => {
                write!(f, "{} % of the change is far outside of the circle", percent(share))
            }
            Self::Saturated { share } => write!(f, "{} % of the circle is saturated", percent(share)),
            Self::OutOfView { share } => write!(f, "{} % of the circle is out of view", percent(share)),
        }
    }
}

/// What speaks against a circle, in figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Examined {
    /// The disc that is seen, if that is sure.
    pub seen: Option<Circle>,
    /// Change in the circle over the usual change of the picture.
    pub contrast: f64,
    /// Share of the change's energy, above the usual, beyond 1.6 radii.
    pub elsewhere: f64,
    /// Share of newly saturated pixels among those of the circle in view.
    pub saturated: f64,
    /// Share of the circle's area out of view.
    pub out_of_view: f64,
}

/// Everything that speaks against a circle; empty if it is good. `background` is the untouched pad's picture of the
/// same size.
///
/// # Panics
/// If the sizes differ.
pub fn suspicions(image: &RgbImage, background: &RgbImage, circle: &Circle) -> Vec<Suspicion> {
    examine(image, background, circle).suspicions(circle)
}

/// Holds a circle against its image. Panics if the sizes differ, as [`suspicions`] does.
pub fn examine(image: &RgbImage, background: &RgbImage, circle: &Circle) -> Examined {
    let found = detect(image, background).filter(|found| found.confidence >= SURE);
    against(image, background, circle, found.map(|found| found.circle))
}

/// The same where the disc that is seen is known already, or known not to be sure.
pub fn against(image: &RgbImage, background: &RgbImage, circle: &Circle, seen: Option<Circle>) -> Examined {
    let change = Change::coarse(image, background);
    let usual = change.usual();
    let near = change.to_blocks(*circle);
    let inside = contents(&change, near);
    Examined {
        seen,
        contrast: inside.mean_energy.sqrt() / usual,
        elsewhere: elsewhere(&change, near, usual),
        saturated: saturated(image, background, circle),
        out_of_view: 1.0 - inside.in_view,
    }
}

impl Examined {
    /// What of it is too much for `circle`.
    pub fn suspicions(&self, circle: &Circle) -> Vec<Suspicion> {
        let mut all = Vec::new();
        if let Some(seen) = self.seen {
            let distance_px = (seen.centre_px[0] - circle.centre_px[0]).hypot(seen.centre_px[1] - circle.centre_px[1]);
            if distance_px > FURTHEST * circle.radius_px {
                all.push(Suspicion::FarFromChange { distance_px });
            } else if !RADII.contains(&(seen.radius_px / circle.radius_px)) {
                all.push(Suspicion::OtherSize { seen_px: seen.radius_px });
            }
        }
        if self.contrast < LEAST_CONTRAST {
            all.push(Suspicion::NothingThere);
        } else if self.elsewhere > MOST_ELSEWHERE {
            all.push(Suspicion::Elsewhere { share: self.elsewhere });
        }
        if self.saturated > MOST_SATURATED {
            all.push(Suspicion::Saturated { share: self.saturated });
        }
        if self.out_of_view > MOST_OUT_OF_VIEW {
            all.push(Suspicion::OutOfView { share: self.out_of_view });
        }
        all
    }
}

/// Share of the change's energy beyond 1.6 radii; changes up to twice the usual do not count.
fn elsewhere(change: &Change, circle: Circle, usual: f64) -> f64 {
    let [cx, cy] = circle.centre_px;
    let (mut all, mut beyond) = (0.0, 0.0);
    for y in 0..change.levels.height {
        for (x, level) in change.levels.row(y).iter().enumerate() {
            let above = (energy(*level) - 4.0 * usual * usual).max(0.0);
            all += above;
            if (x as f64 - cx).hypot(y as f64 - cy) > 1.6 * circle.radius_px {
                beyond += above;
            }
        }
    }
    if all > 0.0 { beyond / all } else { 0.0 }
}

fn saturated(image: &RgbImage, background: &RgbImage, circle: &Circle) -> f64 {
    let [cx, cy] = circle.centre_px;
    let (mut seen, mut count) = (0.0, 0.0);
    for ((x, y, pixel), rest) in image.enumerate_pixels().zip(background.pixels()) {
        if (f64::from(x) - cx).hypot(f64::from(y) - cy) <= circle.radius_px {
            let full = |level: u8| level == 0 || level == 255;
            seen += 1.0;
            count += f64::from(u8::from((0..3).any(|k| full(pixel.0[k]) && !full(rest.0[k]))));
        }
    }
    if seen > 0.0 { count / seen } else { 0.0 }
}
