//! Makes the samples that derive from a real one: the sample itself, its copies, its counterpart, and the synthetic
//! samples that follow it.
//!
//! Synthetic samples are distributed evenly among the real ones of their split, so that no unit is synthetic only.
//! Everything random depends on the sample's number alone, so the order of work does not matter.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use image::RgbImage;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};

use super::counterpart::{Alignment, Counterpart};
use super::input::images::{path_inside, with_slashes};
use super::input::{LabelFormat, RealSample};
use super::output::labels::{LabelWriter, parse_csv_record, parse_object};
use super::output::{ImagePlacement, OutputLayout, OutputSample};
use super::photometric::AppliedAugmentation;
use super::report::SampleEntry;
use super::trace::{Source, Trace};
use super::{AugmentError, Recipe};
use gelsim_core::camera::Image;
use gelsim_dataset::archive::Member;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::input::{MAX_IMAGE_BYTES, read_if_exists};
use gelsim_files::{image_file, png};
use gelsim_lab::metrics::image_stats::ImageStats;
use gelsim_lab::page::make_thumbnail;

mod synthetic;

/// Most real samples on the page.
const MAX_ON_PAGE: usize = 6;
/// Most synthetic samples on the page.
const MAX_SYNTHETIC_ON_PAGE: usize = 12;

/// Files of a real sample.
pub struct RawSample {
    /// Number of the sample in the set.
    pub number: usize,
    /// Bytes of the image.
    pub image: Vec<u8>,
    /// Text of the label.
    pub label: String,
    /// All files in a tar, by their suffixes.
    pub files: Vec<(String, Vec<u8>)>,
}

/// A sample to be made.
enum SampleTask {
    Real,
    Copy { recipe: usize, copy: u32, slot: u64 },
    Counterpart,
    Synthetic { index: u64, on_page: bool },
}

/// An image derived from a real one.
struct DerivedImage<'a> {
    /// Text that is appended to the real one's key.
    tag: String,
    /// Number among all images derived from the real one.
    slot: u64,
    image: &'a Image,
    /// Whether it has the real one's pixels.
    unchanged: bool,
}

/// What was applied for a photometric copy, for the label.
#[derive(Serialize)]
struct PhotometricTrace<'a> {
    recipe: usize,
    copy: u32,
    #[serde(flatten)]
    applied: &'a AppliedAugmentation,
}

/// What was applied for a counterpart, for the label.
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
pub struct SampleMaker<'a> {
    recipe: &'a Recipe,
    labels: &'a LabelWriter<'a>,
    units: &'a OutputLayout<'a>,
    /// For each real sample the synthetic samples that follow it, as a range of those of its split.
    synthetic_after: Vec<std::ops::Range<usize>>,
    /// Real samples on the page.
    on_page: HashSet<usize>,
    /// Synthetic samples on the page, by their numbers in the order of splits.
    synthetic_on_page: HashSet<usize>,
    /// Names of columns and suffixes that layers of a synthetic sample may fill.
    columns: HashSet<String>,
}

impl<'a> SampleMaker<'a> {
    /// Prepares the samples of a recipe.
    pub fn new(recipe: &'a Recipe, labels: &'a LabelWriter<'a>, units: &'a OutputLayout<'a>) -> Self {
        let set = &recipe.set;
        let columns = set.example.keys().cloned().chain(set.suffixes.iter().cloned()).collect();
        let mut maker = Self {
            recipe,
            labels,
            units,
            synthetic_after: deal_synthetic(recipe),
            on_page: HashSet::new(),
            synthetic_on_page: HashSet::new(),
            columns,
        };
        // The page prefers real samples from which something is derived.
        let is_made_of = |number: &usize| {
            let mut tasks = maker.list_tasks(*number);
            tasks.any(|task| matches!(task, SampleTask::Copy { .. } | SampleTask::Counterpart))
        };
        let all: Vec<usize> = (0..set.reals.len()).collect();
        let made_of: Vec<usize> = all.iter().copied().filter(is_made_of).collect();
        let shown = if made_of.is_empty() { all } else { made_of };
        maker.on_page = spread_evenly(shown.len(), MAX_ON_PAGE).map(|at| shown[at]).collect();
        let synthetic = recipe.mix.as_ref().map_or(0, |mix| mix.chosen.iter().map(Vec::len).sum());
        maker.synthetic_on_page = spread_evenly(synthetic, MAX_SYNTHETIC_ON_PAGE).collect();
        maker
    }

