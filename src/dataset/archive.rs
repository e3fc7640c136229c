//! A shard as a tar: written, and read back sample by sample.

use gelsim_files::fail_point::Step;
use gelsim_files::input::{self, MOST_IMAGE_BYTES};
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::ControlFlow;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use gelsim_files::hash::hex;
use gelsim_files::write::{create_anew, same_file};

/// One file of a sample.
pub struct Member {
    /// The end of its name, after key and dot.
    pub suffix: String,
    /// Its content.
    pub bytes: Bytes,
}

/// The content of a file, in memory or where a [`super::spool::Spool`] keeps it.
pub enum Bytes {
    /// In memory.
    Held(Vec<u8>),
    /// On disk.
    Spooled {
        /// The spool.
        file: Arc<File>,
        /// Where it begins.
        at: u64,
        /// Bytes.
        length: usize,
    },
}

impl Bytes {
    /// How many there are.
    pub fn count(&self) -> usize {
        match self {
            Self::Held(bytes) => bytes.len(),
            Self::Spooled { length, .. } => *length,
        }
    }

    /// All of them, for keeps.
    pub fn into_vec(self) -> io::Result<Vec<u8>> {
        match self {
            Self::Held(bytes) => Ok(bytes),
            spooled => spooled.read().map(Cow::into_owned),
        }
    }

    /// All of them.
    pub fn read(&self) -> io::Result<Cow<'_, [u8]>> {
        match self {
            Self::Held(bytes) => Ok(Cow::Borrowed(bytes)),
            Self::Spooled { file, at, length } => {
                let mut bytes = vec![0; *length];
                file.read_exact_at(&mut bytes, *at)?;
                Ok(Cow::Owned(bytes))
            }
        }
    }
}

impl Member {
    /// Of a name's end and the content.
    pub fn new(suffix: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self { suffix: suffix.into(), bytes: Bytes::Held(bytes) }
    }
}

/// A tar being written.
pub struct Writer(BufWriter<Hashed>);

impl Writer {
    /// Starts a tar in place of what is at `path`.
    pub fn create(path: &Path) -> io::Result<Self> {
        let hashed = Hashed { file: create_anew(path)?, hash: Sha256::new(), bytes: 0 };
        // Pictures are larger, and go past the buffer.
        Ok(Self(BufWriter::with_capacity(1 << 14, hashed)))
    }

    /// Appends a sample's files.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        for member in members {
            let mut header = tar::Header::new_ustar();
            header.set_path(format!("{key}.{}", member.suffix))?;
            header.set_size(member.bytes.count() as u64);
            header.set_mode(0o644);
            header.set_mtime(0);
            header.set_uid(0);
            header.set_gid(0);
            header.set_cksum();
            let content = member.bytes.read()?;
            self.0.write_all(header.as_bytes())?;
            self.0.write_all(&content)?;
            self.0.write_all(&[0; BLOCK][..content.len().next_multiple_of(BLOCK) - content.len()])?;
        }
        Ok(())
    }

    /// Brings to disk what was begun at `path`, which must still be there. Its length and SHA-256.
    pub fn finish(&mut self, path: &Path) -> io::Result<(u64, String)> {
        self.0.write_all(&[0; EMPTY_BYTES as usize])?;
        self.0.flush()?;
        Step::ShardWritten.reached(path);
        let hashed = self.0.get_ref();
        hashed.file.sync_all()?;
        if !same_file(&hashed.file, path) {
            return Err(io::Error::other("another process has replaced it"));
        }
        Ok((hashed.bytes, hex(&hashed.hash.clone().finalize())))
    }
}

/// Headers and contents of files fill blocks of so many bytes.
const BLOCK: usize = 512;
/// Bytes that a tar has besides its files: two empty blocks at its end.
pub const EMPTY_BYTES: u64 = 2 * BLOCK as u64;

/// Bytes that a sample's files take in a tar: each with a header, in blocks.
pub fn bytes_of(members: &[Member]) -> u64 {
    members.iter().map(|member| (BLOCK + member.bytes.count().next_multiple_of(BLOCK)) as u64).sum()
}

/// A file that knows the SHA-256 of what was written to it.
struct Hashed {
    file: File,
    hash: Sha256,
    bytes: u64,
}

