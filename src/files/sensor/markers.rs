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
    /// Distance between neighbours, mm, along x and y.
    pub pitch_mm: Quantity,
    /// Diameter, mm; 0 is no markers.
    pub diameter_mm: Quantity,
    /// Largest offset of a dot from the grid along x and along y, mm; the same in every sample.
    pub jitter_mm: Quantity,
    /// Red, green and blue share of the light that the ink lets through, 0 to 1.
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
    /// The pattern of one sample. `None` without any dot.
    pub fn sample(&self, draw: impl Fn(&str, &Quantity) -> f64) -> Option<MarkerPattern> {
        let pattern = MarkerPattern {
            pitch_mm: draw("marker pitch", &self.pitch_mm),
            diameter_mm: draw("marker diameter", &self.diameter_mm),
            jitter_mm: draw("marker jitter", &self.jitter_mm),
        };
        (pattern.diameter_mm > 0.0).then_some(pattern)
    }

    /// The pattern of every sample, if they are all the same.
    pub fn constant(&self) -> Option<MarkerPattern> {
        let quantities = [&self.pitch_mm, &self.diameter_mm, &self.jitter_mm];
        let constant = quantities.iter().all(|quantity| matches!(quantity, Quantity::Constant(_)));
        constant.then(|| self.sample(|_, quantity| quantity.support().0)).flatten()
    }

    /// The ink, which does not vary.
    pub fn print(&self) -> MarkerPrint {
        MarkerPrint { color: self.color, edge_mm: self.edge_mm }
    }
}
