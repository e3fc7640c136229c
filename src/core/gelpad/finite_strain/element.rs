//! Hexahedra of rubber: eight nodes, and one pressure in each.
//!
//! The energy is mu / 2 (|F|^2 - 3) - mu ln J + lambda / 2 (ln J)^2, with mu = 1 here. The part in |F|^2 is linear in
//! the displacement and belongs to [`super::layer`]. The rest needs only the element's mean J, which is its exact
//! volume over the volume at rest, so that there is no quadrature: forces are the gradient of the volume (Flanagan and
//! Belytschko 1981, equation 79).

use pulp::{Simd, WithSimd};

use crate::base::simd::dispatch_kernel;

/// Ratio of volumes below which an element counts as crushed.
const SMALLEST_RATIO: f32 = 0.05;

/// A box of hexahedra, periodic along x and y, fixed at the bottom.
#[derive(Clone, Debug)]
pub struct ElementGrid {
    /// Elements along x and y.
    pub size: [usize; 2],
    /// Their sides, mm.
    pub spacing_mm: [f64; 2],
    /// Their heights from the bottom up, mm.
    pub heights_mm: Vec<f64>,
}

/// Displacement of the nodes and pressure of the elements, row by row, plane by plane.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// Displacement along x, y and z (up), mm, of the planes above the fixed one.
    pub displacement: [Vec<f32>; 3],
    /// Pressure over the shear modulus, positive in tension.
    pub pressure: Vec<f32>,
    /// Displacement of the nodes that may touch on the contact's finer grid, mm. Empty without a contact.
    pub surface: [Vec<f32>; 3],
}

impl ElementGrid {
    /// Returns the number of nodes in a plane.
    pub fn plane(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Returns the number of layers.
    pub fn layers(&self) -> usize {
        self.heights_mm.len()
    }

    /// Returns the state at rest, without a contact.
    pub fn rest(&self) -> State {
        let zeros = || vec![0.0; self.plane() * self.layers()];
        State { displacement: [zeros(), zeros(), zeros()], pressure: zeros(), surface: Default::default() }
    }

    /// Writes what the forces of a state lack to those of the linear layer, and its volumes to the linear ones. Returns
    /// the smallest ratio of an element's volume to that at rest.
    pub fn remainder(&self, state: &State, remainder: &mut State) -> f32 {
        for part in &mut remainder.displacement {
            part.fill(0.0);
        }
        dispatch_kernel(RemainderKernel { grid: self, state, remainder })
    }
}

struct RemainderKernel<'a> {
    grid: &'a ElementGrid,
    state: &'a State,
    remainder: &'a mut State,
}

/// The nodes of the terms of the volume's gradient at each node.
const ORDERS: [[usize; 8]; 8] = [
    [0, 1, 2, 3, 4, 5, 6, 7],
    [1, 2, 3, 0, 5, 6, 7, 4],
    [2, 3, 0, 1, 6, 7, 4, 5],
    [3, 0, 1, 2, 7, 4, 5, 6],
    [4, 7, 6, 5, 0, 3, 2, 1],
    [5, 4, 7, 6, 1, 0, 3, 2],
    [6, 5, 4, 7, 2, 1, 0, 3],
    [7, 6, 5, 4, 3, 2, 1, 0],
];

/// The side of each node along x, y and z: 0 or 1.
const SIDES: [[usize; 3]; 8] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];

/// Numbers of the eight nodes of some neighbouring elements.
type Nodes<S> = [<S as Simd>::f32s; 8];

// What follows names no closure: closures would stay calls within code for wide vectors.

