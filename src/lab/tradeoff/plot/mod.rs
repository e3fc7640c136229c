//! The plot for choosing a fidelity level: error against time, both logarithmic, as SVG and PNG.
//!
//! A thin line for each object, and a thick one for all samples together, whose points carry the levels' names and
//! numbers. Where finite strain was solved for, these are total errors, and finite strain stands at the lower edge,
//! because a logarithmic axis has no place for error 0; bars show its own distance from finite elements. A horizontal
//! line shows where linear theory stops, a dashed curve its numerical error. Else errors are numerical, and the reference
//! stands at the lower edge; the horizontal line is the error that labels expect of the theory, with marks at the right
//! edge for each object, and the dashed curve the sum. The more objects there are, the fainter they are, so that the
//! thick line stands out. Colours are those of Okabe and Ito, with a grey and Tol's
//! wine instead of their yellow, which is faint on white, and their black. Objects also differ in their marks, for
//! readers and printers without colours.

mod axis;
mod placement;

use axis::{Axis, has_place};
use placement::{Area, Obstacles};

use super::{LevelRow, ObjectRows, TRUTH_ERRORS_UM, Tradeoff};
use crate::page::canvas::{Canvas, Colour, Point, Shape, TextAlign, TextStyle, fit_text, text_width};
use gelsim_core::fidelity::Fidelity;
use gelsim_files::number_format::format_number;

const SIZE: [f64; 2] = [1120.0, 750.0];
/// Area of the data.
const FRAME: Area = Area { min: [72.0, 88.0], max: [880.0, 636.0] };
/// Left edge of the title and of the name of the vertical axis.
const NAME_PX: f64 = 24.0;
/// Left edges of the legend's lines and of its text.
const LEGEND_PX: [f64; 2] = [902.0, 938.0];
/// Smallest and largest distance of rows of the legend, pixels.
const ROW_PX: [f64; 2] = [13.5, 21.0];
/// Distance of lines of text, pixels.
const LINE_PX: f64 = 16.0;

const BLACK: Colour = [20, 20, 20];
const GREY: Colour = [85, 85, 85];
const WHITE: Colour = [255, 255, 255];
const COLOURS: [Colour; 8] = [
    [0, 114, 178],
    [230, 159, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [213, 94, 0],
    [136, 136, 136],
    [136, 34, 85],
];
const SHAPES: [Shape; 4] = [Shape::Circle, Shape::Square, Shape::Triangle, Shape::Diamond];
const MARK_PX: f64 = 3.0;
/// Width that a mark takes at the right edge, pixels.
const DODGE_PX: f64 = 9.0;
const LEVEL_MARK_PX: f64 = 6.5;

const TITLE: TextStyle = TextStyle { size: 20, bold: true, colour: BLACK };
const BOLD: TextStyle = TextStyle { size: 14, bold: true, colour: BLACK };
const AXIS: TextStyle = TextStyle { size: 14, bold: false, colour: BLACK };
const TICK: TextStyle = TextStyle { size: 13, bold: false, colour: BLACK };
const PLAIN: TextStyle = TextStyle { size: 12, bold: false, colour: BLACK };
const NOTE: TextStyle = TextStyle { size: 12, bold: false, colour: GREY };
const GRID_ERROR: TextStyle = TextStyle { size: 12, bold: false, colour: [160, 30, 40] };

const MODEL_ERROR: TextStyle = TextStyle { size: 12, bold: false, colour: [0, 90, 60] };

const ERROR_NAME: &str = "height error, RMS over the view (\u{b5}m)";
/// How to read the plot.
const CAPTION: &str =
    "Left is cheaper, down is more exact: choose the leftmost black point under the error that you can accept.";

/// Draws the measurements. Times and errors that cannot be shown on a logarithmic axis are left out, with two
/// exceptions for the levels over all samples: error 0 stands at the lower edge, and levels left out are named below
/// the plot.
pub fn draw_tradeoff(tradeoff: &Tradeoff) -> Canvas {
    let mut drawing = Drawing::new(tradeoff);
    drawing.draw_axes();
    let model = drawing.draw_model_error();
    let own = drawing.draw_object_model_errors();
    drawing.draw_truth_errors();
    drawing.draw_objects();
    let mut labels = drawing.draw_levels();
    labels.extend(drawing.draw_exact_level());
    labels.extend(drawing.draw_grid_error());
    labels.extend(model);
    labels.extend(own);
    labels.iter().for_each(|label| drawing.draw_label(label));
    drawing.draw_legend();
    drawing.draw_titles();
    drawing.canvas
}

struct Drawing<'a> {
    tradeoff: &'a Tradeoff,
    /// CPU time of the level that the others are measured against, ms; none if it cannot be shown.
    exact_ms: Option<f64>,
    /// Error of the reference against a grid twice as fine, um; none if it cannot be shown, or theory decides.
    grid_error_um: Option<f64>,
    /// Error of linear theory over all samples, um; none if it cannot be shown.
    model_error_um: Option<f64>,
    canvas: Canvas,
    x: Axis,
    y: Axis,
    obstacles: Obstacles,
}

