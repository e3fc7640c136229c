//! The objects of a plan: files found, read, named, and divided between the splits.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glob::Pattern;
use rayon::prelude::*;

use super::check::Check;
use super::draw::{Draw, Weighted};
use crate::core::base::rng::stream;
use crate::core::mesh::clusters::Clusters;
use crate::files::figures::figure;
use crate::files::input::{matching, may_be_file};
use crate::files::mesh::{self, Loaded};
use crate::job::config::Job;
use crate::job::config::dataset::{ObjectOrder, SplitBy};
use crate::job::config::object::{Object as Entry, Unit};
use crate::job::layout::Split;

/// An object ready to be pressed.
#[derive(Debug)]
pub struct Object {
    /// Unique name: the file's stem, with a number where two files share it.
    pub id: String,
    /// Class in the labels.
    pub class: String,
    /// SHA-256 of the file's bytes, lower-case hex.
    pub sha256: String,
    /// Relative frequency.
    pub weight: f64,
    /// Its geometry.
    pub clusters: Arc<Clusters>,
}

/// The objects of a job, as far as they could be read.
pub struct Found {
    /// The objects.
    pub objects: Vec<Object>,
    /// How many more there may be behind paths that turned out wrong.
    pub unread: usize,
}

/// Finds and reads the meshes. `job.object` becomes one entry per file, with absolute path, class and SHA-256.
pub fn load(check: &mut Check<'_>, job: &mut Job, notes: &mut Vec<String>) -> Found {
    if job.object.is_empty() && check.document.get("object").is_none() && !check.misspelt("object") {
        check.error("object", "the job has no object", "add an [[object]] table with path = \"...\"");
    } else if job.object.is_empty() && check.sound("object") {
        check.error("object", "the list of objects is empty", "add an [[object]] table with path = \"...\"");
    }
    let mut files: Vec<(usize, PathBuf)> = Vec::new();
    let mut unread = 0;
    for (i, entry) in job.object.iter().enumerate() {
        let path = |key: &str| format!("object.{i}.{key}");
        check.number(&path("weight"), entry.weight, 0.0..=1e9, "");
        if entry.class.as_deref().is_some_and(|class| class.is_empty() || class.len() > 255) {
            check.error(&path("class"), "a class needs 1 to 255 bytes", "or leave `class` out: the file's stem");
        }
        match &entry.path {
            None => {
                check.missing(&path("path"), &format!("a mesh file: {}", mesh::ENDINGS));
                unread += 1;
            }
            Some(written) => match find(check, &path("path"), written, FOLDER_OF_MESHES) {
                Ok(found) => files.extend(found.into_iter().map(|path| (i, path))),
                Err(count) => unread += count,
            },
        }
    }
    if !job.object.is_empty() && job.object.iter().all(|entry| entry.weight == 0.0) {
        check.error(
            "object.0.weight",
            "the weights sum to zero: no object can be drawn",
            "give one object a weight above 0",
        );
    }

    let read: Vec<_> = files
        .par_iter()
        .map(|(i, path)| mesh::load(path, job.object[*i].reading()).map(|l| (Arc::new(Clusters::new(&l.mesh)), l)))
        .collect();
    let mut entries: Vec<Entry> = Vec::new();
    let mut objects: Vec<Object> = Vec::new();
    for ((i, path), read) in files.iter().zip(read) {
        let entry = &job.object[*i];
        let (clusters, loaded) = match read {
            Ok(read) => read,
            Err(error) => {
                check.error(&format!("object.{i}.path"), error.to_string(), error.help());
                unread += 1;
                continue;
            }
        };
        if let Some(warning) = loaded.cleaned.warning() {
            notes.push(format!("{}: {warning}", path.display()));
        }
        if let Some(note) = odd_unit(path, &loaded, job.sensor.field_of_view_mm) {
            notes.push(note);
        }
        if let Some(expected) = &entry.sha256
            && *expected != loaded.sha256
        {
            let message = format!("{} has changed: its SHA-256 is {}", path.display(), loaded.sha256);
            check.error(&format!("object.{i}.sha256"), message, "restore the file, or remove this key");
        }
        let stem = stem(&path.to_string_lossy());
        let class = entry.class.clone().unwrap_or_else(|| stem.clone());
        // What the file itself says stays open: a job names few units.
        let unit = if loaded.given.format.knows_its_unit() { entry.unit } else { entry.unit.or(Some(Unit::Mm)) };
        entries.push(Entry {
            unit,
            path: Some(path.to_string_lossy().into_owned()),
            class: Some(class.clone()),
            sha256: Some(loaded.sha256.clone()),
            ..entry.clone()
        });
        // A weight that is none is reported above; the object counts all the same.
        let weight = if (0.0..).contains(&entry.weight) { entry.weight } else { 1.0 };
        objects.push(Object { id: stem, class, sha256: loaded.sha256, weight, clusters });
    }
    let stems = objects.iter().map(|object| object.id.clone()).collect();
    for (object, id) in objects.iter_mut().zip(ids(stems)) {
        object.id = id;
    }
    job.object = entries;
    Found { objects, unread }
}

