//! Synthetic datasets for optical tactile sensors (GelSight, DIGIT and their kin).
//!
//! A job in TOML names objects, poses, indentation depths and a sensor; the result is pairs of depth map and tactile
//! image with JSON labels, in shards that training pipelines read as they are. Data flows one way:
//!
//! [`config`] (the job as written) -> [`plan`] (resolved, every mistake found) -> [`scene`] (one press, drawn at
//! random) -> [`depth`] (the object over the pad) -> [`gelpad`] (the pad's shape) -> [`optics`] (its light) ->
//! [`camera`] (the image) -> [`label`] -> [`dataset`] (shards on disk).
//!
//! Read [`mod@render`] first: it is that line in code. Lengths are millimetres, angles in labels degrees, image
//! arithmetic is f32; axes, signs and units are in `docs/conventions.md`.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod render;

pub mod effects;

pub mod config;
pub mod fidelity;
pub mod plan;

pub mod rng;
pub mod scene;

pub mod object;

pub mod depth;

pub mod gelpad;

pub mod optics;

pub mod camera;

pub mod label;

pub mod health;

pub mod dataset;
pub mod forecast;
pub mod generate;
pub mod inspect;
pub mod preview;
pub mod report;

pub mod augment;
pub mod calibrate;
pub mod compare;
pub mod metrics;
pub mod presses;
pub mod tradeoff;

pub mod cli;
pub mod grid;
pub mod input;
pub mod page;
pub mod rows;
pub mod simd;
