//! From an AUGMENT.toml to a recipe: the set read, sensor, backgrounds, objects and job found, samples chosen; every mistake
//! found before anything is written.

use std::io;
use std::path::{Path, PathBuf};

use super::config::{Augment, SplitBy};
use super::counterpart::{CounterpartRenderer, PressMetadata};
use super::input::columns::{Meaning, is_own};
use super::input::{self, Layout, Set};
use super::photometric::PhotometricRecipe;
use super::split::{Division, Recipients};
use super::synthetic_mix::{self, SyntheticMix};
use super::trace::TraceColumns;
use super::{make, metadata, photometric, sensor};
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::input as files;
use gelsim_job::config::document::{Document, MOST_READ};
use gelsim_job::config::{self, Written};
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::Check;

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
    /// The splits that get what is made.
    pub recipients: Recipients,
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
        let bytes = files::read(path, MOST_READ).map_err(|error| unreadable(path, &error))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let message = format!("{shown}: not UTF-8 at byte {}", error.utf8_error().valid_up_to());
            user_error(message, "save it as a text in UTF-8")
        })?;
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

    /// Images made of each real one of a split by photometric recipes.
    fn copies(&self, split: usize) -> u64 {
        let recipes = self.photometric.iter().zip(&self.recipients.photometric);
        recipes.filter(|(_, splits)| splits[split]).map(|(recipe, _)| u64::from(recipe.copies())).sum()
    }

    /// Samples of the output.
    pub fn samples(&self) -> u64 {
        let synthetic = self.mix.iter().flat_map(|mix| &mix.chosen).map(|chosen| chosen.len() as u64).sum::<u64>();
        self.without_synthetic() + synthetic
    }

    /// The same without synthetic ones.
    fn without_synthetic(&self) -> u64 {
        let counterparts = self.metadata.iter().flatten().count() as u64;
        let reals = self.division.counts();
        let with_copies = reals.iter().enumerate().map(|(split, count)| count * (1 + self.copies(split)));
        with_copies.sum::<u64>() + counterparts
    }
}

/// Why the file cannot be read, and which one may be meant.
fn unreadable(path: &Path, error: &io::Error) -> Report {
    let message = format!("{}: cannot read it: {error}", path.display());
    if path.is_dir() {
        let help = "name a file that ends in .toml and says what is done with a dataset; configs/augment.toml is one";
        return user_error(message, help);
    }
    let is_toml = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
    let near =
        Some(path).filter(|_| error.kind() == io::ErrorKind::NotFound).and_then(|path| files::meant(path, is_toml));
    match near {
        Some(near) => user_error(message, format!("did you mean {}?", path.with_file_name(near).display())),
        None => user_error(
            message,
            "name a file that says what is done with a dataset: configs/augment.toml is one, `gelsim schema augment` has all keys",
        ),
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
    let mut notes = Diagnostics::default();
    let (set, mut report) = input::read(&mut check, &written.input, &mut notes);
    let size = set.as_ref().map(|set| set.size);
    let trace = TraceColumns::new(&written.output.prefix);
    let division = set.as_ref().map(|set| {
        check_trace_columns(&mut check, set, &trace);
        divide(&mut check, &written, set)
    });
    let recipients = division.as_ref().map(|division| Recipients::find(&mut check, &written, division));

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
        synthetic_mix::check(&mut check, mixing);
    }
    if written.mixing.is_some() && set.as_ref().is_some_and(|set| set.layout == Layout::Coco) {
        let help = "leave [mixing] out: copies and simulated counterparts keep the boxes of their image; `gelsim generate` makes \
                    a set of its own, whose `contact` layer shows where the press is";
        check.error("mixing", "a new sample has no boxes as these annotations mean them", help);
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
        if let (Some(set), Some(division), Some(recipients)) = (&set, &division, &recipients) {
            let receives = |number: usize| recipients.paired[division.of_reals[number]];
            let (found, unknown) = metadata::resolve(set, &plan, &receives, &mut notes);
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
    let is_sound = check.problems.is_empty() && report.is_empty();
    let (Some(set), Some(division), Some(recipients), true) = (set, division, recipients, is_sound) else {
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
        recipients,
        set,
    };
    if let (Some(mixing), Some(plan)) = (mixing, plan) {
        let mut new_classes = Diagnostics::default();
        synthetic_mix::check_class_folders(&mut check, &recipe.set, &plan, &mut new_classes);
        recipe.notes = recipe.notes.and(Report::new(&new_classes, &document.sources));
        recipe.notes = recipe.notes.and(plan.notes.clone());
        let without_synthetic = recipe.without_synthetic();
        let Recipe { set, division, recipients, .. } = &recipe;
        recipe.mix =
            synthetic_mix::choose(&mut check, mixing, plan, set, division, &recipients.mixing, without_synthetic);
        if recipe.mix.is_none() {
            return Err(Report::new(&problems, &document.sources));
        }
    }
    match make::collision(&recipe) {
        None => Ok(recipe),
        Some(name) => Err(user_error(
            format!("{name} would be the name of two samples of the output"),
            "rename the real one: images made of KEY.png and of KEY.jpg are called KEY-photometric-0-0.png and KEY-twin.png, new \
             ones synthetic-NUMBER.png",
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
        let help = "add [[photometric]], [paired] with an [[object]], [mixing] with a job, or [output] splits";
        check.error("input", "nothing is asked for", help);
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
