//! Labels in WebDataset tars: consecutive files with one key form a sample; one of them is its image, one its label.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::columns::{self, ColumnMap, LabelFacts, SourceLabel};
use super::names::lowercase_ending;
use super::{DatasetDraft, RealSample, exif, images, json, most_member_bytes};
use gelsim_dataset::archive::{self, MemberHead, SampleFiles};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::spelling::join_alternatives;
use gelsim_job::plan::check::JobChecker;

/// Usual suffixes of images, without the ending of their format.
const IMAGE_SUFFIXES: [&str; 4] = ["tactile", "image", "", "rgb"];
/// Names of the index of WebDataset's shards.
const INDEX_NAMES: [&str; 2] = ["wids.json", "index.json"];
/// Most suffixes or tars that a message names.
const MAX_NAMED: usize = 8;

/// Reads the tar of unit `unit` of a draft: labels, and the sizes of the images. `None` after a mistake that leaves
/// nothing more to check.
pub(super) fn read(check: &mut JobChecker<'_>, draft: &mut DatasetDraft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let (image, label) = (draft.written.image.clone(), draft.label_suffix.clone());
    let wanted = |head: MemberHead<'_>| match &image {
        Some(suffix) => head.suffix == suffix || head.suffix == label,
        None => head.suffix == label || is_image(head.suffix),
    };
    // Suffixes of all files of the current sample, also of those that are not read.
    let suffixes = RefCell::new(Vec::new());
    let mut keys = HashSet::new();
    let read = archive::visit_webdataset_file(
        &path,
        |head| {
            suffixes.borrow_mut().push(head.suffix.to_owned());
            wanted(head).then(|| most_member_bytes(head.suffix, &label))
        },
        |files| {
            read_sample(check, draft, unit, &files, suffixes.take(), &mut keys);
            let enough = draft.problems.is_full() || draft.image_column.is_none();
            if enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    );
    if let Err(reason) = read {
        let help = "a WebDataset tar holds files named KEY.ending, those of a sample behind each other: write or copy it again";
        draft.problems.push(Diagnostic::new(format!("{}: {reason}", path.display())).help(help));
        return None;
    }
    draft.image_column.as_ref().map(|_| ())
}

/// Warns of tars that are not there, though the index of the folder names them, or the numbers of the others leave them
/// out.
pub(super) fn warn_of_missing_tars(draft: &mut DatasetDraft<'_>) {
    // A tar that was named is all that is meant.
    if draft.written.path.as_deref().is_some_and(|path| lowercase_ending(Path::new(path)) == "tar") {
        return;
    }
    let files: BTreeSet<PathBuf> = draft.units.iter().map(|unit| unit.file.clone()).collect();
    let mut missing = find_missing_numbers(&files);
    missing
        .extend(list_indexed_tars(draft.root).into_iter().filter(|file| !input::may_be_file(&draft.root.join(file))));
    let Some(first) = missing.first() else { return };
    let message = match missing.len() {
        1 => format!("{} is missing", draft.root.join(first).display()),
        count => {
            let mut names: Vec<String> =
                missing.iter().take(MAX_NAMED).map(|file| file.display().to_string()).collect();
            if count > MAX_NAMED {
                names.push(format!("and {} more", count - MAX_NAMED));
            }
            format!("{count} tars are missing in {}: {}", draft.root.display(), names.join(", "))
        }
    };
    draft.notes.push(Diagnostic::warning(message).help("copy what is missing; else its samples are left out"));
}

/// Returns the names that are missing between the first and the last tar of each numbered series. Where more would be
/// missing than there are, the numbers are no series.
fn find_missing_numbers(files: &BTreeSet<PathBuf>) -> BTreeSet<PathBuf> {
    let mut series: BTreeMap<(String, usize), BTreeSet<u64>> = BTreeMap::new();
    for file in files {
        let Some(stem) = file.with_extension("").to_str().map(str::to_owned) else { continue };
        let name = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        let digits = &stem[name.len()..];
        if let Ok(number) = digits.parse() {
            series.entry((name.to_owned(), digits.len())).or_default().insert(number);
        }
    }
    let mut missing = BTreeSet::new();
    for ((name, digits), numbers) in series {
        let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { continue };
        if last - first < 2 * numbers.len() as u64 {
            let absent = (*first..=*last).filter(|number| !numbers.contains(number));
            missing.extend(absent.map(|number| PathBuf::from(format!("{name}{number:0digits$}.tar"))));
        }
    }
    missing
}

/// Lists the tars that the index of WebDataset in the folder names, if there is one. Addresses are no files.
fn list_indexed_tars(root: &Path) -> Vec<PathBuf> {
    let read = |name: &str| -> Option<Value> {
        serde_json::from_slice(&input::read_without_links(&root.join(name), input::MAX_METADATA_BYTES).ok()?).ok()
    };
    let shards = |index: Value| -> Vec<PathBuf> {
        let urls = index["shardlist"].as_array().into_iter().flatten().filter_map(|shard| shard["url"].as_str());
        urls.filter(|url| !url.contains("://")).map(PathBuf::from).collect()
    };
    INDEX_NAMES.into_iter().filter_map(read).flat_map(shards).collect()
}

/// Returns true for the suffix of a picture.
fn is_image(suffix: &str) -> bool {
    image_file::has_image_extension(Path::new(&format!("KEY.{suffix}")))
}

