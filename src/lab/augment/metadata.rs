//! Metadata of real samples for their counterparts.

use super::config::Augment;
use super::counterpart::{Orientation, PressMetadata};
use super::input::Set;
use super::input::columns::{LabelFacts, Meaning};
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::pose::Angles;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::spelling::{nearest, one_of};
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::Check;

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

/// The metadata of each real sample that `receives` a counterpart, by its number. A sample whose label names no object or
/// no depth has none; one that names an object that is not there is a mistake.
pub fn resolve(
    set: &Set,
    plan: &Plan,
    receives: &dyn Fn(usize) -> bool,
    notes: &mut Diagnostics,
) -> (Vec<Option<PressMetadata>>, Report) {
    let mut problems = Diagnostics::default();
    let mut metadata = vec![None; set.reals.len()];
    let mut without = Vec::new();
    let mut received = 0;
    for (number, real) in set.reals.iter().enumerate().filter(|(number, _)| receives(*number)) {
        received += 1;
        let facts = &real.facts;
        let name = facts.object.as_deref().or(facts.class.as_deref());
        let object = name.map(|name| find_object(plan, name));
        if let (Some(name), Some(Err((cause, help)))) = (name, &object) {
            let problem = set.problem(real, cause.message(name)).help(help);
            problems.push(problem.of(&real.key, cause.of_many(name)));
        }
        let thickness = plan.thickness_mm();
        if let Some(depth) = facts.depth_mm.filter(|depth| *depth > thickness) {
            let problem = set.problem(real, format!("a depth of {depth} mm is more than the pad's {thickness} mm"));
            let problem = problem
                .of(format!("{} ({depth} mm)", real.key), format!("depths are more than the pad's {thickness} mm"));
            problems.push(problem.help("give depths in mm, or the pad's thickness with [sensor] gelpad_thickness_mm"));
        }
        let (Some(Ok(object)), Some(depth_mm)) = (object, facts.depth_mm) else {
            without.push(real.key.as_str());
            continue;
        };
        metadata[number] = Some(PressMetadata {
            object,
            orientation: facts
                .quaternion_xyzw
                .map_or_else(|| Orientation::Angles(angles(facts)), Orientation::Quaternion),
            position_mm: facts.place_mm.map(|mm| mm.unwrap_or(0.0)),
            depth_mm,
        });
    }
    if !without.is_empty() && problems.is_empty() {
        let (first, more) = (without.iter().take(NAMED).copied().collect::<Vec<_>>().join(", "), without.len() > NAMED);
        let message = format!(
            "{} of {received} real samples get no simulated counterpart: their labels name no object or no depth ({first}{})",
            without.len(),
            if more { ", .." } else { "" }
        );
        let object = set.columns.name(Meaning::Object).or_else(|| set.columns.name(Meaning::Class));
        let columns: Vec<&str> = object.into_iter().chain(set.columns.name(Meaning::Depth)).collect();
        let help = format!("fill {} in for them", and_list(&columns));
        notes.push(Diagnostic::note(message).help(help));
    }
    (metadata, Report::new(&problems, &set.sources))
}

/// Samples that a message names.
const NAMED: usize = 3;

/// Why it is not known which object a label names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum UnknownObject {
    /// No object is called so.
    NoSuch,
    /// Several are of this class.
    Several,
}

impl UnknownObject {
    fn message(self, name: &str) -> String {
        match self {
            Self::NoSuch => format!("no [[object]] is called `{name}`"),
            Self::Several => format!("several [[object]]s are of the class `{name}`"),
        }
    }

    fn of_many(self, name: &str) -> String {
        match self {
            Self::NoSuch => format!("labels name `{name}`, and no [[object]] is called so"),
            Self::Several => format!("labels name `{name}`, and several [[object]]s are of this class"),
        }
    }
}

/// The object that a label names by its id or its class; else why it is not known, and what to do.
fn find_object(plan: &Plan, name: &str) -> Result<usize, (UnknownObject, String)> {
    let objects = &plan.sampling.objects;
    if let Some(number) = objects.iter().position(|object| object.id == name) {
        return Ok(number);
    }
    let of_class: Vec<usize> = (0..objects.len()).filter(|&number| objects[number].class == name).collect();
    if let [only] = of_class.as_slice() {
        return Ok(*only);
    }
    let ids = |numbers: &mut dyn Iterator<Item = usize>| numbers.map(|k| objects[k].id.as_str()).collect::<Vec<_>>();
    if of_class.is_empty() {
        let ids = ids(&mut (0..objects.len()));
        let near =
            nearest(name, ids.iter().copied()).map_or(String::new(), |near| format!("; or did you mean `{near}`?"));
        let help = format!(
            "call the object so that it is: class = {name:?} under its [[object]] (there are {}){near}",
            and_list(&ids)
        );
        return Err((UnknownObject::NoSuch, help));
    }
    let help = format!(
        "give each a class of its own, or name them in a column, which input.columns.object names: {}",
        one_of(&ids(&mut of_class.into_iter()))
    );
    Err((UnknownObject::Several, help))
}

/// `a`, `b` and `c`; of many the first.
fn and_list(names: &[&str]) -> String {
    const MOST: usize = 20;
    let mut quoted: Vec<String> = names.iter().take(MOST).map(|name| format!("`{name}`")).collect();
    if names.len() > MOST {
        quoted.push(format!("{} more", names.len() - MOST));
    }
    match quoted.split_last() {
        None => String::from("nothing"),
        Some((only, [])) => only.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
    }
}

fn angles(facts: &LabelFacts) -> Angles {
    Angles {
        yaw_deg: facts.yaw_deg.unwrap_or(0.0),
        tilt_deg: facts.tilt_deg.unwrap_or(0.0),
        tilt_azimuth_deg: facts.tilt_azimuth_deg.unwrap_or(0.0),
    }
}
