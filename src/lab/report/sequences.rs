//! What a report shows of sequences: when they slip and how they are loaded, and the force over time of some.

use super::histogram::Histogram;
use gelsim_job::gripper::label::GripSequenceLabel;
use gelsim_job::layout::Split;
use gelsim_job::sequence::label::{FrameLabel, SequenceLabel, SlipState};

/// A quantity of a sequence.
pub struct SequenceQuantity {
    /// Title of its histogram.
    pub title: &'static str,
    /// Name of the axis, with the unit.
    pub axis: &'static str,
    /// Which sequences have it, in words.
    pub among: &'static str,
    value_of: fn(&PadCourse) -> Option<f64>,
}

/// What happens to one pad in a sequence.
struct PadCourse<'a> {
    index: u64,
    class: &'a str,
    /// Which of a gripper's two pads.
    finger: Option<&'static str>,
    /// Facts about the whole sequence; none for its second pad, so that they count once.
    friction_coefficient: Option<f64>,
    first_slip_s: Option<f64>,
    gross_slip_s: Option<f64>,
    frames: Vec<&'a FrameLabel>,
}

/// Name of a quantity's population that every sequence is in; of a gripper, every pad.
pub const EVERY_SEQUENCE: &str = "sequences";

/// All quantities, in the order of the page.
pub const QUANTITIES: [SequenceQuantity; 6] = [
    SequenceQuantity {
        title: "Friction coefficient",
        axis: "",
        among: "sequences that may slip",
        value_of: |course| course.friction_coefficient,
    },
    SequenceQuantity {
        title: "Onset of slip",
        axis: "s",
        among: "sequences that slip",
        value_of: |course| course.first_slip_s,
    },
    SequenceQuantity {
        title: "Onset of gross slip",
        axis: "s",
        among: "sequences with gross slip",
        value_of: |course| course.gross_slip_s,
    },
    SequenceQuantity {
        title: "Largest normal force",
        axis: "N",
        among: EVERY_SEQUENCE,
        value_of: |course| largest_over_frames(course, |frame| -frame.wrench.force_n[2]),
    },
    SequenceQuantity {
        title: "Largest tangential force",
        axis: "N",
        among: EVERY_SEQUENCE,
        value_of: |course| largest_over_frames(course, tangential_force),
    },
    SequenceQuantity {
        title: "Largest torque about z",
        axis: "N mm",
        among: EVERY_SEQUENCE,
        value_of: |course| largest_over_frames(course, |frame| frame.wrench.torque_nmm[2].abs()),
    },
];

/// Force in the pad's plane, N.
fn tangential_force(frame: &FrameLabel) -> f64 {
    let [x, y, _] = frame.wrench.force_n;
    libm::hypot(x, y)
}

fn largest_over_frames(course: &PadCourse, of: impl Fn(&FrameLabel) -> f64) -> Option<f64> {
    course.frames.iter().map(|frame| of(frame)).max_by(f64::total_cmp)
}

/// Sums over the sequences of some shards.
pub struct SequenceStats {
    /// A histogram of each of [`QUANTITIES`].
    pub histograms: Vec<Histogram>,
    /// Number of frames of all sequences.
    pub frames: u64,
    /// Whether they are of grippers, with two pads each.
    pub of_fingers: bool,
    /// Forces of some sequences.
    pub curves: Vec<ForceCurve>,
}

/// Forces of a sequence over time.
pub struct ForceCurve {
    /// Number of the sample.
    pub index: u64,
    /// Title of the curve.
    pub title: String,
    /// Frames in the order of time.
    pub points: Vec<CurvePoint>,
}

/// A frame of a curve.
pub struct CurvePoint {
    /// Time, s.
    pub t_s: f64,
    /// Normal force, N.
    pub normal_n: f64,
    /// Tangential force, N.
    pub tangential_n: f64,
    /// Largest tangential force that friction can hold, N; none without a friction coefficient.
    pub limit_n: Option<f64>,
    /// State of slip.
    pub slip: SlipState,
}

impl Default for SequenceStats {
    fn default() -> Self {
        let histograms = QUANTITIES.iter().map(|_| Histogram::continuous()).collect();
        Self { histograms, frames: 0, of_fingers: false, curves: Vec::new() }
    }
}

impl SequenceStats {
    /// Counts a sequence of a split. If `shown`, its forces are kept for drawing.
    pub fn count_sequence(&mut self, split: Split, label: &SequenceLabel, shown: bool) {
        self.frames += label.frames.len() as u64;
        let (common, sequence) = (&label.common, &label.common.sequence);
        let course = PadCourse {
            index: common.header.index,
            class: &common.header.object.class,
            finger: None,
            friction_coefficient: sequence.friction_coefficient,
            first_slip_s: sequence.first_slip_s,
            gross_slip_s: sequence.gross_slip_s,
            frames: label.frames.iter().collect(),
        };
        self.count_course(split, &course, sequence.friction_coefficient, shown);
    }

    /// Counts a gripper's sequence of a split: each pad is a course of its own. If `shown`, both pads' forces are kept
    /// for drawing.
    pub fn count_grip(&mut self, split: Split, label: &GripSequenceLabel, shown: bool) {
        self.frames += label.frames.len() as u64;
        self.of_fingers = true;
        let sequence = &label.sequence;
        let left = PadCourse {
            index: label.header.index,
            class: &label.header.object.class,
            finger: Some("left"),
            friction_coefficient: sequence.friction_coefficient,
            first_slip_s: sequence.first_slip_s,
            gross_slip_s: sequence.gross_slip_s,
            frames: label.frames.iter().map(|frame| &frame.left).collect(),
        };
        let right = PadCourse {
            finger: Some("right"),
            friction_coefficient: None,
            first_slip_s: None,
            gross_slip_s: None,
            frames: label.frames.iter().map(|frame| &frame.right).collect(),
            ..left
        };
        for course in [&left, &right] {
            self.count_course(split, course, sequence.friction_coefficient, shown);
        }
    }

    fn count_course(&mut self, split: Split, course: &PadCourse, friction_coefficient: Option<f64>, shown: bool) {
        for (quantity, histogram) in QUANTITIES.iter().zip(&mut self.histograms) {
            if let Some(value) = (quantity.value_of)(course).filter(|value| value.is_finite()) {
                histogram.count_value(split, value);
            }
        }
        if shown {
            let point = |frame: &&FrameLabel| {
                let normal_n = -frame.wrench.force_n[2];
                CurvePoint {
                    t_s: frame.t_s,
                    normal_n,
                    tangential_n: tangential_force(frame),
                    limit_n: friction_coefficient.map(|coefficient| coefficient * normal_n),
                    slip: frame.slip.state,
                }
            };
            let finger = course.finger.map_or(String::new(), |finger| format!(", {finger}"));
            let title = format!("{} #{}{finger}", course.class, course.index);
            let points = course.frames.iter().map(point).collect();
            self.curves.push(ForceCurve { index: course.index, title, points });
        }
    }

    /// Adds the sums of other shards.
    pub fn merge(&mut self, other: Self) {
        self.histograms.iter_mut().zip(other.histograms).for_each(|(sum, more)| sum.merge(more));
        self.frames += other.frames;
        self.of_fingers |= other.of_fingers;
        self.curves.extend(other.curves);
    }
}
