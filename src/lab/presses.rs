//! Tables of presses: images of a real sensor, each with the circle where a ball touched, from a CSV file.
//!
//! Columns may stand in any order and are told by their names; unknown ones are passed over. Numbers are taken as they
//! are written: whether a circle fits its ball or its image is for those to check who know both.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::files::diagnostic::user_error;
use crate::files::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::files::input;
use crate::files::rows::{self, Row, cell_place, row_place};
use crate::files::source::Source;
use crate::files::spelling::nearest;
use crate::files::spelling::one_of;

/// Largest table, bytes.
const MOST_BYTES: u64 = 16 << 20;
/// Most rows.
const MOST_PRESSES: usize = 100_000;

/// The circle in which a ball touches the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Column and row of its centre; (0, 0) is the centre of the top left pixel. May lie outside the image.
    pub centre_px: [f64; 2],
    /// Above 0.
    pub radius_px: f64,
}

/// One row of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Press {
    /// The image's file as the table has it.
    pub file: String,
    /// The image's file: relative to the same folder as the table's own path. It need not exist.
    pub path: PathBuf,
    /// The row's line in the table, from 1.
    pub line: u64,
    /// Where the ball touches; None if the table does not say.
    pub circle: Option<Circle>,
    /// Radius of the ball, above 0; None if the table does not say.
    pub ball_radius_mm: Option<f64>,
    /// Width and height of a pixel on the pad, above 0; None if the table does not say.
    pub mm_per_px: Option<f64>,
}

/// A table that was read; it has one press at least.
#[derive(Clone, Debug)]
pub struct Table {
    /// Its file.
    pub path: PathBuf,
    /// Its rows, in order. No file is there twice.
    pub presses: Vec<Press>,
    source: Source,
}

impl Table {
    /// A mistake in the row on `line`, found later: to be collected, and shown by [`Table::report`].
    pub fn problem(&self, line: u64, message: impl Into<String>) -> Diagnostic {
        let before: usize =
            self.source.text.split_inclusive('\n').take(line.saturating_sub(1) as usize).map(str::len).sum();
        Diagnostic::new(message).at(row_place(&self.source.text, before))
    }

    /// Shows mistakes in the table.
    pub fn report(&self, problems: &Diagnostics) -> Report {
        Report::new(problems, std::slice::from_ref(&self.source))
    }
}

/// Reads the table at `path`; all mistakes in it are reported at once.
pub fn read(path: &Path) -> Result<Table, Report> {
    let bytes = input::read(path, MOST_BYTES).map_err(|error| {
        let message = format!("cannot read the table of presses {}: {error}", path.display());
        user_error(message, format!("a CSV file with the columns {} belongs here", one_of(&COLUMNS)))
    })?;
    parse(path, &bytes)
}

/// Reads a table from the bytes of the file `path`.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Table, Report> {
    let source = rows::source(path, bytes)?;
    let mut problems = Diagnostics::default();
    let presses = presses(&source, &mut problems);
    match problems.is_empty() {
        true => Ok(Table { path: path.to_owned(), presses, source }),
        false => Err(Report::new(&problems, &[source])),
    }
}

/// What is read of a table.
#[derive(Clone, Copy)]
enum Column {
    File,
    CentreX,
    CentreY,
    Radius,
    BallRadius,
    PixelSize,
}

/// The names of all columns, in the order of [`Column`].
const COLUMNS: [&str; 6] = ["file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"];
const CIRCLE: [Column; 3] = [Column::CentreX, Column::CentreY, Column::Radius];

impl Column {
    fn name(self) -> &'static str {
        COLUMNS[self as usize]
    }
}

fn presses(source: &Source, problems: &mut Diagnostics) -> Vec<Press> {
    let mut rows = rows::rows(&source.text);
    let Some(header) = rows.next() else {
        problems.push(Diagnostic::new(format!("{}: the table is empty", source.name)).help(
            "its first line names the columns, each further one is an image: file,centre_x_px,centre_y_px,radius_px",
        ));
        return Vec::new();
    };
    let Some(layout) = Layout::new(&header, problems) else { return Vec::new() };
    let mut presses: Vec<Press> = Vec::new();
    let mut seen: HashMap<PathBuf, u64> = HashMap::new();
    let mut last = header;
    for row in rows {
        if problems.is_full() {
            break;
        }
        if presses.len() == MOST_PRESSES {
            problems.push(row.wrong(0, format!("the table has more than {MOST_PRESSES} rows")).help("divide it"));
            break;
        }
        if let Some(press) = layout.press(&row, &source.folder, problems) {
            if let Some(first) = seen.insert(Path::new(".").join(&press.path), press.line) {
                let message = format!("`{}` is on line {first}, too", press.file);
                problems.push(row.wrong(layout.file, message).help("keep one of the two rows"));
            }
            presses.push(press);
        }
        last = row;
    }
    let end = cell_place(&source.text, last.start, last.cells.len().saturating_sub(1));
    let raw = &source.text[end.start..end.end];
    if raw.starts_with('"') && raw.bytes().filter(|byte| *byte == b'"').count() % 2 == 1 {
        problems
            .push(Diagnostic::new("a quote is opened and never closed").at(end).help("write `\"` at the cell's end"));
    } else if presses.is_empty() && problems.is_empty() {
        problems.push(last.wrong(0, "no row follows the names of the columns").help("each row is an image"));
    }
    presses
}

/// In which cells of a row the columns stand.
struct Layout {
    file: usize,
    places: [Option<usize>; COLUMNS.len()],
    width: usize,
}

