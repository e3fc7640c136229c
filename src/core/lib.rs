//! The simulator: from an indenter to a tactile image, as a pure library. It knows no files, no jobs and no random
//! distributions.

pub mod base;
pub mod camera;
pub mod curved;
pub mod depth;
pub mod effects;
pub mod fidelity;
pub mod gelpad;
pub mod impression;
pub mod instances;
pub mod mesh;
pub mod optics;
pub mod pose;
pub mod sensor;
pub mod simulator;
