//! Contact of the surface with a rigid object, within one step of the fixed point.
//!
//! The grid of the contact is finer than the box, and on it the surface has the exact compliance of the linear layer:
//! u = u_free + S f, where u_free comes from the box. At each node p >= 0, and the gap along the object's normal at the
//! displaced node is 0 where p > 0.
//!
//! The force is -p a, with a the normal of the rubber's surface as the box knows it. Under contact a is the object's
//! normal, too. But the box is coarser: were forces to turn with the object's normal at each node, nothing in the box
//! would turn with them, and under some shear moduli of pressure nodes would snap round an edge and back.

use super::height_map::HeightMap;
use super::layer::{BoxLayer, Matrix, PlaneSpectrum, inverse, multiply_matrix, times, times_i, times_minus_i};
use super::spectrum::{HalfSpectrum, RealTransform};
use super::torus::filter;
use crate::base::cubic::catmull_rom;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::gelpad::elastic::layer::ElasticLayer;

/// Nodes of the contact's grid per node of the box.
pub const REFINEMENT: usize = 3;

/// Filter from which waves of two nodes vanish, and in which long ones stay to the sixth order.
const WITHOUT_SHORTEST_WAVES: [f32; 7] =
    [1.0 / 64.0, -6.0 / 64.0, 15.0 / 64.0, 44.0 / 64.0, 15.0 / 64.0, -6.0 / 64.0, 1.0 / 64.0];

/// Ratio of a crushed surface's area to that at rest, below which its normal fades.
const SMALLEST_AREA: f32 = 0.1;

/// Gap from which on a node counts as free for the step, nodes.
const APART_NODES: f64 = 2.0;

/// Gap of nodes with nothing over them, mm.
const FAR_MM: f32 = 1e3;

/// The surface on the contact's grid.
pub struct ContactGrid {
    pub transform: RealTransform,
    pub spacing_mm: [f64; 2],
    /// Compliance for (fx, fy, -i fz): xx, xy, xz, yy, yz, zz per frequency, mm per force over the shear modulus.
    compliance: [Vec<f32>; 6],
    /// From forces on this grid to those on the box's surface that move it as far; nine numbers per frequency of the
    /// box.
    to_box: Vec<f32>,
    /// Place in this grid's spectrum of each frequency of the box.
    places: Vec<Option<u32>>,
    /// Length of the wave vector, rad/mm, per frequency.
    waves: Vec<f32>,
    inverse: Vec<f32>,
    largest_compliance: f32,
    /// Displacement of a node under its own force.
    own_compliance: f32,
    spectra: PlaneSpectrum,
    moved: PlaneSpectrum,
    box_spectra: PlaneSpectrum,
    box_forces: PlaneSpectrum,
    buffers: LcpBuffers,
    /// Forces along the normals and the displacement under them.
    pressed: [Field; 2],
    /// Forces by which the rubber's normals differ from the object's.
    turned: Field,
}

/// A vector field on the contact's grid, row by row.
pub type Field = [Vec<f32>; 3];

#[derive(Default)]
struct LcpBuffers {
    residual: Vec<f32>,
    last_residual: Vec<f32>,
    step: Vec<f32>,
    direction: Vec<f32>,
    gap: Vec<f32>,
    change: Vec<f32>,
}

/// A contact to be improved.
pub struct ContactGuess<'a> {
    /// Displacement of the surface, mm.
    pub surface: &'a mut Field,
    /// Forces on the nodes over the shear modulus; the guess of points that stick.
    pub force: &'a mut Field,
    /// Size of the nodes' force over the shear modulus; the guess of points that slide.
    pub pressure: &'a mut [f32],
}

/// What one contact problem is about.
struct Conditions {
    /// Unit normals.
    normal: Field,
    /// How far each node would reach into the object without any force, mm.
    overlap: Vec<f32>,
}

