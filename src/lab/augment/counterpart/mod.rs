//! `[paired]`: renders the simulated counterpart of a real sample whose object, pose and depth are known.
//!
//! A label is seldom exact to the pixel. So the counterpart is rendered where the label says, the shift between the two
//! is measured ([`align`]), and the counterpart is rendered again at the shifted place. Moving the picture instead
//! would carry the light of one place to another. What is left of the shift is measured again, until it is small or the
//! counterpart becomes less alike.

use gelsim_job::layout::Split;
use gelsim_job::sample;
use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_core::camera::Image;
use gelsim_core::pose::{Angles, Pose};
use gelsim_job::placing::NO_CONTACT_GAP_MM;
use gelsim_job::plan::Plan;
use gelsim_job::plan::check::JobChecker;
use gelsim_job::sample::Sample;
use gelsim_job::scene::{KnownPress, PressSource, Scene};
use gelsim_lab::calibrate::detect::align::{self, ChangePyramid, find_shift};

#[cfg(test)]
mod tests;

/// The `[paired]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Paired {
    /// Largest shift between a real sample and its label that is looked for, px along x and along y, 0 to 200; with 0
    /// the counterpart stays where the label says.
    pub max_offset_px: u32,
    /// A counterpart whose change correlates less than this with the real one stays where the label says, 0 to 1.
    pub min_correlation: f64,
    /// The splits that get simulated counterparts; those for training where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub splits: Option<Vec<String>>,
}

impl Default for Paired {
    fn default() -> Self {
        Self { max_offset_px: 20, min_correlation: 0.3, splits: None }
    }
}

impl Paired {
    /// Finds every mistake in the table at the dotted path `at`.
    pub fn check(&self, check: &mut JobChecker<'_>, at: &str) {
        check.require_in_range(&format!("{at}.max_offset_px"), f64::from(self.max_offset_px), 0.0..=200.0, "px");
        check.require_in_range(&format!("{at}.min_correlation"), self.min_correlation, 0.0..=1.0, "");
    }
}

/// Orientation of a real sample's object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Orientation {
    /// Angles, after the job's face.
    Angles(Angles),
    /// Quaternion x, y, z, w, from the object's axes to the sensor's.
    Quaternion([f64; 4]),
}

/// Metadata of a press of a real sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressMetadata {
    /// Number of the object in [`gelsim_job::plan::SampleSources::objects`].
    pub object: usize,
    /// Orientation of the object.
    pub orientation: Orientation,
    /// Place of the anchor that the job's `[pose]` names, mm.
    pub position_mm: [f64; 2],
    /// Indentation, mm; 0 or less without contact.
    pub depth_mm: f64,
}

/// Result of aligning a counterpart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// It was moved by the offset.
    Aligned,
    /// No shift is to be searched for.
    NotSought,
    /// The counterpart shows no press.
    NoContact,
    /// The best correlation is below `min_correlation`.
    Unlike,
    /// The best offset is `max_offset_px` or more.
    TooFar,
}

impl Alignment {
    /// Name in `augment.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Aligned => "aligned",
            Self::NotSought => "not_sought",
            Self::NoContact => "no_contact",
            Self::Unlike => "unlike",
            Self::TooFar => "too_far",
        }
    }
}

/// A simulated counterpart.
pub struct Counterpart {
    /// The sample, at its place after alignment.
    pub sample: Sample,
    /// Metadata with which it was rendered: those of the real sample, moved by the offset.
    pub metadata: PressMetadata,
    /// Shift of the real sample to the right of its label's place and below it, px; 0 unless aligned.
    pub offset_px: [f64; 2],
    /// Correlation of the two changes at the final place, -1 to 1; 0 if the counterpart shows none.
    pub correlation: f64,
    /// Whether it was aligned, or why not.
    pub alignment: Alignment,
}

/// Renders counterparts of the samples of one sensor.
pub struct CounterpartRenderer {
    /// Sensor and objects. Of the rest only the distributions apart from pose and depth matter.
    pub plan: Plan,
    settings: Paired,
    background: RgbImage,
    /// Simulated background image.
    rendered_background: RgbImage,
}

/// Remaining shift below which no further round is needed, px.
const CONVERGED_SHIFT_PX: f64 = 0.05;

/// Most rounds of measuring and rendering.
const MAX_ROUNDS: usize = 6;

/// Loss of correlation in a round above which the counterpart of the round before is kept.
const CORRELATION_LOSS: f64 = 1e-3;

