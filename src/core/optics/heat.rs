//! Light that runs along a gel from an LED at its rim: the direction from which it comes at each point of the skin.
//!
//! Light spreads through the gel's thin layer like heat, and comes from where it is denser (Crane, Weischedel and
//! Wardetzky 2013, "Geodesics in Heat"). On a gel that is round about its axis, the density is a sum over waves around
//! that axis. Each wave follows an equation in one dimension, along the meridian.

use std::f64::consts::PI;

use crate::base::gel::{GelShape, Site};
use glam::DVec3;
use on_mesh::HeatOnMesh;
use round::HeatOnRound;

mod on_mesh;
mod remesh;
mod round;

/// Standard deviation of the LED's width at the rim, rad.
const LED_WIDTH_RAD: f64 = 0.15;
/// Distance over which light falls to 1 / e in the layer, in radii of the gel. Where two ways to the LED differ by less
/// than that, light comes from both.
const REACH: f64 = 0.2;

/// How steeply light falls off that spreads on its way around a ball, as a fraction of light along a line: this or
/// less.
const SPREAD: f64 = 0.97;

/// Directions of light over a gel from LEDs at its rim.
pub(super) enum Heat {
    Round(HeatOnRound),
    Mesh(HeatOnMesh),
}

impl Heat {
    /// Prepares the directions of light from LEDs at these azimuths, rad.
    pub fn new(shape: &GelShape, azimuths: impl Iterator<Item = f64>) -> Self {
        match shape {
            GelShape::Mesh(surface) => Self::Mesh(HeatOnMesh::new(surface, azimuths)),
            GelShape::Dome(_) | GelShape::Capsule(_) => Self::Round(HeatOnRound::new(shape)),
        }
    }

    /// Returns the direction along the gel towards an LED at one of the azimuths, of length 1 at most, and how far it
    /// is, mm.
    pub fn direction_and_distance_mm(&self, site: Site, azimuth: f64) -> (DVec3, f64) {
        match self {
            Self::Round(heat) => heat.direction_and_distance_mm(site, azimuth),
            Self::Mesh(heat) => heat.direction_and_distance_mm(site.point_mm, site.normal, azimuth),
        }
    }
}

/// Returns the size of an angle without whole turns, rad: 0 to pi.
fn wrap_angle(angle: f64) -> f64 {
    (angle - 2.0 * PI * libm::round(angle / (2.0 * PI))).abs()
}
