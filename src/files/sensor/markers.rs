//! `[markers]`: the distributions that each sample's printed markers are drawn from.

use serde::{Deserialize, Serialize};

use super::quantity::Quantity;
use gelsim_core::camera::markers::{MarkerPattern, MarkerPrint};

/// The `[markers]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "formats", schemars(rename = "Markers"))]
pub struct MarkerDistribution {
    /// Distance between neighbouring dots, mm, along x and y.
    pub pitch_mm: Quantity,
    /// Diameter of the dots, mm; 0 means no markers.
    pub diameter_mm: Quantity,
    /// Largest offset of a dot from the grid along x and along y, mm. It is the same in every sample.
    pub jitter_mm: Quantity,
    /// Fraction of red, green and blue light that the ink lets through, 0 to 1.
    pub color: [f64; 3],
    /// Width of the dots' soft edge, mm.
    pub edge_mm: f64,
}

impl Default for MarkerDistribution {
    fn default() -> Self {
        Self {
            pitch_mm: Quantity::Constant(1.5),
            diameter_mm: Quantity::Constant(0.4),
            jitter_mm: Quantity::Constant(0.05),
            color: [0.12; 3],
            edge_mm: 0.05,
        }
    }
}

impl MarkerDistribution {
    /// Draws the pattern of one sample. Returns `None` if the dots have no size.
    pub fn sample_pattern(&self, draw: impl Fn(&str, &Quantity) -> f64) -> Option<MarkerPattern> {
        let pattern = MarkerPattern {
            pitch_mm: draw("marker pitch", &self.pitch_mm),
            diameter_mm: draw("marker diameter", &self.diameter_mm),
            jitter_mm: draw("marker jitter", &self.jitter_mm),
        };
        (pattern.diameter_mm > 0.0).then_some(pattern)
    }

    /// Returns the pattern of all samples, or `None` if it varies or there are no dots.
    pub fn constant_pattern(&self) -> Option<MarkerPattern> {
        let quantities = [&self.pitch_mm, &self.diameter_mm, &self.jitter_mm];
        let constant = quantities.iter().all(|quantity| matches!(quantity, Quantity::Constant(_)));
        constant.then(|| self.sample_pattern(|_, quantity| quantity.support().0)).flatten()
    }

    /// Returns the ink, which does not vary.
    pub fn to_marker_print(&self) -> MarkerPrint {
        MarkerPrint { color: self.color, edge_mm: self.edge_mm }
    }
}
