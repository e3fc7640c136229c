//! In-plane motion of the pad's surface: against a plain f64 Fourier sum on the camera's own pixels with room to spare,
//! against closed forms, and what symmetry asks for.

use std::f64::consts::TAU;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::simd::scalar_only;
use gelsim_core::gelpad::elastic::in_plane::{DisplacementField, InPlaneResponse, Load, TractionField};
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::gelpad::elastic::shear::{Friction, Motion, ShearOutcome, solve_shear};

use super::rig::Setup;
use gelsim_oracle::in_plane::{displacement_by_fourier_sums, least_energy_within_limits};
use gelsim_oracle::shapes::Random;

const VIEW_MM: [f64; 2] = [20.0, 15.0];

/// The view of a common sensor.
fn setup(h: f64, nu: f64) -> Setup {
    Setup {
        resolution_px: [640, 480],
        mm_per_px: [VIEW_MM[0] / 640.0; 2],
        thickness_mm: h,
        poisson_ratio: nu,
        ..Setup::default()
    }
}

fn inplane(setup: &Setup) -> InPlaneResponse {
    let view = std::array::from_fn(|k| setup.resolution_px[k] as f64 * setup.mm_per_px[k]);
    InPlaneResponse::new(setup.layer(), view, setup.mm_per_px)
}

/// The pressure in view under an object.
fn pressed(setup: &Setup, penetration: impl Fn(f64, f64) -> f64) -> Load {
    let rig = setup.rig();
    let contact = rig.pad.press(&rig.depth(penetration));
    let mut pressure = contact.pressure.expect("the pad knows pressures");
    pressure.data.iter_mut().for_each(|p| *p /= setup.youngs_modulus_kpa as f32);
    let origin_mm = std::array::from_fn(|k| 0.5 * (1.0 - setup.resolution_px[k] as f64) * setup.mm_per_px[k]);
    Load { pressure, origin_mm, mm_per_px: setup.mm_per_px }
}

fn ball(radius: f64, deep: f64, [cx, cy]: [f64; 2]) -> impl Fn(f64, f64) -> f64 {
    move |x, y| {
        let left = radius * radius - (x - cx).powi(2) - (y - cy).powi(2);
        if left > 0.0 { deep - radius + left.sqrt() } else { -1.0 }
    }
}

/// A ring with twelve teeth.
fn gear(deep: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| {
        let (r, angle) = (x.hypot(y), y.atan2(x));
        let outer = if (12.0 * angle / TAU).rem_euclid(1.0) < 0.5 { 5.0 } else { 4.0 };
        if r > 2.5 && r < outer { deep } else { -1.0 }
    }
}

fn square(deep: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| if x.abs() < 2.0 && y.abs() < 2.0 { deep } else { -1.0 }
}

fn centre(origin_mm: [f64; 2], mm_per_px: [f64; 2], x: usize, y: usize) -> [f64; 2] {
    [origin_mm[0] + x as f64 * mm_per_px[0], origin_mm[1] + y as f64 * mm_per_px[1]]
}

/// Differences at the load's pixels in um: root of the mean square, the largest, and the largest displacement.
fn errors_um(field: &DisplacementField, origin_mm: [f64; 2], mm_per_px: [f64; 2], truth: &[Grid<f64>; 2]) -> [f64; 3] {
    let (mut sum, mut worst, mut most) = (0.0, 0.0_f64, 0.0_f64);
    let Grid { width, height, .. } = truth[0];
    for y in 0..height {
        for x in 0..width {
            let [u, v] = field.at(centre(origin_mm, mm_per_px, x, y)).map(f64::from);
            let off = (u - truth[0].at(x, y)).hypot(v - truth[1].at(x, y));
            sum += off * off;
            worst = worst.max(off);
            most = most.max(truth[0].at(x, y).hypot(truth[1].at(x, y)));
        }
    }
    [(sum / (width * height) as f64).sqrt(), worst, most].map(|mm| 1e3 * mm)
}

fn largest(field: &DisplacementField) -> f64 {
    field.x.data.iter().zip(&field.y.data).fold(0.0, |most, (u, v)| f64::from(u.hypot(*v)).max(most))
}

