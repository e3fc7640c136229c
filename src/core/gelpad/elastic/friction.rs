//! Friction while the object is pressed in: the surface under the object cannot slide, or only as far as Coulomb
//! friction allows.
//!
//! Pressure alone moves the surface along itself, u = i C p ([`super::layer`]). Where friction resists, tractions t
//! move it back; they also displace it by -i C t into the pad, which changes the pressure. Pressure and tractions are
//! solved for in turn until neither changes. Both operators come from one energy, so each round leaves at most a share
//! C^2 / (G H) of the error; Aitken's extrapolation (Irons and Tuck 1969) reduces the rest.
//!
//! The displacement by tractions is smooth on the scale of the contact. It is solved for on a grid as fine as the
//! contact needs, and no finer than the pad's own. On the pad's grid, the press is then a frictionless one into a pad
//! that is already displaced ([`FrictionDisplacement`]).

use super::downsampled_object::DownsampledObject;
use super::lattice::Lattice;
use super::model_error::{ContactEdge, force_over_linear};
use super::placed::{GridPlacement, PlacedDisplacement};
use super::shear::Friction;
use super::traction_grid::{ContactPoint, TractionGrid, Vector};
use super::{ContactSolution, ElasticPad, PriorDisplacement};
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;
use crate::effects::Requirement;
use crate::gelpad::Contact;

/// Most pixels along the longer side of the contact on the grid on which pressure and tractions are solved for in turn,
/// if there is a grid that coarse.
const MAX_PRESSURE_PX: usize = 64;

/// Most pixels along the longer side of the contact on the tractions' grid.
const MAX_TRACTION_PX: usize = 40;

/// Rounds after which the solver gives up.
const MAX_ROUNDS: u32 = 20;

/// Rounds after which steps get shorter: pixels at the edge may touch in one round and not in the next.
const FREE_ROUNDS: u32 = 7;

/// Room around the contact, in thicknesses, so that its copies on the torus have no influence.
const ROOM: f64 = 4.0;

/// Accepted change from round to round where pixels at the edge come and go, as a multiple of the negligible
/// displacement.
const SETTLED_TOLERANCES: f32 = 6.0;

/// How far beyond the contact the displacement by tractions is computed, thicknesses.
const REACH: f64 = 0.5 * ROOM;

/// Displacements below this share of the tolerance are negligible.
const NEGLIGIBLE_SHARE: f64 = 0.5;

/// Displacement into the pad caused by the tractions under an object.
#[derive(Clone, Debug)]
pub struct FrictionDisplacement {
    /// Displacement; 0 at the border.
    pub(super) field: PlacedDisplacement,
    /// Share of the contact that slips, 0 to 1.
    slip_fraction: f64,
    /// True if it was solved for within the tolerance.
    pub converged: bool,
}

impl ElasticPad {
    /// Returns the friction during the press; `None` if there is none.
    pub fn friction(&self) -> Option<Friction> {
        self.elastic.friction
    }

    /// Decides whether friction would be visible: in the surface, or in `markers`.
    pub fn friction_required(&self, depth: &Depth, markers: bool) -> Requirement {
        match self.elastic.friction {
            None => Requirement::Absent("the object slides along the pad without friction"),
            Some(_) if depth.touching.is_empty() => Requirement::Unneeded("nothing reaches into the pad"),
            Some(_) if markers => Requirement::Needed("markers stay with the object"),
            Some(_) if self.friction_bound_mm(depth) < self.negligible_mm() => {
                Requirement::Unneeded("it would move the surface by less than half of the solver's tolerance")
            }
            Some(_) => Requirement::Needed("the surface under the object cannot slide"),
        }
    }

    /// Returns the displacement below which an effect is negligible, mm.
    pub fn negligible_mm(&self) -> f64 {
        1e-3 * NEGLIGIBLE_SHARE * self.elastic.tolerance_um
    }

    /// Estimates from above the displacement that tractions cause, mm. A share C^2 / (G H) of a surface's displacement
    /// into the pad comes back by way of its motion along itself. The estimate is the depth times the largest such
    /// share among the frequencies that fit the contact.
    fn friction_bound_mm(&self, depth: &Depth) -> f64 {
        const FINEST: f64 = 40.0;
        const STEPS: u32 = 200;
        let part = depth.touching;
        let width_mm = (part.width() as f64 * self.mm_per_px[0]).max(part.height() as f64 * self.mm_per_px[1]);
        let (lowest, highest) = (1.0 / width_mm, (FINEST / self.layer.thickness_mm).max(2.0 / width_mm));
        let share = |step: u32| {
            let q = lowest * libm::pow(highest / lowest, f64::from(step) / f64::from(STEPS));
            let coupling = self.layer.coupling_compliance(q);
            coupling * coupling / (self.layer.normal_compliance(q) * self.layer.tangential_compliance(q))
        };
        let deepest = depth.largest_penetration_mm();
        (0..=STEPS).map(share).fold(0.0, f64::max) * f64::from(deepest)
    }

