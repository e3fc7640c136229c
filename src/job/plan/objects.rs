//! The objects of a plan: files found, read, named, and divided between the splits.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;

use super::check::Check;
use super::draw::{Draw, Weighted};
use super::meshes::{File, Part, read};
use super::naming;
use super::paths::{OBJECTS, find, folders};
use super::{faces, files, object_notes};
use crate::config::Job;
use crate::config::dataset::{ObjectOrder, SplitBy};
use crate::config::object::{Object as Entry, OnBad, Parts, Unit};
use crate::config::scene::Face;
use crate::inspection::SensorPad;
use crate::inspection::findings::{self, Finding};
use crate::layout::Split;
use gelsim_core::base::rng::stream;
use gelsim_core::depth::relief::Relief;
use gelsim_core::mesh::CleanupReport;
use gelsim_core::mesh::cleaning::LARGEST_MM;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::Side;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Severity};
use gelsim_files::figures::figure;
use gelsim_files::mesh;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::spelling::nearest;

/// An object ready to be pressed.
#[derive(Debug)]
pub struct Object {
    /// Unique name: the file's stem, and the part's name where it is one, with a number where two share it.
    pub id: String,
    /// Class in the labels.
    pub class: String,
    /// Path in the labels: as the job writes it, or as its pattern found it.
    pub path: String,
    /// Name of the part of the file that it is; none if it is all of it.
    pub part: Option<String>,
    /// SHA-256 of the file's bytes, lower-case hex.
    pub sha256: String,
    /// Relative frequency.
    pub weight: f64,
    /// Factor on its size.
    pub scale: Quantity,
    /// Number of the `[[object]]` that names it.
    pub table: usize,
    /// The one split that it is in, if the job says so.
    pub split: Option<Split>,
    /// Its geometry.
    pub clusters: Arc<Clusters>,
    /// The side with the most relief, where the job presses that.
    pub richest: Option<Side>,
    /// The patterns of its own texture; none where it has the job's.
    pub textures: Option<Vec<Arc<Relief>>>,
}

/// The objects of a job, as far as they could be read.
pub struct Found {
    /// The objects.
    pub objects: Vec<Object>,
    /// How many more there may be behind paths that turned out wrong.
    pub unread: usize,
}

