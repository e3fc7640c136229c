//! How much of the light as it travels a model of the LEDs leaves out.
//!
//! The models of this crate differ in what they leave out: `phong` takes the LEDs at infinity, `led` may lack shadows, a
//! window or a coat that scatters. Each of these is worth what the most complete model loses without it, on dents all
//! over the sensor's own view: the mean change over contact and surroundings. Dents of two steepnesses give it as a
//! second-degree polynomial of the mean sine of the slope there; a press is worth that of its own sine. What the sensor
//! does not say is taken as usual: a window behind gel and shell, a coat that scatters two fifths of the light.
//!
//! What the most complete model leaves out itself is a share of the change by the press, found on traced light
//! (docs/explanation/light.md). Causes are independent of each other: squares are summed.

use super::background::BackgroundImage;
use super::led::Led;
use super::led_shader::LedShader;
use super::near_light::bounce::Coat;
use super::near_light::window::Window;
use super::phong::{Equation, Phong, Shadows, SoftShadows};
use super::{Illumination, Model};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::view::{SURFACE_BORDER, View};
use crate::effects::{EffectLog, EffectPolicy};
use crate::gelpad::{self, Contact, Numerics};

/// Shell between gel and air where the sensor states no window, mm.
const SHELL_MM: f64 = 4.0;
const REFRACTIVE_INDEX: f64 = 1.41;
/// Albedo where the sensor states none.
const ALBEDO: f64 = 0.4;
/// The share of the change that the most complete model leaves out: of diffuse light, and what a highlight adds.
const LEFT_OUT: f64 = 0.055;
const LEFT_OUT_BY_HIGHLIGHTS: f64 = 0.16;
/// Pixels of the longer side of the view on which the dents are shaded.
const LONG_SIDE_PX: f64 = 96.0;
/// Slopes of the two sets of dents.
const STEEPNESSES: [f64; 2] = [0.25, 0.75];
/// What surrounds a contact, mm.
const AROUND_MM: f64 = 1.0;

/// Why light differs from light as it travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cause {
    /// LEDs are taken at infinity.
    Distance,
    /// No shadows fall.
    Shadows,
    /// The window shows no image of the LEDs.
    Mirror,
    /// The coat throws no light onto itself.
    Bounce,
    /// What no model of this crate computes.
    Remainder,
}

impl Cause {
    /// What is left out, in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Distance => "the LEDs' distance",
            Self::Shadows => "shadows",
            Self::Mirror => "the mirror",
            Self::Bounce => "the bounce",
            Self::Remainder => "what no model computes",
        }
    }

    /// What a job writes so that it is computed; `None` if nothing makes it so.
    pub fn remedy(self) -> Option<&'static str> {
        match self {
            Self::Distance => Some("optics = \"led\""),
            Self::Shadows => Some("leave shadows = \"none\" out"),
            Self::Mirror => Some("optics = \"led\", and window.distance_mm under [sensor]"),
            Self::Bounce => Some("optics = \"led\", and coat.albedo under [sensor]"),
            Self::Remainder => None,
        }
    }
}

/// What a model of a sensor's light leaves out.
#[derive(Clone, Debug, PartialEq)]
pub struct LightError {
    /// Grey levels by each cause: factors of the mean sine of the slope in the contact and around it, and of its square.
    causes: Vec<(Cause, [f64; 2])>,
}

impl LightError {
    /// Finds what `model` leaves out on a flat pad whose untouched picture has these mean levels.
    ///
    /// # Errors
    ///
    /// Why it is not known.
    pub fn new(model: &Model, light: &Illumination, rest_levels: [f64; 3]) -> Result<Self, &'static str> {
        let Some(phong) = model.phong() else { return Err("the light is as it was measured") };
        if light.residual.is_some() || light.leds.iter().any(|led| led.pattern.is_some()) {
            return Err("the light was fitted to pictures");
        }
        let near = matches!(model, Model::Led(_));
        let [gentle, steep] = STEEPNESSES.map(|steepness| {
            let scene = Scene::new(light, rest_levels, steepness);
            (find_causes(&scene, phong, near, light), mean_sine_around(&scene.contact, &scene.view))
        });
        let through = |cause: Cause, levels: [f64; 2]| {
            let [of_gentle, of_steep] = [levels[0] / gentle.1, levels[1] / steep.1];
            let square = ((of_steep - of_gentle) / (steep.1 - gentle.1)).max(0.0);
            (cause, [(of_gentle - square * gentle.1).max(0.0), square])
        };
        let pairs = gentle.0.iter().zip(&steep.0);
        Ok(Self { causes: pairs.map(|((cause, few), (_, many))| through(*cause, [*few, *many])).collect() })
    }

    /// Returns the levels that a press leaves out by each cause: means over the contact and the millimetre around it,
    /// 0 without a contact.
    pub fn levels_by_cause(&self, contact: &Contact, view: &View) -> Vec<(Cause, f64)> {
        let sine = mean_sine_around(contact, view);
        self.causes.iter().map(|(cause, [linear, square])| (*cause, sine * (linear + sine * square))).collect()
    }

    /// Returns the levels that a press leaves out.
    pub fn levels(&self, contact: &Contact, view: &View) -> f64 {
        self.levels_by_cause(contact, view).iter().map(|(_, levels)| levels * levels).sum::<f64>().sqrt()
    }
}

