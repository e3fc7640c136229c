//! Logs that are made here give their frames to the bit; cut, damaged and lying ones give what is left, and say it.

use std::io::Write;
use std::path::Path;

use super::Log;
use super::mcap_writer::McapWriter;
use super::messages::decode_depth;
use super::schemas::{Cdr, IMAGE, TEXT};

const SIZE: [usize; 2] = [7, 5];
const FRAMES: usize = 12;
const TOPIC: &str = "/gel/depth";

/// The values of frame `k`, m.
fn frame(k: usize) -> Vec<f32> {
    (0..SIZE[0] * SIZE[1]).map(|at| 0.01 + 1e-5 * (at * (k + 3)) as f32).collect()
}

fn stamp(k: usize) -> u64 {
    1_700_000_000_123_456_789 + 40_000_000 * k as u64
}

fn data(k: usize) -> Vec<u8> {
    frame(k).into_iter().flat_map(f32::to_le_bytes).collect()
}

fn ros2_image(k: usize) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp(k), "gel");
    cdr.u32(SIZE[1] as u32).u32(SIZE[0] as u32).text("32FC1").u8(0).u32(4 * SIZE[0] as u32).bytes(&data(k));
    cdr.into_bytes()
}

/// A list of bytes with its length.
fn listed(bytes: impl AsRef<[u8]>) -> Vec<u8> {
    let bytes = bytes.as_ref();
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn ros1_time(ns: u64) -> Vec<u8> {
    [(ns / 1_000_000_000) as u32, (ns % 1_000_000_000) as u32].map(u32::to_le_bytes).concat()
}

fn ros1_image(k: usize) -> Vec<u8> {
    let sizes = [SIZE[1], SIZE[0]].map(|size| (size as u32).to_le_bytes()).concat();
    let step = (4 * SIZE[0] as u32).to_le_bytes();
    [
        vec![9, 0, 0, 0],
        ros1_time(stamp(k)),
        listed("gel"),
        sizes,
        listed("32FC1"),
        vec![0],
        step.to_vec(),
        listed(data(k)),
    ]
    .concat()
}

/// An MCAP file of our own writer: chunks by LZ4.
fn mcap_of_ours() -> Vec<u8> {
    let mut writer = McapWriter::new(Vec::new(), "test").expect("memory");
    for k in 0..FRAMES {
        writer.write("/note", &TEXT, stamp(k), &[0, 1, 0, 0, 1, 0, 0, 0, 0]).expect("memory");
        writer.write(TOPIC, &IMAGE, stamp(k) + 5, &ros2_image(k)).expect("memory");
    }
    writer.finish().expect("memory")
}

fn mcap_record(kind: u8, body: &[u8]) -> Vec<u8> {
    [&[kind], (body.len() as u64).to_le_bytes().as_slice(), body].concat()
}

/// An MCAP file without an index, and with `in_chunk` messages a chunk; 0 stands for no chunks.
fn plain_mcap(in_chunk: usize) -> Vec<u8> {
    let schema = [vec![3, 0], listed("sensor_msgs/msg/Image"), listed("ros2msg"), listed("")].concat();
    let channel = [vec![7, 0, 3, 0], listed(TOPIC), listed("cdr"), listed("")].concat();
    let described = [mcap_record(3, &schema), mcap_record(4, &channel)].concat();
    let message = |k: usize| {
        let time = (stamp(k) + 5).to_le_bytes();
        mcap_record(5, &[&[7, 0, 0, 0, 0, 0], time.as_slice(), &time, &ros2_image(k)].concat())
    };
    let messages: Vec<Vec<u8>> = (0..FRAMES).map(message).collect();
    let body = match in_chunk {
        0 => [described, messages.concat()].concat(),
        _ => {
            let chunk = |(k, messages): (usize, &[Vec<u8>])| {
                let described = if k == 0 { described.as_slice() } else { &[] };
                let records = [described, &messages.concat()].concat();
                let crc = crc32fast::hash(&records).to_le_bytes();
                let sizes = [stamp(0), stamp(FRAMES), records.len() as u64].map(u64::to_le_bytes).concat();
                let packed = (records.len() as u64).to_le_bytes();
                mcap_record(6, &[&sizes, crc.as_slice(), &listed(""), &packed, &records].concat())
            };
            messages.chunks(in_chunk).enumerate().map(chunk).collect::<Vec<_>>().concat()
        }
    };
    [
        b"\x89MCAP0\r\n".as_slice(),
        &mcap_record(1, &[listed("ros2"), listed("")].concat()),
        &body,
        &mcap_record(15, &[0; 4]),
    ]
    .concat()
}

/// A record of a bag: the fields of its header, and its data.
fn bag_record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header = fields.iter().map(|(name, value)| listed([name.as_bytes(), b"=", value].concat()));
    [listed(header.collect::<Vec<_>>().concat()), listed(data)].concat()
}

