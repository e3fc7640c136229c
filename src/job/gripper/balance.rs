//! Finds how two fingers hold an object that is free along the closing axis: both press it with the same force.
//!
//! Each force grows with the depth of its finger, and the two depths add up to the difference between the object's
//! width and the gripper's. So the difference of the forces grows with the left depth, and there is one balance. If
//! each force is F = k d^p, the logarithm of the ratio of the forces is linear in that of the ratio of the depths. The
//! search uses the secant of these logarithms, kept inside the bracket.

use crate::force::{MARGIN, MAX_DEPTH_RATIO, MAX_PRESSES, find_depth_for_force};

/// Fraction of the larger force by which the two may differ.
pub const TOLERANCE: f64 = 1e-3;

/// Exponent with which a force grows with depth as long as nothing else is known: that of Hertz's contact of a ball.
const HERTZ_EXPONENT: f64 = 1.5;

/// Number of secant steps after which every second step halves the bracket. If forces are no powers of the depth, the
/// secant may stay at one end.
const SECANT_STEPS: u32 = 6;

/// A finger, as the search sees it.
pub struct FingerModel<'a> {
    /// The finger's normal force at an indentation depth (mm), N; NaN if it is not known.
    pub force_n: &'a dyn Fn(f64) -> f64,
    /// Thickness of the gelpad, mm.
    pub thickness_mm: f64,
    /// Young's modulus over 1 less the square of Poisson's ratio, kPa. It gives the start of the search.
    pub modulus_kpa: f64,
}

impl FingerModel<'_> {
    fn max_depth_mm(&self) -> f64 {
        MAX_DEPTH_RATIO * self.thickness_mm
    }
}

/// How an object is held.
#[derive(Clone, Debug, PartialEq)]
pub struct GripBalance {
    /// Indentation depth of the left and of the right finger, mm; below 0 neither touches the object.
    pub depth_mm: [f64; 2],
    /// Number of contacts that were solved to find them.
    pub presses: u32,
    /// Whether the forces are equal within [`TOLERANCE`], or the place where they would be is known within `place_mm`.
    pub balanced: bool,
    /// Why the object is not held as was wanted.
    pub failure: Option<String>,
}

impl GripBalance {
    /// Returns the state of fingers that are this far from the object on either side, or just touch it.
    pub fn open(gap_mm: f64) -> Self {
        Self { depth_mm: [-gap_mm; 2], presses: 0, balanced: true, failure: None }
    }
}

