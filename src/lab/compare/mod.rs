//! Distances between simulated and real images: image by image where they show the same presses, and as sets.
//!
//! Folders become sensors with images (`images`), and these become pairs (`pairs`). Pairs are scored (`score`), sets
//! are compared by their colours, edges and grain (`distribution`, `spectrum`), and the result is put into words
//! (`verdict`).

use std::ops::ControlFlow;
use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;
use serde::Serialize;

use gelsim_dataset::archive::SampleFiles;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::image_file;
use gelsim_files::spelling::quote_for_shell;

pub mod counterparts;
pub mod distribution;
pub mod force;
pub mod images;
pub mod pairs;
pub mod picture;
pub mod report;
pub mod score;
pub mod spectrum;
pub mod verdict;

use counterparts::MissingPairs;
use distribution::{Distances, Tally};
use images::{ImageEntry, SensorImages, UnusableImage};
use pairs::{ComparedSet, ComparisonGroup};
use score::{Score, Scores, score_images};
use verdict::{Scenes, describe_distances};

/// Most images of a set without pairs that are read: more do not change its distributions.
const MAX_SET_IMAGES: usize = 1000;

/// Distances between two folders of images.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Radius of what counts as the contact, circle radii.
    pub dilate: f64,
    /// One per sensor; or one of all images, called `all`.
    pub sensors: Vec<SensorRow>,
    /// Over all pairs of all sensors; None if there is none.
    pub total: Option<Means>,
    /// One per pair.
    pub images: Vec<ImageRow>,
    /// Warnings and notes: images without a counterpart, images that were not read.
    pub notes: Vec<String>,
    /// The notes, with what to do about each.
    #[serde(skip)]
    pub diagnostics: Vec<Diagnostic>,
    /// Why no two images belong together, if none do.
    #[serde(skip)]
    pub missing: Option<MissingPairs>,
}

/// One sensor.
#[derive(Clone, Debug, Serialize)]
pub struct SensorRow {
    /// Name of its folder.
    pub sensor: String,
    /// Means over its pairs; None if no two images belong together.
    pub means: Option<Means>,
    /// Distances of its images as sets: of those in pairs, or of all.
    pub distances: Distances,
    /// In which way the simulated set differs, in words. Without pairs the presses differ, too.
    pub verdict: String,
}

/// Means over images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Means {
    /// How many pairs.
    pub images: usize,
    /// Over all pixels.
    #[serde(rename = "whole")]
    pub full_image: Score,
    /// Number of pairs with a contact in view.
    pub contacts: usize,
    /// Over the pixels in the contact.
    pub contact: Option<Score>,
}

/// One pair.
#[derive(Clone, Debug, Serialize)]
pub struct ImageRow {
    /// Name of the sensor's folder.
    pub sensor: String,
    /// The real image's path relative to that folder.
    pub file: String,
    /// Distances of the two images.
    #[serde(flatten)]
    pub scores: Scores,
    /// Real and simulated file.
    #[serde(skip)]
    entries: [ImageEntry; 2],
}

/// Compares the images in two folders. The contact is the annotated circle with its radius times `dilate`. An error
/// reports everything that cannot be read.
pub fn compare_folders(real: &Path, sim: &Path, dilate: f64) -> Result<Comparison, Report> {
    let folders = [real, sim];
    let (real, sim) = match (images::find_images(real), images::find_images(sim)) {
        (Ok(real), Ok(sim)) => (real, sim),
        (real, sim) => {
            return Err([real.err(), sim.err()].into_iter().flatten().fold(Report::default(), Report::merged_with));
        }
    };
    let (groups, mut notes) = pairs::group_images(&real, &sim);
    let is_apart = groups.iter().any(|group| matches!(group, ComparisonGroup::Unpaired { .. }));
    let missing = is_apart.then(|| MissingPairs::from_sides(folders, &real, &sim));
    let (mut sensors, mut images, mut wrong) = (Vec::new(), Vec::new(), Report::default());
    for group in groups {
        let result = match group {
            ComparisonGroup::Paired { real, sim, pairs } => compare_pairs(real, sim, &pairs, dilate, &mut images),
            ComparisonGroup::Unpaired { name, real, sim } => compare_sets(name, &real, &sim, &mut notes),
        };
        match result {
            Ok(sensor) => sensors.push(sensor),
            Err(report) => wrong = wrong.merged_with(report),
        }
    }
    if !wrong.is_empty() {
        return Err(wrong);
    }
    let texts = notes.iter().map(Diagnostic::full_message).collect();
    Ok(Comparison {
        dilate,
        sensors,
        total: Means::from_rows(&images),
        images,
        notes: texts,
        diagnostics: notes,
        missing,
    })
}

