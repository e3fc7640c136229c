//! Reads and checks the images and tables that a job names, and remembers their hashes.

use std::io;
use std::path::Path;
use std::sync::Arc;

use super::check::JobChecker;
use super::paths::FileKind;
use super::{paths, sensor_view};
use crate::config::Job;
use crate::config::document::RESOLVED_HEADER;
use crate::config::texture::{Pattern, TextureDistribution};
use gelsim_core::base::view::MOST_PX;
use gelsim_core::depth::relief::Relief;
use gelsim_core::depth::rest_surface::RestSurface;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::calibrated::CalibrationTable;
use gelsim_files::calibration;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::sensor::RestShape;
use gelsim_files::{hash, heights, image_file, input};

/// Reads the file that is named at `key`. Sets `path` to where it was found and `sha256` to its hash, which must be the
/// one that the job gives. Errors are reported; after one, `None` is returned if there is no content.
pub fn read_input_file<T>(
    check: &mut JobChecker<'_>,
    key: &str,
    kind: &FileKind,
    path: &mut String,
    sha256: &mut Option<String>,
    decode: impl Fn(&[u8]) -> Result<T, String>,
) -> Option<T> {
    if paths::refuse_empty_path(check, key, path, kind) {
        return None;
    }
    let found = check.document.folder_of(key).join(&path);
    let is_there = found.is_file();
    let bytes = match found.to_str() {
        Some(_) => input::read(&found, input::MAX_IMAGE_BYTES).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => String::from("it does not exist"),
            _ => error.to_string(),
        }),
        None => Err(String::from("its path is not UTF-8, so that no job can hold it")),
    };
    let (content, hash) = match bytes.and_then(|bytes| Ok((decode(&bytes)?, hash::sha256(&bytes)))) {
        Ok(read) => read,
        Err(reason) => {
            let message = format!("cannot read the {} {}: {reason}", kind.name, found.display());
            // A table of another version is a table: the reason already says what to do.
            let is_table = kind.key == paths::CALIBRATIONS.key && !reason.starts_with("no table") && is_there;
            let help = match is_there {
                true if is_table => String::from("gelsim calibrate writes it, beside the sensor file"),
                true => kind.what.to_owned(),
                false => paths::suggest_for_missing(check, key, path, kind),
            };
            check.report_error(key, message, help);
            return None;
        }
    };
    let own_key = || {
        let (table, name) = key.rsplit_once('.').unwrap_or(("", key));
        match (table.strip_suffix(".layout"), name) {
            (_, "path") => format!("{table}.sha256"),
            // For the key `layout.file`, the hash stands beside `layout`.
            (Some(table), _) => format!("{table}.layout_sha256"),
            (None, name) => format!("{table}.{name}_sha256"),
        }
    };
    check_hash(check, own_key, sha256.as_deref(), &hash, || format!("the {} {}", kind.name, found.display()));
    *path = found.to_string_lossy().into_owned();
    *sha256 = Some(hash);
    Some(content)
}

/// Reports a file that has not the SHA-256 that the job gives at a key.
pub fn check_hash(
    check: &mut JobChecker<'_>,
    key: impl Fn() -> String,
    expected: Option<&str>,
    hash: &str,
    file: impl Fn() -> String,
) {
    let Some(expected) = expected.filter(|expected| !expected.eq_ignore_ascii_case(hash)) else { return };
    if expected.len() != 64 || !expected.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        let message = format!("no SHA-256: that of {} is {hash}", file());
        check.report_error(&key(), message, "write that, as sha256sum prints it, or remove this key");
    } else {
        let message = format!("{} has changed: its SHA-256 is {hash}", file());
        check.report_error(&key(), message, help_for_changed_file(check));
    }
}

/// Says what to do when a file is not the one whose SHA-256 a job gives.
fn help_for_changed_file(check: &JobChecker<'_>) -> &'static str {
    match check.document.sources.first().is_some_and(|source| source.text.starts_with(RESOLVED_HEADER)) {
        true => "restore the file; the file as it is makes another dataset: generate it into another folder",
        false => "restore the file, or remove this key",
    }
}

/// A photograph of the untouched pad.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Name of the file.
    pub file: String,
    /// SHA-256 of the file in lower-case hex.
    pub sha256: String,
    /// The image.
    pub image: Arc<BackgroundImage>,
}

