//! Two fingers that hold an object: Hertz's contacts in series, the force that the search presses with, and the torque that is left.

use std::path::Path;

use gelsim_job::config::Overrides;
use gelsim_job::gripper::{Grip, render};
use gelsim_job::plan::Plan;
use gelsim_job::scene::Scene;

/// Grips of an object of `objects/` by pads of 80 x 80 px of 0.125 mm.
fn plan(object: &str, more: &str) -> Plan {
    let text = format!(
        "{more}\n[dataset]\nname = \"t\"\nsamples = 8\nseed = 3\n[[object]]\npath = \"objects/{object}.obj\"\n\
         [sensor]\nresolution_px = [80, 80]\nfield_of_view_mm = [10.0, 10.0]\n"
    );
    Plan::read("job", text, Path::new(env!("CARGO_MANIFEST_DIR")), &Overrides::default()).expect("a sound job")
}

fn forces(grip: &Grip) -> [f64; 2] {
    grip.fingers.each_ref().map(|finger| finger.impression.contact.total.total_force_n.expect("an elastic pad"))
}

#[test]
fn a_ball_between_two_thick_pads_is_two_contacts_of_hertz_in_series() {
    const RADIUS: f64 = 4.0;
    const SQUEEZE: f64 = 0.5;
    for (left_kpa, right_kpa) in [(100.0, 100.0), (100.0, 200.0), (300.0, 60.0)] {
        let more = format!(
            "fidelity = \"high\"\ngripper.squeeze_mm = {SQUEEZE}\n\
             gripper.right.resolution_px = [80, 80]\ngripper.right.field_of_view_mm = [10.0, 10.0]\n\
             gripper.right.gelpad_thickness_mm = 500.0\ngripper.right.gelpad_youngs_modulus_kpa = {right_kpa:?}\n\
             sensor.gelpad_thickness_mm = 500.0\nsensor.gelpad_youngs_modulus_kpa = {left_kpa:?}\n"
        );
        let plan = Plan::read(
            "job",
            format!(
                "{more}sensor.resolution_px = [80, 80]\nsensor.field_of_view_mm = [10.0, 10.0]\n\
                 dataset = {{ name = \"t\", samples = 1 }}\nobject = [{{ path = \"objects/sphere.obj\" }}]\n"
            ),
            Path::new(env!("CARGO_MANIFEST_DIR")),
            &Overrides::default(),
        )
        .expect("a sound job");
        let grip = render(&plan, 0, 0);
        assert!(grip.label.gripper.balanced && grip.summary.health.healthy, "{:?}", grip.label.gripper);
        // F = 4/3 E* sqrt(R) d^1.5 on either side.
        let stiffness = [left_kpa, right_kpa].map(|kpa| kpa / (1.0 - 0.48 * 0.48));
        let gives = stiffness.map(|kpa: f64| kpa.powf(-2.0 / 3.0));
        let both = gives[0] + gives[1];
        let expected_n = 1e-3 * 4.0 / 3.0 * RADIUS.sqrt() * (SQUEEZE / both).powf(1.5);
        for (k, finger) in [&grip.label.left, &grip.label.right].into_iter().enumerate() {
            let share = finger.indentation_depth_mm / SQUEEZE - gives[k] / both;
            let force = forces(&grip)[k] / expected_n - 1.0;
            println!("{left_kpa} and {right_kpa} kPa, finger {k}: share off by {share:.1e}, force by {force:.1e}");
            assert!(share.abs() < 5e-3 && force.abs() < 2e-2, "{left_kpa} {right_kpa} {k}: {share} {force}");
        }
    }
}

#[test]
fn the_force_that_a_search_presses_with_is_the_presss_to_the_bit() {
    let more = "gripper.squeeze_mm = [0.5, 2.5]\npose.tilt_deg = [0.0, 20.0]\npose.face = \"any\"\npose.x_mm = [-6.0, 6.0]\n\
                texture = { patterns = [\"knurled\"], amplitude_mm = 0.1, scale_mm = 1.0 }\n";
    let mut beyond = 0;
    for object in ["sphere", "cube", "bolt"] {
        let plan = plan(object, more);
        for index in 0..4 {
            let scene = Scene::draw(&plan, index, 0).at_depth(0.3 + 0.2 * index as f64);
            let simulator = scene.simulator(&plan);
            let press = scene.to_press(&plan);
            let contact = simulator.press_with(&press).contact;
            assert_eq!(simulator.total_force_n(&press), contact.total.total_force_n, "{object} {index}");
            assert!(contact.total.total_force_n.is_some());
            beyond += u32::from(contact.total.cut_by_view);
        }
    }
    assert!(beyond > 0, "some go on beyond the view");
}

