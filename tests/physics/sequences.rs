//! Sequences as a whole, from the job to images and labels: Mindlin's push of a ball, gross slip, rolling, hysteresis, and what the
//! frame rate changes.

use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::gelpad::material::Material;
use gelsim_job::sample::Sample;
use gelsim_job::sequence::label::{FrameLabel, SequenceLabel, SlipState};
use gelsim_job::sequence::render;

use super::history::{solve, stiffer};
use crate::plan::plan;

/// Radius of `objects/sphere.obj`, mm.
const RADIUS_MM: f64 = 4.0;

struct Setup {
    fidelity: &'static str,
    field_of_view_mm: [f64; 2],
    thickness_mm: f64,
    frame_rate_hz: f64,
    friction: f64,
    object: &'static str,
}

const SETUP: Setup = Setup {
    fidelity: "standard",
    field_of_view_mm: [16.0, 12.0],
    thickness_mm: 3.0,
    frame_rate_hz: 25.0,
    friction: 0.4,
    object: "sphere",
};

/// The label of a sequence; `each` is shown every frame and its number.
fn frames(setup: &Setup, phases: &[&str], mut each: impl FnMut(u32, &Sample)) -> SequenceLabel {
    let Setup { fidelity, field_of_view_mm: [width, height], thickness_mm, frame_rate_hz, friction, object } = setup;
    let phases: String =
        phases.iter().enumerate().map(|(k, phase)| format!("[[sequence.phase]]\nname = \"{k}\"\n{phase}\n")).collect();
    let plan = plan(&format!(
        "fidelity = {fidelity:?}\ndataset = {{ name = \"a\", samples = 1 }}\nobject = [{{ path = \"objects/{object}.obj\" }}]\n\
         [sensor]\nresolution_px = [160, 120]\nfield_of_view_mm = [{width:?}, {height:?}]\n\
         gelpad_thickness_mm = {thickness_mm:?}\n[output]\nlayers = [\"flow\"]\n[sequence]\n\
         frame_rate_hz = {frame_rate_hz:?}\nfriction = {{ coefficient = {friction:?} }}\n{phases}"
    ));
    let done = render(&plan, 0, 0, |sample, number| {
        each(number, &sample);
        Ok::<(), std::convert::Infallible>(())
    });
    let Ok(done) = done;
    assert!(done.summary.health.healthy, "{}", done.summary.health.reason);
    done.label
}

/// The label of a sequence, and the pad's motion in its last frame.
fn run(setup: &Setup, phases: &[&str]) -> (SequenceLabel, Vec<[f32; 2]>) {
    let mut last = Vec::new();
    let label = frames(setup, phases, |_, sample| last = sample.impression.flow_mm());
    (label, last)
}

/// Force along x, y and into the pad, N.
fn force(frame: &FrameLabel) -> [f64; 3] {
    let [x, y, z] = frame.wrench.force_n;
    [x, y, -z]
}

fn last(label: &SequenceLabel) -> &FrameLabel {
    label.frames.last().expect("frames")
}

#[test]
fn a_ball_pushed_over_a_thick_pad_follows_mindlin() {
    // 12 mm of pad under a contact of 0.75 mm radius.
    let (h, nu, mu, youngs_kpa) = (12.0, 0.48, 0.4, 145.0);
    let setup = Setup { fidelity: "high", field_of_view_mm: [5.0, 3.75], thickness_mm: h, friction: mu, ..SETUP };
    let (label, _) = run(&setup, &["duration_s = 0.2\ndepth_mm = 0.14", "duration_s = 0.4\nx_mm = 0.08"]);
    let layer = ElasticLayer::new(&Material { thickness_mm: h, poisson_ratio: nu, youngs_modulus_kpa: youngs_kpa });
    let pressed = &label.frames[4];
    let normal = force(pressed)[2];
    // Of a half-space; the layer's stiffness adds some percent.
    let hertz = 4.0 / 3.0 / (1.0 - nu * nu) * (RADIUS_MM * 0.14_f64.powi(3)).sqrt() * youngs_kpa * 1e-3;
    assert!((1.0..1.1).contains(&(normal / hertz)), "{normal} of {hertz} N");
    let a = (3.0 * (1.0 - nu * nu) * normal / (youngs_kpa * 1e-3) * RADIUS_MM / 4.0).cbrt();
    let most = mu * normal;
    // 3 mu N (2 - nu) / (16 G a) (1 - (1 - x)^(2/3)), less what the shell below holds back.
    let soft = 3.0 * most * (2.0 - nu) * (1.0 + nu) / 8.0 / a / (youngs_kpa * 1e-3);
    let stiff = stiffer(layer, nu) * most / (youngs_kpa * 1e-3);
    let path = |x: f64| soft * (1.0 - (1.0 - x).max(0.0).powf(2.0 / 3.0)) - stiff * x;
    let (mut off_force, mut off_stick) = (0.0_f64, 0.0_f64);
    for (k, frame) in label.frames[5..].iter().enumerate() {
        let [x, y, _] = force(frame);
        let share = solve(path, 0.08 * (k + 1) as f64 / 10.0, 0.0, 1.0);
        off_force = off_force.max((x / most - share).abs());
        assert!(y.abs() < 1e-3 * most, "{y}");
        // The radius that sticks, over the contact's.
        off_stick = off_stick.max((frame.slip.stick_fraction.sqrt() - (1.0 - share).cbrt()).abs());
    }
    println!(
        "sequences: Mindlin: force off by {off_force:.4} of mu N, stick radius by {off_stick:.3} of the contact's"
    );
    assert!(off_force < 0.03 && off_stick < 0.05, "{off_force} {off_stick}");
}

