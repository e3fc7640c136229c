//! Nodes that have moved with the rubber: which of them is at a place now, and their forces there.

use super::contact::ContactGrid;
use super::height_map::spline_shares;
use super::press::RubberPress;
use super::torus::{TorusTaps, filter, split};
use crate::base::grid::Grid;

/// The nodes of the contact's grid, and where they have gone.
pub struct MovedNodes {
    /// Motion along x and y, and height, mm.
    pub moved: [Grid<f32>; 3],
    pub spacing_mm: [f32; 2],
}

/// Largest distance between a place and where its node goes, nodes.
const PLACE_TOLERANCE: f32 = 1e-4;

/// Most iterations for a place.
const MOST: u32 = 60;

impl MovedNodes {
    pub fn new(grid: &ContactGrid, press: &RubberPress) -> Self {
        let [width, height] = grid.transform.size();
        Self {
            moved: press.surface.clone().map(|data| Grid { width, height, data }),
            spacing_mm: grid.spacing_mm.map(|mm| mm as f32),
        }
    }

    pub fn size(&self) -> [usize; 2] {
        [self.moved[2].width, self.moved[2].height]
    }

    /// Finds the node, between nodes, that has moved to a place.
    pub fn find(&self, place: [f32; 2], guess: [f32; 2]) -> [f32; 2] {
        let mut node = guess;
        let (mut last, mut share) = (f32::INFINITY, 1.0_f32);
        for _ in 0..MOST {
            let taps = TorusTaps::new(node, self.size());
            let moved = |k: usize| taps.sample(&self.moved[k]) / self.spacing_mm[k];
            let off: [f32; 2] = std::array::from_fn(|k| place[k] - node[k] - moved(k));
            let distance = off[0].abs().max(off[1].abs());
            if distance < PLACE_TOLERANCE {
                break;
            }
            // Where the surface is compressed strongly, whole steps go back and forth.
            if distance > 0.9 * last {
                share = (0.5 * share).max(0.1);
            }
            last = distance;
            node = [0, 1].map(|k| node[k] + share * off[k]);
        }
        node
    }

    /// Returns the height of a node between nodes, mm.
    pub fn height_mm(&self, node: [f32; 2]) -> f32 {
        TorusTaps::new(node, self.size()).sample(&self.moved[2])
    }

    /// Returns the nodes' vertical forces where the nodes have gone, as forces on the nodes of the undeformed grid.
    ///
    /// No force is lost: each is shared among nine nodes by a quadratic B-spline. The blur of that is taken back, so that
    /// a node which has not moved keeps its force.
    pub fn forces_at_places(&self, force: &[f32]) -> Vec<f32> {
        let [width, height] = self.size();
        let tap = |place: f32, count: usize| {
            let (nearest, t) = split(place + 0.5, count);
            ([count - 1, 0, 1].map(|step| (nearest + step) % count), spline_shares(t - 0.5))
        };
        let place = |k: usize, at: usize| self.moved[k].data[at] / self.spacing_mm[k];
        let mut blurred = Grid::<f32>::new(width, height);
        for (at, force) in force.iter().enumerate().filter(|(_, force)| **force != 0.0) {
            let (xs, x_shares) = tap((at % width) as f32 + place(0, at), width);
            let (ys, y_shares) = tap((at / width) as f32 + place(1, at), height);
            for (y, down) in ys.into_iter().zip(y_shares) {
                for (x, along) in xs.into_iter().zip(x_shares) {
                    blurred.row_mut(y)[x] += down * along * force;
                }
            }
        }
        filter(&blurred, &inverse_of_spline()).data
    }
}

/// Returns the filter that undoes a quadratic B-spline's blur of nodes, 1/8, 3/4, 1/8 (Unser, Aldroubi and Eden 1993).
fn inverse_of_spline() -> Vec<f32> {
    const REACH: usize = 6;
    let pole = 2.0 * std::f32::consts::SQRT_2 - 3.0;
    let shares: Vec<f32> = (0..=2 * REACH).map(|k| pole.powi(k.abs_diff(REACH) as i32)).collect();
    let sum: f32 = shares.iter().sum();
    shares.iter().map(|share| share / sum).collect()
}
