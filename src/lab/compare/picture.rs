//! Real and simulated images side by side, with their difference around grey.

use image::RgbImage;

use super::{Comparison, ImageRow, images_of};
use crate::preview::difference;
use crate::preview::rows::{self, Row};
use gelsim_files::diagnostic::Report;

/// Width of a panel, px, at most.
const PANEL: u32 = 640;
/// The same of a sheet of several sensors, whose images may be of several sizes.
const SMALL_PANEL: u32 = 320;
/// Sensors that a sheet shows at most.
const MOST_SENSORS: usize = 20;

/// Titles of the columns of [`row`]s.
const TITLES: [&str; 3] = ["real", "simulated", "grey + 4 x (simulated - real)"];
/// What the difference is multiplied by.
const GAIN: i32 = 4;

/// Real image, simulated image, and four times their difference around grey; `caption` stands below. The images are of
/// one size.
pub fn row(caption: String, real: &RgbImage, sim: &RgbImage) -> Row {
    Row { panels: vec![real.clone(), sim.clone(), difference(real, sim, GAIN)], captions: vec![(0, caption)] }
}

/// Rows below each other; pictures are made `panel_width` px wide at the most.
pub fn sheet(rows: Vec<Row>, panel_width: u32) -> RgbImage {
    rows::sheet(&TITLES, rows, panel_width)
}

/// Best, median and worst pair of every sensor by the MAE of the contact, or of the whole image where a pair of the
/// sensor has no contact. None without pairs; the files are read again.
pub fn best_median_worst(comparison: &Comparison) -> Result<Option<RgbImage>, Report> {
    let mut rows = Vec::new();
    for sensor in comparison.sensors.iter().take(MOST_SENSORS) {
        let of_sensor: Vec<&ImageRow> = comparison.images.iter().filter(|row| row.sensor == sensor.sensor).collect();
        for (row, rank) in chosen(of_sensor) {
            let [real, sim] = images_of(row)?;
            rows.push(self::row(caption(row, rank), &real, &sim));
        }
    }
    let width = if comparison.sensors.len() > 1 { SMALL_PANEL } else { PANEL };
    Ok((!rows.is_empty()).then(|| sheet(rows, width)))
}

fn chosen(mut rows: Vec<&ImageRow>) -> Vec<(&ImageRow, &'static str)> {
    let contacts = rows.iter().all(|row| row.scores.contact.is_some());
    let error = |row: &ImageRow| match row.scores.contact {
        Some(contact) if contacts => contact.mae,
        _ => row.scores.full_image.mae,
    };
    rows.sort_by(|a, b| error(a).total_cmp(&error(b)));
    match rows.as_slice() {
        [] => Vec::new(),
        [only] => vec![(only, "only")],
        [best, worst] => vec![(best, "best"), (worst, "worst")],
        [best, .., worst] => vec![(best, "best"), (rows[rows.len() / 2], "median"), (worst, "worst")],
    }
}

fn caption(row: &ImageRow, rank: &str) -> String {
    let full_image = &row.scores.full_image;
    let contact = row
        .scores
        .contact
        .map_or(String::new(), |contact| format!("; contact: MAE {:.2}, SSIM {:.3}", contact.mae, contact.ssim));
    let file = last_letters(&row.file, 48);
    format!("{rank} of {}: {file}  MAE {:.2}, SSIM {:.3}{contact}", row.sensor, full_image.mae, full_image.ssim)
}

/// The end of a long name, which tells it from others, so that there is room for what is said of it.
fn last_letters(name: &str, most: usize) -> String {
    let letters = name.chars().count();
    if letters <= most {
        return name.to_owned();
    }
    "...".chars().chain(name.chars().skip(letters - most.saturating_sub(3))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_long_name_the_end_is_shown() {
        assert_eq!(last_letters("press_0007.png", 48), "press_0007.png");
        assert_eq!(last_letters("recordings/monday/press_0007.png", 17), "...press_0007.png");
    }

    #[test]
    fn every_title_and_caption_of_a_sheet_of_small_pictures_fits() {
        let small = RgbImage::new(16, 12);
        let long = format!("best of sensor: {}  MAE 12.34, SSIM 0.123; contact: MAE 12.34, SSIM 0.123", "x".repeat(48));
        let sheet = sheet(vec![row(long.clone(), &small, &small)], PANEL);
        let needed = [3 * 7 * TITLES[2].len(), 7 * long.len()];
        assert!(needed.iter().all(|needed| sheet.width() as usize > *needed), "{} px for {needed:?}", sheet.width());
    }
}
