//! What a report shows of sequences: when they slip and how they are pushed, and force over time of some of them.

use super::histogram::Histogram;
use gelsim_job::gripper::label::GripSequenceLabel;
use gelsim_job::layout::Split;
use gelsim_job::sequence::label::{FrameLabel, SequenceLabel, SlipState};

/// A number of a sequence.
pub struct SequenceQuantity {
    /// Title of its histogram.
    pub title: &'static str,
    /// Name of the axis, with the unit.
    pub axis: &'static str,
    /// Which sequences have it, in words.
    pub among: &'static str,
    of: fn(&Course) -> Option<f64>,
}

/// What happens to a pad in a sequence.
struct Course<'a> {
    index: u64,
    class: &'a str,
    /// Of a gripper's pads which one.
    finger: Option<&'static str>,
    /// What holds for the whole sequence; none for the second pad of one.
    friction_coefficient: Option<f64>,
    first_slip_s: Option<f64>,
    gross_slip_s: Option<f64>,
    frames: Vec<&'a FrameLabel>,
}

/// Said of what every sequence has, of a gripper each of its pads.
pub const EACH: &str = "sequences";

/// All of them, in the order of the page.
pub const QUANTITIES: [SequenceQuantity; 6] = [
    SequenceQuantity {
        title: "Friction coefficient",
        axis: "",
        among: "sequences that may slip",
        of: |course| course.friction_coefficient,
    },
    SequenceQuantity {
        title: "Onset of slip",
        axis: "s",
        among: "sequences that slip",
        of: |course| course.first_slip_s,
    },
    SequenceQuantity {
        title: "Onset of gross slip",
        axis: "s",
        among: "sequences that slip as a whole",
        of: |course| course.gross_slip_s,
    },
    SequenceQuantity {
        title: "Largest normal force",
        axis: "N",
        among: EACH,
        of: |course| largest(course, |frame| -frame.wrench.force_n[2]),
    },
    SequenceQuantity {
        title: "Largest tangential force",
        axis: "N",
        among: EACH,
        of: |course| largest(course, tangential),
    },
    SequenceQuantity {
        title: "Largest torque about z",
        axis: "N mm",
        among: EACH,
        of: |course| largest(course, |frame| frame.wrench.torque_nmm[2].abs()),
    },
];

/// Force in the pad's plane, N.
fn tangential(frame: &FrameLabel) -> f64 {
    let [x, y, _] = frame.wrench.force_n;
    libm::hypot(x, y)
}

fn largest(course: &Course, of: impl Fn(&FrameLabel) -> f64) -> Option<f64> {
    course.frames.iter().map(|frame| of(frame)).max_by(f64::total_cmp)
}

/// What is known of the sequences of some shards.
pub struct Sequences {
    /// A histogram of each of [`QUANTITIES`].
    pub histograms: Vec<Histogram>,
    /// Frames of all of them.
    pub frames: u64,
    /// True if they are of grippers, with two pads each.
    pub of_fingers: bool,
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
        let histograms = QUANTITIES.iter().map(|_| Histogram::continuous()).collect();
        Self { histograms, frames: 0, of_fingers: false, curves: Vec::new() }
    }
}

impl Sequences {
    /// Counts a sequence of a split; `shown` if its forces are to be drawn.
    pub fn count(&mut self, split: Split, label: &SequenceLabel, shown: bool) {
        self.frames += label.frames.len() as u64;
        let (common, sequence) = (&label.common, &label.common.sequence);
        let course = Course {
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

    /// The same of a sequence of a gripper.
    pub fn count_grip(&mut self, split: Split, label: &GripSequenceLabel, shown: bool) {
        self.frames += label.frames.len() as u64;
        self.of_fingers = true;
        let sequence = &label.sequence;
        let left = Course {
            index: label.header.index,
            class: &label.header.object.class,
            finger: Some("left"),
            friction_coefficient: sequence.friction_coefficient,
            first_slip_s: sequence.first_slip_s,
            gross_slip_s: sequence.gross_slip_s,
            frames: label.frames.iter().map(|frame| &frame.left).collect(),
        };
        let right = Course {
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

    fn count_course(&mut self, split: Split, course: &Course, friction_coefficient: Option<f64>, shown: bool) {
        for (quantity, histogram) in QUANTITIES.iter().zip(&mut self.histograms) {
            if let Some(value) = (quantity.of)(course).filter(|value| value.is_finite()) {
                histogram.count(split, value);
            }
        }
        if shown {
            let point = |frame: &&FrameLabel| {
                let normal_n = -frame.wrench.force_n[2];
                Point {
                    t_s: frame.t_s,
                    normal_n,
                    tangential_n: tangential(frame),
                    limit_n: friction_coefficient.map(|coefficient| coefficient * normal_n),
                    slip: frame.slip.state,
                }
            };
            let finger = course.finger.map_or(String::new(), |finger| format!(", {finger}"));
            let title = format!("{} #{}{finger}", course.class, course.index);
            let points = course.frames.iter().map(point).collect();
            self.curves.push(Curve { index: course.index, title, points });
        }
    }

    /// Adds those of other shards.
    pub fn merge(&mut self, other: Self) {
        self.histograms.iter_mut().zip(other.histograms).for_each(|(sum, more)| sum.merge(more));
        self.frames += other.frames;
        self.of_fingers |= other.of_fingers;
        self.curves.extend(other.curves);
    }
}
