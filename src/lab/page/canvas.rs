//! Lines, marks and text on a canvas, written as SVG and as PNG from the same list of shapes.
//!
//! SVG text is in the viewer's font. Letters of the PNG come from a bitmap font, whose neighbouring dots are joined by
//! round strokes. The edge of every shape is smoothed by the distance of the pixels' centres from it.

use std::collections::BTreeSet;

use embedded_graphics::text::Baseline;
use image::RgbImage;
use maud::{Markup, PreEscaped, html};

use super::letters::{self, Face, letter_dots};
use super::make_legible;
use gelsim_files::png::encode_small;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// A point of the canvas, pixels from its top left corner.
pub type Point = [f64; 2];

/// Shape of a mark. All have about the same area at the same radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A disc.
    Circle,
    /// A square.
    Square,
    /// A triangle that points up.
    Triangle,
    /// A square on its corner.
    Diamond,
    /// A triangle that points down.
    Down,
}

impl Shape {
    /// Corners, clockwise; empty for a circle.
    fn corners(self, [x, y]: Point, radius: f64) -> Vec<Point> {
        let corners: &[Point] = match self {
            Self::Circle => &[],
            Self::Square => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
            Self::Triangle => &[[0.0, -1.3], [1.2, 0.9], [-1.2, 0.9]],
            Self::Diamond => &[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]],
            Self::Down => &[[0.0, 1.3], [-1.2, -0.9], [1.2, -0.9]],
        };
        corners.iter().map(|[dx, dy]| [x + dx * radius, y + dy * radius]).collect()
    }
}

/// How text looks.
#[derive(Clone, Copy, Debug)]
pub struct TextStyle {
    /// Height of the font, pixels.
    pub size: u32,
    /// Whether the font is bold.
    pub bold: bool,
    /// Colour of the text.
    pub colour: Colour,
}

/// Which part of the text stands at its place.
#[derive(Clone, Copy, Debug)]
pub enum TextAlign {
    /// At its left end.
    Left,
    /// At its middle.
    Middle,
    /// At its right end.
    Right,
}

impl TextAlign {
    /// Value of SVG's `text-anchor`.
    fn svg_anchor(self) -> &'static str {
        match self {
            Self::Left => "start",
            Self::Middle => "middle",
            Self::Right => "end",
        }
    }
}

/// An element of a canvas.
enum Element {
    Line {
        points: Vec<Point>,
        colour: Colour,
        width: f64,
        dash: Option<u32>,
    },
    Rectangle {
        min: Point,
        max: Point,
        fill: Colour,
        opacity: f64,
    },
    Mark {
        shape: Shape,
        at: Point,
        radius: f64,
        fill: Colour,
        outline: Colour,
    },
    Text {
        at: Point,
        text: String,
        style: TextStyle,
        align: TextAlign,
    },
    /// Elements that show a hint under the pointer, in SVG.
    WithHint(String, Vec<Element>),
}

/// Width of a mark's outline, pixels.
const OUTLINE_PX: f64 = 1.5;

/// A canvas that shapes are added to; later ones cover earlier ones.
pub struct Canvas {
    size: [f64; 2],
    elements: Vec<Element>,
}

impl Canvas {
    /// Creates a white canvas.
    pub fn new(width: f64, height: f64) -> Self {
        Self { size: [width, height], elements: Vec::new() }
    }

    /// Adds a line through `points`; `dash` is the length of dashes and gaps, `None` for a solid line.
    pub fn draw_line(&mut self, points: &[Point], colour: Colour, width: f64, dash: Option<u32>) {
        self.elements.push(Element::Line { points: points.to_vec(), colour, width, dash });
    }

    /// Adds a filled rectangle; `opacity` is 0 to 1.
    pub fn draw_rectangle(&mut self, min: Point, max: Point, fill: Colour, opacity: f64) {
        self.elements.push(Element::Rectangle { min, max, fill, opacity });
    }

    /// Adds a filled mark of about `radius` with an outline.
    pub fn draw_mark(&mut self, shape: Shape, at: Point, radius: f64, fill: Colour, outline: Colour) {
        self.elements.push(Element::Mark { shape, at, radius, fill, outline });
    }

    /// Adds a line of text with its baseline at `at`. Characters that XML cannot hold become spaces.
    pub fn draw_text(&mut self, at: Point, text: &str, how: TextStyle, align: TextAlign) {
        self.elements.push(Element::Text { at, text: text.replace(char::is_control, " "), style: how, align });
    }

    /// Adds what `draw` draws, with a `hint` that SVG shows under the pointer.
    pub fn draw_with_hint(&mut self, hint: &str, draw: impl FnOnce(&mut Self)) {
        let first = self.elements.len();
        draw(self);
        let elements = self.elements.split_off(first);
        self.elements.push(Element::WithHint(hint.to_owned(), elements));
    }