#[test]
fn what_slips_as_a_whole_is_pulled_by_friction_times_force() {
    for (object, fidelity) in [("sphere", "draft"), ("sphere", "standard"), ("sphere", "high"), ("cube", "standard")] {
        let setup = Setup { object, fidelity, friction: 0.2, ..SETUP };
        let (label, _) =
            run(&setup, &["duration_s = 0.2\ndepth_mm = 0.5", "duration_s = 0.4\nx_mm = 1.2\ny_mm = -0.9"]);
        let frame = last(&label);
        let [x, y, normal] = force(frame);
        assert_eq!(frame.slip.state, SlipState::Gross, "{object} {fidelity}");
        let pulled = x.hypot(y) / (0.2 * normal);
        println!("sequences: {object}, {fidelity}: {pulled:.4} of mu N in gross slip");
        assert!((pulled - 1.0).abs() < 0.02, "{pulled}");
        // Against the contact as the image has it, which feels what sticks.
        let in_view = frame.contact.force_n.expect("an elastic pad");
        assert!((in_view / normal - 1.0).abs() < 0.06, "{object} {fidelity}: {in_view} {normal}");
    }
}

#[test]
fn what_slides_slips_in_every_frame_even_if_its_pressure_changes() {
    for (fidelity, frame_rate_hz) in [("draft", 25.0), ("standard", 25.0), ("standard", 100.0), ("reference", 25.0)] {
        let setup = Setup { friction: 0.3, fidelity, frame_rate_hz, ..SETUP };
        let (label, _) =
            run(&setup, &["duration_s = 0.12\ndepth_mm = 0.6", "duration_s = 1.0\nx_mm = 3.0\ndepth_mm = 0.65"]);
        let step_mm = 3.0 / frame_rate_hz;
        let slid = label.frames.iter().filter(|frame| frame.t_s > 0.6);
        // A last frame may end within the phase.
        let count = slid.clone().count() - 1;
        let mut worst = 0.0_f64;
        for frame in slid.take(count) {
            let [x, y, normal] = force(frame);
            let slip = &frame.slip;
            assert_eq!((slip.state, slip.stick_fraction > 0.02), (SlipState::Gross, false), "{fidelity} {slip:?}");
            let heat = slip.dissipated_nmm / (0.3 * normal * step_mm);
            worst = worst.max((x.hypot(y) / (0.3 * normal) - 1.0).abs()).max((heat - 1.0).abs());
        }
        println!("sequences: {fidelity} at {frame_rate_hz} Hz: a slide under rising pressure is off by {worst:.4}");
        assert!(worst < if fidelity == "draft" { 0.03 } else { 0.02 }, "{fidelity} {frame_rate_hz}: {worst}");
    }
}

#[test]
fn little_friction_is_friction_at_every_level() {
    for (fidelity, friction, depth_mm) in [
        ("draft", 0.001, 0.5),
        ("standard", 0.001, 0.5),
        ("standard", 0.003, 0.1),
        ("standard", 0.03, 0.02),
        ("high", 0.01, 0.05),
    ] {
        let setup = Setup { friction, fidelity, ..SETUP };
        let press = format!("duration_s = 0.2\ndepth_mm = {depth_mm}");
        let (label, _) = run(&setup, &[&press, "duration_s = 0.4\nx_mm = 0.6", "duration_s = 0.2"]);
        for frame in &label.frames[6..15] {
            let [x, _, normal] = force(frame);
            assert_eq!(frame.slip.state, SlipState::Gross, "{fidelity} {friction} {depth_mm}: {:?}", frame.slip);
            let pulled = x / (friction * normal);
            assert!((pulled - 1.0).abs() < 0.02, "{fidelity} {friction} {depth_mm}: {pulled}");
        }
    }
}