impl ContactGrid {
    pub fn new(layer: &BoxLayer, pad: ElasticLayer) -> Self {
        let size = layer.grid.size.map(|size| size * REFINEMENT);
        let spacing_mm = layer.grid.spacing_mm.map(|mm| mm / REFINEMENT as f64);
        let transform = RealTransform::new(size);
        let count = transform.frequencies();
        let modulus = 2.0 * (1.0 + pad.poisson_ratio);
        let zeros = || vec![0.0_f32; count];
        let mut compliance = [zeros(), zeros(), zeros(), zeros(), zeros(), zeros()];
        let mut waves = zeros();
        let mut exact = vec![[0.0; 6]; count];
        for at in 0..count {
            let (angles, highest) = transform.angles(at);
            let q = [angles[0] / spacing_mm[0], angles[1] / spacing_mm[1]];
            let length = libm::sqrt(q[0] * q[0] + q[1] * q[1]);
            let odd = if highest[0] || highest[1] { 0.0 } else { 1.0 };
            let [cos, sin] = if length > 0.0 { q.map(|q| q / length) } else { [1.0, 0.0] };
            let spread: f64 = angles.iter().map(|angle| sinc(0.5 * angle)).product::<f64>()
                / (spacing_mm[0] * spacing_mm[1])
                / modulus;
            let [g, h, c, t] = [
                pad.normal_compliance(length),
                pad.tangential_compliance(length),
                pad.coupling_compliance(length),
                pad.transverse_compliance(length),
            ]
            .map(|compliance| compliance * spread);
            exact[at] = [
                h * cos * cos + t * sin * sin,
                odd * (h - t) * cos * sin,
                odd * c * cos,
                h * sin * sin + t * cos * cos,
                odd * c * sin,
                g,
            ];
            for (to, value) in compliance.iter_mut().zip(exact[at]) {
                to[at] = value as f32;
            }
            waves[at] = length as f32;
        }
        let places = transform.places_of_coarser(&layer.transform);
        let coarse = layer.transform.frequencies();
        let mut to_box = vec![0.0_f32; 9 * coarse];
        for (at, place) in places.iter().enumerate() {
            let Some(place) = place else { continue };
            let [xx, xy, xz, yy, yz, zz] = exact[*place as usize];
            let here: Matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            let ratio = times(&inverse(&layer.surface_compliance(at)), &here);
            for r in 0..3 {
                for c in 0..3 {
                    // A displacement's spectrum is a sum over nodes, of which this grid has more.
                    to_box[(r * 3 + c) * coarse + at] = ratio[r][c] as f32 / (REFINEMENT * REFINEMENT) as f32;
                }
            }
        }
        let largest_compliance = compliance[5].iter().copied().fold(0.0, f32::max);
        let [width, height] = size;
        let counted: f64 = (0..count).map(|at| transform.multiplicity(at) * f64::from(compliance[5][at])).sum();
        let own_compliance = (counted / (width * height) as f64) as f32;
        let planes = |count: usize| [0, 1, 2].map(|_| HalfSpectrum::zeros(count));
        Self {
            spacing_mm,
            compliance,
            to_box,
            places,
            waves,
            inverse: zeros(),
            largest_compliance,
            own_compliance,
            spectra: planes(count),
            moved: planes(count),
            box_spectra: planes(coarse),
            box_forces: planes(coarse),
            buffers: LcpBuffers::default(),
            pressed: [0, 1].map(|_| [0, 1, 2].map(|_| vec![0.0; width * height])),
            turned: [0, 1, 2].map(|_| vec![0.0; width * height]),
            transform,
        }
    }

    pub fn nodes(&self) -> usize {
        let [width, height] = self.transform.size();
        width * height
    }

    pub fn zeros(&self) -> Field {
        [0, 1, 2].map(|_| vec![0.0; self.nodes()])
    }

