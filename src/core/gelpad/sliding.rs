//! An object that slides, turns and rolls on the pad, step by step, and what friction remembers of it.
//!
//! Pressure and tractions are found in a frame that goes with the object's surface, on pixels of their own
//! ([`super::elastic::history`]). While neither depth nor tilt changes the pressure stays as it is.

use std::sync::Arc;

use glam::DVec3;

use super::elastic::friction::Drag;
use super::elastic::history::{History, Moved, Normal, Step, StickSlip};
use super::elastic::inplane::{Field, InPlane, Load};
use super::elastic::layer::ElasticLayer;
use super::elastic::shear::Friction;
use super::elastic::{self, Elastic};
use super::material::Material;
use super::planar::{PlanarFrame, PlanarMotion};
use crate::base::chart::Chart;
use crate::base::gel::Site;
use crate::base::grid::{Grid, Rect, Resolution, bounding_box};
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::height_map::HeightMap;
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::texture::{Texture, TexturePlacement};
use crate::depth::{self, Depth};
use crate::effects::{EffectLog, EffectPolicy};
use crate::pose::Pose;

pub mod over_gel;

/// A step of an object: where it comes to be, and how its surface at the contact moves in the pad's plane on the way. The two
/// differ where it rolls: then the object moves, but its surface stays where it touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectStep {
    /// Where the object is at the end.
    pub pose: Pose,
    /// How deep its lowest point then reaches below the undeformed pad, mm; 0 or less without contact.
    pub depth_mm: f64,
    /// The motion.
    pub motion: PlanarMotion,
}

impl ObjectStep {
    /// A step that leads to where an indenter is.
    pub fn to(indenter: &Indenter, motion: PlanarMotion) -> Self {
        Self { pose: indenter.pose, depth_mm: indenter.depth_mm, motion }
    }

    pub(crate) fn is_finite(&self) -> bool {
        let Self { pose, depth_mm, motion: PlanarMotion { shift_mm: [x, y], turn_rad, about_mm: [u, v] } } = self;
        let in_place = pose.rotation.is_finite() && pose.translation_mm.is_finite() && depth_mm.is_finite();
        in_place && [x, y, turn_rad, u, v].iter().all(|number| number.is_finite())
    }
}

/// Force and moment of the object on the pad, in the sensor's frame, about the middle of the image on the undeformed pad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// N.
    pub force_n: [f64; 3],
    /// N mm.
    pub torque_nmm: [f64; 3],
}

impl Wrench {
    /// So many times as large.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { force_n: self.force_n.map(|n| factor * n), torque_nmm: self.torque_nmm.map(|nmm| factor * nmm) }
    }

    /// Both together.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            force_n: [0, 1, 2].map(|k| self.force_n[k] + other.force_n[k]),
            torque_nmm: [0, 1, 2].map(|k| self.torque_nmm[k] + other.torque_nmm[k]),
        }
    }
}

/// What beside its shape decides where an object meets the pad.
#[derive(Clone, Copy, Debug)]
pub struct Ground<'a> {
    /// What the camera sees of the pad; height maps are of it.
    pub camera: &'a View,
    /// Micro-texture of the object.
    pub texture: Option<&'a Texture>,
    /// How far a curved pad lies below its highest point, mm, on the grid of the surface in view.
    pub drop_mm: Option<&'a Grid<f32>>,
}

/// What friction did in a frame of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slip {
    /// Whether any pixel touches.
    pub touches: bool,
    /// Share of the contact that sticks, 0 to 1; 0 without contact.
    pub stick_fraction: f64,
    /// True if nothing sticks of what touched before, too.
    pub gross: bool,
    /// How far the pad has slid along the object, the mean over the contact summed up since it began, mm.
    pub displacement_mm: [f64; 2],
    /// Energy that this turned into heat in this frame, N mm.
    pub heat_nmm: f64,
    /// Iterations for tractions.
    pub iterations: u32,
    /// How far friction's law is not met, mm.
    pub residual_mm: f64,
    /// Whether that is within the tolerance, in each step of the frame.
    pub converged: bool,
}

/// Pixels along the longer side of the view on which tractions are solved for, by how fine the model of the pad is.
fn fineness(resolution: Resolution) -> f64 {
    match resolution {
        Resolution::Quarter => 96.0,
        Resolution::Half => 160.0,
        Resolution::Full => 240.0,
    }
}

/// The pad as the frame of an object sees it, made ready once for a sensor.
#[derive(Clone)]
pub struct FramePad {
    view: View,
    pad: elastic::Pad,
    material: Material,
    tolerance_mm: f64,
}

