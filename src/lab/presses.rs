//! Tables of presses: images of a real sensor, each with the circle where a ball touched, from a CSV file.
//!
//! Columns may stand in any order and are found by their names; unknown ones are ignored. Numbers are taken as they are
//! written: whether a circle fits its ball or its image is checked by those who know both. Calibration folders of other
//! programs become the same tables ([`folder`]).

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use gelsim_files::csv_table::{self, TableRow, cell_place, row_place};
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input;
use gelsim_files::source::{LineStarts, SourceText};
use gelsim_files::spelling::find_nearest_name;
use gelsim_files::spelling::join_alternatives;

pub mod folder;
pub mod square;

/// Largest size of a table, bytes.
const MAX_BYTES: u64 = 16 << 20;
/// Most rows of a table.
const MAX_PRESSES: usize = 100_000;

/// The circle in which a ball touches the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Column and row of its centre; (0, 0) is the centre of the top left pixel. May lie outside the image.
    pub centre_px: [f64; 2],
    /// Radius, above 0.
    pub radius_px: f64,
}

/// One row of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct PressRow {
    /// The image's file as the table has it.
    pub file: String,
    /// Path of the image, relative to the same folder as the table's own path. It need not exist.
    pub path: PathBuf,
    /// The row's line in the table, from 1.
    pub line: u64,
    /// Circle in which the ball touches; None if the table does not say.
    pub circle: Option<Circle>,
    /// Radius of the ball, above 0; None if the table does not say.
    pub ball_radius_mm: Option<f64>,
    /// Width and height of a pixel on the pad, above 0; None if the table does not say.
    pub mm_per_px: Option<[f64; 2]>,
}

/// A table of at least one press.
#[derive(Clone, Debug)]
pub struct PressTable {
    /// Path of the table.
    pub path: PathBuf,
    /// Rows, in order. No two name the same file.
    pub presses: Vec<PressRow>,
    /// The background image of a calibration folder; `None` for a table by itself.
    pub background: Option<PathBuf>,
    /// What its reader has to say.
    pub notes: Vec<Diagnostic>,
    /// What gives an image its circle, for messages.
    pub circle_advice: &'static str,
    source: SourceText,
    lines: LineStarts,
    /// Names in the first line that are not those of a column.
    unknown: Vec<String>,
    /// Which columns the table has.
    columns: [bool; COLUMNS.len()],
}

impl PressTable {
    /// Returns a mistake in the row on `line` that was found later, to be collected and shown by
    /// [`PressTable::report`].
    pub fn row_problem(&self, line: u64, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(message).at(self.lines.place(line))
    }

    /// Returns true if the table has the column, or for the size of a pixel those of its width and height.
    pub fn has_column(&self, column: PressColumn) -> bool {
        let has = |column: PressColumn| self.columns[column as usize];
        has(column) || column == PressColumn::PixelSize && PIXEL_SIDES.into_iter().all(has)
    }

    /// Returns the mistake that the table lacks a column, at its first line; `None` if it has it. `what` says what
    /// belongs in it.
    pub fn report_missing_column(&self, column: PressColumn, what: &str) -> Option<Diagnostic> {
        if self.has_column(column) {
            return None;
        }
        let name = column.name();
        let header = row_place(&self.source.text, self.source.text.len() - self.source.text.trim_start().len());
        let help = format!("{}give {what} in every row", hint_for_column(name, &self.unknown));
        Some(Diagnostic::new(format!("no column is called `{name}`")).at(header).help(help))
    }

    /// Builds a report of mistakes in the table.
    pub fn report(&self, problems: &Diagnostics) -> Report {
        Report::new(problems, std::slice::from_ref(&self.source))
    }
}

/// Reads the table at `path`. On failure reports all mistakes at once.
pub fn read(path: &Path) -> Result<PressTable, Report> {
    let bytes = input::read(path, MAX_BYTES).map_err(|error| {
        let message = format!("cannot read the table of presses {}: {error}", path.display());
        user_error(message, format!("name a CSV file: {TABLE_FORM}"))
    })?;
    parse(path, &bytes)
}

