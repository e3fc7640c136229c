//! Turns a calibration that GelSight publishes of a device (gelsightinc/gssim) into a sensor file.
//!
//! It consists of a YAML file and the image of the flat field that it names. From the YAML come `nL`, `width`,
//! `height`, `mmperpixel`; `quadfit`, a row for each term of the place (x^2, x y, y^2, x, y, 1) and ten columns for
//! each lamp; the last row of `linfit`, which says where the lamps are; and `flatfield`. The published code sums up
//! `quadfit` as [`gelsim_core::optics::lamps`] describes, and divides by a correction, `scale` / flat field. The image
//! holds the flat fields of the lamps as tiles, three in a row. Here each is divided by its scale and fitted by a
//! polynomial of fourth degree, so that a sensor file needs no image.
//!
//! The published code counts columns and rows from 0 but the middle from 1, so its places are off by one pixel of the
//! full image. Ours are not; this changes grey levels by less than a tenth.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::Path;

use nalgebra::{SMatrix, SVector};

use gelsim_core::optics::lamps::{COEFFICIENTS, FLAT_FIELD_TERMS, LAMP_COUNT, Lamp, PLACE_TERMS};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::foreign::decode_text;
use gelsim_files::source::{SourceSpan, SourceText};
use gelsim_files::{input, png};

/// Largest YAML file, bytes.
const MAX_YAML_BYTES: u64 = 1 << 20;
/// Pixels of the device's image per pixel of ours, in each direction.
const REDUCTION: f64 = 4.0;
/// Widest and highest image of a device, px.
const MAX_IMAGE_PX: f64 = 32768.0;
/// Darkest value of a flat field, as in the published code.
const DARKEST: f64 = 1.0 / 255.0;
/// Smallest side of a tile: a polynomial of fourth degree needs more pixels than terms.
const SMALLEST_TILE: f64 = 8.0;

/// Contents of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct GelsightImport {
    /// Name of the file without its ending.
    pub name: String,
    /// Width and height of the sensor's image, px: a quarter of the device's.
    pub resolution_px: [u32; 2],
    /// Width and height of the part of the pad in view, mm.
    pub field_of_view_mm: [f64; 2],
    /// The lamps, in the order of the file.
    pub lamps: Vec<Lamp>,
    /// Residuals of the polynomials of the lamps' flat fields, or why there is no image.
    pub flat_field: Result<Vec<FitResidual>, String>,
}

/// Residual of a polynomial against a flat field, grey levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitResidual {
    /// Root mean square.
    pub rms: f64,
    /// Largest residual.
    pub most: f64,
}

/// Reads the calibration at `path`. On failure returns everything that is wrong in it.
pub fn import_gelsight_yaml(path: &Path) -> Result<GelsightImport, Report> {
    let shown = path.display().to_string();
    let text = input::read(path, MAX_YAML_BYTES).map_err(|error| error.to_string());
    let text = text.and_then(decode_text);
    let text = text.map_err(|reason| {
        gelsim_files::diagnostic::user_error(
            format!("cannot read {shown}: {reason}"),
            "name the YAML file of a device, as GelSight publishes them (gelsightinc/gssim, devices/)",
        )
    })?;
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let source = SourceText { name: shown, text, folder: folder.clone() };
    let mut yaml = YamlLines::new(&source.text);
    let device = DeviceCalibration::read(&mut yaml);
    let mut problems = yaml.problems;
    let flat_field = device.as_ref().map(|device| match &device.flat_field {
        None => Ok(Err(String::from("the calibration has none"))),
        Some(flat_field) => fit_flat_fields(flat_field, &folder),
    });
    let fitted = match flat_field {
        Some(Ok(fitted)) => Some(fitted),
        Some(Err((message, help))) => {
            let place = device.as_ref().and_then(|device| device.flat_field.as_ref()).map(|own| own.file_place);
            problems.push(Diagnostic::new(message).at(place).help(help));
            None
        }
        None => None,
    };
    let (Some(device), Some(fitted), true) = (device, fitted, problems.is_empty()) else {
        return Err(Report::new(&problems, &[source]));
    };
    let DeviceCalibration { size_px, mm_per_px, quadratics, azimuths, .. } = device;
    let even = {
        let mut even = [0.0; FLAT_FIELD_TERMS];
        even[0] = 1.0;
        even
    };
    let colors = lamp_colors(&azimuths);
    let lamps = (0..LAMP_COUNT).map(|k| Lamp {
        name: char::from(b'A' + k as u8).to_string(),
        color: colors[k],
        quadratic: quadratics[k],
        flat_field: fitted.as_ref().map_or(even, |fitted| fitted[k].0),
    });
    Ok(GelsightImport {
        name: path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
        resolution_px: size_px.map(|px| libm::round(px / REDUCTION).max(1.0) as u32),
        field_of_view_mm: size_px.map(|px| libm::round(1e4 * px * mm_per_px) / 1e4),
        lamps: lamps.collect(),
        flat_field: fitted.map(|fitted| fitted.into_iter().map(|(_, left)| left).collect()),
    })
}

