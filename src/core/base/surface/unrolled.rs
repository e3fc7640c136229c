//! A chart of a gel that is a mesh: its geodesics from one point, sampled, and smooth between the samples.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::{Spot, Surface};
use crate::base::site::Rest;

/// Geodesics around a point, an even number: each goes on backwards as another one.
const RAYS: usize = 128;
/// Samples on a geodesic.
const STEPS: usize = 96;
/// Least area on the gel of a mm^2 of the chart: beyond, geodesics soon cross.
const LEAST_AREA: f64 = 0.05;
/// Cosine of an angle that is next to a right one.
const ACROSS: f64 = 0.02;
/// How far from a point of the gel a place on the chart may be that is taken for it, as a share of the reach.
const OFF: f64 = 1e-4;

/// Geodesics from the middle of a chart.
#[derive(Clone, Debug)]
pub struct Unrolled {
    /// From the chart's axes to the sensor's: the third is the gel's normal in the middle.
    axes: DMat3,
    middle_mm: DVec3,
    step_mm: f64,
    /// Of each step, of each geodesic.
    nodes: Vec<Node>,
    /// How far it is to the rim along each geodesic; infinite where it is not reached.
    rims_mm: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    point: DVec3,
    normal: DVec3,
    /// The chart's x, taken along.
    x: DVec3,
    /// Area on the gel of a mm^2 of the chart.
    area: f64,
}