/// Reads a table from the bytes of the file `path`.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<PressTable, Report> {
    let source = csv_table::decode_user_table(path, bytes)?;
    let mut problems = Diagnostics::default();
    let (presses, layout) = parse_presses(&source, &mut problems);
    match (layout, problems.is_empty()) {
        (Some(ColumnLayout { places, unknown, .. }), true) => Ok(PressTable {
            path: path.to_owned(),
            presses,
            background: None,
            notes: Vec::new(),
            circle_advice: "write the circle into the table",
            lines: LineStarts::find(&source.text),
            source,
            unknown,
            columns: places.map(|place| place.is_some()),
        }),
        _ => Err(Report::new(&problems, &[source])),
    }
}

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PressColumn {
    /// File of the image.
    File,
    /// Column of the circle's centre.
    CentreX,
    /// Row of the circle's centre.
    CentreY,
    /// Radius of the circle.
    Radius,
    /// Radius of the ball.
    BallRadius,
    /// Width and height of a square pixel on the pad.
    PixelSize,
    /// Width of a pixel that is not square.
    PixelWidth,
    /// Height of a pixel that is not square.
    PixelHeight,
}

/// Names of all columns, in the order of [`PressColumn`].
const COLUMNS: [&str; 8] =
    ["file", "centre_x_px", "centre_y_px", "radius_px", "ball_radius_mm", "mm_per_px", "mm_per_px_x", "mm_per_px_y"];
const CIRCLE_COLUMNS: [PressColumn; 3] = [PressColumn::CentreX, PressColumn::CentreY, PressColumn::Radius];
const PIXEL_SIDES: [PressColumn; 2] = [PressColumn::PixelWidth, PressColumn::PixelHeight];
/// Form of a table, for messages.
const TABLE_FORM: &str = "its first line is file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px, \
                    and each further line is an image";

/// Other names that people give to columns, the column that is meant, and what to change besides the name.
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

impl PressColumn {
    /// Name in the table's first line.
    pub fn name(self) -> &'static str {
        COLUMNS[self as usize]
    }
}

/// Suggests which unknown column may be meant by the `absent` one, as the beginning of a help; empty if there is none.
fn hint_for_column(absent: &str, unknown: &[String]) -> String {
    let alias = |name: &&String| ALIASES.iter().find(|(alias, column, _)| alias == name && *column == absent);
    let meant = unknown.iter().find_map(|name| alias(&name)).map(|(name, _, change)| (*name, *change));
    let near = || find_nearest_name(absent, unknown.iter().map(String::as_str)).map(|near| (near, ""));
    meant.or_else(near).map_or(String::new(), |(name, change)| match change {
        "" => format!("is `{name}` meant? "),
        change => format!("is `{name}` meant? call it `{absent}`{change}; "),
    })
}

/// Returns the rows, and where their columns stand; `None` for these if the first line does not tell.
fn parse_presses(source: &SourceText, problems: &mut Diagnostics) -> (Vec<PressRow>, Option<ColumnLayout>) {
    let mut rows = csv_table::iter_rows(&source.text);
    let Some(header) = rows.next() else {
        problems.push(Diagnostic::new(format!("{}: the table is empty", source.name)).help(TABLE_FORM));
        return (Vec::new(), None);
    };
    let Some(layout) = ColumnLayout::new(&header, problems) else { return (Vec::new(), None) };
    let mut presses: Vec<PressRow> = Vec::new();
    let mut seen: HashMap<PathBuf, u64> = HashMap::new();
    let mut last = header;
    for row in rows {
        if problems.is_full() {
            break;
        }
        if presses.len() == MAX_PRESSES {
            problems.push(
                row.error_in_cell(0, format!("the table has more than {MAX_PRESSES} rows"))
                    .help(format!("write it as several tables of up to {MAX_PRESSES} rows")),
            );
            break;
        }
        if let Some(cell) = find_unclosed_cell(&row, &layout) {
            let problem = row.error_in_cell(cell, "a quote is opened and never closed on its line");
            problems.push(problem.help("write `\"` at the cell's end"));
            return (presses, Some(layout));
        }
        if let Some(press) = layout.parse_press(&row, &source.folder, problems) {
            problems.extend(report_repetition(&mut seen, &press, &row, layout.file));
            presses.push(press);
        }
        last = row;
    }
    if presses.is_empty() && problems.is_empty() {
        let problem = last.error_in_cell(0, "no row follows the names of the columns");
        problems.push(problem.help("write a line for each image below it"));
    }
    (presses, Some(layout))
}

/// Reports an image that an earlier row names, too. `cell` holds its name.
fn report_repetition(
    seen: &mut HashMap<PathBuf, u64>,
    press: &PressRow,
    row: &TableRow,
    cell: usize,
) -> Option<Diagnostic> {
    let first = seen.insert(Path::new(".").join(&press.path), press.line)?;
    let problem = row.error_in_cell(cell, format!("`{}` is on line {first}, too", press.file));
    Some(problem.about(format!("`{}`", press.file), "images are there twice").help("keep one of the two rows"))
}

