//! The layer's response over the frequencies: against a table with 17 digits, and against its limits.

use gelsim_core::gelpad::elastic::layer::ElasticLayer;

/// Poisson ratio, q h, and G, H, C, T times mu / h.
const TABLE: &str = include_str!("data/greens_bonded_layer.csv");

const RATIOS: [f64; 8] = [0.0, 0.1, 0.25, 0.3, 0.45, 0.48, 0.499, 0.4999];

fn responses(layer: ElasticLayer, q: f64) -> [f64; 4] {
    [
        layer.normal_compliance(q),
        layer.tangential_compliance(q),
        layer.coupling_compliance(q),
        layer.transverse_compliance(q),
    ]
}

#[test]
fn greens_functions_agree_with_a_table_of_17_digits() {
    let mut rows = 0;
    let mut worst = [0.0_f64; 4];
    for line in TABLE.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(|text| text.parse().expect("a number")).collect();
        let (nu, s) = (numbers[0], numbers[1]);
        // A thickness that is no power of two, so that q h is rounded like everything else.
        for h in [1.0, 2.7] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: nu };
            let mu = 0.5 / (1.0 + nu);
            for (k, found) in responses(layer, s / h).into_iter().enumerate() {
                // C changes its sign: next to that nothing relative can hold, so G is what it is measured against.
                let scale = if k == 2 { numbers[4].abs().max(1e-3 * numbers[2].abs()) } else { numbers[2 + k] };
                worst[k] = worst[k].max(((found * mu / h - numbers[2 + k]) / scale).abs());
            }
        }
        rows += 1;
    }
    println!("greens: worst relative errors of G, H, C, T: {worst:?}");
    assert!(rows > 200, "{rows} rows");
    assert!(worst.iter().all(|error| *error < 1e-12), "{worst:?}");
}

#[test]
fn at_no_frequency_the_layer_is_a_column_that_cannot_widen_and_a_block_in_shear() {
    for nu in RATIOS {
        for h in [0.05, 3.0, 100.0] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: nu };
            let (column, shear) = (h * (1.0 + nu) * (1.0 - 2.0 * nu) / (1.0 - nu), 2.0 * h * (1.0 + nu));
            // From 0 itself to just above the frequency where the formula takes over: corrections are of order (q h)^2
            // times 1 / (1 - 2 nu), 5000 at most; C is of order q h.
            for s in [0.0, 1e-12, 0.9e-9, 1.1e-9, 1e-8] {
                let [g, t_l, c, t_t] = responses(layer, s / h);
                assert!((g / column - 1.0).abs() < 1e-9, "G at nu {nu}, s {s}: {g}, {column}");
                assert!((t_l / shear - 1.0).abs() < 1e-7 && (t_t / shear - 1.0).abs() < 1e-7, "nu {nu}, s {s}");
                assert!(c.abs() <= 3.0 * h * s.max(1e-9), "C at nu {nu}, s {s}: {c}");
            }
        }
    }
}

#[test]
fn at_high_frequencies_the_layer_is_a_half_space() {
    for nu in RATIOS {
        for h in [0.05, 3.0, 100.0] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: nu };
            for s in [30.0, 1e3, 1e6] {
                let q = s / h;
                let [g, t_l, c, t_t] = responses(layer, q);
                // Johnson (1985), 3.2 and 3.6: the base is felt by exp(-2 s) s^2, below 1e-22.
                let half_space = 2.0 * (1.0 - nu * nu) / q;
                let coupling = (1.0 + nu) * (1.0 - 2.0 * nu) / q;
                assert!(
                    (g / half_space - 1.0).abs() < 1e-12 && (t_l / half_space - 1.0).abs() < 1e-12,
                    "nu {nu}: {g}, {t_l}, {half_space}"
                );
                assert!((t_t * q / (2.0 * (1.0 + nu)) - 1.0).abs() < 1e-12, "nu {nu}: {t_t}");
                // 3 - 4 nu is rounded before 1 is taken from it.
                assert!((c / coupling - 1.0).abs() < 1e-11, "nu {nu}: {c}, {coupling}");
                assert!(
                    (layer.half_space_compliance() / (half_space * q) - 1.0).abs() < 1e-15,
                    "nu {nu}: {half_space}"
                );
            }
        }
    }
}

#[test]
fn responses_are_finite_smooth_and_bounded_at_every_frequency() {
    for nu in RATIOS {
        let layer = ElasticLayer { thickness_mm: 3.0, poisson_ratio: nu };
        let softest = layer.largest_compliance();
        let mut last = responses(layer, 0.0);
        let step = 1.002_f64;
        let mut s = 1e-12;
        while s < 1e6 {
            let now = responses(layer, s / 3.0);
            assert!(now.iter().all(|value| value.is_finite()), "nu {nu}, s {s}: {now:?}");
            let [g, t_l, c, t_t] = now;
            assert!(g > 0.0 && t_l > 0.0 && t_t > 0.0 && g <= softest * (1.0 + 1e-4), "nu {nu}, s {s}: {now:?}");
            // Work is never negative: the 2 x 2 matrix of G, H and C has no negative eigenvalue.
            assert!(c * c <= g * t_l * (1.0 + 1e-12), "nu {nu}, s {s}: {now:?}");
            for k in 0..4 {
                // No function changes faster than s^2 or 1 / s: 0.2 % in s give 0.5 % of it, C of the mean of G and H.
                let scale = if k == 2 { (g * t_l).sqrt() } else { now[k] };
                assert!((now[k] - last[k]).abs() <= 0.005 * scale, "function {k} jumps at nu {nu}, s {s}");
            }
            last = now;
            s *= step;
        }
    }
}

#[test]
fn the_softest_response_is_the_largest_there_is() {
    for nu in RATIOS {
        let layer = ElasticLayer { thickness_mm: 2.5, poisson_ratio: nu };
        let scanned = (0..400_000).map(|k| layer.normal_compliance(f64::from(k) * 1e-4 / 2.5)).fold(0.0, f64::max);
        // Steps of 0.01 around a flat top: off by less than 1e-4 of it.
        assert!(
            (layer.largest_compliance() / scanned - 1.0).abs() < 1e-4,
            "nu {nu}: {} {scanned}",
            layer.largest_compliance()
        );
    }
}
