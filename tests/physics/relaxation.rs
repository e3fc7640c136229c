//! Pads that relax: held, pressed at other speeds, shaken, left, rubbed and turned, against closed forms of linear
//! viscoelasticity.

use gelsim_core::effects::Effect;
use gelsim_core::gelpad::elastic::relaxation::RelaxationMode;
use gelsim_job::sample::Sample;
use gelsim_job::sequence::label::{FrameLabel, SequenceLabel};
use gelsim_job::sequence::render;

use crate::plan::plan;

const MODES: [RelaxationMode; 2] =
    [RelaxationMode { share: 0.3, time_s: 0.1 }, RelaxationMode { share: 0.2, time_s: 1.0 }];

/// A sequence: its sensor, its object, its phases.
struct Setup<'a> {
    modes: &'a [RelaxationMode],
    frame_rate_hz: f64,
    friction: f64,
    object: &'a str,
    sensor: &'a str,
    phases: String,
}

impl Default for Setup<'_> {
    fn default() -> Self {
        Setup {
            modes: &MODES,
            frame_rate_hz: 25.0,
            friction: 0.4,
            object: "sphere",
            sensor: sensor(),
            phases: String::new(),
        }
    }
}

/// A flat sensor, of a quarter of the pixels unless all is to be tried.
fn sensor() -> &'static str {
    match crate::thorough() {
        true => "resolution_px = [160, 120]\nfield_of_view_mm = [16.0, 12.0]\ngelpad_thickness_mm = 3.0",
        false => "resolution_px = [80, 60]\nfield_of_view_mm = [16.0, 12.0]\ngelpad_thickness_mm = 3.0",
    }
}

/// Writes phases.
fn phases<'a>(of: impl IntoIterator<Item = &'a str>) -> String {
    let phase = |(k, phase)| format!("[[sequence.phase]]\nname = \"{k}\"\n{phase}\n");
    of.into_iter().enumerate().map(phase).collect()
}

fn frames(setup: &Setup<'_>, mut each: impl FnMut(&Sample)) -> SequenceLabel {
    let Setup { modes, frame_rate_hz, friction, object, sensor, phases } = setup;
    let mode = |mode: &RelaxationMode| format!("{{ share = {:?}, time_s = {:?} }}", mode.share, mode.time_s);
    let modes: Vec<String> = modes.iter().map(mode).collect();
    let plan = plan(&format!(
        "fidelity = \"standard\"\ngelpad.relaxation = [{}]\ndataset = {{ name = \"a\", samples = 1 }}\n\
         object = [{{ path = \"objects/{object}.obj\" }}]\noutput.layers = [\"flow\"]\n\
         [sensor]\n{sensor}\n\
         [sequence]\nframe_rate_hz = {frame_rate_hz:?}\nfriction = {{ coefficient = {friction:?} }}\n{phases}",
        modes.join(", ")
    ));
    let done = render(&plan, 0, 0, |sample, _| {
        each(&sample);
        Ok::<(), std::convert::Infallible>(())
    });
    let Ok(done) = done;
    assert!(done.summary.health.healthy, "{}", done.summary.health.reason);
    done.label
}

fn label(setup: &Setup<'_>) -> SequenceLabel {
    frames(setup, |_| {})
}

/// The force into the pad, N.
fn normal(frame: &FrameLabel) -> f64 {
    0.0 - frame.wrench.force_n[2]
}

