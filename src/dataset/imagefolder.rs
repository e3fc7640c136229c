//! Writes a shard as a folder in the layout of Hugging Face's imagefolder: the files of each sample, and metadata.jsonl
//! with one row per sample. The folder is written under another name and renamed. It is read back sample by sample.
//!
//! The size of a folder is the sum of the sizes of its files. Its checksum is that of what `sha256sum` prints for them
//! in the order of their names: `(cd data/train-000000 && LC_ALL=C sha256sum *) | sha256sum`. Only files with names
//! that gelsim gives count, and no file is opened through a link.

use gelsim_files::fail_point::Step;
use gelsim_files::input;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::ops::ControlFlow;
use std::path::Path;

use rustix::fs::{AtFlags, CWD, Dir, FileType, Mode, OFlags, openat, statat, unlinkat};
use sha2::{Digest, Sha256};

use super::archive::{Member, MemberHead, SampleFiles};
use gelsim_files::hash::to_hex;
use gelsim_files::write::{is_same_file, sync_all_in};

mod rows;

use rows::{EMPTY_LABEL, LABEL_SUFFIX};
pub use rows::{RowComparison, build_rows};

/// The file with a row per sample.
pub const METADATA_FILE: &str = "metadata.jsonl";

/// A folder that is being written.
pub struct FolderWriter {
    folder: File,
    /// Name of the shard, which is the folder's final name in `data`.
    shard: String,
    metadata: BufWriter<File>,
    sums: ChecksumList,
    metadata_hash: Sha256,
    metadata_bytes: u64,
}

impl FolderWriter {
    /// Makes the folder at `path`, where nothing may be, for the shard called `shard`.
    pub fn create(path: &Path, shard: &str) -> io::Result<Self> {
        std::fs::create_dir(path)?;
        let folder = open_folder(path)?;
        let metadata = BufWriter::new(create_file(&folder, METADATA_FILE)?);
        let (metadata_hash, metadata_bytes) = (Sha256::new(), 0);
        Ok(Self {
            folder,
            shard: shard.to_owned(),
            metadata,
            sums: ChecksumList::default(),
            metadata_hash,
            metadata_bytes,
        })
    }

    /// Writes the files of a sample and its row. Keys must come in ascending order.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        let mut in_order: Vec<&Member> = members.iter().collect();
        in_order.sort_by(|a, b| a.suffix.cmp(&b.suffix));
        let mut label = Cow::Borrowed(EMPTY_LABEL);
        for member in &in_order {
            let name = format!("{key}.{}", member.suffix);
            let bytes = member.bytes.read()?;
            create_file(&self.folder, &name)?.write_all(&bytes)?;
            self.sums.add(&name, bytes.len() as u64, Sha256::digest(&bytes).as_slice());
            if member.suffix == LABEL_SUFFIX {
                label = bytes;
            }
        }
        let row = build_rows(&self.shard, key, &label, in_order.iter().map(|member| member.suffix.as_str()));
        self.metadata_hash.update(&row);
        self.metadata_bytes += row.len() as u64;
        self.metadata.write_all(&row)
    }

    /// Completes the folder and brings it to disk. It must still be what is at `path`. Returns its bytes and checksum.
    pub fn finish(&mut self, path: &Path) -> io::Result<(u64, String)> {
        self.metadata.flush()?;
        Step::ShardWritten.pause_if_requested(path);
        sync_all_in(&self.folder)?;
        if !is_same_file(&self.folder, path) {
            return Err(io::Error::other("another process has replaced it"));
        }
        // metadata.jsonl sorts behind the keys, which begin with digits.
        let hash = std::mem::take(&mut self.metadata_hash).finalize();
        self.sums.add(METADATA_FILE, self.metadata_bytes, hash.as_slice());
        Ok(std::mem::take(&mut self.sums).finish())
    }
}

/// The hash of what `sha256sum` would print, and the sum of the lengths.
#[derive(Default)]
struct ChecksumList {
    lines: Sha256,
    bytes: u64,
}

impl ChecksumList {
    fn add(&mut self, name: &str, bytes: u64, hash: &[u8]) {
        self.lines.update(format!("{}  {name}\n", to_hex(hash)));
        self.bytes += bytes;
    }

