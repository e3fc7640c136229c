//! The shape of a curved gel.
//!
//! Frame: the sensor's, with the origin at the gel's tip and z out of the gel. Every point of a round gel is one radius
//! away from the gel's axis. The axis is the part of the z axis from the centre of the tip's ball downwards.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::gel_surface::GelSurface;
pub use super::site::Site;

/// The outer surface of a curved gel, untouched.
#[derive(Clone, Debug, PartialEq)]
pub enum GelShape {
    /// Half of a ball.
    Dome(GelDome),
    /// A finger: half of a ball on a cylinder of the same radius.
    Capsule(GelCapsule),
    /// Any other, as a mesh.
    Mesh(Arc<GelSurface>),
}

/// A gel that is half of a ball.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GelDome {
    /// Radius of the ball, mm, 1 to 1e6.
    pub radius_mm: f64,
}

/// A gel like a finger: half of a ball on a cylinder of the same radius.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GelCapsule {
    /// Radius of ball and cylinder, mm, 1 to 1000.
    pub radius_mm: f64,
    /// From the tip to the end of the gel, mm: the radius to 1000.
    pub length_mm: f64,
}

impl GelShape {
    /// Returns the radius of the tip, mm; for a mesh, half its smaller width.
    pub fn radius_mm(&self) -> f64 {
        match self {
            Self::Dome(GelDome { radius_mm }) | Self::Capsule(GelCapsule { radius_mm, .. }) => *radius_mm,
            Self::Mesh(surface) => surface.size_mm(),
        }
    }

    /// Returns the mesh of a gel that is given as one; `None` for other shapes.
    pub fn surface(&self) -> Option<&Arc<GelSurface>> {
        match self {
            Self::Mesh(surface) => Some(surface),
            Self::Dome(_) | Self::Capsule(_) => None,
        }
    }

    /// Returns the tip.
    pub(crate) fn tip(&self) -> Site {
        match self {
            Self::Mesh(surface) => Site { normal: surface.tip_normal(), below_mm: 0.0, point_mm: DVec3::ZERO },
            Self::Dome(_) | Self::Capsule(_) => self.site(DVec3::Z, 0.0),
        }
    }

    /// Returns the point of a round gel with this normal, `below_mm` below the centre of the tip's ball.
    pub fn site(&self, normal: DVec3, below_mm: f64) -> Site {
        let point_mm = self.radius_mm() * normal - DVec3::new(0.0, 0.0, self.radius_mm() + below_mm);
        Site { normal, below_mm, point_mm }
    }

    /// Returns the length of a capsule's cylinder, mm; `None` for other shapes.
    pub fn wall_mm(&self) -> Option<f64> {
        match self {
            Self::Dome(_) | Self::Mesh(_) => None,
            Self::Capsule(GelCapsule { radius_mm, length_mm }) => Some((length_mm - radius_mm).max(0.0)),
        }
    }

    /// Returns the distance over the surface from the tip to the end of the gel, mm; for a mesh, to the nearest point
    /// of the rim.
    pub fn length_over_mm(&self) -> f64 {
        match self {
            Self::Mesh(surface) => surface.tip_chart().least_rim_mm(0.0..=360.0).0,
            Self::Dome(_) | Self::Capsule(_) => FRAC_PI_2 * self.radius_mm() + self.wall_mm().unwrap_or(0.0),
        }
    }

    /// Returns the centre of a round tip, where all its normals meet, mm.
    pub fn centre_mm(&self) -> DVec3 {
        DVec3::new(0.0, 0.0, -self.radius_mm())
    }

    /// Returns the point of the gel closest to `to_mm`; the tip if `to_mm` is the centre of the tip's ball.
    pub fn closest(&self, to_mm: DVec3) -> Site {
        if let Self::Mesh(surface) = self {
            return mesh_site(surface.nearest(to_mm));
        }
        let to = to_mm - self.centre_mm();
        let below_mm = (-to.z).clamp(0.0, self.wall_mm().unwrap_or(0.0));
        let out = DVec3::new(to.x, to.y, to.z + below_mm);
        // Below the gel's end, its rim is closest.
        let out = if out.z < 0.0 { DVec3::new(out.x, out.y, 0.0) } else { out };
        self.site(out.normalize_or(DVec3::Z), below_mm)
    }

    /// Returns a frame on the gel at a distance over the surface from the tip and in a direction: its axes in the
    /// sensor's frame (away from the tip, around the gel, out of it), and its origin, mm.
    pub fn frame_at(&self, from_tip_mm: f64, around_deg: f64) -> (DMat3, DVec3) {
        if let Self::Mesh(surface) = self {
            return surface.frame_at(from_tip_mm, around_deg);
        }
        let from_tip = from_tip_mm / self.radius_mm();
        let axes = DMat3::from_rotation_z(around_deg.to_radians()) * DMat3::from_rotation_y(from_tip.min(FRAC_PI_2));
        let below_mm = (from_tip - FRAC_PI_2).max(0.0) * self.radius_mm();
        (axes, self.site(axes.z_axis, below_mm).point_mm)
    }