impl FramePad {
    /// Of a pad that the camera sees in `view`.
    pub(crate) fn new(elastic: &Elastic, material: &Material, view: &View) -> Self {
        let extent = [0, 1].map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
        let longest = extent[0].max(extent[1]);
        let camera = view.mm_per_px[0].max(view.mm_per_px[1]);
        let pitch = camera.max(longest / fineness(elastic.resolution));
        // An even number, so that the middle lies between pixels in every place that the view takes.
        let size = extent.map(|mm| ((0.5 * mm / pitch) as usize + 1) * 2);
        let view = View { resolution_px: size, mm_per_px: [pitch; 2] };
        let elastic = Elastic { resolution: Resolution::Full, friction: None, ..*elastic };
        let pad = elastic::Pad::new(&elastic, material, &view);
        Self { view, pad, material: *material, tolerance_mm: TOLERANCE * 1e-3 * elastic.tolerance_um.min(1.0) }
    }
}

/// Of the contact's tolerance (at most 1 um), the share to which tractions are solved: it is how far a pixel alone
/// would go, of which many together make more.
const TOLERANCE: f64 = 0.1;

/// Poses in the frame that differ by less are the same: mm, or parts of a rotation.
const SAME: f64 = 1e-9;

/// Heights whose deepest point is another by less than this share of the depth are the same.
const SAME_DEPTH: f64 = 5e-3;

/// An object on the pad, from one frame of a sequence to the next.
pub struct Sliding {
    youngs_modulus_kpa: f64,
    thickness_mm: f64,
    /// What is seen of the object's frame.
    view: View,
    /// The pad in that view.
    pad: elastic::Pad,
    history: History,
    /// Where its frame lies in the pad's plane, or on the chart of a gel that is not flat.
    frame: PlanarFrame,
    /// How the object has moved in the plane that it is posed over: on a flat pad the same.
    way: PlanarFrame,
    /// The chart that the frame lies on, and where on the gel the object is closest.
    over: Option<(Chart, Site)>,
    /// The object in its frame, and its depth, when the pressure was found.
    pressed: Option<(Pose, f64)>,
    /// It touched the window's border then: it may go on beyond.
    cut: bool,
    /// The middle of the view in the object's frame, in pixels.
    middle_px: [i64; 2],
    slip: Slip,
}

impl std::fmt::Debug for Sliding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sliding").field("frame", &self.frame).field("slip", &self.slip).finish_non_exhaustive()
    }
}

impl Sliding {
    /// True if it goes over such a pad.
    pub(crate) fn is_over(&self, pad: &FramePad) -> bool {
        (self.view, self.thickness_mm, self.youngs_modulus_kpa)
            == (pad.view, pad.material.thickness_mm, pad.material.youngs_modulus_kpa)
    }

    /// Without contact.
    pub(crate) fn new(pad: &FramePad, friction: Friction) -> Self {
        let FramePad { view, pad, material, tolerance_mm } = pad.clone();
        let coefficient = friction.coefficient().unwrap_or(f64::INFINITY);
        Self {
            youngs_modulus_kpa: material.youngs_modulus_kpa,
            thickness_mm: material.thickness_mm,
            history: History::new(ElasticLayer::new(&material), coefficient, view.mm_per_px, tolerance_mm),
            view,
            pad,
            frame: PlanarFrame::default(),
            way: PlanarFrame::default(),
            over: None,
            pressed: None,
            cut: false,
            middle_px: [0; 2],
            slip: Slip::none(),
        }
    }

    /// What friction did in the last frame.
    pub(crate) fn slip(&self) -> Slip {
        self.slip
    }

    /// A texture where it now lies, if it lay at `laid` at the start.
    pub(crate) fn carried(&self, laid: TexturePlacement) -> TexturePlacement {
        let yaw_deg = laid.yaw_deg + self.way.angle_rad.to_degrees();
        TexturePlacement { origin_mm: self.way.axes().to_sensor(laid.origin_mm), yaw_deg }
    }

