//! Fits the LEDs that explain presses of a ball best: direction, colour and strength of each, and the stray light.
//!
//! The model is that of the optics model `phong` with `stray_light` s: a channel c changes by (background_c - s_c)
//! times the sum over the LEDs of a_lc (reflected(N, l) - reflected(flat, l)). For given directions it is linear in the
//! strengths a and quadratic in s, so that both follow from sums over the pixels. The directions are searched for.

use nalgebra::{SMatrix, SVector};
use pulp::Simd;

use super::Session;
use super::pixels::{PixelSamples, SATURATED};
use crate::metrics::statistics::median;
use gelsim_core::base::rng::random_stream;
use gelsim_core::base::simd::{TwoWidthKernel, Vectors, dispatch_two_widths};
use gelsim_core::optics::calibrated::extrapolation::CalibrationExtrapolation;
use gelsim_core::optics::led::{Led, Normals, PlacedLed};
use gelsim_core::optics::phong::Phong;

/// Number of LEDs that are fitted: one for each colour.
const LED_COUNT: usize = 3;
/// Largest number of pixels that are used.
const MAX_PIXELS: usize = 12_000;
/// Range of the elevations that are tried, degrees.
const ELEVATIONS_DEG: [f64; 2] = [5.0, 80.0];
/// Step sizes of the search, degrees.
const STEPS_DEG: [f64; 7] = [40.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5];
/// Largest stray light, as a fraction of the dark end of the background.
const MAX_STRAY: f64 = 0.9;

/// Largest intensity. A stronger LED explains nothing: it was fitted to pixels without slopes. Real sensors: 0.9 to
/// 6.0. A sensor file may hold 100, and units of a sensor may differ from it by half.
pub const MAX_INTENSITY: f64 = 30.0;
/// Largest change with the displacement that a table may hold, as a fraction per mm.
const MAX_PER_MM: f64 = 1000.0;

/// LEDs that were fitted to presses.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedLeds {
    /// The LEDs: red, green, blue.
    pub leds: Vec<Led>,
    /// See [`gelsim_files::sensor::Sensor::stray_light`].
    pub stray_light: [f64; 3],
    /// Change of each channel with the displacement that the LEDs do not explain, as a fraction of the background per
    /// mm.
    pub per_mm: [f64; 3],
    /// Root mean square of what the LEDs do not explain, as a fraction of full scale.
    pub rms: f64,
}

