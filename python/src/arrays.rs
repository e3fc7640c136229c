//! A sample as numpy's arrays. What was rendered is handed over, not copied.

use std::borrow::Cow;

use gelsim::config::output::Layer;
use gelsim::dataset::content::{Content, Positions, content};
use gelsim::dataset::encode::json;
use gelsim::plan::Plan;
use gelsim::render::Sample;
use numpy::ndarray::{Array2, Array3};
use numpy::{Element, IntoPyArray};
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

/// A sample without what nobody asked for, made without Python.
pub struct Arrays {
    size: [usize; 2],
    tactile: Vec<u8>,
    layers: Vec<(Layer, Values)>,
    label: Vec<u8>,
}

/// The values of a layer, the last axis fastest.
enum Values {
    /// Rows, columns.
    Floats(Vec<f32>),
    /// Rows, columns, X Y Z.
    Vectors(Vec<f32>),
    /// Rows, columns.
    Grey(Vec<u8>),
    /// Rows, columns, red green blue.
    Rgb(Vec<u8>),
    /// Two lists of pairs.
    Markers(Positions),
}

impl Arrays {
    /// Of a sample of `plan`, with the plan's layers.
    pub fn new(plan: &Plan, sample: Sample) -> Self {
        let values = |layer: &Layer| {
            let values = match content(plan, &sample, *layer) {
                Content::Floats(plane) => Values::Floats(plane),
                Content::Vectors(vectors) => Values::Vectors(vectors.into_flattened()),
                Content::Grey(grey) => Values::Grey(Cow::into_owned(grey)),
                Content::Rgb(rgb) => Values::Rgb(rgb.to_vec()),
                Content::Markers(positions) => Values::Markers(positions),
            };
            (*layer, values)
        };
        Self {
            size: [sample.image.height, sample.image.width],
            layers: plan.layers.iter().map(values).collect(),
            label: json(&sample.label),
            tactile: sample.image.rgb,
        }
    }

    /// `tactile`, the layers by their names, and `label`.
    pub fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let size = self.size;
        let dict = PyDict::new(py);
        dict.set_item("tactile", colours(py, size, self.tactile)?)?;
        for (layer, values) in self.layers {
            let array = match values {
                Values::Floats(plane) => plain(py, size, plane)?,
                Values::Vectors(vectors) => colours(py, size, vectors)?,
                Values::Grey(grey) => plain(py, size, grey)?,
                Values::Rgb(rgb) => colours(py, size, rgb)?,
                Values::Markers(positions) => markers(py, positions)?,
            };
            dict.set_item(layer.name(), array)?;
        }
        let label = PyString::from_bytes(py, &self.label)?;
        dict.set_item("label", py.import("json")?.call_method1("loads", (label,))?)?;
        Ok(dict)
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

fn plain<T: Element>(py: Python<'_>, [height, width]: [usize; 2], values: Vec<T>) -> PyResult<Bound<'_, PyAny>> {
    let array = Array2::from_shape_vec((height, width), values).map_err(misshapen)?;
    Ok(array.into_pyarray(py).into_any())
}

fn colours<T: Element>(py: Python<'_>, [height, width]: [usize; 2], values: Vec<T>) -> PyResult<Bound<'_, PyAny>> {
    let array = Array3::from_shape_vec((height, width, 3), values).map_err(misshapen)?;
    Ok(array.into_pyarray(py).into_any())
}

fn markers(py: Python<'_>, Positions { rest_px, moved_px }: Positions) -> PyResult<Bound<'_, PyAny>> {
    let dict = PyDict::new(py);
    for (name, pairs) in [("rest_px", rest_px), ("moved_px", moved_px)] {
        let array = Array2::from_shape_vec((pairs.len(), 2), pairs.into_flattened()).map_err(misshapen)?;
        dict.set_item(name, array.into_pyarray(py))?;
    }
    Ok(dict.into_any())
}

/// A bug: every layer has as many values as the image has pixels.
fn misshapen(error: numpy::ndarray::ShapeError) -> PyErr {
    crate::errors::running(error.to_string())
}
