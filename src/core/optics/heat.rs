//! Light that runs along a gel from an LED at its rim: from where it comes at each point of the skin.
//!
//! Light spreads through the gel's thin layer like heat, and comes from where it is denser (Crane, Weischedel and Wardetzky 2013, "Geodesics in Heat").
//! On a gel that is round about its axis, the density is a sum over waves around that axis, each of which
//! follows an equation in one dimension, along the meridian.

use std::f64::consts::PI;

use crate::base::gel::{GelShape, Site};
use glam::DVec3;
use on_mesh::HeatOnMesh;
use round::HeatOnRound;

mod even_mesh;
mod on_mesh;
mod round;

/// Width of the LED at the rim, rad: the standard deviation.
const LED_RAD: f64 = 0.15;
/// How far light goes in the layer before it is 1 / e, in radii of the gel: where two ways are as short as each other, light comes
/// from both over as much.
const REACH: f64 = 0.2;

/// Light that spreads on the way around a ball is so much less steep than light along a line, at least.
const SPREAD: f64 = 0.97;

/// Directions of light over a gel from LEDs at its rim.
pub(super) enum Heat {
    Round(HeatOnRound),
    Mesh(HeatOnMesh),
}

impl Heat {
    /// Of LEDs at these azimuths.
    pub fn new(shape: &GelShape, azimuths: impl Iterator<Item = f64>) -> Self {
        match shape {
            GelShape::Mesh(surface) => Self::Mesh(HeatOnMesh::new(surface, azimuths)),
            GelShape::Dome(_) | GelShape::Capsule(_) => Self::Round(HeatOnRound::new(shape)),
        }
    }

    /// Towards an LED at one of the azimuths along the gel, of length 1 at most, and how far it is, mm.
    pub fn at(&self, site: Site, azimuth: f64) -> (DVec3, f64) {
        match self {
            Self::Round(heat) => heat.at(site, azimuth),
            Self::Mesh(heat) => heat.at(site.point_mm, site.normal, azimuth),
        }
    }
}

/// An angle, whichever way it turns, without whole turns.
fn half_turn(angle: f64) -> f64 {
    (angle - 2.0 * PI * libm::round(angle / (2.0 * PI))).abs()
}