#[test]
fn what_is_held_still_sticks() {
    for (fidelity, x_mm, frame_rate_hz) in
        [("standard", 0.1, 25.0), ("standard", 0.6, 25.0), ("standard", 0.3, 100.0), ("reference", 0.3, 25.0)]
    {
        let setup = Setup { friction: 0.3, fidelity, frame_rate_hz, ..SETUP };
        let push = format!("duration_s = 0.2\nx_mm = {x_mm}");
        let (label, _) = run(&setup, &["duration_s = 0.2\ndepth_mm = 0.6", &push, "duration_s = 0.4"]);
        let held = |frame: &&FrameLabel| frame.t_s > 0.4 + 1.5 / frame_rate_hz;
        let pushed = label.frames.iter().rfind(|frame| !held(frame)).expect("a frame");
        for frame in label.frames.iter().filter(held) {
            let slip = &frame.slip;
            assert_eq!((slip.stick_fraction, slip.state), (1.0, SlipState::None), "{fidelity} {x_mm}: {slip:?}");
            let [[x, ..], [pulled, ..]] = [frame, pushed].map(force);
            assert!((x / pulled - 1.0).abs() < 1e-3, "{x} of {pulled} N");
        }
    }
}

#[test]
fn a_block_that_slides_into_view_presses_as_one_that_was_pressed_there() {
    let setup = Setup { friction: 0.3, object: "cube", ..SETUP };
    let slid = |way: &[&str]| run(&setup, way).0;
    let label = slid(&["duration_s = 0.04\ndepth_mm = 0.8\nx_mm = 16.0", "duration_s = 0.8\nx_mm = -16.0"]);
    let most = label.frames.iter().map(|frame| force(frame)[2]).fold(0.0, f64::max);
    let mut worst = 0.0_f64;
    for frame in label.frames.iter().skip(1).step_by(3) {
        let there = 16.0 - 20.0 * (frame.t_s - 0.04);
        let press = format!("duration_s = 0.04\nx_mm = {there}");
        let pressed = slid(&[&press, "duration_s = 0.04\ndepth_mm = 0.8"]);
        worst = worst.max((force(frame)[2] - force(last(&pressed))[2]).abs() / most);
    }
    println!("sequences: a block that slides into view presses within {worst:.4} of its force");
    assert!(worst < 0.02, "{worst}");
}

#[test]
fn a_ball_that_rolls_goes_on_without_being_pulled() {
    let setup = Setup { friction: 0.5, ..SETUP };
    let (label, _) = run(
        &setup,
        &["duration_s = 0.2\ndepth_mm = 0.5", "duration_s = 0.8\ntilt_deg = 20.0\ntilt_azimuth_deg = 90.0"],
    );
    let (before, after) = (&label.frames[4], last(&label));
    let [x, y, normal] = force(after);
    let [from, to] = [before, after].map(|frame| frame.contact.centroid_mm);
    let rolled = to[0] - from[0];
    println!(
        "sequences: rolled {rolled:.3} mm of {:.3}; pulled by {:.3} mu N",
        RADIUS_MM * 20.0_f64.to_radians(),
        x.hypot(y) / (0.5 * normal)
    );
    // A turn about +y takes the top of the ball to +x.
    assert!((rolled / (RADIUS_MM * 20.0_f64.to_radians()) - 1.0).abs() < 0.03, "{rolled}");
    assert!((to[1] - from[1]).abs() < 0.05, "{from:?} {to:?}");
    assert!(x.hypot(y) < 0.1 * 0.5 * normal, "{x} {y}");
    assert!((normal / force(before)[2] - 1.0).abs() < 0.01, "{normal} {:?}", force(before));
}

