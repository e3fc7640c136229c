//! Runs a kernel with the widest vectors that the processor has; all widths give the same bits.

#[cfg(target_arch = "x86_64")]
use std::any::Any;
use std::cell::Cell;

use pulp::{Arch, Simd, WithSimd};

/// A vector width that a kernel may be compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorWidth {
    /// The vectors that every processor of this architecture has.
    Plain,
    /// AVX2: eight numbers.
    Eight,
    /// AVX-512: sixteen numbers in plain loops and in Fourier transforms. Other kernels that name their vectors still use
    /// eight, with twice as many registers.
    Sixteen,
}

impl VectorWidth {
    /// All widths, the narrowest first.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Eight, Self::Sixteen];
}

thread_local! {
    static MOST: Cell<VectorWidth> = const { Cell::new(VectorWidth::Sixteen) };
}

/// Runs `work` on this thread as on a processor without wider vectors. The result must not differ in a bit.
pub fn with_width_limit<T>(vectors: VectorWidth, work: impl FnOnce() -> T) -> T {
    let before = MOST.replace(vectors);
    let result = work();
    MOST.set(before);
    result
}

/// Runs `work` as on a processor without wide vectors.
pub fn scalar_only<T>(work: impl FnOnce() -> T) -> T {
    with_width_limit(VectorWidth::Plain, work)
}

/// Runs `kernel` and returns its result. The kernel is compiled for every x86-64, for those with AVX2 and for those
/// with AVX-512; the version is chosen when the program runs.
///
/// The compiler vectorises plain loops; on its own, it neither reorders sums nor fuses multiplications into additions,
/// so all versions give the same bits. The closure and all functions it calls must be `#[inline(always)]`; otherwise
/// they stay compiled for every x86-64. The closure should return what it counts or compares: a variable of the caller
/// would lie in memory, and the loop would process one number at a time. For the same reason the closure is `move`
/// where its loop reads numbers of the caller.
#[inline(always)]
pub fn simd_dispatch<R>(kernel: impl FnOnce() -> R) -> R {
    dispatch_kernel(ClosureKernel(kernel))
}

/// Runs a kernel that names its vectors itself, for loops that the compiler does not vectorise. It gets vectors of
/// eight numbers or of one; the result must not depend on which.
#[inline(always)]
pub fn dispatch_kernel<K: WithSimd>(kernel: K) -> K::Output {
    let most = MOST.get();
    #[cfg(target_arch = "x86_64")]
    {
        use pulp::x86::{V3, V4};
        let eight = if most == VectorWidth::Plain { None } else { V3::try_new() };
        let sixteen = if most == VectorWidth::Sixteen { V4::try_new() } else { None };
        match (eight, sixteen) {
            (Some(eight), Some(sixteen)) => Simd::vectorize(sixteen, EightLaneKernel { kernel, eight }),
            (Some(eight), None) => Simd::vectorize(eight, kernel),
            (None, _) => run_plain(kernel),
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    if most == VectorWidth::Plain { run_plain(kernel) } else { Arch::new().dispatch(kernel) }
}

/// A kernel that names its vectors: those of at most eight numbers, and the widest.
pub trait TwoWidthKernel {
    /// Its result.
    type Output;

    /// Runs the kernel. The result must not depend on the vectors.
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) -> Self::Output;
}

/// Vectors of two widths, or twice the same.
#[derive(Clone, Copy)]
pub struct Vectors<S, W> {
    /// Vectors of at most eight numbers.
    pub eight: S,
    /// The widest vectors.
    pub widest: W,
}

/// Runs a kernel that uses vectors of sixteen numbers in parts, where the processor has them.
#[inline(always)]
pub fn dispatch_two_widths<K: TwoWidthKernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if MOST.get() == VectorWidth::Sixteen
        && let Some(widest) = pulp::x86::V4::try_new()
    {
        return Simd::vectorize(widest, SixteenLaneKernel { kernel, widest });
    }
    dispatch_kernel(OneWidthKernel(kernel))
}

/// A kernel for two widths on a processor that has one.
struct OneWidthKernel<K>(K);

impl<K: TwoWidthKernel> WithSimd for OneWidthKernel<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> K::Output {
        self.0.run(Vectors { eight: simd, widest: simd })
    }
}

/// A kernel for two widths on a processor with AVX-512.
#[cfg(target_arch = "x86_64")]
struct SixteenLaneKernel<K> {
    kernel: K,
    widest: pulp::x86::V4,
}

#[cfg(target_arch = "x86_64")]
impl<K: TwoWidthKernel> WithSimd for SixteenLaneKernel<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> K::Output {
        self.kernel.run(Vectors { eight: *self.widest, widest: self.widest })
    }
}

/// Runs a part that many kernels share, with their vectors. It is a function of its own: within the kernels, it would be
/// compiled once for each call.
#[inline(always)]
pub fn call_kernel<S: Simd, K: WithSimd>(simd: S, kernel: K) -> K::Output {
    if S::IS_SCALAR { run_plain(kernel) } else { simd.vectorize(kernel) }
}

/// Runs a kernel without wide vectors. It is a function of its own since it is rarely called: within its callers it is
/// a fifth of what there is to compile.
#[inline(never)]
fn run_plain<K: WithSimd>(kernel: K) -> K::Output {
    Arch::Scalar.dispatch(kernel)
}

/// A closure as a kernel. pulp accepts closures too, but calls them through a shim that the compiler does not inline.
struct ClosureKernel<F>(F);

impl<R, F: FnOnce() -> R> WithSimd for ClosureKernel<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> R {
        (self.0)()
    }
}

