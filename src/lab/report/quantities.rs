//! Quantities of a label that a report shows as histograms, each with the samples in which it has a meaning.

use super::histogram::Histogram;
use gelsim_core::gelpad::Theory;
use gelsim_job::label::Label;

/// Topic of a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QuantityTopic {
    /// The contact.
    Contact,
    /// Where and how the object is held.
    Pose,
    /// What only some jobs have: texture, motion, markers.
    Extra,
    /// How the contact was solved.
    Solver,
}

/// A quantity of a sample.
pub struct LabelQuantity {
    /// Section of the report.
    pub topic: QuantityTopic,
    /// Title of its histogram.
    pub title: &'static str,
    /// Name of the axis, with the unit.
    pub axis: &'static str,
    /// Which samples have it, in words.
    pub among: &'static str,
    /// Returns the value; none if it has no meaning in this sample.
    pub value_of: fn(&Label) -> Option<f64>,
    /// Whether it is an integer.
    pub is_integer: bool,
    /// What takes the place of its histogram if no sample has it.
    pub absent: EmptyHistogram,
}

/// What takes the place of a histogram without values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmptyHistogram {
    /// Nothing.
    LeftOut,
    /// A message.
    Message(&'static str),
    /// A message that the gelpad model does not compute it.
    Unknown,
}

const PRESSES: &str = "pressed samples";
/// Message where no sample is in contact.
pub const NO_CONTACT: &str = "no sample is in contact";
const CONTACTS: &str = "samples in contact";
const WITHOUT_CONTACT: EmptyHistogram = EmptyHistogram::Message(NO_CONTACT);

/// All quantities, in the order of the page.
pub const QUANTITIES: [LabelQuantity; 19] = [
    LabelQuantity {
        topic: QuantityTopic::Contact,
        title: "Indentation depth",
        axis: "mm",
        among: PRESSES,
        value_of: |label| is_pressed(label).then_some(label.indentation_depth_mm),
        is_integer: false,
        absent: EmptyHistogram::Message("no sample is pressed"),
    },
    LabelQuantity {
        topic: QuantityTopic::Contact,
        title: "Deepest point in view",
        axis: "mm",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, label.contact.max_depth_mm),
        is_integer: false,
        absent: WITHOUT_CONTACT,
    },
    LabelQuantity {
        topic: QuantityTopic::Contact,
        title: "Contact area",
        axis: "mm\u{b2}",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, label.contact.area_mm2),
        is_integer: false,
        absent: WITHOUT_CONTACT,
    },
    LabelQuantity {
        topic: QuantityTopic::Contact,
        title: "Share of the view touched",
        axis: "%",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, 100.0 * label.contact.fraction),
        is_integer: false,
        absent: WITHOUT_CONTACT,
    },
    LabelQuantity {
        topic: QuantityTopic::Contact,
        title: "Normal force",
        axis: "N",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, label.contact.force_n?),
        is_integer: false,
        absent: EmptyHistogram::Unknown,
    },
    LabelQuantity {
        topic: QuantityTopic::Contact,
        title: "Peak pressure",
        axis: "kPa",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, label.contact.peak_pressure_kpa?),
        is_integer: false,
        absent: EmptyHistogram::Unknown,
    },
    LabelQuantity {
        topic: QuantityTopic::Pose,
        title: "Yaw",
        axis: "degrees",
        among: "samples",
        value_of: |label| Some(label.pose.yaw_deg),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Pose,
        title: "Tilt",
        axis: "degrees",
        among: "samples",
        value_of: |label| Some(label.pose.tilt_deg),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Pose,
        title: "Direction of the tilt's axis",
        axis: "degrees",
        among: "tilted samples",
        value_of: |label| (label.pose.tilt_deg != 0.0).then_some(label.pose.tilt_azimuth_deg),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Extra,
        title: "Texture amplitude",
        axis: "mm",
        among: "textured samples",
        value_of: |label| (!label.texture.pattern.is_empty()).then_some(label.texture.amplitude_mm),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Extra,
        title: "Shift in the pad's plane",
        axis: "mm",
        among: "samples that were moved",
        value_of: |label| is_moved(label).then(|| libm::hypot(label.shear.shift_mm[0], label.shear.shift_mm[1])),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Extra,
        title: "Twist in the pad's plane",
        axis: "degrees",
        among: "samples that were moved",
        value_of: |label| is_moved(label).then_some(label.shear.twist_deg),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Extra,
        title: "Shear force",
        axis: "N",
        among: "samples that were moved",
        value_of: |label| {
            let force = label.shear.force_n.filter(|_| is_moved(label));
            force.map(|[x, y]| libm::hypot(x, y))
        },
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Extra,
        title: "Mean motion of markers",
        axis: "px",
        among: "samples with markers",
        value_of: |label| (label.markers.count > 0).then_some(label.markers.mean_motion_px),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Solver,
        title: "Solver's iterations",
        axis: "iterations",
        among: "samples that took any",
        value_of: |label| (label.numerics.iterations > 0).then_some(f64::from(label.numerics.iterations)),
        is_integer: true,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Solver,
        title: "Residual of the contact",
        axis: "um",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, label.numerics.residual_um?),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Solver,
        title: "Error of the pad's theory",
        axis: "um",
        among: CONTACTS,
        value_of: |label| value_in_contact(label, label.numerics.model_error_um?),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Solver,
        title: "Iterations at finite strain",
        axis: "iterations",
        among: "samples at finite strain",
        value_of: |label| value_at_finite_strain(label, f64::from(label.numerics.strain_iterations)),
        is_integer: true,
        absent: EmptyHistogram::LeftOut,
    },
    LabelQuantity {
        topic: QuantityTopic::Solver,
        title: "Residual at finite strain",
        axis: "um",
        among: "samples at finite strain",
        value_of: |label| value_at_finite_strain(label, label.numerics.strain_residual_um),
        is_integer: false,
        absent: EmptyHistogram::LeftOut,
    },
];

impl LabelQuantity {
    /// Title and unit.
    pub fn title_with_unit(&self) -> String {
        if self.is_integer { self.title.to_owned() } else { format!("{}, {}", self.title, self.axis) }
    }

    /// Creates an empty histogram of it.
    pub fn new_histogram(&self) -> Histogram {
        if self.is_integer { Histogram::integer() } else { Histogram::continuous() }
    }
}

fn is_pressed(label: &Label) -> bool {
    label.indentation_depth_mm > 0.0
}

fn value_in_contact(label: &Label, value: f64) -> Option<f64> {
    label.contact.in_contact.then_some(value)
}

fn value_at_finite_strain(label: &Label, value: f64) -> Option<f64> {
    (label.numerics.theory == Theory::FiniteStrain).then_some(value)
}

fn is_moved(label: &Label) -> bool {
    label.shear.shift_mm != [0.0; 2] || label.shear.twist_deg != 0.0
}
