//! Finds, reads and names the objects of a plan, and divides them between the splits.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;

use super::check::JobChecker;
use super::geometry::Geometry;
use super::mesh_facts::MeshFacts;
use super::meshes::{MeshPart, ObjectFile, read_mesh_files};
use super::naming;
use super::object_sampler::{ObjectSampler, WeightedSampler};
use super::paths::{OBJECTS, find_files, resolve_folders};
use super::{files, object_notes};
use crate::config::Job;
use crate::config::dataset::{ObjectOrder, SplitBy};
use crate::config::object::{Object as Entry, OnBad, Parts, Unit};
use crate::config::scene::Face;
use crate::inspection::findings::{self, MeshFinding};
use crate::inspection::{SensorPad, SizeSource};
use crate::layout::Split;
use gelsim_core::base::rng::random_stream;
use gelsim_core::depth::relief::Relief;
use gelsim_core::mesh::CleanupReport;
use gelsim_core::mesh::cleaning::LARGEST_MM;
use gelsim_core::pose::Side;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Severity};
use gelsim_files::mesh::{self, MeshFileError};
use gelsim_files::number_format::format_number;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::source::SourceSpan;
use gelsim_files::spelling::find_nearest_name;

/// An object that is ready to be pressed.
#[derive(Debug)]
pub struct PreparedObject {
    /// Unique name: the file's stem, with the part's name if it is a part, and with a number if several objects share
    /// the name.
    pub id: String,
    /// Class in the labels.
    pub class: String,
    /// Path in the labels: as the job writes it, or as its pattern found it.
    pub path: String,
    /// Name of the part of the file; `None` if the object is the complete file.
    pub part: Option<String>,
    /// SHA-256 of the file's bytes, in lower-case hex.
    pub sha256: String,
    /// Relative frequency of the object.
    pub weight: f64,
    /// Factor on its size.
    pub scale: Quantity,
    /// Index of the `[[object]]` that names it.
    pub table_index: usize,
    /// The split that it must be in, if the job says so.
    pub split: Option<Split>,
    /// Geometry of the object.
    pub geometry: Geometry,
    /// The side with the most relief, if the job presses that.
    pub richest_side: Option<Side>,
    /// Patterns of its own texture; `None` if it has the job's.
    pub textures: Option<Vec<Arc<Relief>>>,
}

/// The objects of a job that could be read.
pub struct FoundObjects {
    /// The objects.
    pub objects: Vec<PreparedObject>,
    /// How many more objects there may be behind paths with errors.
    pub unread: usize,
}

/// Finds and reads the meshes. `job.object` becomes one entry per object, with an absolute path, the class, the
/// SHA-256, and the path for labels.
pub fn load_objects(check: &mut JobChecker<'_>, job: &mut Job, notes: &mut Diagnostics) -> FoundObjects {
    if job.object.is_empty() && check.document.get("object").is_none() && !check.is_misspelt("object") {
        check.report_error("object", "the job has no object", "add an [[object]] table with path = \"...\"");
    } else if job.object.is_empty() && check.is_valid("object") {
        let help = "write [[object]] with path = \"my-part.stl\" in place of the empty list";
        check.report_error("object", "the list of objects is empty", help);
    }
    let mut meshes: Vec<ObjectFile> = Vec::new();
    let mut unread = 0;
    for i in 0..job.object.len() {
        resolve_folders(check, &format!("object.{i}.packages"), &mut job.object[i].packages);
        let entry = &job.object[i];
        check_entry(check, i, job);
        match find_object_files(check, i, entry) {
            Ok(found) => meshes.extend(found),
            Err(count) => unread += count,
        }
    }
    if !job.object.is_empty() && job.object.iter().all(|entry| entry.weight == 0.0) {
        check.report_error(
            "object.0.weight",
            "the weights sum to zero: no object can be drawn",
            "give one object a weight above 0",
        );
    }

    let mut texture = |(i, entry): (usize, &mut Entry)| {
        let texture = entry.texture.as_mut()?;
        Some(files::load_textures(check, &format!("object.{i}.texture"), texture))
    };
    let textures: Vec<_> = job.object.iter_mut().enumerate().map(&mut texture).collect();
    let classes = naming::name_classes(&job.object, &meshes, notes);
    // A height map without a size was reported above, and cannot be read.
    let known = |file: &ObjectFile| !mesh::is_height_map(&file.path) || job.object[file.entry].plate_size().is_some();
    let named = meshes.len();
    let (classes, meshes): (Vec<_>, Vec<_>) = classes.into_iter().zip(meshes).filter(|(_, file)| known(file)).unzip();
    unread += named - meshes.len();
    let pad = SensorPad::new(&job.sensor);
    let (read, not_remembered) = read_mesh_files(job, &meshes, &pad);
    notes.extend(not_remembered);
    let mut loader = ObjectLoader {
        check,
        notes,
        job,
        pad,
        textures,
        is_only_file: meshes.len() == 1,
        entries: Vec::new(),
        objects: Vec::new(),
        left_out: None,
        unread,
    };
    for ((file, parts), class) in meshes.iter().zip(&read).zip(&classes) {
        match &**parts {
            Ok(parts) => loader.add_file(file, parts, class),
            Err(error) => loader.report_unreadable(file.entry, error),
        }
    }
    let (entries, found) = loader.finish();
    job.object = entries;
    found
}

