//! Dots printed on the pad. They move with its surface, so in a press no dot is where the background image has it. What
//! changes there says nothing about the light, and is neither learnt nor counted.
//!
//! Dots are spots that are darker (or brighter) than a closing of their neighbourhood (Serra 1982), round, of one size,
//! and on a grid. In each image the pixels that they cover are filled from their surroundings, and marked.

use std::collections::VecDeque;

use image::{Rgb, RgbImage};
use rayon::prelude::*;

use crate::metrics::statistics::{median, quantile};
use gelsim_core::base::grid::Grid;
use gelsim_files::sensor::markers::MarkerDistribution;
use gelsim_files::sensor::quantity::Quantity;

/// Widths of the neighbourhoods in which spots are searched, px.
const WINDOWS: [usize; 6] = [5, 9, 15, 25, 41, 61];
/// Fewest spots of a grid.
const MIN_SPOTS: usize = 9;
/// Fraction of the spots that must have neighbours on two sides at the grid's distance. Measured: 0.97 and more on
/// printed grids, 0.33 and less on 19 pads without.
const MIN_REGULAR: f64 = 0.7;
/// Largest variation of the distances to the nearest neighbours, relative to their median. Measured: 0.03 and less on
/// grids; 0.14 and more on other pads, whose spots are dust and specks.
const MAX_UNEVEN: f64 = 0.1;
/// Largest ratio of a spot's area to the usual one, and its inverse.
const MAX_AREA_RATIO: f64 = 2.5;
/// Distances to neighbours on a grid, over the nearest one: along x and along y they may differ.
const NEIGHBOUR_DISTANCES: std::ops::Range<f64> = 0.75..1.6;
/// Largest slope of the rows of an upright grid.
const MAX_LEANING: f64 = 0.09;

/// Dots that were found on an untouched pad.
#[derive(Clone, Debug, PartialEq)]
pub struct Dots {
    /// Number of dots that are completely in view.
    pub count: usize,
    /// Distance between neighbours along x and y, px; `None` if the grid is not upright.
    pub pitch_px: Option<[f64; 2]>,
    /// Distance to the nearest neighbour, px.
    pub nearest_px: f64,
    /// Diameter, px.
    pub diameter_px: f64,
    /// Width of the soft edge, px.
    pub edge_px: f64,
    /// Largest offset of a dot from the grid, px.
    pub jitter_px: f64,
    /// Fraction of red, green and blue that is left in the middle of a dot; above 1 if it is brighter than the pad.
    pub color: [f64; 3],
    /// Distance by which presses moved the dots, px: that of 19 in 20 is not larger.
    pub motion_px: f64,
    is_dark: bool,
    window: usize,
    centres: Vec<[f64; 2]>,
    area: f64,
}

/// A group of pixels that may be a dot.
#[derive(Clone, Debug)]
struct Spot {
    centre: [f64; 2],
    places: Vec<usize>,
    is_cut: bool,
}

/// An image whose dots were filled.
#[derive(Clone, Debug)]
pub struct InpaintedImage {
    /// The image, filled where dots were.
    pub image: RgbImage,
    /// True for pixels that were filled.
    pub ink: Vec<bool>,
}

impl Dots {
    /// Finds the dots of an untouched pad, and fills them in its picture; `None` without dots.
    pub fn find(background: &RgbImage) -> Option<(Self, InpaintedImage)> {
        let level = mean_of_channels(background);
        // Between dark dots the pad looks like a grid of bright spots, and vice versa: the dots are the smaller ones.
        let found = [true, false].into_iter().filter_map(|is_dark| SpotGrid::find_densest(&level, is_dark));
        let SpotGrid { is_dark, window, spots, nearest_px, .. } =
            found.min_by(|a, b| a.covered.total_cmp(&b.covered))?;
        let uncut: Vec<&Spot> = spots.iter().filter(|spot| !spot.is_cut).collect();
        let area = median(&uncut.iter().map(|spot| spot.places.len() as f64).collect::<Vec<_>>())?;
        let centres: Vec<[f64; 2]> = uncut.iter().map(|spot| spot.centre).collect();
        let mut dots = Self {
            count: centres.len(),
            pitch_px: None,
            nearest_px,
            diameter_px: 2.0 * (area / std::f64::consts::PI).sqrt(),
            edge_px: 0.0,
            jitter_px: 0.0,
            color: [1.0; 3],
            motion_px: 0.0,
            is_dark,
            window,
            centres,
            area,
        };
        let ink = dots.covered_pixels(&spots, &level);
        let cleared = InpaintedImage { image: fill_ink(background, &ink), ink };
        dots.measure_ink(background, &cleared.image);
        dots.measure_grid();
        Some((dots, cleared))
    }

