//! Contact sheets: tactile image, depth and contact of some samples, of a grip those of both fingers, with class and depth
//! written under each.

use embedded_graphics::mono_font::ascii as fonts;
use embedded_graphics::text::Baseline;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use crate::core::base::grid::Grid;
use crate::core::camera::Image;
use crate::dataset::archive::{Files, Member};
use crate::dataset::decode;
use crate::dataset::encode::{frame, make_shown};
use crate::dataset::labels::SampleLabel;
use crate::files::image_file;
use crate::job::gripper::label::GripLabel;
use crate::job::label::{Label, key};
use crate::job::plan::Plan;
use crate::job::sample::{Sample, shown};
use crate::job::steps::Steps;
use crate::lab::page::ink::dots;

pub mod effects;
pub mod rows;

/// One sample as a sheet shows it.
pub struct Tile {
    panels: Vec<RgbImage>,
    /// Which of them are tactile images.
    tactile: Vec<usize>,
    caption: String,
}

/// Frames of a sequence that a sheet shows, at most.
const FRAMES: usize = 6;

impl Tile {
    /// Renders sample `index` of a plan.
    pub fn rendered(plan: &Plan, index: u64) -> Self {
        if plan.job().sequence.is_some() || plan.job().gripper.is_some() {
            return Self::read(&sample_files(plan, index)).expect("files that were made just now");
        }
        let Sample { impression, label, .. } = shown(plan, index);
        let Image { width, height, .. } = impression.image;
        let mut tactile = RgbImage::new(width as u32, height as u32);
        tactile.copy_from_slice(&impression.image.rgb);
        let depth = Grid { width, height, data: impression.depth_mm() };
        let mask = Grid { width, height, data: impression.contact_mask() };
        let panels = panels(tactile, Some(&depth), Some(&mask));
        Self { panels, tactile: vec![0], caption: caption(&label) }
    }

    /// Shows a sample of a dataset from its files.
    pub fn read(files: &Files) -> Result<Self, String> {
        let named = |suffix: &str, reason: String| format!("{}.{suffix}: {reason}", files.key);
        let needed =
            |suffix: &str| files.member(suffix).ok_or_else(|| named(suffix, String::from("is not in the shard")));
        let label = SampleLabel::read(needed("json")?).map_err(|error| named("json", error))?;
        let summary = label.summary();
        if let Some((count, _)) = label.frames() {
            let shown = (count as usize).min(FRAMES);
            // The first, the last, and some between; of two fingers first those of the left one.
            let fingers: &[Option<&str>] =
                if label.sensors().len() > 1 { &[Some("left"), Some("right")] } else { &[None] };
            let mut panels = Vec::new();
            for finger in fingers {
                for k in 0..shown {
                    panels.push(tactile(files, k * (count as usize - 1) / (shown - 1).max(1), *finger)?);
                }
            }
            return Ok(Self { tactile: (0..panels.len()).collect(), panels, caption: caption(summary) });
        }
        if let SampleLabel::Grip(grip, _) = &label {
            let (mut both, mut tactile) = (Vec::new(), Vec::new());
            for (name, finger) in grip.fingers() {
                tactile.push(both.len());
                both.extend(Self::read_panels(&files.of_finger(name), &finger.png16)?);
            }
            return Ok(Self { panels: both, tactile, caption: grip_caption(grip) });
        }
        Ok(Self { panels: Self::read_panels(files, &summary.png16)?, tactile: vec![0], caption: caption(summary) })
    }

