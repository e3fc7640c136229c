//! Shades a part of the view, row by row.

use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::depth::raster::SAMPLES;
use crate::gelpad::subpixel::{SampledPixel, Subpixel};

use super::{LedShader, Lights, RestReflection};
use crate::optics::background::BackgroundImage;
use crate::optics::coarse::CoarseValues;
use crate::optics::led::Normals;
use crate::optics::light_pattern::place_along;
use crate::optics::near_light::field::{LightField, LightVectors};
use crate::optics::normals::fill_row_normals;
use crate::optics::residual::{self, Planes};

/// A surface to shade, and how.
pub(super) struct ShadedSurface<'a> {
    /// Its shape, mm towards the camera, on the grid of [`crate::gelpad::Contact::surface`].
    pub shape: &'a Grid<f32>,
    /// Its displacement by the press, mm, on the same grid.
    pub displacement: &'a Grid<f32>,
    /// Light of each LED at rest, to be subtracted; empty if nothing is.
    pub at_rest: &'a [RestReflection],
    /// Light of the residual at rest, to be subtracted.
    pub residual_at_rest: Option<&'a Planes>,
    /// Its shape between pixel centres, where light is averaged; all of it lies within the part that is shaded.
    pub subpixel: Option<&'a Subpixel>,
    /// The pad's relief, which `subpixel` does not contain.
    pub relief: Option<&'a Grid<f32>>,
    /// The fraction of each distant LED that is seen; empty where all of it is.
    pub visible_shares: &'a [Option<CoarseValues>],
    /// The light of near LEDs; `None` if they are at infinity.
    pub field: Option<&'a LightField>,
    /// Fraction of the light that is lost per mm of displacement.
    pub darkening_per_mm: f32,
}

/// Shades a part of the view.
pub(super) fn shade_region(shader: &LedShader, lit: &ShadedSurface<'_>, rest: &BackgroundImage, region: Rect) -> Light {
    let planes = std::array::from_fn(|_| Vec::with_capacity(region.area()));
    let mut light = Light { region, planes };
    let columns = (region.x0..region.x1).map(|x| place_along(shader.view.resolution_px[0], x)).collect();
    let mut rows = RowScratch { columns, ..RowScratch::default() };
    simd_dispatch(
        #[inline(always)]
        || {
            for row in 0..region.height() {
                shade_row(shader, lit, rest, &mut light, row, &mut rows);
            }
        },
    );
    light
}

/// Computes the light of each LED on a surface at rest.
pub(super) fn compute_rest_reflection(shader: &LedShader, shape: &Grid<f32>, is_flat: bool) -> Vec<RestReflection> {
    let [width, height] = shader.view.resolution_px;
    let mut normals = Normals::default();
    let field = shader.field_at_rest(shape);
    let is_uniform = is_flat && field.is_none();
    let mut led_row = LedRow::default();
    let mut all: Vec<RestReflection> = Vec::new();
    for number in 0..shader.lights.count() {
        let mut map = if is_uniform { Grid::new(1, 1) } else { Grid::new(width, height) };
        for y in 0..map.height {
            let part = Rect { x0: 0, y0: y, x1: map.width, y1: y + 1 };
            simd_dispatch(
                #[inline(always)]
                || {
                    fill_row_normals(shader.view.mm_per_px, shape, part, 0, &mut normals);
                    led_row.fill(field.as_ref(), number, y, 0, part.width());
                },
            );
            led_row.reflect(shader, number, &normals, map.row_mut(y));
        }
        all.push(if is_uniform { RestReflection::Uniform(map.at(0, 0)) } else { RestReflection::Map(map) });
    }
    all
}

/// Computes the light of the residual on a surface at rest, for each channel and pixel of the view; `None` if there is
/// no residual.
pub(super) fn compute_rest_residual(shader: &LedShader, shape: &Grid<f32>) -> Option<Planes> {
    let residual = shader.residual.as_ref()?;
    let [width, height] = shader.view.resolution_px;
    let (mut normals, mut planes, no_displacement) = (Normals::default(), Planes::default(), vec![0.0; width]);
    let columns: Vec<f32> = (0..width).map(|x| place_along(width, x)).collect();
    residual::reset_planes(&mut planes, width * height);
    for y in 0..height {
        let part = Rect { x0: 0, y0: y, x1: width, y1: y + 1 };
        simd_dispatch(
            #[inline(always)]
            || {
                fill_row_normals(shader.view.mm_per_px, shape, part, 0, &mut normals);
                let row = residual::slice_planes(&mut planes, y * width..(y + 1) * width);
                residual.along_row(place_along(height, y)).add(&normals, &no_displacement, &columns, row);
            },
        );
    }
    Some(planes)
}

