//! Slow truths about an orthographic view of triangles, in f64: a plain loop, and rays.
//!
//! `capture` works in f32: a corner's column and row are rounded by some 2^-23 of the largest number that goes into
//! them (`Scenery::blur_px`, about 1e-4 px for bundled objects). So a pixel near a silhouette may see either side,
//! and the height on a slope moves by the slope times that. [`Scenery::bounds`] turns this into two numbers that the
//! captured height must lie between at every pixel, silhouettes and slivers included; away from them they are
//! within 1e-5 mm of each other.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::Ray;

use gelsim_core::base::view::View;
use gelsim_core::pose::Placement;

use crate::shapes::Shape;

/// Corners as column px, row px, height mm; the pixel in column i, row j has its centre at (i + 0.5, j + 0.5).
type Triangle = [[f64; 3]; 3];

/// A placed object as the camera sees it.
pub struct Scenery {
    triangles: Vec<Triangle>,
    /// How far f32 may move a corner, px.
    blur_px: f64,
    /// How far f32 may move a height, mm.
    blur_mm: f64,
}

impl Scenery {
    /// The camera's image starts `margin` pixels left of and above the view.
    pub fn new(shape: &Shape, placement: &Placement, camera: &View, margin: usize) -> Self {
        let middle = camera.resolution_px.map(|px| px as f64 / 2.0 + margin as f64);
        let pitch = camera.mm_per_px;
        let seen = |p: [f64; 3]| [p[0] / pitch[0] + middle[0], p[1] / pitch[1] + middle[1], p[2]];
        let triangles: Vec<Triangle> = shape.placed(placement).iter().map(|corners| corners.map(seen)).collect();
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in triangles.iter().flatten() {
            for k in 0..3 {
                low[k] = low[k].min(corner[k]);
                high[k] = high[k].max(corner[k]);
            }
        }
        // The largest number on the way: the object's centre, and its size along every axis.
        let size = (0..3).map(|k| (high[k] - low[k]) * if k < 2 { pitch[k] } else { 1.0 }).fold(0.0, f64::max);
        let reach = |k: usize, scale: f64| low[k].abs().max(high[k].abs()) + 2.0 * size / scale;
        let blur_px = reach(0, pitch[0]).max(reach(1, pitch[1])) * 2.0_f64.powi(-23);
        let blur_mm = reach(2, 1.0) * 2.0_f64.powi(-22) + 1e-7;
        Self { triangles, blur_px, blur_mm }
    }

    /// Height over the pad at the centre of a pixel, 0 if nothing is lower.
    pub fn height(&self, column: usize, row: usize) -> f64 {
        self.lowest_point(column, row).min(0.0)
    }

    /// The same above the pad, too; infinite where there is nothing.
    pub fn lowest_point(&self, column: usize, row: usize) -> f64 {
        self.lowest([column as f64 + 0.5, row as f64 + 0.5], |_| 0.0)
    }

    /// The lowest of all triangles that hold the point, edges included.
    fn lowest(&self, point: [f64; 2], add: impl Fn(&Triangle) -> f64) -> f64 {
        let heights = self.triangles.iter().filter_map(|triangle| Some(height(triangle, point)? + add(triangle)));
        heights.fold(f64::INFINITY, f64::min)
    }

    /// What the captured height at a pixel lies between.
    pub fn bounds(&self, column: usize, row: usize) -> [f64; 2] {
        let centre = [column as f64 + 0.5, row as f64 + 0.5];
        let blur = self.blur_px;
        let near = |triangle: &&Triangle| {
            (0..2).all(|k| {
                let [a, b, c] = triangle.map(|corner| corner[k] - centre[k]);
                a.min(b).min(c) <= 2.0 * blur && a.max(b).max(c) >= -2.0 * blur
            })
        };
        let close = Self { triangles: self.triangles.iter().filter(near).copied().collect(), ..*self };

        let touched = close.triangles.iter().filter(|triangle| distance(triangle, centre) <= blur);
        let low = touched.map(|triangle| {
            let [bottom, top] = range(triangle);
            let doubt = close.doubt(triangle);
            if doubt >= top - bottom { bottom } else { (plane(triangle, centre) - doubt).max(bottom) }
        });
        let low = low.fold(0.0, f64::min) - self.blur_mm;

        // Covered for certain is what is covered in every place that f32 may have moved the centre to.
        let around = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];
        let high = around.map(|(dx, dy)| {
            let moved = [centre[0] + f64::from(dx) * blur, centre[1] + f64::from(dy) * blur];
            close.lowest(moved, |triangle| close.doubt(triangle)).min(0.0)
        });
        [low, high.into_iter().fold(f64::NEG_INFINITY, f64::max) + self.blur_mm]
    }

    /// How far f32 may move the height inside a triangle: its share of the way from one edge to the corner opposite.
    fn doubt(&self, triangle: &Triangle) -> f64 {
        let [bottom, top] = range(triangle);
        let longest = (0..3).map(|k| length(sub(triangle[(k + 1) % 3], triangle[k]))).fold(0.0, f64::max);
        let narrowest = area(triangle).abs() / longest;
        (top - bottom) * (4.0 * self.blur_px / narrowest).min(1.0)
    }

    /// True if a height found at a pixel is right.
    pub fn agrees(&self, column: usize, row: usize, found: f64) -> bool {
        let [low, high] = self.bounds(column, row);
        (low..=high).contains(&found)
    }

    /// Ready for rays.
    pub fn rays(&self) -> Rays<'_> {
        let boxes = self.triangles.iter().map(|triangle| {
            let mut bounds = Aabb::empty();
            for corner in triangle {
                bounds.extend(Vec3A::from_array(corner.map(|v| v as f32)));
            }
            // A ray exactly on a box's upper face can miss it, so every box is a little larger than its triangle.
            bounds.min -= Vec3A::splat(1e-2);
            bounds.max += Vec3A::splat(1e-2);
            bounds
        });
        let boxes = boxes.collect::<Vec<_>>();
        let numbers = (0..boxes.len() as u32).collect();
        let tree = PlocBuilder::new().build(PlocSearchDistance::Low, &boxes, numbers, SortPrecision::U64, 0);
        Rays { scenery: self, tree }
    }
}

