//! `gelsim completions`: prints the completion script of a shell.

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::{Arguments, Failure, print_file};

/// Print a completion script for a shell.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  gelsim completions bash > ~/.local/share/bash-completion/completions/gelsim")]
pub struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    pub(super) fn run(self) -> Result<(), Failure> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Arguments::command(), "gelsim", &mut script);
        print_file(&String::from_utf8_lossy(&script))
    }
}
