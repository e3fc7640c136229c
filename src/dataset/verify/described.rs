//! Checks whether the files that describe a dataset, with its job, agree with its shards.

use std::io;

use serde_json::Value;

use super::{DatasetFinding, Remedy, ShardCheck};
use crate::card::render_descriptions;
use crate::cleanup::DESCRIPTION_FILES;
use crate::folder::{is_unmodified, recorded_text};
use crate::recorded::RecordedDataset;
use crate::stats::ShardStats;
use gelsim_files::input;
use gelsim_job::plan::compute_fingerprint;

/// Checks whether job.toml is what was written, and whether all stats are of this job and version.
pub fn check_job(recorded: &RecordedDataset, looked: &[ShardCheck], made_by: Option<&str>) -> Vec<DatasetFinding> {
    let stats = || looked.iter().filter_map(|one| Some((one.shard, one.stats.as_ref()?)));
    let ours = match made_by {
        None => compute_fingerprint(&recorded.job),
        // Only the version that wrote the job can compute its fingerprint. All stats must at least agree.
        Some(_) => stats().next().map_or_else(String::new, |(_, stats)| stats.fingerprint.clone()),
    };
    let version = made_by.unwrap_or(env!("CARGO_PKG_VERSION"));
    let agrees = stats().all(|(_, stats)| stats.fingerprint == ours);
    let text = recorded_text(&recorded.root).unwrap_or_default();
    let mut found = Vec::new();
    if !is_unmodified(&text) {
        let (what, remedy) = match agrees {
            true => ("is not what was written", Remedy::Generate),
            false => ("is not what was written, and not the job of its shards", Remedy::GenerateByJob),
        };
        found.push(DatasetFinding::new("job.toml", what).with_remedy(remedy));
        return found;
    }
    for (shard, stats) in stats() {
        let file = format!("stats/{}.json", shard.name());
        if stats.fingerprint != ours {
            found.push(DatasetFinding::new(&*file, "is of another job than job.toml"));
        }
        if stats.generator != version {
            found.push(DatasetFinding::new(
                file,
                format!("was written by gelsim {}, job.toml by {version}", stats.generator),
            ));
        }
    }
    found
}

/// Checks whether manifest, index and card are what job and stats give. For a dataset of another version, only whether
/// they exist.
pub fn check_descriptions(recorded: &RecordedDataset, looked: &[ShardCheck], by_another: bool) -> Vec<DatasetFinding> {
    let stats = looked.iter().map(|one| one.stats.clone()).collect::<Option<Vec<ShardStats>>>();
    let Some(stats) = stats.filter(|_| !by_another) else {
        // With a shard missing or another version, what they should be is unknown: they are made when the last shard
        // is.
        let is_absent = |name: &&str| !recorded.root.join(name).is_file();
        let names = DESCRIPTION_FILES.into_iter().filter(|name| *name != "wids.json" || recorded.has_index());
        return names.filter(|name| is_absent(name)).map(|name| DatasetFinding::new(name, "is missing")).collect();
    };
    let check = |(name, expected): (&str, String)| {
        let what = match input::read_without_links(&recorded.root.join(name), input::MAX_METADATA_BYTES) {
            Ok(found) if found == expected.as_bytes() => return None,
            Ok(found) => describe_difference(&String::from_utf8_lossy(&found), &expected),
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::from("is missing"),
            Err(error) => error.to_string(),
        };
        Some(DatasetFinding::new(name, what).with_remedy(Remedy::Finalize))
    };
    render_descriptions(recorded, &stats).into_iter().filter_map(check).collect()
}

/// Describes where a text is not what it should be: at the first key of JSON, or from the first line on.
fn describe_difference(found: &str, expected: &str) -> String {
    if let Ok(expected) = serde_json::from_str::<Value>(expected) {
        return match serde_json::from_str::<Value>(found).map(|found| find_first_difference("", &found, &expected)) {
            Ok(Some(what)) => what,
            Ok(None) => String::from("is not as it was written, though its values are the same"),
            Err(_) => String::from("is not complete JSON"),
        };
    }
    let line = found.lines().zip(expected.lines()).take_while(|(a, b)| a == b).count() + 1;
    format!("is not what was written, from line {line} on")
}

/// Finds the first key, by its dotted path, whose value differs.
fn find_first_difference(path: &str, found: &Value, expected: &Value) -> Option<String> {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match (found, expected) {
        (Value::Object(a), Value::Object(b)) => {
            let mut keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            keys.find_map(|key| match (a.get(key), b.get(key)) {
                (Some(a), Some(b)) => find_first_difference(&below(key), a, b),
                (Some(_), None) => Some(format!("has the key {}, which does not belong there", below(key))),
                _ => Some(format!("has no {}", below(key))),
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(at, (a, b))| find_first_difference(&below(&at.to_string()), a, b))
        }
        (Value::Array(a), Value::Array(b)) => Some(format!("has {} {path}, the shards {}", a.len(), b.len())),
        (a, b) => (a != b).then(|| format!("says {path} is {}, the shards {}", shorten_value(a), shorten_value(b))),
    }
}

/// Formats a value, cut if it is long.
fn shorten_value(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(80) {
        Some((at, _)) => format!("{}..", &text[..at]),
        None => text,
    }
}
