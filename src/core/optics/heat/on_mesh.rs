//! Light that runs along a gel that is a mesh, from LEDs at its rim: the model of `heat.rs` on triangles.
//!
//! Linear elements over a mesh whose edges are shorter than the light's reach. Densities fall over many powers of ten
//! from the LED on; how they fall counts, not how much is left. So the solver sweeps over the vertices, outwards and
//! back, which keeps the relative accuracy of each.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::remesh::remesh_evenly;
use super::{LED_WIDTH_RAD, REACH, SPREAD, wrap_angle};
use crate::base::gel_surface::GelSurface;
use crate::base::gel_surface::tree::TriangleTree;
use crate::base::triangle::nearest_point_on_triangle;

/// Longest edge, in reaches of the light.
const LONGEST_EDGE: f64 = 0.4;
/// Relative change of the density below which sweeps end.
const CONVERGENCE: f64 = 1e-4;
/// Largest number of sweeps.
const MAX_SWEEPS: usize = 2000;

/// Directions of the light of LEDs at the rim.
pub struct HeatOnMesh {
    points: Vec<DVec3>,
    corners: Vec<[u32; 3]>,
    tree: TriangleTree,
    /// For each LED its azimuth, rad, and at each vertex the direction to it, of length 1 at most, and how far it is,
    /// mm.
    leds: Vec<(f64, Vec<(DVec3, f64)>)>,
}

/// The neighbours of a vertex, and the weights between it and them.
type NeighbourWeights = Vec<(u32, f64)>;

impl HeatOnMesh {
    /// Solves for the light of LEDs at these azimuths, rad.
    pub fn new(surface: &GelSurface, azimuths: impl Iterator<Item = f64>) -> Self {
        let reach_mm = REACH * surface.size_mm();
        let (points, corners) = remesh_evenly(surface.mesh(), LONGEST_EDGE * reach_mm);
        let triangles: Vec<[DVec3; 3]> = corners.iter().map(|c| c.map(|corner| points[corner as usize])).collect();
        let (neighbours, areas, rim) = assemble_matrix(&points, &corners, &triangles);
        let mut leds: Vec<(f64, Vec<(DVec3, f64)>)> = Vec::new();
        for azimuth in azimuths {
            if !leds.iter().any(|(known, _)| *known == azimuth) {
                let density = solve_density(&points, &neighbours, &areas, &rim, azimuth, reach_mm);
                leds.push((azimuth, directions_to_led(&corners, &triangles, &density, reach_mm)));
            }
        }
        Self { tree: TriangleTree::new(&triangles), points, corners, leds }
    }

    /// Returns the direction along the gel from a point of it towards an LED of this azimuth, of length 1 at most, and
    /// how far it is, mm; zeros if there is no such LED.
    pub fn direction_and_distance_mm(&self, point_mm: DVec3, normal: DVec3, azimuth: f64) -> (DVec3, f64) {
        let Some((_, ways)) = self.leds.iter().find(|(known, _)| *known == azimuth) else { return (DVec3::ZERO, 0.0) };
        let corners = |triangle: usize| self.corners[triangle].map(|corner| self.points[corner as usize]);
        let mut best = (f64::INFINITY, 0, DVec3::ZERO);
        let distance = |low: DVec3, high: DVec3| point_mm.distance_squared(point_mm.clamp(low, high));
        self.tree.visit_nearest(distance, f64::INFINITY, |triangle| {
            let [a, b, c] = corners(triangle);
            let at = nearest_point_on_triangle(point_mm, a, b, c);
            let away = point_mm.distance_squared(at);
            if away < best.0 {
                best = (away, triangle, at);
            }
            best.0
        });
        let (_, triangle, at) = best;
        let [a, b, c] = corners(triangle);
        let facet = (b - a).cross(c - a);
        let shares = [(b, c), (c, a), (a, b)].map(|(p, q)| (q - p).cross(at - p).dot(facet) / facet.length_squared());
        let (mut towards, mut away_mm) = (DVec3::ZERO, 0.0);
        for (corner, share) in self.corners[triangle].iter().zip(shares) {
            let (way, mm) = ways[*corner as usize];
            towards += share * way;
            away_mm += share * mm;
        }
        (towards - normal * normal.dot(towards), away_mm)
    }
}

/// Assembles the weights between vertices, the area of each vertex, and how much of the rim belongs to it, mm.
fn assemble_matrix(
    points: &[DVec3],
    corners: &[[u32; 3]],
    triangles: &[[DVec3; 3]],
) -> (Vec<NeighbourWeights>, Vec<f64>, Vec<f64>) {
    let mut weights: BTreeMap<[u32; 2], (f64, u32)> = BTreeMap::new();
    let mut areas = vec![0.0; points.len()];
    for (corners, triangle) in corners.iter().zip(triangles) {
        let double = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).length().max(f64::MIN_POSITIVE);
        for k in 0..3 {
            areas[corners[k] as usize] += double / 6.0;
            let (a, b) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let [p, q] = [(k + 1) % 3, (k + 2) % 3].map(|other| triangle[other] - triangle[k]);
            let weight = weights.entry([a.min(b), a.max(b)]).or_default();
            *weight = (weight.0 + 0.5 * p.dot(q) / double, weight.1 + 1);
        }
    }
    let mut neighbours = vec![NeighbourWeights::new(); points.len()];
    let mut rim = vec![0.0; points.len()];
    for ([a, b], (weight, triangles)) in weights {
        // Weights of edges opposite wide angles would be negative: light would then come from where there is less of
        // it.
        let weight = weight.max(0.0);
        neighbours[a as usize].push((b, weight));
        neighbours[b as usize].push((a, weight));
        if triangles == 1 {
            let half_mm = 0.5 * points[a as usize].distance(points[b as usize]);
            rim[a as usize] += half_mm;
            rim[b as usize] += half_mm;
        }
    }
    (neighbours, areas, rim)
}

