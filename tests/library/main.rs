//! What the library computes: one process for all of it, tests by name: `cargo test --release --test library physics::contact`.
//!
//! Each folder beside this one is a module, whose head says what it asks. `random_jobs` draws jobs, `plan` makes the plan of
//! a job's text, `cases` checks a table's cases side by side. Second implementations that several of them compare with, meshes
//! and random numbers are in the crate `gelsim_oracle`. It is optimised and this one is not, so put loops that take long there.

use gelsim::SensorExt;

mod cases;
mod stages;

#[path = "../calibration/mod.rs"]
mod calibration;
#[path = "../effects/mod.rs"]
mod effects;
#[path = "../golden/mod.rs"]
mod golden;
#[path = "../physics/mod.rs"]
mod physics;
#[path = "../physics/plan.rs"]
mod plan;
#[path = "../random_jobs/mod.rs"]
mod random_jobs;
#[path = "../reality/mod.rs"]
mod reality;
#[path = "../stability/mod.rs"]
mod stability;
#[path = "../taxim/mod.rs"]
mod taxim;

/// True where `GELSIM_THOROUGH` is set, as `.ci/run --full` does: random cases and sweeps in their full number.
fn thorough() -> bool {
    std::env::var_os("GELSIM_THOROUGH").is_some()
}

/// True of a preset whose gel has no shape: with those a depth frame can be pressed, and any fidelity level.
fn is_flat(preset: &str) -> bool {
    gelsim::Sensor::preset(preset).expect("a preset").shape.is_none()
}