    /// Solves for the displacement that the tractions under an object cause, in a pad that loads outside the window may
    /// displace too. `None` without friction, or if the displacement is negligible.
    pub fn solve_friction(&self, depth: &Depth, outside: Option<&Grid<f32>>) -> Option<FrictionDisplacement> {
        let friction = self.elastic.friction.filter(|_| !depth.touching.is_empty())?;
        if friction == (Friction::Coulomb { coefficient: 0.0 }) {
            return None;
        }
        let drag = self.coarsen_for_friction(depth.touching).solve_alternating(depth, outside, friction)?;
        (drag.largest_mm() >= self.negligible_mm()).then_some(drag)
    }

    /// Returns this pad on the finest grid that is coarse enough for a contact in `touching`, px of the camera.
    fn coarsen_for_friction(&self, touching: Rect) -> &Self {
        let longer = touching.width().max(touching.height());
        match self.coarser.as_deref() {
            Some(coarser) if longer > MAX_PRESSURE_PX * self.elastic.resolution.factor() => {
                coarser.coarsen_for_friction(touching)
            }
            _ => self,
        }
    }

    /// Returns the position of the solver's grid over a depth map.
    pub(super) fn grid_placement(&self, depth: &Depth, lattice: Lattice) -> GridPlacement {
        let fine = [depth.penetration.width, depth.penetration.height];
        let origin_mm = std::array::from_fn(|k| self.pixel_centre_mm(lattice, 0, fine[k], k));
        GridPlacement { origin_mm, mm_per_px: self.coarse_mm_per_px }
    }

    /// Solves for pressure and tractions in turn. `None` without contact.
    fn solve_alternating(
        &self,
        depth: &Depth,
        outside: Option<&Grid<f32>>,
        friction: Friction,
    ) -> Option<FrictionDisplacement> {
        let lattice = self.solver_lattice(depth);
        let placed = self.grid_placement(depth, lattice);
        let tolerance_mm = self.negligible_mm() as f32;
        let DownsampledObject { penetration: mut undisplaced, partial_pixels: mut cut } =
            self.downsample_object(depth, lattice);
        if lattice.factor == 1 {
            undisplaced.clone_from(&depth.penetration);
        }
        PriorDisplacement { outside, ..PriorDisplacement::default() }.add_to(
            &mut undisplaced,
            placed,
            lattice,
            [0; 2],
            -1.0,
        );
        let window = Rect::whole(undisplaced.width, undisplaced.height);
        let mut penetration = undisplaced.clone();
        let mut state: Option<TractionState> = None;
        let mut solution: Option<ContactSolution> = None;
        for round in 0..MAX_ROUNDS {
            let next = self.solve_contact(&penetration, &mut cut, Rect::default(), solution.as_ref());
            let part = bounding_box(&next.pressure, |p| p > 0.0);
            if part.is_empty() {
                return None;
            }
            let Rect { x0, y0, .. } = next.contact_box;
            let part = Rect { x0: part.x0 + x0, x1: part.x1 + x0, y0: part.y0 + y0, y1: part.y1 + y0 };
            // Tractions are kept as long as the contact stays within their box, which has some room; otherwise they
            // start anew.
            let fits = |state: &TractionState| state.part.union(part) == state.part;
            let mut now = match state.take().filter(fits) {
                Some(state) => state,
                None => TractionState::new(
                    self,
                    placed,
                    part.grown(2 + part.width().max(part.height()) / 16, window.x1, window.y1),
                ),
            };
            let solved = now.update_tractions(self, &next, friction, round);
            let largest = now.change.iter().fold(0.0_f32, |most, change| most.max(change.abs()));
            // In the last rounds, the remaining change is that of single pixels at the edge.
            let (step, accepted) = match round < FREE_ROUNDS {
                true => (largest, tolerance_mm),
                false => (now.share as f32 * largest, SETTLED_TOLERANCES * tolerance_mm),
            };
            now.friction.converged = solved && next.converged && largest <= accepted;
            if step <= tolerance_mm || round + 1 == MAX_ROUNDS {
                return Some(now.friction);
            }
            penetration.clone_from(&undisplaced);
            now.friction.field.add_to(&mut penetration, placed, [0; 2], -1.0);
            (state, solution) = (Some(now), Some(next));
        }
        None
    }
}

/// Tractions and the displacement that they cause, from one round to the next.
struct TractionState {
    /// Pixels of the pressure's window that may be in contact.
    part: Rect,
    grid: TractionGrid,
    /// Tractions of the last round, in `grid`'s box. With Coulomb friction they are divided by the pressure, so that
    /// slipping points start at their new limit.
    tractions: Grid<Vector>,
    friction: FrictionDisplacement,
    /// Change of the displacement computed in the last round, and the share of it that was applied.
    change: Vec<f32>,
    share: f64,
}

