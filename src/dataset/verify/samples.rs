//! Whether the samples of a shard are those that its job makes, file by file, and what their labels add up to.

use crate::container::ShardContainer;
use std::collections::BTreeSet;
use std::io::Read;
use std::ops::ControlFlow;

use serde::Deserialize;

use crate::archive::{self, Files};
use crate::encode::frame;
use crate::labels::{self, SampleLabel, Suffix};
use crate::paths::Paths;
use crate::recorded::Recorded;
use crate::stats::Stats;
use crate::{decode, imagefolder};
use gelsim_core::base::clock::Seconds;
use gelsim_core::effects::PerEffect;
use gelsim_files::{exr, npy, png};
use gelsim_job::config::output::Container;
use gelsim_job::gripper::FINGERS;
use gelsim_job::label::{Label, key};
use gelsim_job::layers::{Coding, Form, OutputLayer, Scale};
use gelsim_job::layout::{Shard, Split};
use gelsim_job::steps;
use gelsim_job::steps::Steps;

/// Mistakes named for one shard; the rest are counted.
const MOST_NAMED: usize = 10;

/// Checks a shard on disk, in a folder also its metadata.jsonl, and counts what its labels say.
pub fn check_files(paths: &Paths, recorded: &Recorded, shard: Shard) -> (Vec<String>, Stats) {
    let mut counted = Stats::new(&shard, paths.container, "");
    let mut rows = match paths.container {
        Container::Tar => None,
        Container::Folder => Some(imagefolder::Rows::open(&paths.data, &shard.name())),
    };
    let mut found = check_samples(recorded, shard, &mut counted, |visit| {
        paths.container.read(
            &paths.data,
            |_| true,
            |files| {
                if let Some(Ok(rows)) = &mut rows {
                    rows.compare(&files);
                }
                visit(files)
            },
        )
    });
    found.extend(rows.and_then(|rows| rows.map_or_else(Some, imagefolder::Rows::finish)));
    (found, counted)
}

/// Checks a shard that is a tar: the samples that `recorded` says it has, each with its files, each file what it should
/// be.
pub fn check(tar: impl Read, recorded: &Recorded, shard: Shard) -> Vec<String> {
    let mut counted = Stats::new(&shard, Container::Tar, "");
    check_samples(recorded, shard, &mut counted, |visit| archive::read(tar, visit))
}

/// Checks the samples of a shard, which `read` shows to what it is given, and counts them.
fn check_samples(
    recorded: &Recorded,
    shard: Shard,
    counted: &mut Stats,
    read: impl FnOnce(&mut dyn FnMut(Files) -> ControlFlow<()>) -> Result<(), String>,
) -> Vec<String> {
    let mut found = Vec::new();
    let mut expected = recorded.layout.indices(shard);
    let read = read(&mut |files: Files| {
        match expected.next() {
            Some(index) => {
                if let Some(label) = check_sample(&files, recorded, shard.split, index, &mut found) {
                    counted.count(&label, Vec::new(), &Seconds::default(), &PerEffect::default());
                    counted.rejected += u64::from(label.header.attempt);
                }
            }
            None => found.push(format!("sample {} is one too many", files.key)),
        }
        ControlFlow::Continue(())
    });
    found.extend(read.err());
    let missing: Vec<String> = expected.map(key).collect();
    match missing.as_slice() {
        [] => {}
        [only] => found.push(format!("sample {only} is missing")),
        [first, .., last] => found.push(format!("{} samples are missing: {first} to {last}", missing.len())),
    }
    if found.len() > MOST_NAMED {
        let more = found.len() - MOST_NAMED;
        found.truncate(MOST_NAMED);
        found.push(format!("and {more} more mistakes"));
    }
    found
}

