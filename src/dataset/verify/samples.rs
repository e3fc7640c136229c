//! Checks the samples of a shard, file by file, against what the job makes, and counts what their labels say.

use crate::container::ShardContainer;
use std::collections::BTreeSet;
use std::io::Read;
use std::ops::ControlFlow;

use serde::Deserialize;

use crate::archive::{self, SampleFiles};
use crate::encode::frame_name;
use crate::labels::{self, SampleLabel, SuffixParts};
use crate::paths::ShardPaths;
use crate::recorded::RecordedDataset;
use crate::stats::ShardStats;
use crate::{decode, imagefolder};
use gelsim_core::base::clock::Seconds;
use gelsim_core::effects::PerEffect;
use gelsim_files::{exr, npy, png};
use gelsim_job::config::output::Container;
use gelsim_job::gripper::FINGER_NAMES;
use gelsim_job::label::{Label, sample_key};
use gelsim_job::layers::{LayerCoding, LayerForm, OutputLayer, StepScale};
use gelsim_job::layout::{Shard, Split};
use gelsim_job::steps::Steps;

/// Most errors that are named for one shard; the rest are counted.
const MAX_NAMED: usize = 10;

/// Checks a shard on disk; for a folder, its metadata.jsonl, too. Returns what is wrong, and the stats counted from its
/// labels.
pub fn check_shard_files(paths: &ShardPaths, recorded: &RecordedDataset, shard: Shard) -> (Vec<String>, ShardStats) {
    let mut counted = ShardStats::new(&shard, paths.container, "");
    let mut rows = match paths.container {
        Container::Tar => None,
        Container::Folder => Some(imagefolder::RowComparison::open(&paths.data, &shard.name())),
    };
    let mut found = check_samples(recorded, shard, &mut counted, |visit| {
        paths.container.visit_samples(
            &paths.data,
            |_| true,
            |files| {
                if let Some(Ok(rows)) = &mut rows {
                    rows.compare_row(&files);
                }
                visit(files)
            },
        )
    });
    found.extend(rows.and_then(|rows| rows.map_or_else(Some, imagefolder::RowComparison::finish)));
    (found, counted)
}

/// Checks a shard that is a tar: it must have the samples that `recorded` says, each with its files, and each file must
/// be valid. Returns what is wrong.
pub fn check_tar(tar: impl Read, recorded: &RecordedDataset, shard: Shard) -> Vec<String> {
    let mut counted = ShardStats::new(&shard, Container::Tar, "");
    check_samples(recorded, shard, &mut counted, |visit| archive::visit_tar(tar, visit))
}

/// Checks and counts the samples of a shard. `read` calls its argument with each of them.
fn check_samples(
    recorded: &RecordedDataset,
    shard: Shard,
    counted: &mut ShardStats,
    read: impl FnOnce(&mut dyn FnMut(SampleFiles) -> ControlFlow<()>) -> Result<(), String>,
) -> Vec<String> {
    let mut found = Vec::new();
    let mut expected = recorded.layout.sample_indices(shard);
    let read = read(&mut |files: SampleFiles| {
        match expected.next() {
            Some(index) => {
                if let Some(label) = check_sample(&files, recorded, shard.split, index, &mut found) {
                    counted.count_sample(&label, Vec::new(), &Seconds::default(), &PerEffect::default());
                    counted.rejected += u64::from(label.header.attempt);
                }
            }
            None => found.push(format!("sample {} is one too many", files.key)),
        }
        ControlFlow::Continue(())
    });
    found.extend(read.err());
    let missing: Vec<String> = expected.map(sample_key).collect();
    match missing.as_slice() {
        [] => {}
        [only] => found.push(format!("sample {only} is missing")),
        [first, .., last] => found.push(format!("{} samples are missing: {first} to {last}", missing.len())),
    }
    if found.len() > MAX_NAMED {
        let more = found.len() - MAX_NAMED;
        found.truncate(MAX_NAMED);
        found.push(format!("and {more} more mistakes"));
    }
    found
}

