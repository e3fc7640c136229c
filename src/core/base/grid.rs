//! Row-major images and rectangles of pixels.

use serde::{Deserialize, Serialize};

use super::simd::{largest_value, simd_dispatch};

/// A row-major image. Row 0 is the top one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grid<T> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values.
    pub data: Vec<T>,
}

impl<T: Copy + Default> Grid<T> {
    /// Makes an image of default values (zeros).
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![T::default(); width * height] }
    }

    /// Resizes the image to `width` x `height` and sets every value to the default; allocated memory is reused.
    pub(crate) fn reset(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.data.clear();
        self.data.resize(width * height, T::default());
    }

    /// Resizes the image to `width` x `height`, reusing allocated memory; its values are unspecified.
    pub(crate) fn reshape(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.data.resize(width * height, T::default());
    }

    /// Returns one row.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..][..self.width]
    }

    /// Returns one row, mutable.
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.width..][..self.width]
    }

    /// Returns the value in column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> T {
        self.data[y * self.width + x]
    }

    /// Returns the part that is left when `border` pixels are removed on every side.
    pub fn inner(&self, border: usize) -> Self {
        self.crop(Rect { x0: border, y0: border, x1: self.width - border, y1: self.height - border })
    }

    /// Returns the part inside `rect`, which must lie within the image.
    pub fn crop(&self, rect: Rect) -> Self {
        let mut data = Vec::with_capacity(rect.area());
        for y in rect.y0..rect.y1 {
            data.extend_from_slice(&self.row(y)[rect.x0..rect.x1]);
        }
        Self { width: rect.width(), height: rect.height(), data }
    }

    /// Copies `other` into this image where the two overlap; `other_rect` and `own_rect` are the rectangles of a
    /// common image that `other` and this image show.
    pub(crate) fn paste(&mut self, other: &Self, other_rect: Rect, own_rect: Rect) {
        let both = Rect {
            x0: other_rect.x0.max(own_rect.x0),
            y0: other_rect.y0.max(own_rect.y0),
            x1: other_rect.x1.min(own_rect.x1),
            y1: other_rect.y1.min(own_rect.y1),
        };
        for y in both.y0..both.y1 {
            if both.x0 < both.x1 {
                let from = &other.row(y - other_rect.y0)[both.x0 - other_rect.x0..both.x1 - other_rect.x0];
                self.row_mut(y - own_rect.y0)[both.x0 - own_rect.x0..both.x1 - own_rect.x0].copy_from_slice(from);
            }
        }
    }
}

impl Grid<f32> {
    /// Applies `of` to all values and returns the largest result, 0 if none is above 0.
    pub fn largest(&self, of: impl Fn(f32) -> f32) -> f32 {
        simd_dispatch(
            #[inline(always)]
            || largest_value(self.data.iter().map(|value| of(*value))),
        )
    }

    /// Returns the largest value in a part of the grid, 0 if none is above 0.
    pub(crate) fn largest_in(&self, part: Rect) -> f32 {
        simd_dispatch(
            #[inline(always)]
            || {
                let rows = (part.y0..part.y1).map(|y| largest_value(self.row(y)[part.x0..part.x1].iter().copied()));
                largest_value(rows)
            },
        )
    }

    /// Returns the value in column `x`, row `y` of this image stretched to `width` x `height` pixels: bilinear between
    /// pixel centres, and constant beyond the outermost centres.
    pub(crate) fn sample_stretched(&self, x: usize, y: usize, width: usize, height: usize) -> f32 {
        let place = |at: usize, to: usize, own: usize| {
            let at = ((at as f64 + 0.5) * own as f64 / to as f64 - 0.5).clamp(0.0, own as f64 - 1.0);
            let whole = (at as usize).min(own.saturating_sub(2));
            (whole, (whole + 1).min(own - 1), (at - whole as f64) as f32)
        };
        let ((x0, x1, u), (y0, y1, v)) = (place(x, width, self.width), place(y, height, self.height));
        let above = self.at(x0, y0) * (1.0 - u) + self.at(x1, y0) * u;
        let below = self.at(x0, y1) * (1.0 - u) + self.at(x1, y1) * u;
        above * (1.0 - v) + below * v
    }
}

/// Half-open rectangle of pixels: columns `x0..x1`, rows `y0..y1`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// One past the last column.
    pub x1: usize,
    /// One past the last row.
    pub y1: usize,
}

