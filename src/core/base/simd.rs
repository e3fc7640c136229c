//! Runs a kernel with the widest vectors that give the same bits everywhere.

use std::any::Any;
use std::cell::Cell;

use pulp::{Arch, Simd, WithSimd};

/// The vectors that a kernel may be compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vectors {
    /// What every processor of the kind has.
    Plain,
    /// AVX2: eight numbers.
    Eight,
    /// AVX-512: sixteen numbers in plain loops; where a kernel names its vectors eight, in twice as many registers.
    Sixteen,
}

impl Vectors {
    /// From the narrowest on.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Eight, Self::Sixteen];
}

thread_local! {
    static MOST: Cell<Vectors> = const { Cell::new(Vectors::Sixteen) };
}

/// Does `work` as on a processor without wider vectors, on this thread: what it gives must not differ in a bit.
pub fn at_most<T>(vectors: Vectors, work: impl FnOnce() -> T) -> T {
    let before = MOST.replace(vectors);
    let result = work();
    MOST.set(before);
    result
}

/// Does `work` as on a processor without wide vectors.
pub fn scalar_only<T>(work: impl FnOnce() -> T) -> T {
    at_most(Vectors::Plain, work)
}

/// Runs `kernel`, compiled for every x86-64, for those with AVX2 and for those with AVX-512, chosen when the program runs,
/// and returns what it does.
///
/// The compiler vectorises plain loops; it neither reorders sums nor fuses multiplications into additions on its own,
/// so all versions give the same bits. The closure and all that it calls must be `#[inline(always)]`, or it stays
/// as it is for every x86-64. What it counts or compares it returns: a variable of the caller's would lie in memory, and
/// its loop would take one number at a time. It is `move` for the same reason, where its loop reads numbers of the caller's.
#[inline(always)]
pub fn simd_dispatch<R>(kernel: impl FnOnce() -> R) -> R {
    dispatch(Kernel(kernel))
}

/// Runs a kernel that names its vectors itself, for loops that the compiler does not vectorise. It gets vectors of
/// eight numbers or of one; no operation may depend on which.
#[inline(always)]
pub fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    let most = MOST.get();
    if most == Vectors::Plain {
        return Arch::Scalar.dispatch(kernel);
    }
    #[cfg(target_arch = "x86_64")]
    {
        use pulp::x86::{V3, V4};
        let sixteen = if most == Vectors::Sixteen { V4::try_new() } else { None };
        match (V3::try_new(), sixteen) {
            (Some(eight), Some(sixteen)) => Simd::vectorize(sixteen, OfEight { kernel, eight }),
            (Some(eight), None) => Simd::vectorize(eight, kernel),
            (None, _) => Arch::Scalar.dispatch(kernel),
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    Arch::new().dispatch(kernel)
}

/// pulp takes closures too, but calls them through a shim that the compiler does not inline.
struct Kernel<F>(F);

impl<R, F: FnOnce() -> R> WithSimd for Kernel<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> R {
        (self.0)()
    }
}

/// A kernel that names its vectors, with those of AVX2 in what is compiled for AVX-512: it counts on eight numbers.
#[cfg(target_arch = "x86_64")]
struct OfEight<K> {
    kernel: K,
    eight: pulp::x86::V3,
}

#[cfg(target_arch = "x86_64")]
impl<K: WithSimd> WithSimd for OfEight<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> K::Output {
        self.kernel.with_simd(self.eight)
    }
}

/// Rows become columns.
#[inline(always)]
pub fn transposed<S: Simd>(simd: S, rows: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    // Known when it is compiled. What the compiler makes of the loops takes twice the time.
    #[cfg(target_arch = "x86_64")]
    if let Some(wide) = (&simd as &dyn Any).downcast_ref() {
        return transposed_wide(*wide, rows);
    }
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
fn transposed_wide(pulp::x86::V3 { avx, .. }: pulp::x86::V3, rows: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    // Halves of columns: numbers 0 to 3 come into the lower half of a vector, 4 to 7 into the upper one.
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

/// The whole part of a number from 0 to 2^22 and the rest, from 0 to below 1.
#[inline(always)]
pub fn split(number: f32) -> (u32, f32) {
    // From 2^23 on, floats are whole numbers. Unlike a cast, which has more cases to mind, this runs on eight at a time.
    const WHOLE: f32 = 8_388_608.0;
    let nearest = (number + WHOLE) - WHOLE;
    let below = if nearest > number { nearest - 1.0 } else { nearest };
    ((below + WHOLE).to_bits() - WHOLE.to_bits(), number - below)
}

/// The sum of values: eight partial sums, the same on every processor.
#[inline(always)]
pub fn sum(values: &[f32]) -> f64 {
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

/// How many, of less than 2^32, are true.
#[inline(always)]
pub fn count(values: impl Iterator<Item = bool>) -> u32 {
    values.map(u32::from).sum()
}

/// The largest of values, 0 if none is above it.
#[inline(always)]
pub fn largest(values: impl Iterator<Item = f32>) -> f32 {
    // Floats from 0 up are ordered like their bits, and eight whole numbers are compared at a time.
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
            transposed(simd, &self.0)
        }
    }

    #[test]
    fn columns_become_rows_whatever_the_vectors() {
        let rows: [[f32; 8]; 8] = std::array::from_fn(|y| std::array::from_fn(|x| (8 * y + x) as f32));
        for columns in Vectors::ALL.map(|vectors| at_most(vectors, || dispatch(Transpose(rows)))) {
            for (x, column) in columns.iter().enumerate() {
                assert_eq!(*column, std::array::from_fn(|y| rows[y][x]));
            }
        }
    }
}
