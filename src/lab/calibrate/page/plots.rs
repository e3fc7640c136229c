//! Draws the plots of the page, as SVG. Axes are linear and start at 0.

use maud::Markup;

use super::PressPanel;
use crate::page::canvas::{Canvas, Colour, Point, Shape, TextAlign};
use crate::page::plot::{FAINT, GREY, Plot, TEXT_STYLE, TITLE_STYLE};
use crate::presses::Circle;

const BLUE: Colour = [0, 114, 178];
const RED: Colour = [196, 30, 40];
const CHANNELS: [Colour; 3] = [[204, 50, 50], [0, 140, 90], [40, 90, 200]];

/// Makes a plot with axes from 0 to `ends`.
fn plot_from_zero(size: [f64; 2], title: &str, names: [&str; 2], ends: [f64; 2]) -> Plot {
    Plot::new(size, title, names, ends.map(|end| [0.0, end]))
}

fn draw_dot(plot: &mut Plot, at: Point, shown: &PressPanel) {
    let at = plot.to_canvas(at);
    let hint = format!("{}: {:.2}", shown.file, shown.ranking_error());
    plot.canvas.draw_with_hint(&hint, |canvas| draw_mark(canvas, at, shown));
}

fn draw_mark(canvas: &mut Canvas, at: Point, shown: &PressPanel) {
    let (shape, colour) = if shown.outlier_reasons.is_empty() { (Shape::Circle, BLUE) } else { (Shape::Diamond, RED) };
    canvas.draw_mark(shape, at, 4.0, colour, [255; 3]);
}

fn largest_finite(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|value| value.is_finite()).fold(0.0, f64::max)
}

/// Plots the error of each press, in the table's order.
pub(super) fn plot_errors(presses: &[PressPanel]) -> Markup {
    let ends = [presses.len() as f64 + 0.5, 1.08 * largest_finite(presses.iter().map(PressPanel::ranking_error))];
    let mut plot = plot_from_zero([480.0, 280.0], "Error of each press", ["row of the table", "grey levels"], ends);
    for (row, shown) in presses.iter().enumerate() {
        let x = row as f64 + 1.0;
        let [from, to] = [0.0, shown.ranking_error()].map(|y| plot.to_canvas([x, y]));
        plot.canvas.draw_line(&[from, to], FAINT, 2.0, None);
        draw_dot(&mut plot, [x, shown.ranking_error()], shown);
    }
    plot.to_svg()
}

/// Plots the error against the radius of the circle.
pub(super) fn plot_error_by_radius(presses: &[PressPanel]) -> Markup {
    let radius = |shown: &PressPanel| shown.circle.map_or(f64::NAN, |circle| circle.radius_px);
    let ends = [
        1.08 * largest_finite(presses.iter().map(radius)),
        1.08 * largest_finite(presses.iter().map(PressPanel::ranking_error)),
    ];
    let mut plot =
        plot_from_zero([480.0, 280.0], "Error against radius", ["radius of the circle, px", "grey levels"], ends);
    for shown in presses.iter().filter(|shown| radius(shown).is_finite()) {
        draw_dot(&mut plot, [radius(shown), shown.ranking_error()], shown);
    }
    plot.to_svg()
}

