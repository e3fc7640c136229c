//! Friction while the object is pressed in: the surface under it cannot slide, or only as far as Coulomb's law lets it.
//!
//! Pressure alone moves the surface along itself, u = i C p ([`super::layer`]). Where friction holds it, tractions t take it
//! back, and displace it by -i C t into the pad in turn; the pressure makes up for that. Pressure and tractions are solved
//! for in turn until neither changes: both operators come from one energy, so that each turn leaves a share of at most
//! C^2 / (G H) of the error, and extrapolation after Aitken (Irons and Tuck 1969) shortens the rest.
//!
//! What tractions displace is smooth on the scale of the contact. It is solved for on a grid that is as fine as the
//! contact needs and no finer than the pad's own; there the press is then one without friction, into a pad that is
//! displaced already ([`Drag`]).

use super::grip::{Grip, Point, Vector};
use super::lattice::Lattice;
use super::model_error::{ContactEdge, force_over_linear};
use super::shear::Friction;
use super::walls::Thinned;
use super::{Given, Pad, Solution};
use crate::base::cubic::catmull_rom;
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;
use crate::effects::Requirement;
use crate::gelpad::Contact;

/// The longer side of the contact has at most so many pixels of the grid on which pressure and tractions are solved for in
/// turn, as long as there is a grid so coarse.
const PRESSURE_PX: usize = 64;

/// The longer side of the contact has at most so many pixels of the tractions' grid.
const TRACTION_PX: usize = 40;

/// Turns after which to give up.
const MOST_TURNS: u32 = 20;

/// Turns after which steps get shorter: pixels at the edge may touch in one turn and not in the next.
const FREE_TURNS: u32 = 7;

/// Room around the contact, so that the torus's copies are not felt, thicknesses.
const ROOM: f64 = 4.0;

/// What may change from turn to turn where pixels come and go, in what does not count.
const SETTLED: f32 = 6.0;

/// How far beyond the contact tractions displace the pad, thicknesses.
const REACH: f64 = 0.5 * ROOM;

/// What is a share of the tolerance does not count.
const UNSEEN: f64 = 0.5;

/// Displacement into the pad by the tractions under an object.
#[derive(Clone, Debug)]
pub struct Drag {
    /// mm; 0 at the border.
    down: Grid<f32>,
    placed: Placed,
    /// Share of the contact that slips.
    slipping: f64,
    /// Whether it was solved for within the tolerance.
    pub converged: bool,
}

/// Where the pixels of a grid lie in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    /// Centre of the first pixel.
    pub origin_mm: [f64; 2],
    pub mm_per_px: [f64; 2],
}

impl Placed {
    fn centre_mm(self, k: usize, at: usize) -> f64 {
        self.origin_mm[k] + at as f64 * self.mm_per_px[k]
    }
}

impl Pad {
    /// The friction while pressing.
    pub fn friction(&self) -> Option<Friction> {
        self.elastic.friction
    }

    /// Whether friction can be seen: in the surface, or in `markers`.
    pub fn friction_required(&self, depth: &Depth, markers: bool) -> Requirement {
        match self.elastic.friction {
            None => Requirement::Absent("the object slides along the pad without friction"),
            Some(_) if depth.touching.is_empty() => Requirement::Unneeded("nothing reaches into the pad"),
            Some(_) if markers => Requirement::Needed("markers stay with the object"),
            Some(_) if self.at_most_dragged_mm(depth) < self.unseen_mm() => {
                Requirement::Unneeded("it would move the surface by less than half of the solver's tolerance")
            }
            Some(_) => Requirement::Needed("the surface under the object cannot slide"),
        }
    }

    /// What is below it is taken for nothing, mm.
    pub fn unseen_mm(&self) -> f64 {
        1e-3 * UNSEEN * self.elastic.tolerance_um
    }

    /// An estimate, from above, of what tractions displace, mm: of the depth, the share of a surface's motion into the pad
    /// that comes back by way of its motion along itself, C^2 / (G H), at the frequency where that is largest among those
    /// that fit the contact.
    fn at_most_dragged_mm(&self, depth: &Depth) -> f64 {
        const FINEST: f64 = 40.0;
        const STEPS: u32 = 200;
        let part = depth.touching;
        let width_mm = (part.width() as f64 * self.mm_per_px[0]).max(part.height() as f64 * self.mm_per_px[1]);
        let (lowest, highest) = (1.0 / width_mm, (FINEST / self.layer.thickness_mm).max(2.0 / width_mm));
        let share = |step: u32| {
            let q = lowest * libm::pow(highest / lowest, f64::from(step) / f64::from(STEPS));
            let coupling = self.layer.coupling(q);
            coupling * coupling / (self.layer.normal(q) * self.layer.tangential(q))
        };
        let deepest = depth.penetration.largest(|g| g);
        (0..=STEPS).map(share).fold(0.0, f64::max) * f64::from(deepest)
    }

