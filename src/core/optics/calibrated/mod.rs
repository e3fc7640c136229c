//! Calibrated optics: light as `gelsim calibrate` measured it on a real sensor.
//!
//! The light is the photograph of the untouched pad, plus the change by the press that the fitted
//! [`CalibrationResponse`] (or Taxim's table) gives. Valid for the sensor that was measured. Outside the slopes and
//! depths that it was fitted to, the light goes on by LEDs fitted to the same presses ([`CalibrationExtrapolation`]). A
//! table without those takes deeper and steeper presses as the deepest and steepest that it was fitted to.

use serde::{Deserialize, Serialize};

use super::background::BackgroundImage;
use super::coarse::{CoarseGrid, CoarseValues};
use super::led::Normals;
use super::normals::fill_row_normals;
use super::shadow::casting::ShadowCasting;
use super::threshold::{INVISIBLE_CHANGE, Threshold};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;

pub mod extrapolation;
mod kernel;
mod nodes;
pub mod response;
pub mod taxim;

use extrapolation::{CalibrationExtrapolation, CalibrationRange, ExtrapolationScratch, PreparedExtrapolation};
use kernel::Kernel;
use nodes::{BandScratch, InterpolatedPolynomials, Nodes};
use response::{CalibrationResponse, FLATTEST_CASTER, TERM_DEGREES, TERMS};
use taxim::{TaximCalibration, TaximLookup};

/// Parameters of the calibrated optics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Calibrated {
    /// Distance of the pixels at which the colours' dependence on height, place and shadows is computed, mm, 0 to 10;
    /// at most every eighth pixel. In between it is interpolated; with 0 it is computed at every pixel.
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
pub struct CalibrationTable {
    /// Version of the file format.
    pub calibration_version: u32,
    /// The version of gelsim that wrote it.
    pub generator: String,
    /// Radius of the contact over that of the disc which people see and annotate.
    pub contact_over_disc: f64,
    /// How colour follows from the surface.
    pub colors: CalibrationColors,
    /// How the light goes on outside the range of the presses; `None` if the table does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond: Option<CalibrationExtrapolation>,
}

/// How colour follows from the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationColors {
    /// Fitted by `gelsim calibrate`.
    Response(CalibrationResponse),
    /// Imported from a calibration of Taxim's.
    Taxim(TaximCalibration),
}

impl CalibrationTable {
    /// The newest version that this gelsim reads.
    pub const NEWEST: u32 = 2;
    /// The oldest version, which does not say how the light goes on outside the range of the presses.
    pub const OLDEST: u32 = 1;

    /// Makes a table as this gelsim writes it, in the oldest version that holds it.
    pub fn new(colors: CalibrationColors, contact_over_disc: f64) -> Self {
        let generator = env!("CARGO_PKG_VERSION").to_owned();
        Self { calibration_version: Self::OLDEST, generator, contact_over_disc, colors, beyond: None }
    }

    /// Adds how the light goes on outside the range of the presses, and makes it a table of the newest version.
    pub fn with_extrapolation(self, extrapolation: CalibrationExtrapolation) -> Self {
        Self { calibration_version: Self::NEWEST, beyond: Some(extrapolation), ..self }
    }

    /// Returns the range of the presses that it was fitted to; `None` where that is not known.
    pub fn range(&self) -> Option<CalibrationRange> {
        match &self.colors {
            CalibrationColors::Response(response) => Some(CalibrationRange::from(response)),
            CalibrationColors::Taxim(_) => None,
        }
    }
}

/// Calibrated optics prepared for one view.
pub struct CalibratedShader {
    view: View,
    threshold: Threshold,
    colors: PreparedColors,
    /// The range of the presses that the table was fitted to, if it is known.
    range: Option<CalibrationRange>,
}

/// Colours prepared for one view.
enum PreparedColors {
    Response(Box<ResponseNetwork>),
    Taxim(Box<TaximLookup>),
}

impl CalibratedShader {
    /// Prepares the optics of `table` for a view; without a table, no press changes the picture.
    pub fn new(parameters: Calibrated, table: Option<&CalibrationTable>, view: &View) -> Self {
        let network = |response: CalibrationResponse, extrapolation: Option<&CalibrationExtrapolation>| {
            let (network, largest) = ResponseNetwork::new(response, extrapolation, parameters, view);
            (response_threshold(&network.response, &largest), PreparedColors::Response(Box::new(network)))
        };
        let (threshold, colors) = match table.map(|table| (&table.colors, &table.beyond)) {
            Some((CalibrationColors::Response(response), extrapolation)) => {
                network(response.clone(), extrapolation.as_ref())
            }
            Some((CalibrationColors::Taxim(taxim), _)) => {
                let lookup = TaximLookup::new(taxim, view.resolution_px);
                let slope = lookup.unseen_slope(255.0 * INVISIBLE_CHANGE) * std::f64::consts::FRAC_1_SQRT_2;
                (Threshold { slope: slope as f32, height_mm: f32::MAX }, PreparedColors::Taxim(Box::new(lookup)))
            }
            None => network(CalibrationResponse::default(), None),
        };
        Self { view: *view, threshold, colors, range: table.and_then(CalibrationTable::range) }
    }

