//! Renders depth frames from a pipe and writes what they show to another, for the control loop of a simulator.
//!
//! Frames come as npy files one after another, each with its header ([`input`]). They are answered by tactile images in
//! the same form, or by named parts ([`answer`]); docs/how-to/streams.md describes the other side. An answer is written
//! and flushed before the next frame is read, and nothing is kept.

use std::io::{self, ErrorKind, Read, Write};

use super::camera::DepthCamera;
use super::check::FrameReach;
use super::reader::FrameReader;
use super::run::{self, SequenceSettings};
use super::sequence::{SequenceFollower, SequenceFrame};
use crate::encode::to_json_line;
use answer::AnswerNumber;
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_files::npy;
use gelsim_job::layers::OutputLayer;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sequence::label::{FrameLabel, StepLabel};
use input::{StreamFrame, StreamInput, StreamMessage};

pub mod answer;
pub mod input;

/// How a stream is read and answered.
#[derive(Clone, Copy)]
pub struct StreamSettings<'a> {
    /// The camera that takes the frames.
    pub camera: &'a DepthCamera,
    /// Set if the frames follow each other in time; then a pose stands before each of them.
    pub sequence: Option<SequenceSettings>,
    /// Form of the answers.
    pub answers: AnswerForm,
}

/// Form of the answers of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnswerForm {
    /// The tactile image as an npy file. A frame that cannot be rendered ends the stream.
    Npy,
    /// The tactile image and the plan's layers as named parts.
    Parts {
        /// Whether the label is one of them.
        with_label: bool,
        /// Whether a frame that cannot be rendered is answered by what is wrong with it, and all others are what they
        /// are without it. Else it ends the stream.
        skips_broken: bool,
    },
}

/// Why a stream ended early.
#[derive(Debug)]
pub enum StreamError {
    /// A frame, counted from 0, cannot be read or cannot be right.
    Frame(u64, Diagnostic),
    /// No plan can be made for the first frame's size.
    Plan(Report),
    /// All frames were skipped: their number, and what is wrong with the first.
    AllSkipped(u64, Diagnostic),
    /// The reader of the answers has closed the pipe.
    OutputClosed,
    /// Reading or writing failed.
    Io(io::Error),
}

/// Renders each frame of `input` to `output` until the input ends between two frames, and returns their number. `plan`
/// is called with the size of the frames until one of them was rendered; `note` receives what a user should know of the
/// plan and of the frames.
pub fn render_stream(
    input: impl Read,
    mut output: impl Write,
    settings: &StreamSettings<'_>,
    plan: impl FnMut([usize; 2]) -> Result<Plan, Report>,
    note: impl FnMut(Report),
) -> Result<u64, StreamError> {
    let mut input = StreamInput::new(input, settings.sequence.is_some());
    let mut renderer = StreamRenderer {
        settings,
        make_plan: plan,
        note,
        ready: None,
        follower: None,
        next_index: 0,
        has_pressed: false,
        is_suspected: false,
    };
    let mut skipped = SkippedFrames::default();
    let ended = answer_frames(&mut input, &mut output, &mut renderer, &mut skipped);
    let StreamRenderer { mut note, has_pressed, is_suspected, .. } = renderer;
    let count = *ended.as_ref().unwrap_or(&0);
    if let Some(summary) = skipped.summarize() {
        note(summary.into());
    }
    match skipped.first {
        Some(first) if skipped.count == count => return Err(StreamError::AllSkipped(count, first)),
        _ => {}
    }
    if count > 0 && !has_pressed && !is_suspected {
        let message = format!("nothing reaches the pad in any of {count} frames");
        let help = "if it should, are --depth-unit and --plane-mm right?";
        note(Diagnostic::warning(message).help(help).into());
    }
    ended
}

