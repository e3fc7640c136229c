//! The page beside a sensor file whose gelpad was fitted: measured against fitted forces.

use maud::{Markup, html};

use super::fit::{ElasticFit, rms_and_share};
use super::motion::Motions;
use crate::page;
use crate::page::canvas::{Colour, Point, Shape};
use crate::page::plot::{GREY, Plot};
use gelsim_files::number_format::{format_number, format_percent};

const BLUE: Colour = [0, 114, 178];
const ORANGE: Colour = [213, 94, 0];
/// Most dots of a plot.
const MAX_DOTS: usize = 2000;
/// Most presses with a plot of their own.
const MAX_PLOTS: usize = 40;

/// Names of the columns of the table of presses.
const HEAD: [&str; 7] = ["press", "rows", "deepest, mm", "largest force, N", "factor", "left, N", "left"];

/// Renders the complete file. `warnings` are sentences.
pub fn to_html(
    sensor: &str,
    motions: &Motions,
    fit: &ElasticFit,
    summary: &[(String, String)],
    warnings: &[String],
) -> String {
    let body = html! {
        (page::render_facts(summary))
        (page::render_warnings(warnings))
        h2 { "Forces" }
        p { "Each dot is a row of the table. On the line the fitted force is the measured one." }
        (page::render_figure(plot_forces(fit), ""))
        h2 { "Presses" }
        p {
            "Factor: force over that which a fit to the other presses expects. Left: root mean square of what the fit to "
            "all presses leaves."
        }
        (page::render_table(HEAD, rows(motions, fit)))
        p { "Measured (solid) and fitted (dashed)." }
        @for k in 0..fit.presses.len().min(MAX_PLOTS) { (page::render_figure(plot_press(motions, fit, k), "")) }
    };
    page::render_document(&format!("Gelpad of {sensor}"), &body)
}

fn rows(motions: &Motions, fit: &ElasticFit) -> Vec<Vec<String>> {
    let row = |(press, motion): (&super::fit::PressResult, &super::motion::Motion)| {
        let [rms_n, share] = rms_and_share(press.measured_n.iter().zip(&press.fitted_n));
        vec![
            press.name.clone(),
            press.measured_n.len().to_string(),
            format_number(motion.deepest_mm(fit.solution.zero_mm)),
            format_number(motion.largest_force_n()),
            format!("{:.2}", press.factor),
            format_number(rms_n),
            format_percent(share),
        ]
    };
    fit.presses.iter().zip(&motions.motions).map(row).collect()
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|value| value.is_finite()).fold(0.0, f64::max)
}

fn plot_forces(fit: &ElasticFit) -> Markup {
    let all: Vec<(&str, f64, f64)> = fit
        .presses
        .iter()
        .flat_map(|press| press.measured_n.iter().zip(&press.fitted_n).map(|(m, f)| (press.name.as_str(), *m, *f)))
        .collect();
    let end = 1.05 * largest(all.iter().map(|(_, measured, fitted)| measured.max(*fitted)));
    let mut plot = Plot::new([480.0, 400.0], "Normal force", ["measured, N", "fitted, N"], [[0.0, end]; 2]);
    let diagonal = [[0.0, 0.0], [end, end]].map(|at| plot.to_canvas(at));
    plot.canvas.draw_line(&diagonal, GREY, 1.0, None);
    for (name, measured, fitted) in all.iter().step_by(all.len().div_ceil(MAX_DOTS).max(1)) {
        let at = plot.to_canvas([*measured, *fitted]);
        let hint = format!("{name}: {} N, fitted {} N", format_number(*measured), format_number(*fitted));
        plot.canvas.draw_with_hint(&hint, |canvas| canvas.draw_mark(Shape::Circle, at, 3.0, BLUE, [255; 3]));
    }
    plot.to_svg()
}

/// Plots the forces of a press over time, or over depth without times.
fn plot_press(motions: &Motions, fit: &ElasticFit, which: usize) -> Markup {
    let (press, motion) = (&fit.presses[which], &motions.motions[which]);
    let first_s = motion.moments.first().map_or(0.0, |moment| moment.time_s);
    let along: Vec<f64> = motion
        .moments
        .iter()
        .map(|moment| match motion.has_times {
            true => moment.time_s - first_s,
            false => moment.depth_at_zero(fit.solution.zero_mm),
        })
        .collect();
    let name = if motion.has_times { "time, s" } else { "depth, mm" };
    let end_x = 1.02 * largest(along.iter().copied());
    let end_y = 1.08 * largest(press.measured_n.iter().chain(&press.fitted_n).copied());
    let mut plot = Plot::new([330.0, 220.0], &press.name, [name, "N"], [[0.0, end_x], [0.0, end_y]]);
    for (forces, colour, dash) in [(&press.measured_n, BLUE, None), (&press.fitted_n, ORANGE, Some(4))] {
        let points: Vec<Point> = along.iter().zip(forces).map(|(x, y)| plot.to_canvas([*x, *y])).collect();
        match points[..] {
            [only] => plot.canvas.draw_mark(Shape::Circle, only, 3.0, colour, [255; 3]),
            _ => plot.canvas.draw_line(&points, colour, 1.4, dash),
        }
    }
    plot.to_svg()
}
