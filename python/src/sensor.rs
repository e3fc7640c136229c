//! `gelsim.Sensor`: renders tactile images of depth maps that come as arrays, or of depth frames for a sensor whose gel
//! has a shape.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use gelsim_core::camera::projection::LensModel;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::pose::Pose;
use gelsim_dataset::encode::to_json_line;
use gelsim_dataset::frames::camera::{DepthCamera, DepthProjection, DepthUnit, DistanceAlong};
use gelsim_dataset::frames::reader::{FrameReader, SeenFrame};
use gelsim_dataset::frames::run::render_frame_sample;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::sensor::PRESETS;
use gelsim_files::{hash, input};
use gelsim_job::config::{Overrides, guess_choice};
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::plan::frames::FrameSettings;
use gelsim_job::plan::standalone::load_sensor;
use gelsim_job::sample::press;
use gelsim_job::scene::{DepthFrame, KnownPress, PressSource, Scene};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use rayon::prelude::*;

use crate::arguments::{
    self, OptionalArgument, extract_assignments, extract_texts, extract_whole_number, first_text, write_toml,
};
use crate::arrays::{Arrays, parse_json, require_numpy};
use crate::depth::{DepthFindings, DepthMaps};
use crate::errors::{
    emit_warnings, fidelity_level, find_by_name, mistake_error, panic_error, runtime_error, usage_error,
};
use crate::job::{ALLOWED_SEEDS, PickleParts};
use crate::threads::{extract_thread_count, shared_pool};

/// Maps that each thread renders between two looks at signals.
const BLOCK: usize = 8;

/// Help for a sample's number out of range.
pub const ALLOWED_INDICES: &str = "give 0 to 18446744073709551615";

/// Number of simulators that are kept. A caller who alternates between more resolutions or levels waits at every call.
const MAX_SIMULATORS: usize = 8;

/// A sensor: a preset, or a file. It renders tactile images of depth maps; `Simulator` presses meshes into it.
///
/// ```python
/// sensor = gelsim.Sensor.preset("digit", set={"camera.exposure": 1.2})
/// sensor = sensor.with_leds([*sensor.leds, gelsim.Led(azimuth_deg=45.0, intensity=3.0)])
/// depth_mm = np.zeros((320, 240), np.float32)
/// depth_mm[120:200, 80:160] = 0.5
/// image = sensor.render(depth_mm)["tactile"]
/// ```
///
/// It can be pickled: another process reads its file again.
#[pyclass(frozen, module = "gelsim")]
pub struct Sensor {
    /// A preset's name, or an absolute path.
    source: String,
    set: Vec<String>,
    threads: Option<usize>,
    /// SHA-256 of the file, if it is one.
    sha256: Option<String>,
    /// The sensor after the assignments of `set`.
    itself: gelsim_core::sensor::Sensor,
    /// Notes on the sensor at its own resolution.
    notes: Report,
    /// The simulators that were used last, the most recent at the end. The lock is taken only while the GIL is held,
    /// and only briefly.
    simulators: Mutex<Vec<(SimulatorKey, PreparedPlan)>>,
}

/// What a simulator depends on besides the sensor.
#[derive(Clone, Copy, PartialEq)]
struct SimulatorKey {
    resolution_px: [usize; 2],
    fidelity: Option<Fidelity>,
    /// For a gel that has a shape: columns and rows of the frames, and their rays.
    frames: Option<([usize; 2], FrameRays)>,
}

/// Rays of the depth frames of a camera inside a gel that has a shape.
#[derive(Clone, Copy, PartialEq)]
struct FrameRays {
    along: DistanceAlong,
    fov_y_deg: Option<f64>,
}

/// A plan with its simulator, and the reader of frames if the gel has a shape.
#[derive(Clone)]
struct PreparedPlan {
    plan: Plan,
    reader: Option<Arc<FrameReader>>,
}

