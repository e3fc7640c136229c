//! Capture along the normals of a curved gel: how far the object reaches below its surface, on a chart of it.
//!
//! All normals of a ball come from its centre, so that a triangle is met by the normals between three planes through its
//! edges and that centre. Two triangles that share an edge share its plane, to the bit: there is no gap between them. Normals of
//! a cylinder come from its axis; what a plane is then moved by along that is the same for both triangles, too. Normals of a mesh
//! come from nowhere in common (`lines.rs`).

use std::sync::{Arc, OnceLock};

use glam::{DMat3, DVec3};

use super::blocks::{Groups, apart};
use super::lines::Lines;
use super::places::Places;
use super::{Depth, Window, limited};
use crate::base::chart::{Chart, Latitude};
use crate::base::gel::GelShape;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::mesh::clusters::Clusters;
use crate::mesh::nearest::{nearest_of_box, nearest_of_triangle, triangles};
use crate::pose::Pose;

/// How far from its middle a chart is used, rad: beyond, it is wider than the gel three times over.
const MOST_TURN: f64 = 2.3;

/// Nodes on a side of the blocks in which the normals of a capsule are looked through.
const BLOCK: usize = 8;

/// The normals of the gel at the nodes of charts.
#[derive(Debug)]
pub struct Normals {
    shape: GelShape,
    view: View,
    width: usize,
    height: usize,
    margin_px: usize,
    /// Of a mesh's chart around its tip, once it is asked for.
    at_tip: OnceLock<Lines>,
    /// Of each latitude, once it is asked for: the same all around the gel. A dome has one, the same everywhere.
    latitudes: Vec<OnceLock<Nodes>>,
}

/// The nodes of the charts of one latitude, before their turn about the gel's middle.
#[derive(Debug)]
struct Nodes {
    width: usize,
    mm_per_px: [f64; 2],
    radius_mm: f64,
    /// x, y and z of each node's normal.
    planes: [Vec<f64>; 3],
    /// How far below the ball's middle they are, mm; empty on a dome.
    below_mm: Vec<f64>,
    blocks: Vec<Block>,
}

/// Some nodes of a capsule.
#[derive(Debug)]
struct Block {
    columns_and_rows: [[usize; 2]; 2],
    /// Of their normals.
    normals: [DVec3; 2],
    /// Of how far they are below the ball's middle.
    below_mm: [f64; 2],
}

impl Normals {
    /// Of charts with the nodes of `view` and so many more on every side.
    pub fn new(shape: &GelShape, view: &View, margin_px: usize) -> Self {
        let [width, height] = view.resolution_px.map(|px| px + 2 * margin_px);
        let latitudes = shape.wall_mm().map_or(1, |_| Latitude::count(shape));
        let latitudes = (0..latitudes).map(|_| OnceLock::new()).collect();
        Self { shape: shape.clone(), view: *view, width, height, margin_px, at_tip: OnceLock::new(), latitudes }
    }

    /// How far `object` reaches below the gel along the normals of a chart, limited to `thickness_mm`.
    pub fn capture(&self, object: &Clusters, pose: &Pose, chart: &Chart, window: Window, thickness_mm: f64) -> Depth {
        if let Some(geodesics) = chart.geodesics() {
            let place = |node: [usize; 2]| self.place(node);
            let (size, places) =
                ([self.width, self.height], Places { chart, place: &place, pitch_mm: self.view.mm_per_px });
            let at_tip = self.shape.surface().is_some_and(|surface| Arc::ptr_eq(surface.around_tip(), geodesics));
            if !at_tip {
                return self.capture_at(&places, size, object, pose, window, thickness_mm);
            }
            let lines = self.at_tip.get_or_init(|| Lines::new(geodesics, size, &places));
            let heights = lines.heights(object, pose, (geodesics, &places), window, thickness_mm);
            return limited(heights, self.margin_px, thickness_mm);
        }
        let number = chart.latitude().number();
        let nodes = self.latitudes[number].get_or_init(|| self.nodes(number));
        let heights = self.heights(nodes, chart.turn().transpose(), object, pose, window.above_mm);
        limited(heights, self.margin_px, thickness_mm)
    }

    /// The same at any places, so many columns and rows of them.
    pub fn capture_at(
        &self,
        places: &Places<'_>,
        size: [usize; 2],
        object: &Clusters,
        pose: &Pose,
        window: Window,
        thickness_mm: f64,
    ) -> Depth {
        if let Some(geodesics) = places.chart.geodesics() {
            let lines = Lines::new(geodesics, size, places);
            let heights = lines.heights(object, pose, (geodesics, places), window, thickness_mm);
            return limited(heights, window.margin_px, thickness_mm);
        }
        let mut nodes = self.nodes_of(places.chart, size, places.place);
        nodes.below_mm.resize(nodes.planes[0].len(), 0.0);
        nodes.blocks = nodes.in_blocks();
        let heights = self.heights(&nodes, DMat3::IDENTITY, object, pose, window.above_mm);
        limited(heights, window.margin_px, thickness_mm)
    }

