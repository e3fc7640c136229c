//! Chooses samples that represent a job: every object, pressed gently and deep.

use gelsim_job::plan::Plan;
use gelsim_job::scene::{PressSource, Scene};

/// What decides how much fidelity levels differ on a sample, from its first draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnSample {
    /// Number of the sample.
    pub index: u64,
    /// Number of the object in the plan.
    pub object: usize,
    /// Indentation depth, mm; 0 without contact.
    pub depth_mm: f64,
}

/// Most samples of a job that are drawn.
const MAX_SAMPLES: u64 = 4096;

/// Draws the samples of a plan; of more than 4096, that many spread over them.
pub fn draw_samples(plan: &Plan) -> Vec<DrawnSample> {
    let of = |index| {
        let scene = Scene::draw(plan.for_sample(index, 0), index, 0);
        let object = match scene.pressed {
            PressSource::Object(object) => object,
            // Samples of a job press objects; only depth frames are pressed otherwise.
            PressSource::Frame(_) => 0,
        };
        DrawnSample { index, object, depth_mm: scene.deepest_mm() }
    };
    spread_samples(plan.layout.sample_count(), MAX_SAMPLES).into_iter().map(of).collect()
}

/// Returns `count` numbers below `all`: one in each of `count` equal parts. Offsets by the golden ratio avoid a fixed
/// stride, which would hit the same object again and again where objects come in turn.
pub fn spread_samples(all: u64, count: u64) -> Vec<u64> {
    let count = count.clamp(1, all.max(1));
    let start = |k: u64| (u128::from(k) * u128::from(all) / u128::from(count)) as u64;
    (0..count).map(|k| start(k) + golden_ratio_offset(k, start(k + 1) - start(k))).collect()
}

/// Returns a number below `count` that is evenly distributed over successive `k`.
fn golden_ratio_offset(k: u64, count: u64) -> u64 {
    ((k as f64 * 0.618_033_988_749_894_9).fract() * count as f64) as u64
}

/// Chooses `count` samples (all, if there are fewer), as ascending places in `drawn`. Each object has its share, and at
/// least one while there are enough. Its samples come from as many ranges of depth, and the deepest press of all is
/// among them.
pub fn choose_stratified(drawn: &[DrawnSample], count: usize) -> Vec<usize> {
    let objects = sort_by_depth(drawn);
    let deepest = (0..drawn.len()).max_by(|a, b| drawn[*a].depth_mm.total_cmp(&drawn[*b].depth_mm).then(b.cmp(a)));
    let mut shares = vec![0_usize; objects.len()];
    for _ in 0..count.min(drawn.len()) {
        // Sainte-Laguë's divisors; before them one sample for each object, first for that of the deepest press, then by
        // frequency.
        let claim = |k: usize| {
            let all = objects[k].len();
            let first = objects[k].last().copied() == deepest;
            (shares[k] == 0, shares[k] == 0 && first, all as f64 / (2 * shares[k] + 1) as f64)
        };
        let open = (0..objects.len()).filter(|k| shares[*k] < objects[*k].len());
        let next = open.max_by(|a, b| {
            let (a_claims, b_claims) = (claim(*a), claim(*b));
            let by_need = (a_claims.0, a_claims.1).cmp(&(b_claims.0, b_claims.1));
            by_need.then(a_claims.2.total_cmp(&b_claims.2)).then(b.cmp(a))
        });
        next.into_iter().for_each(|k| shares[k] += 1);
    }
    let mut chosen = Vec::new();
    for (k, (samples, share)) in objects.iter().zip(&shares).enumerate() {
        let start = |range: usize| range * samples.len() / share;
        for range in 0..*share {
            let depth_range = start(range)..start(range + 1);
            let at = depth_range.start + golden_ratio_offset((k + range) as u64, depth_range.len() as u64) as usize;
            let holds_deepest = samples[depth_range.clone()].last().copied() == deepest;
            chosen.push(if holds_deepest { samples[depth_range.end - 1] } else { samples[at] });
        }
    }
    chosen.sort_unstable();
    chosen
}

