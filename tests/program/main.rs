//! What the `gelsim` command does: one process for all of it, tests by name: `cargo test --release --test program faults::kills`.
//!
//! Each folder beside this one is a module, whose head says what it asks. The command is run as a child with limits,
//! current folder, environment and signals of its own: nothing is set for this process, whose tests run side by side.

#[path = "../cli/advice.rs"]
mod advice;
#[path = "../cli/mod.rs"]
mod cli;
#[path = "../cli/command.rs"]
mod command;
#[path = "../faults/mod.rs"]
mod faults;
#[path = "../fuzz/mod.rs"]
mod fuzz;
#[path = "../cli/pty.rs"]
mod pty;
#[path = "../random_jobs/mod.rs"]
mod random_jobs;
#[path = "../cli/support.rs"]
mod support;

/// True where `GELSIM_THOROUGH` is set, as `.ci/run --full` does: random cases and sweeps in their full number.
fn thorough() -> bool {
    std::env::var_os("GELSIM_THOROUGH").is_some()
}
