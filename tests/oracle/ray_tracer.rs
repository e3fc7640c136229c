//! Light of LEDs on a pad of a known shape, traced ray by ray in f64.
//!
//! Places are in mm: x to the right, y down, the third axis towards the camera. The camera is infinitely far. An LED is a
//! point: it shines alike in all directions and falls off with the square of the distance, or is infinitely far as well.
//! Shadows are hard: a ray to the LED that meets the surface carries no light. Light that the surface gives back, alike in
//! all directions, is followed by random paths of any length (Kajiya 1986).

use std::f64::consts::TAU;

use super::shapes::Random;
use super::vectors::{Vector, along, dot, unit};
use gelsim_core::optics::led::Led;
use gelsim_core::optics::phong::Phong;

/// Rays start so far off the surface, mm.
const OFF_MM: f64 = 1e-7;

/// What stands on the plane that an untouched pad is.
#[derive(Clone, Copy, Debug)]
pub enum Dent {
    /// A ball of a radius, pressed in so deep, mm.
    Ball { radius: f64, deep: f64 },
    /// An upright block with a square face of half this width, pressed in so deep, mm.
    Block { half: f64, deep: f64 },
}

impl Dent {
    /// Height of the surface, mm towards the camera.
    pub fn height(self, [x, y]: [f64; 2]) -> f64 {
        match self {
            Self::Ball { radius, deep } => (deep - radius + (radius * radius - x * x - y * y).max(0.0).sqrt()).max(0.0),
            Self::Block { half, deep } => {
                if x.abs().max(y.abs()) <= half {
                    deep
                } else {
                    0.0
                }
            }
        }
    }

    /// Half the width of what is touched, mm.
    pub fn reach(self) -> f64 {
        match self {
            Self::Ball { radius, deep } => (deep * (2.0 * radius - deep)).sqrt(),
            Self::Block { half, .. } => half,
        }
    }

    /// Distance from the edge of what is touched, mm; negative inside.
    pub fn beyond_edge(self, [x, y]: [f64; 2]) -> f64 {
        match self {
            Self::Ball { .. } => x.hypot(y) - self.reach(),
            Self::Block { .. } => x.abs().max(y.abs()) - self.reach(),
        }
    }

    fn covers(self, place: Vector) -> bool {
        self.beyond_edge([place[0], place[1]]) < 0.0
    }

    /// Where a ray meets the surface first, as a multiple of its direction, and the normal there.
    fn hit(self, origin: Vector, direction: Vector) -> Option<(f64, Vector)> {
        let on_plane = (-origin[2] / direction[2], [0.0, 0.0, 1.0]);
        let plane = (on_plane.0 > 0.0 && !self.covers(along(origin, direction, on_plane.0))).then_some(on_plane);
        let object = match self {
            Self::Ball { radius, deep } => {
                let centre = [0.0, 0.0, deep - radius];
                let from = along(origin, centre, -1.0);
                let (a, b, c) = (dot(direction, direction), dot(from, direction), dot(from, from) - radius * radius);
                let root = b * b - a * c;
                let meets = |t: f64| {
                    let place = along(origin, direction, t);
                    (t > 0.0 && place[2] > 0.0).then(|| (t, unit(along(place, centre, -1.0))))
                };
                (root > 0.0).then(|| [-1.0, 1.0].into_iter().find_map(|side| meets((-b + side * root.sqrt()) / a)))
            }
            Self::Block { half, deep } => Some(block(half, deep, origin, direction)),
        };
        [plane, object.flatten()].into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// What the camera sees at a place of its image: where the surface is, and its normal.
    pub fn point_seen(self, [x, y]: [f64; 2]) -> (Vector, Vector) {
        let down = [0.0, 0.0, -1.0];
        let from = [x, y, 10.0];
        let (t, normal) = self.hit(from, down).expect("the plane has no holes");
        (along(from, down, t), normal)
    }
}

/// Where a ray enters a block that stands on the plane.
fn block(half: f64, deep: f64, origin: Vector, direction: Vector) -> Option<(f64, Vector)> {
    let (low, high) = ([-half, -half, 0.0], [half, half, deep]);
    let (mut enters, mut leaves, mut normal) = (f64::NEG_INFINITY, f64::INFINITY, [0.0; 3]);
    for k in 0..3 {
        let ends = [low[k], high[k]].map(|end| (end - origin[k]) / direction[k]);
        let [first, second] = if ends[0] < ends[1] { ends } else { [ends[1], ends[0]] };
        if first > enters {
            enters = first;
            normal = [0.0; 3];
            normal[k] = -direction[k].signum();
        }
        leaves = leaves.min(second);
    }
    (enters > 0.0 && enters < leaves).then_some((enters, normal))
}

/// An LED.
#[derive(Clone, Copy, Debug)]
pub struct Lamp {
    to_led: Vector,
    /// From the middle of the image; at infinity without.
    distance_mm: Option<f64>,
    intensity: f64,
}

/// What of its light is traced.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// A ray that meets the surface carries no light.
    pub shadows: bool,
    /// Every place is lit as if it were on the undeformed pad.
    pub regardless_of_height: bool,
}

