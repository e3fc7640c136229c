//! What a run writes: files, members, labels, manifest, index, card, and the job that makes the same bytes again.

use std::collections::BTreeSet;

use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::support::{Folder, JOB, assert_same_files, edited, exr_planes, json, members};

const EVERY_LAYER: (&str, &str) =
    ("[\"depth\", \"contact\"]", "[\"reference\", \"normal\", \"contact\", \"surface\", \"depth\"]");

#[test]
fn a_dataset_has_the_files_of_the_contract_and_no_others() {
    let folder = Folder::with_job(JOB);
    let said = folder.succeed("generate job.toml");
    assert!(said.contains("8 samples in 4 shards") && said.contains("out/small"), "{said}");
    let names: Vec<String> = folder.files("out/small").into_keys().collect();
    let expected = [
        "README.md",
        "data/test-000000.tar",
        "data/train-000000.tar",
        "data/train-000001.tar",
        "data/val-000000.tar",
        "dataset.json",
        "job.toml",
        "stats/test-000000.json",
        "stats/train-000000.json",
        "stats/train-000001.json",
        "stats/val-000000.json",
        "wids.json",
    ];
    assert_eq!(names, expected);
}

#[test]
fn a_shard_holds_only_members_of_samples_in_order_without_time_and_owner() {
    let folder = Folder::with_job(&edited(JOB, &[EVERY_LAYER]));
    folder.succeed("generate job.toml --quiet");
    let mut indices = BTreeSet::new();
    for file in folder.files("out/small/data").into_keys() {
        let members = members(&folder.path("out/small/data").join(file));
        let suffixes =
            ["tactile.png", "depth.exr", "surface.exr", "contact.png", "normal.exr", "reference.png", "json"];
        let mut keys = Vec::new();
        for sample in members.chunks(suffixes.len()) {
            let key = sample[0].name.split('.').next().expect("a key").to_owned();
            let names: Vec<String> = sample.iter().map(|member| member.name.clone()).collect();
            assert_eq!(names, suffixes.map(|suffix| format!("{key}.{suffix}")));
            assert!(key.len() == 9 && key.bytes().all(|digit| digit.is_ascii_digit()), "{key}");
            let label: Value = serde_json::from_slice(&sample[suffixes.len() - 1].bytes).expect("a label");
            assert_eq!(
                (&label["key"], &label["index"]),
                (&key.as_str().into(), &key.parse::<u64>().expect("digits").into())
            );
            assert!(indices.insert(key.clone()), "{key} is in two shards");
            keys.push(key);
        }
        assert!(keys.is_sorted(), "{keys:?}");
        for member in &members {
            let header = &member.header;
            assert_eq!(header.mtime().expect("a time"), 0);
            assert_eq!(header.mode().expect("a mode"), 0o644);
            assert_eq!((header.uid().expect("an owner"), header.gid().expect("a group")), (0, 0));
            assert!(header.username().expect("text").unwrap_or_default().is_empty());
            assert!(header.entry_type().is_file());
        }
    }
    assert_eq!(indices, (0..8).map(|index| format!("{index:09}")).collect());
}

#[test]
fn layers_have_the_sizes_and_channels_of_the_contract() {
    let folder = Folder::with_job(&edited(JOB, &[EVERY_LAYER]));
    folder.succeed("generate job.toml --quiet");
    for members in folder.samples("out/small").values() {
        for (suffix, color) in [
            ("tactile.png", image::ColorType::Rgb8),
            ("reference.png", image::ColorType::Rgb8),
            ("contact.png", image::ColorType::L8),
        ] {
            let picture = image::load_from_memory(&members[suffix]).expect("a PNG");
            assert_eq!((picture.width(), picture.height(), picture.color()), (48, 36, color), "{suffix}");
        }
        let contact = image::load_from_memory(&members["contact.png"]).expect("a PNG").into_luma8();
        assert!(contact.pixels().all(|pixel| matches!(pixel.0, [0 | 255])));
        for (suffix, channels) in [("depth.exr", &["Z"][..]), ("surface.exr", &["Z"]), ("normal.exr", &["X", "Y", "Z"])]
        {
            let planes = exr_planes(&members[suffix]);
            let names: Vec<&str> = planes.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, channels, "{suffix}");
            assert!(planes.iter().all(|(_, plane)| plane.len() == 48 * 36 && plane.iter().all(|v| v.is_finite())));
        }
    }
}