    /// Fills the dots of a press's image. Also returns how far the dots were moved, px.
    pub fn inpaint_dots(&self, image: &RgbImage) -> (InpaintedImage, Vec<f64>) {
        let level = mean_of_channels(image);
        let spots: Vec<Spot> = find_spots(&level, self.window, self.is_dark)
            .into_iter()
            .filter(|spot| spot.is_cut || self.is_alike(spot))
            .collect();
        let mut ink = self.covered_pixels(&spots, &level);
        // A dot may not be seen again, for example in deep shadow: cover all places to which it may have moved.
        let reach = 0.6 * self.nearest_px;
        let distance = |centre: &[f64; 2]| {
            let away = |spot: &Spot| (spot.centre[0] - centre[0]).hypot(spot.centre[1] - centre[1]);
            spots.iter().filter(|spot| !spot.is_cut).map(away).fold(f64::INFINITY, f64::min)
        };
        let away: Vec<f64> = self.centres.iter().map(distance).collect();
        let motion: Vec<f64> = away.iter().copied().filter(|away| *away < reach).collect();
        let moved = quantile(&motion, 0.95).unwrap_or(0.0);
        for (centre, _) in self.centres.iter().zip(&away).filter(|(_, away)| **away >= reach) {
            cover_disc(
                &mut ink,
                [level.width, level.height],
                *centre,
                0.5 * self.diameter_px + self.cover_margin() + moved,
            );
        }
        (InpaintedImage { image: fill_ink(image, &ink), ink }, motion)
    }

    /// Stores how far dots were moved over all presses, px.
    pub fn with_motion(self, mut all: Vec<f64>) -> Self {
        all.retain(|px| px.is_finite());
        Self { motion_px: quantile(&all, 0.95).unwrap_or(0.0), ..self }
    }

    /// Describes the dots for a sensor file, for this pixel size. `None` for bright dots, which ink cannot make, and
    /// for grids that are not upright and square.
    pub fn to_markers(&self, mm_per_px: f64) -> Option<MarkerDistribution> {
        /// Largest relative difference of the distances along x and along y.
        const SQUARE: f64 = 0.05;
        let [across, down] = self.pitch_px.filter(|_| self.is_dark)?;
        if (across / down - 1.0).abs() > SQUARE {
            return None;
        }
        let constant = |px: f64| Quantity::Constant(round_measured(px * mm_per_px));
        let markers = MarkerDistribution {
            pitch_mm: Some(constant(0.5 * (across + down))),
            diameter_mm: constant(self.diameter_px),
            jitter_mm: constant(self.jitter_px),
            color: self.color.map(|share| round_measured(share.clamp(0.0, 1.0))),
            edge_mm: round_measured(self.edge_px * mm_per_px),
            ..MarkerDistribution::default()
        };
        Some(markers)
    }

    /// Returns true for a spot of about the dots' area.
    fn is_alike(&self, spot: &Spot) -> bool {
        let size = spot.places.len() as f64 / self.area;
        (1.0 / MAX_AREA_RATIO..MAX_AREA_RATIO).contains(&size)
    }

    /// Width of the margin around a spot that is covered with it, px: its soft edge.
    fn cover_margin(&self) -> f64 {
        2.0 + 0.15 * self.diameter_px
    }

    /// Returns the pixels of these spots, with their edges.
    fn covered_pixels(&self, spots: &[Spot], level: &Grid<f32>) -> Vec<bool> {
        let size = [level.width, level.height];
        let mut ink = vec![false; level.data.len()];
        for place in spots.iter().flat_map(|spot| &spot.places) {
            let centre = [(place % level.width) as f64, (place / level.width) as f64];
            cover_disc(&mut ink, size, centre, self.cover_margin());
        }
        ink
    }

