//! What every stage of the simulator stands on.

pub mod angle;
pub mod chart;
pub mod clock;
pub mod cubic;
pub mod gel;
pub mod grain;
pub mod grid;
pub mod light;
pub mod rng;
pub mod simd;
pub mod site;
pub mod surface;
pub mod triangle;
pub mod view;
