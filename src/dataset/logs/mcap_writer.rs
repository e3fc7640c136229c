//! Writes an MCAP file of ROS 2 messages, in chunks that are compressed by LZ4, with an index.

use std::collections::BTreeMap;
use std::io::{self, Write};

use super::mcap::{MAGIC, op};
use super::schemas::RosType;

/// Bytes after which a chunk ends.
const CHUNK_BYTES: usize = 4 << 20;

/// A record under way: its content, little endian.
struct Record(Vec<u8>);

impl Record {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn put(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    fn u16(self, value: u16) -> Self {
        self.put(&value.to_le_bytes())
    }

    fn u32(self, value: u32) -> Self {
        self.put(&value.to_le_bytes())
    }

    fn u64(self, value: u64) -> Self {
        self.put(&value.to_le_bytes())
    }

    /// Adds a text, or another list with its length in bytes.
    fn list(self, bytes: impl AsRef<[u8]>) -> Self {
        let bytes = bytes.as_ref();
        self.u32(bytes.len() as u32).put(bytes)
    }

    /// Returns the record with what it is and its length.
    fn finish(self, kind: u8) -> Vec<u8> {
        let length = self.0.len() as u64;
        [&[kind], length.to_le_bytes().as_slice(), &self.0].concat()
    }
}

/// A file under way.
pub struct McapWriter<W> {
    out: W,
    /// Bytes written.
    at: u64,
    topics: Vec<WrittenTopic>,
    /// Schemas and channels, which are repeated in the summary.
    schemas: Vec<u8>,
    channels: Vec<u8>,
    types: Vec<&'static str>,
    chunk: ChunkUnderWay,
    chunk_indexes: Vec<u8>,
    chunk_count: u32,
    /// First and last log time, ns.
    times: Option<[u64; 2]>,
}

struct WrittenTopic {
    name: String,
    count: u64,
}

#[derive(Default)]
struct ChunkUnderWay {
    records: Vec<u8>,
    times: Option<[u64; 2]>,
    /// For each channel the log time and offset of each message.
    index: BTreeMap<u16, Vec<u8>>,
}

fn widen(times: &mut Option<[u64; 2]>, log_ns: u64) {
    let [first, last] = times.unwrap_or([log_ns; 2]);
    *times = Some([first.min(log_ns), last.max(log_ns)]);
}

impl<W: Write> McapWriter<W> {
    /// Begins a file that `library` writes.
    pub fn new(out: W, library: &str) -> io::Result<Self> {
        let mut writer = Self {
            out,
            at: 0,
            topics: Vec::new(),
            schemas: Vec::new(),
            channels: Vec::new(),
            types: Vec::new(),
            chunk: ChunkUnderWay::default(),
            chunk_indexes: Vec::new(),
            chunk_count: 0,
            times: None,
        };
        writer.put(MAGIC)?;
        writer.put(&Record::new().list("ros2").list(library).finish(op::HEADER))?;
        Ok(writer)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    /// Writes a message in CDR on a topic, at a log time.
    pub fn write(&mut self, topic: &str, of: &RosType, log_ns: u64, message: &[u8]) -> io::Result<()> {
        let channel = match self.topics.iter().position(|known| known.name == topic) {
            Some(known) => known as u16,
            None => self.add_channel(topic, of),
        };
        let count = &mut self.topics[usize::from(channel)].count;
        let record = Record::new().u16(channel).u32(*count as u32).u64(log_ns).u64(log_ns).put(message);
        *count += 1;
        let place = (self.chunk.records.len() as u64).to_le_bytes();
        self.chunk.index.entry(channel).or_default().extend([log_ns.to_le_bytes(), place].as_flattened());
        self.chunk.records.extend(record.finish(op::MESSAGE));
        widen(&mut self.chunk.times, log_ns);
        widen(&mut self.times, log_ns);
        if self.chunk.records.len() >= CHUNK_BYTES { self.end_chunk() } else { Ok(()) }
    }

    fn add_channel(&mut self, topic: &str, of: &RosType) -> u16 {
        // Schemas are counted from 1: 0 stands for none.
        let schema = match self.types.iter().position(|known| *known == of.name) {
            Some(known) => known as u16 + 1,
            None => {
                self.types.push(of.name);
                let number = self.types.len() as u16;
                let record = Record::new().u16(number).list(of.name).list("ros2msg").list(of.definition());
                let record = record.finish(op::SCHEMA);
                self.schemas.extend(&record);
                self.chunk.records.extend(record);
                number
            }
        };
        let channel = self.topics.len() as u16;
        let metadata = Record::new().list("offered_qos_profiles").list("").0;
        let record = Record::new().u16(channel).u16(schema).list(topic).list("cdr").list(metadata).finish(op::CHANNEL);
        self.channels.extend(&record);
        self.chunk.records.extend(record);
        self.topics.push(WrittenTopic { name: topic.to_owned(), count: 0 });
        channel
    }

    fn end_chunk(&mut self) -> io::Result<()> {
        let ChunkUnderWay { records, times, index } = std::mem::take(&mut self.chunk);
        let Some([first, last]) = times else { return Ok(()) };
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(&records)?;
        let packed = encoder.finish().map_err(io::Error::other)?;
        let (size, crc) = (records.len() as u64, crc32fast::hash(&records));
        let chunk = Record::new().u64(first).u64(last).u64(size).u32(crc).list("lz4");
        let chunk = chunk.u64(packed.len() as u64).put(&packed).finish(op::CHUNK);
        let (at, length) = (self.at, chunk.len() as u64);
        self.put(&chunk)?;
        let mut places = Record::new();
        for (channel, messages) in &index {
            places = places.u16(*channel).u64(self.at);
            self.put(&Record::new().u16(*channel).list(messages).finish(op::MESSAGE_INDEX))?;
        }
        let record = Record::new().u64(first).u64(last).u64(at).u64(length).list(places.0);
        let record = record.u64(self.at - at - length).list("lz4").u64(packed.len() as u64).u64(size);
        self.chunk_indexes.extend(record.finish(op::CHUNK_INDEX));
        self.chunk_count += 1;
        Ok(())
    }

    /// Ends the file, and returns what it was written to.
    pub fn finish(mut self) -> io::Result<W> {
        self.end_chunk()?;
        // The checksum of all messages is left out: each chunk has one.
        self.put(&Record::new().u32(0).finish(op::DATA_END))?;
        let [first, last] = self.times.unwrap_or_default();
        let counts = self.topics.iter().enumerate();
        let counts = counts.fold(Record::new(), |record, (channel, topic)| record.u16(channel as u16).u64(topic.count));
        let all = self.topics.iter().map(|topic| topic.count).sum();
        let statistics = Record::new().u64(all).u16(self.types.len() as u16).u32(self.topics.len() as u32);
        let statistics = statistics.u32(0).u32(0).u32(self.chunk_count).u64(first).u64(last).list(counts.0);
        let start = self.at;
        let groups = [
            (op::SCHEMA, std::mem::take(&mut self.schemas)),
            (op::CHANNEL, std::mem::take(&mut self.channels)),
            (op::STATISTICS, statistics.finish(op::STATISTICS)),
            (op::CHUNK_INDEX, std::mem::take(&mut self.chunk_indexes)),
        ];
        let (mut summary, mut offsets) = (Vec::new(), Vec::new());
        for (kind, records) in groups.iter().filter(|(_, records)| !records.is_empty()) {
            let offset = Record::new().put(&[*kind]).u64(start + summary.len() as u64).u64(records.len() as u64);
            offsets.extend(offset.finish(op::SUMMARY_OFFSET));
            summary.extend(records);
        }
        let offsets_start = start + summary.len() as u64;
        summary.extend(offsets);
        // The checksum is of all from the summary to itself.
        let footer = Record::new().u64(start).u64(offsets_start).u32(0).finish(op::FOOTER);
        summary.extend(&footer[..footer.len() - 4]);
        let crc = crc32fast::hash(&summary);
        self.put(&summary)?;
        self.put(&crc.to_le_bytes())?;
        self.put(MAGIC)?;
        Ok(self.out)
    }
}
