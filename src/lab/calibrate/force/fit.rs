//! Fits Young's modulus, relaxation and the zero of the depth to presses.
//!
//! The force is linear in the modulus and in modulus times share, which non-negative least squares find for any times
//! of relaxation and any zero. These few are searched for. Each press weighs the same, and within it a row by the
//! relative error of its force, so that neither many rows nor one hard press decide. The number of modes is the
//! smallest that predicts presses which were left out. Standard errors are those of a jackknife over presses: rows of
//! one press share its errors.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::motion::{History, Motion, Motions};
use super::simplex::minimise;
use gelsim_core::gelpad::elastic::relaxation::RelaxationMode;

/// Most modes of relaxation.
pub const MAX_MODES: usize = 2;
/// Most groups of presses for the jackknife. More presses are left out in groups.
const MAX_GROUPS: usize = 40;
/// Force over the largest at which the error of a row counts as much as that of its size.
const FLOOR_SHARE: f64 = 0.1;
/// Times of relaxation that are tried first.
const GRID_TIMES: usize = 18;
/// Ratio below which two times of relaxation are one.
const LEAST_RATIO: f64 = 2.0;
/// Share of the held-out error by which another mode must reduce it.
const LEAST_GAIN: f64 = 0.02;
/// Share of the force from which on a mode counts.
const LEAST_SHARE: f64 = 5e-3;
/// Fewest presses that are held, for a relaxation.
pub const LEAST_HELD: usize = 2;
/// Greatest offset of the zero over the deepest press.
const MOST_ZERO_SHARE: f64 = 0.5;

/// What is found.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Young's modulus of a quick press, kPa.
    pub youngs_modulus_kpa: f64,
    /// Modes of relaxation, by their times.
    pub relaxation: Vec<RelaxationMode>,
    /// What is added to measured depths, mm.
    pub zero_mm: f64,
}

/// Why there is no relaxation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoRelaxation {
    /// The table has no times.
    NoTimes,
    /// Fewer than [`LEAST_HELD`] presses are held.
    NoHolds,
    /// Modes of relaxation predict presses that were left out no better.
    NotFound,
}

impl NoRelaxation {
    /// Says why.
    pub fn describe(self) -> &'static str {
        match self {
            Self::NoTimes => "not fitted: the table has no time_s",
            Self::NoHolds => "not fitted: fewer than two presses are held",
            Self::NotFound => "none: it would predict no press better",
        }
    }
}

/// A press against its fit.
#[derive(Clone, Debug, PartialEq)]
pub struct PressResult {
    /// Name in the table.
    pub name: String,
    /// Measured forces at the rows that were used, N.
    pub measured_n: Vec<f64>,
    /// Fitted forces, N.
    pub fitted_n: Vec<f64>,
    /// Forces by a fit to the other presses, N; empty if there is none.
    pub held_out_n: Vec<f64>,
    /// Factor by which its forces are larger than those by a fit to the other presses.
    pub factor: f64,
}

/// A fit with its uncertainty.
#[derive(Clone, Debug)]
pub struct ElasticFit {
    /// The values.
    pub solution: Solution,
    /// Why there is no relaxation, if there is none.
    pub no_relaxation: Option<NoRelaxation>,
    /// Names of the values whose errors are known, in the order of `covariance`.
    pub names: Vec<String>,
    /// The values in the same order.
    pub values: Vec<f64>,
    /// Covariances of these values by a jackknife over presses; empty for fewer than three presses.
    pub covariance: Vec<Vec<f64>>,
    /// Presses in the order of the table.
    pub presses: Vec<PressResult>,
}

impl ElasticFit {
    /// Standard error of value number `k`; `None` if it is not known.
    pub fn standard_error(&self, k: usize) -> Option<f64> {
        let variance = *self.covariance.get(k)?.get(k)?;
        Some(variance.max(0.0).sqrt())
    }

    /// Standard error of the value of this name; `None` if it is not known.
    pub fn standard_error_of(&self, name: &str) -> Option<f64> {
        self.standard_error(self.names.iter().position(|known| known == name)?)
    }

    /// Root of the mean square of what the fit leaves over all rows, N, and over that of the forces.
    pub fn remaining(&self) -> [f64; 2] {
        rms_and_share(self.presses.iter().flat_map(|press| press.measured_n.iter().zip(&press.fitted_n)))
    }

    /// The same for fits to the other presses; `None` for fewer than two presses.
    pub fn held_out(&self) -> Option<[f64; 2]> {
        let known = self.presses.iter().all(|press| press.held_out_n.len() == press.measured_n.len());
        known.then(|| {
            rms_and_share(self.presses.iter().flat_map(|press| press.measured_n.iter().zip(&press.held_out_n)))
        })
    }
}

