//! What must not break the elastic pad: any penetration on any grid, any pad.

use gelsim_core::base::grid::Resolution;
use proptest::prelude::*;

use super::rig::{NOTHING, RESOLUTIONS, Setup};
use gelsim_oracle::shapes::Random;

/// Kinds of penetration, in units of its depth, by column and row of a window.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Bumps,
    Noise,
    Stripes,
    Checkerboard,
    /// Single pixels scattered over the window.
    Salt,
    /// One pixel in the view's corner.
    Corner,
    Empty,
    Full,
    Ring,
    /// Just touching all over.
    Graze,
}

const KINDS: [Kind; 10] = [
    Kind::Bumps,
    Kind::Noise,
    Kind::Stripes,
    Kind::Checkerboard,
    Kind::Salt,
    Kind::Corner,
    Kind::Empty,
    Kind::Full,
    Kind::Ring,
    Kind::Graze,
];

fn penetration(kind: Kind, size: [usize; 2], margin: usize, seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    let (width, height) = (size[0] + 2 * margin, size[1] + 2 * margin);
    let bumps: Vec<[f64; 4]> = (0..5)
        .map(|_| {
            let place = |random: &mut Random, k: usize| margin as f64 + random.within(0.0, size[k] as f64);
            let (x, y) = (place(&mut random, 0), place(&mut random, 1));
            [x, y, random.within(1.0, 15.0), random.within(0.1, 1.0)]
        })
        .collect();
    let period = 2 + random.below(5);
    let mut values = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            values.push(match kind {
                Kind::Bumps => {
                    let one = |[u, v, r, d]: &[f64; 4]| d - ((x as f64 - u).powi(2) + (y as f64 - v).powi(2)) / (r * r);
                    bumps.iter().map(one).fold(NOTHING, f64::max)
                }
                Kind::Noise => random.within(-1.0, 1.0),
                Kind::Stripes => {
                    if (x / (period / 2)).is_multiple_of(2) {
                        1.0
                    } else {
                        -0.1
                    }
                }
                Kind::Checkerboard => {
                    if (x + y).is_multiple_of(2) {
                        1.0
                    } else {
                        NOTHING
                    }
                }
                Kind::Salt => {
                    if random.unit() < 0.02 {
                        random.within(0.0, 1.0)
                    } else {
                        NOTHING
                    }
                }
                Kind::Corner => {
                    if (x, y) == (margin, margin) {
                        1.0
                    } else {
                        NOTHING
                    }
                }
                Kind::Empty => NOTHING,
                Kind::Full => 1.0,
                Kind::Ring => {
                    let away = (x as f64 - width as f64 / 2.0).hypot(y as f64 - height as f64 / 2.0);
                    if (5.0..7.5).contains(&away) { 1.0 } else { -0.3 }
                }
                Kind::Graze => random.within(-1e-6, 1e-6),
            });
        }
    }
    values
}

fn setups() -> impl Strategy<Value = (Setup, f64)> {
    let size = prop_oneof![4 => 1_usize..41, 1 => Just(1_usize)];
    // Logarithms: thickness 0.05 to 100 mm, pixels 0.001 to 10 mm.
    let pitch = -3.0..1.0_f64;
    let ratio = prop_oneof![3 => 0.0..0.4999_f64, 1 => Just(0.4999), 1 => Just(0.0)];
    let resolution =
        prop_oneof![2 => Just(Resolution::Full), 1 => Just(Resolution::Half), 1 => Just(Resolution::Quarter)];
    (size.clone(), size, -1.3..2.0_f64, pitch, -0.5..0.5_f64, ratio, resolution, 0.001..1.0_f64).prop_map(
        |(width, height, h, pitch, stretch, poisson_ratio, resolution, strain)| {
            let thickness_mm = 10.0_f64.powf(h);
            let pixel = 10.0_f64.powf(pitch);
            // Not beyond the pad, and no steeper from pixel to pixel than a needle.
            let deep = strain * (0.5 * thickness_mm).min(5.0 * pixel);
            let setup = Setup {
                resolution_px: [width, height],
                mm_per_px: [pixel, (pixel * 10.0_f64.powf(stretch)).clamp(0.001, 10.0)],
                thickness_mm,
                poisson_ratio,
                ..Setup::default()
            };
            (setup.solved(resolution, 1.0), deep)
        },
    )
}

