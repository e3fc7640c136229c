//! Whole presses against closed forms: pads so thick that they are half-spaces, and so thin that they are films.

use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::Contact;

use super::reference_solutions as reference;
use super::rig::{NOTHING, RESOLUTIONS, Rig, Setup};

const YOUNG: f64 = 100.0;

/// A square view of `size` px of pitch 1 / `per_mm` mm on a pad 20 m thick: its base takes away some a / h = 1e-4 of what
/// the surface gives.
fn half_space(size: usize, per_mm: f64, resolution: Resolution) -> Rig {
    let setup = Setup {
        resolution_px: [size; 2],
        mm_per_px: [1.0 / per_mm; 2],
        thickness_mm: 20_000.0,
        poisson_ratio: 0.3,
        youngs_modulus_kpa: YOUNG,
        ..Setup::default()
    };
    setup.solved(resolution, 0.05).rig()
}

const STIFFNESS: f64 = YOUNG / (1.0 - 0.3 * 0.3);

fn force(contact: &Contact) -> f64 {
    1e3 * contact.force_n.expect("the pad knows forces")
}

fn peak(contact: &Contact) -> f64 {
    contact.peak_pressure_kpa.expect("the pad knows pressures")
}

/// The radius of a disc as large as the contact.
fn radius(contact: &Contact, rig: &Rig) -> f64 {
    let touching = contact.mask.data.iter().filter(|value| **value == 255).count();
    (touching as f64 * rig.setup.mm_per_px[0] * rig.setup.mm_per_px[1] / std::f64::consts::PI).sqrt()
}

/// Relative error of the force, of the peak pressure, and error of the radius in px, against `expected`.
fn errors(contact: &Contact, rig: &Rig, expected: reference::Round) -> [f64; 3] {
    assert!(contact.numerics.converged, "{:?}", contact.numerics);
    let far = (radius(contact, rig) - expected.radius) / rig.setup.mm_per_px[0];
    [force(contact) / expected.force - 1.0, peak(contact) / expected.peak - 1.0, far]
}

/// Largest error of the surface in view, um.
fn surface_error(contact: &Contact, rig: &Rig, expected: impl Fn(f64) -> f64) -> f64 {
    let size = contact.surface.width;
    let place = |at: usize| (at as f64 + 0.5 - size as f64 / 2.0) * rig.setup.mm_per_px[0];
    let mut worst = 0.0_f64;
    for y in 0..size {
        for x in 0..size {
            let error = f64::from(contact.surface.at(x, y)) - expected(place(x).hypot(place(y)));
            worst = worst.max(1e3 * error.abs());
        }
    }
    worst
}

fn paraboloid(curvature_radius: f64, deep: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| deep - (x * x + y * y) / (2.0 * curvature_radius)
}

#[test]
fn a_sphere_on_a_thick_pad_is_hertzs() {
    // On every fourth pixel the peak is 1.3 % high: the rest carries what the contact's edge cuts off the interpolated pressure.
    let bounds = [[1e-3, 1e-2, 1.0], [1e-3, 1e-2, 2.0], [1e-2, 1.5e-2, 4.0]];
    for (resolution, bounds) in RESOLUTIONS.into_iter().zip(bounds) {
        // Contact radius 2 mm = 32 px.
        let rig = half_space(128, 16.0, resolution);
        let contact = rig.press(paraboloid(10.0, 0.4));
        let found = errors(&contact, &rig, reference::hertz(STIFFNESS, 10.0, 0.4));
        let surface = surface_error(&contact, &rig, |r| reference::hertz_surface(10.0, 0.4, r));
        println!(
            "hertz, {resolution:?}: force {:.1e}, peak {:.1e}, radius {:.2} px, surface {surface:.3} um",
            found[0], found[1], found[2]
        );
        assert!(found.iter().zip(bounds).all(|(error, bound)| error.abs() < bound), "{resolution:?}: {found:?}");
        // Of 400 um, at the rim of the contact.
        assert!(surface < 5.0, "{resolution:?}: surface off by {surface} um");
    }
}

#[test]
fn a_cone_on_a_thick_pad_is_sneddons() {
    let rig = half_space(128, 16.0, Resolution::Full);
    let contact = rig.press(|x, y| 0.6 - 0.2 * x.hypot(y));
    let found = errors(&contact, &rig, reference::cone(STIFFNESS, 0.2, 0.6));
    println!("cone: force {:.1e}, radius {:.2} px", found[0], found[2]);
    // The apex lies between pixels: 0.7 px from the nearest.
    assert!(found[0].abs() < 5e-3 && found[2].abs() < 1.0, "{found:?}");
}

