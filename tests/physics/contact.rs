//! Whole presses against slow solutions of the same equations, and the conditions of contact at every pixel.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::grid::Resolution;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::depth::Depth;
use gelsim_core::gelpad::Contact;
use gelsim_core::gelpad::elastic::Elastic;

use super::rig::{NOTHING, Named, OBJECTS, RESOLUTIONS, Rig, Setup};
use gelsim_oracle::cut_pixels::edges;
use gelsim_oracle::dense_contact::dense_contact_on_springs;
use gelsim_oracle::pressed_pixel::pressed_pixel;
use gelsim_oracle::shapes::Random;

/// 16 x 16 px, 4 mm wide.
const SMALL: [Named; 6] = [
    ("ball", |x, y| 0.3 - (x * x + y * y) / 4.0),
    ("two balls", |x, y| (0.25 - ((x - 1.0).powi(2) + y * y)).max(0.2 - ((x + 1.1).powi(2) + (y - 0.3).powi(2)))),
    ("tilted square", |x, y| if x.abs() < 1.3 && y.abs() < 1.1 { 0.2 + 0.05 * x - 0.1 * y } else { NOTHING }),
    ("pixel", |x, y| if x.abs().max(y.abs()) < 0.2 && x > 0.0 && y > 0.0 { 0.1 } else { NOTHING }),
    ("rough", |x, y| 0.2 + 0.1 * (5.0 * x).sin() * (7.0 * y + 1.0).cos() - 0.03 * (x * x + y * y)),
    ("punch in a surround", |x, y| if x.hypot(y) < 0.6 { 0.3 } else { -0.005 }),
];

#[test]
fn presses_agree_with_a_dense_solution_in_f64() {
    let mut worst = [0.0_f64; 2];
    let pads = [(3.0, 0.3), (0.6, 0.4999), (40.0, 0.45), (3.0, 0.4999), (0.6, 0.48)];
    for &(thickness_mm, nu) in &pads[..if crate::thorough() { 5 } else { 3 }] {
        let setup = Setup {
            resolution_px: [16, 16],
            mm_per_px: [0.25, 0.25],
            thickness_mm,
            poisson_ratio: nu,
            ..Setup::default()
        };
        // What 32-bit numbers allow where the pad is stiff: a rounding of 3e-8 mm in w is 1e-5 of the pressure.
        let rig = setup.solved(Resolution::Full, 0.01).rig();
        // Around the view there is no object.
        const SIZE: usize = 18;
        let place = |at: usize| (at as f64 + 0.5 - 9.0) * 0.25;
        // Of square pixels (x, y) is (y, x).
        let mut lags = Grid::new(SIZE, SIZE);
        for y in 0..SIZE {
            for x in 0..=y {
                let lag = pressed_pixel(setup.layer(), [0.25; 2], x as f64 * 0.25, y as f64 * 0.25);
                lags.row_mut(y)[x] = lag;
                lags.row_mut(x)[y] = lag;
            }
        }
        for (name, object) in SMALL {
            let object = |x: f64, y: f64| if x.abs().max(y.abs()) < 2.0 { object(x, y) } else { NOTHING };
            let mut penetration = Grid::new(SIZE, SIZE);
            for (at, g) in penetration.data.iter_mut().enumerate() {
                // As the press gets it.
                *g = f64::from(object(place(at % SIZE), place(at / SIZE)).clamp(-thickness_mm, thickness_mm) as f32);
            }
            let springs = edges(&penetration, 0.25, &lags);
            let (pressure, mut displacement) = dense_contact_on_springs(&penetration, &springs, |x, y| lags.at(x, y));
            for (at, w) in displacement.iter_mut().enumerate().filter(|(at, _)| pressure[*at] > 0.0) {
                *w = penetration.data[at];
            }
            let contact = rig.press(object);
            let highest = pressure.iter().fold(0.0_f64, |max, p| max.max(*p));
            let found = contact.pressure.as_ref().expect("pressures");
            for (x, y) in (0..256).map(|at| (at % 16, at / 16)) {
                let at = (y + 1) * SIZE + x + 1;
                let p = f64::from(found.at(x, y)) / setup.youngs_modulus_kpa;
                let w = f64::from(contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER));
                worst[0] = worst[0].max((p - pressure[at]).abs() / highest);
                worst[1] = worst[1].max(1e3 * (w - displacement[at]).abs());
                let what = || format!("{name}, h {thickness_mm}, nu {nu}, pixel {x}, {y}");
                assert!((p - pressure[at]).abs() < 1e-4 * highest, "{}: pressure {p} for {}", what(), pressure[at]);
                // Pressures that are all off one way by the tolerance add up to several times that around the contact.
                assert!((w - displacement[at]).abs() < 5e-5, "{}: {w} mm for {}", what(), displacement[at]);
            }
            let force = pressure.iter().sum::<f64>() * 0.0625 * setup.youngs_modulus_kpa * 1e-3;
            let error = contact.force_n.expect("force") / force - 1.0;
            assert!(error.abs() < 1e-4, "{name}, h {thickness_mm}, nu {nu}: force off by {error}");
        }
    }
    println!("dense: pressure off by {:.1e} of its peak, surface by {:.4} um", worst[0], worst[1]);
}

