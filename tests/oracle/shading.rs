//! Phong's light in f64, written out from the equations of the method.

use gelsim::core::optics::led::Led;
use gelsim::core::optics::phong::{Equation, Phong};
use gelsim::files::sensor::Sensor;

/// Phong shading as the paper has it, of a surface that displaces the pad by `slope` mm per mm along x and y, under
/// one LED of intensity 1.
pub fn phong(slope: [f64; 2], led: &Led, constants: &Phong) -> f64 {
    // f is the height of the surface over the shell: it falls where the displacement grows.
    let [fx, fy] = slope.map(|s| -s);
    let length = (fx * fx + fy * fy + 1.0).sqrt();
    let n = [fx / length, fy / length, -1.0 / length];
    let (azimuth, elevation) = (led.azimuth_deg.to_radians(), led.elevation_deg.to_radians());
    let l = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), -elevation.sin()];
    let along: f64 = n.iter().zip(l).map(|(n, l)| n * l).sum();
    let reflected: [f64; 3] = std::array::from_fn(|k| 2.0 * along * n[k] - l[k]);
    let to_camera = [0.0, 0.0, -1.0];
    let mirrored: f64 = reflected.iter().zip(to_camera).map(|(r, v)| r * v).sum();
    constants.diffuse * along.max(0.0) + constants.specular * mirrored.max(0.0).powf(constants.shininess)
}

/// What the method gives for a place on the pad, 1 = full scale.
pub fn brightness(slope: [f64; 2], displacement: f64, sensor: &Sensor, constants: &Phong, rest: [f64; 3]) -> [f64; 3] {
    let kept = 1.0 - constants.darkening.unwrap_or(sensor.darkening) * displacement / sensor.gelpad_thickness_mm;
    std::array::from_fn(|k| {
        let gain = |led: &Led| {
            let flat = match constants.equation {
                Equation::Relative => phong([0.0, 0.0], led, constants),
                Equation::Literal => 0.0,
            };
            (phong(slope, led, constants) - flat) * led.color[k] * led.intensity
        };
        let scale = sensor.stray_light.map_or(1.0, |stray| (rest[k] - stray[k]).max(0.0));
        (constants.ambient * rest[k] + scale * sensor.led.iter().map(gain).sum::<f64>()) * kept
    })
}