/// Checks the keys of the `[[object]]` with this index that do not depend on its files.
fn check_entry(check: &mut JobChecker<'_>, i: usize, job: &Job) {
    let (entry, dataset) = (&job.object[i], &job.dataset);
    let path = |key: &str| format!("object.{i}.{key}");
    check.require_in_range(&path("weight"), entry.weight, 0.0..=1e9, "");
    if entry.class.as_deref().is_some_and(|class| class.is_empty() || class.len() > 255) {
        check.report_error(&path("class"), "a class needs 1 to 255 bytes", "or leave `class` out: the file's stem");
    }
    check.require_quantity_in_range(&path("scale"), &entry.scale, 1e-3..=1e3, "");
    check_lengths(check, i, entry);
    let Some(split) = entry.split else { return };
    if dataset.split_by != SplitBy::Object {
        let message = "samples are divided between the splits, whatever their object";
        let help = "write split_by = \"object\" under [dataset]: whole objects go to one split then";
        check.report_error(&path("split"), message, help);
    } else if dataset.splits.shares()[split.number()] <= 0.0 {
        let message = format!("no sample is in the split `{}`", split.name());
        let is_only = job.object.iter().all(|other| other.split == Some(split));
        let shares =
            if is_only { format!("{} = 1.0", split.name()) } else { format!("train = 0.9, {} = 0.1", split.name()) };
        let example = format!("splits = {{ {shares} }}");
        let help = format!("give it a share under [dataset], such as {example}");
        check.report_error(&path("split"), message, help);
    }
}

/// Finds the files of the `[[object]]` with this index. An error, which was reported, is how many there may be.
fn find_object_files(check: &mut JobChecker<'_>, i: usize, entry: &Entry) -> Result<Vec<ObjectFile>, usize> {
    let path = format!("object.{i}.path");
    let Some(written) = &entry.path else {
        let help = format!("a mesh file: {}; or a height map: .png, .npy, .npz or .exr", mesh::ENDINGS);
        check.report_missing(&path, &help);
        return Err(1);
    };
    let found = find_files(check, &path, written, &OBJECTS)?;
    check_height_maps(check, i, entry, &found);
    let folder = check.document.folder_of(&path);
    Ok(found.into_iter().map(|path| ObjectFile::new(i, path, entry, folder)).collect())
}

/// Gathers the objects of a job from its files, one after the other.
struct ObjectLoader<'a, 'd> {
    check: &'a mut JobChecker<'d>,
    notes: &'a mut Diagnostics,
    job: &'a Job,
    pad: SensorPad,
    /// Patterns of each table's own texture.
    textures: Vec<Option<Vec<Arc<Relief>>>>,
    is_only_file: bool,
    /// The table of each object.
    entries: Vec<Entry>,
    objects: Vec<PreparedObject>,
    /// The first mesh that is left out: its table, and why.
    left_out: Option<(usize, String)>,
    unread: usize,
}

