//! Rays against the triangles of a placed mesh, in plain loops.

use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::nearest::part_triangles;
use gelsim_core::pose::Pose;
use glam::DVec3;

/// How far a ray from `from` goes to the first triangle that it meets.
pub fn first_met(object: &Clusters, pose: &Pose, from: DVec3, direction: DVec3) -> Option<f64> {
    let centre = DVec3::from_array(object.centre_mm());
    let mut first: Option<f64> = None;
    object.query(
        |_, _| true,
        |part| {
            for triangle in part_triangles(part) {
                let [a, b, c] = triangle.map(|q| pose.rotation * (q + centre) + pose.translation_mm);
                // Moeller and Trumbore.
                let (ab, ac) = (b - a, c - a);
                let across = direction.cross(ac);
                let volume = ab.dot(across);
                if volume.abs() < 1e-12 {
                    continue;
                }
                let to = from - a;
                let u = to.dot(across) / volume;
                let beside = to.cross(ab);
                let (v, t) = (direction.dot(beside) / volume, ac.dot(beside) / volume);
                if u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9 && t > 0.0 {
                    first = Some(first.map_or(t, |first| first.min(t)));
                }
            }
        },
    );
    first
}