/// Values read from the YAML.
struct DeviceCalibration {
    size_px: [f64; 2],
    mm_per_px: f64,
    quadratics: Vec<[[f64; PLACE_TERMS]; COEFFICIENTS]>,
    /// Azimuth of each lamp, rad, from +x (right) towards +y (down).
    azimuths: Vec<f64>,
    flat_field: Option<FlatField>,
}

struct FlatField {
    file: String,
    file_place: SourceSpan,
    tile_px: [usize; 2],
    scale: Vec<f64>,
}

impl DeviceCalibration {
    /// Reads the values. `None` after a mistake.
    fn read(yaml: &mut YamlLines<'_>) -> Option<Self> {
        let lamps = yaml.read_number("", "nL", LAMP_COUNT as f64..=LAMP_COUNT as f64);
        let size_px = ["width", "height"].map(|key| yaml.read_number("", key, 1.0..=MAX_IMAGE_PX));
        let mm_per_px = yaml.read_number("", "mmperpixel", 1e-6..=1.0);
        let quadratics = yaml.read_matrix("quadfit", COEFFICIENTS * LAMP_COUNT).map(|matrix| lamp_quadratics(&matrix));
        let azimuths = yaml.read_matrix("linfit", 3 * LAMP_COUNT).map(|matrix| {
            let last = matrix.last().cloned().unwrap_or_default();
            last.as_chunks::<3>().0.iter().map(|[x, y, _]| libm::atan2(*y, *x)).collect()
        });
        let flat_field = if yaml.has_section("flatfield") { FlatField::read(yaml).map(Some) } else { Some(None) };
        lamps?;
        let [Some(width), Some(height)] = size_px else { return None };
        Some(Self {
            size_px: [width, height],
            mm_per_px: mm_per_px?,
            quadratics: quadratics?,
            azimuths: azimuths?,
            flat_field: flat_field?,
        })
    }
}

impl FlatField {
    fn read(yaml: &mut YamlLines<'_>) -> Option<Self> {
        let file = yaml.read_text("flatfield", "modelfile");
        let tile = yaml.read_list("flatfield", "modelsize", 2, SMALLEST_TILE..=MAX_IMAGE_PX / REDUCTION);
        let scale = yaml.read_list("flatfield", "scale", LAMP_COUNT, DARKEST..=1.0);
        let (file, file_place) = file?;
        let tile = tile?;
        Some(Self { file, file_place, tile_px: [tile[0] as usize, tile[1] as usize], scale: scale? })
    }
}

/// Converts the quadratics of all lamps; `matrix` has a row for each term of the place.
fn lamp_quadratics(matrix: &[Vec<f64>]) -> Vec<[[f64; PLACE_TERMS]; COEFFICIENTS]> {
    // Our terms are 1, y, y^2, x, x y, x^2; theirs end with x, y and 1, and may have only the last one or three.
    const FROM_THE_LAST: [usize; PLACE_TERMS] = [0, 1, 3, 2, 4, 5];
    let term = |column: usize, from_the_last: usize| {
        matrix.len().checked_sub(from_the_last + 1).map_or(0.0, |row| matrix[row][column])
    };
    let of = |lamp: usize| {
        std::array::from_fn(|m| FROM_THE_LAST.map(|from_the_last| term(lamp * COEFFICIENTS + m, from_the_last)))
    };
    (0..LAMP_COUNT).map(of).collect()
}

