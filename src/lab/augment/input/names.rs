//! What names of files and folders say.

use std::path::Path;

/// Words for splits.
const SPLITS: [&str; 10] =
    ["train", "training", "val", "valid", "validation", "dev", "test", "testing", "eval", "evaluation"];

/// True of a word for a split.
pub fn is_split(word: &str) -> bool {
    SPLITS.contains(&word.to_ascii_lowercase().as_str())
}

/// The ending of a name in lower case.
pub fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
