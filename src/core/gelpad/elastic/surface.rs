//! From the solver's grid to the camera's: surface, contact mask, pressure and force in view.
//!
//! On the camera's own grid this is a copy. From a coarser one the surface is interpolated, and goes over to the
//! object's own surface where the two are in contact; pressures are interpolated so that the force stays the solver's.

use std::borrow::Cow;

use super::lattice::Lattice;
use super::resample::Shape;
use super::walls::CutPixel;
use super::{Pad, Solution, edge};
use crate::base::grid::{Grid, Rect};
use crate::base::simd::{largest, simd_dispatch, sum};
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;
use crate::gelpad::Contact;

/// Share of the depth that the pad may be away from an object that it touches between the solver's pixels.
const SHALLOW_CLOSE: f32 = 0.5;

impl Pad {
    /// Takes a solution to the camera's grid: the object's own surface where they touch, the pad's elsewhere.
    pub(super) fn fill(
        &self,
        solution: &Solution,
        depth: &Depth,
        (coarse, cut): (&Grid<f32>, &[CutPixel]),
        seen: Rect,
        lattice: Lattice,
        contact: &mut Contact,
    ) {
        let (width, height) = (contact.surface.width, contact.surface.height);
        contact.region = Rect::whole(width, height);
        let (area, pressure) = match lattice.factor {
            1 => {
                let Rect { x0, y0, .. } = solution.seen;
                let there = seen.seen_from(x0, y0, solution.displacement.width, solution.displacement.height);
                contact.surface = solution.displacement.crop(there);
                (solution.contact_box, Cow::Borrowed(&solution.pressure))
            }
            // The object touches between the solver's pixels only: the surface is as what touches beyond the window has left it.
            _ if solution.contact_box.is_empty() => {
                contact.bulge_mm = contact.bulge_mm.max(contact.surface.largest(|w| -w));
                (Rect::default(), Cow::Borrowed(&solution.pressure))
            }
            _ => {
                let (displacement, surface) = (&solution.displacement, &mut contact.surface);
                lattice.enlarge(displacement, solution.seen, seen, Shape::Cubic, surface);
                let area = lattice.covered_by(solution.contact_box);
                let touched = Touched { solution, depth, coarse, cut, area, highest: -contact.bulge_mm };
                let pressure = self.enlarge_pressure(&touched, lattice, seen, &mut contact.surface);
                (area, Cow::Owned(pressure))
            }
        };
        let on_object = lattice.factor == 1;
        let youngs_modulus_kpa = self.youngs_modulus_kpa as f32;
        let mut in_view = Grid::new(width - 2 * SURFACE_BORDER, height - 2 * SURFACE_BORDER);
        let mut touching = vec![0_u8; width];
        let through = (self.elastic.tolerance_um * 1e-3) as f32;
        // The part of the surface that pressure is known for, in its own columns and rows.
        let pressed = area.seen_from(seen.x0, seen.y0, width, height);
        let (force, peak, not_finite) = simd_dispatch(
            #[inline(always)]
            || {
                let (mut force, mut peak, mut not_finite) = (0.0, 0.0_f32, 0_u32);
                for y in 0..height {
                    let object = &depth.penetration.row(seen.y0 + y)[seen.x0..seen.x1];
                    let surface = contact.surface.row_mut(y);
                    touching.fill(0);
                    if !on_object {
                        // What reaches through an interpolated surface touches it, even if the solver's grid missed it.
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
                            // On the solver's own grid, what touches lies on the object.
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
                        force += sum(kpa);
                        peak = peak.max(largest(kpa.iter().copied()));
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

    /// Pressure on the camera's grid within the touched area. It acts where the contact is known to reach, between the
    /// solver's pixels, unless the object ends before. From half-way between two of these, of which one touches, to that one the
    /// surface goes over to the object's own, but to no higher place than the pad's highest.
    fn enlarge_pressure(
        &self,
        touched: &Touched<'_>,
        lattice: Lattice,
        seen: Rect,
        surface: &mut Grid<f32>,
    ) -> Grid<f32> {
        let Touched { solution, depth, coarse, cut, area, highest } = *touched;
        let stiffness = (2.0 / self.layer.half_space()) as f32;
        let inside =
            edge::inside_mm(solution, coarse, (&depth.penetration, lattice), self.coarse_mm_per_px, stiffness, highest);
        let visible = area.seen_from(seen.x0, seen.y0, surface.width, surface.height);
        if visible.is_empty() {
            let mut pressure = Grid::default();
            lattice.enlarge(&solution.pressure, solution.contact_box, area, Shape::Linear, &mut pressure);
            return pressure;
        }
        let mut touching = solution.pressure.clone();
        touching.data.iter_mut().for_each(|p| *p = if *p > 0.0 { 1.0 } else { 0.0 });
        // Where a wall leaves a pixel's centre out, the pad is on the object as far as that is pressed, too.
        let Rect { x0, y0, .. } = solution.contact_box;
        for pixel in cut.iter().filter(|pixel| solution.contact_box.holds(pixel.at)) {
            let [x, y] = [pixel.at[0] - x0, pixel.at[1] - y0];
            touching.row_mut(y)[x] *= pixel.pressed_centre(solution.pressure.at(x, y));
        }
        let rows = |values, part| lattice.rows(values, part, area);
        // A cubic overshoots beside a sharp edge, where a straight line does not.
        let mut straight = rows(&solution.displacement, solution.seen);
        let [mut pressures, mut inside, mut touching] =
            [&solution.pressure, &inside, &touching].map(|values| rows(values, solution.contact_box));
        // A flank that a shallow press shows is far from the pad in spite of being near by the grid's measure. Gaps are
        // divided by it: above 0 for the smallest depth, too.
        let close = self.close_mm().min(SHALLOW_CLOSE * depth.deepest_mm).max(f32::MIN_POSITIVE);
        let through = (self.elastic.tolerance_um * 1e-3) as f32;
        let columns = seen.x0 + visible.x0..seen.x0 + visible.x1;
        let rows = Rect { y0: seen.y0 + visible.y0, y1: seen.y0 + visible.y1, ..area };
        let mut pressure = Grid::<f32>::new(area.width(), area.height());
        let mut fine_sum = 0.0;
        let in_area = columns.start - area.x0..columns.end - area.x0;
        simd_dispatch(
            #[inline(always)]
            || {
                for y in area.y0..area.y1 {
                    let to = pressure.row_mut(y - area.y0);
                    let ([above, below], share) = pressures.around(y - area.y0);
                    for ((p, above), below) in to.iter_mut().zip(above).zip(below) {
                        *p = above + share * (below - above);
                    }
                    if y < rows.y0 || y >= rows.y1 {
                        continue;
                    }
                    let object = &depth.penetration.row(y)[columns.clone()];
                    let surface = &mut surface.row_mut(y - seen.y0)[columns.start - seen.x0..columns.end - seen.x0];
                    let to = &mut to[in_area.clone()];
                    let around = [&mut inside, &mut straight, &mut touching].map(|rows| rows.around(y - area.y0).0);
                    let [inside, straight, touching] = around.map(|rows| rows.map(|row| &row[in_area.clone()]));
                    for x in 0..to.len() {
                        let between = |[above, below]: [&[f32]; 2]| above[x] + share * (below[x] - above[x]);
                        let (inside, straight, touching) = (between(inside), between(straight), between(touching));
                        let (w, g) = (surface[x], object[x]);
                        let gap = w - g;
                        let nearest = if straight - g < gap { straight - g } else { gap };
                        let touches = ((inside > 0.0) & (nearest < close)) | (-gap > through);
                        let p = if touches & (g >= highest) { to[x] } else { 0.0 };
                        // Gradually: a contact that gains a pixel must not move the surface by more than the object moved.
                        let share = (2.0 * touching - 1.0).max(0.0) * (2.0 - 2.0 * gap / close).clamp(0.0, 1.0);
                        let w = w - share * gap.min((w - highest).max(0.0));
                        // No further off than it may be, where only the cubic has overshot.
                        let near = if w < g + close { w } else { g + close };
                        surface[x] = if p > 0.0 { near } else { w };
                        to[x] = p;
                    }
                    fine_sum += sum(to);
                }
            },
        );
        // Where an edge cut pressure off, the rest carries it: the force is the solver's.
        let mut coarse_sum = 0.0;
        let part = lattice.inside(Rect { x0: columns.start, x1: columns.end, ..rows });
        for y in part.y0.max(solution.contact_box.y0)..part.y1.min(solution.contact_box.y1) {
            let Rect { x0, x1, .. } = solution.contact_box;
            let row = solution.pressure.row(y - solution.contact_box.y0);
            let from = part.x0.clamp(x0, x1) - x0..part.x1.clamp(x0, x1) - x0;
            coarse_sum += row[from].iter().map(|p| f64::from(*p)).sum::<f64>();
        }
        let scale = coarse_sum * (lattice.factor * lattice.factor) as f64 / fine_sum;
        // A sliver of contact at the view's border is not worth a factor.
        if (0.5..=2.0).contains(&scale) {
            pressure.data.iter_mut().for_each(|p| *p *= scale as f32);
        }
        pressure
    }
}

/// What the solver found where there is pressure.
struct Touched<'a> {
    solution: &'a Solution,
    depth: &'a Depth,
    /// Overlap on the solver's grid, and which of its pixels walls cut.
    coarse: &'a Grid<f32>,
    cut: &'a [CutPixel],
    /// The camera's pixels around the contact's box.
    area: Rect,
    /// The highest place of the pad, mm.
    highest: f32,
}
