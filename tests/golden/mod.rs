//! Golden images: small pictures that must stay as they are, byte for byte on x86-64.
//!
//! A case is a pair of files in `cases`: `NAME.toml`, a job, and `NAME.tactile.png`, its first sample; or a layer of it, such as
//! `NAME.surface.png`. After a change that is meant to alter them, look at `target/golden/*.png` (expected, found, difference times
//! 16) and store what is found with the following command. It also gives a job that has no picture yet its tactile image.
//!
//! ```text
//! UPDATE=1 cargo test --release --test library golden
//! ```

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::simd::{VectorWidth, with_width_limit};
use gelsim_core::optics::normals::surface_normals;
use gelsim_files::image_file::decode_rgb;
use gelsim_files::png::encode_small;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, render};
use image::RgbImage;

const UPDATE: &str = "UPDATE";

/// f32 arithmetic is the same on every x86-64; elsewhere a level may round the other way.
const TOLERANCE: u8 = if cfg!(target_arch = "x86_64") { 0 } else { 1 };

/// A picture of a job's first sample.
struct Case {
    /// Its file's name without the ending: the job's, a dot, and what of the sample it shows.
    name: String,
    plan: Plan,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/cases")
}

/// Names of the files in the folder that end so, without their ending.
fn names(ending: &str) -> BTreeSet<String> {
    let files = fs::read_dir(folder()).expect("the repository has the golden images");
    let files = files.map(|file| file.expect("a readable folder").file_name().to_string_lossy().into_owned());
    files.filter_map(|file| Some(file.strip_suffix(ending)?.to_owned())).collect()
}

/// The name of the job that a picture shows, and what of its sample.
fn parts(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or_else(|| panic!("{name}.png does not say what it shows"))
}

/// Every picture, and of jobs that have none the tactile image.
fn cases() -> Vec<Case> {
    let mut pictures = names(".png");
    for job in names(".toml") {
        if !pictures.iter().any(|name| parts(name).0 == job) {
            pictures.insert(format!("{job}.tactile"));
        }
    }
    let read = |name: String| {
        let path = folder().join(format!("{}.toml", parts(&name).0));
        let job = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Case { plan: crate::plan::plan_in(&folder(), &job), name }
    };
    pictures.into_iter().map(read).collect()
}

/// What a case shows: depth and surface are white at the pad's thickness, pressure at its largest; -1 to 1 of normals is 0 to 255.
fn picture(Case { name, plan }: &Case) -> RgbImage {
    let Sample { impression, .. } = render(plan, 0);
    let [width, height] = plan.simulator.view().resolution_px;
    let level = |share: f64| (share * 255.0).round().clamp(0.0, 255.0) as u8;
    let grey = |grid: &Grid<f32>| {
        let border = (grid.width - width) / 2;
        let view = grid.crop(Rect { x0: border, y0: border, x1: border + width, y1: border + height });
        view.data.iter().flat_map(|mm| [level(f64::from(*mm) / plan.thickness_mm()); 3]).collect()
    };
    let rgb: Vec<u8> = match parts(name).1 {
        "tactile" => impression.image.rgb,
        "depth" => grey(&impression.depth.penetration),
        "surface" => grey(&impression.contact.surface),
        "contact" => impression.contact.mask.data.iter().flat_map(|value| [*value; 3]).collect(),
        "pressure" => {
            let pressure = impression.contact.pressure.expect("the model knows it").data;
            let peak = pressure.iter().fold(f32::MIN_POSITIVE, |peak, kpa| peak.max(*kpa));
            pressure.iter().flat_map(|kpa| [level(f64::from(kpa / peak)); 3]).collect()
        }
        "normal" => {
            let normals = surface_normals(&impression.contact, plan.simulator.view());
            normals.iter().flatten().map(|n| level((f64::from(*n) + 1.0) / 2.0)).collect()
        }
        other => panic!("{name}.png: no picture shows `{other}`"),
    };
    RgbImage::from_raw(width as u32, height as u32, rgb).expect("three bytes per pixel")
}

