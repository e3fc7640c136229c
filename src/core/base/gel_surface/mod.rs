//! The outer surface of a gel that is given as a mesh, smooth between its vertices.
//!
//! The normal at a vertex is that of the ball through the vertex and its neighbours (Max 1999, "Weights for Computing
//! Vertex Normals from Facet Normals"). A point of a triangle lies half way between the facet and its mean projection
//! on the corners' tangent planes (Boubekeur and Alexa 2008, "Phong Tessellation"). On the mesh of a ball this is the
//! ball to third order, so that facets can be neither seen nor felt. Edges sharper than [`CREASE_DEG`] stay sharp.

mod geodesic;
pub mod geodesic_chart;
mod topology;
pub mod tree;

use std::sync::Arc;

use glam::{DMat3, DVec3};
use once_cell::race::OnceBox;

use super::triangle::nearest_point_on_triangle;
use geodesic::Waypoint;
use geodesic_chart::GeodesicChart;
use topology::{NO_TRIANGLE, Topology};
use tree::TriangleTree;

/// Edges at which the surface turns by more than this angle stay sharp, degrees.
pub const CREASE_DEG: f64 = 40.0;

/// Largest distance of the sensor's origin from the gel's tip, mm.
pub const MAX_TIP_OFFSET_MM: f64 = 0.1;

/// Facets whose corners all lie within this share of the height above the lowest point are the gel's bottom, not its
/// skin.
const BOTTOM_SHARE: f64 = 1e-4;

/// A gel's surface with its normals, its topology and a search tree.
#[derive(Debug)]
pub struct GelSurface {
    points: Vec<DVec3>,
    corners: Vec<[u32; 3]>,
    /// Normals at the corners of each triangle.
    normals: Vec<[DVec3; 3]>,
    /// Normal of each triangle.
    facets: Vec<DVec3>,
    /// The triangle across each edge; edge k goes from corner k to the next one.
    neighbours: Vec<[u32; 3]>,
    tree: TriangleTree,
    low: DVec3,
    high: DVec3,
    sharp_edges: usize,
    /// The normal at the tip.
    tip_normal: DVec3,
    tip_chart: OnceBox<Arc<GeodesicChart>>,
}

/// Surfaces are shared: only the same object is equal.
impl PartialEq for GelSurface {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

/// A point on a facet of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct FacetPoint {
    pub triangle: usize,
    /// Position, on the flat facet.
    pub at: DVec3,
}

/// Why a mesh cannot be the surface of a gel.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GelSurfaceError {
    /// More than two triangles share an edge.
    #[error("three sheets or more meet at {}", format_point(.0))]
    SheetsMeet(DVec3),
    /// The surface has only one side.
    #[error("the surface has no two sides: it is twisted near {}", format_point(.0))]
    Twisted(DVec3),
    /// The surface is not in one piece.
    #[error("the surface is in {count} pieces, one of them at {}", format_point(at))]
    Pieces {
        /// Number of pieces.
        count: usize,
        /// A corner of one of them.
        at: DVec3,
    },
    /// The z axis does not leave the surface.
    #[error("the z axis does not leave the gel, which reaches from {} to {}", format_point(.0), format_point(.1))]
    NoTip(DVec3, DVec3),
    /// The tip is not at the origin.
    #[error("the z axis leaves the gel at z = {0:.3} mm, but the tip must be at z = 0")]
    TipElsewhere(f64),
    /// The surface is steep where the z axis leaves it.
    #[error("the z axis leaves the gel {0:.0} degrees off the surface's normal")]
    SteepTip(f64),
}

/// Formats a point for messages.
fn format_point(at: &DVec3) -> String {
    format!("({:.2}, {:.2}, {:.2}) mm", at.x, at.y, at.z)
}

/// A gap in a surface that is not its rim.
#[derive(Clone, Copy, Debug)]
pub struct GelHole {
    /// Centre of the gap.
    pub at_mm: DVec3,
    /// Number of edges around it.
    pub edges: usize,
}