#[test]
fn the_depth_layer_agrees_with_the_label() {
    for pixel in ["half", "float"] {
        let folder = Folder::with_job(JOB);
        folder.succeed(&format!("generate job.toml --quiet --set output.exr.pixel=\"{pixel}\""));
        for members in folder.samples("out/small").values() {
            let label: Value = serde_json::from_slice(&members["json"]).expect("a label");
            let deepest = label["contact"]["max_depth_mm"].as_f64().expect("a number");
            let (_, plane) = exr_planes(&members["depth.exr"]).remove(0);
            assert!(plane.iter().all(|mm| *mm >= 0.0));
            let found = f64::from(plane.into_iter().fold(0.0_f32, f32::max));
            // Half a unit in the last place of 11 bits.
            let rounding = if pixel == "half" { deepest / 2048.0 } else { 0.0 };
            assert!((found - deepest).abs() <= rounding, "{found} in the layer, {deepest} in the label");
        }
    }
}

#[test]
fn a_sample_without_contact_is_the_untouched_pad() {
    let folder = Folder::with_job(&edited(JOB, &[EVERY_LAYER, ("no_contact = 0.25", "no_contact = 0.5")]));
    folder.succeed("generate job.toml --quiet");
    let mut without = 0;
    for members in folder.samples("out/small").values() {
        let label: Value = serde_json::from_slice(&members["json"]).expect("a label");
        let contact = &label["contact"];
        if contact["in_contact"] == true {
            assert_ne!(members["tactile.png"], members["reference.png"]);
            assert!(contact["area_mm2"].as_f64().expect("a number") > 0.0);
            continue;
        }
        without += 1;
        assert_eq!(members["tactile.png"], members["reference.png"]);
        assert_eq!(label["indentation_depth_mm"], 0.0);
        for key in ["area_mm2", "fraction", "max_depth_mm"] {
            assert_eq!(contact[key], 0.0, "{key}");
        }
        assert_eq!(contact["centroid_mm"], serde_json::json!([0.0, 0.0]));
        assert_eq!(contact["bbox_px"], serde_json::json!([0, 0, 0, 0]));
        assert!(exr_planes(&members["depth.exr"])[0].1.iter().all(|mm| *mm == 0.0));
    }
    assert!((1..8).contains(&without), "{without} of 8 without contact, about half were asked for");
}

#[test]
fn the_share_without_contact_is_met_at_its_ends() {
    for (share, touching) in [("0.0", true), ("1.0", false)] {
        let folder = Folder::with_job(JOB);
        folder.succeed(&format!("generate job.toml --quiet --set indentation.no_contact={share} --set pose.x_mm=0"));
        for label in folder.labels("out/small").values() {
            assert_eq!(label["contact"]["in_contact"], touching);
        }
    }
}

