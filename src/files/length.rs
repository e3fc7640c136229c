//! The units of length in which the coordinates of a mesh file may be.

use serde::{Deserialize, Serialize};

/// Unit of length of a mesh file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Millimetres.
    #[default]
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
    /// Inches.
    In,
}

impl Unit {
    /// All units.
    pub const ALL: [Self; 4] = [Self::Mm, Self::Cm, Self::M, Self::In];

    /// Returns the name of the unit in a job.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::In => "in",
        }
    }

    /// Returns the millimetres per unit.
    pub fn mm_per_unit(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::In => 25.4,
        }
    }

    /// Returns the unit that has this many millimetres, if there is one.
    pub fn from_mm(mm: f64) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.mm_per_unit() == mm)
    }

    /// Guesses the unit of a mesh whose size is not plausible for a sensor with this field of view. `largest_mm` is its
    /// largest extent as read with `mm_per_unit`. Returns the unit and the extent in millimetres with it; `None` if the
    /// size is plausible, or is so in no unit.
    pub fn guess_from_size(mm_per_unit: f64, largest_mm: f64, field_of_view_mm: [f64; 2]) -> Option<(Self, f64)> {
        if is_plausible_length(largest_mm, field_of_view_mm) {
            return None;
        }
        // If a file is not in millimetres, it is most often in metres.
        let order = [Self::Mm, Self::M, Self::In, Self::Cm];
        let read = order.map(|unit| (unit, largest_mm / mm_per_unit * unit.mm_per_unit()));
        read.into_iter().find(|(_, mm)| is_plausible_length(*mm, field_of_view_mm))
    }

    /// Formats the unit by which coordinates were read, as a job writes it, to stand after "under".
    #[cfg(feature = "formats")]
    pub fn format_as_written(mm_per_unit: f64) -> String {
        match Self::from_mm(mm_per_unit) {
            Some(unit) => format!("unit = \"{}\"", unit.name()),
            None => format!("a unit of {} mm", crate::number_format::format_number(mm_per_unit)),
        }
    }

    /// Returns the name of the unit in words, to stand after a number.
    pub fn plural_name(self) -> &'static str {
        match self {
            Self::Mm => "millimetres",
            Self::Cm => "centimetres",
            Self::M => "metres",
            Self::In => "inches",
        }
    }
}

/// Returns true if a mesh of this length is one that would be pressed onto a sensor with this field of view.
pub fn is_plausible_length(largest_mm: f64, [width, height]: [f64; 2]) -> bool {
    (width.min(height) / 10.0..=width.max(height) * 20.0).contains(&largest_mm)
}
