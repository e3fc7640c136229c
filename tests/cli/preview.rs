//! Contact sheets: of a job, of a dataset, of one sample.

use embedded_graphics::text::Baseline;
use gelsim_lab::page::letters::{self, Face};

use crate::support::{Folder, JOB, advised_arguments, edited, members, repository};

fn picture(folder: &Folder, name: &str) -> image::RgbImage {
    image::open(folder.path(name)).expect("a PNG").into_rgb8()
}

/// Panels of 48 x 36 px stay at that size; around them gaps, over them headings, below them a line of text.
fn assert_sheet(sheet: &image::RgbImage, columns: u32, rows: u32, panels: u32) {
    let (width, height) = sheet.dimensions();
    let (least_width, least_height) = (columns * panels * 48, rows * 36);
    // As wide as headings and captions need: 60 letters at most.
    assert!((least_width..columns * 432).contains(&width), "{width} px for {columns} columns");
    assert!((least_height + rows * 13..least_height + rows * 13 + 90).contains(&height), "{height} px for {rows} rows");
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
        assert!((1200..1230).contains(&width) && (30..90).contains(&height), "{width} x {height}");
    }
}

#[test]
fn large_panels_are_made_smaller_on_a_sheet() {
    let folder = Folder::with_job(&edited(JOB, &[("[48, 36]", "[400, 30]")]));
    folder.succeed("preview job.toml --out sheet.png --panel 100 --columns 1");
    let (width, _) = picture(&folder, "sheet.png").dimensions();
    assert!((300..3 * 133 + 20).contains(&width), "{width}");
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
fn of_a_dataset_that_is_not_complete_what_is_there_is_shown() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --shards 0..1 --out out");
    let said = folder.succeed("preview out --out sheet.png");
    assert!(said.contains("note: 3 of 4 shards are not there, train-000001 the first of them"), "{said}");
    assert_sheet(&picture(&folder, "sheet.png"), 2, 2, 3);
    let text = folder.fail("preview out --out sheet.png --key 7", 1);
    assert!(text.contains(".tar: ") && text.contains("gelsim verify out"), "{text}");
    let generate = advised_arguments(&said, "gelsim ").split_once(" makes").expect("what it does").0;
    folder.succeed(generate);
    assert_eq!(folder.succeed("preview out --out sheet.png"), "");
    assert_sheet(&picture(&folder, "sheet.png"), 2, 4, 3);
    std::fs::remove_dir_all(folder.path("out/data")).expect("a folder");
    let text = folder.fail("preview out --out sheet.png", 1);
    assert!(text.contains("4 of 4 shards are not there"), "{text}");
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
    let left_out = "texture, rest_shape, friction, relaxation, finite_strain, shear, grain, mirror, bounce, markers, defocus, distortion, speckle, exposure";
    assert!(said.contains(&format!("note: samples 0 to 7: not enabled: {left_out}\n")), "{said}");
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
        // Below the headings.
        assert_eq!(at(0), with.get_pixel(6 + x, 21 + y).0);
        assert_eq!(at(1), without.get_pixel(6 + x, 21 + y).0);
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
    assert!(text.contains("samples 0 to 7: no effect is enabled"), "{text}");
    let text = folder.fail("preview job.toml --effects --key 8 --out effects.png", 2);
    assert!(text.contains("there is no sample 8"), "{text}");
    for flags in ["--count 0", "--columns 0", "--panel 0", "--key 1 --count 2"] {
        folder.fail(&format!("preview job.toml --out none.png {flags}"), 2);
    }
    folder.fail("preview job.toml --effects --columns 2 --out effects.png", 2);
    folder.succeed("generate job.toml --quiet");
    let text = folder.fail("preview out/small --effects --out effects.png", 2);
    assert!(text.contains("out/small is a dataset") && text.contains("gelsim preview out/small/job.toml"), "{text}");
    let text = folder.fail("preview out/small/job.toml --effects --out effects.png", 2);
    assert!(text.contains("samples 0 to 7: no effect is enabled"), "a dataset's job is a job: {text}");
    assert!(!folder.path("effects.png").exists());
}

