//! JSON files of a dataset that a later gelsim may write differently: read if they are of a version that is known.

use std::fs;
use std::io;
use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::folder::Refused;
use crate::plan::usage;

/// Why a file cannot be had.
#[derive(Debug)]
pub enum Unreadable {
    /// The disk said no.
    Io(io::Error),
    /// A newer gelsim wrote it: that one's version.
    Newer(String),
}

impl Unreadable {
    /// What the user is told of the file at `path`.
    pub fn refused(self, path: &Path) -> Refused {
        match self {
            Self::Io(error) => Refused::Io(path.to_owned(), error),
            Self::Newer(version) => {
                let message =
                    format!("{} was written by gelsim {version}, which is newer than this one", path.display());
                Refused::Usage(usage(message, "use that version, or another folder"))
            }
        }
    }
}

/// A kind of file that says of which version it is.
pub trait Versioned: DeserializeOwned {
    /// The newest version that is known.
    const NEWEST: u32;

    /// Its version.
    fn version(&self) -> u32;

    /// Reads a file. `None` if it is not there or not whole.
    fn read(path: &Path) -> Result<Option<Self>, Unreadable> {
        match fs::read(path) {
            Ok(text) => Self::parse(&text),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(Unreadable::Io(error)),
        }
    }

    /// The same; what the user is told if it cannot be had.
    fn read_or_refuse(path: &Path) -> Result<Option<Self>, Refused> {
        Self::read(path).map_err(|reason| reason.refused(path))
    }

    /// Reads JSON. `None` if it is not whole.
    fn parse(text: &[u8]) -> Result<Option<Self>, Unreadable> {
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
            return Ok(Some(found));
        }
        match serde_json::from_slice::<Header>(text) {
            Ok(header) if header.version > u64::from(Self::NEWEST) => {
                let name = header.generator.as_str().or(header.generator["version"].as_str());
                Err(Unreadable::Newer(name.unwrap_or("of a later version").to_owned()))
            }
            _ => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::manifest::Manifest;
    use crate::dataset::stats::Stats;

    #[test]
    fn a_file_of_a_newer_version_is_recognised_by_name_and_a_broken_one_is_none() {
        let stats = br#"{ "stats_version": 99, "generator": "9.1.0", "what": ["nobody", "knows"] }"#;
        assert!(matches!(Stats::parse(stats), Err(Unreadable::Newer(version)) if version == "9.1.0"));
        let manifest = br#"{ "manifest_version": 99, "generator": { "name": "gelsim", "version": "9.1.0" } }"#;
        assert!(matches!(Manifest::parse(manifest), Err(Unreadable::Newer(version)) if version == "9.1.0"));
        for broken in [&b"{ \"stats_version\": 1, "[..], b"[]", b"", b"null", b"{ \"stats_version\": -1 }"] {
            assert!(matches!(Stats::parse(broken), Ok(None)));
        }
        let deep = "[".repeat(1_000_000);
        assert!(matches!(Stats::parse(deep.as_bytes()), Ok(None)));
    }
}