/// Scratch memory for a row.
#[derive(Default)]
struct RowScratch {
    /// What the LEDs add to each channel, if that is scaled by the background.
    added: [Vec<f32>; 3],
    normals: Normals,
    gain: Vec<f32>,
    /// Light of the residual.
    residual: Planes,
    subpixel: SubpixelScratch,
    share: Vec<f32>,
    /// Values on a coarser grid.
    line: Vec<f32>,
    led: LedRow,
    /// Where the pixels are along every row, -1 to 1 over the view.
    columns: Vec<f32>,
}

/// An LED's light along a row.
#[derive(Default)]
struct LedRow {
    /// If the LED is near.
    vectors: LightVectors,
    line: Vec<f32>,
}

impl LedRow {
    /// Fills in the light of LED number `led` at the pixels of row `y` of the view, from column `x0` on.
    #[inline(always)]
    fn fill(&mut self, field: Option<&LightField>, led: usize, y: usize, x0: usize, width: usize) {
        if let Some(field) = field {
            field.fill_row(led, y, x0, &mut self.line, &mut self.vectors, width);
        }
    }

    /// Computes the light of LED number `led`, at intensity 1, along a row of normals, and writes it to `gain`.
    fn reflect(&self, shader: &LedShader, led: usize, normals: &Normals, gain: &mut [f32]) {
        match &shader.lights {
            Lights::Distant(leds) => leds[led].reflect(&shader.phong, normals, gain),
            Lights::Near(_) => self.vectors.reflect(&shader.phong, normals, gain),
        }
    }
}

/// Scratch memory for the samples of a row's pixels.
#[derive(Default)]
struct SubpixelScratch {
    normals: Normals,
    led: LedRow,
    /// Displacement of their pixels, mm.
    displacement_mm: Vec<f32>,
    /// Where their pixels are along the row, -1 to 1 over the view; empty if the residual is the same everywhere.
    columns: Vec<f32>,
    /// Light of an LED at each sample, and that of the residual.
    gain: Vec<f32>,
    residual: Planes,
}

/// Returns the heights along row `row` of a part of the view.
#[inline(always)]
fn row_heights(shape: &Grid<f32>, part: Rect, row: usize) -> &[f32] {
    &shape.row(part.y0 + row + SURFACE_BORDER)[part.x0 + SURFACE_BORDER..][..part.width()]
}

impl SubpixelScratch {
    /// Fills in the samples of these pixels in row `y` of the view. `heights_mm` are the displacements along the row of
    /// `part`.
    #[inline(always)]
    fn fill_samples(
        &mut self,
        lit: &ShadedSurface<'_>,
        pixels: &[SampledPixel],
        part: Rect,
        y: usize,
        heights_mm: &[f32],
    ) {
        let Self { normals: Normals { x: nx, y: ny, z: nz }, displacement_mm, .. } = self;
        let mut planes = [nx, ny, nz, displacement_mm].map(|plane| {
            plane.resize(pixels.len() * SAMPLES, 0.0);
            plane.as_chunks_mut::<SAMPLES>().0
        });
        let [nx, ny, nz, displacement_mm] = &mut planes;
        if let Some(subpixel) = lit.subpixel {
            for (at, pixel) in pixels.iter().enumerate() {
                let x = pixel.x as usize;
                [nx[at], ny[at]] = subpixel.sample_slopes(pixel);
                // The displacement changes little within a pixel, unlike the slope.
                displacement_mm[at] = [heights_mm[x - part.x0]; SAMPLES];
                if let Some(relief) = lit.relief {
                    let [along, down] = subpixel.relief_slope(pixel, y, relief);
                    nx[at].iter_mut().for_each(|fall| *fall += along);
                    ny[at].iter_mut().for_each(|fall| *fall += down);
                }
            }
        }
        // One long loop, which the compiler turns into vectors.
        let [nx, ny, nz] = [nx, ny, nz].map(|plane| plane.as_flattened_mut());
        for ((x, y), z) in nx.iter_mut().zip(ny).zip(nz) {
            let inverse = 1.0 / (*x * *x + *y * *y + 1.0).sqrt();
            (*x, *y, *z) = (*x * inverse, *y * inverse, -inverse);
        }
    }
}

