//! Where the effect says that linear theory is within the tolerance, rubber at finite strain differs by no more.

use gelsim_core::base::grid::Resolution;
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::finite_strain::FiniteStrain;
use gelsim_core::gelpad::{Model, Theory};

use crate::physics::rig::{NOTHING, Rig, Setup};
use gelsim_oracle::shapes::Random;

/// What the effect says of a press that it leaves out.
const SMALL: &str = "linear theory is within the tolerance";

/// The models that solve finite strain, and the error that each accepts, um.
fn models() -> [(Model, f64); 2] {
    let elastic = Elastic { resolution: Resolution::Full, strain_correction: true, ..Elastic::default() };
    let own = FiniteStrain::default();
    [(Model::FiniteStrain(own), own.tolerance_um), (Model::Elastic(elastic), 5.0)]
}

fn setup(poisson_ratio: f64) -> Setup {
    Setup { resolution_px: [72, 60], mm_per_px: [0.2; 2], poisson_ratio, ..Setup::default() }
}

/// An object drawn at random: round, oblong, pointed, flat with edges, or tilted; `deep` mm deep.
struct Drawn {
    what: String,
    deep: f64,
    penetration: Box<dyn Fn(f64, f64) -> f64>,
}

fn draw(random: &mut Random, deep: f64) -> Drawn {
    let [x0, y0] = [0; 2].map(|_| random.within(-1.0, 1.0));
    let (sin, cos) = random.within(0.0, 3.2).sin_cos();
    let local = move |x: f64, y: f64| {
        let [u, v] = [x - x0, y - y0];
        [u * cos + v * sin, v * cos - u * sin]
    };
    let (a, b) = (random.within(1.0, 8.0), random.within(1.0, 8.0));
    let slope = random.within(0.05, 0.8);
    let (what, penetration): (_, Box<dyn Fn(f64, f64) -> f64>) = match random.below(6) {
        0 => (
            format!("ball of {a}"),
            Box::new(move |x, y| {
                let [u, v] = local(x, y);
                let left = a * a - u * u - v * v;
                if left > 0.0 { deep - a + left.sqrt() } else { NOTHING }
            }),
        ),
        1 => (
            format!("paraboloid of {a} and {b}"),
            Box::new(move |x, y| {
                let [u, v] = local(x, y);
                deep - 0.5 * (u * u / a + v * v / b)
            }),
        ),
        2 => (
            format!("cone of slope {slope}"),
            Box::new(move |x, y| {
                let [u, v] = local(x, y);
                deep - slope * u.hypot(v)
            }),
        ),
        3 => (
            format!("cylinder of {a}, {b} long"),
            Box::new(move |x, y| {
                let [u, v] = local(x, y);
                let left = a * a - u * u;
                if left > 0.0 && v.abs() < 0.5 * b { deep - a + left.sqrt() } else { NOTHING }
            }),
        ),
        4 => (
            format!("block of {} by {}", 0.5 * a, 0.5 * b),
            Box::new(move |x, y| {
                let [u, v] = local(x, y);
                if u.abs() < 0.25 * a && v.abs() < 0.25 * b { deep } else { NOTHING }
            }),
        ),
        _ => (
            format!("edge of slope {slope}, {b} long"),
            Box::new(move |x, y| {
                let [u, v] = local(x, y);
                deep - slope * u.abs() - 0.5 * (v.abs() - 0.25 * b).max(0.0)
            }),
        ),
    };
    Drawn { what: format!("{what} at {x0} {y0}, {deep} mm deep"), deep, penetration }
}

/// Largest difference of what an effect leaves out, um; `None` where it says otherwise.
fn left_out_um(rig: &Rig, object: &Drawn) -> Option<f64> {
    let depth = rig.depth_in_window(object.deep, &object.penetration);
    let (gated, effects) = rig.press_noted(&depth, EffectPolicy::WhereNeeded);
    let note = &effects.notes[Effect::FiniteStrain];
    if note.reason != SMALL {
        return None;
    }
    assert!(!note.ran && gated.numerics.theory == Theory::Linear, "{}", object.what);
    let (all, effects) = rig.press_noted(&depth, EffectPolicy::All);
    let note = &effects.notes[Effect::FiniteStrain];
    if !note.ran || all.numerics.theory != Theory::FiniteStrain {
        return Some(f64::INFINITY);
    }
    let apart = gated.surface.data.iter().zip(&all.surface.data).map(|(a, b)| f64::from((a - b).abs()));
    Some(1e3 * apart.fold(0.0, f64::max))
}

#[test]
fn what_is_left_out_is_within_the_tolerance() {
    let draws = if crate::thorough() { 60 } else { 24 };
    let mut wrong = Vec::new();
    for poisson_ratio in [0.48, 0.4999] {
        let setup = setup(poisson_ratio);
        let rigs = models().map(|(model, tolerance_um)| (setup.rig_of(&model), tolerance_um));
        let mut random = Random(17);
        let mut left_out = [0; 2];
        for _ in 0..draws {
            let deep = setup.thickness_mm * 10_f64.powf(random.within(-2.0, -1.0));
            let object = draw(&mut random, deep);
            for ((rig, tolerance_um), count) in rigs.iter().zip(&mut left_out) {
                let Some(um) = left_out_um(rig, &object) else { continue };
                *count += 1;
                if um > *tolerance_um {
                    wrong.push(format!("{}, nu {poisson_ratio}: {um:.2} um, tolerance {tolerance_um}", object.what));
                }
            }
        }
        // Fewer at the finer tolerance.
        assert!((draws / 12..left_out[1]).contains(&left_out[0]) && left_out[1] < draws, "{left_out:?} of {draws}");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// At the depth from which on a press is corrected, the surface jumps by what linear theory was off by until then.
#[test]
fn the_surface_jumps_by_no_more_than_the_tolerance_where_the_effect_sets_in() {
    let mut wrong = Vec::new();
    for (model, tolerance_um) in models() {
        let rig = setup(0.48).rig_of(&model);
        for (what, object) in [
            (
                "ball",
                (|x, y, deep| {
                    let left = 16.0 - x * x - y * y;
                    if left > 0.0 { deep - 4.0 + left.sqrt() } else { NOTHING }
                }) as fn(f64, f64, f64) -> f64,
            ),
            ("block", |x, y, deep| if x.abs() < 1.5 && y.abs() < 1.1 { deep } else { NOTHING }),
            ("cone", |x, y, deep| deep - 0.5 * x.hypot(y)),
        ] {
            let press = |deep: f64| {
                let depth = rig.depth_in_window(deep, |x, y| object(x - 0.05, y + 0.03, deep));
                let (contact, effects) = rig.press_noted(&depth, EffectPolicy::WhereNeeded);
                (contact.surface, effects.notes[Effect::FiniteStrain].ran)
            };
            let (mut below, mut above) = (1e-3, 0.9);
            let mut surfaces = [below, above].map(|deep| press(deep).0);
            while above - below > 1e-5 {
                let deep = 0.5 * (below + above);
                let (surface, ran) = press(deep);
                if ran {
                    (above, surfaces[1]) = (deep, surface);
                } else {
                    (below, surfaces[0]) = (deep, surface);
                }
            }
            let [a, b] = &surfaces;
            let jump_um = 1e3 * a.data.iter().zip(&b.data).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
            if f64::from(jump_um) >= tolerance_um || above > 0.8 {
                wrong.push(format!("{what}, {}: {jump_um:.2} um at {above:.4} mm", model.name()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
