//! Phong's reflection of LEDs on a skin, with means over pixels within which the skin bends.

use super::{BentSkin, PressedSkin, SkinShader};
use crate::base::simd::simd_dispatch;
use crate::optics::led::phong_reflection;
use crate::optics::phong::{Phong, WithPower, run_with_power};

/// Samples within a pixel.
pub const LANES: usize = 8;

/// Pixels within which the skin bends that are shaded at once.
const PIXELS_PER_RUN: usize = 32;

/// Computes the light of the LEDs: red, green and blue of each pixel.
pub struct SkinReflectionTask<'a> {
    /// The lights.
    pub skin: &'a SkinShader,
    /// The skin that is lit.
    pub pressed: &'a PressedSkin<'a>,
}

impl SkinReflectionTask<'_> {
    /// Computes the light.
    pub fn run(self) -> [Vec<f32>; 3] {
        let region = self.pressed.region;
        let mut sums = [(); 3].map(|()| vec![0.0; region.area()]);
        simd_dispatch(
            #[inline(always)]
            || {
                let mut reflected = vec![0.0; region.width()];
                for row in 0..region.height() {
                    for number in 0..self.skin.led_light.len() {
                        self.add_row(number, row, &mut reflected, &mut sums);
                    }
                }
                self.average_bent_pixels(&mut sums);
                sums
            },
        )
    }

    /// Adds the light of an LED along a row of the part.
    #[inline(always)]
    fn add_row(&self, number: usize, row: usize, reflected: &mut [f32], sums: &mut [Vec<f32>; 3]) {
        let Self { skin, pressed: PressedSkin { region, normals, visible_shares, .. } } = self;
        let led = &skin.led_light[number];
        let (width, first) = (region.width(), skin.pixel_index(*region, row));
        let normals = normals.map(|plane| &plane[row * width..][..width]);
        let towards = led.directions.each_ref().map(|plane| &plane[first..][..width]);
        let to_camera = skin.to_camera.each_ref().map(|plane| &plane[first..][..width]);
        reflect_phong([normals, towards, to_camera], &skin.phong, reflected);
        let strength = &led.strength[first..][..width];
        match visible_shares.get(number).and_then(Option::as_ref) {
            None => reflected.iter_mut().zip(strength).for_each(|(reflected, strength)| *reflected *= strength),
            Some(share) => {
                let seen = share[row * width..][..width].iter().zip(strength);
                reflected
                    .iter_mut()
                    .zip(seen)
                    .for_each(|(reflected, (share, strength))| *reflected *= share * strength);
            }
        }
        for (sum, share) in sums.iter_mut().zip(led.color) {
            let sum = &mut sum[row * width..][..width];
            sum.iter_mut().zip(&*reflected).for_each(|(sum, reflected)| *sum += reflected * share);
        }
    }

    /// Moves pixels within which the skin bends towards the mean light over them, by the weight of each.
    #[inline(always)]
    fn average_bent_pixels(&self, sums: &mut [Vec<f32>; 3]) {
        let Self { skin, pressed: PressedSkin { region, visible_shares, bent, .. } } = self;
        let width = region.width().max(1);
        // Values at the samples within each pixel, and the light of the LED there.
        let mut normals = [[[0.0; LANES]; PIXELS_PER_RUN]; 3];
        let (mut towards, mut to_camera) = (normals, normals);
        let mut reflected = [[0.0; LANES]; PIXELS_PER_RUN];
        for pixels in bent.chunks(PIXELS_PER_RUN) {
            let index = |pixel: &BentSkin| skin.pixel_index(*region, pixel.index / width) + pixel.index % width;
            for (at, pixel) in pixels.iter().enumerate() {
                normals.iter_mut().zip(pixel.normals).for_each(|(to, values)| to[at] = values);
                let here = skin.to_camera.iter().map(|plane| plane[index(pixel)]);
                to_camera.iter_mut().zip(here).for_each(|(to, value)| to[at] = [value; LANES]);
            }
            let mut means = [[0.0; 3]; PIXELS_PER_RUN];
            for (number, led) in skin.led_light.iter().enumerate() {
                for (at, pixel) in pixels.iter().enumerate() {
                    let here = led.directions.iter().map(|plane| plane[index(pixel)]);
                    towards.iter_mut().zip(here).for_each(|(to, value)| to[at] = [value; LANES]);
                }
                let count = pixels.len();
                let planes = [&normals, &towards, &to_camera];
                let planes = planes.map(|planes| planes.each_ref().map(|plane| plane[..count].as_flattened()));
                reflect_phong(planes, &skin.phong, reflected[..count].as_flattened_mut());
                let visible_share = visible_shares.get(number).and_then(Option::as_ref);
                for ((pixel, [a, b, c, d, e, f, g, h]), means) in pixels.iter().zip(&reflected).zip(&mut means) {
                    let mean = (((a + b) + (c + d)) + ((e + f) + (g + h))) * (1.0 / LANES as f32);
                    let share = visible_share.map_or(1.0, |share| share[pixel.index]);
                    let mean = share * led.strength[index(pixel)] * mean;
                    means.iter_mut().zip(led.color).for_each(|(sum, share)| *sum += mean * share);
                }
            }
            for (pixel, means) in pixels.iter().zip(means) {
                for (sum, mean) in sums.iter_mut().zip(means) {
                    sum[pixel.index] += pixel.weight * (mean - sum[pixel.index]);
                }
            }
        }
    }
}

/// Computes Phong's reflection towards the camera along normals, of light from the directions `towards`.
fn reflect_phong([normals, towards, to_camera]: [[&[f32]; 3]; 3], phong: &Phong, reflected: &mut [f32]) {
    run_with_power(phong.shininess, SkinReflection { normals, towards, to_camera, phong, reflected });
}

/// The work of [`reflect_phong`].
struct SkinReflection<'a> {
    normals: [&'a [f32]; 3],
    towards: [&'a [f32]; 3],
    to_camera: [&'a [f32]; 3],
    phong: &'a Phong,
    reflected: &'a mut [f32],
}

impl WithPower for SkinReflection<'_> {
    #[inline(always)]
    fn run(self, power: impl Fn(f32) -> f32 + Copy) {
        let Self { normals, towards, to_camera, phong, reflected } = self;
        let count = reflected.len();
        let [[nx, ny, nz], [lx, ly, lz], [vx, vy, vz]] =
            [normals, towards, to_camera].map(|planes| planes.map(|plane| &plane[..count]));
        let (diffuse, specular) = (phong.diffuse as f32, phong.specular as f32);
        for x in 0..count {
            let (n, l, v) = ([nx[x], ny[x], nz[x]], [lx[x], ly[x], lz[x]], [vx[x], vy[x], vz[x]]);
            let along = dot(n, l);
            // R.V with R = 2 (N.l) N - l; what is lit from behind has no highlight.
            let mirrored = 2.0 * along * dot(n, v) - dot(l, v);
            let mirrored = if along > 0.0 { mirrored } else { 0.0 };
            reflected[x] = phong_reflection([along, mirrored], diffuse, specular, power);
        }
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
