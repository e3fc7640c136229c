//! An object that slides, turns and rolls on the pad step by step, with the friction history of the contact.
//!
//! Pressure and tractions are computed in a frame that moves with the object's surface, on a pixel grid of its own
//! ([`super::elastic::friction_history`]). While neither depth nor tilt changes, the pressure stays as it is.

use std::sync::Arc;

use glam::DVec3;

use super::elastic::friction::FrictionDisplacement;
use super::elastic::friction_history::{
    FrameMotion, FrictionHistory, RelaxedPad, StepOutcome, StepPressure, StickSlip,
};
use super::elastic::in_plane::{DisplacementField, InPlaneResponse, Load};
use super::elastic::layer::ElasticLayer;
use super::elastic::placed::{GridPlacement, PlacedDisplacement, interpolate_bilinear};
use super::elastic::relaxation::{RelaxationMode, StressMemory};
use super::elastic::shear::Friction;
use super::elastic::{self, Elastic, PriorDisplacement};
use super::material::Material;
use super::planar::{PlanarFrame, PlanarMotion};
use super::traction_map::TractionMap;
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

pub mod on_curved_gel;

/// One step of an object: its pose at the end, and how its surface at the contact moves in the pad's plane meanwhile.
/// The two differ where the object rolls: then it moves, but its surface rests at the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectStep {
    /// Pose of the object at the end of the step.
    pub pose: Pose,
    /// Depth of the object's lowest point below the undeformed pad at the end, mm; 0 or less without contact.
    pub depth_mm: f64,
    /// Motion of the object's surface at the contact.
    pub motion: PlanarMotion,
    /// Time that the step takes, s, 0 or above. It matters to pads that relax.
    pub duration_s: f64,
}

impl ObjectStep {
    /// Farthest that the object of a sequence may be from the sensor along an axis, mm: a thousand kilometres. Positions
    /// there are still known to a nanometre.
    pub const FARTHEST_MM: f64 = 1e9;

    /// Makes the step that leads to the pose of an indenter; it takes no time.
    pub fn to(indenter: &Indenter, motion: PlanarMotion) -> Self {
        Self { pose: indenter.pose, depth_mm: indenter.depth_mm, motion, duration_s: 0.0 }
    }

    /// Returns the step with another duration, s.
    pub fn lasting(self, duration_s: f64) -> Self {
        Self { duration_s, ..self }
    }

    pub(crate) fn is_finite(&self) -> bool {
        let Self { pose, depth_mm, motion, duration_s } = self;
        let PlanarMotion { shift_mm: [x, y], turn_rad, about_mm: [u, v] } = motion;
        let in_place = pose.rotation.is_finite() && pose.translation_mm.is_finite() && depth_mm.is_finite();
        let takes_time = duration_s.is_finite() && *duration_s >= 0.0;
        in_place && takes_time && [x, y, turn_rad, u, v].iter().all(|number| number.is_finite())
    }

    /// Returns true if the motion leads no farther than from one allowed position to another, turned by any angle.
    pub(crate) fn stays_near(&self) -> bool {
        let PlanarMotion { shift_mm: [x, y], about_mm: [u, v], .. } = self.motion;
        [x, y, u, v].iter().all(|mm| mm.abs() <= 10.0 * Self::FARTHEST_MM)
    }
}

/// Force and moment of the object on the pad, in the sensor's frame, about the centre of the image on the undeformed
/// pad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force, N.
    pub force_n: [f64; 3],
    /// Moment, N mm.
    pub torque_nmm: [f64; 3],
}

impl Wrench {
    /// Returns the wrench multiplied by a factor.
    pub(crate) fn scaled_by(self, factor: f64) -> Self {
        Self { force_n: self.force_n.map(|n| factor * n), torque_nmm: self.torque_nmm.map(|nmm| factor * nmm) }
    }

    /// Returns the sum of two wrenches.
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            force_n: [0, 1, 2].map(|k| self.force_n[k] + other.force_n[k]),
            torque_nmm: [0, 1, 2].map(|k| self.torque_nmm[k] + other.torque_nmm[k]),
        }
    }
}

