//! The steps of a calibration, from presses to a table.

use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::camera::{MeasuredCamera, measure};
use super::choose::choose;
use super::leds::{FittedLeds, fit_leds};
use super::outliers::outlier_reasons;
use super::pixels::{DILATE, Pixels};
use super::train::Settings;
use super::validate::{HeldOut, cross_validate};
use super::{Geometry, Session, Surfaces, fit, table};
use crate::core::base::grid::Resolution;
use crate::core::gelpad::Model;
use crate::core::gelpad::elastic::Elastic;
use crate::core::optics::calibrated::response::{Response, SECTORS};
use crate::core::optics::calibrated::{Colors, Table};
use crate::lab::compare::score::{Score, score};

/// Pixels of a press that are learnt from.
const PIXELS: usize = 4000;

/// What a user may fix or wish.
#[derive(Clone, Copy, Debug, Default)]
pub struct Request {
    /// Thickness of the pad, mm; chosen if it is not given.
    pub thickness_mm: Option<f64>,
    /// Radius of the contact over that of the visible disc; chosen if it is not given.
    pub contact_over_disc: Option<f64>,
    /// Leave out presses that may be unusable.
    pub drops_bad: bool,
    /// How the model is fitted.
    pub settings: Settings,
}

/// A finished calibration.
pub struct Calibration {
    /// The presses it was made from.
    pub session: Session,
    /// The pad.
    pub geometry: Geometry,
    /// The light.
    pub table: Table,
    /// LEDs that come nearest to it, for the optics models `phong` and `led`.
    pub leds: FittedLeds,
    /// The camera, where enough of the images is away from the presses.
    pub camera: Option<MeasuredCamera>,
    /// Each press by a model of the others.
    pub held_out: Vec<HeldOut>,
    /// What speaks against each press.
    pub outlier_reasons: Vec<Vec<String>>,
    /// Presses that were left out, each with what spoke against it.
    pub dropped: Vec<(String, Vec<String>)>,
}

/// Calibrates. `None` if too few presses are left.
pub fn run(mut session: Session, request: &Request) -> Option<Calibration> {
    let mut dropped = Vec::new();
    let of = |observation: &super::Observation| -> Vec<String> {
        let found = outlier_reasons(&observation.image, &session.background, &observation.circle);
        found.iter().map(ToString::to_string).collect()
    };
    let mut doubts: Vec<Vec<String>> = session.observations.par_iter().map(of).collect();
    if request.drops_bad {
        drop_bad(&mut session, &mut doubts, &mut dropped);
    }
    if session.observations.len() < super::session::FEWEST {
        return None;
    }
    let chosen =
        |session: &Session| choose(session, request.thickness_mm, request.contact_over_disc, &request.settings);
    let mut geometry = chosen(&session);
    let (mut pixels, mut held_out, mut odd) = learn(&session, geometry, request);
    if request.drops_bad && odd.iter().any(|odd| !odd.is_empty()) {
        drop_bad(&mut session, &mut odd, &mut dropped);
        doubts = vec![Vec::new(); session.observations.len()];
        if session.observations.len() < super::session::FEWEST {
            return None;
        }
        geometry = chosen(&session);
        (pixels, held_out, odd) = learn(&session, geometry, request);
    }
    for (doubts, odd) in doubts.iter_mut().zip(odd) {
        doubts.extend(odd);
    }
    let response = fit(&session, &pixels.iter().collect::<Vec<_>>(), &request.settings, 100);
    let leds = fit_leds(&pixels)?;
    Some(Calibration {
        table: table(response, geometry).with_beyond(leds.beyond()),
        leds,
        camera: measure(&session),
        session,
        geometry,
        held_out,
        outlier_reasons: doubts,
        dropped,
    })
}

/// What there is to learn, each press by a model of the others, and what that says against it.
fn learn(session: &Session, geometry: Geometry, request: &Request) -> (Vec<Pixels>, Vec<HeldOut>, Vec<Vec<String>>) {
    let half = Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() });
    let surfaces = session.surfaces(geometry, &half);
    let pixels = session.pixels(&session.places(PIXELS), &surfaces, true);
    let held_out = cross_validate(session, &surfaces, &pixels, geometry, &request.settings);
    let odd = odd_ones(&surfaces, &held_out);
    (pixels, held_out, odd)
}

impl Request {
    /// The geometry where none is chosen: the sensor's thickness, and the usual contact, if the request has none.
    pub fn geometry(&self, session: &Session) -> Geometry {
        Geometry {
            thickness_mm: self.thickness_mm.unwrap_or(session.sensor.gelpad_thickness_mm),
            contact_over_disc: self.contact_over_disc.unwrap_or(Geometry::USUAL_CONTACT),
        }
    }
}

