//! Whether what describes a dataset, its job among it, is what its shards say.

use std::io;

use serde_json::Value;

use super::{Cure, Finding, Looked};
use crate::card::descriptions;
use crate::cleanup::DESCRIPTIONS;
use crate::folder::{is_as_written, recorded_text};
use crate::recorded::Recorded;
use crate::stats::Stats;
use gelsim_files::input;
use gelsim_job::plan::fingerprint;

/// Where job.toml is not what was written, and stats are of another job than it or of another version.
pub fn of_this_job(recorded: &Recorded, looked: &[Looked], made_by: Option<&str>) -> Vec<Finding> {
    let stats = || looked.iter().filter_map(|one| Some((one.shard, one.stats.as_ref()?)));
    let ours = match made_by {
        None => fingerprint(&recorded.job),
        // Only that version could say. They must at least agree.
        Some(_) => stats().next().map_or_else(String::new, |(_, stats)| stats.fingerprint.clone()),
    };
    let version = made_by.unwrap_or(env!("CARGO_PKG_VERSION"));
    let agrees = stats().all(|(_, stats)| stats.fingerprint == ours);
    let text = recorded_text(&recorded.root).unwrap_or_default();
    let mut found = Vec::new();
    if !is_as_written(&text) {
        let (what, cure) = match agrees {
            true => ("is not what was written", Cure::Generate),
            false => ("is not what was written, and not the job of its shards", Cure::GenerateByJob),
        };
        found.push(Finding::new("job.toml", what).mended_by(cure));
        return found;
    }
    for (shard, stats) in stats() {
        let file = format!("stats/{}.json", shard.name());
        if stats.fingerprint != ours {
            found.push(Finding::new(&*file, "is of another job than job.toml"));
        }
        if stats.generator != version {
            found.push(Finding::new(file, format!("was written by gelsim {}, job.toml by {version}", stats.generator)));
        }
    }
    found
}

/// Where manifest, index and card are not what job and stats make of them; of another version's, whether they are there.
pub fn described(recorded: &Recorded, looked: &[Looked], by_another: bool) -> Vec<Finding> {
    let stats = looked.iter().map(|one| one.stats.clone()).collect::<Option<Vec<Stats>>>();
    let Some(stats) = stats.filter(|_| !by_another) else {
        // They are made when the last shard is.
        let wanting = |name: &&str| !recorded.root.join(name).is_file();
        let names = DESCRIPTIONS.into_iter().filter(|name| *name != "wids.json" || recorded.has_index());
        return names.filter(|name| wanting(name)).map(|name| Finding::new(name, "is missing")).collect();
    };
    let check = |(name, expected): (&str, String)| {
        let what = match input::read_inside(&recorded.root.join(name), input::MOST_METADATA_BYTES) {
            Ok(there) if there == expected.as_bytes() => return None,
            Ok(there) => difference(&String::from_utf8_lossy(&there), &expected),
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::from("is missing"),
            Err(error) => error.to_string(),
        };
        Some(Finding::new(name, what).mended_by(Cure::Finalize))
    };
    descriptions(recorded, &stats).into_iter().filter_map(check).collect()
}

/// Where a text is not what it should be: the first key of JSON, or the first line.
fn difference(there: &str, expected: &str) -> String {
    if let Ok(expected) = serde_json::from_str::<Value>(expected) {
        return match serde_json::from_str::<Value>(there).map(|there| first_difference("", &there, &expected)) {
            Ok(Some(what)) => what,
            Ok(None) => String::from("is not as it was written, though it says the same"),
            Err(_) => String::from("is not whole"),
        };
    }
    let line = there.lines().zip(expected.lines()).take_while(|(a, b)| a == b).count() + 1;
    format!("is not what was written, from line {line} on")
}

/// The first key, by its dotted path, whose value differs.
fn first_difference(path: &str, there: &Value, expected: &Value) -> Option<String> {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match (there, expected) {
        (Value::Object(a), Value::Object(b)) => {
            let mut keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            keys.find_map(|key| match (a.get(key), b.get(key)) {
                (Some(a), Some(b)) => first_difference(&below(key), a, b),
                (Some(_), None) => Some(format!("has the key {}, which does not belong there", below(key))),
                _ => Some(format!("has no {}", below(key))),
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(at, (a, b))| first_difference(&below(&at.to_string()), a, b))
        }
        (Value::Array(a), Value::Array(b)) => Some(format!("has {} {path}, the shards {}", a.len(), b.len())),
        (a, b) => (a != b).then(|| format!("says {path} is {}, the shards {}", shortened(a), shortened(b))),
    }
}

/// A value, cut where it is long.
fn shortened(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(80) {
        Some((at, _)) => format!("{}..", &text[..at]),
        None => text,
    }
}
