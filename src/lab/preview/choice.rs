//! Which samples of a dataset a sheet shows: from every split and class in proportion to its size, spread over the
//! dataset. The same dataset gives the same samples.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

use serde::Deserialize;

use gelsim_dataset::archive::SampleFiles;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_job::label::sample_key;
use gelsim_job::layout::{Layout, Shard, Split};

/// Least number of labels of a split that are read to find its classes.
const MIN_LABELS: u64 = 300;
/// Most shards of a split that are read for them.
const MAX_SHARDS: u64 = 16;

/// Samples that a sheet of a dataset shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleChoice {
    /// Numbers of samples, ascending.
    pub samples: Vec<u64>,
    /// Shards that do not exist; no sample is chosen from them.
    pub missing: Vec<Shard>,
}

/// Chooses `count` samples, or all if there are fewer, from the shards that exist. An error says what cannot be read.
pub fn choose_spread_samples(dataset: &RecordedDataset, count: u64) -> Result<SampleChoice, String> {
    let layout = &dataset.layout;
    let all = (0..layout.shard_count()).map(|number| layout.shard(number));
    let (shards, missing): (Vec<Shard>, Vec<Shard>) = all.partition(|shard| dataset.shard_paths(shard).data.exists());
    if shards.iter().map(|shard| shard.samples).sum::<u64>() <= count {
        let mut samples: Vec<u64> = shards.iter().flat_map(|shard| layout.sample_indices(*shard)).collect();
        samples.sort_unstable();
        return Ok(SampleChoice { samples, missing });
    }
    let of_splits = Split::ALL.map(|split| {
        let of_split = |shard: &&Shard| shard.split == split;
        shards.iter().filter(of_split).copied().collect::<Vec<_>>()
    });
    let candidates = of_splits.each_ref().map(|shards| collect_candidates(layout, shards, MIN_LABELS.max(4 * count)));
    let classed = candidates.iter().map(|shards| read_classes(dataset, shards)).collect::<Result<Vec<_>, _>>()?;
    let sizes = of_splits.map(|shards| shards.iter().map(|shard| shard.samples).sum());
    Ok(SampleChoice { samples: choose_candidates(&classed, sizes, count), missing })
}

/// Picks about `count` samples of a split, evenly spread over some of its shards. Returns them by shard.
fn collect_candidates(layout: &Layout, of_split: &[Shard], count: u64) -> Vec<(Shard, BTreeSet<u64>)> {
    let all = of_split.len() as u64;
    let each = count.div_ceil(MAX_SHARDS.min(all).max(1));
    let of_shard = |shard: Shard| {
        let picks =
            spread_evenly(shard.samples, each).map(|at| layout.index_of(shard.split, shard.first_position + at));
        (shard, picks.collect())
    };
    spread_evenly(all, MAX_SHARDS).map(|at| of_shard(of_split[at as usize])).collect()
}

/// Returns `count` numbers below `all`, evenly spread, or all of them if there are fewer.
fn spread_evenly(all: u64, count: u64) -> impl Iterator<Item = u64> {
    let count = count.min(all);
    // The middles of `count` equal parts, in 128 bits because the product may be larger than a u64.
    (0..count).map(move |i| (u128::from(2 * i + 1) * u128::from(all) / u128::from(2 * count)) as u64)
}

