//! The steps of a calibration, from presses to a table.

use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::camera::{MeasuredCamera, measure};
use super::choose::{self, choose};
use super::judge::fit::{Verdict, guesses};
use super::leds::{FittedLeds, fit_leds};
use super::outliers::{OutlierReason, outlier_reasons};
use super::pixels::{DILATE, Pixels};
use super::progress::{Heard, Work};
use super::train::Settings;
use super::validate::{self, HeldOut, cross_validate};
use super::{Geometry, Observation, Session, Surfaces, fit, table};
use crate::compare::score::{Score, score};
use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::Model;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::optics::calibrated::response::{Response, SECTORS};
use gelsim_core::optics::calibrated::{Colors, Table};

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
    pub outlier_reasons: Vec<Vec<OutlierReason>>,
    /// Presses that were left out, each with what spoke against it.
    pub dropped: Vec<(String, Vec<OutlierReason>)>,
    /// Presses whose contact no press of their ball makes in this pad.
    pub too_large: usize,
    /// Whether the fit explains what the presses change.
    pub verdict: Verdict,
}

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq)]
pub enum Unfit {
    /// Too few presses are left; those that were left out, each with what spoke against it.
    TooFew(Vec<(String, Vec<OutlierReason>)>),
    /// No pixel can be learnt from: all are out of view or white in the background.
    NoPixel,
}

/// What speaks against each press before the fit.
pub fn doubts(session: &Session) -> Vec<Vec<OutlierReason>> {
    let of = |observation: &Observation| outlier_reasons(&observation.image, &session.background, &observation.circle);
    session.observations.par_iter().map(of).collect()
}

/// Calibrates; `None` if too few presses are left, or no pixel that can be learnt from.
pub fn run(session: Session, request: &Request) -> Option<Calibration> {
    let doubts = doubts(&session);
    run_heard(session, doubts, request, &|_, _| {}).ok()
}

/// Calibrates where it is known what speaks against each press, and says how far that has come.
pub fn run_heard(
    mut session: Session,
    mut doubts: Vec<Vec<OutlierReason>>,
    request: &Request,
    heard: Heard<'_>,
) -> Result<Calibration, Unfit> {
    let Request { thickness_mm, contact_over_disc, settings, .. } = request;
    let mut dropped = Vec::new();
    if request.drops_bad {
        drop_bad(&mut session, &mut doubts, &mut dropped);
    }
    if session.observations.len() < super::session::FEWEST {
        return Err(Unfit::TooFew(dropped));
    }
    let last = (settings.networks * settings.steps) as u64;
    let once = choose::work(*thickness_mm, *contact_over_disc, settings)
        + validate::work(session.observations.len(), settings);
    let work = Work::new(if request.drops_bad { 2 * once } else { once } + last, heard);
    let chosen = |session: &Session| choose(session, *thickness_mm, *contact_over_disc, settings, &work);
    let mut geometry = chosen(&session);
    let mut learnt = learn(&session, geometry, request, &work);
    if request.drops_bad && learnt.odd.iter().any(|odd| !odd.is_empty()) {
        drop_bad(&mut session, &mut learnt.odd, &mut dropped);
        doubts = vec![Vec::new(); session.observations.len()];
        if session.observations.len() < super::session::FEWEST {
            return Err(Unfit::TooFew(dropped));
        }
        geometry = chosen(&session);
        learnt = learn(&session, geometry, request, &work);
    }
    let Learnt { pixels, held_out, odd, too_large } = learnt;
    for (doubts, odd) in doubts.iter_mut().zip(odd) {
        doubts.extend(odd);
    }
    let response = fit(&session, &pixels.iter().collect::<Vec<_>>(), settings, 100, &work);
    let leds = fit_leds(&pixels).ok_or(Unfit::NoPixel)?;
    Ok(Calibration {
        table: table(response, geometry).with_beyond(leds.beyond()),
        leds,
        camera: measure(&session),
        verdict: verdict(&session, &held_out),
        session,
        geometry,
        held_out,
        outlier_reasons: doubts,
        dropped,
        too_large,
    })
}

/// What was learnt of presses by models of the others.
struct Learnt {
    pixels: Vec<Pixels>,
    held_out: Vec<HeldOut>,
    /// What that says against each press.
    odd: Vec<Vec<OutlierReason>>,
    too_large: usize,
}

fn learn(session: &Session, geometry: Geometry, request: &Request, work: &Work) -> Learnt {
    let half = Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() });
    let surfaces = session.surfaces(geometry, &half);
    let pixels = session.pixels(&session.places(PIXELS), &surfaces, true);
    let held_out = cross_validate(session, &surfaces, &pixels, geometry, &request.settings, work);
    let odd = odd_ones(&surfaces, &held_out);
    let too_large = surfaces.too_large.iter().filter(|too_large| **too_large).count();
    Learnt { pixels, held_out, odd, too_large }
}

/// Errors of the fit on presses that it has not seen, and of guesses, around the contacts.
fn verdict(session: &Session, held_out: &[HeldOut]) -> Verdict {
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let fit = held_out.iter().filter_map(|held_out| Some(held_out.scores.contact?.mae)).collect();
    let guesses: Vec<[f64; 2]> = session
        .observations
        .par_iter()
        .filter_map(|press| guesses(&press.image, &session.background, &press.circle))
        .collect();
    let of = |k: usize| mean(guesses.iter().map(|guesses| guesses[k]).collect());
    Verdict { fit: mean(fit), background: of(0), flat: of(1) }
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

/// LEDs that were fitted alone, and how good they are.
pub struct LedsAlone {
    /// The LEDs.
    pub leds: FittedLeds,
    /// Whether they explain what the presses change.
    pub verdict: Verdict,
    /// Presses whose contact no press of their ball makes in this pad.
    pub too_large: Vec<bool>,
}

/// Fits the LEDs alone, on this pad. `None` without pixels.
pub fn run_leds(session: &Session, geometry: Geometry) -> Option<LedsAlone> {
    let half = Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() });
    let surfaces = session.surfaces(geometry, &half);
    let pixels = session.pixels(&session.places(PIXELS), &surfaces, false);
    let leds = fit_leds(&pixels)?;
    // Of so few numbers, fitted to thousands of pixels, those of the others are as good; with three presses, of two.
    let parts = pixels.len().min(validate::FOLDS);
    let errors = (0..pixels.len()).into_par_iter().map(|press| {
        let others = pixels.iter().enumerate().filter(|(k, _)| k % parts != press % parts).map(|(_, pixels)| pixels);
        Some(fit_leds(others)?.errors(&pixels[press]))
    });
    let errors: Vec<[f64; 3]> = errors.flatten().collect();
    let mean = |k: usize| errors.iter().map(|errors| errors[k]).sum::<f64>() / errors.len() as f64;
    let verdict = Verdict { fit: mean(0), background: mean(1), flat: mean(2) };
    Some(LedsAlone { leds, verdict, too_large: surfaces.too_large })
}

/// Takes the presses that something speaks against out of the session.
fn drop_bad(
    session: &mut Session,
    doubts: &mut Vec<Vec<OutlierReason>>,
    dropped: &mut Vec<(String, Vec<OutlierReason>)>,
) {
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
fn odd_ones(surfaces: &Surfaces, held_out: &[HeldOut]) -> Vec<Vec<OutlierReason>> {
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
            odd.push(OutlierReason::TooLarge);
        }
        if *error > (middle + 5.0 * spread).max(2.0 * middle) {
            odd.push(OutlierReason::FarWorse { error: *error, others: middle });
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
