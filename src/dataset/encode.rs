//! Makes samples and encodes their files, in the order in which they stand in a shard.

use std::path::{Path, PathBuf};
use std::{fmt, io};

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::archive::Member;
use crate::content::{LayerContent, layer_content};
use crate::spool::Spool;
use gelsim_core::base::clock::{Seconds, ThreadClock};
use gelsim_core::effects::PerEffect;
use gelsim_files::exr::Exr;
use gelsim_files::{exr, npy, png};
use gelsim_job::config::output::{OnUnhealthy, Output};
use gelsim_job::gripper::sequence::FingerSamples;
use gelsim_job::gripper::{self, FINGER_NAMES};
use gelsim_job::label::{Label, sample_key};
use gelsim_job::layers::{LayerCoding, LayerForm, OutputLayer};
use gelsim_job::plan::Plan;
use gelsim_job::sample::{AcceptedSample, RejectedSample, Sample, accept_sample, render, render_together};
use gelsim_job::sequence::{self, SequenceEvent};
use gelsim_job::steps::Steps;

/// A sample that was made and encoded. Its images are not kept.
pub struct EncodedSample {
    /// Its label; for a sequence or a grip the summary of the complete sample.
    pub label: Label,
    /// Labels of the draws before it that were rejected.
    pub rejected: Vec<Label>,
    /// Its files.
    pub members: Vec<Member>,
    /// CPU seconds of its stages.
    pub seconds: Seconds,
    /// CPU seconds of each effect.
    pub effects: PerEffect<f64>,
}

/// Where the files of a sequence are kept until it is complete.
#[derive(Clone, Copy)]
pub enum FrameStorage<'a> {
    /// In memory.
    InMemory,
    /// On disk, in a spool in the folder `data` of the dataset.
    OnDisk {
        /// The folder.
        folder: &'a Path,
        /// Returns true if the sample should be dropped.
        stop: &'a (dyn Fn() -> bool + Sync),
    },
}

/// Why a sample could not be made.
#[derive(Debug)]
pub enum SampleError {
    /// No draw of it may go into the dataset.
    Rejected(RejectedSample),
    /// Its files could not be kept on disk.
    Io(PathBuf, io::Error),
    /// It was dropped because the run stops.
    Stopped,
}

impl From<RejectedSample> for SampleError {
    fn from(unfit: RejectedSample) -> Self {
        Self::Rejected(unfit)
    }
}

impl fmt::Display for SampleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rejected(RejectedSample(label)) => write!(f, "no draw of it is healthy: {}", label.health.reason),
            Self::Io(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Stopped => f.write_str("it was stopped"),
        }
    }
}

/// Makes sample `index` as a dataset has it: a press, a grip, or a sequence. The error says why there is none.
pub fn make_sample(plan: &Plan, index: u64, keep: FrameStorage<'_>) -> Result<EncodedSample, SampleError> {
    let sample = match (&plan.job().sequence, &plan.job().gripper) {
        (None, None) => accept_sample(plan, index).map(|accepted| encode_press(plan, accepted)).map_err(Into::into),
        (None, Some(_)) => {
            gripper::accept_grip(plan, index).map(|accepted| encode_grip(plan, accepted)).map_err(Into::into)
        }
        (Some(_), None) => {
            encode_sequence(plan, index, keep, encode_layers, |each| sequence::accept_sequence(plan, index, each))
        }
        (Some(_), Some(_)) => encode_sequence(plan, index, keep, encode_both_fingers, |each| {
            gripper::sequence::accept_grip_sequence(plan, index, each)
        }),
    };
    require_meshes(plan)?;
    sample
}

