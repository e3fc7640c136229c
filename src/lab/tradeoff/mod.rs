//! What accuracy costs in time: compares the fidelity levels on a job's own samples.
//!
//! Every fidelity level renders the same samples, and its CPU time is measured on one thread. Its surfaces, images, areas
//! and forces are compared twice: with those of the reference level, whose difference from a linear level is numerical
//! error, and with those of finite strain, which is the total error. Where finite strain is not solved for, the total
//! error is the numerical one and the theory's that labels expect. Further studies show how far the reference itself can
//! be trusted (a grid twice as fine, solver tolerances), and what other models and leaving out an effect would change.

use std::sync::Arc;

use serde::Serialize;

use crate::metrics::statistics::{median, pareto_front, quantile};
use crate::metrics::surface::RING_MM;
use crate::metrics::{distance, image};
use gelsim_core::base::clock::Seconds;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::grid::Resolution;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::base::view::View;
use gelsim_core::depth::{self, CaptureWindow};
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::finite_strain::WITHIN_TOLERANCE;
use gelsim_core::gelpad::gaussian::Gaussian;
use gelsim_core::gelpad::no_deformation::NoDeformation;
use gelsim_core::gelpad::{Contact, Model, Pad, Theory};
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use gelsim_job::scene::Scene;

pub mod choose;
mod errors;
pub mod plot;
pub mod report;
pub mod sequences;
pub mod strata;

use errors::{MeanErrors, SampleErrors, expected_model_um};

/// Number of samples for the studies besides the fidelity levels.
const STUDY_SAMPLES: u64 = 8;

/// Time of a sample, s, from which on it is rendered only once.
const SLOW_S: f64 = 0.1;

/// Share of the pad's thickness by which the edges of an object may be rounded in a truth. With more, finite strain
/// misses most of the error beside walls (docs/explanation/finite-strain.md).
const MAX_ROUNDING: f64 = 0.1;

/// Name of the level `standard` with the correction for large strains.
pub const CORRECTED: &str = "standard + strain";

/// Distances of the surfaces of finite strain from finite elements within 2 mm of the contact, um, root mean square
/// (docs/evidence/finite-strain.md): under balls 0.3 to 0.5 of the thickness deep, beside walls 0.2 to 0.3 deep.
pub const TRUTH_ERRORS_UM: [(&str, [f64; 2]); 2] = [("balls", [0.2, 1.6]), ("walls", [1.3, 9.0])];

/// All measurements.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Tradeoff {
    /// Name of the job.
    pub job: String,
    /// Numbers of the samples that were rendered.
    pub samples: Vec<u64>,
    /// True if total errors are measured against finite strain, false if the theory's part is what labels expect.
    pub measured: bool,
    /// Samples of which finite strain knows no more than linear theory. Total errors are those of the others.
    pub without_truth: Vec<WithoutTruth>,
    /// The fidelity levels, from cheap to exact.
    #[serde(rename = "rungs")]
    pub levels: Vec<LevelRow>,
    /// The fidelity levels for each object.
    pub objects: Vec<ObjectRows>,
    /// The reference level on grids of other sizes against one twice as fine as the camera's.
    pub grids: Vec<GridRow>,
    /// The solver on the camera's grid at other tolerances.
    pub tolerances: Vec<LevelRow>,
    /// Gelpad models that are no fidelity level.
    pub models: Vec<LevelRow>,
    /// What the light of the reference level is expected to leave out, the most first.
    pub light: Vec<LightLeftOut>,
    /// Why that is not known; empty if it is.
    pub light_unknown: String,
    /// The reference with one effect left out, for each effect.
    pub left_out: Vec<EffectAblation>,
}

/// A part of the light that a model leaves out.
#[derive(Clone, Debug, Serialize)]
pub struct LightLeftOut {
    /// What is left out.
    pub what: String,
    /// Expected error of the image in the contact and 1 mm around it, grey levels, mean over the samples in contact.
    pub levels: f64,
    /// What a job writes so that it is computed; empty if nothing helps.
    pub remedy: String,
}

