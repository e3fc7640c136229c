//! The shape of a gel that is not flat, and charts of it, which unroll the part around a contact into a plane.
//!
//! Frame: the sensor's, with its origin at the gel's tip and z out of the gel.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// The outer surface of a gel that is not flat, untouched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum GelShape {
    /// Half of a ball.
    Dome(GelDome),
}

/// See [`GelShape::Dome`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GelDome {
    /// Radius of the ball, mm, 1 to 1e6.
    pub radius_mm: f64,
}

impl GelShape {
    /// Radius of its tip, mm.
    pub fn radius_mm(&self) -> f64 {
        let Self::Dome(GelDome { radius_mm }) = self;
        *radius_mm
    }

    /// The point that all normals of the tip come from.
    pub fn centre_mm(&self) -> DVec3 {
        DVec3::new(0.0, 0.0, -self.radius_mm())
    }

    /// Where a line leaves the gel, as a normal of its surface; `None` if it passes the gel by or leaves through its base.
    pub fn left_by(&self, from: DVec3, direction: DVec3) -> Option<DVec3> {
        let radius_mm = self.radius_mm();
        let direction = direction.normalize();
        let from = from - self.centre_mm();
        // Of the point of the line closest to the centre: numbers of the size of the radius cancel only once.
        let nearest = from - direction * from.dot(direction);
        let half_chord = radius_mm * radius_mm - nearest.length_squared();
        let leaves = nearest + direction * libm::sqrt(half_chord);
        (half_chord >= 0.0 && leaves.z >= 0.0).then(|| leaves / radius_mm)
    }
}

/// A map of the gel that keeps distances from its middle (azimuthal equidistant). Points of it are in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chart {
    radius_mm: f64,
    /// From the chart's axes to the sensor's: the third is the gel's normal in the middle.
    axes: DMat3,
}

/// Where a point of a chart is on the gel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Out of the gel.
    pub normal: DVec3,
    /// Along the chart's x and y, as they go over the gel from its middle without a turn: unit vectors across the normal.
    pub tangents: [DVec3; 2],
}

impl Chart {
    /// With the gel's tip in its middle.
    pub fn at_tip(shape: &GelShape) -> Self {
        Self { radius_mm: shape.radius_mm(), axes: DMat3::IDENTITY }
    }

    /// With the point in its middle whose normal this is; its axes are the tip's, taken there without a turn.
    pub fn around(shape: &GelShape, normal: DVec3) -> Self {
        let axes = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, normal.normalize()));
        Self { axes, ..Self::at_tip(shape) }
    }

    /// The same in axes of its own.
    pub fn local(&self) -> Self {
        Self { axes: DMat3::IDENTITY, ..*self }
    }

    /// From the chart's axes to the sensor's.
    pub fn axes(&self) -> DMat3 {
        self.axes
    }

    /// Radius of the gel, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// The gel at a point of the chart.
    pub fn rest(&self, [u, v]: [f64; 2]) -> Rest {
        let angle = libm::hypot(u, v) / self.radius_mm;
        let (sin, cos) = libm::sincos(angle);
        let half = libm::sin(0.5 * angle);
        // sin / angle and (1 - cos) / angle^2, per mm and mm^2 of the chart.
        let (s, k) = match angle > 1e-9 {
            true => (sin / angle, 2.0 * half * half / (angle * angle)),
            false => (1.0, 0.5),
        };
        let [x, y] = [u, v].map(|mm| mm / self.radius_mm);
        let along = [DVec3::new(1.0 - k * x * x, -k * x * y, -s * x), DVec3::new(-k * x * y, 1.0 - k * y * y, -s * y)];
        let normal = self.axes * DVec3::new(s * x, s * y, cos);
        Rest { normal, tangents: along.map(|tangent| (self.axes * tangent).normalize()) }
    }

    /// The point of the gel's surface at a point of the chart, in the sensor's frame, mm.
    pub fn point_mm(&self, at: [f64; 2]) -> DVec3 {
        self.radius_mm * self.rest(at).normal - DVec3::new(0.0, 0.0, self.radius_mm)
    }

    /// The point of the chart that has a normal, which need not be of length 1.
    pub fn at(&self, normal: DVec3) -> [f64; 2] {
        let DVec3 { x, y, z } = self.axes.transpose() * normal;
        let across = libm::hypot(x, y);
        let per = match across > 0.0 {
            true => self.radius_mm * libm::atan2(across, z) / across,
            false => 0.0,
        };
        [per * x, per * y]
    }

    /// Area on the gel of a mm^2 of the chart.
    pub fn area(&self, [u, v]: [f64; 2]) -> f64 {
        let angle = libm::hypot(u, v) / self.radius_mm;
        if angle > 1e-9 { libm::sin(angle) / angle } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn chart() -> impl Strategy<Value = Chart> {
        let normal = prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from_array);
        let normal = normal.prop_filter("of some length", |normal| normal.length() > 0.1);
        (1.0..100.0_f64, normal)
            .prop_map(|(radius_mm, normal)| Chart::around(&GelShape::Dome(GelDome { radius_mm }), normal))
    }

    proptest! {
        #[test]
        fn a_chart_goes_to_the_gel_and_back(chart in chart(), at in prop::array::uniform2(-2.0..2.0_f64)) {
            let at = at.map(|angle| angle * chart.radius_mm());
            let rest = chart.rest(at);
            let back = chart.at(rest.normal);
            prop_assert!((0..2).all(|k| (back[k] - at[k]).abs() < 1e-6 * chart.radius_mm()), "{back:?} {at:?}");
            let frame = DMat3::from_cols(rest.tangents[0], rest.tangents[1], rest.normal);
            prop_assert!((frame.determinant() - 1.0).abs() < 1e-9 && (frame.transpose() * frame).abs_diff_eq(DMat3::IDENTITY, 1e-9));
        }

        /// Outwards the chart keeps lengths, across that by sin(angle) / angle.
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
            prop_assert!((area.length() - chart.area(at)).abs() < 1e-6);
            prop_assert!(area.normalize().abs_diff_eq(chart.rest(at).normal, 1e-6));
        }
    }

    #[test]
    fn a_line_leaves_half_a_ball_where_it_should() {
        let dome = GelShape::Dome(GelDome { radius_mm: 20.0 });
        let up = dome.left_by(DVec3::new(0.0, 0.0, -60.0), DVec3::Z);
        assert!(up.expect("through the tip").abs_diff_eq(DVec3::Z, 1e-12));
        let beside = DVec3::new(12.0, 0.0, -200.0);
        assert!(dome.left_by(beside, DVec3::Z).expect("a hit").abs_diff_eq(DVec3::new(0.6, 0.0, 0.8), 1e-12));
        assert_eq!(dome.left_by(DVec3::new(21.0, 0.0, -60.0), DVec3::Z), None);
        assert_eq!(dome.left_by(DVec3::new(0.0, 0.0, -20.0), DVec3::new(1.0, 0.0, -0.1)), None, "through the base");
        // A ball of a kilometre is flat.
        let wide = GelShape::Dome(GelDome { radius_mm: 1e6 });
        let normal = wide.left_by(DVec3::new(3.0, 4.0, -1.0), DVec3::Z).expect("a hit");
        let [u, v] = Chart::at_tip(&wide).at(normal);
        assert!((u - 3.0).abs() < 1e-6 && (v - 4.0).abs() < 1e-6, "{u} {v}");
    }
}