/// Finds the levels that a model with these parameters leaves out on dents, by each cause.
fn find_causes(scene: &Scene, phong: &Phong, near: bool, light: &Illumination) -> Vec<(Cause, f64)> {
    let usual_window = Window { distance_mm: light.thickness_mm + SHELL_MM, refractive_index: REFRACTIVE_INDEX };
    let is_inside = |led: &Led| {
        let place = led.place();
        -place.direction[2] * place.distance_mm < usual_window.distance_mm
    };
    // LEDs beyond the window that is usual are not mirrored in it.
    let usual_window = light.leds.iter().all(is_inside).then_some(&usual_window);
    let most = Lit {
        phong: Phong { shadows: Shadows::Soft(SoftShadows::default()), equation: Equation::Relative, ..*phong },
        near: true,
        window: light.window.or(usual_window),
        coat: if light.coat.albedo > 0.0 { light.coat } else { Coat { albedo: ALBEDO } },
    };
    let unshadowed = Phong { shadows: Shadows::None, ..most.phong };
    let full = scene.shade(light, most);
    let lost = |without: Lit| scene.mean_difference(&full, &scene.shade(light, without));
    let mut causes = Vec::new();
    if !near {
        let bare = Lit { phong: unshadowed, window: None, coat: Coat::default(), ..most };
        let [near, distant] = [true, false].map(|near| scene.shade(light, Lit { near, ..bare }));
        causes.push((Cause::Distance, scene.mean_difference(&near, &distant)));
    }
    if phong.shadows == Shadows::None {
        causes.push((Cause::Shadows, lost(Lit { phong: unshadowed, ..most })));
    }
    if !near || light.window.is_none() {
        causes.push((Cause::Mirror, lost(Lit { window: None, ..most })));
    }
    if !near || light.coat.albedo <= 0.0 {
        causes.push((Cause::Bounce, lost(Lit { coat: Coat::default(), ..most })));
    }
    let highlights = phong.specular / (phong.diffuse + phong.specular).max(f64::MIN_POSITIVE);
    let change = scene.mean_difference(&full, &scene.untouched());
    causes.push((Cause::Remainder, change * (LEFT_OUT + LEFT_OUT_BY_HIGHLIGHTS * highlights)));
    causes
}

/// What lights the dents.
#[derive(Clone, Copy)]
struct Lit<'a> {
    phong: Phong,
    near: bool,
    window: Option<&'a Window>,
    coat: Coat,
}

/// Dents over a sensor's view.
struct Scene {
    view: View,
    contact: Contact,
    rest: BackgroundImage,
}

impl Scene {
    fn new(light: &Illumination, rest_levels: [f64; 3], steepness: f64) -> Self {
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
        Self { view, contact, rest }
    }

    fn shade(&self, light: &Illumination, Lit { phong, near, window, coat }: Lit<'_>) -> Light {
        let light = Illumination { window, coat, is_photograph: false, ..*light };
        let shader = LedShader::new(phong, near, &light, &self.view, None);
        shader.shade(&self.contact, &self.rest, &mut EffectLog::new(EffectPolicy::All)).into_light()
    }

    fn untouched(&self) -> Light {
        self.rest.light(Rect::whole(self.rest.width, self.rest.height))
    }

