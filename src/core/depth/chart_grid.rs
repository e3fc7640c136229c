//! Points of a chart, along whose normals an object is captured.

use crate::base::chart::Chart;

/// Points of a chart, in columns and rows.
pub struct ChartGrid<'a> {
    /// The chart.
    pub chart: &'a Chart,
    /// Returns the position on the chart of a column and row, mm; a margin counts as columns and rows.
    pub position_mm: &'a dyn Fn([usize; 2]) -> [f64; 2],
    /// Distance between neighbouring columns and rows, mm.
    pub spacing_mm: [f64; 2],
}
