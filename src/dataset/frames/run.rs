//! Renders files of depth frames: all frames are read and checked first, then each becomes a tactile image, layers and
//! a label, in a folder or in a log.
//!
//! The files of a frame are written under other names and renamed. What an earlier run wrote for the same frames is
//! replaced, also layers that this run does not write. Files that have such names but no label beside them stay.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;

use super::camera::DepthCamera;
use super::check::FrameReach;
use super::poses::FrameMetadata;
use super::reader::{FrameReader, SeenFrame};
use super::sequence::{self, SequenceFollower, SequenceFrame};
use super::source::FrameSource;
use super::tactile_log::{self, FrameTime, TactileLog};
use crate::archive::Member;
use crate::encode::{encode_layers, encode_members, to_json_line};
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input;
use gelsim_files::write::{ignore_not_found, remove_abandoned_partials, sync_all_in, write_without_sync};
use gelsim_job::config::output::OnUnhealthy;
use gelsim_job::label::Label;
use gelsim_job::layers::{DepthFormat, OutputLayer};
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::press;
use gelsim_job::scene::{DepthFrame, KnownPress, PressSource, Scene};
use gelsim_job::sequence::label::{FrameRow, SequenceInfo, SequenceLabel};

/// What to render, and where.
pub struct FrameRequest<'a> {
    /// The frames. Their positions are the numbers of their samples.
    pub sources: &'a [FrameSource],
    /// The camera that took them.
    pub camera: DepthCamera,
    /// The reader of that camera's frames for the plan's sensor.
    pub reader: FrameReader,
    /// What is known of each frame's object, if there is a table.
    pub metadata: Option<Vec<FrameMetadata>>,
    /// The folder for the results, or the log: a file that ends in .mcap.
    pub out: &'a Path,
    /// Frames per second of files, which have no times of their own.
    pub frame_rate_hz: f64,
    /// Set if the frames follow each other in time, in their order.
    pub sequence: Option<SequenceSettings>,
    /// Whether it is allowed that no frame reaches the pad.
    pub no_contact_ok: bool,
}

/// How frames follow each other.
#[derive(Clone, Copy, Debug)]
pub struct SequenceSettings {
    /// Friction between the pad and the object.
    pub friction: Friction,
    /// Frames per second.
    pub frame_rate_hz: f64,
}

/// Why rendering ended early. Files that are written stay.
#[derive(Debug)]
pub enum RenderError {
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// A file has changed since it was checked. Holds what is wrong with it.
    Changed(PathBuf, String),
    /// A frame's sample is not healthy, and the job allows no such sample: the frame's file, and the reason.
    Unhealthy(PathBuf, String),
}

/// Reads and checks every frame. The error reports all that is wrong with them.
pub fn check_frames(plan: &Plan, request: &FrameRequest) -> Result<Vec<FrameReach>, Report> {
    let FrameRequest { sources, camera, reader, out, .. } = request;
    let found: Vec<Result<FrameReach, Diagnostic>> = sources
        .par_iter()
        .map(|source| {
            let reach = read_seen_frame(reader, source)?.reach();
            reach.find_error(camera).map_or(Ok(reach), Err)
        })
        .collect();
    let mut problems = Diagnostics::default();
    for known in request.metadata.iter().flatten() {
        if !known.class.is_empty() && plan.class_index(&known.class).is_none() {
            let problem =
                Diagnostic::new(format!("the plan knows no class `{}`, which is that of `{}`", known.class, known.id));
            problems.push(problem.help("make the plan with the classes of all frames"));
        }
    }
    if request.sequence.is_some() {
        let known = request.metadata.as_deref().unwrap_or_default();
        let mut last = None;
        for ((known, source), found) in known.iter().zip(sources.iter()).zip(&found) {
            let normal = found.as_ref().map_or(DVec3::Z, |reach| reach.normal);
            if let Some(problem) = sequence::find_motion_error(last.replace(known.pose), known.pose, normal) {
                problems.push(name_frame(source, problem));
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
                problems.push(name_frame(source, problem));
            }
        }
        // A log is no file of a frame.
        let suffixes = if tactile_log::is_log_name(out) { Vec::new() } else { file_suffixes(plan) };
        let mut ours = suffixes.into_iter().map(|suffix| out.join(format!("{}.{suffix}", source.stem)));
        if ours.any(|path| input::is_same_path(&path, &source.path)) {
            let problem = Diagnostic::new(format!("{} would be written over", source.path.display()));
            problems.push(problem.help("choose another folder with --out"));
        }
    }
    let nearest = reaches.iter().min_by(|a, b| a.lowest_mm.total_cmp(&b.lowest_mm));
    if let Some(nearest) =
        nearest.filter(|nearest| !nearest.is_pressed() && !request.no_contact_ok && problems.is_empty())
    {
        problems.push(nearest.explain_out_of_reach(camera));
    }
    if problems.is_empty() { Ok(reaches) } else { Err(Report::new(&problems, &[])) }
}

