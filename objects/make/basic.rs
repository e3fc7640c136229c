//! The elementary surfaces: ball, faces, edges, corners, punches and rings.

use crate::outline::{polar, rounded_rectangle};
use crate::solid::{P2, P3, Solid, at};
use crate::sweep::{revolve, ring, rise, round};

/// Chords round a straight-sided round thing: 2 degrees each.
const ROUND: usize = 180;

/// A ball of 4 mm radius as six gnomonic grids of equal angles, so that no facet is a sliver.
pub fn sphere() -> Solid {
    const CELLS: usize = 37;
    let tan = |i: usize| libm::tan((90.0 * i as f64 / CELLS as f64 - 45.0).to_radians());
    let mut solid = Solid::fine();
    for axis in 0..3 {
        let point = |i: usize, j: usize, sign: f64| {
            let (u, v) = (tan(i), tan(j));
            let r = sign * 4.0 / (1.0 + u * u + v * v).sqrt();
            let mut p = [r, r * u, r * v];
            p.rotate_right(axis);
            p
        };
        for i in 0..CELLS {
            for j in 0..CELLS {
                let cell = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                solid.face(&cell.map(|(i, j)| point(i, j, 1.0)));
                let mut far = cell.map(|(i, j)| point(i, j, -1.0));
                far.reverse();
                solid.face(&far);
            }
        }
    }
    solid
}

/// A block with a large flat face whose edges are rounded.
pub fn flat_face() -> Solid {
    const FILLET_MM: f64 = 0.3;
    let outline = rounded_rectangle(14.0, 10.0, 1.0, 16);
    let mut solid = Solid::fine();
    let mut steps = vec![[0.0, 4.0 - FILLET_MM]];
    steps.extend(fillet(FILLET_MM, 8).map(|[d, dz]| [d, 4.0 - FILLET_MM + dz]));
    let face = rise(&mut solid, &outline, 0.0, &steps);
    solid.cap_up(&face, &[], 4.0);
    solid.cap_down(&outline, &[], 0.0);
    solid
}

/// A blade 1 mm thick with a rounded crest, standing 2.5 mm above its foot.
pub fn thin_ridge() -> Solid {
    let foot = rounded_rectangle(15.0, 7.0, 1.0, 8);
    let blade = rounded_rectangle(12.0, 1.0, 0.5, 14);
    let mut solid = Solid::fine();
    rise(&mut solid, &foot, 0.0, &[[0.0, 2.0]]);
    solid.cap_down(&foot, &[], 0.0);
    solid.cap_up(&foot, std::slice::from_ref(&blade), 2.0);
    let mut steps = vec![[0.0, 2.1]];
    steps.extend(fillet(0.4, 9).map(|[d, dz]| [d, 2.1 + dz]));
    let crest = rise(&mut solid, &blade, 2.0, &steps);
    solid.cap_up(&crest, &[], 4.5);
    solid
}

/// A square prism of 8 mm standing on one corner, where three faces meet at right angles.
pub fn prism_corner() -> Solid {
    let (a, b, c) = (1.0 / 6f64.sqrt(), 1.0 / 3f64.sqrt(), 1.0 / 2f64.sqrt());
    let mut solid = Solid::fine().turned([[a, a, -2.0 * a], [-c, c, 0.0], [b, b, b]]);
    block(&mut solid, [8.0; 3]);
    solid
}

/// A square bar lying on one of its edges.
pub fn prism_edge() -> Solid {
    let c = 0.5f64.sqrt();
    let mut solid = Solid::fine().turned([[1.0, 0.0, 0.0], [0.0, c, -c], [0.0, c, c]]);
    block(&mut solid, [14.0, 6.0, 6.0]);
    solid
}

/// A cube of exactly 5 mm, sharp.
pub fn cube() -> Solid {
    let mut solid = Solid::new();
    block(&mut solid, [5.0; 3]);
    solid
}