/// Finds and reads the meshes. `job.object` becomes one entry per object, with absolute path, class, SHA-256, and the path for
/// labels.
pub fn load(check: &mut Check<'_>, job: &mut Job, notes: &mut Diagnostics) -> Found {
    if job.object.is_empty() && check.document.get("object").is_none() && !check.misspelt("object") {
        check.error("object", "the job has no object", "add an [[object]] table with path = \"...\"");
    } else if job.object.is_empty() && check.sound("object") {
        let help = "write [[object]] with path = \"my-part.stl\" in place of the empty list";
        check.error("object", "the list of objects is empty", help);
    }
    let mut meshes: Vec<File> = Vec::new();
    let mut unread = 0;
    for (i, entry) in job.object.iter_mut().enumerate() {
        let path = |key: &str| format!("object.{i}.{key}");
        folders(check, &path("packages"), &mut entry.packages);
        let entry = &*entry;
        check.number(&path("weight"), entry.weight, 0.0..=1e9, "");
        if entry.class.as_deref().is_some_and(|class| class.is_empty() || class.len() > 255) {
            check.error(&path("class"), "a class needs 1 to 255 bytes", "or leave `class` out: the file's stem");
        }
        check.quantity(&path("scale"), &entry.scale, 1e-3..=1e3, "");
        lengths(check, i, entry);
        if let Some(split) = entry.split {
            if job.dataset.split_by != SplitBy::Object {
                let help = "write split_by = \"object\" under [dataset]: whole objects go to one split then";
                check.error(&path("split"), "samples are divided between the splits, whatever their object", help);
            } else if job.dataset.splits.shares()[split.number()] <= 0.0 {
                let message = format!("no sample is in the split `{}`", split.name());
                let help = format!(
                    "give it a share under [dataset], such as splits = {{ train = 0.9, {} = 0.1 }}",
                    split.name()
                );
                check.error(&path("split"), message, help);
            }
        }
        match &entry.path {
            None => {
                check.missing(
                    &path("path"),
                    &format!("a mesh file: {}; or a height map: .png, .npy, .npz or .exr", mesh::ENDINGS),
                );
                unread += 1;
            }
            Some(written) => match find(check, &path("path"), written, &OBJECTS) {
                Ok(found) => {
                    height_maps(check, i, entry, &found);
                    let folder = check.document.folder(&path("path"));
                    meshes.extend(found.into_iter().map(|path| File::new(i, path, entry, folder)));
                }
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

    let mut texture = |(i, entry): (usize, &mut Entry)| {
        let texture = entry.texture.as_mut()?;
        Some(files::textures(check, &format!("object.{i}.texture"), texture))
    };
    let textures: Vec<_> = job.object.iter_mut().enumerate().map(&mut texture).collect();
    let classes = naming::classes(&job.object, &meshes, notes);
    // A height map of unknown size is missed above, and no mesh.
    let known = |file: &File| !mesh::is_height_map(&file.path) || job.object[file.entry].plate_size().is_some();
    let named = meshes.len();
    let (classes, meshes): (Vec<_>, Vec<_>) = classes.into_iter().zip(meshes).filter(|(_, file)| known(file)).unzip();
    unread += named - meshes.len();
    let pad = SensorPad::new(&job.sensor);
    // Where an object is named.
    let places: Vec<_> = (0..job.object.len()).map(|i| check.document.place(&format!("object.{i}.path"))).collect();
    let place = |i: usize| places[i];
    let found = read(&job.object, &meshes, &pad);
    let mut entries: Vec<Entry> = Vec::new();
    let mut objects: Vec<Object> = Vec::new();
    let mut left_out = None;
    for ((file, of_file), class) in meshes.iter().zip(found).zip(classes) {
        let File { entry: i, path, label } = file;
        let entry = &job.object[*i];
        let parts = match &*of_file {
            Ok(parts) => parts,
            Err(error) if entry.on_bad == OnBad::Skip => {
                let skipped = Diagnostic::warning(format!("left out: {error}")).help(error.help()).at(place(*i));
                notes.push(skipped.of(error.to_string(), format!("{} and are left out", error.cause())));
                left_out.get_or_insert((*i, error.to_string()));
                continue;
            }
            Err(error) => {
                let help = match meshes.len() {
                    1 => error.help(),
                    _ => format!("{}; on_bad = \"skip\" leaves out all such meshes", error.help()),
                };
                let problem = Diagnostic::new(error.to_string()).help(help).at(place(*i));
                check.problems.push(problem.of(error.to_string(), error.cause()));
                unread += 1;
                continue;
            }
        };
        let meant = |part: &&Part| entry.part.is_none() || part.name == entry.part;
        if let Some(wanted) = entry.part.as_ref().filter(|_| !parts.iter().any(|part| meant(&part))) {
            let names: Vec<&str> = parts.iter().filter_map(|part| part.name.as_deref()).take(20).collect();
            let message = format!("{} has no part `{}`", path.display(), wanted.escape_debug());
            let help = match (names.is_empty(), nearest(wanted, names.iter().copied())) {
                (true, _) => String::from("it has no parts: leave `part` out"),
                (false, Some(near)) => format!("did you mean part = {near:?}? Its parts: {}", names.join(", ")),
                (false, None) => format!("its parts: {}; leave `part` out for all of them", names.join(", ")),
            };
            check.error(&format!("object.{i}.part"), message, help);
            unread += 1;
        }
        for part in parts.iter().filter(meant) {
            let Part { name, clusters, .. } = part;
            let of_part = |text: &str| name.as_ref().map_or(text.to_owned(), |name| format!("{text}/{name}"));
            let shown = of_part(&path.to_string_lossy());
            if let Some(left_out) = (CleanupReport { non_finite_vertices: 0, ..part.cleaned }).warning() {
                let info = Diagnostic::info(format!("{shown}: {left_out}")).at(place(*i));
                notes.push(info.of(format!("{shown} ({left_out})"), "meshes have triangles that were left out"));
            }
            let mut said: Vec<_> = part.remarks.iter().map(findings::remark).collect();
            said.extend(findings::slow(part.rows_per_capture));
            let scale = entry.factor(part.size.largest_mm());
            let mut size = part.size.scaled(&scale, &pad);
            if entry.length_mm.is_some() {
                size.known_from = Some("as length_mm says");
            }
            said.extend(findings::of_mesh(&size, &part.cleaned, &pad));
            let is_doubted = said.iter().any(Finding::doubts_the_size);
            for finding in said {
                let found = finding.diagnostic(&shown).at(place(*i));
                match finding.severity {
                    Severity::Error => check.problems.push(found),
                    _ => notes.push(found),
                }
            }
            // Of another size than the true one, the rest tells nothing.
            if !is_doubted {
                let of_job = object_notes::of(&shown, job, &scale, clusters, &part.facets);
                notes.extend(of_job.into_iter().map(|note| note.at(place(*i))));
            }
            if let Some(expected) = &entry.sha256
                && *expected != part.sha256
            {
                let message = format!("{} has changed: its SHA-256 is {}", path.display(), part.sha256);
                check.error(&format!("object.{i}.sha256"), message, "restore the file, or remove this key");
            }
            let most = part.size.largest_mm() * scale.support().1;
            if most > LARGEST_MM && entry.scale != Quantity::Constant(1.0) {
                let message = format!("{shown} may be {} mm long under this scale", figure(most));
                check.error(&format!("object.{i}.scale"), message, format!("allowed: up to {LARGEST_MM:.0e} mm"));
            }
            let class = entry.class.clone().unwrap_or_else(|| of_part(&class));
            // What the file itself says stays open: a job names few units.
            let unit = match entry.unit {
                None if !part.knows_its_unit && entry.length_mm.is_none() => Some(Unit::Mm),
                unit => unit,
            };
            entries.push(Entry {
                unit,
                path: Some(path.to_string_lossy().into_owned()),
                label_path: Some(label.clone()),
                class: Some(class.clone()),
                class_from: None,
                parts: Parts::default(),
                part: name.clone(),
                packages: part.packages.clone(),
                on_bad: OnBad::default(),
                sha256: Some(part.sha256.clone()),
                ..entry.clone()
            });
            // A weight that is none is reported above; the object counts all the same.
            let weight = if (0.0..).contains(&entry.weight) { entry.weight } else { 1.0 };
            let id = naming::name(&path.to_string_lossy(), name.as_deref());
            objects.push(Object {
                id,
                class,
                path: label.clone(),
                part: name.clone(),
                sha256: part.sha256.clone(),
                weight,
                richest: (job.pose.face == Face::Auto).then(|| match (&entry.length_mm, scale.typical()) {
                    // So large as it is usually pressed.
                    (Some(_), typical) => faces::richest(&clusters.scaled(typical), job.sensor.gelpad_thickness_mm),
                    (None, _) => faces::richest(clusters, job.sensor.gelpad_thickness_mm),
                }),
                scale,
                table: *i,
                split: entry.split,
                clusters: Arc::clone(clusters),
                textures: textures[*i].clone(),
            });
        }
    }
    if let Some((i, error)) = left_out.filter(|_| objects.is_empty() && unread == 0) {
        let message = format!("all meshes are left out, the first because of {error}");
        check.error(
            &format!("object.{i}.path"),
            message,
            "name a mesh that can be read: gelsim inspect tells them apart",
        );
    }
    let names = objects.iter().map(|object| object.id.clone()).collect();
    for (object, id) in objects.iter_mut().zip(ids(names)) {
        object.id = id;
    }
    job.object = entries;
    Found { objects, unread }
}

/// Which sides `face = "auto"` presses: of the first objects, and of how many.
pub fn pressed_sides(objects: &[Object]) -> Option<String> {
    const NAMED: usize = 8;
    let sides = objects.iter().filter_map(|object| Some((object, Face::of(object.richest?).name())));
    let sides: Vec<String> = sides.map(|(object, side)| format!("{side} of {}", object.id)).collect();
    let more = match sides.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(", and of {more} more theirs"),
    };
    let named = sides[..sides.len().min(NAMED)].join(", ");
    (!sides.is_empty()).then(|| format!("face = \"auto\" presses the sides with the most relief: {named}{more}"))
}

/// What an `[[object]]` has to say of the height maps among its files, and what it may not say without any.
fn height_maps(check: &mut Check<'_>, i: usize, entry: &Entry, found: &[PathBuf]) {
    let path = |key: &str| format!("object.{i}.{key}");
    let numbers = [("mm_per_px", entry.mm_per_px, "0.02"), ("height_mm", entry.height_mm, "0.5")];
    let Some(map) = found.iter().find(|path| mesh::is_height_map(path)) else {
        for (key, ..) in numbers.iter().filter(|(_, value, _)| value.is_some()) {
            let message = format!("{key} is for height maps (.png, .npy, .npz, .exr), and `path` names none");
            check.error(&path(key), message, "leave it out; `unit` and `scale` say how large a mesh is");
        }
        return;
    };
    if numbers.iter().all(|(_, value, _)| value.is_none()) {
        let help = format!("how large is {}? For example mm_per_px = 0.02 and height_mm = 0.5", map.display());
        check.missing(&path("mm_per_px"), &help);
    }
    for (key, value, example) in numbers {
        match value {
            // Both were asked for together.
            None if entry.mm_per_px.is_none() && entry.height_mm.is_none() => {}
            Some(value) => check.number(&path(key), value, 1e-4..=100.0, "mm"),
            None => {
                check.missing(&path(key), &format!("how large is {}? For example {key} = {example}", map.display()))
            }
        }
    }
    if entry.unit.is_some() {
        check.error(
            &path("unit"),
            "a height map has no unit",
            "leave it out: mm_per_px and height_mm say how large it is",
        );
    }
}

/// What `length_mm` may be, and what it takes the place of.
fn lengths(check: &mut Check<'_>, i: usize, entry: &Entry) {
    let Some(length_mm) = &entry.length_mm else { return };
    let path = |key: &str| format!("object.{i}.{key}");
    check.quantity(&path("length_mm"), length_mm, 1e-3..=1e4, "mm");
    let others = [
        ("unit", entry.unit.is_some()),
        ("scale", entry.scale != Quantity::Constant(1.0)),
        ("mm_per_px", entry.mm_per_px.is_some()),
    ];
    for (key, _) in others.iter().filter(|(_, given)| *given) {
        let message = format!("`length_mm` and `{key}` both say how large the object is");
        check.error(&path(key), message, "keep one of the two");
    }
}

/// Refuses a scale where no samples are drawn: whoever says where an object is says it of the mesh as it is.
pub fn as_they_are(check: &mut Check<'_>, job: &Job) {
    for (i, entry) in job.object.iter().enumerate() {
        if entry.length_mm.is_some() {
            let help = "leave it out, and write the mesh's `unit`: only samples of a job are scaled";
            check.error(&format!("object.{i}.length_mm"), "the objects' places are known as they are", help);
        }
        if entry.scale != Quantity::Constant(1.0) {
            let help = "leave it out: only samples of a job are scaled";
            check.error(&format!("object.{i}.scale"), "the objects' places are known as they are", help);
        }
    }
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

/// Divides the objects between the splits. `None` after a mistake.
pub fn divide(check: &mut Check<'_>, job: &Job, found: &Found) -> Option<[Draw; 3]> {
    let Found { objects, unread } = found;
    if *unread == 0 && objects.iter().all(|object| object.weight <= 0.0) {
        return None;
    }
    let splits = job.dataset.splits;
    let shares = splits.shares();
    let drawn: Vec<usize> = (0..objects.len()).filter(|&i| objects[i].weight > 0.0).collect();
    let groups = match job.dataset.split_by {
        SplitBy::Sample => [drawn.clone(), drawn.clone(), drawn],
        SplitBy::Object => {
            // Files of the same content are one object: a twin in another split would not be unseen.
            let mut known = HashSet::new();
            let content = |i: usize| (objects[i].sha256.as_str(), objects[i].part.as_deref());
            let contents: Vec<_> = drawn.iter().map(|&i| content(i)).filter(|content| known.insert(*content)).collect();
            // Where an object is said to be, all of its content is.
            let mut said: HashMap<_, Split> = HashMap::new();
            for &i in drawn.iter().filter(|&&i| objects[i].split.is_some()) {
                let split = objects[i].split.expect("filtered");
                let before = *said.entry(content(i)).or_insert(split);
                if before != split {
                    let message =
                        format!("{} is in the split `{}` already, as the same file", objects[i].path, before.name());
                    check.error(
                        &format!("object.{}.split", objects[i].table),
                        message,
                        "an object is in one split: keep one of them",
                    );
                }
            }
            let free: Vec<_> = contents.iter().copied().filter(|content| !said.contains_key(content)).collect();
            let fixed: [usize; 3] = std::array::from_fn(|k| said.values().filter(|split| split.number() == k).count());
            let wanting = (0..3).filter(|&k| shares[k] > 0.0 && fixed[k] == 0).count();
            if wanting > free.len() + unread {
                let used = shares.iter().filter(|share| **share > 0.0).count();
                let message = format!("{used} splits but {} different object(s)", contents.len() + unread);
                let help = "with split_by = \"object\" each split needs an object of its own: add objects, or use split_by = \"sample\"";
                check.error("dataset.split_by", message, help);
            }
            if wanting > free.len() {
                return None;
            }
            let order = shuffled(free.len(), job.dataset.seed);
            let counts = apportion(free.len(), shares, fixed);
            let mut groups: [Vec<usize>; 3] = Default::default();
            let mut next = order.into_iter();
            for (k, (group, count)) in groups.iter_mut().zip(counts).enumerate() {
                let mut mine: HashSet<_> = next.by_ref().take(count).map(|at| free[at]).collect();
                mine.extend(said.iter().filter(|(_, split)| split.number() == k).map(|(content, _)| *content));
                *group = drawn.iter().copied().filter(|&i| mine.contains(&content(i))).collect();
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

/// `count` objects beside those that have their splits, so that all of them are in proportion to `shares` as far as may be, and at
/// least one is where a share is above 0 (there are enough).
fn apportion(count: usize, shares: [f64; 3], fixed: [usize; 3]) -> [usize; 3] {
    let all = count + fixed.iter().sum::<usize>();
    let mut given: [usize; 3] = std::array::from_fn(|k| fixed[k].max(usize::from(shares[k] > 0.0)));
    while given.iter().sum::<usize>() < all {
        // To whoever is furthest behind its share.
        let behind = |k: usize| shares[k] * all as f64 - given[k] as f64;
        let next = (0..3).filter(|&k| shares[k] > 0.0).max_by(|&a, &b| behind(a).total_cmp(&behind(b)));
        match next {
            Some(k) => given[k] += 1,
            None => break,
        }
    }
    std::array::from_fn(|k| given[k] - fixed[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_apportioned_by_share_and_no_split_goes_empty() {
        assert_eq!(apportion(10, [0.8, 0.1, 0.1], [0; 3]), [8, 1, 1]);
        assert_eq!(apportion(3, [0.98, 0.01, 0.01], [0; 3]), [1, 1, 1]);
        assert_eq!(apportion(5, [1.0, 0.0, 0.0], [0; 3]), [5, 0, 0]);
        assert_eq!(apportion(20, [0.5, 0.25, 0.25], [0; 3]), [10, 5, 5]);
        // Beside those that are said.
        assert_eq!(apportion(9, [0.8, 0.1, 0.1], [0, 0, 1]), [8, 1, 0]);
        assert_eq!(apportion(6, [0.5, 0.25, 0.25], [0, 0, 4]), [4, 2, 0]);
        assert_eq!(apportion(0, [0.5, 0.0, 0.5], [2, 0, 1]), [0, 0, 0]);
    }
}
