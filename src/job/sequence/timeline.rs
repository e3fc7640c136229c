//! The phases of a sequence, divided into its frames.

use super::label::PhaseLabel;
use super::motion::{DrawnPhase, Mover, frames};
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::ObjectStep;

/// Share of the depth that an object comes to in its first frame in which it is said to touch.
const FIRST_TOUCH: f64 = 1.0 / 16.0;

/// What a phase comes to.
pub struct End {
    /// Indentation depth at its end, mm.
    pub depth_mm: f64,
    /// Force that was wanted there, N; 0 if none was.
    pub force_n: f64,
    /// Why that force cannot be had.
    pub missed: Option<String>,
}

impl End {
    /// At a depth.
    pub fn at(depth_mm: f64) -> Self {
        Self { depth_mm, force_n: 0.0, missed: None }
    }
}

/// A sequence under way.
pub struct Timeline<'a> {
    phases: &'a [DrawnPhase],
    frame_rate_hz: f64,
    frames: u64,
    mover: Mover<'a>,
    under_way: Option<UnderWay>,
    /// When the next phase starts, s.
    start_s: f64,
    /// Of the phases that were begun.
    labels: Vec<PhaseLabel>,
    missed: Option<String>,
}

/// A phase under way.
struct UnderWay {
    phase: usize,
    end_s: f64,
    from_mm: f64,
    to_mm: f64,
    /// Share of its motion that is done.
    way: f64,
}

impl<'a> Timeline<'a> {
    /// At the start of the first phase.
    pub fn new(phases: &'a [DrawnPhase], frame_rate_hz: f64, mover: Mover<'a>) -> Self {
        let duration_s: f64 = phases.iter().map(|phase| phase.duration_s).sum();
        Self {
            phases,
            frame_rate_hz,
            frames: frames(duration_s, frame_rate_hz),
            mover,
            under_way: None,
            start_s: 0.0,
            labels: Vec::new(),
            missed: None,
        }
    }

    /// How many frames there are.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Where the object is.
    pub fn mover(&self) -> &Mover<'a> {
        &self.mover
    }

    /// Name of the phase that the last frame is in.
    pub fn phase(&self) -> &str {
        self.labels.last().map_or("", |phase| phase.name.as_str())
    }

    /// Why a force that a phase wants cannot be had.
    pub fn missed(&self) -> Option<&str> {
        self.missed.as_deref()
    }

    /// What is to be said of the phases.
    pub fn into_labels(self) -> Vec<PhaseLabel> {
        self.labels
    }

    /// Goes on to frame `number`; the steps since the one before. `end` says what a phase comes to as it begins.
    pub fn frame(&mut self, number: u64, mut end: impl FnMut(&DrawnPhase, &Mover<'a>) -> End) -> Vec<ObjectStep> {
        let until_s = (number + 1) as f64 / self.frame_rate_hz;
        let last = number + 1 == self.frames;
        // Rounding must not leave a rest of a phase to the next frame.
        let slack_s = 1e-9 / self.frame_rate_hz;
        let mut steps = Vec::new();
        while self.begin(number, &mut end) {
            let Some(UnderWay { phase, end_s, from_mm, to_mm, way: done }) = self.under_way else { break };
            let phase = &self.phases[phase];
            // The last frame takes all that is left.
            let ends = last || end_s <= until_s + slack_s;
            let (way, depth_mm) = if ends {
                (1.0, to_mm)
            } else {
                let start_s = self.start_s;
                let way = phase.profile.way((until_s - start_s) / phase.duration_s);
                (way, from_mm + (to_mm - from_mm) * way)
            };
            self.go(phase, way - done, depth_mm, &mut steps);
            if !ends {
                self.under_way = self.under_way.take().map(|under_way| UnderWay { way, ..under_way });
                break;
            }
            (self.under_way, self.start_s) = (None, end_s);
            if !last && end_s >= until_s - slack_s {
                break;
            }
        }
        if steps.is_empty() {
            // Nothing is left to happen.
            let Mover { pose, depth_mm, .. } = self.mover;
            steps.push(ObjectStep { pose, depth_mm, motion: PlanarMotion::default() });
        }
        if let Some(phase) = self.labels.last_mut() {
            phase.frames += 1;
        }
        steps
    }

    /// Begins the next phase if none is under way; false if there is none.
    fn begin(&mut self, number: u64, end: &mut impl FnMut(&DrawnPhase, &Mover<'a>) -> End) -> bool {
        if self.under_way.is_some() {
            return true;
        }
        let at = self.labels.len();
        let Some(phase) = self.phases.get(at) else { return false };
        let End { depth_mm, force_n, missed } = end(phase, &self.mover);
        self.missed = self.missed.take().or(missed);
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
        self.under_way = Some(UnderWay { phase: at, end_s, from_mm: self.mover.depth_mm, to_mm: depth_mm, way: 0.0 });
        true
    }

    /// A share of a phase's motion. What touches first does so at the end of a step: of a sequence of several frames it begins
    /// early in its frame.
    fn go(&mut self, phase: &DrawnPhase, share: f64, depth_mm: f64, steps: &mut Vec<ObjectStep>) {
        let mover = &mut self.mover;
        if self.frames == 1 || mover.depth_mm > 0.0 || depth_mm <= 0.0 {
            mover.go(phase, share, depth_mm, steps);
            return;
        }
        let first_mm = FIRST_TOUCH * depth_mm;
        let touches_at = (first_mm - mover.depth_mm) / (depth_mm - mover.depth_mm);
        mover.go(phase, share * touches_at, first_mm, steps);
        mover.go(phase, share * (1.0 - touches_at), depth_mm, steps);
    }
}
