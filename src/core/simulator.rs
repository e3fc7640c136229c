//! READ FIRST: the whole simulator on one page, a pure function from a press to a tactile image.
//!
//! [`Simulator::new`] is the costly part and is shared by threads; a press fails only on what no sensor can be pressed with
//! ([`PressError`]).

use std::fmt;
use std::sync::{Arc, OnceLock};

use crate::base::clock::{Clock, Seconds};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::view::View;
use crate::camera::markers::{MarkerPattern, MarkerPositions};
use crate::camera::{Camera, CameraParams, Image};
use crate::curved::{Curved, CurvedPress, PressedGel};
use crate::depth::beyond::Surroundings;
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::texture::{Texture, TexturePlacement, TextureSample};
use crate::depth::{self, Depth, Window};
use crate::effects::{Effect, EffectLog, EffectPolicy, Requirement};
use crate::fidelity::Models;
use crate::gelpad::elastic::friction::Drag;
use crate::gelpad::elastic::inplane::InPlane;
use crate::gelpad::elastic::model_error::curvature_error_mm;
use crate::gelpad::elastic::shear::{Friction, Motion};
use crate::gelpad::object::ObjectMaterial;
use crate::gelpad::sliding::{FramePad, Sliding};
use crate::gelpad::tangential::{Shear, tangential};
use crate::gelpad::total_contact::total_contact;
use crate::gelpad::{self, Contact, Pad, subpixel};
use crate::impression::{Impression, SlidingState};
use crate::optics::background::BackgroundImage;
use crate::optics::{Shader, lamps};
use crate::pose::{PadPlane, Pose};
use crate::sensor::{Markers, Sensor};

mod frames;
mod ready;

/// Everything about a sensor that is the same in every press, computed once.
///
/// Threads share it by reference: a press changes nothing in it.
pub struct Simulator {
    sensor: Sensor,
    models: Models,
    policy: EffectPolicy,
    view: View,
    background: Arc<BackgroundImage>,
    /// Noise of a rendered background's grain.
    noise: Option<Arc<Grid<f32>>>,
    drop_mm: Option<Arc<Grid<f32>>>,
    /// What the light sees of a pad that is not smooth and flat.
    relief: Option<Arc<Grid<f32>>>,
    pad: Arc<Pad>,
    /// The same as an object that slides sees it, once one does.
    frame_pad: Arc<OnceLock<FramePad>>,
    /// The sensor's markers, unless they are left out.
    markers: Option<Markers>,
    /// In-plane motion of the pad is wanted for itself.
    flow: bool,
    /// In-plane motion of the pad, where it is wanted or markers show it.
    in_plane: Option<Arc<InPlane>>,
    shader: Arc<Shader>,
    /// The grey images of the sensor's lamps, whatever the model of the light.
    lamps: Option<Arc<lamps::Shader>>,
    camera: Arc<Camera>,
    /// A gel that is not flat, and the pins inside it.
    curved: Option<Arc<Curved>>,
}

/// What happens in one press.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Press {
    /// What is pressed into the pad, and where.
    pub indenter: Indenter,
    /// Micro-texture of the indenter. `None` if no press of the kind has any.
    pub texture: Option<Texture>,
    /// What the indenter is made of. A frame of a sequence takes it for rigid.
    pub material: ObjectMaterial,
    /// How the indenter then moves in the pad's plane. `None` if in no press of the kind it does.
    pub shear: Option<Shear>,
    /// The grid on which markers are printed, on a sensor that has markers.
    pub markers: Option<MarkerPattern>,
    /// The camera's parameters.
    pub camera: CameraParams,
    /// Key of what differs between units of a sensor with pins.
    pub unit_key: u64,
    /// The plane that the indenter is posed over: the flat pad, or one that touches a gel that is not flat.
    pub plane: PadPlane,
}

