//! What every sheet is drawn on, and how pictures come to their size.

use embedded_graphics::text::Baseline;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use crate::page::letters::{self, Face, dots};

/// Room around tiles, px.
pub const GAP: u32 = 6;
/// Room between the panels of a tile, px.
pub const SEAM: u32 = 2;
/// Height of a line of text, px.
pub const CAPTION: u32 = 18;
/// Width of a letter, px.
pub const LETTER: u32 = 7;
/// What is under everything.
pub const PAPER: Rgb<u8> = Rgb([24, 24, 26]);
/// Text.
pub const INK: Rgb<u8> = Rgb([225, 225, 225]);
/// Lines around what may be as dark as paper.
pub const EDGE: Rgb<u8> = Rgb([110, 110, 114]);

/// A sheet being drawn.
pub struct Canvas(pub RgbImage);

impl Canvas {
    /// A bare one.
    pub fn new(width: u32, height: u32) -> Self {
        Self(RgbImage::from_pixel(width, height, PAPER))
    }

    /// Lays a picture down.
    pub fn place(&mut self, panel: &RgbImage, [left, top]: [u32; 2]) {
        imageops::replace(&mut self.0, panel, i64::from(left), i64::from(top));
    }

    /// Sets a pixel, if it is on the sheet.
    pub fn set(&mut self, [x, y]: [u32; 2], colour: Rgb<u8>) {
        if let Some(pixel) = self.0.get_pixel_mut_checked(x, y) {
            *pixel = colour;
        }
    }

    /// Writes a line of text into `room` px; what does not fit ends in dots.
    pub fn write(&mut self, text: &str, [left, top]: [u32; 2], room: u32) {
        let text = letters::fitted(text, (room / LETTER) as usize);
        for [x, y] in dots(&text, Face::Small, Baseline::Top) {
            if let (Ok(x), Ok(y)) = ((left as i32 + x).try_into(), (top as i32 + y).try_into()) {
                self.set([x, y], INK);
            }
        }
    }
}

/// Width of a line of text, px.
pub fn width(text: &str) -> u32 {
    LETTER * letters::count(text) as u32
}

/// Pictures made `width` px wide at the most.
pub fn scaled(panels: &[RgbImage], width: u32) -> Vec<RgbImage> {
    panels.iter().map(|panel| shrunk(panel, width)).collect()
}

/// A picture made `width` px wide at the most.
pub fn shrunk(panel: &RgbImage, width: u32) -> RgbImage {
    if panel.width() > width {
        let height = (u64::from(panel.height()) * u64::from(width)).div_ceil(u64::from(panel.width()));
        imageops::resize(panel, width, height as u32, FilterType::Triangle)
    } else {
        panel.clone()
    }
}

/// Rows of pictures, close to each other.
pub fn joined(rows: &[Vec<RgbImage>]) -> RgbImage {
    let beside = |row: &Vec<RgbImage>| row.iter().map(|panel| panel.width() + SEAM).sum::<u32>();
    let high = |row: &Vec<RgbImage>| row.iter().map(RgbImage::height).max().unwrap_or(0);
    let width = rows.iter().map(beside).max().unwrap_or(0).saturating_sub(SEAM).max(1);
    let height = rows.iter().map(|row| high(row) + SEAM).sum::<u32>().saturating_sub(SEAM).max(1);
    let mut canvas = Canvas::new(width, height);
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for panel in row {
            canvas.place(panel, [left, top]);
            left += panel.width() + SEAM;
        }
        top += high(row) + SEAM;
    }
    canvas.0
}

/// `to` less `from`, times `gain`, around grey. Both are of one size.
pub fn difference(from: &RgbImage, to: &RgbImage, gain: i32) -> RgbImage {
    let mut difference = RgbImage::new(from.width(), from.height());
    for ((value, from), to) in difference.iter_mut().zip(from.iter()).zip(to.iter()) {
        *value = (128 + gain * (i32::from(*to) - i32::from(*from))).clamp(0, 255) as u8;
    }
    difference
}
