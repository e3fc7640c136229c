//! Depth frames from a pipe, tactile images into another: what a simulator's control loop talks to.
//!
//! Either way frames are npy files one after another, each with its header (docs/simulators.md has the other side). An image is
//! written and flushed before the next frame is read, and nothing is kept.

use std::io::{self, ErrorKind, Read, Write};

use super::camera::DepthCamera;
use super::poses::FrameMetadata;
use super::reader::FrameReader;
use super::run::InSequence;
use super::sequence::Follower;
use super::{read, run};
use gelsim_core::pose::Pose;
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_files::npy;
use gelsim_job::plan::Plan;

/// Longest header, bytes; numpy's has 118.
const MOST_HEADER: usize = 1 << 16;

/// Why a stream ended early.
#[derive(Debug)]
pub enum StreamError {
    /// A frame, counted from 0, cannot be read or cannot be right.
    Frame(u64, Diagnostic),
    /// No plan can be made for the first frame's size.
    Plan(Report),
    /// Nobody takes the images any more.
    Unread,
    /// Reading or writing failed.
    Io(io::Error),
}

/// Renders each frame of `input` to `output` until the input ends between two frames; how many there were. `plan` gives
/// the plan for frames of a size, once; `note` is told what should be known of them.
pub fn stream(
    mut input: impl Read,
    mut output: impl Write,
    camera: &DepthCamera,
    sequence: Option<InSequence>,
    plan: impl FnOnce([usize; 2]) -> Result<Plan, Report>,
    mut note: impl FnMut(Report),
) -> Result<u64, StreamError> {
    // What has been said of the frames so far, and whether one of them pressed.
    let (mut is_suspected, mut has_pressed) = (false, false);
    let mut follower: Option<Follower> = None;
    let mut bytes = Vec::new();
    let mut make = Some(plan);
    let mut made: Option<([usize; 2], Plan, FrameReader)> = None;
    for number in 0.. {
        let wrong = |message: String| StreamError::Frame(number, Diagnostic::new(message));
        let first = if sequence.is_some() { What::Pose } else { What::Frame };
        if !next(&mut input, &mut bytes, first).map_err(wrong)? {
            if number > 0 && !has_pressed && !is_suspected {
                let message = format!("nothing reaches the pad in any of {number} frames");
                let help = "if it should, are --depth-unit and --plane-mm right?";
                note(Diagnostic::warning(message).help(help).into());
            }
            return Ok(number);
        }
        // In a sequence each frame comes after its object's pose.
        let known = match sequence {
            None => None,
            Some(_) => {
                let known = pose(&bytes).map_err(wrong)?;
                if !next(&mut input, &mut bytes, What::Frame).map_err(wrong)? {
                    return Err(wrong(String::from("the input ends after its pose")));
                }
                Some(known)
            }
        };
        let frame = read::decode(&bytes).map_err(wrong)?;
        let size = [frame.width, frame.height];
        if let Some(make) = make.take() {
            let plan = make(size).map_err(StreamError::Plan)?;
            let reader = FrameReader::new(*camera, &plan.simulator, size);
            note(plan.notes.clone());
            made = Some((size, plan, reader.map_err(|problem| StreamError::Frame(number, problem))?));
        }
        let Some((first, plan, reader)) = &made else { continue };
        if size != *first {
            let [now, before] = [size, *first].map(|[width, height]| format!("{width}x{height}"));
            return Err(wrong(format!("it has {now} px, and those before it have {before}")));
        }
        let seen = reader.read(frame).map_err(|problem| StreamError::Frame(number, problem))?;
        if let Some(problem) = seen.reach().mistake(camera) {
            return Err(StreamError::Frame(number, problem));
        }
        has_pressed |= seen.reach().is_pressed();
        if !has_pressed
            && !is_suspected
            && let Some(suspicion) = seen.reach().suspicion(camera)
        {
            is_suspected = true;
            let message = format!("frame {number}: {}", suspicion.message);
            note(Diagnostic { message, ..suspicion }.into());
        }
        let sample = match (known, sequence) {
            (Some(known), Some(InSequence { friction, frame_rate_hz })) => {
                let begun = || Follower::new(plan, friction, frame_rate_hz).expect("the plan was made for a sequence");
                let followed = follower.get_or_insert_with(begun).next(plan, number, seen, known);
                followed.map_err(|problem| StreamError::Frame(number, problem))?.sample
            }
            _ => run::sample(plan, number, "frame", seen, None),
        };
        let image = sample.impression.image;
        let written = output.write_all(&npy::encode_rgb(image.width, image.height, &image.rgb));
        written.and_then(|()| output.flush()).map_err(|error| match error.kind() {
            ErrorKind::BrokenPipe => StreamError::Unread,
            _ => StreamError::Io(error),
        })?;
    }
    Ok(0)
}

