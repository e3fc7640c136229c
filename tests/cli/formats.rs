//! `[output] depth_format` and `container`: the same samples in every format and container; a shard that is a folder is
//! as complete, as reproducible and as well looked after as one that is a tar.

use gelsim_dataset::container::ShardContainer;
use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use gelsim_dataset::archive::Member;
use gelsim_dataset::archive::SampleFiles;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_dataset::{decode, verify};
use gelsim_files::{npy, png};
use gelsim_job::config::output::Container;
use gelsim_job::label::Label;
use gelsim_job::layers::{DepthFormat, OutputLayer};

use crate::support::{Folder, JOB, assert_same_files, edited, json, members};

/// The job of [`JOB`] with all float layers, to nearly the pad's back, and other lines in `[output]`.
fn job(output: &str) -> Folder {
    let layers = "layers = [\"depth\", \"contact\"]";
    let all = format!("layers = [\"depth\", \"surface\", \"contact\", \"normal\", \"pressure\"]\n{output}");
    Folder::with_job(&edited(JOB, &[(layers, &all), ("[0.3, 1.2]", "[0.3, 2.95]")]))
}

fn folders() -> Folder {
    let folder = job("container = \"folder\"");
    folder.succeed("generate job.toml --quiet --out out");
    folder
}

/// All samples of a dataset, whatever its container.
fn samples(folder: &Folder, name: &str) -> Vec<SampleFiles> {
    let recorded = RecordedDataset::open(&folder.path(name)).expect("a dataset");
    let mut found = Vec::new();
    for number in 0..recorded.layout.shard_count() {
        let paths = recorded.shard_paths(&recorded.layout.shard(number));
        let read = paths.container.visit_samples(
            &paths.data,
            |_| true,
            |files| {
                found.push(files);
                ControlFlow::Continue(())
            },
        );
        assert_eq!(read, Ok(()));
    }
    found
}

fn label(files: &SampleFiles) -> Label {
    serde_json::from_slice(files.find_member("json").expect("a label")).expect("a label")
}

/// The planes of a sample's float layer.
fn planes(files: &SampleFiles, layer: OutputLayer, format: DepthFormat) -> Vec<(String, Vec<f32>)> {
    let bytes = files.find_member(&layer.file_suffix(format)).unwrap_or_else(|| panic!("{}: no {layer:?}", files.key));
    let planes = decode::decode_planes(layer, layer.coding_for(format), bytes, &label(files).png16).expect("readable");
    assert_eq!((planes.width, planes.height), (48, 36));
    planes.channels
}

/// What verify prints, and its exit status.
fn verify_output(folder: &Folder, name: &str) -> (String, i32) {
    let output = folder.gelsim(&format!("verify {name}")).output().expect("it runs");
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    (String::from_utf8_lossy(&output.stdout).into_owned(), output.status.code().expect("an exit status"))
}