#[test]
fn grips_of_all_kinds_are_in_balance_and_say_the_torque_that_their_pressures_have() {
    let more = "gripper.force_n = [0.3, 3.0]\npose.tilt_deg = [0.0, 8.0]\npose.yaw_deg = [0.0, 360.0]\npose.face = \"any\"\n\
                pose.x_mm = [-1.5, 1.5]\n";
    let (mut told, mut largest) = (0, 0.0_f64);
    for object in ["sphere", "cube", "bolt", "hexagon_nut", "cone"] {
        let plan = plan(object, more);
        for index in 0..3 {
            let grip = render(&plan, index, 0);
            let label = &grip.label.gripper;
            let [left, right] = forces(&grip);
            assert!(grip.summary.health.healthy, "{object} {index}: {}", grip.summary.health.reason);
            assert!((left - right).abs() <= 1e-3 * left.max(right), "{object} {index}: {left} {right}");
            // r x f of each pixel's pressure, in the gripper's frame.
            let mut torque = [0.0; 2];
            let mut seen = true;
            for ((finger, [along_x, along_z]), total) in
                grip.fingers.iter().zip([[1.0, 1.0], [-1.0, -1.0]]).zip([left, right])
            {
                seen &= !finger.impression.contact.total.cut_by_view;
                let pressure = finger.impression.contact.pressure.as_ref().expect("contact");
                // The pressure in the image is that of the solver's grid, sampled: where it acts, but not quite how much it is.
                let sum: f64 = pressure.data.iter().map(|kpa| f64::from(*kpa)).sum();
                for y in 0..80 {
                    for x in 0..80 {
                        let at = [x, y].map(|px| (px as f64 + 0.5 - 40.0) * 0.125);
                        let force = along_z * total * f64::from(pressure.at(x, y)) / sum;
                        torque[0] += at[1] * force;
                        torque[1] -= along_x * at[0] * force;
                    }
                }
            }
            if let Some(said) = label.torque_nmm.filter(|_| seen) {
                told += 1;
                for k in 0..2 {
                    largest = largest.max(said[k].abs() / left);
                    // In mm of lever: two pixels.
                    assert!((said[k] - torque[k]).abs() < 0.25 * left, "{object} {index}: {said:?} {torque:?}");
                }
            }
        }
    }
    assert!(told >= 8 && largest > 0.5, "{told} {largest}");
}

/// The brick goes on beyond the view. Pixels leave open where in them a wall is, so that all levels have the same pixels here.
#[test]
fn torques_at_standard_are_those_of_the_cameras_grid() {
    let objects = ["cube", "cylinder", "brick"];
    for object in &objects[..if crate::thorough() { 3 } else { 2 }] {
        let torques_nmm = |level: &str| {
            let plan = Plan::read(
                "job",
                format!(
                    "fidelity = \"{level}\"\ngripper.force_n = 1.0\npose = {{ yaw_deg = [0.0, 360.0], tilt_deg = [1.0, 3.0] }}\n\
                     sensor = {{ preset = \"digit\" }}\n\
                     dataset = {{ name = \"t\", samples = 6, seed = 3 }}\nobject = [{{ path = \"objects/{object}.obj\" }}]\n"
                ),
                Path::new(env!("CARGO_MANIFEST_DIR")),
                &Overrides::default(),
            )
            .expect("a sound job");
            let torque = |index| render(&plan, index, 0).label.gripper.torque_nmm.expect("a known torque");
            (0..6).map(torque).collect::<Vec<[f64; 2]>>()
        };
        let exact = torques_nmm("reference");
        for (level, most) in [("draft", 0.05), ("standard", 0.025)] {
            let off = |(found, exact): (&[f64; 2], &[f64; 2])| {
                (found[0] - exact[0]).hypot(found[1] - exact[1]) / exact[0].hypot(exact[1])
            };
            let found = torques_nmm(level);
            println!("{found:.4?} {exact:.4?}");
            let mean = found.iter().zip(&exact).map(off).sum::<f64>() / 6.0;
            println!("{object}, {level}: torque off by {:.2} % on the mean", 100.0 * mean);
            assert!(mean < most, "{object}, {level}: {mean}");
        }
    }
}