impl Rect {
    /// Returns the rectangle of a complete `width` x `height` image.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { x0: 0, y0: 0, x1: width, y1: height }
    }

    /// Returns the number of columns.
    pub fn width(self) -> usize {
        self.x1 - self.x0
    }

    /// Returns the number of rows.
    pub fn height(self) -> usize {
        self.y1 - self.y0
    }

    /// Returns true if a pixel lies in the rectangle.
    pub(crate) fn contains(self, [x, y]: [usize; 2]) -> bool {
        (self.x0..self.x1).contains(&x) && (self.y0..self.y1).contains(&y)
    }

    /// Returns the number of pixels.
    pub fn area(self) -> usize {
        self.width() * self.height()
    }

    /// Returns true if the rectangle contains no pixel.
    pub fn is_empty(self) -> bool {
        self.area() == 0
    }

    /// Returns the rectangle grown by `by` pixels on every side and cut to a `width` x `height` image. An empty
    /// rectangle stays empty.
    pub fn grown(self, by: usize, width: usize, height: usize) -> Self {
        if self.is_empty() {
            return self;
        }
        Self {
            x0: self.x0.saturating_sub(by),
            y0: self.y0.saturating_sub(by),
            x1: (self.x1 + by).min(width),
            y1: (self.y1 + by).min(height),
        }
    }

    /// Returns the smallest rectangle that contains both; an empty one is ignored.
    pub(crate) fn union(self, other: Self) -> Self {
        match (self.is_empty(), other.is_empty()) {
            (true, _) => other,
            (_, true) => self,
            _ => Self {
                x0: self.x0.min(other.x0),
                y0: self.y0.min(other.y0),
                x1: self.x1.max(other.x1),
                y1: self.y1.max(other.y1),
            },
        }
    }

    /// Returns the part that both have in common; an empty one if there is none.
    pub(crate) fn intersection(self, other: Self) -> Self {
        let (x0, y0) = (self.x0.max(other.x0), self.y0.max(other.y0));
        let (x1, y1) = (self.x1.min(other.x1), self.y1.min(other.y1));
        if x0 >= x1 || y0 >= y1 { Self::default() } else { Self { x0, y0, x1, y1 } }
    }

    /// Returns the rectangle in the pixel coordinates of a window whose first pixel is (`left`, `top`) and whose size
    /// is `width` x `height`; the part outside the window is cut off.
    pub fn in_window(self, left: usize, top: usize, width: usize, height: usize) -> Self {
        let clamp = |at: usize, start: usize, size: usize| at.saturating_sub(start).min(size);
        let (x0, x1) = (clamp(self.x0, left, width), clamp(self.x1, left, width));
        let (y0, y1) = (clamp(self.y0, top, height), clamp(self.y1, top, height));
        if x0 == x1 || y0 == y1 { Self::default() } else { Self { x0, y0, x1, y1 } }
    }
}

/// Returns the smallest rectangle around the pixels for which `inside` holds; empty if there are none.
pub fn bounding_box<T: Copy + Default>(grid: &Grid<T>, inside: impl Fn(T) -> bool) -> Rect {
    // Flags per column instead of minima and maxima: the inner loop has no branches and vectorises.
    let mut columns = vec![0_u32; grid.width];
    let mut rows = 0..0;
    simd_dispatch(
        #[inline(always)]
        || {
            for y in 0..grid.height {
                let mut any = 0;
                for (column, value) in columns.iter_mut().zip(grid.row(y)) {
                    let is_inside = u32::from(inside(*value));
                    *column |= is_inside;
                    any |= is_inside;
                }
                if any != 0 {
                    rows = if rows.is_empty() { y..y + 1 } else { rows.start..y + 1 };
                }
            }
        },
    );
    let is_inside = |column: &u32| *column != 0;
    match (columns.iter().position(is_inside), columns.iter().rposition(is_inside)) {
        (Some(x0), Some(x1)) => Rect { x0, y0: rows.start, x1: x1 + 1, y1: rows.end },
        _ => Rect::default(),
    }
}

/// Resolution of a grid relative to the camera's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Resolution {
    /// Every pixel.
    Full,
    /// Every second pixel along x and y; in between the surface is interpolated.
    Half,
    /// Every fourth pixel; in between the surface is interpolated.
    Quarter,
}

impl Resolution {
    /// Returns the distance between neighbouring grid points, in camera pixels.
    pub fn factor(self) -> usize {
        match self {
            Self::Full => 1,
            Self::Half => 2,
            Self::Quarter => 4,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bounding_box_holds_exactly_the_marked_pixels() {
        let mut grid = Grid::<u8>::new(7, 5);
        assert_eq!(bounding_box(&grid, |v| v > 0), Rect::default());
        for (x, y) in [(2, 1), (5, 3), (4, 1)] {
            grid.row_mut(y)[x] = 1;
        }
        assert_eq!(bounding_box(&grid, |v| v > 0), Rect { x0: 2, y0: 1, x1: 6, y1: 4 });
        let corner = Rect { x0: 6, y0: 4, x1: 7, y1: 5 };
        assert_eq!(corner.grown(2, 7, 5), Rect { x0: 4, y0: 2, x1: 7, y1: 5 });
        assert_eq!(corner.in_window(1, 1, 4, 4), Rect::default());
        assert_eq!(corner.in_window(5, 1, 4, 4), Rect { x0: 1, y0: 3, x1: 2, y1: 4 });
    }
}
