//! Radial distortion: from a pixel of the picture to the place of the undistorted view that it shows.
//!
//! With r the distance from the middle of the image over half its diagonal, a pixel shows
//! middle + (pixel - middle) (1 + k1 r^2 + k2 r^4). This is the radial part of Brown's model (1971), in the form that
//! makes a picture without an inverse. k1 > 0 shrinks towards the rim (barrel), k1 < 0 stretches it (pincushion). Valid
//! while [`is_valid_distortion`] says so; decentring is left out. Points are in px from the top left corner: pixel
//! (i, j) has its centre at (i + 0.5, j + 0.5).

use crate::base::grid::{Grid, Rect};
use crate::base::simd::{simd_dispatch, split_fraction};

/// Radial distortion of a `width` x `height` picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Distortion that grows with the square of r; at the corners, where r is 1, it is this fraction of r.
    pub k1: f64,
    /// Distortion that grows with the fourth power of r.
    pub k2: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Largest r of the polynomial: a little beyond the corners, where r is 1. From there on it goes on straight, so that
/// every point of the plane has an image.
const LARGEST_R: f64 = 1.1;

/// Slope below which a lens counts as folding the picture.
const MIN_SLOPE: f64 = 0.05;

/// Returns true if the distortion folds nothing: its slope 1 + 3 k1 r^2 + 5 k2 r^4 is above 0.05 for r from 0 to 1.1.
pub fn is_valid_distortion(k1: f64, k2: f64) -> bool {
    let end = LARGEST_R * LARGEST_R;
    // Only a parabola that opens upwards can have its lowest value inside the range.
    let lowest = if k2 > 0.0 { (-0.3 * k1 / k2).clamp(0.0, end) } else { end };
    k1.is_finite() && k2.is_finite() && [lowest, end].iter().all(|square| radial_slope(k1, k2, *square) > MIN_SLOPE)
}

/// Returns how fast the place that a pixel shows moves outwards with the pixel; `square` is r^2.
fn radial_slope(k1: f64, k2: f64, square: f64) -> f64 {
    1.0 + square * (3.0 * k1 + square * (5.0 * k2))
}

impl Lens {
    /// Returns the point of the undistorted view that the point `pixel` of the picture shows.
    #[cfg(test)]
    pub(crate) fn source(&self, pixel: [f64; 2]) -> [f64; 2] {
        self.rescale_radius(pixel, |r| self.undistorted_radius(r))
    }

    /// Returns where the picture shows the point `point` of the undistorted view.
    pub(crate) fn distort_point(&self, point: [f64; 2]) -> [f64; 2] {
        self.rescale_radius(point, |r| self.distorted_radius(r))
    }

    /// Moves `point` along the ray from the middle so that its r becomes `radius(r)`.
    fn rescale_radius(&self, point: [f64; 2], radius: impl Fn(f64) -> f64) -> [f64; 2] {
        let middle = self.centre_px();
        let [x, y] = [point[0] - middle[0], point[1] - middle[1]];
        let r = libm::hypot(x, y) / self.half_diagonal();
        let scale = if r > 0.0 { radius(r) / r } else { 1.0 };
        [middle[0] + x * scale, middle[1] + y * scale]
    }

    fn centre_px(&self) -> [f64; 2] {
        [self.width as f64 / 2.0, self.height as f64 / 2.0]
    }

    /// Returns half the diagonal, px; 1 for an image without pixels.
    fn half_diagonal(&self) -> f64 {
        let [x, y] = self.centre_px();
        if x + y > 0.0 { libm::hypot(x, y) } else { 1.0 }
    }

    /// Returns the r in the undistorted view of what the picture shows at `r`.
    fn undistorted_radius(&self, r: f64) -> f64 {
        let inside = r.min(LARGEST_R);
        let square = inside * inside;
        inside * (1.0 + square * (self.k1 + square * self.k2)) + (r - inside) * radial_slope(self.k1, self.k2, square)
    }

