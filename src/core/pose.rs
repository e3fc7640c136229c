//! The pose of the object: rotation = tilt * yaw * face, and a translation that puts its anchor at (x, y) and its
//! lowest point at a given height.

use crate::base::angle::sin_cos_deg;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::mesh::clusters::Clusters;
use crate::mesh::nearest::first_hit_along;

/// The side of an object that faces the pad, in the object's own axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The side towards +x.
    PlusX,
    /// The side towards -x.
    MinusX,
    /// The side towards +y.
    PlusY,
    /// The side towards -y.
    MinusY,
    /// The side towards +z.
    PlusZ,
    /// The side towards -z: the object's axes stay parallel to the sensor's.
    #[default]
    MinusZ,
}

impl Side {
    /// All six.
    pub const ALL: [Self; 6] = [Self::PlusX, Self::MinusX, Self::PlusY, Self::MinusY, Self::PlusZ, Self::MinusZ];

    /// Returns the rotation that turns this side towards the pad.
    pub fn rotation(self) -> DMat3 {
        match self {
            Self::MinusZ => DMat3::IDENTITY,
            Self::PlusZ => rotation_about(DVec3::X, 180.0),
            Self::PlusX => rotation_about(DVec3::Y, 90.0),
            Self::MinusX => rotation_about(DVec3::Y, -90.0),
            Self::PlusY => rotation_about(DVec3::X, -90.0),
            Self::MinusY => rotation_about(DVec3::X, 90.0),
        }
    }
}

/// Point of an object that a position refers to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Anchor {
    /// Centre of the turned object's bounding box.
    #[default]
    Bounds,
    /// Origin of the mesh file.
    Origin,
    /// The turned object's lowest point, the first to touch.
    Contact,
}

/// The placement of an object as plain arrays: `sensor = rotation * object + translation`, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rows of the rotation matrix.
    pub rotation: [[f64; 3]; 3],
    /// Translation in the sensor's frame, mm.
    pub translation_mm: [f64; 3],
}

/// The angles of a pose, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// Turn about z, from x towards y.
    pub yaw_deg: f64,
    /// A turn about an axis in the pad's plane, after the yaw.
    pub tilt_deg: f64,
    /// Direction of the tilt's axis, from x towards y.
    pub tilt_azimuth_deg: f64,
}

/// The plane that an object is posed over: the flat pad, or a plane that touches a curved gel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PadPlane {
    /// From the plane's axes to the sensor's; z points out of the gel.
    pub axes: DMat3,
    /// The point where the plane touches the gel, in the sensor's frame, mm.
    pub origin_mm: DVec3,
}

impl Default for PadPlane {
    fn default() -> Self {
        Self { axes: DMat3::IDENTITY, origin_mm: DVec3::ZERO }
    }
}

impl PadPlane {
    /// Converts a point of the sensor's frame to the plane's frame.
    pub(crate) fn point_in_plane(&self, point_mm: DVec3) -> DVec3 {
        self.axes.transpose() * (point_mm - self.origin_mm)
    }

    /// Returns the plane that touches a gel at a point, mm, where the gel has this normal. Its axes are the sensor's,
    /// turned the shortest way.
    pub fn tangent_at(point_mm: DVec3, normal: DVec3) -> Self {
        let axes = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, normal.normalize()));
        Self { axes, origin_mm: point_mm }
    }

    /// Converts a pose over this plane to the sensor's frame.
    pub fn pose_in_sensor(&self, over: Pose) -> Pose {
        // The flat pad's plane returns the pose as it is, so that no bit changes.
        if *self == Self::default() { over } else { over.within(self.axes, self.origin_mm) }
    }
}

/// The pose of an object in the sensor's frame: p = rotation * q + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// From the object's axes to the sensor's.
    pub rotation: DMat3,
    /// Translation, mm.
    pub translation_mm: DVec3,
    /// The angles that the rotation was made from.
    pub angles: Angles,
}