    /// Measures diameter, edge and colour from the fraction that the ink takes of the filled picture, as a function of
    /// the distance from the dots' centres.
    fn measure_ink(&mut self, image: &RgbImage, filled: &RgbImage) {
        /// Number of rings per pixel of distance.
        const PARTS: f64 = 2.0;
        let reach = 0.5 * self.diameter_px + self.cover_margin();
        let mut rings = vec![[0.0; 4]; (PARTS * reach) as usize + 1];
        let (width, height) = (image.width() as i64, image.height() as i64);
        for [x, y] in &self.centres {
            let [left, top] = [x - reach, y - reach].map(|at| at.floor() as i64);
            let span = 2 * reach.ceil() as i64 + 1;
            for (row, column) in (top..top + span).flat_map(|row| (left..left + span).map(move |column| (row, column)))
            {
                let distance = (column as f64 - x).hypot(row as f64 - y);
                let inside = (0..width).contains(&column) && (0..height).contains(&row);
                let Some(ring) = rings.get_mut((PARTS * distance) as usize).filter(|_| inside) else { continue };
                let at = |image: &RgbImage| image.get_pixel(column as u32, row as u32).0.map(f64::from);
                let (own, rest) = (at(image), at(filled));
                ring[3] += 1.0;
                (0..3).for_each(|k| ring[k] += own[k] / rest[k].max(1.0));
            }
        }
        let left = |ring: &[f64; 4]| [0, 1, 2].map(|k| if ring[3] > 0.0 { ring[k] / ring[3] } else { 1.0 });
        // The middle of a small dot is only a few pixels: count the innermost rings together.
        let middle = (PARTS * 0.25 * self.diameter_px).ceil().max(1.0) as usize;
        let sum = rings.iter().take(middle).fold([0.0; 4], |sum, ring| std::array::from_fn(|k| sum[k] + ring[k]));
        self.color = left(&sum);
        let taken = |color: [f64; 3]| 3.0 - color.iter().sum::<f64>();
        let all = taken(self.color);
        if all.abs() < 0.05 {
            return;
        }
        let cover: Vec<f64> = rings.iter().map(|ring| taken(left(ring)) / all).collect();
        let radius = |k: usize| (k as f64 + 0.5) / PARTS;
        let area: f64 = cover.iter().enumerate().map(|(k, cover)| 2.0 * radius(k) / PARTS * cover).sum();
        // The distance between a quarter and three quarters of the fall is half of the ramp; a pixel's own width is
        // subtracted.
        let falls = |to: f64| cover.iter().position(|cover| *cover < to).map_or(reach, radius);
        self.edge_px = (2.0 * (falls(0.25) - falls(0.75)) - 1.0).max(0.0);
        self.diameter_px = 2.0 * area.max(0.0).sqrt();
    }

    /// Measures distances and jitter of the grid from each dot's neighbours.
    fn measure_grid(&mut self) {
        let (mut across, mut down, mut lean) = (Vec::new(), Vec::new(), Vec::new());
        for from in &self.centres {
            for to in &self.centres {
                let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
                if !NEIGHBOUR_DISTANCES.contains(&(dx.hypot(dy) / self.nearest_px)) {
                    continue;
                }
                if dx > 0.0 && dy.abs() < 0.35 * dx {
                    across.push(dx);
                    lean.push(dy / dx);
                } else if dy > 0.0 && dx.abs() < 0.35 * dy {
                    down.push(dy);
                }
            }
        }
        let (Some(x), Some(y), Some(lean)) = (median(&across), median(&down), median(&lean)) else { return };
        if lean.abs() > MAX_LEANING || across.len().min(down.len()) * 2 < self.count {
            return;
        }
        self.pitch_px = Some([x, y]);
        let mut off: Vec<f64> = across.iter().map(|px| (px - x).abs()).collect();
        off.extend(down.iter().map(|px| (px - y).abs()));
        // The difference of two offsets, both uniform up to the largest one, has its median at 0.586 of that.
        self.jitter_px = median(&off).unwrap_or(0.0) / 0.586;
    }
}

/// A grid of spots found with one neighbourhood.
struct SpotGrid {
    is_dark: bool,
    window: usize,
    spots: Vec<Spot>,
    nearest_px: f64,
    /// Area of a spot over that of the square between neighbours.
    covered: f64,
}

