//! Labels as COCO detections: one JSON with `images`, `annotations` and `categories`. Boxes, outlines and key points
//! are passed through, because every derived image shows the same press at the same place.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Map, Value};

use super::columns::{LabelFacts, SourceLabel};
use super::names::is_split;
use super::table::{MAX_BYTES, find_image_column, resolve_columns};
use super::{DatasetDraft, RealSample, images, json};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::source::SourceText;
use gelsim_job::plan::check::JobChecker;

/// Number of JSON files up to which each is examined; of more, only those named like annotations.
const MAX_FILES: usize = 64;

/// Annotations of one unit: everything in its file but the images.
#[derive(Clone, Debug, Default)]
pub struct CocoAnnotations {
    /// All other keys of the file, such as categories.
    pub other_keys: Map<String, Value>,
    /// Annotations of each image, in the order of the unit's real samples.
    by_image: Vec<Vec<Map<String, Value>>>,
    /// Number of annotations before those of each image.
    annotations_before: Vec<u64>,
    /// Largest id of an image and of an annotation; none if ids are not integers.
    largest_ids: [Option<u64>; 2],
    /// Number of annotations.
    count: u64,
}

impl CocoAnnotations {
    /// Returns the annotations of a unit's real sample.
    pub fn of_real(&self, number: usize) -> &[Map<String, Value>] {
        self.by_image.get(number).map_or(&[], Vec::as_slice)
    }

    /// Returns the id and annotations of the image derived from real sample `number` as its `slot`th. All ids are new
    /// and unique. `tag` is appended where ids are text.
    pub fn of_derived(&self, number: usize, id: &Value, slot: u64, tag: &str) -> (Value, Vec<Map<String, Value>>) {
        // Each slot has a range of ids of its own behind the largest one, so ids do not depend on the order of work.
        let new = |largest: Option<u64>, count: u64, at: u64, old: &Value| {
            let fresh =
                largest.and_then(|id| id.checked_add(1)?.checked_add(slot.checked_mul(count)?)?.checked_add(at));
            match (fresh, old) {
                (Some(fresh), _) => Value::from(fresh),
                (None, Value::String(old)) => Value::from(format!("{old}{tag}")),
                (None, old) => Value::from(format!("{old}{tag}")),
            }
        };
        let image = new(self.largest_ids[0], self.by_image.len() as u64, number as u64, id);
        let before = self.annotations_before.get(number).copied().unwrap_or(0);
        let own = self.of_real(number).iter().enumerate().map(|(k, annotation)| {
            let mut annotation = annotation.clone();
            if let Some(id) = annotation.get_mut("id") {
                *id = new(self.largest_ids[1], self.count, before + k as u64, id);
            }
            annotation.insert(String::from("image_id"), image.clone());
            annotation
        });
        let own = own.collect();
        (image, own)
    }
}

/// Returns those of the JSON files that hold COCO detections.
pub fn find_annotation_files(root: &Path, jsons: Vec<PathBuf>) -> Vec<PathBuf> {
    /// Shape of a COCO file; the contents of its lists do not matter.
    #[derive(Deserialize)]
    struct Lists {
        #[serde(rename = "images")]
        _images: Vec<IgnoredAny>,
        #[serde(rename = "annotations")]
        _annotations: Vec<IgnoredAny>,
    }
    let named_so = |file: &Path| {
        let name = file.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        ["coco", "annotation", "instances"].iter().any(|word| name.contains(word))
    };
    let few = jsons.len() <= MAX_FILES;
    // With a number that JSON does not have, what the lists hold is not known, so the name decides.
    let holds_lists = |file: &Path, bytes: &[u8]| match serde_json::from_slice::<Lists>(bytes) {
        Ok(_) => true,
        Err(error) => named_so(file) && json::find_non_number(bytes, &error).is_some(),
    };
    let is_coco = |file: &PathBuf| {
        (few || named_so(file)) && input::read(&root.join(file), MAX_BYTES).is_ok_and(|bytes| holds_lists(file, &bytes))
    };
    jsons.into_par_iter().filter(is_coco).collect()
}

