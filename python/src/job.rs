//! `gelsim.Job`: a job as a map-style dataset, which renders samples when they are asked for.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gelsim_core::fidelity::Fidelity;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_job::config::Overrides;
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::gripper::{self, FINGER_NAMES};
use gelsim_job::label::sample_key;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::probe::preview_job;
use gelsim_job::sample::{AcceptedSample, RejectedSample, accept_sample};
use gelsim_job::sequence::{self, SequenceEvent};
use gelsim_lab::tradeoff::choose::choose_level;
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use rayon::prelude::*;

use crate::arguments::{
    self, OptionalArgument, extract_assignments, extract_each, extract_flag, extract_whole_number, first_text,
};
use crate::arrays::{Arrays, parse_json, require_numpy};
use crate::errors::{emit_warnings, fidelity_level, find_by_name, panic_error, runtime_error, usage_error};
use crate::threads::{extract_thread_count, shared_pool};

/// Samples that each thread renders between two looks at signals.
const BLOCK: usize = 8;

/// Help for a value that is no number of samples at all; other mistakes are reported with all those of the job.
const ALLOWED_SAMPLES: &str = "give 1 to 1000000000";

/// Help for a seed out of range: readers of JSON take larger integers for floats.
pub const ALLOWED_SEEDS: &str = "give 0 to 9007199254740991";

/// A job as a map-style dataset: sample `i` is what `gelsim generate` writes, rendered when it is asked for.
///
/// ```python
/// job = gelsim.Job.load("job.toml", samples=1000, set={"sensor.preset": "digit"})
/// sample = job[42]
/// image, depth_mm, label = sample["tactile"], sample["depth"], sample["label"]
/// ```
///
/// It can be pickled: another process reads the objects again, and refuses them if they changed.
#[pyclass(frozen, module = "gelsim")]
pub struct Job {
    plan: Arc<Plan>,
    /// The plan as text, to rebuild it in another process.
    text: String,
    /// The file, of a job of several sensors, whose plan no text holds.
    file: Option<JobFile>,
    threads: Option<usize>,
}

/// The arguments of `Job.load`, but for the threads.
#[derive(Clone, IntoPyObject)]
struct JobFile(PathBuf, Option<u64>, Option<u64>, Option<&'static str>, bool, Vec<String>);

/// A rendered sample, without Python objects.
enum RenderedSample {
    Press(Arrays),
    /// Frames, and the label.
    Sequence(Vec<Arrays>, Vec<u8>),
    /// Left and right finger, and the label.
    Grip(Box<[Arrays; 2]>, Vec<u8>),
    /// Left and right finger of each frame, and the label.
    GripSequence(Vec<[Arrays; 2]>, Vec<u8>),
}

impl RenderedSample {
    /// Returns a press as [`Arrays::into_dict`] does, a sequence as `frames`, a grip as `left` and `right`, both with
    /// one `label`.
    fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        match self {
            Self::Press(arrays) => arrays.into_dict(py),
            Self::Sequence(frames, label) => {
                let list = PyList::empty(py);
                for arrays in frames {
                    list.append(arrays.into_dict(py)?)?;
                }
                let dict = PyDict::new(py);
                dict.set_item("frames", list)?;
                dict.set_item("label", parse_json(py, &label)?)?;
                Ok(dict)
            }
            Self::Grip(fingers, label) => {
                let dict = pair_dict(py, *fingers)?;
                dict.set_item("label", parse_json(py, &label)?)?;
                Ok(dict)
            }
            Self::GripSequence(frames, label) => {
                let list = PyList::empty(py);
                for fingers in frames {
                    list.append(pair_dict(py, fingers)?)?;
                }
                let dict = PyDict::new(py);
                dict.set_item("frames", list)?;
                dict.set_item("label", parse_json(py, &label)?)?;
                Ok(dict)
            }
        }
    }
}

/// Returns `left` and `right`, each as of a press without label.
fn pair_dict(py: Python<'_>, fingers: [Arrays; 2]) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for (name, arrays) in FINGER_NAMES.into_iter().zip(fingers) {
        dict.set_item(name, arrays.into_dict(py)?)?;
    }
    Ok(dict)
}

/// What `__reduce__` returns: a function of the module, and its arguments.
pub type PickleParts<'py, Arguments> = PyResult<(Bound<'py, PyAny>, Arguments)>;

/// Rebuilds a job in another process.
#[pyfunction]
#[pyo3(name = "_job_of_text")]
pub fn job_of_text(py: Python<'_>, text: &Bound<'_, PyAny>, threads: OptionalArgument<'_, '_>) -> PyResult<Job> {
    let text = arguments::extract_text("text", text)?;
    Job::new(py, threads, || Plan::read("the pickled job", text, Path::new(""), &Overrides::default()))
}

