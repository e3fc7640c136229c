//! Prepares a sensor: computes what is the same in every press, or shares it with a simulator that has it already.

use std::sync::Arc;

use once_cell::race::OnceBox;

use crate::base::light::Light;
use crate::camera::pins::Pins;
use crate::camera::{Camera, Image};
use crate::curved::{CurvedGel, GelAppearance, SkinLight, SkinPicture};
use crate::depth::rest_surface::{self, Grain, RestSurface};
use crate::effects::{Effect, EffectPolicy};
use crate::fidelity::{Fidelity, Models};
use crate::gelpad::Pad;
use crate::gelpad::material::Material;
use crate::optics::background::BackgroundImage;
use crate::optics::calibrated::CalibrationTable;
use crate::optics::led::Led;
use crate::optics::near_light::bounce::Coat;
use crate::optics::{Illumination, Shader, lamps};
use crate::sensor::{Background, Sensor, SensorError};

use super::Simulator;

impl Simulator {
    /// Prepares a sensor at a fidelity level. This takes from a few milliseconds to a second.
    ///
    /// # Errors
    ///
    /// If the sensor cannot be simulated: see [`Sensor::check`]. Also if the level solves finite strain, and the sensor's
    /// gel has a shape.
    pub fn new(sensor: &Sensor, fidelity: Fidelity) -> Result<Self, SensorError> {
        sensor.check()?;
        let models = fidelity.models(sensor.light_source());
        if sensor.shape.is_some() && models.gelpad.strain_settings().is_some() {
            return Err(SensorError::FiniteStrainOnCurvedGel);
        }
        Ok(Self::with_models(sensor.clone(), models, EffectPolicy::default()))
    }

    /// Prepares a sensor with any models, and with a policy for the effects.
    ///
    /// An effect that the policy leaves out is missing in the background image, too. The sensor must have passed
    /// [`Sensor::check`].
    pub fn with_models(sensor: Sensor, models: Models, policy: EffectPolicy) -> Self {
        Self::prepare(sensor, models, policy, None)
    }

    /// Prepares another sensor with the models and the policy of this simulator.
    ///
    /// The result equals that of [`Simulator::with_models`]. What both sensors have in common (the pad's response, the
    /// background image, its light) is shared and not computed again.
    pub fn variant(&self, sensor: Sensor) -> Self {
        Self::prepare(sensor, self.models.clone(), self.policy, Some(self))
    }

    /// Makes every press compute how the pad's surface moves in its plane, with markers or without; see
    /// [`crate::impression::Impression::flow_mm`].
    pub fn with_flow(self) -> Self {
        let in_plane = self.in_plane.or_else(|| {
            let Sensor { gelpad, .. } = &self.sensor;
            self.pad.in_plane_response(gelpad, self.sensor.window_mm(), &self.view).map(Arc::new)
        });
        Self { wants_flow: true, in_plane, ..self }
    }

