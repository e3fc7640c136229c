//! Contact sheets: tactile image, depth and contact of some samples, with class and depth written under each.

use embedded_graphics::mono_font::ascii;
use embedded_graphics::text::Baseline;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use crate::core::base::grid::Grid;
use crate::core::camera::Image;
use crate::dataset::archive::{Files, Member};
use crate::dataset::decode;
use crate::dataset::encode::{frame, make_shown};
use crate::dataset::labels::SampleLabel;
use crate::files::png;
use crate::job::label::{Label, key};
use crate::job::plan::Plan;
use crate::job::sample::{Sample, shown};
use crate::lab::page::ink::dots;

pub mod effects;
pub mod rows;

/// One sample as a sheet shows it.
pub struct Tile {
    panels: Vec<RgbImage>,
    /// How many of them, from the first on, are tactile images.
    tactile: usize,
    caption: String,
}

/// Frames of a sequence that a sheet shows, at most.
const FRAMES: usize = 6;

impl Tile {
    /// Renders sample `index` of a plan.
    pub fn rendered(plan: &Plan, index: u64) -> Self {
        if plan.job().sequence.is_some() {
            return Self::read(&sequence_files(plan, index)).expect("files that were made just now");
        }
        let Sample { impression, label, .. } = shown(plan, index);
        let Image { width, height, .. } = impression.image;
        let mut tactile = RgbImage::new(width as u32, height as u32);
        tactile.copy_from_slice(&impression.image.rgb);
        let depth = Grid { width, height, data: impression.depth_mm() };
        let mask = Grid { width, height, data: impression.contact_mask() };
        let panels = panels(tactile, Some(&depth), Some(&mask));
        Self { panels, tactile: 1, caption: caption(&label) }
    }

    /// Shows a sample of a dataset from its files.
    pub fn read(files: &Files) -> Result<Self, String> {
        let named = |suffix: &str, reason: String| format!("{}.{suffix}: {reason}", files.key);
        let needed =
            |suffix: &str| files.member(suffix).ok_or_else(|| named(suffix, String::from("is not in the shard")));
        let label = SampleLabel::read(needed("json")?).map_err(|error| named("json", error))?;
        if let Some(sequence) = label.sequence() {
            let count = sequence.frames.len();
            let shown = count.min(FRAMES);
            // The first, the last, and some between.
            let panels = (0..shown).map(|k| tactile(files, k * (count - 1) / (shown - 1).max(1)));
            let panels = panels.collect::<Result<_, _>>()?;
            return Ok(Self { panels, tactile: shown, caption: caption(label.summary()) });
        }
        let label = label.summary();
        let tactile = png::decode_rgb(needed("tactile.png")?).map_err(|reason| named("tactile.png", reason))?;
        let depth = decode::depth_mm(files, &label.png16)?;
        let contact = files.member("contact.png").map(png::decode_rgb).transpose();
        let contact = contact.map_err(|reason| named("contact.png", reason))?.map(|grey| Grid {
            width: grey.width() as usize,
            height: grey.height() as usize,
            data: grey.pixels().map(|pixel| pixel.0[0]).collect(),
        });
        let panels = panels(tactile, depth.as_ref(), contact.as_ref());
        Ok(Self { panels, tactile: 1, caption: caption(label) })
    }

    /// Class, depth and number.
    pub fn caption(&self) -> &str {
        &self.caption
    }

    /// The panels beside each other, each made `panel_width` px wide at the most.
    pub fn strip(&self, panel_width: u32) -> RgbImage {
        beside(&scaled(&self.panels, panel_width))
    }

    /// The same of the tactile images alone: one of a press, the frames of a sequence.
    pub fn tactile(&self, panel_width: u32) -> RgbImage {
        beside(&scaled(&self.panels[..self.tactile], panel_width))
    }
}

/// Panels in a row.
fn beside(panels: &[RgbImage]) -> RgbImage {
    let height = panels.iter().map(RgbImage::height).max().unwrap_or(1);
    let width: u32 = panels.iter().map(|panel| panel.width() + 2).sum();
    let mut strip = RgbImage::from_pixel(width.saturating_sub(2).max(1), height, PAPER);
    let mut left = 0;
    for panel in panels {
        imageops::replace(&mut strip, panel, left, 0);
        left += i64::from(panel.width()) + 2;
    }
    strip
}

/// The panels that there are: tactile, depth (mm), contact (255 where the pad touches).
fn panels(tactile: RgbImage, depth: Option<&Grid<f32>>, contact: Option<&Grid<u8>>) -> Vec<RgbImage> {
    let mut panels = vec![tactile];
    if let Some(depth) = depth {
        let deepest = depth.data.iter().fold(f32::MIN_POSITIVE, |max, mm| max.max(*mm));
        panels.push(grey(depth, |mm| (mm / deepest * 255.0) as u8));
    }
    panels.extend(contact.map(|contact| grey(contact, |value| value)));
    panels
}

/// The files of a sequence of a plan, made anew.
pub fn sequence_files(plan: &Plan, index: u64) -> Files {
    let made = make_shown(plan, index);
    let file = |Member { suffix, bytes }| (suffix, bytes.into_vec().expect("nothing of it is spooled"));
    Files { key: key(index), members: made.members.into_iter().map(file).collect() }
}

/// The tactile image of a frame.
fn tactile(files: &Files, number: usize) -> Result<RgbImage, String> {
    let suffix = format!("{}.tactile.png", frame(number as u32));
    let png = files.member(&suffix).ok_or_else(|| format!("{}.{suffix}: is not in the shard", files.key))?;
    png::decode_rgb(png).map_err(|reason| format!("{}.{suffix}: {reason}", files.key))
}

