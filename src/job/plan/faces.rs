//! Which side of an object has the most relief: what `face = "auto"` presses.

use glam::DVec3;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::depth::{Window, capture};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, Pose, Side};

/// Points along an object's longest extent at which it is captured.
const POINTS: f64 = 192.0;

/// By what factor another side must have more relief than those before it: sides that are alike differ by rounding.
const RICHER: f64 = 1.05;

/// What counts as flat, mm.
const FLAT_MM: f32 = 1e-3;

/// The sides, the one that faces the pad by default first.
const ORDER: [Side; 6] = [Side::MinusZ, Side::PlusZ, Side::MinusX, Side::PlusX, Side::MinusY, Side::PlusY];

/// The side with the most relief within `reach_mm` of its highest point: the one over which the slope changes most, all in
/// all. Of sides that are alike the first of -z, +z, -x, +x, -y, +y.
pub fn richest(object: &Clusters, reach_mm: f64) -> Side {
    let relief = ORDER.map(|side| bend(side, object, reach_mm));
    let best = (1..ORDER.len()).fold(0, |best, at| if relief[at] > RICHER * relief[best] { at } else { best });
    ORDER[best]
}

/// The side with the most relief, where this one is flat and that is not.
pub fn relief_beside(side: Side, object: &Clusters, reach_mm: f64) -> Option<Side> {
    let flat = |side: Side| {
        let (seen, _) = seen(side, object, reach_mm);
        let highest = seen.largest(|mm| mm);
        seen.data.iter().all(|mm| *mm <= 0.0 || *mm > highest - FLAT_MM)
    };
    flat(side).then(|| richest(object, reach_mm)).filter(|richest| !flat(*richest))
}

/// The change of the slope from point to point, each at most 1, summed over all points of a side within reach.
fn bend(side: Side, object: &Clusters, reach_mm: f64) -> f64 {
    let (penetration, pitch) = seen(side, object, reach_mm);
    let per_mm = 1.0 / pitch as f32;
    let mut sum = 0.0;
    for y in 1..penetration.height - 1 {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| penetration.row(y));
        for x in 1..penetration.width - 1 {
            if row[x] > 0.0 {
                let bends = [row[x - 1] + row[x + 1] - 2.0 * row[x], above[x] + below[x] - 2.0 * row[x]];
                sum += bends.map(|bend| f64::from((bend.abs() * per_mm).min(1.0))).iter().sum::<f64>();
            }
        }
    }
    sum
}

/// A side down to `reach_mm` under its highest point: from there up, mm, and 0 around it; and the distance between points.
fn seen(side: Side, object: &Clusters, reach_mm: f64) -> (Grid<f32>, f64) {
    let level = Angles { yaw_deg: 0.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
    let pose = Pose::new(side, level, [0.0; 2], Anchor::Bounds, -reach_mm, object);
    let turned = pose.rotation.transpose();
    let size = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
        let along = turned * axis;
        object.extreme(along.to_array()) + object.extreme((-along).to_array())
    });
    let pitch = size.into_iter().fold(0.0, f64::max) / POINTS;
    // Two more points on each side, so that the outline counts.
    let resolution_px = [0, 1].map(|k| (size[k] / pitch) as usize + 5);
    let view = View { resolution_px, mm_per_px: [pitch; 2] };
    let window = Window { margin_px: 0, above_mm: 0.0 };
    (capture(object, &pose.placement(), &view, window, reach_mm).penetration, pitch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::mesh::Mesh;

    /// A box with a ridge on one side, turned so that the axes go into one another `turns` times.
    fn ridged(turns: usize, up: f64) -> Clusters {
        let block = |low: [f64; 3], high: [f64; 3], first: u32| {
            let corner =
                move |k: usize| std::array::from_fn(|axis| if k >> axis & 1 == 1 { high[axis] } else { low[axis] });
            let quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
            let triangles = quads.map(|q: [u32; 4]| q.map(|corner| corner + first));
            let triangles: Vec<[u32; 3]> =
                triangles.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
            ((0..8).map(corner).collect::<Vec<[f64; 3]>>(), triangles)
        };
        let (mut vertices, mut triangles) = block([-5.0, -5.0, -2.0], [5.0, 5.0, 2.0], 0);
        for at in [-3.0, 0.0, 3.0] {
            let (more, own) = block([at - 0.4, -4.0, 2.0], [at + 0.4, 4.0, 2.5], vertices.len() as u32);
            vertices.extend(more);
            triangles.extend(own);
        }
        let turned = vertices.into_iter().map(|[x, y, z]| {
            let mut place = [x, y, up * z];
            place.rotate_right(turns);
            place
        });
        Clusters::new(&Mesh::new(turned.collect(), triangles).expect("a mesh").0)
    }

    #[test]
    fn the_side_with_ridges_is_found_wherever_it_is() {
        let expected = [
            (0, 1.0, Side::PlusZ),
            (0, -1.0, Side::MinusZ),
            (1, 1.0, Side::PlusX),
            (1, -1.0, Side::MinusX),
            (2, 1.0, Side::PlusY),
            (2, -1.0, Side::MinusY),
        ];
        for (turns, up, side) in expected {
            let object = ridged(turns, up);
            assert_eq!(richest(&object, 1.0), side);
            assert_eq!(relief_beside(side, &object, 1.0), None, "it is not flat");
        }
        assert_eq!(relief_beside(Side::MinusZ, &ridged(0, 1.0), 1.0), Some(Side::PlusZ));
    }
}
