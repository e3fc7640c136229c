//! Checks the circles of all presses against what changed in their images. One mistake in a table, such as two
//! exchanged columns, moves all of them alike; the correction that moves them back identifies the mistake.

use rayon::prelude::*;

use super::super::detect::change::{BlockChange, change_energy};
use super::super::{Observation, Session};
use crate::metrics::statistics::median;
use crate::presses::Circle;
use gelsim_files::diagnostic::Diagnostic;

/// Radius within which the change of a press is counted, in radii. Measured: with correct circles at least 0.65 of the
/// change of real presses lies within.
const REACH: f64 = 1.3;
/// Median fraction of the change that circles hold if they are on the discs.
const HELD: f64 = 0.55;
/// What corrected circles must hold, how much more than the given ones, and in which fraction of the presses.
const MOVED: f64 = 0.5;
const BETTER: f64 = 0.15;
const MAX_PRESSES: f64 = 0.7;
/// Fraction of the change that defines a disc's radius; and the medians of that radius, in radii of the circle, below
/// and above which the circles have diameters or half radii. Real presses: 0.95 to 1.53; with diameters in place of
/// radii 0.47 to 0.77.
const HOLDING: f64 = 0.8;
const DIAMETERS: f64 = 0.82;
const HALVES: f64 = 1.75;
/// Largest median distance of the change's middle from the circle's, in radii, if the circle is on the disc.
const OFF: f64 = 0.8;
/// Images in which no block has changed by more than so many times the typical size look like the background.
const UNCHANGED: f64 = 6.0;

/// Change by a press above the usual, on blocks.
struct ChangeShares {
    block_px: f64,
    width: usize,
    /// Fraction of the total change in each block.
    shares: Vec<f64>,
    is_unchanged: bool,
}

impl ChangeShares {
    fn from_press(press: &Observation, session: &Session) -> Self {
        let change = BlockChange::on_coarse_blocks(&press.image, &session.background);
        let usual = change.typical_size();
        let above: Vec<f64> =
            change.levels.data.iter().map(|level| (change_energy(*level) - 4.0 * usual * usual).max(0.0)).collect();
        let all: f64 = above.iter().sum();
        let most = change.levels.data.iter().map(|level| change_energy(*level)).fold(0.0, f64::max);
        Self {
            block_px: change.block_px as f64,
            width: change.levels.width,
            shares: above.iter().map(|above| if all > 0.0 { above / all } else { 0.0 }).collect(),
            is_unchanged: most < UNCHANGED * UNCHANGED * usual * usual,
        }
    }

    /// Returns centre and radius of a circle, in blocks.
    fn on_blocks(&self, circle: &Circle) -> ([f64; 2], f64) {
        (circle.centre_px.map(|at| (at + 0.5) / self.block_px - 0.5), circle.radius_px / self.block_px)
    }

    /// Fraction of the change within [`REACH`] radii, less the fraction of the view there: what would be there by
    /// chance.
    fn held_fraction(&self, circle: &Circle) -> f64 {
        let ([cx, cy], radius) = self.on_blocks(circle);
        let (mut share, mut area) = (0.0, 0.0);
        for (at, of_block) in self.shares.iter().enumerate() {
            let distance = ((at % self.width) as f64 - cx).hypot((at / self.width) as f64 - cy);
            // A soft rim as wide as a block.
            let inside = (REACH * radius + 0.5 - distance).clamp(0.0, 1.0);
            share += inside * of_block;
            area += inside;
        }
        share - area / self.shares.len().max(1) as f64
    }

    /// Distance of the change's middle from the circle's, in radii.
    fn centre_offset(&self, circle: &Circle) -> f64 {
        let ([cx, cy], radius) = self.on_blocks(circle);
        let sum =
            |of: &dyn Fn(usize) -> f64| self.shares.iter().enumerate().map(|(at, share)| share * of(at)).sum::<f64>();
        (sum(&|at| (at % self.width) as f64) - cx).hypot(sum(&|at| (at / self.width) as f64) - cy) / radius
    }