/// Returns the SHA-256 of a sensor's file; `None` for a preset, and for what cannot be read.
fn hash_source(source: &str) -> Option<String> {
    // A file's path is absolute, and no preset's name has a slash.
    let path = Path::new(source).is_absolute().then_some(source)?;
    input::read(Path::new(path), input::MAX_METADATA_BYTES).ok().map(|bytes| hash::sha256(&bytes))
}

/// Rebuilds a sensor in another process.
#[pyfunction]
#[pyo3(name = "_sensor_of_source")]
pub fn sensor_of_source(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    set: OptionalArgument<'_, '_>,
    threads: OptionalArgument<'_, '_>,
) -> PyResult<Sensor> {
    Sensor::new(py, arguments::extract_text("source", source)?, set, threads)
}

impl Sensor {
    /// Reads the sensor, and makes the plan of its own resolution, which finds mistakes and notes.
    fn new(
        py: Python<'_>,
        source: String,
        set: OptionalArgument<'_, '_>,
        threads: OptionalArgument<'_, '_>,
    ) -> PyResult<Self> {
        require_numpy(py)?;
        let (set, threads) = (extract_assignments("set", set)?, extract_thread_count(threads)?);
        Self::read(py, source, set, threads)
    }

    // Plans lie on the stack. What calls this may be called again by a path or a number of the user's, a thousand deep.
    #[inline(never)]
    fn read(py: Python<'_>, source: String, set: Vec<String>, threads: Option<usize>) -> PyResult<Self> {
        let sha256 = hash_source(&source);
        let itself = py.detach(|| load_sensor(&source)).map_err(|report| usage_error(&report))?.sensor;
        let written_px = itself.resolution_px;
        let (notes, simulators) = (Report::default(), Mutex::default());
        let sensor = Self { source, set, threads, sha256, itself, notes, simulators };
        let plan = sensor.resolve_plan(py, None, written_px, &[], &[])?;
        let itself = plan.simulator.sensor().clone();
        let choice = SimulatorKey { resolution_px: plan.simulator.view().resolution_px, fidelity: None, frames: None };
        let notes = plan.notes.clone();
        let simulators = Mutex::new(vec![(choice, PreparedPlan { plan, reader: None })]);
        Ok(Self { itself, notes, simulators, ..sensor })
    }

    /// Reads the sensor, and emits its notes as warnings.
    fn with_warnings(
        py: Python<'_>,
        source: String,
        set: OptionalArgument<'_, '_>,
        threads: OptionalArgument<'_, '_>,
    ) -> PyResult<Self> {
        let sensor = Self::new(py, source, set, threads)?;
        emit_warnings(py, &sensor.notes)?;
        Ok(sensor)
    }

    /// Returns the notes on a plan for maps of another resolution that were not already made on the sensor itself.
    pub fn new_notes(&self, plan: &Plan) -> Report {
        let is_said = |note: &Diagnostic| self.notes.problems().iter().any(|said| said.message == note.message);
        let mut news = Diagnostics::default();
        news.extend(plan.notes.problems().iter().filter(|note| !is_said(note)).cloned());
        // Here the map decides the resolution, not a key of the sensor.
        Report::new(&news, &[]).with_replaced_text("`sensor.resolution_px = ", "a map of `[columns, rows] = ")
    }