/// A load of `width` x `height` pixels around the frame's origin.
fn load(width: usize, height: usize, mm_per_px: [f64; 2], pressure: impl Fn(f64, f64) -> f64) -> Load {
    let origin_mm = [0.5 * (1.0 - width as f64) * mm_per_px[0], 0.5 * (1.0 - height as f64) * mm_per_px[1]];
    let mut grid = Grid::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let [x_mm, y_mm] = centre(origin_mm, mm_per_px, x, y);
            grid.row_mut(y)[x] = pressure(x_mm, y_mm) as f32;
        }
    }
    Load { pressure: grid, origin_mm, mm_per_px }
}

/// A load that pulls only.
fn pull(load: &Load, direction: [f32; 2]) -> TractionField {
    let [x, y] = direction.map(|part| {
        let mut grid = load.pressure.clone();
        grid.data.iter_mut().for_each(|value| *value *= part);
        grid
    });
    TractionField { x, y, origin_mm: load.origin_mm, mm_per_px: load.mm_per_px }
}

fn disc(radius: f64, value: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| if x.hypot(y) < radius { value } else { 0.0 }
}

#[test]
fn displacement_under_pressure_agrees_with_a_fine_grid() {
    for (h, nu) in [(3.0, 0.48), (2.0, 0.4999), (4.0, 0.45)] {
        let setup = setup(h, nu);
        let inplane = inplane(&setup);
        let mut loads = vec![
            ("ball R 1, d 0.35", pressed(&setup, ball(1.0, 0.35, [0.013, -0.4]))),
            ("ball R 4, d 1", pressed(&setup, ball(4.0, 1.0, [3.0, 2.0]))),
            ("ball R 5, d 0.35", pressed(&setup, ball(5.0, 0.35, [-6.0, 0.0]))),
            ("square, d 0.5", pressed(&setup, square(0.5))),
            ("gear, d 0.5", pressed(&setup, gear(0.5))),
        ];
        if !crate::thorough() {
            // Each load in one of the pads.
            let own = if h == 3.0 {
                vec![1, 4]
            } else if h == 2.0 {
                vec![0, 2]
            } else {
                vec![3]
            };
            loads = loads.into_iter().enumerate().filter(|(at, _)| own.contains(at)).map(|(_, load)| load).collect();
        }
        for (name, load) in loads {
            let nothing = Grid::new(load.pressure.width, load.pressure.height);
            let truth = displacement_by_fourier_sums(
                setup.layer(),
                [&load.pressure, &nothing, &nothing],
                load.mm_per_px,
                12.0 * h,
            );
            let [rms, worst, most] = errors_um(&inplane.under_pressure(&load), load.origin_mm, load.mm_per_px, &truth);
            println!("in plane: h {h}, nu {nu}, {name}: {rms:.3} um RMS, {worst:.2} largest, of {most:.1} um");
            assert!(rms < 0.6 && worst < 10.0 && most > 5.0, "{name}: {rms}, {worst}, {most}");
        }
    }
}

#[test]
fn displacement_under_tractions_agrees_with_a_fine_grid() {
    for (h, nu) in [(3.0, 0.48), (2.0, 0.0)] {
        let setup = setup(h, nu);
        let mm_per_px = [0.0625; 2];
        let load = load(320, 240, mm_per_px, |x, y| disc(2.0, 0.05)(x - 1.03, y + 2.0) + disc(1.0, 0.04)(x + 5.0, y));
        let traction = pull(&load, [1.0, -0.4]);
        let nothing = Grid::new(320, 240);
        let truth =
            displacement_by_fourier_sums(setup.layer(), [&nothing, &traction.x, &traction.y], mm_per_px, 12.0 * h);
        let field = inplane(&setup).under_traction(&traction);
        let [rms, worst, most] = errors_um(&field, load.origin_mm, mm_per_px, &truth);
        println!("in plane: h {h}, nu {nu}, pulled: {rms:.3} um RMS, {worst:.2} largest, of {most:.1} um");
        assert!(rms < 0.6 && worst < 4.0 && most > 100.0, "{rms}, {worst}, {most}");
    }
}

