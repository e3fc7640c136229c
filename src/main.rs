//! The `gelsim` command: parses, dispatches, prints what went wrong, sets the exit status.

/// Samples are made of images of a megabyte, made and dropped again and again. The system's allocator gives such memory
/// back each time, and the kernel clears it anew: a tenth of the time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

use std::process::ExitCode;

use clap::Parser;
use gelsim::cli::{Arguments, run, say};

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if !failure.message.is_empty() {
                say(&failure.message);
            }
            ExitCode::from(failure.status)
        }
    }
}
