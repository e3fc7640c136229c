//! File formats and access to the disk.

#[cfg(all(feature = "formats", not(unix)))]
compile_error!(
    "gelsim reads and writes files on Unix alone: on Windows use the Windows Subsystem for Linux, or the library without \
     features (default-features = false)"
);

#[cfg_attr(not(feature = "formats"), allow(dead_code, unused_imports, reason = "PNG alone takes a part of it"))]
mod deflate;
pub mod length;
pub mod png;
pub mod sensor;
pub mod spelling;

#[cfg(feature = "formats")]
pub mod calibration;
#[cfg(feature = "formats")]
pub mod csv_table;
#[cfg(feature = "formats")]
pub mod diagnostic;
#[cfg(feature = "formats")]
pub mod exr;
#[cfg(feature = "formats")]
pub mod fail_point;
#[cfg(feature = "formats")]
pub mod foreign;
#[cfg(feature = "formats")]
pub mod hash;
#[cfg(feature = "formats")]
pub mod heights;
#[cfg(feature = "formats")]
pub mod image_file;
#[cfg(feature = "formats")]
pub mod input;
#[cfg(feature = "formats")]
pub mod mesh;
#[cfg(feature = "formats")]
pub mod npy;
#[cfg(feature = "formats")]
pub mod npz;
#[cfg(feature = "formats")]
pub mod number_format;
#[cfg(feature = "formats")]
pub mod place_table;
#[cfg(feature = "formats")]
pub mod size_limits;
#[cfg(feature = "formats")]
pub mod source;
#[cfg(feature = "formats")]
pub mod store;
#[cfg(feature = "formats")]
pub mod watch;
#[cfg(feature = "formats")]
pub mod write;
#[cfg(feature = "formats")]
pub mod zip;