#[test]
fn labels_have_one_set_of_keys_and_a_decimal_point_in_every_float() {
    // Numbers that JSON writers like to shorten.
    let edits = [
        ("yaw_deg = [0.0, 360.0]", "yaw_deg = 1e-7"),
        ("[0.0, 8.0]", "[0.0, 0.0]"),
        ("no_contact = 0.25", "no_contact = 0.5"),
    ];
    let mut jobs = vec![JOB.to_owned(), edited(JOB, &edits)];
    jobs.push(edited(JOB, &[("[sensor]", "[sensor]\npreset = \"digit\"\ngelpad_youngs_modulus_kpa = 1e9")]));
    jobs.push(edited(JOB, &[("[dataset]", "fidelity = \"paper\"\n[dataset]")]));
    let mut all_keys = BTreeSet::new();
    let mut states = BTreeSet::new();
    for job in jobs {
        let folder = Folder::with_job(&job);
        folder.succeed("generate job.toml --quiet --samples 24");
        for members in folder.samples("out/small").values() {
            let text = std::str::from_utf8(&members["json"]).expect("UTF-8");
            let fields = fields(text);
            let label: Value = serde_json::from_str(text).expect("JSON");
            states.insert((label["contact"]["in_contact"] == true, label["object"]["class"].to_string()));
            for (path, token) in &fields {
                let kind = match token.as_bytes()[0] {
                    b'-' | b'0'..=b'9' if INTEGERS.contains(&path.as_str()) => "integer",
                    b'-' | b'0'..=b'9' => "float",
                    _ => "other",
                };
                match kind {
                    "integer" => assert!(!token.contains(['.', 'e']), "{path}: {token} is a whole number"),
                    "float" => assert!(token.contains('.'), "{path}: {token} has no decimal point"),
                    _ => assert!(!INTEGERS.contains(&path.as_str()), "{path}: {token} should be a number"),
                }
                let unknown = label["gelpad_model"] == "mean_blur" && NULLS.contains(&path.as_str());
                // The light of the preset was fitted to pictures.
                let is_fitted = label["numerics"]["light_error_unknown"] != "";
                let unknown = unknown || (is_fitted && path == "numerics.light_error_levels");
                // Nobody said anything of it.
                let unknown = unknown || path.starts_with("object.material.");
                assert_eq!(token == "null", unknown, "{path}: {token}");
            }
            // A list has as many elements as the sensor has LEDs.
            let is_key = |segment: &&str| segment.parse::<usize>().is_err();
            let key = |path: &str| path.split('.').filter(is_key).collect::<Vec<_>>().join(".");
            all_keys.insert(fields.iter().map(|(path, _)| key(path)).collect::<BTreeSet<_>>());
        }
    }
    assert_eq!(states.len(), 4, "both objects, with and without contact, must have been seen: {states:?}");
    assert_eq!(all_keys.len(), 1, "{all_keys:#?}");
    let keys = all_keys.pop_first().expect("labels");
    for key in LEAST_KEYS {
        assert!(keys.iter().any(|known| known == key || known.starts_with(&format!("{key}."))), "{key} in {keys:#?}");
    }
}

const INTEGERS: &[&str] = &[
    "schema_version",
    "markers.count",
    "index",
    "seed",
    "attempt",
    "object.class_index",
    "objects.0.class_index",
    "objects.0.contact.bbox_px.0",
    "objects.0.contact.bbox_px.1",
    "objects.0.contact.bbox_px.2",
    "objects.0.contact.bbox_px.3",
    "unplaced_objects",
    "sensor.width_px",
    "sensor.height_px",
    "contact.bbox_px.0",
    "contact.bbox_px.1",
    "contact.bbox_px.2",
    "contact.bbox_px.3",
    "numerics.iterations",
    "numerics.strain_iterations",
    "health.clipped_px",
    "health.saturated_px",
    "health.over_thickness_px",
    "health.unseen_px",
    "png16.surface_zero",
];

/// What a blur does not know.
const NULLS: &[&str] = &[
    "contact.force_n",
    "objects.0.contact.force_n",
    "contact.total_force_n",
    "contact.total_force_at_least_n",
    "contact.peak_pressure_kpa",
    "numerics.residual_um",
    "numerics.model_error_um",
];

/// The keys that the contract promises.
const LEAST_KEYS: &[&str] = &[
    "schema_version",
    "markers.count",
    "key",
    "index",
    "seed",
    "attempt",
    "split",
    "object.id",
    "object.class",
    "object.class_index",
    "object.mesh_sha256",
    "object.path",
    "object.scale",
    "object.material.youngs_modulus_kpa",
    "object.material.poisson_ratio",
    "object.material.friction",
    "pose.quaternion_xyzw",
    "pose.translation_mm",
    "pose.yaw_deg",
    "pose.tilt_deg",
    "pose.tilt_azimuth_deg",
    "indentation_depth_mm",
    "objects.id",
    "objects.pose.quaternion_xyzw",
    "objects.contact.force_n",
    "unplaced_objects",
    "texture",
    "sensor.name",
    "sensor.width_px",
    "sensor.height_px",
    "sensor.mm_per_px",
    "sensor.gelpad_thickness_mm",
    "sensor.gelpad_youngs_modulus_kpa",
    "sensor.gelpad_poisson_ratio",
    "contact.in_contact",
    "contact.area_mm2",
    "contact.fraction",
    "contact.centroid_mm",
    "contact.centroid_px",
    "contact.equivalent_radius_mm",
    "contact.equivalent_radius_px",
    "contact.bbox_px",
    "contact.max_depth_mm",
    "contact.force_n",
    "contact.total_force_n",
    "contact.total_force_at_least_n",
    "contact.force_unknown",
    "contact.cut_by_view",
    "contact.in_view_fraction",
    "contact.peak_pressure_kpa",
    "fidelity",
    "gelpad_model",
    "optics_model",
    "effects.deformation.ran",
    "effects.shading.reason",
    "numerics.converged",
    "numerics.iterations",
    "numerics.residual_um",
    "numerics.strain",
    "numerics.model_error_um",
    "numerics.theory",
    "numerics.opened_mm",
    "numerics.strain_iterations",
    "numerics.strain_residual_um",
    "health.finite",
    "health.clipped_px",
    "health.saturated_px",
    "health.over_thickness_px",
    "health.unseen_px",
];