/// Returns the root of the mean square of differences, and its ratio to that of the first values; 0 without values.
pub fn rms_and_share<'a>(pairs: impl Iterator<Item = (&'a f64, &'a f64)>) -> [f64; 2] {
    let (mut count, mut left, mut all) = (0.0, 0.0, 0.0);
    for (measured, other) in pairs {
        count += 1.0;
        left += (measured - other) * (measured - other);
        all += measured * measured;
    }
    let rms = if count > 0.0 { (left / count).sqrt() } else { 0.0 };
    [rms, if all > 0.0 { (left / all).sqrt() } else { 0.0 }]
}

/// Fits the presses. With `fits_zero` also one offset of all measured depths.
pub fn fit(motions: &Motions, fits_zero: bool) -> ElasticFit {
    let session = FitSession::new(motions, fits_zero);
    let none = match () {
        () if !motions.has_times => Some(NoRelaxation::NoTimes),
        () if session.held() < LEAST_HELD => Some(NoRelaxation::NoHolds),
        () => None,
    };
    let mut weights = session.initial_weights();
    let mut best = session.fit_modes(0, &weights);
    if none.is_none() {
        for modes in 1..=MAX_MODES {
            let next = session.fit_modes(modes, &weights);
            if session.is_better(&next, &best, &weights) {
                best = next;
            }
        }
    }
    // Weights follow the fitted forces, because measured ones would pull the fit down.
    for _ in 0..2 {
        weights = session.weights(&session.forces(&best.whole));
        best = session.refit(&best, &weights);
    }
    session.describe(best, none)
}

/// Presses in groups that are left out together.
struct FitSession<'a> {
    motions: &'a [Motion],
    fits_zero: bool,
    /// Number of groups; press `k` is in group `k % groups`.
    groups: usize,
    deepest_mm: f64,
    /// Shortest and longest time of relaxation.
    times_s: [f64; 2],
    /// Histories of the presses where the zero is right.
    histories: Vec<History>,
}

/// Values that are searched for: the zero, then logarithms of times.
type Searched = Vec<f64>;

/// A fit to all presses, and those without each group.
struct Fits {
    modes: usize,
    whole: Solution,
    without: Vec<Solution>,
}

/// Sums of products of the columns and of the forces.
#[derive(Clone, Copy, Default)]
struct Gram {
    products: [[f64; MAX_MODES + 1]; MAX_MODES + 1],
    with_force: [f64; MAX_MODES + 1],
    force_square: f64,
}

impl Gram {
    fn add(&mut self, row: [f64; MAX_MODES + 1], force: f64, weight: f64) {
        for j in 0..=MAX_MODES {
            for k in 0..=MAX_MODES {
                self.products[j][k] += weight * row[j] * row[k];
            }
            self.with_force[j] += weight * row[j] * force;
        }
        self.force_square += weight * force * force;
    }

    /// Returns the non-negative factors of the first columns with the least squared error, and this error.
    fn solve(&self, columns: usize) -> ([f64; MAX_MODES + 1], f64) {
        let mut best = ([0.0; MAX_MODES + 1], self.force_square);
        // All sets of columns that may be above 0: there are at most eight.
        for set in 1..1_usize << columns {
            let used: Vec<usize> = (0..columns).filter(|k| set >> k & 1 == 1).collect();
            let Some(found) = self.solve_columns(&used) else { continue };
            if used.iter().any(|k| found[*k] < 0.0) {
                continue;
            }
            let mut error = self.force_square;
            for j in &used {
                error -= 2.0 * found[*j] * self.with_force[*j];
                for k in &used {
                    error += found[*j] * found[*k] * self.products[*j][*k];
                }
            }
            if error < best.1 {
                best = (found, error);
            }
        }
        (best.0, best.1.max(0.0))
    }

    /// Solves the normal equations of some columns. `None` if they depend on each other.
    fn solve_columns(&self, used: &[usize]) -> Option<[f64; MAX_MODES + 1]> {
        let products = DMatrix::from_fn(used.len(), used.len(), |j, k| self.products[used[j]][used[k]]);
        let factors = products.clone().cholesky()?;
        let lower = factors.l_dirty();
        // What the columns before it leave of a column.
        if (0..used.len()).any(|k| lower[(k, k)] * lower[(k, k)] <= 1e-10 * products[(k, k)]) {
            return None;
        }
        let found = factors.solve(&DVector::from_fn(used.len(), |k, _| self.with_force[used[k]]));
        let mut placed = [0.0; MAX_MODES + 1];
        used.iter().zip(&found).for_each(|(k, value)| placed[*k] = *value);
        placed.iter().all(|value| value.is_finite()).then_some(placed)
    }

