//! Tables of presses: images of a real sensor, each with the circle where a ball touched, from a CSV file.
//!
//! Columns may stand in any order and are told by their names; unknown ones are passed over. Numbers are taken as they
//! are written: whether a circle fits its ball or its image is for those to check who know both.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::rows::{self, Row, cell_place, row_place};
use gelsim_files::source::Source;
use gelsim_files::spelling::nearest;
use gelsim_files::spelling::one_of;
use gelsim_files::{foreign, input};

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
    /// The names in its first line that are none of a column.
    unknown: Vec<String>,
    /// The columns that it has.
    columns: [bool; COLUMNS.len()],
}

impl Table {
    /// A mistake in the row on `line`, found later: to be collected, and shown by [`Table::report`].
    pub fn problem(&self, line: u64, message: impl Into<String>) -> Diagnostic {
        let before: usize =
            self.source.text.split_inclusive('\n').take(line.saturating_sub(1) as usize).map(str::len).sum();
        Diagnostic::new(message).at(row_place(&self.source.text, before))
    }

    /// True if the table has the column.
    pub fn has(&self, column: Column) -> bool {
        self.columns[column as usize]
    }

    /// That the table has no such column, said of its first line; `None` if it has. `what` is to be in it.
    pub fn lacks(&self, column: Column, what: &str) -> Option<Diagnostic> {
        if self.columns[column as usize] {
            return None;
        }
        let name = column.name();
        let header = row_place(&self.source.text, self.source.text.len() - self.source.text.trim_start().len());
        let help = format!("{}give {what} in every row", hint(name, &self.unknown));
        Some(Diagnostic::new(format!("no column is called `{name}`")).at(header).help(help))
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
        user_error(message, format!("name a CSV file: {FORM}"))
    })?;
    parse(path, &bytes)
}

/// Reads a table from the bytes of the file `path`.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Table, Report> {
    // An empty one has a message of its own.
    if let Some(foreign) = foreign::recognise(bytes).filter(|_| !bytes.is_empty()) {
        let message = format!("{} is no table: it is {}", path.display(), foreign.what);
        let help = if foreign.what.contains("ZIP") {
            "a spreadsheet (.xlsx, .ods) is such an archive: save it as CSV in UTF-8, and name that file"
        } else {
            foreign.help
        };
        return Err(user_error(message, help));
    }
    let source = rows::source(path, bytes)?;
    let mut problems = Diagnostics::default();
    let (presses, layout) = presses(&source, &mut problems);
    match (layout, problems.is_empty()) {
        (Some(Layout { places, unknown, .. }), true) => {
            Ok(Table { path: path.to_owned(), presses, source, unknown, columns: places.map(|place| place.is_some()) })
        }
        _ => Err(Report::new(&problems, &[source])),
    }
}

/// What is read of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// The image.
    File,
    /// Column of the circle's centre.
    CentreX,
    /// Row of the circle's centre.
    CentreY,
    /// Radius of the circle.
    Radius,
    /// Radius of the ball.
    BallRadius,
    /// Width of a pixel on the pad.
    PixelSize,
}

/// The names of all columns, in the order of [`Column`].
const COLUMNS: [&str; 6] = ["file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px"];
const CIRCLE: [Column; 3] = [Column::CentreX, Column::CentreY, Column::Radius];
/// What a table looks like.
const FORM: &str = "its first line is file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px, \
                    and each further line is an image";

/// What people call columns that are read under another name, and what else is to be done then.
const ALIASES: [(&str, &str, &str); 31] = [
    ("image", "file", ""),
    ("img", "file", ""),
    ("filename", "file", ""),
    ("file_name", "file", ""),
    ("path", "file", ""),
    ("name", "file", ""),
    ("x", "centre_x_px", ""),
    ("cx", "centre_x_px", ""),
    ("x_px", "centre_x_px", ""),
    ("u", "centre_x_px", ""),
    ("col", "centre_x_px", ""),
    ("column", "centre_x_px", ""),
    ("y", "centre_y_px", ""),
    ("cy", "centre_y_px", ""),
    ("y_px", "centre_y_px", ""),
    ("v", "centre_y_px", ""),
    ("row", "centre_y_px", ""),
    ("r", "radius_px", ""),
    ("r_px", "radius_px", ""),
    ("rad", "radius_px", ""),
    ("diameter_px", "radius_px", " with half of its values"),
    ("ball_radius", "ball_radius_mm", ""),
    ("ball_mm", "ball_radius_mm", ""),
    ("radius_mm", "ball_radius_mm", ""),
    ("ball_diameter_mm", "ball_radius_mm", " with half of its values"),
    ("diameter_mm", "ball_radius_mm", " with half of its values"),
    ("mm_per_pixel", "mm_per_px", ""),
    ("mmpp", "mm_per_px", ""),
    ("pixmm", "mm_per_px", ""),
    ("px_per_mm", "mm_per_px", " with 1 / its values"),
    ("pixel_per_mm", "mm_per_px", " with 1 / its values"),
];

