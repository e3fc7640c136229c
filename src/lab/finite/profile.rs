//! The section of a rigid body of revolution: a smooth curve, and how far points are from it.

/// Between two control points of the curve, mm.
const STEP_MM: f64 = 0.01;

/// The lower side of a body of revolution in (r, z), its lowest point at z = 0, as a uniform cubic B-spline: normals
/// and curvatures are continuous.
#[derive(Clone, Debug)]
pub struct Profile {
    control: Vec<[f64; 2]>,
    /// Where the curve is at its knots.
    knots: Vec<[f64; 2]>,
    /// Heights of its lower side at equal distances from the axis outwards, and the distance.
    heights: Vec<f64>,
    pitch: f64,
}

/// Where a point is beside the body.
#[derive(Clone, Copy, Debug)]
pub struct Beside {
    /// Distance from its surface, negative inside.
    pub distance: f64,
    /// Outward normal of the surface there.
    pub normal: [f64; 2],
    /// Curvature of the line of this distance, positive around a ball.
    pub curvature: f64,
}

impl Profile {
    /// From heights at r = 0, `pitch`, 2 `pitch`, ..; `top` and higher is no object. Edges sharper than `rounding` get
    /// that radius.
    pub fn new(heights: &[f64], pitch: f64, rounding: f64, top: f64) -> Self {
        let lowest = heights.iter().copied().fold(top, f64::min);
        let heights: Vec<f64> = heights.iter().map(|z| (z - lowest).min(top)).chain([top]).collect();
        let heights = opened(&heights, (rounding / pitch).round() as usize, pitch);
        let corners: Vec<[f64; 2]> = heights.iter().enumerate().map(|(k, z)| [k as f64 * pitch, *z]).collect();
        let mut control = even(&corners);
        // The other side of the axis.
        let mirrored = [control[2], control[1]].map(|[r, z]| [-r, z]);
        control.splice(0..0, mirrored);
        let knots = control.windows(3).map(|p| std::array::from_fn(|c| (p[0][c] + 4.0 * p[1][c] + p[2][c]) / 6.0));
        Self { knots: knots.collect(), control, heights, pitch }
    }

    /// Height over the lowest point at a radius; that of no object beyond the body.
    pub fn height(&self, r: f64) -> f64 {
        let last = self.heights.len() - 1;
        let at = r / self.pitch;
        let whole = (at as usize).min(last);
        let share = at - whole as f64;
        let next = self.heights[(whole + 1).min(last)];
        self.heights[whole] + share.min(1.0) * (next - self.heights[whole])
    }

    /// The largest radius at which the body reaches below a height.
    pub fn radius_below(&self, height: f64) -> f64 {
        self.heights.iter().rposition(|z| *z < height).map_or(0.0, |last| last as f64 * self.pitch)
    }

    /// Points of the curve from the axis outwards with the tangent's angle and the curvature there.
    pub fn points(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2], f64)> + '_ {
        (1..self.control.len() - 2).map(|k| {
            let Place { at, along, bend } = self.place(k as f64);
            let speed = along[0].hypot(along[1]);
            (at, along.map(|v| v / speed), (along[0] * bend[1] - along[1] * bend[0]) / (speed * speed * speed))
        })
    }

    /// Where a point is beside the body.
    pub fn beside(&self, point: [f64; 2]) -> Beside {
        let squared = |at: &[f64; 2]| (at[0] - point[0]).powi(2) + (at[1] - point[1]).powi(2);
        let (mut nearest, mut least) = (0, f64::INFINITY);
        for (k, knot) in self.knots.iter().enumerate() {
            let here = squared(knot);
            if here < least {
                (nearest, least) = (k, here);
            }
        }
        // Newton's method for the foot of the perpendicular.
        let middle = (nearest + 1) as f64;
        let last = (self.control.len() - 2) as f64;
        let mut t = middle;
        for _ in 0..8 {
            let Place { at, along, bend } = self.place(t);
            let off = [at[0] - point[0], at[1] - point[1]];
            let slope = dot(along, along) + dot(off, bend);
            let by = dot(off, along) / if slope > 0.0 { slope } else { dot(along, along) };
            t = (t - by).clamp((middle - 1.0).max(1.0), (middle + 1.0).min(last));
            if by.abs() < 1e-12 {
                break;
            }
        }
        let Place { at, along, bend } = self.place(t);
        let speed = libm::sqrt(dot(along, along));
        let normal = [along[1] / speed, -along[0] / speed];
        let distance = dot([point[0] - at[0], point[1] - at[1]], normal);
        let curvature = (along[0] * bend[1] - along[1] * bend[0]) / (speed * speed * speed);
        Beside { distance, normal, curvature: curvature / (1.0 + curvature * distance).max(0.1) }
    }

    /// The curve at parameter `t` (control point k has its knot at t = k), and its first two derivatives.
    fn place(&self, t: f64) -> Place {
        let first = (t.floor() as usize).clamp(1, self.control.len() - 3);
        let u = t - first as f64;
        let v = 1.0 - u;
        let weights = [
            v * v * v / 6.0,
            (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0,
            (4.0 - 6.0 * v * v + 3.0 * v * v * v) / 6.0,
            u * u * u / 6.0,
        ];
        let slopes = [-v * v / 2.0, (3.0 * u - 4.0) * u / 2.0, -(3.0 * v - 4.0) * v / 2.0, u * u / 2.0];
        let bends = [v, 3.0 * u - 2.0, 3.0 * v - 2.0, u];
        let sum = |by: [f64; 4]| {
            let mut sum = [0.0; 2];
            for (point, by) in self.control[first - 1..].iter().zip(by) {
                sum = [sum[0] + by * point[0], sum[1] + by * point[1]];
            }
            sum
        };
        Place { at: sum(weights), along: sum(slopes), bend: sum(bends) }
    }
}