impl Layout {
    /// From the first row. None if there is no telling what the others hold.
    fn new(header: &Row, problems: &mut Diagnostics) -> Option<Self> {
        let names: Vec<String> = header.cells.iter().map(|name| name.trim().replace("center_", "centre_")).collect();
        if let [only] = names.as_slice()
            && let Some(separator) =
                [(";", "semicolons"), ("\t", "tabs")].into_iter().find(|(mark, _)| only.contains(mark))
        {
            let problem = header.wrong(0, format!("the cells are separated by {} instead of commas", separator.1));
            problems.push(problem.help("separate them by commas, and write 1.5 with a point"));
            return None;
        }
        let places = COLUMNS.map(|column| names.iter().position(|name| name == column));
        for (column, first) in COLUMNS.iter().zip(places) {
            if let Some(again) = names.iter().rposition(|name| name == column)
                && Some(again) != first
            {
                problems.push(header.wrong(again, format!("the column `{column}` is there twice")).help("remove one"));
            }
        }
        // What `absent` may have been meant to be.
        let hint = |absent: &str| {
            let unknown = names.iter().map(String::as_str).filter(|name| !COLUMNS.contains(name));
            nearest(absent, unknown).map_or(String::new(), |near| format!("is `{near}` meant? "))
        };
        let Some(file) = places[Column::File as usize] else {
            let problem = header.wrong(0, "no column is called `file`");
            problems.push(problem.help(format!("{}columns that are read: {}", hint("file"), one_of(&COLUMNS))));
            return None;
        };
        let layout = Self { file, places, width: names.len() };
        let (there, absent): (Vec<_>, Vec<_>) = CIRCLE.into_iter().partition(|column| layout.place(*column).is_some());
        if let (Some(index), Some(absent)) = (there.first().and_then(|column| layout.place(*column)), absent.first()) {
            let problem = header.wrong(index, format!("half a circle: no column is called `{}`", absent.name()));
            problems.push(problem.help(format!("{}{CIRCLE_HELP}", hint(absent.name()))));
        }
        Some(layout)
    }

    fn place(&self, column: Column) -> Option<usize> {
        self.places[column as usize]
    }

    /// What a row says; None if it has no file or not as many cells as there are columns.
    fn press(&self, row: &Row, folder: &Path, problems: &mut Diagnostics) -> Option<Press> {
        if row.cells.len() != self.width {
            let message = format!("the row has {} cells, and there are {} columns", row.cells.len(), self.width);
            let help = "write a comma for each empty cell, and a cell with a comma in quotes";
            problems.push(Diagnostic::new(message).at(row_place(row.text, row.start)).help(help));
            return None;
        }
        let file = row.cell(self.file);
        if file.is_empty() {
            problems.push(row.wrong(self.file, "`file` is empty").help("name the image, or remove the row"));
            return None;
        }
        let circle = self.circle(row, problems);
        Some(Press {
            file: file.to_owned(),
            path: folder.join(file),
            line: row.line,
            circle,
            ball_radius_mm: self.number(row, Column::BallRadius, problems),
            mm_per_px: self.number(row, Column::PixelSize, problems),
        })
    }

    fn circle(&self, row: &Row, problems: &mut Diagnostics) -> Option<Circle> {
        let [x, y, radius_px] = CIRCLE.map(|column| self.number(row, column, problems));
        // Where a column is absent that has been said of the table.
        let indices: Vec<usize> = CIRCLE.iter().filter_map(|column| self.place(*column)).collect();
        let (empty, given): (Vec<usize>, Vec<usize>) = indices.iter().partition(|index| row.cell(**index).is_empty());
        if indices.len() == CIRCLE.len() && !given.is_empty() && !empty.is_empty() {
            let names: Vec<&str> = CIRCLE
                .iter()
                .filter(|column| self.place(**column).is_some_and(|at| empty.contains(&at)))
                .map(|c| c.name())
                .collect();
            let message = format!("half a circle: {} is empty", names.join(" and "));
            problems.push(row.wrong(given[0], message).help(CIRCLE_HELP));
        }
        Some(Circle { centre_px: [x?, y?], radius_px: radius_px? })
    }

    /// The number in a cell; None if there is none.
    fn number(&self, row: &Row, column: Column, problems: &mut Diagnostics) -> Option<f64> {
        let index = self.place(column)?;
        let text = row.cell(index);
        if text.is_empty() {
            return None;
        }
        let name = column.name();
        let placed = matches!(column, Column::CentreX | Column::CentreY);
        let (message, help) = match text.parse::<f64>() {
            Ok(number) if number.is_finite() && (placed || number > 0.0) => return Some(number),
            Ok(number) if number.is_finite() => {
                (format!("`{name}` is {text}; it must be above 0"), "leave the cell empty if it is not known")
            }
            Ok(_) => (format!("`{name}` is {text}; it must be finite"), "leave the cell empty if it is not known"),
            Err(_) if text.contains(',') => (format!("`{name}`: `{text}` is not a number"), "write 1.5 with a point"),
            Err(_) => (
                format!("`{name}`: `{text}` is not a number"),
                "write a number without its unit, or leave the cell empty",
            ),
        };
        problems.push(row.wrong(index, message).help(help));
        None
    }
}

const CIRCLE_HELP: &str = "a circle is `centre_x_px`, `centre_y_px` and `radius_px`: give all three or none";

#[cfg(test)]
mod tests;
