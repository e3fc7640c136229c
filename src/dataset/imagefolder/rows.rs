//! metadata.jsonl of a shard that is a folder: a row per sample, made from the sample's files and nothing else, so that it
//! can be checked against them.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use super::super::archive::Files;
use super::super::encode::{frame, json};
use super::super::labels::{SampleLabel, split};
use super::{METADATA, old_file, open};
use crate::job::sequence::label::FrameRow;

/// The rows of a sample in metadata.jsonl: one of a press, one for each frame of a sequence.
pub fn rows<'a>(shard: &str, key: &str, members: impl Iterator<Item = (&'a str, &'a [u8])>) -> Vec<u8> {
    let members: Vec<(&str, &[u8])> = members.collect();
    let label = members.iter().find(|(suffix, _)| *suffix == "json").map_or(&b"{}"[..], |(_, bytes)| bytes);
    if members.iter().all(|(suffix, _)| split(suffix).0.is_none()) {
        return row(shard, key, members.into_iter());
    }
    // What is no label of ours has no rows.
    let Ok(SampleLabel::Sequence(sequence, _)) = SampleLabel::read(label) else { return b"\n".to_vec() };
    let mut of_frames: HashMap<&str, Vec<(&str, &[u8])>> = HashMap::new();
    for (suffix, bytes) in &members {
        if let (Some(of), suffix) = split(suffix) {
            of_frames.entry(of).or_default().push((suffix, bytes));
        }
    }
    let of_frame = |of_frame: FrameRow| {
        let name = frame(of_frame.frame.index);
        let label = json(&of_frame);
        let own = of_frames.get(name.as_str()).into_iter().flatten().copied();
        row(shard, &format!("{key}.{name}"), own.chain([("json", label.as_slice())]))
    };
    sequence.rows().flat_map(of_frame).collect()
}

/// The row of a press in metadata.jsonl, from its files by the ends of their names: names of its images, which
/// Hugging Face takes for such by `file_name`, from this folder; paths of the other layers, from the dataset's folder;
/// and the label's keys.
fn row<'a>(shard: &str, key: &str, members: impl Iterator<Item = (&'a str, &'a [u8])>) -> Vec<u8> {
    let (mut first, mut rest, mut label) = (String::new(), String::new(), &b"{}"[..]);
    for (suffix, bytes) in members {
        match suffix.split_once('.') {
            None => label = bytes,
            Some(("tactile", _)) => first = format!("\"file_name\":\"{key}.{suffix}\""),
            Some((layer, "png")) => rest += &format!(",\"{layer}_image_file_name\":\"{key}.{suffix}\""),
            Some((layer, _)) => rest += &format!(",\"{layer}_path\":\"data/{shard}/{key}.{suffix}\""),
        }
    }
    let mut row = format!("{{{first}{rest},").into_bytes();
    // What is no object is no label of ours, and its row nobody's.
    row.extend(label.strip_prefix(b"{").unwrap_or(label));
    row.push(b'\n');
    row
}

/// The rows of a folder's metadata.jsonl, compared with its samples.
pub struct Rows {
    shard: String,
    file: BufReader<File>,
    /// What is wrong; after the first mistake no row can be told from the next.
    wrong: Option<String>,
}

impl Rows {
    /// Opens those of the folder at `path` for the shard that is called `shard`.
    pub fn open(path: &Path, shard: &str) -> Result<Self, String> {
        let file = open(path).and_then(|folder| old_file(&folder, METADATA));
        let file = BufReader::new(file.map_err(|error| format!("{METADATA}: {error}"))?);
        Ok(Self { shard: shard.to_owned(), file, wrong: None })
    }

    /// Compares the next row with the sample that it should be about.
    pub fn compare(&mut self, files: &Files) {
        let members = files.members.iter().map(|(suffix, bytes)| (suffix.as_str(), bytes.as_slice()));
        let expected = rows(&self.shard, &files.key, members);
        let mut found = vec![0; expected.len()];
        let same = self.wrong.is_none() && self.file.read_exact(&mut found).is_ok() && found == expected;
        if !same {
            self.wrong.get_or_insert_with(|| format!("{METADATA}: its row of sample {} is another", files.key));
        }
    }

    /// What is wrong, after all samples.
    pub fn finish(mut self) -> Option<String> {
        let ended = matches!(self.file.read(&mut [0]), Ok(0));
        self.wrong.or_else(|| (!ended).then(|| format!("{METADATA}: it has more rows than samples")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_names_of_images_paths_of_layers_and_the_label() {
        let members = [("contact.png", &b""[..]), ("depth.npy", b""), ("json", b"{\"a\":1}"), ("tactile.png", b"")];
        let expected = "{\"file_name\":\"000000001.tactile.png\",\"contact_image_file_name\":\"000000001.contact.png\",\
                        \"depth_path\":\"data/train-000002/000000001.depth.npy\",\"a\":1}\n";
        let row = row("train-000002", "000000001", members.into_iter());
        assert_eq!(String::from_utf8_lossy(&row), expected);
    }
}
