//! Imports a calibration folder of Taxim (Si and Yuan 2022), in the form of the package `taxim` 1.4.
//!
//! Three files are read: `polycalib.npz` (the polynomials), `f0` of `dataPack.npz` (the background image) and
//! `params.json`. Channels are stored blue first there. The background is the picture that Taxim itself lays under its
//! colours: `f0` mixed with a wide blur of it. Two things are left out: the shadows (`shadowTable.npz` holds pickled
//! Python objects) and the pad's own shape (`gelmap.npy`).

use std::path::Path;

use image::RgbImage;
use serde::Deserialize;

use gelsim_core::base::grid::Grid;
use gelsim_core::optics::calibrated::taxim::{MAX_BINS, TERMS, TaximCalibration};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::input;
use gelsim_files::npy::NumberArray;
use gelsim_files::npz::Npz;

/// Content of a calibration folder of Taxim.
#[derive(Clone, Debug, PartialEq)]
pub struct TaximImport {
    /// The folder's name.
    pub name: String,
    /// Width and height of the image, px.
    pub resolution_px: [u32; 2],
    /// Width and height of the part of the pad that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// The background image, of this resolution.
    pub background: RgbImage,
    /// The colours; validated.
    pub colors: TaximCalibration,
}

/// Reads a folder. The error lists everything that is wrong in it.
pub fn import_taxim_folder(folder: &Path) -> Result<TaximImport, Report> {
    if !folder.is_dir() {
        let what = if folder.exists() { "is no folder" } else { "does not exist" };
        return Err(user_error(format!("{} {what}", folder.display()), FOLDER_HELP));
    }
    let mut problems = Diagnostics::default();
    let mut keep = |name: &str, ImportError { reason, help }: ImportError| {
        let path = folder.join(name);
        problems.push(Diagnostic::new(format!("{}: {reason}", path.display())).help(help));
    };
    let params = read_params(&folder.join("params.json")).map_err(|wrong| keep("params.json", wrong)).ok();
    let table = PolynomialTable::read(&folder.join("polycalib.npz"), params.as_ref());
    let table = table.map_err(|all| all.into_iter().for_each(|wrong| keep("polycalib.npz", wrong))).ok();
    let photograph = read_photograph(&folder.join("dataPack.npz"), params.as_ref());
    let photograph = photograph.map_err(|wrong| keep("dataPack.npz", wrong)).ok();
    if let (Some(Params { sensor, simulator }), Some(table), Some(photograph)) = (params, table, photograph) {
        let colors =
            TaximCalibration { bins: table.bins, resolution_px: [sensor.w, sensor.h], polynomials: table.polynomials };
        match colors.validate() {
            Err(reason) => {
                let help = String::from("make the calibration again in Taxim: its polynomials failed there");
                keep("polycalib.npz", ImportError { reason, help });
            }
            Ok(()) => {
                let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
                return Ok(TaximImport {
                    name: absolute
                        .file_name()
                        .map_or_else(|| String::from("taxim"), |name| name.to_string_lossy().into()),
                    resolution_px: [sensor.w as u32, sensor.h as u32],
                    field_of_view_mm: [sensor.w, sensor.h].map(|size| size as f64 * sensor.pixmm),
                    background: make_background(&photograph, &simulator),
                    colors,
                });
            }
        }
    }
    Err(Report::new(&problems, &[]))
}

const FOLDER_HELP: &str = "name a folder with polycalib.npz, dataPack.npz and params.json of one calibration of Taxim";
const PARAMS_HELP: &str = "write the file: it holds at least {\"sensor\": {\"w\": 640, \"h\": 480, \"pixmm\": 0.0295, \
                           \"num_bins\": 125}}, with your sensor's numbers: width and height in pixels, mm per pixel, bins";

/// Why a file cannot be used, and how to fix it.
struct ImportError {
    reason: String,
    help: String,
}

impl ImportError {
    /// Makes the error of a missing file, or of a file of something else.
    fn wrong_file(reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), help: FOLDER_HELP.to_owned() }
    }
}

/// Content of `params.json` that is used.
#[derive(Debug, Deserialize)]
struct Params {
    sensor: Sensor,
    #[serde(default)]
    simulator: Simulator,
}

#[derive(Debug, Deserialize)]
struct Sensor {
    w: usize,
    h: usize,
    /// mm per pixel.
    pixmm: f64,
    num_bins: usize,
}

/// How Taxim makes the background from the photograph.
#[derive(Debug, Deserialize)]
#[serde(default)]
struct Simulator {
    /// Standard deviation of the blur, as fractions of width and height.
    initial_frame_sigma_rel: [f64; 2],
    /// Fraction of the blurred picture in the mix.
    frame_mixing_percentage: f64,
    /// Pixels that the blur raises by more than this stay as they are. Full scale is 1 there, so that with 1 or more no
    /// pixel stays.
    diff_threshold: f64,
}