/// Checks the files of a sample; its label, if that is what it should be.
fn check_sample(
    files: &Files,
    recorded: &Recorded,
    split: Split,
    index: u64,
    found: &mut Vec<String>,
) -> Option<Label> {
    let key = key(index);
    if files.key != key {
        found.push(format!("sample {} stands where {key} belongs", files.key));
        return None;
    }
    let mut label = None;
    let format = recorded.job.output.depth_format;
    let layers = recorded.job.output.layers_in_order();
    let suffixes: Vec<(String, OutputLayer)> = layers.into_iter().map(|layer| (layer.suffix(format), layer)).collect();
    let read = files.member("json").map(|bytes| check_label(bytes, recorded, split, index));
    // Of a sequence the label says how many frames there are.
    let frames: Vec<String> = match (&recorded.job.sequence, &read) {
        (None, _) => vec![String::new()],
        (Some(_), Some(Ok(label))) => {
            let count = label.frames().map_or(0, |(count, _)| count);
            (0..count).map(|number| format!("{}.", frame(number))).collect()
        }
        (Some(_), _) => Vec::new(),
    };
    let frames: Vec<String> = match recorded.job.gripper {
        None => frames,
        Some(_) => frames.iter().flat_map(|frame| FINGERS.map(|finger| format!("{frame}{finger}."))).collect(),
    };
    let of_frame = |prefix: &String| {
        let images = suffixes.iter().map(|(suffix, _)| suffix.as_str()).chain(["tactile.png"]);
        images.map(|suffix| format!("{prefix}{suffix}")).collect::<Vec<_>>()
    };
    let expected: BTreeSet<String> = frames.iter().flat_map(of_frame).chain([String::from("json")]).collect();
    let there: BTreeSet<String> = files.members.iter().map(|(suffix, _)| suffix.clone()).collect();
    found.extend(expected.difference(&there).map(|suffix| format!("{key}.{suffix} is missing")));
    // Without the label of a sequence nobody knows what belongs there.
    if !frames.is_empty() {
        found.extend(there.difference(&expected).map(|suffix| format!("{key}.{suffix} does not belong there")));
    }
    for (suffix, bytes) in files.members.iter().filter(|(suffix, _)| expected.contains(suffix)) {
        let Suffix { finger, layer: of_frame, .. } =
            match recorded.job.sequence.is_some() || recorded.job.gripper.is_some() {
                true => labels::split(suffix),
                false => Suffix { layer: suffix, ..Suffix::default() },
            };
        let size = recorded.resolution_px(finger == Some(FINGERS[1])).map(|px| px as usize);
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
            None | Some((_, Form::Rgb)) => check_png(bytes, size, image::ColorType::Rgb8),
            Some((_, Form::Grey)) => check_png(bytes, size, image::ColorType::L8),
            Some((_, Form::Positions)) => check_positions(bytes),
            Some((layer, Form::Floats { least, .. })) => check_floats(layer, layer.coding(format), least, bytes, size),
        };
        found.extend(checked.err().map(|what| format!("{key}.{suffix}: {what}")));
    }
    label
}

fn check_png(bytes: &[u8], [width, height]: [usize; 2], color: image::ColorType) -> Result<(), String> {
    // Before it is unpacked: what it says it is must be what belongs there.
    let (size, found) = png::header(bytes)?;
    if size != [width, height] || found != color {
        return Err(format!("is {}x{} px {found:?}, not {width}x{height} {color:?}", size[0], size[1]));
    }
    png::decode(bytes).map(|_| ())
}

/// A layer of floats is what belongs there, finite, and nowhere below `least`.
fn check_floats(
    layer: OutputLayer,
    coding: Coding,
    least: f32,
    bytes: &[u8],
    [width, height]: [usize; 2],
) -> Result<(), String> {
    let channels = layer.channels();
    match coding {
        Coding::Exr => {
            // Before it is unpacked.
            let (size, names) = exr::header(bytes)?;
            if size != [width, height] || names != channels {
                let size = format!("{}x{} px", size[0], size[1]);
                return Err(format!("is {size} of {names:?}, not {width}x{height} of {channels:?}"));
            }
        }
        Coding::Npy => npy::check_float32(bytes)?,
        Coding::Png16(scale) => return check_steps(scale, bytes, [width, height]),
        Coding::Png | Coding::Json => {}
    }
    let planes = decode::planes(layer, coding, bytes, &Steps::default())?;
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

/// A layer in 16-bit steps is a picture of that kind, and has no value that stands for what is not finite.
fn check_steps(scale: Scale, bytes: &[u8], size: [usize; 2]) -> Result<(), String> {
    check_png(bytes, size, image::ColorType::L16)?;
    let none = steps::values(bytes)?.data.iter().position(|value| scale.zero_key().is_some() && *value == 0);
    match none {
        Some(at) => Err(format!("is not finite in column {}, row {}", at % size[0], at / size[0])),
        None => Ok(()),
    }
}

/// Two lists of as many pairs of numbers; of pins also two of triples.
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

/// The label's keys and types are those of its schema, and it is about the sample.
fn check_label(bytes: &[u8], recorded: &Recorded, split: Split, index: u64) -> Result<SampleLabel, String> {
    let read = SampleLabel::read_strictly(bytes)?;
    let label = read.summary();
    let same = label.header.index == index
        && label.header.key == key(index)
        && label.header.split == split
        && label.header.seed == recorded.job.dataset.seed
        && read.frames().is_some() == recorded.job.sequence.is_some()
        && (read.sensors().len() == FINGERS.len()) == recorded.job.gripper.is_some()
        && read
            .sensors()
            .into_iter()
            .zip([false, true])
            .all(|(sensor, right)| [sensor.width_px, sensor.height_px] == recorded.resolution_px(right));
    if same { Ok(read) } else { Err(String::from("is not about this sample")) }
}
