//! Samples as arrays of numpy. The memory of what was rendered is handed over to numpy; only batches are copied.

use std::collections::TryReserveError;

use gelsim_dataset::content::{LayerContent, Positions, layer_content};
use gelsim_dataset::encode::to_json_line;
use gelsim_job::layers::{LayerForm, OutputLayer};
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{Element, IntoPyArray, PyUntypedArray};
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyImportError, PyMemoryError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyCapsule, PyDict, PyList, PyString};

/// A sample, or a batch of samples of one plan one after another, that needs no Python until it becomes arrays.
pub struct Arrays {
    /// Rows and columns; of a batch the number of samples comes first.
    shape: Vec<usize>,
    tactile: Vec<u8>,
    layers: Vec<(OutputLayer, Values)>,
    labels: Vec<Vec<u8>>,
}

/// Values of a layer: rows, columns and, for a layer with several values per pixel, those last.
enum Values {
    /// float32.
    Floats(Vec<f32>),
    /// uint8.
    Bytes(Vec<u8>),
    /// Positions of each sample.
    Markers(Vec<Positions>),
}

impl Arrays {
    /// Takes a sample of `plan`, with the plan's layers.
    pub fn new(plan: &Plan, sample: Sample) -> Self {
        let values = |layer: &OutputLayer| (*layer, Values::from_layer(&sample, *layer));
        Self {
            shape: vec![sample.impression.image.height, sample.impression.image.width],
            layers: plan.layers().iter().map(values).collect(),
            labels: vec![to_json_line(&sample.label)],
            tactile: sample.impression.image.rgb,
        }
    }

    /// Takes a frame of a sequence or a finger of a grip, without label: the sample has one label for all of them.
    pub fn of_frame(plan: &Plan, sample: Sample) -> Self {
        Self { labels: Vec::new(), ..Self::new(plan, sample) }
    }

    /// Turns this sample into the first of a batch of `count`, and reserves memory for the others. Raises MemoryError
    /// if there is too little.
    pub fn into_batch(mut self, count: usize) -> PyResult<Self> {
        self.shape.insert(0, 1);
        let mut room = self.tactile.try_reserve_exact(self.tactile.len() * (count - 1));
        for (_, values) in &mut self.layers {
            room = room.and_then(|()| values.reserve(count - 1));
        }
        let help = |_| PyMemoryError::new_err(format!("what is made of depth_mm's {count} maps: give them in parts"));
        room.map_err(help).map(|()| self)
    }

    /// Appends another sample to a batch.
    pub fn push(&mut self, other: Self) {
        self.shape[0] += 1;
        self.tactile.extend(other.tactile);
        self.labels.extend(other.labels);
        for ((_, values), (_, more)) in self.layers.iter_mut().zip(other.layers) {
            values.extend(more);
        }
    }

    /// Returns `tactile`, the layers by their names, and `label`. In a batch, arrays have the samples as their first
    /// axis, and labels and markers are lists.
    pub fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let plane = self.shape;
        let batch = plane.len() > 2;
        let shape = |form: &LayerForm| match form.values_per_px() {
            None | Some(1) => plane.clone(),
            Some(count) => [plane.as_slice(), &[count]].concat(),
        };
        let dict = PyDict::new(py);
        dict.set_item("tactile", to_array(py, &shape(&LayerForm::Rgb), self.tactile)?)?;
        for (layer, values) in self.layers {
            let array = match values {
                Values::Floats(values) => to_array(py, &shape(&layer.spec().form), values)?,
                Values::Bytes(values) => to_array(py, &shape(&layer.spec().form), values)?,
                Values::Markers(each) => {
                    one_or_all(py, batch, each.into_iter().map(|of_one| marker_array(py, of_one)))?
                }
            };
            dict.set_item(layer.name(), array)?;
        }
        if !self.labels.is_empty() {
            let labels = self.labels.iter().map(|label| parse_json(py, label));
            dict.set_item("label", one_or_all(py, batch, labels)?)?;
        }
        Ok(dict)
    }
}

impl Values {
    fn from_layer(sample: &Sample, layer: OutputLayer) -> Self {
        match layer_content(sample, layer) {
            LayerContent::Floats(values) => Self::Floats(values),
            LayerContent::Bytes(bytes) => Self::Bytes(bytes.into_owned()),
            LayerContent::Markers(positions) => Self::Markers(vec![positions]),
        }
    }

    /// Reserves memory for `times` more samples.
    fn reserve(&mut self, times: usize) -> Result<(), TryReserveError> {
        match self {
            Self::Floats(values) => values.try_reserve_exact(values.len() * times),
            Self::Bytes(values) => values.try_reserve_exact(values.len() * times),
            Self::Markers(each) => each.try_reserve_exact(times),
        }
    }