#[test]
fn a_ball_drives_the_pad_outward_evenly_all_around() {
    for (nu, deep) in [(0.4999, 0.35), (0.4999, 1.0), (0.48, 0.35), (0.48, 1.0)] {
        let setup = setup(3.0, nu);
        let load = pressed(&setup, ball(4.0, deep, [0.0; 2]));
        let field = inplane(&setup).under_pressure(&load);
        let mut farthest = 0.0_f64;
        for r in [1.0, 2.0, 3.0, 4.0, 6.0] {
            let parts: Vec<[f64; 2]> = (0..48)
                .map(|k| {
                    let (sin, cos) = (f64::from(k) / 48.0 * TAU).sin_cos();
                    let [u, v] = field.at([r * cos, r * sin]).map(|mm| 1e3 * f64::from(mm));
                    [u * cos + v * sin, v * cos - u * sin]
                })
                .collect();
            let (low, high) =
                parts.iter().fold((f64::MAX, f64::MIN), |(low, high), [u, _]| (low.min(*u), high.max(*u)));
            let across = parts.iter().fold(0.0_f64, |most, [_, v]| most.max(v.abs()));
            assert!(high - low < 1.0 && across < 0.5, "nu {nu}, r {r}: {low} to {high}, {across} across");
            assert!(low > 0.0, "nu {nu}, r {r}: {low} is inward");
            farthest = farthest.max(high);
        }
        let most = 1e3 * largest(&field);
        println!(
            "in plane: ball R 4, h 3, nu {nu}, d {deep}: {most:.0} um at most, {farthest:.0} um at 1, 2, 3, 4 or 6 mm"
        );
    }
}

#[test]
fn around_a_point_a_half_space_moves_inward_and_a_thin_incompressible_layer_outward() {
    let mm_per_px = [0.05; 2];
    let point = load(5, 5, mm_per_px, |x, y| disc(0.01, 1.0)(x, y));
    let force = 0.05 * 0.05;
    for nu in [0.0, 0.2, 0.4] {
        let thick = InPlaneResponse::new(ElasticLayer { thickness_mm: 60.0, poisson_ratio: nu }, [10.0; 2], mm_per_px);
        let field = thick.under_pressure(&point);
        for r in [1.0, 2.0] {
            let expected = -(1.0 - 2.0 * nu) * (1.0 + nu) * force / (TAU * r);
            let found = f64::from(field.at([0.0, r])[1]);
            println!("in plane: half-space, nu {nu}, r {r}: {:.4} of Boussinesq's", found / expected);
            assert!((found / expected - 1.0).abs() < 0.03, "nu {nu}, r {r}: {found}, {expected}");
        }
    }
    let thin = InPlaneResponse::new(ElasticLayer { thickness_mm: 1.0, poisson_ratio: 0.4999 }, [10.0; 2], mm_per_px);
    assert!(thin.under_pressure(&point).at([0.0, 1.0])[1] > 0.0);
}

#[test]
fn a_wide_even_traction_shears_the_layer_as_a_block() {
    for (h, nu) in [(0.5, 0.48), (0.5, 0.1), (1.0, 0.4999)] {
        let inplane =
            InPlaneResponse::new(ElasticLayer { thickness_mm: h, poisson_ratio: nu }, [20.0, 15.0], [0.05; 2]);
        let wide = load(400, 300, [0.05; 2], |_, _| 0.01);
        let [u, v] = inplane.under_traction(&pull(&wide, [1.0, -2.0])).at([0.1, 0.2]);
        let expected = 0.01 * h * 2.0 * (1.0 + nu);
        let errors = [f64::from(u) / expected - 1.0, f64::from(v) / expected / -2.0 - 1.0];
        assert!(errors.iter().all(|error| error.abs() < 5e-3), "h {h}, nu {nu}: {errors:?}");
    }
}

fn noise(seed: u64, width: usize, height: usize, mm_per_px: [f64; 2]) -> Load {
    let mut random = Random(seed);
    let mut load = load(width, height, mm_per_px, |_, _| 0.0);
    load.pressure.data.iter_mut().for_each(|p| *p = (random.unit() - 0.3).max(0.0) as f32);
    load
}

fn largest_difference(a: &DisplacementField, b: &DisplacementField) -> f64 {
    let off =
        |a: &Grid<f32>, b: &Grid<f32>| a.data.iter().zip(&b.data).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
    f64::from(off(&a.x, &b.x).max(off(&a.y, &b.y)))
}

