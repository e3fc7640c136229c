//! Pairs of simulated and real images.
//!
//! Sensors match by the names of their folders, or if there is just one on each side. Within a sensor, images pair by
//! their paths relative to its folder, then by their names without folders, then by those without endings, where these
//! are unique on both sides.

use std::collections::{HashMap, HashSet};

use super::images::{FolderImages, ImageEntry, SensorImages};
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_files::diagnostic::Diagnostic;

/// One side of a comparison of sets.
pub enum ComparedSet<'a> {
    /// Images of sensors.
    Files(Vec<&'a ImageEntry>),
    /// Images of a dataset.
    Dataset(&'a RecordedDataset),
}

/// A comparison to make.
pub enum ComparisonGroup<'a> {
    /// Image by image.
    Paired {
        /// The sensor that the real images are of.
        real: &'a SensorImages,
        /// The sensor that the simulated images are of.
        sim: &'a SensorImages,
        /// Real and simulated image, in the order of the real ones.
        pairs: Vec<(&'a ImageEntry, &'a ImageEntry)>,
    },
    /// Set by set: no two images belong together.
    Unpaired {
        /// The sensor's name, or `all`.
        name: String,
        /// Real images.
        real: ComparedSet<'a>,
        /// Simulated images.
        sim: ComparedSet<'a>,
    },
}

/// Groups the images of two folders. Also returns warnings about images without a counterpart.
pub fn group_images<'a>(real: &'a FolderImages, sim: &'a FolderImages) -> (Vec<ComparisonGroup<'a>>, Vec<Diagnostic>) {
    let (mut groups, mut notes) = (Vec::new(), Vec::new());
    if let (FolderImages::Sensors(reals), FolderImages::Sensors(sims)) = (real, sim) {
        let single = reals.len() == 1 && sims.len() == 1;
        for real in reals {
            match sims.iter().find(|sim| single || sim.name == real.name) {
                Some(sim) => groups.push(group_sensor(real, sim, &mut notes)),
                None => notes.push(warn_unpaired(&real.name, "real", &real.images.iter().collect::<Vec<_>>())),
            }
        }
        for sim in sims.iter().filter(|sim| !single && reals.iter().all(|real| real.name != sim.name)) {
            notes.push(warn_unpaired(&sim.name, "simulated", &sim.images.iter().collect::<Vec<_>>()));
        }
    }
    if groups.is_empty() {
        notes.clear();
        groups.push(ComparisonGroup::Unpaired { name: String::from("all"), real: to_set(real), sim: to_set(sim) });
    }
    (groups, notes)
}

/// Returns all images of a folder as one set.
fn to_set(images: &FolderImages) -> ComparedSet<'_> {
    match images {
        FolderImages::Sensors(sensors) => {
            ComparedSet::Files(sensors.iter().flat_map(|sensor| &sensor.images).collect())
        }
        FolderImages::Dataset(dataset) => ComparedSet::Dataset(dataset),
    }
}

/// Pairs the images of two sensors; if none pair, they are compared as sets.
fn group_sensor<'a>(real: &'a SensorImages, sim: &'a SensorImages, notes: &mut Vec<Diagnostic>) -> ComparisonGroup<'a> {
    let pairs = match_pairs(&real.images, &sim.images);
    if pairs.is_empty() {
        let [real_side, sim_side] = [real, sim].map(|sensor| ComparedSet::Files(sensor.images.iter().collect()));
        return ComparisonGroup::Unpaired { name: real.name.clone(), real: real_side, sim: sim_side };
    }
    for (what, entries, paired) in [
        ("real", &real.images, pairs.iter().map(|(real, _)| real.name.as_str()).collect::<HashSet<_>>()),
        ("simulated", &sim.images, pairs.iter().map(|(_, sim)| sim.name.as_str()).collect()),
    ] {
        let left: Vec<&ImageEntry> = entries.iter().filter(|entry| !paired.contains(entry.name.as_str())).collect();
        if !left.is_empty() {
            notes.push(warn_unpaired(&real.name, what, &left));
        }
    }
    ComparisonGroup::Paired { real, sim, pairs }
}

/// Finds the pairs, in the order of the real images.
fn match_pairs<'a>(reals: &'a [ImageEntry], sims: &'a [ImageEntry]) -> Vec<(&'a ImageEntry, &'a ImageEntry)> {
    let mut found: Vec<Option<&ImageEntry>> = vec![None; reals.len()];
    let names: [fn(&ImageEntry) -> &str; 3] = [|entry| &entry.name, ImageEntry::file_name, ImageEntry::file_stem];
    for name_of in names {
        let taken: HashSet<&str> = found.iter().flatten().map(|sim| sim.name.as_str()).collect();
        let [unique_reals, unique_sims] = [reals, sims].map(|entries| index_unique_names(entries, name_of));
        for (real, found) in reals.iter().zip(&mut found).filter(|(_, found)| found.is_none()) {
            let name = name_of(real);
            let sim = unique_sims.get(name).filter(|_| unique_reals.contains_key(name));
            *found = sim.copied().filter(|sim| !taken.contains(sim.name.as_str()));
        }
    }
    reals.iter().zip(found).filter_map(|(real, sim)| Some((real, sim?))).collect()
}

/// Indexes images by a name of theirs, where it is unique.
fn index_unique_names(entries: &[ImageEntry], name_of: fn(&ImageEntry) -> &str) -> HashMap<&str, &ImageEntry> {
    let mut found: HashMap<&str, Option<&ImageEntry>> = HashMap::new();
    for entry in entries {
        let only = found.entry(name_of(entry)).or_insert(Some(entry));
        // A table may list an image twice.
        *only = only.filter(|other| other.name == entry.name);
    }
    found.into_iter().filter_map(|(name, only)| Some((name, only?))).collect()
}

/// Most names that a warning lists.
const MAX_NAMED: usize = 8;

/// Returns the warning about images without a counterpart.
fn warn_unpaired(sensor: &str, what: &str, images: &[&ImageEntry]) -> Diagnostic {
    let names: Vec<&str> = images.iter().take(MAX_NAMED).map(|entry| entry.name.as_str()).collect();
    let more = match images.len().saturating_sub(MAX_NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let noun = if images.len() == 1 { "image has" } else { "images have" };
    let message = format!("{sensor}: {} {what} {noun} no counterpart: {}{more}", images.len(), names.join(", "));
    Diagnostic::warning(message)
        .help("images pair by their paths in the sensor's folder, or by their names without endings: rename one side")
}
