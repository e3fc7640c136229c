//! READ FIRST: the whole simulator on one page, a pure function from a plan and a sample's number to the sample.
//!
//! It cannot fail: what depends on what the user wrote fails earlier, in [`crate::plan`].

use rustix::time::{ClockId, clock_gettime};

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
    /// CPU seconds that each stage took; not part of the label, because they differ from run to run.
    pub seconds: Seconds,
}

/// CPU seconds of the thread per stage.
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
    /// All stages but encoding.
    pub fn simulation(&self) -> f64 {
        self.scene + self.depth + self.gelpad + self.optics + self.camera + self.label
    }

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
    let mut clock = Clock::start();
    let mut seconds = Seconds::default();

    // Object, pose, indentation: all randomness of the sample.
    let scene = Scene::draw(plan, index);
    seconds.scene = clock.lap();

    let object = &plan.objects[scene.object].clusters;
    let mut window = plan.pad.window(scene.indentation_depth_mm);
    let (depth, contact) = loop {
        // How far the object reaches below the undeformed pad, at every pixel of the view and of a margin around it.
        let depth = depth::capture(object, &scene.pose.placement(), &plan.camera, window, plan.thickness_mm);
        seconds.depth += clock.lap();

        // The elastomer's surface and where it touches. Rarely it bulges higher than the object was captured.
        let contact = plan.pad.press(&depth);
        seconds.gelpad += clock.lap();
        match plan.pad.higher(window, &contact) {
            Some(higher) => window = higher,
            None => break (depth, contact),
        }
    };

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

/// CPU time of this thread: what other threads and processes do does not count.
pub struct Clock(f64);

impl Clock {
    /// Starts now.
    pub fn start() -> Self {
        Self(Self::now())
    }

    /// Seconds since the last lap.
    pub fn lap(&mut self) -> f64 {
        let now = Self::now();
        let seconds = now - self.0;
        self.0 = now;
        seconds
    }

    fn now() -> f64 {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }
}