    /// Interpolates a displacement of the box's surface, (ux, uy, -i uz), to this grid, by its waves.
    pub fn refine(&mut self, surface: &PlaneSpectrum, field: &mut Field) {
        let scale = (REFINEMENT * REFINEMENT) as f32;
        for (to, from) in self.spectra.iter_mut().zip(surface) {
            to.clear();
            for (at, place) in self.places.iter().enumerate() {
                if let Some(place) = place {
                    let place = *place as usize;
                    (to.re[place], to.im[place]) = (scale * from.re[at], scale * from.im[at]);
                }
            }
        }
        let [x, y, z] = &mut self.spectra;
        times_i(z);
        let [to_x, to_y, to_z] = field;
        self.transform.inverse([x, y], [to_x, to_y]);
        self.transform.inverse_one(z, to_z);
    }

    /// Returns what smoothing adds to a displacement of the box's surface that waves took to this grid: from the box's
    /// nodes by cubics (Catmull and Rom 1974), without the shortest waves. Waves are right for the forces of a step, but
    /// beside a kink they ring far around.
    pub fn smoothing(&self, by_waves: &Field) -> Field {
        let [width, height] = self.transform.size();
        let [columns, rows] = [width, height].map(|size| size / REFINEMENT);
        let shares: [[f32; 4]; REFINEMENT] = std::array::from_fn(|k| catmull_rom(k as f32 / REFINEMENT as f32));
        let mut change = self.zeros();
        let (mut nodes, mut wide) = (Grid::<f32>::new(columns, rows), Grid::<f32>::new(width, rows));
        for (by_waves, change) in by_waves.iter().zip(&mut change) {
            for y in 0..rows {
                for (x, to) in nodes.row_mut(y).iter_mut().enumerate() {
                    *to = by_waves[y * REFINEMENT * width + x * REFINEMENT];
                }
            }
            let smooth = filter(&nodes, &WITHOUT_SHORTEST_WAVES);
            for y in 0..rows {
                let from = smooth.row(y);
                for (x, to) in wide.row_mut(y).iter_mut().enumerate() {
                    let beside = |j: usize| from[(x / REFINEMENT + columns + j - 1) % columns];
                    *to = (0..4).map(|j| beside(j) * shares[x % REFINEMENT][j]).sum();
                }
            }
            for y in 0..height {
                let lines = [0, 1, 2, 3].map(|j| wide.row((y / REFINEMENT + rows + j - 1) % rows));
                let shares = shares[y % REFINEMENT];
                for x in 0..width {
                    let value: f32 = lines.iter().zip(shares).map(|(line, share)| line[x] * share).sum();
                    change[y * width + x] = value - by_waves[y * width + x];
                }
            }
        }
        change
    }

    /// Returns the forces on the box's surface, (fx, fy, -i fz), that move it as forces on this grid move the surface.
    pub fn coarsen(&mut self, force: &Field) -> &PlaneSpectrum {
        let [x, y, z] = &mut self.spectra;
        self.transform.forward([&force[0], &force[1]], [x, y]);
        self.transform.forward_one(&force[2], z);
        times_minus_i(z);
        for (to, from) in self.box_spectra.iter_mut().zip(&self.spectra) {
            for (at, place) in self.places.iter().enumerate() {
                let place = place.map(|place| place as usize);
                (to.re[at], to.im[at]) = place.map_or((0.0, 0.0), |place| (from.re[place], from.im[place]));
            }
        }
        multiply_matrix(&mut self.box_forces, &self.to_box, &self.box_spectra);
        &self.box_forces
    }