    /// Goes through the steps of a frame, under an indenter of which only the shape counts. The texture is as it lay at the
    /// start.
    pub(crate) fn advance(&mut self, steps: &[ObjectStep], indenter: &Indenter, ground: Ground<'_>) {
        self.begin();
        for step in steps {
            let moved = self.frame.moved(step.motion);
            self.way = self.frame;
            let in_frame = self.frame.inverse(step.pose);
            let stays = self.pressed.is_some_and(|(pose, depth_mm)| {
                // Of heights the deepest pixel is another in every place.
                let slack = if matches!(indenter.shape, Shape::HeightMap(_)) { SAME_DEPTH * depth_mm } else { 0.0 };
                (depth_mm - step.depth_mm).abs() <= slack
                    && same(&pose, &in_frame)
                    && (ground.drop_mm.is_none() || moved == Moved::default())
                    // What the window cut goes on, and comes into view.
                    && (!self.cut || self.middle() == self.middle_px)
            });
            if !stays {
                self.middle_px = self.middle();
            }
            let found = (!stays).then(|| self.press(indenter, step.depth_mm, in_frame, self.middle_px, ground));
            self.take(found, (in_frame, step.depth_mm), moved);
        }
    }

    /// Begins a frame.
    fn begin(&mut self) {
        let displacement_mm = self.slip.displacement_mm;
        self.slip = Slip { displacement_mm, converged: true, ..Slip::none() };
    }

    /// Goes on under the pressure `found` of an object in a place; under the same without one.
    fn take(&mut self, found: Option<(Option<Load>, bool)>, placed: (Pose, f64), moved: Moved) {
        let normal = match &found {
            None => Normal::Same,
            Some((Some(load), _)) => Normal::Pressed(load),
            Some((None, _)) => Normal::Nothing,
        };
        if let Some((load, cut)) = &found {
            self.cut = *cut;
            self.pressed = load.is_some().then_some(placed);
        }
        let done = self.history.step(&normal, moved);
        self.count(&done);
    }

    /// The pressure of the object where it is, in its frame; and whether it touches the window's border.
    fn press(
        &self,
        indenter: &Indenter,
        depth_mm: f64,
        in_frame: Pose,
        middle_px: [i64; 2],
        ground: Ground<'_>,
    ) -> (Option<Load>, bool) {
        if depth_mm <= 0.0 {
            return (None, false);
        }
        let middle_mm = [0, 1].map(|k| middle_px[k] as f64 * self.view.mm_per_px[k]);
        let mut pose = in_frame;
        pose.translation_mm -= DVec3::new(middle_mm[0], middle_mm[1], 0.0);
        let shape = match &indenter.shape {
            Shape::HeightMap(map) => Shape::HeightMap(Arc::new(self.seen(map, ground.camera, middle_mm))),
            mesh => mesh.clone(),
        };
        let there = Indenter { shape, pose, depth_mm };
        let texture = ground.texture.map(|texture| {
            let TexturePlacement { origin_mm, yaw_deg } =
                texture.laid.unwrap_or_else(|| TexturePlacement::with(&indenter.pose));
            texture.laid_out(TexturePlacement { origin_mm: [0, 1].map(|k| origin_mm[k] - middle_mm[k]), yaw_deg })
        });
        self.solved(depth_mm, middle_mm, |window| {
            let mut effects = EffectLog::new(EffectPolicy::default());
            let mut depth = self.captured(&there, texture.as_ref(), window, &mut effects);
            if let Some(drop) = ground.drop_mm {
                self.lower(&mut depth, drop, ground.camera, middle_mm, window.above_mm);
            }
            depth
        })
    }

    /// The pressure under what is captured around a place of the frame; and whether it touches the window's border.
    fn solved(
        &self,
        depth_mm: f64,
        middle_mm: [f64; 2],
        mut captured: impl FnMut(depth::Window) -> Depth,
    ) -> (Option<Load>, bool) {
        let mut window = self.pad.window(depth_mm);
        loop {
            let depth = captured(window);
            let contact = self.pad.press(&depth);
            match self.pad.higher(window, &contact) {
                Some(higher) => window = higher,
                None => {
                    let Rect { x0, y0, x1, y1 } = depth.touching;
                    let cut = x0 == 0 || y0 == 0 || x1 == depth.penetration.width || y1 == depth.penetration.height;
                    let origin_mm = |load: &Load| [0, 1].map(|k| load.origin_mm[k] + middle_mm[k]);
                    return (contact.load.map(|load| Load { origin_mm: origin_mm(&load), ..load }), cut);
                }
            }
        }
    }

    /// Where the middle of the view is to be: what the camera sees is what counts; the view stays while that is nearly in its
    /// middle.
    fn middle(&self) -> [i64; 2] {
        let pitch = self.view.mm_per_px;
        let seen = self.frame.axes().to_frame([0.0; 2]);
        let off = |k: usize| (seen[k] / pitch[k] - self.middle_px[k] as f64).abs();
        match (0..2).any(|k| off(k) > 0.1 * self.view.resolution_px[k] as f64) {
            true => [0, 1].map(|k| libm::round(seen[k] / pitch[k]) as i64),
            false => self.middle_px,
        }
    }

