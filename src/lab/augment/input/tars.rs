//! Labels in WebDataset tars: files that follow each other under one key are a sample, one of them its image, one its
//! label.

use std::cell::RefCell;
use std::collections::HashSet;
use std::ops::ControlFlow;

use serde_json::{Map, Value};

use super::columns::{ColumnMap, LabelFacts, SourceLabel};
use super::{Draft, Real, most_bytes};
use crate::dataset::archive::{self, Files, Head};
use crate::files::diagnostic::Diagnostic;
use crate::files::image_file;
use crate::files::spelling::one_of;
use crate::job::plan::check::Check;

/// Ends of names that images usually have.
const IMAGES: [&str; 4] = ["tactile.png", "image.png", "png", "rgb.png"];

/// Reads the tar that is unit `unit` of a draft: labels, and how large the images are. `None` if nothing more can be said
/// after a mistake.
pub(super) fn read(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let (image, label) = (draft.written.image.clone(), draft.label.clone());
    let wanted = |head: Head<'_>| match &image {
        Some(suffix) => head.suffix == suffix || head.suffix == label,
        None => head.suffix == label || head.suffix.ends_with("png"),
    };
    // Ends of the names of the sample that is being read, wanted or not.
    let suffixes = RefCell::new(Vec::new());
    let mut keys = HashSet::new();
    let read = archive::open(
        &path,
        |head| {
            suffixes.borrow_mut().push(head.suffix.to_owned());
            wanted(head).then(|| most_bytes(head.suffix, &label))
        },
        |files| {
            sample(check, draft, unit, &files, suffixes.take(), &mut keys);
            let enough = draft.found.is_full() || draft.image.is_none();
            if enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    );
    if let Err(reason) = read {
        let help = "a WebDataset tar holds files named KEY.ending, those of a sample behind each other";
        draft.found.push(Diagnostic::new(format!("{}: {reason}", path.display())).help(help));
        return None;
    }
    draft.image.as_ref().map(|_| ())
}

fn sample(
    check: &mut Check<'_>,
    draft: &mut Draft<'_>,
    unit: usize,
    files: &Files,
    suffixes: Vec<String>,
    keys: &mut HashSet<String>,
) {
    let name = draft.root.join(&draft.units[unit].file).display().to_string();
    let wrong = |message: String| Diagnostic::new(format!("{name}: {}: {message}", files.key));
    let image = if let Some(image) = &draft.image {
        image.clone()
    } else {
        let found = match &draft.written.image {
            Some(suffix) => suffixes.contains(suffix).then(|| suffix.clone()),
            None => {
                let usual = IMAGES.into_iter().find(|usual| suffixes.iter().any(|suffix| suffix == usual));
                let pngs: Vec<&String> = suffixes.iter().filter(|suffix| suffix.ends_with("png")).collect();
                usual.map(str::to_owned).or_else(|| (pngs.len() == 1).then(|| pngs[0].clone()))
            }
        };
        let Some(found) = found else {
            let all: Vec<&str> = suffixes.iter().map(String::as_str).collect();
            let key = if draft.written.image.is_some() { "input.image" } else { "input.path" };
            let message = format!("{name}: {}: no file of the sample is its image", files.key);
            check.error(key, message, format!("say which one with input.image: {}", one_of(&all)));
            return;
        };
        draft.image = Some(found.clone());
        draft.suffixes.clone_from(&suffixes);
        found
    };
    draft.suffixes.retain(|suffix| suffixes.contains(suffix));
    if !keys.insert(files.key.clone()) {
        draft
            .found
            .push(wrong(String::from("the key is there twice")).help("files of a sample stand behind each other"));
        return;
    }
    let label = files.member(&draft.label).map_or(Ok(Map::new()), serde_json::from_slice::<Map<String, Value>>);
    let label = match label {
        Ok(label) => label,
        Err(error) => {
            draft.found.push(wrong(format!("{} is no JSON object: {error}", draft.label)));
            Map::new()
        }
    };
    let view = SourceLabel::Json(&label);
    let written = &draft.written.columns;
    let columns = draft.columns.get_or_insert_with(|| ColumnMap::find(check, written, &view)).clone();
    let mut mistakes = Vec::new();
    let (facts, split) = LabelFacts::read(&columns, &view, |_, message| mistakes.push(message));
    for message in mistakes {
        draft.found.push(wrong(message).help("write a number without its unit, or null"));
    }
    let size = files.member(&image).ok_or_else(|| format!("there is no {image}")).and_then(image_file::size_of_bytes);
    draft.sizes.push(size);
    draft.reals.push(Real { key: files.key.clone(), unit, image: files.key.clone(), text: 0..0, split: 0, facts });
    draft.named.push(split);
    if draft.example.is_empty() {
        draft.example = label;
    }
}
