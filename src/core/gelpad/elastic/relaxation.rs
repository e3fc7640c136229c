//! Relaxation of the pad: a linear viscoelastic layer with a Prony series (Christensen 1982).
//!
//! Under a shape that is held, every stress in the layer falls to the same share 1 - sum of g (1 - exp(-t / T)) of what
//! it was at first; the modes have the shares g and the times T. Poisson's ratio stays, so the layer's response to loads
//! stays, too. Let q be the loads that the present shape would need without relaxation; they follow from the shape as
//! loads of an elastic layer do. In a step in which q changes at a constant rate, the loads p at its end are
//!
//! ```text
//! p = c q - r     c = 1 - sum of g (1 - a)     r = sum of g (a q0 - e h0)     e = exp(-dt / T)     a = (1 - e) T / dt
//! ```
//!
//! where q0 and h0 are those before the step, and h = e h0 + a (q - q0) is what a mode still carries of q. So a step is a
//! contact on an elastic layer of c times the stiffness, which the loads r / c have already displaced (Kaliske and
//! Rothert 1997). The memory lies still in the pad, while the object's frame moves.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::friction_history::FrictionHistory;
use super::layer::ElasticLayer;
use super::placed::{GridPlacement, PlacedDisplacement, interpolate_bilinear};
use super::response::{OperatorBuffers, PressureResponse};
use super::traction_grid::{TractionGrid, Vector};
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::gelpad::planar::{FrameAxes, PlanarFrame};

/// One mode of a pad's relaxation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RelaxationMode {
    /// Share of the pad's stiffness that is lost with time, above 0. All shares together are below 1.
    pub share: f64,
    /// Time in which that falls to 1/e, s, 0.0001 to 1000000.
    pub time_s: f64,
}

impl RelaxationMode {
    /// Returns what is wrong with the modes of a pad, if anything.
    pub fn find_errors(modes: &[Self]) -> Vec<String> {
        if modes.len() > MOST_MODES {
            return vec![format!("there are {} modes, and at most {MOST_MODES} are possible", modes.len())];
        }
        let mut errors = Vec::new();
        for (number, mode) in modes.iter().enumerate() {
            if mode.share.is_nan() || mode.share <= 0.0 || mode.share >= 1.0 {
                errors.push(format!("the share of mode {} is {}: it is above 0 and below 1", number + 1, mode.share));
            }
            if !(1e-4..=1e6).contains(&mode.time_s) {
                let given = mode.time_s;
                errors.push(format!("the time of mode {} is {given} s: it is 0.0001 to 1000000 s", number + 1));
            }
        }
        let lost: f64 = modes.iter().map(|mode| mode.share).sum();
        if lost >= MOST_LOST {
            errors.push(format!("the shares add up to {lost}: more than {MOST_LOST} of the stiffness is lost"));
        }
        errors
    }

    /// Returns the share of its first stress that a pad still has after a time under a shape that is held.
    pub fn remaining_share(modes: &[Self], time_s: f64) -> f64 {
        1.0 - modes.iter().map(|mode| mode.share * (1.0 - libm::exp(-time_s / mode.time_s))).sum::<f64>()
    }
}

/// Most modes of a pad.
const MOST_MODES: usize = 8;

/// Largest sum of the shares. Something has to carry the object in the end.
const MOST_LOST: f64 = 0.99;

/// Remembered loads that would displace the pad by less than this, mm, are forgotten once nothing touches.
const FORGOTTEN_MM: f64 = 1e-6;

/// Room around the remembered loads, in thicknesses, so that their copies on the torus have no influence.
const ROOM: f64 = 6.0;

/// A load on the pad over Young's modulus: along x and y, and into the pad.
type Stress = [f32; 3];

/// What the pad remembers of the loads on it.
#[derive(Clone)]
pub(crate) struct StressMemory {
    modes: Arc<[RelaxationMode]>,
    layer: ElasticLayer,
    response: Arc<PressureResponse>,
    mm_per_px: [f64; 2],
    /// Where the memory lies in the pad's plane, or on the chart of a curved gel.
    pub frame: PlanarFrame,
    /// Loads that the present shape would need without relaxation: q.
    elastic: Grid<Stress>,
    /// What each mode still carries of them: h.
    carried: Vec<Grid<Stress>>,
    /// The part in which they may differ from 0.
    occupied: Rect,
    step: MemoryStep,
    /// The grid for tractions over a part of the memory.
    traction_grid: Option<(Rect, TractionGrid)>,
}

