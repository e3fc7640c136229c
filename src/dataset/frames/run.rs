//! Renders files of depth frames: first all are read and checked, then each becomes a tactile image, layers and a label.
//!
//! A frame's files are written under other names and renamed. What an earlier run wrote of the same frames is replaced,
//! layers that this one does not write included; files that only have such names, without a label, stay.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;

use super::camera::DepthCamera;
use super::check::Reach;
use super::poses::FrameMetadata;
use super::read;
use super::reader::{FrameReader, SeenFrame};
use super::sequence::{self, Followed, Follower};
use super::source::Source;
use crate::archive::Member;
use crate::encode::{json, layers, members};
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input;
use gelsim_files::write::{absent_is_fine, sweep, sync_all_in, write_one_of_many};
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::label::Label;
use gelsim_job::layers::{DepthFormat, OutputLayer};
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::press;
use gelsim_job::scene::{Frame, KnownPress, Pressed, Scene};
use gelsim_job::sequence::label::{FrameRow, SequenceInfo, SequenceLabel};

/// What to render and where.
pub struct Request<'a> {
    /// The frames; their places are their samples' numbers.
    pub sources: &'a [Source],
    /// What saw them.
    pub camera: DepthCamera,
    /// The same in the place that the plan's sensor gives it.
    pub reader: FrameReader,
    /// What is known of each, if anything is.
    pub known: Option<Vec<FrameMetadata>>,
    /// Folder of the results.
    pub out: &'a Path,
    /// The frames follow each other, in their order.
    pub sequence: Option<InSequence>,
    /// No frame need reach the pad.
    pub no_contact_ok: bool,
}

/// How frames follow each other.
#[derive(Clone, Copy, Debug)]
pub struct InSequence {
    /// What holds the pad to the object.
    pub friction: Friction,
    /// Frames a second.
    pub frame_rate_hz: f64,
}

/// Why rendering ended early. What was written before stays.
#[derive(Debug)]
pub enum RenderError {
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// A file is no more what it was when it was checked.
    Changed(PathBuf, String),
    /// A frame's sample is not sound, and the job wants no such sample: its file, and why.
    Unhealthy(PathBuf, String),
}

/// Reads every frame. On failure, all mistakes in them.
pub fn check(plan: &Plan, request: &Request) -> Result<Vec<Reach>, Report> {
    let Request { sources, camera, reader, out, .. } = request;
    let found: Vec<Result<Reach, Diagnostic>> = sources
        .par_iter()
        .map(|source| {
            let reach = seen(reader, &source.path)?.reach();
            reach.mistake(camera).map_or(Ok(reach), Err)
        })
        .collect();
    let mut problems = Diagnostics::default();
    for known in request.known.iter().flatten() {
        if !known.class.is_empty() && plan.class_index(&known.class).is_none() {
            let problem =
                Diagnostic::new(format!("the plan knows no class `{}`, which is that of `{}`", known.class, known.id));
            problems.push(problem.help("make the plan with the classes of all frames"));
        }
    }
    if request.sequence.is_some() {
        let known = request.known.as_deref().unwrap_or_default();
        for ((pair, source), found) in known.windows(2).zip(sources.iter().skip(1)).zip(found.iter().skip(1)) {
            let normal = found.as_ref().map_or(DVec3::Z, |reach| reach.normal);
            if let Some(problem) = sequence::mistake(pair[0].pose, pair[1].pose, normal) {
                problems.push(of_frame(source, problem));
            }
        }
        if known.len() > 1 && known.windows(2).all(|pair| pair[0].pose == pair[1].pose) {
            let problem = Diagnostic::new("the object's pose is the same in every frame: nothing moves");
            problems.push(problem.help("give each frame its quaternion and position in the table of --poses"));
        }
    }
    let mut reaches = Vec::new();
    for (source, found) in sources.iter().zip(found) {
        match found {
            Ok(reach) => reaches.push(reach),
            Err(problem) => {
                problems.push(of_frame(source, problem));
            }
        }
        let mut ours = suffixes(plan).into_iter().map(|suffix| out.join(format!("{}.{suffix}", source.stem)));
        if ours.any(|path| is_same_file(&path, &source.path)) {
            let problem = Diagnostic::new(format!("{} would be written over", source.path.display()));
            problems.push(problem.help("choose another folder with --out"));
        }
    }
    let nearest = reaches.iter().min_by(|a, b| a.lowest_mm.total_cmp(&b.lowest_mm));
    if let Some(nearest) =
        nearest.filter(|nearest| !nearest.is_pressed() && !request.no_contact_ok && problems.is_empty())
    {
        problems.push(nearest.out_of_reach(camera));
    }
    if problems.is_empty() { Ok(reaches) } else { Err(Report::new(&problems, &[])) }
}

/// What is wrong with a frame, with its name; the same of several is one message.
fn of_frame(source: &Source, problem: Diagnostic) -> Diagnostic {
    let path = source.path.display().to_string();
    let cause = format!("frames: {}", problem.message);
    Diagnostic { message: format!("{path}: {}", problem.message), ..problem }.of(path, cause)
}