    /// Returns the r at which the picture shows what is at `target` in the undistorted view.
    fn distorted_radius(&self, target: f64) -> f64 {
        let end = self.undistorted_radius(LARGEST_R);
        if target >= end {
            return LARGEST_R + (target - end) / (self.undistorted_radius(LARGEST_R + 1.0) - end);
        }
        // Newton's method; bisection where a step would leave the bracket.
        let (mut low, mut high, mut r) = (0.0, LARGEST_R, target.min(LARGEST_R));
        for _ in 0..60 {
            let error = self.undistorted_radius(r) - target;
            if error < 0.0 {
                low = r;
            } else {
                high = r;
            }
            let next = r - error / radial_slope(self.k1, self.k2, r * r);
            let next = if (low..=high).contains(&next) { next } else { 0.5 * (low + high) };
            if next == r {
                break;
            }
            r = next;
        }
        r
    }

    /// Returns how many columns and rows along the border are also seen mirrored, because pixels look beyond it; 0 if
    /// none does.
    pub(crate) fn mirrored_border_px(&self) -> [f64; 2] {
        let stretch = |square: f64| square * (self.k1 + square * self.k2);
        // A parabola is highest at its end or at its vertex.
        let turn = (-0.5 * self.k1 / self.k2).clamp(0.0, 1.0);
        let most = stretch(1.0).max(stretch(if turn.is_nan() { 0.0 } else { turn }));
        // A place between two pixels shows both.
        let reach = |size: usize| if most > 0.0 { 0.5 * size as f64 * most + 1.0 } else { 0.0 };
        [reach(self.width), reach(self.height)]
    }

    /// Returns the pixels of the picture that can show anything of `rect`, a part of the undistorted view, and perhaps
    /// a few more; an empty rectangle if there are none.
    pub(crate) fn image_rect_of(&self, rect: Rect) -> Rect {
        if rect.is_empty() {
            return Rect::default();
        }
        // A pixel mixes the four pixels around the place that it shows, so each of them is seen up to one pixel from
        // its centre.
        let [x, y] = self.centre_px();
        let (left, right) = (rect.x0 as f64 - 1.0 - x, rect.x1 as f64 + 1.0 - x);
        let (top, bottom) = (rect.y0 as f64 - 1.0 - y, rect.y1 as f64 + 1.0 - y);
        // The map along each axis rises with that coordinate, so nothing lies further out than the image of an edge.
        let first = |edge: f64| libm::floor(edge - 0.5);
        let last = |edge: f64| libm::ceil(edge - 0.5) + 1.0;
        let columns = [
            first(x + self.distorted_edge_range(left, top, bottom)[0]),
            last(x + self.distorted_edge_range(right, top, bottom)[1]),
        ];
        let rows = [
            first(y + self.distorted_edge_range(top, left, right)[0]),
            last(y + self.distorted_edge_range(bottom, left, right)[1]),
        ];
        let [x0, x1] = columns.map(|at| (at.max(0.0) as usize).min(self.width));
        let [y0, y1] = rows.map(|at| (at.max(0.0) as usize).min(self.height));
        if x0 < x1 && y0 < y1 { Rect { x0, y0, x1, y1 } } else { Rect::default() }
    }

    /// Returns the range in which the picture shows an edge: it is `at` px from the middle, and runs from `from` to
    /// `to` along the other axis.
    fn distorted_edge_range(&self, at: f64, from: f64, to: f64) -> [f64; 2] {
        let nearest = 0.0_f64.clamp(from, to);
        let furthest = from.abs().max(to.abs());
        let radii =
            [nearest, furthest].map(|along| self.distorted_radius(libm::hypot(at, along) / self.half_diagonal()));
        // How much nearer to the middle a point comes depends on r alone, and has its extremes at these two and at the
        // ends.
        let turns = [libm::sqrt((-0.5 * self.k1 / self.k2).max(0.0)), LARGEST_R];
        let [first, second] = turns.map(|r| r.max(radii[0]).min(radii[1]));
        let places = [radii[0], first, second, radii[1]];
        let places = places.map(|r| if r > 0.0 { at * r / self.undistorted_radius(r) } else { at });
        [places.into_iter().fold(f64::INFINITY, f64::min), places.into_iter().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Warps light `from`, known on the part `source` of the undistorted view and 0 outside it, and returns the part
    /// `target` of the picture; bilinear.
    pub(crate) fn warp_region(&self, from: &[Vec<f32>; 3], source: Rect, target: Rect) -> [Vec<f32>; 3] {
        let pixels = PaddedPixels::new(from, source);
        let mut planes = [(); 3].map(|()| vec![0.0; target.area()]);
        let mut line = SourceRow::new(target.width());
        simd_dispatch(
            #[inline(always)]
            || {
                for (row, y) in (target.y0..target.y1).enumerate() {
                    self.locate_source_row(target.x0, y, &mut line);
                    let row = row * target.width()..(row + 1) * target.width();
                    pixels.sample_row(&mut line, planes.each_mut().map(|plane| &mut plane[row.clone()]));
                }
            },
        );
        planes
    }

    /// Warps the light `from` of the entire undistorted view, mirrored at its edge, and returns the entire picture;
    /// bilinear.
    pub(crate) fn warp_whole(&self, from: &[Vec<f32>; 3]) -> [Vec<f32>; 3] {
        let whole = Rect::whole(self.width, self.height);
        let pixels = PaddedPixels::new(from, whole);
        let mut planes = [(); 3].map(|()| vec![0.0; whole.area()]);
        let mut line = SourceRow::new(self.width);
        let last = [self.width, self.height].map(|size| size.saturating_sub(1) as f32);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..self.height {
                    self.locate_source_row(0, y, &mut line);
                    for (x, y) in line.x.iter_mut().zip(&mut line.y) {
                        (*x, *y) = (mirror_coordinate(*x, last[0]), mirror_coordinate(*y, last[1]));
                    }
                    let row = y * self.width..(y + 1) * self.width;
                    pixels.sample_row(&mut line, planes.each_mut().map(|plane| &mut plane[row.clone()]));
                }
            },
        );
        planes
    }