    /// Writes the canvas as SVG, with text in the viewer's font.
    pub fn to_svg(&self) -> Markup {
        let [width, height] = self.size;
        let svg = html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height)
                font-family="sans-serif" stroke-linecap="round" stroke-linejoin="round" {
                rect width=(width) height=(height) fill="#ffffff" {}
                @for element in &self.elements { (element.to_svg()) }
            }
        };
        PreEscaped(make_legible(&svg.0))
    }

    /// Writes the canvas as a PNG file, at two pixels for each of its own.
    pub fn to_png(&self) -> Vec<u8> {
        let [width, height] = self.size.map(|length| (SCALE * length).ceil() as usize);
        let mut pixels = Pixels { width, rgb: vec![255; 3 * width * height] };
        self.elements.iter().for_each(|element| element.paint(&mut pixels));
        let picture = RgbImage::from_raw(width as u32, height as u32, pixels.rgb);
        encode_small(&picture.expect("three bytes for each pixel"))
    }
}

impl Element {
    fn to_svg(&self) -> Markup {
        let name = |[r, g, b]: Colour| format!("#{r:02x}{g:02x}{b:02x}");
        let px = |length: f64| format!("{length:.2}");
        let list =
            |points: &[Point]| points.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect::<Vec<_>>().join(" ");
        match self {
            Self::Line { points, colour, width, dash } => html! {
                polyline points=(list(points)) fill="none" stroke=(name(*colour)) stroke-width=(width) stroke-dasharray=[dash] {}
            },
            Self::Rectangle { min: [x, y], max, fill, opacity } => html! {
                rect x=(px(*x)) y=(px(*y)) width=(px(max[0] - x)) height=(px(max[1] - y)) fill=(name(*fill))
                    opacity=[(*opacity < 1.0).then_some(opacity)] {}
            },
            Self::Mark { shape, at: [x, y], radius, fill, outline } => html! {
                g fill=(name(*fill)) stroke=(name(*outline)) stroke-width=(OUTLINE_PX) {
                    @if *shape == Shape::Circle { circle cx=(px(*x)) cy=(px(*y)) r=(radius) {} }
                    @else { polygon points=(list(&shape.corners([*x, *y], *radius))) {} }
                }
            },
            Self::Text { at: [x, y], text, style: how, align } => html! {
                text x=(px(*x)) y=(px(*y)) font-size=(how.size) fill=(name(how.colour)) text-anchor=(align.svg_anchor())
                    font-weight=[how.bold.then_some("bold")] { (text) }
            },
            Self::WithHint(hint, elements) => {
                html! { g { title { (hint) } @for element in elements { (element.to_svg()) } } }
            }
        }
    }

    /// Paints the element into the PNG's pixels.
    fn paint(&self, pixels: &mut Pixels) {
        match self {
            Self::Line { points, colour, width, dash } => {
                for ends in points.windows(2) {
                    let [x, y] = ends[0];
                    let way = [ends[1][0] - x, ends[1][1] - y];
                    let length = way[0].hypot(way[1]);
                    let at = |along: f64| {
                        let share = (along / length).min(1.0);
                        [x + way[0] * share, y + way[1] * share]
                    };
                    let dash = dash.map_or(length, f64::from);
                    // Dashes and gaps have one length, so a dash begins at every second multiple of it.
                    for start in (0..).map(|k| 2.0 * dash * f64::from(k)).take_while(|start| *start < length) {
                        pixels.paint_line([at(start), at(start + dash)], *colour, *width);
                    }
                }
            }
            Self::Rectangle { min: [x0, y0], max: [x1, y1], fill, opacity } => {
                pixels.paint_polygon(&[[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]], *fill, *opacity, 0.0);
            }
            Self::Mark { shape, at, radius, fill, outline } => {
                let corners = shape.corners(*at, *radius);
                for (colour, grown) in [(outline, 0.5 * OUTLINE_PX), (fill, -0.5 * OUTLINE_PX)] {
                    match shape {
                        Shape::Circle => pixels.paint_line([*at; 2], *colour, 2.0 * (radius + grown)),
                        _ => pixels.paint_polygon(&corners, *colour, 1.0, grown),
                    }
                }
            }
            Self::Text { at, text, style: how, align } => {
                let start = match align {
                    TextAlign::Left => at[0],
                    TextAlign::Middle => at[0] - 0.5 * text_width(text, *how),
                    TextAlign::Right => at[0] - text_width(text, *how),
                };
                let face = if how.bold { Face::Bold } else { Face::Plain };
                let dot_px = text_width(" ", *how) / f64::from(face.width());
                let place =
                    |[x, y]: [i32; 2]| [start + (f64::from(x) + 0.5) * dot_px, at[1] + (f64::from(y) - 0.5) * dot_px];
                for [from, to] in letter_strokes(&letter_dots(text, face, Baseline::Alphabetic)) {
                    pixels.paint_line([place(from), place(to)], how.colour, 1.2 * dot_px);
                }
            }
            Self::WithHint(_, elements) => elements.iter().for_each(|element| element.paint(pixels)),
        }
    }
}

