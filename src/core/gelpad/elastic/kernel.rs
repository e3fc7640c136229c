//! Displacement around one pressed pixel: the layer's response in space, for Young's modulus 1.
//!
//! Near the pixel the layer deforms like a half-space, whose response to a uniformly pressed rectangle is known in
//! closed form (Love 1929; Johnson 1985, equation 3.25). The shell's correction to it is smooth and depends only on the
//! distance: it is the Hankel transform of G(q) minus the half-space's G, one curve for each Poisson ratio. Where
//! pixels are as coarse as the pad is thick, the two nearly cancel; there the kernel is the sum of G over the grid's
//! frequencies.

use std::f64::consts::{PI, TAU};

use super::layer::ElasticLayer;
use crate::base::grid::Grid;

/// Distance up to which the kernel's curve is known, in thicknesses; displacements beyond it are below 1e-4 of those
/// next to the pixel.
const MAX_DISTANCE: f64 = 9.0;

/// Share of the reach over which the kernel fades to 0, so that displacements end without a step.
const FADE_SHARE: f64 = 0.2;

/// Width of a window, in reaches, above which the end of the kernel is corrected for the tail that is cut off.
const WIDE_WINDOW: f64 = 2.5;

/// Computes the displacement, mm, at lags from 0 up (columns along x, rows along y) from a pixel under pressure 1; from
/// `reach_mm` on it is 0. The image is as large as needed, at most `most_px`.
pub fn layer_kernel(layer: ElasticLayer, mm_per_px: [f64; 2], reach_mm: f64, most_px: [usize; 2]) -> Grid<f32> {
    kernel_with_curve(&CorrectionCurve::new(layer), mm_per_px, reach_mm, most_px, most_px)
}

/// Returns the number of lags of a kernel along each axis.
pub(super) fn lag_counts(layer: ElasticLayer, mm_per_px: [f64; 2], reach_mm: f64, most_px: [usize; 2]) -> [usize; 2] {
    let reach_mm = reach_mm.min(MAX_DISTANCE * layer.thickness_mm);
    std::array::from_fn(|k| ((reach_mm / mm_per_px[k]) as usize + 1).min(most_px[k]).max(1))
}

/// Computes the kernel like [`layer_kernel`], from a known curve, for windows of up to `window_px`.
pub(super) fn kernel_with_curve(
    curve: &CorrectionCurve,
    mm_per_px: [f64; 2],
    reach_mm: f64,
    window_px: [usize; 2],
    most_px: [usize; 2],
) -> Grid<f32> {
    let layer = curve.layer;
    let size = lag_counts(layer, mm_per_px, reach_mm, most_px);
    let reach_mm = reach_mm.min(MAX_DISTANCE * layer.thickness_mm);
    let coarse = mm_per_px[0].max(mm_per_px[1]) > 0.5 * layer.thickness_mm;
    let exact = if coarse { sum_frequencies(layer, mm_per_px, size) } else { sample_in_space(curve, mm_per_px, size) };
    // In a window not much wider than the reach, the kernel without the correction is more accurate.
    let wide = (0..2).any(|k| window_px[k] as f64 * mm_per_px[k] > WIDE_WINDOW * reach_mm);
    let ending = if wide && !coarse { TailCorrection::new(curve, reach_mm) } else { TailCorrection::NONE };
    let area = mm_per_px[0] * mm_per_px[1];
    let mut kernel = Grid::new(size[0], size[1]);
    for (y, row) in kernel.data.chunks_exact_mut(size[0]).enumerate() {
        for (x, value) in row.iter_mut().enumerate() {
            let share = plane_distance(x as f64 * mm_per_px[0], y as f64 * mm_per_px[1]) / reach_mm;
            // No fading at distance 0: a pixel may be wider than the reach.
            let faded = if x + y == 0 { 1.0 } else { fade_factor(share) };
            *value = (exact.at(x, y) * faded + area * ending.density_at(share)) as f32;
        }
    }
    kernel
}

