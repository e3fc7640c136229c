//! The contact as a whole: what of it is in view, and what the view cuts off.

use super::Contact;
use super::elastic::inplane::Load;
use crate::base::grid::Grid;
use crate::base::simd::{count, simd_dispatch};
use crate::base::view::View;
use crate::depth::Depth;
use crate::depth::beyond::{Area, Cells, Surroundings};
use crate::depth::indenter::Shape;

/// What touches the pad beyond the captured window.
#[derive(Clone, Debug)]
pub struct Beyond {
    /// Displacement that its pressure causes, mm, on the grid of [`Depth::penetration`], if the model knows it.
    pub displacement: Option<Grid<f32>>,
    /// How far an object that is not rigid gives way there under that pressure, mm, on the same grid.
    pub object_gives: Option<Grid<f32>>,
    /// Its normal force, N, if the model knows it.
    pub force_n: Option<f64>,
    /// Its area, mm^2.
    pub area_mm2: f64,
    /// The model reached its tolerance there.
    pub solved: bool,
}

/// Cells along the longer side of a contact whose area is measured.
const CELLS: f64 = 256.0;

impl Beyond {
    /// Where an object reaches below the undeformed pad beyond `margin_px` around the view, for a model that knows no
    /// pressure.
    pub(crate) fn of_overlap(around: &Surroundings<'_>, margin_px: usize) -> Self {
        let touching = around.below(0.0);
        let pitch_mm = touching.longest().max(f64::from(f32::MIN_POSITIVE)) / CELLS;
        let cells = Cells::over(touching, pitch_mm, 0);
        let (window, depths) = (Area::around(around.view(), margin_px), around.depths(&cells));
        let mut area_mm2 = 0.0;
        for y in 0..depths.height {
            for (x, _) in depths.row(y).iter().enumerate().filter(|(_, mm)| **mm > 0.0) {
                area_mm2 += (1.0 - window.share(&cells, x, y)) * pitch_mm * pitch_mm;
            }
        }
        Self { displacement: None, object_gives: None, force_n: None, area_mm2, solved: true }
    }
}

impl Beyond {
    /// How high it lifts the pad in the window, mm.
    fn raised_mm(&self) -> f64 {
        self.displacement.as_ref().map_or(0.0, |displacement| displacement.largest(|w| -w)).into()
    }
}

/// How the contact in view is part of a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TotalContact {
    /// Normal force of the whole object, N, if it is known.
    pub total_force_n: Option<f64>,
    /// The object touches the pad beyond the view, too.
    pub cut_by_view: bool,
    /// Share of the contact's area that is in view, if it is known; 0 without contact.
    pub in_view_fraction: Option<f64>,
    /// How high loads beyond the captured window lift the pad in it, mm.
    pub raised_mm: f64,
    /// Why the force in view or that of the whole object is not known; empty if both are.
    pub force_unknown: &'static str,
}

