//! Estimates the difference between the linear layer and a real one, from fits to finite elements.
//!
//! Compared with neo-Hookean finite elements (frictionless, h = 3 mm, nu = 0.48; `tests/oracle/finite_elements.py`),
//! the largest error of the surface within 2 mm of the contact is, as a share of the depth d,
//!
//! ```text
//! 1 / (1 / (A m^a) + 1 / (B s^b)) + C s^2 u^2
//! ```
//!
//! Where the object's slope m at the contact's edge is gentle, the slope decides; where the edge is a wall, the strain
//! s = d / h decides alone. Contacts that are wide compared to the pad's thickness add the last term; u is the
//! contact's area over its perimeter and h. On a curved pad t^2 D is added, with the slope t of the pad at rest at the
//! contact's edge.
//!
//! Walls count by their share of the outline and by their depth, as real objects have them (fitted to presses at finite
//! strain; `tests/bench/model_error.py`): B is 1 + 0.5 w (q - 1) times as large, where w is the walls' share and q the
//! outline over that of a disc as large, and if the object is g deep at its walls, their error is
//! (1.6 g / d)^(1 + b) times as large, at most once.
//!
//! For a layer that sticks to the object, compared with finite elements that stick
//! (`tests/oracle/sticking_elements.py`), the same formula holds with other numbers, and with C u^3 as the last term:
//! under wide contacts, points stick where they were moved to before they touched, at any strain. The linear layer's
//! force is too small then, by [`force_over_linear`].

use super::MAX_STRAIN;
use super::shear::Friction;
use crate::base::grid::{Grid, bounding_box};
use crate::base::simd::{count_true, largest_value, simd_dispatch};
use crate::base::view::SURFACE_BORDER;

/// The fitted numbers for one kind of contact.
struct ErrorFit {
    /// A and a: for an edge as gentle as a ball's.
    gentle: [f64; 2],
    /// B and b: for a wall.
    wall: [f64; 2],
    /// Term of wide contacts, as a function of strain, area over perimeter (mm), and thickness (mm).
    wide: fn(f64, f64, f64) -> f64,
}

const FRICTIONLESS: ErrorFit = ErrorFit {
    gentle: [0.0233, 1.74],
    wall: [1.27, 1.59],
    wide: |strain, width_mm, thickness_mm| {
        let wide = strain * width_mm / thickness_mm;
        0.0341 * wide * wide
    },
};
const STICKING: ErrorFit = ErrorFit {
    gentle: [0.013, 1.409],
    wall: [0.301, 1.413],
    wide: |_, width_mm, thickness_mm| {
        let width = (width_mm / thickness_mm).min(WIDEST_STICKING);
        0.0172 * width * width * width
    },
};

/// Largest u of the contacts that stick in the finite elements' table; wider ones count as this wide.
const WIDEST_STICKING: f64 = 1.5;

/// Factor of the force by which a contact that sticks exceeds the linear layer's; see [`force_over_linear`].
const STICK_STIFFENING: f64 = 10.6;
/// The width u at which half of the factor is reached.
const STIFFENING_HALF_WIDTH: f64 = 1.72;

/// Slope at the contact's edge from which on it is a wall.
pub const WALL_SLOPE: f64 = 3.0;

/// How much a long outline of walls adds to B, and the share of the depth from which on walls count fully.
const OUTLINE_FACTOR: f64 = 0.9;
const WALL_DEPTH_FACTOR: f64 = 1.6;

/// D: the term of a curved pad.
const CURVATURE_FACTOR: f64 = 1.2;

/// The edge of the contact in view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactEdge {
    /// The steepest slope of the object from a pixel in contact to a neighbour that is not. Beside a wall there is no
    /// object, and the slope is limited only by the pixel size.
    pub slope: f64,
    /// The same of the edges that are no walls.
    pub gentle_slope: f64,
    /// The contact's area over its perimeter, mm; half the radius for a disc.
    pub area_over_perimeter_mm: f64,
    /// The contact's perimeter over that of a disc as large.
    pub outline: f64,
    /// Share of the outline at which the object has a wall.
    pub wall_share: f64,
    /// How far the object reaches into the pad at its walls' lower edges, at most, mm.
    pub wall_depth_mm: f64,
}