impl GelSurface {
    /// Makes a surface from triangles with non-zero area in the sensor's frame, mm. A flat bottom is removed. The
    /// orientation of the triangles does not matter.
    ///
    /// # Errors
    ///
    /// Returns what makes the triangles unfit as a gel's surface.
    pub fn new(points: Vec<DVec3>, mut corners: Vec<[u32; 3]>) -> Result<Self, GelSurfaceError> {
        let around = |corners: &[[u32; 3]]| {
            let used = corners.iter().flatten().map(|corner| points[*corner as usize]);
            used.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
        };
        let (low, high) = around(&corners);
        let height = high.z - low.z;
        let is_bottom = |corners: &[u32; 3]| {
            corners.iter().all(|corner| points[*corner as usize].z - low.z <= BOTTOM_SHARE * height) && height > 0.0
        };
        if !corners.iter().all(is_bottom) {
            corners.retain(|corners| !is_bottom(corners));
        }
        let (low, high) = around(&corners);
        let mut topology = Topology::new(&points, corners)?;
        let triangle = |corners: &[u32; 3]| corners.map(|corner| points[corner as usize]);
        let triangles: Vec<[DVec3; 3]> = topology.corners.iter().map(triangle).collect();
        let tree = TriangleTree::new(&triangles);
        let mut surface = Self {
            points: Vec::new(),
            corners: Vec::new(),
            normals: Vec::new(),
            facets: triangles.iter().map(|[a, b, c]| (*b - a).cross(*c - a).normalize_or_zero()).collect(),
            neighbours: Vec::new(),
            tree,
            low,
            high,
            sharp_edges: 0,
            tip_normal: DVec3::Z,
            tip_chart: OnceBox::new(),
        };
        // The tip is where the z axis leaves the mesh last.
        let below = DVec3::new(0.0, 0.0, low.z - 1.0);
        let mut highest: Option<(f64, usize)> = None;
        surface.visit_hits_of(&triangles, below, DVec3::Z, |t, number| {
            highest = highest.filter(|(known, _)| *known > t).or(Some((t, number)));
        });
        let (t, number) = highest.ok_or(GelSurfaceError::NoTip(low, high))?;
        let tip_mm = low.z - 1.0 + t;
        if surface.facets[number].z < 0.0 {
            topology.flip_orientation();
            surface.facets.iter_mut().for_each(|facet| *facet = -*facet);
        }
        if tip_mm.abs() > MAX_TIP_OFFSET_MM {
            return Err(GelSurfaceError::TipElsewhere(tip_mm));
        }
        let (normals, sharp_edges) =
            topology.corner_normals(&points, &surface.facets, libm::cos(CREASE_DEG.to_radians()));
        let Topology { corners, neighbours, .. } = topology;
        surface = Self { points, corners, normals, neighbours, sharp_edges, ..surface };
        // Shift the surface so that the origin is exactly at the tip.
        let (tip, normal) = surface.smooth_point(FacetPoint { triangle: number, at: DVec3::new(0.0, 0.0, tip_mm) });
        surface.points.iter_mut().for_each(|point| point.z -= tip.z);
        let corners = |corners: &[u32; 3]| corners.map(|corner| surface.points[corner as usize]);
        let tree = TriangleTree::new(&surface.corners.iter().map(corners).collect::<Vec<_>>());
        let off_axis = libm::acos(normal.z.clamp(-1.0, 1.0)).to_degrees();
        if off_axis > 60.0 {
            return Err(GelSurfaceError::SteepTip(off_axis));
        }
        let shift = DVec3::new(0.0, 0.0, tip.z);
        Ok(Self { tree, tip_normal: normal, low: surface.low - shift, high: surface.high - shift, ..surface })
    }

    /// Returns half the smaller width, mm: the size of the gel, in place of a round gel's radius.
    pub fn size_mm(&self) -> f64 {
        let across = self.high - self.low;
        0.5 * across.x.min(across.y).max(1e-3)
    }

    /// Returns two opposite corners of the bounding box, mm.
    pub fn bounds_mm(&self) -> [DVec3; 2] {
        [self.low, self.high]
    }

    /// Returns the normal at the tip.
    pub(crate) fn tip_normal(&self) -> DVec3 {
        self.tip_normal
    }

    /// Returns the number of edges at which the surface turns by more than [`CREASE_DEG`].
    pub fn sharp_edges(&self) -> usize {
        self.sharp_edges
    }

    /// Returns the vertices, mm, and the triangles.
    pub fn mesh(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        (self.points.clone(), self.corners.clone())
    }

    /// Returns the number of triangles, without those of a flat bottom.
    pub fn triangles(&self) -> usize {
        self.corners.len()
    }

    /// Returns the largest angle by which the surface turns along one edge of the mesh, degrees.
    pub fn coarsest_deg(&self) -> f64 {
        let least = self.normals.iter().flat_map(|normals| (0..3).map(|k| normals[k].dot(normals[(k + 1) % 3])));
        libm::acos(least.fold(1.0, f64::min).clamp(-1.0, 1.0)).to_degrees()
    }

    /// Returns the chart around the tip; it is made at the first call.
    pub(crate) fn tip_chart(&self) -> &Arc<GeodesicChart> {
        self.tip_chart.get_or_init(|| {
            let across = self.high - self.low;
            // On a gel that bulges, no way along the surface is longer than straight down and across.
            let reach_mm = 1.05 * (across.z + 0.5 * across.truncate().length());
            Box::new(Arc::new(GeodesicChart::around_tip(self, reach_mm)))
        })
    }

    /// Returns the smallest distance from the tip to the rim within a range of directions, and that direction, in mm
    /// and degrees. Where the rim is not reached, the distance is how far the chart reaches.
    pub fn least_rim_mm(&self, around_deg: std::ops::RangeInclusive<f64>) -> (f64, f64) {
        self.tip_chart().least_rim_mm(around_deg)
    }

