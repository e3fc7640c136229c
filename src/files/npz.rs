//! Named arrays in NumPy's archives: a ZIP file of npy files, stored or deflated (APPNOTE.TXT 6.3.10, PKWARE 2022).
//!
//! Read is what `numpy.savez` and `savez_compressed` write of up to 4 GB: one part, no encryption, no ZIP64 sizes.
//! Sizes are checked before memory is taken, and checksums after. Pickled objects are not numbers and are refused.

use std::path::Path;

use miniz_oxide::inflate::decompress_to_vec_with_limit;

use super::npy::{self, Numbers};
use super::unpack;
use crate::files::input::{self, MOST_IMAGE_BYTES};

/// An archive: its bytes, and what its directory says is in it.
pub struct Npz {
    bytes: Vec<u8>,
    members: Vec<Member>,
}

impl Npz {
    /// Reads a file of up to 1 GB. On failure, what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, String> {
        Self::open(input::read(path, MOST_IMAGE_BYTES).map_err(|error| error.to_string())?)
    }

    /// Takes the bytes of an archive, and reads its directory but no array yet.
    pub fn open(bytes: Vec<u8>) -> Result<Self, String> {
        let members = directory(&bytes).ok_or("it is not a ZIP archive, or it is cut off")?;
        Ok(Self { bytes, members })
    }

    /// The arrays' names, in the order of the directory.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.members.iter().map(|member| member.name.as_str())
    }

    /// Unpacks and reads one array. On failure, what is wrong, with the array's name in it.
    pub fn array(&self, name: &str) -> Result<Numbers, String> {
        let Some(member) = self.members.iter().find(|member| member.name == name) else {
            let names: Vec<String> = self.names().take(20).map(|name| format!("`{}`", name.escape_debug())).collect();
            return Err(format!("it has no array `{name}`, but {}", names.join(", ")));
        };
        let numbers = member.unpack(&self.bytes).and_then(|bytes| npy::decode_numbers(&bytes));
        numbers.map_err(|reason| format!("array `{name}`: {reason}"))
    }
}

/// One file in the archive.
struct Member {
    name: String,
    flags: u16,
    method: u16,
    checksum: u32,
    packed: usize,
    unpacked: usize,
    offset: usize,
}

/// How a member is packed.
const STORED: u16 = 0;
const DEFLATED: u16 = 8;

impl Member {
    fn unpack(&self, archive: &[u8]) -> Result<Vec<u8>, String> {
        if self.flags & 1 != 0 {
            return Err(String::from("it is encrypted"));
        }
        // A byte may become a number of eight.
        unpack::bytes(self.unpacked.saturating_mul(8), archive.len())?;
        let packed = self.packed(archive).ok_or("the archive is cut off before it ends")?;
        let bytes = match self.method {
            STORED => packed.to_vec(),
            DEFLATED => decompress_to_vec_with_limit(packed, self.unpacked)
                .map_err(|error| format!("it cannot be unpacked: {:?}", error.status))?,
            method => return Err(format!("it is packed by method {method}; read are 0 (stored) and 8 (deflated)")),
        };
        match bytes.len() == self.unpacked && checksum(&bytes) == self.checksum {
            true => Ok(bytes),
            false => Err(String::from("its checksum or its size is wrong: the archive is damaged")),
        }
    }

    /// Its bytes in the archive. They stand after a second header, whose sizes may be left open.
    fn packed<'a>(&self, archive: &'a [u8]) -> Option<&'a [u8]> {
        let mut header = Fields(archive.get(self.offset..)?.strip_prefix(b"PK\x03\x04")?);
        header.skip(22)?;
        let (name, extra) = (header.u16()?, header.u16()?);
        header.skip(usize::from(name) + usize::from(extra))?;
        header.0.get(..self.packed)
    }
}

/// What the directory at the archive's end lists; `None` if there is none, or one that ends too early.
fn directory(archive: &[u8]) -> Option<Vec<Member>> {
    // The last record is 22 bytes and a comment of up to 65535.
    let last = archive.len().saturating_sub(22 + usize::from(u16::MAX));
    let end = last + archive[last..].windows(4).rposition(|mark| mark == b"PK\x05\x06")?;
    let mut fields = Fields(&archive[end + 4..]);
    fields.skip(6)?;
    let (count, _size, start) = (fields.u16()?, fields.u32()?, fields.u32()?);
    let mut fields = Fields(archive.get(start as usize..)?);
    (0..count).map(|_| member(&mut fields)).collect()
}

fn member(fields: &mut Fields<'_>) -> Option<Member> {
    fields.0 = fields.0.strip_prefix(b"PK\x01\x02")?;
    fields.skip(4)?;
    let (flags, method) = (fields.u16()?, fields.u16()?);
    fields.skip(4)?;
    let (checksum, packed, unpacked) = (fields.u32()?, fields.u32()? as usize, fields.u32()? as usize);
    let (name, extra, comment) = (fields.u16()?, fields.u16()?, fields.u16()?);
    fields.skip(8)?;
    let offset = fields.u32()? as usize;
    let name = String::from_utf8_lossy(fields.skip(name.into())?);
    let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
    fields.skip(usize::from(extra) + usize::from(comment))?;
    Some(Member { name, flags, method, checksum, packed, unpacked, offset })
}

/// What is left of a record of little-endian fields.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn skip(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (skipped, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(skipped)
    }

    fn u16(&mut self) -> Option<u16> {
        self.skip(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.skip(4)?.try_into().ok().map(u32::from_le_bytes)
    }
}

/// ZIP's CRC-32.
fn checksum(bytes: &[u8]) -> u32 {
    let shifted = |crc: u32| (crc >> 1) ^ (0xedb8_8320 * (crc & 1));
    let table: [u32; 256] = std::array::from_fn(|byte| (0..8).fold(byte as u32, |crc, _| shifted(crc)));
    !bytes.iter().fold(!0, |crc, byte| (crc >> 8) ^ table[usize::from(crc as u8 ^ byte)])
}
