//! The pad as a linear elastic layer bonded to the shell, pressed by an object, with or without friction.
//!
//! From the penetration g, the solver (`solve`) finds the pressure p >= 0 and the surface's displacement w >= g with p
//! (w - g) = 0, where w is p convolved with the layer's response ([`kernel`], [`layer`]) in free space. Unlike a blur,
//! the pad bulges, leaves the object where it should, and has forces. Friction adds tractions and the displacement that
//! they cause ([`friction`]). Linear theory holds for small strain; [`model_error`] estimates its error. Displacements
//! do not depend on Young's modulus; pressures are proportional to it.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::finite_strain::StrainSettings;
use super::total_contact::OutsideWindow;
use super::{Contact, Numerics, Theory, no_contact};
use crate::base::grid::{Grid, Rect, Resolution, bounding_box};
use crate::base::simd::{count_true, simd_dispatch};
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::{CaptureWindow, Depth};
use crate::gelpad::material::Material;

pub mod convolve;
mod coulomb;
mod downsampled_object;
mod edge;
pub mod elastic_object;
pub mod fft;
pub mod friction;
pub mod friction_history;
pub mod in_plane;
pub mod kernel;
mod lattice;
pub mod layer;
pub mod model_error;
mod outside_window;
mod partial_pixels;
mod pixel_block;
pub(super) mod placed;
pub mod plane_transform;
pub mod relaxation;
mod resample;
pub mod response;
pub mod shear;
mod solution;
mod solve;
mod surface;
mod traction_grid;
pub mod vector_convolve;
mod wall_marks;

use downsampled_object::DownsampledObject;
use in_plane::Load;
use kernel::CorrectionCurve;
use lattice::Lattice;
use layer::ElasticLayer;
use model_error::{ContactEdge, model_error_mm};
use outside_window::OutsideGrids;
use partial_pixels::PartialPixel;
use placed::GridPlacement;
use resample::Interpolation;
use response::{OperatorBuffers, PressureResponse};
use shear::Friction;
use solution::ContactSolution;
pub use solution::PriorDisplacement;
use solve::{ContactProblem, SolverBuffers, SolverOutcome};

/// Parameters of the contact solver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Elastic {
    /// Grid on which the contact is solved.
    pub resolution: Resolution,
    /// Largest penetration, and largest distance within the contact, that is accepted, um, 0.01 to 1000.
    pub tolerance_um: f64,
    /// Iterations after which the solver gives up, 1 to 10000.
    pub max_iterations: u32,
    /// Friction between pad and object while it is pressed in. `None`: the surface slides along the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
    /// Adds the difference between rubber at finite strain and a linear layer, coarser and cheaper than the model
    /// `finite_strain` does.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub strain_correction: bool,
}

impl Default for Elastic {
    fn default() -> Self {
        Self {
            resolution: Resolution::Full,
            tolerance_um: 1.0,
            max_iterations: 200,
            friction: None,
            strain_correction: false,
        }
    }
}

impl Elastic {
    /// Returns how the difference between rubber and a linear layer is solved for; `None` if it is not.
    pub fn strain_settings(&self) -> Option<StrainSettings> {
        self.strain_correction.then(|| StrainSettings::of_correction(self.friction))
    }

    /// Returns the settings of the coarser solution that provides the initial guess; a few times the tolerance is
    /// enough for it.
    fn coarser_settings(&self) -> Option<Self> {
        let resolution = match self.resolution {
            Resolution::Full => Resolution::Half,
            Resolution::Half => Resolution::Quarter,
            Resolution::Quarter => return None,
        };
        Some(Self { resolution, tolerance_um: (3.0 * self.tolerance_um).max(1.0), ..*self })
    }
}

/// Width of the margin around the view in which the object is captured on the view's own grid, in thicknesses. Contacts
/// that extend beyond the margin are solved on coarser grids ([`outside_window`]).
const MARGIN_THICKNESSES: f64 = 1.5;

/// Largest indentation depth over thickness at which linear theory is useful; under a ball its surface is then off by
/// some 3 % of the depth.
pub const MAX_STRAIN: f64 = 0.5;

/// Number of pixels in the contact's box from which on a coarser grid is solved first.
const COARSER_FROM_PX: usize = 64 * 64;

