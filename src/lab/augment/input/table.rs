//! Labels in a table next to the images: CSV with the names of columns in its first line, or JSON Lines.

use std::collections::HashMap;
use std::path::PathBuf;

use csv::StringRecord;
use rayon::prelude::*;
use serde_json::{Map, Value};

use super::columns::{ColumnMap, LabelFacts, SourceLabel, TableHeader, note_class_numbers};
use super::{DatasetDraft, LabelFormat, MAX_LABEL_BYTES, RealSample, images, json};
use gelsim_files::csv_table;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::foreign;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::source::{SourceSpan, SourceText};
use gelsim_files::spelling::find_nearest_name;
use gelsim_files::spelling::join_alternatives;
use gelsim_job::plan::check::JobChecker;

/// Largest table, bytes.
pub const MAX_BYTES: u64 = 1 << 30;
/// Usual names of the column with the image's file.
const IMAGE_COLUMN_NAMES: [&str; 6] = ["file_name", "file", "image", "filename", "image_path", "path"];

/// Returns the place of the line that begins at `start` of a table's text.
pub fn place_of_row(source: usize, text: &str, start: usize) -> SourceSpan {
    SourceSpan { source, ..csv_table::row_place(text, start) }
}

/// A row of a table.
struct LabelRow {
    start: usize,
    end: usize,
    line: u64,
    image: String,
    facts: LabelFacts,
    split: Option<String>,
}

/// Reads the table of unit `unit` of a draft. `None` after a mistake that leaves nothing more to check.
pub(super) fn read(check: &mut JobChecker<'_>, draft: &mut DatasetDraft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let shown = path.display().to_string();
    let source = |text: String| SourceText { name: shown.clone(), text, folder: path.with_file_name("") };
    let bytes = match input::read(&path, MAX_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => {
            let help = "name a table that can be read with input.labels, or make this one readable";
            draft.problems.push(Diagnostic::new(format!("{shown}: {error}")).help(help));
            return None;
        }
    };
    if let Some(foreign) = foreign::identify_foreign_file(&bytes) {
        let what = if bytes.is_empty() { "the table is empty" } else { foreign.what };
        let help = if bytes.is_empty() {
            "write the names of the columns in its first line, and a row for each image"
        } else {
            "save the table as CSV or JSON Lines, which are text"
        };
        let message =
            if bytes.is_empty() { format!("{shown}: {what}") } else { format!("{shown} is {what}, no table") };
        draft.problems.push(Diagnostic::new(message).help(help));
        return None;
    }
    let text = match csv_table::decode_table(&bytes) {
        Ok(text) => text,
        Err((text, problem)) => {
            draft.sources.push(source(text));
            draft.problems.push(with_source(unit, problem).help("save the table in UTF-8"));
            return None;
        }
    };
    let rows = match draft.units[unit].form {
        LabelFormat::JsonLines => read_json_rows(check, draft, unit, &text),
        _ => read_csv_rows(check, draft, unit, &text),
    };
    draft.sources.push(source(text));
    let rows = rows?;
    let folder = images::find_image_folder(check, draft, unit)?;
    draft.units[unit].images.clone_from(&folder);
    if rows.is_empty() && draft.problems.is_empty() {
        let message = format!("{shown}: no row follows the names of the columns");
        draft.problems.push(Diagnostic::new(message).help("write a row for each image, with its name"));
        return None;
    }
    let mut known = PrecedingRows::default();
    let from = draft.root.join(&folder);
    let mut kept = Vec::new();
    for row in rows {
        let image = images::with_slashes(&from, &row.image);
        if let Some(path) = check_row_image(draft, unit, &mut known, &row, &image) {
            kept.push((row, image, path));
        }
    }
    let root = draft.root;
    draft.sizes.par_extend(kept.par_iter().map(|(.., path)| image_file::read_size_of_file(&root.join(path))));
    for (LabelRow { start, end, image: written, facts, split, .. }, image, path) in kept {
        let has_backslashes = image != written;
        draft.reals.push(RealSample {
            key: written,
            unit,
            image,
            path,
            has_backslashes,
            text: start..end,
            split: 0,
            facts,
        });
        draft.label_splits.push(split);
    }
    Some(())
}

/// Facts about the rows before the current one.
#[derive(Default)]
struct PrecedingRows {
    /// Line of each image, by its path.
    lines: HashMap<PathBuf, u64>,
    /// Help for paths that lead out of the set (true: absolute ones). It searches folders, so it is found once.
    ways_in: HashMap<bool, String>,
}

