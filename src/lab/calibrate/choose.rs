//! Chooses the pad's thickness and how much smaller the contact is than the visible disc.
//!
//! Both are judged by how well colour follows from the surface on presses that were not learnt from. The thickness,
//! which matters less, by a quick stand-in for the model: the same polynomial in the normal, of which the coefficients
//! are linear in the place, with terms in the height, by least squares. The fraction by the model itself, fitted in a
//! hurry.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::pixels::Pixels;
use super::progress::Work;
use super::train::{self, Settings};
use super::validate::{FOLDS, folds};
use super::{Geometry, Session, fit};
use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::Model;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::optics::calibrated::response::{TERMS, terms};

/// Terms at one place.
const LOCAL: usize = TERMS - 1 + 7;
/// All: times 1, x and y.
const ALL: usize = 3 * LOCAL;
/// Weight of the penalty, relative to each column's own.
const RIDGE: f64 = 1e-4;

/// Thicknesses that are tried, mm. On thicker pads no press of a ball tells them apart.
const THICKNESSES_MM: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 9.0];
/// Fractions of the visible disc that are tried for the contact.
const CONTACT_FRACTIONS: [f64; 5] = [0.88, 0.91, 0.94, 0.97, 1.0];
/// What of these makes contacts the smallest for their discs and lets them be the largest.
pub const ROOMIEST: Geometry =
    Geometry { thickness_mm: THICKNESSES_MM[THICKNESSES_MM.len() - 1], contact_over_disc: CONTACT_FRACTIONS[0] };
/// Pixels of a press that are looked at.
const PIXELS: usize = 1500;

/// Steps of training that take as long as the surfaces and the stand-in of one thickness, and as the surfaces of one fraction.
const THICKNESS_STEPS: u64 = 250;
const SURFACES_STEPS: u64 = 400;

/// Steps of training in a hurry.
fn quick_steps(settings: &Settings) -> usize {
    settings.steps.min(400)
}

/// The work of [`choose`], in steps of training.
pub fn work(thickness_mm: Option<f64>, contact_over_disc: Option<f64>, settings: &Settings) -> u64 {
    let thicknesses = if thickness_mm.is_none() { THICKNESSES_MM.len() as u64 } else { 0 };
    let fractions = if contact_over_disc.is_none() { CONTACT_FRACTIONS.len() as u64 } else { 0 };
    thicknesses * THICKNESS_STEPS + fractions * (SURFACES_STEPS + FOLDS as u64 * quick_steps(settings) as u64)
}

/// What is open of `session`'s geometry: the thickness by the stand-in, then the fraction by networks that are fitted in a
/// hurry. What is given stays.
pub fn choose(
    session: &Session,
    thickness_mm: Option<f64>,
    contact_over_disc: Option<f64>,
    settings: &Settings,
    work: &Work,
) -> Geometry {
    let places = session.places(PIXELS);
    let on = |geometry: Geometry, resolution: Resolution, sky: bool| {
        let elastic = Model::Elastic(Elastic { resolution, ..Elastic::default() });
        let surfaces = session.surfaces(geometry, &elastic);
        let largest = surfaces.too_large.iter().filter(|too_large| **too_large).count();
        // A pad in which a tenth of the discs are impossible is not this sensor's.
        let impossible = if 10 * largest > session.observations.len() { largest as f64 } else { 0.0 };
        (session.pixels(&places, &surfaces, sky), impossible)
    };
    let mut geometry = Geometry {
        thickness_mm: thickness_mm.unwrap_or(4.0),
        contact_over_disc: contact_over_disc.unwrap_or(Geometry::USUAL_CONTACT),
    };
    if thickness_mm.is_none() {
        let tried = THICKNESSES_MM.map(|thickness_mm| Geometry { thickness_mm, ..geometry });
        geometry = best(&tried, geometry, |tried| {
            let (pixels, impossible) = on(tried, Resolution::Quarter, false);
            let error = error(&pixels, session.place_mm()) + impossible;
            work.add(THICKNESS_STEPS, "choosing the pad's thickness");
            error
        });
    }
    if contact_over_disc.is_none() {
        let tried = CONTACT_FRACTIONS.map(|contact_over_disc| Geometry { contact_over_disc, ..geometry });
        geometry = best(&tried, geometry, |tried| {
            let (pixels, impossible) = on(tried, Resolution::Half, true);
            work.add(SURFACES_STEPS, "choosing the contact in the disc");
            quick_error(session, &pixels, settings, work) + impossible
        });
    }
    geometry
}

