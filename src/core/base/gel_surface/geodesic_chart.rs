//! The chart of a gel that is a mesh: its geodesics from one point, sampled and interpolated smoothly.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::{FacetPoint, GelSurface};
use crate::base::site::SurfaceFrame;

/// Number of geodesics around a point; even, because each continues backwards as another one.
const RAYS: usize = 128;
/// Number of steps along a geodesic.
const STEPS: usize = 96;
/// Least area on the gel of 1 mm^2 of the chart; beyond it, geodesics soon cross.
const LEAST_AREA: f64 = 0.05;
/// Normals whose cosine is below this count as perpendicular.
const ACROSS_COSINE: f64 = 0.02;
/// Largest distance between a point of the gel and the chart point that is accepted for it, as a share of the reach.
const LOCATE_TOLERANCE: f64 = 1e-4;

/// A chart made of the geodesics from its centre.
#[derive(Clone, Debug)]
pub struct GeodesicChart {
    /// From the chart's axes to the sensor's: the third column is the gel's normal at the chart's centre.
    axes: DMat3,
    middle_mm: DVec3,
    step_mm: f64,
    /// Samples, ordered by step and then by geodesic.
    nodes: Vec<Node>,
    /// Distance to the rim along each geodesic, mm; infinite where the rim is not reached.
    rims_mm: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    point: DVec3,
    normal: DVec3,
    /// The chart's x direction, transported along the geodesic.
    x: DVec3,
    /// Area on the gel of 1 mm^2 of the chart.
    area_ratio: f64,
}

