//! Runs a kernel with the widest vectors that give the same bits everywhere.

use std::cell::Cell;

use pulp::{Arch, Simd, WithSimd};

/// Runs `kernel`, compiled once for every x86-64 and once for those with AVX2, chosen when the program runs.
///
/// The compiler vectorises plain loops; it neither reorders sums nor fuses multiplications into additions on its own,
/// so both versions give the same bits. The closure and all that it calls must be `#[inline(always)]`, or it stays
/// as it is for every x86-64.
#[inline(always)]
pub fn simd_dispatch(kernel: impl FnMut()) {
    dispatch(Kernel(kernel));
}

/// Runs a kernel that names its vectors itself, for loops that the compiler does not vectorise. It gets vectors of
/// eight numbers or of one; no operation may depend on which.
#[inline(always)]
pub fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    let arch = if NARROW.get() { Arch::Scalar } else { Arch::new() };
    arch.dispatch(kernel)
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

thread_local! {
    static NARROW: Cell<bool> = const { Cell::new(false) };
}

/// Does `work` as on a processor without wide vectors, on this thread: what it gives must not differ in a bit.
pub fn scalar_only<T>(work: impl FnOnce() -> T) -> T {
    let before = NARROW.replace(true);
    let result = work();
    NARROW.set(before);
    result
}

/// pulp takes closures too, but calls them through a shim that the compiler does not inline.
struct Kernel<F>(F);

impl<F: FnMut()> WithSimd for Kernel<F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        (self.0)();
    }
}
