//! What comes of real samples: the sample itself, its copies, its counterpart, and the synthetic samples that follow it.
//!
//! Synthetic samples are dealt out evenly among the real ones of their split, so that no unit is synthetic only. All
//! that is random is addressed by the sample's number: the order of work decides nothing.

use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};

use image::RgbImage;
use rayon::prelude::*;
use serde::Serialize;

use super::counterpart::{Alignment, Counterpart};
use super::image_stats::ImageStats;
use super::input::{Form, Real};
use super::output::labels::{Labels, cells, object};
use super::output::{Piece, Units};
use super::photometric::Applied;
use super::report::{SampleEntry, tile};
use super::trace::{Source, Trace};
use super::{AugmentError, Recipe};
use crate::core::camera::Image;
use crate::dataset::archive::Member;
use crate::dataset::encode::json;
use crate::files::input::{MOST_IMAGE_BYTES, read_if_there};
use crate::files::{image_file, png};

mod synthetic;

/// Real samples that the page shows.
const MOST_ON_PAGE: usize = 6;

/// A real sample's files.
pub struct Raw {
    /// Its number in the set.
    pub number: usize,
    /// Its image's bytes.
    pub image: Vec<u8>,
    /// Its label's text.
    pub label: String,
    /// All its files in a tar, by the ends of their names.
    pub files: Vec<(String, Vec<u8>)>,
}

/// Something to be made.
enum Task {
    Real,
    Copy { recipe: usize, copy: u32, slot: u64 },
    Counterpart,
    Synthetic { index: u64 },
}

/// What was done for a photometric copy.
#[derive(Serialize)]
struct PhotometricTrace<'a> {
    recipe: usize,
    copy: u32,
    #[serde(flatten)]
    applied: &'a Applied,
}

/// What was done for a counterpart.
#[derive(Serialize)]
struct CounterpartTrace {
    offset_px: [f64; 2],
    correlation: f64,
    alignment: Alignment,
    object: String,
    depth_mm: f64,
    position_mm: [f64; 2],
}

/// Makes samples.
pub struct Maker<'a> {
    recipe: &'a Recipe,
    labels: &'a Labels<'a>,
    units: &'a Units<'a>,
    /// Synthetic samples that follow each real one: a range of its split's.
    after: Vec<std::ops::Range<usize>>,
    /// Real samples that the page shows.
    on_page: HashSet<usize>,
    /// Names of columns and ends of names that a synthetic sample's layers may fill.
    columns: HashSet<String>,
}

impl<'a> Maker<'a> {
    /// Makes what a recipe wants.
    pub fn new(recipe: &'a Recipe, labels: &'a Labels<'a>, units: &'a Units<'a>) -> Self {
        let set = &recipe.set;
        let columns = set.example.keys().cloned().chain(set.suffixes.iter().cloned()).collect();
        Self { recipe, labels, units, after: dealt(recipe), on_page: on_page(set.reals.len()), columns }
    }

