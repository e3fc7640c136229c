//! Checks the background image against the presses: away from their discs both show the untouched pad.
//!
//! The presses together tell what the untouched pad looks like: the median of those whose disc is elsewhere, on blocks
//! of pixels. Compared with it, the background image may have its channels in another order, be mirrored or rotated, be
//! darker or brighter, show another pad, or show a press of its own.

use image::{RgbImage, imageops};
use rayon::prelude::*;

use super::super::detect::change::{BlockChange, block_means, change_energy, coarse_block_px};
use super::super::{PrintedDots, Session};
use crate::metrics::statistics::median;
use gelsim_core::base::grid::Grid;
use gelsim_files::diagnostic::Diagnostic;

/// Distance from a disc's centre from which on the pad counts as untouched, in radii.
const REACH: f64 = 2.2;
/// Fewest presses whose disc must be elsewhere for a place to be known.
const MIN_PRESSES: usize = 3;
/// Smallest fraction of the view that must be known.
const MIN_KNOWN_SHARE: f64 = 0.05;
/// Levels of a block that is neither black nor white.
const USABLE_LEVELS: std::ops::Range<f32> = 3.0..250.0;
/// Another order or direction must leave less than this fraction of the difference of the image's own, which must be at
/// least [`MIN_LEVELS`]. Measured: 0.44 and less where it was changed, 0.74 and more on images of other pads.
const REARRANGED: f64 = 0.55;
const MIN_LEVELS: f64 = 2.0;
/// Smallest change of brightness that is not drift (real sessions have up to 0.05); correcting it must leave less than
/// the second fraction of the difference.
const MIN_FACTOR: f64 = 0.08;
const FACTOR_LEAVES: f64 = 0.5;
/// Remaining difference over what the presses change from which on the background may be another pad's, and is.
/// Measured: 0.10 and less, and 0.30 where the camera changes its exposure by itself; 0.35 to 3 with photographs of
/// other pads.
const DOUBTFUL: f64 = 0.25;
const OTHER_PAD: f64 = 0.4;
/// Largest fraction of a press's change that all presses share where none of them is. Measured: 0.01 and less on
/// untouched pads, 0.05 and more with one of the presses as background.
const IN_COMMON: f64 = 0.03;
/// Largest fraction of the discs that may be white in the background.
const MAX_WHITE: f64 = 0.9;

/// Orientation of an image relative to the presses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Unchanged.
    None,
    /// Mirrored: left and right exchanged.
    LeftRight,
    /// Mirrored: top and bottom exchanged.
    UpDown,
    /// Rotated by 180 degrees.
    Half,
}

/// Changes that make the background image agree with the presses, in the order of the fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundCorrection {
    /// Rotation or mirroring.
    pub turn: Turn,
    /// Order in which its channels are taken.
    pub order: [usize; 3],
    /// Factors on the channels.
    pub factors: [f64; 3],
}

impl BackgroundCorrection {
    const NOTHING: Self = Self { turn: Turn::None, order: [0, 1, 2], factors: [1.0; 3] };

    /// Returns true if nothing has to change.
    pub fn is_nothing(&self) -> bool {
        *self == Self::NOTHING
    }

    /// Applies the changes to an image.
    pub fn apply(&self, background: &RgbImage) -> RgbImage {
        let mut image = turn_image(background, self.turn);
        for pixel in image.pixels_mut() {
            let own = pixel.0;
            pixel.0 = std::array::from_fn(|k| {
                (f64::from(own[self.order[k]]) * self.factors[k]).round().clamp(0.0, 255.0) as u8
            });
        }
        image
    }

