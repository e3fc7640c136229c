//! `[sensor.shape]`, `[sensor.lens]` and `[sensor.pins]`: their ranges, and what of a job does not go with them.

use super::Scope;
use super::check::Check;
use crate::core::base::gel::{GelDome, GelShape};
use crate::core::camera::projection::{Fisheye, LensModel, Pinhole};
use crate::core::gelpad;
use crate::files::sensor::Sensor;
use crate::files::sensor::pins::PinDistribution;
use crate::job::config::Job;
use crate::job::layers::OutputLayer;

/// The sensor's own tables.
pub fn sensor(check: &mut Check<'_>, sensor: &Sensor) {
    if let Some(GelShape::Dome(GelDome { radius_mm })) = &sensor.shape {
        check.number("sensor.shape.dome.radius_mm", *radius_mm, 1.0..=1e6, "mm");
    }
    match &sensor.lens {
        None | Some(LensModel::Orthographic) => {}
        Some(LensModel::Pinhole(Pinhole { fov_deg, position_mm, look_at_mm })) => {
            check.number("sensor.lens.pinhole.fov_deg", *fov_deg, 1.0..=170.0, "degrees");
            place(check, "sensor.lens.pinhole", sensor, *position_mm, *look_at_mm);
        }
        Some(LensModel::Fisheye(fisheye)) => {
            check.number("sensor.lens.fisheye.fov_deg", fisheye.fov_deg, 1.0..=300.0, "degrees");
            place(check, "sensor.lens.fisheye", sensor, fisheye.position_mm, fisheye.look_at_mm);
            folded(check, fisheye);
        }
    }
    if let Some(pins) = &sensor.pins {
        self::pins(check, sensor, pins);
    }
    let known = [("shape", sensor.shape.is_some()), ("lens", sensor.lens.is_some()), ("pins", sensor.pins.is_some())];
    let has = |name: &str| known.iter().any(|(known, has)| *known == name && *has);
    for name in ["lens", "pins"] {
        if has(name) && !has("shape") {
            let message = format!("`{name}` belongs to a gel that is not flat, and this one has no shape");
            check.error(
                &format!("sensor.{name}"),
                message,
                "add [sensor.shape], for example dome = { radius_mm = 20.0 }",
            );
        }
    }
    if has("shape") && !has("pins") {
        let message = "the light on a gel that is not flat is not simulated yet: it is seen by its pins";
        let help = "add [sensor.pins]; or write [sensor.rest_shape] for a gel that is nearly flat";
        check.error("sensor.shape", message, help);
    }
    for (key, wrong) in [
        ("rest_shape", sensor.rest_shape.is_some()),
        ("grain", sensor.grain.is_some()),
        ("background", sensor.background.is_some()),
        ("calibration", sensor.calibration.is_some()),
        ("lamp", !sensor.lamp.is_empty()),
    ] {
        if has("shape") && wrong {
            let message = format!("`{key}` does not go with a gel that has a shape");
            check.error(&format!("sensor.{key}"), message, "leave one of the two out");
        }
    }
    if let Some(shape) = sensor.shape.filter(|_| check.sound("sensor")) {
        let seen = sensor.to_simulated(None, &Default::default()).projection().chart_view(&shape);
        if seen.is_none() {
            let message = "the camera sees no gel";
            check.error(
                "sensor.lens",
                message,
                "z is 0 at the gel's tip and below 0 inside: move the camera, or turn it",
            );
        }
    }
}

/// Where a camera is and looks.
fn place(check: &mut Check<'_>, at: &str, sensor: &Sensor, position_mm: [f64; 3], look_at_mm: [f64; 3]) {
    for k in 0..3 {
        check.number(&format!("{at}.position_mm.{k}"), position_mm[k], -1e4..=1e4, "mm");
        check.number(&format!("{at}.look_at_mm.{k}"), look_at_mm[k], -1e4..=1e4, "mm");
    }
    if position_mm == look_at_mm {
        check.error(
            &format!("{at}.look_at_mm"),
            "the camera looks at itself",
            "name a point before it, such as the tip",
        );
    }
    let Some(shape) = sensor.shape.filter(|_| check.sound("sensor.shape")) else { return };
    // From the ball's middle; a camera inside the skin, or beyond it, sees no picture of the skin from within.
    let [x, y, z] = position_mm;
    let radius_mm = shape.radius_mm();
    let outside_mm = libm::sqrt(x * x + y * y + (z + radius_mm) * (z + radius_mm)) - radius_mm;
    if outside_mm > -sensor.gelpad_thickness_mm && z > -radius_mm {
        let message = "the camera stands in the gel, or outside of it";
        let help = format!("the gel is {} mm thick, with its tip at z = 0", sensor.gelpad_thickness_mm);
        check.error(&format!("{at}.position_mm"), message, help);
    }
}

