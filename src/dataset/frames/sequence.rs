//! Renders depth frames that follow each other, of an object whose pose is known in each. The state of friction is
//! carried from one frame to the next.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DQuat, DVec3};

use super::poses::FrameMetadata;
use super::reader::SeenFrame;
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
use gelsim_job::scene::{DepthFrame, KnownPress, PressSource, Scene};
use gelsim_job::sequence::label::FrameLabel;

/// The greatest turn about the pad's normal between two frames, degrees. The friction model takes the chord of the turn
/// for the path.
const MAX_TURN_DEG: f64 = 10.0;

/// How near to the lowest point a pixel must be to count to it: as a fraction of the depth, and in mm.
const LOWEST: (f32, f32) = (0.05, 1e-3);

/// Renders the frames of a sequence one after the other.
pub struct SequenceFollower {
    friction: Friction,
    /// The scene and the friction state of the first frame. The texture, printed markers, camera and sensor drawn for
    /// it hold for all frames.
    begun: Option<(Scene, Sliding)>,
    frame_rate_hz: f64,
    last: Option<Pose>,
    /// The placement of the object's texture in the first frame.
    texture_placement: Option<TexturePlacement>,
}

/// A rendered frame of a sequence.
pub struct SequenceFrame {
    /// The frame as a sample of its own.
    pub sample: Sample,
    /// The frame's entry in the label of the sequence.
    pub label: FrameLabel,
}

impl SequenceFollower {
    /// Makes a follower before the first frame. Returns `None` if the plan's model of the gelpad has no tractions.
    pub fn new(plan: &Plan, friction: Friction, frame_rate_hz: f64) -> Option<Self> {
        plan.simulator.sliding(friction)?;
        Some(Self { friction, begun: None, frame_rate_hz, last: None, texture_placement: None })
    }

    /// Renders the next frame, which has the number `index`.
    pub fn render_next(
        &mut self,
        plan: &Plan,
        index: u64,
        seen: SeenFrame<'_>,
        known: FrameMetadata,
    ) -> Result<SequenceFrame, Diagnostic> {
        let FrameMetadata { id, class, pose, .. } = known;
        let depth_mm = seen.indentation_depth_mm();
        let (plane, lowest_mm) = match &seen {
            SeenFrame::Pad(map, _) => {
                (PadPlane::default(), Some(find_lowest_point(map, plan.simulator.view()).unwrap_or_default()))
            }
            SeenFrame::Gel(frame) => match frame.deepest_contact() {
                Some((site, point_mm)) => (PadPlane::tangent_at(site.point_mm, site.normal), Some(point_mm)),
                // Without contact there is no lowest point, and nothing can rub.
                None => (PadPlane::default(), None),
            },
        };
        if let Some(error) = find_motion_error(self.last, pose, plane.axes.z_axis) {
            return Err(error);
        }
        let motion = match (self.last, lowest_mm) {
            (Some(last), Some(now)) => motion_between(last, pose, now, &plane),
            _ => PlanarMotion::default(),
        };
        self.last = Some(pose);
        let pressed = PressSource::Frame(DepthFrame { id, class, shape: seen.into_shape(&pose) });
        let known_press = KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm: depth_mm };
        let drawn = Scene::from_known_press(plan, index, 0, known_press.clone());
        if self.begun.is_none() {
            let sliding = drawn.simulator(plan).sliding(self.friction).expect("the plan was made for a sequence");
            self.begun = Some((drawn.clone(), sliding));
        }
        let Some((first, sliding)) = &mut self.begun else { unreachable!("it was put there") };
        let KnownPress { pressed, pose, indentation_depth_mm, .. } = known_press;
        let noise_key = drawn.camera.noise_key;
        let mut scene = Scene { index, pressed, pose, indentation_depth_mm, plane, ..first.clone() };
        scene.camera.noise_key = noise_key;
        let placement = *self.texture_placement.get_or_insert_with(|| TexturePlacement::at_pose(&pose));
        let mut press = scene.to_press(plan);
        press.texture = press.texture.map(|texture| texture.with_placement(placement));
        let step = ObjectStep { pose, depth_mm, motion, duration_s: 1.0 / self.frame_rate_hz };
        let simulator = scene.simulator(plan);
        let impression = simulator.press_next(&press, &[step], sliding);
        let label = Label::describe(plan, &scene, &simulator, &impression, None);
        let t_s = (index + 1) as f64 / self.frame_rate_hz;
        let of_frame = FrameLabel::new(index as u32, t_s, "", label.clone(), impression.sliding.as_ref());
        let seconds = impression.seconds;
        Ok(SequenceFrame { sample: Sample { simulator, impression, numbered: None, label, seconds }, label: of_frame })
    }
}

/// Returns the middle of the lowest part of a height map, mm; `None` if it has no object.
pub fn find_lowest_point(map: &HeightMap, view: &View) -> Option<DVec3> {
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

/// Returns the angle by which an object turns about the pad's normal from one pose to the next, rad, from -pi to pi.
pub fn turn_rad(from: Pose, to: Pose, normal: DVec3) -> f64 {
    let q = DQuat::from_mat3(&(to.rotation * from.rotation.transpose()));
    let half = libm::atan2(q.xyz().dot(normal), q.w);
    let full = 2.0 * half;
    if half.abs() > FRAC_PI_2 { full - half.signum() * TAU } else { full }
}

/// Returns an error if an object is too far away to be followed from frame to frame.
pub fn find_position_error(pose: &Pose) -> Option<Diagnostic> {
    let away_mm = pose.translation_mm.abs().max_element();
    (away_mm > ObjectStep::FARTHEST_MM).then(|| {
        let message = format!("the object is {away_mm:e} mm away from the sensor");
        let help = format!("give its position in the sensor's frame, in mm, {:e} at most", ObjectStep::FARTHEST_MM);
        Diagnostic::new(message).help(help)
    })
}

/// Returns an error if the pose of a frame cannot be right after that of the frame before: the object is too far away, or
/// turns too far about the pad's normal.
pub fn find_motion_error(from: Option<Pose>, to: Pose, normal: DVec3) -> Option<Diagnostic> {
    if let Some(problem) = find_position_error(&to) {
        return Some(problem);
    }
    let from = from?;
    let turn_deg = turn_rad(from, to, normal).to_degrees();
    (turn_deg.abs() > MAX_TURN_DEG).then(|| {
        let message = format!("the object turns by {turn_deg:.1} degrees since the frame before");
        Diagnostic::new(message).help(format!("give frames more often: at most {MAX_TURN_DEG} degrees"))
    })
}

/// Returns the motion, in the axes of a plane, by which the object's surface came to the point `now` as it went from
/// one pose to the next.
pub fn motion_between(from: Pose, to: Pose, now: DVec3, plane: &PadPlane) -> PlanarMotion {
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
