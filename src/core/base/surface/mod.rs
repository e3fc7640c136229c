//! The outer surface of a gel given as a mesh, smooth between its vertices.
//!
//! A vertex has the normal of the ball through it and its neighbours (Max 1999, "Weights for Computing Vertex Normals from Facet
//! Normals"). A point of a triangle is half way between the facet and its mean projection on the corners' tangent planes (Boubekeur
//! and Alexa 2008, "Phong Tessellation"): on a mesh of a ball that is the ball to the third order, so that no facets are seen or
//! felt. Edges sharper than [`CREASE_DEG`] stay sharp.

mod geodesic;
mod topology;
pub mod tree;
pub mod unrolled;

use std::sync::{Arc, OnceLock};

use glam::{DMat3, DVec3};

use super::triangle::nearest_of_triangle;
use geodesic::Waypoint;
use topology::{NONE, Topology};
use tree::Tree;
use unrolled::Unrolled;

/// Edges at which the surface turns by more than this stay sharp, degrees.
pub const CREASE_DEG: f64 = 40.0;

/// How far off the tip the sensor's origin may be, mm.
pub const TIP_MM: f64 = 0.1;

/// Share of the height up to which a facet that looks down is the gel's bottom, no part of its skin.
const BOTTOM: f64 = 1e-4;

/// A gel's surface, made ready.
#[derive(Debug)]
pub struct Surface {
    points: Vec<DVec3>,
    corners: Vec<[u32; 3]>,
    /// Of each corner of each triangle.
    normals: Vec<[DVec3; 3]>,
    /// Of each triangle.
    facets: Vec<DVec3>,
    /// The triangle across each edge, from corner k to the next one.
    beside: Vec<[u32; 3]>,
    tree: Tree,
    low: DVec3,
    high: DVec3,
    sharp_edges: usize,
    /// The normal at the tip.
    tip: DVec3,
    at_tip: OnceLock<Arc<Unrolled>>,
}

/// Surfaces are shared; two that were made apart differ.
impl PartialEq for Surface {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

/// A place on a surface's facets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub triangle: usize,
    /// On the facet.
    pub at: DVec3,
}

/// Why a mesh is no gel's surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// More than two triangles share an edge.
    #[error("three sheets or more meet at {}", place(.0))]
    SheetsMeet(DVec3),
    /// It has one side only.
    #[error("the surface has no two sides: it is twisted near {}", place(.0))]
    Twisted(DVec3),
    /// It is not in one piece.
    #[error("the surface is in {count} pieces, one of them at {}", place(at))]
    Pieces {
        /// How many.
        count: usize,
        /// A corner of one.
        at: DVec3,
    },
    /// The z axis does not leave it.
    #[error("the z axis does not leave the gel, which reaches from {} to {}", place(.0), place(.1))]
    NoTip(DVec3, DVec3),
    /// The tip is not at the origin.
    #[error("the z axis leaves the gel at z = {0:.3} mm, and the tip's place is z = 0")]
    TipElsewhere(f64),
    /// The surface is steep where the z axis leaves it.
    #[error("the z axis leaves the gel {0:.0} degrees off the surface's normal")]
    SteepTip(f64),
}

/// A place as messages have it.
fn place(at: &DVec3) -> String {
    format!("({:.2}, {:.2}, {:.2}) mm", at.x, at.y, at.z)
}

/// A gap in a surface beside its rim.
#[derive(Clone, Copy, Debug)]
pub struct Hole {
    /// Its middle.
    pub at_mm: DVec3,
    /// Edges around it.
    pub edges: usize,
}

