//! The camera's settings: their laws, as a job has them, and their values in one sample.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lens::Lens;
use super::{Planes, defocus, vignette};
use crate::config::quantity::Quantity;
use crate::depth::Camera;
use crate::effects::{Effect, Gate};
use crate::grid::Rect;
use crate::rng::Stage;

/// The `[camera]` table. What is left out is an ideal camera's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Radial distortion k1: a pixel at distance r from the middle, in half diagonals, shows what an ideal lens would show
    /// at r (1 + k1 r^2 + k2 r^4). Above 0 is barrel-shaped.
    pub distortion_k1: Quantity,
    /// Radial distortion k2.
    pub distortion_k2: Quantity,
    /// Share of the light that is lost in the image's corners, 0 to 1; elsewhere in proportion to r^2.
    pub vignette: Quantity,
    /// Standard deviation of the blur, mm on the pad, 0 to 1.
    pub defocus_mm: Quantity,
    /// Factor on all brightness, 0.01 to 100.
    pub exposure: Quantity,
    /// Factor on red, 0.01 to 100.
    pub red_gain: Quantity,
    /// Factor on blue, 0.01 to 100.
    pub blue_gain: Quantity,
    /// Standard deviation of the shot noise of a white pixel, grey levels of 255; of others in proportion to the root of
    /// their brightness.
    pub shot_noise_levels: Quantity,
    /// Standard deviation of the read noise, grey levels of 255.
    pub read_noise_levels: Quantity,
}

impl Default for Settings {
    fn default() -> Self {
        let (zero, one) = (Quantity::Constant(0.0), Quantity::Constant(1.0));
        Self {
            distortion_k1: zero.clone(),
            distortion_k2: zero.clone(),
            vignette: zero.clone(),
            defocus_mm: zero.clone(),
            exposure: one.clone(),
            red_gain: one.clone(),
            blue_gain: one,
            shot_noise_levels: zero.clone(),
            read_noise_levels: zero,
        }
    }
}

/// The camera in one sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Shot {
    /// Radial distortion k1 and k2.
    pub distortion: [f64; 2],
    /// Share of the light that is lost in the corners.
    pub vignette: f64,
    /// Standard deviation of the blur, mm on the pad.
    pub defocus_mm: f64,
    /// Factors on red, green and blue.
    pub gains: [f64; 3],
    /// Standard deviation of a white pixel's shot noise, grey levels.
    pub shot_noise_levels: f64,
    /// Standard deviation of the read noise, grey levels.
    pub read_noise_levels: f64,
    /// Key of the noise; known from seed and index, so not in the label.
    #[serde(skip)]
    pub noise_key: u64,
}

impl Shot {
    /// Draws each quantity from its law.
    pub fn draw(settings: &Settings, noise_key: u64, draw: impl Fn(Stage, &Quantity) -> f64) -> Self {
        let exposure = draw(Stage::Exposure, &settings.exposure);
        Self {
            distortion: [
                draw(Stage::DistortionK1, &settings.distortion_k1),
                draw(Stage::DistortionK2, &settings.distortion_k2),
            ],
            vignette: draw(Stage::Vignette, &settings.vignette),
            defocus_mm: draw(Stage::Defocus, &settings.defocus_mm),
            gains: [
                exposure * draw(Stage::RedGain, &settings.red_gain),
                exposure,
                exposure * draw(Stage::BlueGain, &settings.blue_gain),
            ],
            shot_noise_levels: draw(Stage::ShotNoise, &settings.shot_noise_levels),
            read_noise_levels: draw(Stage::ReadNoise, &settings.read_noise_levels),
            noise_key,
        }
    }

    /// The camera of the picture of the untouched pad: what differs from sample to sample is ideal there.
    pub fn resting(settings: &Settings) -> Self {
        let ideal = |stage| if matches!(stage, Stage::Exposure | Stage::RedGain | Stage::BlueGain) { 1.0 } else { 0.0 };
        Self::draw(settings, 0, |stage, law| match law {
            Quantity::Constant(value) => *value,
            Quantity::Random(_) => ideal(stage),
        })
    }

    /// The same without an effect that is to be left out.
    pub fn gated(self, gate: Gate) -> Self {
        match gate {
            Gate::Without(Effect::Distortion) => Self { distortion: [0.0; 2], ..self },
            Gate::Without(Effect::Vignette) => Self { vignette: 0.0, ..self },
            Gate::Without(Effect::Defocus) => Self { defocus_mm: 0.0, ..self },
            Gate::Without(Effect::Exposure) => Self { gains: [1.0; 3], ..self },
            Gate::Without(Effect::Noise) => Self { shot_noise_levels: 0.0, read_noise_levels: 0.0, ..self },
            _ => self,
        }
    }

    /// The lens's distortion, if it has any.
    pub fn lens(&self, view: &Camera) -> Option<Lens> {
        let [width, height] = view.resolution_px;
        let [k1, k2] = self.distortion;
        (k1 != 0.0 || k2 != 0.0).then_some(Lens { k1, k2, width, height })
    }

    pub(super) fn same_optics(&self, other: &Self) -> bool {
        let of = |shot: &Self| (shot.distortion, shot.vignette, shot.defocus_mm);
        of(self) == of(other)
    }

    /// Light of the whole view through lens and vignette.
    pub(super) fn through(&self, planes: &Planes, view: &Camera) -> Planes {
        let [width, height] = view.resolution_px;
        let mut planes = planes.clone();
        if self.defocus_mm > 0.0 {
            planes = defocus::blur_whole(&planes, width, height, self.blur_px(view));
        }
        if let Some(lens) = self.lens(view) {
            planes = lens.warp_whole(&planes);
        }
        vignette::darken(&mut planes, Rect::whole(width, height), view, self.vignette);
        planes
    }

    pub(super) fn blur_px(&self, view: &Camera) -> [f64; 2] {
        view.mm_per_px.map(|pitch| self.defocus_mm / pitch)
    }
}
