//! The comparison of fidelity levels as a table and as CSV.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::errors::MeanErrors;
use super::{GridRow, LevelRow, LightLeftOut, Tradeoff};
use crate::text_table::TextTable;
use gelsim_core::fidelity::Fidelity;

/// Columns of the CSV, as names and values; unknown values are empty.
fn csv_columns(row: &LevelRow) -> Vec<(&'static str, String)> {
    let number = |value: f64| format!("{value:?}");
    let maybe = |value: Option<f64>| value.map_or(String::new(), number);
    let errors = &row.errors;
    let total = |of: fn(&MeanErrors) -> f64| maybe(row.total.as_ref().map(of));
    vec![
        ("rung", row.level.clone()),
        ("total_rms_um", maybe(row.total_rms_um)),
        ("total_numerics_rms_um", maybe(row.total_numerics_rms_um)),
        ("total_height_max_um", total(|total| total.height_max_um)),
        ("total_ring_normal_mean_deg", total(|total| total.ring_normal_mean_deg)),
        ("total_image_mae", total(|total| total.image_mae)),
        ("total_force_error_percent", maybe(row.total.as_ref().and_then(|total| total.force_error_percent))),
        ("height_rms_um", number(errors.height_rms_um)),
        ("height_max_um", number(errors.height_max_um)),
        ("light_error_levels", maybe(errors.light_error_levels)),
        ("model_error_um", number(row.model_error_um)),
        ("model_rms_um", number(row.model_rms_um)),
        ("normal_mean_deg", number(errors.normal_mean_deg)),
        ("normal_p95_deg", number(errors.normal_p95_deg)),
        ("contact_normal_mean_deg", number(errors.contact_normal_mean_deg)),
        ("contact_normal_p95_deg", number(errors.contact_normal_p95_deg)),
        ("ring_normal_mean_deg", number(errors.ring_normal_mean_deg)),
        ("ring_normal_p95_deg", number(errors.ring_normal_p95_deg)),
        ("image_mae", number(errors.image_mae)),
        ("image_psnr_db", maybe(errors.image_psnr_db)),
        ("image_ssim", number(errors.image_ssim)),
        ("area_error_percent", maybe(errors.area_error_percent)),
        ("force_error_percent", maybe(errors.force_error_percent)),
        ("contact_iou_mean", maybe(errors.contact_iou_mean)),
        ("contact_iou_worst", maybe(errors.contact_iou_worst)),
        ("cpu_ms_median", number(row.cpu_ms_median)),
        ("cpu_ms_p95", number(row.cpu_ms_p95)),
        ("scene_ms", number(1e3 * row.seconds.scene)),
        ("depth_ms", number(1e3 * row.seconds.depth)),
        ("gelpad_ms", number(1e3 * row.seconds.gelpad)),
        ("optics_ms", number(1e3 * row.seconds.optics)),
        ("camera_ms", number(1e3 * row.seconds.camera)),
        ("label_ms", number(1e3 * row.seconds.label)),
        ("pareto", row.pareto.to_string()),
    ]
}

/// Writes one line per fidelity level over all samples, under a line of names.
pub fn to_csv(tradeoff: &Tradeoff) -> String {
    let mut text = String::new();
    for (k, row) in tradeoff.levels.iter().enumerate() {
        let (names, values): (Vec<_>, Vec<_>) = csv_columns(row).into_iter().unzip();
        if k == 0 {
            text += &(names.join(",") + "\n");
        }
        text += &(values.join(",") + "\n");
    }
    text
}

/// Formats the fidelity levels and the studies for a terminal of `columns`.
pub fn to_text_table(tradeoff: &Tradeoff, columns: Option<usize>) -> String {
    let against = match tradeoff.measured {
        true => "total errors against finite strain, the others against the reference level, over all samples",
        false => "errors against the reference level, and the model's as labels expect it",
    };
    let mut text = format!(
        "{}: {} samples; {against}; CPU time on one thread, files not counted\n\n",
        tradeoff.job,
        tradeoff.samples.len()
    );
    text += &format_rows("fidelity level", &tradeoff.levels, columns);
    text += &format_without_truth(tradeoff);
    let reference = tradeoff.levels.iter().find(|row| row.level == Fidelity::Reference.name());
    for grid in &tradeoff.grids {
        let what = if grid.per_px == 1.0 { "the reference itself" } else { "a grid half as fine" };
        let GridRow { height_rms_um, height_max_um, ring_rms_um, .. } = grid;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{what} against a grid twice as fine: {height_rms_um:.2} um over the view, {ring_rms_um:.2} um in the ring, \
             at most {height_max_um:.0} um"
        );
    }
    if reference.is_some() {
        text += "\n";
    }
    text += &format_light(tradeoff);
    text += &format_rows("solver tolerance", &tradeoff.tolerances, columns);
    text += &format_rows("other models", &tradeoff.models, columns);
    let mut left_out = TextTable::new(&[["effect left out", "samples", "image MAE", "image max", "CPU ms"]]);
    for effect in &tradeoff.left_out {
        left_out.add_row([
            effect.effect.to_string(),
            effect.samples.to_string(),
            format!("{:.3}", effect.image_mae),
            effect.image_max.to_string(),
            format!("{:.2}", effect.cpu_ms),
        ]);
    }
    text + &left_out.render(columns)
}

