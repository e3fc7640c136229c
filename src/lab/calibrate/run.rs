//! Runs the steps of a calibration, from presses to a table.

use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::camera::{MeasuredCamera, measure_camera};
use super::choose::{self, choose_geometry};
use super::judge::fit::{FitVerdict, guess_errors};
use super::leds::{FittedLeds, fit_leds};
use super::outliers::{OutlierReason, outlier_reasons};
use super::pixels::{ERROR_REACH, PixelSamples};
use super::progress::{ProgressCallback, ProgressMeter};
use super::train::TrainingSettings;
use super::validate::{self, HeldOut, cross_validate};
use super::{Geometry, Observation, PressSurfaces, Session, build_table, fit_response};
use crate::compare::score::{Score, score_images};
use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::Model;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::optics::calibrated::response::{CalibrationResponse, SECTORS};
use gelsim_core::optics::calibrated::{CalibrationColors, CalibrationTable};

/// Number of pixels of a press that are learnt from.
const PRESS_PIXELS: usize = 4000;

/// What a user may set.
#[derive(Clone, Copy, Debug, Default)]
pub struct CalibrationRequest {
    /// Thickness of the pad, mm; chosen by fit if `None`.
    pub thickness_mm: Option<f64>,
    /// Radius of the contact over that of the visible disc; chosen by fit if `None`.
    pub contact_over_disc: Option<f64>,
    /// Leave out presses that may be unusable.
    pub drops_outliers: bool,
    /// How the model is fitted.
    pub settings: TrainingSettings,
}

/// A finished calibration.
pub struct Calibration {
    /// The presses that were used.
    pub session: Session,
    /// The chosen pad geometry.
    pub geometry: Geometry,
    /// The calibrated light.
    pub table: CalibrationTable,
    /// LEDs that come nearest to the calibrated light, for the optics models `phong` and `led`.
    pub leds: FittedLeds,
    /// Blur and noise of the camera; `None` if too little of the images is away from the presses.
    pub camera: Option<MeasuredCamera>,
    /// Each press, simulated by a model of the others.
    pub held_out: Vec<HeldOut>,
    /// Reasons against each press.
    pub outlier_reasons: Vec<Vec<OutlierReason>>,
    /// Presses that were left out, each with the reasons.
    pub dropped: Vec<(String, Vec<OutlierReason>)>,
    /// Number of presses whose contact is larger than their ball can make in this pad.
    pub too_large: usize,
    /// Whether the fit explains the changes that the presses make.
    pub verdict: FitVerdict,
}

/// Why a calibration failed.
#[derive(Clone, Debug, PartialEq)]
pub enum CalibrationError {
    /// Too few presses are left. Those that were left out, each with the reasons.
    TooFew(Vec<(String, Vec<OutlierReason>)>),
    /// No pixel can be learnt from: all are out of view or saturated in the background image.
    NoPixel,
}

/// Finds the reasons against each press before the fit.
pub fn find_outliers(session: &Session) -> Vec<Vec<OutlierReason>> {
    let of = |observation: &Observation| outlier_reasons(&observation.image, &session.background, &observation.circle);
    session.observations.par_iter().map(of).collect()
}

/// Calibrates. `None` if too few presses are left, or no pixel can be learnt from.
pub fn calibrate(session: Session, request: &CalibrationRequest) -> Option<Calibration> {
    let doubts = find_outliers(&session);
    calibrate_with_progress(session, doubts, request, &|_, _| {}).ok()
}

