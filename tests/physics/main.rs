//! Does the picture obey the geometry and the formulas? Every stage against closed forms and slow twins in f64.
//!
//! `capture` the depth map against plain loops and rays; `gelpad` the surface; `optics` normals and light against
//! closed forms; `scene` labels against what they describe; `twin` whole samples against a plain f64 pipeline.

mod capture;
mod gelpad;
mod optics;
mod oracle;
mod plan;
mod scene;
mod support;
mod twin;