/// A sample that has no measured total error.
#[derive(Clone, Debug, Serialize)]
pub struct WithoutTruth {
    /// Number of the sample.
    pub sample: u64,
    /// Why finite strain was not solved for.
    pub reason: String,
}

/// A choice of models, its errors, and its cost.
#[derive(Clone, Debug, Default, Serialize)]
pub struct LevelRow {
    /// Name of the fidelity level, or what was changed.
    #[serde(rename = "rung")]
    pub level: String,
    /// Errors against the reference level over all samples.
    #[serde(flatten)]
    pub errors: MeanErrors,
    /// Error that the reference's own theory is expected to have, um: the largest within 2 mm of the contact, mean over
    /// the samples for which it is known.
    pub model_error_um: f64,
    /// Root mean square of that error over the view, um.
    pub model_rms_um: f64,
    /// Total height error over the view, um, root mean square: as measured, or the root of the sum of the squares of
    /// `height_rms_um` and `model_rms_um`. None in studies, and if no sample has a measured one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total_rms_um: Option<f64>,
    /// Errors against finite strain, over the samples in which it was solved for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total: Option<MeanErrors>,
    /// `height_rms_um` over the same samples as `total`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total_numerics_rms_um: Option<f64>,
    /// CPU time of a sample without writing files, ms, median.
    pub cpu_ms_median: f64,
    /// CPU time of a sample, ms, 95th percentile.
    pub cpu_ms_p95: f64,
    /// Medians per stage, s; no files are encoded.
    pub seconds: Seconds,
    /// True if no other row is both quicker and closer: in its measured total error, or to the reference's surface.
    pub pareto: bool,
}

impl LevelRow {
    /// Returns the height error by which levels are chosen, um: the measured total error, else that against the
    /// reference.
    pub fn deciding_um(&self, measured: bool) -> f64 {
        if measured { self.total_rms_um.unwrap_or(f64::NAN) } else { self.errors.height_rms_um }
    }
}

/// The fidelity levels for one object.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ObjectRows {
    /// Name of the object.
    pub object: String,
    /// The fidelity levels.
    #[serde(rename = "rungs")]
    pub levels: Vec<LevelRow>,
}

/// The reference level on a grid of another size.
#[derive(Clone, Debug, Default, Serialize)]
pub struct GridRow {
    /// Pixels per pixel of the camera along x and y.
    pub per_px: f64,
    /// Height error against the finest grid's surface over the view, um, root mean square.
    pub height_rms_um: f64,
    /// Largest height error against the finest grid's surface, um.
    pub height_max_um: f64,
    /// Height error within 2 mm outside the contact, um, root mean square.
    pub ring_rms_um: f64,
}

/// The reference without one effect.
#[derive(Clone, Debug, Serialize)]
pub struct EffectAblation {
    /// Name of the effect.
    pub effect: String,
    /// Number of studied samples in which the effect runs.
    pub samples: usize,
    /// Mean absolute difference of the images, grey levels.
    pub image_mae: f64,
    /// Largest difference, grey levels.
    pub image_max: u8,
    /// CPU time by which a sample takes longer with the effect, ms, median; below 0 is noise.
    pub cpu_ms: f64,
}

