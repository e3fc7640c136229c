//! A `[[photometric]]` table prepared for one sensor, and its application to an image.
//!
//! The real image is taken for the light that a sensor without lens errors sends to the simulated camera: that camera's
//! defocus, vignette, markers, gains and noise are added to those of the real one. Neutral effects do not run; without
//! any effect the image is unchanged, byte for byte.

use image::RgbImage;
use serde::Serialize;

use super::background::BackgroundSwap;
use super::{Photometric, SensorProfile};
use gelsim_core::base::gaussian_blur;
use gelsim_core::base::grid::Rect;
use gelsim_core::base::light::Light;
use gelsim_core::base::rng::random_stream;
use gelsim_core::base::view::View;
use gelsim_core::camera::markers::MarkerPattern;
use gelsim_core::camera::{Camera, CameraParams, Image};
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::optics::background::BackgroundImage;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_lab::metrics::noise::NoiseLevel;

/// A table prepared for one sensor.
#[derive(Clone, Debug)]
pub struct PhotometricRecipe {
    settings: Photometric,
    view: View,
    noise: NoiseLevel,
    swaps: Vec<BackgroundSwap>,
}

/// Values that were drawn for one image and applied. Effects that did not run have their neutral value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AppliedAugmentation {
    /// Background that replaced the image's own; empty if none did.
    pub background: String,
    /// Factors on the LEDs of red, green and blue.
    pub led_gains: [f64; 3],
    /// Factors on red and blue.
    pub white_balance: [f64; 2],
    /// Power of 2 by which display values were multiplied.
    pub exposure_ev: f64,
    /// Standard deviation of the defocus blur, px along x.
    #[serde(rename = "blur_px")]
    pub defocus_px: f64,
    /// Fraction of the light that was taken from the corners.
    pub vignette: f64,
    /// Noise asked for, as a multiple of the sensor's.
    pub noise_level: f64,
    /// Standard deviation of the noise that was added to every pixel, grey levels.
    pub added_read_noise_levels: f64,
    /// Standard deviation of the shot noise that was added, of a white pixel, grey levels.
    pub added_shot_noise_levels: f64,
    /// Distance between markers along x, mm; 0 for measured ones.
    pub marker_pitch_mm: f64,
    /// Diameter of the markers, mm; 0 without any.
    pub marker_diameter_mm: f64,
    /// Largest offset of a marker from its place, mm.
    pub marker_jitter_mm: f64,
    /// Pixels of the real image with a channel at full scale, whose light was lost before.
    pub saturated_before_px: u64,
    /// Pixels of the result with a channel at full scale.
    pub saturated_px: u64,
    /// Pixels with a channel that was below 0 or above full scale and was clipped.
    pub clipped_px: u64,
}

impl PhotometricRecipe {
    /// Creates the recipe from a table without mistakes and the pictures that it names.
    pub fn new(settings: Photometric, profile: &SensorProfile, swaps: Vec<BackgroundSwap>) -> Self {
        Self { settings, view: profile.view, noise: profile.noise.unwrap_or_default(), swaps }
    }

    /// Number of copies of each real image.
    pub fn copies_per_image(&self) -> u32 {
        self.settings.copies
    }

