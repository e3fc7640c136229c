//! Goes through a bag of ROS 1 (version 2.0) from its beginning, so that it needs no index: records of a header with
//! named fields and a content. Chunks hold compressed records.

use std::collections::HashMap;

use super::fields::Serialization;
use super::store::{Place, Store};
use super::{ChunkRecord, Index, PEEKED};

/// The first bytes of a bag.
pub const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Most bytes of a header, and of a connection, which holds the definition of a type.
const MAX_HEADER: u64 = 16 << 20;

/// Kinds of records.
mod op {
    pub const MESSAGE: u8 = 2;
    pub const CHUNK: u8 = 5;
    pub const CONNECTION: u8 = 7;
}

/// Returns the fields of a header by their names.
fn parse_header(mut bytes: &[u8]) -> Result<HashMap<&[u8], &[u8]>, String> {
    let mut fields = HashMap::new();
    while !bytes.is_empty() {
        let (length, rest) = bytes.split_first_chunk().ok_or(BAD_HEADER)?;
        let (field, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or(BAD_HEADER)?;
        let middle = field.iter().position(|byte| *byte == b'=').ok_or(BAD_HEADER)?;
        fields.insert(&field[..middle], &field[middle + 1..]);
        bytes = rest;
    }
    Ok(fields)
}

const BAD_HEADER: &str = "the header of a record has no fields";

/// Returns the kind of the record that a header is of.
fn kind(fields: &HashMap<&[u8], &[u8]>) -> Result<u8, String> {
    match fields.get(b"op".as_slice()) {
        Some([kind]) => Ok(*kind),
        _ => Err(String::from("the header of a record says no op")),
    }
}

/// Returns a whole number of a header.
fn number(fields: &HashMap<&[u8], &[u8]>, name: &str) -> Result<u32, String> {
    let bytes = fields.get(name.as_bytes()).and_then(|bytes| bytes.first_chunk());
    bytes.map(|bytes| u32::from_le_bytes(*bytes)).ok_or_else(|| format!("the header of a record says no {name}"))
}

/// The topics of a bag by the numbers of their connections.
#[derive(Default)]
struct Connections(HashMap<u32, u32>);

impl Connections {
    fn describe(&mut self, fields: &HashMap<&[u8], &[u8]>, data: &[u8], index: &mut Index) -> Result<(), String> {
        let described = parse_header(data)?;
        let text =
            |bytes: Option<&&[u8]>| bytes.map_or(String::new(), |bytes| String::from_utf8_lossy(bytes).into_owned());
        let name = text(fields.get(b"topic".as_slice()).or(described.get(b"topic".as_slice())));
        let type_name = text(described.get(b"type".as_slice()));
        self.0.insert(number(fields, "conn")?, index.topic(&name, &type_name, Some(Serialization::Ros1)));
        Ok(())
    }

    fn add_message(
        &self,
        fields: &HashMap<&[u8], &[u8]>,
        head: &[u8],
        place: Place,
        index: &mut Index,
    ) -> Result<(), String> {
        let topic = *self.0.get(&number(fields, "conn")?).ok_or("a message is of no connection")?;
        let time = fields.get(b"time".as_slice()).and_then(|time| time.first_chunk::<8>());
        let time = u64::from_le_bytes(*time.ok_or("the header of a message says no time")?);
        // Seconds are in the lower half.
        let log_ns = (time & 0xffff_ffff) * 1_000_000_000 + (time >> 32);
        index.add_message(topic, log_ns, place, head);
        Ok(())
    }
}

/// Goes through the records from `at` on, which is where the error is.
pub fn scan_records(file: &mut Store, index: &mut Index, at: &mut u64) -> Result<(), String> {
    let mut connections = Connections::default();
    let length_at = |file: &Store, at: u64| {
        let mut bytes = [0; 4];
        match file.read_some(at, &mut bytes) {
            Ok(4) => Ok(u64::from(u32::from_le_bytes(bytes))),
            Ok(_) => Err(String::from("the file is cut off")),
            Err(error) => Err(error.to_string()),
        }
    };
    let read = |file: &Store, at: u64, len: u64| file.read_range(at, len).map_err(|error| error.to_string());
    while *at < file.length {
        let header_len = length_at(file, *at)?;
        if header_len > MAX_HEADER {
            return Err(format!("a header of {header_len} bytes"));
        }
        let header = read(file, *at + 4, header_len)?;
        let body = *at + 8 + header_len;
        let length = length_at(file, body - 4)?;
        let fields = parse_header(&header)?;
        let kind = kind(&fields)?;
        let is_cut = length > file.length - body;
        if is_cut && kind != op::CHUNK {
            return Err(format!("a record of {length} bytes goes beyond the end of the file"));
        }
        match kind {
            op::CONNECTION if length <= MAX_HEADER => {
                connections.describe(&fields, &read(file, body, length)?, index)?;
            }
            op::CONNECTION => return Err(format!("a connection of {length} bytes")),
            op::MESSAGE => {
                let head = read(file, body, length.min(PEEKED))?;
                connections.add_message(&fields, &head, Place::File { at: body, len: length }, index)?;
            }
            op::CHUNK => {
                let compression = fields.get(b"compression".as_slice()).copied().unwrap_or_default();
                let (packed, size) = ((body, length), number(&fields, "size")?.into());
                let record = ChunkRecord { body, length, is_cut, packed, compression, size, crc: None };
                scan_chunk(file, index, &mut connections, record)?;
            }
            3..=7 => {}
            _ => return Err(format!("no record is of the op {kind}")),
        }
        *at = body + length;
    }
    Ok(())
}

/// Notes what is in a chunk. The error ends the file.
fn scan_chunk(
    file: &mut Store,
    index: &mut Index,
    connections: &mut Connections,
    record: ChunkRecord<'_>,
) -> Result<(), String> {
    index.scan_chunk(file, record, |index, number, bytes| {
        let beyond = "a record goes beyond its chunk";
        let mut rest = bytes;
        while !rest.is_empty() {
            let mut next = || {
                let (length, after) = rest.split_first_chunk().ok_or(beyond)?;
                let (part, after) = after.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or(beyond)?;
                rest = after;
                Ok::<_, String>(part)
            };
            let (header, data) = (next()?, next()?);
            let fields = parse_header(header)?;
            match kind(&fields)? {
                op::CONNECTION => connections.describe(&fields, data, index)?,
                op::MESSAGE => {
                    let (at, len) = ((bytes.len() - rest.len() - data.len()) as u32, data.len() as u32);
                    connections.add_message(&fields, data, Place::Chunk { chunk: number, at, len }, index)?;
                }
                _ => {}
            }
        }
        Ok(())
    })
}