impl FittedLeds {
    /// Computes mean absolute errors on pixels that are neither black nor white, grey levels: of these LEDs, of no
    /// change at all, and of the best constant change.
    pub fn mean_errors(&self, pixels: &PixelSamples) -> [f64; 3] {
        let all: Vec<usize> = (0..pixels.len()).collect();
        let normals = sample_normals(pixels, &all);
        let lit: Vec<Vec<f64>> =
            self.leds.iter().map(|led| led_changes([led.azimuth_deg, led.elevation_deg], &normals)).collect();
        let (mut sums, mut count) = ([0.0; 3], 0.0);
        for channel in 0..3 {
            let shown: Vec<usize> = all.iter().copied().filter(|k| pixels.clipped[*k][channel] == 0.0).collect();
            let change = |k: usize| f64::from(pixels.change[k][channel]);
            // The constant with the least mean absolute error is the median.
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

    /// Draws pixels of presses and moves each to a place drawn from the whole background image: what the LEDs explain of
    /// its change follows the background there, the rest of it stays.
    pub fn move_pixels(&self, pixels: &PixelSamples, session: &Session, count: usize) -> PixelSamples {
        let (mut moved, mut sources) = (PixelSamples::default(), Vec::new());
        if pixels.is_empty() {
            return moved;
        }
        let mut random = random_stream(3, "calibration", 0);
        let size = [session.background.width(), session.background.height()].map(|size| size as usize);
        for _ in 0..count {
            let k = random.uniform_below(pixels.len());
            let [x, y] = size.map(|size| random.uniform_below(size));
            let level = session.background.get_pixel(x as u32, y as u32).0;
            if level.iter().any(|level| *level >= SATURATED) {
                continue;
            }
            moved.normals.push(pixels.normals[k]);
            let place_mm = session.camera.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            let mut inputs = pixels.inputs[k];
            (inputs[1], inputs[2]) = (place_mm[0] as f32, place_mm[1] as f32);
            moved.inputs.push(inputs);
            moved.background.push(level.map(|level| f32::from(level) / 255.0));
            moved.change.push(pixels.change[k]);
            moved.clipped.push(pixels.clipped[k]);
            sources.push(k);
        }
        let normals = sample_normals(pixels, &sources);
        for led in &self.leds {
            let lit = led_changes([led.azimuth_deg, led.elevation_deg], &normals);
            for (at, k) in sources.iter().enumerate() {
                for channel in 0..3 {
                    let brighter = moved.background[at][channel] - pixels.background[*k][channel];
                    moved.change[at][channel] +=
                        (f64::from(brighter) * led.intensity * led.color[channel] * lit[at]) as f32;
                }
            }
        }
        moved
    }

    /// Returns the fit with values cut to what a sensor file may hold.
    fn clamp_to_limits(mut self) -> Self {
        self.leds.iter_mut().for_each(|led| led.intensity = led.intensity.min(MAX_INTENSITY));
        self.per_mm = self.per_mm.map(|share| share.clamp(-MAX_PER_MM, MAX_PER_MM));
        self
    }

    /// Returns what the calibrated optics follow outside the range of the presses.
    pub fn extrapolation(&self) -> CalibrationExtrapolation {
        CalibrationExtrapolation { leds: self.leds.clone(), stray_light: self.stray_light, per_mm: self.per_mm }
    }
}

/// Azimuth and elevation of each LED, degrees.
type Directions = [[f64; 2]; LED_COUNT];

/// Sums over pixels for one channel and given directions: products of the features. The first features are the
/// reflected light times the background, the others the reflected light.
struct ChannelSums {
    products: SMatrix<f64, { 2 * LED_COUNT }, { 2 * LED_COUNT }>,
    with_change: SVector<f64, { 2 * LED_COUNT }>,
    change_squared: f64,
    count: f64,
}

/// Fits three LEDs. `None` without pixels.
pub fn fit_leds<'a>(pixels: impl IntoIterator<Item = &'a PixelSamples>) -> Option<FittedLeds> {
    let mut all = PixelSamples::default();
    pixels.into_iter().for_each(|pixels| all.append(pixels));
    if all.is_empty() {
        return None;
    }
    let sample: Vec<usize> = (0..all.len()).step_by(all.len().div_ceil(MAX_PIXELS)).collect();
    // The 2nd percentile, so that a few black pixels do not decide how much stray light there may be.
    let darkest = [0, 1, 2].map(|channel| {
        let mut levels: Vec<f64> = sample.iter().map(|k| f64::from(all.background[*k][channel])).collect();
        levels.sort_by(f64::total_cmp);
        levels[levels.len() / 50]
    });
    let normals = sample_normals(&all, &sample);
    let samples = ChannelSamples::from_pixels(&all, &sample);
    let sums = |directions: &Directions| channel_sums(&samples, &normals, directions);
    let error = |directions: &Directions| fit_strengths(&sums(directions), darkest).0;
    // The search finds local minima: it starts from three LEDs evenly spaced, at four turns.
    let starts = [0.0, 30.0, 60.0, 90.0].map(|turn| [0.0, 120.0, 240.0].map(|azimuth| [azimuth + turn, 30.0]));
    let found = starts.map(|start| descend_directions(start, &error));
    let (_, directions) = found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let sums = sums(&directions);
    let (left, channels) = fit_strengths(&sums, darkest);
    let count: f64 = sums.iter().map(|sums| sums.count).sum();
    let stray_light = channels.map(|(stray, _)| round_fitted(stray));
    let leds =
        order_by_color(channels.map(|(_, strengths)| strengths)).zip(["red", "green", "blue"]).map(|(l, name)| {
            let strengths = channels.map(|(_, strengths)| strengths[l]);
            let intensity = strengths.into_iter().fold(0.0, f64::max);
            Led {
                name: String::from(name),
                azimuth_deg: directions[l][0].rem_euclid(360.0),
                elevation_deg: directions[l][1],
                color: strengths.map(|strength| if intensity > 0.0 { round_fitted(strength / intensity) } else { 0.0 }),
                intensity: round_fitted(intensity),
                ..Led::default()
            }
        });
    let per_mm = fit_per_mm(&all, &sample, &normals, &directions, channels);
    let found = FittedLeds { leds: leds.collect(), stray_light, per_mm, rms: (left / count.max(1.0)).sqrt() };
    Some(found.clamp_to_limits())
}

/// Fits how the change that the LEDs do not explain grows with the displacement, by least squares.
fn fit_per_mm(
    pixels: &PixelSamples,
    sample: &[usize],
    normals: &Normals,
    directions: &Directions,
    channels: [(f64, [f64; LED_COUNT]); 3],
) -> [f64; 3] {
    let changes = directions.map(|direction| led_changes(direction, normals));
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
    std::array::from_fn(|channel| round_fitted(products[channel] / squares[channel].max(1e-9)))
}

/// Returns which LED is the red, which the green and which the blue one: the order with the largest sum of the
/// strengths in those colours.
fn order_by_color(strengths: [[f64; LED_COUNT]; 3]) -> impl Iterator<Item = usize> {
    const ORDERS: [[usize; LED_COUNT]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let sum = |order: &[usize; LED_COUNT]| (0..3).map(|channel| strengths[channel][order[channel]]).sum::<f64>();
    ORDERS.into_iter().max_by(|a, b| sum(a).total_cmp(&sum(b))).into_iter().flatten()
}

/// Rounds to three decimals: a fit knows no more.
fn round_fitted(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}

/// Minimises the error over the directions, one angle at a time by ever smaller steps. Returns the error, too.
fn descend_directions(start: Directions, error: &impl Fn(&Directions) -> f64) -> (f64, Directions) {
    let (mut best, mut least) = (start, error(&start));
    for step in STEPS_DEG {
        let mut moved = true;
        while moved {
            moved = false;
            for (led, angle) in (0..LED_COUNT).flat_map(|led| [(led, 0), (led, 1)]) {
                for by in [-step, step] {
                    let mut tried = best;
                    tried[led][angle] += by;
                    if angle == 1 {
                        tried[led][1] = tried[led][1].clamp(ELEVATIONS_DEG[0], ELEVATIONS_DEG[1]);
                    }
                    let now = error(&tried);
                    // Not just any decrease: rounding errors could make the search go round for ever.
                    if now < least * (1.0 - 1e-6) {
                        (best, least, moved) = (tried, now, true);
                    }
                }
            }
        }
    }
    (least, best)
}

/// Returns the normals of a sample of the pixels, followed by that of a flat pad.
fn sample_normals(pixels: &PixelSamples, sample: &[usize]) -> Normals {
    let mut normals = Normals::default();
    sample.iter().for_each(|k| normals.push(pixels.normals[*k]));
    normals.push([0.0; 2]);
    normals
}

/// Computes what an LED of strength 1 in this direction reflects at each normal, less what it reflects at the last one,
/// which is a flat pad's.
fn led_changes([azimuth_deg, elevation_deg]: [f64; 2], normals: &Normals) -> Vec<f64> {
    let led = PlacedLed::new(&Led { azimuth_deg, elevation_deg, ..Led::default() });
    let mut gain = vec![0.0; normals.x.len()];
    led.reflect(&Phong::default(), normals, &mut gain);
    let flat = gain.last().copied().unwrap_or_default();
    gain.into_iter().map(|gain| f64::from(gain) - f64::from(flat)).collect()
}

/// What is known of a channel at a sample of the pixels. Clipped ones are left out: their change is not known.
#[derive(Default)]
struct ChannelSamples {
    /// Places in the sample.
    numbers: Vec<usize>,
    /// The background and the change, as fractions of full scale.
    levels: Vec<[f64; 2]>,
}

impl ChannelSamples {
    fn from_pixels(pixels: &PixelSamples, sample: &[usize]) -> [Self; 3] {
        [0, 1, 2].map(|channel| {
            let mut known = Self::default();
            for (number, &k) in sample.iter().enumerate().filter(|(_, k)| pixels.clipped[**k][channel] == 0.0) {
                known.numbers.push(number);
                known.levels.push([pixels.background[k][channel], pixels.change[k][channel]].map(f64::from));
            }
            known
        })
    }

    /// Computes the sums, from each LED's [`led_changes`].
    fn sum(&self, changes: &[Vec<f64>; LED_COUNT]) -> ChannelSums {
        let mut sums = [[0.0; 8]; 2 * LED_COUNT + 1];
        // Few rows at a time, which stay in the L1 cache.
        let mut rows = [[0.0; 8]; 256];
        for (numbers, levels) in self.numbers.chunks(rows.len()).zip(self.levels.chunks(rows.len())) {
            for ((row, &number), [rest, change]) in rows.iter_mut().zip(numbers).zip(levels) {
                for (led, of_led) in changes.iter().enumerate() {
                    row[led] = rest * of_led[number];
                    row[LED_COUNT + led] = of_led[number];
                }
                row[2 * LED_COUNT] = *change;
            }
            dispatch_two_widths(ProductsKernel { rows: &rows[..numbers.len()], sums: &mut sums });
        }
        ChannelSums {
            products: SMatrix::from_fn(|i, j| sums[i][j]),
            with_change: SVector::from_fn(|i, _| sums[i][2 * LED_COUNT]),
            change_squared: sums[2 * LED_COUNT][2 * LED_COUNT],
            count: self.numbers.len() as f64,
        }
    }
}

/// Computes the sums of each channel.
fn channel_sums(samples: &[ChannelSamples; 3], normals: &Normals, directions: &Directions) -> [ChannelSums; 3] {
    let changes = directions.map(|direction| led_changes(direction, normals));
    samples.each_ref().map(|channel| channel.sum(&changes))
}

/// Adds to sums, for each row, the products of all pairs of its first seven numbers. The eighth is 0, so that a row fills
/// vectors.
struct ProductsKernel<'a> {
    rows: &'a [[f64; 8]],
    sums: &'a mut [[f64; 8]; 2 * LED_COUNT + 1],
}

impl TwoWidthKernel for ProductsKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        let simd = vectors.widest;
        for part in 0..8 / W::F64_LANES {
            let mut sums = [simd.splat_f64s(0.0); 2 * LED_COUNT + 1];
            for (sum, all) in sums.iter_mut().zip(&*self.sums) {
                *sum = W::as_simd_f64s(all).0[part];
            }
            for row in self.rows {
                let others = W::as_simd_f64s(row).0[part];
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum = simd.add_f64s(*sum, simd.mul_f64s(simd.splat_f64s(*value), others));
                }
            }
            for (all, sum) in self.sums.iter_mut().zip(sums) {
                W::as_mut_simd_f64s(all).0[part] = sum;
            }
        }
    }
}

