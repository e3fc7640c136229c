//! JSON files of a dataset that a later gelsim may write differently: read if they are of a version that is known.

use std::io;
use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::refused::Refused;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input;

/// The version of the newer gelsim that wrote a file.
#[derive(Debug)]
pub struct Newer(String);

/// A kind of file that says of which version it is.
pub trait Versioned: DeserializeOwned {
    /// The newest version that is known.
    const NEWEST: u32;

    /// Its version.
    fn version(&self) -> u32;

    /// True if the text is what was written, as far as it says so itself.
    fn is_as_written(_text: &[u8]) -> bool {
        true
    }

    /// Reads a file. `None` if it is not there or not whole.
    fn read(path: &Path) -> Result<Option<Self>, Refused> {
        let text = match input::read_inside(path, input::MOST_METADATA_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Refused::Io(path.to_owned(), error)),
        };
        Self::parse(&text).map_err(|Newer(version)| {
            let message = format!("{} was written by gelsim {version}, which is newer than this one", path.display());
            Refused::Usage(user_error(message, "use that version, or another folder"))
        })
    }

    /// Reads JSON. `None` if it is not whole.
    fn parse(text: &[u8]) -> Result<Option<Self>, Newer> {
        /// What every version has.
        #[derive(Deserialize)]
        struct Header {
            #[serde(alias = "stats_version", alias = "manifest_version")]
            version: u64,
            generator: Value,
        }
        if let Ok(found) = serde_json::from_slice::<Self>(text)
            && found.version() <= Self::NEWEST
        {
            return Ok(Self::is_as_written(text).then_some(found));
        }
        match serde_json::from_slice::<Header>(text) {
            Ok(header) if header.version > u64::from(Self::NEWEST) => {
                let name = header.generator.as_str().or(header.generator["version"].as_str());
                Err(Newer(name.unwrap_or("of a later version").to_owned()))
            }
            _ => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::Manifest;
    use crate::stats::Stats;

    #[test]
    fn a_file_of_a_newer_version_is_recognised_by_name_and_a_broken_one_is_none() {
        let stats = br#"{ "stats_version": 99, "generator": "9.1.0", "what": ["nobody", "knows"] }"#;
        assert!(matches!(Stats::parse(stats), Err(Newer(version)) if version == "9.1.0"));
        let manifest = br#"{ "manifest_version": 99, "generator": { "name": "gelsim", "version": "9.1.0" } }"#;
        assert!(matches!(Manifest::parse(manifest), Err(Newer(version)) if version == "9.1.0"));
        for broken in [&b"{ \"stats_version\": 1, "[..], b"[]", b"", b"null", b"{ \"stats_version\": -1 }"] {
            assert!(matches!(Stats::parse(broken), Ok(None)));
        }
        let deep = "[".repeat(1_000_000);
        assert!(matches!(Stats::parse(deep.as_bytes()), Ok(None)));
    }
}
