//! Tables of presses with measured forces, from a CSV file.
//!
//! Columns may stand in any order and are found by their names. Unknown ones are ignored, unless they look like a known
//! one that is absent: a misspelt column would be left out in silence.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::contact_curve::ForceIndenter;
use gelsim_files::csv_table::{self, TableRow, row_place};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::input;
use gelsim_files::source::{LineStarts, SourceText};
use gelsim_files::spelling::{find_nearest_name, join_alternatives};

/// Largest size of a table, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Most rows of a table.
const MAX_ROWS: usize = 200_000;
/// Radius of the contact over that of the visible disc where the table does not say: the middle of what was fitted to
/// real sensors.
pub const CONTACT_OVER_DISC: f64 = 0.95;
/// Share of a press's largest force up to which forces below 0 are noise of the gauge.
const NOISE_SHARE: f64 = 0.05;
/// Radii of balls and punches, mm.
const RADII_MM: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Radius of a contact over that of its ball from which on no press has it.
const WIDEST_CONTACT: f64 = 0.9;

/// One row: a moment of a press.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceRow {
    /// The row's line in the table, from 1.
    pub line: u64,
    /// Time within the press, s; increases from row to row. Known for all rows of a press or for none.
    pub time_s: Option<f64>,
    /// Indentation depth, mm, at least 0.
    pub depth_mm: Option<f64>,
    /// Radius of the contact, mm, above 0.
    pub contact_radius_mm: Option<f64>,
    /// Measured normal force, N; above 0 if the indenter is pressed.
    pub force_n: f64,
    /// Displacement of the indenter in the pad's plane since it was pressed in, mm.
    pub shear_mm: Option<f64>,
    /// Measured tangential force, N.
    pub shear_force_n: Option<f64>,
}

/// A press or a slide: rows in order of time.
#[derive(Clone, Debug, PartialEq)]
pub struct ForcePress {
    /// Its name in the table, or its image's, or `line 7`.
    pub name: String,
    /// What is pressed in.
    pub indenter: ForceIndenter,
    /// At least one row.
    pub rows: Vec<ForceRow>,
}

/// A table of at least one press.
#[derive(Clone, Debug)]
pub struct ForceTable {
    /// Path of the table.
    pub path: PathBuf,
    /// Presses in the order of their first rows.
    pub presses: Vec<ForcePress>,
    /// True if the table has the column `time_s`.
    pub has_times: bool,
    /// True if the table has a tangential force: a value in the column `shear_force_n`.
    pub has_shear: bool,
}

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    Press,
    File,
    BallRadius,
    PunchRadius,
    Depth,
    ContactRadius,
    ContactRadiusPx,
    DiscRadiusPx,
    ContactOverDisc,
    PixelSize,
    Force,
    Time,
    Shear,
    ShearForce,
}

/// Names of all columns, in the order of [`Column`].
const COLUMNS: [&str; 14] = [
    "press",
    "file",
    "ball_radius_mm",
    "punch_radius_mm",
    "depth_mm",
    "contact_radius_mm",
    "contact_radius_px",
    "radius_px",
    "contact_over_disc",
    "mm_per_px",
    "force_n",
    "time_s",
    "shear_mm",
    "shear_force_n",
];

/// Columns of other tables with presses, which are no slips of the keys.
const FOREIGN_COLUMNS: [&str; 2] = ["centre_x_px", "centre_y_px"];

/// Form of a table, for messages.
const TABLE_FORM: &str = "its first line is press,ball_radius_mm,depth_mm,force_n,time_s or has punch_radius_mm or \
     contact_radius_mm in their places, and each further line is a moment of a press";

