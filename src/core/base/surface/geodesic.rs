//! Straight ways over a surface.

use glam::DVec3;

use super::topology::NONE;
use super::{Spot, Surface};

/// Triangles that a step may cross: more are a way that turns about one corner for ever.
const MOST_CROSSED: usize = 100_000;

/// A point of a straight way.
#[derive(Clone, Copy, Debug)]
pub struct Waypoint {
    pub point: DVec3,
    pub normal: DVec3,
    /// The way it goes: a unit vector across the normal.
    pub towards: DVec3,
}

impl Surface {
    /// Goes straight on from a place, by `steps` steps of `step_mm`: the points on the way with the first, and how far it is to the
    /// rim, if that is nearer. Beyond the rim the way goes on in its direction.
    ///
    /// Between two steps the direction is taken along by the turn of the smooth normal, on a ball and a cylinder exactly.
    pub(in crate::base) fn geodesic(
        &self,
        from: Spot,
        towards: DVec3,
        step_mm: f64,
        steps: usize,
    ) -> (Vec<Waypoint>, Option<f64>) {
        let (point, normal) = self.smooth(from);
        let across = towards - normal * normal.dot(towards);
        let mut here = Waypoint { point, normal, towards: across.normalize_or(normal.any_orthonormal_vector()) };
        let mut spot = from;
        let mut way = Vec::with_capacity(steps + 1);
        way.push(here);
        for number in 0..steps {
            if let Some(short_mm) = self.step(&mut spot, here.towards, step_mm) {
                // What is left of this step, and all others.
                let at_rim = self.arrive(spot, here);
                let rim_mm = (number + 1) as f64 * step_mm - short_mm;
                way.extend((number + 1..=steps).map(|number| {
                    let beyond_mm = number as f64 * step_mm - rim_mm;
                    Waypoint { point: at_rim.point + beyond_mm * at_rim.towards, ..at_rim }
                }));
                return (way, Some(rim_mm));
            }
            here = self.arrive(spot, here);
            way.push(here);
        }
        (way, None)
    }

    /// At a new place, the direction taken along.
    fn arrive(&self, spot: Spot, before: Waypoint) -> Waypoint {
        let (point, normal) = self.smooth(spot);
        let towards = before.towards
            - (before.normal + normal) * (before.towards.dot(normal) / (1.0 + before.normal.dot(normal)).max(1e-6));
        let towards = towards - normal * normal.dot(towards);
        Waypoint { point, normal, towards: towards.normalize_or(normal.any_orthonormal_vector()) }
    }

    /// Goes over facets, unfolded at each edge; says how much of the step is left at the rim.
    fn step(&self, spot: &mut Spot, towards: DVec3, step_mm: f64) -> Option<f64> {
        let mut facet = self.facets[spot.triangle];
        let mut direction = (towards - facet * facet.dot(towards)).normalize_or(facet.any_orthonormal_vector());
        let mut left_mm = step_mm;
        for _ in 0..MOST_CROSSED {
            let corners = self.corners[spot.triangle].map(|corner| self.points[corner as usize]);
            // The edge that is met first, and how far it is.
            let mut met = (f64::INFINITY, 0);
            for k in 0..3 {
                let inwards = facet.cross(corners[(k + 1) % 3] - corners[k]);
                let closing = -inwards.dot(direction);
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
            let next = self.beside[spot.triangle][k];
            if next == NONE {
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