/// Finds for each channel the stray light and the strengths with the least error. Returns the sum of squared errors,
/// too.
fn fit_strengths(sums: &[ChannelSums; 3], darkest: [f64; 3]) -> (f64, [(f64, [f64; LED_COUNT]); 3]) {
    let mut left = 0.0;
    let channels = std::array::from_fn(|channel| {
        let tried = (0..=20).map(|k| f64::from(k) / 20.0 * MAX_STRAY * darkest[channel]);
        let found = tried.map(|stray| {
            let (left, strengths) = sums[channel].solve_strengths(stray);
            (left, stray, strengths)
        });
        let least = found.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        left += least.0;
        (least.1, least.2)
    });
    (left, channels)
}

impl ChannelSums {
    /// Finds the strengths, none negative, with the least error. Returns the sum of squared errors, too.
    fn solve_strengths(&self, stray: f64) -> (f64, [f64; LED_COUNT]) {
        let part = |i: usize, j: usize| {
            self.products.fixed_view::<LED_COUNT, LED_COUNT>(i * LED_COUNT, j * LED_COUNT).into_owned()
        };
        let matrix = part(0, 0) - (part(0, 1) + part(1, 0)) * stray + part(1, 1) * (stray * stray);
        let vector =
            self.with_change.fixed_rows::<LED_COUNT>(0) - self.with_change.fixed_rows::<LED_COUNT>(LED_COUNT) * stray;
        let mut best = (self.change_squared, [0.0; LED_COUNT]);
        // Least squares with non-negative strengths. There are so few LEDs that every choice of those above 0 is tried.
        for shining in 1_usize..1 << LED_COUNT {
            let mut reduced = matrix;
            let mut aim = vector;
            for l in (0..LED_COUNT).filter(|l| shining & (1 << l) == 0) {
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
    use gelsim_core::base::rng::random_stream;

    #[test]
    fn leds_that_made_the_pixels_are_found() {
        let truth: Directions = [[262.0, 21.0], [8.0, 33.0], [75.0, 45.0]];
        let strengths = [[2.5, 0.3, 0.0], [0.0, 1.9, 0.2], [0.1, 0.4, 3.1]];
        let stray = [0.05, 0.2, 0.1];
        let per_mm = [0.0, -0.02, 0.03];
        let mut random = random_stream(3, "calibration", 0);
        let mut pixels = PixelSamples::default();
        for _ in 0..4000 {
            let (slope, azimuth) = (0.7 * random.uniform(), 360.0 * random.uniform());
            let (sin, cos) = sin_cos_deg(azimuth);
            let normal = [(slope * cos) as f32, (slope * sin) as f32];
            let rest = [0.3, 0.4, 0.35].map(|level: f64| (level + 0.1 * (random.uniform() - 0.5)) as f32);
            let height_mm = random.uniform() - 0.5;
            let one = PixelSamples {
                normals: vec![normal],
                inputs: vec![std::array::from_fn(|k| if k == 0 { height_mm as f32 } else { 0.0 })],
                change: vec![[1.0; 3]],
                clipped: vec![[0.0; 3]],
                background: vec![[1.0; 3]],
            };
            // Of a white background the features are the reflected light itself.
            let light =
                channel_sums(&ChannelSamples::from_pixels(&one, &[0]), &super::sample_normals(&one, &[0]), &truth)[0]
                    .with_change;
            pixels.append(&PixelSamples {
                change: vec![std::array::from_fn(|c| {
                    let added: f64 = (0..LED_COUNT).map(|l| strengths[l][c] * light[l]).sum();
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
        let flat = PixelSamples {
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
