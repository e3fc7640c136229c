//! Finds the side of an object with the most relief, which `face = "auto"` presses.

use glam::DVec3;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::depth::{CaptureWindow, capture_mesh};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, Pose, Side};

/// Number of points along an object's longest extent at which it is captured.
const POINTS: f64 = 192.0;

/// Factor by which another side must have more relief to be preferred, since equal sides differ by rounding.
const MIN_RELIEF_RATIO: f64 = 1.05;

/// Height below which a relief counts as flat, mm.
const FLAT_MM: f32 = 1e-3;

/// The sides, with the one that faces the pad by default first.
const ORDER: [Side; 6] = [Side::MinusZ, Side::PlusZ, Side::MinusX, Side::PlusX, Side::MinusY, Side::PlusY];

/// Returns the side with the most relief within `reach_mm` of its highest point: the one over which the slope changes
/// most in total. Of equal sides it is the first of -z, +z, -x, +x, -y, +y.
pub fn find_richest_side(object: &Clusters, reach_mm: f64) -> Side {
    let relief = ORDER.map(|side| measure_relief(side, object, reach_mm));
    let best =
        (1..ORDER.len()).fold(0, |best, at| if relief[at] > MIN_RELIEF_RATIO * relief[best] { at } else { best });
    ORDER[best]
}

/// Returns the side with the most relief if `side` is flat and that one is not.
pub fn find_richer_side(side: Side, object: &Clusters, reach_mm: f64) -> Option<Side> {
    let flat = |side: Side| {
        let (seen, _) = capture_relief(side, object, reach_mm);
        let highest = seen.largest(|mm| mm);
        seen.data.iter().all(|mm| *mm <= 0.0 || *mm > highest - FLAT_MM)
    };
    // Of most objects every side is flat, or this one is not.
    let is_meant = || !flat(side) || ORDER.into_iter().all(|other| other == side || flat(other));
    (!is_meant()).then(|| find_richest_side(object, reach_mm)).filter(|richest| !flat(*richest))
}

/// Sums, over all points of a side within reach, the change of the slope from point to point, each at most 1.
fn measure_relief(side: Side, object: &Clusters, reach_mm: f64) -> f64 {
    let (penetration, step_mm) = capture_relief(side, object, reach_mm);
    let per_mm = 1.0 / step_mm as f32;
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

/// Captures a side down to `reach_mm` under its highest point. Returns the heights over that level, mm, with 0 around
/// the object, and the distance between points, mm.
fn capture_relief(side: Side, object: &Clusters, reach_mm: f64) -> (Grid<f32>, f64) {
    let level = Angles { yaw_deg: 0.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
    let pose = Pose::new(side, level, [0.0; 2], Anchor::Bounds, -reach_mm, object);
    let turned = pose.rotation.transpose();
    let size = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
        let along = turned * axis;
        object.extreme(along.to_array()) + object.extreme((-along).to_array())
    });
    let step_mm = size.into_iter().fold(0.0, f64::max) / POINTS;
    // Two more points on each side, so that the object's outline counts.
    let resolution_px = [0, 1].map(|k| (size[k] / step_mm) as usize + 5);
    let view = View { resolution_px, mm_per_px: [step_mm; 2] };
    let window = CaptureWindow { margin_px: 0, above_mm: 0.0 };
    (capture_mesh(object, &pose.placement(), &view, window, reach_mm).penetration, step_mm)
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
            assert_eq!(find_richest_side(&object, 1.0), side);
            assert_eq!(find_richer_side(side, &object, 1.0), None, "it is not flat");
        }
        assert_eq!(find_richer_side(Side::MinusZ, &ridged(0, 1.0), 1.0), Some(Side::PlusZ));
    }
}
