//! The background image against the presses: away from their discs both show the untouched pad.
//!
//! What the pad looks like there, the presses say together: the median of those whose disc is away, on blocks of pixels. Then
//! the background may have its channels in another order, be mirrored or turned, be darker or brighter, show another pad, or
//! a press of its own.

use image::{RgbImage, imageops};
use rayon::prelude::*;

use super::super::detect::change::{Change, block_px, energy, means};
use super::super::{PrintedDots, Session};
use crate::metrics::statistics::median;
use gelsim_core::base::grid::Grid;
use gelsim_files::diagnostic::Diagnostic;

/// How far from a disc the pad counts as untouched, in radii.
const REACH: f64 = 2.2;
/// Presses whose disc must be away from a place for it to be known.
const WITNESSES: usize = 3;
/// Fraction of the view that must be known.
const KNOWN: f64 = 0.05;
/// Levels of a block that is neither black nor white.
const USABLE: std::ops::Range<f32> = 3.0..250.0;
/// Another order or direction must leave less than this of what the image's own leaves, which must be at least so many levels.
/// Measured: 0.44 and less where it was changed, 0.74 and more on images of other pads.
const REARRANGED: f64 = 0.55;
const LEAST_LEVELS: f64 = 2.0;
/// A factor on the brightness that is no drift; real sessions have up to 0.05. It must explain so much of the difference.
const LEAST_FACTOR: f64 = 0.08;
const FACTOR_LEAVES: f64 = 0.5;
/// What is left of the difference over what the presses change: from here on it may be another pad's, or is. Measured: 0.10 and
/// less, and 0.30 where the camera changes its exposure by itself; 0.35 to 3 with photographs of other pads.
const DOUBTFUL: f64 = 0.25;
const OTHER_PAD: f64 = 0.4;
/// Fraction of what a press changes that all presses have in common where none of them is. Measured: 0.01 and less on
/// untouched pads, 0.05 and more with one of the presses as background.
const IN_COMMON: f64 = 0.03;
/// Fraction of the discs that is white in the background.
const MOST_WHITE: f64 = 0.9;

/// Direction of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// As it is.
    None,
    /// Left and right exchanged.
    LeftRight,
    /// Top and bottom exchanged.
    UpDown,
    /// By 180 degrees.
    Half,
}

/// What would have to be done to the background image so that it agrees with the presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// First it is turned.
    pub turn: Turn,
    /// Then its channels are taken in this order.
    pub order: [usize; 3],
    /// Then they are multiplied by these.
    pub factors: [f64; 3],
}

impl Match {
    const NOTHING: Self = Self { turn: Turn::None, order: [0, 1, 2], factors: [1.0; 3] };

    /// True if there is nothing to do.
    pub fn is_nothing(&self) -> bool {
        *self == Self::NOTHING
    }

    /// The image after that.
    pub fn apply(&self, background: &RgbImage) -> RgbImage {
        let mut image = turned(background, self.turn);
        for pixel in image.pixels_mut() {
            let own = pixel.0;
            pixel.0 = std::array::from_fn(|k| {
                (f64::from(own[self.order[k]]) * self.factors[k]).round().clamp(0.0, 255.0) as u8
            });
        }
        image
    }

    /// What was done, in a sentence.
    pub fn text(&self) -> String {
        let mut done = Vec::new();
        if self.turn != Turn::None {
            done.push(format!("is {}", self.turn.text()));
        }
        if self.order != Self::NOTHING.order {
            done.push(format!("has its channels in the order {}", self.order_text()));
        }
        if self.factors != Self::NOTHING.factors {
            let [red, green, blue] = self.factors;
            done.push(format!("is multiplied by {red:.2} (red), {green:.2} (green) and {blue:.2} (blue)"));
        }
        if done.is_empty() {
            String::from("the background image agrees with the presses: --match-background changes nothing")
        } else {
            format!("the background image {}, as the presses have it", done.join(", "))
        }
    }

