//! Friction with history: tractions are carried from one step of a sequence to the next.
//!
//! All fields are kept in a frame that moves with the object in the pad's plane. The layer is the same everywhere and
//! in all directions, so its response in the frame is the same, too. A point of the pad that sticks stays in one pixel;
//! nothing is resampled from step to step, so nothing gets lost in slow motion. The pressure is not affected by the
//! tractions (Goodman 1962).
//!
//! When the object turns, the mean displacement under it keeps its direction in the pad. What differs from the mean
//! winds up with the object, as in linear torsion: under an object that slips all around, displacements stay as they
//! are in the frame, so tractions follow the object's velocity. Slip then turns into heat what the work of the
//! tractions does not store. With displacements u and tractions t, the stored energy t.u / 2 changes in a step by the
//! mean of t before and after times the change of u in the frame.

use super::coulomb::{self, TractionOutcome};
use super::in_plane::{Load, TractionField};
use super::layer::ElasticLayer;
use super::traction_grid::{TractionGrid, Vector, vector_length};
use crate::base::angle::PlanarRotation;
use crate::base::grid::{Grid, Rect, bounding_box};

/// Tolerance of the tractions as a share of a step's motion; with a looser one, slip would drift at high frame rates.
const TOLERANCE_SHARE: f64 = 0.05;

/// Smallest tolerance, mm.
const FINEST_MM: f64 = 1e-7;

/// Slip in a step below which a point rests, as a multiple of the displacements' rounding error.
const REST: f64 = 2.0;

/// Room around the contact, in thicknesses, so that its copies on the torus have no influence.
const ROOM: f64 = 6.0;

/// Motion of the frame in the pad's plane during a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameMotion {
    /// Translation of the frame's origin along its axes before the motion, mm.
    pub shift_mm: [f64; 2],
    /// Rotation from x towards y, rad; at most a few degrees.
    pub turn_rad: f64,
}

/// What the pad remembers in a step of the loads before it; nothing, if it does not relax.
#[derive(Clone, Copy)]
pub struct RelaxedPad<'a> {
    /// Stiffness of the layer over that of an elastic one.
    pub stiffness: f64,
    /// Motion in the pad's plane by the remembered loads, mm, at a point of the frame.
    pub motion_at: Option<&'a dyn Fn([f64; 2]) -> [f64; 2]>,
}

impl Default for RelaxedPad<'_> {
    fn default() -> Self {
        Self { stiffness: 1.0, motion_at: None }
    }
}

/// The pressure of a step.
pub enum StepPressure<'a> {
    /// The pressure of the step before.
    Unchanged,
    /// A new pressure in the frame, whose pixels are a whole number of pixels from those of every other step.
    Load(&'a Load),
    /// There is no contact.
    NoContact,
}

/// Result of a step. Forces are over Young's modulus and act on the pad, along the frame's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepOutcome {
    /// Result of the traction solver.
    pub solver: TractionOutcome,
    /// Number of pixels in contact.
    pub touching: usize,
    /// Number of pixels that stick, including those that came into contact in this step.
    pub sticking: usize,
    /// True if none of the pixels that touched before sticks: gross slip.
    pub gross: bool,
    /// Slip of the pad under the object, mm; the mean over the contact.
    pub slip_mm: [f64; 2],
    /// Energy that slip turned into heat, mm^3.
    pub heat: f64,
}

/// Force and moment on the pad over Young's modulus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactForces {
    /// Tangential force along x and y, mm^2.
    pub force: [f64; 2],
    /// Normal force into the pad, mm^2.
    pub normal: f64,
    /// Moment of the tangential force about the frame's origin, from x towards y, mm^3.
    pub moment: f64,
    /// First moments of the pressure: its integral times x and y, mm^3.
    pub pressure_moment: [f64; 2],
}

/// The friction state that is carried from step to step.
#[derive(Clone)]
pub struct FrictionHistory {
    layer: ElasticLayer,
    /// Coefficient of friction; infinite where nothing slips.
    coefficient: f64,
    mm_per_px: [f64; 2],
    tolerance_mm: f64,
    contact: Option<ContactFields>,
}