#[test]
fn the_manifest_adds_up() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet");
    let manifest = json(&folder, "out/small/dataset.json");
    assert_eq!(manifest["generator"]["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(manifest["splits"], serde_json::json!({ "test": 2, "train": 4, "val": 2 }));
    let labels = folder.labels("out/small");
    assert_eq!(manifest["samples"], labels.len());
    for class in manifest["classes"].as_array().expect("a list") {
        let count = labels.values().filter(|label| label["object"]["class"] == class["name"]).count();
        assert_eq!(class["samples"], count, "{class}");
    }
    for (split, samples) in manifest["splits"].as_object().expect("a table") {
        let count = labels.values().filter(|label| label["split"] == split.as_str()).count();
        assert_eq!(*samples, count, "{split}");
    }
    let shards = manifest["shards"].as_array().expect("a list");
    let index = json(&folder, "out/small/wids.json");
    assert_eq!((&index["__kind__"], &index["wids_version"]), (&"wids-shard-index-v1".into(), &1.into()));
    let indexed = index["shardlist"].as_array().expect("a list");
    assert_eq!(shards.len(), indexed.len());
    let order: Vec<&str> = shards.iter().filter_map(|shard| shard["split"].as_str()).collect();
    assert_eq!(order, ["train", "train", "val", "test"]);
    for (shard, indexed) in shards.iter().zip(indexed) {
        let file = shard["file"].as_str().expect("a name");
        let bytes = &folder.files("out/small")[file];
        let samples =
            members(&folder.path("out/small").join(file)).iter().filter(|m| m.name.ends_with(".json")).count();
        let sha256: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(shard["samples"], samples);
        assert_eq!(shard["bytes"], bytes.len());
        assert_eq!(shard["sha256"], sha256);
        assert_eq!(
            (&indexed["url"], &indexed["nsamples"], &indexed["filesize"]),
            (&shard["file"], &shard["samples"], &shard["bytes"])
        );
    }
}

#[test]
fn the_stats_of_a_shard_count_samples_seconds_and_effects() {
    let folder = Folder::with_job(&edited(JOB, &[("no_contact = 0.25", "no_contact = 0.0")]));
    folder.succeed("generate job.toml --quiet");
    let mut total = 0;
    for file in folder.files("out/small/stats").into_keys() {
        let stats = json(&folder, &format!("out/small/stats/{file}"));
        let samples = stats["samples"].as_u64().expect("a count");
        total += samples;
        assert_eq!(stats["rejected"], 0);
        let seconds = stats["seconds"].as_object().expect("a table");
        for stage in ["scene", "depth", "gelpad", "optics", "camera", "label", "encode"] {
            assert!(seconds[stage].as_f64().is_some_and(|s| s >= 0.0), "{stage} in {seconds:?}");
        }
        for (effect, count) in stats["effects"].as_object().expect("a table") {
            let sum = count["ran"].as_u64().zip(count["skipped"].as_u64()).map(|(ran, skipped)| ran + skipped);
            assert_eq!(sum, Some(samples), "{effect}");
        }
        assert_eq!(stats["effects"]["deformation"]["ran"], samples, "every sample touches here");
    }
    assert_eq!(total, 8);
}

#[test]
fn files_about_the_whole_name_no_time_host_or_absolute_path() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet");
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    for name in ["README.md", "dataset.json", "wids.json", "job.toml"] {
        let text = folder.read(&format!("out/small/{name}"));
        let temporary = folder.path("").to_string_lossy().trim_end_matches('/').to_owned();
        assert!(!text.contains(&temporary), "{name} holds {temporary}");
        assert!(host.trim().len() < 4 || !text.contains(host.trim()), "{name} holds the host's name");
        assert!(!text.contains("\"/") && !text.contains(" /"), "{name} holds an absolute path");
    }
    assert!(folder.read("out/small/job.toml").contains("path = \"../../cube.obj\""));
}

