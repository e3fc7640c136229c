//! Light of lamps whose brightness was measured at every slope, as GelSight publishes it for its sensors
//! (gelsightinc/gssim).
//!
//! The sensor takes one grey image under each of its lamps. At the place (x, y) that of one lamp is
//!
//! ```text
//! grey = clamp(f(n, x, y) F(x, y), 0, 1)
//! f = q0 nx^2 + q1 2 nx ny + q2 2 nx nz + q3 ny^2 + q4 2 ny nz + q5 nz^2 + q6 nx + q7 ny + q8 nz + q9
//! ```
//!
//! with each q a quadratic polynomial in the place and F the lamp's flat field. The normal is n = (-dw/dx, -dw/dy, 1),
//! normalised, w the displacement into the pad: a height map that grows towards the camera, with x to the right and y
//! down as in the image. The published code takes gradients of its height map in the same axes, so that n is our normal
//! ([`super::normals`]) with z turned round.
//!
//! The tactile image is a composite: each lamp's grey image times its colour, added up. As with every other model, it
//! is relative to the untouched pad: the background image, plus what the press changes in the composite. A sensor
//! without a photograph has the composite of the flat pad as its background image, so its tactile image is the
//! composite of the press.

use serde::{Deserialize, Serialize};

use super::background::BackgroundImage;
use super::led::Normals;
use super::normals::fill_row_normals;
use super::threshold::{INVISIBLE_CHANGE, Threshold};
use crate::base::grid::{Grid, Rect};
use crate::base::light::{Light, quantise};
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;

/// Number of lamps of a sensor that has any.
pub const LAMP_COUNT: usize = 6;
/// Coefficients of the quadratic form in the normal.
pub const COEFFICIENTS: usize = 10;
/// Terms of a quadratic polynomial in the place: 1, y, y^2, x, x y, x^2.
pub const PLACE_TERMS: usize = 6;
/// Terms of a polynomial of fourth degree in the place, in the order of [`super::background::Pattern`].
pub const FLAT_FIELD_TERMS: usize = 15;

/// The optics model `lamps`. It has no parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Lamps {}

/// A lamp, for the optics model `lamps`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// What messages and docs call it.
    pub name: String,
    /// Share of its grey image in red, green and blue of the tactile image, 0 to 1.
    pub color: [f64; 3],
    /// The factors of nx^2, 2 nx ny, 2 nx nz, ny^2, 2 ny nz, nz^2, nx, ny, nz and 1, n the unit normal towards the
    /// camera: each a polynomial in the place, the factors of 1, y, y^2, x, x y, x^2. Place is counted from the middle
    /// of the view, x to the right and y down, in units of its shorter side.
    pub quadratic: [[f64; PLACE_TERMS]; COEFFICIENTS],
    /// What the grey image of an even pad is multiplied by: a polynomial of fourth degree in the place, each of x and y
    /// from -1 at the left and the top of the image to 1, with the order of `rendered_background.pattern`.
    pub flat_field: [f64; FLAT_FIELD_TERMS],
}

impl Lamp {
    /// Returns every number of the lamp, with its path below the lamp's table.
    pub fn numbers(&self) -> impl Iterator<Item = (String, f64)> {
        let color = self.color.iter().enumerate().map(|(k, value)| (format!("color.{k}"), *value));
        let quadratic = self.quadratic.iter().enumerate().flat_map(|(m, polynomial)| {
            polynomial.iter().enumerate().map(move |(k, value)| (format!("quadratic.{m}.{k}"), *value))
        });
        let flat_field = self.flat_field.iter().enumerate().map(|(k, value)| (format!("flat_field.{k}"), *value));
        color.chain(quadratic).chain(flat_field)
    }
}

/// Lamps prepared for one view.
pub struct LampShader {
    view: View,
    lamps: Vec<PreparedLamp>,
    /// Places of the columns.
    columns: Columns,
    threshold: Threshold,
}

/// The place of each column of the view.
struct Columns {
    /// In units of the view's shorter side, from its middle.
    short: Vec<f32>,
    /// From -1 at the left to 1.
    unit: Vec<f32>,
}

/// A lamp whose mixed terms have their factor of 2 built in.
struct PreparedLamp {
    color: [f32; 3],
    quadratic: [[f64; PLACE_TERMS]; COEFFICIENTS],
    flat_field: [f64; FLAT_FIELD_TERMS],
}

/// A lamp along a row: polynomials in x alone.
struct LampRow {
    quadratic: [[f32; 3]; COEFFICIENTS],
    flat_field: [f32; 5],
}