impl Surface {
    /// Of triangles in the sensor's frame, mm, each with an area. A flat bottom is no part of it. Which way triangles turn does not
    /// matter.
    ///
    /// # Errors
    ///
    /// What makes them no gel's surface.
    pub fn new(points: Vec<DVec3>, mut corners: Vec<[u32; 3]>) -> Result<Self, SurfaceError> {
        let around = |corners: &[[u32; 3]]| {
            let used = corners.iter().flatten().map(|corner| points[*corner as usize]);
            used.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
        };
        let (low, high) = around(&corners);
        let height = high.z - low.z;
        let is_bottom = |corners: &[u32; 3]| {
            corners.iter().all(|corner| points[*corner as usize].z - low.z <= BOTTOM * height) && height > 0.0
        };
        if !corners.iter().all(is_bottom) {
            corners.retain(|corners| !is_bottom(corners));
        }
        let (low, high) = around(&corners);
        let mut topology = Topology::new(&points, corners)?;
        let triangle = |corners: &[u32; 3]| corners.map(|corner| points[corner as usize]);
        let triangles: Vec<[DVec3; 3]> = topology.corners.iter().map(triangle).collect();
        let tree = Tree::new(&triangles);
        let mut surface = Self {
            points: Vec::new(),
            corners: Vec::new(),
            normals: Vec::new(),
            facets: triangles.iter().map(|[a, b, c]| (*b - a).cross(*c - a).normalize_or_zero()).collect(),
            beside: Vec::new(),
            tree,
            low,
            high,
            sharp_edges: 0,
            tip: DVec3::Z,
            at_tip: OnceLock::new(),
        };
        // Where the z axis is highest.
        let below = DVec3::new(0.0, 0.0, low.z - 1.0);
        let mut highest: Option<(f64, usize)> = None;
        surface.crossings(&triangles, below, DVec3::Z, |t, number| {
            highest = highest.filter(|(known, _)| *known > t).or(Some((t, number)));
        });
        let (t, number) = highest.ok_or(SurfaceError::NoTip(low, high))?;
        let tip_mm = low.z - 1.0 + t;
        if surface.facets[number].z < 0.0 {
            topology.turn_over();
            surface.facets.iter_mut().for_each(|facet| *facet = -*facet);
        }
        if tip_mm.abs() > TIP_MM {
            return Err(SurfaceError::TipElsewhere(tip_mm));
        }
        let (normals, sharp_edges) = topology.normals(&points, &surface.facets, libm::cos(CREASE_DEG.to_radians()));
        let Topology { corners, beside, .. } = topology;
        surface = Self { points, corners, normals, beside, sharp_edges, ..surface };
        // The origin is the tip, exactly.
        let (tip, normal) = surface.smooth(Spot { triangle: number, at: DVec3::new(0.0, 0.0, tip_mm) });
        surface.points.iter_mut().for_each(|point| point.z -= tip.z);
        let corners = |corners: &[u32; 3]| corners.map(|corner| surface.points[corner as usize]);
        let tree = Tree::new(&surface.corners.iter().map(corners).collect::<Vec<_>>());
        let off_axis = libm::acos(normal.z.clamp(-1.0, 1.0)).to_degrees();
        if off_axis > 60.0 {
            return Err(SurfaceError::SteepTip(off_axis));
        }
        let shift = DVec3::new(0.0, 0.0, tip.z);
        Ok(Self { tree, tip: normal, low: surface.low - shift, high: surface.high - shift, ..surface })
    }

    /// Half its smaller width, mm: how large it is, as the radius of a round gel says it.
    pub fn size_mm(&self) -> f64 {
        let across = self.high - self.low;
        0.5 * across.x.min(across.y).max(1e-3)
    }

    /// The corners of a box around it, mm.
    pub fn bounds_mm(&self) -> [DVec3; 2] {
        [self.low, self.high]
    }

    /// Normal at the tip.
    pub fn tip_normal(&self) -> DVec3 {
        self.tip
    }

    /// Edges at which it turns by more than [`CREASE_DEG`].
    pub fn sharp_edges(&self) -> usize {
        self.sharp_edges
    }

    /// Its vertices, mm, and triangles.
    pub fn mesh(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        (self.points.clone(), self.corners.clone())
    }

    /// Triangles, without a flat bottom's.
    pub fn triangles(&self) -> usize {
        self.corners.len()
    }

    /// Its longest edge that is not straight along the surface, as the angle by which the surface turns along it, degrees.
    pub fn coarsest_deg(&self) -> f64 {
        let least = self.normals.iter().flat_map(|normals| (0..3).map(|k| normals[k].dot(normals[(k + 1) % 3])));
        libm::acos(least.fold(1.0, f64::min).clamp(-1.0, 1.0)).to_degrees()
    }

    /// The geodesics that leave its tip.
    pub(crate) fn around_tip(&self) -> &Arc<Unrolled> {
        self.at_tip.get_or_init(|| {
            let across = self.high - self.low;
            // No way over a gel that bulges is longer than down and across.
            let reach_mm = 1.05 * (across.z + 0.5 * across.truncate().length());
            Arc::new(Unrolled::around_tip(self, reach_mm))
        })
    }

    /// How far from the tip the rim is where it is nearest within a range of directions, degrees, and the direction; where it
    /// is not reached, how far the chart reaches. mm and degrees.
    pub fn least_rim_mm(&self, around_deg: std::ops::RangeInclusive<f64>) -> (f64, f64) {
        self.around_tip().least_rim_mm(around_deg)
    }

    /// See [`super::gel::GelShape::frame_at`]; beyond the rim straight on.
    pub fn frame_at(&self, from_tip_mm: f64, around_deg: f64) -> (DMat3, DVec3) {
        const STEP_MM: f64 = 0.1;
        let axes = self.around_tip().axes();
        let towards = axes * DMat3::from_rotation_z(around_deg.to_radians()).x_axis;
        let steps = libm::ceil(from_tip_mm / STEP_MM).max(1.0);
        let (way, _) = self.geodesic(self.closest(DVec3::ZERO), towards, from_tip_mm / steps, steps as usize);
        let Waypoint { point, normal, towards } = way[way.len() - 1];
        (DMat3::from_cols(towards, normal.cross(towards), normal), point)
    }

