//! From presses of a ball into a real sensor to the light that a simulated one gives: `gelsim calibrate`.
//!
//! For each press the pad's surface follows from circle and ball ([`geometry`]); pixels of all presses ([`pixels`]) teach
//! how colour follows from the surface ([`train`]). What holds for the surface of all presses, the pad's thickness and how
//! much larger the visible disc is than the contact, is chosen so that colour follows best ([`choose`]). Errors are those
//! of presses that were not learnt from ([`validate`]).

use gelsim_core::gelpad::material::Material;
use image::RgbImage;
use rayon::prelude::*;

use crate::presses::Circle;
use gelsim_core::base::light::Light;
use gelsim_core::base::light::quantise;
use gelsim_core::base::rng::stream;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::{self, Contact, Pad};
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::calibrated::response::Response;
use gelsim_core::optics::calibrated::{Colors, Table};
use gelsim_files::sensor::Sensor;

pub mod camera;
pub mod choose;
pub mod detect;
pub mod dots;
pub mod evaluate;
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
use pixels::{Pixels, places};
use progress::Work;
use train::Settings;

/// One press: what the camera saw, and where the ball touched.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The image's file, as the table of presses has it.
    pub file: String,
    /// The image; without dots, if any are printed on the pad.
    pub image: RgbImage,
    /// The disc that people see.
    pub circle: Circle,
    /// How sure it is, 0 to 1, if it was looked for.
    pub confidence: Option<f64>,
    /// Radius of the ball, mm.
    pub ball_radius_mm: f64,
    /// True at the pixels that dots cover, in the image or in the background; empty where none are printed.
    pub ink: Vec<bool>,
}

impl Observation {
    /// A press of a pad without dots, of which the circle is known.
    pub fn new(file: impl Into<String>, image: RgbImage, circle: Circle, ball_radius_mm: f64) -> Self {
        Self { file: file.into(), image, circle, confidence: None, ball_radius_mm, ink: Vec::new() }
    }

    /// True if a dot covers the pixel.
    fn is_inked(&self, at: usize) -> bool {
        self.ink.get(at).copied().unwrap_or(false)
    }
}

/// Dots printed on a pad, and its picture with them.
#[derive(Clone, Debug)]
pub struct PrintedDots {
    /// The dots.
    pub dots: Dots,
    /// The background image with them.
    pub background: RgbImage,
}

/// Presses of one sensor.
#[derive(Clone, Debug)]
pub struct Session {
    /// The sensor; its thickness and contact are still to be found.
    pub sensor: Sensor,
    /// Its view.
    pub camera: View,
    /// The background image: the untouched pad; without dots, if any are printed on it.
    pub background: RgbImage,
    /// The presses.
    pub observations: Vec<Observation>,
    /// The dots that are printed on the pad.
    pub printed: Option<PrintedDots>,
}

/// What decides the surface of all presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// Radius of the contact over that of the disc which people see.
    pub contact_over_disc: f64,
}

impl Geometry {
    /// Contact over disc where nothing is known of it.
    pub const USUAL_CONTACT: f64 = 0.95;
}

/// Surfaces of a session's presses.
pub struct Surfaces {
    /// One for each press.
    pub contacts: Vec<Contact>,
    /// How deep each was pressed, mm.
    pub depths_mm: Vec<f64>,
    /// True for a press whose contact is larger than any of such a ball; its surface is the deepest press's.
    pub too_large: Vec<bool>,
}

impl Session {
    /// The sensor with a pad of this thickness.
    pub fn sensor(&self, thickness_mm: f64) -> Sensor {
        Sensor { gelpad_thickness_mm: thickness_mm, ..self.sensor.clone() }
    }

    /// Its pad, at this thickness.
    pub fn material(&self, thickness_mm: f64) -> Material {
        Material { thickness_mm, ..self.sensor.material() }
    }

    /// The pad under each press.
    pub fn surfaces(&self, geometry: Geometry, model: &gelpad::Model) -> Surfaces {
        let material = self.material(geometry.thickness_mm);
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
        Surfaces { contacts, depths_mm, too_large }
    }

    /// True for each press whose contact is larger than any of its ball in such a pad.
    pub fn too_large(&self, geometry: Geometry) -> Vec<bool> {
        let material = self.material(geometry.thickness_mm);
        let balls = Balls::new(self.observations.iter().map(|observation| observation.ball_radius_mm), &material);
        let is_too_large = |observation: &Observation| {
            let contact_mm = observation.circle.radius_px * self.camera.mm_per_px[0] * geometry.contact_over_disc;
            balls.of_radius(observation.ball_radius_mm).depth_mm(contact_mm).is_none()
        };
        self.observations.iter().map(is_too_large).collect()
    }

    /// Places in the picture of each press, up to `most` of each, to learn from.
    pub fn places(&self, most: usize) -> Vec<Vec<usize>> {
        let of = |(k, observation): (usize, &Observation)| {
            places(observation, &self.background, most, &mut stream(1, "calibration", k as u64))
        };
        self.observations.par_iter().enumerate().map(of).collect()
    }

    /// What is there, on these surfaces; with `sky`, how much of it is hidden, too.
    pub fn pixels(&self, places: &[Vec<usize>], surfaces: &Surfaces, sky: bool) -> Vec<Pixels> {
        let of = |((observation, contact), places): ((&Observation, &Contact), &Vec<usize>)| {
            let mut pixels = Pixels::from_press(places, observation, contact, &self.background, &self.camera);
            if sky {
                pixels.look_up(places, contact, &self.camera);
            }
            pixels
        };
        self.observations.par_iter().zip(&surfaces.contacts).zip(places).map(of).collect()
    }

    /// Half the longer side of the view, mm.
    pub fn place_mm(&self) -> f64 {
        0.5 * self.sensor.field_of_view_mm[0].max(self.sensor.field_of_view_mm[1])
    }

    /// The background image as the shaders take it.
    pub fn reference(&self) -> BackgroundImage {
        let (width, height) = (self.background.width() as usize, self.background.height() as usize);
        BackgroundImage::new(width, height, self.background.as_raw().clone())
    }
}

/// Fits one model to the pixels of several presses.
pub fn fit(session: &Session, pixels: &[&Pixels], settings: &Settings, seed: u64, work: &Work) -> Response {
    let mut all = Pixels::default();
    pixels.iter().for_each(|pixels| all.append(pixels));
    train::fit(&all, pixels::range(pixels), session.place_mm(), settings, seed, work)
}

/// A table with a fitted model.
pub fn table(response: Response, geometry: Geometry) -> Table {
    Table::new(Colors::Response(response), geometry.contact_over_disc)
}

/// An 8-bit picture of `light` over `rest`.
pub fn picture(light: &Light, rest: &BackgroundImage) -> RgbImage {
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
