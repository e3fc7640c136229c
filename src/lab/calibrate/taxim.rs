//! A calibration folder of Taxim (Si and Yuan 2022), as the package `taxim` 1.4 has them, made into a sensor of ours.
//!
//! Read are `polycalib.npz` (the polynomials), `f0` of `dataPack.npz` (the background) and `params.json`. Channels are
//! stored blue first there. The background is the picture that Taxim itself lays under its colours: `f0` mixed with a
//! wide blur of it. Left out are the shadows (`shadowTable.npz` holds pickled Python objects) and the pad's own shape
//! (`gelmap.npy`).

use std::path::Path;

use image::RgbImage;
use serde::Deserialize;

use crate::core::base::grid::Grid;
use crate::core::optics::calibrated::taxim::{MOST_BINS, TERMS, Taxim};
use crate::files::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::files::input;
use crate::files::npy::Numbers;
use crate::files::npz::Npz;

/// What a folder says of its sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The folder's name.
    pub name: String,
    /// Width and height of the image, px.
    pub resolution_px: [u32; 2],
    /// Width and height of the part of the pad that it shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// The background image, of that resolution.
    pub background: RgbImage,
    /// The colours; valid.
    pub colors: Taxim,
}

/// Reads a folder. On failure, everything that is wrong in it.
pub fn import(folder: &Path) -> Result<Imported, Report> {
    let mut problems = Diagnostics::default();
    let mut keep = |name: &str, help: &str, reason: String| {
        let path = folder.join(name);
        problems.push(Diagnostic::new(format!("{}: {reason}", path.display())).help(help));
    };
    const PARAMS_HELP: &str = "it holds at least {\"sensor\": {\"w\": 640, \"h\": 480, \"pixmm\": 0.0295, \"num_bins\": 125}}, \
                               with your sensor's numbers: width and height in pixels, mm per pixel, bins";
    const FOLDER_HELP: &str =
        "name a folder with polycalib.npz, dataPack.npz and params.json of one calibration of Taxim";
    let params = params(&folder.join("params.json")).map_err(|reason| keep("params.json", PARAMS_HELP, reason)).ok();
    let table = Table::read(&folder.join("polycalib.npz"), params.as_ref());
    let table =
        table.map_err(|reasons| reasons.into_iter().for_each(|why| keep("polycalib.npz", FOLDER_HELP, why))).ok();
    let photograph = photograph(&folder.join("dataPack.npz"), params.as_ref());
    let photograph = photograph.map_err(|reason| keep("dataPack.npz", FOLDER_HELP, reason)).ok();
    if let (Some(Params { sensor, simulator }), Some(table), Some(photograph)) = (params, table, photograph) {
        let colors = Taxim { bins: table.bins, resolution_px: [sensor.w, sensor.h], polynomials: table.polynomials };
        match colors.validate() {
            Err(reason) => keep("polycalib.npz", "the calibration failed there; make it again", reason),
            Ok(()) => {
                let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
                return Ok(Imported {
                    name: absolute
                        .file_name()
                        .map_or_else(|| String::from("taxim"), |name| name.to_string_lossy().into()),
                    resolution_px: [sensor.w as u32, sensor.h as u32],
                    field_of_view_mm: [sensor.w, sensor.h].map(|size| size as f64 * sensor.pixmm),
                    background: background(&photograph, &simulator),
                    colors,
                });
            }
        }
    }
    Err(Report::new(&problems, &[]))
}

/// What is read of `params.json`.
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

/// How Taxim makes the background of the photograph.
#[derive(Debug, Deserialize)]
#[serde(default)]
struct Simulator {
    /// Standard deviation of the blur, as fractions of width and height.
    initial_frame_sigma_rel: [f64; 2],
    /// Fraction of the blurred picture.
    frame_mixing_percentage: f64,
    /// Pixels that the blur raises by more stay as they are; full scale is 1 there, so that 1 or more is none.
    diff_threshold: f64,
}

