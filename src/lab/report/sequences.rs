//! What a report shows of sequences: when they slip and how they are pushed, and force over time of some of them.

use super::histogram::Histogram;
use crate::job::layout::Split;
use crate::job::sequence::label::{FrameLabel, SequenceLabel, SlipState};

/// A number of a sequence.
pub struct SequenceQuantity {
    /// Title of its histogram.
    pub title: &'static str,
    /// Name of the axis, with the unit.
    pub axis: &'static str,
    /// Which sequences have it, in words.
    pub among: &'static str,
    of: fn(&SequenceLabel) -> Option<f64>,
}

/// All of them, in the order of the page.
pub const QUANTITIES: [SequenceQuantity; 6] = [
    SequenceQuantity {
        title: "Friction coefficient",
        axis: "",
        among: "sequences that may slip",
        of: |label| label.common.sequence.friction_coefficient,
    },
    SequenceQuantity {
        title: "Onset of slip",
        axis: "s",
        among: "sequences that slip",
        of: |label| label.common.sequence.first_slip_s,
    },
    SequenceQuantity {
        title: "Onset of gross slip",
        axis: "s",
        among: "sequences that slip as a whole",
        of: |label| label.common.sequence.gross_slip_s,
    },
    SequenceQuantity {
        title: "Largest normal force",
        axis: "N",
        among: "sequences",
        of: |label| largest(label, |frame| -frame.wrench.force_n[2]),
    },
    SequenceQuantity {
        title: "Largest tangential force",
        axis: "N",
        among: "sequences",
        of: |label| largest(label, tangential),
    },
    SequenceQuantity {
        title: "Largest torque about z",
        axis: "N mm",
        among: "sequences",
        of: |label| largest(label, |frame| frame.wrench.torque_nmm[2].abs()),
    },
];

/// Force in the pad's plane, N.
fn tangential(frame: &FrameLabel) -> f64 {
    let [x, y, _] = frame.wrench.force_n;
    libm::hypot(x, y)
}

fn largest(label: &SequenceLabel, of: impl Fn(&FrameLabel) -> f64) -> Option<f64> {
    label.frames.iter().map(of).max_by(f64::total_cmp)
}

/// What is known of the sequences of some shards.
pub struct Sequences {
    /// A histogram of each of [`QUANTITIES`].
    pub histograms: Vec<Histogram>,
    /// Frames of all of them.
    pub frames: u64,
    /// Forces of some.
    pub curves: Vec<Curve>,
}

/// Forces of a sequence over time.
pub struct Curve {
    /// The sample's number.
    pub index: u64,
    /// What stands above.
    pub title: String,
    /// Time, s; normal force, tangential force and the most that friction holds, N; share that sticks; how much slips.
    pub points: Vec<Point>,
}

/// A frame of a curve.
pub struct Point {
    /// s.
    pub t_s: f64,
    /// N.
    pub normal_n: f64,
    /// N.
    pub tangential_n: f64,
    /// N; none where nothing slips.
    pub limit_n: Option<f64>,
    /// How much slips.
    pub slip: SlipState,
}

impl Default for Sequences {
    fn default() -> Self {
        Self { histograms: QUANTITIES.iter().map(|_| Histogram::continuous()).collect(), frames: 0, curves: Vec::new() }
    }
}

impl Sequences {
    /// Counts a sequence of a split; `shown` if its forces are to be drawn.
    pub fn count(&mut self, split: Split, label: &SequenceLabel, shown: bool) {
        self.frames += label.frames.len() as u64;
        for (quantity, histogram) in QUANTITIES.iter().zip(&mut self.histograms) {
            if let Some(value) = (quantity.of)(label).filter(|value| value.is_finite()) {
                histogram.count(split, value);
            }
        }
        if shown {
            let coefficient = label.common.sequence.friction_coefficient;
            let point = |frame: &FrameLabel| {
                let normal_n = -frame.wrench.force_n[2];
                Point {
                    t_s: frame.t_s,
                    normal_n,
                    tangential_n: tangential(frame),
                    limit_n: coefficient.map(|coefficient| coefficient * normal_n),
                    slip: frame.slip.state,
                }
            };
            let title = format!("{} #{}", label.common.object.class, label.common.index);
            let points = label.frames.iter().map(point).collect();
            self.curves.push(Curve { index: label.common.index, title, points });
        }
    }

    /// Adds those of other shards.
    pub fn merge(&mut self, other: Self) {
        self.histograms.iter_mut().zip(other.histograms).for_each(|(sum, more)| sum.merge(more));
        self.frames += other.frames;
        self.curves.extend(other.curves);
    }
}
