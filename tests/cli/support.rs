//! What the tests share: a folder with a job and two meshes in it, the command, and readers of what it wrote.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use exr::prelude::{ReadChannels, ReadLayers};
use tempfile::TempDir;

use crate::advice::assert_mended;
use crate::command::Command;

/// A job of 8 small samples; every test that needs another one edits it.
pub const JOB: &str = r#"
[dataset]
name = "small"
samples = 8
seed = 7
samples_per_shard = 3
splits = { train = 0.5, val = 0.25, test = 0.25 }

[sensor]
resolution_px = [48, 36]

[[object]]
path = "cube.obj"

[[object]]
path = "cone.obj"
class = "pointed"
weight = 2.0

[pose]
yaw_deg = [0.0, 360.0]
tilt_deg = { uniform = [0.0, 8.0] }
x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }
y_mm = [-2.0, 2.0]

[indentation]
depth_mm = { log_uniform = [0.3, 1.2] }
no_contact = 0.25

[output]
layers = ["depth", "contact"]
"#;

/// The root of the repository.
pub fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// `text` with each `(from, to)` done. `from` must stand there exactly once.
pub fn edited(text: &str, edits: &[(&str, &str)]) -> String {
    edits.iter().fold(text.to_owned(), |text, (from, to)| {
        assert_eq!(text.matches(from).count(), 1, "{from:?} must stand once in\n{text}");
        text.replace(from, to)
    })
}

/// A temporary folder with `cube.obj` and `cone.obj` in it: the current folder of every command run there.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = Self(TempDir::new().expect("a temporary folder"));
        for mesh in ["cube.obj", "cone.obj"] {
            fs::copy(repository().join("objects").join(mesh), folder.path(mesh)).expect("a bundled mesh");
        }
        folder
    }

    /// A folder with `text` as its `job.toml`.
    pub fn with_job(text: &str) -> Self {
        let folder = Self::new();
        folder.write("job.toml", text);
        folder
    }

    /// The same with these bundled meshes beside it.
    pub fn with_objects(text: &str, objects: &[&str]) -> Self {
        let folder = Self::with_job(text);
        for name in objects.iter().map(|name| format!("{name}.obj")) {
            fs::copy(repository().join("objects").join(&name), folder.path(&name)).expect("a bundled mesh");
        }
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).expect("a file in the temporary folder");
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn read_bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// `gelsim` with arguments that are separated by single spaces.
    pub fn gelsim(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gelsim"));
        command.current_dir(self.0.path()).args(arguments.split(' ')).env("GELSIM_CACHE_DIR", self.path("cache"));
        command
    }

    /// The same, to be run beside the test.
    pub fn spawn(&self, arguments: &str) -> std::process::Child {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_gelsim"));
        command.current_dir(self.0.path()).args(arguments.split(' ')).env("GELSIM_CACHE_DIR", self.path("cache"));
        command.stderr(std::process::Stdio::piped());
        command.spawn().expect("the command starts")
    }

    /// Runs `gelsim`, which must succeed; what it said on standard error.
    pub fn succeed(&self, arguments: &str) -> String {
        let assert = self.gelsim(arguments).assert().success();
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    }

    /// Runs `gelsim`, which must end with `status`; what it said on standard error.
    pub fn fail(&self, arguments: &str, status: i32) -> String {
        let assert = self.gelsim(arguments).assert().code(status).stdout("");
        let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        if ["plan job.toml", "generate job.toml"].iter().any(|begin| arguments.starts_with(begin)) {
            assert_mended(self, &said);
        }
        said
    }

    /// What `gelsim` writes to standard output, however it ends.
    pub fn stdout_of(&self, arguments: &str) -> String {
        String::from_utf8(self.gelsim(arguments).output().expect("it runs").stdout).expect("UTF-8")
    }

    /// Generates the job in `one`, on one thread; on four threads it must be the same.
    pub fn assert_same_on_four_threads(&self) {
        self.succeed("generate job.toml --quiet --out one --threads 1");
        self.succeed("generate job.toml --quiet --out four --threads 4");
        assert_same_files(&self.lasting_files("one"), &self.lasting_files("four"));
    }

    /// The same, and in two runs.
    pub fn assert_same_however_divided(&self) {
        self.assert_same_on_four_threads();
        for part in [1, 0] {
            self.succeed(&format!("generate job.toml --quiet --out parts --partition {part}/2"));
        }
        assert_same_files(&self.lasting_files("one"), &self.lasting_files("parts"));
    }

    /// The presses of `job.toml` are the first frames of the sequences of `moves.toml`, byte for byte. How many touch.
    pub fn assert_presses_are_first_frames(&self) -> u64 {
        self.succeed("generate job.toml --quiet --out press");
        self.succeed("generate moves.toml --quiet --out moves");
        let (press, moves) = (self.samples("press"), self.samples("moves"));
        let mut touches = 0;
        for (key, files) in press {
            let mut expected: BTreeMap<String, Vec<u8>> =
                files.into_iter().map(|(name, bytes)| (format!("f0000.{name}"), bytes)).collect();
            let mut found = moves[&key].clone();
            let [label, sequence] = [(&mut expected, "f0000.json"), (&mut found, "json")].map(|(files, name)| {
                let label: serde_json::Value =
                    serde_json::from_slice(&files.remove(name).expect("a label")).expect("JSON");
                label
            });
            assert_same_files(&expected, &found);
            for part in ["pose", "indentation_depth_mm", "contact", "numerics", "health", "markers"] {
                assert_eq!(sequence["frames"][0][part], label[part], "{part} of {key}");
            }
            assert_eq!(sequence["camera"], label["camera"]);
            touches += u64::from(label["contact"]["in_contact"] == true);
        }
        touches
    }

    /// Every file below `name`, relative to it, sorted, with its bytes.
    pub fn files(&self, name: &str) -> BTreeMap<String, Vec<u8>> {
        let root = self.path(name);
        let mut files = BTreeMap::new();
        collect(&root, &root, &mut files);
        files
    }

    /// The files below `name` that must be the same however a dataset was made: all but `stats`, which hold times.
    pub fn lasting_files(&self, name: &str) -> BTreeMap<String, Vec<u8>> {
        let mut files = self.files(name);
        files.retain(|name, _| !name.starts_with("stats/"));
        files
    }

    /// All samples of the dataset in the folder `name`: for each key its members by their suffixes.
    pub fn samples(&self, name: &str) -> BTreeMap<String, BTreeMap<String, Vec<u8>>> {
        let mut samples: BTreeMap<String, BTreeMap<String, Vec<u8>>> = BTreeMap::new();
        for (file, _) in self.files(&format!("{name}/data")) {
            for member in members(&self.path(&format!("{name}/data/{file}"))) {
                let (key, suffix) = member.name.split_once('.').expect("a member has a suffix");
                samples.entry(key.to_owned()).or_default().insert(suffix.to_owned(), member.bytes);
            }
        }
        samples
    }

    /// The labels of all samples, by key.
    pub fn labels(&self, name: &str) -> BTreeMap<String, serde_json::Value> {
        let label = |members: &BTreeMap<String, Vec<u8>>| serde_json::from_slice(&members["json"]).expect("JSON");
        self.samples(name).iter().map(|(key, members)| (key.clone(), label(members))).collect()
    }
}

