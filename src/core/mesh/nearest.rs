//! Finds where a mesh comes closest to a point, and where a line first hits it.

use glam::DVec3;

use super::clusters::{ClusterPart, Clusters};
pub use crate::base::triangle::nearest_point_on_triangle;

/// Returns the point of the object that is closest to `to`, both in the object's own frame, mm.
pub fn nearest_point(object: &Clusters, to: DVec3) -> DVec3 {
    nearest_point_from(object, to, None)
}

/// Returns the point of the object that is closest to `to`, both in the object's own frame, mm. A `known` point of the
/// object close to the result makes the search faster.
pub fn nearest_point_from(object: &Clusters, to: DVec3, known: Option<DVec3>) -> DVec3 {
    let to = to - DVec3::from_array(object.centre_mm());
    let first = known.map(|known| known - DVec3::from_array(object.centre_mm()));
    let best = std::cell::Cell::new(first.map_or((f64::INFINITY, DVec3::ZERO), |at| (to.distance_squared(at), at)));
    object.query(
        |min, max| to.distance_squared(nearest_point_on_box(to, min, max)) < best.get().0,
        |part| {
            for [a, b, c] in part_triangles(part) {
                // A part's box can come close although few of its triangles do: test the triangle's own box first.
                let in_box = to.clamp(a.min(b).min(c), a.max(b).max(c));
                if to.distance_squared(in_box) >= best.get().0 {
                    continue;
                }
                let nearest = nearest_point_on_triangle(to, a, b, c);
                let distance = to.distance_squared(nearest);
                if distance < best.get().0 {
                    best.set((distance, nearest));
                }
            }
        },
    );
    best.get().1 + DVec3::from_array(object.centre_mm())
}

/// Returns the smallest `t` at which `from + t * direction`, a line in the object's own frame, hits the object; `None`
/// if it misses. `t` can be negative. Neighbouring triangles leave no gap.
pub fn first_hit_along(object: &Clusters, from: DVec3, direction: DVec3) -> Option<f64> {
    let from = from - DVec3::from_array(object.centre_mm());
    let mut first: Option<f64> = None;
    object.query(
        |min, max| line_hits_box(from, direction, min, max),
        |part| {
            for t in part_triangles(part).filter_map(|triangle| hit_parameter(triangle, from, direction)) {
                first = Some(first.map_or(t, |first| first.min(t)));
            }
        },
    );
    first
}

/// Returns true if `from + t * direction`, in the object's own frame, hits the object for some `t` from 0 to `most`.
pub fn is_hit_along(object: &Clusters, from: DVec3, direction: DVec3, most: f64) -> bool {
    let from = from - DVec3::from_array(object.centre_mm());
    let to = from + most * direction;
    let (low, high) = (from.min(to), from.max(to));
    let met = std::cell::Cell::new(false);
    object.query(
        |min, max| {
            let [least, largest] = [min, max].map(|side| DVec3::from_array(side.map(f64::from)));
            !met.get()
                && low.cmple(largest).all()
                && high.cmpge(least).all()
                && line_hits_box(from, direction, min, max)
        },
        |part| {
            let mut meets = part_triangles(part).filter_map(|triangle| hit_parameter(triangle, from, direction));
            met.set(met.get() || meets.any(|t| (0.0..=most).contains(&t)));
        },
    );
    met.get()
}

/// Returns where a line hits a triangle; `None` if it misses or lies in the triangle's plane. Neighbours compute the
/// plane of a shared edge with the same bits, so that no line passes between them.
fn hit_parameter(triangle: [DVec3; 3], from: DVec3, direction: DVec3) -> Option<f64> {
    let [a, b, c] = triangle.map(|corner| corner - from);
    let [ab, bc, ca] = [a.cross(b), b.cross(c), c.cross(a)];
    let sides = [ab, bc, ca].map(|side| side.dot(direction));
    let along = (ab + bc + ca).dot(direction);
    let within = sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
    (within && along != 0.0).then(|| a.dot(bc) / along)
}

/// Returns the point of a box that is closest to `to`.
pub fn nearest_point_on_box(to: DVec3, min: [f32; 3], max: [f32; 3]) -> DVec3 {
    to.clamp(DVec3::from_array(min.map(f64::from)), DVec3::from_array(max.map(f64::from)))
}

/// Returns the triangles of a part, relative to the object's centre.
pub fn part_triangles(part: ClusterPart<'_>) -> impl Iterator<Item = [DVec3; 3]> + '_ {
    let corner = move |at: u8| {
        let at = usize::from(at);
        DVec3::new(part.x[at].into(), part.y[at].into(), part.z[at].into())
    };
    part.corners.iter().map(move |corners| corners.map(corner))
}

/// Returns true if a line goes through a box.
fn line_hits_box(from: DVec3, direction: DVec3, min: [f32; 3], max: [f32; 3]) -> bool {
    let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
    for k in 0..3 {
        let [a, b] = [min[k], max[k]].map(|side| f64::from(side) - from[k]);
        if direction[k] == 0.0 {
            if a > 0.0 || b < 0.0 {
                return false;
            }
        } else {
            let [a, b] = [a, b].map(|side| side / direction[k]);
            (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
        }
    }
    // Slightly larger than the box, so that rounding misses no triangle.
    enters <= leaves + 1e-9 * leaves.abs().max(1.0)
}
