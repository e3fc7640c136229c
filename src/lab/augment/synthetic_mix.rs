//! Which samples of a job join the real ones: as many as asked for in each split, as the job draws them or toward classes or
//! cells that the real set lacks. Scenes are drawn and thrown away until one is wanted; only those are rendered.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use rayon::prelude::*;

use super::config::{Mixing, Toward};
use super::coverage::{Bins, Cells, PressFeatures};
use super::input::columns::Meaning;
use super::input::folders::FolderKind;
use super::input::{Layout, Set};
use super::split::Division;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::spelling::one_of;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::Check;
use gelsim_job::scene::{Pressed, Scene};
use gelsim_lab::tradeoff::choose;

/// Scenes that are drawn to see which cells a job reaches.
const PROBES: u64 = 4096;
/// Scenes that are drawn at once.
const BATCH: u64 = 256;
/// Scenes in a row of which none is wanted, for each cell, after which one is taken that is wanted less.
const MOST_MISSES: u64 = 64;
/// Scenes in a row of which none may be in a split, before it is said that none ever will.
const HOPELESS: u64 = 20_000;
/// Objects that a message names.
const MOST_NAMED: usize = 8;

/// Synthetic samples that were chosen.
pub struct SyntheticMix {
    /// The job, resolved.
    pub plan: Plan,
    /// Numbers of its samples for each split, in ascending order.
    pub chosen: Vec<Vec<u64>>,
    /// How presses were told apart.
    pub coverage: Coverage,
}

/// Samples by cell.
pub struct Coverage {
    /// The cells.
    pub cells: Cells,
    /// Those that the job reaches or a real sample is in: what is counted.
    pub counting: Vec<bool>,
    /// Real samples in each.
    pub before: Vec<u64>,
    /// Real and synthetic ones.
    pub after: Vec<u64>,
}

/// Loads the job that `[mixing]` names, for images of the set's size. What is wrong in it is the report.
pub fn plan(check: &mut Check<'_>, mixing: &Mixing, size: Option<[usize; 2]>) -> (Option<Plan>, Report) {
    let Some(job) = &mixing.job else {
        check.missing("mixing.job", "a job of `gelsim generate`: where new samples come from");
        return (None, Report::default());
    };
    let path = check.document.folder("mixing.job").join(job);
    if !path.is_file() {
        check.error("mixing.job", format!("{} does not exist", path.display()), "name a job of `gelsim generate`");
        return (None, Report::default());
    }
    match loaded(&path, size) {
        Ok(plan) => (Some(plan), Report::default()),
        Err(report) => (None, report),
    }
}

fn loaded(path: &Path, size: Option<[usize; 2]>) -> Result<Plan, Report> {
    let set = size.map(|[width, height]| {
        (String::from("[mixing], from the images' size"), format!("sensor.resolution_px = [{width}, {height}]"))
    });
    let plan = Plan::load(path, &Overrides { set: set.into_iter().collect(), fidelity: None })?;
    plan.of_presses("[mixing]")?;
    plan.of_single_objects("[mixing]")?;
    match plan.open_choice() {
        None => Ok(plan),
        Some(bound) => {
            let level = choose::choose(&plan, bound)?.level;
            Ok(plan.with_fidelity(level))
        }
    }
}

/// Checks the table's numbers.
pub fn check(check: &mut Check<'_>, mixing: &Mixing) {
    if let Some(ratio) = mixing.synthetic_per_real {
        check.number("mixing.synthetic_per_real", ratio, 0.0..=1000.0, "");
        if mixing.total.is_some() {
            check.error("mixing.total", "both `synthetic_per_real` and `total` say how many", "keep one of them");
        }
    }
    for (key, bins) in [("depth", mixing.depth_bins), ("place", mixing.place_bins), ("tilt", mixing.tilt_bins)] {
        check.number(&format!("mixing.{key}_bins"), f64::from(bins), 1.0..=100.0, "");
    }
}

/// Checks that classes of the job can be folders, of a set in which they are; notes those that are new there.
pub fn check_class_folders(check: &mut Check<'_>, set: &Set, plan: &Plan, notes: &mut Diagnostics) {
    let Layout::ClassFolders(FolderKind { are_classes: true, .. }) = set.layout else { return };
    let known: BTreeSet<&str> = set.reals.iter().filter_map(|real| real.facts.class.as_deref()).collect();
    let drawn: BTreeSet<&str> = plan.sampling.objects.iter().map(|object| object.class.as_str()).collect();
    for class in drawn.difference(&known).copied() {
        if Path::new(class).components().count() != 1
            || !matches!(Path::new(class).components().next(), Some(Component::Normal(_)))
        {
            let message = format!("the class {class:?} of the job is no name for a folder");
            check.error(
                "mixing.job",
                message,
                "give its [[object]] another `class`: the classes of this set are folders",
            );
            continue;
        }
        let known: Vec<&str> = known.iter().copied().take(MOST_NAMED).collect();
        let note = Diagnostic::note(format!("the class {class:?} of the job is new in the set, and becomes a folder"));
        let help = format!(
            "if it is one of the set's, say so under its [[object]] in the job: class = {:?} ({})",
            known.first().unwrap_or(&""),
            one_of(&known)
        );
        notes.push(note.of(class, "classes of the job are new in the set, and become folders").help(help));
    }
}

