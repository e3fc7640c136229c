//! Noise of a sensor.

use image::RgbImage;

use crate::camera;

/// Noise of a sensor, as standard deviations in grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Level {
    /// Of every pixel.
    pub read_levels: f64,
    /// Of a white pixel, by counting light.
    pub shot_levels: f64,
}

impl Level {
    /// What a sensor's `[camera]` table says.
    pub fn of(_settings: &camera::Settings) -> Option<Self> {
        None
    }

    /// Measured between each image and the next.
    pub fn measured(_images: &[RgbImage]) -> Option<Self> {
        None
    }
}