/// Returns the kernel's factor at a share of the reach.
fn fade_factor(share: f64) -> f64 {
    let left = ((1.0 - share) / FADE_SHARE).clamp(0.0, 1.0);
    left * left * (3.0 - 2.0 * left)
}

/// The correction for the tail that is cut off, spread over the kernel's end, so that the sum of all lags and their
/// second moment are preserved. Wide contacts depend on nothing else of the tail, but on an incompressible pad they do
/// so strongly: without the correction, forces were too small by 60 % where the contact is 40 thicknesses wide.
struct TailCorrection([f64; 2]);

impl TailCorrection {
    const NONE: Self = Self([0.0; 2]);

    fn new(curve: &CorrectionCurve, reach_mm: f64) -> Self {
        let layer = curve.layer;
        let h = layer.thickness_mm;
        // Integrals over the plane of a function of the share of the reach (given per distance), and of it times the
        // share squared.
        let moments = |value: &dyn Fn(f64) -> f64| {
            gauss_points(0.0, 1.0, 400).fold([0.0; 2], |[plain, second], (share, weight)| {
                let value = weight * TAU * reach_mm * value(share);
                [plain + value, second + value * share * share]
            })
        };
        let kept = moments(&|share| {
            let r = share * reach_mm;
            fade_factor(share) * (layer.half_space_compliance() / TAU + r * curve.value_at(r / h) / h)
        });
        // G(q) = sum - q^2 / 4 second moment + ...
        let sum = layer.normal_compliance(0.0);
        let bend = |s: f64| (layer.normal_compliance(s / h) - sum) / (s * s) * h * h;
        let second = -4.0 * (4.0 * bend(0.02) - bend(0.04)) / 3.0;
        let missing = [sum - kept[0], second / (reach_mm * reach_mm) - kept[1]];
        let [a, b] = [0, 1].map(|k| moments(&|share| share * reach_mm * Self::bump_functions(share)[k]));
        let determinant = a[0] * b[1] - a[1] * b[0];
        Self([
            (missing[0] * b[1] - missing[1] * b[0]) / determinant,
            (missing[1] * a[0] - missing[0] * a[1]) / determinant,
        ])
    }

    /// Returns two smooth functions that are 0 up to 70 % of the reach and from its end on.
    fn bump_functions(share: f64) -> [f64; 2] {
        let x = ((share - 0.7) / 0.3).clamp(0.0, 1.0);
        let bump = x * x * (1.0 - x) * (1.0 - x);
        [bump, bump * x]
    }

    /// Returns the correction's density, mm per mm^2.
    fn density_at(&self, share: f64) -> f64 {
        let [a, b] = Self::bump_functions(share);
        self.0[0] * a + self.0[1] * b
    }
}

fn plane_distance(x: f64, y: f64) -> f64 {
    libm::sqrt(x * x + y * y)
}

fn sample_in_space(curve: &CorrectionCurve, mm_per_px: [f64; 2], size: [usize; 2]) -> Grid<f64> {
    let layer = curve.layer;
    let h = layer.thickness_mm;
    let area = mm_per_px[0] * mm_per_px[1];
    // Gauss points over which the smooth part is averaged in a pixel; for small pixels the centre is enough.
    let fine = mm_per_px[0].max(mm_per_px[1]) < h / 32.0;
    let points: &[(f64, f64)] = if fine { &[(0.0, 1.0)] } else { &GAUSS_3 };
    let smooth = |x: f64, y: f64| {
        let mut sum = 0.0;
        for (u, weight_x) in points {
            for (v, weight_y) in points {
                let distance = plane_distance(x + u * mm_per_px[0], y + v * mm_per_px[1]);
                sum += weight_x * weight_y * curve.value_at(distance / h);
            }
        }
        sum * area / h
    };
    let mut grid = Grid::new(size[0], size[1]);
    for (j, row) in grid.data.chunks_exact_mut(size[0]).enumerate() {
        for (i, value) in row.iter_mut().enumerate() {
            let (x, y) = (i as f64 * mm_per_px[0], j as f64 * mm_per_px[1]);
            if plane_distance(x, y) <= MAX_DISTANCE * h {
                *value = layer.half_space_compliance() / TAU * rectangle_potential(x, y, mm_per_px) + smooth(x, y);
            }
        }
    }
    grid
}

