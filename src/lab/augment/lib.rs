//! Enlarges a real dataset in its own layout: its images as other LEDs, gelpads and cameras would have shown them,
//! simulated counterparts of its samples, and new synthetic samples. Every sample is traced to its source.
//!
//! AUGMENT.toml ([`config`]) -> [`recipe`] (resolved, all mistakes found, all choices made) -> `make` (samples) ->
//! [`output`] (files) and [`report`].

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use rayon::prelude::*;

mod card;
pub mod config;
pub mod counterpart;
pub mod coverage;
pub mod input;
mod make;
mod metadata;
pub mod output;
pub mod photometric;
pub mod recipe;
pub mod report;
mod sensor;
pub mod split;
pub mod synthetic_mix;
pub mod trace;

use input::most_member_bytes;
use make::{RawSample, SampleMaker};
use output::folder::{IncompleteOutput, OutputFolder, SUMMARY};
use output::labels::LabelWriter;
use output::{OutputLayout, OutputWriter};
pub use recipe::Recipe;
pub use report::Summary;

use gelsim_dataset::archive;
use gelsim_dataset::cleanup::REPORT_FILE;
use gelsim_dataset::dataset_error::DatasetError;
use gelsim_dataset::generate::{ExpectedWork, RunMonitor};
use gelsim_files::input::MAX_IMAGE_BYTES;

/// Most real samples that are read before their derived samples are written.
const BLOCK: usize = 16;
/// Most samples that are made before they are written, unless a single real one needs more.
const MAX_AT_ONCE: usize = 64;

/// Where an output goes.
pub struct OutputTarget {
    /// Folder of the output.
    pub root: PathBuf,
    /// Number of threads; all cores if absent.
    pub threads: Option<usize>,
    /// Whether to replace an output that exists.
    pub overwrite: bool,
}

/// Why a run ended early. Nothing is written, unless the variant says otherwise.
#[derive(Debug)]
pub enum AugmentError {
    /// The folder cannot be used.
    Refused(DatasetError),
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// The output is written, but the one before it could not be removed from this folder.
    OldNotRemoved(PathBuf, io::Error),
    /// A real image cannot be decoded: which, and why.
    Image(String),
    /// A sample cannot be made.
    Sample(String),
    /// A sample of the job is not healthy, and the job refuses such samples: which, and why.
    Unhealthy(String),
    /// This part of the input has changed since it was checked.
    Changed(PathBuf),
    /// The stop flag was set.
    Interrupted,
}

/// Makes and writes the output of a recipe.
pub fn augment(recipe: &Recipe, target: &OutputTarget, watch: &RunMonitor) -> Result<Summary, AugmentError> {
    let start = Instant::now();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(target.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| AugmentError::Io(target.root.clone(), io::Error::other(error)))?;
    let place =
        OutputFolder::create(&target.root, &recipe.set.root, target.overwrite).map_err(AugmentError::Refused)?;
    // The result is ignored: the value is set only here, once.
    let expected = ExpectedWork { samples: recipe.sample_count(), shards: recipe.set.units.len() as u64, skipped: 0 };
    let _ = watch.expected.set(expected);
    let mut summary = pool.install(|| write_output(recipe, &place.partial, watch))?;
    place.finish().map_err(|unfinished| match unfinished {
        IncompleteOutput::NothingWritten(path, error) => AugmentError::Io(path, error),
        IncompleteOutput::OldNotRemoved(path, error) => AugmentError::OldNotRemoved(path, error),
    })?;
    summary.seconds = start.elapsed().as_secs_f64();
    Ok(summary)
}

/// Writes all files of an output into `root`.
fn write_output(recipe: &Recipe, root: &Path, watch: &RunMonitor) -> Result<Summary, AugmentError> {
    let set = &recipe.set;
    let labels = LabelWriter {
        set,
        trace: recipe.trace.clone(),
        split: recipe.split_column.clone(),
        class_numbers: number_classes(recipe),
    };
    let units = OutputLayout::new(set, &recipe.division);
    let maker = SampleMaker::new(recipe, &labels, &units);
    let mut run = AugmentRun {
        recipe,
        maker,
        writer: OutputWriter::new(root, &units, &labels),
        watch,
        summary: Summary::new(recipe),
    };
    for unit in 0..set.units.len() {
        if set.in_tars() {
            run.augment_tar(unit)?
        } else {
            run.augment_table(unit)?
        }
        watch.written.fetch_add(1, Ordering::Relaxed);
    }
    let AugmentRun { mut writer, mut summary, .. } = run;
    let io = |(path, error)| AugmentError::Io(path, error);
    let card = card::format_card(recipe, &summary, &writer.filled);
    writer.write_file(Path::new("README.md"), card.as_bytes()).map_err(io)?;
    writer.write_file(Path::new(SUMMARY), &summary.to_json(recipe)).map_err(io)?;
    writer.write_file(Path::new(REPORT_FILE), summary.to_html(recipe).as_bytes()).map_err(io)?;
    writer.finish().map_err(io)?;
    summary.bytes = writer.bytes;
    Ok(summary)
}