struct Place {
    at: [f64; 2],
    along: [f64; 2],
    bend: [f64; 2],
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// What a ball of `reach` samples can roll over from below without touching more: morphological opening of the body
/// above the heights.
fn opened(heights: &[f64], reach: usize, pitch: f64) -> Vec<f64> {
    let cap = |k: isize| pitch * libm::sqrt((reach * reach) as f64 - (k * k) as f64);
    let radius = reach as isize;
    let around =
        |at: usize| (-radius..=radius).map(move |k| (((at as isize + k).unsigned_abs()).min(heights.len() - 1), k));
    let within: Vec<f64> = (0..heights.len())
        .map(|at| around(at).map(|(place, k)| heights[place] + cap(k)).fold(f64::NEG_INFINITY, f64::max))
        .collect();
    (0..heights.len())
        .map(|at| around(at).map(|(place, k)| within[place] - cap(k)).fold(f64::INFINITY, f64::min))
        .collect()
}

/// Points along a polygon, equally far apart.
fn even(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut points = vec![corners[0]];
    let mut left = STEP_MM;
    for pair in corners.windows(2) {
        let by = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
        let length = by[0].hypot(by[1]);
        let mut at = left;
        while at <= length {
            points.push([pair[0][0] + by[0] * at / length, pair[0][1] + by[1] * at / length]);
            at += STEP_MM;
        }
        left = at - length;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_balls_profile_is_a_circle() {
        let (radius, pitch) = (2.0_f64, 0.005);
        let heights: Vec<f64> = (0..500)
            .map(|k| (radius * radius - (k as f64 * pitch).powi(2)).sqrt())
            .map(|z| if z > 0.0 { radius - z } else { 9.0 })
            .collect();
        let ball = Profile::new(&heights, pitch, 0.1, 3.0);
        for (r, z) in [(0.0, 0.1), (0.5, 0.0), (1.0, 0.2), (1.6, 0.7), (1.2, 0.401)] {
            let away = f64::hypot(r, z - radius);
            let beside = ball.beside([r, z]);
            assert!((beside.distance - (away - radius)).abs() < 3e-5, "{r} {z}: {beside:?}");
            assert!((beside.normal[0] - r / away).abs() < 2e-3, "{r} {z}: {beside:?}");
            assert!((beside.curvature - 1.0 / away).abs() < 0.05, "{r} {z}: {beside:?}");
        }
    }

    #[test]
    fn a_sharp_edge_is_rounded_and_a_wall_stays_where_it_is() {
        let (pitch, rounding) = (0.005, 0.2);
        let punch = Profile::new(&[0.0; 201], pitch, rounding, 2.0);
        // The corner of the fillet, seen from its centre.
        let [r, z] = [1.0 - rounding + 0.3, rounding - 0.3];
        let beside = punch.beside([r, z]);
        assert!((beside.distance - (0.3 * std::f64::consts::SQRT_2 - rounding)).abs() < 3e-3, "{beside:?}");
        assert!((beside.normal[0] - std::f64::consts::FRAC_1_SQRT_2).abs() < 0.01, "{beside:?}");
        assert!((punch.beside([1.1, 1.0]).distance - 0.1).abs() < 0.004);
        assert!((punch.beside([0.0, -0.3]).distance - 0.3).abs() < 1e-9);
        assert!(punch.beside([0.9, 1.0]).distance < -0.09);
    }
}
