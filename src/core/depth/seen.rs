//! What is pressed into a gel that is not flat, known as the surface that a camera inside the gel sees of it.

use std::fmt;

use crate::mesh::clusters::Clusters;

/// The part of an object that a camera inside a gel sees.
pub struct SeenSurface {
    /// What of it is near the gel, in the object's own frame; empty if nothing is.
    pub near_gel: Clusters,
    /// Pixels of the image in which the gel is hidden from the camera by the object, or out of its frame, so that nothing is known
    /// of what touches there.
    pub unseen_px: u64,
    /// The object reaches into the gel where the frame ends: it goes on, and nobody knows how.
    pub is_cut: bool,
}

impl fmt::Debug for SeenSurface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { near_gel: _, unseen_px, is_cut } = self;
        f.debug_struct("SeenSurface").field("unseen_px", unseen_px).field("is_cut", is_cut).finish_non_exhaustive()
    }
}
