//! The section of a rigid body of revolution: a smooth curve, and distances of points from it.

/// Distance of the curve's control points, mm.
const STEP_MM: f64 = 0.01;

/// Lower side of a body of revolution in (r, z), with its lowest point at z = 0. A uniform cubic B-spline, so that
/// normals and curvatures are continuous.
#[derive(Clone, Debug)]
pub struct Profile {
    control: Vec<[f64; 2]>,
    /// Points of the curve at its knots.
    knots: Vec<[f64; 2]>,
    /// Heights of the lower side at equal distances from the axis outwards.
    heights: Vec<f64>,
    spacing: f64,
}

/// Position of a point relative to the body.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceDistance {
    /// Distance from its surface, negative inside.
    pub distance: f64,
    /// Outward normal of the surface there.
    pub normal: [f64; 2],
    /// Curvature of the curve of equal distance through the point, positive around a ball.
    pub curvature: f64,
}

impl Profile {
    /// Builds the profile from heights at r = 0, `spacing`, 2 `spacing`, .., mm. From `top` up there is no object.
    /// Edges sharper than the radius `rounding` are rounded to it.
    pub fn new(heights: &[f64], spacing: f64, rounding: f64, top: f64) -> Self {
        let lowest = heights.iter().copied().fold(top, f64::min);
        let heights: Vec<f64> = heights.iter().map(|z| (z - lowest).min(top)).chain([top]).collect();
        let heights = open_heights(&heights, (rounding / spacing).round() as usize, spacing);
        let corners: Vec<[f64; 2]> = heights.iter().enumerate().map(|(k, z)| [k as f64 * spacing, *z]).collect();
        let mut control = resample_evenly(&corners);
        // Mirror images across the axis make the curve level there.
        let mirrored = [control[2], control[1]].map(|[r, z]| [-r, z]);
        control.splice(0..0, mirrored);
        let knots = control.windows(3).map(|p| std::array::from_fn(|c| (p[0][c] + 4.0 * p[1][c] + p[2][c]) / 6.0));
        Self { knots: knots.collect(), control, heights, spacing }
    }

    /// Height over the lowest point at a radius, mm; outside the body that of no object.
    pub fn height_at(&self, r: f64) -> f64 {
        let last = self.heights.len() - 1;
        let at = r / self.spacing;
        let index = (at as usize).min(last);
        let share = at - index as f64;
        let next = self.heights[(index + 1).min(last)];
        self.heights[index] + share.min(1.0) * (next - self.heights[index])
    }

    /// Largest radius at which the body reaches below a height, mm.
    pub fn radius_below(&self, height: f64) -> f64 {
        self.heights.iter().rposition(|z| *z < height).map_or(0.0, |last| last as f64 * self.spacing)
    }

    /// Points of the curve from the axis outwards, with the unit tangent and the curvature at each.
    pub fn curve_points(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2], f64)> + '_ {
        (1..self.control.len() - 2).map(|k| {
            let CurvePoint { position: at, tangent: along, second_derivative: bend } = self.curve_at(k as f64);
            let speed = along[0].hypot(along[1]);
            (at, along.map(|v| v / speed), (along[0] * bend[1] - along[1] * bend[0]) / (speed * speed * speed))
        })
    }

    /// Measures where a point is relative to the body.
    pub fn measure_distance(&self, point: [f64; 2]) -> SurfaceDistance {
        let squared = |at: &[f64; 2]| (at[0] - point[0]).powi(2) + (at[1] - point[1]).powi(2);
        let (mut nearest, mut least) = (0, f64::INFINITY);
        for (k, knot) in self.knots.iter().enumerate() {
            let here = squared(knot);
            if here < least {
                (nearest, least) = (k, here);
            }
        }
        // Newton's method for the foot of the perpendicular, from the nearest knot and within a knot of it.
        let middle = (nearest + 1) as f64;
        let last = (self.control.len() - 2) as f64;
        let mut t = middle;
        for _ in 0..8 {
            let CurvePoint { position: at, tangent: along, second_derivative: bend } = self.curve_at(t);
            let off = [at[0] - point[0], at[1] - point[1]];
            let slope = dot(along, along) + dot(off, bend);
            // Where the squared distance is not convex Newton's step would go uphill: use the tangent's part alone.
            let by = dot(off, along) / if slope > 0.0 { slope } else { dot(along, along) };
            t = (t - by).clamp((middle - 1.0).max(1.0), (middle + 1.0).min(last));
            if by.abs() < 1e-12 {
                break;
            }
        }
        let CurvePoint { position: at, tangent: along, second_derivative: bend } = self.curve_at(t);
        let speed = libm::sqrt(dot(along, along));
        let normal = [along[1] / speed, -along[0] / speed];
        let distance = dot([point[0] - at[0], point[1] - at[1]], normal);
        let curvature = (along[0] * bend[1] - along[1] * bend[0]) / (speed * speed * speed);
        // Clamped, because the offset curve degenerates near the centre of curvature.
        SurfaceDistance { distance, normal, curvature: curvature / (1.0 + curvature * distance).max(0.1) }
    }

    /// Point of the curve at parameter `t` (control point k has its knot at t = k), with its first two derivatives.
    fn curve_at(&self, t: f64) -> CurvePoint {
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
        CurvePoint { position: sum(weights), tangent: sum(slopes), second_derivative: sum(bends) }
    }
}

struct CurvePoint {
    position: [f64; 2],
    tangent: [f64; 2],
    second_derivative: [f64; 2],
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Opens the body above the heights with a ball of `reach` samples (morphological opening): what remains is what the
/// ball can roll over from below.
fn open_heights(heights: &[f64], reach: usize, spacing: f64) -> Vec<f64> {
    let cap = |k: isize| spacing * libm::sqrt((reach * reach) as f64 - (k * k) as f64);
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

/// Returns points along a polygon at equal distances.
fn resample_evenly(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
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
            let beside = ball.measure_distance([r, z]);
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
        let beside = punch.measure_distance([r, z]);
        assert!((beside.distance - (0.3 * std::f64::consts::SQRT_2 - rounding)).abs() < 3e-3, "{beside:?}");
        assert!((beside.normal[0] - std::f64::consts::FRAC_1_SQRT_2).abs() < 0.01, "{beside:?}");
        assert!((punch.measure_distance([1.1, 1.0]).distance - 0.1).abs() < 0.004);
        assert!((punch.measure_distance([0.0, -0.3]).distance - 0.3).abs() < 1e-9);
        assert!(punch.measure_distance([0.9, 1.0]).distance < -0.09);
    }
}
