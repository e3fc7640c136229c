//! Chooses the fidelity level for a job that names an error bound: renders some of its samples at every level.
//!
//! An error bound must hold also for samples that are not rendered. For one object, a level's error grows with the
//! depth by a power law, and poses scatter around it. This model is fitted to samples of every object, its deepest
//! among them, and gives the share of all samples that is expected above the bound.

use std::collections::BTreeMap;
use std::fmt;

use rayon::prelude::*;

use super::strata::{DrawnSample, choose_stratified, draw_samples, find_deepest_of_each, spread_samples};
use crate::metrics::statistics::median;
use crate::metrics::surface::height_error_um;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::optics::LightSource;
use gelsim_files::diagnostic::Report;
use gelsim_files::diagnostic::user_error;
use gelsim_job::config::fidelity::FidelityChoice;
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;

/// Number of samples whose time is measured.
const TIMED_SAMPLES: usize = 8;

/// Number of probes of each object besides its deepest press, and the least and the largest number of all together.
const PROBES: (usize, usize, usize) = (3, 16, 100);

/// Largest share of the samples that may be expected beyond a bound.
const MAX_SHARE_BEYOND: f64 = 0.01;

/// Smallest error that counts, um: smaller ones are rounding.
const MIN_ERROR_UM: f64 = 1e-3;

/// A fidelity level with its measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenLevel {
    /// The fidelity level.
    pub level: Fidelity,
    /// Height error of its surface against the reference's, um: root mean square over the view, for the worst of the
    /// probes.
    pub error_um: f64,
    /// Number of samples that were rendered.
    pub probes: usize,
    /// Share of the job's samples that is expected above the bound, 0 to 1; 0 if the bound is a time.
    pub share_beyond: f64,
    /// CPU time of a sample, ms, median.
    pub ms: f64,
}

impl fmt::Display for ChosenLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { level, error_um, probes, share_beyond: beyond, ms } = self;
        write!(
            f,
            "fidelity {} chosen: {error_um:.2} um from the reference in the worst of {probes} samples, ",
            level.name()
        )?;
        if *beyond > 0.0 {
            write!(f, "{:.1} % of all expected above the bound, ", 100.0 * beyond)?;
        }
        write!(f, "{ms:.1} ms a sample")
    }
}

/// Chooses the fidelity level for the bound of the plan's job: the first level within the error, or the most exact one
/// within the time. Fails if no level keeps the bound.
pub fn choose_level(plan: &Plan, bound: FidelityChoice) -> Result<ChosenLevel, Report> {
    let all = draw_samples(plan);
    let chosen = match bound {
        FidelityChoice::MaxErrorUm(_) => choose_probes(&all),
        _ => choose_stratified(&all, TIMED_SAMPLES),
    };
    let timed: Vec<u64> = spread_samples(chosen.len() as u64, TIMED_SAMPLES as u64);
    // Leave out levels that the job could not name: models that compute less than it needs.
    let fits = |level: &Fidelity| {
        let gelpad = level.models(LightSource::Leds).gelpad;
        // The bounds are distances from the reference, which is linear.
        gelpad.strain_settings().is_none()
            && (!plan.solves_contact() || (gelpad.knows_pressure() && gelpad.knows_tractions()))
    };
    let levels: Vec<Fidelity> = Fidelity::ALL.into_iter().filter(fits).collect();
    let surface = |plan: &Plan, at: usize| render(plan, all[at].index).impression.contact.surface;
    let reference = plan.with_fidelity(Fidelity::Reference);
    let exact: Vec<_> = chosen.par_iter().map(|at| surface(&reference, *at)).collect();
    let mut measured = Vec::new();
    for level in levels {
        let plan = plan.with_fidelity(level);
        let error_um = |(at, exact): (&usize, _)| {
            let um = height_error_um(&surface(&plan, *at), exact).0;
            (*at, if um.is_nan() { f64::INFINITY } else { um })
        };
        let errors: BTreeMap<usize, f64> = chosen.par_iter().zip(&exact).map(error_um).collect();
        // The renders above warmed caches and buffers, so these times are comparable.
        let ms = |k: &u64| 1e3 * render(&plan, all[chosen[*k as usize]].index).seconds.simulation();
        let ms: Vec<f64> = timed.iter().map(ms).collect();
        let worst_um = errors.values().copied().fold(0.0, f64::max);
        let mut found = ChosenLevel {
            level,
            error_um: worst_um,
            probes: chosen.len(),
            share_beyond: 0.0,
            ms: median(&ms).unwrap_or(0.0),
        };
        if let FidelityChoice::MaxErrorUm(um) = bound
            && worst_um <= um
        {
            found.share_beyond = share_beyond(&all, &errors, um);
            if found.share_beyond <= MAX_SHARE_BEYOND {
                return Ok(found);
            }
        }
        measured.push(found);
    }
    match bound {
        FidelityChoice::MaxMs(ms) => measured.iter().rev().find(|found| found.ms <= ms).copied(),
        _ => None,
    }
    .ok_or_else(|| report_refusal(bound, &measured))
}

