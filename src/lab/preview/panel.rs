//! A picture of a sheet: an image as it is, or numbers painted with the scale of the whole sheet.

use std::collections::BTreeMap;

use image::{Rgb, RgbImage};

use super::canvas::{Canvas, EDGE, text_width};
use gelsim_core::base::grid::Grid;
use gelsim_files::number_format::format_number;
use gelsim_job::layers::{LayerForm, OutputLayer};

/// View of a press that a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PanelView {
    /// The tactile image.
    Tactile,
    /// A layer.
    Layer(OutputLayer),
}

impl PanelView {
    /// Name of the view.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tactile => "tactile",
            Self::Layer(layer) => layer.name(),
        }
    }
}

/// Returns true for a layer that a picture can show.
pub fn has_picture(layer: OutputLayer) -> bool {
    match layer.spec().form {
        LayerForm::Grey | LayerForm::Rgb => true,
        LayerForm::Floats { channels, .. } => {
            channels.len() == 1 || matches!(layer, OutputLayer::Normal | OutputLayer::Flow | OutputLayer::Traction)
        }
        LayerForm::Positions => false,
    }
}

/// A picture of a sheet before the sheet's scales are known.
pub enum Panel {
    /// An image as it is.
    Picture(RgbImage),
    /// A number for each pixel.
    Numbers(OutputLayer, Grid<f32>),
    /// A vector in the image's plane for each pixel.
    Vectors(OutputLayer, Grid<[f32; 2]>),
    /// A traction along the picture and into it for each pixel.
    Tractions(Grid<[f32; 3]>),
}

impl Panel {
    /// Makes the picture of a layer of floats, from one plane per channel. None if a picture cannot show the layer.
    pub fn from_planes(layer: OutputLayer, [width, height]: [usize; 2], planes: &[Vec<f32>]) -> Option<Self> {
        let is_complete = |plane: &Vec<f32>| plane.len() == width * height && !plane.is_empty();
        if !has_picture(layer) || !planes.iter().all(is_complete) {
            return None;
        }
        match (layer, planes) {
            (OutputLayer::Normal, [x, y, z]) => {
                // The usual colours of normal maps: a flat pad, whose normal is (0, 0, -1), is blue.
                let level = |share: f32| (127.5 * (1.0 + share)).round() as u8;
                let pixel = |at: usize| [level(x[at]), level(y[at]), level(-z[at])];
                RgbImage::from_raw(width as u32, height as u32, (0..x.len()).flat_map(pixel).collect())
                    .map(Self::Picture)
            }
            (_, [numbers]) => Some(Self::Numbers(layer, Grid { width, height, data: numbers.clone() })),
            (OutputLayer::Traction, [x, y, z]) => {
                let data = (0..x.len()).map(|at| [x[at], y[at], z[at]]).collect();
                Some(Self::Tractions(Grid { width, height, data }))
            }
            (_, [x, y]) => {
                let data = x.iter().zip(y).map(|(x, y)| [*x, *y]).collect();
                Some(Self::Vectors(layer, Grid { width, height, data }))
            }
            _ => None,
        }
    }

    /// Makes the picture of a layer of bytes, one per pixel. None if there are not as many bytes as pixels.
    pub fn from_bytes(layer: OutputLayer, [width, height]: [usize; 2], bytes: &[u8]) -> Option<Self> {
        let value = |x: u32, y: u32| bytes[y as usize * width + x as usize];
        (bytes.len() == width * height).then(|| {
            Self::Picture(RgbImage::from_fn(width as u32, height as u32, |x, y| match layer {
                OutputLayer::Instance => object_colour(value(x, y)),
                _ => Rgb([value(x, y); 3]),
            }))
        })
    }

    /// Width and height, px.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Picture(picture) => (picture.width() as usize, picture.height() as usize),
            Self::Numbers(_, Grid { width, height, .. }) => (*width, *height),
            Self::Vectors(_, Grid { width, height, .. }) => (*width, *height),
            Self::Tractions(Grid { width, height, .. }) => (*width, *height),
        }
    }

    /// Paints the picture, its numbers with these scales.
    pub fn to_picture(&self, scales: &Scales) -> RgbImage {
        match self {
            Self::Picture(picture) => picture.clone(),
            Self::Numbers(layer, grid) => {
                let scale = scales.scale_of(*layer);
                paint_grid(
                    grid,
                    |value| if is_known(*layer, value) { scale.colour_at(f64::from(value)) } else { UNKNOWN },
                )
            }
            Self::Vectors(layer, grid) => {
                let longest = scales.scale_of(*layer).high.max(f64::MIN_POSITIVE);
                let level = |value: f32| (128.0 + 127.0 * f64::from(value) / longest) as u8;
                paint_grid(grid, |[x, y]| Rgb([level(x), level(y), 128]))
            }
            Self::Tractions(grid) => {
                let scale = scales.scale_of(OutputLayer::Traction);
                let mut picture = paint_grid(grid, |[.., z]| scale.colour_at(f64::from(z.max(0.0))));
                draw_arrows(&mut picture, grid, scale.high);
                picture
            }
        }
    }
}

