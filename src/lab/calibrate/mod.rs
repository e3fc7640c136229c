//! `gelsim calibrate`: learns the light of a real sensor from presses of a ball.
//!
//! For each press, the pad's surface follows from circle and ball ([`geometry`]). The pixels of all presses
//! ([`pixels`]) teach how colour follows from the surface ([`train`]). Two quantities are common to all presses: the
//! pad's thickness, and how much larger the visible disc is than the contact. They are chosen so that colour follows
//! best ([`choose`]). Errors are those of presses that were not learnt from ([`validate`]).

use gelsim_core::gelpad::material::Material;
use image::RgbImage;
use rayon::prelude::*;

use crate::presses::Circle;
use gelsim_core::base::light::Light;
use gelsim_core::base::light::quantise;
use gelsim_core::base::rng::random_stream;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::{self, Contact, Pad};
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::calibrated::response::CalibrationResponse;
use gelsim_core::optics::calibrated::{CalibrationColors, CalibrationTable};
use gelsim_files::sensor::Sensor;

pub mod camera;
pub mod choose;
pub mod detect;
pub mod dots;
pub mod evaluate;
pub mod force;
pub mod gelsight;
pub mod geometry;
pub mod judge;
pub mod leds;
pub mod outliers;
pub mod page;
pub mod pixels;
pub mod progress;
pub mod run;
pub mod session;
pub mod surfaces;
pub mod taxim;
pub mod train;
pub mod validate;

use dots::Dots;
use geometry::Balls;
use leds::FittedLeds;
use pixels::{PixelSamples, draw_places};
use progress::ProgressMeter;
use train::TrainingSettings;

/// A press: what the camera saw, and where the ball touched.
#[derive(Clone, Debug)]
pub struct Observation {
    /// Name of the image's file, as in the table of presses.
    pub file: String,
    /// The image. Dots that are printed on the pad have been painted over.
    pub image: RgbImage,
    /// The visible disc.
    pub circle: Circle,
    /// Confidence in the circle, 0 to 1; `None` if it was in the table.
    pub confidence: Option<f64>,
    /// Radius of the ball, mm.
    pub ball_radius_mm: f64,
    /// True at pixels that dots cover, in the image or in the background image; empty for a pad without dots.
    pub ink: Vec<bool>,
}

impl Observation {
    /// Makes a press into a pad without dots, with a known circle.
    pub fn new(file: impl Into<String>, image: RgbImage, circle: Circle, ball_radius_mm: f64) -> Self {
        Self { file: file.into(), image, circle, confidence: None, ball_radius_mm, ink: Vec::new() }
    }

    /// Returns true if a dot covers the pixel.
    fn is_inked(&self, at: usize) -> bool {
        self.ink.get(at).copied().unwrap_or(false)
    }
}

/// Dots printed on a pad.
#[derive(Clone, Debug)]
pub struct PrintedDots {
    /// The dots.
    pub dots: Dots,
    /// The background image with the dots.
    pub background: RgbImage,
}

/// Presses of one sensor.
#[derive(Clone, Debug)]
pub struct Session {
    /// The sensor. Thickness and contact are still to be found.
    pub sensor: Sensor,
    /// Its view.
    pub camera: View,
    /// The background image: the untouched pad. Dots have been painted over.
    pub background: RgbImage,
    /// The presses.
    pub observations: Vec<Observation>,
    /// The dots printed on the pad; `None` for a pad without dots.
    pub printed: Option<PrintedDots>,
}

/// What decides the surface under all presses, beside the circles and balls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// Radius of the contact over that of the visible disc.
    pub contact_over_disc: f64,
}

impl Geometry {
    /// Contact over disc if nothing is known about it.
    pub const USUAL_CONTACT: f64 = 0.95;
}

/// Surfaces of a session's presses.
pub struct PressSurfaces {
    /// One for each press.
    pub contacts: Vec<Contact>,
    /// Depth of each press, mm.
    pub depths_mm: Vec<f64>,
    /// True for a press whose contact is larger than the ball can make. Its surface is that of the deepest press.
    pub too_large: Vec<bool>,
}

impl Session {
    /// Returns the sensor with a pad of this thickness.
    pub fn sensor_at_thickness(&self, thickness_mm: f64) -> Sensor {
        Sensor { gelpad_thickness_mm: thickness_mm, ..self.sensor.clone() }
    }

    /// Returns the pad's material at this thickness.
    pub fn material_at_thickness(&self, thickness_mm: f64) -> Material {
        Material { thickness_mm, ..self.sensor.gelpad_material() }
    }

