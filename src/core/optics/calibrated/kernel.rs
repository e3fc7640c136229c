//! The network of a [`Response`] on many points at once: eight in each vector, several outputs for each load.

use super::response::{INPUTS, OUTPUTS, Response, squashed};

/// Points in a vector.
const LANES: usize = 8;
/// Outputs that are summed together, so that a hidden unit is loaded once for all of them.
const GROUP: usize = 5;
const GROUPS: usize = OUTPUTS / GROUP;

/// A value at each of eight points.
type Vector = [f32; LANES];

/// Weights in the order in which they are used.
pub struct Kernel {
    hidden: Vec<[f32; INPUTS + 1]>,
    /// For each group, the weights of every hidden unit and of every input.
    weights: Vec<[f32; GROUP]>,
    /// For each group.
    biases: [[f32; GROUP]; GROUPS],
}

impl Kernel {
    /// From a valid response.
    pub fn new(response: &Response) -> Self {
        let inner = response.hidden.len() + INPUTS;
        let weight = |k: usize, j: usize| response.outputs[k][j];
        let group = |group: usize, j: usize| std::array::from_fn(|g| weight(GROUP * group + g, j));
        Self {
            hidden: response.hidden.clone(),
            weights: (0..GROUPS).flat_map(|g| (0..inner).map(move |j| group(g, j))).collect(),
            biases: std::array::from_fn(|g| group(g, inner)),
        }
    }

    /// The outputs at points, one plane per output, from planes of inputs of one length.
    #[inline(always)]
    pub fn run(&self, inputs: &[Vec<f32>; INPUTS], outputs: &mut [Vec<f32>]) {
        let count = inputs[0].len();
        for output in outputs.iter_mut() {
            output.resize(count, 0.0);
        }
        let units = self.hidden.len();
        let mut known = vec![[0.0; LANES]; units + INPUTS];
        for start in (0..count).step_by(LANES) {
            let end = (start + LANES).min(count);
            let (hidden, given) = known.split_at_mut(units);
            for (vector, plane) in given.iter_mut().zip(inputs) {
                vector[..end - start].copy_from_slice(&plane[start..end]);
            }
            for (unit, weights) in hidden.iter_mut().zip(&self.hidden) {
                let mut sum = [weights[INPUTS]; LANES];
                for (input, weight) in given.iter().zip(weights) {
                    add_scaled(&mut sum, input, *weight);
                }
                for lane in 0..LANES {
                    unit[lane] = squashed(sum[lane]);
                }
            }
            for (group, biases) in self.biases.iter().enumerate() {
                let mut sums: [Vector; GROUP] = std::array::from_fn(|g| [biases[g]; LANES]);
                let weights = &self.weights[group * known.len()..][..known.len()];
                for (vector, weights) in known.iter().zip(weights) {
                    for (sum, weight) in sums.iter_mut().zip(weights) {
                        add_scaled(sum, vector, *weight);
                    }
                }
                for (sum, output) in sums.iter().zip(&mut outputs[GROUP * group..]) {
                    output[start..end].copy_from_slice(&sum[..end - start]);
                }
            }
        }
    }
}

#[inline(always)]
fn add_scaled(sum: &mut Vector, values: &Vector, by: f32) {
    for lane in 0..LANES {
        sum[lane] += by * values[lane];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::base::rng::stream;

    #[test]
    fn outputs_are_the_network_s_whatever_the_number_of_points() {
        let mut random = stream(3, "calibration", 9);
        let mut draw = || random.normal() as f32;
        let hidden: Vec<[f32; INPUTS + 1]> = (0..7).map(|_| std::array::from_fn(|_| draw())).collect();
        let outputs = (0..OUTPUTS).map(|_| (0..7 + INPUTS + 1).map(|_| draw()).collect()).collect();
        let response = Response { hidden, outputs, ..Response::default() };
        let kernel = Kernel::new(&response);
        for count in [0, 1, 7, 8, 9, 40] {
            let inputs: [Vec<f32>; INPUTS] = std::array::from_fn(|_| (0..count).map(|_| draw()).collect());
            let mut found = vec![vec![f32::NAN; 3]; OUTPUTS];
            kernel.run(&inputs, &mut found);
            for point in 0..count {
                let given: Vec<f64> = inputs.iter().map(|plane| f64::from(plane[point])).collect();
                let expected = response.outputs_at(&given);
                for (k, expected) in expected.iter().enumerate() {
                    assert!((f64::from(found[k][point]) - expected).abs() < 1e-4, "{count} {point} {k}");
                }
            }
            assert!(found.iter().all(|plane| plane.len() == count));
        }
    }
}
