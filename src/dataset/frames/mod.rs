//! Depth frames of simulators, which take the place of a mesh and its pose. All that follows the capture of depth is
//! the same code.
//!
//! [`source`] finds the files, [`log_frames`] the messages of logs, and [`read`] reads one. [`reader`] converts it to what is pressed in: by [`camera`] to
//! heights over the pad (through [`perspective`] for a perspective camera), or by [`inside`] to the surface that a
//! camera inside a gel sees. [`check`] finds what cannot be right, [`poses`] reads what is known of the objects,
//! [`run`] renders files, to a folder or to a log ([`tactile_log`]), and [`stream`] renders frames from a pipe.

pub mod camera;
pub mod check;
pub mod heights;
pub mod inside;
pub mod log_frames;
pub mod message;
pub mod perspective;
pub mod poses;
pub mod read;
pub mod reader;
pub mod run;
pub mod sequence;
pub mod source;
pub mod stream;
pub mod tactile_log;
