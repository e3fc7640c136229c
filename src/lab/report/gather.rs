//! Gathers what labels and stats say of a dataset, as plain sums: shards are summed by themselves and merged. Memory
//! depends on what there is to tell apart (classes, objects, reasons), not on the number of samples.

use std::collections::{BTreeMap, BTreeSet};

use super::heatmap::PointHeatmap;
use super::histogram::{Histogram, PerSplit, add_counts};
use super::quantities::QUANTITIES;
use super::sequences::SequenceStats;
use crate::preview::Tile;
use gelsim_core::base::clock::Seconds;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_dataset::stats::{EffectCount, ShardStats};
use gelsim_dataset::verify::DatasetFinding;
use gelsim_job::label::Label;
use gelsim_job::layout::Split;

/// Sums over the samples of some shards.
pub struct DatasetStats {
    /// Samples whose labels were read.
    pub samples: PerSplit,
    /// Samples in contact, of those.
    pub in_contact: PerSplit,
    /// Samples of each class.
    pub classes: BTreeMap<String, PerSplit>,
    /// Class and samples of each object.
    pub objects: BTreeMap<String, (String, PerSplit)>,
    /// Fidelity level, gelpad model and optics model of the samples; a single combination unless shards of different
    /// jobs are mixed.
    pub models: BTreeSet<[String; 3]>,
    /// A histogram of each of [`QUANTITIES`].
    pub histograms: Vec<Histogram>,
    /// Mean grey levels of some tactile images.
    pub brightness: Histogram,
    /// Sums that only sequences have.
    pub sequences: SequenceStats,
    /// Heatmap of the contacts' centroids.
    pub places: PointHeatmap,
    /// Why each effect ran (true) or did not, with the number of samples.
    pub reasons: PerEffect<BTreeMap<(bool, String), u64>>,
    /// Samples that are not healthy.
    pub unhealthy: Reasons,
    /// Samples whose contact is not solved to the tolerance.
    pub unconverged: Reasons,
    /// Draws that were rejected.
    pub rejected: Reasons,
    /// Samples pressed deeper than the gelpad's theory holds.
    pub beyond_theory: u64,
    /// Numbers of samples with clipped pixels, saturated pixels, and pixels limited to the pad's thickness.
    pub pixels: [u64; 3],
    /// Number and bytes of the files with a suffix.
    pub files: BTreeMap<String, (u64, u64)>,
    /// Sums of the shards' stats.
    pub totals: ShardTotals,
    /// Samples for the contact sheet.
    pub tiles: Vec<SampleTile>,
    /// Problems that were found.
    pub findings: Vec<DatasetFinding>,
}

/// Sums of the stats of shards.
#[derive(Clone, Debug)]
pub struct ShardTotals {
    /// Shards with stats.
    pub shards: u64,
    /// Samples in these shards.
    pub samples: u64,
    /// Bytes of the shards.
    pub bytes: u64,
    /// Size of each shard, MiB.
    pub shard_mib: Histogram,
    /// CPU seconds per stage.
    pub seconds: Seconds,
    /// Runs and CPU time of each effect.
    pub effects: PerEffect<EffectCount>,
    /// Versions of the generators.
    pub generators: BTreeSet<String>,
    /// Fingerprints of the job.
    pub fingerprints: BTreeSet<String>,
}

/// A sample of the contact sheet.
pub struct SampleTile {
    /// Number of the sample.
    pub index: u64,
    /// Split of the sample.
    pub split: Split,
    /// Pictures of the sample.
    pub tile: Tile,
}

/// Reasons of one kind, told apart by their words, with the number of times and the first keys of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reasons(BTreeMap<String, (u64, BTreeSet<String>)>);

impl Reasons {
    /// Most keys that are kept for a reason.
    const MAX_NAMED: usize = 5;

    fn count_reason(&mut self, reason: &str, key: &str) {
        self.add_reason(replace_numbers(reason), 1, BTreeSet::from([key.to_owned()]));
    }

    fn add_reason(&mut self, reason: String, count: u64, keys: BTreeSet<String>) {
        let (sum, named) = self.0.entry(reason).or_default();
        *sum += count;
        named.extend(keys);
        while named.len() > Self::MAX_NAMED {
            named.pop_last();
        }
    }

    fn merge(&mut self, other: Self) {
        other.0.into_iter().for_each(|(reason, (count, keys))| self.add_reason(reason, count, keys));
    }

