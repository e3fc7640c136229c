//! Evaluates the network of a [`CalibrationResponse`] at many points at once: as many as a vector holds, several
//! outputs for each load.

use pulp::{Simd, WithSimd};

use super::response::{CalibrationResponse, INPUTS, OUTPUTS, activation};
use crate::base::simd::dispatch_kernel;

/// Outputs that are summed together, so that a hidden unit is loaded once for all of them.
const GROUP_SIZE: usize = 5;
const GROUP_COUNT: usize = OUTPUTS / GROUP_SIZE;

/// Weights of a network, in the order in which they are used.
pub struct Kernel {
    /// For each hidden unit, the weights of the inputs, and its bias.
    hidden: Vec<[f32; INPUTS + 1]>,
    /// For each group of outputs, the weights of every hidden unit and of every input.
    weights: Vec<[f32; GROUP_SIZE]>,
    /// Biases of each group.
    biases: [[f32; GROUP_SIZE]; GROUP_COUNT],
}

impl Kernel {
    /// Prepares a valid response.
    pub fn new(response: &CalibrationResponse) -> Self {
        let inner = response.hidden.len() + INPUTS;
        let weight = |k: usize, j: usize| response.outputs[k][j];
        let group = |group: usize, j: usize| std::array::from_fn(|g| weight(GROUP_SIZE * group + g, j));
        Self {
            hidden: response.hidden.clone(),
            weights: (0..GROUP_COUNT).flat_map(|g| (0..inner).map(move |j| group(g, j))).collect(),
            biases: std::array::from_fn(|g| group(g, inner)),
        }
    }

    /// Computes the outputs at points: one plane per output, from planes of inputs that have one length.
    pub fn run(&self, inputs: &[Vec<f32>; INPUTS], outputs: &mut [Vec<f32>]) {
        dispatch_kernel(ForwardPass { kernel: self, inputs, outputs });
    }
}

/// The forward pass in explicit vectors: left to the compiler, the sums of a group became as many single numbers, five
/// times slower.
struct ForwardPass<'a> {
    kernel: &'a Kernel,
    inputs: &'a [Vec<f32>; INPUTS],
    outputs: &'a mut [Vec<f32>],
}

impl WithSimd for ForwardPass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { kernel, inputs, outputs } = self;
        let count = inputs[0].len();
        // Entire vectors are stored; the planes are cut to their length at the end.
        for output in outputs.iter_mut() {
            output.resize(count.next_multiple_of(S::F32_LANES), 0.0);
        }
        // For the points of a vector: the values of the hidden units, then the inputs.
        let units = kernel.hidden.len();
        let mut values = vec![0.0; (units + INPUTS) * S::F32_LANES];
        for start in (0..count).step_by(S::F32_LANES) {
            let end = (start + S::F32_LANES).min(count);
            let (hidden, input_vectors) = values.split_at_mut(units * S::F32_LANES);
            let input_vectors = S::as_mut_simd_f32s(input_vectors).0;
            for (vector, plane) in input_vectors.iter_mut().zip(inputs) {
                *vector = simd.partial_load_f32s(&plane[start..end]);
            }
            for (sum, weights) in S::as_mut_simd_f32s(hidden).0.iter_mut().zip(&kernel.hidden) {
                *sum = simd.splat_f32s(weights[INPUTS]);
                for (input, weight) in input_vectors.iter().zip(weights) {
                    *sum = simd.add_f32s(*sum, simd.mul_f32s(simd.splat_f32s(*weight), *input));
                }
            }
            for unit in hidden {
                *unit = activation(*unit);
            }
            let values = S::as_simd_f32s(&values).0;
            for (group, biases) in kernel.biases.iter().enumerate() {
                let mut sums = biases.map(|bias| simd.splat_f32s(bias));
                let weights = &kernel.weights[group * values.len()..][..values.len()];
                for (vector, weights) in values.iter().zip(weights) {
                    for (sum, weight) in sums.iter_mut().zip(weights) {
                        *sum = simd.add_f32s(*sum, simd.mul_f32s(simd.splat_f32s(*weight), *vector));
                    }
                }
                for (sum, output) in sums.iter().zip(&mut outputs[GROUP_SIZE * group..]) {
                    S::as_mut_simd_f32s(&mut output[start..]).0[0] = *sum;
                }
            }
        }
        for output in outputs {
            output.truncate(count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::random_stream;

    #[test]
    fn outputs_are_the_network_s_whatever_the_number_of_points() {
        let mut random = random_stream(3, "calibration", 9);
        let mut draw = || random.standard_normal() as f32;
        let hidden: Vec<[f32; INPUTS + 1]> = (0..7).map(|_| std::array::from_fn(|_| draw())).collect();
        let outputs = (0..OUTPUTS).map(|_| (0..7 + INPUTS + 1).map(|_| draw()).collect()).collect();
        let response = CalibrationResponse { hidden, outputs, ..CalibrationResponse::default() };
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
