//! Reads JSON files of a dataset that have a version, and refuses those of a newer gelsim.

use std::io;
use std::path::Path;

use serde::Deserialize;
use serde_json::Value;

use super::dataset_error::DatasetError;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input;

/// The error for a file that a newer gelsim wrote. Holds its version.
#[derive(Debug)]
pub struct NewerVersion(String);

/// A kind of file that holds the version of its format.
pub trait Versioned: Sized {
    /// The newest version of the format that is known.
    const NEWEST: u32;

    /// Reads the JSON of a known version. It is written out for each kind, since code for all kinds would be compiled
    /// again in every crate that reads one.
    fn from_json(text: &[u8]) -> serde_json::Result<Self>;

    /// Returns the version of the format.
    fn version(&self) -> u32;

    /// Returns true if the text is what was written, as far as the file's own hash tells. A kind without one is always
    /// accepted.
    fn is_unmodified(_text: &[u8]) -> bool {
        true
    }

    /// Reads a file. Returns `None` if it does not exist or is not valid. It is an error if a newer gelsim wrote it.
    fn read(path: &Path) -> Result<Option<Self>, DatasetError> {
        let text = match input::read_without_links(path, input::MAX_METADATA_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(DatasetError::Io(path.to_owned(), error)),
        };
        Self::parse(&text).map_err(|NewerVersion(version)| {
            let message = format!("{} was written by gelsim {version}, which is newer than this one", path.display());
            DatasetError::Usage(user_error(message, "use that version, or another folder"))
        })
    }

    /// Parses JSON. Returns `None` if it is not valid.
    fn parse(text: &[u8]) -> Result<Option<Self>, NewerVersion> {
        /// The fields that every version has.
        #[derive(Deserialize)]
        struct Header {
            #[serde(alias = "stats_version", alias = "manifest_version", alias = "set_version")]
            version: u64,
            generator: Value,
        }
        if let Ok(found) = Self::from_json(text)
            && found.version() <= Self::NEWEST
        {
            return Ok(Self::is_unmodified(text).then_some(found));
        }
        match serde_json::from_slice::<Header>(text) {
            Ok(header) if header.version > u64::from(Self::NEWEST) => {
                let name = header.generator.as_str().or(header.generator["version"].as_str());
                Err(NewerVersion(name.unwrap_or("of a later version").to_owned()))
            }
            _ => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::Manifest;
    use crate::stats::ShardStats;

    #[test]
    fn a_file_of_a_newer_version_is_recognised_by_name_and_a_broken_one_is_none() {
        let stats = br#"{ "stats_version": 99, "generator": "9.1.0", "what": ["nobody", "knows"] }"#;
        assert!(matches!(ShardStats::parse(stats), Err(NewerVersion(version)) if version == "9.1.0"));
        let manifest = br#"{ "manifest_version": 99, "generator": { "name": "gelsim", "version": "9.1.0" } }"#;
        assert!(matches!(Manifest::parse(manifest), Err(NewerVersion(version)) if version == "9.1.0"));
        for broken in [&b"{ \"stats_version\": 1, "[..], b"[]", b"", b"null", b"{ \"stats_version\": -1 }"] {
            assert!(matches!(ShardStats::parse(broken), Ok(None)));
        }
        let deep = "[".repeat(1_000_000);
        assert!(matches!(ShardStats::parse(deep.as_bytes()), Ok(None)));
    }
}
