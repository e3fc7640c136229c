//! A lens out of focus: every point of light spread into a Gaussian spot.
//!
//! The weights are those of the discrete Gaussian exp(-s^2) I_k(s^2) (Lindeberg 1990, "Scale-space for discrete
//! signals"), because its variance is s^2 for every s: a sampled curve is too narrow below half a pixel, where most
//! cameras are. Valid for spots of up to 100 px; a real one is a disc with a soft rim, of the same variance.

use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;

/// Standard deviations above this are taken for it, px.
const LARGEST_SIGMA_PX: f64 = 100.0;

/// How far a spot reaches along the axis on which it is wider, px: four standard deviations.
pub fn reach_px(sigma_px: [f64; 2]) -> usize {
    reach(sigma_px[0]).max(reach(sigma_px[1]))
}

/// Blurs a difference image: given on the part `there` of a view and 0 outside it, wanted on the part `here`. `there`
/// [grown](Rect::grown) by [`reach_px`] holds all of the result. Standard deviations are along x and y; those that are
/// not above 0 change nothing.
pub fn blur(planes: &[Vec<f32>; 3], there: Rect, here: Rect, sigma_px: [f64; 2]) -> [Vec<f32>; 3] {
    spread(planes, there, here, sigma_px, Beyond::Dark)
}

/// Blurs whole pictures of `width` x `height` pixels, which go on beyond their edges like their edges.
pub fn blur_whole(planes: &[Vec<f32>; 3], width: usize, height: usize, sigma_px: [f64; 2]) -> [Vec<f32>; 3] {
    let whole = Rect::whole(width, height);
    spread(planes, whole, whole, sigma_px, Beyond::Edge)
}

/// Share of the variance of white noise that a blur leaves: the sum of its squared weights, which for the discrete
/// Gaussian is the middle weight of the one with twice the variance.
pub fn noise_kept(sigma_px: [f64; 2]) -> f64 {
    sigma_px.iter().map(|sigma| f64::from(weights(usable(*sigma) * std::f64::consts::SQRT_2)[0])).product()
}

/// What lies beyond the part that is given.
#[derive(Clone, Copy)]
enum Beyond {
    /// Nothing.
    Dark,
    /// The nearest value.
    Edge,
}

/// A standard deviation that can be worked with: 0 if it is not above 0.
fn usable(sigma_px: f64) -> f64 {
    if sigma_px > 0.0 { sigma_px.min(LARGEST_SIGMA_PX) } else { 0.0 }
}

fn reach(sigma_px: f64) -> usize {
    libm::ceil(4.0 * usable(sigma_px)) as usize
}

/// One side of the spot from its middle on; both sides add up to 1.
fn weights(sigma_px: f64) -> Vec<f32> {
    let reach = reach(sigma_px);
    let variance = usable(sigma_px) * usable(sigma_px);
    // Each weight over the one before it, from far out on inwards: what the start is off by dies away on the way.
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
    // What rounding took goes to the middle: even light stays as it is.
    weights[0] = (1.0 - 2.0 * weights[1..].iter().map(|weight| f64::from(*weight)).sum::<f64>()) as f32;
    weights
}

fn spread(planes: &[Vec<f32>; 3], there: Rect, here: Rect, sigma_px: [f64; 2], beyond: Beyond) -> [Vec<f32>; 3] {
    let mut blurred = [(); 3].map(|()| vec![0.0; here.area()]);
    if there.is_empty() || here.is_empty() {
        return blurred;
    }
    let [across, down] = sigma_px.map(weights);
    let mut rows = Rows::new(there, here, across, beyond, 2 * down.len() - 1);
    for (plane, blurred) in planes.iter().zip(&mut blurred) {
        simd_dispatch(
            #[inline(always)]
            || blur_columns(plane, &mut rows, here, &down, blurred),
        );
    }
    blurred
}

/// Blurs a plane along y, its rows along x before.
#[inline(always)]
fn blur_columns(plane: &[f32], rows: &mut Rows, here: Rect, weights: &[f32], out: &mut [f32]) {
    let reach = weights.len() - 1;
    let there = rows.there;
    let mut next = here.y0.saturating_sub(reach).clamp(there.y0, there.y1 - 1);
    for (y, out) in (here.y0..).zip(out.chunks_exact_mut(here.width())) {
        while next < (y + reach + 1).clamp(there.y0 + 1, there.y1) {
            rows.blur(plane, next);
            next += 1;
        }
        let sides: Vec<_> = (1..=reach).map(|k| [rows.at(y.checked_sub(k)), rows.at(Some(y + k))]).collect();
        sum(weights, rows.at(Some(y)), &sides, out);
    }
}