/// Answers each frame of `input`, and returns their number.
fn answer_frames<P, N>(
    input: &mut StreamInput<impl Read>,
    output: &mut impl Write,
    renderer: &mut StreamRenderer<'_, P, N>,
    skipped: &mut SkippedFrames,
) -> Result<u64, StreamError>
where
    P: FnMut([usize; 2]) -> Result<Plan, Report>,
    N: FnMut(Report),
{
    let answers = renderer.settings.answers;
    let mut number = AnswerNumber { frame: 0, sequence: 0 };
    loop {
        let lost = |reason| StreamError::Frame(number.frame, Diagnostic::new(reason));
        let message = match input.read_message().map_err(lost)? {
            None => return Ok(number.frame),
            Some(StreamMessage::Reset) => {
                number.sequence = number.sequence.wrapping_add(1);
                renderer.begin_sequence();
                continue;
            }
            Some(StreamMessage::Frame(message)) => message,
        };
        let rendered = message
            .map_err(|problem| StreamError::Frame(number.frame, problem))
            .and_then(|frame| renderer.render_frame(number.frame, frame));
        let written = match (rendered, answers) {
            (Ok((sample, _)), AnswerForm::Npy) => {
                let image = &sample.impression.image;
                output.write_all(&npy::encode_rgb(image.width, image.height, &image.rgb))
            }
            (Ok((sample, frame)), AnswerForm::Parts { with_label, .. }) => {
                let label = with_label.then(|| match frame {
                    None => to_json_line(&sample.label),
                    Some(frame) => to_json_line(&StepLabel::new(sample.label.clone(), &frame)),
                });
                answer::write_rendered(output, number, &sample, &renderer.layers(), label)
            }
            (Err(error), AnswerForm::Parts { skips_broken: true, .. }) => {
                let problem = error.into_problem()?;
                if let Some(told) = skipped.add(number.frame, &problem) {
                    (renderer.note)(told.into());
                }
                answer::write_skipped(output, number, &problem)
            }
            (Err(error), _) => return Err(error),
        };
        written.and_then(|()| output.flush()).map_err(|error| match error.kind() {
            ErrorKind::BrokenPipe => StreamError::OutputClosed,
            _ => StreamError::Io(error),
        })?;
        if let Some(ReadyStream { size, .. }) = renderer.ready {
            input.require_size(size);
        }
        number.frame += 1;
    }
}

impl StreamError {
    /// Returns what is wrong with the frame, if the frame is all that is wrong; else the error.
    fn into_problem(self) -> Result<Diagnostic, Self> {
        match self {
            Self::Frame(_, problem) => Ok(problem),
            Self::Plan(report) => report.problems().first().cloned().ok_or(Self::Plan(report)),
            other => Err(other),
        }
    }
}

/// Renders the frames of a stream.
struct StreamRenderer<'a, P, N> {
    settings: &'a StreamSettings<'a>,
    make_plan: P,
    note: N,
    /// What the first frame decides that can be rendered.
    ready: Option<ReadyStream>,
    follower: Option<SequenceFollower>,
    /// Number of the next sample, in its sequence if there are sequences.
    next_index: u64,
    /// Whether a frame has pressed the pad.
    has_pressed: bool,
    /// Whether a suspicion was told.
    is_suspected: bool,
}

struct ReadyStream {
    size: [usize; 2],
    plan: Plan,
    reader: FrameReader,
}

