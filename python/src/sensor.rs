//! `gelsim.Sensor`: tactile images of depth maps that come as arrays; of depth frames, on a sensor whose gel has a shape.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use gelsim_core::camera::projection::LensModel;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::optics::led::Led;
use gelsim_core::pose::Pose;
use gelsim_dataset::encode::json;
use gelsim_dataset::frames::camera::{Along, DepthCamera, Projection, Unit};
use gelsim_dataset::frames::reader::FrameReader;
use gelsim_dataset::frames::run::sample;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::sensor::PRESETS;
use gelsim_job::config::{Overrides, choice};
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::plan::frames::Frames;
use gelsim_job::plan::standalone::sensor;
use gelsim_job::sample::press;
use gelsim_job::scene::{Frame, KnownPress, Pressed, Scene};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use rayon::prelude::*;

use crate::arguments::{self, Given, assignments, first, texts, whole, write_toml};
use crate::arrays::{Arrays, need_numpy, parsed};
use crate::depth::{Depth, Seen};
use crate::errors::{fidelity_level, mistake, named, panicked, running, usage, warn};
use crate::job::{LARGEST_SEED, Pickled};
use crate::threads::{checked, pool};

/// Maps that each thread renders before Python may look at signals.
const BLOCK: usize = 8;

/// What a sample's number may be.
pub const LARGEST_INDEX: &str = "give 0 to 18446744073709551615";

/// Simulators that are kept: who changes resolution or fidelity with every call waits every time.
const MOST_SIMULATORS: usize = 8;

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
    itself: gelsim_core::sensor::Sensor,
    /// Its LEDs, as `set` has them.
    leds: Vec<Led>,
    /// What is not meant of it, perhaps, at its own resolution.
    notes: Report,
    /// The simulators that were used last, the very last at the end. The lock is taken with the GIL only, and not for long.
    simulators: Mutex<Vec<(Choice, Ready)>>,
}

/// What a simulator depends on beside the sensor.
#[derive(Clone, Copy, PartialEq)]
struct Choice {
    resolution_px: [usize; 2],
    fidelity: Option<Fidelity>,
    /// Of a gel that has a shape: columns and rows of the frames, and what took them.
    frames: Option<([usize; 2], Rays)>,
}

/// What takes depth frames inside a gel that has a shape.
#[derive(Clone, Copy, PartialEq)]
struct Rays {
    along: Along,
    fov_y_deg: Option<f64>,
}

/// A plan over a simulator, and what reads frames for it if its gel has a shape.
#[derive(Clone)]
struct Ready {
    plan: Plan,
    reader: Option<Arc<FrameReader>>,
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
    Sensor::new(py, arguments::text("source", source)?, set, threads)
}

impl Sensor {
    /// Reads it, and makes the plan of its own resolution, in which its mistakes and notes are.
    fn new(py: Python<'_>, source: String, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        need_numpy(py)?;
        let (set, threads) = (assignments("set", set)?, checked(threads)?);
        let itself = py.detach(|| sensor(&source)).map_err(|report| usage(&report))?.sensor;
        let (leds, notes, simulators) = (Vec::new(), Report::default(), Mutex::default());
        let sensor = Self { source, set, threads, itself, leds, notes, simulators };
        let resolution_px = sensor.itself.resolution_px;
        let (ready, _) = sensor.ready(py, Choice { resolution_px, fidelity: None, frames: None })?;
        Ok(Self { leds: ready.plan.simulator.sensor().leds.clone(), notes: ready.plan.notes, ..sensor })
    }

    fn noted(py: Python<'_>, source: String, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        let sensor = Self::new(py, source, set, threads)?;
        warn(py, &sensor.notes)?;
        Ok(sensor)
    }

    /// What a plan for maps of another resolution has to say that has not been said of the sensor itself.
    pub fn news(&self, plan: &Plan) -> Report {
        let is_said = |note: &Diagnostic| self.notes.problems().iter().any(|said| said.message == note.message);
        let mut news = Diagnostics::default();
        news.extend(plan.notes.problems().iter().filter(|note| !is_said(note)).cloned());
        // The resolution is the map's.
        Report::new(&news, &[]).saying("`sensor.resolution_px = ", "a map of `[columns, rows] = ")
    }

