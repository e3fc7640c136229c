//! Finds the indentation depth at which a pad presses back with a given force.

use std::cell::Cell;

use gelsim_files::number_format::format_number;

/// Most presses that are tried.
pub const MAX_PRESSES: u32 = 40;

/// The greatest indentation depth that is tried, as a fraction of the pad's thickness.
pub const MAX_DEPTH_RATIO: f64 = 0.9;

/// Relative tolerance with which a force is met.
pub const FORCE_TOLERANCE: f64 = 2e-3;

/// Fraction by which a force may be missed where it jumps: there another chart of a curved gel begins.
const MOST_OFF: f64 = 0.02;

/// The first depth that a search tries, over the greatest.
const FIRST_DEPTH_RATIO: f64 = 0.0625;

/// Width of a bracket at which the search ends, mm.
const MIN_BRACKET_MM: f64 = 1e-6;

/// Fraction of the bracket by which a guess stays away from its ends.
pub const MARGIN: f64 = 0.02;

/// Finds the indentation depth, mm, at which a press gives the wanted force. `force_n` gives the force at a depth, N, if
/// it is known. Also returns the fraction within which it was found, or why it was not.
pub fn press_for_force(
    wanted_n: f64,
    most_mm: f64,
    force_n: impl Fn(f64) -> Option<f64>,
) -> (f64, Result<f64, String>) {
    let mut depth_mm = FIRST_DEPTH_RATIO * most_mm;
    let deep_n = loop {
        match force_n(depth_mm) {
            None => return (depth_mm, Err(format!("the force at a depth of {depth_mm:.3} mm is not known"))),
            Some(found_n) if found_n >= wanted_n => break found_n,
            Some(found_n) if depth_mm >= most_mm => {
                let reason = format!(
                    "{wanted_n:.3} N are wanted, but at {depth_mm:.3} mm, {MAX_DEPTH_RATIO} of the pad's thickness, there are \
                     only {found_n:.3} N"
                );
                return (depth_mm, Err(reason));
            }
            Some(_) => depth_mm = (2.0 * depth_mm).min(most_mm),
        }
    };
    let last_n = Cell::new(deep_n);
    let depth_mm = find_depth_for_force(wanted_n, (depth_mm, deep_n), FORCE_TOLERANCE, |depth_mm| {
        last_n.set(force_n(depth_mm).unwrap_or(f64::NAN));
        last_n.get()
    });
    // Where the force jumps, no depth has the wanted one.
    let off = (last_n.get() / wanted_n - 1.0).abs();
    match off <= MOST_OFF {
        true => (depth_mm, Ok(off.max(FORCE_TOLERANCE))),
        false => {
            let found_n = last_n.get();
            let depth = format_number(depth_mm);
            let reason =
                format!("{wanted_n:.3} N are wanted, but near {depth} mm the force jumps past it: {found_n:.3} N");
            (depth_mm, Err(reason))
        }
    }
}

/// Finds the indentation depth, mm, at which `force_n`, which grows with depth from 0, is `wanted_n` within the
/// fraction `tolerance`. `deepest` is a depth and the force there, which must be at least the wanted one. If the search
/// ends early, its last depth is returned.
pub fn find_depth_for_force(wanted_n: f64, deepest: (f64, f64), tolerance: f64, force_n: impl Fn(f64) -> f64) -> f64 {
    // Forces grow like a power of the depth, so the search uses the secant of their logarithms, kept inside the
    // bracket.
    let (mut low, mut high) = ((0.0, 0.0), deepest);
    // For the first guess the force grows with the depth to the power 1 / 0.6, between a ball (1.5) and a cone (2).
    let mut depth = deepest.0 * libm::pow(wanted_n / deepest.1, 0.6);
    for _ in 0..MAX_PRESSES {
        let found = force_n(depth);
        if (found - wanted_n).abs() <= tolerance * wanted_n || high.0 - low.0 < MIN_BRACKET_MM {
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
        // A guess at an end of the bracket would hardly narrow it.
        let margin = MARGIN * (high.0 - low.0);
        depth = if guess.is_finite() { guess.clamp(low.0 + margin, high.0 - margin) } else { 0.5 * (low.0 + high.0) };
    }
    depth
}
