//! From an object over the pad to the correction of the linear layer: whether one is needed, the box, and what is tried
//! in turn.

use super::StrainCorrection;
use super::deformed::{CapturedObject, DeformedSurface};
use super::height_map::{HeightMap, open_by_ball};
use super::press::{PressOptions, RubberSolver};
use super::settings::StrainSettings;
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::{count_true, simd_dispatch};
use crate::depth::Depth;
use crate::effects::Requirement;
use crate::gelpad::elastic::ElasticPad;
use crate::gelpad::elastic::fft::fast_length;
use crate::gelpad::elastic::model_error::{ContactEdge, WALL_SLOPE, model_error_mm};
use crate::gelpad::elastic::placed::GridPlacement;

/// How thoroughly the rubber is solved.
struct Effort {
    /// What is tried, one after the other until a solution is found: nodes of the box per thickness, and the radius by
    /// which the object's edges are rounded, thicknesses.
    tries: &'static [(f64, f64)],
    /// Layers of elements.
    layers: usize,
    /// Room between the contact and the box's border, thicknesses.
    room: f64,
    /// Samples of the object from one node of the contact's grid to the next: it has walls sharper than that grid.
    samples: usize,
    /// Load steps of a pad that sticks, thicknesses: the shorter they are, the better it is known where points first
    /// touch.
    sticking_step: f64,
    /// Most steps of the fixed point in a try.
    max_iterations: u32,
    /// Steps without progress after which a load step has failed.
    patience: u32,
}

/// For the model of its own.
const THOROUGH: Effort = Effort {
    tries: &[(10.0, 1.0 / 16.0), (8.0, 1.0 / 11.0), (8.0, 1.0 / 4.0)],
    layers: 6,
    room: 2.5,
    samples: 4,
    sticking_step: 0.05,
    max_iterations: 80,
    patience: 12,
};
/// For deep presses beside walls along which the pad slides: a finer grid gains nothing there.
const DEEP_WALLS: Effort =
    Effort { tries: &[(8.0, 1.0 / 16.0), (8.0, 1.0 / 11.0), (8.0, 1.0 / 6.0), (8.0, 1.0 / 4.0)], ..THOROUGH };
/// For the correction of the elastic model.
const CHEAP: Effort = Effort {
    tries: &[(7.0, 1.0 / 8.0), (6.0, 1.0 / 6.0), (6.0, 1.0 / 3.0)],
    layers: 4,
    room: 2.0,
    samples: 2,
    sticking_step: 0.1,
    max_iterations: 48,
    patience: 8,
};

/// Slope between pixels from which on they are taken for the two sides of a wall.
const SMOOTH_SLOPE: f64 = 2.0;

/// Depth from which on a press beside a wall is deep, thicknesses.
const DEEP: f64 = 0.25;

/// Most nodes along a side of the box, and with a distance between them that the job says.
const MOST_NODES: f64 = 128.0;
const MOST_OWN_NODES: f64 = 320.0;

/// Fewest nodes per thickness, where a contact is wide.
const FEWEST_NODES: f64 = 4.0;

/// Nodes across a small contact, as many as there is room for in the box. On fewer, edges and force are off by as much
/// as linear theory.
const NODES_ACROSS: f64 = 8.0;

/// How far around the object's lower parts nodes may touch it, thicknesses: so far a node may move.
const REACH: f64 = 0.3;

/// Share of the tolerance below which the linear layer's expected error is negligible, under smooth edges and beside
/// walls. The law for it is right within a factor of two in the ring around the contact; at single pixels beside walls
/// the error is several times larger.
const NEGLIGIBLE_SHARES: [f64; 2] = [0.15, 0.07];

/// Share of the linear layer's expected error that is left as the largest error beside the contact, as a rule: where
/// edges are hardly rounded, and where they are rounded by more than `SHARP` thicknesses or the contact is narrower than
/// `COARSE_BELOW` nodes. In half of 121 presses of the finite elements' table it is less than 0.25, in nine of ten less
/// than 0.9.
const ERROR_SHARES: [f64; 2] = [0.3, 0.7];
const SHARP: f64 = 0.1;

/// Nodes across a contact below which it is not resolved, and more of the expected error is left.
const COARSE_BELOW: f64 = 4.5;

/// Largest radius by which edges are rounded, as a share of the depth: shallow tips are not to vanish.
const MOST_OPENED: f64 = 0.5;

/// Least share of the object's volume below the undeformed pad that must be left when its edges are rounded.
const LEAST_KEPT: f64 = 0.5;

/// The reason why a press was not corrected.
pub type Reason = &'static str;

