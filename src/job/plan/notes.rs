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
    [strain(job), shallow(job), modulus(job), out_of_view(job)].into_iter().flatten().collect()
}

/// Where the object of a sequence may be moved out of the view: the first phase in which it may.
fn out_of_view(job: &Job) -> Option<String> {
    let sequence = job.sequence.as_ref()?;
    let half_mm = job.sensor.field_of_view_mm.map(|mm| 0.5 * mm);
    let mut reach = [&job.pose.x_mm, &job.pose.y_mm].map(|quantity| quantity.support());
    // Who begins there means it.
    let outside = |reach: &[(f64, f64); 2]| (0..2).find(|k| reach[*k].0.abs().max(reach[*k].1.abs()) > half_mm[*k]);
    if outside(&reach).is_some() {
        return None;
    }
    sequence.phase.iter().find_map(|phase| {
        for (reach, by) in reach.iter_mut().zip([&phase.x_mm, &phase.y_mm]) {
            *reach = (reach.0 + by.support().0, reach.1 + by.support().1);
        }
        outside(&reach).map(|k| {
            let (name, axis, (least, most)) = (phase.name.as_deref().unwrap_or_default(), ["x", "y"][k], reach[k]);
            format!(
                "in phase `{name}` the point that [pose] places may come to {axis} = {least} to {most} mm, out of the view, which \
                 ends at {} mm",
                half_mm[k]
            )
        })
    })
}

/// Where the elastic pad is pressed beyond what its theory holds for.
fn strain(job: &Job) -> Option<String> {
    let deepest = match &job.sequence {
        None => job.indentation.depth_mm.as_ref()?.support().1,
        Some(sequence) => {
            let depths = sequence.phase.iter().filter_map(|phase| phase.depth_mm.as_ref());
            depths.map(|depth| depth.support().1).fold(0.0, f64::max)
        }
    };
    let [thickness, _] = sensors::support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm);
    let elastic = matches!(chosen_models(job).gelpad, gelpad::Model::Elastic(_));
    (elastic && deepest > LARGEST_STRAIN * thickness).then(|| {
        format!(
            "{} may be {deepest}, over half of the pad's {thickness} mm: linear elasticity does not hold \
             there; such samples have numerics.beyond_theory in their labels",
            if job.sequence.is_some() { "depth_mm of a phase" } else { "indentation.depth_mm" }
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