    /// Returns the plan of a choice: one of those used last, or a new one. True if it is new.
    fn prepare_plan(&self, py: Python<'_>, choice: SimulatorKey) -> PyResult<(PreparedPlan, bool)> {
        let simulators = || self.simulators.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut simulators = simulators();
            if let Some(place) = simulators.iter().position(|(known, _)| *known == choice) {
                let used = simulators.remove(place);
                let ready = used.1.clone();
                simulators.push(used);
                return Ok((ready, false));
            }
        }
        let plan = self.resolve_plan(py, choice.fidelity, choice.resolution_px, &[], &[])?;
        let found = plan.simulator.view().resolution_px;
        let own_pixels = choice.frames.is_none_or(|(_, rays)| rays.fov_y_deg.is_none());
        if found != choice.resolution_px && own_pixels {
            let ([width, height], [columns, rows]) = (found, choice.resolution_px);
            let message =
                format!("depth_mm has {rows} rows and {columns} columns, `set` makes them {height} and {width}");
            return Err(mistake_error(message, "leave sensor.resolution_px out: a map brings its own"));
        }
        // Checked on the plan, because `set` may have changed the lens.
        let has_fov = choice.frames.is_some_and(|(_, rays)| rays.fov_y_deg.is_some());
        if has_fov && plan.simulator.sensor().lens == LensModel::Orthographic {
            let message = "the sensor's lens has parallel rays, and so no place for a perspective camera";
            return Err(mistake_error(message, "leave fov_y_deg out"));
        }
        let reader = match choice.frames {
            None => None,
            Some((size_px, FrameRays { along, fov_y_deg })) => {
                let projection = fov_y_deg
                    .map_or(DepthProjection::Orthographic, |fov_y_deg| DepthProjection::Perspective { fov_y_deg });
                let camera = DepthCamera { projection, along, ..FROM_LENS };
                let reader = |camera| py.detach(|| FrameReader::new(camera, &plan.simulator, size_px));
                let refused = |problem: Diagnostic| {
                    // A camera that is too large even along rays is too large in itself.
                    let is_for_axis = along == DistanceAlong::Axis
                        && reader(DepthCamera { along: DistanceAlong::Ray, ..camera }).is_ok();
                    let help = match is_for_axis {
                        true => "give distances along each pixel's own ray: along=\"ray\"",
                        false => "give smaller frames",
                    };
                    mistake_error(format!("depth_mm: {}", problem.message), help)
                };
                Some(Arc::new(reader(camera).map_err(refused)?))
            }
        };
        let ready = PreparedPlan { plan, reader };
        let mut simulators = simulators();
        if simulators.len() == MAX_SIMULATORS {
            simulators.remove(0);
        }
        simulators.push((choice, ready.clone()));
        Ok((ready, true))
    }

    /// Makes a plan with more assignments, for objects that are pressed one by one: at this resolution, or the sensor's
    /// own.
    pub fn plan_with(
        &self,
        py: Python<'_>,
        fidelity: Fidelity,
        resolution_px: Option<[usize; 2]>,
        set: &[String],
        layers: &[OutputLayer],
    ) -> PyResult<Plan> {
        let is_fidelity = |text: &String| text.split(['=', '.']).next().is_some_and(|key| key.trim() == "fidelity");
        if self.set.iter().chain(set).any(is_fidelity) {
            return Err(mistake_error("`set` has a fidelity", "a simulator takes it by itself: fidelity=\"high\""));
        }
        self.resolve_plan(py, Some(fidelity), resolution_px.unwrap_or(self.itself.resolution_px), set, layers)
    }

    /// Makes a plan from the source, which must be as it was when the sensor was made.
    fn resolve_plan(
        &self,
        py: Python<'_>,
        fidelity: Option<Fidelity>,
        resolution_px: [usize; 2],
        set: &[String],
        layers: &[OutputLayer],
    ) -> PyResult<Plan> {
        if self.sha256 != hash_source(&self.source) {
            let message = format!("{} has changed since this sensor was made of it", self.source);
            return Err(mistake_error(message, "load it again: gelsim.Sensor.load"));
        }
        let overrides = Overrides::from_flags(None, None, fidelity, false, &[&self.set, set].concat());
        let frames = FrameSettings {
            sensor: &self.source,
            resolution_px,
            layers,
            classes: &[],
            sequence: false,
            moved: false,
            overrides: &overrides,
        };
        let pool = shared_pool(py, self.threads)?;
        py.detach(|| pool.install(|| frames.resolve_plan())).map_err(|report| usage_error(&report))
    }

    /// Renders depth maps as samples from `index` on.
    // As `read`: not in the stack of what calls the user's code.
    #[inline(never)]
    fn render_maps<'py>(
        &self,
        py: Python<'py>,
        depth: &DepthMaps<'_>,
        choice: SimulatorKey,
        layers: &[OutputLayer],
        index: u64,
        seed: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (mut ready, is_new) = self.prepare_plan(py, choice)?;
        if is_new {
            emit_warnings(py, &self.new_notes(&ready.plan))?;
        }
        ready.plan = ready.plan.with_samples(seed, layers).map_err(|report| usage_error(&report))?;
        let (plan, inside) = (&ready.plan, ready.reader.as_deref());
        let one = |number: usize| {
            let index = index.wrapping_add(number as u64);
            match inside {
                Some(reader) => render_distances(&ready, reader, depth, number, index),
                None => render_heights(plan, depth, number, index),
            }
        };
        let thickness_mm = plan.thickness_mm();
        let judged = |seen: &DepthFindings| {
            let notes = depth.report_findings(seen, thickness_mm).map_err(|report| usage_error(&report))?;
            emit_warnings(py, &notes)
        };
        let Some(maps) = depth.batch_size() else {
            if inside.is_none() {
                judged(&py.detach(|| depth.inspect(0..1, thickness_mm)))?;
            }
            return py.detach(|| one(0))?.into_dict(py);
        };
        let pool = shared_pool(py, self.threads)?;
        let mut seen = DepthFindings::NOTHING;
        for block in depth.block_ranges().filter(|_| inside.is_none()) {
            seen = seen.merge(py.detach(|| pool.install(|| depth.inspect(block, thickness_mm))));
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
                        None => batch = Some(arrays.into_batch(maps)?),
                    }
                }
                PyResult::Ok(())
            })?;
            py.check_signals()?;
        }
        batch.ok_or_else(|| runtime_error("depth_mm is empty"))?.into_dict(py)
    }

    /// Reads the rays of the depth frames; `None` for a flat sensor, for which they must be left out.
    fn frame_rays(
        &self,
        along: OptionalArgument<'_, '_>,
        fov_y_deg: OptionalArgument<'_, '_>,
    ) -> PyResult<Option<FrameRays>> {
        if self.itself.shape.is_none() {
            return match along.or(fov_y_deg) {
                None => Ok(None),
                Some(_) => {
                    let help =
                        "leave `along` and `fov_y_deg` out: depth_mm is how far the object reaches below the pad";
                    Err(mistake_error("this sensor is flat, and its maps have no rays", help))
                }
            };
        }
        let lines = [("axis", DistanceAlong::Axis), ("ray", DistanceAlong::Ray)];
        let along =
            along.map(|along| find_by_name("line", &arguments::extract_text("along", along)?, lines)).transpose()?;
        let fov_y_deg = fov_y_deg.map(|fov| arguments::extract_number("fov_y_deg", fov)).transpose()?;
        if fov_y_deg.is_some_and(|fov| !(fov > 0.0 && fov <= 170.0)) {
            return Err(mistake_error("fov_y_deg is out of range", "allowed: above 0, up to 170 degrees"));
        }
        Ok(Some(FrameRays { along: along.unwrap_or_default(), fov_y_deg }))
    }
}

