//! Chooses the pad's thickness, and the ratio of the contact to the visible disc.
//!
//! Both are judged by how well colour follows from the surface on presses that were held out. The thickness, which
//! matters less, is judged by a quick stand-in for the model: the same polynomial in the normal, with coefficients that
//! are linear in the place and terms in the height, by least squares. The ratio is judged by the model itself, with
//! short training.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::leds::fit_leds;
use super::pixels::PixelSamples;
use super::progress::ProgressMeter;
use super::train::{self, TrainingSettings};
use super::validate::{FOLDS, assign_folds};
use super::{Geometry, Session, fit_response};
use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::Model;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::optics::calibrated::response::{TERMS, normal_terms};

/// Number of terms at one place.
const LOCAL_TERMS: usize = TERMS - 1 + 7;
/// Number of all terms: those at one place times 1, x and y.
const ALL_TERMS: usize = 3 * LOCAL_TERMS;
/// Weight of the penalty, relative to each column's own.
const RIDGE: f64 = 1e-4;

/// Thicknesses to try, mm. Presses of a ball cannot tell thicker pads apart.
const THICKNESSES_MM: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 9.0];
/// Ratios of the contact to the visible disc to try.
const CONTACT_FRACTIONS: [f64; 5] = [0.88, 0.91, 0.94, 0.97, 1.0];
/// Of these, the geometry that makes contacts smallest for their discs, and allows the largest contacts.
pub const SMALLEST_CONTACT: Geometry =
    Geometry { thickness_mm: THICKNESSES_MM[THICKNESSES_MM.len() - 1], contact_over_disc: CONTACT_FRACTIONS[0] };
/// Most pixels of a press that are used.
const PRESS_PIXELS: usize = 1500;

/// Work in steps of training: the surfaces and the stand-in of one thickness; the surfaces of one ratio.
const THICKNESS_STEPS: u64 = 250;
const SURFACES_STEPS: u64 = 400;

/// Number of steps of a short training.
fn quick_steps(settings: &TrainingSettings) -> usize {
    settings.steps.min(400)
}

/// Work of [`choose_geometry`], in steps of training.
pub fn count_choice_steps(
    thickness_mm: Option<f64>,
    contact_over_disc: Option<f64>,
    settings: &TrainingSettings,
) -> u64 {
    let thicknesses = if thickness_mm.is_none() { THICKNESSES_MM.len() as u64 } else { 0 };
    let fractions = if contact_over_disc.is_none() { CONTACT_FRACTIONS.len() as u64 } else { 0 };
    thicknesses * THICKNESS_STEPS + fractions * (SURFACES_STEPS + FOLDS as u64 * quick_steps(settings) as u64)
}

/// Chooses what is open of a session's geometry: first the thickness by the stand-in, then the ratio by networks with
/// short training. Given values are kept.
pub fn choose_geometry(
    session: &Session,
    thickness_mm: Option<f64>,
    contact_over_disc: Option<f64>,
    settings: &TrainingSettings,
    work: &ProgressMeter,
) -> Geometry {
    let places = session.draw_places(PRESS_PIXELS);
    let on = |geometry: Geometry, resolution: Resolution, sky: bool| {
        let elastic = Model::Elastic(Elastic { resolution, ..Elastic::default() });
        let surfaces = session.press_surfaces(geometry, &elastic);
        let largest = surfaces.too_large.iter().filter(|too_large| **too_large).count();
        // A pad in which a tenth of the discs are impossible is not this sensor's: the penalty exceeds any error.
        let impossible = if 10 * largest > session.observations.len() { largest as f64 } else { 0.0 };
        (session.sample_pixels(&places, &surfaces, sky), impossible)
    };
    let mut geometry = Geometry {
        thickness_mm: thickness_mm.unwrap_or(4.0),
        contact_over_disc: contact_over_disc.unwrap_or(Geometry::USUAL_CONTACT),
    };
    if thickness_mm.is_none() {
        let tried = THICKNESSES_MM.map(|thickness_mm| Geometry { thickness_mm, ..geometry });
        geometry = find_best(&tried, geometry, |tried| {
            let (pixels, impossible) = on(tried, Resolution::Quarter, false);
            let error = cross_validation_error(&pixels, session.half_view_mm()) + impossible;
            work.advance(THICKNESS_STEPS, "choosing the pad's thickness");
            error
        });
    }
    if contact_over_disc.is_none() {
        let tried = CONTACT_FRACTIONS.map(|contact_over_disc| Geometry { contact_over_disc, ..geometry });
        geometry = find_best(&tried, geometry, |tried| {
            let (pixels, impossible) = on(tried, Resolution::Half, true);
            work.advance(SURFACES_STEPS, "choosing the contact in the disc");
            quick_error(session, &pixels, settings, work) + impossible
        });
    }
    geometry
}

