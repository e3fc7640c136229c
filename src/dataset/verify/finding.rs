//! What is wrong with a dataset, and the commands that mend it.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use gelsim_files::spelling::shell_word;

/// Something that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The file, relative to the dataset's folder.
    pub file: String,
    /// What is wrong with it.
    pub what: String,
    /// What mends it.
    pub cure: Cure,
}

/// What mends a finding: all that is asked for, in this order.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cure {
    /// The file is to be removed, relative to the dataset's folder.
    Remove(String),
    /// The dataset is to be generated again, which makes what is wanting, by its own job.
    Generate,
    /// The same, by the job that the user has: the dataset's own is lost.
    GenerateByJob,
    /// The dataset is to be described again.
    Finalize,
}

impl Finding {
    /// About a file, relative to the dataset's folder, that `gelsim generate` makes again.
    pub fn new(file: impl Into<String>, what: impl Into<String>) -> Self {
        Self { file: file.into(), what: what.into(), cure: Cure::Generate }
    }

    /// The same with another cure.
    pub fn mended_by(self, cure: Cure) -> Self {
        Self { cure, ..self }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.what)
    }
}

/// The commands that mend what was found in the dataset at `root`, in order.
pub fn cures(root: &Path, findings: &[Finding]) -> Vec<String> {
    let cures: BTreeSet<&Cure> = findings.iter().map(|finding| &finding.cure).collect();
    let own = cures.contains(&Cure::Generate) || cures.iter().any(|cure| matches!(cure, Cure::Remove(_)));
    let (folder, lost) = (shell_word(root), cures.contains(&Cure::GenerateByJob));
    let command = |cure: &&Cure| match cure {
        Cure::Remove(file) => {
            let path = root.join(file);
            Some(format!("rm {}{}", if path.is_dir() && !path.is_symlink() { "-r " } else { "" }, shell_word(&path)))
        }
        Cure::Generate | Cure::GenerateByJob | Cure::Finalize => None,
    };
    let job = if lost { String::from("JOB.toml") } else { shell_word(&root.join("job.toml")) };
    let last = match own || lost {
        // Ends with a description, too.
        true => Some(format!("gelsim generate {job} --out {folder}")),
        false => cures.contains(&Cure::Finalize).then(|| format!("gelsim finalize {folder}")),
    };
    cures.iter().filter_map(command).chain(last).collect()
}