    fn merge(&mut self, other: &Self) {
        for j in 0..=MAX_MODES {
            for k in 0..=MAX_MODES {
                self.products[j][k] += other.products[j][k];
            }
            self.with_force[j] += other.with_force[j];
        }
        self.force_square += other.force_square;
    }
}

impl<'a> FitSession<'a> {
    fn new(motions: &'a Motions, fits_zero: bool) -> Self {
        let held = motions.motions.iter().filter(|motion| motion.hold_s() > 0.0);
        let longest = held.map(Motion::duration_s).fold(0.0, f64::max);
        let steps = motions
            .motions
            .iter()
            .filter(|motion| motion.has_times)
            .flat_map(|motion| motion.moments.windows(2).map(|pair| pair[1].time_s - pair[0].time_s));
        let shortest = steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
        Self {
            motions: &motions.motions,
            fits_zero: fits_zero && motions.deepest_measured_mm() > 0.0,
            groups: motions.motions.len().min(MAX_GROUPS),
            deepest_mm: motions.deepest_measured_mm(),
            times_s: [shortest.min(longest).max(1e-9), longest.max(1e-9)],
            histories: motions.motions.par_iter().map(|motion| motion.history(0.0)).collect(),
        }
    }

    fn held(&self) -> usize {
        self.motions.iter().filter(|motion| motion.hold_s() > 0.0).count()
    }

    fn forces(&self, solution: &Solution) -> Vec<Vec<f64>> {
        let Solution { youngs_modulus_kpa, relaxation, zero_mm } = solution;
        self.motions.iter().map(|motion| motion.forces_n(*youngs_modulus_kpa, relaxation, *zero_mm)).collect()
    }

    fn initial_weights(&self) -> Vec<Vec<f64>> {
        let measured = |motion: &Motion| motion.moments.iter().map(|moment| moment.force_n.max(0.0)).collect();
        self.weights(&self.motions.iter().map(measured).collect::<Vec<Vec<f64>>>())
    }

    /// Returns the weights of rows with these forces.
    fn weights(&self, forces: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let largest = forces.iter().flatten().copied().fold(0.0, f64::max);
        let floor = (FLOOR_SHARE * largest).max(1e-12);
        let weight = |rows: usize| move |force: &f64| 1.0 / (rows as f64 * (force * force + floor * floor));
        forces.iter().map(|press| press.iter().map(weight(press.len())).collect()).collect()
    }

    fn zero_of(&self, searched: &[f64]) -> f64 {
        if self.fits_zero { searched[0].clamp(-MOST_ZERO_SHARE, MOST_ZERO_SHARE) * self.deepest_mm } else { 0.0 }
    }

    fn times_of(&self, searched: &[f64]) -> Vec<f64> {
        let [shortest, longest] = self.times_s;
        let logs = &searched[usize::from(self.fits_zero)..];
        logs.iter().map(|log| libm::exp(*log).clamp(0.5 * shortest, 3.0 * longest)).collect()
    }

    /// Returns the sums of a press.
    fn gram_of(&self, press: usize, history: &History, times_s: &[f64], weights: &[f64]) -> Gram {
        let motion = &self.motions[press];
        let relaxed: Vec<Vec<f64>> = times_s
            .iter()
            .map(|time_s| if motion.has_times { history.relaxed(*time_s) } else { vec![0.0; history.elastic.len()] })
            .collect();
        let mut gram = Gram::default();
        for (k, (moment, weight)) in motion.moments.iter().zip(weights).enumerate() {
            let mut row = [0.0; MAX_MODES + 1];
            // Modulus times (1 - sum of shares) and modulus times each share, all of them at least 0, so that the
            // shares never exceed 1.
            row[0] = 1e-3 * history.elastic[k];
            for (mode, relaxed) in relaxed.iter().enumerate() {
                row[mode + 1] = 1e-3 * (history.elastic[k] - relaxed[k]);
            }
            gram.add(row, moment.force_n, *weight);
        }
        gram
    }

