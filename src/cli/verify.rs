//! `gelsim verify`: checks a dataset.

use std::path::{Path, PathBuf};

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};

use super::{Failure, for_each_dataset, print_result};
use gelsim_dataset::sensor_set::list_dataset_folders;
use gelsim_dataset::verify::{CheckLevel, DatasetFinding, JOB_PLACEHOLDER, Remedy, list_remedy_commands, verify};

/// Read a dataset again and name everything in it that is not as it was written: missing, cut, changed or exchanged
/// shards, files that cannot be decoded, numbers that are not finite, labels that break the schema. Ends with status 1
/// if anything is wrong.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim verify out/quickstart
  gelsim verify out/quickstart --checksums

Below what is wrong it names the commands that fix it; valid shards stay as they are.")]
pub struct Verify {
    /// The dataset's folder, or that of a set of sensors
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Compare checksums only: as quick as the disk
    #[arg(long)]
    checksums: bool,
}

/// Returns the commands that fix a dataset; empty if there are none.
pub(super) fn suggest_repair(root: &Path, findings: &[DatasetFinding]) -> String {
    let commands = list_remedy_commands(root, findings);
    if commands.is_empty() {
        return String::new();
    }
    let explanation = if !commands.iter().any(|command| command.contains(JOB_PLACEHOLDER)) {
        String::new()
    } else if findings.iter().any(|finding| finding.remedy == Remedy::GenerateByJob) {
        format!("{JOB_PLACEHOLDER} is the job as you wrote it\n")
    } else {
        let recorded = root.join("job.toml");
        format!(
            "{} names files that are not where it says: {JOB_PLACEHOLDER} is the job as you wrote it\n",
            recorded.display()
        )
    };
    let fixes: String = commands.iter().map(|command| format!("  {command}\n")).collect();
    format!("{explanation}fix it with\n{fixes}")
}

impl Verify {
    pub(super) fn run(self) -> Result<(), Failure> {
        let depth = if self.checksums { CheckLevel::Checksums } else { CheckLevel::Everything };
        for_each_dataset(&list_dataset_folders(&self.dir)?, |folder| verify_dataset(folder, depth))
    }
}

/// Checks one dataset, prints what is wrong with it, and returns true if nothing is.
fn verify_dataset(root: &Path, depth: CheckLevel) -> Result<bool, Failure> {
    let verified = verify(root, depth)?;
    let mut text: String = verified.findings.iter().map(|finding| format!("{finding}\n")).collect();
    let count = verified.findings.len();
    let [samples, shards] = [HumanCount(verified.samples).of("sample"), HumanCount(verified.shards).of("shard")];
    text += &format!("{}: {samples} in {shards}, {}: ", root.display(), HumanBytes(verified.bytes));
    text += &match count {
        0 => String::from("valid and complete\n"),
        1 => String::from("1 thing is wrong\n"),
        count => format!("{count} things are wrong\n"),
    };
    text += &match &verified.made_by {
        None => suggest_repair(root, &verified.findings),
        // This version's `generate` and `finalize` leave the folder as it is.
        Some(version) => {
            let who_fixes = if count == 0 { "" } else { ", and only it can fix them" };
            format!(
                "made by gelsim {version}: whether job and descriptions fit the shards, only that version can say{who_fixes}\n"
            )
        }
    };
    print_result(&text)?;
    Ok(count == 0)
}