/// All frames of a sequence as an animated PNG, at the speed at which they were taken.
pub fn animation(files: &Files) -> Result<Vec<u8>, String> {
    let label = files.member("json").ok_or_else(|| format!("{}.json: is not in the shard", files.key))?;
    let label = SampleLabel::read(label).map_err(|error| format!("{}.json: {error}", files.key))?;
    let Some(sequence) = label.sequence() else {
        return Err(format!("sample {} is a press: only a sequence moves", files.key));
    };
    let first = tactile(files, 0)?;
    let mut bytes = Vec::new();
    let said = |error: ::png::EncodingError| error.to_string();
    let mut encoder = ::png::Encoder::new(&mut bytes, first.width(), first.height());
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_animated(sequence.frames.len() as u32, 0).map_err(said)?;
    // A fraction of two whole numbers, as the format has it; slow and very fast ones in whole milliseconds.
    let rate_hz = sequence.common.sequence.frame_rate_hz;
    let (time, per_second) = match rate_hz {
        1.0..=600.0 => (100, (100.0 * rate_hz).round() as u16),
        _ => ((1e3 / rate_hz).round().clamp(1.0, 65_535.0) as u16, 1000),
    };
    encoder.set_frame_delay(time, per_second).map_err(said)?;
    let mut writer = encoder.write_header().map_err(said)?;
    for number in 0..sequence.frames.len() {
        writer.write_image_data(&tactile(files, number)?).map_err(said)?;
    }
    writer.finish().map_err(said)?;
    Ok(bytes)
}

fn caption(label: &Label) -> String {
    let depth = match label.contact.in_contact {
        true => format!("{:.2} mm", label.contact.max_depth_mm),
        false => String::from("no contact"),
    };
    // The font has ASCII only.
    let class: String = label.object.class.chars().map(|c| if c.is_ascii_graphic() { c } else { '?' }).collect();
    format!("{class}  {depth}  #{}", label.index)
}

fn grey<T: Copy + Default>(grid: &Grid<T>, value: impl Fn(T) -> u8) -> RgbImage {
    RgbImage::from_fn(grid.width as u32, grid.height as u32, |x, y| Rgb([value(grid.at(x as usize, y as usize)); 3]))
}

const GAP: u32 = 6;
const CAPTION: u32 = 18;
/// Width of a character.
const CHARACTER: u32 = 7;
const PAPER: Rgb<u8> = Rgb([24, 24, 26]);
const INK: Rgb<u8> = Rgb([225, 225, 225]);

/// Lays tiles out in rows of `columns`; panels are made `panel_width` px wide at the most.
pub fn sheet(tiles: &[Tile], columns: usize, panel_width: u32) -> RgbImage {
    let panels: Vec<Vec<RgbImage>> = tiles.iter().map(|tile| scaled(&tile.panels, panel_width)).collect();
    let tile_width = panels.iter().map(|row| row.iter().map(|p| p.width() + 2).sum::<u32>()).max().unwrap_or(1);
    let tile_height = panels.iter().flatten().map(RgbImage::height).max().unwrap_or(1) + CAPTION;
    let columns = columns.clamp(1, tiles.len().max(1)) as u32;
    let rows = (tiles.len() as u32).div_ceil(columns);
    let (width, height) = (GAP + columns * (tile_width + GAP), GAP + rows * (tile_height + GAP));
    let mut canvas = Canvas::new(width, height);
    for (i, (tile, panels)) in tiles.iter().zip(panels).enumerate() {
        let left = GAP + (i as u32 % columns) * (tile_width + GAP);
        let top = GAP + (i as u32 / columns) * (tile_height + GAP);
        let (mut x, mut below) = (left, top);
        for panel in panels {
            canvas.place(&panel, [x, top]);
            x += panel.width() + 2;
            below = below.max(top + panel.height());
        }
        canvas.write(&tile.caption, [left, below + 3], tile_width);
    }
    canvas.0
}

fn scaled(panels: &[RgbImage], width: u32) -> Vec<RgbImage> {
    let scale = |panel: &RgbImage| match panel.width() > width {
        true => {
            let height = (u64::from(panel.height()) * u64::from(width)).div_ceil(u64::from(panel.width()));
            imageops::resize(panel, width, height as u32, FilterType::Triangle)
        }
        false => panel.clone(),
    };
    panels.iter().map(scale).collect()
}

/// `to` less `from`, times `gain`, around grey. Both are of one size.
pub fn difference(from: &RgbImage, to: &RgbImage, gain: i32) -> RgbImage {
    let mut difference = RgbImage::new(from.width(), from.height());
    for ((value, from), to) in difference.iter_mut().zip(from.iter()).zip(to.iter()) {
        *value = (128 + gain * (i32::from(*to) - i32::from(*from))).clamp(0, 255) as u8;
    }
    difference
}

struct Canvas(RgbImage);

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        Self(RgbImage::from_pixel(width, height, PAPER))
    }

    fn place(&mut self, panel: &RgbImage, [left, top]: [u32; 2]) {
        imageops::replace(&mut self.0, panel, i64::from(left), i64::from(top));
    }

    /// Writes what of a text fits into `room` px.
    fn write(&mut self, text: &str, [left, top]: [u32; 2], room: u32) {
        let text: String = text.chars().take((room / CHARACTER) as usize).collect();
        for [x, y] in dots(&text, &ascii::FONT_7X13, Baseline::Top) {
            if let (Ok(x), Ok(y)) = ((left as i32 + x).try_into(), (top as i32 + y).try_into())
                && let Some(pixel) = self.0.get_pixel_mut_checked(x, y)
            {
                *pixel = INK;
            }
        }
    }
}