/// Reads the class of each candidate of a split, in the order of their numbers.
fn read_classes(dataset: &RecordedDataset, shards: &[(Shard, BTreeSet<u64>)]) -> Result<Vec<(u64, String)>, String> {
    let mut found = Vec::new();
    for (shard, picks) in shards {
        let (keys, mut wrong): (BTreeSet<String>, _) = (picks.iter().copied().map(sample_key).collect(), None);
        let before = found.len();
        let visit = |files: SampleFiles| {
            let read = files.key.parse().ok().zip(files.find_member("json"));
            match read.map(|(index, json)| (index, serde_json::from_slice::<ClassLabel>(json))) {
                Some((index, Ok(label))) => found.push((index, label.object.class)),
                Some((_, Err(error))) => wrong = Some(format!("{}.json: {error}", files.key)),
                None => wrong = Some(format!("{}.json: is not in the shard", files.key)),
            }
            if wrong.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let read = dataset.visit_samples(shard, |head| head.suffix == "json" && keys.contains(head.key), visit);
        let read = read.and_then(|()| wrong.map_or(Ok(()), Err));
        let read = read.and_then(|()| match found.len() - before {
            count if count == picks.len() => Ok(()),
            count => Err(format!("{} of its samples are not in it", picks.len() - count)),
        });
        read.map_err(|reason| format!("{}: {reason}", dataset.shard_paths(shard).data.display()))?;
    }
    found.sort_unstable();
    Ok(found)
}

/// The part of a label that says its class.
#[derive(Deserialize)]
struct ClassLabel {
    object: NamedClass,
}

#[derive(Deserialize)]
struct NamedClass {
    class: String,
}

/// Chooses `count` of the candidates. They and the `sizes` are ordered by split.
fn choose_candidates(candidates: &[Vec<(u64, String)>], sizes: [u64; 3], count: u64) -> Vec<u64> {
    let seats = allocate_seats(sizes, count);
    // Expected number of samples of each class, estimated from the candidates.
    let mut shares: BTreeMap<&str, f64> = BTreeMap::new();
    for (split, size) in candidates.iter().zip(sizes) {
        for (_, class) in split {
            *shares.entry(class).or_default() += size as f64 / split.len() as f64;
        }
    }
    let all: f64 = shares.values().sum();
    let mut missing: BTreeMap<&str, f64> =
        shares.into_iter().map(|(class, share)| (class, share / all * count as f64)).collect();
    // Small splits first: a large split can make up for the classes that a small one lacks.
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by_key(|split| sizes[*split]);
    let mut picked = Vec::new();
    for split in order {
        let (mut left, wanted) = (candidates[split].iter().collect::<Vec<_>>(), seats[split]);
        for seat in 0..wanted {
            // Take the class that is missing most, and of its samples the one nearest to the seat's place in the split.
            let most = left.iter().map(|(_, class)| missing[class.as_str()]).fold(f64::NEG_INFINITY, f64::max);
            let here = (2 * seat + 1) as f64 / (2 * wanted) as f64 * candidates[split].len() as f64;
            let position = |index: u64| candidates[split].partition_point(|(other, _)| *other < index) as f64;
            let of_class = left.iter().enumerate().filter(|(_, (_, class))| missing[class.as_str()] >= most);
            let far = |index: u64| (position(index) + 0.5 - here).abs();
            let Some((at, _)) = of_class.min_by(|(_, a), (_, b)| far(a.0).total_cmp(&far(b.0))) else { break };
            let (index, class) = left.remove(at);
            *missing.get_mut(class.as_str()).expect("a candidate's class") -= 1.0;
            picked.push(*index);
        }
    }
    picked.sort_unstable();
    picked
}

/// Allocates `count` places to the splits (Sainte-Laguë). Each gets at least one while there are as many, and none more
/// than it has samples.
fn allocate_seats(sizes: [u64; 3], count: u64) -> [u64; 3] {
    let splits = sizes.iter().filter(|size| **size > 0).count() as u64;
    let mut seats = if count >= splits { sizes.map(|size| size.min(1)) } else { [0; 3] };
    while seats.iter().sum::<u64>() < count {
        let open = (0..sizes.len()).filter(|split| seats[*split] < sizes[*split]);
        // The split with the highest quotient size / (2 seats + 1), the first of equal ones; compared as products,
        // without rounding.
        let more = |a: &usize, b: &usize| {
            let product = |one: usize, other: usize| u128::from(sizes[one]) * u128::from(2 * seats[other] + 1);
            product(*a, *b).cmp(&product(*b, *a)).then(b.cmp(a))
        };
        let Some(next) = open.max_by(more) else { break };
        seats[next] += 1;
    }
    seats
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_job::config::dataset::Splits;

    #[test]
    fn splits_get_their_share_and_none_is_left_out() {
        assert_eq!(allocate_seats([210, 30, 60], 12), [9, 1, 2]);
        assert_eq!(allocate_seats([2100, 300, 600], 30), [21, 3, 6]);
        assert_eq!(allocate_seats([980, 10, 10], 12), [10, 1, 1]);
        assert_eq!(allocate_seats([980, 10, 10], 2), [2, 0, 0]);
        assert_eq!(allocate_seats([5, 0, 3], 6), [4, 0, 2]);
        assert_eq!(allocate_seats([2, 1, 1], 12), [2, 1, 1]);
    }

    /// Indices and classes of the samples of a split.
    type OfSplit = Vec<(u64, String)>;

    /// Samples of three splits with `classes` in turn.
    fn dataset(splits: Splits, samples: u64, classes: &[&str]) -> (Layout, Vec<OfSplit>, [u64; 3]) {
        let layout = Layout::new(samples, 100, splits);
        let class = |index: u64| classes[index as usize * 7 % classes.len()].to_owned();
        let of_split = |split| (0..layout.samples_in(split)).map(|at| layout.index_of(split, at)).collect::<Vec<_>>();
        let all = Split::ALL.map(|split| of_split(split).into_iter().map(|index| (index, class(index))).collect());
        let sizes = Split::ALL.map(|split| layout.samples_in(split));
        (layout, all.to_vec(), sizes)
    }

    #[test]
    fn every_split_and_class_is_shown_as_often_as_it_is_there() {
        let splits = Splits { train: 0.7, val: 0.1, test: 0.2 };
        let (layout, all, sizes) = dataset(splits, 3000, &["a", "b", "c", "d", "d"]);
        for count in [12, 24, 30, 48] {
            let picked = choose_candidates(&all, sizes, count);
            assert_eq!(picked.len() as u64, count);
            assert_eq!(picked.iter().collect::<BTreeSet<_>>().len() as u64, count, "no sample twice");
            let of = |wanted: &str| {
                let class =
                    |index: &&u64| all.iter().flatten().any(|(other, class)| other == *index && class == wanted);
                picked.iter().filter(class).count() as f64
            };
            for (class, share) in [("a", 0.2), ("b", 0.2), ("c", 0.2), ("d", 0.4)] {
                assert!((of(class) - share * count as f64).abs() <= 1.0, "{class}: {} of {count}", of(class));
            }
            let in_split = |split| picked.iter().filter(|index| layout.split_of(**index).0 == split).count() as u64;
            assert_eq!(Split::ALL.map(in_split), allocate_seats(sizes, count));
            let half = picked.iter().filter(|index| **index < 1500).count() as f64;
            assert!((half - count as f64 / 2.0).abs() <= 0.2 * count as f64, "{half} of {count} in the first half");
        }
        assert_eq!(choose_candidates(&all, sizes, 12), choose_candidates(&all, sizes, 12));
    }

    #[test]
    fn classes_of_a_split_alone_are_shown_from_it() {
        let (_, mut all, sizes) = dataset(Splits { train: 0.8, val: 0.1, test: 0.1 }, 1000, &["a", "b"]);
        all[2].iter_mut().for_each(|(_, class)| *class = String::from("only in test"));
        let picked = choose_candidates(&all, sizes, 12);
        let from_test = picked.iter().filter(|index| all[2].iter().any(|(other, _)| other == *index)).count();
        assert_eq!((picked.len(), from_test), (12, 1));
    }

    #[test]
    fn candidates_are_spread_over_the_shards_of_a_split() {
        let layout = Layout::new(100_000, 100, Splits { train: 0.8, val: 0.1, test: 0.1 });
        let all: Vec<Shard> = (0..layout.shard_count()).map(|number| layout.shard(number)).collect();
        let found = collect_candidates(&layout, &all[..800], 300);
        assert_eq!(found.len(), 16);
        assert!(found.iter().all(|(shard, picks)| shard.split == Split::Train && picks.len() == 19));
        assert_eq!([found[0].0.number, found[15].0.number], [25, 775]);
        assert_eq!(
            collect_candidates(&layout, &all[..2], 300).iter().map(|(_, picks)| picks.len()).sum::<usize>(),
            200
        );
        assert!(collect_candidates(&layout, &[], 300).is_empty());
    }
}
