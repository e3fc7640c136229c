//! The outline of an object seen along the pad's normal, as a polygon around it.
//!
//! The sides are the object's reach in directions evenly spaced over the plane. Two outlines are apart if a line
//! perpendicular to one of these directions separates them (the separating-axis test of a discrete orientation
//! polytope, Klosowski et al. 1998). The test errs to one side only: objects whose outlines are apart do not overlap,
//! whatever their shapes and heights.

use once_cell::race::OnceBox;

use crate::base::angle::sin_cos_deg;
use crate::mesh::clusters::Clusters;
use crate::pose::Pose;

/// Sides of an outline. A disc's outline is larger than the disc by a factor of at most 1 / cos(180 degrees / `SIDES`),
/// 0.03 %.
pub const SIDES: usize = 128;

/// A polygon around an object in the plane that it is posed over.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// The largest `direction . point` of the object's points, mm, for each of the [`SIDES`] directions.
    reach_mm: [f64; SIDES],
}

/// Returns unit vectors at even angles from +x towards +y; opposite directions are half of [`SIDES`] apart.
fn side_directions() -> &'static [[f64; 2]; SIDES] {
    static TABLE: OnceBox<[[f64; 2]; SIDES]> = OnceBox::new();
    TABLE.get_or_init(|| {
        Box::new(std::array::from_fn(|side| {
            let (sin, cos) = sin_cos_deg(side as f64 * (360.0 / SIDES as f64));
            [cos, sin]
        }))
    })
}

impl Outline {
    /// Makes the outline of an object at a pose over a plane.
    pub fn of(object: &Clusters, pose: &Pose) -> Self {
        let back = pose.rotation.transpose();
        let centre = pose.rotation * glam::DVec3::from_array(object.centre_mm()) + pose.translation_mm;
        let reach_mm = side_directions().map(|[x, y]| {
            let direction = back * glam::DVec3::new(x, y, 0.0);
            centre.x * x + centre.y * y + object.extreme(direction.to_array())
        });
        Self { reach_mm }
    }

    /// Returns the outline shifted along x and y, mm.
    pub fn moved(&self, by_mm: [f64; 2]) -> Self {
        let mut moved = self.clone();
        for (reach_mm, [x, y]) in moved.reach_mm.iter_mut().zip(side_directions()) {
            *reach_mm += by_mm[0] * x + by_mm[1] * y;
        }
        moved
    }

    /// Returns the width of the gap to another outline, mm, in the direction in which it is widest; below 0 where no
    /// direction separates them.
    pub fn gap_mm(&self, other: &Self) -> f64 {
        let opposite = other.reach_mm.iter().cycle().skip(SIDES / 2);
        self.reach_mm.iter().zip(opposite).map(|(own, other)| -own - other).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns how far a point of the plane lies outside the side that it is farthest outside of, mm; 0 or below for a
    /// point inside.
    pub fn beyond_mm(&self, [px, py]: [f64; 2]) -> f64 {
        let beyond = self.reach_mm.iter().zip(side_directions()).map(|(reach_mm, [x, y])| px * x + py * y - reach_mm);
        beyond.fold(f64::NEG_INFINITY, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::pose::{Anchor, Angles, Side};

    /// A box of 2 x 4 x 6 mm, its centre far from its origin.
    fn brick() -> Clusters {
        let corner = |i: usize| [100.0 + (i & 1) as f64 * 2.0, (i >> 1 & 1) as f64 * 4.0, -7.0 + (i >> 2) as f64 * 6.0];
        let triangles = vec![[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 2, 4], [2, 6, 4], [1, 5, 3], [3, 5, 7]];
        Clusters::new(&Mesh::new((0..8).map(corner).collect(), triangles).expect("a box is a mesh").0)
    }

    fn at(yaw_deg: f64, place_mm: [f64; 2]) -> Outline {
        let angles = Angles { yaw_deg, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
        let brick = brick();
        Outline::of(&brick, &Pose::new(Side::MinusZ, angles, place_mm, Anchor::Bounds, -0.5, &brick))
    }

    #[test]
    fn upright_boxes_are_as_far_apart_as_their_sides() {
        let (left, right) = (at(0.0, [0.0, 0.0]), at(0.0, [2.5, 0.3]));
        assert!((left.gap_mm(&right) - 0.5).abs() < 1e-9, "{}", left.gap_mm(&right));
        assert!((right.gap_mm(&left) - 0.5).abs() < 1e-9);
        assert!((left.gap_mm(&at(0.0, [1.9, 3.9])) + 0.1).abs() < 1e-9, "the larger of two negative gaps");
        assert!((left.gap_mm(&at(90.0, [3.2, 0.0])) - 0.2).abs() < 1e-9);
    }

    #[test]
    fn a_moved_outline_is_that_of_the_moved_object() {
        let (moved, there) = (at(33.0, [1.0, 2.0]).moved([4.0, -7.0]), at(33.0, [5.0, -5.0]));
        for (a, b) in moved.reach_mm.iter().zip(&there.reach_mm) {
            assert!((a - b).abs() < 1e-9);
        }
    }

    #[test]
    fn points_of_an_object_lie_inside_and_others_beyond() {
        let outline = at(0.0, [1.0, 1.0]);
        assert!(outline.beyond_mm([1.9, 2.9]) <= 0.0);
        assert!((outline.beyond_mm([2.25, 1.0]) - 0.25).abs() < 1e-9);
        assert!((outline.beyond_mm([1.0, -1.5]) - 0.5).abs() < 1e-9);
    }
}
