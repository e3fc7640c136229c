//! The light of near LEDs on a part of the view: vectors on a coarse grid, interpolated and reflected row by row.

use crate::optics::coarse::CoarseValues;
use crate::optics::led::Normals;
use crate::optics::phong::{Phong, WithPower, run_with_power};

/// Values of three components or channels on a part of the grid, row-major.
pub(crate) type LightPlanes = [Vec<f32>; 3];

/// The light on a part of the view.
pub(crate) struct LightField {
    /// For each LED the vector of its light: right, down and away from the camera.
    pub leds: Vec<[CoarseValues; 3]>,
    /// Light by one bounce, for each channel.
    pub bounced: Option<[CoarseValues; 3]>,
}

/// What an LED's light is at the pixels of a row.
#[derive(Clone, Debug, Default)]
pub(crate) struct LightVectors {
    planes: [Vec<f32>; 3],
}

impl LightField {
    /// Fills in the light of LED number `led` at the pixels of row `y` of the view, from column `x0` on.
    #[inline(always)]
    pub fn fill_row(&self, led: usize, y: usize, x0: usize, line: &mut Vec<f32>, row: &mut LightVectors, width: usize) {
        for (plane, values) in row.planes.iter_mut().zip(&self.leds[led]) {
            plane.resize(width, 0.0);
            values.interpolate_row(y, x0, line, &mut plane[..width]);
        }
    }

    /// Returns the light of one bounce in a channel.
    pub fn bounced(&self, channel: usize) -> Option<&CoarseValues> {
        self.bounced.as_ref().map(|planes| &planes[channel])
    }
}

impl LightVectors {
    /// Takes the light at these places of another row, each so many times.
    pub fn repeat_from(&mut self, row: &Self, places: impl Iterator<Item = usize> + Clone, times: usize) {
        for (plane, from) in self.planes.iter_mut().zip(&row.planes) {
            plane.clear();
            for place in places.clone() {
                plane.extend(std::iter::repeat_n(from[place], times));
            }
        }
    }

    /// Computes diffuse and specular light towards the camera from a row of normals, and writes it to `gain`.
    pub fn reflect(&self, phong: &Phong, normals: &Normals, gain: &mut [f32]) {
        run_with_power(phong.shininess, NearReflection { light: self, phong, normals, gain });
    }
}

/// The work of [`LightVectors::reflect`].
struct NearReflection<'a> {
    light: &'a LightVectors,
    phong: &'a Phong,
    normals: &'a Normals,
    gain: &'a mut [f32],
}

impl WithPower for NearReflection<'_> {
    #[inline(always)]
    fn run(self, power: impl Fn(f32) -> f32 + Copy) {
        let Self { light, phong, normals, gain } = self;
        let (diffuse, specular) = (phong.diffuse as f32, phong.specular as f32);
        let width = gain.len();
        let [lx, ly, lz] = light.planes.each_ref().map(|plane| &plane[..width]);
        let (nx, ny, nz) = (&normals.x[..width], &normals.y[..width], &normals.z[..width]);
        if specular == 0.0 {
            for x in 0..width {
                gain[x] = diffuse * (nx[x] * lx[x] + ny[x] * ly[x] + nz[x] * lz[x]).max(0.0);
            }
            return;
        }
        for x in 0..width {
            let strength = (lx[x] * lx[x] + ly[x] * ly[x] + lz[x] * lz[x]).sqrt();
            let along = nx[x] * lx[x] + ny[x] * ly[x] + nz[x] * lz[x];
            // V = (0, 0, -1): the camera sees minus the z component. What faces away gives no highlight.
            let mirrored = if along > 0.0 { lz[x] - 2.0 * along * nz[x] } else { 0.0 };
            // Of almost no light, even the square can be 0.
            let mirrored = (mirrored.max(0.0) / strength.max(f32::MIN_POSITIVE)).min(1.0);
            gain[x] = diffuse * along.max(0.0) + specular * strength * power(mirrored);
        }
    }
}
