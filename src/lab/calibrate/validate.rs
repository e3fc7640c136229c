//! Errors of presses that were not learnt from: each fifth of the presses is simulated by a model of the others.

use image::RgbImage;
use rayon::prelude::*;

use super::leds::fit_leds;
use super::progress::Work;
use super::train::Settings;
use super::{Geometry, Session, Surfaces, fit, picture, pixels, table};
use crate::compare::score::{Scores, score};
use gelsim_core::base::rng::stream;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::optics::calibrated::{Calibrated, Shader};

/// Parts that the presses are divided into.
pub const FOLDS: usize = 5;

/// Steps of training that take as long as simulating one press.
const PRESS_STEPS: u64 = 10;

/// The work of [`cross_validate`], in steps of training.
pub fn work(presses: usize, settings: &Settings) -> u64 {
    (FOLDS * settings.networks * settings.steps) as u64 + PRESS_STEPS * presses as u64
}

/// A press simulated by a model that has not seen it.
pub struct HeldOut {
    /// The picture.
    pub simulated: RgbImage,
    /// How far it is from the real one.
    pub scores: Scores,
}

/// Which part each of `count` presses belongs to.
pub fn folds(count: usize) -> Vec<usize> {
    let mut random = stream(2, "calibration", 0);
    let mut fold = vec![0; count];
    for (place, press) in random.some_of((0..count).collect(), count).into_iter().enumerate() {
        fold[press] = place % FOLDS;
    }
    fold
}

/// Simulates every press by a model of the other parts' presses.
pub fn cross_validate(
    session: &Session,
    surfaces: &Surfaces,
    pixels: &[pixels::Pixels],
    geometry: Geometry,
    settings: &Settings,
    work: &Work,
) -> Vec<HeldOut> {
    let fold = folds(session.observations.len());
    let rest = session.reference();
    let shaders: Vec<Shader> = (0..FOLDS)
        .into_par_iter()
        .map(|part| {
            let others: Vec<&pixels::Pixels> =
                pixels.iter().zip(&fold).filter(|(_, fold)| **fold != part).map(|(pixels, _)| pixels).collect();
            let table = table(fit(session, &others, settings, part as u64, work), geometry);
            let table = match fit_leds(others.iter().copied()) {
                Some(leds) => table.with_beyond(leds.beyond()),
                None => table,
            };
            Shader::new(Calibrated::default(), Some(&table), &session.camera)
        })
        .collect();
    let held_out = |k: usize| {
        let light =
            shaders[fold[k]].shade(&surfaces.contacts[k], &rest, &mut EffectLog::new(EffectPolicy::WhereNeeded));
        let simulated = picture(&light, &rest);
        let observation = &session.observations[k];
        let scores = score(&observation.image, &simulated, Some(&observation.circle), pixels::DILATE);
        work.add(PRESS_STEPS, "simulating presses that were not fitted");
        HeldOut { simulated, scores }
    };
    (0..session.observations.len()).into_par_iter().map(held_out).collect()
}
