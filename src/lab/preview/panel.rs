//! What one picture of a sheet shows: an image as it is, or numbers whose scale is that of the whole sheet.

use std::collections::BTreeMap;

use image::{Rgb, RgbImage};

use super::canvas::{Canvas, EDGE, width};
use gelsim_core::base::grid::Grid;
use gelsim_files::figures::figure;
use gelsim_job::layers::{Form, OutputLayer};

/// What a picture shows of a press.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// The tactile image.
    Tactile,
    /// A layer.
    Layer(OutputLayer),
}

impl View {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tactile => "tactile",
            Self::Layer(layer) => layer.name(),
        }
    }
}

/// True of a layer that a picture can show.
pub fn has_picture(layer: OutputLayer) -> bool {
    match layer.spec().form {
        Form::Grey | Form::Rgb => true,
        Form::Floats { channels, .. } => {
            channels.len() == 1 || matches!(layer, OutputLayer::Normal | OutputLayer::Flow)
        }
        Form::Positions => false,
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
}

impl Panel {
    /// Of a layer of floats, from a plane for each of its channels. None if a picture cannot show it.
    pub fn of_planes(layer: OutputLayer, [width, height]: [usize; 2], planes: &[Vec<f32>]) -> Option<Self> {
        let whole = |plane: &Vec<f32>| plane.len() == width * height && !plane.is_empty();
        if !has_picture(layer) || !planes.iter().all(whole) {
            return None;
        }
        match (layer, planes) {
            (OutputLayer::Normal, [x, y, z]) => {
                // A flat pad, whose normal is (0, 0, -1), is blue.
                let level = |share: f32| (127.5 * (1.0 + share)).round() as u8;
                let pixel = |at: usize| [level(x[at]), level(y[at]), level(-z[at])];
                RgbImage::from_raw(width as u32, height as u32, (0..x.len()).flat_map(pixel).collect())
                    .map(Self::Picture)
            }
            (_, [numbers]) => Some(Self::Numbers(layer, Grid { width, height, data: numbers.clone() })),
            (_, [x, y]) => {
                let data = x.iter().zip(y).map(|(x, y)| [*x, *y]).collect();
                Some(Self::Vectors(layer, Grid { width, height, data }))
            }
            _ => None,
        }
    }

    /// Of a layer of bytes, one for each pixel.
    pub fn of_bytes(layer: OutputLayer, [width, height]: [usize; 2], bytes: &[u8]) -> Option<Self> {
        let value = |x: u32, y: u32| bytes[y as usize * width + x as usize];
        (bytes.len() == width * height).then(|| {
            Self::Picture(RgbImage::from_fn(width as u32, height as u32, |x, y| match layer {
                OutputLayer::Instance => colour_of(value(x, y)),
                _ => Rgb([value(x, y); 3]),
            }))
        })
    }

    /// The picture, where numbers have these scales.
    pub fn picture(&self, scales: &Scales) -> RgbImage {
        match self {
            Self::Picture(picture) => picture.clone(),
            Self::Numbers(layer, grid) => {
                let scale = scales.of(*layer);
                painted(grid, |value| if is_known(*layer, value) { scale.shade(f64::from(value)) } else { UNKNOWN })
            }
            Self::Vectors(layer, grid) => {
                let longest = scales.of(*layer).high.max(f64::MIN_POSITIVE);
                let level = |value: f32| (128.0 + 127.0 * f64::from(value) / longest) as u8;
                painted(grid, |[x, y]| Rgb([level(x), level(y), 128]))
            }
        }
    }
}

fn painted<T: Copy + Default>(grid: &Grid<T>, colour: impl Fn(T) -> Rgb<u8>) -> RgbImage {
    RgbImage::from_fn(grid.width as u32, grid.height as u32, |x, y| colour(grid.at(x as usize, y as usize)))
}

/// Colours of numbered objects: Okabe and Ito's that stand out on black.
fn colour_of(number: u8) -> Rgb<u8> {
    const COLOURS: [[u8; 3]; 7] =
        [[86, 180, 233], [230, 159, 0], [0, 158, 115], [240, 228, 66], [204, 121, 167], [213, 94, 0], [255, 255, 255]];
    match number {
        0 => Rgb([0; 3]),
        number => Rgb(COLOURS[(usize::from(number) - 1) % COLOURS.len()]),
    }
}

/// From which value to which a layer's pictures go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The least value, 0 or below.
    low: f64,
    /// The largest, 0 or above.
    high: f64,
    /// The grey of what is just above 0.
    least: f64,
}

