//! metadata.jsonl of a shard that is a folder: a row per sample, made from the sample's files and nothing else, so that it
//! can be checked against them.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use super::super::archive::Files;
use super::super::encode::{frame, json};
use super::super::labels::{SampleLabel, Suffix, split};
use super::{METADATA, old_file, open};
use gelsim_job::sequence::label::FrameRow;

/// The end of the name of a sample's label.
pub const LABEL: &str = "json";

/// What stands for the label of a sample that has none.
pub const NO_LABEL: &[u8] = b"{}";

/// The rows of a sample in metadata.jsonl, from its label and the ends of its files' names: one of a press, one for each frame
/// of a sequence.
pub fn rows<'a>(shard: &str, key: &str, label: &[u8], suffixes: impl Iterator<Item = &'a str>) -> Vec<u8> {
    let suffixes: Vec<&str> = suffixes.collect();
    if suffixes.iter().all(|suffix| split(suffix).frame.is_none()) {
        return row(shard, key, label, &suffixes);
    }
    // What is no label of ours has no rows.
    let Ok(SampleLabel::Sequence(sequence, _)) = SampleLabel::read(label) else { return b"\n".to_vec() };
    let mut of_frames: HashMap<&str, Vec<&str>> = HashMap::new();
    for suffix in suffixes {
        if let Suffix { frame: Some(of), layer, .. } = split(suffix) {
            of_frames.entry(of).or_default().push(layer);
        }
    }
    let of_frame = |of_frame: FrameRow| {
        let name = frame(of_frame.frame.index);
        let own = of_frames.get(name.as_str()).map_or(&[][..], Vec::as_slice);
        row(shard, &format!("{key}.{name}"), &json(&of_frame), own)
    };
    sequence.rows().flat_map(of_frame).collect()
}

/// The row of a press in metadata.jsonl: names of its images, which Hugging Face takes for such by `file_name`, from this folder;
/// paths of the other layers, from the dataset's folder; and the label's keys.
fn row(shard: &str, key: &str, label: &[u8], suffixes: &[&str]) -> Vec<u8> {
    let (mut first, mut rest) = (String::new(), String::new());
    for suffix in suffixes {
        match suffix.split_once('.') {
            None => {}
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
        let label = files.member(LABEL).unwrap_or(NO_LABEL);
        let suffixes = files.members.iter().map(|(suffix, _)| suffix.as_str());
        let expected = rows(&self.shard, &files.key, label, suffixes);
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
        let suffixes = ["contact.png", "depth.npy", "json", "tactile.png"];
        let expected = "{\"file_name\":\"000000001.tactile.png\",\"contact_image_file_name\":\"000000001.contact.png\",\
                        \"depth_path\":\"data/train-000002/000000001.depth.npy\",\"a\":1}\n";
        let row = row("train-000002", "000000001", b"{\"a\":1}", &suffixes);
        assert_eq!(String::from_utf8_lossy(&row), expected);
    }
}
