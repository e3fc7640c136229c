//! Measures a sensor's camera: noise and drift between images, where nothing was pressed; and the speckle that the skin
//! shows where something was.
//!
//! Away from the discs, images of two presses show the same pad. Their difference, less its mean in each small block,
//! is the noise of both, whatever the pad's grain. Its variance as a function of the level separates shot from read
//! noise (Janesick 2007, "Photon transfer"). Medians over blocks ignore dust that moved.
//!
//! Within a disc, a block of image less background is noise, speckle, and light that varies smoothly. Less a parabola,
//! its variance above that of blocks away from the disc is the speckle's.

use image::RgbImage;
use rayon::prelude::*;

use super::pixels::REACH;
use super::{Observation, Session};
use gelsim_core::camera::noise::MAX_CORRELATION;
use gelsim_files::sensor::camera::CameraDistribution;
use gelsim_files::sensor::quantity::{Distribution, Normal, Quantity};

/// Side of a block, px.
const BLOCK_PX: usize = 8;
/// Number of bins of grey levels.
const BINS: usize = 16;
/// Fewest blocks with which a bin of levels counts.
const MIN_BLOCKS: usize = 12;
/// Variance that rounding to integer levels adds to an image.
const ROUNDING: f64 = 1.0 / 12.0;
/// Levels between which a pixel is neither black nor white.
const USABLE_LEVELS: [u8; 2] = [3, 252];
/// Median of a variance of 63 free values over its mean: below 1, because its distribution is skewed.
const MEDIAN_OVER_MEAN: f64 = 0.989;
/// Smallest fraction of an image away from its disc with which its brightness is measured.
const MIN_FAR: f64 = 0.02;
/// Radius within which a disc is as smooth as a parabola in each block, in radii of the disc.
const SMOOTH_RADIUS: f64 = 0.75;
/// Drift of brightness below which none is written.
const UNSEEN_DRIFT: f64 = 5e-4;

/// Camera as its images show it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredCamera {
    /// Standard deviation of the read noise of each channel, grey levels.
    pub read_noise_levels: [f64; 3],
    /// Standard deviation of the shot noise of each channel where it is white, grey levels.
    pub shot_noise_levels: [f64; 3],
    /// Correlation of the noise of a pixel with that of its neighbour to the right, and below.
    pub correlation: [f64; 2],
    /// Standard deviation between the images of the brightness of red, green and blue, as a fraction.
    pub drift: [f64; 3],
    /// Standard deviation between the images of the brightness of green, then of red over green and of blue over green,
    /// as fractions.
    pub gains: [f64; 3],
    /// Standard deviation of the speckle of each channel within the discs, grey levels; `None` if they are too small.
    pub speckle_levels: Option<[f64; 3]>,
}

impl MeasuredCamera {
    /// Returns the keys of a sensor file that describe the camera. What was not measured is taken from `rest`.
    pub fn to_distribution(&self, rest: CameraDistribution) -> CameraDistribution {
        let mean = |levels: [f64; 3]| Quantity::Constant(round_to_parts(rms(levels), 1e3));
        let factor = |std: f64| {
            let std = round_to_parts(std, 1e4);
            let end = |sign: f64| Some(round_to_parts(1.0 + 3.0 * sign * std, 1e4));
            let normal = Normal { mean: 1.0, std, min: end(-1.0), max: end(1.0) };
            if std > UNSEEN_DRIFT { Quantity::Random(Distribution::Normal(normal)) } else { Quantity::Constant(1.0) }
        };
        let [green, red, blue] = self.gains;
        let neighbours = 0.5 * (self.correlation[0] + self.correlation[1]);
        CameraDistribution {
            exposure: factor(green),
            red_gain: factor(red),
            blue_gain: factor(blue),
            shot_noise_levels: mean(self.shot_noise_levels),
            read_noise_levels: mean(self.read_noise_levels),
            noise_color: self.noise_color(),
            noise_correlation: Quantity::Constant(round_to_parts(neighbours.clamp(0.0, MAX_CORRELATION), 1e2)),
            speckle_levels: self.speckle_levels.map_or(rest.speckle_levels, mean),
            ..rest
        }
    }
}