    /// A plan over the simulator of a choice, which is made where it is not one of those that were used last; true with it if it
    /// was made.
    fn ready(&self, py: Python<'_>, choice: Choice) -> PyResult<(Ready, bool)> {
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
        let own_pixels = choice.frames.is_none_or(|(_, rays)| rays.fov_y_deg.is_none());
        if found != choice.resolution_px && own_pixels {
            let ([width, height], [columns, rows]) = (found, choice.resolution_px);
            let message =
                format!("depth_mm has {rows} rows and {columns} columns, `set` makes them {height} and {width}");
            return Err(mistake(message, "leave sensor.resolution_px out: a map brings its own"));
        }
        // `set` may have changed the lens.
        let has_fov = choice.frames.is_some_and(|(_, rays)| rays.fov_y_deg.is_some());
        if has_fov && plan.simulator.sensor().lens == LensModel::Orthographic {
            let message = "the sensor's lens has parallel rays, and so no place for a perspective camera";
            return Err(mistake(message, "leave fov_y_deg out"));
        }
        let reader = match choice.frames {
            None => None,
            Some((size_px, Rays { along, fov_y_deg })) => {
                let projection =
                    fov_y_deg.map_or(Projection::Orthographic, |fov_y_deg| Projection::Perspective { fov_y_deg });
                let camera = DepthCamera { projection, along, ..FROM_LENS };
                let reader = |camera| py.detach(|| FrameReader::new(camera, &plan.simulator, size_px));
                let refused = |problem: Diagnostic| {
                    // What is too large is so along rays, too.
                    let is_for_axis =
                        along == Along::Axis && reader(DepthCamera { along: Along::Ray, ..camera }).is_ok();
                    let help = match is_for_axis {
                        true => "give distances along each pixel's own ray: along=\"ray\"",
                        false => "give smaller frames",
                    };
                    mistake(format!("depth_mm: {}", problem.message), help)
                };
                Some(Arc::new(reader(camera).map_err(refused)?))
            }
        };
        let ready = Ready { plan, reader };
        let mut simulators = simulators();
        if simulators.len() == MOST_SIMULATORS {
            simulators.remove(0);
        }
        simulators.push((choice, ready.clone()));
        Ok((ready, true))
    }

    /// A plan of it as it is, with more assignments, for what is pressed by itself: of its own resolution or another one.
    pub fn plan(
        &self,
        py: Python<'_>,
        fidelity: Fidelity,
        resolution_px: Option<[usize; 2]>,
        set: &[String],
        layers: &[OutputLayer],
    ) -> PyResult<Plan> {
        let overrides = Overrides::of_flags(None, None, Some(fidelity), false, &[&self.set, set].concat());
        let frames = Frames {
            sensor: &self.source,
            resolution_px: resolution_px.unwrap_or(self.itself.resolution_px),
            layers,
            classes: &[],
            sequence: false,
            moved: false,
            overrides: &overrides,
        };
        let pool = pool(py, self.threads)?;
        py.detach(|| pool.install(|| frames.plan())).map_err(|report| usage(&report))
    }

    /// What took the frames of a sensor whose gel has a shape; none if it is flat.
    fn rays(&self, along: Given<'_, '_>, fov_y_deg: Given<'_, '_>) -> PyResult<Option<Rays>> {
        if self.itself.shape.is_none() {
            return match along.or(fov_y_deg) {
                None => Ok(None),
                Some(_) => {
                    let help =
                        "leave `along` and `fov_y_deg` out: depth_mm is how far the object reaches below the pad";
                    Err(mistake("this sensor is flat, and its maps have no rays", help))
                }
            };
        }
        let lines = [("axis", Along::Axis), ("ray", Along::Ray)];
        let along = along.map(|along| named("line", &arguments::text("along", along)?, lines)).transpose()?;
        let fov_y_deg = fov_y_deg.map(|fov| arguments::number("fov_y_deg", fov)).transpose()?;
        if fov_y_deg.is_some_and(|fov| !(fov > 0.0 && fov <= 170.0)) {
            return Err(mistake("fov_y_deg is out of range", "allowed: above 0, up to 170 degrees"));
        }
        Ok(Some(Rays { along: along.unwrap_or_default(), fov_y_deg }))
    }
}