    /// How far the object is from the gel along the normals of nodes, up to a height; `back` turns the sensor's axes to theirs.
    fn heights(&self, nodes: &Nodes, back: DMat3, object: &Clusters, pose: &Pose, above_mm: f64) -> Grid<f32> {
        let farthest = nodes.radius_mm + above_mm;
        // Relative to the ball's centre, before the chart's turn.
        let turn = back * pose.rotation;
        let centre = DVec3::from_array(object.centre_mm());
        let shift = back * (pose.rotation * centre + pose.translation_mm + DVec3::new(0.0, 0.0, nodes.radius_mm));
        let from = turn.transpose() * -shift;
        let mut distances = vec![farthest; nodes.planes[0].len()];
        let wall_mm = self.shape.wall_mm().unwrap_or(0.0);
        if nodes.blocks.is_empty() {
            object.query(
                |min, max| from.distance_squared(nearest_of_box(from, min, max)) <= farthest * farthest,
                |part| {
                    for triangle in triangles(part) {
                        let corners = triangle.map(|corner| turn * corner + shift);
                        let [a, b, c] = corners;
                        let nearest = nearest_of_triangle(DVec3::ZERO, a, b, c).length();
                        let box_px = nodes.around(corners);
                        if nearest > farthest {
                            continue;
                        }
                        // Of a triangle that is seen edge on, rounding decides where along a normal it is met.
                        let range = [nearest, a.length().max(b.length()).max(c.length())];
                        simd_dispatch(
                            #[inline(always)]
                            || nodes.meet::<false>(corners, range, box_px, &mut distances),
                        );
                    }
                },
            )
        } else {
            let boxes: Vec<[DVec3; 2]> = nodes.blocks.iter().map(|block| block.reach(farthest)).collect();
            let groups = Groups::new(&boxes);
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
                    groups.near_part(&boxes, part, |corner| turn * corner + shift, &mut corners, &mut near);
                    if near.is_empty() {
                        return;
                    }
                    for triangle in part.corners {
                        let corners = triangle.map(|corner| corners[usize::from(corner)]);
                        let [a, b, c] = corners;
                        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
                        // A ball around it that stays away from the axis is met by no normal in reach.
                        let (middle, half) = (0.5 * (min + max), 0.5 * (max - min).length());
                        let from_axis = middle - DVec3::new(0.0, 0.0, middle.z.clamp(-wall_mm, 0.0));
                        if from_axis.length() - half > farthest {
                            continue;
                        }
                        for number in near.iter().filter(|number| !apart([min, max], boxes[**number])) {
                            let box_px = nodes.blocks[*number].columns_and_rows;
                            simd_dispatch(
                                #[inline(always)]
                                || nodes.meet::<true>(corners, [0.0, farthest], box_px, &mut distances),
                            );
                        }
                    }
                },
            );
        }
        // Below the ball's middle a dome has no gel.
        let up = back * DVec3::Z;
        let [nx, ny, nz] = nodes.planes.each_ref().map(|plane| &plane[..distances.len()]);
        let mut data = vec![0.0; distances.len()];
        let (heights, distances) = (&mut data[..], &distances[..]);
        simd_dispatch(
            #[inline(always)]
            move || {
                for at in 0..distances.len() {
                    let on_gel = up.x * nx[at] + up.y * ny[at] + up.z * nz[at] >= 0.0;
                    let height = distances[at] - nodes.radius_mm;
                    // What is out of reach is exactly that.
                    heights[at] = (if on_gel & (distances[at] < farthest) { height } else { above_mm }) as f32;
                }
            },
        );
        Grid { width: nodes.width, height: nodes.height(), data }
    }

    /// The nodes of a latitude.
    fn nodes(&self, number: usize) -> Nodes {
        let chart = Chart::before_turn(&self.shape, number);
        let mut nodes = self.nodes_of(&chart, [self.width, self.height], &|node| self.place(node));
        if self.shape.wall_mm().is_some() {
            nodes.blocks = nodes.in_blocks();
        }
        nodes
    }

    /// Where a node is on its chart, mm.
    fn place(&self, node: [usize; 2]) -> [f64; 2] {
        self.view.point_mm(node.map(|at| at as f64 + 0.5 - self.margin_px as f64))
    }

    /// Those at some places of a chart.
    fn nodes_of(&self, chart: &Chart, [width, height]: [usize; 2], place: &dyn Fn([usize; 2]) -> [f64; 2]) -> Nodes {
        let (radius_mm, wall_mm) = (self.shape.radius_mm(), self.shape.wall_mm());
        let mut planes = [(); 3].map(|()| Vec::with_capacity(width * height));
        let mut below_mm = Vec::with_capacity(if wall_mm.is_some() { width * height } else { 0 });
        for y in 0..height {
            for x in 0..width {
                let at = place([x, y]);
                let rest = chart.rest(at);
                // No comparison is true of what is no number.
                let known = libm::hypot(at[0], at[1]) < MOST_TURN * radius_mm || wall_mm.is_some();
                let known = known && rest.below_mm <= wall_mm.unwrap_or(0.0);
                let normal = if known { rest.normal.to_array() } else { [f64::NAN; 3] };
                planes.iter_mut().zip(normal).for_each(|(plane, value)| plane.push(value));
                if wall_mm.is_some() {
                    below_mm.push(rest.below_mm);
                }
            }
        }
        Nodes { width, mm_per_px: self.view.mm_per_px, radius_mm, planes, below_mm, blocks: Vec::new() }
    }
}

