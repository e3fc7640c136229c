//! Presses made by formulas of their own are recovered: Hertz on a thick pad, Lee and Radok in closed form, Mindlin.

use std::fmt::Write;
use std::path::Path;

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::fit::{ElasticFit, NoRelaxation, fit};
use super::friction::{FrictionFit, fit as fit_friction};
use super::motion::Motions;
use super::{judge, table};
use gelsim_core::gelpad::material::Material;

/// So thick, under so large a ball, that the formula of Hertz holds within some 0.1 %.
const PAD: Material = Material { thickness_mm: 20_000.0, youngs_modulus_kpa: 1.0, poisson_ratio: 0.48 };
const MODULUS_KPA: f64 = 150.0;
const BALL_MM: f64 = 50.0;

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let [a, b]: [f64; 2] = [rng.random(), rng.random()];
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Force of a press whose elastic force grows linearly for `rise_s` and is then held, N: so depth goes with time to the
/// power 2/3.
fn ramp_force(t: f64, rise_s: f64, largest_n: f64, modes: &[[f64; 2]]) -> f64 {
    let rising = t.min(rise_s);
    let lost: f64 = modes
        .iter()
        .map(|[share, tau]| {
            // The integral of 1 - exp(-(t - s) / tau) over s from 0 to `rising`.
            share * (rising - tau * ((-(t - rising) / tau).exp() - (-t / tau).exp()))
        })
        .sum();
    largest_n * (rising - lost) / rise_s
}

/// Ten motions: noise of each row and of each press, relative.
fn ten_presses(seed: u64, modes: &[[f64; 2]], row_noise: f64, press_noise: f64, zero_mm: f64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut text = String::from("press,ball_radius_mm,depth_mm,force_n,time_s\n");
    for press in 0..10 {
        let deepest_mm = 0.3 + 0.05 * f64::from(press);
        let rise_s = 0.2 + 0.08 * f64::from(press % 4);
        let plane = 1e-3 * MODULUS_KPA / (1.0 - 0.48 * 0.48);
        let largest_n = 4.0 / 3.0 * plane * BALL_MM.sqrt() * deepest_mm.powf(1.5);
        let factor = 1.0 + press_noise * normal(&mut rng);
        for k in 0..=60 {
            let t = if k <= 20 { rise_s * f64::from(k) / 20.0 } else { rise_s * 1.15_f64.powi(k - 20) };
            let depth_mm = deepest_mm * (t / rise_s).min(1.0).powf(2.0 / 3.0) + zero_mm;
            let force_n = factor * ramp_force(t, rise_s, largest_n, modes) * (1.0 + row_noise * normal(&mut rng));
            writeln!(text, "p{press},{BALL_MM},{depth_mm},{force_n},{t}").expect("a string");
        }
    }
    text
}

fn motions(text: &str) -> Motions {
    Motions::new(&table::parse(Path::new("t.csv"), text.as_bytes()).expect("a table"), PAD)
}

fn fitted(text: &str, fits_zero: bool) -> ElasticFit {
    fit(&motions(text), fits_zero)
}

#[test]
fn modulus_and_relaxation_of_ten_motions_are_recovered() {
    for (seed, modes) in [(1, vec![[0.3, 1.5]]), (2, vec![[0.25, 0.3], [0.2, 8.0]])] {
        let motions = motions(&ten_presses(seed, &modes, 0.02, 0.0, 0.0));
        let found = fit(&motions, false);
        let modulus = found.solution.youngs_modulus_kpa;
        assert!((modulus / MODULUS_KPA - 1.0).abs() < 0.01, "{modulus}");
        assert_eq!(found.solution.relaxation.len(), modes.len());
        for (mode, [share, tau]) in found.solution.relaxation.iter().zip(&modes) {
            assert!((mode.share / share - 1.0).abs() < 0.05, "{mode:?}");
            assert!((mode.time_s / tau - 1.0).abs() < 0.05 * modes.len() as f64, "{mode:?}");
        }
        let findings = judge::judge_fit(&motions, &found).0;
        assert!(findings.is_empty(), "{findings:?}");
    }
}

#[test]
fn elastic_pads_get_no_relaxation_and_tables_without_times_say_so() {
    let elastic = fitted(&ten_presses(3, &[], 0.02, 0.01, 0.0), false);
    assert_eq!(elastic.no_relaxation, Some(NoRelaxation::NotFound));
    let text = ten_presses(3, &[], 0.02, 0.01, 0.0);
    let untimed: String = text.lines().map(|line| line.rsplit_once(',').expect("cells").0.to_owned() + "\n").collect();
    let untimed = fitted(&untimed, false);
    assert_eq!(untimed.no_relaxation, Some(NoRelaxation::NoTimes));
    assert!((untimed.solution.youngs_modulus_kpa / MODULUS_KPA - 1.0).abs() < 0.015);
}

