//! Histograms as stacked bars, as SVG: counts over the bins of an axis, with one colour for each kind.

use maud::Markup;

use super::canvas::{Colour, TextAlign};
use super::plot::{FAINT, Plot, TEXT_STYLE};
use gelsim_files::number_format::format_number;

/// Width and height of a histogram, px: three fit side by side on a page, and one fits a phone.
pub const SIZE: [f64; 2] = [330.0, 220.0];

/// A bar: a bin and the counts in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar<const KINDS: usize> {
    /// Lower end of the bin.
    pub from: f64,
    /// Upper end of the bin.
    pub to: f64,
    /// Count of each kind.
    pub counts: [u64; KINDS],
}

/// Draws adjacent bars as SVG. `axes` names the horizontal axis and what is counted; `kinds` are names and colours.
/// Without bars it draws a placeholder.
pub fn draw_histogram<const KINDS: usize>(
    title: &str,
    axes: [&str; 2],
    bars: &[Bar<KINDS>],
    kinds: &[(&str, Colour); KINDS],
) -> Markup {
    let (Some(first), Some(last)) = (bars.first(), bars.last()) else { return draw_placeholder(title, "no values") };
    let highest = bars.iter().map(|bar| bar.counts.iter().sum::<u64>()).max().unwrap_or(0);
    // At least 4 and some room above the highest bar: below that the axis would have ticks at fractions of a count.
    let top = (1.08 * highest as f64).max(4.0);
    let mut plot = Plot::new(SIZE, title, axes, [[first.from, last.to], [0.0, top]]);
    for bar in bars {
        let of_kinds = || bar.counts.iter().zip(kinds).filter(|(count, _)| **count > 0);
        let counts: Vec<String> = of_kinds().map(|(count, (name, _))| format!("{count} {name}")).collect();
        if counts.is_empty() {
            continue;
        }
        let mut below = 0;
        let stacked = of_kinds().map(|(count, (_, colour))| {
            let from = plot.to_canvas([bar.from, below as f64]);
            below += count;
            (from, plot.to_canvas([bar.to, below as f64]), *colour)
        });
        let stacked: Vec<_> = stacked.collect();
        let [from, to] = [bar.from, bar.to].map(|end| format_distinct(end, bar.to - bar.from));
        let hint = format!("{from} to {to}: {}", counts.join(", "));
        plot.canvas.draw_with_hint(&hint, |canvas| {
            for ([left, low], [right, high], colour) in stacked {
                // A white line separates bars, unless they are too narrow for one.
                let gap = f64::min(1.0, 0.2 * (right - left));
                canvas.draw_rectangle([left, high], [right - gap, low], colour, 1.0);
            }
        });
    }
    plot.to_svg()
}

/// Formats a value with as many digits as tell it from others that are `span` apart.
pub fn format_distinct(value: f64, span: f64) -> String {
    let plain = format_number(value);
    let digits = if span > 0.0 && span.is_finite() { -libm::floor(libm::log10(span) + 1e-9) } else { 0.0 };
    let decimals = digits.clamp(0.0, 9.0) as usize;
    let has = plain.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    if has >= decimals || plain.contains('e') { plain } else { format!("{value:.decimals$}") }
}

/// Draws an empty plot with words in its middle.
pub fn draw_placeholder(title: &str, words: &str) -> Markup {
    let mut plot = Plot::without_axes(SIZE, title);
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]].map(|corner| plot.to_canvas(corner));
    plot.canvas.draw_line(&corners, FAINT, 1.0, None);
    let middle = plot.to_canvas([0.5, 0.5]);
    plot.canvas.draw_text(middle, words, TEXT_STYLE, TextAlign::Middle);
    plot.to_svg()
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [(&str, Colour); 2] = [("near", [1, 2, 3]), ("far", [4, 5, 6])];

    /// The rectangles of a drawing: fill, top, height.
    fn rectangles(svg: &str) -> Vec<(String, f64, f64)> {
        let parsed = roxmltree::Document::parse(svg).expect("well-formed");
        let number = |node: &roxmltree::Node, name: &str| node.attribute(name).and_then(|text| text.parse().ok());
        let rectangles = parsed.descendants().filter(|node| {
            node.has_tag_name("rect") && node.ancestors().any(|above| above.children().any(|c| c.has_tag_name("title")))
        });
        let found = rectangles.map(|node| {
            let [top, height] = ["y", "height"].map(|name| number(&node, name).expect("a number"));
            (node.attribute("fill").expect("a fill").to_owned(), top, height)
        });
        found.collect()
    }

    #[test]
    fn bars_are_as_high_as_their_counts_and_stand_on_each_other() {
        let bar = |from: f64, counts| Bar { from, to: from + 1.0, counts };
        let svg =
            draw_histogram("t", ["mm", "samples"], &[bar(0.0, [3, 1]), bar(1.0, [0, 0]), bar(2.0, [0, 8])], &KINDS).0;
        let drawn = rectangles(&svg);
        assert_eq!(drawn.len(), 3, "{svg}");
        let unit = drawn[2].2 / 8.0;
        assert!((drawn[0].2 - 3.0 * unit).abs() < 0.05 && (drawn[1].2 - unit).abs() < 0.05, "{drawn:?}");
        assert!((drawn[1].1 + drawn[1].2 - drawn[0].1).abs() < 0.05, "on each other: {drawn:?}");
        assert!(svg.contains("0 to 1: 3 near, 1 far") && svg.contains("2 to 3: 8 far"), "{svg}");
    }

    #[test]
    fn figures_close_to_each_other_are_told_apart() {
        assert_eq!(
            [102.9051, 102.94, 102.969].map(|value| format_distinct(value, 0.064)),
            ["102.91", "102.94", "102.97"]
        );
        assert_eq!([0.0, 0.31, 1250.4].map(|value| format_distinct(value, 1000.0)), ["0", "0.31", "1250"]);
        assert_eq!(
            (format_distinct(0.5, 0.0), format_distinct(1e-7, 1e-8)),
            (String::from("0.5"), String::from("1.00e-7"))
        );
        let svg = draw_histogram("t", ["mm", "samples"], &[Bar { from: 102.9, to: 102.91, counts: [1, 2] }], &KINDS).0;
        assert!(svg.contains("102.90 to 102.91: 1 near, 2 far"), "{svg}");
    }

    #[test]
    fn nothing_to_draw_is_said_in_words() {
        let svg = draw_histogram::<2>("t", ["mm", "samples"], &[], &KINDS).0;
        assert!(svg.contains("no values") && rectangles(&svg).is_empty());
        assert!(!svg.contains("NaN"));
    }
}
