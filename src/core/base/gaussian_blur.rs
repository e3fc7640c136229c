//! Gaussian blur of pictures and of light: of a lens that is out of focus, and of what stands around a point.
//!
//! The weights are those of the discrete Gaussian exp(-s^2) I_k(s^2) (Lindeberg 1990, "Scale-space for discrete
//! signals"): its variance is s^2 for every s. A sampled curve is too narrow below half a pixel, where most cameras
//! are. Valid up to a standard deviation of 100 px.

use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;

/// Largest standard deviation, px; larger ones are clamped to it.
const LARGEST_SIGMA_PX: f64 = 100.0;

/// Returns how far a blur reaches along its wider axis, px: four standard deviations.
pub fn reach_px(sigma_px: [f64; 2]) -> usize {
    axis_reach_px(sigma_px[0]).max(axis_reach_px(sigma_px[1]))
}

/// Blurs a difference image, known on the part `source` of a view and 0 outside it; returns the part `target`.
///
/// The result is 0 outside `source` [grown](Rect::grown) by [`reach_px`]. Standard deviations are along x and y; those
/// that are not above 0 change nothing.
pub fn blur_region(planes: &[Vec<f32>; 3], source: Rect, target: Rect, sigma_px: [f64; 2]) -> [Vec<f32>; 3] {
    convolve(planes, source, target, sigma_px, BorderMode::Zero)
}

/// Blurs entire pictures of `width` x `height` pixels; outside its edges a picture repeats them.
pub fn blur_whole(planes: &[Vec<f32>; 3], width: usize, height: usize, sigma_px: [f64; 2]) -> [Vec<f32>; 3] {
    let whole = Rect::whole(width, height);
    convolve(planes, whole, whole, sigma_px, BorderMode::Replicate)
}

/// Returns the fraction of the variance of white noise that a blur leaves: the sum of its squared weights. For the
/// discrete Gaussian, that is the middle weight of the kernel with twice the variance.
pub fn remaining_noise_variance(sigma_px: [f64; 2]) -> f64 {
    sigma_px.iter().map(|sigma| f64::from(kernel_weights(clamp_sigma(*sigma) * std::f64::consts::SQRT_2)[0])).product()
}

/// The values outside the part that is known.
#[derive(Clone, Copy)]
enum BorderMode {
    /// Zeros.
    Zero,
    /// The nearest known value.
    Replicate,
}

/// Clamps a standard deviation to what can be computed; what is not above 0 (NaN, too) becomes 0.
fn clamp_sigma(sigma_px: f64) -> f64 {
    if sigma_px > 0.0 { sigma_px.min(LARGEST_SIGMA_PX) } else { 0.0 }
}

fn axis_reach_px(sigma_px: f64) -> usize {
    libm::ceil(4.0 * clamp_sigma(sigma_px)) as usize
}

/// Computes one side of the kernel, from its middle on; the sum of both sides is 1.
fn kernel_weights(sigma_px: f64) -> Vec<f32> {
    let reach = axis_reach_px(sigma_px);
    let variance = clamp_sigma(sigma_px) * clamp_sigma(sigma_px);
    // The ratio of each weight to the one before it, by the recurrence of the Bessel functions. It runs from far
    // outside inwards, because the error of its first value dies away in this direction only.
    let mut ratios = vec![0.0; reach + 1];
    let mut ratio = 0.0;
    for k in (1..=2 * reach + 8).rev() {
        ratio = 1.0 / (2.0 * k as f64 / variance + ratio);
        if k <= reach {
            ratios[k] = ratio;
        }
    }
    let mut shape = vec![1.0; reach + 1];
    for k in 1..=reach {
        shape[k] = shape[k - 1] * ratios[k];
    }
    let sum = 2.0 * shape.iter().sum::<f64>() - 1.0;
    let mut weights: Vec<f32> = shape.iter().map(|weight| (weight / sum) as f32).collect();
    // What rounding lost goes to the middle weight, so that even light stays as it is.
    weights[0] = (1.0 - 2.0 * weights[1..].iter().map(|weight| f64::from(*weight)).sum::<f64>()) as f32;
    weights
}

/// Blurs planes that are known on `source`, and returns them on `target`.
fn convolve(
    planes: &[Vec<f32>; 3],
    source: Rect,
    target: Rect,
    sigma_px: [f64; 2],
    border_mode: BorderMode,
) -> [Vec<f32>; 3] {
    let mut blurred = [(); 3].map(|()| vec![0.0; target.area()]);
    if source.is_empty() || target.is_empty() {
        return blurred;
    }
    let [across, down] = sigma_px.map(kernel_weights);
    let mut rows = BlurredRows::new(source, target, across, border_mode, 2 * down.len() - 1);
    for (plane, blurred) in planes.iter().zip(&mut blurred) {
        simd_dispatch(
            #[inline(always)]
            || blur_columns(plane, &mut rows, target, &down, blurred),
        );
    }
    blurred
}

