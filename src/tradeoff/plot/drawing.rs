//! The parts of the plot, from the grid lines to the caption.
//!
//! Colours are those of Okabe and Ito, with a grey and Tol's wine instead of their yellow, which is faint on white, and
//! their black. Objects differ in their marks too, for eyes and printers without colours.

use super::axis::{Axis, has_place, short};
use super::ink::{Align, Colour, Page, Point, Shape, Type, fitted, width};
use super::placement::{Area, Obstacles};
use super::{Object, Plot, Rung};

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
const RUNG_MARK_PX: f64 = 6.5;

const TITLE: Type = Type { size: 20, bold: true, colour: BLACK };
const BOLD: Type = Type { size: 14, bold: true, colour: BLACK };
const AXIS: Type = Type { size: 14, bold: false, colour: BLACK };
const TICK: Type = Type { size: 13, bold: false, colour: BLACK };
const PLAIN: Type = Type { size: 12, bold: false, colour: BLACK };
const NOTE: Type = Type { size: 12, bold: false, colour: GREY };
const GRID_ERROR: Type = Type { size: 12, bold: false, colour: [160, 30, 40] };

/// How to read the plot.
pub const CAPTION: &str =
    "Left is cheaper, down is more exact: choose the leftmost black point under the error that you can accept.";

/// Draws `plot`.
pub fn draw(plot: &Plot) -> Page {
    let mut drawing = Drawing::new(plot);
    drawing.axes();
    drawing.objects();
    let labels = drawing.rungs();
    drawing.reference();
    drawing.grid_error();
    labels.iter().for_each(|label| drawing.label(label));
    drawing.reference_label();
    drawing.grid_error_label();
    drawing.legend();
    drawing.words();
    drawing.page
}