/// Chooses the samples to render for an error bound, as places in `all`.
fn choose_probes(all: &[DrawnSample]) -> Vec<usize> {
    let deepest = find_deepest_of_each(all);
    let (of_each, fewest, most) = PROBES;
    let mut chosen = choose_stratified(all, (of_each * deepest.len()).clamp(fewest, most));
    let seen = |object: usize| chosen.iter().any(|at| all[*at].object == object);
    let deepest: Vec<usize> = deepest.into_iter().filter(|at| seen(all[*at].object)).collect();
    chosen.extend(deepest);
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// Model of a level's errors over the depth, in natural logarithms: one line per object with a common slope.
struct ErrorModel {
    /// For each probed object: mean depth, mean error, number of probes.
    objects: BTreeMap<usize, [f64; 3]>,
    slope: f64,
    /// Variance around the lines.
    scatter: f64,
}

impl ErrorModel {
    fn fit(all: &[DrawnSample], errors: &BTreeMap<usize, f64>) -> Self {
        let points: Vec<(usize, f64, f64)> = errors
            .iter()
            .map(|(at, um)| (all[*at], um))
            .filter(|(sample, _)| sample.depth_mm > 0.0)
            .map(|(sample, um)| (sample.object, libm::log(sample.depth_mm), libm::log(um.max(MIN_ERROR_UM))))
            .collect();
        let mut objects: BTreeMap<usize, [f64; 3]> = BTreeMap::new();
        for (object, depth, error) in &points {
            let sums = objects.entry(*object).or_default();
            *sums = [sums[0] + depth, sums[1] + error, sums[2] + 1.0];
        }
        for [depth, error, count] in objects.values_mut() {
            (*depth, *error) = (*depth / *count, *error / *count);
        }
        let about = |(object, depth, error): &(usize, f64, f64)| {
            let [mean_depth, mean_error, _] = objects[object];
            (depth - mean_depth, error - mean_error)
        };
        let (mut depths, mut products) = (0.0, 0.0);
        for (depth, error) in points.iter().map(about) {
            (depths, products) = (depths + depth * depth, products + depth * error);
        }
        let slope = if depths > 0.0 { products / depths } else { 0.0 };
        // Degrees of freedom: a mean for each object, and the slope if there is one.
        let squares: f64 = points.iter().map(about).map(|(depth, error)| (error - slope * depth).powi(2)).sum();
        let fitted = objects.len() + usize::from(depths > 0.0);
        let scatter = squares / points.len().saturating_sub(fitted).max(1) as f64;
        Self { objects, slope, scatter }
    }

    /// Probability that a sample's error exceeds `bound_um`.
    fn probability_beyond(&self, sample: DrawnSample, bound_um: f64) -> f64 {
        if sample.depth_mm <= 0.0 {
            return 0.0;
        }
        let depth = libm::log(sample.depth_mm);
        let expected = |[mean_depth, mean_error, _]: &[f64; 3]| mean_error + self.slope * (depth - mean_depth);
        let (mean, variance) = match self.objects.get(&sample.object) {
            Some(object) => (expected(object), self.scatter * (1.0 + 1.0 / object[2])),
            // An object without probes: like the mean of the others, with the variance between them.
            None => {
                let others: Vec<f64> = self.objects.values().map(expected).collect();
                let count = others.len().max(1) as f64;
                let mean = others.iter().sum::<f64>() / count;
                let between = others.iter().map(|other| (other - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
                (mean, self.scatter + between)
            }
        };
        let short = mean - libm::log(bound_um);
        if variance > 0.0 { 0.5 * libm::erfc(-short / (2.0 * variance).sqrt()) } else { f64::from(short > 0.0) }
    }
}

/// Share of `all` samples whose error exceeds `bound_um`: as measured where it was (`errors`, um), as the model expects
/// elsewhere.
fn share_beyond(all: &[DrawnSample], errors: &BTreeMap<usize, f64>, bound_um: f64) -> f64 {
    let model = ErrorModel::fit(all, errors);
    let beyond = |(at, sample): (usize, &DrawnSample)| match errors.get(&at) {
        Some(um) => f64::from(*um > bound_um),
        None => model.probability_beyond(*sample, bound_um),
    };
    all.iter().enumerate().map(beyond).sum::<f64>() / all.len().max(1) as f64
}

/// Returns the error for a bound that no level keeps, with what was measured.
fn report_refusal(bound: FidelityChoice, measured: &[ChosenLevel]) -> Report {
    let levels: Vec<String> = measured
        .iter()
        .map(|found| format!("{} {:.1} ms, {:.2} um", found.level.name(), found.ms, found.error_um))
        .collect();
    let what = match bound {
        FidelityChoice::MaxMs(ms) => format!("no fidelity level renders a sample of this job in {ms} ms"),
        _ => String::from("no fidelity level is exact enough for this job"),
    };
    // Suggest twice the time of the quickest level, so that it holds on a busy machine, too.
    let cheapest = measured.iter().map(|found| found.ms).fold(f64::INFINITY, f64::min);
    let bound = match bound {
        FidelityChoice::MaxMs(_) if cheapest.is_finite() => {
            format!("allow more, for example fidelity = {{ max_ms = {:.1} }}, or ", (2.0 * cheapest).max(0.1))
        }
        _ => String::new(),
    };
    let named = measured.last().map_or("LEVEL", |found| found.level.name());
    user_error(what, format!("{bound}name a level, for example --fidelity {named}; measured: {}", levels.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::base::rng;

    /// Errors of `samples` presses of objects in turn: the power law of each object, scattered by a factor of e^0.3.
    fn job(samples: u64, objects: usize, seed: u64) -> (Vec<DrawnSample>, Vec<f64>) {
        let mut random = rng::random_stream(seed, "errors", 0);
        let all: Vec<DrawnSample> = (0..samples)
            .map(|index| {
                let depth_mm = 0.3 * libm::pow(4.0, random.uniform());
                DrawnSample { index, object: index as usize % objects, depth_mm }
            })
            .collect();
        let error = |sample: &DrawnSample, scatter: f64| {
            libm::exp(0.5 * sample.object as f64 + 0.3 * scatter) * sample.depth_mm
        };
        // Twelve uniform numbers make a normal one.
        let errors =
            all.iter().map(|sample| error(sample, (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0)).collect();
        (all, errors)
    }

    #[test]
    fn the_share_beyond_a_bound_is_foreseen() {
        let mut seen = 0;
        for seed in 0..20 {
            let (all, errors) = job(400, 5, seed);
            let found: BTreeMap<usize, f64> = choose_probes(&all).into_iter().map(|at| (at, errors[at])).collect();
            assert!(found.len() <= 20, "{} probes", found.len());
            for bound in [2.0, 4.0, 6.0, 9.0, 12.0] {
                let foreseen = share_beyond(&all, &found, bound);
                let beyond = errors.iter().filter(|um| **um > bound).count() as f64 / 400.0;
                assert!((foreseen - beyond).abs() < 0.1, "{foreseen} for {beyond} beyond {bound}, seed {seed}");
                // The level would be accepted.
                if foreseen <= MAX_SHARE_BEYOND && found.values().all(|um| *um <= bound) {
                    assert!(beyond <= 0.02, "{beyond} beyond {bound}, seed {seed}");
                    seen += 1;
                }
            }
        }
        assert!(seen >= 10, "{seen} bounds were accepted");
    }

    #[test]
    fn samples_that_were_all_rendered_need_no_law() {
        let (all, errors) = job(12, 3, 1);
        let found: BTreeMap<usize, f64> = errors.iter().copied().enumerate().collect();
        for bound in &errors {
            let beyond = errors.iter().filter(|um| *um > bound).count() as f64 / 12.0;
            assert_eq!(share_beyond(&all, &found, *bound), beyond);
        }
    }

    #[test]
    fn objects_without_a_probe_are_taken_to_be_like_the_others() {
        let (all, errors) = job(400, 5, 3);
        let of = |objects: &dyn Fn(usize) -> bool| -> BTreeMap<usize, f64> {
            let chosen = choose_probes(&all).into_iter().filter(|at| objects(all[*at].object));
            chosen.map(|at| (at, errors[at])).collect()
        };
        let some = share_beyond(&all, &of(&|object| object != 4), 8.0);
        let every = share_beyond(&all, &of(&|_| true), 8.0);
        assert!(some > 0.0 && some < 0.5 && every > 0.0, "{some}, {every}");
        // No error at all, of no depth or of rounding only.
        let nothing: BTreeMap<usize, f64> = choose_probes(&all).into_iter().map(|at| (at, 0.0)).collect();
        assert_eq!(share_beyond(&all, &nothing, 1.0), 0.0);
        let flat: Vec<DrawnSample> = all.iter().map(|sample| DrawnSample { depth_mm: 0.0, ..*sample }).collect();
        assert_eq!(share_beyond(&flat, &BTreeMap::from([(0, 0.0)]), 1.0), 0.0);
    }
}
