//! Labels as COCO detections: one JSON with `images`, `annotations` and `categories`. Boxes, outlines and key points are passed
//! through: what is made of an image shows the same press at the same place.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Map, Value};

use super::columns::{LabelFacts, SourceLabel};
use super::names::is_split;
use super::table::{MOST_BYTES, columns, image_column};
use super::{Draft, Real, images};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::source::Source;
use gelsim_job::plan::check::Check;

/// JSON files of which each is looked into; of more only those that are named like annotations.
const MOST_FILES: usize = 64;

/// Of one unit: everything but the images.
#[derive(Clone, Debug, Default)]
pub struct Annotations {
    /// All other keys of the file, such as categories.
    pub rest: Map<String, Value>,
    /// Those of each image, in the order of the unit's real samples.
    of_reals: Vec<Vec<Map<String, Value>>>,
    /// How many stand before those of each image.
    before: Vec<u64>,
    /// Largest id of an image and of an annotation; none where ids are no whole numbers.
    largest: [Option<u64>; 2],
    /// How many there are.
    count: u64,
}

impl Annotations {
    /// The annotations of a unit's real sample.
    pub fn of_real(&self, number: usize) -> &[Map<String, Value>] {
        self.of_reals.get(number).map_or(&[], Vec::as_slice)
    }

    /// The id of an image that is made of real sample `number` as its `slot`th, and that image's annotations: no id is there
    /// twice. `tag` tells images apart where ids are text.
    pub fn of_made(&self, number: usize, id: &Value, slot: u64, tag: &str) -> (Value, Vec<Map<String, Value>>) {
        let new = |largest: Option<u64>, count: u64, at: u64, old: &Value| {
            let fresh =
                largest.and_then(|id| id.checked_add(1)?.checked_add(slot.checked_mul(count)?)?.checked_add(at));
            match (fresh, old) {
                (Some(fresh), _) => Value::from(fresh),
                (None, Value::String(old)) => Value::from(format!("{old}{tag}")),
                (None, old) => Value::from(format!("{old}{tag}")),
            }
        };
        let image = new(self.largest[0], self.of_reals.len() as u64, number as u64, id);
        let before = self.before.get(number).copied().unwrap_or(0);
        let own = self.of_real(number).iter().enumerate().map(|(k, annotation)| {
            let mut annotation = annotation.clone();
            if let Some(id) = annotation.get_mut("id") {
                *id = new(self.largest[1], self.count, before + k as u64, id);
            }
            annotation.insert(String::from("image_id"), image.clone());
            annotation
        });
        let own = own.collect();
        (image, own)
    }
}

/// Those of the JSON files that hold COCO detections.
pub fn files(root: &Path, jsons: Vec<PathBuf>) -> Vec<PathBuf> {
    /// Only that these lists are there is of interest.
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
    let few = jsons.len() <= MOST_FILES;
    let is_coco = |file: &PathBuf| {
        (few || named_so(file))
            && input::read(&root.join(file), MOST_BYTES)
                .is_ok_and(|bytes| serde_json::from_slice::<Lists>(&bytes).is_ok())
    };
    jsons.into_par_iter().filter(is_coco).collect()
}

