//! A made-up calibration folder.

use std::fs;

use gelsim_core::optics::calibrated::taxim::TaximCalibration;
use gelsim_lab::calibrate::taxim::import_taxim_folder;

use super::colours::colours;
use super::folder::{self, Member, PARAMS, SIZE};

fn folder_with(table: &[Member], pack: &[Member], params: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    folder::write(folder.path(), table, pack, params);
    folder
}

fn refused(table: &[Member], pack: &[Member], params: &str) -> String {
    import_taxim_folder(folder_with(table, pack, params).path()).expect_err("refused").to_string()
}

#[test]
fn a_folder_becomes_a_sensor() {
    let folder = folder_with(&folder::table(), &folder::pack(), PARAMS);
    let own = folder.path().join("my gel");
    fs::create_dir(&own).expect("a folder");
    folder::write(&own, &folder::table(), &folder::pack(), PARAMS);
    let imported = import_taxim_folder(&own).expect("a calibration");
    assert_eq!(imported.name, "my gel");
    assert_eq!(imported.resolution_px, [24, 16]);
    assert!((imported.field_of_view_mm[0] - 1.2).abs() < 1e-12 && (imported.field_of_view_mm[1] - 0.8).abs() < 1e-12);
    assert_eq!(imported.colors, colours());
    let text = serde_json::to_string(&imported.colors).expect("JSON");
    assert_eq!(serde_json::from_str::<TaximCalibration>(&text).expect("a table"), imported.colors);
}

/// Taxim's blur as a plain double sum over a picture that is mirrored at its border.
#[test]
fn the_background_is_the_photograph_mixed_with_its_blur_and_in_the_right_colours() {
    let imported =
        import_taxim_folder(folder_with(&folder::table(), &folder::pack(), PARAMS).path()).expect("a calibration");
    let weights = |sigma: f64| {
        let size = ((-2.0 * (1e-5 * (2.0 * std::f64::consts::PI).sqrt() * sigma).ln()).sqrt() * sigma).round();
        let reach = (size as i64) / 2;
        assert!(reach >= 6, "the blur reaches over the border");
        let all: Vec<(i64, f64)> = (-reach..=reach).map(|k| (k, (-0.5 * (k as f64 / sigma).powi(2)).exp())).collect();
        let sum: f64 = all.iter().map(|(_, weight)| weight).sum();
        all.into_iter().map(|(k, weight)| (k, weight / sum)).collect::<Vec<_>>()
    };
    let (across, down) = (weights(0.2 * 24.0), weights(0.25 * 16.0));
    let mirrored = |at: i64, size: usize| {
        let last = size as i64 - 1;
        let at = at.abs();
        (if at > last { 2 * last - at } else { at }) as usize
    };
    for (x, y, found) in imported.background.enumerate_pixels() {
        for channel in 0..3 {
            let value = |x: usize, y: usize| f64::from(folder::pad(x, y, 2 - channel));
            let mut blurred = 0.0;
            for (i, a) in &across {
                for (j, b) in &down {
                    blurred += a * b * value(mirrored(i64::from(x) + i, SIZE[0]), mirrored(i64::from(y) + j, SIZE[1]));
                }
            }
            let expected = 0.4 * blurred + 0.6 * value(x as usize, y as usize);
            let off = (f64::from(found[channel]) - expected).abs();
            assert!(off <= 0.5 + 1e-9, "{x} {y} {channel}: {found:?} for {expected}");
        }
    }
}

#[test]
fn every_mistake_is_named_with_its_file_and_its_array() {
    let empty = tempfile::tempdir().expect("a folder");
    let message = import_taxim_folder(empty.path()).expect_err("refused").to_string();
    for name in ["params.json: No such file", "polycalib.npz: No such file", "dataPack.npz: No such file", "pixmm"] {
        assert!(message.contains(name), "{name} in {message}");
    }
    let (table, pack) = (folder::table(), folder::pack());
    let without = |members: &[Member], name: &str| -> Vec<Member> {
        members.iter().filter(|member| member.name != name).cloned().collect()
    };
    let message = refused(&without(&table, "grad_g"), &without(&pack, "f0"), "{\n\"sensor\": 5}");
    for part in [
        "params.json: invalid type: integer `5`, expected struct Sensor at line 2 column 11",
        "polycalib.npz: it has no array `grad_g`, but `bins`, `grad_r`, `grad_b`",
        "dataPack.npz: it has no array `f0`, but `names`",
    ] {
        assert!(message.contains(part), "{part} in {message}");
    }

    let with = |members: &[Member], new: Member| -> Vec<Member> {
        let mut members = without(members, new.name);
        members.push(new);
        members
    };
    let flat = Member::f64("grad_b", &[8, 48], &folder::grades(0));
    let message = refused(&with(&table, flat), &pack, PARAMS);
    assert!(message.contains("array `grad_b` has shape (8, 48); it should be (bins, bins, 6)"), "{message}");
    let mut broken = folder::grades(0);
    broken[6 * 9] = f64::NAN;
    let message = refused(&with(&table, Member::f64("grad_b", &[8, 8, 6], &broken)), &pack, PARAMS);
    assert!(message.contains("polynomial of red in bin 1 of steepness, 1 of direction is not finite"), "{message}");
    let message = refused(&table, &with(&pack, Member::f64("f0", &[16, 8, 3], &[1.0; 384])), PARAMS);
    assert!(
        message.contains("array `f0` is 8 px wide and 16 px high, and params.json has \"w\": 24, \"h\": 16"),
        "{message}"
    );
    for (level, shown) in [(255.5, "255.5"), (-1.0, "-1"), (f64::NAN, "NaN"), (256.0, "256")] {
        let message = refused(&table, &with(&pack, Member::f64("f0", &[16, 24, 3], &[level; 1152])), PARAMS);
        assert!(message.contains(&format!("array `f0` holds {shown}; its values should be")), "{message}");
    }
}

#[test]
fn numbers_of_params_out_of_range_are_refused() {
    for (from, to, expected) in [
        ("\"pixmm\": 0.05", "\"pixmm\": -0.05", "`pixmm` is -0.05; allowed: 0.0001 to 10"),
        ("\"num_bins\": 8", "\"num_bins\": 1", "`num_bins` is 1; allowed: 2 to 1024"),
        ("\"num_bins\": 8", "\"num_bins\": 9", "its polynomials are of 8 bins, and `num_bins` in params.json is 9"),
        ("\"h\": 16", "\"h\": 0", "`w` and `h`: it says 24x0 px"),
        ("\"h\": 16", "\"h\": -16", "params.json: invalid value: integer `-16`"),
        ("0.25]", "1.1]", "`initial_frame_sigma_rel` is 1.1"),
        ("0.4,", "1.4,", "`frame_mixing_percentage` is 1.4"),
        ("\"diff_threshold\": 5", "\"diff_threshold\": 0.5", "`diff_threshold` is 0.5"),
        ("\"pixmm\"", "\"pitch\"", "missing field `pixmm`"),
    ] {
        assert_eq!(PARAMS.matches(from).count(), 1, "{from}");
        let message = refused(&folder::table(), &folder::pack(), &PARAMS.replace(from, to));
        assert!(message.contains(expected), "{expected} in {message}");
    }
}
