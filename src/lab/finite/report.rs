//! The comparison with finite elements as a table and as CSV.

use std::fmt::Write;

use super::{Comparison, PressComparison};
use crate::text_table::TextTable;

/// Columns of the CSV, as names and values.
fn csv_columns(press: &PressComparison) -> Vec<(&'static str, String)> {
    let number = |value: f64| format!("{value:?}");
    vec![
        // Names come from file names; these characters would need quoting.
        ("object", press.object.replace([',', '"', '\n', '\r'], "_")),
        ("sample", press.sample.to_string()),
        ("tilt_deg", number(press.tilt_deg)),
        ("asymmetry_mm", number(press.asymmetry_mm)),
        ("depth_mm", number(press.depth_mm)),
        ("reached_mm", number(press.reached_mm)),
        ("strain", number(press.strain)),
        ("contact_mm", number(press.contact_mm)),
        ("ring_max_um", number(press.ring_max_um)),
        ("ring_rms_um", number(press.ring_rms_um)),
        ("ring_normal_mean_deg", number(press.ring_normal_mean_deg)),
        ("ring_normal_p95_deg", number(press.ring_normal_p95_deg)),
        ("stated_um", press.stated_um.map_or(String::new(), number)),
        ("force_n", number(press.force_n)),
        ("linear_force_n", number(press.linear_force_n)),
        ("force_ratio", number(press.force_ratio)),
        ("unknowns", press.unknowns.to_string()),
        ("solves", press.solves.to_string()),
        ("seconds", number(press.seconds)),
    ]
}

/// Writes one line per press under a line of names.
pub fn to_csv(comparison: &Comparison) -> String {
    let mut text = String::new();
    for (k, press) in comparison.presses.iter().enumerate() {
        let (names, values): (Vec<_>, Vec<_>) = csv_columns(press).into_iter().unzip();
        if k == 0 {
            text += &(names.join(",") + "\n");
        }
        text += &(values.join(",") + "\n");
    }
    text
}

/// Formats the comparison for a terminal of `columns`.
pub fn to_text_table(comparison: &Comparison, columns: Option<usize>) -> String {
    let Comparison { job, options, presses, left_out } = comparison;
    let mut text = format!(
        "{job}: the linear layer of level reference against finite elements ({}), edges rounded to {} mm, without tilt and texture\n",
        if options.sticking { "sticking" } else { "frictionless" },
        options.rounding_mm
    );
    let mut table = TextTable::new(&[
        [
            "object", "depth", "strain", "ring max", "ring RMS", "stated", "ring", "ring", "force", "linear", "ratio",
            "reached", "s",
        ],
        ["", "mm", "", "um", "um", "um", "deg", "p95 deg", "N", "N", "", "mm", ""],
    ]);
    for press in presses {
        table.add_row([
            press.object.clone(),
            format!("{:.3}", press.depth_mm),
            format!("{:.3}", press.strain),
            format!("{:.2}", press.ring_max_um),
            format!("{:.2}", press.ring_rms_um),
            press.stated_um.map_or(String::from("-"), |um| format!("{um:.2}")),
            format!("{:.3}", press.ring_normal_mean_deg),
            format!("{:.3}", press.ring_normal_p95_deg),
            format!("{:.3}", press.force_n),
            format!("{:.3}", press.linear_force_n),
            format!("{:.3}", press.force_ratio),
            format!("{:.3}", press.reached_mm),
            format!("{:.1}", press.seconds),
        ]);
    }
    if !table.is_empty() {
        text = text + "\n" + &table.render(columns);
    }
    if presses.iter().any(|press| press.reached_mm < press.depth_mm) {
        text += "\nWhere less than the depth was reached, the finite elements stopped converging; both are compared there.\n";
    }
    if !left_out.is_empty() {
        text += "\nnot compared:\n";
        for left_out in left_out {
            let _ = writeln!(text, "{:<18} {}", left_out.object, left_out.reason);
        }
    }
    text
}
