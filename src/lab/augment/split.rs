//! Splits of real samples: the input's, or new ones that keep together what belongs together; and the splits that get
//! derived samples.

use std::collections::HashMap;

use super::config::{Augment, SplitBy};
use super::input::columns::ColumnMeaning;
use super::input::{InputLayout, RealDataset};
use gelsim_core::base::rng::random_stream;
use gelsim_files::spelling::{find_nearest_name, join_alternatives};
use gelsim_job::config::dataset::Splits;
use gelsim_job::layout::Split;
use gelsim_job::plan::check::JobChecker;

/// The splits of an output.
#[derive(Clone, Debug, PartialEq)]
pub struct Division {
    /// Names of the splits.
    pub names: Vec<String>,
    /// Number of the split of each real sample.
    pub split_of_real: Vec<usize>,
    /// Whether they differ from the input's.
    pub is_new: bool,
    /// Whether they are new, with files or folders of their own.
    pub has_own_files: bool,
    /// Number of the split with all samples of an object, by the object's name; if objects are kept together.
    pub split_of_object: Option<HashMap<String, usize>>,
}

impl Division {
    /// Takes the input's own splits.
    pub fn from_input(set: &RealDataset, by: Option<SplitBy>) -> Self {
        let of_reals = set.reals.iter().map(|real| real.split).collect();
        let mut division = Self {
            names: set.splits.clone(),
            split_of_real: of_reals,
            is_new: false,
            has_own_files: false,
            split_of_object: None,
        };
        division.split_of_object = division.assign_objects(set, by);
        division
    }

    /// Draws new splits with these fractions of the samples. Groups come in an order drawn from the seed, larger ones
    /// first, so that small ones even out the rest. Each goes to the split that is furthest behind its fraction.
    pub fn draw_splits(set: &RealDataset, fractions: Splits, by: SplitBy, seed: u64) -> Self {
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
            // A sample without a known group is a group of its own. No name contains NUL, so there is no collision.
            let name = name.unwrap_or_else(|| format!("\0{index}"));
            let number = *numbers.entry(name).or_insert(groups.len());
            match groups.get_mut(number) {
                Some(group) => group.push(index),
                None => groups.push(vec![index]),
            }
        }
        let mut random = random_stream(seed, "regroup", 0);
        for last in (1..groups.len()).rev() {
            groups.swap(last, random.uniform_below(last + 1));
        }
        groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
        let mut given = vec![0_usize; used.len()];
        let mut of_reals = vec![0; set.reals.len()];
        for group in &groups {
            let behind = |k: &usize| fractions[used[*k]] * set.reals.len() as f64 - given[*k] as f64;
            // Of equals the first is taken: train before val before test.
            let next = (0..used.len()).rev().max_by(|a, b| behind(a).total_cmp(&behind(b))).unwrap_or(0);
            given[next] += group.len();
            group.iter().for_each(|&index| of_reals[index] = next);
        }
        let mut division = Self {
            names,
            split_of_real: of_reals,
            is_new: true,
            has_own_files: needs_own_files(set),
            split_of_object: None,
        };
        division.split_of_object = division.assign_objects(set, Some(by));
        division
    }

    /// Maps each object and class to the split of its first sample, if objects are kept together.
    fn assign_objects(&self, set: &RealDataset, by: Option<SplitBy>) -> Option<HashMap<String, usize>> {
        let facts = set.reals.iter().zip(&self.split_of_real);
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

    /// Number of real samples in each split.
    pub fn real_counts(&self) -> Vec<u64> {
        let mut counts = vec![0; self.names.len()];
        self.split_of_real.iter().for_each(|split| counts[*split] += 1);
        counts
    }

    /// Returns true if a synthetic sample of this object may be in a split. If objects are kept together, it must join
    /// the object's real samples, or the training split if there are none.
    pub fn accepts_object(&self, split: usize, object: &str, class: &str) -> bool {
        match &self.split_of_object {
            None => true,
            Some(homes) => {
                homes.get(object).or_else(|| homes.get(class)).copied().unwrap_or(self.training_split()) == split
            }
        }
    }

    /// Lists the objects and classes that are kept together in a split, sorted.
    pub fn objects_in(&self, split: usize) -> Vec<String> {
        let homes = self.split_of_object.iter().flatten().filter(|(_, home)| **home == split);
        let mut names: Vec<String> = homes.map(|(name, _)| name.clone()).collect();
        names.sort();
        names
    }

    /// Number of the training split: the one with that name, else the first.
    fn training_split(&self) -> usize {
        self.names.iter().position(|name| is_for_training(name)).unwrap_or(0)
    }

    /// Returns true if the samples are divided into splits at all.
    pub fn is_divided(&self) -> bool {
        self.names.iter().any(|name| !name.is_empty())
    }
}

