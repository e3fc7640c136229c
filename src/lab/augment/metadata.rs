//! Metadata of real samples for their counterparts.

use super::config::Augment;
use super::counterpart::{Orientation, PressMetadata};
use super::input::Set;
use super::input::columns::{LabelFacts, Meaning};
use crate::core::optics::background::BackgroundImage;
use crate::core::pose::Angles;
use crate::files::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::files::spelling::nearest;
use crate::job::plan::Plan;
use crate::job::plan::check::Check;

/// What counterparts need of the file.
pub fn check(check: &mut Check<'_>, written: &Augment, set: Option<&Set>, background: Option<&BackgroundImage>) {
    if written.input.background.is_none() && background.is_none() {
        let help = "name the background image: [input] background = \"...\"";
        check.error(
            "paired",
            "simulated counterparts are aligned by what a press changes, and the background is not known",
            help,
        );
    }
    let Some(set) = set else { return };
    let known = |meaning: Meaning| set.columns.name(meaning).is_some();
    for (found, key, what) in [
        (known(Meaning::Object) || known(Meaning::Class), "object", "the object"),
        (known(Meaning::Depth), "depth_mm", "the depth"),
    ] {
        if !found && check.sound("input.columns") {
            let message = format!("no column of the labels is {what}");
            check.error("paired", message, format!("name it with input.columns.{key}"));
        }
    }
}

/// The metadata of each real sample, for its counterpart. A sample whose label names no object or no depth has none; one
/// that names an object that is not there is a mistake.
pub fn resolve(set: &Set, plan: &Plan, notes: &mut Diagnostics) -> (Vec<Option<PressMetadata>>, Report) {
    let mut problems = Diagnostics::default();
    let object = |name: &str| {
        let of_class = |class: &str| {
            let mut all = plan.sampling.objects.iter().enumerate().filter(|(_, object)| object.class == class);
            all.next().filter(|_| all.next().is_none()).map(|(number, _)| number)
        };
        plan.sampling.objects.iter().position(|object| object.id == name).or_else(|| of_class(name))
    };
    let names: Vec<&str> = plan.sampling.objects.iter().map(|object| object.id.as_str()).collect();
    let mut metadata = Vec::with_capacity(set.reals.len());
    for real in &set.reals {
        let facts = &real.facts;
        let name = facts.object.as_deref().or(facts.class.as_deref());
        let number = name.and_then(|name| {
            let found = object(name);
            if found.is_none() {
                let near = nearest(name, names.iter().copied())
                    .map_or(String::new(), |near| format!("did you mean `{near}`? "));
                let problem: Diagnostic = set.problem(real, format!("no [[object]] is called `{name}`"));
                problems.push(problem.help(format!("{near}there are {}", names.join(", "))));
            }
            found
        });
        if let Some(depth) = facts.depth_mm.filter(|depth| *depth > plan.thickness_mm()) {
            let problem =
                set.problem(real, format!("a depth of {depth} mm is more than the pad's {} mm", plan.thickness_mm()));
            problems.push(problem.help("give depths in mm, or the pad's thickness with [sensor] gelpad_thickness_mm"));
        }
        metadata.push(number.zip(facts.depth_mm).map(|(object, depth_mm)| PressMetadata {
            object,
            orientation:
                facts.quaternion_xyzw.map_or_else(|| Orientation::Angles(angles(facts)), Orientation::Quaternion),
            position_mm: facts.place_mm.map(|mm| mm.unwrap_or(0.0)),
            depth_mm,
        }));
    }
    let without = metadata.iter().filter(|found| found.is_none()).count();
    if without > 0 {
        let message =
            format!("{without} of {} real samples have no twin: object or depth is not known", metadata.len());
        notes.push(Diagnostic::note(message).help("fill them in, or leave such rows out"));
    }
    (metadata, Report::new(&problems, &set.sources))
}

fn angles(facts: &LabelFacts) -> Angles {
    Angles {
        yaw_deg: facts.yaw_deg.unwrap_or(0.0),
        tilt_deg: facts.tilt_deg.unwrap_or(0.0),
        tilt_azimuth_deg: facts.tilt_azimuth_deg.unwrap_or(0.0),
    }
}
