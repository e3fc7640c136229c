//! Friction with history: against Cattaneo, Mindlin and Deresiewicz, Lubkin and Kalker on a pad much thicker than the contact,
//! against a plain descent with matrices, and where nothing may get lost over many steps.

use std::f64::consts::PI;

use gelsim_core::base::grid::Grid;
use gelsim_core::gelpad::elastic::friction_history::{
    ContactForces, FrameMotion, FrictionHistory, StepOutcome, StepPressure,
};
use gelsim_core::gelpad::elastic::in_plane::Load;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::gelpad::material::Material;

use gelsim_oracle::in_plane::displacement_by_fourier_sums;
use gelsim_oracle::shapes::Random;

/// Of a ball of radius 1 mm, the side of the pressure's box, mm.
const BOX_MM: f64 = 2.4;

fn layer(thickness_mm: f64, poisson_ratio: f64) -> ElasticLayer {
    ElasticLayer::new(&Material { thickness_mm, poisson_ratio, youngs_modulus_kpa: 100.0 })
}

/// Hertz' pressure of a ball of radius 1 mm whose contact has the radius `a`, means over pixels, around `middle_mm`.
fn hertz(pixels: usize, pitch: f64, a: f64, nu: f64, middle_mm: f64) -> Load {
    const PARTS: usize = 8;
    let shift = (middle_mm / pitch).round() * pitch;
    let start = shift - 0.5 * (pixels - 1) as f64 * pitch;
    let mut pressure = Grid::new(pixels, pixels);
    let part = |at: usize| ((at as f64 + 0.5) / PARTS as f64 - 0.5) * pitch;
    for y in 0..pixels {
        for x in 0..pixels {
            let mut sum = 0.0;
            for k in 0..PARTS * PARTS {
                let at_x = start + x as f64 * pitch + part(k % PARTS) - middle_mm;
                let at_y = start - shift + y as f64 * pitch + part(k / PARTS);
                sum += (a * a - at_x * at_x - at_y * at_y).max(0.0).sqrt();
            }
            let mean = sum / (PARTS * PARTS) as f64;
            pressure.row_mut(y)[x] = (2.0 / (PI * (1.0 - nu * nu)) * mean) as f32;
        }
    }
    Load { pressure, origin_mm: [start, start - shift], mm_per_px: [pitch; 2] }
}

fn force(load: &Load) -> f64 {
    load.pressure.data.iter().map(|p| f64::from(*p)).sum::<f64>() * load.mm_per_px[0] * load.mm_per_px[1]
}

fn along(x: f64) -> FrameMotion {
    FrameMotion { shift_mm: [x, 0.0], turn_rad: 0.0 }
}

/// An even pressure on a disc of radius 1 mm.
fn punch(pixels: usize, pitch: f64) -> Load {
    let start = -0.5 * (pixels - 1) as f64 * pitch;
    let inside = |at: usize| (start + (at % pixels) as f64 * pitch).hypot(start + (at / pixels) as f64 * pitch) < 1.0;
    let data = (0..pixels * pixels).map(|at| if inside(at) { 0.5 } else { 0.0 }).collect();
    let pressure = Grid { width: pixels, height: pixels, data };
    Load { pressure, origin_mm: [start; 2], mm_per_px: [pitch; 2] }
}

/// By how much less than a half-space a layer moves under a unit force, 1/mm over Young's modulus.
pub fn stiffer(layer: ElasticLayer, nu: f64) -> f64 {
    let h = layer.thickness_mm;
    let value = |q: f64| {
        q * (2.0 * (2.0 - nu) * (1.0 + nu) / q - layer.tangential_compliance(q) - layer.transverse_compliance(q))
    };
    let (end, count) = (30.0 / h, 3000);
    let sum: f64 = (0..count).map(|k| value((k as f64 + 0.5) / count as f64 * end)).sum();
    sum * end / count as f64 / (4.0 * PI)
}