    /// Normal force on the pad if the object were pressed so deep at a pose, N.
    pub(crate) fn normal_force_n(&self, indenter: &Indenter, pose: Pose, depth_mm: f64, ground: Ground<'_>) -> f64 {
        let (load, _) = self.press(indenter, depth_mm, self.frame.inverse(pose), self.middle(), ground);
        load.map_or(0.0, |load| {
            let sum: f64 = load.pressure.data.iter().map(|p| f64::from(p.max(0.0))).sum();
            1e-3 * self.youngs_modulus_kpa * sum * load.mm_per_px[0] * load.mm_per_px[1]
        })
    }

    fn captured(
        &self,
        there: &Indenter,
        texture: Option<&Texture>,
        window: depth::Window,
        effects: &mut EffectLog,
    ) -> Depth {
        depth::penetration(there, texture, None, self.thickness_mm, &self.view, window, effects)
    }

    /// A height map of the camera's view, in the object's frame; beyond the view its border goes on.
    fn seen(&self, map: &HeightMap, camera: &View, middle_mm: [f64; 2]) -> HeightMap {
        let [width, height] = self.view.resolution_px;
        // Walls stay walls.
        let axes = self.frame.axes();
        let jump = 2.0 * camera.mm_per_px[0].max(camera.mm_per_px[1]) as f32;
        let mut above_mm = Grid::new(width, height);
        for y in 0..height {
            for (x, value) in above_mm.row_mut(y).iter_mut().enumerate() {
                let mm = self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                let there = camera.point_px(axes.to_sensor([0, 1].map(|k| mm[k] + middle_mm[k])));
                *value = between(&map.above_mm, there.map(|px| px - 0.5), jump);
            }
        }
        HeightMap { above_mm, unseen_px: map.unseen_px }
    }

    /// Takes an overlap against a curved pad.
    fn lower(&self, depth: &mut Depth, drop: &Grid<f32>, camera: &View, middle_mm: [f64; 2], above_mm: f64) {
        let floor = 0.0 - above_mm as f32;
        let margin = depth.margin_px as f64;
        let axes = self.frame.axes();
        for y in 0..depth.penetration.height {
            for x in 0..depth.penetration.width {
                let px = [x as f64 + 0.5 - margin, y as f64 + 0.5 - margin];
                let mm = self.view.point_mm(px);
                let there = camera.point_px(axes.to_sensor([0, 1].map(|k| mm[k] + middle_mm[k])));
                let below = between(drop, there.map(|px| px - 0.5 + SURFACE_BORDER as f64), f32::INFINITY);
                let value = &mut depth.penetration.row_mut(y)[x];
                *value = if *value > floor { (*value - below).max(floor) } else { *value };
            }
        }
        depth.measure();
    }

    fn count(&mut self, done: &Step) {
        let slip = &mut self.slip;
        slip.touches = done.touching > 0;
        if !slip.touches {
            slip.displacement_mm = [0.0; 2];
        }
        slip.stick_fraction = done.sticking as f64 / done.touching.max(1) as f64;
        slip.gross = done.gross;
        let [dx, dy] = self.way.axes().turned(done.slip_mm);
        slip.displacement_mm = [slip.displacement_mm[0] + dx, slip.displacement_mm[1] + dy];
        // kPa mm^3 are 1e-3 N mm.
        slip.heat_nmm += 1e-3 * self.youngs_modulus_kpa * done.heat;
        slip.iterations += done.solved.iterations;
        slip.residual_mm = slip.residual_mm.max(done.solved.residual_mm);
        slip.converged &= done.solved.converged || !slip.touches;
    }

    /// What the object does to the pad.
    pub(crate) fn wrench(&self) -> Wrench {
        let sums = self.history.sums();
        let newtons = 1e-3 * self.youngs_modulus_kpa;
        let [fx, fy] = self.frame.axes().turned(sums.force).map(|force| newtons * force);
        let fz = -newtons * sums.normal;
        let [x, y] = self.frame.origin_mm;
        let [lever_x, lever_y] = self.frame.axes().turned(sums.lever).map(|lever| newtons * lever);
        // r x f of what presses at z = 0, and of what pulls.
        let torque_x = -(lever_y - y * fz);
        let torque_y = lever_x - x * fz;
        let torque_z = newtons * sums.moment + x * fy - y * fx;
        Wrench { force_n: [fx, fy, fz].map(|n| n + 0.0), torque_nmm: [torque_x, torque_y, torque_z].map(|n| n + 0.0) }
    }