/// Text to write next to a point.
struct PointLabel {
    point: Point,
    lines: Vec<(String, TextStyle)>,
}

impl<'a> Drawing<'a> {
    fn new(tradeoff: &'a Tradeoff) -> Self {
        let measured = tradeoff.measured;
        let of_level = |level: Fidelity| tradeoff.levels.iter().find(|row| row.level == level.name());
        let (exact, model) = match of_level(Fidelity::Reference) {
            Some(reference) if measured => (of_level(Fidelity::FiniteStrain), reference.total_rms_um),
            reference => (reference, tradeoff.levels.first().map(|row| row.model_rms_um)),
        };
        let grid = tradeoff.grids.iter().find(|row| row.per_px == 1.0 && !measured).map(|row| row.height_rms_um);
        let [exact_ms, grid_error_um, model_error_um] =
            [exact.map(row_ms), grid, model].map(|value| value.filter(|value| has_place(*value)));
        let rows = || tradeoff.objects.iter().flat_map(|object| &object.levels).chain(&tradeoff.levels);
        // Room at the lower edge for error 0, and at the right for the labels of the last levels.
        let row_error_um = |row: &LevelRow| row.deciding_um(measured);
        let times = rows().filter(|row| has_place(row_error_um(row))).chain(&tradeoff.levels).map(row_ms);
        let right = 0.08 + DODGE_PX / (FRAME.max[0] - FRAME.min[0]) * tradeoff.objects.len().min(12) as f64 / 2.0;
        let x = Axis::from_values(times, 0.5, [0.06, right], [FRAME.min[0], FRAME.max[0]]);
        // The vertical axis has room for the theory's error of every object, too, or for the dashed curve.
        let models = rows().map(|row| if measured { row_error_um(row) } else { row.model_rms_um });
        let numerics = tradeoff.levels.iter().filter(|_| measured).filter_map(|row| row.total_numerics_rms_um);
        let errors = rows().filter(|row| has_place(row_ms(row))).map(row_error_um);
        let errors = errors.chain(grid_error_um).chain(models).chain(numerics);
        let y = Axis::from_values(errors, 1.0, [0.13, 0.06], [FRAME.max[1], FRAME.min[1]]);
        let (canvas, obstacles) = (Canvas::new(SIZE[0], SIZE[1]), Obstacles::new(FRAME));
        Self { tradeoff, exact_ms, grid_error_um, model_error_um, canvas, x, y, obstacles }
    }

    fn row_error_um(&self, row: &LevelRow) -> f64 {
        row.deciding_um(self.tradeoff.measured)
    }

    fn row_point(&self, row: &LevelRow) -> Option<Point> {
        self.place_point(row_ms(row), self.row_error_um(row))
    }

    fn place_point(&self, ms: f64, um: f64) -> Option<Point> {
        (has_place(ms) && has_place(um)).then(|| [self.x.value_px(ms), self.y.value_px(um)])
    }

    fn format_numbers(&self, row: &LevelRow) -> String {
        match self.row_error_um(row) {
            0.0 => format!("{} ms, error 0", format_number(row_ms(row))),
            error => format!("{} ms, {} \u{b5}m", format_number(row_ms(row)), format_number(error)),
        }
    }