/// Makes sample `index` of several plans, each as [`make_sample`] does. If these are single presses of the same objects
/// into sensors of the same pad and view, the contact is computed once, and layers that are the same are encoded once.
///
/// # Errors
///
/// As [`make_sample`], for the first plan that has one.
pub fn make_samples(plans: &[&Plan], index: u64, keep: &[FrameStorage<'_>]) -> Result<Vec<EncodedSample>, SampleError> {
    let are_pressed_once = |plan: &&Plan| {
        let job = plan.job();
        job.sequence.is_none() && job.gripper.is_none() && job.output.on_unhealthy != OnUnhealthy::Reject
    };
    match plans {
        [first, _, ..] if plans.iter().all(are_pressed_once) => {
            let samples = make_presses_together(plans, index);
            require_meshes(first)?;
            samples
        }
        _ => plans.iter().zip(keep).map(|(plan, keep)| make_sample(plan, index, *keep)).collect(),
    }
}

/// Refuses samples of which a mesh could not be read again.
fn require_meshes(plan: &Plan) -> Result<(), SampleError> {
    plan.find_mesh_failure().map_or(Ok(()), |(path, error)| Err(SampleError::Io(path, error)))
}

fn make_presses_together(plans: &[&Plan], index: u64) -> Result<Vec<EncodedSample>, SampleError> {
    let mut known = KnownLayers::default();
    let mut encode = |plan: &Plan, sample: Sample| {
        if !sample.label.health.healthy && plan.output().on_unhealthy == OnUnhealthy::Fail {
            return Err(RejectedSample(Box::new(sample.label)).into());
        }
        let mut clock = ThreadClock::start();
        let mut members = encode_layers_after(plan, &sample, Some(&mut known));
        members.push(Member::new("json", to_json_line(&sample.label)));
        let seconds = Seconds { encode: clock.lap(), ..sample.seconds };
        let effects = sample.impression.effects.seconds;
        Ok(EncodedSample { label: sample.label, rejected: Vec::new(), members, seconds, effects })
    };
    let mut samples = Vec::with_capacity(plans.len());
    render_together(plans, index, |plan, sample| samples.push(encode(plan, sample)));
    samples.into_iter().collect()
}

/// Makes a sample in memory as [`make_sample`] does. If no draw of it may go into a dataset, it is made from the first
/// draw.
pub fn make_sample_for_display(plan: &Plan, index: u64) -> EncodedSample {
    make_sample(plan, index, FrameStorage::InMemory).unwrap_or_else(|_| {
        match (&plan.job().sequence, &plan.job().gripper) {
            (None, None) => encode_press(plan, AcceptedSample { sample: render(plan, index), rejected: Vec::new() }),
            (None, Some(_)) => {
                encode_grip(plan, gripper::AcceptedGrip { grip: gripper::render(plan, index, 0), rejected: Vec::new() })
            }
            (Some(_), None) => {
                let first = |each: &mut SequenceVisitor<'_, Sample>| {
                    sequence::render(plan, index, 0, |sample, number| {
                        each(SequenceEvent::Frame(Box::new(sample), number))
                    })
                };
                encode_sequence(plan, index, FrameStorage::InMemory, encode_layers, first).expect("nothing stops it")
            }
            (Some(_), Some(_)) => {
                let first = |each: &mut SequenceVisitor<'_, FingerSamples>| {
                    gripper::sequence::render(plan, index, 0, |pair, number| {
                        each(SequenceEvent::Frame(Box::new(pair), number))
                    })
                };
                encode_sequence(plan, index, FrameStorage::InMemory, encode_both_fingers, first)
                    .expect("nothing stops it")
            }
        }
    })
}

/// Encodes a press.
pub fn encode_press(plan: &Plan, AcceptedSample { sample, rejected }: AcceptedSample) -> EncodedSample {
    let mut clock = ThreadClock::start();
    let members = encode_members(plan, &sample);
    let seconds = Seconds { encode: clock.lap(), ..sample.seconds };
    EncodedSample { label: sample.label, rejected, members, seconds, effects: sample.impression.effects.seconds }
}

/// Encodes a grip: the files of its left finger, then those of its right one, and one label.
pub fn encode_grip(plan: &Plan, gripper::AcceptedGrip { grip, rejected }: gripper::AcceptedGrip) -> EncodedSample {
    let mut clock = ThreadClock::start();
    let mut members = encode_both_fingers(plan, &grip.fingers);
    members.push(Member::new("json", to_json_line(&grip.label)));
    let gripper::Grip { summary, mut seconds, effects, .. } = grip;
    seconds.encode += clock.lap();
    EncodedSample { label: summary, rejected, members, seconds, effects }
}

/// Encodes the tactile image and the layers of the left finger, then those of the right one.
fn encode_both_fingers(plan: &Plan, fingers: &FingerSamples) -> Vec<Member> {
    let of_finger = |(name, sample): (&str, &Sample)| {
        let named = |member: Member| Member { suffix: format!("{name}.{}", member.suffix), ..member };
        encode_layers(plan, sample).into_iter().map(named).collect::<Vec<_>>()
    };
    FINGER_NAMES.into_iter().zip(fingers).flat_map(of_finger).collect()
}

/// Receives the events of a sequence, frame by frame.
type SequenceVisitor<'a, S> = dyn FnMut(SequenceEvent<S>) -> Result<(), SampleError> + 'a;

