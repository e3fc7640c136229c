//! Closed forms of frictionless contact. Young's modulus in kPa, lengths in mm, so that pressures are in kPa and forces
//! in mN. `stiffness` is E / (1 - nu^2), the plane-strain modulus.
//!
//! K. L. Johnson, Contact Mechanics, Cambridge 1985: chapters 3 to 5; I. N. Sneddon, Int. J. Eng. Sci. 3 (1965) 47;
//! for thin layers J. S. Jaffar, Int. J. Mech. Sci. 31 (1989) 229 and J. R. Barber, Contact Mechanics, Springer 2018.

use std::f64::consts::PI;

/// What an axially symmetric object does to a pad.
#[derive(Clone, Copy, Debug)]
pub struct Round {
    /// mN.
    pub force: f64,
    /// Of the contact, mm.
    pub radius: f64,
    /// kPa; infinite for points and edges.
    pub peak: f64,
}

/// A paraboloid of radius of curvature `radius`, `deep` into a half-space (Johnson, section 4.2).
pub fn hertz(stiffness: f64, radius: f64, deep: f64) -> Round {
    let a = (radius * deep).sqrt();
    Round { force: 4.0 / 3.0 * stiffness * a * deep, radius: a, peak: 2.0 * stiffness * a / (PI * radius) }
}

/// How deep the surface lies under and around a paraboloid, at `r` from its axis (Johnson, equations 3.41, 3.42).
pub fn hertz_surface(radius: f64, deep: f64, r: f64) -> f64 {
    let a = (radius * deep).sqrt();
    if r <= a {
        return deep - r * r / (2.0 * radius);
    }
    ((2.0 * a * a - r * r) * (a / r).asin() + a * (r * r - a * a).sqrt()) / (PI * radius)
}

/// A cone whose flank falls by `slope` mm per mm (Sneddon).
pub fn cone(stiffness: f64, slope: f64, deep: f64) -> Round {
    let a = 2.0 * deep / (PI * slope);
    Round { force: stiffness * a * deep, radius: a, peak: f64::INFINITY }
}

/// A flat-ended cylinder of radius `radius` (Johnson, section 3.4; Boussinesq).
pub fn punch(stiffness: f64, radius: f64, deep: f64) -> Round {
    Round { force: 2.0 * stiffness * radius * deep, radius, peak: f64::INFINITY }
}

/// How deep the surface lies around a flat punch.
pub fn punch_surface(radius: f64, deep: f64, r: f64) -> f64 {
    if r <= radius { deep } else { deep * 2.0 / PI * (radius / r).asin() }
}

/// Half-width of the contact and peak pressure of a long cylinder of radius `radius` under `load` mN per mm (Johnson,
/// section 4.2).
pub fn long_cylinder(stiffness: f64, radius: f64, load: f64) -> [f64; 2] {
    let a = (4.0 * load * radius / (PI * stiffness)).sqrt();
    [a, 2.0 * load / (PI * a)]
}

/// A paraboloid in an incompressible bonded layer much thinner than the contact is wide: the pad flows out like a
/// viscous film, 3 mu w = - h^3 div grad p, with no pressure and no slope of it at the rim.
pub fn thin_incompressible(shear_modulus: f64, thickness: f64, radius: f64, deep: f64) -> Round {
    let h3 = thickness.powi(3);
    Round {
        force: 2.0 * PI * shear_modulus * radius * radius * deep.powi(3) / h3,
        radius: 2.0 * (radius * deep).sqrt(),
        peak: 1.5 * shear_modulus * radius * deep * deep / h3,
    }
}

/// A paraboloid in a compressible bonded layer much thinner than the contact is wide: columns that cannot widen, of
/// modulus `column` (Johnson, section 5.8).
pub fn thin_compressible(column: f64, thickness: f64, radius: f64, deep: f64) -> Round {
    Round {
        force: PI * radius * deep * deep * column / thickness,
        radius: (2.0 * radius * deep).sqrt(),
        peak: column * deep / thickness,
    }
}

/// Modulus of a column that cannot widen.
pub fn column(youngs_modulus: f64, nu: f64) -> f64 {
    youngs_modulus * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
}