/// The memory's part in a step.
#[derive(Clone, Default)]
struct MemoryStep {
    /// Stiffness of the layer over that of an elastic one: c.
    stiffness: f64,
    /// For each mode, e and a.
    factors: Vec<[f64; 2]>,
    /// The part of the memory that `lasting` covers.
    part: Rect,
    /// Loads that have already displaced the pad: r / c.
    lasting: Grid<Stress>,
    /// Displacement into the pad by their pressure; `None` if it is negligible.
    down: Option<PlacedDisplacement>,
}

/// Motion of the pad in its own plane by the remembered loads, in the memory's frame.
pub(crate) struct RememberedMotion {
    /// Along x and y, mm.
    components: [Grid<f32>; 2],
    placement: GridPlacement,
    frame: FrameAxes,
}

impl RememberedMotion {
    /// Returns the motion at a point of the frame `at`, along its axes, mm.
    pub fn at(&self, at: &FrameAxes, place_mm: [f64; 2]) -> [f64; 2] {
        let place = self.frame.to_frame(at.to_sensor(place_mm));
        let GridPlacement { origin_mm, mm_per_px } = self.placement;
        let px = [0, 1].map(|k| (place[k] - origin_mm[k]) / mm_per_px[k]);
        let moved = self.components.each_ref().map(|part| f64::from(interpolate_bilinear(part, px, f32::INFINITY)));
        at.direction_to_frame(self.frame.direction_to_sensor(moved))
    }
}

impl StressMemory {
    /// Makes an empty memory of `size` pixels around the origin.
    pub fn new(
        modes: &[RelaxationMode],
        layer: ElasticLayer,
        response: Arc<PressureResponse>,
        mm_per_px: [f64; 2],
        size: [usize; 2],
    ) -> Self {
        Self {
            modes: modes.into(),
            layer,
            response,
            mm_per_px,
            frame: PlanarFrame::default(),
            elastic: Grid::new(size[0], size[1]),
            carried: modes.iter().map(|_| Grid::new(size[0], size[1])).collect(),
            occupied: Rect::default(),
            step: MemoryStep { stiffness: 1.0, ..MemoryStep::default() },
            traction_grid: None,
        }
    }

    /// Returns the stiffness of the layer in this step over that of an elastic one.
    pub fn stiffness(&self) -> f64 {
        self.step.stiffness
    }

    /// Returns true if no load is remembered in this step.
    pub fn is_blank(&self) -> bool {
        self.step.part.is_empty()
    }

    /// Begins a step that takes `duration_s`.
    pub fn begin_step(&mut self, duration_s: f64) {
        let factors: Vec<[f64; 2]> = self
            .modes
            .iter()
            .map(|mode| {
                let ratio = duration_s / mode.time_s;
                // expm1 keeps the digits of short steps.
                [libm::exp(-ratio), if ratio > 0.0 { -libm::expm1(-ratio) / ratio } else { 1.0 }]
            })
            .collect();
        let lost: f64 = self.modes.iter().zip(&factors).map(|(mode, [_, mean])| mode.share * (1.0 - mean)).sum();
        let stiffness = 1.0 - lost;
        let part = self.occupied;
        let mut lasting = Grid::<Stress>::new(part.width(), part.height());
        for ((mode, [decay, mean]), carried) in self.modes.iter().zip(&factors).zip(&self.carried) {
            let [of_elastic, of_carried] = [mode.share * mean / stiffness, mode.share * decay / stiffness];
            for y in 0..part.height() {
                let elastic = &self.elastic.row(part.y0 + y)[part.x0..part.x1];
                let carried = &carried.row(part.y0 + y)[part.x0..part.x1];
                for ((to, q), h) in lasting.row_mut(y).iter_mut().zip(elastic).zip(carried) {
                    for k in 0..3 {
                        to[k] += (of_elastic * f64::from(q[k]) - of_carried * f64::from(h[k])) as f32;
                    }
                }
            }
        }
        self.step = MemoryStep { stiffness, factors, part, lasting, down: None };
        self.step.down = self.displacement_by_pressure();
    }

