//! Golden images: small pictures that must stay as they are, byte for byte on x86-64.
//!
//! After a change that is meant to alter them, look at `target/golden/*.png` (expected, found, difference times 16)
//! and store what is found with
//!
//! ```text
//! GELSIM_UPDATE_GOLDEN=1 cargo test --release --test library golden
//! ```

mod effects;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::simd::{Vectors, at_most};
use gelsim_core::optics::normals::normals;
use gelsim_files::image_file::decode_rgb;
use gelsim_files::png::encode_small;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Sample, render};
use image::RgbImage;

const REFRESH: &str = "GELSIM_UPDATE_GOLDEN";

/// f32 arithmetic is the same on every x86-64; elsewhere a level may round the other way.
const TOLERANCE: u8 = if cfg!(target_arch = "x86_64") { 0 } else { 1 };

/// What of a sample is compared.
#[derive(Clone, Copy)]
enum Show {
    Image,
    /// White at the pad's thickness.
    Depth,
    /// White at the pad's thickness.
    Surface,
    Contact,
    /// -1 to 1 as 0 to 255.
    Normal,
    /// White at the largest.
    Pressure,
}

struct Case {
    name: &'static str,
    object: &'static str,
    show: Show,
    /// Lines of the job before its first table.
    job: &'static str,
}

/// At 64 px the paper's blur of 15 px is wider than most objects; this one has the look of the full size.
macro_rules! fine {
    ($sensor:literal, $size:literal, $more:literal) => {
        concat!(
            "gelpad.mean_blur = { kernel_px = 3, passes = 5 }\nsensor.preset = \"",
            $sensor,
            "\"\nsensor.resolution_px = ",
            $size,
            "\n",
            $more
        )
    };
}