impl Pose {
    /// The pose in which the object's axes are the sensor's.
    pub const IDENTITY: Self = Self {
        rotation: DMat3::IDENTITY,
        translation_mm: DVec3::ZERO,
        angles: Angles { yaw_deg: 0.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 },
    };

    /// Makes a pose from a rotation, as a quaternion x, y, z, w of any length but 0, and a translation, mm. The angles
    /// are those of an object whose side -z faces the pad, with a tilt from 0 to 180 degrees.
    pub fn from_quaternion(quaternion_xyzw: [f64; 4], translation_mm: [f64; 3]) -> Self {
        let rotation = DQuat::from_array(quaternion_xyzw).normalize();
        let turn = |about_z: f64, rest: f64| 2.0 * libm::atan2(about_z, rest).to_degrees();
        // R = tilt * yaw: the yaw is about z, the tilt about an axis across it. With half a turn of tilt the yaw is
        // arbitrary.
        let upside_down = rotation.z == 0.0 && rotation.w == 0.0;
        let yaw_deg = if upside_down { 0.0 } else { turn(rotation.z, rotation.w) };
        let tilt = rotation * DQuat::from_rotation_z(-yaw_deg.to_radians());
        let tilt = if tilt.w < 0.0 { -tilt } else { tilt };
        let across = libm::hypot(tilt.x, tilt.y);
        let tilt_azimuth_deg = if across > 0.0 { libm::atan2(tilt.y, tilt.x).to_degrees() } else { 0.0 };
        let angles = Angles { yaw_deg, tilt_deg: turn(across, tilt.w), tilt_azimuth_deg };
        Self { rotation: DMat3::from_quat(rotation), translation_mm: DVec3::from_array(translation_mm), angles }
    }

    /// Turns an object, and places its anchor at `position_mm` and its lowest point at z = `lowest_mm` (negative:
    /// inside the pad).
    pub fn new(
        side: Side,
        angles: Angles,
        position_mm: [f64; 2],
        anchor: Anchor,
        lowest_mm: f64,
        object: &Clusters,
    ) -> Self {
        Self::turned(side, angles).moved(position_mm, anchor, lowest_mm, object)
    }

    /// Turns an object; its origin stays at the frame's origin.
    pub fn turned(side: Side, angles: Angles) -> Self {
        Self::turned_from(side.rotation(), angles)
    }

    /// Turns an object of which `facing` has turned a part towards the pad; its origin stays at the frame's origin.
    pub fn turned_from(facing: DMat3, angles: Angles) -> Self {
        Self { rotation: object_rotation(facing, angles), angles, ..Self::IDENTITY }
    }

    /// Moves the turned object so that its anchor is at `position_mm` and its lowest point at z = `lowest_mm`; see
    /// [`Pose::new`].
    pub fn moved(self, position_mm: [f64; 2], anchor: Anchor, lowest_mm: f64, object: &Clusters) -> Self {
        let rotation = self.rotation;
        let centre = rotation * DVec3::from_array(object.centre_mm());
        // Largest coordinate of the turned object along a sensor axis, relative to its turned centre.
        let reach = |axis: DVec3| object.extreme((rotation.transpose() * axis).to_array());
        let towards_pad = (rotation.transpose() * DVec3::NEG_Z).to_array();
        let lowest = object.extreme(towards_pad);
        let anchor_at = match anchor {
            Anchor::Origin => DVec3::ZERO,
            Anchor::Bounds => {
                let middle = |axis: DVec3| (reach(axis) - reach(-axis)) / 2.0;
                centre + DVec3::new(middle(DVec3::X), middle(DVec3::Y), 0.0)
            }
            Anchor::Contact => {
                // All vertices within a micrometre of the lowest count, so that a flat face touches with its centre.
                let touching = object.extreme_point(towards_pad, lowest, 1e-3);
                centre + rotation * DVec3::from_array(touching)
            }
        };
        let translation_mm =
            DVec3::new(position_mm[0] - anchor_at.x, position_mm[1] - anchor_at.y, lowest_mm + lowest - centre.z);
        Self { translation_mm, ..self }
    }