const NOTHING_TOUCHES: Reason = "nothing reaches into the pad";
/// Why a press needs no correction: the linear layer is as exact.
pub const WITHIN_TOLERANCE: Reason = "linear theory is within the tolerance";
const CUT_OFF: Reason = "the contact goes on beyond the captured window, where linear theory alone is used";
const TOO_WIDE: Reason = "the contact is too wide for a box of rubber: linear theory is used";
const NOT_CONVERGED: Reason = "rubber at finite strain was not solved within the tolerance: linear theory is used";

impl ElasticPad {
    /// Decides whether the difference between rubber and a linear layer would be visible.
    pub fn finite_strain_required(&self, depth: &Depth) -> Requirement {
        let Some(settings) = self.strain_settings() else { return Requirement::Absent("the gelpad model is linear") };
        let (touching, penetration) = (depth.touching, &depth.penetration);
        if touching.is_empty() {
            return Requirement::Absent(NOTHING_TOUCHES);
        }
        let Rect { x0, y0, x1, y1 } = touching;
        if x0 == 0 || y0 == 0 || x1 == penetration.width || y1 == penetration.height {
            return Requirement::Absent(CUT_OFF);
        }
        // No error is larger than the press is deep, and below the tolerance a box has only rounding to add.
        if f64::from(penetration.largest(|mm| mm)) < 1e-3 * settings.tolerance_um {
            return Requirement::Absent(WITHIN_TOLERANCE);
        }
        let edge = self.overlap_edge(depth);
        let effort = self.effort(depth, edge, &settings);
        if self.tries(touching, &settings, effort).is_none() {
            return Requirement::Absent(TOO_WIDE);
        }
        let negligible_um = NEGLIGIBLE_SHARES[usize::from(is_wall(edge))] * settings.tolerance_um;
        if self.expected_error_mm(depth, edge) < 1e-3 * negligible_um {
            return Requirement::Unneeded(WITHIN_TOLERANCE);
        }
        Requirement::Needed("large strains change the surface")
    }

    /// Solves for the correction if the press needs one; `None` also where it was not found.
    pub fn correct_if_required(&self, depth: &Depth) -> Option<StrainCorrection> {
        self.strain_settings()?;
        match self.finite_strain_required(depth) {
            Requirement::Needed(_) => self.solve_finite_strain(depth).ok(),
            Requirement::Unneeded(_) | Requirement::Absent(_) => None,
        }
    }

    /// Returns the error that linear theory is expected to have, mm, judged by where the object reaches below the
    /// undeformed pad. The contact is smaller than that, and gentler at its edge.
    fn expected_error_mm(&self, depth: &Depth, edge: Option<ContactEdge>) -> f64 {
        let Some(edge) = edge else { return 0.0 };
        let deepest_mm = f64::from(depth.largest_penetration_mm());
        let known = model_error_mm(deepest_mm, self.layer().thickness_mm, edge, self.friction());
        known.unwrap_or(f64::INFINITY)
    }

    /// Measures the edge of the part of the object below the undeformed pad.
    fn overlap_edge(&self, depth: &Depth) -> Option<ContactEdge> {
        let mut overlap = Grid::new(depth.penetration.width, depth.penetration.height);
        for (mask, mm) in overlap.data.iter_mut().zip(&depth.penetration.data) {
            *mask = if *mm > 0.0 { 255 } else { 0 };
        }
        ContactEdge::from_mask(&overlap, &depth.penetration, 0, self.mm_per_px())
    }