/// Encodes sequence `index`. `draw` calls its argument with each frame, and only the files that `layers` makes of it
/// are kept.
fn encode_sequence<S, L: Serialize>(
    plan: &Plan,
    index: u64,
    keep: FrameStorage<'_>,
    layers: impl Fn(&Plan, &S) -> Vec<Member>,
    draw: impl FnOnce(&mut SequenceVisitor<'_, S>) -> Result<sequence::AcceptedSequence<L>, SampleError>,
) -> Result<EncodedSample, SampleError> {
    let (mut members, mut encode) = (Vec::new(), 0.0);
    let path = match keep {
        FrameStorage::InMemory => PathBuf::new(),
        FrameStorage::OnDisk { folder, .. } => {
            folder.join(format!(".{}.{}.partial", plan.layout.shard_of(index).name(), sample_key(index)))
        }
    };
    let failed = |error| SampleError::Io(path.clone(), error);
    let mut spool = match keep {
        FrameStorage::InMemory => None,
        FrameStorage::OnDisk { .. } => Some(Spool::create(&path).map_err(failed)?),
    };
    let accepted = draw(&mut |shown| {
        match shown {
            // A new draw begins: forget the files of the one that was rejected.
            SequenceEvent::Begin => {
                members.clear();
                spool.as_mut().map_or(Ok(()), Spool::clear).map_err(failed)?;
            }
            SequenceEvent::Frame(shown, number) => {
                let mut clock = ThreadClock::start();
                for mut member in layers(plan, &shown) {
                    member.suffix = format!("{}.{}", frame_name(number), member.suffix);
                    members.push(match &mut spool {
                        None => member,
                        Some(spool) => spool.put(member).map_err(failed)?,
                    });
                }
                encode += clock.lap();
            }
        }
        match keep {
            FrameStorage::OnDisk { stop, .. } if stop() => Err(SampleError::Stopped),
            _ => Ok(()),
        }
    })?;
    let mut clock = ThreadClock::start();
    members.push(Member::new("json", to_json_line(&accepted.label)));
    let seconds = Seconds { encode: encode + clock.lap(), ..accepted.seconds };
    let sequence::AcceptedSequence { summary, rejected, effects, .. } = accepted;
    Ok(EncodedSample { label: summary, rejected, members, seconds, effects })
}

/// Returns the name of a frame that stands in the names of its files, behind the sample's key.
pub fn frame_name(number: u32) -> String {
    format!("f{number:04}")
}

/// Encodes the tactile image, the layers and the label.
pub fn encode_members(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let mut members = encode_layers(plan, sample);
    members.push(Member::new("json", to_json_line(&sample.label)));
    members
}

/// Layers of floats that were encoded for an earlier sensor.
#[derive(Default)]
struct KnownLayers(Vec<KnownLayer>);

struct KnownLayer {
    layer: OutputLayer,
    values: Vec<f32>,
    output: Output,
    png16: Steps,
    bytes: Vec<u8>,
}

impl KnownLayers {
    /// Returns the layer of `sample` as it was encoded before, or encodes it.
    fn encode(
        &mut self,
        plan: &Plan,
        sample: &Sample,
        layer: OutputLayer,
        values: Vec<f32>,
        encode: impl FnOnce(&[f32]) -> Vec<u8>,
    ) -> Vec<u8> {
        let is_same = |known: &KnownLayer| {
            let bits = || known.values.iter().zip(&values).all(|(a, b)| a.to_bits() == b.to_bits());
            known.layer == layer
                && known.output == *plan.output()
                && known.png16 == sample.label.png16
                && known.values.len() == values.len()
                && bits()
        };
        if let Some(known) = self.0.iter().find(|known| is_same(known)) {
            return known.bytes.clone();
        }
        let bytes = encode(&values);
        self.0.retain(|known| known.layer != layer);
        let (output, png16) = (plan.output().clone(), sample.label.png16);
        self.0.push(KnownLayer { layer, values, output, png16, bytes: bytes.clone() });
        bytes
    }
}

/// Encodes the tactile image and the layers.
pub fn encode_layers(plan: &Plan, sample: &Sample) -> Vec<Member> {
    encode_layers_after(plan, sample, None)
}

/// Encodes the tactile image and the layers; those that an earlier sensor has, too, are taken from `known`.
fn encode_layers_after(plan: &Plan, sample: &Sample, mut known: Option<&mut KnownLayers>) -> Vec<Member> {
    let image = &sample.impression.image;
    let (width, height) = (image.width, image.height);
    let mut members = vec![Member::new("tactile.png", png::encode_rgb(width, height, &image.rgb))];
    for layer in &plan.layers() {
        let bytes = match layer_content(sample, *layer) {
            LayerContent::Floats(values) => {
                let encode = |values: &[f32]| match layer.channels().len() {
                    0 | 1 => encode_float_layer(plan, sample, *layer, &[values]),
                    count => {
                        let plane = |k: usize| values.iter().skip(k).step_by(count).copied().collect();
                        let planes: Vec<Vec<f32>> = (0..count).map(plane).collect();
                        encode_float_layer(plan, sample, *layer, &planes.iter().map(Vec::as_slice).collect::<Vec<_>>())
                    }
                };
                match &mut known {
                    None => encode(&values),
                    Some(known) => known.encode(plan, sample, *layer, values, encode),
                }
            }
            LayerContent::Bytes(bytes) => match layer.spec().form {
                LayerForm::Rgb => png::encode_rgb(width, height, &bytes),
                _ => png::encode_grey(width, height, &bytes),
            },
            LayerContent::Markers(positions) => to_json_line(&positions),
        };
        members.push(Member::new(layer.file_suffix(plan.output().depth_format), bytes));
    }
    members
}

/// Encodes a layer of floats in the format that the job selects.
fn encode_float_layer(plan: &Plan, sample: &Sample, layer: OutputLayer, planes: &[&[f32]]) -> Vec<u8> {
    let (width, height) = (sample.impression.image.width, sample.impression.image.height);
    match layer.coding_for(plan.output().depth_format) {
        LayerCoding::Npy => npy::encode(width, height, planes),
        LayerCoding::Png16(scale) => sample.label.png16.encode(scale, width, height, planes[0]),
        _ => {
            let pixel = match layer.spec().form {
                LayerForm::Floats { pixel, .. } => pixel.unwrap_or(plan.output().exr.pixel),
                _ => plan.output().exr.pixel,
            };
            let named: Vec<(&str, &[f32])> = layer.channels().iter().copied().zip(planes.iter().copied()).collect();
            exr::encode(width, height, &named, Exr { pixel, ..plan.output().exr })
        }
    }
}

/// Formats a value as JSON on one line. Floats have a decimal point; those that are not finite become null.
pub fn to_json_line(value: &impl Serialize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, DecimalPoints);
    value.serialize(&mut serializer).expect("all that is written has string keys");
    bytes
}

