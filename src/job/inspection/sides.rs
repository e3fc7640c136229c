//! Captures the six sides of an object as a sensor would, level and in the middle of the view.
//!
//! Each side is captured on a grid three times as fine as the sensor's; every third point is a pixel's centre. Parts
//! that stand out by less than two pixels across are those into which a disc two pixels wide does not fit
//! ([`gelsim_core::depth::thinness`]).

use rayon::prelude::*;
use serde::Serialize;

use super::SensorPad;
use crate::config::scene::Face;
use gelsim_core::depth::{CaptureWindow, Depth, capture_mesh, thinness};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::Anchor;
use gelsim_core::pose::{Angles, Pose};

/// One side of an object, pressed into the pad.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SideReport {
    /// The side that faces the pad.
    pub face: Face,
    /// Extents of its outline along the image's x and y, mm.
    pub outline_mm: [f64; 2],
    /// Extents of its outline along the image's x and y, px.
    pub outline_px: [f64; 2],
    /// Whether the outline fits into the view.
    pub fits: bool,
    /// Fraction of the view's pixels with the object over them.
    #[serde(rename = "view_share")]
    pub view_fraction: f64,
    /// The first of `bounds` and `contact` with which something touches in the middle of the view; null if nothing does
    /// with either. The following values are measured with it.
    pub anchor: Option<Anchor>,
    /// Whether the lowest point is in view and yet no pixel's centre meets what would touch.
    pub slips: bool,
    /// Number of pixels that the object reaches when it is pressed by [`SensorPad::press_mm`].
    pub touching_px: usize,
    /// Fraction of the view that the object reaches.
    #[serde(rename = "touching_share")]
    pub touching_fraction: f64,
    /// Least and largest height over the lowest point of what is in view within the pad's thickness, mm; null if there
    /// is nothing.
    pub relief_mm: Option<[f64; 2]>,
    /// Fraction, 0 to 1, of what touches that stands out by less than two pixels across.
    #[serde(rename = "thin_share")]
    pub thin_fraction: f64,
}

/// The sides, in the order of tables.
pub const FACES: [Face; 6] = [Face::MinusX, Face::PlusX, Face::MinusY, Face::PlusY, Face::MinusZ, Face::PlusZ];

/// Points of the fine grid per pixel, along x and along y.
const FINE_GRID_FACTOR: usize = 3;

/// How much the opening must remove for a point to count as thin, as a fraction of the press. Edges are always blunted
/// a little.
const BLUNTING: f64 = 0.05;

/// The most pixel rows per capture for which sides are captured: about half a second at the sensor's resolution.
pub const MAX_ROWS: f64 = 1.5e7;

/// Captures all sides of an object of this size, mm.
pub fn capture_sides(object: &Clusters, size_mm: [f64; 3], pad: &SensorPad) -> Vec<SideReport> {
    FACES.into_par_iter().map(|face| capture_side(face, object, size_mm, pad)).collect()
}

