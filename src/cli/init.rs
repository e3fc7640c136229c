//! `gelsim init`

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::{Failure, print, say};
use crate::files::diagnostic::user_error;

/// The job that `init` writes.
pub const TEMPLATE: &str = include_str!("template.toml");

/// Write a commented job to start from.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  gelsim init my-job.toml")]
pub struct Init {
    /// The file to write; on standard output if left out
    #[arg(value_name = "FILE.toml")]
    file: Option<PathBuf>,
}

impl Init {
    pub(super) fn run(self) -> Result<(), Failure> {
        let Some(path) = self.file else {
            return print(TEMPLATE);
        };
        let failed = |error: std::io::Error| Failure::running(format!("{}: {error}", path.display()));
        let mut file = match OpenOptions::new().write(true).create_new(true).open(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
                return Err(user_error(format!("{} exists already", path.display()), "choose another name").into());
            }
            opened => opened.map_err(failed)?,
        };
        file.write_all(TEMPLATE.as_bytes()).map_err(failed)?;
        say(&format!("wrote {}; next: put a mesh into it, then gelsim generate {0}", path.display()));
        Ok(())
    }
}
