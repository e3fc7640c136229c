//! The stats of a finished shard, `stats/NAME.json`. The file is written last and marks the shard as complete.

use crate::container::ShardContainer;
use std::collections::BTreeMap;
use std::io;

use serde::{Deserialize, Serialize};

use super::paths::ShardPaths;
use super::self_hash::{BLANK_HASH, has_valid_self_hash, insert_self_hash};
use super::versioned::Versioned;
use gelsim_core::base::clock::Seconds;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_job::config::output::Container;
use gelsim_job::label::Label;
use gelsim_job::layout::Shard;

/// Version of the keys of stats and their meaning.
pub const STATS_VERSION: u32 = 1;

/// The stats of a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardStats {
    /// [`STATS_VERSION`] of the generator that wrote it.
    pub stats_version: u32,
    /// Version of the generator that wrote it.
    pub generator: String,
    /// Fingerprint of the job.
    pub fingerprint: String,
    /// The tar or folder, relative to the dataset's folder.
    pub file: String,
    /// Number of samples.
    pub samples: u64,
    /// Draws that were rejected and drawn again.
    pub rejected: u64,
    /// Samples that are not healthy.
    pub unhealthy: u64,
    /// Samples whose contact was not solved to the tolerance.
    pub unconverged: u64,
    /// Samples that show contact.
    pub in_contact: u64,
    /// Objects for which there was no place among the others of their samples.
    #[serde(default)]
    pub unplaced_objects: u64,
    /// How much of the contacts lies outside the calibrated range of the optics.
    #[serde(default)]
    pub light: LightRange,
    /// Bytes of the tar, or of the folder's files.
    pub bytes: u64,
    /// SHA-256 of the tar; for a folder see [`super::imagefolder`].
    pub sha256: String,
    /// Samples per class; a sample with several objects counts for the class of the first one.
    pub classes: BTreeMap<String, u64>,
    /// CPU seconds per stage, summed over the samples.
    pub seconds: Seconds,
    /// Each effect: in how many samples it ran, and for how long.
    pub effects: PerEffect<EffectCount>,
    /// The rejected draws.
    pub rejections: Vec<Rejection>,
    /// SHA-256 of this file with 64 zeros in this place.
    pub seal_sha256: String,
}

/// What stands before the file's own hash.
const SELF_HASH_MARK: &str = "\"seal_sha256\": \"";

/// Area of contacts, and the part of it whose slope or displacement lies outside the presses on which the optics were
/// calibrated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightRange {
    /// Area of all contacts, mm^2, summed over the samples.
    pub contact_mm2: f64,
    /// Part of it outside the calibrated range, mm^2.
    pub outside_mm2: f64,
}

impl LightRange {
    /// Returns the areas of one sample.
    pub fn from_label(label: &Label) -> Self {
        let contact_mm2 = label.contact.area_mm2;
        Self { contact_mm2, outside_mm2: contact_mm2 * label.numerics.light_outside_range }
    }

    /// Adds the areas of other samples.
    pub fn add(&mut self, other: &Self) {
        self.contact_mm2 += other.contact_mm2;
        self.outside_mm2 += other.outside_mm2;
    }

    /// Returns the fraction of the contacts outside the calibrated range; 0 without contact.
    pub fn share_outside(&self) -> f64 {
        if self.contact_mm2 > 0.0 { self.outside_mm2 / self.contact_mm2 } else { 0.0 }
    }

    /// Returns a note for the user, or `None` if all is within the calibrated range.
    pub fn note(&self) -> Option<String> {
        let percent = 100.0 * self.share_outside();
        let share = if percent < 0.1 { String::from("less than 0.1 %") } else { format!("{percent:.1} %") };
        (percent > 0.0).then(|| {
            format!(
                "{share} of the contact is steeper or deeper than the presses that the optics were calibrated on: light is \
                 extrapolated there (docs/how-to/calibrate.md)"
            )
        })
    }
}

/// A draw that did not go into the dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rejection {
    /// Key of the sample.
    pub key: String,
    /// How many draws of the sample were rejected before this one.
    pub attempt: u32,
    /// Seed of the job. With the key and the attempt it is all that is needed to draw the sample again.
    pub seed: u64,
    /// What was wrong with it.
    pub reason: String,
    /// Its label.
    pub label: Label,
}

/// Number of samples with and without an effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EffectCount {
    /// Samples in which it ran.
    pub ran: u64,
    /// Samples in which it was skipped.
    pub skipped: u64,
    /// CPU seconds of the effect, which are part of its stage's.
    pub seconds: f64,
}

impl EffectCount {
    /// Adds the counts of other samples.
    pub fn add(&mut self, other: &Self) {
        self.ran += other.ran;
        self.skipped += other.skipped;
        self.seconds += other.seconds;
    }
}

impl Versioned for ShardStats {
    const NEWEST: u32 = STATS_VERSION;

    fn from_json(text: &[u8]) -> serde_json::Result<Self> {
        serde_json::from_value(serde_json::from_slice(text)?)
    }

