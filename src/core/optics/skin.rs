//! The light on a gel that is not flat: each point of the skin sees its LEDs from directions of its own.
//!
//! Diffuse and specular reflection are those of [`super::phong`], with the camera where it is. An LED's light comes straight from
//! where the LED is, its brightness falling with the square of the distance, 1 at the gel's tip; or it runs along the gel
//! (`heat.rs`).

use glam::DVec3;

use super::Illumination;
use super::background::{BackgroundImage, RenderedBackground};
use super::heat::Heat;
use super::led::{Led, reflected};
use super::phong::{Equation, Phong, WithPower, with_power};
use crate::core::base::angle::sin_cos_deg;
use crate::core::base::gel::{GelShape, Site};
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::light::Light;
use crate::core::base::view::View;

/// What a pixel shows of the untouched gel.
#[derive(Clone, Copy, Debug)]
pub struct SkinPoint {
    /// The point.
    pub site: Site,
    /// Towards the camera, a unit vector.
    pub to_camera: DVec3,
}

/// Light on the skin, made ready for one sensor.
pub struct Skin {
    phong: Phong,
    width: usize,
    leds: Vec<LitSkin>,
    to_camera: Vec<[f32; 3]>,
    /// What the LEDs give at rest, to be taken off: red, green and blue of each pixel.
    at_rest: Vec<[f32; 3]>,
    /// Share of the light lost per mm of displacement.
    darkening_per_mm: f32,
    stray_light: Option<[f32; 3]>,
}

/// The light of LEDs at the rim of a gel, if there are any.
pub struct AlongGel(Option<Heat>);

impl AlongGel {
    /// Of those among `leds`.
    pub fn new(leds: &[Led], shape: &GelShape) -> Self {
        let at_rim = || leds.iter().filter(|led| led.position_mm.is_none());
        let azimuths = at_rim().map(|led| led.azimuth_deg.to_radians());
        Self(at_rim().next().is_some().then(|| Heat::new(shape, azimuths)))
    }
}

/// What of an LED's light reaches the skin.
struct LitSkin {
    /// Colour times intensity.
    color: [f32; 3],
    /// Towards it from each pixel's point, of length 1 at most; no light where there is no gel.
    towards: Vec<[f32; 3]>,
    strength: Vec<f32>,
}

/// A pressed skin, as the pixels of a part of the image show it, row-major.
pub struct PressedSkin<'a> {
    /// The part.
    pub region: Rect,
    /// Towards the inside of the gel.
    pub normals: &'a [[f32; 3]],
    /// How far the skin is displaced, mm.
    pub displaced_mm: &'a [f32],
}

impl Skin {
    /// Of a gel whose points the pixels of an image show, row by row.
    pub fn new(
        phong: Phong,
        light: &Illumination<'_>,
        along_gel: &AlongGel,
        points: &[Option<SkinPoint>],
        width: usize,
    ) -> Self {
        let leds = light.leds.iter().map(|led| LitSkin::new(led, along_gel, points)).collect();
        let vector = |point: &Option<SkinPoint>| point.map_or([0.0; 3], |point| point.to_camera.as_vec3().to_array());
        let mut skin = Self {
            phong,
            width,
            leds,
            to_camera: points.iter().map(vector).collect(),
            at_rest: vec![[0.0; 3]; points.len()],
            darkening_per_mm: light.darkening_per_mm(&phong) as f32,
            stray_light: light.stray_light.map(|stray| stray.map(|share| share as f32)),
        };
        if phong.equation == Equation::Relative {
            let normal = |point: &Option<SkinPoint>| {
                let inwards = point.map_or(DVec3::NEG_Z, |point| -point.site.normal);
                inwards.as_vec3().to_array()
            };
            let normals: Vec<[f32; 3]> = points.iter().map(normal).collect();
            let region = Rect::whole(width, points.len() / width.max(1));
            skin.at_rest = skin.reflected(&PressedSkin { region, normals: &normals, displaced_mm: &[] });
        }
        skin
    }

    /// True if the light changes with the depth alone.
    pub fn darkens(&self) -> bool {
        self.darkening_per_mm > 0.0
    }

    /// What the LEDs give: red, green and blue of each pixel.
    fn reflected(&self, pressed: &PressedSkin<'_>) -> Vec<[f32; 3]> {
        with_power(self.phong.shininess, Reflection { skin: self, pressed })
    }

    /// The light of the untouched skin over its picture.
    pub fn untouched(&self, rest: &BackgroundImage, normals: &[[f32; 3]]) -> Light {
        let displaced_mm = vec![0.0; normals.len()];
        let region = Rect::whole(rest.width, rest.height);
        self.shade(&PressedSkin { region, normals, displaced_mm: &displaced_mm }, rest, false)
    }

