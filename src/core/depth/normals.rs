//! Capture along the normals of a curved gel: how far the object reaches below its surface, on a chart of it.
//!
//! All normals of a ball come from its centre, so that a triangle is met by the normals between three planes through its
//! edges and that centre. Two triangles that share an edge share its plane, to the bit: there is no gap between them.

use glam::DVec3;

use super::{Depth, Window, limited};
use crate::core::base::gel::{Chart, GelShape};
use crate::core::base::grid::Grid;
use crate::core::base::simd::simd_dispatch;
use crate::core::base::view::View;
use crate::core::mesh::clusters::Clusters;
use crate::core::mesh::nearest::{nearest_of_box, nearest_of_triangle, triangles};
use crate::core::pose::Pose;

/// How far from its middle a chart is used, rad: beyond, it is wider than the gel three times over.
const MOST_TURN: f64 = 2.3;

/// The normals of the gel at the nodes of a chart: the same wherever the chart's middle lies.
#[derive(Clone, Debug)]
pub struct Normals {
    width: usize,
    height: usize,
    margin_px: usize,
    mm_per_px: [f64; 2],
    radius_mm: f64,
    /// In the chart's axes: x, y and z of each node.
    planes: [Vec<f64>; 3],
}

impl Normals {
    /// Of a chart with the nodes of `view` and so many more on every side.
    pub fn new(shape: &GelShape, view: &View, margin_px: usize) -> Self {
        let [width, height] = view.resolution_px.map(|px| px + 2 * margin_px);
        let chart = Chart::at_tip(shape);
        let radius_mm = chart.radius_mm();
        let mut planes = [(); 3].map(|()| Vec::with_capacity(width * height));
        for y in 0..height {
            for x in 0..width {
                let px = [x, y].map(|at| at as f64 + 0.5 - margin_px as f64);
                let at = view.point_mm(px);
                // No comparison is true of what is no number.
                let known = libm::hypot(at[0], at[1]) < MOST_TURN * radius_mm;
                let normal = if known { chart.rest(at).normal.to_array() } else { [f64::NAN; 3] };
                planes.iter_mut().zip(normal).for_each(|(plane, value)| plane.push(value));
            }
        }
        Self { width, height, margin_px, mm_per_px: view.mm_per_px, radius_mm, planes }
    }

    /// How far `object` reaches below the gel along the normals of a chart, limited to `thickness_mm`.
    pub fn capture(&self, object: &Clusters, pose: &Pose, chart: &Chart, window: Window, thickness_mm: f64) -> Depth {
        let farthest = self.radius_mm + window.above_mm;
        // Relative to the ball's centre, in the chart's axes.
        let turn = chart.axes().transpose() * pose.rotation;
        let centre = DVec3::from_array(object.centre_mm());
        let shift = chart.axes().transpose()
            * (pose.rotation * centre + pose.translation_mm + DVec3::new(0.0, 0.0, self.radius_mm));
        let from = turn.transpose() * -shift;
        let mut distances = vec![farthest; self.width * self.height];
        object.query(
            |min, max| from.distance_squared(nearest_of_box(from, min, max)) <= farthest * farthest,
            |part| {
                for triangle in triangles(part) {
                    let corners = triangle.map(|corner| turn * corner + shift);
                    let [a, b, c] = corners;
                    let nearest = nearest_of_triangle(DVec3::ZERO, a, b, c).length();
                    let box_px = self.around(corners);
                    if nearest > farthest {
                        continue;
                    }
                    // Of a triangle that is seen edge on, rounding decides where along a normal it is met.
                    let range = [nearest, a.length().max(b.length()).max(c.length())];
                    simd_dispatch(
                        #[inline(always)]
                        || self.meet(corners, range, box_px, &mut distances),
                    );
                }
            },
        );
        // Below the ball's middle there is no gel.
        let up = chart.axes().transpose() * DVec3::Z;
        let [nx, ny, nz] = &self.planes;
        let heights = distances.into_iter().zip(nx).zip(ny).zip(nz).map(|(((distance, x), y), z)| {
            let on_gel = up.x * x + up.y * y + up.z * z >= 0.0;
            (if on_gel { distance } else { farthest } - self.radius_mm) as f32
        });
        let data = heights.collect();
        limited(Grid { width: self.width, height: self.height, data }, self.margin_px, thickness_mm)
    }

    /// Columns and rows of the nodes whose normals may meet a triangle, half open.
    fn around(&self, corners: [DVec3; 3]) -> [[usize; 2]; 2] {
        let everywhere = [[0, self.width], [0, self.height]];
        let directions = corners.map(|corner| corner.normalize_or_zero());
        let middle = (directions[0] + directions[1] + directions[2]).normalize_or_zero();
        let angle = |direction: &DVec3| libm::atan2(middle.cross(*direction).length(), middle.dot(*direction));
        let reach = directions.iter().map(angle).fold(0.0, f64::max);
        let from_pole = libm::atan2(libm::hypot(middle.x, middle.y), middle.z);
        let outermost = from_pole + reach;
        // A triangle that is seen under a wide angle, or that is behind the gel's base.
        if reach > 1.2 || outermost > MOST_TURN || middle == DVec3::ZERO {
            return everywhere;
        }
        // Off its middle the chart is wider than the gel by angle / sin(angle).
        let wider = if outermost > 1e-6 { outermost / libm::sin(outermost) } else { 1.0 };
        let reach_mm = self.radius_mm * reach * wider;
        let across = libm::hypot(middle.x, middle.y);
        let per = if across > 0.0 { self.radius_mm * from_pole / across } else { 0.0 };
        let side = |k: usize, count: usize| {
            let at = [middle.x, middle.y][k] * per;
            let px = |mm: f64| mm / self.mm_per_px[k] + count as f64 / 2.0 - 0.5;
            let clamped = |px: f64| px.clamp(0.0, count as f64) as usize;
            [clamped(libm::floor(px(at - reach_mm))), clamped(libm::ceil(px(at + reach_mm)) + 1.0)]
        };
        [side(0, self.width), side(1, self.height)]
    }

    /// Keeps the distances from the centre, all of which are in a range, at which normals meet a triangle, where it is closer
    /// than what was there.
    #[inline(always)]
    fn meet(
        &self,
        [a, b, c]: [DVec3; 3],
        [least, most]: [f64; 2],
        [[x0, x1], [y0, y1]]: [[usize; 2]; 2],
        distances: &mut [f64],
    ) {
        let [ab, bc, ca] = [a.cross(b), b.cross(c), c.cross(a)];
        let normal = ab + bc + ca;
        let volume = a.dot(bc);
        for y in y0..y1 {
            let row = y * self.width + x0..y * self.width + x1;
            let [nx, ny, nz] = [0, 1, 2].map(|k| &self.planes[k][row.clone()]);
            for (((to, x), y), z) in distances[row].iter_mut().zip(nx).zip(ny).zip(nz) {
                let along = |side: DVec3| side.x * x + side.y * y + side.z * z;
                let (p, q, r) = (along(ab), along(bc), along(ca));
                let within = (p.min(q).min(r) >= 0.0) | (p.max(q).max(r) <= 0.0);
                let distance = (volume / along(normal)).clamp(least, most);
                let ahead = (volume > 0.0) == (along(normal) > 0.0);
                let closer = within & ahead & (distance < *to);
                *to = if closer { distance } else { *to };
            }
        }
    }
}
