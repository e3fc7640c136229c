//! Reads the answers of `gelsim render --stream`, from what docs/how-to/streams.md says about their bytes alone.

#![allow(dead_code)] // Tests of the command and fuzz targets read different parts.

use std::collections::BTreeMap;

/// What answers a frame.
pub struct Answer {
    pub status: u32,
    pub frame: u64,
    pub sequence: u32,
    /// The names of the parts in their order.
    pub names: Vec<String>,
    pub parts: BTreeMap<String, Part>,
}

/// A part of an answer.
pub struct Part {
    pub type_name: String,
    pub shape: Vec<usize>,
    pub bytes: Vec<u8>,
}

/// The answers in `bytes`, which must be complete and sound.
pub fn answers(mut bytes: &[u8]) -> Vec<Answer> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let (header, rest) = bytes.split_at(32);
        assert_eq!(&header[..4], b"GSF1");
        let (mut content, after) = rest.split_at(u64_at(header, 24) as usize);
        let mut answer = Answer {
            status: u32_at(header, 4),
            frame: u64_at(header, 8),
            sequence: u32_at(header, 16),
            names: Vec::new(),
            parts: BTreeMap::new(),
        };
        for _ in 0..u32_at(header, 20) {
            let (header, rest) = content.split_at(64);
            let (bytes, after) = rest.split_at(u64_at(header, 56) as usize);
            let axes = u32_at(header, 40) as usize;
            let shape: Vec<usize> = (0..3).map(|axis| u32_at(header, 44 + 4 * axis) as usize).collect();
            assert!(axes <= 3 && shape[axes..].iter().all(|size| *size == 0));
            let part = Part { type_name: text(&header[32..40]), shape: shape[..axes].to_vec(), bytes: bytes.to_vec() };
            let each = match part.type_name.as_str() {
                "|u1" | "json" => 1,
                "<f4" => 4,
                "<f8" => 8,
                other => panic!("a part of type {other}"),
            };
            assert_eq!(part.bytes.len(), each * part.shape.iter().product::<usize>());
            answer.names.push(text(&header[..32]));
            assert!(answer.parts.insert(text(&header[..32]), part).is_none(), "a name stands for one part");
            content = after;
        }
        assert!(content.is_empty(), "the length of an answer is that of its parts");
        found.push(answer);
        bytes = after;
    }
    found
}

impl Answer {
    /// A part that is JSON.
    pub fn json(&self, name: &str) -> serde_json::Value {
        assert_eq!(self.parts[name].type_name, "json");
        serde_json::from_slice(&self.parts[name].bytes).expect("JSON")
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"))
}

fn text(padded: &[u8]) -> String {
    let end = padded.iter().position(|byte| *byte == 0).unwrap_or(padded.len());
    assert!(padded[end..].iter().all(|byte| *byte == 0));
    String::from_utf8(padded[..end].to_vec()).expect("ASCII")
}