impl SpotGrid {
    /// Finds the grid that has the most spots over all sizes of neighbourhoods; `None` if there is none.
    fn find_densest(level: &Grid<f32>, is_dark: bool) -> Option<Self> {
        let most = level.width.min(level.height) / 5;
        let windows: Vec<usize> = WINDOWS.into_iter().filter(|window| *window <= most).collect();
        let all: Vec<Option<Self>> = windows
            .par_iter()
            .map(|window| Self::from_spots(find_spots(level, *window, is_dark), *window, is_dark))
            .collect();
        // In a small neighbourhood the parts of a large dot may form a grid of their own: the largest one has the true
        // distance.
        let all: Vec<Self> = all.into_iter().flatten().collect();
        let nearest_px = all.last()?.nearest_px;
        let same = |grid: &Self| (grid.nearest_px / nearest_px - 1.0).abs() < 0.1;
        let count = |grid: &Self| grid.spots.len();
        let most = all.iter().filter(|grid| same(grid)).map(count).max()?;
        all.into_iter().find(|grid| same(grid) && 10 * count(grid) >= 9 * most)
    }

    /// Checks that spots form a grid; `None` if they do not.
    fn from_spots(spots: Vec<Spot>, window: usize, is_dark: bool) -> Option<Self> {
        let area = |spot: &Spot| spot.places.len() as f64;
        let usual = median(&spots.iter().filter(|spot| !spot.is_cut).map(area).collect::<Vec<_>>())?;
        let alike = |spot: &Spot| spot.is_cut || (1.0 / MAX_AREA_RATIO..MAX_AREA_RATIO).contains(&(area(spot) / usual));
        let spots: Vec<Spot> = spots.into_iter().filter(alike).collect();
        let uncut: Vec<&Spot> = spots.iter().filter(|spot| !spot.is_cut).collect();
        if uncut.len() < MIN_SPOTS || uncut.len() > MAX_SPOTS {
            return None;
        }
        let away = |a: &Spot, b: &Spot| (a.centre[0] - b.centre[0]).hypot(a.centre[1] - b.centre[1]);
        let nearest = |k: usize| {
            let others = uncut.iter().enumerate().filter(|(other, _)| *other != k);
            others.map(|(_, other)| away(uncut[k], other)).fold(f64::INFINITY, f64::min)
        };
        let distances: Vec<f64> = (0..uncut.len()).map(nearest).collect();
        let nearest_px = median(&distances)?;
        let off: Vec<f64> = distances.iter().map(|px| (px - nearest_px).abs()).collect();
        let regular = uncut.iter().filter(|spot| has_two_sides(spot, &uncut, nearest_px)).count();
        let is_grid = regular as f64 >= MIN_REGULAR * uncut.len() as f64 && median(&off)? <= MAX_UNEVEN * nearest_px;
        let covered = usual / (nearest_px * nearest_px);
        is_grid.then_some(Self { is_dark, window, spots, nearest_px, covered })
    }
}

/// Most spots: more are noise, and the search for neighbours would take minutes.
const MAX_SPOTS: usize = 4000;

/// Returns true for a spot with neighbours at the grid's distance in two directions that are far from one line.
fn has_two_sides(spot: &Spot, all: &[&Spot], nearest_px: f64) -> bool {
    let directions = all.iter().filter_map(|other| {
        let [dx, dy] = [other.centre[0] - spot.centre[0], other.centre[1] - spot.centre[1]];
        let away = dx.hypot(dy);
        NEIGHBOUR_DISTANCES.contains(&(away / nearest_px)).then(|| [dx / away, dy / away])
    });
    let directions: Vec<[f64; 2]> = directions.collect();
    directions.iter().any(|[a, b]| directions.iter().any(|[c, d]| (a * c + b * d).abs() < 0.5))
}

