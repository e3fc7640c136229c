//! Reads calibration folders of other programs as tables of presses.
//!
//! gs_sdk (github.com/joehjhuang/gs_sdk) has `catalog.csv` with the columns `experiment_reldir` and `diameter(mm)`, in
//! each such folder `gelsight.png` and `label.npz` (`center`: column and row, `radius`: of the visible disc, all px),
//! and `background.png`. Millimetres per pixel are `ppmm` of its configuration.
//!
//! py3DCal (github.com/rohankotanu/py3DCal) has `annotations/probe_data.csv` with the columns `img_name`, `x_mm`,
//! `y_mm` and `penetration_depth_mm`, and, once it is annotated, `annotations/annotations.csv` with `x_px` and `y_px`
//! besides and `annotations/metadata.json` with `px_per_mm` and `probe_radius_mm`. Images are in `probe_images`, that
//! of the untouched pad is `blank_images/blank.png`. It records no disc: it takes discs to be as wide as the probe.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use gelsim_files::csv_table::{self, TableRow};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::input;
use gelsim_files::npz::Npz;
use gelsim_files::source::{LineStarts, SourceText};
use serde::Deserialize;

use super::{COLUMNS, Circle, MAX_BYTES, MAX_PRESSES, PressRow, PressTable, TABLE_FORM, report_repetition};

/// What the user says in place of the folder.
#[derive(Clone, Copy, Debug, Default)]
pub struct GivenFacts {
    /// Width and height of a pixel on the pad.
    pub mm_per_px: Option<f64>,
    /// Radius of the ball.
    pub ball_radius_mm: Option<f64>,
    /// Whether the untouched pad is known without the folder's image of it.
    pub has_background: bool,
    /// Whether a sensor file tells the size of a pixel where nothing else does.
    pub has_sensor: bool,
}

/// Reads the table at `path`, or the calibration folder of another program. On failure reports all mistakes at once.
pub fn read(path: &Path, given: GivenFacts) -> Result<PressTable, Report> {
    if !path.is_dir() {
        let flags = [("--mm-per-px", given.mm_per_px), ("--ball-radius-mm", given.ball_radius_mm)];
        return match flags.into_iter().find(|(_, value)| value.is_some()) {
            Some((flag, _)) => {
                let message = format!("{flag} is for folders, and {} is none", path.display());
                Err(user_error(message, "leave it out, and write the number into every row of the table"))
            }
            None => super::read(path),
        };
    }
    let has = |name: &str| path.join(name).exists();
    match (has(CATALOG), has("annotations") || has("probe_images")) {
        (true, false) => read_gs_sdk(path, given),
        (false, true) => read_py3dcal(path, given),
        (true, true) => {
            let message = format!("{} has files of gs_sdk ({CATALOG}) and of py3DCal (annotations)", path.display());
            Err(user_error(message, "move those of one of the two into another folder"))
        }
        (false, false) => {
            let message = format!("{} is no folder of gs_sdk ({CATALOG}) or py3DCal (annotations)", path.display());
            Err(user_error(message, format!("name such a folder, or a CSV file: {TABLE_FORM}")))
        }
    }
}

const CATALOG: &str = "catalog.csv";