#[test]
fn a_push_out_and_back_leaves_force_and_motion_behind() {
    let phases = ["duration_s = 0.2\ndepth_mm = 0.5", "duration_s = 0.4\nx_mm = 1.2", "duration_s = 0.4\nx_mm = -1.2"];
    let setup = Setup { friction: 0.3, ..SETUP };
    let (label, flow) = run(&setup, &phases);
    let [x, _, normal] = force(last(&label));
    assert!(x < -0.1 * 0.3 * normal, "{x} of {normal}: pulled the other way");
    let most = flow.iter().map(|[x, _]| x.abs()).fold(0.0, f32::max);
    assert!(most > 0.02, "{most}");
    let heat: f64 = label.frames.iter().map(|frame| frame.slip.dissipated_nmm).sum();
    assert!(heat > 0.0, "{heat}");
    // Held by much friction it comes back to where it was.
    let (label, _) = run(&Setup { friction: 10.0, ..SETUP }, &phases);
    let [x, _, normal] = force(last(&label));
    assert!(x.abs() < 5e-3 * 10.0 * normal, "{x} of {normal}");
    // Lifted and pressed again nothing is left of it.
    let again = [
        "duration_s = 0.2\ndepth_mm = 0.5",
        "duration_s = 0.2\nx_mm = 0.5",
        "duration_s = 0.1\ndepth_mm = -0.1",
        "duration_s = 0.2\ndepth_mm = 0.5",
    ];
    let (label, _) = run(&setup, &again);
    let [x, y, normal] = force(last(&label));
    assert!(x.hypot(y) < 5e-3 * normal, "{x} {y}");
}

#[test]
fn what_a_lift_turns_into_heat_is_the_same_at_every_frame_rate() {
    let phases =
        ["duration_s = 0.2\ndepth_mm = 0.3", "duration_s = 0.4\nx_mm = 0.2", "duration_s = 0.2\ndepth_mm = -0.1"];
    let fast_hz = if crate::thorough() { 400.0 } else { 100.0 };
    for (object, friction) in [("sphere", 0.5), ("sphere", 2.0), ("cube", 0.5)] {
        let [few, many] = [25.0, fast_hz].map(|frame_rate_hz| {
            let setup = Setup { thickness_mm: 12.0, frame_rate_hz, object, friction, ..SETUP };
            run(&setup, &phases).0.frames.iter().map(|frame| frame.slip.dissipated_nmm).sum::<f64>()
        });
        println!(
            "sequences: {object}, mu {friction}: heat of a lift {few:.5} N mm, {many:.5} at {fast_hz} frames a second"
        );
        assert!((few / many - 1.0).abs() < 0.03, "{object} {friction}: {few} {many}");
    }
}

#[test]
fn a_twist_pulls_with_friction_times_the_pressure_in_the_picture() {
    for (object, mu, thickness_mm) in [("sphere", 1.0, 4.0), ("sphere", 0.3, 2.0), ("cylinder", 1.0, 4.0)] {
        let setup = Setup { fidelity: "high", friction: mu, thickness_mm, object, ..SETUP };
        let mut pressure_kpa = Vec::new();
        let phases = ["duration_s = 0.2\ndepth_mm = 0.5", "duration_s = 2.4\ntwist_deg = 120.0"];
        let label = frames(&setup, &phases, |_, sample| {
            pressure_kpa = sample.impression.pressure_kpa().expect("an elastic pad");
        });
        // 160 x 120 pixels of 0.1 mm.
        let place = |k: usize, count: usize| 0.1 * (k as f64 + 0.5 - 0.5 * count as f64);
        let torque = |(at, kpa): (usize, &f32)| f64::from(*kpa) * place(at % 160, 160).hypot(place(at / 160, 120));
        let most = mu * 1e-5 * pressure_kpa.iter().enumerate().map(torque).sum::<f64>();
        let share = last(&label).wrench.torque_nmm[2] / most;
        println!("sequences: {object}, mu {mu}, {thickness_mm} mm: a twist of 120 degrees: {share:.4} of the torque");
        assert!((share - 1.0).abs() < 5e-3, "{object} {mu}: {share}");
    }
}