/// A slab wider than any sensor: its contact face is z = 0.
pub fn slab() -> Solid {
    let mut solid = Solid::new();
    block(&mut solid, [50.0, 50.0, 8.0]);
    solid
}

/// The same with its edge on the x axis: it lies towards +y.
pub fn edge_slab() -> Solid {
    let mut solid = Solid::placed();
    let outline = [[0.0, -50.0], [60.0, -50.0], [60.0, 0.0], [0.0, 0.0]];
    solid.band(&at(&outline, 0.0), &at(&outline, 8.0));
    solid.cap_up(&outline, &[], 8.0);
    solid.cap_down(&outline, &[], 0.0);
    solid
}

/// A cone of 90 degrees whose tip is a ball of 0.25 mm radius.
pub fn cone() -> Solid {
    const TIP_MM: f64 = 0.25;
    let mut profile = vec![[0.0, 0.0], [5.0, 0.0]];
    let centre = 5.0 - TIP_MM * 2f64.sqrt();
    profile.extend([45.0, 62.0, 77.0, 90.0].map(|deg| {
        let [r, z] = polar(TIP_MM, deg);
        [r, centre + z]
    }));
    let mut solid = Solid::new();
    revolve(&mut solid, &profile, &round(ROUND));
    solid
}

/// A torus with a 3.2 mm tube on a 10 mm circle, finer on the side of the pad.
pub fn torus() -> Solid {
    const TUBE_MM: f64 = 1.6;
    let near = (0..=36).map(|i| 90.0 - 75.6 + 4.2 * i as f64);
    let far = (1..=9).map(|i| 90.0 + 75.6 + 208.8 / 9.0 * i as f64);
    let profile: Vec<P2> = near
        .chain(far)
        .map(|deg| {
            let [r, z] = polar(TUBE_MM, deg);
            [5.0 + r, z]
        })
        .collect();
    let mut solid = Solid::fine();
    revolve(&mut solid, &profile, &round(120));
    solid
}

/// A flat punch of 8 mm diameter with a sharp rim.
pub fn cylinder() -> Solid {
    let mut solid = Solid::new();
    let profile = [[0.0, 0.0], [4.0, 0.0], [4.0, 6.0], [0.0, 6.0]];
    revolve(&mut solid, &profile, &round(ROUND));
    solid
}

/// A tube of 8 mm outer diameter with a wall of 0.8 mm, standing on end.
pub fn cylinder_shell() -> Solid {
    let profile = [[3.2, 0.0], [4.0, 0.0], [4.0, 6.0], [3.2, 6.0], [3.2, 0.0]];
    let mut solid = Solid::new();
    revolve(&mut solid, &profile, &round(ROUND));
    solid
}

/// A plain washer for 5 mm screws, its outer edge bevelled on the side of the pad.
pub fn washer() -> Solid {
    let profile = [[2.65, 0.0], [5.0, 0.0], [5.0, 0.75], [4.75, 1.0], [2.65, 1.0], [2.65, 0.0]];
    let mut solid = Solid::new();
    revolve(&mut solid, &profile, &round(ROUND));
    solid
}

/// Steps (inset, rise) up a quarter circle of radius `r`, after its foot.
pub fn fillet(r: f64, steps: usize) -> impl Iterator<Item = P2> {
    (1..=steps).map(move |i| {
        let [x, z] = polar(r, 90.0 * i as f64 / steps as f64);
        [r - x, z]
    })
}

/// A disc of radius `r` at height `z`, seen from +z, over the directions `degrees`.
pub fn disc(solid: &mut Solid, r: f64, z: f64, degrees: &[f64]) {
    solid.fan(&ring(r, z, degrees), [0.0, 0.0, z]);
}

fn block(solid: &mut Solid, [w, d, h]: P3) {
    let outline = [[0.0, 0.0], [w, 0.0], [w, d], [0.0, d]];
    solid.band(&at(&outline, 0.0), &at(&outline, h));
    solid.cap_up(&outline, &[], h);
    solid.cap_down(&outline, &[], 0.0);
}
