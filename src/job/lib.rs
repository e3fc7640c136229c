//! A job: read, resolved to a plan, drawn at random, rendered and labelled.

pub mod config;
pub mod force;
pub mod gripper;
pub mod health;
pub mod inspection;
pub mod label;
pub mod layers;
pub mod layout;
pub mod placing;
pub mod plan;
pub mod probe;
pub mod sample;
pub mod scene;
pub mod schema;
pub mod sequence;
pub mod steps;
