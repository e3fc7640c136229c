//! Finds where an object comes closest to a curved gel, and makes the chart around that place.

use std::cell::Cell;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::CurvedGel;
use crate::base::chart::Chart;
use crate::base::gel::{GelShape, Site};
use crate::base::gel_surface::GelSurface;
use crate::base::gel_surface::geodesic_chart::GeodesicChart;
use crate::depth::deepest_point;
use crate::depth::normal_lines::START_DEPTH;
use crate::gelpad::elastic::shear::Motion;
use crate::mesh::clusters::Clusters;
use crate::mesh::nearest::nearest_point_from;
use crate::pose::Pose;

/// Largest angle between a contact and its chart's centre on a dome, rad: lengths there are off by 0.7 %.
const TIP_CHART_ANGLE: f64 = 0.2;

impl CurvedGel {
    /// Finds where the object comes closest to the gel's axis. Returns the point of the gel on the way there, and how
    /// far the object reaches below it, mm. On a mesh, returns the point where the object reaches deepest.
    pub(crate) fn find_deepest_site(&self, object: &Clusters, pose: &Pose, thickness_mm: f64) -> (Site, f64) {
        if object.is_empty() {
            return (self.shape.tip(), f64::NEG_INFINITY);
        }
        if let GelShape::Mesh(surface) = &self.shape {
            let (point_mm, normal, reaches_mm) =
                deepest_point::find_deepest_point(surface, object, pose, START_DEPTH * thickness_mm);
            return (Site { normal, below_mm: 0.0, point_mm }, reaches_mm);
        }
        let (centre, wall_mm) = (self.shape.centre_mm(), self.shape.wall_mm().unwrap_or(0.0));
        // The closest points to neighbouring places are neighbours: each search starts from the last result.
        let known = Cell::new(None);
        let nearest = |below_mm: f64| {
            let from = centre - DVec3::new(0.0, 0.0, below_mm);
            let in_object = pose.rotation.transpose() * (from - pose.translation_mm);
            let met = nearest_point_from(object, in_object, known.get());
            known.set(Some(met));
            pose.rotation * met + pose.translation_mm - from
        };
        // Start from the best of several places, as an object may come close to the axis in more than one. Then
        // alternate between the closest point of the object and the point of the axis closest to that.
        // One start per half radius along the cylinder, limited so that a very thin gel stays affordable.
        let starts = libm::ceil(2.0 * wall_mm / self.shape.radius_mm()).min(32.0) as usize;
        let mut best = (0.0, nearest(0.0));
        for start in 1..=starts {
            let below_mm = wall_mm * start as f64 / starts as f64;
            let at = nearest(below_mm);
            if at.length_squared() < best.1.length_squared() {
                best = (below_mm, at);
            }
        }
        for _ in 0..20 {
            let next_mm = (best.0 - best.1.z).clamp(0.0, wall_mm);
            if (next_mm - best.0).abs() < 1e-6 * self.shape.radius_mm() {
                break;
            }
            best = (next_mm, nearest(next_mm));
        }
        let (below_mm, at) = best;
        // Below a dome's centre there is no gel, and at the centre itself there is no direction.
        let normal = match (below_mm > 0.0, at.z > 0.0) {
            (true, _) => DVec3::new(at.x, at.y, 0.0).normalize_or(DVec3::X),
            (false, true) => at,
            (false, false) if wall_mm > 0.0 => DVec3::new(at.x, at.y, 0.0).normalize_or(DVec3::Z),
            (false, false) => DVec3::Z,
        };
        (self.shape.site(normal, below_mm), self.shape.radius_mm() - at.length())
    }

    /// Makes the chart for a contact around a point. On a dome its centre is the tip as long as the contact is near the
    /// tip; farther out it follows the contact, as charts are wider than the gel far from their centre. It does so on a
    /// mesh, too, along the way from the tip. On a capsule it is the chart of the closest latitude.
    pub(super) fn chart_around(&self, site: Site) -> Chart {
        if let GelShape::Mesh(surface) = &self.shape {
            return self.chart_on_mesh(surface, site);
        }
        if self.shape.wall_mm().is_some() {
            return Chart::around_site(&self.shape, site);
        }
        let tip = Chart::at_tip(&self.shape);
        let at = DVec2::from(tip.locate_site(site));
        let follows_mm = at.length() - TIP_CHART_ANGLE * tip.radius_mm();
        if follows_mm > 0.0 {
            let normal = tip.surface_frame((at.normalize() * follows_mm).to_array()).normal;
            Chart::around_site(&self.shape, self.shape.site(normal, 0.0))
        } else {
            tip
        }
    }

    /// Makes the chart on a mesh for a contact around a point. Its centre is the first place on the way from the tip from
    /// which the gel leans little up to the contact, and which has the contact within its view. Its axes are the tip's,
    /// moved there without rotation. For a contact that the tip's chart does not reach, it is the chart around it.
    fn chart_on_mesh(&self, surface: &GelSurface, site: Site) -> Chart {
        let tip = Chart::at_tip(&self.shape);
        let at = DVec2::from(tip.locate_site(site));
        if at.is_nan() {
            return Chart::from_geodesics(Arc::new(GeodesicChart::around_point(surface, site.point_mm, self.reach_mm)));
        }
        let contact = tip.surface_frame(at.to_array()).normal;
        let is_near = |share: f64| {
            let normal = tip.surface_frame((share * at).to_array()).normal;
            let beyond = (1.0 - share) * at.abs();
            let half_mm = |k: usize| 0.5 * self.view.resolution_px[k] as f64 * self.view.mm_per_px[k];
            normal.angle_between(contact) <= TIP_CHART_ANGLE && beyond.x <= half_mm(0) && beyond.y <= half_mm(1)
        };
        if is_near(0.0) {
            return tip;
        }
        let (mut far, mut near) = (0.0, 1.0);
        for _ in 0..40 {
            let middle = 0.5 * (far + near);
            *(if is_near(middle) { &mut near } else { &mut far }) = middle;
        }
        let frame = tip.surface_frame((near * at).to_array());
        let chart = GeodesicChart::with_x_axis(surface, frame.point_mm, frame.tangents[0], self.reach_mm);
        Chart::from_geodesics(Arc::new(chart))
    }

    /// Converts a motion in the sensor's x and y to a chart.
    pub(super) fn motion_on_chart(&self, motion: Motion, chart: &Chart) -> Motion {
        let [x, y] = motion.shift_mm;
        let shift_mm = chart.surface_frame([0.0; 2]).tangents.map(|tangent| tangent.dot(DVec3::new(x, y, 0.0)));
        if let GelShape::Mesh(surface) = &self.shape {
            let [x, y] = motion.about_mm;
            let below = DVec3::new(x, y, surface.bounds_mm()[0].z - 1.0);
            let about_mm = surface.find_exit(below, DVec3::Z).map_or([0.0; 2], |(point_mm, normal)| {
                let at = chart.locate_site(Site { normal, below_mm: 0.0, point_mm });
                if at[0].is_nan() { [0.0; 2] } else { at }
            });
            return Motion { shift_mm, about_mm, ..motion };
        }
        // The point of the gel that is seen there from above; for a point beside the gel, the rim.
        let radius_mm = self.shape.radius_mm();
        let across = DVec2::from(motion.about_mm).clamp_length_max(radius_mm);
        let up = libm::sqrt((radius_mm * radius_mm - across.length_squared()).max(0.0));
        let about_mm = chart.locate_site(self.shape.site(across.extend(up), 0.0));
        Motion { shift_mm, about_mm, ..motion }
    }
}
