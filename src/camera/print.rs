//! Markers: dots printed on the pad, which show how its surface moves in its own plane.
//!
//! At rest they lie on a square grid, each a little beside its place as prints are. A press carries them along with the
//! surface ([`crate::gelpad::elastic::inplane`]); each stays round, since the surface strains little over a dot.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Shot;
use super::lens::Lens;
use super::markers::{self, Dot};
use crate::config::quantity::Quantity;
use crate::depth::Camera;
use crate::effects::{Effect, Ledger};
use crate::gelpad::Drag;
use crate::gelpad::elastic::inplane::Field;
use crate::grid::Rect;
use crate::plan::Plan;
use crate::rng::Stage;
use crate::scene::Scene;

/// The `[markers]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Markers {
    /// Distance between neighbours, mm, along x and y.
    pub pitch_mm: Quantity,
    /// Diameter, mm; 0 is no markers.
    pub diameter_mm: Quantity,
    /// Largest offset of a dot from the grid along x and along y, mm; the same in every sample.
    pub jitter_mm: Quantity,
    /// Red, green and blue share of the light that the ink lets through, 0 to 1.
    pub color: [f64; 3],
    /// Width of the dots' soft edge, mm.
    pub edge_mm: f64,
}

impl Default for Markers {
    fn default() -> Self {
        Self {
            pitch_mm: Quantity::Constant(1.5),
            diameter_mm: Quantity::Constant(0.4),
            jitter_mm: Quantity::Constant(0.05),
            color: [0.12; 3],
            edge_mm: 0.05,
        }
    }
}

/// What one sample drew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// See [`Markers::pitch_mm`].
    pub pitch_mm: f64,
    /// See [`Markers::diameter_mm`].
    pub diameter_mm: f64,
    /// See [`Markers::jitter_mm`].
    pub jitter_mm: f64,
}

impl Markers {
    /// Draws a sample's pattern. `None` without any dot.
    pub fn draw(&self, draw: impl Fn(Stage, &Quantity) -> f64) -> Option<Pattern> {
        let pattern = Pattern {
            pitch_mm: draw(Stage::MarkerPitch, &self.pitch_mm),
            diameter_mm: draw(Stage::MarkerDiameter, &self.diameter_mm),
            jitter_mm: draw(Stage::MarkerJitter, &self.jitter_mm),
        };
        (pattern.diameter_mm > 0.0).then_some(pattern)
    }

    /// The pattern of every sample, if they are all the same.
    pub fn constant(&self) -> Option<Pattern> {
        let quantities = [&self.pitch_mm, &self.diameter_mm, &self.jitter_mm];
        let constant = quantities.iter().all(|quantity| matches!(quantity, Quantity::Constant(_)));
        constant.then(|| self.draw(|_, quantity| quantity.support().0)).flatten()
    }

    /// The dots of a pattern that the camera may see, carried along by the pad.
    pub fn ink(&self, pattern: &Pattern, moved_by: Option<&Field>, view: &Camera) -> Ink {
        let field_of_view_mm: [f64; 2] = std::array::from_fn(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
        // As far as any dot moves, and its own size.
        let margin_mm = MOTION_MM + pattern.diameter_mm;
        // The same print in every sample.
        const KEY: u64 = 0;
        let rest_mm = markers::grid(pattern.pitch_mm, pattern.jitter_mm, KEY, field_of_view_mm, margin_mm);
        let moved = |mm: &[f64; 2]| {
            let by = moved_by.map_or([0.0; 2], |field| field.at(*mm));
            view.point_px([mm[0] + f64::from(by[0]), mm[1] + f64::from(by[1])])
        };
        Ink {
            color: self.color.map(|share| share as f32),
            edge_mm: self.edge_mm,
            radius_mm: 0.5 * pattern.diameter_mm,
            moved_px: rest_mm.iter().map(moved).collect(),
            rest_px: rest_mm.iter().map(|mm| view.point_px(*mm)).collect(),
        }
    }
}

/// The dots of a sample, carried along by the pad; none if the pad has none.
pub fn ink(plan: &Plan, scene: &Scene, drag: Option<&Drag>, effects: &mut Ledger) -> Option<Ink> {
    let (markers, pattern) = plan.markers.as_ref().zip(scene.markers.as_ref())?;
    let moved_by = drag.map(|drag| &drag.field);
    Some(effects.timed(Effect::Markers, || markers.ink(pattern, moved_by, &plan.camera)))
}

/// How far beyond the view dots are followed, mm.
const MOTION_MM: f64 = 1.0;

/// The dots of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Ink {
    color: [f32; 3],
    edge_mm: f64,
    radius_mm: f64,
    /// Where they were printed, in the view before any lens.
    rest_px: Vec<[f64; 2]>,
    /// Where the pad carried them, in the same order.
    moved_px: Vec<[f64; 2]>,
}

impl Ink {
    /// Where the dots that rest or lie in view are in the image, at rest and moved, px: the first pixel's centre is at
    /// (0.5, 0.5).
    pub fn seen<'a>(
        &'a self,
        lens: Option<&'a Lens>,
        size: [usize; 2],
    ) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + 'a {
        let place = move |px: &[f64; 2]| lens.map_or(*px, |lens| lens.image(*px));
        let inside = move |px: &[f64; 2]| (0..2).all(|k| (0.0..=size[k] as f64).contains(&px[k]));
        let pairs = self.rest_px.iter().zip(&self.moved_px).map(move |(rest, moved)| (place(rest), place(moved)));
        pairs.filter(move |(rest, moved)| inside(rest) || inside(moved))
    }

    /// The dots as a camera sees them: a lens shifts and scales them.
    pub(super) fn dots(&self, shot: &Shot, view: &Camera) -> Vec<Dot> {
        let lens = shot.lens(view);
        let radius_px = view.mm_per_px.map(|pitch| self.radius_mm / pitch);
        let dot = |px: &[f64; 2]| {
            let Some(lens) = &lens else {
                return Dot { at_px: px.map(|px| px as f32), radius_px: radius_px.map(|px| px as f32) };
            };
            let edge = |k: usize, side: f64| {
                let mut at = *px;
                at[k] += side * radius_px[k];
                lens.image(at)[k]
            };
            let radius_px = std::array::from_fn(|k| (0.5 * (edge(k, 1.0) - edge(k, -1.0))) as f32);
            Dot { at_px: lens.image(*px).map(|px| px as f32), radius_px }
        };
        self.moved_px.iter().map(dot).collect()
    }

    /// Draws dots on the light of a part of the view. Defocus widens their edge: a ramp of width e has the standard
    /// deviation e / sqrt(12), and variances add up.
    pub(super) fn draw(&self, dots: &[Dot], shot: &Shot, view: &Camera, planes: &mut [Vec<f32>; 3], part: Rect) {
        let edge_mm = libm::sqrt(self.edge_mm * self.edge_mm + 12.0 * shot.defocus_mm * shot.defocus_mm);
        let edge_px = (edge_mm / view.mm_per_px[0].max(view.mm_per_px[1])) as f32;
        markers::draw(dots, self.color, edge_px, planes, part);
    }
}
