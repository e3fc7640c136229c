//! A calibration that GelSight publishes of a device (gelsightinc/gssim), made into a sensor of ours.
//!
//! Read are a YAML file and the image of the flat field that it names. Of the YAML: `nL`, `width`, `height`,
//! `mmperpixel`; `quadfit`, a row for each term of the place (x^2, x y, y^2, x, y, 1) and ten columns for each lamp;
//! the last row of `linfit`, where the lamps are; and `flatfield`. The published code adds up `quadfit` as
//! [`gelsim_core::optics::lamps`] says, and divides by a correction, `scale` / flat field. The image holds the flat
//! fields of the lamps as tiles, three beside each other. Here each is divided by its scale and fitted by a polynomial
//! of fourth degree, so that a sensor file needs no image.
//!
//! The published code counts columns and rows from 0 and the middle from 1: its places are one pixel of the full image off. Ours
//! are not; that changes grey levels by less than a tenth.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::Path;

use nalgebra::{SMatrix, SVector};

use gelsim_core::optics::lamps::{COEFFICIENTS, COUNT, FLAT_FIELD_TERMS, Lamp, PLACE_TERMS};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::source::{Place, Source};
use gelsim_files::{input, png};

/// Largest YAML file, bytes.
const MOST_YAML: u64 = 1 << 20;
/// Pixels of the device's image that one of ours is wide and high.
const REDUCTION: f64 = 4.0;
/// Widest and highest image of a device, px.
const MOST_PX: f64 = 32768.0;
/// Darkest value of a flat field that counts, as in the published code.
const DARKEST: f64 = 1.0 / 255.0;
/// Narrowest and lowest flat field: a polynomial of fourth degree needs more pixels than terms.
const SMALLEST_TILE: f64 = 8.0;

/// What a calibration says of its device.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedSensor {
    /// The file's name without its end.
    pub name: String,
    /// Width and height of the sensor's image, px: a quarter of the device's.
    pub resolution_px: [u32; 2],
    /// Width and height of the part of the pad that it shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// The lamps, in the order of the file.
    pub lamps: Vec<Lamp>,
    /// What the polynomial of each lamp's flat field leaves of the image, or why there is no image.
    pub flat_field: Result<Vec<Left>, String>,
}

/// What a polynomial leaves of a flat field, grey levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Left {
    /// Root mean square.
    pub rms: f64,
    /// By most.
    pub most: f64,
}

