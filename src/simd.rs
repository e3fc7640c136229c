//! Runs a kernel with the widest vectors that give the same bits everywhere.

use std::cell::Cell;

use pulp::{Arch, Simd, WithSimd};

/// Runs `kernel`, compiled once for every x86-64 and once for those with AVX2, chosen when the program runs.
///
/// The compiler vectorises plain loops; it neither reorders sums nor fuses multiplications into additions on its own,
/// so both versions give the same bits. The closure and all that it calls must be `#[inline(always)]`, or it stays
/// as it is for every x86-64.
#[inline(always)]
pub fn wide(kernel: impl FnMut()) {
    dispatch(Kernel(kernel));
}

/// Runs a kernel that names its vectors itself, for loops that the compiler does not vectorise. It gets vectors of
/// eight numbers or of one; no operation may depend on which.
#[inline(always)]
pub fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    let arch = if NARROW.get() { Arch::Scalar } else { Arch::new() };
    arch.dispatch(kernel)
}

thread_local! {
    static NARROW: Cell<bool> = const { Cell::new(false) };
}

/// Does `work` as on a processor without wide vectors, on this thread: what it gives must not differ in a bit.
pub fn narrow<T>(work: impl FnOnce() -> T) -> T {
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
