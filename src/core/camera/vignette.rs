//! Loss of light towards the image's corners, in proportion to the square of the distance from the middle: the
//! cosine-fourth law of an ideal lens at small angles.

use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;

/// Darkens `planes`, which show `part` of the view; the corners of the view lose the fraction `corner` of their light.
pub fn darken_corners(planes: &mut [Vec<f32>; 3], part: Rect, view: &View, corner: f64) {
    let [width, height] = view.resolution_px.map(|size| size as f64);
    let diagonal2 = (width * width + height * height) / 4.0;
    // The loss by the distance along one axis: those along x and y add up, to `corner` in the corners.
    let lost = |at: usize, size: f64| {
        let offset = at as f64 + 0.5 - size / 2.0;
        (corner * offset * offset / diagonal2) as f32
    };
    let columns: Vec<f32> = (part.x0..part.x1).map(|x| lost(x, width)).collect();
    for plane in planes {
        simd_dispatch(
            #[inline(always)]
            || {
                for (y, row) in (part.y0..part.y1).zip(plane.chunks_exact_mut(columns.len().max(1))) {
                    let kept = 1.0 - lost(y, height);
                    for (value, lost) in row.iter_mut().zip(&columns) {
                        *value *= kept - lost;
                    }
                }
            },
        );
    }
}
