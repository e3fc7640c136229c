//! Labels in a table beside the images: CSV with names of columns in its first line, or JSON Lines.

use std::collections::HashMap;
use std::path::PathBuf;

use csv::StringRecord;
use rayon::prelude::*;
use serde_json::{Map, Value};

use super::columns::{ColumnMap, Header, LabelFacts, SourceLabel};
use super::{Draft, Form, MOST_LABEL_BYTES, Real, images};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::foreign;
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::rows;
use gelsim_files::source::{Place, Source};
use gelsim_files::spelling::nearest;
use gelsim_files::spelling::one_of;
use gelsim_job::plan::check::Check;

/// Largest table, bytes.
pub const MOST_BYTES: u64 = 1 << 30;
/// Names that the column of the image usually has.
const IMAGES: [&str; 6] = ["file_name", "file", "image", "filename", "image_path", "path"];

/// Where the line that begins at `start` of a table's text stands.
pub fn place(source: usize, text: &str, start: usize) -> Place {
    Place { source, ..rows::row_place(text, start) }
}

/// One row of a table.
struct Row {
    start: usize,
    end: usize,
    line: u64,
    image: String,
    facts: LabelFacts,
    split: Option<String>,
}

/// Reads the table that is unit `unit` of a draft. `None` if nothing more can be said after a mistake.
pub(super) fn read(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize) -> Option<()> {
    let path = draft.root.join(&draft.units[unit].file);
    let shown = path.display().to_string();
    let source = |text: String| Source { name: shown.clone(), text, folder: path.with_file_name("") };
    let bytes = match input::read(&path, MOST_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => {
            let help = "name a table that can be read with input.labels, or make this one readable";
            draft.found.push(Diagnostic::new(format!("{shown}: {error}")).help(help));
            return None;
        }
    };
    if let Some(foreign) = foreign::recognise(&bytes) {
        let what = if bytes.is_empty() { "the table is empty" } else { foreign.what };
        let help = if bytes.is_empty() {
            "write the names of the columns in its first line, and a row for each image"
        } else {
            "save the table as CSV or JSON Lines, which are text"
        };
        let message =
            if bytes.is_empty() { format!("{shown}: {what}") } else { format!("{shown} is {what}, no table") };
        draft.found.push(Diagnostic::new(message).help(help));
        return None;
    }
    let text = match rows::decode(&bytes) {
        Ok(text) => text,
        Err((text, problem)) => {
            draft.sources.push(source(text));
            draft.found.push(at_source(unit, problem).help("save the table in UTF-8"));
            return None;
        }
    };
    let rows = match draft.units[unit].form {
        Form::JsonLines => json_lines(check, draft, unit, &text),
        _ => csv(check, draft, unit, &text),
    };
    draft.sources.push(source(text));
    let rows = rows?;
    let folder = images::folder(check, draft, unit)?;
    draft.units[unit].images.clone_from(&folder);
    if rows.is_empty() && draft.found.is_empty() {
        let message = format!("{shown}: no row follows the names of the columns");
        draft.found.push(Diagnostic::new(message).help("write a row for each image, with its name"));
        return None;
    }
    let mut known = PrecedingRows::default();
    let from = draft.root.join(&folder);
    let mut kept = Vec::new();
    for row in rows {
        let image = images::with_slashes(&from, &row.image);
        if let Some(path) = once(draft, unit, &mut known, &row, &image) {
            kept.push((row, image, path));
        }
    }
    let root = draft.root;
    draft.sizes.par_extend(kept.par_iter().map(|(.., path)| image_file::size_of_file(&root.join(path))));
    for (Row { start, end, image: written, facts, split, .. }, image, path) in kept {
        let has_backslashes = image != written;
        draft.reals.push(Real { key: written, unit, image, path, has_backslashes, text: start..end, split: 0, facts });
        draft.named.push(split);
    }
    Some(())
}

/// What is known of the rows before one.
#[derive(Default)]
struct PrecedingRows {
    /// Lines of images, by their paths.
    lines: HashMap<PathBuf, u64>,
    /// What to do about paths that lead out: folders are looked through for it, once.
    ways_in: HashMap<bool, String>,
}