impl CounterpartRenderer {
    /// Creates a renderer for images of the plan's resolution; `background` is the background image of the real camera.
    pub fn new(plan: Plan, settings: Paired, background: RgbImage) -> Self {
        let rendered_background = to_rgb_image(plan.simulator.untouched());
        Self { plan, settings, background, rendered_background }
    }

    /// Renders the counterpart of a real sample. What is random in it is that of sample `number`.
    pub fn render_counterpart(&self, real: &PressMetadata, image: &RgbImage, number: u64) -> Counterpart {
        let most_px = self.settings.max_offset_px as usize;
        let real_change = ChangePyramid::new(image, &self.background, most_px);
        let pyramid = |sample: &Sample| {
            ChangePyramid::new(&to_rgb_image(&sample.impression.image), &self.rendered_background, most_px)
        };

        let sample = self.render_press(real, number);
        let mut rendered_change = pyramid(&sample);
        let correlation = align::unshifted_correlation(&real_change, &rendered_change);
        let mut counterpart =
            Counterpart { sample, metadata: *real, offset_px: [0.0; 2], correlation, alignment: Alignment::Aligned };
        let mut left_px = match find_shift(&real_change, &rendered_change, most_px) {
            None => return Counterpart { alignment: Alignment::NoContact, ..counterpart },
            Some(_) if most_px == 0 => return Counterpart { alignment: Alignment::NotSought, ..counterpart },
            Some(peak) if peak.correlation < self.settings.min_correlation => {
                return Counterpart { alignment: Alignment::Unlike, ..counterpart };
            }
            Some(peak) if peak.at_edge => return Counterpart { alignment: Alignment::TooFar, ..counterpart },
            Some(peak) => peak.offset_px,
        };
        for _ in 0..MAX_ROUNDS {
            if left_px.iter().all(|px| px.abs() < CONVERGED_SHIFT_PX) {
                break;
            }
            let offset_px: [f64; 2] = std::array::from_fn(|k| counterpart.offset_px[k] + left_px[k]);
            let mm_per_px = self.plan.simulator.view().mm_per_px;
            let position_mm = std::array::from_fn(|k| real.position_mm[k] + offset_px[k] * mm_per_px[k]);
            let metadata = PressMetadata { position_mm, ..*real };
            let sample = self.render_press(&metadata, number);
            rendered_change = pyramid(&sample);
            let correlation = align::unshifted_correlation(&real_change, &rendered_change);
            if correlation < counterpart.correlation - CORRELATION_LOSS {
                break;
            }
            counterpart = Counterpart { sample, metadata, offset_px, correlation, ..counterpart };
            // Only a pixel or two can be left. Further away, another ridge of a pattern may fit as well.
            left_px =
                find_shift(&real_change, &rendered_change, most_px.min(2)).map_or([0.0; 2], |peak| peak.offset_px);
        }
        counterpart
    }

    /// Renders the press that metadata describe.
    fn render_press(&self, metadata: &PressMetadata, number: u64) -> Sample {
        let plan = &self.plan;
        let indentation_depth_mm = metadata.depth_mm.max(0.0);
        let lowest_mm = if indentation_depth_mm > 0.0 { -indentation_depth_mm } else { NO_CONTACT_GAP_MM };
        let object = &plan.sampling.objects[metadata.object].geometry.clusters();
        let pose_config = &plan.job().pose;
        let side = pose_config.face.side().expect("a file whose face is no side is refused");
        let pose = match metadata.orientation {
            Orientation::Angles(angles) => {
                Pose::new(side, angles, metadata.position_mm, pose_config.anchor, lowest_mm, object)
            }
            Orientation::Quaternion(quaternion_xyzw) => Pose::from_quaternion(quaternion_xyzw, [0.0; 3]).moved(
                metadata.position_mm,
                pose_config.anchor,
                lowest_mm,
                object,
            ),
        };
        // The plan knows nothing of the real set's splits; this one is never written.
        let press = KnownPress {
            split: Split::Train,
            pressed: PressSource::Object(metadata.object),
            pose,
            indentation_depth_mm,
        };
        let mut scene = Scene::from_known_press(plan, number, 0, press);
        scene.motion.about_mm = metadata.position_mm;
        sample::press(plan, &scene)
    }
}

/// Returns an image without its counts.
fn to_rgb_image(image: &Image) -> RgbImage {
    RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb.clone()).expect("as many bytes as pixels")
}
