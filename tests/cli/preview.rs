//! Contact sheets: of a job, of a dataset, of one sample.

use crate::support::{Folder, JOB, edited, repository};

fn picture(folder: &Folder, name: &str) -> image::RgbImage {
    image::open(folder.path(name)).expect("a PNG").into_rgb8()
}

/// Panels of 48 x 36 px stay at that size; around them gaps, below them a line of text.
fn assert_sheet(sheet: &image::RgbImage, columns: u32, rows: u32, panels: u32) {
    let (width, height) = sheet.dimensions();
    let (least_width, least_height) = (columns * panels * 48, rows * 36);
    assert!((least_width..least_width + 60).contains(&width), "{width} px for {columns} columns");
    assert!((least_height + rows * 13..least_height + rows * 13 + 70).contains(&height), "{height} px for {rows} rows");
    let colors: std::collections::HashSet<_> = sheet.pixels().collect();
    assert!(colors.len() > 20, "only {} colours", colors.len());
}

#[test]
fn the_sheet_of_a_job_shows_its_first_samples() {
    let folder = Folder::with_job(JOB);
    folder.succeed("preview job.toml --out sheet.png");
    assert_sheet(&picture(&folder, "sheet.png"), 2, 4, 3);
    assert_eq!(folder.files("").len(), 4, "only the picture was written");
    folder.succeed("preview job.toml --out wide.png --count 6 --columns 3");
    assert_sheet(&picture(&folder, "wide.png"), 3, 2, 3);
}

#[test]
fn the_sheet_of_a_dataset_shows_what_is_in_its_shards() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet");
    folder.succeed("preview out/small --out dataset.png");
    folder.succeed("preview job.toml --out job.png");
    assert_sheet(&picture(&folder, "dataset.png"), 2, 4, 3);
    // Depth is drawn from half floats there: the tactile images agree in every bit, grey values to one step.
    let (dataset, job) = (picture(&folder, "dataset.png"), picture(&folder, "job.png"));
    assert_eq!(dataset.dimensions(), job.dimensions());
    let worst = dataset.as_raw().iter().zip(job.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(1), "{worst:?}");
}

#[test]
fn a_dataset_without_layers_still_has_a_sheet() {
    let folder = Folder::with_job(&edited(JOB, &[("[\"depth\", \"contact\"]", "[]")]));
    folder.succeed("generate job.toml --quiet");
    folder.succeed("preview out/small --out sheet.png");
    assert_sheet(&picture(&folder, "sheet.png"), 2, 4, 1);
}

#[test]
fn one_sample_is_shown_at_full_size() {
    let folder = Folder::with_job(&edited(JOB, &[("[48, 36]", "[400, 30]")]));
    folder.succeed("generate job.toml --quiet");
    for source in ["job.toml", "out/small"] {
        folder.succeed(&format!("preview {source} --out sample.png --key 7"));
        let (width, height) = picture(&folder, "sample.png").dimensions();
        assert!((1200..1230).contains(&width) && (30..80).contains(&height), "{width} x {height}");
    }
}

#[test]
fn large_panels_are_made_smaller_on_a_sheet() {
    let folder = Folder::with_job(&edited(JOB, &[("[48, 36]", "[400, 30]")]));
    folder.succeed("preview job.toml --out sheet.png --panel 100 --columns 1");
    let (width, _) = picture(&folder, "sheet.png").dimensions();
    assert!((300..330).contains(&width), "{width}");
}

#[test]
fn a_sample_that_does_not_exist_is_refused_with_the_numbers_that_do() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet");
    for source in ["job.toml", "out/small"] {
        let text = folder.fail(&format!("preview {source} --out sample.png --key 8"), 2);
        assert!(text.contains("there is no sample 8") && text.contains("samples are numbered 0 to 7"), "{text}");
        assert!(!folder.path("sample.png").exists());
    }
}

#[test]
fn a_folder_that_is_no_dataset_is_refused() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("empty")).expect("a folder");
    let text = folder.fail("preview empty --out sheet.png", 2);
    assert!(text.contains("empty is no dataset: there is no job.toml in it"), "{text}");
}

#[test]
fn a_sample_of_a_shard_that_is_missing_is_a_failure_that_names_it() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --shards 0..1");
    let text = folder.fail("preview out/small --out sheet.png", 1);
    assert!(text.contains(".tar: "), "{text}");
}

