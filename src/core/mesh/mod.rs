//! The object that is pressed into the gel: one cleaned [`Mesh`] in millimetres, divided into clusters for capturing
//! it.

pub mod cleaning;
pub mod clusters;
pub mod extents;
pub mod facets;
pub mod nearest;
pub mod surface;

pub use cleaning::{CleanupReport, Mesh};

/// Why vertices and triangles do not make a mesh.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// There is no vertex.
    #[error("no vertex")]
    NoVertex,
    /// There are vertices, all of them with a NaN or infinite coordinate.
    #[error("no vertex with finite coordinates")]
    NoFiniteVertex,
    /// There is no triangle (or polygon).
    #[error("no triangle")]
    NoTriangle,
    /// There were triangles, but cleaning removed all of them.
    #[error("no triangle left: {}", .0.warning().unwrap_or_default())]
    NothingLeft(CleanupReport),
    /// A face refers to a vertex that does not exist.
    #[error("face refers to vertex {index}, but the file has {count}{note}")]
    NoSuchVertex {
        /// The index as it stands in the file.
        index: i64,
        /// Number of vertices.
        count: usize,
        /// An explanation of the two numbers.
        note: &'static str,
    },
    /// The bounding box is longer than [`cleaning::LARGEST_MM`]: 32-bit numbers cannot resolve a millimetre of such an
    /// object.
    #[error("is {0:.3e} mm across, over {limit:.0e} mm: is its unit right?", limit = cleaning::LARGEST_MM)]
    TooLarge(f64),
    /// More vertices or triangles than 32-bit indices can count.
    #[error("has more than {} {}, the largest number allowed", u32::MAX - 1, .0)]
    TooMany(&'static str),
}