impl Write for Hashed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hash.update(&bytes[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The files of one sample.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Files {
    /// The sample's key.
    pub key: String,
    /// End of the name, after key and dot, and content of each file, in order.
    pub members: Vec<(String, Vec<u8>)>,
}

impl Files {
    /// The content of the file with the name's end `suffix`.
    pub fn member(&self, suffix: &str) -> Option<&[u8]> {
        self.members.iter().find(|(name, _)| name == suffix).map(|(_, bytes)| bytes.as_slice())
    }

    /// The files of one finger of a grip, as those of a press: `key` has the finger's name behind it.
    pub fn of_finger(&self, finger: &str) -> Self {
        let own = |(suffix, bytes): &(String, Vec<u8>)| {
            let (name, suffix) = suffix.split_once('.')?;
            (name == finger).then(|| (suffix.to_owned(), bytes.clone()))
        };
        Self { key: format!("{}.{finger}", self.key), members: self.members.iter().filter_map(own).collect() }
    }
}

/// What a tar says of one file before it is read.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// The sample's key.
    pub key: &'a str,
    /// End of the name, after key and dot.
    pub suffix: &'a str,
    /// Length of the content.
    pub bytes: u64,
}

/// Largest name of a file, and largest extended header, bytes.
const MOST_NAME_BYTES: u64 = 64 << 10;

/// Shows every sample of the tar at `path` to `visit`, until that breaks off. `wanted` says of each file how many bytes it
/// may hold at most, or that it is skipped without being read.
pub fn open(
    path: &Path,
    wanted: impl FnMut(Head) -> Option<u64>,
    visit: impl FnMut(Files) -> ControlFlow<()>,
) -> Result<(), String> {
    let (file, length) = input::open_inside(path).map_err(|error| error.to_string())?;
    let mut archive = tar::Archive::new(Skipping(BufReader::with_capacity(1 << 14, file)));
    walk(archive.entries_with_seek().map_err(|error| error.to_string())?, length, wanted, visit)
}

/// Shows every sample of a tar to `visit` with all its files, until that breaks off.
pub fn read(tar: impl Read, visit: impl FnMut(Files) -> ControlFlow<()>) -> Result<(), String> {
    let mut archive = tar::Archive::new(tar);
    walk(archive.entries().map_err(|error| error.to_string())?, u64::MAX, |_| Some(MOST_IMAGE_BYTES), visit)
}

/// What follows each other under one key is one sample. Takes no more memory than the sample that is largest, whatever a
/// header says; `length` is the tar's, beyond which nothing may be skipped.
fn walk<R: Read>(
    entries: tar::Entries<R>,
    length: u64,
    mut wanted: impl FnMut(Head) -> Option<u64>,
    mut visit: impl FnMut(Files) -> ControlFlow<()>,
) -> Result<(), String> {
    let mut sample: Option<Files> = None;
    let mut extended = Extended::default();
    // Raw: the crate would read long names and extended headers whole, however long they are, and unfold sparse files.
    for entry in entries.raw(true) {
        let mut entry = entry.map_err(|error| format!("not a tar: {error}"))?;
        if extended.read(&mut entry)? {
            continue;
        }
        let size = entry.size();
        let name = extended.name.take().unwrap_or_else(|| entry.path_bytes().into_owned());
        let shown = shown(&name);
        let short = |bytes: u64| Err(format!("{shown} ends after {bytes} of {size} bytes"));
        let there = length.saturating_sub(entry.raw_file_position());
        if there < size {
            return short(there);
        }
        let other_size = extended.size.take().filter(|told| *told != size);
        if entry.header().entry_type().is_gnu_sparse() || std::mem::take(&mut extended.sparse) || other_size.is_some() {
            return Err(format!("{shown} is sparse, or larger than 8 GB: write the tar without either"));
        }
        if !entry.header().entry_type().is_file() {
            return Err(format!("{shown} is no regular file"));
        }
        let split = str::from_utf8(&name).ok().and_then(|name| name.split_once('.'));
        let Some((key, suffix)) = split else { return Err(format!("{shown} is not named KEY.LAYER")) };
        if name.starts_with(b"/") || name.split(|byte| *byte == b'/').any(|step| step == b"..") {
            return Err(format!("{shown} leads out of the folder that the tar is unpacked in"));
        }
        if sample.as_ref().is_some_and(|files| files.key != key)
            && let Some(files) = sample.take()
            && visit(files).is_break()
        {
            return Ok(());
        }
        let files = sample.get_or_insert_with(|| Files { key: key.to_owned(), members: Vec::new() });
        if let Some(most) = wanted(Head { key, suffix, bytes: size }) {
            if size > most {
                return Err(format!("{shown} has {size} bytes, and a file of its kind at most {most}"));
            }
            let mut bytes = Vec::new();
            entry.read_to_end(&mut bytes).map_err(|error| format!("{shown}: {error}"))?;
            if bytes.len() as u64 != size {
                return short(bytes.len() as u64);
            }
            files.members.push((suffix.to_owned(), bytes));
        }
    }
    if extended.name.is_some() {
        return Err(String::from("not a tar: it ends after the name of a file"));
    }
    if let Some(files) = sample {
        // Whether it breaks off makes no difference at the end.
        let _ = visit(files);
    }
    Ok(())
}

/// The beginning of a name, so that it speaks to no terminal.
fn shown(name: &[u8]) -> String {
    const MOST: usize = 200;
    let whole = String::from_utf8_lossy(&name[..name.len().min(4 * MOST)]);
    whole.chars().take(MOST).flat_map(char::escape_debug).collect()
}

/// What headers before a file's own say of it.
#[derive(Default)]
struct Extended {
    name: Option<Vec<u8>>,
    size: Option<u64>,
    sparse: bool,
}

impl Extended {
    /// Reads `entry` if it is such a header; false if it is a file.
    fn read<R: Read>(&mut self, entry: &mut tar::Entry<'_, R>) -> Result<bool, String> {
        let kind = entry.header().entry_type();
        let is_name = kind.is_gnu_longname();
        let for_one = kind.is_pax_local_extensions();
        if !(is_name || for_one || kind.is_gnu_longlink() || kind.is_pax_global_extensions()) {
            return Ok(false);
        }
        if entry.size() > MOST_NAME_BYTES {
            return Err(format!("a name or an extended header has {} bytes, more than 64 KB", entry.size()));
        }
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|error| format!("an extended header: {error}"))?;
        if is_name {
            bytes.truncate(bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1));
            self.name = Some(bytes);
        } else if for_one {
            for field in tar::PaxExtensions::new(&bytes) {
                let field = field.map_err(|error| format!("an extended header: {error}"))?;
                match field.key_bytes() {
                    b"path" => self.name = Some(field.value_bytes().to_owned()),
                    b"size" => self.size = field.value().ok().and_then(|size| size.parse().ok()).or(Some(u64::MAX)),
                    key => self.sparse |= key.starts_with(b"GNU.sparse."),
                }
            }
        }
        Ok(true)
    }
}