fn paint_grid<T: Copy + Default>(grid: &Grid<T>, colour: impl Fn(T) -> Rgb<u8>) -> RgbImage {
    RgbImage::from_fn(grid.width as u32, grid.height as u32, |x, y| colour(grid.at(x as usize, y as usize)))
}

/// Fields along the longer side of a picture.
const ARROWS: usize = 28;

/// Draws the mean of the tractions along the picture in each of its fields as an arrow. The longest spans two and a half
/// fields, unless it stands for less than a hundredth of `high`.
fn draw_arrows(picture: &mut RgbImage, grid: &Grid<[f32; 3]>, high: f64) {
    const COLOUR: Rgb<u8> = Rgb([230, 159, 0]);
    let field = grid.width.max(grid.height).div_ceil(ARROWS).max(1);
    let mut arrows: Vec<([f64; 2], [f64; 2])> = Vec::new();
    for top in (0..grid.height).step_by(field) {
        for left in (0..grid.width).step_by(field) {
            let (bottom, right) = ((top + field).min(grid.height), (left + field).min(grid.width));
            let mut sum = [0.0; 2];
            for y in top..bottom {
                for [x, y, _] in &grid.row(y)[left..right] {
                    sum = [sum[0] + f64::from(*x), sum[1] + f64::from(*y)];
                }
            }
            let count = ((bottom - top) * (right - left)) as f64;
            arrows.push(([0.5 * (left + right) as f64, 0.5 * (top + bottom) as f64], sum.map(|part| part / count)));
        }
    }
    let length = |[x, y]: [f64; 2]| libm::hypot(x, y);
    let longest = arrows.iter().map(|(_, mean)| length(*mean)).fold(0.01 * high, f64::max);
    // Sheets show pictures smaller.
    let thick = (field / 8).max(1) as i64;
    let mut draw_line = |from: [f64; 2], to: [f64; 2]| {
        let steps = libm::ceil((to[0] - from[0]).abs().max((to[1] - from[1]).abs())).max(1.0);
        for step in 0..=steps as usize {
            let [x, y] = [0, 1].map(|k| (from[k] + (to[k] - from[k]) * step as f64 / steps) as i64 - thick / 2);
            for (x, y) in (0..thick * thick).map(|at| (x + at % thick, y + at / thick)) {
                if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                    && let Some(pixel) = picture.get_pixel_mut_checked(x, y)
                {
                    *pixel = COLOUR;
                }
            }
        }
    };
    for (from, mean) in arrows {
        let [x, y] = mean.map(|part| 2.5 * field as f64 * part / longest);
        // Also leaves out what is not finite.
        if length([x, y]) >= 0.3 * field as f64 && length([x, y]).is_finite() {
            let tip = [from[0] + x, from[1] + y];
            draw_line(from, tip);
            for side in [-0.6, 0.6] {
                draw_line(tip, [tip[0] - 0.3 * (x + side * y), tip[1] - 0.3 * (y - side * x)]);
            }
        }
    }
}

/// Colour of a numbered object: those of Okabe and Ito that stand out on black. 0 is the background.
fn object_colour(number: u8) -> Rgb<u8> {
    const COLOURS: [[u8; 3]; 7] =
        [[86, 180, 233], [230, 159, 0], [0, 158, 115], [240, 228, 66], [204, 121, 167], [213, 94, 0], [255, 255, 255]];
    match number {
        0 => Rgb([0; 3]),
        number => Rgb(COLOURS[(usize::from(number) - 1) % COLOURS.len()]),
    }
}

/// Range of values of a layer's pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Lowest value, 0 or below.
    low: f64,
    /// Highest value, 0 or above.
    high: f64,
    /// Grey level of values just above 0.
    least: f64,
}

impl Scale {
    /// Colour of a value: black at 0, white at the highest, blue at the lowest.
    fn colour_at(self, value: f64) -> Rgb<u8> {
        const BELOW: [f64; 3] = [70.0, 140.0, 255.0];
        let share = |end: f64| if end == 0.0 { 0.0 } else { (value / end).clamp(0.0, 1.0) };
        match value {
            value if value < 0.0 => Rgb(BELOW.map(|level| (level * share(self.low)) as u8)),
            value if value > 0.0 => Rgb([(self.least + (255.0 - self.least) * share(self.high)) as u8; 3]),
            _ => Rgb([0; 3]),
        }
    }
}

