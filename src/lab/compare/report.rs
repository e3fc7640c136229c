//! A comparison as a table for a terminal, as CSV, and as JSON.

use std::fmt::Write;

use super::distribution::Distances;
use super::score::Score;
use super::{Comparison, Means, SensorRow};
use crate::text_table::TextTable;
use gelsim_dataset::encode::to_json_line;

/// Columns of the CSV.
const COLUMNS: [&str; 8] =
    ["sensor", "file", "mae", "psnr_db", "ssim", "contact_mae", "contact_psnr_db", "contact_ssim"];

/// Writes one line per pair, under a line of names. A cell is empty if no contact is known, or if PSNR is infinite
/// because nothing differs.
pub fn to_csv(comparison: &Comparison) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let written = "writing to memory, and every record has as many cells";
    writer.write_record(COLUMNS).expect(written);
    for row in &comparison.images {
        let figures = |score: Option<&Score>| {
            let values = [score.map(|s| s.mae), score.and_then(|s| s.psnr_db), score.map(|s| s.ssim)];
            values.map(|value| value.map_or(String::new(), |value| format!("{value:?}")))
        };
        let names = [row.sensor.clone(), row.file.clone()];
        let figures = [figures(Some(&row.scores.full_image)), figures(row.scores.contact.as_ref())];
        writer.write_record(names.iter().chain(figures.as_flattened())).expect(written);
    }
    writer.into_inner().expect(written)
}

/// Writes the comparison as one line of JSON.
pub fn to_json(comparison: &Comparison) -> Vec<u8> {
    let mut text = to_json_line(comparison);
    text.push(b'\n');
    text
}

/// Formats tables of distances between images, if there are pairs, and between sets, then the sentences. `per_image`
/// adds a line for each pair. `columns` is the width of the terminal.
pub fn to_text_table(comparison: &Comparison, per_image: bool, columns: Option<usize>) -> String {
    let mut text = match &comparison.total {
        Some(total) => build_score_table(comparison, total, per_image).render(columns),
        None => String::from("no two images belong together: only the sets are compared\n"),
    };
    text = text + "\n" + &build_set_table(comparison).render(columns) + "\n";
    for row in &comparison.sensors {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}: simulated against real: {}", row.sensor, row.verdict);
    }
    text + &explain_unpaired(comparison)
}

/// Explains what the sentences about sets without pairs cannot say, and how to get pairs.
fn explain_unpaired(comparison: &Comparison) -> String {
    let apart: Vec<_> = comparison.sensors.iter().filter(|row| row.means.is_none()).collect();
    if apart.is_empty() {
        return String::new();
    }
    let counts =
        apart.iter().map(|SensorRow { sensor, distances: Distances { real_images, sim_images, .. }, .. }| {
            format!("{sensor}: {real_images} real images against {sim_images} simulated ones of other presses")
        });
    let counts: Vec<String> = counts.collect();
    let way_out = comparison.missing.as_ref().map(|missing| missing.to_advice() + "\n").unwrap_or_default();
    format!(
        "\n{}.\nWhere, how deep and how often was pressed differs, too: this is no measure of the simulator.\n{way_out}",
        counts.join("\n")
    )
}

fn build_score_table(comparison: &Comparison, total: &Means, per_image: bool) -> TextTable {
    let contact = format!("{} radii", comparison.dilate);
    let around = contact.as_str();
    let mut table = TextTable::new(&[
        ["", "", "image", "image", "image", around, around, around, around],
        ["sensor", "images", "MAE", "PSNR dB", "SSIM", "images", "MAE", "PSNR dB", "SSIM"],
    ]);
    let mut line = |name: &str, images: String, full_image: &Score, contacts: String, contact: Option<&Score>| {
        let [mae, psnr, ssim] = score_cells(full_image);
        let contact = contact.map_or([const { String::new() }; 4], |score| {
            let [mae, psnr, ssim] = score_cells(score);
            [contacts, mae, psnr, ssim]
        });
        table.add_row([name.to_owned(), images, mae, psnr, ssim].into_iter().chain(contact));
    };
    for sensor in &comparison.sensors {
        for row in comparison.images.iter().filter(|row| per_image && row.sensor == sensor.sensor) {
            line(&row.file, String::new(), &row.scores.full_image, String::new(), row.scores.contact.as_ref());
        }
        if let Some(means) = &sensor.means {
            let Means { images, full_image, contacts, contact } = means;
            line(&sensor.sensor, images.to_string(), full_image, contacts.to_string(), contact.as_ref());
        }
    }
    line("total", total.images.to_string(), &total.full_image, total.contacts.to_string(), total.contact.as_ref());
    table
}

/// Formats MAE, PSNR and SSIM.
pub fn score_cells(score: &Score) -> [String; 3] {
    let psnr = score.psnr_db.map_or(String::from("inf"), |psnr| format!("{psnr:.2}"));
    [format!("{:.3}", score.mae), psnr, format!("{:.4}", score.ssim)]
}

fn build_set_table(comparison: &Comparison) -> TextTable {
    let mut table = TextTable::new(&[
        ["sets", "real", "simulated", "red", "green", "blue", "slopes", "mean", "edge", "spectrum"],
        ["", "images", "images", "EMD (shift)", "EMD (shift)", "EMD (shift)", "EMD", "ratio", "ratio", "RMS log10"],
    ]);
    for row in &comparison.sensors {
        let Distances { real_images, sim_images, channels, slopes, spectrum_rms, .. } = &row.distances;
        let [red, green, blue] = channels.map(|channel| format!("{:.1} ({:+.1})", channel.emd, channel.mean_shift));
        let [mean, edge] = [slopes.mean_ratio, slopes.edge_ratio]
            .map(|ratio| ratio.map_or(String::new(), |ratio| format!("{ratio:.2}")));
        let spectrum = spectrum_rms.map_or(String::new(), |rms| format!("{rms:.3}"));
        let counts = [real_images, sim_images].map(ToString::to_string);
        let figures = [red, green, blue, format!("{:.2}", slopes.emd), mean, edge, spectrum];
        table.add_row([row.sensor.clone()].into_iter().chain(counts).chain(figures));
    }
    table
}