/// Finds the spots of one size: round groups of pixels that are darker than the closing.
fn find_spots(level: &Grid<f32>, window: usize, is_dark: bool) -> Vec<Spot> {
    let turned = |value: f32| if is_dark { value } else { 255.0 - value };
    let plain = Grid { data: level.data.iter().map(|value| turned(*value)).collect(), ..*level };
    let smooth = average_neighbours(&plain);
    let closed = extreme_in_square(&extreme_in_square(&smooth, window, f32::max), window, f32::min);
    // Noise that remains in the mean of nine pixels.
    let off: Vec<f64> = plain.data.iter().zip(&smooth.data).map(|(a, b)| f64::from((a - b).abs())).collect();
    let noise = 1.4826 * median(&off).unwrap_or(0.0) / 3.0;
    let least = (6.0 * noise).max(8.0) as f32;
    let depth: Vec<f32> = closed.data.iter().zip(&smooth.data).map(|(closed, value)| closed - value).collect();
    let is_in = |at: usize| depth[at] > least.max(0.12 * if is_dark { closed.data[at] } else { level.data[at] });
    let (width, height) = (level.width, level.height);
    let mut seen = vec![false; depth.len()];
    let mut all = Vec::new();
    for start in 0..depth.len() {
        if seen[start] || !is_in(start) {
            continue;
        }
        let (mut places, mut next) = (Vec::new(), VecDeque::from([start]));
        seen[start] = true;
        while let Some(at) = next.pop_front() {
            places.push(at);
            let (x, y) = (at % width, at / width);
            let near =
                [(x > 0, 1, false), (x + 1 < width, 1, true), (y > 0, width, false), (y + 1 < height, width, true)];
            for (_, step, forward) in near.into_iter().filter(|(inside, ..)| *inside) {
                let other = if forward { at + step } else { at - step };
                if !seen[other] && is_in(other) {
                    seen[other] = true;
                    next.push_back(other);
                }
            }
        }
        all.extend(spot_from_pixels(places, &depth, [width, height], window));
    }
    all
}

/// Makes a spot of connected pixels, if they are round.
fn spot_from_pixels(places: Vec<usize>, depth: &[f32], [width, height]: [usize; 2], window: usize) -> Option<Spot> {
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    let (mut sum, mut all) = ([0.0; 2], 0.0);
    for at in &places {
        let place = [at % width, at / width];
        let weight = f64::from(depth[*at]);
        for k in 0..2 {
            low[k] = low[k].min(place[k]);
            high[k] = high[k].max(place[k]);
            sum[k] += weight * place[k] as f64;
        }
        all += weight;
    }
    let is_cut = low.contains(&0) || high[0] + 1 == width || high[1] + 1 == height;
    let [across, down] = [high[0] - low[0] + 1, high[1] - low[1] + 1];
    let is_round = across.max(down) <= 2 * across.min(down) && 2 * places.len() >= across * down;
    let fits = places.len() >= 4 && across.max(down) <= window && (is_cut || is_round);
    fits.then(|| Spot { centre: sum.map(|sum| sum / all), places, is_cut })
}

/// Returns the mean of the channels.
fn mean_of_channels(image: &RgbImage) -> Grid<f32> {
    let data = image.pixels().map(|pixel| pixel.0.iter().map(|level| f32::from(*level)).sum::<f32>() / 3.0).collect();
    Grid { width: image.width() as usize, height: image.height() as usize, data }
}

/// Averages nine pixels; at the border those that exist.
fn average_neighbours(grid: &Grid<f32>) -> Grid<f32> {
    let mut out = Grid::new(grid.width, grid.height);
    for y in 0..grid.height {
        let rows = y.saturating_sub(1)..(y + 2).min(grid.height);
        for x in 0..grid.width {
            let columns = x.saturating_sub(1)..(x + 2).min(grid.width);
            let count = rows.len() * columns.len();
            let sum: f32 = rows.clone().map(|row| grid.row(row)[columns.clone()].iter().sum::<f32>()).sum();
            out.row_mut(y)[x] = sum / count as f32;
        }
    }
    out
}

/// Finds the largest, or smallest, value in a square of `window` pixels around each pixel.
fn extreme_in_square(grid: &Grid<f32>, window: usize, of: impl Fn(f32, f32) -> f32 + Copy) -> Grid<f32> {
    transpose(&extreme_in_rows(&transpose(&extreme_in_rows(grid, window, of)), window, of))
}

/// Finds the extreme values in windows along rows (van Herk 1992): running extremes over blocks of `window` from both
/// ends, then two of these for each pixel. The cost does not depend on the window.
fn extreme_in_rows(grid: &Grid<f32>, window: usize, of: impl Fn(f32, f32) -> f32) -> Grid<f32> {
    let mut out = Grid::new(grid.width, grid.height);
    let half = window / 2;
    let length = (grid.width + 2 * half).next_multiple_of(window);
    let (mut padded, mut forth, mut back) = (vec![0.0; length], vec![0.0; length], vec![0.0; length]);
    for y in 0..grid.height {
        let row = grid.row(y);
        let inside = |at: usize| row[at.saturating_sub(half).min(grid.width - 1)];
        padded.iter_mut().enumerate().for_each(|(at, value)| *value = inside(at));
        for start in (0..length).step_by(window) {
            let end = start + window;
            (forth[start], back[end - 1]) = (padded[start], padded[end - 1]);
            for k in 1..window {
                forth[start + k] = of(forth[start + k - 1], padded[start + k]);
                back[end - 1 - k] = of(back[end - k], padded[end - 1 - k]);
            }
        }
        for (x, value) in out.row_mut(y).iter_mut().enumerate() {
            *value = of(back[x], forth[x + 2 * half]);
        }
    }
    out
}

