//! Resamples the depth image of a perspective camera to parallel rays: neighbouring pixels are joined to a surface, and
//! the surface is rasterised in the sensor's view. At the centre of every pixel the point nearest to the camera's plane
//! counts.
//!
//! Where distances jump, neighbours are not joined: what lies between them was hidden.

use super::heights::FrameHeights;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;

/// Neighbours belong to two surfaces if their distances differ by more than this times their distance across the rays.
/// A steeper surface (83 degrees) would not show itself to parallel rays either.
const MAX_SURFACE_SLOPE: f64 = 8.0;

/// The relation between pixels and directions.
#[derive(Clone, Copy, Debug)]
pub struct PinholeGeometry {
    /// Distance of the image plane from the pinhole, px.
    focal_px: f64,
    /// The image's middle, px. The centre of the first pixel is at (0.5, 0.5).
    middle_px: [f64; 2],
}

impl PinholeGeometry {
    /// Makes the geometry of an image whose upper and lower edges are `fov_y_deg` apart. What belongs to a pixel is
    /// found `offset_px` from it.
    pub fn new(image: &Grid<f64>, fov_y_deg: f64, offset_px: [f64; 2]) -> Self {
        let (sin, cos) = sin_cos_deg(fov_y_deg / 2.0);
        let half = |size: usize, by: f64| size as f64 / 2.0 + by;
        Self {
            focal_px: image.height as f64 / 2.0 * cos / sin,
            middle_px: [half(image.width, offset_px[0]), half(image.height, offset_px[1])],
        }
    }

    /// Converts distances along each pixel's ray to distances along the optical axis.
    pub fn convert_to_axis_distances(&self, distances: &mut Grid<f64>) {
        let width = distances.width;
        for (at, mm) in distances.data.iter_mut().enumerate() {
            let [x, y, z] = self.point_mm(at % width, at / width, 1.0);
            *mm /= (x * x + y * y + z * z).sqrt();
        }
    }

    /// Returns the point that is seen in a pixel, mm.
    fn point_mm(&self, column: usize, row: usize, distance_mm: f64) -> [f64; 3] {
        let across = |at: usize, middle: f64| (at as f64 + 0.5 - middle) * distance_mm / self.focal_px;
        [across(column, self.middle_px[0]), across(row, self.middle_px[1]), distance_mm]
    }

    /// Returns the pixel in which the point at (x, y) mm and a distance is seen, or `None` if it is out of the image.
    fn pixel_at_point(&self, [x, y]: [f64; 2], distance_mm: f64, image: &Grid<f64>) -> Option<[usize; 2]> {
        let at = |mm: f64, middle: f64, size: usize| {
            let px = mm * self.focal_px / distance_mm + middle;
            (0.0..size as f64).contains(&px).then_some(px as usize)
        };
        Some([at(x, self.middle_px[0], image.width)?, at(y, self.middle_px[1], image.height)?])
    }
}

/// Computes heights over a pad `plane_mm` from the camera. A pixel of the view is unseen if no surface was found there,
/// and if what would touch the pad there is out of the image or behind something nearer.
pub fn reproject_orthographic(
    distances_mm: &Grid<f64>,
    pinhole: &PinholeGeometry,
    plane_mm: f64,
    view: &View,
) -> FrameHeights {
    let [width, height] = view.resolution_px;
    let mut nearest = Grid { width, height, data: vec![f64::INFINITY; width * height] };
    let corner = |column: usize, row: usize| {
        let [x, y, z] = pinhole.point_mm(column, row, distances_mm.at(column, row));
        let [x, y] = view.point_px([x, y]);
        // Nothing is seen behind the camera.
        (z.is_finite() && z > 0.0).then_some([x, y, z])
    };
    // Each row of corners is needed twice: keep it for the next row.
    let corners_of = |row: usize| (0..distances_mm.width).map(|column| corner(column, row)).collect::<Vec<_>>();
    let mut upper = corners_of(0);
    for row in 1..distances_mm.height {
        let lower = corners_of(row);
        for (above, below) in upper.windows(2).zip(lower.windows(2)) {
            let [a, b, c, d] = [above[0], above[1], below[0], below[1]];
            for triangle in [[a, b, c], [b, d, c]] {
                if let [Some(a), Some(b), Some(c)] = triangle
                    && is_one_surface([a, b, c], pinhole.focal_px)
                {
                    rasterise_triangle([a, b, c], &mut nearest);
                }
            }
        }
        upper = lower;
    }

    let mut unseen_px = 0;
    for y in 0..height {
        for x in 0..width {
            if nearest.at(x, y) == f64::INFINITY {
                let at_mm = view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                let is_clear = pinhole
                    .pixel_at_point(at_mm, plane_mm, distances_mm)
                    .is_some_and(|[column, row]| distances_mm.at(column, row) >= plane_mm);
                unseen_px += u64::from(!is_clear);
            }
        }
    }
    let data = nearest.data.into_iter().map(|mm| (mm - plane_mm) as f32).collect();
    FrameHeights { above_mm: Grid { width, height, data }, unseen_px }
}