impl Unrolled {
    /// Around the tip; x is the sensor's, taken to the tip's plane without a turn.
    pub(super) fn around_tip(surface: &Surface, reach_mm: f64) -> Self {
        let axes = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, surface.tip_normal()));
        Self::new(surface, surface.closest(DVec3::ZERO), axes, reach_mm)
    }

    /// Around the point closest to a place; x goes away from the tip, down the gel, or is the tip's where the gel is level.
    pub fn around(surface: &Surface, to_mm: DVec3, reach_mm: f64) -> Self {
        let spot = surface.closest(to_mm);
        let (_, normal) = surface.smooth(spot);
        Self::new(surface, spot, axes_at(normal), reach_mm)
    }

    fn new(surface: &Surface, middle: Spot, axes: DMat3, reach_mm: f64) -> Self {
        let step_mm = reach_mm / STEPS as f64;
        let angle = |ray: usize| TAU * ray as f64 / RAYS as f64;
        let mut ways = Vec::with_capacity(RAYS);
        let mut rims_mm = Vec::with_capacity(RAYS);
        for ray in 0..RAYS {
            let (sin, cos) = libm::sincos(angle(ray));
            let (way, rim_mm) = surface.geodesic(middle, axes * DVec3::new(cos, sin, 0.0), step_mm, STEPS);
            ways.push(way);
            rims_mm.push(rim_mm.unwrap_or(f64::INFINITY));
        }
        let (middle_mm, _) = surface.smooth(middle);
        let mut nodes = Vec::with_capacity((STEPS + 1) * RAYS);
        for (step, ray) in (0..=STEPS).flat_map(|step| (0..RAYS).map(move |ray| (step, ray))) {
            let at = ways[ray][step];
            let (sin, cos) = libm::sincos(angle(ray));
            let beside = |by: usize| ways[(ray + by) % RAYS][step].point;
            // Per angle between geodesics, to the fourth order.
            let apart = (8.0 * (beside(1) - beside(RAYS - 1)) - (beside(2) - beside(RAYS - 2))) / (12.0 * angle(1));
            let across = at.normal.cross(at.towards);
            let area = if step == 0 { 1.0 } else { apart.dot(across) / (step as f64 * step_mm) };
            nodes.push(Node { point: at.point, normal: at.normal, x: cos * at.towards - sin * across, area });
        }
        Self { axes, middle_mm, step_mm, nodes, rims_mm }
    }

    /// From the chart's axes to the sensor's.
    pub fn axes(&self) -> DMat3 {
        self.axes
    }

    /// Its middle, mm.
    pub fn middle_mm(&self) -> DVec3 {
        self.middle_mm
    }

    /// How far from its middle it is known, mm.
    pub fn reach_mm(&self) -> f64 {
        self.step_mm * STEPS as f64
    }

    /// How far the rim is in a direction, in the chart's axes, mm; infinite where it is not reached.
    pub fn rim_mm(&self, angle: f64) -> f64 {
        let (ray, share) = ray_of(angle);
        let [a, b] = [self.rims_mm[ray], self.rims_mm[(ray + 1) % RAYS]];
        if a.is_finite() && b.is_finite() { a + share * (b - a) } else { a.max(b) }
    }

    /// Points of the gel all over the chart with their normals, the middle first.
    pub fn places(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
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

    /// How far it is along x and y, at the most, to where the normal is across the middle's, and to the farthest place on the rim;
    /// `None` if the normal is nowhere so.
    pub fn quarter_and_end_mm(&self) -> Option<[f64; 2]> {
        let across =
            |ray: usize| (1..=STEPS).find(|step| self.nodes[step * RAYS + ray].normal.dot(self.axes.z_axis) < ACROSS);
        let steps = (0..4).filter_map(|side| across(side * RAYS / 4)).max()?;
        let end_mm = self.rims_mm.iter().map(|rim_mm| rim_mm.min(self.reach_mm())).fold(0.0, f64::max);
        Some([steps as f64 * self.step_mm, end_mm])
    }

    /// How far the rim is where it is nearest within a range of directions, degrees, and the direction; where it is not reached, how
    /// far the chart reaches.
    pub fn least_rim_mm(&self, around_deg: std::ops::RangeInclusive<f64>) -> (f64, f64) {
        let (first, last) = (*around_deg.start(), around_deg.end().min(around_deg.start() + 360.0));
        let steps = libm::ceil(last - first) as usize;
        let angles = (0..=steps).map(|step| (first + step as f64).min(last));
        let rim = |deg: f64| (self.rim_mm(libm::remainder(deg.to_radians(), TAU)).min(self.reach_mm()), deg);
        angles.map(rim).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((self.reach_mm(), first))
    }

    /// True of a place up to `over_mm` beyond the rim, if it is on the chart and geodesics have not crossed before.
    pub fn is_on_gel(&self, [u, v]: [f64; 2], over_mm: f64) -> bool {
        let away_mm = libm::hypot(u, v);
        away_mm <= self.reach_mm()
            && away_mm <= self.rim_mm(libm::atan2(v, u)) + over_mm
            && self.between([u, v], |node| DVec3::new(node.area, 0.0, 0.0)).x > LEAST_AREA
    }

    /// The gel at a point of the chart; beyond its reach, at its end.
    pub fn rest(&self, at: [f64; 2]) -> Rest {
        let stencil = self.stencil(at);
        let [point, normal, x] = [
            self.sum(&stencil, |node| node.point),
            self.sum(&stencil, |node| node.normal),
            self.sum(&stencil, |node| node.x),
        ];
        let normal = normal.normalize_or(self.axes.z_axis);
        let x = (x - normal * normal.dot(x)).normalize_or(normal.any_orthonormal_vector());
        Rest { normal, below_mm: 0.0, point_mm: point, tangents: [x, normal.cross(x)] }
    }

    /// Area on the gel of a mm^2 of the chart.
    pub fn area(&self, at: [f64; 2]) -> f64 {
        self.between(at, |node| DVec3::new(node.area, 0.0, 0.0)).x
    }

    /// The place of a point of the gel, no numbers if it is not on the chart.
    pub fn at(&self, point_mm: DVec3) -> [f64; 2] {
        let off = point_mm - self.middle_mm;
        let flat = self.axes.transpose() * off;
        let first = DVec2::new(flat.x, flat.y).normalize_or_zero() * off.length();
        let within_mm = OFF * self.reach_mm();
        self.found(first, point_mm, within_mm).unwrap_or_else(|| {
            // From the sample closest to it.
            let distance = |node: &Node| node.point.distance_squared(point_mm);
            let samples = self.nodes.iter().enumerate().step_by(3);
            let closest = samples.min_by(|a, b| distance(a.1).total_cmp(&distance(b.1))).map_or(0, |(at, _)| at);
            let (sin, cos) = libm::sincos(TAU * (closest % RAYS) as f64 / RAYS as f64);
            let first = DVec2::new(cos, sin) * ((closest / RAYS) as f64 * self.step_mm);
            self.found(first, point_mm, within_mm).unwrap_or([f64::NAN; 2])
        })
    }

    /// By Newton's method from a first guess.
    fn found(&self, first: DVec2, point_mm: DVec3, within_mm: f64) -> Option<[f64; 2]> {
        let mut at = first;
        for _ in 0..20 {
            let Rest { point_mm: here, tangents: [x, y], .. } = self.rest(at.to_array());
            let off = point_mm - here;
            let step = DVec2::new(x.dot(off), y.dot(off)).clamp_length_max(0.1 * self.reach_mm());
            if step.length() < 1e-3 * within_mm {
                return (off.length() < within_mm).then_some(at.to_array());
            }
            // Along the geodesic as it is, across it by as much as the chart is wider than the gel.
            let outwards = at.normalize_or(DVec2::X);
            let (along, across) = (step.dot(outwards), step.dot(outwards.perp()));
            let wider = self.area(at.to_array()).max(0.2);
            at += along * outwards + across / wider * outwards.perp();
        }
        None
    }

    fn between(&self, at: [f64; 2], of: impl Fn(&Node) -> DVec3) -> DVec3 {
        self.sum(&self.stencil(at), of)
    }

    fn sum(&self, stencil: &[(usize, f64); 16], of: impl Fn(&Node) -> DVec3) -> DVec3 {
        stencil.iter().map(|(node, share)| *share * of(&self.nodes[*node])).sum()
    }

    /// The samples around a place and their shares: cubic along the geodesics and across them.
    fn stencil(&self, [u, v]: [f64; 2]) -> [(usize, f64); 16] {
        let away = (libm::hypot(u, v) / self.step_mm).min(STEPS as f64);
        let (ray, turn) = ray_of(libm::atan2(v, u));
        let step = (away as usize).min(STEPS - 2);
        let (outwards, around) = (cubic(away - step as f64), cubic(turn));
        std::array::from_fn(|number| {
            let (k, j) = (number / 4, number % 4);
            let ray = ray + RAYS + j - 1;
            // Before the first sample a geodesic is the one on the other side.
            let (step, ray) = if step + k == 0 { (1, ray + RAYS / 2) } else { (step + k - 1, ray) };
            (step * RAYS + ray % RAYS, outwards[k] * around[j])
        })
    }
}

/// Axes of a chart whose middle has this normal.
fn axes_at(normal: DVec3) -> DMat3 {
    let down = DVec3::NEG_Z + normal * normal.z;
    if down.length() > 1e-6 {
        let x = down.normalize();
        DMat3::from_cols(x, normal.cross(x), normal)
    } else {
        DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, normal))
    }
}

/// The geodesic before an angle, and how far it is on to the next.
fn ray_of(angle: f64) -> (usize, f64) {
    let place = (angle / TAU + if angle < 0.0 { 1.0 } else { 0.0 }) * RAYS as f64;
    let ray = (place as usize).min(RAYS - 1);
    (ray, place - ray as f64)
}

/// Shares of four neighbours at a place behind the second: Lagrange's cubic.
fn cubic(t: f64) -> [f64; 4] {
    let (a, b, c) = (t + 1.0, t - 1.0, t - 2.0);
    [-t * b * c / 6.0, a * b * c / 2.0, -a * t * c / 2.0, a * t * b / 6.0]
}
