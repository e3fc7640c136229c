//! Sheets of real and simulated images side by side, with their difference around grey.

use image::RgbImage;

use super::{Comparison, ImageRow, read_pair};
use crate::preview::amplify_difference;
use crate::preview::rows::{self, SheetRow};
use gelsim_files::diagnostic::Report;

/// Most width of a picture, px.
const PANEL: u32 = 640;
/// Most width of a picture on a sheet of several sensors, px, whose images may differ in size.
const SMALL_PANEL: u32 = 320;
/// Most sensors on a sheet.
const MAX_SENSORS: usize = 20;

/// Titles of the columns of a [`comparison_row`].
const TITLES: [&str; 3] = ["real", "simulated", "grey + 4 x (simulated - real)"];
/// Factor on the difference.
const GAIN: i32 = 4;

/// Makes a row: real image, simulated image, and four times their difference around grey, with a `caption` below. The
/// images must be of one size.
pub fn comparison_row(caption: String, real: &RgbImage, sim: &RgbImage) -> SheetRow {
    SheetRow {
        panels: vec![real.clone(), sim.clone(), amplify_difference(real, sim, GAIN)],
        captions: vec![(0, caption)],
    }
}

/// Draws rows one below the other; pictures are at most `panel_width` px wide.
pub fn draw_comparison_sheet(rows: Vec<SheetRow>, panel_width: u32) -> RgbImage {
    rows::draw_row_sheet(&TITLES, rows, panel_width)
}

/// Draws the best, median and worst pair of each sensor by the MAE of the contact, or by that of the whole image if a
/// pair of the sensor has no contact. None without pairs. Reads the files again.
pub fn draw_best_median_worst(comparison: &Comparison) -> Result<Option<RgbImage>, Report> {
    let mut rows = Vec::new();
    for sensor in comparison.sensors.iter().take(MAX_SENSORS) {
        let of_sensor: Vec<&ImageRow> = comparison.images.iter().filter(|row| row.sensor == sensor.sensor).collect();
        for (row, rank) in choose_rows(of_sensor) {
            let [real, sim] = read_pair(row)?;
            rows.push(self::comparison_row(pair_caption(row, rank), &real, &sim));
        }
    }
    let width = if comparison.sensors.len() > 1 { SMALL_PANEL } else { PANEL };
    Ok((!rows.is_empty()).then(|| draw_comparison_sheet(rows, width)))
}

/// Chooses the best, median and worst row, and names them.
fn choose_rows(mut rows: Vec<&ImageRow>) -> Vec<(&ImageRow, &'static str)> {
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

fn pair_caption(row: &ImageRow, rank: &str) -> String {
    let full_image = &row.scores.full_image;
    let contact = row
        .scores
        .contact
        .map_or(String::new(), |contact| format!("; contact: MAE {:.2}, SSIM {:.3}", contact.mae, contact.ssim));
    let file = shorten_name(&row.file, 48);
    format!("{rank} of {}: {file}  MAE {:.2}, SSIM {:.3}{contact}", row.sensor, full_image.mae, full_image.ssim)
}

/// Shortens a long name to its end, which tells it from others, so that there is room for the figures.
fn shorten_name(name: &str, most: usize) -> String {
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
        assert_eq!(shorten_name("press_0007.png", 48), "press_0007.png");
        assert_eq!(shorten_name("recordings/monday/press_0007.png", 17), "...press_0007.png");
    }

    #[test]
    fn every_title_and_caption_of_a_sheet_of_small_pictures_fits() {
        let small = RgbImage::new(16, 12);
        let long = format!("best of sensor: {}  MAE 12.34, SSIM 0.123; contact: MAE 12.34, SSIM 0.123", "x".repeat(48));
        let sheet = draw_comparison_sheet(vec![comparison_row(long.clone(), &small, &small)], PANEL);
        let needed = [3 * 7 * TITLES[2].len(), 7 * long.len()];
        assert!(needed.iter().all(|needed| sheet.width() as usize > *needed), "{} px for {needed:?}", sheet.width());
    }
}
