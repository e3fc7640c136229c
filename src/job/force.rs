//! The depth at which a pad presses back with a force.

/// Presses that are tried for a force.
pub const MOST_PRESSES: u32 = 40;

/// Indentation depth over the pad's thickness up to which a force is looked for.
pub const DEEPEST: f64 = 0.9;

/// A bracket so narrow is a place, mm.
const NARROWEST_MM: f64 = 1e-6;

/// Share of what is known to hold the answer by which a guess stays within it.
pub const MARGIN: f64 = 0.02;

/// The indentation depth, mm, at which `force_n`, which grows with it from 0, is `wanted_n` to a share of `tolerance`; at
/// the depth `deepest.0` it is known to be `deepest.1`, at least as much.
pub fn depth_of(wanted_n: f64, deepest: (f64, f64), tolerance: f64, force_n: impl Fn(f64) -> f64) -> f64 {
    // Forces grow with a power of the depth: the secant of their logarithms, kept within what is known.
    let (mut low, mut high) = ((0.0, 0.0), deepest);
    let mut depth = deepest.0 * libm::pow(wanted_n / deepest.1, 0.6);
    for _ in 0..MOST_PRESSES {
        let found = force_n(depth);
        if (found - wanted_n).abs() <= tolerance * wanted_n || high.0 - low.0 < NARROWEST_MM {
            break;
        }
        if found < wanted_n {
            low = (depth, found)
        } else {
            high = (depth, found)
        }
        let log = libm::log;
        let guess = if low.1 > 0.0 {
            let share = (log(wanted_n) - log(low.1)) / (log(high.1) - log(low.1));
            libm::exp(log(low.0) + share * (log(high.0) - log(low.0)))
        } else {
            0.5 * (low.0 + high.0)
        };
        let margin = MARGIN * (high.0 - low.0);
        depth = if guess.is_finite() { guess.clamp(low.0 + margin, high.0 - margin) } else { 0.5 * (low.0 + high.0) };
    }
    depth
}
