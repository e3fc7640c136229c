//! Sheets of effects: for each one that a job's samples call for the image with it, the same image without it, and the
//! difference. Noise is addressed by sample and pixel: both images have the same, and the difference has none.

use image::RgbImage;
use rayon::prelude::*;

use super::canvas::{GAP, difference};
use super::picture;
use super::rows::{self, Row};
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;

/// What an effect changes in one sample.
pub struct EffectComparison {
    /// The effect.
    pub effect: Effect,
    /// The sample's number.
    index: u64,
    /// Why the effect ran.
    reason: String,
    with: RgbImage,
    without: RgbImage,
}

/// A comparison for each effect that ran in any of the samples `indices`, from the first in which it did.
pub fn compare(plan: &Plan, indices: &[u64]) -> Vec<EffectComparison> {
    let ran = first_runs(plan, indices);
    let compared = ran.into_par_iter().map(|(effect, index, reason, with)| {
        let other = plan.with_policy(EffectPolicy::Without(effect));
        EffectComparison { effect, index, reason, with, without: picture(&render(&other, index).impression.image) }
    });
    compared.collect()
}

/// Each effect with the first sample in which it ran, why it did, and that sample's image.
fn first_runs(plan: &Plan, indices: &[u64]) -> Vec<(Effect, u64, String, RgbImage)> {
    /// Samples that are rendered at a time.
    const BLOCK: usize = 8;
    let mut ran = Vec::new();
    let mut missing = Effect::ALL.to_vec();
    for block in indices.chunks(BLOCK) {
        let samples: Vec<_> = block.par_iter().map(|&index| (index, render(plan, index))).collect();
        for (index, sample) in samples {
            let notes = &sample.label.effects;
            let new = missing.iter().filter(|effect| notes[**effect].ran);
            ran.extend(
                new.map(|&effect| (effect, index, notes[effect].reason.to_string(), picture(&sample.impression.image))),
            );
            missing.retain(|effect| !notes[*effect].ran);
        }
        if missing.is_empty() {
            break;
        }
    }
    ran.sort_by_key(|(effect, ..)| *effect as usize);
    ran
}

impl EffectComparison {
    /// Changes of all values, grey levels.
    fn changes(&self) -> impl Iterator<Item = i32> {
        self.with.iter().zip(self.without.iter()).map(|(with, without)| i32::from(*with) - i32::from(*without))
    }

    /// Largest change and mean of the changes' sizes, grey levels.
    fn size(&self) -> (u32, f64) {
        let sizes = || self.changes().map(i32::unsigned_abs);
        let count = self.with.len().max(1) as f64;
        (sizes().max().unwrap_or_default(), sizes().map(f64::from).sum::<f64>() / count)
    }
}

/// The strongest gain with which a change of this many levels stays in range.
fn gain(largest: u32) -> i32 {
    [16, 8, 4, 2].into_iter().find(|gain| gain * largest <= 127).unwrap_or(1) as i32
}

/// Widest panel with which a sheet is at most 2000 px wide.
pub const PANEL: u32 = (2000 - GAP) / 3 - GAP;

/// Lays comparisons out one below the other; pictures are made `panel_width` px wide at the most.
pub fn sheet(comparisons: &[EffectComparison], panel_width: u32) -> RgbImage {
    let row = |comparison: &EffectComparison| {
        let (largest, mean) = comparison.size();
        let gain = gain(largest);
        let EffectComparison { effect, index, reason, with, without } = comparison;
        Row {
            panels: vec![with.clone(), without.clone(), difference(without, with, gain)],
            captions: vec![
                (0, format!("{} #{index}: {reason}", effect.name())),
                (2, format!("x {gain}, mean {mean:.2}, largest {largest}")),
            ],
        }
    };
    let titles = ["all effects", "without this one", "grey + gain x change, levels"];
    rows::sheet(&titles, comparisons.iter().map(row).collect(), panel_width)
}

#[cfg(test)]
mod tests {
    use super::super::canvas::CAPTION;
    use super::*;
    use image::Rgb;

    fn comparison(with: RgbImage, without: RgbImage) -> EffectComparison {
        EffectComparison { effect: Effect::Grain, index: 3, reason: String::from("rough"), with, without }
    }

    #[test]
    fn a_difference_is_shown_around_grey_as_strongly_as_it_fits() {
        let without = RgbImage::from_pixel(4, 2, Rgb([100, 50, 200]));
        let mut with = without.clone();
        with.put_pixel(1, 1, Rgb([130, 50, 185]));
        let comparison = comparison(with, without);
        let (largest, mean) = comparison.size();
        assert_eq!((largest, mean), (30, 45.0 / 24.0));
        let difference = difference(&comparison.without, &comparison.with, gain(largest));
        assert_eq!(difference.get_pixel(1, 1).0, [128 + 4 * 30, 128, 128 - 4 * 15]);
        assert_eq!(difference.get_pixel(0, 1).0, [128; 3]);
        assert_eq!([0, 7, 8, 15, 16, 31, 32, 63, 64, 255].map(gain), [16, 16, 8, 8, 4, 4, 2, 2, 1, 1]);
    }

    #[test]
    fn pictures_keep_their_size_unless_the_sheet_gets_too_wide() {
        let sized = |width, height| comparison(RgbImage::new(width, height), RgbImage::new(width, height));
        let width = |picture: u32| sheet(&[sized(picture, 30)], PANEL).width();
        assert_eq!(width(640), 3 * 646 + 6);
        assert_eq!(width(4000), width(PANEL));
        assert!(width(4000) <= 2000);
        assert_eq!(width(1), width(196), "room for text");
        let two = [sized(640, 30), sized(640, 30)];
        assert_eq!(sheet(&two, PANEL).height(), 2 * (30 + CAPTION + GAP) + CAPTION + GAP);
        assert_eq!(sheet(&[], PANEL).height(), CAPTION + GAP);
    }
}
