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
use super::lamp::Normals;
use super::phong::set_normals;
use super::shadow::casting::Casting;
use super::visible::{BOUND, Threshold};
use crate::depth::Camera;
use crate::effects::{Effect, Ledger, Need};
use crate::gelpad::elastic::Resolution;
use crate::gelpad::{Contact, SURFACE_BORDER};
use crate::grid::{Grid, Rect};
use crate::simd::wide;

pub mod response;

use response::{DEGREES, FLATTEST_CASTER, Inputs, OUTPUTS, Response, TERMS};

/// Parameters of the measured light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Calibrated {
    /// Grid on which shadows are found, and how height and place turn the colours; in between both are interpolated.
    pub resolution: Resolution,
}

impl Default for Calibrated {
    fn default() -> Self {
        Self { resolution: Resolution::Quarter }
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
    coarse: Coarse,
    camera: Camera,
    threshold: Threshold,
    /// The constant terms at rest, red, green and blue, at the pixels of [`Coarse::view`].
    at_rest: [Grid<f32>; 3],
}

impl Shader {
    /// Prepares what `table` says for a view; without one, nothing changes the picture.
    pub fn new(parameters: Calibrated, table: Option<&Table>, camera: &Camera) -> Self {
        let response = table.map_or_else(Response::default, |table| table.response.clone());
        let coarse = Coarse::new(parameters.resolution);
        let size = camera.resolution_px;
        let [width, height] = coarse.view(size);
        let mut at_rest = [(); 3].map(|()| Grid::new(width, height));
        let mut largest = vec![0.0_f32; OUTPUTS];
        let mut work = Work::default();
        for y in 0..height {
            let part = Rect { x0: 0, y0: y, x1: width, y1: y + 1 };
            work.set_inputs(&response, &Nodes { coarse, camera, surface: None, hidden: &[], part }, 0);
            wide(
                #[inline(always)]
                || response.coefficients(&work.inputs, &mut work.hidden, &mut work.outputs),
            );
            for (channel, grid) in at_rest.iter_mut().enumerate() {
                grid.row_mut(y).copy_from_slice(&work.outputs[channel * TERMS]);
            }
            for (largest, output) in largest.iter_mut().zip(&work.outputs) {
                *largest = output.iter().fold(*largest, |largest, value| largest.max(value.abs()));
            }
        }
        let threshold = threshold(&response, &largest);
        Self { response, coarse, camera: *camera, threshold, at_rest }
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
        let size = self.camera.resolution_px;
        let part = self.coarse.part(size, region);
        if part.is_empty() {
            return light;
        }
        let coefficients = self.coefficients(surface, shares, part);
        let mut rows = Rows::default();
        wide(
            #[inline(always)]
            || {
                for row in 0..region.height() {
                    self.shade_row(surface, &coefficients, &mut light, row, &mut rows);
                }
            },
        );
        light
    }

    /// The coefficients on a part of the coarse grid, the constant ones less those at rest.
    fn coefficients(&self, surface: &Grid<f32>, shares: &[Option<Values>], part: Rect) -> Vec<Values> {
        let mut planes = vec![Vec::with_capacity(part.area()); OUTPUTS];
        let nodes = Nodes { coarse: self.coarse, camera: &self.camera, surface: Some(surface), hidden: shares, part };
        let mut work = Work::default();
        for row in 0..part.height() {
            work.set_inputs(&self.response, &nodes, row);
            wide(
                #[inline(always)]
                || {
                    self.response.coefficients(&work.inputs, &mut work.hidden, &mut work.outputs);
                    for (channel, at_rest) in self.at_rest.iter().enumerate() {
                        let at_rest = &at_rest.row(part.y0 + row)[part.x0..part.x1];
                        for (value, rest) in work.outputs[channel * TERMS].iter_mut().zip(at_rest) {
                            *value -= rest;
                        }
                    }
                },
            );
            for (plane, output) in planes.iter_mut().zip(&work.outputs) {
                plane.extend_from_slice(output);
            }
        }
        planes.into_iter().map(|plane| self.coarse.values(self.camera.resolution_px, part, plane)).collect()
    }

