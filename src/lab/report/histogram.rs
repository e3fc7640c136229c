//! Histograms of numbers whose range is not known beforehand, in constant memory.
//!
//! Bins are multiples of a power of two: the smallest with which all values fit into 1024 bins. If the range grows,
//! bins are joined in pairs, which is exact. So the counts depend on the values alone, in whatever order and parts they
//! are counted.

use std::collections::BTreeMap;

use crate::page::bars::Bar;
use gelsim_job::layout::Split;

/// Most bins.
const BINS: i64 = 1024;

/// One count per split.
pub type PerSplit = [u64; Split::ALL.len()];

/// Number, sum and range of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistogramSummary {
    /// Number of values.
    pub count: u64,
    /// Sum of the values.
    pub sum: f64,
    /// Smallest value; infinite without values.
    pub least: f64,
    /// Largest value; minus infinite without values.
    pub largest: f64,
}

impl Default for HistogramSummary {
    fn default() -> Self {
        Self { count: 0, sum: 0.0, least: f64::INFINITY, largest: f64::NEG_INFINITY }
    }
}

impl HistogramSummary {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.least = self.least.min(other.least);
        self.largest = self.largest.max(other.largest);
    }

    /// Mean; none without values.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

/// Counts of values by bin and split.
#[derive(Clone, Debug)]
pub struct Histogram {
    /// Smallest binary logarithm of the bins' width that is allowed: 0 for integers.
    finest: i32,
    /// Binary logarithm of the bins' width.
    exponent: i32,
    counts: BTreeMap<i64, PerSplit>,
    summaries: [HistogramSummary; Split::ALL.len()],
}

impl Histogram {
    /// Creates an empty histogram of any numbers.
    pub fn continuous() -> Self {
        Self { finest: i32::MIN, exponent: i32::MIN, counts: BTreeMap::new(), summaries: Default::default() }
    }

    /// Creates an empty histogram of integers, with bins at least 1 wide.
    pub fn integer() -> Self {
        Self { finest: 0, exponent: 0, ..Self::continuous() }
    }

    /// Counts a value, which must be finite.
    pub fn count_value(&mut self, split: Split, value: f64) {
        let summary = &mut self.summaries[split.number()];
        summary.add(&HistogramSummary { count: 1, sum: value, least: value, largest: value });
        self.widen_bins();
        self.counts.entry(bin_index(value, self.exponent)).or_default()[split.number()] += 1;
    }

    /// Adds the values of another histogram of the same kind.
    pub fn merge(&mut self, mut other: Self) {
        for (summary, more) in self.summaries.iter_mut().zip(&other.summaries) {
            summary.add(more);
        }
        self.widen_bins();
        other.join_bins(self.exponent);
        for (bin, counts) in other.counts {
            add_counts(self.counts.entry(bin).or_default(), &counts);
        }
    }

    /// Widens the bins as far as the range of the values needs.
    fn widen_bins(&mut self) {
        let HistogramSummary { least, largest, count, .. } = self.total_summary();
        if count > 0 {
            self.join_bins(bin_exponent(least, largest).max(self.finest));
        }
    }

    /// Joins bins until they are 2^`exponent` wide. Does nothing if they are that wide or wider.
    fn join_bins(&mut self, exponent: i32) {
        if exponent > self.exponent {
            let shift = exponent.saturating_sub(self.exponent).min(63);
            for (bin, counts) in std::mem::take(&mut self.counts) {
                add_counts(self.counts.entry(bin >> shift).or_default(), &counts);
            }
            self.exponent = exponent;
        }
    }

    /// Number, sum and range of all values.
    pub fn total_summary(&self) -> HistogramSummary {
        let mut all = HistogramSummary::default();
        self.summaries.iter().for_each(|summary| all.add(summary));
        all
    }

    /// Number, sum and range of the values of one split.
    pub fn split_summary(&self, split: Split) -> &HistogramSummary {
        &self.summaries[split.number()]
    }

    /// Joins neighbouring bins into at most `most` bars of one width, so that little of the last bar lies beyond the
    /// largest value. Empty without values.
    pub fn to_bars(&self, most: usize) -> Vec<Bar<{ Split::ALL.len() }>> {
        let (Some((&first, _)), Some((&last, _))) = (self.counts.first_key_value(), self.counts.last_key_value())
        else {
            return Vec::new();
        };
        let (span, most) = (last - first + 1, most.max(1) as i64);
        let fewest = span.div_euclid(most) + i64::from(span.rem_euclid(most) > 0);
        let overhang = |together: &i64| (together - span.rem_euclid(*together)).rem_euclid(*together);
        // A last bar that is mostly empty would look like a drop. At most twice the width: still wider bars would show
        // too little.
        let widths = || fewest..=(2 * fewest).min(span);
        let full = widths().find(|together| 8 * overhang(together) <= *together);
        let together = full.or_else(|| widths().min_by_key(overhang)).unwrap_or(1);
        // An integer belongs in the middle of its bar.
        let offset = if self.finest == 0 { 0.5 } else { 0.0 };
        let edge = |bin: i64| libm::scalbn(bin as f64, self.exponent) - offset;
        let bars = (first..=last).step_by(together as usize).map(|from| {
            let mut counts = PerSplit::default();
            self.counts.range(from..from + together).for_each(|(_, more)| add_counts(&mut counts, more));
            Bar { from: edge(from), to: edge(from + together), counts }
        });
        bars.collect()
    }
}

