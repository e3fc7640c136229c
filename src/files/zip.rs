//! Reads members of ZIP files, stored or deflated (APPNOTE.TXT 6.3.10, PKWARE 2022), and writes stored ones.
//!
//! The reader takes what `numpy.savez` and the makers of 3MF write, up to 4 GB: one part, no encryption, no ZIP64
//! sizes. It checks sizes before it takes memory, and checksums afterwards.

use miniz_oxide::inflate::decompress_to_vec_with_limit;

use super::size_limits;

/// An archive: its bytes and its directory.
pub struct ZipArchive {
    bytes: Vec<u8>,
    members: Vec<Member>,
}

impl ZipArchive {
    /// Opens the bytes of an archive. Reads its directory, but no member yet. The error says what is wrong with it.
    pub fn open(bytes: Vec<u8>) -> Result<Self, String> {
        let members = read_directory(&bytes).ok_or("it is not a ZIP archive, or it is cut off")?;
        Ok(Self { bytes, members })
    }

    /// Iterates over the names of the members, in the order of the directory.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.members.iter().map(|member| member.name.as_str())
    }

    /// Unpacks a member. `times` is the memory that each of its bytes will take later, which is checked against the
    /// limits. Returns `None` if there is no such member. The inner error says what is wrong with it.
    pub fn unpack_member(&self, name: &str, times: usize) -> Option<Result<Vec<u8>, String>> {
        let member = self.members.iter().find(|member| member.name == name)?;
        Some(member.unpack(&self.bytes, times))
    }
}

/// Returns the names of the members of an archive; empty if it is none, or is cut off.
pub fn list_member_names(archive: &[u8]) -> Vec<String> {
    let members = read_directory(archive).unwrap_or_default();
    members.into_iter().map(|member| member.name).collect()
}

/// A file in the archive.
struct Member {
    name: String,
    flags: u16,
    method: u16,
    checksum: u32,
    packed: usize,
    unpacked: usize,
    offset: usize,
}

/// The method of a member that is not packed.
const STORED: u16 = 0;
/// The method of a member packed by Deflate.
const DEFLATED: u16 = 8;

impl Member {
    fn unpack(&self, archive: &[u8], times: usize) -> Result<Vec<u8>, String> {
        if self.flags & 1 != 0 {
            return Err(String::from("it is encrypted"));
        }
        size_limits::check_unpacked_bytes(self.unpacked.saturating_mul(times), archive.len())?;
        let packed = self.packed_bytes(archive).ok_or("the archive is cut off before it ends")?;
        let bytes = match self.method {
            STORED => packed.to_vec(),
            DEFLATED => decompress_to_vec_with_limit(packed, self.unpacked)
                .map_err(|_| "it cannot be unpacked: the archive is damaged")?,
            method => return Err(format!("it is packed by method {method}; read are 0 (stored) and 8 (deflated)")),
        };
        match bytes.len() == self.unpacked && compute_crc32(&bytes) == self.checksum {
            true => Ok(bytes),
            false => Err(String::from("its checksum or its size is wrong: the archive is damaged")),
        }
    }

    /// Returns the member's packed bytes. They stand behind a second header, whose sizes may be missing, so those of
    /// the directory are used.
    fn packed_bytes<'a>(&self, archive: &'a [u8]) -> Option<&'a [u8]> {
        let mut header = FieldReader(archive.get(self.offset..)?.strip_prefix(b"PK\x03\x04")?);
        header.skip(22)?;
        let (name, extra) = (header.read_u16()?, header.read_u16()?);
        header.skip(usize::from(name) + usize::from(extra))?;
        header.0.get(..self.packed)
    }
}

/// Reads the directory at the archive's end. Returns `None` if there is none or it ends too early.
fn read_directory(archive: &[u8]) -> Option<Vec<Member>> {
    // The last record has 22 bytes and a comment of up to 65535, so it is searched for from the end.
    let last = archive.len().saturating_sub(22 + usize::from(u16::MAX));
    let end = last + archive[last..].windows(4).rposition(|mark| mark == b"PK\x05\x06")?;
    let mut fields = FieldReader(&archive[end + 4..]);
    fields.skip(6)?;
    let (count, _size, start) = (fields.read_u16()?, fields.read_u32()?, fields.read_u32()?);
    let mut fields = FieldReader(archive.get(start as usize..)?);
    (0..count).map(|_| read_member(&mut fields)).collect()
}