/// The job with noise and a dull lens, and nothing else that is an effect of its own.
const NOISY: (&str, &str) = ("[pose]", "[camera]\nread_noise_levels = 2.0\nvignette = 0.3\n\n[pose]");

#[test]
fn the_sheet_of_effects_has_a_row_for_each_that_a_job_calls_for() {
    let folder = Folder::with_job(&edited(JOB, &[NOISY]));
    let said = folder.succeed("preview job.toml --effects --out effects.png");
    // Deformation, supersampling, shading, shadows, darkening, vignette, noise.
    let row = 36 + 18 + 6;
    assert_eq!(picture(&folder, "effects.png").dimensions(), (3 * (196 + 6) + 6, 18 + 6 + 7 * row));
    let left_out = "texture, rest_shape, friction, shear, grain, markers, defocus, distortion, speckle, exposure";
    assert!(said.contains(&format!("note: samples 0 to 7: not called for are {left_out}\n")), "{said}");
    assert_eq!(folder.files("").len(), 4, "only the picture was written");
}

#[test]
fn an_effect_is_shown_with_it_without_it_and_as_a_difference() {
    let folder = Folder::with_job(&edited(JOB, &[NOISY, ("no_contact = 0.25", "no_contact = 1.0")]));
    folder.succeed("preview job.toml --effects --key 3 --out effects.png");
    folder.succeed("preview job.toml --key 3 --out with.png");
    folder.succeed("preview job.toml --key 3 --out without.png --set camera.read_noise_levels=0.0");
    let (sheet, with) = (picture(&folder, "effects.png"), picture(&folder, "with.png"));
    let without = picture(&folder, "without.png");
    // Noise is the only row: nothing touches the pad.
    assert_eq!(sheet.height(), 18 + 6 + 36 + 18 + 6);
    for (x, y) in [(0, 0), (47, 0), (20, 30), (47, 35)] {
        let at = |column: u32| sheet.get_pixel(6 + 202 * column + x, 18 + y).0;
        assert_eq!(at(0), with.get_pixel(6 + x, 6 + y).0);
        assert_eq!(at(1), without.get_pixel(6 + x, 6 + y).0);
        let gains = [1, 2, 4, 8, 16].map(|gain: i32| {
            let shown = |k: usize| 128 + gain * (i32::from(at(0)[k]) - i32::from(at(1)[k]));
            [0, 1, 2].map(|k| shown(k).clamp(0, 255) as u8)
        });
        assert!(gains.contains(&at(2)), "{:?} from {:?} and {:?}", at(2), at(0), at(1));
    }
}

#[test]
fn a_sheet_of_effects_needs_a_job_that_has_some() {
    let folder = Folder::with_job(&edited(JOB, &[("no_contact = 0.25", "no_contact = 1.0")]));
    let text = folder.fail("preview job.toml --effects --out effects.png", 2);
    assert!(text.contains("samples 0 to 7: no effect is called for"), "{text}");
    let text = folder.fail("preview job.toml --effects --key 8 --out effects.png", 2);
    assert!(text.contains("there is no sample 8"), "{text}");
    folder.fail("preview job.toml --effects --columns 2 --out effects.png", 2);
    folder.succeed("generate job.toml --quiet");
    let text = folder.fail("preview out/small --effects --out effects.png", 2);
    assert!(text.contains("out/small is a folder") && text.contains("preview its job: out/small/job.toml"), "{text}");
    let text = folder.fail("preview out/small/job.toml --effects --out effects.png", 2);
    assert!(text.contains("samples 0 to 7: no effect is called for"), "a dataset's job is a job: {text}");
    assert!(!folder.path("effects.png").exists());
}

#[test]
fn the_bundled_job_of_effects_calls_for_every_effect() {
    let folder = Folder::new();
    let job = repository().join("configs/effects.toml");
    let said = folder
        .succeed(&format!("preview {} --effects --out effects.png --set sensor.resolution_px=[64,48]", job.display()));
    assert_eq!(said, "");
    let rows = gelsim::core::effects::Effect::ALL.len() as u32;
    assert_eq!(picture(&folder, "effects.png").height(), 18 + 6 + rows * (48 + 18 + 6));
}