impl ObjectLoader<'_, '_> {
    /// Returns the place of the key that names the files of a table.
    fn place(&self, i: usize) -> Option<SourceSpan> {
        self.check.document.place_of(&format!("object.{i}.path"))
    }

    /// Reports that a file cannot be used, or leaves it out where its table says so.
    fn report_unreadable(&mut self, i: usize, error: &MeshFileError) {
        let message = error.to_string();
        if self.job.object[i].on_bad == OnBad::Skip {
            let skipped = Diagnostic::warning(format!("left out: {message}")).help(error.help()).at(self.place(i));
            self.notes.push(skipped.about(message.clone(), format!("{} and are left out", error.plural_cause())));
            self.left_out.get_or_insert((i, message));
            return;
        }
        let help = match self.is_only_file {
            true => error.help(),
            false => format!("{}; on_bad = \"skip\" leaves out all such meshes", error.help()),
        };
        let problem = Diagnostic::new(message.clone()).help(help).at(self.place(i));
        self.check.problems.push(problem.about(message, error.plural_cause()));
        self.unread += 1;
    }

    /// Adds the parts of a file that its table means.
    fn add_file(&mut self, file: &ObjectFile, parts: &[MeshPart], class: &str) {
        let wanted = self.job.object[file.entry].part.as_ref();
        let meant = |part: &&MeshPart| wanted.is_none() || part.facts.name.as_ref() == wanted;
        if let Some(wanted) = wanted.filter(|_| !parts.iter().any(|part| meant(&part))) {
            let names: Vec<&str> = parts.iter().filter_map(|part| part.facts.name.as_deref()).take(20).collect();
            let message = format!("{} has no part `{}`", file.path.display(), wanted.escape_debug());
            let help = match (names.is_empty(), find_nearest_name(wanted, names.iter().copied())) {
                (true, _) => String::from("it has no parts: leave `part` out"),
                (false, Some(near)) => format!("did you mean part = {near:?}? Its parts: {}", names.join(", ")),
                (false, None) => format!("its parts: {}; leave `part` out for all of them", names.join(", ")),
            };
            self.check.report_error(&format!("object.{}.part", file.entry), message, help);
            self.unread += 1;
        }
        for part in parts.iter().filter(meant) {
            self.inspect_part(file, &part.facts);
            self.add_part(file, part, class);
        }
    }

    /// Says what is remarkable about a part, and whether it is what the job says.
    fn inspect_part(&mut self, file: &ObjectFile, part: &MeshFacts) {
        let (i, entry) = (file.entry, &self.job.object[file.entry]);
        let place = self.place(i);
        let shown = name_part(&file.path.to_string_lossy(), part);
        if let Some(left_out) = (CleanupReport { non_finite_vertices: 0, ..part.cleaned }).warning() {
            let info = Diagnostic::info(format!("{shown}: {left_out}")).at(place);
            self.notes.push(info.about(format!("{shown} ({left_out})"), "meshes have triangles that were left out"));
        }
        let mut said: Vec<_> = part.remarks.iter().map(findings::report_remark).collect();
        said.extend(findings::report_slow(part.rows_per_capture));
        let scale = entry.size_factor(part.size.largest_extent_mm());
        let mut size = part.size.scaled(&scale, &self.pad);
        if entry.length_mm.is_some() {
            size.known_from = Some(SizeSource::LengthMm);
        }
        said.extend(findings::inspect_mesh(&size, &part.cleaned, &self.pad));
        let is_doubted = said.iter().any(MeshFinding::doubts_the_size);
        for finding in said {
            let found = finding.to_diagnostic(&shown).at(place);
            match finding.severity {
                Severity::Error => self.check.problems.push(found),
                _ => self.notes.push(found),
            }
        }
        // If the size is doubted, other notes would be wrong.
        if !is_doubted {
            let of_job = object_notes::collect_object_notes(&shown, self.job, &scale, part);
            self.notes.extend(of_job.into_iter().map(|note| note.at(place)));
        }
        let (key, path) = (|| format!("object.{i}.sha256"), || file.path.display().to_string());
        files::check_hash(self.check, key, entry.sha256.as_deref(), &part.sha256, path);
        let most = part.size.largest_extent_mm() * scale.support().1;
        if most > LARGEST_MM && entry.scale != Quantity::Constant(1.0) {
            let message = format!("{shown} may be {} mm long under this scale", format_number(most));
            let help = format!("allowed: up to {LARGEST_MM:.0e} mm");
            self.check.report_error(&format!("object.{i}.scale"), message, help);
        }
    }

