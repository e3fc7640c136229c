//! The comparison with finite elements as a table and as CSV.

use std::fmt::Write;

use super::{Compared, Comparison};

/// Columns of the CSV: name and value.
fn columns(press: &Compared) -> Vec<(&'static str, String)> {
    let number = |value: f64| format!("{value:?}");
    vec![
        // Names of objects are names of files.
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
        ("stated_um", number(press.stated_um)),
        ("force_n", number(press.force_n)),
        ("linear_force_n", number(press.linear_force_n)),
        ("force_ratio", number(press.force_ratio)),
        ("unknowns", press.unknowns.to_string()),
        ("solves", press.solves.to_string()),
        ("seconds", number(press.seconds)),
    ]
}

/// One line per press under a line of names.
pub fn csv(comparison: &Comparison) -> String {
    let mut text = String::new();
    for (k, press) in comparison.presses.iter().enumerate() {
        let (names, values): (Vec<_>, Vec<_>) = columns(press).into_iter().unzip();
        if k == 0 {
            text += &(names.join(",") + "\n");
        }
        text += &(values.join(",") + "\n");
    }
    text
}

/// The comparison for a terminal.
pub fn table(comparison: &Comparison) -> String {
    let Comparison { job, options, presses, left_out } = comparison;
    let mut text = format!(
        "{job}: the linear layer of level reference against finite elements ({}), edges rounded to {} mm, without tilt and texture\n",
        if options.sticking { "sticking" } else { "frictionless" },
        options.rounding_mm
    );
    if !presses.is_empty() {
        text += "\n";
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:<18} {:>8} {:>6} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>6} {:>10} {:>7}",
            "object",
            "depth mm",
            "strain",
            "ring max",
            "ring RMS",
            "stated um",
            "ring deg",
            "p95",
            "force N",
            "linear N",
            "ratio",
            "reached mm",
            "s"
        );
    }
    for press in presses {
        let _ = writeln!(
            text,
            "{:<18} {:>8.3} {:>6.3} {:>9.2} {:>9.2} {:>9.2} {:>9.3} {:>9.3} {:>8.3} {:>8.3} {:>6.3} {:>10.3} {:>7.1}",
            press.object,
            press.depth_mm,
            press.strain,
            press.ring_max_um,
            press.ring_rms_um,
            press.stated_um,
            press.ring_normal_mean_deg,
            press.ring_normal_p95_deg,
            press.force_n,
            press.linear_force_n,
            press.force_ratio,
            press.reached_mm,
            press.seconds
        );
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