    fn order_text(&self) -> String {
        self.order.map(|k| ["red", "green", "blue"][k]).join(", ")
    }
}

impl Turn {
    const ALL: [Self; 4] = [Self::None, Self::LeftRight, Self::UpDown, Self::Half];

    fn text(self) -> &'static str {
        match self {
            Self::None => "as it is",
            Self::LeftRight => "mirrored left to right",
            Self::UpDown => "mirrored top to bottom",
            Self::Half => "turned by 180 degrees",
        }
    }
}

fn turned(image: &RgbImage, turn: Turn) -> RgbImage {
    match turn {
        Turn::None => image.clone(),
        Turn::LeftRight => imageops::flip_horizontal(image),
        Turn::UpDown => imageops::flip_vertical(image),
        Turn::Half => imageops::rotate180(image),
    }
}

/// What background and presses say of each other.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// What would make them agree.
    pub found: Match,
    /// Mean absolute difference on the untouched pad as it is, grey levels.
    pub as_it_is: f64,
    /// The same after [`Self::found`].
    pub left: f64,
    /// The same after the order and direction of [`Self::found`] over that of the image's own, both with a factor.
    pub rearranged: f64,
    /// Factors on the channels, in the order and direction of [`Self::found`].
    pub factors: [f64; 3],
    /// What the presses change in their discs, grey levels.
    pub change: f64,
    /// Fraction of what a press changes that all presses have in common where none of them is, after [`Self::found`].
    pub in_common: f64,
    /// Where they have most of it, px.
    pub common_px: [f64; 2],
}

/// Orders of three channels, their own first.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [2, 1, 0], [1, 0, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]];

/// Compares them; `None` where too little of the pad is away from the discs.
pub fn compare(session: &Session) -> Option<Comparison> {
    let seen = Seen::of(session)?;
    let turns = Turn::ALL.map(|turn| means(&turned(&session.background, turn), seen.block_px));
    let tried = Turn::ALL.into_iter().zip(&turns).flat_map(|(turn, blocks)| ORDERS.map(|order| (turn, order, blocks)));
    let tried: Vec<_> =
        tried.map(|(turn, order, blocks)| (seen.with_one_factor(blocks, order), turn, order, blocks)).collect();
    let (own, ..) = tried[0];
    let (least, turn, order, blocks) = *tried.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let is_other = least < REARRANGED * own && own >= LEAST_LEVELS;
    let (turn, order, blocks) = if is_other { (turn, order, blocks) } else { (Turn::None, ORDERS[0], &turns[0]) };
    let factors = seen.factors(blocks, order);
    let plain = seen.left(blocks, order, [1.0; 3]);
    let scaled = seen.left(blocks, order, factors);
    let is_scaled = factors.iter().any(|factor| (factor - 1.0).abs() > LEAST_FACTOR) && scaled < FACTOR_LEAVES * plain;
    let found = Match { turn, order, factors: if is_scaled { factors } else { [1.0; 3] } };
    let (in_common, common_px) = in_common(session, &found.apply(&session.background));
    Some(Comparison {
        found,
        as_it_is: seen.left(&turns[0], ORDERS[0], [1.0; 3]),
        left: if is_scaled { scaled } else { plain },
        rearranged: if own > 0.0 { least / own } else { 1.0 },
        factors,
        change: seen.change,
        in_common,
        common_px,
    })
}

/// The untouched pad as the presses show it, on blocks.
struct Seen {
    block_px: usize,
    levels: Grid<[f32; 3]>,
    /// Blocks where it is known.
    known: Vec<usize>,
    change: f64,
}

