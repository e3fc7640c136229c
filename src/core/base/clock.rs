//! CPU time of a thread, and what each stage of a sample took of it.

use rustix::time::{ClockId, clock_gettime};

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