impl Column {
    /// As the table's first line has it.
    pub fn name(self) -> &'static str {
        COLUMNS[self as usize]
    }
}

/// What the column that is called `absent` may have been called instead, as the beginning of a help.
fn hint(absent: &str, unknown: &[String]) -> String {
    let alias = |name: &&String| ALIASES.iter().find(|(alias, column, _)| alias == name && *column == absent);
    let meant = unknown.iter().find_map(|name| alias(&name)).map(|(name, _, change)| (*name, *change));
    let near = || nearest(absent, unknown.iter().map(String::as_str)).map(|near| (near, ""));
    meant.or_else(near).map_or(String::new(), |(name, change)| match change {
        "" => format!("is `{name}` meant? "),
        change => format!("is `{name}` meant? call it `{absent}`{change}; "),
    })
}

/// The rows, and what their columns are; `None` of these if there is no telling.
fn presses(source: &Source, problems: &mut Diagnostics) -> (Vec<Press>, Option<Layout>) {
    let mut rows = rows::rows(&source.text);
    let Some(header) = rows.next() else {
        problems.push(Diagnostic::new(format!("{}: the table is empty", source.name)).help(FORM));
        return (Vec::new(), None);
    };
    let Some(layout) = Layout::new(&header, problems) else { return (Vec::new(), None) };
    let mut presses: Vec<Press> = Vec::new();
    let mut seen: HashMap<PathBuf, u64> = HashMap::new();
    let mut last = header;
    for row in rows {
        if problems.is_full() {
            break;
        }
        if presses.len() == MOST_PRESSES {
            problems.push(
                row.wrong(0, format!("the table has more than {MOST_PRESSES} rows"))
                    .help(format!("write it as several tables of up to {MOST_PRESSES} rows")),
            );
            break;
        }
        if let Some(cell) = open_cell(&row, &layout) {
            let problem = row.wrong(cell, "a quote is opened and never closed on its line");
            problems.push(problem.help("write `\"` at the cell's end"));
            return (presses, Some(layout));
        }
        if let Some(press) = layout.press(&row, &source.folder, problems) {
            if let Some(first) = seen.insert(Path::new(".").join(&press.path), press.line) {
                let message = format!("`{}` is on line {first}, too", press.file);
                let problem = row.wrong(layout.file, message).of(format!("`{}`", press.file), "images are there twice");
                problems.push(problem.help("keep one of the two rows"));
            }
            presses.push(press);
        }
        last = row;
    }
    if presses.is_empty() && problems.is_empty() {
        let problem = last.wrong(0, "no row follows the names of the columns");
        problems.push(problem.help("write a line for each image below it"));
    }
    (presses, Some(layout))
}

/// The cell with a quote that nothing closes, or that takes in other rows where no text is.
fn open_cell(row: &Row, layout: &Layout) -> Option<usize> {
    let last = row.cells.len().saturating_sub(1);
    // A quote without its end is in the last cell of all.
    if row.end >= row.text.trim_end().len() {
        let place = cell_place(row.text, row.start, last);
        let raw = row.text[place.start..place.end].trim_end();
        if raw.starts_with('"') && raw.bytes().filter(|byte| *byte == b'"').count() % 2 == 1 {
            return Some(last);
        }
    }
    let spread = row.cells.iter().position(|cell| cell.contains('\n'))?;
    (row.cells.len() != layout.width || layout.places.contains(&Some(spread))).then_some(spread)
}

/// In which cells of a row the columns stand.
struct Layout {
    file: usize,
    places: [Option<usize>; COLUMNS.len()],
    width: usize,
    unknown: Vec<String>,
}

