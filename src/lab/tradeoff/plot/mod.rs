//! The plot from which a fidelity level is chosen: error against time, logarithmic on both axes, as SVG and PNG.
//!
//! A thin line for each object, a thick one for all samples together, whose points carry the levels' names and numbers.
//! A line across shows what the theory itself is off by, a dashed curve that and the level's error together: below the
//! line, time buys digits that the model does not have.
//! The more objects there are, the fainter they are, so that the thick line stays what is seen first; marks at the right edge
//! say what the theory is off by for each. The reference stands at the lower edge, because error 0 is on no logarithmic axis. Colours are those of Okabe and Ito,
//! with a grey and Tol's wine instead of their yellow, which is faint on white, and their black. Objects differ in their
//! marks too, for eyes and printers without colours.

mod axis;
mod placement;

use axis::{Axis, has_place};
use placement::{Area, Obstacles};

use super::{ObjectRows, Row, Tradeoff};
use crate::page::canvas::{Align, Canvas, Colour, Point, Shape, Type, fitted, width};
use gelsim_core::fidelity::Fidelity;
use gelsim_files::figures::figure;

const SIZE: [f64; 2] = [1120.0, 750.0];
/// Where the data are.
const FRAME: Area = Area { min: [72.0, 88.0], max: [880.0, 636.0] };
/// Left edge of the title and of the error's name.
const NAME_PX: f64 = 24.0;
/// Left edges of the legend's lines and of its text.
const LEGEND_PX: [f64; 2] = [902.0, 938.0];
/// Rows of the legend, pixels apart, at least and at most.
const ROW_PX: [f64; 2] = [13.5, 21.0];
/// Lines of text, pixels apart.
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
/// Room that a mark takes at the right edge, pixels.
const DODGE_PX: f64 = 9.0;
const LEVEL_MARK_PX: f64 = 6.5;

const TITLE: Type = Type { size: 20, bold: true, colour: BLACK };
const BOLD: Type = Type { size: 14, bold: true, colour: BLACK };
const AXIS: Type = Type { size: 14, bold: false, colour: BLACK };
const TICK: Type = Type { size: 13, bold: false, colour: BLACK };
const PLAIN: Type = Type { size: 12, bold: false, colour: BLACK };
const NOTE: Type = Type { size: 12, bold: false, colour: GREY };
const GRID_ERROR: Type = Type { size: 12, bold: false, colour: [160, 30, 40] };

const MODEL_ERROR: Type = Type { size: 12, bold: false, colour: [0, 90, 60] };

const ERROR_NAME: &str = "height error, RMS over the view (\u{b5}m)";
/// How to read the plot.
const CAPTION: &str =
    "Left is cheaper, down is more exact: choose the leftmost black point under the error that you can accept.";

/// Draws what was measured. Times and errors that have no place on a logarithmic axis are left out; of all samples, a
/// level with error 0 is shown at the lower edge, and one without place is named below the plot.
pub fn draw(tradeoff: &Tradeoff) -> Canvas {
    let mut drawing = Drawing::new(tradeoff);
    drawing.axes();
    let model = drawing.model_error();
    let own = drawing.model_errors_of_objects();
    drawing.objects();
    let mut labels = drawing.levels();
    labels.extend(drawing.reference());
    labels.extend(drawing.grid_error());
    labels.extend(model);
    labels.extend(own);
    labels.iter().for_each(|label| drawing.label(label));
    drawing.legend();
    drawing.words();
    drawing.canvas
}

struct Drawing<'a> {
    tradeoff: &'a Tradeoff,
    /// CPU time of the reference, ms, and its error against a grid twice as fine, um, where they have places.
    reference_ms: Option<f64>,
    grid_error_um: Option<f64>,
    /// What the reference's theory is off by, um, over all samples.
    model_error_um: Option<f64>,
    canvas: Canvas,
    x: Axis,
    y: Axis,
    obstacles: Obstacles,
}

/// What is to be written beside a point.
struct Label {
    point: Point,
    lines: Vec<(String, Type)>,
}

