//! Traits that read sensors and meshes from files and write images: the simulator itself knows no files.

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
    /// Returns a sensor that gelsim knows by name, such as `"gelsight-mini"`, `"digit"` or `"tactip"`. The command
    /// `gelsim list sensors` lists the names.
    ///
    /// # Errors
    ///
    /// If there is no preset of this name. The message lists the names.
    fn preset(name: &str) -> Result<Self, UnknownPreset>;

    /// Reads a sensor from a TOML file, such as one that `gelsim calibrate` wrote, with the images and tables that the
    /// file names.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or does not describe a sensor that can be simulated. The message shows every mistake
    /// at its place in the file, with a remedy.
    #[cfg(feature = "files")]
    fn load(path: impl AsRef<Path>) -> Result<Self, SensorFileError>;
}

impl SensorExt for Sensor {
    fn preset(name: &str) -> Result<Self, UnknownPreset> {
        sensor::load_preset(name)
    }

    #[cfg(feature = "files")]
    fn load(path: impl AsRef<Path>) -> Result<Self, SensorFileError> {
        gelsim_job::plan::standalone::load_sensor_file(path.as_ref())
            .map_err(|report| SensorFileError { path: path.as_ref().to_owned(), report })
    }
}

/// The reason why a sensor file gives no sensor. It displays every mistake as the command prints it: with file, line,
/// column and a remedy.
#[cfg(feature = "files")]
#[derive(Clone, thiserror::Error)]
#[error("{report}")]
pub struct SensorFileError {
    path: PathBuf,
    report: Report,
}

/// Shows the message itself: `main` and `expect` print errors with `Debug`.
#[cfg(feature = "files")]
impl std::fmt::Debug for SensorFileError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

#[cfg(feature = "files")]
impl SensorFileError {
    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Iterates over the mistakes: one message each, without its place in the file.
    pub fn messages(&self) -> impl Iterator<Item = &str> {
        self.report.problems().iter().map(|problem| problem.message.as_str())
    }
}

/// Meshes from files.
#[cfg(feature = "files")]
pub trait MeshExt: Sized {
    /// Reads a mesh from a file that ends in .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf. A coordinate of
    /// 1 is a millimetre, unless the format or the file says otherwise.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or has no triangle that can be pressed. The message names the file and, in a text
    /// format, the line.
    fn load(path: impl AsRef<Path>) -> Result<Self, MeshFileError>;

    /// Reads a mesh from a file in which a coordinate of 1 is `mm_per_unit` mm: 1000 for a file in metres.
    ///
    /// # Errors
    ///
    /// Those of [`MeshExt::load`].
    fn load_with_unit(path: impl AsRef<Path>, mm_per_unit: f64) -> Result<Self, MeshFileError>;
}

/// The reason why a file gives no mesh, with a remedy.
#[cfg(feature = "files")]
#[derive(thiserror::Error)]
#[error("{0}; {help}", help = .0.help())]
pub struct MeshFileError(mesh::MeshFileError);

/// Shows the message itself: `main` and `expect` print errors with `Debug`.
#[cfg(feature = "files")]
impl std::fmt::Debug for MeshFileError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

#[cfg(feature = "files")]
impl MeshFileError {
    /// Returns the line of the file, counted from 1; `None` if it is not known, as in a binary format.
    pub fn line(&self) -> Option<usize> {
        self.0.line
    }

    /// Returns the remedy.
    pub fn help(&self) -> String {
        self.0.help()
    }
}

#[cfg(feature = "files")]
impl MeshExt for Mesh {
    fn load(path: impl AsRef<Path>) -> Result<Self, MeshFileError> {
        let loaded = mesh::load(path.as_ref(), mesh::MeshReadOptions::default()).map_err(MeshFileError)?;
        Ok(loaded.mesh)
    }

    fn load_with_unit(path: impl AsRef<Path>, mm_per_unit: f64) -> Result<Self, MeshFileError> {
        let loaded = mesh::load(path.as_ref(), mm_per_unit).map_err(MeshFileError)?;
        Ok(loaded.mesh)
    }
}

/// Images as files.
pub trait ImageExt {
    /// Encodes the image as an 8-bit RGB PNG, with the same bytes as in a dataset.
    fn to_png(&self) -> Vec<u8>;
}

impl ImageExt for Image {
    fn to_png(&self) -> Vec<u8> {
        png::encode_image(self)
    }
}
