//! The LEDs that explain presses of a ball best: direction, colour and strength of each, and the stray light.
//!
//! The model is that of the optics model `phong` with `stray_light` s: a channel c changes by
//! (background_c - s_c) times the sum over the LEDs of a_lc (reflected(N, l) - reflected(flat, l)). For given directions it is
//! linear in the a and quadratic in s, so that both follow from sums over the pixels; the directions are searched for.

use nalgebra::{SMatrix, SVector};

use super::pixels::Pixels;
use crate::metrics::statistics::median;
use gelsim_core::optics::calibrated::beyond::Beyond;
use gelsim_core::optics::led::{Led, Normals, PlacedLed, Row};
use gelsim_core::optics::phong::{Phong, reflect};

/// How many LEDs are fitted: one for each colour.
const LEDS: usize = 3;
/// Pixels that are looked at.
const MOST_PIXELS: usize = 12_000;
/// Elevations that are tried, degrees.
const ELEVATIONS_DEG: [f64; 2] = [5.0, 80.0];
/// Steps of the search, degrees.
const STEPS_DEG: [f64; 7] = [40.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5];
/// Most of the dark end of the background that may be stray light.
const MOST_STRAY: f64 = 0.9;

/// A stronger LED explains nothing: what it is fitted to has no slopes. Real sensors: 0.9 to 6.0. A sensor file may hold 100, of
/// which units of a sensor may differ by half.
pub const MOST_INTENSITY: f64 = 30.0;
/// Largest share per mm that a table may hold.
const MOST_PER_MM: f64 = 1000.0;

/// LEDs that were fitted to presses.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedLeds {
    /// The LEDs, the reddest first.
    pub leds: Vec<Led>,
    /// See [`gelsim_files::sensor::Sensor::stray_light`].
    pub stray_light: [f64; 3],
    /// Change of each channel with the displacement that they leave unexplained, as a share of the background per mm.
    pub per_mm: [f64; 3],
    /// Root of the mean square of what the LEDs leave unexplained, as a fraction of full scale.
    pub rms: f64,
}

impl FittedLeds {
    /// Mean absolute errors on pixels that are not black or white, grey levels: of these LEDs, of no change at all, and of the
    /// best constant change.
    pub fn errors(&self, pixels: &Pixels) -> [f64; 3] {
        let all: Vec<usize> = (0..pixels.len()).collect();
        let normals = normals(pixels, &all);
        let lit: Vec<Vec<f64>> =
            self.leds.iter().map(|led| changes([led.azimuth_deg, led.elevation_deg], &normals)).collect();
        let (mut sums, mut count) = ([0.0; 3], 0.0);
        for channel in 0..3 {
            let shown: Vec<usize> = all.iter().copied().filter(|k| pixels.clipped[*k][channel] == 0.0).collect();
            let change = |k: usize| f64::from(pixels.change[k][channel]);
            let middle = median(&shown.iter().map(|k| change(*k)).collect::<Vec<_>>()).unwrap_or(0.0);
            for k in shown {
                let light: f64 =
                    self.leds.iter().zip(&lit).map(|(led, lit)| led.intensity * led.color[channel] * lit[k]).sum();
                let found = (f64::from(pixels.background[k][channel]) - self.stray_light[channel]) * light;
                sums[0] += (found - change(k)).abs();
                sums[1] += change(k).abs();
                sums[2] += (change(k) - middle).abs();
                count += 1.0;
            }
        }
        sums.map(|sum| 255.0 * sum / f64::max(count, 1.0))
    }

    /// The same within what a sensor file may hold.
    fn limited(mut self) -> Self {
        self.leds.iter_mut().for_each(|led| led.intensity = led.intensity.min(MOST_INTENSITY));
        self.per_mm = self.per_mm.map(|share| share.clamp(-MOST_PER_MM, MOST_PER_MM));
        self
    }

    /// What light follows them beyond the presses.
    pub fn beyond(&self) -> Beyond {
        Beyond { leds: self.leds.clone(), stray_light: self.stray_light, per_mm: self.per_mm }
    }
}

/// Azimuth and elevation of each LED, degrees.
type Directions = [[f64; 2]; LEDS];

