//! Capture along the normals of a gel that is a mesh: each node of a chart has its own line.
//!
//! Pluecker coordinates of line and edge tell on which side of a triangle's edge a line passes. Two triangles that
//! share an edge get the same number with opposite signs, to the bit, so there is no gap between them.

use glam::DVec3;
use once_cell::race::OnceBox;

use super::CaptureWindow;
use super::chart_grid::ChartGrid;
use super::node_blocks::{BlockGroups, are_disjoint};
use crate::base::gel_surface::geodesic_chart::GeodesicChart;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;
use crate::mesh::clusters::Clusters;
use crate::pose::Pose;

/// Nodes along a side of a block.
const BLOCK_SIDE: usize = 8;
/// How far below the gel's surface lines begin, in thicknesses.
pub const START_DEPTH: f64 = 2.0;

/// The lines of a chart's nodes, in blocks.
#[derive(Debug)]
pub(super) struct NormalLines {
    width: usize,
    height: usize,
    blocks: Vec<LineBlock>,
}

#[derive(Debug)]
struct LineBlock {
    columns_and_rows: [[usize; 2]; 2],
    /// Boxes around the positions of the nodes, and around their normals.
    points: [DVec3; 2],
    normals: [DVec3; 2],
    /// True if some nodes may lie beyond the gel.
    at_rim: bool,
    /// The lines, made when they are first needed.
    bundle: OnceBox<LineBundle>,
}

/// Lines through the nodes of a block, row by row: directions, moments, and the positions of the nodes along them. NaN
/// beyond the gel.
#[derive(Debug)]
struct LineBundle {
    directions: [[f64; BLOCK_SIDE * BLOCK_SIDE]; 3],
    moments: [[f64; BLOCK_SIDE * BLOCK_SIDE]; 3],
    offsets: [f64; BLOCK_SIDE * BLOCK_SIDE],
}

impl NormalLines {
    /// Makes the lines of `width` x `height` points of a chart.
    pub fn new(chart: &GeodesicChart, [width, height]: [usize; 2], places: &ChartGrid<'_>) -> Self {
        let [columns, rows] = [width, height].map(|nodes| nodes.div_ceil(BLOCK_SIDE) + 1);
        let [spacing_x, spacing_y] = places.spacing_mm;
        let spacing_mm = spacing_x.max(spacing_y);
        let size_mm = BLOCK_SIDE as f64 * libm::hypot(spacing_x, spacing_y);
        let corner = |number: usize| {
            let at = (places.position_mm)([number % columns * BLOCK_SIDE, number / columns * BLOCK_SIDE]);
            let rest = chart.surface_frame(at);
            let near = chart.is_on_gel(at, BLOCK_SIDE as f64 * spacing_mm);
            (rest.point_mm, rest.normal, near, near && chart.is_on_gel(at, -size_mm))
        };
        let corners: Vec<_> = (0..columns * rows).map(corner).collect();
        let mut blocks = Vec::new();
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let around = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| corners[(row + y) * columns + column + x]);
                if !around.iter().any(|(_, _, near, _)| *near) {
                    continue;
                }
                let low_high = |of: &dyn Fn(usize) -> DVec3| {
                    (0..4)
                        .map(of)
                        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
                };
                let [low, high] = low_high(&|k| around[k].0);
                let [down, up] = low_high(&|k| around[k].1);
                // Bounds of a block come from its corners; between these the gel bulges no more than their normals
                // differ.
                let spread = (up - down).length();
                let bulge = DVec3::splat((high - low).length() * (0.25 * spread + 0.05));
                let lean = DVec3::splat(0.25 * spread + 1e-3);
                let side = |at: usize, count: usize| [at * BLOCK_SIDE, ((at + 1) * BLOCK_SIDE).min(count)];
                blocks.push(LineBlock {
                    columns_and_rows: [side(column, width), side(row, height)],
                    points: [low - bulge, high + bulge],
                    normals: [down - lean, up + lean],
                    at_rim: around.iter().any(|(_, _, _, inside)| !inside),
                    bundle: OnceBox::new(),
                });
            }
        }
        Self { width, height, blocks }
    }

    /// Returns the height of `object` over the gel along each line, mm, up to the window's height. `places` must be
    /// those that the lines were made for.
    pub fn capture_heights(
        &self,
        object: &Clusters,
        pose: &Pose,
        (chart, places): (&GeodesicChart, &ChartGrid<'_>),
        window: CaptureWindow,
        thickness_mm: f64,
    ) -> Grid<f32> {
        let reach = [-START_DEPTH * thickness_mm, window.above_mm];
        let shift = pose.rotation * DVec3::from_array(object.centre_mm()) + pose.translation_mm;
        let boxes: Vec<[DVec3; 2]> = self.blocks.iter().map(|block| block.reach_box(reach)).collect();
        let groups = BlockGroups::new(&boxes);
        let [least, most] = groups.bounds();
        let (mut corners, mut near) = (Vec::new(), Vec::new());
        let mut distances = vec![reach[1]; self.width * self.height];
        object.query(
            |min, max| {
                let [min, max] = [min, max].map(|side| DVec3::from_array(side.map(f64::from)));
                let (middle, half) = (pose.rotation * (0.5 * (min + max)) + shift, (0.5 * (max - min)).length());
                middle.cmpge(least - half).all() && middle.cmple(most + half).all()
            },
            |part| {
                groups.find_blocks_near(&boxes, part, |corner| pose.rotation * corner + shift, &mut corners, &mut near);
                if near.is_empty() {
                    return;
                }
                for triangle in part.corners {
                    let corners = triangle.map(|corner| corners[usize::from(corner)]);
                    let [a, b, c] = corners;
                    let here = [a.min(b).min(c), a.max(b).max(c)];
                    for number in near.iter().filter(|number| !are_disjoint(here, boxes[**number])) {
                        let block = &self.blocks[*number];
                        let bundle = block.bundle.get_or_init(|| Box::new(make_bundle(block, chart, places)));
                        let nodes = block.columns_and_rows;
                        simd_dispatch(
                            #[inline(always)]
                            || bundle.intersect_triangle(corners, reach[0], nodes, &mut distances, self.width),
                        );
                    }
                }
            },
        );
        let data = distances.into_iter().map(|distance| distance as f32).collect();
        Grid { width: self.width, height: self.height, data }
    }
}