/// Colour of pixels where a layer has no value.
const UNKNOWN: Rgb<u8> = Rgb([20, 34, 74]);

/// Returns false for a value that means "none": a layer that ends below 0 has its least value there.
fn is_known(layer: OutputLayer, value: f32) -> bool {
    let least = match layer.spec().form {
        LayerForm::Floats { least, .. } => least,
        LayerForm::Grey | LayerForm::Rgb | LayerForm::Positions => 0.0,
    };
    value.is_finite() && (value > least || value >= 0.0)
}

/// Least and greatest values of each layer of numbers in some pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges(BTreeMap<OutputLayer, [f32; 2]>);

impl Ranges {
    /// Finds the ranges of some panels.
    pub fn from_panels<'a>(panels: impl IntoIterator<Item = &'a Panel>) -> Self {
        let mut found = Self::default();
        let mut count = |layer: OutputLayer, value: f32| found.include_range(layer, [value; 2]);
        for panel in panels {
            match panel {
                Panel::Picture(_) => {}
                Panel::Numbers(layer, grid) => {
                    let known = || grid.data.iter().copied().filter(|value| is_known(*layer, *value));
                    count(*layer, known().fold(0.0, f32::max));
                    count(*layer, known().fold(0.0, f32::min));
                }
                Panel::Tractions(grid) => {
                    let sizes = grid.data.iter().flatten().map(|part| part.abs()).filter(|size| size.is_finite());
                    count(OutputLayer::Traction, sizes.fold(0.0, f32::max));
                }
                Panel::Vectors(layer, grid) => {
                    let sizes = grid.data.iter().flatten().map(|part| part.abs()).filter(|size| size.is_finite());
                    count(*layer, sizes.fold(0.0, f32::max));
                }
            }
        }
        found
    }

    fn include_range(&mut self, layer: OutputLayer, [least, most]: [f32; 2]) {
        let [low, high] = self.0.entry(layer).or_default();
        (*low, *high) = (low.min(least), high.max(most));
    }

    /// Widens the ranges to those of other pictures.
    pub fn include(&mut self, other: &Self) {
        other.0.iter().for_each(|(layer, range)| self.include_range(*layer, *range));
    }
}

/// Scales of a sheet: one per layer of numbers, over all its pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scales(BTreeMap<OutputLayer, Scale>);

impl Scales {
    /// Finds the scales that show all numbers of some panels.
    pub fn from_panels<'a>(panels: impl IntoIterator<Item = &'a Panel>) -> Self {
        Self::from_ranges(&Ranges::from_panels(panels))
    }

    /// Returns the scales that show these ranges. Their ends are rounded outwards to two digits, so that they are short
    /// to write.
    pub fn from_ranges(ranges: &Ranges) -> Self {
        let scale = |(layer, [low, high]): (&OutputLayer, &[f32; 2])| {
            // Values less than a hundredth below 0 are noise, and would show as blue specks.
            let low = if -low > 0.01 * high { -round_outwards(-f64::from(*low)) } else { 0.0 };
            (*layer, Scale { low, high: round_outwards(f64::from(*high)), least: least_grey_of(*layer) })
        };
        Self(ranges.0.iter().map(scale).collect())
    }

    fn scale_of(&self, layer: OutputLayer) -> Scale {
        self.0.get(&layer).copied().unwrap_or(Scale { low: 0.0, high: 1.0, least: 0.0 })
    }

    /// Returns the values at the ends of a layer's scale, the higher one with its unit: (`0`, `1.2 mm`). None for a
    /// layer without numbers.
    pub fn end_labels(&self, layer: OutputLayer) -> Option<(String, String)> {
        let Scale { low, high, .. } = self.0.get(&layer)?;
        let unit = layer.spec().unit.map_or(String::new(), |unit| format!(" {unit}"));
        Some((format_number(*low), format!("{}{unit}", format_number(*high))))
    }
}

/// Returns the grey level of a layer's lowest value above 0. Where 0 means "nothing", such as no depth, small values
/// must stand out from it.
fn least_grey_of(layer: OutputLayer) -> f64 {
    match layer.spec().form {
        LayerForm::Floats { least: 0.0, .. } => 40.0,
        _ => 0.0,
    }
}

