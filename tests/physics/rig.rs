//! Elastic pads under objects that are given by a formula, without any mesh.

use gelsim_core::base::grid::Resolution;
use gelsim_core::base::grid::{Grid, bounding_box};
use gelsim_core::base::view::View;
use gelsim_core::depth::Depth;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::gelpad::elastic::{Elastic, ElasticPad};
use gelsim_core::gelpad::material::Material;
use gelsim_core::gelpad::{Contact, Model, Pad, deform_pad};
use gelsim_files::sensor::Sensor;

pub const RESOLUTIONS: [Resolution; 3] = [Resolution::Full, Resolution::Half, Resolution::Quarter];

/// A view, a pad and how to solve.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    pub resolution_px: [usize; 2],
    pub mm_per_px: [f64; 2],
    pub thickness_mm: f64,
    pub poisson_ratio: f64,
    pub youngs_modulus_kpa: f64,
    pub elastic: Elastic,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            resolution_px: [64, 48],
            mm_per_px: [0.2, 0.2],
            thickness_mm: 3.0,
            poisson_ratio: 0.48,
            youngs_modulus_kpa: 145.0,
            elastic: Elastic { max_iterations: 1000, ..Elastic::default() },
        }
    }
}

impl Setup {
    pub fn layer(&self) -> ElasticLayer {
        ElasticLayer { thickness_mm: self.thickness_mm, poisson_ratio: self.poisson_ratio }
    }

    pub fn solved(self, resolution: Resolution, tolerance_um: f64) -> Self {
        Self { elastic: Elastic { resolution, tolerance_um, ..self.elastic }, ..self }
    }

    pub fn material(self) -> Material {
        Sensor {
            resolution_px: self.resolution_px.map(|px| px as u32),
            field_of_view_mm: std::array::from_fn(|k| self.resolution_px[k] as f64 * self.mm_per_px[k]),
            gelpad_thickness_mm: self.thickness_mm,
            gelpad_poisson_ratio: self.poisson_ratio,
            gelpad_youngs_modulus_kpa: self.youngs_modulus_kpa,
            ..Sensor::default()
        }
        .gelpad_material()
    }

    pub fn rig(self) -> Rig {
        self.rig_of(&Model::Elastic(self.elastic))
    }

    /// The same pad by another model that is elastic.
    pub fn rig_of(self, model: &Model) -> Rig {
        let camera = View { resolution_px: self.resolution_px, mm_per_px: self.mm_per_px };
        match Pad::new(model, &self.material(), &camera) {
            Pad::Elastic(pad) => Rig { setup: self, pad: *pad },
            Pad::None | Pad::MeanBlur(_) | Pad::Gaussian(_) => panic!("{} is not elastic", model.name()),
        }
    }
}

/// A pad that is ready to be pressed.
pub struct Rig {
    pub setup: Setup,
    pub pad: ElasticPad,
}

impl Rig {
    pub fn margin_px(&self) -> usize {
        self.pad.capture_window(0.0).margin_px
    }

    /// The depth map of an object that is `penetration(x, y)` mm below the undeformed pad; x and y in mm from the
    /// view's middle.
    pub fn depth(&self, penetration: impl Fn(f64, f64) -> f64) -> Depth {
        let Setup { resolution_px, mm_per_px, .. } = self.setup;
        let margin = self.margin_px();
        let place =
            |k: usize, at: usize| (at as f64 + 0.5 - margin as f64 - resolution_px[k] as f64 / 2.0) * mm_per_px[k];
        self.depth_at(|x, y| penetration(place(0, x), place(1, y)))
    }

    /// The same, by column and row in the captured window.
    pub fn depth_at(&self, penetration: impl Fn(usize, usize) -> f64) -> Depth {
        let margin = self.margin_px();
        let [width, height] = self.setup.resolution_px.map(|px| px + 2 * margin);
        let (lowest, highest) = (-self.setup.thickness_mm, self.setup.thickness_mm);
        let mut grid = Grid::new(width, height);
        for y in 0..height {
            for x in 0..width {
                grid.row_mut(y)[x] = penetration(x, y).clamp(lowest, highest) as f32;
            }
        }
        let touching = bounding_box(&grid, |mm| mm > 0.0);
        let deepest_mm = grid.inner(margin).data.iter().fold(0.0, |deepest, mm| mm.max(deepest));
        Depth { penetration: grid, margin_px: margin, touching, deepest_mm, over_thickness_px: 0 }
    }

