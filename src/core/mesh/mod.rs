//! The object that is pressed into the gel: one cleaned [`Mesh`] in millimetres, and what capture and `inspect` know of
//! it.

pub mod cleaning;
pub mod clusters;
pub mod nearest;

pub use cleaning::{CleanupReport, Mesh};

/// Why vertices and triangles make no mesh.
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
    /// There were triangles, but cleaning dropped all of them.
    #[error("no triangle left: {}", .0.warning().unwrap_or_default())]
    NothingLeft(CleanupReport),
    /// A face refers to a vertex that is not there.
    #[error("face refers to vertex {index}, but the file has {count}{note}")]
    NoSuchVertex {
        /// The index as the file has it.
        index: i64,
        /// Vertices there are.
        count: usize,
        /// What to know about the two.
        note: &'static str,
    },
    /// Over [`cleaning::LARGEST_MM`]. Of such an object 32 bits do not tell a millimetre.
    #[error("is {0:.3e} mm across, over {limit:.0e} mm: is its unit right?", limit = cleaning::LARGEST_MM)]
    TooLarge(f64),
    /// More than 32-bit indices can count.
    #[error("has more than {} {}, the most there may be", u32::MAX - 1, .0)]
    TooMany(&'static str),
}
