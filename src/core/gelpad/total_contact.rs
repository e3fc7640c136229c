//! The object's total contact: which part of it is in view, and what the view cuts off.

use super::Contact;
use super::elastic::in_plane::Load;
use crate::base::grid::Grid;
use crate::base::simd::{count_true, simd_dispatch};
use crate::base::view::View;
use crate::depth::Depth;
use crate::depth::indenter::Shape;
use crate::depth::outside_window::{CellGrid, OutsideCapture, RectMm};

/// The contact between pad and object outside the captured window.
#[derive(Clone, Debug)]
pub struct OutsideWindow {
    /// Displacement caused by the pressure outside, mm, on the grid of [`Depth::penetration`]; `None` if the model
    /// computes none.
    pub displacement: Option<Grid<f32>>,
    /// Displacement of a deformable object by that pressure, mm, on the same grid.
    pub object_displacement: Option<Grid<f32>>,
    /// Normal force outside the window, N; `None` if the model computes none.
    pub force_n: Option<f64>,
    /// Contact area outside the window, mm^2.
    pub area_mm2: f64,
    /// True if the model reached its tolerance there.
    pub converged: bool,
}

/// Number of cells along the longer side of a patch of contact whose area is measured.
const CELLS_PER_SIDE: f64 = 256.0;

impl OutsideWindow {
    /// Measures where an object reaches below the undeformed pad outside the view and `margin_px` around it, for models
    /// that compute no pressure.
    pub(crate) fn from_penetration(around: &OutsideCapture<'_>, margin_px: usize) -> Self {
        let window = RectMm::around_view(around.view(), margin_px);
        let mut area_mm2 = 0.0;
        // Patches that are far from each other have grids of their own.
        for patch in around.patches_below(0.0, window.longer_side_mm()) {
            // The lower limit avoids a division by 0 for a contact in a single point.
            let cell_size_mm = patch.longer_side_mm().max(f64::from(f32::MIN_POSITIVE)) / CELLS_PER_SIDE;
            let cells = CellGrid::covering(patch, cell_size_mm, 0);
            let depths = around.capture_depths(&cells);
            for y in 0..depths.height {
                for (x, _) in depths.row(y).iter().enumerate().filter(|(_, mm)| **mm > 0.0) {
                    area_mm2 += (1.0 - window.cell_share(&cells, x, y)) * cell_size_mm * cell_size_mm;
                }
            }
        }
        Self { displacement: None, object_displacement: None, force_n: None, area_mm2, converged: true }
    }
}

impl OutsideWindow {
    /// Returns how high the contact outside lifts the pad in the window, mm.
    fn raised_mm(&self) -> f64 {
        self.displacement.as_ref().map_or(0.0, |displacement| displacement.largest(|w| -w)).into()
    }
}

/// How the contact in view belongs to the object's total contact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TotalContact {
    /// Normal force of the complete object, N, if it is known.
    pub total_force_n: Option<f64>,
    /// Force that the complete object has at least, N: of what is known of it. Equal to `total_force_n` if that is known;
    /// `None` for a depth frame that ends within the contact, and if the model computes none.
    pub total_force_at_least_n: Option<f64>,
    /// True if the object touches the pad outside the view, too.
    pub cut_by_view: bool,
    /// Share of the contact's area that is in view, if it is known; 0 without contact.
    pub in_view_fraction: Option<f64>,
    /// How high loads outside the captured window lift the pad in it, mm.
    pub raised_mm: f64,
    /// Why the force in view or that of the complete object is not known; empty if both are known.
    pub force_unknown: &'static str,
}

