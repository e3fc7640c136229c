//! Samples as numpy's arrays. What was rendered is handed over; only batches are copied together.

use std::collections::TryReserveError;

use gelsim_dataset::content::{Content, Positions, content};
use gelsim_dataset::encode::json;
use gelsim_job::layers::{Form, OutputLayer};
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{Element, IntoPyArray, PyUntypedArray};
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyImportError, PyMemoryError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyCapsule, PyDict, PyList, PyString};

/// A sample, or several of one plan behind each other, made without Python.
pub struct Arrays {
    /// Rows and columns; of several samples their number goes first.
    shape: Vec<usize>,
    tactile: Vec<u8>,
    layers: Vec<(OutputLayer, Values)>,
    labels: Vec<Vec<u8>>,
}

/// The values of a layer: rows, columns and, where a pixel has several values, those.
enum Values {
    /// float32.
    Floats(Vec<f32>),
    /// uint8.
    Bytes(Vec<u8>),
    /// One for each sample.
    Markers(Vec<Positions>),
}

impl Arrays {
    /// Of a sample of `plan`, with the plan's layers.
    pub fn new(plan: &Plan, sample: Sample) -> Self {
        let values = |layer: &OutputLayer| (*layer, Values::of(&sample, *layer));
        Self {
            shape: vec![sample.impression.image.height, sample.impression.image.width],
            layers: plan.layers().iter().map(values).collect(),
            labels: vec![json(&sample.label)],
            tactile: sample.impression.image.rgb,
        }
    }

    /// A frame of a sequence or a finger of a grip: its label is the whole's.
    pub fn of_frame(plan: &Plan, sample: Sample) -> Self {
        Self { labels: Vec::new(), ..Self::new(plan, sample) }
    }

    /// This sample as the first of a batch of `count`, with room for the others.
    pub fn first_of(mut self, count: usize) -> PyResult<Self> {
        self.shape.insert(0, 1);
        let mut room = self.tactile.try_reserve_exact(self.tactile.len() * (count - 1));
        for (_, values) in &mut self.layers {
            room = room.and_then(|()| values.reserve(count - 1));
        }
        let help = |_| PyMemoryError::new_err(format!("what is made of depth_mm's {count} maps: give them in parts"));
        room.map_err(help).map(|()| self)
    }

    /// Puts another sample behind the last of a batch.
    pub fn push(&mut self, other: Self) {
        self.shape[0] += 1;
        self.tactile.extend(other.tactile);
        self.labels.extend(other.labels);
        for ((_, values), (_, more)) in self.layers.iter_mut().zip(other.layers) {
            values.extend(more);
        }
    }

    /// `tactile`, the layers by their names, and `label`; in a batch arrays have the samples as their first axis, and
    /// labels and markers are lists.
    pub fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let plane = self.shape;
        let batch = plane.len() > 2;
        let shape = |form: &Form| match form.values_per_px() {
            None | Some(1) => plane.clone(),
            Some(count) => [plane.as_slice(), &[count]].concat(),
        };
        let dict = PyDict::new(py);
        dict.set_item("tactile", array(py, &shape(&Form::Rgb), self.tactile)?)?;
        for (layer, values) in self.layers {
            let array = match values {
                Values::Floats(values) => array(py, &shape(&layer.spec().form), values)?,
                Values::Bytes(values) => array(py, &shape(&layer.spec().form), values)?,
                Values::Markers(each) => one_or_all(py, batch, each.into_iter().map(|of_one| markers(py, of_one)))?,
            };
            dict.set_item(layer.name(), array)?;
        }
        if !self.labels.is_empty() {
            let labels = self.labels.iter().map(|label| parsed(py, label));
            dict.set_item("label", one_or_all(py, batch, labels)?)?;
        }
        Ok(dict)
    }
}

impl Values {
    fn of(sample: &Sample, layer: OutputLayer) -> Self {
        match content(sample, layer) {
            Content::Floats(values) => Self::Floats(values),
            Content::Bytes(bytes) => Self::Bytes(bytes.into_owned()),
            Content::Markers(positions) => Self::Markers(vec![positions]),
        }
    }

    fn reserve(&mut self, times: usize) -> Result<(), TryReserveError> {
        match self {
            Self::Floats(values) => values.try_reserve_exact(values.len() * times),
            Self::Bytes(values) => values.try_reserve_exact(values.len() * times),
            Self::Markers(each) => each.try_reserve_exact(times),
        }
    }