#[test]
fn tractions_add_up_to_the_wrench_and_stay_below_friction_times_pressure() {
    let phases = [
        "duration_s = 0.2\ndepth_mm = 0.5",
        "duration_s = 0.4\nx_mm = 0.3\ny_mm = -0.1",
        "duration_s = 0.4\ntwist_deg = 40.0",
    ];
    for (object, fidelity, mu) in [("sphere", "draft", 0.4), ("sphere", "high", 1.0), ("cube", "standard", 0.3)] {
        let setup = Setup { object, fidelity, friction: mu, ..SETUP };
        let mut sums = Vec::new();
        let label = frames(&setup, &phases, |_, sample| {
            let mut sum = [0.0; 4];
            for (at, t) in sample.impression.traction_kpa().expect("an elastic pad").iter().enumerate() {
                let [x, y, z] = t.map(f64::from);
                assert!(x.hypot(y) <= mu * z * (1.0 + 1e-5), "{object}: {t:?}");
                // 160 x 120 pixels of 0.1 mm.
                let [px, py] = [(at % 160, 160), (at / 160, 120)].map(|(k, n)| 0.1 * (k as f64 + 0.5 - 0.5 * n as f64));
                let add = [x, y, -z, px * y - py * x];
                sum = std::array::from_fn(|k| sum[k] + 1e-5 * add[k]);
            }
            sums.push(sum);
        });
        let mut worst = 0.0_f64;
        for (frame, [x, y, z, torque]) in label.frames.iter().zip(sums) {
            let [fx, fy, fz] = frame.wrench.force_n;
            let off = [x - fx, y - fy, z - fz, torque - frame.wrench.torque_nmm[2]];
            worst = off.iter().fold(worst, |most, off| most.max(off.abs() / fz.abs().max(1e-6)));
        }
        println!("sequences: {object}, {fidelity}: tractions are off the wrench by {worst:.1e} of its force");
        assert!(worst < 1e-6, "{object} {fidelity}: {worst}");
    }
}

#[test]
fn tractions_of_a_press_add_up_to_its_labels() {
    for (fidelity, friction) in [("standard", "\"stick\""), ("high", "{ coulomb = { coefficient = 0.4 } }")] {
        let plan = plan(&format!(
            "fidelity = {fidelity:?}\ndataset = {{ name = \"a\", samples = 1 }}\nobject = [{{ path = \"objects/sphere.obj\" }}]\n\
             [sensor]\nresolution_px = [160, 120]\nfield_of_view_mm = [16.0, 12.0]\n[indentation]\ndepth_mm = 0.6\n\
             [output]\nlayers = [\"traction\"]\n[shear]\nx_mm = 0.2\ntwist_deg = 4.0\nfriction = {friction}\n"
        ));
        let sample = gelsim_job::sample::render(&plan, 0);
        let mut sum = [0.0; 3];
        for t in sample.impression.traction_kpa().expect("an elastic pad") {
            sum = std::array::from_fn(|k| sum[k] + 1e-5 * f64::from(t[k]));
            assert!(fidelity == "standard" || f64::from(t[0].hypot(t[1])) <= 0.4 * f64::from(t[2]) * (1.0 + 1e-5));
        }
        let [x, y] = sample.label.shear.force_n.expect("an elastic pad");
        let normal = sample.label.contact.force_n.expect("an elastic pad");
        println!("sequences: {fidelity}: tractions of a press {sum:?}, labels {x} {y} {normal}");
        assert!(x > 0.05 * normal);
        for (sum, label) in sum.into_iter().zip([x, y, normal]) {
            assert!((sum - label).abs() < 1e-5 * normal, "{sum} {label}");
        }
    }
}

#[test]
fn twenty_five_frames_a_second_do_as_well_as_four_hundred() {
    let phases = [
        "duration_s = 0.4\ndepth_mm = 0.6",
        "duration_s = 0.8\nx_mm = 0.6\ny_mm = 0.2\ntwist_deg = 3.0",
        "duration_s = 0.4\ndepth_mm = 0.3",
    ];
    // Ends of the second and of the third phase.
    let ends_s = [1.2, 1.6];
    let objects = ["sphere", "cube"];
    for &object in if crate::thorough() { &objects[..] } else { &objects[..1] } {
        let at = |frame_rate_hz: f64| {
            let mut flows = Vec::new();
            let setup = Setup { frame_rate_hz, object, friction: 0.5, ..SETUP };
            let label = frames(&setup, &phases, |number, sample| {
                if ends_s.iter().any(|end| (f64::from(number + 1) / frame_rate_hz - end).abs() < 1e-9) {
                    flows.push((number, sample.impression.flow_mm()));
                }
            });
            (label, flows)
        };
        let ((few, few_flows), (many, many_flows)) = (at(25.0), at(400.0));
        assert_eq!((few_flows.len(), many_flows.len()), (2, 2));
        for ((a, few_flow), (b, many_flow)) in few_flows.iter().zip(&many_flows) {
            let off = few_flow.iter().zip(many_flow).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f32::max);
            let (a, b) = (force(&few.frames[*a as usize]), force(&many.frames[*b as usize]));
            let pulled = (a[0] - b[0]).hypot(a[1] - b[1]) / (0.5 * b[2]);
            println!("sequences: {object}: 25 against 400 frames a second: {:.2} um, {pulled:.1e} of mu N", 1e3 * off);
            assert!(off < 4e-3 && pulled < 2.5e-3, "{object}: {off} {pulled}");
        }
    }
}
