//! Points of a gel that is not flat.

use glam::DVec3;

/// A point of a gel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Out of the gel.
    pub normal: DVec3,
    /// How far below the middle of the tip's ball it is, mm: above 0 on a capsule's cylinder, else 0.
    pub below_mm: f64,
    /// Where it is, mm.
    pub point_mm: DVec3,
}

/// Where a point of a chart is on the gel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Out of the gel.
    pub normal: DVec3,
    /// How far below the middle of the tip's ball it is, mm.
    pub below_mm: f64,
    /// Where it is, mm.
    pub point_mm: DVec3,
    /// Along the chart's x and y, as they go over the gel from its middle without a turn: unit vectors across the normal.
    pub tangents: [DVec3; 2],
}

impl Rest {
    /// The same as a point of the gel.
    pub(crate) fn site(&self) -> Site {
        Site { normal: self.normal, below_mm: self.below_mm, point_mm: self.point_mm }
    }
}