impl ContactEdge {
    /// Measures the edge of a contact mask. `penetration` has `margin_px` more on every side. `None` if no pixel in
    /// view is at the edge.
    pub fn from_mask(mask: &Grid<u8>, penetration: &Grid<f32>, margin_px: usize, mm_per_px: [f64; 2]) -> Option<Self> {
        let wall_mm = mm_per_px.map(|mm| (WALL_SLOPE * mm) as f32);
        let part = bounding_box(mask, |value| value != 0).grown(1, mask.width, mask.height);
        let touching = |y: usize| &mask.row(y)[part.x0..part.x1];
        let object = |y: usize| &penetration.row(y + margin_px)[margin_px..][part.x0..part.x1];
        let (mut touching_px, mut sides) = (0_u64, [EdgeSides::default(); 2]);
        for y in part.y0..part.y1 {
            let here = (touching(y), object(y));
            let after = (here.0.get(1..).unwrap_or_default(), here.1.get(1..).unwrap_or_default());
            let below = if y + 1 < part.y1 { (touching(y + 1), object(y + 1)) } else { Default::default() };
            let (many, along, down) = simd_dispatch(
                #[inline(always)]
                || {
                    let many = count_true(here.0.iter().map(|value| *value != 0));
                    (many, EdgeSides::between(here, after, wall_mm[0]), EdgeSides::between(here, below, wall_mm[1]))
                },
            );
            touching_px += u64::from(many);
            sides = [sides[0].with(along), sides[1].with(down)];
        }
        // Sides between columns are as long as a pixel is high. The sides of pixels are longer than a smooth outline,
        // by 4 / pi for a disc.
        let length_mm = |count: fn(EdgeSides) -> u64| {
            let [between_columns, between_rows] = sides.map(|sides| count(sides) as f64);
            0.25 * std::f64::consts::PI * (between_columns * mm_per_px[1] + between_rows * mm_per_px[0])
        };
        let steepest = |step: fn(EdgeSides) -> f32| {
            sides.iter().zip(mm_per_px).map(|(sides, mm)| f64::from(step(*sides)) / mm).fold(0.0, f64::max)
        };
        let area = touching_px as f64 * mm_per_px[0] * mm_per_px[1];
        let perimeter_mm = length_mm(|sides| sides.count);
        (perimeter_mm > 0.0).then(|| Self {
            slope: steepest(|sides| sides.step_mm),
            gentle_slope: steepest(|sides| sides.gentle_step_mm),
            area_over_perimeter_mm: area / perimeter_mm,
            outline: perimeter_mm / libm::sqrt(4.0 * std::f64::consts::PI * area),
            wall_share: length_mm(|sides| sides.walls) / perimeter_mm,
            wall_depth_mm: f64::from(sides[0].wall_depth_mm.max(sides[1].wall_depth_mm)),
        })
    }
}

/// Sides of pixels with a pixel in contact on one hand and one that is not on the other.
#[derive(Clone, Copy, Debug, Default)]
struct EdgeSides {
    count: u64,
    /// Those at which the object has a wall.
    walls: u64,
    /// Largest difference of the object's heights, and that where there is no wall.
    step_mm: f32,
    gentle_step_mm: f32,
    /// How deep the object is beside a wall, at most.
    wall_depth_mm: f32,
}