/// Rounds up to a number of two digits.
fn round_outwards(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let digit = libm::pow(10.0, libm::floor(libm::log10(value)) - 1.0);
    // The tolerance keeps a number that has two digits already, whatever its last bits are.
    (value / digit - 1e-4).ceil() * digit
}

/// Heading over a column of pictures, or beside a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Heading {
    /// Name of the view.
    name: String,
    /// What else to write if there is room.
    more: Option<&'static str>,
    /// Labels of the scale's ends, and the scale.
    scale: Option<(String, String, Scale)>,
}

impl Heading {
    /// Makes a heading of words alone.
    pub fn from_words(words: String) -> Self {
        Self { name: words, more: None, scale: None }
    }

    /// Makes the heading of a view.
    pub fn from_view(view: PanelView, scales: &Scales) -> Self {
        let plain = Self::from_words(view.name().to_owned());
        let PanelView::Layer(layer) = view else { return plain };
        const PLANE: Option<&str> = Some("x red, y green");
        match (layer, scales.end_labels(layer)) {
            (OutputLayer::Normal, _) => Self { more: PLANE, ..plain },
            (OutputLayer::Flow, Some((_, high))) => Self { name: format!("flow to {high}"), more: PLANE, scale: None },
            (OutputLayer::Traction, Some((_, high))) => {
                Self { name: format!("traction to {high}"), more: Some("arrows: along the pad"), scale: None }
            }
            (_, Some((low, high))) => Self { scale: Some((low, high, scales.scale_of(layer))), ..plain },
            (_, None) => plain,
        }
    }

    /// Returns the heading as one line of words, with the ends of the scale.
    fn to_text(&self) -> String {
        match &self.scale {
            Some((low, high, scale)) if scale.high > scale.low => format!("{} {low} to {high}", self.name),
            Some((_, high, _)) => format!("{} all {high}", self.name),
            None => self.name.clone(),
        }
    }

    /// Returns the heading as short lines.
    pub fn text_lines(&self) -> Vec<String> {
        match &self.scale {
            Some((low, high, scale)) if scale.high > scale.low => vec![self.name.clone(), format!("{low} to {high}")],
            Some(_) | None => std::iter::once(self.to_text()).chain(self.more.map(str::to_owned)).collect(),
        }
    }

    /// Width that it needs, px.
    pub fn width(&self) -> u32 {
        text_width(&self.to_text())
    }

