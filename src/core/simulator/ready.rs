//! Makes a sensor ready: computes what is the same in every press, or shares it with a simulator in which it is the same.

use std::sync::Arc;

use crate::base::light::Light;
use crate::camera::pins::Pins;
use crate::camera::{Camera, Image};
use crate::curved::{Curved, Look, SkinLight, SkinPicture};
use crate::depth::rest::{self, Grain, RestSurface};
use crate::effects::{Effect, EffectPolicy};
use crate::fidelity::{Fidelity, Models};
use crate::gelpad::Pad;
use crate::gelpad::material::Material;
use crate::optics::background::BackgroundImage;
use crate::optics::calibrated::Table;
use crate::optics::led::Led;
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
        let flow = like.is_some_and(|like| like.flow);
        let like = like.filter(|like| like.view == view && geometry(&like.sensor) == geometry(&sensor));
        let ready = Sharing { sensor: &sensor, like };

        let (drop_mm, relief) = ready.part(
            rest_surface,
            |like| (like.drop_mm.clone(), like.relief.clone()),
            |(shape, coating)| {
                let drop_mm = shape.map(|shape| rest::drop_mm(shape, &view));
                let relief = match policy {
                    EffectPolicy::Without(Effect::Grain) => None,
                    EffectPolicy::Without(Effect::RestShape) => rest::relief(None, coating, &view),
                    _ => rest::relief(drop_mm.as_ref(), coating, &view),
                };
                (drop_mm.map(Arc::new), relief.map(Arc::new))
            },
        );
        let (pad, frame_pad) = ready.part(
            |of| of.gelpad,
            |like| (Arc::clone(&like.pad), Arc::clone(&like.frame_pad)),
            |gelpad| {
                let pad = ready.part(
                    layer,
                    |like| like.pad.with_youngs_modulus(gelpad.youngs_modulus_kpa),
                    |_| Pad::new(&models.gelpad, &gelpad, &view),
                );
                (Arc::new(pad), Arc::default())
            },
        );
        let markers = sensor.markers.filter(|_| policy != EffectPolicy::Without(Effect::Markers));
        let in_plane = ready.part(
            |of| (of.gelpad, of.markers.is_some()),
            |like| like.in_plane.clone(),
            |_| {
                let shows = markers.is_some() || flow || sensor.pins.is_some();
                shows.then(|| pad.in_plane(&sensor.gelpad, sensor.window_mm(), &view)).flatten().map(Arc::new)
            },
        );

        let shader = ready.part(
            |of| (rest_surface(of), calibration(of), of.illumination()),
            |like| Arc::clone(&like.shader),
            |(.., light)| {
                let (table, relief) = (sensor.calibration.as_deref(), relief.as_deref().cloned());
                Arc::new(Shader::new(&models.optics, table, &light, &view, relief))
            },
        );
        let lamps = ready.part(
            |of| &of.lamps,
            |like| like.lamps.clone(),
            |lamps| (!lamps.is_empty()).then(|| Arc::new(lamps::Shader::new(lamps, &view))),
        );
        let noise = ready.part(
            |of| (of.background.grain_size_mm(), of.lamps.is_empty()),
            |like| like.noise.clone(),
            |_| match &sensor.background {
                Background::Rendered(look) if sensor.lamps.is_empty() => Some(Arc::new(look.noise(&in_image))),
                // The picture is the camera's own, or the lamps'.
                Background::Rendered(_) | Background::Photograph(_) => None,
            },
        );
        let rendered = match (&sensor.background, &noise) {
            (Background::Rendered(look), Some(noise)) => Some((look, &**noise)),
            _ => None,
        };
        let look = || match &sensor.pins {
            Some(pins) => {
                let color = match &sensor.background {
                    Background::Rendered(look) => look.color,
                    Background::Photograph(_) => [0.0; 3],
                };
                // A policy that leaves markers out leaves pins out, too.
                let shown = policy != EffectPolicy::Without(Effect::Markers);
                let at_mm = if shown { pins.at_mm.clone() } else { Vec::new() };
                Look::Pins(Pins { at_mm, ..pins.clone() }, color)
            }
            None => {
                let phong = models.optics.phong().copied().unwrap_or_default();
                let background = match rendered {
                    Some((look, noise)) => SkinPicture::Rendered(look, noise),
                    None => SkinPicture::Photograph(sensor.background()),
                };
                Look::Skin(SkinLight { phong, light: sensor.illumination(), background, in_image })
            }
        };
        let curved = ready.part(
            |of| (layer(of), &of.background, of.pins.is_none().then(|| of.illumination())),
            |like| like.curved.clone(),
            |_| {
                let (camera, margin_px) = (sensor.projection(), pad.window(0.0).margin_px);
                let curve = |shape| Curved::new(shape, camera, view, margin_px, look());
                sensor.shape.clone().map(curve).map(Arc::new)
            },
        );

        let camera = |untouched: &dyn Fn() -> Light| {
            // Where LEDs are at infinity, only presses show how thick the pad is; they alone show how it darkens.
            let near = matches!(models.optics, optics::Model::Led(_));
            ready.part(
                |of| {
                    let thickness_mm = if near { of.gelpad.thickness_mm } else { 0.0 };
                    let light = Illumination { darkening: 0.0, thickness_mm, ..of.illumination() };
                    (rest_surface(of), calibration(of), light, &of.background, of.markers, of.camera)
                },
                |like| Arc::clone(&like.camera),
                |_| {
                    let print =
                        markers.and_then(|markers| Some(markers.print.positions(&markers.pattern?, None, &view)));
                    let (photograph, resting) = (sensor.has_photograph(), sensor.camera.under(policy));
                    Arc::new(Camera::new(&in_image, untouched(), photograph, resting, print))
                },
            )
        };
        let (background, camera) = match &curved {
            None => {
                let glow = |led: &Led| (led.azimuth_deg, led.intensity, led.color);
                let background = ready.part(
                    |of| (&of.background, &of.lamps, of.leds.iter().map(glow).collect::<Vec<_>>()),
                    |like| Arc::clone(&like.background),
                    |_| {
                        let (leds, field_of_view_mm) = (&sensor.leds, sensor.field_of_view_mm);
                        let render =
                            |(look, noise)| BackgroundImage::rendered_with(noise, look, leds, field_of_view_mm, &view);
                        rendered.map(render).map_or_else(|| sensor.background(), Arc::new)
                    },
                );
                let camera = camera(&|| shader.untouched(&background));
                (background, camera)
            }
            Some(curved) => {
                let camera = camera(&|| curved.untouched());
                let Image { width, height, rgb, .. } = &camera.untouched;
                (Arc::new(BackgroundImage::new(*width, *height, rgb.clone())), camera)
            }
        };
        Self {
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
            sensor,
        }
    }
}