/// Reads the file that is unit `unit` of a draft. `None` if nothing more can be said after a mistake.
pub(super) fn read(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let shown = path.display().to_string();
    let mut whole = match whole(&path) {
        Ok(whole) => whole,
        Err((message, help)) => {
            draft.found.push(Diagnostic::new(format!("{shown}: {message}")).help(help));
            return None;
        }
    };
    let mut list = |name: &str| whole.shift_remove(name).and_then(objects);
    let (Some(entries), Some(mut annotations)) = (list("images"), list("annotations")) else {
        let help = "COCO annotations are one JSON object with the lists `images`, `annotations` and `categories`; a list of \
                    records is read as JSON Lines: write each on a line of its own, in a file that ends in .jsonl";
        draft.found.push(Diagnostic::new(format!("{shown} holds no COCO annotations")).help(help));
        return None;
    };
    let categories = categories(&whole);
    let mut of_image: HashMap<String, Vec<usize>> = HashMap::new();
    for (number, annotation) in annotations.iter().enumerate() {
        let id = annotation.get("image_id").map(Value::to_string).unwrap_or_default();
        of_image.entry(id).or_default().push(number);
    }
    let mut kept = Annotations {
        largest: [largest(&entries), largest(&annotations)],
        count: annotations.len() as u64,
        rest: whole,
        ..Annotations::default()
    };
    let mut text = String::new();
    let (mut ids, mut before) = (BTreeSet::new(), 0);
    let first = draft.reals.len();
    for entry in entries {
        let label = SourceLabel::Json(&entry);
        let image = image_column(check, draft, unit, &label)?;
        let columns = columns(check, draft, &label);
        let written = label.text(&image).unwrap_or_default();
        let id = entry.get("id").map(Value::to_string).unwrap_or_default();
        let wrong = |message: String, cause: &str, help: &str| {
            Diagnostic::new(format!("{shown}: {message}")).of(written.clone(), format!("{cause} in {shown}")).help(help)
        };
        if id.is_empty() || !ids.insert(id.clone()) {
            let problem = wrong(
                format!("the image {written} has no id of its own"),
                "images have no id of their own",
                "give each image another id: annotations name their image by it",
            );
            draft.found.push(problem);
            continue;
        }
        if first == draft.reals.len() {
            draft.units[unit].images = folder(check, draft, unit, &written)?;
        }
        let folder = draft.units[unit].images.clone();
        let name = images::with_slashes(&draft.root.join(&folder), &written);
        let Some(path) = images::inside(&folder, &name).filter(|_| !written.is_empty()) else {
            let problem = wrong(
                format!("the image {written:?} is not in the folder"),
                "images are not in the folder",
                "write names from the folder of the images, and name that with input.images",
            );
            draft.found.push(problem);
            continue;
        };
        if !draft.paths.insert(path.clone()) {
            let problem = wrong(
                format!("the image {written} is there twice, or in two files"),
                "images are there twice, or in two files,",
                "name the file with the labels that you want: labels = \"annotations/instances_train.json\" under [input]",
            );
            draft.found.push(problem);
            continue;
        }
        let mut mistakes = Vec::new();
        let (mut facts, split) = LabelFacts::read(&columns, &label, |mistake| mistakes.push(mistake));
        for mistake in mistakes {
            draft.found.push(mistake.of_sample(&written, "null"));
        }
        let own = of_image.remove(&id).unwrap_or_default();
        let own: Vec<Map<String, Value>> = own.into_iter().map(|k| std::mem::take(&mut annotations[k])).collect();
        if facts.class.is_none() {
            facts.class = only_category(&own, &categories);
        }
        kept.before.push(before);
        before += own.len() as u64;
        kept.of_reals.push(own);
        let start = text.len();
        text += &Value::Object(entry.clone()).to_string();
        let range = start..text.len();
        text.push('\n');
        if draft.example.is_empty() {
            draft.example = entry;
        }
        draft.reals.push(Real {
            key: written.clone(),
            unit,
            has_backslashes: name != written,
            image: name,
            path,
            text: range,
            split: 0,
            facts,
        });
        draft.named.push(split);
    }
    note_strays(draft, &shown, &of_image, &annotations);
    measure(draft, first, &text, &shown);
    draft.sources.push(Source { name: shown, text, folder: draft.root.to_owned() });
    draft.coco.push(kept);
    Some(())
}

/// The object in a file; else what is wrong with it and what to do.
fn whole(path: &Path) -> Result<Map<String, Value>, (String, String)> {
    let bytes = input::read(path, MOST_BYTES).map_err(|error| (error.to_string(), String::from("make it readable")))?;
    let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&bytes);
    match serde_json::from_slice(bytes) {
        Ok(Value::Object(whole)) => Ok(whole),
        Ok(_) => Ok(Map::new()),
        Err(error) => {
            Err((format!("no JSON: {error}"), String::from("mend it there, or export the annotations again")))
        }
    }
}

/// The elements of a list, if all are objects.
fn objects(value: Value) -> Option<Vec<Map<String, Value>>> {
    let Value::Array(items) = value else { return None };
    let object = |item| if let Value::Object(object) = item { Some(object) } else { None };
    items.into_iter().map(object).collect()
}

/// Names of categories by the JSON of their ids.
fn categories(whole: &Map<String, Value>) -> HashMap<String, String> {
    let categories = whole.get("categories").and_then(Value::as_array).into_iter().flatten();
    let named = |category: &Value| Some((category.get("id")?.to_string(), category.get("name")?.as_str()?.to_owned()));
    categories.filter_map(named).collect()
}

/// The category of all annotations of an image; `None` if there are several, or none.
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

/// The largest id; `None` if one is no whole number.
fn largest(all: &[Map<String, Value>]) -> Option<u64> {
    let id = |object: &Map<String, Value>| object.get("id").map_or(Some(0), Value::as_u64);
    all.iter().map(id).try_fold(0, |largest, id| Some(largest.max(id?)))
}

