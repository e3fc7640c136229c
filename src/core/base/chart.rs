//! Charts of a curved gel: a plane onto which the part around a contact is unrolled.
//!
//! A chart is built from the geodesics that leave its centre: a point of the chart lies as far from the centre, and in
//! the same direction, as the geodesic to the corresponding point of the gel is long and starts (the exponential map:
//! azimuthal equidistant on a ball, a plain unrolling on a cylinder). Both pieces of a capsule have geodesics in closed
//! form; where ball and cylinder meet, a geodesic keeps its direction. The geodesics of a mesh are sampled
//! (`gel_surface/geodesic_chart.rs`).

use std::f64::consts::FRAC_PI_2;

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::gel::{GelShape, Site};
use super::gel_surface::geodesic_chart::GeodesicChart;
pub use super::site::SurfaceFrame;

/// A map of the gel that preserves distances from its centre. Its points are in mm.
#[derive(Clone, Debug)]
pub struct Chart {
    /// The geodesics of a mesh. If there are any, the other fields but the axes are unused.
    geodesics: Option<Arc<GeodesicChart>>,
    radius_mm: f64,
    /// True if there is a cylinder below the ball.
    has_cylinder: bool,
    /// From the chart's axes to the sensor's: the third column is the gel's normal at the chart's centre.
    axes: DMat3,
    /// How far the chart's centre lies below the centre of the tip's ball, mm.
    below_mm: f64,
    /// Latitude of the chart's centre, on a gel with a cylinder.
    latitude: Latitude,
}

impl PartialEq for Chart {
    fn eq(&self, other: &Self) -> bool {
        let round = |chart: &Self| (chart.radius_mm, chart.has_cylinder, chart.axes, chart.below_mm, chart.latitude);
        match (&self.geodesics, &other.geodesics) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => round(self) == round(other),
            _ => false,
        }
    }
}

/// How far the centre of a chart is from a capsule's tip, in steps of [`Latitude::STEP`]. There are few steps, so that
/// what depends on the latitude is computed once for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latitude(usize);

impl Latitude {
    /// Size of a step, as a share of the radius.
    pub const STEP: f64 = 0.2;

    /// Returns the number of latitudes on a gel.
    pub(crate) fn count_on(shape: &GelShape) -> usize {
        libm::round(shape.length_over_mm() / (shape.radius_mm() * Self::STEP)) as usize + 1
    }

    /// Returns the latitude's number, counted from the tip.
    pub(crate) fn index(self) -> usize {
        self.0
    }
}

impl Chart {
    /// Makes the chart whose centre is the gel's tip.
    pub fn at_tip(shape: &GelShape) -> Self {
        if let GelShape::Mesh(surface) = shape {
            return Self::from_geodesics(Arc::clone(surface.tip_chart()));
        }
        let (radius_mm, has_cylinder) = (shape.radius_mm(), shape.wall_mm().is_some());
        let latitude = Latitude::default();
        Self { geodesics: None, radius_mm, has_cylinder, axes: DMat3::IDENTITY, below_mm: 0.0, latitude }
    }

    /// Makes the chart of a mesh.
    pub fn from_geodesics(geodesics: Arc<GeodesicChart>) -> Self {
        let (axes, radius_mm) = (geodesics.axes(), geodesics.reach_mm());
        let latitude = Latitude::default();
        Self { geodesics: Some(geodesics), radius_mm, has_cylinder: false, axes, below_mm: 0.0, latitude }
    }

    /// Returns the geodesics of a mesh's chart; `None` for other shapes.
    pub fn geodesics(&self) -> Option<&Arc<GeodesicChart>> {
        self.geodesics.as_ref()
    }

