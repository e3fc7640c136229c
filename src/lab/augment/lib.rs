//! Enlarges a real dataset: its images as other LEDs, gelpads and cameras would have shown them, simulated counterparts
//! of its samples, and new synthetic samples among them; in the layout of the input, every sample traced to its source.
//!
//! AUGMENT.toml ([`config`]) -> [`recipe`] (resolved, every mistake found, every choice made) -> `make` (samples) ->
//! [`output`] (files) and [`report`].

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use rayon::prelude::*;

mod card;
pub mod config;
pub mod counterpart;
pub mod coverage;
mod image_stats;
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

use input::most_bytes;
use make::{Maker, Raw};
use output::labels::Labels;
use output::place::{IncompleteOutput, Place, SUMMARY};
use output::{Units, Writer};
pub use recipe::Recipe;
pub use report::Summary;

use gelsim_dataset::archive;
use gelsim_dataset::cleanup::REPORT;
use gelsim_dataset::generate::{Expected, Watch};
use gelsim_dataset::refused::Refused;
use gelsim_files::input::MOST_IMAGE_BYTES;

/// Real samples that are read before what is made of them is written.
const BLOCK: usize = 16;
/// Samples that are made before they are written, unless a single real one asks for more.
const MOST_AT_ONCE: usize = 64;

/// Where an output goes.
pub struct Target {
    /// Its folder.
    pub root: PathBuf,
    /// Threads; all cores if absent.
    pub threads: Option<usize>,
    /// Replace an output that is there.
    pub overwrite: bool,
}

/// Why a run ended early; nothing is written then, unless it says so.
#[derive(Debug)]
pub enum AugmentError {
    /// The folder cannot be used.
    Refused(Refused),
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// The output is written, but the one before it could not be removed from this folder.
    OldStays(PathBuf, io::Error),
    /// A real image cannot be unpacked: which and why.
    Image(String),
    /// A sample cannot be made.
    Sample(String),
    /// A sample of the job is not healthy, and the job keeps none such: which and why.
    Unhealthy(String),
    /// This part of the input has changed since it was looked at.
    Changed(PathBuf),
    /// The stop flag was raised.
    Interrupted,
}

/// Writes the output of a recipe.
pub fn augment(recipe: &Recipe, target: &Target, watch: &Watch) -> Result<Summary, AugmentError> {
    let start = Instant::now();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(target.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| AugmentError::Io(target.root.clone(), io::Error::other(error)))?;
    let place = Place::take(&target.root, &recipe.set.root, target.overwrite).map_err(AugmentError::Refused)?;
    // Nobody else sets it.
    let expected = Expected { samples: recipe.samples(), shards: recipe.set.units.len() as u64, skipped: 0 };
    let _ = watch.expected.set(expected);
    let mut summary = pool.install(|| write(recipe, &place.partial, watch))?;
    place.finish().map_err(|unfinished| match unfinished {
        IncompleteOutput::NothingWritten(path, error) => AugmentError::Io(path, error),
        IncompleteOutput::OldStays(path, error) => AugmentError::OldStays(path, error),
    })?;
    summary.seconds = start.elapsed().as_secs_f64();
    Ok(summary)
}

fn write(recipe: &Recipe, root: &Path, watch: &Watch) -> Result<Summary, AugmentError> {
    let set = &recipe.set;
    let labels = Labels { set, trace: recipe.trace.clone(), split: recipe.split_column.clone() };
    let units = Units::new(set, &recipe.division);
    let maker = Maker::new(recipe, &labels, &units);
    let mut run =
        Run { recipe, maker, writer: Writer::new(root, &units, &labels), watch, summary: Summary::new(recipe) };
    for unit in 0..set.units.len() {
        if set.in_tars() {
            run.tar(unit)?
        } else {
            run.table(unit)?
        }
        watch.written.fetch_add(1, Ordering::Relaxed);
    }
    let Run { mut writer, mut summary, .. } = run;
    let io = |(path, error)| AugmentError::Io(path, error);
    let card = card::card(recipe, &summary, &writer.filled);
    writer.file(Path::new("README.md"), card.as_bytes()).map_err(io)?;
    writer.file(Path::new(SUMMARY), &summary.json(recipe)).map_err(io)?;
    writer.file(Path::new(REPORT), summary.html(recipe).as_bytes()).map_err(io)?;
    writer.finish().map_err(io)?;
    summary.bytes = writer.bytes;
    Ok(summary)
}