impl Default for Simulator {
    fn default() -> Self {
        // 50 px of 640 x 480.
        Self {
            initial_frame_sigma_rel: [50.0 / 640.0, 50.0 / 480.0],
            frame_mixing_percentage: 0.15,
            diff_threshold: 5.0,
        }
    }
}

fn params(path: &Path) -> Result<Params, String> {
    /// Largest file, bytes.
    const MOST: u64 = 1 << 20;
    let bytes = input::read(path, MOST).map_err(|error| error.to_string())?;
    let params: Params = serde_json::from_slice(&bytes).map_err(|error| error.to_string())?;
    let Params { sensor, simulator } = &params;
    crate::core::base::view::sides([sensor.w, sensor.h]).map_err(|reason| format!("`w` and `h`: {reason}"))?;
    let number = |name: &str, value: f64, least: f64, most: f64| match (least..=most).contains(&value) {
        true => Ok(()),
        false => Err(format!("`{name}` is {value}; allowed: {least} to {most}")),
    };
    number("pixmm", sensor.pixmm, 1e-4, 10.0)?;
    number("num_bins", sensor.num_bins as f64, 2.0, MOST_BINS as f64)?;
    for sigma in simulator.initial_frame_sigma_rel {
        number("initial_frame_sigma_rel", sigma, 0.0, 0.25)?;
    }
    number("frame_mixing_percentage", simulator.frame_mixing_percentage, 0.0, 1.0)?;
    number("diff_threshold", simulator.diff_threshold, 1.0, 1e9)?;
    Ok(params)
}

/// What is read of `polycalib.npz`.
struct Table {
    bins: usize,
    polynomials: [Vec<[f32; TERMS]>; 3],
}

impl Table {
    fn read(path: &Path, params: Option<&Params>) -> Result<Self, Vec<String>> {
        let archive = Npz::read(path).map_err(|reason| vec![reason])?;
        let known = params.map(|params| params.sensor.num_bins);
        let mut reasons = Vec::new();
        // Taxim names the polynomials of the first plane, which is blue, red's.
        let polynomials = ["grad_b", "grad_g", "grad_r"].map(|name| {
            archive.array(name).and_then(|array| polynomials(name, &array, known)).unwrap_or_else(|reason| {
                reasons.push(reason);
                Vec::new()
            })
        });
        let counts = polynomials.each_ref().map(Vec::len);
        if reasons.is_empty() && counts.iter().any(|count| *count != counts[0]) {
            reasons.push(String::from("`grad_r`, `grad_g` and `grad_b` differ in shape"));
        }
        match reasons.is_empty() {
            true => Ok(Self { bins: counts[0].isqrt(), polynomials }),
            false => Err(reasons),
        }
    }
}

fn polynomials(name: &str, array: &Numbers, bins: Option<usize>) -> Result<Vec<[f32; TERMS]>, String> {
    let fits = match array.shape.as_slice() {
        &[steepness, direction, TERMS] => steepness == direction && bins.is_none_or(|bins| steepness == bins),
        _ => false,
    };
    if !fits {
        let (shape, side) = (shape(&array.shape), bins.map_or_else(|| String::from("bins"), |bins| bins.to_string()));
        let why = if bins.is_some() { " as `num_bins` in params.json says" } else { "" };
        return Err(format!("array `{name}` has shape {shape}; it should be ({side}, {side}, {TERMS}){why}"));
    }
    Ok(array.values.as_chunks::<TERMS>().0.iter().map(|polynomial| polynomial.map(|value| value as f32)).collect())
}