/// Column and row of the camera's pixels on which the contact is solved.
fn solved_on(rig: &Rig, depth: &Depth) -> [Vec<usize>; 2] {
    let factor = match rig.setup.elastic.resolution {
        Resolution::Full => 1,
        Resolution::Half => 2,
        Resolution::Quarter => 4,
    };
    [depth.penetration.width, depth.penetration.height].map(|size| (factor / 2..size).step_by(factor).collect())
}

/// Largest penetration outside and distance inside the contact, mm, of the pressures in view, summed up in f64.
fn residual(rig: &Rig, depth: &Depth, contact: &Contact) -> f64 {
    let youngs_modulus_kpa = rig.setup.youngs_modulus_kpa;
    let [columns, rows] = solved_on(rig, depth);
    let kernel = rig.pad.kernel();
    let wide = |grid: &Grid<f32>| Grid {
        width: grid.width,
        height: grid.height,
        data: grid.data.iter().map(|value| f64::from(*value)).collect(),
    };
    let springs = match columns.len() == depth.penetration.width {
        true => edges(&wide(&depth.penetration), rig.setup.mm_per_px[0], &wide(kernel)),
        false => vec![0.0; depth.penetration.data.len()],
    };
    let margin = depth.margin_px;
    let pressure = contact.pressure.as_ref().expect("pressures");
    let mut pressed = Vec::new();
    for (v, y) in rows.iter().enumerate() {
        for (u, x) in columns.iter().enumerate() {
            let inside = *x >= margin && *y >= margin && x - margin < pressure.width && y - margin < pressure.height;
            if inside && pressure.at(x - margin, y - margin) > 0.0 {
                pressed.push((u, v, f64::from(pressure.at(x - margin, y - margin)) / youngs_modulus_kpa));
            }
        }
    }
    let mut worst = 0.0_f64;
    for (v, y) in rows.iter().enumerate() {
        for (u, x) in columns.iter().enumerate() {
            let share = |(i, j, p): &(usize, usize, f64)| {
                let (lag_x, lag_y) = (i.abs_diff(u), j.abs_diff(v));
                let known = lag_x < kernel.width && lag_y < kernel.height;
                if known { p * f64::from(kernel.at(lag_x, lag_y)) } else { 0.0 }
            };
            let gap = pressed.iter().map(share).sum::<f64>() - f64::from(depth.penetration.at(*x, *y));
            let own = pressed.iter().find(|(i, j, _)| (*i, *j) == (u, v));
            let touches = own.is_some();
            let gap = gap + own.map_or(0.0, |(.., p)| springs[y * depth.penetration.width + x] * p);
            // Outside the view only the object that the view was made for is known.
            worst = worst.max(if touches { gap.abs() } else { -gap });
        }
    }
    worst
}

#[test]
fn the_residual_in_the_label_is_the_largest_violation_there_is() {
    let mut widest = 0.0_f64;
    for resolution in RESOLUTIONS {
        for tolerance_um in [1.0, 0.05] {
            let setup = Setup { resolution_px: [96, 72], mm_per_px: [0.125; 2], thickness_mm: 1.0, ..Setup::default() };
            let rig = setup.solved(resolution, tolerance_um).rig();
            for (name, object) in OBJECTS {
                // Smaller and out of the border's way, so that every pressure is in view.
                let depth =
                    rig.depth(
                        |x, y| if x.abs() < 4.5 && y.abs() < 3.5 { 0.3 * object(2.0 * x, 2.0 * y) } else { NOTHING },
                    );
                let contact = rig.pad.press(&depth);
                let numerics = contact.numerics;
                assert!(numerics.converged, "{name}, {resolution:?}: {numerics:?}");
                let stated = numerics.residual_um.expect("a residual");
                assert!(stated <= 2.0 * tolerance_um + 1e-3, "{name}, {resolution:?}: {numerics:?}");
                if resolution == Resolution::Full {
                    let found = 1e3 * residual(&rig, &depth, &contact);
                    widest = widest.max(found - stated);
                    // 32-bit displacements of half a millimetre: 0.005 um of rounding, and what updates add to that.
                    assert!(found < stated + 0.02, "{name}, {tolerance_um} um: {found} um, the label says {stated}");
                }
            }
        }
    }
    println!("residual: at most {widest:.4} um above the label's");
}