/// Adds the frame's name to a problem, so that the same problem of several frames becomes one message.
fn name_frame(source: &FrameSource, problem: Diagnostic) -> Diagnostic {
    let path = source.path.display().to_string();
    let cause = format!("frames: {}", problem.message);
    Diagnostic { message: format!("{path}: {}", problem.message), ..problem }.about(path, cause)
}

/// Renders and writes every frame, on the threads of the current pool.
pub fn render_frames(plan: &Plan, request: &FrameRequest) -> Result<(), RenderError> {
    let out = request.out;
    let failed = |error| RenderError::Io(out.to_owned(), error);
    if tactile_log::is_log_name(out) {
        fs::create_dir_all(out.parent().unwrap_or(Path::new(""))).map_err(failed)?;
        let mut log = TactileLog::create(out).map_err(failed)?;
        match request.sequence {
            Some(sequence) => render_sequence(plan, request, sequence, &mut Some(&mut log))?,
            None => render_to_log(plan, request, &mut log)?,
        }
        return log.complete().map_err(failed);
    }
    fs::create_dir_all(out).map_err(failed)?;
    let stems: HashSet<&str> = request.sources.iter().map(|source| source.stem.as_str()).collect();
    let suffixes = file_suffixes(plan);
    let is_ours = |name: &str| {
        let stem = |suffix: &String| name.strip_suffix(suffix.as_str())?.strip_suffix('.');
        suffixes.iter().filter_map(stem).any(|stem| stems.contains(stem))
    };
    remove_abandoned_partials(out, is_ours).map_err(failed)?;
    if let Some(sequence) = request.sequence {
        render_sequence(plan, request, sequence, &mut None)?;
        return File::open(out).and_then(|folder| sync_all_in(&folder)).map_err(failed);
    }
    let one = |(index, source): (usize, &FrameSource)| {
        let sample = render_single(plan, request, index)?;
        write_frame_files(out, source, &encode_members(plan, &sample))
    };
    request.sources.par_iter().enumerate().try_for_each(one)?;
    File::open(out).and_then(|folder| sync_all_in(&folder)).map_err(failed)
}

/// Renders a frame that is by itself.
fn render_single(plan: &Plan, request: &FrameRequest, index: usize) -> Result<Sample, RenderError> {
    let source = &request.sources[index];
    let changed = |problem: Diagnostic| RenderError::Changed(source.path.clone(), problem.message);
    let seen = read_seen_frame(&request.reader, source).map_err(changed)?;
    let known = request.metadata.as_ref().map(|known| &known[index]);
    let sample = render_frame_sample(plan, index as u64, &source.stem, seen, known);
    let health = &sample.label.health;
    match health.healthy || plan.output().on_unhealthy == OnUnhealthy::Keep {
        true => Ok(sample),
        false => Err(RenderError::Unhealthy(source.path.clone(), health.reason.clone())),
    }
}

/// Renders frames that are each by themselves to a log, in their order.
fn render_to_log(plan: &Plan, request: &FrameRequest, log: &mut TactileLog) -> Result<(), RenderError> {
    // As many as are in memory at once.
    let at_once = 2 * rayon::current_num_threads();
    let indices: Vec<usize> = (0..request.sources.len()).collect();
    for batch in indices.chunks(at_once) {
        let render = |index: &usize| {
            let sample = render_single(plan, request, *index)?;
            let label = to_json_line(&sample.label);
            Ok((*index, tactile_log::encode_sample(plan, &sample, find_time(request, *index), Some(&label))))
        };
        let made: Vec<Result<_, RenderError>> = batch.par_iter().map(render).collect();
        for made in made {
            let (index, messages) = made?;
            let written = log.write(find_time(request, index), &messages);
            written.map_err(|error| RenderError::Io(request.out.to_owned(), error))?;
        }
    }
    Ok(())
}

/// Returns when a frame was taken and written to its log. Frames of files follow each other at the frame rate.
fn find_time(request: &FrameRequest, index: usize) -> FrameTime {
    match &request.sources[index].message {
        Some(message) => FrameTime { stamp_ns: message.stamp_ns(), log_ns: message.log_ns() },
        None => {
            let ns = ((index + 1) as f64 * 1e9 / request.frame_rate_hz).round() as u64;
            FrameTime { stamp_ns: ns, log_ns: ns }
        }
    }
}

