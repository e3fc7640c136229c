//! Phong's light in f64, written out from the equations of the method.

use gelsim_core::optics::led::Led;
use gelsim_core::optics::phong::{Equation, Phong};
use gelsim_files::sensor::Sensor;

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

/// What the sensor's residual adds to a channel for a surface of this slope and displacement at a place of the view, -1 to 1.
fn unexplained(slope: [f64; 2], displacement: f64, sensor: &Sensor, channel: usize, place: [f64; 2]) -> f64 {
    let Some(residual) = sensor.light_residual.as_deref() else { return 0.0 };
    let length = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
    let [mut x, mut y] = slope.map(|s| -s / length);
    let steep = x.hypot(y);
    if steep > residual.steepest {
        (x, y) = (x * residual.steepest / steep, y * residual.steepest / steep);
    }
    let w = displacement.clamp(residual.heights_mm[0], residual.heights_mm[1]);
    let dozens = [&residual.red, &residual.green, &residual.blue][channel].chunks(12);
    let of_dozen = |c: &[f64]| {
        let slopes = c[0] * y + c[1] * x + c[2] * y * y + c[3] * x * y + c[4] * x * x;
        let bends = c[5] * y * y * y + c[6] * x * y * y + c[7] * x * x * y + c[8] * x * x * x;
        slopes + bends + c[9] * w + c[10] * w * y + c[11] * w * x
    };
    dozens.zip([1.0, place[0], place[1]]).map(|(c, factor)| factor * of_dozen(c)).sum()
}

/// The factor on a channel of an LED's light at a place of the view, -1 to 1.
fn factor_at(led: &Led, channel: usize, [x, y]: [f64; 2]) -> f64 {
    let Some(pattern) = &led.pattern else { return 1.0 };
    let terms = [&pattern.red, &pattern.green, &pattern.blue][channel];
    let sum: f64 = terms.iter().zip([1.0, x, y, x * x, x * y, y * y]).map(|(c, power)| c * power).sum();
    sum.max(0.0)
}

/// What the method gives for a place of the view, -1 to 1 along each side; 1 = full scale.
pub fn brightness(
    place: [f64; 2],
    slope: [f64; 2],
    displacement: f64,
    sensor: &Sensor,
    constants: &Phong,
    rest: [f64; 3],
) -> [f64; 3] {
    let kept = 1.0 - constants.darkening.unwrap_or(sensor.darkening) * displacement / sensor.gelpad_thickness_mm;
    std::array::from_fn(|k| {
        let gain = |led: &Led| {
            let flat = match constants.equation {
                Equation::Relative => phong([0.0, 0.0], led, constants),
                Equation::Literal => 0.0,
            };
            (phong(slope, led, constants) - flat) * led.color[k] * led.intensity * factor_at(led, k, place)
        };
        let scale = sensor.stray_light.map_or(1.0, |stray| (rest[k] - stray[k]).max(0.0));
        let added = sensor.led.iter().map(gain).sum::<f64>() + unexplained(slope, displacement, sensor, k, place);
        (constants.ambient * rest[k] + scale * added) * kept
    })
}
