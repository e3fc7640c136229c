//! The circles of all presses against what changed in their images: one mistake in a table, such as two columns exchanged,
//! moves all of them alike, and what moves them back is the mistake.

use rayon::prelude::*;

use super::super::detect::change::{Change, energy};
use super::super::{Observation, Session};
use crate::metrics::statistics::median;
use crate::presses::Circle;
use gelsim_files::diagnostic::Diagnostic;

/// What is counted of a press lies within so many radii. Measured: of real presses 0.65 of the change and more, with the
/// circles as they are.
const REACH: f64 = 1.3;
/// Circles that hold so much of the change, the median, are where the discs are.
const HELD: f64 = 0.55;
/// What moves the circles must hold so much, and more than they do by so much, in so many of the presses.
const MOVED: f64 = 0.5;
const BETTER: f64 = 0.15;
const MOST_PRESSES: f64 = 0.7;
/// Radius that holds 80 % of the change, in radii of the circle, the median. Real presses: 0.95 to 1.53; of diameters in
/// place of radii 0.47 to 0.77.
const HOLDING: f64 = 0.8;
const DIAMETERS: f64 = 0.82;
const HALVES: f64 = 1.75;
/// The middle of what changed is nearer to the circle's than this, in radii, the median, where the circle is on the disc.
const OFF: f64 = 0.8;
/// Images in which no block has changed by so many times the usual are as the background is.
const UNCHANGED: f64 = 6.0;

/// What a press changed, above what changes anyhow, on blocks.
struct ChangeMap {
    block_px: f64,
    width: usize,
    /// Fraction of all that changed in each block.
    shares: Vec<f64>,
    is_none: bool,
}

impl ChangeMap {
    fn of(press: &Observation, session: &Session) -> Self {
        let change = Change::coarse(&press.image, &session.background);
        let usual = change.usual();
        let above: Vec<f64> =
            change.levels.data.iter().map(|level| (energy(*level) - 4.0 * usual * usual).max(0.0)).collect();
        let all: f64 = above.iter().sum();
        let most = change.levels.data.iter().map(|level| energy(*level)).fold(0.0, f64::max);
        Self {
            block_px: change.block_px as f64,
            width: change.levels.width,
            shares: above.iter().map(|above| if all > 0.0 { above / all } else { 0.0 }).collect(),
            is_none: most < UNCHANGED * UNCHANGED * usual * usual,
        }
    }

    fn on_blocks(&self, circle: &Circle) -> ([f64; 2], f64) {
        (circle.centre_px.map(|at| (at + 0.5) / self.block_px - 0.5), circle.radius_px / self.block_px)
    }

    /// How much of it is within [`REACH`] radii, less the fraction of the view that is: as much as is there by chance.
    fn held(&self, circle: &Circle) -> f64 {
        let ([cx, cy], radius) = self.on_blocks(circle);
        let (mut share, mut area) = (0.0, 0.0);
        for (at, of_block) in self.shares.iter().enumerate() {
            let distance = ((at % self.width) as f64 - cx).hypot((at / self.width) as f64 - cy);
            // A rim of the width of a block.
            let inside = (REACH * radius + 0.5 - distance).clamp(0.0, 1.0);
            share += inside * of_block;
            area += inside;
        }
        share - area / self.shares.len().max(1) as f64
    }

    /// How far the middle of it is from that of the circle, in radii.
    fn off(&self, circle: &Circle) -> f64 {
        let ([cx, cy], radius) = self.on_blocks(circle);
        let sum =
            |of: &dyn Fn(usize) -> f64| self.shares.iter().enumerate().map(|(at, share)| share * of(at)).sum::<f64>();
        (sum(&|at| (at % self.width) as f64) - cx).hypot(sum(&|at| (at / self.width) as f64) - cy) / radius
    }

