//! A pad with dents all over a sensor's view, and its light by any model of the LEDs.

use super::places_around;
use crate::base::grid::Rect;
use crate::base::light::Light;
use crate::base::view::{SURFACE_BORDER, View};
use crate::effects::{EffectLog, EffectPolicy};
use crate::gelpad::{self, Contact, Numerics};
use crate::optics::Illumination;
use crate::optics::background::BackgroundImage;
use crate::optics::led_shader::LedShader;
use crate::optics::near_light::bounce::Coat;
use crate::optics::near_light::window::Window;
use crate::optics::phong::Phong;

/// Pixels of the longer side of the view.
const LONG_SIDE_PX: f64 = 64.0;

/// What lights the dents.
#[derive(Clone, Copy)]
pub(super) struct Lit<'a> {
    pub phong: Phong,
    pub near: bool,
    pub window: Option<&'a Window>,
    pub coat: Coat,
}

/// A pad with dents over a sensor's view.
pub(super) struct DentedPad {
    pub view: View,
    pub contact: Contact,
    rest: BackgroundImage,
    /// Pixels within the contacts and around them.
    around: Vec<[usize; 2]>,
}

impl Lit<'_> {
    /// Prepares the LEDs of a sensor, lit so, for the view of its dented pads.
    pub fn shader(self, light: &Illumination, view: &View) -> LedShader {
        let light = Illumination { window: self.window, coat: self.coat, is_photograph: false, ..*light };
        LedShader::new(self.phong, self.near, &light, view, None)
    }
}

impl DentedPad {
    /// Dents the pad of a sensor.
    pub fn new(light: &Illumination, rest_levels: [f64; 3], steepness: f64) -> Self {
        let size_mm = light.field_of_view_mm;
        let pixel_mm = size_mm[0].max(size_mm[1]) / LONG_SIDE_PX;
        let resolution_px = size_mm.map(|mm| ((mm / pixel_mm) as usize).max(8));
        let view = View { resolution_px, mm_per_px: std::array::from_fn(|k| size_mm[k] / resolution_px[k] as f64) };
        let [width, height] = resolution_px;
        let mut contact = gelpad::no_contact(width, height, None, Numerics::DIRECT);
        let dents = Dents { size_mm, radius_mm: 0.1 * size_mm[0].min(size_mm[1]), steepness };
        for y in 0..contact.surface.height {
            for x in 0..contact.surface.width {
                let at = [x, y].map(|at| at as f64 + 0.5 - SURFACE_BORDER as f64);
                contact.surface.row_mut(y)[x] = dents.height_mm(view.point_mm(at)).0 as f32;
            }
        }
        for y in 0..height {
            for x in 0..width {
                let place = view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                contact.mask.row_mut(y)[x] = if dents.height_mm(place).1 { 255 } else { 0 };
            }
        }
        contact.region = Rect::whole(contact.surface.width, contact.surface.height);
        let levels = rest_levels.map(|level| level.clamp(0.0, 255.0) as u8);
        let rest = BackgroundImage::new(width, height, levels.repeat(width * height));
        let around = places_around(&contact.mask, &view);
        Self { view, contact, rest, around }
    }

    /// Computes the light of the pad.
    pub fn shade(&self, shader: &LedShader) -> Light {
        shader.shade(&self.contact, &self.rest, &mut EffectLog::new(EffectPolicy::All)).into_light()
    }

    /// Returns the light of the pad without dents.
    pub fn untouched(&self) -> Light {
        self.rest.light(Rect::whole(self.rest.width, self.rest.height))
    }

    /// Returns the mean difference of two lights in the contacts and around them, grey levels.
    pub fn mean_difference(&self, a: &Light, b: &Light) -> f64 {
        let mut sum = 0.0;
        for [x, y] in &self.around {
            let at = y * self.view.resolution_px[0] + x;
            sum += a.planes.iter().zip(&b.planes).map(|(a, b)| f64::from((a[at] - b[at]).abs())).sum::<f64>();
        }
        255.0 * sum / (3 * self.around.len().max(1)) as f64
    }
}

/// A ring in the middle of the view, and balls and punches around it, pressed in.
struct Dents {
    size_mm: [f64; 2],
    /// Radius of the balls' contacts, mm.
    radius_mm: f64,
    /// The slope of the balls at the edges of their contacts.
    steepness: f64,
}

/// What is pressed in.
#[derive(Clone, Copy)]
enum Indenter {
    Ball,
    Punch,
    Ring,
}

impl Dents {
    const PLACES: [(Indenter, [f64; 2]); 5] = [
        (Indenter::Ring, [0.0, 0.0]),
        (Indenter::Ball, [-0.25, -0.25]),
        (Indenter::Punch, [0.25, -0.25]),
        (Indenter::Punch, [-0.25, 0.25]),
        (Indenter::Ball, [0.25, 0.25]),
    ];

    /// Returns the height of the surface, mm, and whether something touches it there.
    fn height_mm(&self, [x, y]: [f64; 2]) -> (f64, bool) {
        let from = |(_, [u, v]): &(Indenter, [f64; 2])| libm::hypot(x - u * self.size_mm[0], y - v * self.size_mm[1]);
        let nearest = Self::PLACES.iter().min_by(|a, b| from(a).total_cmp(&from(b))).expect("there are places");
        let (kind, off) = (nearest.0, from(nearest) / self.radius_mm);
        // Over the radius: each ends as steeply as the rubber beside it begins.
        let (height, touches) = match kind {
            Indenter::Ball if off < 1.0 => (1.0 - 0.5 * off * off, true),
            Indenter::Ball => (0.5 * libm::exp(2.0 - 2.0 * off), false),
            Indenter::Punch => (libm::exp(-5.0 * (off - 2.2).max(0.0)), off < 2.2),
            Indenter::Ring => (libm::exp(-5.0 * ((off - 1.0).abs() - 0.2).max(0.0)), (off - 1.0).abs() < 0.2),
        };
        (self.steepness * self.radius_mm * height, touches)
    }
}
