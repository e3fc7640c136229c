//! Textures without height, of huge height, finer than any pixel and coarser than any view; prints of too many dots.

use std::io::Cursor;
use std::sync::LazyLock;

use super::case::{Case, Touches, run};
use crate::cases::check_cases;

fn textured(name: &'static str, trouble: &'static str, amplitude_mm: &str, scale_mm: &str) -> Case {
    Case::new(name, trouble).set(format!("texture = {{ amplitude_mm = {amplitude_mm}, scale_mm = {scale_mm} }}"))
}

fn heights(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = image::GrayImage::from_fn(width, height, |x, y| image::Luma([(97 * (x + 3 * y) % 256) as u8]));
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("an image");
    bytes.into_inner()
}

pub static CASES: LazyLock<Vec<Case>> = LazyLock::new(cases);

fn cases() -> Vec<Case> {
    let patterns = ["noise", "brushed", "knurled", "woven", "dimples"];
    let fine = ["sub-pixel noise", "sub-pixel brushed", "sub-pixel knurled", "sub-pixel woven", "sub-pixel dimples"];
    let deep = ["deep noise", "deep brushed", "deep knurled", "deep woven", "deep dimples"];
    let mut cases = vec![
        textured("a texture of amplitude 0", "another picture than without", "0.0", "0.5"),
        textured("a texture of 1e-300 mm", "a product that underflows", "1e-300", "0.5"),
        textured("a texture deeper than the pad", "heights below the pad's shell", "10.0", "2.0")
            .touches(Touches::None),
        textured("a texture of scale 1e-3 mm", "a tile of a thousandth of a pixel", "0.1", "1e-3"),
        textured("a texture of scale 1 m", "a view in one texel", "0.1", "1e3"),
        textured("a texture of scale 0", "a division by 0", "0.1", "0.0")
            .refused("scale_mm may be 0, which is out of range"),
        textured("a texture of 11 mm", "the same", "11.0", "0.5")
            .refused("amplitude_mm may be 11, which is out of range"),
        textured("a texture of one pixel", "a tile without slope", "0.3", "1.0")
            .set("texture.patterns = [{ image = { path = 'FOLDER/one.png' } }]")
            .file("one.png", heights(1, 1)),
        textured("a texture of 2 x 501 px", "a tile of another shape than its pattern", "0.3", "1.0")
            .set("texture.patterns = [{ image = { path = 'FOLDER/slim.png' } }]")
            .file("slim.png", heights(2, 501)),
        Case::new("four million dots", "minutes for a sample")
            .set("markers = { pitch_mm = 0.05, jitter_mm = 100.0 }")
            .refused("dots on the view and around it"),
        Case::new("dots over dots", "the same")
            .set("markers = { pitch_mm = 1.0, diameter_mm = 100.0 }")
            .refused("lie over each other"),
        Case::new("dots without size or edge", "a division by the edge")
            .set("markers = { diameter_mm = 0.0, edge_mm = 0.0 }"),
        textured("no pattern", "a choice from nothing", "0.3", "1.0")
            .set("texture.patterns = []")
            .refused("no pattern to choose from"),
    ];
    for (k, pattern) in patterns.into_iter().enumerate() {
        let of = |case: Case| case.set(format!("texture.patterns = ['{pattern}']"));
        cases.push(of(textured(fine[k], "aliasing; a blur of many texels", "0.5", "0.01")));
        // Between the peaks of a knurl a pixel's centre finds nothing.
        let touches = if pattern == "knurled" { Touches::None } else { Touches::All };
        cases.push(of(textured(deep[k], "steps of the pad's thickness", "10.0", "1.0").depth(2.9).touches(touches)));
    }
    cases
}

/// Every texture gives a sound sample, or is refused.
#[test]
fn sound() {
    check_cases(&CASES, |case| case.name, run);
}