    /// Makes a chart around a point. On a dome the point is the chart's centre, and the chart's axes are the tip's,
    /// transported there without rotation. On a capsule the centre is on the point's meridian, at most half a step of
    /// [`Latitude`] away, and the chart's x goes along the meridian, away from the tip.
    pub fn around_site(shape: &GelShape, site: Site) -> Self {
        let tip = Self::at_tip(shape);
        let normal = site.normal.normalize();
        if !tip.has_cylinder {
            return Self { axes: DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, normal)), ..tip };
        }
        let from_tip = libm::acos(normal.z.clamp(0.0, 1.0)) + site.below_mm / tip.radius_mm;
        let number = libm::round(from_tip / Latitude::STEP) as usize;
        // At the tip all meridians meet: any azimuth would do.
        let azimuth = if from_tip > 1e-9 { libm::atan2(normal.y, normal.x) } else { 0.0 };
        tip.on_meridian(Latitude(number.min(Latitude::count_on(shape) - 1)), azimuth)
    }

    /// Returns the chart of a round gel from which all others of a latitude come by [`Chart::base_rotation`]: the one
    /// around a dome's tip, or the one on a capsule's meridian through x.
    pub(crate) fn before_rotation(shape: &GelShape, latitude: usize) -> Self {
        let tip = Self::at_tip(shape);
        if tip.has_cylinder { tip.on_meridian(Latitude(latitude), 0.0) } else { tip }
    }

    /// Returns the charts of a capsule around each of its latitudes, on the meridian through x.
    #[cfg(test)]
    pub(crate) fn of_latitudes(shape: &GelShape) -> impl Iterator<Item = Self> {
        let tip = Self::at_tip(shape);
        (0..Latitude::count_on(shape)).map(move |number| tip.on_meridian(Latitude(number), 0.0))
    }

    fn on_meridian(&self, latitude: Latitude, azimuth: f64) -> Self {
        let from_tip = latitude.0 as f64 * Latitude::STEP;
        let axes = DMat3::from_rotation_z(azimuth) * DMat3::from_rotation_y(from_tip.min(FRAC_PI_2));
        Self { axes, below_mm: (from_tip - FRAC_PI_2).max(0.0) * self.radius_mm, latitude, ..self.clone() }
    }

    /// Returns the rotation from the chart's axes to the sensor's.
    pub(crate) fn axes(&self) -> DMat3 {
        self.axes
    }

    /// Returns the latitude of the chart's centre.
    pub fn latitude(&self) -> Latitude {
        self.latitude
    }

    /// Returns the rotation that takes the chart around the tip, or on the meridian through x, to this one. Charts of a
    /// dome differ only in their axes; those of one latitude of a capsule differ by a rotation about z.
    pub(crate) fn base_rotation(&self) -> DMat3 {
        match self.has_cylinder {
            false => self.axes,
            // The chart's y goes around the sensor's axis.
            true => DMat3::from_cols(self.axes.y_axis.cross(DVec3::Z), self.axes.y_axis, DVec3::Z),
        }
    }

    /// Returns the radius of the gel, mm.
    pub(crate) fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Returns position, normal and tangents of the gel at a point of the chart.
    pub fn surface_frame(&self, at: [f64; 2]) -> SurfaceFrame {
        if let Some(geodesics) = &self.geodesics {
            return geodesics.surface_frame(at);
        }
        if self.has_cylinder {
            self.walk_geodesic(at).surface_frame(at, self.radius_mm)
        } else {
            self.frame_on_ball(at)
        }
    }

    fn frame_on_ball(&self, [u, v]: [f64; 2]) -> SurfaceFrame {
        let angle = libm::hypot(u, v) / self.radius_mm;
        let (sin, cos) = libm::sincos(angle);
        let half = libm::sin(0.5 * angle);
        // sin / angle and (1 - cos) / angle^2, per mm and mm^2 of the chart.
        let (s, k) = if angle > 1e-9 { (sin / angle, 2.0 * half * half / (angle * angle)) } else { (1.0, 0.5) };
        let [x, y] = [u, v].map(|mm| mm / self.radius_mm);
        let along = [DVec3::new(1.0 - k * x * x, -k * x * y, -s * x), DVec3::new(-k * x * y, 1.0 - k * y * y, -s * y)];
        let normal = self.axes * DVec3::new(s * x, s * y, cos);
        let point_mm = round_gel_point_mm(self.radius_mm, normal, 0.0);
        // Written out: a closure may remain a function call.
        let tangents = [(self.axes * along[0]).normalize(), (self.axes * along[1]).normalize()];
        SurfaceFrame { normal, below_mm: 0.0, point_mm, tangents }
    }

    /// Follows the geodesic from the chart's centre to a point of the chart.
    fn walk_geodesic(&self, [u, v]: [f64; 2]) -> GeodesicWalk {
        let length = libm::hypot(u, v);
        let direction = if length > 0.0 { [u / length, v / length] } else { [1.0, 0.0] };
        let towards = self.axes * DVec3::new(direction[0], direction[1], 0.0);
        let mut walk = GeodesicWalk {
            normal: self.axes.z_axis,
            below_mm: self.below_mm,
            towards,
            width: 0.0,
            widening: self.radius_mm,
        };
        let mut left = length / self.radius_mm;
        // Ball and cylinder in turns: a geodesic crosses each of them at most twice.
        for _ in 0..4 {
            if left <= 0.0 {
                break;
            }
            let on_wall = walk.below_mm > 0.0 || (walk.normal.z <= 0.0 && walk.towards.z < 0.0);
            left -= if on_wall { walk.advance_on_cylinder(left, self.radius_mm) } else { walk.advance_on_ball(left) };
        }
        walk
    }

    /// Returns the point of the gel at a point of the chart, in the sensor's frame, mm.
    pub(crate) fn point_mm(&self, at: [f64; 2]) -> DVec3 {
        self.surface_frame(at).point_mm
    }

    /// Returns the gel at a point of the chart, and the area on the gel of 1 mm^2 of the chart there.
    pub(crate) fn frame_and_area(&self, at: [f64; 2]) -> (SurfaceFrame, f64) {
        if !self.has_cylinder {
            return (self.surface_frame(at), self.area_ratio(at));
        }
        let walk = self.walk_geodesic(at);
        (walk.surface_frame(at, self.radius_mm), walk.area_ratio(at))
    }

    /// Returns the gel at a point of the chart, and the slopes on the gel, as vectors, of a chart's slopes of 1 along x
    /// and along y.
    pub(crate) fn frame_and_gradients(&self, at: [f64; 2]) -> (SurfaceFrame, [DVec3; 2]) {
        let (rest, area) = self.frame_and_area(at);
        let [x, y] = rest.tangents;
        let outwards = DVec2::from_array(at).normalize_or(DVec2::X);
        // Across its geodesics the chart is wider than the gel, or narrower; the lower limit keeps the slope finite
        // where geodesics meet.
        let gradient = |slope: DVec2| {
            let (along, across) = (outwards.dot(slope), outwards.perp_dot(slope) / area.max(0.05));
            (outwards.x * along - outwards.y * across) * x + (outwards.y * along + outwards.x * across) * y
        };
        (rest, [gradient(DVec2::X), gradient(DVec2::Y)])
    }

    /// Returns the chart's coordinates of a point of the gel, whose normal need not have length 1. NaN if the point is
    /// not on a mesh's chart.
    pub fn locate_site(&self, site: Site) -> [f64; 2] {
        if let Some(geodesics) = &self.geodesics {
            return geodesics.locate_point(site.point_mm);
        }
        let DVec3 { x, y, z } = self.axes.transpose() * site.normal;
        let across = libm::hypot(x, y);
        let per = if across > 0.0 { self.radius_mm * libm::atan2(across, z) / across } else { 0.0 };
        let at = [per * x, per * y];
        if self.has_cylinder { self.refine_location(at, site) } else { at }
    }

    /// Finds the chart's coordinates of a point of a capsule by Newton's method.
    fn refine_location(&self, first: [f64; 2], site: Site) -> [f64; 2] {
        let normal = site.normal.normalize_or(DVec3::Z);
        let point = |normal: DVec3, below_mm: f64| self.radius_mm * normal - DVec3::new(0.0, 0.0, below_mm);
        let goal = point(normal, site.below_mm);
        let off = |rest: &SurfaceFrame| goal - point(rest.normal, rest.below_mm);
        // On the cylinder a point can be far from the centre: start from its unrolled coordinates there.
        let along = self.axes.x_axis.z.abs().min(1.0);
        let mut at = [first[0] + along * (site.below_mm - self.below_mm), first[1]];
        for _ in 0..30 {
            let rest = self.surface_frame(at);
            let off = off(&rest);
            let step = DVec3::new(rest.tangents[0].dot(off), rest.tangents[1].dot(off), 0.0).truncate();
            // Newton steps are limited, as the tangent plane is a poor guide far around the gel.
            let step = step.clamp_length_max(0.5 * self.radius_mm);
            if step.length() < 1e-12 * self.radius_mm {
                break;
            }
            // Along the geodesic, lengths are right; across it, the chart is wider than the gel, so the step is scaled.
            let outwards = DVec2::from_array(at).normalize_or(DVec2::X);
            let (along, across) = (step.dot(outwards), step.dot(outwards.perp()));
            let moved = along * outwards + across / self.area_ratio(at).max(0.2) * outwards.perp();
            at = [at[0] + moved.x, at[1] + moved.y];
        }
        at
    }

    /// Returns the area on the gel of 1 mm^2 of the chart.
    pub(crate) fn area_ratio(&self, at: [f64; 2]) -> f64 {
        if let Some(geodesics) = &self.geodesics {
            return geodesics.area_ratio(at);
        }
        if self.has_cylinder {
            return self.walk_geodesic(at).area_ratio(at);
        }
        let angle = libm::hypot(at[0], at[1]) / self.radius_mm;
        if angle > 1e-9 { libm::sin(angle) / angle } else { 1.0 }
    }
}