    /// What the tractions under an object displace, in a pad that loads beyond the window displace, too; `None` without
    /// friction, or where that is nothing.
    pub fn drag(&self, depth: &Depth, beyond: Option<&Grid<f32>>) -> Option<Drag> {
        let friction = self.elastic.friction.filter(|_| !depth.touching.is_empty())?;
        if friction == (Friction::Coulomb { coefficient: 0.0 }) {
            return None;
        }
        let drag = self.rubbed(depth.touching).turns(depth, beyond, friction)?;
        (drag.largest_mm() >= self.unseen_mm()).then_some(drag)
    }

    /// This pad on the finest grid that is coarse enough for a contact in `touching`, px of the camera.
    fn rubbed(&self, touching: Rect) -> &Self {
        let longer = touching.width().max(touching.height());
        match self.coarser.as_deref() {
            Some(coarser) if longer > PRESSURE_PX * self.elastic.resolution.factor() => coarser.rubbed(touching),
            _ => self,
        }
    }

    /// The solver's grid over a captured window.
    pub(super) fn placed(&self, depth: &Depth, lattice: Lattice) -> Placed {
        let fine = [depth.penetration.width, depth.penetration.height];
        let origin_mm = std::array::from_fn(|k| self.centre_mm(lattice, 0, fine[k], k));
        Placed { origin_mm, mm_per_px: self.coarse_mm_per_px }
    }

    /// Solves for pressure and tractions in turn; `None` without contact.
    fn turns(&self, depth: &Depth, beyond: Option<&Grid<f32>>, friction: Friction) -> Option<Drag> {
        let lattice = self.lattice(depth);
        let placed = self.placed(depth, lattice);
        let tolerance_mm = self.unseen_mm() as f32;
        let Thinned { penetration: mut undisplaced, mut cut } = self.thinned(depth, lattice);
        if lattice.factor == 1 {
            undisplaced.clone_from(&depth.penetration);
        }
        Given { beyond, drag: None }.add_to(&mut undisplaced, placed, lattice, [0; 2], -1.0);
        let window = Rect::whole(undisplaced.width, undisplaced.height);
        let mut penetration = undisplaced.clone();
        let mut held: Option<Held> = None;
        let mut solution: Option<Solution> = None;
        for turn in 0..MOST_TURNS {
            let next = self.solve(&penetration, &mut cut, Rect::default(), solution.as_ref());
            let part = bounding_box(&next.pressure, |p| p > 0.0);
            if part.is_empty() {
                return None;
            }
            let Rect { x0, y0, .. } = next.contact_box;
            let part = Rect { x0: part.x0 + x0, x1: part.x1 + x0, y0: part.y0 + y0, y1: part.y1 + y0 };
            let fits = |held: &Held| held.part.united(part) == held.part;
            let mut now = match held.take().filter(fits) {
                Some(held) => held,
                None => {
                    Held::new(self, placed, part.grown(2 + part.width().max(part.height()) / 16, window.x1, window.y1))
                }
            };
            let solved = now.turn(self, &next, friction, turn);
            let largest = now.change.iter().fold(0.0_f32, |most, change| most.max(change.abs()));
            // What the last turns would still change is what an edge pixel more or less does.
            let (step, accepted) = match turn < FREE_TURNS {
                true => (largest, tolerance_mm),
                false => (now.share as f32 * largest, SETTLED * tolerance_mm),
            };
            now.drag.converged = solved && next.converged && largest <= accepted;
            if step <= tolerance_mm || turn + 1 == MOST_TURNS {
                return Some(now.drag);
            }
            penetration.clone_from(&undisplaced);
            now.drag.add_to(&mut penetration, placed, [0; 2], -1.0);
            (held, solution) = (Some(now), Some(next));
        }
        None
    }
}

/// Tractions and what they displace, from one turn to the next.
struct Held {
    /// Pixels of the pressure's window that may touch.
    part: Rect,
    grip: Grip,
    /// Of the last turn, in `grip`'s box; where they may slip, over pressure, so that what slipped begins at its new limit.
    tractions: Grid<Vector>,
    drag: Drag,
    /// By how much the last turn would have changed what they displace, and by which share of that it did.
    change: Vec<f32>,
    share: f64,
}

