//! Checks `[sensor.shape]`, `[sensor.lens]` and `[sensor.pins]`, and what of a job does not go with them.

use glam::DVec3;

use super::Scope;
use super::check::JobChecker;
use crate::config::Job;
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::camera::projection::{Fisheye, LensModel, Pinhole};
use gelsim_files::number_format::format_number;
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::pins::{PinDistribution, PinLayout};
use gelsim_files::sensor::shape::SensorShape;

/// The greatest length of a capsule, as a multiple of its radius.
const MAX_CAPSULE_RATIO: f64 = 20.0;

/// Checks the sensor's own tables.
pub fn check_curved_sensor(check: &mut JobChecker<'_>, sensor: &Sensor) {
    match &sensor.shape {
        None => {}
        Some(SensorShape::Dome(GelDome { radius_mm })) => {
            check.require_in_range("sensor.shape.dome.radius_mm", *radius_mm, 1.0..=1e6, "mm");
        }
        Some(SensorShape::Capsule(GelCapsule { radius_mm, length_mm })) => {
            check.require_in_range("sensor.shape.capsule.radius_mm", *radius_mm, 1.0..=1e3, "mm");
            check.require_in_range("sensor.shape.capsule.length_mm", *length_mm, 1.0..=1e3, "mm");
            let longest_mm = MAX_CAPSULE_RATIO * radius_mm;
            if length_mm < radius_mm && check.is_valid("sensor.shape") {
                let message = format!("the capsule is {length_mm} mm long, and its cap alone {radius_mm}");
                let help = format!("count it from the tip to the end of the gel: length_mm = {radius_mm} at least");
                check.report_error("sensor.shape.capsule.length_mm", message, help);
            } else if *length_mm > longest_mm && check.is_valid("sensor.shape") {
                let message = format!("the capsule is {:.0} times as long as its radius", length_mm / radius_mm);
                let help = format!(
                    "allowed: up to {MAX_CAPSULE_RATIO:.0} times, {longest_mm} mm; name the part that the camera sees"
                );
                check.report_error("sensor.shape.capsule.length_mm", message, help);
            }
        }
        // A mesh was checked when its file was read.
        Some(SensorShape::Mesh(_)) => {}
    }
    match &sensor.lens {
        None | Some(LensModel::Orthographic) => {}
        Some(LensModel::Pinhole(Pinhole { fov_deg, position_mm, look_at_mm })) => {
            check.require_in_range("sensor.lens.pinhole.fov_deg", *fov_deg, 1.0..=170.0, "degrees");
            check_camera_position(check, "sensor.lens.pinhole", sensor, *position_mm, *look_at_mm);
        }
        Some(LensModel::Fisheye(fisheye)) => {
            check.require_in_range("sensor.lens.fisheye.fov_deg", fisheye.fov_deg, 1.0..=300.0, "degrees");
            check_camera_position(check, "sensor.lens.fisheye", sensor, fisheye.position_mm, fisheye.look_at_mm);
            check_fisheye(check, fisheye);
        }
    }
    if let Some(pins) = &sensor.pins {
        self::check_pins(check, sensor, pins);
    }
    let known = [("shape", sensor.shape.is_some()), ("lens", sensor.lens.is_some()), ("pins", sensor.pins.is_some())];
    let has = |name: &str| known.iter().any(|(known, has)| *known == name && *has);
    for name in ["lens", "pins"] {
        if has(name) && !has("shape") && check.is_valid("sensor.shape") {
            let message = format!("`{name}` belongs to a gel that is not flat, and this one has no shape");
            check.report_error(
                &format!("sensor.{name}"),
                message,
                "add [sensor.shape], for example dome = { radius_mm = 20.0 }",
            );
        }
    }
    for (key, wrong) in [
        ("rest_shape", sensor.rest_shape.is_some()),
        ("grain", sensor.grain.is_some()),
        ("background", sensor.background.is_some() && has("pins")),
        ("calibration", sensor.calibration.is_some()),
        ("light_residual", sensor.light_residual.is_some()),
        ("window", sensor.window.is_some()),
        ("coat", sensor.coat.is_some()),
        ("lamp", !sensor.lamp.is_empty()),
    ] {
        if has("shape") && wrong {
            let with = if key == "background" { "pins" } else { "a gel that has a shape" };
            let message = format!("`{key}` does not go with {with}");
            let help = match check.document.get(&format!("sensor.{key}")) {
                Some(_) => format!("leave `{key}` out"),
                None => format!("leave `{}` out", if key == "background" { "pins" } else { "shape" }),
            };
            check.report_error(&format!("sensor.{key}"), message, help);
        }
    }
    for (number, led) in sensor.led.iter().enumerate() {
        let flat_pads_alone =
            [("size_mm", led.size_mm.is_some()), ("lobe", led.lobe != 0.0), ("pattern", led.pattern.is_some())];
        for (key, is_set) in flat_pads_alone {
            if has("shape") && is_set {
                let message = format!("`{key}` does not go with a gel that has a shape");
                check.report_error(&format!("sensor.led.{number}.{key}"), message, format!("leave `{key}` out"));
            }
        }
        let Some(position_mm) = led.position_mm else { continue };
        let at = format!("sensor.led.{number}.position_mm");
        for (k, mm) in position_mm.iter().enumerate() {
            check.require_in_range(&format!("{at}.{k}"), *mm, -1e4..=1e4, "mm");
        }
        match sensor.gel_shape().filter(|_| check.is_valid("sensor.shape")) {
            None if !has("shape") && position_mm[2] >= 0.0 => {
                let message = "the LED is not on the camera's side of the pad";
                check.report_error(&at, message, "z is 0 on the pad and below 0 on the camera's side: 5 mm is -5.0");
            }
            Some(shape) if !is_inside_gel(&shape, position_mm, 0.0) => {
                let message = "the LED is outside of the gel, whose skin is opaque";
                let help = format!(
                    "z is 0 at the gel's tip and below 0 inside: {} is in its middle",
                    format_gel_centre(&shape)
                );
                check.report_error(&at, message, help);
            }
            _ => {}
        }
    }
    if let Some(surface) = sensor.gel_shape().as_ref().and_then(GelShape::surface)
        && surface.has_no_rim()
    {
        for number in
            sensor.led.iter().enumerate().filter(|(_, led)| led.position_mm.is_none()).map(|(number, _)| number)
        {
            let message = "the LED is at the gel's rim, and this gel's mesh ends nowhere";
            let help = "leave the base out of the mesh, or place every LED: [[sensor.led]] with position_mm";
            let cause = "LEDs are at the gel's rim, and this gel's mesh ends nowhere";
            check.report_grouped_error(&format!("sensor.led.{number}"), cause, message, help);
        }
    }
    if let Some(shape) = sensor.gel_shape().filter(|_| check.is_valid("sensor")) {
        let projection = sensor.to_simulator_sensor(None, &Default::default()).projection();
        if let Some(surface) = shape.surface() {
            let [width, height] = sensor.resolution_px.map(f64::from);
            let shown = |[x, y]: [f64; 2]| x >= 0.0 && y >= 0.0 && x <= width && y <= height;
            for hole in surface.holes().iter().filter(|hole| projection.point_px(hole.at_mm).is_some_and(shown)) {
                let DVec3 { x, y, z } = hole.at_mm;
                let message = format!(
                    "the gel's mesh has a hole of {} edges around ({x:.2}, {y:.2}, {z:.2}) mm, where the camera looks",
                    hole.edges
                );
                check.report_error("sensor.shape.mesh.path", message, "close it, or turn the camera away");
            }
        }
        if projection.chart_view(&shape).is_none() {
            let message = "the camera sees no gel";
            let help =
                "turn the camera to the gel's tip: look_at_mm = [0.0, 0.0, 0.0], from a position_mm whose z is below 0";
            check.report_error("sensor.lens", message, help);
        }
    }
}

