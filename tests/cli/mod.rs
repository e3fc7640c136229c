//! The `gelsim` command as its users meet it: what it writes, what it refuses, what it does when it is stopped.
//!
//! Everything runs at a few dozen pixels, in folders of its own. After a change of the job file, the label or a
//! sensor file, one command brings the committed schemas up to date: `UPDATE=1 cargo test --test program cli::schema`.

mod augment;
mod calibrate;
mod calibrated;
mod calibration_folders;
mod clearance;
mod compare;
mod curved;
mod curved_sequences;
mod determinism;
mod effects;
mod fidelity;
mod finalize;
mod finite_strain;
mod forces;
mod formats;
mod gel_mesh;
mod gelsight;
mod generate;
mod gripper;
mod grow;
mod guesses;
mod health;
mod inside;
mod inspect;
mod log;
mod many_meshes;
mod markers;
mod messages;
mod object_sets;
mod objects;
mod preview;
mod properties;
mod random_sensor;
mod remedies;
mod render;
mod report;
mod resume;
mod schema;
mod sensor_sets;
mod sequences;
mod several;
mod streams;
mod surface_points;
mod terminal;
mod tradeoff;
mod verify;
mod watch;