    /// Everything that comes of some real samples, in order. `tick` is called before each sample and says whether to
    /// stop.
    pub fn make(
        &self,
        raws: &[Raw],
        tick: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<(Piece, SampleEntry)>, AugmentError> {
        let decode = |raw: &Raw| {
            let name = || self.recipe.set.name(&self.recipe.set.reals[raw.number]);
            image_file::decode_rgb(&raw.image).map_err(|reason| AugmentError::Sample(format!("{}: {reason}", name())))
        };
        let images: Vec<RgbImage> = raws.par_iter().map(decode).collect::<Result<_, _>>()?;
        let tasks: Vec<(usize, Task)> =
            raws.iter().enumerate().flat_map(|(k, raw)| self.tasks(raw.number).map(move |task| (k, task))).collect();
        let made = tasks.par_iter().map(|(k, task)| match tick() {
            true => Err(AugmentError::Interrupted),
            false => self.make_one(&raws[*k], &images[*k], task),
        });
        made.collect()
    }

    fn tasks(&self, number: usize) -> impl Iterator<Item = Task> {
        let mut tasks = vec![Task::Real];
        let mut slot = 0;
        for (recipe, made) in self.recipe.photometric.iter().enumerate() {
            for copy in 0..made.copies() {
                tasks.push(Task::Copy { recipe, copy, slot });
                slot += 1;
            }
        }
        tasks
            .extend(self.recipe.metadata[number].map(|_| Task::Counterpart).filter(|_| self.recipe.renderer.is_some()));
        if let Some(mix) = &self.recipe.mix {
            let chosen = &mix.chosen[self.recipe.division.of_reals[number]];
            tasks.extend(chosen[self.after[number].clone()].iter().map(|index| Task::Synthetic { index: *index }));
        }
        tasks.into_iter()
    }

    fn make_one(&self, raw: &Raw, image: &RgbImage, task: &Task) -> Result<(Piece, SampleEntry), AugmentError> {
        let Recipe { seed, set, photometric, renderer, metadata, .. } = self.recipe;
        let real = &set.reals[raw.number];
        let trace = |source, augmentation| Trace { source, source_key: real.key.clone(), augmentation };
        match task {
            Task::Real => {
                let trace = Trace { source_key: String::new(), ..trace(Source::Real, String::new()) };
                let image_stats = ImageStats::from_rgb(image.width() as usize, image.as_raw());
                let (piece, mut entry) = self.of_real(raw, real, "", None, &trace, image_stats)?;
                entry.tile = self.on_page.contains(&raw.number).then(|| tile(image));
                Ok((piece, entry))
            }
            Task::Copy { recipe, copy, slot } => {
                let (made, applied) = photometric[*recipe].apply(image, *seed, raw.number as u64 | slot << 32);
                let done = json(&PhotometricTrace { recipe: *recipe, copy: *copy, applied: &applied });
                let trace = trace(Source::Photometric, text(done));
                self.of_real(
                    raw,
                    real,
                    &format!("-photometric-{recipe}-{copy}"),
                    Some(&made),
                    &trace,
                    image_stats(&made),
                )
            }
            Task::Counterpart => {
                let (Some(renderer), Some(metadata)) = (renderer, &metadata[raw.number]) else {
                    return Err(AugmentError::Sample(format!("{}: nothing is known of it", set.name(real))));
                };
                let Counterpart { sample, metadata, offset_px, correlation, alignment } =
                    renderer.counterpart(metadata, image, raw.number as u64);
                let done = CounterpartTrace {
                    offset_px,
                    correlation,
                    alignment,
                    object: renderer.plan.sampling.objects[metadata.object].id.clone(),
                    depth_mm: metadata.depth_mm,
                    position_mm: metadata.position_mm,
                };
                let trace = trace(Source::Counterpart, text(json(&done)));
                let (piece, mut entry) = self.of_real(
                    raw,
                    real,
                    "-twin",
                    Some(&sample.impression.image),
                    &trace,
                    image_stats(&sample.impression.image),
                )?;
                entry.pair = Some((offset_px, correlation, alignment));
                Ok((piece, entry))
            }
            Task::Synthetic { index } => self.synthetic(real, raw.number, *index),
        }
    }

    /// The real sample, or one with another image and the same label.
    fn of_real(
        &self,
        raw: &Raw,
        real: &Real,
        tag: &str,
        image: Option<&Image>,
        trace: &Trace,
        image_stats: ImageStats,
    ) -> Result<(Piece, SampleEntry), AugmentError> {
        let (set, division) = (&self.recipe.set, &self.recipe.division);
        let split = division.of_reals[raw.number];
        let (form, split_name) = (&set.units[real.unit].form, &division.names[split]);
        let bytes = image.map(|image| png::encode_rgb(image.width, image.height, &image.rgb));
        let mut piece = Piece {
            unit: real.unit,
            split,
            key: String::new(),
            tar_files: Vec::new(),
            files: Vec::new(),
            row: Vec::new(),
        };
        if *form == Form::Tar {
            let label = self.labels.real(form, &raw.label, split_name, None, trace);
            piece.key = format!("{}{tag}", real.image);
            let replaced = |(suffix, there): &(String, Vec<u8>)| {
                let bytes = match &bytes {
                    Some(bytes) if *suffix == set.image => bytes.clone(),
                    _ if *suffix == set.label => label.clone(),
                    _ => there.clone(),
                };
                Member::new(suffix.as_str(), bytes)
            };
            piece.tar_files = raw.files.iter().map(replaced).collect();
            if !raw.files.iter().any(|(suffix, _)| *suffix == set.label) {
                piece.tar_files.push(Member::new(set.label.as_str(), label));
            }
        } else {
            let folder = self.units.folder(real.unit, split);
            let name = renamed(&real.image, tag);
            let other = (!tag.is_empty()).then_some(name.as_str());
            piece.row = self.labels.real(form, &raw.label, split_name, other, trace);
            if tag.is_empty() {
                piece.files = self.named(real, &raw.label, &folder)?;
            }
            piece.files.push((folder.join(&name), bytes.unwrap_or_else(|| raw.image.clone())));
        }
        let facts = &real.facts;
        let entry = SampleEntry {
            source: trace.source,
            split,
            kind: facts.kind().map(str::to_owned),
            depth_mm: facts.depth_mm,
            image_stats,
            number: raw.number,
            tile: image.and_then(|image| self.tile(raw.number, image)),
            pair: None,
        };
        Ok((piece, entry))
    }

    /// A picture of what was made, if the page shows it.
    fn tile(&self, number: usize, image: &Image) -> Option<RgbImage> {
        self.on_page.contains(&number).then_some(())?;
        RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb.clone()).as_ref().map(tile)
    }