/// The state of a walk along a geodesic. Arc lengths are in radii.
struct GeodesicWalk {
    normal: DVec3,
    below_mm: f64,
    /// Direction of the walk: a unit vector across the normal.
    towards: DVec3,
    /// Distance to the neighbouring geodesics per angle between them at the centre, and its rate of change (the Jacobi
    /// field), in mm and mm per radius of length.
    width: f64,
    widening: f64,
}

impl GeodesicWalk {
    /// Advances by at most `left`, no farther than the rim of the ball; returns the length of the way.
    fn advance_on_ball(&mut self, left: f64) -> f64 {
        let to_rim = libm::atan2(self.normal.z, -self.towards.z);
        let to_rim = if to_rim <= 0.0 { std::f64::consts::PI } else { to_rim };
        let length = left.min(to_rim);
        let (sin, cos) = libm::sincos(length);
        (self.normal, self.towards) = (cos * self.normal + sin * self.towards, cos * self.towards - sin * self.normal);
        // Set exactly, so that rounding cannot leave the walk on the wrong side of the rim.
        if length == to_rim {
            self.normal.z = 0.0;
        }
        (self.width, self.widening) = (cos * self.width + sin * self.widening, cos * self.widening - sin * self.width);
        length
    }

    /// Advances by at most `left`, no farther than the upper end of the cylinder; returns the length of the way.
    fn advance_on_cylinder(&mut self, left: f64, radius_mm: f64) -> f64 {
        let rising = self.towards.z;
        let to_rim = if rising > 0.0 { self.below_mm / (radius_mm * rising) } else { f64::INFINITY };
        let length = left.min(to_rim);
        let around = DVec3::Z.cross(self.normal);
        let turn = DMat3::from_rotation_z(length * self.towards.dot(around));
        (self.normal, self.towards) = (turn * self.normal, turn * self.towards);
        self.below_mm = if length == to_rim { 0.0 } else { self.below_mm - length * rising * radius_mm };
        self.width += length * self.widening;
        length
    }

