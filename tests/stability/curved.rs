//! Hard cases of gels that are not flat: rims of the view, poles, the seam, what wraps a finger, gels of a millimetre and a
//! kilometre, gels seen edge on, cameras close to the skin. Samples are finite, bounded, steady and explained.

use gelsim::SensorExt;
use std::sync::Arc;

use gelsim::{Fidelity, Impression, Indenter, Pose, Sensor, Simulator};
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::camera::projection::{LensModel, Pinhole};
use gelsim_core::mesh::clusters::Clusters;
use glam::{DQuat, DVec3};

use gelsim_oracle::shapes::Shape;

/// A ball around the origin.
fn ball(radius_mm: f64) -> Arc<Clusters> {
    Arc::new(Shape::ball(radius_mm, 96, 48).moved([0.0, 0.0, -radius_mm]).clusters())
}

/// The inside of a tube around z, open by so much, its middle at the origin.
fn tube(radius_mm: f64, width_mm: f64, span_rad: f64) -> Arc<Clusters> {
    let sheet = Shape::sheet(180, 8, |i, j| {
        let angle = span_rad * (i as f64 / 180.0 - 0.5);
        [radius_mm * angle.cos(), radius_mm * angle.sin(), width_mm * (j as f64 / 8.0 - 0.5)]
    });
    Arc::new(sheet.clusters())
}

/// A lit finger or dome of this size without noise, its camera so far below the tip.
fn sensor(shape: GelShape, thickness_mm: f64, behind_mm: f64, look_at_mm: [f64; 3]) -> Sensor {
    let mut sensor = Sensor::preset("geltip").expect("a preset");
    sensor.resolution_px = [96, 72];
    sensor.shape = Some(shape);
    sensor.gelpad.thickness_mm = thickness_mm;
    let position_mm = [0.0, 0.0, -behind_mm];
    sensor.lens = LensModel::Pinhole(Pinhole { fov_deg: 100.0, position_mm, look_at_mm });
    sensor.camera.read_noise_levels = 0.0;
    sensor
}

fn finger() -> GelShape {
    GelShape::Capsule(GelCapsule { radius_mm: 11.485, length_mm: 50.0 })
}

/// Presses a ball into the gel in a place over it.
fn press_at(simulator: &Simulator, ball_mm: f64, depth_mm: f64, [from_tip_mm, around_deg]: [f64; 2]) -> Impression {
    let (axes, origin_mm) = simulator.sensor().shape.as_ref().expect("it has one").frame_at(from_tip_mm, around_deg);
    let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, ball_mm - depth_mm]).within(axes, origin_mm);
    simulator.press(&Indenter::clusters(ball(ball_mm), pose))
}

/// What must be true of any sample.
fn assert_sound(found: &Impression, thickness_mm: f64, at: &str) {
    assert!(found.image.finite && found.contact.finite, "{at}");
    assert!(found.contact.numerics.converged, "{at}: {:?}", found.contact.numerics);
    let [lowest, highest] = found.contact.range_mm();
    // A coarse grid may swing over by a little.
    let most = 1.01 * thickness_mm as f32;
    assert!(lowest >= -most && highest <= most, "{at}: {lowest} {highest}");
    let wrench = found.wrench.expect("an elastic pad");
    assert!(wrench.force_n.iter().chain(&wrench.torque_nmm).all(|value| value.is_finite()), "{at}");
    for normal in found.normals() {
        let length = normal.iter().map(|value| value * value).sum::<f32>();
        assert!((length - 1.0).abs() < 1e-4, "{at}: {normal:?}");
    }
    let whole = &found.contact.total;
    let explained = whole.total_force_n.is_some() == whole.force_unknown.is_empty();
    assert!(explained, "{at}: {whole:?}");
    assert!((0.0..=1.0).contains(&whole.in_view_fraction.expect("known")), "{at}");
}

fn force_n(found: &Impression) -> f64 {
    DVec3::from_array(found.wrench.expect("an elastic pad").force_n).length()
}

/// Levels by which two pictures differ in all but a thousandth of the values, and on average.
fn differences(a: &Impression, b: &Impression) -> (u8, f64) {
    let mut off: Vec<u8> = a.image.rgb.iter().zip(&b.image.rgb).map(|(a, b)| a.abs_diff(*b)).collect();
    off.sort_unstable();
    (off[off.len() * 999 / 1000], off.iter().copied().map(f64::from).sum::<f64>() / off.len() as f64)
}

