//! Cubic interpolation.

/// The shares of four values one apart at the place `t`, 0 to 1, between the second and the third (Catmull and Rom 1974).
#[inline(always)]
pub fn catmull_rom(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [-0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5), -0.5 * s * t * t]
}
