//! Places of a chart, along whose normals an object is captured.

use crate::base::chart::Chart;

/// Places of a chart, in columns and rows.
pub struct Places<'a> {
    /// The chart.
    pub chart: &'a Chart,
    /// That of a column and row, those of a margin included, mm.
    pub place: &'a dyn Fn([usize; 2]) -> [f64; 2],
    /// How far apart they are, mm.
    pub pitch_mm: [f64; 2],
}
