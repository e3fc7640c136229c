//! The table that `gelsim calibrate` writes, read and checked.

use serde::Deserialize;

use gelsim_core::optics::calibrated::beyond::Beyond;
use gelsim_core::optics::calibrated::{Colors, Table};

/// Reads a file's bytes.
pub fn parse(bytes: &[u8]) -> Result<Table, String> {
    /// What every version has.
    #[derive(Deserialize)]
    struct Header {
        calibration_version: u32,
        generator: String,
    }
    let none = |error: serde_json::Error| format!("no table of `gelsim calibrate`: {error}");
    let Header { calibration_version, generator } = serde_json::from_slice(bytes).map_err(none)?;
    if calibration_version > Table::NEWEST {
        return Err(format!(
            "gelsim {generator} wrote it, which is newer than this one ({}): take that one, or calibrate again with this",
            env!("CARGO_PKG_VERSION")
        ));
    }
    if calibration_version < Table::OLDEST {
        return Err(format!("version {calibration_version} of the file is not known: calibrate again"));
    }
    let found: Table = serde_json::from_slice(bytes).map_err(none)?;
    if !(0.1..=10.0).contains(&found.contact_over_disc) {
        return Err(format!(
            "contact_over_disc is {}, and from 0.1 to 10 on any sensor: calibrate again",
            found.contact_over_disc
        ));
    }
    found.beyond.as_ref().map_or(Ok(()), Beyond::validate)?;
    match &found.colors {
        Colors::Response(response) => response.validate()?,
        Colors::Taxim(taxim) => taxim.validate()?,
    }
    Ok(found)
}
