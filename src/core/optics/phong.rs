//! LEDs with diffuse and specular reflection, over the picture of the untouched pad.
//!
//! Source: Phong (1975); constants and lights of Gomes, Wilson and Luo (2019). With N the surface normal, l the
//! direction to the LED, R = 2 (N.l) N - l and V = (0, 0, -1) towards the camera, an LED gives
//! k_d max(0, N.l) + k_s max(0, R.V)^alpha. The paper adds that to the background image; but a photograph of the
//! untouched pad already holds the light that a flat pad reflects. So the flat pad's own term is taken off, and an
//! untouched pad is the background exactly (`equation = "literal"` gives the paper's sum). How it darkens with
//! depth is ours: a share of the light that grows in proportion to the displacement.
//!
//! The light of LEDs is not even over a real pad: where the untouched pad is bright, a slope changes it more. A sensor whose
//! `stray_light` s is known has what its LEDs add scaled by what they gave the untouched pad, background - s, in each
//! channel; so LEDs that were fitted to one unit go with the background image of another.
//!
//! Valid for low relief without interreflection; light is added in display values, as in the paper.

use serde::{Deserialize, Serialize};

use super::background::BackgroundImage;
use super::coarse::Values;
use super::led::{Normals, PlacedLed, Row};
use super::led_shader::{Flat, Shader};
use super::residual::{self, Planes};
use crate::core::base::grid::Resolution;
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::light::Light;
use crate::core::base::simd::simd_dispatch;
use crate::core::base::view::SURFACE_BORDER;
use crate::core::depth::raster::SAMPLES;
use crate::core::gelpad::subpixel::{SampledPixel, Subpixel};

/// Parameters of Phong shading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Phong {
    /// k_a: share of the background image that is seen, 0 to 1. Not in the paper: 1.
    pub ambient: f64,
    /// k_d: diffuse reflection, 0 to 10. The paper's: 0.5.
    pub diffuse: f64,
    /// k_s: specular reflection, 0 to 10. The paper's: 0.15.
    pub specular: f64,
    /// alpha: exponent of the specular lobe, 0 to 1000. The paper's: 5.
    pub shininess: f64,
    /// Share of the light lost where the pad is pressed down to the shell, 0 to 1; the sensor's where it is left out. Not
    /// in the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub darkening: Option<f64>,
    /// What is added to the background.
    pub equation: Equation,
    /// Shadows that the surface casts on itself. Not in the paper.
    pub shadows: Shadows,
}

impl Default for Phong {
    fn default() -> Self {
        Self {
            ambient: 1.0,
            diffuse: 0.5,
            specular: 0.15,
            shininess: 5.0,
            darkening: None,
            equation: Equation::Relative,
            shadows: Shadows::Soft(Soft::default()),
        }
    }
}

/// What is added to the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Equation {
    /// Phong(N) - Phong(flat): an untouched pad is the background.
    Relative,
    /// Phong(N), as the paper writes it: an untouched pad is brighter than the background.
    Literal,
}

/// Shadows that the surface casts on itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Shadows {
    /// None.
    None,
    /// Of every LED, as soft as its angular size makes them.
    Soft(Soft),
}

/// Parameters of soft shadows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Soft {
    /// Grid on which shadows are found; in between they are interpolated.
    pub resolution: Resolution,
}

impl Default for Soft {
    fn default() -> Self {
        Self { resolution: Resolution::Half }
    }
}

/// Something to be computed with a power function that is chosen once, outside the loop over pixels.
pub(super) trait WithPower {
    type Output;
    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> Self::Output;
}

/// Runs `task` with x -> x^exponent for x >= 0. Small whole exponents are products; others go through `libm`.
pub(super) fn with_power<T: WithPower>(exponent: f64, task: T) -> T::Output {
    if exponent == 5.0 {
        task.run(
            #[inline(always)]
            |x| (x * x) * (x * x) * x,
        )
    } else if exponent == exponent.trunc() && (0.0..=64.0).contains(&exponent) {
        let exponent = exponent as u32;
        task.run(
            #[inline(always)]
            move |x| (0..exponent).fold(1.0, |product, _| product * x),
        )
    } else {
        let exponent = exponent as f32;
        task.run(move |x| libm::powf(x, exponent))
    }
}

