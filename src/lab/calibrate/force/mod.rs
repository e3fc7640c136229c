//! `gelsim calibrate --force`: Young's modulus, relaxation and friction of a gelpad from presses with measured forces.
//!
//! A table of presses ([`table`]) is brought together with the forces that gelsim's own layer has at Young's modulus 1
//! ([`contact_curve`], [`motion`]). The modulus and the relaxation are fitted to the normal forces ([`fit`]), the
//! coefficient of friction to the tangential ones ([`friction`]). Then the fit is judged ([`judge`]) and described
//! ([`report`], [`page`]).

pub mod contact_curve;
pub mod fit;
pub mod friction;
pub mod judge;
pub mod motion;
pub mod page;
pub mod report;
mod simplex;
pub mod table;

#[cfg(test)]
mod tests;
