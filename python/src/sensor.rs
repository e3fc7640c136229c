//! `gelsim.Sensor`: tactile images of depth maps that come as arrays.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use gelsim::core::depth::height_map::HeightMap;
use gelsim::core::fidelity::Fidelity;
use gelsim::core::pose::Pose;
use gelsim::files::sensor::PRESETS;
use gelsim::job::config::Overrides;
use gelsim::job::layers::OutputLayer;
use gelsim::job::layout::Split;
use gelsim::job::plan::Plan;
use gelsim::job::plan::frames::Frames;
use gelsim::job::plan::standalone::sensor;
use gelsim::job::sample::press;
use gelsim::job::scene::{Frame, KnownPress, Pressed, Scene};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::arguments::{self, Given, texts, whole};
use crate::arrays::{Arrays, need_numpy};
use crate::depth::{Depth, Seen};
use crate::errors::{mistake, named, panicked, rung, running, usage, warn};
use crate::job::Pickled;
use crate::threads::{checked, pool};

/// Maps that each thread renders before Python may look at signals.
const BLOCK: usize = 8;

/// Simulators that are kept: who changes resolution or fidelity with every call waits every time.
const MOST_SIMULATORS: usize = 8;

/// A sensor, read and checked.
#[pyclass(frozen, module = "gelsim")]
pub struct Sensor {
    /// A preset's name, or an absolute path.
    source: String,
    set: Vec<String>,
    threads: Option<usize>,
    itself: gelsim::core::sensor::Sensor,
    /// The simulators that were used last, the very last at the end. The lock is taken with the GIL only, and not for long.
    simulators: Mutex<Vec<(Choice, Plan)>>,
}

/// What a simulator depends on beside the sensor.
#[derive(Clone, Copy, PartialEq)]
struct Choice {
    resolution_px: [usize; 2],
    fidelity: Option<Fidelity>,
}

/// Rebuilds a sensor in another process.
#[pyfunction]
#[pyo3(name = "_sensor_of_source")]
pub fn sensor_of_source(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    set: Given<'_, '_>,
    threads: Given<'_, '_>,
) -> PyResult<Sensor> {
    Ok(Sensor::new(py, arguments::text("source", source)?, set, threads)?.0)
}

impl Sensor {
    /// Reads it; with the plan of its own resolution, in which its mistakes and notes are.
    fn new(py: Python<'_>, source: String, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<(Self, Plan)> {
        need_numpy(py)?;
        let (set, threads) = (texts("set", set)?, checked(threads)?);
        let itself = py.detach(|| sensor(&source)).map_err(|report| usage(&report))?.sensor;
        let sensor = Self { source, set, threads, itself, simulators: Mutex::default() };
        let resolution_px = sensor.itself.resolution_px;
        let plan = sensor.plan(py, Choice { resolution_px, fidelity: None })?;
        Ok((sensor, plan))
    }

    fn noted(py: Python<'_>, source: String, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        let (sensor, plan) = Self::new(py, source, set, threads)?;
        warn(py, &plan.notes)?;
        Ok(sensor)
    }

    /// A plan over the simulator of a choice, which is made where it is not one of those that were used last.
    fn plan(&self, py: Python<'_>, choice: Choice) -> PyResult<Plan> {
        let simulators = || self.simulators.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut simulators = simulators();
            if let Some(place) = simulators.iter().position(|(known, _)| *known == choice) {
                let used = simulators.remove(place);
                let plan = used.1.clone();
                simulators.push(used);
                return Ok(plan);
            }
        }
        let overrides = Overrides::of_flags(None, None, choice.fidelity, false, &self.set);
        let frames = Frames {
            sensor: &self.source,
            resolution_px: choice.resolution_px,
            layers: &[],
            classes: &[],
            sequence: false,
            moved: false,
            overrides: &overrides,
        };
        let pool = pool(py, self.threads)?;
        let plan = py.detach(|| pool.install(|| frames.plan())).map_err(|report| usage(&report))?;
        let found = plan.simulator.view().resolution_px;
        if found != choice.resolution_px {
            let ([width, height], [columns, rows]) = (found, choice.resolution_px);
            let message =
                format!("depth_mm has {rows} rows and {columns} columns, `set` makes them {height} and {width}");
            return Err(mistake(message, "leave sensor.resolution_px out: a map brings its own"));
        }
        let mut simulators = simulators();
        if simulators.len() == MOST_SIMULATORS {
            simulators.remove(0);
        }
        simulators.push((choice, plan.clone()));
        Ok(plan)
    }
}

/// Map `number` of an input pressed into the pad, as sample `index`.
fn render(plan: &Plan, depth: &Depth<'_>, number: usize, index: u64) -> PyResult<Arrays> {
    // Nothing outside is changed by what panics.
    let rendered = catch_unwind(AssertUnwindSafe(|| {
        let map = HeightMap { above_mm: depth.above_mm(number), unseen_px: 0 };
        // It was looked at, but whoever writes to the array does not wait.
        if map.above_mm.data.iter().any(|mm| mm.is_nan() || *mm == f32::NEG_INFINITY) {
            return Err(running("depth_mm has changed while it was rendered; give a copy: depth_mm.copy()"));
        }
        let indentation_depth_mm = map.indentation_depth_mm();
        let frame = Frame { id: String::from("depth_mm"), class: String::new(), map: Arc::new(map) };
        let (split, pressed, pose) = (Split::Train, Pressed::Frame(frame), Pose::IDENTITY);
        let scene = Scene::given(plan, index, 0, KnownPress { split, pressed, pose, indentation_depth_mm });
        Ok(Arrays::new(plan, press(plan, &scene)))
    }));
    let bug = |panic: Box<dyn Any + Send>| {
        Err(panicked(&format!("map {number} (sample {index}, seed {})", plan.seed()), &*panic))
    };
    rendered.unwrap_or_else(bug)
}

