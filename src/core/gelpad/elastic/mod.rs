//! The pad as a linear elastic layer bonded to the shell, pressed by a rigid object, without friction or with it.
//!
//! From the overlap g come the pressure p >= 0 and the surface's displacement w >= g with p (w - g) = 0 (`solve`), w
//! being p convolved with the layer's response ([`kernel`], [`layer`]) in free space. Unlike a blur this bulges, leaves
//! the object where it should, and knows forces. Friction adds tractions, and what they displace ([`friction`]). Linear
//! theory holds for small strain; what it gets wrong: [`model_error`]. Displacements do not depend on Young's modulus;
//! pressures are proportional to it.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::total_contact::Beyond;
use super::{Contact, Numerics, untouched};
use crate::base::grid::{Grid, Rect, Resolution, bounding_box};
use crate::base::simd::{count, simd_dispatch};
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::{Depth, Window};
use crate::gelpad::material::Material;

mod beyond_view;
mod cone;
pub mod convolve;
mod edge;
pub mod fft;
pub mod friction;
mod grip;
pub mod history;
pub mod inplane;
pub mod kernel;
mod lattice;
pub mod layer;
pub mod model_error;
pub mod plane;
mod resample;
pub mod response;
pub mod shear;
pub mod soft;
mod solution;
mod solve;
mod surface;
mod walls;

use beyond_view::Grids;
use inplane::Load;
use kernel::Curve;
use lattice::Lattice;
use layer::ElasticLayer;
use model_error::{ContactEdge, model_error_mm};
use resample::Shape;
use response::{Memory, Response};
use shear::Friction;
pub use solution::Given;
use solution::Solution;
use solve::{ContactProblem, Outcome, Scratch};
use walls::{CutPixel, Thinned};

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
    /// What holds the pad to the object while it is pressed in. `None`: nothing, the surface slides along it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
}

impl Default for Elastic {
    fn default() -> Self {
        Self { resolution: Resolution::Full, tolerance_um: 1.0, max_iterations: 200, friction: None }
    }
}

impl Elastic {
    /// What gives a guess to begin with. It needs no more than a few times the tolerance.
    fn coarser(&self) -> Option<Self> {
        let resolution = match self.resolution {
            Resolution::Full => Resolution::Half,
            Resolution::Half => Resolution::Quarter,
            Resolution::Quarter => return None,
        };
        Some(Self { resolution, tolerance_um: (3.0 * self.tolerance_um).max(1.0), ..*self })
    }
}

/// How far beyond the view the object is captured on the view's own grid, in thicknesses. Of an object that ends there
/// nothing is missing; what goes on further presses from coarser grids ([`beyond_view`]).
const MARGIN: f64 = 1.5;

/// Indentation depth over thickness up to which linear theory says something; under a ball its surface is then off by some 3 % of
/// the depth.
pub const LARGEST_STRAIN: f64 = 0.5;

/// Overlap, in pixels of the box around it, from which on a coarser grid is solved first.
const COARSER_FROM_PX: usize = 64 * 64;

/// Share of the depth that the tolerance may be: it matters to presses of tens of micrometres and less.
const SHALLOW: f32 = 0.02;

/// Height of the bulges that is counted on, as a share of the indentation depth: rings come to 0.36.
const BULGE: f64 = 0.4;

/// The model made ready for a sensor. A clone shares all that is large.
#[derive(Clone)]
pub struct Pad {
    elastic: Elastic,
    youngs_modulus_kpa: f64,
    margin_px: usize,
    /// Of the camera.
    mm_per_px: [f64; 2],
    /// Of the solver's grid.
    coarse_mm_per_px: [f64; 2],
    layer: ElasticLayer,
    response: Arc<Response>,
    /// The same on every second pixel, if that is fine enough to be of help.
    coarser: Option<Box<Pad>>,
    /// For what lies beyond the window.
    grids: Arc<Grids>,
    /// See [`Self::object`].
    object: Option<f64>,
}

impl Pad {
    /// Computes the layer's response.
    pub fn new(elastic: &Elastic, material: &Material, view: &View) -> Self {
        Self::by(&Curve::new(ElasticLayer::new(material)), elastic, material, view)
    }