#[test]
fn the_bundled_job_of_effects_calls_for_every_effect_but_finite_strain_and_relaxation() {
    let folder = Folder::new();
    let job = repository().join("configs/effects.toml");
    let said = folder
        .succeed(&format!("preview {} --effects --out effects.png --set sensor.resolution_px=[64,48]", job.display()));
    // Its pad has Coulomb friction, which finite strain does not know, and single presses take no time.
    assert_eq!(said, "note: samples 0 to 23: not enabled: relaxation, finite_strain\n");
    let rows = gelsim_core::effects::Effect::ALL.len() as u32 - 2;
    assert_eq!(picture(&folder, "effects.png").height(), 18 + 6 + rows * (48 + 18 + 6));
}

/// The colour of text on a sheet.
const INK: [u8; 3] = [225; 3];

/// True if a text stands somewhere on a sheet.
fn is_written(sheet: &image::RgbImage, text: &str) -> bool {
    let dots: Vec<[i32; 2]> = letters::letter_dots(text, Face::Small, Baseline::Top).into_iter().collect();
    let (width, height) = sheet.dimensions();
    let (wide, high) = (7 * text.chars().count() as u32, 13);
    let at = |x: u32, y: u32, dot: &[i32; 2]| sheet.get_pixel(x + dot[0] as u32, y + dot[1] as u32).0 == INK;
    let places =
        (0..(height + 1).saturating_sub(high)).flat_map(|y| (0..(width + 1).saturating_sub(wide)).map(move |x| (x, y)));
    places.into_iter().any(|(x, y)| dots.iter().all(|dot| at(x, y, dot)))
}

#[test]
fn headings_say_what_columns_show_and_how_deep_white_is() {
    let folder = Folder::with_job(JOB);
    folder.succeed("preview job.toml --out sheet.png --set sensor.resolution_px=[240,180] --columns 1 --count 3");
    let sheet = picture(&folder, "sheet.png");
    for words in ["tactile", "depth 0 ", " mm", "contact", "train", "#2"] {
        assert!(is_written(&sheet, words), "{words}");
    }
    // A bar from black to white stands between the ends of the scale where there is room, else words do.
    assert!(!is_written(&sheet, "depth 0 to "));
    folder.succeed("preview job.toml --out small.png");
    assert!(is_written(&picture(&folder, "small.png"), "depth 0 to "));
}

#[test]
fn names_are_written_as_they_are() {
    let name = "[[object]]\npath = \"cube.obj\"\nclass = \"M10 \u{f8}-nut (\u{43b}\u{44e}\u{43a})\"";
    let folder = Folder::with_job(&edited(JOB, &[("[[object]]\npath = \"cube.obj\"", name)]));
    folder.succeed("preview job.toml --out sheet.png");
    assert!(is_written(&picture(&folder, "sheet.png"), "M10 \u{f8}-nut (\u{43b}\u{44e}\u{43a})"));
}

#[test]
fn every_split_of_a_dataset_is_on_its_sheet() {
    let splits = "splits = { train = 0.7, val = 0.1, test = 0.2 }";
    let edits = [("splits = { train = 0.5, val = 0.25, test = 0.25 }", splits), ("[48, 36]", "[16, 12]")];
    let folder = Folder::with_job(&(String::from("gelpad = \"gaussian\"\n") + &edited(JOB, &edits)));
    folder.succeed("generate job.toml --quiet --out out --samples 300 --set dataset.samples_per_shard=50");
    for count in [12, 30] {
        folder.succeed(&format!("preview out --out sheet.png --count {count}"));
        let sheet = picture(&folder, "sheet.png");
        for split in ["train", "val", "test"] {
            assert!(is_written(&sheet, &format!("  {split}  #")), "{split} of {count}");
        }
        folder.succeed(&format!("preview out --out again.png --count {count}"));
        assert!(picture(&folder, "again.png") == sheet, "the same dataset, the same samples");
    }
}