    /// Files beside the image that a real sample's row names, where they go, and their contents.
    fn named(&self, real: &Real, row: &str, folder: &Path) -> Result<Vec<(PathBuf, Vec<u8>)>, AugmentError> {
        let set = &self.recipe.set;
        let unit = &set.units[real.unit];
        let values: Vec<String> = match &unit.form {
            Form::Csv(_) => cells(row),
            _ => object(row).into_iter().filter_map(|(_, value)| value.as_str().map(str::to_owned)).collect(),
        };
        let own = |path: &Path| path.components().all(|step| matches!(step, Component::Normal(_)));
        let read = |from: &Path| {
            let path = set.root.join(from);
            read_if_there(&path, MOST_IMAGE_BYTES).map_err(|error| AugmentError::Io(path, error))
        };
        let mut files = Vec::new();
        for value in &values {
            let path = Path::new(value);
            let number = value.parse::<f64>().is_ok();
            if *value == real.image || !value.contains('.') || number || !own(path) || self.units.reserved(path) {
                continue;
            }
            match read(&unit.folder().join(path))? {
                Some(bytes) => files.push((folder.join(path), bytes)),
                None => files.extend(read(path)?.map(|bytes| (path.to_owned(), bytes))),
            }
        }
        Ok(files)
    }
}

/// Some of so many real samples, evenly spread.
fn on_page(reals: usize) -> HashSet<usize> {
    let count = reals.min(MOST_ON_PAGE);
    (0..count).map(|k| (2 * k + 1) * reals / (2 * count)).collect()
}

/// For each real sample the synthetic ones that follow it, as a range of those of its split.
fn dealt(recipe: &Recipe) -> Vec<std::ops::Range<usize>> {
    let division = &recipe.division;
    let reals = division.counts();
    let synthetic = |split: usize| recipe.mix.as_ref().map_or(0, |mix| mix.chosen[split].len() as u64);
    let mut before = vec![0_u64; reals.len()];
    let deal = |&split: &usize| {
        let cut =
            |count: u64| (u128::from(synthetic(split)) * u128::from(count) / u128::from(reals[split].max(1))) as usize;
        let from = cut(before[split]);
        before[split] += 1;
        from..cut(before[split])
    };
    division.of_reals.iter().map(deal).collect()
}

/// The name of an image made of another one. What is made is a PNG.
fn renamed(image: &str, tag: &str) -> String {
    if tag.is_empty() {
        return image.to_owned();
    }
    let path = Path::new(image);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    // gelsim's own images are called KEY.tactile.png; the key ends at the first dot.
    let (key, rest) = stem.split_once('.').map_or((&*stem, String::new()), |(key, rest)| (key, format!(".{rest}")));
    path.with_file_name(format!("{key}{tag}{rest}.png")).to_string_lossy().into_owned()
}

fn image_stats(image: &Image) -> ImageStats {
    ImageStats::from_rgb(image.width, &image.rgb)
}

fn text(json: Vec<u8>) -> String {
    String::from_utf8_lossy(&json).into_owned()
}

/// A name that an output would use twice: of something made, and of a real sample.
pub fn collision(recipe: &Recipe) -> Option<String> {
    let reals = &recipe.set.reals;
    let names: HashSet<(usize, &str)> = reals.iter().map(|real| (real.unit, real.image.as_str())).collect();
    let copies = recipe.photometric.iter().enumerate();
    let copies = copies.flat_map(|(k, made)| (0..made.copies()).map(move |copy| format!("-photometric-{k}-{copy}")));
    let tags: Vec<String> = copies.chain([String::from("-twin")]).collect();
    let tars = recipe.set.in_tars();
    let made = |real: &Real, tag: &str| if tars { format!("{}{tag}", real.image) } else { renamed(&real.image, tag) };
    // Synthetic samples are called by their numbers in the job.
    let synthetic = |real: &&Real| {
        recipe.mix.is_some()
            && Path::new(&real.image).file_name().is_some_and(|n| n.to_string_lossy().starts_with("synthetic-"))
    };
    if let Some(real) = reals.iter().find(synthetic) {
        return Some(real.image.clone());
    }
    let all = reals.iter().flat_map(|real| tags.iter().map(move |tag| (real.unit, made(real, tag))));
    all.into_iter().find(|(unit, name)| names.contains(&(*unit, name.as_str()))).map(|(_, name)| name)
}
