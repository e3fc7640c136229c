//! A surface that casts shadows: of which lights, how far, and what each pixel sees of them.

use std::cell::RefCell;

use super::{Caster, Scratch, Steepest, visible};
use crate::base::grid::{Grid, Rect};
use crate::base::view::View;
use crate::optics::coarse::{Coarse, Values};

/// A surface that casts shadows.
pub struct Casting {
    coarse: Coarse,
    /// On the grid on which shadows are found.
    surface: Grid<f32>,
    /// For each light, if it casts any.
    casters: Vec<Option<Caster>>,
    /// Highest point over the lowest one, mm.
    span_mm: f32,
}

impl Casting {
    /// The shadows of lights on `surface`, a [`crate::gelpad::Contact::surface`] seen by `view`, if there are any; with
    /// `everywhere` also those that fall nowhere. `lights` makes the casters for the pitch of the grid, and the highest point of
    /// the surface on it, mm.
    pub fn new(
        coarse: Coarse,
        surface: &Grid<f32>,
        view: &View,
        everywhere: bool,
        lights: impl FnOnce([f64; 2], f32) -> Vec<Caster>,
    ) -> Option<Self> {
        let (surface, pitch) = (coarse.thinned(surface), coarse.pitch(view.mm_per_px));
        let steepest = Steepest::new(&surface, pitch);
        let casting = |caster: Caster| (everywhere || caster.casts(&steepest)).then_some(caster);
        let casters: Vec<Option<Caster>> = lights(pitch, steepest.highest_mm).into_iter().map(casting).collect();
        let any = casters.iter().any(Option::is_some);
        any.then_some(Self { coarse, surface, casters, span_mm: steepest.span_mm })
    }

    /// `bent`, and the part of the view that what stands in it can shadow.
    pub fn reach(&self, bent: Rect, view: &View) -> Rect {
        let [width, height] = view.resolution_px;
        let factor = self.coarse.factor;
        let moved = |start: usize, end: usize, [from, to]: [f64; 2], size: usize| {
            // Interpolation carries a trace further, on either grid.
            let more = 2 * factor;
            let px = |steps: f64| (steps.ceil() as usize).saturating_mul(factor);
            (
                start.saturating_sub(px(-from).saturating_add(more)),
                end.saturating_add(px(to)).saturating_add(more).min(size),
            )
        };
        let shadow = |region: Rect, caster: &Caster| {
            let [x, y] = caster.shadow_px(self.span_mm);
            let ((x0, x1), (y0, y1)) = (moved(bent.x0, bent.x1, x, width), moved(bent.y0, bent.y1, y, height));
            region.united(Rect { x0, y0, x1, y1 })
        };
        self.casters.iter().flatten().fold(bent, shadow)
    }

    /// The share of each light that pixels of `region` see.
    pub fn shares(&self, view: &View, region: Rect) -> Vec<Option<Values>> {
        let size = view.resolution_px;
        let part = self.coarse.part(size, region);
        let values = |values: Vec<f32>| (!values.is_empty()).then(|| self.coarse.values(size, part, values));
        let seen = SCRATCH.with_borrow_mut(|scratch| visible(&self.casters, &self.surface, part, scratch));
        seen.into_iter().map(values).collect()
    }
}

thread_local! {
    /// Memory that a thread's samples share.
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}
