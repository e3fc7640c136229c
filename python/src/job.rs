//! `gelsim.Job`: a job as a map-style dataset, whose samples are rendered when they are asked for.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use gelsim_dataset::encode::json;
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_job::config::Overrides;
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::gripper::{self, FINGERS};
use gelsim_job::label::key;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::probe::foresee;
use gelsim_job::sample::{Accepted, Sample, Unfit, accept};
use gelsim_job::sequence::{self, Shown};
use gelsim_lab::tradeoff::choose::choose;
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use rayon::prelude::*;

use crate::arguments::{self, Given, assignments, each, first, flag, whole};
use crate::arrays::{Arrays, need_numpy, parsed};
use crate::errors::{fidelity_level, named, panicked, running, usage, warn};
use crate::threads::{checked, pool};

/// Samples that each thread renders before Python may look at signals.
const BLOCK: usize = 8;

/// What a job takes, to whoever gives what is no such number at all; the rest is said with all other mistakes of the job.
const MOST_SAMPLES: &str = "give 1 to 1000000000";

/// JSON's readers take larger ones for floats.
pub const LARGEST_SEED: &str = "give 0 to 9007199254740991";

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
    /// The same as text, for other processes.
    text: String,
    threads: Option<usize>,
}

/// A sample, made without Python.
enum Rendered {
    Press(Arrays),
    /// Its frames, and its label.
    Sequence(Vec<Arrays>, Vec<u8>),
    /// Its left and its right finger, and its label.
    Grip(Box<[Arrays; 2]>, Vec<u8>),
    /// Such fingers of its frames, and its label.
    GripSequence(Vec<[Arrays; 2]>, Vec<u8>),
}

impl Rendered {
    /// A press as [`Arrays::into_dict`] has it; of a sequence `frames`, each such a dictionary, of a grip `left` and `right`, and
    /// the `label` of all.
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
                dict.set_item("label", parsed(py, &label)?)?;
                Ok(dict)
            }
            Self::Grip(fingers, label) => {
                let dict = both(py, *fingers)?;
                dict.set_item("label", parsed(py, &label)?)?;
                Ok(dict)
            }
            Self::GripSequence(frames, label) => {
                let list = PyList::empty(py);
                for fingers in frames {
                    list.append(both(py, fingers)?)?;
                }
                let dict = PyDict::new(py);
                dict.set_item("frames", list)?;
                dict.set_item("label", parsed(py, &label)?)?;
                Ok(dict)
            }
        }
    }
}

/// `left` and `right`, each as a press has it, without label.
fn both(py: Python<'_>, fingers: [Arrays; 2]) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for (name, arrays) in FINGERS.into_iter().zip(fingers) {
        dict.set_item(name, arrays.into_dict(py)?)?;
    }
    Ok(dict)
}

/// What pickle wants to know: a function of the module, and its arguments.
pub type Pickled<'py, Arguments> = PyResult<(Bound<'py, PyAny>, Arguments)>;

/// Rebuilds a job in another process.
#[pyfunction]
#[pyo3(name = "_job_of_text")]
pub fn job_of_text(py: Python<'_>, text: &Bound<'_, PyAny>, threads: Given<'_, '_>) -> PyResult<Job> {
    let text = arguments::text("text", text)?;
    Job::new(py, threads, || Plan::read("the pickled job", text, Path::new(""), &Overrides::default()))
}

impl Job {
    /// What its samples depend on.
    pub fn plan(&self) -> Arc<Plan> {
        Arc::clone(&self.plan)
    }

    fn new(
        py: Python<'_>,
        threads: Given<'_, '_>,
        read: impl FnOnce() -> Result<Plan, Report> + Send,
    ) -> PyResult<Self> {
        need_numpy(py)?;
        let threads = checked(threads)?;
        let pool = pool(py, threads)?;
        let plan = py.detach(|| pool.install(|| settled(read()?))).map_err(|report| usage(&report))?;
        let text = plan.to_toml().map_err(|error| running(error.to_string()))?;
        Ok(Self { plan: Arc::new(plan), text, threads })
    }

    /// The number of a sample that Python asks for; negative ones count from the end.
    fn index(&self, index: &Bound<'_, PyAny>) -> PyResult<u64> {
        let samples = self.plan.layout.samples();
        let range = format!("they are numbered 0 to {}", samples - 1);
        let wanted = "a whole number; Job.samples takes several";
        let Some(index) = arguments::integer("index", index, wanted)? else {
            return Err(PyIndexError::new_err(format!("there is no sample of this index: {range}")));
        };
        let counted = if index < 0 { index.saturating_add(i128::from(samples)) } else { index };
        match u64::try_from(counted) {
            Ok(number) if number < samples => Ok(number),
            _ => Err(PyIndexError::new_err(format!("there is no sample {index}: {range}"))),
        }
    }

