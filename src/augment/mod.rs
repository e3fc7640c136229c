//! Enlarges a real dataset: its images as other lamps, pads and cameras would have shown them, and their simulated twins.

pub mod paired;
pub mod photometric;