/// What decides, besides the object's shape, where the object meets the pad.
#[derive(Clone, Copy, Debug)]
pub struct CaptureInput<'a> {
    /// The part of the pad that the camera sees; height maps refer to it.
    pub camera: &'a View,
    /// Micro-texture of the object.
    pub texture: Option<&'a Texture>,
    /// How far a curved pad lies below its highest point, mm, on the grid of the surface in view.
    pub drop_mm: Option<&'a Grid<f32>>,
}

/// The slip between pad and object in one frame of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slip {
    /// True if any pixel touches.
    pub touches: bool,
    /// Share of the contact that sticks, 0 to 1; 0 without contact.
    pub stick_fraction: f64,
    /// True if nothing sticks of what touched before, either: gross slip.
    pub gross: bool,
    /// Distance that the pad has slid along the object since the contact began, mm; the mean over the contact, summed
    /// over the steps.
    pub displacement_mm: [f64; 2],
    /// Energy that slip turned into heat in this frame, N mm.
    pub heat_nmm: f64,
    /// Iterations of the traction solver.
    pub iterations: u32,
    /// Largest violation of the friction conditions, mm.
    pub residual_mm: f64,
    /// True if that is within the tolerance in each step of the frame.
    pub converged: bool,
}

/// What a pad remembers of earlier loads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PadMemory {
    /// The pad is elastic and remembers nothing.
    Elastic,
    /// Nothing has loaded it.
    Blank,
    /// Some load relaxes.
    Loaded,
}

/// What the loads on a pad before a frame's press do to it.
#[derive(Clone, Debug)]
pub struct CarriedLoads {
    /// Displacement by the tractions; `None` if it is negligible.
    pub friction: Option<FrictionDisplacement>,
    /// Displacement by the loads that the pad remembers; `None` if it is negligible.
    pub remembered: Option<PlacedDisplacement>,
    /// What the pad remembers.
    pub memory: PadMemory,
    /// Stiffness of the pad in the last step over that of an elastic one.
    pub stiffness: f64,
}

/// Returns the number of pixels along the longer side of the view on which tractions are solved for, by the resolution
/// of the pad's model.
fn traction_grid_px(resolution: Resolution) -> f64 {
    match resolution {
        Resolution::Quarter => 96.0,
        Resolution::Half => 160.0,
        Resolution::Full => 240.0,
    }
}

/// The pad in the frame of a moving object, prepared once for a sensor.
#[derive(Clone)]
pub struct SlidingPad {
    view: View,
    pad: elastic::ElasticPad,
    material: Material,
    relaxation: Arc<[RelaxationMode]>,
    tolerance_mm: f64,
}

impl SlidingPad {
    /// Prepares a pad that the camera sees in `view`.
    pub(crate) fn new(elastic: &Elastic, material: &Material, relaxation: &[RelaxationMode], view: &View) -> Self {
        let extent = [0, 1].map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
        let longest = extent[0].max(extent[1]);
        let camera_mm = view.mm_per_px[0].max(view.mm_per_px[1]);
        let spacing_mm = camera_mm.max(longest / traction_grid_px(elastic.resolution));
        // An even number of pixels, so that the centre lies between pixels wherever the view is placed.
        let size = extent.map(|mm| ((0.5 * mm / spacing_mm) as usize + 1) * 2);
        let view = View { resolution_px: size, mm_per_px: [spacing_mm; 2] };
        let elastic = Elastic { resolution: Resolution::Full, friction: None, ..*elastic };
        let pad = elastic::ElasticPad::new(&elastic, material, &view);
        let tolerance_mm = TOLERANCE_SHARE * 1e-3 * elastic.tolerance_um.min(1.0);
        Self { view, pad, material: *material, relaxation: relaxation.into(), tolerance_mm }
    }
}

/// Tolerance of the tractions as a share of the contact's tolerance (which counts at most 1 um here). It limits how far
/// a single pixel would still move; many pixels together move more.
const TOLERANCE_SHARE: f64 = 0.1;

/// Poses in the frame that differ by less than this count as equal: mm, or elements of the rotation matrix.
const POSE_TOLERANCE: f64 = 1e-9;