/// Returns the geometry with the least error; `otherwise` if there is none to try.
fn find_best(tried: &[Geometry], otherwise: Geometry, error: impl Fn(Geometry) -> f64) -> Geometry {
    let errors: Vec<f64> = tried.iter().map(|geometry| error(*geometry)).collect();
    let least = (0..errors.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b]));
    least.map_or(otherwise, |k| tried[k])
}

/// Mean absolute error of networks with short training on held-out presses, fractions of full scale.
fn quick_error(session: &Session, pixels: &[PixelSamples], settings: &TrainingSettings, work: &ProgressMeter) -> f64 {
    let quick = TrainingSettings { networks: 1, steps: quick_steps(settings), ..*settings };
    let fold = assign_folds(pixels.len());
    let of = |part: usize| -> [f64; 2] {
        let learnt: Vec<&PixelSamples> =
            pixels.iter().zip(&fold).filter(|(_, fold)| **fold != part).map(|(pixels, _)| pixels).collect();
        let leds = fit_leds(learnt.iter().copied());
        let response = fit_response(session, &learnt, leds.as_ref(), &quick, part as u64, work);
        let held_out = pixels.iter().zip(&fold).filter(|(_, fold)| **fold == part);
        let errors = held_out.map(|(pixels, _)| [train::mean_absolute_error(&response, pixels), 1.0]);
        errors.fold([0.0; 2], |[sum, count], [error, one]| [sum + error, count + one])
    };
    let sums = (0..FOLDS).into_par_iter().map(of).collect::<Vec<_>>();
    let [sum, count] = sums.iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    sum / count.max(1.0)
}

/// Normal equations over the pixels of one press.
struct NormalEquations {
    terms: DMatrix<f64>,
    change: DMatrix<f64>,
    square: f64,
    count: f64,
}

impl NormalEquations {
    fn from_pixels(pixels: &PixelSamples, place_mm: f64) -> Self {
        let rows = pixels.len();
        let mut all = DMatrix::zeros(rows, ALL_TERMS);
        let mut change = DMatrix::zeros(rows, 3);
        for row in 0..rows {
            let [nx, ny] = pixels.normals[row];
            let [w, x, y, ..] = pixels.inputs[row].map(f64::from);
            let mut local = [0.0; LOCAL_TERMS];
            let polynomial = normal_terms(nx, ny).map(f64::from);
            local[..TERMS - 1].copy_from_slice(&polynomial[1..]);
            let [_, ny, nx, yy, xy, xx, ..] = polynomial;
            local[TERMS - 1..].copy_from_slice(&[w, w * w, w * nx, w * ny, w * xx, w * xy, w * yy]);
            for (part, place) in [1.0, x / place_mm, y / place_mm].into_iter().enumerate() {
                for (k, term) in local.iter().enumerate() {
                    all[(row, part * LOCAL_TERMS + k)] = place * term;
                }
            }
            for channel in 0..3 {
                change[(row, channel)] = f64::from(pixels.change[row][channel]);
            }
        }
        let square = change.norm_squared();
        Self { terms: all.transpose() * &all, change: all.transpose() * change, square, count: rows as f64 }
    }
}

/// Root mean square error of the stand-in on held-out presses, fractions of full scale. The sums of a press are
/// computed once and shared by all folds.
pub fn cross_validation_error(pixels: &[PixelSamples], place_mm: f64) -> f64 {
    let sums: Vec<NormalEquations> =
        pixels.iter().map(|pixels| NormalEquations::from_pixels(pixels, place_mm)).collect();
    let fold = assign_folds(sums.len());
    let (mut square, mut count) = (0.0, 0.0);
    for part in 0..FOLDS {
        let learnt = || sums.iter().zip(&fold).filter(|(_, fold)| **fold != part).map(|(sums, _)| sums);
        let mut products = learnt().fold(DMatrix::zeros(ALL_TERMS, ALL_TERMS), |all, sums| all + &sums.terms);
        let change = learnt().fold(DMatrix::zeros(ALL_TERMS, 3), |all, sums| all + &sums.change);
        let scale = DVector::from_fn(ALL_TERMS, |k, _| products[(k, k)].sqrt().max(1e-9));
        // Relative to each column, so that the penalty does not depend on units; the tiny absolute part keeps empty
        // columns solvable.
        for k in 0..ALL_TERMS {
            products[(k, k)] *= 1.0 + RIDGE;
            products[(k, k)] += 1e-12 * scale.max() * scale.max();
        }
        let Some(solved) = products.cholesky() else { return f64::INFINITY };
        let weights = solved.solve(&change);
        for (sums, _) in sums.iter().zip(&fold).filter(|(_, fold)| **fold == part) {
            let fitted = (weights.transpose() * &sums.terms * &weights).trace();
            square += sums.square - 2.0 * weights.dot(&sums.change) + fitted;
            count += 3.0 * sums.count;
        }
    }
    (square.max(0.0) / f64::max(count, 1.0)).sqrt()
}
