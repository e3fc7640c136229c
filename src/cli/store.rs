//! Addresses of object stores in place of folders.

use std::path::{Path, PathBuf};

use clap::builder::{OsStringValueParser, TypedValueParser};

use super::Failure;
use gelsim_files::diagnostic::user_error;
use gelsim_files::store::{HAS_STORES, StoreAddress, explain_mistaken_output};

/// Returns the address of a store that is written in place of a path; `None` for a path. Fails if the address is not
/// valid, or if this program was built without stores.
pub(super) fn parse_address(path: &Path) -> Result<Option<StoreAddress>, Failure> {
    let Some(parsed) = path.to_str().and_then(StoreAddress::parse) else { return Ok(None) };
    let elsewhere = "name a store, or write a folder as ./NAME if it has :// in its name";
    let address = parsed.map_err(|wrong| user_error(wrong, elsewhere))?;
    if HAS_STORES {
        return Ok(Some(address));
    }
    let message = format!("{address} is in an object store, and this gelsim was built without them");
    let help = "build it with them: `cargo install --path . --features stores` (docs/how-to/stores.md); or generate to a folder and \
                copy that";
    Err(user_error(message, help).into())
}

/// Parses a place to write to, which may be in a store.
pub(super) fn output_path_parser() -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().map(PathBuf::from).try_map(|path| match explain_mistaken_output(&path) {
        Some(reason) => Err(reason),
        None => Ok(path),
    })
}

/// Parses a place to write to on this machine.
pub(super) fn local_path_parser() -> impl TypedValueParser<Value = PathBuf> {
    output_path_parser().try_map(|path| if StoreAddress::is_address(&path) { Err(ONLY_LOCAL) } else { Ok(path) })
}

const ONLY_LOCAL: &str = "it is in an object store, where only `generate` and `finalize` work: write to a folder, and copy that (docs/how-to/stores.md)";

/// Fails for an address where only a folder on this machine will do.
pub(super) fn require_local_folder(path: &Path, command: &str) -> Result<(), Failure> {
    if !StoreAddress::is_address(path) {
        return Ok(());
    }
    let message = format!("{} is in an object store; `gelsim {command}` takes a folder", path.display());
    let help = "only `generate` and `finalize` work in stores: copy the dataset here first, for example with `aws s3 sync` (docs/how-to/stores.md)";
    Err(user_error(message, help).into())
}

/// Returns the folder for shards on their way to a store: the chosen one, or that for temporary files.
pub(super) fn staging_folder(chosen: Option<PathBuf>) -> PathBuf {
    chosen.unwrap_or_else(std::env::temp_dir)
}