    /// Describes the changes in a sentence.
    pub fn to_sentence(&self) -> String {
        let mut done = Vec::new();
        if self.turn != Turn::None {
            done.push(format!("is {}", self.turn.describe_turn()));
        }
        if self.order != Self::NOTHING.order {
            done.push(format!("has its channels in the order {}", self.describe_order()));
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

    fn describe_order(&self) -> String {
        self.order.map(|k| ["red", "green", "blue"][k]).join(", ")
    }
}

impl Turn {
    const ALL: [Self; 4] = [Self::None, Self::LeftRight, Self::UpDown, Self::Half];

    fn describe_turn(self) -> &'static str {
        match self {
            Self::None => "as it is",
            Self::LeftRight => "mirrored left to right",
            Self::UpDown => "mirrored top to bottom",
            Self::Half => "turned by 180 degrees",
        }
    }
}

fn turn_image(image: &RgbImage, turn: Turn) -> RgbImage {
    match turn {
        Turn::None => image.clone(),
        Turn::LeftRight => imageops::flip_horizontal(image),
        Turn::UpDown => imageops::flip_vertical(image),
        Turn::Half => imageops::rotate180(image),
    }
}

/// Comparison of the background with the presses.
#[derive(Clone, Debug)]
pub struct BackgroundComparison {
    /// Changes that would make them agree.
    pub found: BackgroundCorrection,
    /// Mean absolute difference on the untouched pad without changes, grey levels.
    pub as_it_is: f64,
    /// Mean absolute difference after the changes of [`Self::found`], grey levels.
    pub left: f64,
    /// Ratio of the differences with the best order and direction and with the image's own, both after a common factor.
    pub rearranged: f64,
    /// Factors on the channels, in the order and direction of [`Self::found`].
    pub factors: [f64; 3],
    /// Mean absolute change by the presses in their discs, grey levels.
    pub change: f64,
    /// Fraction of a press's change that all presses share where none of them is, after the changes of [`Self::found`].
    pub in_common: f64,
    /// Place where they share most, px.
    pub common_px: [f64; 2],
}

/// Orders of three channels, the image's own first.
const CHANNEL_ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [2, 1, 0], [1, 0, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]];

/// Compares background and presses; `None` if too little of the pad is away from the discs.
pub fn compare_background(session: &Session) -> Option<BackgroundComparison> {
    let seen = UntouchedPad::from_session(session)?;
    let turns = Turn::ALL.map(|turn| block_means(&turn_image(&session.background, turn), seen.block_px));
    let tried =
        Turn::ALL.into_iter().zip(&turns).flat_map(|(turn, blocks)| CHANNEL_ORDERS.map(|order| (turn, order, blocks)));
    let tried: Vec<_> = tried
        .map(|(turn, order, blocks)| (seen.difference_with_one_factor(blocks, order), turn, order, blocks))
        .collect();
    let (own, ..) = tried[0];
    let (least, turn, order, blocks) = *tried.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let is_other = least < REARRANGED * own && own >= MIN_LEVELS;
    let (turn, order, blocks) =
        if is_other { (turn, order, blocks) } else { (Turn::None, CHANNEL_ORDERS[0], &turns[0]) };
    let factors = seen.fit_factors(blocks, order);
    let plain = seen.remaining_difference(blocks, order, [1.0; 3]);
    let scaled = seen.remaining_difference(blocks, order, factors);
    let is_scaled = factors.iter().any(|factor| (factor - 1.0).abs() > MIN_FACTOR) && scaled < FACTOR_LEAVES * plain;
    let found = BackgroundCorrection { turn, order, factors: if is_scaled { factors } else { [1.0; 3] } };
    let (in_common, common_px) = measure_common_change(session, &found.apply(&session.background));
    Some(BackgroundComparison {
        found,
        as_it_is: seen.remaining_difference(&turns[0], CHANNEL_ORDERS[0], [1.0; 3]),
        left: if is_scaled { scaled } else { plain },
        rearranged: if own > 0.0 { least / own } else { 1.0 },
        factors,
        change: seen.change,
        in_common,
        common_px,
    })
}

/// Untouched pad as the presses show it, on blocks.
struct UntouchedPad {
    block_px: usize,
    levels: Grid<[f32; 3]>,
    /// Blocks that are known.
    known: Vec<usize>,
    change: f64,
}