/// What one channel says, for given directions: sums over pixels of products of the features, of which the first are the
/// reflected light times the background and the others the reflected light.
#[derive(Clone, Copy, Default)]
struct Sums {
    products: SMatrix<f64, { 2 * LEDS }, { 2 * LEDS }>,
    with_change: SVector<f64, { 2 * LEDS }>,
    change_squared: f64,
    count: f64,
}

/// Fits three LEDs. `None` without pixels.
pub fn fit_leds<'a>(pixels: impl IntoIterator<Item = &'a Pixels>) -> Option<FittedLeds> {
    let mut all = Pixels::default();
    pixels.into_iter().for_each(|pixels| all.append(pixels));
    if all.is_empty() {
        return None;
    }
    let sample: Vec<usize> = (0..all.len()).step_by(all.len().div_ceil(MOST_PIXELS)).collect();
    let darkest = [0, 1, 2].map(|channel| {
        let mut levels: Vec<f64> = sample.iter().map(|k| f64::from(all.background[*k][channel])).collect();
        levels.sort_by(f64::total_cmp);
        levels[levels.len() / 50]
    });
    let normals = normals(&all, &sample);
    let sums = |directions: &Directions| sums(&all, &sample, &normals, directions);
    let error = |directions: &Directions| fitted(&sums(directions), darkest).0;
    let starts = [0.0, 30.0, 60.0, 90.0].map(|turn| [0.0, 120.0, 240.0].map(|azimuth| [azimuth + turn, 30.0]));
    let found = starts.map(|start| descended(start, &error));
    let (_, directions) = found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let sums = sums(&directions);
    let (left, channels) = fitted(&sums, darkest);
    let count: f64 = sums.iter().map(|sums| sums.count).sum();
    let stray_light = channels.map(|(stray, _)| rounded(stray));
    let leds = by_color(channels.map(|(_, strengths)| strengths)).zip(["red", "green", "blue"]).map(|(l, name)| {
        let strengths = channels.map(|(_, strengths)| strengths[l]);
        let intensity = strengths.into_iter().fold(0.0, f64::max);
        Led {
            name: String::from(name),
            azimuth_deg: directions[l][0].rem_euclid(360.0),
            elevation_deg: directions[l][1],
            color: strengths.map(|strength| if intensity > 0.0 { rounded(strength / intensity) } else { 0.0 }),
            intensity: rounded(intensity),
            ..Led::default()
        }
    });
    let per_mm = per_mm(&all, &sample, &normals, &directions, channels);
    let found = FittedLeds { leds: leds.collect(), stray_light, per_mm, rms: (left / count.max(1.0)).sqrt() };
    Some(found.limited())
}

/// How the rest that the LEDs leave grows with the displacement, by least squares.
fn per_mm(
    pixels: &Pixels,
    sample: &[usize],
    normals: &Normals,
    directions: &Directions,
    channels: [(f64, [f64; LEDS]); 3],
) -> [f64; 3] {
    let changes = directions.map(|direction| changes(direction, normals));
    let (mut products, mut squares) = ([0.0; 3], [0.0; 3]);
    for (number, &k) in sample.iter().enumerate() {
        let height_mm = f64::from(pixels.inputs[k][0]);
        for (channel, (stray, strengths)) in channels.iter().enumerate() {
            if pixels.clipped[k][channel] != 0.0 {
                continue;
            }
            let rest = f64::from(pixels.background[k][channel]);
            let light: f64 = strengths.iter().zip(&changes).map(|(strength, of_led)| strength * of_led[number]).sum();
            let left = f64::from(pixels.change[k][channel]) - (rest - stray) * light;
            products[channel] += left * rest * height_mm;
            squares[channel] += (rest * height_mm) * (rest * height_mm);
        }
    }
    std::array::from_fn(|channel| rounded(products[channel] / squares[channel].max(1e-9)))
}