impl Lamp {
    pub fn new(led: &Led, near: bool) -> Self {
        let (azimuth, elevation) = (led.azimuth_deg.to_radians(), led.elevation_deg.to_radians());
        let to_led = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()];
        Self { to_led, distance_mm: near.then_some(led.distance_mm), intensity: led.intensity }
    }

    /// Direction of the LED from a place, brightness there, and whether nothing is in between.
    fn light_at(self, dent: Dent, place: Vector, normal: Vector, light: Light) -> (Vector, f64, bool) {
        let lit = if light.regardless_of_height { [place[0], place[1], 0.0] } else { place };
        let (way, strength) = match self.distance_mm {
            None => (self.to_led, 1.0),
            Some(mm) => {
                let way = along(self.to_led.map(|v| v * mm), lit, -1.0);
                (way, mm * mm / dot(way, way))
            }
        };
        let free = || match dent.hit(along(place, normal, OFF_MM), way) {
            Some((t, _)) => self.distance_mm.is_some() && t > 1.0,
            None => true,
        };
        (unit(way), strength * self.intensity, !light.shadows || free())
    }

    /// N.l times brightness.
    pub fn irradiance(self, dent: Dent, (place, normal): (Vector, Vector), light: Light) -> f64 {
        let (to_led, strength, free) = self.light_at(dent, place, normal, light);
        if free { strength * dot(to_led, normal).max(0.0) } else { 0.0 }
    }

    /// Phong's light, 1 = full scale.
    pub fn phong(self, dent: Dent, (place, normal): (Vector, Vector), light: Light, constants: &Phong) -> f64 {
        let (to_led, strength, free) = self.light_at(dent, place, normal, light);
        let facing = dot(to_led, normal);
        if !free || facing <= 0.0 {
            return 0.0;
        }
        let mirrored = 2.0 * facing * normal[2] - to_led[2];
        strength * (constants.diffuse * facing + constants.specular * mirrored.max(0.0).powf(constants.shininess))
    }
}

/// What a place gets of the light that the surface gives back, a share of `albedo`, N.l times brightness: after one bounce, and
/// after all of them. The mean of so many paths.
pub fn bounced(
    dent: Dent,
    at: (Vector, Vector),
    lamps: &[Lamp],
    albedo: f64,
    paths: usize,
    random: &mut Random,
) -> [f64; 2] {
    let light = Light { shadows: true, regardless_of_height: false };
    let (mut first, mut all) = (0.0, 0.0);
    for _ in 0..paths {
        let ((mut place, mut normal), mut kept) = (at, 1.0);
        for bounce in 0.. {
            let way = scattered(normal, random);
            let Some((t, next)) = dent.hit(along(place, normal, OFF_MM), way) else { break };
            (place, normal) = (along(along(place, normal, OFF_MM), way, t), next);
            kept *= albedo;
            let got: f64 = lamps.iter().map(|lamp| lamp.irradiance(dent, (place, normal), light)).sum();
            all += kept * got;
            if bounce == 0 {
                first += kept * got;
            }
        }
    }
    [first, all].map(|sum| sum / paths as f64)
}

/// A random direction, as likely as its cosine with the normal.
fn scattered(normal: Vector, random: &mut Random) -> Vector {
    let (u, turn): (f64, f64) = (random.unit(), TAU * random.unit());
    let aside = if normal[0].abs() < 0.5 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let s = unit(along(aside, normal, -dot(aside, normal)));
    let t =
        [normal[1] * s[2] - normal[2] * s[1], normal[2] * s[0] - normal[0] * s[2], normal[0] * s[1] - normal[1] * s[0]];
    let flat = along(s.map(|v| v * turn.cos()), t, turn.sin()).map(|v| v * u.sqrt());
    along(flat, normal, (1.0 - u).sqrt())
}