/// Returns the cell whose quote is never closed, or is closed only in a later row although the cell holds no text.
fn find_unclosed_cell(row: &TableRow, layout: &ColumnLayout) -> Option<usize> {
    let last = row.cells.len().saturating_sub(1);
    // A quote that is never closed takes everything after it into the table's last cell.
    if row.end >= row.text.trim_end().len() {
        let place = cell_place(row.text, row.start, last);
        let raw = row.text[place.start..place.end].trim_end();
        if raw.starts_with('"') && raw.bytes().filter(|byte| *byte == b'"').count() % 2 == 1 {
            return Some(last);
        }
    }
    let mut spread = (0..row.cells.len()).filter(|cell| row.cells[*cell].contains('\n'));
    let holds_no_text = |cell: &usize| row.cells.len() != layout.width || layout.places.contains(&Some(*cell));
    spread.find(holds_no_text)
}

/// Which cell of a row holds which column.
struct ColumnLayout {
    file: usize,
    places: [Option<usize>; COLUMNS.len()],
    width: usize,
    unknown: Vec<String>,
}

impl ColumnLayout {
    /// Reads the first row. None if it does not tell what the other rows hold.
    fn new(header: &TableRow, problems: &mut Diagnostics) -> Option<Self> {
        let names: Vec<String> =
            header.cells.iter().map(|name| name.trim().to_lowercase().replace("center_", "centre_")).collect();
        let marks = [(";", "semicolons"), ("\t", "tabs"), (" ", "spaces")];
        if let [only] = names.as_slice()
            && let Some((_, marks)) = marks.into_iter().find(|(mark, _)| only.contains(mark))
        {
            let problem = header.error_in_cell(0, format!("the cells are separated by {marks} instead of commas"));
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
                problems.push(
                    header.error_in_cell(again, format!("the column `{column}` is there twice")).help("remove one"),
                );
            }
        }
        let unknown: Vec<String> = names.iter().filter(|name| !COLUMNS.contains(&name.as_str())).cloned().collect();
        let Some(file) = places[PressColumn::File as usize] else {
            let problem = header.error_in_cell(0, "no column is called `file`");
            problems.push(problem.help(format!(
                "{}columns that are read: {}",
                hint_for_column("file", &unknown),
                join_names(&COLUMNS)
            )));
            return None;
        };
        if is_twice {
            return None;
        }
        let layout = Self { file, places, width: names.len(), unknown };
        let (present, absent): (Vec<_>, Vec<_>) =
            CIRCLE_COLUMNS.into_iter().partition(|column| layout.cell_index(*column).is_some());
        if let (Some(index), Some(absent)) =
            (present.first().and_then(|column| layout.cell_index(*column)), absent.first())
        {
            let problem =
                header.error_in_cell(index, format!("half a circle: no column is called `{}`", absent.name()));
            problems.push(problem.help(format!("{}{CIRCLE_HELP}", hint_for_column(absent.name(), &layout.unknown))));
        }
        let sides = PIXEL_SIDES.map(|column| layout.cell_index(column));
        if let Some(index) = sides[0].or(sides[1])
            && (sides.contains(&None) || layout.cell_index(PressColumn::PixelSize).is_some())
        {
            let problem = header.error_in_cell(index, "the size of a pixel is neither one column nor two");
            problems.push(problem.help(PIXEL_HELP));
        }
        Some(layout)
    }

    fn cell_index(&self, column: PressColumn) -> Option<usize> {
        self.places[column as usize]
    }

    /// Reads a row. None if it names no file, or does not have as many cells as there are columns.
    fn parse_press(&self, row: &TableRow, folder: &Path, problems: &mut Diagnostics) -> Option<PressRow> {
        let (cells, width) = (row.cells.len(), self.width);
        if cells != width {
            let message = format!("the row has {cells} cells, and there are {width} columns");
            let help = "write a comma for each empty cell, a cell with a comma in quotes, and a name for each column";
            let problem = Diagnostic::new(message).at(row_place(row.text, row.start)).help(help);
            let cause = format!("rows have more or fewer cells than there are columns ({width})");
            problems.push(problem.about(format!("line {} ({cells})", row.line), cause));
            return None;
        }
        let file = row.cell(self.file);
        if file.is_empty() {
            let problem = row.error_in_cell(self.file, "`file` is empty").help("name the image, or remove the row");
            problems.push(problem.about(format!("line {}", row.line), "rows name no image"));
            return None;
        }
        let circle = self.parse_circle(row, problems);
        Some(PressRow {
            file: file.to_owned(),
            path: folder.join(file),
            line: row.line,
            circle,
            ball_radius_mm: self.parse_number(row, PressColumn::BallRadius, problems),
            mm_per_px: self.parse_pixel_size(row, problems),
        })
    }

    fn parse_pixel_size(&self, row: &TableRow, problems: &mut Diagnostics) -> Option<[f64; 2]> {
        let size = self.parse_number(row, PressColumn::PixelSize, problems);
        let sides = PIXEL_SIDES.map(|column| self.parse_number(row, column, problems));
        let cells = PIXEL_SIDES.map(|column| self.cell_index(column));
        if let [Some(x), Some(y)] = cells
            && row.cell(x).is_empty() != row.cell(y).is_empty()
        {
            let problem = row.error_in_cell(x, "half the size of a pixel").help(PIXEL_HELP);
            problems.push(problem.about(format!("line {}", row.line), "rows have half the size of a pixel"));
        }
        match (size, sides) {
            (Some(size), _) => Some([size; 2]),
            (None, [Some(x), Some(y)]) => Some([x, y]),
            _ => None,
        }
    }

    fn parse_circle(&self, row: &TableRow, problems: &mut Diagnostics) -> Option<Circle> {
        let [x, y, radius_px] = CIRCLE_COLUMNS.map(|column| self.parse_number(row, column, problems));
        // An absent column was reported once, for the table.
        let indices: Vec<usize> = CIRCLE_COLUMNS.iter().filter_map(|column| self.cell_index(*column)).collect();
        let (empty, given): (Vec<usize>, Vec<usize>) = indices.iter().partition(|index| row.cell(**index).is_empty());
        if indices.len() == CIRCLE_COLUMNS.len() && !given.is_empty() && !empty.is_empty() {
            let names: Vec<&str> = CIRCLE_COLUMNS
                .iter()
                .filter(|column| self.cell_index(**column).is_some_and(|at| empty.contains(&at)))
                .map(|c| c.name())
                .collect();
            let message = format!("half a circle: {} is empty", names.join(" and "));
            let problem = row.error_in_cell(given[0], message).help(CIRCLE_HELP);
            problems.push(problem.about(format!("line {}", row.line), "rows have half a circle"));
        }
        Some(Circle { centre_px: [x?, y?], radius_px: radius_px? })
    }

    /// Reads the number in a cell; None if there is none or it is not valid.
    fn parse_number(&self, row: &TableRow, column: PressColumn, problems: &mut Diagnostics) -> Option<f64> {
        let index = self.cell_index(column)?;
        let text = row.cell(index);
        if text.is_empty() {
            return None;
        }
        let name = column.name();
        let placed = matches!(column, PressColumn::CentreX | PressColumn::CentreY);
        let what = if placed { "a number" } else { "a number above 0" };
        // Empty cells are an alternative only for circles, which --detect can find if all three are empty.
        let or_none = if CIRCLE_COLUMNS.contains(&column) {
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
                let is_near = has_decimal_comma(text) || has_unit(text);
                let help = if is_near { String::from("write the number alone, with a point: 1.5") } else { or_none };
                (format!("`{name}`: `{text}` is not a number"), format!("rows have a `{name}` that is no number"), help)
            }
        };
        let subject = format!("line {} ({text})", row.line);
        problems.push(row.error_in_cell(index, message).about(subject, cause).help(help));
        None
    }
}

/// Returns true for a number such as `1,5`.
fn has_decimal_comma(text: &str) -> bool {
    text.contains(',') && text.replacen(',', ".", 1).parse::<f64>().is_ok_and(f64::is_finite)
}

/// Returns true for a number with its own unit, such as `4.0 mm`.
fn has_unit(text: &str) -> bool {
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+')));
    // With any other unit the number itself would have to change.
    let is_known = |unit: &str| matches!(unit.trim(), "mm" | "px" | "mm/px" | "pixel" | "pixels");
    end.is_some_and(|end| is_known(&text[end..]) && text[..end].parse::<f64>().is_ok())
}

/// Formats names as `a`, `b` and `c`.
fn join_names(names: &[&str]) -> String {
    join_alternatives(names).replace(" or ", " and ")
}

const PIXEL_HELP: &str =
    "write `mm_per_px` for square pixels; for others `mm_per_px_x` and `mm_per_px_y`, and then `radius_px` is along x";
const CIRCLE_HELP: &str = "a circle is `centre_x_px`, `centre_y_px` and `radius_px`: give all three or none";

#[cfg(test)]
mod tests;