#[test]
fn the_card_tells_a_reader_files_and_types() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet");
    let card = folder.read("out/small/README.md");
    let front = card.strip_prefix("---\n").and_then(|rest| rest.split_once("\n---\n")).expect("front matter").0;
    for split in ["train", "val", "test"] {
        assert!(front.contains(&format!("  - {{split: {split}, path: data/{split}-*.tar}}")), "{front}");
    }
    for column in ["__key__", "__url__", "tactile.png", "depth.exr", "contact.png", "json"] {
        assert!(front.contains(&format!("\n  - {{name: {column}, ")), "{column} in\n{front}");
    }
    // Null in every sample of this dataset, a number all the same.
    for name in ["force_n", "total_force_n", "in_view_fraction"] {
        assert!(front.contains(&format!("{{name: {name}, dtype: float64}}")), "{name} in {front}");
    }
    let lines = card.lines().take_while(|line| !line.starts_with("# ")).count();
    assert!(lines < 25, "{lines} lines before the title");
    assert!(!front.contains("reference.png"), "only what the dataset has");
}

#[test]
fn the_resolved_job_makes_the_same_bytes_again() {
    let folder = Folder::new();
    let background = image::RgbImage::from_fn(30, 20, |x, y| image::Rgb([90 + x as u8, 100, 110 + y as u8]));
    background.save(folder.path("pad.png")).expect("a picture");
    let edits = [
        EVERY_LAYER,
        ("[sensor]", "[sensor]\nfile = \"mine.toml\"\nbackground = \"pad.png\""),
        ("\"cube.obj\"", "\"c*.obj\"\nunit = \"mm\""),
        ("[dataset]", "optics = \"phong\"\n[gelpad.mean_blur]\npasses = 2\n[dataset]\nsplit_by = \"object\""),
    ];
    folder.write("mine.toml", "preset = \"digit\"\ngelpad_thickness_mm = 1.5\n[rendered_background]\ngrain = 0.0\n");
    folder.write("job.toml", edited(JOB, &edits).replace("val = 0.25, test = 0.25", "val = 0.0, test = 0.5"));
    folder.succeed("generate job.toml --quiet --out first --set pose.face=\"any\" --seed 11");
    folder.succeed("generate first/job.toml --quiet --out deep/second");
    let (mut first, mut second) = (folder.lasting_files("first"), folder.lasting_files("deep/second"));
    // Of these only the relative paths differ, by the deeper folder.
    let jobs = [&mut first, &mut second]
        .map(|files| String::from_utf8(files.remove("job.toml").expect("a job")).expect("text"));
    let unsealed = |job: &str| job.lines().filter(|line| !line.starts_with("# SHA-256")).collect::<Vec<_>>().join("\n");
    assert_eq!(unsealed(&jobs[0]).replace("\"../", "\"../../"), unsealed(&jobs[1]));
    assert_same_files(&first, &second);
}

#[test]
fn a_linked_mesh_keeps_the_name_of_its_link() {
    let folder = Folder::with_job(&edited(JOB, &[("\"cube.obj\"", "\"box.obj\"")]));
    #[cfg(unix)]
    std::os::unix::fs::symlink("cube.obj", folder.path("box.obj")).expect("a link");
    #[cfg(not(unix))]
    std::fs::copy(folder.path("cube.obj"), folder.path("box.obj")).map(|_| ()).expect("a copy");
    folder.succeed("generate job.toml --quiet --out first");
    folder.succeed("generate first/job.toml --quiet --out second");
    assert_same_files(&folder.files("first/data"), &folder.files("second/data"));
}

#[test]
fn a_job_overrides_single_keys_of_the_tables_of_its_sensor() {
    let edits = [("[sensor]", "[sensor]\npreset = \"digit\"\nrendered_background.grain = 0.5")];
    let folder = Folder::with_job(&edited(JOB, &edits));
    folder.succeed("generate job.toml --quiet");
    let resolved: toml::Table = folder.read("out/small/job.toml").parse().expect("TOML");
    let preset: toml::Table = gelsim_files::sensor::PRESETS[3].1.parse().expect("TOML");
    let (look, expected) = (&resolved["sensor"]["rendered_background"], &preset["rendered_background"]);
    assert_eq!(look["grain"].as_float(), Some(0.5));
    assert_eq!(look["color"], expected["color"]);
    assert_eq!(resolved["sensor"]["led"], preset["led"]);
    assert_eq!(resolved["sensor"]["name"].as_str(), Some("digit"));
}

