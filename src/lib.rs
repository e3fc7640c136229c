//! Tactile images of optical tactile sensors (GelSight, DIGIT, TacTip and their kin), simulated.
//!
//! Such a sensor is a soft gelpad. Coloured LEDs light it from the side and a camera watches it from below. An object that is
//! pressed into it gives an image of the object's relief.
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
//! # A press in five steps
//!
//! 1. **Take a sensor**: [`SensorExt::preset`] by name, [`SensorExt::load`] from a file, or [`Sensor::new`]. Its fields are
//!    public: push a [`Led`] onto [`Sensor::leds`], change [`Sensor::gelpad`].
//! 2. **Prepare it**: [`Simulator::new`] checks the sensor and computes what every press shares. [`Fidelity`] chooses how exact.
//! 3. **Place an object**: [`Indenter::mesh`] takes a [`Mesh`] ([`MeshExt::load`]) at a [`Pose`], [`Indenter::height_map`] an
//!    array. [`Indenter::at_depth_mm`] lowers it into the pad.
//! 4. **Press it**: [`Simulator::press`], or [`Simulator::try_press`] with a [`Press`], which adds [`Texture`], [`Shear`],
//!    [`ObjectMaterial`], markers and camera. The `try_` functions give a [`PressError`] where the others panic.
//! 5. **Read the result**: an [`Impression`] has the [`Image`], the layers in its geometry ([`Impression::surface_mm`],
//!    [`Impression::normals`] and others), the [`Contact`] with its force, and an [`EffectLog`] that says which effects ran and why.
//!
//! For a sequence, [`Simulator::sliding`] begins one, and [`Simulator::try_press_next`] takes it through each frame's
//! [`ObjectStep`]s. The friction of a frame depends on the frames before it.
//!
//! The examples `press`, `sequence` and `led` in `docs/examples` are complete programs: `cargo run --release --example press`.
//!
//! # Conventions
//!
//! Lengths are millimetres, angles degrees where the name says `deg` and radians where it says `rad`, pressures kilopascals,
//! forces newtons. x points to the right in the image, y down, z out of the pad towards the object; the origin is the middle of the
//! view on the undeformed pad. Arrays are row-major. A press is a pure function of simulator and [`Press`]: it gives the same bytes
//! on any thread and CPU.
//!
//! # Features
//!
//! | feature | what it adds |
//! |---|---|
//! | none | the simulator, sensor presets and PNG |
//! | `files` | sensor files, meshes and pictures: [`SensorExt::load`], [`MeshExt`] |
//! | `cli` (default) | the command `gelsim`, and `files` |
//! | `stores` | the command with object stores |
//!
//! # Limitations
//!
//! - The pad is a linear elastic layer. At large strains it is off by tens of micrometres; [`Numerics::model_error_um`] says by how
//!   much for each press.
//! - Objects are rigid, or elastic with one modulus. A frame of a sequence takes them for rigid.
//! - A height map lies over a flat pad. A gel that has a shape takes meshes.
//! - Light is reflected once: no interreflection between slopes of the pad.
//! - Mass, speed and viscosity are not modelled. A press is an equilibrium.

mod file;

// What is made ready and pressed.
#[doc(inline)]
pub use gelsim_core::{
    depth::height_map::HeightMap,
    depth::indenter::{HeightMapError, Indenter, Shape},
    effects::{Effect, EffectLog, EffectPolicy, Note as EffectNote, PerEffect},
    fidelity::{Fidelity, Models},
    mesh::clusters::{Clusters, Part as ClusterPart},
    mesh::{CleanupReport, Mesh, MeshError},
    pose::{Anchor, Angles, PadPlane, Placement, Pose, Side},
    simulator::{Press, PressError, Simulator},
};

// A sensor's parts.
#[doc(inline)]
pub use gelsim_core::{
    base::gel::{GelCapsule, GelDome, GelShape},
    base::site::Site,
    base::surface::{Hole as GelHole, Surface as GelMesh, SurfaceError as GelMeshError},
    base::view::View,
    camera::CameraParams,
    camera::markers::{MarkerPattern, MarkerPrint},
    camera::pins::{Along as PinDirection, MountRing, Pins},
    camera::projection::{Fisheye, LensModel, Pinhole, Projection},
    depth::rest::{Grain, RestSurface},
    gelpad::material::Material,
    optics::LightSource,
    optics::background::{BackgroundImage, Pattern as BackgroundPattern, RenderedBackground},
    optics::calibrated::beyond::{Beyond as CalibrationExtrapolation, Range as CalibrationRange},
    optics::calibrated::{
        Colors as CalibrationColors, Table as CalibrationTable, response::Response as CalibrationResponse,
        taxim::Taxim as TaximCalibration,
    },
    optics::lamps::Lamp,
    optics::led::Led,
    optics::residual::LightResidual,
    sensor::{Background, Markers, Sensor, SensorError},
};
#[doc(inline)]
pub use gelsim_files::sensor::UnknownPreset;

// What happens in a press, and in a sequence.
#[doc(inline)]
pub use gelsim_core::{
    depth::outline::Outline,
    depth::patterns::Procedural,
    depth::relief::Relief,
    depth::seen::SeenSurface,
    depth::texture::{Texture, TexturePlacement, TextureSample},
    gelpad::elastic::shear::{Friction, Motion},
    gelpad::elastic::soft::ElasticObject,
    gelpad::object::ObjectMaterial,
    gelpad::planar::PlanarMotion,
    gelpad::sliding::{ObjectStep, Sliding},
    gelpad::tangential::Shear,
};

// The models that a fidelity level chooses.
#[doc(inline)]
pub use gelsim_core::{
    base::grid::Resolution,
    gelpad::Model as GelpadModel,
    gelpad::elastic::Elastic,
    gelpad::gaussian::Gaussian,
    gelpad::mean_blur::MeanBlur,
    gelpad::none::NoDeformation,
    optics::Model as OpticsModel,
    optics::calibrated::Calibrated as CalibratedOptics,
    optics::lamps::Lamps as LampOptics,
    optics::phong::{Equation as PhongEquation, Phong, Shadows, SoftShadows},
};

// What comes out.
#[doc(inline)]
pub use gelsim_core::{
    base::clock::Seconds,
    base::grid::{Grid, Rect},
    base::light::Light,
    camera::Image,
    camera::gel_map::GelMap,
    camera::lens::Lens,
    camera::markers::MarkerPositions,
    camera::pins::{PinPositions, Tip as PinTip},
    depth::Depth,
    gelpad::elastic::history::StickSlip,
    gelpad::elastic::inplane::{Field, Load},
    gelpad::elastic::shear::Outcome as ShearOutcome,
    gelpad::sliding::{Slip, Wrench},
    gelpad::subpixel::{SampledPixel, Subpixel},
    gelpad::tangential::TangentialMotion,
    gelpad::total_contact::TotalContact,
    gelpad::{Contact, Numerics},
    impression::{Impression, SlidingState},
};

pub use crate::file::{ImageExt, SensorExt};
#[cfg(feature = "files")]
pub use crate::file::{MeshExt, MeshFileError, SensorFileError};