/// Reads a job of several sensors again, in another process.
#[pyfunction]
#[pyo3(name = "_job_of_file")]
pub fn job_of_file(py: Python<'_>, file: &Bound<'_, PyTuple>, threads: OptionalArgument<'_, '_>) -> PyResult<Job> {
    let [path, samples, seed, fidelity, all_effects, set] = [0, 1, 2, 3, 4, 5].map(|k| file.get_item(k));
    let (path, all_effects, set) = (path?, all_effects?, set?);
    let [samples, seed, fidelity] =
        [samples?, seed?, fidelity?].map(|given| Some(given).filter(|given| !given.is_none()));
    Job::load(py, &path, samples.as_ref(), seed.as_ref(), fidelity.as_ref(), Some(&all_effects), Some(&set), threads)
}

impl Job {
    /// Returns the plan of the job.
    pub fn plan(&self) -> Arc<Plan> {
        Arc::clone(&self.plan)
    }

    /// Reads a job on the pool of `threads`, and settles its fidelity level.
    // Plans lie on the stack. What calls this may be called again by a path or a number of the user's, a thousand deep.
    #[inline(never)]
    fn new(
        py: Python<'_>,
        threads: OptionalArgument<'_, '_>,
        read: impl FnOnce() -> Result<Plan, Report> + Send,
    ) -> PyResult<Self> {
        require_numpy(py)?;
        let threads = extract_thread_count(threads)?;
        let pool = shared_pool(py, threads)?;
        let plan = py.detach(|| pool.install(|| settle_fidelity(read()?))).map_err(|report| usage_error(&report))?;
        let text = plan.to_toml().map_err(|error| runtime_error(error.to_string()))?;
        Ok(Self { plan: Arc::new(plan), text, file: None, threads })
    }

    /// Returns the number of the sample that Python asks for; negative ones count from the end. Raises IndexError if
    /// there is none.
    fn resolve_index(&self, index: &Bound<'_, PyAny>) -> PyResult<u64> {
        let samples = self.plan.layout.sample_count();
        let range = format!("they are numbered 0 to {}", samples - 1);
        let wanted = "a whole number; Job.samples takes several";
        let Some(index) = arguments::extract_integer("index", index, wanted)? else {
            return Err(PyIndexError::new_err(format!("there is no sample of this index: {range}")));
        };
        let counted = if index < 0 { index.saturating_add(i128::from(samples)) } else { index };
        match u64::try_from(counted) {
            Ok(number) if number < samples => Ok(number),
            _ => Err(PyIndexError::new_err(format!("there is no sample {index}: {range}"))),
        }
    }

    /// Renders sample `index` as `gelsim generate` writes it.
    fn render_sample(&self, index: u64) -> PyResult<RenderedSample> {
        let plan = &*self.plan;
        let render: fn(&Plan, u64) -> Result<RenderedSample, RejectedSample> =
            match (&plan.job().sequence, &plan.job().gripper) {
                (None, None) => render_press,
                (None, Some(_)) => render_grip,
                (Some(_), None) => render_sequence,
                (Some(_), Some(_)) => render_grip_sequence,
            };
        // A panic leaves nothing half changed that is used later.
        let rendered = catch_unwind(AssertUnwindSafe(|| render(plan, index)));
        if let Some((path, error)) = plan.find_mesh_failure() {
            return Err(runtime_error(format!("{}: {error}", path.display())));
        }
        match rendered {
            Ok(Ok(arrays)) => Ok(arrays),
            Ok(Err(unfit)) => Err(rejected_sample_error(plan, &unfit)),
            Err(panic) => Err(panic_error(&format!("sample {} (seed {})", sample_key(index), plan.seed()), &*panic)),
        }
    }
}

// Samples lie on the stack. Inlined into one function, these would take the stack of all of them together: more than some
// threads of Python have.

#[inline(never)]
fn render_press(plan: &Plan, index: u64) -> Result<RenderedSample, RejectedSample> {
    let AcceptedSample { sample, .. } = accept_sample(plan, index)?;
    Ok(RenderedSample::Press(Arrays::new(plan, sample)))
}

#[inline(never)]
fn render_grip(plan: &Plan, index: u64) -> Result<RenderedSample, RejectedSample> {
    let gripper::AcceptedGrip { grip, .. } = gripper::accept_grip(plan, index)?;
    let fingers = grip.fingers.map(|sample| Arrays::of_frame(plan, sample));
    Ok(RenderedSample::Grip(Box::new(fingers), to_json_line(&grip.label)))
}