fn best(tried: &[Geometry], otherwise: Geometry, error: impl Fn(Geometry) -> f64) -> Geometry {
    let errors: Vec<f64> = tried.iter().map(|geometry| error(*geometry)).collect();
    let least = (0..errors.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b]));
    least.map_or(otherwise, |k| tried[k])
}

/// Mean absolute error of networks on presses that they did not learn from, fractions of full scale.
fn quick_error(session: &Session, pixels: &[Pixels], settings: &Settings, work: &Work) -> f64 {
    let quick = Settings { networks: 1, steps: quick_steps(settings), ..*settings };
    let fold = folds(pixels.len());
    let of = |part: usize| -> [f64; 2] {
        let learnt: Vec<&Pixels> =
            pixels.iter().zip(&fold).filter(|(_, fold)| **fold != part).map(|(pixels, _)| pixels).collect();
        let response = fit(session, &learnt, &quick, part as u64, work);
        let held_out = pixels.iter().zip(&fold).filter(|(_, fold)| **fold == part);
        let errors = held_out.map(|(pixels, _)| [train::error(&response, pixels), 1.0]);
        errors.fold([0.0; 2], |[sum, count], [error, one]| [sum + error, count + one])
    };
    let sums = (0..FOLDS).into_par_iter().map(of).collect::<Vec<_>>();
    let [sum, count] = sums.iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    sum / count.max(1.0)
}

/// Sums of products over the pixels of one press.
struct Sums {
    terms: DMatrix<f64>,
    change: DMatrix<f64>,
    square: f64,
    count: f64,
}

impl Sums {
    fn from_pixels(pixels: &Pixels, place_mm: f64) -> Self {
        let rows = pixels.len();
        let mut all = DMatrix::zeros(rows, ALL);
        let mut change = DMatrix::zeros(rows, 3);
        for row in 0..rows {
            let [nx, ny] = pixels.normals[row];
            let [w, x, y, ..] = pixels.inputs[row].map(f64::from);
            let mut local = [0.0; LOCAL];
            let polynomial = terms(nx, ny).map(f64::from);
            local[..TERMS - 1].copy_from_slice(&polynomial[1..]);
            let [_, ny, nx, yy, xy, xx, ..] = polynomial;
            local[TERMS - 1..].copy_from_slice(&[w, w * w, w * nx, w * ny, w * xx, w * xy, w * yy]);
            for (part, place) in [1.0, x / place_mm, y / place_mm].into_iter().enumerate() {
                for (k, term) in local.iter().enumerate() {
                    all[(row, part * LOCAL + k)] = place * term;
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

/// Root mean square error of presses that were not learnt from, fractions of full scale.
pub fn error(pixels: &[Pixels], place_mm: f64) -> f64 {
    let sums: Vec<Sums> = pixels.iter().map(|pixels| Sums::from_pixels(pixels, place_mm)).collect();
    let fold = folds(sums.len());
    let (mut square, mut count) = (0.0, 0.0);
    for part in 0..FOLDS {
        let learnt = || sums.iter().zip(&fold).filter(|(_, fold)| **fold != part).map(|(sums, _)| sums);
        let mut products = learnt().fold(DMatrix::zeros(ALL, ALL), |all, sums| all + &sums.terms);
        let change = learnt().fold(DMatrix::zeros(ALL, 3), |all, sums| all + &sums.change);
        let scale = DVector::from_fn(ALL, |k, _| products[(k, k)].sqrt().max(1e-9));
        for k in 0..ALL {
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
