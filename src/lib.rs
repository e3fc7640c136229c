//! Simulates the images of optical tactile sensors such as GelSight, DIGIT and TacTip.
//!
//! In such a sensor, a camera looks from inside at a soft gelpad that coloured LEDs light from the side. An object that
//! is pressed into the pad shows as a relief in the image. This library computes the image of a mesh or of a height
//! map, with ground truth: depth, surface, normals, contact mask, pressure and force.
//!
//! ```
//! use gelsim::{Fidelity, ImageExt, Indenter, Sensor, SensorExt, Simulator};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let sensor = Sensor::preset("gelsight-mini")?.with_resolution([80, 60]);
//! let simulator = Simulator::new(&sensor, Fidelity::Standard)?; // the slow part: make it once
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
//! 1. **Describe a sensor.** [`SensorExt::preset`] takes one by name, [`SensorExt::load`] reads a file, and
//!    [`Sensor::new`] makes a flat pad without LEDs. All fields are public: push a [`Led`] onto [`Sensor::leds`],
//!    change [`Sensor::gelpad`].
//! 2. **Prepare a simulator.** [`Simulator::new`] checks the sensor and computes what all presses share. This is slow,
//!    so make it once; threads share it by reference. A [`Fidelity`] level sets how accurate it is.
//! 3. **Place an object.** [`Indenter::mesh`] takes a [`Mesh`] ([`MeshExt::load`]) at a [`Pose`],
//!    [`Indenter::height_map`] takes an array. [`Indenter::at_depth_mm`] lowers the object into the pad.
//!    [`Indenter::moved_to`] places it elsewhere without preparing the mesh again.
//! 4. **Press it.** [`Simulator::press`] takes an indenter alone. [`Simulator::try_press`] takes a [`Press`], which can
//!    have a [`Texture`], a [`Shear`], an [`ObjectMaterial`], markers and a camera of its own. Functions with `try_` in
//!    their names return a [`PressError`] where the others panic.
//! 5. **Read the result.** An [`Impression`] has the [`Image`], the [`Contact`] with its force, and methods for the
//!    layers in the image's geometry: [`Impression::depth_mm`], [`Impression::surface_mm`], [`Impression::normals`],
//!    [`Impression::contact_mask`], [`Impression::pressure_kpa`] and others.
//!
//! # What a press computes
//!
//! 1. **Depth**: how far the object reaches below the undeformed pad, at every pixel ([`Depth`]).
//! 2. **Gelpad**: the shape of the pad, where it touches the object, and with which pressure ([`Contact`]). The
//!    [`GelpadModel`] decides how.
//! 3. **Optics**: the [`Light`] that the pad's surface sends to the camera. The [`OpticsModel`] decides how.
//! 4. **Camera**: lens, markers, exposure, noise and rounding to 8 bits ([`CameraParams`], [`Image`]).
//!
//! An [`Effect`] such as shadows or friction runs only where it can change a pixel. [`Impression::effects`] says which
//! ran, why, and how long each took.
//!
//! # Sequences
//!
//! [`Simulator::sliding`] begins a sequence, in which an object slides, turns and rolls on the pad.
//! [`Simulator::try_press_next`] takes it through the [`ObjectStep`]s of a frame and presses it; the [`Sliding`]
//! remembers where the pad sticks and slips from frame to frame.
//!
//! # Examples
//!
//! `docs/examples` holds complete programs: `press` (a mesh with texture and shear), `sequence` (friction frame by
//! frame) and `led` (a sensor with one more LED). Run one with `cargo run --release --example press`.
//!
//! # Conventions
//!
//! - Lengths are millimetres, pressures kilopascals, forces newtons. Angles are degrees where the name says `deg`, and
//!   radians where it says `rad`.
//! - x points to the right in the image, y down, and z out of the pad towards the object. The origin is the middle of
//!   the image on the undeformed pad.
//! - Arrays are row-major; row 0 is at the top.
//! - The same simulator and the same [`Press`] give the same bytes on any thread and CPU.
//!
//! # Features
//!
//! | feature | what it adds |
//! |---|---|
//! | none | the simulator, sensor presets and PNG |
//! | `files` | sensor files, meshes and pictures: [`SensorExt::load`], [`MeshExt`] |
//! | `cli` (default) | the command `gelsim`, and `files` |
//! | `stores` | object stores for the command, and `cli` |
//!
//! # Limitations
//!
//! - The pad is a linear elastic layer, except at [`Fidelity::FiniteStrain`]. At large strains it is off by tens of
//!   micrometres; [`Numerics::model_error_um`] estimates by how much for each press.
//! - Objects are rigid, or elastic with one modulus. Frames of sequences take them as rigid.
//! - A height map lies over a flat pad. A gel that has a shape takes meshes.
//! - Light is reflected once, except with [`OpticsModel::Led`] over a [`Coat`].
//! - A press is an equilibrium: mass and speed are not modelled.