    fn effort(&self, depth: &Depth, edge: Option<ContactEdge>, settings: &StrainSettings) -> &'static Effort {
        let deep = f64::from(depth.deepest_mm) >= DEEP * self.layer().thickness_mm;
        match settings.thorough {
            false => &CHEAP,
            true if is_wall(edge) && deep && !settings.stick => &DEEP_WALLS,
            true => &THOROUGH,
        }
    }

    /// Returns the distance between the nodes of the box, mm, `nodes` for each thickness unless the job says another;
    /// `None` if the contact is too wide for a box.
    fn node_spacing_mm(&self, touching: Rect, settings: &StrainSettings, nodes: f64, room: f64) -> Option<f64> {
        let h = self.layer().thickness_mm;
        let sides_mm = self.sides_mm(touching);
        let side_mm = sides_mm[0].max(sides_mm[1]) + 2.0 * room * h;
        match settings.spacing_mm {
            Some(own_mm) => (side_mm <= own_mm * MOST_OWN_NODES).then_some(own_mm),
            None => {
                let spacing_mm = (h / nodes).max(side_mm / MOST_NODES);
                (spacing_mm <= h / FEWEST_NODES).then_some(spacing_mm)
            }
        }
    }

    /// Returns what is tried in turn: the distance between nodes, mm, and the radius by which edges are rounded,
    /// thicknesses; `None` if the contact is too wide for a box.
    fn tries(&self, touching: Rect, settings: &StrainSettings, effort: &Effort) -> Option<Vec<(f64, f64)>> {
        let usual = |(nodes, opening): &(f64, f64)| {
            Some((self.node_spacing_mm(touching, settings, *nodes, effort.room)?, *opening))
        };
        let mut tries: Vec<(f64, f64)> = effort.tries.iter().map(usual).collect::<Option<_>>()?;
        let [x, y] = self.sides_mm(touching);
        let side_mm = x.max(y) + 2.0 * effort.room * self.layer().thickness_mm;
        let fine_mm = (x.min(y) / NODES_ACROSS).max(side_mm / MOST_NODES);
        let is_resolved = x.min(y) >= COARSE_BELOW * fine_mm;
        if settings.thorough && settings.spacing_mm.is_none() && is_resolved && fine_mm < tries[0].0 {
            tries.insert(0, (fine_mm, tries[0].1));
        }
        Some(tries)
    }

    fn sides_mm(&self, touching: Rect) -> [f64; 2] {
        let mm_per_px = self.mm_per_px();
        [touching.width() as f64 * mm_per_px[0], touching.height() as f64 * mm_per_px[1]]
    }

    /// Solves for the difference between rubber and the linear layer under an object.
    ///
    /// # Errors
    ///
    /// The reason why there is none.
    pub fn solve_finite_strain(&self, depth: &Depth) -> Result<StrainCorrection, Reason> {
        let settings = self.strain_settings().ok_or("the gelpad model is linear")?;
        let effort = self.effort(depth, self.overlap_edge(depth), &settings);
        let (mut solver, mut last_spacing_mm) = (None, 0.0);
        let mut iterations = 0;
        for (spacing_mm, opening) in self.tries(depth.touching, &settings, effort).ok_or(TOO_WIDE)? {
            if spacing_mm != last_spacing_mm {
                solver = None;
                last_spacing_mm = spacing_mm;
            }
            let solver = solver.get_or_insert_with(|| self.prepare_box(depth.touching, spacing_mm, effort));
            let most_mm = MOST_OPENED * f64::from(depth.largest_penetration_mm());
            let opened_mm = (opening * self.layer().thickness_mm).min(most_mm);
            match self.try_opened(depth, solver, opened_mm, (&settings, effort)) {
                Try::Solved(found) => {
                    let [x, y] = self.sides_mm(depth.touching);
                    let is_coarse = x.min(y) < COARSE_BELOW * spacing_mm;
                    let error_share = if is_coarse { ERROR_SHARES[1] } else { found.error_share };
                    return Ok(StrainCorrection { iterations: iterations + found.iterations, error_share, ..*found });
                }
                Try::Failed(more) => iterations += more,
                // What is thinner than a ball is thinner than the next one, too.
                Try::TooLittleLeft => break,
            }
        }
        Err(NOT_CONVERGED)
    }

    fn prepare_box(&self, touching: Rect, spacing_mm: f64, effort: &Effort) -> RubberSolver {
        let room_mm = 2.0 * effort.room * self.layer().thickness_mm;
        let size = self.sides_mm(touching).map(|side_mm| fast_length(((side_mm + room_mm) / spacing_mm) as usize));
        RubberSolver::new(self.layer(), size, [spacing_mm; 2], effort.layers)
    }

    /// Solves for the difference under an object whose edges are rounded.
    fn try_opened(
        &self,
        depth: &Depth,
        solver: &mut RubberSolver,
        opened_mm: f64,
        (settings, effort): (&StrainSettings, &Effort),
    ) -> Try {
        let (h, mm_per_px) = (self.layer().thickness_mm, self.mm_per_px());
        let Depth { penetration, touching, .. } = depth;
        let (nodes, node_mm) = (solver.contact_size(), solver.contact_spacing_mm());
        // The middle node lies over the middle of the contact.
        let middle_px = [0.5 * (touching.x0 + touching.x1) as f64, 0.5 * (touching.y0 + touching.y1) as f64];
        let first_px: [f64; 2] =
            std::array::from_fn(|k| middle_px[k] - (nodes[k] / 2) as f64 * node_mm[k] / mm_per_px[k] - 0.5);
        let samples = effort.samples;
        let smooth_mm = mm_per_px.map(|mm| (SMOOTH_SLOPE * mm) as f32);
        let sample_mm = node_mm.map(|mm| mm / samples as f64);
        let step_px = std::array::from_fn(|k| sample_mm[k] / mm_per_px[k]);
        let captured = sample_window(penetration, nodes.map(|nodes| nodes * samples), first_px, step_px, smooth_mm);
        let opened = open_by_ball(&captured, sample_mm, opened_mm);
        let nothing = opened.data.iter().copied().fold(f32::INFINITY, f32::min);
        let Rect { x0, y0, x1, y1 } = bounding_box(&opened, |g| g > nothing);
        let region = Rect { x0: x0 / samples, y0: y0 / samples, x1: x1.div_ceil(samples), y1: y1.div_ceil(samples) };
        let volume = |object: &Grid<f32>| object.data.iter().map(|g| f64::from(g.max(0.0))).sum::<f64>();
        if volume(&opened) < LEAST_KEPT * volume(&captured) || opened.largest(|g| g) <= 0.0 {
            return Try::TooLittleLeft;
        }
        let reach = (REACH * h / node_mm[0].min(node_mm[1])) as usize + 2;
        let touching_px = simd_dispatch(
            #[inline(always)]
            || count_true(penetration.data.iter().map(|g| *g > 0.0)),
        );
        let options = PressOptions {
            region: region.grown(reach, nodes[0], nodes[1]),
            contact_mm: libm::sqrt(f64::from(touching_px) * mm_per_px[0] * mm_per_px[1]),
            tolerance_mm: 1e-3 * settings.tolerance_um,
            max_iterations: effort.max_iterations,
            patience: effort.patience,
            load_step_mm: if settings.stick { effort.sticking_step * h } else { f64::INFINITY },
            stick: settings.stick,
        };
        let object = HeightMap::new(opened, sample_mm, samples);
        let press = solver.press(&object, &options);
        if !press.converged {
            return Try::Failed(press.iterations);
        }
        let window = [penetration.width, penetration.height];
        let placed = |first_px: [f64; 2], spacing_mm| GridPlacement {
            origin_mm: std::array::from_fn(|k| (first_px[k] + 0.5 - 0.5 * window[k] as f64) * mm_per_px[k]),
            mm_per_px: spacing_mm,
        };
        let captured = CapturedObject { penetration, placement: placed([0.0; 2], mm_per_px) };
        let nodes = placed(first_px, node_mm);
        let surface = DeformedSurface::new(solver.contact_grid(), &press, &object, nodes, &captured);
        if !surface.is_finite() {
            return Try::Failed(press.iterations);
        }
        Try::Solved(Box::new(StrainCorrection {
            displacement: surface.difference,
            motion: surface.motion,
            reach_mm: surface.reach_mm,
            opened_mm,
            sticks: settings.stick,
            error_share: ERROR_SHARES[usize::from(opened_mm > SHARP * h)],
            iterations: press.iterations,
            residual_um: 1e3 * press.residual_mm,
        }))
    }
}

