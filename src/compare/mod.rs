//! How far simulated images are from real ones, image by image where they are of the same presses.

pub mod score;
