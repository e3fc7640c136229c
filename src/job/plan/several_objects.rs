//! Checks `[scene]`, and what does not go with several objects in one press.

use super::check::JobChecker;
use crate::config::Job;
use crate::config::scene::{At, Count};
use gelsim_core::pose::Anchor;
use gelsim_files::number_format::format_number;

/// Most objects in a press.
const MAX_OBJECTS: u32 = 32;

/// Checks `[scene]` and what stands beside it.
pub fn check_scene(check: &mut JobChecker<'_>, job: &Job) {
    let at = "scene.objects_per_sample";
    let Count { min: least, max: most } = job.objects_per_sample();
    if least > most {
        let message = format!("inverted range: {least} is above {most}");
        return check.report_error(at, message, "write the smaller number first");
    }
    if least < 1 || most > MAX_OBJECTS {
        let written = if least == most { format!("{least}") } else { format!("[{least}, {most}]") };
        return check.report_error(
            at,
            format!("objects_per_sample = {written} is out of range"),
            format!("allowed: 1 to {MAX_OBJECTS}"),
        );
    }
    if most == 1 {
        return;
    }
    let one = "or write objects_per_sample = 1";
    if job.sequence.is_some() {
        check.report_error("sequence", "a sequence moves one object, and [scene] wants several", "leave [scene] out");
    }
    if job.gripper.is_some() {
        check.report_error("gripper", "a gripper holds one object, and [scene] wants several", "leave [scene] out");
    }
    if job.indentation.at == At::Axis {
        let message = "the depth is measured on the sensor's axis, where only one of several objects can be";
        check.report_error("indentation.at", message, format!("leave it out; {one}"));
    }
    let spread = job.pose.x_mm.is_variable() || job.pose.y_mm.is_variable();
    // With the origin as the anchor, objects may lie apart: the origins of meshes need not be in them.
    if !spread && job.pose.anchor != Anchor::Origin && check.is_valid("pose") {
        let path = if check.document.get("pose.x_mm").is_some() { "pose.x_mm" } else { at };
        let message = "all objects of a press would be at the same place: pose.x_mm and pose.y_mm are constant";
        let [x, y] = job.sensor.field_of_view_mm.map(|mm| format_number(0.5 * mm));
        check.report_error(
            path,
            message,
            format!("spread them over the view: x_mm = [-{x}, {x}] and y_mm = [-{y}, {y}] under [pose]; {one}"),
        );
    }
    for (i, object) in job.object.iter().enumerate() {
        let own = [
            (
                "youngs_modulus_kpa",
                object.youngs_modulus_kpa.is_some(),
                "the objects of one press are one rigid body",
                "keys say how objects of one press give way, which are one rigid body",
            ),
            (
                "friction",
                object.friction.is_some(),
                "the objects of one press are one body with one friction",
                "keys say a friction of their own, and the objects of one press are one body",
            ),
            (
                "texture",
                object.texture.is_some(),
                "one texture lies over all objects of a press",
                "textures are those of one object, and one lies over all objects of a press",
            ),
        ];
        for (key, _, message, cause) in own.into_iter().filter(|(_, written, ..)| *written) {
            let help = match key {
                "youngs_modulus_kpa" => "leave it out",
                "friction" => "leave it out for that of [shear] or gelpad.elastic",
                _ => "leave it out for [texture]",
            };
            check.report_grouped_error(&format!("object.{i}.{key}"), cause, message, format!("{help}; {one}"));
        }
    }
}
