//! Surfaces that follow a rule: revolution, height field, relief on a plate, helical thread.

use crate::outline::{inset, polar};
use crate::solid::{P2, P3, Solid, at};

/// The circle of radius `r` at height `z`, one point in each of the directions `degrees`.
pub fn ring(r: f64, z: f64, degrees: &[f64]) -> Vec<P3> {
    at(&degrees.iter().map(|&d| polar(r, d)).collect::<Vec<_>>(), z)
}

/// `steps` directions evenly round the circle, from 0 degrees.
pub fn round(steps: usize) -> Vec<f64> {
    (0..steps).map(|i| 360.0 * i as f64 / steps as f64).collect()
}

/// Turns a profile of (radius, height) about z; the outside is to the right of its way. A profile
/// with both ends on the axis, or with equal ends, closes the surface.
pub fn revolve(solid: &mut Solid, profile: &[P2], degrees: &[f64]) {
    let rings: Vec<_> = profile.iter().map(|&[r, z]| ring(r, z, degrees)).collect();
    solid.loft(&rings);
}

/// The block between z = 0 and `height(x, y)` > 0 over the grid of lines `xs`, `ys`; a cell that is
/// not flat is split along the diagonal that passes nearer its middle.
pub fn height_field(solid: &mut Solid, xs: &[f64], ys: &[f64], height: impl Fn(f64, f64) -> f64) {
    let top = |i: usize, j: usize| [xs[i], ys[j], height(xs[i], ys[j])];
    let (nx, ny) = (xs.len() - 1, ys.len() - 1);
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] = [top(i, j), top(i + 1, j), top(i + 1, j + 1), top(i, j + 1)];
            let (rising, falling) = ((a[2] + c[2]) / 2.0, (b[2] + d[2]) / 2.0);
            let middle = height((a[0] + c[0]) / 2.0, (a[1] + c[1]) / 2.0);
            if (rising - falling).abs() < 1e-4 {
                solid.face(&[a, b, c, d]);
            } else if (rising - middle).abs() <= (falling - middle).abs() {
                solid.face(&[a, b, c]);
                solid.face(&[a, c, d]);
            } else {
                solid.face(&[a, b, d]);
                solid.face(&[b, c, d]);
            }
        }
    }
    let mut rim: Vec<P3> = (0..nx).map(|i| top(i, 0)).collect();
    rim.extend((0..ny).map(|j| top(nx, j)));
    rim.extend((0..nx).map(|i| top(nx - i, ny)));
    rim.extend((0..ny).map(|j| top(0, ny - j)));
    let mut floor: Vec<P3> = rim.iter().map(|&[x, y, _]| [x, y, 0.0]).collect();
    solid.band(&floor, &rim);
    floor.reverse();
    let middle = [(xs[0] + xs[nx]) / 2.0, (ys[0] + ys[ny]) / 2.0, 0.0];
    solid.fan(&floor, middle);
}

/// Walls from `outline` at height `z` through the steps (inset, rise), returning the last outline;
/// a negative inset widens.
pub fn rise(solid: &mut Solid, outline: &[P2], z: f64, steps: &[P2]) -> Vec<P2> {
    let mut below = at(outline, z);
    let mut last = outline.to_vec();
    for &[d, dz] in steps {
        last = inset(outline, d);
        let above = at(&last, z + dz);
        solid.band(&below, &above);
        below = above;
    }
    last
}

/// Walls of a hollow from `outline` at height `z` down through the steps (widening, drop), returning
/// the last outline; a negative widening narrows.
pub fn sink(solid: &mut Solid, outline: &[P2], z: f64, steps: &[P2]) -> Vec<P2> {
    let mut above = at(outline, z);
    let mut last = outline.to_vec();
    for &[d, dz] in steps {
        last = inset(outline, -d);
        let below = at(&last, z - dz);
        solid.band(&above, &below);
        above = below;
    }
    last
}

/// A screw thread about z: its profile over one pitch, where it runs, and how finely.
pub struct Thread<'a> {
    /// (fraction of the pitch, radius), fractions rising from 0 below 1.
    pub profile: &'a [P2],
    pub pitch: f64,
    /// The thread fades into a circle of this radius at both ends.
    pub end_radius: f64,
    pub from_z: f64,
    pub to_z: f64,
    /// Directions of the columns, rising from 0 below 360.
    pub degrees: &'a [f64],
}

impl Thread<'_> {
    /// Adds the outside of a bolt's thread.
    pub fn outer(&self, solid: &mut Solid) {
        self.cells(|a, b, c, d| solid.face(&[a, b, c, d]));
    }

    /// Adds the inside of a nut's thread.
    pub fn inner(&self, solid: &mut Solid) {
        self.cells(|a, b, c, d| solid.face(&[d, c, b, a]));
    }

    fn cells(&self, mut add: impl FnMut(P3, P3, P3, P3)) {
        let turns = ((self.to_z - self.from_z) / self.pitch).ceil() as usize + 1;
        for row in 0..turns * self.profile.len() {
            for column in 0..self.degrees.len() {
                let [a, b] = [self.corner(column, row), self.corner(column + 1, row)];
                let [d, c] = [self.corner(column, row + 1), self.corner(column + 1, row + 1)];
                add(a, b, c, d);
            }
        }
    }

    /// Rows climb one pitch in a turn. Beyond the ends they are held on the end circle, where the
    /// weld merges them: the cut is clean without an intersection to compute.
    fn corner(&self, column: usize, row: usize) -> P3 {
        let row = row + self.profile.len() * (column / self.degrees.len());
        let deg = self.degrees[column % self.degrees.len()];
        let [fraction, radius] = self.profile[row % self.profile.len()];
        let turn = (row / self.profile.len()) as f64 - 1.0 + fraction + deg / 360.0;
        let z = (self.from_z + self.pitch * turn).clamp(self.from_z, self.to_z);
        let to_end = (z - self.from_z).min(self.to_z - z);
        let fade = (to_end / (0.6 * self.pitch)).min(1.0);
        let [x, y] = polar(self.end_radius + (radius - self.end_radius) * fade, deg);
        [x, y, z]
    }
}
