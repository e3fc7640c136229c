//! What a job knows of its meshes besides their geometry. It is remembered from one command to the next.

use serde::{Deserialize, Serialize};

use crate::config::Job;
use crate::inspection::MeshSize;
use gelsim_core::mesh::CleanupReport;
use gelsim_core::mesh::facets::Facets;
use gelsim_core::pose::Side;
use gelsim_files::mesh::Remark;

/// What a job needs to know of a mesh besides its geometry.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MeshFacts {
    /// Name of the part in the file; `None` if the mesh is the complete file.
    pub name: Option<String>,
    /// Facets of round surfaces.
    pub facets: Facets,
    /// What cleaning removed.
    pub cleaned: CleanupReport,
    /// Size and place.
    pub size: MeshSize,
    /// Number of pixel rows that its triangles fill in a capture.
    pub rows_per_capture: f64,
    /// Whether the format defines what a coordinate of 1 is.
    pub knows_its_unit: bool,
    /// SHA-256 of the file, in lower-case hex.
    pub sha256: String,
    /// Folders in which the meshes that the file names are found again.
    pub packages: Vec<String>,
    /// What a user should know of how the file was read.
    pub remarks: Vec<Remark>,
    /// The side with the most relief, if the job presses that.
    pub richest_side: Option<Side>,
    /// The side with the most relief, if the job always presses another one level that is flat.
    pub richer_side: Option<Side>,
}

/// Returns the side of all objects that a job always presses level, if it does so.
pub fn find_level_side(job: &Job) -> Option<Side> {
    let pose = &job.pose;
    let level = pose.tilt_deg.support() == (0.0, 0.0) && pose.roll_deg.is_none() && pose.pitch_deg.is_none();
    pose.face.side().filter(|_| level && pose.at.is_side() && job.sequence.is_none() && job.sensor.shape.is_none())
}
