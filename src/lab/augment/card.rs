//! README.md of an output: how many samples of each split are real, and which files belong to which split for Hugging
//! Face and WebDataset.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::PathBuf;

use serde_json::Value;

use super::Recipe;
use super::input::InputLayout;
use super::input::folders::TABLE_NAME;
use super::report::{PerSource, Summary};
use super::trace::Source;

/// Formats the card.
pub fn format_card(recipe: &Recipe, summary: &Summary, filled: &BTreeSet<(usize, PathBuf)>) -> String {
    let mut text = format_front_matter(recipe, filled).map_or(String::new(), |text| text + "\n");
    let _ = write!(text, "# {}\n\nA real dataset, enlarged by `gelsim augment`.\n\n", recipe.name);
    text += &format_split_table(recipe, summary);
    text += &list_real_only_splits(recipe, summary);
    let [source, key, augmentation] = &recipe.trace.0;
    let place = match recipe.set.layout {
        InputLayout::ClassFolders(_) => format!("In {TABLE_NAME} each image has a row: "),
        _ => String::new(),
    };
    let _ = writeln!(
        text,
        "\n{place}`{source}` says what a sample is, `{key}` which real sample it was made of, `{augmentation}` (JSON) what \
         was drawn for it. augment.json has the figures, report.html shows them, files.sha256 lists every file."
    );
    text
}

/// Formats a table of the samples of each split by source.
fn format_split_table(recipe: &Recipe, summary: &Summary) -> String {
    let sources: Vec<Source> = Source::ALL.into_iter().filter(|source| summary.samples[*source as usize] > 0).collect();
    let divided = recipe.division.is_divided();
    let first = if divided { "split" } else { "" };
    let names: Vec<&str> = [first].into_iter().chain(sources.iter().map(|source| source.name())).collect();
    let mut text = format!("| {} |\n|{}\n", names.join(" | "), "---|".repeat(names.len()));
    let mut row = |name: &str, of: &PerSource| {
        let counts: Vec<String> = sources.iter().map(|source| of[*source as usize].to_string()).collect();
        let name = if name.is_empty() { "-" } else { name };
        let _ = writeln!(text, "| {} | {} |", name.replace(['|', '\n'], " "), counts.join(" | "));
    };
    if divided {
        summary.splits.iter().for_each(|(name, of)| row(name, of));
    }
    row("all", &summary.samples);
    text
}

/// Lists the splits to which nothing was added.
fn list_real_only_splits(recipe: &Recipe, summary: &Summary) -> String {
    let is_real = |of: &PerSource| of[Source::Real as usize] > 0 && of.iter().sum::<u64>() == of[Source::Real as usize];
    let names: Vec<String> = summary
        .splits
        .iter()
        .filter(|(name, of)| !name.is_empty() && is_real(of))
        .map(|(name, _)| format!("`{name}`"))
        .collect();
    if names.is_empty() || !recipe.division.is_divided() || is_real(&summary.samples) {
        return String::new();
    }
    format!("\nReal samples alone: {}.\n", names.join(", "))
}

/// Formats the front matter that Hugging Face reads: the files of each split. None for a table that is no imagefolder,
/// if a file holds several splits, or if a split's name is not valid there.
fn format_front_matter(recipe: &Recipe, filled: &BTreeSet<(usize, PathBuf)>) -> Option<String> {
    let (set, division) = (&recipe.set, &recipe.division);
    let files: BTreeSet<&PathBuf> = filled.iter().map(|(_, file)| file).collect();
    let paths: BTreeMap<usize, Vec<String>> = match set.layout {
        InputLayout::ClassFolders(kind) if kind.are_splits || division.is_new => {
            division.names.iter().enumerate().map(|(split, name)| (split, vec![format!("{name}/**")])).collect()
        }
        InputLayout::ClassFolders(kind) if kind.are_classes => [(0, vec![String::from("*/**")])].into(),
        InputLayout::ClassFolders(_) => {
            let endings =
                set.reals.iter().filter_map(|real| real.path.extension()).map(|ending| ending.to_string_lossy());
            let endings: BTreeSet<String> = endings.map(Into::into).chain([String::from("png")]).collect();
            [(0, endings.into_iter().map(|ending| format!("*.{ending}")).collect())].into()
        }
        InputLayout::Tars | InputLayout::Tables
            if files.len() == filled.len() && (set.in_tars() || set.is_imagefolder()) =>
        {
            let mut paths: BTreeMap<usize, Vec<String>> = BTreeMap::new();
            for (split, file) in filled {
                let path = if set.in_tars() { file.clone() } else { file.with_file_name("**") };
                paths.entry(*split).or_default().push(path.display().to_string());
            }
            paths
        }
        _ => return None,
    };
    let is_name = |name: &String| name.chars().all(|c| c.is_alphanumeric() || c == '_');
    if !division.names.iter().all(is_name) {
        return None;
    }
    let mut text = String::from("---\nconfigs:\n- config_name: default\n  data_files:\n");
    for (split, paths) in paths {
        let name = if division.names[split].is_empty() { "train" } else { &division.names[split] };
        let _ = write!(text, "  - split: {name}\n    path:\n");
        for path in paths {
            let _ = writeln!(text, "    - {}", Value::from(path));
        }
    }
    Some(text + "---\n")
}