    /// Adds a part as an object.
    fn add_part(&mut self, file: &ObjectFile, MeshPart { facts, geometry }: &MeshPart, class: &str) {
        let (i, entry) = (file.entry, &self.job.object[file.entry]);
        let path = file.path.to_string_lossy();
        let class = entry.class.clone().unwrap_or_else(|| name_part(class, facts));
        // If the format states its unit, the key stays empty.
        let unit = match entry.unit {
            None if !facts.knows_its_unit && entry.length_mm.is_none() => Some(Unit::Mm),
            unit => unit,
        };
        self.entries.push(Entry {
            unit,
            path: Some(path.to_string()),
            label_path: Some(file.label.clone()),
            class: Some(class.clone()),
            class_from: None,
            parts: Parts::default(),
            part: facts.name.clone(),
            packages: facts.packages.clone(),
            on_bad: OnBad::default(),
            sha256: Some(facts.sha256.clone()),
            ..entry.clone()
        });
        self.objects.push(PreparedObject {
            id: naming::object_name(&path, facts.name.as_deref()),
            class,
            path: file.label.clone(),
            part: facts.name.clone(),
            sha256: facts.sha256.clone(),
            // An invalid weight was reported; the object still counts.
            weight: if (0.0..).contains(&entry.weight) { entry.weight } else { 1.0 },
            richest_side: facts.richest_side,
            scale: entry.size_factor(facts.size.largest_extent_mm()),
            table_index: i,
            split: entry.split,
            geometry: geometry.clone(),
            textures: self.textures[i].clone(),
        });
    }

    /// Returns the tables of the objects, and the objects under unique names.
    fn finish(mut self) -> (Vec<Entry>, FoundObjects) {
        if let Some((i, error)) = self.left_out.filter(|_| self.objects.is_empty() && self.unread == 0) {
            let message = format!("all meshes are left out, the first because of {error}");
            let help = "name a mesh that can be read: gelsim inspect tells them apart";
            self.check.report_error(&format!("object.{i}.path"), message, help);
        }
        let names = self.objects.iter().map(|object| object.id.clone()).collect();
        for (object, id) in self.objects.iter_mut().zip(make_unique_ids(names)) {
            object.id = id;
        }
        (self.entries, FoundObjects { objects: self.objects, unread: self.unread })
    }
}

/// Returns a name of a file, with that of the part behind it if there is one.
fn name_part(file: &str, part: &MeshFacts) -> String {
    part.name.as_ref().map_or(file.to_owned(), |name| format!("{file}/{name}"))
}

/// Describes which sides `face = "auto"` presses: those of the first few objects, and the number of the others.
pub fn pressed_sides(objects: &[PreparedObject]) -> Option<String> {
    const MAX_NAMED: usize = 8;
    let sides = objects.iter().filter_map(|object| Some((object, Face::from_side(object.richest_side?).name())));
    let sides: Vec<String> = sides.map(|(object, side)| format!("{side} of {}", object.id)).collect();
    let more = match sides.len().saturating_sub(MAX_NAMED) {
        0 => String::new(),
        more => format!(", and of {more} more theirs"),
    };
    let named = sides[..sides.len().min(MAX_NAMED)].join(", ");
    (!sides.is_empty()).then(|| format!("face = \"auto\" presses the sides with the most relief: {named}{more}"))
}

