//! READ FIRST: the whole simulator on one page, a pure function from a plan and a sample's number to the sample.
//!
//! It cannot fail: what depends on what the user wrote fails earlier, in [`crate::plan`].

use std::time::Instant;

use crate::camera::{self, Image};
use crate::depth::{self, Depth};
use crate::gelpad::Contact;
use crate::label::Label;
use crate::plan::Plan;
use crate::scene::Scene;

/// One sample of a dataset.
pub struct Sample {
    /// The tactile image.
    pub image: Image,
    /// The object's depth map.
    pub depth: Depth,
    /// The pad under it.
    pub contact: Contact,
    /// What is known about all of it.
    pub label: Label,
    /// Seconds that each stage took; not part of the label, because they differ from run to run.
    pub seconds: Seconds,
}

/// Seconds per stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Seconds {
    /// Drawing the scene.
    pub scene: f64,
    /// Capturing the depth map.
    pub depth: f64,
    /// Pressing the object into the pad.
    pub gelpad: f64,
    /// Shading.
    pub optics: f64,
    /// The camera.
    pub camera: f64,
    /// Describing the sample.
    pub label: f64,
    /// Encoding its files.
    pub encode: f64,
}

impl Seconds {
    /// Adds another sample's.
    pub fn add(&mut self, other: &Self) {
        self.scene += other.scene;
        self.depth += other.depth;
        self.gelpad += other.gelpad;
        self.optics += other.optics;
        self.camera += other.camera;
        self.label += other.label;
        self.encode += other.encode;
    }
}

/// Renders sample `index` of `plan`.
pub fn render(plan: &Plan, index: u64) -> Sample {
    let mut clock = Clock(Instant::now());
    let mut seconds = Seconds::default();

    // Object, pose, indentation: all randomness of the sample.
    let scene = Scene::draw(plan, index);
    seconds.scene = clock.lap();

    // How far the object reaches below the undeformed pad, at every pixel and a margin around the view.
    let object = &plan.objects[scene.object].clusters;
    let margin_px = plan.gelpad.margin_px();
    let depth = depth::capture(object, &scene.pose.placement(), &plan.camera, margin_px, plan.thickness_mm);
    seconds.depth = clock.lap();

    // The elastomer's surface and where it touches.
    let contact = plan.gelpad.press(&depth);
    seconds.gelpad = clock.lap();

    // The light that the surface sends to the camera.
    let light = plan.shader.shade(&contact, &plan.reference);
    seconds.optics = clock.lap();

    // 8-bit RGB.
    let image = camera::expose(&light, &plan.reference);
    seconds.camera = clock.lap();

    let label = Label::describe(plan, &scene, &depth, &contact, &light, &image);
    seconds.label = clock.lap();

    Sample { image, depth, contact, label, seconds }
}

struct Clock(Instant);

impl Clock {
    /// Seconds since the last lap.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = (now - self.0).as_secs_f64();
        self.0 = now;
        seconds
    }
}