/// Solves for the density of light at each vertex, from an LED at the rim.
fn solve_density(
    points: &[DVec3],
    neighbours: &[NeighbourWeights],
    areas: &[f64],
    rim: &[f64],
    azimuth: f64,
    reach_mm: f64,
) -> Vec<f64> {
    let source = |vertex: usize| {
        let off = wrap_angle(libm::atan2(points[vertex].y, points[vertex].x) - azimuth) / LED_WIDTH_RAD;
        rim[vertex] * libm::exp(-0.5 * off * off)
    };
    let sources: Vec<f64> = (0..points.len()).map(source).collect();
    let away = edge_distances_mm(points, neighbours, &sources);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| away[*a].total_cmp(&away[*b]).then(a.cmp(b)));
    let lost = |vertex: usize| areas[vertex] / (reach_mm * reach_mm);
    let diagonal: Vec<f64> = (0..points.len())
        .map(|vertex| lost(vertex) + neighbours[vertex].iter().map(|(_, weight)| weight).sum::<f64>())
        .collect();
    // The start is close to the solution.
    let guess = |vertex: usize| libm::exp(-away[vertex] / reach_mm);
    let mut density: Vec<f64> = (0..points.len()).map(guess).collect();
    for _ in 0..MAX_SWEEPS {
        let mut changed = 0.0_f64;
        // Each sweep goes outwards from the LED, and back.
        for vertex in order.iter().chain(order.iter().rev()) {
            let arrives: f64 =
                neighbours[*vertex].iter().map(|(other, weight)| weight * density[*other as usize]).sum();
            let next = (sources[*vertex] + arrives) / diagonal[*vertex].max(f64::MIN_POSITIVE);
            changed = changed.max((next - density[*vertex]).abs() / next.max(f64::MIN_POSITIVE));
            density[*vertex] = next;
        }
        if changed < CONVERGENCE {
            break;
        }
    }
    density
}

/// Computes how far each vertex is from the LED along edges, mm (Dijkstra).
fn edge_distances_mm(points: &[DVec3], neighbours: &[NeighbourWeights], sources: &[f64]) -> Vec<f64> {
    let strongest = sources.iter().copied().fold(0.0, f64::max);
    let mut away = vec![f64::INFINITY; points.len()];
    let mut open: BTreeSet<(u64, usize)> = BTreeSet::new();
    for vertex in (0..points.len()).filter(|vertex| sources[*vertex] > 0.5 * strongest) {
        away[vertex] = 0.0;
        open.insert((0, vertex));
    }
    // Lengths are not negative, so their bits sort as they do.
    while let Some((_, vertex)) = open.pop_first() {
        for (other, _) in &neighbours[vertex] {
            let other = *other as usize;
            let there = away[vertex] + points[vertex].distance(points[other]);
            if there < away[other] {
                open.remove(&(away[other].to_bits(), other));
                away[other] = there;
                open.insert((there.to_bits(), other));
            }
        }
    }
    away
}

/// Computes at each vertex the direction to the LED, and how far it is, mm.
fn directions_to_led(
    corners: &[[u32; 3]],
    triangles: &[[DVec3; 3]],
    density: &[f64],
    reach_mm: f64,
) -> Vec<(DVec3, f64)> {
    let mut sums = vec![(DVec3::ZERO, 0.0); density.len()];
    for (corners, [a, b, c]) in corners.iter().zip(triangles) {
        let facet = (*b - *a).cross(*c - *a);
        let square = facet.length_squared().max(f64::MIN_POSITIVE);
        let of = corners.map(|corner| density[corner as usize]);
        let slope =
            (of[0] * facet.cross(*c - *b) + of[1] * facet.cross(*a - *c) + of[2] * facet.cross(*b - *a)) / square;
        let mean = ((of[0] + of[1] + of[2]) / 3.0).max(f64::MIN_POSITIVE);
        let area = facet.length();
        for corner in corners {
            let sum = &mut sums[*corner as usize];
            *sum = (sum.0 + area * slope / mean, sum.1 + area);
        }
    }
    let at_led = density.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let way = |((slope, area), density): ((DVec3, f64), &f64)| {
        let towards = (reach_mm / SPREAD * slope / area.max(f64::MIN_POSITIVE)).clamp_length_max(1.0);
        (towards, (-reach_mm * libm::log(density.max(f64::MIN_POSITIVE) / at_led)).max(0.0))
    };
    sums.into_iter().zip(density).map(way).collect()
}