impl MeasuredCamera {
    /// Noise of each channel at half brightness over that of all channels; 1 without noise.
    fn noise_color(&self) -> [f64; 3] {
        let of =
            |channel: usize| self.read_noise_levels[channel].hypot(self.shot_noise_levels[channel] * 0.5_f64.sqrt());
        let channels = std::array::from_fn(of);
        let all = rms(channels);
        channels.map(|channel| if all > 0.0 { round_to_parts(channel / all, 1e2) } else { 1.0 })
    }
}

/// Rounds to the precision of a measurement: so many parts of 1.
fn round_to_parts(value: f64, parts: f64) -> f64 {
    (parts * value).round() / parts
}

/// Root mean square.
fn rms(values: [f64; 3]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / 3.0).sqrt()
}

/// Measures the camera; `None` if the images show too little away from the discs.
pub fn measure_camera(session: &Session) -> Option<MeasuredCamera> {
    if session.printed.is_some() {
        return measure_camera(&blacken_dots(session));
    }
    let known: Vec<(&Observation, [f64; 3])> = session
        .observations
        .iter()
        .filter_map(|observation| Some((observation, measure_brightness(observation, &session.background)?)))
        .collect();
    let pairs: Vec<_> = known.windows(2).collect();
    let blocks: Vec<NoiseBlock> = pairs
        .par_iter()
        .map(|pair| collect_noise_blocks(pair[0], pair[1]))
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect();
    let noise: Option<Vec<[f64; 2]>> = (0..3).map(|channel| fit_noise(&blocks, channel)).collect();
    let noise = noise?;
    let correlation = |way: usize| {
        let noisy = blocks.iter().flat_map(|block| (0..3).map(move |channel| (block, channel)));
        let values = noisy.filter(|(block, channel)| block.variance[*channel] > ROUNDING);
        median(values.map(|(block, channel)| block.correlation[channel][way]).collect()).unwrap_or_default()
    };
    let shot_noise_levels = [0, 1, 2].map(|channel| noise[channel][1]);
    let drift =
        |of: &dyn Fn(&[f64; 3]) -> f64| robust_deviation(known.iter().map(|(_, gains)| libm::log(of(gains))).collect());
    Some(MeasuredCamera {
        read_noise_levels: std::array::from_fn(|channel| noise[channel][0]),
        shot_noise_levels,
        correlation: std::array::from_fn(correlation),
        drift: std::array::from_fn(|channel| drift(&|gains| gains[channel])),
        gains: [
            drift(&|[_, green, _]| *green),
            drift(&|[red, green, _]| red / green),
            drift(&|[_, green, blue]| blue / green),
        ],
        speckle_levels: measure_speckle(&known, &session.background, shot_noise_levels),
    })
}

/// Returns the session with its dots painted black, so that no measurement counts them.
fn blacken_dots(session: &Session) -> Session {
    let mut blackened = Session { printed: None, ..session.clone() };
    for observation in &mut blackened.observations {
        for (pixel, inked) in observation.image.pixels_mut().zip(std::mem::take(&mut observation.ink)) {
            if inked {
                pixel.0 = [0; 3];
            }
        }
    }
    blackened
}

