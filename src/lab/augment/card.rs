//! README.md of an output that Hugging Face or WebDataset reads: which files are which split.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::Recipe;
use super::report::Summary;
use super::trace::Source;

/// The card; none of a table that is no imagefolder, or where a file holds several splits.
pub fn card(recipe: &Recipe, summary: &Summary, filled: &BTreeSet<(usize, PathBuf)>) -> Option<String> {
    let set = &recipe.set;
    let files: BTreeSet<&PathBuf> = filled.iter().map(|(_, file)| file).collect();
    if !set.in_tars() && !set.is_imagefolder() || files.len() < filled.len() {
        return None;
    }
    let mut text = String::from("---\nconfigs:\n- config_name: default\n  data_files:\n");
    for (split, name) in recipe.division.names.iter().enumerate() {
        let files: Vec<&PathBuf> = filled.iter().filter(|(of, _)| *of == split).map(|(_, file)| file).collect();
        if files.is_empty() {
            continue;
        }
        let name = if name.is_empty() { "train" } else { name };
        text += &format!("  - split: {name}\n    path:\n");
        for file in files {
            let path = match set.in_tars() {
                true => file.display().to_string(),
                false => file.with_file_name("**").display().to_string(),
            };
            text += &format!("    - {}\n", serde_json::Value::from(path));
        }
    }
    text += "---\n\n";
    text += &format!("# {}\n\nA real dataset, enlarged by `gelsim augment`.\n\n", recipe.name);
    text += "| source | samples |\n|---|---|\n";
    for source in Source::ALL.iter().filter(|source| summary.samples[**source as usize] > 0) {
        text += &format!("| {} | {} |\n", source.name(), summary.samples[*source as usize]);
    }
    let [source, key, augmentation] = &recipe.trace.0;
    text += &format!(
        "\n`{source}` says what a sample is, `{key}` which real sample it was made of, `{augmentation}` (JSON) what was \
         drawn for it. augment.json has the figures, report.html shows them, files.sha256 lists every file.\n"
    );
    Some(text)
}
