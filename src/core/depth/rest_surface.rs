//! The pad's surface at rest, where it is not smooth and flat: curved, or covered with a grainy coating.
//!
//! The undeformed surface touches the plane z = 0 at its highest point and lies `drop` below it elsewhere, towards the
//! camera. The object's penetration is measured against that surface. The contact is then solved as on a flat layer,
//! which is accurate where slopes of the rest surface are small against 1 (the error is stated in
//! docs/explanation/effect-models.md). The coating's grain affects only the light: it is far too fine to change a
//! contact.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::base::grain::grain_noise;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::depth::Depth;

/// The rest shape of a pad that is not flat.
#[derive(Clone, Debug, PartialEq)]
pub enum RestSurface {
    /// Part of a ball, highest at the centre of the image.
    Dome {
        /// Radius of the ball, mm, at least half the view's diagonal.
        radius_mm: f64,
    },
    /// A height map, stretched over the view; 1 is the highest point.
    HeightMap {
        /// Heights, 0 to 1.
        heights: Arc<Grid<f32>>,
        /// Height of 1 above 0, mm.
        height_mm: f64,
    },
}

/// The coating's grain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Grain {
    /// Standard deviation of its height, um, 0 to 100.
    pub height_um: f64,
    /// Size of the grain, mm.
    pub size_mm: f64,
}

/// Computes how far the surface of a curved pad lies below its highest point, mm, on the grid of
/// [`crate::gelpad::Contact::surface`].
pub fn rest_drop_mm(shape: &RestSurface, view: &View) -> Grid<f32> {
    let [width, height] = view.resolution_px.map(|size| size + 2 * SURFACE_BORDER);
    let mut drop = Grid::new(width, height);
    for row in 0..height {
        for column in 0..width {
            let below = match shape {
                RestSurface::Dome { radius_mm } => {
                    let centre = |at: usize| at as f64 + 0.5 - SURFACE_BORDER as f64;
                    let [x, y] = view.point_mm([centre(column), centre(row)]);
                    let (r2, radius2) = (x * x + y * y, radius_mm * radius_mm);
                    // R - sqrt(R^2 - r^2) without cancellation.
                    r2 / (radius_mm + libm::sqrt((radius2 - r2).max(0.0)))
                }
                RestSurface::HeightMap { heights, height_mm } => {
                    height_mm * (1.0 - f64::from(heights.sample_stretched(column, row, width, height)))
                }
            };
            drop.row_mut(row)[column] = below as f32;
        }
    }
    drop
}

/// Subtracts a curved pad's drop from a penetration that was captured up to `above_mm`. Beyond the view the pad is as
/// high as at the view's border. No value falls below minus `above_mm`, which stands for no object, as elsewhere.
pub fn subtract_drop(depth: &mut Depth, drop: &Grid<f32>, above_mm: f64) {
    let Depth { penetration, margin_px, .. } = depth;
    // The margin of every pad model includes the surface's border.
    let beyond = margin_px.saturating_sub(SURFACE_BORDER);
    let inside = drop.width.min(penetration.width);
    let floor = 0.0 - above_mm as f32;
    let mut below = vec![0.0; penetration.width];
    simd_dispatch(
        #[inline(always)]
        || {
            for y in 0..penetration.height {
                let row = drop.row(y.saturating_sub(beyond).min(drop.height - 1));
                below[..beyond].fill(row[0]);
                below[beyond..beyond + inside].copy_from_slice(&row[..inside]);
                below[beyond + inside..].fill(row[drop.width - 1]);
                for (penetration, below) in penetration.row_mut(y).iter_mut().zip(&below) {
                    *penetration = (*penetration - below).max(floor);
                }
            }
        },
    );
    depth.measure();
}

/// Returns the relief of the pad at rest as the light sees it: mm towards the camera, on the grid of
/// [`crate::gelpad::Contact::surface`]. `None` for a smooth and flat pad.
pub fn rest_relief(drop: Option<&Grid<f32>>, coating: Option<&Grain>, view: &View) -> Option<Grid<f32>> {
    let [width, height] = view.resolution_px.map(|size| size + 2 * SURFACE_BORDER);
    let rough = coating.filter(|coating| coating.height_um > 0.0).map(|coating| {
        let mut noise = grain_noise(width, height, coating.size_mm, view, "coating");
        let mm = (coating.height_um * 1e-3) as f32;
        noise.data.iter_mut().for_each(|value| *value *= mm);
        noise
    });
    match (rough, drop) {
        (None, None) => None,
        (Some(rough), None) => Some(rough),
        (None, Some(drop)) => Some(drop.clone()),
        (Some(mut rough), Some(drop)) => {
            rough.data.iter_mut().zip(&drop.data).for_each(|(sum, drop)| *sum += drop);
            Some(rough)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::grid::Rect;

    #[test]
    fn a_curved_pad_lies_lower_under_the_object_and_no_object_stays_none() {
        let penetration = Grid { width: 6, height: 5, data: [0.5, 0.5, 0.0, 0.0, -0.2, -0.2].repeat(5) };
        let drop = Grid { width: 4, height: 3, data: [0.1, 0.2, 0.3, 0.1].repeat(3) };
        let mut depth =
            Depth { penetration, margin_px: 2, touching: Rect::default(), deepest_mm: 9.0, over_thickness_px: 0 };
        subtract_drop(&mut depth, &drop, 0.2);
        let expected = [0.4_f32, 0.4, -0.2, -0.2, -0.2, -0.2];
        for row in 0..5 {
            for (found, expected) in depth.penetration.row(row).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-6, "{:?}", depth.penetration.row(row));
            }
        }
        assert_eq!(depth.touching, Rect { x0: 0, y0: 0, x1: 2, y1: 5 });
    }
}
