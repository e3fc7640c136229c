//! Differences between two surfaces of the pad: in height, and in the direction of their normals.
//!
//! Heights are compared in the view, normals in the contact and in the ring around it, where light shows them. Slopes
//! are centred differences, as in [`gelsim_core::optics::normals`], but in f64.

use crate::metrics::distance::squared_distance_mm2;
use crate::metrics::statistics::quantile;
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::SURFACE_BORDER;

/// Width of the ring around the contact, mm.
pub const RING_MM: f64 = 2.0;

/// Differences between a surface and its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceError {
    /// Root of the mean squared height difference, um; 0 for surfaces without pixels, NaN if a height is.
    pub height_rms_um: f64,
    /// Largest height difference, um; 0 for surfaces without pixels, NaN if a height is.
    pub height_max_um: f64,
    /// Angles between the normals in the contact and in the ring around it; None without contact.
    pub near: Option<NormalAngles>,
    /// Angles between the normals inside the contact; None without contact.
    pub contact: Option<NormalAngles>,
    /// Angles between the normals outside the contact, at most [`RING_MM`] from it; None without contact or if it
    /// fills the view.
    pub ring: Option<NormalAngles>,
    /// Share of the view that is in that ring, 0 to 1.
    pub ring_share: f64,
}

/// Angles between two surfaces' normals, over a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalAngles {
    /// Mean, degrees.
    pub mean_deg: f64,
    /// 95th percentile, degrees.
    pub p95_deg: f64,
}

/// Compares two displacement maps, mm, which are [`SURFACE_BORDER`] wider than the view on every side; `mask` is the
/// reference's contact in the view (non-zero where it touches), `mm_per_px` is [width, height] of a pixel.
///
/// # Panics
///
/// If the sizes do not match.
pub fn compare_surfaces(
    surface: &Grid<f32>,
    reference: &Grid<f32>,
    mask: &Grid<u8>,
    mm_per_px: [f64; 2],
) -> SurfaceError {
    let size = [mask.width + 2 * SURFACE_BORDER, mask.height + 2 * SURFACE_BORDER];
    assert_eq!([surface.width, surface.height], size, "surface and mask do not match");
    assert_eq!([reference.width, reference.height], size, "reference and mask do not match");

    let (height_rms_um, height_max_um) = height_error_um(surface, reference);
    let angles = angles_deg(surface, reference, mm_per_px);
    let squares = squared_distance_mm2(mask, mm_per_px);
    // A pixel exactly at the limit belongs to the ring, however its square was rounded.
    let limit = RING_MM * RING_MM * (1.0 + 1e-9);
    let in_ring = |square: f64| square > 0.0 && square <= limit;
    let over = |inside: &dyn Fn(f64) -> bool| -> Option<NormalAngles> {
        let angles = angles.data.iter().zip(&squares.data).filter(|(_, square)| inside(**square));
        let angles: Vec<f64> = angles.map(|(angle, _)| *angle).collect();
        let p95_deg = quantile(&angles, 0.95)?;
        Some(NormalAngles { mean_deg: angles.iter().sum::<f64>() / angles.len() as f64, p95_deg })
    };
    SurfaceError {
        height_rms_um,
        height_max_um,
        near: over(&|square| square <= limit),
        contact: over(&|square| square == 0.0),
        ring: over(&|square| in_ring(square)),
        ring_share: squares.data.iter().filter(|square| in_ring(**square)).count() as f64
            / squares.data.len().max(1) as f64,
    }
}

