//! An object that is pressed into a curved gel and known as the surface that a camera inside the gel sees of it.

use std::fmt;

use crate::mesh::clusters::Clusters;

/// The part of an object that a camera inside a gel sees.
pub struct SeenSurface {
    /// The triangles near the gel, in the object's own frame; empty if there are none.
    pub near_gel: Clusters,
    /// Pixels of the image where the object hides the gel from the camera, or where the gel is outside the frame, so
    /// that nothing is known of the contact there.
    pub unseen_px: u64,
    /// True if the object reaches into the gel at the border of the frame: it goes on there in an unknown way.
    pub is_cut: bool,
}

impl fmt::Debug for SeenSurface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { near_gel: _, unseen_px, is_cut } = self;
        f.debug_struct("SeenSurface").field("unseen_px", unseen_px).field("is_cut", is_cut).finish_non_exhaustive()
    }
}
