//! Links, pipes and folders under the names of a dataset's files: nothing is written outside, nothing waits.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::Duration;

use gelsim_dataset::lock::Lock;
use gelsim_files::write::write_atomically;

use super::rig::{assert_like_undisturbed, in_folders, with_undisturbed};
use crate::support::{Folder, JOB, assert_same_files};

/// What is put in place of something of ours.
#[derive(Clone, Copy, Debug)]
enum Plant {
    LinkToFile,
    LinkToFolder,
    LinkToNothing,
    LinkToDevice,
    Folder,
    Pipe,
}

const PLANTS: [Plant; 6] =
    [Plant::LinkToFile, Plant::LinkToFolder, Plant::LinkToNothing, Plant::LinkToDevice, Plant::Folder, Plant::Pipe];

impl Plant {
    fn what(self) -> &'static str {
        match self {
            Self::LinkToFile | Self::LinkToFolder | Self::LinkToNothing | Self::LinkToDevice => "is a symbolic link",
            Self::Folder => "is a folder",
            Self::Pipe => "is neither a file nor a folder",
        }
    }

    fn put(self, folder: &Folder, at: &Path) {
        if let Ok(meta) = at.symlink_metadata() {
            if meta.is_dir() { fs::remove_dir_all(at) } else { fs::remove_file(at) }.expect("it goes");
        }
        match self {
            Self::LinkToFile => symlink(folder.path("outside/precious.txt"), at).expect("a link"),
            Self::LinkToFolder => symlink(folder.path("outside"), at).expect("a link"),
            Self::LinkToNothing => symlink(folder.path("outside/new"), at).expect("a link"),
            Self::LinkToDevice => symlink("/dev/zero", at).expect("a link"),
            Self::Folder => fs::create_dir(at).expect("a folder"),
            Self::Pipe => {
                let made = std::process::Command::new("mkfifo").arg(at).status();
                assert!(made.expect("mkfifo").success());
            }
        }
    }
}

/// A dataset of which one shard is there, and a folder beside it that must stay as it is.
fn start_dataset() -> (Folder, BTreeMap<String, Vec<u8>>) {
    let folder = with_undisturbed(JOB);
    fs::create_dir(folder.path("outside")).expect("a folder");
    folder.write("outside/precious.txt", "precious\n");
    // With names of ours in it, which an --overwrite must not reach.
    folder.write("outside/train-000000.tar", "theirs\n");
    let outside = folder.files("outside");
    (folder, outside)
}

const NAMES: [&str; 14] = [
    "data",
    "stats",
    ".gelsim.lock",
    "job.toml",
    "dataset.json",
    "wids.json",
    "README.md",
    "report.html",
    "data/train-000000.tar",
    "data/val-000000.tar",
    "data/.val-000000.tar.partial",
    "data/.val-000000.lock",
    "stats/train-000000.json",
    "stats/val-000000.json",
];

#[test]
fn nothing_is_written_or_removed_through_what_stands_in_place_of_ours() {
    let (folder, outside) = start_dataset();
    let mut tried = 0;
    for name in NAMES {
        for plant in PLANTS {
            if ["data", "stats"].contains(&name) && matches!(plant, Plant::Folder) {
                continue;
            }
            folder.succeed("generate job.toml --quiet --out out --shards 0..1");
            plant.put(&folder, &folder.path("out").join(name));
            for flags in ["", " --overwrite"] {
                let mut command = folder.gelsim(&format!("generate job.toml --out out{flags}"));
                let output = command.timeout(Duration::from_secs(60)).output().expect("it runs");
                let said = String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.code(), Some(2), "{name} {plant:?}{flags}: {said}");
                let words = format!("out/{name} {}, which is not what gelsim made there", plant.what());
                assert!(said.contains(&words), "{name} {plant:?}{flags}: {said}");
                assert_same_files(&outside, &folder.files("outside"));
                tried += 1;
            }
            fs::remove_dir_all(folder.path("out")).expect("a folder");
        }
    }
    println!("{tried} runs met a link, a pipe or a folder in place of a file of theirs");
}

#[test]
fn nothing_is_written_or_removed_through_what_stands_in_place_of_a_folder_of_ours() {
    let folder = with_undisturbed(&in_folders(JOB));
    fs::create_dir(folder.path("outside")).expect("a folder");
    for name in ["precious.txt", "metadata.jsonl", "000000001.json"] {
        folder.write(&format!("outside/{name}"), "precious\n");
    }
    let outside = folder.files("outside");
    let complete = folder.files("complete/data");
    let inside = complete.keys().find(|name| name.starts_with("train-000000/")).expect("a file of the shard");
    let inside = format!("data/{inside}");
    let names =
        ["data/train-000000", "data/val-000000", "data/.val-000000.partial", "data/.train-000000.replaced.partial"];
    for name in names.into_iter().chain(["data/train-000000/metadata.jsonl", &inside]) {
        let is_folder = !name.ends_with(".jsonl") && name != inside;
        for plant in PLANTS {
            if is_folder && matches!(plant, Plant::Folder) {
                continue;
            }
            folder.succeed("generate job.toml --quiet --out out --shards 0..1");
            plant.put(&folder, &folder.path("out").join(name));
            for flags in ["", " --overwrite"] {
                let said = folder.fail(&format!("generate job.toml --out out{flags}"), 2);
                let words = format!("out/{name} {}, which is not what gelsim made there", plant.what());
                assert!(said.contains(&words), "{name} {plant:?}{flags}: {said}");
                assert_same_files(&outside, &folder.files("outside"));
            }
            fs::remove_dir_all(folder.path("out")).expect("a folder");
        }
    }
}

