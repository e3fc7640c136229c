//! The `gelsim` command.

mod memory;

use std::process::ExitCode;

fn main() -> ExitCode {
    memory::keep_freed();
    ExitCode::from(gelsim_cli::main(std::env::args_os()))
}
