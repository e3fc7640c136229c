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

// What is made ready and pressed.
#[doc(inline)]
pub use gelsim_core::depth::height_map::HeightMap;
#[doc(inline)]
pub use gelsim_core::depth::indenter::{HeightMapError, Indenter, Shape};
#[doc(inline)]
pub use gelsim_core::effects::{Effect, EffectLog, EffectPolicy, Note as EffectNote, PerEffect};
#[doc(inline)]
pub use gelsim_core::fidelity::{Fidelity, Models};
#[doc(inline)]
pub use gelsim_core::mesh::clusters::{Clusters, Part as ClusterPart};
#[doc(inline)]
pub use gelsim_core::mesh::{CleanupReport, Mesh, MeshError};
#[doc(inline)]
pub use gelsim_core::pose::{Anchor, Angles, PadPlane, Placement, Pose, Side};
#[doc(inline)]
pub use gelsim_core::simulator::{Press, PressError, Simulator};

// A sensor's parts.
#[doc(inline)]
pub use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
#[doc(inline)]
pub use gelsim_core::base::site::Site;
#[doc(inline)]
pub use gelsim_core::base::surface::{Hole as GelHole, Surface as GelMesh, SurfaceError as GelMeshError};
#[doc(inline)]
pub use gelsim_core::base::view::View;
#[doc(inline)]
pub use gelsim_core::camera::CameraParams;
#[doc(inline)]
pub use gelsim_core::camera::markers::{MarkerPattern, MarkerPrint};
#[doc(inline)]
pub use gelsim_core::camera::pins::{Along as PinDirection, MountRing, Pins};
#[doc(inline)]
pub use gelsim_core::camera::projection::{Fisheye, LensModel, Pinhole, Projection};
#[doc(inline)]
pub use gelsim_core::depth::rest::{Grain, RestSurface};
#[doc(inline)]
pub use gelsim_core::gelpad::material::Material;
#[doc(inline)]
pub use gelsim_core::optics::LightSource;
#[doc(inline)]
pub use gelsim_core::optics::background::{BackgroundImage, Pattern as BackgroundPattern, RenderedBackground};
#[doc(inline)]
pub use gelsim_core::optics::calibrated::beyond::{Beyond as CalibrationExtrapolation, Range as CalibrationRange};
#[doc(inline)]
pub use gelsim_core::optics::calibrated::{
    Colors as CalibrationColors, Table as CalibrationTable, response::Response as CalibrationResponse,
    taxim::Taxim as TaximCalibration,
};
#[doc(inline)]
pub use gelsim_core::optics::lamps::Lamp;
#[doc(inline)]
pub use gelsim_core::optics::led::Led;
#[doc(inline)]
pub use gelsim_core::optics::residual::LightResidual;
#[doc(inline)]
pub use gelsim_core::sensor::{Background, Markers, Sensor, SensorError};
#[doc(inline)]
pub use gelsim_files::sensor::UnknownPreset;

// What happens in a press, and in a sequence.
#[doc(inline)]
pub use gelsim_core::depth::outline::Outline;
#[doc(inline)]
pub use gelsim_core::depth::patterns::Procedural;
#[doc(inline)]
pub use gelsim_core::depth::relief::Relief;
#[doc(inline)]
pub use gelsim_core::depth::seen::SeenSurface;
#[doc(inline)]
pub use gelsim_core::depth::texture::{Texture, TexturePlacement, TextureSample};
#[doc(inline)]
pub use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
#[doc(inline)]
pub use gelsim_core::gelpad::elastic::soft::ElasticObject;
#[doc(inline)]
pub use gelsim_core::gelpad::object::ObjectMaterial;
#[doc(inline)]
pub use gelsim_core::gelpad::planar::PlanarMotion;
#[doc(inline)]
pub use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
#[doc(inline)]
pub use gelsim_core::gelpad::tangential::Shear;

// The models that a fidelity level chooses.
#[doc(inline)]
pub use gelsim_core::base::grid::Resolution;
#[doc(inline)]
pub use gelsim_core::gelpad::Model as GelpadModel;
#[doc(inline)]
pub use gelsim_core::gelpad::elastic::Elastic;
#[doc(inline)]
pub use gelsim_core::gelpad::gaussian::Gaussian;
#[doc(inline)]
pub use gelsim_core::gelpad::mean_blur::MeanBlur;
#[doc(inline)]
pub use gelsim_core::gelpad::none::NoDeformation;
#[doc(inline)]
pub use gelsim_core::optics::Model as OpticsModel;
#[doc(inline)]
pub use gelsim_core::optics::calibrated::Calibrated as CalibratedOptics;
#[doc(inline)]
pub use gelsim_core::optics::lamps::Lamps as LampOptics;
#[doc(inline)]
pub use gelsim_core::optics::phong::{Equation as PhongEquation, Phong, Shadows, SoftShadows};

// What comes out.
#[doc(inline)]
pub use gelsim_core::base::clock::Seconds;
#[doc(inline)]
pub use gelsim_core::base::grid::{Grid, Rect};
#[doc(inline)]
pub use gelsim_core::base::light::Light;
#[doc(inline)]
pub use gelsim_core::camera::Image;
#[doc(inline)]
pub use gelsim_core::camera::gel_map::GelMap;
#[doc(inline)]
pub use gelsim_core::camera::lens::Lens;
#[doc(inline)]
pub use gelsim_core::camera::markers::MarkerPositions;
#[doc(inline)]
pub use gelsim_core::camera::pins::{PinPositions, Tip as PinTip};
#[doc(inline)]
pub use gelsim_core::depth::Depth;
#[doc(inline)]
pub use gelsim_core::gelpad::elastic::history::StickSlip;
#[doc(inline)]
pub use gelsim_core::gelpad::elastic::inplane::{Field, Load};
#[doc(inline)]
pub use gelsim_core::gelpad::elastic::shear::Outcome as ShearOutcome;
#[doc(inline)]
pub use gelsim_core::gelpad::sliding::{Slip, Wrench};
#[doc(inline)]
pub use gelsim_core::gelpad::subpixel::{SampledPixel, Subpixel};
#[doc(inline)]
pub use gelsim_core::gelpad::tangential::TangentialMotion;
#[doc(inline)]
pub use gelsim_core::gelpad::total_contact::TotalContact;
#[doc(inline)]
pub use gelsim_core::gelpad::{Contact, Numerics};
#[doc(inline)]
pub use gelsim_core::impression::{Impression, SlidingState};

pub use crate::file::{ImageExt, SensorExt};
#[cfg(feature = "files")]
pub use crate::file::{MeshExt, MeshFileError, SensorFileError};