impl Seen {
    fn of(session: &Session) -> Option<Self> {
        let block_px = block_px(&session.background);
        let presses: Vec<Grid<[f32; 3]>> =
            session.observations.par_iter().map(|press| means(&press.image, block_px)).collect();
        let Grid { width, height, .. } = *presses.first()?;
        let mut levels = Grid::new(width, height);
        let mut known = Vec::new();
        for at in 0..width * height {
            let away = presses.iter().zip(&session.observations).filter(|(_, press)| {
                let [x, y] = [at % width, at / width].map(|at| (at as f64 + 0.5) * block_px as f64 - 0.5);
                let [cx, cy] = press.circle.centre_px;
                (x - cx).hypot(y - cy) > REACH * press.circle.radius_px
            });
            let away: Vec<[f32; 3]> = away.map(|(blocks, _)| blocks.data[at]).collect();
            if away.len() < WITNESSES.min(presses.len()) {
                continue;
            }
            let middle = |k: usize| median(&away.iter().map(|level| f64::from(level[k])).collect::<Vec<_>>());
            let level = [0, 1, 2].map(|k| middle(k).unwrap_or(0.0) as f32);
            if level.iter().all(|level| USABLE.contains(level)) {
                levels.data[at] = level;
                known.push(at);
            }
        }
        if (known.len() as f64) < KNOWN * (width * height) as f64 {
            return None;
        }
        let mut seen = Self { block_px, levels, known, change: 0.0 };
        seen.change = seen.change(session, &presses);
        Some(seen)
    }