fn make_bundle(block: &LineBlock, chart: &GeodesicChart, places: &ChartGrid<'_>) -> LineBundle {
    let nothing = [f64::NAN; BLOCK_SIDE * BLOCK_SIDE];
    let mut bundle = LineBundle { directions: [nothing; 3], moments: [nothing; 3], offsets: nothing };
    let [[x0, x1], [y0, y1]] = block.columns_and_rows;
    for (y, x) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (y, x))) {
        let at = (places.position_mm)([x, y]);
        if block.at_rim && !chart.is_on_gel(at, 0.0) {
            continue;
        }
        let rest = chart.surface_frame(at);
        let moment = rest.point_mm.cross(rest.normal);
        let number = (y - y0) * BLOCK_SIDE + x - x0;
        for k in 0..3 {
            bundle.directions[k][number] = rest.normal[k];
            bundle.moments[k][number] = moment[k];
        }
        bundle.offsets[number] = rest.point_mm.dot(rest.normal);
    }
    bundle
}

impl LineBlock {
    /// Returns a box around everything that the block's lines pass within a range of distances from the gel.
    fn reach_box(&self, [least, most]: [f64; 2]) -> [DVec3; 2] {
        let ends = [least, most].map(|distance| self.normals.map(|side| distance * side));
        let [[a, b], [c, d]] = ends;
        [self.points[0] + a.min(b).min(c).min(d), self.points[1] + a.max(b).max(c).max(d)]
    }
}

impl LineBundle {
    /// Updates the lines' distances from the gel (at least `least`) to their hits on a triangle, where these are
    /// closer.
    #[inline(always)]
    fn intersect_triangle(
        &self,
        [a, b, c]: [DVec3; 3],
        least: f64,
        [[x0, x1], [y0, y1]]: [[usize; 2]; 2],
        distances: &mut [f64],
        width: usize,
    ) {
        let edges = [b - a, c - b, a - c];
        let sides = [a.cross(b), b.cross(c), c.cross(a)];
        for y in y0..y1 {
            let row = &mut distances[y * width + x0..y * width + x1];
            let nodes = (y - y0) * BLOCK_SIDE..(y - y0) * BLOCK_SIDE + row.len();
            let [nx, ny, nz] = self.directions.each_ref().map(|plane| &plane[nodes.clone()]);
            let [mx, my, mz] = self.moments.each_ref().map(|plane| &plane[nodes.clone()]);
            let lines = row.iter_mut().zip(nx).zip(ny).zip(nz).zip(mx).zip(my).zip(mz).zip(&self.offsets[nodes]);
            for (((((((to, x), y), z), u), v), w), along) in lines {
                let towards = |side: DVec3| side.x * x + side.y * y + side.z * z;
                let passes = |k: usize| towards(sides[k]) + (edges[k].x * u + edges[k].y * v + edges[k].z * w);
                let (p, q, r) = (passes(0), passes(1), passes(2));
                // Bitwise operators instead of short-circuit ones: without branches the loop vectorises.
                let within = (p.min(q).min(r) >= 0.0) | (p.max(q).max(r) <= 0.0);
                let distance = (q * towards(a) + r * towards(b) + p * towards(c)) / (p + q + r) - along;
                let closer = within & (distance >= least) & (distance < *to);
                *to = if closer { distance } else { *to };
            }
        }
    }
}