    /// Number of times that any reason was given.
    pub fn total(&self) -> u64 {
        self.0.values().map(|(count, _)| count).sum()
    }

    /// Lists every reason with its count and its lowest keys, the most frequent first.
    pub fn ranked_reasons(&self) -> Vec<(&str, u64, Vec<&str>)> {
        let listed = self.0.iter().map(|(reason, (count, keys))| {
            (reason.as_str(), *count, keys.iter().map(String::as_str).collect::<Vec<_>>())
        });
        let mut listed: Vec<_> = listed.collect();
        listed.sort_by_key(|(_, count, _)| std::cmp::Reverse(*count));
        listed
    }
}

/// Replaces each number of a text by an ellipsis, so that sentences that differ only in numbers are one reason.
fn replace_numbers(text: &str) -> String {
    let (mut out, mut within) = (String::with_capacity(text.len()), false);
    for (at, c) in text.char_indices() {
        let next_is_digit = || text[at + c.len_utf8()..].starts_with(|next: char| next.is_ascii_digit());
        let of_number = c.is_ascii_digit() || within && c == '.' && next_is_digit() || c == '-' && next_is_digit();
        match (of_number, within) {
            (true, false) => out.push('\u{2026}'),
            (true, true) => {}
            (false, _) => out.push(c),
        }
        within = of_number;
    }
    out
}

impl DatasetStats {
    /// Creates empty sums for a view of this width and height, mm.
    pub fn new(view_mm: [f64; 2]) -> Self {
        Self {
            samples: PerSplit::default(),
            in_contact: PerSplit::default(),
            classes: BTreeMap::new(),
            objects: BTreeMap::new(),
            models: BTreeSet::new(),
            histograms: QUANTITIES.iter().map(|quantity| quantity.new_histogram()).collect(),
            brightness: Histogram::continuous(),
            sequences: SequenceStats::default(),
            places: PointHeatmap::new(view_mm),
            reasons: PerEffect::default(),
            unhealthy: Reasons::default(),
            unconverged: Reasons::default(),
            rejected: Reasons::default(),
            beyond_theory: 0,
            pixels: [0; 3],
            files: BTreeMap::new(),
            totals: ShardTotals {
                shards: 0,
                samples: 0,
                bytes: 0,
                shard_mib: Histogram::continuous(),
                seconds: Seconds::default(),
                effects: PerEffect::default(),
                generators: BTreeSet::new(),
                fingerprints: BTreeSet::new(),
            },
            tiles: Vec::new(),
            findings: Vec::new(),
        }
    }

    /// Counts a sample of a split.
    pub fn count_sample(&mut self, split: Split, label: &Label) {
        let at = split.number();
        self.samples[at] += 1;
        entry_or_default(&mut self.classes, &label.header.object.class)[at] += 1;
        match self.objects.get_mut(&label.header.object.id) {
            Some((_, counts)) => counts[at] += 1,
            None => {
                let mut counts = PerSplit::default();
                counts[at] = 1;
                self.objects.insert(label.header.object.id.clone(), (label.header.object.class.clone(), counts));
            }
        }
        let models =
            [&label.models.fidelity, &label.models.gelpad_model, &label.models.optics_model].map(String::clone);
        self.models.insert(models);
        if label.contact.in_contact {
            self.in_contact[at] += 1;
            self.places.count_point(label.contact.centroid_mm);
        }
        for (quantity, histogram) in QUANTITIES.iter().zip(&mut self.histograms) {
            // A quantity computed from finite numbers may overflow.
            if let Some(value) = (quantity.value_of)(label).filter(|value| value.is_finite()) {
                histogram.count_value(split, value);
            }
        }
        for (effect, note) in label.effects.iter() {
            *self.reasons[effect].entry((note.ran, note.reason.to_string())).or_default() += 1;
        }
        if !label.health.healthy {
            self.unhealthy.count_reason(&label.health.reason, &label.header.key);
        }
        if !label.numerics.converged {
            self.unconverged.count_reason("the solver stopped before its tolerance", &label.header.key);
        }
        self.beyond_theory += u64::from(label.numerics.beyond_theory);
        let health = &label.health;
        let pixels = [health.clipped_px, health.saturated_px, health.over_thickness_px];
        self.pixels.iter_mut().zip(pixels).for_each(|(samples, px)| *samples += u64::from(px > 0));
    }