/// Returns the derivative of the volume by one coordinate of a node, times 12.
#[inline(always)]
fn volume_gradient<S: Simd>(simd: S, y: &Nodes<S>, z: &Nodes<S>, at: [usize; 8]) -> S::f32s {
    let [_, b, c, d, e, f, _, h] = at;
    let (x, v, w) = (simd.sub_f32s(z[d], z[e]), simd.sub_f32s(z[b], z[d]), simd.sub_f32s(z[e], z[b]));
    let first = simd.mul_f32s(y[b], simd.sub_f32s(simd.sub_f32s(z[f], z[c]), x));
    let second = simd.mul_f32s(y[c], v);
    let third = simd.mul_f32s(y[d], simd.sub_f32s(simd.sub_f32s(z[c], z[h]), w));
    let fourth = simd.mul_f32s(y[e], simd.sub_f32s(simd.sub_f32s(z[h], z[f]), v));
    let last = simd.add_f32s(simd.mul_f32s(y[f], w), simd.mul_f32s(y[h], x));
    simd.add_f32s(simd.add_f32s(simd.add_f32s(first, second), simd.add_f32s(third, fourth)), last)
}

#[inline(always)]
fn volume_gradients<S: Simd>(simd: S, y: &Nodes<S>, z: &Nodes<S>) -> Nodes<S> {
    let mut gradients = *y;
    for (gradient, order) in gradients.iter_mut().zip(ORDERS) {
        *gradient = volume_gradient(simd, y, z, order);
    }
    gradients
}

/// Returns the sum over the nodes of their numbers' products.
#[inline(always)]
fn sum_products<S: Simd>(simd: S, a: &Nodes<S>, b: &Nodes<S>) -> S::f32s {
    let mut products = *a;
    for (product, b) in products.iter_mut().zip(b) {
        *product = simd.mul_f32s(*product, *b);
    }
    sum_nodes(simd, &products)
}

#[inline(always)]
fn sum_nodes<S: Simd>(simd: S, [a, b, c, d, e, f, g, h]: &Nodes<S>) -> S::f32s {
    let lower = simd.add_f32s(simd.add_f32s(*a, *b), simd.add_f32s(*c, *d));
    simd.add_f32s(lower, simd.add_f32s(simd.add_f32s(*e, *f), simd.add_f32s(*g, *h)))
}

/// Returns the numbers of the nodes on the upper side along axis `c`, minus those on the lower one.
#[inline(always)]
fn difference_along<S: Simd>(simd: S, values: &Nodes<S>, c: usize) -> S::f32s {
    let mut signed = *values;
    for (value, side) in signed.iter_mut().zip(SIDES) {
        if side[c] == 0 {
            *value = simd.neg_f32s(*value);
        }
    }
    sum_nodes(simd, &signed)
}

/// Returns the logarithm of numbers around 1, by its series in (x - 1) / (x + 1); it is smooth and rising everywhere.
#[inline(always)]
fn logarithm<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let one = simd.splat_f32s(1.0);
    let t = simd.div_f32s(simd.sub_f32s(x, one), simd.add_f32s(x, one));
    let square = simd.mul_f32s(t, t);
    let mut sum = simd.splat_f32s(1.0 / 13.0);
    for divisor in [11.0, 9.0, 7.0, 5.0, 3.0, 1.0] {
        sum = simd.add_f32s(simd.mul_f32s(sum, square), simd.splat_f32s(1.0 / divisor));
    }
    simd.mul_f32s(simd.add_f32s(t, t), sum)
}

