//! The sensor that is to be found out: an elastic pad at the reference level, four near coloured LEDs with shadows,
//! loss of light towards the corners, a noisy camera, and people who draw circles larger than the contact.

use std::sync::LazyLock;

use gelsim_core::base::grid::Rect;
use gelsim_core::base::light::Light;
use gelsim_core::base::rng::random_stream;
use gelsim_core::base::view::View;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::optics::calibrated::{self, Calibrated, CalibrationTable};
use gelsim_core::optics::{LightSource, Shader};
use gelsim_files::sensor::Sensor;
use gelsim_job::label::Label;
use gelsim_job::sample::render;
use gelsim_lab::calibrate::{Observation, Session, light_to_rgb};
use gelsim_lab::metrics::image::mae;
use gelsim_lab::presses::Circle;
use image::{RgbImage, imageops};
use rayon::prelude::*;

use crate::plan::plan;

pub const CAMERA: View = View { resolution_px: [200, 150], mm_per_px: [0.08; 2] };
pub const THICKNESS_MM: f64 = 3.5;
pub const CONTACT_OVER_DISC: f64 = 0.95;
const NOISE_LEVELS: f64 = 1.5;

const SENSOR: &str = "
fidelity = 'reference'
camera.vignette = 0.25
optics.led = { diffuse = 0.45, specular = 0.25, shininess = 6.0, shadows = { soft = { resolution = 'full' } } }
[sensor]
resolution_px = [200, 150]
field_of_view_mm = [16.0, 12.0]
gelpad_thickness_mm = 3.5
rendered_background = { color = [0.38, 0.42, 0.45], glow = 0.2, vignette = 0.2, grain = 0.01, grain_size_mm = 0.3 }
[[sensor.led]]
azimuth_deg = 80.0
elevation_deg = 20.0
distance_mm = 12.0
color = [1.0, 0.15, 0.1]
intensity = 0.8
[[sensor.led]]
azimuth_deg = 195.0
elevation_deg = 25.0
distance_mm = 11.0
color = [0.1, 1.0, 0.2]
intensity = 0.7
[[sensor.led]]
azimuth_deg = 310.0
elevation_deg = 22.0
distance_mm = 13.0
color = [0.15, 0.2, 1.0]
intensity = 0.9
[[sensor.led]]
azimuth_deg = 20.0
elevation_deg = 35.0
distance_mm = 14.0
color = [0.9, 0.9, 0.8]
intensity = 0.3
";

/// A press into the hidden sensor.
pub struct Press {
    /// What its camera would see without noise.
    pub image: RgbImage,
    pub contact: Contact,
    /// The disc that people see of a ball.
    pub disc: Circle,
    label: Label,
}

/// Presses of a bundled object; `pose` are the lines of the job's table.
pub fn presses(object: &str, pose: &str, depth_mm: &str, count: u64) -> Vec<Press> {
    let plan = plan(&format!(
        "object = [{{ path = 'objects/{object}.obj' }}]\ndataset = {{ name = 'hidden', samples = {count}, seed = 3 }}\n\
         indentation.depth_mm = {depth_mm}\noutput.layers = []\n{SENSOR}\n[pose]\n{pose}\n"
    ));
    let one = |index: u64| {
        let sample = render(&plan, index);
        let at = sample.label.pose.translation_mm;
        let centre_px = [0, 1].map(|k| (CAMERA.resolution_px[k] as f64 - 1.0) / 2.0 + at[k] / CAMERA.mm_per_px[k]);
        let contact_px = (sample.label.contact.area_mm2 / std::f64::consts::PI).sqrt() / CAMERA.mm_per_px[0];
        Press {
            image: rgb(&sample.impression.image.rgb),
            contact: sample.impression.contact,
            disc: Circle { centre_px, radius_px: contact_px / CONTACT_OVER_DISC },
            label: sample.label,
        }
    };
    (0..count).into_par_iter().map(one).collect()
}

fn rgb(bytes: &[u8]) -> RgbImage {
    let [width, height] = CAMERA.resolution_px.map(|px| px as u32);
    RgbImage::from_raw(width, height, bytes.to_vec()).expect("all pixels")
}

fn noisy(image: &RgbImage, levels: f64, seed: u64) -> RgbImage {
    let mut random = random_stream(seed, "noise", 0);
    let mut picture = image.clone();
    for value in picture.iter_mut() {
        *value = (f64::from(*value) + levels * random.standard_normal()).round().clamp(0.0, 255.0) as u8;
    }
    picture
}

/// Balls all over the view, to learn from.
pub static BALLS: LazyLock<Vec<Press>> =
    LazyLock::new(|| presses("sphere", "x_mm = [-5.6, 5.6]\ny_mm = [-3.8, 3.8]", "[0.2, 0.7]", 30));

