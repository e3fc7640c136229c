//! The sensor that took the images of a real set: the job that simulates it, its untouched pad, its noise.

use image::RgbImage;

use super::config::Augment;
use super::input::Set;
use super::photometric::Taken;
use super::photometric::noise::Level;
use crate::config::Job;
use crate::config::dataset::Dataset;
use crate::config::object::Object;
use crate::config::quantity::Quantity;
use crate::config::scene::{Face, Indentation, Pose};
use crate::dataset::png;
use crate::input as files;
use crate::optics::background::Reference;
use crate::plan::check::Check;
use crate::plan::{ranges, standalone, view};

/// What names the untouched pad as the sensor renders it.
const RENDERED: &str = "rendered";
/// Images between which a sensor's noise is measured.
const NOISE_IMAGES: usize = 16;

/// The job of which twins are samples.
pub fn job(check: &mut Check<'_>, written: &Augment, size: Option<[usize; 2]>) -> Job {
    let mut sensor = written.sensor.clone();
    if let Some([width, height]) = size {
        let there = check.document.get("sensor.resolution_px").map(|node| node.place.source);
        let own = there.is_some_and(|source| source == 0 || check.document.sources[source].name.starts_with("--"));
        if own && sensor.resolution_px != [width as u32, height as u32] {
            let message = format!("the images are {width}x{height} px, resolution_px is {:?}", sensor.resolution_px);
            check.wrong("sensor.resolution_px", message, "leave it out: the images' size is taken");
        }
        sensor.resolution_px = [width as u32, height as u32];
    }
    if written.pose.face == Face::Any && check.sound("pose") {
        check.wrong("pose.face", "a real sample has one side that faces the pad", "name it: one of +x -x +y -y +z -z");
    }
    Job {
        fidelity: written.fidelity.map(Into::into),
        gelpad: written.gelpad.clone(),
        optics: written.optics.clone(),
        dataset: Dataset {
            name: Some(String::from("twins")),
            samples: Some(1),
            seed: written.seed,
            ..Dataset::default()
        },
        sensor,
        object: written.object.iter().map(|object| Object { weight: 1.0, ..object.clone() }).collect(),
        pose: Pose { face: written.pose.face, anchor: written.pose.anchor, ..Pose::default() },
        indentation: Indentation { depth_mm: Some(Quantity::Constant(0.0)), no_contact: 0.0 },
        markers: written.markers.clone(),
        camera: written.camera.clone(),
        ..Job::default()
    }
}

/// The picture of the untouched pad, of the images' size.
pub fn background(check: &mut Check<'_>, written: &Augment, job: &Job, size: Option<[usize; 2]>) -> Option<Reference> {
    let name = written.input.background.as_ref()?;
    if name == RENDERED {
        // Of a sensor that is unsound nothing can be rendered, and it is said elsewhere.
        return check.problems.is_empty().then(|| Reference::rendered(&job.sensor, &view(job)));
    }
    let beside = check.document.folder("input.background").join(name);
    let inside = written.input.path.as_ref().map(|path| check.document.folder("input.path").join(path).join(name));
    let path = inside.filter(|inside| !beside.is_file() && inside.is_file()).unwrap_or(beside);
    let read = files::read(&path, files::MOST_IMAGE_BYTES).map_err(|error| error.to_string());
    match read.and_then(|bytes| png::decode_background(&bytes)) {
        Ok(picture) => {
            let found = [picture.width() as usize, picture.height() as usize];
            if let Some([width, height]) = size.filter(|size| *size != found) {
                let message =
                    format!("{} is {}x{} px, the images {width}x{height} px", path.display(), found[0], found[1]);
                check.wrong("input.background", message, "a picture of the untouched pad of the images' size");
                return None;
            }
            Some(Reference::new(found[0], found[1], picture.into_raw()))
        }
        Err(reason) => {
            let message = format!("cannot read the background {}: {reason}", path.display());
            check.wrong("input.background", message, "a PNG of the untouched pad belongs here");
            None
        }
    }
}

pub fn picture(reference: &Reference) -> Option<RgbImage> {
    let [width, height] = [reference.width, reference.height].map(|px| px as u32);
    RgbImage::from_raw(width, height, reference.rgb.clone())
}

/// The sensor that took the images. `None` after a mistake.
pub fn taken(check: &mut Check<'_>, job: &mut Job, set: Option<&Set>, own: Option<Reference>) -> Option<Taken> {
    let Some(set) = set else {
        ranges::sensor(check, job);
        return None;
    };
    let photograph = job.sensor.background.is_some();
    let standalone::Standalone { sensor, camera, reference, .. } = standalone::of(check, job)?;
    let noise = Level::of(&job.camera).or_else(|| Level::measured(&some_images(set)));
    Some(Taken { sensor, view: camera, background: own.or(photograph.then_some(reference)), noise })
}

/// Some images of a set, evenly spread; those that cannot be read are left out, which is said later.
fn some_images(set: &Set) -> Vec<RgbImage> {
    let count = set.reals.len().min(NOISE_IMAGES);
    let picks = (0..count).map(|k| &set.reals[k * set.reals.len() / count]);
    picks.filter_map(|real| set.image(real).ok()).filter_map(|bytes| png::decode_background(&bytes).ok()).collect()
}
