//! Finds what of a depth map is thin.
//!
//! Parts that are narrower than a disc are found by a morphological opening (Serra 1982) of the depth map with the disc,
//! which removes exactly those parts into which it does not fit.

use super::Depth;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// Counts the pixels that touch, and those of them that are in no square of four touching ones.
pub fn count_scattered_pixels(penetration: &Grid<f32>) -> (usize, usize) {
    let Grid { width, height, .. } = *penetration;
    let touches = |x: usize, y: usize| penetration.data.get(y * width + x).is_some_and(|mm| *mm > 0.0);
    let (mut count, mut alone) = (0, 0);
    for y in 0..height {
        for x in 0..width {
            if !touches(x, y) {
                continue;
            }
            count += 1;
            let square = |left: usize, top: usize| {
                left + 1 < width && (0..2).all(|j| (0..2).all(|i| touches(left + i, top + j)))
            };
            let corners = [x.checked_sub(1), Some(x)].into_iter().flatten();
            let in_square = corners
                .into_iter()
                .any(|left| [y.checked_sub(1), Some(y)].into_iter().flatten().any(|top| square(left, top)));
            alone += usize::from(!in_square);
        }
    }
    (count, alone)
}

/// Computes the fraction of what touches in view from which an opening with a disc of `radius` px removes more than
/// `blunting_mm`; 0 if nothing touches. The margin must be at least twice the radius.
pub fn compute_thin_fraction(depth: &Depth, radius: usize, blunting_mm: f32) -> f64 {
    let (width, height, margin) = (depth.penetration.width, depth.penetration.height, depth.margin_px);
    let part = depth.touching.grown(2 * radius, width, height);
    let mut pressed = depth.penetration.crop(part);
    pressed.data.iter_mut().for_each(|below| *below = below.max(0.0));
    let least = |a: f32, b: f32| if b < a { b } else { a };
    let largest = |a: f32, b: f32| if b > a { b } else { a };
    let opened = filter_over_disc(&filter_over_disc(&pressed, radius, least), radius, largest);

    let view = Rect { x0: margin, y0: margin, x1: width - margin, y1: height - margin };
    let view = view.in_window(part.x0, part.y0, part.width(), part.height());
    let (mut touching, mut thin) = (0_usize, 0_usize);
    for y in view.y0..view.y1 {
        let rows = pressed.row(y)[view.x0..view.x1].iter().zip(&opened.row(y)[view.x0..view.x1]);
        for (before, after) in rows {
            touching += usize::from(*before > 0.0);
            thin += usize::from(before - after > blunting_mm);
        }
    }
    thin as f64 / touching.max(1) as f64
}

/// Combines every value with those in the disc of `radius` px around it, as far as the disc lies in the image. With a
/// minimum this is an erosion, with a maximum a dilation.
fn filter_over_disc(image: &Grid<f32>, radius: usize, take: impl Fn(f32, f32) -> f32) -> Grid<f32> {
    let mut result = image.clone();
    let (width, height) = (image.width, image.height);
    simd_dispatch(
        #[inline(always)]
        || {
            for y in 0..height {
                for from in y.saturating_sub(radius)..(y + radius + 1).min(height) {
                    let dy = from.abs_diff(y);
                    let reach = (radius * radius - dy * dy).isqrt();
                    // The disc is symmetric: shift to both sides at once.
                    for shift in 0..=reach.min(width.saturating_sub(1)) {
                        let source = image.row(from);
                        let target = result.row_mut(y);
                        for (value, other) in target.iter_mut().zip(&source[shift..]) {
                            *value = take(*value, *other);
                        }
                        for (value, other) in target[shift..].iter_mut().zip(source) {
                            *value = take(*value, *other);
                        }
                    }
                }
            }
        },
    );
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADIUS: usize = 3;

    #[test]
    fn the_opening_keeps_what_the_disc_fits_into_and_takes_off_the_rest() {
        let mut image = Grid::<f32>::new(60, 40);
        for y in 0..40 {
            // Strips as wide as the disc and a point narrower.
            image.row_mut(y)[10..10 + 2 * RADIUS + 1].fill(1.0);
            image.row_mut(y)[30..30 + 2 * RADIUS].fill(1.0);
        }
        let opened = filter_over_disc(&filter_over_disc(&image, RADIUS, f32::min), RADIUS, f32::max);
        let row = opened.row(20);
        assert!(row[10..10 + 2 * RADIUS + 1].iter().all(|value| *value == 1.0), "{row:?}");
        assert!(row[30..30 + 2 * RADIUS].iter().all(|value| *value == 0.0), "{row:?}");
    }

    #[test]
    fn a_filter_over_the_disc_agrees_with_a_plain_search() {
        for (width, height) in [(1, 1), (2, 7), (9, 3), (17, 23)] {
            let mut image = Grid::<f32>::new(width, height);
            for (at, value) in image.data.iter_mut().enumerate() {
                *value = ((at * 7919 + 13) % 101) as f32;
            }
            let filtered = filter_over_disc(&image, RADIUS, f32::max);
            for y in 0..height {
                for x in 0..width {
                    let inside = |u: usize, v: usize| u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2) <= RADIUS * RADIUS;
                    let points = (0..width).flat_map(|u| (0..height).map(move |v| (u, v)));
                    let around = points.filter(|&(u, v)| inside(u, v)).map(|(u, v)| image.at(u, v));
                    assert_eq!(filtered.at(x, y), around.fold(0.0, f32::max), "{x}, {y} of {width} x {height}");
                }
            }
        }
    }

    #[test]
    fn what_stands_alone_is_told_from_what_is_part_of_a_square() {
        let row = |text: &str| text.chars().map(|c| if c == '#' { 1.0 } else { -1.0 }).collect::<Vec<f32>>();
        let of = |rows: [&str; 3]| count_scattered_pixels(&Grid { width: 5, height: 3, data: rows.map(row).concat() });
        assert_eq!(of(["#.#.#", ".....", "#...#"]), (5, 5));
        assert_eq!(of(["##...", "##...", "....#"]), (5, 1));
        assert_eq!(of([".....", "#####", "....."]), (5, 5));
        assert_eq!(of(["#####", "#####", "#####"]), (15, 0));
    }
}
