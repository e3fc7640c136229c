//! Lines, marks and text on a page, as SVG and as PNG from the same list of shapes.
//!
//! `kuva` writes both; it brings a font, so that text is drawn on machines without any. Its own axes and legends are
//! not used: labels beside points that keep clear of each other are beyond them.

use kuva::RasterBackend;
use kuva::backend::svg::SvgBackend;
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor, TextSpan};

/// Red, green, blue.
pub type Colour = [u8; 3];

/// A point of the page, pixels from its top left corner.
pub type Point = [f64; 2];

/// Marks of a size: all of about the same area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    Circle,
    Square,
    Triangle,
    Diamond,
    /// A triangle that points down.
    Down,
}

/// How text looks.
#[derive(Clone, Copy, Debug)]
pub struct Type {
    /// Height of the font, pixels.
    pub size: u32,
    pub bold: bool,
    pub colour: Colour,
}

/// Which part of the text stands at its place.
#[derive(Clone, Copy, Debug)]
pub enum Align {
    Left,
    Middle,
    Right,
}

/// A page that shapes are added to; later ones cover earlier ones.
pub struct Page(Scene);

impl Page {
    /// A white page.
    pub fn new(width: f64, height: f64) -> Self {
        let mut scene = Scene::new(width, height);
        // The first is the one in the PNG; Verdana is as wide, the others are narrower.
        scene.font_family = Some("DejaVu Sans, Verdana, Helvetica, Arial, sans-serif".to_owned());
        Self(scene)
    }

    /// A line through `points`; `dash` is the length of dashes and gaps.
    pub fn line(&mut self, points: &[Point], colour: Colour, width: f64, dash: Option<u32>) {
        self.0.elements.push(Primitive::PolyLine {
            points: points.iter().map(|[x, y]| (*x, *y)).collect(),
            stroke: ink(colour),
            stroke_width: width,
            stroke_dasharray: dash.map(|length| format!("{length},{length}")),
        });
    }

    /// A filled rectangle, opaque by `opacity` (0 to 1).
    pub fn rectangle(&mut self, [x0, y0]: Point, [x1, y1]: Point, fill: Colour, opacity: f64) {
        self.0.elements.push(Primitive::Rect {
            x: x0,
            y: y0,
            width: x1 - x0,
            height: y1 - y0,
            fill: ink(fill),
            stroke: None,
            stroke_width: None,
            opacity: Some(opacity),
        });
    }

