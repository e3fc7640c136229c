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
use crate::gelpad::elastic::convolve::{ConvolutionBuffers, KernelSpectrum};
use crate::gelpad::elastic::layer::ElasticLayer;
use crate::gelpad::elastic::vector_convolve::{FrequencyFactors, InSpace};

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
    compliance: FrequencyFactors<6>,
    /// From forces on this grid to those on the box's surface that move it as far; nine numbers per frequency of the
    /// box.
    to_box: Vec<f32>,
    /// Place in this grid's spectrum of each frequency of the box.
    places: Vec<Option<u32>>,
    /// What a force into the pad does to itself, and the length of the wave vector, rad/mm, at the frequencies from 0 up
    /// along x and y.
    pressed_compliance: Grid<[f32; 2]>,
    inverse: KernelSpectrum,
    largest_compliance: f32,
    /// Displacement of a node under its own force.
    own_compliance: f32,
    spectra: PlaneSpectrum,
    convolution_buffers: [ConvolutionBuffers; 3],
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
    /// Nodes along x and y.
    size: [usize; 2],
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
        let modulus = 2.0 * (1.0 + pad.poisson_ratio);
        // The exact compliance of the linear layer, and the length of the wave vector.
        let exact = |numbers: [usize; 2]| -> ([f64; 6], f64) {
            let (angles, highest) = transform.angles_of(numbers);
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
            let factors = [
                h * cos * cos + t * sin * sin,
                odd * (h - t) * cos * sin,
                odd * c * cos,
                h * sin * sin + t * cos * cos,
                odd * c * sin,
                g,
            ];
            (factors, length)
        };
        let [width, height] = size;
        let mut pressed_compliance = Grid::new(width / 2 + 1, height / 2 + 1);
        let (mut largest_compliance, mut counted) = (0.0_f32, 0.0);
        let norm = 1.0 / (width * height) as f64;
        let compliance = FrequencyFactors::new(size, |[x, y]| {
            let (factors, length) = exact([x, y]);
            let pressed = factors[5] as f32;
            pressed_compliance.row_mut(y)[x] = [pressed, length as f32];
            largest_compliance = largest_compliance.max(pressed);
            // A frequency stands for its mirror images as well.
            let images = [(x, width), (y, height)].map(|(at, size)| if at == 0 || 2 * at == size { 1.0 } else { 2.0 });
            counted += images[0] * images[1] * f64::from(pressed);
            factors.map(|factor| (factor * norm) as f32)
        });
        let own_compliance = (counted * norm) as f32;
        let numbers = transform.numbers_of_coarser(&layer.transform);
        let coarse = layer.transform.frequencies();
        let mut to_box = vec![0.0_f32; 9 * coarse];
        for (at, numbers) in numbers.iter().enumerate() {
            let Some(numbers) = numbers else { continue };
            let ([xx, xy, xz, yy, yz, zz], _) = exact(*numbers);
            let here: Matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
            let ratio = times(&inverse(&layer.surface_compliance(at)), &here);
            for r in 0..3 {
                for c in 0..3 {
                    // A displacement's spectrum is a sum over nodes, of which this grid has more.
                    to_box[(r * 3 + c) * coarse + at] = ratio[r][c] as f32 / (REFINEMENT * REFINEMENT) as f32;
                }
            }
        }
        let place = |numbers: &Option<[usize; 2]>| numbers.map(|numbers| transform.place_of(numbers) as u32);
        let places = numbers.iter().map(place).collect();
        let count = transform.frequencies();
        let planes = |count: usize| [0, 1, 2].map(|_| HalfSpectrum::zeros(count));
        Self {
            spacing_mm,
            compliance,
            to_box,
            places,
            pressed_compliance,
            inverse: KernelSpectrum::default(),
            largest_compliance,
            own_compliance,
            spectra: planes(count),
            convolution_buffers: Default::default(),
            box_spectra: planes(coarse),
            box_forces: planes(coarse),
            buffers: LcpBuffers::default(),
            pressed: Default::default(),
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
        self.displace_box(self.transform.size(), force, displacement);
    }

    /// Writes the displacement in a box of `size` nodes under forces in it.
    fn displace_box(&mut self, size: [usize; 2], force: &Field, displacement: &mut Field) {
        self.transform.convolution(size).convolve_fields::<InSpace, 3, 6>(
            &self.compliance,
            force.each_ref().map(|part| &part[..]),
            &mut displacement.each_mut().map(|part| &mut part[..]),
            &mut self.convolution_buffers,
        );
    }

    /// Makes the approximate inverse of the compliance for a contact of this size, mm.
    pub fn prepare_inverse(&mut self, pad: ElasticLayer, size_mm: f64) {
        let cutoff = std::f64::consts::PI / size_mm;
        let scale = 1.0 / (self.spacing_mm[0] * self.spacing_mm[1]) / (2.0 * (1.0 + pad.poisson_ratio));
        let longest = 1.0 / (scale * pad.normal_compliance(cutoff));
        self.inverse = KernelSpectrum::from_factors(self.transform.size(), |[x, y]| {
            let [compliance, wave] = self.pressed_compliance.at(x, y);
            if f64::from(wave) < cutoff { longest as f32 } else { 1.0 / compliance }
        });
    }

    /// Computes approximately the forces in a box of `size` nodes under displacements in it, along one axis.
    fn invert_box(&mut self, size: [usize; 2], displacement: &[f32], force: &mut [f32]) {
        let [buffers, ..] = &mut self.convolution_buffers;
        self.transform.convolution(size).convolve_rows(&self.inverse, displacement, force, buffers);
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
        self.solve_in_region(&conditions, region, pressure, tolerance_mm);
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
        for (displacement, force) in displacement.iter().zip(force) {
            self.invert_box(self.transform.size(), displacement, force);
        }
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
        Conditions { size: self.transform.size(), normal, overlap }
    }

    /// Solves for the pressures in the part of the grid outside which there are none.
    fn solve_in_region(&mut self, conditions: &Conditions, region: Rect, pressure: &mut [f32], tolerance_mm: f32) {
        if region.is_empty() {
            return;
        }
        let width = self.transform.size()[0];
        let part = |whole: &Vec<f32>| take_part(whole, width, region);
        let inside = Conditions {
            size: [region.width(), region.height()],
            normal: conditions.normal.each_ref().map(part),
            overlap: part(&conditions.overlap),
        };
        let mut pressure_inside = take_part(pressure, width, region);
        self.solve_conditions(&inside, &mut pressure_inside, tolerance_mm);
        paste_part(&pressure_inside, pressure, width, region);
    }

    /// Writes how far pressures along the normals move the nodes along them.
    fn respond(&mut self, conditions: &Conditions, pressure: &[f32], moved: &mut [f32]) {
        let [mut force, mut response] = std::mem::take(&mut self.pressed);
        for part in force.iter_mut().chain(&mut response) {
            part.resize(pressure.len(), 0.0);
        }
        for c in 0..3 {
            for ((force, n), p) in force[c].iter_mut().zip(&conditions.normal[c]).zip(pressure) {
                *force = n * p;
            }
        }
        self.displace_box(conditions.size, &force, &mut response);
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
            self.invert_box(conditions.size, residual, step);
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

/// Returns a part of a grid with `width` columns, row by row.
pub fn take_part(whole: &[f32], width: usize, part: Rect) -> Vec<f32> {
    (part.y0..part.y1).flat_map(|y| &whole[y * width..][part.x0..part.x1]).copied().collect()
}

/// Writes what [`take_part`] took.
pub fn paste_part(values: &[f32], whole: &mut [f32], width: usize, part: Rect) {
    for (y, row) in (part.y0..part.y1).zip(values.chunks(part.width().max(1))) {
        whole[y * width..][part.x0..part.x1].copy_from_slice(row);
    }
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(x) / x }
}

/// Computes the scalar product, in eight partial sums.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0_f64; 8];
    simd_dispatch(
        #[inline(always)]
        || {
            for (a, b) in a.iter().zip(b) {
                for k in 0..8 {
                    sums[k] += f64::from(a[k] * b[k]);
                }
            }
        },
    );
    sums.iter_mut().zip(a_rest.iter().zip(b_rest)).for_each(|(sum, (a, b))| *sum += f64::from(a * b));
    sums.iter().sum()
}