/// A depth camera where the sensor's lens is, in millimetres.
pub const FROM_LENS: DepthCamera = DepthCamera {
    unit: DepthUnit::Millimetre,
    plane_mm: 0.0,
    max_depth_mm: None,
    background: None,
    flip: [false; 2],
    offset_px: [0.0; 2],
    projection: DepthProjection::Orthographic,
    along: DistanceAlong::Axis,
};

/// Reads depth frame `number` of an input, of a camera where the sensor's lens is. Raises UsageError for distances that
/// cannot be right.
pub fn read_distances<'a>(reader: &'a FrameReader, depth: &DepthMaps<'_>, number: usize) -> PyResult<SeenFrame<'a>> {
    let of_frame = |problem: Diagnostic, help: &str| {
        let which = depth.batch_size().map_or_else(String::new, |_| format!("map {number}: "));
        mistake_error(format!("{which}{}", problem.message), help)
    };
    let seen = reader.read(depth.distances(number)).map_err(|problem| {
        of_frame(problem, "depth_mm is the distance from the lens, above 0; where nothing is, write inf")
    })?;
    match seen.reach().find_error(&FROM_LENS) {
        None => Ok(seen),
        Some(problem) => {
            let help = "depth_mm is the distance from the lens in mm, along its axis unless along=\"ray\"";
            Err(of_frame(problem, help))
        }
    }
}