    /// Writes the displacement under forces, by the exact linear layer on this torus.
    pub fn displace(&mut self, force: &Field, displacement: &mut Field) {
        let [x, y, z] = &mut self.spectra;
        self.transform.forward([&force[0], &force[1]], [x, y]);
        self.transform.forward_one(&force[2], z);
        times_minus_i(z);
        let [xx, xy, xz, yy, yz, zz] = &self.compliance;
        for (moved, rows) in self.moved.iter_mut().zip([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) {
            let parts = [
                (&mut moved.re, [&self.spectra[0].re, &self.spectra[1].re, &self.spectra[2].re]),
                (&mut moved.im, [&self.spectra[0].im, &self.spectra[1].im, &self.spectra[2].im]),
            ];
            for (to, [a, b, c]) in parts {
                simd_dispatch(
                    #[inline(always)]
                    || {
                        for ((((((to, a), b), c), p), q), r) in
                            to.iter_mut().zip(a).zip(b).zip(c).zip(rows[0]).zip(rows[1]).zip(rows[2])
                        {
                            *to = a * p + b * q + c * r;
                        }
                    },
                );
            }
        }
        let [x, y, z] = &mut self.moved;
        times_i(z);
        let [to_x, to_y, to_z] = displacement;
        self.transform.inverse([x, y], [to_x, to_y]);
        self.transform.inverse_one(z, to_z);
    }

    /// Makes the approximate inverse of the compliance for a contact of this size, mm.
    pub fn prepare_inverse(&mut self, pad: ElasticLayer, size_mm: f64) {
        let cutoff = std::f64::consts::PI / size_mm;
        let scale = 1.0 / (self.spacing_mm[0] * self.spacing_mm[1]) / (2.0 * (1.0 + pad.poisson_ratio));
        let longest = 1.0 / (scale * pad.normal_compliance(cutoff));
        for ((inverse, q), zz) in self.inverse.iter_mut().zip(&self.waves).zip(&self.compliance[5]) {
            *inverse = if f64::from(*q) < cutoff { longest as f32 } else { 1.0 / zz };
        }
    }

    /// Finds the pressures under which the surface does not enter the object, linearised about the guess. `box_surface`
    /// is the displacement of the box's surface on this grid.
    pub fn solve(
        &mut self,
        (object, lifted_mm, region): (&HeightMap, f32, Rect),
        [free, box_surface]: [&Field; 2],
        ContactGuess { surface, force, pressure }: ContactGuess<'_>,
        tolerance_mm: f32,
    ) {
        let mut conditions = self.linearise(object, lifted_mm, region, free, surface);
        // The problem is symmetric for forces along the object's normals; what the rubber's differ by is known from the
        // pressure so far.
        let mut turned = std::mem::take(&mut self.turned);
        self.turn_to_rubber(&conditions.normal, pressure, region, box_surface, &mut turned);
        self.displace(&turned, surface);
        for (moved, normal) in surface.iter().zip(&conditions.normal) {
            for ((overlap, moved), n) in conditions.overlap.iter_mut().zip(moved).zip(normal) {
                *overlap += moved * n;
            }
        }
        self.solve_conditions(&conditions, pressure, tolerance_mm);
        for ((force, normal), turned) in force.iter_mut().zip(&conditions.normal).zip(&turned) {
            for (((force, n), p), turned) in force.iter_mut().zip(normal).zip(&*pressure).zip(turned) {
                *force = turned - n * p;
            }
        }
        self.turned = turned;
        self.displace(force, surface);
        for (surface, free) in surface.iter_mut().zip(free) {
            surface.iter_mut().zip(free).for_each(|(sum, free)| *sum += free);
        }
    }

    /// Writes the forces p (n - a) that take pressures from the object's normals n to the normals a of the box's surface.
    fn turn_to_rubber(&self, normal: &Field, pressure: &[f32], region: Rect, box_surface: &Field, turned: &mut Field) {
        let [width, height] = self.transform.size();
        let per_mm = self.spacing_mm.map(|mm| (0.5 / mm) as f32);
        turned.iter_mut().for_each(|part| part.fill(0.0));
        for y in region.y0..region.y1 {
            let [above, below] = [(y + height - 1) % height, (y + 1) % height].map(|y| y * width);
            for x in region.x0..region.x1 {
                let at = y * width + x;
                if pressure[at] == 0.0 {
                    continue;
                }
                let [left, right] = [(x + width - 1) % width, (x + 1) % width];
                let row = y * width;
                let [xx, yx, zx] =
                    [0, 1, 2].map(|c| (box_surface[c][row + right] - box_surface[c][row + left]) * per_mm[0]);
                let [xy, yy, zy] =
                    [0, 1, 2].map(|c| (box_surface[c][below + x] - box_surface[c][above + x]) * per_mm[1]);
                let area = [yx * zy - zx * (1.0 + yy), zx * xy - (1.0 + xx) * zy, (1.0 + xx) * (1.0 + yy) - xy * yx];
                let length = area.iter().map(|a| a * a).sum::<f32>().sqrt().max(SMALLEST_AREA);
                for c in 0..3 {
                    turned[c][at] = pressure[at] * (normal[c][at] - area[c] / length);
                }
            }
        }
    }

    /// Finds the forces under which the surface does not enter the object, where points that touch stay at their
    /// anchors.
    pub fn solve_sticking(
        &mut self,
        (object, lifted_mm, region): (&HeightMap, f32, Rect),
        free: &Field,
        anchors: &[Vec<f32>; 2],
        ContactGuess { surface, force, .. }: ContactGuess<'_>,
        tolerance_mm: f32,
    ) {
        let [width, _] = self.transform.size();
        let per_mm = self.spacing_mm.map(|mm| (1.0 / mm) as f32);
        let mut target = [anchors[0].clone(), anchors[1].clone(), vec![FAR_MM; self.nodes()]];
        for y in region.y0..region.y1 {
            for x in region.x0..region.x1 {
                let at = y * width + x;
                let place = [x as f32 + target[0][at] * per_mm[0], y as f32 + target[1][at] * per_mm[1]];
                target[2][at] = lifted_mm - object.at(place).height_mm;
            }
        }
        if force[2].iter().all(|f| *f >= 0.0) {
            for ((f, free), target) in force[2].iter_mut().zip(&free[2]).zip(&target[2]) {
                *f = (target - free).min(0.0) / self.largest_compliance;
            }
        }
        self.stick_to(&target, free, force, surface, tolerance_mm);
    }

    /// Conjugate gradients for the forces of nodes that touch, which join and leave as they enter or pull.
    fn stick_to(&mut self, target: &Field, free: &Field, force: &mut Field, surface: &mut Field, tolerance_mm: f32) {
        const MOST: u32 = 60;
        let mut residual = self.zeros();
        let (mut last_residual, mut step) = (residual.clone(), residual.clone());
        let (mut direction, mut response) = (residual.clone(), residual.clone());
        let add = |surface: &mut Field| {
            for (surface, free) in surface.iter_mut().zip(free) {
                surface.iter_mut().zip(free).for_each(|(sum, free)| *sum += free);
            }
        };
        let product = |a: &Field, b: &Field| (0..3).map(|c| dot(&a[c], &b[c])).sum::<f64>();
        self.displace(force, surface);
        add(surface);
        let (mut last_product, mut keeps) = (1.0_f64, false);
        for iteration in 0.. {
            let mut worst = 0.0_f32;
            for at in 0..force[2].len() {
                let touches = force[2][at] < 0.0;
                for c in 0..3 {
                    let off = surface[c][at] - target[c][at];
                    residual[c][at] = if touches { off } else { 0.0 };
                    worst = worst.max(if touches {
                        off.abs()
                    } else if c == 2 {
                        off
                    } else {
                        0.0
                    });
                }
            }
            if worst <= tolerance_mm || iteration == MOST {
                return;
            }
            self.apply_inverse(&residual, &mut step);
            for part in &mut step {
                part.iter_mut().zip(&force[2]).for_each(|(z, f)| *z = if *f < 0.0 { *z } else { 0.0 });
            }
            let now = product(&residual, &step);
            let share = ((now - product(&step, &last_residual)) / last_product).max(0.0);
            let share = if keeps && share.is_finite() { share as f32 } else { 0.0 };
            last_product = now;
            for (direction, step) in direction.iter_mut().zip(&step) {
                for ((t, z), f) in direction.iter_mut().zip(step).zip(&force[2]) {
                    *t = if *f < 0.0 { z + share * *t } else { 0.0 };
                }
            }
            self.displace(&direction, &mut response);
            let curvature = product(&direction, &response);
            if curvature <= 0.0 {
                return;
            }
            let length = (product(&residual, &direction) / curvature) as f32;
            std::mem::swap(&mut residual, &mut last_residual);
            let mut changed = false;
            for at in 0..force[2].len() {
                let touches = force[2][at] < 0.0;
                for c in 0..3 {
                    surface[c][at] -= length * response[c][at];
                    force[c][at] -= length * direction[c][at];
                }
                if touches && force[2][at] >= 0.0 {
                    changed = true;
                    (0..3).for_each(|c| force[c][at] = 0.0);
                } else if !touches && surface[2][at] > target[2][at] {
                    changed = true;
                    force[2][at] = (target[2][at] - surface[2][at]) / self.own_compliance;
                }
            }
            keeps = !changed;
            if changed {
                self.displace(force, surface);
                add(surface);
            }
        }
    }

    /// Computes approximately the forces under displacements.
    fn apply_inverse(&mut self, displacement: &Field, force: &mut Field) {
        let [x, y, z] = &mut self.spectra;
        self.transform.forward([&displacement[0], &displacement[1]], [x, y]);
        self.transform.forward_one(&displacement[2], z);
        for HalfSpectrum { re, im } in &mut self.spectra {
            for ((re, im), inverse) in re.iter_mut().zip(im).zip(&self.inverse) {
                (*re, *im) = (*re * inverse, *im * inverse);
            }
        }
        let [x, y, z] = &self.spectra;
        let [to_x, to_y, to_z] = force;
        self.transform.inverse([x, y], [to_x, to_y]);
        self.transform.inverse_one(z, to_z);
    }

    fn linearise(&self, object: &HeightMap, lifted_mm: f32, region: Rect, free: &Field, surface: &Field) -> Conditions {
        let [width, _] = self.transform.size();
        let mut normal = self.zeros();
        normal[2].fill(1.0);
        let mut overlap = vec![-FAR_MM; self.nodes()];
        let apart_mm = (APART_NODES * self.spacing_mm[0].max(self.spacing_mm[1])) as f32;
        let per_mm = self.spacing_mm.map(|mm| (1.0 / mm) as f32);
        for y in region.y0..region.y1 {
            for x in region.x0..region.x1 {
                let at = y * width + x;
                let moved = [0, 1, 2].map(|c| surface[c][at]);
                let place = [x as f32 + moved[0] * per_mm[0], y as f32 + moved[1] * per_mm[1]];
                if moved[2] + object.at_most_mm(place) < lifted_mm - apart_mm {
                    continue;
                }
                let here = object.at(place);
                let n = here.normal();
                let mut reach = (moved[2] + here.height_mm - lifted_mm) * n[2];
                for c in 0..3 {
                    normal[c][at] = n[c];
                    reach += n[c] * (free[c][at] - moved[c]);
                }
                overlap[at] = reach;
            }
        }
        Conditions { normal, overlap }
    }

    /// Writes how far pressures along the normals move the nodes along them.
    fn respond(&mut self, conditions: &Conditions, pressure: &[f32], moved: &mut [f32]) {
        let [mut force, mut response] = std::mem::take(&mut self.pressed);
        for c in 0..3 {
            for ((force, n), p) in force[c].iter_mut().zip(&conditions.normal[c]).zip(pressure) {
                *force = n * p;
            }
        }
        self.displace(&force, &mut response);
        let [nx, ny, nz] = &conditions.normal;
        let [x, y, z] = &response;
        for ((moved, (x, nx)), ((y, ny), (z, nz))) in
            moved.iter_mut().zip(x.iter().zip(nx)).zip(y.iter().zip(ny).zip(z.iter().zip(nz)))
        {
            *moved = x * nx + y * ny + z * nz;
        }
        self.pressed = [force, response];
    }

    /// Conjugate gradients under bounds, as in the linear layer's solver.
    fn solve_conditions(&mut self, conditions: &Conditions, pressure: &mut [f32], tolerance_mm: f32) {
        const MOST: u32 = 60;
        let overlap = &conditions.overlap;
        if !pressure.iter().any(|p| *p > 0.0) {
            for (p, overlap) in pressure.iter_mut().zip(overlap) {
                *p = overlap.max(0.0) / self.largest_compliance;
            }
            if !pressure.iter().any(|p| *p > 0.0) {
                return;
            }
        }
        let len = pressure.len();
        let mut own = std::mem::take(&mut self.buffers);
        for buffer in [
            &mut own.residual,
            &mut own.last_residual,
            &mut own.step,
            &mut own.direction,
            &mut own.gap,
            &mut own.change,
        ] {
            buffer.clear();
            buffer.resize(len, 0.0);
        }
        let LcpBuffers { residual, last_residual, step, direction, gap, change } = &mut own;
        self.respond(conditions, pressure, gap);
        let (mut last_product, mut keeps, mut iterations) = (1.0_f64, false, 0);
        loop {
            let mut worst = 0.0_f32;
            for (((p, w), b), r) in pressure.iter().zip(&*gap).zip(overlap).zip(residual.iter_mut()) {
                let difference = w - b;
                *r = if *p > 0.0 { difference } else { 0.0 };
                worst = worst.max(if *p > 0.0 { difference.abs() } else { -difference });
            }
            if worst <= tolerance_mm || iterations == MOST {
                break;
            }
            iterations += 1;
            self.transform.forward_one(residual, &mut self.spectra[0]);
            let HalfSpectrum { re, im } = &mut self.spectra[0];
            for ((re, im), inverse) in re.iter_mut().zip(im).zip(&self.inverse) {
                (*re, *im) = (*re * inverse, *im * inverse);
            }
            self.transform.inverse_one(&self.spectra[0], step);
            for (z, p) in step.iter_mut().zip(&*pressure) {
                *z = if *p > 0.0 { *z } else { 0.0 };
            }
            let product = dot(residual, step);
            let share = ((product - dot(step, last_residual)) / last_product).max(0.0);
            let share = if keeps && share.is_finite() { share as f32 } else { 0.0 };
            last_product = product;
            for ((t, z), p) in direction.iter_mut().zip(&*step).zip(&*pressure) {
                *t = if *p > 0.0 { z + share * *t } else { 0.0 };
            }
            self.respond(conditions, direction, change);
            let curvature = dot(direction, change);
            if curvature <= 0.0 {
                break;
            }
            let length = (dot(residual, direction) / curvature) as f32;
            std::mem::swap(residual, last_residual);
            let (mut joined, mut left) = (false, false);
            for ((((p, t), w), q), b) in
                pressure.iter_mut().zip(&*direction).zip(gap.iter_mut()).zip(&*change).zip(overlap)
            {
                let touches = *p > 0.0;
                let moved = *p - length * t;
                *w -= length * q;
                if touches {
                    left |= moved <= 0.0;
                    *p = moved.max(0.0);
                } else if *w < *b {
                    joined = true;
                    *p = (b - *w) / self.own_compliance;
                }
            }
            keeps = !(joined || left);
            if !keeps {
                self.respond(conditions, pressure, gap);
            }
        }
        self.buffers = own;
    }
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(x) / x }
}

/// Computes the scalar product, in eight partial sums.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f64; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for k in 0..8 {
            sums[k] += f64::from(a[k] * b[k]);
        }
    }
    sums.iter().sum()
}
