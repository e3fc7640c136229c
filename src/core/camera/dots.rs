//! Dots printed on the pad: where they are at rest, and how they are drawn onto light.
//!
//! A dot is an ellipse of ink with a soft edge. How much of a pixel it covers follows from the distance of the pixel to
//! the edge. The edge is moved so that the amount of ink is that of the ellipse's area (Steiner's formula for the
//! ramp). This holds within 1 % from a radius of 0.3 px on, while the radii are alike (7 : 10) and the edge is no wider
//! than the dot. Where dots overlap, both take their share of the light.

use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;

use super::noise::splitmix64;

/// A dot in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    /// Its middle, px from the top left corner: pixel (i, j) has its centre at (i + 0.5, j + 0.5).
    pub at_px: [f32; 2],
    /// Its radii along x and y, px. A dot is drawn only if its radii are above 0 and its middle is finite.
    pub radius_px: [f32; 2],
}

/// Draws dots onto the part `region` of the picture's light.
///
/// Each channel is multiplied by 1 - cover (1 - `color`), with `color` the fraction of the light that the ink lets
/// through. The ramp from full ink to none is `edge_px` and one pixel wide.
pub fn draw_dots(dots: &[Dot], color: [f32; 3], edge_px: f32, planes: &mut [Vec<f32>; 3], region: Rect) {
    let absorbed = color.map(|through| 1.0 - through);
    let (mut samples, mut cover) = (Vec::new(), Vec::new());
    simd_dispatch(
        #[inline(always)]
        || {
            for dot in dots {
                let Some(stamp) = Stamp::new(dot, edge_px, region) else { continue };
                let Rect { x0, y0, x1, y1 } = stamp.part;
                for y in y0..y1 {
                    stamp.compute_row_coverage(y, &mut samples, &mut cover);
                    let start = (y - region.y0) * region.width() + x0 - region.x0;
                    for (plane, absorbed) in planes.iter_mut().zip(absorbed) {
                        for (light, cover) in plane[start..][..x1 - x0].iter_mut().zip(&cover) {
                            *light *= 1.0 - cover * absorbed;
                        }
                    }
                }
            }
        },
    );
}

/// Dots with a smaller radius are drawn on a grid finer than the pixels, on which their radius is at least this, px.
const MIN_RADIUS_PX: f32 = 4.0;

/// Largest factor by which that grid is finer than the pixels.
const MAX_OVERSAMPLING: f32 = 32.0;

/// Largest radius and edge, px; larger ones are clamped to it.
const LARGEST_PX: f32 = 1e6;

/// A dot prepared for drawing, in lengths of a grid `oversampling` times finer than the pixels.
struct Stamp {
    /// The pixels that it touches.
    part: Rect,
    oversampling: usize,
    middle: [f32; 2],
    /// One over the radii of the ellipse at which the ink ends.
    inverse_radius: [f32; 2],
    /// First and last column of the finer grid that it touches, counted from the first one of the part.
    columns: [usize; 2],
    /// One over the width of the ramp from full ink to none.
    steepness: f32,
}

impl Stamp {
    /// Prepares a dot; returns `None` if it touches no pixel of `region`.
    fn new(dot: &Dot, edge_px: f32, region: Rect) -> Option<Self> {
        let drawable = dot.at_px.iter().all(|at| at.is_finite()) && dot.radius_px.iter().all(|radius| *radius > 0.0);
        if !drawable {
            return None;
        }
        let radius = dot.radius_px.map(|radius| radius.min(LARGEST_PX));
        let fine = libm::ceilf(MIN_RADIUS_PX / radius[0].min(radius[1])).clamp(1.0, MAX_OVERSAMPLING);
        let ramp = 1.0 + fine * if edge_px > 0.0 { edge_px.min(LARGEST_PX) } else { 0.0 };
        let spare = ramp_overhang(fine * libm::sqrtf(radius[0]) * libm::sqrtf(radius[1]), ramp);
        let outer = radius.map(|radius| radius * fine + spare);
        let middle = dot.at_px.map(|at| at * fine);

        // Pixels from the left or from the top.
        let range = |axis: usize, start: usize, end: usize| {
            let [first, last] = [middle[axis] - outer[axis], middle[axis] + outer[axis]].map(|at| at / fine);
            let cut = |at: f32| (at.max(0.0) as usize).clamp(start, end);
            [cut(first), cut(libm::ceilf(last))]
        };
        let ([x0, x1], [y0, y1]) = (range(0, region.x0, region.x1), range(1, region.y0, region.y1));
        let part = Rect { x0, y0, x1, y1 };
        if part.is_empty() {
            return None;
        }
        let fine_px = fine as usize;
        let column = |at: f32| ((at - x0 as f32 * fine).max(0.0) as usize).min(part.width() * fine_px);
        let columns = [column(middle[0] - outer[0]), column(libm::ceilf(middle[0] + outer[0]))];
        Some(Self {
            part,
            oversampling: fine_px,
            middle,
            inverse_radius: outer.map(|outer| 1.0 / outer),
            columns,
            steepness: 1.0 / ramp,
        })
    }

