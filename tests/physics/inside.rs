//! Depth frames of a camera inside a gel: what it sees of an object, by rays in closed form, gives the press of that object.

use gelsim::SensorExt;
use std::sync::Arc;

use gelsim::{Fidelity, Friction, Impression, Indenter, Pose, Sensor, Simulator};
use gelsim_core::base::grid::Grid;
use gelsim_core::camera::projection::{LensModel, Projection};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_dataset::frames::camera::{DepthCamera, DepthProjection as Rays, DepthUnit, DistanceAlong};
use gelsim_dataset::frames::poses::FrameMetadata;
use gelsim_dataset::frames::reader::{FrameReader, SeenFrame};
use gelsim_dataset::frames::sequence::SequenceFollower;
use gelsim_job::config::Overrides;
use gelsim_job::plan::frames::FrameSettings;
use gelsim_job::plan::standalone;
use glam::{DQuat, DVec3};

use gelsim_oracle::shapes::Shape;

const CAMERA: DepthCamera = DepthCamera {
    unit: DepthUnit::Millimetre,
    plane_mm: 0.0,
    max_depth_mm: None,
    background: None,
    flip: [false; 2],
    offset_px: [0.0; 2],
    projection: Rays::Orthographic,
    along: DistanceAlong::Axis,
};

/// A sensor without noise.
fn sensor(name: &str) -> Sensor {
    let mut sensor = match name {
        "fingertip" => standalone::load_sensor("configs/fingertip/sensor.toml").expect("a sound file").sensor,
        preset => Sensor::preset(preset).expect("a preset"),
    };
    sensor.camera.read_noise_levels = 0.0;
    sensor
}

fn simulator(sensor: &Sensor) -> Simulator {
    Simulator::new(sensor, Fidelity::Standard).expect("a sensor")
}

/// Where the middle of a ball is whose lowest point is so deep in the gel, in a place.
fn middle(sensor: &Sensor, ball_mm: f64, depth_mm: f64, [from_tip_mm, around_deg]: [f64; 2]) -> DVec3 {
    let shape = sensor.shape.as_ref().expect("a shape");
    let (axes, origin_mm) = shape.frame_at(from_tip_mm, around_deg);
    origin_mm + (ball_mm - depth_mm) * axes.z_axis
}

/// The ball itself pressed in.
fn pressed_ball(simulator: &Simulator, ball_mm: f64, middle: DVec3) -> Impression {
    let ball: Arc<Clusters> = Arc::new(Shape::ball_around_origin(ball_mm, 384, 192).clusters());
    simulator.press(&Indenter::clusters(ball, Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], middle.to_array())))
}

/// What a lens sees of a ball: distances along its axis or its rays, infinite where nothing is.
fn frame(
    looks: &Projection,
    [width, height]: [usize; 2],
    along: DistanceAlong,
    middle: DVec3,
    ball_mm: f64,
) -> Grid<f64> {
    let pixel = |at: usize| {
        let (from, direction) = looks.ray_at([(at % width) as f64 + 0.5, (at / width) as f64 + 0.5]);
        let direction = direction.normalize();
        let to = middle - from;
        let half_chord = ball_mm * ball_mm - (to - direction * to.dot(direction)).length_squared();
        let mm = to.dot(direction) - half_chord.max(0.0).sqrt();
        match (half_chord > 0.0, along) {
            (false, _) => f64::INFINITY,
            (true, DistanceAlong::Axis) => mm * direction.dot(looks.optical_axis()),
            (true, DistanceAlong::Ray) => mm,
        }
    };
    Grid { width, height, data: (0..width * height).map(pixel).collect() }
}

/// What was seen, pressed in; and the pixels that nobody saw.
fn pressed(simulator: &Simulator, seen: SeenFrame<'_>, pose: Pose) -> (Impression, u64) {
    let depth_mm = seen.indentation_depth_mm();
    let shape = seen.into_shape(&pose);
    let unseen_px = shape.unseen_px();
    (simulator.press(&Indenter::of_known_depth(shape, pose, depth_mm)), unseen_px)
}