/// Checks the position and direction of a camera.
fn check_camera_position(
    check: &mut JobChecker<'_>,
    at: &str,
    sensor: &Sensor,
    position_mm: [f64; 3],
    look_at_mm: [f64; 3],
) {
    for k in 0..3 {
        check.require_in_range(&format!("{at}.position_mm.{k}"), position_mm[k], -1e4..=1e4, "mm");
        check.require_in_range(&format!("{at}.look_at_mm.{k}"), look_at_mm[k], -1e4..=1e4, "mm");
    }
    if position_mm == look_at_mm {
        check.report_error(
            &format!("{at}.look_at_mm"),
            "the camera looks at itself",
            "name a point before it, such as the gel's tip: look_at_mm = [0.0, 0.0, 0.0]",
        );
    }
    let Some(shape) = sensor.gel_shape().filter(|_| check.is_valid("sensor.shape")) else { return };
    // A camera in the skin, or outside of it, does not see the skin from inside.
    if !is_inside_gel(&shape, position_mm, sensor.gelpad_thickness_mm) {
        let message = "the camera stands in the gel, or outside of it";
        let help = format!(
            "the gel is {} mm thick, with its tip at z = 0: {} is in its middle",
            sensor.gelpad_thickness_mm,
            format_gel_centre(&shape)
        );
        check.report_error(&format!("{at}.position_mm"), message, help);
    }
}