/// Where `of`, which grows, is `wanted`.
pub fn solve(of: impl Fn(f64) -> f64, wanted: f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if of(middle) < wanted { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Steps of `by` along x, `count` of them; what `each` makes of the step, the sums after it and its number.
fn step_along(history: &mut FrictionHistory, by: f64, count: usize, mut each: impl FnMut(StepOutcome, ContactForces)) {
    for _ in 0..count {
        let step = history.step(&StepPressure::Unchanged, along(by));
        assert!(step.solver.converged, "{step:?}");
        each(step, history.contact_forces());
    }
}

#[test]
fn a_ball_that_is_pushed_out_back_and_out_again_follows_mindlin_and_deresiewicz() {
    let (mu, h, top, nu) = (0.5, 5.0, 0.8, 0.0);
    let layer = layer(h, nu);
    for (pixels, within, of_radius) in [(24, 3e-3, 0.05), (36, 2e-3, 0.03)] {
        let pitch = BOX_MM / pixels as f64;
        let load = hertz(pixels, pitch, 1.0, nu, 0.0);
        let normal = force(&load);
        let (soft, stiff) = (3.0 * mu * normal * (2.0 - nu) * (1.0 + nu) / 8.0, stiffer(layer, nu));
        let virgin = |x: f64| 1.0 - (1.0 - x).max(0.0).powf(2.0 / 3.0);
        let back = |x: f64| virgin(top) - 2.0 * virgin((top - x) / 2.0);
        let again = |x: f64| 2.0 * virgin((top + x) / 2.0) - virgin(top);
        let path = |law: &dyn Fn(f64) -> f64, x: f64| soft * law(x) - stiff * x * mu * normal;

        let mut history = FrictionHistory::new(layer, mu, [pitch; 2], 1e-4);
        history.step(&StepPressure::Load(&load), FrameMotion::default());
        let far = path(&virgin, top);
        let (mut d, mut worst, mut heat, mut iterations) = (0.0_f64, 0.0_f64, 0.0, 0);
        let mut radius = 0.0;
        let laws: [&dyn Fn(f64) -> f64; 3] = [&virgin, &back, &again];
        for (leg, (to, count)) in [(far, 20), (-far, 40), (far, 40)].into_iter().enumerate() {
            let law = laws[leg];
            let by = (to - d) / count as f64;
            step_along(&mut history, by, count, |step, sums| {
                d += by;
                let x = solve(|x| path(law, x), d, -top - 1e-6, 1.0);
                worst = worst.max((sums.force[0] / (mu * normal) - x).abs());
                heat += if leg > 0 { step.heat } else { 0.0 };
                iterations += step.solver.iterations;
                if leg == 0 {
                    radius = (step.sticking as f64 * pitch * pitch / PI).sqrt();
                }
            });
        }
        let parts = 4000;
        let gap: f64 = (0..parts)
            .map(|k| ((k as f64 + 0.5) / parts as f64 * 2.0 - 1.0) * top)
            .map(|x| (again(x) - back(x)) * 2.0 * top / parts as f64)
            .sum();
        // The area between both branches, force over path.
        let loop_heat = -gap * soft * mu * normal;
        let off_radius = radius - (1.0 - top).cbrt();
        println!(
            "history: {pixels} px: force off by {worst:.1e} of mu N, stick radius by {off_radius:+.3} of the contact's, heat of \
             a loop {:.4}, {:.1} iterations a step",
            heat / loop_heat,
            f64::from(iterations) / 100.0
        );
        assert!(worst < within, "{worst}");
        assert!(off_radius.abs() < of_radius, "{off_radius}");
        assert!((heat / loop_heat - 1.0).abs() < 0.02, "{heat} of {loop_heat}");
        assert!(f64::from(iterations) / 100.0 < 12.0, "{iterations} iterations");
    }
}

#[test]
fn a_ball_that_is_turned_follows_lubkin() {
    let (nu, h, pixels) = (0.48, 10.0, 64);
    let pitch = BOX_MM / pixels as f64;
    let load = hertz(pixels, pitch, 1.0, nu, 0.0);
    let normal = force(&load);
    let turned = |coefficient: f64, turn_rad: f64| {
        let mut history = FrictionHistory::new(layer(h, nu), coefficient, [pitch; 2], 1e-6);
        history.step(&StepPressure::Load(&load), FrameMotion::default());
        let step = history.step(&StepPressure::Unchanged, FrameMotion { shift_mm: [0.0; 2], turn_rad });
        assert!(step.solver.converged, "{step:?}");
        (history.contact_forces().moment, step.gross)
    };
    // Over Young's modulus: G = 1 / (2 (1 + nu)).
    let (stuck, slips) = turned(1e3, 1e-3);
    let stuck = stuck / (16.0 / 3.0 * 0.5 / (1.0 + nu) * 1e-3);
    let (gross, all_slip) = turned(0.001, 0.05);
    let gross = gross / (3.0 * PI / 16.0 * 0.001 * normal);
    println!("history: torsion {stuck:.3} of 16 G a^3 / 3, {gross:.4} of 3 pi mu N a / 16");
    // The pixels that touch reach half a pixel further than the contact.
    assert!(!slips && (1.0..1.06).contains(&stuck), "{stuck}");
    assert!(all_slip && (gross - 1.0).abs() < 2e-3, "{gross}");
}

#[test]
fn whatever_is_turned_far_enough_is_held_by_friction_times_its_mean_radius() {
    let pixels = 40;
    let pitch = BOX_MM / pixels as f64;
    let mut random = Random(11);
    let mut tried = 0;
    for (object, load) in [("ball", hertz(pixels, pitch, 1.0, 0.48, 0.0)), ("punch", punch(pixels, pitch))] {
        for (h, nu) in [(0.8, 0.48), (3.0, 0.48), (3.0, 0.3), (10.0, 0.48)] {
            // Every coefficient, or one in each pad.
            let coefficients = [0.3, 1.0, 2.0];
            tried += 1;
            let own = if crate::thorough() { &coefficients[..] } else { &coefficients[tried % 3..][..1] };
            for &mu in own {
                let mut most = 0.0;
                for (at, p) in load.pressure.data.iter().enumerate() {
                    let place = |k: usize| load.origin_mm[0] + k as f64 * pitch;
                    most += mu * f64::from(*p) * place(at % pixels).hypot(place(at / pixels)) * pitch * pitch;
                }
                let mut history = FrictionHistory::new(layer(h, nu), mu, [pitch; 2], 1e-4);
                history.step(&StepPressure::Load(&load), FrameMotion::default());
                // It was pushed aside before.
                let by = random.within(-0.2, 0.2);
                let mut heat = history.step(&StepPressure::Unchanged, along(by)).heat;
                let sums = history.contact_forces();
                let (mut work, mut last) = (by * sums.force[0], sums.moment);
                let turn_rad = 4.0_f64.to_radians();
                for k in 0..270 {
                    let step = history.step(&StepPressure::Unchanged, FrameMotion { shift_mm: [0.0; 2], turn_rad });
                    assert!(step.solver.converged, "{step:?}");
                    let moment = history.contact_forces().moment;
                    work += 0.5 * (last + moment) * turn_rad;
                    heat += step.heat;
                    last = moment;
                    assert!(heat <= work + 1e-3 * most, "{object} {h} {nu} {mu} {k}: {heat} of {work}");
                }
                let sums = history.contact_forces();
                let (share, pulled) = (sums.moment / most, sums.force[0].hypot(sums.force[1]) / (mu * sums.normal));
                println!("history: {object}, h {h}, nu {nu}, mu {mu}: {share:.4} of the torque, {pulled:.4} of mu N");
                assert!((share - 1.0).abs() < 5e-3 && pulled < 0.01, "{object} {h} {nu} {mu}: {share} {pulled}");
            }
        }
    }
}

#[test]
fn work_becomes_heat_on_any_path() {
    let pixels = 32;
    let pitch = BOX_MM / pixels as f64;
    let mut random = Random(7);
    let (mut above, mut below) = (0.0_f64, 0.0_f64);
    for number in 0..if crate::thorough() { 24 } else { 8 } {
        let (nu, mu) = (random.within(0.2, 0.499), 0.2 * 10_f64.powf(random.within(0.0, 1.0)));
        let h = random.within(0.8, 8.0);
        let round = number % 2 == 0;
        // At nu 0.5 a thick pad moves along itself under no pressure: that motion feeds on the work of pressing.
        let (nu, h) = if number % 3 == 0 { (0.4999, 12.0) } else { (nu, h) };
        let load = |a: f64, at: f64| if round { hertz(pixels, pitch, a, nu, at) } else { punch(pixels, pitch) };
        let mut history = FrictionHistory::new(layer(h, nu), mu, [pitch; 2], 1e-5);
        let (mut a, mut rolled) = (if round { 0.8 } else { 1.0 }, 0.0);
        history.step(&StepPressure::Load(&load(a, rolled)), FrameMotion::default());
        let (mut work, mut heat) = (0.0_f64, 0.0_f64);
        let mut last = ContactForces::default();
        let mut advance = |history: &mut FrictionHistory, next: Option<&Load>, moved: FrameMotion| {
            let normal = next.map_or(StepPressure::Unchanged, StepPressure::Load);
            let step = history.step(&normal, moved);
            let sums = history.contact_forces();
            // Forces before and after, along the axes half way, on the way of the frame's origin.
            let turned = |[x, y]: [f64; 2], angle: f64| {
                let (sin, cos) = angle.sin_cos();
                [cos * x - sin * y, sin * x + cos * y]
            };
            let half = 0.5 * moved.turn_rad;
            let (before, after) = (turned(last.force, -half), turned(sums.force, half));
            let way = turned(moved.shift_mm, -half);
            work += (0..2).map(|k| 0.5 * (before[k] + after[k]) * way[k]).sum::<f64>();
            work += 0.5 * (last.moment + sums.moment) * moved.turn_rad;
            heat += step.heat;
            last = sums;
            [work, heat]
        };
        let mut sums = [0.0; 2];
        for _ in 0..8 {
            let steps = 40;
            let (shift, turn) = ([random.within(-1.0, 1.0), random.within(-1.0, 1.0)], random.within(-1.0, 1.0));
            let kind = (random.within(0.0, 4.0) as u32).min(3);
            let (from, to) = (a, random.within(0.6, 1.1));
            let roll =
                if number % 3 == 0 && round { (random.within(-0.04, 0.04) - rolled).clamp(-0.04, 0.04) } else { 0.0 };
            for k in 1..=steps {
                let moves = |it: bool| if it { 1.0 / f64::from(steps) } else { 0.0 };
                let moved = FrameMotion {
                    shift_mm: shift.map(|mm| moves(kind == 0 || kind == 2) * mm),
                    turn_rad: moves(kind == 1 || kind == 2) * turn,
                };
                let next = (kind == 3 && number % 3 == 0).then(|| {
                    a = from + (to - from) * f64::from(k) / f64::from(steps);
                    load(a, rolled + roll * f64::from(k) / f64::from(steps))
                });
                sums = advance(&mut history, next.as_ref(), moved);
                let [work, heat] = sums;
                // What is stored is left over.
                below = below.min((work - heat) / work.max(1e-2));
            }
            rolled += if kind == 3 { roll } else { 0.0 };
        }
        let [work, heat] = sums;
        let heat = heat + history.step(&StepPressure::NoContact, FrameMotion::default()).heat;
        let over = heat / work - 1.0;
        println!("history: path {number}, h {h:.2}, nu {nu:.3}, mu {mu:.2}: heat is {:+.2} % off work", 100.0 * over);
        above = above.max(over.abs());
    }
    println!(
        "history: heat and work of all paths: at most {:.2} % apart, never {:.2} % above",
        100.0 * above,
        -100.0 * below
    );
    assert!(above < 5e-3 && below > -5e-3, "{above} {below}");
}

#[test]
fn a_rolling_ball_creeps_as_kalker_says() {
    // Full stick in steady rolling of a rigid ball, nu .5: Q = creep 2 G a^2 C11 along and C22 across (Kalker 1967). There
    // pressure alone moves nothing in the plane, as Kalker has it.
    let (nu, pixels) = (0.4999, 48);
    let pitch = BOX_MM / pixels as f64;
    let shear = 0.5 / (1.0 + nu);
    for (k, truth, per_step) in [(0, 5.20, 1.0), (1, 3.98, 1.0)] {
        // It rolls along x: the contact goes on, the pad's points stay; creep drags them.
        let steps = (6.0 / (per_step * pitch)) as usize;
        let pulled = |creep: f64| {
            let mut history = FrictionHistory::new(layer(12.0, nu), 50.0, [pitch; 2], 1e-6);
            for step in 0..steps {
                let at = step as f64 * per_step * pitch;
                let mut shift_mm = [0.0; 2];
                shift_mm[k] = if step == 0 { 0.0 } else { creep * per_step * pitch };
                history.step(
                    &StepPressure::Load(&hertz(pixels, pitch, 1.0, nu, at)),
                    FrameMotion { shift_mm, turn_rad: 0.0 },
                );
            }
            history.contact_forces().force[k]
        };
        // Less what a pad of finite thickness pushes aside under the pressure alone.
        let creep = 1e-3;
        let found = (pulled(creep) - pulled(0.0)) / (creep * 2.0 * shear) / truth;
        println!("history: rolling, {per_step} px a step, creep along {}: {found:.3} of Kalker's", ["x", "y"][k]);
        assert!((found - 1.0).abs() < 0.03, "{found}");
    }
}

#[test]
fn loads_that_grow_keep_tractions_and_slow_motion_loses_none() {
    let (nu, pixels) = (0.0, 64);
    let pitch = 2.9 / pixels as f64;
    let small = hertz(pixels, pitch, 1.0, nu, 0.0);
    let pushed = |steps: usize| {
        let mut history = FrictionHistory::new(layer(10.0, nu), 0.5, [pitch; 2], 1e-5);
        history.step(&StepPressure::Load(&small), FrameMotion::default());
        step_along(&mut history, 0.3 / steps as f64, steps, |_, _| ());
        history
    };
    let mut history = pushed(10);
    let before = history.contact_forces().force[0];
    for a in [1.05, 1.1, 1.15, 1.2] {
        let step = history.step(&StepPressure::Load(&hertz(pixels, pitch, a, nu, 0.0)), FrameMotion::default());
        assert!(!step.gross, "{a}: {step:?}");
    }
    let after = history.contact_forces();
    let grown = after.force[0] / before - 1.0;
    println!("history: a load that grows by 73 %: force changes by {grown:.1e}");
    // What the pressure itself pushes aside is 0 in sum; at nu 0 it is little.
    assert!(grown.abs() < 2e-2, "{grown}");
    let slow = pushed(400).contact_forces().force[0] / before - 1.0;
    println!("history: 400 steps of 0.75 um against 10 of 30 um: force off by {slow:.1e}");
    assert!(slow.abs() < 2e-3, "{slow}");
    // Falling loads: all slips in the end, and force is mu N.
    for k in 1..=18 {
        let a = 1.2 - 0.05 * f64::from(k);
        history.step(&StepPressure::Load(&hertz(pixels, pitch, a, nu, 0.0)), FrameMotion::default());
    }
    let sums = history.contact_forces();
    assert!(sums.force[0] <= 0.5 * sums.normal * 1.0001 && sums.force[0] > 0.3 * sums.normal, "{sums:?}");
}

#[test]
fn a_thousand_steps_to_and_fro_drift_nowhere_and_make_heat() {
    let (nu, pixels) = (0.48, 40);
    let pitch = BOX_MM / pixels as f64;
    let load = hertz(pixels, pitch, 1.0, nu, 0.0);
    for (amplitude, coefficient) in [(0.08, 0.5), (0.4, 0.5), (0.08, 10.0)] {
        let mut history = FrictionHistory::new(layer(3.0, nu), coefficient, [pitch; 2], 1e-3);
        history.step(&StepPressure::Load(&load), FrameMotion::default());
        let (mut peaks, mut least) = (Vec::new(), 0.0_f64);
        for k in 0..1000 {
            let at = |k: i32| (f64::from(k) * PI / 20.0).sin();
            let step = history.step(&StepPressure::Unchanged, along(amplitude * (at(k + 1) - at(k))));
            assert!(step.solver.converged, "{step:?}");
            least = least.min(step.heat);
            if k % 40 == 9 {
                peaks.push(history.contact_forces().force[0]);
            }
        }
        let drift = peaks.iter().skip(1).map(|peak| (peak / peaks[1] - 1.0).abs()).fold(0.0, f64::max);
        println!(
            "history: to and fro by {amplitude} mm, mu {coefficient}: force drifts by {drift:.1e}, least heat {least:.1e}"
        );
        assert!(drift < 1e-4, "{drift}");
        assert!(least > -1e-6 * force(&load) * amplitude, "heat {least}");
    }
}

#[test]
fn turning_the_frame_and_moving_the_box_change_nothing() {
    let (nu, pixels, mu) = (0.3, 32, 0.4);
    let pitch = BOX_MM / pixels as f64;
    let load = hertz(pixels, pitch, 1.0, nu, 0.0);
    // The same motion, one with the frame turned by a right angle before.
    let run = |turned: bool| {
        let mut history = FrictionHistory::new(layer(3.0, nu), mu, [pitch; 2], 1e-6);
        history.step(&StepPressure::Load(&load), FrameMotion::default());
        for k in 0..8 {
            let shift_mm = if turned { [0.0, -0.02] } else { [0.02, 0.0] };
            history.step(&StepPressure::Unchanged, FrameMotion { shift_mm, turn_rad: 0.01 * f64::from(k % 2) });
        }
        history.contact_forces()
    };
    let (a, b) = (run(false), run(true));
    assert!((a.force[0] + b.force[1]).abs() < 1e-4 * a.force[0], "{a:?} {b:?}");
    assert!((a.force[1] - b.force[0]).abs() < 1e-4 * a.force[0], "{a:?} {b:?}");
    assert!((a.moment - b.moment).abs() < 1e-4 * a.force[0], "{a:?} {b:?}");
    // A contact that leaves its box takes all along.
    let mut history = FrictionHistory::new(layer(3.0, nu), mu, [pitch; 2], 1e-6);
    history.step(&StepPressure::Load(&load), FrameMotion::default());
    history.step(&StepPressure::Unchanged, along(0.05));
    let before = history.contact_forces();
    let mut wide = hertz(4 * pixels, pitch, 1.0, nu, 0.0);
    let far = 4 * pixels - 2;
    wide.pressure.row_mut(far)[far] = 1e-9;
    history.step(&StepPressure::Load(&wide), FrameMotion::default());
    let after = history.contact_forces();
    assert!((after.force[0] / before.force[0] - 1.0).abs() < 1e-3, "{before:?} {after:?}");
}

#[test]
fn hard_cases_stay_finite() {
    let pitch = 0.1;
    let one = |p: f32| Load {
        pressure: Grid { width: 1, height: 1, data: vec![p] },
        origin_mm: [0.05; 2],
        mm_per_px: [pitch; 2],
    };
    let wall = Load {
        pressure: Grid { width: 40, height: 1, data: (0..40).map(|k| if k % 7 == 0 { 0.0 } else { 3.0 }).collect() },
        origin_mm: [-1.95, 0.05],
        mm_per_px: [pitch; 2],
    };
    let nothing = Load { pressure: Grid::default(), origin_mm: [0.0; 2], mm_per_px: [pitch; 2] };
    for coefficient in [0.0, 1e-6, 0.5, 10.0, f64::INFINITY] {
        for (h, nu) in [(0.01, 0.4999), (0.3, 0.48), (3.0, 0.0), (50.0, 0.4999)] {
            let mut history = FrictionHistory::new(layer(h, nu), coefficient, [pitch; 2], 1e-3);
            let loads = [&one(1.0), &wall, &one(1e-20), &one(1e6), &wall, &nothing, &wall];
            for (k, load) in loads.into_iter().enumerate() {
                let normal =
                    if load.pressure.data.is_empty() { StepPressure::NoContact } else { StepPressure::Load(load) };
                history.step(&normal, FrameMotion { shift_mm: [0.3, -0.1 * k as f64], turn_rad: 0.05 });
                let step =
                    history.step(if k == 5 { &StepPressure::NoContact } else { &StepPressure::Unchanged }, along(0.2));
                let sums = history.contact_forces();
                let largest = if coefficient.is_finite() { coefficient * sums.normal } else { f64::MAX };
                let length = sums.force[0].hypot(sums.force[1]);
                assert!(
                    length.is_finite() && length <= largest * (1.0 + 1e-5) + 1e-30,
                    "{coefficient} {h} {nu}: {sums:?}"
                );
                assert!(step.heat.is_finite() && step.slip_mm.iter().all(|mm| mm.is_finite()), "{step:?}");
                assert!(step.solver.residual_mm.is_finite(), "{coefficient} {h} {nu} {k}: {step:?}");
                assert!((step.touching == 0) == (k == 5), "{k}: {step:?}");
            }
        }
    }
}

/// The same law in plain matrices: in every step each pixel's traction in turn goes where it alone would, within its limit,
/// until none moves (Gauss and Seidel, projected).
struct Plain {
    pixels: usize,
    pitch: f64,
    coefficient: f64,
    /// Displacement at a lag, by a unit traction along x and along y.
    response: [[Grid<f64>; 2]; 2],
    layer: ElasticLayer,
    pressure: Vec<f64>,
    tractions: Vec<[f64; 2]>,
    hold: Vec<[f64; 2]>,
    free: Vec<[f64; 2]>,
}

impl Plain {
    fn new(layer: ElasticLayer, coefficient: f64, pixels: usize, pitch: f64) -> Self {
        let side = 2 * pixels - 1;
        let nothing = Grid::new(side, side);
        let mut unit = nothing.clone();
        unit.row_mut(pixels - 1)[pixels - 1] = 1.0;
        let room = 8.0 * layer.thickness_mm;
        let response = [[&nothing, &unit, &nothing], [&nothing, &nothing, &unit]]
            .map(|load| displacement_by_fourier_sums(layer, load, [pitch; 2], room));
        let count = pixels * pixels;
        Self {
            pixels,
            pitch,
            coefficient,
            response,
            layer,
            pressure: vec![0.0; count],
            tractions: vec![[0.0; 2]; count],
            hold: vec![[0.0; 2]; count],
            free: vec![[0.0; 2]; count],
        }
    }

    fn between(&self, to: usize, from: usize, axis: usize, by: usize) -> f64 {
        let lag = |a: usize, b: usize| a + self.pixels - 1 - b;
        let (x, y) = (lag(to % self.pixels, from % self.pixels), lag(to / self.pixels, from / self.pixels));
        self.response[by][axis].at(x, y)
    }

    fn place(&self, at: usize) -> [f64; 2] {
        [at % self.pixels, at / self.pixels].map(|k| (k as f64 - 0.5 * (self.pixels - 1) as f64) * self.pitch)
    }

    fn step(&mut self, load: &Load, shift: [f64; 2], turn: f64) {
        let (sin, cos) = turn.sin_cos();
        let back = |[x, y]: [f64; 2]| [cos * x + sin * y, cos * y - sin * x];
        // Weighted with the pressure so far.
        let total: f64 = self.pressure.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mean = |of: &dyn Fn(usize) -> [f64; 2]| {
            let sum = |k: usize| self.pressure.iter().enumerate().map(|(at, p)| p * of(at)[k]).sum::<f64>() / total;
            [sum(0), sum(1)]
        };
        let centre = mean(&|at| self.place(at));
        let force = self.tractions.iter().fold([0.0; 2], |sum, t| [sum[0] + t[0], sum[1] + t[1]]);
        let square = (force[0] * force[0] + force[1] * force[1]).max(f64::MIN_POSITIVE);
        let whole = mean(&|at| self.hold[at]);
        let carried = force.map(|part| (whole[0] * force[0] + whole[1] * force[1]) / square * part);
        let nothing = Grid::new(self.pixels, self.pixels);
        let pushed = displacement_by_fourier_sums(
            self.layer,
            [&load.pressure, &nothing, &nothing],
            [self.pitch; 2],
            8.0 * self.layer.thickness_mm,
        );
        let count = self.pressure.len();
        let free: Vec<[f64; 2]> = (0..count).map(|at| [0, 1].map(|k| pushed[k].data[at])).collect();
        let anchor: Vec<[f64; 2]> = (0..count)
            .map(|at| {
                let place = self.place(at);
                let (shift, turned, kept) = (back(shift), back(centre), back(carried));
                let wound = [-turn * (place[1] - centre[1]), turn * (place[0] - centre[0])];
                [0, 1].map(|k| self.hold[at][k] + kept[k] - carried[k] + shift[k] + centre[k] - turned[k] + wound[k])
            })
            .collect();
        let limit: Vec<f64> = (0..count)
            .map(|at| {
                let p = f64::from(load.pressure.data[at]);
                if p > 0.0 && self.pressure[at] > 0.0 { self.coefficient * p } else { 0.0 }
            })
            .collect();
        let own = self.between(0, 0, 0, 0);
        let held = |t: [f64; 2], limit: f64| {
            let long = t[0].hypot(t[1]);
            if long > limit { t.map(|part| part * limit / long) } else { t }
        };
        let acts: Vec<usize> = (0..count).filter(|at| limit[*at] > 0.0).collect();
        (0..count).for_each(|at| self.tractions[at] = held(self.tractions[at], limit[at]));
        for _ in 0..3000 {
            let mut most = 0.0_f64;
            for &to in &acts {
                let moved: [f64; 2] = std::array::from_fn(|k| {
                    let of = |&from: &usize| {
                        let t = self.tractions[from];
                        t[0] * self.between(to, from, k, 0) + t[1] * self.between(to, from, k, 1)
                    };
                    acts.iter().map(of).sum()
                });
                let t = self.tractions[to];
                let next = held([0, 1].map(|k| t[k] + (anchor[to][k] - free[to][k] - moved[k]) / own), limit[to]);
                most = most.max(own * (next[0] - t[0]).hypot(next[1] - t[1]));
                self.tractions[to] = next;
            }
            if most < 1e-9 {
                break;
            }
        }
        for at in 0..count {
            let t = self.tractions[at];
            let stuck = limit[at] > 0.0 && t[0].hypot(t[1]) < limit[at] * (1.0 - 1e-9);
            self.hold[at] = if stuck {
                anchor[at]
            } else {
                std::array::from_fn(|k| {
                    let of = |&from: &usize| {
                        let t = self.tractions[from];
                        t[0] * self.between(at, from, k, 0) + t[1] * self.between(at, from, k, 1)
                    };
                    free[at][k] + acts.iter().map(of).sum::<f64>()
                })
            };
        }
        self.free = free;
        self.pressure = load.pressure.data.iter().map(|p| f64::from(*p)).collect();
    }

    fn sums(&self) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (at, t) in self.tractions.iter().enumerate() {
            let [x, y] = self.place(at);
            sums[0] += t[0];
            sums[1] += t[1];
            sums[2] += x * t[1] - y * t[0];
        }
        sums.map(|sum| sum * self.pitch * self.pitch)
    }
}

#[test]
fn pressing_pushing_around_a_corner_turning_and_lifting_agree_with_plain_matrices() {
    let (pixels, pitch) = (14, 0.18);
    for (h, nu, mu) in [(3.0, 0.48, 0.5), (1.0, 0.3, 0.2), (3.0, 0.48, 2.0)] {
        let mut plain = Plain::new(layer(h, nu), mu, pixels, pitch);
        let mut history = FrictionHistory::new(layer(h, nu), mu, [pitch; 2], 1e-6);
        let (mut worst, mut normal) = (0.0_f64, 0.0_f64);
        let legs = [
            (0.5, 1.0, [0.0; 2], 0.0),
            (1.0, 1.0, [0.05, 0.0], 0.0),
            (1.0, 1.0, [0.0, 0.06], 0.03),
            (1.0, 0.6, [0.0; 2], -0.04),
        ];
        for (from, to, shift, turn) in legs {
            for k in 1..=4 {
                let a = from + (to - from) * f64::from(k) / 4.0;
                let load = hertz(pixels, pitch, a, nu, 0.0);
                plain.step(&load, shift, turn);
                let step = history.step(&StepPressure::Load(&load), FrameMotion { shift_mm: shift, turn_rad: turn });
                assert!(step.solver.converged, "{step:?}");
                normal = normal.max(force(&load));
                let (sums, truth) = (history.contact_forces(), plain.sums());
                let found = [sums.force[0], sums.force[1], sums.moment];
                for (found, truth) in found.iter().zip(truth) {
                    worst = worst.max((found - truth).abs() / (mu * normal));
                }
            }
        }
        println!("history: h {h}, nu {nu}, mu {mu}: force and moment off plain matrices by {worst:.1e} of mu N");
        assert!(worst < 1e-3, "{worst}");
    }
}
