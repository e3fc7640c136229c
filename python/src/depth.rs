//! Depth maps that come as arrays of numpy: one, or a batch of them.

use gelsim::core::base::grid::Grid;
use gelsim::files::diagnostic::Report;
use gelsim::files::diagnostic::user_error;
use numpy::ndarray::{ArrayView2, ArrayViewD, Axis, Ix2};
use numpy::{PyArrayDescrMethods, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::errors::{mistake, usage};

/// An array that was found to hold depth maps.
pub enum Input<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

/// Depth maps, mm below the undeformed pad, in one array of two or three axes.
pub enum Depth<'a> {
    Single(ArrayViewD<'a, f32>),
    Double(ArrayViewD<'a, f64>),
}

/// How the values of one map cannot be right: how many, and where the first is.
#[derive(Clone, Copy, Default)]
struct Wrong {
    nan: Option<(usize, [usize; 3])>,
    infinite: Option<(usize, [usize; 3])>,
    /// Nothing of it lies in the pad or above it.
    all_through: Option<usize>,
}

impl<'a> Depth<'a> {
    /// Takes an array of float32 or float64, of one map or several.
    pub fn array<'py>(given: &Bound<'py, PyAny>) -> PyResult<Input<'py>> {
        let Ok(array) = given.cast::<PyUntypedArray>() else {
            let kind = given.get_type().name()?;
            let message = format!("depth_mm is a {kind}; give an array of numpy: np.asarray(depth_mm, np.float32)");
            return Err(PyTypeError::new_err(message));
        };
        let shape = array.shape();
        let help = "one depth map has the axes (rows, columns), a batch (maps, rows, columns)";
        if !matches!(shape, [_, _] | [_, _, _]) {
            return Err(mistake(format!("depth_mm has {} axes", shape.len()), help));
        }
        if shape.contains(&0) {
            return Err(mistake(format!("depth_mm is empty: its shape is {shape:?}"), help));
        }
        if !given.getattr("flags")?.getattr("aligned")?.is_truthy()? {
            return Err(mistake("depth_mm is not aligned in memory", "give a copy: depth_mm.copy()"));
        }
        if let Ok(array) = array.cast() {
            return Ok(Input::Single(array.try_readonly().map_err(|error| borrowed(&error))?));
        }
        if let Ok(array) = array.cast() {
            return Ok(Input::Double(array.try_readonly().map_err(|error| borrowed(&error))?));
        }
        let dtype = array.dtype();
        let swapped = dtype.byteorder() == b'>';
        let fix = if swapped { "depth_mm.astype(np.float32)" } else { "(depth_mm * mm_per_step).astype(np.float32)" };
        Err(PyTypeError::new_err(format!("depth_mm is {dtype}; give millimetres as float32 or float64: {fix}")))
    }

    /// What is in an array.
    pub fn new(input: &'a Input<'_>) -> Self {
        match input {
            Input::Single(array) => Self::Single(array.as_array()),
            Input::Double(array) => Self::Double(array.as_array()),
        }
    }

    fn shape(&self) -> &[usize] {
        match self {
            Self::Single(view) => view.shape(),
            Self::Double(view) => view.shape(),
        }
    }

    /// Columns and rows.
    pub fn resolution_px(&self) -> [usize; 2] {
        let shape = self.shape();
        [shape[shape.len() - 1], shape[shape.len() - 2]]
    }

    /// How many maps there are; none if it is one by itself.
    pub fn batch(&self) -> Option<usize> {
        match *self.shape() {
            [maps, _, _] => Some(maps),
            _ => None,
        }
    }

    /// Heights over the pad of one map. 0 is how depth layers say that the object does not reach there.
    pub fn above_mm(&self, map: usize) -> Grid<f32> {
        let [width, height] = self.resolution_px();
        let above = |below: f32| if below == 0.0 { f32::INFINITY } else { -below };
        let data = match self {
            Self::Single(view) => plane(view, map).iter().map(|mm| above(*mm)).collect(),
            Self::Double(view) => plane(view, map).iter().map(|mm| above(*mm as f32)).collect(),
        };
        Grid { width, height, data }
    }

    /// Looks for values that cannot be right in a pad of `thickness_mm`. On failure, all kinds of them.
    pub fn check(&self, thickness_mm: f64) -> Result<(), Report> {
        let find = |map: usize| match self {
            Self::Single(view) => Wrong::find(&plane(view, map), map, thickness_mm),
            Self::Double(view) => Wrong::find(&plane(view, map), map, thickness_mm),
        };
        let wrong = match self.batch() {
            Some(maps) => (0..maps).into_par_iter().map(find).reduce(Wrong::default, Wrong::and),
            None => find(0),
        };
        let mut report: Option<Report> = None;
        let mut add = |message: String, help: &str| {
            let found = user_error(message, help);
            report = Some(match report.take() {
                Some(before) => before.and(found),
                None => found,
            });
        };
        let place = |[map, row, column]: [usize; 3]| match self.batch() {
            Some(_) => format!("map {map}, row {row}, column {column}"),
            None => format!("row {row}, column {column}"),
        };
        if let Some((count, first)) = wrong.nan {
            let message = format!("depth_mm has {count} values that are not a number, the first in {}", place(first));
            add(message, "where nothing is, write -inf");
        }
        if let Some((count, first)) = wrong.infinite {
            let message = format!("depth_mm is infinite at {count} places, the first in {}", place(first));
            add(message, "depths are positive into the pad: where nothing is, write -inf");
        }
        if let Some(map) = wrong.all_through {
            let which = self.batch().map_or(String::from("depth_mm"), |_| format!("map {map} of depth_mm"));
            let message = format!("all of {which} goes through the pad, which is {thickness_mm} mm thick");
            add(message, "depth_mm is mm below the undeformed pad, not distance from a camera: plane_mm - distance_mm");
        }
        report.map_or(Ok(()), Err)
    }
}