    /// Prepares `sensor`. Parts that are the same in it are taken from `donor`, a simulator with the same models and
    /// policy.
    fn prepare(sensor: Sensor, models: Models, policy: EffectPolicy, donor: Option<&Self>) -> Self {
        let view = sensor.view();
        // The view of a gel that is not flat is that of its charts; the image's own pixels have another size.
        let at_tip = sensor.shape.as_ref().and_then(|_| sensor.projection().view_at_tip());
        let in_image = at_tip.unwrap_or(view);
        let wants_flow = donor.is_some_and(|donor| donor.wants_flow);
        let donor = donor.filter(|donor| donor.view == view && geometry_key(&donor.sensor) == geometry_key(&sensor));
        let parts = PartSharing { sensor: &sensor, donor };

        let (drop_mm, relief) = parts.share_or_make(
            rest_surface_key,
            |donor| (donor.drop_mm.clone(), donor.relief.clone()),
            |(shape, coating)| {
                let drop_mm = shape.map(|shape| rest_surface::rest_drop_mm(shape, &view));
                let relief = match policy {
                    EffectPolicy::Without(Effect::Grain) => None,
                    EffectPolicy::Without(Effect::RestShape) => rest_surface::rest_relief(None, coating, &view),
                    _ => rest_surface::rest_relief(drop_mm.as_ref(), coating, &view),
                };
                (drop_mm.map(Arc::new), relief.map(Arc::new))
            },
        );
        let (pad, frame_pad) = parts.share_or_make(
            |of| of.gelpad,
            |donor| (Arc::clone(&donor.pad), Arc::clone(&donor.frame_pad)),
            |gelpad| {
                let pad = parts.share_or_make(
                    elastic_layer_key,
                    |donor| donor.pad.with_youngs_modulus(gelpad.youngs_modulus_kpa),
                    |_| Pad::new(&models.gelpad, &gelpad, &view),
                );
                (Arc::new(pad), Arc::default())
            },
        );
        let markers = sensor.markers.clone().filter(|_| policy != EffectPolicy::Without(Effect::Markers));
        let in_plane = parts.share_or_make(
            |of| (of.gelpad, of.markers.is_some()),
            |donor| donor.in_plane.clone(),
            |_| {
                let shows = markers.is_some() || wants_flow || sensor.pins.is_some();
                shows.then(|| pad.in_plane_response(&sensor.gelpad, sensor.window_mm(), &view)).flatten().map(Arc::new)
            },
        );

        let shader = parts.share_or_make(
            |of| (rest_surface_key(of), calibration_key(of), of.illumination()),
            |donor| Arc::clone(&donor.shader),
            |(.., light)| {
                let (table, relief) = (sensor.calibration.as_deref(), relief.as_deref().cloned());
                let window = light.window.filter(|_| policy != EffectPolicy::Without(Effect::Mirror));
                let light = Illumination { window, ..light };
                Arc::new(Shader::new(&models.optics, table, &light, &view, relief))
            },
        );
        let lamps = parts.share_or_make(
            |of| &of.lamps,
            |donor| donor.lamps.clone(),
            |lamps| (!lamps.is_empty()).then(|| Arc::new(lamps::LampShader::new(lamps, &view))),
        );
        let noise = parts.share_or_make(
            |of| (of.background.grain_size_mm(), of.lamps.is_empty()),
            |donor| donor.grain_noise.clone(),
            |_| match &sensor.background {
                Background::Rendered(look) if sensor.lamps.is_empty() => Some(Arc::new(look.grain_noise(&in_image))),
                // A photograph shows its own grain, and lamps give a picture without any.
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
                GelAppearance::Pins(Pins { at_mm, ..pins.clone() }, color)
            }
            None => {
                let phong = models.optics.phong().copied().unwrap_or_default();
                let background = match rendered {
                    Some((look, noise)) => SkinPicture::Rendered(look, noise),
                    None => SkinPicture::Photograph(sensor.background()),
                };
                GelAppearance::Skin(SkinLight { phong, light: sensor.illumination(), background, in_image })
            }
        };
        let curved = parts.share_or_make(
            |of| (elastic_layer_key(of), &of.background, of.pins.is_none().then(|| of.illumination())),
            |donor| donor.curved.clone(),
            |_| {
                let (camera, margin_px) = (sensor.projection(), pad.capture_window(0.0).margin_px);
                let curve = |shape| CurvedGel::new(shape, camera, view, margin_px, look());
                sensor.shape.clone().map(curve).map(Arc::new)
            },
        );

        let camera = |untouched: &dyn Fn() -> Light| {
            // The key leaves out what the untouched pad does not show, so that sensors that differ in it share a
            // camera: darkening, the thickness of the pad and the albedo of its coat.
            parts.share_or_make(
                |of| {
                    let light =
                        Illumination { darkening: 0.0, thickness_mm: 0.0, coat: Coat::default(), ..of.illumination() };
                    (rest_surface_key(of), calibration_key(of), light, &of.background, &of.markers, of.camera)
                },
                |donor| Arc::clone(&donor.camera),
                |_| {
                    let print =
                        markers.as_ref().and_then(|markers| Some(markers.print.at_rest(&markers.pattern?, &view)));
                    let (photograph, resting) = (sensor.has_photograph(), sensor.camera.with_policy(policy));
                    Arc::new(Camera::new(&in_image, untouched(), photograph, resting, print))
                },
            )
        };
        let (background, camera) = match &curved {
            None => {
                let glow = |led: &Led| (led.place().azimuth, led.intensity, led.color);
                let background = parts.share_or_make(
                    |of| (&of.background, &of.lamps, of.leds.iter().map(glow).collect::<Vec<_>>()),
                    |donor| Arc::clone(&donor.background),
                    |_| {
                        let (leds, field_of_view_mm) = (&sensor.leds, sensor.field_of_view_mm);
                        let render = |(look, noise)| {
                            BackgroundImage::render_with_noise(noise, look, leds, field_of_view_mm, &view)
                        };
                        rendered.map(render).map_or_else(|| sensor.background(), Arc::new)
                    },
                );
                let camera = camera(&|| shader.untouched_light(&background));
                (background, camera)
            }
            Some(curved) => {
                let camera = camera(&|| curved.untouched_light());
                let Image { width, height, rgb, .. } = &camera.untouched;
                (Arc::new(BackgroundImage::new(*width, *height, rgb.clone())), camera)
            }
        };
        Self {
            models,
            policy,
            view,
            light_error: OnceBox::new(),
            background,
            grain_noise: noise,
            drop_mm,
            relief,
            pad,
            frame_pad,
            markers,
            wants_flow,
            in_plane,
            shader,
            lamps,
            camera,
            curved,
            sensor,
        }
    }
}

/// A sensor to prepare, and a simulator to share with: one of the same models, policy, view and [`geometry_key`].
struct PartSharing<'a> {
    sensor: &'a Sensor,
    donor: Option<&'a Simulator>,
}

impl<'a> PartSharing<'a> {
    /// Returns a part of the simulator. If the key `from` is equal for both sensors, `known` takes the part from the
    /// donor; if not, `make` computes it.
    fn share_or_make<K: PartialEq, T>(
        &self,
        from: impl Fn(&'a Sensor) -> K,
        known: impl FnOnce(&'a Simulator) -> T,
        make: impl FnOnce(K) -> T,
    ) -> T {
        let key = from(self.sensor);
        match self.donor.filter(|donor| from(&donor.sensor) == key) {
            Some(donor) => known(donor),
            None => make(key),
        }
    }
}

/// Returns what every part depends on, besides the view.
fn geometry_key(of: &Sensor) -> impl PartialEq {
    (of.field_of_view_mm, &of.shape, &of.lens, &of.pins)
}

/// Returns the pad's material without Young's modulus, on which displacements do not depend.
fn elastic_layer_key(of: &Sensor) -> Material {
    Material { youngs_modulus_kpa: 0.0, ..of.gelpad }
}

/// Returns what the shape of the pad at rest depends on.
fn rest_surface_key(of: &Sensor) -> (Option<&RestSurface>, Option<&Grain>) {
    (of.rest_surface.as_ref(), of.coating.as_ref())
}

/// Returns the address of the calibration table: its contents are too large to be compared.
fn calibration_key(of: &Sensor) -> Option<*const CalibrationTable> {
    of.calibration.as_ref().map(Arc::as_ptr)
}
