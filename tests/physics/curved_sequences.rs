//! Objects that slide over gels that are not flat: a dome of a kilometre against the flat pad, the same slide in other places of a
//! gel, and what charts that follow the contact must not change.

use gelsim::SensorExt;
use std::sync::Arc;

use gelsim::{
    Fidelity, Friction, Impression, Indenter, ObjectStep, PadPlane, PlanarMotion, Pose, Press, PressError, Sensor,
    Simulator,
};
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::mesh::clusters::Clusters;
use glam::DVec3;

use super::curved::flat_and_of_a_kilometre;
use gelsim_oracle::shapes::Shape;

/// How a ball moves in a frame: so deep in the end, pushed and turned in its plane by so much.
pub struct Frame {
    depth_mm: f64,
    shift_mm: [f64; 2],
    turn_deg: f64,
}

const STILL: Frame = Frame { depth_mm: 0.0, shift_mm: [0.0; 2], turn_deg: 0.0 };

/// Presses a ball in and moves it over a plane, frame by frame; what each frame gives.
pub fn slide(
    simulator: &Simulator,
    ball_mm: f64,
    plane: PadPlane,
    coefficient: f64,
    frames: &[Frame],
) -> Vec<Impression> {
    let ball: Arc<Clusters> = Arc::new(Shape::ball_around_origin(ball_mm, 192, 96).clusters());
    let mut sliding = simulator.sliding(Friction::Coulomb { coefficient }).expect("an elastic pad");
    let (mut at, mut turn_deg) = ([0.0; 2], 0.0_f64);
    let step = |frame: &Frame| {
        let about_mm = at;
        at = [0, 1].map(|k| at[k] + frame.shift_mm[k]);
        turn_deg += frame.turn_deg;
        let half = 0.5 * turn_deg.to_radians();
        let over = Pose::from_quaternion([0.0, 0.0, half.sin(), half.cos()], [at[0], at[1], ball_mm - frame.depth_mm]);
        let pose = plane.pose_in_sensor(over);
        let motion = PlanarMotion { shift_mm: frame.shift_mm, turn_rad: frame.turn_deg.to_radians(), about_mm };
        let indenter = Indenter::clusters(Arc::clone(&ball), pose);
        let mut press = Press::new(indenter, simulator.sensor());
        press.plane = plane;
        let step = ObjectStep { pose, depth_mm: frame.depth_mm, motion, duration_s: 0.0 };
        simulator.press_next(&press, &[step], &mut sliding)
    };
    frames.iter().map(step).collect()
}

pub fn pushed(frames: u32, depth_mm: f64, shift_mm: [f64; 2], turn_deg: f64) -> Vec<Frame> {
    let pressed = (1..=3).map(|k| Frame { depth_mm: depth_mm * f64::from(k) / 3.0, ..STILL });
    pressed.chain((0..frames).map(|_| Frame { depth_mm, shift_mm, turn_deg })).collect()
}

pub fn wrench(found: &Impression) -> [DVec3; 2] {
    let wrench = found.sliding.as_ref().expect("a frame of a sequence").wrench;
    [wrench.force_n, wrench.torque_nmm].map(DVec3::from_array)
}

