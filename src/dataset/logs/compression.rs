//! How the chunks of a log are compressed.

use std::io::{BufReader, Read};

/// Most bytes of a chunk that is unpacked.
pub const MAX_CHUNK_BYTES: u64 = 1 << 30;

/// The compression of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// None.
    Stored,
    /// bzip2.
    Bzip2,
    /// LZ4 in frames.
    Lz4,
    /// Zstandard.
    Zstd,
}

impl Compression {
    /// Returns the compression that a log calls so; `None` for those that cannot be read.
    pub fn from_name(name: &[u8]) -> Option<Self> {
        match name {
            b"" | b"none" => Some(Self::Stored),
            b"bz2" => Some(Self::Bzip2),
            b"lz4" => Some(Self::Lz4),
            b"zstd" => Some(Self::Zstd),
            _ => None,
        }
    }

    /// Unpacks a chunk of at most `most` bytes. Returns what came out before an error, and the error.
    pub fn unpack(self, packed: impl Read, most: u64) -> (Vec<u8>, Result<(), String>) {
        let most = most.min(MAX_CHUNK_BYTES);
        let packed = BufReader::with_capacity(1 << 16, packed);
        let mut bytes = Vec::new();
        let read = match self {
            Self::Stored => read_limited(packed, &mut bytes, most),
            Self::Bzip2 => read_limited(bzip2::bufread::BzDecoder::new(packed), &mut bytes, most),
            Self::Lz4 => read_limited(lz4_flex::frame::FrameDecoder::new(packed), &mut bytes, most),
            Self::Zstd => match ruzstd::decoding::StreamingDecoder::new(packed) {
                Ok(decoder) => read_limited(decoder, &mut bytes, most),
                Err(error) => Err(error.to_string()),
            },
        };
        (bytes, read)
    }
}

/// Reads to the end. The error says also that there is more than `most` bytes.
fn read_limited(from: impl Read, bytes: &mut Vec<u8>, most: u64) -> Result<(), String> {
    // The buffer grows with what comes: what a log claims is never believed.
    let mut piece = [0; 1 << 14];
    let mut from = from.take(most + 1);
    loop {
        match from.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => bytes.extend_from_slice(&piece[..count]),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error.to_string()),
        }
    }
    match bytes.len() as u64 > most {
        true => Err(format!("it unpacks to more than {most} bytes")),
        false => Ok(()),
    }
}