/// Measures how much rougher each channel is within the discs than away from them, grey levels. `None` if there are too
/// few blocks.
fn measure_speckle(
    known: &[(&Observation, [f64; 3])],
    background: &RgbImage,
    shot_noise_levels: [f64; 3],
) -> Option<[f64; 3]> {
    let roughness = |is_inside: &(dyn Fn(&Observation, usize, usize) -> bool + Sync)| -> Option<[f64; 3]> {
        let of = |(observation, gains): &(&Observation, [f64; 3])| {
            let is_clear = |x: usize, y: usize| is_inside(observation, x, y);
            find_clear_blocks(background, is_clear)
                .filter_map(|at| {
                    measure_noise_block([&observation.image, background], [*gains, [1.0; 3]], at, Trend::Parabola)
                })
                .collect::<Vec<_>>()
        };
        let blocks: Vec<NoiseBlock> = known.par_iter().flat_map_iter(of).collect();
        // The block measures a difference as half of its variance: that is the mean noise of both pictures, and half of
        // the speckle.
        let excess = |channel: usize| {
            let shot = shot_noise_levels[channel] * shot_noise_levels[channel];
            let of = |block: &NoiseBlock| block.variance[channel] - shot * block.level[channel] / 255.0;
            median(blocks.iter().map(of).collect())
        };
        (blocks.len() >= MIN_BLOCKS).then(|| [0, 1, 2].map(|channel| excess(channel).unwrap_or_default()))
    };
    let (within, away) = (roughness(&is_within_disc)?, roughness(&is_far_from_disc)?);
    Some(std::array::from_fn(|channel| (2.0 * (within[channel] - away[channel]).max(0.0) / MEDIAN_OVER_MEAN).sqrt()))
}

fn is_far_from_disc(observation: &Observation, x: usize, y: usize) -> bool {
    distance_from_centre(observation, x, y) > REACH
}

fn is_within_disc(observation: &Observation, x: usize, y: usize) -> bool {
    distance_from_centre(observation, x, y) < SMOOTH_RADIUS
}

/// Distance from the centre of the disc, in its radii.
fn distance_from_centre(observation: &Observation, x: usize, y: usize) -> f64 {
    let [cx, cy] = observation.circle.centre_px;
    libm::hypot(x as f64 - cx, y as f64 - cy) / observation.circle.radius_px
}

fn is_usable(level: u8) -> bool {
    (USABLE_LEVELS[0]..=USABLE_LEVELS[1]).contains(&level)
}

/// Measures by what factor each channel of an image is brighter than the background, away from its disc. `None` if too
/// little is.
fn measure_brightness(observation: &Observation, background: &RgbImage) -> Option<[f64; 3]> {
    let mut sums = [[0.0; 2]; 3];
    let mut far = 0_u64;
    for (x, y, rest) in background.enumerate_pixels() {
        if !is_far_from_disc(observation, x as usize, y as usize) {
            continue;
        }
        far += 1;
        for (channel, sums) in sums.iter_mut().enumerate() {
            let (level, rest) = (observation.image.get_pixel(x, y).0[channel], rest.0[channel]);
            if is_usable(level) && is_usable(rest) {
                let (level, rest) = (f64::from(level), f64::from(rest));
                *sums = [sums[0] + level * rest, sums[1] + rest * rest];
            }
        }
    }
    let all = f64::from(background.width()) * f64::from(background.height());
    let known = far as f64 >= MIN_FAR * all && sums.iter().all(|[product, square]| *product > 0.0 && *square > 0.0);
    known.then(|| sums.map(|[product, square]| product / square))
}

/// Noise of one of two images in a block, per channel.
struct NoiseBlock {
    level: [f64; 3],
    variance: [f64; 3],
    correlation: [[f64; 2]; 3],
}

/// Measures the noise of the blocks that are away from both discs and neither black nor white.
fn collect_noise_blocks(
    (first, first_gains): (&Observation, [f64; 3]),
    (second, second_gains): (&Observation, [f64; 3]),
) -> Vec<NoiseBlock> {
    find_clear_blocks(&first.image, |x, y| is_far_from_disc(first, x, y) && is_far_from_disc(second, x, y))
        .filter_map(|at| {
            measure_noise_block([&first.image, &second.image], [first_gains, second_gains], at, Trend::Mean)
        })
        .collect()
}