/// Which LED is the red one, which the green and which the blue: as gives the largest sum of the strengths in their colours.
fn by_color(strengths: [[f64; LEDS]; 3]) -> impl Iterator<Item = usize> {
    const ORDERS: [[usize; LEDS]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let sum = |order: &[usize; LEDS]| (0..3).map(|channel| strengths[channel][order[channel]]).sum::<f64>();
    ORDERS.into_iter().max_by(|a, b| sum(a).total_cmp(&sum(b))).into_iter().flatten()
}

/// To what a fit knows.
fn rounded(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}

/// Moves one angle at a time by ever smaller steps, as long as the error falls.
fn descended(start: Directions, error: &impl Fn(&Directions) -> f64) -> (f64, Directions) {
    let (mut best, mut least) = (start, error(&start));
    for step in STEPS_DEG {
        let mut moved = true;
        while moved {
            moved = false;
            for (led, angle) in (0..LEDS).flat_map(|led| [(led, 0), (led, 1)]) {
                for by in [-step, step] {
                    let mut tried = best;
                    tried[led][angle] += by;
                    if angle == 1 {
                        tried[led][1] = tried[led][1].clamp(ELEVATIONS_DEG[0], ELEVATIONS_DEG[1]);
                    }
                    let now = error(&tried);
                    if now < least * (1.0 - 1e-6) {
                        (best, least, moved) = (tried, now, true);
                    }
                }
            }
        }
    }
    (least, best)
}

/// The normals of a sample of the pixels, and a flat pad's after them.
fn normals(pixels: &Pixels, sample: &[usize]) -> Normals {
    let mut normals = Normals::default();
    sample.iter().for_each(|k| normals.push(pixels.normals[*k]));
    normals.push([0.0; 2]);
    normals
}

/// What an LED in this direction gives at each normal beyond what it gives at the last one, which is a flat pad's.
fn changes([azimuth_deg, elevation_deg]: [f64; 2], normals: &Normals) -> Vec<f64> {
    let led = PlacedLed::new(&Led { azimuth_deg, elevation_deg, ..Led::default() }, false);
    let mut gain = vec![0.0; normals.x.len()];
    reflect(&Phong::default(), &led, normals, Row::default(), &mut gain);
    let flat = gain.last().copied().unwrap_or_default();
    gain.into_iter().map(|gain| f64::from(gain) - f64::from(flat)).collect()
}

/// The sums of each channel.
fn sums(pixels: &Pixels, sample: &[usize], normals: &Normals, directions: &Directions) -> [Sums; 3] {
    let changes = directions.map(|direction| changes(direction, normals));
    let mut all = [Sums::default(); 3];
    for (number, &k) in sample.iter().enumerate() {
        let changes = changes.each_ref().map(|of_led| of_led[number]);
        for (channel, sums) in all.iter_mut().enumerate() {
            if pixels.clipped[k][channel] != 0.0 {
                continue;
            }
            let (rest, change) = (f64::from(pixels.background[k][channel]), f64::from(pixels.change[k][channel]));
            let features =
                SVector::<f64, { 2 * LEDS }>::from_fn(|i, _| if i < LEDS { rest } else { 1.0 } * changes[i % LEDS]);
            sums.products += features * features.transpose();
            sums.with_change += features * change;
            sums.change_squared += change * change;
            sums.count += 1.0;
        }
    }
    all
}

/// For each channel the stray light and strengths that leave least, and what all of them leave.
fn fitted(sums: &[Sums; 3], darkest: [f64; 3]) -> (f64, [(f64, [f64; LEDS]); 3]) {
    let mut left = 0.0;
    let channels = std::array::from_fn(|channel| {
        let tried = (0..=20).map(|k| f64::from(k) / 20.0 * MOST_STRAY * darkest[channel]);
        let found = tried.map(|stray| {
            let (left, strengths) = sums[channel].strengths(stray);
            (left, stray, strengths)
        });
        let least = found.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        left += least.0;
        (least.1, least.2)
    });
    (left, channels)
}

impl Sums {
    /// Strengths, none below 0, that leave least; and how much, as a sum of squares.
    fn strengths(&self, stray: f64) -> (f64, [f64; LEDS]) {
        let part = |i: usize, j: usize| self.products.fixed_view::<LEDS, LEDS>(i * LEDS, j * LEDS).into_owned();
        let matrix = part(0, 0) - (part(0, 1) + part(1, 0)) * stray + part(1, 1) * (stray * stray);
        let vector = self.with_change.fixed_rows::<LEDS>(0) - self.with_change.fixed_rows::<LEDS>(LEDS) * stray;
        let mut best = (self.change_squared, [0.0; LEDS]);
        // So few that every choice of those above 0 is tried.
        for shining in 1_usize..1 << LEDS {
            let mut reduced = matrix;
            let mut aim = vector;
            for l in (0..LEDS).filter(|l| shining & (1 << l) == 0) {
                reduced.row_mut(l).fill(0.0);
                reduced.column_mut(l).fill(0.0);
                reduced[(l, l)] = 1.0;
                aim[l] = 0.0;
            }
            let Some(found) = reduced.cholesky().map(|factors| factors.solve(&aim)) else { continue };
            if found.iter().any(|strength| *strength < 0.0 || !strength.is_finite()) {
                continue;
            }
            let left = self.change_squared - 2.0 * vector.dot(&found) + found.dot(&(matrix * found));
            if left < best.0 {
                best = (left, std::array::from_fn(|l| found[l]));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::base::angle::sin_cos_deg;
    use gelsim_core::base::rng::stream;

    #[test]
    fn leds_that_made_the_pixels_are_found() {
        let truth: Directions = [[262.0, 21.0], [8.0, 33.0], [75.0, 45.0]];
        let strengths = [[2.5, 0.3, 0.0], [0.0, 1.9, 0.2], [0.1, 0.4, 3.1]];
        let stray = [0.05, 0.2, 0.1];
        let per_mm = [0.0, -0.02, 0.03];
        let mut random = stream(3, "calibration", 0);
        let mut pixels = Pixels::default();
        for _ in 0..4000 {
            let (slope, azimuth) = (0.7 * random.unit(), 360.0 * random.unit());
            let (sin, cos) = sin_cos_deg(azimuth);
            let normal = [(slope * cos) as f32, (slope * sin) as f32];
            let rest = [0.3, 0.4, 0.35].map(|level: f64| (level + 0.1 * (random.unit() - 0.5)) as f32);
            let height_mm = random.unit() - 0.5;
            let one = Pixels {
                normals: vec![normal],
                inputs: vec![std::array::from_fn(|k| if k == 0 { height_mm as f32 } else { 0.0 })],
                change: vec![[1.0; 3]],
                clipped: vec![[0.0; 3]],
                background: vec![[1.0; 3]],
            };
            // Of a white background the features are the reflected light itself.
            let light = sums(&one, &[0], &super::normals(&one, &[0]), &truth)[0].with_change;
            pixels.append(&Pixels {
                change: vec![std::array::from_fn(|c| {
                    let added: f64 = (0..LEDS).map(|l| strengths[l][c] * light[l]).sum();
                    (added * (f64::from(rest[c]) - stray[c]) + per_mm[c] * f64::from(rest[c]) * height_mm) as f32
                })],
                background: vec![rest],
                ..one
            });
        }
        let found = fit_leds([&pixels]).expect("pixels");
        assert!(found.rms < 1e-2, "{found:?}");
        assert!(found.per_mm.iter().zip(per_mm).all(|(found, truth)| (found - truth).abs() < 0.01), "{found:?}");
        for (led, ([azimuth, elevation], strengths)) in found.leds.iter().zip(truth.iter().zip(strengths)) {
            let turned = (led.azimuth_deg - azimuth + 180.0).rem_euclid(360.0) - 180.0;
            assert!(turned.abs() < 3.0 && (led.elevation_deg - elevation).abs() < 5.0, "{led:?}");
            let strongest = strengths.iter().copied().fold(0.0, f64::max);
            assert!((led.intensity / strongest - 1.0).abs() < 0.1, "{led:?}");
        }
        assert!(found.stray_light.iter().zip(stray).all(|(found, stray)| (found - stray).abs() < 0.05), "{found:?}");
    }

    #[test]
    fn pads_that_nothing_changed_have_dark_leds_and_no_pixels_none() {
        assert_eq!(fit_leds([]), None);
        let flat = Pixels {
            normals: vec![[0.0; 2]; 9],
            inputs: vec![Default::default(); 9],
            change: vec![[0.0; 3]; 9],
            clipped: vec![[0.0; 3]; 9],
            background: vec![[0.5; 3]; 9],
        };
        let found = fit_leds([&flat]).expect("pixels");
        assert!(found.leds.iter().all(|led| led.intensity == 0.0) && found.rms == 0.0, "{found:?}");
    }
}
