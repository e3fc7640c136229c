//! What must not matter, or only to rounding: which way round an object lies, where, how stiff the pad is, which
//! vectors the processor has.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::grid::Resolution;
use gelsim_core::base::simd;
use gelsim_core::gelpad::Contact;

use super::rig::{NOTHING, OBJECTS, RESOLUTIONS, Rig, Setup, ball, texture};

fn setup() -> Setup {
    Setup {
        resolution_px: [96, 96],
        mm_per_px: [0.125; 2],
        thickness_mm: 2.0,
        poisson_ratio: 0.4999,
        ..Setup::default()
    }
}

/// Largest difference of two surfaces, um, the second one read at another place.
fn difference(a: &Grid<f32>, b: &Grid<f32>, place: impl Fn(usize, usize) -> Option<(usize, usize)>) -> f64 {
    let mut worst = 0.0_f64;
    for y in 0..a.height {
        for x in 0..a.width {
            if let Some((u, v)) = place(x, y) {
                worst = worst.max(1e3 * f64::from(a.at(x, y) - b.at(u, v)).abs());
            }
        }
    }
    worst
}

/// A lopsided object that touches in three places.
fn lopsided(x: f64, y: f64) -> f64 {
    let square = if (x + 2.0).abs() < 1.1 && (y - 1.6).abs() < 0.7 { 0.4 + 0.03 * x } else { NOTHING };
    ball(2.0, 0.5, x - 1.5, y + 0.4).max(square).max(0.2 - (x + 3.0).powi(2) - 0.3 * (y + 2.0).powi(2))
}