/// Largest tolerance as a share of the depth; it matters for presses of tens of micrometres and less.
const MAX_TOLERANCE_SHARE: f32 = 0.02;

/// Tolerance of a solution that serves as a guess, in tolerances of its grid. On the finer grid the walls' pixels are far
/// off anyway.
const GUESS_TOLERANCES: f32 = 3.0;

/// Height of bulges that a capture allows for, as a share of the indentation depth; rings come to 0.36.
const BULGE_SHARE: f64 = 0.4;

/// Height of bulges that a capture allows for where large strains are solved for, thicknesses. There, points far over the
/// pad count as well, so that it must not depend on how deep one knows the object to be.
const STRAIN_BULGE: f64 = 0.3;

/// The model prepared for a sensor. Clones share all large data.
#[derive(Clone)]
pub struct ElasticPad {
    elastic: Elastic,
    youngs_modulus_kpa: f64,
    margin_px: usize,
    /// Pixel size of the camera.
    mm_per_px: [f64; 2],
    /// Pixel size of the solver's grid.
    coarse_mm_per_px: [f64; 2],
    layer: ElasticLayer,
    response: Arc<PressureResponse>,
    /// The same pad on every second pixel, for initial guesses; `None` on the coarsest grid.
    coarser: Option<Box<ElasticPad>>,
    /// Grids for contacts outside the window.
    outside_grids: Arc<OutsideGrids>,
    /// See [`Self::object_compliance`].
    object_compliance: Option<f64>,
    /// See [`Self::strain_settings`].
    strain: Option<StrainSettings>,
}

impl ElasticPad {
    /// Prepares the pad; computes the layer's response.
    pub fn new(elastic: &Elastic, material: &Material, view: &View) -> Self {
        let pad = Self::with_curve(&CorrectionCurve::new(ElasticLayer::new(material)), elastic, material, view);
        Self { strain: elastic.strain_settings(), ..pad }
    }

    /// Returns the pad at finite strain.
    pub(super) fn with_strain(self, strain: StrainSettings) -> Self {
        Self { strain: Some(strain), ..self }
    }

    /// Returns how the difference between rubber and a linear layer is solved for; `None` if the pad is linear.
    pub fn strain_settings(&self) -> Option<StrainSettings> {
        self.strain
    }

    fn with_curve(curve: &CorrectionCurve, elastic: &Elastic, material: &Material, view: &View) -> Self {
        let layer = curve.layer;
        let [width, height] = view.resolution_px;
        let [dx, dy] = view.mm_per_px;
        // On a pad much thicker than the view is wide, no margin would be enough; half of the view is not too slow.
        let widest = (width.max(height) / 2).max(16);
        // A multiple of the coarsest grid's pixels, so that a tiny change of thickness does not shift coarse grids
        // against the view.
        let margin_px = ((MARGIN_THICKNESSES * layer.thickness_mm / dx.min(dy)).ceil() as usize)
            .clamp(8, widest)
            .next_multiple_of(4);
        let lattice = Lattice::new(elastic.resolution, [width, height].map(|size| size + 2 * margin_px));
        let coarse_mm_per_px = view.mm_per_px.map(|mm| mm * lattice.factor as f64);
        let window = lattice.size();
        // Cutting off the response at this many thicknesses costs about the tolerance: the tail falls by 60 % with
        // each. Contacts much wider than the pad is thick, which a wide window may hold, feel the tail more.
        let widest_mm = (0..2).map(|k| window[k] as f64 * coarse_mm_per_px[k]).fold(0.0, f64::max);
        let thicknesses =
            (libm::log(100.0 / elastic.tolerance_um) / 0.9 + 1.0).max(widest_mm / layer.thickness_mm / 1.5);
        let reach_mm = layer.thickness_mm * thicknesses.clamp(6.0, 9.0);
        Self {
            elastic: *elastic,
            youngs_modulus_kpa: material.youngs_modulus_kpa,
            margin_px,
            mm_per_px: view.mm_per_px,
            coarse_mm_per_px,
            layer,
            response: Arc::new(PressureResponse::with_curve(
                curve,
                coarse_mm_per_px,
                reach_mm,
                window,
                elastic.tolerance_um,
            )),
            coarser: elastic
                .coarser_settings()
                .map(|coarser| Box::new(Self::with_curve(curve, &coarser, material, view))),
            outside_grids: Arc::default(),
            object_compliance: None,
            strain: None,
        }
    }