/// Levels by which two pictures differ: how many values by more than two, and the most.
fn levels(a: &[u8], b: &[u8]) -> (usize, u8) {
    let off: Vec<u8> = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).collect();
    (off.iter().filter(|off| **off > 2).count(), off.into_iter().max().unwrap_or(0))
}

fn force_n(impression: &Impression) -> f64 {
    impression.contact.force_n.expect("a force")
}

/// Presets and a mesh, pinhole and fisheye, on the tip and beside it: the ball that a frame of the image's own pixels shows.
#[test]
fn a_frame_of_the_sensors_own_lens_gives_the_press_of_the_object_that_it_shows() {
    for (name, ball_mm, depth_mm, places) in [
        ("tactip", 5.0, 1.5, [[0.0, 0.0], [8.0, 30.0]]),
        ("geltip", 4.0, 0.8, [[0.0, 0.0], [8.0, 30.0]]),
        ("allsight", 4.0, 0.8, [[0.0, 0.0], [20.0, 80.0]]),
        ("fingertip", 4.0, 0.8, [[0.0, 0.0], [6.0, 200.0]]),
    ] {
        let mut sensor = sensor(name);
        // Beyond 90 degrees from a lens's axis distances along the axis say nothing.
        if let LensModel::Fisheye(lens) = &mut sensor.lens {
            lens.fov_deg = lens.fov_deg.min(120.0);
        }
        let simulator = simulator(&sensor);
        let size = sensor.resolution_px;
        let camera = |along| DepthCamera { along, ..CAMERA };
        let readers = [DistanceAlong::Axis, DistanceAlong::Ray].map(|along| {
            FrameReader::new(camera(along), &simulator, size).unwrap_or_else(|problem| panic!("{problem:?}"))
        });
        // On the tip and beside it, or on the tip of the pins and beside it of the others.
        let places = match (crate::thorough(), name) {
            (true, _) => &places[..],
            (false, "tactip") => &places[..1],
            (false, _) => &places[1..],
        };
        for &at in places {
            let middle = middle(&sensor, ball_mm, depth_mm, at);
            let whole = pressed_ball(&simulator, ball_mm, middle);
            let [by_axis, by_ray] =
                [(DistanceAlong::Axis, &readers[0]), (DistanceAlong::Ray, &readers[1])].map(|(along, reader)| {
                    let seen = reader.read(frame(&sensor.projection(), size, along, middle, ball_mm)).expect("a frame");
                    assert!(
                        (seen.indentation_depth_mm() - depth_mm).abs() < 0.03 * depth_mm,
                        "{name} {at:?}: {}",
                        seen.indentation_depth_mm()
                    );
                    pressed(&simulator, seen, Pose::IDENTITY)
                });
            let ((over, most), share) =
                (levels(&by_axis.0.image.rgb, &whole.image.rgb), force_n(&by_axis.0) / force_n(&whole));
            println!("{name} {at:?}: force {share:.4}, {over} of {} over 2, {most} at most", whole.image.rgb.len());
            assert_eq!(by_axis.1, 0, "{name} {at:?}");
            assert!((share - 1.0).abs() < 0.01, "{name} {at:?}: {share}");
            assert!(over * 500 <= whole.image.rgb.len(), "{name} {at:?}: {over}");
            // Pins are black or white.
            assert!(most <= 40 || sensor.pins.is_some(), "{name} {at:?}: {most}");
            assert!((force_n(&by_ray.0) / force_n(&by_axis.0) - 1.0).abs() < 1e-5, "{name} {at:?}");
        }
    }
}