    /// Returns the frame at a distance from the tip; see [`super::gel::GelShape::frame_at`]. Beyond the rim the way
    /// continues straight.
    pub fn frame_at(&self, from_tip_mm: f64, around_deg: f64) -> (DMat3, DVec3) {
        const STEP_MM: f64 = 0.1;
        let axes = self.tip_chart().axes();
        let towards = axes * DMat3::from_rotation_z(around_deg.to_radians()).x_axis;
        let steps = libm::ceil(from_tip_mm / STEP_MM).max(1.0);
        let (way, _) =
            self.trace_geodesic(self.closest_facet_point(DVec3::ZERO), towards, from_tip_mm / steps, steps as usize);
        let Waypoint { point, normal, towards } = way[way.len() - 1];
        (DMat3::from_cols(towards, normal.cross(towards), normal), point)
    }

    /// Returns the point of the smooth surface at a point of a facet, and its normal.
    pub(super) fn smooth_point(&self, spot: FacetPoint) -> (DVec3, DVec3) {
        let normals = &self.normals[spot.triangle];
        let points = self.corners[spot.triangle].map(|corner| self.points[corner as usize]);
        let shares = self.barycentric_shares(spot);
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

    /// Returns the barycentric coordinates of a point, clamped to its triangle.
    fn barycentric_shares(&self, FacetPoint { triangle, at }: FacetPoint) -> [f64; 3] {
        let [a, b, c] = self.corners[triangle].map(|corner| self.points[corner as usize]);
        let normal = self.facets[triangle];
        let of = |p: DVec3, q: DVec3| (q - p).cross(at - p).dot(normal).max(0.0);
        let [u, v, w] = [of(b, c), of(c, a), of(a, b)];
        let all = u + v + w;
        if all > 0.0 { [u / all, v / all, w / all] } else { [1.0, 0.0, 0.0] }
    }

    /// Returns the point of the facets that is closest to `to`.
    pub(super) fn closest_facet_point(&self, to: DVec3) -> FacetPoint {
        let mut best = (f64::INFINITY, FacetPoint { triangle: 0, at: DVec3::ZERO });
        let distance = |low: DVec3, high: DVec3| to.distance_squared(to.clamp(low, high));
        self.tree.visit_nearest(distance, f64::INFINITY, |triangle| {
            let [a, b, c] = self.corners[triangle].map(|corner| self.points[corner as usize]);
            let at = nearest_point_on_triangle(to, a, b, c);
            let away = to.distance_squared(at);
            if away < best.0 {
                best = (away, FacetPoint { triangle, at });
            }
            best.0
        });
        best.1
    }

    /// Returns the point of the smooth surface that is closest to `to`, and its normal.
    pub fn nearest(&self, to: DVec3) -> (DVec3, DVec3) {
        self.smooth_point(self.closest_facet_point(to))
    }

    /// Returns the first point where a ray leaves the surface, and its normal; `None` if it never does.
    pub fn find_exit(&self, from: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
        let mut first: Option<(f64, usize)> = None;
        self.visit_hits(from, direction, |t, triangle| {
            let leaves = self.facets[triangle].dot(direction) > 0.0;
            if leaves && t >= 0.0 && first.is_none_or(|(known, _)| t < known) {
                first = Some((t, triangle));
            }
        });
        first.map(|(t, triangle)| self.smooth_point(FacetPoint { triangle, at: from + t * direction }))
    }

    fn visit_hits(&self, from: DVec3, direction: DVec3, met: impl FnMut(f64, usize)) {
        let corners = |triangle: usize| self.corners[triangle].map(|corner| self.points[corner as usize]);
        visit_line_hits(&self.tree, corners, from, direction, met);
    }

    fn visit_hits_of(&self, triangles: &[[DVec3; 3]], from: DVec3, direction: DVec3, met: impl FnMut(f64, usize)) {
        visit_line_hits(&self.tree, |triangle| triangles[triangle], from, direction, met);
    }

    /// Returns the gaps beside the rim: borders that are less than half as long as the longest one.
    pub fn holes(&self) -> Vec<GelHole> {
        let loops = topology::find_borders(&self.corners, &self.neighbours);
        let point = |corner: &u32| self.points[*corner as usize];
        let length = |border: &[u32]| {
            let next = border.iter().cycle().skip(1);
            border.iter().zip(next).map(|(a, b)| point(a).distance(point(b))).sum::<f64>()
        };
        let longest = loops.iter().map(|border| length(border)).fold(0.0, f64::max);
        let holes = loops.iter().filter(|border| length(border) < 0.5 * longest);
        holes
            .map(|border| GelHole {
                at_mm: border.iter().map(point).sum::<DVec3>() / border.len() as f64,
                edges: border.len(),
            })
            .collect()
    }

    /// Returns true if the surface is closed, without any border.
    pub fn has_no_rim(&self) -> bool {
        self.neighbours.iter().flatten().all(|beside| *beside != NO_TRIANGLE)
    }
}

/// Calls `met` with the position along the line and the number of every triangle that the line hits. Neighbouring
/// triangles leave no gap.
fn visit_line_hits(
    tree: &TriangleTree,
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
        // Slightly larger than the box, so that rounding misses no triangle.
        enters <= leaves + 1e-9 * leaves.abs().max(1.0)
    };
    tree.visit_boxes(enter, |number| {
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