/// A camera in the place of a lens, and millimetres.
const FROM_LENS: DepthCamera = DepthCamera {
    unit: Unit::Millimetre,
    plane_mm: 0.0,
    max_depth_mm: None,
    background: None,
    flip: [false; 2],
    offset_px: [0.0; 2],
    projection: Projection::Orthographic,
    along: Along::Axis,
};

/// Frame `number` of an input pressed into a gel that has a shape, as sample `index`.
fn render_seen(ready: &Ready, reader: &FrameReader, depth: &Depth<'_>, number: usize, index: u64) -> PyResult<Arrays> {
    let plan = &ready.plan;
    let rendered = catch_unwind(AssertUnwindSafe(|| {
        let of_frame = |problem: Diagnostic, help: &str| {
            let which = depth.batch().map_or_else(String::new, |_| format!("map {number}: "));
            mistake(format!("{which}{}", problem.message), help)
        };
        let seen = reader.read(depth.values(number)).map_err(|problem| {
            of_frame(problem, "depth_mm is the distance from the lens, above 0; where nothing is, write inf")
        })?;
        if let Some(problem) = seen.reach().mistake(&FROM_LENS) {
            let help = "depth_mm is the distance from the lens in mm, along its axis unless along=\"ray\"";
            return Err(of_frame(problem, help));
        }
        Ok(Arrays::new(plan, sample(plan, index, "depth_mm", seen, None)))
    }));
    rendered.unwrap_or_else(|panic| Err(bug(plan, number, index, &*panic)))
}

fn bug(plan: &Plan, number: usize, index: u64, panic: &(dyn Any + Send)) -> PyErr {
    panicked(&format!("map {number} (sample {index}, seed {})", plan.seed()), panic)
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
        let frame =
            Frame { id: String::from("depth_mm"), class: String::new(), shape: Shape::HeightMap(Arc::new(map)) };
        let (split, pressed, pose) = (Split::Train, Pressed::Frame(frame), Pose::IDENTITY);
        let scene = Scene::given(plan, index, 0, KnownPress { split, pressed, pose, indentation_depth_mm });
        Ok(Arrays::new(plan, press(plan, &scene)))
    }));
    rendered.unwrap_or_else(|panic| Err(bug(plan, number, index, &*panic)))
}

/// The preset that is meant by what is none.
fn preset_of(name: &str) -> Option<&'static str> {
    choice(name, &PRESETS.map(|(name, _)| name))
}

