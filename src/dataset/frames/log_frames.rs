//! Finds the depth frames in logs of robots and simulators, and what the logs say about them: the unit, how the camera's
//! rays run, when the frames were taken, and where the object was.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::camera::DepthUnit;
use super::message::FrameMessage;
use super::poses::FrameMetadata;
use super::source::FrameSource;
use crate::logs::messages::{self, CameraInfo, Kind, Stamped, Transform};
use crate::logs::{Entry, Log, Loss, Topic};
use gelsim_core::pose::Pose;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::spelling::find_nearest_name;

/// What a user says about a log.
#[derive(Clone, Copy, Debug, Default)]
pub struct LogChoice<'a> {
    /// The topic of the depth images; `None` for the only one.
    pub topic: Option<&'a str>,
    /// The topic of the camera's CameraInfo; `None` for the one beside the images.
    pub camera_info_topic: Option<&'a str>,
    /// The topic of the object's poses.
    pub pose_topic: Option<&'a str>,
    /// The sensor's frame among transforms.
    pub sensor_frame: Option<&'a str>,
    /// The object's frame among transforms.
    pub object_frame: Option<&'a str>,
}

/// The frames of logs.
pub struct LogFrames {
    /// The frames, in the order of the times at which they were taken, log by log.
    pub sources: Vec<FrameSource>,
    /// Unit of their values.
    pub unit: DepthUnit,
    /// How the rays of the camera run, and the topic that says it; `None` if the first log does not tell.
    pub camera: Option<(String, CameraInfo)>,
    /// The object's pose in each frame, if a topic was named.
    pub poses: Option<Vec<FrameMetadata>>,
    /// Frames per second, by the times of the first and the last one; `None` of a single frame, or if that is no rate.
    pub rate_hz: Option<f64>,
    /// What cannot be read.
    pub losses: Vec<Loss>,
}

/// Why logs have no frames.
pub enum LogError {
    /// What the user wrote does not fit to them.
    Wrong,
    /// They are damaged, and nothing is left.
    Lost(Diagnostic),
}

/// Finds the frames in the logs at these paths. Mistakes go to `problems`.
pub fn find_log_frames(
    paths: &[PathBuf],
    choice: &LogChoice<'_>,
    problems: &mut Diagnostics,
) -> Result<LogFrames, LogError> {
    let mut found = LogFrames {
        sources: Vec::new(),
        unit: DepthUnit::Metre,
        camera: None,
        poses: None,
        rate_hz: None,
        losses: Vec::new(),
    };
    let mut stems = HashSet::new();
    let mut is_wrong = false;
    for path in paths {
        let log = match Log::open(path) {
            Ok(log) => Arc::new(log),
            Err(problem) => {
                problems.push(problem);
                is_wrong = true;
                continue;
            }
        };
        if let Err(problem) = add_log(&log, choice, &mut stems, &mut found) {
            match log.losses.first() {
                // What is missing may be in what is lost.
                Some(loss) => return Err(LogError::Lost(problem.help(loss.to_warning().message))),
                None => problems.push(problem),
            }
            is_wrong = true;
        }
    }
    if is_wrong { Err(LogError::Wrong) } else { Ok(found) }
}