    /// Returns a layer of the undistorted view as the picture shows it; bilinear, mirrored at its edge. The layer has
    /// the lens's size.
    pub fn warp_plane(&self, from: &Grid<f32>) -> Grid<f32> {
        let last = [from.width, from.height].map(|size| size.saturating_sub(1) as f32);
        self.map_pixels(from, |x, y| {
            let (x, y) = (mirror_coordinate(x, last[0]), mirror_coordinate(y, last[1]));
            let (column, row) = (x as usize, y as usize);
            let (next, below) = ((column + 1).min(from.width - 1), (row + 1).min(from.height - 1));
            let (u, v) = (x - column as f32, y - row as f32);
            let upper = lerp(from.at(column, row), from.at(next, row), u);
            lerp(upper, lerp(from.at(column, below), from.at(next, below), u), v)
        })
    }

    /// Returns a mask of the undistorted view as the picture shows it: the nearest pixel's value, 0 outside its edge.
    /// The mask has the lens's size.
    pub fn warp_mask(&self, from: &Grid<u8>) -> Grid<u8> {
        self.map_pixels(from, |x, y| sample_nearest(from, x, y))
    }

    /// Returns the smallest rectangle around the picture's pixels that show a marked pixel of `mask`, as in
    /// [`Lens::warp_mask`]; all marked pixels lie in `part`.
    pub fn box_of(&self, mask: &Grid<u8>, part: Rect) -> Rect {
        let target = self.image_rect_of(part);
        let mut line = SourceRow::new(target.width());
        let mut seen = Rect::default();
        for y in target.y0..target.y1 {
            simd_dispatch(
                #[inline(always)]
                || self.locate_source_row(target.x0, y, &mut line),
            );
            let shows = |k: &usize| sample_nearest(mask, line.x[*k], line.y[*k]) > 0;
            if let Some(first) = (0..target.width()).find(shows) {
                let last = (first..target.width()).rev().find(shows).unwrap_or(first);
                seen = seen.union(Rect { x0: target.x0 + first, y0: y, x1: target.x0 + last + 1, y1: y + 1 });
            }
        }
        seen
    }

    /// Returns the picture whose pixels are `value` at the places that they show: column and row of `from`.
    fn map_pixels<T: Copy + Default>(&self, from: &Grid<T>, value: impl Fn(f32, f32) -> T) -> Grid<T> {
        let mut layer = Grid::new(self.width, self.height);
        let mut line = SourceRow::new(self.width);
        if from.data.is_empty() {
            return layer;
        }
        for y in 0..self.height {
            self.locate_source_row(0, y, &mut line);
            for ((pixel, x), y) in layer.row_mut(y).iter_mut().zip(&line.x).zip(&line.y) {
                *pixel = value(*x, *y);
            }
        }
        layer
    }

