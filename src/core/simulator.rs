//! READ FIRST: the whole simulator on one page, a pure function from a press to a tactile image.
//!
//! [`Simulator::new`] is the costly part and is shared by threads; [`Simulator::press`] cannot fail.

use std::sync::{Arc, OnceLock};

use crate::core::base::clock::{Clock, Seconds};
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::light::Light;
use crate::core::base::view::View;
use crate::core::camera::markers::{MarkerPattern, MarkerPositions};
use crate::core::camera::pins::Pins;
use crate::core::camera::{Camera, CameraParams, Image};
use crate::core::curved::sequence::MovingObject;
use crate::core::curved::{Curved, CurvedPress, PressedGel, SkinLight, SkinPicture};
use crate::core::depth::beyond::Surroundings;
use crate::core::depth::indenter::{Indenter, Shape};
use crate::core::depth::texture::{Laid, Texture};
use crate::core::depth::{self, Depth, Window, rest};
use crate::core::effects::{Effect, EffectLog, EffectPolicy, Requirement};
use crate::core::fidelity::{Fidelity, Models};
use crate::core::gelpad::elastic::friction::Drag;
use crate::core::gelpad::elastic::inplane::InPlane;
use crate::core::gelpad::elastic::model_error::curvature_error_mm;
use crate::core::gelpad::elastic::shear::Friction;
use crate::core::gelpad::material::Material;
use crate::core::gelpad::object::ObjectMaterial;
use crate::core::gelpad::sliding::{FramePad, Ground, ObjectStep, Sliding};
use crate::core::gelpad::subpixel;
use crate::core::gelpad::tangential::{Shear, tangential};
use crate::core::gelpad::whole::Whole;
use crate::core::gelpad::{self, Contact, Pad};
use crate::core::impression::{Impression, Slid};
use crate::core::optics::background::BackgroundImage;
use crate::core::optics::lamps;
use crate::core::optics::{self, Illumination, Shader};
use crate::core::pose::{PadPlane, Pose};
use crate::core::sensor::{Background, Markers, Sensor, SensorError};

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

/// An object captured and the pad under it, before the light.
struct Touched {
    depth: Depth,
    contact: Contact,
    /// What of the object was captured.
    window: Window,
}

impl Simulator {
    /// Makes a sensor ready at a fidelity level. This takes from a few milliseconds to a second.
    ///
    /// # Errors
    ///
    /// What makes the sensor impossible to simulate.
    pub fn new(sensor: &Sensor, fidelity: Fidelity) -> Result<Self, SensorError> {
        sensor.check()?;
        Ok(Self::with_models(sensor.clone(), fidelity.models(sensor.light_source()), EffectPolicy::default()))
    }

    /// The same with any models, and with a policy for the effects: one that leaves an effect out takes it from the
    /// background image, too. The sensor must be sound ([`Sensor::check`]).
    pub fn with_models(sensor: Sensor, models: Models, policy: EffectPolicy) -> Self {
        Self::make(sensor, models, policy, None)
    }

    /// Another sensor of the same models and policy: the same as [`Simulator::with_models`] of it, but what both have in
    /// common (the pad's response, the background image, its light) is shared and not computed again.
    pub fn variant(&self, sensor: Sensor) -> Self {
        Self::make(sensor, self.models.clone(), self.policy, Some(self))
    }

    /// The same, but every press says how the pad's surface moves in its plane, markers or not; see
    /// [`Impression::flow_mm`].
    pub fn with_flow(self) -> Self {
        let in_plane = self.in_plane.or_else(|| {
            let Sensor { gelpad, .. } = &self.sensor;
            self.pad.in_plane(gelpad, self.sensor.window_mm(), &self.view).map(Arc::new)
        });
        Self { flow: true, in_plane, ..self }
    }