    fn draw_axes(&mut self) {
        let [left, top] = FRAME.min;
        let [right, bottom] = FRAME.max;
        let shade = |decade: bool| if decade { [208, 208, 208] } else { [240, 240, 240] };
        let (columns, rows) = (self.x.ticks(), self.y.ticks());
        for decade in [false, true] {
            for tick in columns.iter().filter(|tick| tick.decade == decade) {
                self.canvas.draw_line(&[[tick.px, top], [tick.px, bottom]], shade(decade), 1.0, None);
            }
            for tick in rows.iter().filter(|tick| tick.decade == decade) {
                self.canvas.draw_line(&[[left, tick.px], [right, tick.px]], shade(decade), 1.0, None);
            }
        }
        for tick in columns {
            if let Some(label) = tick.label {
                self.canvas.draw_text([tick.px, bottom + 19.0], &label, TICK, TextAlign::Middle);
            }
        }
        for tick in rows {
            if let Some(label) = tick.label {
                self.canvas.draw_text([left - 8.0, tick.px + 4.5], &label, TICK, TextAlign::Right);
            }
        }
        self.canvas.draw_line(&[[left, top], [left, bottom], [right, bottom]], GREY, 1.2, None);
    }

    fn draw_objects(&mut self) {
        let many = self.tradeoff.objects.len();
        // Faint lines weigh less as obstacles: a label may cover them rather than stand far from its point.
        let weight = (3.0 / many.max(1) as f64).min(1.0);
        for (i, object) in self.tradeoff.objects.iter().enumerate() {
            let (colour, shape) = object_style(i);
            let points: Vec<Point> = object.levels.iter().filter_map(|level| self.row_point(level)).collect();
            self.canvas.draw_line(&points, fade_colour(colour, line_share(many)), 1.2, None);
            self.obstacles.add_line(&points, weight);
            for level in &object.levels {
                let Some(point) = self.row_point(level) else { continue };
                let hint = format!("{}, {}: {}", object.object, level.level, self.format_numbers(level));
                let (colour, radius) = (fade_colour(colour, mark_share(many)), mark_px(many));
                self.canvas.draw_with_hint(&hint, |canvas| canvas.draw_mark(shape, point, radius, colour, colour));
                // A label over a line leaves the rest of it to be seen; over a mark it hides a result.
                self.obstacles.add_area(Area::centred_at(point, [2.5 * radius; 2]), 4.0 * weight);
            }
        }
    }

    /// Draws the levels over all samples. Returns their labels.
    fn draw_levels(&mut self) -> Vec<PointLabel> {
        let bottom = FRAME.max[1];
        let points: Vec<Point> = self.tradeoff.levels.iter().filter_map(|level| self.row_point(level)).collect();
        if let (Some(last), Some(ms)) = (points.last(), self.exact_ms) {
            let way = [*last, [self.x.value_px(ms), bottom]];
            self.canvas.draw_line(&way, BLACK, 1.5, Some(4));
            self.obstacles.add_line(&way, 2.0);
        }
        self.canvas.draw_line(&points, WHITE, 5.0, None);
        self.canvas.draw_line(&points, BLACK, 3.0, None);
        self.obstacles.add_line(&points, 6.0);

        let mut labels = Vec::new();
        for level in &self.tradeoff.levels {
            let exact = self.row_error_um(level) == 0.0;
            if !has_place(row_ms(level)) || exact && Some(row_ms(level)) == self.exact_ms {
                continue;
            }
            let (point, shape, text) = match self.row_point(level) {
                Some(point) => (point, Shape::Circle, self.format_numbers(level)),
                None if exact => ([self.x.value_px(row_ms(level)), bottom], Shape::Down, self.format_numbers(level)),
                None => continue,
            };
            let fill = if level.pareto { BLACK } else { WHITE };
            let hint = format!("all samples, {}: {text}", level.level);
            self.canvas.draw_with_hint(&hint, |canvas| canvas.draw_mark(shape, point, LEVEL_MARK_PX, fill, BLACK));
            self.obstacles.add_area(Area::centred_at(point, [2.2 * LEVEL_MARK_PX; 2]), 20.0);
            labels.push(PointLabel { point, lines: vec![(fit_text(&level.level, BOLD, 180.0), BOLD), (text, NOTE)] });
        }
        labels
    }