#[test]
fn a_flat_punch_on_a_thick_pad_is_boussinesqs() {
    let mut last = f64::INFINITY;
    for (per_mm, bound) in [(4.0, 2e-3), (8.0, 2e-3), (16.0, 2e-3), (32.0, 1e-3)] {
        let rig = half_space((6.0 * per_mm) as usize, per_mm, Resolution::Full);
        let contact = rig.press(|x, y| if x.hypot(y) <= 2.0 { 0.2 } else { NOTHING });
        // The disc of pixels is not quite as large as the disc; its own radius is what counts.
        let a = radius(&contact, &rig);
        let expected = reference::punch(STIFFNESS, a, 0.2);
        let found = errors(&contact, &rig, expected);
        println!("punch, radius {:.0} px ({a:.4} mm): force {:.2e}", 2.0 * per_mm, found[0]);
        assert!(found[0].abs() < bound, "{per_mm} px/mm: {found:?}");
        assert!(found[0].abs() < last, "finer pixels must do better");
        last = found[0].abs();
        if per_mm == 32.0 {
            let surface = surface_error(&contact, &rig, |r| {
                // Within 3 px of the edge the slope is infinite.
                if (r - 2.0).abs() < 3.0 / per_mm { f64::NAN } else { reference::punch_surface(2.0, 0.2, r) }
            });
            println!("punch, surface: {surface:.2} um");
            assert!(surface < 1.0, "{surface}");
        }
    }
}

#[test]
fn a_long_cylinder_on_a_thick_pad_is_hertzs_line_contact() {
    let setup = Setup {
        resolution_px: [96, 640],
        mm_per_px: [1.0 / 16.0, 1.0 / 8.0],
        thickness_mm: 20_000.0,
        poisson_ratio: 0.3,
        youngs_modulus_kpa: YOUNG,
        ..Setup::default()
    };
    let rig = setup.solved(Resolution::Full, 0.05).rig();
    // 60 mm long, some 3.4 mm wide: in its middle the ends are felt by (width / length)^2 = 0.3 %.
    let contact = rig.press(|x, y| if y.abs() < 30.0 { 0.6 - x * x / (2.0 * 10.0) } else { NOTHING });
    let pressure = contact.pressure.as_ref().expect("pressures");
    let middle = pressure.row(320);
    let load = middle.iter().map(|p| f64::from(*p)).sum::<f64>() / 16.0;
    let width = middle.iter().filter(|p| **p > 0.0).count() as f64 / 16.0;
    let highest = middle.iter().fold(0.0_f32, |max, p| max.max(*p));
    let [half, peak] = reference::long_cylinder(STIFFNESS, 10.0, load);
    println!("line: half-width {:.4} for {half:.4} mm, peak {highest:.3} for {peak:.3} kPa", width / 2.0);
    assert!((width / 2.0 - half).abs() < 1.0 / 16.0, "{width} {half}");
    assert!((f64::from(highest) / peak - 1.0).abs() < 5e-3, "{highest} {peak}");
}

/// A square view of `size` px, 4 px to the thickness of 1 mm.
fn film(size: usize, nu: f64) -> Rig {
    let setup = Setup {
        resolution_px: [size; 2],
        mm_per_px: [0.25; 2],
        thickness_mm: 1.0,
        poisson_ratio: nu,
        youngs_modulus_kpa: YOUNG,
        ..Setup::default()
    };
    setup.solved(Resolution::Full, 0.01).rig()
}

#[test]
fn a_sphere_on_a_thin_incompressible_pad_squeezes_it_like_a_film() {
    let mut last = f64::INFINITY;
    for (wide, ratio) in [(11.0, 1.15), (21.0, 1.04), (42.0, 1.01)] {
        // a^2 = 4 R d; at 1 - 2 nu = 2e-7 what the pad gives in volume is felt over 1300 thicknesses only.
        let deep = 0.05;
        let curvature = wide * wide / (4.0 * deep);
        let rig = film((8.0 * wide * 1.25) as usize, 0.499_999_9);
        let contact = rig.press(paraboloid(curvature, deep));
        let expected = reference::thin_incompressible(YOUNG / 2.999_999_8, 1.0, curvature, deep);
        let found = force(&contact) / expected.force;
        let [_, peak, radius] = errors(&contact, &rig, expected);
        println!(
            "film, a/h {wide}: force ratio {found:.4}, peak {peak:.3}, radius {radius:.2} px, {:?}",
            contact.numerics
        );
        assert!((found - ratio).abs() < 0.02, "a/h {wide}: {found} instead of {ratio}");
        assert!((found - 1.0).abs() < last, "wider contacts are nearer to a film");
        last = (found - 1.0).abs();
    }
}

#[test]
fn a_sphere_on_a_thin_compressible_pad_presses_columns() {
    let mut last = f64::INFINITY;
    for (wide, bound) in [(11.0, 0.08), (21.0, 0.04), (42.0, 0.02)] {
        let deep = 0.05;
        let curvature = wide * wide / (2.0 * deep);
        let rig = film((8.0 * wide * 1.25) as usize, 0.3);
        let contact = rig.press(paraboloid(curvature, deep));
        let expected = reference::thin_compressible(reference::column(YOUNG, 0.3), 1.0, curvature, deep);
        let [found, peak, radius] = errors(&contact, &rig, expected);
        println!("columns, a/h {wide}: force {found:.4}, peak {peak:.4}, radius {radius:.2} px");
        assert!(found.abs() < bound && peak.abs() < 0.01, "a/h {wide}: {found} {peak}");
        assert!(found.abs() < last, "wider contacts are nearer to columns");
        last = found.abs();
    }
}