    /// Writes it into `room` px, with a bar of the scale if that fits.
    pub fn write(&self, canvas: &mut Canvas, [left, top]: [u32; 2], room: u32) {
        const BAR: [u32; 2] = [24, 80];
        let Some((low, high, scale)) = &self.scale else {
            let more = self.more.map_or(String::new(), |more| format!(": {more}"));
            let full = format!("{}{more}", self.name);
            let text = if text_width(&full) <= room { full } else { self.to_text() };
            return canvas.write_text(&text, [left, top], room);
        };
        let before = format!("{} {low} ", self.name);
        // The last space keeps a distance from the next heading.
        let taken = text_width(&before) + text_width(" ") + text_width(high) + text_width(" ");
        if scale.high <= scale.low || room < taken + BAR[0] {
            return canvas.write_text(&self.to_text(), [left, top], room);
        }
        canvas.write_text(&before, [left, top], room);
        let (start, long) = (left + text_width(&before), (room - taken).min(BAR[1]).max(BAR[0]));
        for x in 0..long {
            let share = f64::from(x.saturating_sub(1)) / f64::from(long - 3);
            let shade = scale.colour_at(scale.low + share * (scale.high - scale.low));
            for y in 0..11 {
                let edge = x == 0 || x + 1 == long || y == 0 || y == 10;
                canvas.set_pixel([start + x, top + 1 + y], if edge { EDGE } else { shade });
            }
        }
        canvas.write_text(high, [start + long + text_width(" "), top], text_width(high));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(layer: OutputLayer, data: &[f32]) -> Panel {
        Panel::from_planes(layer, [data.len(), 1], &[data.to_vec()]).expect("a picture")
    }

    fn greys(panel: &Panel, scales: &Scales) -> Vec<[u8; 3]> {
        panel.to_picture(scales).pixels().map(|pixel| pixel.0).collect()
    }

    #[test]
    fn numbers_of_a_layer_have_one_scale_on_all_of_a_sheet() {
        let depth = |data: &[f32]| numbers(OutputLayer::Depth, data);
        let [shallow, deep] = [depth(&[0.0, 0.01, 0.6]), depth(&[0.0, 1.17])];
        let scales = Scales::from_panels([&shallow, &deep]);
        assert_eq!(scales.end_labels(OutputLayer::Depth), Some((String::from("0"), String::from("1.2 mm"))));
        let (shallow, deep) = (greys(&shallow, &scales), greys(&deep, &scales));
        assert_eq!((shallow[0], deep[0]), ([0; 3], [0; 3]));
        assert!((145..150).contains(&shallow[2][0]) && deep[1][0] > 245, "{shallow:?} {deep:?}");
        assert!(shallow[1][0] >= 40, "what is little stands out from what is none");
        let flat = numbers(OutputLayer::Depth, &[0.0; 3]);
        let scales = Scales::from_panels([&flat]);
        assert_eq!(greys(&flat, &scales), [[0; 3]; 3]);
        assert_eq!(Heading::from_view(PanelView::Layer(OutputLayer::Depth), &scales).text_lines(), ["depth all 0 mm"]);
    }

    #[test]
    fn what_is_below_zero_is_blue_and_what_is_unknown_has_no_scale() {
        let surface = numbers(OutputLayer::Surface, &[-0.1, 0.0, 1.0, f32::NAN]);
        let scales = Scales::from_panels([&surface]);
        assert_eq!(scales.end_labels(OutputLayer::Surface), Some((String::from("-0.1"), String::from("1 mm"))));
        assert_eq!(greys(&surface, &scales), [[70, 140, 255], [0; 3], [255; 3], UNKNOWN.0]);
        let gap = numbers(OutputLayer::Gap, &[-1.0, 0.0, 0.5]);
        let scales = Scales::from_panels([&gap]);
        assert_eq!(scales.end_labels(OutputLayer::Gap), Some((String::from("0"), String::from("0.5 mm"))));
        assert_eq!(greys(&gap, &scales), [UNKNOWN.0, [0; 3], [255; 3]]);
    }

    #[test]
    fn tractions_are_arrows_over_pressure() {
        let size = [48, 24];
        let plane = |value: f32| vec![value; 48 * 24];
        let panel =
            Panel::from_planes(OutputLayer::Traction, size, &[plane(4.0), plane(0.0), plane(8.0)]).expect("one");
        let scales = Scales::from_panels([&panel]);
        let picture = panel.to_picture(&scales);
        let is_arrow = |pixel: &Rgb<u8>| *pixel == Rgb([230, 159, 0]);
        let arrows = picture.pixels().filter(|pixel| is_arrow(pixel)).count();
        assert!((100..1100).contains(&arrows), "{arrows}");
        assert!(picture.pixels().any(|pixel| *pixel == Rgb([255; 3])), "the highest pressure is white");
        let still =
            Panel::from_planes(OutputLayer::Traction, size, &[plane(0.0), plane(0.0), plane(8.0)]).expect("one");
        assert!(!still.to_picture(&scales).pixels().any(is_arrow));
    }

    #[test]
    fn normals_and_flow_have_colours_of_their_own_and_clouds_of_points_no_picture() {
        let plane = |value: f32| vec![value; 2];
        let flat =
            Panel::from_planes(OutputLayer::Normal, [2, 1], &[plane(0.0), plane(0.0), plane(-1.0)]).expect("one");
        assert_eq!(greys(&flat, &Scales::default()), [[128, 128, 255]; 2]);
        let still = Panel::from_planes(OutputLayer::Flow, [2, 1], &[plane(0.0), plane(0.0)]).expect("one");
        assert_eq!(greys(&still, &Scales::from_panels([&still])), [[128; 3]; 2]);
        let moved = Panel::from_planes(OutputLayer::Flow, [2, 1], &[vec![0.2, -0.2], plane(0.0)]).expect("one");
        assert_eq!(greys(&moved, &Scales::from_panels([&moved])), [[255, 128, 128], [0, 128, 128]]);
        let three = [plane(0.0), plane(0.0), plane(0.0)];
        assert!(Panel::from_planes(OutputLayer::Points, [2, 1], &three).is_none());
        assert!(Panel::from_planes(OutputLayer::Depth, [3, 1], &[plane(0.0)]).is_none(), "too few values");
        let shown = OutputLayer::ALL.into_iter().filter(|layer| has_picture(*layer)).map(OutputLayer::name);
        let expected = "depth surface contact normal pressure gap reference slip flow traction instance untouched";
        assert_eq!(shown.collect::<Vec<_>>().join(" "), expected);
    }

    #[test]
    fn scales_end_at_numbers_of_two_digits() {
        let rounded = [1.17, 1.2, 0.0312, 999.0, 250.0, 0.0].map(round_outwards).map(format_number);
        assert_eq!(rounded, ["1.2", "1.2", "0.032", "1000", "250", "0"]);
    }
}
