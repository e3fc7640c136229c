//! Writes a shard as a tar, and reads it back sample by sample.

use gelsim_files::fail_point::Step;
use gelsim_files::input::{self, MAX_IMAGE_BYTES};
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::ControlFlow;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use gelsim_files::hash::to_hex;
use gelsim_files::write::{is_same_file, recreate_file};

/// One file of a sample.
pub struct Member {
    /// The end of its name, behind the sample's key and a dot.
    pub suffix: String,
    /// Its content.
    pub bytes: FileContent,
}

/// The content of a file, in memory or in the file of a [`super::spool::Spool`].
pub enum FileContent {
    /// In memory.
    InMemory(Vec<u8>),
    /// On disk.
    Spooled {
        /// The spool's file.
        file: Arc<File>,
        /// Offset of the content in it.
        at: u64,
        /// Number of bytes.
        length: usize,
    },
}

impl FileContent {
    /// Returns the number of bytes.
    pub fn byte_count(&self) -> usize {
        match self {
            Self::InMemory(bytes) => bytes.len(),
            Self::Spooled { length, .. } => *length,
        }
    }

    /// Returns the bytes as a vector; reads them if they are on disk.
    pub fn into_vec(self) -> io::Result<Vec<u8>> {
        match self {
            Self::InMemory(bytes) => Ok(bytes),
            spooled => spooled.read().map(Cow::into_owned),
        }
    }

    /// Returns the bytes; reads them if they are on disk.
    pub fn read(&self) -> io::Result<Cow<'_, [u8]>> {
        match self {
            Self::InMemory(bytes) => Ok(Cow::Borrowed(bytes)),
            Self::Spooled { file, at, length } => {
                let mut bytes = vec![0; *length];
                file.read_exact_at(&mut bytes, *at)?;
                Ok(Cow::Owned(bytes))
            }
        }
    }
}

impl Member {
    /// Makes a file in memory.
    pub fn new(suffix: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self { suffix: suffix.into(), bytes: FileContent::InMemory(bytes) }
    }
}

/// A tar that is being written.
pub struct TarWriter(BufWriter<HashingFile>);

impl TarWriter {
    /// Starts a tar and replaces what is at `path`.
    pub fn create(path: &Path) -> io::Result<Self> {
        let hashed = HashingFile { file: recreate_file(path)?, hash: Sha256::new(), bytes: 0 };
        // Images are larger than this buffer and are written past it.
        Ok(Self(BufWriter::with_capacity(1 << 14, hashed)))
    }

    /// Appends the files of a sample.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        for member in members {
            let mut header = tar::Header::new_ustar();
            header.set_path(format!("{key}.{}", member.suffix))?;
            header.set_size(member.bytes.byte_count() as u64);
            header.set_mode(0o644);
            // No times and owners, so that the same samples give the same bytes.
            header.set_mtime(0);
            header.set_uid(0);
            header.set_gid(0);
            header.set_cksum();
            let content = member.bytes.read()?;
            self.0.write_all(header.as_bytes())?;
            self.0.write_all(&content)?;
            self.0.write_all(&[0; BLOCK_BYTES][..content.len().next_multiple_of(BLOCK_BYTES) - content.len()])?;
        }
        Ok(())
    }

    /// Ends the tar and brings it to disk. It must still be the file at `path`. Returns its length and SHA-256.
    pub fn finish(&mut self, path: &Path) -> io::Result<(u64, String)> {
        self.0.write_all(&[0; EMPTY_BYTES as usize])?;
        self.0.flush()?;
        Step::ShardWritten.pause_if_requested(path);
        let hashed = self.0.get_ref();
        hashed.file.sync_all()?;
        if !is_same_file(&hashed.file, path) {
            return Err(io::Error::other("another process has replaced it"));
        }
        Ok((hashed.bytes, to_hex(&hashed.hash.clone().finalize())))
    }
}

/// Size of a tar's blocks, bytes: headers and contents fill complete blocks.
const BLOCK_BYTES: usize = 512;
/// Bytes of a tar without files: the two empty blocks at its end.
pub const EMPTY_BYTES: u64 = 2 * BLOCK_BYTES as u64;