    /// Returns the response of the pad on its own grid.
    pub(crate) fn response(&self) -> &Arc<PressureResponse> {
        &self.response
    }

    /// Returns the linear layer.
    pub(super) fn layer(&self) -> ElasticLayer {
        self.layer
    }

    /// Returns the camera's pixel size.
    pub(super) fn mm_per_px(&self) -> [f64; 2] {
        self.mm_per_px
    }

    /// Returns the pad with another Young's modulus, kPa; displacements do not depend on it.
    pub(crate) fn with_youngs_modulus(&self, youngs_modulus_kpa: f64) -> Self {
        let coarser = self.coarser.as_ref().map(|coarser| Box::new(coarser.with_youngs_modulus(youngs_modulus_kpa)));
        Self { youngs_modulus_kpa, coarser, ..self.clone() }
    }

    /// Returns the displacement around one pressed pixel of the solver's grid, mm, for Young's modulus 1: lags from 0
    /// up along x and y, 0 beyond the last.
    pub fn kernel(&self) -> &Grid<f32> {
        self.response.kernel()
    }

    /// Returns the part of an object that the solver needs; see [`super::Pad::capture_window`].
    pub fn capture_window(&self, depth_mm: f64) -> CaptureWindow {
        let bulge_mm = match self.strain {
            Some(_) => STRAIN_BULGE * self.layer.thickness_mm,
            // A few tolerances more, as the height of a bulge is only known within the tolerance.
            None => (BULGE_SHARE * depth_mm).max(4e-3 * self.elastic.tolerance_um),
        };
        CaptureWindow {
            margin_px: self.margin_px,
            above_mm: (bulge_mm + self.interpolation_slack_mm()).min(self.layer.thickness_mm),
        }
    }

    /// Returns a higher window if the pad bulged beyond `window`; see [`super::Pad::higher_window`]. It never reaches
    /// higher than one thickness: linear theory has ended long before.
    pub(crate) fn higher_window(&self, window: CaptureWindow, contact: &Contact) -> Option<CaptureWindow> {
        let spare_mm = 2e-3 * self.elastic.tolerance_um + self.interpolation_slack_mm();
        let reached = f64::from(contact.bulge_mm) + spare_mm >= window.above_mm;
        let higher = CaptureWindow { above_mm: (2.0 * window.above_mm).min(self.layer.thickness_mm), ..window };
        (reached && higher.above_mm > window.above_mm).then_some(higher)
    }

    /// Returns the distance to an interpolated surface below which the object counts as touching, mm: the window must
    /// reach higher than the surface by this much.
    fn interpolation_slack_mm(&self) -> f64 {
        if self.elastic.resolution == Resolution::Full { 0.0 } else { f64::from(self.contact_gap_mm()) }
    }

    /// Presses the object into the pad, with the pad's friction.
    pub fn press(&self, depth: &Depth) -> Contact {
        self.press_with_outside(depth, None)
    }

    /// Presses the object into the pad, with its friction and strain and the contact outside the window.
    pub fn press_with_outside(&self, depth: &Depth, outside: Option<&OutsideWindow>) -> Contact {
        let outside = outside.and_then(|outside| outside.displacement.as_ref());
        let strain = self.correct_if_required(depth);
        let sticks = strain.as_ref().is_some_and(|strain| strain.sticks);
        let drag = if sticks { None } else { self.solve_friction(depth, outside) };
        let prior = PriorDisplacement { outside, friction: drag.as_ref(), remembered: None, strain: strain.as_ref() };
        self.press_displaced_pad(depth, prior)
    }

    /// Presses the object into a pad with the displacements `prior`.
    pub(crate) fn press_displaced_pad(&self, depth: &Depth, prior: PriorDisplacement<'_>) -> Contact {
        let margin = depth.margin_px;
        let (width, height) = (depth.penetration.width - 2 * margin, depth.penetration.height - 2 * margin);
        let solved =
            Numerics { residual_um: Some(0.0), model_error_um: Ok(0.0), theory: Theory::Linear, ..Numerics::DIRECT };
        let mut contact = no_contact(width, height, Some(0.0), solved);
        if depth.touching.is_empty() && prior.outside.is_none() {
            if let Some(remembered) = prior.remembered {
                remembered.add_to(&mut contact.surface, self.surface_placement([width, height]), [0; 2], 1.0);
                contact.region = Rect::whole(contact.surface.width, contact.surface.height);
                contact.bulge_mm = contact.surface.largest(|w| -w);
                contact.finite = contact.surface.data.iter().all(|w| w.is_finite());
            }
            return contact;
        }
        self.solve_press(depth, prior, &mut contact);
        contact
    }

