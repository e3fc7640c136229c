//! Resolves an AUGMENT.toml to a recipe: reads the set, finds sensor, backgrounds, objects and job, chooses samples,
//! and finds every mistake before anything is written.

use std::io;
use std::path::{Path, PathBuf};

use super::config::{Augment, SplitBy};
use super::counterpart::{CounterpartRenderer, PressMetadata};
use super::input::columns::{ColumnMeaning, is_own_label};
use super::input::{self, InputLayout, RealDataset};
use super::photometric::PhotometricRecipe;
use super::split::{Division, Recipients};
use super::synthetic_mix::{self, SyntheticMix};
use super::trace::TraceColumns;
use super::{make, metadata, photometric, sensor};
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::foreign::decode_text;
use gelsim_files::input as files;
use gelsim_job::config::document::{Document, MAX_READ_BYTES};
use gelsim_job::config::{self, FileKind, ParsedJob};
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::JobChecker;
use gelsim_job::plan::markers::read_marker_file;

/// Largest seed.
const MAX_SEED: f64 = 9_007_199_254_740_991.0;

/// Everything that an output depends on, resolved and checked.
pub struct Recipe {
    /// Name of the file without its ending.
    pub name: String,
    /// Folder of the output unless the command line gives another.
    pub root: PathBuf,
    /// Text of the file, and the assignments that changed it.
    pub text: String,
    /// Seed of all randomness.
    pub seed: u64,
    /// The real dataset.
    pub set: RealDataset,
    /// Recipes for copies of its images.
    pub photometric: Vec<PhotometricRecipe>,
    /// Renderer of counterparts, if there are any.
    pub renderer: Option<CounterpartRenderer>,
    /// Metadata of each real sample; none for those without a counterpart.
    pub metadata: Vec<Option<PressMetadata>>,
    /// Splits of the output.
    pub division: Division,
    /// Splits that get derived samples.
    pub recipients: Recipients,
    /// Column of the split, if splits are new.
    pub split_column: Option<String>,
    /// New samples, if there are any.
    pub mix: Option<SyntheticMix>,
    /// Columns that say where samples come from.
    pub trace: TraceColumns,
    /// Notes that are no mistakes.
    pub notes: Report,
}

impl Recipe {
    /// Reads and resolves the file at `path`, changed by the assignments `set` (flag and assignment each).
    pub fn load(path: &Path, set: &[(String, String)]) -> Result<Self, Report> {
        let shown = path.display().to_string();
        let bytes = files::read(path, MAX_READ_BYTES).map_err(|error| report_unreadable(path, &error))?;
        let text = decode_text(bytes)
            .map_err(|reason| user_error(format!("cannot read {shown}: {reason}"), "a recipe is a text in UTF-8"))?;
        let mut problems = Diagnostics::default();
        let folder = path.parent().unwrap_or(Path::new(""));
        let merged = config::read_merged::<Augment>(FileKind::Recipe, &shown, text.clone(), folder, set, &mut problems);
        if merged.broken {
            return Err(Report::new(&problems, &merged.document.sources));
        }
        let name =
            path.file_stem().map_or_else(|| String::from("augmented"), |stem| stem.to_string_lossy().into_owned());
        let assignments = set.iter().map(|(flag, assignment)| format!("# {flag}: {assignment}\n"));
        resolve_recipe(name, text + &assignments.collect::<String>(), merged, problems)
    }

    /// Number of photometric copies of each real image of a split.
    fn photometric_copies(&self, split: usize) -> u64 {
        let recipes = self.photometric.iter().zip(&self.recipients.photometric);
        recipes.filter(|(_, splits)| splits[split]).map(|(recipe, _)| u64::from(recipe.copies_per_image())).sum()
    }

    /// Number of samples in the output.
    pub fn sample_count(&self) -> u64 {
        let synthetic = self.mix.iter().flat_map(|mix| &mix.chosen).map(|chosen| chosen.len() as u64).sum::<u64>();
        self.count_without_synthetic() + synthetic
    }