/// The background image in `dataPack.npz`.
fn photograph(path: &Path, params: Option<&Params>) -> Result<RgbImage, String> {
    let array = Npz::read(path)?.array("f0")?;
    let found = shape(&array.shape);
    let &[height, width, 3] = array.shape.as_slice() else {
        return Err(format!("array `f0` has shape {found}; it should be (height, width, 3)"));
    };
    if let Some(Params { sensor, .. }) = params
        && [width, height] != [sensor.w, sensor.h]
    {
        let (w, h) = (sensor.w, sensor.h);
        return Err(format!(
            "array `f0` has shape {found}; it should be ({h}, {w}, 3) as `h` and `w` in params.json say"
        ));
    }
    let is_level = |value: f64| (0.0..=255.0).contains(&value) && value == value.trunc();
    if let Some(bad) = array.values.iter().find(|value| !is_level(**value)) {
        return Err(format!("array `f0` holds {bad}; its values should be whole numbers from 0 to 255"));
    }
    let rgb = array.values.as_chunks().0.iter().flat_map(|[blue, green, red]| [*red, *green, *blue].map(|v| v as u8));
    let too_large = || format!("array `f0` has shape {found}, which is too large");
    let size = [width, height].map(u32::try_from);
    let [Ok(width), Ok(height)] = size else { return Err(too_large()) };
    RgbImage::from_raw(width, height, rgb.collect()).ok_or_else(too_large)
}

/// A shape as NumPy writes it.
fn shape(sizes: &[usize]) -> String {
    let sizes: Vec<String> = sizes.iter().map(usize::to_string).collect();
    format!("({})", sizes.join(", "))
}

/// The picture that Taxim lays under its colours.
fn background(photograph: &RgbImage, simulator: &Simulator) -> RgbImage {
    let (width, height) = (photograph.width() as usize, photograph.height() as usize);
    let [across, down] = simulator.initial_frame_sigma_rel;
    let [across, down] = [weights(across * width as f64), weights(down * height as f64)];
    let blurred: [Grid<f64>; 3] = std::array::from_fn(|channel| {
        let data = photograph.pixels().map(|pixel| f64::from(pixel[channel])).collect();
        let plane = Grid { width, height, data };
        transposed(&blurred_down(&transposed(&blurred_down(&plane, &down)), &across))
    });
    let fraction = simulator.frame_mixing_percentage;
    RgbImage::from_fn(photograph.width(), photograph.height(), |x, y| {
        let own = photograph.get_pixel(x, y).0;
        let mixed = |channel: usize| {
            let blurred = blurred[channel].at(x as usize, y as usize);
            fraction * blurred + (1.0 - fraction) * f64::from(own[channel])
        };
        // To the nearest level; rounding errors of the blur are far below half of one.
        image::Rgb([0, 1, 2].map(|channel| (mixed(channel) + 0.5) as u8))
    })
}

/// Taxim's Gaussian, which ends where it falls to 1e-5; from its middle on, both sides add up to 1.
fn weights(sigma_px: f64) -> Vec<f64> {
    let end = -2.0 * libm::log(1e-5 * (2.0 * std::f64::consts::PI).sqrt() * sigma_px);
    let reach = if sigma_px > 0.0 && end > 0.0 { libm::rint(end.sqrt() * sigma_px) as usize / 2 } else { 0 };
    let spread = sigma_px.max(f64::MIN_POSITIVE);
    let shape: Vec<f64> = (0..=reach).map(|k| libm::exp(-0.5 * (k as f64 / spread) * (k as f64 / spread))).collect();
    let sum = 2.0 * shape.iter().sum::<f64>() - shape[0];
    shape.iter().map(|weight| weight / sum).collect()
}

/// Blurs along the columns. Beyond its border the picture is mirrored at the border's pixels.
fn blurred_down(plane: &Grid<f64>, weights: &[f64]) -> Grid<f64> {
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
                // Counted from a whole number of periods further up, where nothing is negative.
                add(mirrored(y + period * weights.len() - k), *weight);
            }
        }
    }
    blurred
}

fn transposed(plane: &Grid<f64>) -> Grid<f64> {
    let (width, height) = (plane.height, plane.width);
    let data = (0..width * height).map(|at| plane.at(at / width, at % width)).collect();
    Grid { width, height, data }
}