    /// Returns where the pixels of the surface around a view lie.
    fn surface_placement(&self, view_px: [usize; 2]) -> GridPlacement {
        let first = |k: usize| (0.5 - SURFACE_BORDER as f64 - 0.5 * view_px[k] as f64) * self.mm_per_px[k];
        GridPlacement { origin_mm: [first(0), first(1)], mm_per_px: self.mm_per_px }
    }

    fn solve_press(&self, depth: &Depth, prior: PriorDisplacement<'_>, contact: &mut Contact) {
        let lattice = self.solver_lattice(depth);
        let DownsampledObject { penetration, partial_pixels: cut } = &mut self.downsample_object(depth, lattice);
        let object = if lattice.factor == 1 { &depth.penetration } else { &*penetration };
        // Displacements that are already there reduce what the pressure has to do.
        let mut left = Cow::Borrowed(object);
        if !prior.is_empty() {
            prior.add_to(left.to_mut(), self.grid_placement(depth, lattice), lattice, [0; 2], -1.0);
        }
        let corner = depth.margin_px - SURFACE_BORDER;
        let (width, height) = (contact.surface.width, contact.surface.height);
        let seen = Rect { x0: corner, y0: corner, x1: corner + width, y1: corner + height };
        let mut solution = self.solve_contact(&left, cut, lattice.coarse_box_around(seen), None);
        solution.settle_stopped_pixels(&left, cut);
        let Rect { x0, y0, .. } = solution.known_box;
        prior.add_to(&mut solution.displacement, self.grid_placement(depth, lattice), lattice, [x0, y0], 1.0);
        if prior.strain.is_some() && prior.outside.is_none() {
            // Beside walls the difference between rubber and the layer is less exact than this bound.
            let deepest_mm = depth.largest_penetration_mm();
            solution.displacement.data.iter_mut().for_each(|w| *w = w.min(deepest_mm));
        }
        solution.converged &= prior.friction.is_none_or(|drag| drag.converged);
        if let Some(outside) = prior.outside {
            contact.surface = outside.crop(seen);
        }
        if let Some(remembered) = prior.remembered {
            // A coarse grid that finds no contact leaves the surface as it is.
            remembered.add_to(
                &mut contact.surface,
                self.surface_placement([width, height].map(|px| px - 2 * SURFACE_BORDER)),
                [0; 2],
                1.0,
            );
        }
        contact.bulge_mm = solution.displacement.largest(|w| -w);
        self.fill_contact(&solution, depth, (object, cut), seen, lattice, contact);
        if let Some(strain) = prior.strain {
            strain.lay_on_edges(depth, seen, contact);
        }
        let edge = ContactEdge::from_mask(&contact.mask, &depth.penetration, depth.margin_px, self.mm_per_px);
        let (deepest_mm, thickness_mm) = (f64::from(depth.deepest_mm), self.layer.thickness_mm);
        let error_mm =
            edge.map_or(Ok(0.0), |edge| model_error_mm(deepest_mm, thickness_mm, edge, self.elastic.friction));
        if let Some(drag) = prior.friction {
            drag.apply_stick_stiffening(contact, thickness_mm, edge);
        }
        contact.numerics = Numerics {
            converged: solution.converged,
            iterations: solution.iterations,
            residual_um: Some(f64::from(solution.residual_mm) * 1e3),
            model_error_um: error_mm.map(|mm| 1e3 * mm),
            ..contact.numerics
        };
        if let Some(strain) = prior.strain {
            contact.numerics.theory = Theory::FiniteStrain;
            contact.numerics.model_error_um = error_mm.map(|mm| 1e3 * mm * strain.error_share);
            contact.numerics.opened_mm = strain.opened_mm;
            contact.numerics.strain_iterations = strain.iterations;
            contact.numerics.strain_residual_um = strain.residual_um;
            contact.strain_motion = Some((strain.motion.clone(), strain.sticks));
        }
        contact.load = self.extract_load(&mut solution, depth, lattice);
    }