#[inline(never)]
fn render_sequence(plan: &Plan, index: u64) -> Result<RenderedSample, RejectedSample> {
    let mut frames = Vec::new();
    let accepted = sequence::accept_sequence(plan, index, |shown| {
        match shown {
            SequenceEvent::Begin => frames.clear(),
            SequenceEvent::Frame(sample, _) => frames.push(Arrays::of_frame(plan, *sample)),
        }
        Ok::<(), RejectedSample>(())
    })?;
    Ok(RenderedSample::Sequence(frames, to_json_line(&accepted.label)))
}

#[inline(never)]
fn render_grip_sequence(plan: &Plan, index: u64) -> Result<RenderedSample, RejectedSample> {
    let mut frames = Vec::new();
    let accepted = gripper::sequence::accept_grip_sequence(plan, index, |shown| {
        match shown {
            SequenceEvent::Begin => frames.clear(),
            SequenceEvent::Frame(pair, _) => frames.push(pair.map(|sample| Arrays::of_frame(plan, sample))),
        }
        Ok::<(), RejectedSample>(())
    })?;
    Ok(RenderedSample::GripSequence(frames, to_json_line(&accepted.label)))
}

/// Returns the exception for a sample that the job rejects.
fn rejected_sample_error(plan: &Plan, unfit: &RejectedSample) -> PyErr {
    let help = match plan.output().on_unhealthy {
        OnUnhealthy::Reject => "set=['output.on_unhealthy=\"keep\"'] takes it as it was drawn last",
        OnUnhealthy::Keep | OnUnhealthy::Fail => {
            "set=['output.on_unhealthy=\"keep\"'] takes it as it is, \"reject\" draws it again"
        }
    };
    runtime_error(format!("{unfit}; {help}"))
}

/// Returns the plan with a fidelity level: the job's, or the fastest that keeps the error bound which the job gives
/// instead.
pub fn settle_fidelity(mut plan: Plan) -> Result<Plan, Report> {
    let Some(bound) = plan.open_fidelity_choice() else { return Ok(plan) };
    let chosen = choose_level(&plan, bound)?;
    plan.notes = plan.notes.merged_with(Diagnostic::note(chosen.to_string()).into());
    Ok(plan.with_fidelity(chosen.level))
}

/// Returns the overrides that the arguments describe. They have the names of the command's flags.
pub fn extract_overrides(
    samples: OptionalArgument<'_, '_>,
    seed: OptionalArgument<'_, '_>,
    fidelity: OptionalArgument<'_, '_>,
    all_effects: OptionalArgument<'_, '_>,
    set: OptionalArgument<'_, '_>,
) -> PyResult<Overrides> {
    Ok(Overrides::from_flags(
        extract_whole_number("samples", samples, ALLOWED_SAMPLES)?,
        extract_whole_number("seed", seed, ALLOWED_SEEDS)?,
        fidelity.map(fidelity_level).transpose()?,
        extract_flag("all_effects", all_effects)?,
        &extract_assignments("set", set)?,
    ))
}

#[pymethods]
impl Job {
    /// Raises a TypeError that says how to make a job: the class itself cannot be called.
    #[new]
    #[pyo3(signature = (*given, **named), text_signature = None)]
    fn refuse_call(given: &Bound<'_, PyTuple>, named: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let path = first_text(given, named).unwrap_or_else(|| String::from("job.toml"));
        Err(PyTypeError::new_err(format!(
            "gelsim.Job is not made by calling it: gelsim.Job.load({path:?}) reads a job"
        )))
    }