    /// Number of samples in the output without synthetic ones.
    fn count_without_synthetic(&self) -> u64 {
        let counterparts = self.metadata.iter().flatten().count() as u64;
        let reals = self.division.real_counts();
        let with_copies = reals.iter().enumerate().map(|(split, count)| count * (1 + self.photometric_copies(split)));
        with_copies.sum::<u64>() + counterparts
    }
}

/// Returns the error for a file that cannot be read, and which one may be meant.
fn report_unreadable(path: &Path, error: &io::Error) -> Report {
    let message = format!("{}: cannot read it: {error}", path.display());
    if path.is_dir() {
        let help = "name a file that ends in .toml and says what is done with a dataset; configs/augment.toml is one";
        return user_error(message, help);
    }
    let is_toml = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
    let near = Some(path)
        .filter(|_| error.kind() == io::ErrorKind::NotFound)
        .and_then(|path| files::suggest_file_name(path, is_toml));
    match near {
        Some(near) => user_error(message, format!("did you mean {}?", path.with_file_name(near).display())),
        None => user_error(
            message,
            "name a file that says what is done with a dataset: configs/augment.toml is one, `gelsim schema augment` has all keys",
        ),
    }
}

/// Resolves a file that was parsed. Collects mistakes of all parts before it fails.
fn resolve_recipe(
    name: String,
    text: String,
    merged: config::MergedDocument<Augment>,
    mut problems: Diagnostics,
) -> Result<Recipe, Report> {
    let config::MergedDocument { value: mut written, document, sensor_known, presets, .. } = merged;
    let mut check = JobChecker { document: &document, problems: &mut problems };
    check.require_in_range("seed", written.seed as f64, 0.0..=MAX_SEED, "");
    check.refuse_random_sensor(&written.sensor);
    if presets.is_some() {
        check.report_error("sensor.preset", "several presets", "name one: real images come from one sensor");
    }
    check_not_empty(&mut check, &written);
    let mut notes = Diagnostics::default();
    let (set, mut report) = input::read(&mut check, &written.input, &mut notes);
    let size = set.as_ref().map(|set| set.size);
    let trace = TraceColumns::new(&written.output.prefix);
    let division = set.as_ref().map(|set| {
        check_trace_columns(&mut check, set, &trace);
        divide_splits(&mut check, &written, set)
    });
    let recipients = division.as_ref().map(|division| Recipients::resolve_recipients(&mut check, &written, division));

    let mut job = sensor::build_sensor_job(&mut check, &written, size);
    let background = sensor::read_background(&mut check, &written, &job, size);
    let own = set.as_ref().is_some_and(|set| is_own_label(&set.example));
    if own && document.get("pose.anchor").is_none() {
        job.pose.anchor = Anchor::Origin;
    }
    let is_rendered = written.input.background.as_deref() == Some(sensor::RENDERED);
    let profile =
        sensor::build_sensor_profile(&mut check, &mut job.clone(), set.as_ref(), background.clone(), is_rendered);
    for (k, recipe) in written.photometric.iter_mut().enumerate() {
        if let Some(markers) = &mut recipe.markers {
            read_marker_file(&mut check, &format!("photometric.{k}.markers"), markers);
        }
        recipe.check(&mut check, &format!("photometric.{k}"), profile.as_ref());
    }
    let photometric = profile.as_ref().filter(|_| check.problems.is_empty()).map(|profile| {
        let ready = |(k, recipe): (usize, &photometric::Photometric)| {
            recipe.build_recipe(&mut check, &format!("photometric.{k}"), profile)
        };
        written.photometric.iter().enumerate().filter_map(ready).collect::<Vec<_>>()
    });
    if let Some(mixing) = &written.mixing {
        synthetic_mix::check_numbers(&mut check, mixing);
    }
    if written.mixing.is_some() && set.as_ref().is_some_and(|set| set.layout == InputLayout::Coco) {
        let help = "leave [mixing] out: copies and simulated counterparts keep the boxes of their image; `gelsim generate` makes \
                    a set of its own, whose `contact` layer shows where the press is";
        check.report_error("mixing", "a new sample has no boxes as these annotations mean them", help);
    }
    if let Some(paired) = &written.paired {
        paired.check(&mut check, "paired");
        metadata::check_paired_input(&mut check, &written, set.as_ref(), background.as_ref());
    }

    // The counterparts' plan takes over the problems found so far, and adds those of sensor and objects.
    let mut of_reals = Vec::new();
    let mut renderer = None;
    if let Some(paired) = &written.paired {
        let before = std::mem::take(&mut problems);
        let counterparts = ParsedJob {
            job,
            document: document.clone(),
            broken: false,
            sensor_known,
            other_presets: Vec::new(),
            right_finger: None,
            further_sensors: Vec::new(),
            calibration: None,
        };
        let plan = match Plan::resolve_objects(counterparts, before) {
            Ok(plan) => plan,
            Err(found) => return Err(add_mixing_problems(found.merged_with(report), &document, &written, size)),
        };
        if let (Some(set), Some(division), Some(recipients)) = (&set, &division, &recipients) {
            notes.extend(compare_sensors(set, &plan.job().sensor.name, "counterparts"));
            let receives = |number: usize| recipients.paired[division.split_of_real[number]];
            let (found, unknown) = metadata::resolve_presses(set, &plan, &receives, &mut notes);
            of_reals = found;
            report = report.merged_with(unknown);
        }
        let background = background.and_then(|reference| sensor::background_to_rgb(&reference));
        renderer = background.map(|background| CounterpartRenderer::new(plan, paired.clone(), background));
    }
    let mut check = JobChecker { document: &document, problems: &mut problems };
    let mixing = written.mixing.as_ref();
    let (plan, of_job) =
        mixing.map_or((None, Report::default()), |mixing| synthetic_mix::load_plan(&mut check, mixing, size));
    report = report.merged_with(of_job);
    let is_sound = check.problems.is_empty() && report.is_empty();
    let (Some(set), Some(division), Some(recipients), true) = (set, division, recipients, is_sound) else {
        return Err(Report::new(&problems, &document.sources).merged_with(report));
    };
    of_reals.resize(set.reals.len(), None);
    let own_column = set.columns.column_of(ColumnMeaning::Split).map(str::to_owned);
    let split_column = match (division.is_new, division.has_own_files) {
        (false, _) => None,
        (true, true) => own_column,
        (true, false) => Some(own_column.unwrap_or_else(|| String::from("split"))),
    };
    let named = written.output.path.as_ref().map(|path| document.folder_of("output.path").join(path));
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
        let mut of_labels = Diagnostics::default();
        synthetic_mix::check_class_folders(&mut check, &recipe.set, &plan, &mut of_labels);
        synthetic_mix::warn_of_unlabelled_samples(&recipe.set, &mut of_labels);
        of_labels.extend(compare_sensors(&recipe.set, &plan.job().sensor.name, "new samples"));
        recipe.notes = recipe.notes.merged_with(Report::new(&of_labels, &document.sources));
        recipe.notes = recipe.notes.merged_with(plan.notes.clone());
        let without_synthetic = recipe.count_without_synthetic();
        let Recipe { set, division, recipients, .. } = &recipe;
        recipe.mix = synthetic_mix::choose_samples(
            &mut check,
            mixing,
            plan,
            set,
            division,
            &recipients.mixing,
            without_synthetic,
        );
        if recipe.mix.is_none() {
            return Err(Report::new(&problems, &document.sources));
        }
    }
    let Some(name) = make::find_name_collision(&recipe) else { return Ok(recipe) };
    let message = format!("{name} would be the name of two samples of the output");
    let root = &recipe.set.root;
    Err(match root.join("augment.json").is_file() {
        true => user_error(
            format!("{message}: {} is an output of gelsim augment already", root.display()),
            "name the dataset that it was made of: what was made of it would count as real",
        ),
        false => user_error(
            message,
            "rename the real one: images made of KEY.png and of KEY.jpg are called KEY-photometric-0-0.png and KEY-twin.png, new \
             ones synthetic-NUMBER.png",
        ),
    })
}