    /// Returns the point where a line leaves a round gel; `None` if the line misses the gel or leaves it through its
    /// base. For a mesh, returns the first point where the ray leaves it.
    pub(crate) fn find_exit(&self, from: DVec3, direction: DVec3) -> Option<Site> {
        if let Self::Mesh(surface) = self {
            return surface.find_exit(from, direction).map(mesh_site);
        }
        let radius_mm = self.radius_mm();
        let direction = direction.normalize();
        let from = from - self.centre_mm();
        // From the point of the line that is closest to the centre: there, numbers as large as the radius cancel only
        // once.
        let nearest = from - direction * from.dot(direction);
        let half_chord = radius_mm * radius_mm - nearest.length_squared();
        let leaves = nearest + direction * libm::sqrt(half_chord);
        if half_chord >= 0.0 && leaves.z >= 0.0 {
            return Some(self.site(leaves / radius_mm, 0.0));
        }
        // The tip is missed: intersect the line with the cylinder, in the plane across its axis.
        let along = direction.truncate().length();
        let across = direction.truncate() / along;
        let nearest = from.truncate() - across * from.truncate().dot(across);
        let half_chord = radius_mm * radius_mm - nearest.length_squared();
        let leaves = nearest + across * libm::sqrt(half_chord);
        let below_mm = -(from.z + direction.z * (leaves - from.truncate()).dot(across) / along);
        let on_wall = half_chord >= 0.0 && below_mm > 0.0 && below_mm <= self.wall_mm()?;
        on_wall.then(|| self.site((leaves / radius_mm).extend(0.0), below_mm))
    }
}

/// Makes a site from a point of a mesh and its normal.
fn mesh_site((point_mm, normal): (DVec3, DVec3)) -> Site {
    Site { normal, below_mm: 0.0, point_mm }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::chart::Chart;

    #[test]
    fn a_line_leaves_half_a_ball_where_it_should() {
        let dome = GelShape::Dome(GelDome { radius_mm: 20.0 });
        let up = dome.find_exit(DVec3::new(0.0, 0.0, -60.0), DVec3::Z);
        assert!(up.expect("through the tip").normal.abs_diff_eq(DVec3::Z, 1e-12));
        let beside = DVec3::new(12.0, 0.0, -200.0);
        assert!(dome.find_exit(beside, DVec3::Z).expect("a hit").normal.abs_diff_eq(DVec3::new(0.6, 0.0, 0.8), 1e-12));
        assert_eq!(dome.find_exit(DVec3::new(21.0, 0.0, -60.0), DVec3::Z), None);
        assert_eq!(dome.find_exit(DVec3::new(0.0, 0.0, -20.0), DVec3::new(1.0, 0.0, -0.1)), None, "through the base");
        // A ball of a kilometre is flat.
        let wide = GelShape::Dome(GelDome { radius_mm: 1e6 });
        let site = wide.find_exit(DVec3::new(3.0, 4.0, -1.0), DVec3::Z).expect("a hit");
        let [u, v] = Chart::at_tip(&wide).locate_site(site);
        assert!((u - 3.0).abs() < 1e-6 && (v - 4.0).abs() < 1e-6, "{u} {v}");
    }

    #[test]
    fn a_line_leaves_a_capsule_by_its_cap_its_wall_or_its_end() {
        let capsule = GelShape::Capsule(GelCapsule { radius_mm: 10.0, length_mm: 40.0 });
        let from = DVec3::new(1.0, 0.0, -35.0);
        for (direction, expected) in [
            (DVec3::X, Some(DVec3::new(10.0, 0.0, -35.0))),
            (DVec3::new(0.0, 1.0, 1.0), Some(DVec3::new(1.0, f64::sqrt(99.0), -35.0 + f64::sqrt(99.0)))),
            (DVec3::new(-1.0, 0.0, -1.0), None),
            (DVec3::NEG_Z, None),
        ] {
            let point = capsule.find_exit(from, direction).map(|site| site.point_mm);
            match (point, expected) {
                (Some(point), Some(expected)) => assert!(point.abs_diff_eq(expected, 1e-9), "{point} {expected}"),
                (point, expected) => assert_eq!(point, expected, "{direction}"),
            }
        }
        let up = capsule.find_exit(from, DVec3::Z).expect("the cap");
        assert_eq!(up.below_mm, 0.0);
        assert!(up.point_mm.abs_diff_eq(DVec3::new(1.0, 0.0, f64::sqrt(99.0) - 10.0), 1e-9));
        let beside = capsule.closest(DVec3::new(0.0, -14.0, -33.0));
        assert_eq!((beside.normal, beside.below_mm), (DVec3::NEG_Y, 23.0));
        assert_eq!(capsule.closest(DVec3::new(0.0, 3.0, -90.0)).below_mm, 30.0);
    }
}