    /// Augments an image of the view's size. Everything random depends on `seed` and `number` alone.
    pub fn apply(&self, image: &RgbImage, seed: u64, number: u64) -> (Image, AppliedAugmentation) {
        let draws = Draws { seed, number };
        let [width, height] = self.view.resolution_px;
        let real = BackgroundImage::new(width, height, image.as_raw().clone());
        let swap = (!self.swaps.is_empty()).then(|| {
            let chosen = random_stream(seed, "augment background", number).uniform_below(self.swaps.len());
            &self.swaps[chosen]
        });
        let region = Rect::whole(width, height);
        let light = match swap {
            Some(swap) => Light { region, planes: swap.change.apply(&real.rgb) },
            None => real.light(region),
        };

        let settings = &self.settings;
        let led_gains = draws.sample_each("augment leds", &settings.led_gain);
        let white_balance = draws.sample_each("augment balance", &settings.white_balance);
        let exposure_ev = draws.sample("augment exposure", &settings.exposure_ev);
        let defocus_px = draws.sample("augment blur", &settings.defocus_px);
        let vignette = draws.sample("augment vignette", &settings.vignette);
        let noise_level = draws.sample("augment noise level", &settings.noise_level);

        let exposure = libm::exp2(exposure_ev);
        let balance = [white_balance[0], 1.0, white_balance[1]];
        let gains: [f64; 3] = std::array::from_fn(|k| exposure * balance[k] * led_gains[k]);
        let added = self.missing_noise(noise_level, defocus_px, gains);
        let mut shot = CameraParams::default();
        (shot.vignette, shot.gains) = (vignette, gains);
        shot.defocus_mm = defocus_px * self.view.mm_per_px[0];
        (shot.shot_noise_levels, shot.read_noise_levels) = (added.shot_levels, added.read_levels);
        shot.noise_key = random_stream(seed, "augment noise", number).next_bits();
        let pattern = settings
            .markers
            .as_ref()
            .and_then(|markers| markers.sample_pattern(|name, distribution| draws.sample_markers(name, distribution)));
        let positions = settings
            .markers
            .as_ref()
            .zip(pattern)
            .map(|(markers, pattern)| markers.to_marker_print().at_rest(&pattern, &self.view));

        let body = Camera::new(&self.view, light, false, CameraParams::default(), None);
        let image = body.expose(
            Light::default().into(),
            None,
            positions.as_ref(),
            &shot,
            &mut EffectLog::new(EffectPolicy::WhereNeeded),
        );
        let MarkerPattern { pitch_mm: [marker_pitch_mm, _], diameter_mm, jitter_mm } =
            pattern.unwrap_or(MarkerPattern { pitch_mm: [0.0; 2], diameter_mm: 0.0, jitter_mm: 0.0 });
        let applied = AppliedAugmentation {
            background: swap.map(|swap| swap.name.clone()).unwrap_or_default(),
            led_gains,
            white_balance,
            exposure_ev,
            defocus_px,
            vignette,
            noise_level,
            added_read_noise_levels: added.read_levels,
            added_shot_noise_levels: added.shot_levels,
            marker_pitch_mm,
            marker_diameter_mm: diameter_mm,
            marker_jitter_mm: jitter_mm,
            saturated_before_px: real.saturated_px,
            saturated_px: image.saturated_px,
            clipped_px: image.clipped_px,
        };
        (image, applied)
    }

    /// Returns the noise to add. The image's own, taken to be the sensor's, is reduced by the blur and scaled by the
    /// gains.
    fn missing_noise(&self, wanted: f64, defocus_px: f64, gains: [f64; 3]) -> NoiseLevel {
        let [across, down] = self.view.mm_per_px;
        let kept = gaussian_blur::remaining_noise_variance([defocus_px, defocus_px * across / down]);
        let gain2 = gains.iter().map(|gain| gain * gain).sum::<f64>() / 3.0;
        self.noise.noise_to_add(wanted, libm::sqrt(kept * gain2))
    }
}

/// Random numbers of one image.
struct Draws {
    seed: u64,
    number: u64,
}

impl Draws {
    fn sample(&self, name: &str, distribution: &Quantity) -> f64 {
        distribution.sample(&mut random_stream(self.seed, name, self.number))
    }

    /// Draws several independent values of one distribution.
    fn sample_each<const N: usize>(&self, name: &str, distribution: &Quantity) -> [f64; N] {
        let mut stream = random_stream(self.seed, name, self.number);
        std::array::from_fn(|_| distribution.sample(&mut stream))
    }

    /// Draws a value of an image's print, independent of those of a job with the same seed.
    fn sample_markers(&self, name: &str, distribution: &Quantity) -> f64 {
        let seed = random_stream(self.seed, "augment markers", self.number).next_bits();
        distribution.sample(&mut random_stream(seed, name, self.number))
    }
}