impl Layout {
    /// From the first row. None if there is no telling what the others hold.
    fn new(header: &Row, problems: &mut Diagnostics) -> Option<Self> {
        let names: Vec<String> =
            header.cells.iter().map(|name| name.trim().to_lowercase().replace("center_", "centre_")).collect();
        let marks = [(";", "semicolons"), ("\t", "tabs"), (" ", "spaces")];
        if let [only] = names.as_slice()
            && let Some((_, marks)) = marks.into_iter().find(|(mark, _)| only.contains(mark))
        {
            let problem = header.wrong(0, format!("the cells are separated by {marks} instead of commas"));
            problems.push(problem.help("separate them by commas, and write 1.5 with a point"));
            return None;
        }
        let places = COLUMNS.map(|column| names.iter().position(|name| name == column));
        let mut is_twice = false;
        for (column, first) in COLUMNS.iter().zip(places) {
            if let Some(again) = names.iter().rposition(|name| name == column)
                && Some(again) != first
            {
                is_twice = true;
                problems.push(header.wrong(again, format!("the column `{column}` is there twice")).help("remove one"));
            }
        }
        let unknown: Vec<String> = names.iter().filter(|name| !COLUMNS.contains(&name.as_str())).cloned().collect();
        let Some(file) = places[Column::File as usize] else {
            let problem = header.wrong(0, "no column is called `file`");
            problems.push(problem.help(format!("{}columns that are read: {}", hint("file", &unknown), all(&COLUMNS))));
            return None;
        };
        if is_twice {
            return None;
        }
        let layout = Self { file, places, width: names.len(), unknown };
        let (there, absent): (Vec<_>, Vec<_>) = CIRCLE.into_iter().partition(|column| layout.place(*column).is_some());
        if let (Some(index), Some(absent)) = (there.first().and_then(|column| layout.place(*column)), absent.first()) {
            let problem = header.wrong(index, format!("half a circle: no column is called `{}`", absent.name()));
            problems.push(problem.help(format!("{}{CIRCLE_HELP}", hint(absent.name(), &layout.unknown))));
        }
        Some(layout)
    }

    fn place(&self, column: Column) -> Option<usize> {
        self.places[column as usize]
    }

    /// What a row says; None if it has no file or not as many cells as there are columns.
    fn press(&self, row: &Row, folder: &Path, problems: &mut Diagnostics) -> Option<Press> {
        let (cells, width) = (row.cells.len(), self.width);
        if cells != width {
            let message = format!("the row has {cells} cells, and there are {width} columns");
            let help = "write a comma for each empty cell, a cell with a comma in quotes, and a name for each column";
            let problem = Diagnostic::new(message).at(row_place(row.text, row.start)).help(help);
            let cause = format!("rows have more or fewer cells than there are columns ({width})");
            problems.push(problem.of(format!("line {} ({cells})", row.line), cause));
            return None;
        }
        let file = row.cell(self.file);
        if file.is_empty() {
            let problem = row.wrong(self.file, "`file` is empty").help("name the image, or remove the row");
            problems.push(problem.of(format!("line {}", row.line), "rows name no image"));
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
            let problem = row.wrong(given[0], message).help(CIRCLE_HELP);
            problems.push(problem.of(format!("line {}", row.line), "rows have half a circle"));
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
        let what = if placed { "a number" } else { "a number above 0" };
        // An empty cell helps where a circle may be looked for, and all three are empty.
        let or_none = if CIRCLE.contains(&column) {
            format!(
                "write {what}; or leave the three cells of the circle empty, and have `gelsim calibrate --detect` look for it"
            )
        } else {
            format!("write {what}")
        };
        let (message, cause, help) = match text.parse::<f64>() {
            Ok(number) if number.is_finite() && (placed || number > 0.0) => return Some(number),
            Ok(number) if number.is_finite() => (
                format!("`{name}` is {text}; it must be above 0"),
                format!("rows have a `{name}` that is not above 0"),
                or_none,
            ),
            Ok(_) => (
                format!("`{name}` is {text}; it must be finite"),
                format!("rows have a `{name}` that is not finite"),
                or_none,
            ),
            Err(_) => {
                let is_near = with_point(text) || without_unit(text);
                let help = if is_near { String::from("write the number alone, with a point: 1.5") } else { or_none };
                (format!("`{name}`: `{text}` is not a number"), format!("rows have a `{name}` that is no number"), help)
            }
        };
        let subject = format!("line {} ({text})", row.line);
        problems.push(row.wrong(index, message).of(subject, cause).help(help));
        None
    }
}

/// True of `1,5`.
fn with_point(text: &str) -> bool {
    text.contains(',') && text.replacen(',', ".", 1).parse::<f64>().is_ok_and(f64::is_finite)
}

/// True of `4.0 mm`.
fn without_unit(text: &str) -> bool {
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+')));
    // Of other units the number is another one.
    let is_known = |unit: &str| matches!(unit.trim(), "mm" | "px" | "mm/px" | "pixel" | "pixels");
    end.is_some_and(|end| is_known(&text[end..]) && text[..end].parse::<f64>().is_ok())
}

/// `a`, `b` and `c`.
fn all(names: &[&str]) -> String {
    one_of(names).replace(" or ", " and ")
}

const CIRCLE_HELP: &str = "a circle is `centre_x_px`, `centre_y_px` and `radius_px`: give all three or none";

#[cfg(test)]
mod tests;