impl Means {
    fn from_rows(rows: &[ImageRow]) -> Option<Self> {
        let contacts: Vec<&Score> = rows.iter().filter_map(|row| row.scores.contact.as_ref()).collect();
        Some(Self {
            images: rows.len(),
            full_image: Score::mean(rows.iter().map(|row| &row.scores.full_image))?,
            contacts: contacts.len(),
            contact: Score::mean(contacts.into_iter()),
        })
    }
}

/// Compares image by image. Adds the images' rows to `images`, and returns the row of the sensor.
fn compare_pairs(
    real: &SensorImages,
    sim: &SensorImages,
    pairs: &[(&ImageEntry, &ImageEntry)],
    dilate: f64,
    images: &mut Vec<ImageRow>,
) -> Result<SensorRow, Report> {
    /// Pairs whose tallies are in memory at once.
    const BLOCK: usize = 64;
    let first = images.len();
    let (mut real_tally, mut sim_tally) = (Tally::default(), Tally::default());
    let (mut real_unusable, mut sim_unusable) = (Vec::new(), Vec::new());
    for block in pairs.chunks(BLOCK) {
        let compared: Vec<_> = block.par_iter().map(|(real, sim)| compare_pair(real, sim, dilate)).collect();
        for ((real_entry, sim_entry), compared) in block.iter().zip(compared) {
            match compared {
                Ok((scores, [of_real, of_sim])) => {
                    real_tally.add(&of_real);
                    sim_tally.add(&of_sim);
                    let (sensor, file) = (real.name.clone(), real_entry.name.clone());
                    let entries = [(*real_entry).clone(), (*sim_entry).clone()];
                    images.push(ImageRow { sensor, file, scores, entries });
                }
                Err(unusable) => {
                    let [of_real, of_sim] = *unusable;
                    real_unusable.extend(of_real);
                    sim_unusable.extend(of_sim);
                }
            }
        }
    }
    let wrong = real.report(&real_unusable).merged_with(sim.report(&sim_unusable));
    if !wrong.is_empty() {
        return Err(wrong);
    }
    let distances = Distances::between(&real_tally, &sim_tally);
    let verdict = describe_distances(&distances, Scenes::Same);
    Ok(SensorRow { sensor: real.name.clone(), means: Means::from_rows(&images[first..]), distances, verdict })
}

/// Problems of a pair: of the real image, of the simulated one.
type UnusablePair = Box<[Option<UnusableImage>; 2]>;

/// Scores a pair, and tallies its images.
fn compare_pair(real: &ImageEntry, sim: &ImageEntry, dilate: f64) -> Result<(Scores, [Tally; 2]), UnusablePair> {
    let (real_image, sim_image) = match (images::read_image(real), images::read_image(sim)) {
        (Ok(real), Ok(sim)) => (real, sim),
        (real, sim) => return Err(Box::new([real.err(), sim.err()])),
    };
    if real_image.dimensions() != sim_image.dimensions() {
        let ([w, h], [v, g]) = ([real_image.width(), real_image.height()], [sim_image.width(), sim_image.height()]);
        let (real_path, sim_path) = (real.path.display(), sim.path.display());
        let message = format!("{real_path} is {w}x{h} px, and {sim_path} is {v}x{g} px");
        let problem = Diagnostic::new(message)
            .about(
                real.name.as_str(),
                format!("real images are {w}x{h} px, and their simulated counterparts {v}x{g} px"),
            )
            .help(format!("simulate with `resolution_px = [{w}, {h}]` in the sensor, or resize one of the two sides"));
        return Err(Box::new([Some(UnusableImage::new(real, problem)), None]));
    }
    let scores = score_images(&real_image, &sim_image, real.circle.as_ref(), dilate);
    Ok((scores, [Tally::from_image(&real_image), Tally::from_image(&sim_image)]))
}

/// Compares two sets whose images do not pair.
fn compare_sets(
    name: String,
    real: &ComparedSet,
    sim: &ComparedSet,
    notes: &mut Vec<Diagnostic>,
) -> Result<SensorRow, Report> {
    let (real, sim) = match (tally_side(real, notes), tally_side(sim, notes)) {
        (Ok(real), Ok(sim)) => (real, sim),
        (real, sim) => {
            return Err([real.err(), sim.err()].into_iter().flatten().fold(Report::default(), Report::merged_with));
        }
    };
    let distances = Distances::between(&real, &sim);
    let verdict = describe_distances(&distances, Scenes::Different);
    Ok(SensorRow { sensor: name, means: None, distances, verdict })
}

