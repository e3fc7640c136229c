//! Ways out that several messages name, as they are to be written in this job.

use super::sensors::support;
use crate::config::Job;
use crate::config::document::Document;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_files::figures::figure;

/// `depth_mm` of usual presses of a pad so thick.
pub fn usual_depth(thickness_mm: f64) -> String {
    let [least, most] = USUAL_DEPTHS.map(|share| figure(share * thickness_mm));
    format!("depth_mm = [{least}, {most}]")
}

/// The thinnest gelpad that a job's samples may have, mm.
pub fn thinnest_mm(job: &Job) -> f64 {
    support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm)[0]
}

/// How to come from a job whose depth is said elsewhere, in tables such as `[sequence]`, to one of single presses.
pub fn single_presses(job: &Job, without: &str) -> String {
    match job.indentation.depth_mm {
        Some(_) => format!("leave {without} out"),
        None => format!("leave {without} out, and write {} under [indentation]", usual_depth(thinnest_mm(job))),
    }
}

/// How to have a gelpad model that solves the contact.
pub fn solving_gelpad(document: &Document) -> &'static str {
    match document.get("gelpad") {
        Some(_) => "write gelpad = \"elastic\" in place of the model",
        None => "choose the fidelity level draft or a better one",
    }
}

/// A friction as a job says it.
pub fn friction(friction: Friction) -> String {
    match friction {
        Friction::Stick => String::from("friction = \"stick\""),
        Friction::Coulomb { coefficient } => {
            format!("friction = {{ coulomb = {{ coefficient = {coefficient} }} }}")
        }
    }
}
