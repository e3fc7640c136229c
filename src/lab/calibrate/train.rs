//! Fits a [`CalibrationResponse`] to pixels: several small networks from different starts, whose mean is one larger
//! network.
//!
//! The method is stochastic gradient descent (Adam, Kingma and Ba 2015, with decoupled weight decay, Loshchilov and
//! Hutter 2019, and a rate that falls along a cosine). The loss is pseudo-Huber, which forgives specks of dust. The
//! same pixels give the same numbers on the same machine, whatever the number of threads.

use nalgebra::DMatrix;

use super::pixels::PixelSamples;
use super::progress::ProgressMeter;
use gelsim_core::base::rng::{RandomStream, random_stream};
use gelsim_core::optics::calibrated::extrapolation::CalibrationRange;
use gelsim_core::optics::calibrated::response::{
    CalibrationResponse, INPUTS, OUTPUTS, TERMS, activation, activation_slope, normal_terms,
};

/// Unit of the outputs while training, as a fraction of full scale. It suits the training rate.
const OUTPUT_UNIT: f32 = 0.4;
/// Error from which the loss grows in proportion, as a fraction of full scale.
const HUBER_DELTA: f32 = 4.0 / 255.0;

/// Settings of the training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingSettings {
    /// Number of networks whose mean is taken.
    pub networks: usize,
    /// Number of hidden units of each network.
    pub units: usize,
    /// Number of training steps of each network.
    pub steps: usize,
    /// Number of pixels per step.
    pub batch: usize,
    /// Training rate at the start.
    pub rate: f32,
    /// Weight decay: fraction of the weights lost per step and unit of the rate.
    pub decay: f32,
}

impl Default for TrainingSettings {
    fn default() -> Self {
        Self { networks: 3, units: 12, steps: 1500, batch: 2048, rate: 1e-2, decay: 0.1 }
    }
}

/// Units of inputs.
#[derive(Clone, Copy, Debug)]
struct InputScales {
    height_mm: f32,
    place_mm: f32,
}

/// Fits a model that holds within `range`. `seed` decides where its networks start. `place_mm` is half the longer side
/// of the view.
pub fn fit_networks(
    pixels: &PixelSamples,
    range: CalibrationRange,
    place_mm: f64,
    settings: &TrainingSettings,
    seed: u64,
    work: &ProgressMeter,
) -> CalibrationResponse {
    let deepest_mm = pixels.inputs.iter().map(|input| input[0]).fold(0.0, f32::max);
    // The depth is used as a divisor: presses without depth must not make it 0.
    let scales = InputScales { height_mm: deepest_mm.max(1e-3), place_mm: place_mm as f32 };
    let networks =
        (0..settings.networks as u64).map(|k| Network::train_network(pixels, &scales, settings, 64 * seed + k, work));
    let networks: Vec<Network> = networks.collect();
    let weight = OUTPUT_UNIT / networks.len().max(1) as f32;
    let hidden: Vec<[f32; INPUTS + 1]> = networks.iter().flat_map(Network::hidden_units).collect();
    let output = |k: usize| {
        let from_hidden = networks.iter().flat_map(|n| (0..settings.units).map(move |j| weight * n.outer[(k, j)]));
        let sum = |i: usize| networks.iter().map(|n| weight * n.outer[(k, settings.units + i)]).sum::<f32>();
        from_hidden.chain((0..=INPUTS).map(sum)).collect()
    };
    let outputs = (0..OUTPUTS).map(output).collect();
    let (InputScales { height_mm, place_mm }, CalibrationRange { steepest, heights_mm }) = (scales, range);
    CalibrationResponse { height_mm, place_mm, heights_mm, steepest, hidden, outputs }
}

/// Computes the mean absolute error of a model on pixels, as a fraction of full scale; 0 without pixels.
pub fn mean_absolute_error(response: &CalibrationResponse, pixels: &PixelSamples) -> f64 {
    let of = |k: usize| -> f64 {
        let [w, x, y, sky @ ..] = pixels.inputs[k].map(f64::from);
        let found = response.change(pixels.normals[k].map(f64::from), w, [x, y], sky);
        found.iter().zip(pixels.change[k]).map(|(found, change)| (found - f64::from(change)).abs()).sum()
    };
    (0..pixels.len()).map(of).sum::<f64>() / (3 * pixels.len().max(1)) as f64
}