    /// Reads and resolves a job. The arguments are the flags of `gelsim generate`.
    ///
    /// `set` changes keys of the job: a dict as in `{"indentation.depth_mm": [0.3, 0.9], "sensor.preset": "digit"}`, or a list of
    /// texts as the command takes them, `["indentation.depth_mm=[0.3, 0.9]"]`. `threads` is for `samples`: all cores if it is left out, one in a process that multiprocessing started.
    /// Raises UsageError with every mistake in the job.
    #[staticmethod]
    #[pyo3(
        signature = (path, *, samples=None, seed=None, fidelity=None, all_effects=None, set=None, threads=None),
        text_signature = "(path, *, samples=None, seed=None, fidelity=None, all_effects=False, set=(), threads=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "they are the command's flags")]
    fn load(
        py: Python<'_>,
        path: &Bound<'_, PyAny>,
        samples: OptionalArgument<'_, '_>,
        seed: OptionalArgument<'_, '_>,
        fidelity: OptionalArgument<'_, '_>,
        all_effects: OptionalArgument<'_, '_>,
        set: OptionalArgument<'_, '_>,
        threads: OptionalArgument<'_, '_>,
    ) -> PyResult<Self> {
        let path = arguments::extract_path("path", path)?;
        let overrides = extract_overrides(samples, seed, fidelity, all_effects, set)?;
        let mut job = Self::new(py, threads, || Plan::load(&path, &overrides))?;
        if job.plan.job().sensors.is_some() {
            job.file = Some(JobFile(
                std::path::absolute(&path)?,
                extract_whole_number("samples", samples, ALLOWED_SAMPLES)?,
                extract_whole_number("seed", seed, ALLOWED_SEEDS)?,
                fidelity.map(fidelity_level).transpose()?.map(Fidelity::name),
                extract_flag("all_effects", all_effects)?,
                extract_assignments("set", set)?,
            ));
        }
        let pool = shared_pool(py, job.threads)?;
        let foreseen = py.detach(|| pool.install(|| preview_job(&job.plan)));
        emit_warnings(py, &foreseen.notes)?;
        emit_warnings(py, &job.plan.note_one_of_sensors())?;
        Ok(job)
    }

    /// Sample `index`, rendered on this thread, without the GIL. Negative ones count from the end.
    fn sample<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let index = self.resolve_index(index)?;
        py.detach(|| self.render_sample(index))?.into_dict(py)
    }

    /// Several samples in this order, rendered on the job's threads.
    fn samples<'py>(&self, py: Python<'py>, indices: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
        let numbers = extract_each("indices", indices, "a list of whole numbers", |index| self.resolve_index(index))?;
        let pool = shared_pool(py, self.threads)?;
        let list = PyList::empty(py);
        // A sequence holds the arrays of all its frames, so one per thread is enough.
        let each = if self.plan.job().sequence.is_some() { 1 } else { BLOCK };
        for block in numbers.chunks(each * pool.current_num_threads()) {
            let render = || block.par_iter().map(|index| self.render_sample(*index)).collect::<PyResult<Vec<_>>>();
            for rendered in py.detach(|| pool.install(render))? {
                list.append(rendered.into_dict(py)?)?;
            }
            py.check_signals()?;
        }
        Ok(list)
    }

    fn __getitems__<'py>(&self, py: Python<'py>, indices: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
        self.samples(py, indices)
    }

    fn __getitem__<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        self.sample(py, index)
    }

    fn __iter__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let builtins = slf.py().import("builtins")?;
        let indices = builtins.call_method1("range", (slf.len()?,))?;
        builtins.call_method1("map", (slf.getattr("sample")?, indices))
    }

    fn __len__(&self) -> usize {
        self.plan.layout.sample_count() as usize
    }

    /// The samples of the split `train`, `val` or `test`, ascending.
    fn indices(&self, split: &Bound<'_, PyAny>) -> PyResult<Vec<u64>> {
        let split = arguments::extract_text("split", split)?;
        let split = find_by_name("split", &split, Split::ALL.map(|known| (known.name(), known)))?;
        let layout = &self.plan.layout;
        Ok((0..layout.samples_in(split)).map(|position| layout.index_of(split, position)).collect())
    }

    /// Name of the dataset.
    #[getter]
    fn name(&self) -> &str {
        self.plan.name()
    }

    /// Seed of all randomness.
    #[getter]
    fn seed(&self) -> u64 {
        self.plan.seed()
    }

    /// Fidelity level.
    #[getter]
    fn fidelity(&self) -> &'static str {
        self.plan.fidelity().name()
    }

    /// SHA-256 over all that decides the bytes of a sample, as in `dataset.json`.
    #[getter]
    fn fingerprint(&self) -> &str {
        &self.plan.fingerprint
    }

    /// Class names; a label's `class_index` counts here.
    #[getter]
    fn classes(&self) -> Vec<String> {
        self.plan.sampling.classes.clone()
    }

    /// The layers of every sample.
    #[getter]
    fn layers(&self) -> Vec<&'static str> {
        self.plan.layers().iter().map(|layer| layer.name()).collect()
    }

    fn __repr__(&self) -> String {
        format!(
            "<gelsim.Job {:?}: {} samples, fidelity {}>",
            self.plan.name(),
            self.__len__(),
            self.plan.fidelity().name()
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PickleParts<'py, Bound<'py, PyTuple>> {
        let native = py.import("gelsim._native")?;
        Ok(match self.file.clone() {
            None => (native.getattr("_job_of_text")?, (&self.text, self.threads).into_pyobject(py)?),
            Some(file) => (native.getattr("_job_of_file")?, (file, self.threads).into_pyobject(py)?),
        })
    }
}
