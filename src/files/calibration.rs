//! Reads and checks the calibration table that `gelsim calibrate` writes.

use serde::Deserialize;

use gelsim_core::optics::calibrated::extrapolation::CalibrationExtrapolation;
use gelsim_core::optics::calibrated::{CalibrationColors, CalibrationTable};

/// Parses a calibration table from the bytes of its file. The error is one sentence that says what is wrong and what to
/// do.
pub fn parse_calibration(bytes: &[u8]) -> Result<CalibrationTable, String> {
    /// The fields that every version of the file has.
    #[derive(Deserialize)]
    struct Header {
        calibration_version: u32,
        generator: String,
    }
    let none = |error: serde_json::Error| format!("no table of `gelsim calibrate`: {error}");
    let Header { calibration_version, generator } = serde_json::from_slice(bytes).map_err(none)?;
    if calibration_version > CalibrationTable::NEWEST {
        return Err(format!(
            "gelsim {generator} wrote it, which is newer than this one ({}): take that one, or calibrate again with this",
            env!("CARGO_PKG_VERSION")
        ));
    }
    if calibration_version < CalibrationTable::OLDEST {
        return Err(format!("version {calibration_version} of the file is not known: calibrate again"));
    }
    let found: CalibrationTable = serde_json::from_slice(bytes).map_err(none)?;
    if !(0.1..=10.0).contains(&found.contact_over_disc) {
        return Err(format!(
            "contact_over_disc is {}, and from 0.1 to 10 on any sensor: calibrate again",
            found.contact_over_disc
        ));
    }
    found.beyond.as_ref().map_or(Ok(()), CalibrationExtrapolation::validate)?;
    match &found.colors {
        CalibrationColors::Response(response) => response.validate()?,
        CalibrationColors::Taxim(taxim) => taxim.validate()?,
    }
    Ok(found)
}
