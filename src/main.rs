//! The `gelsim` command: parses, dispatches, prints what went wrong, sets the exit status.

use std::process::ExitCode;

use clap::Parser;
use gelsim::cli::{Arguments, run};

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if !failure.message.is_empty() {
                eprintln!("{}", failure.message);
            }
            ExitCode::from(failure.status)
        }
    }
}
