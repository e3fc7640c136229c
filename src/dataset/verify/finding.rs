//! What is wrong with a dataset, and the commands that fix it.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use crate::recorded::RecordedDataset;
use gelsim_files::spelling::quote_for_shell;

/// Something that is wrong in a dataset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DatasetFinding {
    /// The file, relative to the dataset's folder.
    pub file: String,
    /// What is wrong with it.
    pub what: String,
    /// What fixes it.
    pub remedy: Remedy,
}

/// What fixes a finding. The order of the variants is the order in which remedies are applied.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Remedy {
    /// Remove this file, relative to the dataset's folder.
    Remove(String),
    /// Generate the dataset again by its own job, which makes what is missing.
    Generate,
    /// Generate the dataset again by the job that the user has, since the dataset's own is lost.
    GenerateByJob,
    /// Finalize the dataset again, which writes its manifest, index and card.
    Finalize,
}

impl DatasetFinding {
    /// Makes a finding about a file, relative to the dataset's folder, that `gelsim generate` makes again.
    pub fn new(file: impl Into<String>, what: impl Into<String>) -> Self {
        Self { file: file.into(), what: what.into(), remedy: Remedy::Generate }
    }

    /// Returns the finding with another remedy.
    pub fn with_remedy(self, remedy: Remedy) -> Self {
        Self { remedy, ..self }
    }
}

impl fmt::Display for DatasetFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.what)
    }
}

/// The job that the user has, in commands.
pub const JOB_PLACEHOLDER: &str = "JOB.toml";

/// Returns true if all files that the dataset's job names are where it says. Those of a dataset that was moved by itself
/// are not.
fn has_all_inputs(root: &Path) -> bool {
    RecordedDataset::open(root)
        .is_ok_and(|mut recorded| recorded.job.paths_mut().all(|path| root.join(path.as_str()).exists()))
}

/// Lists the commands that fix what was found in the dataset at `root`, in order.
pub fn list_remedy_commands(root: &Path, findings: &[DatasetFinding]) -> Vec<String> {
    let remedies: BTreeSet<&Remedy> = findings.iter().map(|finding| &finding.remedy).collect();
    let own = remedies.contains(&Remedy::Generate) || remedies.iter().any(|remedy| matches!(remedy, Remedy::Remove(_)));
    let (folder, lost) = (quote_for_shell(root), remedies.contains(&Remedy::GenerateByJob));
    let command = |remedy: &&Remedy| match remedy {
        Remedy::Remove(file) => {
            let path = root.join(file);
            Some(format!(
                "rm {}{}",
                if path.is_dir() && !path.is_symlink() { "-r " } else { "" },
                quote_for_shell(&path)
            ))
        }
        Remedy::Generate | Remedy::GenerateByJob | Remedy::Finalize => None,
    };
    let last = match own || lost {
        // Generating also finalizes.
        true => {
            let is_usable = !lost && has_all_inputs(root);
            let job = if is_usable { quote_for_shell(&root.join("job.toml")) } else { JOB_PLACEHOLDER.to_owned() };
            Some(format!("gelsim generate {job} --out {folder}"))
        }
        false => remedies.contains(&Remedy::Finalize).then(|| format!("gelsim finalize {folder}")),
    };
    remedies.iter().filter_map(command).chain(last).collect()
}