/// The forces of a pad that relaxes, from those of an elastic one under the same shapes, which follow each other in
/// `step_s` (Lee and Radok 1960).
fn relaxed(elastic_n: &[f64], step_s: f64, modes: &[RelaxationMode]) -> Vec<f64> {
    // In each step the force changes at a constant rate.
    let remaining = |from_s: f64, to_s: f64| {
        let lost = |mode: &RelaxationMode| {
            let integral = mode.time_s * ((-from_s / mode.time_s).exp() - (-to_s / mode.time_s).exp());
            mode.share * (1.0 - integral / (to_s - from_s))
        };
        1.0 - modes.iter().map(lost).sum::<f64>()
    };
    let before = |at: usize| if at == 0 { 0.0 } else { elastic_n[at - 1] };
    let sum = |until: usize| {
        let part = |at: usize| {
            let ago = (until - at) as f64 * step_s;
            (elastic_n[at] - before(at)) * remaining(ago, ago + step_s)
        };
        (0..=until).map(part).sum()
    };
    (0..elastic_n.len()).map(sum).collect()
}

const PRESS_AND_HOLD: [&str; 2] = ["duration_s = 0.2\ndepth_mm = 0.4", "duration_s = 1.0"];

#[test]
fn a_ball_that_is_held_relaxes_as_lee_and_radok_say() {
    let dome = "preset = \"tactip\"";
    for (name, sensor, object) in [
        ("flat, ball", Setup::default().sensor, "sphere"),
        ("flat, torus", Setup::default().sensor, "torus"),
        ("dome, ball", dome, "sphere"),
    ] {
        let fine = 400.0;
        let of = |modes, frame_rate_hz| Setup {
            modes,
            frame_rate_hz,
            object,
            sensor,
            phases: phases(PRESS_AND_HOLD),
            ..Setup::default()
        };
        // Only the press has to be known finely; then the shape is held.
        let press = Setup { phases: phases([PRESS_AND_HOLD[0]]), ..of(&[], fine) };
        let mut elastic: Vec<f64> = label(&press).frames.iter().map(normal).collect();
        let held = *elastic.last().expect("frames");
        elastic.resize(480, held);
        let expected = relaxed(&elastic, 1.0 / fine, &MODES);
        for rate in [25.0, 100.0] {
            let found = label(&of(&MODES, rate));
            let mut off = 0.0_f64;
            for (k, frame) in found.frames.iter().enumerate().skip((0.2 * rate) as usize - 1) {
                let at = ((k + 1) as f64 * fine / rate) as usize - 1;
                off = off.max((normal(frame) / expected[at] - 1.0).abs());
            }
            let last = normal(found.frames.last().expect("frames"));
            println!(
                "relaxation: {name}, {rate} Hz: held force {:.3} of the elastic one, off by {off:.4}",
                last / held
            );
            assert!(off < 0.01, "{name} {rate}: {off}");
            assert!((0.5..0.6).contains(&(last / held)), "{last} of {held}");
        }
    }
}

