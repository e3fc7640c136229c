//! What the names of files and folders tell.

use std::path::Path;

/// Words for splits.
const SPLIT_WORDS: [&str; 10] =
    ["train", "training", "val", "valid", "validation", "dev", "test", "testing", "eval", "evaluation"];

/// Returns true for a word for a split.
pub fn is_split(word: &str) -> bool {
    SPLIT_WORDS.contains(&word.to_ascii_lowercase().as_str())
}

/// Returns the ending of a name in lower case.
pub fn lowercase_ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