impl Default for Simulator {
    fn default() -> Self {
        // Taxim's defaults. The blur's width is 50 px in an image of 640 x 480.
        Self {
            initial_frame_sigma_rel: [50.0 / 640.0, 50.0 / 480.0],
            frame_mixing_percentage: 0.15,
            diff_threshold: 5.0,
        }
    }
}

fn read_params(path: &Path) -> Result<Params, ImportError> {
    /// Largest file, bytes.
    const MAX_BYTES: u64 = 1 << 20;
    let missing = |reason: String| ImportError { reason, help: PARAMS_HELP.to_owned() };
    let bytes = input::read(path, MAX_BYTES).map_err(|error| missing(error.to_string()))?;
    let params: Params = serde_json::from_slice(&bytes).map_err(|error| missing(error.to_string()))?;
    let Params { sensor, simulator } = &params;
    let out_of_range = |reason: String, help: &str| ImportError { reason, help: help.to_owned() };
    gelsim_core::base::view::check_image_size([sensor.w, sensor.h]).map_err(|reason| {
        out_of_range(format!("`w` and `h`: {reason}"), "write the images' width and height in pixels")
    })?;
    let number = |name: &str, value: f64, least: f64, most: f64| {
        if (least..=most).contains(&value) {
            Ok(())
        } else {
            Err(ImportError {
                reason: format!("`{name}` is {value}; allowed: {least} to {most}"),
                help: format!("write a `{name}` of this range there"),
            })
        }
    };
    number("pixmm", sensor.pixmm, 1e-4, 10.0)?;
    number("num_bins", sensor.num_bins as f64, 2.0, MAX_BINS as f64)?;
    for sigma in simulator.initial_frame_sigma_rel {
        number("initial_frame_sigma_rel", sigma, 0.0, 0.25)?;
    }
    number("frame_mixing_percentage", simulator.frame_mixing_percentage, 0.0, 1.0)?;
    number("diff_threshold", simulator.diff_threshold, 1.0, 1e9)?;
    Ok(params)
}

/// Content of `polycalib.npz` that is used.
struct PolynomialTable {
    bins: usize,
    polynomials: [Vec<[f32; TERMS]>; 3],
}

impl PolynomialTable {
    fn read(path: &Path, params: Option<&Params>) -> Result<Self, Vec<ImportError>> {
        let archive = Npz::read(path).map_err(|reason| vec![ImportError::wrong_file(reason)])?;
        let mut wrong = Vec::new();
        // Taxim names the polynomials of its first plane, which is blue, as those of red.
        let polynomials = ["grad_b", "grad_g", "grad_r"].map(|name| {
            archive.read_array(name).and_then(|array| read_polynomials(name, &array)).unwrap_or_else(|reason| {
                wrong.push(ImportError::wrong_file(reason));
                Vec::new()
            })
        });
        let counts = polynomials.each_ref().map(Vec::len);
        let bins = counts[0].isqrt();
        if wrong.is_empty() && counts.iter().any(|count| *count != counts[0]) {
            wrong.push(ImportError::wrong_file("`grad_r`, `grad_g` and `grad_b` differ in shape"));
        } else if let Some(said) = params.map(|params| params.sensor.num_bins).filter(|said| *said != bins)
            && wrong.is_empty()
        {
            wrong.push(ImportError {
                reason: format!("its polynomials are of {bins} bins, and `num_bins` in params.json is {said}"),
                help: format!("write \"num_bins\": {bins} into params.json, if both are of one calibration"),
            });
        }
        if wrong.is_empty() { Ok(Self { bins, polynomials }) } else { Err(wrong) }
    }
}

fn read_polynomials(name: &str, array: &NumberArray) -> Result<Vec<[f32; TERMS]>, String> {
    let fits = matches!(array.shape.as_slice(), &[steepness, direction, TERMS] if steepness == direction);
    if !fits {
        let shape = format_shape(&array.shape);
        return Err(format!("array `{name}` has shape {shape}; it should be (bins, bins, {TERMS})"));
    }
    Ok(array.values.as_chunks::<TERMS>().0.iter().map(|polynomial| polynomial.map(|value| value as f32)).collect())
}

