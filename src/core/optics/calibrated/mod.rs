//! Light as it was measured on a real sensor, by `gelsim calibrate`.
//!
//! The photograph of the untouched pad, plus what the measured [`Response`] (or Taxim's table) says that the press
//! changes. Valid for the sensor that was measured. Beyond the slopes and depths that it was fitted to the light goes on
//! by LEDs fitted to the same presses ([`Beyond`]); with a table that has none, deeper and steeper presses are taken for as
//! deep and as steep ones.

use serde::{Deserialize, Serialize};

use super::background::BackgroundImage;
use super::coarse::{Coarse, Values};
use super::led::Normals;
use super::normals::set_normals;
use super::shadow::casting::Casting;
use super::visible::{BOUND, Threshold};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;

pub mod beyond;
mod kernel;
mod nodes;
pub mod response;
pub mod taxim;

use beyond::{Beyond, Continuation, Range, Run};
use kernel::Kernel;
use nodes::{Between, Memory, Nodes};
use response::{DEGREES, FLATTEST_CASTER, Response, TERMS};
use taxim::{Lookup, Taxim};

/// Parameters of the measured light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    /// How colour follows from the surface.
    pub colors: Colors,
    /// What it follows beyond the presses that the colours were fitted to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond: Option<Beyond>,
}

/// How colour follows from the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Colors {
    /// Fitted by `gelsim calibrate`.
    Response(Response),
    /// Taken over from a calibration of Taxim's.
    Taxim(Taxim),
}

impl Table {
    /// The newest version that is known.
    pub const NEWEST: u32 = 2;
    /// The oldest, which has nothing beyond the presses.
    pub const OLDEST: u32 = 1;

    /// One that this gelsim writes, of the oldest version that holds it.
    pub fn new(colors: Colors, contact_over_disc: f64) -> Self {
        let generator = env!("CARGO_PKG_VERSION").to_owned();
        Self { calibration_version: Self::OLDEST, generator, contact_over_disc, colors, beyond: None }
    }

    /// The same with what the light follows beyond the presses.
    pub fn with_beyond(self, beyond: Beyond) -> Self {
        Self { calibration_version: Self::NEWEST, beyond: Some(beyond), ..self }
    }

    /// How far the presses went that it was fitted to; `None` where that is not known.
    pub fn range(&self) -> Option<Range> {
        match &self.colors {
            Colors::Response(response) => Some(Range::from(response)),
            Colors::Taxim(_) => None,
        }
    }
}

/// The model made ready for one view.
pub struct Shader {
    view: View,
    threshold: Threshold,
    colors: Ready,
    /// How far the presses went that the table was fitted to, if that is known.
    range: Option<Range>,
}

/// Colours made ready for one view.
enum Ready {
    Response(Box<Network>),
    Taxim(Box<Lookup>),
}

impl Shader {
    /// Prepares what `table` says for a view; without one, nothing changes the picture.
    pub fn new(parameters: Calibrated, table: Option<&Table>, view: &View) -> Self {
        let network = |response: Response, beyond: Option<&Beyond>| {
            let (network, largest) = Network::new(response, beyond, parameters, view);
            (threshold(&network.response, &largest), Ready::Response(Box::new(network)))
        };
        let (threshold, colors) = match table.map(|table| (&table.colors, &table.beyond)) {
            Some((Colors::Response(response), beyond)) => network(response.clone(), beyond.as_ref()),
            Some((Colors::Taxim(taxim), _)) => {
                let lookup = Lookup::new(taxim, view.resolution_px);
                let slope = lookup.unseen_slope(255.0 * BOUND) * std::f64::consts::FRAC_1_SQRT_2;
                (Threshold { slope: slope as f32, height_mm: f32::MAX }, Ready::Taxim(Box::new(lookup)))
            }
            None => network(Response::default(), None),
        };
        Self { view: *view, threshold, colors, range: table.and_then(Table::range) }
    }

    /// Share of the pixels in contact that are steeper or deeper than the presses that the table was fitted to; 0 where that
    /// is not known.
    pub(crate) fn share_beyond(&self, contact: &Contact) -> f64 {
        self.range.map_or(0.0, |range| range.share_beyond(contact, &self.view))
    }

    /// The light from the pad where it differs from that of the untouched one, whose picture is `rest`.
    pub fn shade(&self, contact: &Contact, rest: &BackgroundImage, effects: &mut EffectLog) -> Light {
        let (surface, everywhere) = (&contact.surface, effects.everywhere());
        let bent = effects.timed(Effect::Shading, || self.threshold.region(contact, &self.view));
        let if_bent =
            |why| if bent.is_empty() { Requirement::Unneeded("the surface is flat") } else { Requirement::Needed(why) };
        let shades = effects.enable(Effect::Shading, if_bent("the surface is not flat"));
        effects.enable(Effect::Grain, Requirement::Absent("the measured light holds it"));
        effects.enable(Effect::Darkening, Requirement::Absent("the measured light holds it"));
        let any = everywhere || !bent.is_empty();
        let shadows = effects.timed(Effect::Shadows, || match &self.colors {
            Ready::Response(network) if any => {
                Casting::new(network.coarse, surface, &self.view, everywhere, |pitch, _| {
                    crate::optics::calibrated::response::sky(pitch)
                })
            }
            _ => None,
        });
        let need = match (&self.colors, &shadows) {
            (Ready::Taxim(_), _) => Requirement::Absent("Taxim's colours are without shadows"),
            (_, None) if !bent.is_empty() => Requirement::Unneeded("no slope hides any of the sky"),
            _ => if_bent("a slope hides some of the sky"),
        };
        let shadows = if effects.enable(Effect::Shadows, need) { shadows } else { None };
        if !shades {
            return Light::default();
        }
        let (region, hidden) = effects.timed(Effect::Shadows, || {
            let region = match &shadows {
                _ if everywhere => Rect::whole(rest.width, rest.height),
                None => bent,
                Some(shadows) => shadows.reach(bent, &self.view),
            };
            let hidden = shadows.map(|shadows| shadows.shares(&self.view, region));
            (region, hidden.unwrap_or_default())
        });
        effects.timed(Effect::Shading, || {
            let mut light = rest.light(region);
            match &self.colors {
                _ if region.is_empty() => {}
                Ready::Response(network) => {
                    let beyond = network.beyond.as_ref().filter(|_| {
                        everywhere || self.range.is_some_and(|range| !range.holds(contact, region, &self.view))
                    });
                    network.add(&mut light, surface, &hidden, beyond.map(|beyond| (beyond, rest)), &self.view);
                }
                Ready::Taxim(lookup) => add_taxim(lookup, &mut light, surface, &self.view),
            }
            light
        })
    }
}