/// Formats the middle of the space inside a gel, as a job writes positions.
fn format_gel_centre(shape: &GelShape) -> String {
    let below_mm = match shape {
        GelShape::Mesh(_) => 0.5 * shape.radius_mm(),
        _ => shape.radius_mm(),
    };
    format!("[0.0, 0.0, -{}]", format_number(below_mm))
}

/// Returns true for a place at least `from_skin_mm` inside the skin of a gel, or anywhere beyond its base.
fn is_inside_gel(shape: &GelShape, place_mm: [f64; 3], from_skin_mm: f64) -> bool {
    if let GelShape::Mesh(surface) = shape {
        let place = DVec3::from_array(place_mm);
        let (skin, normal) = surface.nearest(place);
        return normal.dot(place - skin) <= 0.0 && place.distance(skin) >= from_skin_mm;
    }
    let to = DVec3::from_array(place_mm) - shape.centre_mm();
    let wall_mm = shape.wall_mm().unwrap_or(0.0);
    let out = DVec3::new(to.x, to.y, to.z - to.z.clamp(-wall_mm, 0.0));
    to.z < -wall_mm || out.length() <= shape.radius_mm() - from_skin_mm
}

/// Refuses a fisheye lens that is not one-to-one.
fn check_fisheye(check: &mut JobChecker<'_>, fisheye: &Fisheye) {
    if check.is_valid("sensor.lens") && !fisheye.is_one_to_one() {
        let message = "this lens shows two directions in one place";
        check.report_error("sensor.lens.fisheye.k", message, "bring the coefficients towards 0, or lower fov_deg");
    }
}

/// Checks the pins of a sensor, and whether the gel has room for them.
fn check_pins(check: &mut JobChecker<'_>, sensor: &Sensor, pins: &PinDistribution) {
    let from_file = matches!(pins.layout, PinLayout::File(_));
    for (key, value, range, unit) in [
        ("count", pins.count.map(f64::from), 1.0..=10_000.0, "pins"),
        ("spacing_mm", pins.spacing_mm, 0.05..=1e3, "mm"),
    ] {
        let at = format!("sensor.pins.{key}");
        match (value, from_file) {
            (Some(value), false) => check.require_in_range(&at, value, range, unit),
            (None, false) => {
                check.report_missing(
                    &at,
                    if key == "count" { "for example count = 127" } else { "for example spacing_mm = 2.0" },
                );
            }
            (Some(_), true) => {
                let help = "leave it out: the file says where each pin stands";
                check.report_error(&at, format!("`{key}` beside a layout from a file"), help);
            }
            (None, true) => {}
        }
    }
    check.require_in_range("sensor.pins.turn_deg", pins.turn_deg, -3600.0..=3600.0, "degrees");
    check.require_in_range("sensor.pins.length_mm", pins.length_mm, 0.0..=1e3, "mm");
    check.require_in_range("sensor.pins.diameter_mm", pins.diameter_mm, 1e-3..=100.0, "mm");
    check.require_in_range("sensor.pins.skin_smoothing_mm", pins.skin_smoothing_mm, 0.0..=100.0, "mm");
    check.require_in_range("sensor.pins.in_plane", pins.in_plane, 0.0..=1.0, "");
    check.require_in_range("sensor.pins.drag_smoothing_mm", pins.drag_smoothing_mm, 0.0..=100.0, "mm");
    check.require_in_range("sensor.pins.size_jitter", pins.size_jitter, 0.0..=0.5, "");
    check.require_in_range("sensor.pins.place_jitter_mm", pins.place_jitter_mm, 0.0..=10.0, "mm");
    if let Some(mount) = &pins.mount {
        check.require_in_range("sensor.pins.mount.radius_mm", mount.radius_mm, 1e-3..=1e4, "mm");
        check.require_in_range("sensor.pins.mount.width_mm", mount.width_mm, 0.0..=1e3, "mm");
        check.require_in_range("sensor.pins.mount.below_tip_mm", mount.below_tip_mm, 0.0..=1e4, "mm");
    }
    let is_valid = check.is_valid("sensor.pins") && check.is_valid("sensor.shape");
    let Some(shape) = sensor.gel_shape().filter(|_| is_valid) else { return };
    let most_mm = shape.length_over_mm();
    if pins.reach_mm() > most_mm {
        let message = format!("the outermost pins stand {:.1} mm from the tip, over the rim", pins.reach_mm());
        let (key, help) =
            if from_file { ("layout.file", "move them inwards") } else { ("spacing_mm", "lower count or spacing_mm") };
        check.report_error(
            &format!("sensor.pins.{key}"),
            message,
            format!("the gel ends after {most_mm:.1} mm: {help}"),
        );
    }
    if pins.length_mm >= shape.radius_mm() {
        let message = "the pins are longer than the gel's radius";
        check.report_error("sensor.pins.length_mm", message, format!("stay below {} mm", shape.radius_mm()));
    }
}