/// One map.
fn plane<'b, T>(view: &'b ArrayViewD<'_, T>, map: usize) -> ArrayView2<'b, T> {
    let map = if view.ndim() == 3 { view.index_axis(Axis(0), map) } else { view.view() };
    map.into_dimensionality::<Ix2>().expect("two axes are left")
}

impl Wrong {
    fn find<T: Copy + Into<f64>>(plane: &ArrayView2<'_, T>, map: usize, thickness_mm: f64) -> Self {
        let mut wrong = Self::default();
        let (mut all_through, mut all_numbers) = (true, true);
        for value in plane {
            let mm: f64 = (*value).into();
            all_through &= mm >= thickness_mm;
            all_numbers &= mm < f64::INFINITY;
        }
        wrong.all_through = all_through.then_some(map);
        if all_numbers {
            return wrong;
        }
        for ((row, column), value) in plane.indexed_iter() {
            let mm: f64 = (*value).into();
            let note = |found: &mut Option<(usize, [usize; 3])>| {
                found.get_or_insert((0, [map, row, column])).0 += 1;
            };
            if mm.is_nan() {
                note(&mut wrong.nan);
            } else if mm == f64::INFINITY {
                note(&mut wrong.infinite);
            }
        }
        wrong
    }

    /// The same of two sets of maps, those of `other` last.
    fn and(self, other: Self) -> Self {
        let sum = |one: Option<(usize, _)>, other: Option<(usize, _)>| match (one, other) {
            (Some((a, first)), Some((b, _))) => Some((a + b, first)),
            (one, other) => one.or(other),
        };
        Self {
            nan: sum(self.nan, other.nan),
            infinite: sum(self.infinite, other.infinite),
            all_through: self.all_through.or(other.all_through),
        }
    }
}

/// Somebody writes to the array at this moment.
fn borrowed(error: &dyn std::fmt::Display) -> PyErr {
    usage(&user_error(format!("depth_mm cannot be read: {error}"), "give a copy: depth_mm.copy()"))
}
