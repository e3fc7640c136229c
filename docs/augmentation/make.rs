//! Makes the pictures of docs/how-to/augment.md: `cargo run --release --example augmentation [DIR]`.
//!
//! The "real" images are gelsim's own: another light, another lens and noise than the sensor that augments them knows.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use gelsim_augment::counterpart::{CounterpartRenderer, Orientation, Paired, PressMetadata};
use gelsim_augment::photometric::background::BackgroundSwap;
use gelsim_augment::photometric::{Photometric, PhotometricRecipe, SensorProfile};
use gelsim_core::camera::Image;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::pose::Angles;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::png;
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use gelsim_lab::metrics::noise::NoiseLevel;
use gelsim_lab::preview::amplify_difference;
use gelsim_lab::preview::rows::{SheetRow, draw_row_sheet};
use image::{Rgb, RgbImage};

/// The sensor as its file describes it.
const SENSOR: &str = "[sensor]\npreset = \"gelsight-mini\"\nresolution_px = [320, 240]\n";

/// The same sensor as it is: its LEDs are near, its lens is not ideal, its camera is noisy.
const REAL: &str = "optics = \"led\"\n[camera]\ndefocus_mm = 0.04\nvignette = 0.15\nread_noise_levels = 1.0\n";

/// The same with other lamps, and coated anew.
const OTHER: &str = "[sensor.rendered_background]\ncolor = [0.36, 0.42, 0.52]\nglow = 0.4\ngrain = 0.012\n";

const PANEL_WIDTH: u32 = 196;

fn main() -> ExitCode {
    let folder = std::env::args().nth(1).map_or_else(|| PathBuf::from("docs/augmentation"), PathBuf::from);
    match pictures(&folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("{reason}");
            ExitCode::FAILURE
        }
    }
}

fn pictures(folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for (name, picture) in [("photometric", photometric()?), ("mirrored", mirrored()?), ("paired", paired()?)] {
        let path = folder.join(format!("{name}.png"));
        let written = std::fs::write(&path, png::encode_small(&picture));
        written.map_err(|error| format!("{}: {error}", path.display()))?;
    }
    Ok(())
}

/// One press of an object, of a job that begins with `head`.
fn plan(head: &str, object: &str, place: &str) -> Result<Plan, String> {
    let text = format!(
        "{head}\n{SENSOR}[dataset]\nname = \"pictures\"\nsamples = 1\n[indentation]\ndepth_mm = 0.9\n\
         [[object]]\npath = \"objects/{object}.obj\"\n[pose]\n{place}\n"
    );
    let mut problems = Diagnostics::default();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let written = config::read_job_text(object, text, folder, &Overrides::default(), &mut problems);
    Plan::resolve(written, problems).map_err(|report: Report| report.to_string())
}

fn picture(image: &Image) -> RgbImage {
    RgbImage::from_fn(image.width as u32, image.height as u32, |x, y| {
        let at = 3 * (y as usize * image.width + x as usize);
        Rgb([image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]])
    })
}

fn reference(image: &Image) -> BackgroundImage {
    BackgroundImage::new(image.width, image.height, image.rgb.clone())
}

/// Each photometric augmentation by itself, and all together.
fn photometric() -> Result<RgbImage, String> {
    let real = plan(REAL, "gear", "yaw_deg = 20.0\nx_mm = 1.0\ny_mm = 0.5")?;
    let other = plan(&format!("{REAL}{OTHER}"), "gear", "")?;
    let image = picture(&render(&real, 0).impression.image);
    let own = reference(real.simulator.untouched());
    let profile = SensorProfile {
        sensor: real.job().sensor.clone(),
        view: *real.simulator.view(),
        background: Some(own.clone()),
        noise: NoiseLevel::from_camera(&real.job().camera),
    };
    let swap = || vec![BackgroundSwap::new("other-lamp.png", &own, &other.simulator.untouched().rgb)];
    let print = "markers = { pitch_mm = 1.6, diameter_mm = 0.4 }";
    let all = format!(
        "led_gain = [0.7, 1.3]\nwhite_balance = [0.85, 1.15]\nexposure_ev = [-0.4, 0.4]\nnoise_level = 2.0\n\
         blur_px = 1.0\nvignette = 0.3\n{print}"
    );
    let panels = [
        ("the real image", "", false),
        ("background = [..]", "", true),
        ("led_gain = [0.6, 1.4]", "led_gain = [0.6, 1.4]", false),
        ("white_balance = [0.7, 1.3]", "white_balance = [0.7, 1.3]", false),
        ("exposure_ev = -0.6", "exposure_ev = -0.6", false),
        ("noise_level = 6.0", "noise_level = 6.0", false),
        ("blur_px = 2.5", "blur_px = 2.5", false),
        ("vignette = 0.6", "vignette = 0.6", false),
        ("markers = { .. }", print, false),
        ("all of them", all.as_str(), true),
    ];
    let mut made = Vec::new();
    for (number, (caption, text, swaps)) in (0..).zip(panels) {
        let settings: Photometric = toml::from_str(text).map_err(|error| format!("{caption}: {error}"))?;
        let (out, applied) = PhotometricRecipe::new(settings, &profile, if swaps { swap() } else { Vec::new() })
            .apply(&image, 1, number);
        println!("{caption}: {}", String::from_utf8_lossy(&gelsim_dataset::encode::to_json_line(&applied)));
        made.push((caption, picture(&out)));
    }
    let rows = made.chunks(5).map(|row| SheetRow {
        panels: row.iter().map(|(_, picture)| picture.clone()).collect(),
        captions: (0..).zip(row).map(|(column, (caption, _))| (column, (*caption).to_owned())).collect(),
    });
    Ok(draw_row_sheet(&["", "", "", "", ""], rows.collect(), PANEL_WIDTH))
}

