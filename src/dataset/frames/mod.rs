//! Depth frames of simulators, which take the place of a mesh and its pose: everything behind the capture of depth is the
//! same code.
//!
//! [`source`] finds the files, [`read`] reads one, [`reader`] takes it to what is pressed in: [`camera`] to heights over the
//! pad (through [`perspective`], if its camera was one of perspective), or [`inside`] to the surface that a camera inside a gel
//! sees. [`check`] says what cannot be right, [`poses`] reads what is known of the objects, [`run`] renders files, [`stream`]
//! renders what comes through a pipe.

pub mod camera;
pub mod check;
pub mod heights;
pub mod inside;
pub mod perspective;
pub mod poses;
pub mod read;
pub mod reader;
pub mod run;
pub mod sequence;
pub mod source;
pub mod stream;