impl<'a> Drawing<'a> {
    fn new(tradeoff: &'a Tradeoff) -> Self {
        let reference = tradeoff.levels.iter().find(|row| row.level == Fidelity::Reference.name()).map(ms);
        let grid = tradeoff.grids.iter().find(|row| row.per_px == 1.0).map(|row| row.height_rms_um);
        let model = tradeoff.levels.first().map(|row| row.errors.model_rms_um);
        let [reference_ms, grid_error_um, model_error_um] =
            [reference, grid, model].map(|value| value.filter(|value| has_place(*value)));
        let rows = || tradeoff.objects.iter().flat_map(|object| &object.levels).chain(&tradeoff.levels);
        // Room at the lower edge for what has error 0, at the right for the names of the last levels.
        let times = rows().filter(|row| has_place(error_um(row))).chain(&tradeoff.levels).map(ms);
        let right = 0.08 + DODGE_PX / (FRAME.max[0] - FRAME.min[0]) * tradeoff.objects.len().min(12) as f64 / 2.0;
        let x = Axis::over(times, 0.5, [0.06, right], [FRAME.min[0], FRAME.max[0]]);
        // Of every object.
        let models = rows().map(|row| row.errors.model_rms_um);
        let errors = rows().filter(|row| has_place(ms(row))).map(error_um).chain(grid_error_um).chain(models);
        let y = Axis::over(errors, 1.0, [0.13, 0.06], [FRAME.max[1], FRAME.min[1]]);
        let (canvas, obstacles) = (Canvas::new(SIZE[0], SIZE[1]), Obstacles::new(FRAME));
        Self { tradeoff, reference_ms, grid_error_um, model_error_um, canvas, x, y, obstacles }
    }

    fn place(&self, row: &Row) -> Option<Point> {
        (has_place(ms(row)) && has_place(error_um(row))).then(|| [self.x.px(ms(row)), self.y.px(error_um(row))])
    }

    fn axes(&mut self) {
        let [left, top] = FRAME.min;
        let [right, bottom] = FRAME.max;
        let shade = |decade: bool| if decade { [208, 208, 208] } else { [240, 240, 240] };
        let (columns, rows) = (self.x.ticks(), self.y.ticks());
        for decade in [false, true] {
            for tick in columns.iter().filter(|tick| tick.decade == decade) {
                self.canvas.line(&[[tick.px, top], [tick.px, bottom]], shade(decade), 1.0, None);
            }
            for tick in rows.iter().filter(|tick| tick.decade == decade) {
                self.canvas.line(&[[left, tick.px], [right, tick.px]], shade(decade), 1.0, None);
            }
        }
        for tick in columns {
            if let Some(label) = tick.label {
                self.canvas.text([tick.px, bottom + 19.0], &label, TICK, Align::Middle);
            }
        }
        for tick in rows {
            if let Some(label) = tick.label {
                self.canvas.text([left - 8.0, tick.px + 4.5], &label, TICK, Align::Right);
            }
        }
        self.canvas.line(&[[left, top], [left, bottom], [right, bottom]], GREY, 1.2, None);
    }

    fn objects(&mut self) {
        let many = self.tradeoff.objects.len();
        // Labels may cover faint lines rather than stand far from their points.
        let weight = (3.0 / many.max(1) as f64).min(1.0);
        for (i, object) in self.tradeoff.objects.iter().enumerate() {
            let (colour, shape) = style(i);
            let points: Vec<Point> = object.levels.iter().filter_map(|level| self.place(level)).collect();
            self.canvas.line(&points, faint(colour, line_share(many)), 1.2, None);
            self.obstacles.line(&points, weight);
            for level in &object.levels {
                let Some(point) = self.place(level) else { continue };
                let hint = format!("{}, {}: {}", object.object, level.level, numbers(level));
                let (colour, radius) = (faint(colour, mark_share(many)), mark_px(many));
                self.canvas.hinted(&hint, |canvas| canvas.mark(shape, point, radius, colour, colour));
                self.obstacles.area(Area::around(point, [2.5 * radius; 2]), weight);
            }
        }
    }

