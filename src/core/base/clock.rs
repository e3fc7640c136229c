//! CPU time of a thread, and how much of it each stage of a sample took.

/// CPU seconds of one thread, per stage.
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
    /// Returns the seconds of all stages but encoding.
    pub fn simulation(&self) -> f64 {
        self.scene + self.depth + self.gelpad + self.optics + self.camera + self.label
    }

    /// Returns the stages in the order in which they run, with their names.
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

    /// Returns all stages multiplied by a factor.
    pub fn scaled(&self, by: f64) -> Self {
        let Self { scene, depth, gelpad, optics, camera, label, encode } = *self;
        let [scene, depth, gelpad, optics, camera, label, encode] =
            [scene, depth, gelpad, optics, camera, label, encode].map(|seconds| by * seconds);
        Self { scene, depth, gelpad, optics, camera, label, encode }
    }

    /// Adds the seconds of another sample.
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

/// A stopwatch for the CPU time of this thread. The work of other threads and processes does not count.
pub struct ThreadClock(f64);

impl ThreadClock {
    /// Starts the stopwatch.
    pub fn start() -> Self {
        Self(Self::thread_seconds())
    }

    /// Returns the seconds since the last lap, or since the start.
    pub fn lap(&mut self) -> f64 {
        let now = Self::thread_seconds();
        let seconds = now - self.0;
        self.0 = now;
        seconds
    }

    #[cfg(unix)]
    fn thread_seconds() -> f64 {
        use rustix::time::{ClockId, clock_gettime};
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }

    /// Elapsed time, which no thread's CPU time is above: the standard library knows no other.
    #[cfg(not(unix))]
    fn thread_seconds() -> f64 {
        static START: once_cell::race::OnceBox<std::time::Instant> = once_cell::race::OnceBox::new();
        START.get_or_init(|| Box::new(std::time::Instant::now())).elapsed().as_secs_f64()
    }
}
