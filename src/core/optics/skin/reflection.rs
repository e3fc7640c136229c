//! Phong's reflection of LEDs on a skin, eight pixels at a time, and on average over pixels within which the skin bends.

use super::{PressedSkin, Skin};
use crate::core::base::simd::simd_dispatch;
use crate::core::optics::led::reflected;
use crate::core::optics::phong::WithPower;

/// Pixels that are shaded at once, and places within a pixel.
pub const LANES: usize = 8;

/// What the LEDs give: red, green and blue of each pixel.
pub struct Reflection<'a> {
    /// The lights.
    pub skin: &'a Skin,
    /// What is lit.
    pub pressed: &'a PressedSkin<'a>,
}

impl WithPower for Reflection<'_> {
    type Output = [Vec<f32>; 3];

    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> [Vec<f32>; 3] {
        let region = self.pressed.region;
        let mut sums = [(); 3].map(|()| vec![0.0; region.area()]);
        simd_dispatch(
            #[inline(always)]
            || {
                for row in 0..region.height() {
                    for number in 0..self.skin.leds.len() {
                        self.add_row(number, row, power, &mut sums);
                    }
                }
                self.average(power, &mut sums);
            },
        );
        sums
    }
}

impl Reflection<'_> {
    /// Adds what an LED gives along a row of the part.
    #[inline(always)]
    fn add_row(&self, number: usize, row: usize, power: impl Fn(f32) -> f32 + Copy, sums: &mut [Vec<f32>; 3]) {
        let Self { skin, pressed: PressedSkin { region, normals, visible, .. } } = self;
        let led = &skin.leds[number];
        let (width, first) = (region.width(), skin.index(*region, row));
        let normals = normals.map(|plane| &plane[row * width..][..width]);
        let towards = led.towards.each_ref().map(|plane| &plane[first..][..width]);
        let to_camera = skin.to_camera.each_ref().map(|plane| &plane[first..][..width]);
        let strength = &led.strength[first..][..width];
        let visible = visible.get(number).and_then(Option::as_ref).map(|share| &share[row * width..][..width]);
        let phong = [skin.phong.diffuse as f32, skin.phong.specular as f32];
        let [red, green, blue] = sums.each_mut().map(|sum| &mut sum[row * width..][..width]);
        let whole = width / LANES * LANES;
        for x in (0..whole).step_by(LANES) {
            let ([nx, ny, nz], [lx, ly, lz]) =
                (normals.map(|plane| eight(plane, x)), towards.map(|plane| eight(plane, x)));
            let ([vx, vy, vz], strength) = (to_camera.map(|plane| eight(plane, x)), eight(strength, x));
            let visible = visible.map_or([1.0; LANES], |share| eight(share, x));
            let given: [f32; LANES] = std::array::from_fn(|k| {
                let given = given([nx[k], ny[k], nz[k]], [lx[k], ly[k], lz[k]], [vx[k], vy[k], vz[k]], phong, power);
                visible[k] * strength[k] * given
            });
            for (sum, share) in [&mut *red, &mut *green, &mut *blue].into_iter().zip(led.color) {
                sum[x..x + LANES].iter_mut().zip(given).for_each(|(sum, given)| *sum += given * share);
            }
        }
        for x in whole..width {
            let at = |planes: [&[f32]; 3]| planes.map(|plane| plane[x]);
            let seen = visible.map_or(1.0, |share| share[x]) * strength[x];
            let given = seen * given(at(normals), at(towards), at(to_camera), phong, power);
            for (sum, share) in [&mut *red, &mut *green, &mut *blue].into_iter().zip(led.color) {
                sum[x] += given * share;
            }
        }
    }

    /// Takes pixels within which the skin bends to what it reflects on average over them.
    #[inline(always)]
    fn average(&self, power: impl Fn(f32) -> f32 + Copy, sums: &mut [Vec<f32>; 3]) {
        let Self { skin, pressed: PressedSkin { region, visible, bent, .. } } = self;
        let phong = [skin.phong.diffuse as f32, skin.phong.specular as f32];
        let width = region.width().max(1);
        for pixel in *bent {
            let index = skin.index(*region, pixel.at / width) + pixel.at % width;
            let to_camera = skin.to_camera.each_ref().map(|plane| plane[index]);
            let [nx, ny, nz] = &pixel.normals;
            let mut means = [0.0; 3];
            for (number, led) in skin.leds.iter().enumerate() {
                let towards = led.towards.each_ref().map(|plane| plane[index]);
                let given: [f32; LANES] =
                    std::array::from_fn(|k| given([nx[k], ny[k], nz[k]], towards, to_camera, phong, power));
                let [a, b, c, d, e, f, g, h] = given;
                let mean = (((a + b) + (c + d)) + ((e + f) + (g + h))) * (1.0 / LANES as f32);
                let visible = visible.get(number).and_then(Option::as_ref).map_or(1.0, |share| share[pixel.at]);
                let mean = visible * led.strength[index] * mean;
                means.iter_mut().zip(led.color).for_each(|(sum, share)| *sum += mean * share);
            }
            for (sum, mean) in sums.iter_mut().zip(means) {
                sum[pixel.at] += pixel.weight * (mean - sum[pixel.at]);
            }
        }
    }
}

/// Phong's reflection of light from `l` towards `v` at a normal `n`.
#[inline(always)]
fn given(
    n: [f32; 3],
    l: [f32; 3],
    v: [f32; 3],
    [diffuse, specular]: [f32; 2],
    power: impl Fn(f32) -> f32 + Copy,
) -> f32 {
    let along = dot(n, l);
    // R.V of R = 2 (N.l) N - l; what is lit from behind gleams no more.
    let mirrored = if along > 0.0 { 2.0 * along * dot(n, v) - dot(l, v) } else { 0.0 };
    reflected([along, mirrored], diffuse, specular, power)
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Eight values from a place on.
#[inline(always)]
fn eight(plane: &[f32], at: usize) -> [f32; LANES] {
    let plane = &plane[at..at + LANES];
    std::array::from_fn(|k| plane[k])
}
