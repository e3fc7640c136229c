//! LEDs, surfaces and backgrounds at the ends of their ranges, under both models of the light.

use std::io::Cursor;
use std::sync::LazyLock;

use gelsim_core::base::rng::random_stream;
use gelsim_core::optics::calibrated::response::{CalibrationResponse, INPUTS, OUTPUTS};
use gelsim_dataset::encode::to_json_line;
use gelsim_lab::calibrate::{Geometry, build_table};

use super::case::{Case, Dress, run};
use crate::cases::check_cases;
use gelsim_oracle::shapes::Shape;

fn photograph(width: u32, height: u32, level: u8) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = image::RgbImage::from_pixel(width, height, image::Rgb([level; 3]));
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("an image");
    bytes.into_inner()
}

/// A case with these LEDs.
fn leds(name: &'static str, trouble: &'static str, leds: &str) -> Case {
    Case::new(name, trouble).set(format!("sensor.led = [{leds}]"))
}

fn photo(name: &'static str, trouble: &'static str, bytes: Vec<u8>) -> Case {
    Case::new(name, trouble).file("rest.png", bytes).set("sensor.background = 'FOLDER/rest.png'")
}

/// A case with calibrated light, as strong as LEDs have it; the dress with near LEDs wears those instead.
fn calibrated(name: &'static str, trouble: &'static str) -> Case {
    let mut random = random_stream(4, "calibration", 0);
    let mut weight = || (0.1 * random.standard_normal()) as f32;
    let hidden: Vec<_> = (0..8).map(|_| std::array::from_fn(|_| weight())).collect();
    let outputs = (0..OUTPUTS).map(|_| (0..hidden.len() + INPUTS + 1).map(|_| weight()).collect()).collect();
    let response =
        CalibrationResponse { height_mm: 0.5, place_mm: 9.6, heights_mm: [-0.1, 0.6], steepest: 0.7, hidden, outputs };
    let table = build_table(response, Geometry { thickness_mm: 3.0, contact_over_disc: 0.95 });
    Case::new(name, trouble).file("table.json", to_json_line(&table)).set("sensor.calibration = 'FOLDER/table.json'")
}

/// A case with near LEDs before a window, over a white coat.
fn near(name: &'static str, trouble: &'static str, tables: &str) -> Case {
    leds(name, trouble, tables)
        .set("sensor.window = { distance_mm = 8.0, refractive_index = 3.0 }")
        .set("sensor.coat.albedo = 1.0")
}

/// The case with walls; its normals are asked for.
const WALL: &str = "normals at 89.999 degrees";

pub static CASES: LazyLock<Vec<Case>> = LazyLock::new(cases);

