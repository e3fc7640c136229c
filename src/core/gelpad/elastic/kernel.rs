//! Displacement around one pressed pixel: the layer's response in space, for Young's modulus 1.
//!
//! Near the pixel the layer gives like a half-space, whose answer to a uniformly pressed rectangle is known in closed
//! form (Love 1929; Johnson 1985, equation 3.25). What the shell takes away from it is smooth and depends on the
//! distance only: the Hankel transform of G(q) minus the half-space's G, one curve for each Poisson ratio. Where pixels
//! are as coarse as the pad is thick the two cancel, and the kernel is the sum of G over the grid's frequencies
//! instead.

use std::f64::consts::{PI, TAU};

use super::layer::ElasticLayer;
use crate::base::grid::Grid;

/// Distance beyond which the kernel's curve is not known, in thicknesses; displacements there are below 1e-4 of those
/// next to the pixel.
const FARTHEST: f64 = 9.0;

/// Share of the reach over which the kernel fades to 0, so that displacements end without a step.
const FADE: f64 = 0.2;

/// Width of a window, in reaches, from which on the kernel's end stands for the tail that is cut off.
const WIDE: f64 = 2.5;

/// Displacement, mm, at lags from 0 up (columns along x, rows along y) from a pixel under pressure 1, and 0 from
/// `reach_mm` on. The image is as large as that needs, at most `most_px`.
pub fn kernel(layer: ElasticLayer, mm_per_px: [f64; 2], reach_mm: f64, most_px: [usize; 2]) -> Grid<f32> {
    kernel_by(&Curve::new(layer), mm_per_px, reach_mm, most_px, most_px)
}

/// How many lags a kernel has along each axis.
pub(super) fn lags(layer: ElasticLayer, mm_per_px: [f64; 2], reach_mm: f64, most_px: [usize; 2]) -> [usize; 2] {
    let reach_mm = reach_mm.min(FARTHEST * layer.thickness_mm);
    std::array::from_fn(|k| ((reach_mm / mm_per_px[k]) as usize + 1).min(most_px[k]).max(1))
}

/// The same as [`kernel`], of a curve that is known, for windows of up to `window_px`.
pub(super) fn kernel_by(
    curve: &Curve,
    mm_per_px: [f64; 2],
    reach_mm: f64,
    window_px: [usize; 2],
    most_px: [usize; 2],
) -> Grid<f32> {
    let layer = curve.layer;
    let size = lags(layer, mm_per_px, reach_mm, most_px);
    let reach_mm = reach_mm.min(FARTHEST * layer.thickness_mm);
    let coarse = mm_per_px[0].max(mm_per_px[1]) > 0.5 * layer.thickness_mm;
    let exact = if coarse { summed(layer, mm_per_px, size) } else { in_space(curve, mm_per_px, size) };
    // In a window that is not much wider than the reach, the kernel as it is does better.
    let wide = (0..2).any(|k| window_px[k] as f64 * mm_per_px[k] > WIDE * reach_mm);
    let ending = if wide && !coarse { Ending::new(curve, reach_mm) } else { Ending::NONE };
    let area = mm_per_px[0] * mm_per_px[1];
    let mut kernel = Grid::new(size[0], size[1]);
    for (y, row) in kernel.data.chunks_exact_mut(size[0]).enumerate() {
        for (x, value) in row.iter_mut().enumerate() {
            let share = length(x as f64 * mm_per_px[0], y as f64 * mm_per_px[1]) / reach_mm;
            // Without a distance there is no fading: one pixel may be wider than the reach.
            let faded = if x + y == 0 { 1.0 } else { fade(share) };
            *value = (exact.at(x, y) * faded + area * ending.at(share)) as f32;
        }
    }
    kernel
}

/// The factor at a share of the reach.
fn fade(share: f64) -> f64 {
    let left = ((1.0 - share) / FADE).clamp(0.0, 1.0);
    left * left * (3.0 - 2.0 * left)
}

/// What the kernel gets for the tail that is cut off, spread over its end: so that the sum of all lags and their
/// second moment stay as they were. Wide contacts feel nothing else of the tail, but those on an incompressible pad
/// feel it strongly: their forces were too small by 60 % where the contact is 40 thicknesses wide.
struct Ending([f64; 2]);

impl Ending {
    const NONE: Self = Self([0.0; 2]);

