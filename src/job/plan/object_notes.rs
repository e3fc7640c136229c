//! Notes on the objects of a job: what is allowed but probably not meant. Each is made once for each mesh.

use std::num::NonZeroU32;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::meshes::MeshFacts;
use crate::config::Job;
use crate::config::scene::Face;
use crate::inspection::MeshSize;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::mesh::Mesh;
use gelsim_core::pose::{Anchor, Side};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::number_format::format_number;
use gelsim_files::sensor::quantity::Quantity;

/// Angles between neighbouring facets, degrees, that approximate a round surface. Smaller ones are not visible in any
/// image, and larger ones are edges.
const ROUND_DEG: [f64; 2] = [1.0, 30.0];

/// Fraction of a mesh's area in facets of round surfaces from which on there is a note.
const MIN_FACET_SHARE: f64 = 0.5;

/// Width from which a facet is visible, as a fraction of the view's shorter side. The pad smooths narrower ones.
const MIN_VISIBLE_WIDTH: f64 = 0.05;

/// The facets of a mesh that approximate round surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Facets {
    /// Fraction of the mesh's area in such facets.
    pub share: f64,
    /// Mean width of such facets between their edges, weighted by area, mm. At an edge the width of the narrower facet
    /// counts, so that a flat face beside a rounded edge is no facet of it.
    pub width_mm: f64,
    /// Mean angle between neighbours, weighted by area, degrees.
    pub angle_deg: f64,
}

impl Facets {
    /// Measures the facets of a mesh.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let corners = |triangle: &[u32; 3]| {
            triangle.map(|vertex| DVec3::from_array(mesh.vertices[vertex as usize].map(f64::from)))
        };
        let across: Vec<DVec3> = mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = corners(triangle);
                0.5 * (b - a).cross(c - a)
            })
            .collect();
        let steepest_cos = ROUND_DEG.map(|deg| sin_cos_deg(deg).1);
        // For each triangle: the largest angle to a neighbour that still belongs to a round surface, and the width
        // across that edge.
        let mut steepest = vec![[0.0_f64; 2]; across.len()];
        let mut edges = MeshEdges::from_mesh(mesh);
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            for k in 0..3 {
                let edge = [triangle[k], triangle[(k + 1) % 3]];
                let Some(other) = edges.replace_last_triangle(edge, number) else { continue };
                let areas = [across[number], across[other]].map(DVec3::length);
                let cos = across[number].dot(across[other]) / (areas[0] * areas[1]);
                if cos < steepest_cos[0] && cos >= steepest_cos[1] {
                    let angle_deg = across[number].angle_between(across[other]).to_degrees();
                    let [a, b, _] = corners(&[edge[0], edge[1], 0]);
                    let narrower = areas[0].min(areas[1]);
                    for own in [number, other] {
                        if steepest[own][0] < angle_deg {
                            steepest[own] = [angle_deg, 2.0 * narrower / a.distance(b)];
                        }
                    }
                }
            }
        }
        let (mut all, mut round, mut width, mut angle) = (0.0, 0.0, 0.0, 0.0);
        for (across, [angle_deg, width_mm]) in across.iter().zip(steepest) {
            let area = across.length();
            all += area;
            if angle_deg > 0.0 {
                round += area;
                width += area * width_mm;
                angle += area * angle_deg;
            }
        }
        let mean = |sum: f64| if round > 0.0 { sum / round } else { 0.0 };
        Self { share: if all > 0.0 { round / all } else { 0.0 }, width_mm: mean(width), angle_deg: mean(angle) }
    }
}

/// The edges of a mesh, each with the triangle that was last seen at it. An edge is in the list of that of its ends at
/// which fewer triangles meet, so that the tip of a fan has no long list.
struct MeshEdges {
    triangles_at: Vec<u32>,
    first: Vec<Option<NonZeroU32>>,
    all: Vec<Edge>,
}

struct Edge {
    other_end: u32,
    triangle: u32,
    /// The next edge of the list, counted from 1.
    next: Option<NonZeroU32>,
}

impl MeshEdges {
    /// Prepares for the edges of a mesh, none of which was seen yet.
    fn from_mesh(mesh: &Mesh) -> Self {
        let mut triangles_at = vec![0; mesh.vertices.len()];
        mesh.triangles.as_flattened().iter().for_each(|vertex| triangles_at[*vertex as usize] += 1);
        let first = vec![None; mesh.vertices.len()];
        Self { triangles_at, first, all: Vec::with_capacity(mesh.triangles.len() * 3 / 2) }
    }