    fn finish(self) -> (u64, String) {
        (self.bytes, to_hex(&self.lines.finalize()))
    }
}

/// The names in a folder: those that gelsim gives, sorted, and others.
struct FolderNames {
    ours: Vec<String>,
    others: Vec<String>,
}

/// Returns true for a name that gelsim gives to a file in a shard's folder: metadata.jsonl, or a sample's key and a
/// layer.
fn is_ours(name: &str) -> bool {
    let key = |(key, layer): (&str, &str)| {
        key.len() == 9 && key.bytes().all(|byte| byte.is_ascii_digit()) && !layer.is_empty()
    };
    name == METADATA_FILE || name.split_once('.').is_some_and(key)
}

fn open_folder(path: &Path) -> io::Result<File> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    Ok(openat(CWD, path, flags, Mode::empty())?.into())
}

fn create_file(folder: &File, name: &str) -> io::Result<File> {
    let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    Ok(openat(folder, name, flags, Mode::from_raw_mode(0o666))?.into())
}

fn list_names(folder: &File) -> io::Result<FolderNames> {
    let (mut ours, mut others) = (Vec::new(), Vec::new());
    for entry in Dir::read_from(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy();
        match &*name {
            "." | ".." => {}
            name if is_ours(name) => ours.push(name.to_owned()),
            name => others.push(name.to_owned()),
        }
    }
    ours.sort();
    others.sort();
    Ok(FolderNames { ours, others })
}

/// Opens a file that must be a regular one.
fn open_own_file(folder: &File, name: &str) -> io::Result<File> {
    // Opening a pipe would otherwise wait for its other end.
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let strange = || io::Error::other("is no regular file");
    let file: File = match openat(folder, name, flags, Mode::empty()) {
        Err(rustix::io::Errno::LOOP) => return Err(strange()),
        opened => opened?.into(),
    };
    if file.metadata()?.is_file() { Ok(file) } else { Err(strange()) }
}

/// Lists the files in the folder at `path` that have other names than gelsim gives.
pub fn list_foreign_files(path: &Path) -> io::Result<Vec<String>> {
    Ok(list_names(&open_folder(path)?)?.others)
}

/// Finds the first file in the folder at `path` that has a name of gelsim's but is not a regular file, and returns its
/// name. A file that another process removes meanwhile is ignored.
pub fn find_strange_file(path: &Path) -> io::Result<Option<String>> {
    match find_strange_file_in(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        found => found,
    }
}

