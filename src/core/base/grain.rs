//! Noise with a grain size, the same in every sample: for coatings and rendered backgrounds.

use super::grid::Grid;
use super::rng::random_stream;
use super::view::View;

/// Makes noise of mean 0 and standard deviation 1 with a given grain size: bilinear between random knots, at two
/// scales.
pub fn grain_noise(width: usize, height: usize, size_mm: f64, view: &View, name: &str) -> Grid<f32> {
    let mut grid = Grid::new(width, height);
    for octave in 0..2_u64 {
        let spacing = view.mm_per_px.map(|mm_per_px| f64::max(size_mm / mm_per_px / f64::from(1 << octave), 1.0));
        let columns = (width as f64 / spacing[0]) as usize + 2;
        let rows = (height as f64 / spacing[1]) as usize + 2;
        let mut random = random_stream(0, name, octave);
        let knots: Vec<f64> = (0..columns * rows).map(|_| random.standard_normal()).collect();
        // Bilinear weights shrink the spread between knots: they are divided out, so that no lattice shows.
        let kept = |u: f64| u * u + (1.0 - u) * (1.0 - u);
        let knot = |at: usize, k: usize| {
            let position = (at as f64 + 0.5) / spacing[k];
            let whole = libm::floor(position);
            (whole as usize, position - whole)
        };
        let across: Vec<(usize, f64, f64)> =
            (0..width).map(|i| knot(i, 0)).map(|(column, u)| (column, u, kept(u))).collect();
        for j in 0..height {
            let (row, v) = knot(j, 1);
            let (above, below) = knots[row * columns..][..2 * columns].split_at(columns);
            for (value, (column, u, kept_u)) in grid.row_mut(j).iter_mut().zip(&across) {
                let between = |row: &[f64]| row[*column] * (1.0 - u) + row[column + 1] * u;
                let sum = (between(above) * (1.0 - v) + between(below) * v) / (kept_u * kept(v)).sqrt();
                *value += (sum * std::f64::consts::FRAC_1_SQRT_2) as f32;
            }
        }
    }
    grid
}
