//! Addresses of object stores in place of folders.

use std::path::{Path, PathBuf};

use clap::builder::{OsStringValueParser, TypedValueParser};

use super::Failure;
use gelsim_files::diagnostic::user_error;
use gelsim_files::store::{Address, BUILT_IN, mistaken_output};

/// The address that stands in place of a folder's path; `None` of a path. Refuses an address that is not sound, or that this
/// program cannot go to.
pub(super) fn address(path: &Path) -> Result<Option<Address>, Failure> {
    let Some(parsed) = path.to_str().and_then(Address::parse) else { return Ok(None) };
    let elsewhere = "name a store, or write a folder as ./NAME if it has :// in its name";
    let address = parsed.map_err(|wrong| user_error(wrong, elsewhere))?;
    if BUILT_IN {
        return Ok(Some(address));
    }
    let message = format!("{address} is in an object store, and this gelsim was built without them");
    let help = "build it with them: `cargo install --path . --features stores` (docs/stores.md); or generate to a folder and \
                copy that";
    Err(user_error(message, help).into())
}

/// Takes a place to write to, which may be in a store.
pub(super) fn output() -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().map(PathBuf::from).try_map(|path| match mistaken_output(&path) {
        Some(reason) => Err(reason),
        None => Ok(path),
    })
}

/// Takes a place to write to on this machine.
pub(super) fn local_output() -> impl TypedValueParser<Value = PathBuf> {
    output().try_map(|path| if Address::is_one(&path) { Err(ONLY_LOCAL) } else { Ok(path) })
}

const ONLY_LOCAL: &str = "it is in an object store, where only `generate` and `finalize` work: write to a folder, and copy that (docs/stores.md)";

/// Refuses an address where only a folder on this machine will do.
pub(super) fn folder_only(path: &Path, command: &str) -> Result<(), Failure> {
    if !Address::is_one(path) {
        return Ok(());
    }
    let message = format!("{} is in an object store; `gelsim {command}` takes a folder", path.display());
    let help = "only `generate` and `finalize` work in stores: copy the dataset here first, for example with `aws s3 sync` (docs/stores.md)";
    Err(user_error(message, help).into())
}

/// Where shards on their way to a store are, unless it is said.
pub(super) fn staging(chosen: Option<PathBuf>) -> PathBuf {
    chosen.unwrap_or_else(std::env::temp_dir)
}