/// Checks that a job has nothing that does not go with a gel that has a shape.
pub fn check_curved_job(check: &mut JobChecker<'_>, job: &Job, scope: Scope) {
    let pose = &job.pose;
    let place = [("from_tip_mm", &pose.from_tip_mm, 2e6), ("around_deg", &pose.around_deg, 3600.0)];
    if job.sensor.shape.is_none() {
        for (key, _, _) in place.iter().filter(|(_, place, _)| place.is_some()) {
            let message = format!("`{key}` is a place on a gel that has a shape, and this one is flat");
            check.report_error(
                &format!("pose.{key}"),
                message,
                "write x_mm and y_mm in its place; or take a sensor that has a shape",
            );
        }
        return;
    }
    for (key, quantity, most) in place {
        if let Some(quantity) = quantity {
            let (least, unit) = if key == "from_tip_mm" { (0.0, "mm") } else { (-most, "degrees") };
            check.require_quantity_in_range(&format!("pose.{key}"), quantity, least..=most, unit);
        }
    }
    if let (Some(from_tip), Some(shape)) = (&pose.from_tip_mm, job.sensor.gel_shape())
        && check.is_valid("sensor.shape")
    {
        let (end_mm, where_it_is) = match shape.surface() {
            Some(surface) => {
                let (least, most) = pose.around_deg.as_ref().map_or((0.0, 0.0), |around| around.support());
                let (end_mm, at_deg) = surface.least_rim_mm(least..=most);
                (end_mm, format!(" at around_deg = {at_deg:.0}"))
            }
            None => (shape.length_over_mm(), String::new()),
        };
        let farthest_mm = from_tip.support().1;
        if farthest_mm > end_mm && farthest_mm <= 2e6 {
            let message =
                format!("from_tip_mm may be {farthest_mm}, and the gel ends {end_mm:.1} mm from its tip{where_it_is}");
            let help =
                format!("stay below {}: it is counted over the gel, along its curve", format_number(end_mm.floor()));
            check.report_error("pose.from_tip_mm", message, help);
        }
    }
    if scope == Scope::Objects {
        let message = "simulated counterparts are for flat pads: on a gel that has a shape a shift in the image is no shift of \
                       the object in a plane";
        check.report_error(
            "sensor.shape",
            message,
            "leave [paired] out; samples of a job ([mixing]) may be of this sensor",
        );
        return;
    }
    if scope == Scope::Frames && job.sequence.is_some() && job.texture.amplitude_mm.support() != (0.0, 0.0) {
        let message = "texture in a sequence of depth frames on a gel that has a shape is not simulated";
        check.report_error("texture.amplitude_mm", message, "leave it out, or have it in the frames");
    }
    let named = check.document.get("gelpad").is_some();
    let mut refuse = |wrong: bool, path: &str, what: &str| {
        if wrong {
            let message = format!("{what} on a gel that has a shape is not simulated");
            let help = match path {
                "shear" => "leave it out, or take a flat sensor, or add the layer flow, which shows it",
                "fidelity" => "choose the fidelity level draft or a better one, or take a flat sensor",
                "gelpad" => "write gelpad = \"elastic\", or take a flat sensor",
                _ => "leave it out, or take a flat sensor",
            };
            check.report_error(path, message, help);
        }
    };
    refuse(job.markers.is_some(), "markers", "print");
    let placed = pose.from_tip_mm.is_some() || pose.around_deg.is_some();
    let moved =
        [&job.shear.x_mm, &job.shear.y_mm, &job.shear.twist_deg].map(|quantity| quantity.support() != (0.0, 0.0));
    let sheared = moved.iter().any(|moved| *moved);
    let shown = job.sensor.pins.is_some() || super::shows_motion(&job.output.layers);
    refuse(sheared && !shown, "shear", "shear that neither pins nor the layers `flow` and `traction` show");
    refuse(sheared && placed, "shear.x_mm", "shear beside from_tip_mm or around_deg");
    let camera = &job.camera;
    for (name, quantity) in [("distortion_k1", &camera.distortion_k1), ("distortion_k2", &camera.distortion_k2)] {
        refuse(quantity.support() != (0.0, 0.0), &format!("camera.{name}"), "distortion by [camera]");
    }
    let elastic = super::chosen_models(job).gelpad.knows_pressure();
    let path = if named { "gelpad" } else { "fidelity" };
    refuse(!elastic, path, "a pad that is not elastic");
}
