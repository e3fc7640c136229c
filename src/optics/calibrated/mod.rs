//! Light as it was measured on a real sensor, by `gelsim calibrate`.
//!
//! The photograph of the untouched pad, plus what the measured [`Response`] (or Taxim's table) says that the press
//! changes. Valid for the sensor that was measured; deeper and steeper presses than it was fitted on are taken for as
//! deep and as steep ones.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Light;
use super::background::Reference;
use super::coarse::{Coarse, Values};
use super::phong::set_normals;
use super::shadow::casting::Casting;
use super::visible::{BOUND, Threshold};
use crate::depth::Camera;
use crate::effects::{Effect, Ledger, Need};
use crate::gelpad::Contact;
use crate::grid::{Grid, Rect};
use crate::simd::wide;

mod kernel;
mod nodes;
pub mod response;
pub mod taxim;

use kernel::Kernel;
use nodes::{Between, Nodes, Rows};
use response::{DEGREES, FLATTEST_CASTER, Response, TERMS};

/// Parameters of the measured light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Calibrated {
    /// Distance of the pixels at which is found how height, place and shadows turn the colours, mm, 0 to 10; at most every
    /// eighth one. In between that is interpolated; with 0 it is found at every pixel.
    pub spacing_mm: f64,
}

impl Default for Calibrated {
    fn default() -> Self {
        Self { spacing_mm: 0.25 }
    }
}

/// A file of `gelsim calibrate`: what was measured on a sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Version of the file's form.
    pub calibration_version: u32,
    /// The gelsim that wrote it.
    pub generator: String,
    /// Radius of the contact over that of the disc which people see and annotate.
    pub contact_over_disc: f64,
    /// The colours.
    pub response: Response,
}

impl Table {
    /// The newest version that is known.
    pub const NEWEST: u32 = 1;

    /// Reads a file's bytes.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        /// What every version has.
        #[derive(Deserialize)]
        struct Header {
            calibration_version: u32,
            generator: String,
        }
        let found = serde_json::from_slice::<Self>(bytes).map_err(|error| match serde_json::from_slice(bytes) {
            Ok(Header { calibration_version, generator }) if calibration_version > Self::NEWEST => {
                format!("gelsim {generator} wrote it, which is newer than this one")
            }
            _ => format!("no table of `gelsim calibrate`: {error}"),
        })?;
        if found.calibration_version != Self::NEWEST {
            return Err(format!("version {} of the file is not known", found.calibration_version));
        }
        if !(0.1..=10.0).contains(&found.contact_over_disc) {
            return Err(format!("contact_over_disc is {}", found.contact_over_disc));
        }
        found.response.validate()?;
        Ok(found)
    }
}

/// The model made ready for one view.
pub struct Shader {
    response: Response,
    kernel: Kernel,
    coarse: Coarse,
    camera: Camera,
    threshold: Threshold,
    /// The constant terms at rest, red, green and blue, at all nodes.
    at_rest: [Grid<f32>; 3],
}

impl Shader {
    /// Prepares what `table` says for a view; without one, nothing changes the picture.
    pub fn new(parameters: Calibrated, table: Option<&Table>, camera: &Camera) -> Self {
        let response = table.map_or_else(Response::default, |table| table.response.clone());
        let kernel = Kernel::new(&response);
        let coarse = Coarse::spaced(parameters.spacing_mm, camera.mm_per_px);
        let [width, height] = coarse.size(camera.resolution_px);
        let nodes = Nodes { coarse, camera, part: Rect::whole(width, height) };
        let outputs = nodes.outputs(&response, &kernel, None, &[]);
        let largest: Vec<f32> =
            outputs.iter().map(|plane| plane.iter().fold(0.0, |largest, value| value.abs().max(largest))).collect();
        let at_rest = std::array::from_fn(|channel| Grid { width, height, data: outputs[channel * TERMS].clone() });
        Self { threshold: threshold(&response, &largest), response, kernel, coarse, camera: *camera, at_rest }
    }