/// A response made ready for one view.
struct Network {
    response: Response,
    kernel: Kernel,
    coarse: Coarse,
    /// The constant terms at rest, red, green and blue, at all nodes.
    at_rest: [Grid<f32>; 3],
    beyond: Option<Continuation>,
}

impl Network {
    /// Prepares a response, and says how large each of its coefficients is at rest, anywhere in view.
    fn new(response: Response, beyond: Option<&Beyond>, parameters: Calibrated, view: &View) -> (Self, Vec<f32>) {
        let kernel = Kernel::new(&response);
        let coarse = Coarse::spaced(parameters.spacing_mm, view.mm_per_px);
        let [width, height] = coarse.size(view.resolution_px);
        let nodes = Nodes { coarse, view, part: Rect::whole(width, height) };
        let outputs = nodes.outputs(&response, &kernel, None, &[]);
        let size = |plane: &Vec<f32>| plane.iter().fold(0.0, |largest: f32, value| largest.max(value.abs()));
        let largest = outputs.iter().map(size).collect();
        let at_rest = std::array::from_fn(|channel| Grid { width, height, data: outputs[channel * TERMS].clone() });
        let beyond = beyond.map(|beyond| Continuation::new(beyond, Range::from(&response)));
        (Self { response, kernel, coarse, at_rest, beyond }, largest)
    }

    /// Adds to the untouched pad's light what the surface changes; `shares` are those of the sky that are seen, `beyond` is
    /// for surfaces that leave the response's range.
    fn add(
        &self,
        light: &mut Light,
        surface: &Grid<f32>,
        shares: &[Option<Values>],
        beyond: Option<(&Continuation, &BackgroundImage)>,
        view: &View,
    ) {
        let region = light.region;
        let nodes = Nodes::around(region, self.coarse, view);
        let mut outputs = nodes.outputs(&self.response, &self.kernel, Some(surface), shares);
        for (channel, at_rest) in self.at_rest.iter().enumerate() {
            let at_rest = at_rest.crop(nodes.part);
            for (value, rest) in outputs[channel * TERMS].iter_mut().zip(&at_rest.data) {
                *value -= rest;
            }
        }
        let between = Between::new(&nodes, outputs, self.response.steepest);
        let (mut normals, mut memory, mut run) = (Vec::new(), Memory::default(), Run::default());
        simd_dispatch(
            #[inline(always)]
            || {
                let mut row = 0;
                while row < region.height() {
                    let band = between.band(region, row);
                    normals.resize_with(band.len(), Normals::default);
                    for (row, normals) in band.clone().zip(&mut normals) {
                        set_normals(view.mm_per_px, surface, region, row, normals);
                    }
                    between.add_band(light, band.clone(), &normals, &mut memory);
                    if let Some((beyond, rest)) = beyond {
                        for (row, normals) in band.clone().zip(&normals) {
                            beyond.add_row(light, row, normals, surface, rest, shares, &mut run);
                        }
                    }
                    row = band.end;
                }
            },
        );
    }
}

/// Adds what Taxim's colours say.
fn add_taxim(lookup: &Lookup, light: &mut Light, surface: &Grid<f32>, view: &View) {
    let Light { region, planes } = light;
    let width = region.width();
    let per_step = view.mm_per_px.map(|pitch| (0.5 / pitch) as f32);
    let mut scratch = taxim::Scratch::default();
    let (mut slopes, mut change) = ([(); 2].map(|()| vec![0.0; width]), [(); 3].map(|()| vec![0.0; width]));
    simd_dispatch(
        #[inline(always)]
        || {
            for row in 0..region.height() {
                let y = region.y0 + row;
                let window = |dx: usize, dy: usize| &surface.row(y + dy)[region.x0 + dx..][..width];
                let across = [(window(2, 1), window(0, 1)), (window(1, 2), window(1, 0))];
                for ((slopes, (after, before)), per_step) in slopes.iter_mut().zip(across).zip(per_step) {
                    for ((slope, after), before) in slopes.iter_mut().zip(after).zip(before) {
                        *slope = (after - before) * per_step;
                    }
                }
                let [right, down] = slopes.each_ref().map(Vec::as_slice);
                lookup.row(y, region.x0, [right, down], &mut scratch, change.each_mut().map(Vec::as_mut_slice));
                for (plane, change) in planes.iter_mut().zip(&change) {
                    for (value, change) in plane[row * width..][..width].iter_mut().zip(change) {
                        *value += change * (1.0 / 255.0);
                    }
                }
            }
        },
    );
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