const CASES: [Case; 24] = [
    Case {
        name: "gelsight_2014_sphere",
        object: "sphere",
        show: Show::Image,
        job: fine!("gelsight-2014", "[64, 48]", "indentation.depth_mm = 1.2"),
    },
    Case {
        name: "gelsight_2014_dots",
        object: "dots",
        show: Show::Image,
        job: fine!("gelsight-2014", "[64, 48]", "indentation.depth_mm = 0.7\npose.yaw_deg = 20.0"),
    },
    Case {
        name: "gelsight_2014_rope_with_the_papers_blur",
        object: "rope",
        show: Show::Image,
        job: "fidelity = \"paper\"\nsensor.resolution_px = [64, 48]\nindentation.depth_mm = 1.0\npose.yaw_deg = 70.0",
    },
    Case {
        name: "gelsight_2014_hexagon_nut_literal",
        object: "hexagon_nut",
        show: Show::Image,
        job: fine!(
            "gelsight-2014",
            "[64, 48]",
            "indentation.depth_mm = 0.8\noptics.phong.equation = \"literal\"\noptics.phong.ambient = 0.6"
        ),
    },
    Case {
        name: "gelsight_2014_phillips_screw_shiny",
        object: "phillips_screw",
        show: Show::Image,
        job: fine!(
            "gelsight-2014",
            "[64, 48]",
            "indentation.depth_mm = 1.5\noptics.phong.shininess = 30.5\noptics.phong.specular = 0.8"
        ),
    },
    Case {
        name: "gelsight_2017_gear",
        object: "gear",
        show: Show::Image,
        job: fine!(
            "gelsight-2017",
            "[64, 48]",
            "indentation.depth_mm = 0.9\npose.yaw_deg = 5.0\npose.tilt_deg = 2.0\npose.tilt_azimuth_deg = 30.0"
        ),
    },
    Case {
        name: "gelsight_2017_cube_across_the_border",
        object: "cube",
        show: Show::Image,
        job: fine!(
            "gelsight-2017",
            "[64, 48]",
            "indentation.depth_mm = 1.5\npose.x_mm = 6.0\npose.y_mm = -4.0\npose.yaw_deg = 30.0\npose.tilt_deg = 15.0\npose.tilt_azimuth_deg = 100.0"
        ),
    },
    Case {
        name: "gelsight_mini_coin",
        object: "coin",
        show: Show::Image,
        job: fine!("gelsight-mini", "[64, 48]", "indentation.depth_mm = 0.5"),
    },
    Case {
        name: "gelsight_mini_untouched",
        object: "cone",
        show: Show::Image,
        job: fine!("gelsight-mini", "[64, 48]", "indentation.depth_mm = 0.5\nindentation.no_contact = 1.0"),
    },
    Case {
        name: "digit_letter",
        object: "letter",
        show: Show::Image,
        job: fine!("digit", "[48, 64]", "indentation.depth_mm = 0.6"),
    },
    Case {
        name: "digit_prism_corner",
        object: "prism_corner",
        show: Show::Image,
        job: fine!("digit", "[48, 64]", "indentation.depth_mm = 1.9\npose.y_mm = 3.0\npose.x_mm = -2.0"),
    },
    Case {
        name: "depth_of_a_tilted_bolt",
        object: "bolt",
        show: Show::Depth,
        job: fine!(
            "gelsight-2014",
            "[64, 48]",
            "indentation.depth_mm = 2.5\npose.yaw_deg = 40.0\npose.tilt_deg = 8.0\npose.tilt_azimuth_deg = 0.0"
        ),
    },
    Case {
        name: "gelsight_series2_gear",
        object: "gear",
        show: Show::Image,
        job: fine!("gelsight-series2", "[64, 54]", "indentation.depth_mm = 0.8\npose.yaw_deg = 5.0"),
    },
    Case {
        name: "tactip_beside_an_edge",
        object: "edge_slab",
        show: Show::Image,
        job: "sensor.preset = \"tactip\"\nindentation.depth_mm = 3.0\ncamera = { threshold = 0.0, read_noise_levels = 0.0 }\n\
              pose = { anchor = \"origin\", yaw_deg = 30.0, y_mm = 2.0 }",
    },
    Case {
        name: "geltip_cube_from_the_side",
        object: "cube",
        show: Show::Image,
        job: "sensor.preset = \"geltip\"\nsensor.resolution_px = [80, 60]\nindentation.depth_mm = 1.0\n\
              pose = { from_tip_mm = 16.0, around_deg = 40.0, yaw_deg = 20.0 }",
    },
    Case {
        name: "allsight_letter_at_the_tip",
        object: "letter",
        show: Show::Image,
        job: "sensor.preset = \"allsight\"\nsensor.resolution_px = [80, 60]\nindentation.depth_mm = 0.8\n\
              pose = { from_tip_mm = 3.0, around_deg = 200.0 }",
    },
    Case {
        name: "surface_under_a_thin_ridge",
        object: "thin_ridge",
        show: Show::Surface,
        job: fine!("gelsight-2014", "[64, 48]", "indentation.depth_mm = 2.0\npose.yaw_deg = 60.0\npose.x_mm = 2.0"),
    },
    Case {
        name: "contact_of_a_key",
        object: "key",
        show: Show::Contact,
        job: fine!("gelsight-2014", "[64, 48]", "indentation.depth_mm = 0.8\npose.yaw_deg = 25.0"),
    },
    Case {
        name: "normals_under_a_torus",
        object: "torus",
        show: Show::Normal,
        job: fine!("gelsight-2014", "[64, 48]", "indentation.depth_mm = 1.4"),
    },
    Case {
        name: "high_gear",
        object: "gear",
        show: Show::Image,
        job: "fidelity = \"high\"\nsensor.resolution_px = [64, 48]\nindentation.depth_mm = 0.9\npose.tilt_deg = 2.0\npose.tilt_azimuth_deg = 30.0",
    },
    Case {
        name: "standard_torus_across_the_border",
        object: "torus",
        show: Show::Image,
        job: "sensor.resolution_px = [64, 48]\nindentation.depth_mm = 1.2\npose.x_mm = 6.0\npose.y_mm = -3.0",
    },
    Case {
        name: "draft_surface_under_a_cone",
        object: "cone",
        show: Show::Surface,
        job: "fidelity = \"draft\"\nsensor.resolution_px = [64, 48]\nindentation.depth_mm = 2.0",
    },
    Case {
        name: "pressure_under_crossed_ridges",
        object: "crossed_ridges",
        show: Show::Pressure,
        job: "fidelity = \"high\"\nsensor.resolution_px = [64, 48]\nindentation.depth_mm = 0.8\npose.yaw_deg = 15.0",
    },
    Case {
        name: "gaussian_brick",
        object: "brick",
        show: Show::Image,
        job: "gelpad.gaussian = { kernels_px = [11, 5], smoothing_px = 3 }\nsensor.resolution_px = [64, 48]\nindentation.depth_mm = 0.7",
    },
];

fn cases() -> impl Iterator<Item = &'static Case> {
    CASES.iter().chain(&effects::CASES)
}

fn plan_of(case: &Case) -> Plan {
    let object = format!("[[object]]\npath = \"objects/{}.obj\"\n", case.object);
    crate::plan::plan(&format!("dataset.name = \"golden\"\ndataset.samples = 1\n{}\n{object}", case.job))
}