    /// All samples together; returns what to write beside the levels.
    fn levels(&mut self) -> Vec<Label> {
        let bottom = FRAME.max[1];
        let points: Vec<Point> = self.tradeoff.levels.iter().filter_map(|level| self.place(level)).collect();
        if let (Some(last), Some(ms)) = (points.last(), self.reference_ms) {
            let way = [*last, [self.x.px(ms), bottom]];
            self.canvas.line(&way, BLACK, 1.5, Some(4));
            self.obstacles.line(&way, 2.0);
        }
        self.canvas.line(&points, WHITE, 5.0, None);
        self.canvas.line(&points, BLACK, 3.0, None);
        self.obstacles.line(&points, 6.0);

        let mut labels = Vec::new();
        for level in &self.tradeoff.levels {
            let exact = error_um(level) == 0.0;
            if !has_place(ms(level)) || exact && Some(ms(level)) == self.reference_ms {
                continue;
            }
            let (point, shape, text) = match self.place(level) {
                Some(point) => (point, Shape::Circle, numbers(level)),
                None if exact => ([self.x.px(ms(level)), bottom], Shape::Down, numbers(level)),
                None => continue,
            };
            let fill = if level.pareto { BLACK } else { WHITE };
            let hint = format!("all samples, {}: {text}", level.level);
            self.canvas.hinted(&hint, |canvas| canvas.mark(shape, point, LEVEL_MARK_PX, fill, BLACK));
            self.obstacles.area(Area::around(point, [2.2 * LEVEL_MARK_PX; 2]), 20.0);
            labels.push(Label { point, lines: vec![(fitted(&level.level, BOLD, 180.0), BOLD), (text, NOTE)] });
        }
        labels
    }

    /// The reference at the lower edge; returns what to write beside it.
    fn reference(&mut self) -> Option<Label> {
        let ms = self.reference_ms?;
        let [x, bottom] = [self.x.px(ms), FRAME.max[1]];
        let line = [[x, FRAME.min[1]], [x, bottom]];
        self.canvas.line(&line, GREY, 1.2, Some(6));
        self.obstacles.line(&line, 2.0);
        self.canvas.mark(Shape::Down, [x, bottom], LEVEL_MARK_PX, BLACK, BLACK);
        self.obstacles.area(Area::around([x, bottom], [2.4 * LEVEL_MARK_PX; 2]), 20.0);
        let mut lines =
            vec![("reference".to_owned(), BOLD), (format!("{} ms, error 0 by definition", figure(ms)), NOTE)];
        if let Some(error) = self.grid_error_um {
            lines.push((format!("against a grid twice as fine: {} \u{b5}m", figure(error)), NOTE));
        }
        Some(Label { point: [x, bottom], lines })
    }

    /// The level of the grid's own error; returns what to write beside it.
    fn grid_error(&mut self) -> Option<Label> {
        let error = self.grid_error_um?;
        let y = self.y.px(error);
        let line = [[FRAME.min[0], y], [FRAME.max[0], y]];
        self.canvas.line(&line, GRID_ERROR.colour, 1.5, Some(6));
        self.obstacles.line(&line, 1.0);
        let lines = vec![
            (format!("error of the grid itself: {} \u{b5}m", figure(error)), GRID_ERROR),
            ("below this line only a finer grid helps".to_owned(), GRID_ERROR),
        ];
        Some(Label { point: line[0], lines })
    }

    /// What the theory itself is off by over all samples, and that together with the levels' errors. Returns what to write beside
    /// it.
    fn model_error(&mut self) -> Option<Label> {
        let error = self.model_error_um?;
        let (y, colour) = (self.y.px(error), MODEL_ERROR.colour);
        let [left, right] = [FRAME.min[0], FRAME.max[0]];
        self.canvas.rectangle([left, y], FRAME.max, colour, 0.07);
        self.canvas.line(&[[left, y], [right, y]], colour, 2.0, None);
        self.obstacles.line(&[[left, y], [right, y]], 1.0);
        let total = |row: &Row| row.errors.total_rms_um;
        let shown = self.tradeoff.levels.iter().filter(|row| has_place(ms(row)) && has_place(total(row)));
        let both: Vec<Point> = shown.map(|row| [self.x.px(ms(row)), self.y.px(total(row))]).collect();
        self.canvas.line(&both, colour, 2.0, Some(3));
        self.obstacles.line(&both, 2.0);
        let lines = vec![
            (format!("error of the linear theory: {} \u{b5}m; dashed: both", figure(error)), MODEL_ERROR),
            ("below this line time buys digits that the model does not have".to_owned(), MODEL_ERROR),
        ];
        Some(Label { point: [left + 0.3 * (right - left), y], lines })
    }