/// Renders frames that follow each other. Their labels are written last, because they describe the complete sequence.
fn render_sequence(
    plan: &Plan,
    request: &FrameRequest,
    sequence: SequenceSettings,
    log: &mut Option<&mut TactileLog>,
) -> Result<(), RenderError> {
    let SequenceSettings { friction, frame_rate_hz } = sequence;
    let failed = |error| RenderError::Io(request.out.to_owned(), error);
    let mut follower = SequenceFollower::new(plan, friction, frame_rate_hz).expect("the plan was made for a sequence");
    let mut first: Option<Label> = None;
    let mut frames = Vec::new();
    for (index, source) in request.sources.iter().enumerate() {
        let changed = |problem: Diagnostic| RenderError::Changed(source.path.clone(), problem.message);
        let seen = read_seen_frame(&request.reader, source).map_err(changed)?;
        let nothing = || FrameMetadata::from_id(&source.stem);
        let known = request.metadata.as_ref().map_or_else(nothing, |known| known[index].clone());
        let unsound = |reason: String| RenderError::Unhealthy(source.path.clone(), reason);
        let next = follower.render_next(plan, index as u64, seen, known);
        let SequenceFrame { sample, label } = next.map_err(|problem| {
            unsound(problem.help.map_or_else(|| problem.message.clone(), |help| format!("{}; {help}", problem.message)))
        })?;
        if !label.health.healthy && plan.output().on_unhealthy != OnUnhealthy::Keep {
            return Err(unsound(label.health.reason.clone()));
        }
        match log {
            Some(log) => {
                let time = find_time(request, index);
                log.write(time, &tactile_log::encode_sample(plan, &sample, time, None)).map_err(failed)?;
            }
            None => write_frame_files(request.out, source, &encode_layers(plan, &sample))?,
        }
        first.get_or_insert(sample.label);
        frames.push(label);
    }
    let Some(first) = first else { return Ok(()) };
    let friction_coefficient = friction.coefficient();
    let info =
        SequenceInfo { frame_rate_hz, frames: frames.len() as u32, friction_coefficient, ..SequenceInfo::default() };
    for (index, row) in SequenceLabel::new(&first, info, frames).to_rows().enumerate() {
        let line = to_json_line(&row);
        match log {
            Some(log) => log.write(find_time(request, index), &[tactile_log::encode_label(&line)]).map_err(failed)?,
            None => {
                let path = request.out.join(format!("{}.json", request.sources[index].stem));
                write_without_sync(&path, &line).map_err(|error| RenderError::Io(path, error))?;
            }
        }
    }
    Ok(())
}

/// Reads a frame and converts it to what is pressed in.
fn read_seen_frame<'a>(reader: &'a FrameReader, source: &FrameSource) -> Result<SeenFrame<'a>, Diagnostic> {
    let frame = source.read().map_err(|reason| {
        let help = match &source.message {
            None => "a frame is an npy array, an EXR picture or a grey PNG of 16 bits, up to 8192 px on a side",
            Some(_) => "a frame is an image 32FC1, 16UC1 or mono16, or one of the transport compressedDepth",
        };
        Diagnostic::new(reason).help(help)
    })?;
    reader.read(frame)
}

/// Renders the sample of a frame called `name`.
pub fn render_frame_sample(
    plan: &Plan,
    index: u64,
    name: &str,
    seen: SeenFrame<'_>,
    known: Option<&FrameMetadata>,
) -> Sample {
    let nothing = FrameMetadata::from_id(name);
    let FrameMetadata { id, class, pose, motion } = known.unwrap_or(&nothing).clone();
    let indentation_depth_mm = seen.indentation_depth_mm();
    let pressed = PressSource::Frame(DepthFrame { id, class, shape: seen.into_shape(&pose) });
    let known_press = KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm };
    let mut scene = Scene::from_known_press(plan, index, 0, known_press);
    if known.is_some() {
        scene.motion = motion;
    }
    press(plan, &scene)
}

/// Lists the suffixes of the names of a frame's files.
fn file_suffixes(plan: &Plan) -> Vec<String> {
    let format = plan.output().depth_format;
    let layers = plan.layers().into_iter().map(|layer| layer.file_suffix(format));
    [String::from("tactile.png"), String::from("json")].into_iter().chain(layers).collect()
}

fn write_frame_files(out: &Path, source: &FrameSource, members: &[Member]) -> Result<(), RenderError> {
    let path = |suffix: &str| out.join(format!("{}.{suffix}", source.stem));
    // Remove layers of an earlier run that this one does not write, but only beside a label that gelsim wrote.
    let stale = DepthFormat::ALL.into_iter().flat_map(|format| OutputLayer::ALL.map(|layer| layer.file_suffix(format)));
    let label = input::read_if_exists(&path("json"), input::MAX_METADATA_BYTES);
    let label = label.map_err(|error| RenderError::Io(path("json"), error))?;
    let is_ours = label.is_some_and(|label| {
        let Ok(label) = serde_json::from_slice::<serde_json::Value>(&label) else { return false };
        serde_json::from_value::<Label>(label.clone()).is_ok() || serde_json::from_value::<FrameRow>(label).is_ok()
    });
    for suffix in stale.filter(|suffix| is_ours && members.iter().all(|member| member.suffix != *suffix)) {
        let path = path(&suffix);
        if input::is_same_path(&path, &source.path) {
            continue;
        }
        ignore_not_found(fs::remove_file(&path)).map_err(|error| RenderError::Io(path, error))?;
    }
    for member in members {
        let path = path(&member.suffix);
        let written = member.bytes.read().and_then(|bytes| write_without_sync(&path, &bytes));
        written.map_err(|error| RenderError::Io(path, error))?;
    }
    Ok(())
}
