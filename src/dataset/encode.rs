//! The files of a sample, in the order in which they stand in a shard.

use std::path::{Path, PathBuf};
use std::{fmt, io};

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::archive::Member;
use crate::content::{Content, content};
use crate::spool::Spool;
use gelsim_core::base::clock::{Clock, Seconds};
use gelsim_core::effects::PerEffect;
use gelsim_files::exr::Exr;
use gelsim_files::{exr, npy, png};
use gelsim_job::gripper::sequence::Pair;
use gelsim_job::gripper::{self, FINGERS};
use gelsim_job::label::{Label, key};
use gelsim_job::layers::{Coding, Form, OutputLayer};
use gelsim_job::plan::Plan;
use gelsim_job::sample::{Accepted, Sample, Unfit, accept, render};
use gelsim_job::sequence::{self, Shown};

/// A sample made and encoded. Its images are not kept.
pub struct Made {
    /// Its label; of a sequence what counts of it as a whole.
    pub label: Label,
    /// What was drawn before it and rejected.
    pub rejected: Vec<Label>,
    /// Its files.
    pub members: Vec<Member>,
    /// CPU seconds of its stages.
    pub seconds: Seconds,
    /// The same of each effect.
    pub effects: PerEffect<f64>,
}

/// Where the files of a sequence stay until it is whole.
#[derive(Clone, Copy)]
pub enum Keep<'a> {
    /// In memory.
    InMemory,
    /// On disk, in the folder `data` of the dataset, until there is no more need for it.
    OnDisk {
        /// The folder.
        folder: &'a Path,
        /// Whether to drop what is under way.
        stop: &'a (dyn Fn() -> bool + Sync),
    },
}

/// Why there is no sample.
#[derive(Debug)]
pub enum Unmade {
    /// No draw of it may go into the dataset.
    Unfit(Unfit),
    /// There was no keeping its files.
    Io(PathBuf, io::Error),
    /// It was to be dropped.
    Stopped,
}

impl From<Unfit> for Unmade {
    fn from(unfit: Unfit) -> Self {
        Self::Unfit(unfit)
    }
}

impl fmt::Display for Unmade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unfit(Unfit(label)) => write!(f, "no draw of it is healthy: {}", label.health.reason),
            Self::Io(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Stopped => f.write_str("it was stopped"),
        }
    }
}

/// Makes sample `index` as a dataset has it: a press, a grip, or a sequence.
pub fn make(plan: &Plan, index: u64, keep: Keep<'_>) -> Result<Made, Unmade> {
    match (&plan.job().sequence, &plan.job().gripper) {
        (None, None) => Ok(press(plan, accept(plan, index)?)),
        (None, Some(_)) => Ok(grip(plan, gripper::accept(plan, index)?)),
        (Some(_), None) => sequence(plan, index, keep, layers, |each| sequence::accept(plan, index, each)),
        (Some(_), Some(_)) => {
            sequence(plan, index, keep, layers_of_both, |each| gripper::sequence::accept(plan, index, each))
        }
    }
}

/// The same in memory, of its first draw if no draw of it may go into a dataset.
pub fn make_shown(plan: &Plan, index: u64) -> Made {
    make(plan, index, Keep::InMemory).unwrap_or_else(|_| match (&plan.job().sequence, &plan.job().gripper) {
        (None, None) => press(plan, Accepted { sample: render(plan, index), rejected: Vec::new() }),
        (None, Some(_)) => {
            grip(plan, gripper::Accepted { grip: gripper::render(plan, index, 0), rejected: Vec::new() })
        }
        (Some(_), None) => {
            let first = |each: &mut Each<'_, Sample>| {
                sequence::render(plan, index, 0, |sample, number| each(Shown::Frame(Box::new(sample), number)))
            };
            sequence(plan, index, Keep::InMemory, layers, first).expect("nothing stops it")
        }
        (Some(_), Some(_)) => {
            let first = |each: &mut Each<'_, Pair>| {
                gripper::sequence::render(plan, index, 0, |pair, number| each(Shown::Frame(Box::new(pair), number)))
            };
            sequence(plan, index, Keep::InMemory, layers_of_both, first).expect("nothing stops it")
        }
    })
}

/// Encodes a press.
pub fn press(plan: &Plan, Accepted { sample, rejected }: Accepted) -> Made {
    let mut clock = Clock::start();
    let members = members(plan, &sample);
    let seconds = Seconds { encode: clock.lap(), ..sample.seconds };
    Made { label: sample.label, rejected, members, seconds, effects: sample.impression.effects.seconds }
}

/// Encodes a grip: the files of its left finger, then those of its right one, and one label.
pub fn grip(plan: &Plan, gripper::Accepted { grip, rejected }: gripper::Accepted) -> Made {
    let mut clock = Clock::start();
    let mut members = layers_of_both(plan, &grip.fingers);
    members.push(Member::new("json", json(&grip.label)));
    let gripper::Grip { summary, mut seconds, effects, .. } = grip;
    seconds.encode += clock.lap();
    Made { label: summary, rejected, members, seconds, effects }
}

/// Encodes the tactile image and the layers of the left finger, then those of the right one.
fn layers_of_both(plan: &Plan, fingers: &Pair) -> Vec<Member> {
    let of_finger = |(name, sample): (&str, &Sample)| {
        let named = |member: Member| Member { suffix: format!("{name}.{}", member.suffix), ..member };
        layers(plan, sample).into_iter().map(named).collect::<Vec<_>>()
    };
    FINGERS.into_iter().zip(fingers).flat_map(of_finger).collect()
}

/// Who is shown a sequence.
type Each<'a, S> = dyn FnMut(Shown<S>) -> Result<(), Unmade> + 'a;