    /// Returns the mean difference of two lights in the contacts and around them, grey levels.
    fn mean_difference(&self, a: &Light, b: &Light) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for [x, y] in places_around(&self.contact.mask, &self.view) {
            let at = y * self.view.resolution_px[0] + x;
            sum += a.planes.iter().zip(&b.planes).map(|(a, b)| f64::from((a[at] - b[at]).abs())).sum::<f64>();
            count += 3;
        }
        255.0 * sum / f64::from(count.max(1))
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
enum Kind {
    Ball,
    Punch,
    Ring,
}

impl Dents {
    const PLACES: [(Kind, [f64; 2]); 5] = [
        (Kind::Ring, [0.0, 0.0]),
        (Kind::Ball, [-0.25, -0.25]),
        (Kind::Punch, [0.25, -0.25]),
        (Kind::Punch, [-0.25, 0.25]),
        (Kind::Ball, [0.25, 0.25]),
    ];

    /// Returns the height of the surface, mm, and whether something touches it there.
    fn height_mm(&self, [x, y]: [f64; 2]) -> (f64, bool) {
        let from = |(_, [u, v]): &(Kind, [f64; 2])| libm::hypot(x - u * self.size_mm[0], y - v * self.size_mm[1]);
        let nearest = Self::PLACES.iter().min_by(|a, b| from(a).total_cmp(&from(b))).expect("there are places");
        let (kind, off) = (nearest.0, from(nearest) / self.radius_mm);
        // Over the radius: each ends as steeply as the rubber beside it begins.
        let (height, touches) = match kind {
            Kind::Ball if off < 1.0 => (1.0 - 0.5 * off * off, true),
            Kind::Ball => (0.5 * libm::exp(2.0 - 2.0 * off), false),
            Kind::Punch => (libm::exp(-5.0 * (off - 2.2).max(0.0)), off < 2.2),
            Kind::Ring => (libm::exp(-5.0 * ((off - 1.0).abs() - 0.2).max(0.0)), (off - 1.0).abs() < 0.2),
        };
        (self.steepness * self.radius_mm * height, touches)
    }
}

/// Returns the mean sine of the surface's slope over the contact and what surrounds it; 0 without a contact.
fn mean_sine_around(contact: &Contact, view: &View) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    let per_slope = view.mm_per_px.map(|pixel_mm| 0.5 / pixel_mm);
    for [x, y] in places_around(&contact.mask, view) {
        let at = |dx: usize, dy: usize| f64::from(contact.surface.at(x + dx, y + dy));
        let slopes = [(at(2, 1) - at(0, 1)) * per_slope[0], (at(1, 2) - at(1, 0)) * per_slope[1]];
        let square = slopes[0] * slopes[0] + slopes[1] * slopes[1];
        sum += (square / (1.0 + square)).sqrt();
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

/// Returns pixels, one of each cell of a grid, that lie within the contact or around it.
fn places_around(mask: &Grid<u8>, view: &View) -> Vec<[usize; 2]> {
    let cell_px: [usize; 2] = view.mm_per_px.map(|pixel_mm| ((0.25 * AROUND_MM / pixel_mm) as usize).max(1));
    let count = [mask.width.div_ceil(cell_px[0]), mask.height.div_ceil(cell_px[1])];
    let mut touched: Grid<u8> = Grid::new(count[0], count[1]);
    for y in 0..mask.height {
        let cells = touched.row_mut(y / cell_px[1]);
        for (cell, pixels) in cells.iter_mut().zip(mask.row(y).chunks(cell_px[0])) {
            *cell |= pixels.iter().fold(0, |all, pixel| all | pixel);
        }
    }
    let reach: [usize; 2] =
        std::array::from_fn(|k| (AROUND_MM / (view.mm_per_px[k] * cell_px[k] as f64) + 0.5) as usize);
    let mut places = Vec::new();
    for y in 0..count[1] {
        let rows = y.saturating_sub(reach[1])..(y + reach[1] + 1).min(count[1]);
        for x in 0..count[0] {
            let columns = x.saturating_sub(reach[0])..(x + reach[0] + 1).min(count[0]);
            if rows.clone().any(|row| touched.row(row)[columns.clone()].iter().any(|cell| *cell > 0)) {
                places.push([
                    (x * cell_px[0] + cell_px[0] / 2).min(mask.width - 1),
                    (y * cell_px[1] + cell_px[1] / 2).min(mask.height - 1),
                ]);
            }
        }
    }
    places
}
