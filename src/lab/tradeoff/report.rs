//! The comparison of fidelity levels as a table and as CSV.

use std::fmt::Write;

use super::{GridRow, LevelRow, Tradeoff};
use crate::text_table::TextTable;
use gelsim_core::fidelity::Fidelity;

/// Columns of the CSV, as names and values; unknown values are empty.
fn csv_columns(row: &LevelRow) -> Vec<(&'static str, String)> {
    let number = |value: f64| format!("{value:?}");
    let maybe = |value: Option<f64>| value.map_or(String::new(), number);
    let errors = &row.errors;
    vec![
        ("rung", row.level.clone()),
        ("height_rms_um", number(errors.height_rms_um)),
        ("height_max_um", number(errors.height_max_um)),
        ("model_error_um", number(errors.model_error_um)),
        ("model_rms_um", number(errors.model_rms_um)),
        ("total_rms_um", number(errors.total_rms_um)),
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
    let mut text = format!(
        "{}: {} samples; errors against the reference level, CPU time on one thread, files not counted\n\n",
        tradeoff.job,
        tradeoff.samples.len()
    );
    text += &format_rows("fidelity level", &tradeoff.levels, columns);
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

/// Formats a table of choices of models.
fn format_rows(name: &str, rows: &[LevelRow], columns: Option<usize>) -> String {
    let mut table = TextTable::new(&[
        [
            name, "height", "height", "model", "total", "contact", "ring", "ring", "image", "image", "image", "area",
            "force", "mask", "mask", "CPU ms", "CPU ms", "best",
        ],
        [
            "", "RMS um", "max um", "RMS um", "RMS um", "deg", "deg", "p95 deg", "MAE", "PSNR dB", "SSIM", "%", "%",
            "IoU", "worst", "median", "p95", "",
        ],
    ]);
    for row in rows {
        let errors = &row.errors;
        let maybe = |value: Option<f64>| value.map_or(String::from("-"), |value| format!("{value:.2}"));
        let share = |value: Option<f64>| value.map_or(String::from("-"), |value| format!("{value:.4}"));
        let [two, three] = [2, 3].map(|digits| move |value: f64| format!("{value:.digits$}"));
        table.add_row([
            row.level.clone(),
            three(errors.height_rms_um),
            two(errors.height_max_um),
            two(errors.model_rms_um),
            two(errors.total_rms_um),
            three(errors.contact_normal_mean_deg),
            three(errors.ring_normal_mean_deg),
            three(errors.ring_normal_p95_deg),
            three(errors.image_mae),
            maybe(errors.image_psnr_db),
            format!("{:.4}", errors.image_ssim),
            maybe(errors.area_error_percent),
            maybe(errors.force_error_percent),
            share(errors.contact_iou_mean),
            share(errors.contact_iou_worst),
            two(row.cpu_ms_median),
            two(row.cpu_ms_p95),
            String::from(if row.pareto { "*" } else { "" }),
        ]);
    }
    table.render(columns) + "\n"
}