/// What to say of a mesh whose coordinates are probably in another unit than the job says.
fn odd_unit(path: &Path, loaded: &Loaded, field_of_view_mm: [f64; 2]) -> Option<String> {
    // The bounding box is centred on zero.
    let half = loaded.mesh.vertices.iter().flatten().fold(0.0, |largest: f32, place| largest.max(place.abs()));
    let largest_mm = 2.0 * f64::from(half);
    let (likely, _) = Unit::likely(loaded.mm_per_unit, largest_mm, field_of_view_mm)?;
    let [width, height] = field_of_view_mm;
    let measured =
        format!("{} is {} mm long under {}", path.display(), figure(largest_mm), Unit::written(loaded.mm_per_unit));
    Some(format!(
        "{measured}, against a view of {width} x {height} mm; its values look like {}: if they are, write unit = \"{}\" \
         under its [[object]]",
        likely.in_words(),
        likely.name()
    ))
}

/// Unique names of objects from the stems of their files: with a number where several share one.
pub fn ids(stems: Vec<String>) -> Vec<String> {
    // The names that are taken, and of each stem the number that was given last.
    let (mut taken, mut numbers) = (HashSet::new(), HashMap::new());
    let named = stems.into_iter().map(|stem| {
        let (mut id, number) = (stem.clone(), numbers.entry(stem.clone()).or_insert(1));
        while !taken.insert(id.clone()) {
            *number += 1;
            id = format!("{stem}-{number}");
        }
        id
    });
    named.collect()
}

/// A mesh's name: that of its file, without folder and ending.
pub fn stem(path: &str) -> String {
    Path::new(path).file_stem().map_or(String::from("object"), |stem| stem.to_string_lossy().into_owned())
}

const FOLDER_OF_MESHES: &str =
    "paths are relative to the file they stand in; a folder's meshes are path = \"FOLDER/*.stl\"";

/// The files that `written` names: itself if it exists, else as a pattern; `help` is for who names none. After a mistake,
/// how many it may stand for.
pub(super) fn find(check: &mut Check<'_>, place: &str, written: &str, help: &str) -> Result<Vec<PathBuf>, usize> {
    // Nobody knows; enough for every split.
    const MANY: usize = Split::ALL.len();
    let folder = check.document.folder(place);
    let path = folder.join(written);
    let is_pattern = written.contains(['*', '?', '[']);
    if path.exists() || !is_pattern {
        if may_be_file(&path) {
            return no_text(&path).map_or(Ok(vec![path]), |odd| refuse_name(check, place, &odd));
        }
        let what = if path.is_dir() { "is a folder" } else { "does not exist" };
        check.error(place, format!("{} {what}", path.display()), help);
        return Err(if path.is_dir() { MANY } else { 1 });
    }
    if written.matches("**").count() > 1 {
        check.error(place, "more than one `**` in a pattern", "one `**` stands for any number of folders");
        return Err(MANY);
    }
    // Only what the user wrote is a pattern, not the folder that it starts from.
    let pattern = Path::new(&Pattern::escape(&folder.to_string_lossy())).join(written);
    let found = match glob::glob(&pattern.to_string_lossy()).map(matching) {
        Ok(Ok(found)) => found,
        Ok(Err(error)) => {
            check.error(place, error.to_string(), "name folders that can be read");
            return Err(MANY);
        }
        Err(error) => {
            check.error(place, format!("not a pattern: {}", error.msg), "`*`, `?` and `[abc]` stand for characters");
            return Err(MANY);
        }
    };
    if let Some(odd) = found.iter().find_map(|path| no_text(path)).or_else(|| passed_over(&path)) {
        return refuse_name(check, place, &odd);
    }
    if found.is_empty() {
        check.error(
            place,
            format!("no file matches {}", path.display()),
            "paths are relative to the file they stand in",
        );
        return Err(MANY);
    }
    Ok(found)
}

