//! The point of a triangle that is closest to a given point.

use glam::DVec3;

/// Returns the point of a triangle that is closest to `to`. Triangles without area are treated as their edges.
pub fn nearest_point_on_triangle(to: DVec3, a: DVec3, b: DVec3, c: DVec3) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let length = normal.length_squared();
    if length > 0.0 {
        let foot = to - normal * (normal.dot(to - a) / length);
        let inside = |p: DVec3, q: DVec3| normal.dot((q - p).cross(foot - p)) >= 0.0;
        if inside(a, b) && inside(b, c) && inside(c, a) {
            return foot;
        }
    }
    let of_edge = |p: DVec3, q: DVec3| {
        let along = q - p;
        let length = along.length_squared();
        let share = if length > 0.0 { ((to - p).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
        p + share * along
    };
    let edges = [of_edge(a, b), of_edge(b, c), of_edge(c, a)];
    edges.into_iter().min_by(|p, q| to.distance_squared(*p).total_cmp(&to.distance_squared(*q))).unwrap_or(a)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn corner() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-5.0..5.0).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn no_point_of_a_triangle_is_closer(
            [a, b, c, to] in prop::array::uniform4(corner()),
            [s, t] in prop::array::uniform2(0.0..1.0_f64),
        ) {
            let nearest = nearest_point_on_triangle(to, a, b, c);
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            let other = a + s * (b - a) + t * (c - a);
            prop_assert!(to.distance(nearest) <= to.distance(other) + 1e-9);
            // It is one of the triangle's.
            let area = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).length();
            let parts = area(a, b, nearest) + area(b, c, nearest) + area(c, a, nearest);
            prop_assert!((parts - area(a, b, c)).abs() < 1e-6 * (1.0 + parts), "{parts}");
        }
    }
}
