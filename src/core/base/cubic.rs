//! Cubic interpolation between equally spaced values.

/// Returns the weights of four equally spaced values at the position `t`, 0 to 1, between the second and the third one
/// (Catmull and Rom 1974).
#[inline(always)]
pub fn catmull_rom(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [-0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5), -0.5 * s * t * t]
}
