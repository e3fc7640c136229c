//! Files that hold points and no surface.

use std::fmt;

/// Points without a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoosePoints {
    /// Their number.
    pub count: usize,
    /// Their kind.
    pub kind: PointKind,
}

/// Kinds of points that belong to no triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointKind {
    /// Points that a scanner or a camera measured.
    #[default]
    Cloud,
    /// Gaussian splats: blobs of light, each with a size and a colour.
    Splats,
    /// Ends of lines.
    Lines,
}

impl LoosePoints {
    /// Returns what to do.
    pub(super) fn help(self) -> &'static str {
        match self.kind {
            PointKind::Cloud => {
                "reconstruct a surface, e.g. in MeshLab: Filters > Point Set > Compute normals for point sets, then Filters > \
                 Remeshing, Simplification and Reconstruction > Surface Reconstruction: Screened Poisson"
            }
            PointKind::Splats => {
                "splats have no surface: take a mesh of the same thing, such as photogrammetry makes of the same pictures"
            }
            PointKind::Lines => "export it with its faces",
        }
    }
}

impl fmt::Display for LoosePoints {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let what = match self.kind {
            PointKind::Cloud => "is a point cloud",
            PointKind::Splats => "holds Gaussian splats",
            PointKind::Lines => "holds lines alone",
        };
        let points = if self.count == 1 { "point" } else { "points" };
        write!(f, "{what}: {} {points} and no triangle", self.count)
    }
}
