//! `[markers]`: the distributions that each sample's printed markers are drawn from.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::quantity::Quantity;
use gelsim_core::camera::markers::{MarkerLayout, MarkerPattern, MarkerPrint, MeasuredDot};

/// The `[markers]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "formats", schemars(rename = "Markers"))]
pub struct MarkerDistribution {
    /// CSV file with the dots' places as measured, relative to the file this stands in: columns x_mm and y_mm, mm from the
    /// middle of the view to the right and down, and diameter_mm if dots differ in size. Not with a grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// SHA-256 of that file in lower-case hex; if given, another content is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file_sha256: Option<String>,
    /// The dots in that file, once it was read.
    #[serde(skip)]
    pub dots: Option<Arc<Vec<MeasuredDot>>>,
    /// Number of rows of the grid, with `columns`. Without both it covers the view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<u32>,
    /// Number of columns of the grid, with `rows`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<u32>,
    /// Row and column of each dot of the grid that is not there, counted from 0 at the top left.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<[u32; 2]>,
    /// Place of the grid's middle, or shift of measured dots, mm from the middle of the view to the right and down.
    #[serde(skip_serializing_if = "is_unmoved")]
    pub offset_mm: [f64; 2],
    /// Distance between neighbouring dots of the grid, mm, along x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_mm: Option<Quantity>,
    /// Distance along y, mm, if it is another one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_y_mm: Option<Quantity>,
    /// Diameter of the dots, mm; 0 means no markers.
    pub diameter_mm: Quantity,
    /// Largest offset of a dot from its place along x and along y, mm. It is the same in every sample.
    pub jitter_mm: Quantity,
    /// Fraction of red, green and blue light that the ink lets through, 0 to 1.
    pub color: [f64; 3],
    /// Width of the dots' soft edge, mm.
    pub edge_mm: f64,
}

fn is_unmoved(offset_mm: &[f64; 2]) -> bool {
    *offset_mm == [0.0; 2]
}

impl Default for MarkerDistribution {
    fn default() -> Self {
        Self {
            file: None,
            file_sha256: None,
            dots: None,
            rows: None,
            columns: None,
            missing: Vec::new(),
            offset_mm: [0.0; 2],
            pitch_mm: Some(Quantity::Constant(1.5)),
            pitch_y_mm: None,
            diameter_mm: Quantity::Constant(0.4),
            jitter_mm: Quantity::Constant(0.05),
            color: [0.12; 3],
            edge_mm: 0.05,
        }
    }
}

impl MarkerDistribution {
    /// Leaves out the grid where a file says where the dots are, as the job of a dataset has it.
    pub fn leave_out_grid(&mut self) {
        if self.file.is_some() {
            (self.pitch_mm, self.pitch_y_mm, self.rows, self.columns) = (None, None, None, None);
            self.missing.clear();
        }
    }

    /// Iterates over the numbers that are drawn for each sample.
    pub fn quantities(&self) -> impl Iterator<Item = &Quantity> {
        self.pitch_mm.iter().chain(&self.pitch_y_mm).chain([&self.diameter_mm, &self.jitter_mm])
    }

    /// Draws the pattern of one sample. Returns `None` if the dots have no size.
    pub fn sample_pattern(&self, draw: impl Fn(&str, &Quantity) -> f64) -> Option<MarkerPattern> {
        let pitch_mm = self.pitch_mm.as_ref().map_or(0.0, |pitch| draw("marker pitch", pitch));
        let pitch_y_mm = self.pitch_y_mm.as_ref().map_or(pitch_mm, |pitch| draw("marker pitch along y", pitch));
        let pattern = MarkerPattern {
            pitch_mm: [pitch_mm, pitch_y_mm],
            diameter_mm: draw("marker diameter", &self.diameter_mm),
            jitter_mm: draw("marker jitter", &self.jitter_mm),
        };
        (pattern.diameter_mm > 0.0).then_some(pattern)
    }

    /// Returns the pattern of all samples, or `None` if it varies or there are no dots.
    pub fn constant_pattern(&self) -> Option<MarkerPattern> {
        let constant = self.quantities().all(|quantity| matches!(quantity, Quantity::Constant(_)));
        constant.then(|| self.sample_pattern(|_, quantity| quantity.support().0)).flatten()
    }

    /// Returns the ink and the arrangement, which do not vary.
    pub fn to_marker_print(&self) -> MarkerPrint {
        let layout = match (&self.dots, self.rows, self.columns) {
            (Some(dots), ..) => MarkerLayout::Measured(Arc::clone(dots)),
            (None, Some(rows), Some(columns)) => {
                let mut missing = self.missing.clone();
                missing.sort_unstable();
                MarkerLayout::Counted { rows, columns, missing }
            }
            _ => MarkerLayout::Endless,
        };
        MarkerPrint { color: self.color, edge_mm: self.edge_mm, layout, offset_mm: self.offset_mm }
    }
}

/// Reads a table of dots. The errors name the line and the column.
#[cfg(feature = "formats")]
pub fn parse_marker_table(path: &str, bytes: &[u8]) -> Result<Vec<MeasuredDot>, Vec<String>> {
    use crate::place_table::{PlaceKind, parse_places};

    let kind = PlaceKind { name: "dot", max_diameter_mm: Some(100.0), is_distinct: true };
    let dots = parse_places(path, bytes, kind)?.into_iter();
    Ok(dots.map(|dot| MeasuredDot { at_mm: dot.at_mm, diameter_mm: dot.diameter_mm }).collect())
}