fn is_for_training(name: &str) -> bool {
    name.to_ascii_lowercase().starts_with("train")
}

/// For each table that makes samples, the splits that get them. Splits for evaluation stay real unless the file says
/// otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recipients {
    /// Splits for the copies of each `[[photometric]]` table.
    pub photometric: Vec<Vec<bool>>,
    /// Splits for simulated counterparts.
    pub paired: Vec<bool>,
    /// Splits for synthetic samples.
    pub mixing: Vec<bool>,
}

impl Recipients {
    /// Resolves the tables' `splits`. Without one, the splits for training, or all samples of an undivided set.
    pub fn resolve_recipients(check: &mut JobChecker<'_>, written: &Augment, division: &Division) -> Self {
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
            let message =
                format!("no split is for training, and only there samples are added: {}", list_splits(&names));
            let help = format!(
                "say in [[photometric]], [paired] and [mixing] which splits get new samples, for example splits = [{:?}]; a \
                 split for training is called train",
                names.iter().find(|name| !name.is_empty()).unwrap_or(&"")
            );
            check.report_error(table, message, help);
        }
        let mut of_tables = tables.iter().map(|(table, splits)| match splits {
            Some(splits) => resolve_named_splits(check, table, splits, division),
            None => training.clone(),
        });
        let photometric = of_tables.by_ref().take(written.photometric.len()).collect();
        let mut next = |table: bool| table.then(|| of_tables.next()).flatten().unwrap_or_default();
        Self { photometric, paired: next(written.paired.is_some()), mixing: next(written.mixing.is_some()) }
    }
}

/// Lists the splits that exist, as a clause.
fn list_splits(names: &[&str]) -> String {
    let known: Vec<String> = names.iter().filter(|name| !name.is_empty()).map(|name| format!("`{name}`")).collect();
    let without = names.contains(&"").then(|| String::from("samples without a split"));
    format!("there are {}", known.into_iter().chain(without).collect::<Vec<_>>().join(", "))
}

/// Resolves the list `splits` of a table.
fn resolve_named_splits(check: &mut JobChecker<'_>, table: &str, splits: &[String], division: &Division) -> Vec<bool> {
    let key = format!("{table}.splits");
    let names: Vec<&str> = division.names.iter().map(String::as_str).collect();
    if !division.is_divided() {
        let help = "leave `splits` out, or name the column of the split with input.columns.split";
        check.report_error(&key, "no split of the real samples is known", help);
    } else if splits.is_empty() {
        check.report_error(
            &key,
            "no split is named",
            format!("leave the table out, or name one: {}", join_alternatives(&names)),
        );
    } else {
        for (k, split) in splits.iter().enumerate().filter(|(_, split)| !names.contains(&split.as_str())) {
            let near = find_nearest_name(split, names.iter().copied())
                .map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let message = format!("no split is called `{split}`");
            check.report_error(&format!("{key}.{k}"), message, format!("{near}{}", list_splits(&names)));
        }
    }
    division.names.iter().map(|name| splits.contains(name)).collect()
}

/// Returns true if new splits need label files of their own: for tars, for folders whose names tell the split, and for
/// an imagefolder or COCO annotations without a column of the split.
fn needs_own_files(set: &RealDataset) -> bool {
    let column = set.columns.column_of(ColumnMeaning::Split).is_some();
    set.in_tars() || set.split_by_unit || (set.is_imagefolder() || set.layout == InputLayout::Coco) && !column
}
