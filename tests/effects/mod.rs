//! Do effects run when they should, and only then? Leaving out what a sample does not call for must not move a pixel,
//! or none by more than the bound; an effect of strength zero is none at all; each does what its name says.
//!
//! `gating` runs random jobs with the effects that they call for and with all; `strength` tries every effect at zero;
//! `facts` what is known of each; `dome` bounds the error of solving a curved pad as a flat one; `finite_strain` what
//! linear theory leaves out where it is said to be within the tolerance.

mod dome;
mod facts;
mod finite_strain;
mod gating;
mod strength;