/// Blurs a plane along y; `rows` blurs its rows along x as they are needed.
#[inline(always)]
fn blur_columns(plane: &[f32], rows: &mut BlurredRows, target: Rect, weights: &[f32], out: &mut [f32]) {
    let reach = weights.len() - 1;
    let source = rows.source;
    let mut next = target.y0.saturating_sub(reach).clamp(source.y0, source.y1 - 1);
    for (y, out) in (target.y0..).zip(out.chunks_exact_mut(target.width())) {
        while next < (y + reach + 1).clamp(source.y0 + 1, source.y1) {
            rows.blur_row(plane, next);
            next += 1;
        }
        let sides: Vec<_> = (1..=reach).map(|k| [rows.row_at(y.checked_sub(k)), rows.row_at(Some(y + k))]).collect();
        sum_weighted_lines(weights, rows.row_at(Some(y)), &sides, out);
    }
}

/// Rows of the source, blurred along x, in the columns of the target: as many as the blur along y needs at a time.
struct BlurredRows {
    source: Rect,
    width: usize,
    weights: Vec<f32>,
    border_mode: BorderMode,
    /// A ring buffer: row `y` stands at `y` modulo the number of rows.
    blurred: Vec<f32>,
    /// A row of zeros.
    zeros: Vec<f32>,
    /// A row before it is blurred, with what reaches into the columns of the target.
    line: Vec<f32>,
    /// The values of `line` that are known; the first of them is column `skipped` of the source.
    known: std::ops::Range<usize>,
    skipped: usize,
}

impl BlurredRows {
    fn new(source: Rect, target: Rect, weights: Vec<f32>, border_mode: BorderMode, count: usize) -> Self {
        let (width, reach) = (target.width(), weights.len() - 1);
        let within = |column: usize| (column + reach).saturating_sub(target.x0).min(width + 2 * reach);
        Self {
            source,
            width,
            border_mode,
            blurred: vec![0.0; width * count],
            zeros: vec![0.0; width],
            line: vec![0.0; width + 2 * reach],
            known: within(source.x0)..within(source.x1),
            skipped: target.x0.saturating_sub(source.x0 + reach).min(source.width()),
            weights,
        }
    }

    #[inline(always)]
    fn blur_row(&mut self, plane: &[f32], y: usize) {
        let row = &plane[(y - self.source.y0) * self.source.width()..][..self.source.width()];
        if let BorderMode::Replicate = self.border_mode {
            self.line[..self.known.start].fill(row[0]);
            self.line[self.known.end..].fill(row[row.len() - 1]);
        }
        self.line[self.known.clone()].copy_from_slice(&row[self.skipped..][..self.known.len()]);
        let reach = self.weights.len() - 1;
        let shifted = |by: usize| &self.line[by..][..self.width];
        let sides: Vec<_> = (1..=reach).map(|k| [shifted(reach - k), shifted(reach + k)]).collect();
        let start = y * self.width % self.blurred.len();
        sum_weighted_lines(&self.weights, shifted(reach), &sides, &mut self.blurred[start..][..self.width]);
    }

    /// Returns row `y` of the view; `None` is a row above it.
    #[inline(always)]
    fn row_at(&self, y: Option<usize>) -> &[f32] {
        let nearest = y.unwrap_or(0).clamp(self.source.y0, self.source.y1 - 1);
        match self.border_mode {
            BorderMode::Zero if y != Some(nearest) => &self.zeros,
            _ => &self.blurred[nearest * self.width % self.blurred.len()..][..self.width],
        }
    }
}