struct Drawing<'a> {
    plot: &'a Plot,
    page: Page,
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
    fn new(plot: &'a Plot) -> Self {
        let rungs = || plot.objects.iter().flat_map(|object| &object.rungs).chain(&plot.all);
        // Room at the lower edge for what has error 0, at the right for the names of the last rungs.
        let times = rungs().filter(|rung| has_place(rung.error_um)).chain(&plot.all).map(|rung| rung.ms);
        let x = Axis::over(times.chain([plot.reference_ms]), 0.5, [0.06, 0.08], [FRAME.min[0], FRAME.max[0]]);
        let errors = rungs().filter(|rung| has_place(rung.ms)).map(|rung| rung.error_um).chain(plot.grid_error_um);
        let y = Axis::over(errors, 1.0, [0.13, 0.06], [FRAME.max[1], FRAME.min[1]]);
        Self { plot, page: Page::new(SIZE[0], SIZE[1]), x, y, obstacles: Obstacles::new(FRAME) }
    }

    fn place(&self, rung: &Rung) -> Option<Point> {
        (has_place(rung.ms) && has_place(rung.error_um)).then(|| [self.x.px(rung.ms), self.y.px(rung.error_um)])
    }

    fn axes(&mut self) {
        let [left, top] = FRAME.min;
        let [right, bottom] = FRAME.max;
        let shade = |decade: bool| if decade { [208, 208, 208] } else { [240, 240, 240] };
        let (columns, rows) = (self.x.ticks(), self.y.ticks());
        for decade in [false, true] {
            for tick in columns.iter().filter(|tick| tick.decade == decade) {
                self.page.line(&[[tick.px, top], [tick.px, bottom]], shade(decade), 1.0, None);
            }
            for tick in rows.iter().filter(|tick| tick.decade == decade) {
                self.page.line(&[[left, tick.px], [right, tick.px]], shade(decade), 1.0, None);
            }
        }
        for tick in columns {
            if let Some(label) = tick.label {
                self.page.text([tick.px, bottom + 19.0], &label, TICK, Align::Middle);
            }
        }
        for tick in rows {
            if let Some(label) = tick.label {
                self.page.text([left - 8.0, tick.px + 4.5], &label, TICK, Align::Right);
            }
        }
        self.page.line(&[[left, top], [left, bottom], [right, bottom]], GREY, 1.2, None);
    }

    fn objects(&mut self) {
        for (i, object) in self.plot.objects.iter().enumerate() {
            let (colour, shape) = style(i);
            let points: Vec<Point> = object.rungs.iter().filter_map(|rung| self.place(rung)).collect();
            self.page.line(&points, faint(colour), 1.2, None);
            self.obstacles.line(&points, 1.0);
            for rung in &object.rungs {
                let Some(point) = self.place(rung) else { continue };
                let hint = format!("{}, {}: {}", object.name, rung.name, numbers(rung));
                self.page.hinted(&hint, |page| page.mark(shape, point, MARK_PX, colour, colour));
                self.obstacles.area(Area::around(point, [2.5 * MARK_PX; 2]), 1.0);
            }
        }
    }

    /// All samples together; returns what to write beside the rungs.
    fn rungs(&mut self) -> Vec<Label> {
        let bottom = FRAME.max[1];
        let points: Vec<Point> = self.plot.all.iter().filter_map(|rung| self.place(rung)).collect();
        if let (Some(last), true) = (points.last(), has_place(self.plot.reference_ms)) {
            let way = [*last, [self.x.px(self.plot.reference_ms), bottom]];
            self.page.line(&way, BLACK, 1.5, Some(4));
            self.obstacles.line(&way, 2.0);
        }
        self.page.line(&points, WHITE, 5.0, None);
        self.page.line(&points, BLACK, 3.0, None);
        self.obstacles.line(&points, 6.0);

        let mut labels = Vec::new();
        for rung in &self.plot.all {
            let exact = rung.error_um == 0.0;
            if !has_place(rung.ms) || exact && rung.ms == self.plot.reference_ms {
                continue;
            }
            let (point, shape, text) = match self.place(rung) {
                Some(point) => (point, Shape::Circle, numbers(rung)),
                None if exact => ([self.x.px(rung.ms), bottom], Shape::Down, format!("{} ms, error 0", short(rung.ms))),
                None => continue,
            };
            let fill = if rung.pareto { BLACK } else { WHITE };
            let hint = format!("all samples, {}: {text}", rung.name);
            self.page.hinted(&hint, |page| page.mark(shape, point, RUNG_MARK_PX, fill, BLACK));
            self.obstacles.area(Area::around(point, [2.2 * RUNG_MARK_PX; 2]), 20.0);
            labels.push(Label { point, lines: vec![(fitted(&rung.name, BOLD, 180.0), BOLD), (text, NOTE)] });
        }
        labels
    }

    fn reference(&mut self) {
        if !has_place(self.plot.reference_ms) {
            return;
        }
        let [x, bottom] = [self.x.px(self.plot.reference_ms), FRAME.max[1]];
        let line = [[x, FRAME.min[1]], [x, bottom]];
        self.page.line(&line, GREY, 1.2, Some(6));
        self.obstacles.line(&line, 2.0);
        self.page.mark(Shape::Down, [x, bottom], RUNG_MARK_PX, BLACK, BLACK);
        self.obstacles.area(Area::around([x, bottom], [2.4 * RUNG_MARK_PX; 2]), 20.0);
    }

    fn reference_label(&mut self) {
        let ms = self.plot.reference_ms;
        if !has_place(ms) {
            return;
        }
        let mut lines = vec![("reference".to_owned(), BOLD)];
        match self.plot.grid_error_um.filter(|error| has_place(*error)) {
            None => lines.push((format!("{} ms, error 0 by definition", short(ms)), NOTE)),
            Some(error) => lines.extend([
                (format!("{} ms, error 0 by definition;", short(ms)), NOTE),
                (format!("against a grid twice as fine: {} \u{b5}m", short(error)), NOTE),
            ]),
        }
        let place = self.obstacles.along_upright(self.x.px(ms), size(&lines));
        self.write(place, &lines);
    }

    /// The level of the grid's own error.
    fn grid_error(&mut self) {
        let Some(error) = self.plot.grid_error_um.filter(|error| has_place(*error)) else { return };
        let y = self.y.px(error);
        let line = [[FRAME.min[0], y], [FRAME.max[0], y]];
        self.page.line(&line, GRID_ERROR.colour, 1.5, Some(6));
        self.obstacles.line(&line, 1.0);
    }

    fn grid_error_label(&mut self) {
        let Some(error) = self.plot.grid_error_um.filter(|error| has_place(*error)) else { return };
        let lines = [
            (format!("error of the grid itself: {} \u{b5}m", short(error)), GRID_ERROR),
            ("below this line only a finer grid helps".to_owned(), GRID_ERROR),
        ];
        let place = self.obstacles.along_level(self.y.px(error), size(&lines));
        self.write(place, &lines);
    }

    fn label(&mut self, label: &Label) {
        let place = self.obstacles.beside(label.point, size(&label.lines));
        let near = place.nearest(label.point);
        let way = [near[0] - label.point[0], near[1] - label.point[1]];
        let distance = way[0].hypot(way[1]);
        if distance > 20.0 {
            let start = [0, 1].map(|i| label.point[i] + way[i] * (RUNG_MARK_PX + 2.0) / distance);
            self.page.line(&[start, near], GREY, 1.0, None);
        }
        self.write(place, &label.lines);
    }

    /// Lines of text, on a ground that lets little through.
    fn write(&mut self, place: Area, lines: &[(String, Type)]) {
        self.page.rectangle(place.min, place.max, WHITE, 0.8);
        for (i, (text, how)) in lines.iter().enumerate() {
            let baseline = place.min[1] + LINE_PX * (i as f64 + 1.0) - 3.0;
            self.page.text([place.min[0] + 3.0, baseline], text, *how, Align::Left);
        }
    }

    fn legend(&mut self) {
        let [left, text_left] = LEGEND_PX;
        let middle = (left + text_left - 8.0) / 2.0;
        let mut y = FRAME.min[1] + 10.0;
        self.page.line(&[[left, y], [text_left - 8.0, y]], BLACK, 3.0, None);
        self.page.text([text_left, y + 4.5], "rungs, over all samples", PLAIN, Align::Left);
        for (fill, text) in [(BLACK, "best for its time (Pareto)"), (WHITE, "beaten by another rung")] {
            y += ROW_PX[1];
            self.page.mark(Shape::Circle, [middle, y], RUNG_MARK_PX - 1.0, fill, BLACK);
            self.page.text([text_left, y + 4.5], text, PLAIN, Align::Left);
        }
        y += 1.8 * ROW_PX[1];
        if self.plot.objects.is_empty() {
            return;
        }
        self.page.text([left, y + 4.5], "objects", BOLD, Align::Left);
        y += ROW_PX[1] + 2.0;
        let rows = ((FRAME.max[1] - y) / ROW_PX[0]) as usize + 1;
        let objects = &self.plot.objects;
        let shown = if objects.len() > rows { rows - 1 } else { objects.len() };
        let pitch = ((FRAME.max[1] - y) / (objects.len() as f64)).clamp(ROW_PX[0], ROW_PX[1]);
        for (i, Object { name, .. }) in objects[..shown].iter().enumerate() {
            let (colour, shape) = style(i);
            self.page.line(&[[left, y], [text_left - 8.0, y]], faint(colour), 1.2, None);
            self.page.mark(shape, [middle, y], MARK_PX + 0.4, colour, colour);
            let name = fitted(name, PLAIN, SIZE[0] - text_left - 8.0);
            self.page.text([text_left, y + 4.5], &name, PLAIN, Align::Left);
            y += pitch;
        }
        if shown < objects.len() {
            self.page.text([text_left, y + 4.5], &format!("and {} more", objects.len() - shown), NOTE, Align::Left);
        }
    }

    /// Title, names of the axes, caption.
    fn words(&mut self) {
        let [left, top] = FRAME.min;
        let [right, bottom] = FRAME.max;
        let title = fitted(&self.plot.title, TITLE, SIZE[0] - 2.0 * NAME_PX);
        self.page.text([NAME_PX, 38.0], &title, TITLE, Align::Left);
        self.page.text([(left + right) / 2.0, bottom + 46.0], "CPU time per sample (ms)", AXIS, Align::Middle);
        let name = if self.plot.error_name.is_empty() { "error" } else { &self.plot.error_name };
        let name = fitted(name, AXIS, right - left - 60.0);
        self.page.text([NAME_PX, top - 16.0], &format!("{name} (\u{b5}m)"), AXIS, Align::Left);
        self.page.text([NAME_PX, bottom + 82.0], CAPTION, AXIS, Align::Left);
        let lost: Vec<&str> =
            self.plot.all.iter().filter(|rung| is_lost(rung)).map(|rung| rung.name.as_str()).collect();
        if !lost.is_empty() {
            let text = format!("Not shown, without a positive time and a number as error: {}.", lost.join(", "));
            self.page.text([NAME_PX, bottom + 104.0], &fitted(&text, NOTE, right - left), NOTE, Align::Left);
        }
    }
}

/// Size of a label, pixels.
fn size(lines: &[(String, Type)]) -> [f64; 2] {
    let width = lines.iter().map(|(text, how)| width(text, *how)).fold(0.0, f64::max);
    [width + 6.0, LINE_PX * lines.len() as f64 + 2.0]
}

/// True for a rung that has no place in the plot, not even at the lower edge.
fn is_lost(rung: &Rung) -> bool {
    !has_place(rung.ms) || !has_place(rung.error_um) && rung.error_um != 0.0
}

fn numbers(rung: &Rung) -> String {
    format!("{} ms, {} \u{b5}m", short(rung.ms), short(rung.error_um))
}

/// Colour and mark of object `i`: 32 pairs before one returns.
fn style(i: usize) -> (Colour, Shape) {
    (COLOURS[i % COLOURS.len()], SHAPES[(i + i / COLOURS.len()) % SHAPES.len()])
}

/// The same colour, nearer to white.
fn faint(colour: Colour) -> Colour {
    colour.map(|level| level + (255 - level) / 3)
}
