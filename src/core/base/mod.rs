//! Basic types that every stage of the simulator uses: images, views, gel shapes and charts, random numbers, blur, SIMD
//! dispatch.

pub mod angle;
pub mod chart;
pub mod clock;
pub mod cubic;
pub mod gaussian_blur;
pub mod gel;
pub mod gel_surface;
pub mod grain;
pub mod grid;
pub mod light;
pub mod mask_extent;
pub mod rng;
pub mod simd;
pub mod site;
pub mod triangle;
pub mod view;