/// Returns the bytes that a sample's files take in a tar: each has a header, and both fill blocks.
pub fn tar_bytes_of(members: &[Member]) -> u64 {
    members.iter().map(|member| (BLOCK_BYTES + member.bytes.byte_count().next_multiple_of(BLOCK_BYTES)) as u64).sum()
}

/// A file that hashes what is written to it.
struct HashingFile {
    file: File,
    hash: Sha256,
    bytes: u64,
}

impl Write for HashingFile {
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
pub struct SampleFiles {
    /// The sample's key.
    pub key: String,
    /// The end of each file's name, behind the key and a dot, and its content, in order.
    pub members: Vec<(String, Vec<u8>)>,
}

impl SampleFiles {
    /// Returns the content of the file whose name ends in `suffix`, or `None` if there is none.
    pub fn find_member(&self, suffix: &str) -> Option<&[u8]> {
        self.members.iter().find(|(name, _)| name == suffix).map(|(_, bytes)| bytes.as_slice())
    }

    /// Returns the files of one finger of a grip as those of a press. Their key is the sample's with the finger's name
    /// behind it.
    pub fn finger_files(&self, finger: &str) -> Self {
        let own = |(suffix, bytes): &(String, Vec<u8>)| {
            let (name, suffix) = suffix.split_once('.')?;
            (name == finger).then(|| (suffix.to_owned(), bytes.clone()))
        };
        Self { key: format!("{}.{finger}", self.key), members: self.members.iter().filter_map(own).collect() }
    }
}

/// What a tar says about a file before its content is read.
#[derive(Clone, Copy, Debug)]
pub struct MemberHead<'a> {
    /// The sample's key.
    pub key: &'a str,
    /// The end of the name, behind the key and a dot.
    pub suffix: &'a str,
    /// Length of the content, bytes.
    pub bytes: u64,
}

/// Most bytes of a file's name, and of an extended header.
const MAX_NAME_BYTES: u64 = 64 << 10;

/// What may be in a tar, and how the names of its files are split into key and suffix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TarOrigin {
    /// A shard of gelsim: files only, whose keys end at the first dot.
    Gelsim,
    /// A tar of any program, read as WebDataset does: keys end at the first dot of the file's own name, in whatever
    /// folder it is. A `./` before a name does not count. Folders and hidden files are passed over.
    WebDataset,
}

impl TarOrigin {
    /// Splits a name into key and suffix.
    fn split_name(self, name: &[u8]) -> Option<(&str, &str)> {
        let name = str::from_utf8(name).ok()?;
        let folders = match self {
            Self::Gelsim => 0,
            Self::WebDataset => name.rfind('/').map_or(0, |slash| slash + 1),
        };
        let dot = folders + name[folders..].find('.')?;
        Some((&name[..dot], &name[dot + 1..]))
    }
}

/// Returns true if a file's own name begins with a dot.
fn is_hidden(name: &[u8]) -> bool {
    name.rsplit(|byte| *byte == b'/').next().is_some_and(|own| own.starts_with(b"."))
}

/// Calls `visit` with every sample of the tar at `path`, until that breaks off. For each file `wanted` returns the most
/// bytes that it may have, or `None` to skip it without reading.
pub fn visit_tar_file(
    path: &Path,
    wanted: impl FnMut(MemberHead) -> Option<u64>,
    visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
) -> Result<(), String> {
    visit_file(path, TarOrigin::Gelsim, wanted, visit)
}

/// Does what [`visit_tar_file`] does for a tar of any program, in which samples may be in folders.
pub fn visit_webdataset_file(
    path: &Path,
    wanted: impl FnMut(MemberHead) -> Option<u64>,
    visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
) -> Result<(), String> {
    visit_file(path, TarOrigin::WebDataset, wanted, visit)
}

