//! `[paired]`: the simulated twin of a real sample whose object, pose and depth are known.
//!
//! A label is seldom exact to the pixel. So the twin is rendered where the label says, the shift between the two is
//! measured ([`mod@align`]), and the twin is rendered anew at the shifted place: a picture that is moved instead would take
//! the light of one place to another. What is left of the shift is measured again, until it is small or the twin gets less
//! alike.

use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::Image;
use crate::plan::Plan;
use crate::plan::check::Check;
use crate::render::{self, Sample};
use crate::scene::pose::{Angles, Pose};
use crate::scene::{NO_CONTACT_GAP_MM, Press, Pressed, Scene};

pub mod align;
#[cfg(test)]
mod tests;

use align::{Pair, align};

/// The `[paired]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Paired {
    /// Largest shift between a real sample and its label that is looked for, px along x and along y, 0 to 200; with 0 the
    /// twin stays where the label says.
    pub max_offset_px: u32,
    /// A twin whose change correlates less than this with the real one stays where the label says, 0 to 1.
    pub min_correlation: f64,
}

impl Default for Paired {
    fn default() -> Self {
        Self { max_offset_px: 20, min_correlation: 0.3 }
    }
}

impl Paired {
    /// Finds every mistake in the table at the dotted path `at`.
    pub fn check(&self, check: &mut Check<'_>, at: &str) {
        check.number(&format!("{at}.max_offset_px"), f64::from(self.max_offset_px), 0.0..=200.0, "px");
        check.number(&format!("{at}.min_correlation"), self.min_correlation, 0.0..=1.0, "");
    }
}

/// How the object of a real sample is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    /// By angles, after the job's face.
    Angles(Angles),
    /// By a quaternion x, y, z, w, from its axes to the sensor's.
    Quaternion([f64; 4]),
}

/// What is known of a real sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Number of its object in [`Plan::objects`].
    pub object: usize,
    /// How the object is turned.
    pub turn: Turn,
    /// Where the anchor of the job's `[pose]` is, mm.
    pub position_mm: [f64; 2],
    /// Indentation, mm; 0 or less without contact.
    pub depth_mm: f64,
}

/// What came of aligning a twin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// The twin was moved by the offset.
    Aligned,
    /// No shift was to be looked for.
    NotSought,
    /// The twin shows no press.
    NoContact,
    /// The best correlation is below `min_correlation`.
    Unlike,
    /// The best offset is `max_offset_px` or more.
    TooFar,
}

/// A simulated twin.
pub struct Twin {
    /// The sample, at its place after alignment.
    pub sample: Sample,
    /// Where it was rendered: what is known of the real sample, moved by the offset.
    pub known: Known,
    /// How far the real sample lies to the right of what its label says and below it, px; 0 unless it was aligned.
    pub offset_px: [f64; 2],
    /// Correlation of the two changes where the twin is, -1 to 1; 0 if the twin shows none.
    pub correlation: f64,
    /// Whether it was aligned, and why not.
    pub alignment: Alignment,
}

/// Makes twins of the samples of one sensor.
pub struct Pairing {
    /// The sensor and its objects. Only they and the laws beside pose and depth count.
    pub plan: Plan,
    settings: Paired,
    background: RgbImage,
    /// The simulated pad at rest.
    untouched: RgbImage,
}

/// A shift that is left after a round and is smaller than this needs no other round, px.
const SMALL_PX: f64 = 0.05;

/// Rounds of measuring and rendering at most.
const ROUNDS: usize = 6;

/// A twin whose correlation falls by more than this in a round was better before.
const WORSE: f64 = 1e-3;

impl Pairing {
    /// For images of the plan's resolution; `background` is the untouched pad as the real camera sees it.
    pub fn new(plan: Plan, settings: Paired, background: RgbImage) -> Self {
        let untouched = picture(&plan.ready.body.untouched);
        Self { plan, settings, background, untouched }
    }

    /// The twin of a real sample; what is still random of it is that of sample `number`.
    pub fn twin(&self, real: &Known, image: &RgbImage, number: u64) -> Twin {
        let most_px = self.settings.max_offset_px as usize;
        let seen = Pair::new(image, &self.background, most_px);
        let pair = |sample: &Sample| Pair::new(&picture(&sample.image), &self.untouched, most_px);

        let sample = self.render(real, number);
        let mut shown = pair(&sample);
        let correlation = align::correlation(&seen, &shown);
        let mut twin = Twin { sample, known: *real, offset_px: [0.0; 2], correlation, alignment: Alignment::Aligned };
        let mut left_px = match align(&seen, &shown, most_px) {
            None => return Twin { alignment: Alignment::NoContact, ..twin },
            Some(_) if most_px == 0 => return Twin { alignment: Alignment::NotSought, ..twin },
            Some(peak) if peak.correlation < self.settings.min_correlation => {
                return Twin { alignment: Alignment::Unlike, ..twin };
            }
            Some(peak) if peak.at_edge => return Twin { alignment: Alignment::TooFar, ..twin },
            Some(peak) => peak.offset_px,
        };
        for _ in 0..ROUNDS {
            if left_px.iter().all(|px| px.abs() < SMALL_PX) {
                break;
            }
            let offset_px: [f64; 2] = std::array::from_fn(|k| twin.offset_px[k] + left_px[k]);
            let pitch = self.plan.camera.mm_per_px;
            let position_mm = std::array::from_fn(|k| real.position_mm[k] + offset_px[k] * pitch[k]);
            let known = Known { position_mm, ..*real };
            let sample = self.render(&known, number);
            shown = pair(&sample);
            let correlation = align::correlation(&seen, &shown);
            if correlation < twin.correlation - WORSE {
                break;
            }
            twin = Twin { sample, known, offset_px, correlation, ..twin };
            // What is left is a pixel or two: further away another ridge of a pattern may look as good.
            left_px = align(&seen, &shown, most_px.min(2)).map_or([0.0; 2], |peak| peak.offset_px);
        }
        twin
    }

    fn render(&self, known: &Known, number: u64) -> Sample {
        let plan = &self.plan;
        let indentation_depth_mm = known.depth_mm.max(0.0);
        let lowest_mm = if indentation_depth_mm > 0.0 { -indentation_depth_mm } else { NO_CONTACT_GAP_MM };
        let object = &plan.objects[known.object].clusters;
        let law = &plan.pose;
        let pose = match known.turn {
            Turn::Angles(angles) => Pose::new(law.face, angles, known.position_mm, law.anchor, lowest_mm, object),
            Turn::Quaternion(quaternion_xyzw) => {
                Pose::placed(quaternion_xyzw, [0.0; 3]).moved(known.position_mm, law.anchor, lowest_mm, object)
            }
        };
        // Whose split it is, is not the plan's to say.
        let (split, _) = plan.layout.split_of(0);
        let press = Press { split, pressed: Pressed::Object(known.object), pose, indentation_depth_mm };
        let mut scene = Scene::given(plan, number, 0, press);
        scene.motion.about_mm = known.position_mm;
        render::press(plan, &scene)
    }
}

/// An image without what was counted of it.
fn picture(image: &Image) -> RgbImage {
    RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb.clone()).expect("as many bytes as pixels")
}