/// Checks the files of a sample. Returns its label, or the summary, if that is valid.
fn check_sample(
    files: &SampleFiles,
    recorded: &RecordedDataset,
    split: Split,
    index: u64,
    found: &mut Vec<String>,
) -> Option<Label> {
    let key = sample_key(index);
    if files.key != key {
        found.push(format!("sample {} stands where {key} belongs", files.key));
        return None;
    }
    let mut label = None;
    let format = recorded.job.output.depth_format;
    let layers = recorded.job.output.layers_in_order();
    let suffixes: Vec<(String, OutputLayer)> =
        layers.into_iter().map(|layer| (layer.file_suffix(format), layer)).collect();
    let read = files.find_member("json").map(|bytes| check_label(bytes, recorded, split, index));
    // Only its label says how many frames a sequence has.
    let frames: Vec<String> = match (&recorded.job.sequence, &read) {
        (None, _) => vec![String::new()],
        (Some(_), Some(Ok(label))) => {
            let count = label.frames().map_or(0, |(count, _)| count);
            (0..count).map(|number| format!("{}.", frame_name(number))).collect()
        }
        (Some(_), _) => Vec::new(),
    };
    let frames: Vec<String> = match recorded.job.gripper {
        None => frames,
        Some(_) => frames.iter().flat_map(|frame| FINGER_NAMES.map(|finger| format!("{frame}{finger}."))).collect(),
    };
    let of_frame = |prefix: &String| {
        let images = suffixes.iter().map(|(suffix, _)| suffix.as_str()).chain(["tactile.png"]);
        images.map(|suffix| format!("{prefix}{suffix}")).collect::<Vec<_>>()
    };
    let expected: BTreeSet<String> = frames.iter().flat_map(of_frame).chain([String::from("json")]).collect();
    let actual: BTreeSet<String> = files.members.iter().map(|(suffix, _)| suffix.clone()).collect();
    found.extend(expected.difference(&actual).map(|suffix| format!("{key}.{suffix} is missing")));
    // Without the label of a sequence, the files that belong to it are unknown.
    if !frames.is_empty() {
        found.extend(actual.difference(&expected).map(|suffix| format!("{key}.{suffix} does not belong there")));
    }
    for (suffix, bytes) in files.members.iter().filter(|(suffix, _)| expected.contains(suffix)) {
        let SuffixParts { finger, layer: of_frame, .. } =
            match recorded.job.sequence.is_some() || recorded.job.gripper.is_some() {
                true => labels::split_suffix(suffix),
                false => SuffixParts { layer: suffix, ..SuffixParts::default() },
            };
        let size = recorded.resolution_px(finger == Some(FINGER_NAMES[1])).map(|px| px as usize);
        let layer = suffixes.iter().find(|(of, _)| of == of_frame).map(|(_, layer)| *layer);
        let checked = match layer.map(|layer| (layer, layer.spec().form)) {
            None if suffix == "json" => match &read {
                Some(Ok(read)) => {
                    label = Some(read.summary().clone());
                    Ok(())
                }
                Some(Err(reason)) => Err(reason.clone()),
                None => Ok(()),
            },
            None | Some((_, LayerForm::Rgb)) => check_png(bytes, size, image::ColorType::Rgb8),
            Some((_, LayerForm::Grey)) => check_png(bytes, size, image::ColorType::L8),
            Some((_, LayerForm::Positions)) => check_positions(bytes),
            Some((layer, LayerForm::Floats { least, .. })) => {
                check_floats(layer, layer.coding_for(format), least, bytes, size)
            }
        };
        found.extend(checked.err().map(|what| format!("{key}.{suffix}: {what}")));
    }
    label
}

fn check_png(bytes: &[u8], [width, height]: [usize; 2], color: image::ColorType) -> Result<(), String> {
    // Check the header before anything is unpacked.
    let (size, found) = png::read_header(bytes)?;
    if size != [width, height] || found != color {
        return Err(format!("is {}x{} px {found:?}, not {width}x{height} {color:?}", size[0], size[1]));
    }
    png::decode(bytes).map(|_| ())
}

