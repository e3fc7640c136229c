//! The plots of the page, as SVG: shapes by `tradeoff`'s drawing of lines and marks, axes linear and from 0.

use super::Shown;
use crate::presses::Circle;
use crate::tradeoff::plot::ink::{Align, Colour, Page, Point, Shape, Type};

const BLACK: Colour = [30, 30, 30];
const FAINT: Colour = [225, 225, 225];
const GREY: Colour = [140, 140, 140];
const BLUE: Colour = [0, 114, 178];
const RED: Colour = [196, 30, 40];
const CHANNELS: [Colour; 3] = [[204, 50, 50], [0, 140, 90], [40, 90, 200]];
const TITLE: Type = Type { size: 14, bold: true, colour: BLACK };
const TEXT: Type = Type { size: 12, bold: false, colour: BLACK };

/// A plot with two axes.
struct Plot {
    page: Page,
    size: [f64; 2],
    ends: [f64; 2],
}

/// Room around the data: left, top, right, bottom.
const ROOM: [f64; 4] = [48.0, 34.0, 12.0, 42.0];

impl Plot {
    /// With axes from 0 to `ends`, and where these are 0 or no numbers, to 1.
    fn new(size: [f64; 2], title: &str, names: [&str; 2], ends: [f64; 2]) -> Self {
        let ends = ends.map(|end| if end > 0.0 && end.is_finite() { end } else { 1.0 });
        let mut plot = Self { page: Page::new(size[0], size[1]), size, ends };
        plot.page.text([8.0, 18.0], title, TITLE, Align::Left);
        for (axis, name) in names.iter().enumerate() {
            let step = step(ends[axis]);
            let mut value = 0.0;
            while value <= ends[axis] * (1.0 + 1e-9) {
                plot.tick(axis, value);
                value += step;
            }
            match axis {
                0 => plot.page.text([size[0] - ROOM[2], size[1] - 8.0], name, TEXT, Align::Right),
                _ => plot.page.text([size[0] - ROOM[2], 18.0], name, TEXT, Align::Right),
            }
        }
        plot
    }

    fn tick(&mut self, axis: usize, value: f64) {
        let label = format!("{}", (value * 1e6).round() / 1e6);
        let mut from = [0.0; 2];
        let mut to = self.ends;
        (from[axis], to[axis]) = (value, value);
        let (from, to) = (self.place(from), self.place(to));
        self.page.line(&[from, to], if value == 0.0 { GREY } else { FAINT }, 1.0, None);
        match axis {
            0 => self.page.text([from[0], from[1] + 16.0], &label, TEXT, Align::Middle),
            _ => self.page.text([from[0] - 6.0, from[1] + 4.0], &label, TEXT, Align::Right),
        }
    }

    /// Where a point of the data is on the page. Points beyond the axes lie on their ends.
    fn place(&self, [x, y]: Point) -> Point {
        let share = |value: f64, end: f64| if value.is_nan() { 0.0 } else { (value / end).clamp(0.0, 1.0) };
        let [left, top, right, bottom] = ROOM;
        [
            left + share(x, self.ends[0]) * (self.size[0] - left - right),
            self.size[1] - bottom - share(y, self.ends[1]) * (self.size[1] - top - bottom),
        ]
    }

    fn dot(&mut self, at: Point, shown: &Shown) {
        let at = self.place(at);
        let hint = format!("{}: {:.2}", shown.file, shown.error());
        self.page.hinted(&hint, |page| mark(page, at, shown));
    }

    fn svg(&self) -> String {
        self.page.svg()
    }
}

fn mark(page: &mut Page, at: Point, shown: &Shown) {
    let (shape, colour) = if shown.suspicions.is_empty() { (Shape::Circle, BLUE) } else { (Shape::Diamond, RED) };
    page.mark(shape, at, 4.0, colour, [255; 3]);
}

/// Distance of ticks, 1, 2 or 5 times a power of ten, so that there are 4 to 10 of them.
fn step(end: f64) -> f64 {
    let rough = end / 4.0;
    let decade = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let factor = [5.0, 2.0].into_iter().find(|factor| factor * decade <= rough).unwrap_or(1.0);
    factor * decade
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|value| value.is_finite()).fold(0.0, f64::max)
}

/// Error of each press, in the table's order.
pub(super) fn errors(presses: &[Shown]) -> String {
    let ends = [presses.len() as f64 + 0.5, 1.08 * largest(presses.iter().map(Shown::error))];
    let mut plot = Plot::new([480.0, 280.0], "Error of each press", ["row of the table", "grey levels"], ends);
    for (row, shown) in presses.iter().enumerate() {
        let x = row as f64 + 1.0;
        let [from, to] = [0.0, shown.error()].map(|y| plot.place([x, y]));
        plot.page.line(&[from, to], FAINT, 2.0, None);
        plot.dot([x, shown.error()], shown);
    }
    plot.svg()
}