    /// Returns the object on the solver's grid.
    fn downsample_object(&self, depth: &Depth, lattice: Lattice) -> DownsampledObject {
        DownsampledObject::new(lattice, depth, self.mm_per_px, self.response.kernel())
    }

    /// Returns the solver's grid over a depth map.
    fn solver_lattice(&self, depth: &Depth) -> Lattice {
        Lattice::new(self.elastic.resolution, [depth.penetration.width, depth.penetration.height])
    }

    /// Takes the pressure out of a solution, with its position. `None` without contact.
    fn extract_load(&self, solution: &mut ContactSolution, depth: &Depth, lattice: Lattice) -> Option<Load> {
        let (fine, corner) = ([depth.penetration.width, depth.penetration.height], solution.contact_box);
        let centre_mm = |coarse: usize, k: usize| self.pixel_centre_mm(lattice, coarse, fine[k], k);
        let touches = solution.pressure.data.iter().any(|p| *p > 0.0);
        touches.then(|| Load {
            pressure: std::mem::take(&mut solution.pressure),
            origin_mm: [centre_mm(corner.x0, 0), centre_mm(corner.y0, 1)],
            mm_per_px: self.coarse_mm_per_px,
        })
    }

    /// Returns the position of a pixel of the solver's grid, mm from the centre of the view, which is the centre of the
    /// window.
    fn pixel_centre_mm(&self, lattice: Lattice, coarse: usize, fine: usize, k: usize) -> f64 {
        (lattice.centre_px(coarse, k) + 0.5 - fine as f64 / 2.0) * self.mm_per_px[k]
    }

    /// Solves for the contact with `penetration`, some of whose pixels are cut by walls, and for the displacement in
    /// `seen` at least. The solver begins with the pressure of `like`, if there is one.
    fn solve_contact(
        &self,
        penetration: &Grid<f32>,
        cut: &mut [PartialPixel],
        seen: Rect,
        like: Option<&ContactSolution>,
    ) -> ContactSolution {
        self.solve_to(self.tolerance_mm(), penetration, cut, seen, like)
    }

    /// Returns the largest violation of the contact's conditions that is accepted, mm.
    fn tolerance_mm(&self) -> f32 {
        (self.elastic.tolerance_um * 1e-3) as f32
    }