/// Moves values at pixel centres towards the means over the pixels, by the weight of each pixel.
#[inline(always)]
fn average_samples(values: &mut [f32], samples: &[f32], pixels: &[SampledPixel], x0: usize) {
    for (pixel, samples) in pixels.iter().zip(samples.as_chunks::<SAMPLES>().0) {
        let [a, b, c, d, e, f, g, h] = samples;
        let mean = (((a + b) + (c + d)) + ((e + f) + (g + h))) * (1.0 / SAMPLES as f32);
        let value = &mut values[pixel.x as usize - x0];
        *value += pixel.weight * (mean - *value);
    }
}

/// Shades row `row` of the light's region. Every loop runs along the row with nothing but arithmetic in it, so that the
/// compiler computes eight pixels in each step.
#[inline(always)]
fn shade_row(
    shader: &LedShader,
    lit: &ShadedSurface<'_>,
    rest: &BackgroundImage,
    light: &mut Light,
    row: usize,
    rows: &mut RowScratch,
) {
    let region = light.region;
    let (y, width) = (region.y0 + row, region.width());
    let heights_mm = row_heights(lit.displacement, region, row);
    let RowScratch { added, normals, gain, residual, subpixel, share, line, led: led_row, columns } = rows;
    let pixels = lit.subpixel.map_or(&[][..], |subpixel| subpixel.row(y));
    subpixel.fill_samples(lit, pixels, region, y, heights_mm);
    fill_row_normals(shader.view.mm_per_px, lit.shape, region, row, normals);

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
    // Light from all around gives no highlight.
    let reflected_bounce = shader.phong.diffuse as f32;
    gain.resize(width, 0.0);
    share.resize(width, 1.0);
    let (gain, share) = (&mut gain[..width], &mut share[..width]);
    let (columns, place) = (&columns[..width], place_along(shader.view.resolution_px[1], y));
    for number in 0..shader.lights.count() {
        let color = shader.lights.color(number);
        led_row.fill(lit.field, number, y, region.x0, width);
        led_row.reflect(shader, number, normals, gain);
        if !pixels.is_empty() {
            let SubpixelScratch { normals, led: sample_row, gain: samples, .. } = &mut *subpixel;
            samples.resize(pixels.len() * SAMPLES, 0.0);
            if lit.field.is_some() {
                // Light varies little within a pixel, unlike the normal.
                let columns = pixels.iter().map(|pixel| pixel.x as usize - region.x0);
                sample_row.vectors.repeat_from(&led_row.vectors, columns, SAMPLES);
            }
            sample_row.reflect(shader, number, normals, samples);
            average_samples(gain, samples, pixels, region.x0);
        }
        if let Some(Some(visible)) = lit.visible_shares.get(number) {
            visible.interpolate_row(y, region.x0, line, share);
            for (gain, share) in gain.iter_mut().zip(&*share) {
                *gain *= share;
            }
        }
        let flat = match lit.at_rest.get(number) {
            None => 0.0,
            Some(RestReflection::Uniform(flat)) => *flat,
            Some(RestReflection::Map(map)) => {
                for (gain, flat) in gain.iter_mut().zip(&map.row(y)[region.x0..region.x1]) {
                    *gain -= flat;
                }
                0.0
            }
        };
        color.add_to_row(gain, flat, columns, place, [&mut *red, &mut *green, &mut *blue]);
    }
    for (channel, out) in [&mut *red, &mut *green, &mut *blue].into_iter().enumerate() {
        if let Some(bounced) = lit.field.and_then(|field| field.bounced(channel)) {
            bounced.interpolate_row(y, region.x0, line, share);
            out.iter_mut().zip(&*share).for_each(|(out, light)| *out += reflected_bounce * light);
        }
    }
    if let Some(prepared) = &shader.residual {
        residual::reset_planes(residual, width);
        let at_row = prepared.along_row(place);
        at_row.add(normals, heights_mm, columns, residual::slice_planes(residual, 0..width));
        let SubpixelScratch { normals: sample_normals, displacement_mm, columns: places, residual: samples, .. } =
            &mut *subpixel;
        residual::reset_planes(samples, displacement_mm.len());
        places.clear();
        if prepared.varies {
            places.extend(pixels.iter().flat_map(|pixel| [columns[pixel.x as usize - region.x0]; SAMPLES]));
        }
        at_row.add(sample_normals, displacement_mm, places, residual::slice_planes(samples, 0..displacement_mm.len()));
        for (channel, (plane, out)) in residual.iter_mut().zip([red, green, blue]).enumerate() {
            average_samples(plane, &samples[channel], pixels, region.x0);
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