fn read_gs_sdk(folder: &Path, given: GivenFacts) -> Result<PressTable, Report> {
    let mut table = FolderTable::open(folder, CATALOG)?;
    let mm_per_px = given.mm_per_px.or_else(|| find_ppmm(folder));
    if mm_per_px.is_none() && !given.has_sensor {
        let problem = Diagnostic::new(format!("{}: nothing says how wide a pixel is", folder.display()));
        let help = "give --mm-per-px with `ppmm` of gs_sdk's configuration (examples/configs/gsmini.yaml)";
        table.problems.push(problem.help(help));
    }
    if given.ball_radius_mm.is_some() {
        let problem =
            Diagnostic::new(format!("{CATALOG} has the diameter of each ball, and --ball-radius-mm is given"));
        table.problems.push(problem.help("leave --ball-radius-mm out"));
    }
    table.check_background("background.png", given);
    let help = "only folders of balls are read: the first line is experiment_reldir,diameter(mm)";
    let presses = table.read_rows(["experiment_reldir", "diameter(mm)"], help, |row, [place, diameter], problems| {
        // Catalogues that were written on Windows.
        let place_in_folder = row.cell(place).replace('\\', "/");
        let path = folder.join(&place_in_folder);
        let diameter_mm = parse_number(row, diameter, "diameter(mm)", true, problems);
        let label = path.join("label.npz");
        let circle = label.exists().then(|| read_label(&label)).transpose().unwrap_or_else(|reason| {
            let problem = row.error_in_cell(place, format!("{}: {reason}", label.display()));
            let problem = problem.about(label.display().to_string(), "labels cannot be read");
            problems.push(problem.help("label the image again in gs_sdk"));
            None
        });
        Some(PressRow {
            file: format!("{place_in_folder}/gelsight.png"),
            path: path.join("gelsight.png"),
            line: row.line,
            circle,
            ball_radius_mm: diameter_mm.map(|diameter| 0.5 * diameter),
            mm_per_px: mm_per_px.map(|mm| [mm; 2]),
        })
    });
    table.finish(presses, "label the image in gs_sdk (its label.npz is missing)", Vec::new())
}

/// Reads the circle of a label.
fn read_label(path: &Path) -> Result<Circle, String> {
    let archive = Npz::read(path)?;
    let [center, radius] = [archive.read_array("center")?, archive.read_array("radius")?];
    match (center.values.as_slice(), radius.values.as_slice()) {
        (&[x, y], &[radius_px]) if x.is_finite() && y.is_finite() && radius_px.is_finite() && radius_px > 0.0 => {
            Ok(Circle { centre_px: [x, y], radius_px })
        }
        (center, radius) => Err(format!("center {center:?} and radius {radius:?} are no circle")),
    }
}

/// Finds millimetres per pixel in a configuration of gs_sdk that lies in the folder; `None` if there is not just one.
fn find_ppmm(folder: &Path) -> Option<f64> {
    let is_yaml = |path: &PathBuf| path.extension().is_some_and(|end| end == "yaml" || end == "yml");
    let files = folder.read_dir().ok()?.filter_map(|entry| Some(entry.ok()?.path())).filter(is_yaml);
    let texts = files.filter_map(|path| String::from_utf8(input::read(&path, MAX_BYTES).ok()?).ok());
    let numbers = texts.filter_map(|text| {
        let value = text.lines().find_map(|line| line.strip_prefix("ppmm:"))?;
        let number = value.split('#').next()?.trim().parse::<f64>().ok()?;
        (number.is_finite() && number > 0.0).then_some(number)
    });
    match numbers.collect::<Vec<_>>().as_slice() {
        [only] => Some(*only),
        _ => None,
    }
}

/// Content of `metadata.json` of py3DCal.
#[derive(Deserialize, Default)]
struct Metadata {
    px_per_mm: Option<f64>,
    probe_radius_mm: Option<f64>,
}