fn collect(root: &Path, folder: &Path, files: &mut BTreeMap<String, Vec<u8>>) {
    for entry in fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
        let path = entry.expect("a folder's entry").path();
        if path.is_dir() {
            collect(root, &path, files);
        } else {
            let name = path.strip_prefix(root).expect("below the root").to_string_lossy().into_owned();
            files.insert(name, fs::read(&path).expect("a file"));
        }
    }
}

/// Which files differ between two sets; better to read than two dumps of bytes.
pub fn assert_same_files(left: &BTreeMap<String, Vec<u8>>, right: &BTreeMap<String, Vec<u8>>) {
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(left), names(right));
    let differ: Vec<&String> = left.keys().filter(|name| left[*name] != right[*name]).collect();
    assert!(differ.is_empty(), "these differ: {differ:?}");
}

/// One file in a tar.
pub struct Member {
    pub name: String,
    pub header: tar::Header,
    pub bytes: Vec<u8>,
}

/// The files in a tar, in order.
pub fn members(path: &Path) -> Vec<Member> {
    let mut archive = tar::Archive::new(File::open(path).expect("a tar"));
    let read = |entry: std::io::Result<tar::Entry<'_, File>>| {
        let mut entry = entry.expect("an entry");
        let name = entry.path().expect("a name").to_string_lossy().into_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).expect("its content");
        Member { name, header: entry.header().clone(), bytes }
    };
    archive.entries().expect("a tar").map(read).collect()
}

