//! Real presses, where `GELSIM_REAL_DATA` names a folder of them. Nothing of it is in the project.

use std::path::{Path, PathBuf};

use gelsim_core::base::grid::Resolution;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::{gelpad, optics};
use gelsim_files::sensor::Sensor;
use gelsim_lab::calibrate::pixels::ERROR_REACH;
use gelsim_lab::calibrate::{Session, light_to_rgb, session};
use gelsim_lab::compare::score::{Score, Scores, score_images};
use gelsim_lab::presses;
use image::RgbImage;
use rayon::prelude::*;

/// The folder, if the environment names it.
pub fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("GELSIM_REAL_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("GELSIM_REAL_DATA names no folder with real presses: nothing is tested here");
    }
    folder
}

/// The presses in a sensor's folder; None, with a message, where they cannot be calibrated from.
pub fn session(folder: &Path) -> Option<Session> {
    let [table, background] = ["annotations.csv", "background.png"].map(|file| folder.join(file));
    let read = |table| session::read_session(table, &background, Sensor::default(), false, session::MIN_PRESSES);
    match presses::read(&table).and_then(read) {
        Ok((session, _)) => Some(session),
        Err(_) => {
            println!("{}: no table of circles and balls of known size", folder.display());
            None
        }
    }
}

/// The pad that calibration learns on.
pub fn half() -> gelpad::Model {
    gelpad::Model::Elastic(Elastic { resolution: Resolution::Half, ..Elastic::default() })
}

/// A picture for each contact.
pub fn simulate(session: &Session, contacts: &[Contact], shader: &optics::Shader) -> Vec<RgbImage> {
    let rest = session.to_background_image();
    let one = |contact: &Contact| {
        light_to_rgb(&shader.shade(contact, &rest, &mut EffectLog::new(EffectPolicy::WhereNeeded)).into_light(), &rest)
    };
    contacts.par_iter().map(one).collect()
}

/// How far pictures are from the real ones.
pub fn score_pictures(session: &Session, pictures: &[RgbImage]) -> Vec<Scores> {
    let pairs = session.observations.par_iter().zip(pictures);
    pairs
        .map(|(observation, picture)| score_images(&observation.image, picture, Some(&observation.circle), ERROR_REACH))
        .collect()
}

/// MAE of the contact, levels; 0 without one.
pub fn contact_mae(scores: &Scores) -> f64 {
    scores.contact.map_or(0.0, |contact| contact.mae)
}

/// Means as the tables have them: MAE, PSNR and SSIM of the contact, MAE of the whole image.
pub fn format_means<'a>(scores: impl Iterator<Item = &'a Scores> + Clone) -> String {
    let figures =
        |score: Score| format!("{:5.2} / {:5.2} / {:.3}", score.mae, score.psnr_db.unwrap_or(f64::NAN), score.ssim);
    let contact = Score::mean(scores.clone().filter_map(|scores| scores.contact.as_ref()));
    let whole = Score::mean(scores.map(|scores| &scores.full_image));
    format!("{} | {:5.2}", contact.map_or(String::new(), figures), whole.map_or(f64::NAN, |whole| whole.mae))
}

/// Mean of numbers; NaN without any.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count)
}

/// Writes a picture into the folder that `GELSIM_REALITY_OUT` names, if it names one.
pub fn write(name: &str, picture: &RgbImage) {
    let Some(folder) = std::env::var_os("GELSIM_REALITY_OUT").map(PathBuf::from) else { return };
    std::fs::create_dir_all(&folder).expect("a folder that can be written");
    picture.save(folder.join(name)).expect("a picture that can be written");
}