    /// Returns the fraction of the pixels in contact that are steeper or deeper than the presses that the table was
    /// fitted to; 0 where that is not known.
    pub(crate) fn extrapolated_fraction(&self, contact: &Contact) -> f64 {
        self.range.map_or(0.0, |range| range.outside_fraction(contact, &self.view))
    }

    /// Computes the light from the pad where it differs from that of the untouched pad, whose picture is `rest`.
    pub fn shade(&self, contact: &Contact, rest: &BackgroundImage, effects: &mut EffectLog) -> Light {
        let (surface, everywhere) = (&contact.surface, effects.runs_everywhere());
        let bent = effects.run_timed(Effect::Shading, || self.threshold.visible_region(contact, &self.view));
        let if_bent =
            |why| if bent.is_empty() { Requirement::Unneeded("the surface is flat") } else { Requirement::Needed(why) };
        let shades = effects.enable(Effect::Shading, if_bent("the surface is not flat"));
        for effect in [Effect::Grain, Effect::Mirror, Effect::Bounce, Effect::Darkening] {
            effects.enable(effect, Requirement::Absent("the measured light holds it"));
        }
        let any = everywhere || !bent.is_empty();
        let shadows = effects.run_timed(Effect::Shadows, || match &self.colors {
            PreparedColors::Response(network) if any => {
                ShadowCasting::new(network.coarse, surface, &self.view, everywhere, |pixel_mm, _| {
                    crate::optics::calibrated::response::sky_casters(pixel_mm)
                })
            }
            _ => None,
        });
        let need = match (&self.colors, &shadows) {
            (PreparedColors::Taxim(_), _) => Requirement::Absent("Taxim's colours are without shadows"),
            (_, None) if !bent.is_empty() => Requirement::Unneeded("no slope hides any of the sky"),
            _ => if_bent("a slope hides some of the sky"),
        };
        let shadows = if effects.enable(Effect::Shadows, need) { shadows } else { None };
        if !shades {
            return Light::default();
        }
        let (region, hidden) = effects.run_timed(Effect::Shadows, || {
            let region = match &shadows {
                _ if everywhere => Rect::whole(rest.width, rest.height),
                None => bent,
                Some(shadows) => shadows.shadowed_region(bent, &self.view),
            };
            let hidden = shadows.map(|shadows| shadows.compute_visible_shares(&self.view, region));
            (region, hidden.unwrap_or_default())
        });
        effects.run_timed(Effect::Shading, || {
            let mut light = rest.light(region);
            match &self.colors {
                _ if region.is_empty() => {}
                PreparedColors::Response(network) => {
                    let extrapolation = network.extrapolation.as_ref().filter(|_| {
                        everywhere
                            || self.range.is_some_and(|range| !range.contains_surface(contact, region, &self.view))
                    });
                    network.add_change(
                        &mut light,
                        surface,
                        &hidden,
                        extrapolation.map(|extrapolation| (extrapolation, rest)),
                        &self.view,
                    );
                }
                PreparedColors::Taxim(lookup) => add_taxim_change(lookup, &mut light, surface, &self.view),
            }
            light
        })
    }
}

/// A response prepared for one view.
struct ResponseNetwork {
    response: CalibrationResponse,
    kernel: Kernel,
    coarse: CoarseGrid,
    /// The constant terms of red, green and blue of a flat pad, at all nodes.
    at_rest: [Grid<f32>; 3],
    extrapolation: Option<PreparedExtrapolation>,
}

impl ResponseNetwork {
    /// Prepares a response. Also returns how large each of its coefficients becomes on a flat pad, anywhere in view.
    fn new(
        response: CalibrationResponse,
        extrapolation: Option<&CalibrationExtrapolation>,
        parameters: Calibrated,
        view: &View,
    ) -> (Self, Vec<f32>) {
        let kernel = Kernel::new(&response);
        let coarse = CoarseGrid::with_spacing(parameters.spacing_mm, view.mm_per_px);
        let [width, height] = coarse.subsampled_size(view.resolution_px);
        let nodes = Nodes { coarse, view, part: Rect::whole(width, height) };
        let outputs = nodes.evaluate_network(&response, &kernel, None, &[]);
        let size = |plane: &Vec<f32>| plane.iter().fold(0.0, |largest: f32, value| largest.max(value.abs()));
        let largest = outputs.iter().map(size).collect();
        let at_rest = std::array::from_fn(|channel| Grid { width, height, data: outputs[channel * TERMS].clone() });
        let extrapolation = extrapolation
            .map(|extrapolation| PreparedExtrapolation::new(extrapolation, CalibrationRange::from(&response)));
        (Self { response, kernel, coarse, at_rest, extrapolation }, largest)
    }