/// A file of which parts are skipped: what the buffer holds already is not read again.
struct Skipping(BufReader<File>);

impl Read for Skipping {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.read(bytes)
    }
}

impl Seek for Skipping {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(by) => {
                self.0.seek_relative(by)?;
                self.0.stream_position()
            }
            _ => self.0.seek(to),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tar(files: &[(&str, &str)]) -> Vec<u8> {
        let mut builder = tar::Builder::new(Vec::new());
        for (name, text) in files {
            let mut header = tar::Header::new_ustar();
            header.set_path(name).expect("a name");
            header.set_size(text.len() as u64);
            header.set_cksum();
            builder.append(&header, text.as_bytes()).expect("memory");
        }
        builder.into_inner().expect("memory")
    }

    fn samples(tar: &[u8]) -> Result<Vec<Files>, String> {
        let mut found = Vec::new();
        read(tar, |files| {
            found.push(files);
            ControlFlow::Continue(())
        })?;
        Ok(found)
    }

    #[test]
    fn what_follows_each_other_under_one_key_is_one_sample() {
        let tar = tar(&[("0.png", "a"), ("0.a.exr", "bc"), ("1.png", ""), ("0.json", "d")]);
        let found = samples(&tar).expect("a tar");
        let keys: Vec<&str> = found.iter().map(|files| files.key.as_str()).collect();
        assert_eq!(keys, ["0", "1", "0"]);
        assert_eq!(found[0].member("a.exr"), Some(&b"bc"[..]));
        assert_eq!(found[0].member("json"), None);
        let mut first = None;
        read(tar.as_slice(), |files| {
            first = Some(files);
            ControlFlow::Break(())
        })
        .expect("a tar");
        assert_eq!(first.as_ref(), found.first());
    }