/// Fits the LEDs alone, on this pad. `None` without pixels.
pub fn run_leds(session: &Session, geometry: Geometry) -> Option<FittedLeds> {
    let half = Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() });
    let surfaces = session.surfaces(geometry, &half);
    fit_leds(&session.pixels(&session.places(PIXELS), &surfaces, false))
}

/// Takes the presses that something speaks against out of the session.
fn drop_bad(session: &mut Session, doubts: &mut Vec<Vec<String>>, dropped: &mut Vec<(String, Vec<String>)>) {
    let all = std::mem::take(&mut session.observations).into_iter().zip(std::mem::take(doubts));
    for (observation, found) in all {
        if found.is_empty() {
            session.observations.push(observation);
            doubts.push(found);
        } else {
            dropped.push((observation.file, found));
        }
    }
}

/// What the fit says against presses: contacts no ball has, and errors far beyond the others'.
fn odd_ones(surfaces: &Surfaces, held_out: &[HeldOut]) -> Vec<Vec<String>> {
    let errors: Vec<f64> =
        held_out.iter().map(|held_out| held_out.scores.contact.unwrap_or(held_out.scores.full_image).mae).collect();
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let middle = median(errors.clone());
    let spread = 1.4826 * median(errors.iter().map(|error| (error - middle).abs()).collect());
    let odd = |(error, too_large): (&f64, &bool)| {
        let mut odd = Vec::new();
        if *too_large {
            odd.push(String::from("its circle is too large for its ball"));
        }
        if *error > (middle + 5.0 * spread).max(2.0 * middle) {
            odd.push(format!(
                "it is simulated far worse than the others ({error:.1} levels, theirs {middle:.1}): its circle or its ball \
                 may be wrong"
            ));
        }
        odd
    };
    errors.iter().zip(&surfaces.too_large).map(odd).collect()
}

impl Calibration {
    /// Mean errors around the contact and over the whole image.
    pub fn errors(&self) -> [Option<Score>; 2] {
        let contact = self.held_out.iter().filter_map(|held_out| held_out.scores.contact.as_ref());
        [Score::mean(contact), Score::mean(self.held_out.iter().map(|held_out| &held_out.scores.full_image))]
    }

    /// The same of the background alone, as if nothing pressed.
    pub fn errors_without(&self) -> [Option<Score>; 2] {
        let background = &self.session.background;
        let of =
            |observation: &super::Observation| score(&observation.image, background, Some(&observation.circle), DILATE);
        let scores: Vec<_> = self.session.observations.par_iter().map(of).collect();
        let contact = scores.iter().filter_map(|scores| scores.contact.as_ref());
        [Score::mean(contact), Score::mean(scores.iter().map(|scores| &scores.full_image))]
    }

    /// Pictures of the colour by normal, in the middle of the view and towards its corners: a disc as a ball of the
    /// steepest slope would show it, at half of the deepest displacement, over grey.
    pub fn colors(&self) -> Vec<(String, RgbImage)> {
        let places = [("middle", 0.0, 0.0), ("top left", -0.5, -0.5), ("top right", 0.5, -0.5)];
        let more = [("bottom left", -0.5, 0.5), ("bottom right", 0.5, 0.5)];
        let half = self.session.sensor.field_of_view_mm.map(|mm| 0.5 * mm);
        let Colors::Response(response) = &self.table.colors else { return Vec::new() };
        let disc =
            |&(name, x, y): &(&str, f64, f64)| (name.to_owned(), disc_of_normals(response, [x * half[0], y * half[1]]));
        places.iter().chain(&more).map(disc).collect()
    }
}

fn disc_of_normals(response: &Response, place_mm: [f64; 2]) -> RgbImage {
    const SIZE: u32 = 129;
    let middle = 0.5 * (f64::from(SIZE) - 1.0);
    RgbImage::from_fn(SIZE, SIZE, |column, row| {
        let [x, y] = [column, row].map(|at| (f64::from(at) - middle) / middle);
        if x * x + y * y > 1.0 {
            return Rgb([255; 3]);
        }
        let steepest = f64::from(response.steepest);
        let change = response.change(
            [x * steepest, y * steepest],
            0.5 * f64::from(response.heights_mm[1]),
            place_mm,
            [0.0; SECTORS],
        );
        Rgb(change.map(|change| (127.5 + 255.0 * change).clamp(0.0, 255.0) as u8))
    })
}