/// Returns the place in `drawn` of each object's deepest press.
pub fn find_deepest_of_each(drawn: &[DrawnSample]) -> Vec<usize> {
    sort_by_depth(drawn).iter().filter_map(|samples| samples.last().copied()).collect()
}

/// Groups places in `drawn` by object, each sorted from the gentlest press to the deepest. Of equally deep presses the
/// first counts as the deepest.
fn sort_by_depth(drawn: &[DrawnSample]) -> Vec<Vec<usize>> {
    let objects = drawn.iter().map(|sample| sample.object + 1).max().unwrap_or(0);
    let mut of = vec![Vec::new(); objects];
    for (at, sample) in drawn.iter().enumerate() {
        of[sample.object].push(at);
    }
    of.retain(|samples| !samples.is_empty());
    for samples in &mut of {
        samples.sort_by(|a, b| drawn[*a].depth_mm.total_cmp(&drawn[*b].depth_mm).then(b.cmp(a)));
    }
    of
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    /// Sample k of a job with objects in turn.
    fn job(samples: u64, objects: usize) -> Vec<DrawnSample> {
        let depth_mm = |index: u64| 0.1 + golden_ratio_offset(index, 1000) as f64 * 1e-3;
        (0..samples)
            .map(|index| DrawnSample { index, object: index as usize % objects, depth_mm: depth_mm(index) })
            .collect()
    }

    proptest! {
        #[test]
        fn every_object_and_the_deepest_press_are_among_them(
            samples in 1_u64..300, objects in 1_usize..20, count in 1_usize..60,
        ) {
            let drawn = job(samples, objects);
            let chosen = choose_stratified(&drawn, count);
            prop_assert_eq!(chosen.len(), count.min(drawn.len()));
            prop_assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]), "{:?}", chosen);
            let there: BTreeSet<usize> = drawn.iter().map(|sample| sample.object).collect();
            let seen: BTreeSet<usize> = chosen.iter().map(|at| drawn[*at].object).collect();
            prop_assert_eq!(seen.len(), there.len().min(count));
            let deepest = |of: &mut dyn Iterator<Item = &DrawnSample>| of.map(|sample| sample.depth_mm).fold(0.0, f64::max);
            let of_all = deepest(&mut drawn.iter());
            prop_assert_eq!(deepest(&mut chosen.iter().map(|at| &drawn[*at])), of_all);
        }

        #[test]
        fn numbers_are_spread_over_all(all in 1_u64..2_000_000_000, count in 1_u64..40) {
            let found = spread_samples(all, count);
            let count = count.min(all);
            prop_assert_eq!(found.len() as u64, count);
            for (part, index) in (0..count).zip(found) {
                prop_assert!((part * all / count..(part + 1) * all / count).contains(&index), "{} in part {}", index, part);
            }
        }
    }

    #[test]
    fn of_an_object_depths_are_taken_from_every_range() {
        let drawn = job(400, 4);
        for object in 0..4 {
            let chosen = choose_stratified(&drawn, 16);
            let mut depths: Vec<f64> =
                chosen.iter().map(|at| &drawn[*at]).filter(|s| s.object == object).map(|s| s.depth_mm).collect();
            depths.sort_by(f64::total_cmp);
            assert_eq!(depths.len(), 4);
            for (range, depth) in depths.iter().enumerate() {
                let (low, high) = (0.1 + 0.25 * range as f64, 0.35 + 0.25 * range as f64);
                assert!((low - 0.02..high + 0.02).contains(depth), "{depth} in range {range} of object {object}");
            }
        }
        let deepest = find_deepest_of_each(&drawn);
        assert_eq!(deepest.len(), 4);
        for at in deepest {
            assert!(drawn.iter().all(|s| s.object != drawn[at].object || s.depth_mm <= drawn[at].depth_mm));
        }
    }

    #[test]
    fn frequent_objects_get_more() {
        let drawn: Vec<DrawnSample> = (0..100)
            .map(|index| DrawnSample { index, object: usize::from(index % 10 == 0), depth_mm: index as f64 })
            .collect();
        let rare = choose_stratified(&drawn, 20).iter().filter(|at| drawn[**at].object == 1).count();
        assert_eq!(rare, 2);
    }
}