    /// Moves the turned object so that a point of it, mm from its centre, is at `position_mm` and its lowest point at
    /// z = `lowest_mm`.
    pub fn moved_to_point(self, point_mm: DVec3, position_mm: [f64; 2], lowest_mm: f64, object: &Clusters) -> Self {
        let placed = self.moved([0.0; 2], Anchor::Origin, lowest_mm, object);
        let at = self.rotation * (DVec3::from_array(object.centre_mm()) + point_mm);
        let translation_mm = DVec3::new(position_mm[0] - at.x, position_mm[1] - at.y, placed.translation_mm.z);
        Self { translation_mm, ..self }
    }

    /// Turns an object of which `facing` has turned a part towards the pad by its yaw, then about the sensor's x, then
    /// about its y, degrees; its origin stays at the frame's origin.
    pub fn rolled(facing: DMat3, yaw_deg: f64, roll_deg: f64, pitch_deg: f64) -> Self {
        let turn = rotation_about(DVec3::Y, pitch_deg)
            * rotation_about(DVec3::X, roll_deg)
            * rotation_about(DVec3::Z, yaw_deg);
        let quaternion = DQuat::from_mat3(&turn).normalize();
        let Self { angles, .. } = Self::from_quaternion(quaternion.to_array(), [0.0; 3]);
        Self { rotation: turn * facing, angles, ..Self::IDENTITY }
    }

    /// Returns the height of the object's underside on the sensor's axis over the undeformed pad, mm; `None` if the
    /// object does not meet the axis.
    pub(crate) fn on_axis_mm(&self, object: &Clusters) -> Option<f64> {
        let back = self.rotation.transpose();
        first_hit_along(object, back * -self.translation_mm, back * DVec3::Z)
    }

    /// Moves the object along z until its underside on the sensor's axis is at z = `axis_mm`; `None` if the object does
    /// not meet the axis.
    pub fn with_axis_at(self, axis_mm: f64, object: &Clusters) -> Option<Self> {
        let by = axis_mm - self.on_axis_mm(object)?;
        Some(Self { translation_mm: self.translation_mm + DVec3::new(0.0, 0.0, by), ..self })
    }

    /// Moves the object along z until its lowest point is at z = `lowest_mm`.
    pub fn lowered(self, lowest_mm: f64, object: &Clusters) -> Self {
        let centre = self.rotation * DVec3::from_array(object.centre_mm());
        let lowest = object.extreme((self.rotation.transpose() * DVec3::NEG_Z).to_array());
        let DVec3 { x, y, .. } = self.translation_mm;
        Self { translation_mm: DVec3::new(x, y, lowest_mm + lowest - centre.z), ..self }
    }

    /// Returns the height of the object's lowest point over the undeformed pad, mm.
    pub fn lowest_mm(&self, object: &Clusters) -> f64 {
        let centre = self.rotation * DVec3::from_array(object.centre_mm()) + self.translation_mm;
        centre.z - object.extreme((self.rotation.transpose() * DVec3::NEG_Z).to_array())
    }

    /// Converts a pose in a frame to the sensor's frame, given the frame's axes and origin there. The angles are kept
    /// as they are in that frame.
    pub fn within(self, rotation: DMat3, origin_mm: DVec3) -> Self {
        let translation_mm = rotation * self.translation_mm + origin_mm;
        Self { rotation: rotation * self.rotation, translation_mm, ..self }
    }

    /// Returns the pose as the opposite pad sees it: in a frame turned by half a turn about y, with the same origin.
    /// The angles then refer to the object turned likewise: R = tilt * yaw * (half a turn * face).
    pub fn seen_by_opposite_pad(self) -> Self {
        let Angles { yaw_deg, tilt_deg, tilt_azimuth_deg } = self.angles;
        let angles = Angles { yaw_deg: 0.0 - yaw_deg, tilt_deg, tilt_azimuth_deg: 180.0 - tilt_azimuth_deg };
        Self { angles, ..self.within(half_turn(), DVec3::ZERO) }
    }