    /// Radius that holds 80 % of the change, in radii of the circle.
    fn holding_radius(&self, circle: &Circle) -> f64 {
        let ([cx, cy], radius) = self.on_blocks(circle);
        let mut by_distance: Vec<(f64, f64)> = self
            .shares
            .iter()
            .enumerate()
            .map(|(at, share)| (((at % self.width) as f64 - cx).hypot((at / self.width) as f64 - cy), *share))
            .collect();
        by_distance.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        let reached = by_distance.into_iter().find(|(_, share)| {
            sum += share;
            sum >= HOLDING
        });
        reached.map_or(f64::INFINITY, |(distance, _)| distance / radius)
    }
}

/// A mistake that would move all circles alike: its description, what to write instead, and the correction.
struct CircleMistake {
    what: String,
    help: String,
    /// Returns the circle that was meant by that of a press.
    correct_circle: Box<dyn Fn(&Circle) -> Circle + Sync>,
}

/// Lists the known mistakes, for a view of this width and height, px, and this pixel size.
fn known_mistakes([width, height]: [f64; 2], mm_per_px: f64) -> Vec<CircleMistake> {
    let (right, low) = (width - 1.0, height - 1.0);
    let mut all = Vec::new();
    let mut add = |what: String, help: String, meant: Box<dyn Fn(&Circle) -> Circle + Sync>| {
        all.push(CircleMistake { what, help, correct_circle: meant });
    };
    type Move = fn([f64; 2], [f64; 2]) -> [f64; 2];
    let moves: [(&str, String, Move); 7] = [
        (
            "`centre_x_px` and `centre_y_px` look exchanged",
            "exchange the two names in the table's first line".to_owned(),
            |[x, y], _| [y, x],
        ),
        (
            "`centre_y_px` looks counted from the lower edge",
            format!("write {low} - centre_y_px: rows count from the upper edge down"),
            |[x, y], [_, low]| [x, low - y],
        ),
        (
            "`centre_x_px` looks counted from the right edge",
            format!("write {right} - centre_x_px: columns count from the left edge"),
            |[x, y], [right, _]| [right - x, y],
        ),
        (
            "the circles look like those of images turned by 180 degrees",
            format!("write {right} - centre_x_px and {low} - centre_y_px; or turn the images"),
            |[x, y], [right, low]| [right - x, low - y],
        ),
        (
            "the circles look like those of images turned by 90 degrees",
            format!("exchange `centre_x_px` and `centre_y_px`, then write {right} - centre_x_px; or turn the images"),
            |[x, y], [right, _]| [right - y, x],
        ),
        (
            "the circles look like those of images turned by 90 degrees",
            format!("exchange `centre_x_px` and `centre_y_px`, then write {low} - centre_y_px; or turn the images"),
            |[x, y], [_, low]| [y, low - x],
        ),
        (
            "the circles look like those of images turned by 90 degrees and mirrored",
            format!(
                "exchange `centre_x_px` and `centre_y_px`, then write {right} - centre_x_px and {low} - centre_y_px; or turn the \
                 images"
            ),
            |[x, y], [right, low]| [right - y, low - x],
        ),
    ];
    for (what, help, to) in moves {
        let meant = move |circle: &Circle| Circle { centre_px: to(circle.centre_px, [right, low]), ..*circle };
        add(what.to_owned(), help, Box::new(meant));
    }
    add(
        "`centre_x_px` and `centre_y_px` look like the upper left corner of a box around the disc".to_owned(),
        "add radius_px to both: they are the middle of the disc".to_owned(),
        Box::new(|circle| Circle { centre_px: circle.centre_px.map(|at| at + circle.radius_px), ..*circle }),
    );
    let scaled = |x: f64, y: f64, radius: f64| {
        move |circle: &Circle| {
            let [cx, cy] = circle.centre_px;
            Circle { centre_px: [x * cx, y * cy], radius_px: radius * circle.radius_px }
        }
    };
    add(
        "the circles look like fractions of the image's width and height".to_owned(),
        format!("multiply `centre_x_px` and `radius_px` by {width}, and `centre_y_px` by {height}"),
        Box::new(scaled(width, height, width)),
    );
    add(
        "the circles look like millimetres from the upper left corner".to_owned(),
        "divide `centre_x_px`, `centre_y_px` and `radius_px` by mm_per_px".to_owned(),
        Box::new(scaled(1.0 / mm_per_px, 1.0 / mm_per_px, 1.0 / mm_per_px)),
    );
    for (by, times) in [
        (0.5, "twice"),
        (0.25, "four times"),
        (1.0 / 3.0, "three times"),
        (2.0 / 3.0, "1.5 times"),
        (0.75, "4/3 times"),
        (2.0, "half"),
        (4.0, "a quarter"),
        (3.0, "a third"),
        (1.5, "2/3"),
        (4.0 / 3.0, "3/4"),
    ] {
        add(
            format!("the circles look like those of an image {times} as wide"),
            format!(
                "multiply `centre_x_px`, `centre_y_px` and `radius_px` by {:.3}; mm_per_px is that of these images, {width:.0}x{height:.0} px",
                by
            ),
            Box::new(scaled(by, by, by)),
        );
    }
    all
}