/// Presses, and says what is wrong with the result.
fn check(setup: Setup, kind: Kind, deep: f64, seed: u64) -> Result<u32, String> {
    let rig = setup.rig();
    let margin = rig.margin_px();
    let width = setup.resolution_px[0] + 2 * margin;
    let values = penetration(kind, setup.resolution_px, margin, seed);
    let depth = rig.depth_at(|x, y| deep * values[y * width + x]);
    let contact = rig.pad.press(&depth);
    let what = || format!("{setup:?}, {kind:?}, deep {deep}, seed {seed}: {:?}", contact.numerics);
    let fails = |text: &str| Err(format!("{text}: {}", what()));
    if !contact.finite || !contact.surface.data.iter().all(|w| w.is_finite()) {
        return fails("not finite");
    }
    let h = setup.thickness_mm as f32;
    if let Some(w) = contact.surface.data.iter().find(|w| w.abs() > h) {
        return fails(&format!("the surface leaves the pad at {w}"));
    }
    let pressures = contact.pressure.iter().flat_map(|p| &p.data);
    if pressures.clone().any(|p| !p.is_finite() || *p < 0.0) {
        return fails("a pressure that cannot be");
    }
    let residual = contact.numerics.residual_um.unwrap_or(f64::NAN);
    let tolerance = setup.elastic.tolerance_um;
    if contact.numerics.converged != (residual <= 2.0 * tolerance * (1.0 + 1e-6)) {
        return fails("converged or not, the residual says otherwise");
    }
    for (y, row) in contact.surface.data.chunks_exact(contact.surface.width).enumerate() {
        for (x, w) in row.iter().enumerate() {
            if *w < depth.penetration.at(x + margin - 1, y + margin - 1) {
                return fails("the object goes through the surface");
            }
        }
    }
    if !contact.numerics.converged {
        return fails("did not converge");
    }
    Ok(contact.numerics.iterations)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: if crate::thorough() { 1500 } else { 400 },
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn any_penetration_on_any_grid_in_any_pad_is_solved((setup, deep) in setups(), kind in 0..KINDS.len(), seed: u64) {
        if let Err(text) = check(setup, KINDS[kind], deep, seed) {
            prop_assert!(false, "{}", text);
        }
    }
}

#[test]
fn every_kind_of_penetration_is_solved_on_the_smallest_and_the_thinnest_grids() {
    const PADS: [(f64, f64); 5] = [(3.0, 0.03), (0.05, 10.0), (100.0, 0.001), (0.05, 0.04), (2.0, 0.7)];
    let (mut most, mut grids) = (0, 0);
    for kind in KINDS {
        for resolution_px in [[1, 1], [2, 2], [3, 4], [5, 1], [1, 97], [37, 41]] {
            for resolution in RESOLUTIONS {
                // All pads on every grid, or one after the other.
                grids += 1;
                let pads = if crate::thorough() { &PADS[..] } else { &PADS[grids % PADS.len()..][..1] };
                for &(thickness_mm, pixel) in pads {
                    let setup = Setup {
                        resolution_px,
                        mm_per_px: [pixel, pixel],
                        thickness_mm,
                        poisson_ratio: 0.4999,
                        ..Setup::default()
                    };
                    // The second is no normal float any more.
                    for deep in [0.2 * thickness_mm.min(4.0 * pixel), 1e-40] {
                        match check(setup.solved(resolution, 1.0), kind, deep, 9) {
                            Ok(iterations) => most = most.max(iterations),
                            Err(text) => panic!("{text}"),
                        }
                    }
                }
            }
        }
    }
    println!("hard cases: at most {most} iterations");
}

/// By rounding, corners of a turned object that rests on the pad lie below it, here far beyond the view alone.
#[test]
fn an_object_that_rests_on_the_pad_beyond_the_view_gives_an_untouched_image() {
    for fidelity in ["draft", "standard", "high"] {
        let plan = crate::plan::plan(&format!(
            r#"
            fidelity = "{fidelity}"
            dataset = {{ name = "resting", samples = 400, seed = 3248140416527614 }}
            sensor = {{ resolution_px = [24, 18], field_of_view_mm = [0.5, 91.92155141063164], gelpad_poisson_ratio = 0.0 }}
            indentation.depth_mm = 0.0
            object = [{{ path = "objects/cube.obj" }}]
            [pose]
            yaw_deg = {{ log_uniform = [125.11247484922211, 3384.95981367093] }}
            tilt_deg = -90.0
            tilt_azimuth_deg = [-1757.0228170662745, 2410.4912835645337]
            face = "any"
            anchor = "contact"
            x_mm = [-7.75532763417857, 8.815531300383366]
            y_mm = [-8.0, 9.0]
            "#
        ));
        for index in 0..400 {
            let sample = gelsim_job::sample::render(&plan, index);
            assert!(!sample.label.contact.in_contact, "{fidelity}, {index}: {:?}", sample.label.contact);
            assert_eq!(sample.impression.image.rgb, sample.simulator.untouched().rgb, "{fidelity}, {index}");
        }
    }
}