    /// Finds what the pixels of row `y` show, from column `x0` on: columns and rows of the undistorted view.
    #[inline(always)]
    fn locate_source_row(&self, x0: usize, y: usize, line: &mut SourceRow) {
        let middle = self.centre_px().map(|middle| middle as f32 - 0.5);
        let share = (1.0 / (self.half_diagonal() * self.half_diagonal())) as f32;
        let (k1, k2) = (self.k1 as f32, self.k2 as f32);
        let down = y as f32 - middle[1];
        for ((x, y), column) in line.x.iter_mut().zip(&mut line.y).zip(x0 as u32..) {
            // By way of `i32`: vectors of most processors convert only signed integers.
            let right = column as i32 as f32 - middle[0];
            let square = (right * right + down * down) * share;
            let scale = 1.0 + square * (k1 + square * k2);
            *x = middle[0] + right * scale;
            *y = middle[1] + down * scale;
        }
    }
}

/// Returns the value of the pixel around a place, 0 where there is none.
#[inline(always)]
fn sample_nearest(mask: &Grid<u8>, x: f32, y: f32) -> u8 {
    let [x, y] = [x + 0.5, y + 0.5];
    let inside = x >= 0.0 && y >= 0.0 && x < mask.width as f32 && y < mask.height as f32;
    if inside { mask.at(x as usize, y as usize) } else { 0 }
}

/// Mirrors a place into the range from 0 to `last`; it may lie up to as far outside it.
#[inline(always)]
fn mirror_coordinate(at: f32, last: f32) -> f32 {
    let (at, excess) = (at.abs(), (at.abs() - last).max(0.0));
    // Places within the range are not touched by rounding.
    (at - 2.0 * excess).max(0.0).min(last)
}

/// The places that a row of pixels shows.
struct SourceRow {
    x: Vec<f32>,
    y: Vec<f32>,
    /// The upper left of the four pixels around each place.
    cell: Vec<u32>,
    /// The mixture of these four; the fourth colour fills a vector.
    pixels: Vec<[f32; 4]>,
}

impl SourceRow {
    fn new(width: usize) -> Self {
        Self { x: vec![0.0; width], y: vec![0.0; width], cell: vec![0; width], pixels: vec![[0.0; 4]; width] }
    }
}

/// Light with the colours of a pixel side by side, so that one load gets them all. A frame of zeros surrounds it: one
/// pixel at the left and top, two at the right and bottom.
struct PaddedPixels {
    source: Rect,
    stride: usize,
    pixels: Vec<[f32; 4]>,
}

impl PaddedPixels {
    fn new(from: &[Vec<f32>; 3], source: Rect) -> Self {
        let (width, height) = (source.width(), source.height());
        let stride = width + 3;
        let mut pixels = vec![[0.0; 4]; stride * (height + 3)];
        for y in 0..height {
            let [red, green, blue] = from.each_ref().map(|plane| &plane[y * width..][..width]);
            let out = &mut pixels[(y + 1) * stride + 1..][..width];
            for (((pixel, red), green), blue) in out.iter_mut().zip(red).zip(green).zip(blue) {
                *pixel = [*red, *green, *blue, 0.0];
            }
        }
        Self { source, stride, pixels }
    }

    /// Writes what `line` shows to a row of each plane; `line` keeps the fractions between pixels.
    #[inline(always)]
    fn sample_row(&self, line: &mut SourceRow, [red, green, blue]: [&mut [f32]; 3]) {
        let Rect { x0, y0, x1, y1 } = self.source;
        let (start, stride) = ([x0 as u32, y0 as u32], self.stride as u32);
        let ([left, top], [right, bottom]) = ([x0, y0].map(|at| at as f32 - 1.0), [x1, y1].map(|at| at as f32));
        for ((x, y), cell) in line.x.iter_mut().zip(&mut line.y).zip(&mut line.cell) {
            // Counted from the corner of the view, so that rounding does not depend on the part that is known.
            let (column, across) = split_fraction(x.max(left).min(right) + 1.0);
            let (row, down) = split_fraction(y.max(top).min(bottom) + 1.0);
            *cell = (row - start[1]) * stride + column - start[0];
            (*x, *y) = (across, down);
        }
        let places = line.x.iter().zip(&line.y).zip(&line.cell);
        for (((x, y), cell), pixel) in places.zip(&mut line.pixels) {
            let upper = &self.pixels[*cell as usize..][..2];
            let lower = &self.pixels[*cell as usize + self.stride..][..2];
            *pixel = lerp_pixels(lerp_pixels(upper[0], upper[1], *x), lerp_pixels(lower[0], lower[1], *x), *y);
        }
        for (((pixel, red), green), blue) in line.pixels.iter().zip(red).zip(green).zip(blue) {
            [*red, *green, *blue, _] = *pixel;
        }
    }
}

