//! What comes of real samples: the sample itself, its copies, its counterpart, and the synthetic samples that follow it.
//!
//! Synthetic samples are dealt out evenly among the real ones of their split, so that no unit is synthetic only. All
//! that is random is addressed by the sample's number: the order of work decides nothing.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use image::RgbImage;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};

use super::counterpart::{Alignment, Counterpart};
use super::image_stats::ImageStats;
use super::input::images::{inside, with_slashes};
use super::input::{Form, Real};
use super::output::labels::{Labels, cells, object};
use super::output::pictures::{encode_as, is_of_format};
use super::output::{ImagePlacement, Piece, Units};
use super::photometric::AppliedAugmentation;
use super::report::{SampleEntry, tile};
use super::trace::{Source, Trace};
use super::{AugmentError, Recipe};
use gelsim_core::camera::Image;
use gelsim_dataset::archive::Member;
use gelsim_dataset::encode::json;
use gelsim_files::input::{MOST_IMAGE_BYTES, read_if_there};
use gelsim_files::{image_file, png};

mod synthetic;

/// Real samples that the page shows.
const MOST_ON_PAGE: usize = 6;
/// Synthetic samples that the page shows.
const MOST_SYNTHETIC_ON_PAGE: usize = 12;

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
    Synthetic { index: u64, on_page: bool },
}

/// An image that was made of a real one.
struct Made<'a> {
    /// What is put behind the real one's key.
    tag: String,
    /// Its number among all that is made of the real one.
    slot: u64,
    image: &'a Image,
    /// True if it has the real one's pixels.
    unchanged: bool,
}

/// What was done for a photometric copy.
#[derive(Serialize)]
struct PhotometricTrace<'a> {
    recipe: usize,
    copy: u32,
    #[serde(flatten)]
    applied: &'a AppliedAugmentation,
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
    /// Synthetic samples that the page shows, by their numbers in the order of splits.
    synthetic_on_page: HashSet<usize>,
    /// Names of columns and ends of names that a synthetic sample's layers may fill.
    columns: HashSet<String>,
}

