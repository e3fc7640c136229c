//! One LED: at infinity, or at its distance from the pad.
//!
//! A near LED is a point that shines alike in all directions. Its direction turns from pixel to pixel, and its
//! brightness falls with the square of the distance (Lambert 1760), 1 in the middle of the image. Both follow the
//! surface's height: a dent comes nearer to the LED, which then stands lower over it. The height is ignored under an
//! LED so far away that no height changes its light.

use super::shadow::ShadowCaster;
use crate::base::angle::sin_cos_deg;
use serde::{Deserialize, Serialize};

/// Smallest square of a distance to an LED that counts, mm^2: at an LED that lies in the pad's plane, light would be
/// infinite and come from nowhere.
const NEAREST_MM2: f32 = 1e-6;

/// An LED.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Led {
    /// What messages and docs call it.
    pub name: String,
    /// Direction towards the LED in the image plane, degrees from +x (right) towards +y (down).
    pub azimuth_deg: f64,
    /// Angle of the LED over the pad's plane on the camera's side, degrees, 0 to 90.
    pub elevation_deg: f64,
    /// Angles under which the pad sees the LED or the row of LEDs, degrees, 0 to 90: width along the pad, height over
    /// it. They say how soft shadows are at their sides and at their ends.
    pub angular_size_deg: [f64; 2],
    /// Distance from the middle of the image, mm; used by the optics model `led`.
    pub distance_mm: f64,
    /// Where it is, on a gel that has a shape, mm in the sensor's frame: its light comes straight from there. Without
    /// it the light runs along the gel from its rim at `azimuth_deg`, and comes `elevation_deg` out of the skin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_mm: Option<[f64; 3]>,
    /// Red, green and blue share of the light, 0 to 1.
    pub color: [f64; 3],
    /// Brightness that a surface facing the LED gains, as a share of full scale before k_d and k_s; 0 or more.
    pub intensity: f64,
}

impl Default for Led {
    fn default() -> Self {
        // The paper's L rises by 0.15 over a horizontal length of 1.
        let elevation_deg = 8.530_765_609_948_133;
        Self {
            name: String::from("led"),
            azimuth_deg: 0.0,
            elevation_deg,
            angular_size_deg: [40.0, 10.0],
            distance_mm: 20.0,
            position_mm: None,
            color: [1.0; 3],
            intensity: 1.0,
        }
    }
}

/// An LED in the shader's numbers.
#[derive(Clone, Copy, Debug)]
pub struct PlacedLed {
    /// Colour times intensity.
    pub color: [f32; 3],
    /// Unit vector from the middle of the image to the LED.
    to_led: [f32; 3],
    /// Distance from the middle of the image, mm; `None` at infinity.
    distance_mm: Option<f32>,
    /// True if its light follows the surface's height.
    follows_height: bool,
    /// Width and height under which the pad sees it, degrees.
    angular_size_deg: [f64; 2],
}

/// Where the points of a row lie, mm from the middle of the image; only near LEDs read it.
#[derive(Clone, Copy, Debug, Default)]
pub struct RowPositions<'a> {
    /// Place of each point along the row.
    pub x_mm: &'a [f32],
    /// Place of the row.
    pub y_mm: f32,
    /// Heights of the surface over the undeformed pad, mm towards the camera.
    pub heights_mm: &'a [f32],
}

/// Unit normals of a row, a plane per component.
#[derive(Clone, Debug, Default)]
pub struct Normals {
    /// Along the row.
    pub x: Vec<f32>,
    /// Down.
    pub y: Vec<f32>,
    /// Away from the camera: negative.
    pub z: Vec<f32>,
}

impl Normals {
    /// Adds a normal that faces the camera, from its components along the row and down.
    pub fn push(&mut self, [x, y]: [f32; 2]) {
        self.x.push(x);
        self.y.push(y);
        self.z.push(-(1.0 - x * x - y * y).max(0.0).sqrt());
    }
}

impl PlacedLed {
    /// Places a sensor's LED; `near` if its distance counts.
    pub fn new(led: &Led, near: bool) -> Self {
        let (sin_azimuth, cos_azimuth) = sin_cos_deg(led.azimuth_deg);
        let (sin_elevation, cos_elevation) = sin_cos_deg(led.elevation_deg);
        let to_led = [cos_azimuth * cos_elevation, sin_azimuth * cos_elevation, -sin_elevation];
        Self {
            to_led: to_led.map(|v| v as f32),
            color: led.color.map(|share| (share * led.intensity) as f32),
            distance_mm: near.then_some(led.distance_mm as f32),
            follows_height: near,
            angular_size_deg: led.angular_size_deg,
        }
    }

    /// Returns true if its light is the same at every pixel of a flat pad.
    pub(crate) fn is_uniform(&self) -> bool {
        self.distance_mm.is_none()
    }

    /// Returns true if its light follows the surface's height.
    pub(crate) fn follows_height(&self) -> bool {
        self.follows_height
    }