/// Height maps whose depth differs by less than this share count as equally deep.
const DEPTH_TOLERANCE: f64 = 5e-3;

/// An object on the pad, with its state from one frame of a sequence to the next.
#[derive(Clone)]
pub struct Sliding {
    youngs_modulus_kpa: f64,
    thickness_mm: f64,
    /// The view of the pad in the object's frame.
    view: View,
    /// The pad in that view.
    pad: elastic::ElasticPad,
    history: FrictionHistory,
    /// What the pad remembers of earlier loads; `None` if it does not relax.
    memory: Option<StressMemory>,
    /// Position of the object's frame in the pad's plane, or on the chart of a curved gel.
    frame: PlanarFrame,
    /// Motion of the object in the plane that it is posed over; on a flat pad the same as `frame`.
    plane_frame: PlanarFrame,
    /// The chart that the frame lies on, and the point of the gel where the object is closest.
    chart_and_site: Option<(Chart, Site)>,
    /// The chart that the memory lies on, and where the object was closest.
    memory_chart: Option<(Chart, Site)>,
    /// The object's pose and depth when the pressure was solved for; the pose is in the frame on a flat pad.
    pressed_pose: Option<(Pose, f64)>,
    /// True if the object touched the window's border then: it may extend beyond it.
    is_cut: bool,
    /// Centre of the view in the object's frame, in pixels.
    view_centre_px: [i64; 2],
    slip: Slip,
}

impl std::fmt::Debug for Sliding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sliding").field("frame", &self.frame).field("slip", &self.slip).finish_non_exhaustive()
    }
}

impl Sliding {
    /// Returns true if this object moves over the given pad.
    pub(crate) fn matches_pad(&self, pad: &SlidingPad) -> bool {
        (self.view, self.thickness_mm, self.youngs_modulus_kpa)
            == (pad.view, pad.material.thickness_mm, pad.material.youngs_modulus_kpa)
    }

    /// Starts without contact.
    pub(crate) fn new(pad: &SlidingPad, friction: Friction) -> Self {
        let SlidingPad { view, pad, material, relaxation, tolerance_mm } = pad.clone();
        let coefficient = friction.coefficient().unwrap_or(f64::INFINITY);
        let layer = ElasticLayer::new(&material);
        let memory = (!relaxation.is_empty()).then(|| {
            let size = view.resolution_px.map(|px| px + 2 * pad.capture_window(0.0).margin_px);
            StressMemory::new(&relaxation, layer, Arc::clone(pad.response()), view.mm_per_px, size)
        });
        Self {
            youngs_modulus_kpa: material.youngs_modulus_kpa,
            thickness_mm: material.thickness_mm,
            history: FrictionHistory::new(layer, coefficient, view.mm_per_px, tolerance_mm),
            memory,
            view,
            pad,
            frame: PlanarFrame::default(),
            plane_frame: PlanarFrame::default(),
            chart_and_site: None,
            memory_chart: None,
            pressed_pose: None,
            is_cut: false,
            view_centre_px: [0; 2],
            slip: Slip::no_contact(),
        }
    }

    /// Returns the slip of the last frame.
    pub(crate) fn slip(&self) -> Slip {
        self.slip
    }

    /// Returns the present placement of a texture whose placement at the start was `initial`.
    pub(crate) fn texture_placement(&self, initial: TexturePlacement) -> TexturePlacement {
        let yaw_deg = initial.yaw_deg + self.plane_frame.angle_rad.to_degrees();
        TexturePlacement { origin_mm: self.plane_frame.axes().to_sensor(initial.origin_mm), yaw_deg }
    }

