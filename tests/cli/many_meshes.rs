//! Sets of many meshes: what is known of them is remembered, geometry is read when a sample needs it, and neither changes a byte.

use std::fs::{self, File};
use std::time::{Duration, UNIX_EPOCH};

use crate::support::{Folder, assert_same_files};

/// More files than are all held in memory.
const COUNT: usize = 270;

const JOB: &str = "
[dataset]
name = \"many\"
samples = 24
samples_per_shard = 6
seed = 3

[sensor]
resolution_px = [48, 36]

[[object]]
path = \"meshes/*.obj\"

[pose]
face = \"auto\"
yaw_deg = [0.0, 360.0]

[indentation]
depth_mm = [0.3, 1.0]
";

/// A wedge whose ridge is as long as its number says.
fn wedge(number: usize) -> String {
    let long = 3.0 + 0.01 * number as f64;
    format!(
        "v {long} 0 4\nv -{long} 0 4\nv -6 -6 0\nv 6 -6 0\nv 6 6 0\nv -6 6 0\n\
         f 3 6 5\nf 3 5 4\nf 3 4 1\nf 3 1 2\nf 5 6 2\nf 5 2 1\nf 4 5 1\nf 6 3 2\n"
    )
}

/// A folder with the job and its meshes, which were all changed at one time long ago.
fn folder() -> Folder {
    let folder = Folder::with_job(JOB);
    fs::create_dir(folder.path("meshes")).expect("a folder");
    for number in 0..COUNT {
        write_mesh(&folder, number, &wedge(number));
    }
    folder
}

fn write_mesh(folder: &Folder, number: usize, text: &str) {
    let name = format!("meshes/m{number:03}.obj");
    folder.write(&name, text);
    let file = File::options().write(true).open(folder.path(&name)).expect("the mesh");
    file.set_modified(UNIX_EPOCH + Duration::from_secs(1_700_000_000)).expect("a time");
}

fn remembered(folder: &Folder) -> Vec<String> {
    let files = folder.files("cache/meshes");
    let [text] = files.values().collect::<Vec<_>>()[..] else { panic!("{:?}", files.keys()) };
    let mut lines: Vec<String> = String::from_utf8(text.clone()).expect("UTF-8").lines().map(str::to_owned).collect();
    lines.sort();
    lines
}

#[test]
fn what_is_remembered_and_read_later_gives_the_same_bytes() {
    let folder = folder();
    // At first all is read; then only what samples need.
    for (out, threads) in [("first", 2), ("second", 1), ("third", 3)] {
        folder.succeed(&format!("generate job.toml --quiet --out {out} --threads {threads}"));
    }
    let first = folder.lasting_files("first");
    assert_same_files(&first, &folder.lasting_files("second"));
    assert_same_files(&first, &folder.lasting_files("third"));
    assert_eq!(remembered(&folder).len(), COUNT);
    let plan = |folder: &Folder| folder.stdout_of("plan job.toml").lines().next().map(str::to_owned);
    let before = plan(&folder);
    fs::remove_dir_all(folder.path("cache")).expect("the cache");
    assert_eq!(plan(&folder), before);
}

#[test]
fn the_objects_of_few_files_are_those_of_many() {
    let folder = folder();
    // All samples of one mesh, alone and among many.
    let one = JOB.replace("meshes/*.obj", "meshes/m100.obj");
    let many = format!("{one}\n[[object]]\npath = \"meshes/*.obj\"\nweight = 0.0\nclass = \"m100\"\n");
    for (name, text) in [("one", &one), ("many", &many)] {
        folder.write("job.toml", text);
        folder.succeed(&format!("generate job.toml --quiet --out {name}"));
    }
    let images = |name: &str| {
        let mut samples = folder.samples(name);
        samples.values_mut().for_each(|members| members.retain(|suffix, _| suffix != "json"));
        samples
    };
    assert_eq!(images("one"), images("many"));
}

#[test]
fn a_mesh_that_changes_is_read_again_and_one_that_changes_unseen_stops_the_run() {
    let folder = folder();
    folder.succeed("plan job.toml");
    let before = remembered(&folder);
    write_mesh(&folder, 7, &wedge(1000));
    folder.succeed("plan job.toml");
    let after = remembered(&folder);
    assert_eq!(before.iter().filter(|line| !after.contains(line)).count(), 1, "the others stay");

    // A file of the same size and time is taken for the same one, until a sample reads it.
    for number in 0..COUNT {
        let text = wedge(number);
        write_mesh(&folder, number, &text.replace("v 6 6 0", "v 6 5 0"));
    }
    let said = folder.fail("generate job.toml --out stopped", 1);
    assert!(said.contains("has changed since the job was read"), "{said}");
    let shards = folder.files("stopped/data");
    assert!(shards.keys().all(|name| name.starts_with('.') || name.contains(".partial")), "{:?}", shards.keys());
    let said = folder.fail("preview job.toml --out preview.png", 1);
    assert!(said.contains("has changed") && !folder.path("preview.png").exists(), "{said}");
}

#[test]
fn a_mesh_that_was_just_written_is_not_taken_for_settled() {
    let folder = folder();
    folder.write("meshes/m003.obj", wedge(3));
    folder.succeed("plan job.toml");
    assert_eq!(remembered(&folder).len(), COUNT - 1);
}

#[test]
fn without_a_cache_folder_all_works_and_is_told() {
    let folder = folder();
    folder.write("cache", "a file in its place");
    let said = folder.succeed("generate job.toml --out one --verbose");
    assert!(said.contains("cannot remember what the meshes hold") && said.contains("GELSIM_CACHE_DIR"), "{said}");
}
