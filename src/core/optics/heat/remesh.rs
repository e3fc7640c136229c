//! Remeshes a surface so that its edges are about as long as each other: short ones are collapsed, long ones split.

use std::collections::BTreeMap;

use glam::DVec3;

/// Vertices and triangles.
pub(super) type Triangles = (Vec<DVec3>, Vec<[u32; 3]>);

/// Shortest edge that stays, as a fraction of the longest.
const SHORTEST_EDGE: f64 = 0.35;

/// Remeshes a surface with edges no longer than `longest_mm`, and hardly any much shorter.
pub(super) fn remesh_evenly(mesh: Triangles, longest_mm: f64) -> Triangles {
    let coarse =
        flip_edges(collapse_edges(flip_edges(split_edges(mesh, 2.0 * longest_mm)), SHORTEST_EDGE * longest_mm));
    flip_edges(split_edges(coarse, longest_mm))
}

/// Flips edges that are opposite two wide angles, until there is none. The triangles are then Delaunay's, and no weight
/// between vertices is negative.
fn flip_edges((points, mut corners): Triangles) -> Triangles {
    const MAX_PASSES: usize = 60;
    for _ in 0..MAX_PASSES {
        let mut edges: BTreeMap<[u32; 2], Vec<(usize, usize)>> = BTreeMap::new();
        for (number, corner) in corners.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (corner[k], corner[(k + 1) % 3]);
                edges.entry([a.min(b), a.max(b)]).or_default().push((number, k));
            }
        }
        let point = |vertex: u32| points[vertex as usize];
        let facet = |[a, b, c]: [u32; 3]| (point(b) - point(a)).cross(point(c) - point(a));
        let mut touched = vec![false; corners.len()];
        let mut any_flipped = false;
        let mut new_edges = std::collections::BTreeSet::new();
        for sides in edges.values() {
            let [(first, k), (second, j)] = sides[..] else { continue };
            let [a, b, c] = [0, 1, 2].map(|n| corners[first][(k + n) % 3]);
            let d = corners[second][(j + 2) % 3];
            let between = [c.min(d), c.max(d)];
            if touched[first]
                || touched[second]
                || c == d
                || edges.contains_key(&between)
                || new_edges.contains(&between)
            {
                continue;
            }
            let cotangent = |apex: u32| {
                let (p, q) = (point(a) - point(apex), point(b) - point(apex));
                p.dot(q) / p.cross(q).length().max(f64::MIN_POSITIVE)
            };
            let whole = facet([a, b, c]) + facet([b, a, d]);
            let [one, other] = [[a, d, c], [d, b, c]];
            let upright = facet(one).dot(whole) > 0.0 && facet(other).dot(whole) > 0.0;
            if cotangent(c) + cotangent(d) < -1e-9 && upright {
                (corners[first], corners[second]) = (one, other);
                (touched[first], touched[second]) = (true, true);
                new_edges.insert(between);
                any_flipped = true;
            }
        }
        if !any_flipped {
            break;
        }
    }
    (points, corners)
}

/// Splits edges that are too long in their middles, until none is.
fn split_edges((mut points, mut corners): Triangles, longest_mm: f64) -> Triangles {
    loop {
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut next = Vec::with_capacity(corners.len());
        for corner in &corners {
            let middle = [0, 1, 2].map(|k| {
                let (a, b) = (corner[k], corner[(k + 1) % 3]);
                let ends = [points[a as usize], points[b as usize]];
                (ends[0].distance(ends[1]) > longest_mm).then(|| {
                    *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                        points.push(0.5 * (ends[0] + ends[1]));
                        points.len() as u32 - 1
                    })
                })
            });
            // Starts at a split edge after one that is not split, if there is one: this leaves four cases.
            let first = (0..3).find(|k| middle[*k].is_some() && middle[(k + 2) % 3].is_none()).unwrap_or(0);
            let [a, b, c] = [0, 1, 2].map(|k| corner[(first + k) % 3]);
            match [0, 1, 2].map(|k| middle[(first + k) % 3]) {
                [None, _, _] => next.push([a, b, c]),
                [Some(p), None, _] => next.extend([[a, p, c], [p, b, c]]),
                [Some(p), Some(q), None] => next.extend([[a, p, c], [p, q, c], [p, b, q]]),
                [Some(p), Some(q), Some(r)] => next.extend([[a, p, r], [p, b, q], [r, q, c], [p, q, r]]),
            }
        }
        corners = next;
        if middles.is_empty() {
            return (points, corners);
        }
    }
}