/// Pixels of the PNG per pixel of the canvas.
const SCALE: f64 = 2.0;

/// Pixels of the PNG.
struct Pixels {
    width: usize,
    rgb: Vec<u8>,
}

impl Pixels {
    /// Paints where `distance` to the edge, in pixels of the canvas, is negative. Nothing outside `bounds` is painted.
    fn paint_area(&mut self, [min, max]: [Point; 2], colour: Colour, opacity: f64, distance: impl Fn(Point) -> f64) {
        let (width, height) = (self.width, self.rgb.len() / 3 / self.width);
        let first = min.map(|at| (SCALE * at - 1.0).max(0.0) as usize);
        let end = max.map(|at| (SCALE * at + 2.0).max(0.0) as usize);
        for y in first[1]..end[1].min(height) {
            for x in first[0]..end[0].min(width) {
                let at = [x, y].map(|pixel| (pixel as f64 + 0.5) / SCALE);
                // Half covered where the edge runs through the pixel's centre; the ramp is one pixel of the PNG wide.
                let share = opacity * (0.5 - SCALE * distance(at)).clamp(0.0, 1.0);
                if share > 0.0 {
                    let pixel = &mut self.rgb[3 * (y * width + x)..][..3];
                    for (old, new) in pixel.iter_mut().zip(colour) {
                        *old = (f64::from(*old) + share * (f64::from(new) - f64::from(*old))).round() as u8;
                    }
                }
            }
        }
    }

    /// Paints a line with round ends. A line of no length is a circle.
    fn paint_line(&mut self, [from, to]: [Point; 2], colour: Colour, width: f64) {
        let way = [to[0] - from[0], to[1] - from[1]];
        let square = (way[0] * way[0] + way[1] * way[1]).max(f64::MIN_POSITIVE);
        let [min, max] = [f64::min, f64::max].map(|of| [of(from[0], to[0]), of(from[1], to[1])]);
        let bounds = [min.map(|at| at - 0.5 * width), max.map(|at| at + 0.5 * width)];
        self.paint_area(bounds, colour, 1.0, |at| {
            let at = [at[0] - from[0], at[1] - from[1]];
            let share = ((at[0] * way[0] + at[1] * way[1]) / square).clamp(0.0, 1.0);
            (at[0] - share * way[0]).hypot(at[1] - share * way[1]) - 0.5 * width
        });
    }

    /// Paints a convex polygon whose corners are given clockwise, with its sides moved outwards by `grown`.
    fn paint_polygon(&mut self, corners: &[Point], colour: Colour, opacity: f64, grown: f64) {
        let bound = |of: fn(f64, f64) -> f64| corners.iter().copied().reduce(|a, b| [of(a[0], b[0]), of(a[1], b[1])]);
        let (Some(min), Some(max)) = (bound(f64::min), bound(f64::max)) else { return };
        // A pointed corner moves further out than its sides do: 3 covers the sharpest corner of the marks.
        let bounds = [min.map(|at| at - 3.0 * grown.max(0.0)), max.map(|at| at + 3.0 * grown.max(0.0))];
        let sides = || corners.iter().zip(corners.iter().cycle().skip(1));
        self.paint_area(bounds, colour, opacity, |at| {
            let outside = sides().map(|([ax, ay], [bx, by])| {
                let [dx, dy] = [bx - ax, by - ay];
                (dy * (at[0] - ax) - dx * (at[1] - ay)) / dx.hypot(dy)
            });
            outside.fold(f64::NEG_INFINITY, f64::max) - grown
        });
    }
}

/// Returns strokes that join neighbouring dots, with each dot also as a stroke by itself. Diagonal neighbours are
/// joined only if no dot is next to both.
fn letter_strokes(dots: &BTreeSet<[i32; 2]>) -> Vec<[[i32; 2]; 2]> {
    let set = |x: i32, y: i32| dots.contains(&[x, y]);
    let mut strokes = Vec::new();
    for &[x, y] in dots {
        for [dx, dy] in [[0, 0], [1, 0], [0, 1], [1, 1], [-1, 1]] {
            if set(x + dx, y + dy) && (dx == 0 || dy == 0 || !set(x + dx, y) && !set(x, y + dy)) {
                strokes.push([[x, y], [x + dx, y + dy]]);
            }
        }
    }
    strokes
}

/// Width of `text` in the PNG, pixels of the canvas. Most viewers' letters are narrower.
pub fn text_width(text: &str, how: TextStyle) -> f64 {
    0.56 * f64::from(how.size) * letters::count_letters(text) as f64
}

/// Returns `text`, its end replaced by dots if it is wider than `limit` pixels.
pub fn fit_text(text: &str, how: TextStyle, limit: f64) -> String {
    letters::truncate_text(text, (limit / text_width(" ", how)) as usize)
}
