//! Builds the rows of metadata.jsonl for a shard that is a folder. A row is made from the sample's files and nothing
//! else, so that it can be checked against them.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use super::super::archive::SampleFiles;
use super::super::encode::{frame_name, to_json_line};
use super::super::labels::{SampleLabel, SuffixParts, split_suffix};
use super::{METADATA_FILE, open_folder, open_own_file};
use gelsim_job::sequence::label::FrameRow;

/// The suffix of a sample's label.
pub const LABEL_SUFFIX: &str = "json";

/// The label of a sample without one.
pub const EMPTY_LABEL: &[u8] = b"{}";

/// Builds the rows of a sample in metadata.jsonl from its label and the suffixes of its files: one row for a press, one
/// for each frame of a sequence.
pub fn build_rows<'a>(shard: &str, key: &str, label: &[u8], suffixes: impl Iterator<Item = &'a str>) -> Vec<u8> {
    let suffixes: Vec<&str> = suffixes.collect();
    if suffixes.iter().all(|suffix| split_suffix(suffix).frame.is_none()) {
        return build_row(shard, key, label, &suffixes);
    }
    // Anything that is not a label of gelsim's has no rows.
    let Ok(SampleLabel::Sequence(sequence, _)) = SampleLabel::read(label) else { return b"\n".to_vec() };
    let mut of_frames: HashMap<&str, Vec<&str>> = HashMap::new();
    for suffix in suffixes {
        if let SuffixParts { frame: Some(of), layer, .. } = split_suffix(suffix) {
            of_frames.entry(of).or_default().push(layer);
        }
    }
    let of_frame = |of_frame: FrameRow| {
        let name = frame_name(of_frame.frame.index);
        let own = of_frames.get(name.as_str()).map_or(&[][..], Vec::as_slice);
        build_row(shard, &format!("{key}.{name}"), &to_json_line(&of_frame), own)
    };
    sequence.to_rows().flat_map(of_frame).collect()
}

/// Builds the row of a press or a frame: names of its images, relative to this folder, which Hugging Face recognises by
/// `file_name`; paths of the other layers, relative to the dataset's folder; and the keys of the label.
fn build_row(shard: &str, key: &str, label: &[u8], suffixes: &[&str]) -> Vec<u8> {
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
    // A label that is no JSON object is not gelsim's; its row is never valid.
    row.extend(label.strip_prefix(b"{").unwrap_or(label));
    row.push(b'\n');
    row
}

/// Compares the rows of a folder's metadata.jsonl with its samples.
pub struct RowComparison {
    shard: String,
    file: BufReader<File>,
    /// The first error. After it, no row can be told from the next.
    error: Option<String>,
}

impl RowComparison {
    /// Opens the rows of the folder at `path` for the shard called `shard`.
    pub fn open(path: &Path, shard: &str) -> Result<Self, String> {
        let file = open_folder(path).and_then(|folder| open_own_file(&folder, METADATA_FILE));
        let file = BufReader::new(file.map_err(|error| format!("{METADATA_FILE}: {error}"))?);
        Ok(Self { shard: shard.to_owned(), file, error: None })
    }

    /// Compares the next row with the sample that it should describe.
    pub fn compare_row(&mut self, files: &SampleFiles) {
        let label = files.find_member(LABEL_SUFFIX).unwrap_or(EMPTY_LABEL);
        let suffixes = files.members.iter().map(|(suffix, _)| suffix.as_str());
        let expected = build_rows(&self.shard, &files.key, label, suffixes);
        let mut found = vec![0; expected.len()];
        let same = self.error.is_none() && self.file.read_exact(&mut found).is_ok() && found == expected;
        if !same {
            self.error.get_or_insert_with(|| format!("{METADATA_FILE}: its row of sample {} is another", files.key));
        }
    }

    /// Returns what is wrong, after all samples were compared; `None` if nothing is.
    pub fn finish(mut self) -> Option<String> {
        let ended = matches!(self.file.read(&mut [0]), Ok(0));
        self.error.or_else(|| (!ended).then(|| format!("{METADATA_FILE}: it has more rows than samples")))
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
        let row = build_row("train-000002", "000000001", b"{\"a\":1}", &suffixes);
        assert_eq!(String::from_utf8_lossy(&row), expected);
    }
}
