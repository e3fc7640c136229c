//! Light on a gel that is not flat: each point of the skin sees its LEDs from directions of its own.
//!
//! Diffuse and specular reflection are those of [`super::phong`], with the camera at its real place. An LED's light
//! comes straight from the LED, and its brightness falls with the square of the distance, 1 at the gel's tip. The light
//! of an LED without a position runs along the gel (`heat.rs`).

use glam::DVec3;

use super::Illumination;
use super::background::{BackgroundImage, RenderedBackground};
use super::heat::Heat;
use super::led::Led;
use super::phong::{Equation, Phong, Shadows};
use super::shadow::ShadowCaster;
use crate::base::angle::sin_cos_deg;
use crate::base::gel::{GelShape, Site};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::simd_dispatch;
use crate::base::site::SurfaceFrame;
use crate::base::view::View;
use reflection::{LANES, SkinReflectionTask};

mod reflection;

/// A point of the untouched gel that a pixel shows.
#[derive(Clone, Copy, Debug)]
pub struct SkinPoint {
    /// The point.
    pub site: Site,
    /// Unit vector towards the camera.
    pub to_camera: DVec3,
}

/// Light on the skin, prepared for one sensor.
pub struct SkinShader {
    phong: Phong,
    width: usize,
    led_params: Vec<Led>,
    rim_light: RimLight,
    led_light: Vec<SkinLedLight>,
    /// Unit vectors towards the camera, a plane per component; 0 where there is no gel.
    to_camera: [Vec<f32>; 3],
    /// Light of the LEDs at rest, to be subtracted: red, green and blue of each pixel.
    at_rest: [Vec<f32>; 3],
    /// Fraction of the light that is lost per mm of displacement.
    darkening_per_mm: f32,
    stray_light: Option<[f32; 3]>,
}

/// The light of LEDs at the rim of a gel; empty if there are none.
pub struct RimLight(Option<Heat>);

impl RimLight {
    /// Prepares the light of those among `leds` that have no position.
    pub(crate) fn new(leds: &[Led], shape: &GelShape) -> Self {
        let at_rim = || leds.iter().filter(|led| led.position_mm.is_none());
        let azimuths = at_rim().map(|led| led.azimuth_deg.to_radians());
        Self(at_rim().next().is_some().then(|| Heat::new(shape, azimuths)))
    }
}

/// The light of an LED that reaches the skin.
struct SkinLedLight {
    /// Colour times intensity.
    color: [f32; 3],
    /// Direction towards it from each pixel's point, of length 1 at most, a plane per component; 0 where there is no
    /// gel.
    directions: [Vec<f32>; 3],
    /// Brightness at each pixel's point; 0 where there is no gel.
    strength: Vec<f32>,
}

/// A pressed skin, as the pixels of a part of the image show it, row-major.
pub struct PressedSkin<'a> {
    /// The part of the image.
    pub region: Rect,
    /// Unit normals towards the inside of the gel, a plane per component.
    pub normals: [&'a [f32]; 3],
    /// How far the skin is pressed in, mm.
    pub displacement_mm: &'a [f32],
    /// The share of each LED that each pixel sees; empty, or `None`, where all of it is seen.
    pub visible_shares: &'a [Option<Vec<f32>>],
    /// Pixels within which the skin bends.
    pub bent: &'a [BentSkin],
}

/// A pixel within which the skin bends.
pub struct BentSkin {
    /// Its number in the part, row by row.
    pub index: usize,
    /// Weight of the mean over the pixel against the value at its centre, above 0 and at most 1.
    pub weight: f32,
    /// Unit normals at the samples, towards the inside of the gel: a plane per component.
    pub normals: [[f32; LANES]; 3],
}