fn read_py3dcal(folder: &Path, given: GivenFacts) -> Result<PressTable, Report> {
    const ANNOTATED: &str = "annotations/annotations.csv";
    let probed = "annotations/probe_data.csv";
    let is_annotated = folder.join(ANNOTATED).exists() || !folder.join(probed).exists();
    let mut table = FolderTable::open(folder, if is_annotated { ANNOTATED } else { probed })?;
    let path = folder.join("annotations/metadata.json");
    let metadata = match input::read_if_exists(&path, MAX_BYTES) {
        Ok(None) => Ok(Metadata::default()),
        Ok(Some(bytes)) => serde_json::from_slice(&bytes).map_err(|error| error.to_string()),
        Err(error) => Err(error.to_string()),
    };
    let metadata = metadata.unwrap_or_else(|reason| {
        let problem = Diagnostic::new(format!("cannot read {}: {reason}", path.display()));
        table.problems.push(problem.help("annotate the folder again in py3DCal, or remove the file"));
        Metadata::default()
    });
    let mut number = |flag: &str, given: Option<f64>, key: &str, found: Option<f64>| {
        let known = given.or(found.filter(|value| value.is_finite() && *value > 0.0));
        if known.is_none() {
            let what = if found.is_some() { "is no number above 0" } else { "is missing" };
            let problem = Diagnostic::new(format!("{}: `{key}` {what}", path.display()));
            table.problems.push(problem.help(format!("give {flag}")));
        }
        known
    };
    let radius_mm = number("--ball-radius-mm", given.ball_radius_mm, "probe_radius_mm", metadata.probe_radius_mm);
    let mm_per_px = number("--mm-per-px", given.mm_per_px, "px_per_mm", metadata.px_per_mm.map(f64::recip));
    table.check_background("blank_images/blank.png", given);

    let (mut places, mut repeated) = (HashSet::new(), 0);
    let mut press = |row: &TableRow, image: usize, place: [usize; 3], depth_mm: Option<f64>, px: [Option<f64>; 2]| {
        // Frames of one place show the same press.
        if !places.insert(place.map(|column| row.cell(column).to_owned())) {
            repeated += 1;
            return None;
        }
        // A probe that is pressed in by less than its radius shows a smaller disc.
        let is_wide = radius_mm.zip(depth_mm).is_some_and(|(radius, depth)| depth.abs() >= radius);
        let circle = match (px, radius_mm, mm_per_px) {
            ([Some(x), Some(y)], Some(radius), Some(mm)) if is_wide => {
                Some(Circle { centre_px: [x, y], radius_px: radius / mm })
            }
            _ => None,
        };
        Some(PressRow {
            file: format!("probe_images/{}", row.cell(image)),
            path: folder.join("probe_images").join(row.cell(image)),
            line: row.line,
            circle,
            ball_radius_mm: radius_mm,
            mm_per_px: mm_per_px.map(|mm| [mm; 2]),
        })
    };
    let help = "probe and annotate the pad again in py3DCal 1.1";
    let presses = if is_annotated {
        let columns = ["img_name", "x_mm", "y_mm", "penetration_depth_mm", "x_px", "y_px"];
        table.read_rows(columns, help, |row, [image, x_mm, y_mm, depth, x, y], problems| {
            let depth_mm = parse_number(row, depth, "penetration_depth_mm", false, problems);
            let px = [(x, "x_px"), (y, "y_px")].map(|(cell, name)| parse_number(row, cell, name, false, problems));
            press(row, image, [x_mm, y_mm, depth], depth_mm, px)
        })
    } else {
        let columns = ["img_name", "x_mm", "y_mm", "penetration_depth_mm"];
        table.read_rows(columns, help, |row, [image, x_mm, y_mm, depth], _| {
            press(row, image, [x_mm, y_mm, depth], None, [None; 2])
        })
    };
    let note = (repeated > 0).then(|| {
        let message = format!("{}: {repeated} images of places that earlier rows have are left out", table.source.name);
        Diagnostic::note(message).help("images of one place and depth show the same press: one is enough")
    });
    let advice = if is_annotated {
        "leave out rows of less depth than the probe's radius, where py3DCal does not say how wide the disc is"
    } else {
        "annotate the folder in py3DCal"
    };
    table.finish(presses, advice, note.into_iter().collect())
}

/// The table in a folder, and what is wrong in the folder.
struct FolderTable<'a> {
    folder: &'a Path,
    path: PathBuf,
    source: SourceText,
    background: PathBuf,
    problems: Diagnostics,
}

impl<'a> FolderTable<'a> {
    fn open(folder: &'a Path, name: &str) -> Result<Self, Report> {
        let (path, mut problems) = (folder.join(name), Diagnostics::default());
        let bytes = input::read(&path, MAX_BYTES).unwrap_or_else(|error| {
            let problem = Diagnostic::new(format!("cannot read {}: {error}", path.display()));
            problems.push(problem.help("name a complete folder: this file lists its images"));
            Vec::new()
        });
        let source = csv_table::decode_user_table(&path, &bytes)?;
        Ok(Self { folder, path, source, background: PathBuf::new(), problems })
    }