#[test]
fn contact_is_complementary_at_every_pixel_of_every_object() {
    for resolution in RESOLUTIONS {
        let setup =
            Setup { resolution_px: [160, 120], mm_per_px: [0.125, 0.1], poisson_ratio: 0.4999, ..Setup::default() };
        let rig = setup.solved(resolution, 1.0).rig();
        for (name, object) in OBJECTS {
            let depth = rig.depth(object);
            let contact = rig.pad.press(&depth);
            assert!(contact.finite && contact.numerics.converged, "{name}, {resolution:?}: {:?}", contact.numerics);
            assert_eq!([contact.surface.width, contact.surface.height], [162, 122]);
            let pressure = contact.pressure.as_ref().expect("pressures");
            let (mut force, mut peak, mut touching) = (0.0, 0.0_f32, 0);
            for y in 0..120 {
                for x in 0..160 {
                    let p = pressure.at(x, y);
                    let w = contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
                    let g = depth.penetration.at(x + depth.margin_px, y + depth.margin_px);
                    assert!(p >= 0.0, "{name}, {resolution:?}: pressure {p} at {x}, {y}");
                    assert!(w >= g, "{name}, {resolution:?}: {w} under {g} at {x}, {y}");
                    let touches = contact.mask.at(x, y) == 255;
                    // On coarse grids, what reaches through the interpolated surface touches it without pressure.
                    let pressed = p > 0.0 || resolution != Resolution::Full && w == g;
                    assert!(touches || p == 0.0, "{name}, {resolution:?}: {p} kPa without contact at {x}, {y}");
                    assert!(pressed || !touches, "{name}, {resolution:?}: contact without pressure at {x}, {y}");
                    // What touches lies on the object; between coarse pixels the surface is interpolated, and lies at
                    // most a tenth of their distance away.
                    let pixels = match resolution {
                        Resolution::Full => 0.0,
                        Resolution::Half => 2.0,
                        Resolution::Quarter => 4.0,
                    };
                    let away = 0.1 * 0.1 * pixels;
                    assert!(
                        p == 0.0 || w - g <= 1.0001 * away,
                        "{name}, {resolution:?}: {p} kPa, {} mm away at {x}, {y}",
                        w - g
                    );
                    force += f64::from(p);
                    peak = peak.max(p);
                    touching += usize::from(p > 0.0);
                }
            }
            assert!(touching > 30, "{name}, {resolution:?}: {touching} px touch");
            let newtons = force * 0.125 * 0.1 * 1e-3;
            assert!((contact.force_n.expect("force") / newtons - 1.0).abs() < 1e-9, "{name}: {newtons} N");
            assert_eq!(contact.peak_pressure_kpa, Some(f64::from(peak)));
        }
    }
}

#[test]
fn pile_up_makes_contact_far_beyond_the_penetration() {
    let setup = Setup { resolution_px: [160, 120], mm_per_px: [0.125; 2], poisson_ratio: 0.4999, ..Setup::default() };
    for resolution in RESOLUTIONS {
        let rig = setup.solved(resolution, 0.5).rig();
        let punch = |x: f64, y: f64| x.hypot(y) < 1.5;
        let pressed = |surround: f64| rig.press(move |x, y| if punch(x, y) { 0.5 } else { surround });
        let (contact, alone) = (pressed(-0.01), pressed(NOTHING));
        assert!(contact.numerics.converged && alone.numerics.converged, "{:?}", contact.numerics);
        let area = |contact: &Contact| contact.mask.data.iter().filter(|value| **value == 255).count();
        println!("pile-up, {resolution:?}: {} px instead of {}, {:?}", area(&contact), area(&alone), contact.numerics);
        assert!(area(&contact) > 10 * area(&alone), "{} {}", area(&contact), area(&alone));
        assert!(contact.surface.data.iter().all(|w| *w >= -0.0101 - 1e-6), "nothing rises through the surround");
        assert!(alone.surface.data.iter().any(|w| *w < -0.015), "without a surround it would");
    }
}

#[test]
fn a_solver_that_may_not_iterate_says_that_it_did_not_converge() {
    let mut random = Random(5);
    let setup = Setup { resolution_px: [40, 40], ..Setup::default() };
    for max_iterations in [1, 2, 3] {
        let setup = Setup { elastic: Elastic { max_iterations, ..setup.elastic }, ..setup };
        let rig = setup.solved(Resolution::Full, 0.01).rig();
        let noise: Vec<f64> = (0..200 * 200).map(|_| random.within(-0.2, 0.5)).collect();
        let depth = rig.depth_at(|x, y| noise[y * 200 + x]);
        let contact = rig.pad.press(&depth);
        let numerics = contact.numerics;
        assert!(!numerics.converged && numerics.residual_um.expect("a residual") > 0.01, "{numerics:?}");
        assert!(numerics.iterations <= max_iterations, "{numerics:?}");
        assert!(contact.finite);
    }
}
