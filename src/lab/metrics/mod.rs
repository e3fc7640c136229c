//! Differences between two results: images, pad surfaces, and figures of many samples. Also what is measured of a
//! picture alone ([`image_stats`]) and of several of one sensor ([`noise`]).
//!
//! Nothing here knows where the two came from: a fidelity level and its reference, or a real image and a simulated one.

pub mod distance;
pub mod image;
pub mod image_stats;
pub mod noise;
pub mod statistics;
pub mod surface;
