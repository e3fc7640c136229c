//! Phong's reflection of LEDs on a skin, and on average over pixels within which the skin bends.

use super::{BentSkin, PressedSkin, Skin};
use crate::base::simd::simd_dispatch;
use crate::optics::led::reflected;
use crate::optics::phong::{Phong, WithPower};

/// Places within a pixel.
pub const LANES: usize = 8;

/// Pixels within which the skin bends that are shaded at once.
const RUN: usize = 32;

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
                let mut given = vec![0.0; region.width()];
                for row in 0..region.height() {
                    for number in 0..self.skin.leds.len() {
                        self.add_row(number, row, power, &mut given, &mut sums);
                    }
                }
                self.average(power, &mut sums);
                sums
            },
        )
    }
}

impl Reflection<'_> {
    /// Adds what an LED gives along a row of the part.
    #[inline(always)]
    fn add_row(
        &self,
        number: usize,
        row: usize,
        power: impl Fn(f32) -> f32 + Copy,
        given: &mut [f32],
        sums: &mut [Vec<f32>; 3],
    ) {
        let Self { skin, pressed: PressedSkin { region, normals, visible, .. } } = self;
        let led = &skin.leds[number];
        let (width, first) = (region.width(), skin.index(*region, row));
        let normals = normals.map(|plane| &plane[row * width..][..width]);
        let towards = led.towards.each_ref().map(|plane| &plane[first..][..width]);
        let to_camera = skin.to_camera.each_ref().map(|plane| &plane[first..][..width]);
        reflect([normals, towards, to_camera], &skin.phong, power, given);
        let strength = &led.strength[first..][..width];
        match visible.get(number).and_then(Option::as_ref) {
            None => given.iter_mut().zip(strength).for_each(|(given, strength)| *given *= strength),
            Some(share) => {
                let seen = share[row * width..][..width].iter().zip(strength);
                given.iter_mut().zip(seen).for_each(|(given, (share, strength))| *given *= share * strength);
            }
        }
        for (sum, share) in sums.iter_mut().zip(led.color) {
            let sum = &mut sum[row * width..][..width];
            sum.iter_mut().zip(&*given).for_each(|(sum, given)| *sum += given * share);
        }
    }

    /// Takes pixels within which the skin bends to what it reflects on average over them.
    #[inline(always)]
    fn average(&self, power: impl Fn(f32) -> f32 + Copy, sums: &mut [Vec<f32>; 3]) {
        let Self { skin, pressed: PressedSkin { region, visible, bent, .. } } = self;
        let width = region.width().max(1);
        // At the places within each pixel, and what the LED gives there.
        let mut normals = [[[0.0; LANES]; RUN]; 3];
        let (mut towards, mut to_camera) = (normals, normals);
        let mut given = [[0.0; LANES]; RUN];
        for pixels in bent.chunks(RUN) {
            let index = |pixel: &BentSkin| skin.index(*region, pixel.at / width) + pixel.at % width;
            for (at, pixel) in pixels.iter().enumerate() {
                normals.iter_mut().zip(pixel.normals).for_each(|(to, values)| to[at] = values);
                let here = skin.to_camera.iter().map(|plane| plane[index(pixel)]);
                to_camera.iter_mut().zip(here).for_each(|(to, value)| to[at] = [value; LANES]);
            }
            let mut means = [[0.0; 3]; RUN];
            for (number, led) in skin.leds.iter().enumerate() {
                for (at, pixel) in pixels.iter().enumerate() {
                    let here = led.towards.iter().map(|plane| plane[index(pixel)]);
                    towards.iter_mut().zip(here).for_each(|(to, value)| to[at] = [value; LANES]);
                }
                let count = pixels.len();
                let planes = [&normals, &towards, &to_camera];
                let planes = planes.map(|planes| planes.each_ref().map(|plane| plane[..count].as_flattened()));
                reflect(planes, &skin.phong, power, given[..count].as_flattened_mut());
                let visible = visible.get(number).and_then(Option::as_ref);
                for ((pixel, [a, b, c, d, e, f, g, h]), means) in pixels.iter().zip(&given).zip(&mut means) {
                    let mean = (((a + b) + (c + d)) + ((e + f) + (g + h))) * (1.0 / LANES as f32);
                    let share = visible.map_or(1.0, |share| share[pixel.at]);
                    let mean = share * led.strength[index(pixel)] * mean;
                    means.iter_mut().zip(led.color).for_each(|(sum, share)| *sum += mean * share);
                }
            }
            for (pixel, means) in pixels.iter().zip(means) {
                for (sum, mean) in sums.iter_mut().zip(means) {
                    sum[pixel.at] += pixel.weight * (mean - sum[pixel.at]);
                }
            }
        }
    }
}

/// Phong's reflection along normals, of light from directions towards an LED in those towards the camera.
#[inline(always)]
fn reflect(
    [normals, towards, to_camera]: [[&[f32]; 3]; 3],
    phong: &Phong,
    power: impl Fn(f32) -> f32 + Copy,
    given: &mut [f32],
) {
    let count = given.len();
    let [[nx, ny, nz], [lx, ly, lz], [vx, vy, vz]] =
        [normals, towards, to_camera].map(|planes| planes.map(|plane| &plane[..count]));
    let (diffuse, specular) = (phong.diffuse as f32, phong.specular as f32);
    for x in 0..count {
        let (n, l, v) = ([nx[x], ny[x], nz[x]], [lx[x], ly[x], lz[x]], [vx[x], vy[x], vz[x]]);
        let along = dot(n, l);
        // R.V of R = 2 (N.l) N - l; what is lit from behind gleams no more.
        let mirrored = 2.0 * along * dot(n, v) - dot(l, v);
        let mirrored = if along > 0.0 { mirrored } else { 0.0 };
        given[x] = reflected([along, mirrored], diffuse, specular, power);
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