    /// Draws the level that the others are measured against at the lower edge. Returns its label.
    fn draw_exact_level(&mut self) -> Option<PointLabel> {
        let ms = self.exact_ms?;
        let [x, bottom] = [self.x.value_px(ms), FRAME.max[1]];
        let line = [[x, FRAME.min[1]], [x, bottom]];
        self.canvas.draw_line(&line, GREY, 1.2, Some(6));
        self.obstacles.add_line(&line, 2.0);
        self.canvas.draw_mark(Shape::Down, [x, bottom], LEVEL_MARK_PX, BLACK, BLACK);
        self.obstacles.add_area(Area::centred_at([x, bottom], [2.4 * LEVEL_MARK_PX; 2]), 20.0);
        let level = if self.tradeoff.measured { Fidelity::FiniteStrain } else { Fidelity::Reference };
        let mut lines =
            vec![(level.name().to_owned(), BOLD), (format!("{} ms, error 0 by definition", format_number(ms)), NOTE)];
        if self.tradeoff.measured {
            let own = TRUTH_ERRORS_UM.map(|(what, [least, most])| format!("{what} {least} to {most} \u{b5}m"));
            lines.push((String::from("bars: against finite elements,"), MODEL_ERROR));
            lines.push((own.join(", "), MODEL_ERROR));
        }
        if let Some(error) = self.grid_error_um {
            lines.push((format!("against a grid twice as fine: {} \u{b5}m", format_number(error)), NOTE));
        }
        Some(PointLabel { point: [x, bottom], lines })
    }

    /// Draws the line of the grid's own error. Returns its label.
    fn draw_grid_error(&mut self) -> Option<PointLabel> {
        let error = self.grid_error_um?;
        let y = self.y.value_px(error);
        let line = [[FRAME.min[0], y], [FRAME.max[0], y]];
        self.canvas.draw_line(&line, GRID_ERROR.colour, 1.5, Some(6));
        self.obstacles.add_line(&line, 1.0);
        let lines = vec![
            (format!("error of the grid itself: {} \u{b5}m", format_number(error)), GRID_ERROR),
            ("below this line only a finer grid helps".to_owned(), GRID_ERROR),
        ];
        Some(PointLabel { point: line[0], lines })
    }

    /// Draws the distance of finite strain from finite elements over its time.
    fn draw_truth_errors(&mut self) {
        let Some(ms) = self.exact_ms.filter(|_| self.tradeoff.measured) else { return };
        let [top, bottom] = [FRAME.min[1], FRAME.max[1]];
        for ((what, [least, most]), beside) in TRUTH_ERRORS_UM.into_iter().zip([-6.0, 6.0]) {
            let x = self.x.value_px(ms) + beside;
            let ends = [least, most].map(|um| [x, self.y.value_px(um).clamp(top, bottom)]);
            let hint = format!("{what}: finite strain is {least} to {most} \u{b5}m from finite elements");
            self.canvas.draw_with_hint(&hint, |canvas| canvas.draw_line(&ends, MODEL_ERROR.colour, 7.0, None));
            self.obstacles.add_line(&ends, 6.0);
        }
    }

    /// Draws the error of linear theory over all samples, and the dashed curve of the levels' other error: if the total
    /// one is measured, the numerical one, else the total one. Returns the label.
    fn draw_model_error(&mut self) -> Option<PointLabel> {
        let error = self.model_error_um?;
        let (y, colour) = (self.y.value_px(error), MODEL_ERROR.colour);
        let [left, right] = [FRAME.min[0], FRAME.max[0]];
        let measured = self.tradeoff.measured;
        if !measured {
            self.canvas.draw_rectangle([left, y], FRAME.max, colour, 0.07);
        }
        self.canvas.draw_line(&[[left, y], [right, y]], colour, 2.0, None);
        self.obstacles.add_line(&[[left, y], [right, y]], 1.0);
        let linear = self.tradeoff.levels.iter().take_while(|row| !measured || row.level != Fidelity::Reference.name());
        let other = |row: &LevelRow| {
            let um = if measured { row.total_numerics_rms_um } else { row.total_rms_um };
            self.place_point(row_ms(row), um?)
        };
        let curve: Vec<Point> = linear.filter_map(other).collect();
        self.canvas.draw_line(&curve, colour, 2.0, Some(3));
        self.obstacles.add_line(&curve, 2.0);
        let (what, below) = match measured {
            true => ("numerical error alone", "here the total error of linear theory ends"),
            false => ("both", "below this line a slower level gains no real accuracy"),
        };
        let lines = vec![
            (format!("error of the linear theory: {} \u{b5}m; dashed: {what}", format_number(error)), MODEL_ERROR),
            (below.to_owned(), MODEL_ERROR),
        ];
        Some(PointLabel { point: [left + 0.3 * (right - left), y], lines })
    }