/// The folder, from the set's, that the images' names start from: where the first one is.
fn folder(check: &mut Check<'_>, draft: &Draft<'_>, unit: usize, first: &str) -> Option<PathBuf> {
    let base = images::folder(check, draft, unit)?;
    let there = &draft.units[unit];
    let stem = there.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    // Of `instances_train2017` the images are in `train2017` or in `train`.
    let last = stem.rsplit('_').next().unwrap_or_default().to_owned();
    let word = there.split.clone().unwrap_or_default();
    let parts = [String::new(), last, word, String::from("images"), String::from("data")];
    let bases = match draft.written.images {
        Some(_) => vec![base.clone()],
        None => vec![base.clone(), PathBuf::new(), PathBuf::from("images")],
    };
    let candidates = bases
        .iter()
        .flat_map(|base| parts.iter().filter(|part| part.is_empty() || is_name(part)).map(move |part| base.join(part)));
    let holds = |folder: &PathBuf| {
        let name = images::with_slashes(&draft.root.join(folder), first);
        images::inside(folder, &name).is_some_and(|path| draft.root.join(path).is_file())
    };
    Some(candidates.into_iter().find(holds).unwrap_or(base))
}

/// True of the name of a folder that images of a split may be in.
fn is_name(part: &str) -> bool {
    let word = part.trim_end_matches(|c: char| c.is_ascii_digit());
    ["images", "data"].contains(&word) || is_split(word)
}

/// Notes annotations whose image is not there: they are in no output.
fn note_strays(
    draft: &mut Draft<'_>,
    shown: &str,
    of_image: &HashMap<String, Vec<usize>>,
    annotations: &[Map<String, Value>],
) {
    let mut strays: Vec<usize> = of_image.values().flatten().copied().collect();
    strays.sort_unstable();
    // What is wrong with their images has been said.
    for number in strays.into_iter().filter(|_| draft.found.is_empty()) {
        let id = annotations[number].get("id").map_or(String::from("one without an id"), Value::to_string);
        let note = Diagnostic::warning(format!("the annotation {id} of {shown} is of no image, and is left out"));
        let note = note.of(id, format!("annotations of {shown} are of no image, and are left out"));
        draft.notes.push(note.help("add their images to `images`, or remove them"));
    }
}

/// How large the images are, and whether their annotations are in these pixels.
fn measure(draft: &mut Draft<'_>, first: usize, text: &str, shown: &str) {
    let root = draft.root;
    let reals = &draft.reals[first..];
    let sizes: Vec<_> = reals.par_iter().map(|real| image_file::size_of_file(&root.join(&real.path))).collect();
    for (real, size) in reals.iter().zip(&sizes) {
        let entry: Map<String, Value> = serde_json::from_str(&text[real.text.clone()]).unwrap_or_default();
        let told = ["width", "height"].map(|side| entry.get(side).and_then(Value::as_u64));
        if let ([Some(width), Some(height)], Ok([w, h])) = (told, size)
            && [width as usize, height as usize] != [*w, *h]
        {
            let message =
                format!("{shown}: {} is {w}x{h} px, and its annotations are for {width}x{height} px", real.key);
            let cause = format!("images have other sizes than their annotations in {shown} are for");
            let help = "put the images there that were annotated, or mend width and height if the boxes are right";
            draft.found.push(Diagnostic::new(message).of(&real.key, cause).help(help));
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
        let annotations = Annotations {
            of_reals: vec![vec![box_of(7, 10), box_of(8, 10)], vec![box_of(9, 12)]],
            before: vec![0, 2],
            largest: [Some(12), Some(9)],
            count: 3,
            ..Annotations::default()
        };
        let mut ids = BTreeSet::new();
        for (number, id) in [(0, 10), (1, 12)] {
            for slot in 0..3 {
                let (image, own) = annotations.of_made(number, &json!(id), slot, "-x");
                assert!(image.as_u64().expect("a number") > 12);
                for annotation in own {
                    assert_eq!((&annotation["image_id"], &annotation["bbox"]), (&image, &json!([1.5, 2, 3, 4])));
                    assert!(ids.insert(annotation["id"].as_u64().expect("a number")));
                }
            }
        }
        assert_eq!((ids.len(), ids.first().copied(), ids.last().copied()), (9, Some(10), Some(18)));
        let text = Annotations { largest: [None, None], ..annotations };
        let (image, own) = text.of_made(1, &json!("a"), 0, "-photometric-0-0");
        assert_eq!((image, &own[0]["id"]), (json!("a-photometric-0-0"), &json!("9-photometric-0-0")));
    }
}
