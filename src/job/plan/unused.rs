//! Finds keys of a job that have no effect. What the user wanted does not happen, and nothing else would say so.

use super::chosen_models;
use crate::config::Job;
use crate::config::dataset::{ObjectOrder, SplitBy};
use crate::config::document::{Document, RESOLVED_HEADER};
use crate::layers::LayerCoding;
use gelsim_core::camera::markers::MeasuredDot;
use gelsim_core::optics;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::mesh::Format;
use gelsim_files::sensor::quantity::Quantity;

/// Makes a note for each key without effect. A job.toml of a dataset is exempt: it has all keys, which says nothing of
/// what the user wants.
pub fn note_unused_keys(job: &Job, document: &Document) -> Vec<Diagnostic> {
    if document.sources.first().is_some_and(|job| job.text.contains(RESOLVED_HEADER)) {
        return Vec::new();
    }
    let given = |key: &str| {
        let place = document.get(key)?.place;
        let source = document.sources.get(place.source)?;
        // Only keys in the job or on the command line count, since a sensor file serves other jobs, too.
        (place.source == 0 || source.name.starts_with("--")).then_some(place)
    };
    let mut notes = Vec::new();
    let mut note = |key: &str, unless: bool, why: &str, help: &str| {
        if let Some(place) = given(key).filter(|_| !unless) {
            // It has two places, of which the user wrote one.
            let called = if key == "sensor.gelpad_relaxation" { "relaxation" } else { key };
            notes.push(Diagnostic::note(format!("`{called}` has no effect: {why}")).help(help).at(place));
        }
    };
    let models = chosen_models(job);
    let splits = [job.dataset.splits.train, job.dataset.splits.val, job.dataset.splits.test];
    let is_split = splits.iter().filter(|share| **share > 0.0).count() > 1;
    note(
        "dataset.split_by",
        is_split || job.dataset.split_by == SplitBy::Sample,
        "all samples are in one split",
        "add splits, such as splits = { train = 0.8, val = 0.1, test = 0.1 }",
    );
    let is_tilted = job.pose.tilt_deg.support() != (0.0, 0.0);
    note("pose.tilt_azimuth_deg", is_tilted, "objects are not tilted", "add tilt_deg, or leave it out");
    let layers = job.output.layers_in_order();
    let writes_exr = layers.iter().any(|layer| layer.coding_for(job.output.depth_format) == LayerCoding::Exr);
    note("output.exr", writes_exr, "no layer is written as EXR", "leave it out");
    let shows_motion = job.markers.is_some()
        || job.sensor.pins.is_some()
        || super::shows_motion(&layers)
        || job.gripper.as_ref().is_some_and(|gripper| gripper.right.is_some());
    note(
        "shear",
        shows_motion || !job.shear.has_motion(),
        "only markers, pins and the layers `flow` and `traction` show how the pad moves in its own plane",
        "add a [markers] table or the layer flow",
    );
    let of_file = job.markers.as_ref().and_then(|markers| Some((markers.dots.as_deref()?, &markers.diameter_mm)));
    let sizes = |(dots, shared): (&Vec<MeasuredDot>, &Quantity)| {
        // No dot is printed where the diameter is 0.
        shared.support().0 == 0.0 || dots.iter().any(|dot| dot.diameter_mm.is_none())
    };
    note(
        "markers.diameter_mm",
        of_file.is_none_or(sizes),
        "the file has a diameter for every dot",
        "leave it out, or the column diameter_mm",
    );
    note(
        "shear.friction",
        job.shear.has_motion(),
        "nothing moves the object",
        "add x_mm = [-0.3, 0.3] or twist_deg, or leave it out",
    );
    let has_leds = models.optics.phong().is_some();
    let light = format!("the light is `{}`, which LEDs are no part of", models.optics.name());
    note("sensor.led", has_leds, &light, "leave it out, or choose optics = \"phong\"");
    for key in ["sensor.darkening", "sensor.stray_light"] {
        note(key, has_leds, &light, "leave it out, or choose optics = \"phong\"");
    }
    let is_lamps = matches!(models.optics, optics::Model::Lamps(_));
    note("sensor.grain", !is_lamps, "the light is `lamps`, which shows no grain", "leave it out");
    let is_near = matches!(models.optics, optics::Model::Led(_));
    let light = format!("the light is `{}`, and it belongs to that of near LEDs", models.optics.name());
    let of_leds = (0..job.sensor.led.len())
        .flat_map(|i| ["size_mm", "lobe"].map(|key| format!("sensor.led.{i}.{key}")))
        // Of a gel that has a shape, LEDs are points.
        .filter(|_| job.sensor.shape.is_none() && has_leds);
    for key in [String::from("sensor.window"), String::from("sensor.coat")].into_iter().chain(of_leds) {
        note(&key, is_near, &light, "leave it out, or choose optics = \"led\"");
    }
    for (i, _) in job.sensor.led.iter().enumerate().filter(|(_, led)| led.position_mm.is_some()) {
        for key in ["azimuth_deg", "elevation_deg", "distance_mm"] {
            let key = format!("sensor.led.{i}.{key}");
            note(&key, false, "`position_mm` says where the LED is", "leave it out, or leave position_mm out");
        }
    }
    let is_rendered = job.sensor.background.is_none() && !is_lamps;
    note(
        "sensor.rendered_background",
        is_rendered,
        "the image of the untouched pad is a photograph",
        "leave it out, or leave `background` out",
    );
    let is_elastic = models.gelpad.knows_pressure();
    let model = format!("the gelpad model `{}` knows no elasticity", models.gelpad.name());
    for key in ["sensor.gelpad_youngs_modulus_kpa", "sensor.gelpad_poisson_ratio"] {
        note(key, is_elastic, &model, "choose fidelity = \"draft\" or better, or leave it out");
    }
    // Frames of a simulator, which come without objects, may follow each other.
    let follows = job.sequence.is_some() || document.get("object").is_none();
    let relaxes = follows && job.gripper.is_none() && is_elastic;
    let why = match (&job.sequence, &job.gripper) {
        (None, _) => "a single press takes no time",
        (_, Some(_)) => "the fingers of a gripper are elastic",
        _ => "the gelpad model is not elastic",
    };
    note("sensor.gelpad_relaxation", relaxes, why, "leave it out; pads relax in a [sequence] of one sensor");
    // What names a sensor alone is for frames of a simulator, or for objects that are pressed one by one.
    let is_job = document.sources.first().is_none_or(|first| !first.name.starts_with("--"));
    for key in ["object", "pose", "indentation", "scene", "sequence", "gripper", "sensors"] {
        note(
            key,
            is_job,
            "it belongs to a job, and there is none: each frame or press says what is pressed",
            "leave it out",
        );
    }
    let has_texture = job.texture.amplitude_mm.support().1 > 0.0;
    note("texture", has_texture, "its amplitude is 0", "add amplitude_mm = [0.01, 0.05]");
    notes
}

