//! Facets of a mesh: flat triangles that stand for a round surface.

use std::num::NonZeroU32;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Mesh;
use crate::base::angle::sin_cos_deg;

/// Angles between neighbouring facets, degrees, that approximate a round surface. Smaller ones are not visible in any
/// image, and larger ones are edges.
const ROUND_DEG: [f64; 2] = [1.0, 30.0];

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
        let areas: Vec<f64> = across.iter().map(|across| across.length()).collect();
        let steepest_cos = ROUND_DEG.map(|deg| sin_cos_deg(deg).1);
        // For each triangle: the least cosine to a neighbour that still belongs to a round surface, and the width across
        // that edge.
        let mut steepest = vec![[f64::INFINITY, 0.0]; across.len()];
        let mut edges = MeshEdges::from_mesh(mesh);
        for (number, triangle) in mesh.triangles.iter().enumerate() {
            for k in 0..3 {
                let edge = [triangle[k], triangle[(k + 1) % 3]];
                let Some(other) = edges.replace_last_triangle(edge, number) else { continue };
                let cos = across[number].dot(across[other]) / (areas[number] * areas[other]);
                if cos < steepest_cos[0] && cos >= steepest_cos[1] {
                    let [a, b, _] = corners(&[edge[0], edge[1], 0]);
                    let narrower = areas[number].min(areas[other]);
                    for own in [number, other] {
                        if cos < steepest[own][0] {
                            steepest[own] = [cos, 2.0 * narrower / a.distance(b)];
                        }
                    }
                }
            }
        }
        let (mut all, mut round, mut width, mut angle) = (0.0, 0.0, 0.0, 0.0);
        for (area, [cos, width_mm]) in areas.into_iter().zip(steepest) {
            all += area;
            if cos.is_finite() {
                round += area;
                width += area * width_mm;
                angle += area * libm::acos(cos).to_degrees();
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
