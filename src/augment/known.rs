//! What is known of real samples, for their twins.

use super::config::Augment;
use super::input::Set;
use super::input::columns::{Facts, Meaning};
use super::paired::{Known, Turn};
use crate::config::diagnostic::{Problem, Problems, Report, nearest};
use crate::optics::background::Reference;
use crate::plan::Plan;
use crate::plan::check::Check;
use crate::scene::pose::Angles;

/// What twins need of the file.
pub fn needs(check: &mut Check<'_>, written: &Augment, set: Option<&Set>, background: Option<&Reference>) {
    if written.input.background.is_none() && background.is_none() {
        let help = "name the picture of the untouched pad: [input] background = \"...\"";
        check.wrong("paired", "twins are aligned by what a press changes, and the untouched pad is not known", help);
    }
    let Some(set) = set else { return };
    let known = |meaning: Meaning| set.columns.of(meaning).is_some();
    for (there, key, what) in [
        (known(Meaning::Object) || known(Meaning::Class), "object", "the object"),
        (known(Meaning::Depth), "depth_mm", "the depth"),
    ] {
        if !there && check.sound("input.columns") {
            let message = format!("no column of the labels is {what}");
            check.wrong("paired", message, format!("name it with input.columns.{key}"));
        }
    }
}

/// What is known of each real sample, for its twin. A sample whose label names no object or no depth has none; one that
/// names an object that is not there is a mistake.
pub fn know(set: &Set, plan: &Plan, notes: &mut Vec<String>) -> (Vec<Option<Known>>, Report) {
    let mut problems = Problems::default();
    let object = |name: &str| {
        let of_class = |class: &str| {
            let mut all = plan.objects.iter().enumerate().filter(|(_, object)| object.class == class);
            all.next().filter(|_| all.next().is_none()).map(|(number, _)| number)
        };
        plan.objects.iter().position(|object| object.id == name).or_else(|| of_class(name))
    };
    let names: Vec<&str> = plan.objects.iter().map(|object| object.id.as_str()).collect();
    let mut known = Vec::with_capacity(set.reals.len());
    for real in &set.reals {
        let facts = &real.facts;
        let name = facts.object.as_deref().or(facts.class.as_deref());
        let number = name.and_then(|name| {
            let found = object(name);
            if found.is_none() {
                let near = nearest(name, names.iter().copied())
                    .map_or(String::new(), |near| format!("did you mean `{near}`? "));
                let problem: Problem = set.problem(real, format!("no [[object]] is called `{name}`"));
                problems.push(problem.help(format!("{near}there are {}", names.join(", "))));
            }
            found
        });
        if let Some(depth) = facts.depth_mm.filter(|depth| *depth > plan.thickness_mm) {
            let problem =
                set.problem(real, format!("a depth of {depth} mm is more than the pad's {} mm", plan.thickness_mm));
            problems.push(problem.help("give depths in mm, or the pad's thickness with [sensor] gelpad_thickness_mm"));
        }
        known.push(number.zip(facts.depth_mm).map(|(object, depth_mm)| Known {
            object,
            turn: facts.quaternion_xyzw.map_or_else(|| Turn::Angles(angles(facts)), Turn::Quaternion),
            position_mm: facts.place_mm.map(|mm| mm.unwrap_or(0.0)),
            depth_mm,
        }));
    }
    let without = known.iter().filter(|known| known.is_none()).count();
    if without > 0 {
        notes.push(format!("{without} of {} real samples have no twin: object or depth is not known", known.len()));
    }
    (known, Report::new(&problems, &set.sources))
}

fn angles(facts: &Facts) -> Angles {
    Angles {
        yaw_deg: facts.yaw_deg.unwrap_or(0.0),
        tilt_deg: facts.tilt_deg.unwrap_or(0.0),
        tilt_azimuth_deg: facts.tilt_azimuth_deg.unwrap_or(0.0),
    }
}
