//! Takes a stream of npy arrays apart: frames, or in a sequence the pose of the object and a frame in turn.
//!
//! An array that cannot be a frame is told from a stream that is lost: the header of the one says where the next array
//! begins. Its data are passed over, not kept, and only when the next array is wanted.

use std::io::{self, Read};

use super::super::poses::FrameMetadata;
use super::super::read;
use gelsim_core::base::grid::Grid;
use gelsim_core::pose::Pose;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::input::MAX_IMAGE_BYTES;
use gelsim_files::npy;

/// Most bytes of a header; numpy's has 118.
const MAX_HEADER: usize = 1 << 16;

/// Most numbers of an array that may be a wrong pose; one with more is a frame in the place of a pose.
const MAX_POSE: usize = 64;

/// What a pose is, for messages.
const POSE: &str = "it is quaternion x, y, z, w, then x, y, z in mm";

/// Reads the messages of a stream.
pub struct StreamInput<R> {
    input: R,
    has_poses: bool,
    /// The array that was read last. Its memory is used again.
    bytes: Vec<u8>,
    /// Data of an array that was refused and that still stand before the next one.
    passed_over: u64,
    size: Option<[usize; 2]>,
}

/// A message of a stream.
#[expect(clippy::large_enum_variant, reason = "one is read at a time")]
pub enum StreamMessage {
    /// Another object begins: an array without values in the place of a pose.
    Reset,
    /// A frame, or what is wrong with it.
    Frame(Result<StreamFrame, Diagnostic>),
}

/// A frame of a stream.
pub struct StreamFrame {
    /// Pose of the object, in a sequence.
    pub known: Option<FrameMetadata>,
    /// Values of the camera, in its own unit.
    pub depth: Grid<f64>,
}

/// The place of an array in the stream.
#[derive(Clone, Copy, PartialEq)]
enum ArrayPlace {
    Frame,
    Pose,
}

impl<R: Read> StreamInput<R> {
    /// Makes a reader of `input`. With `has_poses` a pose stands before each frame.
    pub fn new(input: R, has_poses: bool) -> Self {
        Self { input, has_poses, bytes: Vec::new(), passed_over: 0, size: None }
    }

    /// Refuses all further frames of another width and height than these.
    pub fn require_size(&mut self, size: [usize; 2]) {
        self.size = Some(size);
    }

    /// Reads the next message. Returns `None` if the stream ends before it. The error says why the stream is lost: no
    /// further message can be read.
    pub fn read_message(&mut self) -> Result<Option<StreamMessage>, String> {
        let mut known = None;
        if self.has_poses {
            let Some(read) = self.read_array(ArrayPlace::Pose)? else { return Ok(None) };
            if read.as_ref().is_ok_and(|shape| *shape == [0]) {
                return Ok(Some(StreamMessage::Reset));
            }
            known = Some(read.and_then(|_| parse_pose(&self.bytes)));
        }
        let Some(read) = self.read_array(ArrayPlace::Frame)? else {
            return if known.is_none() { Ok(None) } else { Err(String::from("the input ends after its pose")) };
        };
        let depth = read.and_then(|_| read::decode_frame(&self.bytes));
        let frame = known.transpose().and_then(|known| Ok(StreamFrame { known, depth: depth? }));
        Ok(Some(StreamMessage::Frame(frame.map_err(Diagnostic::new))))
    }

    /// Reads the next array into `bytes` and returns its shape, or says what is wrong with it. Returns `None` if there
    /// is none. The outer error says why the stream is lost.
    fn read_array(&mut self, place: ArrayPlace) -> Result<Option<Result<Vec<usize>, String>>, String> {
        /// Bytes before the length of the header.
        const START: usize = 8;
        let passed = io::copy(&mut self.input.by_ref().take(self.passed_over), &mut io::sink());
        if passed.map_err(|error| error.to_string())? < self.passed_over {
            return Err(String::from("the input ends within the array before it"));
        }
        self.passed_over = 0;
        self.bytes.clear();
        if !self.read_more(START)? {
            return Ok(None);
        }
        let length = match self.bytes.as_slice() {
            [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _] => 2,
            [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _] => 4,
            _ => return Err(String::from("no npy file begins where it should")),
        };
        self.read_rest(length)?;
        // Little endian: the last byte is the highest.
        let header = self.bytes[START..].iter().rev().fold(0, |length: usize, byte| length << 8 | usize::from(*byte));
        if header > MAX_HEADER {
            return Err(format!("its header claims {header} bytes"));
        }
        self.read_rest(header)?;
        // The shape is checked before memory is taken for the data.
        let checked = npy::read_announced_shape(&self.bytes).and_then(|(shape, data)| {
            self.check_shape(place, &shape)?;
            Ok((shape, data))
        });
        match checked {
            Ok((shape, data)) => {
                self.read_rest(data)?;
                Ok(Some(Ok(shape)))
            }
            Err(reason) => {
                let data = npy::read_announced_bytes(&self.bytes).filter(|data| *data <= MAX_IMAGE_BYTES);
                self.passed_over = data.ok_or_else(|| reason.clone())?;
                if self.has_poses && self.is_misplaced(place) {
                    return Err(format!("a pose stands before each frame, and their order is lost: {reason}"));
                }
                Ok(Some(Err(reason)))
            }
        }
    }

    /// Checks that an array of this shape can stand at this place.
    fn check_shape(&self, place: ArrayPlace, shape: &[usize]) -> Result<(), String> {
        match place {
            ArrayPlace::Frame => {
                let size = read::frame_size(shape)?;
                let words = |[width, height]: [usize; 2]| format!("{width}x{height}");
                match self.size.filter(|first| *first != size) {
                    Some(first) => Err(format!("it has {} px, and those before it have {}", words(size), words(first))),
                    None => Ok(()),
                }
            }
            ArrayPlace::Pose if *shape == [7] || *shape == [0] => Ok(()),
            ArrayPlace::Pose => Err(format!("its pose has the shape {shape:?}, not (7,): {POSE}")),
        }
    }

    /// Returns true if the array that was refused belongs to the other place.
    fn is_misplaced(&self, place: ArrayPlace) -> bool {
        let Ok((shape, _)) = npy::read_announced_shape(&self.bytes) else { return false };
        match place {
            ArrayPlace::Frame => shape == [7] || shape == [0],
            ArrayPlace::Pose => shape.iter().product::<usize>() > MAX_POSE,
        }
    }

    /// Appends `count` bytes of an array that has begun.
    fn read_rest(&mut self, count: usize) -> Result<(), String> {
        match self.read_more(count)? || count == 0 {
            true => Ok(()),
            false => Err(format!("the input ends within it, after {} bytes", self.bytes.len())),
        }
    }

    /// Appends `count` bytes. Returns false if the input has ended before the first of them.
    fn read_more(&mut self, count: usize) -> Result<bool, String> {
        let before = self.bytes.len();
        let read = self.input.by_ref().take(count as u64).read_to_end(&mut self.bytes);
        match read.map_err(|error| error.to_string())? {
            read if read == count => Ok(count > 0),
            0 => Ok(false),
            read => Err(format!("the input ends within it, after {} bytes", before + read)),
        }
    }
}

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