/// Formats how many samples have no measured total error, and why; nothing if all have.
fn format_without_truth(tradeoff: &Tradeoff) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for without in &tradeoff.without_truth {
        *counts.entry(&without.reason).or_default() += 1;
    }
    if counts.is_empty() {
        return String::new();
    }
    let reasons: Vec<String> = counts.iter().map(|(reason, count)| format!("{reason} ({count})")).collect();
    let (without, all) = (tradeoff.without_truth.len(), tradeoff.samples.len());
    format!("{without} of {all} samples have no truth: {}\n\n", reasons.join("; "))
}

/// Formats what the light of the reference level is expected to leave out, and what would compute it.
fn format_light(tradeoff: &Tradeoff) -> String {
    if !tradeoff.light_unknown.is_empty() {
        return format!("the error of the light is not known: {}\n\n", tradeoff.light_unknown);
    }
    if tradeoff.light.is_empty() {
        return String::new();
    }
    let mut text = String::from("light left out, grey levels in the contact and 1 mm around it, as expected:\n");
    for LightLeftOut { what, levels, remedy } in &tradeoff.light {
        let remedy = if remedy.is_empty() { String::new() } else { format!(": {remedy}") };
        text += &format!("{levels:7.2}  {what}{remedy}\n");
    }
    text + "\n"
}

/// A column of a table: two lines of its head, and what it says of a row.
type Column = (&'static str, &'static str, fn(&LevelRow) -> String);

/// Total errors as measured, and the numerical one of the same samples.
const MEASURED: [Column; 4] = [
    ("total", "RMS um", |row| optional(row.total_rms_um)),
    ("numeric", "RMS um", |row| optional(row.total_numerics_rms_um)),
    ("total", "max um", |row| optional(row.total.map(|total| total.height_max_um))),
    ("total", "image", |row| optional(row.total.map(|total| total.image_mae))),
];
/// The theory's part of the total error as labels expect it, and both.
const EXPECTED: [Column; 2] = [
    ("model", "RMS um", |row| format!("{:.2}", row.model_rms_um)),
    ("total", "RMS um", |row| optional(row.total_rms_um)),
];
const AGAINST_REFERENCE: [Column; 14] = [
    ("height", "RMS um", |row| format!("{:.3}", row.errors.height_rms_um)),
    ("height", "max um", |row| format!("{:.2}", row.errors.height_max_um)),
    ("light", "levels", |row| optional(row.errors.light_error_levels)),
    ("contact", "deg", |row| format!("{:.3}", row.errors.contact_normal_mean_deg)),
    ("ring", "deg", |row| format!("{:.3}", row.errors.ring_normal_mean_deg)),
    ("image", "MAE", |row| format!("{:.3}", row.errors.image_mae)),
    ("image", "PSNR dB", |row| optional(row.errors.image_psnr_db)),
    ("image", "SSIM", |row| format!("{:.4}", row.errors.image_ssim)),
    ("area", "%", |row| optional(row.errors.area_error_percent)),
    ("force", "%", |row| optional(row.errors.force_error_percent)),
    ("mask", "IoU", |row| optional_share(row.errors.contact_iou_mean)),
    ("CPU ms", "median", |row| format!("{:.2}", row.cpu_ms_median)),
    ("CPU ms", "p95", |row| format!("{:.2}", row.cpu_ms_p95)),
    ("best", "", |row| String::from(if row.pareto { "*" } else { "" })),
];

fn optional(value: Option<f64>) -> String {
    value.map_or(String::from("-"), |value| format!("{value:.2}"))
}

fn optional_share(value: Option<f64>) -> String {
    value.map_or(String::from("-"), |value| format!("{value:.4}"))
}

/// Formats a table of choices of models.
fn format_rows(name: &str, rows: &[LevelRow], columns: Option<usize>) -> String {
    let totals: &[Column] = match rows {
        _ if rows.iter().any(|row| row.total.is_some()) => &MEASURED,
        _ if rows.iter().any(|row| row.total_rms_um.is_some()) => &EXPECTED,
        _ => &[],
    };
    let shown = || totals.iter().chain(&AGAINST_REFERENCE);
    let upper: Vec<&str> = std::iter::once(name).chain(shown().map(|(upper, ..)| *upper)).collect();
    let lower: Vec<&str> = std::iter::once("").chain(shown().map(|(_, lower, _)| *lower)).collect();
    let mut table = TextTable::new(&[upper, lower]);
    for row in rows {
        table.add_row(std::iter::once(row.level.clone()).chain(shown().map(|(.., cell)| cell(row))));
    }
    table.render(columns) + "\n"
}