impl WithSimd for RemainderKernel<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let ElementGrid { size: [width, height], spacing_mm: [dx, dy], heights_mm } = self.grid;
        let (width, height, plane) = (*width, *height, self.grid.plane());
        // Rows of nodes, with the first node once more at the end; forces on the nodes on the left and on the right.
        let mut rows = vec![0.0_f32; 12 * (width + 1)];
        let mut forces = vec![0.0_f32; 24 * width];
        let mut smallest = simd.splat_f32s(1.0);
        for (k, dz) in heights_mm.iter().enumerate() {
            let halves = [dx, dy, dz].map(|side| (0.5 * side) as f32);
            let volume = (dx * dy * dz) as f32;
            let faces = [dy * dz, dx * dz, dx * dy].map(|area| (0.25 * area) as f32);
            for j in 0..height {
                let lines = [j, (j + 1) % height];
                for c in 0..3 {
                    for up in 0..2 {
                        for (down, line) in lines.iter().enumerate() {
                            let to = &mut rows[((c * 2 + up) * 2 + down) * (width + 1)..][..width + 1];
                            match (k + up).checked_sub(1) {
                                Some(above) => {
                                    let from = &self.state.displacement[c][above * plane + line * width..][..width];
                                    to[..width].copy_from_slice(from);
                                    to[width] = from[0];
                                }
                                None => to.fill(0.0),
                            }
                        }
                    }
                }
                let start = k * plane + j * width;
                let pressure = S::as_simd_f32s(&self.state.pressure[start..][..width]).0;
                let volumes = S::as_mut_simd_f32s(&mut self.remainder.pressure[start..][..width]).0;
                for (at, (p, g)) in pressure.iter().zip(volumes).enumerate() {
                    let first = at * S::F32_LANES;
                    let mut moved = [[simd.splat_f32s(0.0); 8]; 3];
                    let mut place = moved;
                    for c in 0..3 {
                        let half = simd.splat_f32s(halves[c]);
                        for node in 0..8 {
                            let [x, y, z] = SIDES[node];
                            let from = ((c * 2 + z) * 2 + y) * (width + 1) + x + first;
                            moved[c][node] = S::as_simd_f32s(&rows[from..from + S::F32_LANES]).0[0];
                            place[c][node] = match SIDES[node][c] {
                                1 => simd.add_f32s(moved[c][node], half),
                                _ => simd.sub_f32s(moved[c][node], half),
                            };
                        }
                    }
                    let [x, y, z] = &place;
                    let gradients =
                        [volume_gradients(simd, y, z), volume_gradients(simd, z, x), volume_gradients(simd, x, y)];
                    let twelve = sum_products(simd, x, &gradients[0]);
                    let ratio = simd.mul_f32s(twelve, simd.splat_f32s(1.0 / (12.0 * volume)));
                    smallest = simd.min_f32s(smallest, ratio);
                    let ratio = simd.max_f32s(ratio, simd.splat_f32s(SMALLEST_RATIO));
                    // The linear change of the volume.
                    let mut linear = simd.splat_f32s(0.0);
                    for c in 0..3 {
                        let along = difference_along(simd, &moved[c], c);
                        linear = simd.add_f32s(linear, simd.mul_f32s(simd.splat_f32s(faces[c]), along));
                    }
                    *g = simd.sub_f32s(simd.mul_f32s(simd.splat_f32s(volume), logarithm(simd, ratio)), linear);
                    let one = simd.splat_f32s(1.0);
                    let now = simd.div_f32s(simd.sub_f32s(*p, one), ratio);
                    let now = simd.mul_f32s(now, simd.splat_f32s(1.0 / 12.0));
                    let rest =
                        simd.sub_f32s(simd.sub_f32s(one, *p), simd.mul_f32s(linear, simd.splat_f32s(1.0 / volume)));
                    for c in 0..3 {
                        let at_rest = simd.mul_f32s(rest, simd.splat_f32s(faces[c]));
                        for node in 0..8 {
                            let [x, y, z] = SIDES[node];
                            let force = simd.mul_f32s(now, gradients[c][node]);
                            let force = if SIDES[node][c] == 1 {
                                simd.add_f32s(force, at_rest)
                            } else {
                                simd.sub_f32s(force, at_rest)
                            };
                            let to = (((c * 2 + z) * 2 + y) * 2 + x) * width + first;
                            S::as_mut_simd_f32s(&mut forces[to..to + S::F32_LANES]).0[0] = force;
                        }
                    }
                }
                for c in 0..3 {
                    for up in 0..2 {
                        let Some(above) = (k + up).checked_sub(1) else { continue };
                        for (down, line) in lines.iter().enumerate() {
                            let from = &forces[((c * 2 + up) * 2 + down) * 2 * width..][..2 * width];
                            let (left, right) = from.split_at(width);
                            let to = &mut self.remainder.displacement[c][above * plane + line * width..][..width];
                            to[0] -= left[0] + right[width - 1];
                            for ((to, left), right) in to[1..].iter_mut().zip(&left[1..]).zip(right) {
                                *to -= left + right;
                            }
                        }
                    }
                }
            }
        }
        simd.reduce_min_f32s(smallest)
    }
}
