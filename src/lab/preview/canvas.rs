//! The canvas on which every sheet is drawn, and the scaling of pictures.

use embedded_graphics::text::Baseline;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use crate::page::letters::{self, Face, letter_dots};

/// Space around tiles, px.
pub const GAP: u32 = 6;
/// Space between the pictures of a tile, px.
pub const SEAM: u32 = 2;
/// Height of a line of text, px.
pub const CAPTION: u32 = 18;
/// Width of a letter, px.
pub const LETTER: u32 = 7;
/// Colour of the background.
pub const PAPER: Rgb<u8> = Rgb([24, 24, 26]);
/// Colour of text.
pub const INK: Rgb<u8> = Rgb([225, 225, 225]);
/// Colour of lines around what may be as dark as the background.
pub const EDGE: Rgb<u8> = Rgb([110, 110, 114]);

/// A sheet that is being drawn.
pub struct Canvas(pub RgbImage);

impl Canvas {
    /// Creates an empty canvas.
    pub fn new(width: u32, height: u32) -> Self {
        Self(RgbImage::from_pixel(width, height, PAPER))
    }

    /// Draws a picture with its top left corner at a place.
    pub fn draw_panel(&mut self, panel: &RgbImage, [left, top]: [u32; 2]) {
        imageops::replace(&mut self.0, panel, i64::from(left), i64::from(top));
    }

    /// Sets a pixel, if it is on the sheet.
    pub fn set_pixel(&mut self, [x, y]: [u32; 2], colour: Rgb<u8>) {
        if let Some(pixel) = self.0.get_pixel_mut_checked(x, y) {
            *pixel = colour;
        }
    }

    /// Writes a line of text into `room` px. Text that does not fit ends in dots.
    pub fn write_text(&mut self, text: &str, [left, top]: [u32; 2], room: u32) {
        let text = letters::truncate_text(text, (room / LETTER) as usize);
        for [x, y] in letter_dots(&text, Face::Small, Baseline::Top) {
            if let (Ok(x), Ok(y)) = ((left as i32 + x).try_into(), (top as i32 + y).try_into()) {
                self.set_pixel([x, y], INK);
            }
        }
    }
}

/// Width of a line of text, px.
pub fn text_width(text: &str) -> u32 {
    LETTER * letters::count_letters(text) as u32
}

/// Scales pictures to at most `width` px.
pub fn scale_panels(panels: &[RgbImage], width: u32) -> Vec<RgbImage> {
    panels.iter().map(|panel| shrink_panel(panel, width)).collect()
}

/// Scales a picture to at most `width` px, in proportion. Never enlarges it.
pub fn shrink_panel(panel: &RgbImage, width: u32) -> RgbImage {
    if panel.width() > width {
        let height = (u64::from(panel.height()) * u64::from(width)).div_ceil(u64::from(panel.width()));
        imageops::resize(panel, width, height as u32, FilterType::Triangle)
    } else {
        panel.clone()
    }
}

/// Joins rows of pictures into one picture, close to each other.
pub fn join_panels(rows: &[Vec<RgbImage>]) -> RgbImage {
    let beside = |row: &Vec<RgbImage>| row.iter().map(|panel| panel.width() + SEAM).sum::<u32>();
    let high = |row: &Vec<RgbImage>| row.iter().map(RgbImage::height).max().unwrap_or(0);
    let width = rows.iter().map(beside).max().unwrap_or(0).saturating_sub(SEAM).max(1);
    let height = rows.iter().map(|row| high(row) + SEAM).sum::<u32>().saturating_sub(SEAM).max(1);
    let mut canvas = Canvas::new(width, height);
    let mut top = 0;
    for row in rows {
        let mut left = 0;
        for panel in row {
            canvas.draw_panel(panel, [left, top]);
            left += panel.width() + SEAM;
        }
        top += high(row) + SEAM;
    }
    canvas.0
}

/// Returns the difference `to - from`, times `gain`, around grey. Both must be of one size.
pub fn amplify_difference(from: &RgbImage, to: &RgbImage, gain: i32) -> RgbImage {
    let mut difference = RgbImage::new(from.width(), from.height());
    for ((value, from), to) in difference.iter_mut().zip(from.iter()).zip(to.iter()) {
        *value = (128 + gain * (i32::from(*to) - i32::from(*from))).clamp(0, 255) as u8;
    }
    difference
}