    /// The light from the pad where it differs from that of the untouched one, whose picture is `rest`.
    pub fn shade(&self, contact: &Contact, rest: &Reference, effects: &mut Ledger) -> Light {
        let (surface, everywhere) = (&contact.surface, effects.everywhere());
        let bent = effects.timed(Effect::Shading, || self.threshold.region(contact, &self.camera));
        let if_bent = |why| if bent.is_empty() { Need::Idle("the surface is flat") } else { Need::Called(why) };
        let shades = effects.calls(Effect::Shading, if_bent("the surface is not flat"));
        effects.calls(Effect::Grain, Need::Absent("the measured light holds it"));
        effects.calls(Effect::Darkening, Need::Absent("the measured light holds it"));
        let shadows = effects.timed(Effect::Shadows, || {
            let any = everywhere || !bent.is_empty();
            any.then(|| Casting::new(self.coarse, surface, &self.camera, everywhere, Response::sky)).flatten()
        });
        let need = match &shadows {
            None if !bent.is_empty() => Need::Idle("no slope hides any of the sky"),
            _ => if_bent("a slope hides some of the sky"),
        };
        let shadows = if effects.calls(Effect::Shadows, need) { shadows } else { None };
        if !shades {
            return Light::default();
        }
        let (region, hidden) = effects.timed(Effect::Shadows, || {
            let region = match &shadows {
                _ if everywhere => Rect::whole(rest.width, rest.height),
                None => bent,
                Some(shadows) => shadows.reach(bent, &self.camera),
            };
            let hidden = shadows.map(|shadows| shadows.shares(&self.camera, region));
            (region, hidden.unwrap_or_default())
        });
        effects.timed(Effect::Shading, || self.light(surface, &hidden, rest, region))
    }

    /// The light in a part of the view.
    fn light(&self, surface: &Grid<f32>, shares: &[Option<Values>], rest: &Reference, region: Rect) -> Light {
        let mut light = rest.light(region);
        if region.is_empty() {
            return light;
        }
        let nodes = Nodes::around(region, self.coarse, &self.camera);
        let mut outputs = nodes.outputs(&self.response, &self.kernel, Some(surface), shares);
        for (channel, at_rest) in self.at_rest.iter().enumerate() {
            let at_rest = at_rest.crop(nodes.part);
            for (value, rest) in outputs[channel * TERMS].iter_mut().zip(&at_rest.data) {
                *value -= rest;
            }
        }
        let between = Between::new(&nodes, outputs, self.response.steepest);
        let mut rows = Rows::default();
        wide(
            #[inline(always)]
            || {
                for row in 0..region.height() {
                    set_normals(self.camera.mm_per_px, surface, region, row, &mut rows.normals);
                    between.add_row(&mut light, row, &mut rows);
                }
            },
        );
        light
    }
}

/// Slope and displacement below which nothing is seen: together they change a channel by less than [`BOUND`].
/// `largest` is the size of each coefficient at rest, anywhere in view.
fn threshold(response: &Response, largest: &[f32]) -> Threshold {
    let steepness = response.steepness();
    let per_height = (0..3).map(|channel| steepness[channel * TERMS]).fold(1e-9, f64::max);
    let height = (0.5 * BOUND / per_height).min(1.0);
    let change = |slope: f64| {
        let of = |channel: usize| {
            let term = |m: usize| {
                let k = channel * TERMS + m;
                (f64::from(largest[k]) + steepness[k] * height) * libm::pow(slope, f64::from(DEGREES[m]))
            };
            (1..TERMS).map(term).sum()
        };
        (0..3).map(of).fold(0.0, f64::max)
    };
    let (mut low, mut high) = (0.0, 0.5);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if change(middle) <= 0.5 * BOUND { low = middle } else { high = middle }
    }
    // Slopes along x and y are compared one by one.
    let slope = low.min(FLATTEST_CASTER) * std::f64::consts::FRAC_1_SQRT_2;
    Threshold { slope: slope as f32, height_mm: height as f32 * response.height_mm }
}
