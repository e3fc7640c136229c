//! What an `[[object]]` says of its material: how it gives way, what holds the pad to it, and its own micro-texture.

use super::check::Check;
use super::chosen_models;
use super::ranges;
use crate::core::gelpad;
use crate::job::config::Job;

/// Young's moduli that an object may have, kPa: from a gel much softer than any pad to what no pad can tell from rigid.
const MODULI_KPA: [f64; 2] = [0.1, 1e9];

/// Checks the keys, and that something in the job uses them.
pub fn check(check: &mut Check<'_>, job: &Job) {
    let model = chosen_models(job).gelpad;
    let held = model.friction().is_some() || job.shear.any() || job.sequence.is_some();
    for (i, object) in job.object.iter().enumerate() {
        let path = |key: &str| format!("object.{i}.{key}");
        if let Some(modulus) = &object.youngs_modulus_kpa {
            let at = path("youngs_modulus_kpa");
            check.quantity(&at, modulus, MODULI_KPA[0]..=MODULI_KPA[1], "kPa");
            if !matches!(model, gelpad::Model::Elastic(_)) {
                let message =
                    format!("the gelpad model `{}` knows no pressure, so that nothing gives way", model.name());
                check.error(&at, message, "choose fidelity = \"draft\" or better, or gelpad.elastic, or leave it out");
            }
            if job.sequence.is_some() {
                check.error(&at, "the objects of a sequence are rigid", "leave it out, or leave [sequence] out");
            }
        }
        if let Some(ratio) = &object.poisson_ratio {
            check.quantity(&path("poisson_ratio"), ratio, 0.0..=0.5, "");
            if object.youngs_modulus_kpa.is_none() {
                let help = "add youngs_modulus_kpa, or leave poisson_ratio out";
                check.error(&path("poisson_ratio"), "an object without youngs_modulus_kpa is rigid", help);
            }
        }
        if let Some(friction) = &object.friction {
            check.quantity(&path("friction"), friction, 0.0..=10.0, "");
            if !held {
                let message = "nothing in this job uses the friction of an object: it slides along the pad without any";
                let help = "add gelpad.elastic.friction, [shear] or [sequence], or leave it out";
                check.error(&path("friction"), message, help);
            }
        }
        if let Some(texture) = &object.texture {
            ranges::texture(check, &path("texture"), texture);
        }
    }
}
