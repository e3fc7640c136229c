//! Sensors, meshes and images from and to files: what the simulator, which knows no file, leaves to these traits.

use gelsim_core::camera::Image;
use gelsim_core::sensor::Sensor;
use gelsim_files::sensor::UnknownPreset;
use gelsim_files::{png, sensor};

#[cfg(feature = "files")]
use std::path::{Path, PathBuf};

#[cfg(feature = "files")]
use gelsim_core::mesh::Mesh;
#[cfg(feature = "files")]
use gelsim_files::{diagnostic::Report, mesh};

/// Sensors from presets and files.
pub trait SensorExt: Sized {
    /// A sensor that gelsim knows, such as `"gelsight-mini"`, `"digit"` or `"tactip"`; `gelsim list sensors` lists them.
    ///
    /// # Errors
    ///
    /// If no preset is called so. The message names them all.
    fn preset(name: &str) -> Result<Self, UnknownPreset>;

    /// The sensor that a TOML file describes, such as one that `gelsim calibrate` wrote, with the images and tables that it
    /// names.
    ///
    /// # Errors
    ///
    /// If the file cannot be read or holds no sensor that can be simulated. The message shows every mistake at its place, with a
    /// way out.
    #[cfg(feature = "files")]
    fn load(path: impl AsRef<Path>) -> Result<Self, SensorFileError>;
}

impl SensorExt for Sensor {
    fn preset(name: &str) -> Result<Self, UnknownPreset> {
        sensor::preset(name)
    }

    #[cfg(feature = "files")]
    fn load(path: impl AsRef<Path>) -> Result<Self, SensorFileError> {
        gelsim_job::plan::standalone::load(path.as_ref())
            .map_err(|report| SensorFileError { path: path.as_ref().to_owned(), report })
    }
}

/// Why a sensor file gives no sensor: every mistake as the command prints it, with file, line, column and what to do.
#[cfg(feature = "files")]
#[derive(Clone, thiserror::Error)]
#[error("{report}")]
pub struct SensorFileError {
    path: PathBuf,
    report: Report,
}

/// As it reads, since `main` and `expect` show errors so.
#[cfg(feature = "files")]
impl std::fmt::Debug for SensorFileError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

#[cfg(feature = "files")]
impl SensorFileError {
    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Each mistake on a line of its own, without its place in the text.
    pub fn messages(&self) -> impl Iterator<Item = &str> {
        self.report.problems().iter().map(|problem| problem.message.as_str())
    }
}

/// Meshes from files.
#[cfg(feature = "files")]
pub trait MeshExt: Sized {
    /// The mesh in a file that ends in .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf. A coordinate of 1 is a
    /// millimetre, unless the format or the file says otherwise.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or holds no triangle that can be pressed. The message names the file and, in text, the line.
    fn load(path: impl AsRef<Path>) -> Result<Self, MeshFileError>;

    /// The mesh in such a file, a coordinate of 1 being `mm_per_unit` mm: 1000 for a file in metres.
    ///
    /// # Errors
    ///
    /// As [`MeshExt::load`].
    fn load_with_unit(path: impl AsRef<Path>, mm_per_unit: f64) -> Result<Self, MeshFileError>;
}

/// Why a file gives no mesh.
#[cfg(feature = "files")]
#[derive(thiserror::Error)]
#[error("{0}; {help}", help = .0.help())]
pub struct MeshFileError(mesh::MeshFileError);

/// As it reads, since `main` and `expect` show errors so.
#[cfg(feature = "files")]
impl std::fmt::Debug for MeshFileError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

#[cfg(feature = "files")]
impl MeshFileError {
    /// The line, in a format that is text.
    pub fn line(&self) -> Option<usize> {
        self.0.line
    }

    /// What to do.
    pub fn help(&self) -> String {
        self.0.help()
    }
}

#[cfg(feature = "files")]
impl MeshExt for Mesh {
    fn load(path: impl AsRef<Path>) -> Result<Self, MeshFileError> {
        let loaded = mesh::load(path.as_ref(), mesh::Reading::default()).map_err(MeshFileError)?;
        Ok(loaded.mesh)
    }

    fn load_with_unit(path: impl AsRef<Path>, mm_per_unit: f64) -> Result<Self, MeshFileError> {
        let loaded = mesh::load(path.as_ref(), mm_per_unit).map_err(MeshFileError)?;
        Ok(loaded.mesh)
    }
}

/// Images as files.
pub trait ImageExt {
    /// The bytes of an 8-bit RGB PNG, as in a dataset.
    fn to_png(&self) -> Vec<u8>;
}

impl ImageExt for Image {
    fn to_png(&self) -> Vec<u8> {
        png::encode_image(self)
    }
}
