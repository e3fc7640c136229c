//! Checks whether a fit explains what the presses change, on presses that it was not fitted to.
//!
//! Two guesses need no fit: that nothing changes, which is the background image, and that a press changes its disc by
//! one colour, which is even taken from the press itself. A fit is useful if it leaves less than half of the better
//! guess's error. Measured (tests/reality/judge.rs): 0.17 to 0.39 on six sets of real presses in 300 steps, by LEDs
//! alone 0.32 to 0.56.

use image::RgbImage;

use super::super::choose::SMALLEST_CONTACT;
use super::super::leds::{FittedLeds, MAX_INTENSITY};
use super::super::outliers::OutlierReason;
use super::super::pixels::ERROR_REACH;
use super::super::{Geometry, Session};
use crate::compare::score::disc_mask;
use crate::presses::Circle;
use gelsim_files::diagnostic::Diagnostic;

/// Largest fraction of the better guess's error that a fit may leave.
pub const MAX_REMAINING_SHARE: f64 = 0.5;

/// Mean absolute errors around the contact, grey levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitVerdict {
    /// Error of the fit, each press by a fit to the others.
    pub fit: f64,
    /// Error of the background image, as if nothing was pressed.
    pub background: f64,
    /// Error of one colour for each disc.
    pub flat: f64,
}

impl FitVerdict {
    /// Error of the better guess.
    pub fn best_guess(&self) -> f64 {
        self.background.min(self.flat)
    }

    /// Fraction of the better guess's error that the fit leaves; 1 if there is nothing to explain.
    pub fn remaining_share(&self) -> f64 {
        if self.best_guess() > 0.0 { self.fit / self.best_guess() } else { 1.0 }
    }

    /// Returns true if the result would be useless, also if the errors are not numbers.
    pub fn is_hopeless(&self) -> bool {
        self.remaining_share().is_nan() || self.remaining_share() >= MAX_REMAINING_SHARE
    }

    /// Describes it in a sentence.
    pub fn to_sentence(&self) -> String {
        let explained = (100.0 * (1.0 - self.remaining_share())).round();
        let Self { fit, background, flat } = self;
        let figures = format!(
            "its error around the contact is {fit:.2} grey levels, that of the background alone {background:.2}, that of one \
             colour for each disc {flat:.2}"
        );
        match explained {
            explained if explained > 0.0 => format!("the fit explains {explained} % of what presses change: {figures}"),
            _ => format!("the fit explains nothing of what presses change: {figures}"),
        }
    }

    /// Returns the finding that the fit is useless, if it is; `doubtful` of `all` presses have doubts of their own.
    /// `is_short` says that the training was cut short.
    pub fn to_finding(&self, doubtful: usize, all: usize, is_short: bool) -> Option<Diagnostic> {
        if !self.is_hopeless() {
            return None;
        }
        let help = match doubtful {
            _ if is_short => "the training was short: leave --steps out first".to_owned(),
            _ if 2 * doubtful >= all => {
                "most presses are doubtful, see the warnings: correct their circles and balls first".to_owned()
            }
            0 => String::from(
                "nothing speaks against single presses: check that all of them are of one sensor, of the balls that the \
                 table says, and at the depths that the circles say; and take 20 to 50 of them",
            ),
            _ => format!("{doubtful} of {all} presses are doubtful, see the warnings: correct them, or add --drop-bad"),
        };
        Some(Diagnostic::new(self.to_sentence()).help(help))
    }
}

/// Reports that most circles are larger than any contact of their balls, with the option that causes it, if one does.
pub fn judge_contacts(
    session: &Session,
    thickness_mm: Option<f64>,
    contact_over_disc: Option<f64>,
) -> Option<Diagnostic> {
    let count = |thickness_mm: Option<f64>, contact_over_disc: Option<f64>| {
        let geometry = Geometry {
            thickness_mm: thickness_mm.unwrap_or(SMALLEST_CONTACT.thickness_mm),
            contact_over_disc: contact_over_disc.unwrap_or(SMALLEST_CONTACT.contact_over_disc),
        };
        session.find_too_large(geometry).into_iter().filter(|too_large| *too_large).count()
    };
    let all = session.observations.len();
    let is_most = |count: usize| 2 * count >= all;
    let large = count(thickness_mm, contact_over_disc);
    if !is_most(large) {
        return None;
    }
    let what = format!("{large} of {all} circles are larger than any contact of their balls");
    Some(match (thickness_mm, contact_over_disc) {
        (Some(thickness_mm), _) if !is_most(count(None, contact_over_disc)) => Diagnostic::new(format!(
            "{what} in a pad of {thickness_mm} mm"
        ))
        .help("leave --thickness-mm out, or give the thickness of the gelpad in mm; common ones are 1.5 to 5 mm"),
        (_, Some(fraction)) if !is_most(count(thickness_mm, None)) => {
            Diagnostic::new(format!("{what} where the contact is {fraction} times the disc"))
                .help("leave --contact-over-disc out; where it was fitted it is 0.88 to 1")
        }
        _ => Diagnostic::new(what).help(
            "check `radius_px`, which is the radius of the disc and not its diameter, `ball_radius_mm` and `mm_per_px`",
        ),
    })
}

