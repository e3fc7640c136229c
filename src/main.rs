//! The `gelsim` command.

/// Samples are made of images of a megabyte, made and dropped again and again. The system's allocator gives such memory
/// back each time, and the kernel clears it anew: a tenth of the time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(gelsim::cli::main(std::env::args_os()))
}
