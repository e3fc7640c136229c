//! Chooses the samples of a job that join the real ones: as many as asked for in each split, as the job draws them, or
//! toward classes or cells that the real set lacks. Scenes are drawn and dropped until one is wanted; only wanted ones
//! are rendered.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use rayon::prelude::*;

use super::config::{Mixing, Toward};
use super::coverage::{Bins, CoverageCells, PressFeatures};
use super::input::columns::ColumnMeaning;
use super::input::folders::FolderKind;
use super::input::{InputLayout, LabelFormat, RealDataset};
use super::split::Division;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::spelling::join_alternatives;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::JobChecker;
use gelsim_job::scene::{PressSource, Scene};
use gelsim_lab::tradeoff::choose;

/// Number of scenes drawn to see which cells a job reaches.
const PROBE_SCENES: u64 = 4096;
/// Number of scenes drawn at once.
const BATCH_SCENES: u64 = 256;
/// Number of unwanted scenes in a row, per cell, after which less wanted cells are filled instead.
const MAX_MISSES: u64 = 64;
/// Number of scenes in a row that a split refuses, after which none is expected to fit.
const MAX_REFUSED: u64 = 20_000;
/// Most objects or columns that a message names.
const MAX_NAMED: usize = 8;

/// Synthetic samples that were chosen.
pub struct SyntheticMix {
    /// The resolved job.
    pub plan: Plan,
    /// Numbers of its samples for each split, ascending.
    pub chosen: Vec<Vec<u64>>,
    /// Coverage before and after.
    pub coverage: Coverage,
}

/// Number of samples in each cell.
pub struct Coverage {
    /// The cells.
    pub cells: CoverageCells,
    /// Cells that count: those that the job reaches or that hold a real sample.
    pub is_counted: Vec<bool>,
    /// Real samples in each cell.
    pub before: Vec<u64>,
    /// Real and synthetic samples in each cell.
    pub after: Vec<u64>,
}

/// Loads the job that `[mixing]` names, for images of the set's size. Mistakes in the job are returned as a report.
pub fn load_plan(check: &mut JobChecker<'_>, mixing: &Mixing, size: Option<[usize; 2]>) -> (Option<Plan>, Report) {
    let Some(job) = &mixing.job else {
        check.report_missing("mixing.job", "a job of `gelsim generate`: where new samples come from");
        return (None, Report::default());
    };
    let path = check.document.folder_of("mixing.job").join(job);
    if !path.is_file() {
        check.report_error(
            "mixing.job",
            format!("{} does not exist", path.display()),
            "name a job of `gelsim generate`",
        );
        return (None, Report::default());
    }
    match load_job(&path, size) {
        Ok(plan) => (Some(plan), Report::default()),
        Err(report) => (None, report),
    }
}

fn load_job(path: &Path, size: Option<[usize; 2]>) -> Result<Plan, Report> {
    let set = size.map(|[width, height]| {
        (String::from("[mixing], from the images' size"), format!("sensor.resolution_px = [{width}, {height}]"))
    });
    let plan = Plan::load(path, &Overrides { set: set.into_iter().collect(), fidelity: None })?;
    plan.require_single_presses("[mixing]")?;
    plan.require_single_objects("[mixing]")?;
    if plan.job().sensors.is_some() {
        let help = "name a job without [sensors], or the job.toml of one of its datasets";
        return Err(user_error("[mixing] adds samples of one sensor, and this job has several", help));
    }
    match plan.open_fidelity_choice() {
        None => Ok(plan),
        Some(bound) => {
            let level = choose::choose_level(&plan, bound)?.level;
            Ok(plan.with_fidelity(level))
        }
    }
}

