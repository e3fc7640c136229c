//! Suggestions that several messages make, as they would be written in this job.

use super::sensors::number_support;
use crate::config::Job;
use crate::config::document::Document;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_files::number_format::format_number;

/// Suggests `depth_mm` of usual presses for a pad of this thickness.
pub fn suggest_depth(thickness_mm: f64) -> String {
    let [least, most] = USUAL_DEPTHS.map(|share| format_number(share * thickness_mm));
    format!("depth_mm = [{least}, {most}]")
}

/// Returns the thickness of the thinnest gelpad that a job's samples may have, mm.
pub fn min_thickness_mm(job: &Job) -> f64 {
    number_support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm)[0]
}

/// Suggests how to turn a job whose depth is given by a table such as `[sequence]` into one of single presses.
pub fn suggest_single_presses(job: &Job, without: &str) -> String {
    match job.indentation.depth_mm.as_ref().or(job.indentation.force_n.as_ref()) {
        Some(_) => format!("leave {without} out"),
        None => format!("leave {without} out, and write {} under [indentation]", suggest_depth(min_thickness_mm(job))),
    }
}

/// Suggests how to get a gelpad model that solves the contact.
pub fn suggest_solving_gelpad(document: &Document) -> &'static str {
    match document.get("gelpad") {
        Some(_) => "write gelpad = \"elastic\" in place of the model",
        None => "choose the fidelity level draft or a better one",
    }
}

/// Formats a friction as a job writes it.
pub fn format_friction(friction: Friction) -> String {
    match friction {
        Friction::Stick => String::from("friction = \"stick\""),
        Friction::Coulomb { coefficient } => {
            format!("friction = {{ coulomb = {{ coefficient = {coefficient} }} }}")
        }
    }
}
