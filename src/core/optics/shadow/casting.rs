//! The shadows that a surface casts: of which lights, how far, and what each pixel sees of them.

use std::cell::RefCell;

use super::{ShadowCaster, ShadowScratch, SteepestSlopes, compute_visible_shares};
use crate::base::grid::{Grid, Rect};
use crate::base::view::View;
use crate::optics::coarse::{CoarseGrid, CoarseValues};

/// A surface that casts shadows.
pub struct ShadowCasting {
    coarse: CoarseGrid,
    /// The surface on the grid on which shadows are computed.
    surface: Grid<f32>,
    /// For each light its caster; `None` if it casts no shadow.
    casters: Vec<Option<ShadowCaster>>,
    /// Height of the highest point over the lowest one, mm.
    span_mm: f32,
}

impl ShadowCasting {
    /// Finds the shadows of lights on `surface`, a [`crate::gelpad::Contact::surface`] seen by `view`; `None` if there
    /// are none. With `everywhere`, lights whose shadows fall nowhere count, too. `lights` makes the casters for the
    /// pixel size of the grid and the highest point of the surface on it, mm.
    pub fn new(
        coarse: CoarseGrid,
        surface: &Grid<f32>,
        view: &View,
        everywhere: bool,
        lights: impl FnOnce([f64; 2], f32) -> Vec<ShadowCaster>,
    ) -> Option<Self> {
        let (surface, pixel_mm) = (coarse.subsample(surface), coarse.pixel_size_mm(view.mm_per_px));
        let steepest = SteepestSlopes::new(&surface, pixel_mm);
        let casting = |caster: ShadowCaster| (everywhere || caster.casts_shadow(&steepest)).then_some(caster);
        let casters: Vec<Option<ShadowCaster>> =
            lights(pixel_mm, steepest.highest_mm).into_iter().map(casting).collect();
        let any = casters.iter().any(Option::is_some);
        any.then_some(Self { coarse, surface, casters, span_mm: steepest.span_mm })
    }

    /// Returns the part of the view that what stands in `bent` can shadow, with `bent` itself.
    pub fn shadowed_region(&self, bent: Rect, view: &View) -> Rect {
        let [width, height] = view.resolution_px;
        let factor = self.coarse.factor;
        let moved = |start: usize, end: usize, [from, to]: [f64; 2], size: usize| {
            // Interpolation carries a trace of a shadow further, on either grid.
            let more = 2 * factor;
            let px = |steps: f64| (steps.ceil() as usize).saturating_mul(factor);
            (
                start.saturating_sub(px(-from).saturating_add(more)),
                end.saturating_add(px(to)).saturating_add(more).min(size),
            )
        };
        let shadow = |region: Rect, caster: &ShadowCaster| {
            let [x, y] = caster.shadow_extent_px(self.span_mm);
            let ((x0, x1), (y0, y1)) = (moved(bent.x0, bent.x1, x, width), moved(bent.y0, bent.y1, y, height));
            region.union(Rect { x0, y0, x1, y1 })
        };
        self.casters.iter().flatten().fold(bent, shadow)
    }

    /// Computes the fraction of each light that the pixels of `region` see; `None` for a light that casts no shadow.
    pub fn compute_visible_shares(&self, view: &View, region: Rect) -> Vec<Option<CoarseValues>> {
        let size = view.resolution_px;
        let part = self.coarse.part_for_region(size, region);
        let values = |values: Vec<f32>| (!values.is_empty()).then(|| self.coarse.place_values(size, part, values));
        let seen =
            SCRATCH.with_borrow_mut(|scratch| compute_visible_shares(&self.casters, &self.surface, part, scratch));
        seen.into_iter().map(values).collect()
    }
}

thread_local! {
    /// Scratch memory that a thread's samples share.
    static SCRATCH: RefCell<ShadowScratch> = RefCell::default();
}