#[test]
fn gels_of_a_millimetre_and_of_a_kilometre_and_all_sizes_between_take_presses_everywhere() {
    for radius_mm in [1.0, 3.0, 30.0, 1e3] {
        let capsule = GelShape::Capsule(GelCapsule { radius_mm, length_mm: 1e3_f64.min(3.0 * radius_mm) });
        for shape in [capsule, GelShape::Dome(GelDome { radius_mm })] {
            let thickness_mm = 3.0_f64.min(0.3 * radius_mm);
            let length_mm = shape.wall_mm().unwrap_or(0.0) + radius_mm;
            let sensor = sensor(shape.clone(), thickness_mm, length_mm, [0.0; 3]);
            let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
            let end_mm = shape.length_over_mm();
            // The tip, the rim of the view, where ball and cylinder meet, the gel's end.
            for share in [0.0, 0.5, 0.75, 0.99] {
                for around_deg in [0.0, 180.0] {
                    let at = format!("{shape:?} at {share} of its length, {around_deg} degrees");
                    let found = press_at(
                        &simulator,
                        0.5 * radius_mm.min(8.0),
                        0.3 * thickness_mm,
                        [share * end_mm, around_deg],
                    );
                    assert_sound(&found, thickness_mm, &at);
                    // Nodes are farther apart than the ball is wide where a camera looks at a metre of gel.
                    assert!(force_n(&found) > 0.0 || radius_mm > 100.0, "{at}");
                }
            }
        }
    }
    let shape = GelShape::Dome(GelDome { radius_mm: 1e6 });
    let mut kilometre = sensor(shape, 3.0, 20.0, [0.0; 3]);
    kilometre.lens = LensModel::Orthographic;
    let simulator = Simulator::new(&kilometre, Fidelity::Standard).expect("a sound sensor");
    assert_sound(&press_at(&simulator, 4.0, 0.8, [0.0, 0.0]), 3.0, "a kilometre");
}

#[test]
fn a_press_beside_the_pole_is_that_on_the_pole() {
    for shape in [finger(), GelShape::Dome(GelDome { radius_mm: 20.0 })] {
        let sensor = sensor(shape, 2.5, 45.0, [0.0; 3]);
        let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
        let there = press_at(&simulator, 4.0, 0.8, [0.0, 0.0]);
        assert_sound(&there, 2.5, "the pole");
        for around_deg in [0.0, 45.0, 90.0, 179.0, -91.0] {
            let beside = press_at(&simulator, 4.0, 0.8, [1e-6, around_deg]);
            let (most, mean) = differences(&there, &beside);
            let force = force_n(&beside) / force_n(&there);
            println!(
                "beside the pole at {around_deg} degrees: {most} levels but for a thousandth, {mean:.5} on average, force {force:.6}"
            );
            assert!(
                most <= 4 && mean < 0.03 && (force - 1.0).abs() < 2e-3,
                "{around_deg} degrees: {most} levels, {mean}, force {force}"
            );
        }
    }
}

#[test]
fn there_is_no_seam_where_angles_begin_anew() {
    for (shape, from_tip_mm) in
        [(finger(), 26.0), (finger(), 12.0), (GelShape::Dome(GelDome { radius_mm: 20.0 }), 15.0)]
    {
        let sensor = sensor(shape, 2.5, 45.0, [0.0; 3]);
        let simulator = Simulator::new(&sensor, Fidelity::High).expect("a sound sensor");
        for seam_deg in [0.0, 90.0, 180.0] {
            let [a, b] = [-1e-5, 1e-5].map(|by| press_at(&simulator, 4.0, 0.8, [from_tip_mm, seam_deg + by]));
            assert_sound(&a, 2.5, "the seam");
            let (most, mean) = differences(&a, &b);
            println!("across {seam_deg} degrees at {from_tip_mm} mm: {most} levels, {mean:.6} on average");
            assert!(
                most <= 2 && mean < 1e-3 && (force_n(&a) / force_n(&b) - 1.0).abs() < 1e-4,
                "{seam_deg} degrees: {most} levels, {mean}, {} and {} N",
                force_n(&a),
                force_n(&b)
            );
        }
    }
}

