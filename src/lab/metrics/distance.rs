//! Exact Euclidean distances, in mm, from every pixel to the nearest marked one.
//!
//! Two passes (Felzenszwalb and Huttenlocher 2012, Distance Transforms of Sampled Functions): along each column, count
//! the rows to the nearest marked pixel; along each row, take the lower envelope of the parabolas that the columns
//! give. Pixels may be wider than high.

use gelsim_core::base::grid::Grid;

/// Squared distance, mm^2, from each pixel's centre to that of the nearest non-zero pixel of `mask`: 0 at those,
/// infinity everywhere if there is none. `mm_per_px` is [width, height] of a pixel.
pub fn squared_distance_mm2(mask: &Grid<u8>, mm_per_px: [f64; 2]) -> Grid<f64> {
    let [mm_per_column, mm_per_row] = mm_per_px;
    let mut squares = rows_to_nearest(mask);
    for rows in &mut squares.data {
        *rows = (*rows * mm_per_row) * (*rows * mm_per_row);
    }
    let mut envelope = Envelope::default();
    for y in 0..squares.height {
        envelope.write_lowest(squares.row_mut(y), mm_per_column);
    }
    squares
}

/// Rows between each pixel and the nearest marked one in its column; infinity without any.
fn rows_to_nearest(mask: &Grid<u8>) -> Grid<f64> {
    let mut rows = Grid { width: mask.width, height: mask.height, data: vec![f64::INFINITY; mask.data.len()] };
    let mut nearest = vec![f64::INFINITY; mask.width];
    for y in 0..mask.height {
        for ((rows, nearest), mask) in rows.row_mut(y).iter_mut().zip(&mut nearest).zip(mask.row(y)) {
            *nearest = if *mask > 0 { 0.0 } else { *nearest + 1.0 };
            *rows = *nearest;
        }
    }
    nearest.fill(f64::INFINITY);
    for y in (0..mask.height).rev() {
        for (rows, nearest) in rows.row_mut(y).iter_mut().zip(&mut nearest) {
            *nearest = rows.min(*nearest + 1.0);
            *rows = *nearest;
        }
    }
    rows
}

/// Parabolas of a row that are lowest somewhere, from left to right.
#[derive(Default)]
struct Envelope {
    parabolas: Vec<Parabola>,
}

/// `height + (step_mm * (x - column))^2`, the lowest one from `from` on; `x` and `from` in columns.
struct Parabola {
    column: f64,
    height: f64,
    from: f64,
}

impl Envelope {
    /// Replaces each value of `row` by the lowest parabola there.
    fn write_lowest(&mut self, row: &mut [f64], step_mm: f64) {
        self.parabolas.clear();
        for (column, &height) in row.iter().enumerate() {
            // A parabola at infinity is lowest nowhere, and would make the crossing with others NaN.
            if height.is_finite() {
                self.push(column as f64, height, step_mm);
            }
        }
        if self.parabolas.is_empty() {
            return;
        }
        let mut lowest = 0;
        for (column, value) in row.iter_mut().enumerate() {
            let column = column as f64;
            while self.parabolas.get(lowest + 1).is_some_and(|next| next.from <= column) {
                lowest += 1;
            }
            let parabola = &self.parabolas[lowest];
            let across = step_mm * (column - parabola.column);
            *value = parabola.height + across * across;
        }
    }

    /// Adds a parabola to the right of all others, and removes those that it hides.
    fn push(&mut self, column: f64, height: f64, step_mm: f64) {
        let mut from = f64::NEG_INFINITY;
        while let Some(last) = self.parabolas.last() {
            let lift = (height - last.height) / (step_mm * step_mm);
            from = 0.5 * (lift / (column - last.column) + column + last.column);
            if from > last.from {
                break;
            }
            self.parabolas.pop();
            from = f64::NEG_INFINITY;
        }
        self.parabolas.push(Parabola { column, height, from });
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn without_a_mark_every_distance_is_infinite() {
        let distances = squared_distance_mm2(&Grid::new(5, 4), [0.1, 0.2]);
        assert!(distances.data.iter().all(|d| *d == f64::INFINITY));
        assert!(squared_distance_mm2(&Grid::new(0, 0), [0.1, 0.2]).data.is_empty());
    }

    #[test]
    fn pixels_wider_than_high_count_as_such() {
        let mut mask = Grid::new(4, 3);
        mask.row_mut(0)[0] = 255;
        let distances = squared_distance_mm2(&mask, [0.5, 0.25]);
        assert_eq!(distances.at(3, 0), 2.25);
        assert_eq!(distances.at(0, 2), 0.25);
        assert_eq!(distances.at(2, 2), 1.25);
    }

    proptest! {
        #[test]
        fn distances_are_those_of_a_search_over_all_pixels(
            width in 1usize..24,
            height in 1usize..24,
            marks in prop::collection::vec((0usize..24, 0usize..24), 1..12),
            mm_per_px in prop::array::uniform2(0.01f64..2.0),
        ) {
            let mut mask = Grid::new(width, height);
            for (x, y) in &marks {
                mask.row_mut(y % height)[x % width] = 255;
            }
            let found = squared_distance_mm2(&mask, mm_per_px);
            for y in 0..height {
                for x in 0..width {
                    let square = |mark: &(usize, usize)| {
                        let dx = ((mark.0 % width) as f64 - x as f64) * mm_per_px[0];
                        let dy = ((mark.1 % height) as f64 - y as f64) * mm_per_px[1];
                        dx * dx + dy * dy
                    };
                    let expected = marks.iter().map(square).fold(f64::INFINITY, f64::min);
                    prop_assert!((found.at(x, y) - expected).abs() <= 1e-12 * expected, "{x} {y}");
                }
            }
        }
    }
}