    /// A mark of about `radius`, filled, with an outline of 1.5 px.
    pub fn mark(&mut self, shape: Shape, [x, y]: Point, radius: f64, fill: Colour, outline: Colour) {
        let corners: &[Point] = match shape {
            Shape::Circle => {
                self.0.elements.push(Primitive::Circle {
                    cx: x,
                    cy: y,
                    r: radius,
                    fill: ink(fill),
                    fill_opacity: None,
                    stroke: Some(ink(outline)),
                    stroke_width: Some(1.5),
                });
                return;
            }
            Shape::Square => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
            Shape::Triangle => &[[0.0, -1.3], [1.2, 0.9], [-1.2, 0.9]],
            Shape::Diamond => &[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]],
            Shape::Down => &[[0.0, 1.3], [1.2, -0.9], [-1.2, -0.9]],
        };
        let mut outlines = String::new();
        for (i, [dx, dy]) in corners.iter().enumerate() {
            let command = if i == 0 { 'M' } else { 'L' };
            outlines += &format!("{command} {:.2} {:.2} ", x + dx * radius, y + dy * radius);
        }
        self.0.elements.push(Primitive::Path(Box::new(PathData {
            d: outlines + "Z",
            fill: Some(ink(fill)),
            stroke: ink(outline),
            stroke_width: 1.5,
            opacity: None,
            stroke_dasharray: None,
        })));
    }

    /// A line of text on the baseline at `place`. Characters that XML cannot hold become spaces.
    pub fn text(&mut self, [x, y]: Point, text: &str, how: Type, align: Align) {
        // Rich text, because plain text takes what stands between dollars for a formula.
        let (text, bold) = (printable(text), how.bold);
        let spans = vec![TextSpan { text, bold, italic: false, underline: false, code: false, math: false }];
        let (size, anchor, color) = (how.size, anchor(align), Some(ink(how.colour)));
        self.0.elements.push(Primitive::RichText { x, y, spans, size, anchor, color });
    }

    /// What `draw` adds shows `hint` under the pointer, in SVG.
    pub fn hinted(&mut self, hint: &str, draw: impl FnOnce(&mut Self)) {
        self.0.elements.push(Primitive::GroupStart {
            transform: None,
            title: Some(printable(hint)),
            extra_attrs: None,
        });
        draw(self);
        self.0.elements.push(Primitive::GroupEnd);
    }

    /// The page as SVG. Text is text, in the viewer's font.
    pub fn svg(&self) -> String {
        let size = format!("<svg viewBox=\"0 0 {} {}\"", self.0.width, self.0.height);
        SvgBackend::new().with_pretty(true).render_scene(&self.0).replacen("<svg", &size, 1)
    }

    /// The page as PNG file, two pixels for one.
    pub fn png(mut self) -> Vec<u8> {
        for element in &mut self.0.elements {
            // Dashes are the one length that kuva does not scale.
            if let Primitive::PolyLine { stroke_dasharray: Some(dashes), .. } = element {
                let doubled =
                    dashes.split(',').filter_map(|length| length.parse().ok()).map(|n: u32| (2 * n).to_string());
                *dashes = doubled.collect::<Vec<String>>().join(",");
            }
        }
        RasterBackend::new().with_scale(2.0).render_scene(&self.0).expect("a page with an area can be drawn")
    }
}

fn ink([r, g, b]: Colour) -> Color {
    Color::Rgb(r, g, b)
}

fn anchor(align: Align) -> TextAnchor {
    match align {
        Align::Left => TextAnchor::Start,
        Align::Middle => TextAnchor::Middle,
        Align::Right => TextAnchor::End,
    }
}

fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') { ' ' } else { c }).collect()
}

/// Width of each ASCII character from the space on in the font of the PNG, hundredths of its size.
const ADVANCES: [u8; 95] = [
    32, 40, 46, 84, 64, 95, 78, 27, 39, 39, 50, 84, 32, 36, 32, 34, 64, 64, 64, 64, 64, 64, 64, 64, 64, 64, 34, 34, 84,
    84, 84, 53, 100, 68, 69, 70, 77, 63, 58, 77, 75, 29, 29, 66, 56, 86, 75, 79, 60, 79, 69, 63, 61, 73, 68, 99, 69,
    61, 69, 39, 34, 39, 84, 50, 50, 61, 63, 55, 63, 62, 35, 63, 63, 28, 28, 58, 28, 97, 63, 61, 63, 63, 41, 52, 39, 63,
    59, 82, 59, 59, 52, 64, 34, 64, 84,
];

/// Width of `text`, pixels; other letters than ASCII are taken for wide ones.
pub fn width(text: &str, how: Type) -> f64 {
    let advance = |c: char| ADVANCES.get((c as usize).wrapping_sub(32)).copied().unwrap_or(100);
    let hundredths: u64 = text.chars().map(|c| u64::from(advance(c))).sum();
    // Bold letters are about a ninth wider.
    hundredths as f64 * 0.01 * f64::from(how.size) * if how.bold { 1.11 } else { 1.0 }
}

/// `text`, its end replaced by dots if it is wider than `limit` pixels.
pub fn fitted(text: &str, how: Type, limit: f64) -> String {
    if width(text, how) <= limit {
        return text.to_owned();
    }
    let mut text = text.to_owned();
    while !text.is_empty() && width(&text, how) + width("...", how) > limit {
        text.pop();
    }
    text + "..."
}
