//! The page of a calibration, of presses that the simulator makes: whole, and small enough for a browser.

use gelsim_lab::calibrate::page::{CalibrationPage, PressPanel};
use gelsim_lab::compare::score::score_images;
use image::{Rgb, RgbImage};

use super::synthetic::{plan, press};

#[test]
fn a_page_of_presses_is_complete() {
    let plan = plan("gelsight-mini", "x_mm = [-6.0, 6.0]\ny_mm = [-5.0, 5.0]", "[camera]\nread_noise_levels = 2.0\n");
    let presses: Vec<PressPanel> = (0..8)
        .map(|index| {
            let (real, _, circle) = press(&plan, index);
            // A simulation that is too dark in blue by a few levels, more for later presses.
            let mut simulated = real.clone();
            simulated.pixels_mut().for_each(|pixel| pixel.0[2] = pixel.0[2].saturating_sub(2 + 3 * index as u8));
            let scores = score_images(&real, &simulated, Some(&circle), 1.3);
            let outlier_reasons =
                if index == 5 { vec![String::from("12 % of the circle is out of view")] } else { vec![] };
            PressPanel {
                file: format!("images/{index:04}.png"),
                real,
                simulated,
                circle: Some(circle),
                scores,
                outlier_reasons,
            }
        })
        .collect();
    let disc = RgbImage::from_fn(160, 160, |x, y| Rgb([x as u8, y as u8, 128]));
    let normals = ["middle", "top left", "top right", "bottom left", "bottom right"];
    let normals = normals.map(|place| (place.to_owned(), disc.clone()));
    let summary = [("presses", "8"), ("error, cross-validated", "4.1 grey levels"), ("thickness", "2.0 mm")];
    let summary = summary.map(|(what, figure)| (what.to_owned(), figure.to_owned()));
    let warnings = [String::from("images/0005.png: 12 % of the circle is out of view")];
    let verdict = (String::from("the fit explains 84 % of what presses change"), false);
    let page = CalibrationPage {
        sensor: "example",
        verdict,
        summary: &summary,
        warnings: &warnings,
        presses: &presses,
        normals: &normals,
    };
    let html = page.to_html();
    assert_eq!(html.matches("data:image/png;base64,").count(), 8 * 3 + 5);
    assert!(html.len() < 8_000_000, "{} bytes", html.len());
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("page.html");
    std::fs::write(&path, html).expect("a folder that can be written");
    println!("{}", path.display());
}