/// One network. `inner` has a row of weights and a bias for each hidden unit. `outer` has a row for each output: the
/// weights of the hidden units, those of the inputs, and a bias.
struct Network {
    inner: DMatrix<f32>,
    outer: DMatrix<f32>,
}

/// Pixels of one training step, one in each column.
struct Batch {
    /// Inputs, followed by a 1 for the bias.
    inputs: DMatrix<f32>,
    /// Inputs at these places on an untouched pad, followed by a 1.
    at_rest: DMatrix<f32>,
    terms: DMatrix<f32>,
    change: DMatrix<f32>,
    clipped: DMatrix<f32>,
}

impl Batch {
    fn new(size: usize) -> Self {
        let zeros = |rows| DMatrix::zeros(rows, size);
        let [inputs, at_rest] = [zeros(INPUTS + 1), zeros(INPUTS + 1)];
        Self { inputs, at_rest, terms: zeros(TERMS), change: zeros(3), clipped: zeros(3) }
    }

    fn draw(&mut self, pixels: &PixelSamples, scales: &InputScales, random: &mut RandomStream) {
        for column in 0..self.inputs.ncols() {
            let k = random.uniform_below(pixels.len());
            let [w, x, y, sky @ ..] = pixels.inputs[k];
            let place = [x / scales.place_mm, y / scales.place_mm];
            let mut inputs = self.inputs.column_mut(column);
            (inputs[0], inputs[1], inputs[2], inputs[INPUTS]) = (w / scales.height_mm, place[0], place[1], 1.0);
            for (input, hidden) in inputs.iter_mut().skip(3).zip(sky) {
                *input = hidden;
            }
            let mut at_rest = self.at_rest.column_mut(column);
            (at_rest[1], at_rest[2], at_rest[INPUTS]) = (place[0], place[1], 1.0);
            let [nx, ny] = pixels.normals[k];
            self.terms.column_mut(column).copy_from_slice(&normal_terms(nx, ny));
            self.change.column_mut(column).copy_from_slice(&pixels.change[k]);
            self.clipped.column_mut(column).copy_from_slice(&pixels.clipped[k]);
        }
    }
}

/// Values of a forward pass, and the slopes of the activation there.
struct ForwardPass {
    /// Hidden units, then inputs and a 1.
    all: DMatrix<f32>,
    slopes: DMatrix<f32>,
}

impl Network {
    fn train_network(
        pixels: &PixelSamples,
        scales: &InputScales,
        settings: &TrainingSettings,
        seed: u64,
        work: &ProgressMeter,
    ) -> Self {
        /// Number of steps after which progress is reported.
        const SAID: usize = 25;
        let mut random = random_stream(seed, "calibration", 0);
        let mut network = Self::with_random_weights(settings.units, &mut random);
        if pixels.is_empty() {
            // Without pixels there is nothing to learn: the model says that nothing changes.
            network.outer.fill(0.0);
            return network;
        }
        let mut batch = Batch::new(settings.batch);
        let mut inner = Adam::new(network.inner.len());
        let mut outer = Adam::new(network.outer.len());
        for step in 0..settings.steps {
            batch.draw(pixels, scales, &mut random);
            let [inner_slope, outer_slope] = network.gradient(&batch);
            let cosine = 0.5 * (1.0 + libm::cosf(std::f32::consts::PI * step as f32 / settings.steps as f32));
            // The rate rises over the first 50 steps, while Adam knows little of the slopes.
            let rate = settings.rate * cosine * ((step + 1) as f32 / 50.0).min(1.0);
            inner.step(network.inner.as_mut_slice(), inner_slope.as_slice(), rate, settings.decay);
            outer.step(network.outer.as_mut_slice(), outer_slope.as_slice(), rate, settings.decay);
            if (step + 1) % SAID == 0 {
                work.advance(SAID as u64, "fitting the light");
            }
        }
        network
    }

    /// Makes a network with random weights of the hidden units, small ones of the outputs, and none from inputs
    /// straight to outputs.
    fn with_random_weights(units: usize, random: &mut RandomStream) -> Self {
        let mut draw = |count: usize| (random.standard_normal() / libm::sqrt(count.max(1) as f64)) as f32;
        let inner = DMatrix::from_fn(units, INPUTS + 1, |_, k| if k < INPUTS { draw(INPUTS) } else { 0.0 });
        let outer =
            DMatrix::from_fn(OUTPUTS, units + INPUTS + 1, |_, j| if j < units { 0.1 * draw(units) } else { 0.0 });
        Self { inner, outer }
    }

