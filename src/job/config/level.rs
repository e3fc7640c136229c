//! Applies a fidelity level, which chooses numerics: grids, tolerances, iterations. What a job says of physics stays
//! under every level. What it says of numerics is never dropped for a level silently.

use super::Job;
use super::document::Document;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::gelpad;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::optics;
use gelsim_core::optics::phong::Shadows;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};

/// Fills the numerics that a job leaves open with those of the level that it names. What the job writes itself stays.
pub fn fill_from_level(job: &mut Job, document: &Document) {
    let named = document.get("fidelity").is_some();
    let Some(level) = job.fidelity.and_then(super::fidelity::FidelityChoice::level).filter(|_| named) else { return };
    let models = level.models(job.sensor.light_source());
    if let (Some(gelpad::Model::Elastic(own)), gelpad::Model::Elastic(of_level)) = (&mut job.gelpad, models.gelpad) {
        let is_open = |key: &str| document.get(&format!("gelpad.elastic.{key}")).is_none();
        if is_open("resolution") {
            own.resolution = of_level.resolution;
        }
        if is_open("tolerance_um") {
            own.tolerance_um = of_level.tolerance_um;
        }
        if is_open("max_iterations") {
            own.max_iterations = of_level.max_iterations;
        }
    }
    if let (Some(own), Some(of_level)) = (&mut job.optics, models.optics.phong()) {
        let is_open = document.get(&format!("optics.{}.shadows", own.name())).is_none();
        if let Some(own) = own.phong_mut().filter(|_| is_open) {
            own.shadows = of_level.shadows;
        }
    }
}

/// Replaces the job's level by one of the command line. What is not part of a level stays, and what contradicts it is
/// an error.
pub fn replace_level(job: &mut Job, document: &Document, level: Fidelity, problems: &mut Diagnostics) {
    let light = job.sensor.light_source();
    // Values that only repeat the job's own level are not the user's choice.
    let before = job.fidelity.and_then(super::fidelity::FidelityChoice::level).unwrap_or_default().models(light);
    let after = level.models(light);
    let mut change = LevelChange { document, level, problems };
    job.fidelity = Some(level.into());
    job.gelpad = job.gelpad.take().and_then(|own| change.merge_gelpad(own, &before, &after));
    job.optics = job.optics.take().map(|own| change.merge_optics(own, &before, &after));
}

struct LevelChange<'a> {
    document: &'a Document,
    level: Fidelity,
    problems: &'a mut Diagnostics,
}