    fn version(&self) -> u32 {
        self.stats_version
    }

    fn is_unmodified(text: &[u8]) -> bool {
        has_valid_self_hash(text, SELF_HASH_MARK)
    }
}

impl ShardStats {
    /// Makes the stats of a shard that has no samples yet.
    pub fn new(shard: &Shard, container: Container, fingerprint: &str) -> Self {
        Self {
            stats_version: STATS_VERSION,
            generator: env!("CARGO_PKG_VERSION").to_owned(),
            fingerprint: fingerprint.to_owned(),
            file: container.relative_path(shard),
            samples: 0,
            rejected: 0,
            unhealthy: 0,
            unconverged: 0,
            in_contact: 0,
            unplaced_objects: 0,
            light: LightRange::default(),
            bytes: 0,
            sha256: String::new(),
            classes: BTreeMap::new(),
            seconds: Seconds::default(),
            effects: PerEffect::default(),
            rejections: Vec::new(),
            seal_sha256: BLANK_HASH.to_owned(),
        }
    }

    /// Returns true if the stats are about this shard of the job with this fingerprint.
    pub fn belongs_to(&self, shard: &Shard, container: Container, fingerprint: &str) -> bool {
        (self.fingerprint.as_str(), self.samples) == (fingerprint, shard.samples)
            && self.file == container.relative_path(shard)
    }

    /// Formats the text of the file, with its own hash.
    pub fn to_text(&self) -> io::Result<String> {
        let blank = Self { seal_sha256: BLANK_HASH.to_owned(), ..self.clone() };
        Ok(insert_self_hash(&(serde_json::to_string_pretty(&blank).map_err(io::Error::other)? + "\n"), SELF_HASH_MARK))
    }

    /// Compares the stats with what the labels of the shard were counted to be. Returns the first difference, by key,
    /// or `None`. `counted` has the number of rejected draws, but not the draws.
    pub fn find_difference(&self, counted: &Self) -> Option<String> {
        let numbers = [
            ("samples", self.samples, counted.samples),
            ("rejected", self.rejected, counted.rejected),
            ("rejections", self.rejections.len() as u64, counted.rejected),
            ("unhealthy", self.unhealthy, counted.unhealthy),
            ("unconverged", self.unconverged, counted.unconverged),
            ("in_contact", self.in_contact, counted.in_contact),
            ("unplaced_objects", self.unplaced_objects, counted.unplaced_objects),
        ];
        if let Some((key, here, there)) = numbers.into_iter().find(|(_, here, there)| here != there) {
            return Some(format!("{key} is {here}, the labels have {there}"));
        }
        if self.classes != counted.classes {
            return Some(format!("classes are {:?}, the labels have {:?}", self.classes, counted.classes));
        }
        if self.light != counted.light {
            return Some(format!("light is {:?}, the labels have {:?}", self.light, counted.light));
        }
        let ran = |stats: &Self, effect| (stats.effects[effect].ran, stats.effects[effect].skipped);
        let effect = Effect::ALL.into_iter().find(|effect| ran(self, *effect) != ran(counted, *effect))?;
        let [here, there] = [self, counted].map(|stats| stats.effects[effect].ran);
        Some(format!("effects.{}.ran is {here}, the labels have {there}", effect.name()))
    }

    /// Counts a sample, and those draws of it that were rejected.
    pub fn count_sample(&mut self, label: &Label, rejected: Vec<Label>, seconds: &Seconds, effects: &PerEffect<f64>) {
        self.samples += 1;
        self.rejected += rejected.len() as u64;
        self.unhealthy += u64::from(!label.health.healthy);
        self.unconverged += u64::from(!label.numerics.converged);
        self.in_contact += u64::from(label.contact.in_contact);
        self.unplaced_objects += u64::from(label.unplaced_objects);
        self.light.add(&LightRange::from_label(label));
        *self.classes.entry(label.header.object.class.clone()).or_default() += 1;
        for effect in Effect::ALL {
            let ran = label.effects[effect].ran;
            let one = EffectCount { ran: u64::from(ran), skipped: u64::from(!ran), seconds: effects[effect] };
            self.effects[effect].add(&one);
        }
        self.seconds.add(seconds);
        self.rejections.extend(rejected.into_iter().map(|label| Rejection {
            key: label.header.key.clone(),
            attempt: label.header.attempt,
            seed: label.header.seed,
            reason: label.health.reason.clone(),
            label,
        }));
    }

    /// Returns true if the shard exists with the size that was written.
    pub fn matches_size(&self, paths: &ShardPaths) -> io::Result<bool> {
        match paths.container.measure_bytes(&paths.data) {
            Ok(bytes) => Ok(bytes == self.bytes),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Returns true if the shard is exactly the one that was written. Reads all of it.
    pub fn matches_checksum(&self, paths: &ShardPaths) -> io::Result<bool> {
        Ok(self.matches_size(paths)? && paths.container.checksum(&paths.data)?.1 == self.sha256)
    }
}