#[test]
fn displacement_is_linear_continuous_and_symmetric() {
    let layer = ElasticLayer { thickness_mm: 2.0, poisson_ratio: 0.48 };
    let inplane = InPlaneResponse::new(layer, [8.0; 2], [0.05; 2]);
    let load = noise(5, 60, 60, [0.05; 2]);
    let field = inplane.under_pressure(&load);
    let size = largest(&field);
    assert_eq!(scalar_only(|| inplane.under_pressure(&load)), field);
    let changed = |change: &dyn Fn(&Load) -> Load| inplane.under_pressure(&change(&load));

    let mut twice = field.clone();
    twice.add(&field);
    let doubled = changed(&|load| {
        let mut load = load.clone();
        load.pressure.data.iter_mut().for_each(|p| *p *= 2.0);
        load
    });
    assert!(largest_difference(&twice, &doubled) <= 1e-6 * size, "{}", largest_difference(&twice, &doubled));

    let moved = changed(&|load| Load { origin_mm: load.origin_mm.map(|mm| mm + 1e-6), ..load.clone() });
    assert!(largest_difference(&field, &moved) < 1e-5 * size, "{} of {size}", largest_difference(&field, &moved));

    let mapped = |from: &dyn Fn(usize, usize) -> (usize, usize)| {
        changed(&|load| {
            let mut out = load.clone();
            for y in 0..60 {
                for x in 0..60 {
                    let (there_x, there_y) = from(x, y);
                    out.pressure.row_mut(y)[x] = load.pressure.at(there_x, there_y);
                }
            }
            out
        })
    };
    let (mirrored, turned) = (mapped(&|x, y| (59 - x, y)), mapped(&|x, y| (y, 59 - x)));
    for point in [[1.0, 0.3], [-2.0, 3.5], [0.4, -1.7]] {
        let [u, v] = field.at(point);
        let [mu, mv] = mirrored.at([-point[0], point[1]]);
        // What stood at (y, -x) stands at (x, y) now: turned from x towards y.
        let [tu, tv] = turned.at([-point[1], point[0]]);
        let off = (u + mu).abs().max((v - mv).abs()).max((u - tv).abs()).max((v + tu).abs());
        assert!(f64::from(off) < 1e-5 * size, "{point:?}: {off} of {size}");
    }
}

#[test]
fn an_interpolated_field_is_continuous_and_goes_on_beyond_its_border() {
    let field = InPlaneResponse::new(ElasticLayer { thickness_mm: 2.0, poisson_ratio: 0.48 }, [8.0, 6.0], [0.05; 2])
        .under_pressure(&noise(6, 80, 60, [0.05; 2]));
    let size = largest(&field) as f32;
    for k in 0..400 {
        let point = [-5.0 + 0.025 * f64::from(k), 0.37];
        let ([u, v], [next_u, next_v]) = (field.at(point), field.at([point[0] + 1e-7, point[1]]));
        assert!((u - next_u).abs().max((v - next_v).abs()) < 1e-5 * size, "{point:?}");
    }
    for k in [2, 7, 20] {
        let place = centre(field.origin_mm, [field.spacing_mm; 2], k, k);
        let off = (field.at(place)[0] - field.x.at(k, k)).abs().max((field.at(place)[1] - field.y.at(k, k)).abs());
        assert!(off < 1e-5 * size, "{off}");
    }
    assert_eq!(field.at([100.0, 0.0]), field.at([1000.0, 0.0]));
    let corner = centre(field.origin_mm, [field.spacing_mm; 2], 1, 1);
    assert!(corner[0] < -4.0 && corner[1] < -3.0, "the field ends in view");
}

#[test]
fn hard_inputs_give_numbers() {
    let motion = Motion { shift_mm: [0.3, -0.2], twist_rad: 0.1, about_mm: [0.1, 0.0] };
    for h in [0.05, 3.0, 1000.0] {
        for (size, pitch) in [([1, 1], [0.03; 2]), ([37, 53], [0.1, 0.25]), ([211, 3], [0.01, 0.3])] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: 0.4999 };
            let inplane = InPlaneResponse::new(layer, [0, 1].map(|k| size[k] as f64 * pitch[k]), pitch);
            let one =
                load(size[0], size[1], pitch, |x, y| if x.abs() < pitch[0] && y.abs() < pitch[1] { 0.1 } else { 0.0 });
            let beyond = Load { origin_mm: [1e9, -1e9], ..one.clone() };
            let loads = [
                Load { pressure: Grid::default(), ..one.clone() },
                load(size[0], size[1], pitch, |_, _| 0.0),
                load(size[0], size[1], pitch, |_, _| 0.1),
                load(2 * size[0], 2 * size[1], pitch, |_, _| 0.1),
                one,
                beyond,
            ];
            for (k, load) in loads.iter().enumerate() {
                let mut field = inplane.under_pressure(load);
                for friction in [Friction::Stick, Friction::Coulomb { coefficient: 0.5 }] {
                    let (traction, outcome) = solve_shear(layer, load, motion, friction);
                    field.add(&inplane.under_traction(&traction));
                    assert!(outcome.converged, "h {h}, {size:?}, load {k}: {outcome:?}");
                    assert!(outcome.force.iter().all(|part| part.is_finite()), "{outcome:?}");
                }
                let finite = |grid: &Grid<f32>| grid.data.iter().all(|value| value.is_finite());
                assert!(finite(&field.x) && finite(&field.y), "h {h}, {size:?}, load {k}");
                assert!(field.at([0.0, 1e300]).iter().all(|value| value.is_finite()));
            }
        }
    }
}