/// Why something cannot be pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PressError {
    /// The height map has another size than the image.
    #[error("the height map has {found:?} px, the sensor's image {expected:?}: they must be the same")]
    HeightMapSize {
        /// Columns and rows of the map.
        found: [usize; 2],
        /// Columns and rows of the image.
        expected: [usize; 2],
    },
    /// A height map lies over a flat pad, and this sensor's gel has a shape.
    #[error("a height map lies over a flat pad, and the gel of this sensor has a shape: press a mesh into it")]
    HeightMapOnCurvedGel,
    /// A number is NaN or infinite.
    #[error("the {0} of the press is NaN or infinite")]
    NotFinite(&'static str),
    /// What slides was begun by the simulator of another sensor.
    #[error("the sequence was begun on another sensor: begin it with `sliding` of this simulator")]
    OtherSensor,
}

/// An object captured and the pad under it, before the light.
struct Touched {
    depth: Depth,
    contact: Contact,
    /// What of the object was captured.
    window: Window,
}

impl Simulator {
    /// Presses an indenter into the pad, with the sensor's own markers and camera.
    ///
    /// # Panics
    ///
    /// Where [`Simulator::try_press`] gives an error.
    pub fn press(&self, indenter: &Indenter) -> Impression {
        self.press_with(&Press::new(indenter.clone(), &self.sensor))
    }

