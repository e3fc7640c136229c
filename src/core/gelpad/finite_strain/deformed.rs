//! From nodes that move with the rubber to places on the deformed surface.
//!
//! The solver knows where each node of the surface goes; images, pressures and the linear layer are functions of the
//! place. The node that is now at a place x is X with X + u(X) = x.

use super::contact::{ContactGrid, Field};
use super::press::RubberPress;
use crate::base::cubic::catmull_rom;
use crate::base::grid::Grid;

/// The deformed surface, and how it differs from that of a linear layer under the same pressure.
pub struct DeformedSurface {
    /// Rubber minus linear layer: displacement into the pad, mm.
    pub difference_mm: Grid<f32>,
    /// Rubber minus linear layer: motion of the surface's points along x and y, mm.
    pub motion_mm: [Grid<f32>; 2],
}

/// Largest distance between a place and where its node goes, nodes.
const PLACE_TOLERANCE: f32 = 1e-3;

/// Most iterations for a place.
const MOST: u32 = 60;

/// Share of the torus's half width over which the difference goes to 0 at its border.
const TAPER: f64 = 0.2;

impl DeformedSurface {
    /// Returns true if every number is finite.
    pub fn is_finite(&self) -> bool {
        let [x, y] = &self.motion_mm;
        [&self.difference_mm, x, y].iter().all(|grid| grid.data.iter().all(|value| value.is_finite()))
    }

    /// Takes a solution to places, and subtracts the linear layer under its pressure on the same torus.
    pub fn new(grid: &mut ContactGrid, press: &RubberPress) -> Self {
        let [width, height] = grid.transform.size();
        let [dx, dy] = grid.spacing_mm.map(|mm| mm as f32);
        let of_nodes = |data: &Vec<f32>| Grid { width, height, data: data.clone() };
        let [along_x, along_y, up] = [0, 1, 2].map(|c| of_nodes(&press.surface[c]));
        // Vertical force per area of the deformed surface, seen from above.
        let mut force = Grid::<f32>::new(width, height);
        for y in 0..height {
            let (above, below) = ((y + height - 1) % height, (y + 1) % height);
            for x in 0..width {
                let at = y * width + x;
                if press.force[2][at] == 0.0 {
                    continue;
                }
                let (left, right) = ((x + width - 1) % width, (x + 1) % width);
                let slope = |of: &Grid<f32>| {
                    [0.5 * (of.at(right, y) - of.at(left, y)) / dx, 0.5 * (of.at(x, below) - of.at(x, above)) / dy]
                };
                let ([xx, xy], [yx, yy]) = (slope(&along_x), slope(&along_y));
                let stretch = (1.0 + xx) * (1.0 + yy) - xy * yx;
                force.data[at] = press.force[2][at] / stretch.max(0.1);
            }
        }
        let mut at_place: Field = grid.zeros();
        let mut surface = Grid::<f32>::new(width, height);
        for y in 0..height {
            for x in 0..width {
                let at = y * width + x;
                let node = find_node([x, y], [&along_x, &along_y], [dx, dy]);
                surface.data[at] = sample_cubic(&up, node);
                at_place[2][at] = sample_linear(&force, node).min(0.0);
            }
        }
        let mut linear: Field = grid.zeros();
        grid.displace(&at_place, &mut linear);
        let taper = |at: usize, count: usize| {
            let beside = 1.0 - (2.0 * at as f64 / count as f64 - 1.0).abs();
            let t = (beside / TAPER).min(1.0);
            (t * t * (3.0 - 2.0 * t)) as f32
        };
        let columns: Vec<f32> = (0..width).map(|x| taper(x, width)).collect();
        let rows: Vec<f32> = (0..height).map(|y| taper(y, height)).collect();
        let difference = |rubber: &[f32], linear: &[f32], sign: f32| {
            let mut grid = Grid::<f32>::new(width, height);
            for (at, value) in grid.data.iter_mut().enumerate() {
                *value = sign * (rubber[at] - linear[at]) * columns[at % width] * rows[at / width];
            }
            grid
        };
        Self {
            difference_mm: difference(&surface.data, &linear[2], -1.0),
            motion_mm: [0, 1].map(|c| difference(&press.surface[c], &linear[c], 1.0)),
        }
    }
}

/// Finds the node, between nodes, that has moved to a place.
fn find_node(place: [usize; 2], moved: [&Grid<f32>; 2], spacing: [f32; 2]) -> [f32; 2] {
    let place = place.map(|at| at as f32);
    let mut node = place;
    let (mut last, mut share) = (f32::INFINITY, 1.0_f32);
    for _ in 0..MOST {
        let off: [f32; 2] = std::array::from_fn(|k| place[k] - node[k] - sample_cubic(moved[k], node) / spacing[k]);
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

/// Returns the whole node before a place on a torus, and how far the place is beyond it.
fn split(place: f32, count: usize) -> (usize, f32) {
    let below = place.floor();
    ((below as isize).rem_euclid(count as isize) as usize, place - below)
}

/// Samples a field on the torus by cubics (Catmull and Rom 1974).
fn sample_cubic(field: &Grid<f32>, place: [f32; 2]) -> f32 {
    let ((x, t), (y, s)) = (split(place[0], field.width), split(place[1], field.height));
    let (along, down) = (catmull_rom(t), catmull_rom(s));
    let mut sum = 0.0;
    for (k, share) in down.iter().enumerate() {
        let row = field.row((y + field.height + k - 1) % field.height);
        let line: f32 = if x >= 1 && x + 2 < field.width {
            row[x - 1..x + 3].iter().zip(along).map(|(value, share)| value * share).sum()
        } else {
            (0..4).map(|j| row[(x + field.width + j - 1) % field.width] * along[j]).sum()
        };
        sum += share * line;
    }
    sum
}

/// Samples a field on the torus by straight lines.
fn sample_linear(field: &Grid<f32>, place: [f32; 2]) -> f32 {
    let ((x, t), (y, s)) = (split(place[0], field.width), split(place[1], field.height));
    let (right, below) = ((x + 1) % field.width, (y + 1) % field.height);
    let line = |y: usize| field.at(x, y) + t * (field.at(right, y) - field.at(x, y));
    let (upper, lower) = (line(y), line(below));
    upper + s * (lower - upper)
}