/// Returns true if no two corners are farther apart along the rays than a steep surface allows.
fn is_one_surface([a, b, c]: [[f64; 3]; 3], focal_px: f64) -> bool {
    let nearest = a[2].min(b[2]).min(c[2]);
    let farthest = a[2].max(b[2]).max(c[2]);
    farthest - nearest <= MAX_SURFACE_SLOPE * nearest / focal_px
}

/// Lowers `nearest` to a triangle (px, px, mm) at the pixel centres inside it, with its edges.
fn rasterise_triangle([a, b, c]: [[f64; 3]; 3], nearest: &mut Grid<f64>) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area == 0.0 {
        return;
    }
    // Only pixels whose centres lie in the box around the triangle.
    let span = |k: usize, size: usize| {
        let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
        ((low - 0.5).ceil().max(0.0) as usize, ((high - 0.5).floor() + 1.0).clamp(0.0, size as f64) as usize)
    };
    let ((x0, x1), (y0, y1)) = (span(0, nearest.width), span(1, nearest.height));
    for y in y0..y1 {
        for x in x0..x1 {
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            let share = |p: [f64; 3], q: [f64; 3]| ((q[0] - p[0]) * (py - p[1]) - (q[1] - p[1]) * (px - p[0])) / area;
            let (of_a, of_b, of_c) = (share(b, c), share(c, a), share(a, b));
            // The tolerance keeps rounding from leaving a gap between neighbouring triangles.
            if of_a.min(of_b).min(of_c) >= -1e-9 {
                let mm = of_a * a[2] + of_b * b[2] + of_c * c[2];
                let value = &mut nearest.row_mut(y)[x];
                *value = value.min(mm);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLANE_MM: f64 = 25.0;
    const VIEW: View = View { resolution_px: [160, 120], mm_per_px: [0.1, 0.1] };

    /// What a perspective camera sees of `surface`, which gives the distance along a ray (x, y, 1).
    fn seen(fov_y_deg: f64, size: [usize; 2], surface: impl Fn([f64; 2]) -> f64) -> FrameHeights {
        let mut image = Grid::new(size[0], size[1]);
        let pinhole = PinholeGeometry::new(&image, fov_y_deg, [0.0; 2]);
        for row in 0..size[1] {
            for column in 0..size[0] {
                let [x, y, _] = pinhole.point_mm(column, row, 1.0);
                image.row_mut(row)[column] = surface([x, y]);
            }
        }
        reproject_orthographic(&image, &pinhole, PLANE_MM, &VIEW)
    }

    /// Distance at which a ray meets a ball, or infinity.
    fn ball(centre: [f64; 3], radius: f64, [x, y]: [f64; 2]) -> f64 {
        let square = x * x + y * y + 1.0;
        let along = (x * centre[0] + y * centre[1] + centre[2]) / square;
        let rest = centre.iter().map(|c| c * c).sum::<f64>() - radius * radius;
        let root = along * along - rest / square;
        if root < 0.0 { f64::INFINITY } else { along - root.sqrt() }
    }

    fn at(x: usize, y: usize) -> [f64; 2] {
        VIEW.point_mm([x as f64 + 0.5, y as f64 + 0.5])
    }

    #[test]
    fn a_tilted_plane_comes_back_exactly_and_all_of_it_is_seen() {
        // z = 25 + 0.2 x - 0.1 y along the ray (x z, y z, z).
        let heights = seen(40.0, [400, 300], |[x, y]| 25.0 / (1.0 - 0.2 * x + 0.1 * y));
        assert_eq!(heights.unseen_px, 0);
        for y in 0..120 {
            for x in 0..160 {
                let [mx, my] = at(x, y);
                let found = f64::from(heights.above_mm.at(x, y));
                assert!((found - (0.2 * mx - 0.1 * my)).abs() < 1e-5, "({x}, {y}): {found}");
            }
        }
    }

    #[test]
    fn a_ball_is_where_it_is_to_the_curvature_between_pixels() {
        // 1 mm deep, off the middle; 0.05 mm between rays at the pad: h^2 / (4 R), with slopes at the rim of the contact.
        let (centre, radius) = ([3.0, -1.5, PLANE_MM + 3.0], 4.0);
        let heights = seen(40.0, [480, 360], |ray| ball(centre, radius, ray).min(60.0));
        let (mut worst, mut touching) = (0.0_f64, 0);
        for y in 0..120 {
            for x in 0..160 {
                let [mx, my] = at(x, y);
                let square = radius * radius - (mx - centre[0]).powi(2) - (my - centre[1]).powi(2);
                let truth = if square > 0.0 { centre[2] - square.sqrt() - PLANE_MM } else { f64::INFINITY };
                let found = f64::from(heights.above_mm.at(x, y));
                assert_eq!(found < 0.0, truth < 0.0, "({x}, {y})");
                if truth < 0.0 {
                    worst = worst.max((found - truth).abs());
                    touching += 1;
                }
            }
        }
        assert!(touching > 2000 && worst < 1e-3, "{touching} px, {worst} mm");
    }

    #[test]
    fn what_a_block_hides_is_counted_and_not_bridged() {
        // A square 10 mm wide whose face is 1 mm in the pad, before a wall 15 mm behind it.
        let face = |[x, y]: [f64; 2]| x.abs().max(y.abs()) * 24.0 <= 5.0;
        let heights = seen(40.0, [480, 360], |ray| if face(ray) { 24.0 } else { 40.0 });
        let columns: Vec<f32> = (0..160).map(|x| heights.above_mm.at(x, 60)).collect();
        // From the face's edge (5 mm) to where the wall begins to be seen (5 * 40 / 24 mm) nothing is known.
        for (x, height) in columns.iter().enumerate() {
            let from_middle = at(x, 60)[0].abs();
            let expected = if from_middle < 4.93 { -1.0 } else { f32::INFINITY };
            if !(4.93..5.07).contains(&from_middle) && from_middle < 7.9 {
                assert!((height - expected).abs() < 1e-5 || *height == expected, "{from_middle} mm: {height}");
            }
        }
        // Beside the face, up to where a ray passes it on the way to the pad's surface (5 * 25 / 24 mm).
        let ring = 4.0 * ((5.0_f64 * 25.0 / 24.0).powi(2) - 25.0) / 0.01;
        assert!((heights.unseen_px as f64 - ring).abs() < 0.5 * ring, "{} of about {ring}", heights.unseen_px);
    }

    #[test]
    fn what_lies_out_of_the_image_is_unseen_and_what_is_empty_is_not() {
        let empty = seen(40.0, [400, 300], |_| f64::INFINITY);
        assert_eq!(empty.unseen_px, 0);
        assert!(empty.above_mm.data.iter().all(|mm| *mm == f32::INFINITY));
        // 25 mm away, 12 mm high: tan(fov / 2) = 6 / 25. Half of that shows the middle half.
        let narrow = 2.0 * (3.0_f64 / 25.0).atan().to_degrees();
        let half = seen(narrow, [160, 120], |_| f64::INFINITY);
        assert_eq!(half.unseen_px, 160 * 120 - 80 * 60);
    }
}