    /// Returns the area on the gel of 1 mm^2 of the chart at the end of the walk; the argument is that point of the
    /// chart.
    fn area_ratio(&self, [u, v]: [f64; 2]) -> f64 {
        let length = libm::hypot(u, v);
        if length > 1e-9 * self.widening.abs() { (self.width / length).abs() } else { 1.0 }
    }

    /// Returns the gel at the end of the walk, with tangents along the chart's axes; the first argument is that point
    /// of the chart.
    fn surface_frame(&self, [u, v]: [f64; 2], radius_mm: f64) -> SurfaceFrame {
        let length = libm::hypot(u, v);
        let [cos, sin] = if length > 0.0 { [u / length, v / length] } else { [1.0, 0.0] };
        let across = self.normal.cross(self.towards);
        let tangents = [cos * self.towards - sin * across, sin * self.towards + cos * across];
        let point_mm = round_gel_point_mm(radius_mm, self.normal, self.below_mm);
        SurfaceFrame { normal: self.normal, below_mm: self.below_mm, point_mm, tangents }
    }
}

/// Returns the position of a point of a round gel, mm.
fn round_gel_point_mm(radius_mm: f64, normal: DVec3, below_mm: f64) -> DVec3 {
    radius_mm * normal - DVec3::new(0.0, 0.0, radius_mm + below_mm)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::base::gel::{GelCapsule, GelDome};

    fn normal() -> impl Strategy<Value = DVec3> {
        let normal = prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from_array);
        normal.prop_filter("of some length", |normal| normal.length() > 0.1)
    }

    fn chart() -> impl Strategy<Value = Chart> {
        let dome = (1.0..100.0_f64, normal()).prop_map(|(radius_mm, normal)| {
            let shape = GelShape::Dome(GelDome { radius_mm });
            Chart::around_site(&shape, shape.site(normal, 0.0))
        });
        let capsule =
            (1.0..100.0_f64, 0.0..4.0_f64, normal(), 0.0..4.0_f64).prop_map(|(radius_mm, wall, to, below)| {
                let shape = GelShape::Capsule(GelCapsule { radius_mm, length_mm: (1.0 + wall) * radius_mm });
                let to = DVec3::new(to.x, to.y, if below > 2.0 { -(below - 2.0) * wall } else { to.z.abs() });
                Chart::around_site(&shape, shape.closest(radius_mm * to + shape.centre_mm()))
            });
        prop_oneof![dome, capsule]
    }

    proptest! {
        #[test]
        fn a_chart_goes_to_the_gel_and_back(chart in chart(), at in prop::array::uniform2(-2.0..2.0_f64)) {
            let at = at.map(|angle| angle * chart.radius_mm());
            let rest = chart.surface_frame(at);
            let back = chart.locate_site(rest.site());
            // On a capsule two geodesics may lead to one point.
            let [there, here] = [back, at].map(|at| chart.point_mm(at));
            prop_assert!(there.abs_diff_eq(here, 1e-6 * chart.radius_mm()), "{back:?} {at:?}");
            let at = if libm::hypot(at[0], at[1]) < chart.radius_mm() { at } else { back };
            prop_assert!((0..2).all(|k| (back[k] - at[k]).abs() < 1e-6 * chart.radius_mm()), "{back:?} {at:?}");
            let frame = DMat3::from_cols(rest.tangents[0], rest.tangents[1], rest.normal);
            prop_assert!((frame.determinant() - 1.0).abs() < 1e-9 && (frame.transpose() * frame).abs_diff_eq(DMat3::IDENTITY, 1e-9));
        }

        /// Outwards the chart keeps lengths.
        #[test]
        fn tangents_are_where_points_go(chart in chart(), at in prop::array::uniform2(-1.0..1.0_f64)) {
            let step = 1e-5 * chart.radius_mm();
            let at = at.map(|angle| angle * chart.radius_mm());
            let towards = |k: usize, by: f64| {
                let mut there = at;
                there[k] += by;
                chart.point_mm(there)
            };
            let slopes = [0, 1].map(|k| (towards(k, step) - towards(k, -step)) / (2.0 * step));
            let area = slopes[0].cross(slopes[1]);
            prop_assert!((area.length() - chart.area_ratio(at)).abs() < 1e-6);
            prop_assert!(area.normalize().abs_diff_eq(chart.surface_frame(at).normal, 1e-6));
        }
    }

    #[test]
    fn a_capsules_charts_unroll_its_cylinder_and_go_over_its_rim() {
        let shape = GelShape::Capsule(GelCapsule { radius_mm: 10.0, length_mm: 60.0 });
        let site = shape.site(DVec3::Y, 24.0);
        let chart = Chart::around_site(&shape, site);
        let middle = chart.surface_frame([0.0; 2]);
        assert!((middle.below_mm - 24.0).abs() <= 1.0 && middle.normal.abs_diff_eq(DVec3::Y, 1e-12), "{middle:?}");
        assert!(
            middle.tangents[0].abs_diff_eq(DVec3::NEG_Z, 1e-12) && middle.tangents[1].abs_diff_eq(DVec3::NEG_X, 1e-12)
        );
        let turned = chart.surface_frame([3.0, 5.0]);
        assert!((turned.below_mm - middle.below_mm - 3.0).abs() < 1e-9);
        assert!((turned.normal.angle_between(DVec3::Y) - 0.5).abs() < 1e-9);
        // Straight up the meridian, over the rim, to the tip and down on the other side.
        let to_tip = middle.below_mm + 10.0 * FRAC_PI_2;
        assert!(chart.point_mm([-to_tip, 0.0]).abs_diff_eq(DVec3::ZERO, 1e-9));
        let beyond = chart.point_mm([-to_tip - 10.0 * FRAC_PI_2 - 7.0, 0.0]);
        assert!(beyond.abs_diff_eq(DVec3::new(0.0, -10.0, -17.0), 1e-9), "{beyond}");
        assert_eq!(chart.area_ratio([-5.0, 5.0]), 1.0);
        assert!(chart.base_rotation().abs_diff_eq(DMat3::from_rotation_z(FRAC_PI_2), 1e-12));
    }

    #[test]
    fn charts_of_one_latitude_differ_by_a_turn() {
        let shape = GelShape::Capsule(GelCapsule { radius_mm: 10.0, length_mm: 40.0 });
        for base in Chart::of_latitudes(&shape) {
            let rest = base.surface_frame([0.0; 2]);
            let turn = DMat3::from_rotation_z(2.0);
            let site = shape.site(turn * rest.normal, rest.below_mm);
            let chart = Chart::around_site(&shape, site);
            assert_eq!(chart.latitude(), base.latitude());
            for at in [[0.0, 0.0], [6.0, -3.0], [-20.0, 8.0], [12.0, 15.0]] {
                let (here, there) = (chart.surface_frame(at), base.surface_frame(at));
                assert!(here.normal.abs_diff_eq(chart.base_rotation() * there.normal, 1e-9), "{at:?}");
                assert!((here.below_mm - there.below_mm).abs() < 1e-9, "{at:?}");
            }
        }
    }
}