/// Returns the image's path relative to the set's folder, if it is inside it and no earlier row names it.
fn check_row_image(
    draft: &mut DatasetDraft<'_>,
    unit: usize,
    known: &mut PrecedingRows,
    row: &LabelRow,
    image: &str,
) -> Option<PathBuf> {
    let line = format!("line {}", row.line);
    let text = &draft.sources[unit].text;
    let wrong = |message: String, subject: String, cause: &str| {
        Diagnostic::new(message).at(place_of_row(unit, text, row.start)).about(subject, cause)
    };
    if image.is_empty() {
        let problem = wrong(String::from("the row names no image"), line, "rows name no image");
        draft.problems.push(problem.help("name the image, or remove the row"));
        return None;
    }
    let folder = &draft.units[unit].images;
    let Some(path) = images::path_inside(folder, image) else {
        let is_absolute = images::is_absolute(image);
        let (message, cause) = if is_absolute {
            (format!("{image} is an absolute path, of another place or machine"), "images have absolute paths")
        } else {
            (format!("{} is not in the folder of input.path", row.image), "images are not in the folder of input.path")
        };
        let problem = wrong(message, row.image.clone(), cause);
        let help = known.ways_in.entry(is_absolute).or_insert_with(|| {
            let real = RealSample::from_image(unit, image);
            images::find_elsewhere(draft, &real).unwrap_or_else(|| {
                if is_absolute {
                    String::from("write names from the table's folder, or from one that input.images names")
                } else {
                    String::from("name a folder above both with input.path, and the table from there with input.labels")
                }
            })
        });
        let help = help.clone();
        draft.problems.push(problem.help(help));
        return None;
    };
    if let Some(first) = known.lines.insert(path.clone(), row.line) {
        let message = format!("the image {} is on line {first}, too", row.image);
        let subject = format!("{} (lines {first} and {})", row.image, row.line);
        draft.problems.push(wrong(message, subject, "images are in several rows").help("keep one of the two rows"));
        return None;
    }
    Some(path)
}

/// Returns a mistake in a table with the place in that unit's source.
fn with_source(unit: usize, problem: Diagnostic) -> Diagnostic {
    Diagnostic { place: problem.place.map(|place| SourceSpan { source: unit, ..place }), ..problem }
}

/// Finds the column with the image's file.
pub(super) fn find_image_column(
    check: &mut JobChecker<'_>,
    draft: &mut DatasetDraft<'_>,
    unit: usize,
    label: &SourceLabel<'_>,
) -> Option<String> {
    if let Some(known) = &draft.image_column {
        return Some(known.clone());
    }
    let column = match &draft.written.image {
        Some(column) if label.has_column(column) => Some(column.clone()),
        Some(column) => {
            let near = find_nearest_name(column, label.column_names())
                .map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let names: Vec<&str> = label.column_names().take(40).collect();
            let help = format!("{near}columns of the labels: {}", names.join(", "));
            check.report_error("input.image", format!("no column is called `{column}`"), help);
            None
        }
        None => {
            let found = IMAGE_COLUMN_NAMES.into_iter().find(|name| label.has_column(name)).map(str::to_owned);
            if found.is_none() {
                let message = format!("{}: no column names the image", draft.units[unit].file.display());
                let help = format!(
                    "say which one with input.image = \"...\"; it is found if it is {}",
                    join_alternatives(&IMAGE_COLUMN_NAMES)
                );
                check.report_error("input.path", message, help);
            }
            found
        }
    };
    draft.image_column.clone_from(&column);
    column
}

/// Resolves the columns by the first label; they hold for all others.
pub(super) fn resolve_columns(
    check: &mut JobChecker<'_>,
    draft: &mut DatasetDraft<'_>,
    label: &SourceLabel<'_>,
) -> ColumnMap {
    let written = &draft.written.columns;
    draft.columns.get_or_insert_with(|| ColumnMap::resolve_columns(check, written, label)).clone()
}

/// Returns a mistake if the row from `start` to `end` is longer than any label may be.
fn check_row_length(unit: usize, text: &str, start: usize, end: usize) -> Option<Diagnostic> {
    let bytes = end - start;
    (bytes as u64 > MAX_LABEL_BYTES).then(|| {
        let problem = Diagnostic::new(format!("the row has {bytes} bytes, more than 1 MB"));
        problem.at(place_of_row(unit, text, start)).help("leave columns out, or write what is so long into files")
    })
}

