//! The images that a job names: read, checked, and remembered by their hashes.

use std::sync::Arc;

use super::check::Check;
use super::view;
use crate::core::base::view::MOST_PX;
use crate::core::depth::relief::Relief;
use crate::core::depth::rest::RestSurface;
use crate::core::optics::background::BackgroundImage;
use crate::core::optics::calibrated::Table;
use crate::core::sensor::Background;
use crate::files::sensor::RestShape;
use crate::files::{hash, heights, input, png};
use crate::job::config::Job;
use crate::job::config::texture::Pattern;

/// Reads the file that the key at `key` names. Sets `path` to where it was found and `sha256` to its hash, which must be
/// the one that the job gives. `None` after a mistake.
fn read<T>(
    check: &mut Check<'_>,
    key: &str,
    what: &str,
    path: &mut String,
    sha256: &mut Option<String>,
    decode: impl Fn(&[u8]) -> Result<T, String>,
) -> Option<T> {
    let found = check.document.folder(key).join(&path);
    let bytes = match found.to_str() {
        Some(_) => input::read(&found, input::MOST_IMAGE_BYTES).map_err(|error| error.to_string()),
        None => Err(String::from("its path is not UTF-8, so that no job can hold it")),
    };
    let (content, hash) = match bytes.and_then(|bytes| Ok((decode(&bytes)?, hash::sha256(&bytes)))) {
        Ok(read) => read,
        Err(reason) => {
            let message = format!("cannot read the {what} {}: {reason}", found.display());
            let help = match what {
                "background" => "an 8-bit PNG of the untouched pad belongs here",
                "calibration" => "the table that `gelsim calibrate` wrote beside its sensor file belongs here",
                _ => "a grey PNG of 8 or 16 bits, or an npy or EXR file with values from 0 to 1, belongs here",
            };
            check.error(key, message, help);
            return None;
        }
    };
    if sha256.as_ref().is_some_and(|expected| *expected != hash) {
        let message = format!("the {what} {} has changed: its SHA-256 is {hash}", found.display());
        let (table, name) = key.rsplit_once('.').unwrap_or(("", key));
        let own = match name {
            "path" => String::from("sha256"),
            name => format!("{name}_sha256"),
        };
        check.error(&format!("{table}.{own}"), message, "restore the file, or remove this key");
    }
    *path = found.to_string_lossy().into_owned();
    *sha256 = Some(hash);
    Some(content)
}

/// The background image, and a note where a photograph was resampled. `None` after a mistake.
pub fn background(check: &mut Check<'_>, job: &mut Job) -> Option<(Background, Option<String>)> {
    let [width, height] = view(job).resolution_px;
    let sizes = [width, height].iter().all(|size| (1..=MOST_PX).contains(size));
    let Some(path) = &mut job.sensor.background else {
        let sound = sizes && check.problems.is_empty();
        return sound.then(|| (Background::Rendered(job.sensor.rendered_background.clone()), None));
    };
    let sha256 = &mut job.sensor.background_sha256;
    let image = read(check, "sensor.background", "background", path, sha256, png::decode_background)?;
    if !sizes {
        return None;
    }
    let size = (width as u32, height as u32);
    let note = (image.dimensions() != size).then(|| {
        let (w, h) = image.dimensions();
        format!("{path}: {w}x{h} px, resampled to the sensor's {width}x{height} px")
    });
    let image = match note {
        Some(_) => image::imageops::resize(&image, size.0, size.1, image::imageops::FilterType::Triangle),
        None => image,
    };
    Some((Background::Photograph(Arc::new(BackgroundImage::new(width, height, image.into_raw()))), note))
}

/// What was measured on the sensor, if anything was. `None` after a mistake, too.
pub fn calibration(check: &mut Check<'_>, job: &mut Job) -> Option<Table> {
    let path = job.sensor.calibration.as_mut()?;
    read(check, "sensor.calibration", "calibration", path, &mut job.sensor.calibration_sha256, Table::parse)
}

/// The texture's patterns, made ready; none if no sample has any. Those that cannot be read are left out, and said.
pub fn textures(check: &mut Check<'_>, job: &mut Job) -> Vec<Arc<Relief>> {
    // Patterns take a while to make: not for a job that is refused anyway.
    let wanted = job.texture.amplitude_mm.support().1 > 0.0 && check.problems.is_empty();
    let mut ready = Vec::new();
    for (i, pattern) in job.texture.patterns.iter_mut().enumerate() {
        let relief = match pattern {
            Pattern::Image(image) => {
                let key = format!("texture.patterns.{i}.image.path");
                read(check, &key, "height map", &mut image.path, &mut image.sha256, heights::decode)
                    .map(Relief::from_heights)
            }
            pattern => pattern.procedural().filter(|_| wanted).map(Relief::procedural),
        };
        ready.extend(relief.map(Arc::new));
    }
    if wanted { ready } else { Vec::new() }
}

/// The shape of a pad that is not flat. `None` after a mistake, too.
pub fn rest_surface(check: &mut Check<'_>, job: &mut Job) -> Option<RestSurface> {
    match job.sensor.rest_shape.as_mut()? {
        RestShape::Dome(dome) => Some(RestSurface::Dome { radius_mm: dome.radius_mm }),
        RestShape::HeightMap(map) => {
            let key = "sensor.rest_shape.height_map.path";
            let heights = read(check, key, "height map", &mut map.path, &mut map.sha256, heights::decode)?;
            Some(RestSurface::HeightMap { heights: Arc::new(heights), height_mm: map.height_mm })
        }
    }
}
