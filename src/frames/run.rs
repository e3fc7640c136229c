//! Renders files of depth frames: first all are read and checked, then each becomes a tactile image, layers and a label.
//!
//! A frame's files are written under other names and renamed. What an earlier run wrote of the same frames is replaced,
//! layers that this one does not write included; files that only have such names, without a label, stay.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::camera::{DepthCamera, Heights};
use super::check::Reach;
use super::poses::Known;
use super::read;
use super::source::Source;
use crate::config::diagnostic::{Problem, Problems, Report};
use crate::config::output::{DepthFormat, Layer};
use crate::dataset::encode::{Member, members};
use crate::dataset::imagefolder::sync;
use crate::dataset::layout::Split;
use crate::dataset::shard::write_one_of_many;
use crate::health::OnUnhealthy;
use crate::label::Label;
use crate::plan::Plan;
use crate::render::{Sample, press};
use crate::scene::frame::Frame;
use crate::scene::{Press, Pressed, Scene};

/// What to render and where.
pub struct Request<'a> {
    /// The frames; their places are their samples' numbers.
    pub sources: &'a [Source],
    /// What saw them.
    pub camera: DepthCamera,
    /// What is known of each, if anything is.
    pub known: Option<Vec<Known>>,
    /// Folder of the results.
    pub out: &'a Path,
    /// No frame need reach the pad.
    pub no_contact_ok: bool,
}

/// Why rendering ended early. What was written before stays.
#[derive(Debug)]
pub enum Stopped {
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// A file is no more what it was when it was checked.
    Changed(PathBuf, String),
    /// A frame's sample is not sound, and the job wants no such sample: its file, and why.
    Unhealthy(PathBuf, String),
}

/// Reads every frame. On failure, all mistakes in them.
pub fn check(plan: &Plan, request: &Request) -> Result<Vec<Reach>, Report> {
    let Request { sources, camera, out, .. } = request;
    let found: Vec<Result<Reach, Problem>> = sources
        .par_iter()
        .map(|source| {
            let heights = heights(plan, camera, &source.path)?;
            let reach = Reach::of(&heights, plan.thickness_mm);
            reach.mistake(camera).map_or(Ok(reach), Err)
        })
        .collect();
    let mut problems = Problems::default();
    let mut reaches = Vec::new();
    for (source, found) in sources.iter().zip(found) {
        match found {
            Ok(reach) => reaches.push(reach),
            Err(problem) => {
                let message = format!("{}: {}", source.path.display(), problem.message);
                problems.push(Problem { message, ..problem });
            }
        }
        let mut ours = suffixes(plan).into_iter().map(|suffix| out.join(format!("{}.{suffix}", source.stem)));
        if ours.any(|path| is_same_file(&path, &source.path)) {
            let problem = Problem::new(format!("{} would be written over", source.path.display()));
            problems.push(problem.help("choose another folder with --out"));
        }
    }
    let nearest = reaches.iter().min_by(|a, b| a.lowest_mm.total_cmp(&b.lowest_mm));
    if let Some(nearest) = nearest.filter(|nearest| !nearest.touches() && !request.no_contact_ok && problems.is_empty())
    {
        problems.push(nearest.out_of_reach(camera));
    }
    if problems.is_empty() { Ok(reaches) } else { Err(Report::new(&problems, &[])) }
}

/// Renders and writes every frame, on the threads of the pool that this is called in.
pub fn run(plan: &Plan, request: &Request) -> Result<(), Stopped> {
    let out = request.out;
    let failed = |error| Stopped::Io(out.to_owned(), error);
    fs::create_dir_all(out).map_err(failed)?;
    let one = |(index, source): (usize, &Source)| {
        let changed = |problem: Problem| Stopped::Changed(source.path.clone(), problem.message);
        let heights = heights(plan, &request.camera, &source.path).map_err(changed)?;
        let known = request.known.as_ref().map(|known| &known[index]);
        let sample = sample(plan, index as u64, &source.stem, heights, known);
        let health = &sample.label.health;
        if !health.healthy && plan.on_unhealthy != OnUnhealthy::Keep {
            return Err(Stopped::Unhealthy(source.path.clone(), health.reason.clone()));
        }
        write(out, source, &members(plan, &sample))
    };
    request.sources.par_iter().enumerate().try_for_each(one)?;
    File::open(out).and_then(|folder| sync(&folder)).map_err(failed)
}

/// Reads a frame and takes it to heights in the plan's view.
fn heights(plan: &Plan, camera: &DepthCamera, path: &Path) -> Result<Heights, Problem> {
    let frame = read::file(path).map_err(|reason| {
        Problem::new(reason)
            .help("a frame is an npy array, an EXR picture or a grey PNG of 16 bits, up to 8192 px on a side")
    })?;
    camera.heights(frame, &plan.camera)
}

/// The sample of a frame called `name`.
pub fn sample(plan: &Plan, index: u64, name: &str, heights: Heights, known: Option<&Known>) -> Sample {
    let nothing = Known::nothing(name);
    let Known { id, class, pose, motion } = known.unwrap_or(&nothing).clone();
    let frame = Frame { id, class, above_mm: heights.above_mm, unseen_px: heights.unseen_px };
    let indentation_depth_mm = frame.indentation_depth_mm();
    let pressed = Pressed::Frame(Arc::new(frame));
    let given = Press { split: Split::Train, pressed, pose, indentation_depth_mm };
    let mut scene = Scene::given(plan, index, 0, given);
    if known.is_some() {
        scene.motion = motion;
    }
    press(plan, &scene)
}

/// Ends of the names of a frame's files.
fn suffixes(plan: &Plan) -> Vec<String> {
    let format = plan.job.output.depth_format;
    let layers = plan.layers.iter().map(|layer| layer.suffix(format));
    [String::from("tactile.png"), String::from("json")].into_iter().chain(layers).collect()
}

fn write(out: &Path, source: &Source, members: &[Member]) -> Result<(), Stopped> {
    let path = |suffix: &str| out.join(format!("{}.{suffix}", source.stem));
    let stale = DepthFormat::ALL.into_iter().flat_map(|format| Layer::ALL.map(|layer| layer.suffix(format)));
    let label = fs::read(path("json")).unwrap_or_default();
    let is_ours = serde_json::from_slice::<Label>(&label).is_ok();
    for suffix in stale.filter(|suffix| is_ours && members.iter().all(|member| member.suffix != *suffix)) {
        let path = path(&suffix);
        if is_same_file(&path, &source.path) {
            continue;
        }
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(Stopped::Io(path, error)),
            _ => {}
        }
    }
    for member in members {
        let path = path(&member.suffix);
        write_one_of_many(&path, &member.bytes).map_err(|error| Stopped::Io(path, error))?;
    }
    Ok(())
}

/// True if both are there and are one file.
fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