    /// Computes the fraction of each pixel in row `y` of the part that is covered; `samples` is scratch memory.
    #[inline(always)]
    fn compute_row_coverage(&self, y: usize, samples: &mut Vec<f32>, cover: &mut Vec<f32>) {
        let [first, last] = self.columns;
        // Full blocks only, so that no sample needs a loop of its own: outside its edge, a dot covers nothing.
        let size = (last - first).next_multiple_of(BLOCK);
        samples.clear();
        samples.resize((first + size).max(self.part.width() * self.oversampling), 0.0);
        // Counted from the picture's edge, so that a part of a dot has the same bits in every region.
        let start = (self.part.x0 * self.oversampling + first) as f32 + 0.5;
        for row in y * self.oversampling..(y + 1) * self.oversampling {
            let down = row as f32 + 0.5 - self.middle[1];
            for (block, samples) in samples[first..first + size].chunks_exact_mut(BLOCK).enumerate() {
                for (i, sample) in samples.iter_mut().enumerate() {
                    *sample += self.ink_at(start + (block * BLOCK + i) as f32 - self.middle[0], down);
                }
            }
        }
        if self.oversampling == 1 {
            std::mem::swap(samples, cover);
            return;
        }
        let share = 1.0 / (self.oversampling * self.oversampling) as f32;
        cover.clear();
        cover.extend(
            samples.chunks_exact(self.oversampling).take(self.part.width()).map(|s| s.iter().sum::<f32>() * share),
        );
    }

    /// Returns how much ink there is at a place counted from the middle, 0 to 1.
    #[inline(always)]
    fn ink_at(&self, right: f32, down: f32) -> f32 {
        // Keeps the distance from becoming 0 / 0 in the middle.
        const TINY: f32 = 1e-9;
        let [x, y] = [right * self.inverse_radius[0], down * self.inverse_radius[1]];
        let [dx, dy] = [x * self.inverse_radius[0], y * self.inverse_radius[1]];
        let square = x * x + y * y;
        let slope = dx * dx + dy * dy + TINY * self.inverse_radius[0] * self.inverse_radius[1];
        let distance = (1.0 - square.sqrt()) * ((square + TINY) / slope).sqrt();
        (distance * self.steepness).clamp(0.0, 1.0)
    }
}

/// Samples that are computed at a time.
const BLOCK: usize = 8;

/// Returns how far outside a circle's edge the ink has to end, so that a ramp from there inwards holds as much ink as a
/// sharp edge.
///
/// If the ink ends at a radius R, that is pi ((R - ramp / 2)^2 + ramp^2 / 12), or a cone of pi R^3 / (3 ramp) where the
/// ramp is wider than R.
fn ramp_overhang(radius: f32, ramp: f32) -> f32 {
    let square = radius * radius;
    let outer = if 3.0 * square > ramp * ramp {
        libm::sqrtf(square - ramp * ramp / 12.0) + ramp / 2.0
    } else {
        libm::cbrtf(3.0 * ramp * square)
    };
    outer - radius
}

/// Largest number of dots of a printed pattern on each side of the middle, along each axis.
const MAX_DOTS_PER_SIDE: f64 = 1000.0;