/// Renders depth frame `number` of an input inside a gel that has a shape, as sample `index`.
fn render_distances(
    ready: &PreparedPlan,
    reader: &FrameReader,
    depth: &DepthMaps<'_>,
    number: usize,
    index: u64,
) -> PyResult<Arrays> {
    let plan = &ready.plan;
    let rendered = catch_unwind(AssertUnwindSafe(|| {
        let seen = read_distances(reader, depth, number)?;
        Ok(Arrays::new(plan, render_frame_sample(plan, index, "depth_mm", seen, None)))
    }));
    rendered.unwrap_or_else(|panic| Err(map_panic_error(plan, number, index, &*panic)))
}

/// Returns the exception for a panic in map `number` of an input.
fn map_panic_error(plan: &Plan, number: usize, index: u64, panic: &(dyn Any + Send)) -> PyErr {
    panic_error(&format!("map {number} (sample {index}, seed {})", plan.seed()), panic)
}

/// Renders depth map `number` of an input pressed into the pad, as sample `index`.
fn render_heights(plan: &Plan, depth: &DepthMaps<'_>, number: usize, index: u64) -> PyResult<Arrays> {
    // A panic leaves nothing half changed that is used later.
    let rendered = catch_unwind(AssertUnwindSafe(|| {
        let map = HeightMap { above_mm: depth.above_mm(number), unseen_px: 0 };
        // The values were checked, but another thread may write to the array meanwhile.
        if map.above_mm.data.iter().any(|mm| mm.is_nan() || *mm == f32::NEG_INFINITY) {
            return Err(runtime_error("depth_mm has changed while it was rendered; give a copy: depth_mm.copy()"));
        }
        let indentation_depth_mm = map.indentation_depth_mm();
        let frame =
            DepthFrame { id: String::from("depth_mm"), class: String::new(), shape: Shape::HeightMap(Arc::new(map)) };
        let (split, pressed, pose) = (Split::Train, PressSource::Frame(frame), Pose::IDENTITY);
        let scene = Scene::from_known_press(plan, index, 0, KnownPress { split, pressed, pose, indentation_depth_mm });
        Ok(Arrays::new(plan, press(plan, &scene)))
    }));
    rendered.unwrap_or_else(|panic| Err(map_panic_error(plan, number, index, &*panic)))
}

/// Returns the preset that an unknown name seems to mean; `None` if none is near.
fn guess_preset(name: &str) -> Option<&'static str> {
    guess_choice(name, &PRESETS.map(|(name, _)| name))
}

#[pymethods]
impl Sensor {
    /// Raises a TypeError that says how to make a sensor: the class itself cannot be called.
    #[new]
    #[pyo3(signature = (*given, **named), text_signature = None)]
    fn refuse_call(given: &Bound<'_, PyTuple>, named: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let what = first_text(given, named);
        let preset = what.as_deref().and_then(guess_preset);
        let file = what.as_deref().filter(|_| preset.is_none()).unwrap_or("my.toml");
        let preset = preset.unwrap_or("digit");
        Err(PyTypeError::new_err(format!(
            "gelsim.Sensor is not made by calling it: gelsim.Sensor.preset({preset:?}) makes one that comes with gelsim, \
             gelsim.Sensor.load({file:?}) one of a file"
        )))
    }