    /// At the right edge what the theory is off by for each object; returns what to write beside it.
    fn model_errors_of_objects(&mut self) -> Option<Label> {
        // Of a single one the line says the same.
        if self.tradeoff.objects.len() < 2 {
            return None;
        }
        let own = self.tradeoff.objects.iter().enumerate().filter_map(|(i, object)| {
            let error = object.levels.first().map(|row| row.errors.model_rms_um).filter(|error| has_place(*error))?;
            Some((i, object.object.as_str(), error, self.y.px(error)))
        });
        let mut own: Vec<_> = own.collect();
        own.sort_by(|(.., a), (.., b)| a.total_cmp(b));
        let right = FRAME.max[0] - DODGE_PX;
        let columns = side_by_side(&own.iter().map(|(.., y)| *y).collect::<Vec<_>>(), DODGE_PX);
        let mut topmost = None;
        for ((i, object, error, y), column) in own.into_iter().zip(columns) {
            let (at, (colour, shape)) = ([right - DODGE_PX * column as f64, y], style(i));
            let hint = format!("{object}: the linear theory is off by {} \u{b5}m", figure(error));
            self.canvas.hinted(&hint, |canvas| canvas.mark(shape, at, MARK_PX, colour, colour));
            self.obstacles.area(Area::around(at, [DODGE_PX; 2]), 20.0);
            topmost.get_or_insert(at);
        }
        let lines = ["the linear theory's", "error, by object"].map(|line| (line.to_owned(), MODEL_ERROR));
        Some(Label { point: topmost?, lines: lines.to_vec() })
    }

    fn label(&mut self, label: &Label) {
        let place = self.obstacles.beside(label.point, size(&label.lines));
        let near = place.nearest(label.point);
        let way = [near[0] - label.point[0], near[1] - label.point[1]];
        let distance = way[0].hypot(way[1]);
        if distance > 20.0 {
            let outside = (LEVEL_MARK_PX + 2.0) / distance;
            let start = [label.point[0] + way[0] * outside, label.point[1] + way[1] * outside];
            self.canvas.line(&[start, near], GREY, 1.0, None);
        }
        // On a ground that lets little through.
        self.canvas.rectangle(place.min, place.max, WHITE, 0.8);
        for (i, (text, how)) in label.lines.iter().enumerate() {
            let baseline = place.min[1] + LINE_PX * (i as f64 + 1.0) - 3.0;
            self.canvas.text([place.min[0] + 3.0, baseline], text, *how, Align::Left);
        }
    }

    fn legend(&mut self) {
        let [left, text_left] = LEGEND_PX;
        let middle = (left + text_left - 8.0) / 2.0;
        let mut y = FRAME.min[1] + 10.0;
        self.canvas.line(&[[left, y], [text_left - 8.0, y]], BLACK, 3.0, None);
        self.canvas.text([text_left, y + 4.5], "levels, over all samples", PLAIN, Align::Left);
        for (fill, text) in [(BLACK, "best for its time (Pareto)"), (WHITE, "beaten by another level")] {
            y += ROW_PX[1];
            self.canvas.mark(Shape::Circle, [middle, y], LEVEL_MARK_PX - 1.0, fill, BLACK);
            self.canvas.text([text_left, y + 4.5], text, PLAIN, Align::Left);
        }
        y += 1.8 * ROW_PX[1];
        if self.tradeoff.objects.is_empty() {
            return;
        }
        self.canvas.text([left, y + 4.5], "objects", BOLD, Align::Left);
        y += ROW_PX[1] + 2.0;
        let rows = ((FRAME.max[1] - y) / ROW_PX[0]) as usize + 1;
        let objects = &self.tradeoff.objects;
        let shown = if objects.len() > rows { rows - 1 } else { objects.len() };
        let pitch = ((FRAME.max[1] - y) / (objects.len() as f64)).clamp(ROW_PX[0], ROW_PX[1]);
        for (i, ObjectRows { object, .. }) in objects[..shown].iter().enumerate() {
            let (colour, shape) = style(i);
            self.canvas.line(&[[left, y], [text_left - 8.0, y]], faint(colour, line_share(objects.len())), 1.2, None);
            self.canvas.mark(shape, [middle, y], MARK_PX + 0.4, colour, colour);
            let name = fitted(object, PLAIN, SIZE[0] - text_left - 8.0);
            self.canvas.text([text_left, y + 4.5], &name, PLAIN, Align::Left);
            y += pitch;
        }
        if shown < objects.len() {
            self.canvas.text([text_left, y + 4.5], &format!("and {} more", objects.len() - shown), NOTE, Align::Left);
        }
    }

