//! The colours of a table against Taxim's formulas in plain f64.

use std::f64::consts::PI;

use gelsim_core::base::simd::{scalar_only, simd_dispatch};
use gelsim_core::optics::calibrated::taxim::{LookupScratch, TaximCalibration, TaximLookup};

use super::folder::{self, BINS, SIZE};

/// Red, green and blue of the made-up calibration.
pub fn colours() -> TaximCalibration {
    let polynomials = [0, 1, 2].map(|plane| {
        folder::grades(plane).as_chunks::<6>().0.iter().map(|polynomial| polynomial.map(|v| v as f32)).collect()
    });
    TaximCalibration { bins: BINS, resolution_px: SIZE, polynomials }
}

/// Steepness and direction in bins, with their fractions; the place in the calibration's picture.
pub fn bins(taxim: &TaximCalibration, slope: [f64; 2]) -> [f64; 2] {
    let steps = (taxim.bins - 1) as f64;
    let steepness = slope[0].hypot(slope[1]).atan() / (0.5 * PI / steps);
    [steepness, (slope[1].atan2(slope[0]) + PI) / (2.0 * PI / steps)]
}

/// What a bin gives at a place, grey levels.
pub fn polynomial(taxim: &TaximCalibration, bin: [usize; 2], [x, y]: [f64; 2]) -> [f64; 3] {
    let features = [x * x, y * y, x * y, x, y, 1.0];
    taxim.polynomials.each_ref().map(|all| {
        let terms = all[bin[0] * taxim.bins + bin[1]].iter().zip(features);
        terms.map(|(factor, feature)| f64::from(*factor) * feature).sum()
    })
}

fn rows(lookup: &TaximLookup, y: usize, x0: usize, slopes: [&[f32]; 2]) -> [Vec<f32>; 3] {
    let mut change = [(); 3].map(|()| vec![f32::NAN; slopes[0].len()]);
    let mut scratch = LookupScratch::default();
    let [red, green, blue] = &mut change;
    simd_dispatch(
        #[inline(always)]
        || lookup.compute_row_change(y, x0, slopes, &mut scratch, [red, green, blue]),
    );
    change
}

/// Slopes of every size and direction, the axes and level ground among them.
fn slopes(count: usize) -> [Vec<f32>; 2] {
    let sizes = [0.0, 1e-30, 1e-6, 1e-3, 0.05, 0.3, 1.0, 4.0, 20.0, 1e3];
    let value = |at: usize, axis: usize| match folder::made_up(3 * at) {
        along if along < -0.9 => (sizes[at % 10] * (at % 3) as f64 - sizes[at % 10]) as f32,
        _ => (sizes[at / 7 % 10] * folder::made_up(5 * at + axis)) as f32,
    };
    [0, 1].map(|axis| (0..count).map(|at| value(at, axis)).collect())
}

#[test]
fn colours_are_those_of_a_plain_loop_in_f64() {
    let taxim = colours();
    taxim.validate().expect("valid");
    let lookup = TaximLookup::new(&taxim, SIZE);
    let [along, across] = slopes(24_000);
    let (mut worst, mut at_edges, mut bins_seen) = (0.0_f64, 0, std::collections::BTreeSet::new());
    for (row, (along, across)) in along.chunks(SIZE[0]).zip(across.chunks(SIZE[0])).enumerate() {
        let y = row % SIZE[1];
        let change = rows(&lookup, y, 0, [along, across]);
        for x in 0..SIZE[0] {
            let slope = [f64::from(along[x]), f64::from(across[x])];
            let [steepness, direction] = bins(&taxim, slope);
            let found: [f64; 3] = std::array::from_fn(|channel| change[channel][x].into());
            let off = |steepness: f64, direction: f64| {
                let bin = [steepness, direction].map(|at| at as usize);
                let expected = polynomial(&taxim, bin, [x as f64, y as f64]);
                (0..3).map(|c| (expected[c] * steepness.min(1.0) - found[c]).abs()).fold(0.0, f64::max)
            };
            bins_seen.insert([steepness as usize, direction as usize]);
            let mut error = off(steepness, direction);
            let is_edge = |at: f64| (at - at.round()).abs() < 1e-5;
            if error > 1e-3 && (is_edge(steepness) || is_edge(direction)) {
                at_edges += 1;
                let beside = [(1e-5, 0.0), (-1e-5, 0.0), (0.0, 1e-5), (0.0, -1e-5)];
                error = beside.map(|(s, d)| off(steepness + s, direction + d)).into_iter().fold(error, f64::min);
            }
            worst = worst.max(error);
        }
    }
    println!("worst {worst:.1e} levels, {at_edges} at a bin's edge, {} bins", bins_seen.len());
    assert!(worst < 1e-3, "{worst} levels");
    assert!(at_edges < 5, "{at_edges}");
    assert!(bins_seen.len() >= 49, "{}", bins_seen.len());
}