/// Other names that people give to columns, the column that is meant, and what to change besides the name.
const ALIASES: [(&str, &str, &str); 40] = [
    ("trial", "press", ""),
    ("motion", "press", ""),
    ("press_id", "press", ""),
    ("ball_radius", "ball_radius_mm", ""),
    ("ball_mm", "ball_radius_mm", ""),
    ("ball_diameter_mm", "ball_radius_mm", " with half of its values"),
    ("punch_radius", "punch_radius_mm", ""),
    ("punch_diameter_mm", "punch_radius_mm", " with half of its values"),
    ("depth", "depth_mm", ""),
    ("depth_um", "depth_mm", " with 0.001 times its values"),
    ("depth_m", "depth_mm", " with 1000 times its values"),
    ("indentation_mm", "depth_mm", ""),
    ("indentation", "depth_mm", ""),
    ("contact_radius", "contact_radius_mm", ""),
    ("contact_diameter_mm", "contact_radius_mm", " with half of its values"),
    ("contact_diameter_px", "contact_radius_px", " with half of its values"),
    ("diameter_px", "radius_px", " with half of its values"),
    ("mm_per_pixel", "mm_per_px", ""),
    ("px_per_mm", "mm_per_px", " with 1 / its values"),
    ("force", "force_n", ""),
    ("fz", "force_n", ", with forces above 0 where the indenter is pressed"),
    ("fz_n", "force_n", ", with forces above 0 where the indenter is pressed"),
    ("normal_force_n", "force_n", ""),
    ("force_mn", "force_n", " with 0.001 times its values"),
    ("force_g", "force_n", " with 0.00981 times its values"),
    ("time", "time_s", ""),
    ("t", "time_s", ""),
    ("t_s", "time_s", ""),
    ("seconds", "time_s", ""),
    ("time_ms", "time_s", " with 0.001 times its values"),
    ("t_ms", "time_s", " with 0.001 times its values"),
    ("shear", "shear_mm", ""),
    ("slide_mm", "shear_mm", ""),
    ("displacement_mm", "shear_mm", ""),
    ("shear_um", "shear_mm", " with 0.001 times its values"),
    ("shear_force", "shear_force_n", ""),
    ("tangential_force_n", "shear_force_n", ""),
    ("fx_n", "shear_force_n", ", the length of the tangential force"),
    ("shear_n", "shear_force_n", ""),
    ("shear_force_mn", "shear_force_n", " with 0.001 times its values"),
];

impl Column {
    fn name(self) -> &'static str {
        COLUMNS[self as usize]
    }
}

/// Reads the table at `path`. On failure reports all mistakes at once.
pub fn read(path: &Path) -> Result<ForceTable, Report> {
    let bytes = input::read(path, MAX_BYTES).map_err(|error| {
        let message = format!("cannot read the table of forces {}: {error}", path.display());
        user_error(message, format!("name a CSV file: {TABLE_FORM}"))
    })?;
    parse(path, &bytes)
}

/// Reads a table from the bytes of the file `path`.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<ForceTable, Report> {
    let source = csv_table::decode_user_table(path, bytes)?;
    let mut problems = Diagnostics::default();
    let read = parse_source(&source, &mut problems);
    match read.filter(|_| problems.is_empty()) {
        Some((presses, layout)) => Ok(ForceTable {
            path: path.to_owned(),
            has_times: layout.has(Column::Time),
            has_shear: presses.iter().flat_map(|press| &press.rows).any(|row| row.shear_force_n.is_some()),
            presses,
        }),
        None => Err(Report::new(&problems, &[source])),
    }
}

