//! Contacts that are none, tiny, everywhere, deep or rough; views and pads of extreme size.

use std::sync::LazyLock;

use super::case::{Case, Extent, Touches, run};
use crate::cases::check_cases;
use gelsim_oracle::shapes::{Random, Shape};

const PX: [u32; 2] = [48, 36];
const PITCH: [f64; 2] = [0.4; 2];
/// Pixels around the view that the pad's models look at, and some more.
const MARGIN: i32 = 16;

fn tiles(height: impl Fn(i32, i32) -> Option<f64>) -> Shape {
    Shape::tiles(PX, PITCH, MARGIN, height)
}

/// A number per pixel, 0 to 1, that has nothing to do with its neighbours'.
fn noise(i: i32, j: i32) -> f64 {
    Random(((i as u64) << 32) ^ (j as u64 & 0xffff_ffff)).unit()
}

pub static CASES: LazyLock<Vec<Case>> = LazyLock::new(cases);

fn cases() -> Vec<Case> {
    let wide = Shape::plate(60.0, 60.0);
    let islands = [(-6.0, -4.0), (6.0, -4.0), (0.0, 0.0), (-6.0, 4.0), (6.0, 4.0)]
        .map(|(x, y)| Shape::ball(1.5, 24, 12).moved([x, y, 0.0]))
        .into_iter()
        .fold(Shape::default(), Shape::and);
    let ring = tiles(|i, j| {
        let away = (f64::from(i) - 23.5).hypot(f64::from(j) - 17.5);
        (6.0..8.0).contains(&away).then_some(0.0)
    });
    // A needle's cross-section is a tenth of a pixel.
    let needle = |x: f64, y: f64| {
        let tip = [[-0.02, -0.02, 1.0], [0.02, -0.02, 1.0], [0.0, 0.02, 1.0]];
        let sides = (0..3).map(|k| [[0.0, 0.0, 0.0], tip[k], tip[(k + 1) % 3]]);
        Shape::soup(sides.chain([tip])).moved([x, y, 0.0])
    };
    let checker = |i: i32, j: i32| (i + j).rem_euclid(2) == 0;
    vec![
        Case::new("no contact", "a picture that differs from the untouched pad's")
            .set("indentation.no_contact = 1.0")
            .touches(Touches::None),
        Case::new("an object beside the view", "pixels of nothing").set("pose.x_mm = 500.0").touches(Touches::None),
        Case::new("grazing by 0.1 um", "a press smaller than the solver's tolerance")
            .shape(Shape::cap(4000.0, 8.0))
            .depth(1e-4)
            .touches(Touches::Some),
        Case::new("grazing by 0.1 um with a plate", "the same")
            .shape(Shape::plate(6.0, 5.0))
            .depth(1e-4)
            .touches(Touches::Some),
        Case::new("one pixel", "a contact of one unknown; pixels between the solver's")
            .shape(tiles(|i, j| ((i, j) == (24, 18)).then_some(0.0))),
        Case::new("one pixel in a corner", "reads and slopes beyond the border")
            .shape(tiles(|i, j| ((i, j) == (0, 0)).then_some(0.0))),
        Case::new("along the border", "a contact half of which is out of view")
            .shape(tiles(|_, j| (-3..1).contains(&j).then_some(0.0))),
        Case::new("just beyond the border", "pressure of which no pixel is in view")
            .shape(tiles(|i, j| ((-3..0).contains(&i) && (10..20).contains(&j)).then_some(0.0)))
            .touches(Touches::None),
        Case::new("the whole window, incompressible", "a layer that cannot give way, response near 0")
            .shape(wide.clone())
            .pad(3.0, 0.4999)
            .depth(0.3),
        Case::new("the whole window, compressible", "pressure without gradient")
            .shape(wide.clone())
            .pad(3.0, 0.0)
            .depth(0.3),
        Case::new("five islands", "a box around all of them").shape(islands),
        Case::new("a needle on a pixel's centre", "a peak of pressure").shape(needle(0.2, 0.2)),
        Case::new("a needle between pixels", "an object that no pixel sees")
            .shape(needle(0.0, 0.0))
            .touches(Touches::None),
        Case::new("a plate tilted by 0.01 degrees", "a contact whose edge is decided by 0.1 um")
            .shape(wide.clone())
            .set("pose.tilt_deg = 0.01")
            .depth(0.008),
        Case::new("pixel noise", "a contact of single pixels").shape(tiles(|i, j| Some(0.6 * noise(i, j)))),
        Case::new("checkerboard", "the highest frequency there is").shape(tiles(|i, j| checker(i, j).then_some(0.0))),
        Case::new("stripes one pixel wide", "the highest frequency along one axis")
            .shape(tiles(|i, _| (i.rem_euclid(2) == 0).then_some(0.0))),
        Case::new("a plate with holes of a pixel", "an incompressible pad that is squeezed through them")
            .shape(tiles(|i, j| (i.rem_euclid(4) != 0 || j.rem_euclid(4) != 0).then_some(0.0)))
            .pad(0.5, 0.4999)
            .depth(0.3),
        Case::new("an annulus", "the highest bulge, in its middle").shape(ring.clone()),
        Case::new("an incompressible annulus", "the same where nothing can give way")
            .shape(ring)
            .pad(3.0, 0.4999)
            .depth(1.5),
        Case::new("a ball to 99 % of the pad", "a surface beyond the shell").depth(2.97),
        Case::new("a plate to 99 % of the pad", "a surface beyond the shell")
            .shape(Shape::plate(8.0, 6.0))
            .depth(2.97)
            .pad(3.0, 0.4999),
        Case::new("noise to 99 % of the pad", "slopes of the pad's thickness from pixel to pixel")
            .shape(tiles(|i, j| Some(2.9 * noise(i, j))))
            .depth(2.97),
        Case::new("a pad of 0.05 mm", "pixels much larger than the layer")
            .pad(0.05, 0.4999)
            .shape(Shape::cap(4.0, 4.0))
            .depth(0.02),
        Case::new("a pad of 1 m", "pixels and margin much smaller than the layer").pad(1000.0, 0.48).depth(0.6),
        Case::new("pixels of 1 um", "lengths near the tolerance")
            .view(PX, [1e-3; 2])
            .shape(Shape::cap(0.02, 0.02))
            .depth(0.004),
        Case::new("pixels of 10 mm", "a pad thinner than a pixel")
            .view([16, 12], [10.0; 2])
            .shape(Shape::cap(100.0, 50.0))
            .depth(2.0),
        Case::new("pixels of 0.05 x 1 mm", "pitches taken for each other").view(PX, [0.05, 1.0]).depth(0.5),
        Case::new("pixels of 1 x 0.05 mm", "pitches taken for each other").view(PX, [1.0, 0.05]).depth(0.5),
        Case::new("a plate with one hole", "an incompressible pad that has nowhere else to go")
            .shape(tiles(|i, j| ((i - 24).abs() > 1 || (j - 18).abs() > 1).then_some(0.0)))
            .pad(3.0, 0.4999)
            .depth(1.0),
        Case::new("a plate with one hole, to 99 %", "the same, beyond what the theory holds for")
            .shape(tiles(|i, j| ((i - 24).abs() > 1 || (j - 18).abs() > 1).then_some(0.0)))
            .pad(3.0, 0.4999)
            .depth(2.97),
        Case::new("pixels of 10 x 0.01 mm", "frequencies by the million")
            .view([8, 64], [10.0, 0.01])
            .shape(Shape::cap(400.0, 40.0))
            .depth(0.5)
            .pad(3.0, 0.4999),
        Case::new("pixels of 100 x 0.01 mm", "the same")
            .view([8, 64], [100.0, 0.01])
            .refused("10000 times as long as wide"),
        Case::new("a depth of 0", "a division by the depth").depth(0.0).touches(Touches::None),
        Case::new("a depth of 1e-300 mm", "what is 0 in 32 bits").depth(1e-300).touches(Touches::None),
        Case::new("the stiffest pad", "pressures beyond 16 bits").set("sensor.gelpad_youngs_modulus_kpa = 1e9"),
        Case::new("the softest pad", "pressures near 0").set("sensor.gelpad_youngs_modulus_kpa = 1e-3"),
        Case::new("one iteration", "a solver that gives up without a word")
            .set("gelpad.elastic = { max_iterations = 1, tolerance_um = 0.01 }")
            .unsolved(),
        Case::new("noise in one iteration", "the same where every pixel matters")
            .shape(tiles(|i, j| Some(2.9 * noise(i, j))))
            .depth(2.97)
            .set("gelpad.elastic = { max_iterations = 1, tolerance_um = 0.01 }")
            .unsolved(),
        Case::new("pressed flat to the shell", "a layer without thickness")
            .depth(3.0)
            .refused("and the gelpad is as thick as 3 mm"),
        Case::new("an exactly incompressible pad", "a response of 0")
            .pad(3.0, 0.5)
            .refused("gelpad_poisson_ratio = 0.5 is out of range"),
    ]
}

/// A ball in proportion to a view.
fn grid(name: &'static str, px: [u32; 2]) -> Case {
    Case::new(name, "windows, lattices and transforms of odd sizes").view(px, [0.3, 0.3]).depth(0.5)
}

pub static GRIDS: LazyLock<Vec<Case>> = LazyLock::new(grids);

fn grids() -> Vec<Case> {
    vec![
        grid("1 x 1 px", [1, 1]),
        grid("2 x 1 px", [2, 1]),
        grid("1 x 2 px", [1, 2]),
        grid("3 x 5 px", [3, 5]),
        grid("1 x 640 px", [1, 640]),
        grid("37 x 41 px", [37, 41]),
        grid("127 x 113 px", [127, 113]),
        grid("8192 x 16 px", [8192, 16]).extent(Extent::Cheap),
        grid("8193 px", [8193, 16]).refused("resolution_px = 8193 is out of range"),
        grid("0 px", [0, 16]).refused("resolution_px = 0 is out of range"),
    ]
}

/// Every contact gives a sound sample.
#[test]
fn sound() {
    check_cases(&CASES, |case| case.name, run);
}

/// Every grid gives a sound sample.
#[test]
fn on_grids() {
    check_cases(&GRIDS, |case| case.name, run);
}
