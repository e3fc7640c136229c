//! The result as lines for a terminal and for the head of a sensor file, and as JSON.

use serde_json::{Value, json};

use super::fit::{ElasticFit, NoRelaxation};
use super::friction::FrictionFit;
use super::motion::Motions;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::number_format::{format_count, format_number, format_percent};

/// Formats a value with its standard error, each to the error's second digit; the value alone without an error.
pub fn format_with_error(value: f64, standard_error: Option<f64>) -> String {
    match standard_error.filter(|error| *error > 0.0 && error.is_finite()) {
        None => format_number(value),
        Some(error) => {
            let digits = (1.0 - libm::floor(libm::log10(error))).clamp(0.0, 9.0) as usize;
            format!("{value:.digits$} ± {error:.digits$}")
        }
    }
}

/// Summarises a fit as labels and figures.
pub fn summarise(motions: &Motions, fit: &ElasticFit, friction: &FrictionFit) -> Vec<(String, String)> {
    let line = |what: &str, figure: String| (what.to_owned(), figure);
    let modulus = format_with_error(fit.solution.youngs_modulus_kpa, fit.standard_error(0));
    let mut lines = vec![line("Young's modulus", format!("{modulus} kPa"))];
    for (k, mode) in fit.solution.relaxation.iter().enumerate() {
        let error = |name: &str| fit.standard_error_of(&format!("gelpad_relaxation.{k}.{name}"));
        let share = format_with_error(mode.share, error("share"));
        lines.push(line("relaxation, share", share));
        lines.push(line("relaxation, time", format!("{} s", format_with_error(mode.time_s, error("time_s")))));
    }
    if let Some(why) = fit.no_relaxation {
        lines.push(line("relaxation", why.describe().to_owned()));
        if why != NoRelaxation::NotFound {
            lines.push(line("the modulus is that of", String::from("presses as slow as these")));
        }
    }
    if fit.names.iter().any(|name| name == "zero_mm") {
        let zero = format_with_error(fit.solution.zero_mm, fit.standard_error_of("zero_mm"));
        lines.push(line("to add to depth_mm", format!("{zero} mm")));
    }
    match friction {
        FrictionFit::NoForces => {
            lines.push(line("friction", String::from("not fitted: the table has no shear_force_n")))
        }
        FrictionFit::AtLeast { coefficient, .. } => {
            lines.push(line("friction", format!("at least {}, not written", format_number(*coefficient))))
        }
        FrictionFit::Found(found) => {
            let coefficient = format_with_error(found.coefficient, found.standard_error);
            let slides = format_count(found.slides.len(), "slide", "slides");
            lines.push(line("coefficient of friction", format!("{coefficient} ({slides})")));
            let [rms_n, share] = found.remaining();
            lines.push(line("tangential force, left", format_left(rms_n, share)));
        }
    }
    let rows: usize = fit.presses.iter().map(|press| press.measured_n.len()).sum();
    let presses = format_count(fit.presses.len(), "press", "presses");
    lines.push(line("presses", format!("{presses}, {}", format_count(rows, "row", "rows"))));
    if motions.left_out() > 0 {
        lines.push(line("rows left out", format!("{}, where the indenter is lifted", motions.left_out())));
    }
    let [rms_n, share] = fit.remaining();
    lines.push(line("force, left by the fit", format_left(rms_n, share)));
    if let Some([rms_n, share]) = fit.held_out() {
        lines.push(line("force, by fits to other presses", format_left(rms_n, share)));
    }
    let material = &motions.material;
    let pad = format!("{} mm, {}", format_number(material.thickness_mm), format_number(material.poisson_ratio));
    lines.push(line("thickness, Poisson's ratio", format!("{pad}, as given")));
    lines
}

fn format_left(rms_n: f64, share: f64) -> String {
    format!("{} N RMS, {} of the force", format_number(rms_n), format_percent(share))
}

/// Writes the result as one line of JSON. `findings` are warnings as sentences.
pub fn to_json(motions: &Motions, fit: &ElasticFit, friction: &FrictionFit, findings: &[String]) -> Vec<u8> {
    let values: Vec<Value> = fit
        .names
        .iter()
        .zip(&fit.values)
        .enumerate()
        .map(|(k, (name, value))| json!({ "name": name, "value": value, "standard_error": fit.standard_error(k) }))
        .collect();
    let presses: Vec<Value> = fit
        .presses
        .iter()
        .zip(&motions.motions)
        .map(|(press, motion)| {
            let residual_n: Vec<f64> = press.measured_n.iter().zip(&press.fitted_n).map(|(m, f)| m - f).collect();
            let column = |of: &dyn Fn(&super::motion::Moment) -> Value| -> Vec<Value> {
                motion.moments.iter().map(of).collect()
            };
            json!({
                "name": press.name,
                "indenter": motion.curve.indenter().describe(),
                "factor": press.factor,
                "line": column(&|moment| json!(moment.line)),
                "time_s": if motion.has_times { json!(column(&|moment| json!(moment.time_s))) } else { Value::Null },
                "depth_mm": column(&|moment| json!(moment.depth_at_zero(fit.solution.zero_mm))),
                "measured_n": press.measured_n,
                "fitted_n": press.fitted_n,
                "residual_n": residual_n,
                "held_out_n": press.held_out_n,
            })
        })
        .collect();
    let rms = |[rms_n, share]: [f64; 2]| json!({ "rms_n": rms_n, "share": share });
    let friction = match friction {
        FrictionFit::NoForces => Value::Null,
        FrictionFit::AtLeast { coefficient, why } => json!({ "at_least": coefficient, "why": why }),
        FrictionFit::Found(found) => {
            let slides: Vec<Value> = found
                .slides
                .iter()
                .map(|slide| {
                    json!({
                        "name": slide.name,
                        "coefficient": slide.coefficient,
                        "measured_n": slide.measured_n,
                        "fitted_n": slide.fitted_n,
                    })
                })
                .collect();
            json!({
                "coefficient": found.coefficient,
                "standard_error": found.standard_error,
                "has_displacements": found.has_displacements,
                "left": rms(found.remaining()),
                "slides": slides,
            })
        }
    };
    let whole = json!({
        "thickness_mm": motions.material.thickness_mm,
        "poisson_ratio": motions.material.poisson_ratio,
        "values": values,
        "covariance": fit.covariance,
        "no_relaxation": fit.no_relaxation.map(|why| why.describe()),
        "friction": friction,
        "left": rms(fit.remaining()),
        "held_out": fit.held_out().map(rms),
        "rows_left_out": motions.left_out(),
        "warnings": findings,
        "presses": presses,
    });
    [to_json_line(&whole).as_slice(), b"\n"].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_rounded_to_their_errors() {
        assert_eq!(format_with_error(118.345, Some(1.93)), "118.3 ± 1.9");
        assert_eq!(format_with_error(118.345, Some(19.3)), "118 ± 19");
        assert_eq!(format_with_error(0.21847, Some(0.0042)), "0.2185 ± 0.0042");
        assert_eq!(format_with_error(118.345, None), "118");
        assert_eq!(format_with_error(1.0, Some(f64::NAN)), "1");
    }
}
