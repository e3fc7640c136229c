//! Textures without height, of huge height, finer than any pixel and coarser than any view; prints of too many dots.

use std::io::Cursor;
use std::sync::LazyLock;

use super::case::{Case, Touches};

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
mod sound {
    use super::CASES;
    use crate::stability::case::run_named;

    tests_of_cases! {
        |name| run_named(&CASES, name), CASES.iter().map(|case| case.name);
        a_texture_of_amplitude_0,
        a_texture_of_1e_300_mm,
        a_texture_deeper_than_the_pad,
        a_texture_of_scale_1e_3_mm,
        a_texture_of_scale_1_m,
        a_texture_of_scale_0,
        a_texture_of_11_mm,
        a_texture_of_one_pixel,
        a_texture_of_2_x_501_px,
        four_million_dots,
        dots_over_dots,
        dots_without_size_or_edge,
        no_pattern,
        sub_pixel_noise,
        deep_noise,
        sub_pixel_brushed,
        deep_brushed,
        sub_pixel_knurled,
        deep_knurled,
        sub_pixel_woven,
        deep_woven,
        sub_pixel_dimples,
        deep_dimples,
    }
}