impl<'a> Maker<'a> {
    /// Makes what a recipe wants.
    pub fn new(recipe: &'a Recipe, labels: &'a Labels<'a>, units: &'a Units<'a>) -> Self {
        let set = &recipe.set;
        let columns = set.example.keys().cloned().chain(set.suffixes.iter().cloned()).collect();
        let mut maker = Self {
            recipe,
            labels,
            units,
            after: dealt(recipe),
            on_page: HashSet::new(),
            synthetic_on_page: HashSet::new(),
            columns,
        };
        // Real samples of which something is made, if there are any.
        let is_made_of = |number: &usize| {
            let mut tasks = maker.tasks(*number);
            tasks.any(|task| matches!(task, Task::Copy { .. } | Task::Counterpart))
        };
        let all: Vec<usize> = (0..set.reals.len()).collect();
        let made_of: Vec<usize> = all.iter().copied().filter(is_made_of).collect();
        let shown = if made_of.is_empty() { all } else { made_of };
        maker.on_page = spread(shown.len(), MOST_ON_PAGE).map(|at| shown[at]).collect();
        let synthetic = recipe.mix.as_ref().map_or(0, |mix| mix.chosen.iter().map(Vec::len).sum());
        maker.synthetic_on_page = spread(synthetic, MOST_SYNTHETIC_ON_PAGE).collect();
        maker
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
            image_file::decode_rgb(&raw.image).map_err(|reason| AugmentError::Image(format!("{}: {reason}", name())))
        };
        let images: Vec<RgbImage> = raws.par_iter().map(decode).collect::<Result<_, _>>()?;
        let tasks: Vec<(usize, Task)> =
            raws.iter().enumerate().flat_map(|(k, raw)| self.tasks(raw.number).map(move |task| (k, task))).collect();
        let made = tasks.par_iter().map(|(k, task)| {
            if tick() { Err(AugmentError::Interrupted) } else { self.make_one(&raws[*k], &images[*k], task) }
        });
        made.collect()
    }

    fn tasks(&self, number: usize) -> impl Iterator<Item = Task> {
        let mut tasks = vec![Task::Real];
        let split = self.recipe.division.of_reals[number];
        let mut slot = 0;
        for (recipe, made) in self.recipe.photometric.iter().enumerate() {
            for copy in 0..made.copies() {
                if self.recipe.recipients.photometric[recipe][split] {
                    tasks.push(Task::Copy { recipe, copy, slot });
                }
                slot += 1;
            }
        }
        tasks
            .extend(self.recipe.metadata[number].map(|_| Task::Counterpart).filter(|_| self.recipe.renderer.is_some()));
        if let Some(mix) = &self.recipe.mix {
            let before: usize = mix.chosen[..split].iter().map(Vec::len).sum();
            tasks.extend(self.after[number].clone().map(|at| Task::Synthetic {
                index: mix.chosen[split][at],
                on_page: self.synthetic_on_page.contains(&(before + at)),
            }));
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
                let (piece, mut entry) = self.of_real(raw, real, None, &trace, image_stats)?;
                entry.tile = self.on_page.contains(&raw.number).then(|| (tile(image), self.caption(real, raw.number)));
                Ok((piece, entry))
            }
            Task::Copy { recipe, copy, slot } => {
                let (pixels, applied) = photometric[*recipe].apply(image, *seed, raw.number as u64 | slot << 32);
                let done = json(&PhotometricTrace { recipe: *recipe, copy: *copy, applied: &applied });
                let trace = trace(Source::Photometric, text(done));
                let made = Made {
                    tag: format!("-photometric-{recipe}-{copy}"),
                    slot: *slot,
                    image: &pixels,
                    unchanged: pixels.rgb == *image.as_raw(),
                };
                self.of_real(raw, real, Some(&made), &trace, image_stats(&pixels))
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
                let pixels = &sample.impression.image;
                let slot = photometric.iter().map(|recipe| u64::from(recipe.copies())).sum();
                let made = Made { tag: String::from("-twin"), slot, image: pixels, unchanged: false };
                let (piece, mut entry) = self.of_real(raw, real, Some(&made), &trace, image_stats(pixels))?;
                entry.pair = Some((offset_px, correlation, alignment));
                Ok((piece, entry))
            }
            Task::Synthetic { index, on_page } => self.synthetic(real, raw.number, *index, *on_page),
        }
    }

    /// The real sample, or one with another image and the same label.
    fn of_real(
        &self,
        raw: &Raw,
        real: &Real,
        made: Option<&Made<'_>>,
        trace: &Trace,
        image_stats: ImageStats,
    ) -> Result<(Piece, SampleEntry), AugmentError> {
        let (set, division) = (&self.recipe.set, &self.recipe.division);
        let split = division.of_reals[raw.number];
        let (form, split_name) = (&set.units[real.unit].form, &division.names[split]);
        let tag = made.map_or("", |made| &made.tag);
        let mut piece = Piece { unit: real.unit, split, ..Piece::default() };
        if *form == Form::Tar {
            let bytes = made.map(|made| self.encoded(raw, real, made)).transpose()?;
            let label = self.labels.real(form, &raw.label, split_name, &[], trace);
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
            let ImagePlacement { file, name } = self.units.image(real, split, tag);
            let own = self.units.image(real, split, "").name;
            let as_written = if real.has_backslashes { real.image.replace('/', "\\") } else { real.image.clone() };
            let mut changes = Vec::new();
            if name != as_written {
                changes.push((set.image.as_str(), Value::from(name)));
            }
            if *form == Form::Coco {
                let (id, annotations) = self.annotations(raw, real, made);
                changes.extend(id.map(|id| ("id", id)));
                piece.annotations = annotations.iter().map(json).collect();
            }
            let key = if set.in_class_folders() && made.is_some() { own } else { trace.source_key.clone() };
            let trace = Trace { source_key: key, ..trace.clone() };
            piece.row = self.labels.real(form, &raw.label, split_name, &changes, &trace);
            match made {
                None => {
                    piece.files = self.named(real, &raw.label, split)?;
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
            kind: facts.kind().map(str::to_owned),
            depth_mm: facts.depth_mm,
            image_stats,
            number: raw.number,
            tile: made.filter(|_| self.on_page.contains(&raw.number)).map(|made| (small(made.image), String::new())),
            pair: None,
        };
        Ok((piece, entry))
    }

    /// What stands below a real image on the page.
    fn caption(&self, real: &Real, number: usize) -> String {
        let division = &self.recipe.division;
        let split = &division.names[division.of_reals[number]];
        let file = real.key.rsplit(['/', '\\']).next().unwrap_or(&real.key);
        if split.is_empty() { file.to_owned() } else { format!("{file}\n{split}") }
    }

    /// The id and the annotations of an entry among COCO's images; no id of the real one, which keeps its own.
    fn annotations(&self, raw: &Raw, real: &Real, made: Option<&Made<'_>>) -> (Option<Value>, Vec<Map<String, Value>>) {
        let set = &self.recipe.set;
        let (annotations, number) = (&set.annotations[real.unit], raw.number - set.units[real.unit].reals.start);
        match made {
            None => (None, annotations.of_real(number).to_vec()),
            Some(made) => {
                let id = object(&raw.label).get("id").cloned().unwrap_or_default();
                let (id, annotations) = annotations.of_made(number, &id, made.slot, &made.tag);
                (Some(id), annotations)
            }
        }
    }

    /// The image as a file of the format that the tar's names say; the real one's bytes where no pixel was changed.
    fn encoded(&self, raw: &Raw, real: &Real, made: &Made<'_>) -> Result<Vec<u8>, AugmentError> {
        let set = &self.recipe.set;
        let failed = |reason: String| AugmentError::Sample(format!("{}: {reason}", set.name(real)));
        let is_as_named = is_of_format(&raw.image, &set.image);
        if is_as_named && made.unchanged {
            return Ok(raw.image.clone());
        }
        encode_as(&set.image, made.image).map_err(failed)
    }

    /// Files beside the image that a real sample's label names, where they go, and their contents.
    fn named(&self, real: &Real, row: &str, split: usize) -> Result<Vec<(PathBuf, Vec<u8>)>, AugmentError> {
        let set = &self.recipe.set;
        let unit = &set.units[real.unit];
        let values: Vec<String> = match &unit.form {
            Form::Csv(_) => cells(row),
            _ => object(row).into_iter().filter_map(|(_, value)| value.as_str().map(str::to_owned)).collect(),
        };
        let read = |from: &Path| {
            let path = set.root.join(from);
            read_if_there(&path, MOST_IMAGE_BYTES).map_err(|error| AugmentError::Io(path, error))
        };
        let folder = self.units.folder(real.unit, split);
        let mut files = Vec::new();
        for value in values.iter().filter(|value| value.contains('.') && value.parse::<f64>().is_err()) {
            // From the images' folder, from the table's, or from the set's.
            let bases =
                [(unit.images.as_path(), folder.as_path()), (unit.folder(), &folder), (Path::new(""), Path::new(""))];
            for (base, to) in bases {
                let name = with_slashes(&set.root.join(base), value);
                let (Some(from), Some(to)) = (inside(base, &name), inside(to, &name)) else { continue };
                if from == real.path || self.units.reserved(&from) {
                    break;
                }
                if let Some(bytes) = read(&from)? {
                    let to = if self.recipe.division.apart { to } else { from };
                    files.push((to, bytes));
                    break;
                }
            }
        }
        Ok(files)
    }
}

/// Some of so many, at most `most`, evenly spread.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let shown = count.min(most);
    (0..shown).map(move |k| (2 * k + 1) * count / (2 * shown))
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

/// A picture as the page shows it.
fn small(image: &Image) -> RgbImage {
    let picture = RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb.clone());
    picture.as_ref().map_or_else(RgbImage::default, tile)
}