/// Places the dots of a printed pattern without end at rest: mm from the middle of the image, x right, y down.
///
/// One dot is at `offset_mm`; the others, `pitch_mm` apart along x and along y, cover `field_of_view_mm` and `margin_mm`
/// around it. Each is moved by up to `jitter_mm` along x and along y, at random by `key` and by the dot's column and row
/// from the first one: a wider view has the same dots, and more. There are no dots if a pitch is not above 0 or the view
/// is empty. The pattern ends with the 1000th dot on a side.
pub fn place_dot_grid(
    pitch_mm: [f64; 2],
    offset_mm: [f64; 2],
    jitter_mm: f64,
    key: u64,
    field_of_view_mm: [f64; 2],
    margin_mm: f64,
) -> Vec<[f64; 2]> {
    // A dot that is outside by less than the jitter may be moved in.
    let reach_mm = field_of_view_mm.map(|mm| mm / 2.0 + margin_mm + jitter_mm.abs());
    let printable = pitch_mm.iter().all(|pitch| *pitch > 0.0 && pitch.is_finite())
        && offset_mm.iter().all(|offset| offset.is_finite())
        && jitter_mm.is_finite();
    if !printable || !reach_mm.iter().all(|reach| *reach >= 0.0) {
        return Vec::new();
    }
    let last = |axis: usize, offset_mm: f64| {
        let count = libm::floor((reach_mm[axis] - offset_mm) / pitch_mm[axis]);
        count.clamp(-MAX_DOTS_PER_SIDE, MAX_DOTS_PER_SIDE) as i32
    };
    let [columns, rows] = [0, 1].map(|axis| -last(axis, -offset_mm[axis])..=last(axis, offset_mm[axis]));
    let mut dots = Vec::new();
    for row in rows {
        for column in columns.clone() {
            let moved = random_offset(key, column, row);
            let steps = [column, row].map(f64::from);
            dots.push(std::array::from_fn(|k| steps[k] * pitch_mm[k] + moved[k] * jitter_mm + offset_mm[k]));
        }
    }
    dots
}

