//! Values of nodes on a torus: between the nodes, and filtered.

use crate::base::cubic::catmull_rom;
use crate::base::grid::Grid;

/// Returns the whole node before a place on a torus, and how far the place is beyond it.
pub fn split(place: f32, count: usize) -> (usize, f32) {
    // A conversion rounds towards 0, and is quicker than rounding down.
    let towards_0 = place as isize;
    let below = if place < towards_0 as f32 { towards_0.saturating_sub(1) } else { towards_0 };
    (below.rem_euclid(count as isize) as usize, place - below as f32)
}

/// The sixteen nodes around a place on a torus, and their shares in a cubic (Catmull and Rom 1974).
pub struct TorusTaps {
    columns: [usize; 4],
    rows: [usize; 4],
    along: [f32; 4],
    down: [f32; 4],
}

impl TorusTaps {
    pub fn new(place: [f32; 2], [width, height]: [usize; 2]) -> Self {
        let ((x, t), (y, s)) = (split(place[0], width), split(place[1], height));
        let beside = |at: usize, count: usize| {
            if at >= 1 && at + 2 < count {
                [at - 1, at, at + 1, at + 2]
            } else {
                [count - 1, 0, 1, 2].map(|step| (at + step) % count)
            }
        };
        Self { columns: beside(x, width), rows: beside(y, height), along: catmull_rom(t), down: catmull_rom(s) }
    }

    pub fn sample(&self, field: &Grid<f32>) -> f32 {
        let mut sum = 0.0;
        for (y, share) in self.rows.iter().zip(self.down) {
            let row = field.row(*y);
            sum += share * (0..4).map(|k| row[self.columns[k]] * self.along[k]).sum::<f32>();
        }
        sum
    }
}

/// Applies a symmetric filter along x and y: `shares` of the values from half of its length before a node to as far
/// behind it.
pub fn filter(values: &Grid<f32>, shares: &[f32]) -> Grid<f32> {
    let Grid { width, height, .. } = *values;
    let reach = shares.len() / 2;
    let (mut along, mut filtered) = (Grid::<f32>::new(width, height), Grid::<f32>::new(width, height));
    for y in 0..height {
        let from = values.row(y);
        for (x, to) in along.row_mut(y).iter_mut().enumerate() {
            let first = x + reach * (width - 1);
            *to = shares.iter().enumerate().map(|(k, share)| share * from[(first + k) % width]).sum();
        }
    }
    for y in 0..height {
        let to = filtered.row_mut(y);
        for (k, share) in shares.iter().enumerate() {
            let from = along.row((y + reach * (height - 1) + k) % height);
            to.iter_mut().zip(from).for_each(|(to, from)| *to += share * from);
        }
    }
    filtered
}