fn cases() -> Vec<Case> {
    let shiny = |name, shininess: &str| {
        Case::new(name, "0 to the power of 0; a power that underflows")
            .set(format!("optics.MODEL.shininess = {shininess}"))
    };
    let strong = "optics.MODEL = { diffuse = 10.0, specular = 10.0 }";
    vec![
        leds("an LED at the horizon", "a flat pad without light, shadows without end", "{ elevation_deg = 0.0 }"),
        leds("a point at the horizon", "shadows of one ray", "{ elevation_deg = 0.0, angular_size_deg = [0.0, 0.0] }"),
        leds(
            "an LED in the pad's plane, on a pixel's centre",
            "a distance of 0",
            "{ elevation_deg = 0.0, distance_mm = 4.0 }, { azimuth_deg = 90.0, elevation_deg = 0.0, distance_mm = 2.0 }",
        )
        .view([49, 37], [0.4; 2]),
        leds("an LED 0.01 mm away", "a brightness that falls with the square of nothing", "{ distance_mm = 0.01 }"),
        leds("an LED 1 km away", "the square of its distance", "{ distance_mm = 1e6 }"),
        leds("an LED below the horizon", "light through the shell", "{ elevation_deg = -5.0 }")
            .refused("elevation_deg = -5 is out of range"),
        leds("an LED at the zenith", "an azimuth of nothing", "{ elevation_deg = 90.0, angular_size_deg = [90.0, 90.0] }"),
        near("rows in the window", "total reflection", "{ position_mm = [0.0, -9.0, -4.0], size_mm = [12.0, 1.0], lobe = 1.0 }"),
        near("a row of nothing at the coat", "points in one place", "{ position_mm = [0.0, -9.0, -1e-3], size_mm = [0.0, 0.0], lobe = 100.0 }"),
        near("a row over the pad", "an LED under the press", "{ position_mm = [0.0, 0.0, -0.5], size_mm = [1000.0, 0.0] }"),
        near("an LED on the pad", "light from the plane", "{ position_mm = [3.0, 0.0, 0.0] }")
            .refused("the LED is not on the camera's side of the pad"),
        near("an LED beyond the window", "an image before it", "{ position_mm = [3.0, 0.0, -8.0] }")
            .refused("beyond the window at 8 mm"),
        Case::new(WALL, "overflow of a squared slope")
            .view([48, 36], [1e-3; 2])
            .pad(1000.0, 0.48)
            .depth(500.0)
            .shape(Shape::brick([-0.0101, -0.0101, 0.0], [0.0101, 0.0101, 800.0])),
        shiny("shininess 0", "0.0"),
        shiny("shininess 0.5", "0.5"),
        shiny("shininess 1", "1.0"),
        shiny("shininess 1000", "1000.0"),
        shiny("shininess 1001", "1001.0").refused("shininess = 1001 is out of range"),
        Case::new("literal light", "an untouched pad that is not the background").set("optics.MODEL.equation = 'literal'"),
        leds("LEDs without light", "a share of nothing", "{ intensity = 0.0 }, { intensity = 0.0 }"),
        leds("LEDs a hundred times as bright", "light far over white", "{ intensity = 100.0 }, { azimuth_deg = 90.0, intensity = 100.0 }")
            .set(strong),
        leds("LEDs too bright", "the same", "{ intensity = 1e9 }").refused("intensity = 1000000000 is out of range"),
        Case::new("a black rendered background", "light below 0")
            .set("sensor.rendered_background = { color = [0.0, 0.0, 0.0], glow = 0.0, grain = 1.0 }")
            .set(strong),
        Case::new("a saturated rendered background", "light over white")
            .set("sensor.rendered_background = { color = [1.0, 1.0, 1.0], glow = 10.0, grain = 1.0 }")
            .set(strong),
        calibrated("a ball in calibrated light", "a pad that is not flat where it should be"),
        calibrated("walls in calibrated light", "slopes and heights that nothing was learnt from")
            .depth(2.5)
            .shape(Shape::brick([-3.0, -2.0, 0.0], [2.0, 3.0, 8.0])),
        calibrated("a corner in calibrated light", "places beyond the view")
            .shape(Shape::brick([5.0, 4.0, 0.0], [60.0, 50.0, 8.0])),
        calibrated("a pixel of calibrated light", "a grid of nothing").view([1, 1], [0.4; 2]),
        calibrated("half a table", "a reader that panics").file("table.json", b"{\"calibration_version\": 1".to_vec())
            .refused("no table of `gelsim calibrate`"),
        photo("a black photograph", "light below 0", photograph(48, 36, 0)).set(strong),
        photo("a white photograph", "light over white", photograph(48, 36, 255)).set(strong),
        photo("a photograph of 7 x 5 px", "reads beyond it", photograph(7, 5, 120)),
        photo("a photograph of 1 x 1 px", "reads beyond it", photograph(1, 1, 120)),
        photo("a photograph of 900 x 700 px", "reads beyond it", photograph(900, 700, 120)),
        photo("a photograph that is none", "a decoder that panics", b"not a picture".to_vec()).refused("cannot read the background"),
    ]
}

/// Every light gives a sound sample, or is refused.
#[test]
fn sound() {
    check_cases(&CASES, |case| case.name, run);
}

/// Mean brightness of the untouched pad under LEDs of this intensity.
fn untouched(intensity: f64) -> f64 {
    let dim = Case::new("untouched", "").set("sensor.rendered_background.glow = 10.0");
    let leds = [0.0, 90.0, 180.0].map(|azimuth| format!("{{ azimuth_deg = {azimuth:?}, intensity = {intensity:?} }}"));
    let plan = dim.set(format!("sensor.led = [{}]", leds.join(", "))).plan(Dress::Plain).expect("a plain job");
    let rgb = &plan.simulator.untouched().rgb;
    rgb.iter().map(|value| f64::from(*value)).sum::<f64>() / rgb.len() as f64
}

#[test]
fn brighter_leds_never_darken_the_untouched_pad() {
    let levels = [0.0, 0.05, 0.2, 1.0, 10.0, 100.0].map(untouched);
    println!("untouched pad under ever brighter LEDs: mean grey level {levels:.1?}");
    assert!(levels.is_sorted() && levels[5] > levels[0] + 50.0, "{levels:?}");
}

#[test]
fn the_steepest_walls_have_normals_of_89_999_degrees() {
    let wall = CASES.iter().find(|case| case.name == WALL).expect("the case with walls");
    let steepest = run(wall).steepest_deg;
    assert!(steepest >= 89.999, "{steepest} degrees");
}