#[test]
fn what_is_shaken_answers_with_the_complex_modulus() {
    // The mean depth, the amplitude, and periods of 20 frames each.
    let (mean_mm, by_mm, per_period, periods) = (0.3, 0.03, 20, 12);
    for (object, rate) in [("cylinder", 20.0), ("cylinder", 100.0), ("sphere", 50.0)] {
        let omega = std::f64::consts::TAU * rate / per_period as f64;
        let depth = |frame: usize| mean_mm + by_mm * (omega * frame as f64 / rate).sin();
        let motion: Vec<String> = std::iter::once(format!("duration_s = {:?}\ndepth_mm = {mean_mm}", 1.0 / rate))
            .chain(
                (1..=per_period * periods).map(|k| format!("duration_s = {:?}\ndepth_mm = {:?}", 1.0 / rate, depth(k))),
            )
            .collect();
        let of = |modes| Setup {
            modes,
            frame_rate_hz: rate,
            object,
            friction: 0.0,
            phases: phases(motion.iter().map(String::as_str)),
            ..Setup::default()
        };
        // One mode, so that the start has faded after some periods.
        let modes = [RelaxationMode { share: 0.4, time_s: 0.1 }];
        // In the last period, the part of the force in phase with the motion, and the part ahead of it.
        let parts = |label: &SequenceLabel| {
            let forces: Vec<f64> = label.frames.iter().map(normal).collect();
            let last = &forces[1 + per_period * (periods - 1)..];
            let sum = |of: fn(f64) -> f64| -> f64 {
                let at = |k: usize| of(omega * (1 + per_period * (periods - 1) + k) as f64 / rate);
                last.iter().enumerate().map(|(k, force)| force * at(k)).sum::<f64>() * 2.0 / per_period as f64
            };
            [sum(f64::sin), sum(f64::cos)]
        };
        let [stiffness, _] = parts(&label(&of(&[])));
        let [in_phase, ahead] = parts(&label(&of(&modes))).map(|part| part / stiffness);
        let turns = omega * modes[0].time_s;
        // Samples of a sine at 20 to a period are joined by lines.
        let joined = (std::f64::consts::PI / per_period as f64).sin() / (std::f64::consts::PI / per_period as f64);
        let storage = 1.0 - modes[0].share / (1.0 + turns * turns);
        let loss = modes[0].share * turns / (1.0 + turns * turns);
        println!(
            "relaxation: {object}, {turns:.2} rad per time: storage {in_phase:.4} of {storage:.4}, loss {ahead:.4} of {loss:.4}"
        );
        let complex = storage.hypot(loss);
        assert!(
            (in_phase - storage).abs() < 0.01 * complex + (1.0 - joined * joined),
            "{object}: {in_phase} {storage}"
        );
        assert!((ahead - loss).abs() < 0.01 * complex + (1.0 - joined * joined), "{object}: {ahead} {loss}");
    }
}

#[test]
fn a_dent_that_is_left_fades_at_the_time_of_creep() {
    let mode = RelaxationMode { share: 0.4, time_s: 0.2 };
    let setup = Setup {
        modes: &[mode],
        frame_rate_hz: 50.0,
        phases: phases([
            "duration_s = 0.1\ndepth_mm = 0.5",
            "duration_s = 1.0",
            "duration_s = 0.04\ndepth_mm = -0.5",
            "duration_s = 1.0",
        ]),
        ..Setup::default()
    };
    let mut deepest = Vec::new();
    let label = frames(&setup, |sample| {
        deepest.push(f64::from(sample.impression.surface_mm().into_iter().fold(0.0, f32::max)));
    });
    let left = 5 + 50 + 2;
    assert_eq!(label.frames[left].contact.area_mm2, 0.0);
    assert!(label.frames[left].effects[Effect::Deformation].ran, "the dent is shown");
    let dents = &deepest[left..];
    assert!(dents[0] > 0.05 && dents[0] < 0.4, "{}", dents[0]);
    // Without a load the memory fades with the time of creep.
    let time_s = mode.time_s / (1.0 - mode.share);
    let mut off = 0.0_f64;
    for (k, dent) in dents.iter().enumerate().take(40) {
        let expected = dents[0] * (-(k as f64) / 50.0 / time_s).exp();
        off = off.max((dent / expected - 1.0).abs());
    }
    println!("relaxation: a dent of {:.3} mm fades, off by {off:.4}", dents[0]);
    assert!(off < 0.01, "{off}");
}

