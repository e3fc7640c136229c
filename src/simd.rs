//! Runs a kernel with the widest vectors that give the same bits everywhere.

use pulp::{Arch, Simd, WithSimd};

/// Runs `kernel`, compiled once for every x86-64 and once for those with AVX2, chosen when the program runs.
///
/// The compiler vectorises plain loops; it neither reorders sums nor fuses multiplications into additions on its own,
/// so both versions give the same bits. The closure and all that it calls must be `#[inline(always)]`, or it stays
/// as it is for every x86-64.
#[inline(always)]
pub fn wide(kernel: impl FnMut()) {
    Arch::new().dispatch(Kernel(kernel));
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