/// Compares all fidelity levels that a job may have on `count` of its samples. Calls `progress` with what is done next.
pub fn measure_tradeoff(plan: &Plan, count: u64, progress: impl Fn(&str)) -> Tradeoff {
    let drawn = strata::draw_samples(plan);
    let chosen = |count: u64| -> Vec<u64> {
        strata::choose_stratified(&drawn, count as usize).iter().map(|at| drawn[*at].index).collect()
    };
    let samples = chosen(count);
    let measure = |name: &str, plan: &Plan| {
        progress(name);
        LevelMeasurement::new(plan, &samples)
    };
    let measure_level = |level: Fidelity| measure(level.name(), &plan.with_fidelity(level));
    let reference = measure_level(Fidelity::Reference);
    let strained = plan.allows_level(Fidelity::FiniteStrain).then(|| measure_level(Fidelity::FiniteStrain));
    let missing = strained.iter().flat_map(|truth| samples.iter().zip(&truth.samples));
    let missing = missing.filter_map(|(sample, truth)| Some((*sample, reason_without_truth(truth)?)));
    let without_truth: Vec<_> =
        missing.map(|(sample, reason)| WithoutTruth { sample, reason: reason.to_owned() }).collect();
    let total = match &strained {
        Some(truth) if without_truth.len() < samples.len() => Total::Measured(truth),
        _ => Total::Expected,
    };
    let compare = |name: &str, own: &LevelMeasurement| own.compare_with(name, &reference, total);
    let linear = Fidelity::ALL.into_iter().filter(|level| *level != Fidelity::FiniteStrain);
    let mut compared: Vec<LevelComparison> = linear
        .map(|level| match level {
            Fidelity::Reference => compare(level.name(), &reference),
            _ => compare(level.name(), &measure_level(level)),
        })
        .collect();
    if let Some(truth) = &strained {
        let corrected = measure(CORRECTED, &correct_strain(&plan.with_fidelity(Fidelity::Standard)));
        compared.push(compare(CORRECTED, &corrected));
        compared.push(compare(Fidelity::FiniteStrain.name(), truth));
    }
    let everything: Vec<usize> = (0..samples.len()).collect();
    let levels = build_rows(&compared, &everything);
    let objects = plan.sampling.objects.iter().filter_map(|object| {
        let of_object = |k: &usize| reference.samples[*k].label.header.object.id == object.id;
        let own: Vec<usize> = everything.iter().copied().filter(of_object).collect();
        (!own.is_empty()).then(|| ObjectRows { object: object.id.clone(), levels: build_rows(&compared, &own) })
    });
    let objects = objects.collect();

    let few = chosen(STUDY_SAMPLES.min(count));
    let exact = plan.with_fidelity(Fidelity::Reference);
    let exact_few = LevelMeasurement::new(&exact, &few);
    progress("other grids");
    let grids = compare_grids(&exact, &few);
    let study = |variants: Vec<(String, Model)>| {
        let measured: Vec<LevelComparison> = variants
            .into_iter()
            .map(|(name, gelpad)| {
                progress(&name);
                let models = Models { gelpad, optics: exact.simulator.models().optics.clone() };
                LevelMeasurement::new(&exact.with_models(models), &few).compare_with(&name, &exact_few, Total::Unasked)
            })
            .collect();
        build_rows(&measured, &(0..few.len()).collect::<Vec<_>>())
    };
    let friction = exact.simulator.models().gelpad.friction();
    let elastic = |resolution, tolerance_um| {
        let max_iterations = 1000;
        Model::Elastic(Elastic { resolution, tolerance_um, max_iterations, friction, ..Elastic::default() })
    };
    let tolerances = study(
        [30.0, 10.0, 3.0, 1.0, 0.3, 0.1]
            .into_iter()
            .map(|tolerance_um| (format!("full grid, {tolerance_um} um"), elastic(Resolution::Full, tolerance_um)))
            .collect(),
    );
    let models = study(vec![
        (String::from("none"), Model::None(NoDeformation::default())),
        (String::from("gaussian"), Model::Gaussian(Gaussian::default())),
        (String::from("quarter grid, 0.1 um"), elastic(Resolution::Quarter, 0.1)),
        (String::from("half grid, 10 um"), elastic(Resolution::Half, 10.0)),
        (String::from("half grid, 0.1 um"), elastic(Resolution::Half, 0.1)),
    ]);
    progress("effects left out");
    let left_out = ablate_effects(&exact, &exact_few, &few);
    Tradeoff {
        job: plan.name().to_owned(),
        measured: matches!(total, Total::Measured(_)),
        samples,
        without_truth,
        levels,
        objects,
        grids,
        tolerances,
        models,
        light: find_light_left_out(&exact, &reference.samples),
        light_unknown: exact.simulator.light_error().err().unwrap_or_default().to_owned(),
        left_out,
    }
}