/// A press, its mirrored image, and the mirrored press.
fn mirrored() -> Result<RgbImage, String> {
    let of = |x_mm: f64, yaw_deg: f64| -> Result<RgbImage, String> {
        let plan = plan("", "hexagon_nut", &format!("x_mm = {x_mm:?}\nyaw_deg = {yaw_deg:?}"))?;
        Ok(picture(&render(&plan, 0).impression.image))
    };
    let (press, right) = (of(1.5, 10.0)?, of(-1.5, -10.0)?);
    let wrong = image::imageops::flip_horizontal(&press);
    let panels = vec![press, wrong.clone(), right.clone(), amplify_difference(&right, &wrong, 4)];
    let titles = ["the press", "its image mirrored: wrong", "mirrored, rendered anew", "4 x the difference"];
    Ok(draw_row_sheet(&titles, vec![SheetRow { panels, captions: Vec::new() }], PANEL_WIDTH))
}

/// Presses that lie beside what their labels say, and their twins.
fn paired() -> Result<RgbImage, String> {
    let mut rows = Vec::new();
    for (object, shift_px) in [("letter", [3.4, -2.2]), ("hexagon_nut", [-9.0, 6.5])] {
        let simulated = plan("", object, "")?;
        let pitch = simulated.simulator.view().mm_per_px;
        let real =
            plan(REAL, object, &format!("x_mm = {:?}\ny_mm = {:?}", shift_px[0] * pitch[0], shift_px[1] * pitch[1]))?;
        let (image, background) = (picture(&render(&real, 0).impression.image), picture(real.simulator.untouched()));
        let level = Angles { yaw_deg: 0.0, tilt_deg: 0.0, tilt_azimuth_deg: 0.0 };
        let metadata =
            PressMetadata { object: 0, orientation: Orientation::Angles(level), position_mm: [0.0; 2], depth_mm: 0.9 };
        let counterpart = |max_offset_px| {
            let settings = Paired { max_offset_px, ..Paired::default() };
            Ok::<_, String>(
                CounterpartRenderer::new(plan("", object, "")?, settings, background.clone())
                    .render_counterpart(&metadata, &image, 0),
            )
        };
        let (labelled, aligned) = (counterpart(0)?, counterpart(20)?);
        for (what, counterpart) in [("as labelled", &labelled), ("aligned", &aligned)] {
            let [x, y] = counterpart.offset_px;
            println!("{object}, {what}: offset {x:.2}, {y:.2} px, correlation {:.3}", counterpart.correlation);
        }
        let change = |image: &Image| over(&picture(image), &picture(simulated.simulator.untouched()), &background);
        let panels = vec![
            image.clone(),
            picture(&labelled.sample.impression.image),
            picture(&aligned.sample.impression.image),
            amplify_difference(&change(&labelled.sample.impression.image), &image, 4),
            amplify_difference(&change(&aligned.sample.impression.image), &image, 4),
        ];
        let [x, y] = aligned.offset_px;
        let captions = vec![
            (0, format!("off by {}, {} px", shift_px[0], shift_px[1])),
            (1, format!("correlation {:.2}", labelled.correlation)),
            (2, format!("{x:.2}, {y:.2} px: {:.2}", aligned.correlation)),
        ];
        rows.push(SheetRow { panels, captions });
    }
    let titles =
        ["real", "twin where the label says", "twin, aligned", "4 x difference as labelled", "4 x difference, aligned"];
    Ok(draw_row_sheet(&titles, rows, PANEL_WIDTH))
}

/// An image over another background.
fn over(image: &RgbImage, own: &RgbImage, other: &RgbImage) -> RgbImage {
    let own = BackgroundImage::new(own.width() as usize, own.height() as usize, own.as_raw().clone());
    let planes = BackgroundSwap::new("", &own, other.as_raw()).change.apply(image.as_raw());
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let at = (y * image.width() + x) as usize;
        Rgb([0, 1, 2].map(|k| gelsim_core::base::light::quantise(planes[k][at])))
    })
}
