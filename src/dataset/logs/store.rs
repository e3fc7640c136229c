//! A file of a log, in which messages are found again.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use super::MAX_CHUNK_BYTES;
use super::compression::Compression;

/// Unpacked chunks that are kept, since the messages of a chunk are read one after the other, by several threads.
const KEPT_CHUNKS: usize = 8;
/// Most bytes of an unpacked chunk that is kept.
const MAX_KEPT_BYTES: usize = 32 << 20;

const SHORTER: &str = "the log has become shorter";

/// Where the bytes of a message are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// In the file itself.
    File {
        /// Number of the first byte.
        at: u64,
        /// Number of bytes.
        len: u64,
    },
    /// In an unpacked chunk.
    Chunk {
        /// Number of the chunk.
        chunk: u32,
        /// Number of the first byte.
        at: u32,
        /// Number of bytes.
        len: u32,
    },
    /// In a row of a database.
    Row {
        /// Number of its page.
        page: u32,
        /// Offset of its cell in the page.
        cell: u16,
    },
}

/// Where a chunk is, and how it is compressed.
#[derive(Clone, Copy, Debug)]
pub struct Chunk {
    /// Number of its first byte.
    pub at: u64,
    /// Number of its bytes.
    pub len: u64,
    /// Its compression.
    pub compression: Compression,
    /// Number of bytes to which it says that it unpacks.
    pub unpacked: u64,
}

/// How the pages of a database are laid out.
#[derive(Clone, Copy, Debug)]
pub struct Pages {
    /// Bytes of a page.
    pub size: usize,
    /// Bytes of a page that may be used.
    pub usable: usize,
}

/// An open file of a log.
#[derive(Debug)]
pub struct Store {
    /// Its path.
    pub path: PathBuf,
    /// Number of its bytes.
    pub length: u64,
    content: Content,
    /// The chunks of it that messages are in.
    pub chunks: Vec<Chunk>,
    /// How its pages are laid out; `None` if it is no database.
    pub pages: Option<Pages>,
    kept: Mutex<VecDeque<(u32, Arc<Vec<u8>>)>>,
}

#[derive(Debug)]
enum Content {
    File(File),
    Memory(Vec<u8>),
}

impl Store {
    /// Makes it of a file that was opened.
    pub fn from_file(path: PathBuf, file: File, length: u64) -> Self {
        Self::new(path, Content::File(file), length)
    }

    /// Makes it of bytes.
    pub fn from_bytes(bytes: Vec<u8>) -> Self {
        let length = bytes.len() as u64;
        Self::new(PathBuf::from("log"), Content::Memory(bytes), length)
    }

    fn new(path: PathBuf, content: Content, length: u64) -> Self {
        Self { path, length, content, chunks: Vec::new(), pages: None, kept: Mutex::default() }
    }

    /// Reads from byte `at` on until `bytes` is full or the file ends, and returns the number of bytes.
    pub fn read_some(&self, at: u64, bytes: &mut [u8]) -> io::Result<usize> {
        let mut count = 0;
        while count < bytes.len() {
            match self.content.read_at(at + count as u64, &mut bytes[count..]) {
                Ok(0) => break,
                Ok(more) => count += more,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(count)
    }

    /// Reads `len` bytes, or as many as there are.
    pub fn read_range(&self, at: u64, len: u64) -> io::Result<Vec<u8>> {
        // As many as there are: the length may be any.
        let mut bytes = vec![0; len.min(self.length.saturating_sub(at)) as usize];
        let count = self.read_some(at, &mut bytes)?;
        bytes.truncate(count);
        Ok(bytes)
    }

    /// Unpacks a chunk. Returns what came out before an error, and the error.
    pub fn unpack(&self, chunk: Chunk) -> (Vec<u8>, Result<(), String>) {
        let packed = Range { store: self, at: chunk.at, end: chunk.at.saturating_add(chunk.len) };
        chunk.compression.unpack(packed, chunk.unpacked)
    }

    /// Reads a message that is in the file itself.
    pub fn read_message(&self, at: u64, len: u64) -> Result<Vec<u8>, String> {
        if len > MAX_CHUNK_BYTES {
            return Err(format!("it has more than {} MiB, at byte {at}", MAX_CHUNK_BYTES >> 20));
        }
        let bytes = self.read_range(at, len).map_err(|error| error.to_string())?;
        if bytes.len() as u64 == len { Ok(bytes) } else { Err(String::from(SHORTER)) }
    }

    /// Reads a message that is in a chunk.
    pub fn read_from_chunk(&self, chunk: u32, at: u32, len: u32) -> Result<Vec<u8>, String> {
        let bytes = self.keep_unpacked(chunk);
        let message = bytes.get(at as usize..).and_then(|rest| rest.get(..len as usize));
        message.map(<[u8]>::to_vec).ok_or_else(|| String::from(SHORTER))
    }

    /// Returns an unpacked chunk that messages are in; one that is cut off as far as it goes.
    fn keep_unpacked(&self, number: u32) -> Arc<Vec<u8>> {
        let lock = || self.kept.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, bytes)) = lock().iter().find(|(kept, _)| *kept == number) {
            return Arc::clone(bytes);
        }
        let bytes = Arc::new(self.unpack(self.chunks[number as usize]).0);
        if bytes.len() <= MAX_KEPT_BYTES {
            let mut kept = lock();
            kept.push_back((number, Arc::clone(&bytes)));
            if kept.len() > KEPT_CHUNKS {
                kept.pop_front();
            }
        }
        bytes
    }
}

impl Content {
    fn read_at(&self, at: u64, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read_at(bytes, at),
            Self::Memory(all) => {
                let rest = usize::try_from(at).ok().and_then(|at| all.get(at..)).unwrap_or_default();
                let count = rest.len().min(bytes.len());
                bytes[..count].copy_from_slice(&rest[..count]);
                Ok(count)
            }
        }
    }
}

/// The bytes of a file up to an end.
struct Range<'a> {
    store: &'a Store,
    at: u64,
    end: u64,
}

impl Read for Range<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let most = (self.end - self.at).min(bytes.len() as u64) as usize;
        let count = self.store.read_some(self.at, &mut bytes[..most])?;
        self.at += count as u64;
        Ok(count)
    }
}