fn image_stats(image: &Image) -> ImageStats {
    ImageStats::from_rgb(image.width, &image.rgb)
}

fn text(json: Vec<u8>) -> String {
    String::from_utf8_lossy(&json).into_owned()
}

/// A name that an output would use twice: of something made, and of a real sample or something else that is made.
pub fn collision(recipe: &Recipe) -> Option<String> {
    let (set, division) = (&recipe.set, &recipe.division);
    let reals = &set.reals;
    // Synthetic samples are called by their numbers in the job.
    let synthetic = |real: &&Real| {
        recipe.mix.is_some()
            && Path::new(&real.image).file_name().is_some_and(|n| n.to_string_lossy().starts_with("synthetic-"))
    };
    if let Some(real) = reals.iter().find(synthetic) {
        return Some(real.image.clone());
    }
    let units = Units::new(set, division);
    let name = |(number, real): (usize, &Real), tag: &str| {
        if set.in_tars() {
            set.units[real.unit].file.join(format!("{}{tag}", real.image))
        } else {
            units.image(real, division.of_reals[number], tag).file
        }
    };
    let copies = recipe.photometric.iter().enumerate();
    let copies = copies.flat_map(|(k, made)| (0..made.copies()).map(move |copy| format!("-photometric-{k}-{copy}")));
    let tags: Vec<String> = copies.chain([String::from("-twin")]).collect();
    let mut names: HashSet<PathBuf> = HashSet::new();
    let mut copies = HashSet::new();
    for (number, real) in reals.iter().enumerate() {
        let own = name((number, real), "");
        // One tag tells of all: images of one name and several formats have copies of one name.
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
