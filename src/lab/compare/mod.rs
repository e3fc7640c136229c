//! How far simulated images are from real ones: image by image where they are of the same presses, and as sets.
//!
//! Folders become sensors with images (`images`), these become pairs (`pairs`); pairs are scored (`score`), sets are
//! compared by what they look like as a whole (`distribution`, `spectrum`), and that is put in words (`verdict`).

use std::ops::ControlFlow;
use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;
use serde::Serialize;

use gelsim_dataset::archive::Files;
use gelsim_dataset::recorded::Recorded;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::image_file;

pub mod counterparts;
pub mod distribution;
pub mod images;
pub mod pairs;
pub mod picture;
pub mod report;
pub mod score;
pub mod spectrum;
pub mod verdict;

use counterparts::MissingPairs;
use distribution::{Distances, Tally};
use images::{Entry, SensorImages, Unusable};
use pairs::{Group, Side};
use score::{Score, Scores, score};
use verdict::{Scenes, verdict};

/// Images of a set that is not paired: more do not change what it looks like.
const MOST_OF_A_SET: usize = 1000;

/// All that is known of the distance between two folders of images.
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
    /// What has no counterpart, or was not looked at.
    pub notes: Vec<String>,
    /// The same with ways out.
    #[serde(skip)]
    pub diagnostics: Vec<Diagnostic>,
    /// Why no two images belong together, where none do.
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
    /// Its images as sets: those of its pairs, or all.
    pub distances: Distances,
    /// Which way the simulated set is off, in words; without pairs only how it differs, since the presses do, too.
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
    /// How many of them have a contact in view.
    pub contacts: usize,
    /// Over the pixels in the contact.
    pub contact: Option<Score>,
}

/// One pair.
#[derive(Clone, Debug, Serialize)]
pub struct ImageRow {
    /// Name of the sensor's folder.
    pub sensor: String,
    /// The real image's path relative to that.
    pub file: String,
    /// Its distances.
    #[serde(flatten)]
    pub scores: Scores,
    /// The two files.
    #[serde(skip)]
    entries: [Entry; 2],
}