fn picture(case: &Case) -> RgbImage {
    let plan = plan_of(case);
    let sample = render(&plan, 0);
    let [width, height] = plan.simulator.view().resolution_px;
    let level = |share: f64| (share * 255.0).round().clamp(0.0, 255.0) as u8;
    let grey = |grid: &Grid<f32>| {
        let border = (grid.width - width) / 2;
        let view = grid.crop(Rect { x0: border, y0: border, x1: border + width, y1: border + height });
        view.data.iter().flat_map(|mm| [level(f64::from(*mm) / plan.thickness_mm()); 3]).collect()
    };
    let rgb: Vec<u8> = match case.show {
        Show::Image => sample.impression.image.rgb,
        Show::Depth => grey(&sample.impression.depth.penetration),
        Show::Surface => grey(&sample.impression.contact.surface),
        Show::Contact => sample.impression.contact.mask.data.iter().flat_map(|value| [*value; 3]).collect(),
        Show::Pressure => {
            let pressure = sample.impression.contact.pressure.expect("the model knows it").data;
            let peak = pressure.iter().fold(f32::MIN_POSITIVE, |peak, kpa| peak.max(*kpa));
            pressure.iter().flat_map(|kpa| [level(f64::from(kpa / peak)); 3]).collect()
        }
        Show::Normal => {
            let normals = normals(&sample.impression.contact, plan.simulator.view());
            normals.iter().flatten().map(|n| level((f64::from(*n) + 1.0) / 2.0)).collect()
        }
    };
    RgbImage::from_raw(width as u32, height as u32, rgb).expect("three bytes per pixel")
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/images")
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
    let path = folder().join(format!("{}.png", case.name));
    let found = picture(case);
    if std::env::var_os(REFRESH).is_some() {
        return std::fs::write(&path, encode_small(&found)).map_err(|error| format!("{}: {error}", path.display()));
    }
    let stored = std::fs::read(&path).map_err(|error| error.to_string()).and_then(|bytes| decode_rgb(&bytes));
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
    let shown_path = shown.join(format!("{}.png", case.name));
    std::fs::create_dir_all(&shown)
        .and_then(|()| std::fs::write(&shown_path, encode_small(&panels(&expected, &found))))
        .map_err(|error| format!("{}: {error}", shown_path.display()))?;
    let size = if same_size { "" } else { "another size, " };
    let name = case.name;
    Err(format!("{name}: {size}{differ} values differ, by up to {largest} levels: see {}", shown_path.display()))
}

#[test]
fn processors_with_wider_vectors_and_without_give_the_same_bits() {
    for case in cases() {
        let seen = |vectors| {
            at_most(vectors, || {
                let Sample { impression, label, .. } = render(&plan_of(case), 0);
                let surface: Vec<u32> = impression.contact.surface.data.iter().map(|mm| mm.to_bits()).collect();
                (impression.image.rgb, surface, label)
            })
        };
        let [plain, eight, sixteen] = Vectors::ALL.map(seen);
        assert!(plain == eight, "{}: AVX2 gives other bits", case.name);
        assert!(plain == sixteen, "{}: AVX-512 gives other bits", case.name);
    }
}

/// Every golden image is found again.
#[test]
fn found() {
    let cases: Vec<&Case> = cases().collect();
    crate::cases::check_cases(&cases, |case| case.name, |case| check(case));
}

fn check(case: &Case) {
    if let Err(wrong) = compare(case) {
        panic!(
            "\n{wrong}\n\nIf that is meant: {REFRESH}=1 cargo test --release --test library golden stores what is found.\n"
        );
    }
}

#[test]
fn the_folder_holds_the_golden_images_and_nothing_else() {
    // A refresh may be writing them right now.
    if std::env::var_os(REFRESH).is_some() {
        return;
    }
    let entries = std::fs::read_dir(folder()).expect("the repository has the golden images");
    let found: BTreeSet<String> =
        entries.map(|entry| entry.expect("a readable folder").file_name().to_string_lossy().into_owned()).collect();
    let expected: BTreeSet<String> = cases().map(|case| format!("{}.png", case.name)).collect();
    assert_eq!(found, expected);
}

#[test]
fn golden_images_show_every_sensor_and_no_two_are_alike() {
    let plans: Vec<Plan> = cases().map(plan_of).collect();
    let sensors: BTreeSet<&str> = plans.iter().map(|plan| plan.job().sensor.name.as_str()).collect();
    let presets: BTreeSet<&str> = gelsim_files::sensor::PRESETS.iter().map(|(name, _)| *name).collect();
    assert_eq!(sensors, presets);
    let pictures: BTreeSet<Vec<u8>> = cases().map(|case| picture(case).into_raw()).collect();
    assert_eq!(pictures.len(), cases().count());
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