/// The image's path from the set's folder, if it is a file of the set's own that no row before it names.
fn once(draft: &mut Draft<'_>, unit: usize, known: &mut PrecedingRows, row: &Row, image: &str) -> Option<PathBuf> {
    let line = format!("line {}", row.line);
    let text = &draft.sources[unit].text;
    let wrong = |message: String, subject: String, cause: &str| {
        Diagnostic::new(message).at(place(unit, text, row.start)).of(subject, cause)
    };
    if image.is_empty() {
        let problem = wrong(String::from("the row names no image"), line, "rows name no image");
        draft.found.push(problem.help("name the image, or remove the row"));
        return None;
    }
    let folder = &draft.units[unit].images;
    let Some(path) = images::inside(folder, image) else {
        let is_absolute = images::is_absolute(image);
        let (message, cause) = if is_absolute {
            (format!("{image} is an absolute path, of another place or machine"), "images have absolute paths")
        } else {
            (format!("{} is not in the folder of input.path", row.image), "images are not in the folder of input.path")
        };
        let problem = wrong(message, row.image.clone(), cause);
        let help = known.ways_in.entry(is_absolute).or_insert_with(|| {
            let real = Real::of_image(unit, image);
            images::elsewhere(draft, &real).unwrap_or_else(|| {
                if is_absolute {
                    String::from("write names from the table's folder, or from one that input.images names")
                } else {
                    String::from("name a folder above both with input.path, and the table from there with input.labels")
                }
            })
        });
        let help = help.clone();
        draft.found.push(problem.help(help));
        return None;
    };
    if let Some(first) = known.lines.insert(path.clone(), row.line) {
        let message = format!("the image {} is on line {first}, too", row.image);
        let subject = format!("{} (lines {first} and {})", row.image, row.line);
        draft.found.push(wrong(message, subject, "images are in several rows").help("keep one of the two rows"));
        return None;
    }
    Some(path)
}

/// The same mistake in the table of a unit.
fn at_source(unit: usize, problem: Diagnostic) -> Diagnostic {
    Diagnostic { place: problem.place.map(|place| Place { source: unit, ..place }), ..problem }
}

/// The column of the image among those that there are.
pub(super) fn image_column(
    check: &mut Check<'_>,
    draft: &mut Draft<'_>,
    unit: usize,
    label: &SourceLabel<'_>,
) -> Option<String> {
    if let Some(known) = &draft.image {
        return Some(known.clone());
    }
    let column = match &draft.written.image {
        Some(column) if label.has(column) => Some(column.clone()),
        Some(column) => {
            let near = nearest(column, label.names()).map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let names: Vec<&str> = label.names().take(40).collect();
            let help = format!("{near}columns of the labels: {}", names.join(", "));
            check.error("input.image", format!("no column is called `{column}`"), help);
            None
        }
        None => {
            let found = IMAGES.into_iter().find(|name| label.has(name)).map(str::to_owned);
            if found.is_none() {
                let message = format!("{}: no column names the image", draft.units[unit].file.display());
                let help =
                    format!("say which one with input.image = \"...\"; it is found if it is {}", one_of(&IMAGES));
                check.error("input.path", message, help);
            }
            found
        }
    };
    draft.image.clone_from(&column);
    column
}

/// Columns of the first label stand for all.
pub(super) fn columns(check: &mut Check<'_>, draft: &mut Draft<'_>, label: &SourceLabel<'_>) -> ColumnMap {
    let written = &draft.written.columns;
    draft.columns.get_or_insert_with(|| ColumnMap::find(check, written, label)).clone()
}

/// A mistake if the row of a table from `start` to `end` is longer than any label is.
fn too_long(unit: usize, text: &str, start: usize, end: usize) -> Option<Diagnostic> {
    let bytes = end - start;
    (bytes as u64 > MOST_LABEL_BYTES).then(|| {
        let problem = Diagnostic::new(format!("the row has {bytes} bytes, more than 1 MB"));
        problem.at(place(unit, text, start)).help("leave columns out, or write what is so long into files")
    })
}