    /// Returns the sums of all presses but those of the group `without`.
    fn gram(&self, searched: &[f64], weights: &[Vec<f64>], without: Option<usize>) -> Gram {
        let (zero_mm, times_s) = (self.zero_of(searched), self.times_of(searched));
        let mut sum = Gram::default();
        for press in (0..self.motions.len()).filter(|press| Some(press % self.groups) != without) {
            let moved = (zero_mm != 0.0).then(|| self.motions[press].history(zero_mm));
            let history = moved.as_ref().unwrap_or(&self.histories[press]);
            sum.merge(&self.gram_of(press, history, &times_s, &weights[press]));
        }
        sum
    }

    /// Searches from a start for the values of the least error.
    fn search(&self, start: Searched, weights: &[Vec<f64>], without: Option<usize>) -> Searched {
        if start.is_empty() {
            return start;
        }
        let columns = 1 + start.len() - usize::from(self.fits_zero);
        let steps: Vec<f64> = (0..start.len()).map(|k| if k == 0 && self.fits_zero { 0.03 } else { 0.3 }).collect();
        minimise(start, &steps, |searched| {
            let times = self.times_of(searched);
            let close = matches!(times[..], [a, b] if (a / b).max(b / a) < LEAST_RATIO);
            if close { f64::INFINITY } else { self.gram(searched, weights, without).solve(columns).1 }
        })
    }

    fn to_solution(&self, searched: &[f64], weights: &[Vec<f64>], without: Option<usize>) -> Solution {
        let times_s = self.times_of(searched);
        let (factors, _) = self.gram(searched, weights, without).solve(1 + times_s.len());
        let youngs_modulus_kpa: f64 = factors.iter().sum();
        let mut relaxation: Vec<RelaxationMode> = times_s
            .iter()
            .zip(&factors[1..])
            .map(|(time_s, factor)| RelaxationMode {
                share: if youngs_modulus_kpa > 0.0 { factor / youngs_modulus_kpa } else { 0.0 },
                time_s: *time_s,
            })
            .collect();
        relaxation.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Solution { youngs_modulus_kpa, relaxation, zero_mm: self.zero_of(searched) }
    }