/// A bag of ROS 1 without an index, three messages a chunk.
fn bag(compression: &str) -> Vec<u8> {
    let described: Vec<u8> =
        [("topic", TOPIC), ("type", "sensor_msgs/Image"), ("md5sum", "*"), ("message_definition", "")]
            .iter()
            .flat_map(|(name, value)| listed(format!("{name}={value}")))
            .collect();
    let connection = bag_record(&[("conn", &[4, 0, 0, 0]), ("op", &[7]), ("topic", TOPIC.as_bytes())], &described);
    let message = |k: usize| {
        bag_record(&[("conn", &[4, 0, 0, 0]), ("op", &[2]), ("time", &ros1_time(stamp(k) + 5))], &ros1_image(k))
    };
    let messages: Vec<Vec<u8>> = (0..FRAMES).map(message).collect();
    let chunk = |(k, messages): (usize, &[Vec<u8>])| {
        let records = [if k == 0 { connection.as_slice() } else { &[] }, &messages.concat()].concat();
        let packed = match compression {
            "bz2" => {
                let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::default());
                encoder.write_all(&records).and_then(|()| encoder.finish()).expect("memory")
            }
            "lz4" => {
                let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                encoder.write_all(&records).expect("memory");
                encoder.finish().expect("memory")
            }
            _ => records.clone(),
        };
        let size = (records.len() as u32).to_le_bytes();
        bag_record(&[("compression", compression.as_bytes()), ("op", &[5]), ("size", &size)], &packed)
    };
    let head = bag_record(&[("op", &[3]), ("index_pos", &[0; 8])], &[b' '; 40]);
    [b"#ROSBAG V2.0\n".to_vec(), head, messages.chunks(3).enumerate().map(chunk).collect::<Vec<_>>().concat()].concat()
}

/// A bag of ROS 2 in a database, whose rows go over several pages of 512 bytes.
fn database() -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/corpus/log/bag.db3"))
        .expect("a committed bag")
}

/// All kinds, with whether a checksum or a compression tells of damage to messages.
fn logs() -> Vec<(&'static str, Vec<u8>, bool)> {
    vec![
        ("lz4", mcap_of_ours(), true),
        ("chunks", plain_mcap(4), true),
        ("messages", plain_mcap(0), false),
        ("bag", bag("none"), false),
        ("bag bz2", bag("bz2"), true),
        ("bag lz4", bag("lz4"), false),
    ]
}

/// The frames of a log that can be read: their times and values.
fn read_frames(log: &Log) -> Vec<(u64, u64, Vec<f64>)> {
    let mut found = Vec::new();
    for entry in &log.entries {
        let topic = &log.topics[entry.topic as usize];
        let (Some(kind), Some(serialization)) = (topic.kind, topic.serialization) else { continue };
        let Ok(message) = log.read(entry) else { continue };
        if let Ok((grid, _)) = decode_depth(kind, serialization, &message) {
            found.push((entry.stamp_ns, entry.log_ns, grid.data));
        }
    }
    found
}

fn expected() -> Vec<(u64, u64, Vec<f64>)> {
    (0..FRAMES).map(|k| (stamp(k), stamp(k) + 5, frame(k).into_iter().map(f64::from).collect())).collect()
}