/// Measures the total contact, given the contact in `view` and that outside the captured window. If the contact outside
/// is not solved, the force in view depends on it and is removed from `contact`.
pub fn measure_total_contact(
    shape: &Shape,
    depth: &Depth,
    outside: Option<&OutsideWindow>,
    contact: &mut Contact,
    youngs_modulus_kpa: f64,
    view: &View,
) -> TotalContact {
    if let Shape::HeightMap(_) = shape {
        let Grid { width, height, .. } = contact.mask;
        let touches = |y: usize| contact.mask.row(y).iter().any(|value| *value > 0);
        let ends = |y: usize| contact.mask.at(0, y) > 0 || contact.mask.at(width - 1, y) > 0;
        let cut_by_view = touches(0) || touches(height - 1) || (0..height).any(ends);
        return TotalContact::of_depth_frame(contact, cut_by_view);
    }
    let [dx, dy] = view.mm_per_px;
    let touching = simd_dispatch(
        #[inline(always)]
        || count_true(contact.mask.data.iter().map(|touches| *touches > 0)),
    );
    let mut in_view_mm2 = f64::from(touching) * dx * dy;
    // Around the view, within the captured window.
    let (force, mut area_mm2) = match (&contact.load, contact.force_n) {
        (Some(load), Some(_)) => force_and_area_around_view(load, view),
        (None, Some(_)) => (0.0, 0.0),
        (_, None) => {
            // Without pressure, what reaches below the pad counts, in view and around it alike.
            let [within, around] = count_penetrating(depth).map(|px| px as f64 * dx * dy);
            in_view_mm2 = within;
            (0.0, around)
        }
    };
    // kPa mm^2 are mN.
    let force_n = contact.stiffening_factor * force * youngs_modulus_kpa * 1e-3;
    let solved = outside.is_none_or(|outside| outside.converged);
    area_mm2 += outside.map_or(0.0, |outside| outside.area_mm2);
    let force_unknown = match (contact.force_n, solved) {
        (None, _) => "the gelpad model knows no force",
        (_, false) => "the contact beyond the view is not solved",
        _ => "",
    };
    // An object that is cut off presses less than the complete one.
    let alone_n = contact.force_n;
    if !solved {
        contact.force_n = None;
    }
    let all_mm2 = in_view_mm2 + area_mm2;
    let total_force_n = contact.force_n.map(|in_view| match area_mm2 > 0.0 {
        true => {
            in_view + force_n + contact.stiffening_factor * outside.and_then(|outside| outside.force_n).unwrap_or(0.0)
        }
        false => in_view,
    });
    TotalContact {
        total_force_n,
        total_force_at_least_n: total_force_n.or(alone_n),
        cut_by_view: area_mm2 > 0.0,
        raised_mm: outside.map_or(0.0, OutsideWindow::raised_mm),
        in_view_fraction: Some(if all_mm2 > 0.0 { in_view_mm2 / all_mm2 } else { 0.0 }),
        force_unknown,
    }
}

impl TotalContact {
    /// Returns the total contact of an object known from a depth frame: beyond the frame nothing is known.
    pub(crate) fn of_depth_frame(contact: &mut Contact, cut_by_view: bool) -> Self {
        let force_unknown = match (contact.force_n, cut_by_view) {
            (None, _) => "the gelpad model knows no force",
            (_, true) => "the contact goes on beyond the frame, and what is there is not known",
            _ => "what touches beyond the frame is not known",
        };
        if cut_by_view {
            contact.force_n = None;
        }
        // What touches beyond the frame only adds to what does not reach its border.
        let total_force_at_least_n = contact.force_n;
        Self {
            total_force_n: None,
            total_force_at_least_n,
            cut_by_view,
            in_view_fraction: None,
            raised_mm: 0.0,
            force_unknown,
        }
    }
}

/// Returns the force over Young's modulus, mm^2, and the area, mm^2, of a load around the view.
fn force_and_area_around_view(load: &Load, view: &View) -> (f64, f64) {
    let Load { pressure, origin_mm, mm_per_px } = load;
    let (seen, cell_mm2) = (RectMm::around_view(view, 0), mm_per_px[0] * mm_per_px[1]);
    // The first pixel in view, and one past the last one.
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

/// Counts the pixels in which the object reaches below the undeformed pad: those in view, and those around it.
fn count_penetrating(depth: &Depth) -> [u64; 2] {
    let Depth { penetration, margin_px, touching, .. } = depth;
    let [x1, y1] = [penetration.width, penetration.height].map(|size| size - margin_px);
    let (mut within, mut all) = (0, 0);
    let count = |row: &[f32]| row.iter().map(|mm| u64::from(*mm > 0.0)).sum::<u64>();
    for y in touching.y0..touching.y1 {
        let row = penetration.row(y);
        all += count(row);
        if (*margin_px..y1).contains(&y) {
            within += count(&row[*margin_px..x1]);
        }
    }
    [within, all - within]
}

/// Computes the first moment of a contact's pressure along the pad's x and y, N mm. Returns `None` if some of the pressure
/// lies beyond what was captured.
pub fn pressure_moment_nmm(contact: &Contact, youngs_modulus_kpa: f64) -> Option<[f64; 2]> {
    let Some(load) = &contact.load else { return contact.force_n.filter(|force| *force == 0.0).map(|_| [0.0; 2]) };
    let mut sums = [0.0; 3];
    for y in 0..load.pressure.height {
        let at_y = load.origin_mm[1] + y as f64 * load.mm_per_px[1];
        for (x, pressure) in load.pressure.row(y).iter().enumerate() {
            let pressure = f64::from(*pressure);
            sums[0] += pressure * (load.origin_mm[0] + x as f64 * load.mm_per_px[0]);
            sums[1] += pressure * at_y;
            sums[2] += pressure;
        }
    }
    // 1 kPa mm^2 is 1 mN.
    let newtons = 1e-3 * contact.stiffening_factor * youngs_modulus_kpa * load.mm_per_px[0] * load.mm_per_px[1];
    let total = contact.total.total_force_n?;
    let captured = (newtons * sums[2] - total).abs() <= 1e-3 * total;
    captured.then(|| [newtons * sums[0], newtons * sums[1]])
}
