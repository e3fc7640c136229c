//! A comparison as a table for a terminal, as CSV, and as JSON.

use std::fmt::Write;

use super::distribution::Distances;
use super::score::Score;
use super::{Comparison, Means, SensorRow};
use crate::dataset::encode::json;

/// Columns of the CSV.
const COLUMNS: [&str; 8] =
    ["sensor", "file", "mae", "psnr_db", "ssim", "contact_mae", "contact_psnr_db", "contact_ssim"];

/// One line per pair, under a line of names. Empty: no contact is known, or no PSNR because nothing differs.
pub fn csv(comparison: &Comparison) -> Vec<u8> {
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

/// All of it.
pub fn to_json(comparison: &Comparison) -> Vec<u8> {
    let mut text = json(comparison);
    text.push(b'\n');
    text
}

/// Tables of distances between images, if there are pairs, and between sets; then the sentences. `per_image` adds a
/// line for each pair.
pub fn table(comparison: &Comparison, per_image: bool) -> String {
    let names = comparison.sensors.iter().map(|row| row.sensor.as_str());
    let files = comparison.images.iter().filter(|_| per_image).map(|row| row.file.as_str());
    let width = names.chain(files).map(|name| name.chars().count()).max().unwrap_or_default().clamp(6, 40);
    let mut text = String::new();
    match &comparison.total {
        Some(total) => scores(&mut text, comparison, total, per_image, width),
        None => text += "no two images belong together: only the sets are compared\n",
    }
    sets(&mut text, comparison, width);
    for row in &comparison.sensors {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}: simulated against real: {}", row.sensor, row.verdict);
    }
    text += &unpaired(comparison);
    // Empty cells at a line's end.
    text.lines().map(|line| line.trim_end().to_owned() + "\n").collect()
}

/// What the sentences of sets without pairs do not say, and how to have it said.
fn unpaired(comparison: &Comparison) -> String {
    let apart: Vec<_> = comparison.sensors.iter().filter(|row| row.means.is_none()).collect();
    if apart.is_empty() {
        return String::new();
    }
    let counts =
        apart.iter().map(|SensorRow { sensor, distances: Distances { real_images, sim_images, .. }, .. }| {
            format!("{sensor}: {real_images} real images against {sim_images} simulated ones of other presses")
        });
    let counts: Vec<String> = counts.collect();
    format!(
        "\n{}.\nWhere, how deep and how often was pressed differs, too: this is no measure of the simulator. For one, simulate \
         the presses of REAL\n(gelsim calibrate --evaluate REAL/annotations.csv --sensor SENSOR.toml --out SIM), or name the \
         simulated images as their\nreal counterparts.\n",
        counts.join("\n")
    )
}

fn scores(text: &mut String, comparison: &Comparison, total: &Means, per_image: bool, width: usize) {
    let contact = format!("contact, {} radii", comparison.dilate);
    let _ = writeln!(text, "{:<width$} {:>7}  {:^24}    {:^32}", "", "", "whole image", contact);
    let head = ["sensor", "images", "MAE", "PSNR dB", "SSIM", "images", "MAE", "PSNR dB", "SSIM"];
    let [sensor, images, mae, psnr, ssim, contacts, contact_mae, contact_psnr, contact_ssim] = head;
    let _ = writeln!(
        text,
        "{sensor:<width$} {images:>7} {mae:>8} {psnr:>8} {ssim:>7} {contacts:>10} {contact_mae:>8} {contact_psnr:>8} \
         {contact_ssim:>7}"
    );
    let mut line = |name: &str, images: String, full_image: &Score, contacts: String, contact: Option<&Score>| {
        let contact = contact.map_or(String::new(), |score| format!("{contacts:>10} {}", figures(score)));
        let _ = writeln!(text, "{name:<width$} {images:>7} {} {contact}", figures(full_image));
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
    text.push('\n');
}

fn figures(score: &Score) -> String {
    let psnr = score.psnr_db.map_or(String::from("inf"), |psnr| format!("{psnr:.2}"));
    format!("{:>8.3} {psnr:>8} {:>7.4}", score.mae, score.ssim)
}

fn sets(text: &mut String, comparison: &Comparison, width: usize) {
    let _ = writeln!(
        text,
        "{:<width$} {:>9} {:>9}   {:^23}   {:^17}   {:>8}",
        "", "", "", "EMD (shift), levels", "slopes, levels/px", "spectrum"
    );
    let _ = writeln!(
        text,
        "{:<width$} {:>9} {:>9} {:>12} {:>12} {:>12} {:>6} {:>6} {:>6} {:>9}",
        "sets", "real", "simulated", "red", "green", "blue", "EMD", "mean x", "edge x", "RMS log10"
    );
    for row in &comparison.sensors {
        let Distances { real_images, sim_images, channels, slopes, spectrum_rms, .. } = &row.distances;
        let [red, green, blue] = channels.map(|channel| format!("{:.1} ({:+.1})", channel.emd, channel.mean_shift));
        let [mean, edge] = [slopes.mean_ratio, slopes.edge_ratio]
            .map(|ratio| ratio.map_or(String::new(), |ratio| format!("{ratio:.2}")));
        let spectrum = spectrum_rms.map_or(String::new(), |rms| format!("{rms:.3}"));
        let _ = writeln!(
            text,
            "{:<width$} {real_images:>9} {sim_images:>9} {red:>12} {green:>12} {blue:>12} {:>6.2} {mean:>6} {edge:>6} \
             {spectrum:>9}",
            row.sensor, slopes.emd
        );
    }
    text.push('\n');
}