fn open(bytes: &[u8]) -> Option<Log> {
    Log::from_bytes(bytes.to_vec()).ok()
}

#[test]
fn every_kind_of_log_gives_its_frames_to_the_bit() {
    for (name, bytes, _) in logs() {
        let log = open(&bytes).expect("a log");
        assert_eq!(log.losses, [], "{name}");
        assert_eq!(read_frames(&log), expected(), "{name}");
        let topic = log.topics.iter().find(|topic| topic.name == TOPIC).expect("the topic");
        assert_eq!((topic.count, topic.is_depth(), topic.encoding.as_str()), (FRAMES as u64, true, "32FC1"), "{name}");
        assert!(log.describe_topics().contains("/gel/depth (sensor_msgs/Image, 32FC1, 12)"), "{name}");
    }
}

#[test]
fn a_log_that_is_cut_anywhere_gives_the_frames_before_and_says_what_is_lost() {
    for (name, bytes, _) in logs() {
        let mut most = 0;
        for cut in 16..=bytes.len() {
            let log = open(&bytes[..cut]).unwrap_or_else(|| panic!("{name} {cut}"));
            let frames = read_frames(&log);
            assert_eq!(frames, expected()[..frames.len()], "{name} {cut}");
            assert!(frames.len() >= most, "{name} {cut}");
            most = frames.len();
            for loss in &log.losses {
                assert!(loss.at + loss.bytes <= cut as u64 && !loss.reason.contains('\n'), "{name} {cut}: {loss:?}");
            }
            // A bag without an index may end behind any record.
            if frames.len() < FRAMES && !name.starts_with("bag") {
                assert!(!log.losses.is_empty(), "{name} {cut}");
            }
        }
        assert_eq!(most, FRAMES, "{name}");
    }
}

#[test]
fn a_changed_byte_never_changes_a_frame_that_has_a_checksum_and_never_stops_the_reader() {
    for (name, bytes, is_checked) in logs() {
        let mut kept = 0;
        for at in (0..bytes.len()).step_by(7) {
            for flip in [0xff, 0x01] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                let Some(log) = open(&damaged) else { continue };
                let frames = read_frames(&log);
                kept += usize::from(frames.len() == FRAMES || !log.losses.is_empty());
                if is_checked {
                    let values: Vec<_> = expected().into_iter().map(|(.., values)| values).collect();
                    assert!(frames.iter().all(|(.., frame)| values.contains(frame)), "{name} {at}");
                }
            }
        }
        assert!(kept > 0, "{name}");
    }
}

#[test]
fn what_a_log_claims_is_not_believed() {
    for (name, bytes, _) in logs() {
        for at in (8..bytes.len().min(1500)).step_by(3) {
            for length in [u32::MAX.to_le_bytes().as_slice(), &u64::MAX.to_le_bytes(), &(u64::MAX >> 20).to_le_bytes()]
            {
                let mut lying = bytes.clone();
                let end = (at + length.len()).min(lying.len());
                lying[at..end].copy_from_slice(&length[..end - at]);
                if let Some(log) = open(&lying) {
                    assert!(read_frames(&log).len() <= FRAMES, "{name} {at}");
                }
            }
        }
    }
}

#[test]
fn a_database_gives_its_messages_whole_cut_and_damaged() {
    let bytes = database();
    let log = open(&bytes).expect("a log");
    assert_eq!(log.losses, []);
    let whole = read_frames(&log);
    assert_eq!(whole.len(), 3);
    for cut in (100..bytes.len()).step_by(97) {
        let frames = open(&bytes[..cut]).map_or(Vec::new(), |log| read_frames(&log));
        assert!(frames.iter().all(|frame| whole.contains(frame)), "{cut}");
    }
    for at in (16..bytes.len()).step_by(5) {
        for flip in [0xff, 0x01, 0x80] {
            let mut damaged = bytes.clone();
            damaged[at] ^= flip;
            if let Some(log) = open(&damaged) {
                assert!(read_frames(&log).len() <= 3 * whole.len(), "{at}");
            }
        }
    }
}