    /// Returns times of relaxation from which a search with `modes` modes begins.
    fn start_times(&self, modes: usize, weights: &[Vec<f64>]) -> Vec<f64> {
        let [shortest, longest] = self.times_s;
        let ratio = libm::pow((longest / shortest).max(1.0), 1.0 / (GRID_TIMES - 1) as f64);
        let times: Vec<f64> = (0..GRID_TIMES).map(|k| shortest * libm::pow(ratio, k as f64)).collect();
        let choices: Vec<Vec<f64>> = match modes {
            0 => return Vec::new(),
            1 => times.iter().map(|time| vec![*time]).collect(),
            _ => times
                .iter()
                .enumerate()
                .flat_map(|(k, short)| times[k + 1..].iter().map(|long| vec![*short, *long]))
                .filter(|pair| pair[1] >= LEAST_RATIO * pair[0])
                .collect(),
        };
        let errors: Vec<f64> = choices
            .par_iter()
            .map(|times| {
                let mut sum = Gram::default();
                for (press, history) in self.histories.iter().enumerate() {
                    sum.merge(&self.gram_of(press, history, times, &weights[press]));
                }
                sum.solve(1 + modes).1
            })
            .collect();
        let best = (0..choices.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b]));
        best.map_or_else(|| (0..modes).map(|k| shortest * libm::pow(3.0, k as f64)).collect(), |k| choices[k].clone())
    }

    fn fit_modes(&self, modes: usize, weights: &[Vec<f64>]) -> Fits {
        let times = self.start_times(modes, weights);
        let zero = self.fits_zero.then_some(0.0);
        self.fit_from(zero.into_iter().chain(times.into_iter().map(libm::log)).collect(), weights)
    }

    fn refit(&self, fits: &Fits, weights: &[Vec<f64>]) -> Fits {
        let Solution { relaxation, zero_mm, .. } = &fits.whole;
        let zero = self.fits_zero.then(|| zero_mm / self.deepest_mm);
        self.fit_from(zero.into_iter().chain(relaxation.iter().map(|mode| libm::log(mode.time_s))).collect(), weights)
    }

    fn fit_from(&self, start: Searched, weights: &[Vec<f64>]) -> Fits {
        let modes = start.len() - usize::from(self.fits_zero);
        let searched = self.search(start, weights, None);
        let without = if self.motions.len() < 2 { 0 } else { self.groups };
        let without = (0..without)
            .into_par_iter()
            .map(|group| {
                let searched = self.search(searched.clone(), weights, Some(group));
                self.to_solution(&searched, weights, Some(group))
            })
            .collect();
        Fits { modes, whole: self.to_solution(&searched, weights, None), without }
    }

    /// Returns the held-out errors of the groups.
    fn held_out_errors(&self, fits: &Fits, weights: &[Vec<f64>]) -> Vec<f64> {
        let mut errors = vec![0.0; fits.without.len()];
        for (press, motion) in self.motions.iter().enumerate() {
            let group = press % self.groups;
            let Some(Solution { youngs_modulus_kpa, relaxation, zero_mm }) = fits.without.get(group) else { continue };
            let forces = motion.forces_n(*youngs_modulus_kpa, relaxation, *zero_mm);
            for ((moment, force), weight) in motion.moments.iter().zip(forces).zip(&weights[press]) {
                errors[group] += weight * (moment.force_n - force) * (moment.force_n - force);
            }
        }
        errors
    }

    /// Returns true if more modes predict groups that were left out clearly better.
    fn is_better(&self, more: &Fits, fewer: &Fits, weights: &[Vec<f64>]) -> bool {
        if more.whole.relaxation.iter().any(|mode| mode.share < LEAST_SHARE) {
            return false;
        }
        let (more, fewer) = (self.held_out_errors(more, weights), self.held_out_errors(fewer, weights));
        let count = more.len() as f64;
        if count < 2.0 {
            return false;
        }
        let gains: Vec<f64> = fewer.iter().zip(&more).map(|(fewer, more)| fewer - more).collect();
        let mean = gains.iter().sum::<f64>() / count;
        let square = gains.iter().map(|gain| (gain - mean) * (gain - mean)).sum::<f64>();
        let error = (square / (count * (count - 1.0))).sqrt();
        mean > error && mean > LEAST_GAIN * fewer.iter().sum::<f64>() / count
    }

    fn describe(&self, fits: Fits, none: Option<NoRelaxation>) -> ElasticFit {
        let mut names = vec![String::from("gelpad_youngs_modulus_kpa")];
        for k in 0..fits.modes {
            names.push(format!("gelpad_relaxation.{k}.share"));
            names.push(format!("gelpad_relaxation.{k}.time_s"));
        }
        if self.fits_zero {
            names.push(String::from("zero_mm"));
        }
        let values_of = |solution: &Solution| -> Vec<f64> {
            let modes = solution.relaxation.iter().flat_map(|mode| [mode.share, mode.time_s]);
            let zero = self.fits_zero.then_some(solution.zero_mm);
            [solution.youngs_modulus_kpa].into_iter().chain(modes).chain(zero).collect()
        };
        let replicates: Vec<Vec<f64>> = fits.without.iter().map(values_of).collect();
        let covariance = if self.motions.len() < 3 { Vec::new() } else { jackknife(&replicates) };
        let fitted = self.forces(&fits.whole);
        let presses = self.motions.iter().zip(fitted).enumerate().map(|(press, (motion, fitted_n))| {
            let measured_n: Vec<f64> = motion.moments.iter().map(|moment| moment.force_n).collect();
            let held_out_n = fits
                .without
                .get(press % self.groups)
                .map(|solution| motion.forces_n(solution.youngs_modulus_kpa, &solution.relaxation, solution.zero_mm));
            let held_out_n = held_out_n.unwrap_or_default();
            let expected = if held_out_n.is_empty() { &fitted_n } else { &held_out_n };
            let (mut product, mut square) = (0.0, 0.0);
            for (measured, expected) in measured_n.iter().zip(expected) {
                product += measured * expected;
                square += expected * expected;
            }
            let factor = if square > 0.0 { product / square } else { 1.0 };
            PressResult { name: motion.name.clone(), measured_n, fitted_n, held_out_n, factor }
        });
        let no_relaxation = none.or((fits.modes == 0).then_some(NoRelaxation::NotFound));
        ElasticFit {
            no_relaxation,
            names,
            values: values_of(&fits.whole),
            covariance,
            presses: presses.collect(),
            solution: fits.whole,
        }
    }
}

/// Returns the covariances of values from those without each group.
pub fn jackknife(replicates: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let count = replicates.len() as f64;
    let width = replicates.first().map_or(0, Vec::len);
    let means: Vec<f64> = (0..width).map(|k| replicates.iter().map(|values| values[k]).sum::<f64>() / count).collect();
    let covariance = |j: usize, k: usize| {
        let sum: f64 = replicates.iter().map(|values| (values[j] - means[j]) * (values[k] - means[k])).sum();
        (count - 1.0) / count * sum
    };
    (0..width).map(|j| (0..width).map(|k| covariance(j, k)).collect()).collect()
}