    /// Returns the LED with its light as on the undeformed pad, whatever the surface's height.
    pub(crate) fn regardless_of_height(self) -> Self {
        Self { follows_height: false, ..self }
    }

    /// Returns the vector from a point of the undeformed pad to the LED, mm; a unit vector if the LED is at infinity.
    pub(crate) fn vector_from(&self, point_mm: [f32; 2]) -> [f32; 3] {
        let [x, y, z] = self.to_led;
        match self.distance_mm {
            None => self.to_led,
            Some(distance) => [x * distance - point_mm[0], y * distance - point_mm[1], z * distance],
        }
    }

    /// Returns the brightness at a point of the undeformed pad, as a fraction of that in the middle of the image.
    pub(crate) fn strength_at_point(&self, point_mm: [f32; 2]) -> f32 {
        let [x, y, z] = self.vector_from(point_mm);
        self.distance_mm.map_or(1.0, |distance| distance * distance / (x * x + y * y + z * z).max(NEAREST_MM2))
    }

    /// Returns the brightness at a distance from the LED, mm, as a fraction of that in the middle of the image.
    pub(crate) fn strength_at_distance(&self, mm: f64) -> f64 {
        self.distance_mm.map_or(1.0, |distance| f64::from(distance).powi(2) / (mm * mm).max(f64::from(NEAREST_MM2)))
    }

    /// Returns what casts the LED's shadows around a point at a height over the pad, mm.
    pub(crate) fn shadow_caster(&self, point_mm: [f64; 2], height_mm: f32, mm_per_px: [f64; 2]) -> ShadowCaster {
        let [x, y, z] = self.vector_from(point_mm.map(|mm| mm as f32));
        let z = if self.follows_height { z + height_mm } else { z };
        let [x, y, z] = [x, y, z].map(f64::from);
        let azimuth_deg = libm::atan2(y, x).to_degrees();
        let elevation_deg = libm::atan2(-z, libm::hypot(x, y)).to_degrees();
        ShadowCaster::new(azimuth_deg, elevation_deg, self.angular_size_deg, mm_per_px)
    }

    /// Computes the light of the LED, at intensity 1, along a row of normals, and writes it to `gain`.
    #[inline(always)]
    pub(crate) fn reflect(
        &self,
        normals: &Normals,
        row: RowPositions,
        diffuse: f32,
        specular: f32,
        power: impl Fn(f32) -> f32 + Copy,
        gain: &mut [f32],
    ) {
        let width = gain.len();
        let (nx, ny, nz) = (&normals.x[..width], &normals.y[..width], &normals.z[..width]);
        match self.distance_mm {
            None => {
                let to_led = self.to_led;
                for x in 0..width {
                    gain[x] =
                        phong_reflection(reflection_cosines(to_led, [nx[x], ny[x], nz[x]]), diffuse, specular, power);
                }
            }
            Some(distance) => {
                let [led_x, led_y, led_z] = self.to_led.map(|v| v * distance);
                let (dy, full, places) = (led_y - row.y_mm, distance * distance, &row.x_mm[..width]);
                let lit = |x: usize, dz: f32| {
                    let dx = led_x - places[x];
                    let inverse = 1.0 / (dx * dx + (dy * dy + dz * dz).max(NEAREST_MM2)).sqrt();
                    let to_led = [dx * inverse, dy * inverse, dz * inverse];
                    let strength = full * inverse * inverse;
                    let [along, mirrored] = reflection_cosines(to_led, [nx[x], ny[x], nz[x]]);
                    // A dent may reach past an LED, which is then behind what faces the camera: it gives no highlight.
                    let mirrored = if along > 0.0 { mirrored } else { 0.0 };
                    strength * phong_reflection([along, mirrored], diffuse, specular, power)
                };
                if self.follows_height {
                    // Towards the camera, where the LED is, z falls: a positive height brings the surface nearer to it.
                    let heights = &row.heights_mm[..width];
                    for x in 0..width {
                        gain[x] = lit(x, led_z + heights[x]);
                    }
                } else {
                    for (x, gain) in gain.iter_mut().enumerate() {
                        *gain = lit(x, led_z);
                    }
                }
            }
        }
    }
}

/// Returns N.l and R.V, for light from a direction at a surface with this normal.
#[inline(always)]
fn reflection_cosines(to_led: [f32; 3], normal: [f32; 3]) -> [f32; 2] {
    let [lx, ly, lz] = to_led;
    let [nx, ny, nz] = normal;
    let along = nx * lx + ny * ly + nz * lz;
    // V = (0, 0, -1): the camera sees minus the z component.
    [along, lz - 2.0 * along * nz]
}

/// Returns Phong's reflection towards the camera.
#[inline(always)]
pub(super) fn phong_reflection(
    [along, mirrored]: [f32; 2],
    diffuse: f32,
    specular: f32,
    power: impl Fn(f32) -> f32,
) -> f32 {
    diffuse * along.max(0.0) + specular * power(mirrored.max(0.0))
}