/// Adds counts per split.
pub fn add_counts(sum: &mut PerSplit, counts: &PerSplit) {
    sum.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
}

/// Index of the bin of a value, for bins that are 2^`exponent` wide.
fn bin_index(value: f64, exponent: i32) -> i64 {
    libm::floor(libm::scalbn(value, exponent.saturating_neg())) as i64
}

/// Binary logarithm of the smallest width with which a range fits into [`BINS`] bins and every bin's index is exact in
/// an f64.
fn bin_exponent(least: f64, largest: f64) -> i32 {
    let logarithm = |value: f64| if value > 0.0 { libm::ilogb(value) } else { -1074 };
    let exact = logarithm(least.abs().max(largest.abs())) - 52;
    // Halved before the subtraction: the range itself may overflow.
    let near = logarithm(largest / 2.0 - least / 2.0) - 10;
    (exact.max(near).max(-1074)..)
        .find(|exponent| bin_index(largest, *exponent) - bin_index(least, *exponent) < BINS)
        .unwrap_or(i32::MAX)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn filled(values: &[(f64, usize)], mut histogram: Histogram) -> Histogram {
        values.iter().for_each(|(value, split)| histogram.count_value(Split::ALL[*split], *value));
        histogram
    }

    fn value() -> impl Strategy<Value = f64> {
        prop_oneof![
            -1.0..1.0,
            0.0..360.0,
            Just(0.0),
            Just(0.3),
            -1e300..1e300,
            1e-310..1e-300,
            (0..40).prop_map(f64::from)
        ]
    }

    proptest! {
        #[test]
        fn counts_sum_up_and_every_value_is_in_the_bar_that_holds_it(
            values in prop::collection::vec((value(), 0..3_usize), 1..60), most in 1..40_usize,
        ) {
            let histogram = filled(&values, Histogram::continuous());
            prop_assert!(histogram.counts.len() as i64 <= BINS);
            let bars = histogram.to_bars(most);
            prop_assert!(!bars.is_empty() && bars.len() <= most);
            prop_assert!(bars.windows(2).all(|pair| pair[0].to == pair[1].from));
            for split in 0..3 {
                let sum: u64 = bars.iter().map(|bar| bar.counts[split]).sum();
                prop_assert_eq!(sum, values.iter().filter(|(_, of)| *of == split).count() as u64);
            }
            for bar in &bars {
                let inside = |(value, _): &&(f64, usize)| *value >= bar.from && *value < bar.to;
                prop_assert_eq!(values.iter().filter(inside).count() as u64, bar.counts.iter().sum::<u64>());
            }
        }

        #[test]
        fn order_and_division_do_not_matter(
            values in prop::collection::vec((value(), 0..3_usize), 0..60), cut in 0..60_usize,
        ) {
            let all_values = filled(&values, Histogram::continuous());
            let (first, rest) = values.split_at(cut.min(values.len()));
            for (a, b) in [(first, rest), (rest, first)] {
                let mut merged = filled(a, Histogram::continuous());
                merged.merge(filled(b, Histogram::continuous()));
                prop_assert_eq!(&merged.counts, &all_values.counts);
                prop_assert_eq!(merged.to_bars(20), all_values.to_bars(20));
                let (merged, all_values) = (merged.total_summary(), all_values.total_summary());
                prop_assert_eq!((merged.count, merged.least, merged.largest), (all_values.count, all_values.least, all_values.largest));
                prop_assert!((merged.sum - all_values.sum).abs() <= 1e-9 * values.iter().map(|(v, _)| v.abs()).sum::<f64>());
            }
        }
    }

    #[test]
    fn bars_fill_their_range_and_whole_numbers_are_in_the_middle_of_theirs() {
        let turns: Vec<(f64, usize)> = (0..3600).map(|k| (0.1 * f64::from(k), k as usize % 3)).collect();
        let bars = filled(&turns, Histogram::continuous()).to_bars(30);
        assert_eq!((bars.len(), bars[0].from, bars[29].to), (30, 0.0, 360.0));
        assert!(bars.iter().all(|bar| bar.counts.iter().sum::<u64>() == 120), "{bars:?}");
        let dice: Vec<(f64, usize)> = (3..9).map(|k| (f64::from(k), 0)).collect();
        let bars = filled(&dice, Histogram::integer()).to_bars(30);
        let ends: Vec<(f64, f64)> = bars.iter().map(|bar| (bar.from, bar.to)).collect();
        assert_eq!((ends.len(), ends[0], ends[5]), (6, (2.5, 3.5), (7.5, 8.5)));
    }

    #[test]
    fn no_values_and_equal_values_have_bars_without_a_range() {
        assert!(
            Histogram::continuous().to_bars(30).is_empty() && Histogram::continuous().total_summary().mean().is_none()
        );
        for value in [0.0, 0.3, -1e300, 5e-324] {
            let histogram = filled(&[(value, 2); 7], Histogram::continuous());
            assert_eq!(histogram.to_bars(30).len(), 1, "{value}");
            assert_eq!((histogram.total_summary().least, histogram.total_summary().largest), (value, value));
            assert_eq!(histogram.split_summary(Split::Test).count, 7);
        }
    }
}