#[pymethods]
impl Sensor {
    #[staticmethod]
    #[pyo3(signature = (name, *, set=None, threads=None), text_signature = "(name, *, set=(), threads=None)")]
    fn preset(py: Python<'_>, name: &Bound<'_, PyAny>, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        let name = arguments::text("name", name)?;
        named("sensor preset", &name, PRESETS)?;
        Self::noted(py, name, set, threads)
    }

    #[staticmethod]
    #[pyo3(signature = (path, *, set=None, threads=None), text_signature = "(path, *, set=(), threads=None)")]
    fn load(py: Python<'_>, path: &Bound<'_, PyAny>, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        let path = arguments::path("path", path)?;
        let absolute = std::path::absolute(&path).map_err(|error| running(format!("{}: {error}", path.display())))?;
        let source = absolute.into_os_string().into_string();
        let source = source.map_err(|path| {
            mistake(
                format!("{} is not UTF-8", path.display()),
                "rename the file or its folder: labels and jobs are UTF-8",
            )
        })?;
        Self::noted(py, source, set, threads)
    }

    /// Presses what depth maps show into the pad.
    #[pyo3(
        signature = (depth_mm, *, fidelity=None, layers=None, index=None, seed=None),
        text_signature = "($self, depth_mm, *, fidelity=None, layers=(), index=0, seed=0)"
    )]
    fn render<'py>(
        &self,
        py: Python<'py>,
        depth_mm: &Bound<'py, PyAny>,
        fidelity: Given<'_, 'py>,
        layers: Given<'_, 'py>,
        index: Given<'_, 'py>,
        seed: Given<'_, 'py>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let input = Depth::array(depth_mm)?;
        let depth = Depth::new(&input);
        let wanted = |name: &String| named("layer", name, OutputLayer::ALL.map(|layer| (layer.name(), layer)));
        let layers = texts("layers", layers)?.iter().map(wanted).collect::<PyResult<Vec<_>>>()?;
        let fidelity = fidelity.map(rung).transpose()?;
        let index = whole("index", index)?.unwrap_or(0);
        let seed = whole("seed", seed)?.unwrap_or(0);
        let plan = self.plan(py, Choice { resolution_px: depth.resolution_px(), fidelity })?;
        let plan = plan.with_samples(seed, &layers).map_err(|report| usage(&report))?;
        let one = |number: usize| render(&plan, &depth, number, index.wrapping_add(number as u64));
        let thickness_mm = plan.thickness_mm();
        let judged = |seen: &Seen| {
            let notes = depth.judge(seen, thickness_mm).map_err(|report| usage(&report))?;
            warn(py, &notes)
        };
        let Some(maps) = depth.batch() else {
            judged(&py.detach(|| depth.look(0..1, thickness_mm)))?;
            return py.detach(|| one(0))?.into_dict(py);
        };
        let pool = pool(py, self.threads)?;
        let mut seen = Seen::NOTHING;
        for block in depth.blocks() {
            seen = seen.and(py.detach(|| pool.install(|| depth.look(block, thickness_mm))));
            py.check_signals()?;
        }
        judged(&seen)?;
        let mut batch: Option<Arrays> = None;
        let length = BLOCK * pool.current_num_threads();
        for start in (0..maps).step_by(length) {
            let block = start..maps.min(start + length);
            let rendered = || block.into_par_iter().map(one).collect::<PyResult<Vec<_>>>();
            py.detach(|| {
                for arrays in pool.install(rendered)? {
                    match &mut batch {
                        Some(batch) => batch.push(arrays),
                        None => batch = Some(arrays.first_of(maps)?),
                    }
                }
                PyResult::Ok(())
            })?;
            py.check_signals()?;
        }
        batch.ok_or_else(|| running("depth_mm is empty"))?.into_dict(py)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.itself.name
    }

    /// Width and height.
    #[getter]
    fn resolution_px(&self) -> (usize, usize) {
        self.itself.resolution_px.into()
    }

    /// Width and height.
    #[getter]
    fn field_of_view_mm(&self) -> (f64, f64) {
        self.itself.field_of_view_mm.into()
    }

    #[getter]
    fn gelpad_thickness_mm(&self) -> f64 {
        self.itself.gelpad.thickness_mm
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.itself.resolution_px;
        format!("<gelsim.Sensor {:?}: {width}x{height} px>", self.itself.name)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> Pickled<'py, (&str, Vec<String>, Option<usize>)> {
        let rebuild = py.import("gelsim._native")?.getattr("_sensor_of_source")?;
        Ok((rebuild, (&self.source, self.set.clone(), self.threads)))
    }
}
