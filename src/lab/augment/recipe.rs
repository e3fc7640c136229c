//! From an AUGMENT.toml to a recipe: the set read, sensor, backgrounds, objects and job found, samples chosen; every mistake
//! found before anything is written.

use std::path::{Path, PathBuf};

use super::config::{Augment, SplitBy};
use super::counterpart::{CounterpartRenderer, PressMetadata};
use super::input::columns::{Meaning, is_own};
use super::input::{self, Set};
use super::photometric::PhotometricRecipe;
use super::split::Division;
use super::synthetic_mix::{self, SyntheticMix};
use super::trace::TraceColumns;
use super::{make, metadata, photometric, sensor};
use crate::core::pose::Anchor;
use crate::files::diagnostic::user_error;
use crate::files::diagnostic::{Diagnostics, Report};
use crate::files::input as files;
use crate::job::config::document::{Document, MOST_READ};
use crate::job::config::{self, Written};
use crate::job::plan::Plan;
use crate::job::plan::check::Check;

/// Largest seed.
const MOST_SEED: f64 = 9_007_199_254_740_991.0;

/// Everything an output depends on, resolved and checked.
pub struct Recipe {
    /// The file's name without its ending.
    pub name: String,
    /// Where its output goes unless the command line says otherwise.
    pub root: PathBuf,
    /// Its text, and what was laid over it.
    pub text: String,
    /// Seed of all randomness.
    pub seed: u64,
    /// The real set.
    pub set: Set,
    /// Recipes for its images.
    pub photometric: Vec<PhotometricRecipe>,
    /// Makes counterparts, if they are wanted.
    pub renderer: Option<CounterpartRenderer>,
    /// What is known of each real sample; none of those without a counterpart.
    pub metadata: Vec<Option<PressMetadata>>,
    /// Splits.
    pub division: Division,
    /// The column of the split, if that is set anew.
    pub split_column: Option<String>,
    /// New samples, if they are wanted.
    pub mix: Option<SyntheticMix>,
    /// Columns that say where samples come from.
    pub trace: TraceColumns,
    /// Things the user should know that are no mistakes.
    pub notes: Report,
}

impl Recipe {
    /// Reads and resolves the file at `path`, with the assignments `set` (flag and assignment each) laid over it.
    pub fn load(path: &Path, set: &[(String, String)]) -> Result<Self, Report> {
        let shown = path.display().to_string();
        let text = files::read(path, MOST_READ)
            .and_then(|bytes| String::from_utf8(bytes).map_err(std::io::Error::other))
            .map_err(|error| Report::message(format!("{shown}: cannot read it: {error}")))?;
        let mut problems = Diagnostics::default();
        let folder = path.parent().unwrap_or(Path::new(""));
        let laid = config::lay::<Augment>(&shown, text.clone(), folder, set, &mut problems);
        if laid.broken {
            return Err(Report::new(&problems, &laid.document.sources));
        }
        let name =
            path.file_stem().map_or_else(|| String::from("augmented"), |stem| stem.to_string_lossy().into_owned());
        let laid_over = set.iter().map(|(flag, assignment)| format!("# {flag}: {assignment}\n"));
        resolve(name, text + &laid_over.collect::<String>(), laid, problems)
    }

    /// Images made of each real one by photometric recipes.
    pub fn copies(&self) -> u64 {
        self.photometric.iter().map(|recipe| u64::from(recipe.copies())).sum()
    }

    /// Samples of the output.
    pub fn samples(&self) -> u64 {
        let synthetic = self.mix.iter().flat_map(|mix| &mix.chosen).map(|chosen| chosen.len() as u64).sum::<u64>();
        self.without_synthetic() + synthetic
    }

    /// The same without synthetic ones.
    fn without_synthetic(&self) -> u64 {
        let counterparts = self.metadata.iter().flatten().count() as u64;
        self.set.reals.len() as u64 * (1 + self.copies()) + counterparts
    }
}