impl TractionState {
    fn new(pad: &ElasticPad, placed: GridPlacement, part: Rect) -> Self {
        let grid = TractionGrid::new(pad.layer, [placed.origin_mm, placed.mm_per_px], part, MAX_TRACTION_PX, ROOM);
        // At most half of the room on the torus: beyond it the tractions' copies are nearer.
        let reach = grid.reach_px(REACH);
        let down = Grid::new(grid.size[0] + 2 * reach[0], grid.size[1] + 2 * reach[1]);
        let origin_mm = [0, 1].map(|k| grid.origin_mm[k] - reach[k] as f64 * grid.mm_per_px[k]);
        let placed = GridPlacement { origin_mm, mm_per_px: grid.mm_per_px };
        let tractions = Grid::new(grid.size[0], grid.size[1]);
        let change = vec![0.0; down.data.len()];
        Self {
            part,
            grid,
            tractions,
            friction: FrictionDisplacement {
                field: PlacedDisplacement { values_mm: down, placement: placed },
                slip_fraction: 0.0,
                converged: false,
            },
            change,
            share: 1.0,
        }
    }

    /// Updates the tractions under a pressure, and the displacement that they cause. Returns whether the tractions
    /// converged.
    fn update_tractions(
        &mut self,
        pad: &ElasticPad,
        solution: &ContactSolution,
        friction: Friction,
        round: u32,
    ) -> bool {
        let mut pressure = Grid::new(self.part.width(), self.part.height());
        pressure.paste(&solution.pressure, solution.contact_box, self.part);
        self.grid.set_contact(&pressure, Rect::whole(pressure.width, pressure.height));
        self.grid.set_rest_targets();
        let unit = |point: &ContactPoint| if friction == Friction::Stick { 1.0 } else { point.pressure };
        let of_last = |point: &ContactPoint| {
            let [x, y] = point.pixel;
            self.tractions.at(x, y).map(|share| share * unit(point))
        };
        let mut tractions: Vec<Vector> = self.grid.points.iter().map(of_last).collect();
        let (residual_mm, slipping) = self.grid.solve_tractions(friction, &mut tractions, &mut 0);
        self.friction.slip_fraction = slipping;
        self.tractions.data.fill([0.0; 2]);
        for (point, t) in self.grid.points.iter().zip(&tractions) {
            let [x, y] = point.pixel;
            self.tractions.row_mut(y)[x] = t.map(|part| part / unit(point));
        }
        let mut acting = Grid::new(self.grid.size[0], self.grid.size[1]);
        for (point, t) in self.grid.points.iter().zip(&tractions) {
            let [x, y] = point.pixel;
            acting.row_mut(y)[x] = *t;
        }
        let down = self.grid.normal_displacement(&acting, self.grid.reach_px(REACH)).data;
        let change: Vec<f32> =
            down.iter().zip(&self.friction.field.values_mm.data).map(|(next, last)| next - last).collect();
        // Aitken's extrapolation, for vectors. The limits keep one bad estimate from spoiling the iteration.
        let (mut along, mut square) = (0.0, 0.0);
        for (next, last) in change.iter().zip(&self.change) {
            let bend = f64::from(next - last);
            along += f64::from(*last) * bend;
            square += bend * bend;
        }
        let extrapolated = -self.share * along / square;
        self.share = if extrapolated.is_finite() && along != 0.0 { extrapolated.clamp(0.3, 4.0) } else { 1.0 };
        if round >= FREE_ROUNDS {
            self.share = self.share.min(1.0) / f64::from(round - FREE_ROUNDS + 2);
        }
        let share = self.share as f32;
        for (down, change) in self.friction.field.values_mm.data.iter_mut().zip(&change) {
            *down += share * change;
        }
        self.change = change;
        residual_mm <= 2e-3 * pad.elastic.tolerance_um.max(1.0)
    }
}

impl FrictionDisplacement {
    /// Makes the displacement by tractions that are carried through a sequence.
    pub fn carried(field: PlacedDisplacement) -> Self {
        // 1.0: no correction of the force in a sequence; it is that of a frictionless press
        // (docs/how-to/sequences.md).
        Self { field, slip_fraction: 1.0, converged: true }
    }

    /// Returns the largest absolute displacement, mm.
    pub fn largest_mm(&self) -> f64 {
        self.field.largest_mm()
    }

    /// Raises pressures and force by the ratio between finite elements that stick and linear theory, for the share of
    /// the contact that does not slip.
    pub(super) fn apply_stick_stiffening(&self, contact: &mut Contact, thickness_mm: f64, edge: Option<ContactEdge>) {
        let (mut sum, mut count) = (0.0, 0_u32);
        for y in 0..contact.mask.height {
            let surface = &contact.surface.row(y + SURFACE_BORDER)[SURFACE_BORDER..];
            for (_, w) in contact.mask.row(y).iter().zip(surface).filter(|(touches, _)| **touches != 0) {
                sum += f64::from(*w);
                count += 1;
            }
        }
        let mean_mm = sum / f64::from(count.max(1));
        let more = (1.0 - self.slip_fraction) * (force_over_linear(mean_mm, thickness_mm, edge) - 1.0);
        contact.scale_forces(1.0 + more);
    }
}