/// Fraction of each press's change that its circle holds.
fn held_fractions(changed: &[ChangeShares], circles: &[Circle]) -> Vec<f64> {
    changed.par_iter().zip(circles).map(|(changed, circle)| changed.held_fraction(circle)).collect()
}

fn median_or_zero(values: &[f64]) -> f64 {
    median(values).unwrap_or(0.0)
}

/// Medians over a session: the fraction of the change that the circles hold, and the radius that holds 80 % of it, in
/// radii of the circles.
pub fn circle_statistics(session: &Session) -> [f64; 2] {
    let changed: Vec<ChangeShares> =
        session.observations.par_iter().map(|press| ChangeShares::from_press(press, session)).collect();
    let circles: Vec<Circle> = session.observations.iter().map(|press| press.circle).collect();
    let holding: Vec<f64> =
        changed.iter().zip(&circles).map(|(changed, circle)| changed.holding_radius(circle)).collect();
    [median_or_zero(&held_fractions(&changed, &circles)), median_or_zero(&holding)]
}

/// Returns the findings against the circles of all presses.
pub fn judge_circles(session: &Session) -> Vec<Diagnostic> {
    let presses = &session.observations;
    let changed: Vec<ChangeShares> = presses.par_iter().map(|press| ChangeShares::from_press(press, session)).collect();
    let same: Vec<&Observation> =
        presses.iter().zip(&changed).filter(|(_, changed)| changed.is_unchanged).map(|(press, _)| press).collect();
    if 2 * same.len() >= presses.len().max(1) {
        let help = "name images of a ball in the pad; where the contact is faint, press deeper";
        let message = |press: &Observation| format!("{}: it shows nothing that is not in the background", press.file);
        let cause = "images show nothing that is not in the background";
        return same
            .into_iter()
            .map(|press| Diagnostic::new(message(press)).about(press.file.as_str(), cause).help(help))
            .collect();
    }
    let circles: Vec<Circle> = presses.iter().map(|press| press.circle).collect();
    let own = held_fractions(&changed, &circles);
    let of_each = |of: fn(&ChangeShares, &Circle) -> f64| {
        median_or_zero(&changed.iter().zip(&circles).map(|(changed, circle)| of(changed, circle)).collect::<Vec<_>>())
    };
    let (radius, is_on_disc) = (of_each(ChangeShares::holding_radius), of_each(ChangeShares::centre_offset) < OFF);
    if is_on_disc && radius < DIAMETERS {
        let message = format!(
            "`radius_px` looks like a diameter: 80 % of what changed lies within {radius:.2} of it, of real discs 0.95 to 1.5"
        );
        return vec![Diagnostic::new(message).help("write half of it: the radius of the disc in pixels")];
    }
    if is_on_disc && radius > HALVES {
        let message = format!(
            "`radius_px` looks like half of the radius: 80 % of what changed lies within {radius:.2} of it, of real discs 0.95 to \
             1.5"
        );
        return vec![Diagnostic::new(message).help("write the radius of the disc that you see, in pixels")];
    }
    let is_elsewhere = median_or_zero(&own) < HELD;
    find_common_mistake(session, &changed, &circles, &own).filter(|_| is_elsewhere).into_iter().collect()
}