    /// Counts the stats of a shard of a split.
    pub fn count_shard(&mut self, split: Split, stats: &ShardStats) {
        let totals = &mut self.totals;
        totals.shards += 1;
        totals.samples += stats.samples;
        totals.bytes += stats.bytes;
        totals.shard_mib.count_value(split, stats.bytes as f64 / 1_048_576.0);
        totals.seconds.add(&stats.seconds);
        for (effect, count) in stats.effects.iter() {
            totals.effects[effect].add(count);
        }
        totals.generators.insert(stats.generator.clone());
        totals.fingerprints.insert(stats.fingerprint.clone());
        stats.rejections.iter().for_each(|draw| self.rejected.count_reason(&draw.reason, &draw.key));
    }

    /// Adds a sample to the contact sheet.
    pub fn add_tile(&mut self, index: u64, split: Split, tile: Tile) {
        self.tiles.push(SampleTile { index, split, tile });
    }

    /// Adds the sums of later shards.
    pub fn merge(&mut self, other: Self) {
        add_counts(&mut self.samples, &other.samples);
        add_counts(&mut self.in_contact, &other.in_contact);
        other.classes.iter().for_each(|(name, counts)| add_counts(entry_or_default(&mut self.classes, name), counts));
        for (id, (class, counts)) in other.objects {
            add_counts(&mut self.objects.entry(id).or_insert((class, PerSplit::default())).1, &counts);
        }
        self.models.extend(other.models);
        self.histograms.iter_mut().zip(other.histograms).for_each(|(sum, more)| sum.merge(more));
        self.brightness.merge(other.brightness);
        self.sequences.merge(other.sequences);
        self.places.merge(&other.places);
        for (effect, reasons) in other.reasons.iter() {
            for (reason, count) in reasons {
                *self.reasons[effect].entry(reason.clone()).or_default() += count;
            }
        }
        self.unhealthy.merge(other.unhealthy);
        self.unconverged.merge(other.unconverged);
        self.rejected.merge(other.rejected);
        self.beyond_theory += other.beyond_theory;
        self.pixels.iter_mut().zip(other.pixels).for_each(|(sum, samples)| *sum += samples);
        for (suffix, (number, bytes)) in &other.files {
            let sum = entry_or_default(&mut self.files, suffix);
            *sum = (sum.0 + number, sum.1 + bytes);
        }
        self.totals.merge(other.totals);
        self.tiles.extend(other.tiles);
        self.findings.extend(other.findings);
    }
}

impl ShardTotals {
    fn merge(&mut self, other: Self) {
        self.shards += other.shards;
        self.samples += other.samples;
        self.bytes += other.bytes;
        self.shard_mib.merge(other.shard_mib);
        self.seconds.add(&other.seconds);
        for effect in Effect::ALL {
            self.effects[effect].add(&other.effects[effect]);
        }
        self.generators.extend(other.generators);
        self.fingerprints.extend(other.fingerprints);
    }
}

/// Returns the entry of a name, which is inserted if it is missing. The name is copied only then.
pub fn entry_or_default<'a, T: Default>(map: &'a mut BTreeMap<String, T>, name: &str) -> &'a mut T {
    if !map.contains_key(name) {
        map.insert(name.to_owned(), T::default());
    }
    map.get_mut(name).expect("it was inserted if it was not there")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_that_differ_in_numbers_only_are_one_with_its_least_keys() {
        let text = "the contact is not solved: 0.125 um are left after 200 iterations; between -3 and 1.5 mm.";
        let kind = "the contact is not solved: \u{2026} um are left after \u{2026} iterations; between \u{2026} and \u{2026} mm.";
        assert_eq!(replace_numbers(text), kind);
        let given = |keys: &mut dyn Iterator<Item = u64>| {
            let mut reasons = Reasons::default();
            keys.for_each(|key| reasons.count_reason(&format!("{key}.5 um"), &gelsim_job::label::sample_key(key)));
            reasons
        };
        let in_order = given(&mut (0..20));
        let (mut a, b) =
            (given(&mut (0..20).filter(|key| key % 3 > 0)), given(&mut (0..20).filter(|key| key % 3 == 0)));
        a.merge(b);
        assert_eq!(a, in_order);
        let ranked = in_order.ranked_reasons();
        assert_eq!((ranked.len(), ranked[0].0, ranked[0].1), (1, "\u{2026} um", 20));
        assert_eq!(ranked[0].2, ["000000000", "000000001", "000000002", "000000003", "000000004"]);
    }
}
