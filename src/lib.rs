//! Tactile images of optical tactile sensors (GelSight, DIGIT and their kin), simulated.
//!
//! Such a sensor is a soft gelpad, lit from the side by coloured LEDs and watched by a camera; an object pressed into it
//! gives an image of the object's relief. A [`Sensor`] made ready at a [`Fidelity`] level is a [`Simulator`]; what is
//! pressed into it is an [`Indenter`], a mesh at a [`Pose`] or a height map; what comes out is an [`Impression`]: the
//! tactile image, and surface, contact, pressure, normals and markers beneath it.
//!
//! ```
//! use gelsim::{Fidelity, Indenter, Sensor, Simulator};
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

#![forbid(unsafe_code)]
#![warn(missing_docs)]

// Six floors, each of which sees only those below; docs/architecture.md has the drawing, tests/library/floors.rs the rule.

#[doc(hidden)]
pub mod core;

#[doc(hidden)]
pub mod files;

#[cfg(feature = "datasets")]
#[doc(hidden)]
pub mod job;

#[cfg(feature = "datasets")]
#[doc(hidden)]
pub mod dataset;

#[cfg(feature = "datasets")]
#[doc(hidden)]
pub mod lab;

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;

pub use crate::core::base::grid::{Grid, Rect};
pub use crate::core::camera::markers::{MarkerPattern, MarkerPositions, MarkerPrint};
pub use crate::core::camera::{CameraParams, Image};
pub use crate::core::depth::height_map::HeightMap;
pub use crate::core::depth::indenter::{HeightMapError, Indenter, Shape};
pub use crate::core::depth::outline::Outline;
pub use crate::core::depth::relief::Relief;
pub use crate::core::depth::texture::{Laid, Texture, TextureSample};
pub use crate::core::effects::{Effect, EffectLog, EffectPolicy};
pub use crate::core::fidelity::{Fidelity, Models};
pub use crate::core::gelpad::elastic::history::Contacting;
pub use crate::core::gelpad::elastic::shear::{Friction, Motion};
pub use crate::core::gelpad::elastic::soft::Soft;
pub use crate::core::gelpad::material::Material;
pub use crate::core::gelpad::object::ObjectMaterial;
pub use crate::core::gelpad::planar::{PlanarFrame, PlanarMotion};
pub use crate::core::gelpad::sliding::{ObjectStep, Sliding, Slip, Wrench};
pub use crate::core::gelpad::tangential::Shear;
pub use crate::core::gelpad::{Contact, Numerics};
pub use crate::core::impression::{Impression, Slid};
pub use crate::core::mesh::{Cleaned, Mesh, MeshError};
pub use crate::core::pose::{Anchor, Angles, PadPlane, Pose, Side};
pub use crate::core::sensor::{Background, Markers, Sensor, SensorError};
pub use crate::core::simulator::{Press, Simulator};
pub use crate::files::sensor::UnknownPreset;