#[pymethods]
impl Sensor {
    /// Whoever calls the class itself is told what makes a sensor.
    #[new]
    #[pyo3(signature = (*given, **named), text_signature = None)]
    fn itself(given: &Bound<'_, PyTuple>, named: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let what = first(given, named);
        let preset = what.as_deref().and_then(preset_of);
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
    fn preset(py: Python<'_>, name: &Bound<'_, PyAny>, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        let name = arguments::text("name", name)?;
        if Path::new(&name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
            let help = format!("gelsim.Sensor.load({name:?}) reads a sensor file");
            return Err(mistake(format!("no sensor preset is called `{name}`"), help));
        }
        named("sensor preset", &name, PRESETS)?;
        Self::noted(py, name, set, threads)
    }

    /// A sensor file, such as `gelsim calibrate` writes. `set` and `threads` are those of `preset`.
    #[staticmethod]
    #[pyo3(signature = (path, *, set=None, threads=None), text_signature = "(path, *, set=(), threads=None)")]
    fn load(py: Python<'_>, path: &Bound<'_, PyAny>, set: Given<'_, '_>, threads: Given<'_, '_>) -> PyResult<Self> {
        let path = arguments::path("path", path)?;
        if let Some(preset) = path.to_str().filter(|_| !path.exists()).and_then(preset_of) {
            let help = format!("gelsim.Sensor.preset({preset:?}) is one that comes with gelsim");
            return Err(mistake(format!("there is no file {}", path.display()), help));
        }
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
        fidelity: Given<'_, 'py>,
        layers: Given<'_, 'py>,
        index: Given<'_, 'py>,
        seed: Given<'_, 'py>,
        along: Given<'_, 'py>,
        fov_y_deg: Given<'_, 'py>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let input = Depth::array(depth_mm, self.itself.shape.is_some())?;
        let depth = Depth::new(&input);
        let wanted = |name: &String| named("layer", name, OutputLayer::ALL.map(|layer| (layer.name(), layer)));
        let layers = texts("layers", layers)?.iter().map(wanted).collect::<PyResult<Vec<_>>>()?;
        let fidelity = fidelity.map(fidelity_level).transpose()?;
        let index = whole("index", index, LARGEST_INDEX)?.unwrap_or(0);
        let seed = whole("seed", seed, LARGEST_SEED)?.unwrap_or(0);
        let rays = self.rays(along, fov_y_deg)?;
        let size_px = depth.resolution_px();
        let resolution_px = match rays {
            Some(Rays { fov_y_deg: Some(_), .. }) => self.itself.resolution_px,
            _ => size_px,
        };
        let choice = Choice { resolution_px, fidelity, frames: rays.map(|rays| (size_px, rays)) };
        let (mut ready, is_new) = self.ready(py, choice)?;
        if is_new {
            warn(py, &self.news(&ready.plan))?;
        }
        ready.plan = ready.plan.with_samples(seed, &layers).map_err(|report| usage(&report))?;
        let (plan, inside) = (&ready.plan, ready.reader.as_deref());
        let one = |number: usize| {
            let index = index.wrapping_add(number as u64);
            match inside {
                Some(reader) => render_seen(&ready, reader, &depth, number, index),
                None => render(plan, &depth, number, index),
            }
        };
        let thickness_mm = plan.thickness_mm();
        let judged = |seen: &Seen| {
            let notes = depth.judge(seen, thickness_mm).map_err(|report| usage(&report))?;
            warn(py, &notes)
        };
        let Some(maps) = depth.batch() else {
            if inside.is_none() {
                judged(&py.detach(|| depth.look(0..1, thickness_mm)))?;
            }
            return py.detach(|| one(0))?.into_dict(py);
        };
        let pool = pool(py, self.threads)?;
        let mut seen = Seen::NOTHING;
        for block in depth.blocks().filter(|_| inside.is_none()) {
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

    /// Its name in labels.
    #[getter]
    fn name(&self) -> &str {
        &self.itself.name
    }

    /// Width and height of its own image.
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

    /// Its LEDs; `with_leds` gives a sensor with others.
    #[getter]
    fn leds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let led = py.import("gelsim.scene")?.getattr("Led")?;
        let list = PyList::empty(py);
        for each in &self.leds {
            list.append(led.call_method1("_of_json", (parsed(py, &json(each))?,))?)?;
        }
        Ok(list)
    }

    /// The same sensor with these LEDs in place of its own: `sensor.with_leds([*sensor.leds, gelsim.Led(45.0)])`.
    ///
    /// Raises UsageError with every mistake; warns where the sensor's light is measured, so that LEDs are no part of it.
    fn with_leds(&self, py: Python<'_>, leds: &Bound<'_, PyAny>) -> PyResult<Self> {
        let tables = py.import("gelsim.scene")?.call_method1("led_tables", (leds,))?;
        let mut assignment = String::from("sensor.led = ");
        write_toml("leds", &tables, 0, &mut assignment)?;
        let set: Vec<String> = self.set.iter().cloned().chain([assignment]).collect();
        let (set, threads) = (set.into_pyobject(py)?, self.threads.into_pyobject(py)?);
        let threads = Some(threads.as_any()).filter(|threads| !threads.is_none());
        Self::noted(py, self.source.clone(), Some(&set), threads)
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