/// Tallies a set: all its images, or at most [`MAX_SET_IMAGES`] of them, evenly spread.
fn tally_side(side: &ComparedSet, notes: &mut Vec<Diagnostic>) -> Result<Tally, Report> {
    let (tally, looked, all, what) = match side {
        ComparedSet::Files(entries) => {
            let tally = tally_files(entries)?;
            (tally.clone(), tally.images, entries.len() as u64, "images")
        }
        ComparedSet::Dataset(dataset) => {
            let (tally, samples) = tally_dataset(dataset)?;
            (
                tally,
                samples,
                dataset.layout.sample_count(),
                if has_single_images(dataset) { "images" } else { "samples" },
            )
        }
    };
    if looked < all {
        notes.push(Diagnostic::note(format!("looked at {looked} of {all} {what}, evenly spread")));
    }
    Ok(tally)
}

/// Tallies image files, evenly spread if there are too many.
fn tally_files(entries: &[&ImageEntry]) -> Result<Tally, Report> {
    let chosen: Vec<&&ImageEntry> = entries.iter().step_by(entries.len().div_ceil(MAX_SET_IMAGES).max(1)).collect();
    let (mut sum, mut wrong) = (Tally::default(), Diagnostics::default());
    let tallies: Vec<_> =
        chosen.par_iter().map(|entry| images::read_image(entry).map(|image| Tally::from_image(&image))).collect();
    for tally in tallies {
        match tally {
            Ok(tally) => sum.add(&tally),
            Err(unusable) => wrong.extend(unusable.report().problems().iter().cloned()),
        }
    }
    if wrong.is_empty() { Ok(sum) } else { Err(Report::new(&wrong, &[])) }
}

/// Returns true for a dataset whose samples are one image each: neither sequences nor grips.
fn has_single_images(dataset: &RecordedDataset) -> bool {
    dataset.job.sequence.is_none() && dataset.job.gripper.is_none()
}

/// Tallies a dataset, all frames and fingers of each sample. Returns the tally and the number of samples in it.
fn tally_dataset(dataset: &RecordedDataset) -> Result<(Tally, u64), Report> {
    let every = dataset.layout.sample_count().div_ceil(MAX_SET_IMAGES as u64).max(1);
    // In sequences and grips the names of frame and finger come first.
    let is_tactile = |suffix: &str| suffix == "tactile.png" || suffix.ends_with(".tactile.png");
    let shard = |number: u64| -> Result<(Tally, u64), String> {
        let shard = dataset.layout.shard(number);
        let (mut sum, mut samples, mut wrong) = (Tally::default(), 0, None);
        let counts = |key: &str| key.parse::<u64>().is_ok_and(|index| index.is_multiple_of(every));
        let visit = |files: SampleFiles| {
            if !counts(&files.key) {
                return ControlFlow::Continue(());
            }
            samples += 1;
            let images: Vec<&(String, Vec<u8>)> =
                files.members.iter().filter(|(suffix, _)| is_tactile(suffix)).collect();
            if images.is_empty() {
                wrong = Some(format!("{}.tactile.png: is not there", files.key));
            }
            for (suffix, bytes) in images {
                match image_file::decode_rgb(bytes) {
                    Ok(image) => sum.add(&Tally::from_image(&image)),
                    Err(reason) => wrong = Some(format!("{}.{suffix}: {reason}", files.key)),
                }
            }
            if wrong.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let read = dataset.visit_samples(&shard, |head| is_tactile(head.suffix) && counts(head.key), visit);
        let path = || dataset.shard_paths(&shard).data;
        let expected = dataset.layout.sample_indices(shard).filter(|index| index.is_multiple_of(every)).count();
        let all = |wrong: Option<String>| match wrong {
            Some(reason) => Err(reason),
            None if samples < expected as u64 => {
                Err(format!("{samples} samples are in it, and {expected} belong there"))
            }
            None => Ok(()),
        };
        read.and_then(|()| all(wrong)).map_err(|reason| format!("{}: {reason}", path().display()))?;
        Ok((sum, samples))
    };
    let tallies: Vec<_> = (0..dataset.layout.shard_count()).into_par_iter().map(shard).collect();
    let (mut sum, mut samples) = (Tally::default(), 0);
    for tally in tallies {
        match tally {
            Ok((tally, count)) => {
                sum.add(&tally);
                samples += count;
            }
            Err(reason) => {
                let help =
                    format!("`gelsim verify {}` names all that is wrong with it", quote_for_shell(&dataset.root));
                return Err(user_error(reason, help));
            }
        }
    }
    Ok((sum, samples))
}

/// Reads the two images of a scored pair again.
pub fn read_pair(row: &ImageRow) -> Result<[RgbImage; 2], Report> {
    let [real, sim] = &row.entries;
    let read = |entry: &ImageEntry| images::read_image(entry).map_err(|unusable| unusable.report());
    Ok([read(real)?, read(sim)?])
}