    /// Title, names of the axes, caption.
    fn words(&mut self) {
        let [left, top] = FRAME.min;
        let [right, bottom] = FRAME.max;
        let title = fitted(&self.tradeoff.job, TITLE, SIZE[0] - 2.0 * NAME_PX);
        self.canvas.text([NAME_PX, 38.0], &title, TITLE, Align::Left);
        self.canvas.text([(left + right) / 2.0, bottom + 46.0], "CPU time per sample (ms)", AXIS, Align::Middle);
        self.canvas.text([NAME_PX, top - 16.0], ERROR_NAME, AXIS, Align::Left);
        self.canvas.text([NAME_PX, bottom + 82.0], CAPTION, AXIS, Align::Left);
        let is_lost = |row: &&Row| !has_place(ms(row)) || !has_place(error_um(row)) && error_um(row) != 0.0;
        let lost: Vec<&str> = self.tradeoff.levels.iter().filter(is_lost).map(|row| row.level.as_str()).collect();
        if !lost.is_empty() {
            let text = format!("Not shown, without a positive time and a number as error: {}.", lost.join(", "));
            self.canvas.text([NAME_PX, bottom + 104.0], &fitted(&text, NOTE, right - left), NOTE, Align::Left);
        }
    }
}

/// Size of a label, pixels.
fn size(lines: &[(String, Type)]) -> [f64; 2] {
    let width = lines.iter().map(|(text, how)| width(text, *how)).fold(0.0, f64::max);
    [width + 6.0, LINE_PX * lines.len() as f64 + 2.0]
}

fn ms(row: &Row) -> f64 {
    row.cpu_ms_median
}

fn error_um(row: &Row) -> f64 {
    row.errors.height_rms_um
}

fn numbers(row: &Row) -> String {
    match error_um(row) {
        0.0 => format!("{} ms, error 0", figure(ms(row))),
        error => format!("{} ms, {} \u{b5}m", figure(ms(row)), figure(error)),
    }
}

/// Colour and mark of object `i`: 32 pairs before one returns.
fn style(i: usize) -> (Colour, Shape) {
    (COLOURS[i % COLOURS.len()], SHAPES[(i + i / COLOURS.len()) % SHAPES.len()])
}

/// The same colour, nearer to white by this share of the way.
fn faint(colour: Colour, share: f64) -> Colour {
    colour.map(|level| (f64::from(level) + share * (255.0 - f64::from(level))).round() as u8)
}

/// How near to white the lines of so many objects are.
fn line_share(objects: usize) -> f64 {
    (0.33 + 0.045 * objects.saturating_sub(3) as f64).min(0.78)
}

/// The same of their marks.
fn mark_share(objects: usize) -> f64 {
    line_share(objects) - 0.33
}

/// Radius of the marks of so many objects.
fn mark_px(objects: usize) -> f64 {
    if objects > 6 { 2.4 } else { MARK_PX }
}