    #[test]
    fn only_what_is_wanted_is_read_and_the_rest_is_skipped() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.tar");
        let large = "x".repeat(100_000);
        let whole = tar(&[("0.png", &large), ("0.json", "{}"), ("1.png", "y"), ("1.json", "[]"), ("2.png", &large)]);
        let opened = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("a file");
            let (mut heads, mut found) = (Vec::new(), Vec::new());
            let wanted = |head: Head| {
                heads.push((head.key.to_owned(), head.bytes));
                (head.suffix == "json").then_some(2)
            };
            let visit = |files| {
                found.push(files);
                ControlFlow::Continue(())
            };
            open(&path, wanted, visit).map(|()| (heads, found))
        };
        let (heads, found) = opened(&whole).expect("a tar");
        assert_eq!(heads.iter().map(|(_, bytes)| *bytes).collect::<Vec<_>>(), [100_000, 2, 1, 2, 100_000]);
        let keys: Vec<&str> = found.iter().map(|files| files.key.as_str()).collect();
        assert_eq!(keys, ["0", "1", "2"]);
        assert_eq!(found[1].members, [(String::from("json"), b"[]".to_vec())]);
        assert!(found[2].members.is_empty());
        let error = opened(&whole[..150_000]).expect_err("cut in what is skipped");
        assert!(error.starts_with("2.png ends after ") && error.ends_with(" of 100000 bytes"), "{error}");
    }

    #[test]
    fn a_cut_tar_is_an_error_wherever_it_is_cut_but_between_files() {
        let whole = tar(&[("0.png", "some bytes"), ("0.json", "{}")]);
        assert_eq!(samples(&whole).expect("a tar").len(), 1);
        for length in (1..1536).filter(|length| length % 1024 != 0) {
            let found = samples(&whole[..length]);
            // The padding after a file's last byte is not missed.
            let padding = (512 + 10..1024).contains(&length);
            assert!(found.is_err() || padding, "{length}: {found:?}");
        }
        assert!(samples(b"").expect("no file").is_empty());
    }

    #[test]
    fn names_that_are_no_samples_are_refused() {
        assert!(samples(&tar(&[("README", "x")])).is_err());
        assert!(samples(&vec![7; 4096]).is_err());
    }

    /// A tar of one file under `name`, each header before it of a kind and with a content.
    fn extended(headers: &[(tar::EntryType, &[u8])], kind: tar::EntryType, name: &[u8]) -> Vec<u8> {
        let mut builder = tar::Builder::new(Vec::new());
        let mut append = |kind, name: &[u8], content: &[u8]| {
            let mut header = tar::Header::new_gnu();
            header.as_gnu_mut().expect("GNU's").name[..name.len()].copy_from_slice(name);
            header.set_entry_type(kind);
            header.set_size(content.len() as u64);
            header.set_cksum();
            builder.append(&header, content).expect("memory");
        };
        headers.iter().for_each(|(kind, content)| append(*kind, b"header", content));
        append(kind, name, b"y");
        builder.into_inner().expect("memory")
    }

    #[test]
    fn long_names_and_extended_headers_are_read_up_to_a_limit() {
        use tar::EntryType;
        let long = format!("{}.json", "k".repeat(300));
        let (gnu, pax) = (EntryType::GNULongName, EntryType::XHeader);
        let record = |key: &str, value: &str| format!("{} {key}={value}\n", key.len() + value.len() + 6).into_bytes();
        let of = |headers: &[(EntryType, &[u8])]| samples(&extended(headers, EntryType::Regular, b"0.json"));
        let key = |headers: &[(EntryType, &[u8])]| of(headers).expect("a tar")[0].key.len();
        assert_eq!(key(&[]), 1);
        assert_eq!(key(&[(gnu, format!("{long}\0").as_bytes())]), 300);
        assert_eq!(key(&[(pax, &record("path", &long)), (EntryType::GNULongLink, b"link")]), 300);
        assert_eq!(key(&[(EntryType::XGlobalHeader, b"9 a=b c\n"), (pax, b"10 size=1\n")]), 1);
        let wrong = |headers: &[(EntryType, &[u8])]| of(headers).expect_err("refused");
        let huge = vec![b'k'; 70_000];
        for kind in [gnu, pax, EntryType::GNULongLink, EntryType::XGlobalHeader] {
            assert!(wrong(&[(kind, &huge)]).contains("70000 bytes, more than 64 KB"));
        }
        assert!(wrong(&[(pax, b"22 size=9999999999999\n")]).contains("larger than 8 GB"));
        assert!(wrong(&[(pax, b"22 GNU.sparse.major=1\n")]).contains("sparse"));
        assert!(wrong(&[(pax, b"nonsense")]).contains("extended header"));
        let alone = samples(&extended(&[], gnu, b"0.json")).expect_err("a name of nothing");
        assert!(alone.contains("ends after the name"), "{alone}");
        assert!(samples(&extended(&[], EntryType::GNUSparse, b"0.json")).expect_err("sparse").contains("sparse"));
        for name in ["../0.png", "a/../0.png", "/0.png", "..", "a/.."] {
            let found = samples(&extended(&[], EntryType::Regular, name.as_bytes())).expect_err("outside");
            assert!(found.contains(name) && (found.contains("leads out") || found.contains("KEY.LAYER")), "{found}");
        }
    }
}