#[test]
fn every_format_holds_the_layers_of_the_floats_and_is_verified_reproduced_and_shown() {
    let folder = job("exr = { pixel = \"float\" }");
    for format in DepthFormat::ALL.map(DepthFormat::name) {
        folder.succeed(&format!("generate job.toml --quiet --out {format} --set output.depth_format=\"{format}\""));
        let (said, status) = verify_output(&folder, format);
        assert_eq!(status, 0, "{said}");
        folder.gelsim(&format!("reproduce {format} 3")).assert().success();
        folder.succeed(&format!("preview {format} --out {format}.png"));
        assert_eq!(json(&folder, &format!("{format}/dataset.json"))["depth_format"], format);
    }
    assert_eq!(folder.read_bytes("exr.png"), folder.read_bytes("npy.png"), "the same picture");

    let floats = [OutputLayer::Depth, OutputLayer::Surface, OutputLayer::Normal, OutputLayer::Pressure];
    let (mut deepest, mut clear) = (0.0, 0);
    for exact in samples(&folder, "exr") {
        let index = exact.key.parse().expect("a number");
        for format in [DepthFormat::Npy, DepthFormat::Png16] {
            let other =
                RecordedDataset::open(&folder.path(format.name())).expect("a dataset").read_sample(index).expect("one");
            let steps = label(&other).png16;
            for layer in floats {
                let expected = planes(&exact, layer, DepthFormat::Exr);
                let found = planes(&other, layer, format);
                let half_step = match (format, layer) {
                    (DepthFormat::Png16, OutputLayer::Depth) => 0.5 * steps.depth_mm_per_step,
                    (DepthFormat::Png16, OutputLayer::Surface) => 0.5 * steps.surface_mm_per_step,
                    _ => 0.0,
                };
                // 3 mm in 65535 steps, or in 32767 above 0.
                assert!(half_step < 5e-5, "{half_step} mm");
                for ((name, expected), (other, found)) in expected.iter().zip(&found) {
                    assert_eq!(name, other);
                    let most = expected.iter().zip(found).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
                    assert!(most <= half_step * 1.01, "{} {layer:?} {format:?}: {most} mm", exact.key);
                }
            }
        }
        deepest = label(&exact).contact.max_depth_mm.max(deepest);
        clear += u32::from(!label(&exact).contact.in_contact);
        assert_eq!(label(&exact).png16, Default::default());
    }
    assert!(deepest > 2.0 && clear > 0, "no hard case: {deepest} mm, {clear} without contact");
}

/// Exact names: what a reader of tars makes of them depends on their ends.
#[test]
fn members_are_named_by_their_format() {
    let folder = job("");
    for (format, expected) in [
        ("npy", ["tactile.png", "depth.npy", "surface.npy", "contact.png", "normal.npy", "pressure.npy", "json"]),
        ("png16", ["tactile.png", "depth.png16", "surface.png16", "contact.png", "normal.exr", "pressure.exr", "json"]),
    ] {
        folder.succeed(&format!("generate job.toml --quiet --out {format} --set output.depth_format=\"{format}\""));
        let members = members(&folder.path(&format!("{format}/data/val-000000.tar")));
        let suffixes: Vec<&str> = members.iter().map(|member| &member.name[10..]).take(7).collect();
        assert_eq!(suffixes, expected);
        assert_eq!(json(&folder, &format!("{format}/dataset.json"))["layers"].as_array().map(Vec::len), Some(5));
    }
}

#[test]
fn a_layer_that_is_not_in_the_jobs_format_is_named() {
    let floats = |channels: usize, value: f32| npy::encode(48, 36, &vec![&[value; 48 * 36][..]; channels]);
    let doubles = {
        let text = "{'descr': '<f8', 'fortran_order': False, 'shape': (36, 48), }";
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.resize(bytes.len() + 8 * 48 * 36, 0);
        bytes
    };
    let steps = |value: u16| png::encode_grey16(48, 36, &[value; 48 * 36]);
    let cases: [(&str, &str, Vec<u8>, &str); 9] = [
        ("npy", "depth.npy", floats(1, f32::NAN), "depth.npy: channel Z is NaN in column 0, row 0"),
        ("npy", "depth.npy", floats(1, -0.5), "depth.npy: channel Z is -0.5 in column 0, row 0"),
        ("npy", "depth.npy", floats(3, 0.5), "depth.npy: is of shape [36, 48, 3], not rows and columns of 1 values"),
        ("npy", "normal.npy", floats(1, 0.5), "normal.npy: is of shape [36, 48], not rows and columns of 3 values"),
        ("npy", "surface.npy", doubles, "surface.npy: its values are of type `<f8`, not `<f4`"),
        ("npy", "depth.npy", npy::encode(2, 1, &[&[0.0; 2]]), "depth.npy: is 2x1 px, not 48x36"),
        ("png16", "depth.png16", png::encode_grey(48, 36, &[0; 48 * 36]), "is 48x36 px L8, not 48x36 L16"),
        ("png16", "surface.png16", steps(0), "surface.png16: is not finite in column 0, row 0"),
        ("png16", "depth.png16", png::encode_grey16(1, 1, &[0]), "is 1x1 px L16, not 48x36 L16"),
    ];
    let folder = job("");
    for format in ["npy", "png16"] {
        folder.succeed(&format!("generate job.toml --quiet --out {format} --set output.depth_format=\"{format}\""));
    }
    for (format, suffix, bytes, words) in cases {
        let recorded = RecordedDataset::open(&folder.path(format)).expect("a dataset");
        let shard = recorded.layout.shard(0);
        let mut tar = tar::Builder::new(Vec::new());
        for member in members(&recorded.shard_paths(&shard).data) {
            let bytes = if member.name.ends_with(suffix) { &bytes } else { &member.bytes };
            let mut header = tar::Header::new_ustar();
            header.set_size(bytes.len() as u64);
            tar.append_data(&mut header, &member.name, bytes.as_slice()).expect("memory");
        }
        let found = verify::check_tar(tar.into_inner().expect("memory").as_slice(), &recorded, shard);
        assert!(found.len() == 3 && found[0].contains(words), "{words:?} in {found:?}");
    }
}