    /// Advances through the steps of a frame. Of the indenter, only the shape counts. The texture is the one at the
    /// start.
    pub(crate) fn advance(&mut self, steps: &[ObjectStep], indenter: &Indenter, ground: CaptureInput<'_>) {
        self.begin_frame();
        for step in steps {
            self.begin_step(step);
            let moved = self.frame.move_by(step.motion);
            self.plane_frame = self.frame;
            let in_frame = self.frame.pose_in_frame(step.pose);
            let stays = self.memory.is_none()
                && self.pressed_pose.is_some_and(|(pose, depth_mm)| {
                    // The deepest pixel of a height map changes as the map is resampled.
                    let slack =
                        if matches!(indenter.shape, Shape::HeightMap(_)) { DEPTH_TOLERANCE * depth_mm } else { 0.0 };
                    (depth_mm - step.depth_mm).abs() <= slack
                    && is_same_pose(&pose, &in_frame)
                    && (ground.drop_mm.is_none() || moved == FrameMotion::default())
                    // If the window cut the object, a move of the view brings a new part into it.
                    && (!self.is_cut || self.seen_centre_px() == self.view_centre_px)
                });
            let found = (!stays).then(|| {
                let solve = |centre_px| self.solve_pressure(indenter, step.depth_mm, in_frame, centre_px, ground);
                let (centre_px, found) = self.solve_in_view(solve);
                self.view_centre_px = centre_px;
                found
            });
            self.apply_pressure(found, (in_frame, step.depth_mm), moved);
        }
    }

    /// Begins a frame: keeps the slip so far and resets what counts per frame.
    fn begin_frame(&mut self) {
        let displacement_mm = self.slip.displacement_mm;
        self.slip = Slip { displacement_mm, converged: true, ..Slip::no_contact() };
    }

    /// Begins a step of a frame: what the pad remembers relaxes for as long as it takes.
    fn begin_step(&mut self, step: &ObjectStep) {
        if let Some(memory) = &mut self.memory {
            memory.begin_step(step.duration_s);
        }
    }

    /// Returns the stiffness of the pad in the last step over that of an elastic one.
    fn stiffness(&self) -> f64 {
        self.memory.as_ref().map_or(1.0, StressMemory::stiffness)
    }

    /// Advances friction under a new pressure (`found`), or under the same one (`None`).
    fn apply_pressure(&mut self, found: Option<(Option<Load>, bool)>, placed: (Pose, f64), moved: FrameMotion) {
        let normal = match &found {
            None => StepPressure::Unchanged,
            Some((Some(load), _)) => StepPressure::Load(load),
            Some((None, _)) => StepPressure::NoContact,
        };
        if let Some((load, cut)) = &found {
            self.is_cut = *cut;
            self.pressed_pose = load.is_some().then_some(placed);
        }
        let done = match &mut self.memory {
            None => self.history.step(&normal, moved),
            Some(memory) => {
                let axes = self.frame.axes();
                let motion = match &normal {
                    StepPressure::Load(load) => memory.motion(&axes, load.corners_mm().into_iter()),
                    _ => None,
                };
                let motion_at = motion.map(|motion| move |place: [f64; 2]| motion.at(&axes, place));
                let motion_at = motion_at.as_ref().map(|motion_at| motion_at as &dyn Fn([f64; 2]) -> [f64; 2]);
                let pad = RelaxedPad { stiffness: memory.stiffness(), motion_at };
                let done = self.history.step_on_relaxed_pad(&normal, moved, pad);
                memory.finish_step(&self.history, &axes);
                done
            }
        };
        self.accumulate_slip(&done);
    }

    /// Solves for the pressure of the object at a pose in its frame. Also returns whether the contact touches the
    /// window's border.
    fn solve_pressure(
        &self,
        indenter: &Indenter,
        depth_mm: f64,
        in_frame: Pose,
        middle_px: [i64; 2],
        ground: CaptureInput<'_>,
    ) -> (Option<Load>, bool) {
        if depth_mm <= 0.0 {
            return (None, false);
        }
        let middle_mm = [0, 1].map(|k| middle_px[k] as f64 * self.view.mm_per_px[k]);
        let mut pose = in_frame;
        pose.translation_mm -= DVec3::new(middle_mm[0], middle_mm[1], 0.0);
        let shape = match &indenter.shape {
            Shape::HeightMap(map) => {
                Shape::HeightMap(Arc::new(self.resample_height_map(map, ground.camera, middle_mm)))
            }
            mesh => mesh.clone(),
        };
        let in_window = Indenter { shape, pose, depth_mm };
        let texture = ground.texture.map(|texture| {
            let TexturePlacement { origin_mm, yaw_deg } =
                texture.placement.unwrap_or_else(|| TexturePlacement::at_pose(&indenter.pose));
            texture.with_placement(TexturePlacement { origin_mm: [0, 1].map(|k| origin_mm[k] - middle_mm[k]), yaw_deg })
        });
        self.solve_captured(depth_mm, middle_mm, |window| {
            let mut effects = EffectLog::new(EffectPolicy::default());
            let mut depth = self.capture_object(&in_window, texture.as_ref(), window, &mut effects);
            if let Some(drop) = ground.drop_mm {
                self.subtract_drop(&mut depth, drop, ground.camera, middle_mm, window.above_mm);
            }
            depth
        })
    }

