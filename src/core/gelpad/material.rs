//! Material of a gelpad.

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
