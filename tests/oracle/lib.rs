//! Second implementations that say what is right: slow, plain, in f64.

pub mod cut_pixels;
pub mod dense_contact;
pub mod fourier;
pub mod in_plane;
pub mod marched_rays;
pub mod mesh_rays;
pub mod path_tracer;
pub mod pipeline_f64;
pub mod pixel_pairs;
pub mod pressed_pixel;
pub mod ray_tracer;
pub mod scenery;
pub mod shading;
pub mod shapes;
mod vectors;