fn read_member(fields: &mut FieldReader<'_>) -> Option<Member> {
    fields.0 = fields.0.strip_prefix(b"PK\x01\x02")?;
    fields.skip(4)?;
    let (flags, method) = (fields.read_u16()?, fields.read_u16()?);
    fields.skip(4)?;
    let (checksum, packed, unpacked) = (fields.read_u32()?, fields.read_u32()? as usize, fields.read_u32()? as usize);
    let (name, extra, comment) = (fields.read_u16()?, fields.read_u16()?, fields.read_u16()?);
    fields.skip(8)?;
    let offset = fields.read_u32()? as usize;
    let name = String::from_utf8_lossy(fields.skip(name.into())?).into_owned();
    fields.skip(usize::from(extra) + usize::from(comment))?;
    Some(Member { name, flags, method, checksum, packed, unpacked, offset })
}

/// The rest of a record of little-endian fields.
struct FieldReader<'a>(&'a [u8]);

impl<'a> FieldReader<'a> {
    fn skip(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (skipped, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(skipped)
    }

    fn read_u16(&mut self) -> Option<u16> {
        self.skip(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn read_u32(&mut self) -> Option<u32> {
        self.skip(4)?.try_into().ok().map(u32::from_le_bytes)
    }
}

/// Computes the CRC-32 of the ZIP format.
fn compute_crc32(bytes: &[u8]) -> u32 {
    let shifted = |crc: u32| (crc >> 1) ^ (0xedb8_8320 * (crc & 1));
    let table: [u32; 256] = std::array::from_fn(|byte| (0..8).fold(byte as u32, |crc, _| shifted(crc)));
    !bytes.iter().fold(!0, |crc, byte| (crc >> 8) ^ table[usize::from(crc as u8 ^ byte)])
}

/// Encodes an archive of stored members.
pub fn encode_stored(members: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut archive, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in members {
        let offset = archive.len() as u32;
        let mut sizes = compute_crc32(bytes).to_le_bytes().to_vec();
        sizes.extend([bytes.len() as u32; 2].map(u32::to_le_bytes).as_flattened());
        sizes.extend((name.len() as u16).to_le_bytes());
        sizes.extend([0; 2]);
        archive.extend(b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0");
        archive.extend(&sizes);
        archive.extend(name.as_bytes());
        archive.extend(*bytes);
        directory.extend(b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0");
        directory.extend(&sizes);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (start, count) = (archive.len() as u32, members.len() as u16);
    archive.extend(&directory);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend([count; 2].map(u16::to_le_bytes).as_flattened());
    archive.extend([directory.len() as u32, start].map(u32::to_le_bytes).as_flattened());
    archive.extend([0; 2]);
    archive
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_come_back_and_damaged_ones_are_refused() {
        let archive = encode_stored(&[("a/b.txt", b"hello"), ("c", b"")]);
        let zip = ZipArchive::open(archive.clone()).unwrap();
        assert_eq!(zip.names().collect::<Vec<_>>(), ["a/b.txt", "c"]);
        assert_eq!(zip.unpack_member("a/b.txt", 1), Some(Ok(b"hello".to_vec())));
        assert_eq!(zip.unpack_member("c", 1), Some(Ok(Vec::new())));
        assert_eq!(zip.unpack_member("d", 1), None);
        let at = archive.windows(5).position(|bytes| bytes == b"hello").unwrap();
        let mut damaged = archive;
        damaged[at] = b'j';
        let error = ZipArchive::open(damaged).unwrap().unpack_member("a/b.txt", 1).unwrap().unwrap_err();
        assert_eq!(error, "its checksum or its size is wrong: the archive is damaged");
        assert!(ZipArchive::open(b"PK".to_vec()).is_err());
    }
}
