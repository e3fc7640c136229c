//! Checks what an `[[object]]` says of its material: its elasticity, its friction, and its own micro-texture.

use super::check::JobChecker;
use super::chosen_models;
use super::{ranges, remedies};
use crate::config::Job;
use gelsim_core::gelpad;

/// The range of an object's Young's modulus, kPa: from a gel much softer than any pad to a material that no pad can
/// tell from a rigid one.
const MODULI_KPA: [f64; 2] = [0.1, 1e9];

/// Checks the keys of the material, and that something in the job uses them.
pub fn check_materials(check: &mut JobChecker<'_>, job: &Job) {
    let model = chosen_models(job).gelpad;
    let held = model.friction().is_some() || job.shear.has_motion() || job.sequence.is_some();
    for (i, object) in job.object.iter().enumerate() {
        let path = |key: &str| format!("object.{i}.{key}");
        if let Some(modulus) = &object.youngs_modulus_kpa {
            let at = path("youngs_modulus_kpa");
            check.require_quantity_in_range(&at, modulus, MODULI_KPA[0]..=MODULI_KPA[1], "kPa");
            if !model.knows_pressure() {
                let message =
                    format!("the gelpad model `{}` knows no pressure, so that nothing gives way", model.name());
                let help =
                    format!("{}; or leave youngs_modulus_kpa out", remedies::suggest_solving_gelpad(check.document));
                check.report_grouped_error(
                    &at,
                    "keys say how objects give way, and this gelpad model knows no pressure",
                    message,
                    help,
                );
            }
            if job.sequence.is_some() {
                let message = "the objects of a sequence are rigid";
                check.report_grouped_error(
                    &at,
                    "keys say how the objects of a sequence give way, which are rigid",
                    message,
                    "leave it out",
                );
            }
        }
        if let Some(ratio) = &object.poisson_ratio {
            check.require_quantity_in_range(&path("poisson_ratio"), ratio, 0.0..=0.5, "");
            if object.youngs_modulus_kpa.is_none() {
                let help = "leave poisson_ratio out, or add youngs_modulus_kpa, such as 100.0";
                let message = "an object without youngs_modulus_kpa is rigid";
                check.report_grouped_error(
                    &path("poisson_ratio"),
                    "objects without youngs_modulus_kpa are rigid",
                    message,
                    help,
                );
            }
        }
        if let Some(friction) = &object.friction {
            check.require_quantity_in_range(&path("friction"), friction, 0.0..=10.0, "");
            if !held {
                let message = "nothing in this job uses the friction of an object: it slides along the pad without any";
                let help = "leave it out, or push the object over the pad: x_mm = [-0.4, 0.4] under [shear]";
                check.report_grouped_error(
                    &path("friction"),
                    "keys say a friction that nothing in this job uses",
                    message,
                    help,
                );
            }
            if model.strain_settings().is_some() && model.friction().is_some() {
                let message = "at finite strain the pad sticks to every object: one with a friction is not simulated";
                let help = match &model {
                    gelpad::Model::Elastic(_) => "leave it out, or leave strain_correction out",
                    _ => "leave it out, or take the model elastic",
                };
                check.report_grouped_error(
                    &path("friction"),
                    "keys say a friction, and at finite strain the pad sticks to every object",
                    message,
                    help,
                );
            }
        }
        if let Some(texture) = &object.texture {
            ranges::check_texture(check, &path("texture"), texture);
        }
    }
}