#[test]
fn the_axes_fall_into_the_bins_into_which_taxim_puts_them() {
    // 9 bins have edges at all of them; what `floor((arctan2(..) + pi) / (2 pi / 8))` gives.
    let taxim = TaximCalibration {
        bins: 9,
        resolution_px: [1, 1],
        polynomials: [(); 3].map(|()| (0..81).map(|bin| [0.0, 0.0, 0.0, 0.0, 0.0, bin as f32]).collect()),
    };
    let lookup = TaximLookup::new(&taxim, [1, 1]);
    let bin = |slope: [f32; 2]| rows(&lookup, 0, 0, [&[slope[0]], &[slope[1]]])[1][0] as usize;
    for size in [0.3_f64, 0.7] {
        let steepness = (size.atan() / (PI / 16.0)) as usize;
        let size = size as f32;
        for (slope, direction) in
            [([1.0, 0.0], 4), ([0.0, 1.0], 6), ([-1.0, 0.0], 8), ([0.0, -1.0], 2), ([-1.0, -1e-6], 0)]
        {
            assert_eq!(bin(slope.map(|share: f32| share * size)), 9 * steepness + direction, "{slope:?}");
        }
    }
    assert_eq!(bin([-0.3, -0.0]), bin([-0.3, 0.0]));
    assert_eq!(bin([f32::MAX, 0.0]), 9 * 8 + 4);
}

#[test]
fn nothing_changes_where_the_surface_is_flat_and_little_where_it_nearly_is() {
    let taxim = colours();
    let lookup = TaximLookup::new(&taxim, SIZE);
    let flat = rows(&lookup, 3, 0, [&[0.0; 24], &[-0.0; 24]]);
    assert!(flat.iter().flatten().all(|change| *change == 0.0));
    for levels in [1e-3, 0.4, 3.0, 1e9] {
        let slope = lookup.unseen_slope(levels) as f32;
        assert!(slope > 0.0);
        let mut largest = 0.0_f32;
        for turn in 0..64 {
            let (sine, cosine) = (f64::from(turn) * PI / 32.0).sin_cos();
            let slopes = [cosine, sine].map(|share| [share as f32 * slope * 0.999_999; 24]);
            for y in 0..SIZE[1] {
                let change = rows(&lookup, y, 0, slopes.each_ref().map(<[f32; 24]>::as_slice));
                largest = change.iter().flatten().fold(largest, |largest, change| largest.max(change.abs()));
            }
        }
        assert!(f64::from(largest) <= levels, "{largest} > {levels}");
        assert!(levels > 1e6 || f64::from(largest) > 0.3 * levels.min(30.0), "{largest} of {levels}");
    }
}

#[test]
fn a_part_of_a_row_is_as_in_the_whole_row_on_every_processor() {
    let lookup = TaximLookup::new(&colours(), [40, 10]);
    let [along, across] = slopes(40);
    let whole = rows(&lookup, 7, 0, [&along, &across]);
    assert_eq!(scalar_only(|| rows(&lookup, 7, 0, [&along, &across])), whole);
    let part = rows(&lookup, 7, 11, [&along[11..32], &across[11..32]]);
    for (part, whole) in part.iter().zip(&whole) {
        assert_eq!(part, &whole[11..32]);
    }
}

#[test]
fn at_another_resolution_the_calibrations_picture_is_stretched() {
    let taxim = colours();
    let slopes: [&[f32]; 2] = [&[0.5; 3], &[0.2; 3]];
    // Three pixels of 72 stand for one of 24; the middle one has its centre.
    let fine = rows(&TaximLookup::new(&taxim, [72, 48]), 3 * 5 + 1, 3 * 9, slopes);
    let own = rows(&TaximLookup::new(&taxim, SIZE), 5, 9, [&slopes[0][..1], &slopes[1][..1]]);
    for (fine, own) in fine.iter().zip(&own) {
        assert!((fine[1] - own[0]).abs() < 1e-3 && (fine[0] - fine[2]).abs() > 0.01, "{fine:?} {own:?}");
    }
}

#[test]
fn a_table_that_is_not_valid_is_refused_with_a_reason() {
    let good = colours();
    let refused = |change: &dyn Fn(&mut TaximCalibration)| {
        let mut taxim = good.clone();
        change(&mut taxim);
        taxim.validate().expect_err("refused")
    };
    assert!(refused(&|taxim| taxim.bins = 1).contains("allowed: 2 to 1024"));
    assert!(refused(&|taxim| taxim.bins = usize::MAX).contains("allowed"));
    assert!(refused(&|taxim| taxim.resolution_px[1] = 0).contains("24x0"));
    assert!(refused(&|taxim| taxim.polynomials[2].truncate(63)).contains("63 polynomials of blue for 8 x 8 bins"));
    for bad in [f32::NAN, f32::INFINITY, 3e38] {
        let message = refused(&|taxim| taxim.polynomials[1][17][3] = bad);
        assert!(message.contains("of green in bin 2 of steepness, 1 of direction"), "{message}");
    }
}