fn shift(x: f64, y: f64) -> Motion {
    Motion { shift_mm: [x, y], ..Motion::default() }
}

fn force(load: &Load) -> f64 {
    load.pressure.data.iter().map(|p| f64::from(*p)).sum::<f64>() * load.mm_per_px[0] * load.mm_per_px[1]
}

/// A pad as good as a half-space, of nu 0, under a ball's pressure: contact radius 1 mm, highest pressure 0.1.
fn hertz() -> (ElasticLayer, Load) {
    let pressure = |x: f64, y: f64| 0.1 * (1.0 - x * x - y * y).max(0.0).sqrt();
    (ElasticLayer { thickness_mm: 100.0, poisson_ratio: 0.0 }, load(64, 64, [0.04; 2], pressure))
}

#[test]
fn a_disc_that_sticks_is_as_stiff_as_mindlin_and_reissner_say() {
    for (thickness_mm, pitch) in [(100.0, 0.04), (100.0, 0.02), (1000.0, 0.01)] {
        let layer = ElasticLayer { thickness_mm, poisson_ratio: 0.0 };
        let count = (2.4 / pitch) as usize;
        let disc = load(count, count, [pitch; 2], disc(1.0, 0.1));
        // Mu is 1/2: 4 mu a delta, and 16/3 mu a^3 theta.
        let (_, pulled) = solve_shear(layer, &disc, shift(0.1, 0.0), Friction::Stick);
        let (_, twisted) = solve_shear(layer, &disc, Motion { twist_rad: 0.1, ..Motion::default() }, Friction::Stick);
        let [force, moment] = [pulled.force[0] / 0.2, twisted.moment / (0.8 / 3.0)];
        println!("shear: disc, pitch {pitch}: force {force:.4}, moment {moment:.4}, {} iterations", pulled.iterations);
        assert!((force - 1.0).abs() < 0.04 && (moment - 1.0).abs() < 0.06, "{force}, {moment}");
        assert!(pulled.force[1].abs() < 1e-3 && pulled.iterations < 15, "{pulled:?}");
    }
}

#[test]
fn a_ball_under_shear_slips_in_the_ring_of_cattaneo_and_mindlin() {
    let (layer, load) = hertz();
    let (coefficient, normal) = (0.5, force(&load));
    // Mindlin's shift at which everything slips; mu is 1/2.
    let whole = 3.0 * coefficient * normal / 4.0;
    for share in [0.2, 0.5, 0.8] {
        let (_, outcome) = solve_shear(layer, &load, shift(share * whole, 0.0), Friction::Coulomb { coefficient });
        let pulled = outcome.force[0] / (coefficient * normal);
        let expected = 1.0 - (1.0_f64 - share).powf(1.5);
        let (stuck, stuck_expected) = ((1.0 - outcome.slipping).sqrt(), (1.0 - expected).cbrt());
        println!("shear: ball, {share}: force {pulled:.4}, {expected:.4}; stuck to {stuck:.4}, {stuck_expected:.4}");
        assert!(outcome.converged, "{outcome:?}");
        assert!((pulled - expected).abs() < 0.03, "{pulled}, {expected}");
        assert!((stuck - stuck_expected).abs() < 0.05, "{stuck}, {stuck_expected}");
    }
}

