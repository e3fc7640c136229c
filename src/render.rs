//! READ FIRST: the whole simulator on one page, a pure function from a plan and a sample's number to the sample.
//!
//! It cannot fail: what depends on what the user wrote fails earlier, in [`crate::plan`].

use rustix::time::{ClockId, clock_gettime};

use crate::camera::Image;
use crate::camera::lens::Lens;
use crate::camera::print::{self, Ink};
use crate::depth::{self, Depth};
use crate::effects::{Ledger, PerEffect};
use crate::gelpad::{self, Contact};
use crate::label::Label;
use crate::plan::{Plan, Ready};
use crate::scene::Scene;

/// One sample of a dataset.
pub struct Sample {
    /// The tactile image.
    pub image: Image,
    /// The object's depth map.
    pub depth: Depth,
    /// The pad under it.
    pub contact: Contact,
    /// The pad's markers, if it has any.
    pub ink: Option<Ink>,
    /// Distortion of the lens, if it has any: `depth` and `contact` are as the pad is, not as the camera sees it.
    pub lens: Option<Lens>,
    /// What is known about all of it.
    pub label: Label,
    /// CPU seconds that each stage took; not part of the label, because they differ from run to run.
    pub seconds: Seconds,
    /// CPU seconds that each effect took; part of its stage's.
    pub effects: PerEffect<f64>,
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

    /// The stages in their order, with their names.
    pub fn stages(&self) -> [(&'static str, f64); 7] {
        let Self { scene, depth, gelpad, optics, camera, label, encode } = *self;
        [
            ("scene", scene),
            ("depth", depth),
            ("gelpad", gelpad),
            ("optics", optics),
            ("camera", camera),
            ("label", label),
            ("encode", encode),
        ]
    }

    /// Multiplied by a factor.
    pub fn scaled(&self, by: f64) -> Self {
        let Self { scene, depth, gelpad, optics, camera, label, encode } = *self;
        let [scene, depth, gelpad, optics, camera, label, encode] =
            [scene, depth, gelpad, optics, camera, label, encode].map(|seconds| by * seconds);
        Self { scene, depth, gelpad, optics, camera, label, encode }
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

/// Renders sample `index` of `plan` as it is drawn first.
pub fn render(plan: &Plan, index: u64) -> Sample {
    attempt(plan, index, 0)
}

/// Renders sample `index` of `plan` as it is drawn after `attempt` draws were rejected; see [`crate::health`].
pub fn attempt(plan: &Plan, index: u64, attempt: u32) -> Sample {
    let mut clock = Clock::start();
    // Object, pose, indentation: all randomness of the sample.
    let scene = Scene::draw(plan, index, attempt);
    let seconds = clock.lap();
    let mut sample = press(plan, &scene);
    sample.seconds.scene = seconds;
    sample
}

/// Renders one press of `plan`.
pub fn press(plan: &Plan, scene: &Scene) -> Sample {
    let mut clock = Clock::start();
    let mut seconds = Seconds::default();
    let mut effects = Ledger::new(plan.gate);
    let Ready { pad, shader, body, .. } = &plan.ready;

    let mut window = pad.window(scene.indentation_depth_mm);
    let (depth, mut contact) = loop {
        // How far the object reaches below the undeformed pad, at every pixel of the view and of a margin around it.
        let depth = depth::overlap(plan, scene, window, &mut effects);
        seconds.depth += clock.lap();

        // The elastomer's surface and where it touches. Rarely it bulges higher than the object was captured.
        let contact = gelpad::deform(pad, &depth, &mut effects);
        seconds.gelpad += clock.lap();
        match pad.higher(window, &contact) {
            Some(higher) => window = higher,
            None => break (depth, contact),
        }
    };
    // The motion of the elastomer in its own plane, where markers show it.
    contact.drag = gelpad::drag(plan, scene, &contact, &mut effects);
    seconds.gelpad += clock.lap();

    // The light that the surface sends to the camera.
    let light = shader.shade(&contact, &plan.reference, &mut effects);
    seconds.optics = clock.lap();

    // 8-bit RGB.
    let ink = print::ink(plan, scene, contact.drag.as_ref(), &mut effects);
    let image = body.expose(light, ink.as_ref(), &scene.shot, &mut effects);
    seconds.camera = clock.lap();

    let label = Label::describe(plan, scene, &depth, &contact, ink.as_ref(), &image, &effects);
    seconds.label = clock.lap();

    let lens = scene.shot.lens(&plan.camera);
    Sample { image, depth, contact, ink, lens, label, seconds, effects: effects.seconds }
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