#[test]
fn fingers_are_named_and_frames_have_their_times_and_phases() {
    let grip = "\n[gripper]\nsqueeze_mm = 0.8\n";
    let folder = Folder::with_job(
        &(edited(JOB, &[("[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n", "")]) + grip),
    );
    folder.succeed("preview job.toml --out grips.png --count 2");
    let sheet = picture(&folder, "grips.png");
    assert!(is_written(&sheet, "left") && is_written(&sheet, "right") && is_written(&sheet, "tactile"));

    let moves = "\n[sequence]\nframe_rate_hz = 10.0\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.3\ndepth_mm = 0.5\n\
                 [[sequence.phase]]\nname = \"slide\"\nduration_s = 0.4\nx_mm = 1.0\n";
    let folder = Folder::with_job(
        &(edited(JOB, &[("[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n", "")]) + moves),
    );
    folder.succeed("generate job.toml --quiet --out out --samples 2");
    folder.succeed("preview out --out frames.png");
    let sheet = picture(&folder, "frames.png");
    assert!(is_written(&sheet, "0.1 s press") && is_written(&sheet, "0.7 s slide"));
    folder.succeed("preview out --out layers.png --layers contact,depth --key 1");
    let layers = picture(&folder, "layers.png");
    assert!((3 * 36..3 * 36 + 60).contains(&layers.height()), "{:?}", layers.dimensions());
    assert!(is_written(&layers, "contact") && is_written(&layers, "depth"));
}

#[test]
fn layers_are_those_asked_for_or_the_ones_there_are_named() {
    let folder = Folder::with_job(JOB);
    folder.succeed(
        "preview job.toml --out all.png --layers surface,normal,pressure,gap,reference,instance --count 2 --columns 1",
    );
    let sheet = picture(&folder, "all.png");
    for words in ["surface", "normal", "pressure 0 to ", " kPa", "gap 0 to ", "reference", "instance"] {
        assert!(is_written(&sheet, words), "{words}");
    }
    assert!(!is_written(&sheet, "depth"));
    folder.succeed("generate job.toml --quiet --out out");
    folder.succeed("preview out --out contact.png --layers contact");
    assert!(
        is_written(&picture(&folder, "contact.png"), "contact")
            && !is_written(&picture(&folder, "contact.png"), "depth")
    );

    let said = folder.fail("preview out --out none.png --layers pressure,depth", 2);
    assert!(said.contains("out was made without pressure") && !folder.path("none.png").exists(), "{said}");
    let there = advised_arguments(&said, "there are ").split_once(';').expect("then its job").0;
    folder.succeed(&format!("preview out --out there.png {there}"));
    assert!(is_written(&picture(&folder, "there.png"), "contact"), "{there}");
    folder.succeed(advised_arguments(&said, "its job renders others: gelsim "));
    assert!(is_written(&picture(&folder, "none.png"), "pressure 0 to "));

    for (layers, words) in [
        ("markers", "it has no picture"),
        ("tactile", "leave it out"),
        ("presure", "did you mean pressure?"),
        ("colour", "layers with a picture are depth, surface, contact"),
    ] {
        let said = folder.fail(&format!("preview job.toml --out no.png --layers {layers}"), 2);
        assert!(said.contains(words), "{layers}: {said}");
    }
    let said = folder.fail("preview job.toml --out no.png --layers slip", 2);
    assert!(said.contains("slip") && said.contains("--layers"), "{said}");
    folder.fail("preview job.toml --out no.png --layers depth --effects", 2);
}