impl Block {
    /// A box around what the normals of its nodes pass up to so far from the axis.
    fn reach(&self, farthest: f64) -> [DVec3; 2] {
        let [low, high] = self.normals.map(|side| farthest * side);
        let [least, most] = self.below_mm;
        let axis = |below_mm: f64| DVec3::new(0.0, 0.0, -below_mm);
        [low.min(DVec3::ZERO) + axis(most), high.max(DVec3::ZERO) + axis(least)]
    }
}

impl Nodes {
    fn height(&self) -> usize {
        self.planes[0].len() / self.width
    }

    fn in_blocks(&self) -> Vec<Block> {
        let mut blocks = Vec::new();
        for y0 in (0..self.height()).step_by(BLOCK) {
            for x0 in (0..self.width).step_by(BLOCK) {
                let (x1, y1) = ((x0 + BLOCK).min(self.width), (y0 + BLOCK).min(self.height()));
                let infinite = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                let (mut normals, mut below_mm) = (infinite, [f64::INFINITY, f64::NEG_INFINITY]);
                let nodes = (y0..y1).flat_map(|y| (y * self.width + x0)..(y * self.width + x1));
                for at in nodes.filter(|at| !self.planes[0][*at].is_nan()) {
                    let normal = DVec3::from_array(self.planes.each_ref().map(|plane| plane[at]));
                    normals = [normals[0].min(normal), normals[1].max(normal)];
                    below_mm = [below_mm[0].min(self.below_mm[at]), below_mm[1].max(self.below_mm[at])];
                }
                if below_mm[0] <= below_mm[1] {
                    blocks.push(Block { columns_and_rows: [[x0, x1], [y0, y1]], normals, below_mm });
                }
            }
        }
        blocks
    }

    /// Columns and rows of the nodes whose normals may meet a triangle, half open.
    fn around(&self, corners: [DVec3; 3]) -> [[usize; 2]; 2] {
        let everywhere = [[0, self.width], [0, self.height()]];
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
        [side(0, self.width), side(1, self.height())]
    }

    /// Keeps the distances from the axis, all of which are in a range, at which normals meet a triangle, where it is closer
    /// than what was there.
    #[inline(always)]
    fn meet<const WALLED: bool>(
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
            let [nx, ny, nz] = [0, 1, 2].map(|k| &self.planes[k][row.clone()]);
            let below = if WALLED { &self.below_mm[row.clone()] } else { nx };
            let nodes = distances[row].iter_mut().zip(nx).zip(ny).zip(nz).zip(below);
            for ((((to, x), y), z), below) in nodes {
                let along = |side: DVec3| side.x * x + side.y * y + side.z * z;
                // What the plane through an edge and the ball's centre gets by going down the axis.
                let lowered = |edge: DVec3| if WALLED { below * (edge.x * y - edge.y * x) } else { 0.0 };
                let side = |side: DVec3, edge: DVec3| if WALLED { along(side) + lowered(edge) } else { along(side) };
                let (p, q, r) = (side(ab, edges[0]), side(bc, edges[1]), side(ca, edges[2]));
                let within = (p.min(q).min(r) >= 0.0) | (p.max(q).max(r) <= 0.0);
                let volume = if WALLED { volume + below * normal.z } else { volume };
                let distance = volume / along(normal);
                let distance = match WALLED {
                    // No farther along the normal than the farthest corner, and no nearer than the nearest one.
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