    /// Adds what the surface changes to the untouched pad's light. `shares` are the fractions of each sector of the sky
    /// that are seen; `extrapolation` is for surfaces that leave the response's range.
    fn add_change(
        &self,
        light: &mut Light,
        surface: &Grid<f32>,
        shares: &[Option<CoarseValues>],
        extrapolation: Option<(&PreparedExtrapolation, &BackgroundImage)>,
        view: &View,
    ) {
        let region = light.region;
        let nodes = Nodes::around(region, self.coarse, view);
        let mut outputs = nodes.evaluate_network(&self.response, &self.kernel, Some(surface), shares);
        // Without the constant terms of a flat pad, so that such a pad gives exactly the untouched picture.
        for (channel, at_rest) in self.at_rest.iter().enumerate() {
            let at_rest = at_rest.crop(nodes.part);
            for (value, rest) in outputs[channel * TERMS].iter_mut().zip(&at_rest.data) {
                *value -= rest;
            }
        }
        let polynomials = InterpolatedPolynomials::new(&nodes, outputs, self.response.steepest);
        let (mut normals, mut memory, mut run) = (Vec::new(), BandScratch::default(), ExtrapolationScratch::default());
        simd_dispatch(
            #[inline(always)]
            || {
                let mut row = 0;
                while row < region.height() {
                    let band = polynomials.band_from(region, row);
                    normals.resize_with(band.len(), Normals::default);
                    for (row, normals) in band.clone().zip(&mut normals) {
                        fill_row_normals(view.mm_per_px, surface, region, row, normals);
                    }
                    polynomials.add_band(light, band.clone(), &normals, &mut memory);
                    if let Some((extrapolation, rest)) = extrapolation {
                        for (row, normals) in band.clone().zip(&normals) {
                            extrapolation.add_row(light, row, normals, surface, rest, shares, &mut run);
                        }
                    }
                    row = band.end;
                }
            },
        );
    }
}

/// Adds what the surface changes by Taxim's colours.
fn add_taxim_change(lookup: &TaximLookup, light: &mut Light, surface: &Grid<f32>, view: &View) {
    let Light { region, planes } = light;
    let width = region.width();
    let per_step = view.mm_per_px.map(|pixel_mm| (0.5 / pixel_mm) as f32);
    let mut scratch = taxim::LookupScratch::default();
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
                lookup.compute_row_change(
                    y,
                    region.x0,
                    [right, down],
                    &mut scratch,
                    change.each_mut().map(Vec::as_mut_slice),
                );
                for (plane, change) in planes.iter_mut().zip(&change) {
                    for (value, change) in plane[row * width..][..width].iter_mut().zip(change) {
                        *value += change * (1.0 / 255.0);
                    }
                }
            }
        },
    );
}

/// Finds the slope and the displacement below which nothing is seen: together they change a channel by less than
/// [`INVISIBLE_CHANGE`]. `largest` is how large each coefficient becomes on a flat pad, anywhere in view.
fn response_threshold(response: &CalibrationResponse, largest: &[f32]) -> Threshold {
    let steepness = response.steepness();
    let per_height = (0..3).map(|channel| steepness[channel * TERMS]).fold(1e-9, f64::max);
    let height = (0.5 * INVISIBLE_CHANGE / per_height).min(1.0);
    let change = |slope: f64| {
        let of = |channel: usize| {
            let term = |m: usize| {
                let k = channel * TERMS + m;
                (f64::from(largest[k]) + steepness[k] * height) * libm::pow(slope, f64::from(TERM_DEGREES[m]))
            };
            (1..TERMS).map(term).sum()
        };
        (0..3).map(of).fold(0.0, f64::max)
    };
    let (mut low, mut high) = (0.0, 0.5);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if change(middle) <= 0.5 * INVISIBLE_CHANGE { low = middle } else { high = middle }
    }
    // Slopes along x and y are compared one by one, and may both be as large as this.
    let slope = low.min(FLATTEST_CASTER) * std::f64::consts::FRAC_1_SQRT_2;
    Threshold { slope: slope as f32, height_mm: height as f32 * response.height_mm }
}
