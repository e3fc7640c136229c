//! Samples as numpy's arrays. What was rendered is handed over; only batches are copied together.

use gelsim::dataset::content::{Content, Positions, content};
use gelsim::dataset::encode::json;
use gelsim::job::layers::{Form, OutputLayer};
use gelsim::job::plan::Plan;
use gelsim::job::sample::Sample;
use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{Element, IntoPyArray};
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};

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
        let values = |layer: &OutputLayer| {
            let values = match content(&sample, *layer) {
                Content::Floats(values) => Values::Floats(values),
                Content::Bytes(bytes) => Values::Bytes(bytes.into_owned()),
                Content::Markers(positions) => Values::Markers(vec![positions]),
            };
            (*layer, values)
        };
        Self {
            shape: vec![sample.impression.image.height, sample.impression.image.width],
            layers: plan.layers().iter().map(values).collect(),
            labels: vec![json(&sample.label)],
            tactile: sample.impression.image.rgb,
        }
    }

    /// This sample as the first of a batch of `count`, with room for the others.
    pub fn first_of(mut self, count: usize) -> Self {
        self.shape.insert(0, 1);
        self.tactile.reserve_exact(self.tactile.len() * (count - 1));
        for (_, values) in &mut self.layers {
            values.reserve(count - 1);
        }
        self
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
        let loads = py.import("json")?.getattr("loads")?;
        let labels = self.labels.iter().map(|label| loads.call1((PyString::from_bytes(py, label)?,)));
        dict.set_item("label", one_or_all(py, batch, labels)?)?;
        Ok(dict)
    }
}

impl Values {
    fn reserve(&mut self, times: usize) {
        match self {
            Self::Floats(values) => values.reserve_exact(values.len() * times),
            Self::Bytes(values) => values.reserve_exact(values.len() * times),
            Self::Markers(each) => each.reserve_exact(times),
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

/// numpy, or what to do without it: the command needs none.
pub fn need_numpy(py: Python<'_>) -> PyResult<()> {
    let help = |error: PyErr| {
        let wanted = PyImportError::new_err("gelsim gives and takes arrays of numpy: pip install numpy");
        wanted.set_cause(py, Some(error));
        wanted
    };
    py.import("numpy").map(drop).map_err(help)
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

fn markers(py: Python<'_>, Positions { rest_px, moved_px }: Positions) -> PyResult<Bound<'_, PyAny>> {
    let dict = PyDict::new(py);
    for (name, pairs) in [("rest_px", rest_px), ("moved_px", moved_px)] {
        dict.set_item(name, array(py, &[pairs.len(), 2], pairs.into_flattened())?)?;
    }
    Ok(dict.into_any())
}
