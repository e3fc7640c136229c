//! Computes the errors of presses that were not learnt from: each fifth of the presses is simulated by a model of the
//! others.

use image::RgbImage;
use rayon::prelude::*;

use super::leds::fit_leds;
use super::progress::ProgressMeter;
use super::train::TrainingSettings;
use super::{Geometry, PressSurfaces, Session, build_table, fit_response, light_to_rgb, pixels};
use crate::compare::score::{Scores, score_images};
use gelsim_core::base::rng::random_stream;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::optics::calibrated::{Calibrated, CalibratedShader};

/// Number of parts that the presses are divided into.
pub const FOLDS: usize = 5;

/// Number of training steps that take as long as simulating one press.
const PRESS_STEPS: u64 = 10;

/// Returns the work of [`cross_validate`], in training steps.
pub fn count_validation_steps(presses: usize, settings: &TrainingSettings) -> u64 {
    (FOLDS * settings.networks * settings.steps) as u64 + PRESS_STEPS * presses as u64
}

/// A press simulated by a model that has not seen it.
pub struct HeldOut {
    /// The simulated image.
    pub simulated: RgbImage,
    /// Differences from the real image.
    pub scores: Scores,
}

/// Returns the part, 0 to [`FOLDS`] - 1, that each of `count` presses belongs to.
pub fn assign_folds(count: usize) -> Vec<usize> {
    let mut random = random_stream(2, "calibration", 0);
    let mut fold = vec![0; count];
    for (place, press) in random.sample_without_replacement((0..count).collect(), count).into_iter().enumerate() {
        fold[press] = place % FOLDS;
    }
    fold
}

/// Simulates every press by a model that was fitted to the presses of the other parts.
pub fn cross_validate(
    session: &Session,
    surfaces: &PressSurfaces,
    pixels: &[pixels::PixelSamples],
    geometry: Geometry,
    settings: &TrainingSettings,
    work: &ProgressMeter,
) -> Vec<HeldOut> {
    let fold = assign_folds(session.observations.len());
    let rest = session.to_background_image();
    let shaders: Vec<CalibratedShader> = (0..FOLDS)
        .into_par_iter()
        .map(|part| {
            let others: Vec<&pixels::PixelSamples> =
                pixels.iter().zip(&fold).filter(|(_, fold)| **fold != part).map(|(pixels, _)| pixels).collect();
            let leds = fit_leds(others.iter().copied());
            let response = fit_response(session, &others, leds.as_ref(), settings, part as u64, work);
            let table = build_table(response, geometry);
            let table = match leds {
                Some(leds) => table.with_extrapolation(leds.extrapolation()),
                None => table,
            };
            CalibratedShader::new(Calibrated::default(), Some(&table), &session.camera)
        })
        .collect();
    let held_out = |k: usize| {
        let light =
            shaders[fold[k]].shade(&surfaces.contacts[k], &rest, &mut EffectLog::new(EffectPolicy::WhereNeeded));
        let simulated = light_to_rgb(&light, &rest);
        let observation = &session.observations[k];
        let scores = score_images(&observation.image, &simulated, Some(&observation.circle), pixels::ERROR_REACH);
        work.advance(PRESS_STEPS, "simulating presses that were not fitted");
        HeldOut { simulated, scores }
    };
    (0..session.observations.len()).into_par_iter().map(held_out).collect()
}