/// Renders and writes every frame, on the threads of the pool that this is called in.
pub fn run(plan: &Plan, request: &Request) -> Result<(), RenderError> {
    let out = request.out;
    let failed = |error| RenderError::Io(out.to_owned(), error);
    fs::create_dir_all(out).map_err(failed)?;
    let stems: HashSet<&str> = request.sources.iter().map(|source| source.stem.as_str()).collect();
    let suffixes = suffixes(plan);
    let is_ours = |name: &str| {
        let stem = |suffix: &String| name.strip_suffix(suffix.as_str())?.strip_suffix('.');
        suffixes.iter().filter_map(stem).any(|stem| stems.contains(stem))
    };
    sweep(out, is_ours).map_err(failed)?;
    if let Some(sequence) = request.sequence {
        follow(plan, request, sequence)?;
        return File::open(out).and_then(|folder| sync_all_in(&folder)).map_err(failed);
    }
    let one = |(index, source): (usize, &Source)| {
        let changed = |problem: Diagnostic| RenderError::Changed(source.path.clone(), problem.message);
        let seen = seen(&request.reader, &source.path).map_err(changed)?;
        let known = request.known.as_ref().map(|known| &known[index]);
        let sample = sample(plan, index as u64, &source.stem, seen, known);
        let health = &sample.label.health;
        if !health.healthy && plan.output().on_unhealthy != OnUnhealthy::Keep {
            return Err(RenderError::Unhealthy(source.path.clone(), health.reason.clone()));
        }
        write(out, source, &members(plan, &sample))
    };
    request.sources.par_iter().enumerate().try_for_each(one)?;
    File::open(out).and_then(|folder| sync_all_in(&folder)).map_err(failed)
}

/// Renders frames that follow each other; their labels are written last, because they say what the whole sequence does.
fn follow(plan: &Plan, request: &Request, sequence: InSequence) -> Result<(), RenderError> {
    let InSequence { friction, frame_rate_hz } = sequence;
    let mut follower = Follower::new(plan, friction, frame_rate_hz).expect("the plan was made for a sequence");
    let mut first: Option<Label> = None;
    let mut frames = Vec::new();
    for (index, source) in request.sources.iter().enumerate() {
        let changed = |problem: Diagnostic| RenderError::Changed(source.path.clone(), problem.message);
        let seen = seen(&request.reader, &source.path).map_err(changed)?;
        let nothing = || FrameMetadata::nothing(&source.stem);
        let known = request.known.as_ref().map_or_else(nothing, |known| known[index].clone());
        let unsound = |reason: String| RenderError::Unhealthy(source.path.clone(), reason);
        let next = follower.next(plan, index as u64, seen, known);
        let Followed { sample, label } = next.map_err(|problem| {
            unsound(problem.help.map_or_else(|| problem.message.clone(), |help| format!("{}; {help}", problem.message)))
        })?;
        if !label.health.healthy && plan.output().on_unhealthy != OnUnhealthy::Keep {
            return Err(unsound(label.health.reason.clone()));
        }
        write(request.out, source, &layers(plan, &sample))?;
        first.get_or_insert(sample.label);
        frames.push(label);
    }
    let Some(first) = first else { return Ok(()) };
    let friction_coefficient = friction.coefficient();
    let info =
        SequenceInfo { frame_rate_hz, frames: frames.len() as u32, friction_coefficient, ..SequenceInfo::default() };
    for (row, source) in SequenceLabel::new(&first, info, frames).rows().zip(request.sources) {
        let path = request.out.join(format!("{}.json", source.stem));
        write_one_of_many(&path, &json(&row)).map_err(|error| RenderError::Io(path, error))?;
    }
    Ok(())
}

/// Reads a frame and takes it to what is pressed in.
fn seen<'a>(reader: &'a FrameReader, path: &Path) -> Result<SeenFrame<'a>, Diagnostic> {
    let frame = read::file(path).map_err(|reason| {
        Diagnostic::new(reason)
            .help("a frame is an npy array, an EXR picture or a grey PNG of 16 bits, up to 8192 px on a side")
    })?;
    reader.read(frame)
}

/// The sample of a frame called `name`.
pub fn sample(plan: &Plan, index: u64, name: &str, seen: SeenFrame<'_>, known: Option<&FrameMetadata>) -> Sample {
    let nothing = FrameMetadata::nothing(name);
    let FrameMetadata { id, class, pose, motion } = known.unwrap_or(&nothing).clone();
    let indentation_depth_mm = seen.depth_mm();
    let pressed = Pressed::Frame(Frame { id, class, shape: seen.pressed(&pose) });
    let given = KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm };
    let mut scene = Scene::given(plan, index, 0, given);
    if known.is_some() {
        scene.motion = motion;
    }
    press(plan, &scene)
}

/// Ends of the names of a frame's files.
fn suffixes(plan: &Plan) -> Vec<String> {
    let format = plan.output().depth_format;
    let layers = plan.layers().into_iter().map(|layer| layer.suffix(format));
    [String::from("tactile.png"), String::from("json")].into_iter().chain(layers).collect()
}

fn write(out: &Path, source: &Source, members: &[Member]) -> Result<(), RenderError> {
    let path = |suffix: &str| out.join(format!("{}.{suffix}", source.stem));
    let stale = DepthFormat::ALL.into_iter().flat_map(|format| OutputLayer::ALL.map(|layer| layer.suffix(format)));
    let label = input::read_if_there(&path("json"), input::MOST_METADATA_BYTES);
    let label = label.map_err(|error| RenderError::Io(path("json"), error))?;
    let is_ours = label.is_some_and(|label| {
        serde_json::from_slice::<Label>(&label).is_ok() || serde_json::from_slice::<FrameRow>(&label).is_ok()
    });
    for suffix in stale.filter(|suffix| is_ours && members.iter().all(|member| member.suffix != *suffix)) {
        let path = path(&suffix);
        if is_same_file(&path, &source.path) {
            continue;
        }
        absent_is_fine(fs::remove_file(&path)).map_err(|error| RenderError::Io(path, error))?;
    }
    for member in members {
        let path = path(&member.suffix);
        let written = member.bytes.read().and_then(|bytes| write_one_of_many(&path, &bytes));
        written.map_err(|error| RenderError::Io(path, error))?;
    }
    Ok(())
}

/// True if both are there and are one file.
fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