/// Exchanges rows and columns.
fn transpose(grid: &Grid<f32>) -> Grid<f32> {
    let mut out = Grid::new(grid.height, grid.width);
    for y in 0..grid.height {
        for (x, value) in grid.row(y).iter().enumerate() {
            out.data[x * grid.height + y] = *value;
        }
    }
    out
}

/// Covers the pixels of a disc, px.
fn cover_disc(ink: &mut [bool], [width, height]: [usize; 2], [x, y]: [f64; 2], radius: f64) {
    let span = |centre: f64, size: usize| {
        (centre - radius).ceil().max(0.0) as usize..((centre + radius).floor() + 1.0).clamp(0.0, size as f64) as usize
    };
    for row in span(y, height) {
        for column in span(x, width) {
            if (column as f64 - x).hypot(row as f64 - y) <= radius {
                ink[row * width + column] = true;
            }
        }
    }
}

/// Fills the pixels that `ink` covers from their surroundings, from coarse means to fine ones.
fn fill_ink(image: &RgbImage, ink: &[bool]) -> RgbImage {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let data = image.pixels().zip(ink).map(|(pixel, covered)| {
        if *covered { [0.0; 4] } else { [f32::from(pixel[0]), f32::from(pixel[1]), f32::from(pixel[2]), 1.0] }
    });
    let smooth = fill_unknown(&Grid { width, height, data: data.collect() });
    let mut out = image.clone();
    for ((pixel, covered), value) in out.pixels_mut().zip(ink).zip(&smooth.data) {
        if *covered {
            *pixel = Rgb(std::array::from_fn(|k| value[k].round().clamp(0.0, 255.0) as u8));
        }
    }
    out
}

/// Fills values whose weight, the fourth number, is 0: recursively from means of 2 x 2 pixels. Then smooths the filled
/// values between the known ones.
fn fill_unknown(grid: &Grid<[f32; 4]>) -> Grid<[f32; 4]> {
    let is_known = |value: &[f32; 4]| value[3] > 0.0;
    if grid.data.iter().all(is_known) || grid.width.max(grid.height) < 2 {
        return grid.clone();
    }
    let mut half = Grid::<[f32; 4]>::new(grid.width.div_ceil(2), grid.height.div_ceil(2));
    for y in 0..grid.height {
        for (x, value) in grid.row(y).iter().enumerate().filter(|(_, value)| is_known(value)) {
            let sum = &mut half.row_mut(y / 2)[x / 2];
            (0..3).for_each(|k| sum[k] += value[k]);
            sum[3] += 1.0;
        }
    }
    for value in half.data.iter_mut().filter(|value| value[3] > 0.0) {
        let count = value[3];
        (0..3).for_each(|k| value[k] /= count);
        value[3] = 1.0;
    }
    let coarse = fill_unknown(&half);
    let mut out = grid.clone();
    for y in 0..grid.height {
        for (x, value) in out.row_mut(y).iter_mut().enumerate().filter(|(_, value)| value[3] == 0.0) {
            let rest = coarse.at(x / 2, y / 2);
            (0..3).for_each(|k| value[k] = rest[k]);
        }
    }
    // A few steps of Jacobi's method suffice: larger shapes were smoothed on coarser grids.
    for _ in 0..8 {
        let before = out.clone();
        for y in 0..grid.height {
            for x in (0..grid.width).filter(|x| grid.at(*x, y)[3] == 0.0) {
                let (left, right) = (before.at(x.saturating_sub(1), y), before.at((x + 1).min(grid.width - 1), y));
                let (up, low) = (before.at(x, y.saturating_sub(1)), before.at(x, (y + 1).min(grid.height - 1)));
                let value = &mut out.row_mut(y)[x];
                (0..3).for_each(|k| value[k] = 0.25 * (left[k] + right[k] + up[k] + low[k]));
            }
        }
    }
    out.data.iter_mut().for_each(|value| value[3] = 1.0);
    out
}

/// Rounds to the precision of a measurement.
fn round_measured(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}