    /// Sample `index` as `gelsim generate` writes it.
    fn render(&self, index: u64) -> PyResult<Rendered> {
        let plan = &*self.plan;
        // Nothing outside is changed by what panics.
        let both = |pair: [Sample; 2]| pair.map(|sample| Arrays::of_frame(plan, sample));
        let rendered = catch_unwind(AssertUnwindSafe(|| match plan.job().sequence {
            None if plan.job().gripper.is_some() => gripper::accept(plan, index)
                .map(|gripper::Accepted { grip, .. }| Rendered::Grip(Box::new(both(grip.fingers)), json(&grip.label))),
            None => accept(plan, index).map(|Accepted { sample, .. }| Rendered::Press(Arrays::new(plan, sample))),
            Some(_) if plan.job().gripper.is_some() => {
                let mut frames = Vec::new();
                let accepted = gripper::sequence::accept(plan, index, |shown| {
                    match shown {
                        Shown::Begin => frames.clear(),
                        Shown::Frame(pair, _) => frames.push(both(*pair)),
                    }
                    Ok::<(), Unfit>(())
                })?;
                Ok(Rendered::GripSequence(frames, json(&accepted.label)))
            }
            Some(_) => {
                let mut frames = Vec::new();
                let accepted = sequence::accept(plan, index, |shown| {
                    match shown {
                        Shown::Begin => frames.clear(),
                        Shown::Frame(sample, _) => frames.push(Arrays::of_frame(plan, *sample)),
                    }
                    Ok::<(), Unfit>(())
                })?;
                Ok(Rendered::Sequence(frames, json(&accepted.label)))
            }
        }));
        match rendered {
            Ok(Ok(arrays)) => Ok(arrays),
            Ok(Err(unfit)) => Err(unhealthy(plan, &unfit)),
            Err(panic) => Err(panicked(&format!("sample {} (seed {})", key(index), plan.seed()), &*panic)),
        }
    }
}

/// What to raise for a sample that the job does not take.
fn unhealthy(plan: &Plan, unfit: &Unfit) -> PyErr {
    let help = match plan.output().on_unhealthy {
        OnUnhealthy::Reject => "set=['output.on_unhealthy=\"keep\"'] takes it as it was drawn last",
        OnUnhealthy::Keep | OnUnhealthy::Fail => {
            "set=['output.on_unhealthy=\"keep\"'] takes it as it is, \"reject\" draws it again"
        }
    };
    running(format!("{unfit}; {help}"))
}

/// The plan at the fidelity level that keeps the bound which the job gives instead of one.
pub fn settled(mut plan: Plan) -> Result<Plan, Report> {
    let Some(bound) = plan.open_choice() else { return Ok(plan) };
    let chosen = choose(&plan, bound)?;
    plan.notes = plan.notes.and(Diagnostic::note(chosen.to_string()).into());
    Ok(plan.with_fidelity(chosen.level))
}

/// What the command's flags of the same names say of a job.
pub fn overrides(
    samples: Given<'_, '_>,
    seed: Given<'_, '_>,
    fidelity: Given<'_, '_>,
    all_effects: Given<'_, '_>,
    set: Given<'_, '_>,
) -> PyResult<Overrides> {
    Ok(Overrides::of_flags(
        whole("samples", samples, MOST_SAMPLES)?,
        whole("seed", seed, LARGEST_SEED)?,
        fidelity.map(fidelity_level).transpose()?,
        flag("all_effects", all_effects)?,
        &assignments("set", set)?,
    ))
}

#[pymethods]
impl Job {
    /// Whoever calls the class itself is told what makes a job.
    #[new]
    #[pyo3(signature = (*given, **named), text_signature = None)]
    fn itself(given: &Bound<'_, PyTuple>, named: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let path = first(given, named).unwrap_or_else(|| String::from("job.toml"));
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
        samples: Given<'_, '_>,
        seed: Given<'_, '_>,
        fidelity: Given<'_, '_>,
        all_effects: Given<'_, '_>,
        set: Given<'_, '_>,
        threads: Given<'_, '_>,
    ) -> PyResult<Self> {
        let path = arguments::path("path", path)?;
        let overrides = overrides(samples, seed, fidelity, all_effects, set)?;
        let job = Self::new(py, threads, || Plan::load(&path, &overrides))?;
        let pool = pool(py, job.threads)?;
        let foreseen = py.detach(|| pool.install(|| foresee(&job.plan)));
        warn(py, &foreseen.notes)?;
        Ok(job)
    }

    /// Sample `index`, rendered on this thread, without the GIL. Negative ones count from the end.
    fn sample<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let index = self.index(index)?;
        py.detach(|| self.render(index))?.into_dict(py)
    }

    /// Several samples in this order, rendered on the job's threads.
    fn samples<'py>(&self, py: Python<'py>, indices: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
        let numbers = each("indices", indices, "a list of whole numbers", |index| self.index(index))?;
        let pool = pool(py, self.threads)?;
        let list = PyList::empty(py);
        // A sequence holds the arrays of all its frames.
        let each = if self.plan.job().sequence.is_some() { 1 } else { BLOCK };
        for block in numbers.chunks(each * pool.current_num_threads()) {
            let render = || block.par_iter().map(|index| self.render(*index)).collect::<PyResult<Vec<_>>>();
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
        self.plan.layout.samples() as usize
    }

    /// The samples of the split `train`, `val` or `test`, ascending.
    fn indices(&self, split: &Bound<'_, PyAny>) -> PyResult<Vec<u64>> {
        let split = arguments::text("split", split)?;
        let split = named("split", &split, Split::ALL.map(|known| (known.name(), known)))?;
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> Pickled<'py, (&str, Option<usize>)> {
        Ok((py.import("gelsim._native")?.getattr("_job_of_text")?, (&self.text, self.threads)))
    }
}
