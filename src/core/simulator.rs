//! READ FIRST: the entire simulator on one page, a pure function from a press to a tactile image.
//!
//! [`Simulator::new`] is the costly part, and threads share what it makes. A press fails only on what no sensor can be
//! pressed with ([`PressError`]).

use std::fmt;
use std::sync::Arc;

use once_cell::race::OnceBox;

use crate::base::clock::{Seconds, ThreadClock};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::view::View;
use crate::camera::markers::{MarkerPattern, MarkerPositions};
use crate::camera::{Camera, CameraParams, Image};
use crate::curved::{CurvedGel, CurvedPressInput, CurvedPressResult};
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::outside_window::OutsideCapture;
use crate::depth::texture::{Texture, TexturePlacement, TextureSample};
use crate::depth::{self, CaptureWindow, Depth};
use crate::effects::{Effect, EffectLog, EffectPolicy, Requirement};
use crate::fidelity::Models;
use crate::gelpad::elastic::in_plane::InPlaneResponse;
use crate::gelpad::elastic::model_error::curvature_error_mm;
use crate::gelpad::elastic::shear::{Friction, Motion};
use crate::gelpad::object_material::ObjectMaterial;
use crate::gelpad::sliding::{CarriedLoads, Sliding, SlidingPad};
use crate::gelpad::tangential::{Shear, solve_tangential_motion};
use crate::gelpad::total_contact::measure_total_contact;
use crate::gelpad::{self, Contact, Pad, subpixel};
use crate::impression::{Impression, SlidingState};
use crate::mesh::clusters::Clusters;
use crate::optics::background::BackgroundImage;
use crate::optics::light_error::LightError;
use crate::optics::{Shader, lamps};
use crate::pose::{PadPlane, Pose};
use crate::sensor::{Markers, Sensor};

mod frames;
mod prepare;
mod together;

/// A sensor prepared for presses: everything that is the same in every press, computed once.
///
/// Threads share it by reference: a press changes nothing in it.
pub struct Simulator {
    sensor: Sensor,
    models: Models,
    policy: EffectPolicy,
    view: View,
    background: Arc<BackgroundImage>,
    /// Noise of the grain of a rendered background.
    grain_noise: Option<Arc<Grid<f32>>>,
    /// How far a curved pad lies below its highest point, mm.
    drop_mm: Option<Arc<Grid<f32>>>,
    /// Relief of a pad that is not smooth and flat, as the light sees it.
    relief: Option<Arc<Grid<f32>>>,
    pad: Arc<Pad>,
    /// The pad under objects that slide, prepared when the first sequence begins.
    frame_pad: Arc<OnceBox<SlidingPad>>,
    /// The sensor's markers, unless the policy leaves them out.
    markers: Option<Markers>,
    /// True if every press computes in-plane motion, even if neither markers nor pins show it.
    wants_flow: bool,
    /// What gives the pad's in-plane motion; `None` if nothing needs it.
    in_plane: Option<Arc<InPlaneResponse>>,
    shader: Arc<Shader>,
    /// What the model of the light leaves out, once it is asked for.
    light_error: OnceBox<Result<LightError, &'static str>>,
    /// The grey images of the sensor's lamps, whatever the optics model.
    lamps: Option<Arc<lamps::LampShader>>,
    camera: Arc<Camera>,
    /// The gel and the pins inside it, if it is not flat.
    curved: Option<Arc<CurvedGel>>,
}

/// One press: an object, how it moves, and what the sensor leaves to each press.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Press {
    /// The object that is pressed into the pad, and where.
    pub indenter: Indenter,
    /// Micro-texture of the indenter; `None` if it has none.
    pub texture: Option<Texture>,
    /// Material of the indenter. A frame of a sequence takes it as rigid.
    pub material: ObjectMaterial,
    /// How the indenter, once pressed in, moves in the pad's plane; `None` if it does not.
    pub shear: Option<Shear>,
    /// Distance, size and jitter of the markers, on a sensor that has some; `None` prints none.
    pub markers: Option<MarkerPattern>,
    /// The camera's parameters.
    pub camera: CameraParams,
    /// Key of the differences between units of a sensor with pins.
    pub unit_key: u64,
    /// The plane over which the indenter is posed: that of the flat pad, or one that touches a gel that is not flat.
    pub plane: PadPlane,
}