    #[inline(always)]
    fn shade_row(&self, surface: &Grid<f32>, coefficients: &[Values], light: &mut Light, row: usize, rows: &mut Rows) {
        let region = light.region;
        let (y, width) = (region.y0 + row, region.width());
        let Rows { normals, terms, factor, line } = rows;
        set_normals(self.camera.mm_per_px, surface, region, row, normals);
        set_terms(normals, self.response.steepest, terms);
        factor.resize(width, 0.0);
        let factor = &mut factor[..width];
        for (channel, plane) in light.planes.iter_mut().enumerate() {
            let plane = &mut plane[row * width..][..width];
            for (m, values) in coefficients[channel * TERMS..][..TERMS].iter().enumerate() {
                values.row(y, region.x0, line, factor);
                if m == 0 {
                    plane.iter_mut().zip(&*factor).for_each(|(value, factor)| *value += factor);
                } else {
                    let term = &terms[m][..width];
                    for x in 0..width {
                        plane[x] += term[x] * factor[x];
                    }
                }
            }
        }
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

/// Pixels of the coarse grid: where they are and what is there.
struct Nodes<'a> {
    coarse: Coarse,
    camera: &'a Camera,
    /// A flat pad without one.
    surface: Option<&'a Grid<f32>>,
    /// Shares of the sky that are seen, on `part`.
    hidden: &'a [Option<Values>],
    part: Rect,
}

/// Memory for one row of the coarse grid.
struct Work {
    inputs: Inputs,
    hidden: Vec<Vec<f32>>,
    outputs: Vec<Vec<f32>>,
}

impl Default for Work {
    fn default() -> Self {
        Self { inputs: Default::default(), hidden: Vec::new(), outputs: vec![Vec::new(); OUTPUTS] }
    }
}

impl Work {
    /// What the coefficients of row `row` of the part depend on.
    fn set_inputs(&mut self, response: &Response, nodes: &Nodes<'_>, row: usize) {
        let Nodes { coarse, camera, surface, hidden, part } = nodes;
        let size = camera.resolution_px;
        let [heights, xs, ys, sky @ ..] = &mut self.inputs;
        for plane in [&mut *heights, &mut *xs, &mut *ys] {
            plane.clear();
        }
        let [low, high] = response.heights_mm;
        for column in part.x0..part.x1 {
            let [x, y] = coarse.place(size, [column, part.y0 + row]);
            let [x_mm, y_mm] = camera.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            xs.push(x_mm as f32 / response.place_mm);
            ys.push(y_mm as f32 / response.place_mm);
            let border = SURFACE_BORDER as isize;
            let w = surface.map_or(0.0, |surface| surface.at((x + border) as usize, (y + border) as usize));
            heights.push(w.clamp(low, high) / response.height_mm);
        }
        for (k, plane) in sky.iter_mut().enumerate() {
            plane.clear();
            match hidden.get(k) {
                Some(Some(seen)) => plane.extend(seen.values.row(row).iter().map(|share| 1.0 - share)),
                _ => plane.resize(part.width(), 0.0),
            }
        }
    }
}

/// What is kept of one row of the view on the way.
#[derive(Default)]
struct Rows {
    normals: Normals,
    terms: [Vec<f32>; TERMS],
    factor: Vec<f32>,
    /// Values on the coarse grid.
    line: Vec<f32>,
}

/// The terms of a row's normals, no steeper than `steepest`.
#[inline(always)]
fn set_terms(normals: &Normals, steepest: f32, terms: &mut [Vec<f32>; TERMS]) {
    let width = normals.x.len();
    for plane in terms.iter_mut() {
        plane.resize(width, 0.0);
    }
    let [_, y1, x1, yy, xy, xx, yyy, xyy, xxy, xxx, y4, xy3, x2y2, x3y, x4] =
        terms.each_mut().map(|plane| &mut plane[..width]);
    let (nx, ny) = (&normals.x[..width], &normals.y[..width]);
    for i in 0..width {
        let length = (nx[i] * nx[i] + ny[i] * ny[i]).sqrt();
        let kept = if length > steepest { steepest / length } else { 1.0 };
        let (x, y) = (nx[i] * kept, ny[i] * kept);
        let all = response::terms(x, y);
        (y1[i], x1[i], yy[i], xy[i], xx[i]) = (all[1], all[2], all[3], all[4], all[5]);
        (yyy[i], xyy[i], xxy[i], xxx[i]) = (all[6], all[7], all[8], all[9]);
        (y4[i], xy3[i], x2y2[i], x3y[i], x4[i]) = (all[10], all[11], all[12], all[13], all[14]);
    }
}