impl Scale {
    /// From black at 0 to white; below 0 to blue.
    fn shade(self, value: f64) -> Rgb<u8> {
        const BELOW: [f64; 3] = [70.0, 140.0, 255.0];
        let share = |end: f64| if end == 0.0 { 0.0 } else { (value / end).clamp(0.0, 1.0) };
        match value {
            value if value < 0.0 => Rgb(BELOW.map(|level| (level * share(self.low)) as u8)),
            value if value > 0.0 => Rgb([(self.least + (255.0 - self.least) * share(self.high)) as u8; 3]),
            _ => Rgb([0; 3]),
        }
    }
}

/// Pixels of which a layer knows nothing.
const UNKNOWN: Rgb<u8> = Rgb([20, 34, 74]);

/// False of a number that stands for none: a layer that ends below 0 has it there.
fn is_known(layer: OutputLayer, value: f32) -> bool {
    let least = match layer.spec().form {
        Form::Floats { least, .. } => least,
        Form::Grey | Form::Rgb | Form::Positions => 0.0,
    };
    value.is_finite() && (value > least || value >= 0.0)
}

/// The scales of a sheet: one for each layer of numbers, over all pictures of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scales(BTreeMap<OutputLayer, Scale>);

impl Scales {
    /// Those that show all numbers of some panels, rounded outwards to two digits, which can be said.
    pub fn over<'a>(panels: impl IntoIterator<Item = &'a Panel>) -> Self {
        let mut found: BTreeMap<OutputLayer, [f32; 2]> = BTreeMap::new();
        let mut count = |layer: OutputLayer, value: f32| {
            let [low, high] = found.entry(layer).or_default();
            (*low, *high) = (low.min(value), high.max(value));
        };
        for panel in panels {
            match panel {
                Panel::Picture(_) => {}
                Panel::Numbers(layer, grid) => {
                    let known = || grid.data.iter().copied().filter(|value| is_known(*layer, *value));
                    count(*layer, known().fold(0.0, f32::max));
                    count(*layer, known().fold(0.0, f32::min));
                }
                Panel::Vectors(layer, grid) => {
                    let sizes = grid.data.iter().flatten().map(|part| part.abs()).filter(|size| size.is_finite());
                    count(*layer, sizes.fold(0.0, f32::max));
                }
            }
        }
        let scale = |(layer, [low, high]): (OutputLayer, [f32; 2])| {
            // Less than a hundredth below 0 would show as noise of a colour.
            let low = if -low > 0.01 * high { -outwards(-f64::from(low)) } else { 0.0 };
            (layer, Scale { low, high: outwards(f64::from(high)), least: least_grey(layer) })
        };
        Self(found.into_iter().map(scale).collect())
    }

    fn of(&self, layer: OutputLayer) -> Scale {
        self.0.get(&layer).copied().unwrap_or(Scale { low: 0.0, high: 1.0, least: 0.0 })
    }

    /// The values at the ends of a layer's scale, with their unit: (`0`, `1.2 mm`). None of a layer without numbers.
    pub fn ends(&self, layer: OutputLayer) -> Option<(String, String)> {
        let Scale { low, high, .. } = self.0.get(&layer)?;
        let unit = layer.spec().unit.map_or(String::new(), |unit| format!(" {unit}"));
        Some((figure(*low), format!("{}{unit}", figure(*high))))
    }
}

