//! From the solver's grid to the camera's: surface, contact mask, pressure and force in view.
//!
//! On the camera's own grid this is a copy. From a coarser grid the surface is interpolated; where pad and object are
//! in contact, it changes over to the object's own surface. Pressures are interpolated such that the force stays the
//! solver's.

use std::borrow::Cow;

use super::lattice::Lattice;
use super::partial_pixels::PartialPixel;
use super::resample::Interpolation;
use super::{ContactSolution, ElasticPad, edge};
use crate::base::grid::{Grid, Rect};
use crate::base::simd::{largest_value, simd_dispatch, sum_values};
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;
use crate::gelpad::Contact;

/// Largest gap, as a share of the depth, over which an interpolated pad counts as touching.
const MAX_GAP_SHARE: f32 = 0.5;

/// Where the cubic's gap is larger than is close and the straight line's is less than this share of it, there is contact.
const CLEAR_SHARE: f32 = 0.75;

impl ElasticPad {
    /// Transfers a solution to the camera's grid: the object's own surface where they touch, the pad's elsewhere.
    pub(super) fn fill_contact(
        &self,
        solution: &ContactSolution,
        depth: &Depth,
        (coarse, cut): (&Grid<f32>, &[PartialPixel]),
        seen: Rect,
        lattice: Lattice,
        contact: &mut Contact,
    ) {
        let (width, height) = (contact.surface.width, contact.surface.height);
        contact.region = Rect::whole(width, height);
        let (area, pressure) = match lattice.factor {
            1 => {
                let Rect { x0, y0, .. } = solution.known_box;
                let there = seen.in_window(x0, y0, solution.displacement.width, solution.displacement.height);
                contact.surface = solution.displacement.crop(there);
                (solution.contact_box, Cow::Borrowed(&solution.pressure))
            }
            // The object touches only between the solver's pixels: the surface stays as loads outside the window have
            // left it.
            _ if solution.contact_box.is_empty() => {
                contact.bulge_mm = contact.bulge_mm.max(contact.surface.largest(|w| -w));
                (Rect::default(), Cow::Borrowed(&solution.pressure))
            }
            _ => {
                let (displacement, surface) = (&solution.displacement, &mut contact.surface);
                lattice.upsample(displacement, solution.known_box, seen, Interpolation::Cubic, surface);
                let area = lattice.fine_box_of(solution.contact_box);
                let touched = TouchedArea { solution, depth, coarse, cut, area, highest: -contact.bulge_mm };
                let pressure = self.upsample_pressure(&touched, lattice, seen, &mut contact.surface);
                (area, Cow::Owned(pressure))
            }
        };
        let on_object = lattice.factor == 1;
        let youngs_modulus_kpa = self.youngs_modulus_kpa as f32;
        let mut in_view = Grid::new(width - 2 * SURFACE_BORDER, height - 2 * SURFACE_BORDER);
        let mut touching = vec![0_u8; width];
        let through = self.tolerance_mm();
        // The part of the surface with known pressure, in the surface's own columns and rows.
        let pressed = area.in_window(seen.x0, seen.y0, width, height);
        let (force, peak, not_finite) = simd_dispatch(
            #[inline(always)]
            || {
                let (mut force, mut peak, mut not_finite) = (0.0, 0.0_f32, 0_u32);
                for y in 0..height {
                    let object = &depth.penetration.row(seen.y0 + y)[seen.x0..seen.x1];
                    let surface = contact.surface.row_mut(y);
                    touching.fill(0);
                    if !on_object {
                        // An object that reaches through an interpolated surface touches it, even if the solver's grid
                        // missed it.
                        for ((touching, w), g) in touching.iter_mut().zip(&*surface).zip(object) {
                            *touching = if g - w > through { 255 } else { 0 };
                        }
                    }
                    for (w, g) in surface.iter_mut().zip(object) {
                        *w = if *g > *w { *g } else { *w };
                        not_finite += u32::from(*w * 0.0 != 0.0);
                    }
                    let columns = pressed.x0..pressed.x1;
                    let in_contact = (pressed.y0..pressed.y1).contains(&y);
                    if in_contact {
                        let from = &pressure.row(seen.y0 + y - area.y0)[seen.x0 + columns.start - area.x0..];
                        let rows = touching[columns.clone()].iter_mut().zip(&mut surface[columns.clone()]);
                        for (((touching, w), g), p) in rows.zip(&object[columns.clone()]).zip(from) {
                            *touching = if *p > 0.0 { 255 } else { *touching };
                            // On the solver's own grid, the surface in contact is the object's.
                            *w = if (*p > 0.0) & on_object { *g } else { *w };
                        }
                    }
                    if y < SURFACE_BORDER || y + SURFACE_BORDER >= height {
                        continue;
                    }
                    let inside = SURFACE_BORDER..width - SURFACE_BORDER;
                    contact.mask.row_mut(y - SURFACE_BORDER).copy_from_slice(&touching[inside.clone()]);
                    if in_contact {
                        let columns = columns.start.max(inside.start)..columns.end.min(inside.end);
                        let from = &pressure.row(seen.y0 + y - area.y0)[seen.x0 + columns.start - area.x0..];
                        let kpa = &mut in_view.row_mut(y - SURFACE_BORDER)
                            [columns.start - SURFACE_BORDER..columns.end - SURFACE_BORDER];
                        for (kpa, p) in kpa.iter_mut().zip(from) {
                            *kpa = p * youngs_modulus_kpa;
                        }
                        force += sum_values(kpa);
                        peak = peak.max(largest_value(kpa.iter().copied()));
                    }
                }
                (force, peak, not_finite)
            },
        );
        // kPa mm^2 are mN.
        contact.force_n = Some(force * self.mm_per_px[0] * self.mm_per_px[1] * 1e-3);
        contact.peak_pressure_kpa = Some(f64::from(peak));
        contact.pressure = Some(in_view);
        contact.finite = not_finite == 0 && force.is_finite();
    }