/// Reports that most presses are doubtful by themselves.
pub fn judge_doubts(doubts: &[Vec<OutlierReason>]) -> Option<Diagnostic> {
    let (doubtful, all) = (doubts.iter().filter(|doubts| !doubts.is_empty()).count(), doubts.len());
    (2 * doubtful >= all).then(|| {
        let message =
            format!("{doubtful} of {all} presses are doubtful, so that a fit would learn from what is not there");
        Diagnostic::new(message).help("see the warnings for what speaks against each, and correct it")
    })
}

/// Reports LEDs that are stronger than any real ones: what they were fitted to has almost no slopes.
pub fn judge_leds(found: &FittedLeds) -> Option<Diagnostic> {
    let strongest = found.leds.iter().map(|led| led.intensity).fold(0.0, f64::max);
    (strongest >= MAX_INTENSITY).then(|| {
        let message = format!(
            "LEDs of an intensity of {MAX_INTENSITY} and more would be needed to make what the presses change of so gentle slopes"
        );
        Diagnostic::new(message).help(
            "check `ball_radius_mm` and `mm_per_px`, and --contact-over-disc and --thickness-mm if they are given; press deeper",
        )
    })
}

/// Errors around the contact of the background image, and of the background with the best constant change of each
/// channel. `None` if the contact is out of view.
pub fn guess_errors(image: &RgbImage, background: &RgbImage, circle: &Circle) -> Option<[f64; 2]> {
    let mask = disc_mask(circle, ERROR_REACH, [image.width() as usize, image.height() as usize]);
    let inside = image.pixels().zip(background.pixels()).zip(&mask.data).filter(|(_, mask)| **mask > 0);
    let mut changes: [Vec<i16>; 3] = Default::default();
    for ((pixel, rest), _) in inside {
        (0..3).for_each(|k| changes[k].push(i16::from(pixel[k]) - i16::from(rest[k])));
    }
    let count = 3.0 * changes[0].len() as f64;
    let (mut background, mut flat) = (0.0, 0.0);
    for mut changes in changes {
        changes.sort_unstable();
        let middle = *changes.get(changes.len() / 2)?;
        for change in changes {
            background += f64::from(change.abs());
            flat += f64::from((change - middle).abs());
        }
    }
    Some([background / count, flat / count])
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_fit_must_leave_less_than_half_of_the_better_guess() {
        let verdict = |fit: f64| FitVerdict { fit, background: 16.0, flat: 12.0 };
        assert!(!verdict(5.9).is_hopeless() && verdict(6.0).is_hopeless() && verdict(f64::NAN).is_hopeless());
        assert!(verdict(3.0).to_sentence().starts_with("the fit explains 75 % of what presses change"));
        assert!(verdict(13.0).to_sentence().starts_with("the fit explains nothing"));
        assert_eq!(verdict(3.0).to_finding(9, 9, false), None);
        let help = |doubtful: usize| {
            verdict(9.0).to_finding(doubtful, 9, false).and_then(|found| found.help).expect("a way out")
        };
        let cut_short = verdict(9.0).to_finding(0, 9, true).and_then(|found| found.help);
        assert!(cut_short.is_some_and(|help| help.contains("leave --steps out")));
        assert!(help(0).contains("one sensor") && help(2).contains("--drop-bad") && help(5).contains("most presses"));
        assert!(FitVerdict { fit: 0.0, background: 0.0, flat: 0.0 }.is_hopeless());
    }

    #[test]
    fn guesses_are_of_the_disc_alone_and_the_flat_one_is_the_best_constant() {
        let rest = RgbImage::from_pixel(30, 20, Rgb([100, 110, 120]));
        let mut image = rest.clone();
        image.put_pixel(0, 0, Rgb([255; 3]));
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            if (8..13).contains(&x) && (8..13).contains(&y) {
                *pixel = Rgb([110, 110, if x < 10 { 100 } else { 110 }]);
            }
        }
        let circle = Circle { centre_px: [10.0, 10.0], radius_px: 1.0 };
        // Nine pixels: red 10 more, green as before, blue 20 less in three of them and 10 less in six.
        let [background, flat] =
            guess_errors(&image, &rest, &Circle { radius_px: 1.5 / ERROR_REACH, ..circle }).expect("in view");
        assert!((background - (90.0 + 60.0 + 60.0) / 27.0).abs() < 1e-12, "{background}");
        assert!((flat - 30.0 / 27.0).abs() < 1e-12, "{flat}");
        assert_eq!(guess_errors(&image, &rest, &Circle { centre_px: [-50.0, 0.0], ..circle }), None);
    }
}