impl UntouchedPad {
    fn from_session(session: &Session) -> Option<Self> {
        let block_px = coarse_block_px(&session.background);
        let presses: Vec<Grid<[f32; 3]>> =
            session.observations.par_iter().map(|press| block_means(&press.image, block_px)).collect();
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
            if away.len() < MIN_PRESSES.min(presses.len()) {
                continue;
            }
            let middle = |k: usize| median(&away.iter().map(|level| f64::from(level[k])).collect::<Vec<_>>());
            let level = [0, 1, 2].map(|k| middle(k).unwrap_or(0.0) as f32);
            if level.iter().all(|level| USABLE_LEVELS.contains(level)) {
                levels.data[at] = level;
                known.push(at);
            }
        }
        if (known.len() as f64) < MIN_KNOWN_SHARE * (width * height) as f64 {
            return None;
        }
        let mut seen = Self { block_px, levels, known, change: 0.0 };
        seen.change = seen.mean_press_change(session, &presses);
        Some(seen)
    }

    /// Mean absolute difference of the presses from the untouched pad in their discs, grey levels.
    fn mean_press_change(&self, session: &Session, presses: &[Grid<[f32; 3]>]) -> f64 {
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

    /// Returns the levels of pad and background in each known block that is neither black nor white in either.
    fn level_pairs<'a>(
        &'a self,
        background: &'a Grid<[f32; 3]>,
        order: [usize; 3],
    ) -> impl Iterator<Item = ([f64; 3], [f64; 3])> + 'a {
        self.known.iter().filter_map(move |at| {
            let (seen, rest) = (self.levels.data[*at], background.data[*at]);
            let rest = order.map(|k| rest[k]);
            rest.iter().all(|level| USABLE_LEVELS.contains(level)).then(|| (seen.map(f64::from), rest.map(f64::from)))
        })
    }

    /// Fits the factor of each channel, by least squares.
    fn fit_factors(&self, background: &Grid<[f32; 3]>, order: [usize; 3]) -> [f64; 3] {
        let mut sums = [[0.0; 2]; 3];
        for (seen, rest) in self.level_pairs(background, order) {
            (0..3).for_each(|k| sums[k] = [sums[k][0] + seen[k] * rest[k], sums[k][1] + rest[k] * rest[k]]);
        }
        sums.map(|[product, square]| if square > 0.0 { product / square } else { 1.0 })
    }

    /// Mean absolute difference after these factors, grey levels.
    fn remaining_difference(&self, background: &Grid<[f32; 3]>, order: [usize; 3], factors: [f64; 3]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (seen, rest) in self.level_pairs(background, order) {
            sum += (0..3).map(|k| (seen[k] - factors[k] * rest[k]).abs()).sum::<f64>();
            count += 3.0;
        }
        // A background that is black or white all over agrees with nothing.
        if count > 0.0 { sum / count } else { 255.0 }
    }

    /// Mean absolute difference after one factor for all channels: with one for each, grey pads would agree in any
    /// order.
    fn difference_with_one_factor(&self, background: &Grid<[f32; 3]>, order: [usize; 3]) -> f64 {
        let [product, square] =
            self.level_pairs(background, order).fold([0.0; 2], |[product, square], (seen, rest)| {
                let sum = |of: &dyn Fn(usize) -> f64| (0..3).map(of).sum::<f64>();
                [product + sum(&|k| seen[k] * rest[k]), square + sum(&|k| rest[k] * rest[k])]
            });
        self.remaining_difference(background, order, [if square > 0.0 { product / square } else { 1.0 }; 3])
    }
}

/// Measures the fraction of the presses' change that is common to all presses where none of them is. Also returns the
/// place where it is largest, px.
fn measure_common_change(session: &Session, background: &RgbImage) -> (f64, [f64; 2]) {
    /// Largest deviation of presses from what they share, relative to its square.
    const ALIKE: f64 = 0.3;
    let changes: Vec<BlockChange> =
        session.observations.par_iter().map(|press| BlockChange::on_coarse_blocks(&press.image, background)).collect();
    let Some(first) = changes.first() else { return (0.0, [0.0; 2]) };
    let Grid { width, height, .. } = first.levels;
    let usual: Vec<f64> = changes.iter().map(BlockChange::typical_size).collect();
    let above = |level: [f32; 3], usual: f64| (change_energy(level) - 4.0 * usual * usual).max(0.0);
    let total = changes.iter().zip(&usual);
    let total = total.map(|(change, usual)| change.levels.data.iter().map(|level| above(*level, *usual)).sum());
    let total = median(&total.collect::<Vec<f64>>()).unwrap_or(0.0);
    let usual = median(&usual).unwrap_or(0.0);
    let (mut sum, mut most, mut place) = (0.0, 0.0, [0.0; 2]);
    for at in 0..width * height {
        let [x, y] = [at % width, at / width].map(|at| (at as f64 + 0.5) * first.block_px as f64 - 0.5);
        let away = changes.iter().zip(&session.observations).filter(|(_, press)| {
            let [cx, cy] = press.circle.centre_px;
            (x - cx).hypot(y - cy) > REACH * press.circle.radius_px
        });
        let away: Vec<[f32; 3]> = away.map(|(change, _)| change.levels.data[at]).collect();
        if away.len() < MIN_PRESSES {
            continue;
        }
        let middle = |k: usize| median(&away.iter().map(|level| f64::from(level[k])).collect::<Vec<_>>());
        let shared = [0, 1, 2].map(|k| middle(k).unwrap_or(0.0) as f32);
        let off = |level: &[f32; 3]| change_energy(std::array::from_fn(|k| level[k] - shared[k]));
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
    (if total > 0.0 { sum / total } else { 0.0 }, place)
}

/// A finding about a background image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackgroundFinding {
    /// Diagnostic for the user.
    pub diagnostic: Diagnostic,
    /// Whether it is only seen if the circles are on the discs.
    pub depends_on_circles: bool,
}