/// The rows of `there`, blurred along x, in the columns of `here`: as many as are needed at a time.
struct Rows {
    there: Rect,
    width: usize,
    weights: Vec<f32>,
    beyond: Beyond,
    /// Row `y` stands at `y` modulo their number.
    blurred: Vec<f32>,
    /// A row of nothing.
    dark: Vec<f32>,
    /// A row before it is blurred, with what reaches into the columns of `here`.
    line: Vec<f32>,
    /// Which of `line` are given; the first of them is column `skipped` of `there`.
    given: std::ops::Range<usize>,
    skipped: usize,
}

impl Rows {
    fn new(there: Rect, here: Rect, weights: Vec<f32>, beyond: Beyond, count: usize) -> Self {
        let (width, reach) = (here.width(), weights.len() - 1);
        let within = |column: usize| (column + reach).saturating_sub(here.x0).min(width + 2 * reach);
        Self {
            there,
            width,
            beyond,
            blurred: vec![0.0; width * count],
            dark: vec![0.0; width],
            line: vec![0.0; width + 2 * reach],
            given: within(there.x0)..within(there.x1),
            skipped: here.x0.saturating_sub(there.x0 + reach).min(there.width()),
            weights,
        }
    }

    #[inline(always)]
    fn blur(&mut self, plane: &[f32], y: usize) {
        let row = &plane[(y - self.there.y0) * self.there.width()..][..self.there.width()];
        if let Beyond::Edge = self.beyond {
            self.line[..self.given.start].fill(row[0]);
            self.line[self.given.end..].fill(row[row.len() - 1]);
        }
        self.line[self.given.clone()].copy_from_slice(&row[self.skipped..][..self.given.len()]);
        let reach = self.weights.len() - 1;
        let shifted = |by: usize| &self.line[by..][..self.width];
        let sides: Vec<_> = (1..=reach).map(|k| [shifted(reach - k), shifted(reach + k)]).collect();
        let start = y * self.width % self.blurred.len();
        sum(&self.weights, shifted(reach), &sides, &mut self.blurred[start..][..self.width]);
    }

    /// Row `y` of the view; none is one above it.
    #[inline(always)]
    fn at(&self, y: Option<usize>) -> &[f32] {
        let nearest = y.unwrap_or(0).clamp(self.there.y0, self.there.y1 - 1);
        match self.beyond {
            Beyond::Dark if y != Some(nearest) => &self.dark,
            _ => &self.blurred[nearest * self.width % self.blurred.len()..][..self.width],
        }
    }
}

/// Numbers that are summed at a time: they stay in registers.
const BLOCK: usize = 32;