/// How many synthetic samples each split gets of those that are `receiving`; `without_synthetic` is how many samples there
/// are without them.
fn amounts(
    check: &mut Check<'_>,
    mixing: &Mixing,
    division: &Division,
    receiving: &[bool],
    without_synthetic: u64,
) -> Vec<u64> {
    let reals = division.counts().into_iter().zip(receiving);
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
        check.error("mixing.total", message, help);
        return vec![0; reals.len()];
    };
    let all: u64 = reals.iter().sum::<u64>().max(1);
    // Running sums, so that the parts add up to the whole.
    let cut = |before: u64| (u128::from(wanted) * u128::from(before) / u128::from(all)) as u64;
    let mut before = 0;
    let parts = reals.iter().map(|count| {
        let part = cut(before + count) - cut(before);
        before += count;
        part
    });
    parts.collect()
}

/// Chooses the samples. `None` after a mistake.
pub fn choose(
    check: &mut Check<'_>,
    mixing: &Mixing,
    plan: Plan,
    set: &Set,
    division: &Division,
    receiving: &[bool],
    without_synthetic: u64,
) -> Option<SyntheticMix> {
    let amounts = amounts(check, mixing, division, receiving, without_synthetic);
    if !check.sound("mixing") || !check.sound("input") {
        return None;
    }
    let sampler = SceneSampler::new(&plan, set);
    let cells = sampler.cells(mixing, set);
    let count = cells.count();
    let probes: Vec<(usize, Option<usize>)> = sampler.batch(0..PROBES, &cells);
    let mut counting = vec![false; count];
    probes.iter().filter_map(|(_, cell)| *cell).for_each(|cell| counting[cell] = true);
    let mut before = vec![vec![0_u64; count]; division.names.len()];
    for (real, split) in set.reals.iter().zip(&division.of_reals) {
        if let Some(cell) = cells.index(&press_of(&real.facts)) {
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
        Toward::Classes => Some(Cells { depth: None, place: None, tilt: None, ..cells.clone() }),
    };
    if let Some(Cells { classes, .. }) = &toward
        && classes.is_empty()
        && mixing.toward == Toward::Classes
    {
        let help = "name it with input.columns.class, or input.columns.object";
        check.error("mixing.toward", "no column of the labels is the class", help);
        return None;
    }
    let mut next = 0;
    let mut after = before.clone();
    let mut chosen = Vec::new();
    for (split, amount) in amounts.iter().enumerate() {
        let picks = match &toward {
            Some(toward) => {
                let mut counts = vec![0; toward.count()];
                for (real, _) in set.reals.iter().zip(&division.of_reals).filter(|(_, of)| **of == split) {
                    toward.index(&press_of(&real.facts)).into_iter().for_each(|cell| counts[cell] += 1);
                }
                sampler.fill(toward, counts, division, split, *amount, &mut next)
            }
            None => sampler.fill(&Cells::single(), vec![0], division, split, *amount, &mut next),
        };
        if (picks.len() as u64) < *amount {
            let name = &division.names[split];
            let message = format!("the job draws no object that may be in the split `{name}`");
            let objects = division.objects_in(split);
            let objects: Vec<&str> = objects.iter().map(String::as_str).take(MOST_NAMED).collect();
            let help = format!(
                "with split_by = \"object\" it may have {}: add one as an [[object]] of the job, with this class, or leave \
                 the split out of `splits` in [mixing]",
                one_of(&objects)
            );
            check.error("mixing.job", message, help);
            return None;
        }
        for cell in picks.iter().filter_map(|index| cells.index(&sampler.press(&sampler.scene(*index)))) {
            after[split][cell] += 1;
            counting[cell] = true;
        }
        chosen.push(picks);
    }
    let after = sum(&after);
    Some(SyntheticMix { coverage: Coverage { cells, counting, before: all_before, after }, chosen, plan })
}

fn press_of(facts: &super::input::columns::LabelFacts) -> PressFeatures<'_> {
    PressFeatures { class: facts.kind(), depth_mm: facts.depth_mm, place_mm: facts.place_mm, tilt_deg: facts.tilt_deg }
}

