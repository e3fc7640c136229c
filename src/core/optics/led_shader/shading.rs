//! Shades a part of the view, row by row.

use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::depth::raster::SAMPLES;
use crate::gelpad::subpixel::{SampledPixel, Subpixel};

use super::{Flat, Shader};
use crate::optics::background::BackgroundImage;
use crate::optics::coarse::Values;
use crate::optics::led::{Normals, Row};
use crate::optics::normals::set_normals;
use crate::optics::phong::{WithPower, with_power};
use crate::optics::residual::{self, Planes};

/// What of a surface is shaded, and how.
pub(super) struct Lit<'a> {
    /// Its shape, mm towards the camera, on the grid of [`crate::gelpad::Contact::surface`].
    pub shape: &'a Grid<f32>,
    /// Its displacement by the press, mm, on the same grid.
    pub displacement: &'a Grid<f32>,
    /// What each LED gives at rest, to be taken off; empty if nothing is.
    pub at_rest: &'a [Flat],
    /// What the residual gives at rest, to be taken off.
    pub residual_at_rest: Option<&'a Planes>,
    /// Its shape between pixel centres, where light is averaged: all of it within the part that is shaded.
    pub subpixel: Option<&'a Subpixel>,
    /// What the pad's relief adds to that.
    pub relief: Option<&'a Grid<f32>>,
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

impl Between {
    /// Goes to the samples of these pixels in row `y` of the view, of a part of it whose displacements along the row are
    /// `heights_mm`.
    #[inline(always)]
    fn go(
        &mut self,
        shader: &Shader,
        lit: &Lit<'_>,
        pixels: &[SampledPixel],
        part: Rect,
        y: usize,
        heights_mm: &[f32],
    ) {
        let Self { normals: Normals { x: nx, y: ny, z: nz }, x_mm, heights_mm: between_mm, displaced_mm, .. } = self;
        let mut planes = [nx, ny, nz, x_mm, between_mm, displaced_mm].map(|plane| {
            plane.resize(pixels.len() * SAMPLES, 0.0);
            plane.as_chunks_mut::<SAMPLES>().0
        });
        let [nx, ny, nz, x_mm, between_mm, displaced_mm] = &mut planes;
        if let Some(subpixel) = lit.subpixel {
            for (at, pixel) in pixels.iter().enumerate() {
                let x = pixel.x as usize;
                [nx[at], ny[at]] = subpixel.falls(pixel);
                x_mm[at] = [shader.columns_mm[x]; SAMPLES];
                between_mm[at] = subpixel.heights_mm(pixel);
                // It changes little within the pixel beside its slope.
                displaced_mm[at] = [heights_mm[x - part.x0]; SAMPLES];
                if let Some(relief) = lit.relief {
                    let ([along, down], mm) = subpixel.of_relief(pixel, y, relief);
                    nx[at].iter_mut().for_each(|fall| *fall += along);
                    ny[at].iter_mut().for_each(|fall| *fall += down);
                    between_mm[at].iter_mut().for_each(|height| *height += mm);
                }
            }
        }
        // In one long loop, of which the compiler makes vectors.
        let [nx, ny, nz] = [nx, ny, nz].map(|plane| plane.as_flattened_mut());
        for ((x, y), z) in nx.iter_mut().zip(ny).zip(nz) {
            let inverse = 1.0 / (*x * *x + *y * *y + 1.0).sqrt();
            (*x, *y, *z) = (*x * inverse, *y * inverse, -inverse);
        }
    }
}

/// Takes values at pixels' centres to those on average over the pixels.
#[inline(always)]
fn average(values: &mut [f32], samples: &[f32], pixels: &[SampledPixel], x0: usize) {
    for (pixel, samples) in pixels.iter().zip(samples.as_chunks::<SAMPLES>().0) {
        let [a, b, c, d, e, f, g, h] = samples;
        let mean = (((a + b) + (c + d)) + ((e + f) + (g + h))) * (1.0 / SAMPLES as f32);
        let value = &mut values[pixel.x as usize - x0];
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
    between.go(shader, lit, pixels, region, y, heights_mm);
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
        let flat = match lit.at_rest.get(number) {
            None => 0.0,
            Some(Flat::Even(flat)) => *flat,
            Some(Flat::Map(map)) => {
                for (gain, flat) in gain.iter_mut().zip(&map.row(y)[region.x0..region.x1]) {
                    *gain -= flat;
                }
                0.0
            }
        };
        let color = lamp.color;
        for x in 0..width {
            let gain = gain[x] - flat;
            red[x] += gain * color[0];
            green[x] += gain * color[1];
            blue[x] += gain * color[2];
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
    if lit.darkening_per_mm != 0.0 {
        let [red, green, blue] = planes;
        for x in 0..width {
            let kept = 1.0 - lit.darkening_per_mm * heights_mm[x];
            red[x] *= kept;
            green[x] *= kept;
            blue[x] *= kept;
        }
    }
}