/// The grey of a layer's least value above 0. Where 0 stands for nothing, such as no depth, what is little stands out from it.
fn least_grey(layer: OutputLayer) -> f64 {
    match layer.spec().form {
        Form::Floats { least: 0.0, .. } => 40.0,
        _ => 0.0,
    }
}

/// The next larger number of two digits.
fn outwards(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let digit = libm::pow(10.0, libm::floor(libm::log10(value)) - 1.0);
    // What is such a number itself stays, whatever its last bits are.
    (value / digit - 1e-4).ceil() * digit
}

/// What stands over a column of pictures, or beside a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Heading {
    /// What is shown.
    name: String,
    /// What more there is to say where there is room.
    more: Option<&'static str>,
    /// The ends of its scale, and what lies between them.
    scale: Option<(String, String, Scale)>,
}

impl Heading {
    /// Of words alone.
    pub fn of_words(words: String) -> Self {
        Self { name: words, more: None, scale: None }
    }

    /// Of what a column shows.
    pub fn of_view(view: View, scales: &Scales) -> Self {
        let plain = Self::of_words(view.name().to_owned());
        let View::Layer(layer) = view else { return plain };
        const PLANE: Option<&str> = Some("x red, y green");
        match (layer, scales.ends(layer)) {
            (OutputLayer::Normal, _) => Self { more: PLANE, ..plain },
            (OutputLayer::Flow, Some((_, high))) => Self { name: format!("flow to {high}"), more: PLANE, scale: None },
            (_, Some((low, high))) => Self { scale: Some((low, high, scales.of(layer))), ..plain },
            (_, None) => plain,
        }
    }

    /// The same in words.
    fn words(&self) -> String {
        match &self.scale {
            Some((low, high, scale)) if scale.high > scale.low => format!("{} {low} to {high}", self.name),
            Some((_, high, _)) => format!("{} all {high}", self.name),
            None => self.name.clone(),
        }
    }

    /// The same in short lines.
    pub fn lines(&self) -> Vec<String> {
        match &self.scale {
            Some((low, high, scale)) if scale.high > scale.low => vec![self.name.clone(), format!("{low} to {high}")],
            Some(_) | None => std::iter::once(self.words()).chain(self.more.map(str::to_owned)).collect(),
        }
    }

    /// Room that it needs, px.
    pub fn width(&self) -> u32 {
        width(&self.words())
    }