/// Where the same pixel is found in the image of an object that lies another way round.
pub type Way = (&'static str, fn(f64, f64) -> (f64, f64), fn(usize, usize, usize) -> (usize, usize));

pub const WAYS: [Way; 4] = [
    ("mirrored left to right", |x, y| (-x, y), |x, y, last| (last - x, y)),
    ("mirrored top to bottom", |x, y| (x, -y), |x, y, last| (x, last - y)),
    ("transposed", |x, y| (y, x), |x, y, _| (y, x)),
    ("turned by a quarter", |x, y| (-y, x), |x, y, last| (last - y, x)),
];

#[test]
fn an_object_the_other_way_round_gives_the_surface_the_other_way_round() {
    for resolution in RESOLUTIONS {
        // Well below what 1 um of tolerance would hide.
        let rig = setup().solved(resolution, 0.02).rig();
        let straight = rig.press(lopsided);
        assert!(straight.numerics.converged, "{:?}", straight.numerics);
        for (name, object, place) in WAYS {
            let other = rig.press(|x, y| {
                let (u, v) = object(x, y);
                lopsided(u, v)
            });
            let last = straight.surface.width - 1;
            let away = difference(&other.surface, &straight.surface, |x, y| Some(place(x, y, last)));
            let force = other.force_n.expect("force") / straight.force_n.expect("force") - 1.0;
            println!("{name}, {resolution:?}: {away:.5} um, force {force:.1e}");
            assert!(away < 0.02, "{name}, {resolution:?}: {away} um");
            assert!(force.abs() < 1e-5, "{name}, {resolution:?}: force {force}");
        }
    }
}

#[test]
fn a_symmetric_object_gives_a_symmetric_surface() {
    for resolution in RESOLUTIONS {
        let rig = setup().solved(resolution, 0.02).rig();
        let contact =
            rig.press(|x, y| if x.abs().max(y.abs()) < 2.0 && x.abs().min(y.abs()) < 1.0 { 0.4 } else { NOTHING });
        for (name, _, place) in WAYS {
            let last = contact.surface.width - 1;
            let away = difference(&contact.surface, &contact.surface, |x, y| Some(place(x, y, last)));
            assert!(away < 0.02, "{name}, {resolution:?}: {away} um");
        }
    }
}

/// An object moved by whole pixels.
fn moved(rig: &Rig, by: [i32; 2]) -> Contact {
    let [dx, dy] = by.map(|px| f64::from(px) * 0.125);
    rig.press(|x, y| lopsided(x - dx, y - dy))
}

#[test]
fn an_object_moved_by_whole_pixels_moves_the_surface() {
    for resolution in RESOLUTIONS {
        let rig = setup().solved(resolution, 0.02).rig();
        let here = moved(&rig, [0, 0]);
        // Some moves take it to the very border of the view, where sums of all lengths are cut off; multiples of 4,
        // because coarse grids have only those.
        for by in [[4, 0], [0, -8], [-8, 4], [16, 12], [20, -16], [-12, 20]] {
            let there = moved(&rig, by);
            let size = here.surface.width as i32;
            let away = difference(&here.surface, &there.surface, |x, y| {
                let (u, v) = (x as i32 + by[0], y as i32 + by[1]);
                let inside = |at: i32| (4..size - 4).contains(&at);
                // Near the border coarse grids have nothing to interpolate to.
                let all = [u, v, x as i32, y as i32].into_iter().all(inside);
                all.then_some((u as usize, v as usize))
            });
            println!("moved by {by:?}, {resolution:?}: {away:.5} um");
            assert!(away < 0.02, "moved by {by:?}, {resolution:?}: {away} um");
        }
    }
}

#[test]
fn deeper_is_never_less_force_or_area() {
    for resolution in RESOLUTIONS {
        let rig = setup().solved(resolution, 0.5).rig();
        for (name, object) in OBJECTS {
            let (mut force, mut area) = (0.0, 0);
            for step in 0..12 {
                let lower = 0.06 * f64::from(step) - 0.4;
                let contact = rig.press(|x, y| object(x, y) + lower);
                assert!(contact.numerics.converged, "{name}, {lower}: {:?}", contact.numerics);
                let now = contact.force_n.expect("force");
                let touching = contact.mask.data.iter().filter(|value| **value == 255).count();
                // The set in contact is known to the tolerance only: single pixels at its rim come and go.
                // On coarse grids a pixel of theirs at a time does.
                let slack = 1 + touching / if resolution == Resolution::Full { 100 } else { 20 };
                assert!(now >= force, "{name}, {resolution:?} at {lower}: {now} N after {force}");
                assert!(touching + slack >= area, "{name}, {resolution:?} at {lower}: {touching} px after {area}");
                (force, area) = (now, touching);
            }
            assert!(force > 0.1, "{name}: {force} N");
        }
    }
}

fn bits(grid: &Grid<f32>) -> Vec<u32> {
    grid.data.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn the_surface_does_not_know_youngs_modulus_and_the_force_is_proportional_to_it() {
    for resolution in RESOLUTIONS {
        let press =
            |youngs_modulus_kpa| Setup { youngs_modulus_kpa, ..setup() }.solved(resolution, 1.0).rig().press(lopsided);
        let (soft, stiff) = (press(10.0), press(320.0));
        assert!(bits(&soft.surface) == bits(&stiff.surface) && soft.mask == stiff.mask);
        // 320 is 10 times a power of two: every rounding is the same.
        let ratio = stiff.force_n.expect("force") / soft.force_n.expect("force");
        assert!((ratio / 32.0 - 1.0).abs() < 1e-12, "{ratio}");
    }
}

#[test]
fn wide_vectors_change_no_bit_of_a_press() {
    let nasty = |x: f64, y: f64| texture(x, y).max(lopsided(x, y));
    for resolution in RESOLUTIONS {
        // Sizes that no vector divides.
        let setup = Setup { resolution_px: [101, 83], ..setup() };
        let wide = setup.solved(resolution, 0.1).rig().press(nasty);
        let narrow = simd::scalar_only(|| setup.solved(resolution, 0.1).rig().press(nasty));
        assert!(wide.numerics.iterations > 2, "{:?}", wide.numerics);
        assert!(bits(&wide.surface) == bits(&narrow.surface), "{resolution:?}: surface");
        let pressures = |contact: &Contact| contact.pressure.as_ref().map(bits);
        assert!(pressures(&wide) == pressures(&narrow), "{resolution:?}: pressure");
        assert_eq!((wide.force_n, wide.numerics, wide.mask), (narrow.force_n, narrow.numerics, narrow.mask));
    }
}

#[test]
fn what_was_pressed_before_changes_no_bit() {
    for resolution in RESOLUTIONS {
        let rig = setup().solved(resolution, 1.0).rig();
        let first = rig.press(lopsided);
        for (_, object) in OBJECTS {
            rig.press(object);
        }
        Setup { resolution_px: [30, 50], ..setup() }.solved(resolution, 1.0).rig().press(texture);
        let again = rig.press(lopsided);
        assert!(bits(&first.surface) == bits(&again.surface) && first.force_n == again.force_n, "{resolution:?}");
    }
}