#[test]
fn a_folder_holds_the_files_of_the_tar_and_a_row_per_sample() {
    let folder = folders();
    folder.succeed("generate job.toml --quiet --out tars --set output.container=\"tar\"");
    let by_key = |name: &str| -> BTreeMap<String, BTreeMap<String, Vec<u8>>> {
        samples(&folder, name).into_iter().map(|files| (files.key, files.members.into_iter().collect())).collect()
    };
    assert!(by_key("out") == by_key("tars"), "the same samples");
    assert!(!folder.path("out/wids.json").exists() && folder.path("tars/wids.json").exists());
    let manifest = json(&folder, "out/dataset.json");
    assert_eq!(
        (&manifest["container"], &manifest["shards"][0]["file"]),
        (&"folder".into(), &"data/train-000000".into())
    );

    let mut rows = 0;
    for shard in ["train-000000", "train-000001", "val-000000", "test-000000"] {
        for line in folder.read(&format!("out/data/{shard}/metadata.jsonl")).lines() {
            let row: serde_json::Value = serde_json::from_str(line).expect("a row");
            let mut row = row.as_object().expect("a row").clone();
            let mut text = |key: &str| row.remove(key).and_then(|v| v.as_str().map(str::to_owned)).expect("a name");
            for image in ["file_name", "contact_image_file_name"] {
                assert!(
                    folder.path("out/data").join(shard).join(text(image)).is_file(),
                    "{image} from the row's folder"
                );
            }
            for path in ["depth_path", "surface_path", "normal_path", "pressure_path"] {
                assert!(folder.path("out").join(text(path)).is_file(), "{path} from the dataset's folder");
            }
            let key = row["key"].as_str().expect("a key");
            let label = json(&folder, &format!("out/data/{shard}/{key}.json"));
            assert_eq!(Some(&row), label.as_object(), "what is left is the label");
            rows += 1;
        }
    }
    assert_eq!(rows, 8);
}

#[test]
fn folders_are_the_same_for_every_number_of_threads_and_every_partition() {
    let folder = folders();
    folder.succeed("generate job.toml --quiet --out threads --threads 5");
    assert_same_files(&folder.lasting_files("out"), &folder.lasting_files("threads"));
    for part in [2, 0, 1] {
        folder.succeed(&format!("generate job.toml --quiet --out parts --partition {part}/3"));
    }
    assert_same_files(&folder.lasting_files("out"), &folder.lasting_files("parts"));
    folder.succeed("generate job.toml --quiet --out single --set dataset.samples_per_shard=1");
    assert_eq!(verify_output(&folder, "single").1, 0, "one sample per shard");
    assert_eq!(samples(&folder, "single").len(), 8);
}