/// The fields of a contact, all on the pixels of `grid`.
#[derive(Clone)]
struct ContactFields {
    grid: TractionGrid,
    /// The grid with room around it, for effects beyond the contact.
    padded_grid: TractionGrid,
    /// The box's first pixel, counted from the one at the frame's origin.
    first: [i64; 2],
    pressure: Grid<f32>,
    /// Tractions over Young's modulus.
    tractions: Grid<Vector>,
    /// Change of the tractions in the last step; the next step often repeats it.
    change: Grid<Vector>,
    /// Where the object holds each point of the pad, mm from its rest position; for points that are not held, where
    /// they are.
    anchors: Grid<[f64; 2]>,
    /// Motion of each point under the pressure and the remembered loads, mm.
    pressure_motion: Grid<Vector>,
    /// Whether each point slipped in the last step.
    slips: Grid<bool>,
}

impl FrictionHistory {
    /// Starts without contact. Pixels are `mm_per_px` apart. Tractions are solved to `tolerance_mm`, or finer where
    /// steps are small.
    pub fn new(layer: ElasticLayer, coefficient: f64, mm_per_px: [f64; 2], tolerance_mm: f64) -> Self {
        Self { layer, coefficient, mm_per_px, tolerance_mm, contact: None }
    }

    /// Advances the object by one step: the frame moves by `moved`, under a new pressure or the same one.
    pub fn step(&mut self, normal: &StepPressure<'_>, moved: FrameMotion) -> StepOutcome {
        self.step_on_relaxed_pad(normal, moved, RelaxedPad::default())
    }

    /// Advances the object by one step on a pad that remembers loads.
    pub fn step_on_relaxed_pad(
        &mut self,
        normal: &StepPressure<'_>,
        moved: FrameMotion,
        pad: RelaxedPad<'_>,
    ) -> StepOutcome {
        match normal {
            StepPressure::NoContact => {
                // All that the tractions have stored is lost to slip while the object lifts off.
                let heat = self.contact.take().map_or(0.0, |mut contact| contact.stored_energy(pad.stiffness));
                return StepOutcome { heat, ..StepOutcome::default() };
            }
            StepPressure::Unchanged => {}
            StepPressure::Load(load) => self.grow_contact_box(load, pad),
        }
        let Some(contact) = &mut self.contact else { return StepOutcome::default() };
        let before = match normal {
            StepPressure::Load(load) => {
                let pressure = contact.place_load(load, self.mm_per_px);
                Some(std::mem::replace(&mut contact.pressure, pressure))
            }
            _ => None,
        };
        contact.solve_step(before.as_ref(), self.coefficient, moved, (self.tolerance_mm, pad))
    }

    /// Returns force and moment of the last step.
    pub fn contact_forces(&self) -> ContactForces {
        self.contact.as_ref().map_or_else(ContactForces::default, ContactFields::contact_forces)
    }

    /// Returns the tractions: position of each pixel in the frame, mm, and force on it over Young's modulus, mm^2.
    pub fn traction_forces(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        self.contact.iter().flat_map(|contact| {
            let area = contact.pixel_area_mm2();
            let pixels = (0..contact.tractions.height).flat_map(|y| (0..contact.tractions.width).map(move |x| [x, y]));
            let force = move |[x, y]: [usize; 2]| {
                let t = contact.tractions.at(x, y);
                (t != [0.0; 2]).then(|| (contact.pixel_centre_mm(x, y), t.map(|part| area * f64::from(part))))
            };
            pixels.filter_map(force)
        })
    }

    /// Returns the pressure: position of each pixel in the frame, mm, and normal force on it over Young's modulus,
    /// mm^2.
    pub fn pressure_forces(&self) -> impl Iterator<Item = ([f64; 2], f64)> {
        self.contact.iter().flat_map(|contact| {
            let area = contact.pixel_area_mm2();
            let pixels = (0..contact.pressure.height).flat_map(|y| (0..contact.pressure.width).map(move |x| [x, y]));
            let force = move |[x, y]: [usize; 2]| {
                let p = contact.pressure.at(x, y);
                (p > 0.0).then(|| (contact.pixel_centre_mm(x, y), area * f64::from(p)))
            };
            pixels.filter_map(force)
        })
    }