#[test]
fn a_finer_pinhole_in_the_place_of_the_lens_knows_the_object_better() {
    for (name, within) in [("geltip", 0.002), ("tactip", 0.002)] {
        let sensor = sensor(name);
        let simulator = simulator(&sensor);
        let (size, fov_y_deg) = ([1280, 960], if name == "geltip" { 73.739_795 } else { 44.0 });
        let LensModel::Pinhole(mut pinhole) = (match sensor.lens {
            LensModel::Fisheye(lens) => LensModel::Pinhole(gelsim_core::camera::projection::Pinhole {
                fov_deg: lens.fov_deg,
                position_mm: lens.position_mm,
                look_at_mm: lens.look_at_mm,
            }),
            other => other,
        }) else {
            panic!("no place")
        };
        pinhole.fov_deg = 2.0 * ((0.5 * f64::to_radians(fov_y_deg)).tan() * 4.0 / 3.0).atan().to_degrees();
        let looks = Projection::new(&LensModel::Pinhole(pinhole), size, [1.0; 2]);
        let camera = DepthCamera { projection: Rays::Perspective { fov_y_deg }, ..CAMERA };
        let reader = FrameReader::new(camera, &simulator, size).unwrap_or_else(|problem| panic!("{problem:?}"));
        let middle = middle(&sensor, 4.0, 0.8, [6.0, 120.0]);
        let whole = pressed_ball(&simulator, 4.0, middle);
        let seen = reader.read(frame(&looks, size, DistanceAlong::Axis, middle, 4.0)).expect("a frame");
        let (found, _) = pressed(&simulator, seen, Pose::IDENTITY);
        let share = force_n(&found) / force_n(&whole);
        println!("{name}: force {share:.5}, {:?}", levels(&found.image.rgb, &whole.image.rgb));
        assert!((share - 1.0).abs() < within, "{name}: {share}");
    }
}

#[test]
fn a_pose_moves_nothing_but_what_is_laid_out_from_it() {
    let sensor = sensor("geltip").with_resolution([160, 120]);
    let simulator = simulator(&sensor);
    let reader = FrameReader::new(CAMERA, &simulator, [160, 120]).expect("a camera");
    let middle = middle(&sensor, 4.0, 0.8, [5.0, 70.0]);
    let look =
        || reader.read(frame(&sensor.projection(), [160, 120], DistanceAlong::Axis, middle, 4.0)).expect("a frame");
    let turned = Pose::from_quaternion(DQuat::from_rotation_x(0.7).to_array(), middle.to_array());
    let [here, there] = [Pose::IDENTITY, turned].map(|pose| pressed(&simulator, look(), pose).0);
    assert!((force_n(&here) / force_n(&there) - 1.0).abs() < 1e-5, "{} {}", force_n(&here), force_n(&there));
    assert!(levels(&here.image.rgb, &there.image.rgb).1 <= 1, "{:?}", levels(&here.image.rgb, &there.image.rgb));
}

/// Beside a finger a lens at its end sees one flank of a ball only.
#[test]
fn what_the_object_hides_is_counted_and_what_the_frame_cuts_takes_the_force_away() {
    let sensor = sensor("geltip");
    let (simulator, size) = (simulator(&sensor), sensor.resolution_px);
    let reader = FrameReader::new(CAMERA, &simulator, size).expect("a camera");
    let look = |at: [f64; 2]| {
        let middle = middle(&sensor, 4.0, 0.8, at);
        let seen = reader.read(frame(&sensor.projection(), size, DistanceAlong::Axis, middle, 4.0)).expect("a frame");
        let (found, unseen_px) = pressed(&simulator, seen, Pose::IDENTITY);
        (found, unseen_px, pressed_ball(&simulator, 4.0, middle))
    };
    let mut before = (0, 1.0);
    for from_tip_mm in [14.0, 26.0] {
        let (found, unseen_px, whole) = look([from_tip_mm, 30.0]);
        let share = force_n(&found) / force_n(&whole);
        println!("{from_tip_mm} mm from the tip: {unseen_px} px hidden, force {share:.3}");
        assert!(unseen_px > before.0 && share < before.1, "{from_tip_mm}: {unseen_px} px, {share}");
        assert!(!found.contact.total.cut_by_view && found.contact.total.total_force_n.is_none());
        before = (unseen_px, share);
    }
    // The image's lower edge shows the wall here, 36.9 degrees from the axis.
    let (cut, _, _) = look([36.7, 90.0]);
    assert!(cut.contact.total.cut_by_view && cut.contact.force_n.is_none() && cut.wrench.is_none());
}