/// Collapses edges that are too short, as long as no triangle turns over and the surface keeps its topology.
fn collapse_edges((points, mut corners): Triangles, shortest_mm: f64) -> Triangles {
    const MAX_PASSES: usize = 40;
    for _ in 0..MAX_PASSES {
        let mut around: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
        let mut edges: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for (number, corner) in corners.iter().enumerate() {
            for k in 0..3 {
                around[corner[k] as usize].push(number);
                let (a, b) = (corner[k], corner[(k + 1) % 3]);
                *edges.entry([a.min(b), a.max(b)]).or_default() += 1;
            }
        }
        let mut at_rim = vec![false; points.len()];
        for ([a, b], _) in edges.iter().filter(|(_, triangles)| **triangles == 1) {
            (at_rim[*a as usize], at_rim[*b as usize]) = (true, true);
        }
        let mut touched = vec![false; points.len()];
        let mut gone = vec![false; corners.len()];
        for ([a, b], sides) in &edges {
            let length = points[*a as usize].distance(points[*b as usize]);
            // The first vertex goes, unless it is on the rim and the other is not.
            let (from, to) = if at_rim[*a as usize] && !at_rim[*b as usize] { (*b, *a) } else { (*a, *b) };
            let across_rim = at_rim[*a as usize] && at_rim[*b as usize] && *sides == 2;
            let ring = |vertex: u32| around[vertex as usize].iter().flat_map(|number| corners[*number]);
            if length >= shortest_mm || across_rim || ring(from).chain(ring(to)).any(|vertex| touched[vertex as usize])
            {
                continue;
            }
            // The surface keeps its topology if the two ends share only the vertices opposite their edge.
            let mut common: Vec<u32> = ring(from)
                .filter(|vertex| *vertex != from && *vertex != to && ring(to).any(|v| v == *vertex))
                .collect();
            common.sort_unstable();
            common.dedup();
            let facet = |corner: [u32; 3]| {
                let [p, q, r] = corner.map(|corner| points[corner as usize]);
                (q - p).cross(r - p)
            };
            let moved = |corner: [u32; 3]| corner.map(|corner| if corner == from { to } else { corner });
            let stay = || around[from as usize].iter().filter(|number| !corners[**number].contains(&to));
            let upright = |number: &usize| {
                let (before, after) = (facet(corners[*number]), facet(moved(corners[*number])));
                // Turned by less than 60 degrees.
                before.normalize_or_zero().dot(after.normalize_or_zero()) > 0.5
            };
            if common.len() != *sides || !stay().all(upright) {
                continue;
            }
            let vertices: Vec<u32> = ring(from).chain(ring(to)).collect();
            vertices.iter().for_each(|vertex| touched[*vertex as usize] = true);
            let numbers: Vec<usize> = around[from as usize].clone();
            for number in numbers {
                gone[number] |= corners[number].contains(&to);
                corners[number] = moved(corners[number]);
            }
        }
        if !gone.contains(&true) {
            break;
        }
        let mut is_gone = gone.into_iter();
        corners.retain(|_| is_gone.next() == Some(false));
    }
    // Drops the vertices that no triangle uses any more.
    let mut numbers = vec![u32::MAX; points.len()];
    let mut kept = Vec::new();
    for corner in corners.as_flattened_mut() {
        let number = &mut numbers[*corner as usize];
        if *number == u32::MAX {
            *number = kept.len() as u32;
            kept.push(points[*corner as usize]);
        }
        *corner = *number;
    }
    (kept, corners)
}
