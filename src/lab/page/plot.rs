//! Plots with two linear axes, as SVG; lines and marks are those of `tradeoff`'s drawing.

use maud::Markup;

use super::canvas::{Align, Canvas, Colour, Point, Type, width};

/// Text and outlines.
pub const BLACK: Colour = [30, 30, 30];
/// Lines of the grid.
pub const FAINT: Colour = [225, 225, 225];
/// Axes and frames.
pub const GREY: Colour = [140, 140, 140];
/// A plot's title.
pub const TITLE: Type = Type { size: 14, bold: true, colour: BLACK };
/// Everything else that is written.
pub const TEXT: Type = Type { size: 12, bold: false, colour: BLACK };

/// A plot with two axes.
pub struct Plot {
    /// What is drawn, in pixels; [`Plot::place`] says where a point of the data is.
    pub canvas: Canvas,
    size: [f64; 2],
    ranges: [[f64; 2]; 2],
}

/// Room between names of ticks, and beside those of the vertical axis, px.
const GAP: f64 = 8.0;

/// Room around the data: left, top, right, bottom, px.
pub const ROOM: [f64; 4] = [52.0, 34.0, 14.0, 42.0];

impl Plot {
    /// With axes called `names` (x and y) that reach over `ranges`, first the value at the left or bottom. A range that is
    /// empty or not finite becomes 0 to 1.
    pub fn new(size: [f64; 2], title: &str, names: [&str; 2], ranges: [[f64; 2]; 2]) -> Self {
        let ranges =
            ranges.map(|[from, to]| if (to - from).is_finite() && to != from { [from, to] } else { [0.0, 1.0] });
        let mut plot = Self { ranges, ..Self::bare(size, title) };
        for (axis, name) in names.iter().enumerate() {
            let [left, top, right, bottom] = ROOM;
            let (length, room) = match axis {
                // Names stand beside each other, with a gap between them.
                0 => (size[0] - left - right, None),
                _ => (size[1] - top - bottom, Some(left - GAP)),
            };
            let too_wide = |labels: &[(f64, String)], step: f64| {
                let apart =
                    room.unwrap_or_else(|| length * step / (plot.ranges[axis][1] - plot.ranges[axis][0]).abs() - GAP);
                labels.iter().any(|(_, label)| width(label, TEXT) > apart)
            };
            for (value, label) in ticks(plot.ranges[axis], too_wide) {
                plot.tick(axis, value, &label);
            }
            let baseline = if axis == 0 { size[1] - 8.0 } else { 18.0 };
            plot.canvas.text([size[0] - ROOM[2], baseline], name, TEXT, Align::Right);
        }
        plot
    }

    /// Without axes: a title and room for words.
    pub fn bare(size: [f64; 2], title: &str) -> Self {
        let mut canvas = Canvas::new(size[0], size[1]);
        canvas.text([8.0, 18.0], title, TITLE, Align::Left);
        Self { canvas, size, ranges: [[0.0, 1.0]; 2] }
    }

    fn tick(&mut self, axis: usize, value: f64, label: &str) {
        let [[left, right], [low, high]] = self.ranges;
        let (mut from, mut to) = ([left, low], [right, high]);
        (from[axis], to[axis]) = (value, value);
        let (from, to) = (self.place(from), self.place(to));
        self.canvas.line(&[from, to], if value == 0.0 { GREY } else { FAINT }, 1.0, None);
        match axis {
            0 => {
                // A name that would reach over the page's edge is left out; its line says enough.
                if from[0] + 0.5 * width(label, TEXT) <= self.size[0] {
                    self.canvas.text([from[0], self.size[1] - ROOM[3] + 16.0], label, TEXT, Align::Middle);
                }
            }
            _ => self.canvas.text([from[0] - 6.0, from[1] + 4.0], label, TEXT, Align::Right),
        }
    }

    /// Where a point of the data is on the canvas. Points beyond the axes lie on their ends.
    pub fn place(&self, [x, y]: Point) -> Point {
        let share = |value: f64, [from, to]: [f64; 2]| {
            if value.is_nan() { 0.0 } else { ((value - from) / (to - from)).clamp(0.0, 1.0) }
        };
        let [left, top, right, bottom] = ROOM;
        [
            left + share(x, self.ranges[0]) * (self.size[0] - left - right),
            self.size[1] - bottom - share(y, self.ranges[1]) * (self.size[1] - top - bottom),
        ]
    }

    /// The plot as SVG.
    pub fn svg(&self) -> Markup {
        self.canvas.svg()
    }
}

/// Distance of ticks, 1, 2 or 5 times a power of ten, so that there are 4 to 10 of them in `length`.
fn step(length: f64) -> f64 {
    let rough = length / 4.0;
    let decade = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let factor = [5.0, 2.0].into_iter().find(|factor| factor * decade <= rough).unwrap_or(1.0);
    factor * decade
}