/// The reason why something cannot be pressed.
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
    /// Finite strain is solved on flat pads, and this sensor's gel has a shape.
    #[error(
        "finite strain is solved on flat pads, and the gel of this sensor has a shape: take the fidelity level high"
    )]
    FiniteStrainOnCurvedGel,
    /// At finite strain the pad sticks to the object or slides freely.
    #[error("at finite strain the pad sticks or slides freely: give the object no friction of its own")]
    CoulombAtFiniteStrain,
    /// A number is NaN or infinite.
    #[error("the {0} of the press is NaN or infinite")]
    NotFinite(&'static str),
    /// A step of a sequence moves by more than positions of objects allow.
    #[error("a step of the sequence leads too far: give positions in the sensor's frame, in mm")]
    TooFar,
    /// The sequence was begun by the simulator of another sensor.
    #[error("the sequence was begun on another sensor: begin it with `sliding` of this simulator")]
    OtherSensor,
}

/// A captured object and the pad under it, before the light.
struct CapturedContact {
    depth: Depth,
    contact: Contact,
    /// The window in which the object was captured.
    window: CaptureWindow,
}

/// A pressed flat pad before the light: what sensors of one pad and view have in common.
#[derive(Clone)]
struct PressedPad {
    depth: Depth,
    contact: Contact,
    /// How high above the undeformed pad the object was captured, mm.
    above_mm: f64,
    effects: EffectLog,
    seconds: Seconds,
}

impl PressedPad {
    /// Returns a copy for another sensor. What it took to compute is counted once.
    fn for_another(&self) -> Self {
        self.clone().into_another()
    }

    /// Returns this pad for another sensor, as [`PressedPad::for_another`] does.
    fn into_another(self) -> Self {
        Self { effects: self.effects.without_seconds(), seconds: Seconds::default(), ..self }
    }
}

impl Simulator {
    /// Presses an indenter into the pad, with the sensor's own markers and camera.
    ///
    /// # Panics
    ///
    /// If [`Simulator::try_press`] returns an error.
    pub fn press(&self, indenter: &Indenter) -> Impression {
        self.press_with(&Press::new(indenter.clone(), &self.sensor))
    }