/// Assigns the lamps to red, green and blue in pairs of neighbours: the pair nearest to the upper edge is red, then
/// clockwise green and blue. So the composite shows colours from three sides, as a sensor with coloured LEDs does.
fn lamp_colors(azimuths: &[f64]) -> Vec<[f64; 3]> {
    let mut order: Vec<usize> = (0..azimuths.len()).collect();
    order.sort_by(|a, b| azimuths[*a].total_cmp(&azimuths[*b]));
    let count = order.len();
    let upwards = |first: usize| {
        // Largest if both lie towards the upper edge, which is at -90 degrees.
        let pair = [order[first], order[(first + 1) % count]];
        pair.iter().map(|lamp| libm::cos(azimuths[*lamp] + FRAC_PI_2)).sum::<f64>()
    };
    let first = (0..count).max_by(|a, b| upwards(*a).total_cmp(&upwards(*b))).unwrap_or(0);
    let mut colors = vec![[0.0; 3]; count];
    for k in 0..count {
        colors[order[(first + k) % count]][(k / 2) % 3] = 0.5;
    }
    colors
}

/// A fitted flat field, and its residual.
type FittedFlatField = ([f64; FLAT_FIELD_TERMS], FitResidual);

/// Fits polynomials to the flat fields. The inner error says why there are none if the image is missing; the outer one
/// what is wrong with the image, and what to do.
fn fit_flat_fields(own: &FlatField, folder: &Path) -> Result<Result<Vec<FittedFlatField>, String>, (String, String)> {
    // Only a file next to the YAML is read, whatever path the YAML gives.
    let name = Path::new(&own.file).file_name().unwrap_or_default();
    let path = folder.join(name);
    let wrong = |reason: String| {
        let help = String::from(
            "put the PNG there that was published beside the YAML file; or remove it, and the flat field is taken as even",
        );
        (format!("{}: {reason}", path.display()), help)
    };
    let bytes = match input::read(&path, input::MAX_IMAGE_BYTES) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Err(format!("{} is missing", path.display()))),
        read => read.map_err(|error| wrong(error.to_string()))?,
    };
    let image = png::decode_heights(&bytes).map_err(wrong)?;
    let [width, height] = own.tile_px;
    if [image.width, image.height] != [3 * width, 2 * height] {
        let (across, down) = (image.width, image.height);
        let expected = format!("{} x {} px: 3 x 2 tiles of `modelsize`", 3 * width, 2 * height);
        return Err(wrong(format!("the image has {across} x {down} px, not {expected}")));
    }
    let normal = normal_equations(own.tile_px);
    let Some(inverse) = normal.cholesky() else { return Err(wrong(String::from("it is too small"))) };
    let fit = |lamp: usize| {
        let tile = |x: usize, y: usize| {
            f64::from(image.at(lamp % 3 * width + x, lamp / 3 * height + y)).max(DARKEST) / own.scale[lamp]
        };
        let mut aim = SVector::<f64, FLAT_FIELD_TERMS>::zeros();
        for_each_pixel(own.tile_px, |x, y, terms| aim += *terms * tile(x, y));
        // Rounded to a millionth, far below a grey level, to keep the sensor file short.
        let found = inverse.solve(&aim).map(|factor| libm::round(1e6 * factor) / 1e6);
        let (mut squares, mut most) = (0.0, 0.0_f64);
        for_each_pixel(own.tile_px, |x, y, terms| {
            let off = 255.0 * own.scale[lamp] * (found.dot(terms) - tile(x, y));
            squares += off * off;
            most = most.max(off.abs());
        });
        let rms = (squares / (width * height) as f64).sqrt();
        (std::array::from_fn(|k| found[k]), FitResidual { rms, most })
    };
    Ok(Ok((0..LAMP_COUNT).map(fit).collect()))
}

/// Sums up the normal equations of the polynomial over a tile.
fn normal_equations(size: [usize; 2]) -> SMatrix<f64, FLAT_FIELD_TERMS, FLAT_FIELD_TERMS> {
    let mut normal = SMatrix::zeros();
    for_each_pixel(size, |_, _, terms| normal += *terms * terms.transpose());
    normal
}