    /// The same, captured no higher than a simulator captures an object that is `deep` mm deep.
    pub fn depth_in_window(&self, deep: f64, penetration: impl Fn(f64, f64) -> f64) -> Depth {
        let above_mm = self.pad.capture_window(deep).above_mm;
        self.depth(|x, y| penetration(x, y).max(-above_mm))
    }

    pub fn press(&self, penetration: impl Fn(f64, f64) -> f64) -> Contact {
        self.pad.press(&self.depth(penetration))
    }

    /// The same as a stage of a simulator, which notes the effects that ran and why.
    pub fn press_noted(&self, depth: &Depth, policy: EffectPolicy) -> (Contact, EffectLog) {
        let mut effects = EffectLog::new(policy);
        let pad = Pad::Elastic(Box::new(self.pad.clone()));
        let contact = deform_pad(&pad, depth, None, None, false, &mut effects);
        (contact, effects)
    }
}

/// Where there is nothing of the object.
pub const NOTHING: f64 = f64::NEG_INFINITY;

fn turned(x: f64, y: f64, angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    (x * cos + y * sin, y * cos - x * sin)
}

/// An object by name and formula.
pub type Named = (&'static str, fn(f64, f64) -> f64);

/// A ball of radius `radius`, its lowest point `deep` below the pad at (0.13, -0.21).
pub fn ball(radius: f64, deep: f64, x: f64, y: f64) -> f64 {
    let r = (x - 0.13).hypot(y + 0.21);
    if r < radius { deep - radius + (radius * radius - r * r).sqrt() } else { NOTHING }
}

pub fn square(x: f64, y: f64) -> f64 {
    let (u, v) = turned(x, y, 0.25);
    if u.abs() < 2.5 && v.abs() < 2.5 { 0.5 } else { NOTHING }
}

/// A ridge 0.3 mm wide under a plate that stays 0.2 mm above the pad.
pub fn line(x: f64, y: f64) -> f64 {
    let (u, v) = turned(x, y, 0.6);
    if u.abs() < 3.0 && v.abs() < 0.15 { 0.5 } else { -0.2 }
}

/// The corner of a cube.
pub fn corner(x: f64, y: f64) -> f64 {
    let away = |k: f64| {
        let (sin, cos) = (0.2 + std::f64::consts::TAU * k / 3.0).sin_cos();
        cos * (x - 0.1) + sin * (y + 0.1)
    };
    1.0 - away(0.0).max(away(1.0)).max(away(2.0)) * 0.5_f64.sqrt()
}

pub fn texture(x: f64, y: f64) -> f64 {
    let (u, v) = turned(x, y, 0.15);
    let wave = |mm: f64, period: f64| (std::f64::consts::TAU * mm / period).cos();
    let rough = 0.35 + 0.12 * wave(u, 0.9) * wave(v, 0.9) + 0.03 * wave(u + 0.4 * v, 0.31);
    if u.abs() < 4.0 && v.abs() < 4.0 { rough } else { NOTHING }
}

/// Every kind of object: round, flat, pointed, edged, thin, rough, many, wider than the view, ringed by a surround that
/// is 0.01 mm above the pad, so that the pad piles up against it.
pub const OBJECTS: [Named; 12] = [
    ("small ball", |x, y| ball(2.35, 1.0, x, y)),
    ("large ball", |x, y| ball(5.0, 1.0, x, y)),
    ("square", square),
    ("corner", corner),
    ("line", line),
    ("texture", texture),
    ("roof", |x, y| {
        let (u, v) = turned(x, y, 0.5);
        if u.abs() < 3.0 { 0.8 - v.abs() } else { NOTHING }
    }),
    ("cylinder", |x, y| {
        let (u, v) = turned(x, y, 0.3);
        if v.abs() < 2.35 && u.abs() < 4.0 { 1.0 - 2.35 + (2.35 * 2.35 - v * v).sqrt() } else { NOTHING }
    }),
    ("five", |x, y| {
        let places = [(-6.0, -4.0), (5.0, 3.0), (0.0, 5.0), (7.0, -5.0), (-3.0, 2.0)];
        let one = |(u, v): (f64, f64)| 0.6 - ((x - u).powi(2) + (y - v).powi(2)) / 2.0;
        places.into_iter().map(one).fold(NOTHING, f64::max)
    }),
    ("plate", |_, _| 0.3),
    ("window plate", |x, y| if x.abs() <= 10.0 && y.abs() <= 7.5 { 0.3 } else { NOTHING }),
    ("punch in a surround", |x, y| if (x - 0.13).hypot(y + 0.21) < 2.0 { 0.5 } else { -0.01 }),
];
