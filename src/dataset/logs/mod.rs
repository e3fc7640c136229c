//! Logs that robots record: MCAP, bags of ROS 1, and bags of ROS 2, which are folders of MCAP or SQLite files.
//!
//! [`Log::open`] goes through a log once and notes where the messages of the [`messages::Kind`]s lie; [`Log::read`] then
//! reads any of them. Only one chunk at a time is in memory, and no length that a log claims is believed. What is
//! damaged or cut off is left out and noted as a [`Loss`].

pub mod compression;
pub mod fields;
mod mcap;
pub mod mcap_writer;
pub mod messages;
mod rosbag;
pub mod schemas;
mod sqlite;
mod store;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use compression::{Compression, MAX_CHUNK_BYTES};
use fields::Serialization;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::{foreign, input};
use messages::Kind;
use store::{Chunk, Place, Store};

/// Bytes of a message that are looked at.
const PEEKED: u64 = 1 << 12;

/// Endings of the names of logs.
pub const ENDINGS: [&str; 3] = ["mcap", "bag", "db3"];

/// A topic of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Name of the type of its messages, without `/msg/`.
    pub type_name: String,
    /// Kind of its messages; `None` if they are not read.
    pub kind: Option<Kind>,
    /// How its messages became bytes; `None` if that cannot be read.
    pub serialization: Option<Serialization>,
    /// Number of its messages.
    pub count: u64,
    /// Encoding of its first image, or the format if it is compressed; empty if it has no images.
    pub encoding: String,
}

impl Topic {
    /// Returns true if it carries depth images.
    pub fn is_depth(&self) -> bool {
        self.kind.is_some_and(|kind| messages::depth_unit(kind, &self.encoding).is_some())
    }
}

/// A message that can be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Number of its topic.
    pub topic: u32,
    /// Number of its file.
    file: u32,
    /// When it was written to the log, ns since the epoch.
    pub log_ns: u64,
    /// When it was taken, by its header, ns since the epoch; `log_ns` if that is 0.
    pub stamp_ns: u64,
    place: Place,
}

/// A part of a log that cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// The file.
    pub path: PathBuf,
    /// Number of its first byte.
    pub at: u64,
    /// Number of its bytes.
    pub bytes: u64,
    /// Number of bytes of the file.
    pub length: u64,
    /// What is wrong with it.
    pub reason: String,
}

impl Loss {
    /// Returns a warning that says what is lost.
    pub fn to_warning(&self) -> Diagnostic {
        let Self { path, at, bytes, length, reason } = self;
        Diagnostic::warning(format!("{}: {bytes} bytes from byte {at} of {length} are lost: {reason}", path.display()))
    }
}

/// A log whose messages were found.
#[derive(Debug)]
pub struct Log {
    /// The file or folder.
    pub path: PathBuf,
    /// Its topics, in the order in which they were met.
    pub topics: Vec<Topic>,
    /// The messages of the topics that have a kind, in the order in which they were written.
    pub entries: Vec<Entry>,
    /// What cannot be read.
    pub losses: Vec<Loss>,
    files: Vec<Store>,
}

/// Returns true if a path is that of a log by its name, or of a folder with the metadata of a ROS 2 bag.
pub fn is_log(path: &Path) -> bool {
    let ending = |path: &Path| ENDINGS.into_iter().any(|known| path.extension() == Some(OsStr::new(known)));
    ending(path) || (path.is_dir() && path.join("metadata.yaml").is_file())
}

impl Log {
    /// Goes through the log at `path`. The error says why there is none; one that is damaged is no error.
    pub fn open(path: &Path) -> Result<Self, Diagnostic> {
        let failed = |error: &dyn std::fmt::Display| {
            Diagnostic::new(format!("{}: {error}", path.display())).help("name a log that can be read")
        };
        let mut paths = vec![path.to_owned()];
        if path.is_dir() {
            let found = fs::read_dir(path).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
            let found = found.map_err(|error| failed(&error))?.into_iter().map(|entry| entry.path());
            let (packed, whole): (Vec<_>, Vec<_>) = found
                .filter(|path| input::may_be_file(path))
                .partition(|path| path.extension() == Some(OsStr::new("zstd")));
            if let Some(packed) = packed.first() {
                let problem = Diagnostic::new(format!("{} is compressed as a file", packed.display()));
                return Err(problem.help(format!("unpack it: zstd -d --rm {}", packed.display())));
            }
            paths = whole.into_iter().filter(|path| is_log(path)).collect();
            // The tenth file follows the ninth.
            paths.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
            if paths.is_empty() {
                let problem = Diagnostic::new(format!("the bag {} holds no .mcap and no .db3 file", path.display()));
                return Err(problem.help("name a bag with its files"));
            }
        }
        let mut index = Index::default();
        let mut files = Vec::new();
        for path in paths {
            let (file, length) = input::open(&path).map_err(|error| failed(&format!("{}: {error}", path.display())))?;
            files.push(Store::from_file(path, file, length));
        }
        index.scan_all(&mut files)?;
        Ok(index.into_log(path.to_owned(), files))
    }