#[test]
fn friction_has_its_two_limits_and_a_contact_that_slips_pulls_with_its_whole_force() {
    let (layer, load) = hertz();
    let motion = Motion { shift_mm: [0.02, 0.01], twist_rad: 0.01, about_mm: [0.2, 0.1] };
    let stick = solve_shear(layer, &load, motion, Friction::Stick);
    assert!(stick.1.slipping == 0.0 && stick.1.converged, "{:?}", stick.1);
    assert_eq!(scalar_only(|| solve_shear(layer, &load, motion, Friction::Stick)), stick);
    assert_eq!(solve_shear(layer, &load, motion, Friction::Coulomb { coefficient: 1e9 }), stick);
    let (traction, outcome) = solve_shear(layer, &load, motion, Friction::Coulomb { coefficient: 0.0 });
    assert!(traction.x.data.iter().chain(&traction.y.data).all(|t| *t == 0.0));
    assert!(outcome.force == [0.0; 2] && outcome.slipping == 1.0 && outcome.converged, "{outcome:?}");
    let (_, outcome) = solve_shear(layer, &load, shift(3.0, 4.0), Friction::Coulomb { coefficient: 0.5 });
    let whole = 0.5 * force(&load);
    assert!(
        (outcome.force[0] / whole - 0.6).abs() < 1e-3 && (outcome.force[1] / whole - 0.8).abs() < 1e-3,
        "{outcome:?}"
    );
    assert_eq!(outcome.slipping, 1.0);
}

/// Displacements of a few pixels under tractions in them, as a matrix: entries 2k and 2k + 1 are pixel k's parts.
fn dense(layer: ElasticLayer, pixels: &[[usize; 2]], pitch: f64) -> Vec<Vec<f64>> {
    let size = 64;
    let middle = size / 2;
    let (mut one, zero) = (Grid::new(size, size), Grid::new(size, size));
    one.row_mut(middle)[middle] = 1.0;
    let under =
        |load: [&Grid<f32>; 3]| displacement_by_fourier_sums(layer, load, [pitch; 2], 20.0 * layer.thickness_mm);
    let kernel = [under([&zero, &one, &zero]), under([&zero, &zero, &one])];
    let entry = |row: usize, column: usize| {
        let (to, from) = (pixels[row / 2], pixels[column / 2]);
        kernel[column % 2][row % 2].at(middle + to[0] - from[0], middle + to[1] - from[1])
    };
    let count = 2 * pixels.len();
    (0..count).map(|row| (0..count).map(|column| entry(row, column)).collect()).collect()
}

#[test]
fn tractions_agree_with_dense_matrices() {
    let (layer, pitch) = (ElasticLayer { thickness_mm: 1.0, poisson_ratio: 0.48 }, 0.1);
    // Two blobs, one of them larger.
    let blob = |x: f64, y: f64| 0.2 * (0.3 - x * x - 2.0 * y * y).max(0.0).sqrt();
    let load = load(16, 16, [pitch; 2], |x, y| blob(x + 0.2, y + 0.2) + blob(1.5 * (x - 0.45), 2.0 * (y - 0.5)));
    let pixels: Vec<[usize; 2]> =
        (0..256).map(|k| [k % 16, k / 16]).filter(|[x, y]| load.pressure.at(*x, *y) > 0.0).collect();
    let matrix = dense(layer, &pixels, pitch);
    let motion = Motion { shift_mm: [0.06, 0.02], twist_rad: 0.1, about_mm: [0.1, -0.2] };
    let places = pixels.iter().map(|[x, y]| centre(load.origin_mm, load.mm_per_px, *x, *y));
    let wanted: Vec<f64> = places.flat_map(|[x, y]| [0.06 - 0.1 * (y + 0.2), 0.02 + 0.1 * (x - 0.1)]).collect();
    for (friction, factor) in [(Friction::Stick, 1e9), (Friction::Coulomb { coefficient: 2.0 }, 2.0)] {
        let limits: Vec<f64> = pixels.iter().map(|[x, y]| factor * f64::from(load.pressure.at(*x, *y))).collect();
        let truth = least_energy_within_limits(&matrix, &wanted, &limits);
        let (traction, outcome) = solve_shear(layer, &load, motion, friction);
        let ShearOutcome { force, slipping, iterations, .. } = outcome;
        let corner = [0, 1].map(|k| ((traction.origin_mm[k] - load.origin_mm[k]) / pitch).round() as usize);
        let found = pixels
            .iter()
            .flat_map(|[x, y]| [&traction.x, &traction.y].map(|part| f64::from(part.at(x - corner[0], y - corner[1]))));
        let (off, all) = found.zip(&truth).fold((0.0, 0.0), |(off, all), (a, b)| (off + (a - b).powi(2), all + b * b));
        let sum = [0, 1].map(|k| truth.iter().skip(k).step_by(2).sum::<f64>() * pitch * pitch);
        let (error, count) = ((off / all).sqrt(), pixels.len());
        println!(
            "shear: {friction:?}, {count} pixels: off by {error:.4}, {slipping:.2} slips, {iterations} iterations"
        );
        assert!(error < 0.05, "{error}");
        assert!((force[0] - sum[0]).hypot(force[1] - sum[1]) < 0.02 * sum[0].hypot(sum[1]), "{force:?}, {sum:?}");
        assert!(outcome.converged && (factor > 1e3 || (slipping > 0.1 && slipping < 0.9)), "{outcome:?}");
    }
}

