//! The picture of the untouched pad: a photograph, or one that the sensor renders for itself.
//!
//! The rendered one is a plausible look, not a measurement: diffuse light, a glow that falls off from each LED's edge
//! of the image, a vignette, and the fine grain of the coating, which is the same in every sample. The model is ours.

use super::Light;
use crate::config::sensor::Sensor;
use crate::depth::Camera;
use crate::grid::{Grid, Rect};
use crate::rng::{Stage, stream};
use crate::scene::pose::sin_cos_deg;
use crate::simd::wide;

/// What the camera sees without contact, as 8-bit display values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reference {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major RGB.
    pub rgb: Vec<u8>,
    /// The same as one plane per channel.
    pub planes: [Vec<u8>; 3],
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
}

impl Reference {
    /// From row-major RGB.
    pub fn new(width: usize, height: usize, rgb: Vec<u8>) -> Self {
        let planes = std::array::from_fn(|k| rgb.iter().skip(k).step_by(3).copied().collect());
        let mut reference = Self { width, height, rgb, planes, saturated_px: 0 };
        reference.saturated_px = reference.saturated_in(Rect::whole(width, height));
        reference
    }

    /// A part of it as light.
    pub fn light(&self, region: Rect) -> Light {
        let planes = self.planes.each_ref().map(|plane| {
            let mut light = vec![0.0; region.area()];
            wide(
                #[inline(always)]
                || {
                    for (row, light) in light.chunks_exact_mut(region.width().max(1)).enumerate() {
                        let levels = &plane[(region.y0 + row) * self.width + region.x0..][..light.len()];
                        for (light, level) in light.iter_mut().zip(levels) {
                            *light = f32::from(*level) * (1.0 / 255.0);
                        }
                    }
                },
            );
            light
        });
        Light { region, planes }
    }

    /// Pixels of a part with a channel at full scale.
    #[inline(always)]
    pub fn saturated_in(&self, part: Rect) -> u64 {
        let [red, green, blue] = &self.planes;
        let mut count = 0;
        for y in part.y0..part.y1 {
            let row = y * self.width + part.x0..y * self.width + part.x1;
            let pixels = red[row.clone()].iter().zip(&green[row.clone()]).zip(&blue[row]);
            let saturated = pixels.map(|((red, green), blue)| u32::from((*red).max(*green).max(*blue) == 255));
            count += u64::from(saturated.sum::<u32>());
        }
        count
    }

    /// Renders the untouched pad of a sensor without a photograph.
    pub fn rendered(sensor: &Sensor, camera: &Camera) -> Self {
        let [width, height] = camera.resolution_px;
        let look = &sensor.rendered_background;
        let half = sensor.field_of_view_mm.map(|mm| mm / 2.0);
        let corner = half[0] * half[0] + half[1] * half[1];
        let grain = grain(width, height, look.grain_size_mm, camera, Stage::Grain);
        let mut rgb = Vec::with_capacity(width * height * 3);
        for j in 0..height {
            for i in 0..width {
                let x = (i as f64 + 0.5) * camera.mm_per_px[0] - half[0];
                let y = (j as f64 + 0.5) * camera.mm_per_px[1] - half[1];
                let mut color = look.color;
                for led in &sensor.led {
                    let (sin, cos) = sin_cos_deg(led.azimuth_deg);
                    let edge = half[0] * libm::fabs(cos) + half[1] * libm::fabs(sin);
                    let distance = edge - (x * cos + y * sin);
                    let glow = look.glow * led.intensity * libm::exp(-distance / look.glow_reach_mm);
                    for (value, share) in color.iter_mut().zip(led.color) {
                        // Light that is added to a bright pad saturates softly, and never beyond white.
                        *value += (glow * share).min(1.0) * (1.0 - *value);
                    }
                }
                let kept = 1.0 - look.vignette * (x * x + y * y) / corner;
                let grain = look.grain * f64::from(grain.at(i, j));
                rgb.extend(color.map(|value| quantise((value * kept + grain) as f32)));
            }
        }
        Self::new(width, height, rgb)
    }
}

/// 8-bit display value of a brightness, 1 = full scale, rounded to the nearest and cut to 0 .. 255; NaN is 0.
#[inline(always)]
pub fn quantise(brightness: f32) -> u8 {
    // From 2^23 on, floats are whole numbers: the sum is rounded, and its low byte is the value. Unlike a cast, which
    // has more cases to mind, this runs on eight pixels at a time.
    const WHOLE: f32 = 8_388_608.0;
    ((brightness * 255.0).clamp(0.0, 255.0) + WHOLE).to_bits() as u8
}

/// Noise of mean 0 and standard deviation 1 with a given grain size: bilinear between random knots, at two scales.
pub fn grain(width: usize, height: usize, size_mm: f64, camera: &Camera, stage: Stage) -> Grid<f32> {
    let mut grid = Grid::new(width, height);
    for octave in 0..2_u64 {
        let spacing = camera.mm_per_px.map(|pitch| f64::max(size_mm / pitch / f64::from(1 << octave), 1.0));
        let columns = (width as f64 / spacing[0]) as usize + 2;
        let rows = (height as f64 / spacing[1]) as usize + 2;
        let mut random = stream(0, stage, octave);
        let knots: Vec<f64> = (0..columns * rows).map(|_| random.normal()).collect();
        for j in 0..height {
            let (row, v) = knot((j as f64 + 0.5) / spacing[1]);
            for i in 0..width {
                let (column, u) = knot((i as f64 + 0.5) / spacing[0]);
                let at = |dx: usize, dy: usize| knots[(row + dy) * columns + column + dx];
                let above = at(0, 0) * (1.0 - u) + at(1, 0) * u;
                let below = at(0, 1) * (1.0 - u) + at(1, 1) * u;
                // Bilinear weights shrink the spread between knots: divided out, so that no lattice shows.
                let spread = libm::sqrt((u * u + (1.0 - u) * (1.0 - u)) * (v * v + (1.0 - v) * (1.0 - v)));
                let value = (above * (1.0 - v) + below * v) / spread;
                grid.row_mut(j)[i] += (value * std::f64::consts::FRAC_1_SQRT_2) as f32;
            }
        }
    }
    grid
}

fn knot(position: f64) -> (usize, f64) {
    let whole = libm::floor(position);
    (whole as usize, position - whole)
}