    /// One of `gelsim list sensors`, changed by `set`: keys of a job, as in `{"camera.exposure": 1.2}`, or a list of texts as the
    /// command takes them.
    ///
    /// `threads` is for batches: all cores if it is left out, one in a process that multiprocessing started.
    /// Raises UsageError with every mistake.
    #[staticmethod]
    #[pyo3(signature = (name, *, set=None, threads=None), text_signature = "(name, *, set=(), threads=None)")]
    fn preset(
        py: Python<'_>,
        name: &Bound<'_, PyAny>,
        set: OptionalArgument<'_, '_>,
        threads: OptionalArgument<'_, '_>,
    ) -> PyResult<Self> {
        let name = arguments::extract_text("name", name)?;
        if Path::new(&name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
            let help = format!("gelsim.Sensor.load({name:?}) reads a sensor file");
            return Err(mistake_error(format!("no sensor preset is called `{name}`"), help));
        }
        find_by_name("sensor preset", &name, PRESETS)?;
        Self::with_warnings(py, name, set, threads)
    }

    /// A sensor file, such as `gelsim calibrate` writes. `set` and `threads` are those of `preset`.
    #[staticmethod]
    #[pyo3(signature = (path, *, set=None, threads=None), text_signature = "(path, *, set=(), threads=None)")]
    fn load(
        py: Python<'_>,
        path: &Bound<'_, PyAny>,
        set: OptionalArgument<'_, '_>,
        threads: OptionalArgument<'_, '_>,
    ) -> PyResult<Self> {
        let path = arguments::extract_path("path", path)?;
        if let Some(preset) = path.to_str().filter(|_| !path.exists()).and_then(guess_preset) {
            let help = format!("gelsim.Sensor.preset({preset:?}) is one that comes with gelsim");
            return Err(mistake_error(format!("there is no file {}", path.display()), help));
        }
        let absolute =
            std::path::absolute(&path).map_err(|error| runtime_error(format!("{}: {error}", path.display())))?;
        let source = absolute.into_os_string().into_string();
        let source = source.map_err(|path| {
            mistake_error(
                format!("{} is not UTF-8", path.display()),
                "rename the file or its folder: labels and jobs are UTF-8",
            )
        })?;
        Self::with_warnings(py, source, set, threads)
    }

