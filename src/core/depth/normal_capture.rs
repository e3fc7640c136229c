//! Capture along the normals of a curved gel: how far the object reaches below its surface, on a chart.
//!
//! All normals of a ball come from its centre, so a normal hits a triangle if it lies between the three planes through
//! the triangle's edges and that centre. Two triangles that share an edge share its plane, to the bit, so there is no
//! gap between them. Normals of a cylinder come from its axis; the shift of a plane along the axis is the same for both
//! triangles, too. Normals of a mesh have no common origin: see `normal_lines.rs`.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use once_cell::race::OnceBox;

use super::chart_grid::ChartGrid;
use super::node_blocks::{BlockGroups, are_disjoint};
use super::normal_lines::NormalLines;
use super::{CaptureWindow, Depth, limit_to_thickness};
use crate::base::chart::{Chart, Latitude};
use crate::base::gel::GelShape;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::mesh::clusters::Clusters;
use crate::mesh::nearest::{nearest_point_on_box, nearest_point_on_triangle, part_triangles};
use crate::pose::Pose;

/// Largest angle from a chart's centre that is used, rad: beyond it, the chart is more than three times as wide as the
/// gel.
const MAX_ANGLE: f64 = 2.3;

/// Nodes along a side of the blocks into which the nodes of a capsule are divided.
const BLOCK_SIDE: usize = 8;

/// The normals of the gel at the nodes of charts.
#[derive(Debug)]
pub struct NormalCapture {
    shape: GelShape,
    view: View,
    width: usize,
    height: usize,
    margin_px: usize,
    /// Lines of a mesh's chart around its tip, made when first needed.
    tip_lines: OnceBox<NormalLines>,
    /// Nodes of each latitude, made when first needed: the same all around the gel. A dome has one latitude, the same
    /// everywhere.
    latitudes: Vec<OnceBox<ChartNodes>>,
}

/// The nodes of the charts of one latitude, before the chart's rotation.
#[derive(Debug)]
struct ChartNodes {
    width: usize,
    mm_per_px: [f64; 2],
    radius_mm: f64,
    /// x, y and z of each node's normal; NaN beyond the gel.
    normals: [Vec<f64>; 3],
    /// How far each node lies below the ball's centre, mm; empty on a dome.
    below_mm: Vec<f64>,
    blocks: Vec<NodeBlock>,
}

/// A block of nodes of a capsule.
#[derive(Debug)]
struct NodeBlock {
    columns_and_rows: [[usize; 2]; 2],
    /// Smallest and largest x, y and z of the normals.
    normals: [DVec3; 2],
    /// Smallest and largest distance below the ball's centre.
    below_mm: [f64; 2],
}

impl NormalCapture {
    /// Prepares charts with the nodes of `view` and `margin_px` more on every side.
    pub fn new(shape: &GelShape, view: &View, margin_px: usize) -> Self {
        let [width, height] = view.resolution_px.map(|px| px + 2 * margin_px);
        let latitudes = shape.wall_mm().map_or(1, |_| Latitude::count_on(shape));
        let latitudes = (0..latitudes).map(|_| OnceBox::new()).collect();
        Self { shape: shape.clone(), view: *view, width, height, margin_px, tip_lines: OnceBox::new(), latitudes }
    }

    /// Returns how far `object` reaches below the gel along the normals of a chart, limited to `thickness_mm`.
    pub fn capture(
        &self,
        object: &Clusters,
        pose: &Pose,
        chart: &Chart,
        window: CaptureWindow,
        thickness_mm: f64,
    ) -> Depth {
        if let Some(geodesics) = chart.geodesics() {
            let place = |node: [usize; 2]| self.node_position_mm(node);
            let (size, places) =
                ([self.width, self.height], ChartGrid { chart, position_mm: &place, spacing_mm: self.view.mm_per_px });
            let at_tip = self.shape.surface().is_some_and(|surface| Arc::ptr_eq(surface.tip_chart(), geodesics));
            if !at_tip {
                return self.capture_at(&places, size, object, pose, window, thickness_mm);
            }
            let lines = self.tip_lines.get_or_init(|| Box::new(NormalLines::new(geodesics, size, &places)));
            let heights = lines.capture_heights(object, pose, (geodesics, &places), window, thickness_mm);
            return limit_to_thickness(heights, self.margin_px, thickness_mm);
        }
        let number = chart.latitude().index();
        let nodes = self.latitudes[number].get_or_init(|| Box::new(self.latitude_nodes(number)));
        let heights = self.capture_heights(nodes, chart.base_rotation().transpose(), object, pose, window.above_mm);
        limit_to_thickness(heights, self.margin_px, thickness_mm)
    }