/// Adds the problems of the job that `[mixing]` names to a report, although the run has failed already.
fn add_mixing_problems(report: Report, document: &Document, written: &Augment, size: Option<[usize; 2]>) -> Report {
    let Some(mixing) = &written.mixing else { return report };
    let mut problems = Diagnostics::default();
    let (_, of_job) = synthetic_mix::load_plan(&mut JobChecker { document, problems: &mut problems }, mixing, size);
    report.merged_with(Report::new(&problems, &document.sources)).merged_with(of_job)
}

/// Reports a file that asks for nothing.
fn check_not_empty(check: &mut JobChecker<'_>, written: &Augment) {
    let nothing = written.photometric.is_empty() && written.paired.is_none() && written.mixing.is_none();
    let misspelt = ["photometric", "paired", "mixing"].iter().any(|table| check.is_misspelt(table));
    if nothing && !misspelt && written.output.splits.is_none() && check.is_valid("photometric") {
        let help = "add [[photometric]], [paired] with an [[object]], [mixing] with a job, or [output] splits";
        check.report_error("input", "nothing is asked for", help);
    }
}

/// Reports columns that the trace would overwrite.
fn check_trace_columns(check: &mut JobChecker<'_>, set: &RealDataset, trace: &TraceColumns) {
    let header = set.units.iter().filter_map(|unit| match &unit.form {
        input::LabelFormat::Csv(names) => Some(names),
        _ => None,
    });
    let names: Vec<&String> = header.flatten().chain(set.example.keys()).collect();
    if let Some(taken) = trace.0.iter().find(|name| names.contains(name)) {
        let message = format!("the labels have a column `{taken}` already");
        let help = "give the columns that augment adds other names: [output] prefix = \"gelsim_\"";
        check.report_error("output.prefix", message, help);
    }
}

