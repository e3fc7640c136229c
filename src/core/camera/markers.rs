//! Markers: dots printed on the pad, which show how its surface moves in its own plane.
//!
//! At rest they lie on a grid, each a little off its place, as prints are; or where they were measured. A press carries
//! them along with the surface ([`crate::gelpad::elastic::in_plane`]). Each stays round, since the surface strains little
//! over a dot.

use std::sync::Arc;

use super::CameraParams;
use super::dots::{self, Dot};
use super::lens::Lens;
use crate::base::grid::Rect;
use crate::base::view::View;
use crate::gelpad::elastic::in_plane::DisplacementField;

/// How markers are printed: their ink and arrangement, the same in every press.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerPrint {
    /// Fraction of red, green and blue light that the ink lets through, 0 to 1.
    pub color: [f64; 3],
    /// Width of the dots' soft edge, mm.
    pub edge_mm: f64,
    /// How the dots are arranged.
    pub layout: MarkerLayout,
    /// Shift of all dots along x (right) and y (down), mm.
    pub offset_mm: [f64; 2],
}

/// How markers are arranged around the middle of the view.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum MarkerLayout {
    /// On a grid that covers the view, with a dot in the middle.
    #[default]
    Endless,
    /// On a grid of so many rows and columns.
    Counted {
        /// Number of rows.
        rows: u32,
        /// Number of columns.
        columns: u32,
        /// Row and column of each dot that is not there, counted from 0 at the top left, in ascending order.
        missing: Vec<[u32; 2]>,
    },
    /// Where they were measured.
    Measured(Arc<Vec<MeasuredDot>>),
}

/// A dot whose place was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDot {
    /// Its middle, mm from the middle of the view: x right, y down.
    pub at_mm: [f64; 2],
    /// Its diameter, mm; `None`: that of the pattern.
    pub diameter_mm: Option<f64>,
}

/// The numbers of a print.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarkerPattern {
    /// Distance between neighbours along x and along y, mm. Not used for measured dots.
    pub pitch_mm: [f64; 2],
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Largest offset of a dot from its place along x and along y, mm.
    pub jitter_mm: f64,
}

impl MarkerPrint {
    /// Places the dots of a pattern that the camera may see, on the untouched pad.
    pub fn at_rest(&self, pattern: &MarkerPattern, view: &View) -> MarkerPositions {
        self.carried_positions(pattern, None, view)
    }

    /// Places the dots of a pattern that the camera may see, carried along by `moved_by`.
    pub(crate) fn carried_positions(
        &self,
        pattern: &MarkerPattern,
        moved_by: Option<&DisplacementField>,
        view: &View,
    ) -> MarkerPositions {
        let dots = self.place_dots(pattern, view);
        let moved = |mm: &[f64; 2]| {
            let by = moved_by.map_or([0.0; 2], |field| field.at(*mm));
            view.point_px([mm[0] + f64::from(by[0]), mm[1] + f64::from(by[1])])
        };
        MarkerPositions {
            color: self.color.map(|share| share as f32),
            edge_mm: self.edge_mm,
            radii_mm: dots.iter().map(|(_, diameter_mm)| 0.5 * diameter_mm).collect(),
            moved_px: dots.iter().map(|(mm, _)| moved(mm)).collect(),
            rest_px: dots.iter().map(|(mm, _)| view.point_px(*mm)).collect(),
        }
    }

