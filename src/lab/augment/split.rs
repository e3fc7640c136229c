//! Which split a real sample is in: the input's, or one of new ones that keep together what belongs together.

use std::collections::HashMap;

use super::config::SplitBy;
use super::input::Set;
use super::input::columns::Meaning;
use crate::core::base::rng::stream;
use crate::job::config::dataset::Splits;
use crate::job::layout::Split;

/// The splits of an output.
#[derive(Clone, Debug, PartialEq)]
pub struct Division {
    /// Their names.
    pub names: Vec<String>,
    /// Number of each real sample's.
    pub of_reals: Vec<usize>,
    /// True if they are not the input's.
    pub anew: bool,
    /// True if they are not the input's and each is in files or folders of its own.
    pub apart: bool,
    /// Number of the split in which all samples of an object are, by its name; where objects are kept together.
    pub homes: Option<HashMap<String, usize>>,
}

impl Division {
    /// The input's own splits.
    pub fn kept(set: &Set, by: Option<SplitBy>) -> Self {
        let of_reals = set.reals.iter().map(|real| real.split).collect();
        let mut division = Self { names: set.splits.clone(), of_reals, anew: false, apart: false, homes: None };
        division.homes = division.find_homes(set, by);
        division
    }

    /// New splits with these fractions of the samples. Groups come in an order drawn from the seed, each goes to the
    /// split that is furthest behind its fraction; larger ones first, so that small ones even it out.
    pub fn drawn(set: &Set, fractions: Splits, by: SplitBy, seed: u64) -> Self {
        let fractions = [fractions.train, fractions.val, fractions.test];
        let used: Vec<usize> = (0..fractions.len()).filter(|&k| fractions[k] > 0.0).collect();
        let names = used.iter().map(|&k| Split::ALL[k].name().to_owned()).collect();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut numbers: HashMap<String, usize> = HashMap::new();
        for (index, real) in set.reals.iter().enumerate() {
            let name = match by {
                SplitBy::Sample => None,
                SplitBy::Group => real.facts.group.clone(),
                SplitBy::Object => real.facts.object.clone().or_else(|| real.facts.class.clone()),
            };
            // Of what no group is known is a group of its own.
            let name = name.unwrap_or_else(|| format!("\0{index}"));
            let number = *numbers.entry(name).or_insert(groups.len());
            match groups.get_mut(number) {
                Some(group) => group.push(index),
                None => groups.push(vec![index]),
            }
        }
        let mut random = stream(seed, "regroup", 0);
        for last in (1..groups.len()).rev() {
            groups.swap(last, random.below(last + 1));
        }
        groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
        let mut given = vec![0_usize; used.len()];
        let mut of_reals = vec![0; set.reals.len()];
        for group in &groups {
            let behind = |k: &usize| fractions[used[*k]] * set.reals.len() as f64 - given[*k] as f64;
            // The first of equals: train before val before test.
            let next = (0..used.len()).rev().max_by(|a, b| behind(a).total_cmp(&behind(b))).unwrap_or(0);
            given[next] += group.len();
            group.iter().for_each(|&index| of_reals[index] = next);
        }
        let mut division = Self { names, of_reals, anew: true, apart: apart(set), homes: None };
        division.homes = division.find_homes(set, Some(by));
        division
    }

    fn find_homes(&self, set: &Set, by: Option<SplitBy>) -> Option<HashMap<String, usize>> {
        let facts = set.reals.iter().zip(&self.of_reals);
        (by == Some(SplitBy::Object)).then(|| {
            let mut homes = HashMap::new();
            for (real, split) in facts {
                for name in [&real.facts.object, &real.facts.class].into_iter().flatten() {
                    homes.entry(name.clone()).or_insert(*split);
                }
            }
            homes
        })
    }

    /// Real samples in each split.
    pub fn counts(&self) -> Vec<u64> {
        let mut counts = vec![0; self.names.len()];
        self.of_reals.iter().for_each(|split| counts[*split] += 1);
        counts
    }

    /// True if a synthetic sample of this object may be in a split: where objects are kept together it goes where the
    /// object's real samples are, and one that has none to the split for training.
    pub fn takes(&self, split: usize, object: &str, class: &str) -> bool {
        match &self.homes {
            None => true,
            Some(homes) => homes.get(object).or_else(|| homes.get(class)).copied().unwrap_or(self.training()) == split,
        }
    }

    /// The split for training: the one that is called so, else the first.
    fn training(&self) -> usize {
        self.names.iter().position(|name| name.starts_with("train")).unwrap_or(0)
    }
}

/// True if new splits of a set are files or folders of their own: of tars, of folders whose names tell their splits, and
/// of an imagefolder without a column for them.
fn apart(set: &Set) -> bool {
    let column = set.columns.name(Meaning::Split).is_some();
    set.in_tars() || set.split_by_unit || set.is_imagefolder() && !column
}
