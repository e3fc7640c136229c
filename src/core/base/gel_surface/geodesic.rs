//! Geodesics: straight ways over a surface.

use glam::DVec3;

use super::topology::NO_TRIANGLE;
use super::{FacetPoint, GelSurface};

/// Most triangles that a step may cross; a way that crosses more turns around one corner for ever.
const MAX_CROSSED: usize = 100_000;

/// A point of a geodesic.
#[derive(Clone, Copy, Debug)]
pub struct Waypoint {
    pub point: DVec3,
    pub normal: DVec3,
    /// Direction of the way: a unit vector across the normal.
    pub towards: DVec3,
}

impl GelSurface {
    /// Follows the geodesic from a point in `steps` steps of `step_mm`. Returns the points on the way, the first one
    /// included, and the distance to the rim if the way reaches it. Beyond the rim the way continues straight in its
    /// last direction.
    ///
    /// Between two steps the direction is rotated as the smooth normal is, which is exact on a ball and a cylinder.
    pub(in crate::base) fn trace_geodesic(
        &self,
        from: FacetPoint,
        towards: DVec3,
        step_mm: f64,
        steps: usize,
    ) -> (Vec<Waypoint>, Option<f64>) {
        let (point, normal) = self.smooth_point(from);
        let across = towards - normal * normal.dot(towards);
        let mut here = Waypoint { point, normal, towards: across.normalize_or(normal.any_orthonormal_vector()) };
        let mut spot = from;
        let mut way = Vec::with_capacity(steps + 1);
        way.push(here);
        for number in 0..steps {
            if let Some(short_mm) = self.step_over_facets(&mut spot, here.towards, step_mm) {
                // The rim was reached: the rest of this step and all further steps go straight on.
                let at_rim = self.transport_direction(spot, here);
                let rim_mm = (number + 1) as f64 * step_mm - short_mm;
                way.extend((number + 1..=steps).map(|number| {
                    let beyond_mm = number as f64 * step_mm - rim_mm;
                    Waypoint { point: at_rim.point + beyond_mm * at_rim.towards, ..at_rim }
                }));
                return (way, Some(rim_mm));
            }
            here = self.transport_direction(spot, here);
            way.push(here);
        }
        (way, None)
    }

    /// Returns the waypoint at a new point, with the direction transported from the previous one.
    fn transport_direction(&self, spot: FacetPoint, before: Waypoint) -> Waypoint {
        let (point, normal) = self.smooth_point(spot);
        let towards = before.towards
            - (before.normal + normal) * (before.towards.dot(normal) / (1.0 + before.normal.dot(normal)).max(1e-6));
        let towards = towards - normal * normal.dot(towards);
        Waypoint { point, normal, towards: towards.normalize_or(normal.any_orthonormal_vector()) }
    }

    /// Walks over the facets, unfolding them at each edge. Returns the rest of the step, mm, if the way ends at the
    /// rim.
    fn step_over_facets(&self, spot: &mut FacetPoint, towards: DVec3, step_mm: f64) -> Option<f64> {
        let mut facet = self.facets[spot.triangle];
        let mut direction = (towards - facet * facet.dot(towards)).normalize_or(facet.any_orthonormal_vector());
        let mut left_mm = step_mm;
        for _ in 0..MAX_CROSSED {
            let corners = self.corners[spot.triangle].map(|corner| self.points[corner as usize]);
            // The edge that is hit first, and its distance.
            let mut met = (f64::INFINITY, 0);
            for k in 0..3 {
                let inwards = facet.cross(corners[(k + 1) % 3] - corners[k]);
                let closing = -inwards.dot(direction);
                // An edge that is parallel to the way, up to rounding, is never crossed.
                if closing > 1e-12 * inwards.length() {
                    let away = (inwards.dot(spot.at - corners[k]) / closing).max(0.0);
                    if away < met.0 {
                        met = (away, k);
                    }
                }
            }
            let (away, k) = met;
            if away >= left_mm {
                spot.at += left_mm * direction;
                return None;
            }
            spot.at += away * direction;
            left_mm -= away;
            let next = self.neighbours[spot.triangle][k];
            if next == NO_TRIANGLE {
                return Some(left_mm);
            }
            let edge = (corners[(k + 1) % 3] - corners[k]).normalize_or_zero();
            let (along, over) = (direction.dot(edge), direction.dot(facet.cross(edge)));
            facet = self.facets[next as usize];
            direction = (along * edge + over * facet.cross(edge)).normalize_or(direction);
            spot.triangle = next as usize;
        }
        None
    }
}
