//! Frictionless contact solved in f64 with dense matrices: slow and plain.

use gelsim_core::base::grid::Grid;

/// Solves a dense symmetric positive system by Cholesky's method.
pub fn solved(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for k in 0..n {
        let (done, rest) = matrix.split_at_mut(k);
        let row = &mut rest[0];
        for (j, above) in done.iter().enumerate() {
            let sum: f64 = (0..j).map(|i| row[i] * above[i]).sum();
            row[j] = (row[j] - sum) / above[j];
        }
        let square = row[k] - row[..k].iter().map(|value| value * value).sum::<f64>();
        assert!(square > 0.0, "the response is positive definite");
        row[k] = square.sqrt();
        right[k] = (right[k] - (0..k).map(|i| row[i] * right[i]).sum::<f64>()) / row[k];
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|i| matrix[i][k] * right[i]).sum();
        right[k] = (right[k] - sum) / matrix[k][k];
    }
    right
}

/// Pressures for E = 1 and displacements that fulfil the conditions of contact to 1e-12 mm at all pixels: the set of
/// those in contact is guessed, solved for, and mended until nothing is left to mend. Each pixel gives way by its own number of
/// mm under pressure 1, beside what the pad does.
pub fn dense_contact_on_springs(
    penetration: &Grid<f64>,
    springs: &[f64],
    response: impl Fn(usize, usize) -> f64,
) -> (Vec<f64>, Vec<f64>) {
    let (width, count) = (penetration.width, penetration.data.len());
    let lags: Vec<f64> = (0..count).map(|at| response(at % width, at / width)).collect();
    let between = |a: usize, b: usize| lags[(a / width).abs_diff(b / width) * width + (a % width).abs_diff(b % width)];
    let mut touching: Vec<bool> = penetration.data.iter().map(|g| *g > 0.0).collect();
    for _ in 0..200 {
        let inside: Vec<usize> = (0..count).filter(|at| touching[*at]).collect();
        let spring = |a: usize, b: usize| if a == b { springs[a] } else { 0.0 };
        let row = |a: &usize| inside.iter().map(|b| between(*a, *b) + spring(*a, *b)).collect();
        let matrix = inside.iter().map(row).collect();
        let found = solved(matrix, inside.iter().map(|at| penetration.data[*at]).collect());
        let mut pressure = vec![0.0; count];
        inside.iter().zip(&found).for_each(|(at, p)| pressure[*at] = *p);
        let displacement: Vec<f64> =
            (0..count).map(|a| inside.iter().map(|b| between(a, *b) * pressure[*b]).sum()).collect();
        let mut mended = false;
        for at in 0..count {
            let wrong = if touching[at] { pressure[at] < 0.0 } else { penetration.data[at] - displacement[at] > 1e-12 };
            touching[at] ^= wrong;
            mended |= wrong;
        }
        if !mended {
            return (pressure, displacement);
        }
    }
    panic!("the set of pixels in contact was not found");
}