    /// Goes through a log in memory, as [`Log::open`] does.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, Diagnostic> {
        let mut files = vec![Store::from_bytes(bytes)];
        let mut index = Index::default();
        index.scan_all(&mut files)?;
        Ok(index.into_log(PathBuf::from("log"), files))
    }

    /// Reads a message. The error says what is wrong with it.
    pub fn read(&self, entry: &Entry) -> Result<Vec<u8>, String> {
        let file = &self.files[entry.file as usize];
        let bytes = match entry.place {
            Place::File { at, len } => file.read_message(at, len),
            Place::Chunk { chunk, at, len } => file.read_from_chunk(chunk, at, len),
            Place::Row { page, cell } => sqlite::read_message(file, page, cell),
        }?;
        if !is_packed_message(&bytes) {
            return Ok(bytes);
        }
        let (bytes, unpacked) = Compression::Zstd.unpack(bytes.as_slice(), MAX_CHUNK_BYTES);
        unpacked.map(|()| bytes)
    }

    /// Returns the number of the topic of this name.
    pub fn find_topic(&self, name: &str) -> Option<u32> {
        self.topics.iter().position(|topic| topic.name == name).map(|at| at as u32)
    }

    /// Lists the topics with types and numbers of messages.
    pub fn describe_topics(&self) -> String {
        let line = |topic: &Topic| {
            let coded = if topic.encoding.is_empty() { String::new() } else { format!(", {}", topic.encoding) };
            let (name, kind) = (topic.name.escape_debug(), topic.type_name.escape_debug());
            format!("{name} ({kind}{}, {})", coded.escape_debug(), topic.count)
        };
        match self.topics.is_empty() {
            true => String::from("the log has no topics"),
            false => format!("its topics: {}", self.topics.iter().map(line).collect::<Vec<_>>().join(", ")),
        }
    }
}

/// What is known of a log while it is gone through.
#[derive(Default)]
struct Index {
    topics: Vec<Topic>,
    entries: Vec<Entry>,
    losses: Vec<Loss>,
    known: HashMap<(String, String, Option<Serialization>), u32>,
    file: u32,
}

impl Index {
    fn scan_all(&mut self, files: &mut [Store]) -> Result<(), Diagnostic> {
        for (number, file) in files.iter_mut().enumerate() {
            self.file = number as u32;
            let mut start = [0; 16];
            let count = file.read_some(0, &mut start).map_err(|error| {
                Diagnostic::new(format!("{}: {error}", file.path.display())).help("name a log that can be read")
            })?;
            match &start[..count] {
                start if start.starts_with(mcap::MAGIC) => self.scan_records(file, mcap::MAGIC, mcap::scan_records),
                start if start.starts_with(rosbag::MAGIC) => {
                    self.scan_records(file, rosbag::MAGIC, rosbag::scan_records);
                }
                start if start.starts_with(sqlite::MAGIC) => sqlite::scan(file, self),
                start => {
                    let what = match foreign::identify_foreign_binary(start) {
                        _ if start.starts_with(b"#ROSBAG V1") => {
                            String::from("a bag of before ROS 1.2: rosbag fix writes a newer one")
                        }
                        Some(foreign) => foreign.to_string(),
                        None => String::from("it begins like no log"),
                    };
                    let problem = Diagnostic::new(format!("{}: {what}", file.path.display()));
                    return Err(
                        problem.help("logs are MCAP, bags of ROS 1 (.bag) and of ROS 2 (a folder, .mcap or .db3)")
                    );
                }
            }
        }
        Ok(())
    }

    /// Has `scan` note topics, messages and losses of a file that is records one after another behind its `magic`. It
    /// moves the number of the byte that it is at, from which on the file is lost if it fails.
    fn scan_records(
        &mut self,
        file: &mut Store,
        magic: &[u8],
        scan: impl FnOnce(&mut Store, &mut Self, &mut u64) -> Result<(), String>,
    ) {
        let mut at = magic.len() as u64;
        if let Err(reason) = scan(file, self, &mut at) {
            self.lose_rest(file, at, reason);
        }
    }

    fn into_log(self, path: PathBuf, files: Vec<Store>) -> Log {
        let Self { topics, entries, losses, .. } = self;
        Log { path, topics, entries, losses, files }
    }