/// Reads the background image in `dataPack.npz`.
fn read_photograph(path: &Path, params: Option<&Params>) -> Result<RgbImage, ImportError> {
    let array = Npz::read(path).and_then(|archive| archive.read_array("f0")).map_err(ImportError::wrong_file)?;
    let found = format_shape(&array.shape);
    let &[height, width, 3] = array.shape.as_slice() else {
        return Err(ImportError::wrong_file(format!("array `f0` has shape {found}; it should be (height, width, 3)")));
    };
    if let Some(Params { sensor, .. }) = params
        && [width, height] != [sensor.w, sensor.h]
    {
        let (w, h) = (sensor.w, sensor.h);
        return Err(ImportError {
            reason: format!(
                "array `f0` is {width} px wide and {height} px high, and params.json has \"w\": {w}, \"h\": {h}"
            ),
            help: format!("write \"w\": {width}, \"h\": {height} into params.json, if both are of one calibration"),
        });
    }
    let is_level = |value: f64| (0.0..=255.0).contains(&value) && value == value.trunc();
    if let Some(bad) = array.values.iter().find(|value| !is_level(**value)) {
        return Err(ImportError::wrong_file(format!(
            "array `f0` holds {bad}; its values should be whole numbers from 0 to 255"
        )));
    }
    let rgb = array.values.as_chunks().0.iter().flat_map(|[blue, green, red]| [*red, *green, *blue].map(|v| v as u8));
    let too_large = || ImportError::wrong_file(format!("array `f0` has shape {found}, which is too large"));
    let size = [width, height].map(u32::try_from);
    let [Ok(width), Ok(height)] = size else { return Err(too_large()) };
    RgbImage::from_raw(width, height, rgb.collect()).ok_or_else(too_large)
}

/// Formats a shape as NumPy writes it.
fn format_shape(sizes: &[usize]) -> String {
    let sizes: Vec<String> = sizes.iter().map(usize::to_string).collect();
    format!("({})", sizes.join(", "))
}

/// Computes the picture that Taxim lays under its colours.
fn make_background(photograph: &RgbImage, simulator: &Simulator) -> RgbImage {
    let (width, height) = (photograph.width() as usize, photograph.height() as usize);
    let [across, down] = simulator.initial_frame_sigma_rel;
    let [across, down] = [gaussian_weights(across * width as f64), gaussian_weights(down * height as f64)];
    let blurred: [Grid<f64>; 3] = std::array::from_fn(|channel| {
        let data = photograph.pixels().map(|pixel| f64::from(pixel[channel])).collect();
        let plane = Grid { width, height, data };
        transpose(&blur_columns(&transpose(&blur_columns(&plane, &down)), &across))
    });
    let fraction = simulator.frame_mixing_percentage;
    RgbImage::from_fn(photograph.width(), photograph.height(), |x, y| {
        let own = photograph.get_pixel(x, y).0;
        let mixed = |channel: usize| {
            let blurred = blurred[channel].at(x as usize, y as usize);
            fraction * blurred + (1.0 - fraction) * f64::from(own[channel])
        };
        // Rounded to the nearest level: rounding errors of the blur are far below half a level.
        image::Rgb(std::array::from_fn(|channel| (mixed(channel) + 0.5) as u8))
    })
}

/// Returns one half of Taxim's Gaussian, from its middle on: it ends where it falls to 1e-5, and both sides add up to
/// 1.
fn gaussian_weights(sigma_px: f64) -> Vec<f64> {
    let end = -2.0 * libm::log(1e-5 * (2.0 * std::f64::consts::PI).sqrt() * sigma_px);
    let reach = if sigma_px > 0.0 && end > 0.0 { libm::rint(end.sqrt() * sigma_px) as usize / 2 } else { 0 };
    let spread = sigma_px.max(f64::MIN_POSITIVE);
    let shape: Vec<f64> = (0..=reach).map(|k| libm::exp(-0.5 * (k as f64 / spread) * (k as f64 / spread))).collect();
    let sum = 2.0 * shape.iter().sum::<f64>() - shape[0];
    shape.iter().map(|weight| weight / sum).collect()
}

/// Blurs along the columns. Outside its border the picture is mirrored at the border's pixels.
fn blur_columns(plane: &Grid<f64>, weights: &[f64]) -> Grid<f64> {
    let mut blurred = Grid::new(plane.width, plane.height);
    let period = 2 * (plane.height - 1).max(1);
    let mirrored = |y: usize| (y % period).min(period - y % period).min(plane.height - 1);
    for y in 0..plane.height {
        let out = blurred.row_mut(y);
        let mut add = |row: usize, weight: f64| {
            out.iter_mut().zip(plane.row(row)).for_each(|(sum, value)| *sum += weight * value);
        };
        for (k, weight) in weights.iter().enumerate() {
            add(mirrored(y + k), *weight);
            if k > 0 {
                // Counted from a full number of periods further on, because an unsigned index cannot be negative.
                add(mirrored(y + period * weights.len() - k), *weight);
            }
        }
    }
    blurred
}

fn transpose(plane: &Grid<f64>) -> Grid<f64> {
    let (width, height) = (plane.height, plane.width);
    let data = (0..width * height).map(|at| plane.at(at / width, at % width)).collect();
    Grid { width, height, data }
}
