//! `gelsim verify`

use std::path::{Path, PathBuf};

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};

use super::{Failure, print};
use gelsim_dataset::verify::{CheckLevel, Finding, cures, verify};

/// Read a dataset again and name everything in it that is not as it was written: missing, cut, changed or exchanged shards,
/// files that cannot be decoded, numbers that are not finite, labels that break the schema. Exit status 1 if there is any.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim verify out/quickstart
  gelsim verify out/quickstart --checksums

Below what is wrong it names the commands that mend it; shards that are whole stay as they are.")]
pub struct Verify {
    /// The dataset's folder
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Compare checksums only: as quick as the disk
    #[arg(long)]
    checksums: bool,
}

/// What mends a dataset, if anything is wrong with it.
pub(super) fn mended_by(root: &Path, findings: &[Finding]) -> String {
    let cures: String = cures(root, findings).iter().map(|command| format!("  {command}\n")).collect();
    if cures.is_empty() { cures } else { format!("mend it with\n{cures}") }
}

impl Verify {
    pub(super) fn run(self) -> Result<(), Failure> {
        let depth = if self.checksums { CheckLevel::Checksums } else { CheckLevel::Everything };
        let verified = verify(&self.dir, depth)?;
        let mut text: String = verified.findings.iter().map(|finding| format!("{finding}\n")).collect();
        let count = verified.findings.len();
        let [samples, shards] = [verified.samples, verified.shards].map(HumanCount);
        text +=
            &format!("{}: {samples} samples in {shards} shards, {}: ", self.dir.display(), HumanBytes(verified.bytes));
        text += &match count {
            0 => String::from("whole\n"),
            1 => String::from("1 thing is wrong\n"),
            count => format!("{count} things are wrong\n"),
        };
        text += &match &verified.made_by {
            None => mended_by(&self.dir, &verified.findings),
            // `generate` and `finalize` leave its folder as it is.
            Some(version) => {
                let mends = if count == 0 { "" } else { ", and only it mends them" };
                format!(
                    "made by gelsim {version}: whether job and descriptions fit the shards, only that version can say{mends}\n"
                )
            }
        };
        print(&text)?;
        // What is wrong has been said.
        if count == 0 { Ok(()) } else { Err(Failure::reported(1)) }
    }
}