/// Checks that an `[[object]]` with height maps says how large they are, and that one without any does not.
fn check_height_maps(check: &mut JobChecker<'_>, i: usize, entry: &Entry, found: &[PathBuf]) {
    let path = |key: &str| format!("object.{i}.{key}");
    let numbers = [("mm_per_px", entry.mm_per_px, "0.02"), ("height_mm", entry.height_mm, "0.5")];
    let Some(map) = found.iter().find(|path| mesh::is_height_map(path)) else {
        // What is neither a mesh nor a height map is refused for that.
        let is_mesh = found.iter().any(|path| mesh::Format::from_path(path).is_some());
        for (key, ..) in numbers.iter().filter(|(_, value, _)| value.is_some() && is_mesh) {
            let message = format!("{key} is for height maps (.png, .npy, .npz, .exr), and `path` names none");
            check.report_error(&path(key), message, "leave it out; `unit` and `scale` say how large a mesh is");
        }
        return;
    };
    if numbers.iter().all(|(_, value, _)| value.is_none()) {
        let help = format!("how large is {}? For example mm_per_px = 0.02 and height_mm = 0.5", map.display());
        check.report_missing(&path("mm_per_px"), &help);
    }
    for (key, value, example) in numbers {
        match value {
            // The missing keys were reported together.
            None if entry.mm_per_px.is_none() && entry.height_mm.is_none() => {}
            Some(value) => check.require_in_range(&path(key), value, 1e-4..=100.0, "mm"),
            None => check
                .report_missing(&path(key), &format!("how large is {}? For example {key} = {example}", map.display())),
        }
    }
    if entry.unit.is_some() {
        check.report_error(
            &path("unit"),
            "a height map has no unit",
            "leave it out: mm_per_px and height_mm say how large it is",
        );
    }
}

/// Checks `length_mm`, and refuses the keys that it replaces.
fn check_lengths(check: &mut JobChecker<'_>, i: usize, entry: &Entry) {
    let Some(length_mm) = &entry.length_mm else { return };
    let path = |key: &str| format!("object.{i}.{key}");
    check.require_quantity_in_range(&path("length_mm"), length_mm, 1e-3..=1e4, "mm");
    let others = [
        ("unit", entry.unit.is_some()),
        ("scale", entry.scale != Quantity::Constant(1.0)),
        ("mm_per_px", entry.mm_per_px.is_some()),
    ];
    for (key, _) in others.iter().filter(|(_, given)| *given) {
        let message = format!("`length_mm` and `{key}` both say how large the object is");
        check.report_error(&path(key), message, "keep one of the two");
    }
}

/// Refuses a scale for plans without samples, in which the poses of objects are known for the meshes as they are.
pub fn refuse_scaling(check: &mut JobChecker<'_>, job: &Job) {
    for (i, entry) in job.object.iter().enumerate() {
        if entry.length_mm.is_some() {
            let help = "leave it out, and write the mesh's `unit`: only samples of a job are scaled";
            check.report_error(&format!("object.{i}.length_mm"), "the objects' places are known as they are", help);
        }
        if entry.scale != Quantity::Constant(1.0) {
            let help = "leave it out: only samples of a job are scaled";
            check.report_error(&format!("object.{i}.scale"), "the objects' places are known as they are", help);
        }
    }
}