fn csv(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize, text: &str) -> Option<Vec<Row>> {
    if let Some(problem) = rows::check_quotes(text) {
        draft.found.push(at_source(unit, problem));
        return None;
    }
    let mut records = rows::rows(text);
    let Some(header) = records.next() else {
        let message = format!("{}: the table is empty", draft.root.join(&draft.units[unit].file).display());
        let help = "write the names of the columns in its first line, and a row for each image";
        draft.found.push(Diagnostic::new(message).help(help));
        return None;
    };
    if let Some(problem) = too_long(unit, text, header.start, header.end) {
        draft.found.push(problem);
        return None;
    }
    let names: Vec<String> = header.cells.iter().map(|name| name.trim().to_owned()).collect();
    if let [only] = names.as_slice()
        && let Some(mark) = [(";", "semicolons"), ("\t", "tabs")].into_iter().find(|(mark, _)| only.contains(mark))
    {
        let problem = header.wrong(0, format!("the cells are separated by {} instead of commas", mark.1));
        draft.found.push(at_source(unit, problem).help("separate them by commas, and write 1.5 with a point"));
        return None;
    }
    let header = match Header::new(names) {
        Ok(known) => known,
        Err(twice) => {
            let problem = header.wrong(twice, format!("the column `{}` is there twice", header.cell(twice)));
            draft.found.push(at_source(unit, problem).help("rename one"));
            return None;
        }
    };
    let nothing = StringRecord::new();
    let label = SourceLabel::Cells(&header, &nothing);
    let (image, columns) = (image_column(check, draft, unit, &label), columns(check, draft, &label));
    let image = header.number(&image?)?;
    let mut rows = Vec::new();
    for record in records {
        if draft.found.is_full() {
            break;
        }
        if let Some(problem) = too_long(unit, text, record.start, record.end) {
            draft.found.push(problem);
            continue;
        }
        if record.cells.len() != header.names.len() {
            let (cells, names) = (record.cells.len(), header.names.len());
            let message = format!("the row has {cells} cells, and there are {names} columns");
            let subject = format!("line {} ({cells} cells)", record.line);
            let help = "write a comma for each empty cell, and a cell with a comma in quotes";
            let problem = Diagnostic::new(message).at(place(unit, text, record.start)).help(help);
            draft
                .found
                .push(problem.of(subject, format!("rows have not as many cells as there are columns ({names})")));
            continue;
        }
        let label = SourceLabel::Cells(&header, &record.cells);
        let name = record.cell(image).to_owned();
        let (facts, split) = LabelFacts::read(&columns, &label, |mistake| {
            let cell = header.number(&mistake.column).map(|index| rows::cell_place(text, record.start, index));
            let problem = mistake.of_sample(&name, "leave the cell empty");
            draft.found.push(at_source(unit, problem.at(cell)));
        });
        rows.push(Row { start: record.start, end: record.end, line: record.line, image: name, facts, split });
    }
    draft.units[unit].form = Form::Csv(header.names);
    Some(rows)
}

fn json_lines(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize, text: &str) -> Option<Vec<Row>> {
    let (mut rows, mut start) = (Vec::new(), 0);
    for (number, line) in text.split('\n').enumerate() {
        let (from, end) = (start, start + line.len());
        start = end + 1;
        if line.trim().is_empty() {
            continue;
        }
        if draft.found.is_full() {
            break;
        }
        if let Some(problem) = too_long(unit, text, from, end) {
            draft.found.push(problem);
            continue;
        }
        let map: Map<String, Value> = match serde_json::from_str(line) {
            Ok(map) => map,
            Err(error) => {
                let at = from + error.column().saturating_sub(1).min(line.len());
                let reason = error.to_string();
                let reason = reason.split(" at line ").next().unwrap_or_default();
                let problem = Diagnostic::new(format!("no JSON object: {reason}"));
                let problem = problem.at(Place { source: unit, start: at, end: at });
                let problem = problem.of(format!("line {}", number + 1), "lines are no JSON objects");
                let help = if text.trim_start().starts_with('[') {
                    "write each object on a line of its own, without [ ] around all and commas between them"
                } else {
                    "write one object on each line"
                };
                draft.found.push(problem.help(help));
                continue;
            }
        };
        let label = SourceLabel::Json(&map);
        let image = image_column(check, draft, unit, &label)?;
        let columns = columns(check, draft, &label);
        let image = label.text(&image).unwrap_or_default();
        let (facts, split) = LabelFacts::read(&columns, &label, |mistake| {
            draft.found.push(mistake.of_sample(&image, "null").at(place(unit, text, from)));
        });
        if draft.example.is_empty() {
            draft.example = map;
        }
        rows.push(Row { start: from, end, line: number as u64 + 1, image, facts, split });
    }
    Some(rows)
}