/// Computes the displacement at lags from 0 up from a pixel under pressure 1, for a half-space; `response` is its
/// displacement times frequency.
pub(super) fn half_space_kernel(response: f64, mm_per_px: [f64; 2], size: [usize; 2]) -> Grid<f32> {
    let mut grid = Grid::new(size[0], size[1]);
    for (j, row) in grid.data.chunks_exact_mut(size[0]).enumerate() {
        for (i, value) in row.iter_mut().enumerate() {
            let (x, y) = (i as f64 * mm_per_px[0], j as f64 * mm_per_px[1]);
            *value = (response / TAU * rectangle_potential(x, y, mm_per_px)) as f32;
        }
    }
    grid
}

/// Offsets (in pixels) and weights of the three-point Gauss rule.
const GAUSS_3: [(f64, f64); 3] =
    [(-0.387_298_334_620_741_7, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.387_298_334_620_741_7, 5.0 / 18.0)];

/// Returns the integral of 1 / distance over a rectangle of a pixel's size whose centre lies at (`x`, `y`).
fn rectangle_potential(x: f64, y: f64, mm_per_px: [f64; 2]) -> f64 {
    let [dx, dy] = mm_per_px;
    let r2 = x * x + y * y;
    if r2 > 400.0 * (dx * dx + dy * dy) {
        // Far away the closed form loses digits; the mean of 1 / r over a small rectangle does not.
        let bend = (dx * dx * (3.0 * x * x / r2 - 1.0) + dy * dy * (3.0 * y * y / r2 - 1.0)) / (24.0 * r2);
        return dx * dy / libm::sqrt(r2) * (1.0 + bend);
    }
    let corner = |x: f64, y: f64| {
        let along = |a: f64, b: f64| if a == 0.0 { 0.0 } else { a * libm::asinh(b / libm::fabs(a)) };
        along(x, y) + along(y, x)
    };
    let (left, right, above, below) = (x - dx / 2.0, x + dx / 2.0, y - dy / 2.0, y + dy / 2.0);
    corner(right, below) - corner(left, below) - corner(right, above) + corner(left, above)
}

/// The shell's correction to a half-space's displacement under unit force, times thickness, as a function of distance
/// over thickness.
pub(super) struct CorrectionCurve {
    pub layer: ElasticLayer,
    /// Values at multiples of [`TABLE_STEP`], from minus one step on, as the curve is even.
    values: Vec<f64>,
}

/// Distance between tabulated values, thicknesses; small enough for cubics to keep nine digits.
const TABLE_STEP: f64 = 1.0 / 256.0;

impl CorrectionCurve {
    pub(super) fn new(layer: ElasticLayer) -> Self {
        const TERMS: usize = 48;
        let h = layer.thickness_mm;
        // (G - half-space's G) q over s = q h; it has vanished at s = 24.
        let spectrum: Vec<(f64, f64)> = gauss_points(0.0, 24.0, 200)
            .map(|(s, weight)| {
                (s, weight * (s * layer.normal_compliance(s / h) / h - layer.half_space_compliance()) / TAU)
            })
            .collect();
        // The curve is analytic: its Chebyshev coefficients decrease by half with each term.
        let angle = |k: usize| PI * (k as f64 + 0.5) / TERMS as f64;
        let nodes: [f64; TERMS] = std::array::from_fn(|k| {
            let distance = MAX_DISTANCE * 0.5 * (libm::cos(angle(k)) + 1.0);
            spectrum.iter().map(|(s, value)| value * libm::j0(s * distance)).sum()
        });
        let coefficients: [f64; TERMS] = std::array::from_fn(|n| {
            let sum: f64 = (0..TERMS).map(|k| nodes[k] * libm::cos(n as f64 * angle(k))).sum();
            sum * if n == 0 { 1.0 } else { 2.0 } / TERMS as f64
        });
        let at = |distance: f64| {
            // Clenshaw's recurrence.
            let x = 2.0 * distance / MAX_DISTANCE - 1.0;
            let (mut next, mut after) = (0.0, 0.0);
            for coefficient in coefficients[1..].iter().rev() {
                (next, after) = (coefficient + 2.0 * x * next - after, next);
            }
            coefficients[0] + x * next - after
        };
        let count = (MAX_DISTANCE / TABLE_STEP) as i64 + 3;
        Self { layer, values: (-1..count).map(|k| at((k.abs() as f64 * TABLE_STEP).min(MAX_DISTANCE))).collect() }
    }