fn parse_source(source: &SourceText, problems: &mut Diagnostics) -> Option<(Vec<ForcePress>, ColumnLayout)> {
    if let Some(problem) = csv_table::check_quotes(&source.text) {
        problems.push(problem);
        return None;
    }
    let mut rows = csv_table::iter_rows(&source.text);
    let Some(header) = rows.next() else {
        problems.push(Diagnostic::new(format!("{}: the table is empty", source.name)).help(TABLE_FORM));
        return None;
    };
    let layout = ColumnLayout::new(&header, problems)?;
    let mut presses: Vec<ForcePress> = Vec::new();
    let mut by_name: HashMap<String, usize> = HashMap::new();
    let (mut count, mut last) = (0, header);
    for row in rows {
        if problems.is_full() {
            break;
        }
        if count == MAX_ROWS {
            let problem = row.error_in_cell(0, format!("the table has more than {MAX_ROWS} rows"));
            problems.push(problem.help("keep every tenth row, or write fewer presses"));
            break;
        }
        if let Some((name, indenter, found)) = layout.parse_row(&row, problems) {
            let at = *by_name.entry(name.clone()).or_insert(presses.len());
            match presses.get_mut(at) {
                None => presses.push(ForcePress { name, indenter, rows: vec![found] }),
                Some(press) => {
                    check_order(press, &row, indenter, &found, &layout, problems);
                    press.rows.push(found);
                }
            }
        }
        count += 1;
        last = row;
    }
    if count == 0 && problems.is_empty() {
        let problem = last.error_in_cell(0, "no row follows the names of the columns");
        problems.push(problem.help("write a line for each moment of each press below it"));
    }
    check_signs(&presses, &source.text, problems);
    Some((presses, layout))
}

/// Reports what contradicts the row before it in the same press.
fn check_order(
    press: &ForcePress,
    row: &TableRow,
    indenter: ForceIndenter,
    found: &ForceRow,
    layout: &ColumnLayout,
    problems: &mut Diagnostics,
) {
    let name = &press.name;
    let subject = format!("line {}", row.line);
    if press.indenter != indenter {
        let message =
            format!("press `{name}` is with {}, and here with {}", press.indenter.describe(), indenter.describe());
        let problem = Diagnostic::new(message).at(row_place(row.text, row.start)).about(subject, "presses change it");
        problems.push(problem.help("give each press a name of its own, and one indenter"));
        return;
    }
    let cell = layout.place(Column::Time).unwrap_or_default();
    let last = press.rows.last().copied().unwrap_or_default();
    match (last.time_s, found.time_s) {
        (Some(before), Some(now)) if now <= before => {
            let problem = row.error_in_cell(cell, format!("`time_s` is {now} after {before} in press `{name}`"));
            let help = "sort the rows of each press by time, and give presses different names";
            problems.push(problem.about(subject, "rows are not in the order of their times").help(help));
        }
        (Some(_), None) | (None, Some(_)) => {
            let problem = row.error_in_cell(cell, format!("press `{name}` has times in some of its rows only"));
            let help = "give `time_s` in all rows of the press, or in none";
            problems.push(problem.about(subject, "rows lack `time_s` that others of their press have").help(help));
        }
        _ => {}
    }
}

/// Reports forces below 0 that are more than the noise of a gauge.
fn check_signs(presses: &[ForcePress], text: &str, problems: &mut Diagnostics) {
    let lines = LineStarts::find(text);
    for press in presses {
        let largest = press.rows.iter().map(|row| row.force_n.abs()).fold(0.0, f64::max);
        for row in press.rows.iter().filter(|row| row.force_n < -NOISE_SHARE * largest) {
            let message = format!("`force_n` is {}; it is above 0 where the indenter is pressed", row.force_n);
            let problem = Diagnostic::new(message).at(lines.place(row.line));
            let help = "turn the sign of the column, or remove the rows in which the indenter is pulled";
            problems.push(problem.about(format!("line {}", row.line), "rows have a force below 0").help(help));
            if problems.is_full() {
                return;
            }
        }
    }
}

/// Which cell of a row holds which column.
struct ColumnLayout {
    places: [Option<usize>; COLUMNS.len()],
    width: usize,
}