    /// What tractions displace into the pad; `None` where that is nothing, or less than `unseen_mm`.
    pub(crate) fn drag(&mut self, unseen_mm: f64) -> Option<Drag> {
        let (down, origin_mm) = self.history.displaced()?;
        let PlanarFrame { origin_mm: frame_mm, angle_rad } = self.frame;
        let drag = Drag::of_frame(down, origin_mm, self.view.mm_per_px, frame_mm, angle_rad);
        (drag.largest_mm() >= unseen_mm).then_some(drag)
    }

    /// Motion of the pad in its plane under a pressure and the tractions.
    pub(crate) fn motion(&self, in_plane: &InPlane, load: &Load) -> Field {
        if self.history.is_at_rest() {
            return in_plane.under_pressure(load);
        }
        // A pixel as some points of which each is no larger than the values that it falls on.
        let parts = (libm::ceil(2.0 * self.view.mm_per_px[0] / in_plane.pitch_mm()) as usize).clamp(1, 8);
        let share = 1.0 / (parts * parts) as f64;
        let pitch = self.view.mm_per_px;
        let within = move |part: usize, k: usize| ((part as f64 + 0.5) / parts as f64 - 0.5) * pitch[k];
        let axes = self.frame.axes();
        let points = self.history.forces().flat_map(|(place, force)| {
            let force = axes.turned(force).map(|part| share * part);
            (0..parts * parts).map(move |part| {
                let at = [place[0] + within(part % parts, 0), place[1] + within(part / parts, 1)];
                (axes.to_sensor(at), force)
            })
        });
        in_plane.under(load, points)
    }

    /// Of the pixels of a view that touch, what the pad does there.
    pub(crate) fn states(&self, mask: &Grid<u8>, view: &View) -> Grid<StickSlip> {
        let part = bounding_box(mask, |value| value > 0);
        let mut states = Grid::new(mask.width, mask.height);
        let axes = self.frame.axes();
        let place = |px: [f64; 2]| axes.to_frame(view.point_mm(px));
        let (start, right, down) = (place([0.5, 0.5]), place([1.5, 0.5]), place([0.5, 1.5]));
        for y in part.y0..part.y1 {
            for x in part.x0..part.x1 {
                if mask.at(x, y) > 0 {
                    let (column, row) = (x as f64, y as f64);
                    let place_mm =
                        [0, 1].map(|k| start[k] + column * (right[k] - start[k]) + row * (down[k] - start[k]));
                    states.row_mut(y)[x] = match self.history.state_at(place_mm) {
                        // The camera's pixels are finer than the tractions': at the rim of the contact.
                        StickSlip::Apart => StickSlip::Slips,
                        state => state,
                    };
                }
            }
        }
        states
    }
}

impl Slip {
    /// Without contact.
    pub(crate) fn none() -> Self {
        Self {
            touches: false,
            stick_fraction: 0.0,
            gross: false,
            displacement_mm: [0.0; 2],
            heat_nmm: 0.0,
            iterations: 0,
            residual_mm: 0.0,
            converged: true,
        }
    }
}

fn same(a: &Pose, b: &Pose) -> bool {
    a.rotation.abs_diff_eq(b.rotation, SAME) && a.translation_mm.abs_diff_eq(b.translation_mm, SAME)
}

/// Bilinear; beyond the border, what is at the border. Where values are further apart than `jump`, the nearest.
fn between(grid: &Grid<f32>, at: [f64; 2], jump: f32) -> f32 {
    let axis = |k: usize, count: usize| {
        let at = at[k].clamp(0.0, (count - 1) as f64);
        let first = (at as usize).min(count.saturating_sub(2));
        (first, (at - first as f64) as f32)
    };
    let ((x, t), (y, s)) = (axis(0, grid.width), axis(1, grid.height));
    let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
    let value = |(x, y): (usize, usize)| grid.at(x.min(grid.width - 1), y.min(grid.height - 1));
    let values = corners.map(value);
    let [lowest, highest] = [f32::min, f32::max].map(|of| values.into_iter().fold(values[0], of));
    if highest.is_infinite() || highest - lowest > jump {
        return value((x + usize::from(t > 0.5), y + usize::from(s > 0.5)));
    }
    let line = |y: usize| grid.at(x, y) + t * (grid.at((x + 1).min(grid.width - 1), y) - grid.at(x, y));
    let (upper, lower) = (line(y), line((y + 1).min(grid.height - 1)));
    upper + s * (lower - upper)
}