impl<P: FnMut([usize; 2]) -> Result<Plan, Report>, N: FnMut(Report)> StreamRenderer<'_, P, N> {
    /// Begins another sequence, as if the stream began here.
    fn begin_sequence(&mut self) {
        (self.follower, self.next_index) = (None, 0);
    }

    /// Returns the layers of the plan.
    fn layers(&self) -> Vec<OutputLayer> {
        self.ready.as_ref().map_or_else(Vec::new, |ready| ready.plan.layers())
    }

    /// Renders a frame; one of a sequence comes with its label. A frame that is refused changes nothing.
    fn render_frame(&mut self, number: u64, frame: StreamFrame) -> Result<(Sample, Option<FrameLabel>), StreamError> {
        let is_first = self.ready.is_none();
        let wrong = |problem| StreamError::Frame(number, problem);
        if is_first {
            let size = [frame.depth.width, frame.depth.height];
            let plan = (self.make_plan)(size).map_err(StreamError::Plan)?;
            let reader = FrameReader::new(*self.settings.camera, &plan.simulator, size).map_err(wrong)?;
            self.ready = Some(ReadyStream { size, plan, reader });
        }
        match (self.press_frame(frame), &self.ready) {
            (Ok((reach, sample, label)), Some(ready)) => {
                if is_first {
                    (self.note)(ready.plan.notes.clone());
                }
                self.next_index += 1;
                self.look_for_contact(number, &reach);
                Ok((sample, label))
            }
            (Err(problem), _) => {
                self.ready = self.ready.take().filter(|_| !is_first);
                Err(wrong(problem))
            }
            (Ok(_), None) => unreachable!("it was pressed with what is ready"),
        }
    }

    fn press_frame(
        &mut self,
        StreamFrame { known, depth }: StreamFrame,
    ) -> Result<(FrameReach, Sample, Option<FrameLabel>), Diagnostic> {
        let StreamSettings { camera, sequence, .. } = *self.settings;
        let ReadyStream { plan, reader, .. } = self.ready.as_ref().expect("the first frame made it");
        let seen = reader.read(depth)?;
        let reach = seen.reach();
        if let Some(problem) = reach.find_error(camera) {
            return Err(problem);
        }
        let (Some(known), Some(SequenceSettings { friction, frame_rate_hz })) = (known, sequence) else {
            return Ok((reach, run::render_frame_sample(plan, self.next_index, "frame", seen, None), None));
        };
        let begun = || SequenceFollower::new(plan, friction, frame_rate_hz).expect("the plan was made for a sequence");
        let follower = self.follower.get_or_insert_with(begun);
        let SequenceFrame { sample, label } = follower.render_next(plan, self.next_index, seen, known)?;
        Ok((reach, sample, Some(label)))
    }

    /// Tells once if frames that press nothing would press with other units.
    fn look_for_contact(&mut self, number: u64, reach: &FrameReach) {
        self.has_pressed |= reach.is_pressed();
        if !self.has_pressed
            && !self.is_suspected
            && let Some(suspicion) = reach.find_suspicion(self.settings.camera)
        {
            self.is_suspected = true;
            let message = format!("frame {number}: {}", suspicion.message);
            (self.note)(Diagnostic { message, ..suspicion }.into());
        }
    }
}

/// Counts skipped frames by their cause, so that each cause is told once.
#[derive(Default)]
struct SkippedFrames {
    count: u64,
    /// What is wrong with the first.
    first: Option<Diagnostic>,
    causes: Vec<SkipCause>,
}

struct SkipCause {
    /// The message without its numbers.
    words: String,
    /// Number of the first frame.
    first: u64,
    count: u64,
}

impl SkippedFrames {
    /// Most causes that are told; a stream of nonsense may have as many as it has frames.
    const MAX_CAUSES: usize = 20;

    /// Counts a frame. Returns what is to be told if its cause is new.
    fn add(&mut self, number: u64, problem: &Diagnostic) -> Option<Diagnostic> {
        self.count += 1;
        self.first.get_or_insert_with(|| problem.clone());
        let words = problem.message.chars().filter(|letter| !letter.is_ascii_digit()).collect();
        if let Some(known) = self.causes.iter_mut().find(|known| known.words == words) {
            known.count += 1;
            return None;
        }
        if self.causes.len() == Self::MAX_CAUSES {
            return None;
        }
        self.causes.push(SkipCause { words, first: number, count: 1 });
        let message = format!("frame {number} is skipped: {}", problem.message);
        Some(Diagnostic { help: problem.help.clone(), ..Diagnostic::warning(message) })
    }

    /// Returns how many frames were skipped for which cause; `None` if there are none.
    fn summarize(&self) -> Option<Diagnostic> {
        let cause = |cause: &SkipCause| format!("{} like frame {}", cause.count, cause.first);
        let causes: Vec<String> = self.causes.iter().map(cause).collect();
        let others = self.count - self.causes.iter().map(|cause| cause.count).sum::<u64>();
        let others = if others == 0 { String::new() } else { format!(", {others} for other causes") };
        let message = format!("skipped frames: {} ({}{others})", self.count, causes.join(", "));
        (self.count > 1).then(|| Diagnostic::warning(message))
    }
}
