//! What a gelpad is made of, and what is pressed into it.

use super::elastic::shear::Friction;
use super::elastic::soft::Soft;

/// The elastomer of a pad, bonded to a rigid shell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Thickness over the shell, mm, above 0.
    pub thickness_mm: f64,
    /// Young's modulus, kPa, above 0.
    pub youngs_modulus_kpa: f64,
    /// Poisson ratio, 0 to 0.4999.
    pub poisson_ratio: f64,
}

/// What an object is made of, as far as it is not what others are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMaterial {
    /// How it gives way; `None`: it is rigid.
    pub soft: Option<Soft>,
    /// What holds the pad to it, where anything holds pads to objects; `None`: what holds them all.
    pub friction: Option<Friction>,
}
