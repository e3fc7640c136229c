//! What is allowed of an object and yet probably not meant, said once for each mesh.

use std::num::NonZeroU32;

use glam::DVec3;

use super::faces;
use crate::config::Job;
use crate::config::scene::Face;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::mesh::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::figures::figure;
use gelsim_files::sensor::quantity::Quantity;

/// Angles between neighbouring facets, degrees, that stand for a round surface: below it no image shows them, above it they
/// are edges.
const ROUND_DEG: [f64; 2] = [1.0, 30.0];

/// Share of a mesh's area in facets that stand for round surfaces, from which on it is said.
const MOSTLY: f64 = 0.5;

/// Width of a facet that is seen for what it is, as a share of the view's shorter side: the pad rounds smaller ones.
const SEEN: f64 = 0.05;

/// The facets of a mesh that stand for round surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facets {
    /// Share of the mesh's area that they make up.
    pub share: f64,
    /// Their width from one such edge to the next, the mean by area, mm. Where two meet it is the narrower one's: a flat face
    /// beside a rounded edge is no facet of it.
    pub width_mm: f64,
    /// Angle between neighbours, the mean by area, degrees.
    pub angle_deg: f64,
}

impl Facets {
    /// Those of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
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
        // Of each triangle the steepest angle to a neighbour that still is a round surface's, and its width across that edge.
        let mut steepest = vec![[0.0_f64; 2]; across.len()];
        let mut edges = Edges::of(mesh);
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            for k in 0..3 {
                let edge = [triangle[k], triangle[(k + 1) % 3]];
                let Some(other) = edges.last_at(edge, number) else { continue };
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

/// The edges of a mesh, each with the triangle that was last seen at it: in a list of that end of it at which fewer triangles
/// are, so that the tip of a fan has no long one.
struct Edges {
    triangles_at: Vec<u32>,
    first: Vec<Option<NonZeroU32>>,
    all: Vec<Edge>,
}

struct Edge {
    other_end: u32,
    triangle: u32,
    /// The next one of the list, counted from 1.
    next: Option<NonZeroU32>,
}

impl Edges {
    /// Of a mesh, none of them seen.
    fn of(mesh: &Mesh) -> Self {
        let mut triangles_at = vec![0; mesh.vertices.len()];
        mesh.triangles.as_flattened().iter().for_each(|vertex| triangles_at[*vertex as usize] += 1);
        let first = vec![None; mesh.vertices.len()];
        Self { triangles_at, first, all: Vec::with_capacity(mesh.triangles.len() * 3 / 2) }
    }

    /// The triangle that was last at an edge, if one was; from now on it is this one.
    fn last_at(&mut self, mut edge: [u32; 2], triangle: usize) -> Option<usize> {
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

/// All that is to be said of a mesh that messages call `shown`, as this job presses it.
pub fn of(shown: &str, job: &Job, scale: &Quantity, object: &Clusters, facets: &Facets) -> Vec<Diagnostic> {
    if job.sensor.resolution_px.contains(&0) {
        return Vec::new();
    }
    let found = [faceted(shown, job, scale, facets), flat(shown, job, object), out_of_view(shown, job, scale, object)];
    found.into_iter().flatten().collect()
}

/// Where the facets of round surfaces are so large that the image shows them.
fn faceted(shown: &str, job: &Job, scale: &Quantity, facets: &Facets) -> Option<Diagnostic> {
    let sensor = &job.sensor;
    let [shorter_mm, px] = match sensor.field_of_view_mm[0] < sensor.field_of_view_mm[1] {
        true => [sensor.field_of_view_mm[0], f64::from(sensor.resolution_px[0])],
        false => [sensor.field_of_view_mm[1], f64::from(sensor.resolution_px[1])],
    };
    let width_mm = facets.width_mm * scale.support().0;
    (facets.share > MOSTLY && width_mm > SEEN * shorter_mm).then(|| {
        let width = figure(width_mm);
        let message = format!(
            "{shown}: its round surfaces are facets some {width} mm ({:.0} px) wide that meet at some {:.1} degrees, which images \
             show",
            width_mm / shorter_mm * px,
            facets.angle_deg
        );
        Diagnostic::note(message)
            .help("export it with smaller facets")
            .of(format!("{shown} ({width} mm)"), "meshes have round surfaces of facets so wide that images show them")
    })
}

/// Where the side that is pressed, always level, is flat and another is not.
fn flat(shown: &str, job: &Job, object: &Clusters) -> Option<Diagnostic> {
    let pose = &job.pose;
    let level = pose.tilt_deg.support() == (0.0, 0.0) && pose.roll_deg.is_none() && pose.pitch_deg.is_none();
    let side = pose.face.side().filter(|_| level && job.sequence.is_none() && job.sensor.shape.is_none())?;
    let reach_mm = job.sensor.gelpad_thickness_mm;
    let other = Face::of(faces::relief_beside(side, object, reach_mm)?).name();
    let side = Face::of(side).name();
    let message = format!("{shown}: its side {side}, which [pose] presses, is flat, and others are not");
    let help = format!(
        "write face = \"auto\" under [pose], which presses of each object the side with the most relief, or face = \"{other}\""
    );
    let cause = format!("meshes are flat on their side {side}, which [pose] presses, and not on others");
    // It may be meant: a side is seen by its outline, too.
    Some(Diagnostic::info(message).help(help).of(shown, cause))
}

/// Where no draw of the pose brings any of the object into view.
fn out_of_view(shown: &str, job: &Job, scale: &Quantity, object: &Clusters) -> Option<Diagnostic> {
    if job.sensor.shape.is_some() || job.sequence.is_some() {
        return None;
    }
    let corner = [DVec3::X, DVec3::Y, DVec3::Z]
        .map(|axis| object.extreme(axis.to_array()).max(object.extreme((-axis).to_array())));
    // From the point that is placed to the farthest one, whatever the turn.
    let across = DVec3::from_array(corner).length();
    let reach_mm = scale.support().1
        * match job.pose.anchor {
            Anchor::Origin => across + DVec3::from_array(object.centre_mm()).length(),
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
            figure(reach_mm),
            half_mm[k]
        );
        Diagnostic::warning(message)
            .explains_misses()
            .help(format!("{axis}_mm counts from the middle of the view, in mm: write {axis}_mm = 0.0"))
            .of(format!("{shown} (reaches {} mm)", figure(reach_mm)), format!("meshes are never in view: [pose] places them at {axis}_mm = {place}"))
    })
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;

    /// A cylinder around z of so many corners.
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
        let facets = Facets::of(&cylinder(36, 5.0));
        assert!((facets.angle_deg - 10.0).abs() < 0.01 && facets.share > 0.999, "{facets:?}");
        assert!((facets.width_mm - 0.8716).abs() < 1e-3, "{facets:?}");
        // Of six corners they are edges, of a thousand nobody sees them.
        assert_eq!(Facets::of(&cylinder(6, 5.0)).share, 0.0);
        assert_eq!(Facets::of(&cylinder(1000, 5.0)).share, 0.0);
    }

    proptest! {
        #[test]
        fn edges_know_the_triangle_that_was_last_at_them(
            triangles in prop::collection::vec(prop::array::uniform3(0..12_u32), 1..60),
        ) {
            let different = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
            let triangles: Vec<[u32; 3]> = triangles.into_iter().filter(different).collect();
            let mesh = Mesh { vertices: vec![[0.0; 3]; 12], triangles, centre_mm: [0.0; 3] };
            let (mut edges, mut known) = (Edges::of(&mesh), HashMap::new());
            for (number, triangle) in mesh.triangles.iter().enumerate() {
                for k in 0..3 {
                    let [a, b] = [triangle[k], triangle[(k + 1) % 3]];
                    prop_assert_eq!(edges.last_at([a, b], number), known.insert([a.min(b), a.max(b)], number));
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
        let facets = Facets::of(&Mesh::new(vertices, triangles).expect("a mesh").0);
        assert!(facets.width_mm < 0.2, "{facets:?}");
    }
}