    /// The light of a pressed skin over the picture of the untouched one; it `darkens` with depth unless that is left out.
    pub fn shade(&self, pressed: &PressedSkin<'_>, rest: &BackgroundImage, darkens: bool) -> Light {
        let region = pressed.region;
        let darkening_per_mm = if darkens { self.darkening_per_mm } else { 0.0 };
        let mut light = rest.light(region);
        let reflected = self.reflected(pressed);
        let ambient = self.phong.ambient as f32;
        for (at, (reflected, displaced_mm)) in reflected.iter().zip(pressed.displaced_mm).enumerate() {
            let at_rest = self.at_rest[self.index(region, at)];
            let kept = 1.0 - darkening_per_mm * displaced_mm;
            for (channel, plane) in light.planes.iter_mut().enumerate() {
                let untouched = plane[at];
                let scale = self.stray_light.map_or(1.0, |stray| (untouched - stray[channel]).max(0.0));
                plane[at] = kept * (ambient * untouched + scale * (reflected[channel] - at_rest[channel]));
            }
        }
        light
    }

    /// Number in the image of a pixel of a part of it.
    fn index(&self, region: Rect, at: usize) -> usize {
        let width = region.width();
        (region.y0 + at / width) * self.width + region.x0 + at % width
    }
}

/// The picture of an untouched skin without a photograph: black where there is no gel.
pub fn rendered(
    look: &RenderedBackground,
    noise: &Grid<f32>,
    leds: &[Led],
    along_gel: &AlongGel,
    points: &[Option<SkinPoint>],
    view: &View,
) -> BackgroundImage {
    let glow = |number: usize, pixel: usize, _: [f64; 2]| {
        let (led, Some(point)) = (&leds[number], points[pixel]) else { return 0.0 };
        match (led.position_mm, &along_gel.0) {
            (Some(position_mm), _) => {
                let (towards, strength) = straight(position_mm, point.site.point_mm);
                strength * (-point.site.normal).dot(towards).max(0.0)
            }
            (None, Some(heat)) => {
                let (_, distance_mm) = heat.at(point.site, led.azimuth_deg.to_radians());
                libm::exp(-distance_mm / look.glow_reach_mm)
            }
            (None, None) => 0.0,
        }
    };
    let window_mm = std::array::from_fn(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
    let BackgroundImage { width, height, mut rgb, .. } =
        BackgroundImage::glowing(noise, look, leds, window_mm, view, glow);
    for (pixel, point) in rgb.chunks_exact_mut(3).zip(points) {
        if point.is_none() {
            pixel.fill(0);
        }
    }
    BackgroundImage::new(width, height, rgb)
}

/// Towards an LED that is near, a unit vector, and its brightness, 1 at the gel's tip.
fn straight(position_mm: [f64; 3], point_mm: DVec3) -> (DVec3, f64) {
    const NEAREST_MM2: f64 = 1e-6;
    let position = DVec3::from_array(position_mm);
    let to_led = position - point_mm;
    let strength = position.length_squared().max(NEAREST_MM2) / to_led.length_squared().max(NEAREST_MM2);
    (to_led.normalize_or(DVec3::NEG_Z), strength)
}

impl LitSkin {
    fn new(led: &Led, along_gel: &AlongGel, points: &[Option<SkinPoint>]) -> Self {
        let (sin, cos) = sin_cos_deg(led.elevation_deg);
        let azimuth = led.azimuth_deg.to_radians();
        let lit = |point: &Option<SkinPoint>| {
            let Some(SkinPoint { site, .. }) = point else { return ([0.0; 3], 0.0) };
            let (towards, strength) = match (led.position_mm, &along_gel.0) {
                (Some(position_mm), _) => straight(position_mm, site.point_mm),
                (None, Some(heat)) => (cos * heat.at(*site, azimuth).0 - sin * site.normal, 1.0),
                (None, None) => (DVec3::ZERO, 0.0),
            };
            (towards.as_vec3().to_array(), strength as f32)
        };
        let (towards, strength) = points.iter().map(lit).unzip();
        Self { color: led.color.map(|share| (share * led.intensity) as f32), towards, strength }
    }
}

struct Reflection<'a> {
    skin: &'a Skin,
    pressed: &'a PressedSkin<'a>,
}

impl WithPower for Reflection<'_> {
    type Output = Vec<[f32; 3]>;

    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> Vec<[f32; 3]> {
        let Self { skin, pressed: PressedSkin { region, normals, .. } } = self;
        let (diffuse, specular) = (skin.phong.diffuse as f32, skin.phong.specular as f32);
        let of = |(at, normal): (usize, &[f32; 3])| {
            let index = skin.index(*region, at);
            let to_camera = skin.to_camera[index];
            let mut sum = [0.0; 3];
            for led in &skin.leds {
                let (towards, strength) = (led.towards[index], led.strength[index]);
                let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                let along = dot(*normal, towards);
                // R.V of R = 2 (N.l) N - l; what is lit from behind gleams no more.
                let mirrored =
                    if along > 0.0 { 2.0 * along * dot(*normal, to_camera) - dot(towards, to_camera) } else { 0.0 };
                let given = strength * reflected([along, mirrored], diffuse, specular, power);
                (0..3).for_each(|k| sum[k] += given * led.color[k]);
            }
            sum
        };
        normals.iter().enumerate().map(of).collect()
    }
}