fn resolve(
    name: String,
    text: String,
    laid: config::Laid<Augment>,
    mut problems: Diagnostics,
) -> Result<Recipe, Report> {
    let config::Laid { value: written, document, sensor_known, presets, .. } = laid;
    let mut check = Check { document: &document, problems: &mut problems };
    check.number("seed", written.seed as f64, 0.0..=MOST_SEED, "");
    check.one_sensor(&written.sensor);
    if presets.is_some() {
        check.error("sensor.preset", "several presets", "name one: real images come from one sensor");
    }
    check_not_empty(&mut check, &written);
    let (set, mut report) = input::read(&mut check, &written.input);
    let size = set.as_ref().map(|set| set.size);
    let trace = TraceColumns::new(&written.output.prefix);
    let division = set.as_ref().map(|set| {
        check_trace_columns(&mut check, set, &trace);
        divide(&mut check, &written, set)
    });
    let mut notes = Diagnostics::default();

    let mut job = sensor::job(&mut check, &written, size);
    let background = sensor::background(&mut check, &written, &job, size);
    let own = set.as_ref().is_some_and(|set| is_own(&set.example));
    if own && document.get("pose.anchor").is_none() {
        job.pose.anchor = Anchor::Origin;
    }
    let is_rendered = written.input.background.as_deref() == Some(sensor::RENDERED);
    let profile = sensor::profile(&mut check, &mut job.clone(), set.as_ref(), background.clone(), is_rendered);
    for (k, recipe) in written.photometric.iter().enumerate() {
        recipe.check(&mut check, &format!("photometric.{k}"), profile.as_ref());
    }
    let photometric = profile.as_ref().filter(|_| check.problems.is_empty()).map(|profile| {
        let ready = |(k, recipe): (usize, &photometric::Photometric)| {
            recipe.ready(&mut check, &format!("photometric.{k}"), profile)
        };
        written.photometric.iter().enumerate().filter_map(ready).collect::<Vec<_>>()
    });
    if let Some(mixing) = &written.mixing {
        synthetic_mix::check(&mut check, mixing, division.as_ref());
    }
    if let Some(paired) = &written.paired {
        paired.check(&mut check, "paired");
        metadata::check(&mut check, &written, set.as_ref(), background.as_ref());
    }

    // The counterparts' plan takes over what was found so far, and adds what is wrong with sensor and objects.
    let mut of_reals = Vec::new();
    let mut renderer = None;
    if let Some(paired) = &written.paired {
        let before = std::mem::take(&mut problems);
        let counterparts =
            Written { job, document: document.clone(), broken: false, sensor_known, others: Vec::new(), right: None };
        let plan = match Plan::resolve_objects(counterparts, before) {
            Ok(plan) => plan,
            Err(found) => return Err(with_mixing(found.and(report), &document, &written, size)),
        };
        if let Some(set) = &set {
            let (found, unknown) = metadata::resolve(set, &plan, &mut notes);
            of_reals = found;
            report = report.and(unknown);
        }
        let background = background.and_then(|reference| sensor::background_image(&reference));
        renderer = background.map(|background| CounterpartRenderer::new(plan, paired.clone(), background));
    }
    let mut check = Check { document: &document, problems: &mut problems };
    let mixing = written.mixing.as_ref();
    let (plan, of_job) =
        mixing.map_or((None, Report::default()), |mixing| synthetic_mix::plan(&mut check, mixing, size));
    report = report.and(of_job);
    let (Some(set), Some(division), true) = (set, division, check.problems.is_empty() && report.is_empty()) else {
        return Err(Report::new(&problems, &document.sources).and(report));
    };
    of_reals.resize(set.reals.len(), None);
    let own_column = set.columns.name(Meaning::Split).map(str::to_owned);
    let split_column = match (division.anew, division.apart) {
        (false, _) => None,
        (true, true) => own_column,
        (true, false) => Some(own_column.unwrap_or_else(|| String::from("split"))),
    };
    let named = written.output.path.as_ref().map(|path| document.folder("output.path").join(path));
    let mut recipe = Recipe {
        root: named.unwrap_or_else(|| Path::new("out").join(&name)),
        name,
        text,
        seed: written.seed,
        photometric: photometric.unwrap_or_default(),
        renderer,
        metadata: of_reals,
        split_column,
        mix: None,
        trace,
        notes: Report::new(&notes, &document.sources),
        division,
        set,
    };
    if let (Some(mixing), Some(plan)) = (mixing, plan) {
        recipe.notes = recipe.notes.and(plan.notes.clone());
        let without_synthetic = recipe.without_synthetic();
        recipe.mix = synthetic_mix::choose(&mut check, mixing, plan, &recipe.set, &recipe.division, without_synthetic);
        if recipe.mix.is_none() {
            return Err(Report::new(&problems, &document.sources));
        }
    }
    match make::collision(&recipe) {
        None => Ok(recipe),
        Some(name) => Err(user_error(
            format!("{name} is a real sample's, and a sample that is made would be called so"),
            "rename it: images made of KEY are called KEY-photometric-0-0 and KEY-twin, new ones synthetic-NUMBER",
        )),
    }
}