/// Returns a warning about labels of gelsim that name another sensor than the one of what is made from them.
fn compare_sensors(set: &RealDataset, sensor: &str, made: &str) -> Option<Diagnostic> {
    let theirs = set.example.get("sensor")?.get("name")?.as_str().filter(|_| is_own_label(&set.example))?;
    let message = format!("the labels are of the sensor `{theirs}`, and {made} would be of `{sensor}`");
    (theirs != sensor).then(|| {
        Diagnostic::warning(message)
            .help("write that sensor under [sensor], with `preset` or `file`; of [mixing] in its job")
    })
}

/// Determines the splits: the input's own, or new ones.
fn divide_splits(check: &mut JobChecker<'_>, written: &Augment, set: &RealDataset) -> Division {
    let output = &written.output;
    let known = |meaning: ColumnMeaning| set.columns.column_of(meaning).is_some();
    let by = output.split_by.unwrap_or(if known(ColumnMeaning::Group) { SplitBy::Group } else { SplitBy::Sample });
    let absent = match by {
        SplitBy::Group => (!known(ColumnMeaning::Group)).then_some("group"),
        SplitBy::Object => (!known(ColumnMeaning::Object) && !known(ColumnMeaning::Class)).then_some("object"),
        SplitBy::Sample => None,
    };
    if let Some(absent) = absent {
        let message = format!("no column of the labels is the {absent}");
        check.report_error("output.split_by", message, format!("name it with input.columns.{absent}"));
    }
    match output.splits {
        None => Division::from_input(set, output.split_by),
        Some(fractions) => {
            for (name, fraction) in [("train", fractions.train), ("val", fractions.val), ("test", fractions.test)] {
                check.require_in_range(&format!("output.splits.{name}"), fraction, 0.0..=1.0, "");
            }
            let sum = fractions.train + fractions.val + fractions.test;
            if (sum - 1.0).abs() > 1e-6 && check.is_valid("output.splits") {
                check.report_error("output.splits", format!("the shares sum to {sum}"), "they must sum to 1");
            }
            Division::draw_splits(set, fractions, by, written.seed)
        }
    }
}