/// Checks that a layer of floats has the right size and channels, and that all values are finite and not below `least`.
fn check_floats(
    layer: OutputLayer,
    coding: LayerCoding,
    least: f32,
    bytes: &[u8],
    [width, height]: [usize; 2],
) -> Result<(), String> {
    let channels = layer.channels();
    match coding {
        LayerCoding::Exr => {
            // Check the header before anything is unpacked.
            let (size, names) = exr::read_header(bytes)?;
            if size != [width, height] || names != channels {
                let size = format!("{}x{} px", size[0], size[1]);
                return Err(format!("is {size} of {names:?}, not {width}x{height} of {channels:?}"));
            }
        }
        LayerCoding::Npy => npy::check_float32(bytes)?,
        LayerCoding::Png16(scale) => return check_steps(scale, bytes, [width, height]),
        LayerCoding::Png | LayerCoding::Json => {}
    }
    let planes = decode::decode_planes(layer, coding, bytes, &Steps::default())?;
    if [planes.width, planes.height] != [width, height] {
        return Err(format!("is {}x{} px, not {width}x{height}", planes.width, planes.height));
    }
    for (name, values) in &planes.channels {
        if let Some(at) = values.iter().position(|value| !value.is_finite() || *value < least) {
            return Err(format!("channel {name} is {} in column {}, row {}", values[at], at % width, at / width));
        }
    }
    Ok(())
}

/// Checks that a layer in 16-bit steps is an image of that kind, without the value 0 if that stands for a value that is
/// not finite.
fn check_steps(scale: StepScale, bytes: &[u8], size: [usize; 2]) -> Result<(), String> {
    check_png(bytes, size, image::ColorType::L16)?;
    let none = png::decode_grey16(bytes)?.data.iter().position(|value| scale.zero_key().is_some() && *value == 0);
    match none {
        Some(at) => Err(format!("is not finite in column {}, row {}", at % size[0], at / size[0])),
        None => Ok(()),
    }
}

/// Checks that positions are two lists of pairs of equal length; those of pins also two of triples.
fn check_positions(bytes: &[u8]) -> Result<(), String> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Positions {
        rest_px: Vec<[f64; 2]>,
        moved_px: Vec<[f64; 2]>,
        rest_mm: Option<Vec<[f64; 3]>>,
        moved_mm: Option<Vec<[f64; 3]>>,
    }
    let positions: Positions = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    let Positions { rest_px, moved_px, rest_mm, moved_mm } = positions;
    let count = rest_px.len();
    let as_many = |mm: &Option<Vec<[f64; 3]>>| mm.as_ref().is_none_or(|mm| mm.len() == count);
    match (count == moved_px.len(), as_many(&rest_mm) && as_many(&moved_mm)) {
        (true, true) => Ok(()),
        (false, _) => Err(format!("{count} rest, {} moved", moved_px.len())),
        (true, false) => Err(format!("{count} in the image, another number in mm")),
    }
}

/// Checks that a label has the keys and types of its schema, and that it is about the sample.
fn check_label(bytes: &[u8], recorded: &RecordedDataset, split: Split, index: u64) -> Result<SampleLabel, String> {
    let read = SampleLabel::read_strictly(bytes)?;
    let label = read.summary();
    let same = label.header.index == index
        && label.header.key == sample_key(index)
        && label.header.split == split
        && label.header.seed == recorded.job.dataset.seed
        && read.frames().is_some() == recorded.job.sequence.is_some()
        && (read.sensors().len() == FINGER_NAMES.len()) == recorded.job.gripper.is_some()
        && read
            .sensors()
            .into_iter()
            .zip([false, true])
            .all(|(sensor, right)| [sensor.width_px, sensor.height_px] == recorded.resolution_px(right));
    if same { Ok(read) } else { Err(String::from("is not about this sample")) }
}
