//! Metadata of real samples that their simulated counterparts need.

use super::config::Augment;
use super::counterpart::{Orientation, PressMetadata};
use super::input::RealDataset;
use super::input::columns::{ColumnMeaning, LabelFacts};
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::pose::Angles;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::spelling::{find_nearest_name, join_alternatives};
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::JobChecker;

/// Checks what counterparts need: a background image, and columns for object and depth.
pub fn check_paired_input(
    check: &mut JobChecker<'_>,
    written: &Augment,
    set: Option<&RealDataset>,
    background: Option<&BackgroundImage>,
) {
    if written.input.background.is_none() && background.is_none() {
        let help = "name the background image: [input] background = \"...\"";
        check.report_error(
            "paired",
            "simulated counterparts are aligned by what a press changes, and the background is not known",
            help,
        );
    }
    let Some(set) = set else { return };
    let known = |meaning: ColumnMeaning| set.columns.column_of(meaning).is_some();
    for (found, key, what) in [
        (known(ColumnMeaning::Object) || known(ColumnMeaning::Class), "object", "the object"),
        (known(ColumnMeaning::Depth), "depth_mm", "the depth"),
    ] {
        if !found && check.is_valid("input.columns") {
            let message = format!("no column of the labels is {what}");
            check.report_error("paired", message, format!("name it with input.columns.{key}"));
        }
    }
}

/// Resolves the metadata of each real sample that `receives` a counterpart, by its number. A sample whose label names
/// no object or no depth has none, with a note. Unknown objects and too large depths are mistakes.
pub fn resolve_presses(
    set: &RealDataset,
    plan: &Plan,
    receives: &dyn Fn(usize) -> bool,
    notes: &mut Diagnostics,
) -> (Vec<Option<PressMetadata>>, Report) {
    let mut problems = Diagnostics::default();
    let mut metadata = vec![None; set.reals.len()];
    let (mut without, mut scaled) = (Vec::new(), Vec::new());
    let mut received = 0;
    for (number, real) in set.reals.iter().enumerate().filter(|(number, _)| receives(*number)) {
        received += 1;
        let facts = &real.facts;
        if facts.is_scaled {
            scaled.push(real.key.as_str());
            continue;
        }
        let name = facts.object.as_deref().or(facts.class.as_deref());
        let object = name.map(|name| find_object(plan, name));
        if let (Some(name), Some(Err((cause, help)))) = (name, &object) {
            let problem = set.label_problem(real, cause.message(name)).help(help);
            problems.push(problem.about(&real.key, cause.cause_message(name)));
        }
        let thickness = plan.thickness_mm();
        if let Some(depth) = facts.depth_mm.filter(|depth| *depth > thickness) {
            let problem =
                set.label_problem(real, format!("a depth of {depth} mm is more than the pad's {thickness} mm"));
            let problem = problem
                .about(format!("{} ({depth} mm)", real.key), format!("depths are more than the pad's {thickness} mm"));
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
                .map_or_else(|| Orientation::Angles(angles_of_label(facts)), Orientation::Quaternion),
            position_mm: facts.place_mm.map(|mm| mm.unwrap_or(0.0)),
            depth_mm,
        });
    }
    let no_counterpart = |keys: &[&str], reason: &str| {
        let first = keys.iter().take(MAX_NAMED).copied().collect::<Vec<_>>().join(", ");
        let more = if keys.len() > MAX_NAMED { ", .." } else { "" };
        let count = keys.len();
        format!("{count} of {received} real samples get no simulated counterpart: {reason} ({first}{more})")
    };
    if !scaled.is_empty() && problems.is_empty() {
        let reason = "their objects are scaled (`object.scale`), and a counterpart shows a mesh as large as its file";
        let help = "make the dataset without `scale` and `length_mm`, of meshes that are as large as they are to be";
        notes.push(Diagnostic::note(no_counterpart(&scaled, reason)).help(help));
    }
    if !without.is_empty() && problems.is_empty() {
        let message = no_counterpart(&without, "their labels name no object or no depth");
        let object =
            set.columns.column_of(ColumnMeaning::Object).or_else(|| set.columns.column_of(ColumnMeaning::Class));
        let columns: Vec<&str> = object.into_iter().chain(set.columns.column_of(ColumnMeaning::Depth)).collect();
        let help = format!("fill {} in for them", join_names(&columns));
        notes.push(Diagnostic::note(message).help(help));
    }
    (metadata, Report::new(&problems, &set.sources))
}

/// Most samples that a message names.
const MAX_NAMED: usize = 3;

/// Why a label's object cannot be resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum UnknownObject {
    /// No object has this name.
    NoSuch,
    /// Several objects have this class.
    Several,
}

impl UnknownObject {
    fn message(self, name: &str) -> String {
        match self {
            Self::NoSuch => format!("no [[object]] is called `{name}`"),
            Self::Several => format!("several [[object]]s are of the class `{name}`"),
        }
    }

    fn cause_message(self, name: &str) -> String {
        match self {
            Self::NoSuch => format!("labels name `{name}`, and no [[object]] is called so"),
            Self::Several => format!("labels name `{name}`, and several [[object]]s are of this class"),
        }
    }
}

/// Finds the object that a label names by its id or class. An error says why it cannot be resolved, and what to do.
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
        let near = find_nearest_name(name, ids.iter().copied())
            .map_or(String::new(), |near| format!("; or did you mean `{near}`?"));
        let help = format!(
            "call the object so that it is: class = {name:?} under its [[object]] (there are {}){near}",
            join_names(&ids)
        );
        return Err((UnknownObject::NoSuch, help));
    }
    let help = format!(
        "give each a class of its own, or name them in a column, which input.columns.object names: {}",
        join_alternatives(&ids(&mut of_class.into_iter()))
    );
    Err((UnknownObject::Several, help))
}

/// Formats names as `a`, `b` and `c`; only the first of many.
fn join_names(names: &[&str]) -> String {
    const MAX_NAMES: usize = 20;
    let mut quoted: Vec<String> = names.iter().take(MAX_NAMES).map(|name| format!("`{name}`")).collect();
    if names.len() > MAX_NAMES {
        quoted.push(format!("{} more", names.len() - MAX_NAMES));
    }
    match quoted.split_last() {
        None => String::from("nothing"),
        Some((only, [])) => only.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
    }
}

fn angles_of_label(facts: &LabelFacts) -> Angles {
    Angles {
        yaw_deg: facts.yaw_deg.unwrap_or(0.0),
        tilt_deg: facts.tilt_deg.unwrap_or(0.0),
        tilt_azimuth_deg: facts.tilt_azimuth_deg.unwrap_or(0.0),
    }
}