/// What comes next.
#[derive(Clone, Copy)]
enum What {
    Frame,
    Pose,
}

/// What a pose is.
const POSE: &str = "it is quaternion x, y, z, w, then x, y, z in mm";

/// The pose in an npy array of seven numbers: a unit quaternion x, y, z, w, then x, y, z in mm.
fn pose(bytes: &[u8]) -> Result<FrameMetadata, String> {
    let array = npy::decode_numbers(bytes)?;
    let [x, y, z, w, right, down, out] = array.values[..] else {
        return Err(format!("its pose has {} numbers: {POSE}", array.values.len()));
    };
    let quaternion = [x, y, z, w];
    let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
    if !array.values.iter().all(|number| number.is_finite()) || (length - 1.0).abs() > 1e-3 {
        return Err(format!("its pose's quaternion has length {length}, not 1, or a number of it is not finite"));
    }
    Ok(FrameMetadata { pose: Pose::placed(quaternion, [right, down, out]), ..FrameMetadata::nothing("frame") })
}

/// Reads the next npy file into `bytes`; false if there is none. On failure, what is wrong with it.
fn next(input: &mut impl Read, bytes: &mut Vec<u8>, what: What) -> Result<bool, String> {
    /// Up to the length of the header.
    const START: usize = 8;
    bytes.clear();
    if !more(input, bytes, START)? {
        return Ok(false);
    }
    let length = match bytes.as_slice() {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _] => 2,
        [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _] => 4,
        _ => return Err(String::from("no npy file begins where it should")),
    };
    whole(input, bytes, length)?;
    let header = bytes[START..].iter().rev().fold(0, |length: usize, byte| length << 8 | usize::from(*byte));
    if header > MOST_HEADER {
        return Err(format!("its header claims {header} bytes"));
    }
    whole(input, bytes, header)?;
    let (shape, data) = npy::announced(bytes)?;
    match what {
        What::Frame => read::size(&shape).map(drop)?,
        What::Pose if shape == [7] => {}
        What::Pose => return Err(format!("its pose has the shape {shape:?}, not (7,): {POSE}")),
    }
    whole(input, bytes, data)?;
    Ok(true)
}

/// Appends `count` bytes of a frame that has begun.
fn whole(input: &mut impl Read, bytes: &mut Vec<u8>, count: usize) -> Result<(), String> {
    match more(input, bytes, count)? || count == 0 {
        true => Ok(()),
        false => Err(format!("the input ends within it, after {} bytes", bytes.len())),
    }
}

/// Appends `count` bytes; false if the input has ended before the first of them.
fn more(input: &mut impl Read, bytes: &mut Vec<u8>, count: usize) -> Result<bool, String> {
    let before = bytes.len();
    let read = input.by_ref().take(count as u64).read_to_end(bytes).map_err(|error| error.to_string())?;
    match read {
        _ if read == count => Ok(count > 0),
        0 => Ok(false),
        _ => Err(format!("the input ends within it, after {} bytes", before + read)),
    }
}
