//! Makes a sensor ready: computes what is the same in every press, or shares it with a simulator in which it is the same.

use std::sync::Arc;

use crate::camera::pins::Pins;
use crate::camera::{Camera, Image};
use crate::curved::{Curved, SkinLight, SkinPicture};
use crate::depth::rest;
use crate::effects::{Effect, EffectPolicy};
use crate::fidelity::{Fidelity, Models};
use crate::gelpad::Pad;
use crate::gelpad::material::Material;
use crate::optics::background::BackgroundImage;
use crate::optics::{self, Illumination, Shader, lamps};
use crate::sensor::{Background, Sensor, SensorError};

use super::Simulator;

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
    /// [`crate::impression::Impression::flow_mm`].
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
}
