//! What is known of a finished shard: its `stats/NAME.json`, written last, which marks the shard as complete.

use crate::container::ShardContainer;
use std::collections::BTreeMap;
use std::io;

use serde::{Deserialize, Serialize};

use super::paths::Paths;
use super::seal::{BLANK, is_sealed, sealed};
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
pub struct Stats {
    /// [`STATS_VERSION`] of the generator that wrote it.
    pub stats_version: u32,
    /// Version of the generator that wrote it.
    pub generator: String,
    /// Fingerprint of the job.
    pub fingerprint: String,
    /// The tar or folder, relative to the dataset's folder.
    pub file: String,
    /// Samples in it.
    pub samples: u64,
    /// Draws that were rejected and drawn again.
    pub rejected: u64,
    /// Samples in it that are not healthy.
    pub unhealthy: u64,
    /// Samples in it whose contact was not solved to the tolerance.
    pub unconverged: u64,
    /// Samples in it that show contact.
    pub in_contact: u64,
    /// Objects that were to be pressed in with others, and found no place among them.
    #[serde(default)]
    pub unplaced_objects: u64,
    /// How much of the contacts the optics were not calibrated on.
    #[serde(default)]
    pub light: LightRange,
    /// Bytes of the tar, or of the folder's files.
    pub bytes: u64,
    /// SHA-256 of the tar; of a folder, see [`super::imagefolder`].
    pub sha256: String,
    /// Samples per class; of several objects the first one's counts.
    pub classes: BTreeMap<String, u64>,
    /// Seconds per stage, summed over the samples.
    pub seconds: Seconds,
    /// How many samples each effect ran in, and for how long.
    pub effects: PerEffect<Count>,
    /// The rejected draws.
    pub rejections: Vec<Rejection>,
    /// SHA-256 of this file with 64 zeros in this place.
    pub seal_sha256: String,
}

/// What stands before the seal in the file.
const SEAL: &str = "\"seal_sha256\": \"";

/// Areas in contact, and those of them whose slope or displacement lies beyond the presses that the optics were calibrated
/// on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightRange {
    /// All that touches, mm^2, summed over the samples.
    pub contact_mm2: f64,
    /// What of it lies beyond, mm^2.
    pub outside_mm2: f64,
}

impl LightRange {
    /// Of one sample.
    pub fn from_label(label: &Label) -> Self {
        let contact_mm2 = label.contact.area_mm2;
        Self { contact_mm2, outside_mm2: contact_mm2 * label.numerics.light_outside_range }
    }

    /// Adds the areas of others.
    pub fn add(&mut self, other: &Self) {
        self.contact_mm2 += other.contact_mm2;
        self.outside_mm2 += other.outside_mm2;
    }

    /// Share of the contacts that lies beyond; 0 without contact.
    pub fn share_outside(&self) -> f64 {
        if self.contact_mm2 > 0.0 { self.outside_mm2 / self.contact_mm2 } else { 0.0 }
    }

    /// What to say of it; nothing if all is within.
    pub fn note(&self) -> Option<String> {
        let percent = 100.0 * self.share_outside();
        let share = if percent < 0.1 { String::from("less than 0.1 %") } else { format!("{percent:.1} %") };
        (percent > 0.0).then(|| {
            format!(
                "{share} of the contact is steeper or deeper than the presses that the optics were calibrated on: light is \
                 extrapolated there (docs/calibration.md)"
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
    /// Seed of the job: with key and attempt, all it takes to draw it again.
    pub seed: u64,
    /// What was wrong with it.
    pub reason: String,
    /// Its label.
    pub label: Label,
}

/// Samples with and without an effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Count {
    /// Samples in which it ran.
    pub ran: u64,
    /// Samples in which it was skipped.
    pub skipped: u64,
    /// CPU seconds that it took; part of its stage's.
    pub seconds: f64,
}

impl Count {
    /// Adds the samples of others.
    pub fn add(&mut self, other: &Self) {
        self.ran += other.ran;
        self.skipped += other.skipped;
        self.seconds += other.seconds;
    }
}

impl Versioned for Stats {
    const NEWEST: u32 = STATS_VERSION;

    fn version(&self) -> u32 {
        self.stats_version
    }

    fn is_as_written(text: &[u8]) -> bool {
        is_sealed(text, SEAL)
    }
}

impl Stats {
    /// Those of a shard without samples yet.
    pub fn new(shard: &Shard, container: Container, fingerprint: &str) -> Self {
        Self {
            stats_version: STATS_VERSION,
            generator: env!("CARGO_PKG_VERSION").to_owned(),
            fingerprint: fingerprint.to_owned(),
            file: container.file(shard),
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
            seal_sha256: BLANK.to_owned(),
        }
    }

    /// True if they are about this shard of the job with this fingerprint.
    pub fn is_of(&self, shard: &Shard, container: Container, fingerprint: &str) -> bool {
        (self.fingerprint.as_str(), self.samples) == (fingerprint, shard.samples) && self.file == container.file(shard)
    }

    /// The text of its file, sealed.
    pub fn to_text(&self) -> io::Result<String> {
        let blank = Self { seal_sha256: BLANK.to_owned(), ..self.clone() };
        Ok(sealed(&(serde_json::to_string_pretty(&blank).map_err(io::Error::other)? + "\n"), SEAL))
    }

    /// What the samples of the shard were counted to be otherwise than in this file, by key. `counted` has no rejected
    /// draws, only how many.
    pub fn differs(&self, counted: &Self) -> Option<String> {
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

    /// Counts a sample, and the draws of it that were rejected.
    pub fn count(&mut self, label: &Label, rejected: Vec<Label>, seconds: &Seconds, effects: &PerEffect<f64>) {
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
            let one = Count { ran: u64::from(ran), skipped: u64::from(!ran), seconds: effects[effect] };
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

    /// True if the shard is there and as large as the one that was written.
    pub fn measures(&self, paths: &Paths) -> io::Result<bool> {
        match paths.container.measure(&paths.data) {
            Ok(bytes) => Ok(bytes == self.bytes),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// True if the shard is the one that was written, byte for byte: reads all of it.
    pub fn vouches_for(&self, paths: &Paths) -> io::Result<bool> {
        Ok(self.measures(paths)? && paths.container.checksum(&paths.data)?.1 == self.sha256)
    }
}