/// Checks the numbers in the table.
pub fn check_numbers(check: &mut JobChecker<'_>, mixing: &Mixing) {
    if let Some(ratio) = mixing.synthetic_per_real {
        check.require_in_range("mixing.synthetic_per_real", ratio, 0.0..=1000.0, "");
        if mixing.total.is_some() {
            check.report_error(
                "mixing.total",
                "both `synthetic_per_real` and `total` say how many",
                "keep one of them",
            );
        }
    }
    for (key, bins) in [("depth", mixing.depth_bins), ("place", mixing.place_bins), ("tilt", mixing.tilt_bins)] {
        check.require_in_range(&format!("mixing.{key}_bins"), f64::from(bins), 1.0..=100.0, "");
    }
}

/// If the set's classes are folders, checks that the job's classes can be folders, and notes those that are new.
pub fn check_class_folders(check: &mut JobChecker<'_>, set: &RealDataset, plan: &Plan, notes: &mut Diagnostics) {
    let InputLayout::ClassFolders(FolderKind { are_classes: true, .. }) = set.layout else { return };
    let known: BTreeSet<&str> = set.reals.iter().filter_map(|real| real.facts.class.as_deref()).collect();
    let drawn: BTreeSet<&str> = plan.sampling.objects.iter().map(|object| object.class.as_str()).collect();
    for class in drawn.difference(&known).copied() {
        if Path::new(class).components().count() != 1
            || !matches!(Path::new(class).components().next(), Some(Component::Normal(_)))
        {
            let message = format!("the class {class:?} of the job is no name for a folder");
            check.report_error(
                "mixing.job",
                message,
                "give its [[object]] another `class`: the classes of this set are folders",
            );
            continue;
        }
        let known: Vec<&str> = known.iter().copied().take(MAX_NAMED).collect();
        let note = Diagnostic::note(format!("the class {class:?} of the job is new in the set, and becomes a folder"));
        let help = format!(
            "if it is one of the set's, say so under its [[object]] in the job: class = {:?} ({})",
            known.first().unwrap_or(&""),
            join_alternatives(&known)
        );
        notes.push(note.about(class, "classes of the job are new in the set, and become folders").help(help));
    }
}

/// Warns if new samples get no label because no column of the set is known that a job can fill.
pub fn warn_of_unlabelled_samples(set: &RealDataset, notes: &mut Diagnostics) {
    let filled =
        [ColumnMeaning::Object, ColumnMeaning::Class, ColumnMeaning::Depth, ColumnMeaning::X, ColumnMeaning::Y];
    if set.in_class_folders() || filled.iter().any(|meaning| set.columns.column_of(*meaning).is_some()) {
        return;
    }
    let columns: Vec<&String> = match set.units.first().map(|unit| &unit.form) {
        Some(LabelFormat::Csv(names)) => names.iter().collect(),
        _ => set.example.keys().collect(),
    };
    let split = set.columns.column_of(ColumnMeaning::Split);
    let is_label = |name: &&String| **name != set.image_column && Some(name.as_str()) != split;
    let columns: Vec<&String> = columns.into_iter().filter(is_label).collect();
    let is_other = |suffix: &&String| **suffix != set.image_column && **suffix != set.label_suffix;
    let endings: Vec<&String> = set.suffixes.iter().filter(is_other).collect();
    let known = "object, class, depth or place";
    let (reason, help) = match columns.first() {
        Some(first) => (
            format!("none of {} is known as {known}", list_names(&columns)),
            format!("say which one it is, for example with input.columns.class = {first:?}"),
        ),
        None if endings.is_empty() => return,
        None => (
            format!("no `{}` of the tars tells {known}", set.label_suffix),
            format!("write the class into KEY.{}, and name its key with input.columns.class", set.label_suffix),
        ),
    };
    let missing = match endings.as_slice() {
        [] => String::new(),
        endings => format!(" and no file that ends in {}", list_names(endings)),
    };
    notes.push(Diagnostic::warning(format!("new samples get no label{missing}: {reason}")).help(help));
}

/// Lists names as `a`, `b`; only the first of many.
fn list_names(names: &[&String]) -> String {
    let first: Vec<String> = names.iter().take(MAX_NAMED).map(|name| format!("`{name}`")).collect();
    format!("{}{}", first.join(", "), if names.len() > MAX_NAMED { ", .." } else { "" })
}

