//! Goes through an MCAP file from its beginning, so that it needs no index: records of a byte that says what they are,
//! a length and a content. Chunks hold compressed records.

use std::collections::HashMap;

use super::fields::{Fields, Serialization};
use super::store::{Place, Store};
use super::{ChunkRecord, Index, PEEKED};

/// The first bytes of a file, and the last ones.
pub const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Bytes before the content of a record.
const RECORD_HEAD: u64 = 9;
/// Bytes of a message before what was sent.
const MESSAGE_HEAD: usize = 22;
/// Most bytes of a schema or a channel.
const MAX_DESCRIPTION: u64 = 16 << 20;

/// Kinds of records.
pub mod op {
    /// The first record.
    pub const HEADER: u8 = 1;
    /// The last record.
    pub const FOOTER: u8 = 2;
    /// A type of message.
    pub const SCHEMA: u8 = 3;
    /// A topic.
    pub const CHANNEL: u8 = 4;
    /// A message.
    pub const MESSAGE: u8 = 5;
    /// Compressed records.
    pub const CHUNK: u8 = 6;
    /// Where the messages of a channel are in a chunk.
    pub const MESSAGE_INDEX: u8 = 7;
    /// Where a chunk is.
    pub const CHUNK_INDEX: u8 = 8;
    /// How much there is.
    pub const STATISTICS: u8 = 11;
    /// Where a part of the summary is.
    pub const SUMMARY_OFFSET: u8 = 14;
    /// The end of the messages.
    pub const DATA_END: u8 = 15;
}

/// The types and topics of a file by their numbers.
#[derive(Default)]
struct Channels {
    types: HashMap<u16, String>,
    topics: HashMap<u16, u32>,
}

impl Channels {
    /// Takes in a schema or a channel.
    fn describe(&mut self, kind: u8, body: &[u8], index: &mut Index) -> Result<(), String> {
        let mut fields = Fields::new(body, Serialization::Ros1)?;
        let number = fields.u16()?;
        if kind == op::SCHEMA {
            self.types.insert(number, fields.text()?.to_owned());
            return Ok(());
        }
        let type_name = self.types.get(&fields.u16()?).map_or("", String::as_str);
        let (name, serialization) = (fields.text()?, Serialization::from_name(fields.text()?));
        self.topics.insert(number, index.topic(name, type_name, serialization));
        Ok(())
    }

    /// Notes a message; `place` is that of what was sent.
    fn add_message(&self, head: &[u8], place: Place, index: &mut Index) -> Result<(), String> {
        let mut fields = Fields::new(head, Serialization::Ros1)?;
        let topic = *self.topics.get(&fields.u16()?).ok_or("a message is of no channel")?;
        fields.u32()?;
        let log_ns = fields.u64()?;
        index.add_message(topic, log_ns, place, head.get(MESSAGE_HEAD..).ok_or("a message ends within its head")?);
        Ok(())
    }
}

/// Goes through the records from `at` on, which is where the error is.
pub fn scan_records(file: &mut Store, index: &mut Index, at: &mut u64) -> Result<(), String> {
    let mut channels = Channels::default();
    loop {
        let mut head = [0; RECORD_HEAD as usize];
        if file.read_some(*at, &mut head).map_err(|error| error.to_string())? < head.len() {
            return Err(String::from("the file is cut off"));
        }
        let [kind, length @ ..] = head;
        let (body, length) = (*at + RECORD_HEAD, u64::from_le_bytes(length));
        let is_cut = length > file.length - body;
        if is_cut && kind != op::CHUNK {
            return Err(format!("a record of {length} bytes goes beyond the end of the file"));
        }
        match kind {
            op::FOOTER | op::DATA_END => return Ok(()),
            0 | 0x10..0x80 => return Err(format!("no record is of the kind {kind:#04x}")),
            op::SCHEMA | op::CHANNEL => {
                if length > MAX_DESCRIPTION {
                    return Err(format!("a description of {length} bytes"));
                }
                let bytes = file.read_range(body, length).map_err(|error| error.to_string())?;
                channels.describe(kind, &bytes, index)?;
            }
            op::MESSAGE => {
                let head = file.read_range(body, length.min(PEEKED)).map_err(|error| error.to_string())?;
                let place =
                    Place::File { at: body + MESSAGE_HEAD as u64, len: length.saturating_sub(MESSAGE_HEAD as u64) };
                channels.add_message(&head, place, index)?;
            }
            op::CHUNK => scan_chunk(file, index, &mut channels, body, length, is_cut)?,
            _ => {}
        }
        *at = body + length;
    }
}

/// Notes what is in a chunk. The error ends the file.
fn scan_chunk(
    file: &mut Store,
    index: &mut Index,
    channels: &mut Channels,
    body: u64,
    length: u64,
    is_cut: bool,
) -> Result<(), String> {
    let head = file.read_range(body, length.min(80)).map_err(|error| error.to_string())?;
    let mut fields = Fields::new(&head, Serialization::Ros1)?;
    fields.u64()?;
    fields.u64()?;
    let (size, crc) = (fields.u64()?, fields.u32()?);
    let compression = fields.bytes()?;
    let before = 40 + compression.len() as u64;
    let packed = (body + before, fields.u64()?.min(length.saturating_sub(before)));
    let crc = Some(crc).filter(|crc| *crc != 0);
    let record = ChunkRecord { body, length, is_cut, packed, compression, size, crc };
    index.scan_chunk(file, record, |index, number, bytes| {
        let mut rest = bytes;
        while let Some((head, after)) = rest.split_first_chunk::<{ RECORD_HEAD as usize }>() {
            let [kind, length @ ..] = *head;
            let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
            let (record, following) = after.split_at_checked(length).ok_or("a record goes beyond its chunk")?;
            let at = (bytes.len() - after.len() + MESSAGE_HEAD) as u32;
            match kind {
                op::SCHEMA | op::CHANNEL => channels.describe(kind, record, index)?,
                op::MESSAGE => {
                    let len = length.saturating_sub(MESSAGE_HEAD) as u32;
                    channels.add_message(record, Place::Chunk { chunk: number, at, len }, index)?;
                }
                _ => {}
            }
            rest = following;
        }
        if rest.is_empty() { Ok(()) } else { Err(String::from("a record goes beyond its chunk")) }
    })
}