    /// Mean absolute difference of the presses from the pad as it is seen elsewhere, in their discs.
    fn change(&self, session: &Session, presses: &[Grid<[f32; 3]>]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (blocks, press) in presses.iter().zip(&session.observations) {
            for at in &self.known {
                let [x, y] =
                    [at % blocks.width, at / blocks.width].map(|at| (at as f64 + 0.5) * self.block_px as f64 - 0.5);
                let [cx, cy] = press.circle.centre_px;
                if (x - cx).hypot(y - cy) <= press.circle.radius_px {
                    sum +=
                        (0..3).map(|k| f64::from((blocks.data[*at][k] - self.levels.data[*at][k]).abs())).sum::<f64>();
                    count += 3.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Levels of the pad and of the background at each known block that is neither black nor white in either.
    fn pairs<'a>(
        &'a self,
        background: &'a Grid<[f32; 3]>,
        order: [usize; 3],
    ) -> impl Iterator<Item = ([f64; 3], [f64; 3])> + 'a {
        self.known.iter().filter_map(move |at| {
            let (seen, rest) = (self.levels.data[*at], background.data[*at]);
            let rest = order.map(|k| rest[k]);
            rest.iter().all(|level| USABLE.contains(level)).then(|| (seen.map(f64::from), rest.map(f64::from)))
        })
    }

    /// Factor of each channel, by least squares.
    fn factors(&self, background: &Grid<[f32; 3]>, order: [usize; 3]) -> [f64; 3] {
        let mut sums = [[0.0; 2]; 3];
        for (seen, rest) in self.pairs(background, order) {
            (0..3).for_each(|k| sums[k] = [sums[k][0] + seen[k] * rest[k], sums[k][1] + rest[k] * rest[k]]);
        }
        sums.map(|[product, square]| if square > 0.0 { product / square } else { 1.0 })
    }

    /// Mean absolute difference after these factors.
    fn left(&self, background: &Grid<[f32; 3]>, order: [usize; 3], factors: [f64; 3]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (seen, rest) in self.pairs(background, order) {
            sum += (0..3).map(|k| (seen[k] - factors[k] * rest[k]).abs()).sum::<f64>();
            count += 3.0;
        }
        // A background that is black or white all over agrees with nothing.
        if count > 0.0 { sum / count } else { 255.0 }
    }

    /// The same after one factor for all channels: with one for each, grey pads would agree in any order.
    fn with_one_factor(&self, background: &Grid<[f32; 3]>, order: [usize; 3]) -> f64 {
        let [product, square] = self.pairs(background, order).fold([0.0; 2], |[product, square], (seen, rest)| {
            let sum = |of: &dyn Fn(usize) -> f64| (0..3).map(of).sum::<f64>();
            [product + sum(&|k| seen[k] * rest[k]), square + sum(&|k| rest[k] * rest[k])]
        });
        self.left(background, order, [if square > 0.0 { product / square } else { 1.0 }; 3])
    }
}

/// What of the presses' change is the same in all of them where none of them is, and where that is most, px.
fn in_common(session: &Session, background: &RgbImage) -> (f64, [f64; 2]) {
    /// How far presses may be from what they have in common: of its square.
    const ALIKE: f64 = 0.3;
    let changes: Vec<Change> =
        session.observations.par_iter().map(|press| Change::coarse(&press.image, background)).collect();
    let Some(first) = changes.first() else { return (0.0, [0.0; 2]) };
    let Grid { width, height, .. } = first.levels;
    let usual: Vec<f64> = changes.iter().map(Change::usual).collect();
    let above = |level: [f32; 3], usual: f64| (energy(level) - 4.0 * usual * usual).max(0.0);
    let whole = changes.iter().zip(&usual);
    let whole = whole.map(|(change, usual)| change.levels.data.iter().map(|level| above(*level, *usual)).sum());
    let whole = median(&whole.collect::<Vec<f64>>()).unwrap_or(0.0);
    let usual = median(&usual).unwrap_or(0.0);
    let (mut sum, mut most, mut place) = (0.0, 0.0, [0.0; 2]);
    for at in 0..width * height {
        let [x, y] = [at % width, at / width].map(|at| (at as f64 + 0.5) * first.block_px as f64 - 0.5);
        let away = changes.iter().zip(&session.observations).filter(|(_, press)| {
            let [cx, cy] = press.circle.centre_px;
            (x - cx).hypot(y - cy) > REACH * press.circle.radius_px
        });
        let away: Vec<[f32; 3]> = away.map(|(change, _)| change.levels.data[at]).collect();
        if away.len() < WITNESSES {
            continue;
        }
        let middle = |k: usize| median(&away.iter().map(|level| f64::from(level[k])).collect::<Vec<_>>());
        let shared = [0, 1, 2].map(|k| middle(k).unwrap_or(0.0) as f32);
        let off = |level: &[f32; 3]| energy(std::array::from_fn(|k| level[k] - shared[k]));
        let apart = median(&away.iter().map(off).collect::<Vec<_>>()).unwrap_or(0.0);
        let common = above(shared, usual);
        if apart > ALIKE * common {
            continue;
        }
        sum += common;
        if common > most {
            (most, place) = (common, [x, y]);
        }
    }
    (if whole > 0.0 { sum / whole } else { 0.0 }, place)
}

/// One thing that speaks against a background image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What it is.
    pub diagnostic: Diagnostic,
    /// True if it is seen only where the circles are on the discs.
    pub depends_on_circles: bool,
}

/// All that is seen of a background image.
#[derive(Clone, Debug)]
pub struct Look {
    /// The comparison; none where too little is away from the discs.
    pub compared: Option<Comparison>,
    /// What speaks against it.
    pub findings: Vec<Finding>,
}

/// Looks at the background image.
pub fn look(session: &Session) -> Look {
    if let Some(white) = white(session) {
        return Look { compared: None, findings: vec![Finding { diagnostic: white, depends_on_circles: false }] };
    }
    let compared = compare(session);
    Look { findings: compared.as_ref().map_or_else(Vec::new, judged), compared }
}

/// What speaks against the background image.
pub fn findings(session: &Session) -> Vec<Diagnostic> {
    look(session).findings.into_iter().map(|found| found.diagnostic).collect()
}

/// Why nothing can be learnt where it is white.
fn white(session: &Session) -> Option<Diagnostic> {
    let (mut white, mut all) = (0.0, 0.0);
    for press in &session.observations {
        let [cx, cy] = press.circle.centre_px;
        for (x, y, pixel) in session.background.enumerate_pixels() {
            if (f64::from(x) - cx).hypot(f64::from(y) - cy) <= press.circle.radius_px {
                all += 1.0;
                white += f64::from(u8::from(pixel.0.iter().any(|level| *level >= 254)));
            }
        }
    }
    (all > 0.0 && white > MOST_WHITE * all).then(|| {
        let message = format!(
            "the background image is white in {:.0} % of the discs, where nothing can be learnt",
            100.0 * white / all
        );
        Diagnostic::new(message)
            .help("take background and presses at a shorter exposure; name another image with --background")
    })
}

/// What speaks against it in a comparison.
pub fn judged(found: &Comparison) -> Vec<Finding> {
    const FLAG: &str = "add --match-background, which changes it so; or convert the images that are wrong";
    let Match { turn, order, factors } = found.found;
    let mut all = Vec::new();
    let mut add =
        |diagnostic: Diagnostic, depends_on_circles: bool| all.push(Finding { diagnostic, depends_on_circles });
    if order != Match::NOTHING.order {
        let message = match order {
            [2, 1, 0] => {
                String::from("red and blue of the background image are exchanged against the presses (RGB and BGR)")
            }
            _ => format!(
                "the channels of the background image are exchanged against the presses: in their order it has {}",
                found.found.order_text()
            ),
        };
        add(Diagnostic::new(message).help(FLAG), false);
    }
    if turn != Turn::None {
        let message = format!("the background image agrees with the presses only if it is {}", turn.text());
        add(Diagnostic::new(message).help(FLAG), false);
    }
    if factors != Match::NOTHING.factors {
        let [red, green, blue] = factors;
        let mean = factors.iter().sum::<f64>() / 3.0;
        let is_even = factors.iter().all(|factor| (factor / mean - 1.0).abs() < 0.05);
        let what = match mean > 1.0 {
            _ if !is_even => "has another brightness or white balance than",
            true => "is darker than",
            false => "is brighter than",
        };
        let message = format!(
            "the background image {what} the presses, whose pad is {red:.2} (red), {green:.2} (green), {blue:.2} (blue) times as \
             bright away from the discs"
        );
        let help = "take it with the exposure and the white balance of the presses; or add --match-background, which multiplies \
                    it by these";
        add(Diagnostic::new(message).help(help), false);
    }
    let share = if found.change > 0.0 { found.left / found.change } else { f64::INFINITY };
    if share > DOUBTFUL && found.left > LEAST_LEVELS {
        let so = if found.found.is_nothing() { "" } else { ", also after that" };
        let message = format!(
            "the background image does not look like the presses away from their discs{so}: they differ by {:.1} grey levels, \
             and in the discs by {:.1}",
            found.left, found.change
        );
        let help =
            "name the image of the same untouched pad, of the same camera and the same session, with --background";
        let is_other = share > OTHER_PAD;
        add(if is_other { Diagnostic::new(message) } else { Diagnostic::warning(message) }.help(help), true);
        if is_other {
            return all;
        }
    }
    if found.in_common > IN_COMMON {
        let [x, y] = found.common_px;
        let message = format!(
            "the pad is not untouched in the background image: near column {x:.0}, row {y:.0} it differs from all presses that are \
             elsewhere"
        );
        add(Diagnostic::new(message).help("name an image of the untouched pad with --background"), true);
    }
    all
}

/// The session with the background image as the presses have it, and what was done.
pub fn matched(session: Session) -> (Session, String) {
    match compare(&session).map(|found| found.found) {
        None => {
            let why = "too little of the pad is away from the discs: --match-background changes nothing";
            (session, String::from(why))
        }
        Some(found) => {
            let background = found.apply(&session.background);
            let printed =
                session.printed.map(|printed| PrintedDots { background: found.apply(&printed.background), ..printed });
            (Session { background, printed, ..session }, found.text())
        }
    }
}