    /// Draws a mark at the right edge for the theory's error of each object. Returns their label.
    fn draw_object_model_errors(&mut self) -> Option<PointLabel> {
        // Lines of measured errors lead to it, and with a single object the line over all samples shows the same.
        if self.tradeoff.measured || self.tradeoff.objects.len() < 2 {
            return None;
        }
        let own = self.tradeoff.objects.iter().enumerate().filter_map(|(i, object)| {
            let error = object.levels.first().map(|row| row.model_rms_um).filter(|error| has_place(*error))?;
            Some((i, object.object.as_str(), error, self.y.value_px(error)))
        });
        let mut own: Vec<_> = own.collect();
        own.sort_by(|(.., a), (.., b)| a.total_cmp(b));
        let right = FRAME.max[0] - DODGE_PX;
        let columns = arrange_marks(&own.iter().map(|(.., y)| *y).collect::<Vec<_>>(), DODGE_PX);
        let mut topmost = None;
        for ((i, object, error, y), column) in own.into_iter().zip(columns) {
            let (at, (colour, shape)) = ([right - DODGE_PX * column as f64, y], object_style(i));
            let hint = format!("{object}: the linear theory is off by {} \u{b5}m", format_number(error));
            self.canvas.draw_with_hint(&hint, |canvas| canvas.draw_mark(shape, at, MARK_PX, colour, colour));
            self.obstacles.add_area(Area::centred_at(at, [DODGE_PX; 2]), 20.0);
            topmost.get_or_insert(at);
        }
        let lines = ["the linear theory's", "error, by object"].map(|line| (line.to_owned(), MODEL_ERROR));
        Some(PointLabel { point: topmost?, lines: lines.to_vec() })
    }

    fn draw_label(&mut self, label: &PointLabel) {
        let place = self.obstacles.place_label(label.point, label_size(&label.lines));
        let near = place.nearest_point(label.point);
        let way = [near[0] - label.point[0], near[1] - label.point[1]];
        let distance = way[0].hypot(way[1]);
        if distance > 20.0 {
            let outside = (LEVEL_MARK_PX + 2.0) / distance;
            let start = [label.point[0] + way[0] * outside, label.point[1] + way[1] * outside];
            self.canvas.draw_line(&[start, near], GREY, 1.0, None);
        }
        // White, so that what lies below hardly shows through.
        self.canvas.draw_rectangle(place.min, place.max, WHITE, 0.8);
        for (i, (text, how)) in label.lines.iter().enumerate() {
            let baseline = place.min[1] + LINE_PX * (i as f64 + 1.0) - 3.0;
            self.canvas.draw_text([place.min[0] + 3.0, baseline], text, *how, TextAlign::Left);
        }
    }

    fn draw_legend(&mut self) {
        let [left, text_left] = LEGEND_PX;
        let middle = (left + text_left - 8.0) / 2.0;
        let mut y = FRAME.min[1] + 10.0;
        self.canvas.draw_line(&[[left, y], [text_left - 8.0, y]], BLACK, 3.0, None);
        self.canvas.draw_text([text_left, y + 4.5], "levels, over all samples", PLAIN, TextAlign::Left);
        for (fill, text) in [(BLACK, "best for its time (Pareto)"), (WHITE, "beaten by another level")] {
            y += ROW_PX[1];
            self.canvas.draw_mark(Shape::Circle, [middle, y], LEVEL_MARK_PX - 1.0, fill, BLACK);
            self.canvas.draw_text([text_left, y + 4.5], text, PLAIN, TextAlign::Left);
        }
        y += 1.8 * ROW_PX[1];
        if self.tradeoff.objects.is_empty() {
            return;
        }
        self.canvas.draw_text([left, y + 4.5], "objects", BOLD, TextAlign::Left);
        y += ROW_PX[1] + 2.0;
        let rows = ((FRAME.max[1] - y) / ROW_PX[0]) as usize + 1;
        let objects = &self.tradeoff.objects;
        let shown = if objects.len() > rows { rows - 1 } else { objects.len() };
        let row_px = ((FRAME.max[1] - y) / (objects.len() as f64)).clamp(ROW_PX[0], ROW_PX[1]);
        for (i, ObjectRows { object, .. }) in objects[..shown].iter().enumerate() {
            let (colour, shape) = object_style(i);
            self.canvas.draw_line(
                &[[left, y], [text_left - 8.0, y]],
                fade_colour(colour, line_share(objects.len())),
                1.2,
                None,
            );
            self.canvas.draw_mark(shape, [middle, y], MARK_PX + 0.4, colour, colour);
            let name = fit_text(object, PLAIN, SIZE[0] - text_left - 8.0);
            self.canvas.draw_text([text_left, y + 4.5], &name, PLAIN, TextAlign::Left);
            y += row_px;
        }
        if shown < objects.len() {
            self.canvas.draw_text(
                [text_left, y + 4.5],
                &format!("and {} more", objects.len() - shown),
                NOTE,
                TextAlign::Left,
            );
        }
    }