    fn check_background(&mut self, name: &str, given: GivenFacts) {
        self.background = self.folder.join(name);
        if !given.has_background && !self.background.is_file() {
            let problem = Diagnostic::new(format!("{} is missing", self.background.display()));
            self.problems.push(problem.help("name an image of the untouched pad with --background"));
        }
    }

    /// Reads the rows below the names of the columns. `read` gets a row and the cells of the columns.
    fn read_rows<const N: usize>(
        &mut self,
        columns: [&str; N],
        help: &str,
        mut read: impl FnMut(&TableRow, [usize; N], &mut Diagnostics) -> Option<PressRow>,
    ) -> Vec<PressRow> {
        let (mut presses, mut seen) = (Vec::new(), HashMap::new());
        let mut rows = csv_table::iter_rows(&self.source.text);
        let Some(header) = rows.next() else {
            if self.path.is_file() {
                self.problems.push(Diagnostic::new(format!("{}: the table is empty", self.source.name)).help(help));
            }
            return presses;
        };
        let cells = columns.map(|name| header.cells.iter().position(|cell| cell.trim() == name));
        for (name, _) in columns.iter().zip(cells).filter(|(_, cell)| cell.is_none()) {
            self.problems.push(header.error_in_cell(0, format!("no column is called `{name}`")).help(help));
        }
        let cells = cells.map(|cell| cell.unwrap_or(usize::MAX));
        if cells.contains(&usize::MAX) {
            return presses;
        }
        for row in rows {
            if self.problems.is_full() {
                break;
            }
            if presses.len() == MAX_PRESSES {
                let problem = row.error_in_cell(cells[0], format!("more than {MAX_PRESSES} presses"));
                self.problems.push(problem.help("remove rows"));
                break;
            }
            if row.cell(cells[0]).is_empty() {
                let problem = row.error_in_cell(cells[0], format!("`{}` is empty", columns[0]));
                self.problems.push(problem.help("remove the row"));
            } else if let Some(press) = read(&row, cells, &mut self.problems) {
                self.problems.extend(report_repetition(&mut seen, &press, &row, cells[0]));
                presses.push(press);
            }
        }
        if presses.is_empty() && self.problems.is_empty() {
            let problem = header.error_in_cell(0, "no row follows the names of the columns");
            self.problems.push(problem.help("take images of presses first"));
        }
        presses
    }

    fn finish(
        self,
        presses: Vec<PressRow>,
        circle_advice: &'static str,
        notes: Vec<Diagnostic>,
    ) -> Result<PressTable, Report> {
        if !self.problems.is_empty() {
            return Err(Report::new(&self.problems, &[self.source]));
        }
        Ok(PressTable {
            path: self.path,
            presses,
            background: Some(self.background),
            notes,
            circle_advice,
            lines: LineStarts::find(&self.source.text),
            source: self.source,
            unknown: Vec::new(),
            columns: [true; COLUMNS.len()],
        })
    }
}

/// Reads the number in a cell; `None`, with a message, if it is not valid.
fn parse_number(row: &TableRow, cell: usize, name: &str, is_size: bool, problems: &mut Diagnostics) -> Option<f64> {
    let text = row.cell(cell);
    if let Some(number) = text.parse::<f64>().ok().filter(|number| number.is_finite() && (!is_size || *number > 0.0)) {
        return Some(number);
    }
    let what = if is_size { "a number above 0" } else { "a number" };
    let problem = row.error_in_cell(cell, format!("`{name}`: `{text}` is not {what}"));
    let problem =
        problem.about(format!("line {} ({text})", row.line), format!("rows have a `{name}` that is not {what}"));
    problems.push(problem.help(format!("write {what}, or remove the row")));
    None
}
