//! The light on a gel that is not flat: each point of the skin sees its LEDs from directions of its own.
//!
//! Diffuse and specular reflection are those of [`super::phong`], with the camera where it is. An LED's light comes straight from
//! where the LED is, its brightness falling with the square of the distance, 1 at the gel's tip; or it runs along the gel
//! (`heat.rs`).

use glam::DVec3;

use super::Illumination;
use super::background::{BackgroundImage, RenderedBackground};
use super::heat::Heat;
use super::led::Led;
use super::phong::{Equation, Phong, Shadows, with_power};
use super::shadow::Caster;
use crate::base::angle::sin_cos_deg;
use crate::base::gel::{GelShape, Site};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::site::Rest;
use crate::base::view::View;
use reflection::{LANES, Reflection};

mod reflection;

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
    lamps: Vec<Led>,
    along_gel: AlongGel,
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
    pub(crate) fn new(leds: &[Led], shape: &GelShape) -> Self {
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
    /// The share of each LED that each pixel sees; empty, or `None`, for all of it.
    pub visible: &'a [Option<Vec<f32>>],
    /// Pixels within which it bends.
    pub bent: &'a [BentSkin],
}

/// A pixel within which the skin bends.
pub struct BentSkin {
    /// Its number in the part.
    pub at: usize,
    /// Weight of what is between pixel centres against the centre itself, over 0 to 1.
    pub weight: f32,
    /// Unit normals there, towards the inside of the gel: a plane per component.
    pub normals: [[f32; LANES]; 3],
}

impl Skin {
    /// Of a gel whose points the pixels of an image show, row by row.
    pub(crate) fn new(
        phong: Phong,
        light: &Illumination<'_>,
        along_gel: AlongGel,
        points: &[Option<SkinPoint>],
        width: usize,
    ) -> Self {
        let leds = light.leds.iter().map(|led| LitSkin::new(led, &along_gel, points)).collect();
        let planes = |of: &dyn Fn(&SkinPoint) -> DVec3, without: DVec3| {
            [0, 1, 2]
                .map(|k| points.iter().map(|point| point.as_ref().map_or(without, of)[k] as f32).collect::<Vec<_>>())
        };
        let mut skin = Self {
            phong,
            width,
            lamps: light.leds.to_vec(),
            along_gel,
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
            skin.at_rest = skin.reflected(&PressedSkin { region, normals, displaced_mm: &[], visible: &[], bent: &[] });
        }
        skin
    }

    /// The shadows that its model of light has.
    pub(crate) fn shadows(&self) -> Shadows {
        self.phong.shadows
    }

    /// What casts each LED's shadows on a chart whose nodes are `mm_per_px` apart, around a point of the gel with the chart's
    /// directions there. Light from the rim comes as light does over a flat pad; LEDs inside the gel cast none: held against rays,
    /// shadows of one direction for all of a press were farther off than none.
    pub(crate) fn casters(&self, rest: &Rest, mm_per_px: [f64; 2]) -> Vec<Caster> {
        const OVERHEAD_DEG: f64 = 90.0;
        let caster = |led: &Led| {
            if led.position_mm.is_some() {
                return Caster::new(0.0, OVERHEAD_DEG, [0.0; 2], mm_per_px);
            }
            let (towards, _) = towards(led, &self.along_gel, &rest.site());
            let [x, y] = rest.tangents.map(|tangent| tangent.dot(towards));
            let azimuth_deg = libm::atan2(y, x).to_degrees();
            let elevation_deg = libm::atan2(-rest.normal.dot(towards), libm::hypot(x, y)).to_degrees();
            Caster::new(azimuth_deg, elevation_deg, led.angular_size_deg, mm_per_px)
        };
        self.lamps.iter().map(caster).collect()
    }

    /// True if the light changes with the depth alone.
    pub(crate) fn darkens(&self) -> bool {
        self.darkening_per_mm > 0.0
    }

    /// What the LEDs give: red, green and blue of each pixel.
    fn reflected(&self, pressed: &PressedSkin<'_>) -> [Vec<f32>; 3] {
        with_power(self.phong.shininess, Reflection { skin: self, pressed })
    }

    /// The light of the untouched skin over its picture.
    pub(crate) fn untouched(&self, rest: &BackgroundImage, normals: [&[f32]; 3]) -> Light {
        let displaced_mm = vec![0.0; normals[0].len()];
        let region = Rect::whole(rest.width, rest.height);
        let skin = PressedSkin { region, normals, displaced_mm: &displaced_mm, visible: &[], bent: &[] };
        self.shade(&skin, rest, false)
    }

    /// The light of a pressed skin over the picture of the untouched one; it `darkens` with depth unless that is left out.
    pub(crate) fn shade(&self, pressed: &PressedSkin<'_>, rest: &BackgroundImage, darkens: bool) -> Light {
        let region = pressed.region;
        let darkening_per_mm = if darkens { self.darkening_per_mm } else { 0.0 };
        let mut light = rest.light(region);
        let reflected = self.reflected(pressed);
        let (ambient, width) = (self.phong.ambient as f32, region.width());
        for (channel, (plane, reflected)) in light.planes.iter_mut().zip(&reflected).enumerate() {
            let stray = self.stray_light.map(|stray| stray[channel]);
            let (plane, reflected) = (&mut plane[..], &reflected[..]);
            let at_rest = &self.at_rest[channel][..];
            simd_dispatch(
                #[inline(always)]
                move || {
                    for row in 0..region.height() {
                        let here = row * width..(row + 1) * width;
                        let (plane, reflected) = (&mut plane[here.clone()], &reflected[here.clone()]);
                        let (at_rest, mm) = (&at_rest[self.index(region, row)..][..width], &pressed.displaced_mm[here]);
                        for x in 0..width {
                            let kept = 1.0 - darkening_per_mm * mm[x];
                            let scale = stray.map_or(1.0, |stray| (plane[x] - stray).max(0.0));
                            plane[x] = kept * (ambient * plane[x] + scale * (reflected[x] - at_rest[x]));
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
    let glow = |number: usize, [column, row]: [usize; 2]| {
        let (led, Some(point)) = (&leds[number], points[row * view.resolution_px[0] + column]) else { return 0.0 };
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

/// Towards an LED from a point of the gel, of length 1 at most, and its brightness.
fn towards(led: &Led, along_gel: &AlongGel, site: &Site) -> (DVec3, f64) {
    let (sin, cos) = sin_cos_deg(led.elevation_deg);
    match (led.position_mm, &along_gel.0) {
        (Some(position_mm), _) => straight(position_mm, site.point_mm),
        (None, Some(heat)) => (cos * heat.at(*site, led.azimuth_deg.to_radians()).0 - sin * site.normal, 1.0),
        (None, None) => (DVec3::ZERO, 0.0),
    }
}

impl LitSkin {
    fn new(led: &Led, along_gel: &AlongGel, points: &[Option<SkinPoint>]) -> Self {
        let lit = |point: &Option<SkinPoint>| {
            let Some(SkinPoint { site, .. }) = point else { return ([0.0; 3], 0.0) };
            let (towards, strength) = towards(led, along_gel, site);
            (towards.as_vec3().to_array(), strength as f32)
        };
        let (towards, strength): (Vec<[f32; 3]>, _) = points.iter().map(lit).unzip();
        let towards = [0, 1, 2].map(|k| towards.iter().map(|towards| towards[k]).collect());
        Self { color: led.color.map(|share| (share * led.intensity) as f32), towards, strength }
    }
}