/// Finds the mistake that best explains why the circles, which hold `own` of the change, are not on the discs.
fn find_common_mistake(
    session: &Session,
    changed: &[ChangeShares],
    circles: &[Circle],
    own: &[f64],
) -> Option<Diagnostic> {
    let is_better = |tried: &[f64]| {
        let better = tried.iter().zip(own).filter(|(tried, own)| tried > own).count() as f64;
        median_or_zero(tried) >= MOVED
            && median_or_zero(tried) >= median_or_zero(own) + BETTER
            && better >= MAX_PRESSES * own.len() as f64
    };
    let [width, height] = session.camera.resolution_px.map(|px| px as f64);
    let known = known_mistakes([width, height], session.camera.mm_per_px[0]).into_iter().map(|mistake| {
        let meant: Vec<Circle> = circles.iter().map(|circle| (mistake.correct_circle)(circle)).collect();
        (held_fractions(changed, &meant), mistake)
    });
    let best = known
        .filter(|(tried, _)| is_better(tried))
        .max_by(|(a, _), (b, _)| median_or_zero(a).total_cmp(&median_or_zero(b)));
    let rows = find_swapped_rows(session, changed, circles).filter(|(tried, _)| is_better(tried));
    match (best, rows) {
        // One of many rows' circles fits more easily by chance than one of few mistakes: prefer the mistake.
        (Some((tried, mistake)), rows)
            if rows.as_ref().is_none_or(|(of_rows, _)| median_or_zero(&tried) > median_or_zero(of_rows) - 0.05) =>
        {
            Some(Diagnostic::new(mistake.what).help(mistake.help))
        }
        (_, rows) => rows.map(|(_, found)| found),
    }
}

/// Checks whether circles belong to other rows' images, by the circle that holds most of each press's change.
fn find_swapped_rows(
    session: &Session,
    changed: &[ChangeShares],
    circles: &[Circle],
) -> Option<(Vec<f64>, Diagnostic)> {
    /// Most rows: each is tried with each, which would take minutes for more.
    const MAX_ROWS: usize = 300;
    if circles.len() > MAX_ROWS {
        return None;
    }
    let best = |changed: &ChangeShares| {
        let held = circles.iter().map(|circle| changed.held_fraction(circle)).enumerate();
        held.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    };
    let found: Vec<(usize, f64)> = changed.par_iter().map(best).collect();
    let others = found.iter().enumerate().filter(|(press, (row, _))| press != row).count();
    let mut rows: Vec<usize> = found.iter().map(|(row, _)| *row).collect();
    rows.sort_unstable();
    rows.dedup();
    // Each row's circle must belong to a single image.
    if others * 2 < found.len() || (rows.len() as f64) < MAX_PRESSES * found.len() as f64 {
        return None;
    }
    let first = found.iter().enumerate().find(|(press, (row, _))| press != row)?;
    let name = |press: usize| session.observations[press].file.as_str();
    let message = format!(
        "the circles look exchanged between the rows: {others} of {} images agree with the circle of another one, {} with that of {}",
        found.len(),
        name(first.0),
        name(first.1.0)
    );
    let held = found.iter().map(|(_, held)| *held).collect();
    Some((held, Diagnostic::new(message).help("write each circle into the row of its own image")))
}