    /// Returns tractions and pressure of the last step on the same pixels, in the frame; `None` without contact.
    pub fn traction_field(&self) -> Option<(TractionField, Grid<f32>)> {
        let contact = self.contact.as_ref()?;
        let ContactFields { grid, tractions, pressure, .. } = contact;
        let part = |k: usize| Grid {
            width: tractions.width,
            height: tractions.height,
            data: tractions.data.iter().map(|t| t[k]).collect(),
        };
        let field = TractionField { x: part(0), y: part(1), origin_mm: grid.origin_mm, mm_per_px: grid.mm_per_px };
        Some((field, pressure.clone()))
    }

    /// Returns true if there are no tractions.
    pub fn has_no_tractions(&self) -> bool {
        self.contact.as_ref().is_none_or(ContactFields::has_no_tractions)
    }

    /// Returns the state of the pad at a point of the frame.
    pub fn state_at(&self, place_mm: [f64; 2]) -> StickSlip {
        let Some(contact) = &self.contact else { return StickSlip::Apart };
        let pixel: [f64; 2] =
            std::array::from_fn(|k| libm::round((place_mm[k] - contact.grid.origin_mm[k]) / contact.grid.mm_per_px[k]));
        if (0..2).any(|k| pixel[k] < 0.0 || pixel[k] >= contact.grid.size[k] as f64) {
            return StickSlip::Apart;
        }
        let [x, y] = pixel.map(|at| at as usize);
        match (contact.pressure.at(x, y) > 0.0, contact.slips.at(x, y)) {
            (false, _) => StickSlip::Apart,
            (true, false) => StickSlip::Sticks,
            (true, true) => StickSlip::Slips,
        }
    }

    /// Returns the state of the pad at a point of the frame that is in contact. Pixels of the tractions are coarser than
    /// those of the camera: at the rim it is that of the pixels beside, of which one that sticks holds the point.
    pub fn state_near(&self, place_mm: [f64; 2]) -> StickSlip {
        let itself = self.state_at(place_mm);
        let Some(contact) = self.contact.as_ref().filter(|_| itself == StickSlip::Apart) else { return itself };
        let [dx, dy] = contact.grid.mm_per_px;
        let steps = [-1.0, 0.0, 1.0];
        let beside =
            |dy_px: f64| steps.map(|dx_px| self.state_at([place_mm[0] + dx_px * dx, place_mm[1] + dy_px * dy]));
        match steps.map(beside).as_flattened().contains(&StickSlip::Sticks) {
            true => StickSlip::Sticks,
            false => StickSlip::Slips,
        }
    }

    /// Returns the displacement into the pad by the tractions, mm, over the contact and some thicknesses around it, and
    /// the position of its first pixel in the frame. `None` without tractions.
    pub fn normal_displacement(&mut self) -> Option<(Grid<f32>, [f64; 2])> {
        // On a pad that remembers loads, it is that on an elastic layer.
        self.contact.as_mut().and_then(ContactFields::normal_displacement)
    }