    /// Appends the values of more samples.
    fn extend(&mut self, more: Self) {
        match (self, more) {
            (Self::Floats(values), Self::Floats(more)) => values.extend(more),
            (Self::Bytes(values), Self::Bytes(more)) => values.extend(more),
            (Self::Markers(each), Self::Markers(more)) => each.extend(more),
            _ => unreachable!("samples of one plan have the same layers"),
        }
    }
}

/// Returns one layer of a sample as an array; markers as a dictionary of arrays.
pub fn layer_array<'py>(py: Python<'py>, sample: &Sample, layer: OutputLayer) -> PyResult<Bound<'py, PyAny>> {
    let image = &sample.impression.image;
    let channels = layer.spec().form.values_per_px().filter(|count| *count > 1);
    let shape: Vec<usize> = [image.height, image.width].into_iter().chain(channels).collect();
    match py.detach(|| Values::from_layer(sample, layer)) {
        Values::Floats(values) => to_array(py, &shape, values),
        Values::Bytes(values) => to_array(py, &shape, values),
        Values::Markers(mut each) => marker_array(py, each.remove(0)),
    }
}

/// Returns the pixels of the tactile image of a sample as an array (rows, columns, 3).
pub fn image_array<'py>(py: Python<'py>, sample: &Sample, rgb: Vec<u8>) -> PyResult<Bound<'py, PyAny>> {
    let image = &sample.impression.image;
    to_array(py, &[image.height, image.width, 3], rgb)
}

/// Reads JSON as Python objects.
pub fn parse_json<'py>(py: Python<'py>, text: &[u8]) -> PyResult<Bound<'py, PyAny>> {
    json_scanner(py)?.call1((PyString::from_bytes(py, text)?, 0))?.get_item(0)
}

/// Returns the function that `json.loads` calls to read JSON, which is written in C. While Python shuts down it ends
/// every thread that runs Python code, and the whole process if Rust called that code. So samples are made without any
/// Python code.
fn json_scanner(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static SCAN_ONCE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let found = || Ok(py.import("json")?.getattr("JSONDecoder")?.call0()?.getattr("scan_once")?.unbind());
    SCAN_ONCE.get_or_try_init(py, found).map(|scan| scan.bind(py))
}

/// Checks for numpy, and raises an ImportError that says how to install it: the command needs none. Also loads what
/// samples need of Python, so that it is missing here or never.
pub fn require_numpy(py: Python<'_>) -> PyResult<()> {
    let help = |error: PyErr| {
        let wanted = PyImportError::new_err("gelsim gives and takes arrays of numpy: pip install numpy");
        wanted.set_cause(py, Some(error));
        wanted
    };
    // The crate `numpy` panics if it does not find these, as in a folder with a numpy.py of its own.
    let found = || {
        let core = py.import("numpy")?.getattr("_core").or_else(|_| py.import("numpy")?.getattr("core"))?;
        core.getattr("multiarray")?.getattr("_ARRAY_API")?.cast::<PyCapsule>()?;
        py.import("numpy.lib")?.getattr("NumpyVersion").map(drop)
    };
    found().map_err(help)?;
    // The crate caches what it needs at this call.
    PyUntypedArray::type_object(py);
    json_scanner(py).map(drop)
}

/// Turns values into an array of this shape without copying.
fn to_array<'py, T: Element>(py: Python<'py>, shape: &[usize], values: Vec<T>) -> PyResult<Bound<'py, PyAny>> {
    // It cannot fail: every layer has as many values as the image has pixels.
    let array = ArrayD::from_shape_vec(IxDyn(shape), values)
        .map_err(|error| crate::errors::runtime_error(error.to_string()))?;
    Ok(array.into_pyarray(py).into_any())
}

/// Returns the list of a batch, or of a single sample its only entry.
fn one_or_all<'py>(
    py: Python<'py>,
    batch: bool,
    each: impl Iterator<Item = PyResult<Bound<'py, PyAny>>>,
) -> PyResult<Bound<'py, PyAny>> {
    let list = PyList::new(py, each.collect::<PyResult<Vec<_>>>()?)?;
    if batch { Ok(list.into_any()) } else { list.get_item(0) }
}

/// Returns the positions of markers as a dictionary of arrays; those in mm only if the layer has them.
fn marker_array(py: Python<'_>, positions: Positions) -> PyResult<Bound<'_, PyAny>> {
    let Positions { rest_px, moved_px, rest_mm, moved_mm } = positions;
    let dict = PyDict::new(py);
    for (name, pairs) in [("rest_px", rest_px), ("moved_px", moved_px)] {
        dict.set_item(name, to_array(py, &[pairs.len(), 2], pairs.into_flattened())?)?;
    }
    for (name, triples) in [("rest_mm", rest_mm), ("moved_mm", moved_mm)] {
        if !triples.is_empty() {
            dict.set_item(name, to_array(py, &[triples.len(), 3], triples.into_flattened())?)?;
        }
    }
    Ok(dict.into_any())
}