impl EdgeSides {
    /// Measures the sides between two lines of pixels: masks, and how deep the object is.
    #[inline(always)]
    fn between(a: (&[u8], &[f32]), b: (&[u8], &[f32]), wall_mm: f32) -> Self {
        let differ = || a.0.iter().zip(b.0).map(|(a, b)| a != b);
        let heights = || a.1.iter().zip(b.1);
        let steps = || differ().zip(heights()).map(|(differ, (a, b))| if differ { (a - b).abs() } else { 0.0 });
        let at_walls = || steps().zip(heights()).map(|(step, (a, b))| if step >= wall_mm { a.max(*b) } else { 0.0 });
        Self {
            count: u64::from(count_true(differ())),
            walls: u64::from(count_true(steps().map(|step| step >= wall_mm))),
            step_mm: largest_value(steps()),
            gentle_step_mm: largest_value(steps().map(|step| if step < wall_mm { step } else { 0.0 })),
            wall_depth_mm: largest_value(at_walls()),
        }
    }

    fn with(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            walls: self.walls + other.walls,
            step_mm: self.step_mm.max(other.step_mm),
            gentle_step_mm: self.gentle_step_mm.max(other.gentle_step_mm),
            wall_depth_mm: self.wall_depth_mm.max(other.wall_depth_mm),
        }
    }
}

impl ErrorFit {
    fn error_mm(&self, depth_mm: f64, thickness_mm: f64, edge: ContactEdge) -> f64 {
        let strain = (depth_mm / thickness_mm).max(0.0);
        let gentle = |slope: f64| self.gentle[0] * libm::pow(slope.max(0.0), self.gentle[1]);
        let wall = self.wall[0] * libm::pow(strain, self.wall[1]);
        // A harmonic sum: the smaller of the two errors decides.
        let beside = |gentle: f64, wall: f64| {
            if gentle > 0.0 && wall > 0.0 { 1.0 / (1.0 / gentle + 1.0 / wall) } else { 0.0 }
        };
        let mut share = beside(gentle(edge.gentle_slope), wall);
        if edge.wall_share > 0.0 && depth_mm > 0.0 {
            let longer = 1.0 + OUTLINE_FACTOR * edge.wall_share * (edge.outline - 1.0).max(0.0);
            let deep = (WALL_DEPTH_FACTOR * edge.wall_depth_mm / depth_mm).clamp(0.0, 1.0);
            let at_walls = beside(gentle(edge.slope), wall * longer) * libm::pow(deep, 1.0 + self.wall[1]);
            share = share.max(at_walls);
        }
        depth_mm * (share + (self.wide)(strain, edge.area_over_perimeter_mm, thickness_mm))
    }
}

/// Largest u for which the fits are used; the widest contact in the finite elements' tables has 1.92, measured as here.
const WIDEST_KNOWN: f64 = 2.0;

/// Reason why the error of a contact is not known: it is too deep.
pub const TOO_DEEP: &str =
    "the object is pressed deeper than half of the pad's thickness, where the law for this error ends";
/// Reason why the error of a contact is not known: it is too wide.
pub const TOO_WIDE: &str = "the contact, as far as it is in view, is wider beside the pad's thickness than those that the law for this error was fitted to";

/// Returns the largest expected error of the surface within 2 mm of the contact, mm, for an object `depth_mm` deep.
/// With Coulomb friction it is the larger one of the errors without friction and with full stick.
///
/// # Errors
///
/// [`TOO_DEEP`] and [`TOO_WIDE`] outside the range of the fits. The error grows with the square of the width; a contact
/// with hardly any edge in view would get an error of metres.
pub fn model_error_mm(
    depth_mm: f64,
    thickness_mm: f64,
    edge: ContactEdge,
    friction: Option<Friction>,
) -> Result<f64, &'static str> {
    if depth_mm > MAX_STRAIN * thickness_mm {
        return Err(TOO_DEEP);
    }
    if edge.area_over_perimeter_mm > WIDEST_KNOWN * thickness_mm {
        return Err(TOO_WIDE);
    }
    let of = |fit: ErrorFit| fit.error_mm(depth_mm, thickness_mm, edge);
    Ok(match friction {
        None => of(FRICTIONLESS),
        Some(Friction::Stick) => of(STICKING),
        Some(Friction::Coulomb { .. }) => of(FRICTIONLESS).max(of(STICKING)),
    })
}

