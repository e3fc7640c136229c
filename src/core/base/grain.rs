//! Noise with a grain size, the same in every sample: of coatings and of rendered backgrounds.

use super::grid::Grid;
use super::rng::stream;
use super::view::View;

/// Noise of mean 0 and standard deviation 1 with a given grain size: bilinear between random knots, at two scales.
pub fn grain(width: usize, height: usize, size_mm: f64, view: &View, name: &str) -> Grid<f32> {
    let mut grid = Grid::new(width, height);
    for octave in 0..2_u64 {
        let spacing = view.mm_per_px.map(|pitch| f64::max(size_mm / pitch / f64::from(1 << octave), 1.0));
        let columns = (width as f64 / spacing[0]) as usize + 2;
        let rows = (height as f64 / spacing[1]) as usize + 2;
        let mut random = stream(0, name, octave);
        let knots: Vec<f64> = (0..columns * rows).map(|_| random.normal()).collect();
        for j in 0..height {
            let (row, v) = knot((j as f64 + 0.5) / spacing[1]);
            for i in 0..width {
                let (column, u) = knot((i as f64 + 0.5) / spacing[0]);
                let at = |dx: usize, dy: usize| knots[(row + dy) * columns + column + dx];
                let above = at(0, 0) * (1.0 - u) + at(1, 0) * u;
                let below = at(0, 1) * (1.0 - u) + at(1, 1) * u;
                // Bilinear weights shrink the spread between knots: divided out, so that no lattice shows.
                let spread = libm::sqrt((u * u + (1.0 - u) * (1.0 - u)) * (v * v + (1.0 - v) * (1.0 - v)));
                let value = (above * (1.0 - v) + below * v) / spread;
                grid.row_mut(j)[i] += (value * std::f64::consts::FRAC_1_SQRT_2) as f32;
            }
        }
    }
    grid
}

fn knot(position: f64) -> (usize, f64) {
    let whole = libm::floor(position);
    (whole as usize, position - whole)
}