#[test]
fn twenty_five_frames_a_second_relax_as_well_as_two_hundred() {
    let way = [
        "duration_s = 0.2\ndepth_mm = 0.5",
        "duration_s = 0.2",
        "duration_s = 0.4\nx_mm = 1.6\ntwist_deg = 20.0",
        "duration_s = 0.2\ndepth_mm = 0.2",
        "duration_s = 0.2\nforce_n = 0.5",
        "duration_s = 0.2",
    ];
    let objects = ["sphere", "cube"];
    for &object in if crate::thorough() { &objects[..] } else { &objects[..1] } {
        let at = |rate: f64| label(&Setup { frame_rate_hz: rate, object, phases: phases(way), ..Setup::default() });
        let (coarse, fine) = (at(25.0), at(200.0));
        let largest = fine.frames.iter().map(normal).fold(0.0, f64::max);
        let mut off = [0.0_f64; 2];
        for (k, frame) in coarse.frames.iter().enumerate() {
            let same = &fine.frames[8 * (k + 1) - 1];
            let [here, there] = [frame, same].map(|frame| frame.wrench.force_n);
            off[0] = off[0].max((here[2] - there[2]).abs() / largest);
            off[1] = off[1].max((here[0] - there[0]).hypot(here[1] - there[1]) / (0.4 * largest));
        }
        println!("relaxation: {object}, 25 Hz against 200: force off by {:.4}, friction by {:.4}", off[0], off[1]);
        assert!(off[0] < 0.01 && off[1] < 0.03, "{object}: {off:?}");
        // The wanted force is there at the end of its phase.
        for (label, rate) in [(&coarse, 25.0), (&fine, 200.0)] {
            let found = normal(&label.frames[(1.2 * rate) as usize - 1]);
            assert!((found / 0.5 - 1.0).abs() < 0.005, "{object}: {found} N");
        }
    }
}

#[test]
fn no_path_gains_energy() {
    let mut draw = gelsim_core::base::rng::random_stream(7, "paths", 0);
    let rate = 100.0;
    for path in 0..6 {
        let object = ["sphere", "cylinder", "cube"][path % 3];
        let mut between = |low: f64, high: f64| low + (high - low) * draw.uniform();
        let mut way = vec![String::from("duration_s = 0.05\ndepth_mm = 0.3")];
        for _ in 0..4 {
            let (x, y, depth) = (between(-0.6, 0.6), between(-0.6, 0.6), between(0.05, 0.5));
            let duration = between(0.03, 0.2);
            way.push(format!("duration_s = {duration:?}\nx_mm = {x:?}\ny_mm = {y:?}\ndepth_mm = {depth:?}"));
        }
        way.push(String::from("duration_s = 0.05\ndepth_mm = -0.05"));
        let label = label(&Setup {
            frame_rate_hz: rate,
            object,
            friction: 0.6,
            phases: phases(way.iter().map(String::as_str)),
            ..Setup::default()
        });
        let (mut work, mut heat, mut lowest, mut done) = (0.0, 0.0, 0.0_f64, 0.0_f64);
        let mut last: Option<&FrameLabel> = None;
        for frame in &label.frames {
            let place = |frame: &FrameLabel| frame.pose.translation_mm;
            if let Some(last) = last {
                let by = [0, 1, 2].map(|k| place(frame)[k] - place(last)[k]);
                let force = [0, 1, 2].map(|k| 0.5 * (frame.wrench.force_n[k] + last.wrench.force_n[k]));
                let part: f64 = (0..3).map(|k| by[k] * force[k]).sum();
                work += part;
                done += part.abs();
            }
            heat += frame.slip.dissipated_nmm;
            lowest = lowest.min(work - heat);
            last = Some(frame);
        }
        println!("relaxation: path {path}, {object}: work {work:.4} N mm, heat of slip {heat:.4}, lowest {lowest:.4}");
        assert!(work > heat && lowest > -0.02 * done, "path {path}: {work} {heat} {lowest} of {done}");
    }
}

#[test]
fn a_pad_that_hardly_relaxes_is_an_elastic_one() {
    let way = phases(["duration_s = 0.2\ndepth_mm = 0.5", "duration_s = 0.2\nx_mm = 0.8\ntwist_deg = 10.0"]);
    let hardly = [RelaxationMode { share: 1e-6, time_s: 0.1 }];
    let [elastic, relaxing] =
        [&[][..], &hardly].map(|modes| label(&Setup { modes, phases: way.clone(), ..Setup::default() }));
    for (a, b) in elastic.frames.iter().zip(&relaxing.frames) {
        for k in 0..3 {
            let [a, b] = [a, b].map(|frame| frame.wrench.force_n[k]);
            assert!((a - b).abs() < 2e-3, "{a} {b}");
        }
    }
    let ran = |label: &SequenceLabel| label.frames.iter().filter(|frame| frame.effects[Effect::Relaxation].ran).count();
    assert_eq!([ran(&elastic), ran(&relaxing)], [0, relaxing.frames.len()]);
}