    /// Computes the displacement into the pad by the remembered pressure; `None` if nothing is remembered.
    fn displacement_by_pressure(&self) -> Option<PlacedDisplacement> {
        let part = self.step.part;
        if part.is_empty() {
            return None;
        }
        let pressure = component(&self.step.lasting, 2);
        let kernel = self.response.kernel();
        let reach = kernel.width.max(kernel.height);
        let target = part.grown(reach, self.elastic.width, self.elastic.height);
        let operator = self.response.operator(part, target);
        let (mut memory, mut values_mm) = (OperatorBuffers::default(), Grid::default());
        operator.prepare(&mut memory);
        operator.displace(&pressure, &mut memory, &mut values_mm);
        Some(PlacedDisplacement { values_mm, placement: self.placement_of([target.x0, target.y0]) })
    }

    /// Returns the displacement into the pad by the remembered pressure, in a frame from its point `origin_mm`; `None` if
    /// nothing is remembered.
    pub fn down_in_frame(&self, frame: &PlanarFrame, origin_mm: [f64; 2]) -> Option<PlacedDisplacement> {
        let down = self.step.down.as_ref()?;
        let at = frame.axes().to_frame(self.frame.origin_mm);
        let at = [0, 1].map(|k| at[k] - origin_mm[k]);
        Some(down.in_turned_frame(at, self.frame.angle_rad - frame.angle_rad))
    }

    /// Computes the displacement into the pad by all remembered loads, in the pad's plane; `None` if it is below
    /// `unseen_mm`.
    pub fn displacement(&mut self, unseen_mm: f64) -> Option<PlacedDisplacement> {
        let mut down = self.step.down.clone()?;
        if self.step.lasting.data.iter().any(|load| load[0] != 0.0 || load[1] != 0.0) {
            let (corner, grid, tractions) = self.loaded_grid(Rect::default());
            let reach = grid.reach_px(0.5 * ROOM);
            let values_mm = grid.normal_displacement(&tractions, reach);
            let first = [0, 1].map(|k| corner[k] as f64 - reach[k] as f64);
            let drag = PlacedDisplacement { values_mm, placement: self.placement_at(first) };
            let placement = down.placement;
            drag.add_to(&mut down.values_mm, placement, [0; 2], 1.0);
        }
        let down = down.in_turned_frame(self.frame.origin_mm, self.frame.angle_rad);
        (down.largest_mm() >= unseen_mm).then_some(down)
    }

    /// Computes the motion in the pad's plane by the remembered loads, there and over points of the frame `at`; `None`
    /// if nothing is remembered.
    pub fn motion(&mut self, at: &FrameAxes, points_mm: impl Iterator<Item = [f64; 2]>) -> Option<RememberedMotion> {
        if self.is_blank() {
            return None;
        }
        let own = self.frame.axes();
        let mut wanted = Rect::default();
        for place in points_mm {
            let [x, y] = self.pixel_at(own.to_frame(at.to_sensor(place))).map(|px| px.max(0.0) as usize);
            let (x, y) = (x.min(self.elastic.width - 1), y.min(self.elastic.height - 1));
            wanted = wanted.union(Rect { x0: x, y0: y, x1: x + 1, y1: y + 1 });
        }
        let part = self.step.part;
        let (corner, grid, tractions) = self.loaded_grid(wanted);
        let mut pressure = Grid::new(grid.size[0], grid.size[1]);
        let values = grid.motion_under_tractions(&tractions);
        let (placement, lasting) = (self.placement_at(corner.map(|at| at as f64)), &self.step.lasting);
        for y in 0..part.height() {
            let row = &mut pressure.row_mut(part.y0 - corner[1] + y)[part.x0 - corner[0]..];
            row.iter_mut().zip(lasting.row(y)).for_each(|(to, load)| *to = load[2]);
        }
        let Some((_, grid)) = &mut self.traction_grid else { return None };
        grid.set_whole_contact(&pressure);
        let pushed = grid.motion_under_pressure();
        let components = [0, 1].map(|k| Grid {
            width: pushed.width,
            height: pushed.height,
            data: values.data.iter().zip(&pushed.data).map(|(dragged, pushed)| dragged[k] + pushed[k]).collect(),
        });
        Some(RememberedMotion { components, placement, frame: own })
    }