fn capture_side(face: Face, object: &Clusters, size_mm: [f64; 3], pad: &SensorPad) -> SideReport {
    let pose = |anchor| {
        let level = Angles { yaw_deg: 0.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
        Pose::new(face.side().expect("one of the six sides"), level, [0.0; 2], anchor, -pad.press_mm, object)
    };
    let rows = pose(Anchor::Bounds).placement().rotation;
    let outline_mm = [0, 1].map(|k| (0..3).map(|j| rows[k][j].abs() * size_mm[j]).sum::<f64>());
    // High enough to capture all of the object.
    let above_mm = size_mm.into_iter().fold(1.0, f64::max) + pad.thickness_mm;

    let mut anchor = None;
    let mut slips = false;
    let mut stats = SideStats::default();
    for tried in [Anchor::Bounds, Anchor::Contact] {
        let pose = pose(tried);
        let found = SideStats::new(object, &pose, above_mm, pad);
        // The contact in the middle of the view is of use only if it touches there; else the bounds' result stays.
        if tried == Anchor::Bounds || found.touching_px > 0 {
            stats = found;
        }
        if stats.touching_px > 0 {
            anchor = Some(tried);
            break;
        }
        slips |= is_lowest_in_view(object, &pose, pad);
    }
    let pixels = pad.resolution_px[0] * pad.resolution_px[1];
    SideReport {
        face,
        outline_mm,
        outline_px: [0, 1].map(|k| outline_mm[k] / pad.mm_per_px[k]),
        fits: (0..2).all(|k| outline_mm[k] <= pad.field_of_view_mm[k]),
        view_fraction: stats.covered_px as f64 / pixels as f64,
        anchor,
        slips: slips && anchor.is_none(),
        touching_px: stats.touching_px,
        touching_fraction: stats.touching_px as f64 / pixels as f64,
        relief_mm: stats.relief_mm,
        thin_fraction: stats.thin_fraction,
    }
}

/// Returns true if one of the points that touch first, within a micrometre, is over the view.
pub fn is_lowest_in_view(object: &Clusters, pose: &Pose, pad: &SensorPad) -> bool {
    let mut found = false;
    for_each_vertex(object, pose, |[x, y, z]| {
        found |= z < 1e-3 - pad.press_mm
            && x.abs() <= pad.field_of_view_mm[0] / 2.0
            && y.abs() <= pad.field_of_view_mm[1] / 2.0;
    });
    found
}

/// Finds the points that touch first, within a micrometre, and returns the place of the one nearest to the middle of
/// the view, mm.
pub fn find_lowest_place(object: &Clusters, pose: &Pose) -> Option<[f64; 2]> {
    let mut lowest = f64::INFINITY;
    for_each_vertex(object, pose, |[_, _, z]| lowest = lowest.min(z));
    let mut nearest: Option<[f64; 2]> = None;
    for_each_vertex(object, pose, |[x, y, z]| {
        let is_nearer = nearest.is_none_or(|[u, v]| x * x + y * y < u * u + v * v);
        if z < lowest + 1e-3 && is_nearer {
            nearest = Some([x, y]);
        }
    });
    nearest
}

/// Calls `see` with every vertex of an object in a pose, in the sensor's frame, mm.
fn for_each_vertex(object: &Clusters, pose: &Pose, mut see: impl FnMut([f64; 3])) {
    let placement = pose.placement();
    let centre_mm = object.centre_mm();
    object.query(
        |_, _| true,
        |part| {
            for at in 0..part.x.len() {
                let vertex = [part.x[at], part.y[at], part.z[at]];
                see([0, 1, 2].map(|k| {
                    let turned: f64 =
                        (0..3).map(|j| placement.rotation[k][j] * (centre_mm[j] + f64::from(vertex[j]))).sum();
                    turned + placement.translation_mm[k]
                }));
            }
        },
    );
}

/// What is seen of an object in one pose.
#[derive(Default)]
struct SideStats {
    covered_px: usize,
    touching_px: usize,
    relief_mm: Option<[f64; 2]>,
    thin_fraction: f64,
}

impl SideStats {
    fn new(object: &Clusters, pose: &Pose, above_mm: f64, pad: &SensorPad) -> Self {
        let margin_px = MARGIN_PX;
        let depth = capture_finely(object, pose, above_mm, pad);
        let mut stats = Self { thin_fraction: measure_thin_fraction(&depth, pad), ..Self::default() };
        let [width, height] = pad.resolution_px;
        let nothing = -above_mm as f32;
        let (mut least, mut largest) = (f32::INFINITY, f32::NEG_INFINITY);
        for y in 0..height {
            let row = &depth.penetration.row(margin_px + FINE_GRID_FACTOR * y + FINE_GRID_FACTOR / 2)[margin_px..];
            for below in row.iter().skip(FINE_GRID_FACTOR / 2).step_by(FINE_GRID_FACTOR).take(width) {
                stats.covered_px += usize::from(*below > nothing);
                stats.touching_px += usize::from(*below > 0.0);
                let over_lowest = (pad.press_mm as f32 - below).max(0.0);
                if *below > nothing && over_lowest <= pad.thickness_mm as f32 {
                    least = least.min(over_lowest);
                    largest = largest.max(over_lowest);
                }
            }
        }
        stats.relief_mm = (least <= largest).then_some([least, largest].map(f64::from));
        stats
    }
}

/// Margin around the view that the opening needs, px of the fine grid.
const MARGIN_PX: usize = 2 * DISC_RADIUS;

/// Captures an object on the fine grid, up to a height over the pad.
pub fn capture_finely(object: &Clusters, pose: &Pose, above_mm: f64, pad: &SensorPad) -> Depth {
    let window = CaptureWindow { margin_px: MARGIN_PX, above_mm };
    capture_mesh(object, &pose.placement(), &pad.subdivided_view(FINE_GRID_FACTOR), window, pad.thickness_mm)
}

/// Computes the fraction of what touches in view, on the fine grid, that the opening removes; 0 if nothing touches.
pub fn measure_thin_fraction(depth: &Depth, pad: &SensorPad) -> f64 {
    thinness::compute_thin_fraction(depth, DISC_RADIUS, (BLUNTING * pad.press_mm) as f32)
}

/// Radius of the disc in points of the fine grid: it is two pixels wide from centre to centre.
const DISC_RADIUS: usize = FINE_GRID_FACTOR;