#[test]
fn a_dataset_of_folders_is_verified_reproduced_shown_and_compared() {
    let folder = folders();
    let (said, status) = verify_output(&folder, "out");
    assert!(
        status == 0 && said.starts_with("out: 8 samples in 4 shards") && said.ends_with(": valid and complete\n"),
        "{said}"
    );
    for key in ["0", "7"] {
        let output = folder.gelsim(&format!("reproduce out {key}")).assert().success();
        assert!(String::from_utf8_lossy(&output.get_output().stdout).ends_with("the same sample\n"));
    }
    folder.succeed("preview out --out sheet.png");
    folder.succeed("generate job.toml --quiet --out tars --set output.container=\"tar\"");
    folder.succeed("preview tars --out tars.png");
    assert_eq!(folder.read_bytes("sheet.png"), folder.read_bytes("tars.png"));
    let output = folder.gelsim("compare tars out").assert().success();
    let shown = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(shown.contains("all: simulated against real: no difference"), "{shown}");
    let said = folder.succeed("generate job.toml --out out");
    assert!(said.contains("0 samples in 0 shards") && said.contains("4 shards were there already"), "{said}");
}

/// Damages a copy of a sound dataset; verify must say the words, and only `again` shards be made anew.
fn damage(folder: &Folder, again: u64, words: &[&str], damage: impl Fn(&Path)) {
    let sound = folder.lasting_files("out");
    damage(&folder.path("out/data"));
    let (said, status) = verify_output(folder, "out");
    assert!(status == 1 && words.iter().all(|word| said.contains(word)), "{words:?} in\n{said}");
    folder.gelsim("verify out --checksums").assert().code(1);
    let said = folder.succeed("generate job.toml --out out");
    assert!(said.contains(&format!(" in {again} shard")), "{said}");
    assert_same_files(&sound, &folder.lasting_files("out"));
    assert_eq!(verify_output(folder, "out").1, 0);
}

#[test]
fn what_is_wrong_in_a_folder_is_named_and_only_its_shard_made_again() {
    let folder = folders();
    let shard = ["train-000000", "train-000001", "val-000000", "test-000000"]
        .into_iter()
        .find(|shard| folder.path(&format!("out/data/{shard}/000000003.json")).exists())
        .expect("one shard has it");
    let not_written = format!("data/{shard}: is not what was written");
    let file = |data: &Path, name: &str| data.join(shard).join(name);
    let flip = |path: &Path| {
        let mut bytes = fs::read(path).expect("a file");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(path, bytes).expect("a file");
    };
    for name in ["000000003.depth.exr", "000000003.tactile.png"] {
        damage(&folder, 1, &[&not_written], |data| flip(&file(data, name)));
    }
    damage(&folder, 1, &[&not_written, "metadata.jsonl: its row of sample 0"], |data| {
        flip(&file(data, "metadata.jsonl"));
    });
    damage(&folder, 1, &[&not_written, "metadata.jsonl: its row of sample 000000003 is another"], |data| {
        let label = file(data, "000000003.json");
        let text = fs::read_to_string(&label).expect("a label");
        fs::write(&label, text.replace("\"attempt\":0", "\"attempt\":1")).expect("a label");
    });
    for (name, words) in [
        ("000000003.depth.exr", "000000003.depth.exr is missing"),
        ("000000003.json", "000000003.json is missing"),
        ("metadata.jsonl", "metadata.jsonl: "),
    ] {
        damage(&folder, 1, &[&not_written, words], |data| fs::remove_file(file(data, name)).expect("a file"));
    }
    damage(&folder, 1, &[&not_written, "000000099 is one too many"], |data| {
        fs::write(file(data, "000000099.json"), "{}").expect("a file");
    });
    let missing = format!("data/{shard}: is missing");
    damage(&folder, 1, &[&missing], |data| fs::remove_dir_all(data.join(shard)).expect("a folder"));
    damage(&folder, 1, &[&not_written], |data| {
        fs::remove_dir_all(data.join(shard)).expect("a folder");
        fs::create_dir(data.join(shard)).expect("a folder");
    });
    let words = ["data/val-000000: is the content of data/test-000000", "data/test-000000: is the content of data/val"];
    damage(&folder, 2, &words, |data| {
        for (from, to) in [("val-000000", "x"), ("test-000000", "val-000000"), ("x", "test-000000")] {
            fs::rename(data.join(from), data.join(to)).expect("a folder");
        }
    });
}