#[test]
fn a_slide_over_a_dome_of_a_kilometre_is_that_over_a_flat_pad() {
    let mut frames = pushed(4, 0.6, [0.25, 0.1], 4.0);
    frames.push(Frame { depth_mm: 0.3, ..STILL });
    let [flat, dome] = flat_and_of_a_kilometre([100, 76], [15.0, 11.4])
        .map(|simulator| slide(&simulator.with_flow(), 4.0, PadPlane::default(), 0.4, &frames));
    for (k, (flat, dome)) in flat.iter().zip(&dome).enumerate() {
        let ([force, torque], [other, moment]) = (wrench(flat), wrench(dome));
        let [stick, sticks] = [flat, dome].map(|found| found.sliding.as_ref().expect("known").slip.stick_fraction);
        let off = flat.image.rgb.iter().zip(&dome.image.rgb).map(|(a, b)| a.abs_diff(*b));
        let off = off.max();
        let flow = flat.flow_mm().into_iter().flatten().zip(dome.flow_mm().into_iter().flatten());
        let flow = flow.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!(
            "frame {k}: force off by {:.4} % of {:.2} N, flow by {:.2} um, image by {off:?} levels, sticks {stick:.3} {sticks:.3}",
            100.0 * (force - other).length() / force.length(),
            force.length(),
            1e3 * flow
        );
        assert!((force - other).length() < 5e-3 * force.length(), "{force} {other}");
        assert!((torque - moment).length() < 5e-3 * force.length() * 4.0, "{torque} {moment}");
        assert!(
            off <= Some(1) && flow < 5e-3 && (stick - sticks).abs() < 0.02,
            "frame {k}: {off:?} levels, {flow} mm, sticking {stick} {sticks}"
        );
    }
    assert!(wrench(&flat[6])[0].truncate().length() > 0.2 * wrench(&flat[6])[0].z.abs(), "it is pulled");
}

/// A finger of a ball and a cylinder, all around which nothing changes; and a dome.
#[test]
fn the_same_slide_anywhere_on_a_gel_gives_the_same_forces() {
    let finger = GelShape::Capsule(GelCapsule { radius_mm: 12.0, length_mm: 50.0 });
    let dome = GelShape::Dome(GelDome { radius_mm: 20.0 });
    for (name, shape, places) in [
        ("geltip", finger, [[29.0, 0.0], [33.5, 77.0], [38.0, -140.0]]),
        ("tactip", dome, [[0.0, 0.0], [6.0, 50.0], [13.0, -100.0]]),
    ] {
        let mut sensor = Sensor::preset(name).expect("a preset");
        sensor.resolution_px = [120, 90];
        sensor.shape = Some(shape.clone());
        let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
        let frames = pushed(4, 0.8, [0.0, 0.3], 2.0);
        let of = |[from_tip_mm, around_deg]: [f64; 2]| {
            let (axes, origin_mm) = shape.frame_at(from_tip_mm, around_deg);
            let found = slide(&simulator, 4.0, PadPlane { axes, origin_mm }, 0.5, &frames);
            // As the place sees them.
            found.iter().map(|found| axes.transpose() * wrench(found)[0]).collect::<Vec<_>>()
        };
        let first = of(places[0]);
        for place in &places[1..] {
            let worst = first.iter().zip(of(*place)).map(|(a, b)| (*a - b).length() / a.length()).fold(0.0, f64::max);
            println!("{name}: a slide at {place:?}: forces within {:.3} %", 100.0 * worst);
            assert!(worst < 0.02, "{name} {place:?}: {worst}");
        }
        // Pulled along, no harder than friction lets.
        let last = first.last().expect("frames");
        let (pull, push) = (last.y, -last.z);
        assert!(pull > 0.1 * push && pull < 0.6 * push, "{last}");
    }
}

