//! Chooses the pad's thickness and how much smaller the contact is than the visible disc.
//!
//! A quick stand-in for the model says how well colour follows from a surface: the same polynomial in the normal, of
//! which the coefficients are linear in the place, with terms in the height, by least squares (cross-validated). What it
//! likes best the model does too.

use nalgebra::{DMatrix, DVector};

use super::pixels::Pixels;
use super::validate::{FOLDS, folds};
use super::{Geometry, Session};
use crate::gelpad::Model;
use crate::gelpad::elastic::{Elastic, Resolution};
use crate::optics::calibrated::response::{TERMS, terms};

/// Terms at one place.
const LOCAL: usize = TERMS - 1 + 7;
/// All: times 1, x and y.
const ALL: usize = 3 * LOCAL;
/// Weight of the penalty, relative to each column's own.
const RIDGE: f64 = 1e-4;

/// Thicknesses that are tried, mm. On thicker pads no press of a ball tells them apart.
const THICKNESSES_MM: [f64; 6] = [1.5, 2.0, 3.0, 4.0, 6.0, 9.0];
/// Shares of the visible disc that are tried for the contact.
const SHARES: [f64; 7] = [0.85, 0.88, 0.91, 0.94, 0.97, 1.0, 1.03];
/// Pixels of a press that are looked at.
const PIXELS: usize = 1200;

/// What is not given of `session`'s geometry: first the share on a pad of middling thickness, then the thickness, then the
/// share again.
pub fn choose(session: &Session, thickness_mm: Option<f64>, contact_over_disc: Option<f64>) -> Geometry {
    let places = session.places(PIXELS);
    let coarse = Model::Elastic(Elastic { resolution: Resolution::Quarter, ..Elastic::default() });
    let error = |geometry: Geometry| {
        let surfaces = session.surfaces(geometry, &coarse);
        let largest = surfaces.too_large.iter().filter(|too_large| **too_large).count();
        // A pad in which a tenth of the discs are impossible is not this sensor's.
        let possible = 10 * largest <= session.seen.len();
        let error = error(&session.pixels(&places, &surfaces, false), session.place_mm());
        if possible { error } else { 1.0 + largest as f64 }
    };
    let best = |tried: Vec<Geometry>| {
        let errors: Vec<f64> = tried.iter().map(|geometry| error(*geometry)).collect();
        let least = (0..errors.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b]));
        least.map(|k| tried[k])
    };
    let mut geometry = Geometry { thickness_mm: thickness_mm.unwrap_or(4.0), contact_over_disc: 0.95 };
    for round in 0..2 {
        let shares = contact_over_disc.map_or(SHARES.to_vec(), |share| vec![share]);
        let with_share = |contact_over_disc: f64| Geometry { contact_over_disc, ..geometry };
        geometry = best(shares.into_iter().map(with_share).collect()).unwrap_or(geometry);
        if round == 0 && thickness_mm.is_none() {
            let with_thickness = |thickness_mm: f64| Geometry { thickness_mm, ..geometry };
            geometry = best(THICKNESSES_MM.map(with_thickness).to_vec()).unwrap_or(geometry);
        }
    }
    geometry
}

/// Sums of products over the pixels of one press.
struct Sums {
    terms: DMatrix<f64>,
    change: DMatrix<f64>,
    square: f64,
    count: f64,
}

impl Sums {
    fn of(pixels: &Pixels, place_mm: f64) -> Self {
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

/// Root mean square error of presses that were not learnt from, shares of full scale.
pub fn error(pixels: &[Pixels], place_mm: f64) -> f64 {
    let sums: Vec<Sums> = pixels.iter().map(|pixels| Sums::of(pixels, place_mm)).collect();
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