/// Computes the number of synthetic samples for each split that is `receiving`. `without_synthetic` is the number of
/// all other samples.
fn compute_amounts(
    check: &mut JobChecker<'_>,
    mixing: &Mixing,
    division: &Division,
    receiving: &[bool],
    without_synthetic: u64,
) -> Vec<u64> {
    let reals = division.real_counts().into_iter().zip(receiving);
    let reals: Vec<u64> = reals.map(|(count, receives)| if *receives { count } else { 0 }).collect();
    let Some(total) = mixing.total else {
        let ratio = mixing.synthetic_per_real.unwrap_or(1.0);
        return reals.iter().map(|count| (ratio * *count as f64).round() as u64).collect();
    };
    let Some(wanted) = total.checked_sub(without_synthetic) else {
        let message = format!("total = {total}, and there are {without_synthetic} samples without any synthetic one");
        let help = format!(
            "write more than {without_synthetic}: total counts real samples, copies, simulated counterparts and synthetic ones"
        );
        check.report_error("mixing.total", message, help);
        return vec![0; reals.len()];
    };
    let all: u64 = reals.iter().sum::<u64>().max(1);
    // Differences of running sums, so that rounded parts add up to the total.
    let cut = |before: u64| (u128::from(wanted) * u128::from(before) / u128::from(all)) as u64;
    let mut before = 0;
    let parts = reals.iter().map(|count| {
        let part = cut(before + count) - cut(before);
        before += count;
        part
    });
    parts.collect()
}

/// Chooses the samples, and counts the coverage. `None` after a mistake.
pub fn choose_samples(
    check: &mut JobChecker<'_>,
    mixing: &Mixing,
    plan: Plan,
    set: &RealDataset,
    division: &Division,
    receiving: &[bool],
    without_synthetic: u64,
) -> Option<SyntheticMix> {
    let amounts = compute_amounts(check, mixing, division, receiving, without_synthetic);
    if !check.is_valid("mixing") || !check.is_valid("input") {
        return None;
    }
    let sampler = SceneSampler::new(&plan, set);
    let cells = sampler.build_cells(mixing, set);
    let count = cells.count();
    let probes: Vec<(usize, Option<usize>)> = sampler.draw_batch(0..PROBE_SCENES, &cells);
    let mut counting = vec![false; count];
    probes.iter().filter_map(|(_, cell)| *cell).for_each(|cell| counting[cell] = true);
    let mut before = vec![vec![0_u64; count]; division.names.len()];
    for (real, split) in set.reals.iter().zip(&division.split_of_real) {
        if let Some(cell) = cells.index(&features_of_label(&real.facts)) {
            before[*split][cell] += 1;
            counting[cell] = true;
        }
    }
    let sum =
        |splits: &[Vec<u64>]| -> Vec<u64> { (0..count).map(|cell| splits.iter().map(|s| s[cell]).sum()).collect() };
    let all_before = sum(&before);
    let toward = match mixing.toward {
        Toward::AsDrawn => None,
        Toward::Coverage => Some(cells.clone()),
        Toward::Classes => Some(CoverageCells { depth: None, place: None, tilt: None, ..cells.clone() }),
    };
    if let Some(CoverageCells { classes, .. }) = &toward
        && classes.is_empty()
        && mixing.toward == Toward::Classes
    {
        let help = "name it with input.columns.class, or input.columns.object";
        check.report_error("mixing.toward", "no column of the labels is the class", help);
        return None;
    }
    let mut next = 0;
    let mut after = before.clone();
    let mut chosen = Vec::new();
    for (split, amount) in amounts.iter().enumerate() {
        let picks = match &toward {
            Some(toward) => {
                let mut counts = vec![0; toward.count()];
                for (real, _) in set.reals.iter().zip(&division.split_of_real).filter(|(_, of)| **of == split) {
                    toward.index(&features_of_label(&real.facts)).into_iter().for_each(|cell| counts[cell] += 1);
                }
                sampler.fill_cells(toward, counts, division, split, *amount, &mut next)
            }
            None => sampler.fill_cells(&CoverageCells::single_cell(), vec![0], division, split, *amount, &mut next),
        };
        if (picks.len() as u64) < *amount {
            let name = &division.names[split];
            let message = format!("the job draws no object that may be in the split `{name}`");
            let objects = division.objects_in(split);
            let objects: Vec<&str> = objects.iter().map(String::as_str).take(MAX_NAMED).collect();
            let help = format!(
                "with split_by = \"object\" it may have {}: add one as an [[object]] of the job, with this class, or leave \
                 the split out of `splits` in [mixing]",
                join_alternatives(&objects)
            );
            check.report_error("mixing.job", message, help);
            return None;
        }
        for cell in picks.iter().filter_map(|index| cells.index(&sampler.scene_features(&sampler.draw_scene(*index)))) {
            after[split][cell] += 1;
            counting[cell] = true;
        }
        chosen.push(picks);
    }
    let after = sum(&after);
    Some(SyntheticMix { coverage: Coverage { cells, is_counted: counting, before: all_before, after }, chosen, plan })
}