/// Returns the blocks whose four corners are all clear.
fn find_clear_blocks(image: &RgbImage, is_clear: impl Fn(usize, usize) -> bool) -> impl Iterator<Item = [usize; 2]> {
    let starts = |size: u32| (0..(size as usize).saturating_sub(BLOCK_PX)).step_by(BLOCK_PX);
    let (columns, rows) = (starts(image.width()), starts(image.height()));
    rows.flat_map(move |y| columns.clone().map(move |x| [x, y])).filter(move |[x, y]| {
        let (right, low) = (x + BLOCK_PX, y + BLOCK_PX);
        [(*x, *y), (right, *y), (*x, low), (right, low)].into_iter().all(|(x, y)| is_clear(x, y))
    })
}

/// Trend of a block's difference that is not noise, to be removed.
#[derive(Clone, Copy, PartialEq)]
enum Trend {
    /// A constant.
    Mean,
    /// A polynomial of second degree.
    Parabola,
}

impl Trend {
    /// Removes the trend. Returns the number of degrees of freedom that remain.
    fn remove_from(self, values: &mut [[f64; BLOCK_PX]; BLOCK_PX]) -> f64 {
        // Polynomials that are orthogonal on the columns, or rows, of the block: each can be removed by itself.
        let place = |k: usize| k as f64 - 0.5 * (BLOCK_PX as f64 - 1.0);
        let square = (BLOCK_PX * BLOCK_PX - 1) as f64 / 12.0;
        let power = |degree: u8, k: usize| match degree {
            0 => 1.0,
            1 => place(k),
            _ => place(k) * place(k) - square,
        };
        let degrees: &[[u8; 2]] = match self {
            Self::Mean => &[[0, 0]],
            Self::Parabola => &[[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [0, 2]],
        };
        for [across, down] in degrees {
            let term = |x: usize, y: usize| power(*across, x) * power(*down, y);
            let places = || (0..BLOCK_PX).flat_map(|y| (0..BLOCK_PX).map(move |x| (x, y)));
            let size: f64 = places().map(|(x, y)| term(x, y) * term(x, y)).sum();
            let share = places().map(|(x, y)| values[y][x] * term(x, y)).sum::<f64>() / size;
            places().for_each(|(x, y)| values[y][x] -= share * term(x, y));
        }
        (BLOCK_PX * BLOCK_PX - degrees.len()) as f64
    }
}

/// Measures the noise of a block. `None` if a pixel is black or white.
fn measure_noise_block(
    images: [&RgbImage; 2],
    gains: [[f64; 3]; 2],
    [x0, y0]: [usize; 2],
    trend: Trend,
) -> Option<NoiseBlock> {
    const COUNT: f64 = (BLOCK_PX * BLOCK_PX) as f64;
    let mut block = NoiseBlock { level: [0.0; 3], variance: [0.0; 3], correlation: [[0.0; 2]; 3] };
    for (channel, (first, second)) in gains[0].into_iter().zip(gains[1]).enumerate() {
        let (mut difference, mut level) = ([[0.0; BLOCK_PX]; BLOCK_PX], 0.0);
        for (down, row) in difference.iter_mut().enumerate() {
            for (across, difference) in row.iter_mut().enumerate() {
                let at = |image: &RgbImage| image.get_pixel((x0 + across) as u32, (y0 + down) as u32).0[channel];
                let levels = images.map(at);
                if !levels.into_iter().all(is_usable) {
                    return None;
                }
                let [a, b] = levels.map(f64::from);
                *difference = a / first - b / second;
                level += 0.5 * (a + b) / COUNT;
            }
        }
        let free = trend.remove_from(&mut difference);
        let square = difference.as_flattened().iter().map(|value| value * value).sum::<f64>();
        let products = |dx: usize, dy: usize| -> f64 {
            let places = (0..BLOCK_PX - dy).flat_map(|y| (0..BLOCK_PX - dx).map(move |x| (x, y)));
            let count = ((BLOCK_PX - dy) * (BLOCK_PX - dx)) as f64;
            places.map(|(x, y)| difference[y][x] * difference[y + dy][x + dx]).sum::<f64>() / count
        };
        block.level[channel] = level;
        // Half, because the difference has the noise of two images; without what rounding adds.
        block.variance[channel] = 0.5 * square / free - ROUNDING;
        // Removing the mean lowers the correlation by 1 / COUNT: add that back.
        let relative = |product: f64| if square > 0.0 { product * COUNT / square + 1.0 / COUNT } else { 0.0 };
        block.correlation[channel] = [relative(products(1, 0)), relative(products(0, 1))];
    }
    Some(block)
}

/// Fits read and shot noise of a channel, grey levels: a line through the medians of the variances at each level.
fn fit_noise(blocks: &[NoiseBlock], channel: usize) -> Option<[f64; 2]> {
    let mut bins: [Vec<(f64, f64)>; BINS] = Default::default();
    for block in blocks {
        let (level, variance) = (block.level[channel], block.variance[channel]);
        bins[((level / 256.0 * BINS as f64) as usize).min(BINS - 1)].push((level / 255.0, variance));
    }
    // Sums of 1, x, x^2, y and x y, in which each block has the same weight.
    let mut sums = [0.0; 5];
    for bin in bins.iter().filter(|bin| bin.len() >= MIN_BLOCKS) {
        let count = bin.len() as f64;
        let x = bin.iter().map(|(level, _)| level).sum::<f64>() / count;
        let middle = median(bin.iter().map(|(_, variance)| *variance).collect())?;
        let y = (middle + ROUNDING) / MEDIAN_OVER_MEAN - ROUNDING;
        for (sum, term) in sums.iter_mut().zip([1.0, x, x * x, y, x * y]) {
            *sum += count * term;
        }
    }
    let [count, x, xx, y, xy] = sums;
    if count == 0.0 {
        return None;
    }
    let spread = xx - x * x / count;
    let slope = if spread > 1e-6 * count { (xy - x * y / count) / spread } else { 0.0 };
    let start = (y - slope * x) / count;
    // Neither can be negative: if one would be, the other is fitted alone.
    let [read, shot] = match (start >= 0.0, slope >= 0.0) {
        (true, true) => [start, slope],
        (false, _) => [0.0, xy / xx],
        (true, false) => [y / count, 0.0],
    };
    Some([read, shot].map(|variance| variance.max(0.0).sqrt()))
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Standard deviation of normal values with some outliers: the median absolute deviation, scaled.
fn robust_deviation(values: Vec<f64>) -> f64 {
    let Some(middle) = median(values.clone()) else { return 0.0 };
    1.4826 * median(values.iter().map(|value| (value - middle).abs()).collect()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::presses::Circle;
    use gelsim_core::base::rng::random_stream;
    use gelsim_core::base::view::View;
    use gelsim_files::sensor::Sensor;

    /// Images of a pad with a bright and a dark side, grain and a spot under the disc.
    fn session(read: f64, shot: f64, drift: f64, disc_px: f64, speckle: f64) -> Session {
        let pad =
            |x: u32, y: u32| [30 + x, 200 - x, 60 + y].map(|level| f64::from(level) + f64::from((7 * x + 3 * y) % 5));
        let circle = Circle { centre_px: [80.0, 60.0], radius_px: disc_px };
        let picture = |k: u64, gain: f64| {
            let mut random = random_stream(k, "camera", 0);
            RgbImage::from_fn(160, 120, |x, y| {
                Rgb(pad(x, y).map(|level| {
                    let light = gain * level;
                    let noise = (read * read + shot * shot * light / 255.0).sqrt() * random.standard_normal();
                    (light + noise).round().clamp(0.0, 255.0) as u8
                }))
            })
        };
        let observation = |k: u64| {
            let gain = 1.0 + drift * (k as f64 - 4.0) / 4.0;
            let mut image = picture(k, gain);
            (0..20).for_each(|at| image.put_pixel(70 + at, 60, Rgb([255; 3])));
            let mut random = random_stream(k, "speckle", 0);
            for (x, y, pixel) in image.enumerate_pixels_mut() {
                // A disc that is lit from the left, as far as a parabola goes.
                let [right, down] = [(f64::from(x) - 80.0) / disc_px, (f64::from(y) - 60.0) / disc_px];
                if speckle > 0.0 && right * right + down * down < 1.0 {
                    let light = 20.0 * right - 15.0 * down * down;
                    *pixel = Rgb(pixel.0.map(|level| {
                        (f64::from(level) + light + speckle * random.standard_normal()).round().clamp(0.0, 255.0) as u8
                    }));
                }
            }
            Observation::new(format!("{k}"), image, circle, 4.0)
        };
        Session {
            sensor: Sensor::default(),
            camera: View { resolution_px: [160, 120], mm_per_px: [0.1; 2] },
            background: picture(99, 1.0),
            observations: (0..9).map(observation).collect(),
            printed: None,
        }
    }

    #[test]
    fn noise_and_drift_that_were_put_in_are_found() {
        let found =
            measure_camera(&session(1.2, 3.0, 0.04, 6.0, 0.0)).expect("most of the image is away from the disc");
        let close = |found: f64, truth: f64, by: f64| assert!((found - truth).abs() < by, "{found} for {truth}");
        for channel in 0..3 {
            close(found.read_noise_levels[channel], 1.2, 0.3);
            close(found.shot_noise_levels[channel], 3.0, 0.3);
            // Steps of a hundredth from -0.04 to 0.04: half of them within 0.02.
            close(found.drift[channel], 1.4826 * 0.02, 0.003);
        }
        found.correlation.into_iter().for_each(|correlation| close(correlation, 0.0, 0.03));
        close(found.gains[1], 0.0, 0.002);
        let camera =
            found.to_distribution(CameraDistribution { vignette: Quantity::Constant(0.25), ..Default::default() });
        assert_eq!((camera.vignette, camera.red_gain), (Quantity::Constant(0.25), Quantity::Constant(1.0)));
        assert!(matches!(camera.exposure, Quantity::Random(Distribution::Normal(_))), "{:?}", camera.exposure);
        camera.noise_color.into_iter().for_each(|factor| close(factor, 1.0, 0.1));
    }

    #[test]
    fn speckle_that_was_put_into_discs_is_found_and_none_where_there_is_none() {
        let found =
            |speckle: f64| measure_camera(&session(1.2, 3.0, 0.02, 20.0, speckle)).expect("far pixels").speckle_levels;
        let close = |found: Option<[f64; 3]>, truth: f64, by: f64| {
            let found = found.expect("blocks within the discs");
            assert!(found.iter().all(|levels| (levels - truth).abs() < by), "{found:?} for {truth}");
        };
        close(found(2.0), 2.0, 0.3);
        // The line of white pixels and chance leave a little.
        close(found(0.0), 0.0, 0.8);
        let small = measure_camera(&session(1.2, 3.0, 0.02, 6.0, 2.0)).expect("far pixels");
        assert_eq!(small.speckle_levels, None);
        let rest = CameraDistribution { speckle_levels: Quantity::Constant(0.7), ..Default::default() };
        assert_eq!(small.to_distribution(rest).speckle_levels, Quantity::Constant(0.7));
    }

    #[test]
    fn a_camera_without_noise_has_none_and_one_that_shows_discs_alone_is_not_measured() {
        let quiet = measure_camera(&session(0.0, 0.0, 0.0, 6.0, 0.0)).expect("most of the image is away from the disc");
        assert!(
            quiet.read_noise_levels.iter().chain(&quiet.shot_noise_levels).all(|levels| *levels < 0.05),
            "{quiet:?}"
        );
        assert_eq!(quiet.to_distribution(CameraDistribution::default()).exposure, Quantity::Constant(1.0));
        assert_eq!(measure_camera(&session(1.0, 1.0, 0.0, 40.0, 0.0)), None);
    }
}