    fn by(curve: &Curve, elastic: &Elastic, material: &Material, view: &View) -> Self {
        let layer = curve.layer;
        let [width, height] = view.resolution_px;
        let [dx, dy] = view.mm_per_px;
        // On a pad much thicker than the view is wide, no margin would do; one of half a view is not too slow.
        let widest = (width.max(height) / 2).max(16);
        // In whole pixels of the coarsest grid, so that a hair of thickness does not shift coarse grids against the view.
        let margin_px =
            ((MARGIN * layer.thickness_mm / dx.min(dy)).ceil() as usize).clamp(8, widest).next_multiple_of(4);
        let lattice = Lattice::new(elastic.resolution, [width, height].map(|size| size + 2 * margin_px));
        let coarse_mm_per_px = view.mm_per_px.map(|pitch| pitch * lattice.factor as f64);
        let window = lattice.size();
        // Cutting the response off at so many thicknesses costs about the tolerance: the tail falls by 60 % with each.
        // Contacts much wider than the pad is thick, which a wide window may hold, feel the tail more.
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
            response: Arc::new(Response::by(curve, coarse_mm_per_px, reach_mm, window, elastic.tolerance_um)),
            coarser: elastic.coarser().map(|coarser| Box::new(Self::by(curve, &coarser, material, view))),
            grids: Arc::default(),
            object: None,
        }
    }

    /// The same pad of another Young's modulus, kPa: displacements do not depend on it.
    pub(crate) fn with_youngs_modulus(&self, youngs_modulus_kpa: f64) -> Self {
        let coarser = self.coarser.as_ref().map(|coarser| Box::new(coarser.with_youngs_modulus(youngs_modulus_kpa)));
        Self { youngs_modulus_kpa, coarser, ..self.clone() }
    }

    /// Displacement around one pressed pixel of the solver's grid, mm, for Young's modulus 1: lags from 0 up along x and
    /// y, 0 beyond the last.
    pub fn kernel(&self) -> &Grid<f32> {
        self.response.kernel()
    }

    /// See [`super::Pad::window`].
    pub fn window(&self, depth_mm: f64) -> Window {
        // Some tolerances more, because nobody can tell within them whether a bulge got there.
        let bulge_mm = (BULGE * depth_mm).max(4e-3 * self.elastic.tolerance_um);
        Window { margin_px: self.margin_px, above_mm: (bulge_mm + self.taken_for_mm()).min(self.layer.thickness_mm) }
    }

    /// See [`super::Pad::higher`]. Over a pad's thickness above it nothing is looked for: linear theory has ended long
    /// before.
    pub(crate) fn higher(&self, window: Window, contact: &Contact) -> Option<Window> {
        let spare_mm = 2e-3 * self.elastic.tolerance_um + self.taken_for_mm();
        let reached = f64::from(contact.bulge_mm) + spare_mm >= window.above_mm;
        let higher = Window { above_mm: (2.0 * window.above_mm).min(self.layer.thickness_mm), ..window };
        (reached && higher.above_mm > window.above_mm).then_some(higher)
    }

    /// Where the surface is interpolated, what is captured this close to it is taken for the object: no object at all
    /// must stay further away, mm.
    fn taken_for_mm(&self) -> f64 {
        if self.elastic.resolution == Resolution::Full { 0.0 } else { f64::from(self.close_mm()) }
    }

    /// Presses the object into the pad, with the friction that there is.
    pub fn press(&self, depth: &Depth) -> Contact {
        self.press_with(depth, None)
    }

    /// The same with what touches beyond the window.
    pub fn press_with(&self, depth: &Depth, beyond: Option<&Beyond>) -> Contact {
        let beyond = beyond.and_then(|beyond| beyond.displacement.as_ref());
        let drag = self.drag(depth, beyond);
        self.press_into(depth, Given { beyond, drag: drag.as_ref() })
    }

    /// Presses the object into a pad that is displaced already.
    pub(crate) fn press_into(&self, depth: &Depth, given: Given<'_>) -> Contact {
        let margin = depth.margin_px;
        let (width, height) = (depth.penetration.width - 2 * margin, depth.penetration.height - 2 * margin);
        let solved = Numerics { residual_um: Some(0.0), model_error_um: Ok(0.0), ..Numerics::DIRECT };
        let mut contact = untouched(width, height, Some(0.0), solved);
        if depth.touching.is_empty() && given.beyond.is_none() {
            return contact;
        }
        self.press_in(depth, given, &mut contact);
        contact
    }

    fn press_in(&self, depth: &Depth, given: Given<'_>, contact: &mut Contact) {
        let lattice = self.lattice(depth);
        let Thinned { penetration, cut } = &mut self.thinned(depth, lattice);
        let object = if lattice.factor == 1 { &depth.penetration } else { &*penetration };
        // The pressure has to do what is not done yet.
        let mut left = Cow::Borrowed(object);
        if !given.is_nothing() {
            given.add_to(left.to_mut(), self.placed(depth, lattice), lattice, [0; 2], -1.0);
        }
        let corner = depth.margin_px - SURFACE_BORDER;
        let (width, height) = (contact.surface.width, contact.surface.height);
        let seen = Rect { x0: corner, y0: corner, x1: corner + width, y1: corner + height };
        let mut solution = self.solve(&left, cut, lattice.box_around(seen), None);
        solution.settle(&left, cut);
        let Rect { x0, y0, .. } = solution.seen;
        given.add_to(&mut solution.displacement, self.placed(depth, lattice), lattice, [x0, y0], 1.0);
        solution.converged &= given.drag.is_none_or(|drag| drag.converged);
        if let Some(beyond) = given.beyond {
            contact.surface = beyond.crop(seen);
        }
        contact.bulge_mm = solution.displacement.largest(|w| -w);
        self.fill(&solution, depth, (object, cut), seen, lattice, contact);
        let edge = ContactEdge::of(&contact.mask, &depth.penetration, depth.margin_px, self.mm_per_px);
        let (deepest_mm, thickness_mm) = (f64::from(depth.deepest_mm), self.layer.thickness_mm);
        let error_mm =
            edge.map_or(Ok(0.0), |edge| model_error_mm(deepest_mm, thickness_mm, edge, self.elastic.friction));
        if let Some(drag) = given.drag {
            drag.stiffen(contact, thickness_mm, edge);
        }
        contact.numerics = Numerics {
            converged: solution.converged,
            iterations: solution.iterations,
            residual_um: Some(f64::from(solution.residual_mm) * 1e3),
            model_error_um: error_mm.map(|mm| 1e3 * mm),
        };
        contact.load = self.load(&mut solution, depth, lattice);
    }

    /// The object on the solver's grid.
    fn thinned(&self, depth: &Depth, lattice: Lattice) -> Thinned {
        Thinned::new(lattice, depth, self.mm_per_px, self.response.kernel().at(0, 0))
    }

    /// The points on which the solver works.
    fn lattice(&self, depth: &Depth) -> Lattice {
        Lattice::new(self.elastic.resolution, [depth.penetration.width, depth.penetration.height])
    }

    /// The solution's pressure, and where it acts. `None` without contact.
    fn load(&self, solution: &mut Solution, depth: &Depth, lattice: Lattice) -> Option<Load> {
        let (fine, corner) = ([depth.penetration.width, depth.penetration.height], solution.contact_box);
        let centre_mm = |coarse: usize, k: usize| self.centre_mm(lattice, coarse, fine[k], k);
        let touches = solution.pressure.data.iter().any(|p| *p > 0.0);
        touches.then(|| Load {
            pressure: std::mem::take(&mut solution.pressure),
            origin_mm: [centre_mm(corner.x0, 0), centre_mm(corner.y0, 1)],
            mm_per_px: self.coarse_mm_per_px,
        })
    }

    /// Where a pixel of the solver's grid lies: from the middle of the view, which is the middle of the window.
    fn centre_mm(&self, lattice: Lattice, coarse: usize, fine: usize, k: usize) -> f64 {
        (lattice.centre(coarse, k) + 0.5 - fine as f64 / 2.0) * self.mm_per_px[k]
    }

    /// Solves for the contact within `penetration`, some of whose pixels are cut by walls, and for the displacement in
    /// `seen` at least, beginning with the pressure of `like`, if there is one.
    fn solve(&self, penetration: &Grid<f32>, cut: &mut [CutPixel], seen: Rect, like: Option<&Solution>) -> Solution {
        let tolerance = (self.elastic.tolerance_um * 1e-3) as f32;
        let whole = Rect::whole(penetration.width, penetration.height);
        let mut touching = bounding_box(penetration, |g| g > 0.0);
        let mut solution = Solution {
            contact_box: Rect::default(),
            pressure: Grid::default(),
            seen,
            displacement: Grid::default(),
            converged: true,
            iterations: 0,
            residual_mm: 0.0,
        };
        if touching.is_empty() {
            // The object touches between the pixels of the solver's grid only.
            solution.displacement.reset(seen.width(), seen.height());
            return solution;
        }
        // A press shallower than the tolerance would be solved before it began, whatever its pressure.
        let deepest = penetration.largest(|g| g);
        let goal = tolerance.min(SHALLOW * deepest);
        let touching_px = simd_dispatch(
            #[inline(always)]
            || count(penetration.data.iter().map(|g| *g > 0.0)),
        );
        let area = f64::from(touching_px) * self.coarse_mm_per_px[0] * self.coarse_mm_per_px[1];
        let cutoff = std::f64::consts::PI / libm::sqrt(area);
        // Pile-up may meet the object where it does not reach below the untouched pad: the box grows to hold it.
        const MOST_BOXES: u32 = 12;
        let (mut memory, mut scratch) = (Memory::default(), Scratch::default());
        for round in 0..MOST_BOXES {
            let room = 4 + touching.width().min(touching.height()) / 32;
            let contact_box = touching.grown(room, whole.x1, whole.y1);
            let operator = self.response.operator(contact_box, contact_box);
            operator.prepare(&mut memory);
            operator.prepare_undo(cutoff, &mut memory);
            let mut problem = ContactProblem {
                operator: &operator,
                softest: self.response.softest() as f32,
                penetration: penetration.crop(contact_box),
                cut: Vec::new(),
                own: self.response.kernel().at(0, 0),
                tolerance_mm: goal,
                max_iterations: self.elastic.max_iterations - solution.iterations.min(self.elastic.max_iterations),
            };
            problem.place(cut, contact_box);
            let mut pressure = Grid::default();
            let large = touching.area() > COARSER_FROM_PX;
            if let Some(like) = like.filter(|_| round == 0) {
                pressure.reset(contact_box.width(), contact_box.height());
                pressure.paste(&like.pressure, like.contact_box, contact_box);
            } else if round == 0
                && let Some(coarser) = self.coarser.as_ref().filter(|_| large)
            {
                pressure = coarser.guess(penetration, contact_box);
                problem.refine(&mut pressure);
            } else if round == 0 {
                problem.guess(&mut pressure);
            } else {
                pressure.reset(contact_box.width(), contact_box.height());
                pressure.paste(&solution.pressure, solution.contact_box, contact_box);
            }
            let Outcome { iterations, residual_mm } = problem.solve(&mut pressure, &mut scratch, &mut memory);
            problem.note_stopped(cut, contact_box);
            solution.iterations += iterations;
            solution.contact_box = contact_box;
            solution.pressure = pressure;

            let all = contact_box.united(seen);
            solution.seen = all;
            if all == contact_box {
                solution.displacement.clone_from(&scratch.displacement);
                problem.take_back(&solution.pressure, &mut solution.displacement);
            } else {
                let operator = self.response.operator(contact_box, all);
                operator.prepare(&mut memory);
                operator.displace(&solution.pressure, &mut memory, &mut solution.displacement);
            }
            let missed = solution.check(penetration, cut, 2.0 * tolerance);
            // In a view wider than the contact the displacement was computed anew, without the rounding of all steps.
            let solved = residual_mm <= tolerance && solution.residual_mm <= 2.0 * tolerance;
            solution.converged = solved && missed.is_empty();
            if missed.is_empty() || solution.iterations >= self.elastic.max_iterations {
                break;
            }
            touching = touching.united(missed);
        }
        solution
    }

    /// A guess of the pressure on a grid twice as fine as this pad's, within its box `part`: the solution on this one.
    fn guess(&self, fine: &Grid<f32>, part: Rect) -> Grid<f32> {
        let lattice = Lattice::new(Resolution::Half, [fine.width, fine.height]);
        let penetration = lattice.thin_out(fine, self.mm_per_px);
        let solution = self.solve(&penetration, &mut [], Rect::default(), None);
        let mut pressure = Grid::new(part.width(), part.height());
        if !solution.contact_box.is_empty() {
            let enlarge = |values, shape, out| lattice.enlarge(values, solution.contact_box, part, shape, out);
            enlarge(&solution.pressure, Shape::Linear, &mut pressure);
            let mut surface = Grid::default();
            enlarge(&solution.displacement, Shape::Cubic, &mut surface);
            let close = self.close_mm();
            for y in 0..part.height() {
                let object = &fine.row(part.y0 + y)[part.x0..part.x1];
                for ((p, w), g) in pressure.row_mut(y).iter_mut().zip(surface.row(y)).zip(object) {
                    *p = if w - g < close { *p } else { 0.0 };
                }
            }
        }
        pressure
    }

    /// An interpolated surface that is no further than this from the object may touch it, mm.
    fn close_mm(&self) -> f32 {
        0.1 * self.coarse_mm_per_px[0].min(self.coarse_mm_per_px[1]) as f32
    }
}