    fn hidden_units(&self) -> impl Iterator<Item = [f32; INPUTS + 1]> {
        self.inner.row_iter().map(|row| std::array::from_fn(|k| row[k]))
    }

    fn forward(&self, inputs: &DMatrix<f32>) -> ForwardPass {
        let units = self.inner.nrows();
        let mut slopes = &self.inner * inputs;
        let mut all = DMatrix::zeros(units + inputs.nrows(), inputs.ncols());
        all.rows_mut(units, inputs.nrows()).copy_from(inputs);
        for (mut column, mut slopes) in all.column_iter_mut().zip(slopes.column_iter_mut()) {
            for (value, slope) in column.iter_mut().zip(slopes.iter_mut()) {
                (*value, *slope) = (activation(*slope), activation_slope(*slope));
            }
        }
        ForwardPass { all, slopes }
    }

    /// Computes the slopes of the loss along `inner` and `outer`.
    fn gradient(&self, batch: &Batch) -> [DMatrix<f32>; 2] {
        let units = self.inner.nrows();
        let (here, rest) = (self.forward(&batch.inputs), self.forward(&batch.at_rest));
        let constants = self.constant_rows();
        let (mut outputs, flat) = (&self.outer * &here.all, &constants * &rest.all);
        let mut errors = DMatrix::zeros(3, outputs.ncols());
        let per_pixel = 1.0 / outputs.ncols() as f32;
        for (column, mut outputs) in outputs.column_iter_mut().enumerate() {
            let terms = batch.terms.column(column);
            for channel in 0..3 {
                let part = channel * TERMS..(channel + 1) * TERMS;
                let sum: f32 = outputs.as_slice()[part.clone()].iter().zip(terms.as_slice()).map(|(c, t)| c * t).sum();
                let error = OUTPUT_UNIT * (sum - flat[(channel, column)]) - batch.change[(channel, column)];
                // A clipped pixel does not say by how much its change is larger, so a guess beyond it is no error.
                let held_out = error * batch.clipped[(channel, column)] > 0.0;
                let relative = error / HUBER_DELTA;
                let slope = if held_out { 0.0 } else { relative / (1.0 + relative * relative).sqrt() };
                let slope = slope * per_pixel;
                // The change at rest is subtracted from the output, hence the sign.
                errors[(channel, column)] = -slope;
                for (output, term) in outputs.as_mut_slice()[part].iter_mut().zip(terms.as_slice()) {
                    *output = slope * term;
                }
            }
        }
        let mut outer_slope = &outputs * here.all.transpose();
        let constant_slope = &errors * rest.all.transpose();
        for channel in 0..3 {
            let mut row = outer_slope.row_mut(channel * TERMS);
            row += constant_slope.row(channel);
        }
        let through = |weights: DMatrix<f32>, slopes: &DMatrix<f32>, forward: &ForwardPass, inputs: &DMatrix<f32>| {
            let back = weights.columns(0, units).transpose() * slopes;
            back.component_mul(&forward.slopes) * inputs.transpose()
        };
        let inner_slope = through(self.outer.clone(), &outputs, &here, &batch.inputs)
            + through(constants, &errors, &rest, &batch.at_rest);
        [inner_slope, outer_slope]
    }

    /// Returns the rows of `outer` for the constant terms: on a flat pad n_x = n_y = 0, and all other terms vanish.
    fn constant_rows(&self) -> DMatrix<f32> {
        DMatrix::from_fn(3, self.outer.ncols(), |channel, j| self.outer[(channel * TERMS, j)])
    }
}

/// Adam's running means of the slopes and of their squares.
struct Adam {
    mean: Vec<f32>,
    square: Vec<f32>,
    steps: i32,
}

impl Adam {
    const DECAY_RATES: [f32; 2] = [0.9, 0.995];

    fn new(count: usize) -> Self {
        Self { mean: vec![0.0; count], square: vec![0.0; count], steps: 0 }
    }

