//! Which split a real sample is in: the input's, or one of new ones that keep together what belongs together; and which
//! splits get what is made.

use std::collections::HashMap;

use super::config::{Augment, SplitBy};
use super::input::columns::Meaning;
use super::input::{Layout, Set};
use gelsim_core::base::rng::stream;
use gelsim_files::spelling::{nearest, one_of};
use gelsim_job::config::dataset::Splits;
use gelsim_job::layout::Split;
use gelsim_job::plan::check::Check;

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

    /// Objects and classes that are kept together in a split, sorted.
    pub fn objects_in(&self, split: usize) -> Vec<String> {
        let homes = self.homes.iter().flatten().filter(|(_, home)| **home == split);
        let mut names: Vec<String> = homes.map(|(name, _)| name.clone()).collect();
        names.sort();
        names
    }

    /// The split for training: the one that is called so, else the first.
    fn training(&self) -> usize {
        self.names.iter().position(|name| is_for_training(name)).unwrap_or(0)
    }

    /// True if the samples are divided at all.
    pub fn is_divided(&self) -> bool {
        self.names.iter().any(|name| !name.is_empty())
    }
}

fn is_for_training(name: &str) -> bool {
    name.to_ascii_lowercase().starts_with("train")
}

/// For each table that makes samples, which splits get them. What is evaluated on stays real unless somebody says otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recipients {
    /// Of the copies of each `[[photometric]]` table.
    pub photometric: Vec<Vec<bool>>,
    /// Of simulated counterparts.
    pub paired: Vec<bool>,
    /// Of synthetic samples.
    pub mixing: Vec<bool>,
}

impl Recipients {
    /// As the tables' `splits` say, else the splits for training; all samples of a set that is not divided.
    pub fn find(check: &mut Check<'_>, written: &Augment, division: &Division) -> Self {
        let copies = written.photometric.iter().enumerate();
        let copies = copies.map(|(k, table)| (format!("photometric.{k}"), table.splits.as_deref()));
        let paired = written.paired.iter().map(|table| (String::from("paired"), table.splits.as_deref()));
        let mixing = written.mixing.iter().map(|table| (String::from("mixing"), table.splits.as_deref()));
        let tables: Vec<(String, Option<&[String]>)> = copies.chain(paired).chain(mixing).collect();
        let training: Vec<bool> =
            division.names.iter().map(|name| is_for_training(name) || !division.is_divided()).collect();
        if let Some((table, _)) = tables.iter().find(|(_, splits)| splits.is_none())
            && !training.contains(&true)
        {
            let names: Vec<&str> = division.names.iter().map(String::as_str).collect();
            let message = format!("no split is for training, and only there samples are added: {}", there_are(&names));
            let help = format!(
                "say in [[photometric]], [paired] and [mixing] which splits get new samples, for example splits = [{:?}]; a \
                 split for training is called train",
                names.iter().find(|name| !name.is_empty()).unwrap_or(&"")
            );
            check.error(table, message, help);
        }
        let mut of_tables = tables.iter().map(|(table, splits)| match splits {
            Some(splits) => named(check, table, splits, division),
            None => training.clone(),
        });
        let photometric = of_tables.by_ref().take(written.photometric.len()).collect();
        let mut next = |table: bool| table.then(|| of_tables.next()).flatten().unwrap_or_default();
        Self { photometric, paired: next(written.paired.is_some()), mixing: next(written.mixing.is_some()) }
    }
}

/// What there is, as a clause.
fn there_are(names: &[&str]) -> String {
    let known: Vec<String> = names.iter().filter(|name| !name.is_empty()).map(|name| format!("`{name}`")).collect();
    let without = names.contains(&"").then(|| String::from("samples without a split"));
    format!("there are {}", known.into_iter().chain(without).collect::<Vec<_>>().join(", "))
}

/// The splits that the list `splits` of a table names.
fn named(check: &mut Check<'_>, table: &str, splits: &[String], division: &Division) -> Vec<bool> {
    let key = format!("{table}.splits");
    let names: Vec<&str> = division.names.iter().map(String::as_str).collect();
    if !division.is_divided() {
        let help = "leave `splits` out, or name the column of the split with input.columns.split";
        check.error(&key, "no split of the real samples is known", help);
    } else if splits.is_empty() {
        check.error(&key, "no split is named", format!("leave the table out, or name one: {}", one_of(&names)));
    } else {
        for (k, split) in splits.iter().enumerate().filter(|(_, split)| !names.contains(&split.as_str())) {
            let near =
                nearest(split, names.iter().copied()).map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let message = format!("no split is called `{split}`");
            check.error(&format!("{key}.{k}"), message, format!("{near}{}", there_are(&names)));
        }
    }
    division.names.iter().map(|name| splits.contains(name)).collect()
}

/// True if new splits of a set are files of labels of their own: of tars, of folders whose names tell their splits, and of an
/// imagefolder or COCO annotations without a column for them.
fn apart(set: &Set) -> bool {
    let column = set.columns.name(Meaning::Split).is_some();
    set.in_tars() || set.split_by_unit || (set.is_imagefolder() || set.layout == Layout::Coco) && !column
}
