//! Direct solver for symmetric systems whose entries lie near the diagonal.

use gelsim_core::base::simd::simd_dispatch;

/// Rows that are eliminated together, so that a pass over the rows below serves all of them.
const BLOCK: usize = 4;

/// A symmetric matrix. Each row is stored from its diagonal to `band` columns to the right.
#[derive(Clone, Debug)]
pub struct BandMatrix {
    size: usize,
    stride: usize,
    rows: Vec<f64>,
}

/// Factors of a band matrix: U of A = U^T D^-1 U, where D is the diagonal of U.
#[derive(Debug)]
pub struct BandFactors(BandMatrix);

impl BandMatrix {
    /// Creates a matrix of zeros for entries up to `band` columns from the diagonal.
    pub fn new(size: usize, band: usize) -> Self {
        // A block's last row reaches BLOCK - 1 columns beyond its first. Extra rows with 1 on the diagonal fill the
        // last block.
        let stride = band + BLOCK;
        let mut rows = vec![0.0; size.next_multiple_of(BLOCK) * stride];
        rows[size * stride..].iter_mut().step_by(stride).for_each(|diagonal| *diagonal = 1.0);
        Self { size, stride, rows }
    }

    /// Adds to an entry, which must be in the band. Entries below the diagonal are ignored: the matrix is symmetric.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        if column >= row {
            self.rows[row * self.stride + column - row] += value;
        }
    }

    /// Factorizes without exchanging rows. This is stable as long as displacements and pressures make the matrix
    /// quasi-definite. `None` if a pivot is zero or not finite.
    pub fn factorize(mut self) -> Option<BandFactors> {
        let mut done = None;
        simd_dispatch(
            #[inline(always)]
            || done = self.eliminate_rows(),
        );
        done.map(|()| BandFactors(self))
    }

    #[inline(always)]
    fn eliminate_rows(&mut self) -> Option<()> {
        let stride = self.stride;
        for first in (0..self.rows.len() / stride).step_by(BLOCK) {
            let (block, below) = self.rows[first * stride..].split_at_mut(BLOCK * stride);
            for pivot in 0..BLOCK {
                let (head, tail) = block.split_at_mut((pivot + 1) * stride);
                let head = &head[pivot * stride..];
                if !(head[0].abs() > 1e-14 && head[0].is_finite()) {
                    return None;
                }
                for (k, row) in tail.chunks_exact_mut(stride).enumerate() {
                    let along = &head[k + 1..];
                    let factor = along[0] / head[0];
                    for (to, from) in row.iter_mut().zip(along) {
                        *to -= factor * from;
                    }
                }
            }
            eliminate_block(block, below, stride);
        }
        Some(())
    }
}

/// Subtracts the rows of a block from all rows below that the band reaches.
#[inline(always)]
fn eliminate_block(block: &[f64], below: &mut [f64], stride: usize) {
    let row = |k: usize| &block[k * stride..][..stride];
    let [a, b, c, d] = [row(0), row(1), row(2), row(3)];
    for (k, to) in below.chunks_exact_mut(stride).take(stride - BLOCK).enumerate() {
        let [a, b, c, d] = [&a[k + 4..], &b[k + 3..], &c[k + 2..], &d[k + 1..]];
        let factors = [a[0] / block[0], b[0] / block[stride], c[0] / block[2 * stride], d[0] / block[3 * stride]];
        if factors == [0.0; 4] {
            continue;
        }
        for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *to -= (factors[0] * a + factors[1] * b) + (factors[2] * c + factors[3] * d);
        }
    }
}

impl BandFactors {
    /// Solves for a right-hand side, which is overwritten.
    pub fn solve(&self, values: &mut [f64]) {
        let BandMatrix { size, stride, rows } = &self.0;
        let row = |k: usize| &rows[k * stride..][..*stride.min(&(size - k))];
        for k in 0..*size {
            let own = row(k);
            let factor = values[k] / own[0];
            for (to, from) in values[k + 1..].iter_mut().zip(&own[1..]) {
                *to -= factor * from;
            }
        }
        for k in (0..*size).rev() {
            let own = row(k);
            let sum: f64 = own[1..].iter().zip(&values[k + 1..]).map(|(a, x)| a * x).sum();
            values[k] = (values[k] - sum) / own[0];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solution_times_the_matrix_is_the_right_hand_side() {
        for (size, band) in [(1, 0), (7, 2), (30, 9), (41, 13)] {
            let entry = |row: usize, column: usize| {
                let (low, high) = (row.min(column), row.max(column));
                match high - low {
                    // Saddle points: every third unknown has a negative diagonal.
                    0 => {
                        if low % 3 == 2 {
                            -3.0
                        } else {
                            20.0
                        }
                    }
                    apart if apart <= band => ((low * 7 + high * 3) % 11) as f64 / 11.0 - 0.4,
                    _ => 0.0,
                }
            };
            let mut matrix = BandMatrix::new(size, band);
            for row in 0..size {
                for column in row.saturating_sub(band)..size.min(row + band + 1) {
                    matrix.add(row, column, entry(row, column));
                }
            }
            let expected: Vec<f64> = (0..size).map(|k| (k as f64 * 0.7).sin()).collect();
            let times = |row: usize| (0..size).map(|column| entry(row, column) * expected[column]).sum::<f64>();
            let mut values: Vec<f64> = (0..size).map(times).collect();
            matrix.factorize().expect("pivots").solve(&mut values);
            for (value, expected) in values.iter().zip(&expected) {
                assert!((value - expected).abs() < 1e-11, "{size} {band}: {value} for {expected}");
            }
        }
    }

    #[test]
    fn a_singular_matrix_has_no_factors() {
        let mut matrix = BandMatrix::new(2, 1);
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            matrix.add(row, column, 1.0);
        }
        assert!(matrix.factorize().is_none());
    }
}
