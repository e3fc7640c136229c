//! Light that runs along a gel that is a mesh, from LEDs at its rim: the same as in `heat.rs`, on triangles.
//!
//! Linear elements over a mesh whose edges are shorter than the light's reach. Densities fall over many powers of ten from the LED
//! on, and how they fall counts, not how much is left: sweeps outwards and back keep each one's own digits.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::even_mesh::even;
use super::{LED_RAD, REACH, SPREAD, half_turn};
use crate::base::surface::Surface;
use crate::base::surface::tree::Tree;
use crate::base::triangle::nearest_of_triangle;

/// Longest edge, in reaches of the light.
const LONGEST: f64 = 0.4;
/// Share of the density by which no sweep changes any more.
const SETTLED: f64 = 1e-4;
const MOST_SWEEPS: usize = 2000;

/// Directions of the light of LEDs at the rim.
pub struct HeatOnMesh {
    points: Vec<DVec3>,
    corners: Vec<[u32; 3]>,
    tree: Tree,
    /// Azimuth of each LED, and at each vertex the way to it, of length 1 at most, and how far that is, mm.
    leds: Vec<(f64, Vec<(DVec3, f64)>)>,
}

/// A vertex beside another one, and the weight between them.
type Beside = Vec<(u32, f64)>;

impl HeatOnMesh {
    pub fn new(surface: &Surface, azimuths: impl Iterator<Item = f64>) -> Self {
        let reach_mm = REACH * surface.size_mm();
        let (points, corners) = even(surface.mesh(), LONGEST * reach_mm);
        let triangles: Vec<[DVec3; 3]> = corners.iter().map(|c| c.map(|corner| points[corner as usize])).collect();
        let (beside, areas, rim) = matrix(&points, &corners, &triangles);
        let mut leds: Vec<(f64, Vec<(DVec3, f64)>)> = Vec::new();
        for azimuth in azimuths {
            if !leds.iter().any(|(known, _)| *known == azimuth) {
                let density = density(&points, &beside, &areas, &rim, azimuth, reach_mm);
                leds.push((azimuth, ways(&corners, &triangles, &density, reach_mm)));
            }
        }
        Self { tree: Tree::new(&triangles), points, corners, leds }
    }

    /// Towards an LED of this azimuth along the gel from a point of it, of length 1 at most, and how far it is, mm.
    pub fn at(&self, point_mm: DVec3, normal: DVec3, azimuth: f64) -> (DVec3, f64) {
        let Some((_, ways)) = self.leds.iter().find(|(known, _)| *known == azimuth) else { return (DVec3::ZERO, 0.0) };
        let corners = |triangle: usize| self.corners[triangle].map(|corner| self.points[corner as usize]);
        let mut best = (f64::INFINITY, 0, DVec3::ZERO);
        let distance = |low: DVec3, high: DVec3| point_mm.distance_squared(point_mm.clamp(low, high));
        self.tree.visit_nearest(distance, f64::INFINITY, |triangle| {
            let [a, b, c] = corners(triangle);
            let at = nearest_of_triangle(point_mm, a, b, c);
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

/// The weights between vertices, the area of each, and how much of the rim belongs to it, mm.
fn matrix(points: &[DVec3], corners: &[[u32; 3]], triangles: &[[DVec3; 3]]) -> (Vec<Beside>, Vec<f64>, Vec<f64>) {
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
    let mut beside = vec![Beside::new(); points.len()];
    let mut rim = vec![0.0; points.len()];
    for ([a, b], (weight, triangles)) in weights {
        // Across edges opposite wide angles nothing flows; light does not come from where there is less of it.
        let weight = weight.max(0.0);
        beside[a as usize].push((b, weight));
        beside[b as usize].push((a, weight));
        if triangles == 1 {
            let half_mm = 0.5 * points[a as usize].distance(points[b as usize]);
            rim[a as usize] += half_mm;
            rim[b as usize] += half_mm;
        }
    }
    (beside, areas, rim)
}

/// At each vertex, from an LED at the rim.
fn density(points: &[DVec3], beside: &[Beside], areas: &[f64], rim: &[f64], azimuth: f64, reach_mm: f64) -> Vec<f64> {
    let source = |vertex: usize| {
        let off = half_turn(libm::atan2(points[vertex].y, points[vertex].x) - azimuth) / LED_RAD;
        rim[vertex] * libm::exp(-0.5 * off * off)
    };
    let sources: Vec<f64> = (0..points.len()).map(source).collect();
    let away = away(points, beside, &sources);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| away[*a].total_cmp(&away[*b]).then(a.cmp(b)));
    let lost = |vertex: usize| areas[vertex] / (reach_mm * reach_mm);
    let all: Vec<f64> = (0..points.len())
        .map(|vertex| lost(vertex) + beside[vertex].iter().map(|(_, weight)| weight).sum::<f64>())
        .collect();
    // Not far from what comes out.
    let guess = |vertex: usize| libm::exp(-away[vertex] / reach_mm);
    let mut density: Vec<f64> = (0..points.len()).map(guess).collect();
    for _ in 0..MOST_SWEEPS {
        let mut changed = 0.0_f64;
        for vertex in order.iter().chain(order.iter().rev()) {
            let arrives: f64 = beside[*vertex].iter().map(|(other, weight)| weight * density[*other as usize]).sum();
            let next = (sources[*vertex] + arrives) / all[*vertex].max(f64::MIN_POSITIVE);
            changed = changed.max((next - density[*vertex]).abs() / next.max(f64::MIN_POSITIVE));
            density[*vertex] = next;
        }
        if changed < SETTLED {
            break;
        }
    }
    density
}

/// At each vertex, how far it is from the LED along edges, mm (Dijkstra).
fn away(points: &[DVec3], beside: &[Beside], sources: &[f64]) -> Vec<f64> {
    let strongest = sources.iter().copied().fold(0.0, f64::max);
    let mut away = vec![f64::INFINITY; points.len()];
    let mut open: BTreeSet<(u64, usize)> = BTreeSet::new();
    for vertex in (0..points.len()).filter(|vertex| sources[*vertex] > 0.5 * strongest) {
        away[vertex] = 0.0;
        open.insert((0, vertex));
    }
    // Lengths are above 0: their bits are in their order.
    while let Some((_, vertex)) = open.pop_first() {
        for (other, _) in &beside[vertex] {
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

/// At each vertex, the way to the LED and how far it is, mm.
fn ways(corners: &[[u32; 3]], triangles: &[[DVec3; 3]], density: &[f64], reach_mm: f64) -> Vec<(DVec3, f64)> {
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