/// Makes unique names of objects from the stems of their files, with a number if several share one.
pub fn make_unique_ids(stems: Vec<String>) -> Vec<String> {
    // The names in use, and the last number that was given for each stem.
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

/// Divides the objects between the splits. Returns `None` after an error.
pub fn divide_objects(check: &mut JobChecker<'_>, job: &Job, found: &FoundObjects) -> Option<[ObjectSampler; 3]> {
    let FoundObjects { objects, unread } = found;
    if *unread == 0 && objects.iter().all(|object| object.weight <= 0.0) {
        return None;
    }
    let splits = job.dataset.splits;
    let shares = splits.shares();
    let drawn: Vec<usize> = (0..objects.len()).filter(|&i| objects[i].weight > 0.0).collect();
    let groups = match job.dataset.split_by {
        SplitBy::Sample => [drawn.clone(), drawn.clone(), drawn],
        SplitBy::Object => {
            // Files with the same content are one object, since a copy in another split would not be unseen.
            let mut known = HashSet::new();
            let content = |i: usize| (objects[i].sha256.as_str(), objects[i].part.as_deref());
            let contents: Vec<_> = drawn.iter().map(|&i| content(i)).filter(|content| known.insert(*content)).collect();
            // If the split of one object is given, it holds for all files with its content.
            let mut said: HashMap<_, Split> = HashMap::new();
            for &i in drawn.iter().filter(|&&i| objects[i].split.is_some()) {
                let split = objects[i].split.expect("filtered");
                let before = *said.entry(content(i)).or_insert(split);
                if before != split {
                    let message =
                        format!("{} is in the split `{}` already, as the same file", objects[i].path, before.name());
                    check.report_error(
                        &format!("object.{}.split", objects[i].table_index),
                        message,
                        "an object is in one split: keep one of them",
                    );
                }
            }
            let free: Vec<_> = contents.iter().copied().filter(|content| !said.contains_key(content)).collect();
            let fixed: [usize; 3] = std::array::from_fn(|k| said.values().filter(|split| split.number() == k).count());
            let needed = (0..3).filter(|&k| shares[k] > 0.0 && fixed[k] == 0).count();
            let is_reported = said.values().any(|split| shares[split.number()] <= 0.0);
            if needed > free.len() + unread && !is_reported {
                let count = free.len() + unread;
                let message = match said.is_empty() {
                    true => format!("{needed} splits but {count} different object(s)"),
                    false => format!("{needed} split(s) without an object, and {count} object(s) without a `split`"),
                };
                let help = "with split_by = \"object\" each split needs an object of its own: add objects, or use split_by = \"sample\"";
                check.report_error("dataset.split_by", message, help);
            }
            if needed > free.len() {
                return None;
            }
            let order = shuffle_indices(free.len(), job.dataset.seed);
            let counts = apportion_counts(free.len(), shares, fixed);
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
        ObjectOrder::InTurn => ObjectSampler::InTurn(groups[split].clone()),
        ObjectOrder::Weighted => ObjectSampler::Weighted(WeightedSampler::new(split, groups[split].iter().map(of))),
    }))
}

/// Returns the numbers 0 .. `count` in a random order drawn from the seed (Fisher and Yates).
fn shuffle_indices(count: usize, seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    let mut random = random_stream(seed, "splits", 0);
    for last in (1..count).rev() {
        order.swap(last, random.uniform_below(last + 1));
    }
    order
}

/// Divides `count` objects between the splits, beside those whose split is fixed. All together are as nearly in
/// proportion to the shares as possible, and a split with a share above 0 has at least one (there are enough).
fn apportion_counts(count: usize, shares: [f64; 3], fixed: [usize; 3]) -> [usize; 3] {
    let all = count + fixed.iter().sum::<usize>();
    // Each split with a share begins with one object.
    let mut given: [usize; 3] = std::array::from_fn(|k| fixed[k].max(usize::from(shares[k] > 0.0)));
    while given.iter().sum::<usize>() < all {
        // Give the next one to the split that is furthest behind its share.
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
        assert_eq!(apportion_counts(10, [0.8, 0.1, 0.1], [0; 3]), [8, 1, 1]);
        assert_eq!(apportion_counts(3, [0.98, 0.01, 0.01], [0; 3]), [1, 1, 1]);
        assert_eq!(apportion_counts(5, [1.0, 0.0, 0.0], [0; 3]), [5, 0, 0]);
        assert_eq!(apportion_counts(20, [0.5, 0.25, 0.25], [0; 3]), [10, 5, 5]);
        // Beside those that are said.
        assert_eq!(apportion_counts(9, [0.8, 0.1, 0.1], [0, 0, 1]), [8, 1, 0]);
        assert_eq!(apportion_counts(6, [0.5, 0.25, 0.25], [0, 0, 4]), [4, 2, 0]);
        assert_eq!(apportion_counts(0, [0.5, 0.0, 0.5], [2, 0, 1]), [0, 0, 0]);
    }
}