    /// Solves for the pressure of an object that `captured` captures around a point of the frame. Also returns whether
    /// the contact touches the window's border.
    fn solve_captured(
        &self,
        depth_mm: f64,
        middle_mm: [f64; 2],
        mut captured: impl FnMut(depth::CaptureWindow) -> Depth,
    ) -> (Option<Load>, bool) {
        let mut window = self.pad.capture_window(depth_mm);
        let memory = self.memory.as_ref();
        let remembered = memory.and_then(|memory| memory.down_in_frame(&self.frame, middle_mm));
        loop {
            let depth = captured(window);
            let mut contact = match &remembered {
                None => self.pad.press(&depth),
                Some(down) => {
                    let prior = PriorDisplacement { remembered: Some(down), ..PriorDisplacement::default() };
                    self.pad.press_displaced_pad(&depth, prior)
                }
            };
            if let (Some(load), Some(memory)) = (&mut contact.load, memory) {
                load.pressure.data.iter_mut().for_each(|p| *p *= memory.stiffness() as f32);
            }
            match self.pad.higher_window(window, &contact) {
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

    /// Returns the pixel of the frame at which the camera's middle is.
    fn seen_centre_px(&self) -> [i64; 2] {
        let seen = self.frame.axes().to_frame([0.0; 2]);
        [0, 1].map(|k| libm::round(seen[k] / self.view.mm_per_px[k]) as i64)
    }

    /// Solves for a pressure in a view around a centre, which should show what the camera sees. The view stays while it
    /// is close to that, unless it cuts the object: then each pixel brings another part of the object into it. Returns
    /// the centre, and what was found there.
    fn solve_in_view(&self, solve: impl Fn([i64; 2]) -> (Option<Load>, bool)) -> ([i64; 2], (Option<Load>, bool)) {
        let (seen, last) = (self.seen_centre_px(), self.view_centre_px);
        let is_near = (0..2).all(|k| (seen[k] - last[k]).abs() as f64 <= 0.1 * self.view.resolution_px[k] as f64);
        if is_near && !self.is_cut && last != seen {
            let found = solve(last);
            if !found.1 {
                return (last, found);
            }
        }
        (seen, solve(seen))
    }

    /// Computes the normal force on the pad, N, if the object were pressed to a depth at a pose.
    pub(crate) fn normal_force_n(
        &self,
        indenter: &Indenter,
        pose: Pose,
        depth_mm: f64,
        ground: CaptureInput<'_>,
    ) -> f64 {
        let in_frame = self.frame.pose_in_frame(pose);
        let solve = |centre_px| self.solve_pressure(indenter, depth_mm, in_frame, centre_px, ground);
        let (_, (load, _)) = self.solve_in_view(solve);
        load.map_or(0.0, |load| {
            let sum: f64 = load.pressure.data.iter().map(|p| f64::from(p.max(0.0))).sum();
            1e-3 * self.youngs_modulus_kpa * sum * load.mm_per_px[0] * load.mm_per_px[1]
        })
    }

    fn capture_object(
        &self,
        indenter: &Indenter,
        texture: Option<&Texture>,
        window: depth::CaptureWindow,
        effects: &mut EffectLog,
    ) -> Depth {
        depth::capture_penetration(indenter, texture, None, self.thickness_mm, &self.view, window, effects)
    }

    /// Resamples a height map from the camera's view to the object's frame. Outside the camera's view its border is
    /// continued.
    fn resample_height_map(&self, map: &HeightMap, camera: &View, middle_mm: [f64; 2]) -> HeightMap {
        let [width, height] = self.view.resolution_px;
        // Values that differ by more than this are not interpolated, so that walls stay walls.
        let axes = self.frame.axes();
        let jump = 2.0 * camera.mm_per_px[0].max(camera.mm_per_px[1]) as f32;
        let mut above_mm = Grid::new(width, height);
        for y in 0..height {
            for (x, value) in above_mm.row_mut(y).iter_mut().enumerate() {
                let mm = self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                let there = camera.point_px(axes.to_sensor([0, 1].map(|k| mm[k] + middle_mm[k])));
                *value = interpolate_bilinear(&map.above_mm, there.map(|px| px - 0.5), jump);
            }
        }
        HeightMap { above_mm, unseen_px: map.unseen_px }
    }

    /// Subtracts a curved pad's drop from a penetration in the object's frame.
    fn subtract_drop(&self, depth: &mut Depth, drop: &Grid<f32>, camera: &View, middle_mm: [f64; 2], above_mm: f64) {
        let floor = 0.0 - above_mm as f32;
        let margin = depth.margin_px as f64;
        let axes = self.frame.axes();
        for y in 0..depth.penetration.height {
            for x in 0..depth.penetration.width {
                let px = [x as f64 + 0.5 - margin, y as f64 + 0.5 - margin];
                let mm = self.view.point_mm(px);
                let there = camera.point_px(axes.to_sensor([0, 1].map(|k| mm[k] + middle_mm[k])));
                let below = interpolate_bilinear(drop, there.map(|px| px - 0.5 + SURFACE_BORDER as f64), f32::INFINITY);
                let value = &mut depth.penetration.row_mut(y)[x];
                *value = if *value > floor { (*value - below).max(floor) } else { *value };
            }
        }
        depth.measure();
    }

    fn accumulate_slip(&mut self, done: &StepOutcome) {
        let slip = &mut self.slip;
        slip.touches = done.touching > 0;
        if !slip.touches {
            slip.displacement_mm = [0.0; 2];
        }
        slip.stick_fraction = done.sticking as f64 / done.touching.max(1) as f64;
        slip.gross = done.gross;
        let [dx, dy] = self.plane_frame.axes().direction_to_sensor(done.slip_mm);
        slip.displacement_mm = [slip.displacement_mm[0] + dx, slip.displacement_mm[1] + dy];
        // kPa mm^3 are 1e-3 N mm.
        slip.heat_nmm += 1e-3 * self.youngs_modulus_kpa * done.heat;
        slip.iterations += done.solver.iterations;
        slip.residual_mm = slip.residual_mm.max(done.solver.residual_mm);
        slip.converged &= done.solver.converged || !slip.touches;
    }

    /// Returns the wrench of the object on the pad.
    pub(crate) fn wrench(&self) -> Wrench {
        let sums = self.history.contact_forces();
        let newtons = 1e-3 * self.youngs_modulus_kpa;
        let [fx, fy] = self.frame.axes().direction_to_sensor(sums.force).map(|force| newtons * force);
        let fz = -newtons * sums.normal;
        let [x, y] = self.frame.origin_mm;
        let [lever_x, lever_y] =
            self.frame.axes().direction_to_sensor(sums.pressure_moment).map(|lever| newtons * lever);
        // Moments r x f of the pressure at z = 0, and of the tractions. The lever is measured from the frame's origin.
        let torque_x = -(lever_y - y * fz);
        let torque_y = lever_x - x * fz;
        let torque_z = newtons * sums.moment + x * fy - y * fx;
        // Adding 0 turns -0.0 into 0.0.
        Wrench { force_n: [fx, fy, fz].map(|n| n + 0.0), torque_nmm: [torque_x, torque_y, torque_z].map(|n| n + 0.0) }
    }

    /// Returns what the loads on the pad before a frame's press do to it. Displacements below `unseen_mm` are left out.
    pub(crate) fn carried_loads(&mut self, unseen_mm: f64) -> CarriedLoads {
        let stiffness = self.stiffness();
        let PlanarFrame { origin_mm: frame_mm, angle_rad } = self.frame;
        let by_tractions = self.history.normal_displacement().map(|(mut down, origin_mm)| {
            if stiffness != 1.0 {
                down.data.iter_mut().for_each(|mm| *mm /= stiffness as f32);
            }
            let placement = GridPlacement { origin_mm, mm_per_px: self.view.mm_per_px };
            let down = PlacedDisplacement { values_mm: down, placement };
            FrictionDisplacement::carried(down.in_turned_frame(frame_mm, angle_rad))
        });
        CarriedLoads {
            friction: by_tractions.filter(|drag| drag.largest_mm() >= unseen_mm),
            remembered: self.memory.as_mut().and_then(|memory| memory.displacement(unseen_mm)),
            memory: match &self.memory {
                None => PadMemory::Elastic,
                Some(memory) if memory.is_blank() && self.pressed_pose.is_none() => PadMemory::Blank,
                Some(_) => PadMemory::Loaded,
            },
            stiffness,
        }
    }

    /// Computes the motion of the pad in its plane under a pressure and the tractions; `None` if nothing loads the pad.
    pub(crate) fn displacement_field(
        &self,
        in_plane: &InPlaneResponse,
        load: Option<&Load>,
    ) -> Option<DisplacementField> {
        let remembered = self.memory.as_ref().filter(|memory| !memory.is_blank());
        if self.history.has_no_tractions() && remembered.is_none() {
            return load.map(|load| in_plane.under_pressure(load));
        }
        if load.is_none() && remembered.is_none() {
            return None;
        }
        // Divide each pixel into points no farther apart than half the spacing of the values that they are added to.
        let parts = (libm::ceil(2.0 * self.view.mm_per_px[0] / in_plane.spacing_mm()) as usize).clamp(1, 8);
        let share = 1.0 / (parts * parts) as f64;
        let spacing_mm = self.view.mm_per_px;
        let within = move |part: usize, k: usize| ((part as f64 + 0.5) / parts as f64 - 0.5) * spacing_mm[k];
        let axes = self.frame.axes();
        let points = self.history.traction_forces().flat_map(|(place, force)| {
            let force = axes.direction_to_sensor(force).map(|part| share * part);
            (0..parts * parts).map(move |part| {
                let at = [place[0] + within(part % parts, 0), place[1] + within(part / parts, 1)];
                (axes.to_sensor(at), [force[0], force[1], 0.0])
            })
        });
        // A layer of another stiffness is displaced by the same loads in proportion.
        let divide = 1.0 / self.stiffness();
        let points = points.map(|(at, force)| (at, force.map(|part| divide * part)));
        let remembered = remembered.into_iter().flat_map(StressMemory::forces);
        Some(in_plane.under_load_and_forces(load, points.chain(remembered)))
    }

    /// Returns the tractions and the pressure of the last step, multiplied by a factor; `None` without contact.
    pub(crate) fn traction_map(&self, factor: f64) -> Option<TractionMap> {
        let (tractions, pressure) = self.history.traction_field()?;
        Some(TractionMap::new(tractions, pressure, self.frame, factor * self.youngs_modulus_kpa))
    }

    /// Returns the state of the pad (sticks or slips) at the pixels of a view that touch.
    pub(crate) fn stick_slip_states(&self, mask: &Grid<u8>, view: &View) -> Grid<StickSlip> {
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
                    states.row_mut(y)[x] = self.history.state_near(place_mm);
                }
            }
        }
        states
    }
}

impl Slip {
    /// Returns the slip without contact.
    pub(crate) fn no_contact() -> Self {
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

fn is_same_pose(a: &Pose, b: &Pose) -> bool {
    a.rotation.abs_diff_eq(b.rotation, POSE_TOLERANCE) && a.translation_mm.abs_diff_eq(b.translation_mm, POSE_TOLERANCE)
}