/// Presses that nothing is learnt from, of four objects.
pub static UNSEEN: LazyLock<[(&str, Vec<Press>); 4]> = LazyLock::new(|| {
    let pose =
        |x: f64, y: f64, more: &str| format!("yaw_deg = [0.0, 360.0]\nx_mm = [-{x}, {x}]\ny_mm = [-{y}, {y}]\n{more}");
    [
        ("ball", presses("sphere", &pose(5.5, 3.7, ""), "[0.25, 0.65]", 6)),
        ("cylinder's side", presses("cylinder", &pose(3.0, 2.0, "face = '+x'"), "[0.3, 0.5]", 4)),
        ("cone's tip", presses("cone", &pose(4.0, 3.0, ""), "[0.4, 0.8]", 4)),
        ("dots", presses("dots", &pose(2.0, 1.5, ""), "[0.3, 0.5]", 4)),
    ]
});

/// The untouched pad: the mean of eight noisy pictures.
pub static BACKGROUND: LazyLock<RgbImage> = LazyLock::new(|| {
    let untouched = presses("sphere", "", "0.3\nindentation.no_contact = 1.0", 1);
    noisy(&untouched[0].image, NOISE_LEVELS / 8.0_f64.sqrt(), 1000)
});

/// What the user has of presses.
pub fn session<'a>(presses: impl IntoIterator<Item = &'a Press>) -> Session {
    let observation = |(k, press): (usize, &Press)| {
        Observation::new(format!("{k:02}.png"), noisy(&press.image, NOISE_LEVELS, k as u64), press.disc, 4.0)
    };
    let [width, height] = CAMERA.resolution_px;
    let sensor = Sensor {
        resolution_px: [width as u32, height as u32],
        field_of_view_mm: [0, 1].map(|k| CAMERA.resolution_px[k] as f64 * CAMERA.mm_per_px[k]),
        ..Sensor::default()
    };
    let observations = presses.into_iter().enumerate().map(observation).collect();
    Session { sensor, camera: CAMERA, background: BACKGROUND.clone(), observations, printed: None }
}

/// The picture of the untouched pad as shaders take it.
pub fn rest() -> BackgroundImage {
    let [width, height] = CAMERA.resolution_px;
    BackgroundImage::new(width, height, BACKGROUND.as_raw().clone())
}

/// A table's light of a surface.
pub fn light(table: &CalibrationTable, spacing_mm: f64, contact: &Contact, gate: EffectPolicy) -> Light {
    let shader = calibrated::CalibratedShader::new(Calibrated { spacing_mm }, Some(table), &CAMERA);
    shader.shade(contact, &rest(), &mut EffectLog::new(gate))
}

/// A table's picture of a surface.
pub fn simulated(table: &CalibrationTable, contact: &Contact) -> RgbImage {
    light_to_rgb(&light(table, Calibrated::default().spacing_mm, contact, EffectPolicy::WhereNeeded), &rest())
}

/// The picture of a surface by those who do not calibrate.
pub fn uncalibrated(contact: &Contact) -> RgbImage {
    let model = Fidelity::Standard.models(LightSource::Leds).optics;
    let shader = Shader::new(&model, None, &session([]).sensor.illumination(), &CAMERA, None);
    let (rest, mut effects) = (rest(), EffectLog::new(EffectPolicy::WhereNeeded));
    light_to_rgb(&shader.shade(contact, &rest, &mut effects).into_light(), &rest)
}

/// Mean absolute error around the contact, levels: in the box that holds it.
pub fn error(press: &Press, simulated: &RgbImage) -> f64 {
    let [x0, y0, x1, y1] = press.label.contact.bbox_px;
    let cut = |image: &RgbImage| imageops::crop_imm(image, x0, y0, x1 - x0, y1 - y0).to_image();
    mae(&cut(&press.image), &cut(simulated))
}

/// Mean of the errors of presses.
pub fn mean_error(presses: &[Press], simulated: impl Fn(&Contact) -> RgbImage) -> f64 {
    presses.iter().map(|press| error(press, &simulated(&press.contact))).sum::<f64>() / presses.len() as f64
}

/// The whole view with its border, of which `at` gives the displacement, mm, at each pixel.
pub fn surface(like: &Contact, at: impl Fn(usize, usize) -> f32) -> Contact {
    let mut contact = like.clone();
    let width = contact.surface.width;
    contact.surface.data.iter_mut().enumerate().for_each(|(k, w)| *w = at(k % width, k / width));
    contact.region = Rect::whole(width, contact.surface.height);
    contact
}
