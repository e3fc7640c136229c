//! `gelsim render --stream`: answers each frame of a pipe before the next is read.

use std::io::{self, BufWriter};

use clap::ValueEnum;

use super::{Render, format_frame_count};
use crate::{Failure, Log, print_to_stderr};
use gelsim_dataset::frames::camera::DepthCamera;
use gelsim_dataset::frames::stream::{AnswerForm, StreamError, StreamSettings, render_stream};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};

/// Help for a frame of a stream that cannot be read.
const BROKEN_FRAME: &str = "each frame is an npy file as numpy.save writes it, (H, W) of float32, float64 or uint16; images of those before \
                            it were written";

/// What becomes of a frame that cannot be rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum OnBrokenFrame {
    /// The command ends with status 1
    #[default]
    End,
    /// It is answered by the reason, and changes nothing else; needs --labels or --layers
    Skip,
}

impl Render {
    pub(super) fn render_stream(self, camera: DepthCamera, mut problems: Diagnostics) -> Result<(), Failure> {
        let answers = match (self.labels || !self.layers.is_empty(), self.on_broken_frame) {
            (false, OnBrokenFrame::End) => AnswerForm::Npy,
            (true, on_broken) => {
                AnswerForm::Parts { with_label: self.labels, skips_broken: on_broken == OnBrokenFrame::Skip }
            }
            (false, OnBrokenFrame::Skip) => {
                let help = "add --labels or --layers: a stream of npy images cannot say that there is none";
                problems.push(Diagnostic::new("--on-broken-frame skip needs answers of named parts").help(help));
                AnswerForm::Npy
            }
        };
        if !problems.is_empty() {
            return Err(Report::new(&problems, &[]).into());
        }
        // A plan for a small view finds mistakes before anything is read. The first frame brings the size for which the
        // plan is made again, unless the options say it.
        const SMALL: [usize; 2] = [64, 48];
        let plan =
            if self.is_perspective() { self.plan_for_frames(None, &[])? } else { self.plan_for_view(SMALL, &[])? };
        let is_known = plan.simulator.view().resolution_px != SMALL;
        let for_size = |size: [usize; 2]| {
            if is_known && (self.is_perspective() || plan.simulator.view().resolution_px == size) {
                Ok(plan.clone())
            } else {
                self.plan_for_frames(Some(size), &[])
            }
        };
        let settings = StreamSettings { camera: &camera, sequence: self.sequence_options(), answers };
        let (input, output) = (io::stdin().lock(), BufWriter::new(io::stdout().lock()));
        let log = Log::plain_text(self.quiet);
        let broken = |message: String, problem: Diagnostic| {
            Err(Failure::runtime_with_help(message, problem.help.unwrap_or_else(|| String::from(BROKEN_FRAME))))
        };
        match render_stream(input, output, &settings, for_size, |notes| log.print_notes(&notes)) {
            Ok(count) => {
                if !self.quiet {
                    print_to_stderr(&format_frame_count(count as usize));
                }
                Ok(())
            }
            Err(StreamError::OutputClosed) => Ok(()),
            Err(StreamError::Plan(report)) => Err(report.into()),
            Err(StreamError::Io(error)) => Err(Failure::runtime(format!("standard output: {error}"))),
            Err(StreamError::Frame(number, problem)) => broken(format!("frame {number}: {}", problem.message), problem),
            Err(StreamError::AllSkipped(count, problem)) => {
                let message = format!("{} and none to render: {}", format_frame_count(count as usize), problem.message);
                broken(message, problem)
            }
        }
    }
}