/// A ring that is narrower than the finger presses all around; a gutter of half a turn no farther than a quarter to each side.
#[test]
fn what_wraps_a_finger_beyond_its_chart_says_that_its_force_is_not_known() {
    use std::f64::consts::{PI, TAU};
    let sensor = sensor(finger(), 2.5, 45.5, [0.0; 3]);
    let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
    let press = |object: Arc<Clusters>, aside_mm: f64| {
        let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [-aside_mm, 0.0, -30.0]);
        simulator.press(&Indenter::clusters(object, pose))
    };
    let ring = press(tube(11.0, 4.0, TAU), 0.0);
    let gutter = press(tube(12.0, 4.0, PI), 1.0);
    let around_ball = press_at(&simulator, 4.0, 0.8, [30.0, 0.0]);
    for (name, found, wraps) in [("ring", &ring, true), ("gutter", &gutter, false), ("ball", &around_ball, false)] {
        assert_sound(found, 2.5, name);
        let whole = &found.contact.total;
        println!(
            "{name}: {:.3} N on the chart, total {:?}, {}",
            force_n(found),
            whole.total_force_n,
            whole.force_unknown
        );
        assert_eq!(whole.total_force_n.is_none(), wraps, "{name}");
        let least_n = whole.total_force_at_least_n.expect("an elastic gel");
        assert!(whole.total_force_n.is_none_or(|all| all == least_n) && least_n >= 0.0, "{name}: {least_n} N");
        assert_eq!(whole.cut_by_view, wraps, "{name}");
        assert!(force_n(found) > 0.1, "{name}");
    }
    // What is on the chart does not add up to nothing, as all of it would.
    let force = DVec3::from_array(ring.wrench.expect("known").force_n);
    assert!(force.truncate().length() > 1.0, "{force}");
}

#[test]
fn a_gel_seen_edge_on_and_a_camera_close_to_the_skin_give_sound_samples() {
    for (name, behind_mm, look_at_mm) in [
        ("a camera that looks at the wall", 20.0, [11.485, 0.0, -20.0]),
        ("one that looks at the base", 10.0, [3.0, 0.0, -60.0]),
        ("one a tenth of a millimetre below the gel", 2.6, [0.0; 3]),
        ("one that looks along the wall", 49.0, [11.0, 0.0, 0.0]),
    ] {
        let sensor = sensor(finger(), 2.5, behind_mm, look_at_mm);
        let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
        for from_tip_mm in [0.0, 18.0, 26.0, 38.0] {
            for around_deg in [0.0, 120.0] {
                let at = format!("{name}, {from_tip_mm} mm from the tip, {around_deg} degrees");
                let found = press_at(&simulator, 4.0, 1.0, [from_tip_mm, around_deg]);
                assert_sound(&found, 2.5, &at);
                let again = press_at(&simulator, 4.0, 1.0, [from_tip_mm, around_deg]);
                assert!(found.image.rgb == again.image.rgb, "{at}");
            }
        }
    }
}

/// A needle, an edge and a plate through the gel, from the side, at the rim of the view and beyond it.
#[test]
fn thin_and_wide_objects_at_the_rim_of_the_view_are_taken() {
    let needle = Arc::new(Shape::brick([-0.03, -0.03, -4.0], [0.03, 0.03, 4.0]).clusters());
    let plate = Arc::new(Shape::brick([-40.0, -40.0, 0.0], [40.0, 40.0, 2.0]).clusters());
    let sensor = sensor(finger(), 2.5, 45.5, [0.0; 3]);
    let simulator = Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor");
    let shape = finger();
    for (name, object) in [("needle", &needle), ("plate", &plate)] {
        for from_tip_mm in [0.0, 18.04, 35.0, 55.0, 56.5] {
            for tilt_deg in [0.0_f64, 40.0, 90.0] {
                let (axes, origin_mm) = shape.frame_at(from_tip_mm, -180.0);
                let turn = DQuat::from_rotation_y(tilt_deg.to_radians());
                let pose = Pose::from_quaternion(turn.to_array(), [0.0, 0.0, -0.6]).within(axes, origin_mm);
                let found = simulator.press(&Indenter::clusters(Arc::clone(object), pose));
                assert_sound(&found, 2.5, &format!("{name}, {from_tip_mm} mm, {tilt_deg} degrees"));
            }
        }
    }
}