#[test]
fn files_of_others_in_a_folder_are_named_stay_and_are_in_nobodys_way_unless_the_shard_must_go() {
    let folder = folders();
    let sound = folder.lasting_files("out");
    folder.write("out/data/val-000000/.DS_Store", "shown by a file manager");
    folder.write("out/data/val-000000/notes.txt", "mine");
    let (said, status) = verify_output(&folder, "out");
    let named =
        ["data/val-000000/.DS_Store: belongs to no shard\n", "data/val-000000/notes.txt: belongs to no shard\n"];
    assert!(status == 1 && said.starts_with(&named.concat()), "{said}");
    let said = folder.fail("generate job.toml --out out", 1);
    assert!(said.contains("data/val-000000/notes.txt: belongs to no shard"), "{said}");

    fs::remove_file(folder.path("out/data/val-000000/metadata.jsonl")).expect("a file");
    let said = folder.fail("generate job.toml --out out", 1);
    assert!(said.contains("out/data/val-000000/.DS_Store is in it, which gelsim did not make: move it away"), "{said}");
    fs::remove_file(folder.path("out/data/val-000000/.DS_Store")).expect("a file");
    let said = folder.fail("generate job.toml --out out --overwrite", 1);
    assert!(said.contains("out/data/val-000000/notes.txt is in it"), "{said}");
    assert_eq!(folder.read("out/data/val-000000/notes.txt"), "mine");
    fs::rename(folder.path("out/data/val-000000/notes.txt"), folder.path("notes.txt")).expect("a file");
    folder.succeed("generate job.toml --quiet --out out");
    assert_same_files(&sound, &folder.lasting_files("out"));
}

#[test]
fn a_link_in_a_folder_is_named_and_nothing_is_done_through_it() {
    let folder = folders();
    folder.write("precious.json", "{}");
    let key = fs::read_dir(folder.path("out/data/val-000000")).expect("a folder").flatten();
    let name = key.map(|entry| entry.file_name()).find(|name| name.to_string_lossy().ends_with(".json")).expect("one");
    let path = folder.path("out/data/val-000000").join(&name);
    fs::remove_file(&path).expect("a file");
    std::os::unix::fs::symlink(folder.path("precious.json"), &path).expect("a link");
    let (said, status) = verify_output(&folder, "out");
    assert!(status == 1 && said.contains(&format!("{}: is no regular file", name.to_string_lossy())), "{said}");
    for flags in ["", " --overwrite"] {
        let said = folder.fail(&format!("generate job.toml --out out{flags}"), 2);
        let words = format!("out/data/val-000000/{} is a symbolic link, which is not", name.to_string_lossy());
        assert!(said.contains(&words), "{words:?} in\n{said}");
    }
    assert_eq!(folder.read("precious.json"), "{}");
}

#[test]
fn overwrite_takes_a_dataset_from_one_container_to_the_other() {
    let folder = folders();
    folder.succeed("generate job.toml --quiet --out tars --set output.container=\"tar\"");
    let said = folder.fail("generate job.toml --out out --set output.container=\"tar\"", 2);
    assert!(said.contains("output.container is \"folder\" there and \"tar\" here"), "{said}");
    folder.succeed("generate job.toml --quiet --out changed --set output.container=\"tar\"");
    folder.succeed("generate job.toml --quiet --out changed --overwrite");
    assert_same_files(&folder.lasting_files("out"), &folder.lasting_files("changed"));
    folder.succeed("generate job.toml --quiet --out changed --overwrite --set output.container=\"tar\"");
    assert_same_files(&folder.lasting_files("tars"), &folder.lasting_files("changed"));
}