/// Expected, found and their difference side by side, enlarged.
fn panels(expected: &RgbImage, found: &RgbImage) -> RgbImage {
    const SCALE: u32 = 4;
    const GAP: u32 = 8;
    let (width, height) = (expected.width().max(found.width()), expected.height().max(found.height()));
    let mut sheet = RgbImage::new(3 * SCALE * width + 2 * GAP, SCALE * height);
    for (x, y, pixel) in sheet.enumerate_pixels_mut() {
        let (panel, column) = (x / (SCALE * width + GAP), x % (SCALE * width + GAP) / SCALE);
        let at = |image: &RgbImage| image.get_pixel_checked(column, y / SCALE).map_or([0; 3], |pixel| pixel.0);
        pixel.0 = match panel {
            0 => at(expected),
            1 => at(found),
            _ => {
                let (expected, found) = (at(expected), at(found));
                std::array::from_fn(|k| expected[k].abs_diff(found[k]).saturating_mul(16))
            }
        };
    }
    sheet
}

/// What is wrong with a case, if anything.
fn compare(case: &Case) -> Result<(), String> {
    let name = &case.name;
    let path = folder().join(format!("{name}.png"));
    let found = picture(case);
    if std::env::var_os(UPDATE).is_some() {
        return fs::write(&path, encode_small(&found)).map_err(|error| format!("{}: {error}", path.display()));
    }
    let stored = fs::read(&path).map_err(|error| error.to_string()).and_then(|bytes| decode_rgb(&bytes));
    let expected = stored.map_err(|error| format!("{}: {error}", path.display()))?;
    let same_size = expected.dimensions() == found.dimensions();
    let apart = expected.iter().zip(found.iter()).map(|(a, b)| a.abs_diff(*b));
    let largest = apart.clone().max().unwrap_or_default();
    let differ = apart.filter(|levels| *levels > TOLERANCE).count();
    if same_size && differ == 0 {
        return Ok(());
    }
    // Beside Cargo's own folder for what tests write: target/golden.
    let shown = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("golden");
    let shown_path = shown.join(format!("{name}.png"));
    fs::create_dir_all(&shown)
        .and_then(|()| fs::write(&shown_path, encode_small(&panels(&expected, &found))))
        .map_err(|error| format!("{}: {error}", shown_path.display()))?;
    let size = if same_size { "" } else { "another size, " };
    Err(format!("{name}: {size}{differ} values differ, by up to {largest} levels: see {}", shown_path.display()))
}

#[test]
fn processors_with_wider_vectors_and_without_give_the_same_bits() {
    for Case { name, plan } in cases() {
        let seen = |vectors| {
            with_width_limit(vectors, || {
                let Sample { impression, label, .. } = render(&plan, 0);
                let surface: Vec<u32> = impression.contact.surface.data.iter().map(|mm| mm.to_bits()).collect();
                (impression.image.rgb, surface, label)
            })
        };
        let [plain, eight, sixteen] = VectorWidth::ALL.map(seen);
        assert!(plain == eight, "{name}: AVX2 gives other bits");
        assert!(plain == sixteen, "{name}: AVX-512 gives other bits");
    }
}

/// Every golden image is found again.
#[test]
fn found() {
    let cases = cases();
    let cases: Vec<&Case> = cases.iter().collect();
    crate::cases::check_cases(&cases, |case| &case.name, |case| check(case));
}

fn check(case: &Case) {
    if let Err(wrong) = compare(case) {
        panic!(
            "\n{wrong}\n\nIf that is meant: {UPDATE}=1 cargo test --release --test library golden stores what is found.\n"
        );
    }
}

#[test]
fn golden_images_show_every_sensor_and_no_two_are_alike() {
    let cases = cases();
    let sensors: BTreeSet<&str> = cases.iter().map(|case| case.plan.job().sensor.name.as_str()).collect();
    let presets: BTreeSet<&str> = gelsim_files::sensor::PRESETS.iter().map(|(name, _)| *name).collect();
    assert_eq!(sensors, presets);
    let pictures: BTreeSet<Vec<u8>> = cases.iter().map(|case| picture(case).into_raw()).collect();
    assert_eq!(pictures.len(), cases.len());
}

#[test]
fn a_mismatch_is_shown_as_expected_found_and_difference() {
    let expected = RgbImage::from_pixel(5, 4, image::Rgb([100, 100, 100]));
    let mut found = expected.clone();
    found.get_pixel_mut(2, 1).0 = [103, 100, 60];
    let sheet = panels(&expected, &found);
    assert_eq!(sheet.dimensions(), (3 * 20 + 16, 16));
    // The upper left of the enlarged pixel (2, 1) in each panel.
    let seen = [0, 28, 56].map(|left| sheet.get_pixel(left + 8, 4).0);
    assert_eq!(seen, [[100, 100, 100], [103, 100, 60], [48, 0, 255]]);
    assert_eq!(sheet.get_pixel(56, 0).0, [0, 0, 0]);
}
