//! Sheets of effects: for each one that a job's samples enable, the image with it, the same image without it, and the
//! difference. Noise depends on sample and pixel alone, so both images have the same noise and the difference has none.

use image::RgbImage;
use rayon::prelude::*;

use super::canvas::{GAP, amplify_difference};
use super::image_to_rgb;
use super::rows::{self, SheetRow};
use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;

/// An image with and without an effect.
pub struct EffectComparison {
    /// The effect.
    pub effect: Effect,
    /// Number of the sample.
    index: u64,
    /// Why the effect ran.
    reason: String,
    with: RgbImage,
    without: RgbImage,
}

/// Compares images with and without each effect that ran in any of the samples `indices`, for the first sample in which
/// it ran.
pub fn compare_effect_images(plan: &Plan, indices: &[u64]) -> Vec<EffectComparison> {
    let ran = find_first_runs(plan, indices);
    let compared = ran.into_par_iter().map(|(effect, index, reason, with)| {
        let other = plan.with_policy(EffectPolicy::Without(effect));
        EffectComparison { effect, index, reason, with, without: image_to_rgb(&render(&other, index).impression.image) }
    });
    compared.collect()
}

/// Finds the first sample in which each effect ran: effect, sample, the reason, and the image.
fn find_first_runs(plan: &Plan, indices: &[u64]) -> Vec<(Effect, u64, String, RgbImage)> {
    /// Samples that are rendered at once.
    const BLOCK: usize = 8;
    let mut ran = Vec::new();
    let mut missing = Effect::ALL.to_vec();
    for block in indices.chunks(BLOCK) {
        let samples: Vec<_> = block.par_iter().map(|&index| (index, render(plan, index))).collect();
        for (index, sample) in samples {
            let notes = &sample.label.effects;
            let new = missing.iter().filter(|effect| notes[**effect].ran);
            ran.extend(new.map(|&effect| {
                (effect, index, notes[effect].reason.to_string(), image_to_rgb(&sample.impression.image))
            }));
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
    /// Changes of all values by the effect, grey levels.
    fn value_changes(&self) -> impl Iterator<Item = i32> {
        self.with.iter().zip(self.without.iter()).map(|(with, without)| i32::from(*with) - i32::from(*without))
    }

    /// Largest change, and mean size of the changes, grey levels.
    fn change_size(&self) -> (u32, f64) {
        let sizes = || self.value_changes().map(i32::unsigned_abs);
        let count = self.with.len().max(1) as f64;
        (sizes().max().unwrap_or_default(), sizes().map(f64::from).sum::<f64>() / count)
    }
}

/// Returns the largest gain with which changes up to `largest` levels stay in range.
fn choose_gain(largest: u32) -> i32 {
    [16, 8, 4, 2].into_iter().find(|gain| gain * largest <= 127).unwrap_or(1) as i32
}

/// Widest panel with which a sheet of three columns is at most 2000 px wide.
pub const WIDEST_PANEL: u32 = (2000 - GAP) / 3 - GAP;

/// Draws comparisons one below the other. Pictures are at most `panel_width` px wide.
pub fn draw_effect_sheet(comparisons: &[EffectComparison], panel_width: u32) -> RgbImage {
    let row = |comparison: &EffectComparison| {
        let (largest, mean) = comparison.change_size();
        let gain = choose_gain(largest);
        let EffectComparison { effect, index, reason, with, without } = comparison;
        SheetRow {
            panels: vec![with.clone(), without.clone(), amplify_difference(without, with, gain)],
            captions: vec![
                (0, format!("{} #{index}: {reason}", effect.name())),
                (2, format!("x {gain}, mean {mean:.2}, largest {largest}")),
            ],
        }
    };
    let titles = ["all effects", "without this one", "grey + gain x change, levels"];
    rows::draw_row_sheet(&titles, comparisons.iter().map(row).collect(), panel_width)
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
        let (largest, mean) = comparison.change_size();
        assert_eq!((largest, mean), (30, 45.0 / 24.0));
        let difference = amplify_difference(&comparison.without, &comparison.with, choose_gain(largest));
        assert_eq!(difference.get_pixel(1, 1).0, [128 + 4 * 30, 128, 128 - 4 * 15]);
        assert_eq!(difference.get_pixel(0, 1).0, [128; 3]);
        assert_eq!([0, 7, 8, 15, 16, 31, 32, 63, 64, 255].map(choose_gain), [16, 16, 8, 8, 4, 4, 2, 2, 1, 1]);
    }

    #[test]
    fn pictures_keep_their_size_unless_the_sheet_gets_too_wide() {
        let sized = |width, height| comparison(RgbImage::new(width, height), RgbImage::new(width, height));
        let width = |picture: u32| draw_effect_sheet(&[sized(picture, 30)], WIDEST_PANEL).width();
        assert_eq!(width(640), 3 * 646 + 6);
        assert_eq!(width(4000), width(WIDEST_PANEL));
        assert!(width(4000) <= 2000);
        assert_eq!(width(1), width(196), "room for text");
        let two = [sized(640, 30), sized(640, 30)];
        assert_eq!(draw_effect_sheet(&two, WIDEST_PANEL).height(), 2 * (30 + CAPTION + GAP) + CAPTION + GAP);
        assert_eq!(draw_effect_sheet(&[], WIDEST_PANEL).height(), CAPTION + GAP);
    }
}