/// The forecast of `gelsim plan` and the shards agree about what a shard takes.
#[test]
fn the_bytes_of_a_sample_are_foreseen_for_both_containers() {
    let folder = folders();
    folder.succeed("generate job.toml --quiet --out tars --set output.container=\"tar\"");
    for (name, container) in [("out", Container::Folder), ("tars", Container::Tar)] {
        let recorded = RecordedDataset::open(&folder.path(name)).expect("a dataset");
        let foreseen: u64 = samples(&folder, name)
            .into_iter()
            .map(|SampleFiles { key, members }| {
                let index = key.parse().expect("a number");
                let members: Vec<Member> =
                    members.into_iter().map(|(suffix, bytes)| Member::new(suffix, bytes)).collect();
                let label = members.iter().find(|member| member.suffix == "json").expect("a label");
                let label = label.bytes.read().expect("in memory");
                container.sample_bytes(&recorded.layout.shard_of(index), index, &label, &members)
            })
            .sum();
        let manifest = json(&folder, &format!("{name}/dataset.json"));
        let shards = manifest["shards"].as_array().expect("shards");
        let bytes: u64 = shards.iter().map(|shard| shard["bytes"].as_u64().expect("bytes")).sum();
        assert_eq!(foreseen + shards.len() as u64 * container.empty_bytes(), bytes, "{name}");
    }
}

#[test]
fn the_card_has_the_columns_and_the_loader_of_its_container_and_format() {
    let folder = job("");
    for (container, format, present, absent) in [
        ("tar", "exr", &["- {name: depth.exr, dtype: binary}", "read_exr(data)", "shardshuffle"][..], "imagefolder"),
        ("tar", "npy", &["{array3_d: {shape: [36, 48, 3], dtype: float32}}", "sample[\"depth.npy\"]"], "OpenEXR"),
        (
            "tar",
            "png16",
            &["- {name: depth.png16, dtype: binary}", "label[\"png16\"][\"depth_mm_per_step\"]"],
            "array2_d",
        ),
        (
            "folder",
            "exr",
            &["[data/val-*/metadata.jsonl, data/val-*/*.png]", "- {name: contact_image, dtype: image}"],
            "webdataset",
        ),
        ("folder", "npy", &["- {name: depth_path, dtype: string}", "numpy.load(sample[\"depth_path\"])"], "OpenEXR"),
        (
            "folder",
            "png16",
            &[
                "\n  features:\n  - {name: image, dtype: image}\n",
                "- {name: contact, struct: [{name: in_contact, dtype: bool}, ",
                "Image.open(sample[\"depth_path\"])",
            ],
            "webdataset",
        ),
    ] {
        let set = format!("--set output.container=\"{container}\" --set output.depth_format=\"{format}\"");
        folder.succeed(&format!("generate job.toml --quiet --out out --overwrite {set}"));
        let card = folder.read("out/README.md");
        for words in present {
            assert!(card.contains(words), "{container} {format}: {words:?} in\n{card}");
        }
        assert!(!card.contains(absent), "{container} {format}: {absent:?} in\n{card}");
        assert_eq!(card.matches("```python\n").count(), if container == "tar" { 3 } else { 2 });
        assert!(!card.contains("SPLIT"));
    }
}

#[test]
fn a_dataset_of_folders_grows_and_its_last_shards_are_exchanged() {
    let folder = folders();
    folder.succeed("generate job.toml --quiet --out grown --samples 13");
    let said = folder.succeed("generate job.toml --out out --samples 13");
    assert!(said.contains("1 shard was there already"), "only train-000000 was full: {said}");
    assert_same_files(&folder.lasting_files("grown"), &folder.lasting_files("out"));
    folder.gelsim("finalize out").assert().success();
    assert_eq!(verify_output(&folder, "out").1, 0);
}