/// What of a surface is shaded, and how.
pub(super) struct Lit<'a> {
    /// Its shape, mm towards the camera, on the grid of [`crate::core::gelpad::Contact::surface`].
    pub shape: &'a Grid<f32>,
    /// Its displacement by the press, mm, on the same grid.
    pub displacement: &'a Grid<f32>,
    /// What each LED gives at rest, to be taken off; empty if nothing is.
    pub at_rest: &'a [Flat],
    /// What the residual gives at rest, to be taken off.
    pub residual_at_rest: Option<&'a Planes>,
    /// Its shape between pixel centres, where light is averaged: all of it within the part that is shaded.
    pub subpixel: Option<&'a Subpixel>,
    /// The share of each LED that is seen; empty for all of it.
    pub visible: &'a [Option<Values>],
    /// Share of the light lost per mm of displacement.
    pub darkening_per_mm: f32,
}

/// Shades a part of the view.
pub(super) fn shade(shader: &Shader, lit: &Lit<'_>, rest: &BackgroundImage, region: Rect) -> Light {
    let planes = std::array::from_fn(|_| Vec::with_capacity(region.area()));
    let mut light = Light { region, planes };
    with_power(shader.phong.shininess, Picture { shader, lit, rest, light: &mut light });
    light
}

/// What each LED gives at a surface at rest.
pub(super) fn at_rest(shader: &Shader, shape: &Grid<f32>, is_flat: bool) -> Vec<Flat> {
    with_power(shader.phong.shininess, AtRest { shader, shape, is_flat })
}

/// What the residual gives at a surface at rest, for each channel and pixel of the view.
pub(super) fn residual_at_rest(shader: &Shader, shape: &Grid<f32>) -> Option<Planes> {
    let residual = shader.residual.as_ref()?;
    let [width, height] = shader.view.resolution_px;
    let (mut normals, mut planes, no_displacement) = (Normals::default(), Planes::default(), vec![0.0; width]);
    residual::clear(&mut planes, width * height);
    for y in 0..height {
        let part = Rect { x0: 0, y0: y, x1: width, y1: y + 1 };
        simd_dispatch(
            #[inline(always)]
            || {
                set_normals(shader.view.mm_per_px, shape, part, 0, &mut normals);
                let row = residual::part(&mut planes, y * width..(y + 1) * width);
                residual.add(&normals, &no_displacement, 1.0, row);
            },
        );
    }
    Some(planes)
}

impl Phong {
    /// What an LED of intensity 1 gives along a row of normals.
    pub fn reflect(&self, led: &PlacedLed, normals: &Normals, row: Row<'_>, gain: &mut [f32]) {
        with_power(self.shininess, AlongRow { phong: self, led, normals, row, gain });
    }
}

struct AlongRow<'a> {
    phong: &'a Phong,
    led: &'a PlacedLed,
    normals: &'a Normals,
    row: Row<'a>,
    gain: &'a mut [f32],
}

impl WithPower for AlongRow<'_> {
    type Output = ();

    fn run(self, power: impl Fn(f32) -> f32 + Copy) {
        let Self { phong: Phong { diffuse, specular, .. }, led, normals, row, gain } = self;
        simd_dispatch(
            #[inline(always)]
            || led.reflect(normals, row, *diffuse as f32, *specular as f32, power, gain),
        );
    }
}

struct AtRest<'a> {
    shader: &'a Shader,
    shape: &'a Grid<f32>,
    is_flat: bool,
}

impl WithPower for AtRest<'_> {
    type Output = Vec<Flat>;

    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> Vec<Flat> {
        let Self { shader, shape, is_flat } = self;
        let [width, height] = shader.view.resolution_px;
        let mut normals = Normals::default();
        let (diffuse, specular) = (shader.phong.diffuse as f32, shader.phong.specular as f32);
        let mut all: Vec<Flat> = Vec::new();
        for lamp in &shader.lamps {
            let even = is_flat && lamp.is_even();
            let mut map = if even { Grid::new(1, 1) } else { Grid::new(width, height) };
            for y in 0..map.height {
                let part = Rect { x0: 0, y0: y, x1: map.width, y1: y + 1 };
                simd_dispatch(
                    #[inline(always)]
                    || {
                        set_normals(shader.view.mm_per_px, shape, part, 0, &mut normals);
                        let row = shader.row(part, 0, centres(shape, part, 0));
                        lamp.reflect(&normals, row, diffuse, specular, power, map.row_mut(y));
                    },
                );
            }
            all.push(if even { Flat::Even(map.at(0, 0)) } else { Flat::Map(map) });
        }
        all
    }
}

struct Picture<'a> {
    shader: &'a Shader,
    lit: &'a Lit<'a>,
    rest: &'a BackgroundImage,
    light: &'a mut Light,
}

impl WithPower for Picture<'_> {
    type Output = ();

    fn run(self, power: impl Fn(f32) -> f32 + Copy) {
        let Self { shader, lit, rest, light } = self;
        let mut rows = Rows::default();
        simd_dispatch(
            #[inline(always)]
            || {
                for row in 0..light.region.height() {
                    shade_row(shader, lit, rest, light, row, &mut rows, power);
                }
            },
        );
    }
}