fn find_strange_file_in(path: &Path) -> io::Result<Option<String>> {
    let folder = open_folder(path)?;
    for name in list_names(&folder)?.ours {
        if FileType::from_raw_mode(statat(&folder, &name, AtFlags::SYMLINK_NOFOLLOW)?.st_mode) != FileType::RegularFile
        {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// Removes gelsim's files in the folder at `path`, and the folder. If something else is in it, that and the folder
/// stay, and it is an error.
pub fn remove_folder(path: &Path) -> io::Result<()> {
    let folder = open_folder(path)?;
    for name in list_names(&folder)?.ours {
        unlinkat(&folder, &name, AtFlags::empty())?;
    }
    check_no_foreign_files(path)?;
    std::fs::remove_dir(path)
}

/// Returns an error if there is a folder at `path` with a file that gelsim did not make.
pub fn check_no_foreign_files(path: &Path) -> io::Result<()> {
    let others = match list_foreign_files(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        others => others?,
    };
    let Some(first) = others.first() else { return Ok(()) };
    let what = format!("{} is in it, which gelsim did not make: move it away", path.join(first).display());
    Err(io::Error::new(io::ErrorKind::DirectoryNotEmpty, what))
}

/// Returns the sum of the sizes of the files in the folder at `path`, without following links.
pub fn measure_bytes(path: &Path) -> io::Result<u64> {
    let folder = open_folder(path)?;
    let mut bytes = 0;
    for name in list_names(&folder)?.ours {
        bytes += statat(&folder, &name, AtFlags::SYMLINK_NOFOLLOW)?.st_size as u64;
    }
    Ok(bytes)
}

/// Returns the bytes and the checksum of the folder at `path`. Reads all of it.
pub fn checksum_folder(path: &Path) -> io::Result<(u64, String)> {
    let folder = open_folder(path)?;
    let (mut sums, mut buffer) = (ChecksumList::default(), vec![0; 1 << 16]);
    for name in list_names(&folder)?.ours {
        let named = |error: io::Error| io::Error::new(error.kind(), format!("{name}: {error}"));
        let mut file = open_own_file(&folder, &name).map_err(named)?;
        let (mut hash, mut bytes) = (Sha256::new(), 0);
        loop {
            match file.read(&mut buffer).map_err(named)? {
                0 => break,
                count => {
                    hash.update(&buffer[..count]);
                    bytes += count as u64;
                }
            }
        }
        sums.add(&name, bytes, hash.finalize().as_slice());
    }
    Ok(sums.finish())
}

/// Calls `visit` with every sample of the folder at `path`, in the order of their keys, until that breaks off. Only
/// files for which `wanted` returns true are read.
pub fn visit_folder(
    path: &Path,
    mut wanted: impl FnMut(MemberHead<'_>) -> bool,
    mut visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
) -> Result<(), String> {
    let said = |error: io::Error| error.to_string();
    let folder = open_folder(path).map_err(said)?;
    let names = list_names(&folder).map_err(said)?.ours;
    let samples: Vec<&String> = names.iter().filter(|name| *name != METADATA_FILE).collect();
    for names in samples.chunk_by(|a, b| a[..9] == b[..9]) {
        let mut files = SampleFiles { key: names[0][..9].to_owned(), members: Vec::new() };
        for name in names {
            let (key, suffix) = name.split_once('.').ok_or_else(|| format!("{name} is not named KEY.LAYER"))?;
            let file = open_own_file(&folder, name).map_err(|error| format!("{name}: {error}"))?;
            let bytes = file.metadata().map_err(said)?.len();
            if wanted(MemberHead { key, suffix, bytes }) {
                let bytes = input::read_open_file((file, bytes), input::MAX_IMAGE_BYTES);
                let bytes = bytes.map_err(|error| format!("{name}: {error}"))?;
                files.members.push((suffix.to_owned(), bytes));
            }
        }
        if visit(files).is_break() {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(suffix: &str, bytes: &[u8]) -> Member {
        Member::new(suffix, bytes.to_vec())
    }

    /// A folder with two samples, its bytes and checksum.
    fn written(path: &Path) -> (u64, String) {
        let mut writer = FolderWriter::create(path, "val-000007").expect("a new folder");
        for key in ["000000003", "000000010"] {
            let members = [member("tactile.png", b"T"), member("depth.exr", b"DD"), member("json", b"{\"a\":1}")];
            writer.append(key, &members).expect("room");
        }
        writer.finish(path).expect("room")
    }

    #[test]
    fn what_is_written_is_read_back_and_its_checksum_is_found_again() {
        let root = tempfile::tempdir().expect("a folder");
        let path = root.path().join("shard");
        let written = written(&path);
        assert_eq!(checksum_folder(&path).expect("readable"), written);
        assert_eq!(measure_bytes(&path).expect("readable"), written.0);
        let mut found = Vec::new();
        let mut rows = RowComparison::open(&path, "val-000007").expect("metadata");
        let read = visit_folder(
            &path,
            |_| true,
            |files| {
                rows.compare_row(&files);
                found.push(files);
                ControlFlow::Continue(())
            },
        );
        assert_eq!((read, rows.finish()), (Ok(()), None));
        let keys: Vec<&str> = found.iter().map(|files| files.key.as_str()).collect();
        assert_eq!(keys, ["000000003", "000000010"]);
        assert_eq!(found[0].find_member("depth.exr"), Some(&b"DD"[..]));
        let (mut labels, mut sizes) = (Vec::new(), Vec::new());
        let wanted = |head: MemberHead<'_>| {
            sizes.push(head.bytes);
            head.suffix == "json"
        };
        let visit = |files: SampleFiles| {
            labels.push(files);
            ControlFlow::Break(())
        };
        super::visit_folder(&path, wanted, visit).expect("readable");
        assert_eq!((labels[0].key.as_str(), labels[0].members.len(), labels.len()), ("000000003", 1, 1));
        assert_eq!(sizes.len(), found[0].members.len(), "what follows is not looked at");
    }

    /// The command that the module's head names, done by hand.
    #[test]
    fn the_checksum_is_that_of_sha256sums_lines() {
        let root = tempfile::tempdir().expect("a folder");
        let path = root.path().join("shard");
        let (_, found) = written(&path);
        let script = "cd \"$1\" && LC_ALL=C sha256sum * | sha256sum | cut -d ' ' -f 1";
        let output = std::process::Command::new("sh").args(["-c", script, "sh"]).arg(&path).output();
        assert_eq!(String::from_utf8_lossy(&output.expect("a shell").stdout).trim(), found);
    }

    #[test]
    fn every_change_changes_the_checksum_and_files_of_others_do_not() {
        let root = tempfile::tempdir().expect("a folder");
        let path = root.path().join("shard");
        let (bytes, whole) = written(&path);
        let at = |name: &str| path.join(name);
        std::fs::write(at(".DS_Store"), "x").expect("a file");
        std::fs::write(at("notes.txt"), "x").expect("a file");
        assert_eq!(checksum_folder(&path).expect("readable"), (bytes, whole.clone()));
        assert_eq!(list_foreign_files(&path).expect("readable"), [".DS_Store", "notes.txt"]);
        let differs = |what: &str| assert_ne!(checksum_folder(&path).expect("readable").1, whole, "{what}");
        std::fs::rename(at("000000003.json"), at("000000004.json")).expect("a file");
        differs("renamed");
        std::fs::rename(at("000000004.json"), at("000000003.json")).expect("a file");
        std::fs::write(at("000000003.depth.exr"), "DE").expect("a file");
        differs("changed");
        std::fs::write(at("000000003.depth.exr"), "DD").expect("a file");
        std::fs::write(at("000000011.json"), "").expect("a file");
        differs("one more");
        remove_folder(&path).expect_err("files of others are in it");
        assert_eq!(std::fs::read_dir(&path).expect("a folder").count(), 2, "which stay");
    }

    #[test]
    fn a_row_that_is_not_the_samples_is_named() {
        let root = tempfile::tempdir().expect("a folder");
        let path = root.path().join("shard");
        written(&path);
        let text = std::fs::read_to_string(path.join(METADATA_FILE)).expect("rows");
        let wrong = |text: &str| {
            std::fs::write(path.join(METADATA_FILE), text).expect("rows");
            let mut rows = RowComparison::open(&path, "val-000007").expect("metadata");
            let compare = |files: SampleFiles| {
                rows.compare_row(&files);
                ControlFlow::Continue(())
            };
            visit_folder(&path, |_| true, compare).expect("readable");
            rows.finish()
        };
        assert_eq!(wrong(&text), None);
        assert_eq!(wrong(&format!("{text}\n")), Some(format!("{METADATA_FILE}: it has more rows than samples")));
        for damaged in [text.replace("\"a\":1", "\"a\":2"), text[1..].to_owned(), String::new()] {
            assert_eq!(wrong(&damaged), Some(format!("{METADATA_FILE}: its row of sample 000000003 is another")));
        }
    }

    #[test]
    fn nothing_is_read_or_removed_through_a_link() {
        let root = tempfile::tempdir().expect("a folder");
        let (path, linked) = (root.path().join("shard"), root.path().join("linked"));
        written(&path);
        assert_eq!(find_strange_file(&path).expect("readable"), None);
        std::os::unix::fs::symlink(&path, &linked).expect("a link");
        assert!(
            checksum_folder(&linked).is_err()
                && remove_folder(&linked).is_err()
                && visit_folder(&linked, |_| true, |_| panic!("read")).is_err()
        );
        let label = path.join("000000003.json");
        std::fs::remove_file(&label).expect("a file");
        std::os::unix::fs::symlink("/etc/passwd", &label).expect("a link");
        assert_eq!(find_strange_file(&path).expect("readable").as_deref(), Some("000000003.json"));
        let read = visit_folder(&path, |_| true, |_| ControlFlow::Continue(()));
        assert_eq!(read, Err(String::from("000000003.json: is no regular file")));
        assert!(checksum_folder(&path).expect_err("a link").to_string().contains("000000003.json: is no regular file"));
    }
}
