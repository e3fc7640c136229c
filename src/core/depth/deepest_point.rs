//! Finds where an object comes closest to a gel that is a mesh, or reaches deepest into it.

use glam::DVec3;

use crate::base::gel_surface::GelSurface;
use crate::mesh::clusters::Clusters;
use crate::mesh::nearest::nearest_point;
use crate::pose::Pose;

/// Returns the point of the gel where the object reaches deepest, its normal, and how far the object reaches below it,
/// mm; below 0 if the object stays outside. Distances are measured from points `inside_mm` below the gel's surface.
pub fn find_deepest_point(surface: &GelSurface, object: &Clusters, pose: &Pose, inside_mm: f64) -> (DVec3, DVec3, f64) {
    let back = pose.rotation.transpose();
    let nearest = |(point, normal): (DVec3, DVec3)| {
        let from = point - inside_mm * normal;
        let met = pose.rotation * nearest_point(object, back * (from - pose.translation_mm)) + pose.translation_mm;
        (point, normal, met, met.distance(from))
    };
    // Start from the best of several places; then alternate between the object's closest point and the gel's point
    // closest to it.
    let starts = surface.tip_chart().spread_points().map(nearest);
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
