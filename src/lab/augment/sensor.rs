//! The sensor that took the images of a real set: the job that simulates it, its background, its noise.

use image::RgbImage;

use super::config::Augment;
use super::input::Set;
use super::photometric::background::picture_help;
use super::photometric::noise::NoiseLevel;
use super::photometric::{SensorProfile, rendered};
use gelsim_core::base::view::View;
use gelsim_core::camera::projection::LensModel;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::sensor as simulated;
use gelsim_files::image_file;
use gelsim_files::input as files;
use gelsim_job::config::Job;
use gelsim_job::config::dataset::Dataset;
use gelsim_job::config::object::Object;
use gelsim_job::config::scene::{Face, Pose};
use gelsim_job::plan::check::Check;
use gelsim_job::plan::{ranges, standalone};

/// What names the background image that the sensor renders.
pub const RENDERED: &str = "rendered";
/// Images between which a sensor's noise is measured.
const NOISE_IMAGES: usize = 16;

/// What simulated counterparts depend on: a job without a dataset, whose presses the real samples say.
pub fn job(check: &mut Check<'_>, written: &Augment, size: Option<[usize; 2]>) -> Job {
    let mut sensor = written.sensor.clone();
    if let Some([width, height]) = size {
        let node = check.document.get("sensor.resolution_px").map(|node| node.place.source);
        let own = node.is_some_and(|source| source == 0 || check.document.sources[source].name.starts_with("--"));
        if own && sensor.resolution_px != [width as u32, height as u32] {
            let message = format!("the images are {width}x{height} px, resolution_px is {:?}", sensor.resolution_px);
            check.error("sensor.resolution_px", message, "leave it out: the images' size is taken");
        }
        sensor.resolution_px = [width as u32, height as u32];
    }
    if matches!(written.pose.face, Face::Any | Face::Auto) && check.sound("pose") {
        check.error("pose.face", "a real sample has one side that faces the pad", "name it: one of +x -x +y -y +z -z");
    }
    Job {
        fidelity: written.fidelity.map(Into::into),
        gelpad: written.gelpad.clone(),
        optics: written.optics.clone(),
        // Where what is still random of a counterpart comes from.
        dataset: Dataset { seed: written.seed, ..Dataset::default() },
        sensor,
        object: written.object.iter().map(|object| Object { weight: 1.0, ..object.clone() }).collect(),
        pose: Pose { face: written.pose.face, anchor: written.pose.anchor, ..Pose::default() },
        markers: written.markers.clone(),
        camera: written.camera.clone(),
        ..Job::default()
    }
}

/// The background image, of the images' size.
pub fn background(
    check: &mut Check<'_>,
    written: &Augment,
    job: &Job,
    size: Option<[usize; 2]>,
) -> Option<BackgroundImage> {
    let name = written.input.background.as_ref()?;
    if name == RENDERED {
        // Of a sensor that is unsound nothing can be rendered, and it is said elsewhere. That of a gel that has a shape needs its files.
        let can_be = check.problems.is_empty() && job.sensor.shape.is_none();
        return can_be.then(|| BackgroundImage::clone(&job.bare_sensor().background()));
    }
    let beside = check.document.folder("input.background").join(name);
    let inside = written.input.path.as_ref().map(|path| check.document.folder("input.path").join(path).join(name));
    let path = inside.filter(|inside| !beside.is_file() && inside.is_file()).unwrap_or(beside);
    let read = files::read(&path, files::MOST_IMAGE_BYTES).map_err(|error| error.to_string());
    match read.and_then(|bytes| image_file::decode_rgb(&bytes)) {
        Ok(picture) => {
            let found = [picture.width() as usize, picture.height() as usize];
            if let Some([width, height]) = size.filter(|size| *size != found) {
                let message =
                    format!("{} is {}x{} px, the images {width}x{height} px", path.display(), found[0], found[1]);
                let help =
                    "name a picture that was taken as the images were, or bring it to their size as they were brought";
                check.error("input.background", message, help);
                return None;
            }
            Some(BackgroundImage::new(found[0], found[1], picture.into_raw()))
        }
        Err(reason) => {
            let message = format!("cannot read the background {}: {reason}", path.display());
            check.error("input.background", message, picture_help(&path));
            None
        }
    }
}

/// As an image; `None` if the sizes are not those of its bytes.
pub fn background_image(reference: &BackgroundImage) -> Option<RgbImage> {
    let [width, height] = [reference.width, reference.height].map(|px| px as u32);
    RgbImage::from_raw(width, height, reference.rgb.clone())
}

/// The sensor that took the images. `None` after a mistake.
pub fn profile(
    check: &mut Check<'_>,
    job: &mut Job,
    set: Option<&Set>,
    own: Option<BackgroundImage>,
    is_rendered: bool,
) -> Option<SensorProfile> {
    let Some(set) = set else {
        ranges::sensor(check, job);
        return None;
    };
    let standalone::Standalone { written, sensor } = standalone::resolve(check, job)?;
    let noise = NoiseLevel::from_camera(&job.camera).or_else(|| NoiseLevel::from_images(&some_images(set)));
    let photograph = sensor.has_photograph().then(|| BackgroundImage::clone(&sensor.background()));
    let view = pixels(&sensor);
    let background = match (own.or(photograph), is_rendered && sensor.shape.is_some()) {
        (None, true) => Some(rendered(sensor)),
        (known, _) => known,
    };
    Some(SensorProfile { sensor: written, view, background, noise })
}

/// The image's pixels; on a gel that has a shape only how wide they are for their height means something.
fn pixels(sensor: &simulated::Sensor) -> View {
    match (&sensor.shape, sensor.lens) {
        (None, _) => sensor.view(),
        (Some(_), LensModel::Orthographic) => {
            let mm_per_px = std::array::from_fn(|k| sensor.field_of_view_mm[k] / sensor.resolution_px[k].max(1) as f64);
            View { resolution_px: sensor.resolution_px, mm_per_px }
        }
        (Some(_), _) => View { resolution_px: sensor.resolution_px, mm_per_px: [1.0; 2] },
    }
}

/// Some images of a set, evenly spread; those that cannot be read are left out, which is said later.
fn some_images(set: &Set) -> Vec<RgbImage> {
    let count = set.reals.len().min(NOISE_IMAGES);
    let picks = (0..count).map(|k| &set.reals[k * set.reals.len() / count]);
    picks.filter_map(|real| set.image(real).ok()).filter_map(|bytes| image_file::decode_rgb(&bytes).ok()).collect()
}