    /// Returns how far `object` reaches below the gel along the normals at `size` columns and rows of points on a
    /// chart, limited to `thickness_mm`.
    pub fn capture_at(
        &self,
        places: &ChartGrid<'_>,
        size: [usize; 2],
        object: &Clusters,
        pose: &Pose,
        window: CaptureWindow,
        thickness_mm: f64,
    ) -> Depth {
        if let Some(geodesics) = places.chart.geodesics() {
            let lines = NormalLines::new(geodesics, size, places);
            let heights = lines.capture_heights(object, pose, (geodesics, places), window, thickness_mm);
            return limit_to_thickness(heights, window.margin_px, thickness_mm);
        }
        let mut nodes = self.nodes_at(places.chart, size, places.position_mm);
        nodes.below_mm.resize(nodes.normals[0].len(), 0.0);
        nodes.blocks = nodes.split_into_blocks();
        let heights = self.capture_heights(&nodes, DMat3::IDENTITY, object, pose, window.above_mm);
        limit_to_thickness(heights, window.margin_px, thickness_mm)
    }

    /// Returns the height of the object over the gel along the normals of nodes, mm, up to `above_mm`; `back` rotates
    /// the sensor's axes to the nodes'.
    fn capture_heights(
        &self,
        nodes: &ChartNodes,
        back: DMat3,
        object: &Clusters,
        pose: &Pose,
        above_mm: f64,
    ) -> Grid<f32> {
        let farthest = nodes.radius_mm + above_mm;
        // All points are relative to the ball's centre, in the nodes' axes.
        let turn = back * pose.rotation;
        let centre = DVec3::from_array(object.centre_mm());
        let shift = back * (pose.rotation * centre + pose.translation_mm + DVec3::new(0.0, 0.0, nodes.radius_mm));
        let from = turn.transpose() * -shift;
        let mut distances = vec![farthest; nodes.normals[0].len()];
        let wall_mm = self.shape.wall_mm().unwrap_or(0.0);
        if nodes.blocks.is_empty() {
            object.query(
                |min, max| from.distance_squared(nearest_point_on_box(from, min, max)) <= farthest * farthest,
                |part| {
                    for triangle in part_triangles(part) {
                        let corners = triangle.map(|corner| turn * corner + shift);
                        let [a, b, c] = corners;
                        let nearest = nearest_point_on_triangle(DVec3::ZERO, a, b, c).length();
                        let box_px = nodes.nodes_near_triangle(corners);
                        if nearest > farthest {
                            continue;
                        }
                        // For a triangle seen edge-on, rounding decides where along a normal it is hit; the range of
                        // its distances limits that.
                        let range = [nearest, a.length().max(b.length()).max(c.length())];
                        simd_dispatch(
                            #[inline(always)]
                            || nodes.intersect_triangle::<false>(corners, range, box_px, &mut distances),
                        );
                    }
                },
            )
        } else {
            let boxes: Vec<[DVec3; 2]> = nodes.blocks.iter().map(|block| block.reach_box(farthest)).collect();
            let groups = BlockGroups::new(&boxes);
            let (mut corners, mut near) = (Vec::new(), Vec::new());
            let least = DVec3::new(-farthest, -farthest, -wall_mm - farthest);
            let most = DVec3::splat(farthest);
            object.query(
                |min, max| {
                    let [min, max] = [min, max].map(|side| DVec3::from_array(side.map(f64::from)));
                    let (middle, half) = (turn * (0.5 * (min + max)) + shift, (0.5 * (max - min)).length());
                    middle.cmpge(least - half).all() && middle.cmple(most + half).all()
                },
                |part| {
                    groups.find_blocks_near(&boxes, part, |corner| turn * corner + shift, &mut corners, &mut near);
                    if near.is_empty() {
                        return;
                    }
                    for triangle in part.corners {
                        let corners = triangle.map(|corner| corners[usize::from(corner)]);
                        let [a, b, c] = corners;
                        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
                        // If the ball around a triangle stays away from the axis, no normal reaches the triangle.
                        let (middle, half) = (0.5 * (min + max), 0.5 * (max - min).length());
                        let from_axis = middle - DVec3::new(0.0, 0.0, middle.z.clamp(-wall_mm, 0.0));
                        if from_axis.length() - half > farthest {
                            continue;
                        }
                        for number in near.iter().filter(|number| !are_disjoint([min, max], boxes[**number])) {
                            let box_px = nodes.blocks[*number].columns_and_rows;
                            simd_dispatch(
                                #[inline(always)]
                                || nodes.intersect_triangle::<true>(corners, [0.0, farthest], box_px, &mut distances),
                            );
                        }
                    }
                },
            );
        }
        // Below the ball's centre a dome has no gel.
        let up = back * DVec3::Z;
        let [nx, ny, nz] = nodes.normals.each_ref().map(|plane| &plane[..distances.len()]);
        let mut data = vec![0.0; distances.len()];
        let (heights, distances) = (&mut data[..], &distances[..]);
        simd_dispatch(
            #[inline(always)]
            move || {
                for at in 0..distances.len() {
                    let on_gel = up.x * nx[at] + up.y * ny[at] + up.z * nz[at] >= 0.0;
                    let height = distances[at] - nodes.radius_mm;
                    // Nodes out of reach get exactly `above_mm`.
                    heights[at] = (if on_gel & (distances[at] < farthest) { height } else { above_mm }) as f32;
                }
            },
        );
        Grid { width: nodes.width, height: nodes.height(), data }
    }