#[test]
fn what_sticks_goes_where_the_object_goes() {
    let setup = setup(3.0, 0.48);
    let inplane = inplane(&setup);
    let objects = [
        ("ball R 4, d 0.6", pressed(&setup, ball(4.0, 0.6, [1.0, 2.0]))),
        ("ball R 1, d 0.05", pressed(&setup, ball(1.0, 0.05, [1.0, 2.0]))),
        ("square, d 0.5", pressed(&setup, square(0.5))),
        ("gear, d 0.5", pressed(&setup, gear(0.5))),
    ];
    for (name, load) in objects {
        for friction in [Friction::Stick, Friction::Coulomb { coefficient: 0.5 }] {
            let motion = Motion { shift_mm: [0.3, 0.1], twist_rad: 0.05, about_mm: [1.0, 2.0] };
            let (traction, outcome) = solve_shear(setup.layer(), &load, motion, friction);
            let field = inplane.under_traction(&traction);
            let (mut sum, mut count) = (0.0, 0);
            for y in 0..load.pressure.height {
                for x in (0..load.pressure.width).filter(|x| load.pressure.at(*x, y) > 0.0) {
                    let place = centre(load.origin_mm, load.mm_per_px, x, y);
                    let [u, v] = field.at(place).map(f64::from);
                    let wanted = [0.3 - 0.05 * (place[1] - 2.0), 0.1 + 0.05 * (place[0] - 1.0)];
                    sum += (u - wanted[0]).powi(2) + (v - wanted[1]).powi(2);
                    count += 1;
                }
            }
            let rms = 1e3 * (sum / f64::from(count)).sqrt();
            let ShearOutcome { iterations, slipping, .. } = outcome;
            println!("shear: {name}, {friction:?}: {rms:.1} um RMS off, {slipping:.2} slips, {iterations} iterations");
            assert!(outcome.converged, "{outcome:?}");
            // A contact only a few values of the field wide is blurred.
            let accepted = if name.starts_with("ball R 1") { 40.0 } else { 10.0 };
            assert!(friction != Friction::Stick || rms < accepted, "{name}: {rms}");
        }
    }
}

#[test]
fn a_pull_gives_a_force_along_it_and_mirrors_with_it() {
    let (layer, load) = hertz();
    let friction = Friction::Coulomb { coefficient: 0.3 };
    let (right, first) = solve_shear(layer, &load, shift(0.02, 0.0), friction);
    let (down, second) = solve_shear(layer, &load, shift(0.0, 0.02), friction);
    assert!(first.force[0] > 0.0 && first.force[1].abs() < 1e-3 * first.force[0], "{first:?}");
    assert!(
        (first.force[0] / second.force[1] - 1.0).abs() < 2e-3 && first.iterations == second.iterations,
        "{first:?} {second:?}"
    );
    let most = right.x.data.iter().fold(0.0_f32, |most, t| most.max(*t));
    for y in 0..right.x.height {
        for x in 0..right.x.width {
            assert!((right.x.at(x, y) - down.y.at(y, x)).abs() < 0.02 * most, "{x}, {y}");
        }
    }
}

#[test]
fn friction_reads_as_it_is_written_in_a_job() {
    let read = |text: &str| serde_json::from_str::<Friction>(text).ok();
    assert_eq!(read("\"stick\""), Some(Friction::default()));
    assert_eq!(read("{\"coulomb\": {\"coefficient\": 0.5}}"), Some(Friction::Coulomb { coefficient: 0.5 }));
    assert_eq!(read("{\"coulomb\": {\"coefficient\": 0.5, \"other\": 1}}"), None);
}