/// Calibrates with known reasons against each press, and reports the progress.
pub fn calibrate_with_progress(
    mut session: Session,
    mut doubts: Vec<Vec<OutlierReason>>,
    request: &CalibrationRequest,
    callback: ProgressCallback<'_>,
) -> Result<Calibration, CalibrationError> {
    let CalibrationRequest { thickness_mm, contact_over_disc, settings, .. } = request;
    let mut dropped = Vec::new();
    if request.drops_outliers {
        drop_outliers(&mut session, &mut doubts, &mut dropped);
    }
    if session.observations.len() < super::session::MIN_PRESSES {
        return Err(CalibrationError::TooFew(dropped));
    }
    let last = (settings.networks * settings.steps) as u64;
    let once = choose::count_choice_steps(*thickness_mm, *contact_over_disc, settings)
        + validate::count_validation_steps(session.observations.len(), settings);
    // A second round follows if the first one finds outliers.
    let work = ProgressMeter::new(if request.drops_outliers { 2 * once } else { once } + last, callback);
    let chosen = |session: &Session| choose_geometry(session, *thickness_mm, *contact_over_disc, settings, &work);
    let mut geometry = chosen(&session);
    let mut learnt = cross_validate_presses(&session, geometry, request, &work);
    // A bad press also spoils the choice of the geometry and the fits of the others: start again without it.
    if request.drops_outliers && learnt.outlier_reasons.iter().any(|odd| !odd.is_empty()) {
        drop_outliers(&mut session, &mut learnt.outlier_reasons, &mut dropped);
        doubts = vec![Vec::new(); session.observations.len()];
        if session.observations.len() < super::session::MIN_PRESSES {
            return Err(CalibrationError::TooFew(dropped));
        }
        geometry = chosen(&session);
        learnt = cross_validate_presses(&session, geometry, request, &work);
    }
    let CrossValidation { pixels, held_out, outlier_reasons: odd, too_large } = learnt;
    for (doubts, odd) in doubts.iter_mut().zip(odd) {
        doubts.extend(odd);
    }
    let leds = fit_leds(&pixels).ok_or(CalibrationError::NoPixel)?;
    let response = fit_response(&session, &pixels.iter().collect::<Vec<_>>(), Some(&leds), settings, 100, &work);
    Ok(Calibration {
        table: build_table(response, geometry).with_extrapolation(leds.extrapolation()),
        leds,
        camera: measure_camera(&session),
        verdict: judge_fit(&session, &held_out),
        session,
        geometry,
        held_out,
        outlier_reasons: doubts,
        dropped,
        too_large,
    })
}

/// What models of the other presses say about each press.
struct CrossValidation {
    pixels: Vec<PixelSamples>,
    held_out: Vec<HeldOut>,
    /// Reasons that the fit gives against each press.
    outlier_reasons: Vec<Vec<OutlierReason>>,
    too_large: usize,
}

fn cross_validate_presses(
    session: &Session,
    geometry: Geometry,
    request: &CalibrationRequest,
    work: &ProgressMeter,
) -> CrossValidation {
    let half = Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() });
    let surfaces = session.press_surfaces(geometry, &half);
    let pixels = session.sample_pixels(&session.draw_places(PRESS_PIXELS), &surfaces, true);
    let held_out = cross_validate(session, &surfaces, &pixels, geometry, &request.settings, work);
    let odd = find_misfits(&surfaces, &held_out);
    let too_large = surfaces.too_large.iter().filter(|too_large| **too_large).count();
    CrossValidation { pixels, held_out, outlier_reasons: odd, too_large }
}

/// Computes the errors around the contacts of the fit, on presses that it has not seen, and of two guesses.
fn judge_fit(session: &Session, held_out: &[HeldOut]) -> FitVerdict {
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let fit = held_out.iter().filter_map(|held_out| Some(held_out.scores.contact?.mae)).collect();
    let guesses: Vec<[f64; 2]> = session
        .observations
        .par_iter()
        .filter_map(|press| guess_errors(&press.image, &session.background, &press.circle))
        .collect();
    let of = |k: usize| mean(guesses.iter().map(|guesses| guesses[k]).collect());
    FitVerdict { fit: mean(fit), background: of(0), flat: of(1) }
}

impl CalibrationRequest {
    /// Returns the geometry without a choice by fit: the request's, else the sensor's thickness and the usual contact.
    pub fn default_geometry(&self, session: &Session) -> Geometry {
        Geometry {
            thickness_mm: self.thickness_mm.unwrap_or(session.sensor.gelpad_thickness_mm),
            contact_over_disc: self.contact_over_disc.unwrap_or(Geometry::USUAL_CONTACT),
        }
    }
}

