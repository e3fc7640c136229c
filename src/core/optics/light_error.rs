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

use super::led::Led;
use super::near_light::bounce::Coat;
use super::near_light::window::{SILICONE_INDEX, Window};
use super::phong::{Equation, Phong, Shadows, SoftShadows};
use super::{Illumination, Model};
use crate::base::grid::Grid;
use crate::base::light::Light;
use crate::base::view::View;
use crate::gelpad::Contact;
use dents::{DentedPad, Lit};

mod dents;

/// Shell between gel and air where the sensor states no window, mm.
const SHELL_MM: f64 = 4.0;
/// Albedo where the sensor states none.
const ALBEDO: f64 = 0.4;
/// The share of the change that the most complete model leaves out: of diffuse light, and what a highlight adds.
const LEFT_OUT: f64 = 0.055;
const LEFT_OUT_BY_HIGHLIGHTS: f64 = 0.16;
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
        let pads = STEEPNESSES.map(|steepness| DentedPad::new(light, rest_levels, steepness));
        let [gentle, steep] = pads.each_ref().map(|pad| mean_sine_around(&pad.contact, &pad.view));
        if !(0.0 < gentle && gentle < steep) {
            return Err("the view is too narrow for the dents by which it is found");
        }
        let through = |(cause, [few, many]): (Cause, [f64; 2])| {
            let square = ((many / steep - few / gentle) / (steep - gentle)).max(0.0);
            (cause, [(few / gentle - square * gentle).max(0.0), square])
        };
        Ok(Self { causes: find_causes(&pads, phong, near, light).into_iter().map(through).collect() })
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

/// Finds the levels that a model with these parameters leaves out on two pads, by each cause.
fn find_causes(pads: &[DentedPad; 2], phong: &Phong, near: bool, light: &Illumination) -> Vec<(Cause, [f64; 2])> {
    let usual_window = Window { distance_mm: light.thickness_mm + SHELL_MM, refractive_index: SILICONE_INDEX };
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
    let shade = |lit: Lit| {
        let shader = lit.shader(light, &pads[0].view);
        pads.each_ref().map(|pad| pad.shade(&shader))
    };
    let difference =
        |a: &[Light; 2], b: &[Light; 2]| std::array::from_fn::<f64, 2, _>(|k| pads[k].mean_difference(&a[k], &b[k]));
    let full = shade(most);
    let lost = |without: Lit| difference(&full, &shade(without));
    let mut causes = Vec::new();
    if !near {
        let bare = Lit { phong: unshadowed, window: None, coat: Coat::default(), ..most };
        causes.push((Cause::Distance, difference(&shade(bare), &shade(Lit { near: false, ..bare }))));
    }
    if phong.shadows == Shadows::None {
        causes.push((Cause::Shadows, lost(Lit { phong: unshadowed, ..most })));
    }
    if most.window.is_some() && (!near || light.window.is_none()) {
        causes.push((Cause::Mirror, lost(Lit { window: None, ..most })));
    }
    if !near || light.coat.albedo <= 0.0 {
        causes.push((Cause::Bounce, lost(Lit { coat: Coat::default(), ..most })));
    }
    let highlights = phong.specular / (phong.diffuse + phong.specular).max(f64::MIN_POSITIVE);
    let share = LEFT_OUT + LEFT_OUT_BY_HIGHLIGHTS * highlights;
    let change = difference(&full, &pads.each_ref().map(DentedPad::untouched));
    causes.push((Cause::Remainder, change.map(|levels| levels * share)));
    causes
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
    // First along y, for all columns at once.
    let mut columns = vec![0; mask.width];
    for (y, rows) in mask.data.chunks(cell_px[1] * mask.width).enumerate() {
        columns.fill(0);
        for row in rows.chunks_exact(mask.width) {
            columns.iter_mut().zip(row).for_each(|(column, pixel)| *column |= pixel);
        }
        for (cell, columns) in touched.row_mut(y).iter_mut().zip(columns.chunks(cell_px[0])) {
            *cell = columns.iter().fold(0, |all, column| all | column);
        }
    }
    let reach: [usize; 2] =
        std::array::from_fn(|k| (AROUND_MM / (view.mm_per_px[k] * cell_px[k] as f64) + 0.5) as usize);
    // First along x, then along y.
    let mut beside: Grid<u8> = Grid::new(count[0], count[1]);
    for y in 0..count[1] {
        let near = beside.row_mut(y);
        for (x, _) in touched.row(y).iter().enumerate().filter(|(_, cell)| **cell > 0) {
            near[x.saturating_sub(reach[0])..(x + reach[0] + 1).min(count[0])].fill(1);
        }
    }
    let mut places = Vec::new();
    for y in 0..count[1] {
        let rows = y.saturating_sub(reach[1])..(y + reach[1] + 1).min(count[1]);
        for x in (0..count[0]).filter(|x| rows.clone().any(|row| beside.at(*x, row) > 0)) {
            places.push([
                (x * cell_px[0] + cell_px[0] / 2).min(mask.width - 1),
                (y * cell_px[1] + cell_px[1] / 2).min(mask.height - 1),
            ]);
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_too_narrow_for_dents_is_said_to_be_unknown_and_others_are_known() {
        let leds = [Led::default()];
        let light = |field_of_view_mm| Illumination {
            leds: &leds,
            lamps: &[],
            field_of_view_mm,
            thickness_mm: 3.0,
            is_photograph: false,
            darkening: 0.0,
            stray_light: None,
            residual: None,
            window: None,
            coat: Coat::default(),
        };
        let find =
            |field_of_view_mm| LightError::new(&Model::Phong(Phong::default()), &light(field_of_view_mm), [128.0; 3]);
        assert!(find([1000.0, 0.1]).is_err_and(|why| why.contains("narrow")));
        for size_mm in [[16.0, 12.0], [0.1, 0.08], [1e4, 1e4]] {
            let known = find(size_mm).expect("dents fit");
            assert!(known.causes.iter().all(|(_, levels)| levels.iter().all(|levels| levels.is_finite())), "{known:?}");
            assert!(known.causes.iter().any(|(_, levels)| levels[0] + levels[1] > 0.0), "{known:?}");
        }
    }
}