/// A run under way.
struct Run<'a> {
    recipe: &'a Recipe,
    maker: Maker<'a>,
    writer: Writer<'a>,
    watch: &'a Watch,
    summary: Summary,
}

impl Run<'_> {
    /// Real samples that are read at once.
    fn block(&self) -> usize {
        let each = self.recipe.samples().div_ceil(self.recipe.set.reals.len().max(1) as u64) as usize;
        (MOST_AT_ONCE / each.max(1)).clamp(1, BLOCK)
    }

    fn table(&mut self, unit: usize) -> Result<(), AugmentError> {
        let set = &self.recipe.set;
        let numbers: Vec<usize> = set.units[unit].reals.clone().collect();
        for block in numbers.chunks(self.block()) {
            let read = |&number: &usize| {
                let real = &set.reals[number];
                let path = set.path(real);
                let image = gelsim_files::input::read(&path, MOST_IMAGE_BYTES)
                    .map_err(|error| AugmentError::Io(path, error))?;
                Ok(Raw { number, image, label: set.text(real).to_owned(), files: Vec::new() })
            };
            let raws: Vec<Raw> = block.par_iter().map(read).collect::<Result<_, _>>()?;
            self.samples(raws)?;
        }
        Ok(())
    }

    fn tar(&mut self, unit: usize) -> Result<(), AugmentError> {
        let set = &self.recipe.set;
        let path = set.root.join(&set.units[unit].file);
        let (mut numbers, mut raws, mut stopped) = (set.units[unit].reals.clone(), Vec::new(), None);
        let most = self.block();
        let visit = |files: archive::Files| {
            let expected = numbers.next().filter(|number| set.reals[*number].image == files.key);
            let label = read_object(files.member(&set.label).unwrap_or(b"{}"));
            let result = match (expected, files.member(&set.image), label) {
                (Some(number), Some(image), Some(label)) => {
                    let (image, label) = (image.to_vec(), label.to_owned());
                    raws.push(Raw { number, image, label, files: files.members });
                    if raws.len() == most { self.samples(std::mem::take(&mut raws)) } else { Ok(()) }
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
        archive::open(&path, |head| Some(most_bytes(head.suffix, &set.label)), visit)
            .map_err(|reason| AugmentError::Sample(format!("{}: {reason}", path.display())))?;
        match stopped {
            Some(stopped) => Err(stopped),
            None => self.samples(raws),
        }
    }

    /// Makes and writes what comes of some real samples, in order.
    fn samples(&mut self, raws: Vec<Raw>) -> Result<(), AugmentError> {
        let stop = || self.watch.stop.load(Ordering::Relaxed);
        if stop() {
            return Err(AugmentError::Interrupted);
        }
        let made = self.maker.make(&raws, &|| {
            self.watch.rendered.fetch_add(1, Ordering::Relaxed);
            stop()
        })?;
        for (piece, entry) in made {
            self.summary.count(entry);
            self.writer.append(piece).map_err(|(path, error)| AugmentError::Io(path, error))?;
        }
        Ok(())
    }
}

/// The text of a label of a tar that was looked at before, if it still is a JSON object.
fn read_object(label: &[u8]) -> Option<&str> {
    let is_object = |text: &&str| serde_json::from_str::<serde_json::Map<_, serde_json::Value>>(text).is_ok();
    str::from_utf8(label).ok().filter(is_object)
}
