//! Notes on the objects of a job: what is allowed but probably not meant. Each is made once for each mesh.

use glam::DVec3;

use super::mesh_facts::{MeshFacts, find_level_side};
use crate::config::Job;
use crate::config::scene::Face;
use crate::inspection::MeshSize;
use gelsim_core::mesh::facets::Facets;
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::number_format::format_number;
use gelsim_files::sensor::quantity::Quantity;

/// Fraction of a mesh's area in facets of round surfaces from which on there is a note.
const MIN_FACET_SHARE: f64 = 0.5;

/// Width from which a facet is visible, as a fraction of the view's shorter side. The pad smooths narrower ones.
const MIN_VISIBLE_WIDTH: f64 = 0.05;

/// Collects all notes on a mesh that messages call `shown`, as this job presses it.
pub fn collect_object_notes(shown: &str, job: &Job, scale: &Quantity, mesh: &MeshFacts) -> Vec<Diagnostic> {
    if job.sensor.resolution_px.contains(&0) {
        return Vec::new();
    }
    let found = [
        note_visible_facets(shown, job, scale, &mesh.facets),
        note_flat_side(shown, job, mesh),
        note_out_of_view(shown, job, scale, &mesh.size),
    ];
    found.into_iter().flatten().collect()
}

/// Notes facets of round surfaces that are so large that the image shows them.
fn note_visible_facets(shown: &str, job: &Job, scale: &Quantity, facets: &Facets) -> Option<Diagnostic> {
    let sensor = &job.sensor;
    let [shorter_mm, px] = match sensor.field_of_view_mm[0] < sensor.field_of_view_mm[1] {
        true => [sensor.field_of_view_mm[0], f64::from(sensor.resolution_px[0])],
        false => [sensor.field_of_view_mm[1], f64::from(sensor.resolution_px[1])],
    };
    let width_mm = facets.width_mm * scale.support().0;
    (facets.share > MIN_FACET_SHARE && width_mm > MIN_VISIBLE_WIDTH * shorter_mm).then(|| {
        let width = format_number(width_mm);
        let message = format!(
            "{shown}: its round surfaces are facets some {width} mm ({:.0} px) wide that meet at some {:.1} degrees, which images \
             show",
            width_mm / shorter_mm * px,
            facets.angle_deg
        );
        Diagnostic::note(message)
            .help("export it with smaller facets")
            .about(format!("{shown} ({width} mm)"), "meshes have round surfaces of facets so wide that images show them")
    })
}

/// Notes a side that is always pressed level and is flat, while another one is not.
fn note_flat_side(shown: &str, job: &Job, mesh: &MeshFacts) -> Option<Diagnostic> {
    let side = Face::from_side(find_level_side(job)?).name();
    let other = Face::from_side(mesh.richer_side?).name();
    let message = format!("{shown}: its side {side}, which [pose] presses, is flat, and others are not");
    let help = format!(
        "write face = \"auto\" under [pose], which presses of each object the side with the most relief, or face = \"{other}\""
    );
    let cause = format!("meshes are flat on their side {side}, which [pose] presses, and not on others");
    // This is information only: a flat side may be meant, since its outline is visible.
    Some(Diagnostic::info(message).help(help).about(shown, cause))
}

/// Notes an object that no draw of the pose brings into view.
fn note_out_of_view(shown: &str, job: &Job, scale: &Quantity, size: &MeshSize) -> Option<Diagnostic> {
    if job.sensor.shape.is_some() || job.sequence.is_some() {
        return None;
    }
    // The greatest distance from the point that is placed to any point of the object, for any rotation.
    let across = 0.5 * DVec3::from_array(size.size_mm).length();
    let reach_mm = scale.support().1
        * match job.pose.anchor {
            Anchor::Origin => across + DVec3::from_array(size.centre_mm).length(),
            Anchor::Bounds | Anchor::Contact => 2.0 * across,
        };
    let places = [&job.pose.x_mm, &job.pose.y_mm].map(|quantity| quantity.support());
    let half_mm = job.sensor.field_of_view_mm.map(|mm| 0.5 * mm);
    let beyond = |k: &usize| places[*k].0 - reach_mm > half_mm[*k] || places[*k].1 + reach_mm < -half_mm[*k];
    (0..2).find(beyond).map(|k| {
        let (axis, (least, most)) = (["x", "y"][k], places[k]);
        let place = if least == most { format!("{least}") } else { format!("{least} to {most}") };
        let message = format!(
            "{shown} is never in view: [pose] places it at {axis}_mm = {place}, it reaches {} mm from there at most, and \
             the view ends at {} mm",
            format_number(reach_mm),
            half_mm[k]
        );
        Diagnostic::warning(message)
            .explaining_no_contact()
            .help(format!("{axis}_mm counts from the middle of the view, in mm: write {axis}_mm = 0.0"))
            .about(format!("{shown} (reaches {} mm)", format_number(reach_mm)), format!("meshes are never in view: [pose] places them at {axis}_mm = {place}"))
    })
}