/// Reads the file of unit `unit` of a draft. `None` after a mistake that leaves nothing more to check.
pub(super) fn read(check: &mut JobChecker<'_>, draft: &mut DatasetDraft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let shown = path.display().to_string();
    let mut object = match read_json_object(&path) {
        Ok(object) => object,
        Err((message, help)) => {
            draft.problems.push(Diagnostic::new(format!("{shown}: {message}")).help(help));
            return None;
        }
    };
    let mut list = |name: &str| object.shift_remove(name).and_then(into_objects);
    let (Some(entries), Some(mut annotations)) = (list("images"), list("annotations")) else {
        let help = "COCO annotations are one JSON object with the lists `images`, `annotations` and `categories`; a list of \
                    records is read as JSON Lines: write each on a line of its own, in a file that ends in .jsonl";
        draft.problems.push(Diagnostic::new(format!("{shown} holds no COCO annotations")).help(help));
        return None;
    };
    let categories = category_names(&object);
    let mut of_image: HashMap<String, Vec<usize>> = HashMap::new();
    for (number, annotation) in annotations.iter().enumerate() {
        let id = annotation.get("image_id").map(Value::to_string).unwrap_or_default();
        of_image.entry(id).or_default().push(number);
    }
    let mut kept = CocoAnnotations {
        largest_ids: [largest_id(&entries), largest_id(&annotations)],
        count: annotations.len() as u64,
        other_keys: object,
        ..CocoAnnotations::default()
    };
    let mut text = String::new();
    let (mut ids, mut before) = (BTreeSet::new(), 0);
    let first = draft.reals.len();
    for entry in entries {
        let label = SourceLabel::Json(&entry);
        let image = find_image_column(check, draft, unit, &label)?;
        let columns = resolve_columns(check, draft, &label);
        let written = label.text(&image).unwrap_or_default();
        let id = entry.get("id").map(Value::to_string).unwrap_or_default();
        let wrong = |message: String, cause: &str, help: &str| {
            Diagnostic::new(format!("{shown}: {message}"))
                .about(written.clone(), format!("{cause} in {shown}"))
                .help(help)
        };
        if id.is_empty() || !ids.insert(id.clone()) {
            let problem = wrong(
                format!("the image {written} has no id of its own"),
                "images have no id of their own",
                "give each image another id: annotations name their image by it",
            );
            draft.problems.push(problem);
            continue;
        }
        if first == draft.reals.len() {
            draft.units[unit].images = find_image_folder(check, draft, unit, &written)?;
        }
        let folder = draft.units[unit].images.clone();
        let name = images::with_slashes(&draft.root.join(&folder), &written);
        let Some(path) = images::path_inside(&folder, &name).filter(|_| !written.is_empty()) else {
            let problem = wrong(
                format!("the image {written:?} is not in the folder"),
                "images are not in the folder",
                "write names from the folder of the images, and name that with input.images",
            );
            draft.problems.push(problem);
            continue;
        };
        if !draft.paths.insert(path.clone()) {
            let problem = wrong(
                format!("the image {written} is there twice, or in two files"),
                "images are there twice, or in two files,",
                "name the file with the labels that you want: labels = \"annotations/instances_train.json\" under [input]",
            );
            draft.problems.push(problem);
            continue;
        }
        let mut mistakes = Vec::new();
        let (mut facts, split) = LabelFacts::read(&columns, &label, |mistake| mistakes.push(mistake));
        for mistake in mistakes {
            draft.problems.push(mistake.into_diagnostic(&written, "null"));
        }
        let own = of_image.remove(&id).unwrap_or_default();
        let own: Vec<Map<String, Value>> = own.into_iter().map(|k| std::mem::take(&mut annotations[k])).collect();
        if facts.class.is_none() {
            facts.class = only_category(&own, &categories);
        }
        kept.annotations_before.push(before);
        before += own.len() as u64;
        kept.by_image.push(own);
        let start = text.len();
        text += &Value::Object(entry.clone()).to_string();
        let range = start..text.len();
        text.push('\n');
        if draft.example.is_empty() {
            draft.example = entry;
        }
        draft.reals.push(RealSample {
            key: written.clone(),
            unit,
            has_backslashes: name != written,
            image: name,
            path,
            text: range,
            split: 0,
            facts,
        });
        draft.label_splits.push(split);
    }
    note_strays(draft, &shown, &of_image, &annotations);
    measure_annotated_images(draft, first, &text, &shown);
    draft.sources.push(SourceText { name: shown, text, folder: draft.root.to_owned() });
    draft.annotations.push(kept);
    Some(())
}