    /// Takes from `like`, of the same models and policy, all that is the same in `sensor`.
    fn make(sensor: Sensor, models: Models, policy: EffectPolicy, like: Option<&Self>) -> Self {
        let view = sensor.view();
        // A chart's pixels are not the image's.
        let at_tip = sensor.shape.as_ref().and_then(|_| sensor.projection().view_at_tip());
        let in_image = at_tip.unwrap_or(view);
        let like = like.filter(|like| {
            let (a, b) = (&like.sensor, &sensor);
            let same_gel = a.shape == b.shape && a.lens == b.lens && a.pins == b.pins;
            like.view == view && a.field_of_view_mm == b.field_of_view_mm && same_gel
        });

        let same_look = like.filter(|like| like.sensor.background.looks_like(&sensor.background));
        let same_lamps = like.filter(|like| like.sensor.lamps == sensor.lamps);
        let same_background = same_look
            .filter(|like| sensor.has_photograph() || (same_lamps.is_some() && like.sensor.leds_glow_like(&sensor)));
        let noise = match &sensor.background {
            Background::Photograph(_) => None,
            // The picture is the lamps'.
            Background::Rendered(_) if !sensor.lamps.is_empty() => None,
            Background::Rendered(look) => {
                let known = like.filter(|like| like.sensor.background.grain_size_mm() == Some(look.grain_size_mm));
                Some(known.and_then(|like| like.noise.clone()).unwrap_or_else(|| Arc::new(look.noise(&in_image))))
            }
        };
        let background = match (same_background, &sensor.background, &noise) {
            (Some(like), ..) => Arc::clone(&like.background),
            (None, Background::Rendered(look), Some(noise)) => {
                let (leds, field_of_view_mm) = (&sensor.leds, sensor.field_of_view_mm);
                Arc::new(BackgroundImage::rendered_with(noise, look, leds, field_of_view_mm, &in_image))
            }
            _ => sensor.background(),
        };

        let same_rest = like.filter(|like| {
            let (a, b) = (&like.sensor, &sensor);
            a.rest_surface == b.rest_surface && a.coating == b.coating
        });
        let (drop_mm, relief) = match same_rest {
            Some(like) => (like.drop_mm.clone(), like.relief.clone()),
            None => {
                let drop_mm = sensor.rest_surface.as_ref().map(|shape| rest::drop_mm(shape, &view));
                let relief = match policy {
                    EffectPolicy::Without(Effect::Grain) => None,
                    EffectPolicy::Without(Effect::RestShape) => rest::relief(None, sensor.coating.as_ref(), &view),
                    _ => rest::relief(drop_mm.as_ref(), sensor.coating.as_ref(), &view),
                };
                (drop_mm.map(Arc::new), relief.map(Arc::new))
            }
        };

        let pad = match like {
            Some(like) if like.sensor.gelpad == sensor.gelpad => Arc::clone(&like.pad),
            // Displacements do not depend on it.
            Some(like)
                if Material { youngs_modulus_kpa: sensor.gelpad.youngs_modulus_kpa, ..like.sensor.gelpad }
                    == sensor.gelpad =>
            {
                Arc::new(like.pad.with_youngs_modulus(sensor.gelpad.youngs_modulus_kpa))
            }
            _ => Arc::new(Pad::new(&models.gelpad, &sensor.gelpad, &view)),
        };

        let frame_pad = match like {
            Some(like) if like.sensor.gelpad == sensor.gelpad => Arc::clone(&like.frame_pad),
            _ => Arc::default(),
        };

        let light = Illumination {
            leds: &sensor.leds,
            lamps: &sensor.lamps,
            field_of_view_mm: sensor.field_of_view_mm,
            thickness_mm: sensor.gelpad.thickness_mm,
            photograph: sensor.has_photograph(),
            darkening: sensor.darkening,
            stray_light: sensor.stray_light,
            residual: sensor.light_residual.as_deref(),
        };
        // What decides the light of the untouched pad; then what decides that of a pressed one beside it.
        let same_leds = same_rest.and(same_lamps).filter(|like| {
            let (a, b) = (&like.sensor, &sensor);
            let same_table = match (&a.calibration, &b.calibration) {
                (None, None) => true,
                (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                _ => false,
            };
            let same_light = a.leds == b.leds && a.stray_light == b.stray_light && a.light_residual == b.light_residual;
            // A thickness decides which LEDs are too far for heights to matter.
            let near = matches!(models.optics, optics::Model::Led(_));
            let same_light = same_light && (!near || a.gelpad.thickness_mm == b.gelpad.thickness_mm);
            same_light && a.has_photograph() == b.has_photograph() && same_table
        });
        let same_shader = same_leds.filter(|like| {
            let (a, b) = (&like.sensor, &sensor);
            a.darkening == b.darkening && a.gelpad.thickness_mm == b.gelpad.thickness_mm
        });
        let shader = match same_shader {
            Some(like) => Arc::clone(&like.shader),
            None => {
                let relief = relief.as_deref().cloned();
                Arc::new(Shader::new(&models.optics, sensor.calibration.as_deref(), &light, &view, relief))
            }
        };
        let lamps = match same_lamps {
            _ if sensor.lamps.is_empty() => None,
            Some(like) => like.lamps.clone(),
            None => Some(Arc::new(lamps::Shader::new(&sensor.lamps, &view))),
        };

        let markers = sensor.markers.filter(|_| policy != EffectPolicy::Without(Effect::Markers));
        let flow = like.is_some_and(|like| like.flow);
        let in_plane = match like {
            Some(like) if like.markers.is_some() == markers.is_some() && Arc::ptr_eq(&like.pad, &pad) => {
                like.in_plane.clone()
            }
            _ if markers.is_none() && !flow && sensor.pins.is_none() => None,
            _ => pad.in_plane(&sensor.gelpad, sensor.window_mm(), &view).map(Arc::new),
        };
        let curved = sensor.shape.clone().map(|shape| {
            let known = like.filter(|like| Arc::ptr_eq(&like.pad, &pad)).filter(|like| match sensor.pins {
                Some(_) => like.sensor.background.looks_like(&sensor.background),
                None => Arc::ptr_eq(&like.shader, &shader) && Arc::ptr_eq(&like.background, &background),
            });
            let make = || {
                let (camera, margin_px) = (sensor.projection(), pad.window(0.0).margin_px);
                let Some(pins) = &sensor.pins else {
                    let picture = match (&sensor.background, &noise) {
                        (Background::Rendered(look), Some(noise)) => SkinPicture::Rendered(look, noise),
                        _ => SkinPicture::Photograph(&background),
                    };
                    let phong = models.optics.phong().copied().unwrap_or_default();
                    let look = SkinLight { phong, light, background: picture, in_image };
                    return Arc::new(Curved::with_skin(shape, camera, view, margin_px, &look));
                };
                let dark = match &sensor.background {
                    Background::Rendered(look) => look.color,
                    Background::Photograph(_) => [0.0; 3],
                };
                // A policy that leaves markers out leaves pins out, too.
                let at_mm = match policy {
                    EffectPolicy::Without(Effect::Markers) => Vec::new(),
                    _ => pins.at_mm.clone(),
                };
                let pins = Pins { at_mm, ..pins.clone() };
                Arc::new(Curved::with_pins(shape, camera, view, margin_px, pins, dark))
            };
            known.and_then(|like| like.curved.clone()).unwrap_or_else(make)
        });
        let same_camera = same_leds.zip(same_background).map(|(like, _)| like).filter(|like| {
            let (a, b) = (&like.sensor, &sensor);
            a.camera == b.camera && a.markers == b.markers
        });
        let camera = match same_camera {
            Some(like) => Arc::clone(&like.camera),
            None => {
                let printed = markers.and_then(|markers| Some(markers.print.positions(&markers.pattern?, None, &view)));
                let untouched = match &curved {
                    Some(curved) => curved.untouched(),
                    None => shader.untouched(&background),
                };
                let resting = sensor.camera.under(policy);
                Arc::new(Camera::new(&in_image, untouched, sensor.has_photograph(), resting, printed))
            }
        };
        let background = match &curved {
            Some(_) => {
                let Image { width, height, rgb, .. } = &camera.untouched;
                Arc::new(BackgroundImage::new(*width, *height, rgb.clone()))
            }
            None => background,
        };
        Self {
            sensor,
            models,
            policy,
            view,
            background,
            noise,
            drop_mm,
            relief,
            pad,
            frame_pad,
            markers,
            flow,
            in_plane,
            shader,
            lamps,
            camera,
            curved,
        }
    }

    /// Presses an indenter into the pad, with the sensor's own markers and camera.
    ///
    /// # Panics
    ///
    /// If the indenter is a height map of another size than the sensor's image, or one that is pressed into a gel that has a shape.
    pub fn press(&self, indenter: &Indenter) -> Impression {
        self.press_with(&Press::new(indenter.clone(), &self.sensor))
    }

    /// Presses with texture, motion in the pad's plane, and markers and camera of its own.
    ///
    /// # Panics
    ///
    /// If the indenter is a height map of another size than the sensor's image, or one that is pressed into a gel that has a shape.
    pub fn press_with(&self, press: &Press) -> Impression {
        self.pressed(press, None)
    }

    /// An object that is to slide, turn and roll on the pad; `None` if the model of the gelpad knows no tractions.
    pub fn sliding(&self, friction: Friction) -> Option<Sliding> {
        match &self.models.gelpad {
            gelpad::Model::Elastic(elastic) => {
                let pad = || FramePad::new(elastic, &self.sensor.gelpad, &self.view);
                Some(Sliding::new(self.frame_pad.get_or_init(pad), friction))
            }
            _ => None,
        }
    }

    /// The next frame of a sequence: the object goes through `steps`, the last of which leads to where `press` has it, and
    /// friction remembers in `sliding` what it did. The press's texture lies where it lay at the start of the sequence; its
    /// shear is left out.
    ///
    /// ```
    /// use gelsim::{Fidelity, Friction, Indenter, ObjectStep, PlanarMotion, Pose, Press, Sensor, Simulator};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let sensor = Sensor::preset("gelsight-2014")?.with_resolution([80, 60]);
    /// let simulator = Simulator::new(&sensor, Fidelity::Draft)?;
    /// let view = sensor.view();
    /// let mut sliding = simulator.sliding(Friction::Coulomb { coefficient: 0.3 }).expect("an elastic pad");
    /// let mut wrench = Default::default();
    /// for frame in 0..12 {
    ///     // A ball of 4 mm: pressed in for four frames, then pushed to the right.
    ///     let (deep, right, by) = (0.2 * f64::from(frame.min(3) + 1), 0.2 * f64::from((frame - 3).max(0)), 0.2);
    ///     let ball = |i: usize| {
    ///         let [x, y] = view.point_mm([(i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5]);
    ///         let left = 16.0 - (x - right) * (x - right) - y * y;
    ///         if left > 0.0 { (deep - 4.0 + left.sqrt()) as f32 } else { f32::NEG_INFINITY }
    ///     };
    ///     let pose = Pose::placed([0.0, 0.0, 0.0, 1.0], [right, 0.0, -deep]);
    ///     let indenter = Indenter { pose, ..Indenter::height_map([80, 60], (0..80 * 60).map(ball).collect())? };
    ///     let shift_mm = [if frame > 3 { by } else { 0.0 }, 0.0];
    ///     let motion = PlanarMotion { shift_mm, ..PlanarMotion::default() };
    ///     let step = ObjectStep { pose, depth_mm: indenter.depth_mm, motion };
    ///     let impression = simulator.press_next(&Press::new(indenter, &sensor), &[step], &mut sliding);
    ///     wrench = impression.sliding.expect("a frame of a sequence").wrench;
    /// }
    /// let [x, _, z] = wrench.force_n;
    /// assert!(x > 0.25 * -z && x < 0.301 * -z, "{wrench:?}"); // it slips
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Panics
    ///
    /// If the indenter is a height map of another size than the sensor's image, or one that is pressed into a gel that has a shape.
    pub fn press_next(&self, press: &Press, steps: &[ObjectStep], sliding: &mut Sliding) -> Impression {
        let mut clock = Clock::start();
        match &self.curved {
            Some(curved) => curved.advance(sliding, steps, &self.moving(press)),
            None => sliding.advance(steps, &press.indenter, self.ground(press)),
        }
        let carried = |texture: &Texture| {
            let laid = texture.laid.unwrap_or_else(|| Laid::over(&press.indenter.pose, &press.plane));
            texture.laid_out(sliding.carried(laid))
        };
        let press = Press { texture: press.texture.as_ref().map(carried), shear: None, ..press.clone() };
        let seconds = clock.lap();
        let mut impression = self.pressed(&press, Some(sliding));
        impression.seconds.gelpad += seconds;
        impression.effects.seconds[Effect::Friction] += seconds;
        impression
    }

    /// Normal force of the whole object on the pad if it were pressed so deep at a pose, N.
    pub fn force_n(&self, sliding: &Sliding, press: &Press, pose: Pose, depth_mm: f64) -> f64 {
        match &self.curved {
            Some(curved) => curved.force_n(sliding, &self.moving(press), &pose),
            None => sliding.normal_force_n(&press.indenter, pose, depth_mm, self.ground(press)),
        }
    }

    /// Normal force of the whole object on the pad, in view and beyond, N: to the bit what [`Simulator::press_with`] has as
    /// `contact.whole.total_force_n`, on a flat pad without its light and image. `None` where that is not known.
    ///
    /// # Panics
    ///
    /// As [`Simulator::press_with`] does.
    pub fn total_force_n(&self, press: &Press) -> Option<f64> {
        if self.curved.is_some() {
            return self.press_with(press).contact.whole.total_force_n;
        }
        let own_pad = self.pad.under(&press.material);
        let (mut clock, mut seconds) = (Clock::start(), Seconds::default());
        let mut effects = EffectLog::new(self.policy);
        let pad = own_pad.as_ref().unwrap_or(&self.pad);
        self.touched(press, pad, None, &mut clock, &mut seconds, &mut effects).contact.whole.total_force_n
    }

    /// What moves over a gel that is not flat.
    fn moving<'a>(&'a self, press: &'a Press) -> MovingObject<'a> {
        MovingObject {
            indenter: &press.indenter,
            plane: &press.plane,
            texture: self.ground(press).texture,
            thickness_mm: self.sensor.gelpad.thickness_mm,
        }
    }

    /// What beside the object's shape decides where it meets the pad, unless it is left out.
    fn ground<'a>(&'a self, press: &'a Press) -> Ground<'a> {
        let unless = |effect| self.policy != EffectPolicy::Without(effect);
        Ground {
            camera: &self.view,
            texture: press.texture.as_ref().filter(|_| unless(Effect::Texture)),
            drop_mm: self.drop_mm.as_deref().filter(|_| unless(Effect::RestShape)),
        }
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
        let image = self.camera.expose(light, Some(&touched), None, &camera, &mut effects);
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
        if let Shape::HeightMap(map) = &indenter.shape {
            let size = [map.above_mm.width, map.above_mm.height];
            assert_eq!(size, self.view.resolution_px, "a height map has the size of the sensor's image");
        }
        let thickness_mm = self.sensor.gelpad.thickness_mm;
        let mut window = pad.window(indenter.depth_mm);
        let mut beyond = None;
        loop {
            // How far the object reaches below the undeformed pad, at every pixel of the view and of a margin around it.
            let (texture, drop_mm) = (texture.as_ref(), self.drop_mm.as_deref());
            let depth = depth::overlap(indenter, texture, drop_mm, thickness_mm, &self.view, window, effects);
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
            contact.whole = Whole::of(shape, &depth, beyond, &mut contact, youngs_modulus_kpa, &self.view);
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
        if let (Some(drop_mm), Some(error_um)) = (self.drop_mm.as_deref(), contact.numerics.model_error_um.as_mut()) {
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
        let image = self.camera.expose(light, Some(&contact.mask), markers.as_ref(), &camera, &mut effects);
        seconds.camera = clock.lap();

        let lens = camera.lens(&self.view);
        let lamps = self.lamps.clone();
        let (view, above_mm) = (self.view, window.above_mm);
        let sliding = sliding.map(|sliding| Slid {
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
        self.camera.expose(nothing, None, markers.as_ref(), &camera, &mut EffectLog::new(self.policy))
    }

    /// The gelpad alone: contacts without light.
    pub fn pad(&self) -> &Pad {
        &self.pad
    }

    /// The light alone: from a contact to brightness.
    pub fn shader(&self) -> &Shader {
        &self.shader
    }

    /// The camera alone: from brightness to an image.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The light that a contact sends to the camera, where it differs from the background image.
    pub fn light(&self, contact: &Contact) -> Light {
        self.shader.shade(contact, &self.background, &mut EffectLog::new(self.policy))
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

impl Press {
    /// How the indenter moves, held by the friction of its own material where that has one.
    fn sheared(&self) -> Option<Shear> {
        self.shear.map(|shear| Shear { friction: self.material.friction.unwrap_or(shear.friction), ..shear })
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