/// Returns what the light of a plan leaves out of these samples, the most first; nothing if that is not known.
fn find_light_left_out(plan: &Plan, samples: &[Sample]) -> Vec<LightLeftOut> {
    let Ok(error) = plan.simulator.light_error() else { return Vec::new() };
    let touching: Vec<&Sample> = samples.iter().filter(|sample| sample.label.contact.in_contact).collect();
    let mut left_out: Vec<LightLeftOut> = Vec::new();
    for sample in &touching {
        let by_cause = error.levels_by_cause(&sample.impression.contact, plan.simulator.view());
        for (at, (cause, levels)) in by_cause.into_iter().enumerate() {
            let levels = levels / touching.len() as f64;
            match left_out.get_mut(at) {
                Some(row) => row.levels += levels,
                None => {
                    let remedy = cause.remedy().unwrap_or_default().to_owned();
                    left_out.push(LightLeftOut { what: cause.name().to_owned(), levels, remedy });
                }
            }
        }
    }
    left_out.sort_by(|a, b| b.levels.total_cmp(&a.levels));
    left_out
}

/// Returns a plan with the correction for large strains, if its gelpad model has one.
fn correct_strain(plan: &Plan) -> Plan {
    let mut models = plan.simulator.models().clone();
    if let Model::Elastic(elastic) = &mut models.gelpad {
        elastic.strain_correction = true;
    }
    plan.with_models(models)
}

/// Returns why a sample of the level finite-strain is no truth; `None` if it is one. Where linear theory is within the
/// tolerance, it is.
fn reason_without_truth(sample: &Sample) -> Option<&str> {
    let (label, strain) = (&sample.label, &sample.label.effects[Effect::FiniteStrain]);
    if label.numerics.opened_mm > MAX_ROUNDING * sample.simulator.sensor().gelpad.thickness_mm {
        return Some("the object's edges had to be rounded too much for rubber at finite strain");
    }
    let known = label.numerics.theory == Theory::FiniteStrain
        || !label.effects[Effect::Deformation].ran
        || strain.reason == WITHIN_TOLERANCE;
    (!known).then_some(&*strain.reason)
}

/// What the total error of a choice of models is.
#[derive(Clone, Copy)]
enum Total<'a> {
    /// The distance from finite strain, of samples in which that was solved for.
    Measured(&'a LevelMeasurement),
    /// The distance from the reference, and the error that labels expect of its theory.
    Expected,
    /// Nothing: only the distance from the reference counts.
    Unasked,
}

/// Samples that a plan renders, and their times.
struct LevelMeasurement {
    samples: Vec<Sample>,
    seconds: Vec<Seconds>,
}

impl LevelMeasurement {
    fn new(plan: &Plan, indices: &[u64]) -> Self {
        let (mut samples, mut seconds) = (Vec::new(), Vec::new());
        for index in indices {
            let mut sample = render(plan, *index);
            // Large, and not needed for any comparison.
            (sample.impression.depth.penetration, sample.impression.contact.pressure) = (Grid::default(), None);
            // The quicker of two runs: caches may be cold in the first one, which matters little to a slow one.
            let slow = sample.seconds.simulation() > SLOW_S;
            let again = if slow { sample.seconds } else { render(plan, *index).seconds };
            // A sample's own sensor is not needed either: share the plan's simulator instead.
            sample.simulator = Arc::clone(&plan.simulator);
            let first = sample.seconds;
            seconds.push(if again.simulation() < first.simulation() { again } else { first });
            samples.push(sample);
        }
        Self { samples, seconds }
    }

    fn compare_with(&self, name: &str, reference: &Self, total: Total<'_>) -> LevelComparison {
        let pairs = self.samples.iter().zip(&reference.samples);
        let errors: Vec<SampleErrors> = pairs.map(|(sample, exact)| SampleErrors::new(sample, exact)).collect();
        let measured = match total {
            Total::Measured(truth) => self
                .samples
                .iter()
                .zip(&truth.samples)
                .map(|(sample, truth)| reason_without_truth(truth).is_none().then(|| SampleErrors::new(sample, truth)))
                .collect(),
            Total::Expected | Total::Unasked => vec![None; errors.len()],
        };
        let (name, expected) = (name.to_owned(), matches!(total, Total::Expected));
        LevelComparison { name, errors, measured, expected, seconds: self.seconds.clone() }
    }
}