impl GeodesicChart {
    /// Makes the chart around the tip. Its x is the sensor's, brought to the tip's plane by the smallest rotation.
    pub(super) fn around_tip(surface: &GelSurface, reach_mm: f64) -> Self {
        let axes = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, surface.tip_normal()));
        Self::new(surface, surface.closest_facet_point(DVec3::ZERO), axes, reach_mm)
    }

    /// Makes the chart around the point closest to `to_mm`. Its x goes down the gel, away from the tip; where the gel
    /// is level it is the tip's.
    pub fn around_point(surface: &GelSurface, to_mm: DVec3, reach_mm: f64) -> Self {
        let spot = surface.closest_facet_point(to_mm);
        let (_, normal) = surface.smooth_point(spot);
        Self::new(surface, spot, axes_at(normal), reach_mm)
    }

    /// Makes the chart around the point closest to `to_mm`, with x as close as possible to `x`.
    pub fn with_x_axis(surface: &GelSurface, to_mm: DVec3, x: DVec3, reach_mm: f64) -> Self {
        let spot = surface.closest_facet_point(to_mm);
        let (_, normal) = surface.smooth_point(spot);
        let x = (x - normal * normal.dot(x)).normalize_or(normal.any_orthonormal_vector());
        Self::new(surface, spot, DMat3::from_cols(x, normal.cross(x), normal), reach_mm)
    }

    fn new(surface: &GelSurface, middle: FacetPoint, axes: DMat3, reach_mm: f64) -> Self {
        let step_mm = reach_mm / STEPS as f64;
        let angle = |ray: usize| TAU * ray as f64 / RAYS as f64;
        let mut ways = Vec::with_capacity(RAYS);
        let mut rims_mm = Vec::with_capacity(RAYS);
        for ray in 0..RAYS {
            let (sin, cos) = libm::sincos(angle(ray));
            let (way, rim_mm) = surface.trace_geodesic(middle, axes * DVec3::new(cos, sin, 0.0), step_mm, STEPS);
            ways.push(way);
            rims_mm.push(rim_mm.unwrap_or(f64::INFINITY));
        }
        let (middle_mm, _) = surface.smooth_point(middle);
        let mut nodes = Vec::with_capacity((STEPS + 1) * RAYS);
        for (step, ray) in (0..=STEPS).flat_map(|step| (0..RAYS).map(move |ray| (step, ray))) {
            let at = ways[ray][step];
            let (sin, cos) = libm::sincos(angle(ray));
            let beside = |by: usize| ways[(ray + by) % RAYS][step].point;
            // Distance between neighbouring geodesics per angle between them, by a fourth-order difference.
            let apart = (8.0 * (beside(1) - beside(RAYS - 1)) - (beside(2) - beside(RAYS - 2))) / (12.0 * angle(1));
            let across = at.normal.cross(at.towards);
            let area_ratio = if step == 0 { 1.0 } else { apart.dot(across) / (step as f64 * step_mm) };
            nodes.push(Node { point: at.point, normal: at.normal, x: cos * at.towards - sin * across, area_ratio });
        }
        Self { axes, middle_mm, step_mm, nodes, rims_mm }
    }

    /// Returns the rotation from the chart's axes to the sensor's.
    pub fn axes(&self) -> DMat3 {
        self.axes
    }

    /// Returns the chart's centre on the gel, mm.
    pub fn middle_mm(&self) -> DVec3 {
        self.middle_mm
    }

    /// Returns the chart's radius, mm.
    pub fn reach_mm(&self) -> f64 {
        self.step_mm * STEPS as f64
    }

    /// Returns the distance to the rim in a direction of the chart (rad, from x towards y), mm; infinite where the rim
    /// is not reached.
    pub fn rim_mm(&self, angle: f64) -> f64 {
        let (ray, share) = ray_of(angle);
        let [a, b] = [self.rims_mm[ray], self.rims_mm[(ray + 1) % RAYS]];
        if a.is_finite() && b.is_finite() { a + share * (b - a) } else { a.max(b) }
    }

    /// Returns points of the gel all over the chart, with their normals; the centre comes first.
    pub fn spread_points(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        const AROUND: usize = 8;
        const OUTWARDS: usize = 4;
        let place = |ray: usize, share: usize| {
            let end_mm = self.rims_mm[ray].min(self.reach_mm());
            let step = (end_mm / self.step_mm) as usize * share / OUTWARDS;
            let Node { point, normal, .. } = self.nodes[step * RAYS + ray];
            (point, normal)
        };
        let others = (1..OUTWARDS).flat_map(move |share| (0..AROUND).map(move |k| place(k * RAYS / AROUND, share)));
        std::iter::once(place(0, 0)).chain(others)
    }

    /// Returns the largest distance along x and y to where the normal is perpendicular to the centre's, and the
    /// distance to the farthest point of the rim, mm; `None` if the normal is perpendicular nowhere.
    pub fn quarter_and_end_mm(&self) -> Option<[f64; 2]> {
        let across = |ray: usize| {
            (1..=STEPS).find(|step| self.nodes[step * RAYS + ray].normal.dot(self.axes.z_axis) < ACROSS_COSINE)
        };
        let steps = (0..4).filter_map(|side| across(side * RAYS / 4)).max()?;
        let end_mm = self.rims_mm.iter().map(|rim_mm| rim_mm.min(self.reach_mm())).fold(0.0, f64::max);
        Some([steps as f64 * self.step_mm, end_mm])
    }

    /// Returns the smallest distance to the rim within a range of directions, and that direction, in mm and degrees.
    /// Where the rim is not reached, the distance is the chart's radius.
    pub fn least_rim_mm(&self, around_deg: std::ops::RangeInclusive<f64>) -> (f64, f64) {
        let (first, last) = (*around_deg.start(), around_deg.end().min(around_deg.start() + 360.0));
        let steps = libm::ceil(last - first) as usize;
        let angles = (0..=steps).map(|step| (first + step as f64).min(last));
        let rim = |deg: f64| (self.rim_mm(libm::remainder(deg.to_radians(), TAU)).min(self.reach_mm()), deg);
        angles.map(rim).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((self.reach_mm(), first))
    }

    /// Returns true if a point is on the chart, at most `over_mm` beyond the rim, and no geodesics have crossed before
    /// it.
    pub fn is_on_gel(&self, [u, v]: [f64; 2], over_mm: f64) -> bool {
        let away_mm = libm::hypot(u, v);
        away_mm <= self.reach_mm()
            && away_mm <= self.rim_mm(libm::atan2(v, u)) + over_mm
            && self.interpolate([u, v], |node| DVec3::new(node.area_ratio, 0.0, 0.0)).x > LEAST_AREA
    }

    /// Returns the gel at a point of the chart; outside the chart's radius, at its end.
    pub fn surface_frame(&self, at: [f64; 2]) -> SurfaceFrame {
        let stencil = self.interpolation_stencil(at);
        let [point, normal, x] = [
            self.weighted_sum(&stencil, |node| node.point),
            self.weighted_sum(&stencil, |node| node.normal),
            self.weighted_sum(&stencil, |node| node.x),
        ];
        let normal = normal.normalize_or(self.axes.z_axis);
        let x = (x - normal * normal.dot(x)).normalize_or(normal.any_orthonormal_vector());
        SurfaceFrame { normal, below_mm: 0.0, point_mm: point, tangents: [x, normal.cross(x)] }
    }

    /// Returns the area on the gel of 1 mm^2 of the chart.
    pub fn area_ratio(&self, at: [f64; 2]) -> f64 {
        self.interpolate(at, |node| DVec3::new(node.area_ratio, 0.0, 0.0)).x
    }

    /// Returns the chart's coordinates of a point of the gel; NaN if it is not on the chart.
    pub fn locate_point(&self, point_mm: DVec3) -> [f64; 2] {
        let off = point_mm - self.middle_mm;
        let flat = self.axes.transpose() * off;
        let first = DVec2::new(flat.x, flat.y).normalize_or_zero() * off.length();
        let within_mm = LOCATE_TOLERANCE * self.reach_mm();
        self.refine_location(first, point_mm, within_mm).unwrap_or_else(|| {
            // Newton's method failed from the projected point: start again from the closest sample.
            let distance = |node: &Node| node.point.distance_squared(point_mm);
            let samples = self.nodes.iter().enumerate().step_by(3);
            let closest = samples.min_by(|a, b| distance(a.1).total_cmp(&distance(b.1))).map_or(0, |(at, _)| at);
            let (sin, cos) = libm::sincos(TAU * (closest % RAYS) as f64 / RAYS as f64);
            let first = DVec2::new(cos, sin) * ((closest / RAYS) as f64 * self.step_mm);
            self.refine_location(first, point_mm, within_mm).unwrap_or([f64::NAN; 2])
        })
    }

    /// Finds the coordinates by Newton's method from a first guess; `None` if it does not converge to the point.
    fn refine_location(&self, first: DVec2, point_mm: DVec3, within_mm: f64) -> Option<[f64; 2]> {
        let mut at = first;
        for _ in 0..20 {
            let SurfaceFrame { point_mm: here, tangents: [x, y], .. } = self.surface_frame(at.to_array());
            let off = point_mm - here;
            let step = DVec2::new(x.dot(off), y.dot(off)).clamp_length_max(0.1 * self.reach_mm());
            if step.length() < 1e-3 * within_mm {
                return (off.length() < within_mm).then_some(at.to_array());
            }
            // Along the geodesic, lengths are right; across it, the chart is wider than the gel, so the step is scaled.
            let outwards = at.normalize_or(DVec2::X);
            let (along, across) = (step.dot(outwards), step.dot(outwards.perp()));
            let wider = self.area_ratio(at.to_array()).max(0.2);
            at += along * outwards + across / wider * outwards.perp();
        }
        None
    }

    fn interpolate(&self, at: [f64; 2], of: impl Fn(&Node) -> DVec3) -> DVec3 {
        self.weighted_sum(&self.interpolation_stencil(at), of)
    }

    fn weighted_sum(&self, stencil: &[(usize, f64); 16], of: impl Fn(&Node) -> DVec3) -> DVec3 {
        stencil.iter().map(|(node, share)| *share * of(&self.nodes[*node])).sum()
    }

    /// Returns the samples around a point and their weights: cubic along the geodesics and across them.
    fn interpolation_stencil(&self, [u, v]: [f64; 2]) -> [(usize, f64); 16] {
        let away = (libm::hypot(u, v) / self.step_mm).min(STEPS as f64);
        let (ray, turn) = ray_of(libm::atan2(v, u));
        let step = (away as usize).min(STEPS - 2);
        let (outwards, around) = (lagrange_cubic(away - step as f64), lagrange_cubic(turn));
        std::array::from_fn(|number| {
            let (k, j) = (number / 4, number % 4);
            let ray = ray + RAYS + j - 1;
            // Behind the centre, a geodesic continues as the one on the opposite side.
            let (step, ray) = if step + k == 0 { (1, ray + RAYS / 2) } else { (step + k - 1, ray) };
            (step * RAYS + ray % RAYS, outwards[k] * around[j])
        })
    }
}

/// Returns the axes of a chart whose centre has this normal.
fn axes_at(normal: DVec3) -> DMat3 {
    let down = DVec3::NEG_Z + normal * normal.z;
    if down.length() > 1e-6 {
        let x = down.normalize();
        DMat3::from_cols(x, normal.cross(x), normal)
    } else {
        DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, normal))
    }
}

/// Returns the geodesic before an angle, and how far the angle lies towards the next one, 0 to 1.
fn ray_of(angle: f64) -> (usize, f64) {
    let place = (angle / TAU + if angle < 0.0 { 1.0 } else { 0.0 }) * RAYS as f64;
    let ray = (place as usize).min(RAYS - 1);
    (ray, place - ray as f64)
}

/// Returns the weights of four equally spaced values at the position `t`, 0 to 1, between the second and the third one:
/// Lagrange's cubic.
fn lagrange_cubic(t: f64) -> [f64; 4] {
    let (a, b, c) = (t + 1.0, t - 1.0, t - 2.0);
    [-t * b * c / 6.0, a * b * c / 2.0, -a * t * c / 2.0, a * t * b / 6.0]
}