/// What is kept of one row on the way.
#[derive(Default)]
struct Rows {
    /// What the LEDs add to each channel, where that is scaled by the background.
    added: [Vec<f32>; 3],
    normals: Normals,
    gain: Vec<f32>,
    /// What the residual gives.
    residual: Planes,
    between: Between,
    share: Vec<f32>,
    /// Shares on a coarser grid.
    line: Vec<f32>,
}

/// What is kept of the samples of a row's pixels.
#[derive(Default)]
struct Between {
    normals: Normals,
    /// Where they are.
    x_mm: Vec<f32>,
    heights_mm: Vec<f32>,
    /// By how much their pixels are displaced.
    displaced_mm: Vec<f32>,
    /// What an LED gives at each, and what the residual does.
    gain: Vec<f32>,
    residual: Planes,
}

/// Heights along row `row` of a part of the view.
#[inline(always)]
fn centres(shape: &Grid<f32>, part: Rect, row: usize) -> &[f32] {
    &shape.row(part.y0 + row + SURFACE_BORDER)[part.x0 + SURFACE_BORDER..][..part.width()]
}

/// Normals along row `row` of a part of the view.
#[inline(always)]
pub(super) fn set_normals(mm_per_px: [f64; 2], shape: &Grid<f32>, part: Rect, row: usize, normals: &mut Normals) {
    let width = part.width();
    let window = |dx: usize, dy: usize| &shape.row(part.y0 + row + dy)[part.x0 + dx..][..width];
    let (left, right, above, below) = (window(0, 1), window(2, 1), window(1, 0), window(1, 2));
    let [per_slope_x, per_slope_y] = mm_per_px.map(|pitch| (0.5 / pitch) as f32);
    let Normals { x: nx, y: ny, z: nz } = normals;
    for plane in [&mut *nx, &mut *ny, &mut *nz] {
        plane.resize(width, 0.0);
    }
    let (nx, ny, nz) = (&mut nx[..width], &mut ny[..width], &mut nz[..width]);
    for x in 0..width {
        let fx = (left[x] - right[x]) * per_slope_x;
        let fy = (above[x] - below[x]) * per_slope_y;
        let inverse = 1.0 / (fx * fx + fy * fy + 1.0).sqrt();
        (nx[x], ny[x], nz[x]) = (fx * inverse, fy * inverse, -inverse);
    }
}

impl Between {
    /// Goes to the samples of these pixels, of a part of the view whose displacements along the row are `heights_mm`.
    #[inline(always)]
    fn go(&mut self, shader: &Shader, pixels: &[SampledPixel], part: Rect, heights_mm: &[f32]) {
        let Self { normals: Normals { x: nx, y: ny, z: nz }, x_mm, heights_mm: between_mm, displaced_mm, .. } = self;
        let mut planes = [nx, ny, nz, x_mm, between_mm, displaced_mm].map(|plane| {
            plane.resize(pixels.len() * SAMPLES, 0.0);
            plane.as_chunks_mut::<SAMPLES>().0
        });
        let [nx, ny, nz, x_mm, between_mm, displaced_mm] = &mut planes;
        for (at, pixel) in pixels.iter().enumerate() {
            let [across, down] = &pixel.falls;
            for k in 0..SAMPLES {
                let (fx, fy) = (across[k], down[k]);
                let inverse = 1.0 / (fx * fx + fy * fy + 1.0).sqrt();
                (nx[at][k], ny[at][k], nz[at][k]) = (fx * inverse, fy * inverse, -inverse);
            }
            x_mm[at] = [shader.columns_mm[pixel.x]; SAMPLES];
            between_mm[at] = pixel.heights_mm;
            // It changes little within the pixel beside its slope.
            displaced_mm[at] = [heights_mm[pixel.x - part.x0]; SAMPLES];
        }
    }
}

/// Takes values at pixels' centres to those on average over the pixels.
#[inline(always)]
fn average(values: &mut [f32], samples: &[f32], pixels: &[SampledPixel], x0: usize) {
    for (pixel, samples) in pixels.iter().zip(samples.as_chunks::<SAMPLES>().0) {
        let [a, b, c, d, e, f, g, h] = samples;
        let mean = (((a + b) + (c + d)) + ((e + f) + (g + h))) * (1.0 / SAMPLES as f32);
        let value = &mut values[pixel.x - x0];
        *value += pixel.weight * (mean - *value);
    }
}