    /// Enlarges the box, if necessary, to the contact of a load with some pixels around it.
    fn grow_contact_box(&mut self, load: &Load, pad: RelaxedPad<'_>) {
        let part = bounding_box(&load.pressure, |p| p > 0.0);
        let corner = first_pixel(load.origin_mm, self.mm_per_px);
        let low = [corner[0] + part.x0 as i64, corner[1] + part.y0 as i64];
        let high = [corner[0] + part.x1 as i64, corner[1] + part.y1 as i64];
        if let Some(contact) = &self.contact {
            let end = [0, 1].map(|k| contact.first[k] + contact.grid.size[k] as i64);
            if (0..2).all(|k| contact.first[k] <= low[k] && high[k] <= end[k]) {
                return;
            }
        }
        let (mut low, mut high) = (low, high);
        let old = self.contact.as_ref().map(|contact| {
            let old = bounding_box(&contact.pressure, |p| p > 0.0);
            [[old.x0, old.x1], [old.y0, old.y1]].map(|ends| ends.map(|at| at as i64))
        });
        if let (Some(contact), Some(old)) = (&self.contact, old)
            && (0..2).any(|k| contact.first[k] + old[k][1] <= low[k] || high[k] <= contact.first[k] + old[k][0])
        {
            // A different contact: nothing that touched still does, and a box around both might be very large.
            self.contact = None;
        }
        if let (Some(contact), Some(old)) = (&self.contact, old) {
            // Everything that was in contact, and everything that is.
            for k in 0..2 {
                let [from, to] = old[k].map(|at| contact.first[k] + at);
                (low[k], high[k]) = (low[k].min(from), high[k].max(to));
            }
        }
        let spare = (0..2).map(|k| (high[k] - low[k]) / 3).max().unwrap_or(0).max(8);
        let first = low.map(|at| at - spare);
        let size = [0, 1].map(|k| (high[k] - low[k] + 2 * spare) as usize);
        let origin_mm = [0, 1].map(|k| (first[k] as f64 + 0.5) * self.mm_per_px[k]);
        let box_px = Rect::whole(size[0], size[1]);
        let mut padded_grid = TractionGrid::new(self.layer, [origin_mm, self.mm_per_px], box_px, usize::MAX, ROOM);
        let [width, height] = size;
        let mut next = ContactFields {
            grid: padded_grid.free_space_grid(),
            padded_grid,
            first,
            pressure: Grid::new(width, height),
            tractions: Grid::new(width, height),
            change: Grid::new(width, height),
            anchors: Grid::new(width, height),
            pressure_motion: Grid::new(width, height),
            slips: Grid::new(width, height),
        };
        if let Some(contact) = &self.contact {
            let [dx, dy] = [0, 1].map(|k| contact.first[k] - first[k]);
            let within = |x: usize, y: usize| -> Option<[usize; 2]> {
                let [x, y] = [x as i64 + dx, y as i64 + dy];
                ((0..width as i64).contains(&x) && (0..height as i64).contains(&y)).then_some([x as usize, y as usize])
            };
            for y in 0..contact.pressure.height {
                for x in 0..contact.pressure.width {
                    if let Some([column, row]) = within(x, y) {
                        next.pressure.row_mut(row)[column] = contact.pressure.at(x, y);
                        next.tractions.row_mut(row)[column] = contact.tractions.at(x, y);
                    }
                }
            }
            // Outside the old box, the position of the pad follows from the loads on it.
            next.pressure_motion = next.motion_without_tractions(pad);
            let moved = next.motion_under_tractions(pad.stiffness);
            for (hold, (u, free)) in next.anchors.data.iter_mut().zip(moved.data.iter().zip(&next.pressure_motion.data))
            {
                *hold = [0, 1].map(|k| f64::from(u[k]) + f64::from(free[k]));
            }
            for y in 0..contact.anchors.height {
                for x in 0..contact.anchors.width {
                    if let Some([column, row]) = within(x, y) {
                        next.anchors.row_mut(row)[column] = contact.anchors.at(x, y);
                    }
                }
            }
        }
        self.contact = Some(next);
    }
}

/// State of the pad at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StickSlip {
    /// There is no contact.
    #[default]
    Apart,
    /// The pad slides along the object.
    Slips,
    /// The pad moves with the object.
    Sticks,
}

/// Returns the pixel whose centre is at a point, counted from the pixel that begins at the frame's origin.
fn first_pixel(origin_mm: [f64; 2], mm_per_px: [f64; 2]) -> [i64; 2] {
    [0, 1].map(|k| libm::round(origin_mm[k] / mm_per_px[k] - 0.5) as i64)
}

/// Returns the work of a traction along a slip of the pad under the object, per area. The traction changes from the
/// first to the second, its limit too. Slip begins where the traction meets the limit, and goes on at the limit.
fn friction_work([first, last]: [Vector; 2], [limit_before, limit]: [f32; 2], slip: [f64; 2]) -> f64 {
    let length = libm::hypot(slip[0], slip[1]);
    let against = |t: Vector| -(f64::from(t[0]) * slip[0] + f64::from(t[1]) * slip[1]) / length;
    let [low, high] = [limit_before.min(limit), limit_before.max(limit)].map(f64::from);
    if length > 0.0 { 0.5 * length * (against(first).clamp(low, high) + against(last)) } else { 0.0 }
}

/// Divides motions by the stiffness of the layer over that of an elastic one.
fn divide_by_stiffness(moved: &mut Grid<Vector>, stiffness: f64) {
    if stiffness != 1.0 {
        let share = (1.0 / stiffness) as f32;
        moved.data.iter_mut().flatten().for_each(|mm| *mm *= share);
    }
}

impl ContactFields {
    fn pixel_area_mm2(&self) -> f64 {
        self.grid.mm_per_px[0] * self.grid.mm_per_px[1]
    }

