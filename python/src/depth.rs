//! Depth maps that come as arrays of numpy: a single one, or a batch.

use std::ops::Range;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::MOST_PX;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use numpy::ndarray::{ArrayView2, ArrayViewD, Axis, Ix2};
use numpy::{PyArrayDescrMethods, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arguments::describe_type;
use crate::errors::{mistake_error, usage_error};

/// An array that was checked to hold depth maps.
pub enum DepthInput<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

/// Depth maps, mm below the undeformed pad, in one array of two or three axes.
pub enum DepthMaps<'a> {
    Single(ArrayViewD<'a, f32>),
    Double(ArrayViewD<'a, f64>),
}

/// What is odd about depth maps: which values cannot be right, how many there are, and where the first is.
#[derive(Clone, Copy)]
pub struct DepthFindings {
    /// Count of values that are not a number; map, row and column of the first.
    nan: Option<(usize, [usize; 3])>,
    /// Count of values that are infinitely deep; map, row and column of the first.
    infinite: Option<(usize, [usize; 3])>,
    /// The first map in which every number is at least as deep as the pad is thick.
    all_through: Option<usize>,
    deepest_mm: f64,
}

/// Most pixels of a batch: the results of more would not fit into memory.
const MAX_BATCH_PX: usize = 1 << 32;

/// Memory of a map's label, in pixels.
const LABEL_PX: usize = 1 << 12;

/// Pixels that are checked before Python may handle signals.
const BLOCK_PX: usize = 1 << 26;

impl<'a> DepthMaps<'a> {
    /// Checks an array of float32 or float64 with one map or several. `is_distance` is true for frames from inside a
    /// gel, whose empty pixels are inf instead of -inf.
    pub fn extract_input<'py>(given: &Bound<'py, PyAny>, is_distance: bool) -> PyResult<DepthInput<'py>> {
        let Ok(array) = given.cast::<PyUntypedArray>() else {
            let message = format!(
                "depth_mm is {}; give an array of numpy: np.asarray(depth_mm, np.float32)",
                describe_type(given)
            );
            return Err(PyTypeError::new_err(message));
        };
        let shape = array.shape();
        let help = "one depth map has the axes (rows, columns), a batch (maps, rows, columns)";
        if shape.contains(&0) {
            return Err(mistake_error(format!("depth_mm is empty: its shape is {shape:?}"), help));
        }
        // The last axis may be the single channel of a depth camera. A map that is one pixel wide is not to be
        // expected.
        let shape = match shape {
            [rest @ .., 1] if matches!(rest, [_, _] | [_, _, _]) && rest[rest.len() - 1] > 1 => rest,
            shape => shape,
        };
        if !matches!(shape, [_, _] | [_, _, _]) {
            return Err(mistake_error(format!("depth_mm has {} axes", shape.len()), help));
        }
        let [rows, columns] = [shape[shape.len() - 2], shape[shape.len() - 1]];
        if rows.max(columns) > MOST_PX {
            let message = format!("depth_mm has {rows} rows and {columns} columns");
            return Err(mistake_error(
                message,
                format!("give at most {MOST_PX} of each, as many as the sensor's image shall have"),
            ));
        }
        if shape.len() == 3 && shape[0] > MAX_BATCH_PX / (rows * columns + LABEL_PX) {
            let message = format!("depth_mm has {} maps of {rows} rows and {columns} columns", shape[0]);
            return Err(mistake_error(message, "give them in parts: what is made of so many fits no memory"));
        }
        let py = given.py();
        // numpy loads this module when it is first needed: until then no array can be masked.
        let masked = |ma: Bound<'py, PyAny>| given.is_instance(&ma.getattr("MaskedArray")?);
        if py.import("sys")?.getattr("modules")?.get_item("numpy.ma").and_then(masked).unwrap_or(false) {
            let nothing = if is_distance { "np.inf" } else { "-np.inf" };
            return Err(PyTypeError::new_err(format!(
                "depth_mm is a masked array; say what is where it is masked: depth_mm.filled({nothing})"
            )));
        }
        // Ask numpy itself: a subclass may override `flags`.
        let flags = py.get_type::<PyUntypedArray>().getattr("flags")?.call_method1("__get__", (given,))?;
        if !flags.getattr("aligned")?.is_truthy()? {
            return Err(mistake_error("depth_mm is not aligned in memory", "give a copy: depth_mm.copy()"));
        }
        if let Ok(array) = array.cast() {
            return Ok(DepthInput::Single(array.try_readonly().map_err(|error| borrow_error(&error))?));
        }
        if let Ok(array) = array.cast() {
            return Ok(DepthInput::Double(array.try_readonly().map_err(|error| borrow_error(&error))?));
        }
        let dtype = array.dtype();
        let steps = matches!(dtype.kind(), b'i' | b'u');
        let fix = if steps { "(depth_mm * mm_per_step).astype(np.float32)" } else { "depth_mm.astype(np.float32)" };
        Err(PyTypeError::new_err(format!("depth_mm is {dtype}; give millimetres as float32 or float64: {fix}")))
    }

    /// Borrows the maps of a checked array.
    pub fn new(input: &'a DepthInput<'_>) -> Self {
        match input {
            DepthInput::Single(array) => Self::Single(drop_channel_axis(array.as_array())),
            DepthInput::Double(array) => Self::Double(drop_channel_axis(array.as_array())),
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

    /// Number of maps in a batch; `None` for a single map.
    pub fn batch_size(&self) -> Option<usize> {
        match *self.shape() {
            [maps, _, _] => Some(maps),
            _ => None,
        }
    }

    /// Returns one map as heights over the pad, mm. 0 becomes infinitely high: depth layers have 0 where the object
    /// does not reach below the pad.
    pub fn above_mm(&self, map: usize) -> Grid<f32> {
        let [width, height] = self.resolution_px();
        let above = |below: f32| if below == 0.0 { f32::INFINITY } else { -below };
        // A finite f64 may overflow to infinity as f32, which would mean that nothing is there.
        let single = |mm: f64| if mm > f64::from(f32::MAX) { f32::MAX } else { mm as f32 };
        let data = match self {
            Self::Single(view) => map_plane(view, map).iter().map(|mm| above(*mm)).collect(),
            Self::Double(view) => map_plane(view, map).iter().map(|mm| above(single(*mm))).collect(),
        };
        Grid { width, height, data }
    }

    /// Returns one map as it is, mm.
    pub fn distances(&self, map: usize) -> Grid<f64> {
        let [width, height] = self.resolution_px();
        let data = match self {
            Self::Single(view) => map_plane(view, map).iter().map(|mm| f64::from(*mm)).collect(),
            Self::Double(view) => map_plane(view, map).iter().copied().collect(),
        };
        Grid { width, height, data }
    }

    /// Returns the ranges of maps that are checked between two looks at signals.
    pub fn block_ranges(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let [width, height] = self.resolution_px();
        let (maps, length) = (self.batch_size().unwrap_or(1), BLOCK_PX.div_ceil(width * height));
        (0..maps).step_by(length).map(move |start| start..maps.min(start + length))
    }

    /// Checks maps that are to be pressed into a pad of `thickness_mm`, in parallel if there are several.
    pub fn inspect(&self, maps: Range<usize>, thickness_mm: f64) -> DepthFindings {
        let find = |map: usize| match self {
            Self::Single(view) => DepthFindings::from_plane(&map_plane(view, map), map, thickness_mm),
            Self::Double(view) => DepthFindings::from_plane(&map_plane(view, map), map, thickness_mm),
        };
        match self.batch_size() {
            Some(_) => maps.into_par_iter().map(find).reduce(|| DepthFindings::NOTHING, DepthFindings::merge),
            None => find(0),
        }
    }

    /// Returns warnings about what may be a mistake. On failure returns everything that cannot be right.
    pub fn report_findings(&self, wrong: &DepthFindings, thickness_mm: f64) -> Result<Report, Report> {
        let mut report: Option<Report> = None;
        let mut add = |message: String, help: &str| {
            let found = user_error(message, help);
            report = Some(match report.take() {
                Some(before) => before.merged_with(found),
                None => found,
            });
        };
        let place = |[map, row, column]: [usize; 3]| match self.batch_size() {
            Some(_) => format!("map {map}, row {row}, column {column}"),
            None => format!("row {row}, column {column}"),
        };
        // A camera's distances, given by mistake, are infinite where nothing is: name the mistake, not each infinity.
        if let Some(map) = wrong.all_through {
            let which = self.batch_size().map_or(String::from("depth_mm"), |_| format!("map {map} of depth_mm"));
            let message = format!("all of {which} goes through the pad, which is {thickness_mm} mm thick");
            let holes = if wrong.nan.is_some() { ", with inf in place of nan" } else { "" };
            let help = "depth_mm is mm below the undeformed pad, not distance from a camera: plane_mm - distance_mm";
            add(message, &format!("{help}{holes}"));
        } else {
            if let Some((count, first)) = wrong.nan {
                let message =
                    format!("depth_mm has {count} values that are not a number, the first in {}", place(first));
                add(message, "where nothing is, write -inf");
            }
            if let Some((count, first)) = wrong.infinite {
                let message = format!("depth_mm is infinite at {count} places, the first in {}", place(first));
                let help = "of a camera's distances give plane_mm - distance_mm; of depths into the pad write -inf where \
                            nothing is";
                add(message, help);
            }
        }
        // The messages do not name the depth itself: Python shows an equal warning once, not for every frame.
        let shallow = wrong.deepest_mm > 0.0 && wrong.deepest_mm < thickness_mm * 1e-3;
        let deep = wrong.deepest_mm > thickness_mm * 50.0;
        let through = wrong.deepest_mm > thickness_mm && !deep;
        let mut notes = Diagnostics::default();
        if shallow {
            let message =
                format!("depth_mm is nowhere a thousandth of the pad's {thickness_mm} mm, which no camera shows");
            notes.push(Diagnostic::warning(message).help("if it is in metres, give depth_mm * 1000"));
        }
        if deep {
            let message = format!("depth_mm goes fifty times as deep as the pad is thick, {thickness_mm} mm");
            notes.push(Diagnostic::warning(message).help("if it is in micrometres, give depth_mm / 1000"));
        }
        if through {
            let message = format!("depth_mm goes through the pad and is cut off at its thickness, {thickness_mm} mm");
            notes.push(
                Diagnostic::warning(message)
                    .help("press less deep, or of a camera's distances give plane_mm - distance_mm"),
            );
        }
        report.map_or_else(|| Ok(Report::new(&notes, &[])), Err)
    }
}

/// Drops a last axis of one channel, which [`DepthMaps::extract_input`] allows.
fn drop_channel_axis<T>(view: ArrayViewD<'_, T>) -> ArrayViewD<'_, T> {
    match *view.shape() {
        [.., columns, 1] if view.ndim() > 2 && columns > 1 => {
            let last = Axis(view.ndim() - 1);
            view.index_axis_move(last, 0)
        }
        _ => view,
    }
}

/// Returns one map of an array with two or three axes.
fn map_plane<'b, T>(view: &'b ArrayViewD<'_, T>, map: usize) -> ArrayView2<'b, T> {
    let map = if view.ndim() == 3 { view.index_axis(Axis(0), map) } else { view.view() };
    map.into_dimensionality::<Ix2>().expect("two axes are left")
}

impl DepthFindings {
    pub const NOTHING: Self = Self { nan: None, infinite: None, all_through: None, deepest_mm: f64::NEG_INFINITY };

    /// Checks one map. A first pass without branches serves the usual case, in which nothing is wrong.
    fn from_plane<T: Copy + Into<f64>>(plane: &ArrayView2<'_, T>, map: usize, thickness_mm: f64) -> Self {
        let mut wrong = Self::NOTHING;
        let (mut none_above, mut any_through, mut all_numbers) = (true, false, true);
        for value in plane {
            let mm: f64 = (*value).into();
            wrong.deepest_mm = if mm > wrong.deepest_mm { mm } else { wrong.deepest_mm };
            none_above &= mm.is_nan() || mm >= thickness_mm;
            any_through |= mm >= thickness_mm;
            all_numbers &= mm < f64::INFINITY;
        }
        wrong.all_through = (none_above && any_through).then_some(map);
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

    /// Merges the findings of maps with those of later maps, `other`.
    pub fn merge(self, other: Self) -> Self {
        let sum = |one: Option<(usize, _)>, other: Option<(usize, _)>| match (one, other) {
            (Some((a, first)), Some((b, _))) => Some((a + b, first)),
            (one, other) => one.or(other),
        };
        Self {
            nan: sum(self.nan, other.nan),
            infinite: sum(self.infinite, other.infinite),
            all_through: self.all_through.or(other.all_through),
            deepest_mm: self.deepest_mm.max(other.deepest_mm),
        }
    }
}

/// Returns the error for an array that somebody writes to at this moment.
fn borrow_error(error: &dyn std::fmt::Display) -> PyErr {
    usage_error(&user_error(format!("depth_mm cannot be read: {error}"), "give a copy: depth_mm.copy()"))
}