/// Reads the object in a file. An error says what is wrong and what to do.
fn read_json_object(path: &Path) -> Result<Map<String, Value>, (String, String)> {
    let bytes = input::read(path, MAX_BYTES).map_err(|error| (error.to_string(), String::from("make it readable")))?;
    let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&bytes);
    match serde_json::from_slice(bytes) {
        Ok(Value::Object(object)) => Ok(object),
        Ok(_) => Ok(Map::new()),
        Err(error) => Err(match json::find_non_number(bytes, &error) {
            Some(number) => (
                format!("{} (line {}, column {})", json::non_number_message(number), error.line(), error.column()),
                String::from(json::NON_NUMBER_HELP),
            ),
            None => (format!("no JSON: {error}"), String::from("fix it there, or export the annotations again")),
        }),
    }
}

/// Returns the elements of a list if all are objects.
fn into_objects(value: Value) -> Option<Vec<Map<String, Value>>> {
    let Value::Array(items) = value else { return None };
    let object = |item| if let Value::Object(object) = item { Some(object) } else { None };
    items.into_iter().map(object).collect()
}

/// Returns the names of categories by the JSON of their ids.
fn category_names(object: &Map<String, Value>) -> HashMap<String, String> {
    let categories = object.get("categories").and_then(Value::as_array).into_iter().flatten();
    let named = |category: &Value| Some((category.get("id")?.to_string(), category.get("name")?.as_str()?.to_owned()));
    categories.filter_map(named).collect()
}

/// Returns the category of all annotations of an image; `None` if there are several, or none.
fn only_category(own: &[Map<String, Value>], categories: &HashMap<String, String>) -> Option<String> {
    let mut ids: Vec<String> =
        own.iter().filter_map(|annotation| Some(annotation.get("category_id")?.to_string())).collect();
    ids.sort();
    ids.dedup();
    match ids.as_slice() {
        [only] => categories.get(only).cloned(),
        _ => None,
    }
}

/// Returns the largest id; `None` if one is not an integer.
fn largest_id(all: &[Map<String, Value>]) -> Option<u64> {
    let id = |object: &Map<String, Value>| object.get("id").map_or(Some(0), Value::as_u64);
    all.iter().map(id).try_fold(0, |largest, id| Some(largest.max(id?)))
}

/// Finds the folder, relative to the set's, from which the images' names start: where the first image is.
fn find_image_folder(
    check: &mut JobChecker<'_>,
    draft: &DatasetDraft<'_>,
    unit: usize,
    first: &str,
) -> Option<PathBuf> {
    let base = images::find_image_folder(check, draft, unit)?;
    let input_unit = &draft.units[unit];
    let stem = input_unit.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    // The images of `instances_train2017` are usually in `train2017` or in `train`.
    let last = stem.rsplit('_').next().unwrap_or_default().to_owned();
    let word = input_unit.split.clone().unwrap_or_default();
    let parts = [String::new(), last, word, String::from("images"), String::from("data")];
    let bases = match draft.written.images {
        Some(_) => vec![base.clone()],
        None => vec![base.clone(), PathBuf::new(), PathBuf::from("images")],
    };
    let candidates = bases.iter().flat_map(|base| {
        parts.iter().filter(|part| part.is_empty() || is_folder_name(part)).map(move |part| base.join(part))
    });
    let holds = |folder: &PathBuf| {
        let name = images::with_slashes(&draft.root.join(folder), first);
        images::path_inside(folder, &name).is_some_and(|path| draft.root.join(path).is_file())
    };
    Some(candidates.into_iter().find(holds).unwrap_or(base))
}