    /// Presses what a depth map (H, W) or (H, W, 1) shows into the pad: a `Sample` with `tactile`, `layers` and `label`.
    ///
    /// `depth_mm` is how far the object reaches below the undeformed pad, mm, as the layer `depth`: 0 where it does not.
    /// Negative values are heights above the pad, which matter where the pad bulges up to them; -inf is nothing there.
    /// Several maps (N, H, W) or (N, H, W, 1) give a `Batch`, rendered on the sensor's threads. The map's resolution wins; the field of
    /// view is the sensor's. `index` and `seed` address what is random in the camera: map k is sample `index` + k.
    /// Raises UsageError for values that cannot be right, TypeError for other types; warns of depth that seems to be in
    /// metres or micrometres, that goes through the pad, and of maps whose pixels are out of proportion.
    ///
    /// On a sensor whose gel has a shape `depth_mm` is a depth frame of a camera where the sensor's lens is: distance from it,
    /// mm, above 0, inf where nothing is, along the optical axis or, with `along="ray"`, along each pixel's ray. The camera
    /// has the sensor's own lens, or with `fov_y_deg` a pinhole's of that angle between its upper and lower edge.
    #[pyo3(
        signature = (depth_mm, *, fidelity=None, layers=None, index=None, seed=None, along=None, fov_y_deg=None),
        text_signature = "($self, depth_mm, *, fidelity=None, layers=(), index=0, seed=0, along=None, fov_y_deg=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "each is a keyword of Python's")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        depth_mm: &Bound<'py, PyAny>,
        fidelity: OptionalArgument<'_, 'py>,
        layers: OptionalArgument<'_, 'py>,
        index: OptionalArgument<'_, 'py>,
        seed: OptionalArgument<'_, 'py>,
        along: OptionalArgument<'_, 'py>,
        fov_y_deg: OptionalArgument<'_, 'py>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let input = DepthMaps::extract_input(depth_mm, self.itself.shape.is_some())?;
        let depth = DepthMaps::new(&input);
        let wanted = |name: &String| find_by_name("layer", name, OutputLayer::ALL.map(|layer| (layer.name(), layer)));
        let names = extract_texts("layers", layers)?;
        // Which is there without being asked for.
        let layers = names.iter().filter(|name| *name != "tactile").map(wanted).collect::<PyResult<Vec<_>>>()?;
        let fidelity = fidelity.map(fidelity_level).transpose()?;
        let index = extract_whole_number("index", index, ALLOWED_INDICES)?.unwrap_or(0);
        let seed = extract_whole_number("seed", seed, ALLOWED_SEEDS)?.unwrap_or(0);
        let rays = self.frame_rays(along, fov_y_deg)?;
        let size_px = depth.resolution_px();
        let resolution_px = match rays {
            Some(FrameRays { fov_y_deg: Some(_), .. }) => self.itself.resolution_px,
            _ => size_px,
        };
        let choice = SimulatorKey { resolution_px, fidelity, frames: rays.map(|rays| (size_px, rays)) };
        self.render_maps(py, &depth, choice, &layers, index, seed)
    }

    /// Name in labels.
    #[getter]
    fn name(&self) -> &str {
        &self.itself.name
    }

    /// Width and height of the sensor's own image.
    #[getter]
    fn resolution_px(&self) -> (usize, usize) {
        self.itself.resolution_px.into()
    }

    /// Width and height of the pad's window that the image shows.
    #[getter]
    fn field_of_view_mm(&self) -> (f64, f64) {
        self.itself.field_of_view_mm.into()
    }

    /// Thickness of the gelpad.
    #[getter]
    fn gelpad_thickness_mm(&self) -> f64 {
        self.itself.gelpad.thickness_mm
    }

    /// True for a flat pad, which is given heights; a gel that has a shape is given distances from its lens.
    #[getter]
    fn is_flat(&self) -> bool {
        self.itself.shape.is_none()
    }

    /// LEDs; `with_leds` makes a sensor with others.
    #[getter]
    fn leds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let led = py.import("gelsim.scene")?.getattr("Led")?;
        let list = PyList::empty(py);
        for each in &self.itself.leds {
            list.append(led.call_method1("_of_json", (parse_json(py, &to_json_line(each))?,))?)?;
        }
        Ok(list)
    }

    /// Returns this sensor with other LEDs in place of its own: `sensor.with_leds([*sensor.leds, gelsim.Led(45.0)])`.
    ///
    /// Raises UsageError with every mistake; warns if the sensor has calibrated optics, which LEDs are no part of.
    fn with_leds(&self, py: Python<'_>, leds: &Bound<'_, PyAny>) -> PyResult<Self> {
        let tables = py.import("gelsim.scene")?.call_method1("led_tables", (leds,))?;
        let mut assignment = String::from("sensor.led = ");
        write_toml("leds", &tables, 0, &mut assignment)?;
        let set: Vec<String> = self.set.iter().cloned().chain([assignment]).collect();
        let (set, threads) = (set.into_pyobject(py)?, self.threads.into_pyobject(py)?);
        let threads = Some(threads.as_any()).filter(|threads| !threads.is_none());
        Self::with_warnings(py, self.source.clone(), Some(&set), threads)
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.itself.resolution_px;
        format!("<gelsim.Sensor {:?}: {width}x{height} px>", self.itself.name)
    }

    /// A sensor never changes: it is its own copy.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PickleParts<'py, (&str, Vec<String>, Option<usize>)> {
        let rebuild = py.import("gelsim._native")?.getattr("_sensor_of_source")?;
        Ok((rebuild, (&self.source, self.set.clone(), self.threads)))
    }
}
