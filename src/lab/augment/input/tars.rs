//! Labels in WebDataset tars: files that follow each other under one key are a sample, one of them its image, one its
//! label.

use std::cell::RefCell;
use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::Path;

use serde_json::{Map, Value};

use super::columns::{ColumnMap, LabelFacts, SourceLabel};
use super::{Draft, Real, most_bytes};
use gelsim_dataset::archive::{self, Files, Head};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file;
use gelsim_files::spelling::one_of;
use gelsim_job::plan::check::Check;

/// Ends of names that images usually have, without the ending of their format.
const IMAGES: [&str; 4] = ["tactile", "image", "", "rgb"];

/// Reads the tar that is unit `unit` of a draft: labels, and how large the images are. `None` if nothing more can be said
/// after a mistake.
pub(super) fn read(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let (image, label) = (draft.written.image.clone(), draft.label.clone());
    let wanted = |head: Head<'_>| match &image {
        Some(suffix) => head.suffix == suffix || head.suffix == label,
        None => head.suffix == label || is_image(head.suffix),
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
        let help = "a WebDataset tar holds files named KEY.ending, those of a sample behind each other: write or copy it again";
        draft.found.push(Diagnostic::new(format!("{}: {reason}", path.display())).help(help));
        return None;
    }
    draft.image.as_ref().map(|_| ())
}

/// True of the end of a name that a picture has.
fn is_image(suffix: &str) -> bool {
    image_file::is_named_like_one(&Path::new("KEY").with_extension(suffix))
}

/// The end of the image's name among those of a sample.
fn image_suffix(suffixes: &[String]) -> Option<String> {
    let images: Vec<&String> = suffixes.iter().filter(|suffix| is_image(suffix)).collect();
    let stem = |suffix: &str| suffix.rsplit_once('.').map_or(String::new(), |(stem, _)| stem.to_owned());
    let usual = IMAGES.into_iter().find_map(|usual| images.iter().find(|suffix| stem(suffix) == usual));
    usual.copied().or_else(|| (images.len() == 1).then(|| images[0])).cloned()
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
            None => image_suffix(&suffixes),
        };
        let Some(found) = found else {
            let images: Vec<&str> = suffixes.iter().map(String::as_str).filter(|suffix| is_image(suffix)).collect();
            let all: Vec<&str> = suffixes.iter().map(String::as_str).collect();
            let key = if draft.written.image.is_some() { "input.image" } else { "input.path" };
            let message = format!("{name}: {}: no file of the sample is its image", files.key);
            let help = if images.is_empty() {
                format!(
                    "put the image into the tar as KEY.png or KEY.jpg ({} are read; there are {}), or say which file is one \
                     with input.image",
                    image_file::NAMES,
                    one_of(&all)
                )
            } else {
                format!("say which one under [input]: image = {:?} ({})", images[0], one_of(&images))
            };
            check.error(key, message, help);
            return;
        };
        draft.image = Some(found.clone());
        draft.suffixes.clone_from(&suffixes);
        found
    };
    draft.suffixes.retain(|suffix| suffixes.contains(suffix));
    if !keys.insert(files.key.clone()) {
        let problem = wrong(String::from("the key is there twice"));
        let problem = problem.of(format!("{name}: {}", files.key), "keys are there twice");
        draft.found.push(problem.help("write the tar anew, the files of a sample behind each other"));
        return;
    }
    let label = files.member(&draft.label).map_or(Ok(Map::new()), serde_json::from_slice::<Map<String, Value>>);
    let label = match label {
        Ok(label) => label,
        Err(error) => {
            let problem = wrong(format!("{} is no JSON object: {error}", draft.label));
            let problem = problem.of(format!("{name}: {}", files.key), "labels are no JSON objects");
            let help = "write labels as JSON objects; labels that are something else have another ending: say the one of JSON \
                        with input.labels";
            draft.found.push(problem.help(help));
            Map::new()
        }
    };
    let view = SourceLabel::Json(&label);
    let written = &draft.written.columns;
    let columns = draft.columns.get_or_insert_with(|| ColumnMap::find(check, written, &view)).clone();
    let mut mistakes = Vec::new();
    let (facts, split) = LabelFacts::read(&columns, &view, |mistake| mistakes.push(mistake));
    for mistake in mistakes {
        let problem = mistake.of_sample(&files.key, "null");
        let message = format!("{name}: {}: {}", files.key, problem.message);
        draft.found.push(Diagnostic { message, ..problem });
    }
    let size = files.member(&image).ok_or_else(|| format!("there is no {image}")).and_then(image_file::size_of_bytes);
    draft.sizes.push(size);
    draft.reals.push(Real { facts, ..Real::of_image(unit, &files.key) });
    draft.named.push(split);
    if draft.example.is_empty() {
        draft.example = label;
    }
}