#[test]
fn errors_cover_the_truth_in_most_draws_and_a_seed_gives_the_same_bits() {
    let modes = [[0.3, 1.5]];
    let (mut modulus, mut share) = (0, 0);
    // Draws differ in their forces alone, so that the contacts are solved once.
    let mut motions = motions(&ten_presses(100, &modes, 0.02, 0.03, 0.0));
    for seed in 0..30 {
        let text = ten_presses(100 + seed, &modes, 0.02, 0.03, 0.0);
        let drawn = table::parse(Path::new("t.csv"), text.as_bytes()).expect("a table");
        for (motion, press) in motions.motions.iter_mut().zip(&drawn.presses) {
            motion.moments.iter_mut().zip(&press.rows).for_each(|(moment, row)| moment.force_n = row.force_n);
        }
        let found = fit(&motions, false);
        let off =
            |value: f64, truth: f64, error: Option<f64>| (value - truth).abs() < 2.0 * error.expect("ten presses");
        modulus += usize::from(off(found.values[0], MODULUS_KPA, found.standard_error(0)));
        share += usize::from(found.values.len() > 1 && off(found.values[1], 0.3, found.standard_error(1)));
    }
    assert!(modulus >= 25 && share >= 24, "{modulus} {share}");
    assert_eq!(fit(&motions, true).values, fit(&motions, true).values);
}

#[test]
fn an_unknown_zero_of_the_depth_is_found_with_its_error() {
    let found = fitted(&ten_presses(11, &[[0.3, 1.5]], 0.02, 0.01, 0.04), true);
    assert!((found.solution.zero_mm + 0.04).abs() < 0.005, "{:?}", found.solution);
    assert!((found.solution.youngs_modulus_kpa / MODULUS_KPA - 1.0).abs() < 0.04);
    assert!(found.standard_error_of("zero_mm").is_some_and(|error| error > 0.0 && error < 0.01));
}

fn slides(seed: u64, coefficient: f64, furthest: f64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut text = String::from("press,ball_radius_mm,depth_mm,force_n,shear_mm,shear_force_n\n");
    for press in 0..5 {
        let depth_mm = 0.3 + 0.08 * f64::from(press);
        let force_n = 4.0 / 3.0 * 1e-3 * MODULUS_KPA / (1.0 - 0.48 * 0.48) * BALL_MM.sqrt() * depth_mm.powf(1.5);
        let stiffness = 4e-3 * MODULUS_KPA * (BALL_MM * depth_mm).sqrt() / (1.48 * 1.52);
        for k in 0..40 {
            let shear_mm = furthest * f64::from(k) / 39.0;
            let stuck = (1.0 - stiffness * shear_mm / (1.5 * coefficient * force_n)).max(0.0);
            let shear_n = coefficient * force_n * (1.0 - stuck.powf(1.5)) * (1.0 + 0.02 * normal(&mut rng));
            writeln!(text, "s{press},{BALL_MM},{depth_mm},{force_n},{shear_mm},{shear_n}").expect("a string");
        }
    }
    text
}

#[test]
fn friction_of_slides_is_recovered_and_contacts_that_stick_give_a_lower_bound() {
    let FrictionFit::Found(found) = fit_friction(&motions(&slides(5, 0.7, 1.5)), 0.0) else { panic!("slides") };
    assert!((found.coefficient / 0.7 - 1.0).abs() < 0.03, "{}", found.coefficient);
    assert!(found.standard_error.is_some_and(|error| error > 0.0 && error < 0.05));
    assert!(judge::judge_friction(&FrictionFit::Found(found)).0.is_empty());
    let stuck = fit_friction(&motions(&slides(5, 3.0, 0.3)), 0.0);
    assert!(matches!(stuck, FrictionFit::AtLeast { coefficient, .. } if coefficient < 3.0), "{stuck:?}");
    let without = slides(5, 0.7, 1.5).replace("shear_mm", "other");
    let FrictionFit::Found(found) = fit_friction(&motions(&without), 0.0) else { panic!("plateaus") };
    assert!((found.coefficient / 0.7 - 1.0).abs() < 0.05 && !found.has_displacements, "{found:?}");
}