    /// Returns place and diameter, mm, of each dot that the camera may see.
    fn place_dots(&self, pattern: &MarkerPattern, view: &View) -> Vec<([f64; 2], f64)> {
        // One key for all samples: the print is the same in each.
        const KEY: u64 = 0;
        let MarkerPattern { pitch_mm, diameter_mm, jitter_mm } = *pattern;
        let field_of_view_mm: [f64; 2] = std::array::from_fn(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]);
        // A dot from outside the view may move in, and reaches further by its own size.
        let margin_mm = |diameter_mm: f64| FOLLOWED_MARGIN_MM + diameter_mm;
        let printed = |at_mm: [f64; 2], column: i32, row: i32| -> [f64; 2] {
            let moved = dots::random_offset(KEY, column, row);
            std::array::from_fn(|k| at_mm[k] + moved[k] * jitter_mm + self.offset_mm[k])
        };
        let is_followed = |(at_mm, diameter_mm): &([f64; 2], f64)| {
            (0..2).all(|k| at_mm[k].abs() <= field_of_view_mm[k] / 2.0 + margin_mm(*diameter_mm))
        };
        match &self.layout {
            MarkerLayout::Endless => {
                let (offset_mm, margin_mm) = (self.offset_mm, margin_mm(diameter_mm));
                let places = dots::place_dot_grid(pitch_mm, offset_mm, jitter_mm, KEY, field_of_view_mm, margin_mm);
                places.into_iter().map(|at_mm| (at_mm, diameter_mm)).collect()
            }
            MarkerLayout::Counted { rows, columns, missing } => {
                let there = (0..*rows)
                    .flat_map(|row| (0..*columns).map(move |column| [row, column]))
                    .filter(|place| missing.binary_search(place).is_err());
                let from_middle = |index: u32, count: u32| f64::from(index) - 0.5 * f64::from(count.saturating_sub(1));
                let dot = |[row, column]: [u32; 2]| {
                    let steps = [from_middle(column, *columns), from_middle(row, *rows)];
                    let at_mm = std::array::from_fn(|k| steps[k] * pitch_mm[k]);
                    // Counted from the middle, as in a grid without end.
                    let number = |index: u32, count: u32| index as i32 - (count / 2) as i32;
                    (printed(at_mm, number(column, *columns), number(row, *rows)), diameter_mm)
                };
                there.map(dot).filter(is_followed).collect()
            }
            MarkerLayout::Measured(dots) => {
                let dot = |(number, dot): (usize, &MeasuredDot)| {
                    (printed(dot.at_mm, number as i32, 0), dot.diameter_mm.unwrap_or(diameter_mm))
                };
                dots.iter().enumerate().map(dot).filter(is_followed).collect()
            }
        }
    }
}

/// How far outside the view dots are followed, mm.
const FOLLOWED_MARGIN_MM: f64 = 1.0;

/// The markers of one press.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerPositions {
    color: [f32; 3],
    edge_mm: f64,
    /// Radius of each, mm.
    radii_mm: Vec<f64>,
    /// Where they were printed, px of the view before any lens.
    rest_px: Vec<[f64; 2]>,
    /// Where the pad carried them, px, in the same order.
    moved_px: Vec<[f64; 2]>,
}

impl MarkerPositions {
    /// Returns the markers where they were printed.
    pub(crate) fn at_rest(&self) -> Self {
        Self { moved_px: self.rest_px.clone(), ..self.clone() }
    }

    /// Iterates over the dots that the image shows at rest or moved, and returns both places in the image, px: the
    /// first pixel's centre is at (0.5, 0.5).
    pub fn in_view<'a>(
        &'a self,
        lens: Option<&'a Lens>,
        size: [usize; 2],
    ) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + 'a {
        let place = move |px: &[f64; 2]| lens.map_or(*px, |lens| lens.distort_point(*px));
        let inside = move |px: &[f64; 2]| (0..2).all(|k| (0.0..=size[k] as f64).contains(&px[k]));
        let pairs = self.rest_px.iter().zip(&self.moved_px).map(move |(rest, moved)| (place(rest), place(moved)));
        pairs.filter(move |(rest, moved)| inside(rest) || inside(moved))
    }

    /// Returns the dots as a camera sees them: a lens shifts and scales them.
    pub(super) fn project_dots(&self, camera: &CameraParams, view: &View) -> Vec<Dot> {
        let lens = camera.lens(view);
        let dot = |(px, radius_mm): (&[f64; 2], &f64)| {
            let radius_px = view.mm_per_px.map(|pixel_mm| radius_mm / pixel_mm);
            let Some(lens) = &lens else {
                return Dot { at_px: px.map(|px| px as f32), radius_px: radius_px.map(|px| px as f32) };
            };
            let edge = |k: usize, side: f64| {
                let mut at = *px;
                at[k] += side * radius_px[k];
                lens.distort_point(at)[k]
            };
            let radius_px = std::array::from_fn(|k| (0.5 * (edge(k, 1.0) - edge(k, -1.0))) as f32);
            Dot { at_px: lens.distort_point(*px).map(|px| px as f32), radius_px }
        };
        self.moved_px.iter().zip(&self.radii_mm).map(dot).collect()
    }

    /// Draws dots on the light of a part of the view.
    ///
    /// Defocus widens their edge: a ramp of width e has the standard deviation e / sqrt(12), and variances add up.
    pub(super) fn draw(
        &self,
        dots: &[Dot],
        camera: &CameraParams,
        view: &View,
        planes: &mut [Vec<f32>; 3],
        part: Rect,
    ) {
        let edge_mm = libm::sqrt(self.edge_mm * self.edge_mm + 12.0 * camera.defocus_mm * camera.defocus_mm);
        let edge_px = (edge_mm / view.mm_per_px[0].max(view.mm_per_px[1])) as f32;
        dots::draw_dots(dots, self.color, edge_px, planes, part);
    }
}