impl Held {
    fn new(pad: &Pad, placed: Placed, part: Rect) -> Self {
        let grip = Grip::new(pad.layer, [placed.origin_mm, placed.mm_per_px], part, TRACTION_PX, ROOM);
        // Half of the room on the torus: beyond it the tractions' copies are nearer.
        let reach = grip.reach(REACH);
        let down = Grid::new(grip.size[0] + 2 * reach[0], grip.size[1] + 2 * reach[1]);
        let origin_mm = [0, 1].map(|k| grip.origin_mm[k] - reach[k] as f64 * grip.mm_per_px[k]);
        let placed = Placed { origin_mm, mm_per_px: grip.mm_per_px };
        let tractions = Grid::new(grip.size[0], grip.size[1]);
        let change = vec![0.0; down.data.len()];
        Self { part, grip, tractions, drag: Drag { down, placed, slipping: 0.0, converged: false }, change, share: 1.0 }
    }

    /// Tractions under a pressure, and what they displace. Whether they were found.
    fn turn(&mut self, pad: &Pad, solution: &Solution, friction: Friction, turn: u32) -> bool {
        let mut pressure = Grid::new(self.part.width(), self.part.height());
        pressure.paste(&solution.pressure, solution.contact_box, self.part);
        self.grip.touch(&pressure, Rect::whole(pressure.width, pressure.height));
        self.grip.want_rest();
        let unit = |point: &Point| if friction == Friction::Stick { 1.0 } else { point.pressure };
        let of_last = |point: &Point| {
            let [x, y] = point.pixel;
            self.tractions.at(x, y).map(|share| share * unit(point))
        };
        let mut tractions: Vec<Vector> = self.grip.points.iter().map(of_last).collect();
        let (residual_mm, slipping) = self.grip.hold(friction, &mut tractions, &mut 0);
        self.drag.slipping = slipping;
        self.tractions.data.fill([0.0; 2]);
        for (point, t) in self.grip.points.iter().zip(&tractions) {
            let [x, y] = point.pixel;
            self.tractions.row_mut(y)[x] = t.map(|part| part / unit(point));
        }
        let mut acting = Grid::new(self.grip.size[0], self.grip.size[1]);
        for (point, t) in self.grip.points.iter().zip(&tractions) {
            let [x, y] = point.pixel;
            acting.row_mut(y)[x] = *t;
        }
        let down = self.grip.sunk(&acting, self.grip.reach(REACH)).data;
        let change: Vec<f32> = down.iter().zip(&self.drag.down.data).map(|(next, last)| next - last).collect();
        // Aitken's extrapolation, of vectors.
        let (mut along, mut square) = (0.0, 0.0);
        for (next, last) in change.iter().zip(&self.change) {
            let bend = f64::from(next - last);
            along += f64::from(*last) * bend;
            square += bend * bend;
        }
        let extrapolated = -self.share * along / square;
        self.share = if extrapolated.is_finite() && along != 0.0 { extrapolated.clamp(0.3, 4.0) } else { 1.0 };
        if turn >= FREE_TURNS {
            self.share = self.share.min(1.0) / f64::from(turn - FREE_TURNS + 2);
        }
        let share = self.share as f32;
        for (down, change) in self.drag.down.data.iter_mut().zip(&change) {
            *down += share * change;
        }
        self.change = change;
        residual_mm <= 2e-3 * pad.elastic.tolerance_um.max(1.0)
    }
}

/// The first of the four values that a place lies among, and their shares.
struct Taps {
    first: usize,
    shares: [f32; 4],
}