    fn extend(&mut self, more: Self) {
        match (self, more) {
            (Self::Floats(values), Self::Floats(more)) => values.extend(more),
            (Self::Bytes(values), Self::Bytes(more)) => values.extend(more),
            (Self::Markers(each), Self::Markers(more)) => each.extend(more),
            _ => unreachable!("samples of one plan have the same layers"),
        }
    }
}

/// One layer of a sample.
pub fn layer<'py>(py: Python<'py>, sample: &Sample, layer: OutputLayer) -> PyResult<Bound<'py, PyAny>> {
    let image = &sample.impression.image;
    let channels = layer.spec().form.values_per_px().filter(|count| *count > 1);
    let shape: Vec<usize> = [image.height, image.width].into_iter().chain(channels).collect();
    match py.detach(|| Values::of(sample, layer)) {
        Values::Floats(values) => array(py, &shape, values),
        Values::Bytes(values) => array(py, &shape, values),
        Values::Markers(mut each) => markers(py, each.remove(0)),
    }
}

/// The tactile image of a sample.
pub fn image<'py>(py: Python<'py>, sample: &Sample) -> PyResult<Bound<'py, PyAny>> {
    let image = &sample.impression.image;
    array(py, &[image.height, image.width, 3], image.rgb.clone())
}

/// JSON as Python's objects.
pub fn parsed<'py>(py: Python<'py>, text: &[u8]) -> PyResult<Bound<'py, PyAny>> {
    scanner(py)?.call1((PyString::from_bytes(py, text)?, 0))?.get_item(0)
}

/// What `json.loads` calls to read JSON, which is C. As Python ends it ends threads wherever they run Python's code, and
/// the whole process where Rust has called that code: samples are made without any.
fn scanner(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static SCAN_ONCE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let found = || Ok(py.import("json")?.getattr("JSONDecoder")?.call0()?.getattr("scan_once")?.unbind());
    SCAN_ONCE.get_or_try_init(py, found).map(|scan| scan.bind(py))
}

/// numpy, or what to do without it: the command needs none. What samples need of Python is found here.
pub fn need_numpy(py: Python<'_>) -> PyResult<()> {
    let help = |error: PyErr| {
        let wanted = PyImportError::new_err("gelsim gives and takes arrays of numpy: pip install numpy");
        wanted.set_cause(py, Some(error));
        wanted
    };
    // The crate `numpy` panics where these are not found, as in a folder that has a numpy.py of its own.
    let found = || {
        let core = py.import("numpy")?.getattr("_core").or_else(|_| py.import("numpy")?.getattr("core"))?;
        core.getattr("multiarray")?.getattr("_ARRAY_API")?.cast::<PyCapsule>()?;
        py.import("numpy.lib")?.getattr("NumpyVersion").map(drop)
    };
    found().map_err(help)?;
    // It keeps what it needs from here on.
    PyUntypedArray::type_object(py);
    scanner(py).map(drop)
}

fn array<'py, T: Element>(py: Python<'py>, shape: &[usize], values: Vec<T>) -> PyResult<Bound<'py, PyAny>> {
    // It cannot fail: every layer has as many values as the image has pixels.
    let array =
        ArrayD::from_shape_vec(IxDyn(shape), values).map_err(|error| crate::errors::running(error.to_string()))?;
    Ok(array.into_pyarray(py).into_any())
}

/// The list of a batch; else its only entry.
fn one_or_all<'py>(
    py: Python<'py>,
    batch: bool,
    each: impl Iterator<Item = PyResult<Bound<'py, PyAny>>>,
) -> PyResult<Bound<'py, PyAny>> {
    let list = PyList::new(py, each.collect::<PyResult<Vec<_>>>()?)?;
    if batch { Ok(list.into_any()) } else { list.get_item(0) }
}

fn markers(py: Python<'_>, positions: Positions) -> PyResult<Bound<'_, PyAny>> {
    let Positions { rest_px, moved_px, rest_mm, moved_mm } = positions;
    let dict = PyDict::new(py);
    for (name, pairs) in [("rest_px", rest_px), ("moved_px", moved_px)] {
        dict.set_item(name, array(py, &[pairs.len(), 2], pairs.into_flattened())?)?;
    }
    for (name, triples) in [("rest_mm", rest_mm), ("moved_mm", moved_mm)] {
        if !triples.is_empty() {
            dict.set_item(name, array(py, &[triples.len(), 3], triples.into_flattened())?)?;
        }
    }
    Ok(dict.into_any())
}