#[test]
fn a_picture_is_what_its_name_says() {
    let folder = Folder::with_job(JOB);
    folder.succeed("preview job.toml --out sheet.png");
    for name in ["sheet.jpg", "sheet.JPEG"] {
        folder.succeed(&format!("preview job.toml --out {name}"));
        let bytes = folder.read_bytes(name);
        assert_eq!(bytes[..3], [0xff, 0xd8, 0xff], "{name}");
        let (jpeg, png) = (image::load_from_memory(&bytes).expect("a JPEG").into_rgb8(), picture(&folder, "sheet.png"));
        assert_eq!(jpeg.dimensions(), png.dimensions());
        let apart: u64 = jpeg.iter().zip(png.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        assert!(apart < 8 * jpeg.len() as u64, "{apart}");
    }
    let before = folder.files("");
    for name in ["sheet.gif", "sheet", "sheet.png.txt"] {
        let said = folder.fail(&format!("preview job.toml --out {name}"), 2);
        assert!(said.contains(".png, .jpg or .jpeg"), "{said}");
        // Before the job is looked at.
        assert_eq!(folder.fail(&format!("preview none.toml --out {name}"), 2), said);
        assert!(folder.files("") == before);
    }
    let said = folder.fail("preview job.toml --key 0 --apng --out film.jpg", 2);
    assert!(said.contains("which ends in .png"), "{said}");
    let said = folder.fail("preview job.toml --out sheet.gif", 2);
    folder.succeed(&format!("preview job.toml {}", advised_arguments(&said, "name such a file: ")));

    std::fs::create_dir(folder.path("folder.png")).expect("a folder");
    let said = folder.fail("preview job.toml --out folder.png", 2);
    assert!(said.contains("folder.png is a folder"), "{said}");
    folder.succeed(&format!("preview job.toml {}", advised_arguments(&said, "name a file in it: ")));
    assert!(folder.path("folder.png/sheet.png").is_file());
    let said = folder.fail("preview job.toml --out deep/down/sheet.png", 2);
    let made = advised_arguments(&said, "make it with mkdir -p ").split_once(',').expect("or another place").0;
    std::fs::create_dir_all(folder.path(made)).expect("folders");
    folder.succeed("preview job.toml --out deep/down/sheet.png");
    let said = folder.fail("preview job.toml --out s3://bucket/sheet.png", 2);
    assert!(said.contains("it is in an object store") && said.contains("write to a folder, and copy that"), "{said}");
}

#[test]
fn what_only_a_job_has_is_refused_of_a_dataset_with_a_way_out() {
    let folder = Folder::with_job(&edited(JOB, &[NOISY]));
    folder.succeed("generate job.toml --quiet --out out");
    let said = folder.fail("preview out --out a.png --strict --samples 4 --all-effects", 2);
    assert!(said.contains("--samples, --all-effects, --strict change a job, not a dataset"), "{said}");
    let job = advised_arguments(&said, "preview the dataset's job: ");
    folder.succeed(&format!("preview {job} --out a.png --samples 4"));
    let said = folder.fail("preview out --out b.png --key 0 --apng --seed 5", 2);
    assert!(said.contains("--seed changes a job"), "{said}");
    let said = folder.fail("preview out --out effects.png --effects", 2);
    folder.succeed(advised_arguments(&said, "preview the job that it was made by: gelsim "));
    assert!(picture(&folder, "effects.png").height() > 5 * 36);
    for source in ["out", "job.toml"] {
        let said = folder.fail(&format!("preview {source} --out film.png --key 3 --apng"), 2);
        assert!(said.contains("--apng shows a sequence"), "{said}");
        folder.succeed(advised_arguments(&said, "leave --apng out: gelsim "));
        assert!(is_written(&picture(&folder, "film.png"), "#3"), "{source}");
    }
}

#[test]
fn a_damaged_shard_is_named_with_the_command_that_says_more() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    let tar = folder.path("out/data/train-000000.tar");
    let last = members(&tar).pop().expect("a file").name[..9].parse::<u64>().expect("a key");
    let bytes = std::fs::read(&tar).expect("a tar");
    std::fs::write(&tar, &bytes[..bytes.len() / 3]).expect("cut");
    let reproduce = format!("reproduce out {last}");
    for command in ["preview out --out sheet.png", "preview out --out sheet.png --count 4", &reproduce] {
        let said = folder.fail(command, 1);
        assert!(said.contains("train-000000.tar: "), "{command}: {said}");
        let verify = advised_arguments(&said, "gelsim ").split_once(" names").expect("what it does").0;
        let output = folder.gelsim(verify).assert().code(1);
        let found = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
        assert!(found.contains("data/train-000000.tar") && found.contains("fix it with"), "{found}");
        folder.gelsim("preview out --key 7 --out other.png").assert().success();
    }
}
