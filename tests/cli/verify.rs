//! `gelsim verify` names what is wrong with a dataset, `generate` makes just that again, `reproduce` renders a sample
//! again, and files of a newer version are left alone.

use std::fs;
use std::ops::RangeInclusive;

use gelsim_dataset::verify::{self, CheckLevel};
use serde_json::Value;

use crate::support::{Folder, JOB, assert_same_files, edit_stats, edited, json, members, sha256};

/// Every layer there is.
fn all_layers() -> Folder {
    let layers = r#"["depth", "surface", "contact", "normal", "pressure", "markers", "reference"]"#;
    let job = edited(JOB, &[(r#"["depth", "contact"]"#, layers)]) + "\n[markers]\npitch_mm = 1.5\ndiameter_mm = 0.5\n";
    let folder = Folder::with_job(&job);
    folder.succeed("generate job.toml --quiet --out out");
    folder
}

/// What verify prints, and its exit status.
fn verify(folder: &Folder, flags: &str) -> (String, i32) {
    let output = folder.gelsim(&format!("verify out{flags}")).output().expect("it runs");
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    (String::from_utf8_lossy(&output.stdout).into_owned(), output.status.code().expect("an exit status"))
}

/// Damages a copy of a sound dataset. Verify must then name the file and say all the words, and so it must when it only
/// compares checksums, unless the damage leaves them right; `generate` must make exactly `again` shards anew and end with
/// the bytes of the sound dataset.
fn damage(folder: &Folder, again: RangeInclusive<u64>, words: &[&str], damage: impl Fn(&Folder)) {
    let sound = folder.lasting_files("out");
    damage(folder);
    let (said, status) = verify(folder, "");
    assert_eq!(status, 1, "{said}");
    assert!(words.iter().all(|word| said.contains(word)), "{words:?} in\n{said}");
    let (quick, status) = verify(folder, " --checksums");
    assert_eq!(status, 1, "{quick}");
    let said = folder.succeed("generate job.toml --out out");
    let made = said.split(" in ").nth(1).and_then(|rest| rest.split(' ').next()).and_then(|n| n.parse().ok());
    assert!(made.is_some_and(|made| again.contains(&made)), "{said}");
    assert_same_files(&sound, &folder.lasting_files("out"));
    assert_eq!(verify(folder, ""), (summary(folder), 0));
}

fn summary(folder: &Folder) -> String {
    let (said, _) = verify(folder, " --checksums");
    assert!(said.starts_with("out: 8 samples in 4 shards") && said.ends_with(": valid and complete\n"), "{said}");
    said
}

#[test]
fn a_complete_dataset_is_said_to_be_complete() {
    let folder = all_layers();
    let said = summary(&folder);
    assert_eq!(verify(&folder, ""), (said, 0));
}

#[test]
fn every_flipped_bit_of_a_shard_is_found_and_that_shard_made_again() {
    let folder = all_layers();
    let tar = folder.path("out/data/train-000001.tar");
    let length = fs::metadata(&tar).expect("a tar").len() as usize;
    // In a header, in an image, in a label, in the padding at the end.
    for at in [0, 130, 600, length / 2, length - 3000, length - 1] {
        damage(&folder, 1..=1, &["data/train-000001.tar: is not what was written"], |_| {
            let mut bytes = fs::read(&tar).expect("a tar");
            bytes[at] ^= 0x10;
            fs::write(&tar, bytes).expect("a tar");
        });
    }
}

#[test]
fn a_cut_a_missing_and_an_exchanged_shard_are_named_and_made_again() {
    let folder = all_layers();
    let path = |name: &str| folder.path(name);
    damage(&folder, 1..=1, &["data/val-000000.tar: is not what was written"], |_| {
        let bytes = fs::read(path("out/data/val-000000.tar")).expect("a tar");
        fs::write(path("out/data/val-000000.tar"), &bytes[..bytes.len() / 3]).expect("a tar");
    });
    damage(&folder, 1..=1, &["data/val-000000.tar: is missing"], |_| {
        fs::remove_file(path("out/data/val-000000.tar")).expect("a tar");
    });
    damage(&folder, 1..=1, &["stats/val-000000.json: is missing"], |_| {
        fs::remove_file(path("out/stats/val-000000.json")).expect("stats");
    });
    damage(&folder, 1..=1, &["stats/val-000000.json: is not what was written"], |_| {
        fs::write(path("out/stats/val-000000.json"), "{").expect("stats");
    });
    let words = [
        "data/val-000000.tar: is the content of data/test-000000.tar",
        "data/test-000000.tar: is the content of data/val-000000.tar",
    ];
    damage(&folder, 2..=2, &words, |_| {
        fs::rename(path("out/data/val-000000.tar"), path("out/x")).expect("a tar");
        fs::rename(path("out/data/test-000000.tar"), path("out/data/val-000000.tar")).expect("a tar");
        fs::rename(path("out/x"), path("out/data/test-000000.tar")).expect("a tar");
    });
    for name in ["dataset.json", "wids.json", "README.md"] {
        damage(&folder, 0..=0, &[&format!("{name}: is missing")], |_| {
            fs::remove_file(path("out").join(name)).expect("a file");
        });
    }
    // The index of another dataset, and a manifest that tells another story.
    damage(&folder, 0..=0, &["wids.json: says shardlist.2.nsamples is 1, the shards 2"], |folder| {
        let text = folder.read("out/wids.json").replace("\"nsamples\": 2", "\"nsamples\": 1");
        folder.write("out/wids.json", text);
    });
    damage(&folder, 0..=0, &["dataset.json: says shards.0.sha256 is \"0000"], |folder| {
        let sha256 = json(folder, "out/stats/train-000000.json")["sha256"].as_str().expect("a hash").to_owned();
        let text = folder.read("out/dataset.json").replace(&sha256, &"0".repeat(64));
        folder.write("out/dataset.json", text);
    });
}

/// A tar with other content in some files, or without them, and stats that vouch for it.
fn forge_shard(folder: &Folder, change: impl Fn(&str, &[u8]) -> Option<Vec<u8>>) {
    let path = folder.path("out/data/test-000000.tar");
    let mut builder = tar::Builder::new(Vec::new());
    for member in members(&path) {
        let Some(bytes) = change(&member.name, &member.bytes) else { continue };
        let mut header = member.header.clone();
        header.set_size(bytes.len() as u64);
        header.set_cksum();
        builder.append(&header, bytes.as_slice()).expect("memory");
    }
    let bytes = builder.into_inner().expect("memory");
    fs::write(&path, &bytes).expect("a tar");
    let sha256 = sha256(&bytes);
    edit_stats(folder, "out", "test-000000", |stats| {
        stats["bytes"] = bytes.len().into();
        stats["sha256"] = sha256.clone().into();
    });
    folder.succeed("finalize out");
}

#[test]
fn behind_right_checksums_a_file_that_is_not_what_it_should_be_is_still_found() {
    let folder = all_layers();
    let sound = folder.files("out");
    let restore = || sound.iter().for_each(|(name, bytes)| folder.write(&format!("out/{name}"), bytes));
    let label = |bytes: &[u8], from: &str, to: &str| {
        let text = String::from_utf8(bytes.to_vec()).expect("JSON");
        assert!(text.contains(from), "{from} in {text}");
        Some(text.replace(from, to).into_bytes())
    };
    let not_a_number = gelsim_files::exr::encode(48, 36, &[("Z", &[f32::NAN; 48 * 36])], Default::default());
    let below = gelsim_files::exr::encode(48, 36, &[("Z", &[-0.5; 48 * 36])], Default::default());
    let small = gelsim_files::png::encode_rgb(2, 1, &[0; 6]);
    type Change<'a> = Box<dyn Fn(&str, &[u8]) -> Option<Vec<u8>> + 'a>;
    let for_files = |ending: &'static str, new: Vec<u8>| -> Change<'_> {
        Box::new(move |name, bytes| Some(if name.ends_with(ending) { new.clone() } else { bytes.to_vec() }))
    };
    let in_label = |from: &'static str, to: &'static str| -> Change<'_> {
        Box::new(move |name, bytes| {
            if name.ends_with("json") && !name.contains("markers") {
                label(bytes, from, to)
            } else {
                Some(bytes.to_vec())
            }
        })
    };
    let cases: Vec<(Change<'_>, &str)> = vec![
        (for_files("depth.exr", not_a_number.clone()), "depth.exr: channel Z is NaN in column 0, row 0"),
        (for_files("depth.exr", below), "depth.exr: channel Z is -0.5 in column 0, row 0"),
        (for_files("surface.exr", not_a_number), "surface.exr: channel Z is NaN"),
        (for_files("tactile.png", small), "tactile.png: is 2x1 px Rgb8, not 48x36 Rgb8"),
        (for_files("contact.png", b"PNG".to_vec()), "contact.png: "),
        (
            for_files("markers.json", b"{\"rest_px\": [[1, 2]], \"moved_px\": []}".to_vec()),
            "markers.json: 1 rest, 0 moved",
        ),
        (for_files("normal.exr", Vec::new()), "normal.exr: "),
        (Box::new(|name, bytes| (!name.ends_with("pressure.exr")).then(|| bytes.to_vec())), "pressure.exr is missing"),
        (Box::new(|name, bytes| (!name.starts_with("000000003")).then(|| bytes.to_vec())), "000000003"),
        (in_label("\"attempt\":0", "\"attempt\":0,\"more\":1"), "has `more`, which the schema does not know"),
        (in_label("\"attempt\":0,", ""), "missing field `attempt`"),
        (
            in_label("\"in_contact\":", "\"often\":0,\"in_contact\":"),
            "has `objects[0].contact.often`, which the schema does not know",
        ),
        (in_label("\"seed\":7", "\"seed\":8"), "is not about this sample"),
        (in_label("\"schema_version\":1", "\"schema_version\":9"), "has version 9 of the schema"),
        (in_label("\"split\":\"test\"", "\"split\":\"train\""), "is not about this sample"),
    ];
    for (change, words) in cases {
        forge_shard(&folder, change);
        assert_eq!(verify(&folder, " --checksums").1, 0, "checksums vouch for {words:?}");
        let (said, status) = verify(&folder, "");
        assert!(status == 1 && said.contains("data/test-000000.tar: ") && said.contains(words), "{words:?} in\n{said}");
        run_named_fixes(&folder, &said);
        restore();
    }
    assert_eq!(verify(&folder, "").1, 0);
}

#[test]
fn a_dataset_of_another_version_is_left_to_it() {
    let folder = all_layers();
    let job = folder.read("out/job.toml");
    folder.write("out/job.toml", job.replacen(concat!(env!("CARGO_PKG_VERSION"), "."), "0.0.9.", 1));
    folder.write("out/data/test-000000.tar", "");
    let (said, status) = verify(&folder, "");
    let only = "only that version can say, and only it can fix them\n";
    assert!(status == 1 && said.contains("made by gelsim 0.0.9") && said.ends_with(only), "{said}");
    assert!(!said.contains("fix it with"), "{said}");
}

#[test]
fn files_that_belong_to_no_shard_are_named() {
    let folder = all_layers();
    folder.write("out/data/train-000007.tar", "");
    folder.write("out/stats/notes.txt", "");
    folder.write("out/data/.val-000000.lock", "");
    let (said, status) = verify(&folder, "");
    assert_eq!(status, 1);
    assert!(
        said.contains("data/train-000007.tar: belongs to no shard\nstats/notes.txt: belongs to no shard\n"),
        "{said}"
    );
    assert!(!said.contains(".lock"), "{said}");
}

#[test]
fn what_is_no_dataset_is_refused() {
    let folder = Folder::with_job(JOB);
    fs::create_dir(folder.path("empty")).expect("a folder");
    for (command, words) in [
        ("verify empty", "empty is no dataset: there is no job.toml in it"),
        ("verify nowhere", "nowhere is no dataset"),
        ("reproduce empty 1", "empty is no dataset"),
    ] {
        let said = folder.fail(command, 2);
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn a_dataset_can_be_verified_where_its_meshes_are_not() {
    let folder = all_layers();
    fs::remove_file(folder.path("cube.obj")).expect("a mesh");
    assert_eq!(verify(&folder, "").1, 0);
}

#[test]
fn stats_and_manifests_of_a_newer_version_are_refused_by_name_and_stay() {
    let folder = all_layers();
    let newer = |name: &str, key: &str| {
        let before = folder.read(name);
        let mut value = json(&folder, name);
        value[key] = 2.into();
        match value["generator"].is_object() {
            true => value["generator"]["version"] = "3.4.5".into(),
            false => value["generator"] = "3.4.5".into(),
        }
        let text = value.to_string();
        folder.write(name, &text);
        let file = name.strip_prefix("out/").expect("in the dataset");
        for command in ["verify out", "generate job.toml --out out"] {
            let said = folder.fail(command, 2);
            assert!(said.contains(&format!("{file} was written by gelsim 3.4.5")), "{said}");
        }
        assert_eq!(folder.read(name), text);
        folder.write(name, before);
    };
    newer("out/stats/val-000000.json", "stats_version");
    newer("out/dataset.json", "manifest_version");
}

#[test]
fn a_sample_is_reproduced_byte_by_byte_and_a_changed_one_is_told_apart() {
    let folder = all_layers();
    for key in ["0", "000000003", "7"] {
        let output = folder.gelsim(&format!("reproduce out {key}")).assert().success();
        let said = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
        assert!(said.contains(".tactile.png: the same ") && said.ends_with("the same sample\n"), "{said}");
        assert_eq!(said.lines().count(), 10, "nine files and the verdict: {said}");
    }
    forge_shard(&folder, |name, bytes| {
        let mut bytes = bytes.to_vec();
        if name.ends_with("contact.png") {
            *bytes.last_mut().expect("a byte") ^= 1;
        }
        (!name.ends_with("depth.exr")).then_some(bytes)
    });
    let index = members(&folder.path("out/data/test-000000.tar"))[0].name[..9].to_owned();
    let output = folder.gelsim(&format!("reproduce out {index}")).assert().code(1);
    let said = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(
        said.contains(".depth.exr: is not in the shard\n") && said.contains(".contact.png: differs from byte "),
        "{said}"
    );
    assert!(said.contains(".tactile.png: the same ") && said.ends_with("not the same sample\n"), "{said}");
    let said = folder.fail("reproduce out 8", 2);
    assert!(said.contains("there is no sample 8") && said.contains("numbered 0 to 7"), "{said}");
    folder.write("cube.obj", folder.read("cone.obj"));
    let said = folder.fail("reproduce out 0", 2);
    assert!(said.contains("cube.obj has changed"), "{said}");
}

/// Checksums, job and descriptions compared, in this process.
fn is_complete(folder: &Folder) -> bool {
    verify::verify(&folder.path("out"), CheckLevel::Checksums).is_ok_and(|verified| verified.findings.is_empty())
}

#[test]
fn no_byte_of_what_describes_a_dataset_can_be_changed_unnoticed() {
    let folder = all_layers();
    assert!(is_complete(&folder));
    let names =
        ["job.toml", "dataset.json", "wids.json", "README.md", "stats/train-000000.json", "stats/val-000000.json"];
    for name in names {
        let path = folder.path("out").join(name);
        let text = fs::read(&path).expect("a file");
        // Every line, which is every key, and bytes all over them.
        let lines =
            text.iter().enumerate().filter(|(_, byte)| **byte == b'\n').flat_map(|(at, _)| [at, at.saturating_sub(2)]);
        for at in lines.chain((0..text.len()).step_by(23)) {
            let mut changed = text.clone();
            changed[at] ^= if at % 2 == 0 { 1 } else { 0x10 };
            fs::write(&path, &changed).expect("a file");
            assert!(!is_complete(&folder), "byte {at} of {name}");
        }
        for shorter in [&text[..text.len() - 1], &text[1..], b""] {
            fs::write(&path, shorter).expect("a file");
            assert!(!is_complete(&folder), "{} bytes of {name}", shorter.len());
        }
        fs::write(&path, [&text[..], b"\n"].concat()).expect("a file");
        assert!(!is_complete(&folder), "a line more in {name}");
        fs::write(&path, text).expect("a file");
        assert!(is_complete(&folder));
    }
}

#[test]
fn what_stats_count_is_what_labels_say() {
    let folder = all_layers();
    type Edit = fn(&mut Value);
    let edits: [(&str, Edit); 7] = [
        ("unhealthy is 1, the labels have 0", |stats| stats["unhealthy"] = 1.into()),
        ("unconverged is 2, the labels have 0", |stats| stats["unconverged"] = 2.into()),
        ("in_contact is 5, the labels have 2", |stats| stats["in_contact"] = 5.into()),
        ("rejected is 3, the labels have 0", |stats| stats["rejected"] = 3.into()),
        ("classes are ", |stats| stats["classes"] = serde_json::json!({ "unheard_of": 2 })),
        ("light is ", |stats| stats["light"]["outside_mm2"] = 0.5.into()),
        ("effects.shadows.ran is 7", |stats| stats["effects"]["shadows"]["ran"] = 7.into()),
    ];
    let sound = folder.lasting_files("out");
    for (words, edit) in edits {
        edit_stats(&folder, "out", "test-000000", edit);
        folder.succeed("finalize out");
        let (said, status) = verify(&folder, "");
        assert!(status == 1 && said.contains(&format!("stats/test-000000.json: {words}")), "{words} in\n{said}");
        run_named_fixes(&folder, &said);
        assert_same_files(&sound, &folder.lasting_files("out"));
    }
}

/// Runs the commands that verify named, and checks that the dataset is valid and complete then.
fn run_named_fixes(folder: &Folder, said: &str) {
    let (_, commands) = said.split_once("fix it with\n").unwrap_or_else(|| panic!("no cure: {said}"));
    for command in commands.lines().map(str::trim) {
        match command.split_once(' ').expect("a command") {
            ("rm", path) => fs::remove_file(folder.path(path)).expect("a file"),
            ("gelsim", line) => _ = folder.succeed(&line.replace("JOB.toml", "job.toml")),
            _ => panic!("{command}"),
        }
    }
    assert_eq!(verify(folder, "").1, 0, "{}", verify(folder, "").0);
}

#[test]
fn every_finding_has_a_cure_that_mends_it() {
    let folder = all_layers();
    let sound = folder.lasting_files("out");
    let path = |name: &str| folder.path("out").join(name);
    let exchange = |a: &str, b: &str| {
        let [first, second] = [a, b].map(|name| fs::read(path(name)).expect("a file"));
        fs::write(path(a), second).expect("a file");
        fs::write(path(b), first).expect("a file");
    };
    let seed_8 = || {
        folder.succeed("generate job.toml --quiet --out other --seed 8 --overwrite");
        for file in ["data/train-000001.tar", "stats/train-000001.json"] {
            fs::copy(folder.path("other").join(file), path(file)).expect("a file");
        }
    };
    let text = |name: &str, from: &str, to: &str| {
        let before = folder.read(&format!("out/{name}"));
        assert!(before.contains(from), "{from} in {before}");
        folder.write(&format!("out/{name}"), before.replace(from, to));
    };
    type Damage<'a> = (&'a str, Box<dyn Fn() + 'a>);
    let cases: Vec<Damage<'_>> = vec![
        (
            "stats/test-000000.json: is about data/val-000000.tar",
            Box::new(|| {
                edit_stats(&folder, "out", "test-000000", |stats| stats["file"] = "data/val-000000.tar".into());
            }),
        ),
        (
            "stats/train-000000.json: is about data/train-000001.tar",
            Box::new(|| {
                exchange("data/train-000000.tar", "data/train-000001.tar");
                exchange("stats/train-000000.json", "stats/train-000001.json");
            }),
        ),
        ("stats/train-000001.json: is of another job than job.toml", Box::new(seed_8)),
        #[cfg(unix)]
        (
            "stats/train-000001.json: it is a symbolic link",
            Box::new(|| {
                fs::rename(path("stats/train-000001.json"), folder.path("elsewhere.json")).expect("stats");
                std::os::unix::fs::symlink(folder.path("elsewhere.json"), path("stats/train-000001.json"))
                    .expect("a link");
            }),
        ),
        ("data/extra.tar: belongs to no shard", Box::new(|| folder.write("out/data/extra.tar", "more"))),
        (
            "data/train-000099.tar: belongs to no shard",
            Box::new(|| {
                fs::copy(path("data/train-000000.tar"), path("data/train-000099.tar")).expect("a tar");
            }),
        ),
        (
            "stats/test-000000.json: classes are",
            Box::new(|| {
                edit_stats(&folder, "out", "test-000000", |stats| {
                    stats["classes"] = serde_json::json!({ "cube": 1, "cone": 1, "x": 0 })
                });
            }),
        ),
        (
            "README.md: is not what was written, from line 2 on",
            Box::new(|| text("README.md", "pretty_name", "ugly_name")),
        ),
        (
            "dataset.json: says generator.version is \"9.9.9\"",
            Box::new(|| text("dataset.json", concat!("\"", env!("CARGO_PKG_VERSION"), "\""), "\"9.9.9\"")),
        ),
        ("job.toml: is not what was written", Box::new(|| text("job.toml", "\n\n", "\n\n# Mine.\n"))),
        (
            "job.toml: is not what was written, and not the job of its shards",
            Box::new(|| text("job.toml", "seed = 7", "seed = 9")),
        ),
    ];
    for (words, damage) in cases {
        damage();
        let (said, status) = verify(&folder, "");
        assert!(status == 1 && said.contains(words), "{words} in\n{said}");
        run_named_fixes(&folder, &said);
        assert_same_files(&sound, &folder.lasting_files("out"));
    }
}

#[test]
fn a_dataset_that_was_moved_away_from_its_meshes_is_mended_by_the_job_as_it_was_written() {
    let folder = all_layers();
    let sound = folder.lasting_files("out");
    fs::create_dir(folder.path("disk")).expect("a folder");
    fs::rename(folder.path("out"), folder.path("disk/out")).expect("a dataset");
    fs::remove_file(folder.path("disk/out/data/test-000000.tar")).expect("a tar");
    let said = folder.stdout_of("verify disk/out");
    let words = "disk/out/job.toml names files that are not where it says: JOB.toml is the job as you wrote it\n";
    assert!(said.contains(words), "{said}");
    assert!(said.ends_with("fix it with\n  gelsim generate JOB.toml --out disk/out\n"), "{said}");
    folder.succeed("generate job.toml --out disk/out");
    assert_same_files(&sound, &folder.lasting_files("disk/out"));
}

#[test]
fn a_job_that_is_lost_is_written_again_where_shards_know_it() {
    let folder = all_layers();
    let sound = folder.lasting_files("out");
    for damage in [None, Some(""), Some("\u{0}\u{0}"), Some("[dataset]\n")] {
        let job = folder.path("out/job.toml");
        match damage {
            None => fs::remove_file(&job).expect("a file"),
            Some(text) => fs::write(&job, text).expect("a file"),
        }
        let said = folder.fail("generate job.toml --out out --seed 8", 2);
        assert!(said.contains("out holds shards of another job, and its job.toml is "), "{said}");
        let said = folder.succeed("generate job.toml --out out");
        assert!(said.contains("0 samples in 0 shards"), "{said}");
        assert_same_files(&sound, &folder.lasting_files("out"));
    }
}

#[test]
fn strays_end_generate_and_finalize_with_status_1() {
    let folder = all_layers();
    folder.write("out/data/train-000099.tar", "");
    for command in ["generate job.toml --out out", "generate job.toml --out out --partition 0/2"] {
        let said = folder.fail(command, 1);
        assert!(said.contains("data/train-000099.tar: belongs to no shard"), "{said}");
    }
    let output = folder.gelsim("finalize out").assert().code(1);
    let said = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(
        said.contains("data/train-000099.tar: belongs to no shard") && said.contains("rm out/data/train-000099.tar"),
        "{said}"
    );
    fs::remove_file(folder.path("out/data/train-000099.tar")).expect("a file");
    folder.succeed("generate job.toml --out out");
}
