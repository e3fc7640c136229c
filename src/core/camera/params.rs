//! The camera's parameters in one press.

use serde::{Deserialize, Serialize};

use super::lens::Lens;
use super::noise::{self, Noise};
use super::{Planes, vignette};
use crate::base::gaussian_blur;
use crate::base::grid::Rect;
use crate::base::rng;
use crate::base::view::View;
use crate::effects::{Effect, EffectPolicy};

/// The camera's parameters in one sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Shot"))]
#[non_exhaustive]
pub struct CameraParams {
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
    /// Factors on the noise of red, green and blue.
    pub noise_color: [f64; 3],
    /// Correlation of the noise of neighbouring pixels.
    pub noise_correlation: f64,
    /// Standard deviation of the speckle where the pad is touched, grey levels.
    pub speckle_levels: f64,
    /// Share of full scale from which a pixel is white, and below which it is black; 0 where the image is not
    /// binarised.
    #[serde(default)]
    pub threshold: f64,
    /// Key of the noise; known from seed and index, so not in the label.
    #[serde(skip)]
    pub noise_key: u64,
}

impl Default for CameraParams {
    /// An ideal camera.
    fn default() -> Self {
        Self {
            distortion: [0.0; 2],
            vignette: 0.0,
            defocus_mm: 0.0,
            gains: [1.0; 3],
            shot_noise_levels: 0.0,
            read_noise_levels: 0.0,
            noise_color: [1.0; 3],
            noise_correlation: 0.0,
            speckle_levels: 0.0,
            threshold: 0.0,
            noise_key: 0,
        }
    }
}

impl CameraParams {
    /// Returns the parameters at another moment: with other noise, which the key fixes, too, and all else as it is.
    pub(crate) fn with_fresh_noise(self) -> Self {
        Self { noise_key: rng::random_stream(self.noise_key, "another moment", 0).next_bits(), ..self }
    }

    /// Returns the parameters without the effect that the policy leaves out.
    pub(crate) fn with_policy(self, policy: EffectPolicy) -> Self {
        match policy {
            EffectPolicy::WhereNeeded | EffectPolicy::All => self,
            EffectPolicy::Without(effect) => match effect {
                Effect::Distortion => Self { distortion: [0.0; 2], ..self },
                Effect::Vignette => Self { vignette: 0.0, ..self },
                Effect::Defocus => Self { defocus_mm: 0.0, ..self },
                Effect::Exposure => Self { gains: [1.0; 3], ..self },
                Effect::Noise => Self { shot_noise_levels: 0.0, read_noise_levels: 0.0, ..self },
                Effect::Speckle => Self { speckle_levels: 0.0, ..self },
                // Not an effect of the camera.
                Effect::Texture
                | Effect::RestShape
                | Effect::Deformation
                | Effect::Friction
                | Effect::Relaxation
                | Effect::FiniteStrain
                | Effect::Supersampling
                | Effect::Shear
                | Effect::Shading
                | Effect::Grain
                | Effect::Shadows
                | Effect::Mirror
                | Effect::Bounce
                | Effect::Darkening
                | Effect::Markers => self,
            },
        }
    }

    /// Returns the camera's noise; `None` if it has none.
    pub(super) fn noise(&self) -> Option<Noise> {
        let [read, shot] = [self.read_noise_levels, self.shot_noise_levels].map(levels_to_fraction);
        (read > 0.0 || shot > 0.0).then(|| Noise {
            read,
            shot,
            color: self.noise_color.map(|factor| factor as f32),
            correlation: self.noise_correlation,
            key: self.noise_key,
        })
    }

    /// Returns the speckle of a pad that is touched; `None` if it has none.
    pub(super) fn speckle(&self) -> Option<Noise> {
        (self.speckle_levels > 0.0).then(|| Noise {
            read: levels_to_fraction(self.speckle_levels),
            shot: 0.0,
            color: [1.0; 3],
            correlation: noise::MAX_CORRELATION,
            // Another key than that of the noise: the two are independent.
            key: noise::splitmix64(self.noise_key),
        })
    }

    /// Returns the lens's distortion; `None` if it has none.
    pub(crate) fn lens(&self, view: &View) -> Option<Lens> {
        let [width, height] = view.resolution_px;
        let [k1, k2] = self.distortion;
        (k1 != 0.0 || k2 != 0.0).then_some(Lens { k1, k2, width, height })
    }

    /// Returns true if both show light alike, before exposure and noise. What is compared here,
    /// [`CameraParams::apply_optics`] has to apply.
    pub(super) fn has_same_optics(&self, other: &Self) -> bool {
        let of = |camera: &Self| {
            // Every field is named, so that a new one cannot be forgotten here.
            let Self {
                distortion,
                vignette,
                defocus_mm,
                gains: _,
                shot_noise_levels: _,
                read_noise_levels: _,
                noise_color: _,
                noise_correlation: _,
                speckle_levels: _,
                threshold: _,
                noise_key: _,
            } = *camera;
            (distortion, vignette, defocus_mm)
        };
        of(self) == of(other)
    }

    /// Applies lens and vignette to light of the entire view.
    pub(super) fn apply_optics(&self, planes: &Planes, view: &View) -> Planes {
        let [width, height] = view.resolution_px;
        let mut planes = planes.clone();
        if self.defocus_mm > 0.0 {
            planes = gaussian_blur::blur_whole(&planes, width, height, self.blur_sigma_px(view));
        }
        if let Some(lens) = self.lens(view) {
            planes = lens.warp_whole(&planes);
        }
        vignette::darken_corners(&mut planes, Rect::whole(width, height), view, self.vignette);
        planes
    }

    /// Returns the standard deviation of the blur along x and y, px.
    pub(super) fn blur_sigma_px(&self, view: &View) -> [f64; 2] {
        view.mm_per_px.map(|pixel_mm| self.defocus_mm / pixel_mm)
    }
}

/// Converts grey levels to a fraction of full scale.
fn levels_to_fraction(levels: f64) -> f32 {
    (levels / 255.0) as f32
}