    /// Writes it into `room` px, with a bar of the scale if that fits.
    pub fn write(&self, canvas: &mut Canvas, [left, top]: [u32; 2], room: u32) {
        const BAR: [u32; 2] = [24, 80];
        let Some((low, high, scale)) = &self.scale else {
            let more = self.more.map_or(String::new(), |more| format!(": {more}"));
            let whole = format!("{}{more}", self.name);
            let text = if width(&whole) <= room { whole } else { self.words() };
            return canvas.write(&text, [left, top], room);
        };
        let before = format!("{} {low} ", self.name);
        // With room left before the next heading.
        let taken = width(&before) + width(" ") + width(high) + width(" ");
        if scale.high <= scale.low || room < taken + BAR[0] {
            return canvas.write(&self.words(), [left, top], room);
        }
        canvas.write(&before, [left, top], room);
        let (start, long) = (left + width(&before), (room - taken).min(BAR[1]).max(BAR[0]));
        for x in 0..long {
            let share = f64::from(x.saturating_sub(1)) / f64::from(long - 3);
            let shade = scale.shade(scale.low + share * (scale.high - scale.low));
            for y in 0..11 {
                let edge = x == 0 || x + 1 == long || y == 0 || y == 10;
                canvas.set([start + x, top + 1 + y], if edge { EDGE } else { shade });
            }
        }
        canvas.write(high, [start + long + width(" "), top], width(high));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(layer: OutputLayer, data: &[f32]) -> Panel {
        Panel::of_planes(layer, [data.len(), 1], &[data.to_vec()]).expect("a picture")
    }

    fn greys(panel: &Panel, scales: &Scales) -> Vec<[u8; 3]> {
        panel.picture(scales).pixels().map(|pixel| pixel.0).collect()
    }

    #[test]
    fn numbers_of_a_layer_have_one_scale_on_all_of_a_sheet() {
        let depth = |data: &[f32]| numbers(OutputLayer::Depth, data);
        let [shallow, deep] = [depth(&[0.0, 0.01, 0.6]), depth(&[0.0, 1.17])];
        let scales = Scales::over([&shallow, &deep]);
        assert_eq!(scales.ends(OutputLayer::Depth), Some((String::from("0"), String::from("1.2 mm"))));
        let (shallow, deep) = (greys(&shallow, &scales), greys(&deep, &scales));
        assert_eq!((shallow[0], deep[0]), ([0; 3], [0; 3]));
        assert!((145..150).contains(&shallow[2][0]) && deep[1][0] > 245, "{shallow:?} {deep:?}");
        assert!(shallow[1][0] >= 40, "what is little stands out from what is none");
        let flat = numbers(OutputLayer::Depth, &[0.0; 3]);
        let scales = Scales::over([&flat]);
        assert_eq!(greys(&flat, &scales), [[0; 3]; 3]);
        assert_eq!(Heading::of_view(View::Layer(OutputLayer::Depth), &scales).lines(), ["depth all 0 mm"]);
    }

    #[test]
    fn what_is_below_zero_is_blue_and_what_is_unknown_has_no_scale() {
        let surface = numbers(OutputLayer::Surface, &[-0.1, 0.0, 1.0, f32::NAN]);
        let scales = Scales::over([&surface]);
        assert_eq!(scales.ends(OutputLayer::Surface), Some((String::from("-0.1"), String::from("1 mm"))));
        assert_eq!(greys(&surface, &scales), [[70, 140, 255], [0; 3], [255; 3], UNKNOWN.0]);
        let gap = numbers(OutputLayer::Gap, &[-1.0, 0.0, 0.5]);
        let scales = Scales::over([&gap]);
        assert_eq!(scales.ends(OutputLayer::Gap), Some((String::from("0"), String::from("0.5 mm"))));
        assert_eq!(greys(&gap, &scales), [UNKNOWN.0, [0; 3], [255; 3]]);
    }

    #[test]
    fn normals_and_flow_have_colours_of_their_own_and_clouds_of_points_no_picture() {
        let plane = |value: f32| vec![value; 2];
        let flat = Panel::of_planes(OutputLayer::Normal, [2, 1], &[plane(0.0), plane(0.0), plane(-1.0)]).expect("one");
        assert_eq!(greys(&flat, &Scales::default()), [[128, 128, 255]; 2]);
        let still = Panel::of_planes(OutputLayer::Flow, [2, 1], &[plane(0.0), plane(0.0)]).expect("one");
        assert_eq!(greys(&still, &Scales::over([&still])), [[128; 3]; 2]);
        let moved = Panel::of_planes(OutputLayer::Flow, [2, 1], &[vec![0.2, -0.2], plane(0.0)]).expect("one");
        assert_eq!(greys(&moved, &Scales::over([&moved])), [[255, 128, 128], [0, 128, 128]]);
        let three = [plane(0.0), plane(0.0), plane(0.0)];
        assert!(Panel::of_planes(OutputLayer::Points, [2, 1], &three).is_none());
        assert!(Panel::of_planes(OutputLayer::Depth, [3, 1], &[plane(0.0)]).is_none(), "too few values");
        let shown = OutputLayer::ALL.into_iter().filter(|layer| has_picture(*layer)).map(OutputLayer::name);
        let expected = "depth surface contact normal pressure gap reference slip flow instance untouched";
        assert_eq!(shown.collect::<Vec<_>>().join(" "), expected);
    }

    #[test]
    fn scales_end_at_numbers_of_two_digits() {
        let rounded = [1.17, 1.2, 0.0312, 999.0, 250.0, 0.0].map(outwards).map(figure);
        assert_eq!(rounded, ["1.2", "1.2", "0.032", "1000", "250", "0"]);
    }
}