#[test]
fn a_ball_that_slips_on_a_dome_is_pulled_by_friction_and_follows_the_charts() {
    let mut sensor = Sensor::preset("tactip").expect("a preset");
    sensor.resolution_px = [96, 96];
    let radius_mm = sensor.shape.as_ref().expect("a dome").radius_mm();
    let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
    // Around the dome, at the same depth below it: far beyond the chart around the tip.
    let ball: Arc<Clusters> = Arc::new(Shape::ball_around_origin(4.0, 96, 48).clusters());
    let mut sliding = simulator.sliding(Friction::Coulomb { coefficient: 0.3 }).expect("an elastic pad");
    let mut ratios = Vec::new();
    let from_middle = radius_mm + 4.0 - 0.8;
    for frame in 0..14 {
        let angle = |frame: i32| 0.05 * f64::from((frame - 1).max(0));
        let at = |frame: i32| {
            let (sin, cos) = angle(frame).sin_cos();
            DVec3::new(from_middle * sin, 0.0, from_middle * cos - radius_mm)
        };
        let by = at(frame) - at((frame - 1).max(0));
        // The plane at the place, in which the ball goes on.
        let middle = 0.5 * (angle(frame) + angle((frame - 1).max(0)));
        let (axes, origin_mm) = sensor.shape.as_ref().expect("a dome").frame_at(radius_mm * middle, 0.0);
        let plane = PadPlane { axes, origin_mm };
        let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], at(frame).to_array());
        let shift_mm = [by.dot(axes.x_axis), 0.0];
        let mut press = Press::new(Indenter::clusters(Arc::clone(&ball), pose), &sensor);
        press.plane = plane;
        let motion = PlanarMotion { shift_mm, ..PlanarMotion::default() };
        let step = ObjectStep { pose, depth_mm: 0.8, motion, duration_s: 0.0 };
        let found = simulator.press_next(&press, &[step], &mut sliding);
        let [force, _] = wrench(&found);
        let (sin, cos) = angle(frame).sin_cos();
        let [pull, push] = [force.dot(DVec3::new(cos, 0.0, -sin)), -force.dot(DVec3::new(sin, 0.0, cos))];
        let slip = found.sliding.expect("known").slip;
        println!("{:.2} rad: {:.4} of the pressure, {:.3} sticks", angle(frame), pull / push, slip.stick_fraction);
        ratios.push((push, pull / push, slip.gross));
    }
    let settled = &ratios[7..];
    for (push, ratio, gross) in settled {
        assert!((ratio / 0.3 - 1.0).abs() < 0.03 && *gross, "{ratio}");
        assert!((push / settled[0].0 - 1.0).abs() < 0.01, "{push}");
    }
}

#[test]
fn steps_that_lead_too_far_are_refused_and_the_farthest_is_another_contact() {
    let mut sensor = Sensor::preset("gelsight-mini").expect("a preset");
    sensor.resolution_px = [64, 48];
    let ball: Arc<Clusters> = Arc::new(Shape::ball_around_origin(4.0, 24, 12).clusters());
    for shape in [None, Some(GelShape::Dome(GelDome { radius_mm: 20.0 }))] {
        sensor.shape = shape;
        let simulator = Simulator::new(&sensor, Fidelity::Draft).expect("a sound sensor");
        let mut sliding = simulator.sliding(Friction::Coulomb { coefficient: 0.3 }).expect("an elastic pad");
        let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 3.5]);
        let press = Press::new(Indenter::clusters(Arc::clone(&ball), pose).at_depth_mm(0.5), &sensor);
        let step = |motion| [ObjectStep { pose, depth_mm: 0.5, motion, duration_s: 0.0 }];
        simulator.press_next(&press, &step(PlanarMotion::default()), &mut sliding);
        for mm in [1e30, 1e300] {
            for motion in [
                PlanarMotion { shift_mm: [0.0, -mm], ..PlanarMotion::default() },
                PlanarMotion { turn_rad: 0.1, about_mm: [mm, 0.0], ..PlanarMotion::default() },
            ] {
                assert_eq!(
                    simulator.try_press_next(&press, &step(motion), &mut sliding).err(),
                    Some(PressError::TooFar)
                );
            }
        }
        for shift_mm in [[ObjectStep::FARTHEST_MM, 0.0], [0.0, -ObjectStep::FARTHEST_MM]] {
            let motion = PlanarMotion { shift_mm, ..PlanarMotion::default() };
            let found = simulator.press_next(&press, &step(motion), &mut sliding);
            assert!(found.contact.finite && found.contact.force_n.is_some_and(|force| force > 0.1), "{motion:?}");
            assert!(wrench(&found).iter().all(|part| part.is_finite()), "{motion:?}");
        }
    }
}