    /// Makes the nodes of a latitude.
    fn latitude_nodes(&self, number: usize) -> ChartNodes {
        let chart = Chart::before_rotation(&self.shape, number);
        let mut nodes = self.nodes_at(&chart, [self.width, self.height], &|node| self.node_position_mm(node));
        if self.shape.wall_mm().is_some() {
            nodes.blocks = nodes.split_into_blocks();
        }
        nodes
    }

    /// Returns the position of a node on its chart, mm.
    fn node_position_mm(&self, node: [usize; 2]) -> [f64; 2] {
        self.view.point_mm(node.map(|at| at as f64 + 0.5 - self.margin_px as f64))
    }

    /// Makes the nodes at `width` x `height` points of a chart.
    fn nodes_at(
        &self,
        chart: &Chart,
        [width, height]: [usize; 2],
        place: &dyn Fn([usize; 2]) -> [f64; 2],
    ) -> ChartNodes {
        let (radius_mm, wall_mm) = (self.shape.radius_mm(), self.shape.wall_mm());
        let mut normals = [(); 3].map(|()| Vec::with_capacity(width * height));
        let mut below_mm = Vec::with_capacity(if wall_mm.is_some() { width * height } else { 0 });
        for y in 0..height {
            for x in 0..width {
                let at = place([x, y]);
                let rest = chart.surface_frame(at);
                // Comparisons with NaN are false, so that points outside a mesh's chart are unknown.
                let known = libm::hypot(at[0], at[1]) < MAX_ANGLE * radius_mm || wall_mm.is_some();
                let known = known && rest.below_mm <= wall_mm.unwrap_or(0.0);
                let normal = if known { rest.normal.to_array() } else { [f64::NAN; 3] };
                normals.iter_mut().zip(normal).for_each(|(plane, value)| plane.push(value));
                if wall_mm.is_some() {
                    below_mm.push(rest.below_mm);
                }
            }
        }
        ChartNodes { width, mm_per_px: self.view.mm_per_px, radius_mm, normals, below_mm, blocks: Vec::new() }
    }
}

impl NodeBlock {
    /// Returns a box around everything that the block's normals pass up to a distance from the axis.
    fn reach_box(&self, farthest: f64) -> [DVec3; 2] {
        let [low, high] = self.normals.map(|side| farthest * side);
        let [least, most] = self.below_mm;
        let axis = |below_mm: f64| DVec3::new(0.0, 0.0, -below_mm);
        [low.min(DVec3::ZERO) + axis(most), high.max(DVec3::ZERO) + axis(least)]
    }
}

impl ChartNodes {
    fn height(&self) -> usize {
        self.normals[0].len() / self.width
    }