/// Errors of a choice of models, sample by sample.
struct LevelComparison {
    name: String,
    /// Against the reference.
    errors: Vec<SampleErrors>,
    /// Against finite strain.
    measured: Vec<Option<SampleErrors>>,
    /// Whether the total error includes what labels expect of the theory.
    expected: bool,
    seconds: Vec<Seconds>,
}

/// Builds one row for each choice of models, over the samples `chosen`.
fn build_rows(all: &[LevelComparison], chosen: &[usize]) -> Vec<LevelRow> {
    let row = |compared: &LevelComparison| {
        let seconds: Vec<&Seconds> = chosen.iter().map(|k| &compared.seconds[*k]).collect();
        let ms = |of: &dyn Fn(&Seconds) -> f64| seconds.iter().map(|all| 1e3 * of(all)).collect::<Vec<f64>>();
        let middle = |of: &dyn Fn(&Seconds) -> f64| median(&ms(of)).unwrap_or(0.0) * 1e-3;
        let simulation_ms = ms(&Seconds::simulation);
        let errors = MeanErrors::from_errors(chosen.iter().map(|k| &compared.errors[*k]));
        let [model_error_um, model_rms_um] = expected_model_um(chosen.iter().map(|k| &compared.errors[*k]));
        let measured = chosen.iter().filter_map(|k| compared.measured[*k].as_ref());
        let total = measured.clone().next().is_some().then(|| MeanErrors::from_errors(measured));
        let with_truth = chosen.iter().filter(|k| compared.measured[**k].is_some()).map(|k| &compared.errors[*k]);
        let numerics = total.map(|_| MeanErrors::from_errors(with_truth).height_rms_um);
        let expected_um = compared.expected.then(|| errors.height_rms_um.hypot(model_rms_um));
        LevelRow {
            level: compared.name.clone(),
            errors,
            model_error_um,
            model_rms_um,
            total_rms_um: total.as_ref().map(|total| total.height_rms_um).or(expected_um),
            total,
            total_numerics_rms_um: numerics,
            cpu_ms_median: median(&simulation_ms).unwrap_or(0.0),
            cpu_ms_p95: quantile(&simulation_ms, 0.95).unwrap_or(0.0),
            seconds: Seconds {
                scene: middle(&|all| all.scene),
                depth: middle(&|all| all.depth),
                gelpad: middle(&|all| all.gelpad),
                optics: middle(&|all| all.optics),
                camera: middle(&|all| all.camera),
                label: middle(&|all| all.label),
                encode: 0.0,
            },
            pareto: false,
        }
    };
    let mut rows: Vec<LevelRow> = all.iter().map(row).collect();
    let measured = rows.iter().any(|row| row.total.is_some());
    let points: Vec<(f64, f64)> = rows.iter().map(|row| (row.cpu_ms_median, row.deciding_um(measured))).collect();
    for (row, pareto) in rows.iter_mut().zip(pareto_front(&points)) {
        row.pareto = pareto;
    }
    rows
}

/// Presses sample `index` into a pad seen by another camera.
fn press_sample(plan: &Plan, index: u64, camera: &View, pad: &Pad) -> Contact {
    let scene = Scene::draw_pressed(plan, index, 0);
    let window = CaptureWindow { above_mm: plan.thickness_mm(), ..pad.capture_window(scene.deepest_mm()) };
    pad.press(&depth::capture_indenter(&scene.indenter(plan), camera, window, plan.thickness_mm()))
}