/// Finds how the fingers hold an object that is wider than the gripper by `squeeze_mm`. The depths are known within
/// `place_mm` at the end. `begin` is the expected fraction of the squeeze on the left finger, if there is one.
pub fn balance_squeeze(
    [left, right]: [&FingerModel<'_>; 2],
    squeeze_mm: f64,
    place_mm: f64,
    begin: Option<f64>,
) -> GripBalance {
    if squeeze_mm <= 0.0 {
        return GripBalance::open(-0.5 * squeeze_mm);
    }
    let (most_left, most_right) = (left.max_depth_mm(), right.max_depth_mm());
    let (mut low, mut high) = ((squeeze_mm - most_right).max(0.0), squeeze_mm.min(most_left));
    // Even at their greatest depths, both pads together cannot take the squeeze.
    if low >= high {
        let share = most_left / (most_left + most_right);
        let reason = format!(
            "the pads are {squeeze_mm:.3} mm closer than the object is wide, and give way by {:.3} mm, {MAX_DEPTH_RATIO} of their thicknesses",
            most_left + most_right
        );
        let depth_mm = [share * squeeze_mm, (1.0 - share) * squeeze_mm];
        return GripBalance { depth_mm, presses: 0, balanced: false, failure: Some(reason) };
    }
    // At an end of the bracket where one finger does not touch, the other one is stronger, without a press.
    // Under Hertz's law of a ball the depth at equal force goes with the modulus to the power -2/3.
    let (mut low_known, mut high_known) = (low == 0.0, high == squeeze_mm);
    let [soft_left, soft_right] = [left, right].map(|finger| libm::pow(finger.modulus_kpa, -1.0 / HERTZ_EXPONENT));
    let begin = squeeze_mm * begin.unwrap_or(soft_left / (soft_left + soft_right));
    let mut depth = if begin > low && begin < high { begin } else { 0.5 * (low + high) };
    let (mut presses, mut balanced) = (0, false);
    let (mut power, mut before) = (HERTZ_EXPONENT, None::<(f64, f64)>);
    for step in 0..MAX_PRESSES {
        let (on_left, on_right) = ((left.force_n)(depth), (right.force_n)(squeeze_mm - depth));
        presses += 2;
        if (on_left - on_right).abs() <= TOLERANCE * on_left.max(on_right) {
            balanced = true;
            break;
        }
        if on_left < on_right {
            (low, low_known) = (depth, true);
        } else {
            (high, high_known) = (depth, true);
        }
        if high - low <= place_mm {
            balanced = low_known && high_known && on_left.is_finite() && on_right.is_finite();
            break;
        }
        let depths = libm::log(depth / (squeeze_mm - depth));
        let forces = libm::log(on_left / on_right);
        // The last two steps give the exponent of the forces.
        if let Some((depths_before, forces_before)) = before {
            let slope = (forces - forces_before) / (depths - depths_before);
            power = if slope.is_finite() && slope > 0.0 { slope } else { power };
        }
        before = Some((depths, forces));
        let guess = squeeze_mm / (1.0 + libm::exp(forces / power - depths));
        let margin = MARGIN * (high - low);
        let halves = !forces.is_finite() || (step >= SECANT_STEPS && step % 2 == 0);
        depth = if halves { 0.5 * (low + high) } else { guess.clamp(low + margin, high - margin) };
    }
    GripBalance { depth_mm: [depth, squeeze_mm - depth], presses, balanced, failure: None }
}

/// Finds how each finger presses an object with `wanted_n`.
pub fn balance_force(fingers: [&FingerModel<'_>; 2], wanted_n: f64) -> GripBalance {
    let mut hold = GripBalance { depth_mm: [0.0; 2], presses: 0, balanced: true, failure: None };
    for (number, finger) in fingers.into_iter().enumerate() {
        let presses = std::cell::Cell::new(0);
        let force_n = |depth_mm: f64| {
            presses.set(presses.get() + 1);
            (finger.force_n)(depth_mm)
        };
        let deepest_mm = finger.max_depth_mm();
        let most_n = force_n(deepest_mm);
        hold.depth_mm[number] = match most_n >= wanted_n {
            // Half of the tolerance for each finger.
            true => find_depth_for_force(wanted_n, (deepest_mm, most_n), 0.5 * TOLERANCE, force_n),
            false => {
                hold.balanced = false;
                hold.failure.get_or_insert_with(|| {
                    format!(
                        "{wanted_n:.3} N are wanted, but at {deepest_mm:.3} mm, {MAX_DEPTH_RATIO} of the pad's thickness, the {} \
                         finger has only {most_n:.3} N",
                        ["left", "right"][number]
                    )
                });
                deepest_mm
            }
        };
        hold.presses += presses.get();
    }
    hold
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn finger(force_n: &dyn Fn(f64) -> f64, modulus_kpa: f64) -> FingerModel<'_> {
        FingerModel { force_n, thickness_mm: 4.0, modulus_kpa }
    }

    /// A force that grows with a power of the depth beyond `from`, as on a pad whose highest point is elsewhere.
    fn power(k: f64, p: f64, from: f64) -> impl Fn(f64) -> f64 {
        move |depth| k * (depth - from).max(0.0).powf(p)
    }

    /// The balance by bisection, as far as doubles can tell.
    fn halved(left: &dyn Fn(f64) -> f64, right: &dyn Fn(f64) -> f64, squeeze: f64) -> f64 {
        let (mut low, mut high) = (0.0, squeeze);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if left(middle) < right(squeeze - middle) { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    #[test]
    fn balls_of_hertz_share_the_squeeze_by_their_moduli() {
        for (soft, stiff) in [(1.0, 1.0), (1.0, 2.0), (0.1, 5.0)] {
            let (left, right) = (power(soft, 1.5, 0.0), power(stiff, 1.5, 0.0));
            let (left, right) = (finger(&left, soft), finger(&right, stiff));
            let hold = balance_squeeze([&left, &right], 2.0, 1e-4, None);
            let share = stiff.powf(2.0 / 3.0) / (soft.powf(2.0 / 3.0) + stiff.powf(2.0 / 3.0));
            assert!((hold.depth_mm[0] - 2.0 * share).abs() < 1e-9, "{hold:?}");
            assert_eq!((hold.presses, hold.balanced, hold.depth_mm[0] + hold.depth_mm[1]), (2, true, 2.0));
        }
    }

    #[test]
    fn what_is_thinner_than_the_gripper_is_open_touches_neither_finger() {
        let never = |_: f64| panic!("no press");
        let (left, right) = (finger(&never, 1.0), finger(&never, 1.0));
        assert_eq!(balance_squeeze([&left, &right], -0.4, 1e-4, None), GripBalance::open(0.2));
        assert_eq!(balance_squeeze([&left, &right], 0.0, 1e-4, None).depth_mm, [0.0; 2]);
    }

    #[test]
    fn what_pads_cannot_give_is_said() {
        let (weak, strong) = (power(1.0, 1.5, 0.0), power(100.0, 1.5, 0.0));
        let (weak, strong) = (finger(&weak, 1.0), finger(&strong, 100.0));
        let wide = balance_squeeze([&weak, &strong], 7.5, 1e-4, None);
        assert!(
            !wide.balanced && wide.failure.as_deref().is_some_and(|reason| reason.contains("7.200 mm")),
            "{wide:?}"
        );
        assert_eq!(wide.depth_mm, [3.75; 2]);
        // The strong pad hardly yields, so the weak one would have to yield more than it can.
        let lop = balance_squeeze([&weak, &strong], 5.0, 1e-4, None);
        assert!(!lop.balanced && lop.depth_mm[0] <= 3.6, "{lop:?}");
        let most = balance_force([&strong, &weak], 10.0);
        let reason = most.failure.expect("3.6 mm of the weak pad are 6.8 N");
        assert!(reason.contains("the right finger has only 6.831 N"), "{reason}");
    }

    #[test]
    fn a_force_that_jumps_is_placed_and_one_that_is_not_known_is_not() {
        let jumps = |depth: f64| if depth < 0.7 { depth } else { 3.0 * depth };
        let (smooth, unknown) = (power(1.0, 1.0, 0.0), |_: f64| f64::NAN);
        let (left, right, nobody) = (finger(&jumps, 1.0), finger(&smooth, 1.0), finger(&unknown, 1.0));
        // At 0.7 mm the right finger's 1.3 mm lie within the jump.
        let hold = balance_squeeze([&left, &right], 2.0, 1e-4, None);
        assert!(hold.balanced && (hold.depth_mm[0] - 0.7).abs() <= 1e-4, "{hold:?}");
        let hold = balance_squeeze([&left, &nobody], 2.0, 1e-4, None);
        assert!(!hold.balanced && hold.presses <= 2 * MAX_PRESSES, "{hold:?}");
    }

    proptest! {
        #[test]
        fn the_balance_is_that_of_halving_whatever_the_powers(
            k in 1e-2..1e2_f64, p in 0.8..4.0_f64, q in 0.8..4.0_f64, from in 0.0..0.5_f64, squeeze in 0.05..3.5_f64,
        ) {
            let (left, right) = (power(1.0, p, 0.0), power(k, q, from));
            let (one, other) = (finger(&left, 1.0), finger(&right, k));
            let hold = balance_squeeze([&one, &other], squeeze, 1e-4, None);
            let [a, b] = hold.depth_mm;
            prop_assert!(hold.balanced, "{:?}", hold);
            let (f, g) = (left(a), right(b));
            let placed = (a - halved(&left, &right, squeeze)).abs() <= 1e-4;
            prop_assert!((f - g).abs() <= TOLERANCE * f.max(g) || placed, "{:?} {} {}", hold, f, g);
        }

        #[test]
        fn a_grip_of_a_force_has_it_on_both_sides_and_its_squeeze_gives_it_again(
            k in 0.1..10.0_f64, p in 1.0..3.0_f64, q in 1.0..3.0_f64, wanted in 0.01..1.0_f64,
        ) {
            let (left, right) = (power(2.0, p, 0.0), power(2.0 * k, q, 0.0));
            let (one, other) = (finger(&left, 1.0), finger(&right, k));
            let hold = balance_force([&one, &other], wanted);
            let [a, b] = hold.depth_mm;
            prop_assert!(hold.balanced, "{:?}", hold);
            prop_assert!((left(a) - wanted).abs() <= TOLERANCE * wanted && (right(b) - wanted).abs() <= TOLERANCE * wanted);
            let again = balance_squeeze([&one, &other], a + b, 1e-6, None);
            prop_assert!((left(again.depth_mm[0]) / wanted - 1.0).abs() < 4e-3, "{:?} {:?}", hold, again);
        }
    }
}
