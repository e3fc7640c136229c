//! Loss of light towards the image's corners: in proportion to the square of the distance from the middle, as for small
//! angles of the cosine-fourth law of an ideal lens.

use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;

/// Takes from `planes`, which show `part` of the view, the share `corner` of the light in the view's corners.
pub fn darken(planes: &mut [Vec<f32>; 3], part: Rect, view: &View, corner: f64) {
    let [width, height] = view.resolution_px.map(|size| size as f64);
    let diagonal2 = (width * width + height * height) / 4.0;
    // The share lost at a distance along one axis, and at the corner in all.
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
