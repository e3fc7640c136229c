//! Units of length of mesh files.

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
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Mm, Self::Cm, Self::M, Self::In];

    /// As it is written in jobs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::In => "in",
        }
    }

    /// Millimetres per unit.
    pub fn mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::In => 25.4,
        }
    }

    /// The unit of so many millimetres, if there is one.
    pub fn of_mm(mm: f64) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.mm() == mm)
    }

    /// The unit that a mesh's coordinates look like, where it is another than they were taken for, and the length of the
    /// mesh in it: `largest_mm` is the one with `mm_per_unit`, to be seen by a sensor with this field of view.
    pub fn likely(mm_per_unit: f64, largest_mm: f64, field_of_view_mm: [f64; 2]) -> Option<(Self, f64)> {
        if is_plausible(largest_mm, field_of_view_mm) {
            return None;
        }
        // Metres are what a file is most often in if not in millimetres.
        let order = [Self::Mm, Self::M, Self::In, Self::Cm];
        let read = order.map(|unit| (unit, largest_mm / mm_per_unit * unit.mm()));
        read.into_iter().find(|(_, mm)| is_plausible(*mm, field_of_view_mm))
    }

    /// What a coordinate of 1 was taken for, as it is written in jobs, behind "under".
    #[cfg(feature = "formats")]
    pub fn written(mm_per_unit: f64) -> String {
        match Self::of_mm(mm_per_unit) {
            Some(unit) => format!("unit = \"{}\"", unit.name()),
            None => format!("a unit of {} mm", crate::figures::figure(mm_per_unit)),
        }
    }

    /// The same in words, behind a length.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Mm => "millimetres",
            Self::Cm => "centimetres",
            Self::M => "metres",
            Self::In => "inches",
        }
    }
}

/// True if a mesh of this length is one that a sensor with this field of view would be pressed with.
pub fn is_plausible(largest_mm: f64, [width, height]: [f64; 2]) -> bool {
    (width.min(height) / 10.0..=width.max(height) * 20.0).contains(&largest_mm)
}