    /// Makes everything that derives from some real samples, in order. Calls `tick` before each sample; it returns
    /// whether to stop.
    pub fn make_samples(
        &self,
        raws: &[RawSample],
        tick: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<(OutputSample, SampleEntry)>, AugmentError> {
        let decode = |raw: &RawSample| {
            let name = || self.recipe.set.sample_name(&self.recipe.set.reals[raw.number]);
            image_file::decode_rgb(&raw.image).map_err(|reason| AugmentError::Image(format!("{}: {reason}", name())))
        };
        let images: Vec<RgbImage> = raws.par_iter().map(decode).collect::<Result<_, _>>()?;
        let tasks: Vec<(usize, SampleTask)> = raws
            .iter()
            .enumerate()
            .flat_map(|(k, raw)| self.list_tasks(raw.number).map(move |task| (k, task)))
            .collect();
        let made = tasks.par_iter().map(|(k, task)| {
            if tick() { Err(AugmentError::Interrupted) } else { self.make_sample(&raws[*k], &images[*k], task) }
        });
        let made = made.collect();
        let plans = self.recipe.mix.iter().map(|mix| &mix.plan).chain(self.recipe.renderer.iter().map(|of| &of.plan));
        match plans.filter_map(|plan| plan.find_mesh_failure()).next() {
            Some((path, error)) => Err(AugmentError::Io(path, error)),
            None => made,
        }
    }

    /// Lists the samples that derive from a real one, in order.
    fn list_tasks(&self, number: usize) -> impl Iterator<Item = SampleTask> {
        let mut tasks = vec![SampleTask::Real];
        let split = self.recipe.division.split_of_real[number];
        let mut slot = 0;
        for (recipe, made) in self.recipe.photometric.iter().enumerate() {
            // A copy keeps its slot even if another copy is not made in this split: its noise does not depend on that.
            for copy in 0..made.copies_per_image() {
                if self.recipe.recipients.photometric[recipe][split] {
                    tasks.push(SampleTask::Copy { recipe, copy, slot });
                }
                slot += 1;
            }
        }
        tasks.extend(
            self.recipe.metadata[number].map(|_| SampleTask::Counterpart).filter(|_| self.recipe.renderer.is_some()),
        );
        if let Some(mix) = &self.recipe.mix {
            let before: usize = mix.chosen[..split].iter().map(Vec::len).sum();
            tasks.extend(self.synthetic_after[number].clone().map(|at| SampleTask::Synthetic {
                index: mix.chosen[split][at],
                on_page: self.synthetic_on_page.contains(&(before + at)),
            }));
        }
        tasks.into_iter()
    }

    /// Makes one sample.
    fn make_sample(
        &self,
        raw: &RawSample,
        image: &RgbImage,
        task: &SampleTask,
    ) -> Result<(OutputSample, SampleEntry), AugmentError> {
        let Recipe { seed, set, photometric, renderer, metadata, .. } = self.recipe;
        let real = &set.reals[raw.number];
        let trace = |source, augmentation| Trace { source, source_key: real.key.clone(), augmentation };
        match task {
            SampleTask::Real => {
                let trace = Trace { source_key: String::new(), ..trace(Source::Real, String::new()) };
                let image_stats = ImageStats::from_rgb(image.width() as usize, image.as_raw());
                let (piece, mut entry) = self.make_real_sample(raw, real, None, &trace, image_stats)?;
                entry.tile = self
                    .on_page
                    .contains(&raw.number)
                    .then(|| (make_thumbnail(image), self.page_caption(real, raw.number)));
                Ok((piece, entry))
            }
            SampleTask::Copy { recipe, copy, slot } => {
                let (pixels, applied) = photometric[*recipe].apply(image, *seed, raw.number as u64 | slot << 32);
                let done = to_json_line(&PhotometricTrace { recipe: *recipe, copy: *copy, applied: &applied });
                let trace = trace(Source::Photometric, json_to_text(done));
                let made = DerivedImage {
                    tag: format!("-photometric-{recipe}-{copy}"),
                    slot: *slot,
                    image: &pixels,
                    unchanged: pixels.rgb == *image.as_raw(),
                };
                self.make_real_sample(raw, real, Some(&made), &trace, stats_of_image(&pixels))
            }
            SampleTask::Counterpart => {
                let (Some(renderer), Some(metadata)) = (renderer, &metadata[raw.number]) else {
                    return Err(AugmentError::Sample(format!("{}: nothing is known of it", set.sample_name(real))));
                };
                let Counterpart { sample, metadata, offset_px, correlation, alignment } =
                    renderer.render_counterpart(metadata, image, raw.number as u64);
                let done = CounterpartTrace {
                    offset_px,
                    correlation,
                    alignment,
                    object: renderer.plan.sampling.objects[metadata.object].id.clone(),
                    depth_mm: metadata.depth_mm,
                    position_mm: metadata.position_mm,
                };
                let trace = trace(Source::Counterpart, json_to_text(to_json_line(&done)));
                let pixels = &sample.impression.image;
                let slot = photometric.iter().map(|recipe| u64::from(recipe.copies_per_image())).sum();
                let made = DerivedImage { tag: String::from("-twin"), slot, image: pixels, unchanged: false };
                let (piece, mut entry) =
                    self.make_real_sample(raw, real, Some(&made), &trace, stats_of_image(pixels))?;
                entry.pair = Some((offset_px, correlation, alignment));
                Ok((piece, entry))
            }
            SampleTask::Synthetic { index, on_page } => self.make_synthetic_sample(real, raw.number, *index, *on_page),
        }
    }

    /// Writes the real sample, or one with a derived image and the real one's label.
    fn make_real_sample(
        &self,
        raw: &RawSample,
        real: &RealSample,
        made: Option<&DerivedImage<'_>>,
        trace: &Trace,
        image_stats: ImageStats,
    ) -> Result<(OutputSample, SampleEntry), AugmentError> {
        let (set, division) = (&self.recipe.set, &self.recipe.division);
        let split = division.split_of_real[raw.number];
        let (form, split_name) = (&set.units[real.unit].form, &division.names[split]);
        let tag = made.map_or("", |made| &made.tag);
        let mut piece = OutputSample { unit: real.unit, split, ..OutputSample::default() };
        if *form == LabelFormat::Tar {
            let bytes = made.map(|made| self.encode_for_tar(raw, real, made)).transpose()?;
            let label = self.labels.encode_real_label(form, &raw.label, split_name, &[], trace);
            piece.key = format!("{}{tag}", real.image);
            let replaced = |(suffix, original): &(String, Vec<u8>)| {
                let bytes = match &bytes {
                    Some(bytes) if *suffix == set.image_column => bytes.clone(),
                    _ if *suffix == set.label_suffix => label.clone(),
                    _ => original.clone(),
                };
                Member::new(suffix.as_str(), bytes)
            };
            piece.tar_files = raw.files.iter().map(replaced).collect();
            if !raw.files.iter().any(|(suffix, _)| *suffix == set.label_suffix) {
                piece.tar_files.push(Member::new(set.label_suffix.as_str(), label));
            }
        } else {
            let ImagePlacement { file, name } = self.units.place_image(real, split, tag);
            let own = self.units.place_image(real, split, "").name;
            let as_written = if real.has_backslashes { real.image.replace('/', "\\") } else { real.image.clone() };
            let mut changes = Vec::new();
            if name != as_written {
                changes.push((set.image_column.as_str(), Value::from(name)));
            }
            if *form == LabelFormat::Coco {
                let (id, annotations) = self.coco_entry(raw, real, made);
                changes.extend(id.map(|id| ("id", id)));
                piece.annotations = annotations.iter().map(to_json_line).collect();
            }
            let key = if set.in_class_folders() { own } else { real.key.clone() };
            let mut trace = trace.clone();
            if made.is_some() {
                trace.source_key = key;
            } else {
                trace.fill_for_csv(form, &key);
            }
            piece.row = self.labels.encode_real_label(form, &raw.label, split_name, &changes, &trace);
            match made {
                None => {
                    piece.files = self.read_named_files(real, &raw.label, split)?;
                    piece.files.push((file, raw.image.clone()));
                }
                Some(made) => {
                    piece.files.push((file, png::encode_rgb(made.image.width, made.image.height, &made.image.rgb)));
                }
            }
        }
        let facts = &real.facts;
        let entry = SampleEntry {
            source: trace.source,
            split,
            kind: facts.class_or_object().map(str::to_owned),
            depth_mm: facts.depth_mm,
            image_stats,
            number: raw.number,
            tile: made
                .filter(|_| self.on_page.contains(&raw.number))
                .map(|made| (to_thumbnail(made.image), String::new())),
            pair: None,
        };
        Ok((piece, entry))
    }

    /// Returns the caption of a real image on the page.
    fn page_caption(&self, real: &RealSample, number: usize) -> String {
        let division = &self.recipe.division;
        let split = &division.names[division.split_of_real[number]];
        let file = real.key.rsplit(['/', '\\']).next().unwrap_or(&real.key);
        if split.is_empty() { file.to_owned() } else { format!("{file}\n{split}") }
    }

    /// Returns the id and annotations of an image in COCO's lists; no id for the real one, which keeps its own.
    fn coco_entry(
        &self,
        raw: &RawSample,
        real: &RealSample,
        made: Option<&DerivedImage<'_>>,
    ) -> (Option<Value>, Vec<Map<String, Value>>) {
        let set = &self.recipe.set;
        let (annotations, number) = (&set.annotations[real.unit], raw.number - set.units[real.unit].reals.start);
        match made {
            None => (None, annotations.of_real(number).to_vec()),
            Some(made) => {
                let id = parse_object(&raw.label).get("id").cloned().unwrap_or_default();
                let (id, annotations) = annotations.of_derived(number, &id, made.slot, &made.tag);
                (Some(id), annotations)
            }
        }
    }

    /// Encodes the image in the format that the tar's names say. Returns the real one's bytes if no pixel changed.
    fn encode_for_tar(
        &self,
        raw: &RawSample,
        real: &RealSample,
        made: &DerivedImage<'_>,
    ) -> Result<Vec<u8>, AugmentError> {
        let set = &self.recipe.set;
        let failed = |reason: String| AugmentError::Sample(format!("{}: {reason}", set.sample_name(real)));
        let is_as_named = image_file::is_of_format(&raw.image, &set.image_column);
        if is_as_named && made.unchanged {
            return Ok(raw.image.clone());
        }
        image_file::encode_as(&set.image_column, made.image).map_err(failed)
    }

    /// Reads the files that a real sample's label names besides the image. Returns where they go, and their contents.
    fn read_named_files(
        &self,
        real: &RealSample,
        row: &str,
        split: usize,
    ) -> Result<Vec<(PathBuf, Vec<u8>)>, AugmentError> {
        let set = &self.recipe.set;
        let unit = &set.units[real.unit];
        let values: Vec<String> = match &unit.form {
            LabelFormat::Csv(_) => parse_csv_record(row),
            _ => parse_object(row).into_iter().filter_map(|(_, value)| value.as_str().map(str::to_owned)).collect(),
        };
        let read = |from: &Path| {
            let path = set.root.join(from);
            read_if_exists(&path, MAX_IMAGE_BYTES).map_err(|error| AugmentError::Io(path, error))
        };
        let folder = self.units.image_folder(real.unit, split);
        let mut files = Vec::new();
        for value in values.iter().filter(|value| value.contains('.') && value.parse::<f64>().is_err()) {
            // A name may be relative to the images' folder, to the table's, or to the set's.
            let bases =
                [(unit.images.as_path(), folder.as_path()), (unit.folder(), &folder), (Path::new(""), Path::new(""))];
            for (base, to) in bases {
                let name = with_slashes(&set.root.join(base), value);
                let (Some(from), Some(to)) = (path_inside(base, &name), path_inside(to, &name)) else { continue };
                if from == real.path || self.units.is_reserved(&from) {
                    break;
                }
                if let Some(bytes) = read(&from)? {
                    let to = if self.recipe.division.has_own_files { to } else { from };
                    files.push((to, bytes));
                    break;
                }
            }
        }
        Ok(files)
    }
}

/// Returns at most `most` numbers below `count`, evenly spread.
fn spread_evenly(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let shown = count.min(most);
    (0..shown).map(move |k| (2 * k + 1) * count / (2 * shown))
}

/// Distributes the synthetic samples: for each real sample a range of those of its split.
fn deal_synthetic(recipe: &Recipe) -> Vec<std::ops::Range<usize>> {
    let division = &recipe.division;
    let reals = division.real_counts();
    let synthetic = |split: usize| recipe.mix.as_ref().map_or(0, |mix| mix.chosen[split].len() as u64);
    let mut before = vec![0_u64; reals.len()];
    let deal = |&split: &usize| {
        let cut =
            |count: u64| (u128::from(synthetic(split)) * u128::from(count) / u128::from(reals[split].max(1))) as usize;
        let from = cut(before[split]);
        before[split] += 1;
        from..cut(before[split])
    };
    division.split_of_real.iter().map(deal).collect()
}

/// Returns a picture as the page shows it.
fn to_thumbnail(image: &Image) -> RgbImage {
    let picture = RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb.clone());
    picture.as_ref().map_or_else(RgbImage::default, make_thumbnail)
}