    /// Writes the title, the names of the axes and the caption.
    fn draw_titles(&mut self) {
        let [left, top] = FRAME.min;
        let [right, bottom] = FRAME.max;
        let title = fit_text(&self.tradeoff.job, TITLE, SIZE[0] - 2.0 * NAME_PX);
        self.canvas.draw_text([NAME_PX, 38.0], &title, TITLE, TextAlign::Left);
        self.canvas.draw_text(
            [(left + right) / 2.0, bottom + 46.0],
            "CPU time per sample (ms)",
            AXIS,
            TextAlign::Middle,
        );
        self.canvas.draw_text([NAME_PX, top - 16.0], ERROR_NAME, AXIS, TextAlign::Left);
        self.canvas.draw_text([NAME_PX, bottom + 82.0], CAPTION, AXIS, TextAlign::Left);
        let is_lost = |row: &&LevelRow| {
            let um = self.row_error_um(row);
            !has_place(row_ms(row)) || !has_place(um) && um != 0.0
        };
        let lost: Vec<&str> = self.tradeoff.levels.iter().filter(is_lost).map(|row| row.level.as_str()).collect();
        if !lost.is_empty() {
            let text = format!("Not shown, without a positive time and a number as error: {}.", lost.join(", "));
            self.canvas.draw_text(
                [NAME_PX, bottom + 104.0],
                &fit_text(&text, NOTE, right - left),
                NOTE,
                TextAlign::Left,
            );
        }
    }
}

/// Size of a label, pixels.
fn label_size(lines: &[(String, TextStyle)]) -> [f64; 2] {
    let width = lines.iter().map(|(text, how)| text_width(text, *how)).fold(0.0, f64::max);
    [width + 6.0, LINE_PX * lines.len() as f64 + 2.0]
}

fn row_ms(row: &LevelRow) -> f64 {
    row.cpu_ms_median
}

/// Colour and mark of object `i`: 32 different pairs.
fn object_style(i: usize) -> (Colour, Shape) {
    (COLOURS[i % COLOURS.len()], SHAPES[(i + i / COLOURS.len()) % SHAPES.len()])
}

/// Moves a colour towards white by this share.
fn fade_colour(colour: Colour, share: f64) -> Colour {
    colour.map(|level| (f64::from(level) + share * (255.0 - f64::from(level))).round() as u8)
}

/// Share by which the lines of so many objects are faded towards white.
fn line_share(objects: usize) -> f64 {
    (0.33 + 0.045 * objects.saturating_sub(3) as f64).min(0.78)
}

/// Share by which their marks are faded towards white: less than their lines.
fn mark_share(objects: usize) -> f64 {
    line_share(objects) - 0.33
}

/// Radius of the marks of so many objects, pixels.
fn mark_px(objects: usize) -> f64 {
    if objects > 6 { 2.4 } else { MARK_PX }
}

