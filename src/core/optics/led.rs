//! One LED, and its light from infinity. What it sends from its distance is in [`super::near_light`].

use super::light_pattern::{LightColor, LightPattern};
use super::phong::{Phong, WithPower, run_with_power};
use super::shadow::ShadowCaster;
use crate::base::angle::sin_cos_deg;
use serde::{Deserialize, Serialize};

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
    /// Where it is, mm in the sensor's frame, in place of azimuth, elevation and distance: on a flat pad from the middle
    /// of the image, with z below 0 on the camera's side. On a gel that has a shape its light comes straight from there;
    /// without it the light runs along the gel from its rim at `azimuth_deg`, and comes `elevation_deg` out of the skin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_mm: Option<[f64; 3]>,
    /// Width along the pad and height of the LED or the row of LEDs, mm, 0 to 1000; used by the optics model `led`.
    /// Without it they follow from `angular_size_deg`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_mm: Option<[f64; 2]>,
    /// Exponent of the cosine with which its light falls off about the direction to the middle of the image, 0 to 100:
    /// 0 shines alike in all directions, 1 is an even surface. Used by the optics model `led`.
    #[serde(skip_serializing_if = "is_zero")]
    pub lobe: f64,
    /// Red, green and blue share of the light, 0 to 1.
    pub color: [f64; 3],
    /// Brightness that a surface facing the LED gains, as a share of full scale before k_d and k_s; 0 or more.
    pub intensity: f64,
    /// How its light varies over a flat pad, as a factor on its colour. Without it a distant LED shines alike everywhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<Box<LightPattern>>,
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
            size_mm: None,
            lobe: 0.0,
            color: [1.0; 3],
            intensity: 1.0,
            pattern: None,
        }
    }
}

/// Returns true for 0, which files leave out.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Where an LED is, seen from the middle of the image of a flat pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LedPlace {
    /// Unit vector to the LED: right, down and away from the camera.
    pub direction: [f64; 3],
    /// Sine and cosine of the direction in the plane of the pad, from +x towards +y.
    pub azimuth: (f64, f64),
    /// Distance, mm.
    pub distance_mm: f64,
}

impl Led {
    /// Returns where the LED is: at its position, or in its direction.
    pub fn place(&self) -> LedPlace {
        let azimuth = sin_cos_deg(self.azimuth_deg);
        match self.position_mm {
            Some(position) => {
                let [x, y, z] = position;
                let across = libm::hypot(x, y);
                let distance_mm = libm::hypot(across, z).max(1e-3);
                let azimuth = if across > 0.0 { (y / across, x / across) } else { azimuth };
                LedPlace { direction: position.map(|mm| mm / distance_mm), azimuth, distance_mm }
            }
            None => {
                let ((sin, cos), (sin_elevation, cos_elevation)) = (azimuth, sin_cos_deg(self.elevation_deg));
                let direction = [cos * cos_elevation, sin * cos_elevation, -sin_elevation];
                LedPlace { direction, azimuth, distance_mm: self.distance_mm }
            }
        }
    }
}

/// An LED at infinity in the shader's numbers.
#[derive(Clone, Debug)]
pub struct PlacedLed {
    /// Colour times intensity.
    pub(crate) color: LightColor,
    /// Unit vector to the LED.
    to_led: [f32; 3],
    /// Width and height under which the pad sees it, degrees.
    angular_size_deg: [f64; 2],
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
    /// Places a sensor's LED at infinity.
    pub fn new(led: &Led) -> Self {
        Self {
            to_led: led.place().direction.map(|v| v as f32),
            color: LightColor::new(led.color, led.intensity, led.pattern.as_deref()),
            angular_size_deg: led.angular_size_deg,
        }
    }

    /// Returns the unit vector to the LED.
    pub(crate) fn direction(&self) -> [f32; 3] {
        self.to_led
    }

    /// Returns what casts the LED's shadows.
    pub(crate) fn shadow_caster(&self, mm_per_px: [f64; 2]) -> ShadowCaster {
        let [x, y, z] = self.to_led.map(f64::from);
        let azimuth_deg = libm::atan2(y, x).to_degrees();
        let elevation_deg = libm::atan2(-z, libm::hypot(x, y)).to_degrees();
        ShadowCaster::new(azimuth_deg, elevation_deg, self.angular_size_deg, mm_per_px)
    }

    /// Computes the light of the LED, at intensity 1, along a row of normals, and writes it to `gain`.
    pub fn reflect(&self, phong: &Phong, normals: &Normals, gain: &mut [f32]) {
        run_with_power(phong.shininess, DistantReflection { led: self, phong, normals, gain });
    }
}

/// The work of [`PlacedLed::reflect`].
struct DistantReflection<'a> {
    led: &'a PlacedLed,
    phong: &'a Phong,
    normals: &'a Normals,
    gain: &'a mut [f32],
}

impl WithPower for DistantReflection<'_> {
    #[inline(always)]
    fn run(self, power: impl Fn(f32) -> f32 + Copy) {
        let Self { led: PlacedLed { to_led, .. }, phong, normals, gain } = self;
        let (diffuse, specular) = (phong.diffuse as f32, phong.specular as f32);
        let width = gain.len();
        let (nx, ny, nz) = (&normals.x[..width], &normals.y[..width], &normals.z[..width]);
        let to_led = *to_led;
        for x in 0..width {
            gain[x] = phong_reflection(reflection_cosines(to_led, [nx[x], ny[x], nz[x]]), diffuse, specular, power);
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
