//! Does a sample stay sound and steady, whatever it is asked for?
//!
//! `press` makes jobs whose numbers a test moves one at a time; `continuity` moves them by a millionth, `sweeps` through
//! the places where the code changes its way of working; `symmetry` turns and mirrors whole samples; `twin` makes them a
//! second time, in f64, and `stages` each stage from the one before; `properties` draws random jobs.

mod continuity;
#[path = "../oracle/dense_contact.rs"]
mod dense_contact;
#[path = "../effects/jobs.rs"]
mod jobs;
#[path = "../oracle/light.rs"]
mod light;
#[path = "../physics/plan.rs"]
mod plan;
mod press;
#[path = "../oracle/pressed_pixel.rs"]
mod pressed_pixel;
mod properties;
mod stages;
mod sweeps;
mod symmetry;
mod twin;
