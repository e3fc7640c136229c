//! Letters as dots of bitmap fonts: Latin, Greek and Cyrillic. Any other character is spelled by its number, so that
//! two names never look alike.

use std::collections::BTreeSet;
use std::convert::Infallible;

use embedded_graphics::Pixel;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::mapping::{self, StrGlyphMapping};
use embedded_graphics::mono_font::{
    MonoFont, MonoTextStyle, iso_8859_1, iso_8859_2, iso_8859_3, iso_8859_4, iso_8859_5, iso_8859_7, iso_8859_14,
    iso_8859_15, iso_8859_16,
};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{DrawTarget, Drawable};
use embedded_graphics::text::{Baseline, Text};

use gelsim_files::spelling::is_hidden_char;

/// Size and weight of letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Face {
    /// 7 dots wide, 13 high.
    Small,
    /// 9 dots wide, 15 high.
    Plain,
    /// 9 dots wide, 15 high, bold.
    Bold,
}

/// The letters of an alphabet, and the fonts that draw them in each [`Face`].
type Alphabet = (StrGlyphMapping<'static>, [&'static MonoFont<'static>; 3]);

macro_rules! alphabet {
    ($letters:ident, $fonts:ident) => {
        (mapping::$letters, [&$fonts::FONT_7X13, &$fonts::FONT_9X15, &$fonts::FONT_9X15_BOLD])
    };
}

/// Alphabets in the order in which they are tried: the first that has a letter draws it.
const ALPHABETS: [Alphabet; 9] = [
    alphabet!(ISO_8859_1, iso_8859_1),
    alphabet!(ISO_8859_2, iso_8859_2),
    alphabet!(ISO_8859_5, iso_8859_5),
    alphabet!(ISO_8859_7, iso_8859_7),
    alphabet!(ISO_8859_3, iso_8859_3),
    alphabet!(ISO_8859_4, iso_8859_4),
    alphabet!(ISO_8859_14, iso_8859_14),
    alphabet!(ISO_8859_15, iso_8859_15),
    alphabet!(ISO_8859_16, iso_8859_16),
];

/// Returns the font that has a letter; `None` if no alphabet has it or it would not be seen.
fn find_font(letter: char, face: Face) -> Option<&'static MonoFont<'static>> {
    let (_, fonts) = ALPHABETS.iter().find(|(letters, _)| letters.contains(letter) && !is_hidden_char(letter))?;
    Some(fonts[face as usize])
}

impl Face {
    /// Width of each letter, dots.
    pub fn width(self) -> u32 {
        iso_8859_1_font(self).character_size.width
    }
}

fn iso_8859_1_font(face: Face) -> &'static MonoFont<'static> {
    ALPHABETS[0].1[face as usize]
}

/// Spells a character in letters that can be drawn: itself, a space for white space, else its number.
fn spell_character(c: char) -> String {
    match c {
        c if c.is_whitespace() => String::from(' '),
        c if find_font(c, Face::Small).is_some() => String::from(c),
        c => format!("U+{:04X}", u32::from(c)),
    }
}

/// Returns how many letters a text takes.
pub fn count_letters(text: &str) -> usize {
    text.chars().map(|c| spell_character(c).chars().count()).sum()
}

/// Returns `text`, its end replaced by dots if it takes more than `most` letters.
pub fn truncate_text(text: &str, most: usize) -> String {
    if count_letters(text) <= most {
        return text.to_owned();
    }
    let mut left = most.saturating_sub(3);
    let kept = text.chars().take_while(|c| {
        let needed = spell_character(*c).chars().count();
        let fits = needed <= left;
        left -= if fits { needed } else { left };
        fits
    });
    kept.chain("...".chars().take(most)).collect()
}

/// Returns the dots of a line of text: columns from its start, rows down from `baseline`.
pub fn letter_dots(text: &str, face: Face, baseline: Baseline) -> BTreeSet<[i32; 2]> {
    let mut dots = Dots(BTreeSet::new());
    let text: String = text.chars().map(spell_character).collect();
    for (letter, left) in text.chars().zip((0..).step_by(face.width() as usize)) {
        let style = MonoTextStyle::new(find_font(letter, face).unwrap_or(iso_8859_1_font(face)), BinaryColor::On);
        let mut bytes = [0; 4];
        let drawn = Text::with_baseline(letter.encode_utf8(&mut bytes), Point::new(left, 0), style, baseline);
        let Ok(_) = drawn.draw(&mut dots);
    }
    dots.0
}

/// A drawing target that collects the dots which are set.
struct Dots(BTreeSet<[i32; 2]>);

impl OriginDimensions for Dots {
    fn size(&self) -> Size {
        Size::new(u32::MAX, u32::MAX)
    }
}

impl DrawTarget for Dots {
    type Color = BinaryColor;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        self.0.extend(pixels.into_iter().map(|Pixel(at, _)| [at.x, at.y]));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(text: &str) -> BTreeSet<[i32; 2]> {
        letter_dots(text, Face::Small, Baseline::Top)
    }

    #[test]
    fn letters_of_europe_are_drawn_and_others_are_spelled_by_their_number() {
        let question = drawn("?");
        for letter in "aZ9 _-äøµßłŠőğıŵ€șЖяΩλ".chars() {
            assert!(drawn(&letter.to_string()) != question, "{letter}");
            assert_eq!(count_letters(&letter.to_string()), 1, "{letter}");
            for face in [Face::Plain, Face::Bold] {
                let plain = letter_dots(&letter.to_string(), face, Baseline::Alphabetic);
                assert!(letter == ' ' || plain != letter_dots("?", face, Baseline::Alphabetic), "{letter}");
            }
        }
        assert!(drawn("a b") == drawn("a\tb") && drawn(" ").is_empty());
        assert_eq!(drawn("球"), drawn("U+7403"));
        assert_eq!(drawn("a\u{202e}b"), drawn("aU+202Eb"));
        assert!(drawn("球") != drawn("箱"));
    }

    #[test]
    fn what_does_not_fit_ends_in_dots() {
        assert_eq!(truncate_text("hex nut", 7), "hex nut");
        assert_eq!(truncate_text("hex nuts", 7), "hex ...");
        assert_eq!(truncate_text("球球", 12), "球球");
        assert_eq!(truncate_text("球球", 11), "球...");
        assert_eq!(truncate_text("hex", 2), "..");
        assert_eq!(truncate_text("hex", 0), "");
    }
}