/// Loads the photographs of the untouched pad that the job names, if any, with a note if one was stretched. Returns
/// `None` after an error.
pub fn load_backgrounds(check: &mut JobChecker<'_>, job: &mut Job) -> Option<(Vec<Photograph>, Option<Diagnostic>)> {
    let size = sensor_view(job).resolution_px;
    // A size that is out of range is reported elsewhere.
    let size = size.iter().all(|size| (1..=MOST_PX).contains(size)).then_some(size);
    if !job.random.backgrounds.is_empty() {
        return load_sample_backgrounds(check, job, size).map(|photographs| (photographs, None));
    }
    if !job.random.background_sha256.is_empty() {
        check.report_error("sensor.background_sha256", "a list of hashes for one background", "write the hash alone");
        return None;
    }
    // An empty list of backgrounds was reported before.
    if job.sensor.background.as_deref() == Some("") && !check.is_valid("sensor.background") {
        return None;
    }
    let Some(path) = &mut job.sensor.background else {
        return (size.is_some() && check.problems.is_empty()).then(|| (Vec::new(), None));
    };
    let sha256 = &mut job.sensor.background_sha256;
    let image = read_input_file(check, "sensor.background", &paths::BACKGROUNDS, path, sha256, image_file::decode_rgb)?;
    let [width, height] = size?;
    let expected = (width as u32, height as u32);
    let note = note_resampling(check, path, image.dimensions(), [width, height], job.sensor.field_of_view_mm);
    let image = match image.dimensions() != expected {
        true => image::imageops::resize(&image, expected.0, expected.1, image::imageops::FilterType::Triangle),
        false => image,
    };
    let photograph = Photograph {
        file: file_name(path),
        sha256: sha256.clone().unwrap_or_default(),
        image: Arc::new(BackgroundImage::new(width, height, image.into_raw())),
    };
    Some((vec![photograph], note))
}

/// Makes a note for a background with other proportions than the sensor's. One that only has more or fewer pixels needs
/// none.
fn note_resampling(
    check: &JobChecker<'_>,
    path: &str,
    (w, h): (u32, u32),
    [width, height]: [usize; 2],
    view_mm: [f64; 2],
) -> Option<Diagnostic> {
    /// The greatest difference of proportions that is taken for rounding.
    const ALIKE: f64 = 0.02;
    let stretched = f64::from(w) * height as f64 / (f64::from(h) * width as f64);
    ((stretched - 1.0).abs() > ALIKE).then(|| {
        let message = format!("{path} has {w}x{h} px, which are stretched to the sensor's {width}x{height} px");
        let help = format!(
            "give the sensor the photograph's size, `resolution_px = [{w}, {h}]`, and a `field_of_view_mm` of its proportions \
             (now {} x {} mm)",
            view_mm[0], view_mm[1]
        );
        Diagnostic::warning(message).help(help).at(check.document.place_of("sensor.background"))
    })
}

/// Most background images of a job. Each takes 2 MB of memory at 640 x 480.
const MAX_BACKGROUNDS: usize = 1000;

