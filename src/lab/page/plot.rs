//! Plots with two linear axes, as SVG, on the canvas that `tradeoff` draws on, too.

use maud::Markup;

use super::canvas::{Canvas, Colour, Point, TextAlign, TextStyle, text_width};

/// Text and outlines.
pub const BLACK: Colour = [30, 30, 30];
/// Lines of the grid.
pub const FAINT: Colour = [225, 225, 225];
/// Axes and frames.
pub const GREY: Colour = [140, 140, 140];
/// Style of a plot's title.
pub const TITLE_STYLE: TextStyle = TextStyle { size: 14, bold: true, colour: BLACK };
/// Style of all other text.
pub const TEXT_STYLE: TextStyle = TextStyle { size: 12, bold: false, colour: BLACK };

/// A plot with two axes.
pub struct Plot {
    /// The canvas, in pixels; [`Plot::to_canvas`] says where a point of the data is.
    pub canvas: Canvas,
    size: [f64; 2],
    ranges: [[f64; 2]; 2],
}

/// Least room between the labels of ticks, and beside those of the vertical axis, px.
const GAP: f64 = 8.0;

/// Room around the data: left, top, right, bottom, px.
pub const MARGINS: [f64; 4] = [52.0, 34.0, 14.0, 42.0];

impl Plot {
    /// Creates a plot with axes called `names` (x and y) over `ranges`, each from its value at the left or bottom. A
    /// range that is empty or not finite becomes 0 to 1.
    pub fn new(size: [f64; 2], title: &str, names: [&str; 2], ranges: [[f64; 2]; 2]) -> Self {
        let ranges =
            ranges.map(|[from, to]| if (to - from).is_finite() && to != from { [from, to] } else { [0.0, 1.0] });
        let mut plot = Self { ranges, ..Self::without_axes(size, title) };
        for (axis, name) in names.iter().enumerate() {
            let [left, top, right, bottom] = MARGINS;
            let (length, room) = match axis {
                // Labels of the horizontal axis stand side by side, those of the vertical one share the left margin.
                0 => (size[0] - left - right, None),
                _ => (size[1] - top - bottom, Some(left - GAP)),
            };
            let too_wide = |labels: &[(f64, String)], step: f64| {
                let apart =
                    room.unwrap_or_else(|| length * step / (plot.ranges[axis][1] - plot.ranges[axis][0]).abs() - GAP);
                labels.iter().any(|(_, label)| text_width(label, TEXT_STYLE) > apart)
            };
            for (value, label) in choose_ticks(plot.ranges[axis], too_wide) {
                plot.draw_tick(axis, value, &label);
            }
            let baseline = if axis == 0 { size[1] - 8.0 } else { 18.0 };
            plot.canvas.draw_text([size[0] - MARGINS[2], baseline], name, TEXT_STYLE, TextAlign::Right);
        }
        plot
    }

    /// Creates a plot with a title and no axes.
    pub fn without_axes(size: [f64; 2], title: &str) -> Self {
        let mut canvas = Canvas::new(size[0], size[1]);
        canvas.draw_text([8.0, 18.0], title, TITLE_STYLE, TextAlign::Left);
        Self { canvas, size, ranges: [[0.0, 1.0]; 2] }
    }

    fn draw_tick(&mut self, axis: usize, value: f64, label: &str) {
        let [[left, right], [low, high]] = self.ranges;
        let (mut from, mut to) = ([left, low], [right, high]);
        (from[axis], to[axis]) = (value, value);
        let (from, to) = (self.to_canvas(from), self.to_canvas(to));
        self.canvas.draw_line(&[from, to], if value == 0.0 { GREY } else { FAINT }, 1.0, None);
        match axis {
            0 => {
                // A label that would leave the page is omitted; its grid line is still drawn.
                if from[0] + 0.5 * text_width(label, TEXT_STYLE) <= self.size[0] {
                    self.canvas.draw_text(
                        [from[0], self.size[1] - MARGINS[3] + 16.0],
                        label,
                        TEXT_STYLE,
                        TextAlign::Middle,
                    );
                }
            }
            _ => self.canvas.draw_text([from[0] - 6.0, from[1] + 4.0], label, TEXT_STYLE, TextAlign::Right),
        }
    }