/// Returns the ratio of a sticking contact's force to the linear layer's: 1 + 10.6 e^2 u / (u + 1.72). Here e is the
/// mean displacement in the contact over the pad's thickness, and u the contact's area over its perimeter and that
/// thickness. Without an edge in view, the contact counts as infinitely wide.
pub fn force_over_linear(mean_mm: f64, thickness_mm: f64, edge: Option<ContactEdge>) -> f64 {
    let strain = mean_mm / thickness_mm;
    let confined = edge.map_or(1.0, |edge| {
        let width = edge.area_over_perimeter_mm / thickness_mm;
        width / (width + STIFFENING_HALF_WIDTH)
    });
    1.0 + STICK_STIFFENING * strain * strain * confined
}

/// Returns the error that a curved pad adds, mm. `drop_mm` is how far the pad lies below its highest point, with
/// [`SURFACE_BORDER`] around the mask.
pub fn curvature_error_mm(depth_mm: f64, mask: &Grid<u8>, drop_mm: &Grid<f32>, mm_per_px: [f64; 2]) -> f64 {
    let per_px = mm_per_px.map(|mm| (0.5 / mm) as f32);
    let slope_squared = |x: usize, y: usize| {
        let row = |down: usize| &drop_mm.row(y + SURFACE_BORDER + down - 1)[SURFACE_BORDER - 1..];
        let (upper, here, lower) = (row(0), row(1), row(2));
        let [across, down] = [(here[x + 2] - here[x]) * per_px[0], (lower[x + 1] - upper[x + 1]) * per_px[1]];
        f64::from(across * across + down * down)
    };
    let mut steepest_squared = 0.0_f64;
    for y in 0..mask.height {
        let touching = mask.row(y);
        let (above, below) = (mask_in_row(mask, y.checked_sub(1)), mask_in_row(mask, Some(y + 1)));
        for x in 0..mask.width {
            let beside = [x.checked_sub(1).map(|x| touching[x]), touching.get(x + 1).copied(), above(x), below(x)];
            if beside.into_iter().flatten().any(|other| other != touching[x]) {
                steepest_squared = steepest_squared.max(slope_squared(x, y));
            }
        }
    }
    depth_mm * CURVATURE_FACTOR * steepest_squared
}

/// Error on a gel of even thickness over a curved core, per depth and per radian by which the gel turns under the
/// contact.
const TURN_FACTOR: f64 = 0.2;
/// Least share of a flat layer's error that remains where both errors cancel each other.
const MIN_FLAT_SHARE: f64 = 0.5;