#[test]
fn what_stands_nearer_to_the_user_overrides_what_is_further_away() {
    let edits = [
        ("[sensor]", "[sensor]\nfile = \"mine.toml\"\ngelpad_poisson_ratio = 0.3"),
        ("resolution_px = [48, 36]\n", ""),
    ];
    let folder = Folder::with_job(&edited(JOB, &edits));
    folder.write(
        "mine.toml",
        "preset = \"digit\"\nresolution_px = [24, 18]\ngelpad_poisson_ratio = 0.4\ngelpad_youngs_modulus_kpa = 99\n",
    );
    folder.succeed("generate job.toml --quiet --set sensor.gelpad_youngs_modulus_kpa=77 --samples 2");
    let resolved: toml::Table = folder.read("out/small/job.toml").parse().expect("TOML");
    let sensor = &resolved["sensor"];
    assert_eq!(sensor["gelpad_youngs_modulus_kpa"].as_float(), Some(77.0), "command line over sensor file");
    assert_eq!(sensor["gelpad_poisson_ratio"].as_float(), Some(0.3), "job over sensor file");
    assert_eq!(sensor["resolution_px"].as_array().map(Vec::len), Some(2));
    assert_eq!(sensor["resolution_px"][0].as_integer(), Some(24), "sensor file over preset");
    assert_eq!(sensor["name"].as_str(), Some("digit"), "preset where the sensor file is silent");
    assert_eq!(resolved["dataset"]["samples"].as_integer(), Some(2));
}

#[test]
fn a_level_of_the_command_line_chooses_numerics_and_refuses_what_contradicts_it() {
    let with = |gelpad: &str| Folder::with_job(&edited(JOB, &[("[dataset]", &format!("{gelpad}\n[dataset]"))]));
    let resolved = |folder: &Folder| folder.read("out/job.toml").parse::<toml::Table>().expect("TOML");

    // Friction is physics and stays; the grid is the level's.
    let folder = with("[gelpad.elastic]\nfriction = \"stick\"");
    folder.succeed("generate job.toml --quiet --out out --fidelity high");
    let elastic = resolved(&folder)["gelpad"]["elastic"].clone();
    assert_eq!(elastic["friction"].as_str(), Some("stick"), "{elastic}");
    assert_eq!(elastic["resolution"].as_str(), Some("full"), "{elastic}");

    // What says other numerics than the level is refused, with both places.
    for (gelpad, level, key, line) in [
        ("[gelpad.elastic]\nresolution = \"quarter\"", "high", "gelpad.elastic.resolution", 3),
        ("[gelpad.elastic]\ntolerance_um = 9.0", "high", "gelpad.elastic.tolerance_um", 3),
        ("[gelpad.elastic]\nmax_iterations = 3", "standard", "gelpad.elastic.max_iterations", 3),
        ("[gelpad.elastic]\nfriction = \"stick\"", "paper", "gelpad.elastic.friction", 3),
        ("[gelpad.mean_blur]\npasses = 1", "paper", "gelpad.mean_blur", 2),
        ("[gelpad.mean_blur]\npasses = 1", "high", "gelpad", 2),
    ] {
        let folder = with(gelpad);
        for command in ["generate job.toml --quiet --out out", "plan job.toml", "preview job.toml --out sheet.png"] {
            let said = folder.fail(&format!("{command} --fidelity {level}"), 2);
            let before = JOB.lines().position(|line| line == "[dataset]").expect("a table");
            assert!(said.contains(&format!("--fidelity {level}")) && said.contains(&format!("`{key}`")), "{said}");
            assert!(said.contains(&format!("job.toml:{}:", before + line - 1)), "{said}");
            assert!(!folder.path("out").exists() && !folder.path("sheet.png").exists());
        }
        // Either remedy leads on.
        folder.succeed("generate job.toml --quiet --out out");
    }
}