fn folded(check: &mut Check<'_>, fisheye: &Fisheye) {
    if check.sound("sensor.lens") && !fisheye.is_one_to_one() {
        let message = "this lens shows two directions in one place";
        check.error("sensor.lens.fisheye.k", message, "lower the coefficients, or fov_deg");
    }
}

fn pins(check: &mut Check<'_>, sensor: &Sensor, pins: &PinDistribution) {
    check.number("sensor.pins.count", f64::from(pins.count), 1.0..=10_000.0, "pins");
    check.number("sensor.pins.spacing_mm", pins.spacing_mm, 0.05..=1e3, "mm");
    check.number("sensor.pins.turn_deg", pins.turn_deg, -3600.0..=3600.0, "degrees");
    check.number("sensor.pins.length_mm", pins.length_mm, 0.0..=1e3, "mm");
    check.number("sensor.pins.diameter_mm", pins.diameter_mm, 1e-3..=100.0, "mm");
    check.number("sensor.pins.skin_smoothing_mm", pins.skin_smoothing_mm, 0.0..=100.0, "mm");
    check.number("sensor.pins.in_plane", pins.in_plane, 0.0..=1.0, "");
    check.number("sensor.pins.size_jitter", pins.size_jitter, 0.0..=0.5, "");
    check.number("sensor.pins.place_jitter_mm", pins.place_jitter_mm, 0.0..=10.0, "mm");
    if let Some(mount) = &pins.mount {
        check.number("sensor.pins.mount.radius_mm", mount.radius_mm, 1e-3..=1e4, "mm");
        check.number("sensor.pins.mount.width_mm", mount.width_mm, 0.0..=1e3, "mm");
        check.number("sensor.pins.mount.below_tip_mm", mount.below_tip_mm, 0.0..=1e4, "mm");
    }
    let sound = check.sound("sensor.pins") && check.sound("sensor.shape");
    let Some(shape) = sensor.shape.filter(|_| sound) else { return };
    let most_mm = shape.radius_mm() * std::f64::consts::FRAC_PI_2;
    if pins.reach_mm() > most_mm {
        let message = format!("the outermost pins stand {:.1} mm from the tip, over the rim", pins.reach_mm());
        let help = format!("the gel ends after {most_mm:.1} mm: lower count or spacing_mm");
        check.error("sensor.pins.spacing_mm", message, help);
    }
    if pins.length_mm >= shape.radius_mm() {
        let message = "the pins are longer than the gel's radius";
        check.error("sensor.pins.length_mm", message, format!("stay below {} mm", shape.radius_mm()));
    }
}

/// What of a job does not go with a gel that has a shape.
pub fn job(check: &mut Check<'_>, job: &Job, scope: Scope) {
    if job.sensor.shape.is_none() {
        return;
    }
    if scope != Scope::Dataset {
        let message = "this looks at flat pads, and the sensor's gel has a shape";
        check.error("sensor.shape", message, "take a flat sensor; meshes are pressed into this one by a job");
        return;
    }
    let named = check.document.get("gelpad").is_some();
    let mut refuse = |wrong: bool, path: &str, what: &str| {
        if wrong {
            let message = format!("{what} on a gel that has a shape is not simulated");
            check.error(path, message, "leave it out, or take a flat sensor");
        }
    };
    refuse(job.sequence.is_some(), "sequence", "a sequence");
    refuse(job.texture.amplitude_mm.support() != (0.0, 0.0), "texture.amplitude_mm", "texture");
    refuse(job.markers.is_some(), "markers", "print");
    let camera = &job.camera;
    for (name, quantity) in [("distortion_k1", &camera.distortion_k1), ("distortion_k2", &camera.distortion_k2)] {
        refuse(quantity.support() != (0.0, 0.0), &format!("camera.{name}"), "distortion by [camera]");
    }
    let elastic = matches!(super::chosen_models(job).gelpad, gelpad::Model::Elastic(_));
    let path = if named { "gelpad" } else { "fidelity" };
    refuse(!elastic, path, "a pad that is not elastic");
    for (i, layer) in job.output.layers.iter().enumerate() {
        let unknown = matches!(layer, OutputLayer::Gap | OutputLayer::Flow);
        refuse(unknown, &format!("output.layers.{i}"), &format!("layer `{}`", layer.name()));
    }
}
