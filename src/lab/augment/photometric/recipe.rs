//! A `[[photometric]]` table made ready, and what it makes of one image.
//!
//! The real image is taken for the light that a sensor without lens errors sends to the simulated camera: that camera's
//! defocus, vignette, markers, gains and noise come on top of what the real one did. What is neutral does not run;
//! without any effect the image stays as it is, byte for byte.

use image::RgbImage;
use serde::Serialize;

use super::background::BackgroundSwap;
use super::noise::NoiseLevel;
use super::{Photometric, SensorProfile};
use gelsim_core::base::grid::Rect;
use gelsim_core::base::light::Light;
use gelsim_core::base::rng::stream;
use gelsim_core::base::view::View;
use gelsim_core::camera::markers::MarkerPattern;
use gelsim_core::camera::{Camera, CameraParams, Image, defocus};
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::optics::background::BackgroundImage;
use gelsim_files::sensor::quantity::Quantity;

/// A table made ready for one sensor.
#[derive(Clone, Debug)]
pub struct PhotometricRecipe {
    settings: Photometric,
    view: View,
    noise: NoiseLevel,
    swaps: Vec<BackgroundSwap>,
}

/// What was drawn for one image and done to it. What did not run has its neutral value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AppliedAugmentation {
    /// The background that took the place of the image's own; empty if that stayed.
    pub background: String,
    /// Factors on the LEDs of red, green and blue.
    pub led_gains: [f64; 3],
    /// Factors on red and blue.
    pub white_balance: [f64; 2],
    /// Display values were multiplied by 2 to this power.
    pub exposure_ev: f64,
    /// Standard deviation of the defocus blur, px along x.
    #[serde(rename = "blur_px")]
    pub defocus_px: f64,
    /// Fraction of the light that was taken from the corners.
    pub vignette: f64,
    /// Noise that was wanted, as a multiple of the sensor's.
    pub noise_level: f64,
    /// Standard deviation of the noise that was added to every pixel, grey levels.
    pub added_read_noise_levels: f64,
    /// The same by counting light, of a white pixel.
    pub added_shot_noise_levels: f64,
    /// Distance between markers, mm.
    pub marker_pitch_mm: f64,
    /// Their diameter, mm; 0 without any.
    pub marker_diameter_mm: f64,
    /// Largest offset of a marker from the grid, mm.
    pub marker_jitter_mm: f64,
    /// Pixels of the real image with a channel at full scale: their light was lost before.
    pub saturated_before_px: u64,
    /// Pixels with a channel at full scale now.
    pub saturated_px: u64,
    /// Pixels with a channel that came out below 0 or above full scale and was cut.
    pub clipped_px: u64,
}

impl PhotometricRecipe {
    /// From a table without mistakes and the pictures that it names.
    pub fn new(settings: Photometric, profile: &SensorProfile, swaps: Vec<BackgroundSwap>) -> Self {
        Self { settings, view: profile.view, noise: profile.noise.unwrap_or_default(), swaps }
    }

    /// How many images are wanted of each real one.
    pub fn copies(&self) -> u32 {
        self.settings.copies
    }

    /// Augments an image of the view's size. All that is random is addressed by `seed` and `number`.
    pub fn apply(&self, image: &RgbImage, seed: u64, number: u64) -> (Image, AppliedAugmentation) {
        let draws = Draws { seed, number };
        let [width, height] = self.view.resolution_px;
        let real = BackgroundImage::new(width, height, image.as_raw().clone());
        let swap = (!self.swaps.is_empty()).then(|| {
            let chosen = stream(seed, "augment background", number).below(self.swaps.len());
            &self.swaps[chosen]
        });
        let region = Rect::whole(width, height);
        let light = match swap {
            Some(swap) => Light { region, planes: swap.light(&real.rgb) },
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
        shot.noise_key = stream(seed, "augment noise", number).bits();
        let pattern = settings
            .markers
            .as_ref()
            .and_then(|markers| markers.sample(|name, distribution| draws.sample_markers(name, distribution)));
        let positions = settings
            .markers
            .as_ref()
            .zip(pattern)
            .map(|(markers, pattern)| markers.print().at_rest(&pattern, &self.view));

        let body = Camera::new(&self.view, light, false, CameraParams::default(), None);
        let image = body.expose(
            Light::default().into(),
            None,
            positions.as_ref(),
            &shot,
            &mut EffectLog::new(EffectPolicy::WhereNeeded),
        );
        let MarkerPattern { pitch_mm, diameter_mm, jitter_mm } =
            pattern.unwrap_or(MarkerPattern { pitch_mm: 0.0, diameter_mm: 0.0, jitter_mm: 0.0 });
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
            marker_pitch_mm: pitch_mm,
            marker_diameter_mm: diameter_mm,
            marker_jitter_mm: jitter_mm,
            saturated_before_px: real.saturated_px,
            saturated_px: image.saturated_px,
            clipped_px: image.clipped_px,
        };
        (image, applied)
    }

    /// Noise to be added: the image's own, taken to be the sensor's, was blurred and multiplied before.
    fn missing_noise(&self, wanted: f64, defocus_px: f64, gains: [f64; 3]) -> NoiseLevel {
        let [across, down] = self.view.mm_per_px;
        let kept = defocus::noise_kept([defocus_px, defocus_px * across / down]);
        let gain2 = gains.iter().map(|gain| gain * gain).sum::<f64>() / 3.0;
        self.noise.missing(wanted, libm::sqrt(kept * gain2))
    }
}

/// The random numbers of one image.
struct Draws {
    seed: u64,
    number: u64,
}

impl Draws {
    fn sample(&self, name: &str, distribution: &Quantity) -> f64 {
        distribution.sample(&mut stream(self.seed, name, self.number))
    }

    /// Several values of one distribution, each by itself.
    fn sample_each<const N: usize>(&self, name: &str, distribution: &Quantity) -> [f64; N] {
        let mut stream = stream(self.seed, name, self.number);
        std::array::from_fn(|_| distribution.sample(&mut stream))
    }

    /// The print of one image, apart from those of a job with the same seed.
    fn sample_markers(&self, name: &str, distribution: &Quantity) -> f64 {
        let seed = stream(self.seed, "augment markers", self.number).bits();
        distribution.sample(&mut stream(seed, name, self.number))
    }
}
