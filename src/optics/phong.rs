//! LEDs at infinity with diffuse and specular reflection, over the picture of the untouched pad.
//!
//! Source: Phong (1975); constants and lights of Gomes, Wilson and Luo (2019). With N the surface normal, l the
//! direction to the LED, R = 2 (N.l) N - l and V = (0, 0, -1) towards the camera, an LED gives
//! k_d max(0, N.l) + k_s max(0, R.V)^alpha. The paper adds that to the background image; but a photograph of the
//! untouched pad already holds the light that a flat pad reflects. So the flat pad's own term is taken off, and an
//! untouched pad is the background exactly (`equation = "literal"` gives the paper's sum). The law of the darkening by
//! depth is ours: a share of the light that grows in proportion to the displacement.
//!
//! Valid for low relief without shadows and interreflection; light is added in display values, as in the paper.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Light, background::Reference};
use crate::config::sensor::Sensor;
use crate::depth::Camera;
use crate::gelpad::{Contact, SURFACE_BORDER};
use crate::scene::pose::sin_cos_deg;
use crate::simd::wide;

/// Parameters of Phong shading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
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
    /// Share of the light lost where the pad is pressed down to the shell, 0 to 1. Not in the paper: 0.35.
    pub darkening: f64,
    /// What is added to the background.
    pub equation: Equation,
}

impl Default for Phong {
    fn default() -> Self {
        Self {
            ambient: 1.0,
            diffuse: 0.5,
            specular: 0.15,
            shininess: 5.0,
            darkening: 0.35,
            equation: Equation::Relative,
        }
    }
}

/// What is added to the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Equation {
    /// Phong(N) - Phong(flat): an untouched pad is the background.
    Relative,
    /// Phong(N), as the paper writes it: an untouched pad is brighter than the background.
    Literal,
}

/// One LED in the shader's numbers.
#[derive(Clone, Copy, Debug)]
struct Lamp {
    /// Unit vector to the LED.
    to_led: [f32; 3],
    /// Colour times intensity.
    color: [f32; 3],
    /// What a flat pad gives, to be taken off.
    flat: f32,
}

/// Phong shading made ready for a sensor.
pub struct Shader {
    phong: Phong,
    lamps: Vec<Lamp>,
    /// 1 / (2 r) along x and y, 1/mm.
    per_slope: [f32; 2],
    /// Share of the light lost per mm of displacement.
    darkening_per_mm: f32,
    width: usize,
    height: usize,
}

impl Shader {
    /// Prepares the sensor's LEDs.
    pub fn new(phong: &Phong, sensor: &Sensor, camera: &Camera) -> Self {
        let [width, height] = camera.resolution_px;
        let lamps = sensor.led.iter().map(|led| {
            let (sin_azimuth, cos_azimuth) = sin_cos_deg(led.azimuth_deg);
            let (sin_elevation, cos_elevation) = sin_cos_deg(led.elevation_deg);
            let to_led = [cos_azimuth * cos_elevation, sin_azimuth * cos_elevation, -sin_elevation];
            let mut lamp = Lamp {
                to_led: to_led.map(|v| v as f32),
                color: led.color.map(|share| (share * led.intensity) as f32),
                flat: 0.0,
            };
            if phong.equation == Equation::Relative {
                // By the same instructions as in the picture, so that a flat pixel loses exactly what it gains.
                lamp.flat = with_power(phong.shininess, Reflect { lamp: &lamp, normal: [0.0, 0.0, -1.0], phong });
            }
            lamp
        });
        Self {
            phong: *phong,
            lamps: lamps.collect(),
            per_slope: camera.mm_per_px.map(|pitch| (0.5 / pitch) as f32),
            darkening_per_mm: (phong.darkening / sensor.gelpad_thickness_mm) as f32,
            width,
            height,
        }
    }

    /// True if depth alone takes light away.
    pub fn darkens(&self) -> bool {
        self.darkening_per_mm > 0.0
    }

    /// True if an untouched pad is the background itself.
    fn rests_on_background(&self) -> bool {
        self.phong.equation == Equation::Relative && self.phong.ambient == 1.0
    }