/// The object of a drawn scene, which always has one.
fn object_of(scene: &Scene) -> usize {
    if let Pressed::Object(object) = scene.pressed { object } else { 0 }
}

/// A job's scenes, told apart as the real set's are.
struct SceneSampler<'a> {
    plan: &'a Plan,
    /// The set names classes, not objects.
    by_class: bool,
    /// The set's places are those of the meshes' origins.
    origin: bool,
}

impl<'a> SceneSampler<'a> {
    fn new(plan: &'a Plan, set: &Set) -> Self {
        let by_class = set.reals.iter().any(|real| real.facts.class.is_some());
        let origin = set.columns.name(Meaning::X).is_some_and(|column| column.starts_with("pose.translation_mm"));
        Self { plan, by_class, origin }
    }

    fn scene(&self, index: u64) -> Scene {
        Scene::draw(self.plan, index, 0)
    }

    fn press(&self, scene: &Scene) -> PressFeatures<'a> {
        let object = &self.plan.sampling.objects[object_of(scene)];
        let translation = scene.pose.translation_mm;
        let place = if self.origin { [translation.x, translation.y] } else { scene.motion.about_mm };
        PressFeatures {
            class: Some(if self.by_class { &object.class } else { &object.id }),
            depth_mm: Some(scene.indentation_depth_mm),
            place_mm: place.map(Some),
            tilt_deg: Some(scene.pose.angles.tilt_deg),
        }
    }

    /// Object and cell of consecutive samples.
    fn batch(&self, indices: std::ops::Range<u64>, cells: &Cells) -> Vec<(usize, Option<usize>)> {
        let draw = |index| {
            let scene = self.scene(index);
            (object_of(&scene), cells.index(&self.press(&scene)))
        };
        indices.into_par_iter().map(draw).collect()
    }

    /// The cells of what the set knows, over what it has and the job draws.
    fn cells(&self, mixing: &Mixing, set: &Set) -> Cells {
        let facts = || set.reals.iter().map(|real| &real.facts);
        let drawn = self.plan.sampling.objects.iter().filter(|object| object.weight > 0.0);
        let drawn = drawn.map(|object| if self.by_class { object.class.as_str() } else { object.id.as_str() });
        let known = facts().any(|facts| facts.kind().is_some());
        let mut classes: Vec<String> =
            if known { drawn.chain(facts().filter_map(|f| f.kind())).map(str::to_owned).collect() } else { Vec::new() };
        classes.sort();
        classes.dedup();
        let depths = || facts().filter_map(|facts| facts.depth_mm);
        let drawn = self.plan.job().indentation.depth_mm.as_ref();
        let depth =
            depths().next().zip(drawn).map(|(_, drawn)| Bins::over(drawn, depths(), mixing.depth_bins as usize));
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
            Bins::over(&none, tilts().chain(largest), mixing.tilt_bins as usize)
        });
        Cells { classes, depth, place, tilt: tilt.filter(|bins| bins.to > bins.from) }
    }

    /// The next `amount` samples of the job for a split that has `counts` samples in its cells: those in the cells that have
    /// the fewest. Fewer if the split takes no object of the job.
    fn fill(
        &self,
        cells: &Cells,
        mut counts: Vec<u64>,
        division: &Division,
        split: usize,
        amount: u64,
        next: &mut u64,
    ) -> Vec<u64> {
        let takes = |object: usize| {
            let object = &self.plan.sampling.objects[object];
            division.takes(split, &object.id, &object.class)
        };
        let mut open = vec![false; counts.len()];
        if amount > 0 {
            let probes = self.batch(0..PROBES, cells);
            let reached = probes.iter().filter(|(object, _)| takes(*object)).filter_map(|(_, cell)| *cell);
            reached.for_each(|cell| open[cell] = true);
        }
        let patience = MOST_MISSES * (counts.len() as u64).max(4);
        // Cells that are still open and below the level are filled first; then it rises. A cell that is not drawn for long
        // is not waited for.
        let lowest = |counts: &[u64], open: &[bool]| {
            counts.iter().zip(open).filter(|(_, open)| **open).map(|(count, _)| *count).min().unwrap_or(u64::MAX - 1)
        };
        let mut level = lowest(&counts, &open) + 1;
        let (mut picks, mut misses, mut strangers) = (Vec::new(), 0, 0);
        while (picks.len() as u64) < amount && strangers < HOPELESS {
            let first = *next;
            for (offset, (object, cell)) in self.batch(first..first + BATCH, cells).into_iter().enumerate() {
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

impl Cells {
    /// One cell that holds everything.
    fn single() -> Self {
        Self { classes: Vec::new(), depth: None, place: None, tilt: None }
    }
}