impl SkinShader {
    /// Prepares the light on the points of a gel that the pixels of an image, `width` in a row, show row by row.
    pub(crate) fn new(
        phong: Phong,
        light: &Illumination<'_>,
        rim_light: RimLight,
        points: &[Option<SkinPoint>],
        width: usize,
    ) -> Self {
        let led_light = light.leds.iter().map(|led| SkinLedLight::new(led, &rim_light, points)).collect();
        let planes = |of: &dyn Fn(&SkinPoint) -> DVec3, without: DVec3| {
            [0, 1, 2]
                .map(|k| points.iter().map(|point| point.as_ref().map_or(without, of)[k] as f32).collect::<Vec<_>>())
        };
        let mut skin = Self {
            phong,
            width,
            led_params: light.leds.to_vec(),
            rim_light,
            led_light,
            to_camera: planes(&|point| point.to_camera, DVec3::ZERO),
            at_rest: [(); 3].map(|()| vec![0.0; points.len()]),
            darkening_per_mm: light.darkening_per_mm(&phong) as f32,
            stray_light: light.stray_light.map(|stray| stray.map(|share| share as f32)),
        };
        if phong.equation == Equation::Relative {
            let normals = planes(&|point| -point.site.normal, DVec3::NEG_Z);
            let region = Rect::whole(width, points.len() / width.max(1));
            let normals = normals.each_ref().map(|plane| &plane[..]);
            skin.at_rest = skin.compute_reflection(&PressedSkin {
                region,
                normals,
                displacement_mm: &[],
                visible_shares: &[],
                bent: &[],
            });
        }
        skin
    }

    /// Returns how the model of the light casts shadows.
    pub(crate) fn shadows(&self) -> Shadows {
        self.phong.shadows
    }

    /// Returns what casts each LED's shadows on a chart whose nodes are `mm_per_px` apart, around the point `rest` of
    /// the gel.
    ///
    /// Light from the rim comes as light does over a flat pad. LEDs inside the gel cast no shadows: compared with
    /// traced rays, shadows of one direction for all of a press were farther off than none.
    pub(crate) fn shadow_casters(&self, rest: &SurfaceFrame, mm_per_px: [f64; 2]) -> Vec<ShadowCaster> {
        const OVERHEAD_DEG: f64 = 90.0;
        let caster = |led: &Led| {
            if led.position_mm.is_some() {
                // Straight overhead it casts no shadow.
                return ShadowCaster::new(0.0, OVERHEAD_DEG, [0.0; 2], mm_per_px);
            }
            let (towards, _) = direction_to_led(led, &self.rim_light, &rest.site());
            let [x, y] = rest.tangents.map(|tangent| tangent.dot(towards));
            let azimuth_deg = libm::atan2(y, x).to_degrees();
            let elevation_deg = libm::atan2(-rest.normal.dot(towards), libm::hypot(x, y)).to_degrees();
            ShadowCaster::new(azimuth_deg, elevation_deg, led.angular_size_deg, mm_per_px)
        };
        self.led_params.iter().map(caster).collect()
    }

    /// Returns true if the light changes with the depth alone.
    pub(crate) fn darkens_with_depth(&self) -> bool {
        self.darkening_per_mm > 0.0
    }

    /// Computes the light of the LEDs: red, green and blue of each pixel.
    fn compute_reflection(&self, pressed: &PressedSkin<'_>) -> [Vec<f32>; 3] {
        SkinReflectionTask { skin: self, pressed }.run()
    }

    /// Computes the light of the untouched skin over its picture.
    pub(crate) fn untouched_light(&self, rest: &BackgroundImage, normals: [&[f32]; 3]) -> Light {
        let displacement_mm = vec![0.0; normals[0].len()];
        let region = Rect::whole(rest.width, rest.height);
        let skin = PressedSkin { region, normals, displacement_mm: &displacement_mm, visible_shares: &[], bent: &[] };
        self.shade(&skin, rest, false)
    }

