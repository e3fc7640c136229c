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
use crate::core::base::simd::simd_dispatch;
use crate::core::base::view::View;

/// Pixels that are shaded at once.
const LANES: usize = 8;

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
    to_camera: [Vec<f32>; 3],
    /// What the LEDs give at rest, to be taken off: red, green and blue of each pixel.
    at_rest: [Vec<f32>; 3],
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
    towards: [Vec<f32>; 3],
    strength: Vec<f32>,
}

/// A pressed skin, as the pixels of a part of the image show it, row-major.
pub struct PressedSkin<'a> {
    /// The part.
    pub region: Rect,
    /// Towards the inside of the gel, a plane per component.
    pub normals: [&'a [f32]; 3],
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
        let planes = |of: &dyn Fn(&SkinPoint) -> DVec3, without: DVec3| {
            [0, 1, 2]
                .map(|k| points.iter().map(|point| point.as_ref().map_or(without, of)[k] as f32).collect::<Vec<_>>())
        };
        let mut skin = Self {
            phong,
            width,
            leds,
            to_camera: planes(&|point| point.to_camera, DVec3::ZERO),
            at_rest: [(); 3].map(|()| vec![0.0; points.len()]),
            darkening_per_mm: light.darkening_per_mm(&phong) as f32,
            stray_light: light.stray_light.map(|stray| stray.map(|share| share as f32)),
        };
        if phong.equation == Equation::Relative {
            let normals = planes(&|point| -point.site.normal, DVec3::NEG_Z);
            let region = Rect::whole(width, points.len() / width.max(1));
            let normals = normals.each_ref().map(|plane| &plane[..]);
            skin.at_rest = skin.reflected(&PressedSkin { region, normals, displaced_mm: &[] });
        }
        skin
    }

    /// True if the light changes with the depth alone.
    pub fn darkens(&self) -> bool {
        self.darkening_per_mm > 0.0
    }

    /// What the LEDs give: red, green and blue of each pixel.
    fn reflected(&self, pressed: &PressedSkin<'_>) -> [Vec<f32>; 3] {
        with_power(self.phong.shininess, Reflection { skin: self, pressed })
    }

    /// The light of the untouched skin over its picture.
    pub fn untouched(&self, rest: &BackgroundImage, normals: [&[f32]; 3]) -> Light {
        let displaced_mm = vec![0.0; normals[0].len()];
        let region = Rect::whole(rest.width, rest.height);
        self.shade(&PressedSkin { region, normals, displaced_mm: &displaced_mm }, rest, false)
    }

    /// The light of a pressed skin over the picture of the untouched one; it `darkens` with depth unless that is left out.
    pub fn shade(&self, pressed: &PressedSkin<'_>, rest: &BackgroundImage, darkens: bool) -> Light {
        let region = pressed.region;
        let darkening_per_mm = if darkens { self.darkening_per_mm } else { 0.0 };
        let mut light = rest.light(region);
        let reflected = self.reflected(pressed);
        let (ambient, width) = (self.phong.ambient as f32, region.width());
        for (channel, (plane, reflected)) in light.planes.iter_mut().zip(&reflected).enumerate() {
            let stray = self.stray_light.map(|stray| stray[channel]);
            simd_dispatch(
                #[inline(always)]
                || {
                    for row in 0..region.height() {
                        let here = row * width..(row + 1) * width;
                        let at_rest = &self.at_rest[channel][self.index(region, row)..][..width];
                        let pixels = plane[here.clone()].iter_mut().zip(&reflected[here.clone()]).zip(at_rest);
                        for (((value, reflected), at_rest), displaced_mm) in pixels.zip(&pressed.displaced_mm[here]) {
                            let kept = 1.0 - darkening_per_mm * displaced_mm;
                            let scale = stray.map_or(1.0, |stray| (*value - stray).max(0.0));
                            *value = kept * (ambient * *value + scale * (reflected - at_rest));
                        }
                    }
                },
            );
        }
        light
    }

    /// Number in the image of the first pixel of a row of a part of it.
    #[inline(always)]
    fn index(&self, region: Rect, row: usize) -> usize {
        (region.y0 + row) * self.width + region.x0
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
        let (towards, strength): (Vec<[f32; 3]>, _) = points.iter().map(lit).unzip();
        let towards = [0, 1, 2].map(|k| towards.iter().map(|towards| towards[k]).collect());
        Self { color: led.color.map(|share| (share * led.intensity) as f32), towards, strength }
    }
}

struct Reflection<'a> {
    skin: &'a Skin,
    pressed: &'a PressedSkin<'a>,
}

impl WithPower for Reflection<'_> {
    type Output = [Vec<f32>; 3];

    fn run(self, power: impl Fn(f32) -> f32 + Copy) -> [Vec<f32>; 3] {
        let Self { skin, pressed: PressedSkin { region, .. } } = self;
        let mut sums = [(); 3].map(|()| vec![0.0; region.area()]);
        simd_dispatch(
            #[inline(always)]
            || {
                for row in 0..region.height() {
                    for led in &skin.leds {
                        self.add_row(led, row, power, &mut sums);
                    }
                }
            },
        );
        sums
    }
}

impl Reflection<'_> {
    /// Adds what an LED gives along a row of the part, eight pixels at a time.
    #[inline(always)]
    fn add_row(&self, led: &LitSkin, row: usize, power: impl Fn(f32) -> f32 + Copy, sums: &mut [Vec<f32>; 3]) {
        let Self { skin, pressed: PressedSkin { region, normals, .. } } = self;
        let (width, first) = (region.width(), skin.index(*region, row));
        let normals = normals.map(|plane| &plane[row * width..][..width]);
        let towards = led.towards.each_ref().map(|plane| &plane[first..][..width]);
        let to_camera = skin.to_camera.each_ref().map(|plane| &plane[first..][..width]);
        let strength = &led.strength[first..][..width];
        let phong = [skin.phong.diffuse as f32, skin.phong.specular as f32];
        let [red, green, blue] = sums.each_mut().map(|sum| &mut sum[row * width..][..width]);
        let whole = width / LANES * LANES;
        for x in (0..whole).step_by(LANES) {
            let ([nx, ny, nz], [lx, ly, lz]) =
                (normals.map(|plane| eight(plane, x)), towards.map(|plane| eight(plane, x)));
            let ([vx, vy, vz], strength) = (to_camera.map(|plane| eight(plane, x)), eight(strength, x));
            let given: [f32; LANES] = std::array::from_fn(|k| {
                strength[k] * given([nx[k], ny[k], nz[k]], [lx[k], ly[k], lz[k]], [vx[k], vy[k], vz[k]], phong, power)
            });
            for (sum, share) in [&mut *red, &mut *green, &mut *blue].into_iter().zip(led.color) {
                sum[x..x + LANES].iter_mut().zip(given).for_each(|(sum, given)| *sum += given * share);
            }
        }
        for x in whole..width {
            let at = |planes: [&[f32]; 3]| planes.map(|plane| plane[x]);
            let given = strength[x] * given(at(normals), at(towards), at(to_camera), phong, power);
            for (sum, share) in [&mut *red, &mut *green, &mut *blue].into_iter().zip(led.color) {
                sum[x] += given * share;
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