impl ColumnLayout {
    /// Reads the first row. None if it does not tell what the other rows hold.
    fn new(header: &TableRow, problems: &mut Diagnostics) -> Option<Self> {
        let names: Vec<String> = header.cells.iter().map(|name| name.trim().to_lowercase()).collect();
        let marks = [(";", "semicolons"), ("\t", "tabs"), (" ", "spaces")];
        if let [only] = names.as_slice()
            && let Some((_, marks)) = marks.into_iter().find(|(mark, _)| only.contains(mark))
        {
            let problem = header.error_in_cell(0, format!("the cells are separated by {marks} instead of commas"));
            problems.push(problem.help("separate them by commas, and write 1.5 with a point"));
            return None;
        }
        let places = COLUMNS.map(|column| names.iter().position(|name| name == column));
        let layout = Self { places, width: names.len() };
        let mut sound = true;
        for (at, name) in names.iter().enumerate() {
            if COLUMNS.contains(&name.as_str()) {
                if names.iter().position(|other| other == name) != Some(at) {
                    sound = false;
                    let problem = header.error_in_cell(at, format!("the column `{name}` is there twice"));
                    problems.push(problem.help("remove one"));
                }
            } else if let Some((meant, change)) = layout.guess_column(name) {
                sound = false;
                let problem = header.error_in_cell(at, format!("no column is called `{name}`"));
                problems
                    .push(problem.help(format!(
                        "call it `{meant}`{change}; or give it another name if something else is meant"
                    )));
            }
        }
        if !sound {
            return None;
        }
        let needed = [
            (vec![Column::Force], "the measured normal force, N"),
            (vec![Column::BallRadius, Column::PunchRadius], "the radius of the ball or of the flat punch, mm"),
            (
                vec![Column::Depth, Column::ContactRadius, Column::ContactRadiusPx, Column::DiscRadiusPx],
                "how deep or how wide each contact is",
            ),
        ];
        for (columns, what) in needed {
            if !columns.iter().any(|column| layout.has(*column)) {
                sound = false;
                let all: Vec<&str> = columns.iter().map(|column| column.name()).collect();
                let problem = header.error_in_cell(0, format!("no column is called {}", join_alternatives(&all)));
                problems.push(problem.help(format!("give {what}, in every row")));
            }
        }
        for needs in [Column::ContactRadiusPx, Column::DiscRadiusPx] {
            if layout.has(needs) && !layout.has(Column::PixelSize) && !layout.has(Column::Depth) {
                sound = false;
                let problem = header.error_in_cell(0, format!("no column is called `{}`", Column::PixelSize.name()));
                problems.push(problem.help(format!("`{}` needs the size of a pixel on the pad", needs.name())));
            }
        }
        sound.then_some(layout)
    }

    fn place(&self, column: Column) -> Option<usize> {
        self.places[column as usize]
    }

    fn has(&self, column: Column) -> bool {
        self.place(column).is_some()
    }

    /// Guesses which absent column an unknown name means, and what else to change.
    fn guess_column(&self, name: &str) -> Option<(&'static str, &'static str)> {
        let absent = |column: &str| {
            COLUMNS.iter().position(|known| *known == column).is_some_and(|at| self.places[at].is_none())
        };
        if let Some((_, column, change)) = ALIASES.iter().find(|(alias, ..)| *alias == name) {
            return absent(column).then_some((*column, *change));
        }
        let near = find_nearest_name(name, COLUMNS.into_iter().chain(FOREIGN_COLUMNS))?;
        let near = COLUMNS.iter().find(|column| **column == near)?;
        absent(near).then_some((*near, ""))
    }