#[test]
fn files_with_a_second_name_keep_what_they_have_under_it() {
    let (folder, outside) = start_dataset();
    let names = NAMES.into_iter().filter(|name| !["data", "stats", "job.toml", "report.html"].contains(name));
    for name in names {
        folder.succeed("generate job.toml --quiet --out out --shards 0..1");
        let _ = fs::remove_file(folder.path("out").join(name));
        fs::hard_link(folder.path("outside/precious.txt"), folder.path("out").join(name)).expect("a link");
        if name.ends_with(".lock") {
            let text = folder.fail("generate job.toml --out out", 1);
            assert!(text.contains(&format!("out/{name}: not a plain file, or one with a second name")), "{text}");
            fs::remove_file(folder.path("out").join(name)).expect("a lock file");
        }
        folder.succeed("generate job.toml --quiet --out out");
        assert_like_undisturbed(&folder, "out");
        assert_same_files(&outside, &folder.files("outside"));
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
}

#[test]
fn a_dataset_may_be_reached_through_a_link() {
    let folder = with_undisturbed(JOB);
    fs::create_dir(folder.path("real")).expect("a folder");
    symlink(folder.path("real"), folder.path("out")).expect("a link");
    folder.succeed("generate job.toml --quiet --out out --shards 0..2");
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_undisturbed(&folder, "real");
}

#[test]
fn overwrite_removes_nothing_but_the_dataset() {
    let folder = with_undisturbed(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    let theirs = ["out/data/cube.obj", "out/data/.hidden.partial", "out/stats/notes.txt", "out/.mine.lock"];
    for name in theirs {
        folder.write(name, folder.read("cube.obj"));
    }
    // Also if a mesh of the job is among it.
    let mesh = "--set object.0.path=\"out/data/cube.obj\" --set object.0.label_path=\"cube.obj\"";
    let said = folder.fail(&format!("generate job.toml --quiet --out out --overwrite {mesh}"), 1);
    assert!(said.contains("data/cube.obj: belongs to no shard") && said.contains("stats/notes.txt: "), "{said}");
    for name in theirs {
        assert_eq!(folder.read(name), folder.read("cube.obj"));
    }
    assert_same_files(
        &folder.files("complete/data"),
        &folder.files("out/data").into_iter().filter(|(name, _)| name.ends_with(".tar")).collect(),
    );
}

#[test]
fn neither_locks_nor_files_are_opened_through_links() {
    // As if the link had been put there after the folder was looked at.
    let (folder, outside) = start_dataset();
    let lock = folder.path("a.lock");
    for plant in [Plant::LinkToFile, Plant::LinkToNothing, Plant::Folder, Plant::Pipe] {
        plant.put(&folder, &lock);
        assert!(Lock::try_acquire(&lock).is_err() && Lock::acquire(&lock).is_err(), "{plant:?}");
    }
    let file = folder.path("a.json");
    let partial = folder.path(&format!(".a.json.{}.partial", std::process::id()));
    for plant in [Plant::LinkToFile, Plant::LinkToNothing, Plant::Pipe] {
        plant.put(&folder, &partial);
        plant.put(&folder, &file);
        write_atomically(&file, b"content").expect("in their place");
        assert!(file.symlink_metadata().expect("a file").is_file());
        assert_eq!(folder.read("a.json"), "content");
    }
    assert_same_files(&outside, &folder.files("outside"));
}

/// Readers of a dataset open nothing that would keep them waiting or fill memory: they say what it is, or that it is not
/// what was written.
#[test]
fn readers_wait_for_nothing_and_read_no_device() {
    let sound = with_undisturbed(JOB);
    let places =
        ["job.toml", "dataset.json", "wids.json", "README.md", "data/train-000000.tar", "stats/train-000000.json"];
    let readers = [
        "verify complete",
        "verify complete --checksums",
        "finalize complete",
        "report complete --out page.html",
        "preview complete --out sheet.png",
        "reproduce complete 0",
        "generate job.toml --out complete",
    ];
    let mut tried = 0;
    for place in places {
        for plant in PLANTS {
            for reader in readers {
                // One that describes the dataset puts its own file there.
                plant.put(&sound, &sound.path("complete").join(place));
                // None takes a second; one that waits would never end.
                let output = sound.gelsim(reader).timeout(Duration::from_secs(60)).output().expect("it ends");
                let status =
                    output.status.code().unwrap_or_else(|| panic!("{reader} was killed: {plant:?} as {place}"));
                assert!([0, 1, 2].contains(&status), "{reader}: status {status} with {plant:?} as {place}");
                let reads_it = reader.starts_with("verify") || reader.starts_with("generate");
                assert!(!reads_it || status > 0, "{reader} did not mind {plant:?} as {place}");
                tried += 1;
            }
            let at = sound.path("complete").join(place);
            if at.symlink_metadata().expect("it is there").is_dir() {
                fs::remove_dir(&at)
            } else {
                fs::remove_file(&at)
            }
            .expect("it goes");
            sound.succeed("generate job.toml --quiet --out complete");
        }
    }
    println!("{tried} readers met a link, pipe, device or folder");
}