/// Reads the calibration at `path`. On failure, everything that is wrong in it.
pub fn import(path: &Path) -> Result<ImportedSensor, Report> {
    let shown = path.display().to_string();
    let text = input::read(path, MOST_YAML).map_err(|error| error.to_string());
    let text = text.and_then(|bytes| String::from_utf8(bytes).map_err(|_| String::from("it is not UTF-8")));
    let text = text.map_err(|reason| {
        gelsim_files::diagnostic::user_error(
            format!("cannot read {shown}: {reason}"),
            "name the YAML file of a device, as GelSight publishes them (gelsightinc/gssim, devices/)",
        )
    })?;
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let source = Source { name: shown, text, folder: folder.clone() };
    let mut yaml = Yaml::new(&source.text);
    let device = Device::read(&mut yaml);
    let mut problems = yaml.problems;
    let flat_field = device.as_ref().map(|device| match &device.flat_field {
        None => Ok(Err(String::from("the calibration has none"))),
        Some(flat_field) => fields(flat_field, &folder),
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
    let Device { size_px, mm_per_px, quadratics, azimuths, .. } = device;
    let even = {
        let mut even = [0.0; FLAT_FIELD_TERMS];
        even[0] = 1.0;
        even
    };
    let colors = colors(&azimuths);
    let lamps = (0..COUNT).map(|k| Lamp {
        name: char::from(b'A' + k as u8).to_string(),
        color: colors[k],
        quadratic: quadratics[k],
        flat_field: fitted.as_ref().map_or(even, |fitted| fitted[k].0),
    });
    Ok(ImportedSensor {
        name: path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
        resolution_px: size_px.map(|px| libm::round(px / REDUCTION).max(1.0) as u32),
        field_of_view_mm: size_px.map(|px| libm::round(1e4 * px * mm_per_px) / 1e4),
        lamps: lamps.collect(),
        flat_field: fitted.map(|fitted| fitted.into_iter().map(|(_, left)| left).collect()),
    })
}

/// What is read of the YAML.
struct Device {
    size_px: [f64; 2],
    mm_per_px: f64,
    quadratics: Vec<[[f64; PLACE_TERMS]; COEFFICIENTS]>,
    /// Of each lamp, from +x (right) towards +y (down).
    azimuths: Vec<f64>,
    flat_field: Option<FlatField>,
}

struct FlatField {
    file: String,
    file_place: Place,
    tile_px: [usize; 2],
    scale: Vec<f64>,
}

impl Device {
    /// `None` after a mistake.
    fn read(yaml: &mut Yaml<'_>) -> Option<Self> {
        let lamps = yaml.number("", "nL", COUNT as f64..=COUNT as f64);
        let size_px = ["width", "height"].map(|key| yaml.number("", key, 1.0..=MOST_PX));
        let mm_per_px = yaml.number("", "mmperpixel", 1e-6..=1.0);
        let quadratics = yaml.matrix("quadfit", COEFFICIENTS * COUNT).map(|matrix| quadratics(&matrix));
        let azimuths = yaml.matrix("linfit", 3 * COUNT).map(|matrix| {
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
    fn read(yaml: &mut Yaml<'_>) -> Option<Self> {
        let file = yaml.text("flatfield", "modelfile");
        let tile = yaml.list("flatfield", "modelsize", 2, SMALLEST_TILE..=MOST_PX / REDUCTION);
        let scale = yaml.list("flatfield", "scale", COUNT, DARKEST..=1.0);
        let (file, file_place) = file?;
        let tile = tile?;
        Some(Self { file, file_place, tile_px: [tile[0] as usize, tile[1] as usize], scale: scale? })
    }
}

/// The quadratics of all lamps; `matrix` has a row for each term of the place.
fn quadratics(matrix: &[Vec<f64>]) -> Vec<[[f64; PLACE_TERMS]; COEFFICIENTS]> {
    // Ours are the factors of 1, y, y^2, x, x y, x^2; theirs end with those of x, y and 1.
    const FROM_THE_LAST: [usize; PLACE_TERMS] = [0, 1, 3, 2, 4, 5];
    let term = |column: usize, from_the_last: usize| {
        matrix.len().checked_sub(from_the_last + 1).map_or(0.0, |row| matrix[row][column])
    };
    let of = |lamp: usize| {
        std::array::from_fn(|m| FROM_THE_LAST.map(|from_the_last| term(lamp * COEFFICIENTS + m, from_the_last)))
    };
    (0..COUNT).map(of).collect()
}

/// The share of each lamp in red, green and blue: neighbours in pairs, the pair nearest to the upper edge red, then clockwise
/// green and blue, so that the composite shows colours from three sides as a sensor with coloured LEDs does.
fn colors(azimuths: &[f64]) -> Vec<[f64; 3]> {
    let mut order: Vec<usize> = (0..azimuths.len()).collect();
    order.sort_by(|a, b| azimuths[*a].total_cmp(&azimuths[*b]));
    let count = order.len();
    let upwards = |first: usize| {
        // Largest where both lie towards the upper edge.
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

/// A fitted flat field and what it leaves.
type Fitted = ([f64; FLAT_FIELD_TERMS], Left);

/// The polynomials of the flat fields; why there are none, where the image is missing; or what is wrong with it, with help.
fn fields(own: &FlatField, folder: &Path) -> Result<Result<Vec<Fitted>, String>, (String, String)> {
    // Only a file beside the YAML.
    let name = Path::new(&own.file).file_name().unwrap_or_default();
    let path = folder.join(name);
    let wrong = |reason: String| {
        let help = String::from(
            "put the PNG there that was published beside the YAML file; or remove it, and the flat field is taken as even",
        );
        (format!("{}: {reason}", path.display()), help)
    };
    let bytes = match input::read(&path, input::MOST_IMAGE_BYTES) {
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
        each_place(own.tile_px, |x, y, terms| aim += *terms * tile(x, y));
        // A millionth is far below a grey level.
        let found = inverse.solve(&aim).map(|factor| libm::round(1e6 * factor) / 1e6);
        let (mut squares, mut most) = (0.0, 0.0_f64);
        each_place(own.tile_px, |x, y, terms| {
            let off = 255.0 * own.scale[lamp] * (found.dot(terms) - tile(x, y));
            squares += off * off;
            most = most.max(off.abs());
        });
        let rms = (squares / (width * height) as f64).sqrt();
        (std::array::from_fn(|k| found[k]), Left { rms, most })
    };
    Ok(Ok((0..COUNT).map(fit).collect()))
}

fn normal_equations(size: [usize; 2]) -> SMatrix<f64, FLAT_FIELD_TERMS, FLAT_FIELD_TERMS> {
    let mut normal = SMatrix::zeros();
    each_place(size, |_, _, terms| normal += *terms * terms.transpose());
    normal
}

/// The terms of fourth degree at every pixel.
fn each_place(size: [usize; 2], mut work: impl FnMut(usize, usize, &SVector<f64, FLAT_FIELD_TERMS>)) {
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

/// That the untouched pad is black or white in the middle of the view under every lamp, so that no press shows.
pub fn darkness(lamps: &[Lamp]) -> Option<Diagnostic> {
    // There the place is 0, and the normal points at the camera.
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

/// The tables of lamps as they stand at the end of a sensor file, a line for each polynomial.
pub fn tables(lamps: &[Lamp]) -> String {
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

/// The lines of a YAML file that have a key: at the margin, or below a key at the margin. Nothing else of YAML is needed here.
struct Yaml<'a> {
    lines: Vec<Line<'a>>,
    problems: Diagnostics,
}

struct Line<'a> {
    /// The key at the margin above it; empty for those at the margin.
    section: &'a str,
    key: &'a str,
    value: &'a str,
    place: Place,
}

impl<'a> Yaml<'a> {
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
                // A list may go on over the next lines.
                if text[from..end].trim_start().starts_with('[')
                    && let Some(close) = text[from..].find(']')
                    && from + close >= end
                {
                    to = from + close + 1;
                    next = text[to..].find('\n').map_or(text.len(), |at| to + at + 1);
                }
                let inner = line.starts_with([' ', '\t']);
                let first = start + line.len() - line.trim_start().len();
                lines.push(Line {
                    section: if inner { section } else { "" },
                    key: key.trim_end(),
                    value: text[from..to].trim(),
                    place: Place { source: 0, start: first, end: first + key.trim_end().len() },
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

    /// The value of a key and where the key stands. A key that is missing is said at its section.
    fn value(&mut self, section: &str, key: &str) -> Option<(&'a str, Place)> {
        if let Some(line) = self.lines.iter().find(|line| line.section == section && line.key == key) {
            return Some((line.value, line.place));
        }
        let above = self.lines.iter().find(|line| line.section.is_empty() && line.key == section);
        let place = above.map_or(Place { source: 0, start: 0, end: 0 }, |line| line.place);
        let message = match section {
            "" => format!("missing key `{key}`"),
            section => format!("missing key `{key}` below `{section}`"),
        };
        let help =
            "name the YAML file of a device with six lamps, as GelSight publishes them (gelsightinc/gssim, devices/)";
        let named = if section.is_empty() { format!("`{key}`") } else { format!("`{section}: {key}`") };
        self.problems.push(Diagnostic::new(message).at(place).of(named, "keys are missing").help(help));
        None
    }

    fn wrong(&mut self, place: Place, message: String, help: &str) {
        self.problems.push(Diagnostic::new(message).at(place).help(help));
    }

    fn text(&mut self, section: &str, key: &str) -> Option<(String, Place)> {
        let (value, place) = self.value(section, key)?;
        let value = value.trim_matches(['"', '\'']);
        if value.is_empty() {
            let help = "write the name of the flat field's PNG, or remove the whole of `flatfield` to take it as even";
            self.wrong(place, format!("`{key}` is empty"), help);
            return None;
        }
        Some((value.to_owned(), place))
    }

    fn number(&mut self, section: &str, key: &str, range: std::ops::RangeInclusive<f64>) -> Option<f64> {
        let (value, place) = self.value(section, key)?;
        let read = value.parse().ok().filter(|number| range.contains(number));
        if read.is_none() {
            let allowed = if range.start() == range.end() {
                format!("allowed: {}", range.start())
            } else {
                format!("allowed: {} to {}", range.start(), range.end())
            };
            self.wrong(place, format!("`{key}` is {value}"), &allowed);
        }
        read
    }

    /// A list of numbers in brackets of any kind.
    fn list(
        &mut self,
        section: &str,
        key: &str,
        count: usize,
        range: std::ops::RangeInclusive<f64>,
    ) -> Option<Vec<f64>> {
        let (value, place) = self.value(section, key)?;
        let inner = value.trim_start_matches(['[', '(']).trim_end_matches([']', ')']);
        let texts: Vec<&str> = inner.split(',').map(str::trim).filter(|text| !text.is_empty()).collect();
        let mut numbers = Vec::new();
        for text in &texts {
            match text.parse() {
                Ok(number) if range.contains(&number) => numbers.push(number),
                _ => {
                    let allowed = format!("allowed: numbers from {} to {}", range.start(), range.end());
                    self.wrong(place, format!("`{key}` holds {text}"), &allowed);
                    return None;
                }
            }
        }
        if numbers.len() != count {
            let help = format!("write {count} numbers, as the file of GelSight has them");
            self.wrong(place, format!("`{key}` holds {} numbers", numbers.len()), &help);
            return None;
        }
        Some(numbers)
    }

    /// The rows of a matrix with this many columns, one for each term of the place.
    fn matrix(&mut self, section: &str, columns: usize) -> Option<Vec<Vec<f64>>> {
        let rows = self.number(section, "rows", 1.0..=PLACE_TERMS as f64);
        let found = self.number(section, "cols", 1.0..=1e3);
        let (rows, found) = (rows? as usize, found? as usize);
        let (_, place) = self.value(section, "rows")?;
        if ![1, 3, PLACE_TERMS].contains(&rows) {
            let help = "only polynomials in the place up to the second degree are known: 1, 3 or 6 rows";
            self.wrong(place, format!("`{section}` has {rows} rows"), help);
            return None;
        }
        if found != columns {
            let (_, place) = self.value(section, "cols")?;
            let help = format!("only {} columns for each of {COUNT} lamps are known", columns / COUNT);
            self.wrong(place, format!("`{section}` has {found} columns"), &help);
            return None;
        }
        let values = self.list(section, "values", rows * columns, -100.0..=100.0)?;
        Some(values.chunks_exact(columns).map(<[f64]>::to_vec).collect())
    }
}
