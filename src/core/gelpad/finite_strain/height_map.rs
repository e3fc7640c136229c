//! The object over the contact's grid, smooth enough to have a slope everywhere.

use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::simd_dispatch;

/// Samples of how far the object reaches below the undeformed surface, mm. Between them it is a quadratic B-spline, whose
/// slope is continuous and which does not overshoot.
pub struct HeightMap {
    heights_mm: Grid<f32>,
    spacing_mm: [f64; 2],
    /// Samples from one node of the contact's grid to the next.
    per_node: usize,
    /// The largest height of the places next to each node.
    highest_mm: Grid<f32>,
}

/// Height and slope of the object at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightAndSlope {
    pub height_mm: f32,
    pub slope: [f32; 2],
}

impl HeightAndSlope {
    /// Returns the unit normal that points into the object.
    pub fn normal(&self) -> [f32; 3] {
        let [a, b] = self.slope;
        let scale = 1.0 / (a * a + b * b + 1.0).sqrt();
        [a * scale, b * scale, scale]
    }
}

impl HeightMap {
    /// Takes samples `spacing_mm` apart, `per_node` of them from one node of the contact's grid to the next.
    pub fn new(heights_mm: Grid<f32>, spacing_mm: [f64; 2], per_node: usize) -> Self {
        let highest_mm = highest_beside(&heights_mm, per_node);
        Self { heights_mm, spacing_mm, per_node, highest_mm }
    }

    /// Returns a height that the object does not exceed at a place in nodes of the contact's grid.
    pub fn at_most_mm(&self, place: [f32; 2]) -> f32 {
        let Grid { width, height, .. } = self.highest_mm;
        let [x, y] = place.map(|at| (at.max(0.0) + 0.5) as usize);
        self.highest_mm.at(x.min(width - 1), y.min(height - 1))
    }

    /// Returns the object's height and slope at a place in nodes of the contact's grid; outside the map they are those
    /// at its border.
    pub fn at(&self, place: [f32; 2]) -> HeightAndSlope {
        let size = [self.heights_mm.width, self.heights_mm.height];
        let tap = |k: usize| {
            let place = (place[k] * self.per_node as f32).clamp(0.0, (size[k] - 1) as f32);
            let nearest = (place + 0.5) as usize;
            let t = place - nearest as f32;
            let weights = spline_shares(t);
            let slopes = [t - 0.5, -2.0 * t, t + 0.5];
            let places = [nearest.saturating_sub(1), nearest, (nearest + 1).min(size[k] - 1)];
            (places, weights, slopes)
        };
        let ((xs, x_weights, x_slopes), (ys, y_weights, y_slopes)) = (tap(0), tap(1));
        let (mut height_mm, mut slope) = (0.0, [0.0; 2]);
        for (y, (weight, rise)) in ys.into_iter().zip(y_weights.into_iter().zip(y_slopes)) {
            let row = self.heights_mm.row(y);
            let four = xs.map(|x| row[x]);
            let line: f32 = four.iter().zip(x_weights).map(|(value, weight)| value * weight).sum();
            let along: f32 = four.iter().zip(x_slopes).map(|(value, slope)| value * slope).sum();
            height_mm += weight * line;
            slope[0] += weight * along;
            slope[1] += rise * line;
        }
        let spacing = self.spacing_mm.map(|mm| mm as f32);
        HeightAndSlope { height_mm, slope: [slope[0] / spacing[0], slope[1] / spacing[1]] }
    }

    pub fn heights_mm(&self) -> &Grid<f32> {
        &self.heights_mm
    }
}

/// Returns the shares of three samples in a quadratic B-spline at a place `t`, -0.5 to 0.5, from the middle one.
pub fn spline_shares(t: f32) -> [f32; 3] {
    [0.5 * (0.5 - t) * (0.5 - t), 0.75 - t * t, 0.5 * (0.5 + t) * (0.5 + t)]
}