    fn split_into_blocks(&self) -> Vec<NodeBlock> {
        let mut blocks = Vec::new();
        for y0 in (0..self.height()).step_by(BLOCK_SIDE) {
            for x0 in (0..self.width).step_by(BLOCK_SIDE) {
                let (x1, y1) = ((x0 + BLOCK_SIDE).min(self.width), (y0 + BLOCK_SIDE).min(self.height()));
                let infinite = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                let (mut normals, mut below_mm) = (infinite, [f64::INFINITY, f64::NEG_INFINITY]);
                let nodes = (y0..y1).flat_map(|y| (y * self.width + x0)..(y * self.width + x1));
                for at in nodes.filter(|at| !self.normals[0][*at].is_nan()) {
                    let normal = DVec3::from_array(self.normals.each_ref().map(|plane| plane[at]));
                    normals = [normals[0].min(normal), normals[1].max(normal)];
                    below_mm = [below_mm[0].min(self.below_mm[at]), below_mm[1].max(self.below_mm[at])];
                }
                if below_mm[0] <= below_mm[1] {
                    blocks.push(NodeBlock { columns_and_rows: [[x0, x1], [y0, y1]], normals, below_mm });
                }
            }
        }
        blocks
    }

    /// Returns columns and rows of the nodes whose normals may hit a triangle, half open.
    fn nodes_near_triangle(&self, corners: [DVec3; 3]) -> [[usize; 2]; 2] {
        let everywhere = [[0, self.width], [0, self.height()]];
        let directions = corners.map(|corner| corner.normalize_or_zero());
        let middle = (directions[0] + directions[1] + directions[2]).normalize_or_zero();
        let angle = |direction: &DVec3| libm::atan2(middle.cross(*direction).length(), middle.dot(*direction));
        let reach = directions.iter().map(angle).fold(0.0, f64::max);
        let from_pole = libm::atan2(libm::hypot(middle.x, middle.y), middle.z);
        let outermost = from_pole + reach;
        // The triangle is seen under a wide angle, or it is behind the gel's base.
        if reach > 1.2 || outermost > MAX_ANGLE || middle == DVec3::ZERO {
            return everywhere;
        }
        // Away from its centre the chart is wider than the gel by angle / sin(angle).
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
        [side(0, self.width), side(1, self.height())]
    }

    /// Updates the nodes' distances from the axis to their hits on a triangle, where these are closer. On a dome,
    /// distances are limited to the range `least` to `most`.
    #[inline(always)]
    fn intersect_triangle<const WALLED: bool>(
        &self,
        [a, b, c]: [DVec3; 3],
        [least, most]: [f64; 2],
        [[x0, x1], [y0, y1]]: [[usize; 2]; 2],
        distances: &mut [f64],
    ) {
        let [ab, bc, ca] = [a.cross(b), b.cross(c), c.cross(a)];
        let normal = ab + bc + ca;
        let volume = a.dot(bc);
        let edges = [b - a, c - b, a - c];
        for y in y0..y1 {
            let row = y * self.width + x0..y * self.width + x1;
            let [nx, ny, nz] = [0, 1, 2].map(|k| &self.normals[k][row.clone()]);
            let below = if WALLED { &self.below_mm[row.clone()] } else { nx };
            let nodes = distances[row].iter_mut().zip(nx).zip(ny).zip(nz).zip(below);
            for ((((to, x), y), z), below) in nodes {
                let along = |side: DVec3| side.x * x + side.y * y + side.z * z;
                // The shift of the plane through an edge and the ball's centre for a node below that centre.
                let lowered = |edge: DVec3| if WALLED { below * (edge.x * y - edge.y * x) } else { 0.0 };
                let side = |side: DVec3, edge: DVec3| if WALLED { along(side) + lowered(edge) } else { along(side) };
                let (p, q, r) = (side(ab, edges[0]), side(bc, edges[1]), side(ca, edges[2]));
                // Bitwise operators instead of short-circuit ones: without branches the loop vectorises.
                let within = (p.min(q).min(r) >= 0.0) | (p.max(q).max(r) <= 0.0);
                let volume = if WALLED { volume + below * normal.z } else { volume };
                let distance = volume / along(normal);
                let distance = match WALLED {
                    // Rounding must not put a hit nearer along the normal than the nearest corner, nor farther than the
                    // farthest.
                    true => {
                        let [a, b, c] = [along(a), along(b), along(c)];
                        distance.max(a.min(b).min(c)).min(a.max(b).max(c))
                    }
                    false => distance.clamp(least, most),
                };
                let ahead = if WALLED { distance >= 0.0 } else { (volume > 0.0) == (along(normal) > 0.0) };
                let closer = within & ahead & (distance < *to);
                *to = if closer { distance } else { *to };
            }
        }
    }
}