impl LampShader {
    /// Prepares the lamps of a sensor.
    pub fn new(lamps: &[Lamp], view: &View) -> Self {
        let width = view.resolution_px[0];
        let [width_mm, height_mm] = [0, 1].map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
        let short_mm = width_mm.min(height_mm);
        let units: Vec<f64> = (0..width).map(|x| (2.0 * x as f64 + 1.0) / width as f64 - 1.0).collect();
        let columns = Columns {
            short: units.iter().map(|x| (0.5 * x * width_mm / short_mm) as f32).collect(),
            unit: units.iter().map(|x| *x as f32).collect(),
        };
        let prepared = |lamp: &Lamp| {
            let mut quadratic = lamp.quadratic;
            for mixed in [1, 2, 4] {
                quadratic[mixed] = quadratic[mixed].map(|factor| 2.0 * factor);
            }
            PreparedLamp { color: lamp.color.map(|share| share as f32), quadratic, flat_field: lamp.flat_field }
        };
        let lamps: Vec<PreparedLamp> = lamps.iter().map(prepared).collect();
        let threshold = lamp_threshold(&lamps, [0.5 * width_mm / short_mm, 0.5 * height_mm / short_mm]);
        Self { view: *view, lamps, columns, threshold }
    }

    /// Evaluates the polynomials of a lamp along row `y` of the view.
    fn prepare_row(&self, lamp: &PreparedLamp, y: usize) -> LampRow {
        let View { resolution_px: [width, height], mm_per_px: [mm_per_px_x, mm_per_px_y] } = self.view;
        let (width_mm, height_mm) = (width as f64 * mm_per_px_x, height as f64 * mm_per_px_y);
        let unit = (2.0 * y as f64 + 1.0) / height as f64 - 1.0;
        let y = 0.5 * unit * height_mm / width_mm.min(height_mm);
        let quadratic = lamp
            .quadratic
            .map(|[c, cy, cyy, cx, cxy, cxx]| [c + y * (cy + y * cyy), cx + y * cxy, cxx].map(|value| value as f32));
        let [c, cy, cy2, cy3, cy4, cx, cxy, cxy2, cxy3, cxx, cxxy, cxxy2, cx3, cx3y, cx4] = lamp.flat_field;
        let y = unit;
        let flat_field = [
            c + y * (cy + y * (cy2 + y * (cy3 + y * cy4))),
            cx + y * (cxy + y * (cxy2 + y * cxy3)),
            cxx + y * (cxxy + y * cxxy2),
            cx3 + y * cx3y,
            cx4,
        ];
        LampRow { quadratic, flat_field: flat_field.map(|value| value as f32) }
    }

    /// Renders the grey image of each lamp over a surface on the grid of [`Contact::surface`], 0 to 1.
    pub fn render_grey(&self, surface: &Grid<f32>) -> Vec<Grid<f32>> {
        let [width, height] = self.view.resolution_px;
        let mut planes: Vec<Grid<f32>> = self.lamps.iter().map(|_| Grid::new(width, height)).collect();
        let mut normals = Normals::default();
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..height {
                    let part = Rect { x0: 0, y0: y, x1: width, y1: y + 1 };
                    fill_row_normals(self.view.mm_per_px, surface, part, 0, &mut normals);
                    for (lamp, plane) in self.lamps.iter().zip(&mut planes) {
                        let row = self.prepare_row(lamp, y);
                        row.fill_grey(&self.columns, 0, &normals, plane.row_mut(y), |pressed, _| pressed);
                    }
                }
            },
        );
        planes
    }

    /// Renders the composite of the flat pad.
    pub fn render_background(&self) -> BackgroundImage {
        let [width, height] = self.view.resolution_px;
        let level = Normals { x: vec![0.0; width], y: vec![0.0; width], z: vec![-1.0; width] };
        let (mut grey, mut sums) = (vec![0.0_f32; width], vec![[0.0_f32; 3]; width]);
        let mut rgb = Vec::with_capacity(3 * width * height);
        for y in 0..height {
            sums.fill([0.0; 3]);
            for lamp in &self.lamps {
                self.prepare_row(lamp, y).fill_grey(&self.columns, 0, &level, &mut grey, |_, rest| rest);
                for (sums, grey) in sums.iter_mut().zip(&grey) {
                    sums.iter_mut().zip(lamp.color).for_each(|(sum, share)| *sum += share * grey);
                }
            }
            rgb.extend(sums.iter().flatten().map(|value| quantise(*value)));
        }
        BackgroundImage::new(width, height, rgb)
    }

    /// Computes the light from the pad where it differs from that of the untouched pad, whose picture is `rest`.
    pub fn shade(&self, contact: &Contact, rest: &BackgroundImage, effects: &mut EffectLog) -> Light {
        let bent = effects.run_timed(Effect::Shading, || self.threshold.visible_region(contact, &self.view));
        let need = match bent.is_empty() {
            true => Requirement::Unneeded("the surface is flat"),
            false => Requirement::Needed("the surface is not flat"),
        };
        let shades = effects.enable(Effect::Shading, need);
        effects.enable(Effect::Grain, Requirement::Absent("the lamps were measured on a smooth pad"));
        effects.enable(Effect::Shadows, Requirement::Absent("the lamps' light is without shadows"));
        for effect in [Effect::Mirror, Effect::Bounce] {
            effects.enable(effect, Requirement::Absent("the measured light holds it"));
        }
        effects.enable(Effect::Darkening, Requirement::Absent("the lamps' light does not depend on depth"));
        if !shades {
            return Light::default();
        }
        let region = if effects.runs_everywhere() { Rect::whole(rest.width, rest.height) } else { bent };
        effects.run_timed(Effect::Shading, || {
            let mut light = rest.light(region);
            if !region.is_empty() {
                self.add_change(&mut light, &contact.surface);
            }
            light
        })
    }

    /// Adds to the untouched pad's light what the surface changes.
    fn add_change(&self, light: &mut Light, surface: &Grid<f32>) {
        let Light { region, planes } = light;
        let width = region.width();
        let (mut normals, mut change) = (Normals::default(), vec![0.0; width]);
        simd_dispatch(
            #[inline(always)]
            || {
                for row in 0..region.height() {
                    fill_row_normals(self.view.mm_per_px, surface, *region, row, &mut normals);
                    for lamp in &self.lamps {
                        let along = self.prepare_row(lamp, region.y0 + row);
                        along
                            .fill_grey(&self.columns, region.x0, &normals, &mut change, |pressed, rest| pressed - rest);
                        for (plane, share) in planes.iter_mut().zip(lamp.color).filter(|(_, share)| *share != 0.0) {
                            for (value, change) in plane[row * width..][..width].iter_mut().zip(&change) {
                                *value += share * change;
                            }
                        }
                    }
                }
            },
        );
    }
}