/// The path, if it is not UTF-8: no job can hold it, so that nobody could make the dataset again.
fn no_text(path: &Path) -> Option<PathBuf> {
    path.to_str().is_none().then(|| path.to_owned())
}

/// A file that the pattern's last part would match if its name were UTF-8; such names match no pattern.
fn passed_over(pattern: &Path) -> Option<PathBuf> {
    let last = Pattern::new(pattern.file_name()?.to_str()?).ok()?;
    let mut names = std::fs::read_dir(pattern.parent()?).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    let odd = names.find(|name| name.to_str().is_none() && last.matches(&name.to_string_lossy()))?;
    Some(pattern.with_file_name(odd))
}

fn refuse_name(check: &mut Check<'_>, place: &str, path: &Path) -> Result<Vec<PathBuf>, usize> {
    let message = format!("{} is not UTF-8, so that no job can hold it", path.display());
    check.error(place, message, "rename the file or its folders");
    Err(Split::ALL.len())
}

/// Divides the objects between the splits. `None` after a mistake.
pub fn divide(check: &mut Check<'_>, job: &Job, found: &Found) -> Option<[Draw; 3]> {
    let Found { objects, unread } = found;
    if *unread == 0 && objects.iter().all(|object| object.weight <= 0.0) {
        return None;
    }
    let splits = job.dataset.splits;
    let shares = [splits.train, splits.val, splits.test];
    let drawn: Vec<usize> = (0..objects.len()).filter(|&i| objects[i].weight > 0.0).collect();
    let groups = match job.dataset.split_by {
        SplitBy::Sample => [drawn.clone(), drawn.clone(), drawn],
        SplitBy::Object => {
            // Files of the same content are one object: a twin in another split would not be unseen.
            let mut known = HashSet::new();
            let hashes = drawn.iter().map(|&i| objects[i].sha256.as_str());
            let contents: Vec<&str> = hashes.filter(|hash| known.insert(*hash)).collect();
            let used = shares.iter().filter(|share| **share > 0.0).count();
            if used > contents.len() + unread {
                let message = format!("{used} splits but {} different object(s)", contents.len() + unread);
                let help = "with split_by = \"object\" each split needs an object of its own: add objects, or use split_by = \"sample\"";
                check.error("dataset.split_by", message, help);
            }
            if used > contents.len() {
                return None;
            }
            let order = shuffled(contents.len(), job.dataset.seed);
            let counts = apportion(contents.len(), shares);
            let mut groups: [Vec<usize>; 3] = Default::default();
            let mut next = order.into_iter();
            for (group, count) in groups.iter_mut().zip(counts) {
                let mine: HashSet<&str> = next.by_ref().take(count).map(|at| contents[at]).collect();
                *group = drawn.iter().copied().filter(|&i| mine.contains(objects[i].sha256.as_str())).collect();
            }
            groups
        }
    };
    let of = |i: &usize| (*i, objects[*i].class.as_str(), objects[*i].weight);
    Some(std::array::from_fn(|split| match job.dataset.object_order {
        ObjectOrder::InTurn => Draw::InTurn(groups[split].clone()),
        ObjectOrder::Weighted => Draw::Weighted(Weighted::new(split, groups[split].iter().map(of))),
    }))
}

/// Numbers 0 .. `count` in an order drawn from the seed (Fisher and Yates).
fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    let mut random = stream(seed, "splits", 0);
    for last in (1..count).rev() {
        order.swap(last, random.below(last + 1));
    }
    order
}

/// `count` objects in proportion to `shares`, at least one where a share is above 0 (there are enough).
fn apportion(count: usize, shares: [f64; 3]) -> [usize; 3] {
    let mut given = shares.map(|share| usize::from(share > 0.0));
    while given.iter().sum::<usize>() < count {
        // To whoever is furthest behind its share.
        let behind = |k: usize| shares[k] * count as f64 - given[k] as f64;
        let next = (0..3).filter(|&k| shares[k] > 0.0).max_by(|&a, &b| behind(a).total_cmp(&behind(b)));
        match next {
            Some(k) => given[k] += 1,
            None => break,
        }
    }
    given
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_apportioned_by_share_and_no_split_goes_empty() {
        assert_eq!(apportion(10, [0.8, 0.1, 0.1]), [8, 1, 1]);
        assert_eq!(apportion(3, [0.98, 0.01, 0.01]), [1, 1, 1]);
        assert_eq!(apportion(5, [1.0, 0.0, 0.0]), [5, 0, 0]);
        assert_eq!(apportion(20, [0.5, 0.25, 0.25]), [10, 5, 5]);
    }
}