    fn step(&mut self, weights: &mut [f32], slopes: &[f32], rate: f32, decay: f32) {
        self.steps += 1;
        let [kept, kept_square] = Self::DECAY_RATES;
        let [seen, seen_square] = Self::DECAY_RATES.map(|kept| 1.0 - kept.powi(self.steps));
        let memory = self.mean.iter_mut().zip(&mut self.square);
        for ((weight, slope), (mean, square)) in weights.iter_mut().zip(slopes).zip(memory) {
            *mean = kept * *mean + (1.0 - kept) * slope;
            *square = kept_square * *square + (1.0 - kept_square) * slope * slope;
            let way = (*mean / seen) / ((*square / seen_square).sqrt() + 1e-8);
            *weight -= rate * (way + decay * *weight);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_slopes_of_the_loss() {
        let mut random = random_stream(7, "calibration", 1);
        let mut pixels = PixelSamples::default();
        for k in 0..64 {
            let mut unit = || random.uniform() as f32;
            pixels.normals.push([unit() - 0.5, unit() - 0.5]);
            pixels.inputs.push(std::array::from_fn(|_| unit()));
            pixels.change.push([unit() - 0.5, unit() - 0.5, unit()]);
            pixels.clipped.push([0.0, 0.0, f32::from(u8::from(k % 3 == 0))]);
        }
        let scales = InputScales { height_mm: 0.7, place_mm: 1.3 };
        let mut network = Network::with_random_weights(4, &mut random);
        network.outer.iter_mut().for_each(|weight| *weight = 0.3 * random.standard_normal() as f32);
        let mut batch = Batch::new(64);
        batch.draw(&pixels, &scales, &mut random);
        // In f64, so that differences are meaningful.
        let loss = |network: &Network| {
            let squashed = |x: f64| {
                x.clamp(-3.0, 3.0) * (27.0 + x.clamp(-3.0, 3.0).powi(2)) / (27.0 + 9.0 * x.clamp(-3.0, 3.0).powi(2))
            };
            let outputs = |inputs: &DMatrix<f32>, column: usize, k: usize| {
                let input = |i: usize| f64::from(inputs[(i, column)]);
                let hidden =
                    |j: usize| squashed((0..=INPUTS).map(|i| f64::from(network.inner[(j, i)]) * input(i)).sum());
                (0..4).map(|j| f64::from(network.outer[(k, j)]) * hidden(j)).sum::<f64>()
                    + (0..=INPUTS).map(|i| f64::from(network.outer[(k, 4 + i)]) * input(i)).sum::<f64>()
            };
            let mut sum = 0.0;
            for column in 0..64 {
                for channel in 0..3 {
                    let value: f64 = (0..TERMS)
                        .map(|m| {
                            f64::from(batch.terms[(m, column)]) * outputs(&batch.inputs, column, channel * TERMS + m)
                        })
                        .sum();
                    let value = value - outputs(&batch.at_rest, column, channel * TERMS);
                    let error = f64::from(OUTPUT_UNIT) * value - f64::from(batch.change[(channel, column)]);
                    if error * f64::from(batch.clipped[(channel, column)]) <= 0.0 {
                        let relative = error / f64::from(HUBER_DELTA);
                        sum +=
                            (1.0 + relative * relative).sqrt() * f64::from(HUBER_DELTA) / f64::from(OUTPUT_UNIT) / 64.0;
                    }
                }
            }
            sum
        };
        let [inner, outer] = network.gradient(&batch);
        for (row, column) in [(0, 0), (1, 2), (3, 5), (2, INPUTS)] {
            let mut moved = |by: f32| {
                network.inner[(row, column)] += by;
                let loss = loss(&network);
                network.inner[(row, column)] -= by;
                loss
            };
            let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
            let found = f64::from(inner[(row, column)]);
            assert!((slope - found).abs() < 2e-3 + 0.02 * slope.abs(), "inner {row} {column}: {found} {slope}");
        }
        for (row, column) in [(0, 0), (TERMS, 5), (17, 3), (44, 4 + INPUTS), (30, 1)] {
            let mut moved = |by: f32| {
                network.outer[(row, column)] += by;
                let loss = loss(&network);
                network.outer[(row, column)] -= by;
                loss
            };
            let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
            let found = f64::from(outer[(row, column)]);
            assert!((slope - found).abs() < 2e-3 + 0.02 * slope.abs(), "outer {row} {column}: {found} {slope}");
        }
    }
}