    /// Reads a row. None if it is no moment of a press.
    fn parse_row(&self, row: &TableRow, problems: &mut Diagnostics) -> Option<(String, ForceIndenter, ForceRow)> {
        let (cells, width) = (row.cells.len(), self.width);
        if cells != width {
            let message = format!("the row has {cells} cells, and there are {width} columns");
            let help = "write a comma for each empty cell, a cell with a comma in quotes, and a name for each column";
            let problem = Diagnostic::new(message).at(row_place(row.text, row.start)).help(help);
            let cause = format!("rows have more or fewer cells than there are columns ({width})");
            problems.push(problem.about(format!("line {} ({cells})", row.line), cause));
            return None;
        }
        let before = problems.iter().count();
        let ball = self.parse_above_zero(row, Column::BallRadius, problems);
        let punch = self.parse_above_zero(row, Column::PunchRadius, problems);
        let depth_mm = self.parse_number(row, Column::Depth, Some(0.0), problems);
        let radii = [Column::ContactRadius, Column::ContactRadiusPx, Column::DiscRadiusPx]
            .map(|column| self.parse_above_zero(row, column, problems));
        let over_disc = self.parse_above_zero(row, Column::ContactOverDisc, problems);
        let mm_per_px = self.parse_above_zero(row, Column::PixelSize, problems);
        let force_n = self.parse_number(row, Column::Force, None, problems);
        let [time_s, shear_mm, shear_force_n] = [Column::Time, Column::Shear, Column::ShearForce]
            .map(|column| self.parse_number(row, column, None, problems));
        // What is wrong with single cells was said.
        if problems.iter().count() > before {
            return None;
        }
        let mut report = |message: String, cause: &str, help: &str| {
            let problem = Diagnostic::new(message).at(row_place(row.text, row.start)).help(help);
            problems.push(problem.about(format!("line {}", row.line), cause));
        };
        if let Some(radius_mm) = ball.or(punch).filter(|mm| !RADII_MM.contains(mm)) {
            let help = "write the radius in mm, from 0.01 to 1000";
            report(format!("an indenter of {radius_mm} mm radius is none"), "radii are out of range", help);
            return None;
        }
        let indenter = match (ball, punch) {
            (Some(radius_mm), None) => ForceIndenter::Ball { radius_mm },
            (None, Some(radius_mm)) => ForceIndenter::Punch { radius_mm },
            (None, None) => {
                let help = "give `ball_radius_mm` or `punch_radius_mm`, mm";
                report(String::from("the row has no indenter"), "rows have no indenter", help);
                return None;
            }
            (Some(_), Some(_)) => {
                let help = "leave `ball_radius_mm` or `punch_radius_mm` empty";
                report(String::from("the row has a ball and a punch"), "rows have two indenters", help);
                return None;
            }
        };
        let [in_mm, in_px, disc_px] = radii;
        if (in_px.or(disc_px).is_some() && in_mm.is_none()) && mm_per_px.is_none() {
            let help = "give `mm_per_px`, or the radius in mm: `contact_radius_mm`";
            report(String::from("the radius is in px, and `mm_per_px` is empty"), "rows lack `mm_per_px`", help);
            return None;
        }
        let over_disc = over_disc.unwrap_or(CONTACT_OVER_DISC);
        let contact_radius_mm =
            in_mm.or_else(|| Some(in_px? * mm_per_px?)).or_else(|| Some(disc_px? * over_disc * mm_per_px?));
        match indenter {
            ForceIndenter::Ball { radius_mm }
                if contact_radius_mm.is_some_and(|mm| mm > WIDEST_CONTACT * radius_mm) =>
            {
                let mm = contact_radius_mm.unwrap_or_default();
                let message = format!("a contact of {mm:.3} mm radius is as large as the ball of {radius_mm} mm");
                let help =
                    "check `ball_radius_mm`, `mm_per_px` and the radius of the contact, which is not its diameter";
                report(message, "contacts are as large as their balls", help);
                return None;
            }
            ForceIndenter::Punch { .. } if depth_mm.is_none() => {
                let help = "give `depth_mm`: the contact of a punch is as wide as the punch at every depth";
                report(String::from("the row of a punch has no depth"), "rows of a punch have no depth", help);
                return None;
            }
            _ if depth_mm.is_none() && contact_radius_mm.is_none() => {
                let help = "give `depth_mm` or the radius of the contact";
                report(
                    String::from("the row says not how deep the press is"),
                    "rows say not how deep presses are",
                    help,
                );
                return None;
            }
            _ => {}
        }
        let Some(force_n) = force_n else {
            report(String::from("`force_n` is empty"), "rows have no force", "give the measured normal force, N");
            return None;
        };
        let cell = |column: Column| self.place(column).map(|at| row.cell(at)).filter(|text| !text.is_empty());
        let name = cell(Column::Press).or_else(|| cell(Column::File).filter(|_| !self.has(Column::Press)));
        let name = match name {
            Some(name) => name.to_owned(),
            None if self.has(Column::Press) => {
                let help = "name the press in every row, or remove the column: then each row is a press";
                report(String::from("`press` is empty"), "rows name no press", help);
                return None;
            }
            None => format!("line {}", row.line),
        };
        let found = ForceRow {
            line: row.line,
            time_s,
            depth_mm,
            contact_radius_mm: contact_radius_mm.filter(|_| matches!(indenter, ForceIndenter::Ball { .. })),
            force_n,
            shear_mm,
            shear_force_n,
        };
        Some((name, indenter, found))
    }

