//! The pad as a pyramid of Gaussian blurs of the depth map; the contact is restored after each blur.
//!
//! Source: Si and Yuan (2022), "Taxim: an example-based simulation model for GelSight tactile sensors", section III-B.
//! Blurs go from wide to narrow. After each, the object's own surface is restored where it reaches into the pad; a last
//! narrow blur softens the rim. The result is closer to a soft pad than a mean blur. But the pad cannot bulge, all of
//! the penetration counts as contact, and there is no force.

use serde::{Deserialize, Serialize};

use super::{Contact, Numerics, no_contact};
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;

/// Parameters of the pyramid.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Gaussian {
    /// Widths of the blurs, px, odd, 1 to 255, in the order in which they are applied; up to 8. Taxim's: 51, 21, 11, 5.
    pub kernels_px: Vec<u32>,
    /// Width of the last blur, px, odd, 1 to 255. Taxim's: 5.
    pub smoothing_px: u32,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self { kernels_px: vec![51, 21, 11, 5], smoothing_px: 5 }
    }
}

impl Gaussian {
    /// Returns how far a value spreads, px.
    pub fn reach_px(&self) -> usize {
        self.kernels_px.iter().chain([&self.smoothing_px]).map(|width| *width as usize / 2).sum()
    }
}

/// Presses the object into the pad.
pub fn press(gaussian: &Gaussian, depth: &Depth) -> Contact {
    let margin = depth.margin_px;
    let (width, height) = (depth.penetration.width - 2 * margin, depth.penetration.height - 2 * margin);
    let mut contact = no_contact(width, height, None, Numerics::DIRECT);
    let area = depth.touching.grown(gaussian.reach_px(), depth.penetration.width, depth.penetration.height);
    let corner = margin.saturating_sub(SURFACE_BORDER);
    contact.region = area.in_window(corner, corner, contact.surface.width, contact.surface.height);
    if contact.region.is_empty() {
        return contact;
    }
    let penetration = depth.penetration.crop(area);
    let mut surface = penetration.clone();
    let mut spare = Grid::new(surface.width, surface.height);
    for kernel_px in &gaussian.kernels_px {
        blur_in_place(&mut surface, &mut spare, *kernel_px);
        for (surface, object) in surface.data.iter_mut().zip(&penetration.data) {
            *surface = if *object > 0.0 { *object } else { *surface };
        }
    }
    blur_in_place(&mut surface, &mut spare, gaussian.smoothing_px);
    contact.finite = surface.data.iter().all(|value| value.is_finite());
    let window =
        Rect { x0: corner, y0: corner, x1: corner + contact.surface.width, y1: corner + contact.surface.height };
    contact.surface.paste(&surface, area, window);
    for y in 0..height {
        let object = &depth.penetration.row(margin + y)[margin..margin + width];
        for (mask, penetration) in contact.mask.row_mut(y).iter_mut().zip(object) {
            *mask = if *penetration > 0.0 { 255 } else { 0 };
        }
    }
    contact
}

/// Returns one half of a Gaussian of `width` px, from its centre outwards. Sigma is chosen as OpenCV does: it grows by
/// 0.15 px per pixel of width.
fn gaussian_weights(width: u32) -> Vec<f32> {
    let sigma = 0.3 * ((f64::from(width) - 1.0) * 0.5 - 1.0) + 0.8;
    let value = |k: u32| libm::exp(-0.5 * f64::from(k * k) / (sigma * sigma));
    let sum = value(0) + 2.0 * (1..=width / 2).map(value).sum::<f64>();
    (0..=width / 2).map(|k| (value(k) / sum) as f32).collect()
}

/// Blurs an image in place; outside the image the depth is 0. `spare` is memory of the same size.
fn blur_in_place(image: &mut Grid<f32>, spare: &mut Grid<f32>, width_px: u32) {
    let weights = gaussian_weights(width_px);
    let reach = weights.len() - 1;
    let (width, height) = (image.width, image.height);
    let mut padded = vec![0.0; width + 2 * reach];
    simd_dispatch(
        #[inline(always)]
        || {
            for y in 0..height {
                let out = spare.row_mut(y);
                padded[reach..reach + width].copy_from_slice(image.row(y));
                for (value, middle) in out.iter_mut().zip(&padded[reach..]) {
                    *value = weights[0] * middle;
                }
                for (k, weight) in weights.iter().enumerate().skip(1) {
                    let (before, after) = (&padded[reach - k..][..width], &padded[reach + k..][..width]);
                    for ((value, before), after) in out.iter_mut().zip(before).zip(after) {
                        *value += weight * (before + after);
                    }
                }
            }
            for y in 0..height {
                let out = image.row_mut(y);
                for (value, middle) in out.iter_mut().zip(spare.row(y)) {
                    *value = weights[0] * middle;
                }
                for (k, weight) in weights.iter().enumerate().skip(1) {
                    for row in [y.checked_sub(k), Some(y + k)].into_iter().flatten().filter(|row| *row < height) {
                        for (value, other) in out.iter_mut().zip(spare.row(row)) {
                            *value += weight * other;
                        }
                    }
                }
            }
        },
    );
}