/// Adds the frames of a log. The error says what does not fit.
fn add_log(
    log: &Arc<Log>,
    choice: &LogChoice<'_>,
    stems: &mut HashSet<String>,
    found: &mut LogFrames,
) -> Result<(), Diagnostic> {
    let topic_number = find_depth_topic(log, choice.topic)?;
    let topic = &log.topics[topic_number as usize];
    let unit = topic.kind.and_then(|kind| messages::depth_unit(kind, &topic.encoding)).unwrap_or(DepthUnit::Metre);
    let is_first = found.sources.is_empty();
    if !is_first && unit != found.unit {
        let problem =
            Diagnostic::new(format!("{}: its frames have another unit than those before", log.path.display()));
        return Err(problem.help("render these logs one by one"));
    }
    found.unit = unit;
    let mut entries: Vec<Entry> = log.entries.iter().filter(|entry| entry.topic == topic_number).copied().collect();
    entries.sort_by_key(|entry| entry.stamp_ns);
    let name: String =
        topic.name.trim_matches('/').chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    for entry in &entries {
        let mut stem = format!("{name}_{}", entry.stamp_ns);
        for number in 2.. {
            if stems.insert(stem.clone()) {
                break;
            }
            stem = format!("{name}_{}_{number}", entry.stamp_ns);
        }
        let path = log.path.join(topic.name.trim_start_matches('/')).join(entry.stamp_ns.to_string());
        let message = Some(FrameMessage::new(Arc::clone(log), *entry, unit));
        found.sources.push(FrameSource { path, stem, message });
    }
    if is_first {
        found.camera = find_camera_info(log, topic, choice.camera_info_topic)?;
        if let [first, .., last] = entries.as_slice() {
            let rate_hz = (entries.len() - 1) as f64 * 1e9 / (last.stamp_ns - first.stamp_ns) as f64;
            found.rate_hz = Some(rate_hz).filter(|rate| (1e-3..=1e4).contains(rate));
        }
    }
    if let Some(topic) = choice.pose_topic {
        let tracks = Tracks::read(log, topic, choice)?;
        let stems = found.sources[found.sources.len() - entries.len()..].iter().map(|source| &source.stem);
        let poses = entries.iter().zip(stems).map(|(entry, stem)| {
            let Transform { rotation, translation_m } = tracks.find(entry.stamp_ns, choice).map_err(|reason| {
                let problem = Diagnostic::new(format!("{}: {reason}", log.path.display()));
                problem
                    .help("name a topic that says where the object is in the sensor's frame, from the first frame on")
            })?;
            let pose = Pose::from_quaternion(rotation.to_array(), (1e3 * translation_m).to_array());
            Ok(FrameMetadata { pose, ..FrameMetadata::from_id(stem) })
        });
        let poses = poses.collect::<Result<Vec<_>, Diagnostic>>()?;
        found.poses.get_or_insert_default().extend(poses);
    }
    found.losses.extend(log.losses.iter().cloned());
    Ok(())
}

/// Returns the number of the topic of this name, which need not have its first slash.
fn find_named_topic(log: &Log, name: &str) -> Result<u32, Diagnostic> {
    log.find_topic(name).or_else(|| log.find_topic(&format!("/{name}"))).ok_or_else(|| {
        let names = log.topics.iter().map(|topic| topic.name.as_str());
        let meant = find_nearest_name(name, names).map_or(String::new(), |near| format!("is {near} meant? "));
        let problem = Diagnostic::new(format!("{} has no topic {name}", log.path.display()));
        problem.help(format!("{meant}{}", log.describe_topics()))
    })
}

/// Returns the topic of the depth images.
fn find_depth_topic(log: &Log, wanted: Option<&str>) -> Result<u32, Diagnostic> {
    let shown = log.path.display();
    let Some(name) = wanted else {
        let depth = (0..).zip(&log.topics).filter(|(_, topic)| topic.is_depth()).map(|(number, _)| number);
        let depth: Vec<u32> = depth.collect();
        return match depth.as_slice() {
            [only] => Ok(*only),
            [] => Err(Diagnostic::new(format!("{shown} has no topic of depth images")).help(log.describe_topics())),
            _ => {
                let names: Vec<&str> = depth.iter().map(|at| log.topics[*at as usize].name.as_str()).collect();
                let problem = Diagnostic::new(format!("{shown} has {} topics of depth images", names.len()));
                Err(problem.help(format!("name one with --topic: {}", names.join(", "))))
            }
        };
    };
    let number = find_named_topic(log, name)?;
    let topic = &log.topics[number as usize];
    match topic.is_depth() {
        true => Ok(number),
        false => {
            let problem = Diagnostic::new(format!("{} of {shown} has no depth images", topic.name));
            let depth = "these are 32FC1, 16UC1 or mono16, or of the transport compressedDepth";
            Err(problem.help(format!("{depth}; {}", log.describe_topics())))
        }
    }
}

