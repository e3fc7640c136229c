//! Points of an object's surface, drawn evenly by area, and the rotations that turn them to the pad.

use glam::{DMat3, DVec3};

use super::clusters::Clusters;
use crate::base::rng::RandomStream;

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point, mm from the object's centre.
    pub point_mm: DVec3,
    /// The unit normal of its triangle. Of a mesh whose triangles all go round in the same way it points outwards.
    pub normal: DVec3,
}

/// The surface of an object, to draw points from.
pub struct Surface<'a> {
    object: &'a Clusters,
    /// Sum of the areas up to and with each triangle, mm^2.
    areas_mm2: Vec<f64>,
    /// Whether the triangles go round so that their normals point inwards.
    is_inside_out: bool,
}

impl<'a> Surface<'a> {
    /// Measures the surface of an object.
    pub fn of(object: &'a Clusters) -> Self {
        let (mut sum, mut volume) = (0.0, 0.0);
        let areas = object.triangles().map(|corners| {
            let across = across(corners);
            volume += corners[0].dot(across);
            sum += 0.5 * across.length();
            sum
        });
        let areas_mm2 = areas.collect();
        Self { object, areas_mm2, is_inside_out: volume < 0.0 }
    }

    /// Draws a point, each as likely as any other; `None` if there is no surface.
    pub fn draw(&self, stream: &mut RandomStream) -> Option<SurfacePoint> {
        let all = *self.areas_mm2.last()?;
        let at = stream.uniform() * all;
        let [mut u, mut v] = [stream.uniform(), stream.uniform()];
        let number = self.areas_mm2.partition_point(|sum| *sum <= at).min(self.areas_mm2.len() - 1);
        let [a, b, c] = self.object.triangle(number);
        // The half of a parallelogram beyond the triangle is turned onto it.
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let point_mm = a + (b - a) * u + (c - a) * v;
        let normal = across([a, b, c]).try_normalize()?;
        Some(SurfacePoint { point_mm, normal: if self.is_inside_out { -normal } else { normal } })
    }
}

impl SurfacePoint {
    /// Returns the shortest rotation after which the normal points into the pad, -z.
    pub fn facing(&self) -> DMat3 {
        let DVec3 { x, y, z } = self.normal;
        // Rodrigues' formula for the turn from the normal to -z, whose axis is (-y, x, 0) and whose cosine is -z. At
        // z = 1 any half turn will do.
        if 1.0 - z < 1e-12 {
            return DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        }
        let by = 1.0 / (1.0 - z);
        DMat3::from_cols(
            DVec3::new(1.0 - x * x * by, -x * y * by, -x),
            DVec3::new(-x * y * by, 1.0 - y * y * by, -y),
            DVec3::new(x, y, -z),
        )
    }
}

/// Returns the normal of a triangle, twice as long as its area.
fn across([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::random_stream;
    use crate::mesh::Mesh;

    /// A closed box of 2 x 4 x 6 mm, also with triangles that go round the wrong way.
    fn brick(is_inside_out: bool) -> Clusters {
        let corner = |i: usize| [(i & 1) as f64 * 2.0, (i >> 1 & 1) as f64 * 4.0, (i >> 2) as f64 * 6.0];
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        if is_inside_out {
            triangles.iter_mut().for_each(|triangle| triangle.reverse());
        }
        Clusters::new(&Mesh::new((0..8).map(corner).collect(), triangles).expect("a box").0)
    }

    #[test]
    fn points_lie_on_the_faces_as_often_as_their_areas_say() {
        let [object, inside_out] = [false, true].map(brick);
        let surfaces = [Surface::of(&object), Surface::of(&inside_out)];
        let half = DVec3::new(1.0, 2.0, 3.0);
        let (mut on, count) = ([[0_u32; 2]; 3], 8800);
        for (surface, index) in surfaces.iter().cycle().zip(0..count) {
            let drawn = surface.draw(&mut random_stream(5, "surface", index)).expect("a point");
            let axis = (0..3).find(|k| drawn.normal[*k].abs() > 0.99).expect("a face");
            on[axis][usize::from(drawn.normal[axis] > 0.0)] += 1;
            assert!((drawn.point_mm[axis] - half[axis] * drawn.normal[axis]).abs() < 1e-6, "{drawn:?}");
            assert!((0..3).all(|k| drawn.point_mm[k].abs() <= half[k] + 1e-6));
        }
        // Areas of 24, 12 and 8 of 88 mm^2.
        for (found, expected) in on.iter().flatten().zip([2400.0, 2400.0, 1200.0, 1200.0, 800.0, 800.0]) {
            assert!((f64::from(*found) - expected).abs() < 4.0 * f64::sqrt(expected), "{on:?}");
        }
    }

    #[test]
    fn the_normal_is_turned_into_the_pad() {
        for index in 0..200 {
            let mut stream = random_stream(1, "normal", index);
            let normal = match index {
                0 => DVec3::Z,
                1 => DVec3::NEG_Z,
                2 => DVec3::new(1e-9, 0.0, 1.0).normalize(),
                _ => DVec3::from_array([(); 3].map(|()| stream.standard_normal())).normalize(),
            };
            let turn = SurfacePoint { point_mm: DVec3::ZERO, normal }.facing();
            assert!((turn * normal - DVec3::NEG_Z).length() < 1e-8, "{normal}");
            assert!(
                (turn.determinant() - 1.0).abs() < 1e-8
                    && (turn * turn.transpose() - DMat3::IDENTITY).x_axis.length() < 1e-8
            );
        }
    }
}
