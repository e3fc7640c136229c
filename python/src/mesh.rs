//! Meshes to press: read from a file, or given as arrays.

use std::path::PathBuf;
use std::sync::Arc;

use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::{CleanupReport, Mesh};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::length::Unit;
use gelsim_files::mesh::{self, MeshReadOptions};
use gelsim_files::number_format::format_number;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::errors::mistake_error;
use crate::threads::shared_pool;

/// A mesh that was cleaned and prepared for pressing; held by `gelsim.Mesh`.
#[pyclass(frozen, module = "gelsim._native")]
pub struct ReadyMesh {
    pub clusters: Arc<Clusters>,
    triangles: usize,
    bounds_mm: [[f64; 3]; 2],
    /// Whether its file, or who read it, says what a coordinate of 1 is.
    states_its_unit: bool,
}

impl ReadyMesh {
    /// Prepares a mesh, and finds its bounds in the file's own coordinates.
    fn new(mesh: &Mesh, states_its_unit: bool) -> Self {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for vertex in &mesh.vertices {
            for axis in 0..3 {
                let mm = f64::from(vertex[axis]) + mesh.centre_mm[axis];
                bounds[0][axis] = bounds[0][axis].min(mm);
                bounds[1][axis] = bounds[1][axis].max(mm);
            }
        }
        let clusters = Arc::new(Clusters::new(mesh));
        Self { clusters, triangles: mesh.triangles.len(), bounds_mm: bounds, states_its_unit }
    }

    /// Warns of a mesh that is too small for a sensor with this field of view, and would fit it in metres.
    pub fn unit_warning(&self, field_of_view_mm: [f64; 2]) -> Option<Diagnostic> {
        let [least, most] = self.bounds_mm;
        let longest_mm = (0..3).map(|axis| most[axis] - least[axis]).fold(0.0, f64::max);
        match Unit::guess_from_size(1.0, longest_mm, field_of_view_mm) {
            Some((Unit::M, mm)) if !self.states_its_unit => {
                let [longest, likely] = [longest_mm, mm].map(format_number);
                let message = format!("the mesh is {longest} mm long; it looks like one in metres, {likely} mm long");
                let help = "if it is: gelsim.Mesh.load(path, mm_per_unit=1000) or gelsim.Mesh(1000 * vertices, faces); \
                            if not, gelsim.Mesh.load(path, mm_per_unit=1) says so";
                Some(Diagnostic::warning(message).help(help))
            }
            _ => None,
        }
    }
}

#[pymethods]
impl ReadyMesh {
    #[getter]
    fn triangles(&self) -> usize {
        self.triangles
    }

    #[getter]
    fn bounds_mm(&self) -> [[f64; 3]; 2] {
        self.bounds_mm
    }
}

/// Returns the warnings about a mesh.
fn collect_remarks(cleaned: &CleanupReport, others: impl Iterator<Item = String>) -> Vec<String> {
    cleaned.warning().into_iter().chain(others).collect()
}

/// Reads the mesh of a file. Returns it, and warnings about it.
#[pyfunction]
pub fn mesh_of_file(py: Python<'_>, path: PathBuf, mm_per_unit: Option<f64>) -> PyResult<(ReadyMesh, Vec<String>)> {
    let pool = shared_pool(py, None)?;
    // Reading works in parallel, and must not use rayon's global pool.
    py.detach(|| {
        pool.install(|| {
            let loaded = mesh::load(&path, MeshReadOptions { mm_per_unit, ..MeshReadOptions::default() });
            let loaded = loaded.map_err(|error| mistake_error(error.to_string(), error.help()))?;
            let read = loaded.remarks.iter().map(|remark| format!("{remark}; {}", remark.help()));
            let states_its_unit = loaded.states_its_unit || mm_per_unit.is_some();
            Ok((ReadyMesh::new(&loaded.mesh, states_its_unit), collect_remarks(&loaded.cleaned, read)))
        })
    })
}

/// Makes a mesh of vertices (N, 3), mm, and triangles (M, 3). Returns it, and warnings about it.
#[pyfunction]
pub fn mesh_of_arrays(
    py: Python<'_>,
    vertices_mm: PyReadonlyArray2<'_, f64>,
    faces: PyReadonlyArray2<'_, u32>,
) -> PyResult<(ReadyMesh, Vec<String>)> {
    let (vertices_mm, faces) = (vertices_mm.as_array(), faces.as_array());
    if vertices_mm.ncols() != 3 || faces.ncols() != 3 {
        return Err(mistake_error("vertices and faces have three columns each", "give arrays (N, 3) and (M, 3)"));
    }
    let vertices = vertices_mm.rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect();
    let triangles = faces.rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect();
    py.detach(|| {
        let help = "vertices_mm is (N, 3) in mm, faces (M, 3) counts in it from 0";
        let (mesh, cleaned) = Mesh::new(vertices, triangles).map_err(|error| mistake_error(error.to_string(), help))?;
        Ok((ReadyMesh::new(&mesh, false), collect_remarks(&cleaned, std::iter::empty())))
    })
}