/// Reads how the rays of the camera run, from the topic of this name or from that beside the images.
fn find_camera_info(
    log: &Log,
    images: &Topic,
    wanted: Option<&str>,
) -> Result<Option<(String, CameraInfo)>, Diagnostic> {
    let number = match wanted {
        Some(name) => Some(find_named_topic(log, name)?),
        None => {
            // Of /left/depth/image the camera's is /left/depth/camera_info; a transport adds a part to the name.
            let depth = if images.kind == Some(Kind::CompressedImage) { 3 } else { 2 };
            let places = Path::new(&images.name).ancestors().take(depth);
            let mut beside = places.map(|place| place.join("camera_info").to_string_lossy().into_owned());
            beside.find_map(|name| log.find_topic(&name))
        }
    };
    let Some(number) = number else { return Ok(None) };
    let topic = &log.topics[number as usize];
    let wrong = |reason: &str| {
        let problem = Diagnostic::new(format!("{} of {}: {reason}", topic.name, log.path.display()));
        problem.help("say how the camera's rays run: --projection orthographic, or perspective with --fov-y-deg F")
    };
    let entry = log.entries.iter().find(|entry| entry.topic == number);
    let (Some(Kind::CameraInfo), Some(serialization), Some(entry)) = (topic.kind, topic.serialization, entry) else {
        // A topic that nobody named counts only if it tells something.
        return if wanted.is_some() { Err(wrong("it has no sensor_msgs/CameraInfo")) } else { Ok(None) };
    };
    let info = log.read(entry).and_then(|message| messages::decode_camera_info(serialization, &message));
    info.map(|info| Some((topic.name.clone(), info))).map_err(|reason| wrong(&reason))
}

/// Where frames were at times.
struct Tracks {
    /// For each child its parent and its places, sorted by time.
    by_child: HashMap<String, Vec<Track>>,
}

struct Track {
    parent: String,
    is_static: bool,
    places: Vec<(u64, Transform)>,
}

impl Tracks {
    /// Reads the transforms of a topic, and the static ones if it carries transforms of many frames.
    fn read(log: &Log, topic: &str, choice: &LogChoice<'_>) -> Result<Self, Diagnostic> {
        let named = find_named_topic(log, topic)?;
        let Topic { name, kind, .. } = &log.topics[named as usize];
        let wrong = |reason: String, help: String| {
            Diagnostic::new(format!("{name} of {}: {reason}", log.path.display())).help(help)
        };
        let is_tree = match (kind, choice.sensor_frame, choice.object_frame) {
            (Some(Kind::PoseStamped), ..) => false,
            (Some(Kind::TransformStamped), None, None) => false,
            (Some(Kind::Transforms | Kind::TransformStamped), Some(_), Some(_)) => true,
            (Some(Kind::Transforms | Kind::TransformStamped), ..) => {
                let help = "name the frames of sensor and object: --sensor-frame A --object-frame B";
                return Err(wrong(String::from("it has the transforms of many frames"), String::from(help)));
            }
            _ => {
                let kinds = "poses are PoseStamped, TransformStamped or TFMessage";
                return Err(wrong(String::from("it has no poses"), format!("{kinds}; {}", log.describe_topics())));
            }
        };
        let is_static = |topic: &Topic| topic.kind == Some(Kind::Transforms) && topic.name.ends_with("tf_static");
        let mut by_child: HashMap<String, Vec<Track>> = HashMap::new();
        for entry in &log.entries {
            let topic = &log.topics[entry.topic as usize];
            let is_static = is_static(topic);
            let (Some(kind), Some(serialization)) = (topic.kind, topic.serialization) else { continue };
            if entry.topic != named && !(is_tree && is_static) {
                continue;
            }
            let found = log.read(entry).and_then(|bytes| messages::decode_transforms(kind, serialization, &bytes));
            let found = found.map_err(|reason| {
                wrong(format!("its message at {} ns: {reason}", entry.log_ns), String::from("choose another topic"))
            })?;
            for Stamped { stamp_ns, parent, child, transform } in found {
                let tracks = by_child.entry(if is_tree { child } else { String::new() }).or_default();
                let stamp_ns = if stamp_ns == 0 { entry.log_ns } else { stamp_ns };
                match tracks.iter_mut().find(|track| track.parent == parent) {
                    Some(track) => track.places.push((stamp_ns, transform)),
                    None => tracks.push(Track { parent, is_static, places: vec![(stamp_ns, transform)] }),
                }
            }
        }
        for track in by_child.values_mut().flatten() {
            track.places.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        }
        if let (false, Some([first, second, ..])) = (is_tree, by_child.get("").map(Vec::as_slice)) {
            let parents = format!("its poses are in several frames: {}, {}", first.parent, second.parent);
            return Err(wrong(parents, String::from("record the poses in the sensor's frame")));
        }
        if let (false, Some(wanted), Some([only])) = (is_tree, choice.sensor_frame, by_child.get("").map(Vec::as_slice))
            && only.parent != wanted.trim_start_matches('/')
        {
            let reason = format!("its poses are in the frame {}, not {wanted}", only.parent);
            return Err(wrong(reason, String::from("record the poses in the sensor's frame")));
        }
        Ok(Self { by_child })
    }