fn visit_file(
    path: &Path,
    origin: TarOrigin,
    wanted: impl FnMut(MemberHead) -> Option<u64>,
    visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
) -> Result<(), String> {
    let (file, length) = input::open_without_links(path).map_err(|error| error.to_string())?;
    let mut archive = tar::Archive::new(SkippingReader(BufReader::with_capacity(1 << 14, file)));
    visit_entries(archive.entries_with_seek().map_err(|error| error.to_string())?, length, origin, wanted, visit)
}

/// Calls `visit` with every sample of a tar, with all its files, until that breaks off.
pub fn visit_tar(tar: impl Read, visit: impl FnMut(SampleFiles) -> ControlFlow<()>) -> Result<(), String> {
    let mut archive = tar::Archive::new(tar);
    let entries = archive.entries().map_err(|error| error.to_string())?;
    visit_entries(entries, u64::MAX, TarOrigin::Gelsim, |_| Some(MAX_IMAGE_BYTES), visit)
}

/// Visits the samples of a tar. Files with the same key that follow each other are one sample. Memory is limited to
/// that of the largest sample, whatever a header says. `length` is that of the tar in bytes, beyond which nothing may
/// be skipped.
fn visit_entries<R: Read>(
    entries: tar::Entries<R>,
    length: u64,
    origin: TarOrigin,
    mut wanted: impl FnMut(MemberHead) -> Option<u64>,
    mut visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
) -> Result<(), String> {
    let mut sample: Option<SampleFiles> = None;
    let mut extended = ExtendedHeader::default();
    // Raw entries: the crate would read long names and extended headers of any length into memory, and unfold sparse
    // files.
    for entry in entries.raw(true) {
        let mut entry = entry.map_err(|error| format!("not a tar: {error}"))?;
        if extended.read(&mut entry)? {
            continue;
        }
        let size = entry.size();
        let name = extended.name.take().unwrap_or_else(|| entry.path_bytes().into_owned());
        let shown = escape_name(&name);
        let short = |bytes: u64| Err(format!("{shown} ends after {bytes} of {size} bytes"));
        // A header may claim any size, but no memory is taken for more than there is.
        let bytes_left = length.saturating_sub(entry.raw_file_position());
        if bytes_left < size {
            return short(bytes_left);
        }
        let other_size = extended.size.take().filter(|told| *told != size);
        if entry.header().entry_type().is_gnu_sparse() || std::mem::take(&mut extended.sparse) || other_size.is_some() {
            return Err(format!("{shown} is sparse, or larger than 8 GB: write the tar without either"));
        }
        let mut name = name.as_slice();
        if origin == TarOrigin::WebDataset {
            if entry.header().entry_type().is_dir() || is_hidden(name) {
                continue;
            }
            while let Some(rest) = name.strip_prefix(b"./") {
                name = rest;
            }
        }
        if !entry.header().entry_type().is_file() {
            return Err(format!("{shown} is no regular file"));
        }
        let Some((key, suffix)) = origin.split_name(name) else {
            return Err(format!("{shown} is not named KEY.LAYER"));
        };
        if name.starts_with(b"/") || name.split(|byte| *byte == b'/').any(|step| step == b"..") {
            return Err(format!("{shown} leads out of the folder that the tar is unpacked in"));
        }
        if sample.as_ref().is_some_and(|files| files.key != key)
            && let Some(files) = sample.take()
            && visit(files).is_break()
        {
            return Ok(());
        }
        let files = sample.get_or_insert_with(|| SampleFiles { key: key.to_owned(), members: Vec::new() });
        if let Some(most) = wanted(MemberHead { key, suffix, bytes: size }) {
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
        // This is the last sample, so it does not matter whether the visit breaks off.
        let _ = visit(files);
    }
    Ok(())
}

/// Returns the beginning of a name with its control characters escaped, so that it cannot control a terminal.
fn escape_name(name: &[u8]) -> String {
    const MAX_CHARS: usize = 200;
    let start = String::from_utf8_lossy(&name[..name.len().min(4 * MAX_CHARS)]);
    start.chars().take(MAX_CHARS).flat_map(char::escape_debug).collect()
}

/// What the headers before a file's own header say about it.
#[derive(Default)]
struct ExtendedHeader {
    name: Option<Vec<u8>>,
    size: Option<u64>,
    sparse: bool,
}

impl ExtendedHeader {
    /// Reads `entry` if it is an extended header. Returns false if it is a file.
    fn read<R: Read>(&mut self, entry: &mut tar::Entry<'_, R>) -> Result<bool, String> {
        let kind = entry.header().entry_type();
        let is_name = kind.is_gnu_longname();
        let for_one = kind.is_pax_local_extensions();
        if !(is_name || for_one || kind.is_gnu_longlink() || kind.is_pax_global_extensions()) {
            return Ok(false);
        }
        if entry.size() > MAX_NAME_BYTES {
            return Err(format!("a name or an extended header has {} bytes, more than 64 KB", entry.size()));
        }
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|error| format!("an extended header: {error}"))?;
        if is_name {
            // The name ends in zeros.
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

/// A buffered file in which a skip keeps what the buffer already holds.
struct SkippingReader(BufReader<File>);

impl Read for SkippingReader {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.read(bytes)
    }
}

impl Seek for SkippingReader {
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

    fn samples(tar: &[u8]) -> Result<Vec<SampleFiles>, String> {
        let mut found = Vec::new();
        visit_tar(tar, |files| {
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
        assert_eq!(found[0].find_member("a.exr"), Some(&b"bc"[..]));
        assert_eq!(found[0].find_member("json"), None);
        let mut first = None;
        visit_tar(tar.as_slice(), |files| {
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
            let wanted = |head: MemberHead| {
                heads.push((head.key.to_owned(), head.bytes));
                (head.suffix == "json").then_some(2)
            };
            let visit = |files| {
                found.push(files);
                ControlFlow::Continue(())
            };
            visit_tar_file(&path, wanted, visit).map(|()| (heads, found))
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
            // Padding behind a file's last byte need not be there.
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

    #[test]
    fn tars_of_other_programs_have_samples_in_folders_and_shards_of_gelsim_do_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.tar");
        let visited = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("a file");
            let mut found = Vec::new();
            visit_webdataset_file(
                &path,
                |_| Some(9),
                |files| {
                    found.push((files.key, files.members.into_iter().map(|(suffix, _)| suffix).collect::<Vec<_>>()));
                    ControlFlow::Continue(())
                },
            )
            .map(|()| found)
        };
        for (name, key, suffix) in [
            ("000.png", "000", "png"),
            ("000.tactile.png", "000", "tactile.png"),
            ("./000.png", "000", "png"),
            ("v1.0/000.png", "v1.0/000", "png"),
            ("././v1.0/000.depth.exr", "v1.0/000", "depth.exr"),
            ("a/.x/000.png", "a/.x/000", "png"),
        ] {
            let bytes = extended(&[], tar::EntryType::Regular, name.as_bytes());
            assert_eq!(visited(&bytes), Ok(vec![(key.to_owned(), vec![suffix.to_owned()])]), "{name}");
            let own = samples(&bytes).expect("a tar");
            assert_eq!(Some((&*own[0].key, &*own[0].members[0].0)), name.split_once('.'), "{name}");
        }
        for name in ["./", "./v1.0/"] {
            let bytes = extended(&[], tar::EntryType::Directory, name.as_bytes());
            assert_eq!(visited(&bytes), Ok(Vec::new()), "{name}");
            assert!(samples(&bytes).expect_err("a folder").contains("is no regular file"));
        }
        for name in ["._000.png", "v1.0/.DS_Store"] {
            let bytes = extended(&[], tar::EntryType::Regular, name.as_bytes());
            assert_eq!(visited(&bytes), Ok(Vec::new()), "{name}");
        }
        for name in ["README", "v1.0/README", "../0.png", "/0.png", ".//0.png"] {
            assert!(visited(&extended(&[], tar::EntryType::Regular, name.as_bytes())).is_err(), "{name}");
        }
    }

    /// Makes a tar of one file under `name`. Each header before it has a kind and a content.
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