mod file;

// The simulator, and what is pressed.
#[doc(inline)]
pub use gelsim_core::{
    depth::height_map::HeightMap,
    depth::indenter::{HeightMapError, Indenter, Shape},
    effects::{Effect, EffectLog, EffectNote, EffectPolicy, PerEffect},
    fidelity::{Fidelity, Models},
    mesh::clusters::{ClusterPart, Clusters},
    mesh::{CleanupReport, Mesh, MeshError},
    pose::{Anchor, Angles, PadPlane, Placement, Pose, Side},
    simulator::{Press, PressError, Simulator},
};

// The sensor and its parts.
#[doc(inline)]
pub use gelsim_core::{
    base::gel::{GelCapsule, GelDome, GelShape},
    base::gel_surface::{GelHole, GelSurface as GelMesh, GelSurfaceError as GelMeshError},
    base::site::Site,
    base::view::View,
    camera::CameraParams,
    camera::markers::{MarkerLayout, MarkerPattern, MarkerPrint, MeasuredDot},
    camera::pins::{Along as PinDirection, MountRing, Pins},
    camera::projection::{Fisheye, LensModel, Pinhole, Projection},
    depth::rest_surface::{Grain, RestSurface},
    gelpad::material::Material,
    optics::background::{BackgroundImage, Pattern as BackgroundPattern, RenderedBackground},
    optics::calibrated::extrapolation::{CalibrationExtrapolation, CalibrationRange},
    optics::calibrated::{CalibrationColors, CalibrationTable, response::CalibrationResponse, taxim::TaximCalibration},
    optics::lamps::Lamp,
    optics::led::{Led, LedPlace},
    optics::light_error::{Cause as LightErrorCause, LightError},
    optics::light_pattern::LightPattern,
    optics::near_light::bounce::Coat,
    optics::near_light::window::Window,
    optics::residual::LightResidual,
    optics::{Illumination, LightSource},
    sensor::{Background, Markers, Sensor, SensorError},
};
#[doc(inline)]
pub use gelsim_files::sensor::UnknownPreset;

// What a press and a sequence can have besides an object.
#[doc(inline)]
pub use gelsim_core::{
    depth::outline::Outline,
    depth::patterns::Procedural,
    depth::relief::Relief,
    depth::seen_surface::SeenSurface,
    depth::texture::{Texture, TexturePlacement, TextureSample},
    gelpad::elastic::elastic_object::ElasticObject,
    gelpad::elastic::relaxation::RelaxationMode,
    gelpad::elastic::shear::{Friction, Motion},
    gelpad::object_material::ObjectMaterial,
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
    gelpad::finite_strain::{FiniteStrain, StrainSettings},
    gelpad::gaussian::Gaussian,
    gelpad::mean_blur::MeanBlur,
    gelpad::no_deformation::NoDeformation,
    optics::Model as OpticsModel,
    optics::calibrated::Calibrated as CalibratedOptics,
    optics::lamps::Lamps as LampOptics,
    optics::phong::{Equation as PhongEquation, Phong, Shadows, SoftShadows},
};

// The results.
#[doc(inline)]
pub use gelsim_core::{
    base::clock::Seconds,
    base::grid::{Grid, Rect},
    base::light::Light,
    camera::Image,
    camera::gel_map::GelMap,
    camera::lens::Lens,
    camera::markers::MarkerPositions,
    camera::pins::{PinPositions, PinTip},
    depth::Depth,
    gelpad::elastic::friction_history::StickSlip,
    gelpad::elastic::in_plane::{DisplacementField, Load},
    gelpad::elastic::shear::ShearOutcome,
    gelpad::sliding::{Slip, Wrench},
    gelpad::subpixel::{SampledPixel, Subpixel},
    gelpad::tangential::TangentialMotion,
    gelpad::total_contact::TotalContact,
    gelpad::traction_map::TractionMap,
    gelpad::{Contact, Numerics, Theory},
    impression::{Impression, SlidingState},
};

pub use crate::file::{ImageExt, SensorExt};
#[cfg(feature = "files")]
pub use crate::file::{MeshExt, MeshFileError, SensorFileError};

/// The programs of the page on this library, compiled as doc tests.
#[cfg(all(doctest, feature = "files"))]
#[doc = include_str!("../docs/how-to/rust.md")]
struct RustLibraryPage;
