//! The report's section about sequences.

use maud::{Markup, html};

use super::figures::render_histogram;
use crate::numbers::HumanCount;
use crate::page;
use crate::page::canvas::Colour;
use crate::page::plot::Plot;
use crate::report::gather::DatasetStats;
use crate::report::sequences::{CurvePoint, EVERY_SEQUENCE, ForceCurve, QUANTITIES};
use gelsim_files::number_format::format_number;
use gelsim_job::sequence::label::SlipState;

const SIZE: [f64; 2] = [330.0, 220.0];
const NORMAL: Colour = [0, 114, 178];
const TANGENTIAL: Colour = [213, 94, 0];
const LIMIT: Colour = [140, 140, 140];
const INCIPIENT: Colour = [240, 228, 66];
const GROSS: Colour = [204, 121, 167];

/// Renders slip and forces; nothing if samples are single presses.
pub(super) fn render_sequences(gathered: &DatasetStats) -> Markup {
    let sequences = &gathered.sequences;
    if sequences.frames == 0 {
        return Markup::default();
    }
    let all = QUANTITIES.iter().zip(&sequences.histograms).filter(|(_, histogram)| histogram.total_summary().count > 0);
    let each = if sequences.of_fingers { "fingers" } else { EVERY_SEQUENCE };
    let histograms = all.map(|(quantity, histogram)| {
        let (counted, among) =
            if quantity.among == EVERY_SEQUENCE { (each, each) } else { (EVERY_SEQUENCE, quantity.among) };
        render_histogram(quantity.title, [quantity.axis, counted], among, histogram)
    });
    let keys = [
        ("normal force", NORMAL),
        ("tangential force", TANGENTIAL),
        ("the most that friction holds", LIMIT),
        ("a part slips", INCIPIENT),
        ("all slips", GROSS),
    ];
    let mut curves: Vec<&ForceCurve> = sequences.curves.iter().collect();
    curves.sort_by_key(|curve| curve.index);
    html! {
        h2 { "Sequences" }
        p.note { (HumanCount(sequences.frames)) " frames in all." }
        (page::render_figures(html! { @for histogram in histograms { (histogram) } }))
        h3 { "Force over time" }
        p.note { (page::render_legend(&keys)) }
        (page::render_figures(html! { @for of in curves { (render_curve(of)) } }))
    }
}

/// Renders the forces of a sequence over time, on colours that mark slip.
fn render_curve(curve: &ForceCurve) -> Markup {
    let Some(last) = curve.points.last() else { return Markup::default() };
    let highest = |point: &CurvePoint| point.normal_n.max(point.tangential_n).max(point.limit_n.unwrap_or(0.0));
    let most = curve.points.iter().map(highest).fold(0.0, f64::max);
    let mut plot = Plot::new(SIZE, &curve.title, ["s", "N"], [[0.0, last.t_s], [0.0, 1.05 * most]]);
    let mut from_s = 0.0;
    for point in &curve.points {
        let colour = match point.slip {
            SlipState::None => None,
            SlipState::Incipient => Some(INCIPIENT),
            SlipState::Gross => Some(GROSS),
        };
        // A frame's state holds for the time since the previous frame.
        if let Some(colour) = colour {
            let (low, high) = (plot.to_canvas([from_s, 0.0]), plot.to_canvas([point.t_s, 1.05 * most]));
            plot.canvas.draw_rectangle([low[0], high[1]], [high[0], low[1]], colour, 0.3);
        }
        from_s = point.t_s;
    }
    let mut line = |of: &dyn Fn(&CurvePoint) -> Option<f64>, colour, dash| {
        let points: Vec<[f64; 2]> =
            curve.points.iter().filter_map(|point| of(point).map(|value| plot.to_canvas([point.t_s, value]))).collect();
        plot.canvas.draw_line(&points, colour, 1.5, dash);
    };
    line(&|point| point.limit_n, LIMIT, Some(4));
    line(&|point| Some(point.normal_n), NORMAL, None);
    line(&|point| Some(point.tangential_n), TANGENTIAL, None);
    page::render_figure(plot.to_svg(), format!("{}: at most {} N", curve.title, format_number(most)))
}
