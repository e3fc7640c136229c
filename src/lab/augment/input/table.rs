//! Labels in a table beside the images: CSV with names of columns in its first line, or JSON Lines.

use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

use csv::StringRecord;
use rayon::prelude::*;
use serde_json::{Map, Value};

use super::columns::{ColumnMap, Header, LabelFacts, SourceLabel};
use super::{Draft, Form, MOST_LABEL_BYTES, Real};
use crate::files::diagnostic::Diagnostic;
use crate::files::image_file;
use crate::files::input;
use crate::files::rows;
use crate::files::source::{Place, Source};
use crate::files::spelling::nearest;
use crate::files::spelling::one_of;
use crate::job::plan::check::Check;

/// Largest table, bytes.
const MOST_BYTES: u64 = 1 << 30;
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
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let text = input::read(&path, MOST_BYTES).and_then(|bytes| {
        String::from_utf8(bytes).map_err(|error| {
            let at = error.utf8_error().valid_up_to();
            std::io::Error::other(format!("not UTF-8 at byte {at}"))
        })
    });
    let text = match text {
        Ok(text) => text,
        Err(error) => {
            draft.found.push(Diagnostic::new(format!("{}: {error}", path.display())));
            return None;
        }
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text).replace("\r\n", "\n").replace('\r', "\n");
    let rows = match draft.units[unit].form {
        Form::JsonLines => json_lines(check, draft, unit, &text),
        _ => csv(check, draft, unit, &text),
    };
    draft.sources.push(Source { name: path.display().to_string(), text, folder: folder.clone() });
    let rows = rows?;
    let mut seen: HashMap<PathBuf, u64> = HashMap::new();
    let kept: Vec<Row> = rows.into_iter().filter_map(|row| once(draft, unit, &mut seen, row)).collect();
    let sizes: Vec<_> = kept.par_iter().map(|row| image_file::size_of_file(&folder.join(&row.image))).collect();
    draft.sizes.extend(sizes);
    for Row { start, end, image, facts, split, .. } in kept {
        draft.reals.push(Real { key: image.clone(), unit, image, text: start..end, split: 0, facts });
        draft.named.push(split);
    }
    Some(())
}

/// The row, if its image is a file of the set's own that no row before it names.
fn once(draft: &mut Draft<'_>, unit: usize, seen: &mut HashMap<PathBuf, u64>, row: Row) -> Option<Row> {
    let wrong = |message: String| {
        let text = &draft.sources[unit].text;
        Diagnostic::new(message).at(place(unit, text, row.start))
    };
    let steps: Vec<Component<'_>> = Path::new(&row.image).components().collect();
    let inside = |step: &Component<'_>| matches!(step, Component::Normal(_) | Component::CurDir);
    if row.image.is_empty() {
        let problem = wrong(String::from("the row names no image"));
        draft.found.push(problem.help("name the image, or remove the row"));
        return None;
    }
    if !steps.iter().all(inside) {
        let problem = wrong(format!("{} is not in the table's folder", row.image));
        draft.found.push(problem.help(
            "an output with the same names would lie outside its folder: put the table above \
                                       its images, and name them from there",
        ));
        return None;
    }
    let path: PathBuf = steps.iter().filter(|step| matches!(step, Component::Normal(_))).collect();
    if let Some(first) = seen.insert(path, row.line) {
        let problem = wrong(format!("the image {} is on line {first}, too", row.image));
        draft.found.push(problem.help("keep one of the two rows"));
        return None;
    }
    Some(row)
}

/// The column of the image among those that there are.
fn image_column(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize, label: &SourceLabel<'_>) -> Option<String> {
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
fn columns(check: &mut Check<'_>, draft: &mut Draft<'_>, label: &SourceLabel<'_>) -> ColumnMap {
    let written = &draft.written.columns;
    draft.columns.get_or_insert_with(|| ColumnMap::find(check, written, label)).clone()
}

/// A mistake if the row of a table from `start` to `end` is longer than any label is.
fn too_long(unit: usize, text: &str, start: usize, end: usize) -> Option<Diagnostic> {
    let bytes = end - start;
    (bytes as u64 > MOST_LABEL_BYTES).then(|| {
        let problem = Diagnostic::new(format!("the row has {bytes} bytes, more than 1 MB"));
        problem.at(place(unit, text, start)).help("look for a quote that nothing closes, or leave columns out")
    })
}

fn csv(check: &mut Check<'_>, draft: &mut Draft<'_>, unit: usize, text: &str) -> Option<Vec<Row>> {
    let mut records = rows::rows(text);
    let Some(header) = records.next() else {
        draft.found.push(Diagnostic::new(format!("{}: the table is empty", draft.units[unit].file.display())));
        return None;
    };
    let at_source =
        |problem: Diagnostic| Diagnostic { place: problem.place.map(|p| Place { source: unit, ..p }), ..problem };
    if let Some(problem) = too_long(unit, text, header.start, header.end) {
        draft.found.push(problem);
        return None;
    }
    let names: Vec<String> = header.cells.iter().map(|name| name.trim().to_owned()).collect();
    if let [only] = names.as_slice()
        && let Some(mark) = [(";", "semicolons"), ("\t", "tabs")].into_iter().find(|(mark, _)| only.contains(mark))
    {
        let problem = header.wrong(0, format!("the cells are separated by {} instead of commas", mark.1));
        draft.found.push(at_source(problem).help("separate them by commas, and write 1.5 with a point"));
        return None;
    }
    let header = match Header::new(names) {
        Ok(known) => known,
        Err(twice) => {
            let problem = header.wrong(twice, format!("the column `{}` is there twice", header.cell(twice)));
            draft.found.push(at_source(problem).help("rename one"));
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
            let help = "write a comma for each empty cell, and a cell with a comma in quotes";
            draft.found.push(Diagnostic::new(message).at(place(unit, text, record.start)).help(help));
            continue;
        }
        let label = SourceLabel::Cells(&header, &record.cells);
        let (facts, split) = LabelFacts::read(&columns, &label, |column, message| {
            let problem = match header.number(column) {
                Some(index) => at_source(record.wrong(index, message)),
                None => Diagnostic::new(message).at(place(unit, text, record.start)),
            };
            draft.found.push(problem.help("write a number without its unit, or leave the cell empty"));
        });
        let image = record.cell(image).to_owned();
        rows.push(Row { start: record.start, end: record.end, line: record.line, image, facts, split });
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
                draft
                    .found
                    .push(problem.at(Place { source: unit, start: at, end: at }).help("one object on each line"));
                continue;
            }
        };
        let label = SourceLabel::Json(&map);
        let image = image_column(check, draft, unit, &label)?;
        let columns = columns(check, draft, &label);
        let (facts, split) = LabelFacts::read(&columns, &label, |_, message| {
            let problem = Diagnostic::new(message).at(place(unit, text, from));
            draft.found.push(problem.help("write a number without its unit, or null"));
        });
        let image = label.text(&image).unwrap_or_default();
        if draft.example.is_empty() {
            draft.example = map;
        }
        rows.push(Row { start: from, end, line: number as u64 + 1, image, facts, split });
    }
    Some(rows)
}