/// A kernel that names its vectors and expects eight numbers, with the AVX2 vectors inside code compiled for AVX-512.
#[cfg(target_arch = "x86_64")]
struct EightLaneKernel<K> {
    kernel: K,
    eight: pulp::x86::V3,
}

#[cfg(target_arch = "x86_64")]
impl<K: WithSimd> WithSimd for EightLaneKernel<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> K::Output {
        self.kernel.with_simd(self.eight)
    }
}

/// Transposes a matrix of 8 rows and columns.
#[inline(always)]
pub fn transpose_8x8<S: Simd>(simd: S, rows: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    // The branch is decided at compile time. The compiler's code for the plain loops takes twice as long.
    #[cfg(target_arch = "x86_64")]
    if let Some(wide) = (&simd as &dyn Any).downcast_ref() {
        return transpose_8x8_avx(*wide, rows);
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = simd;
    let mut columns = [[0.0; 8]; 8];
    for (k, row) in rows.iter().enumerate() {
        for (column, value) in columns.iter_mut().zip(row) {
            column[k] = *value;
        }
    }
    columns
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn transpose_8x8_avx(pulp::x86::V3 { avx, .. }: pulp::x86::V3, rows: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    // First transpose 4 x 4 blocks: numbers 0 to 3 go to the lower half of a vector, 4 to 7 to the upper half.
    let mut halves = [avx._mm256_setzero_ps(); 8];
    for (half, four) in halves.as_chunks_mut::<4>().0.iter_mut().zip(rows.as_chunks::<4>().0) {
        let [a, b, c, d] = [pulp::cast(four[0]), pulp::cast(four[1]), pulp::cast(four[2]), pulp::cast(four[3])];
        let [ab, cd] = [avx._mm256_unpacklo_ps(a, b), avx._mm256_unpacklo_ps(c, d)];
        let [ab_next, cd_next] = [avx._mm256_unpackhi_ps(a, b), avx._mm256_unpackhi_ps(c, d)];
        half[0] = avx._mm256_shuffle_ps::<0b01_00_01_00>(ab, cd);
        half[1] = avx._mm256_shuffle_ps::<0b11_10_11_10>(ab, cd);
        half[2] = avx._mm256_shuffle_ps::<0b01_00_01_00>(ab_next, cd_next);
        half[3] = avx._mm256_shuffle_ps::<0b11_10_11_10>(ab_next, cd_next);
    }
    let mut columns = [[0.0; 8]; 8];
    for k in 0..4 {
        columns[k] = pulp::cast(avx._mm256_permute2f128_ps::<0x20>(halves[k], halves[k + 4]));
        columns[k + 4] = pulp::cast(avx._mm256_permute2f128_ps::<0x31>(halves[k], halves[k + 4]));
    }
    columns
}

/// Splits a number from 0 to 2^22 into its whole part and the rest, from 0 to below 1.
#[inline(always)]
pub fn split_fraction(number: f32) -> (u32, f32) {
    // From 2^23 on, consecutive floats are whole numbers. A cast has to handle more cases; this runs on eight at a
    // time.
    const WHOLE: f32 = 8_388_608.0;
    let nearest = (number + WHOLE) - WHOLE;
    let below = if nearest > number { nearest - 1.0 } else { nearest };
    ((below + WHOLE).to_bits() - WHOLE.to_bits(), number - below)
}

/// Sums values in eight partial sums, so that the result is the same on every processor.
#[inline(always)]
pub fn sum_values(values: &[f32]) -> f64 {
    let mut sums = [0.0_f64; 8];
    let (eights, rest) = values.as_chunks::<8>();
    for eight in eights {
        for k in 0..8 {
            sums[k] += f64::from(eight[k]);
        }
    }
    sums.iter_mut().zip(rest).for_each(|(sum, value)| *sum += f64::from(*value));
    sums.iter().sum()
}

/// Computes the scalar product of some thousand numbers in eight partial sums of 32 bits, so that the result is the same
/// on every processor. Longer ones are summed from parts: a single sum would lose small numbers.
#[inline(always)]
pub fn dot_in_eights(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f32; 8];
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *sum += a * b;
    }
    sums.iter().map(|sum| f64::from(*sum)).sum()
}

/// Counts how many of the values (fewer than 2^32) are true.
#[inline(always)]
pub fn count_true(values: impl Iterator<Item = bool>) -> u32 {
    values.map(u32::from).sum()
}

/// Returns the larger of two numbers. `f32::max` takes five instructions more to know of NaN, which must not occur here.
#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the smaller of two numbers, neither of them NaN.
#[inline(always)]
pub fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the largest of the values, 0 if none is above 0.
#[inline(always)]
pub fn largest_value(values: impl Iterator<Item = f32>) -> f32 {
    // Non-negative floats are ordered like their bits, and whole numbers are compared eight at a time.
    f32::from_bits(values.fold(0, |most, value| value.max(0.0).to_bits().max(most)))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Transpose([[f32; 8]; 8]);

    impl WithSimd for Transpose {
        type Output = [[f32; 8]; 8];

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            transpose_8x8(simd, &self.0)
        }
    }

    #[test]
    fn columns_become_rows_whatever_the_vectors() {
        let rows: [[f32; 8]; 8] = std::array::from_fn(|y| std::array::from_fn(|x| (8 * y + x) as f32));
        for columns in VectorWidth::ALL.map(|vectors| with_width_limit(vectors, || dispatch_kernel(Transpose(rows)))) {
            for (x, column) in columns.iter().enumerate() {
                assert_eq!(*column, std::array::from_fn(|y| rows[y][x]));
            }
        }
    }
}