    /// The point of the surface at a place on its facets, and its normal.
    pub(super) fn smooth(&self, spot: Spot) -> (DVec3, DVec3) {
        let normals = &self.normals[spot.triangle];
        let points = self.corners[spot.triangle].map(|corner| self.points[corner as usize]);
        let shares = self.shares(spot);
        let (mut at, mut normal, mut off) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for ((share, point), up) in shares.iter().zip(points).zip(normals) {
            at += *share * point;
            normal += *share * *up;
        }
        for ((share, point), up) in shares.iter().zip(points).zip(normals) {
            off += *share * *up * up.dot(point - at);
        }
        (at + 0.5 * off, normal.normalize_or(self.facets[spot.triangle]))
    }

    /// Barycentric coordinates of a place, within its triangle.
    fn shares(&self, Spot { triangle, at }: Spot) -> [f64; 3] {
        let [a, b, c] = self.corners[triangle].map(|corner| self.points[corner as usize]);
        let normal = self.facets[triangle];
        let of = |p: DVec3, q: DVec3| (q - p).cross(at - p).dot(normal).max(0.0);
        let [u, v, w] = [of(b, c), of(c, a), of(a, b)];
        let all = u + v + w;
        if all > 0.0 { [u / all, v / all, w / all] } else { [1.0, 0.0, 0.0] }
    }

    /// The place that is closest to a point.
    pub(super) fn closest(&self, to: DVec3) -> Spot {
        let mut best = (f64::INFINITY, Spot { triangle: 0, at: DVec3::ZERO });
        let distance = |low: DVec3, high: DVec3| to.distance_squared(to.clamp(low, high));
        self.tree.visit_nearest(distance, f64::INFINITY, |triangle| {
            let [a, b, c] = self.corners[triangle].map(|corner| self.points[corner as usize]);
            let at = nearest_of_triangle(to, a, b, c);
            let away = to.distance_squared(at);
            if away < best.0 {
                best = (away, Spot { triangle, at });
            }
            best.0
        });
        best.1
    }

    /// The point of it closest to a point, and its normal.
    pub fn nearest(&self, to: DVec3) -> (DVec3, DVec3) {
        self.smooth(self.closest(to))
    }

    /// Where a ray first goes out of it: the point and its normal.
    pub fn left_by(&self, from: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
        let mut first: Option<(f64, usize)> = None;
        self.rays(from, direction, |t, triangle| {
            let leaves = self.facets[triangle].dot(direction) > 0.0;
            if leaves && t >= 0.0 && first.is_none_or(|(known, _)| t < known) {
                first = Some((t, triangle));
            }
        });
        first.map(|(t, triangle)| self.smooth(Spot { triangle, at: from + t * direction }))
    }

    fn rays(&self, from: DVec3, direction: DVec3, met: impl FnMut(f64, usize)) {
        let corners = |triangle: usize| self.corners[triangle].map(|corner| self.points[corner as usize]);
        crossed(&self.tree, corners, from, direction, met);
    }

    fn crossings(&self, triangles: &[[DVec3; 3]], from: DVec3, direction: DVec3, met: impl FnMut(f64, usize)) {
        crossed(&self.tree, |triangle| triangles[triangle], from, direction, met);
    }

    /// Gaps beside the rim: borders that are less than half as long as the longest one.
    pub fn holes(&self) -> Vec<Hole> {
        let loops = topology::borders(&self.corners, &self.beside);
        let point = |corner: &u32| self.points[*corner as usize];
        let length = |border: &[u32]| {
            let next = border.iter().cycle().skip(1);
            border.iter().zip(next).map(|(a, b)| point(a).distance(point(b))).sum::<f64>()
        };
        let longest = loops.iter().map(|border| length(border)).fold(0.0, f64::max);
        let holes = loops.iter().filter(|border| length(border) < 0.5 * longest);
        holes
            .map(|border| Hole {
                at_mm: border.iter().map(point).sum::<DVec3>() / border.len() as f64,
                edges: border.len(),
            })
            .collect()
    }

    /// True if nothing of it ends anywhere.
    pub fn has_no_rim(&self) -> bool {
        self.beside.iter().flatten().all(|beside| *beside != NONE)
    }
}

/// Triangles that a line meets, and how far along it. Neighbouring triangles leave no gap.
fn crossed(
    tree: &Tree,
    corners: impl Fn(usize) -> [DVec3; 3],
    from: DVec3,
    direction: DVec3,
    mut met: impl FnMut(f64, usize),
) {
    let inverse = direction.recip();
    let enter = |low: DVec3, high: DVec3| {
        let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            if direction[k] == 0.0 {
                if from[k] < low[k] || from[k] > high[k] {
                    return false;
                }
            } else {
                let [a, b] = [low[k], high[k]].map(|side| (side - from[k]) * inverse[k]);
                (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
            }
        }
        // A hair more than the box: rounding shall lose no triangle.
        enters <= leaves + 1e-9 * leaves.abs().max(1.0)
    };
    tree.visit(enter, |number| {
        let [a, b, c] = corners(number).map(|corner| corner - from);
        let [ab, bc, ca] = [a.cross(b), b.cross(c), c.cross(a)];
        let sides = [ab, bc, ca].map(|side| side.dot(direction));
        let along = (ab + bc + ca).dot(direction);
        let within = sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
        if within && along != 0.0 {
            met(a.dot(bc) / along, number);
        }
    });
}