/// Compares the reference level on a grid half as fine as the camera's, and on the camera's own, with one twice as
/// fine. Every pixel's centre is also one of the finest grid's, so that nothing is interpolated.
fn compare_grids(plan: &Plan, indices: &[u64]) -> Vec<GridRow> {
    let View { resolution_px: [width, height], mm_per_px } = *plan.simulator.view();
    let grid = |resolution_px, factor: f64| {
        let camera = View { resolution_px, mm_per_px: mm_per_px.map(|own| own * factor) };
        let pad = Pad::new(&plan.simulator.models().gelpad, &plan.simulator.sensor().gelpad, &camera);
        (camera, pad)
    };
    let fine = grid([2 * width - 1, 2 * height - 1], 0.5);
    let own = (1, grid([width, height], 1.0), SquaredErrorSums::default());
    let mut compared = vec![own];
    if width >= 4 && height >= 4 {
        compared.insert(0, (2, grid([width / 2, height / 2], 2.0), SquaredErrorSums::default()));
    }
    for index in indices {
        let exact = press_sample(plan, *index, &fine.0, &fine.1);
        for (step, (camera, pad), sums) in &mut compared {
            let found = press_sample(plan, *index, camera, pad);
            let squares = distance::squared_distance_mm2(&found.mask, camera.mm_per_px);
            // Place of a pixel on the finest grid, whose middle is at (width - 1, height - 1).
            let [columns, rows] = camera.resolution_px;
            let fine_index = |x: usize, count: usize, size: usize| *step * (2 * x + 1) + size - 1 - *step * count;
            for y in 0..rows {
                for x in 0..columns {
                    let (column, row) = (fine_index(x, columns, width), fine_index(y, rows, height));
                    let exact = exact.surface.at(column + SURFACE_BORDER, row + SURFACE_BORDER);
                    sums.add(found.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER) - exact, squares.at(x, y));
                }
            }
        }
    }
    compared.iter().map(|(step, _, sums)| sums.to_row(1.0 / *step as f64)).collect()
}

/// Sums of squared errors over the view, and over the ring around the contact.
#[derive(Default)]
struct SquaredErrorSums {
    squares: f64,
    count: f64,
    max: f64,
    ring_squares: f64,
    ring_count: f64,
}

impl SquaredErrorSums {
    fn add(&mut self, error_mm: f32, distance2_mm2: f64) {
        let error = 1e3 * f64::from(error_mm).abs();
        self.squares += error * error;
        self.count += 1.0;
        self.max = self.max.max(error);
        if distance2_mm2 > 0.0 && distance2_mm2 <= RING_MM * RING_MM {
            self.ring_squares += error * error;
            self.ring_count += 1.0;
        }
    }

    fn to_row(&self, per_px: f64) -> GridRow {
        GridRow {
            per_px,
            height_rms_um: (self.squares / self.count.max(1.0)).sqrt(),
            height_max_um: self.max,
            ring_rms_um: (self.ring_squares / self.ring_count.max(1.0)).sqrt(),
        }
    }
}

/// Compares the reference's images with those without each effect that it runs.
fn ablate_effects(plan: &Plan, reference: &LevelMeasurement, indices: &[u64]) -> Vec<EffectAblation> {
    let ran = |effect: &Effect| reference.samples.iter().any(|sample| sample.label.effects[*effect].ran);
    let rows = Effect::ALL.into_iter().filter(ran).map(|effect| {
        let without = plan.with_policy(EffectPolicy::Without(effect));
        let ms = |plan: &Plan, index: u64| 1e3 * render(plan, index).seconds.simulation();
        let (mut image_mae, mut image_max, mut saved) = (0.0, 0, Vec::new());
        for (index, exact) in indices.iter().zip(&reference.samples) {
            let sample = render(&without, *index);
            let (image, exact) = (&sample.impression.image.rgb, &exact.impression.image.rgb);
            image_mae += image::mae(image, exact) / indices.len() as f64;
            image_max = image.iter().zip(exact).map(|(a, b)| a.abs_diff(*b)).fold(image_max, u8::max);
            // Alternately, so that a machine that becomes slower does so for both.
            let [mut with, mut left_out] = [f64::INFINITY; 2];
            for _ in 0..2 {
                (with, left_out) = (with.min(ms(plan, *index)), left_out.min(ms(&without, *index)));
            }
            saved.push(with - left_out);
        }
        EffectAblation {
            effect: effect.name().to_owned(),
            samples: reference.samples.iter().filter(|sample| sample.label.effects[effect].ran).count(),
            image_mae,
            image_max,
            cpu_ms: median(&saved).unwrap_or(0.0),
        }
    });
    rows.collect()
}