/// Any values in any frame: a refusal in words, or something finite.
#[test]
fn odd_frames_are_refused_in_words_or_pressed_in_finitely() {
    for name in ["tactip", "geltip", "fingertip"] {
        for size in [[1, 1], [2, 1], [1, 9], [7, 5], [16, 40]] {
            let sensor = sensor(name).with_resolution(size);
            // Of so few pixels a camera may see no gel at all.
            let Ok(simulator) = Simulator::new(&sensor, Fidelity::Standard) else { continue };
            let reader = FrameReader::new(CAMERA, &simulator, size).unwrap_or_else(|problem| panic!("{problem:?}"));
            let all = |mm: f64| Grid { width: size[0], height: size[1], data: vec![mm; size[0] * size[1]] };
            for mm in [f64::NAN, f64::NEG_INFINITY, 0.0, -3.0] {
                let problem = reader.read(all(mm)).err().expect("refused");
                assert!(problem.message.contains("row 0, column 0") && problem.help.is_some(), "{problem:?}");
            }
            for mm in [f64::INFINITY, 1e300, 1e9, 90.0, 45.5, 44.9, 20.0, 1e-6, 1e-300] {
                let seen = reader.read(all(mm)).expect("distances");
                let reach = seen.reach();
                assert!(reach.through_px <= (size[0] * size[1]) as u64 && !reach.lowest_mm.is_nan(), "{name} {mm}");
                let (found, unseen_px) = pressed(&simulator, seen, Pose::IDENTITY);
                assert!(found.image.finite && found.contact.finite, "{name} {size:?} {mm}");
                assert!(unseen_px <= (size[0] * size[1]) as u64, "{name} {size:?} {mm}: {unseen_px}");
                let nothing = mm > 1e3;
                assert!(!nothing || (!reach.touches_pad() && found.contact.region.is_empty()), "{name} {mm}");
            }
        }
    }
}

#[test]
fn a_ball_that_is_pushed_around_a_finger_is_held_back_by_friction() {
    const PX: [usize; 2] = [160, 120];
    const MU: f64 = 0.3;
    let overrides = Overrides::default();
    let frames = FrameSettings {
        sensor: "geltip",
        resolution_px: PX,
        layers: &[],
        classes: &[],
        moved: false,
        sequence: true,
        overrides: &overrides,
    };
    let plan = frames.resolve_plan().unwrap_or_else(|report| panic!("{report}"));
    let sensor = plan.simulator.sensor();
    let reader = FrameReader::new(CAMERA, &plan.simulator, PX).expect("a camera");
    let mut follower =
        SequenceFollower::new(&plan, Friction::Coulomb { coefficient: MU }, 25.0).expect("an elastic gel");
    let mut last = None;
    // Pressed in beside the tip in four frames, then taken about the finger's axis.
    for k in 0..14_u32 {
        let around_deg = 1.5 * f64::from(k.saturating_sub(3));
        let middle = middle(sensor, 4.0, 0.2 * f64::from(k.min(3) + 1), [9.0, around_deg]);
        let seen = reader.read(frame(&sensor.projection(), PX, DistanceAlong::Axis, middle, 4.0)).expect("a frame");
        let turned = DQuat::from_rotation_z(around_deg.to_radians());
        let known = FrameMetadata {
            pose: Pose::from_quaternion(turned.to_array(), middle.to_array()),
            ..FrameMetadata::from_id("a")
        };
        let followed =
            follower.render_next(&plan, k.into(), seen, known).unwrap_or_else(|problem| panic!("{problem:?}"));
        last = Some((followed.label, middle, around_deg));
    }
    let Some((label, middle, around_deg)) = last else { panic!("frames") };
    let normal = (sensor.shape.as_ref().expect("a shape").centre_mm() - middle).normalize();
    let force = DVec3::from_array(label.wrench.force_n);
    let (pressing, pulling) = (force.dot(normal), force - force.dot(normal) * normal);
    let way = DVec3::new(-around_deg.to_radians().sin(), around_deg.to_radians().cos(), 0.0);
    println!("pressing {pressing:.4} N, pulled by {:.4} mu N", pulling.length() / (MU * pressing));
    assert_eq!(serde_json::to_value(&label.slip).expect("JSON")["state"], "gross");
    assert!((pulling.length() / (MU * pressing) - 1.0).abs() < 0.03, "{pulling} of {pressing}");
    assert!(pulling.normalize().dot(way) > 0.99, "{pulling} along {way}");
}