/// Finds the suffix of the image among those of a sample: a usual one, or the only picture.
fn find_image_suffix(suffixes: &[String]) -> Option<String> {
    let images: Vec<&String> = suffixes.iter().filter(|suffix| is_image(suffix)).collect();
    let stem = |suffix: &str| suffix.rsplit_once('.').map_or(String::new(), |(stem, _)| stem.to_owned());
    let usual = IMAGE_SUFFIXES.into_iter().find_map(|usual| images.iter().find(|suffix| stem(suffix) == usual));
    usual.copied().or_else(|| (images.len() == 1).then(|| images[0])).cloned()
}

/// Returns what the samples are of which gelsim wrote this label, if they have several images.
fn name_several_images(label: &Map<String, Value>) -> Option<&'static str> {
    let has = |key: &str| columns::is_own_label(label) && label.contains_key(key);
    match (has("sequence"), has("left")) {
        (true, true) => Some("sequences of grips"),
        (true, false) => Some("sequences"),
        (false, true) => Some("grips"),
        (false, false) => None,
    }
}

/// Adds a sample of the tar to the draft. The first sample decides which suffix is the image.
fn read_sample(
    check: &mut JobChecker<'_>,
    draft: &mut DatasetDraft<'_>,
    unit: usize,
    files: &SampleFiles,
    suffixes: Vec<String>,
    keys: &mut HashSet<String>,
) {
    let name = draft.root.join(&draft.units[unit].file).display().to_string();
    let wrong = |message: String| Diagnostic::new(format!("{name}: {}: {message}", files.key));
    let label_bytes = files.find_member(&draft.label_suffix);
    let label = label_bytes.map_or(Ok(Map::new()), serde_json::from_slice::<Map<String, Value>>);
    if draft.image_column.is_none()
        && let Some(several) = label.as_ref().ok().and_then(name_several_images)
    {
        let message = format!("{name} holds {several}, and augment takes single images");
        let help =
            "make the dataset with container = \"folder\" under [output] of its job: there each image is a sample";
        check.report_error("input.path", message, help);
        return;
    }
    let image = if let Some(image) = &draft.image_column {
        image.clone()
    } else {
        let found = match &draft.written.image {
            Some(suffix) => suffixes.contains(suffix).then(|| suffix.clone()),
            None => find_image_suffix(&suffixes),
        };
        let Some(found) = found else {
            let names = || suffixes.iter().map(String::as_str);
            let images: Vec<&str> = names().filter(|suffix| is_image(suffix)).take(MAX_NAMED).collect();
            let all: Vec<&str> = names().take(MAX_NAMED).collect();
            let key = if draft.written.image.is_some() { "input.image" } else { "input.path" };
            let message = format!("{name}: {}: no file of the sample is its image", files.key);
            let help = if images.is_empty() {
                format!(
                    "put the image into the tar as KEY.png or KEY.jpg ({} are read; there are {}), or say which file is one \
                     with input.image",
                    image_file::FORMAT_NAMES,
                    join_alternatives(&all)
                )
            } else {
                format!("say which one under [input]: image = {:?} ({})", images[0], join_alternatives(&images))
            };
            check.report_error(key, message, help);
            return;
        };
        draft.image_column = Some(found.clone());
        draft.suffixes.clone_from(&suffixes);
        found
    };
    draft.suffixes.retain(|suffix| suffixes.contains(suffix));
    if !keys.insert(files.key.clone()) {
        let problem = wrong(String::from("the key is there twice"));
        let problem = problem.about(format!("{name}: {}", files.key), "keys are there twice");
        draft.problems.push(problem.help("write the tar anew, the files of a sample behind each other"));
        return;
    }
    let label = match label {
        Ok(label) => label,
        Err(error) => {
            let problem = match json::find_non_number(label_bytes.unwrap_or_default(), &error) {
                Some(number) => wrong(format!("{}: {}", draft.label_suffix, json::non_number_message(number)))
                    .about(format!("{name}: {}", files.key), json::NON_NUMBER_CAUSE)
                    .help(json::NON_NUMBER_HELP),
                None => wrong(format!("{} is no JSON object: {error}", draft.label_suffix))
                    .about(format!("{name}: {}", files.key), "labels are no JSON objects")
                    .help(
                        "write labels as JSON objects; labels that are something else have another ending: say the one of \
                         JSON with input.labels",
                    ),
            };
            draft.problems.push(problem);
            Map::new()
        }
    };
    let view = SourceLabel::Json(&label);
    let written = &draft.written.columns;
    let columns = draft.columns.get_or_insert_with(|| ColumnMap::resolve_columns(check, written, &view)).clone();
    let mut mistakes = Vec::new();
    let (facts, split) = LabelFacts::read(&columns, &view, |mistake| mistakes.push(mistake));
    for mistake in mistakes {
        let problem = mistake.into_diagnostic(&files.key, "null");
        let message = format!("{name}: {}: {}", files.key, problem.message);
        draft.problems.push(Diagnostic { message, ..problem });
    }
    let image_bytes = files.find_member(&image);
    let size = image_bytes.ok_or_else(|| format!("there is no {image}")).and_then(image_file::read_size_of_bytes);
    draft.sizes.push(size);
    if let Some(orientation) = image_bytes.and_then(exif::find_turn) {
        draft.notes.push(images::warn_of_turn(&format!("{name}: {}", files.key), orientation));
    }
    draft.reals.push(RealSample { facts, ..RealSample::from_image(unit, &files.key) });
    draft.label_splits.push(split);
    columns::note_class_numbers(&mut draft.class_numbers, &label);
    if draft.example.is_empty() {
        draft.example = label;
    }
}
