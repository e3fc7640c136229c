//! Jobs at random corners of all ranges at once: what no named case has put together.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use gelsim_core::fidelity::Fidelity;

use super::case::{Case, Dress};
use super::sound;
use crate::random_jobs::extremes;
use gelsim_oracle::shapes::{Random, Shape};

fn pick<T: Copy>(random: &mut Random, values: &[T]) -> T {
    values[(random.unit() * values.len() as f64) as usize]
}

fn case(random: &mut Random) -> Case {
    let px = pick(random, &[[1, 1], [2, 1], [3, 5], [24, 18], [7, 64], [61, 1]]);
    let pitch = pick(random, &[1e-5, 1e-3, 0.05, 0.4, 0.4, 10.0, 200.0]);
    let pitches = [pitch, pitch * pick(random, &[1.0, 1.0, 1.0, 0.03, 900.0])];
    let mm_per_px = [0, 1].map(|k| (pitches[k] * f64::from(px[k])).clamp(1e-3, 1e4) / f64::from(px[k]));
    let thickness_mm = pick(random, &[0.01, 0.05, 0.5, 3.0, 3.0, 1000.0]);
    let depth_mm = thickness_mm * pick(random, &[1e-9, 1e-3, 0.1, 0.3, 0.99]);
    let size = (0..2).map(|k| f64::from(px[k]) * mm_per_px[k]).fold(0.0, f64::max);
    let shape = match (random.unit() * 6.0) as u32 {
        0 => Shape::ball(0.3 * size, 24, 12),
        1 => Shape::plate(0.5 * size, 0.5 * size),
        2 => Shape::plate(9.0 * size, 9.0 * size),
        3 => Shape::cap(size, size),
        4 => Shape::tiles(px, mm_per_px, 8, |i, j| {
            (((i * 7 + j * 13) & 3) > 0).then_some(f64::from((i * 5 + j * 3) & 7) * 0.1 * depth_mm)
        }),
        _ => Shape::soup([[[0.0, 0.0, 0.0], [size, 0.1 * size, 0.0], [0.0, size, 0.3 * size]]]),
    };
    let case = Case::new("corner", "").view(px, mm_per_px).pad(thickness_mm, pick(random, &[0.0, 0.3, 0.48, 0.4999]));
    let case = extremes(&mut || random.unit()).into_iter().fold(case, Case::set);
    case.shape(shape).depth(depth_mm)
}

#[test]
fn random_corners_of_all_ranges_give_sound_samples_or_are_refused() {
    let jobs: u64 = if crate::thorough() { 200 } else { 80 };
    let (mut refused, mut wrong, mut slowest) = (0, Vec::new(), (Duration::ZERO, String::new()));
    for number in 0..jobs {
        let mut random = Random(1000 + number);
        let case = case(&mut random);
        let dress = pick(&mut random, &[Dress::Plain, Dress::Still, Dress::Noisy]);
        let (strained, linear) = Fidelity::ALL.split_last().expect("there are levels");
        let level = pick(&mut random, linear);
        let level = if number % 8 == 3 { *strained } else { level };
        let start = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(|| match case.plan(dress) {
            Ok(plan) => sound::check(&plan.with_fidelity(level)).map(|_| false),
            Err(_) => Ok(true),
        }));
        let what = || format!("job {number}, {dress:?}, {}: {case:?}", level.name());
        match outcome {
            Ok(Ok(was_refused)) => refused += u64::from(was_refused),
            Ok(Err(text)) => wrong.push(format!("{text}: {}", what())),
            Err(_) => wrong.push(format!("panicked: {}", what())),
        }
        if start.elapsed() > slowest.0 {
            slowest = (start.elapsed(), what());
        }
    }
    println!(
        "random corners: {jobs} jobs, {refused} refused; the slowest took {} ms: {}",
        slowest.0.as_millis(),
        slowest.1
    );
    assert!(wrong.is_empty(), "{} findings:\n{}", wrong.len(), wrong.join("\n"));
    assert!(refused < jobs / 3, "{refused} of {jobs} jobs were refused");
}