/// Computes the weighted sum of a line and of the pairs of lines to its sides.
#[inline(always)]
fn sum_weighted_lines(weights: &[f32], middle: &[f32], sides: &[[&[f32]; 2]], out: &mut [f32]) {
    for (sum, middle) in out.iter_mut().zip(middle) {
        *sum = weights[0] * middle;
    }
    // Sums stay in memory: the compiler would keep those of a block as single numbers.
    for (weight, [before, after]) in weights[1..].iter().zip(sides) {
        for ((sum, before), after) in out.iter_mut().zip(*before).zip(*after) {
            *sum += weight * (before + after);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::simd::scalar_only;

    fn light(area: usize) -> [Vec<f32>; 3] {
        [1, 5, 11].map(|start| (start..start + area).map(|i| (i * 7919 % 1009) as f32 / 1009.0 - 0.3).collect())
    }

    fn bits(planes: &[Vec<f32>; 3]) -> Vec<u32> {
        planes.iter().flatten().map(|value| value.to_bits()).collect()
    }

    /// exp(-t) I_k(t) as the integral that defines it, cut at the reach and scaled to the sum 1.
    fn exact_weights(sigma: f64) -> Vec<f64> {
        let steps = 4000;
        let weight = |k: usize| {
            let angles = (0..steps).map(|i| std::f64::consts::PI * (f64::from(i) + 0.5) / f64::from(steps));
            let values = angles.map(|angle| (sigma * sigma * (angle.cos() - 1.0)).exp() * (k as f64 * angle).cos());
            values.sum::<f64>() / f64::from(steps)
        };
        let weights: Vec<f64> = (0..=axis_reach_px(sigma)).map(weight).collect();
        let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
        weights.iter().map(|weight| weight / sum).collect()
    }

    /// The double sum as written, in f64.
    fn oracle(plane: &[f32], source: Rect, target: Rect, sigma: [f64; 2], border_mode: BorderMode) -> Vec<f64> {
        let [across, down] = sigma.map(exact_weights);
        let value = |x: isize, y: isize| {
            let (column, row) = (x - source.x0 as isize, y - source.y0 as isize);
            let (last, bottom) = (source.width() as isize - 1, source.height() as isize - 1);
            let (near, level) = (column.clamp(0, last), row.clamp(0, bottom));
            let dark = matches!(border_mode, BorderMode::Zero) && (near, level) != (column, row);
            if dark { 0.0 } else { f64::from(plane[level as usize * source.width() + near as usize]) }
        };
        let sides = |weights: &[f64]| weights.len() as isize - 1;
        let mut sums = Vec::new();
        for (y, x) in (target.y0..target.y1).flat_map(|y| (target.x0..target.x1).map(move |x| (y as isize, x as isize)))
        {
            let mut sum = 0.0;
            for v in -sides(&down)..=sides(&down) {
                for u in -sides(&across)..=sides(&across) {
                    sum += down[v.unsigned_abs()] * across[u.unsigned_abs()] * value(x + u, y + v);
                }
            }
            sums.push(sum);
        }
        sums
    }

    #[test]
    fn weights_are_those_of_the_discrete_gaussian_and_have_its_variance() {
        for sigma in [1e-6, 0.05, 0.2, 0.3, 0.5, 0.77, 1.0, 2.0, 5.5, 20.0, 100.0] {
            let found = kernel_weights(sigma);
            for (k, (found, exact)) in found.iter().zip(exact_weights(sigma)).enumerate() {
                assert!((f64::from(*found) - exact).abs() < 2e-7, "{sigma} {k}: {found} {exact}");
            }
            let variance: f64 = found.iter().enumerate().map(|(k, w)| 2.0 * (k * k) as f64 * f64::from(*w)).sum();
            // What is cut off is missed most where the reach is a pixel or two.
            assert!((variance - sigma * sigma).abs() < 0.006 + 0.003 * sigma * sigma, "{sigma}: {variance}");
        }
    }

    #[test]
    fn blurring_agrees_with_the_double_sum() {
        let part = |x0, y0, x1, y1| Rect { x0, y0, x1, y1 };
        for (source, target) in [
            (part(20, 10, 61, 33), part(10, 0, 75, 50)),
            (part(20, 10, 61, 33), part(25, 12, 30, 14)),
            (part(3, 3, 4, 4), part(0, 0, 9, 7)),
            (part(0, 5, 1, 70), part(0, 0, 3, 80)),
            (part(10, 10, 20, 20), part(25, 5, 40, 9)),
            (part(30, 30, 40, 40), part(0, 25, 28, 50)),
            (part(0, 0, 3, 3), part(50, 50, 53, 53)),
        ] {
            for sigma in [[0.3, 0.3], [1.0, 1.3], [0.0, 2.0], [2.6, 0.0], [4.0, 1.0]] {
                let planes = light(source.area());
                for border_mode in [BorderMode::Zero, BorderMode::Replicate] {
                    let found = convolve(&planes, source, target, sigma, border_mode);
                    for (plane, found) in planes.iter().zip(&found) {
                        for (found, exact) in found.iter().zip(oracle(plane, source, target, sigma, border_mode)) {
                            let error = (f64::from(*found) - exact).abs();
                            assert!(error < 1e-6, "{source:?} {target:?} {sigma:?}: {found} {exact}");
                        }
                    }
                    assert_eq!(
                        bits(&found),
                        bits(&scalar_only(|| convolve(&planes, source, target, sigma, border_mode)))
                    );
                }
            }
        }
    }

    #[test]
    fn what_a_blur_leaves_of_white_noise_is_the_sum_of_its_squared_weights() {
        for sigma in [0.0, 0.2, 0.7, 1.5, 6.0] {
            let line = kernel_weights(sigma);
            let squares: f64 = line.iter().map(|weight| f64::from(weight * weight)).sum();
            let kept = 2.0 * squares - f64::from(line[0] * line[0]);
            // What is cut off of the spots is missed most where their reach is a pixel or two.
            assert!((remaining_noise_variance([sigma, 0.0]) - kept).abs() < 1e-3 * kept, "{sigma}");
            assert!((remaining_noise_variance([sigma; 2]) - kept * kept).abs() < 2e-3 * kept * kept, "{sigma}");
        }
    }

    #[test]
    fn even_light_stays_even_and_no_light_is_lost() {
        for (width, height) in [(1, 1), (1, 640), (640, 1), (70, 33)] {
            for sigma in [0.0, 1e-9, 0.4, 1.0, 20.0, 1e9] {
                let even = blur_whole(&[(); 3].map(|()| vec![0.7; width * height]), width, height, [sigma; 2]);
                assert!(even.iter().flatten().all(|value| (value - 0.7).abs() < 1e-6), "{width} {height} {sigma}");
            }
        }
        let (source, sigma) = (Rect { x0: 100, y0: 90, x1: 140, y1: 101 }, [3.0, 1.7]);
        let target = source.grown(reach_px(sigma), 300, 300);
        let planes = light(source.area());
        let sum = |plane: &Vec<f32>| plane.iter().map(|value| f64::from(*value)).sum::<f64>();
        for (before, after) in planes.iter().zip(&blur_region(&planes, source, target, sigma)) {
            assert!((sum(before) - sum(after)).abs() < 1e-4, "{} {}", sum(before), sum(after));
        }
    }

    #[test]
    fn nothing_arrives_beyond_the_reach_and_a_part_is_a_part_of_the_whole() {
        let (source, whole, sigma) = (Rect { x0: 40, y0: 30, x1: 52, y1: 37 }, Rect::whole(90, 70), [2.2, 0.9]);
        let planes = light(source.area());
        let near = source.grown(reach_px(sigma), 90, 70);
        let (all, part) = (blur_region(&planes, source, whole, sigma), blur_region(&planes, source, near, sigma));
        for (all, part) in all.into_iter().zip(part) {
            let mut pasted = crate::base::grid::Grid::<f32>::new(90, 70);
            pasted.paste(
                &crate::base::grid::Grid { width: near.width(), height: near.height(), data: part },
                near,
                whole,
            );
            assert_eq!(pasted.data, all);
        }
    }

    #[test]
    fn two_blurs_are_one_whose_variance_is_the_sum() {
        let planes = light(80 * 60);
        let twice = blur_whole(&blur_whole(&planes, 80, 60, [0.6, 0.3]), 80, 60, [0.8, 0.4]);
        let once = blur_whole(&planes, 80, 60, [1.0, 0.5]);
        for y in 8..52 {
            for x in 8..72 {
                assert!((twice[0][y * 80 + x] - once[0][y * 80 + x]).abs() < 5e-4);
            }
        }
    }

    #[test]
    fn no_spot_changes_no_bit_and_extremes_stay_finite() {
        let planes = light(37 * 11);
        for sigma in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY] {
            assert_eq!(bits(&blur_whole(&planes, 37, 11, [sigma; 2])), bits(&planes));
            assert_eq!(reach_px([sigma, 0.1]), 1);
        }
        for sigma in [f64::MIN_POSITIVE, 1e-30, 1e30, f64::INFINITY] {
            assert!(blur_whole(&planes, 37, 11, [sigma, 0.5]).iter().flatten().all(|value| value.is_finite()));
        }
        let (none, some) = (Rect::default(), Rect::whole(5, 4));
        let nothing = [vec![], vec![], vec![]];
        assert_eq!(blur_region(&nothing, none, some, [1.0; 2]), [(); 3].map(|()| vec![0.0; 20]));
        assert_eq!(blur_region(&light(20), some, none, [1.0; 2]), nothing);
        assert_eq!(blur_whole(&nothing, 0, 0, [1.0; 2]), nothing);
    }
}