/// Arranges marks of `size` at sorted heights in columns, counted from the edge, so that none overlap.
fn arrange_marks(heights: &[f64], size: f64) -> Vec<usize> {
    let mut ends: Vec<f64> = Vec::new();
    let place = |height: &f64| {
        let column = ends.iter().position(|end| *end + size <= *height).unwrap_or(ends.len());
        ends.resize(ends.len().max(column + 1), *height);
        ends[column] = *height;
        column
    };
    heights.iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::tradeoff::GridRow;
    use crate::tradeoff::errors::MeanErrors;

    fn row(name: &str, cpu_ms_median: f64, height_rms_um: f64, pareto: bool) -> LevelRow {
        let (model_rms_um, total_rms_um) = (7.0, Some(height_rms_um.hypot(7.0)));
        let errors = MeanErrors { height_rms_um, ..MeanErrors::default() };
        let level = name.to_owned();
        LevelRow { level, errors, model_rms_um, total_rms_um, cpu_ms_median, pareto, ..LevelRow::default() }
    }

    fn make_job(job: &str, objects: Vec<ObjectRows>, levels: Vec<LevelRow>, height_rms_um: f64) -> Tradeoff {
        let grids = vec![GridRow { per_px: 1.0, height_rms_um, ..GridRow::default() }];
        Tradeoff { job: job.to_owned(), objects, levels, grids, ..Tradeoff::default() }
    }

    fn example(objects: &[&str]) -> Tradeoff {
        let levels = [("paper", 2.5, 50.0), ("draft", 1.5, 4.7), ("high", 15.0, 0.04), ("reference", 60.0, 0.0)];
        let all = levels.map(|(name, ms, error_um)| row(name, ms, error_um, name != "paper"));
        let object = |(i, name): (usize, &&str)| {
            let apart =
                |(name, ms, error_um)| row(name, ms * (1.0 + 0.1 * i as f64), error_um / (1.0 + i as f64), false);
            ObjectRows { object: (*name).to_owned(), levels: levels.map(apart).to_vec() }
        };
        make_job("all \"objects\" < 5 $ & $\u{1}", objects.iter().enumerate().map(object).collect(), all.to_vec(), 1.2)
    }

    const NAMES: [&str; 8] = ["sphere", "torus", "dots", "hexagon_nut", "coin", "gear", "letter", "rope"];

    fn texts(svg: &str) -> Vec<String> {
        let document = roxmltree::Document::parse(svg).expect("the SVG is XML");
        let texts = document.descendants().filter(|node| node.has_tag_name("text"));
        texts.map(|node| node.text().unwrap_or_default().to_owned()).collect()
    }

    #[test]
    fn everything_needed_to_choose_a_level_is_written_on_the_plot() {
        let found = texts(&draw_tradeoff(&example(&NAMES)).to_svg().0);
        let numbers = [
            "1.5 ms, 4.7 \u{b5}m",
            "60 ms, error 0 by definition",
            "against a grid twice as fine: 1.2 \u{b5}m",
            "error of the linear theory: 7 \u{b5}m; dashed: both",
        ];
        let words = ["all \"objects\" < 5 $ & $ ", "CPU time per sample (ms)", ERROR_NAME, CAPTION];
        let names = ["paper", "draft", "high", "reference"].into_iter().chain(NAMES);
        for wanted in names.chain(numbers).chain(words) {
            assert_eq!(found.iter().filter(|text| *text == wanted).count(), 1, "{wanted} in {found:?}");
        }
    }

    #[test]
    fn measured_total_errors_have_finite_strain_at_the_lower_edge_and_no_sums() {
        let mut tradeoff = example(&NAMES);
        tradeoff.measured = true;
        let mut exact = row("finite-strain", 200.0, 11.0, true);
        exact.total_rms_um = Some(0.0);
        tradeoff.levels.push(exact);
        let found = texts(&draw_tradeoff(&tradeoff).to_svg().0);
        let lines = [
            "200 ms, error 0 by definition",
            "balls 0.2 to 1.6 \u{b5}m, walls 1.3 to 9 \u{b5}m",
            "60 ms, 7 \u{b5}m",
            "error of the linear theory: 7 \u{b5}m; dashed: numerical error alone",
        ];
        for wanted in lines {
            assert_eq!(found.iter().filter(|text| *text == wanted).count(), 1, "{wanted} in {found:?}");
        }
        assert!(!found.iter().any(|text| text.contains("by object") || text.contains("grid twice")), "{found:?}");
    }

    #[test]
    fn the_more_objects_the_fainter_and_the_thick_line_stays_dark() {
        let lightest = |count: usize| {
            let names: Vec<String> = (0..count).map(|i| format!("object {i}")).collect();
            let svg = draw_tradeoff(&example(&names.iter().map(String::as_str).collect::<Vec<_>>())).to_svg().0;
            let explained = texts(&svg).iter().filter(|text| *text == "the linear theory's").count();
            assert_eq!(explained, usize::from(count > 1), "{count}");
            let document = roxmltree::Document::parse(&svg).expect("the SVG is XML");
            let lines = document.descendants().filter(|node| node.attribute("stroke-width") == Some("1.2"));
            let strokes = lines.filter(|node| node.attribute("stroke-dasharray").is_none());
            let light = strokes.filter_map(|node| u32::from_str_radix(&node.attribute("stroke")?[5..7], 16).ok());
            light.max().expect("lines")
        };
        assert!(lightest(1) < lightest(12) && lightest(12) < 250);
        assert_eq!(fade_colour([0, 100, 200], 0.5), [128, 178, 228]);
        assert_eq!([1, 3, 12, 30].map(|count| (100.0 * line_share(count)).round()), [33.0, 33.0, 74.0, 78.0]);
    }

    #[test]
    fn marks_at_one_height_lie_beside_each_other() {
        assert_eq!(arrange_marks(&[1.0, 2.0, 3.0, 20.0, 21.0], 8.0), [0, 1, 2, 0, 1]);
        assert_eq!(arrange_marks(&[1.0, 9.0, 10.0], 8.0), [0, 0, 1]);
        assert!(arrange_marks(&[], 8.0).is_empty());
    }

    #[test]
    fn the_png_shows_text_and_lines_and_is_the_same_every_time() {
        let png = draw_tradeoff(&example(&NAMES)).to_png();
        assert_eq!(png, draw_tradeoff(&example(&NAMES)).to_png());
        let png = image::load_from_memory(&png).expect("the PNG can be read").to_rgb8();
        assert_eq!(png.dimensions(), (2240, 1500));
        let dark = |x0: u32, y0: u32, x1: u32, y1: u32| {
            let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
            pixels.filter(|(x, y)| png.get_pixel(*x, *y).0.iter().all(|level| *level < 110)).count()
        };
        // Title, legend, caption; and the white margin over the title.
        assert!(dark(48, 40, 700, 90) > 1500);
        assert!(dark(1850, 140, 2200, 700) > 1500);
        assert!(dark(48, 1400, 1800, 1460) > 1500);
        assert_eq!(dark(0, 0, 2240, 30), 0);
    }

    #[test]
    fn levels_that_cannot_be_shown_are_named() {
        let mut tradeoff = example(&NAMES[..1]);
        tradeoff.levels[0].errors.height_rms_um = f64::NAN;
        tradeoff.levels[1].cpu_ms_median = 0.0;
        tradeoff.levels[2].errors.height_rms_um = 0.0;
        let found = texts(&draw_tradeoff(&tradeoff).to_svg().0);
        assert!(found.iter().any(|text| text.contains("Not shown") && text.contains("paper, draft")), "{found:?}");
        assert!(found.iter().any(|text| text == "15 ms, error 0"), "{found:?}");
    }

    fn numbers() -> impl Strategy<Value = f64> {
        let odd = [0.0, -0.0, -1.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, 1e-300, f64::MAX];
        prop_oneof![prop::sample::select(odd.to_vec()), 1e-3f64..1e3]
    }

    fn levels() -> impl Strategy<Value = Vec<LevelRow>> {
        let odd = ("[a-c<&$\\u{0}\u{b5}]{0,8}|reference|finite-strain", numbers(), numbers(), any::<bool>());
        prop::collection::vec(odd.prop_map(|(name, ms, error_um, pareto)| row(&name, ms, error_um, pareto)), 0..6)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn no_numbers_are_too_odd_to_be_drawn(
            job in any::<String>(),
            objects in prop::collection::vec((any::<String>(), levels()), 0..4),
            all in levels(),
            grid_error_um in numbers(),
            measured in any::<bool>(),
        ) {
            let objects = objects.into_iter().map(|(object, levels)| ObjectRows { object, levels }).collect();
            let tradeoff = make_job(&job, objects, all, grid_error_um);
            let canvas = draw_tradeoff(&Tradeoff { measured, ..tradeoff });
            let svg = canvas.to_svg().0;
            texts(&svg);
            prop_assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", svg);
            canvas.to_png();
        }
    }
}
