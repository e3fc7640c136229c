//! The simulator: a pure library from an indenter to a tactile image. It knows no file, no job and no random distribution.

pub mod base;
pub mod camera;
pub mod curved;
pub mod depth;
pub mod effects;
pub mod fidelity;
pub mod gelpad;
pub mod impression;
pub mod mesh;
pub mod optics;
pub mod pose;
pub mod sensor;
pub mod simulator;