fn stats_of_image(image: &Image) -> ImageStats {
    ImageStats::from_rgb(image.width, &image.rgb)
}

fn json_to_text(json: Vec<u8>) -> String {
    String::from_utf8_lossy(&json).into_owned()
}

/// Finds a name that an output would use twice: that of a derived or synthetic sample, and of another sample.
pub fn find_name_collision(recipe: &Recipe) -> Option<String> {
    let (set, division) = (&recipe.set, &recipe.division);
    let reals = &set.reals;
    // Synthetic samples are named by their numbers in the job.
    let synthetic = |real: &&RealSample| {
        recipe.mix.is_some()
            && Path::new(&real.image).file_name().is_some_and(|n| n.to_string_lossy().starts_with("synthetic-"))
    };
    if let Some(real) = reals.iter().find(synthetic) {
        return Some(real.image.clone());
    }
    let units = OutputLayout::new(set, division);
    let name = |(number, real): (usize, &RealSample), tag: &str| {
        if set.in_tars() {
            set.units[real.unit].file.join(format!("{}{tag}", real.image))
        } else {
            units.place_image(real, division.split_of_real[number], tag).file
        }
    };
    let copies = recipe.photometric.iter().enumerate();
    let copies =
        copies.flat_map(|(k, made)| (0..made.copies_per_image()).map(move |copy| format!("-photometric-{k}-{copy}")));
    let tags: Vec<String> = copies.chain([String::from("-twin")]).collect();
    let mut names: HashSet<PathBuf> = HashSet::new();
    let mut copies = HashSet::new();
    for (number, real) in reals.iter().enumerate() {
        let own = name((number, real), "");
        // One tag stands for all: images with one name but different formats would have copies with one name.
        if !copies.insert(name((number, real), &tags[0])) || names.contains(&own) {
            return Some(own.display().to_string());
        }
        names.insert(own);
    }
    let mut all = reals.iter().enumerate().flat_map(|real| tags.iter().map(move |tag| (real, tag)));
    all.find_map(|(real, tag)| {
        let made = name(real, tag);
        names.contains(&made).then(|| made.display().to_string())
    })
}