    /// Presses with texture, motion in the pad's plane, and markers and camera of its own.
    ///
    /// # Panics
    ///
    /// Where [`Simulator::try_press`] gives an error.
    pub fn press_with(&self, press: &Press) -> Impression {
        self.try_press(press).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Presses with texture, motion in the pad's plane, and markers and camera of its own.
    ///
    /// # Errors
    ///
    /// If the indenter is a height map of another size than the sensor's image, or one that is pressed into a gel that has a
    /// shape, or if a number of the press is NaN or infinite.
    pub fn try_press(&self, press: &Press) -> Result<Impression, PressError> {
        self.check_press(press)?;
        Ok(self.pressed(press, None))
    }

    fn check_press(&self, press: &Press) -> Result<(), PressError> {
        if let Shape::HeightMap(map) = &press.indenter.shape {
            let (found, expected) = ([map.above_mm.width, map.above_mm.height], self.view.resolution_px);
            if self.curved.is_some() {
                return Err(PressError::HeightMapOnCurvedGel);
            }
            if found != expected {
                return Err(PressError::HeightMapSize { found, expected });
            }
        }
        press.numbers_are_finite()
    }

    /// Normal force of the whole object on the pad, in view and beyond, N: to the bit what [`Simulator::press_with`] has as
    /// `contact.total.total_force_n`, on a flat pad without its light and image. `None` where that is not known.
    ///
    /// # Panics
    ///
    /// Where [`Simulator::try_press`] gives an error.
    pub fn total_force_n(&self, press: &Press) -> Option<f64> {
        self.check_press(press).unwrap_or_else(|error| panic!("{error}"));
        if self.curved.is_some() {
            return self.press_with(press).contact.total.total_force_n;
        }
        let own_pad = self.pad.under(&press.material);
        let (mut clock, mut seconds) = (Clock::start(), Seconds::default());
        let mut effects = EffectLog::new(self.policy);
        let pad = own_pad.as_ref().unwrap_or(&self.pad);
        self.touched(press, pad, None, &mut clock, &mut seconds, &mut effects).contact.total.total_force_n
    }

    /// What holds the pad to the object while it is pressed in, if anything does.
    fn held(&self, press: &Press) -> Option<Friction> {
        self.models.gelpad.friction().map(|held| press.material.friction.unwrap_or(held))
    }

    /// The same on a gel that is not flat.
    fn pressed_into(&self, curved: &Curved, press: &Press, sliding: Option<&mut Sliding>) -> Impression {
        let mut seconds = Seconds::default();
        let mut effects = EffectLog::new(self.policy);
        let camera = press.camera.under(self.policy);
        let (own_pad, shear) = (self.pad.under(&press.material), press.sheared());
        let gel = PressedGel {
            indenter: &press.indenter,
            plane: &press.plane,
            texture: press.texture.as_ref(),
            shear: shear.as_ref(),
            unit_key: press.unit_key,
            pad: own_pad.as_ref().unwrap_or(&self.pad),
            in_plane: self.in_plane.as_deref(),
            held: self.held(press),
            material: &self.sensor.gelpad,
        };
        let CurvedPress { depth, contact, map, pins, wrench, slid, light, above_mm } =
            curved.press(&gel, sliding, &mut seconds, &mut effects);
        let mut clock = Clock::start();
        let touched = map.mask(&contact.mask);
        let image = self.camera.expose(light.into(), Some(&touched), None, &camera, &mut effects);
        let differ = self.sensor.pins.as_ref().is_some_and(|pins| pins.size_jitter > 0.0 || pins.place_jitter_mm > 0.0);
        let need = match (contact.region.is_empty(), differ) {
            _ if pins.is_none() => Requirement::Absent("the sensor has none"),
            (false, _) => Requirement::Needed("the skin carries the pins along"),
            (true, true) => Requirement::Needed("the pins differ from sample to sample"),
            (true, false) => Requirement::Unneeded("nothing moves them"),
        };
        effects.enable(Effect::Markers, need);
        seconds.camera = clock.lap();
        Impression {
            image,
            depth,
            contact,
            sliding: slid,
            markers: None,
            pins,
            wrench,
            lens: None,
            gel_map: Some(map),
            camera,
            effects,
            seconds,
            view: self.view,
            above_mm,
            lamps: None,
            drop_mm: None,
        }
    }

    /// The object captured, and the pad under it: the stages before the light. `drag` is what tractions of a sequence displace.
    fn touched(
        &self,
        press: &Press,
        pad: &Pad,
        drag: Option<Option<&Drag>>,
        clock: &mut Clock,
        seconds: &mut Seconds,
        effects: &mut EffectLog,
    ) -> Touched {
        let Press { indenter, texture, .. } = press;
        let thickness_mm = self.sensor.gelpad.thickness_mm;
        let mut window = pad.window(indenter.depth_mm);
        let mut beyond = None;
        loop {
            // How far the object reaches below the undeformed pad, at every pixel of the view and of a margin around it.
            let (texture, drop_mm) = (texture.as_ref(), self.drop_mm.as_deref());
            let depth = depth::penetration(indenter, texture, drop_mm, thickness_mm, &self.view, window, effects);
            seconds.depth += clock.lap();

            // What touches the pad beyond that, if anything does.
            let beyond = beyond.get_or_insert_with(|| {
                let unless = |effect| self.policy != EffectPolicy::Without(effect);
                let texture = texture.filter(|_| unless(Effect::Texture));
                let drop_mm = drop_mm.filter(|_| unless(Effect::RestShape));
                Surroundings::new(indenter, texture, drop_mm, thickness_mm, &self.view, window.margin_px)
                    .map(|around| effects.timed(Effect::Deformation, || pad.beyond(&around)))
            });
            // The shape that an object takes which is not rigid.
            let (depth, shaped) = gelpad::shaped(pad, depth, beyond.as_ref(), window, effects);
            // The elastomer's surface and where it touches. Rarely it bulges higher than the object was captured.
            let markers = self.in_plane.is_some();
            let mut contact = gelpad::deform(pad, &depth, beyond.as_ref(), drag, markers, effects);
            contact.numerics.converged &= shaped;
            let youngs_modulus_kpa = self.sensor.gelpad.youngs_modulus_kpa;
            let (shape, beyond) = (&indenter.shape, beyond.as_ref());
            contact.total = total_contact(shape, &depth, beyond, &mut contact, youngs_modulus_kpa, &self.view);
            seconds.gelpad += clock.lap();
            match pad.higher(window, &contact) {
                Some(higher) => window = higher,
                None => return Touched { depth, contact, window },
            }
        }
    }

    fn pressed(&self, press: &Press, mut sliding: Option<&mut Sliding>) -> Impression {
        if let Some(curved) = &self.curved {
            return self.pressed_into(curved, press, sliding);
        }
        let Press { indenter, texture, material, markers, camera, .. } = press;
        let mut clock = Clock::start();
        let mut seconds = Seconds::default();
        let mut effects = EffectLog::new(self.policy);
        let camera = camera.under(self.policy);

        let unseen_mm = if let Pad::Elastic(pad) = &*self.pad { pad.unseen_mm() } else { 0.0 };
        let drag = sliding.as_mut().map(|sliding| effects.timed(Effect::Friction, || sliding.drag(unseen_mm)));
        // A sequence has a friction of its own, and takes objects for rigid.
        let own_pad = self.pad.under(material).filter(|_| sliding.is_none());
        let pad = own_pad.as_ref().unwrap_or(&self.pad);
        let drag = drag.as_ref().map(Option::as_ref);
        let Touched { depth, mut contact, window } =
            self.touched(press, pad, drag, &mut clock, &mut seconds, &mut effects);
        if let (Some(drop_mm), Ok(error_um)) = (self.drop_mm.as_deref(), contact.numerics.model_error_um.as_mut()) {
            let depth_mm = f64::from(depth.deepest_mm);
            *error_um += 1e3 * curvature_error_mm(depth_mm, &contact.mask, drop_mm, self.view.mm_per_px);
        }
        // Between pixel centres, where it bends within a pixel.
        let scene = subpixel::Scene {
            pad,
            indenter,
            window,
            depth: &depth,
            retouched: texture.is_some() || self.drop_mm.is_some() || material.soft.is_some(),
            contact: &contact,
            view: &self.view,
            averages: self.shader.averages(),
        };
        contact.subpixel = subpixel::sample(&scene, &mut effects);
        seconds.gelpad += clock.lap();
        // The motion of the elastomer in its own plane, where markers show it.
        let (in_plane, load) = (self.in_plane.as_deref(), contact.load.as_ref());
        let (held, shear) = (self.held(press), press.sheared());
        let sliding = sliding.as_deref();
        contact.tangential =
            tangential(in_plane, &self.sensor.gelpad, load, held, shear.as_ref(), sliding, &mut effects);
        seconds.gelpad += clock.lap();

        // The light that the surface sends to the camera.
        let light = self.shader.shade(&contact, &self.background, &mut effects);
        seconds.optics = clock.lap();

        // 8-bit RGB.
        let markers = self.markers.zip(*markers).map(|(markers, pattern)| {
            let moved_by = contact.tangential.as_ref().map(|tangential| &tangential.field);
            effects.timed(Effect::Markers, || markers.print.positions(&pattern, moved_by, &self.view))
        });
        let before = effects.seconds[Effect::Shading];
        let image = self.camera.expose(light, Some(&contact.mask), markers.as_ref(), &camera, &mut effects);
        // The camera asks for the light as it goes.
        let shading = effects.seconds[Effect::Shading] - before;
        seconds.optics += shading;
        seconds.camera = clock.lap() - shading;

        let lens = camera.lens(&self.view);
        let lamps = self.lamps.clone();
        let (view, above_mm) = (self.view, window.above_mm);
        let sliding = sliding.map(|sliding| SlidingState {
            slip: sliding.slip(),
            wrench: sliding.wrench(),
            states: sliding.states(&contact.mask, &view),
        });
        let (pins, wrench, gel_map) = (None, None, None);
        Impression {
            image,
            depth,
            contact,
            sliding,
            markers,
            pins,
            wrench,
            lens,
            gel_map,
            camera,
            effects,
            seconds,
            view,
            above_mm,
            lamps,
            drop_mm: self.drop_mm.clone().filter(|_| self.policy != EffectPolicy::Without(Effect::RestShape)),
        }
    }

    /// The sensor.
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// The models of gelpad and light.
    pub fn models(&self) -> &Models {
        &self.models
    }

    /// Which effects run.
    pub fn policy(&self) -> EffectPolicy {
        self.policy
    }

    /// Its view.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// The background image as it was given or rendered, before markers and lens.
    pub fn background(&self) -> &BackgroundImage {
        &self.background
    }

    /// The image without contact, markers included.
    pub fn untouched(&self) -> &Image {
        &self.camera.untouched
    }

    /// The untouched pad as the camera of a press took it at another moment: its lens, its gains and its print, and noise of its
    /// own. Pins are those of a unit without differences.
    pub fn untouched_beside(&self, impression: &Impression) -> Image {
        let nothing = Light { region: Rect::whole(0, 0), planes: Default::default() };
        let markers = impression.markers.as_ref().map(MarkerPositions::at_rest);
        let camera = impression.camera.at_another_moment();
        self.camera.expose(nothing.into(), None, markers.as_ref(), &camera, &mut EffectLog::new(self.policy))
    }

    /// How far a curved pad lies below its highest point, mm, on the grid of [`Contact::surface`].
    pub fn drop_mm(&self) -> Option<&Grid<f32>> {
        self.drop_mm.as_deref()
    }

    /// True if tractions are known where something is moved in the pad's plane: markers show them, and the model of the
    /// gelpad knows them.
    pub fn knows_tractions(&self) -> bool {
        self.in_plane.is_some()
    }
}

/// The stages of a simulator by themselves, for studies and tests of one of them.
pub trait Stages {
    /// The gelpad alone: contacts without light.
    fn pad(&self) -> &Pad;

