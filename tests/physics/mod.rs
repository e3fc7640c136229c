//! Does the picture obey the geometry and the formulas? Every stage against closed forms and slow references in f64.
//!
//! `capture` the depth map against plain loops and rays; `gelpad` and `gaussian` the blurred surfaces; `optics` normals
//! and light against closed forms; `presets` the light of presets against figures of real sensors; `walls` light
//! between pixel centres; `scene` labels against what they describe; `lamps` light of measured lamps against the
//! published formula; `near_light` near LEDs against traced rays; `curved` gels that are not flat, `curved_elements`
//! against finite elements, `curved_light` their shadows and edges, `gel_mesh` the same as meshes; `frames` depth
//! frames against the objects that they show, `inside` those of cameras inside a gel; `pipeline` samples against the
//! reference pipeline in f64.
//!
//! The elastic pad: `greens`, `convolution` and `kernel` its parts; `contact` presses against slow solutions of the
//! same equations; `solutions` against closed forms; `symmetry`; `border` and `grids` what the view's border and the
//! pixels' size cost; `finite_elements` the error of linear theory; `ladder` every level on the bundled objects; `mask`
//! the contact of coarse grids as a label; `gripper` two fingers; `hard_cases` what must not break it.

mod beyond;
mod border;
mod capture;
mod contact;
mod convolution;
mod curved;
mod curved_elements;
mod curved_light;
mod curved_sequences;
mod curved_texture;
mod finite_elements;
mod finite_strain;
mod frames;
mod friction;
mod gaussian;
mod gel_mesh;
mod gelpad;
mod greens;
mod grids;
mod gripper;
mod hard_cases;
mod history;
mod inplane;
mod inside;
mod interreflection;
mod kernel;
mod ladder;
mod lamps;
mod mask;
mod near_light;
mod optics;
mod pipeline;
mod presets;
mod reference_solutions;
mod relaxation;
mod response;
pub mod rig;
mod scene;
mod sequences;
mod several;
mod shadow;
mod soft;
mod solutions;
mod support;
pub mod symmetry;
mod transport;
mod walls;