    fn parse_above_zero(&self, row: &TableRow, column: Column, problems: &mut Diagnostics) -> Option<f64> {
        self.parse_number(row, column, Some(f64::MIN_POSITIVE), problems)
    }

    /// Reads the number in a cell; None if there is none or it is not valid.
    fn parse_number(
        &self,
        row: &TableRow,
        column: Column,
        least: Option<f64>,
        problems: &mut Diagnostics,
    ) -> Option<f64> {
        let index = self.place(column)?;
        let text = row.cell(index);
        if text.is_empty() {
            return None;
        }
        let name = column.name();
        // Sums of squares of larger numbers would not be finite.
        const MOST: f64 = 1e9;
        let bound = match least {
            None => "",
            Some(0.0) => " from 0 up",
            Some(_) => " above 0",
        };
        let (message, cause, help) = match text.parse::<f64>() {
            Ok(number) if number.abs() <= MOST && least.is_none_or(|least| number >= least) => return Some(number),
            Ok(number) if number.is_finite() && least.is_some_and(|least| number < least) => (
                format!("`{name}` is {text}; it must be{}", if least == Some(0.0) { " at least 0" } else { bound }),
                format!("rows have a `{name}` that is too small"),
                match column {
                    Column::Depth => String::from("remove the rows in which the indenter does not touch the pad yet"),
                    _ => format!("write a number{bound}"),
                },
            ),
            Ok(number) if number.is_finite() => (
                format!("`{name}` is {text}; nothing is so large"),
                format!("rows have a `{name}` that is too large"),
                format!("write a number{bound} in the unit of the column's name"),
            ),
            Ok(_) => (
                format!("`{name}` is {text}; it must be finite"),
                format!("rows have a `{name}` that is not finite"),
                format!("write a number{bound}, or remove the row"),
            ),
            Err(_) => (
                format!("`{name}`: `{text}` is not a number"),
                format!("rows have a `{name}` that is no number"),
                format!("write a number{bound} alone, with a point: 1.5"),
            ),
        };
        let subject = format!("line {} ({text})", row.line);
        problems.push(row.error_in_cell(index, message).about(subject, cause).help(help));
        None
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read_text(text: &str) -> Result<ForceTable, String> {
        parse(Path::new("presses.csv"), text.as_bytes()).map_err(|report| report.messages_with_help().join("\n"))
    }

    #[test]
    fn rows_of_a_press_belong_together_and_rows_without_names_are_presses() {
        let table = read_text(
            "time_s,press,ball_radius_mm,punch_radius_mm,depth_mm,force_n\n0,a,4,,0.1,0.2\n1,b,,2,0.1,0.2\n\
             2,a,4,,0.2,0.6\n",
        )
        .expect("a table");
        assert!(table.has_times && !table.has_shear);
        let shear_of = |cells: &str| {
            let text = format!("ball_radius_mm,depth_mm,force_n,shear_mm,shear_force_n\n4,0.1,0.2,{cells}\n");
            read_text(&text).expect("a table").has_shear
        };
        assert_eq!([shear_of(","), shear_of("0.1,0.05")], [false, true], "an empty column has no forces");
        let names: Vec<(&str, usize)> = table.presses.iter().map(|p| (p.name.as_str(), p.rows.len())).collect();
        assert_eq!(names, [("a", 2), ("b", 1)]);
        assert_eq!(table.presses[1].indenter, ForceIndenter::Punch { radius_mm: 2.0 });
        let table =
            read_text("file,ball_radius_mm,radius_px,mm_per_px,force_n\n1.png,4,20,0.05,0.5\n2.png,4,30,0.05,1\n");
        let table = table.expect("a table of circles");
        assert_eq!(table.presses[1].name, "2.png");
        let radius = table.presses[1].rows[0].contact_radius_mm.expect("a radius");
        assert!((radius - 30.0 * 0.05 * CONTACT_OVER_DISC).abs() < 1e-12);
    }

    #[test]
    fn mistakes_are_said_with_their_lines_and_a_way_out() {
        let head = "press,ball_radius_mm,punch_radius_mm,depth_mm,contact_radius_mm,force_n,time_s\n";
        for (rows, words) in [
            ("a,4,,0.1,,x,0\n", "`force_n`: `x` is not a number"),
            ("a,4,,0.1,,nan,0\n", "must be finite"),
            ("a,4,,-0.1,,1,0\n", "must be at least 0"),
            ("a,0,,0.1,,1,0\n", "must be above 0"),
            ("a,4,,0.1,,-1,0\n", "turn the sign"),
            ("a,4,2,0.1,,1,0\n", "a ball and a punch"),
            ("a,4000,,0.1,,1,0\n", "from 0.01 to 1000"),
            ("a,,,0.1,,1,0\n", "no indenter"),
            ("a,4,,,,1,0\n", "how deep"),
            ("a,,2,,0.5,1,0\n", "punch has no depth"),
            ("a,4,,,3.9,1,0\n", "as large as the ball"),
            ("a,4,,0.1,,1,1\na,4,,0.2,,2,1\n", "`time_s` is 1 after 1"),
            ("a,4,,0.1,,1,1\na,4,,0.2,,2,\n", "some of its rows"),
            ("a,4,,0.1,,1,1\na,5,,0.2,,2,2\n", "here with a ball of 5 mm"),
            ("a,4,,0.1,,,1\n", "`force_n` is empty"),
            (",4,,0.1,,1,1\n", "`press` is empty"),
            ("a,4,,0.1,,1\n", "6 cells, and there are 7 columns"),
            ("a,4,,0.1,,1e300,1\n", "nothing is so large"),
            ("\"a,4,,0.1,,1,1\n", "never closed"),
            ("", "no row follows"),
        ] {
            let said = read_text(&format!("{head}{rows}")).expect_err(rows);
            assert!(said.contains(words), "{rows}: {said}");
        }
        for (text, words) in [
            ("", "the table is empty"),
            ("ball_radius_mm,depth_mm,force\n4,0.1,1\n", "call it `force_n`"),
            ("ball_radius_mm,depth_mm,force_n,tims_s\n4,0.1,1,2\n", "call it `time_s`"),
            ("ball_radius_mm,depth_mm,force_n,time_ms\n4,0.1,1,2\n", "call it `time_s` with 0.001 times its values"),
            ("ball_radius_mm;depth_mm;force_n\n4;0.1;1\n", "semicolons"),
            ("depth_mm,force_n\n0.1,1\n", "`ball_radius_mm` or `punch_radius_mm`"),
            ("ball_radius_mm,radius_px,force_n\n4,10,1\n", "no column is called `mm_per_px`"),
            ("ball_radius_mm,depth_mm,force_n,force_n\n4,0.1,1,1\n", "there twice"),
        ] {
            let said = read_text(text).expect_err(text);
            assert!(said.contains(words), "{text}: {said}");
        }
        let centred = "file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px,force_n\na.png,1,2,9,4,0.1,1\n";
        assert!(read_text(centred).is_ok(), "columns of the light's table are no slips");
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(
            text in "[a-z_,0-9.\n\"\r-]{0,200}",
            rows in prop::collection::vec("[-0-9.e,a\" ]{0,30}", 0..6),
        ) {
            let _ = read_text(&text);
            let _ = read_text(&format!("press,ball_radius_mm,depth_mm,force_n,time_s\n{}", rows.join("\n")));
        }
    }
}