/// The round values in a range, with what is written beside them: so many that no name is too wide for its place.
fn ticks([from, to]: [f64; 2], too_wide: impl Fn(&[(f64, String)], f64) -> bool) -> Vec<(f64, String)> {
    let (low, high) = (from.min(to), from.max(to));
    let mut step = step(high - low);
    // Wider names need wider steps; of those that never fit the last ones are taken.
    for _ in 0..6 {
        let ticks = ticks_at(low, high, step);
        if ticks.len() <= 2 || !too_wide(&ticks, step) {
            return ticks;
        }
        step = wider(step);
    }
    ticks_at(low, high, step)
}

/// The multiples of `step` in a range.
fn ticks_at(low: f64, high: f64, step: f64) -> Vec<(f64, String)> {
    let first = (low / step - 1e-9).ceil();
    // Counted, because adding a step to a large number may not change it.
    let values = (0..12).map(|k| (first + f64::from(k)) * step).take_while(|value| *value <= high + 1e-9 * step);
    values.map(|value| (value, label(value, step))).collect()
}

/// The next step of 1, 2, 5 times a power of ten.
fn wider(step: f64) -> f64 {
    let lead = step / libm::pow(10.0, libm::floor(libm::log10(step) + 1e-9));
    step * if (1.5..3.5).contains(&lead) { 2.5 } else { 2.0 }
}

/// A tick's value with as many digits as tell it from the next one.
fn label(value: f64, step: f64) -> String {
    let places = |value: f64| libm::floor(libm::log10(value.abs()) + 1e-9);
    match value.abs() {
        0.0 => String::from("0"),
        size if size >= 1e6 && step >= 1e4 && size < 1e10 => format!("{}M", (value / 1e4).round() / 1e2),
        size if step < 1e-5 && (1e-3..1e6).contains(&size) => {
            let decimals = (-places(step)).clamp(0.0, 15.0) as usize;
            format!("{value:.decimals$}")
        }
        size if size >= 1e6 || step < 1e-5 => {
            let digits = (places(value) - places(step)).clamp(1.0, 15.0) as usize;
            format!("{value:.digits$e}")
        }
        _ => format!("{}", (value * 1e6).round() / 1e6),
    }
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

    #[test]
    fn axes_begin_anywhere_and_run_either_way() {
        let labels = |range| ticks(range, |_, _| false).into_iter().map(|(_, label)| label).collect::<Vec<_>>();
        assert_eq!(labels([-7.5, 7.5]), ["-6", "-4", "-2", "0", "2", "4", "6"]);
        assert_eq!(labels([7.5, -7.5]), labels([-7.5, 7.5]));
        assert_eq!(labels([0.31, 0.52]), ["0.35", "0.4", "0.45", "0.5"]);
        assert_eq!(labels([0.0, 2e6]), ["0", "500000", "1M", "1.5M", "2M"]);
        assert_eq!(labels([0.0, 4e-9]), ["0", "1.0e-9", "2.0e-9", "3.0e-9", "4.0e-9"]);
        assert_eq!(labels([102.905, 102.975]), ["102.91", "102.92", "102.93", "102.94", "102.95", "102.96", "102.97"]);
        assert_eq!(
            labels([7.000_001, 7.000_006]),
            ["7.000001", "7.000002", "7.000003", "7.000004", "7.000005", "7.000006"]
        );
        for range in [[1e17, 1e17 + 64.0], [-1e300, 1e300], [1e-310, 3e-310], [5.0, 5.0], [0.0, f64::NAN]] {
            let plot = Plot::new([330.0, 220.0], "t", ["x", "y"], [range, range]);
            assert!(plot.svg().0.len() < 20_000, "{range:?}");
            let at = plot.place([range[0], range[1]]);
            assert!(at.iter().all(|at| (0.0..=330.0).contains(at)), "{range:?}: {at:?}");
        }
    }

    /// Left and right end of every name of the horizontal axis.
    fn names(range: [f64; 2]) -> Vec<(f64, f64)> {
        let svg = Plot::new([330.0, 220.0], "t", ["x", "y"], [range, [0.0, 9.0]]).svg().0;
        let parsed = roxmltree::Document::parse(&svg).expect("well-formed");
        let number =
            |node: &roxmltree::Node, name: &str| node.attribute(name).and_then(|text| text.parse::<f64>().ok());
        let names = parsed.descendants().filter(|node| number(node, "y") == Some(220.0 - ROOM[3] + 16.0));
        let ends = names.map(|node| {
            let half = 0.5 * width(node.text().unwrap_or_default(), TEXT);
            let middle = number(&node, "x").expect("a place");
            (middle - half, middle + half)
        });
        ends.collect()
    }

    #[test]
    fn names_of_ticks_neither_touch_each_other_nor_leave_the_page() {
        for range in
            [[102.905, 102.975], [0.3, 2.83], [0.0, 4e-9], [1e6, 1.9e6], [-1234.5, 1234.5], [7.000_001, 7.000_004]]
        {
            let names = names(range);
            assert!(names.len() >= 2, "{range:?}: {names:?}");
            assert!(names.windows(2).all(|pair| pair[0].1 + 4.0 <= pair[1].0), "{range:?}: {names:?}");
            assert!(names.iter().all(|(left, right)| *left >= 0.0 && *right <= 330.0), "{range:?}: {names:?}");
        }
    }
}