    /// The radius that holds 80 % of it, in radii of the circle.
    fn holding(&self, circle: &Circle) -> f64 {
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

/// One mistake that would move all circles alike: what it looks like, what to write instead, and where the circle was meant.
struct Mistake {
    what: String,
    help: String,
    /// The circle that is meant by that of a press, in a view of this width and height.
    meant: Box<dyn Fn(&Circle) -> Circle + Sync>,
}

/// The mistakes that are known, of a view of this size and pixels of this many mm.
fn mistakes([width, height]: [f64; 2], mm_per_px: f64) -> Vec<Mistake> {
    let (right, low) = (width - 1.0, height - 1.0);
    let mut all = Vec::new();
    let mut add = |what: String, help: String, meant: Box<dyn Fn(&Circle) -> Circle + Sync>| {
        all.push(Mistake { what, help, meant });
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

/// How much of the change given circles hold.
fn held(changed: &[ChangeMap], circles: &[Circle]) -> Vec<f64> {
    changed.par_iter().zip(circles).map(|(changed, circle)| changed.held(circle)).collect()
}

fn middle(values: &[f64]) -> f64 {
    median(values).unwrap_or(0.0)
}

/// How much of the change the circles of a session hold, and the radius that holds 80 % of it in radii of theirs: medians.
pub fn figures(session: &Session) -> [f64; 2] {
    let changed: Vec<ChangeMap> = session.observations.par_iter().map(|press| ChangeMap::of(press, session)).collect();
    let circles: Vec<Circle> = session.observations.iter().map(|press| press.circle).collect();
    let holding: Vec<f64> = changed.iter().zip(&circles).map(|(changed, circle)| changed.holding(circle)).collect();
    [middle(&held(&changed, &circles)), middle(&holding)]
}

/// What speaks against the circles of all presses.
pub fn findings(session: &Session) -> Vec<Diagnostic> {
    let presses = &session.observations;
    let changed: Vec<ChangeMap> = presses.par_iter().map(|press| ChangeMap::of(press, session)).collect();
    let same: Vec<&Observation> =
        presses.iter().zip(&changed).filter(|(_, changed)| changed.is_none).map(|(press, _)| press).collect();
    if 2 * same.len() >= presses.len().max(1) {
        let help = "name images of a ball in the pad; where the contact is faint, press deeper";
        let message = |press: &Observation| format!("{}: it shows nothing that is not in the background", press.file);
        let cause = "images show nothing that is not in the background";
        return same
            .into_iter()
            .map(|press| Diagnostic::new(message(press)).of(press.file.as_str(), cause).help(help))
            .collect();
    }
    let circles: Vec<Circle> = presses.iter().map(|press| press.circle).collect();
    let own = held(&changed, &circles);
    let of_each = |of: fn(&ChangeMap, &Circle) -> f64| {
        middle(&changed.iter().zip(&circles).map(|(changed, circle)| of(changed, circle)).collect::<Vec<_>>())
    };
    let (radius, is_on_disc) = (of_each(ChangeMap::holding), of_each(ChangeMap::off) < OFF);
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
    let is_elsewhere = middle(&own) < HELD;
    moved(session, &changed, &circles, &own).filter(|_| is_elsewhere).into_iter().collect()
}

/// The mistake that explains best why the circles, which hold `own`, are not on the discs.
fn moved(session: &Session, changed: &[ChangeMap], circles: &[Circle], own: &[f64]) -> Option<Diagnostic> {
    let is_better = |tried: &[f64]| {
        let better = tried.iter().zip(own).filter(|(tried, own)| tried > own).count() as f64;
        middle(tried) >= MOVED && middle(tried) >= middle(own) + BETTER && better >= MOST_PRESSES * own.len() as f64
    };
    let [width, height] = session.camera.resolution_px.map(|px| px as f64);
    let known = mistakes([width, height], session.camera.mm_per_px[0]).into_iter().map(|mistake| {
        let meant: Vec<Circle> = circles.iter().map(|circle| (mistake.meant)(circle)).collect();
        (held(changed, &meant), mistake)
    });
    let best = known.filter(|(tried, _)| is_better(tried)).max_by(|(a, _), (b, _)| middle(a).total_cmp(&middle(b)));
    let rows = other_rows(session, changed, circles).filter(|(tried, _)| is_better(tried));
    match (best, rows) {
        // A circle of one of many rows fits more easily than one of a few mistakes.
        (Some((tried, mistake)), rows)
            if rows.as_ref().is_none_or(|(of_rows, _)| middle(&tried) > middle(of_rows) - 0.05) =>
        {
            Some(Diagnostic::new(mistake.what).help(mistake.help))
        }
        (_, rows) => rows.map(|(_, found)| found),
    }
}

/// That circles belong to other rows' images: for each press the circle that holds most of its change.
fn other_rows(session: &Session, changed: &[ChangeMap], circles: &[Circle]) -> Option<(Vec<f64>, Diagnostic)> {
    /// With more rows that each are tried with each this takes minutes.
    const MOST_ROWS: usize = 300;
    if circles.len() > MOST_ROWS {
        return None;
    }
    let best = |changed: &ChangeMap| {
        let held = circles.iter().map(|circle| changed.held(circle)).enumerate();
        held.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    };
    let found: Vec<(usize, f64)> = changed.par_iter().map(best).collect();
    let others = found.iter().enumerate().filter(|(press, (row, _))| press != row).count();
    let mut rows: Vec<usize> = found.iter().map(|(row, _)| *row).collect();
    rows.sort_unstable();
    rows.dedup();
    // Each row's circle belongs to one image.
    if others * 2 < found.len() || (rows.len() as f64) < MOST_PRESSES * found.len() as f64 {
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