    /// Returns the grid for tractions over the remembered loads and `wanted`, its first pixel, and the remembered
    /// tractions on it.
    fn loaded_grid(&mut self, wanted: Rect) -> ([usize; 2], &mut TractionGrid, Grid<Vector>) {
        let part = self.step.part;
        let needed = part.union(wanted);
        let known = self.traction_grid.take().filter(|(known, _)| {
            known.x0 <= needed.x0 && known.y0 <= needed.y0 && known.x1 >= needed.x1 && known.y1 >= needed.y1
        });
        let (grown, grid) = known.unwrap_or_else(|| {
            let spare = 8 + needed.width().max(needed.height()) / 3;
            let grown = needed.grown(spare, self.elastic.width, self.elastic.height);
            let placed = [self.placement_of([0, 0]).origin_mm, self.mm_per_px];
            (grown, TractionGrid::new(self.layer, placed, grown, usize::MAX, ROOM))
        });
        let mut tractions = Grid::new(grown.width(), grown.height());
        for y in 0..part.height() {
            let row = &mut tractions.row_mut(part.y0 - grown.y0 + y)[part.x0 - grown.x0..];
            row.iter_mut().zip(self.step.lasting.row(y)).for_each(|(to, load)| *to = [load[0], load[1]]);
        }
        let (_, grid) = self.traction_grid.insert((grown, grid));
        ([grown.x0, grown.y0], grid, tractions)
    }

    /// Returns the remembered loads of this step: place in the pad's plane, mm, and force over Young's modulus, mm^2,
    /// along x and y and into the pad.
    pub fn forces(&self) -> impl Iterator<Item = ([f64; 2], [f64; 3])> {
        let (part, axes) = (self.step.part, self.frame.axes());
        let area = self.mm_per_px[0] * self.mm_per_px[1];
        let pixels = (0..part.height()).flat_map(move |y| (0..part.width()).map(move |x| [x, y]));
        pixels.filter_map(move |[x, y]| {
            let load = self.step.lasting.at(x, y);
            (load != [0.0; 3]).then(|| {
                let place = self.placement_of([part.x0 + x, part.y0 + y]).origin_mm;
                let [along, down, into] = load.map(|part| area * f64::from(part));
                let [along, down] = axes.direction_to_sensor([along, down]);
                (axes.to_sensor(place), [along, down, into])
            })
        })
    }

    /// Ends a step with the loads that it led to, in the frame `at`.
    pub fn finish_step(&mut self, loads: &FrictionHistory, at: &FrameAxes) {
        let own = self.frame.axes();
        let found = loads.traction_field();
        let mut next = self.occupied;
        if let Some((field, pressure)) = &found {
            let part = bounding_box(pressure, |p| p > 0.0);
            let ends = [[part.x0, part.y0], [part.x1, part.y0], [part.x0, part.y1], [part.x1, part.y1]];
            for corner in ends {
                let place = [0, 1].map(|k| field.origin_mm[k] + (corner[k] as f64 - 0.5) * field.mm_per_px[k]);
                let px = self.pixel_at(own.to_frame(at.to_sensor(place)));
                let [x, y] = [0, 1].map(|k| {
                    let most = [self.elastic.width, self.elastic.height][k] as f64;
                    [(px[k] - 1.0).clamp(0.0, most) as usize, (px[k] + 2.0).clamp(0.0, most) as usize]
                });
                next = next.union(Rect { x0: x[0], y0: y[0], x1: x[1], y1: y[1] });
            }
        }
        let part = self.step.part;
        let divide = 1.0 / self.step.stiffness;
        for y in next.y0..next.y1 {
            for x in next.x0..next.x1 {
                let mut elastic = match part.contains([x, y]) {
                    true => self.step.lasting.at(x - part.x0, y - part.y0),
                    false => [0.0; 3],
                };
                if let Some((field, pressure)) = &found {
                    let place = at.to_frame(own.to_sensor(self.placement_of([x, y]).origin_mm));
                    let placed = GridPlacement { origin_mm: field.origin_mm, mm_per_px: field.mm_per_px };
                    if let Some([p, u, v]) = interpolate_inside([pressure, &field.x, &field.y], placed, place) {
                        let along = own.direction_to_frame(at.direction_to_sensor([u, v].map(f64::from)));
                        let load = [along[0], along[1], f64::from(p)];
                        elastic = [0, 1, 2].map(|k| elastic[k] + (divide * load[k]) as f32);
                    }
                }
                let before = std::mem::replace(&mut self.elastic.row_mut(y)[x], elastic);
                for (carried, [decay, mean]) in self.carried.iter_mut().zip(&self.step.factors) {
                    let there = &mut carried.row_mut(y)[x];
                    *there = [0, 1, 2].map(|k| {
                        let change = f64::from(elastic[k]) - f64::from(before[k]);
                        (decay * f64::from(there[k]) + mean * change) as f32
                    });
                }
            }
        }
        self.occupied = next;
        if found.is_none() {
            self.forget_traces();
        }
    }