fn features_of_label(facts: &super::input::columns::LabelFacts) -> PressFeatures<'_> {
    PressFeatures {
        class: facts.class_or_object(),
        depth_mm: facts.depth_mm,
        place_mm: facts.place_mm,
        tilt_deg: facts.tilt_deg,
    }
}

/// Number of the object of a scene. Scenes of a job always press objects.
fn object_of_scene(scene: &Scene) -> usize {
    if let PressSource::Object(object) = scene.pressed { object } else { 0 }
}

/// Draws a job's scenes, and describes them as the real set describes its samples.
struct SceneSampler<'a> {
    plan: &'a Plan,
    /// Whether the set names classes rather than objects.
    by_class: bool,
    /// Whether the set's places are those of the meshes' origins.
    origin: bool,
}

impl<'a> SceneSampler<'a> {
    fn new(plan: &'a Plan, set: &RealDataset) -> Self {
        let by_class = set.reals.iter().any(|real| real.facts.class.is_some());
        let origin =
            set.columns.column_of(ColumnMeaning::X).is_some_and(|column| column.starts_with("pose.translation_mm"));
        Self { plan, by_class, origin }
    }

    fn draw_scene(&self, index: u64) -> Scene {
        Scene::draw(self.plan, index, 0)
    }

    fn scene_features(&self, scene: &Scene) -> PressFeatures<'a> {
        let object = &self.plan.sampling.objects[object_of_scene(scene)];
        let translation = scene.pose.translation_mm;
        let place = if self.origin { [translation.x, translation.y] } else { scene.motion.about_mm };
        PressFeatures {
            class: Some(if self.by_class { &object.class } else { &object.id }),
            depth_mm: Some(scene.indentation_depth_mm),
            place_mm: place.map(Some),
            tilt_deg: Some(scene.pose.angles.tilt_deg),
        }
    }

    /// Draws consecutive samples, and returns the object and cell of each.
    fn draw_batch(&self, indices: std::ops::Range<u64>, cells: &CoverageCells) -> Vec<(usize, Option<usize>)> {
        let draw = |index| {
            let scene = self.draw_scene(index);
            (object_of_scene(&scene), cells.index(&self.scene_features(&scene)))
        };
        indices.into_par_iter().map(draw).collect()
    }

    /// Builds cells from the features that the set knows, over the values of set and job.
    fn build_cells(&self, mixing: &Mixing, set: &RealDataset) -> CoverageCells {
        let facts = || set.reals.iter().map(|real| &real.facts);
        let drawn = self.plan.sampling.objects.iter().filter(|object| object.weight > 0.0);
        let drawn = drawn.map(|object| if self.by_class { object.class.as_str() } else { object.id.as_str() });
        let known = facts().any(|facts| facts.class_or_object().is_some());
        let mut classes: Vec<String> = if known {
            drawn.chain(facts().filter_map(|f| f.class_or_object())).map(str::to_owned).collect()
        } else {
            Vec::new()
        };
        classes.sort();
        classes.dedup();
        let depths = || facts().filter_map(|facts| facts.depth_mm);
        let drawn = self.plan.job().indentation.depth_mm.as_ref();
        let depth =
            depths().next().zip(drawn).map(|(_, drawn)| Bins::from_values(drawn, depths(), mixing.depth_bins as usize));
        let placed = facts().any(|facts| facts.place_mm.iter().all(Option::is_some));
        let count = mixing.place_bins as usize;
        let view = self.plan.job().sensor.field_of_view_mm;
        let place = placed.then(|| view.map(|mm| Bins { from: -mm / 2.0, to: mm / 2.0, count }));
        let tilts = || facts().filter_map(|facts| facts.tilt_deg).map(f64::abs);
        let distribution = &self.plan.job().pose.tilt_deg;
        let largest = [distribution.support().0, distribution.support().1]
            .map(f64::abs)
            .into_iter()
            .filter(|end| end.is_finite());
        let tilt = tilts().next().map(|_| {
            let none = gelsim_files::sensor::quantity::Quantity::Constant(0.0);
            Bins::from_values(&none, tilts().chain(largest), mixing.tilt_bins as usize)
        });
        CoverageCells { classes, depth, place, tilt: tilt.filter(|bins| bins.to > bins.from) }
    }

    /// Picks the next `amount` samples of the job for a split that has `counts` samples in its cells, preferring cells
    /// with the fewest. Returns fewer if the split accepts no object of the job.
    fn fill_cells(
        &self,
        cells: &CoverageCells,
        mut counts: Vec<u64>,
        division: &Division,
        split: usize,
        amount: u64,
        next: &mut u64,
    ) -> Vec<u64> {
        let takes = |object: usize| {
            let object = &self.plan.sampling.objects[object];
            division.accepts_object(split, &object.id, &object.class)
        };
        let mut open = vec![false; counts.len()];
        if amount > 0 {
            let probes = self.draw_batch(0..PROBE_SCENES, cells);
            let reached = probes.iter().filter(|(object, _)| takes(*object)).filter_map(|(_, cell)| *cell);
            reached.for_each(|cell| open[cell] = true);
        }
        let patience = MAX_MISSES * (counts.len() as u64).max(4);
        // Open cells below the level are filled first, then the level rises. Cells that are not drawn for long are
        // closed, so that rare ones do not stop the others.
        let lowest = |counts: &[u64], open: &[bool]| {
            counts.iter().zip(open).filter(|(_, open)| **open).map(|(count, _)| *count).min().unwrap_or(u64::MAX - 1)
        };
        let mut level = lowest(&counts, &open) + 1;
        let (mut picks, mut misses, mut strangers) = (Vec::new(), 0, 0);
        while (picks.len() as u64) < amount && strangers < MAX_REFUSED {
            let first = *next;
            for (offset, (object, cell)) in self.draw_batch(first..first + BATCH_SCENES, cells).into_iter().enumerate()
            {
                *next = first + offset as u64 + 1;
                if !takes(object) {
                    strangers += 1;
                    continue;
                }
                strangers = 0;
                if let Some(cell) = cell {
                    if counts[cell] >= level {
                        misses += 1;
                        if misses > patience {
                            open.iter_mut().zip(&counts).for_each(|(open, count)| *open &= *count >= level);
                            (level, misses) = (lowest(&counts, &open) + 1, 0);
                        }
                        continue;
                    }
                    counts[cell] += 1;
                    level = level.max(lowest(&counts, &open) + 1);
                }
                misses = 0;
                picks.push(*next - 1);
                if picks.len() as u64 == amount {
                    break;
                }
            }
        }
        picks
    }
}

impl CoverageCells {
    /// A single cell that holds everything.
    fn single_cell() -> Self {
        Self { classes: Vec::new(), depth: None, place: None, tilt: None }
    }
}
