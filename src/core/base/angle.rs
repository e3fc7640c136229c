//! Angles that are exact where they must be.

/// Sine and cosine of an angle in degrees, exact at quarter turns and the same on every machine.
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