/// Assessment of a background image.
#[derive(Clone, Debug)]
pub struct BackgroundAssessment {
    /// Comparison; none if too little is away from the discs.
    pub compared: Option<BackgroundComparison>,
    /// Findings against it.
    pub findings: Vec<BackgroundFinding>,
}

/// Assesses the background image.
pub fn assess_background(session: &Session) -> BackgroundAssessment {
    if let Some(white) = check_white_background(session) {
        return BackgroundAssessment {
            compared: None,
            findings: vec![BackgroundFinding { diagnostic: white, depends_on_circles: false }],
        };
    }
    let compared = compare_background(session);
    BackgroundAssessment { findings: compared.as_ref().map_or_else(Vec::new, judge_comparison), compared }
}

/// Returns the findings against the background image.
pub fn judge_background(session: &Session) -> Vec<Diagnostic> {
    assess_background(session).findings.into_iter().map(|found| found.diagnostic).collect()
}

/// Reports a background that is white in the discs, where nothing can be learnt.
fn check_white_background(session: &Session) -> Option<Diagnostic> {
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
    (all > 0.0 && white > MAX_WHITE * all).then(|| {
        let message = format!(
            "the background image is white in {:.0} % of the discs, where nothing can be learnt",
            100.0 * white / all
        );
        Diagnostic::new(message)
            .help("take background and presses at a shorter exposure; name another image with --background")
    })
}

/// Returns the findings of a comparison.
pub fn judge_comparison(found: &BackgroundComparison) -> Vec<BackgroundFinding> {
    const FLAG: &str = "add --match-background, which changes it so; or convert the images that are wrong";
    let BackgroundCorrection { turn, order, factors } = found.found;
    let mut all = Vec::new();
    let mut add = |diagnostic: Diagnostic, depends_on_circles: bool| {
        all.push(BackgroundFinding { diagnostic, depends_on_circles })
    };
    if order != BackgroundCorrection::NOTHING.order {
        let message = match order {
            [2, 1, 0] => {
                String::from("red and blue of the background image are exchanged against the presses (RGB and BGR)")
            }
            _ => format!(
                "the channels of the background image are exchanged against the presses: in their order it has {}",
                found.found.describe_order()
            ),
        };
        add(Diagnostic::new(message).help(FLAG), false);
    }
    if turn != Turn::None {
        let message = format!("the background image agrees with the presses only if it is {}", turn.describe_turn());
        add(Diagnostic::new(message).help(FLAG), false);
    }
    if factors != BackgroundCorrection::NOTHING.factors {
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
    if share > DOUBTFUL && found.left > MIN_LEVELS {
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

/// Changes the background image of a session to agree with the presses. Also returns what was done.
pub fn match_background(session: Session) -> (Session, String) {
    match compare_background(&session).map(|found| found.found) {
        None => {
            let why = "too little of the pad is away from the discs: --match-background changes nothing";
            (session, String::from(why))
        }
        Some(found) => {
            let background = found.apply(&session.background);
            let printed =
                session.printed.map(|printed| PrintedDots { background: found.apply(&printed.background), ..printed });
            (Session { background, printed, ..session }, found.to_sentence())
        }
    }
}