    /// Returns the rotation as a unit quaternion x, y, z, w with w >= 0.
    pub fn quaternion_xyzw(&self) -> [f64; 4] {
        let q = DQuat::from_mat3(&self.rotation).normalize();
        let q = if q.w < 0.0 { -q } else { q };
        // Adding 0 turns -0.0 into 0.0.
        [q.x, q.y, q.z, q.w].map(|v| v + 0.0)
    }

    /// Returns the pose as plain arrays.
    pub fn placement(&self) -> Placement {
        let rows = self.rotation.transpose();
        Placement {
            rotation: [rows.x_axis.to_array(), rows.y_axis.to_array(), rows.z_axis.to_array()],
            translation_mm: self.translation_mm.to_array(),
        }
    }
}

/// Returns half a turn about y, exactly.
fn half_turn() -> DMat3 {
    DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0))
}

/// Returns the rotation from the object's axes to the sensor's.
fn object_rotation(facing: DMat3, angles: Angles) -> DMat3 {
    let (sin, cos) = sin_cos_deg(angles.tilt_azimuth_deg);
    let tilt_axis = DVec3::new(cos, sin, 0.0);
    rotation_about(tilt_axis, angles.tilt_deg) * rotation_about(DVec3::Z, angles.yaw_deg) * facing
}