/// Root mean square and maximum over the view of the differences of two displacement maps of the same size, which are
/// [`SURFACE_BORDER`] wider on every side, um.
pub fn height_error_um(surface: &Grid<f32>, reference: &Grid<f32>) -> (f64, f64) {
    let (mut sum, mut max, mut count) = (0.0, 0.0, 0_usize);
    for y in SURFACE_BORDER..surface.height - SURFACE_BORDER {
        let inside = SURFACE_BORDER..surface.width - SURFACE_BORDER;
        for (height, expected) in surface.row(y)[inside.clone()].iter().zip(&reference.row(y)[inside]) {
            let error = (f64::from(*height) - f64::from(*expected)).abs() * 1e3;
            sum += error * error;
            // `f64::max` would pass over a NaN.
            max = if error > max || error.is_nan() { error } else { max };
            count += 1;
        }
    }
    ((sum / count.max(1) as f64).sqrt(), max)
}

/// Angle between the two normals at every pixel of the view, degrees.
pub fn angles_deg(surface: &Grid<f32>, reference: &Grid<f32>, mm_per_px: [f64; 2]) -> Grid<f64> {
    let mut angles = Grid::new(surface.width - 2 * SURFACE_BORDER, surface.height - 2 * SURFACE_BORDER);
    for y in 0..angles.height {
        for x in 0..angles.width {
            let [ax, ay] = slopes_at(surface, x, y, mm_per_px);
            let [bx, by] = slopes_at(reference, x, y, mm_per_px);
            // The cross product of (ax, ay, -1) and (bx, by, -1) from the slopes' differences. It keeps its digits
            // where the normals are almost the same, unlike the arc cosine of their dot product.
            let (dx, dy) = (bx - ax, by - ay);
            let turn = ax * dy - ay * dx;
            let sine = (dx * dx + dy * dy + turn * turn).sqrt();
            let cosine = ax * bx + ay * by + 1.0;
            angles.row_mut(y)[x] = sine.atan2(cosine).to_degrees();
        }
    }
    angles
}