    fn new(curve: &Curve, reach_mm: f64) -> Self {
        let layer = curve.layer;
        let h = layer.thickness_mm;
        // Sums over the plane of a function of the share of the reach, per distance, and of that times the share squared.
        let moments = |value: &dyn Fn(f64) -> f64| {
            gauss(0.0, 1.0, 400).fold([0.0; 2], |[plain, second], (share, weight)| {
                let value = weight * TAU * reach_mm * value(share);
                [plain + value, second + value * share * share]
            })
        };
        let kept = moments(&|share| {
            let r = share * reach_mm;
            fade(share) * (layer.half_space() / TAU + r * curve.at(r / h) / h)
        });
        // G(q) = sum - q^2 / 4 second moment + ...
        let sum = layer.normal(0.0);
        let bend = |s: f64| (layer.normal(s / h) - sum) / (s * s) * h * h;
        let second = -4.0 * (4.0 * bend(0.02) - bend(0.04)) / 3.0;
        let missing = [sum - kept[0], second / (reach_mm * reach_mm) - kept[1]];
        let [a, b] = [0, 1].map(|k| moments(&|share| share * reach_mm * Self::shape(share)[k]));
        let determinant = a[0] * b[1] - a[1] * b[0];
        Self([
            (missing[0] * b[1] - missing[1] * b[0]) / determinant,
            (missing[1] * a[0] - missing[0] * a[1]) / determinant,
        ])
    }

    /// Two smooth functions, 0 up to 70 % of the reach and from its end on.
    fn shape(share: f64) -> [f64; 2] {
        let x = ((share - 0.7) / 0.3).clamp(0.0, 1.0);
        let bump = x * x * (1.0 - x) * (1.0 - x);
        [bump, bump * x]
    }

    /// mm per mm^2.
    fn at(&self, share: f64) -> f64 {
        let [a, b] = Self::shape(share);
        self.0[0] * a + self.0[1] * b
    }
}

fn length(x: f64, y: f64) -> f64 {
    libm::sqrt(x * x + y * y)
}

fn in_space(curve: &Curve, pitch: [f64; 2], size: [usize; 2]) -> Grid<f64> {
    let layer = curve.layer;
    let h = layer.thickness_mm;
    let area = pitch[0] * pitch[1];
    // Gauss points in which the smooth part is averaged over a pixel; for small pixels its middle is enough.
    let fine = pitch[0].max(pitch[1]) < h / 32.0;
    let points: &[(f64, f64)] = if fine { &[(0.0, 1.0)] } else { &GAUSS_3 };
    let smooth = |x: f64, y: f64| {
        let mut sum = 0.0;
        for (u, weight_x) in points {
            for (v, weight_y) in points {
                let distance = length(x + u * pitch[0], y + v * pitch[1]);
                sum += weight_x * weight_y * curve.at(distance / h);
            }
        }
        sum * area / h
    };
    let mut grid = Grid::new(size[0], size[1]);
    for (j, row) in grid.data.chunks_exact_mut(size[0]).enumerate() {
        for (i, value) in row.iter_mut().enumerate() {
            let (x, y) = (i as f64 * pitch[0], j as f64 * pitch[1]);
            if length(x, y) <= FARTHEST * h {
                *value = layer.half_space() / TAU * pressed_rectangle(x, y, pitch) + smooth(x, y);
            }
        }
    }
    grid
}

/// Displacement at lags from 0 up from a pixel under pressure 1, of a half-space whose response times frequency this is.
pub(super) fn half_space(response: f64, pitch: [f64; 2], size: [usize; 2]) -> Grid<f32> {
    let mut grid = Grid::new(size[0], size[1]);
    for (j, row) in grid.data.chunks_exact_mut(size[0]).enumerate() {
        for (i, value) in row.iter_mut().enumerate() {
            *value = (response / TAU * pressed_rectangle(i as f64 * pitch[0], j as f64 * pitch[1], pitch)) as f32;
        }
    }
    grid
}

/// Offsets in pixels and weights.
const GAUSS_3: [(f64, f64); 3] =
    [(-0.387_298_334_620_741_7, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.387_298_334_620_741_7, 5.0 / 18.0)];