/// Returns the largest of the samples that [`HeightMap::at`] uses where a node is the nearest one, for each node.
fn highest_beside(samples: &Grid<f32>, per_node: usize) -> Grid<f32> {
    let nodes = [samples.width, samples.height].map(|count| count.div_ceil(per_node));
    // Half a node and one and a half samples to each side lie in these four cells, whose first samples are the nodes.
    let reach = |node: usize, count: usize| (node.saturating_sub(2) * per_node)..((node + 2) * per_node).min(count);
    let most = |values: &[f32]| values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut along = Grid::<f32>::new(nodes[0], samples.height);
    for y in 0..samples.height {
        let row = samples.row(y);
        for (x, to) in along.row_mut(y).iter_mut().enumerate() {
            *to = most(&row[reach(x, samples.width)]);
        }
    }
    let mut highest = Grid::<f32>::new(nodes[0], nodes[1]);
    highest.data.fill(f32::NEG_INFINITY);
    for y in 0..nodes[1] {
        for from in reach(y, samples.height) {
            for (to, value) in highest.row_mut(y).iter_mut().zip(along.row(from)) {
                *to = to.max(*value);
            }
        }
    }
    highest
}

/// Opens an object by a ball: what is left of it is all that a ball of this radius reaches from inside. Edges are
/// rounded, and what is thinner than the ball goes; the rest stays as it is.
pub fn open_by_ball(heights_mm: &Grid<f32>, spacing_mm: [f64; 2], radius_mm: f64) -> Grid<f32> {
    let reach = spacing_mm.map(|mm| (radius_mm / mm) as isize);
    let mut ball = Vec::new();
    for dy in -reach[1]..=reach[1] {
        for dx in -reach[0]..=reach[0] {
            let (x, y) = (dx as f64 * spacing_mm[0], dy as f64 * spacing_mm[1]);
            let square = radius_mm * radius_mm - x * x - y * y;
            if square >= 0.0 {
                ball.push(([dx, dy], (radius_mm - libm::sqrt(square)) as f32));
            }
        }
    }
    // Where there is nothing, nothing is left.
    let nothing = heights_mm.data.iter().copied().fold(f32::INFINITY, f32::min);
    let room = reach.map(|reach| reach as usize + 1);
    let whole = Rect::whole(heights_mm.width, heights_mm.height);
    let part = bounding_box(heights_mm, |height| height > nothing).grown(room[0].max(room[1]), whole.x1, whole.y1);
    let object = heights_mm.crop(part);
    let (width, height) = (object.width as isize, object.height as isize);
    // At each node the least of the heights around it, each with the height that a ball there has above its lowest point.
    let find_least = |from: &Grid<f32>| {
        let mut least = Grid::new(from.width, from.height);
        least.data.fill(f32::INFINITY);
        simd_dispatch(
            #[inline(always)]
            || {
                // One offset after the other over all rows, so that the inner loop is plain.
                for ([dx, dy], above) in &ball {
                    let columns = (-dx).max(0)..(width - dx).min(width);
                    for y in (-dy).max(0)..(height - dy).min(height) {
                        let source = from.row((y + dy) as usize);
                        let source = &source[(columns.start + dx) as usize..(columns.end + dx) as usize];
                        let target = &mut least.row_mut(y as usize)[columns.start as usize..columns.end as usize];
                        for (least, from) in target.iter_mut().zip(source) {
                            let here = from + above;
                            *least = if here < *least { here } else { *least };
                        }
                    }
                }
            },
        );
        least
    };
    let negate = |mut heights: Grid<f32>| {
        heights.data.iter_mut().for_each(|height| *height = -*height);
        heights
    };
    // The deepest that the ball's lowest point gets at each node, and then what the ball covers from there.
    let covered = negate(find_least(&negate(find_least(&object))));
    let mut opened = heights_mm.clone();
    opened.paste(&covered, part, whole);
    opened
}