    /// Returns where the object is in the sensor's frame at a time.
    fn find(&self, stamp_ns: u64, choice: &LogChoice<'_>) -> Result<Transform, String> {
        let (Some(sensor), Some(object), false) =
            (choice.sensor_frame, choice.object_frame, self.by_child.contains_key(""))
        else {
            let track = self.by_child.get("").and_then(|tracks| tracks.first()).ok_or("the topic of poses is empty")?;
            return track.at(stamp_ns).ok_or_else(|| format!("no pose is as early as the frame of {stamp_ns} ns"));
        };
        let sensor = self.climb(sensor.trim_start_matches('/'), stamp_ns);
        let object = self.climb(object.trim_start_matches('/'), stamp_ns);
        for (above, to_sensor) in &sensor {
            if let Some((_, to_object)) = object.iter().find(|(name, _)| name == above) {
                return Ok(to_sensor.inverse().after(*to_object));
            }
        }
        let ends = |chain: &[(String, Transform)]| chain.last().map_or(String::new(), |(name, _)| name.clone());
        Err(format!(
            "no transforms lead from the sensor's frame to the object's at {stamp_ns} ns: one leads up to `{}`, the other \
             to `{}`",
            ends(&sensor),
            ends(&object)
        ))
    }

    /// Returns the frames above a frame, itself first, with the transform that takes its points there.
    fn climb(&self, frame: &str, stamp_ns: u64) -> Vec<(String, Transform)> {
        /// No tree is as deep; a circle of frames would be.
        const DEEPEST: usize = 256;
        let mut chain = vec![(frame.to_owned(), Transform::IDENTITY)];
        while chain.len() < DEEPEST
            && let Some((name, so_far)) = chain.last()
            && let Some(tracks) = self.by_child.get(name)
            && let Some((parent, step)) = tracks.iter().find_map(|track| Some((&track.parent, track.at(stamp_ns)?)))
        {
            let next = (parent.clone(), step.after(*so_far));
            chain.push(next);
        }
        chain
    }
}

impl Track {
    /// Returns the place at a time: between the places before and after it, or the last one. `None` before the first.
    fn at(&self, stamp_ns: u64) -> Option<Transform> {
        let after = self.places.partition_point(|(time, _)| *time <= stamp_ns);
        if self.is_static {
            return self.places.get(after.max(1) - 1).map(|(_, place)| *place);
        }
        let (before_ns, before) = *self.places.get(after.checked_sub(1)?)?;
        Some(match self.places.get(after) {
            Some((after_ns, next)) => {
                before.between(*next, (stamp_ns - before_ns) as f64 / (*after_ns - before_ns) as f64)
            }
            None => before,
        })
    }
}
