//! Formats and the disk.

mod deflate;
pub mod length;
pub mod png;
pub mod sensor;
pub mod spelling;

#[cfg(feature = "datasets")]
mod calibration;
#[cfg(feature = "datasets")]
pub mod diagnostic;
#[cfg(feature = "datasets")]
pub mod exr;
#[cfg(feature = "datasets")]
pub mod fail_point;
#[cfg(feature = "datasets")]
pub mod figures;
#[cfg(feature = "datasets")]
pub mod foreign;
#[cfg(feature = "datasets")]
pub mod hash;
#[cfg(feature = "datasets")]
pub mod heights;
#[cfg(feature = "datasets")]
pub mod image_file;
#[cfg(feature = "datasets")]
pub mod input;
#[cfg(feature = "datasets")]
pub mod mesh;
#[cfg(feature = "datasets")]
pub mod npy;
#[cfg(feature = "datasets")]
pub mod npz;
#[cfg(feature = "datasets")]
pub mod rows;
#[cfg(feature = "datasets")]
pub mod source;
#[cfg(feature = "datasets")]
pub mod store;
#[cfg(feature = "datasets")]
pub mod unpack;
#[cfg(feature = "datasets")]
pub mod write;
#[cfg(feature = "datasets")]
pub mod zip;