/// Loads the backgrounds of which each sample gets one. They must have the sensor's own size. `job` then names every
/// file.
fn load_sample_backgrounds(
    check: &mut JobChecker<'_>,
    job: &mut Job,
    size: Option<[usize; 2]>,
) -> Option<Vec<Photograph>> {
    let is_list = check.document.get("sensor.background").is_some_and(|node| node.as_str().is_none());
    let mut named: Vec<(String, String)> = Vec::new();
    let mut found_all = true;
    for (i, written) in job.random.backgrounds.iter().enumerate() {
        let place = if is_list { format!("sensor.background.{i}") } else { String::from("sensor.background") };
        match paths::find_files(check, &place, written, &paths::BACKGROUNDS) {
            // Make paths absolute, so that they are not joined to a folder again.
            Ok(found) => named.extend(found.into_iter().map(|path| {
                let path = std::path::absolute(&path).unwrap_or(path);
                (place.clone(), path.to_string_lossy().into_owned())
            })),
            Err(_) => found_all = false,
        }
    }
    if named.len() > MAX_BACKGROUNDS {
        let message = format!("{} background images", named.len());
        check.report_error("sensor.background", message, format!("allowed: up to {MAX_BACKGROUNDS}"));
        return None;
    }
    let given = std::mem::take(&mut job.random.background_sha256);
    if found_all && !given.is_empty() && given.len() != named.len() {
        let message = format!("{} hashes for {} background images", given.len(), named.len());
        check.report_error(
            "sensor.background_sha256",
            message,
            "one for each image, in the order of their names; or leave it out",
        );
    }
    let mut photographs = Vec::new();
    for (i, (place, path)) in named.iter_mut().enumerate() {
        let mut sha256 = None;
        let Some(image) = read_input_file(check, place, &paths::BACKGROUNDS, path, &mut sha256, image_file::decode_rgb)
        else {
            continue;
        };
        let sha256 = sha256.unwrap_or_default();
        if given.get(i).is_some_and(|given| *given != sha256) {
            let message = format!("the background {path} has changed: its SHA-256 is {sha256}");
            let help = help_for_changed_file(check);
            check.report_error(&format!("sensor.background_sha256.{i}"), message, help);
        }
        let found = [image.width() as usize, image.height() as usize];
        match size {
            Some(size) if size == found => {
                let image = Arc::new(BackgroundImage::new(size[0], size[1], image.into_raw()));
                photographs.push(Photograph { file: file_name(path), sha256, image });
            }
            Some([width, height]) => {
                let message = format!("{path} is {}x{} px, the sensor {width}x{height} px", found[0], found[1]);
                let help = "where samples choose a background, all have the sensor's size; or set resolution_px";
                check.report_error(place, message, help);
            }
            None => {}
        }
    }
    if !found_all || photographs.len() != named.len() || size.is_none() {
        return None;
    }
    job.sensor.background = named.first().map(|(_, path)| path.clone());
    job.sensor.background_sha256 = photographs.first().map(|photograph| photograph.sha256.clone());
    if photographs.len() == 1 {
        // With one image there is nothing to choose.
        job.random.backgrounds.clear();
    } else {
        job.random.backgrounds = named.into_iter().map(|(_, path)| path).collect();
        job.random.background_sha256 = photographs.iter().map(|photograph| photograph.sha256.clone()).collect();
    }
    Some(photographs)
}

/// Returns the last part of a path.
pub fn file_name(path: &str) -> String {
    Path::new(path).file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// Loads the sensor's calibration table. Returns `None` if it has none, or after an error.
pub fn load_calibration(check: &mut JobChecker<'_>, job: &mut Job) -> Option<CalibrationTable> {
    let path = job.sensor.calibration.as_mut()?;
    read_input_file(
        check,
        "sensor.calibration",
        &paths::CALIBRATIONS,
        path,
        &mut job.sensor.calibration_sha256,
        calibration::parse_calibration,
    )
}

/// Loads the patterns of the texture at the key `at`; none if no sample has texture. A pattern that cannot be read is
/// left out and reported.
pub fn load_textures(check: &mut JobChecker<'_>, at: &str, texture: &mut TextureDistribution) -> Vec<Arc<Relief>> {
    // Patterns take a while to make, so none are made for a job that is refused anyway.
    let wanted = texture.amplitude_mm.support().1 > 0.0 && check.problems.is_empty();
    let mut ready = Vec::new();
    for (i, pattern) in texture.patterns.iter_mut().enumerate() {
        let relief = match pattern {
            Pattern::Image(image) => {
                let key = format!("{at}.patterns.{i}.image.path");
                read_input_file(
                    check,
                    &key,
                    &paths::HEIGHT_MAPS,
                    &mut image.path,
                    &mut image.sha256,
                    heights::decode_height_map,
                )
                .map(Relief::from_heights)
            }
            pattern => pattern.to_procedural().filter(|_| wanted).map(Relief::procedural),
        };
        ready.extend(relief.map(Arc::new));
    }
    if wanted { ready } else { Vec::new() }
}

/// Loads the shape of a pad that is nearly flat. Returns `None` if the pad is flat, or after an error.
pub fn load_rest_surface(check: &mut JobChecker<'_>, job: &mut Job) -> Option<RestSurface> {
    match job.sensor.rest_shape.as_mut()? {
        RestShape::Dome(dome) => Some(RestSurface::Dome { radius_mm: dome.radius_mm }),
        RestShape::HeightMap(map) => {
            let key = "sensor.rest_shape.height_map.path";
            let heights = read_input_file(
                check,
                key,
                &paths::HEIGHT_MAPS,
                &mut map.path,
                &mut map.sha256,
                heights::decode_height_map,
            )?;
            Some(RestSurface::HeightMap { heights: Arc::new(heights), height_mm: map.height_mm })
        }
    }
}