    /// Returns the value at a distance in thicknesses, 0 to [`MAX_DISTANCE`].
    pub(super) fn value_at(&self, distance: f64) -> f64 {
        let position = distance.min(MAX_DISTANCE) / TABLE_STEP;
        let first = position as usize;
        let t = position - first as f64;
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| self.values[first + k]);
        let (down, up) = (t * (t - 1.0), (t + 1.0) * (t - 2.0));
        down * (t + 1.0) / 6.0 * d - down * (t - 2.0) / 6.0 * a + up * ((t - 1.0) * b - t * c) / 2.0
    }
}

/// Returns points and weights of a four-point Gauss rule on each of `panels` equal parts of an interval.
fn gauss_points(from: f64, to: f64, panels: usize) -> impl Iterator<Item = (f64, f64)> {
    const RULE: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];
    let half = 0.5 * (to - from) / panels as f64;
    (0..panels).flat_map(move |panel| {
        let middle = from + half * (2 * panel + 1) as f64;
        RULE.map(|(node, weight)| (middle + half * node, half * weight))
    })
}

/// Computes the response to one pixel as a sum over the frequencies of the grid, each weighted by a pixel's share in
/// it. The torus is wide enough that the pixel does not meet its copies.
fn sum_frequencies(layer: ElasticLayer, mm_per_px: [f64; 2], size: [usize; 2]) -> Grid<f64> {
    let reach = |k: usize| (MAX_DISTANCE * layer.thickness_mm / mm_per_px[k]) as usize + 1;
    let torus: [usize; 2] = std::array::from_fn(|k| (2 * (size[k].min(reach(k)) + reach(k)) + 16).next_multiple_of(2));
    let frequency = |k: usize, n: usize| TAU * n as f64 / (torus[k] as f64 * mm_per_px[k]);
    let share = |k: usize, n: usize| {
        let half = 0.5 * frequency(k, n) * mm_per_px[k];
        // The lowest and the highest frequency have no mirror image.
        let count = if n == 0 || 2 * n == torus[k] { 1.0 } else { 2.0 };
        if n == 0 { count } else { count * libm::sin(half) / half }
    };
    // The phase of a frequency at a lag is always one of the torus's steps of a full turn.
    let turn = torus.map(|steps| (0..steps).map(|at| libm::cos(TAU * at as f64 / steps as f64)).collect::<Vec<_>>());
    let wave = |k: usize, n: usize, lag: usize| turn[k][(n * lag) % torus[k]];
    let (columns, rows) = (torus[0] / 2 + 1, torus[1] / 2 + 1);
    let mut along_y = Grid::<f64>::new(columns, size[1]);
    for n in 0..rows {
        for m in 0..columns {
            let q = plane_distance(frequency(0, m), frequency(1, n));
            let value = layer.normal_compliance(q) * share(0, m) * share(1, n) / (torus[0] * torus[1]) as f64;
            for y in 0..size[1] {
                along_y.row_mut(y)[m] += value * wave(1, n, y);
            }
        }
    }
    let mut grid = Grid::new(size[0], size[1]);
    for y in 0..size[1] {
        for x in 0..size[0] {
            grid.row_mut(y)[x] = (0..columns).map(|m| along_y.at(m, y) * wave(0, m, x)).sum();
        }
    }
    grid
}
