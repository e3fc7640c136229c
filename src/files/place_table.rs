//! Reads places from a CSV table: pins inside a gel, or dots printed on a pad.

use std::path::Path;

use crate::csv_table::{self, TableRow};

/// Greatest coordinate, mm.
const MAX_POSITION_MM: f64 = 1e4;
/// Most places in a table.
const MAX_PLACES: usize = 10_000;
/// Mistakes that are described; further ones are counted.
const MAX_DESCRIBED: usize = 8;

/// A row of a table of places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceRow {
    /// The columns `x_mm` and `y_mm`.
    pub at_mm: [f64; 2],
    /// The column `diameter_mm`; `None` if the cell is empty or there is no such column.
    pub diameter_mm: Option<f64>,
    /// The line on which the row begins, from 1.
    line: u64,
}

/// What a table holds.
#[derive(Clone, Copy, Debug)]
pub struct PlaceKind {
    /// One of them, such as `pin`.
    pub name: &'static str,
    /// Largest diameter in a column `diameter_mm`, mm; `None` if the table has no such column.
    pub max_diameter_mm: Option<f64>,
    /// Whether two at one place are refused.
    pub is_distinct: bool,
}

/// Reads a table of places. The errors name line and column, and say what to do.
pub fn parse_places(path: &str, bytes: &[u8], kind: PlaceKind) -> Result<Vec<PlaceRow>, Vec<String>> {
    let PlaceKind { name, max_diameter_mm, is_distinct } = kind;
    let source = match csv_table::decode_source(Path::new(path), bytes) {
        Ok(source) => source,
        Err(report) => {
            let said = report.problems().iter().map(|problem| {
                let at = report.format_place(problem).unwrap_or_else(|| path.to_owned());
                let help = problem.help.as_deref().unwrap_or_default();
                format!("{at}: {}; {help}", problem.full_message())
            });
            return Err(said.collect());
        }
    };
    let mut mistakes = Vec::new();
    let mut report = |row: &TableRow<'_>, cell: usize, what: String| {
        let place = csv_table::cell_place(row.text, row.start, cell);
        let column = row.text[row.start.min(place.start)..place.start].chars().count() + 1;
        mistakes.push(format!("{path}:{}:{column}: {what}", row.line));
    };
    let mut rows = csv_table::iter_rows(&source.text);
    let Some(header) = rows.next() else { return Err(vec![format!("{path}: the table of {name}s is empty")]) };
    let named = |name: &str| (0..header.cells.len()).find(|cell| header.cell(*cell) == name);
    let (Some(x), Some(y)) = (named("x_mm"), named("y_mm")) else {
        let semicolons = header.cells.len() == 1 && header.cell(0).contains(';');
        let why = if semicolons { ": its cells are separated by `;`, save it with commas" } else { "" };
        report(&header, 0, format!("the first line names no columns x_mm and y_mm{why}"));
        return Err(mistakes);
    };
    let size = max_diameter_mm.and_then(|most| Some((named("diameter_mm")?, most)));
    let mut found: Vec<PlaceRow> = Vec::new();
    for row in rows {
        if found.len() == MAX_PLACES {
            report(&row, 0, format!("more than {MAX_PLACES} {name}s: leave out this row and those below it"));
            break;
        }
        let mut place = PlaceRow { at_mm: [0.0; 2], diameter_mm: None, line: row.line };
        for (at_mm, cell) in place.at_mm.iter_mut().zip([x, y]) {
            match row.cell(cell).parse::<f64>() {
                Ok(mm) if mm.abs() <= MAX_POSITION_MM => *at_mm = mm + 0.0,
                _ => report(&row, cell, format!("`{}` is no place of a {name} in mm", row.cell(cell))),
            }
        }
        if let Some((cell, most)) = size.filter(|(cell, _)| !row.cell(*cell).is_empty()) {
            match row.cell(cell).parse::<f64>() {
                Ok(mm) if mm > 0.0 && mm <= most => place.diameter_mm = Some(mm),
                _ => {
                    let what = format!("`{}` is no diameter of a {name}", row.cell(cell));
                    report(&row, cell, format!("{what}: above 0, up to {most} mm"));
                }
            }
        }
        found.push(place);
    }
    // A wrong cell is no place, so that places are compared only if all cells are right.
    if mistakes.is_empty() && is_distinct {
        let mut sorted = found.clone();
        sorted.sort_by(|a, b| {
            let [[ax, ay], [bx, by]] = [a.at_mm, b.at_mm];
            ax.total_cmp(&bx).then(ay.total_cmp(&by)).then(a.line.cmp(&b.line))
        });
        let mut doubles: Vec<[PlaceRow; 2]> =
            sorted.windows(2).filter(|pair| pair[0].at_mm == pair[1].at_mm).map(|pair| [pair[0], pair[1]]).collect();
        doubles.sort_by_key(|[_, second]| second.line);
        mistakes.extend(doubles.into_iter().map(|[first, second]| {
            format!(
                "{path}:{}:1: the {name} at {:?} mm is on line {}, too: leave one of them out",
                second.line, second.at_mm, first.line
            )
        }));
    }
    if mistakes.len() > MAX_DESCRIBED {
        let more = mistakes.len() - MAX_DESCRIBED;
        mistakes.truncate(MAX_DESCRIBED);
        mistakes.push(format!("{path}: {more} more mistakes of these kinds"));
    }
    match (mistakes.is_empty(), found.is_empty()) {
        (true, false) => Ok(found),
        (true, true) => Err(vec![format!("{path}: the table has no {name}s")]),
        (false, _) => Err(mistakes),
    }
}
