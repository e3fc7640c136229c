//! Disks that are full or read-only, and limits of a file's size: said in words, nothing half-written, and the same
//! command goes on once there is room.

use std::collections::BTreeMap;

use super::rig::{
    assert_complete_or_absent, assert_like_undisturbed, assert_swept, in_folders, in_sequences, messages_of, shell,
    shell_with_mounts, with_undisturbed,
};
use crate::support::{Folder, JOB, assert_same_files};

/// Fills a disk of `SIZE` with a run, keeps what is on it then, makes room, and runs again.
const FILLED: &str = r#"
mkdir -p disk full again && rm -rf full again
mount -t tmpfs -o "size=$SIZE,nr_inodes=$FILES" none disk || exit 98
"$G" generate job.toml --quiet --threads 1 --out disk/out; first=$?
[ -e disk/out ] && cp -r disk/out full
mount -o remount,size=64m,nr_inodes=100000 disk || exit 98
"$G" generate job.toml --quiet --threads 1 --out disk/out >&2 || exit 97
cp -r disk/out again
exit $first
"#;

/// The file at which a message says that the disk was full.
fn hit(text: &str) -> String {
    let path = text.split(": No space left").next().and_then(|path| path.rsplit(": ").next()).unwrap_or_default();
    let name = path.rsplit('/').next().unwrap_or_default();
    match (path.contains("/data/"), path.contains("/stats/"), name.ends_with(".lock")) {
        (true, _, true) => String::from("a shard's lock"),
        (true, ..) if name.starts_with('.') => String::from("a shard"),
        (_, true, _) => String::from("a stats file"),
        _ => name.to_owned(),
    }
}

/// Fills one disk. At which file it was full; none if all had room.
fn fill(folder: &Folder, size: &str, files: &str) -> Option<Option<String>> {
    let output = shell_with_mounts(folder, FILLED, &[("SIZE", size), ("FILES", files)])?;
    let text = messages_of(&output);
    assert_complete_or_absent(folder, "full");
    assert_like_undisturbed(folder, "again");
    match output.status.code() {
        Some(0) => Some(None),
        Some(1) => {
            assert!(text.contains("No space left on device") && text.contains("make room there"), "{text}");
            assert!(text.contains("the same command goes on from there"), "{text}");
            if folder.path("full").exists() {
                assert_swept(folder, "full");
            }
            Some(Some(hit(&text)))
        }
        other => panic!("{other:?}: {text}"),
    }
}

/// A folder in which `complete` was made as deep as `disk/out` is: paths in job.toml are relative.
fn folder(job: &str) -> Folder {
    let folder = Folder::with_job(job);
    std::fs::create_dir(folder.path("plain")).expect("a folder");
    folder.succeed("generate job.toml --quiet --out plain/out");
    std::fs::rename(folder.path("plain/out"), folder.path("complete")).expect("a folder");
    folder
}

#[test]
fn a_disk_that_fills_up_at_any_size_is_named_and_loses_nothing() {
    room_runs_out(JOB);
}

#[test]
fn a_disk_that_fills_up_under_sequences_is_named_and_loses_nothing() {
    room_runs_out(&in_sequences(JOB));
}

/// Every size of a disk, or every second one, for jobs that are no more than another form of the usual one.
fn step(job: &str) -> usize {
    if job == JOB || crate::thorough() { 1 } else { 2 }
}

fn room_runs_out(job: &str) {
    let folder = folder(job);
    let mut hits: BTreeMap<String, u32> = BTreeMap::new();
    // In pages, of which each file takes whole ones.
    for pages in (1..).step_by(step(job)) {
        match fill(&folder, &format!("{}k", 4 * pages), "100000") {
            None => return,
            Some(None) => break,
            Some(Some(file)) => *hits.entry(file).or_default() += 1,
        }
    }
    println!("{} sizes of a full disk survived; it was full at: {hits:?}", hits.values().sum::<u32>());
    assert!(["job.toml", "a shard", "a stats file"].iter().all(|file| hits.contains_key(*file)), "{hits:?}");
}

#[test]
fn a_disk_that_has_no_room_for_one_more_file_is_named_and_loses_nothing() {
    files_run_out(JOB);
}

#[test]
fn a_disk_that_has_no_room_for_one_more_file_of_a_folder_is_named_and_loses_nothing() {
    files_run_out(&in_folders(JOB));
}

fn files_run_out(job: &str) {
    let folder = folder(job);
    let mut hits: BTreeMap<String, u32> = BTreeMap::new();
    for files in 2.. {
        match fill(&folder, "64m", &files.to_string()) {
            None => return,
            Some(None) => break,
            Some(Some(file)) => *hits.entry(file).or_default() += 1,
        }
    }
    println!("{} counts of files on a full disk survived; it was full at: {hits:?}", hits.values().sum::<u32>());
    assert!(
        ["job.toml", "a stats file", "dataset.json"].iter().all(|file| hits.contains_key(*file))
            && ["a shard", "a shard's lock"].iter().any(|file| hits.contains_key(*file)),
        "{hits:?}"
    );
}

#[test]
fn a_limit_of_a_files_size_is_an_error_and_no_end_by_a_signal() {
    let folder = with_undisturbed(JOB);
    let (mut met, mut limit) = (0, 0);
    loop {
        // In blocks of 512 bytes.
        let script = format!("ulimit -f {limit}; exec \"$G\" generate job.toml --quiet --out out");
        let output = shell(&folder, &script, &[]);
        let text = messages_of(&output);
        assert_complete_or_absent(&folder, "out");
        match output.status.code() {
            Some(0) => break,
            Some(1) => assert!(text.contains("File too large") && text.contains("ulimit -f"), "{text}"),
            other => panic!("{other:?}: {text}"),
        }
        met += 1;
        if met % 3 == 0 {
            folder.succeed("generate job.toml --quiet --out out");
            assert_like_undisturbed(&folder, "out");
            std::fs::remove_dir_all(folder.path("out")).expect("a folder");
        }
        limit += 7;
    }
    println!("{met} limits of a file's size survived");
    assert!(met > 3);
    assert_like_undisturbed(&folder, "out");
}

#[test]
fn a_read_only_folder_is_named_and_stays_as_it_is() {
    let folder = with_undisturbed(JOB);
    std::fs::create_dir(folder.path("empty")).expect("a folder");
    folder.succeed("generate job.toml --quiet --out begun --shards 0..2");
    folder.succeed("generate job.toml --quiet --out complete");
    for name in ["empty", "begun", "complete"] {
        let before = folder.files(name);
        let script = "mount --bind $NAME $NAME && mount -o remount,bind,ro $NAME || exit 98
            exec \"$G\" generate job.toml --quiet --out $NAME";
        let Some(output) = shell_with_mounts(&folder, script, &[("NAME", name)]) else { return };
        let text = messages_of(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.contains("Read-only file system") && text.contains("make the folder writable"), "{text}");
        assert!(text.contains(&format!("error: {name}/")), "{text}");
        assert_same_files(&before, &folder.files(name));
        folder.succeed(&format!("generate job.toml --quiet --out {name}"));
        assert_like_undisturbed(&folder, name);
    }
}