    /// Computes the light of a pressed skin over the picture of the untouched one, `rest`; it darkens with depth only
    /// with `darkens`.
    pub(crate) fn shade(&self, pressed: &PressedSkin<'_>, rest: &BackgroundImage, darkens: bool) -> Light {
        let region = pressed.region;
        let darkening_per_mm = if darkens { self.darkening_per_mm } else { 0.0 };
        let mut light = rest.light(region);
        let reflected = self.compute_reflection(pressed);
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
                        let (at_rest, mm) =
                            (&at_rest[self.pixel_index(region, row)..][..width], &pressed.displacement_mm[here]);
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

    /// Returns the number in the image of the first pixel of a row of a part of it.
    #[inline(always)]
    fn pixel_index(&self, region: Rect, row: usize) -> usize {
        (region.y0 + row) * self.width + region.x0
    }
}

/// Renders the picture of an untouched skin without a photograph: black where there is no gel.
pub fn render_untouched(
    look: &RenderedBackground,
    noise: &Grid<f32>,
    leds: &[Led],
    rim_light: &RimLight,
    points: &[Option<SkinPoint>],
    view: &View,
) -> BackgroundImage {
    let glow = |number: usize, [column, row]: [usize; 2]| {
        let (led, Some(point)) = (&leds[number], points[row * view.resolution_px[0] + column]) else { return 0.0 };
        match (led.position_mm, &rim_light.0) {
            (Some(position_mm), _) => {
                let (towards, strength) = direction_to_near_led(position_mm, point.site.point_mm);
                strength * (-point.site.normal).dot(towards).max(0.0)
            }
            (None, Some(heat)) => {
                let (_, distance_mm) = heat.direction_and_distance_mm(point.site, led.azimuth_deg.to_radians());
                libm::exp(-distance_mm / look.glow_reach_mm)
            }
            (None, None) => 0.0,
        }
    };
    let window_mm = std::array::from_fn(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
    let BackgroundImage { width, height, mut rgb, .. } =
        BackgroundImage::render_with_glow(noise, look, leds, window_mm, view, glow);
    for (pixel, point) in rgb.chunks_exact_mut(3).zip(points) {
        if point.is_none() {
            pixel.fill(0);
        }
    }
    BackgroundImage::new(width, height, rgb)
}

/// Returns the unit vector towards an LED at a position, and its brightness, 1 at the gel's tip.
fn direction_to_near_led(position_mm: [f64; 3], point_mm: DVec3) -> (DVec3, f64) {
    const NEAREST_MM2: f64 = 1e-6;
    let position = DVec3::from_array(position_mm);
    let to_led = position - point_mm;
    let strength = position.length_squared().max(NEAREST_MM2) / to_led.length_squared().max(NEAREST_MM2);
    (to_led.normalize_or(DVec3::NEG_Z), strength)
}

/// Returns the direction towards an LED from a point of the gel, of length 1 at most, and its brightness.
fn direction_to_led(led: &Led, rim_light: &RimLight, site: &Site) -> (DVec3, f64) {
    let (sin, cos) = sin_cos_deg(led.elevation_deg);
    match (led.position_mm, &rim_light.0) {
        (Some(position_mm), _) => direction_to_near_led(position_mm, site.point_mm),
        (None, Some(heat)) => {
            (cos * heat.direction_and_distance_mm(*site, led.azimuth_deg.to_radians()).0 - sin * site.normal, 1.0)
        }
        (None, None) => (DVec3::ZERO, 0.0),
    }
}

impl SkinLedLight {
    fn new(led: &Led, rim_light: &RimLight, points: &[Option<SkinPoint>]) -> Self {
        let lit = |point: &Option<SkinPoint>| {
            let Some(SkinPoint { site, .. }) = point else { return ([0.0; 3], 0.0) };
            let (towards, strength) = direction_to_led(led, rim_light, site);
            (towards.as_vec3().to_array(), strength as f32)
        };
        let (towards, strength): (Vec<[f32; 3]>, _) = points.iter().map(lit).unzip();
        let towards = [0, 1, 2].map(|k| towards.iter().map(|towards| towards[k]).collect());
        Self { color: led.color.map(|share| (share * led.intensity) as f32), directions: towards, strength }
    }
}