/// Returns the offset of a dot along x and along y, as a fraction of the largest one, -1 to 1: at random by `key` and by
/// the dot's column and row.
pub fn random_offset(key: u64, column: i32, row: i32) -> [f64; 2] {
    let bits = splitmix64(splitmix64(key) ^ ((u64::from(column as u32) << 32) | u64::from(row as u32)));
    [bits >> 32, bits & 0xffff_ffff].map(|bits| bits as f64 / f64::from(u32::MAX) * 2.0 - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::grid::Grid;
    use crate::base::simd::scalar_only;
    use std::f64::consts::PI;

    fn white(region: Rect) -> [Vec<f32>; 3] {
        [(); 3].map(|()| vec![1.0; region.area()])
    }

    /// Numbers from 0 to 1 that look random.
    fn unit(number: u64) -> f32 {
        (splitmix64(number) >> 40) as f32 / (1 << 24) as f32
    }

    /// What a black dot covers of the pixels of a picture.
    fn covered(dot: Dot, edge_px: f32, region: Rect) -> Vec<f32> {
        let mut planes = white(region);
        draw_dots(&[dot], [0.0; 3], edge_px, &mut planes, region);
        planes[0].iter().map(|light| 1.0 - light).collect()
    }

    fn somewhere(number: u64, radius_px: [f32; 2]) -> Dot {
        Dot { at_px: [35.0 + unit(number), 35.0 + unit(number + 1000)], radius_px }
    }

    #[test]
    fn a_dot_has_the_ink_of_its_ellipse_wherever_it_lies_and_however_soft_it_is() {
        let region = Rect::whole(70, 70);
        for number in 0..600 {
            let radius = 0.3 * libm::powf(60.0, unit(number + 2000));
            let radii = [radius, radius * (0.7 + 0.6 * unit(number + 3000))];
            let edge = if number % 3 == 0 { 0.0 } else { 1.5 * unit(number + 4000) };
            let ink: f64 = covered(somewhere(number, radii), edge, region).iter().map(|c| f64::from(*c)).sum();
            let area = PI * f64::from(radii[0]) * f64::from(radii[1]);
            // Where the edge is wider than the dot, how its ramp runs out at the tips is a guess.
            let bound = if edge < radii[0].min(radii[1]) { 0.01 } else { 0.03 };
            assert!((ink / area - 1.0).abs() < bound, "{radii:?} edge {edge}: {}", ink / area);
        }
    }

    #[test]
    fn a_sharp_dot_covers_of_each_pixel_what_lies_inside_the_ellipse() {
        let region = Rect::whole(70, 70);
        for number in 0..40 {
            let radius = 0.3 * libm::powf(60.0, unit(number + 2000));
            let dot = somewhere(number, [radius, radius * 1.3]);
            let mut squares = 0.0;
            for (i, found) in covered(dot, 0.0, region).iter().enumerate() {
                let inside = (0..400).filter(|k| {
                    let x = ((i % 70) as f32 + ((k % 20) as f32 + 0.5) / 20.0 - dot.at_px[0]) / dot.radius_px[0];
                    let y = ((i / 70) as f32 + ((k / 20) as f32 + 0.5) / 20.0 - dot.at_px[1]) / dot.radius_px[1];
                    x * x + y * y < 1.0
                });
                let error = f64::from(*found) - inside.count() as f64 / 400.0;
                assert!(error.abs() < 0.12, "{dot:?} {i}: {error}");
                squares += error * error;
            }
            assert!((squares / (10.0 * f64::from(radius).max(1.0))).sqrt() < 0.04, "{dot:?}: {squares}");
        }
    }

    #[test]
    fn edges_are_as_soft_as_asked() {
        let dot = Dot { at_px: [35.0, 35.5], radius_px: [12.0, 12.0] };
        for edge in [0.0, 2.0, 6.0] {
            let row = covered(dot, edge, Rect::whole(70, 70))[35 * 70..][35..70].to_vec();
            assert!(row[..(11.0 - edge / 2.0) as usize].iter().all(|cover| *cover == 1.0));
            assert!(row[(13.5 + edge / 2.0) as usize..].iter().all(|cover| *cover == 0.0));
            assert!(row.windows(2).all(|pair| pair[0] >= pair[1]));
            let soft = row.iter().filter(|cover| (0.001..0.999).contains(*cover)).count() as f32;
            assert!((soft - edge - 1.0).abs() <= 1.0, "{edge}: {soft}");
        }
    }

    #[test]
    fn a_part_of_a_picture_is_drawn_like_that_part_of_the_whole() {
        let whole = Rect::whole(90, 60);
        let dots: Vec<Dot> = (0..80)
            .map(|i| Dot {
                at_px: [unit(i) * 100.0 - 5.0, unit(i + 500) * 70.0 - 5.0],
                radius_px: [0.2 + 7.0 * unit(i + 900), 0.2 + 7.0 * unit(i + 1300)],
            })
            .collect();
        let color = [0.2, 0.5, 0.9];
        let mut all = white(whole);
        draw_dots(&dots, color, 0.7, &mut all, whole);
        assert!(all[0].iter().any(|light| *light < 0.05) && all[0].contains(&1.0));
        for part in [Rect { x0: 13, y0: 7, x1: 61, y1: 44 }, Rect { x0: 89, y0: 0, x1: 90, y1: 60 }, whole] {
            let mut planes = white(part);
            scalar_only(|| draw_dots(&dots, color, 0.7, &mut planes, part));
            for (all, plane) in all.iter().zip(&planes) {
                let all = Grid { width: 90, height: 60, data: all.clone() };
                assert_eq!(&all.crop(part).data, plane);
            }
        }
    }

    #[test]
    fn ink_over_ink_lets_through_the_product_and_clear_ink_changes_nothing() {
        let region = Rect::whole(9, 9);
        let dot = Dot { at_px: [4.5, 4.5], radius_px: [3.0, 3.0] };
        let mut planes = white(region).map(|plane| plane.iter().map(|light| light * 0.8).collect());
        draw_dots(&[dot, dot], [1.0, 0.5, 0.1], 0.0, &mut planes, region);
        assert!(planes[0].iter().all(|light| *light == 0.8));
        assert!((planes[1][40] - 0.2).abs() < 1e-6 && (planes[2][40] - 0.008).abs() < 1e-6);
        assert_eq!([planes[1][0], planes[2][8]], [0.8, 0.8]);
    }

    #[test]
    fn extremes_are_drawn_or_left_out_and_stay_finite() {
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0, 1e-40, 1e-6, 3.0, 1e6, 1e30, f32::MAX];
        for region in [Rect::whole(1, 1), Rect::whole(1, 64), Rect { x0: 5, y0: 5, x1: 5, y1: 9 }] {
            for (i, at) in odd.iter().enumerate() {
                for (j, radius) in odd.iter().enumerate() {
                    let (other, edge) = (odd[(i + j) % odd.len()], odd[(i * j) % odd.len()]);
                    let dot = Dot { at_px: [*at, 0.5], radius_px: [*radius, other] };
                    let cover = covered(dot, edge, region);
                    assert!(cover.iter().all(|cover| (0.0..=1.0).contains(cover)), "{dot:?} {edge} {cover:?}");
                    if !at.is_finite() {
                        assert!(cover.iter().all(|cover| *cover == 0.0));
                    }
                }
            }
        }
        let vast = Dot { at_px: [0.5, 20.0], radius_px: [1e5, 3e4] };
        assert!(covered(vast, 0.5, Rect::whole(1, 64)).iter().all(|cover| *cover == 1.0));
    }

    #[test]
    fn a_printed_grid_is_symmetric_and_covers_the_view_and_its_margin() {
        let dots = place_dot_grid([1.5; 2], [0.0; 2], 0.0, 1, [20.0, 15.0], 2.0);
        // 12 / 1.5 and 9.5 / 1.5 on each side.
        assert_eq!(dots.len(), 17 * 13);
        assert!(dots.iter().all(|[x, y]| dots.contains(&[-x, -y]) && dots.contains(&[-x, *y])));
        assert!(dots.contains(&[0.0, 0.0]) && dots.contains(&[12.0, -9.0]));
    }

    #[test]
    fn a_wider_view_keeps_the_dots_and_another_key_moves_them() {
        let jitter = 0.2;
        let grid = |key, view_mm, margin_mm| place_dot_grid([1.0; 2], [0.0; 2], jitter, key, view_mm, margin_mm);
        let (few, many) = (grid(7, [6.0, 4.0], 0.5), grid(7, [16.0, 9.0], 1.0));
        assert!(few.len() < many.len() && few.iter().all(|dot| many.contains(dot)));
        assert!(grid(8, [6.0, 4.0], 0.5).iter().all(|dot| !many.contains(dot)));
        let moves: Vec<f64> = many.iter().flatten().map(|mm| mm - mm.round()).collect();
        assert!(moves.iter().all(|mm| mm.abs() <= jitter));
        let count = moves.len() as f64;
        let mean = moves.iter().sum::<f64>() / count;
        let variance = moves.iter().map(|mm| mm * mm).sum::<f64>() / count;
        assert!(mean.abs() < 0.02, "{mean}");
        assert!((variance / (jitter * jitter / 3.0) - 1.0).abs() < 0.15, "{variance}");
    }

    #[test]
    fn no_numbers_make_a_grid_without_end() {
        let grid =
            |pitch, jitter, view_mm, margin_mm| place_dot_grid([pitch; 2], [0.0; 2], jitter, 0, view_mm, margin_mm);
        for pitch in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(grid(pitch, 0.1, [10.0, 10.0], 1.0).is_empty());
        }
        assert!(grid(1.0, f64::NAN, [10.0; 2], 1.0).is_empty() && grid(1.0, 0.0, [-5.0, 3.0], 1.0).is_empty());
        assert_eq!(grid(1e-300, 0.0, [1.0, 0.0], 0.0).len(), 2001);
        assert!(grid(1.0, 1.0, [0.0; 2], f64::INFINITY).iter().flatten().all(|mm| mm.is_finite()));
        assert!(place_dot_grid([1.0; 2], [f64::NAN, 0.0], 0.0, 0, [10.0; 2], 1.0).is_empty());
    }

    #[test]
    fn a_shifted_grid_covers_the_view_with_the_dots_of_one_that_is_wider() {
        for offset in [[0.3, -0.6], [-7.2, 4.0], [1e9, 0.0]] {
            let dots = place_dot_grid([1.5, 0.8], offset, 0.0, 1, [6.0, 4.0], 0.5);
            assert!(dots.iter().all(|[x, y]| (offset[0] > 1e6) == (x.abs() > 3.5) && y.abs() <= 2.5), "{offset:?}");
            let on_grid = |mm: f64, pitch: f64| (mm / pitch - libm::round(mm / pitch)).abs() < 1e-9;
            assert!(dots.iter().all(|[x, y]| on_grid(x - offset[0], 1.5) && on_grid(y - offset[1], 0.8)), "{offset:?}");
            // 7 mm and 5 mm hold four or five columns and six or seven rows.
            assert!(offset[0] > 1e6 || (24..=35).contains(&dots.len()), "{offset:?} {}", dots.len());
        }
    }
}
