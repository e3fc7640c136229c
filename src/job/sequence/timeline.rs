//! Divides the phases of a sequence into its frames.

use super::label::PhaseLabel;
use super::motion::{DrawnPhase, ObjectMover, PartOfPhase, count_frames};
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::ObjectStep;

/// Fraction of the depth of its first frame of contact at which an object is taken to touch.
const FIRST_TOUCH: f64 = 1.0 / 16.0;

/// The depth at the end of a phase.
pub struct PhaseEnd {
    /// Indentation depth, mm.
    pub depth_mm: f64,
    /// Force that was wanted, N; 0 if none was.
    pub force_n: f64,
    /// Why that force cannot be reached.
    pub failure: Option<String>,
}

impl PhaseEnd {
    /// Makes the end of a phase at a given depth.
    pub fn at_depth(depth_mm: f64) -> Self {
        Self { depth_mm, force_n: 0.0, failure: None }
    }
}

/// The progress of a sequence.
pub struct Timeline<'a> {
    phases: &'a [DrawnPhase],
    frame_rate_hz: f64,
    frames: u64,
    mover: ObjectMover<'a>,
    under_way: Option<PhaseProgress>,
    /// Start of the next phase, s.
    start_s: f64,
    /// Labels of the phases that have begun.
    labels: Vec<PhaseLabel>,
    failure: Option<String>,
}

/// The progress of a phase.
struct PhaseProgress {
    phase: usize,
    end_s: f64,
    from_mm: f64,
    to_mm: f64,
    /// Fraction of its motion that is done.
    done_share: f64,
}

impl<'a> Timeline<'a> {
    /// Makes a timeline at the start of the first phase.
    pub fn new(phases: &'a [DrawnPhase], frame_rate_hz: f64, mover: ObjectMover<'a>) -> Self {
        let duration_s: f64 = phases.iter().map(|phase| phase.duration_s).sum();
        Self {
            phases,
            frame_rate_hz,
            frames: count_frames(duration_s, frame_rate_hz),
            mover,
            under_way: None,
            start_s: 0.0,
            labels: Vec::new(),
            failure: None,
        }
    }

    /// Returns the number of frames.
    pub fn frame_count(&self) -> u64 {
        self.frames
    }

    /// Returns the object.
    pub fn mover(&self) -> &ObjectMover<'a> {
        &self.mover
    }

    /// Returns the name of the phase that the last frame is in.
    pub fn phase_name(&self) -> &str {
        self.labels.last().map_or("", |phase| phase.name.as_str())
    }

    /// Returns the phase that the last frame is in.
    pub fn phase(&self) -> Option<&PhaseLabel> {
        self.labels.last()
    }

    /// Returns why a force that a phase wants cannot be reached, if so.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Returns the labels of the phases.
    pub fn into_labels(self) -> Vec<PhaseLabel> {
        self.labels
    }

    /// Advances to frame `number`, and returns the steps since the frame before. `end` returns the depth at the end of
    /// a phase, and is called when the phase begins.
    pub fn advance_to_frame(
        &mut self,
        number: u64,
        mut end: impl FnMut(&DrawnPhase, &ObjectMover<'a>) -> PhaseEnd,
    ) -> Vec<ObjectStep> {
        let until_s = (number + 1) as f64 / self.frame_rate_hz;
        let last = number + 1 == self.frames;
        // Rounding must not leave a bit of a phase for the next frame.
        let slack_s = 1e-9 / self.frame_rate_hz;
        let mut steps = Vec::new();
        let mut now_s = number as f64 / self.frame_rate_hz;
        while self.begin_phase(number, &mut end) {
            let Some(PhaseProgress { phase, end_s, from_mm, to_mm, done_share: done }) = self.under_way else { break };
            let phase = &self.phases[phase];
            // The last frame takes all that is left of the phases.
            let ends = last || end_s <= until_s + slack_s;
            let (way, depth_mm) = if ends {
                (1.0, to_mm)
            } else {
                let start_s = self.start_s;
                let way = phase.profile.progress_at((until_s - start_s) / phase.duration_s);
                (way, from_mm + (to_mm - from_mm) * way)
            };
            let goes_until_s = if last { end_s } else { end_s.min(until_s) };
            let part = PartOfPhase { share: way - done, depth_mm, duration_s: (goes_until_s - now_s).max(0.0) };
            now_s = goes_until_s;
            self.advance_phase(phase, part, &mut steps);
            if !ends {
                self.under_way = self.under_way.take().map(|under_way| PhaseProgress { done_share: way, ..under_way });
                break;
            }
            (self.under_way, self.start_s) = (None, end_s);
            if !last && end_s >= until_s - slack_s {
                break;
            }
        }
        if steps.is_empty() {
            // All phases are over: the object rests.
            let ObjectMover { pose, depth_mm, .. } = self.mover;
            let duration_s = 1.0 / self.frame_rate_hz;
            steps.push(ObjectStep { pose, depth_mm, motion: PlanarMotion::default(), duration_s });
        }
        if let Some(phase) = self.labels.last_mut() {
            phase.frames += 1;
        }
        steps
    }

    /// Begins the next phase if none is going on. Returns false if there is none left.
    fn begin_phase(&mut self, number: u64, end: &mut impl FnMut(&DrawnPhase, &ObjectMover<'a>) -> PhaseEnd) -> bool {
        if self.under_way.is_some() {
            return true;
        }
        let at = self.labels.len();
        let Some(phase) = self.phases.get(at) else { return false };
        let PhaseEnd { depth_mm, force_n, failure: missed } = end(phase, &self.mover);
        self.failure = self.failure.take().or(missed);
        self.labels.push(PhaseLabel {
            name: phase.name.clone(),
            duration_s: phase.duration_s,
            first_frame: number as u32,
            frames: 0,
            depth_mm,
            force_n,
            shift_mm: phase.shift_mm,
            twist_deg: phase.twist_deg,
            tilt_deg: phase.tilt_deg,
            tilt_azimuth_deg: phase.tilt_azimuth_deg,
        });
        let end_s = self.start_s + phase.duration_s;
        self.under_way =
            Some(PhaseProgress { phase: at, end_s, from_mm: self.mover.depth_mm, to_mm: depth_mm, done_share: 0.0 });
        true
    }

    /// Advances a phase by a fraction of its motion. The first touch is the end of a step, so in a sequence of several
    /// frames that step ends early in its frame.
    fn advance_phase(&mut self, phase: &DrawnPhase, part: PartOfPhase, steps: &mut Vec<ObjectStep>) {
        let PartOfPhase { share, depth_mm, duration_s } = part;
        let mover = &mut self.mover;
        if self.frames == 1 || mover.depth_mm > 0.0 || depth_mm <= 0.0 {
            mover.advance(phase, part, steps);
            return;
        }
        let first_mm = FIRST_TOUCH * depth_mm;
        let touches_at = (first_mm - mover.depth_mm) / (depth_mm - mover.depth_mm);
        let before = PartOfPhase { share: share * touches_at, depth_mm: first_mm, duration_s: duration_s * touches_at };
        mover.advance(phase, before, steps);
        let after = 1.0 - touches_at;
        mover.advance(phase, PartOfPhase { share: share * after, depth_mm, duration_s: duration_s * after }, steps);
    }
}