    /// See [`super::Shader::shade`].
    pub fn shade(&self, contact: &Contact, rest: &Reference) -> Light {
        let region = if self.rests_on_background() {
            // A pixel's slopes reach one pixel further than the displacement itself.
            let padded = contact.region.grown(1, contact.surface.width, contact.surface.height);
            padded.seen_from(SURFACE_BORDER, SURFACE_BORDER, self.width, self.height)
        } else {
            crate::grid::Rect::whole(self.width, self.height)
        };
        let planes = std::array::from_fn(|_| Vec::with_capacity(region.area()));
        let mut light = Light { region, planes };
        with_power(self.phong.shininess, Picture { shader: self, contact, rest, light: &mut light });
        light
    }
}

/// Something to be computed with a power function that is chosen once, outside the loop over pixels.
trait WithPower {
    type Output;
    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> Self::Output;
}

/// Runs `task` with x -> x^exponent for x >= 0. Small whole exponents are products; others go through `libm`.
fn with_power<T: WithPower>(exponent: f64, task: T) -> T::Output {
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

struct Reflect<'a> {
    lamp: &'a Lamp,
    normal: [f32; 3],
    phong: &'a Phong,
}

impl WithPower for Reflect<'_> {
    type Output = f32;

    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> f32 {
        reflect(self.lamp, self.normal, self.phong.diffuse as f32, self.phong.specular as f32, power)
    }
}

/// What an LED of intensity 1 gives at a surface of this normal.
#[inline(always)]
fn reflect(lamp: &Lamp, normal: [f32; 3], diffuse: f32, specular: f32, power: impl Fn(f32) -> f32) -> f32 {
    let [lx, ly, lz] = lamp.to_led;
    let [nx, ny, nz] = normal;
    let along = nx * lx + ny * ly + nz * lz;
    // R.V with V = (0, 0, -1): the camera sees minus the z component.
    let mirrored = lz - 2.0 * along * nz;
    diffuse * along.max(0.0) + specular * power(mirrored.max(0.0))
}

struct Picture<'a> {
    shader: &'a Shader,
    contact: &'a Contact,
    rest: &'a Reference,
    light: &'a mut Light,
}

impl WithPower for Picture<'_> {
    type Output = ();

    fn run(self, power: impl Fn(f32) -> f32 + Copy) {
        let Self { shader, contact, rest, light } = self;
        wide(
            #[inline(always)]
            || {
                let mut normals = Normals::default();
                for row in 0..light.region.height() {
                    shade_row(shader, contact, rest, light, row, &mut normals, power);
                }
            },
        );
    }
}

/// Normals of one row, a plane per component.
#[derive(Default)]
struct Normals {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

/// Shades row `row` of the light's region. Every loop runs along the row with nothing but arithmetic in it, so that
/// the compiler makes eight pixels of each step.
#[inline(always)]
fn shade_row(
    shader: &Shader,
    contact: &Contact,
    rest: &Reference,
    light: &mut Light,
    row: usize,
    normals: &mut Normals,
    power: impl Fn(f32) -> f32 + Copy,
) {
    let region = light.region;
    let (y, width) = (region.y0 + row, region.width());
    let window = |dx: usize, dy: usize| &contact.surface.row(y + dy)[region.x0 + dx..][..width];
    let (left, right, above, below, here) = (window(0, 1), window(2, 1), window(1, 0), window(1, 2), window(1, 1));
    let [per_slope_x, per_slope_y] = shader.per_slope;
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

    let ambient = shader.phong.ambient as f32 / 255.0;
    for (plane, rest) in light.planes.iter_mut().zip(&rest.planes) {
        let rest = &rest[y * shader.width + region.x0..][..width];
        plane.extend(rest.iter().map(|value| f32::from(*value) * ambient));
    }
    let [red, green, blue] = light.planes.each_mut().map(|plane| &mut plane[row * width..][..width]);
    let (diffuse, specular) = (shader.phong.diffuse as f32, shader.phong.specular as f32);
    for lamp in &shader.lamps {
        for x in 0..width {
            let gain = reflect(lamp, [nx[x], ny[x], nz[x]], diffuse, specular, power) - lamp.flat;
            red[x] += gain * lamp.color[0];
            green[x] += gain * lamp.color[1];
            blue[x] += gain * lamp.color[2];
        }
    }
    for x in 0..width {
        let kept = 1.0 - shader.darkening_per_mm * here[x];
        red[x] *= kept;
        green[x] *= kept;
        blue[x] *= kept;
    }
}