/// A sensor to be made ready, and a simulator to share with: one of the same models, policy, view and [`geometry`].
struct Sharing<'a> {
    sensor: &'a Sensor,
    like: Option<&'a Simulator>,
}

impl<'a> Sharing<'a> {
    /// A part of the simulator: the `known` one where what it is made `from` is the same in both sensors, else a new one.
    fn part<K: PartialEq, T>(
        &self,
        from: impl Fn(&'a Sensor) -> K,
        known: impl FnOnce(&'a Simulator) -> T,
        make: impl FnOnce(K) -> T,
    ) -> T {
        let key = from(self.sensor);
        match self.like.filter(|like| from(&like.sensor) == key) {
            Some(like) => known(like),
            None => make(key),
        }
    }
}

/// What every part is made from, beside the view.
fn geometry(of: &Sensor) -> impl PartialEq {
    (of.field_of_view_mm, &of.shape, &of.lens, &of.pins)
}

/// The pad but for its Young's modulus, on which displacements do not depend.
fn layer(of: &Sensor) -> Material {
    Material { youngs_modulus_kpa: 0.0, ..of.gelpad }
}

fn rest_surface(of: &Sensor) -> (Option<&RestSurface>, Option<&Grain>) {
    (of.rest_surface.as_ref(), of.coating.as_ref())
}

/// The same if it is the same table: it is large.
fn calibration(of: &Sensor) -> Option<*const Table> {
    of.calibration.as_ref().map(Arc::as_ptr)
}