/// Compares the images in two folders; the contact is the annotated circle with its radius times `dilate`.
pub fn compare(real: &Path, sim: &Path, dilate: f64) -> Result<Comparison, Report> {
    let folders = [real, sim];
    let (real, sim) = match (images::find(real), images::find(sim)) {
        (Ok(real), Ok(sim)) => (real, sim),
        (real, sim) => {
            return Err([real.err(), sim.err()].into_iter().flatten().fold(Report::default(), Report::and));
        }
    };
    let (groups, mut notes) = pairs::pair(&real, &sim);
    let is_apart = groups.iter().any(|group| matches!(group, Group::Apart { .. }));
    let missing = is_apart.then(|| MissingPairs::between(folders, &real, &sim));
    let (mut sensors, mut images, mut wrong) = (Vec::new(), Vec::new(), Report::default());
    for group in groups {
        let result = match group {
            Group::Paired { real, sim, pairs } => paired(real, sim, &pairs, dilate, &mut images),
            Group::Apart { name, real, sim } => apart(name, &real, &sim, &mut notes),
        };
        match result {
            Ok(sensor) => sensors.push(sensor),
            Err(report) => wrong = wrong.and(report),
        }
    }
    if !wrong.is_empty() {
        return Err(wrong);
    }
    let texts = notes.iter().map(Diagnostic::text).collect();
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

/// Compares image by image, and adds the images' rows to `images`.
fn paired(
    real: &SensorImages,
    sim: &SensorImages,
    pairs: &[(&Entry, &Entry)],
    dilate: f64,
    images: &mut Vec<ImageRow>,
) -> Result<SensorRow, Report> {
    /// Pairs whose tallies are in memory at once.
    const BLOCK: usize = 64;
    let first = images.len();
    let (mut real_tally, mut sim_tally) = (Tally::default(), Tally::default());
    let (mut real_unusable, mut sim_unusable) = (Vec::new(), Vec::new());
    for block in pairs.chunks(BLOCK) {
        let compared: Vec<_> = block.par_iter().map(|(real, sim)| compared(real, sim, dilate)).collect();
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
    let wrong = real.report(&real_unusable).and(sim.report(&sim_unusable));
    if !wrong.is_empty() {
        return Err(wrong);
    }
    let distances = Distances::between(&real_tally, &sim_tally);
    let verdict = verdict(&distances, Scenes::Same);
    Ok(SensorRow { sensor: real.name.clone(), means: Means::from_rows(&images[first..]), distances, verdict })
}

/// What is wrong with either of two images.
type UnusablePair = Box<[Option<Unusable>; 2]>;

/// Scores and tallies of two images.
fn compared(real: &Entry, sim: &Entry, dilate: f64) -> Result<(Scores, [Tally; 2]), UnusablePair> {
    let (real_image, sim_image) = match (images::read(real), images::read(sim)) {
        (Ok(real), Ok(sim)) => (real, sim),
        (real, sim) => return Err(Box::new([real.err(), sim.err()])),
    };
    if real_image.dimensions() != sim_image.dimensions() {
        let ([w, h], [v, g]) = ([real_image.width(), real_image.height()], [sim_image.width(), sim_image.height()]);
        let (real_path, sim_path) = (real.path.display(), sim.path.display());
        let message = format!("{real_path} is {w}x{h} px, and {sim_path} is {v}x{g} px");
        let problem = Diagnostic::new(message)
            .of(real.name.as_str(), format!("real images are {w}x{h} px, and their simulated counterparts {v}x{g} px"))
            .help(format!("simulate with `resolution_px = [{w}, {h}]` in the sensor, or resize one of the two sides"));
        return Err(Box::new([Some(Unusable::new(real, problem)), None]));
    }
    let scores = score(&real_image, &sim_image, real.circle.as_ref(), dilate);
    Ok((scores, [Tally::from_image(&real_image), Tally::from_image(&sim_image)]))
}

/// Compares two sets.
fn apart(name: String, real: &Side, sim: &Side, notes: &mut Vec<Diagnostic>) -> Result<SensorRow, Report> {
    let (real, sim) = match (tally(real, notes), tally(sim, notes)) {
        (Ok(real), Ok(sim)) => (real, sim),
        (real, sim) => {
            return Err([real.err(), sim.err()].into_iter().flatten().fold(Report::default(), Report::and));
        }
    };
    let distances = Distances::between(&real, &sim);
    let verdict = verdict(&distances, Scenes::Different);
    Ok(SensorRow { sensor: name, means: None, distances, verdict })
}

/// Tally of a set, or of as many of its images, evenly spread, as are needed.
fn tally(side: &Side, notes: &mut Vec<Diagnostic>) -> Result<Tally, Report> {
    let (tally, looked, all, what) = match side {
        Side::Files(entries) => {
            let tally = tally_files(entries)?;
            (tally.clone(), tally.images, entries.len() as u64, "images")
        }
        Side::Dataset(dataset) => {
            let (tally, samples) = tally_dataset(dataset)?;
            (tally, samples, dataset.layout.samples(), if is_of_one(dataset) { "images" } else { "samples" })
        }
    };
    if looked < all {
        notes.push(Diagnostic::note(format!("looked at {looked} of {all} {what}, evenly spread")));
    }
    Ok(tally)
}

fn tally_files(entries: &[&Entry]) -> Result<Tally, Report> {
    let chosen: Vec<&&Entry> = entries.iter().step_by(entries.len().div_ceil(MOST_OF_A_SET).max(1)).collect();
    let (mut sum, mut wrong) = (Tally::default(), Diagnostics::default());
    let tallies: Vec<_> =
        chosen.par_iter().map(|entry| images::read(entry).map(|image| Tally::from_image(&image))).collect();
    for tally in tallies {
        match tally {
            Ok(tally) => sum.add(&tally),
            Err(unusable) => wrong.extend(unusable.report().problems().iter().cloned()),
        }
    }
    if wrong.is_empty() { Ok(sum) } else { Err(Report::new(&wrong, &[])) }
}

/// True of a dataset whose samples are one image each: neither sequences nor grips.
fn is_of_one(dataset: &Recorded) -> bool {
    dataset.job.sequence.is_none() && dataset.job.gripper.is_none()
}

/// Tally of a dataset, of all frames and fingers of each sample; and of how many samples.
fn tally_dataset(dataset: &Recorded) -> Result<(Tally, u64), Report> {
    let every = dataset.layout.samples().div_ceil(MOST_OF_A_SET as u64).max(1);
    // What stands before it names the frame and the finger.
    let is_tactile = |suffix: &str| suffix == "tactile.png" || suffix.ends_with(".tactile.png");
    let shard = |number: u64| -> Result<(Tally, u64), String> {
        let shard = dataset.layout.shard(number);
        let (mut sum, mut samples, mut wrong) = (Tally::default(), 0, None);
        let counts = |key: &str| key.parse::<u64>().is_ok_and(|index| index.is_multiple_of(every));
        let visit = |files: Files| {
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
        let read = dataset.read(&shard, |head| is_tactile(head.suffix) && counts(head.key), visit);
        let path = || dataset.paths(&shard).data;
        read.and_then(|()| wrong.map_or(Ok(()), Err)).map_err(|reason| format!("{}: {reason}", path().display()))?;
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
                let help = format!("`gelsim verify {}` names all that is wrong with it", dataset.root.display());
                return Err(user_error(reason, help));
            }
        }
    }
    Ok((sum, samples))
}

/// The two images of a pair that was scored, read again.
pub fn images_of(row: &ImageRow) -> Result<[RgbImage; 2], Report> {
    let [real, sim] = &row.entries;
    let read = |entry: &Entry| images::read(entry).map_err(|unusable| unusable.report());
    Ok([read(real)?, read(sim)?])
}