#[test]
fn presses_that_cannot_tell_are_refused_and_doubtful_ones_named() {
    let good = ten_presses(1, &[], 0.02, 0.01, 0.0);
    let head = good.lines().next().expect("a head");
    let only = |names: &[&str]| {
        let kept = good.lines().filter(|line| names.iter().any(|name| line.starts_with(&format!("{name},"))));
        [head].into_iter().chain(kept).collect::<Vec<_>>().join("\n")
    };
    let pad = |thickness_mm: f64| Material { thickness_mm, ..PAD };
    let judged = |text: &str, material: Material, zero: bool| {
        let table = table::parse(Path::new("t.csv"), text.as_bytes()).expect("a table");
        let found = judge::judge_presses(&Motions::new(&table, material), zero);
        let texts: Vec<String> = found.0.iter().map(|finding| finding.message.clone()).collect();
        (found.are_hopeless(), texts.join("\n"))
    };
    let hopeless = |text: &str, material: Material, zero: bool, words: &str| {
        let (hopeless, said) = judged(text, material, zero);
        assert!(hopeless && said.contains(words), "{words}: {said}");
    };
    assert_eq!(judged(&good, PAD, false), (false, String::new()));
    hopeless(&only(&["p1", "p2"]), PAD, false, "2 of the 3 presses");
    // Balls a tenth as large: in thin pads contacts as wide as theirs take long to solve.
    let small = good.replace(&format!(",{BALL_MM},"), ",5,");
    hopeless(&small, pad(1.0), false, "linear theory does not hold");
    let (bad, said) = judged(&small, pad(2.0), false);
    assert!(!bad && said.contains("some 10 % off"), "{said}");
    let flat = "press,ball_radius_mm,depth_mm,force_n\na,5,0.3,1\nb,5,0.31,1.1\nc,5,0.3,1\n";
    hopeless(flat, PAD, true, "cannot tell a wrong zero");
    assert!(judged(flat, PAD, false).1.contains("would not be noticed"));
    hopeless("ball_radius_mm,depth_mm,force_n\n5,0,0\n5,0,0\n5,0,0\n", PAD, false, "nothing is pressed");
    hopeless("ball_radius_mm,depth_mm,force_n\n5,0.1,3\n5,0.2,2\n5,0.4,1\n", PAD, false, "smaller forces");
    let falling = "press,ball_radius_mm,depth_mm,force_n\na,5,0.1,1\na,5,0.2,2\na,5,0.4,0.5\nb,5,0.3,2\nc,5,0.2,1\n";
    assert!(judged(falling, PAD, false).1.contains("falls while it goes deeper"));
    let radii = "ball_radius_mm,depth_mm,contact_radius_mm,force_n\n5,0.1,2,1\n5,0.2,2.5,2\n5,0.4,3,5\n";
    hopeless(radii, PAD, false, "times as wide as its depth");
    hopeless("punch_radius_mm,contact_radius_mm,depth_mm,force_n\n5,5,0.1,1\n", PAD, false, "of the 3 presses");
    let units = motions("ball_radius_mm,depth_mm,force_n\n5,0.1,3000\n5,0.2,9000\n5,0.4,25000\n");
    assert!(judge::judge_fit(&units, &fit(&units, false)).are_hopeless(), "newtons that are millinewtons");
    let outlier = good.lines().map(|line| match line.strip_prefix("p3,") {
        Some(rest) => {
            let cells: Vec<&str> = rest.split(',').collect();
            let force: f64 = cells[2].parse().expect("a force");
            format!("p3,{},{},{},{}", cells[0], cells[1], 1.6 * force, cells[3])
        }
        None => line.to_owned(),
    });
    let outlier = fitted(&outlier.collect::<Vec<_>>().join("\n"), false);
    let names: Vec<String> = judge::find_outliers(&outlier).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["p3"]);
}

#[test]
fn odd_numbers_give_figures_or_findings_and_no_nan() {
    for text in [
        "ball_radius_mm,depth_mm,force_n\n5,1e-9,1e9\n5,1e8,1e-9\n5,0.4,1\n",
        "ball_radius_mm,depth_mm,force_n\n0.01,1,1\n1000,2,1\n5,0.4,1\n",
        "press,ball_radius_mm,depth_mm,force_n,time_s\na,5,0,0,0\na,5,0,0,1e-9\nb,5,0,1,-1e9\nb,5,1,1,1e9\nc,5,0,0,0\n",
        "ball_radius_mm,depth_mm,force_n,shear_mm,shear_force_n\n5,0.3,0,1,1\n5,0.4,1,0,0\n5,0,1,1,-1\n",
        "punch_radius_mm,depth_mm,force_n\n5,0.3,0\n5,0.4,0\n5,0.5,0\n",
    ] {
        for (zero, thickness_mm) in [(false, 3.0), (true, 3.0), (true, 0.01)] {
            let table = table::parse(Path::new("t.csv"), text.as_bytes()).expect("a table");
            let motions = Motions::new(&table, Material { thickness_mm, ..PAD });
            let _ = judge::judge_presses(&motions, zero);
            let found = fit(&motions, zero);
            let friction = fit_friction(&motions, found.solution.zero_mm);
            let _ = (judge::judge_fit(&motions, &found), judge::judge_friction(&friction));
            let lines = super::report::summarise(&motions, &found, &friction);
            assert!(lines.iter().all(|(_, figure)| !figure.contains("NaN") && !figure.contains("inf")), "{lines:?}");
            let html = super::page::to_html("x", &motions, &found, &lines, &[]);
            assert!(!html.contains("NaN") && !html.contains("inf\""));
            assert!(found.values.iter().all(|value| value.is_finite()), "{text}: {:?}", found.values);
        }
    }
}
