//! Angles with exact results where they matter: quarter turns and small rotations.

/// Computes sine and cosine of an angle in degrees, exact at quarter turns and the same on every machine.
pub fn sin_cos_deg(angle_deg: f64) -> (f64, f64) {
    let turns = libm::floor(angle_deg / 90.0 + 0.5);
    let rest = (angle_deg - 90.0 * turns).to_radians();
    let (sin, cos) = (libm::sin(rest), libm::cos(rest));
    match turns.rem_euclid(4.0) as u8 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// A rotation in the plane, from x towards y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarRotation {
    sin: f64,
    cos: f64,
    /// 1 - cos, without cancellation.
    versine: f64,
}

impl PlanarRotation {
    /// Makes the rotation by an angle, rad.
    pub fn new(angle_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(angle_rad);
        Self { sin, cos, versine: 2.0 * libm::pow(libm::sin(0.5 * angle_rad), 2.0) }
    }

    /// Rotates a direction.
    pub fn rotate(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.cos * x - self.sin * y, self.sin * x + self.cos * y]
    }

    /// Rotates a direction by the inverse rotation.
    pub fn rotate_back(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.cos * x + self.sin * y, self.cos * y - self.sin * x]
    }

    /// Returns how far the rotation moves a point, accurate for small angles.
    pub fn displacement(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [-self.versine * x - self.sin * y, -self.versine * y + self.sin * x]
    }

    /// Returns a point minus its image under the inverse rotation, accurate for small angles.
    pub fn offset_from_inverse(self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.versine * x - self.sin * y, self.versine * y + self.sin * x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact() {
        assert_eq!(sin_cos_deg(90.0), (1.0, 0.0));
        assert_eq!(sin_cos_deg(-180.0), (0.0, -1.0));
        assert_eq!(sin_cos_deg(3690.0), (1.0, 0.0));
        let (sin, cos) = sin_cos_deg(30.0);
        assert!((sin - 0.5).abs() < 1e-15 && (cos - 0.75_f64.sqrt()).abs() < 1e-15);
    }
}