    /// Computes the pad's surface under each press.
    pub fn press_surfaces(&self, geometry: Geometry, model: &gelpad::Model) -> PressSurfaces {
        let material = self.material_at_thickness(geometry.thickness_mm);
        let pad = Pad::new(model, &material, &self.camera);
        let balls = Balls::new(self.observations.iter().map(|observation| observation.ball_radius_mm), &material);
        let press = |observation: &Observation| {
            let ball = balls.of_radius(observation.ball_radius_mm);
            let contact_mm = observation.circle.radius_px * self.camera.mm_per_px[0] * geometry.contact_over_disc;
            let found = ball.depth_mm(contact_mm);
            let depth_mm = found.unwrap_or(ball.deepest_mm());
            (ball.press(&pad, &self.camera, observation.circle.centre_px, depth_mm), (depth_mm, found.is_none()))
        };
        let (contacts, depths): (Vec<_>, Vec<_>) = self.observations.par_iter().map(press).unzip();
        let (depths_mm, too_large) = depths.into_iter().unzip();
        PressSurfaces { contacts, depths_mm, too_large }
    }

    /// Returns, for each press, whether its contact is larger than its ball can make in a pad of this geometry.
    pub fn find_too_large(&self, geometry: Geometry) -> Vec<bool> {
        let material = self.material_at_thickness(geometry.thickness_mm);
        let balls = Balls::new(self.observations.iter().map(|observation| observation.ball_radius_mm), &material);
        let is_too_large = |observation: &Observation| {
            let contact_mm = observation.circle.radius_px * self.camera.mm_per_px[0] * geometry.contact_over_disc;
            balls.of_radius(observation.ball_radius_mm).depth_mm(contact_mm).is_none()
        };
        self.observations.iter().map(is_too_large).collect()
    }

    /// Draws pixels of each press to learn from, up to `most` of each. Returns their indices, row after row.
    pub fn draw_places(&self, most: usize) -> Vec<Vec<usize>> {
        let of = |(k, observation): (usize, &Observation)| {
            draw_places(observation, &self.background, most, &mut random_stream(1, "calibration", k as u64))
        };
        self.observations.par_iter().enumerate().map(of).collect()
    }

    /// Collects the pixels at `places`, on these surfaces. `sky`: also compute how much of the sky is hidden.
    pub fn sample_pixels(&self, places: &[Vec<usize>], surfaces: &PressSurfaces, sky: bool) -> Vec<PixelSamples> {
        let of = |((observation, contact), places): ((&Observation, &Contact), &Vec<usize>)| {
            let mut pixels = PixelSamples::from_press(places, observation, contact, &self.background, &self.camera);
            if sky {
                pixels.fill_hidden_sky(places, contact, &self.camera);
            }
            pixels
        };
        self.observations.par_iter().zip(&surfaces.contacts).zip(places).map(of).collect()
    }

    /// Returns half the longer side of the view, mm.
    pub fn half_view_mm(&self) -> f64 {
        0.5 * self.sensor.field_of_view_mm[0].max(self.sensor.field_of_view_mm[1])
    }

    /// Returns the background image in the form that the shaders use.
    pub fn to_background_image(&self) -> BackgroundImage {
        let (width, height) = (self.background.width() as usize, self.background.height() as usize);
        BackgroundImage::new(width, height, self.background.as_raw().clone())
    }
}

/// This over the square of the number of presses is how many pixels are learnt elsewhere on the pad, too: with five
/// presses, as many as one press has.
const MOVED_PIXELS: usize = 100_000;

/// Fits one model to the pixels of several presses, and some of these pixels elsewhere on the pad, by LEDs that were
/// fitted to the same presses: few presses say little of most places. `seed` decides where training starts.
pub fn fit_response(
    session: &Session,
    pixels: &[&PixelSamples],
    leds: Option<&FittedLeds>,
    settings: &TrainingSettings,
    seed: u64,
    work: &ProgressMeter,
) -> CalibrationResponse {
    let mut all = PixelSamples::default();
    pixels.iter().for_each(|pixels| all.append(pixels));
    let moved = (MOVED_PIXELS / pixels.len().max(1).pow(2)).min(all.len() / 2);
    if let Some(moved) = leds.map(|leds| leds.move_pixels(&all, session, moved)) {
        all.append(&moved);
    }
    train::fit_networks(&all, pixels::common_range(pixels), session.half_view_mm(), settings, seed, work)
}

/// Makes a table of a fitted model.
pub fn build_table(response: CalibrationResponse, geometry: Geometry) -> CalibrationTable {
    CalibrationTable::new(CalibrationColors::Response(response), geometry.contact_over_disc)
}

/// Renders an 8-bit picture of `light` over the background image `rest`.
pub fn light_to_rgb(light: &Light, rest: &BackgroundImage) -> RgbImage {
    let mut rgb = rest.rgb.clone();
    let region = light.region;
    for row in 0..region.height() {
        let start = 3 * ((region.y0 + row) * rest.width + region.x0);
        for x in 0..region.width() {
            for (channel, plane) in light.planes.iter().enumerate() {
                rgb[start + 3 * x + channel] = quantise(plane[row * region.width() + x]);
            }
        }
    }
    RgbImage::from_raw(rest.width as u32, rest.height as u32, rgb).expect("three bytes for each pixel of the reference")
}