/// LEDs that were fitted without a table, and how good they are.
pub struct LedCalibration {
    /// The LEDs.
    pub leds: FittedLeds,
    /// Whether the LEDs explain the changes that the presses make.
    pub verdict: FitVerdict,
    /// True for each press whose contact is larger than its ball can make in this pad.
    pub too_large: Vec<bool>,
}

/// Fits the LEDs alone, in a pad of known geometry. `None` without pixels.
pub fn calibrate_leds(session: &Session, geometry: Geometry) -> Option<LedCalibration> {
    let half = Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() });
    let surfaces = session.press_surfaces(geometry, &half);
    let pixels = session.sample_pixels(&session.draw_places(PRESS_PIXELS), &surfaces, false);
    let leds = fit_leds(&pixels)?;
    // Errors are those of presses that were not fitted. With three presses, each fit is to the two others.
    let parts = pixels.len().min(validate::FOLDS);
    let errors = (0..pixels.len()).into_par_iter().map(|press| {
        let others = pixels.iter().enumerate().filter(|(k, _)| k % parts != press % parts).map(|(_, pixels)| pixels);
        Some(fit_leds(others)?.mean_errors(&pixels[press]))
    });
    let errors: Vec<[f64; 3]> = errors.flatten().collect();
    let mean = |k: usize| errors.iter().map(|errors| errors[k]).sum::<f64>() / errors.len() as f64;
    let verdict = FitVerdict { fit: mean(0), background: mean(1), flat: mean(2) };
    Some(LedCalibration { leds, verdict, too_large: surfaces.too_large })
}

/// Removes the presses with reasons against them from the session.
fn drop_outliers(
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

/// Finds the reasons that a fit gives: contacts that the ball cannot make, and errors far above those of the other
/// presses.
fn find_misfits(surfaces: &PressSurfaces, held_out: &[HeldOut]) -> Vec<Vec<OutlierReason>> {
    let errors: Vec<f64> =
        held_out.iter().map(|held_out| held_out.scores.contact.unwrap_or(held_out.scores.full_image).mae).collect();
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let middle = median(errors.clone());
    // 1.4826 times the median absolute deviation estimates the standard deviation of a normal distribution; outliers
    // hardly change it.
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
    /// Computes mean errors around the contact, and over the whole image. `None` where nothing was measured.
    pub fn mean_errors(&self) -> [Option<Score>; 2] {
        let contact = self.held_out.iter().filter_map(|held_out| held_out.scores.contact.as_ref());
        [Score::mean(contact), Score::mean(self.held_out.iter().map(|held_out| &held_out.scores.full_image))]
    }

    /// Computes mean errors of the background image in place of a simulated one, around the contact and over the whole
    /// image.
    pub fn mean_background_errors(&self) -> [Option<Score>; 2] {
        let background = &self.session.background;
        let of = |observation: &super::Observation| {
            score_images(&observation.image, background, Some(&observation.circle), ERROR_REACH)
        };
        let scores: Vec<_> = self.session.observations.par_iter().map(of).collect();
        let contact = scores.iter().filter_map(|scores| scores.contact.as_ref());
        [Score::mean(contact), Score::mean(scores.iter().map(|scores| &scores.full_image))]
    }

    /// Renders the fitted colour by normal, in the middle of the view and towards its corners: a disc shows the normals
    /// of a ball up to the steepest slope, at half of the deepest displacement, over grey.
    pub fn color_discs(&self) -> Vec<(String, RgbImage)> {
        let places = [("middle", 0.0, 0.0), ("top left", -0.5, -0.5), ("top right", 0.5, -0.5)];
        let more = [("bottom left", -0.5, 0.5), ("bottom right", 0.5, 0.5)];
        let half = self.session.sensor.field_of_view_mm.map(|mm| 0.5 * mm);
        let CalibrationColors::Response(response) = &self.table.colors else { return Vec::new() };
        let disc = |&(name, x, y): &(&str, f64, f64)| {
            (name.to_owned(), render_normal_disc(response, [x * half[0], y * half[1]]))
        };
        places.iter().chain(&more).map(disc).collect()
    }
}

fn render_normal_disc(response: &CalibrationResponse, place_mm: [f64; 2]) -> RgbImage {
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