    /// The light alone: from a contact to brightness.
    fn shader(&self) -> &Shader;

    /// The camera alone: from brightness to an image.
    fn camera(&self) -> &Camera;

    /// The light that a contact sends to the camera, where it differs from the background image.
    fn light(&self, contact: &Contact) -> Light;
}

impl Stages for Simulator {
    fn pad(&self) -> &Pad {
        &self.pad
    }

    fn shader(&self) -> &Shader {
        &self.shader
    }

    fn camera(&self) -> &Camera {
        &self.camera
    }

    fn light(&self, contact: &Contact) -> Light {
        self.shader.shade(contact, &self.background, &mut EffectLog::new(self.policy)).whole()
    }
}

impl fmt::Debug for Simulator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sensor, models, policy, .. } = self;
        let mut shown = f.debug_struct("Simulator");
        shown.field("sensor", &sensor.name).field("resolution_px", &sensor.resolution_px);
        shown.field("models", models).field("policy", policy).finish_non_exhaustive()
    }
}

impl Press {
    /// How the indenter moves, held by the friction of its own material where that has one.
    fn sheared(&self) -> Option<Shear> {
        self.shear.map(|shear| Shear { friction: self.material.friction.unwrap_or(shear.friction), ..shear })
    }

    /// Checks the numbers that nothing else has checked.
    fn numbers_are_finite(&self) -> Result<(), PressError> {
        let Pose { rotation, translation_mm, .. } = self.indenter.pose;
        let PadPlane { axes, origin_mm } = self.plane;
        let is_finite = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
        let of_texture = |Texture { sample, laid, .. }: &Texture| {
            let TextureSample { amplitude_mm, scale_mm, angle_deg, offset: [u, v] } = *sample;
            let laid =
                laid.is_none_or(|TexturePlacement { origin_mm, yaw_deg }| is_finite(&origin_mm) && yaw_deg.is_finite());
            laid && is_finite(&[amplitude_mm, scale_mm, angle_deg, u, v])
        };
        let of_motion = |Motion { shift_mm, twist_rad, about_mm }: Motion| {
            is_finite(&shift_mm) && is_finite(&about_mm) && twist_rad.is_finite()
        };
        let checks = [
            ("pose", rotation.is_finite() && translation_mm.is_finite()),
            ("depth", self.indenter.depth_mm.is_finite()),
            ("plane", axes.is_finite() && origin_mm.is_finite()),
            ("texture", self.texture.as_ref().is_none_or(of_texture)),
            ("shear", self.shear.is_none_or(|shear| of_motion(shear.motion))),
        ];
        let wrong = checks.into_iter().find(|(_, is_fine)| !is_fine);
        wrong.map_or(Ok(()), |(name, _)| Err(PressError::NotFinite(name)))
    }

    /// A press without texture or motion, with the sensor's own markers and camera.
    pub fn new(indenter: Indenter, sensor: &Sensor) -> Self {
        let markers = sensor.markers.and_then(|markers| markers.pattern);
        Self {
            indenter,
            texture: None,
            material: ObjectMaterial::default(),
            shear: None,
            markers,
            camera: sensor.camera,
            unit_key: 0,
            plane: PadPlane::default(),
        }
    }
}