    /// Solves for the contact like [`Self::solve_contact`], to a tolerance in mm.
    fn solve_to(
        &self,
        tolerance: f32,
        penetration: &Grid<f32>,
        cut: &mut [PartialPixel],
        seen: Rect,
        like: Option<&ContactSolution>,
    ) -> ContactSolution {
        let whole = Rect::whole(penetration.width, penetration.height);
        let mut touching = bounding_box(penetration, |g| g > 0.0);
        let mut solution = ContactSolution {
            contact_box: Rect::default(),
            pressure: Grid::default(),
            known_box: seen,
            displacement: Grid::default(),
            converged: true,
            iterations: 0,
            residual_mm: 0.0,
        };
        if touching.is_empty() {
            // The object touches only between the pixels of the solver's grid.
            solution.displacement.reset(seen.width(), seen.height());
            return solution;
        }
        // A press shallower than the tolerance would count as solved from the beginning, whatever its pressure.
        let deepest = penetration.largest_in(touching);
        let goal = tolerance.min(MAX_TOLERANCE_SHARE * deepest);
        let touching_px = simd_dispatch(
            #[inline(always)]
            || (touching.y0..touching.y1).map(|y| count_true(penetration.row(y).iter().map(|g| *g > 0.0))).sum::<u32>(),
        );
        let area = f64::from(touching_px) * self.coarse_mm_per_px[0] * self.coarse_mm_per_px[1];
        // Waves longer than the contact count as one in the preconditioner: within the contact they look alike.
        let cutoff = std::f64::consts::PI / libm::sqrt(area);
        // A bulge may touch the object outside the box of positive penetration; the box then grows to contain it.
        const MOST_BOXES: u32 = 12;
        let (mut memory, mut scratch) = (OperatorBuffers::default(), SolverBuffers::default());
        for round in 0..MOST_BOXES {
            // Room for the contact to grow into: a bulge beside the object may touch it.
            let room = 4 + touching.width().min(touching.height()) / 32;
            let contact_box = touching.grown(room, whole.x1, whole.y1);
            let operator = self.response.operator(contact_box, contact_box);
            operator.prepare(&mut memory);
            operator.prepare_inverse(cutoff, &mut memory);
            let mut problem = ContactProblem {
                operator: &operator,
                largest_compliance: self.response.largest_compliance() as f32,
                penetration: penetration.crop(contact_box),
                partial_pixels: Vec::new(),
                own_response: self.response.kernel().at(0, 0),
                tolerance_mm: goal,
                max_iterations: self.elastic.max_iterations - solution.iterations.min(self.elastic.max_iterations),
            };
            problem.take_partial_pixels(cut, contact_box);
            let mut pressure = Grid::default();
            let large = touching.area() > COARSER_FROM_PX;
            if let Some(like) = like.filter(|_| round == 0) {
                pressure.reset(contact_box.width(), contact_box.height());
                pressure.paste(&like.pressure, like.contact_box, contact_box);
            } else if round == 0
                && let Some(coarser) = self.coarser.as_ref().filter(|_| large)
            {
                pressure = coarser.guess_pressure(penetration, contact_box);
                problem.refine_guess(&mut pressure);
            } else if round == 0 {
                problem.guess_pressure(&mut pressure);
            } else {
                pressure.reset(contact_box.width(), contact_box.height());
                pressure.paste(&solution.pressure, solution.contact_box, contact_box);
            }
            let SolverOutcome { iterations, residual_mm } = problem.solve(&mut pressure, &mut scratch, &mut memory);
            problem.note_stopped_pixels(cut, contact_box);
            solution.iterations += iterations;
            solution.contact_box = contact_box;
            solution.pressure = pressure;

            let all = contact_box.union(seen);
            solution.known_box = all;
            if all == contact_box {
                solution.displacement.clone_from(&scratch.displacement);
                problem.subtract_compression(&solution.pressure, &mut solution.displacement);
            } else {
                let operator = self.response.operator(contact_box, all);
                operator.prepare(&mut memory);
                operator.displace(&solution.pressure, &mut memory, &mut solution.displacement);
            }
            let missed = solution.check_conditions(penetration, cut, 2.0 * tolerance);
            // In a view wider than the contact, the displacement was computed anew, so that it lacks the accumulated
            // rounding.
            let solved = residual_mm <= tolerance && solution.residual_mm <= 2.0 * tolerance;
            solution.converged = solved && missed.is_empty();
            if missed.is_empty() || solution.iterations >= self.elastic.max_iterations {
                break;
            }
            touching = touching.union(missed);
        }
        solution
    }

    /// Guesses the pressure on a grid twice as fine as this pad's, within its box `part`, from the solution on this
    /// pad's grid.
    fn guess_pressure(&self, fine: &Grid<f32>, part: Rect) -> Grid<f32> {
        let lattice = Lattice::new(Resolution::Half, [fine.width, fine.height]);
        let penetration = lattice.downsample(fine, self.mm_per_px);
        let solution =
            self.solve_to(GUESS_TOLERANCES * self.tolerance_mm(), &penetration, &mut [], Rect::default(), None);
        let mut pressure = Grid::new(part.width(), part.height());
        if !solution.contact_box.is_empty() {
            let enlarge = |values, shape, out| lattice.upsample(values, solution.contact_box, part, shape, out);
            enlarge(&solution.pressure, Interpolation::Linear, &mut pressure);
            let mut surface = Grid::default();
            enlarge(&solution.displacement, Interpolation::Cubic, &mut surface);
            let close = self.contact_gap_mm();
            for y in 0..part.height() {
                let object = &fine.row(part.y0 + y)[part.x0..part.x1];
                for ((p, w), g) in pressure.row_mut(y).iter_mut().zip(surface.row(y)).zip(object) {
                    *p = if w - g < close { *p } else { 0.0 };
                }
            }
        }
        pressure
    }

    /// Returns the gap below which an interpolated surface may touch the object, mm.
    fn contact_gap_mm(&self) -> f32 {
        0.1 * self.coarse_mm_per_px[0].min(self.coarse_mm_per_px[1]) as f32
    }
}