fn is_wall(edge: Option<ContactEdge>) -> bool {
    edge.is_some_and(|edge| edge.slope >= WALL_SLOPE)
}

/// Outcome of one try.
enum Try {
    Solved(Box<StrainCorrection>),
    /// After so many steps.
    Failed(u32),
    /// The ball does not fit into much of the object: a correction for the rest would be none for the whole.
    TooLittleLeft,
}

/// Samples the captured object by [`interpolate`]; beyond the window there is nothing.
fn sample_window(
    penetration: &Grid<f32>,
    samples: [usize; 2],
    first_px: [f64; 2],
    step_px: [f64; 2],
    smooth_mm: [f32; 2],
) -> Grid<f32> {
    let nothing = penetration.data.iter().copied().fold(f32::INFINITY, f32::min);
    let taps = |k: usize, size: usize| -> Vec<Option<(usize, f32)>> {
        let place = |sample: usize| first_px[k] + sample as f64 * step_px[k];
        let tap =
            |place: f64| (0.0..(size - 1) as f64).contains(&place).then(|| (place as usize, place.fract() as f32));
        (0..samples[k]).map(|sample| tap(place(sample))).collect()
    };
    let (columns, rows) = (taps(0, penetration.width), taps(1, penetration.height));
    let mut sampled = Grid::new(samples[0], samples[1]);
    sampled.data.fill(nothing);
    for (y, row) in rows.iter().enumerate() {
        let Some((above, s)) = row else { continue };
        let (upper, lower) = (penetration.row(*above), penetration.row(above + 1));
        for (to, column) in sampled.row_mut(y).iter_mut().zip(&columns) {
            let Some((left, t)) = column else { continue };
            let line = |row: &[f32]| interpolate(row[*left], row[left + 1], *t, smooth_mm[0]);
            *to = interpolate(line(upper), line(lower), *s, smooth_mm[1]);
        }
    }
    sampled
}

/// Interpolates by a straight line; a step of more than `smooth_mm` becomes a wall half-way.
fn interpolate(from: f32, to: f32, share: f32, smooth_mm: f32) -> f32 {
    let steepness = ((to - from).abs() / smooth_mm).max(1.0);
    let share = (0.5 + steepness * (share - 0.5)).clamp(0.0, 1.0);
    // Without rounding beyond the ends: where there is nothing, nothing is found.
    (from + share * (to - from)).clamp(from.min(to), from.max(to))
}