/// Rays from below, one per pixel, through obvhs' hierarchy.
pub struct Rays<'a> {
    scenery: &'a Scenery,
    tree: Bvh2,
}

impl Rays<'_> {
    /// Height of the first hit at the centre of a pixel, 0 if nothing is below the pad.
    ///
    /// obvhs finds the boxes on the ray. Its own triangle test is not used: that one works in f32 and loses hits on
    /// edges, where a coordinate is -0.0. Nor is its search for the nearest hit, which drops a hit at exactly `tmax`.
    pub fn height(&self, column: usize, row: usize) -> f64 {
        let point = [column as f64 + 0.5, row as f64 + 0.5];
        let start = self.tree.nodes[0].aabb().min.z - 1.0;
        let origin = Vec3A::new(point[0] as f32, point[1] as f32, start);
        let mut lowest = 0.0_f64;
        self.tree.ray_traverse_anyhit(Ray::new_inf(origin, Vec3A::Z), |_, at| {
            let triangle = &self.scenery.triangles[self.tree.primitive_indices[at] as usize];
            if let Some(along) = moller_trumbore(triangle, [point[0], point[1], 0.0]) {
                lowest = lowest.min(along);
            }
        });
        lowest
    }
}

/// Where a line along z through `origin` meets a triangle (Moller and Trumbore 1997). A hair more than the triangle
/// counts, for this test is not exact on edges.
fn moller_trumbore([a, b, c]: &Triangle, origin: [f64; 3]) -> Option<f64> {
    let cross =
        |u: [f64; 3], v: [f64; 3]| [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let direction = [0.0, 0.0, 1.0];
    let (e1, e2) = (sub(*b, *a), sub(*c, *a));
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    if determinant == 0.0 {
        return None;
    }
    let t = sub(origin, *a);
    let q = cross(t, e1);
    let (u, v) = (dot(t, p) / determinant, dot(direction, q) / determinant);
    let inside = u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12;
    inside.then(|| dot(e2, q) / determinant)
}

/// Height of a triangle at a point in it or on its edge.
fn height(triangle: &Triangle, point: [f64; 2]) -> Option<f64> {
    let [a, b, c] = triangle.map(|corner| [corner[0] - point[0], corner[1] - point[1]]);
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let edges = [edge(b, c), edge(c, a), edge(a, b)];
    let sum: f64 = edges.iter().sum();
    let inside = edges.iter().all(|e| *e >= 0.0) || edges.iter().all(|e| *e <= 0.0);
    (inside && sum != 0.0).then(|| edges.iter().zip(triangle).map(|(e, corner)| e * corner[2]).sum::<f64>() / sum)
}

/// Height of a triangle's plane at a point.
fn plane([a, b, c]: &Triangle, point: [f64; 2]) -> f64 {
    let (u, v) = (sub(*b, *a), sub(*c, *a));
    let (x, y) = (point[0] - a[0], point[1] - a[1]);
    let area = u[0] * v[1] - u[1] * v[0];
    a[2] + ((x * v[1] - y * v[0]) * u[2] + (y * u[0] - x * u[1]) * v[2]) / area
}

/// Distance of a point from a triangle in the image, 0 inside.
fn distance(triangle: &Triangle, point: [f64; 2]) -> f64 {
    if height(triangle, point).is_some() {
        return 0.0;
    }
    let to_edge = |k: usize| {
        let (p, q) = (triangle[k], triangle[(k + 1) % 3]);
        let (edge, away) = ([q[0] - p[0], q[1] - p[1]], [point[0] - p[0], point[1] - p[1]]);
        let squared = edge[0] * edge[0] + edge[1] * edge[1];
        let along = if squared > 0.0 { (edge[0] * away[0] + edge[1] * away[1]) / squared } else { 0.0 };
        let along = along.clamp(0.0, 1.0);
        (away[0] - along * edge[0]).hypot(away[1] - along * edge[1])
    };
    to_edge(0).min(to_edge(1)).min(to_edge(2))
}

/// Twice the signed area in the image.
fn area([a, b, c]: &Triangle) -> f64 {
    let (u, v) = (sub(*b, *a), sub(*c, *a));
    u[0] * v[1] - u[1] * v[0]
}

fn range(triangle: &Triangle) -> [f64; 2] {
    let heights = triangle.map(|corner| corner[2]);
    [heights.iter().copied().fold(f64::INFINITY, f64::min), heights.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Length in the image.
fn length(v: [f64; 3]) -> f64 {
    v[0].hypot(v[1])
}