/// The JSON file `name` of a folder.
pub fn json(folder: &Folder, name: &str) -> serde_json::Value {
    serde_json::from_str(&folder.read(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The channels of an EXR picture of 48x36 px by name.
pub fn exr_planes(bytes: &[u8]) -> Vec<(String, Vec<f32>)> {
    let picture = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(std::io::Cursor::new(bytes))
        .expect("an EXR picture");
    let layer = picture.layer_data;
    assert_eq!((layer.size.width(), layer.size.height()), (48, 36));
    let plane = |channel: &exr::prelude::AnyChannel<exr::prelude::FlatSamples>| {
        (channel.name.to_string(), channel.sample_data.values_as_f32().collect())
    };
    layer.channel_data.list.iter().map(plane).collect()
}

/// What stands after `start` in a line of what was said, as arguments of `gelsim`.
pub fn advised_arguments<'a>(said: &'a str, start: &str) -> &'a str {
    let rest = said.split_once(start).unwrap_or_else(|| panic!("{start:?} in {said}")).1;
    rest.lines().next().unwrap_or_default().trim_end()
}

/// SHA-256 in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    <sha2::Sha256 as sha2::Digest>::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Changes the stats of a shard of the dataset `name` and seals them again.
pub fn edit_stats(folder: &Folder, name: &str, shard: &str, edit: impl Fn(&mut serde_json::Value)) {
    let name = format!("{name}/stats/{shard}.json");
    let mut value = json(folder, &name);
    edit(&mut value);
    let blank = "0".repeat(64);
    value["seal_sha256"] = blank.clone().into();
    let text = format!("{value:#}\n");
    folder.write(&name, text.replace(&blank, &sha256(text.as_bytes())));
}

/// Makes the dataset `name` look as if gelsim `version` had made it.
pub fn made_by(folder: &Folder, name: &str, version: &str) {
    let job = format!("{name}/job.toml");
    let line = format!("resolved by gelsim {}.", env!("CARGO_PKG_VERSION"));
    folder.write(&job, edited(&folder.read(&job), &[(&line, &format!("resolved by gelsim {version}."))]));
    for shard in folder.files(&format!("{name}/stats")).keys() {
        edit_stats(folder, name, shard.trim_end_matches(".json"), |stats| {
            stats["generator"] = version.into();
            stats["fingerprint"] = "0".repeat(63).into();
        });
    }
}

/// A ZIP archive of members as they are.
pub fn archive(members: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut archive, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in members {
        let offset = archive.len() as u32;
        let crc = crc(bytes);
        let sizes =
            [&crc.to_le_bytes()[..], &(bytes.len() as u32).to_le_bytes(), &(bytes.len() as u32).to_le_bytes()].concat();
        let name_length = (name.len() as u16).to_le_bytes();
        archive.extend(
            [&b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0"[..], &sizes, &name_length, &[0; 2], name.as_bytes(), bytes].concat(),
        );
        let start = b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0";
        directory.extend([&start[..], &sizes, &name_length, &[0; 12], &offset.to_le_bytes(), name.as_bytes()].concat());
    }
    let (start, count) = (archive.len() as u32, (members.len() as u16).to_le_bytes());
    archive.extend(&directory);
    let end = b"PK\x05\x06\0\0\0\0";
    archive.extend(
        [&end[..], &count, &count, &(directory.len() as u32).to_le_bytes(), &start.to_le_bytes(), &[0; 2]].concat(),
    );
    archive
}

/// ZIP's checksum.
fn crc(bytes: &[u8]) -> u32 {
    !bytes
        .iter()
        .fold(!0_u32, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1))))
}

/// A box of this length as glTF, whose unit is the metre.
pub fn gltf(length: f32) -> String {
    use base64::Engine;
    let mut bytes = Vec::new();
    for corner in 0..8_u32 {
        for axis in 0..3 {
            bytes.extend((if corner >> axis & 1 == 1 { length } else { 0.0 }).to_le_bytes());
        }
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in quads {
        [a, b, c, a, c, d].into_iter().for_each(|index: u16| bytes.extend(index.to_le_bytes()));
    }
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
"buffers":[{{"byteLength":{},"uri":"data:application/octet-stream;base64,{data}"}}],
"bufferViews":[{{"buffer":0,"byteLength":96}},{{"buffer":0,"byteOffset":96,"byteLength":72}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[{length},{length},{length}]}},
{{"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}}]}}"#,
        bytes.len()
    )
}

/// A page as XML: the tags that HTML leaves open are closed.
pub fn closed_tags(page: &str) -> String {
    let is_open = |tag: &str| ["meta ", "img ", "br>"].iter().any(|name| tag.starts_with(name));
    let close = |tag: &str| if is_open(tag) { tag.replacen('>', "/>", 1) } else { tag.to_owned() };
    page.split('<').map(close).collect::<Vec<_>>().join("<")
}