/// Numbers the classes of an output: those of the real set as its labels do, new ones of the job behind them.
fn number_classes(recipe: &Recipe) -> BTreeMap<String, u64> {
    let mut numbers = recipe.set.class_numbers.clone();
    let first = numbers.values().max().map_or(0, |largest| largest.saturating_add(1));
    let classes = recipe.mix.iter().flat_map(|mix| &mix.plan.sampling.classes);
    let new: Vec<String> = classes.filter(|class| !numbers.contains_key(*class)).cloned().collect();
    numbers.extend(new.into_iter().zip(first..));
    numbers
}

/// State of a run.
struct AugmentRun<'a> {
    recipe: &'a Recipe,
    maker: SampleMaker<'a>,
    writer: OutputWriter<'a>,
    watch: &'a RunMonitor,
    summary: Summary,
}

impl AugmentRun<'_> {
    /// Number of real samples that are read at once.
    fn block_size(&self) -> usize {
        let each = self.recipe.sample_count().div_ceil(self.recipe.set.reals.len().max(1) as u64) as usize;
        (MAX_AT_ONCE / each.max(1)).clamp(1, BLOCK)
    }

    /// Augments the samples of a unit that is a table.
    fn augment_table(&mut self, unit: usize) -> Result<(), AugmentError> {
        let set = &self.recipe.set;
        let numbers: Vec<usize> = set.units[unit].reals.clone().collect();
        for block in numbers.chunks(self.block_size()) {
            let read = |&number: &usize| {
                let real = &set.reals[number];
                let path = set.image_path(real);
                let image =
                    gelsim_files::input::read(&path, MAX_IMAGE_BYTES).map_err(|error| AugmentError::Io(path, error))?;
                Ok(RawSample { number, image, label: set.label_text(real).to_owned(), files: Vec::new() })
            };
            let raws: Vec<RawSample> = block.par_iter().map(read).collect::<Result<_, _>>()?;
            self.write_samples(raws)?;
        }
        Ok(())
    }

    /// Augments the samples of a unit that is a tar. Fails if it has changed since it was checked.
    fn augment_tar(&mut self, unit: usize) -> Result<(), AugmentError> {
        let set = &self.recipe.set;
        let path = set.root.join(&set.units[unit].file);
        let (mut numbers, mut raws, mut stopped) = (set.units[unit].reals.clone(), Vec::new(), None);
        let most = self.block_size();
        let visit = |files: archive::SampleFiles| {
            let expected = numbers.next().filter(|number| set.reals[*number].image == files.key);
            let label = read_object(files.find_member(&set.label_suffix).unwrap_or(b"{}"));
            let result = match (expected, files.find_member(&set.image_column), label) {
                (Some(number), Some(image), Some(label)) => {
                    let (image, label) = (image.to_vec(), label.to_owned());
                    raws.push(RawSample { number, image, label, files: files.members });
                    if raws.len() == most { self.write_samples(std::mem::take(&mut raws)) } else { Ok(()) }
                }
                _ => Err(AugmentError::Changed(path.clone())),
            };
            match result {
                Ok(()) => std::ops::ControlFlow::Continue(()),
                Err(error) => {
                    stopped = Some(error);
                    std::ops::ControlFlow::Break(())
                }
            }
        };
        let most_bytes = |head: archive::MemberHead<'_>| Some(most_member_bytes(head.suffix, &set.label_suffix));
        archive::visit_webdataset_file(&path, most_bytes, visit)
            .map_err(|reason| AugmentError::Sample(format!("{}: {reason}", path.display())))?;
        match stopped {
            Some(stopped) => Err(stopped),
            None => self.write_samples(raws),
        }
    }

    /// Makes and writes everything that derives from some real samples, in order.
    fn write_samples(&mut self, raws: Vec<RawSample>) -> Result<(), AugmentError> {
        let stop = || self.watch.stop.load(Ordering::Relaxed);
        if stop() {
            return Err(AugmentError::Interrupted);
        }
        let made = self.maker.make_samples(&raws, &|| {
            self.watch.rendered.fetch_add(1, Ordering::Relaxed);
            stop()
        })?;
        for (piece, entry) in made {
            self.summary.count_sample(entry);
            self.writer.append_sample(piece).map_err(|(path, error)| AugmentError::Io(path, error))?;
        }
        Ok(())
    }
}

/// Returns the text of a tar's label if it is still a JSON object, as it was when it was checked.
fn read_object(label: &[u8]) -> Option<&str> {
    let is_object = |text: &&str| serde_json::from_str::<serde_json::Map<_, serde_json::Value>>(text).is_ok();
    str::from_utf8(label).ok().filter(is_object)
}
