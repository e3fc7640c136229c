//! The sensor that took the images of a real set: a job that simulates it, its background, its noise.

use image::RgbImage;

use super::config::Augment;
use super::input::RealDataset;
use super::photometric::background::picture_help;
use super::photometric::{SensorProfile, render_background};
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
use gelsim_job::plan::check::JobChecker;
use gelsim_job::plan::{ranges, standalone};
use gelsim_lab::metrics::noise::NoiseLevel;

/// Name that means the background image which the sensor renders.
pub const RENDERED: &str = "rendered";
/// Number of images between which a sensor's noise is measured.
const NOISE_IMAGES: usize = 16;

/// Builds the job for simulated counterparts: without a dataset, because the real samples state the presses.
pub fn build_sensor_job(check: &mut JobChecker<'_>, written: &Augment, size: Option<[usize; 2]>) -> Job {
    let mut sensor = written.sensor.clone();
    if let Some([width, height]) = size {
        let node = check.document.get("sensor.resolution_px").map(|node| node.place.source);
        let own = node.is_some_and(|source| source == 0 || check.document.sources[source].name.starts_with("--"));
        if own && sensor.resolution_px != [width as u32, height as u32] {
            let message = format!("the images are {width}x{height} px, resolution_px is {:?}", sensor.resolution_px);
            check.report_error("sensor.resolution_px", message, "leave it out: the images' size is taken");
        }
        sensor.resolution_px = [width as u32, height as u32];
    }
    if matches!(written.pose.face, Face::Any | Face::Auto) && check.is_valid("pose") {
        check.report_error(
            "pose.face",
            "a real sample has one side that faces the pad",
            "name it: one of +x -x +y -y +z -z",
        );
    }
    Job {
        fidelity: written.fidelity.map(Into::into),
        gelpad: written.gelpad.clone(),
        optics: written.optics.clone(),
        // What is random in a counterpart comes from this seed.
        dataset: Dataset { seed: written.seed, ..Dataset::default() },
        sensor,
        object: written.object.iter().map(|object| Object { weight: 1.0, ..object.clone() }).collect(),
        pose: Pose { face: written.pose.face, anchor: written.pose.anchor, ..Pose::default() },
        markers: written.markers.clone(),
        camera: written.camera.clone(),
        ..Job::default()
    }
}

/// Reads the background image, which must have the images' size.
pub fn read_background(
    check: &mut JobChecker<'_>,
    written: &Augment,
    job: &Job,
    size: Option<[usize; 2]>,
) -> Option<BackgroundImage> {
    let name = written.input.background.as_ref()?;
    if name == RENDERED {
        // An unsound sensor is reported elsewhere, and cannot be rendered. A gel that has a shape needs its files
        // first.
        let can_be = check.problems.is_empty() && job.sensor.shape.is_none();
        return can_be.then(|| BackgroundImage::clone(&job.sensor_without_files().background()));
    }
    let beside = check.document.folder_of("input.background").join(name);
    let inside = written.input.path.as_ref().map(|path| check.document.folder_of("input.path").join(path).join(name));
    let path = inside.filter(|inside| !beside.is_file() && inside.is_file()).unwrap_or(beside);
    let read = files::read(&path, files::MAX_IMAGE_BYTES).map_err(|error| error.to_string());
    match read.and_then(|bytes| image_file::decode_rgb(&bytes)) {
        Ok(picture) => {
            let found = [picture.width() as usize, picture.height() as usize];
            if let Some([width, height]) = size.filter(|size| *size != found) {
                let message =
                    format!("{} is {}x{} px, the images {width}x{height} px", path.display(), found[0], found[1]);
                let help =
                    "name a picture that was taken as the images were, or bring it to their size as they were brought";
                check.report_error("input.background", message, help);
                return None;
            }
            Some(BackgroundImage::new(found[0], found[1], picture.into_raw()))
        }
        Err(reason) => {
            let message = format!("cannot read the background {}: {reason}", path.display());
            check.report_error("input.background", message, picture_help(&path));
            None
        }
    }
}

/// Turns the background into an image; `None` if its size does not match its bytes.
pub fn background_to_rgb(reference: &BackgroundImage) -> Option<RgbImage> {
    let [width, height] = [reference.width, reference.height].map(|px| px as u32);
    RgbImage::from_raw(width, height, reference.rgb.clone())
}

/// Builds the profile of the sensor that took the images. `None` after a mistake.
pub fn build_sensor_profile(
    check: &mut JobChecker<'_>,
    job: &mut Job,
    set: Option<&RealDataset>,
    own: Option<BackgroundImage>,
    is_rendered: bool,
) -> Option<SensorProfile> {
    let Some(set) = set else {
        ranges::check_sensor(check, job);
        return None;
    };
    let standalone::StandaloneSensor { written, sensor } = standalone::resolve_sensor(check, job)?;
    let noise = NoiseLevel::from_camera(&job.camera).or_else(|| NoiseLevel::from_images(&read_some_images(set)));
    let photograph = sensor.has_photograph().then(|| BackgroundImage::clone(&sensor.background()));
    let view = image_view(&sensor);
    let background = match (own.or(photograph), is_rendered && sensor.shape.is_some()) {
        (None, true) => Some(render_background(sensor)),
        (known, _) => known,
    };
    Some(SensorProfile { sensor: written, view, background, noise })
}

/// Returns the view of the images. On a gel that has a shape, only the ratio of a pixel's width to its height has a
/// meaning.
fn image_view(sensor: &simulated::Sensor) -> View {
    match (&sensor.shape, sensor.lens) {
        (None, _) => sensor.view(),
        (Some(_), LensModel::Orthographic) => {
            let mm_per_px = std::array::from_fn(|k| sensor.field_of_view_mm[k] / sensor.resolution_px[k].max(1) as f64);
            View { resolution_px: sensor.resolution_px, mm_per_px }
        }
        (Some(_), _) => View { resolution_px: sensor.resolution_px, mm_per_px: [1.0; 2] },
    }
}

/// Reads some images of a set, evenly spread. Unreadable ones are skipped here; they are reported later.
fn read_some_images(set: &RealDataset) -> Vec<RgbImage> {
    let count = set.reals.len().min(NOISE_IMAGES);
    let picks = (0..count).map(|k| &set.reals[k * set.reals.len() / count]);
    picks.filter_map(|real| set.read_image(real).ok()).filter_map(|bytes| image_file::decode_rgb(&bytes).ok()).collect()
}