/// Returns the right-handed rotation by `angle_deg` about a unit `axis` (Rodrigues).
pub fn rotation_about(axis: DVec3, angle_deg: f64) -> DMat3 {
    let (sin, cos) = sin_cos_deg(angle_deg);
    let cross = DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    );
    let outer = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
    DMat3::IDENTITY * cos + cross * sin + outer * (1.0 - cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cleaning::Mesh;

    /// A box from (0, 0, 0) to (2, 4, 6) mm.
    fn brick() -> Clusters {
        let corner = |i: usize| [(i & 1) as f64 * 2.0, (i >> 1 & 1) as f64 * 4.0, (i >> 2) as f64 * 6.0];
        let vertices = (0..8).map(corner).collect();
        let triangles = vec![[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 2, 4], [2, 6, 4], [1, 5, 3], [3, 5, 7]];
        Clusters::new(&Mesh::new(vertices, triangles).expect("a box is a mesh").0)
    }

    const LEVEL: Angles = Angles { yaw_deg: 0.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };

    #[test]
    fn each_face_turns_its_own_side_towards_the_pad() {
        for (face, side) in [
            (Side::PlusX, DVec3::X),
            (Side::MinusX, DVec3::NEG_X),
            (Side::PlusY, DVec3::Y),
            (Side::MinusY, DVec3::NEG_Y),
            (Side::PlusZ, DVec3::Z),
            (Side::MinusZ, DVec3::NEG_Z),
        ] {
            let turned = object_rotation(face.rotation(), LEVEL) * side;
            assert_eq!(turned, DVec3::NEG_Z, "{face:?} must face the camera exactly");
        }
    }

    #[test]
    fn the_lowest_point_is_at_the_indentation_depth_in_every_pose() {
        let brick = brick();
        let corners = (0..8).map(|i| [(i & 1) as f64 * 2.0, (i >> 1 & 1) as f64 * 4.0, (i >> 2) as f64 * 6.0]);
        let corners: Vec<[f64; 3]> = corners.collect();
        for face in [Side::PlusX, Side::MinusY, Side::MinusZ] {
            for (yaw_deg, tilt_deg) in [(0.0, 0.0), (33.0, 12.0), (250.0, -80.0), (90.0, 90.0)] {
                let angles = Angles { yaw_deg, tilt_deg, tilt_azimuth_deg: 57.0 };
                let pose = Pose::new(face, angles, [1.0, -2.0], Anchor::Bounds, -0.8, &brick);
                let placed = corners.iter().map(|&q| pose.rotation * DVec3::from_array(q) + pose.translation_mm);
                let placed: Vec<DVec3> = placed.collect();
                let lowest = placed.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
                assert!((lowest + 0.8).abs() < 1e-6, "{lowest}");
                for (k, at) in [(0, 1.0), (1, -2.0)] {
                    let min = placed.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
                    let max = placed.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
                    assert!(((min + max) / 2.0 - at).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn the_contact_anchor_is_the_lowest_corner_and_the_origin_anchor_the_origin() {
        let tilted = Angles { yaw_deg: 20.0, tilt_deg: 30.0, tilt_azimuth_deg: 10.0 };
        let pose = Pose::new(Side::MinusZ, tilted, [3.0, 4.0], Anchor::Contact, -0.5, &brick());
        let touches = (0..8).map(|i: usize| {
            let q = DVec3::new((i & 1) as f64 * 2.0, (i >> 1 & 1) as f64 * 4.0, (i >> 2) as f64 * 6.0);
            pose.rotation * q + pose.translation_mm
        });
        let lowest = touches.min_by(|a, b| a.z.total_cmp(&b.z)).expect("eight corners");
        assert!((lowest - DVec3::new(3.0, 4.0, -0.5)).length() < 1e-6, "{lowest}");

        let pose = Pose::new(Side::MinusZ, LEVEL, [3.0, 4.0], Anchor::Origin, -0.5, &brick());
        assert_eq!(pose.translation_mm, DVec3::new(3.0, 4.0, -0.5));
    }

    #[test]
    fn a_pad_that_faces_another_sees_the_other_side_with_y_kept_and_the_angles_that_make_it() {
        let angles = Angles { yaw_deg: 33.0, tilt_deg: 12.0, tilt_azimuth_deg: 57.0 };
        let pose = Pose::new(Side::PlusX, angles, [1.0, -2.0], Anchor::Bounds, -0.8, &brick());
        let faced = pose.seen_by_opposite_pad();
        let q = DVec3::new(0.3, 1.7, -4.0);
        let (here, there) = (pose.rotation * q + pose.translation_mm, faced.rotation * q + faced.translation_mm);
        assert_eq!(there, DVec3::new(-here.x, here.y, -here.z));
        let made = Pose { rotation: object_rotation(DMat3::IDENTITY, faced.angles), ..Pose::IDENTITY };
        let by_angles = made.rotation * half_turn() * Side::PlusX.rotation();
        assert!(by_angles.abs_diff_eq(faced.rotation, 1e-14), "{by_angles} {}", faced.rotation);
        assert_eq!(faced.seen_by_opposite_pad().rotation, pose.rotation);
    }

    #[test]
    fn a_placed_pose_has_the_angles_that_make_it() {
        let cases =
            [(0.0, 0.0, 0.0), (30.0, 20.0, 70.0), (-140.0, 90.0, -160.0), (179.0, 1e-6, 10.0), (0.0, 180.0, 45.0)];
        for (yaw_deg, tilt_deg, tilt_azimuth_deg) in cases {
            let angles = Angles { yaw_deg, tilt_deg, tilt_azimuth_deg };
            let made = Pose { rotation: object_rotation(DMat3::IDENTITY, angles), ..Pose::IDENTITY };
            let placed = Pose::from_quaternion(made.quaternion_xyzw(), [1.0, 2.0, 3.0]);
            assert_eq!(placed.translation_mm, DVec3::new(1.0, 2.0, 3.0));
            assert!(placed.rotation.abs_diff_eq(made.rotation, 1e-12));
            assert!(
                object_rotation(DMat3::IDENTITY, placed.angles).abs_diff_eq(made.rotation, 1e-12),
                "{:?}",
                placed.angles
            );
            if tilt_deg > 0.0 && tilt_deg < 180.0 {
                let found = [placed.angles.yaw_deg, placed.angles.tilt_deg, placed.angles.tilt_azimuth_deg];
                for (found, made) in found.into_iter().zip([yaw_deg, tilt_deg, tilt_azimuth_deg]) {
                    assert!((found - made).abs() < 1e-6, "{:?}", placed.angles);
                }
            }
        }
    }
}
