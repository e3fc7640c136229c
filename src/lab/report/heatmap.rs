//! Heatmap of points in the view: counts on a grid of square cells, drawn darker where they are higher.

use maud::Markup;

use crate::page::canvas::Colour;
use crate::page::plot::{GREY, MARGINS, Plot};

/// Number of cells along the longer side of the view.
const CELLS: f64 = 40.0;
/// Colours of the lowest count above 0 and of the highest.
const SHADES: [Colour; 2] = [[205, 222, 238], [8, 48, 107]];

/// Counts of points in a view.
#[derive(Clone, Debug)]
pub struct PointHeatmap {
    view_mm: [f64; 2],
    cells: [usize; 2],
    counts: Vec<u64>,
}

impl PointHeatmap {
    /// Creates an empty heatmap of a view of this width and height, mm, with its middle at (0, 0).
    pub fn new(view_mm: [f64; 2]) -> Self {
        let view_mm = view_mm.map(|side| if side.is_finite() && side > 0.0 { side } else { 1.0 });
        let cell_mm = view_mm[0].max(view_mm[1]) / CELLS;
        let cells = view_mm.map(|side| ((side / cell_mm).round() as usize).max(1));
        Self { view_mm, cells, counts: vec![0; cells[0] * cells[1]] }
    }

    /// Counts a point, mm. A point outside the view counts in the nearest cell.
    pub fn count_point(&mut self, at_mm: [f64; 2]) {
        let cell = |axis: usize| {
            let fraction = at_mm[axis] / self.view_mm[axis] + 0.5;
            // The cast takes negative numbers to 0.
            ((fraction * self.cells[axis] as f64) as usize).min(self.cells[axis] - 1)
        };
        let cell = cell(1) * self.cells[0] + cell(0);
        self.counts[cell] += 1;
    }

    /// Adds the counts of another heatmap of the same view.
    pub fn merge(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(sum, count)| *sum += count);
    }

    /// Highest count of a cell.
    pub fn highest_count(&self) -> u64 {
        self.counts.iter().copied().max().unwrap_or(0)
    }

    /// Width and height of a cell, mm.
    pub fn cell_mm(&self) -> [f64; 2] {
        std::array::from_fn(|axis| self.view_mm[axis] / self.cells[axis] as f64)
    }

    /// Draws the view with its cells as SVG, `width` px wide; y grows downwards, as in images.
    pub fn to_svg(&self, title: &str, width: f64) -> Markup {
        let [left, top, right, bottom] = MARGINS;
        let height = (width - left - right) * self.view_mm[1] / self.view_mm[0];
        let [x, y] = self.view_mm.map(|side| side / 2.0);
        let size = [width, top + bottom + height.clamp(40.0, 4.0 * width)];
        let mut plot = Plot::new(size, title, ["x, mm", "y, mm"], [[-x, x], [y, -y]]);
        let cell_mm = self.cell_mm();
        for (number, &count) in self.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let [column, row] = [number % self.cells[0], number / self.cells[0]].map(|at| at as f64);
            let corner = |column: f64, row: f64| plot.to_canvas([column * cell_mm[0] - x, row * cell_mm[1] - y]);
            let (from, to) = (corner(column, row), corner(column + 1.0, row + 1.0));
            let shade = cell_colour(count, self.highest_count());
            plot.canvas.draw_with_hint(&count.to_string(), |canvas| canvas.draw_rectangle(from, to, shade, 1.0));
        }
        let corners = [[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]].map(|corner| plot.to_canvas(corner));
        plot.canvas.draw_line(&corners, GREY, 1.0, None);
        plot.to_svg()
    }
}

/// Colour of a cell, between those of a single point and of the highest count.
fn cell_colour(count: u64, most: u64) -> Colour {
    let fraction = if most > 1 { (count - 1) as f64 / (most - 1) as f64 } else { 1.0 };
    let [pale, dark] = SHADES;
    std::array::from_fn(|k| (f64::from(pale[k]) + fraction * (f64::from(dark[k]) - f64::from(pale[k]))).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_counted_in_their_cells_with_y_downwards() {
        let mut places = PointHeatmap::new([20.0, 15.0]);
        assert_eq!((places.cells, places.cell_mm()), ([40, 30], [0.5, 0.5]));
        let points = [[-9.9, -7.4], [-9.6, -7.1], [9.9, 7.4], [1e9, 1e9], [0.1, -0.1]];
        points.into_iter().for_each(|point| places.count_point(point));
        assert_eq!((places.counts[0], places.counts[1199], places.counts[14 * 40 + 20]), (2, 2, 1));
        let mut twice = places.clone();
        twice.merge(&places);
        assert_eq!((twice.counts.iter().sum::<u64>(), twice.highest_count()), (10, 4));
    }

    #[test]
    fn any_view_is_drawn_well_formed() {
        for view in [[20.0, 15.0], [1.0, 1000.0], [0.0, f64::NAN], [1e-9, 1e-9]] {
            let mut places = PointHeatmap::new(view);
            let empty = places.to_svg("t", 330.0).0;
            places.count_point([0.0, 0.0]);
            for svg in [empty, places.to_svg("t", 330.0).0] {
                assert!(roxmltree::Document::parse(&svg).is_ok() && !svg.contains("NaN"), "{svg}");
            }
        }
    }
}