    /// Records a triangle at an edge, and returns the one that was recorded there before, if any.
    fn replace_last_triangle(&mut self, mut edge: [u32; 2], triangle: usize) -> Option<usize> {
        edge.sort_unstable_by_key(|vertex| (self.triangles_at[*vertex as usize], *vertex));
        let [end, other_end] = edge;
        let first = &mut self.first[end as usize];
        let mut next = *first;
        while let Some(at) = next {
            let edge = &mut self.all[at.get() as usize - 1];
            if edge.other_end == other_end {
                return Some(std::mem::replace(&mut edge.triangle, triangle as u32) as usize);
            }
            next = edge.next;
        }
        self.all.push(Edge { other_end, triangle: triangle as u32, next: *first });
        *first = NonZeroU32::new(self.all.len() as u32);
        None
    }
}

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

/// Returns the side of all objects that a job always presses level, if it does so.
pub fn find_level_side(job: &Job) -> Option<Side> {
    let pose = &job.pose;
    let level = pose.tilt_deg.support() == (0.0, 0.0) && pose.roll_deg.is_none() && pose.pitch_deg.is_none();
    pose.face.side().filter(|_| level && pose.at.is_side() && job.sequence.is_none() && job.sensor.shape.is_none())
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

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;

    /// A cylinder around z with this many corners.
    fn cylinder(corners: u32, radius_mm: f64) -> Mesh {
        let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(corners);
        let ring = |z: f64| (0..corners).map(move |k| [radius_mm * angle(k).cos(), radius_mm * angle(k).sin(), z]);
        let vertices = ring(0.0).chain(ring(20.0)).collect();
        let quad = |k: u32| [k, (k + 1) % corners, (k + 1) % corners + corners, k + corners];
        let triangles = (0..corners).map(quad).flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Mesh::new(vertices, triangles).expect("a mesh").0
    }

    #[test]
    fn facets_of_a_cylinder_meet_at_a_turn_over_its_corners() {
        let facets = Facets::from_mesh(&cylinder(36, 5.0));
        assert!((facets.angle_deg - 10.0).abs() < 0.01 && facets.share > 0.999, "{facets:?}");
        assert!((facets.width_mm - 0.8716).abs() < 1e-3, "{facets:?}");
        // With six corners they are edges; with a thousand nobody sees them.
        assert_eq!(Facets::from_mesh(&cylinder(6, 5.0)).share, 0.0);
        assert_eq!(Facets::from_mesh(&cylinder(1000, 5.0)).share, 0.0);
    }

    proptest! {
        #[test]
        fn edges_know_the_triangle_that_was_last_at_them(
            triangles in prop::collection::vec(prop::array::uniform3(0..12_u32), 1..60),
        ) {
            let different = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
            let triangles: Vec<[u32; 3]> = triangles.into_iter().filter(different).collect();
            let mesh = Mesh { vertices: vec![[0.0; 3]; 12], triangles, centre_mm: [0.0; 3] };
            let (mut edges, mut known) = (MeshEdges::from_mesh(&mesh), HashMap::new());
            for (number, triangle) in mesh.triangles.iter().enumerate() {
                for k in 0..3 {
                    let [a, b] = [triangle[k], triangle[(k + 1) % 3]];
                    prop_assert_eq!(edges.replace_last_triangle([a, b], number), known.insert([a.min(b), a.max(b)], number));
                }
            }
        }
    }

    #[test]
    fn a_flat_face_beside_a_rounded_edge_is_no_facet() {
        // A plate 20 mm wide and 10 mm long whose two sides are rounded, in eight steps each, with 1 mm.
        let turn = |k: u32| std::f64::consts::FRAC_PI_2 * f64::from(k) / 8.0;
        let right: Vec<[f64; 2]> = (0..=8).map(|k| [10.0 + turn(k).sin(), turn(k).cos() - 1.0]).collect();
        let section: Vec<[f64; 2]> = right.iter().rev().map(|[x, z]| [-x, *z]).chain(right.iter().copied()).collect();
        let count = section.len() as u32;
        let along = |y: f64| section.iter().map(move |[x, z]| [*x, y, *z]);
        let vertices = along(0.0).chain(along(10.0)).collect();
        let quad = |k: u32| [k, k + 1, k + 1 + count, k + count];
        let triangles = (0..count - 1).map(quad).flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let facets = Facets::from_mesh(&Mesh::new(vertices, triangles).expect("a mesh").0);
        assert!(facets.width_mm < 0.2, "{facets:?}");
    }
}