/// Returns the ratio of a contact's force on a gel of even thickness over a curved core to that on a flat layer. The
/// material narrows towards a core that is bent outwards, as if the layer were thicker by 1 / (1 - h c), where c is the
/// core's mean curvature. The force begins as that of a half-space times 1 + C a / h, with the contact's radius a and C
/// of Dimitriadis et al. (2002), so the ratio is 1 / (1 + C a c). Nothing is known of hollow cores: they count as flat.
/// The curvature is limited to 1 / h: a thicker gel would leave no core.
pub fn force_on_core(radius_mm: f64, curvature_per_mm: f64, thickness_mm: f64, poisson_ratio: f64) -> f64 {
    let bent = curvature_per_mm.min(1.0 / thickness_mm).max(0.0);
    let nu = poisson_ratio;
    let per_radius = 2.0 / std::f64::consts::PI * (1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    1.0 / (1.0 + per_radius * radius_mm * bent)
}

/// Returns the largest expected error of the surface on a curved core, mm. `flat_mm` is a flat layer's error,
/// `turn_rad` the angle of the gel from the contact's centre to its edge. The core lowers the pad beside the contact,
/// large strains raise it. The estimate is within a factor of 2.3 of 16 presses on domes.
pub fn error_on_core_mm(flat_mm: f64, depth_mm: f64, turn_rad: f64) -> f64 {
    (TURN_FACTOR * depth_mm * turn_rad - flat_mm).abs().max(MIN_FLAT_SHARE * flat_mm)
}

/// Returns the mask in a row, if there is one.
fn mask_in_row(mask: &Grid<u8>, row: Option<usize>) -> impl Fn(usize) -> Option<u8> {
    let row = row.filter(|row| *row < mask.height);
    move |x| row.map(|row| mask.at(x, row))
}

/// Estimates the root mean square of the error within 2 mm of the contact from the largest error: 0.29 to 0.90 of it in
/// the finite elements' table, least beside walls.
pub fn ring_rms_mm(largest_mm: f64, depth_mm: f64) -> f64 {
    if depth_mm > 0.0 { 0.68 * largest_mm / (1.0 + 4.0 * largest_mm / depth_mm) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A round contact whose edge is equally steep all around.
    fn disc(slope: f64, area_over_perimeter_mm: f64, depth_mm: f64) -> ContactEdge {
        let wall_share = if slope < WALL_SLOPE { 0.0 } else { 1.0 };
        let gentle_slope = if slope < WALL_SLOPE { slope } else { 0.0 };
        let wall_depth_mm = wall_share * depth_mm;
        ContactEdge { slope, gentle_slope, area_over_perimeter_mm, outline: 1.0, wall_share, wall_depth_mm }
    }

    #[test]
    fn walls_count_by_their_share_of_the_outline_and_by_their_depth() {
        // A wall above, 0.5 mm deep, and gentle edges.
        let rows = [[-1.0, -1.0, -1.0], [0.1, 0.5, 0.1], [0.0, 0.4, 0.0], [-0.1, 0.3, 0.0]];
        let mut penetration = Grid::new(3, 4);
        penetration.data = rows.as_flattened().to_vec();
        let mut mask = Grid::new(3, 4);
        mask.data = vec![0, 0, 0, 0, 255, 0, 0, 255, 0, 0, 0, 0];
        let edge = ContactEdge::from_mask(&mask, &penetration, 0, [0.2; 2]).expect("an edge");
        assert!((edge.wall_share - 1.0 / 6.0).abs() < 1e-9 && (edge.wall_depth_mm - 0.5).abs() < 1e-6, "{edge:?}");
        assert!((edge.slope - 7.5).abs() < 1e-5 && (edge.gentle_slope - 2.0).abs() < 1e-5, "{edge:?}");
        let of = |edge| model_error_mm(0.6, 3.0, edge, None).expect("within what was fitted");
        let walls = disc(10.0, 0.5, 0.6);
        let long = ContactEdge { outline: 3.0, ..walls };
        let shallow = ContactEdge { wall_depth_mm: 0.1, gentle_slope: 0.5, ..walls };
        assert!(of(long) > 1.2 * of(walls) && of(shallow) < 0.2 * of(walls));
        assert!(of(shallow) >= of(disc(0.5, 0.5, 0.6)));
    }

    #[test]
    fn the_steepest_edge_counts_and_what_lies_within_the_contact_does_not() {
        // A margin of 1; a step within the contact, a gentle edge to the right, a steeper one below.
        let rows = [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.5, 0.2, 0.1, 0.0],
            [0.0, 0.5, 0.2, 0.1, 0.0],
            [0.0, 0.1, -0.1, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ];
        let mut penetration = Grid::new(5, 5);
        penetration.data = rows.as_flattened().to_vec();
        let mut mask = Grid::new(3, 3);
        mask.data = vec![255, 255, 0, 255, 255, 0, 0, 0, 0];
        let edge = ContactEdge::from_mask(&mask, &penetration, 1, [0.1, 0.2]).expect("an edge");
        // 0.4 mm over 0.2 mm down, 0.1 mm over 0.1 mm to the right.
        assert!((edge.slope - 2.0).abs() < 1e-6, "{edge:?}");
        assert!((edge.gentle_slope, edge.wall_share) == (edge.slope, 0.0), "{edge:?}");
        // Four pixels of 0.1 mm x 0.2 mm, two sides of 0.2 mm and two of 0.1 mm.
        assert!((edge.area_over_perimeter_mm - 0.08 / (0.6 * std::f64::consts::FRAC_PI_4)).abs() < 1e-9, "{edge:?}");
        for without in [255, 0] {
            mask.data.fill(without);
            assert_eq!(ContactEdge::from_mask(&mask, &penetration, 1, [0.1, 0.2]), None);
        }
    }

    #[test]
    fn the_area_of_a_disc_over_its_perimeter_is_half_its_radius() {
        let mut mask = Grid::new(100, 100);
        for y in 0..100_usize {
            for x in 0..100_usize {
                mask.row_mut(y)[x] = if x.abs_diff(50).pow(2) + y.abs_diff(50).pow(2) < 1600 { 255 } else { 0 };
            }
        }
        let edge = ContactEdge::from_mask(&mask, &Grid::new(100, 100), 0, [0.05; 2]).expect("an edge");
        assert!((edge.area_over_perimeter_mm - 1.0).abs() < 0.03, "{edge:?}");
    }

    #[test]
    fn the_error_grows_with_depth_slope_and_width_and_is_not_known_beyond_what_was_fitted() {
        let known = |depth_mm, slope, area_over_perimeter_mm| {
            model_error_mm(depth_mm, 3.0, disc(slope, area_over_perimeter_mm, depth_mm), None)
        };
        let of = |depth_mm, slope, width_mm| known(depth_mm, slope, width_mm).expect("within what was fitted");
        assert_eq!(of(0.0, 1.0, 1.0), 0.0);
        assert_eq!(of(1.0, 0.0, 0.0), 0.0);
        let errors = [0.0, 0.1, 1.0, 10.0, 1e3, 1e30].map(|slope| of(0.6, slope, 0.5));
        assert!(errors.is_sorted() && errors[0] > 0.0 && errors[5] < 0.6, "{errors:?}");
        let errors = [1e-30, 0.1, 0.5, 1.0, 1.5].map(|depth_mm| of(depth_mm, 2.0, 1.0));
        assert!(errors.is_sorted() && errors.iter().all(|mm| mm.is_finite()), "{errors:?}");
        assert!(of(0.6, 0.5, 3.0) > of(0.6, 0.5, 1.0));
        assert_eq!(known(1.51, 0.5, 1.0), Err(TOO_DEEP));
        // A contact that fills the view but for a few pixels.
        assert_eq!(known(0.6, 0.5, 50.0), Err(TOO_WIDE));
    }

    #[test]
    fn the_error_of_a_contact_that_slips_in_parts_is_the_larger_one() {
        for (slope, area_over_perimeter_mm) in [(0.3, 0.5), (100.0, 0.5), (0.3, 4.0), (100.0, 4.8)] {
            let edge = disc(slope, area_over_perimeter_mm, 0.6);
            let of = |friction| model_error_mm(0.6, 3.0, edge, friction).expect("within what was fitted");
            let [slides, sticks] = [of(None), of(Some(Friction::Stick))];
            assert_eq!(of(Some(Friction::Coulomb { coefficient: 0.5 })), slides.max(sticks));
            assert!(slides > 0.0 && sticks > 0.0 && sticks < 0.6, "{slides}, {sticks}");
        }
    }

    #[test]
    fn forces_grow_with_compression_and_width_and_are_linear_theory_s_without_either() {
        let edge = |area_over_perimeter_mm| Some(disc(1.0, area_over_perimeter_mm, 0.5));
        assert_eq!(force_over_linear(0.0, 3.0, edge(1.0)), 1.0);
        assert_eq!(force_over_linear(0.5, 3.0, edge(0.0)), 1.0);
        let by_width = [edge(0.1), edge(1.0), edge(10.0), None].map(|edge| force_over_linear(0.5, 3.0, edge));
        assert!(by_width.is_sorted() && by_width[0] > 1.0 && by_width[3] < 1.4, "{by_width:?}");
    }
}