#[test]
fn until_something_loads_the_pad_nothing_runs_and_nothing_differs() {
    let way = phases(["duration_s = 0.2\ndepth_mm = -0.2", "duration_s = 0.2\ndepth_mm = 0.3"]);
    let images = |modes| {
        let mut images = Vec::new();
        let label = frames(&Setup { modes, phases: way.clone(), ..Setup::default() }, |sample| {
            images.push(sample.impression.image.rgb.clone());
        });
        (label, images)
    };
    let ((_, elastic), (label, relaxing)) = (images(&[]), images(&MODES));
    let loaded = label.frames.iter().position(|frame| frame.contact.in_contact).expect("it presses");
    assert!((4..8).contains(&loaded), "{loaded}");
    for (k, frame) in label.frames.iter().enumerate() {
        assert_eq!(frame.effects[Effect::Relaxation].ran, k >= loaded, "{k}");
        assert_eq!(elastic[k] == relaxing[k], k < loaded, "{k}");
    }
}

#[test]
fn hard_cases_stay_finite() {
    let extreme = [RelaxationMode { share: 0.5, time_s: 1e-4 }, RelaxationMode { share: 0.48, time_s: 1e6 }];
    for (modes, rate) in [(&extreme[..], 25.0), (&extreme[..1], 10_000.0), (&MODES[..], 0.5)] {
        let duration = 3.0 / rate;
        let way = [
            format!("duration_s = {duration:?}\ndepth_mm = 1.2"),
            format!("duration_s = {duration:?}\nx_mm = 6.0\ntwist_deg = 120.0"),
            format!("duration_s = {duration:?}\ndepth_mm = -3.0"),
            format!("duration_s = {duration:?}\nx_mm = -12.0\ndepth_mm = 0.001"),
            format!("duration_s = {duration:?}\nx_mm = 5.0\ndepth_mm = 0.5"),
        ];
        let setup = Setup {
            modes,
            frame_rate_hz: rate,
            object: "gear",
            phases: phases(way.iter().map(String::as_str)),
            ..Setup::default()
        };
        frames(&setup, |sample| {
            let deepest = sample.impression.surface_mm().into_iter().map(f32::abs).fold(0.0, f32::max);
            assert!(deepest.is_finite() && deepest < 2.0, "{deepest}");
            assert!(sample.impression.flow_mm().iter().flatten().all(|mm| mm.is_finite() && mm.abs() < 10.0));
        });
    }
}

#[test]
fn impossible_modes_are_explained() {
    let mode = |share, time_s| RelaxationMode { share, time_s };
    for (modes, says) in [
        (vec![mode(0.0, 1.0)], "share of mode 1 is 0"),
        (vec![mode(f64::NAN, 1.0)], "share of mode 1"),
        (vec![mode(0.2, 1.0), mode(0.2, 0.0)], "time of mode 2 is 0"),
        (vec![mode(0.6, 1.0), mode(0.6, 2.0)], "add up to 1.2"),
        (vec![mode(0.1, 1.0); 9], "9 modes"),
    ] {
        let found = RelaxationMode::find_errors(&modes);
        assert!(found.len() == 1 && found[0].contains(says), "{found:?}");
    }
    let found = RelaxationMode::find_errors(&[mode(0.6, 1.0), mode(0.5, 1e9)]);
    assert!(found.len() == 2 && found[0].contains("time of mode 2") && found[1].contains("add up to 1.1"), "{found:?}");
    assert!(RelaxationMode::find_errors(&MODES).is_empty());
    assert!((RelaxationMode::remaining_share(&MODES, 1e9) - 0.5).abs() < 1e-12);
}