/// Error against the radius of the contact.
pub(super) fn by_radius(presses: &[Shown]) -> String {
    let radius = |shown: &Shown| shown.circle.map_or(f64::NAN, |circle| circle.radius_px);
    let ends = [1.08 * largest(presses.iter().map(radius)), 1.08 * largest(presses.iter().map(Shown::error))];
    let mut plot = Plot::new([480.0, 280.0], "Error against radius", ["radius of the circle, px", "grey levels"], ends);
    for shown in presses.iter().filter(|shown| radius(shown).is_finite()) {
        plot.dot([radius(shown), shown.error()], shown);
    }
    plot.svg()
}

/// Circles in the frame of the image, darker where the error is larger.
pub(super) fn places(presses: &[Shown]) -> String {
    let [width, height] = presses.first().map_or([4.0, 3.0], |shown| {
        let (width, height) = shown.real.dimensions();
        [width, height].map(|px| f64::from(px.max(1)))
    });
    let scale = f64::min(440.0 / width, 330.0 / height);
    let (left, top) = (8.0, 46.0);
    let corner = [left + scale * width, top + scale * height];
    let mut page = Page::new(480.0, corner[1] + 10.0);
    let worst = largest(presses.iter().map(Shown::error));
    page.text([left, 18.0], "Where the presses are", TITLE, Align::Left);
    page.text([left, 36.0], &format!("pale: error 0; dark: {worst:.1} grey levels; red: suspect"), TEXT, Align::Left);
    page.line(&[[left, top], [corner[0], top], corner, [left, corner[1]], [left, top]], GREY, 1.0, None);
    for shown in presses {
        let Some(circle) = shown.circle.filter(|circle| in_reach(circle, [width, height])) else { continue };
        let [x, y] = circle.centre_px.map(|at| scale * (at + 0.5));
        let radius = scale * circle.radius_px;
        let points: Vec<Point> = (0..=48)
            .map(|step| {
                let angle = std::f64::consts::TAU * f64::from(step) / 48.0;
                // What lies out of view is drawn along the border.
                let at = [x + radius * libm::cos(angle), y + radius * libm::sin(angle)];
                [left + at[0].clamp(0.0, scale * width), top + at[1].clamp(0.0, scale * height)]
            })
            .collect();
        let share = if worst > 0.0 { (shown.error() / worst).clamp(0.0, 1.0) } else { 0.0 };
        let shade = |pale: f64, dark: f64| (pale + share * (dark - pale)).round() as u8;
        let colour = if shown.suspicions.is_empty() {
            [shade(190.0, 0.0), shade(215.0, 40.0), shade(240.0, 110.0)]
        } else {
            RED
        };
        page.hinted(&format!("{}: {:.2}", shown.file, shown.error()), |page| page.line(&points, colour, 2.0, None));
    }
    page.svg()
}

/// True if a part of the circle may be in view.
fn in_reach(circle: &Circle, size: [f64; 2]) -> bool {
    (0..2).all(|k| {
        let (at, radius) = (circle.centre_px[k], circle.radius_px);
        at + radius >= 0.0 && at - radius <= size[k] && radius < 4.0 * size[k]
    })
}

/// Red, green and blue along the row and along the column through the centre of the circle, or of the image without one.
pub(super) fn profiles(shown: &Shown) -> [String; 2] {
    let size = [shown.real.width().min(shown.simulated.width()), shown.real.height().min(shown.simulated.height())];
    let middle = size.map(|size| f64::from(size) / 2.0);
    let centre = shown.circle.map_or(middle, |circle| circle.centre_px);
    let titles = [("From left to right", "column, px"), ("From top to bottom", "row, px")];
    [0, 1].map(|along| {
        let across = 1 - along;
        let line = centre[across].round().clamp(0.0, f64::from(size[across].max(1) - 1)) as u32;
        let (title, name) = titles[along];
        let ends = [f64::from(size[along]), 255.0];
        let mut plot = Plot::new([480.0, 300.0], title, [name, "grey levels"], ends);
        for side in shown.circle.iter().flat_map(|circle| [-1.0, 1.0].map(|side| (side, circle.radius_px))) {
            let at = centre[along] + 0.5 + side.0 * side.1;
            if at >= 0.0 && at <= ends[0] {
                let ends = [plot.place([at, 0.0]), plot.place([at, 255.0])];
                plot.page.line(&ends, GREY, 1.0, None);
            }
        }
        for (image, dash) in [(&shown.real, None), (&shown.simulated, Some(4))] {
            for (channel, colour) in CHANNELS.into_iter().enumerate() {
                let level = |at: u32| {
                    let (x, y) = if along == 0 { (at, line) } else { (line, at) };
                    image.get_pixel(x, y).0[channel]
                };
                let points: Vec<Point> =
                    (0..size[along]).map(|at| plot.place([f64::from(at) + 0.5, f64::from(level(at))])).collect();
                plot.page.line(&points, colour, 1.4, dash);
            }
        }
        plot.svg()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_few() {
        for (end, expected) in [(255.0, 50.0), (1.0, 0.2), (0.9, 0.2), (8.4, 2.0), (33.0, 5.0), (10.0, 2.0), (4.0, 1.0)]
        {
            assert!((step(end) - expected).abs() < 1e-12 * end, "{end}: {}", step(end));
        }
        for end in [1e-300, 1e-3, 7.77, 1e300] {
            assert!((3.9..=10.1).contains(&(end / step(end))), "{end}");
        }
    }
}