/// Reads the rows of a CSV table, and stores its columns in the unit.
fn read_csv_rows(
    check: &mut JobChecker<'_>,
    draft: &mut DatasetDraft<'_>,
    unit: usize,
    text: &str,
) -> Option<Vec<LabelRow>> {
    if let Some(problem) = csv_table::check_quotes(text) {
        draft.problems.push(with_source(unit, problem));
        return None;
    }
    let mut records = csv_table::iter_rows(text);
    let Some(header) = records.next() else {
        let message = format!("{}: the table is empty", draft.root.join(&draft.units[unit].file).display());
        let help = "write the names of the columns in its first line, and a row for each image";
        draft.problems.push(Diagnostic::new(message).help(help));
        return None;
    };
    if let Some(problem) = check_row_length(unit, text, header.start, header.end) {
        draft.problems.push(problem);
        return None;
    }
    let names: Vec<String> = header.cells.iter().map(|name| name.trim().to_owned()).collect();
    if let [only] = names.as_slice()
        && let Some(mark) = [(";", "semicolons"), ("\t", "tabs")].into_iter().find(|(mark, _)| only.contains(mark))
    {
        let problem = header.error_in_cell(0, format!("the cells are separated by {} instead of commas", mark.1));
        draft.problems.push(with_source(unit, problem).help("separate them by commas, and write 1.5 with a point"));
        return None;
    }
    let header = match TableHeader::new(names) {
        Ok(known) => known,
        Err(twice) => {
            let problem = header.error_in_cell(twice, format!("the column `{}` is there twice", header.cell(twice)));
            draft.problems.push(with_source(unit, problem).help("rename one"));
            return None;
        }
    };
    let nothing = StringRecord::new();
    let label = SourceLabel::Cells(&header, &nothing);
    let (image, columns) = (find_image_column(check, draft, unit, &label), resolve_columns(check, draft, &label));
    let image = header.column_index(&image?)?;
    let mut rows = Vec::new();
    for record in records {
        if draft.problems.is_full() {
            break;
        }
        if let Some(problem) = check_row_length(unit, text, record.start, record.end) {
            draft.problems.push(problem);
            continue;
        }
        if record.cells.len() != header.names.len() {
            let (cells, names) = (record.cells.len(), header.names.len());
            let message = format!("the row has {cells} cells, and there are {names} columns");
            let subject = format!("line {} ({cells} cells)", record.line);
            let help = "write a comma for each empty cell, and a cell with a comma in quotes";
            let problem = Diagnostic::new(message).at(place_of_row(unit, text, record.start)).help(help);
            draft
                .problems
                .push(problem.about(subject, format!("rows have not as many cells as there are columns ({names})")));
            continue;
        }
        let label = SourceLabel::Cells(&header, &record.cells);
        let name = record.cell(image).to_owned();
        let (facts, split) = LabelFacts::read(&columns, &label, |mistake| {
            let cell =
                header.column_index(&mistake.column).map(|index| csv_table::cell_place(text, record.start, index));
            let problem = mistake.into_diagnostic(&name, "leave the cell empty");
            draft.problems.push(with_source(unit, problem.at(cell)));
        });
        rows.push(LabelRow { start: record.start, end: record.end, line: record.line, image: name, facts, split });
    }
    draft.units[unit].form = LabelFormat::Csv(header.names);
    Some(rows)
}

/// Reads the rows of JSON Lines.
fn read_json_rows(
    check: &mut JobChecker<'_>,
    draft: &mut DatasetDraft<'_>,
    unit: usize,
    text: &str,
) -> Option<Vec<LabelRow>> {
    let (mut rows, mut start) = (Vec::new(), 0);
    for (number, line) in text.split('\n').enumerate() {
        let (from, end) = (start, start + line.len());
        start = end + 1;
        if line.trim().is_empty() {
            continue;
        }
        if draft.problems.is_full() {
            break;
        }
        if let Some(problem) = check_row_length(unit, text, from, end) {
            draft.problems.push(problem);
            continue;
        }
        let map: Map<String, Value> = match serde_json::from_str(line) {
            Ok(map) => map,
            Err(error) => {
                let at = from + error.column().saturating_sub(1).min(line.len());
                let place = SourceSpan { source: unit, start: at, end: at };
                let shown = format!("line {}", number + 1);
                if let Some(number) = json::find_non_number(line.as_bytes(), &error) {
                    let problem = Diagnostic::new(json::non_number_message(number)).at(place);
                    let problem = problem.about(shown, json::NON_NUMBER_CAUSE).help(json::NON_NUMBER_HELP);
                    draft.problems.push(problem);
                    continue;
                }
                let reason = error.to_string();
                let reason = reason.split(" at line ").next().unwrap_or_default();
                let problem = Diagnostic::new(format!("no JSON object: {reason}")).at(place);
                let problem = problem.about(shown, "lines are no JSON objects");
                let help = if text.trim_start().starts_with('[') {
                    "write each object on a line of its own, without [ ] around all and commas between them"
                } else {
                    "write one object on each line"
                };
                draft.problems.push(problem.help(help));
                continue;
            }
        };
        let label = SourceLabel::Json(&map);
        let image = find_image_column(check, draft, unit, &label)?;
        let columns = resolve_columns(check, draft, &label);
        let image = label.text(&image).unwrap_or_default();
        let (facts, split) = LabelFacts::read(&columns, &label, |mistake| {
            draft.problems.push(mistake.into_diagnostic(&image, "null").at(place_of_row(unit, text, from)));
        });
        note_class_numbers(&mut draft.class_numbers, &map);
        if draft.example.is_empty() {
            draft.example = map;
        }
        rows.push(LabelRow { start: from, end, line: number as u64 + 1, image, facts, split });
    }
    Some(rows)
}