/// Plots the circles in the frame of the image, darker where the error is larger.
pub(super) fn plot_circles(presses: &[PressPanel]) -> Markup {
    let [width, height] = presses.first().map_or([4.0, 3.0], |shown| {
        let (width, height) = shown.real.dimensions();
        [width, height].map(|px| f64::from(px.max(1)))
    });
    let scale = f64::min(440.0 / width, 330.0 / height);
    let (left, top) = (8.0, 46.0);
    let corner = [left + scale * width, top + scale * height];
    let mut canvas = Canvas::new(480.0, corner[1] + 10.0);
    let worst = largest_finite(presses.iter().map(PressPanel::ranking_error));
    canvas.draw_text([left, 18.0], "Where the presses are", TITLE_STYLE, TextAlign::Left);
    canvas.draw_text(
        [left, 36.0],
        &format!("pale: error 0; dark: {worst:.1} grey levels; red: suspect"),
        TEXT_STYLE,
        TextAlign::Left,
    );
    canvas.draw_line(&[[left, top], [corner[0], top], corner, [left, corner[1]], [left, top]], GREY, 1.0, None);
    for shown in presses {
        let Some(circle) = shown.circle.filter(|circle| may_be_in_view(circle, [width, height])) else { continue };
        let [x, y] = circle.centre_px.map(|at| scale * (at + 0.5));
        let radius = scale * circle.radius_px;
        let points: Vec<Point> = (0..=48)
            .map(|step| {
                let angle = std::f64::consts::TAU * f64::from(step) / 48.0;
                // Points out of view are moved onto the border, so that the line stays in the frame.
                let at = [x + radius * libm::cos(angle), y + radius * libm::sin(angle)];
                [left + at[0].clamp(0.0, scale * width), top + at[1].clamp(0.0, scale * height)]
            })
            .collect();
        let fraction = if worst > 0.0 { (shown.ranking_error() / worst).clamp(0.0, 1.0) } else { 0.0 };
        let shade = |pale: f64, dark: f64| (pale + fraction * (dark - pale)).round() as u8;
        let colour = if shown.outlier_reasons.is_empty() {
            [shade(190.0, 0.0), shade(215.0, 40.0), shade(240.0, 110.0)]
        } else {
            RED
        };
        canvas.draw_with_hint(&format!("{}: {:.2}", shown.file, shown.ranking_error()), |canvas| {
            canvas.draw_line(&points, colour, 2.0, None)
        });
    }
    canvas.to_svg()
}

/// Returns true if a part of the circle may be in view, and the circle is not absurdly large.
fn may_be_in_view(circle: &Circle, size: [f64; 2]) -> bool {
    (0..2).all(|k| {
        let (at, radius) = (circle.centre_px[k], circle.radius_px);
        at + radius >= 0.0 && at - radius <= size[k] && radius < 4.0 * size[k]
    })
}

/// Plots red, green and blue along the row and along the column through the centre of the circle, or of the image
/// without one.
pub(super) fn plot_profiles(shown: &PressPanel) -> [Markup; 2] {
    let size = [shown.real.width().min(shown.simulated.width()), shown.real.height().min(shown.simulated.height())];
    let middle = size.map(|size| f64::from(size) / 2.0);
    let centre = shown.circle.map_or(middle, |circle| circle.centre_px);
    let titles = [("From left to right", "column, px"), ("From top to bottom", "row, px")];
    std::array::from_fn(|along| {
        let across = 1 - along;
        let line = centre[across].round().clamp(0.0, f64::from(size[across].max(1) - 1)) as u32;
        let (title, name) = titles[along];
        let ends = [f64::from(size[along]), 255.0];
        let mut plot = plot_from_zero([480.0, 300.0], title, [name, "grey levels"], ends);
        for side in shown.circle.iter().flat_map(|circle| [-1.0, 1.0].map(|side| (side, circle.radius_px))) {
            // Pixel k is drawn at k + 0.5, its centre.
            let at = centre[along] + 0.5 + side.0 * side.1;
            if at >= 0.0 && at <= ends[0] {
                let ends = [plot.to_canvas([at, 0.0]), plot.to_canvas([at, 255.0])];
                plot.canvas.draw_line(&ends, GREY, 1.0, None);
            }
        }
        for (image, dash) in [(&shown.real, None), (&shown.simulated, Some(4))] {
            for (channel, colour) in CHANNELS.into_iter().enumerate() {
                let level = |at: u32| {
                    let (x, y) = if along == 0 { (at, line) } else { (line, at) };
                    image.get_pixel(x, y).0[channel]
                };
                let points: Vec<Point> =
                    (0..size[along]).map(|at| plot.to_canvas([f64::from(at) + 0.5, f64::from(level(at))])).collect();
                plot.canvas.draw_line(&points, colour, 1.4, dash);
            }
        }
        plot.to_svg()
    })
}
