//! Depth frames that follow each other, of an object whose pose is known in each: friction remembers from one to the next.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat3, DQuat, DVec3};

use super::poses::FrameMetadata;
use super::reader::SeenFrame;
use gelsim_core::base::gel::Site;
use gelsim_core::base::view::View;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::texture::TexturePlacement;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
use gelsim_core::pose::{PadPlane, Pose};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_job::label::Label;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::scene::{Frame, KnownPress, Pressed, Scene};
use gelsim_job::sequence::label::FrameLabel;

/// Largest turn about the pad's normal between two frames, degrees: the law of friction takes its chord for the way.
const MOST_TURN_DEG: f64 = 10.0;

/// Share of the depth, and mm, within which pixels count to the lowest point.
const LOWEST: (f32, f32) = (0.05, 1e-3);

/// An object that is followed from frame to frame.
pub struct Follower {
    friction: Friction,
    /// The first frame: what is drawn of texture, print, camera and sensor holds for all.
    begun: Option<(Scene, Sliding)>,
    frame_rate_hz: f64,
    last: Option<Pose>,
    /// Where its texture lay in the first frame.
    laid: Option<TexturePlacement>,
}

/// A frame of a sequence.
pub struct Followed {
    /// As a press.
    pub sample: Sample,
    /// As a frame.
    pub label: FrameLabel,
}

impl Follower {
    /// Before the first frame; `None` if the plan's model of the gelpad knows no tractions.
    pub fn new(plan: &Plan, friction: Friction, frame_rate_hz: f64) -> Option<Self> {
        plan.simulator.sliding(friction)?;
        Some(Self { friction, begun: None, frame_rate_hz, last: None, laid: None })
    }

    /// The next frame, number `index`.
    pub fn next(
        &mut self,
        plan: &Plan,
        index: u64,
        seen: SeenFrame<'_>,
        known: FrameMetadata,
    ) -> Result<Followed, Diagnostic> {
        let FrameMetadata { id, class, pose, .. } = known;
        let depth_mm = seen.depth_mm();
        let (plane, lowest_mm) = match &seen {
            SeenFrame::Pad(map, _) => {
                (PadPlane::default(), Some(lowest_mm(map, plan.simulator.view()).unwrap_or_default()))
            }
            SeenFrame::Gel(frame) => match frame.deepest() {
                Some((site, point_mm)) => (tangent(site), Some(point_mm)),
                None => (PadPlane::default(), None),
            },
        };
        let motion = match self.last {
            Some(last) => match mistake(last, pose, plane.axes.z_axis) {
                Some(mistake) => return Err(mistake),
                None => lowest_mm.map_or_else(PlanarMotion::default, |now| motion(last, pose, now, &plane)),
            },
            None => PlanarMotion::default(),
        };
        self.last = Some(pose);
        let pressed = Pressed::Frame(Frame { id, class, shape: seen.pressed(&pose) });
        let given = KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm: depth_mm };
        let drawn = Scene::given(plan, index, 0, given.clone());
        if self.begun.is_none() {
            let sliding = drawn.simulator(plan).sliding(self.friction).expect("the plan was made for a sequence");
            self.begun = Some((drawn.clone(), sliding));
        }
        let Some((first, sliding)) = &mut self.begun else { unreachable!("it was put there") };
        let KnownPress { pressed, pose, indentation_depth_mm, .. } = given;
        let noise_key = drawn.camera.noise_key;
        let mut scene = Scene { index, pressed, pose, indentation_depth_mm, plane, ..first.clone() };
        scene.camera.noise_key = noise_key;
        let laid = *self.laid.get_or_insert_with(|| TexturePlacement::with(&pose));
        let mut press = scene.press(plan);
        press.texture = press.texture.map(|texture| texture.laid_out(laid));
        let step = ObjectStep { pose, depth_mm, motion };
        let simulator = scene.simulator(plan);
        let impression = simulator.press_next(&press, &[step], sliding);
        let label = Label::describe(plan, &scene, &simulator, &impression, None);
        let t_s = (index + 1) as f64 / self.frame_rate_hz;
        let of_frame = FrameLabel::new(index as u32, t_s, "", label.clone(), impression.sliding.as_ref());
        let seconds = impression.seconds;
        Ok(Followed { sample: Sample { simulator, impression, numbered: None, label, seconds }, label: of_frame })
    }
}

/// The middle of what reaches lowest of a height map, mm; `None` if there is no object.
pub fn lowest_mm(map: &HeightMap, view: &View) -> Option<DVec3> {
    let lowest = map.above_mm.data.iter().fold(f32::INFINITY, |lowest, mm| lowest.min(*mm));
    if !lowest.is_finite() {
        return None;
    }
    let until = lowest + LOWEST.0 * lowest.abs() + LOWEST.1;
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for y in 0..map.above_mm.height {
        for (x, _) in map.above_mm.row(y).iter().enumerate().filter(|(_, mm)| **mm <= until) {
            let at = view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            sum = [sum[0] + at[0], sum[1] + at[1]];
            count += 1.0;
        }
    }
    Some(DVec3::new(sum[0] / count, sum[1] / count, f64::from(lowest)))
}

/// The plane that touches a gel in a place.
fn tangent(site: Site) -> PadPlane {
    let axes = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, site.normal.normalize()));
    PadPlane { axes, origin_mm: site.point_mm }
}

/// By how much an object turns about the pad's normal from one pose to the next, rad.
pub fn turn_rad(from: Pose, to: Pose, normal: DVec3) -> f64 {
    let q = DQuat::from_mat3(&(to.rotation * from.rotation.transpose()));
    let half = libm::atan2(q.xyz().dot(normal), q.w);
    let whole = 2.0 * half;
    if half.abs() > FRAC_PI_2 { whole - half.signum() * TAU } else { whole }
}

/// What cannot be right of the poses of two frames that follow each other, on a pad with this normal.
pub fn mistake(from: Pose, to: Pose, normal: DVec3) -> Option<Diagnostic> {
    let turn_deg = turn_rad(from, to, normal).to_degrees();
    (turn_deg.abs() > MOST_TURN_DEG).then(|| {
        let message = format!("the object turns by {turn_deg:.1} degrees since the frame before");
        Diagnostic::new(message).help(format!("give frames more often: at most {MOST_TURN_DEG} degrees"))
    })
}

/// How the surface at the point `now` of an object came there as the object went from one pose to the next, in the axes of a plane.
pub fn motion(from: Pose, to: Pose, now: DVec3, plane: &PadPlane) -> PlanarMotion {
    let turn = to.rotation * from.rotation.transpose();
    let before = turn.transpose() * (now - to.translation_mm) + from.translation_mm;
    let back = plane.axes.transpose();
    let (by, about) = (back * (now - before), back * (before - plane.origin_mm));
    PlanarMotion {
        shift_mm: [by.x, by.y],
        turn_rad: turn_rad(from, to, plane.axes.z_axis),
        about_mm: [about.x, about.y],
    }
}
