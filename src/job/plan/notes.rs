//! What is allowed and yet probably not meant: words of warning about a job, each cause once.

use super::{chosen_models, sensors};
use crate::core::gelpad;
use crate::core::gelpad::elastic::LARGEST_STRAIN;
use crate::job::config::Job;

/// Young's moduli of gels and elastomers, kPa.
const MODULI_KPA: [f64; 2] = [1.0, 1e5];

/// Less than this no camera shows, mm.
const SHALLOWEST_MM: f64 = 1e-3;

/// All of them.
pub fn of(job: &Job) -> Vec<String> {
    [strain(job), shallow(job), modulus(job)].into_iter().flatten().collect()
}

/// Where the elastic pad is pressed beyond what its theory holds for.
fn strain(job: &Job) -> Option<String> {
    let deepest = job.indentation.depth_mm.as_ref()?.support().1;
    let [thickness, _] = sensors::support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm);
    let elastic = matches!(chosen_models(job).gelpad, gelpad::Model::Elastic(_));
    (elastic && deepest > LARGEST_STRAIN * thickness).then(|| {
        format!(
            "indentation.depth_mm may be {deepest}, over half of the pad's {thickness} mm: linear elasticity does not hold \
             there; such samples have numerics.beyond_theory in their labels"
        )
    })
}

/// Where no press can be seen.
fn shallow(job: &Job) -> Option<String> {
    let deepest = job.indentation.depth_mm.as_ref()?.support().1;
    (deepest < SHALLOWEST_MM).then(|| {
        format!(
            "indentation.depth_mm is at most {deepest}, less than a micrometre, which no camera shows; its unit is mm"
        )
    })
}

/// Where the gelpad is softer than a gel or harder than a rubber.
fn modulus(job: &Job) -> Option<String> {
    let [softest, hardest] = sensors::support(job, "gelpad_youngs_modulus_kpa", job.sensor.gelpad_youngs_modulus_kpa);
    let [least, most] = MODULI_KPA;
    let odd = if softest < least { Some(softest) } else { (hardest > most).then_some(hardest) };
    odd.map(|kpa| {
        format!(
            "sensor.gelpad_youngs_modulus_kpa may be {kpa}, where gelpads have {least} to {most}; its unit is kPa, and it \
             scales forces and pressures only"
        )
    })
}