    fn pixel_centre_mm(&self, x: usize, y: usize) -> [f64; 2] {
        let at = [x, y];
        [0, 1].map(|k| self.grid.origin_mm[k] + at[k] as f64 * self.grid.mm_per_px[k])
    }

    /// Returns a load on the box's pixels.
    fn place_load(&self, load: &Load, mm_per_px: [f64; 2]) -> Grid<f32> {
        let corner = first_pixel(load.origin_mm, mm_per_px);
        let mut pressure = Grid::new(self.grid.size[0], self.grid.size[1]);
        let part = bounding_box(&load.pressure, |p| p > 0.0);
        for y in part.y0..part.y1 {
            let row = (corner[1] + y as i64 - self.first[1]) as usize;
            for x in part.x0..part.x1 {
                let column = (corner[0] + x as i64 - self.first[0]) as usize;
                pressure.row_mut(row)[column] = load.pressure.at(x, y).max(0.0);
            }
        }
        pressure
    }

    /// Returns the centre of a pressure in the frame, and the mean of the anchors by that pressure, mm.
    fn mean_anchor(&self, pressure: &Grid<f32>) -> [[f64; 2]; 2] {
        let (mut centre, mut mean, mut sum) = ([0.0; 2], [0.0; 2], 0.0);
        for y in 0..pressure.height {
            for (x, p) in pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let (p, place, hold) = (f64::from(*p), self.pixel_centre_mm(x, y), self.anchors.at(x, y));
                centre = [0, 1].map(|k| centre[k] + p * place[k]);
                mean = [0, 1].map(|k| mean[k] + p * hold[k]);
                sum += p;
            }
        }
        if sum > 0.0 { [centre, mean].map(|sums| sums.map(|part| part / sum)) } else { [[0.0; 2]; 2] }
    }

    /// Returns the part of a vector along the sum of the tractions.
    fn part_along_force(&self, vector: [f64; 2]) -> [f64; 2] {
        let force = self.tractions.data.iter().fold([0.0; 2], |sum, t| [0, 1].map(|k| sum[k] + f64::from(t[k])));
        let square = force[0] * force[0] + force[1] * force[1];
        let along = (vector[0] * force[0] + vector[1] * force[1]) / square;
        if square > 0.0 { force.map(|part| along * part) } else { [0.0; 2] }
    }

    /// Returns the energy that the tractions have stored, over Young's modulus, mm^3.
    fn stored_energy(&mut self, stiffness: f64) -> f64 {
        let moved = self.motion_under_tractions(stiffness);
        let work = |(t, u): (&Vector, &Vector)| f64::from(t[0]) * f64::from(u[0]) + f64::from(t[1]) * f64::from(u[1]);
        let sum: f64 = self.tractions.data.iter().zip(&moved.data).map(work).sum();
        0.5 * sum * self.pixel_area_mm2()
    }

    /// Computes the motion under the pressure and the remembered loads.
    fn motion_without_tractions(&mut self, pad: RelaxedPad<'_>) -> Grid<Vector> {
        self.padded_grid.set_whole_contact(&self.pressure);
        let mut moved = self.padded_grid.motion_under_pressure();
        divide_by_stiffness(&mut moved, pad.stiffness);
        if let Some(motion_at) = pad.motion_at {
            for y in 0..moved.height {
                for x in 0..moved.width {
                    let more = motion_at(self.pixel_centre_mm(x, y));
                    let sum = &mut moved.row_mut(y)[x];
                    *sum = [0, 1].map(|k| (f64::from(sum[k]) + more[k]) as f32);
                }
            }
        }
        moved
    }

    /// Computes the motion under the tractions alone.
    fn motion_under_tractions(&mut self, stiffness: f64) -> Grid<Vector> {
        let mut moved = self.grid.motion_under_tractions(&self.tractions);
        divide_by_stiffness(&mut moved, stiffness);
        moved
    }

    /// Solves for the tractions of a step. `before` is the pressure of the last step, if it has changed.
    fn solve_step(
        &mut self,
        before: Option<&Grid<f32>>,
        coefficient: f64,
        moved: FrameMotion,
        (tolerance_mm, pad): (f64, RelaxedPad<'_>),
    ) -> StepOutcome {
        // The motion under the pressure is computed again only if the pressure has changed.
        let free = if before.is_some() { self.motion_without_tractions(pad) } else { self.pressure_motion.clone() };
        // The object takes its point at the contact's centre C by R^T m + C - R^T C, and winds up what lies around it.
        let turn = PlanarRotation::new(moved.turn_rad);
        let [centre, mean] = self.mean_anchor(before.unwrap_or(&self.pressure));
        // The mean displacement keeps its direction in the pad: its part along the force if anything may slip. Across the
        // force the turn would do work on it that no one supplies.
        let mean = if coefficient.is_finite() { self.part_along_force(mean) } else { mean };
        let (shift, ahead) = (turn.rotate_back(moved.shift_mm), turn.offset_from_inverse(centre));
        let mean_turned = turn.rotate_back(mean);
        // Without a turn these differences are exactly 0.
        let shift = [0, 1].map(|k| shift[k] + ahead[k] + (mean_turned[k] - mean[k]));
        let driven = |[x, y]: [f64; 2]| {
            let [dx, dy] = [x - centre[0], y - centre[1]];
            [shift[0] - moved.turn_rad * dy, shift[1] + moved.turn_rad * dx]
        };
        let [width, height] = self.grid.size;
        let mut limits = Grid::<f32>::new(width, height);
        let (mut push_mm, mut touching, mut joined) = (0.0_f64, 0, 0);
        let mut wanted = self.anchors.clone();
        for y in 0..height {
            for x in 0..width {
                let p = self.pressure.at(x, y);
                let drive = driven(self.pixel_centre_mm(x, y));
                let [new, old] = [free.at(x, y), self.pressure_motion.at(x, y)].map(|v| v.map(f64::from));
                let hold = wanted.at(x, y);
                wanted.row_mut(y)[x] = [0, 1].map(|k| hold[k] + drive[k] - new[k]);
                if p > 0.0 {
                    touching += 1;
                    let push = [0, 1].map(|k| drive[k] - new[k] + old[k]);
                    push_mm = push_mm.max(libm::hypot(push[0], push[1]));
                    // Pixels that join do so at the end of the step, and stick.
                    match before.is_none_or(|before| before.at(x, y) > 0.0) {
                        true => limits.row_mut(y)[x] = (coefficient * f64::from(p)) as f32,
                        false => joined += 1,
                    }
                }
            }
        }
        let tolerance_mm = tolerance_mm.min((TOLERANCE_SHARE * push_mm).max(FINEST_MM));
        self.grid.set_whole_contact(&limits);
        let pixels: Vec<[usize; 2]> = self.grid.points.iter().map(|point| point.pixel).collect();
        let bounds: Vec<f32> = self.grid.points.iter().map(|point| point.pressure).collect();
        // On a layer of another stiffness, the same tractions belong to displacements in proportion.
        let at = |[x, y]: [usize; 2]| wanted.at(x, y).map(|mm| (pad.stiffness * mm) as f32);
        let wanted_there: Vec<Vector> = pixels.iter().map(|pixel| at(*pixel)).collect();
        let guess = |&[x, y]: &[usize; 2]| {
            let (t, more) = (self.tractions.at(x, y), self.change.at(x, y));
            [0, 1].map(|k| t[k] + more[k])
        };
        let mut tractions: Vec<Vector> = pixels.iter().map(guess).collect();
        let solved = coulomb::solve_tractions(
            &mut self.grid,
            &bounds,
            &wanted_there,
            &mut tractions,
            pad.stiffness * tolerance_mm,
        );

        let earlier = std::mem::replace(&mut self.tractions, Grid::new(width, height));
        self.change.data.fill([0.0; 2]);
        for (&[x, y], t) in pixels.iter().zip(&tractions) {
            let last = earlier.at(x, y);
            self.tractions.row_mut(y)[x] = *t;
            self.change.row_mut(y)[x] = [0, 1].map(|k| t[k] - last[k]);
        }
        let moved = self.motion_under_tractions(pad.stiffness);
        let mut step = StepOutcome {
            solver: solved,
            touching,
            sticking: joined,
            gross: !pixels.is_empty(),
            ..StepOutcome::default()
        };
        // Where the pad slips and outside the contact, the anchor is where the pad is. Where it sticks, the anchor is
        // where the object wants it: with the solver's result, its remaining errors would add up.
        let mut hold = Grid::new(width, height);
        for y in 0..height {
            for x in 0..width {
                let (u, free) = (moved.at(x, y), free.at(x, y));
                hold.row_mut(y)[x] = [0, 1].map(|k| f64::from(u[k]) + f64::from(free[k]));
            }
        }
        // A point slips if its traction is at the limit and the object has left it behind. What is at its limit and rests,
        // as after a slide, sticks.
        let own_mm = self.grid.own_response();
        let rest_mm = REST * solved.rounding_mm.max(FINEST_MM);
        self.slips.data.fill(false);
        for ((&[x, y], t), limit) in pixels.iter().zip(&tractions).zip(&bounds) {
            let (free, wanted) = (free.at(x, y).map(f64::from), wanted.at(x, y));
            let anchor = [0, 1].map(|k| wanted[k] + free[k]);
            let there = &mut hold.row_mut(y)[x];
            let slip = [0, 1].map(|k| there[k] - anchor[k]);
            let left_mm = slip.map(|mm| (-pad.stiffness * mm) as f32);
            let (_, is_limited) = coulomb::limited_trial(*t, left_mm, *limit, own_mm);
            if !is_limited || f64::from(vector_length(left_mm)) <= rest_mm {
                *there = anchor;
                step.sticking += 1;
                step.gross = false;
            } else {
                self.slips.row_mut(y)[x] = true;
                step.slip_mm = [0, 1].map(|k| step.slip_mm[k] + slip[k]);
                let held_before = before.map_or(*limit, |before| (coefficient * f64::from(before.at(x, y))) as f32);
                step.heat += friction_work([earlier.at(x, y), *t], [held_before, *limit], slip);
            }
        }
        // What has left the contact slipped on its way.
        for (at, t) in earlier.data.iter().enumerate().filter(|(_, t)| **t != [0.0; 2]) {
            if limits.data[at] <= 0.0 {
                let slip = [0, 1].map(|k| hold.data[at][k] - wanted.data[at][k] - f64::from(free.data[at][k]));
                step.heat += friction_work([*t, [0.0; 2]], [vector_length(*t), 0.0], slip);
            }
        }
        // Pixels with a limit of 0 have no traction; they slip if they touched before.
        for y in 0..height {
            for x in 0..width {
                let joins = before.is_some_and(|before| before.at(x, y) <= 0.0);
                if self.pressure.at(x, y) > 0.0 && limits.at(x, y) <= 0.0 && !joins {
                    self.slips.row_mut(y)[x] = true;
                    let (there, free, wanted) = (hold.at(x, y), free.at(x, y), wanted.at(x, y));
                    step.slip_mm = [0, 1].map(|k| step.slip_mm[k] + there[k] - wanted[k] - f64::from(free[k]));
                    step.gross |= step.sticking == joined;
                }
            }
        }
        step.heat *= self.pixel_area_mm2();
        step.slip_mm = step.slip_mm.map(|sum| sum / touching.max(1) as f64);
        if coefficient == 0.0 {
            self.slips.data.fill(true);
            step.sticking = 0;
            step.gross = touching > 0;
        }
        (self.anchors, self.pressure_motion) = (hold, free);
        step
    }

    fn contact_forces(&self) -> ContactForces {
        let mut sums = ContactForces::default();
        let area = self.pixel_area_mm2();
        for y in 0..self.pressure.height {
            for (x, p) in self.pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let place = self.pixel_centre_mm(x, y);
                let p = area * f64::from(*p);
                let t = self.tractions.at(x, y).map(|part| area * f64::from(part));
                sums.normal += p;
                sums.pressure_moment = [0, 1].map(|k| sums.pressure_moment[k] + p * place[k]);
                sums.force = [0, 1].map(|k| sums.force[k] + t[k]);
                sums.moment += place[0] * t[1] - place[1] * t[0];
            }
        }
        sums
    }

    fn has_no_tractions(&self) -> bool {
        self.tractions.data.iter().all(|t| *t == [0.0; 2])
    }

    fn normal_displacement(&mut self) -> Option<(Grid<f32>, [f64; 2])> {
        if self.has_no_tractions() {
            return None;
        }
        let reach = self.padded_grid.reach_px(0.5 * ROOM);
        let down = self.padded_grid.normal_displacement(&self.tractions, reach);
        let origin_mm = [0, 1].map(|k| self.grid.origin_mm[k] - reach[k] as f64 * self.grid.mm_per_px[k]);
        Some((down, origin_mm))
    }
}