/// The integral of 1 / distance over a rectangle of size `pitch` whose centre lies at (`x`, `y`).
fn pressed_rectangle(x: f64, y: f64, pitch: [f64; 2]) -> f64 {
    let [dx, dy] = pitch;
    let r2 = x * x + y * y;
    if r2 > 400.0 * (dx * dx + dy * dy) {
        // The closed form loses digits far away; the mean of 1 / r over a small rectangle does not.
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

/// What the shell takes from a half-space's displacement under unit force, times thickness, over distance / thickness.
pub(super) struct Curve {
    pub layer: ElasticLayer,
    /// At every [`STEP`] from minus one step on: the curve is even.
    values: Vec<f64>,
}

/// Distance between tabulated values, thicknesses: fine enough for cubics to keep nine digits.
const STEP: f64 = 1.0 / 256.0;

impl Curve {
    pub(super) fn new(layer: ElasticLayer) -> Self {
        const TERMS: usize = 48;
        let h = layer.thickness_mm;
        // (G - half-space) q over s = q h: gone beyond s = 24.
        let spectrum: Vec<(f64, f64)> = gauss(0.0, 24.0, 200)
            .map(|(s, weight)| (s, weight * (s * layer.normal(s / h) / h - layer.half_space()) / TAU))
            .collect();
        // The curve is analytic: its Chebyshev coefficients fall by half with each term.
        let angle = |k: usize| PI * (k as f64 + 0.5) / TERMS as f64;
        let nodes: [f64; TERMS] = std::array::from_fn(|k| {
            let distance = FARTHEST * 0.5 * (libm::cos(angle(k)) + 1.0);
            spectrum.iter().map(|(s, value)| value * libm::j0(s * distance)).sum()
        });
        let coefficients: [f64; TERMS] = std::array::from_fn(|n| {
            let sum: f64 = (0..TERMS).map(|k| nodes[k] * libm::cos(n as f64 * angle(k))).sum();
            sum * if n == 0 { 1.0 } else { 2.0 } / TERMS as f64
        });
        let at = |distance: f64| {
            // Clenshaw's recurrence.
            let x = 2.0 * distance / FARTHEST - 1.0;
            let (mut next, mut after) = (0.0, 0.0);
            for coefficient in coefficients[1..].iter().rev() {
                (next, after) = (coefficient + 2.0 * x * next - after, next);
            }
            coefficients[0] + x * next - after
        };
        let count = (FARTHEST / STEP) as i64 + 3;
        Self { layer, values: (-1..count).map(|k| at((k.abs() as f64 * STEP).min(FARTHEST))).collect() }
    }

    /// At a distance in thicknesses, 0 to [`FARTHEST`].
    pub(super) fn at(&self, distance: f64) -> f64 {
        let position = distance.min(FARTHEST) / STEP;
        let first = position as usize;
        let t = position - first as f64;
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| self.values[first + k]);
        let (down, up) = (t * (t - 1.0), (t + 1.0) * (t - 2.0));
        down * (t + 1.0) / 6.0 * d - down * (t - 2.0) / 6.0 * a + up * ((t - 1.0) * b - t * c) / 2.0
    }
}

/// Points and weights of a four-point Gauss rule on each of `panels` equal parts of an interval.
fn gauss(from: f64, to: f64, panels: usize) -> impl Iterator<Item = (f64, f64)> {
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

/// The response to one pixel as a sum over the frequencies that the grid can carry, each weighted by a pixel's share in
/// it; on a torus wide enough that the pixel does not meet itself.
fn summed(layer: ElasticLayer, pitch: [f64; 2], size: [usize; 2]) -> Grid<f64> {
    let reach = |k: usize| (FARTHEST * layer.thickness_mm / pitch[k]) as usize + 1;
    let torus: [usize; 2] = std::array::from_fn(|k| (2 * (size[k].min(reach(k)) + reach(k)) + 16).next_multiple_of(2));
    let frequency = |k: usize, n: usize| TAU * n as f64 / (torus[k] as f64 * pitch[k]);
    let share = |k: usize, n: usize| {
        let half = 0.5 * frequency(k, n) * pitch[k];
        // The lowest and the highest frequency have no mirror image.
        let count = if n == 0 || 2 * n == torus[k] { 1.0 } else { 2.0 };
        if n == 0 { count } else { count * libm::sin(half) / half }
    };
    // A frequency at a lag is one of so many steps of a turn.
    let turn = torus.map(|steps| (0..steps).map(|at| libm::cos(TAU * at as f64 / steps as f64)).collect::<Vec<_>>());
    let wave = |k: usize, n: usize, lag: usize| turn[k][(n * lag) % torus[k]];
    let (columns, rows) = (torus[0] / 2 + 1, torus[1] / 2 + 1);
    let mut along_y = Grid::<f64>::new(columns, size[1]);
    for n in 0..rows {
        for m in 0..columns {
            let q = length(frequency(0, m), frequency(1, n));
            let value = layer.normal(q) * share(0, m) * share(1, n) / (torus[0] * torus[1]) as f64;
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