    /// The panels of one press, from its files.
    fn read_panels(files: &Files, steps: &Steps) -> Result<Vec<RgbImage>, String> {
        let named = |suffix: &str, reason: String| format!("{}.{suffix}: {reason}", files.key);
        let tactile = files.member("tactile.png").ok_or_else(|| String::from("is not in the shard"));
        let tactile = tactile.and_then(image_file::decode_rgb).map_err(|reason| named("tactile.png", reason))?;
        let depth = decode::depth_mm(files, steps)?;
        let contact = files.member("contact.png").map(image_file::decode_rgb).transpose();
        let contact = contact.map_err(|reason| named("contact.png", reason))?.map(|grey| Grid {
            width: grey.width() as usize,
            height: grey.height() as usize,
            data: grey.pixels().map(|pixel| pixel.0[0]).collect(),
        });
        Ok(panels(tactile, depth.as_ref(), contact.as_ref()))
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
        let tactile: Vec<RgbImage> = self.tactile.iter().map(|panel| self.panels[*panel].clone()).collect();
        beside(&scaled(&tactile, panel_width))
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

/// The files of a sample of a plan, made anew.
pub fn sample_files(plan: &Plan, index: u64) -> Files {
    let made = make_shown(plan, index);
    let file = |Member { suffix, bytes }| (suffix, bytes.into_vec().expect("nothing of it is spooled"));
    Files { key: key(index), members: made.members.into_iter().map(file).collect() }
}

/// The tactile image of a frame, of a gripper that of one finger.
fn tactile(files: &Files, number: usize, finger: Option<&str>) -> Result<RgbImage, String> {
    let finger = finger.map_or(String::new(), |finger| format!("{finger}."));
    let suffix = format!("{}.{finger}tactile.png", frame(number as u32));
    let png = files.member(&suffix).ok_or_else(|| format!("{}.{suffix}: is not in the shard", files.key))?;
    image_file::decode_rgb(png).map_err(|reason| format!("{}.{suffix}: {reason}", files.key))
}

/// The tactile image of a frame, of a gripper those of both fingers side by side.
fn film_frame(files: &Files, number: usize, both: bool) -> Result<RgbImage, String> {
    if !both {
        return tactile(files, number, None);
    }
    let panels = [tactile(files, number, Some("left"))?, tactile(files, number, Some("right"))?];
    Ok(beside(&panels))
}

/// All frames of a sequence as an animated PNG, at the speed at which they were taken.
pub fn animation(files: &Files) -> Result<Vec<u8>, String> {
    let label = files.member("json").ok_or_else(|| format!("{}.json: is not in the shard", files.key))?;
    let label = SampleLabel::read(label).map_err(|error| format!("{}.json: {error}", files.key))?;
    let Some((count, rate_hz)) = label.frames() else {
        return Err(format!("sample {} is no sequence: nothing else moves", files.key));
    };
    let both = label.sensors().len() > 1;
    let first = film_frame(files, 0, both)?;
    let mut bytes = Vec::new();
    let said = |error: ::png::EncodingError| error.to_string();
    let mut encoder = ::png::Encoder::new(&mut bytes, first.width(), first.height());
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_animated(count, 0).map_err(said)?;
    // A fraction of two whole numbers, as the format has it; slow and very fast ones in whole milliseconds.
    let (time, per_second) = match rate_hz {
        1.0..=600.0 => (100, (100.0 * rate_hz).round() as u16),
        _ => ((1e3 / rate_hz).round().clamp(1.0, 65_535.0) as u16, 1000),
    };
    encoder.set_frame_delay(time, per_second).map_err(said)?;
    let mut writer = encoder.write_header().map_err(said)?;
    for number in 0..count as usize {
        writer.write_image_data(&film_frame(files, number, both)?).map_err(said)?;
    }
    writer.finish().map_err(said)?;
    Ok(bytes)
}

fn caption(label: &Label) -> String {
    let depth = match label.contact.in_contact {
        true => format!("{:.2} mm", label.contact.max_depth_mm),
        false => String::from("no contact"),
    };
    let others = match label.objects.len() {
        0 | 1 => String::new(),
        count => format!(" and {} more", count - 1),
    };
    format!("{}{others}  {depth}  #{}", ascii(&label.object.class), label.index)
}

/// Left finger, right finger, and how they hold the object.
fn grip_caption(label: &GripLabel) -> String {
    let deep = label.fingers().map(|(_, finger)| finger.contact.max_depth_mm);
    let held = match label.fingers().iter().any(|(_, finger)| finger.contact.in_contact) {
        true => {
            let force = label.gripper.force_n.map_or(String::new(), |force| format!(" {force:.2} N"));
            format!("left {:.2} mm, right {:.2} mm{force}", deep[0], deep[1])
        }
        false => String::from("no contact"),
    };
    format!("{}  {held}  #{}", ascii(&label.object.class), label.index)
}

/// A name in the letters that the font has.
fn ascii(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_graphic() { c } else { '?' }).collect()
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
        for [x, y] in dots(&text, &fonts::FONT_7X13, Baseline::Top) {
            if let (Ok(x), Ok(y)) = ((left as i32 + x).try_into(), (top as i32 + y).try_into())
                && let Some(pixel) = self.0.get_pixel_mut_checked(x, y)
            {
                *pixel = INK;
            }
        }
    }
}