/// Compact JSON in which every float has a decimal point, so that no reader takes it for a whole number: 1.0e-7 where
/// serde_json alone writes 1e-7.
struct DecimalPoints;

impl Formatter for DecimalPoints {
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        let mut text = Vec::with_capacity(24);
        CompactFormatter.write_f64(&mut text, value)?;
        match text.iter().position(|byte| *byte == b'e') {
            Some(at) if !text.contains(&b'.') => {
                writer.write_all(&text[..at])?;
                writer.write_all(b".0")?;
                writer.write_all(&text[at..])
            }
            _ => writer.write_all(&text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::archive::FileContent;
    use gelsim_job::config::Overrides;

    fn slide(folder: &Path) -> Plan {
        let ball = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../objects/sphere.obj");
        let text = format!(
            "dataset = {{ name = \"t\", samples = 1, seed = 5 }}\nsensor.resolution_px = [24, 18]\n\
             object = [{{ path = {ball:?} }}]\noutput.layers = [\"slip\"]\n\
             [[sequence.phase]]\nname = \"press\"\nduration_s = 0.2\ndepth_mm = 0.5\n\
             [[sequence.phase]]\nname = \"slide\"\nduration_s = 0.4\nx_mm = 1.0\n"
        );
        let path = folder.join("job.toml");
        std::fs::write(&path, text).expect("a file");
        Plan::load(&path, &Overrides::default()).expect("a sound job")
    }

    #[test]
    fn the_frames_of_a_sequence_wait_on_disk_and_are_the_same() {
        let folder = tempfile::tempdir().expect("a folder");
        let plan = slide(folder.path());
        let on_disk = FrameStorage::OnDisk { folder: folder.path(), stop: &|| false };
        let (held, kept) =
            (make_sample(&plan, 0, FrameStorage::InMemory).unwrap(), make_sample(&plan, 0, on_disk).unwrap());
        assert_eq!(held.members.len(), kept.members.len());
        let mut images = 0;
        for (held, kept) in held.members.iter().zip(&kept.members) {
            assert_eq!(held.suffix, kept.suffix);
            assert!(matches!(held.bytes, FileContent::InMemory(_)));
            assert_eq!(matches!(kept.bytes, FileContent::Spooled { .. }), kept.suffix != "json", "{}", kept.suffix);
            if kept.suffix.ends_with(".png") {
                images += 1;
                assert!(held.bytes.read().unwrap() == kept.bytes.read().unwrap(), "{}", kept.suffix);
            }
        }
        assert_eq!(images, 2 * 15);
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["job.toml"]);
    }

    #[test]
    fn a_sequence_that_is_stopped_ends_with_the_frame_under_way() {
        use std::sync::atomic::{AtomicU32, Ordering};
        let folder = tempfile::tempdir().expect("a folder");
        let plan = slide(folder.path());
        let asked = AtomicU32::new(0);
        // `stop` is asked once at the beginning, and after each frame.
        let third = || asked.fetch_add(1, Ordering::Relaxed) == 3;
        let stopped = make_sample(&plan, 0, FrameStorage::OnDisk { folder: folder.path(), stop: &third });
        assert!(matches!(stopped, Err(SampleError::Stopped)));
        assert_eq!(asked.into_inner(), 4);
    }
}