#[test]
fn objects_of_one_split_are_in_no_other_where_objects_are_split() {
    let edits =
        [("seed = 7", "split_by = \"object\""), ("train = 0.5, val = 0.25, test = 0.25", "train = 0.5, test = 0.5")];
    let folder = Folder::with_job(&edited(JOB, &edits));
    folder.succeed("generate job.toml --quiet --samples 24");
    let labels = folder.labels("out/small");
    let pairs: BTreeSet<(String, String)> =
        labels.values().map(|label| (label["object"]["id"].to_string(), label["split"].to_string())).collect();
    assert_eq!(pairs.len(), 2, "{pairs:?}");
    assert_eq!(pairs.iter().map(|(object, _)| object).collect::<BTreeSet<_>>().len(), 2, "{pairs:?}");
}

/// Every value of a JSON text with its dotted path and its characters as they are written.
fn fields(text: &str) -> Vec<(String, String)> {
    fn value(rest: &mut &str, path: &str, found: &mut Vec<(String, String)>) {
        let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
        match rest.as_bytes()[0] {
            b'{' => {
                while !rest.starts_with('}') {
                    *rest = &rest[1..];
                    let key = token(rest);
                    *rest = rest.strip_prefix(':').expect("a colon");
                    value(rest, &below(key.trim_matches('"')), found);
                }
                *rest = &rest[1..];
            }
            b'[' => {
                found.push((path.to_owned(), String::from("[]")));
                let mut number = 0;
                if let Some(after) = rest.strip_prefix("[]") {
                    *rest = after;
                    return;
                }
                while !rest.starts_with(']') {
                    *rest = &rest[1..];
                    value(rest, &below(&number.to_string()), found);
                    number += 1;
                }
                *rest = &rest[1..];
            }
            _ => found.push((path.to_owned(), token(rest))),
        }
    }
    fn token(rest: &mut &str) -> String {
        let end = match rest.strip_prefix('"') {
            Some(inside) => inside.find('"').expect("text ends") + 2,
            None => rest.find([',', '}', ']']).expect("a value ends"),
        };
        let (token, after) = rest.split_at(end);
        *rest = after;
        token.to_owned()
    }
    let mut found = Vec::new();
    let mut rest = text;
    value(&mut rest, "", &mut found);
    assert!(rest.is_empty(), "{rest:?} after the label");
    found
}

#[test]
fn objects_take_the_places_of_a_grid_in_turn() {
    let grid = "grid = { columns = 3, rows = 2, step_mm = [4.0, 3.0] }\nanchor = \"origin\"";
    let text = edited(
        JOB,
        &[
            ("samples = 8", "samples = 14\nobject_order = \"in_turn\""),
            ("splits = { train = 0.5, val = 0.25, test = 0.25 }", ""),
            ("x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }\ny_mm = [-2.0, 2.0]", grid),
        ],
    );
    let folder = Folder::with_job(&text);
    folder.succeed("generate job.toml --quiet");
    let places = [[-4.0, -1.5], [0.0, -1.5], [4.0, -1.5], [-4.0, 1.5], [0.0, 1.5], [4.0, 1.5], [-4.0, -1.5]];
    for (number, label) in folder.labels("out/small").values().enumerate() {
        assert_eq!(label["object"]["id"], ["cube", "cone"][number % 2]);
        let at = |k: usize| label["pose"]["translation_mm"][k].as_f64().expect("a number");
        let [x, y] = places[number / 2];
        assert!((at(0) - x).abs() < 1e-9 && (at(1) - y).abs() < 1e-9, "{number}: {} {}", at(0), at(1));
    }
    // At random by weight, each sample takes the next place.
    folder.write("job.toml", edited(&text, &[("object_order = \"in_turn\"", "")]));
    folder.succeed("generate job.toml --quiet --out weighted");
    let labels = folder.labels("weighted");
    let at = |number: usize| labels.values().nth(number).expect("a sample")["pose"]["translation_mm"][0].as_f64();
    assert_eq!([0, 1, 2, 3].map(at), [-4.0, 0.0, 4.0, -4.0].map(Some));

    let several = edited(&text, &[("[pose]", "[scene]\nobjects_per_sample = 2\n[pose]")]);
    folder.write("job.toml", several);
    assert!(folder.fail("generate job.toml --out several", 2).contains("a grid of places for one of several objects"));
    folder.write("job.toml", edited(&text, &[("columns = 3", "columns = 0")]));
    assert!(folder.fail("generate job.toml --out none", 2).contains("columns = 0 is out of range"));
}