    /// Returns the pressure on the camera's grid within the touched area. It acts up to the contact's edge between the
    /// solver's pixels, unless the object ends before. Between a solver's pixel in contact and one that is not, the
    /// surface changes over to the object's own from half way on, but it is raised no higher than the pad's highest
    /// point.
    fn upsample_pressure(
        &self,
        touched: &TouchedArea<'_>,
        lattice: Lattice,
        seen: Rect,
        surface: &mut Grid<f32>,
    ) -> Grid<f32> {
        let TouchedArea { solution, depth, coarse, cut, area, highest } = *touched;
        let stiffness = (2.0 / self.layer.half_space_compliance()) as f32;
        let inside = edge::distance_inside_mm(
            solution,
            coarse,
            (&depth.penetration, lattice),
            self.coarse_mm_per_px,
            stiffness,
            highest,
        );
        let visible = area.in_window(seen.x0, seen.y0, surface.width, surface.height);
        if visible.is_empty() {
            let mut pressure = Grid::default();
            lattice.upsample(&solution.pressure, solution.contact_box, area, Interpolation::Linear, &mut pressure);
            return pressure;
        }
        let mut touching = solution.pressure.clone();
        touching.data.iter_mut().for_each(|p| *p = if *p > 0.0 { 1.0 } else { 0.0 });
        // Where a wall leaves out a pixel's centre, the pad there lies on the object as far as the part beside the wall
        // is pressed.
        let Rect { x0, y0, .. } = solution.contact_box;
        for pixel in cut.iter().filter(|pixel| solution.contact_box.contains(pixel.at)) {
            let [x, y] = [pixel.at[0] - x0, pixel.at[1] - y0];
            touching.row_mut(y)[x] *= pixel.pressed_centre_share(solution.pressure.at(x, y));
        }
        let rows = |values, part| lattice.upsampled_rows(values, part, area);
        // A cubic overshoots beside a sharp edge; a straight line does not.
        let mut straight = rows(&solution.displacement, solution.known_box);
        let [mut pressures, mut inside, mut touching] =
            [&solution.pressure, &inside, &touching].map(|values| rows(values, solution.contact_box));
        // In a shallow press, a flank can be within the grid's gap and still be far from the pad compared with the
        // depth. Gaps are divided by this, so it must be above 0 for the smallest depth, too.
        let close = self.contact_gap_mm().min(MAX_GAP_SHARE * depth.deepest_mm).max(f32::MIN_POSITIVE);
        let through = self.tolerance_mm();
        // Nor does the cubic reach deeper than the object.
        let deepest = depth.largest_penetration_mm();
        let columns = seen.x0 + visible.x0..seen.x0 + visible.x1;
        let rows = Rect { y0: seen.y0 + visible.y0, y1: seen.y0 + visible.y1, ..area };
        let mut pressure = Grid::<f32>::new(area.width(), area.height());
        // The view, without the surface's border.
        let border = SURFACE_BORDER;
        let view = Rect { x0: seen.x0 + border, y0: seen.y0 + border, x1: seen.x1 - border, y1: seen.y1 - border };
        let mut fine_sum = 0.0;
        let in_area = columns.start - area.x0..columns.end - area.x0;
        simd_dispatch(
            #[inline(always)]
            || {
                for y in area.y0..area.y1 {
                    let to = pressure.row_mut(y - area.y0);
                    let ([above, below], share) = pressures.rows_around(y - area.y0);
                    for ((p, above), below) in to.iter_mut().zip(above).zip(below) {
                        *p = above + share * (below - above);
                    }
                    if y < rows.y0 || y >= rows.y1 {
                        continue;
                    }
                    let object = &depth.penetration.row(y)[columns.clone()];
                    let surface = &mut surface.row_mut(y - seen.y0)[columns.start - seen.x0..columns.end - seen.x0];
                    let to = &mut to[in_area.clone()];
                    let around =
                        [&mut inside, &mut straight, &mut touching].map(|rows| rows.rows_around(y - area.y0).0);
                    let [inside, straight, touching] = around.map(|rows| rows.map(|row| &row[in_area.clone()]));
                    for x in 0..to.len() {
                        let between = |[above, below]: [&[f32]; 2]| above[x] + share * (below[x] - above[x]);
                        let (inside, straight, touching) = (between(inside), between(straight), between(touching));
                        let (w, g) = (surface[x], object[x]);
                        let gap = w - g;
                        let touches = ((inside > 0.0) & ((gap < close) | (straight - g < CLEAR_SHARE * close)))
                            | (-gap > through);
                        let p = if touches & (g >= highest) { to[x] } else { 0.0 };
                        // The change is gradual: a contact that gains a pixel must not move the surface by more than
                        // the object moved.
                        let share = (2.0 * touching - 1.0).max(0.0) * (2.0 - 2.0 * gap / close).clamp(0.0, 1.0);
                        let w = w - share * gap.min((w - highest).max(0.0));
                        // Where only the cubic has overshot, limit the gap, too; in full where it counts as contact.
                        let over = if (w < g + close) | (inside <= 0.0) | (g < highest) { 0.0 } else { w - g - close };
                        let limited = (1.0 - (straight - g) / close) / (1.0 - CLEAR_SHARE);
                        let w = w - limited.clamp(0.0, 1.0) * over;
                        surface[x] = if w < deepest { w } else { deepest };
                        to[x] = p;
                    }
                    if (view.y0..view.y1).contains(&y) {
                        let [from, end] =
                            [view.x0, view.x1].map(|x| x.clamp(columns.start, columns.end) - columns.start);
                        fine_sum += sum_values(&to[from..end]);
                    }
                }
            },
        );
        // Where an edge cut off pressure, the rest carries it: in view, the total is scaled to the solver's force.
        let mut coarse_sum = 0.0;
        let part = lattice.coarse_inside(view);
        for y in part.y0.max(solution.contact_box.y0)..part.y1.min(solution.contact_box.y1) {
            let Rect { x0, x1, .. } = solution.contact_box;
            let row = solution.pressure.row(y - solution.contact_box.y0);
            let from = part.x0.clamp(x0, x1) - x0..part.x1.clamp(x0, x1) - x0;
            coarse_sum += row[from].iter().map(|p| f64::from(*p)).sum::<f64>();
        }
        let scale = coarse_sum * (lattice.factor * lattice.factor) as f64 / fine_sum;
        // For a sliver of contact at the view's border the ratio is meaningless, so it is not applied.
        if (0.5..=2.0).contains(&scale) {
            pressure.data.iter_mut().for_each(|p| *p *= scale as f32);
        }
        pressure
    }
}

/// The inputs of the pressure's interpolation.
struct TouchedArea<'a> {
    solution: &'a ContactSolution,
    depth: &'a Depth,
    /// Penetration on the solver's grid, and the pixels that walls cut.
    coarse: &'a Grid<f32>,
    cut: &'a [PartialPixel],
    /// The camera's pixels in the contact's box.
    area: Rect,
    /// The pad's highest point as a displacement into the pad, mm: minus the bulge.
    highest: f32,
}
