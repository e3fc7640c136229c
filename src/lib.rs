//! Tactile images of optical tactile sensors (GelSight, DIGIT and their kin), simulated.
//!
//! Such a sensor is a soft gelpad, lit from the side by coloured LEDs and watched by a camera; an object pressed into it
//! gives an image of the object's relief. A [`Sensor`] made ready at a [`Fidelity`] level is a [`Simulator`]; what is
//! pressed into it is an [`Indenter`], a mesh at a [`Pose`] or a height map; what comes out is an [`Impression`]: the
//! tactile image, and surface, contact, pressure, normals and markers beneath it.
//!
//! ```
//! use gelsim::{Fidelity, ImageExt, Indenter, Sensor, SensorExt, Simulator};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let sensor = Sensor::preset("gelsight-mini")?.with_resolution([80, 60]);
//! let simulator = Simulator::new(&sensor, Fidelity::Standard)?; // the costly part, shared by threads
//! let bar = |i: usize| (20..60).contains(&(i % 80)) && (20..40).contains(&(i / 80));
//! let depth_mm = (0..80 * 60).map(|i| if bar(i) { 0.3 } else { -1.0 }).collect();
//! let press = simulator.press(&Indenter::height_map([80, 60], depth_mm)?);
//! let png: Vec<u8> = press.image.to_png();
//! assert!(press.contact.force_n.is_some_and(|force_n| force_n > 0.0) && png.starts_with(b"\x89PNG"));
//! # Ok(())
//! # }
//! ```
//!
//! [`Press`] says more of a press: texture, motion in the pad's plane, markers and camera of its own. Lengths are
//! millimetres, pressures kPa, forces N; x is to the right in the image, y down, z out of the pad towards the object;
//! image arithmetic is f32. [`Simulator::press_next`] presses frame by frame, with friction that remembers. A press is
//! a pure function of simulator and [`Press`]: the same bytes on any thread and CPU.
//!
//! # Features
//!
//! Without any feature the crate is this simulator, with at most 60 crates beneath it. `datasets` adds jobs in TOML,
//! datasets on disk and what is done with them; `cli`, the default, the command `gelsim`. What these add is the program's
//! own: it is hidden here, and may change with every version.

mod file;

pub use gelsim_core::base::grid::{Grid, Rect};
pub use gelsim_core::camera::markers::{MarkerPattern, MarkerPositions, MarkerPrint};
pub use gelsim_core::camera::{CameraParams, Image};
pub use gelsim_core::depth::height_map::HeightMap;
pub use gelsim_core::depth::indenter::{HeightMapError, Indenter, Shape};
pub use gelsim_core::depth::outline::Outline;
pub use gelsim_core::depth::relief::Relief;
pub use gelsim_core::depth::texture::{Laid, Texture, TextureSample};
pub use gelsim_core::effects::{Effect, EffectLog, EffectPolicy};
pub use gelsim_core::fidelity::{Fidelity, Models};
pub use gelsim_core::gelpad::elastic::history::Contacting;
pub use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
pub use gelsim_core::gelpad::elastic::soft::Soft;
pub use gelsim_core::gelpad::material::Material;
pub use gelsim_core::gelpad::object::ObjectMaterial;
pub use gelsim_core::gelpad::planar::{PlanarFrame, PlanarMotion};
pub use gelsim_core::gelpad::sliding::{ObjectStep, Sliding, Slip, Wrench};
pub use gelsim_core::gelpad::tangential::Shear;
pub use gelsim_core::gelpad::{Contact, Numerics};
pub use gelsim_core::impression::{Impression, Slid};
pub use gelsim_core::mesh::{Cleaned, Mesh, MeshError};
pub use gelsim_core::pose::{Anchor, Angles, PadPlane, Pose, Side};
pub use gelsim_core::sensor::{Background, Markers, Sensor, SensorError};
pub use gelsim_core::simulator::{Press, Simulator};
pub use gelsim_files::sensor::UnknownPreset;

pub use crate::file::{ImageExt, SensorExt};
#[cfg(feature = "files")]
pub use crate::file::{MeshExt, MeshFileError, SensorFileError};