/// The weighted sum of a line and of the pairs of lines to its sides.
#[inline(always)]
fn sum(weights: &[f32], middle: &[f32], sides: &[[&[f32]; 2]], out: &mut [f32]) {
    let whole = out.len() - out.len() % BLOCK;
    for start in (0..whole).step_by(BLOCK) {
        let mut sums: [f32; BLOCK] = std::array::from_fn(|i| weights[0] * middle[start + i]);
        for (weight, [before, after]) in weights[1..].iter().zip(sides) {
            let (before, after) = (&before[start..][..BLOCK], &after[start..][..BLOCK]);
            for i in 0..BLOCK {
                sums[i] += weight * (before[i] + after[i]);
            }
        }
        out[start..][..BLOCK].copy_from_slice(&sums);
    }
    let rest = &mut out[whole..];
    for (sum, middle) in rest.iter_mut().zip(&middle[whole..]) {
        *sum = weights[0] * middle;
    }
    for (weight, [before, after]) in weights[1..].iter().zip(sides) {
        for ((sum, before), after) in rest.iter_mut().zip(&before[whole..]).zip(&after[whole..]) {
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
        let weights: Vec<f64> = (0..=reach(sigma)).map(weight).collect();
        let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
        weights.iter().map(|weight| weight / sum).collect()
    }

    /// The double sum as written, in f64.
    fn oracle(plane: &[f32], there: Rect, here: Rect, sigma: [f64; 2], beyond: Beyond) -> Vec<f64> {
        let [across, down] = sigma.map(exact_weights);
        let value = |x: isize, y: isize| {
            let (column, row) = (x - there.x0 as isize, y - there.y0 as isize);
            let (last, bottom) = (there.width() as isize - 1, there.height() as isize - 1);
            let (near, level) = (column.clamp(0, last), row.clamp(0, bottom));
            let dark = matches!(beyond, Beyond::Dark) && (near, level) != (column, row);
            if dark { 0.0 } else { f64::from(plane[level as usize * there.width() + near as usize]) }
        };
        let sides = |weights: &[f64]| weights.len() as isize - 1;
        let mut sums = Vec::new();
        for (y, x) in (here.y0..here.y1).flat_map(|y| (here.x0..here.x1).map(move |x| (y as isize, x as isize))) {
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
            let found = weights(sigma);
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
        for (there, here) in [
            (part(20, 10, 61, 33), part(10, 0, 75, 50)),
            (part(20, 10, 61, 33), part(25, 12, 30, 14)),
            (part(3, 3, 4, 4), part(0, 0, 9, 7)),
            (part(0, 5, 1, 70), part(0, 0, 3, 80)),
            (part(10, 10, 20, 20), part(25, 5, 40, 9)),
            (part(30, 30, 40, 40), part(0, 25, 28, 50)),
            (part(0, 0, 3, 3), part(50, 50, 53, 53)),
        ] {
            for sigma in [[0.3, 0.3], [1.0, 1.3], [0.0, 2.0], [2.6, 0.0], [4.0, 1.0]] {
                let planes = light(there.area());
                for beyond in [Beyond::Dark, Beyond::Edge] {
                    let found = spread(&planes, there, here, sigma, beyond);
                    for (plane, found) in planes.iter().zip(&found) {
                        for (found, exact) in found.iter().zip(oracle(plane, there, here, sigma, beyond)) {
                            let error = (f64::from(*found) - exact).abs();
                            assert!(error < 1e-6, "{there:?} {here:?} {sigma:?}: {found} {exact}");
                        }
                    }
                    assert_eq!(bits(&found), bits(&scalar_only(|| spread(&planes, there, here, sigma, beyond))));
                }
            }
        }
    }

    #[test]
    fn what_a_blur_leaves_of_white_noise_is_the_sum_of_its_squared_weights() {
        for sigma in [0.0, 0.2, 0.7, 1.5, 6.0] {
            let line = weights(sigma);
            let squares: f64 = line.iter().map(|weight| f64::from(weight * weight)).sum();
            let kept = 2.0 * squares - f64::from(line[0] * line[0]);
            // What is cut off of the spots is missed most where their reach is a pixel or two.
            assert!((noise_kept([sigma, 0.0]) - kept).abs() < 1e-3 * kept, "{sigma}");
            assert!((noise_kept([sigma; 2]) - kept * kept).abs() < 2e-3 * kept * kept, "{sigma}");
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
        let (there, sigma) = (Rect { x0: 100, y0: 90, x1: 140, y1: 101 }, [3.0, 1.7]);
        let here = there.grown(reach_px(sigma), 300, 300);
        let planes = light(there.area());
        let sum = |plane: &Vec<f32>| plane.iter().map(|value| f64::from(*value)).sum::<f64>();
        for (before, after) in planes.iter().zip(&blur(&planes, there, here, sigma)) {
            assert!((sum(before) - sum(after)).abs() < 1e-4, "{} {}", sum(before), sum(after));
        }
    }

    #[test]
    fn nothing_arrives_beyond_the_reach_and_a_part_is_a_part_of_the_whole() {
        let (there, whole, sigma) = (Rect { x0: 40, y0: 30, x1: 52, y1: 37 }, Rect::whole(90, 70), [2.2, 0.9]);
        let planes = light(there.area());
        let near = there.grown(reach_px(sigma), 90, 70);
        let (all, part) = (blur(&planes, there, whole, sigma), blur(&planes, there, near, sigma));
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
        assert_eq!(blur(&nothing, none, some, [1.0; 2]), [(); 3].map(|()| vec![0.0; 20]));
        assert_eq!(blur(&light(20), some, none, [1.0; 2]), nothing);
        assert_eq!(blur_whole(&nothing, 0, 0, [1.0; 2]), nothing);
    }
}