impl Drag {
    /// From what tractions displace in a frame whose origin lies at `frame_mm` and whose axes are turned by `angle_rad`, on
    /// pixels of `pitch_mm` with the first one at `origin_mm`.
    pub fn of_frame(
        down: Grid<f32>,
        origin_mm: [f64; 2],
        pitch_mm: [f64; 2],
        frame_mm: [f64; 2],
        angle_rad: f64,
    ) -> Self {
        let held = |down, origin_mm| {
            let placed = Placed { origin_mm, mm_per_px: pitch_mm };
            // Of a sequence the force is known: it is that of a frictionless press (docs/sequences.md).
            Self { down, placed, slipping: 1.0, converged: true }
        };
        if angle_rad == 0.0 {
            return held(down, [0, 1].map(|k| origin_mm[k] + frame_mm[k]));
        }
        let (sin, cos) = libm::sincos(angle_rad);
        let size = [down.width, down.height];
        let out = |[x, y]: [f64; 2]| [frame_mm[0] + cos * x - sin * y, frame_mm[1] + sin * x + cos * y];
        let far = [0, 1].map(|k| origin_mm[k] + (size[k] - 1) as f64 * pitch_mm[k]);
        let corners = [[0, 0], [0, 1], [1, 0], [1, 1]]
            .map(|ends: [usize; 2]| out([0, 1].map(|k| if ends[k] == 0 { origin_mm[k] } else { far[k] })));
        let low = [0, 1].map(|k| corners.iter().map(|corner| corner[k]).fold(f64::INFINITY, f64::min));
        let high = [0, 1].map(|k| corners.iter().map(|corner| corner[k]).fold(f64::NEG_INFINITY, f64::max));
        let count = |k: usize| libm::ceil((high[k] - low[k]) / pitch_mm[k]) as usize + 4;
        let first = [0, 1].map(|k| low[k] - 1.5 * pitch_mm[k]);
        let mut turned = Grid::new(count(0), count(1));
        for y in 0..turned.height {
            for (x, value) in turned.row_mut(y).iter_mut().enumerate() {
                let [dx, dy] = [x, y].map(|at| at as f64);
                let [dx, dy] = [first[0] + dx * pitch_mm[0] - frame_mm[0], first[1] + dy * pitch_mm[1] - frame_mm[1]];
                let there = [cos * dx + sin * dy, cos * dy - sin * dx];
                let place: [f64; 2] = std::array::from_fn(|k| (there[k] - origin_mm[k]) / pitch_mm[k]);
                if (0..2).all(|k| (1.0..(size[k] - 2) as f64).contains(&place[k])) {
                    let left = place.map(|at| at as usize);
                    let [along, across] = [0, 1].map(|k| catmull_rom((place[k] - left[k] as f64) as f32));
                    *value = (0..4)
                        .map(|row| {
                            let four = &down.row(left[1] + row - 1)[left[0] - 1..left[0] + 3];
                            across[row] * four.iter().zip(along).map(|(value, share)| value * share).sum::<f32>()
                        })
                        .sum();
                }
            }
        }
        held(turned, first)
    }

    /// The largest displacement, mm.
    pub fn largest_mm(&self) -> f64 {
        f64::from(self.down.largest(f32::abs))
    }

    /// Adds it, times `factor`, to a grid whose first pixel is pixel `corner` of `placed`; by cubics (Catmull and Rom 1974).
    pub(super) fn add_to(&self, target: &mut Grid<f32>, placed: Placed, corner: [usize; 2], factor: f32) {
        let (x, columns) = self.taps(0, placed, corner[0], target.width);
        let (y, rows) = self.taps(1, placed, corner[1], target.height);
        if columns.is_empty() {
            return;
        }
        let mut wide = Grid::<f32>::new(columns.len(), self.down.height);
        for row in 0..self.down.height {
            let from = self.down.row(row);
            for (to, taps) in wide.row_mut(row).iter_mut().zip(&columns) {
                let four = &from[taps.first..taps.first + 4];
                *to = four.iter().zip(taps.shares).map(|(value, share)| value * share).sum();
            }
        }
        for (k, taps) in rows.iter().enumerate() {
            let [a, b, c, d] = [0, 1, 2, 3].map(|line| wide.row(taps.first + line));
            let [p, q, r, s] = taps.shares.map(|share| factor * share);
            let to = &mut target.row_mut(y + k)[x..x + columns.len()];
            simd_dispatch(
                #[inline(always)]
                || {
                    for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                        *to += a * p + b * q + c * r + d * s;
                    }
                },
            );
        }
    }

    /// Raises pressures and force by what finite elements that stick have more than linear theory, as far as nothing slips.
    pub(super) fn stiffen(&self, contact: &mut Contact, thickness_mm: f64, edge: Option<ContactEdge>) {
        let (mut sum, mut count) = (0.0, 0_u32);
        for y in 0..contact.mask.height {
            let surface = &contact.surface.row(y + SURFACE_BORDER)[SURFACE_BORDER..];
            for (_, w) in contact.mask.row(y).iter().zip(surface).filter(|(touches, _)| **touches != 0) {
                sum += f64::from(*w);
                count += 1;
            }
        }
        let mean_mm = sum / f64::from(count.max(1));
        let more = (1.0 - self.slipping) * (force_over_linear(mean_mm, thickness_mm, edge) - 1.0);
        contact.stiffen(1.0 + more);
    }

    /// The first of a line's pixels that this reaches, and what each from there on takes.
    fn taps(&self, k: usize, placed: Placed, corner: usize, count: usize) -> (usize, Vec<Taps>) {
        let values = [self.down.width, self.down.height][k];
        let place =
            |at: usize| (placed.centre_mm(k, corner + at) - self.placed.origin_mm[k]) / self.placed.mm_per_px[k];
        let within = |at: &usize| (1.0..(values - 2) as f64).contains(&place(*at));
        let Some(first) = (0..count).find(within) else { return (0, Vec::new()) };
        let taps = (first..count).take_while(within).map(|at| {
            let place = place(at);
            let left = (place as usize).clamp(1, values - 3);
            let shares = catmull_rom((place - left as f64) as f32);
            Taps { first: left - 1, shares }
        });
        (first, taps.collect())
    }
}