    /// Returns where a point of the data is on the canvas. Points outside the axes are drawn at their ends.
    pub fn to_canvas(&self, [x, y]: Point) -> Point {
        let share = |value: f64, [from, to]: [f64; 2]| {
            if value.is_nan() { 0.0 } else { ((value - from) / (to - from)).clamp(0.0, 1.0) }
        };
        let [left, top, right, bottom] = MARGINS;
        [
            left + share(x, self.ranges[0]) * (self.size[0] - left - right),
            self.size[1] - bottom - share(y, self.ranges[1]) * (self.size[1] - top - bottom),
        ]
    }

    /// The plot as SVG.
    pub fn to_svg(&self) -> Markup {
        self.canvas.to_svg()
    }
}

/// Returns a distance of ticks, 1, 2 or 5 times a power of ten, of which 4 to 10 fit into `length`.
fn tick_step(length: f64) -> f64 {
    let rough = length / 4.0;
    let decade = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let factor = [5.0, 2.0].into_iter().find(|factor| factor * decade <= rough).unwrap_or(1.0);
    factor * decade
}

/// Chooses the round values in a range and their labels, so many that no label is too wide for its place.
fn choose_ticks([from, to]: [f64; 2], too_wide: impl Fn(&[(f64, String)], f64) -> bool) -> Vec<(f64, String)> {
    let (low, high) = (from.min(to), from.max(to));
    let mut step = tick_step(high - low);
    // Wider labels need wider steps. If they never fit, the last ticks are taken.
    for _ in 0..6 {
        let ticks = ticks_at(low, high, step);
        if ticks.len() <= 2 || !too_wide(&ticks, step) {
            return ticks;
        }
        step = next_step(step);
    }
    ticks_at(low, high, step)
}

/// Returns the multiples of `step` in a range, with their labels.
fn ticks_at(low: f64, high: f64, step: f64) -> Vec<(f64, String)> {
    let first = (low / step - 1e-9).ceil();
    // By multiplication, because adding a step to a large number may not change it.
    let values = (0..12).map(|k| (first + f64::from(k)) * step).take_while(|value| *value <= high + 1e-9 * step);
    values.map(|value| (value, format_tick(value, step))).collect()
}

/// Returns the next larger step of 1, 2 or 5 times a power of ten.
fn next_step(step: f64) -> f64 {
    let lead = step / libm::pow(10.0, libm::floor(libm::log10(step) + 1e-9));
    step * if (1.5..3.5).contains(&lead) { 2.5 } else { 2.0 }
}

/// Formats a tick's value with as many digits as tell it from the next one.
fn format_tick(value: f64, step: f64) -> String {
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
            assert!((tick_step(end) - expected).abs() < 1e-12 * end, "{end}: {}", tick_step(end));
        }
        for end in [1e-300, 1e-3, 7.77, 1e300] {
            assert!((3.9..=10.1).contains(&(end / tick_step(end))), "{end}");
        }
    }

    #[test]
    fn axes_begin_anywhere_and_run_either_way() {
        let labels = |range| choose_ticks(range, |_, _| false).into_iter().map(|(_, label)| label).collect::<Vec<_>>();
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
            assert!(plot.to_svg().0.len() < 20_000, "{range:?}");
            let at = plot.to_canvas([range[0], range[1]]);
            assert!(at.iter().all(|at| (0.0..=330.0).contains(at)), "{range:?}: {at:?}");
        }
    }

    /// Left and right end of every name of the horizontal axis.
    fn names(range: [f64; 2]) -> Vec<(f64, f64)> {
        let svg = Plot::new([330.0, 220.0], "t", ["x", "y"], [range, [0.0, 9.0]]).to_svg().0;
        let parsed = roxmltree::Document::parse(&svg).expect("well-formed");
        let number =
            |node: &roxmltree::Node, name: &str| node.attribute(name).and_then(|text| text.parse::<f64>().ok());
        let names = parsed.descendants().filter(|node| number(node, "y") == Some(220.0 - MARGINS[3] + 16.0));
        let ends = names.map(|node| {
            let half = 0.5 * text_width(node.text().unwrap_or_default(), TEXT_STYLE);
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