/// Returns true for the name of a folder that may hold the images of a split.
fn is_folder_name(part: &str) -> bool {
    let word = part.trim_end_matches(|c: char| c.is_ascii_digit());
    ["images", "data"].contains(&word) || is_split(word)
}

/// Notes annotations of images that are not listed: they are in no output.
fn note_strays(
    draft: &mut DatasetDraft<'_>,
    shown: &str,
    of_image: &HashMap<String, Vec<usize>>,
    annotations: &[Map<String, Value>],
) {
    let mut strays: Vec<usize> = of_image.values().flatten().copied().collect();
    strays.sort_unstable();
    // If there are mistakes, these images may be among them, so nothing is said of their annotations.
    for number in strays.into_iter().filter(|_| draft.problems.is_empty()) {
        let id = annotations[number].get("id").map_or(String::from("one without an id"), Value::to_string);
        let note = Diagnostic::warning(format!("the annotation {id} of {shown} is of no image, and is left out"));
        let note = note.about(id, format!("annotations of {shown} are of no image, and are left out"));
        draft.notes.push(note.help("add their images to `images`, or remove them"));
    }
}

/// Measures the images, and checks that their annotations are for images of that size.
fn measure_annotated_images(draft: &mut DatasetDraft<'_>, first: usize, text: &str, shown: &str) {
    let root = draft.root;
    let reals = &draft.reals[first..];
    let sizes: Vec<_> = reals.par_iter().map(|real| image_file::read_size_of_file(&root.join(&real.path))).collect();
    for (real, size) in reals.iter().zip(&sizes) {
        let entry: Map<String, Value> = serde_json::from_str(&text[real.text.clone()]).unwrap_or_default();
        let told = ["width", "height"].map(|side| entry.get(side).and_then(Value::as_u64));
        if let ([Some(width), Some(height)], Ok([w, h])) = (told, size)
            && [width as usize, height as usize] != [*w, *h]
        {
            let message =
                format!("{shown}: {} is {w}x{h} px, and its annotations are for {width}x{height} px", real.key);
            let cause = format!("images have other sizes than their annotations in {shown} are for");
            let help = "put the images there that were annotated, or fix width and height if the boxes are right";
            draft.problems.push(Diagnostic::new(message).about(&real.key, cause).help(help));
        }
    }
    draft.sizes.extend(sizes);
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn object(value: Value) -> Map<String, Value> {
        value.as_object().expect("an object").clone()
    }

    #[test]
    fn what_is_made_has_ids_of_its_own_and_the_boxes_of_its_image() {
        let box_of = |id: u64, image: u64| object(json!({ "id": id, "image_id": image, "bbox": [1.5, 2, 3, 4] }));
        let annotations = CocoAnnotations {
            by_image: vec![vec![box_of(7, 10), box_of(8, 10)], vec![box_of(9, 12)]],
            annotations_before: vec![0, 2],
            largest_ids: [Some(12), Some(9)],
            count: 3,
            ..CocoAnnotations::default()
        };
        let mut ids = BTreeSet::new();
        for (number, id) in [(0, 10), (1, 12)] {
            for slot in 0..3 {
                let (image, own) = annotations.of_derived(number, &json!(id), slot, "-x");
                assert!(image.as_u64().expect("a number") > 12);
                for annotation in own {
                    assert_eq!((&annotation["image_id"], &annotation["bbox"]), (&image, &json!([1.5, 2, 3, 4])));
                    assert!(ids.insert(annotation["id"].as_u64().expect("a number")));
                }
            }
        }
        assert_eq!((ids.len(), ids.first().copied(), ids.last().copied()), (9, Some(10), Some(18)));
        let text = CocoAnnotations { largest_ids: [None, None], ..annotations };
        let (image, own) = text.of_derived(1, &json!("a"), 0, "-photometric-0-0");
        assert_eq!((image, &own[0]["id"]), (json!("a-photometric-0-0"), &json!("9-photometric-0-0")));
    }
}