/// Calls `work` with the terms of fourth degree at every pixel.
fn for_each_pixel(size: [usize; 2], mut work: impl FnMut(usize, usize, &SVector<f64, FLAT_FIELD_TERMS>)) {
    let powers = |at: usize, count: usize| {
        let v = (2.0 * at as f64 + 1.0) / count as f64 - 1.0;
        [1.0, v, v * v, v * v * v, v * v * v * v]
    };
    for y in 0..size[1] {
        let down = powers(y, size[1]);
        for x in 0..size[0] {
            let across = powers(x, size[0]);
            let degrees = (0..5).flat_map(|i| (0..5 - i).map(move |j| (i, j)));
            let terms = SVector::from_iterator(degrees.map(|(i, j)| across[i] * down[j]));
            work(x, y, &terms);
        }
    }
}

/// Reports a pad that is black or white in the middle of the view under every lamp, so that no press would show.
pub fn check_darkness(lamps: &[Lamp]) -> Option<Diagnostic> {
    // In the middle the place is 0 and the normal points at the camera, so most terms vanish.
    let grey = |lamp: &Lamp| {
        let [.., nz_nz, _, _, nz, one] = lamp.quadratic.map(|polynomial| polynomial[0]);
        lamp.flat_field[0] * (nz_nz + nz + one)
    };
    let is_cut = |grey: f64| !(0.004..0.996).contains(&grey);
    lamps.iter().all(|lamp| is_cut(grey(lamp))).then(|| {
        let message = "the untouched pad is black or white under every lamp, so that no press would show";
        Diagnostic::new(message).help("check `quadfit` and the flat field: are they those of one device?")
    })
}

/// Formats the tables of lamps for the end of a sensor file, a line per polynomial.
pub fn format_lamp_tables(lamps: &[Lamp]) -> String {
    let list = |numbers: &[f64]| {
        let numbers: Vec<String> = numbers.iter().map(|number| format!("{number:?}")).collect();
        format!("[{}]", numbers.join(", "))
    };
    let mut text = String::new();
    for Lamp { name, color, quadratic, flat_field } in lamps {
        let rows: String = quadratic.iter().map(|row| format!("    {},\n", list(row))).collect();
        let (color, flat_field) = (list(color), list(flat_field));
        let table = format!("quadratic = [\n{rows}]\nflat_field = {flat_field}\n");
        write!(text, "\n[[lamp]]\nname = {name:?}\ncolor = {color}\n{table}").expect("a string takes all text");
    }
    text
}

/// Lines of a YAML file with a key, at the margin or below a key at the margin. These files need no more of YAML.
struct YamlLines<'a> {
    lines: Vec<YamlLine<'a>>,
    problems: Diagnostics,
}

struct YamlLine<'a> {
    /// Key at the margin above it; empty for keys at the margin.
    section: &'a str,
    key: &'a str,
    value: &'a str,
    place: SourceSpan,
}

impl<'a> YamlLines<'a> {
    fn new(text: &'a str) -> Self {
        let (mut lines, mut section, mut start) = (Vec::new(), "", 0);
        while start < text.len() {
            let end = text[start..].find('\n').map_or(text.len(), |at| start + at);
            let line = &text[start..end];
            let mut next = end + 1;
            let content = line.trim();
            if let Some((key, _)) = content.split_once(':').filter(|_| !content.starts_with(['#', '-'])) {
                let from = start + line.find(':').unwrap_or(0) + 1;
                let mut to = end;
                // A list may continue on the next lines.
                if text[from..end].trim_start().starts_with('[')
                    && let Some(close) = text[from..].find(']')
                    && from + close >= end
                {
                    to = from + close + 1;
                    next = text[to..].find('\n').map_or(text.len(), |at| to + at + 1);
                }
                let inner = line.starts_with([' ', '\t']);
                let first = start + line.len() - line.trim_start().len();
                lines.push(YamlLine {
                    section: if inner { section } else { "" },
                    key: key.trim_end(),
                    value: text[from..to].trim(),
                    place: SourceSpan { source: 0, start: first, end: first + key.trim_end().len() },
                });
                if !inner {
                    section = key.trim_end();
                }
            }
            start = next;
        }
        Self { lines, problems: Diagnostics::default() }
    }

    fn has_section(&self, section: &str) -> bool {
        self.lines.iter().any(|line| line.section.is_empty() && line.key == section)
    }