impl LevelChange<'_> {
    /// Reports that a key contradicts the level.
    fn refuse_key(&mut self, key: &str, own: &str, of_level: &str) {
        let level = self.level.name();
        let message = format!("--fidelity {level} stands for {of_level}, and `{key}` says {own}");
        let help = format!("leave `{key}` out, or --fidelity; `gelsim list levels` says what each level stands for");
        self.problems.push(Diagnostic::new(message).at(self.document.place_of(key)).help(help));
    }

    /// Returns true if a key is the user's own choice: it was written, and is not just the value of the job's level, as
    /// in the job of a dataset.
    fn is_own<T: PartialEq>(&self, key: &str, own: &T, before: Option<&T>) -> bool {
        self.document.get(key).is_some() && before != Some(own)
    }

    /// Refuses a key with a value of the user's own that differs from the level's.
    fn require_level_value<T: PartialEq + Copy>(
        &mut self,
        key: &str,
        own: T,
        before: Option<T>,
        after: T,
        show: impl Fn(T) -> String,
    ) {
        if own != after && self.is_own(key, &own, before.as_ref()) {
            self.refuse_key(key, &show(own), &show(after));
        }
    }

    /// Returns what stays of a job's gelpad; `None` if nothing but what the level chooses.
    fn merge_gelpad(&mut self, own: gelpad::Model, before: &Models, after: &Models) -> Option<gelpad::Model> {
        use gelpad::Model::{Elastic, FiniteStrain, MeanBlur};
        match (own, &before.gelpad, &after.gelpad) {
            (Elastic(own), before, Elastic(after)) => {
                let before = if let Elastic(before) = before { Some(before) } else { None };
                let path = |key: &str| format!("gelpad.elastic.{key}");
                let name = |resolution| {
                    format!("{:?}", serde_json::to_value(resolution).unwrap_or_default().as_str().unwrap_or_default())
                };
                let [own_grid, grid_after] = [own.resolution, after.resolution];
                self.require_level_value(&path("resolution"), own_grid, before.map(|b| b.resolution), grid_after, name);
                let show = |value: f64| value.to_string();
                let [own_um, after_um] = [own.tolerance_um, after.tolerance_um];
                self.require_level_value(&path("tolerance_um"), own_um, before.map(|b| b.tolerance_um), after_um, show);
                let show = |value| f64::from(value).to_string();
                let [own_most, most_after] = [own.max_iterations, after.max_iterations];
                self.require_level_value(
                    &path("max_iterations"),
                    own_most,
                    before.map(|b| b.max_iterations),
                    most_after,
                    show,
                );
                let gelpad::elastic::Elastic { friction, strain_correction, .. } = own;
                Some(Elastic(gelpad::elastic::Elastic { friction, strain_correction, ..*after }))
            }
            (FiniteStrain(own), before, FiniteStrain(after)) => {
                let before = if let FiniteStrain(before) = before { Some(before) } else { None };
                let path = |key: &str| format!("gelpad.finite_strain.{key}");
                let show = |value: Option<f64>| value.map_or(String::from("nothing"), |mm| mm.to_string());
                self.require_level_value(&path("box_mm"), own.box_mm, before.map(|b| b.box_mm), after.box_mm, show);
                let show = |value: f64| value.to_string();
                let [own_um, after_um] = [own.tolerance_um, after.tolerance_um];
                self.require_level_value(&path("tolerance_um"), own_um, before.map(|b| b.tolerance_um), after_um, show);
                Some(FiniteStrain(gelpad::finite_strain::FiniteStrain { friction: own.friction, ..*after }))
            }
            // Friction is physics, and stays.
            (Elastic(own), Elastic(_), FiniteStrain(_)) if matches!(own.friction, Some(Friction::Coulomb { .. })) => {
                let of_level = "the gelpad model finite_strain, whose pad sticks or slides freely";
                self.refuse_key("gelpad.elastic.friction", "Coulomb friction", of_level);
                None
            }
            (own @ Elastic(_), Elastic(_), after @ FiniteStrain(_))
            | (own @ FiniteStrain(_), FiniteStrain(_), after @ Elastic(_)) => {
                Some(after.clone().with_friction(own.friction()))
            }
            (own @ (Elastic(_) | FiniteStrain(_)), before, after)
                if own.name() == before.name() && !after.knows_tractions() =>
            {
                // The level's pad has no tractions, and so no friction.
                if own.friction().is_some() {
                    let of_level = format!("the gelpad model {}, which knows no friction", after.name());
                    self.refuse_key(&format!("gelpad.{}.friction", own.name()), "that the pad is held", &of_level);
                }
                if let Elastic(gelpad::elastic::Elastic { strain_correction: true, .. }) = own {
                    let of_level = format!("the gelpad model {}, which knows no strain", after.name());
                    self.refuse_key("gelpad.elastic.strain_correction", "true", &of_level);
                }
                None
            }
            (MeanBlur(own), before, MeanBlur(after)) if own != *after && MeanBlur(own) != *before => {
                self.refuse_key("gelpad.mean_blur", "another blur", "that of the paper");
                None
            }
            (own, before, after) if own.name() == before.name() || own.name() == after.name() => None,
            (own, _, after) => {
                let models = [own.name(), after.name()].map(|name| format!("the model {name}"));
                self.refuse_key("gelpad", &models[0], &models[1]);
                None
            }
        }
    }

    fn merge_optics(&mut self, mut own: optics::Model, before: &Models, after: &Models) -> optics::Model {
        let key = format!("optics.{}.shadows", own.name());
        let (Some(light), Some(after)) = (own.phong_mut(), after.optics.phong()) else { return own };
        let before = before.optics.phong().map(|before| before.shadows);
        match (light.shadows, after.shadows) {
            (own, _) if !self.is_own(&key, &own, before.as_ref()) => light.shadows = after.shadows,
            (Shadows::Soft(own), Shadows::Soft(after)) if own != after => {
                self.refuse_key(&key, "another grid", "shadows on its own grid");
            }
            // Whether there are shadows at all is physics, and stays.
            _ => {}
        }
        own
    }
}