/// Slopes of the surface at pixel (`x`, `y`) of the view, along rows and columns.
fn slopes_at(surface: &Grid<f32>, x: usize, y: usize, mm_per_px: [f64; 2]) -> [f64; 2] {
    let at = |x, y| f64::from(surface.at(x, y));
    let (x, y) = (x + SURFACE_BORDER, y + SURFACE_BORDER);
    [(at(x - 1, y) - at(x + 1, y)) * (0.5 / mm_per_px[0]), (at(x, y - 1) - at(x, y + 1)) * (0.5 / mm_per_px[1])]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MM_PER_PX: [f64; 2] = [0.5, 0.25];

    fn plane(width: usize, height: usize, slope: [f64; 2]) -> Grid<f32> {
        let mut grid = Grid::new(width + 2, height + 2);
        for y in 0..height + 2 {
            for x in 0..width + 2 {
                grid.row_mut(y)[x] = (x as f64 * MM_PER_PX[0] * slope[0] + y as f64 * MM_PER_PX[1] * slope[1]) as f32;
            }
        }
        grid
    }

    #[test]
    fn heights_are_compared_in_micrometres_in_the_view() {
        let reference = Grid::<f32>::new(4, 4);
        let mut surface = reference.clone();
        surface.row_mut(1)[1] = 0.008;
        surface.row_mut(2)[1] = -0.004;
        // Not in view.
        surface.row_mut(0)[0] = 1.0;
        let error = compare_surfaces(&surface, &reference, &Grid::new(2, 2), MM_PER_PX);
        assert!((error.height_max_um - 8.0).abs() < 1e-6);
        assert!((error.height_rms_um - (80f64 / 4.0).sqrt()).abs() < 1e-6);
        assert_eq!((error.near, error.contact, error.ring), (None, None, None));
    }

    #[test]
    fn a_height_that_is_no_number_is_not_passed_over() {
        let reference = Grid::<f32>::new(5, 5);
        let mut surface = reference.clone();
        surface.row_mut(2)[2] = f32::NAN;
        surface.row_mut(3)[3] = 1.0;
        let error = compare_surfaces(&surface, &reference, &Grid::new(3, 3), MM_PER_PX);
        assert!(error.height_rms_um.is_nan() && error.height_max_um.is_nan());
    }

    #[test]
    fn the_angle_of_tilted_planes_is_the_tilt() {
        let flat = plane(6, 5, [0.0, 0.0]);
        for slope in [[0.75, 0.0], [0.0, 0.75]] {
            let angles = angles_deg(&plane(6, 5, slope), &flat, MM_PER_PX);
            assert!(angles.data.iter().all(|angle| (angle - 36.869_897_645_844_02).abs() < 1e-9), "{slope:?}");
        }
        let opposite = angles_deg(&plane(6, 5, [2.0, 0.0]), &plane(6, 5, [-2.0, 0.0]), MM_PER_PX);
        assert!(opposite.data.iter().all(|angle| (angle - 126.869_897_645_844_02).abs() < 1e-9));
    }

    #[test]
    fn contact_and_ring_are_told_apart() {
        // One row of pixels, 0.5 mm wide: contact at 2 and 3, the ring from there to 7, 2 mm away.
        let mut mask = Grid::new(12, 1);
        mask.row_mut(0)[2..4].fill(255);
        let reference = Grid::<f32>::new(14, 3);
        let mut surface = reference.clone();
        let kink = |surface: &mut Grid<f32>, x: usize, slope: f32| {
            surface.row_mut(0)[x + 1] = slope * 0.25;
            surface.row_mut(2)[x + 1] = -slope * 0.25;
        };
        kink(&mut surface, 3, 1.0);
        kink(&mut surface, 7, 1.0);
        kink(&mut surface, 8, 7.0);
        let error = compare_surfaces(&surface, &reference, &mask, MM_PER_PX);
        let contact = error.contact.unwrap();
        assert!((contact.mean_deg - 22.5).abs() < 1e-9 && (contact.p95_deg - 42.75).abs() < 1e-9, "{contact:?}");
        // Columns 0, 1, 4, 5, 6, 7, of which only the last is tilted: numpy.quantile gives 33.75.
        let ring = error.ring.unwrap();
        assert!((ring.mean_deg - 7.5).abs() < 1e-9 && (ring.p95_deg - 33.75).abs() < 1e-9, "{ring:?}");
        assert_eq!(compare_surfaces(&surface, &reference, &Grid { data: vec![255; 12], ..mask }, MM_PER_PX).ring, None);
    }

    proptest! {
        #[test]
        fn tiny_angles_keep_their_digits(slope in prop::array::uniform2(-3.0f64..3.0), turn in -10i32..-2) {
            let step = 10f64.powi(turn) as f32;
            let mut reference = plane(1, 1, slope);
            reference.row_mut(1)[0] = 0.0;
            let mut surface = reference.clone();
            surface.row_mut(1)[0] = step;
            let found = angles_deg(&surface, &reference, MM_PER_PX).data[0].to_radians();
            // To first order: the change of slope, seen along the other slope and foreshortened.
            let [gx, gy] = slopes_at(&reference, 0, 0, MM_PER_PX);
            let change = f64::from(step);
            let expected = change * (1.0 + gy * gy).sqrt() / (1.0 + gx * gx + gy * gy);
            let rounding = 1e-14 / change;
            prop_assert!((found / expected - 1.0).abs() < 4.0 * change + rounding, "{found} {expected}");
        }

        #[test]
        fn a_surface_is_no_distance_from_itself(heights in prop::collection::vec(-3f32..3.0, 30)) {
            let surface = Grid { width: 6, height: 5, data: heights };
            let mut mask = Grid::new(4, 3);
            mask.row_mut(1)[1] = 255;
            let none = Some(NormalAngles { mean_deg: 0.0, p95_deg: 0.0 });
            // All of the view lies within 2 mm of the pixel that touches.
            let ring_share = 11.0 / 12.0;
            let expected =
                SurfaceError { height_rms_um: 0.0, height_max_um: 0.0, near: none, contact: none, ring: none, ring_share };
            prop_assert_eq!(compare_surfaces(&surface, &surface, &mask, MM_PER_PX), expected);
        }
    }
}