/// Mixes two pixels, see [`lerp`].
#[inline(always)]
fn lerp_pixels(from: [f32; 4], to: [f32; 4], at: f32) -> [f32; 4] {
    std::array::from_fn(|k| lerp(from[k], to[k], at))
}

/// Interpolates between `from` at 0 and `to` at 1; exactly `from` at 0.
#[inline(always)]
fn lerp(from: f32, to: f32, at: f32) -> f32 {
    from + (to - from) * at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::grid::bounding_box;
    use crate::base::simd::scalar_only;

    const LENSES: [[f64; 2]; 8] =
        [[0.0, 0.0], [0.15, 0.02], [-0.2, 0.0], [-0.1, -0.05], [0.4, -0.3], [-0.24, 0.1], [2.0, 1.0], [1e-9, -1e-9]];

    fn lenses(width: usize, height: usize) -> impl Iterator<Item = Lens> {
        LENSES.into_iter().map(move |[k1, k2]| Lens { k1, k2, width, height })
    }

    /// Uneven light, 0 to 1.
    fn light(area: usize) -> [Vec<f32>; 3] {
        [1, 5, 11].map(|start| (start..start + area).map(|i| (i * 7919 % 1009) as f32 / 1009.0).collect())
    }

    fn bits(planes: &[Vec<f32>; 3]) -> Vec<u32> {
        planes.iter().flatten().map(|value| value.to_bits()).collect()
    }

    /// Light of `from` at a point of the view, in f64.
    fn oracle(from: &[f32], source: Rect, [x, y]: [f64; 2]) -> f64 {
        let (x, y) = (x - 0.5 - source.x0 as f64, y - 0.5 - source.y0 as f64);
        let at = |column: f64, row: f64| {
            let inside = column >= 0.0 && row >= 0.0 && column < source.width() as f64 && row < source.height() as f64;
            if inside { f64::from(from[row as usize * source.width() + column as usize]) } else { 0.0 }
        };
        let (left, top) = (x.floor(), y.floor());
        let upper = at(left, top) * (left + 1.0 - x) + at(left + 1.0, top) * (x - left);
        let lower = at(left, top + 1.0) * (left + 1.0 - x) + at(left + 1.0, top + 1.0) * (x - left);
        upper * (top + 1.0 - y) + lower * (y - top)
    }

    #[test]
    fn valid_lenses_are_those_whose_slope_stays_up_everywhere() {
        for i in -40..=40 {
            for j in -40..=40 {
                // Off the grid on which the bound is met exactly.
                let (k1, k2) = (f64::from(i) * 0.0501, f64::from(j) * 0.0503);
                let slope = |r: f64| 1.0 + 3.0 * k1 * r * r + 5.0 * k2 * r.powi(4);
                let lowest = (0..=11_000).step_by(11).map(|step| slope(f64::from(step) * 1e-4)).fold(1.0, f64::min);
                if (lowest - 0.05).abs() > 1e-5 {
                    assert_eq!(is_valid_distortion(k1, k2), lowest > 0.05, "{k1} {k2} {lowest}");
                }
            }
        }
        assert!(LENSES.iter().all(|[k1, k2]| is_valid_distortion(*k1, *k2)));
        for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, -1e300] {
            assert!(!is_valid_distortion(bad, 0.0) && !is_valid_distortion(0.0, bad));
        }
    }

    #[test]
    fn the_image_of_what_a_pixel_shows_is_the_pixel() {
        for (width, height) in [(640, 480), (1, 1), (1, 640), (3, 2)] {
            for lens in lenses(width, height) {
                let mut last = [f64::NEG_INFINITY; 2];
                for step in -200..=1200 {
                    let share = f64::from(step) * 1e-3;
                    let pixel = [share * width as f64, (0.1 + 0.8 * share) * height as f64];
                    let point = lens.source(pixel);
                    let back = lens.distort_point(point);
                    assert!((0..2).all(|axis| (back[axis] - pixel[axis]).abs() < 1e-6), "{lens:?} {pixel:?} {back:?}");
                    assert!(point[0] > last[0] && point[1] > last[1], "folded: {lens:?} {pixel:?}");
                    last = point;
                }
                let middle = [width as f64 / 2.0, height as f64 / 2.0];
                assert_eq!((lens.source(middle), lens.distort_point(middle)), (middle, middle));
                if lens.k1 == 0.0 {
                    assert_eq!(lens.distort_point([0.3, 0.7]), lens.source([0.3, 0.7]));
                }
            }
        }
        let corner = Lens { k1: 0.15, k2: 0.02, width: 640, height: 480 }.source([640.0, 0.0]);
        assert!((corner[0] - (320.0 + 320.0 * 1.17)).abs() < 1e-9 && (corner[1] - (240.0 - 240.0 * 1.17)).abs() < 1e-9);
    }

    #[test]
    fn a_straight_line_bulges_outwards_if_k1_is_positive_and_inwards_if_it_is_negative() {
        for (k1, outwards) in [(0.1, true), (-0.1, false)] {
            let lens = Lens { k1, k2: 0.0, width: 200, height: 150 };
            let mut line = Grid::<f32>::new(200, 150);
            (0..150).for_each(|y| line.row_mut(y)[40] = 1.0);
            let picture = lens.warp_plane(&line);
            let place = |y: usize| {
                let row = picture.row(y);
                row.iter().enumerate().map(|(x, v)| x as f32 * v).sum::<f32>() / row.iter().sum::<f32>()
            };
            assert_eq!(place(75) < place(10) - 1.0, outwards, "{k1}: {} {}", place(75), place(10));
            assert!((place(10) - place(139)).abs() < 0.01);
            for y in 5..145 {
                // Sums over a row weigh the line's flanks unevenly where it leans.
                let expected = lens.distort_point([40.5, lens.source([place(y).into(), y as f64 + 0.5])[1]])[0] - 0.5;
                assert!((f64::from(place(y)) - expected).abs() < 0.1, "{y}: {} {expected}", place(y));
            }
        }
    }

    #[test]
    fn warping_agrees_with_the_sum_as_written() {
        let source = Rect { x0: 11, y0: 7, x1: 90, y1: 71 };
        let from = light(source.area());
        for lens in lenses(97, 73) {
            let target = Rect { x0: 3, y0: 0, x1: 97, y1: 70 };
            let planes = lens.warp_region(&from, source, target);
            for (plane, from) in planes.iter().zip(&from) {
                for (i, value) in plane.iter().enumerate() {
                    let pixel =
                        [i % target.width() + target.x0, i / target.width() + target.y0].map(|at| at as f64 + 0.5);
                    let expected = oracle(from, source, lens.source(pixel));
                    assert!((f64::from(*value) - expected).abs() < 1e-4, "{lens:?} {pixel:?}: {value} {expected}");
                }
            }
            let again = scalar_only(|| lens.warp_region(&from, source, target));
            assert_eq!(bits(&planes), bits(&again));
            let whole = Rect::whole(97, 73);
            let padded = from.each_ref().map(|from| {
                let mut plane = Grid::new(97, 73);
                plane.paste(
                    &Grid { width: source.width(), height: source.height(), data: from.clone() },
                    source,
                    whole,
                );
                plane.data
            });
            assert_eq!(planes, lens.warp_region(&padded, whole, target));
        }
    }

    #[test]
    fn a_lens_without_distortion_changes_no_bit() {
        for (width, height) in [(640, 480), (1, 1), (1, 640), (77, 5)] {
            let lens = Lens { k1: 0.0, k2: 0.0, width, height };
            let whole = Rect::whole(width, height);
            let from = light(whole.area());
            assert_eq!(bits(&lens.warp_region(&from, whole, whole)), bits(&from));
            let plane = Grid { width, height, data: from[1].clone() };
            assert_eq!(lens.warp_plane(&plane), plane);
            let mask = Grid { width, height, data: from[0].iter().map(|v| u8::from(*v > 0.3) * 255).collect() };
            assert_eq!(lens.warp_mask(&mask), mask);
        }
    }

    #[test]
    fn the_image_of_a_rectangle_holds_all_that_shows_it_and_little_more() {
        let (width, height) = (120, 90);
        let whole = Rect::whole(width, height);
        for lens in lenses(width, height) {
            for i in 0..60 {
                let (x0, y0) = (i * 37 % 119, i * 53 % 89);
                let source = Rect { x0, y0, x1: x0 + 1 + i * 11 % (120 - x0), y1: y0 + 1 + i * 29 % (90 - y0) };
                let planes = lens.warp_region(&[(); 3].map(|()| vec![1.0; source.area()]), source, whole);
                let seen =
                    crate::base::grid::bounding_box(&Grid { width, height, data: planes[0].clone() }, |v| v > 0.0);
                let found = lens.image_rect_of(source);
                assert_eq!(found.union(seen), found, "{lens:?} {source:?} {seen:?}");
                let corners =
                    [[source.x0, source.y0], [source.x1, source.y0], [source.x0, source.y1], [source.x1, source.y1]];
                let inside = corners.map(|corner| lens.distort_point(corner.map(|at| at as f64)));
                if !seen.is_empty() && inside.iter().all(|[x, y]| (0.0..=120.0).contains(x) && (0.0..=90.0).contains(y))
                {
                    let spare = seen.grown(4, width, height);
                    assert_eq!(found.union(spare), spare, "{lens:?} {source:?} {seen:?}");
                }
            }
            assert_eq!(lens.image_rect_of(Rect::default()), Rect::default());
        }
    }

    #[test]
    fn layers_are_mirrored_at_their_edge_and_masks_end_there() {
        for lens in lenses(60, 40) {
            let plane = Grid { width: 60, height: 40, data: vec![0.7_f32; 2400] };
            assert!(lens.warp_plane(&plane).data.iter().all(|value| (value - 0.7).abs() < 1e-6));
            let mut mask = Grid::<u8>::new(60, 40);
            (10..30).for_each(|y| mask.row_mut(y)[20..45].fill(255));
            let seen = lens.warp_mask(&mask);
            for (i, value) in seen.data.iter().enumerate() {
                let [x, y] = lens.source([(i % 60) as f64 + 0.5, (i / 60) as f64 + 0.5]);
                let edge = [x - 20.0, x - 45.0, y - 10.0, y - 30.0].into_iter().any(|away| away.abs() < 1e-3);
                let inside = (20.0..45.0).contains(&x) && (10.0..30.0).contains(&y);
                assert!(edge || (*value == 255) == inside, "{lens:?} {i}");
            }
        }
    }

    #[test]
    fn the_box_of_a_mask_is_that_of_its_picture() {
        for lens in lenses(60, 40) {
            for (x0, y0, x1, y1) in
                [(20, 10, 45, 30), (29, 19, 31, 21), (0, 5, 7, 40), (55, 0, 60, 3), (31, 22, 32, 23)]
            {
                let mut mask = Grid::<u8>::new(60, 40);
                (y0..y1).for_each(|y| mask.row_mut(y)[x0..x1].fill(255));
                let part = Rect { x0, y0, x1, y1 };
                let expected = bounding_box(&lens.warp_mask(&mask), |value| value > 0);
                assert_eq!(lens.box_of(&mask, part), expected, "{lens:?} {part:?}");
            }
            assert_eq!(lens.box_of(&Grid::new(60, 40), Rect::default()), Rect::default());
        }
    }

    #[test]
    fn extremes_neither_panic_nor_give_what_is_not_a_number() {
        let folded = [[-3.0, 0.0], [1e300, -1e300], [f64::NAN, 0.0], [0.0, f64::INFINITY]];
        for [k1, k2] in LENSES.into_iter().chain(folded) {
            for (width, height) in [(1, 1), (1, 64), (64, 1), (0, 0)] {
                let lens = Lens { k1, k2, width, height };
                let whole = Rect::whole(width, height);
                let from = light(whole.area());
                for (source, target) in [(whole, whole), (Rect::default(), whole), (whole, Rect::default())] {
                    let planes = lens.warp_region(&from, source, target);
                    assert_eq!(planes[2].len(), target.area());
                    assert!(planes.iter().flatten().all(|value| value.is_finite()), "{lens:?}");
                }
                let plane = lens.warp_plane(&Grid { width, height, data: from[0].clone() });
                assert!(plane.data.iter().all(|value| value.is_finite()), "{lens:?}");
                assert_eq!(lens.warp_mask(&Grid::new(0, 0)).data, vec![0; whole.area()]);
                assert!(lens.image_rect_of(whole).union(whole) == whole);
                lens.distort_point([1e30, -1e30]);
            }
        }
    }
}