/// Shades row `row` of the light's region. Every loop runs along the row with nothing but arithmetic in it, so that
/// the compiler makes eight pixels of each step.
#[inline(always)]
fn shade_row(
    shader: &Shader,
    lit: &Lit<'_>,
    rest: &BackgroundImage,
    light: &mut Light,
    row: usize,
    rows: &mut Rows,
    power: impl Fn(f32) -> f32 + Copy,
) {
    let region = light.region;
    let (y, width) = (region.y0 + row, region.width());
    let heights_mm = centres(lit.displacement, region, row);
    let Rows { added, normals, gain, residual, between, share, line } = rows;
    let pixels = lit.subpixel.map_or(&[][..], |subpixel| subpixel.row(y));
    between.go(shader, pixels, region, heights_mm);
    set_normals(shader.view.mm_per_px, lit.shape, region, row, normals);

    let ambient = shader.phong.ambient as f32 / 255.0;
    for (plane, rest_plane) in light.planes.iter_mut().zip(&rest.planes) {
        let rest_row = &rest_plane[y * rest.width + region.x0..][..width];
        plane.extend(rest_row.iter().map(|value| f32::from(*value) * ambient));
    }
    let mut planes = light.planes.each_mut().map(|plane| &mut plane[row * width..][..width]);
    let [red, green, blue] = match shader.stray_light {
        None => planes.each_mut().map(|plane| &mut **plane),
        Some(_) => added.each_mut().map(|added| {
            added.clear();
            added.resize(width, 0.0);
            &mut added[..]
        }),
    };
    let (diffuse, specular) = (shader.phong.diffuse as f32, shader.phong.specular as f32);
    gain.resize(width, 0.0);
    share.resize(width, 1.0);
    let (gain, share) = (&mut gain[..width], &mut share[..width]);
    let places = shader.row(region, row, centres(lit.shape, region, row));
    for (number, lamp) in shader.lamps.iter().enumerate() {
        lamp.reflect(normals, places, diffuse, specular, power, gain);
        if !pixels.is_empty() {
            let Between { normals, x_mm, heights_mm, gain: samples, .. } = &mut *between;
            samples.resize(pixels.len() * SAMPLES, 0.0);
            let places = Row { x_mm, y_mm: shader.row_mm(y), heights_mm };
            lamp.reflect(normals, places, diffuse, specular, power, samples);
            average(gain, samples, pixels, region.x0);
        }
        if let Some(Some(visible)) = lit.visible.get(number) {
            visible.row(y, region.x0, line, share);
            for (gain, share) in gain.iter_mut().zip(&*share) {
                *gain *= share;
            }
        }
        match lit.at_rest.get(number) {
            None => {}
            Some(Flat::Even(flat)) => gain.iter_mut().for_each(|gain| *gain -= flat),
            Some(Flat::Map(map)) => {
                for (gain, flat) in gain.iter_mut().zip(&map.row(y)[region.x0..region.x1]) {
                    *gain -= flat;
                }
            }
        }
        let color = lamp.color;
        for x in 0..width {
            red[x] += gain[x] * color[0];
            green[x] += gain[x] * color[1];
            blue[x] += gain[x] * color[2];
        }
    }
    if let Some(ready) = &shader.residual {
        residual::clear(residual, width);
        ready.add(normals, heights_mm, 1.0, residual::part(residual, 0..width));
        let Between { normals: normals_between, displaced_mm, residual: samples, .. } = &mut *between;
        residual::clear(samples, displaced_mm.len());
        ready.add(normals_between, displaced_mm, 1.0, residual::part(samples, 0..displaced_mm.len()));
        for (channel, (plane, out)) in residual.iter_mut().zip([red, green, blue]).enumerate() {
            average(plane, &samples[channel], pixels, region.x0);
            if let Some(at_rest) = lit.residual_at_rest {
                let at_rest = &at_rest[channel][y * shader.view.resolution_px[0] + region.x0..][..width];
                plane.iter_mut().zip(at_rest).for_each(|(value, at_rest)| *value -= at_rest);
            }
            out.iter_mut().zip(&*plane).for_each(|(out, value)| *out += value);
        }
    }
    if let Some(stray_light) = shader.stray_light {
        for (channel, plane) in planes.iter_mut().enumerate() {
            let rest_row = &rest.planes[channel][y * rest.width + region.x0..][..width];
            for ((value, added), rest) in plane.iter_mut().zip(&added[channel]).zip(rest_row) {
                *value += added * (f32::from(*rest) * (1.0 / 255.0) - stray_light[channel]).max(0.0);
            }
        }
    }
    let [red, green, blue] = planes;
    for x in 0..width {
        let kept = 1.0 - lit.darkening_per_mm * heights_mm[x];
        red[x] *= kept;
        green[x] *= kept;
        blue[x] *= kept;
    }
}