/// The total contact of one in `view`, with what touches beyond the captured window. A force in view that what is not known
/// decides is taken from the contact.
pub fn total_contact(
    shape: &Shape,
    depth: &Depth,
    beyond: Option<&Beyond>,
    contact: &mut Contact,
    youngs_modulus_kpa: f64,
    view: &View,
) -> TotalContact {
    if let Shape::HeightMap(_) = shape {
        let Grid { width, height, .. } = contact.mask;
        let touches = |y: usize| contact.mask.row(y).iter().any(|value| *value > 0);
        let ends = |y: usize| contact.mask.at(0, y) > 0 || contact.mask.at(width - 1, y) > 0;
        let cut_by_view = touches(0) || touches(height - 1) || (0..height).any(ends);
        return TotalContact::framed(contact, cut_by_view);
    }
    let [dx, dy] = view.mm_per_px;
    let touching = simd_dispatch(
        #[inline(always)]
        || count(contact.mask.data.iter().map(|touches| *touches > 0)),
    );
    let in_view_mm2 = f64::from(touching) * dx * dy;
    // Around the view, as far as the object was captured.
    let (force, mut area_mm2) = match (&contact.load, contact.force_n) {
        (Some(load), Some(_)) => pressed_around(load, view),
        (None, Some(_)) => (0.0, 0.0),
        (_, None) => (0.0, overlapped_around(depth) as f64 * dx * dy),
    };
    // kPa mm^2 are mN.
    let force_n = contact.stiffened * force * youngs_modulus_kpa * 1e-3;
    let solved = beyond.is_none_or(|beyond| beyond.solved);
    area_mm2 += beyond.map_or(0.0, |beyond| beyond.area_mm2);
    let force_unknown = match (contact.force_n, solved) {
        (None, _) => "the gelpad model knows no force",
        (_, false) => "the contact beyond the view is not solved",
        _ => "",
    };
    if !solved {
        contact.force_n = None;
    }
    let all_mm2 = in_view_mm2 + area_mm2;
    TotalContact {
        total_force_n: contact.force_n.map(|in_view| match area_mm2 > 0.0 {
            true => in_view + force_n + contact.stiffened * beyond.and_then(|beyond| beyond.force_n).unwrap_or(0.0),
            false => in_view,
        }),
        cut_by_view: area_mm2 > 0.0,
        raised_mm: beyond.map_or(0.0, Beyond::raised_mm),
        in_view_fraction: Some(if all_mm2 > 0.0 { in_view_mm2 / all_mm2 } else { 0.0 }),
        force_unknown,
    }
}

impl TotalContact {
    /// Of what a depth frame shows, and nobody knows beyond it.
    pub(crate) fn framed(contact: &mut Contact, cut_by_view: bool) -> Self {
        let force_unknown = match (contact.force_n, cut_by_view) {
            (None, _) => "the gelpad model knows no force",
            (_, true) => "the contact goes on beyond the frame, and what is there is not known",
            _ => "what touches beyond the frame is not known",
        };
        if cut_by_view {
            contact.force_n = None;
        }
        Self { total_force_n: None, cut_by_view, in_view_fraction: None, raised_mm: 0.0, force_unknown }
    }
}

/// Force over Young's modulus, mm^2, and area, mm^2, of a load around the view.
fn pressed_around(load: &Load, view: &View) -> (f64, f64) {
    let Load { pressure, origin_mm, mm_per_px } = load;
    let (seen, cell_mm2) = (Area::around(view, 0), mm_per_px[0] * mm_per_px[1]);
    // The first pixel in view, and one past the last.
    let inside = |k: usize, count: usize| {
        let before = |end: f64| (0..count).take_while(|at| origin_mm[k] + *at as f64 * mm_per_px[k] < end).count();
        (before(seen.min[k]), before(seen.max[k]))
    };
    let ((x0, x1), (y0, y1)) = (inside(0, pressure.width), inside(1, pressure.height));
    let (mut sum, mut touching) = (0.0, 0_u64);
    for y in 0..pressure.height {
        let row = pressure.row(y);
        let sides = if (y0..y1).contains(&y) { [&row[..x0], &row[x1..]] } else { [row, &[]] };
        for p in sides.into_iter().flatten() {
            sum += f64::from(*p);
            touching += u64::from(*p > 0.0);
        }
    }
    (sum * cell_mm2, touching as f64 * cell_mm2)
}

/// Pixels around the view in which the object reaches below the undeformed pad.
fn overlapped_around(depth: &Depth) -> u64 {
    let Depth { penetration, margin_px, touching, .. } = depth;
    let [x1, y1] = [penetration.width, penetration.height].map(|size| size - margin_px);
    let mut count = 0;
    for y in touching.y0..touching.y1 {
        let row = penetration.row(y);
        let sides = if (*margin_px..y1).contains(&y) { [&row[..*margin_px], &row[x1..]] } else { [row, &[]] };
        count += sides.into_iter().flatten().map(|mm| u64::from(*mm > 0.0)).sum::<u64>();
    }
    count
}