    /// Forgets all loads.
    pub fn clear(&mut self) {
        for grid in std::iter::once(&mut self.elastic).chain(&mut self.carried) {
            grid.data.fill([0.0; 3]);
        }
        self.occupied = Rect::default();
        self.step = MemoryStep { stiffness: self.step.stiffness, ..MemoryStep::default() };
    }

    /// Forgets all loads if they are too small to show.
    fn forget_traces(&mut self) {
        let part = self.occupied;
        let most = (part.y0..part.y1)
            .flat_map(|y| &self.elastic.row(y)[part.x0..part.x1])
            .flatten()
            .fold(0.0_f32, |most, load| most.max(load.abs()));
        if f64::from(most) * self.response.largest_compliance() < FORGOTTEN_MM {
            self.clear();
        }
    }

    /// Returns where the memory's pixels lie, counted from `first`, in its frame.
    fn placement_of(&self, first: [usize; 2]) -> GridPlacement {
        self.placement_at(first.map(|at| at as f64))
    }

    fn placement_at(&self, first: [f64; 2]) -> GridPlacement {
        let size = [self.elastic.width, self.elastic.height];
        let origin_mm = [0, 1].map(|k| (first[k] + 0.5 - 0.5 * size[k] as f64) * self.mm_per_px[k]);
        GridPlacement { origin_mm, mm_per_px: self.mm_per_px }
    }

    /// Returns the pixel at a point of the memory's frame; whole numbers are centres.
    fn pixel_at(&self, place_mm: [f64; 2]) -> [f64; 2] {
        let size = [self.elastic.width, self.elastic.height];
        [0, 1].map(|k| place_mm[k] / self.mm_per_px[k] - 0.5 + 0.5 * size[k] as f64)
    }
}

/// Returns one component of loads.
fn component(loads: &Grid<Stress>, k: usize) -> Grid<f32> {
    Grid { width: loads.width, height: loads.height, data: loads.data.iter().map(|load| load[k]).collect() }
}

/// The first of the two values around a place along an axis, and how far the place is beyond it. A place that is off a
/// value by rounding alone is on it.
fn linear_tap(place: f64) -> (f64, f32) {
    let nearest = libm::round(place);
    let place = if (place - nearest).abs() < 1e-6 { nearest } else { place };
    let first = libm::floor(place);
    (first, (place - first) as f32)
}

/// Interpolates grids bilinearly at a point; beyond their borders values are 0. `None` if the point is farther out.
fn interpolate_inside<const N: usize>(
    grids: [&Grid<f32>; N],
    placed: GridPlacement,
    place_mm: [f64; 2],
) -> Option<[f32; N]> {
    let size = [grids[0].width, grids[0].height];
    let mut taps = [(0.0, 0.0); 2];
    for k in 0..2 {
        taps[k] = linear_tap((place_mm[k] - placed.origin_mm[k]) / placed.mm_per_px[k]);
        if taps[k].0 < -1.0 || taps[k].0 >= size[k] as f64 {
            return None;
        }
    }
    let [(x, along), (y, across)] = taps;
    let inside = |at: f64, count: usize| (at >= 0.0 && at < count as f64).then_some(at as usize);
    Some(grids.map(|grid| {
        let value = |dx: f64, dy: f64| match (inside(x + dx, size[0]), inside(y + dy, size[1])) {
            (Some(x), Some(y)) => grid.at(x, y),
            _ => 0.0,
        };
        let line = |dy: f64| (1.0 - along) * value(0.0, dy) + along * value(1.0, dy);
        (1.0 - across) * line(0.0) + across * line(1.0)
    }))
}
