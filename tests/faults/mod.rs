//! What happens to a dataset when something happens to the process, the disk, or the folder: kills at random moments,
//! full and read-only disks, several processes, changed files, links and odd names, a strange environment.
//!
//! Every test really does it. What needs a kernel feature that may be denied (a mount of one's own) says so and is left
//! out. `cargo test --release --test program faults -- --nocapture` prints how many faults were survived.

#![cfg(unix)]

mod augmented;
mod changed;
mod environment;
mod full_disk;
mod holders;
mod kills;
mod left_behind;
mod limits;
mod links;
mod names;
mod outputs;
mod rig;
mod stores;
