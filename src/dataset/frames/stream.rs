//! Renders depth frames from a pipe and writes tactile images to another, for the control loop of a simulator.
//!
//! In both directions, frames are npy files one after another, each with its header (docs/how-to/simulators.md
//! describes the other side). An image is written and flushed before the next frame is read, and nothing is kept.

use std::io::{self, ErrorKind, Read, Write};

use super::camera::DepthCamera;
use super::poses::FrameMetadata;
use super::reader::FrameReader;
use super::run::SequenceSettings;
use super::sequence::SequenceFollower;
use super::{read, run};
use gelsim_core::pose::Pose;
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_files::npy;
use gelsim_job::plan::Plan;

/// Most bytes of a header; numpy's has 118.
const MAX_HEADER: usize = 1 << 16;

/// Why a stream ended early.
#[derive(Debug)]
pub enum StreamError {
    /// A frame, counted from 0, cannot be read or cannot be right.
    Frame(u64, Diagnostic),
    /// No plan can be made for the first frame's size.
    Plan(Report),
    /// The reader of the images has closed the pipe.
    OutputClosed,
    /// Reading or writing failed.
    Io(io::Error),
}

/// Renders each frame of `input` to `output` until the input ends between two frames, and returns their number. `plan`
/// is called once, with the size of the frames, to make the plan; `note` receives what a user should know of it and of
/// the frames.
pub fn render_stream(
    mut input: impl Read,
    mut output: impl Write,
    camera: &DepthCamera,
    sequence: Option<SequenceSettings>,
    plan: impl FnOnce([usize; 2]) -> Result<Plan, Report>,
    mut note: impl FnMut(Report),
) -> Result<u64, StreamError> {
    // Whether a suspicion was reported, and whether a frame has pressed the pad.
    let (mut is_suspected, mut has_pressed) = (false, false);
    let mut follower: Option<SequenceFollower> = None;
    let mut bytes = Vec::new();
    let mut make = Some(plan);
    let mut made: Option<([usize; 2], Plan, FrameReader)> = None;
    for number in 0.. {
        let wrong = |message: String| StreamError::Frame(number, Diagnostic::new(message));
        let first = if sequence.is_some() { StreamItem::Pose } else { StreamItem::Frame };
        if !read_next_array(&mut input, &mut bytes, first).map_err(wrong)? {
            if number > 0 && !has_pressed && !is_suspected {
                let message = format!("nothing reaches the pad in any of {number} frames");
                let help = "if it should, are --depth-unit and --plane-mm right?";
                note(Diagnostic::warning(message).help(help).into());
            }
            return Ok(number);
        }
        // In a sequence the pose of the object comes before each frame.
        let known = match sequence {
            None => None,
            Some(_) => {
                let known = parse_pose(&bytes).map_err(wrong)?;
                if !read_next_array(&mut input, &mut bytes, StreamItem::Frame).map_err(wrong)? {
                    return Err(wrong(String::from("the input ends after its pose")));
                }
                Some(known)
            }
        };
        let frame = read::decode_frame(&bytes).map_err(wrong)?;
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
        if let Some(problem) = seen.reach().find_error(camera) {
            return Err(StreamError::Frame(number, problem));
        }
        has_pressed |= seen.reach().is_pressed();
        if !has_pressed
            && !is_suspected
            && let Some(suspicion) = seen.reach().find_suspicion(camera)
        {
            is_suspected = true;
            let message = format!("frame {number}: {}", suspicion.message);
            note(Diagnostic { message, ..suspicion }.into());
        }
        let sample = match (known, sequence) {
            (Some(known), Some(SequenceSettings { friction, frame_rate_hz })) => {
                let begun =
                    || SequenceFollower::new(plan, friction, frame_rate_hz).expect("the plan was made for a sequence");
                let followed = follower.get_or_insert_with(begun).render_next(plan, number, seen, known);
                followed.map_err(|problem| StreamError::Frame(number, problem))?.sample
            }
            _ => run::render_frame_sample(plan, number, "frame", seen, None),
        };
        let image = sample.impression.image;
        let written = output.write_all(&npy::encode_rgb(image.width, image.height, &image.rgb));
        written.and_then(|()| output.flush()).map_err(|error| match error.kind() {
            ErrorKind::BrokenPipe => StreamError::OutputClosed,
            _ => StreamError::Io(error),
        })?;
    }
    Ok(0)
}

/// What comes next in the stream.
#[derive(Clone, Copy)]
enum StreamItem {
    Frame,
    Pose,
}

/// What a pose is, for messages.
const POSE: &str = "it is quaternion x, y, z, w, then x, y, z in mm";

/// Parses the pose in an npy array of seven numbers: a unit quaternion x, y, z, w, then x, y, z in mm.
fn parse_pose(bytes: &[u8]) -> Result<FrameMetadata, String> {
    let array = npy::decode_numbers(bytes)?;
    let [x, y, z, w, right, down, out] = array.values[..] else {
        return Err(format!("its pose has {} numbers: {POSE}", array.values.len()));
    };
    let quaternion = [x, y, z, w];
    let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
    if !array.values.iter().all(|number| number.is_finite()) || (length - 1.0).abs() > 1e-3 {
        return Err(format!("its pose's quaternion has length {length}, not 1, or a number of it is not finite"));
    }
    Ok(FrameMetadata { pose: Pose::from_quaternion(quaternion, [right, down, out]), ..FrameMetadata::from_id("frame") })
}

/// Reads the next npy file into `bytes`. Returns false if there is none. The error says what is wrong with it.
fn read_next_array(input: &mut impl Read, bytes: &mut Vec<u8>, what: StreamItem) -> Result<bool, String> {
    /// Bytes before the length of the header.
    const START: usize = 8;
    bytes.clear();
    if !read_more(input, bytes, START)? {
        return Ok(false);
    }
    let length = match bytes.as_slice() {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _] => 2,
        [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _] => 4,
        _ => return Err(String::from("no npy file begins where it should")),
    };
    read_rest(input, bytes, length)?;
    // Little endian: the last byte is the highest.
    let header = bytes[START..].iter().rev().fold(0, |length: usize, byte| length << 8 | usize::from(*byte));
    if header > MAX_HEADER {
        return Err(format!("its header claims {header} bytes"));
    }
    read_rest(input, bytes, header)?;
    // The shape is checked before memory is taken for the data.
    let (shape, data) = npy::read_announced_shape(bytes)?;
    match what {
        StreamItem::Frame => read::frame_size(&shape).map(drop)?,
        StreamItem::Pose if shape == [7] => {}
        StreamItem::Pose => return Err(format!("its pose has the shape {shape:?}, not (7,): {POSE}")),
    }
    read_rest(input, bytes, data)?;
    Ok(true)
}

/// Appends `count` bytes of a file that has begun.
fn read_rest(input: &mut impl Read, bytes: &mut Vec<u8>, count: usize) -> Result<(), String> {
    match read_more(input, bytes, count)? || count == 0 {
        true => Ok(()),
        false => Err(format!("the input ends within it, after {} bytes", bytes.len())),
    }
}

/// Appends `count` bytes. Returns false if the input has ended before the first of them.
fn read_more(input: &mut impl Read, bytes: &mut Vec<u8>, count: usize) -> Result<bool, String> {
    let before = bytes.len();
    let read = input.by_ref().take(count as u64).read_to_end(bytes).map_err(|error| error.to_string())?;
    match read {
        _ if read == count => Ok(count > 0),
        0 => Ok(false),
        _ => Err(format!("the input ends within it, after {} bytes", before + read)),
    }
}