impl LampRow {
    /// Fills `out`, from column `x0` on, with what `of` makes of the grey value at each normal and of that of the flat
    /// pad. Both come from the same operations, so they are equal where the surface is flat.
    #[inline(always)]
    fn fill_grey(
        &self,
        columns: &Columns,
        x0: usize,
        normals: &Normals,
        out: &mut [f32],
        of: impl Fn(f32, f32) -> f32 + Copy,
    ) {
        let count = out.len();
        let (short, unit) = (&columns.short[x0..][..count], &columns.unit[x0..][..count]);
        let (nx, ny, nz) = (&normals.x[..count], &normals.y[..count], &normals.z[..count]);
        let [f0, f1, f2, f3, f4] = self.flat_field;
        for k in 0..count {
            let (x, u) = (short[k], unit[k]);
            let q = |m: usize| self.quadratic[m][0] + x * (self.quadratic[m][1] + x * self.quadratic[m][2]);
            // The published normal has z the other way round.
            let (nx, ny, nz) = (nx[k], ny[k], -nz[k]);
            let (q5, q8, q9) = (q(5), q(8), q(9));
            let upright = (q5 * nz * nz + q8 * nz) + q9;
            let across = nx * (q(0) * nx + q(1) * ny + q(2) * nz + q(6));
            let down = ny * (q(3) * ny + q(4) * nz + q(7));
            let flat_field = f0 + u * (f1 + u * (f2 + u * (f3 + u * f4)));
            let grey = |f: f32| (f * flat_field).clamp(0.0, 1.0);
            out[k] = of(grey(upright + across + down), grey((q5 + q8) + q9));
        }
    }
}

/// Finds the slope below which no channel changes by [`INVISIBLE_CHANGE`], by bounds on every term. `x` and `y` are the
/// largest |x| and |y| of the view in units of its shorter side.
///
/// At a slope s no component of (nx, ny) exceeds s, 1 - nz is at most s^2 / 2 and 1 - nz^2 at most s^2.
fn lamp_threshold(lamps: &[PreparedLamp], [x, y]: [f64; 2]) -> Threshold {
    let bounds = lamps.iter().map(|lamp| {
        let place = [1.0, y, y * y, x, x * y, x * x];
        let q = lamp.quadratic.map(|factors| factors.iter().zip(place).map(|(c, most)| c.abs() * most).sum::<f64>());
        let flat_field: f64 = lamp.flat_field.iter().map(|c| c.abs()).sum();
        let (linear, squared) = (q[2] + q[4] + q[6] + q[7], q[0] + q[1] + q[3] + q[5] + 0.5 * q[8]);
        (lamp.color, flat_field * linear, flat_field * squared)
    });
    let bounds: Vec<([f32; 3], f64, f64)> = bounds.collect();
    let change = |slope: f64| {
        let of = |channel: usize| {
            let each = bounds
                .iter()
                .map(|(color, linear, squared)| f64::from(color[channel]) * slope * (linear + slope * squared));
            each.sum::<f64>()
        };
        (0..3).map(of).fold(0.0, f64::max)
    };
    let (mut low, mut high) = (0.0, 0.5);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if change(middle) <= INVISIBLE_CHANGE { low = middle } else { high = middle }
    }
    // Slopes along x and y are compared one by one, and may both be as large as this.
    Threshold { slope: (low * std::f64::consts::FRAC_1_SQRT_2) as f32, height_mm: f32::MAX }
}
