//! Points of a curved gel.

use glam::DVec3;

/// A point on the surface of a curved gel, in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Normal, out of the gel.
    pub normal: DVec3,
    /// How far the point lies below the centre of the tip's ball, mm: above 0 on a capsule's cylinder, else 0.
    pub below_mm: f64,
    /// Position, mm.
    pub point_mm: DVec3,
}

/// The gel at a point of a chart: position, normal and directions, in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFrame {
    /// Normal, out of the gel.
    pub normal: DVec3,
    /// How far the point lies below the centre of the tip's ball, mm.
    pub below_mm: f64,
    /// Position, mm.
    pub point_mm: DVec3,
    /// Directions of the chart's x and y on the gel, transported from the chart's centre without rotation: unit vectors
    /// across the normal.
    pub tangents: [DVec3; 2],
}

impl SurfaceFrame {
    /// Returns the point without its tangents.
    pub(crate) fn site(&self) -> Site {
        Site { normal: self.normal, below_mm: self.below_mm, point_mm: self.point_mm }
    }
}