    /// Returns the value of a key, and the key's place. A missing key is reported at its section.
    fn find_value(&mut self, section: &str, key: &str) -> Option<(&'a str, SourceSpan)> {
        if let Some(line) = self.lines.iter().find(|line| line.section == section && line.key == key) {
            return Some((line.value, line.place));
        }
        let above = self.lines.iter().find(|line| line.section.is_empty() && line.key == section);
        let place = above.map_or(SourceSpan { source: 0, start: 0, end: 0 }, |line| line.place);
        let message = match section {
            "" => format!("missing key `{key}`"),
            section => format!("missing key `{key}` below `{section}`"),
        };
        let help =
            "name the YAML file of a device with six lamps, as GelSight publishes them (gelsightinc/gssim, devices/)";
        let named = if section.is_empty() { format!("`{key}`") } else { format!("`{section}: {key}`") };
        self.problems.push(Diagnostic::new(message).at(place).about(named, "keys are missing").help(help));
        None
    }

    fn report_problem(&mut self, place: SourceSpan, message: String, help: &str) {
        self.problems.push(Diagnostic::new(message).at(place).help(help));
    }

    fn read_text(&mut self, section: &str, key: &str) -> Option<(String, SourceSpan)> {
        let (value, place) = self.find_value(section, key)?;
        let value = value.trim_matches(['"', '\'']);
        if value.is_empty() {
            let help = "write the name of the flat field's PNG, or remove the whole of `flatfield` to take it as even";
            self.report_problem(place, format!("`{key}` is empty"), help);
            return None;
        }
        Some((value.to_owned(), place))
    }

    fn read_number(&mut self, section: &str, key: &str, range: std::ops::RangeInclusive<f64>) -> Option<f64> {
        let (value, place) = self.find_value(section, key)?;
        let read = value.parse().ok().filter(|number| range.contains(number));
        if read.is_none() {
            let allowed = if range.start() == range.end() {
                format!("allowed: {}", range.start())
            } else {
                format!("allowed: {} to {}", range.start(), range.end())
            };
            self.report_problem(place, format!("`{key}` is {value}"), &allowed);
        }
        read
    }

    /// Reads a list of numbers in brackets of any kind.
    fn read_list(
        &mut self,
        section: &str,
        key: &str,
        count: usize,
        range: std::ops::RangeInclusive<f64>,
    ) -> Option<Vec<f64>> {
        let (value, place) = self.find_value(section, key)?;
        let inner = value.trim_start_matches(['[', '(']).trim_end_matches([']', ')']);
        let texts: Vec<&str> = inner.split(',').map(str::trim).filter(|text| !text.is_empty()).collect();
        let mut numbers = Vec::new();
        for text in &texts {
            match text.parse() {
                Ok(number) if range.contains(&number) => numbers.push(number),
                _ => {
                    let allowed = format!("allowed: numbers from {} to {}", range.start(), range.end());
                    self.report_problem(place, format!("`{key}` holds {text}"), &allowed);
                    return None;
                }
            }
        }
        if numbers.len() != count {
            let help = format!("write {count} numbers, as the file of GelSight has them");
            self.report_problem(place, format!("`{key}` holds {} numbers", numbers.len()), &help);
            return None;
        }
        Some(numbers)
    }

    /// Reads the rows of a matrix with this many columns, a row for each term of the place.
    fn read_matrix(&mut self, section: &str, columns: usize) -> Option<Vec<Vec<f64>>> {
        let rows = self.read_number(section, "rows", 1.0..=PLACE_TERMS as f64);
        let found = self.read_number(section, "cols", 1.0..=1e3);
        let (rows, found) = (rows? as usize, found? as usize);
        let (_, place) = self.find_value(section, "rows")?;
        if ![1, 3, PLACE_TERMS].contains(&rows) {
            let help = "only polynomials in the place up to the second degree are known: 1, 3 or 6 rows";
            self.report_problem(place, format!("`{section}` has {rows} rows"), help);
            return None;
        }
        if found != columns {
            let (_, place) = self.find_value(section, "cols")?;
            let help = format!("only {} columns for each of {LAMP_COUNT} lamps are known", columns / LAMP_COUNT);
            self.report_problem(place, format!("`{section}` has {found} columns"), &help);
            return None;
        }
        let values = self.read_list(section, "values", rows * columns, -100.0..=100.0)?;
        Some(values.chunks_exact(columns).map(<[f64]>::to_vec).collect())
    }
}