/// Makes a note for each key of an `[[object]]` table without effect, before each object becomes a table of its own.
pub fn note_unused_object_keys(job: &Job, document: &Document) -> Vec<Diagnostic> {
    if document.sources.first().is_some_and(|job| job.text.contains(RESOLVED_HEADER)) {
        return Vec::new();
    }
    let mut notes = Vec::new();
    for (i, object) in job.object.iter().enumerate() {
        let mut note = |key: &str, unless: bool, why: &str, help: &str| {
            if let Some(node) = document.get(&format!("object.{i}.{key}")).filter(|_| !unless) {
                let message = format!("`{key}` has no effect: {why}");
                let cause = format!("tables [[object]] have a `{key}` without effect: {why}");
                notes.push(
                    Diagnostic::note(message).help(help).at(node.place).about(format!("number {}", i + 1), cause),
                );
            }
        };
        let in_turn = job.dataset.object_order == ObjectOrder::InTurn;
        note(
            "weight",
            !in_turn || object.weight == 0.0,
            "object_order = \"in_turn\" takes one object after the other",
            "leave it out",
        );
        note("class_from", object.class.is_none(), "`class` names the class", "keep one of the two");
        let path = std::path::Path::new(object.path.as_deref().unwrap_or_default());
        let is_robot = Format::from_path(path).is_none_or(|format| format == Format::Urdf);
        note("urdf", is_robot, "it is for robots (.urdf)", "leave it out");
    }
    notes
}