/// Columns, counted from the edge, in which marks at sorted heights lie without one on another of `size`.
fn side_by_side(heights: &[f64], size: f64) -> Vec<usize> {
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
    use crate::tradeoff::errors::Mean;

    fn row(name: &str, cpu_ms_median: f64, height_rms_um: f64, pareto: bool) -> Row {
        let (model_rms_um, total_rms_um) = (7.0, height_rms_um.hypot(7.0));
        let errors = Mean { height_rms_um, model_rms_um, total_rms_um, ..Mean::default() };
        Row { level: name.to_owned(), errors, cpu_ms_median, pareto, ..Row::default() }
    }

    fn whole(job: &str, objects: Vec<ObjectRows>, levels: Vec<Row>, height_rms_um: f64) -> Tradeoff {
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
        whole("all \"objects\" < 5 $ & $\u{1}", objects.iter().enumerate().map(object).collect(), all.to_vec(), 1.2)
    }

    const NAMES: [&str; 8] = ["sphere", "torus", "dots", "hexagon_nut", "coin", "gear", "letter", "rope"];

    fn texts(svg: &str) -> Vec<String> {
        let document = roxmltree::Document::parse(svg).expect("the SVG is XML");
        let texts = document.descendants().filter(|node| node.has_tag_name("text"));
        texts.map(|node| node.text().unwrap_or_default().to_owned()).collect()
    }

    #[test]
    fn everything_needed_to_choose_a_level_is_written_on_the_plot() {
        let found = texts(&draw(&example(&NAMES)).svg().0);
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
    fn the_more_objects_the_fainter_and_the_thick_line_stays_dark() {
        let lightest = |count: usize| {
            let names: Vec<String> = (0..count).map(|i| format!("object {i}")).collect();
            let svg = draw(&example(&names.iter().map(String::as_str).collect::<Vec<_>>())).svg().0;
            let explained = texts(&svg).iter().filter(|text| *text == "the linear theory's").count();
            assert_eq!(explained, usize::from(count > 1), "{count}");
            let document = roxmltree::Document::parse(&svg).expect("the SVG is XML");
            let lines = document.descendants().filter(|node| node.attribute("stroke-width") == Some("1.2"));
            let strokes = lines.filter(|node| node.attribute("stroke-dasharray").is_none());
            let light = strokes.filter_map(|node| u32::from_str_radix(&node.attribute("stroke")?[5..7], 16).ok());
            light.max().expect("lines")
        };
        assert!(lightest(1) < lightest(12) && lightest(12) < 250);
        assert_eq!(faint([0, 100, 200], 0.5), [128, 178, 228]);
        assert_eq!([1, 3, 12, 30].map(|count| (100.0 * line_share(count)).round()), [33.0, 33.0, 74.0, 78.0]);
    }

    #[test]
    fn marks_at_one_height_lie_beside_each_other() {
        assert_eq!(side_by_side(&[1.0, 2.0, 3.0, 20.0, 21.0], 8.0), [0, 1, 2, 0, 1]);
        assert_eq!(side_by_side(&[1.0, 9.0, 10.0], 8.0), [0, 0, 1]);
        assert!(side_by_side(&[], 8.0).is_empty());
    }

    #[test]
    fn the_png_shows_text_and_lines_and_is_the_same_every_time() {
        let png = draw(&example(&NAMES)).png();
        assert_eq!(png, draw(&example(&NAMES)).png());
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
        let found = texts(&draw(&tradeoff).svg().0);
        assert!(found.iter().any(|text| text.contains("Not shown") && text.contains("paper, draft")), "{found:?}");
        assert!(found.iter().any(|text| text == "15 ms, error 0"), "{found:?}");
    }

    fn numbers() -> impl Strategy<Value = f64> {
        let odd = [0.0, -0.0, -1.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, 1e-300, f64::MAX];
        prop_oneof![prop::sample::select(odd.to_vec()), 1e-3f64..1e3]
    }

    fn levels() -> impl Strategy<Value = Vec<Row>> {
        let odd = ("[a-c<&$\\u{0}\u{b5}]{0,8}|reference", numbers(), numbers(), any::<bool>());
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
        ) {
            let objects = objects.into_iter().map(|(object, levels)| ObjectRows { object, levels }).collect();
            let canvas = draw(&whole(&job, objects, all, grid_error_um));
            let svg = canvas.svg().0;
            texts(&svg);
            prop_assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", svg);
            canvas.png();
        }
    }
}
