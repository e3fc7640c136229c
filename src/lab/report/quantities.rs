//! What a report shows a histogram of: numbers of a label, each with the samples in which it means something.

use super::histogram::Histogram;
use gelsim_job::label::Label;

/// What quantities are about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum About {
    /// The contact.
    Contact,
    /// Where and how the object is held.
    Pose,
    /// What only some jobs have.
    Extra,
    /// How the contact was solved.
    Solver,
}

/// A number of a sample.
pub struct LabelQuantity {
    /// What it is about.
    pub about: About,
    /// Title of its histogram.
    pub title: &'static str,
    /// Name of the axis, with the unit.
    pub axis: &'static str,
    /// Which samples have it, in words.
    pub among: &'static str,
    /// The number; none if it means nothing in this sample.
    pub of: fn(&Label) -> Option<f64>,
    /// True if it is a whole number.
    pub is_integer: bool,
    /// What becomes of its histogram if no sample has it.
    pub absent: Absent,
}

/// What stands in the place of a histogram without values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Absent {
    /// Nothing.
    LeftOut,
    /// Words.
    Message(&'static str),
    /// Words about the model of the pad, which does not know it.
    Unknown,
}

const PRESSES: &str = "pressed samples";
/// Said where no sample is in contact.
pub const NO_CONTACT: &str = "no sample is in contact";
const CONTACTS: &str = "samples in contact";
const WITHOUT_CONTACT: Absent = Absent::Message(NO_CONTACT);

/// All of them, in the order of the page.
pub const QUANTITIES: [LabelQuantity; 17] = [
    LabelQuantity {
        about: About::Contact,
        title: "Indentation depth",
        axis: "mm",
        among: PRESSES,
        of: |label| pressed(label).then_some(label.indentation_depth_mm),
        is_integer: false,
        absent: Absent::Message("no sample is pressed"),
    },
    LabelQuantity {
        about: About::Contact,
        title: "Deepest point in view",
        axis: "mm",
        among: CONTACTS,
        of: |label| touching(label, label.contact.max_depth_mm),
        is_integer: false,
        absent: WITHOUT_CONTACT,
    },
    LabelQuantity {
        about: About::Contact,
        title: "Contact area",
        axis: "mm\u{b2}",
        among: CONTACTS,
        of: |label| touching(label, label.contact.area_mm2),
        is_integer: false,
        absent: WITHOUT_CONTACT,
    },
    LabelQuantity {
        about: About::Contact,
        title: "Share of the view touched",
        axis: "%",
        among: CONTACTS,
        of: |label| touching(label, 100.0 * label.contact.fraction),
        is_integer: false,
        absent: WITHOUT_CONTACT,
    },
    LabelQuantity {
        about: About::Contact,
        title: "Normal force",
        axis: "N",
        among: CONTACTS,
        of: |label| touching(label, label.contact.force_n?),
        is_integer: false,
        absent: Absent::Unknown,
    },
    LabelQuantity {
        about: About::Contact,
        title: "Peak pressure",
        axis: "kPa",
        among: CONTACTS,
        of: |label| touching(label, label.contact.peak_pressure_kpa?),
        is_integer: false,
        absent: Absent::Unknown,
    },
    LabelQuantity {
        about: About::Pose,
        title: "Yaw",
        axis: "degrees",
        among: "samples",
        of: |label| Some(label.pose.yaw_deg),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Pose,
        title: "Tilt",
        axis: "degrees",
        among: "samples",
        of: |label| Some(label.pose.tilt_deg),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Pose,
        title: "Direction of the tilt's axis",
        axis: "degrees",
        among: "tilted samples",
        of: |label| (label.pose.tilt_deg != 0.0).then_some(label.pose.tilt_azimuth_deg),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Extra,
        title: "Texture amplitude",
        axis: "mm",
        among: "textured samples",
        of: |label| (!label.texture.pattern.is_empty()).then_some(label.texture.amplitude_mm),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Extra,
        title: "Shift in the pad's plane",
        axis: "mm",
        among: "samples that were moved",
        of: |label| moved(label).then(|| libm::hypot(label.shear.shift_mm[0], label.shear.shift_mm[1])),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Extra,
        title: "Twist in the pad's plane",
        axis: "degrees",
        among: "samples that were moved",
        of: |label| moved(label).then_some(label.shear.twist_deg),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Extra,
        title: "Shear force",
        axis: "N",
        among: "samples that were moved",
        of: |label| {
            let force = label.shear.force_n.filter(|_| moved(label));
            force.map(|[x, y]| libm::hypot(x, y))
        },
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Extra,
        title: "Mean motion of markers",
        axis: "px",
        among: "samples with markers",
        of: |label| (label.markers.count > 0).then_some(label.markers.mean_motion_px),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Solver,
        title: "Solver's iterations",
        axis: "iterations",
        among: "samples that took any",
        of: |label| (label.numerics.iterations > 0).then_some(f64::from(label.numerics.iterations)),
        is_integer: true,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Solver,
        title: "Residual of the contact",
        axis: "um",
        among: CONTACTS,
        of: |label| touching(label, label.numerics.residual_um?),
        is_integer: false,
        absent: Absent::LeftOut,
    },
    LabelQuantity {
        about: About::Solver,
        title: "Error of the pad's theory",
        axis: "um",
        among: CONTACTS,
        of: |label| touching(label, label.numerics.model_error_um?),
        is_integer: false,
        absent: Absent::LeftOut,
    },
];

impl LabelQuantity {
    /// Title and unit.
    pub fn name(&self) -> String {
        if self.is_integer { self.title.to_owned() } else { format!("{}, {}", self.title, self.axis) }
    }

    /// An empty histogram of it.
    pub fn histogram(&self) -> Histogram {
        if self.is_integer { Histogram::integer() } else { Histogram::continuous() }
    }
}

fn pressed(label: &Label) -> bool {
    label.indentation_depth_mm > 0.0
}

fn touching(label: &Label, value: f64) -> Option<f64> {
    label.contact.in_contact.then_some(value)
}

fn moved(label: &Label) -> bool {
    label.shear.shift_mm != [0.0; 2] || label.shear.twist_deg != 0.0
}