    /// Presses an object with the texture, motion, markers and camera of `press`.
    ///
    /// # Panics
    ///
    /// If [`Simulator::try_press`] returns an error.
    pub fn press_with(&self, press: &Press) -> Impression {
        self.try_press(press).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Presses an object with the texture, motion, markers and camera of `press`, and returns what cannot be pressed as
    /// an error.
    ///
    /// # Errors
    ///
    /// If the indenter is a height map of another size than the sensor's image, or a height map over a gel that has a
    /// shape, or if a number of the press is NaN or infinite. If the model of the gelpad solves finite strain, also if the
    /// gel has a shape or friction is Coulomb's.
    pub fn try_press(&self, press: &Press) -> Result<Impression, PressError> {
        self.check_press(press)?;
        Ok(self.render_press(press, None))
    }

    fn check_press(&self, press: &Press) -> Result<(), PressError> {
        if self.models.gelpad.strain_settings().is_some() {
            if self.curved.is_some() {
                return Err(PressError::FiniteStrainOnCurvedGel);
            }
            if let Some(Friction::Coulomb { .. }) = self.holding_friction(press) {
                return Err(PressError::CoulombAtFiniteStrain);
            }
        }
        if let Shape::HeightMap(map) = &press.indenter.shape {
            let (found, expected) = ([map.above_mm.width, map.above_mm.height], self.view.resolution_px);
            if self.curved.is_some() {
                return Err(PressError::HeightMapOnCurvedGel);
            }
            if found != expected {
                return Err(PressError::HeightMapSize { found, expected });
            }
        }
        press.check_finite()
    }

    /// Finds where a mesh comes closest to the pad. Returns the plane that touches the pad there, and how far the mesh
    /// reaches below it, mm; negative if it does not. On a flat pad this is the pad's own plane.
    pub fn find_contact_plane(&self, mesh: &Clusters, pose: &Pose) -> (PadPlane, f64) {
        let Some(curved) = &self.curved else { return (PadPlane::default(), 0.0 - pose.lowest_mm(mesh)) };
        let (site, reaches_mm) = curved.find_deepest_site(mesh, pose, self.sensor.gelpad.thickness_mm);
        (PadPlane::tangent_at(site.point_mm, site.normal), reaches_mm)
    }

    /// Returns the normal force of the entire object on the pad, in view and outside it, N; `None` where it is not
    /// known.
    ///
    /// It equals `contact.total.total_force_n` of [`Simulator::press_with`] to the bit. On a flat pad, neither light
    /// nor image is computed.
    ///
    /// # Panics
    ///
    /// If [`Simulator::try_press`] returns an error.
    pub fn total_force_n(&self, press: &Press) -> Option<f64> {
        self.check_press(press).unwrap_or_else(|error| panic!("{error}"));
        if self.curved.is_some() {
            return self.press_with(press).contact.total.total_force_n;
        }
        let own_pad = self.pad.with_object_material(&press.material);
        let (mut clock, mut seconds) = (ThreadClock::start(), Seconds::default());
        let mut effects = EffectLog::new(self.policy);
        let pad = own_pad.as_ref().unwrap_or(&self.pad);
        self.compute_contact(press, pad, None, &mut clock, &mut seconds, &mut effects).contact.total.total_force_n
    }

    /// Returns the friction between pad and object while it is pressed in; `None` if there is none.
    fn holding_friction(&self, press: &Press) -> Option<Friction> {
        self.models.gelpad.friction().map(|friction| press.material.friction.unwrap_or(friction))
    }

    /// Presses an object into a gel that is not flat; with `sliding`, in a frame of a sequence.
    fn press_curved_gel(&self, curved: &CurvedGel, press: &Press, sliding: Option<&mut Sliding>) -> Impression {
        let mut seconds = Seconds::default();
        let mut effects = EffectLog::new(self.policy);
        let camera = press.camera.with_policy(self.policy);
        let (own_pad, shear) = (self.pad.with_object_material(&press.material), press.shear_with_friction());
        let gel = CurvedPressInput {
            indenter: &press.indenter,
            plane: &press.plane,
            texture: press.texture.as_ref(),
            shear: shear.as_ref(),
            unit_key: press.unit_key,
            pad: own_pad.as_ref().unwrap_or(&self.pad),
            in_plane: self.in_plane.as_deref(),
            press_friction: self.holding_friction(press),
            material: &self.sensor.gelpad,
        };
        let CurvedPressResult { depth, contact, map, pins, wrench, sliding: sliding_state, light, above_mm } =
            curved.press(&gel, sliding, &mut seconds, &mut effects);
        let mut clock = ThreadClock::start();
        let touched = map.warp_mask(&contact.mask);
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
            sliding: sliding_state,
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

    /// Captures the object and deforms the pad: the stages before the light. In a sequence `carried` is `Some`, with
    /// what the loads before this press do.
    fn compute_contact(
        &self,
        press: &Press,
        pad: &Pad,
        carried: Option<&CarriedLoads>,
        clock: &mut ThreadClock,
        seconds: &mut Seconds,
        effects: &mut EffectLog,
    ) -> CapturedContact {
        let Press { indenter, texture, .. } = press;
        let thickness_mm = self.sensor.gelpad.thickness_mm;
        let mut window = pad.capture_window(indenter.depth_mm);
        let mut outside = None;
        loop {
            // How far the object reaches below the undeformed pad, at every pixel of the view and of a margin around
            // it.
            let (texture, drop_mm) = (texture.as_ref(), self.drop_mm.as_deref());
            let depth =
                depth::capture_penetration(indenter, texture, drop_mm, thickness_mm, &self.view, window, effects);
            seconds.depth += clock.lap();

            // What touches the pad outside that window, if anything does. It is solved once: a higher window has the
            // same margin.
            let outside = outside.get_or_insert_with(|| {
                let keeps = |effect| self.policy != EffectPolicy::Without(effect);
                let texture = texture.filter(|_| keeps(Effect::Texture));
                let drop_mm = drop_mm.filter(|_| keeps(Effect::RestShape));
                OutsideCapture::new(indenter, texture, drop_mm, thickness_mm, &self.view, window.margin_px)
                    .map(|around| effects.run_timed(Effect::Deformation, || pad.solve_outside_window(&around)))
            });
            // An elastic object takes another shape under its load.
            let (depth, object_converged) = gelpad::deform_object(pad, depth, outside.as_ref(), window, effects);
            // The pad's surface and where it touches. Rarely it bulges higher than the object was captured; then a
            // higher window is captured, and the contact is solved again.
            let markers = self.in_plane.is_some();
            let mut contact = gelpad::deform_pad(pad, &depth, outside.as_ref(), carried, markers, effects);
            contact.numerics.converged &= object_converged;
            let youngs_modulus_kpa = self.sensor.gelpad.youngs_modulus_kpa;
            let (shape, outside) = (&indenter.shape, outside.as_ref());
            contact.total = measure_total_contact(shape, &depth, outside, &mut contact, youngs_modulus_kpa, &self.view);
            seconds.gelpad += clock.lap();
            match pad.higher_window(window, &contact) {
                Some(higher) => window = higher,
                None => return CapturedContact { depth, contact, window },
            }
        }
    }

    fn render_press(&self, press: &Press, mut sliding: Option<&mut Sliding>) -> Impression {
        if let Some(curved) = &self.curved {
            return self.press_curved_gel(curved, press, sliding);
        }
        let pressed = self.press_pad(press, sliding.as_deref_mut());
        self.light_pad(press, pressed, sliding.as_deref())
    }

    /// Captures the object, deforms the pad and moves it in its own plane: all of a press into a flat pad before the
    /// light.
    fn press_pad(&self, press: &Press, mut sliding: Option<&mut Sliding>) -> PressedPad {
        let Press { indenter, texture, material, .. } = press;
        let mut clock = ThreadClock::start();
        let mut seconds = Seconds::default();
        let mut effects = EffectLog::new(self.policy);

        let negligible_mm = if let Pad::Elastic(pad) = &*self.pad { pad.negligible_mm() } else { 0.0 };
        let carried = sliding
            .as_mut()
            .map(|sliding| effects.run_timed(Effect::Friction, || sliding.carried_loads(negligible_mm)));
        // A sequence has its own friction, and takes objects as rigid.
        let own_pad = self.pad.with_object_material(material).filter(|_| sliding.is_none());
        let pad = own_pad.as_ref().unwrap_or(&self.pad);
        let CapturedContact { depth, mut contact, window } =
            self.compute_contact(press, pad, carried.as_ref(), &mut clock, &mut seconds, &mut effects);
        // The contact was solved on a flat layer: a curved pad adds to the error of that model.
        if let (Some(drop_mm), Ok(error_um)) = (self.drop_mm.as_deref(), contact.numerics.model_error_um.as_mut()) {
            let depth_mm = f64::from(depth.deepest_mm);
            *error_um += 1e3 * curvature_error_mm(depth_mm, &contact.mask, drop_mm, self.view.mm_per_px);
        }
        // Samples between the pixel centres, for pixels within which the surface bends.
        let scene = subpixel::SubpixelInput {
            pad,
            indenter,
            window,
            depth: &depth,
            has_texture_or_drop: texture.is_some() || self.drop_mm.is_some() || material.soft.is_some(),
            contact: &contact,
            view: &self.view,
            averages_light: self.shader.averages_within_pixels(),
        };
        contact.subpixel = subpixel::sample_subpixels(&scene, &mut effects);
        seconds.gelpad += clock.lap();
        // The motion of the pad in its own plane, where something shows it.
        let (in_plane, load) = (self.in_plane.as_deref(), contact.load.as_ref());
        let (press_friction, shear) = (self.holding_friction(press), press.shear_with_friction());
        contact.tangential = solve_tangential_motion(
            in_plane,
            &self.sensor.gelpad,
            (load, contact.strain_motion.as_ref()),
            press_friction,
            shear.as_ref(),
            sliding.as_deref(),
            &mut effects,
        );
        seconds.gelpad += clock.lap();
        PressedPad { depth, contact, above_mm: window.above_mm, effects, seconds }
    }

    /// Takes the picture of a pressed pad: the light that its surface sends to the camera, markers and camera.
    fn light_pad(&self, press: &Press, pressed: PressedPad, sliding: Option<&Sliding>) -> Impression {
        let PressedPad { depth, contact, above_mm, mut effects, mut seconds } = pressed;
        let Press { markers, camera, .. } = press;
        let camera = camera.with_policy(self.policy);
        let mut clock = ThreadClock::start();

        // The light that the surface sends to the camera.
        let light = self.shader.shade(&contact, &self.background, &mut effects);
        seconds.optics = clock.lap();

        // The camera's image, 8-bit RGB.
        let markers = self.markers.as_ref().zip(*markers).map(|(markers, pattern)| {
            let moved_by = contact.tangential.as_ref().map(|tangential| &tangential.field);
            effects.run_timed(Effect::Markers, || markers.print.carried_positions(&pattern, moved_by, &self.view))
        });
        let before = effects.seconds[Effect::Shading];
        let image = self.camera.expose(light, Some(&contact.mask), markers.as_ref(), &camera, &mut effects);
        // Light is shaded only when the camera needs it, but its time counts as that of the optics.
        let shading = effects.seconds[Effect::Shading] - before;
        seconds.optics += shading;
        seconds.camera = clock.lap() - shading;

        let lens = camera.lens(&self.view);
        let lamps = self.lamps.clone();
        let view = self.view;
        let sliding = sliding.map(|sliding| SlidingState {
            slip: sliding.slip(),
            wrench: sliding.wrench(),
            states: sliding.stick_slip_states(&contact.mask, &view),
            tractions: sliding.traction_map(1.0),
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

    /// Returns the sensor.
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Returns the models of gelpad and light.
    pub fn models(&self) -> &Models {
        &self.models
    }

    /// Returns the policy that decides which effects run.
    pub fn policy(&self) -> EffectPolicy {
        self.policy
    }

    /// Returns the view: the image's size, and the size of a pixel on the pad.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Returns the background image as it was given or rendered, before markers and lens.
    pub fn background(&self) -> &BackgroundImage {
        &self.background
    }

    /// Returns what the model of the light is expected to leave out; why that is not known as an error.
    ///
    /// # Errors
    ///
    /// If the gel has a shape, or if the light was measured or fitted to pictures.
    pub fn light_error(&self) -> Result<&LightError, &'static str> {
        let find = || {
            if self.curved.is_some() {
                return Err("the gel has a shape");
            }
            let mean =
                |plane: &Vec<u8>| plane.iter().map(|level| f64::from(*level)).sum::<f64>() / plane.len().max(1) as f64;
            let rest_levels = self.background.planes.each_ref().map(mean);
            LightError::new(&self.models.optics, &self.sensor.illumination(), rest_levels)
        };
        self.light_error.get_or_init(|| Box::new(find())).as_ref().map_err(|why| *why)
    }

    /// Returns the image without contact, markers included.
    pub fn untouched(&self) -> &Image {
        &self.camera.untouched
    }

    /// Takes the image of the untouched pad as the camera of a press would at another moment: with the lens, gains and
    /// print of that press, and fresh noise. Pins are those of a unit without differences.
    pub fn untouched_beside(&self, impression: &Impression) -> Image {
        let nothing = Light { region: Rect::whole(0, 0), planes: Default::default() };
        let markers = impression.markers.as_ref().map(MarkerPositions::at_rest);
        let camera = impression.camera.with_fresh_noise();
        self.camera.expose(nothing.into(), None, markers.as_ref(), &camera, &mut EffectLog::new(self.policy))
    }

    /// Returns how far a curved pad lies below its highest point, mm, on the grid of [`Contact::surface`]; `None` if
    /// the pad is flat.
    pub fn drop_mm(&self) -> Option<&Grid<f32>> {
        self.drop_mm.as_deref()
    }

    /// Returns true if a press computes the tractions of an object that moves in the pad's plane: something shows them,
    /// and the model of the gelpad knows them.
    pub fn knows_tractions(&self) -> bool {
        self.in_plane.is_some()
    }
}

/// The stages of a simulator one by one, for studies and tests of a single stage.
pub trait Stages {
    /// Returns the gelpad: contacts without light.
    fn pad(&self) -> &Pad;

    /// Returns the shader: from a contact to brightness.
    fn shader(&self) -> &Shader;

    /// Returns the camera: from brightness to an image.
    fn camera(&self) -> &Camera;

    /// Computes the light that a contact sends to the camera, where it differs from the background image.
    fn shade_contact(&self, contact: &Contact) -> Light;
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

    fn shade_contact(&self, contact: &Contact) -> Light {
        self.shader.shade(contact, &self.background, &mut EffectLog::new(self.policy)).into_light()
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
    /// Returns how the indenter moves; the friction of its own material, if it has any, replaces that of the motion.
    fn shear_with_friction(&self) -> Option<Shear> {
        self.shear.map(|shear| Shear { friction: self.material.friction.unwrap_or(shear.friction), ..shear })
    }

    /// Checks the numbers of the press that nothing else has checked.
    fn check_finite(&self) -> Result<(), PressError> {
        let Pose { rotation, translation_mm, .. } = self.indenter.pose;
        let PadPlane { axes, origin_mm } = self.plane;
        let is_finite = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
        let of_texture = |Texture { sample, placement, .. }: &Texture| {
            let TextureSample { amplitude_mm, scale_mm, angle_deg, offset: [u, v] } = *sample;
            let is_placed = placement
                .is_none_or(|TexturePlacement { origin_mm, yaw_deg }| is_finite(&origin_mm) && yaw_deg.is_finite());
            is_placed && is_finite(&[amplitude_mm, scale_mm, angle_deg, u, v])
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

    /// Makes a press without texture and motion, with the sensor's own markers and camera.
    pub fn new(indenter: Indenter, sensor: &Sensor) -> Self {
        let markers = sensor.markers.as_ref().and_then(|markers| markers.pattern);
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