    /// Returns the number of a topic.
    fn topic(&mut self, name: &str, type_name: &str, serialization: Option<Serialization>) -> u32 {
        let type_name = type_name.replace("/msg/", "/");
        let key = (name.to_owned(), type_name, serialization);
        if let Some(known) = self.known.get(&key) {
            return *known;
        }
        let number = self.topics.len() as u32;
        self.known.insert(key.clone(), number);
        let (name, type_name, _) = key;
        let kind = serialization.and_then(|_| Kind::from_name(&type_name));
        self.topics.push(Topic { name, type_name, kind, serialization, count: 0, encoding: String::new() });
        number
    }

    /// Notes a message, of which `head` holds the first bytes.
    fn add_message(&mut self, topic: u32, log_ns: u64, place: Place, head: &[u8]) {
        let known = &mut self.topics[topic as usize];
        known.count += 1;
        let (Some(kind), Some(serialization)) = (known.kind, known.serialization) else { return };
        let unpacked;
        let head = if is_packed_message(head) {
            unpacked = Compression::Zstd.unpack(head, PEEKED).0;
            unpacked.as_slice()
        } else {
            head
        };
        let (stamp_ns, encoding) = messages::peek(kind, serialization, head).unwrap_or_default();
        if known.encoding.is_empty() {
            known.encoding = encoding.to_owned();
        }
        let stamp_ns = if stamp_ns == 0 { log_ns } else { stamp_ns };
        self.entries.push(Entry { topic, file: self.file, log_ns, stamp_ns, place });
    }

    /// Notes that `bytes` bytes of a file cannot be read, because of `reason`.
    fn lose(&mut self, file: &Store, at: u64, bytes: u64, reason: impl Into<String>) {
        let (path, length) = (file.path.clone(), file.length);
        self.losses.push(Loss { path, at, bytes, length, reason: reason.into() });
    }

    /// Notes that a file cannot be read from byte `at` on.
    fn lose_rest(&mut self, file: &Store, at: u64, reason: impl Into<String>) {
        self.lose(file, at, file.length.saturating_sub(at), reason);
    }
}

/// A record that holds compressed records.
#[derive(Clone, Copy)]
struct ChunkRecord<'a> {
    /// Number of the first byte of its content.
    body: u64,
    /// Number of bytes of its content.
    length: u64,
    /// Whether the file ends within it.
    is_cut: bool,
    /// Where in the file what is compressed is: its first byte, and the number of bytes.
    packed: (u64, u64),
    /// Name of the compression.
    compression: &'a [u8],
    /// Number of bytes to which it says that it unpacks.
    size: u64,
    /// Checksum of these bytes, if it has one.
    crc: Option<u32>,
}

impl Index {
    /// Unpacks a chunk, and has `scan` note what is in it, by its number and bytes. The error ends the file; a chunk that
    /// is damaged is noted and left out.
    fn scan_chunk(
        &mut self,
        file: &mut Store,
        record: ChunkRecord<'_>,
        scan: impl FnOnce(&mut Self, u32, &[u8]) -> Result<(), String>,
    ) -> Result<(), String> {
        let ChunkRecord { body, length, is_cut, packed: (at, len), compression, size, crc } = record;
        let Some(known) = Compression::from_name(compression) else {
            let name = String::from_utf8_lossy(compression).escape_debug().to_string();
            let reason = format!("a chunk is compressed by {name}; bz2, lz4 and zstd can be read");
            if is_cut {
                return Err(reason);
            }
            self.lose(file, body, length, reason);
            return Ok(());
        };
        let chunk = Chunk { at, len, compression: known, unpacked: size };
        let (bytes, unpacked) = file.unpack(chunk);
        let is_another = || match crc {
            _ if bytes.len() as u64 != size => Err(String::from("its size is another")),
            Some(crc) if crc32fast::hash(&bytes) != crc => Err(String::from("its checksum is another")),
            _ => Ok(()),
        };
        let mut found = if is_cut { Ok(()) } else { unpacked.and_then(|()| is_another()) };
        if found.is_ok() {
            let number = file.chunks.len() as u32;
            file.chunks.push(chunk);
            found = scan(self, number, &bytes);
        }
        if is_cut {
            return Err(String::from("the file is cut off within a chunk"));
        }
        if let Err(reason) = found {
            self.lose(file, body, length, format!("a damaged chunk: {reason}"));
        }
        Ok(())
    }
}

/// Returns true if a bag of ROS 2 compressed each message by itself. CDR never begins so.
fn is_packed_message(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x28, 0xb5, 0x2f, 0xfd])
}
