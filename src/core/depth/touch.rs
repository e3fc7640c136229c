//! Where an object comes closest to a gel that is a mesh, or reaches deepest into it.

use glam::DVec3;

use crate::base::surface::Surface;
use crate::mesh::clusters::Clusters;
use crate::mesh::nearest::nearest_point;
use crate::pose::Pose;

/// The point of the gel there, its normal, and how far the object reaches below it, mm; below 0 where it does not. It is looked for
/// from points so far inside the gel.
pub fn deepest(surface: &Surface, object: &Clusters, pose: &Pose, inside_mm: f64) -> (DVec3, DVec3, f64) {
    let back = pose.rotation.transpose();
    let nearest = |(point, normal): (DVec3, DVec3)| {
        let from = point - inside_mm * normal;
        let met = pose.rotation * nearest_point(object, back * (from - pose.translation_mm)) + pose.translation_mm;
        (point, normal, met, met.distance(from))
    };
    // From the best of several places; then by turns the closest point of the object, and that of the gel closest to it.
    let starts = surface.around_tip().places().map(nearest);
    let best = starts.min_by(|a, b| a.3.total_cmp(&b.3));
    let mut best = best.unwrap_or_else(|| nearest((DVec3::ZERO, surface.tip_normal())));
    for _ in 0..20 {
        let (point, _, met, distance_mm) = best;
        let next = nearest(surface.nearest(met));
        if next.3 >= distance_mm || next.0.distance(point) < 1e-6 * surface.size_mm() {
            break;
        }
        best = next;
    }
    let (point, normal, _, distance_mm) = best;
    (point, normal, inside_mm - distance_mm)
}