/// Encodes sequence `index`, which `draw` shows frame by frame: only their files, which `layers` encodes, are kept.
fn sequence<S, L: Serialize>(
    plan: &Plan,
    index: u64,
    keep: Keep<'_>,
    layers: impl Fn(&Plan, &S) -> Vec<Member>,
    draw: impl FnOnce(&mut Each<'_, S>) -> Result<sequence::Accepted<L>, Unmade>,
) -> Result<Made, Unmade> {
    let (mut members, mut encode) = (Vec::new(), 0.0);
    let path = match keep {
        Keep::InMemory => PathBuf::new(),
        Keep::OnDisk { folder, .. } => {
            folder.join(format!(".{}.{}.partial", plan.layout.shard_of(index).name(), key(index)))
        }
    };
    let failed = |error| Unmade::Io(path.clone(), error);
    let mut spool = match keep {
        Keep::InMemory => None,
        Keep::OnDisk { .. } => Some(Spool::create(&path).map_err(failed)?),
    };
    let accepted = draw(&mut |shown| {
        match shown {
            Shown::Begin => {
                members.clear();
                spool.as_mut().map_or(Ok(()), Spool::clear).map_err(failed)?;
            }
            Shown::Frame(shown, number) => {
                let mut clock = Clock::start();
                for mut member in layers(plan, &shown) {
                    member.suffix = format!("{}.{}", frame(number), member.suffix);
                    members.push(match &mut spool {
                        None => member,
                        Some(spool) => spool.put(member).map_err(failed)?,
                    });
                }
                encode += clock.lap();
            }
        }
        match keep {
            Keep::OnDisk { stop, .. } if stop() => Err(Unmade::Stopped),
            _ => Ok(()),
        }
    })?;
    let mut clock = Clock::start();
    members.push(Member::new("json", json(&accepted.label)));
    let seconds = Seconds { encode: encode + clock.lap(), ..accepted.seconds };
    let sequence::Accepted { summary, rejected, effects, .. } = accepted;
    Ok(Made { label: summary, rejected, members, seconds, effects })
}

/// What stands in the names of a frame's files, after the sample's key.
pub fn frame(number: u32) -> String {
    format!("f{number:04}")
}

/// Encodes the tactile image, the layers and the label.
pub fn members(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let mut members = layers(plan, sample);
    members.push(Member::new("json", json(&sample.label)));
    members
}

/// Encodes the tactile image and the layers.
pub fn layers(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let image = &sample.impression.image;
    let (width, height) = (image.width, image.height);
    let mut members = vec![Member::new("tactile.png", png::encode_rgb(width, height, &image.rgb))];
    for layer in &plan.layers() {
        let bytes = match content(sample, *layer) {
            Content::Floats(values) => match layer.channels().len() {
                0 | 1 => float_layer(plan, sample, *layer, &[&values]),
                count => {
                    let plane = |k: usize| values.iter().skip(k).step_by(count).copied().collect();
                    let planes: Vec<Vec<f32>> = (0..count).map(plane).collect();
                    float_layer(plan, sample, *layer, &planes.iter().map(Vec::as_slice).collect::<Vec<_>>())
                }
            },
            Content::Bytes(bytes) => match layer.spec().form {
                Form::Rgb => png::encode_rgb(width, height, &bytes),
                _ => png::encode_grey(width, height, &bytes),
            },
            Content::Markers(positions) => json(&positions),
        };
        members.push(Member::new(layer.suffix(plan.output().depth_format), bytes));
    }
    members
}

/// Encodes a layer of floats in the format that the job wants.
fn float_layer(plan: &Plan, sample: &Sample, layer: OutputLayer, planes: &[&[f32]]) -> Vec<u8> {
    let (width, height) = (sample.impression.image.width, sample.impression.image.height);
    match layer.coding(plan.output().depth_format) {
        Coding::Npy => npy::encode(width, height, planes),
        Coding::Png16(scale) => sample.label.png16.encode(scale, width, height, planes[0]),
        _ => {
            let pixel = match layer.spec().form {
                Form::Floats { pixel, .. } => pixel.unwrap_or(plan.output().exr.pixel),
                _ => plan.output().exr.pixel,
            };
            let named: Vec<(&str, &[f32])> = layer.channels().iter().copied().zip(planes.iter().copied()).collect();
            exr::encode(width, height, &named, Exr { pixel, ..plan.output().exr })
        }
    }
}

/// A value as JSON on one line, its floats with a decimal point; those that are not finite become null.
pub fn json(value: &impl Serialize) -> Vec<u8> {
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
    use crate::archive::Bytes;
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
        let on_disk = Keep::OnDisk { folder: folder.path(), stop: &|| false };
        let (held, kept) = (make(&plan, 0, Keep::InMemory).unwrap(), make(&plan, 0, on_disk).unwrap());
        assert_eq!(held.members.len(), kept.members.len());
        let mut images = 0;
        for (held, kept) in held.members.iter().zip(&kept.members) {
            assert_eq!(held.suffix, kept.suffix);
            assert!(matches!(held.bytes, Bytes::Held(_)));
            assert_eq!(matches!(kept.bytes, Bytes::Spooled { .. }), kept.suffix != "json", "{}", kept.suffix);
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
        // Asked once at its begin, and after each frame.
        let third = || asked.fetch_add(1, Ordering::Relaxed) == 3;
        let stopped = make(&plan, 0, Keep::OnDisk { folder: folder.path(), stop: &third });
        assert!(matches!(stopped, Err(Unmade::Stopped)));
        assert_eq!(asked.into_inner(), 4);
    }
}