/// A report that also says what is wrong with the job, although more cannot be done with it.
fn with_mixing(report: Report, document: &Document, written: &Augment, size: Option<[usize; 2]>) -> Report {
    let Some(mixing) = &written.mixing else { return report };
    let mut problems = Diagnostics::default();
    let (_, of_job) = synthetic_mix::plan(&mut Check { document, problems: &mut problems }, mixing, size);
    report.and(Report::new(&problems, &document.sources)).and(of_job)
}

fn check_not_empty(check: &mut Check<'_>, written: &Augment) {
    let nothing = written.photometric.is_empty() && written.paired.is_none() && written.mixing.is_none();
    let misspelt = ["photometric", "paired", "mixing"].iter().any(|table| check.misspelt(table));
    if nothing && !misspelt && written.output.splits.is_none() && check.sound("photometric") {
        check.error("input", "nothing is asked for", "add [[photometric]], [paired], [mixing] or [output] splits");
    }
}

/// Columns that the trace would hide.
fn check_trace_columns(check: &mut Check<'_>, set: &Set, trace: &TraceColumns) {
    let header = set.units.iter().filter_map(|unit| match &unit.form {
        input::Form::Csv(names) => Some(names),
        _ => None,
    });
    let names: Vec<&String> = header.flatten().chain(set.example.keys()).collect();
    if let Some(taken) = trace.0.iter().find(|name| names.contains(name)) {
        let message = format!("the labels have a column `{taken}` already");
        let help = "give the columns that augment adds other names: [output] prefix = \"gelsim_\"";
        check.error("output.prefix", message, help);
    }
}

fn divide(check: &mut Check<'_>, written: &Augment, set: &Set) -> Division {
    let output = &written.output;
    let known = |meaning: Meaning| set.columns.name(meaning).is_some();
    let by = output.split_by.unwrap_or(if known(Meaning::Group) { SplitBy::Group } else { SplitBy::Sample });
    let absent = match by {
        SplitBy::Group => (!known(Meaning::Group)).then_some("group"),
        SplitBy::Object => (!known(Meaning::Object) && !known(Meaning::Class)).then_some("object"),
        SplitBy::Sample => None,
    };
    if let Some(absent) = absent {
        let message = format!("no column of the labels is the {absent}");
        check.error("output.split_by", message, format!("name it with input.columns.{absent}"));
    }
    match output.splits {
        None => Division::kept(set, output.split_by),
        Some(fractions) => {
            for (name, fraction) in [("train", fractions.train), ("val", fractions.val), ("test", fractions.test)] {
                check.number(&format!("output.splits.{name}"), fraction, 0.0..=1.0, "");
            }
            let sum = fractions.train + fractions.val + fractions.test;
            if (sum - 1.0).abs() > 1e-6 && check.sound("output.splits") {
                check.error("output.splits", format!("the shares sum to {sum}"), "they must sum to 1");
            }
            Division::drawn(set, fractions, by, written.seed)
        }
    }
}
