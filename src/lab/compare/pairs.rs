//! Which simulated image belongs to which real one.
//!
//! Sensors are told by the names of their folders, unless there is one on each side. Within a sensor, images pair by
//! their paths relative to its folder, then by their names without folders, where those are unique on both sides.

use std::collections::{HashMap, HashSet};

use super::images::{Entry, Images, SensorImages};
use gelsim_dataset::recorded::Recorded;
use gelsim_files::diagnostic::Diagnostic;

/// One side of a comparison of sets.
pub enum Side<'a> {
    /// Images of sensors.
    Files(Vec<&'a Entry>),
    /// Images of a dataset.
    Dataset(&'a Recorded),
}

/// What is compared with what.
pub enum Group<'a> {
    /// Image by image.
    Paired {
        /// The sensor that the real images are of.
        real: &'a SensorImages,
        /// The sensor that the simulated images are of.
        sim: &'a SensorImages,
        /// Real and simulated image, in the order of the real ones.
        pairs: Vec<(&'a Entry, &'a Entry)>,
    },
    /// Set by set: no two images belong together.
    Apart {
        /// The sensor's name, or `all`.
        name: String,
        /// Real images.
        real: Side<'a>,
        /// Simulated images.
        sim: Side<'a>,
    },
}

/// The groups, and what has no counterpart, as warnings.
pub fn pair<'a>(real: &'a Images, sim: &'a Images) -> (Vec<Group<'a>>, Vec<Diagnostic>) {
    let (mut groups, mut notes) = (Vec::new(), Vec::new());
    if let (Images::Sensors(reals), Images::Sensors(sims)) = (real, sim) {
        let single = reals.len() == 1 && sims.len() == 1;
        for real in reals {
            match sims.iter().find(|sim| single || sim.name == real.name) {
                Some(sim) => groups.push(group(real, sim, &mut notes)),
                None => notes.push(alone(&real.name, "real", &real.images.iter().collect::<Vec<_>>())),
            }
        }
        for sim in sims.iter().filter(|sim| !single && reals.iter().all(|real| real.name != sim.name)) {
            notes.push(alone(&sim.name, "simulated", &sim.images.iter().collect::<Vec<_>>()));
        }
    }
    if groups.is_empty() {
        notes.clear();
        groups.push(Group::Apart { name: String::from("all"), real: side(real), sim: side(sim) });
    }
    (groups, notes)
}

fn side(images: &Images) -> Side<'_> {
    match images {
        Images::Sensors(sensors) => Side::Files(sensors.iter().flat_map(|sensor| &sensor.images).collect()),
        Images::Dataset(dataset) => Side::Dataset(dataset),
    }
}

fn group<'a>(real: &'a SensorImages, sim: &'a SensorImages, notes: &mut Vec<Diagnostic>) -> Group<'a> {
    let pairs = pairs(&real.images, &sim.images);
    if pairs.is_empty() {
        let [real_side, sim_side] = [real, sim].map(|sensor| Side::Files(sensor.images.iter().collect()));
        return Group::Apart { name: real.name.clone(), real: real_side, sim: sim_side };
    }
    for (what, entries, paired) in [
        ("real", &real.images, pairs.iter().map(|(real, _)| real.name.as_str()).collect::<HashSet<_>>()),
        ("simulated", &sim.images, pairs.iter().map(|(_, sim)| sim.name.as_str()).collect()),
    ] {
        let left: Vec<&Entry> = entries.iter().filter(|entry| !paired.contains(entry.name.as_str())).collect();
        if !left.is_empty() {
            notes.push(alone(&real.name, what, &left));
        }
    }
    Group::Paired { real, sim, pairs }
}

fn pairs<'a>(reals: &'a [Entry], sims: &'a [Entry]) -> Vec<(&'a Entry, &'a Entry)> {
    let by_path: HashMap<&str, &Entry> = sims.iter().map(|sim| (sim.name.as_str(), sim)).collect();
    let (real_bases, sim_bases) = (unique(reals), unique(sims));
    let real_paths: HashMap<&str, &Entry> = reals.iter().map(|real| (real.name.as_str(), real)).collect();
    let found = reals.iter().filter_map(|real| {
        let by_base = || {
            real_bases.get(real.base())?;
            // Not one that another image's path claims.
            sim_bases.get(real.base()).filter(|sim| !real_paths.contains_key(sim.name.as_str()))
        };
        Some((real, *by_path.get(real.name.as_str()).or_else(by_base)?))
    });
    found.collect()
}

/// Images whose names without folders no other has.
fn unique(entries: &[Entry]) -> HashMap<&str, &Entry> {
    let mut counts: HashMap<&str, u32> = HashMap::new();
    entries.iter().for_each(|entry| *counts.entry(entry.base()).or_default() += 1);
    entries.iter().map(|entry| (entry.base(), entry)).filter(|(base, _)| counts[base] == 1).collect()
}

/// Names that a warning lists.
const MOST_NAMED: usize = 8;

fn alone(sensor: &str, what: &str, images: &[&Entry]) -> Diagnostic {
    let names: Vec<&str> = images.iter().take(MOST_NAMED).map(|entry| entry.name.as_str()).collect();
    let more = match images.len().saturating_sub(MOST_NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let noun = if images.len() == 1 { "image has" } else { "images have" };
    let message = format!("{sensor}: {} {what} {noun} no counterpart: {}{more}", images.len(), names.join(", "));
    Diagnostic::warning(message)
        .help("images pair by their paths in the sensor's folder, or by their names: rename one side")
}
