//! `gelsim render`: turns depth frames of a simulator into tactile images.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::guesses::{parse_number, parse_whole_number};
use super::store::local_path_parser;
use super::{Failure, Log, MAX_THREADS, print_to_stderr, threads_failure};
use gelsim_core::camera::projection::LensModel;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::sensor::Sensor;
use gelsim_dataset::frames::camera::{DepthCamera, DepthProjection, DepthUnit, DistanceAlong};
use gelsim_dataset::frames::check::FrameReach;
use gelsim_dataset::frames::log_frames::{LogChoice, LogError, LogFrames, find_log_frames};
use gelsim_dataset::frames::poses::{self, FrameMetadata};
use gelsim_dataset::frames::reader::FrameReader;
use gelsim_dataset::frames::run::{FrameRequest, RenderError, SequenceSettings, check_frames, render_frames};
use gelsim_dataset::frames::source::{FrameSource, find_frames};
use gelsim_dataset::frames::tactile_log::is_log_name;
use gelsim_dataset::logs::is_log;
use gelsim_dataset::logs::messages::CameraInfo;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_job::config::Overrides;
use gelsim_job::layers::OutputLayer;
use gelsim_job::plan::frames::FrameSettings;
use gelsim_job::plan::{Plan, standalone};
use stream::OnBrokenFrame;

mod stream;

/// Turn depth frames of a simulator (MuJoCo, PyBullet, Gazebo, Isaac) or of a recorded log into tactile images: the
/// object's distance from a camera that looks out of the sensor takes the place of a mesh, and all else is as in
/// generate.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim render --depth run --depth-unit m --plane-mm 10 --sensor digit -o out
  gelsim render --depth 'run/*.npy' --poses poses.csv --depth-unit m \\
      --plane-mm 10 --sensor gelsight-mini --out tactile
  gelsim render --depth run.mcap --topic /gel/depth --plane-mm 25 \\
      --sensor digit --out tactile.mcap
  gelsim render --stream --depth-unit m --plane-mm 10 --sensor digit \\
      <frames.npy >images.npy

A frame is an npy array of rows and columns (also in an npz: FILE.npz, or FILE.npz/NAME where it holds several), an EXR \
picture or a grey 16-bit PNG. Its resolution is the image's, and shows \
the sensor's field of view. Scripts for each simulator, and what goes wrong there, are in docs/how-to/simulators.md; \
programs that read a stream in docs/how-to/streams.md. Logs are MCAP (.mcap), bags of ROS 1 (.bag) and of ROS 2 (a \
folder, .mcap or .db3): docs/how-to/logs.md.")]
pub struct Render {
    /// Frames: files, folders or patterns of names; or logs: .mcap, .bag, .db3, or the folder of a ROS 2 bag
    #[arg(long, value_name = "FILE|DIR|GLOB", num_args = 1.., required_unless_present = "stream")]
    depth: Vec<PathBuf>,
    /// Unit of the values [default: of a log that of its images: 32FC1 has metres, 16UC1 and mono16 millimetres]
    #[arg(long, value_name = "UNIT", value_enum)]
    depth_unit: Option<UnitName>,
    /// Distance of the undeformed pad's surface from the camera, mm; not for a sensor whose gel has a shape: its lens
    /// says it
    #[arg(long, value_name = "D", allow_negative_numbers = true, value_parser = parse_number)]
    plane_mm: Option<f64>,
    /// Preset or sensor file
    #[arg(long, value_name = "PRESET|FILE.toml")]
    sensor: String,
    /// Folder for NAME.tactile.png, NAME.LAYER.* and NAME.json of each frame; or a log for all: FILE.mcap
    #[arg(short, long, value_name = "DIR|FILE.mcap", value_parser = local_path_parser(), required_unless_present = "stream")]
    out: Option<PathBuf>,
    /// Ignore what is farther from the camera than this, mm
    #[arg(long, value_name = "D", allow_negative_numbers = true, value_parser = parse_number)]
    max_depth_mm: Option<f64>,
    /// The value that means "nothing there", in the frame's own unit; may be nan or inf
    #[arg(long, value_name = "V", allow_negative_numbers = true, value_parser = parse_number)]
    background_value: Option<f64>,
    /// The frame's columns go from right to left
    #[arg(long)]
    flip_x: bool,
    /// The frame's rows go from bottom to top
    #[arg(long)]
    flip_y: bool,
    /// Offset of the frame against the image, px to the right and down, after flips: pixel (x, y) is read at (x + DX, y
    /// + DY)
    #[arg(long, value_name = "DX,DY", value_delimiter = ',', allow_hyphen_values = true, value_parser = parse_number)]
    pixel_offset: Vec<f64>,
    /// The camera's rays [default: orthographic; inside a gel that has a shape those of the sensor's own lens]; images
    /// of perspective frames have the sensor's own resolution
    #[arg(long, value_name = "KIND", value_enum)]
    projection: Option<ProjectionName>,
    /// Angle between the upper and the lower edge of a perspective frame, degrees
    #[arg(long, value_name = "F", allow_negative_numbers = true, value_parser = parse_number)]
    fov_y_deg: Option<f64>,
    /// Line along which the values are distances
    #[arg(long, value_name = "LINE", value_enum, default_value_t)]
    depth_along: AlongName,
    /// Table of what is known about each frame: file, id, class, quaternion_x to quaternion_w, x_mm, y_mm, z_mm,
    /// shear_x_mm, shear_y_mm, twist_deg
    #[arg(long, value_name = "FILE.csv", conflicts_with = "stream")]
    poses: Option<PathBuf>,
    /// Render even if no frame reaches the pad
    #[arg(long, conflicts_with = "stream")]
    no_contact_ok: bool,
    #[arg(long, help = format!("Layers besides the tactile image: {} [default: depth; with --stream none]", layer_names()), value_name = "L,L", value_delimiter = ',', value_parser = parse_layer)]
    layers: Vec<OutputLayer>,
    /// Take the frames, in the order of their names, for one object that moves, with friction that depends on its path:
    /// the coefficient, or `stick`. Files need --poses; in a stream each frame follows an npy array of seven numbers:
    /// quaternion x, y, z, w and x, y, z in mm; an empty one begins another sequence
    #[arg(long, value_name = "MU|stick", value_parser = parse_friction)]
    sequence: Option<Friction>,
    /// Frames per second of a sequence, for times in labels; and of files, for times in a log [default: of a log that of
    /// its images, else 25]
    #[arg(long, value_name = "F", value_parser = parse_number)]
    frame_rate_hz: Option<f64>,
    /// Fidelity level
    #[arg(long, value_name = "LEVEL", value_parser = super::fidelity_level_parser())]
    fidelity: Option<Fidelity>,
    /// Any key of a job, such as of its sensor, camera or markers: dotted.path=TOML-VALUE
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Threads [default: all cores]
    #[arg(short = 'j', long, value_name = "T", value_parser = parse_whole_number::<usize>, conflicts_with = "stream")]
    threads: Option<usize>,
    /// Read npy frames one after another from standard input and answer each on standard output before the next is read:
    /// by the tactile image, an npy array of shape (H, W, 3), or with --labels or --layers by named parts
    /// (docs/how-to/streams.md)
    #[arg(long, conflicts_with_all = ["depth", "out"])]
    stream: bool,
    /// Answer each frame of a stream by named parts, its label in JSON among them
    #[arg(long, conflicts_with = "depth")]
    labels: bool,
    /// What becomes of a frame of a stream that cannot be rendered
    #[arg(long, value_name = "WHAT", value_enum, default_value_t, conflicts_with = "depth")]
    on_broken_frame: OnBrokenFrame,
    /// Topic of the depth images in a log [default: the only one]
    #[arg(long, value_name = "TOPIC", conflicts_with = "stream", help_heading = "Logs")]
    topic: Option<String>,
    /// Topic of the camera's CameraInfo [default: camera_info beside the images]
    #[arg(long, value_name = "TOPIC", conflicts_with = "stream", help_heading = "Logs")]
    camera_info_topic: Option<String>,
    /// Topic of the object's poses in the sensor's frame: PoseStamped, TransformStamped or TFMessage
    #[arg(long, value_name = "TOPIC", conflicts_with_all = ["stream", "poses"], help_heading = "Logs")]
    pose_topic: Option<String>,
    /// The sensor's frame in transforms: x right, y down, z out of the pad
    #[arg(long, value_name = "FRAME", requires = "pose_topic", help_heading = "Logs")]
    sensor_frame: Option<String>,
    /// The object's frame in transforms
    #[arg(long, value_name = "FRAME", requires = "pose_topic", help_heading = "Logs")]
    object_frame: Option<String>,
    /// Refuse a log that is damaged or cut off [default: render what is left of it]
    #[arg(long, conflicts_with = "stream", help_heading = "Logs")]
    strict: bool,
    /// Print nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum UnitName {
    /// Metres
    M,
    /// Millimetres
    Mm,
    /// Micrometres
    Um,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum AlongName {
    /// The camera's optical axis
    #[default]
    Axis,
    /// Each pixel's own ray
    Ray,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ProjectionName {
    /// Parallel rays
    Orthographic,
    /// Rays through one point
    Perspective,
}

fn parse_layer(name: &str) -> Result<OutputLayer, String> {
    OutputLayer::from_name(name).ok_or_else(|| format!("layers are {}", layer_names()))
}

fn parse_friction(text: &str) -> Result<Friction, String> {
    match text.parse::<f64>() {
        _ if text == "stick" => Ok(Friction::Stick),
        Ok(coefficient) if (0.0..=10.0).contains(&coefficient) => Ok(Friction::Coulomb { coefficient }),
        _ => Err(String::from("a coefficient of 0 to 10, or stick")),
    }
}

fn layer_names() -> String {
    OutputLayer::ALL.map(OutputLayer::name).join(", ")
}

impl Render {
    pub(super) fn run(mut self) -> Result<(), Failure> {
        let mut problems = Diagnostics::default();
        let found = self.find_frames(&mut problems)?;
        let is_unknown = |found: &FoundFrames| self.stream || !found.sources.is_empty();
        if self.depth_unit.is_none() && found.as_ref().is_some_and(is_unknown) {
            let help = "say what the values are: --depth-unit m, mm or um";
            problems.push(Diagnostic::new("--depth-unit is needed for frames that do not say it").help(help));
        }
        let camera = self.depth_camera(&mut problems);
        if self.sequence.is_some() && self.poses.is_none() && self.pose_topic.is_none() && !self.stream {
            let help =
                "give a table of where the object is in each frame: --poses FILE.csv; or of a log its --pose-topic";
            problems.push(Diagnostic::new("--sequence needs the object's poses").help(help));
        }
        if !(1e-3..=1e4).contains(&self.frame_rate_hz()) {
            problems.push(Diagnostic::new("--frame-rate-hz is out of range").help("allowed: 0.001 to 10000"));
        }
        if self.layers.is_empty() && !self.stream {
            self.layers.push(OutputLayer::Depth);
        }
        match (self.out.clone(), found) {
            (Some(_), None) => Err(Report::new(&problems, &[]).into()),
            // Clap sees to it that there is --out or --stream.
            (Some(out), Some(found)) => self.render_files(&out, found, camera, problems),
            (None, _) => self.render_stream(camera, problems),
        }
    }

    /// Finds the frames. What a log says of them takes the place of options that are not given. Mistakes go to
    /// `problems`; returns `None` if no option can be checked because of them.
    fn find_frames(&mut self, problems: &mut Diagnostics) -> Result<Option<FoundFrames>, Failure> {
        let sources = find_frames(&self.depth, problems);
        let files = sources.iter().map(|source| source.path.clone()).collect();
        let mut found = FoundFrames { files, sources, known: None, notes: Diagnostics::default() };
        let are_logs = found.files.iter().filter(|path| is_log(path)).count();
        if are_logs == 0 {
            let of_logs = [
                ("--topic", self.topic.is_some()),
                ("--camera-info-topic", self.camera_info_topic.is_some()),
                ("--pose-topic", self.pose_topic.is_some()),
                ("--strict", self.strict),
            ];
            for (name, _) in of_logs.iter().filter(|(_, is_given)| *is_given && !found.files.is_empty()) {
                let problem = Diagnostic::new(format!("{name} is for logs, and the frames are files"));
                problems.push(problem.help("leave it out"));
            }
            return Ok(Some(found));
        }
        if are_logs < found.files.len() {
            let problem = Diagnostic::new("some frames are in logs, and others are files");
            problems.push(problem.help("render them one after the other"));
            return Ok(None);
        }
        let choice = LogChoice {
            topic: self.topic.as_deref(),
            camera_info_topic: self.camera_info_topic.as_deref(),
            pose_topic: self.pose_topic.as_deref(),
            sensor_frame: self.sensor_frame.as_deref(),
            object_frame: self.object_frame.as_deref(),
        };
        let LogFrames { sources, unit, camera, poses, rate_hz, losses } =
            match find_log_frames(&found.files, &choice, problems) {
                Ok(frames) => frames,
                Err(LogError::Wrong) => return Ok(None),
                Err(LogError::Lost(problem)) => {
                    return Err(Failure::runtime_with_help(problem.message, problem.help.unwrap_or_default()));
                }
            };
        let warnings = losses.iter().take(MAX_LOSSES).map(|loss| loss.to_warning());
        found
            .notes
            .extend(warnings.map(|warning| warning.help("what is left is rendered; --strict refuses such a log")));
        if losses.len() > MAX_LOSSES {
            found.notes.push(Diagnostic::warning(format!("{} more parts of it are lost", losses.len() - MAX_LOSSES)));
        }
        if let (true, Some(loss)) = (self.strict, losses.first()) {
            return Err(Failure::runtime_with_help(
                loss.to_warning().message,
                "leave --strict out to render what is left",
            ));
        }
        self.depth_unit = self.depth_unit.or(Some(UnitName::from_unit(unit)));
        self.frame_rate_hz = self.frame_rate_hz.or(rate_hz);
        found.known = poses;
        match camera {
            Some((topic, info)) if self.projection != Some(ProjectionName::Orthographic) => {
                // The frames must have the size of the camera's; one that cannot be read is refused later.
                let size = sources.iter().find_map(|source| source.read().ok());
                let size = size.map_or(info.size_px, |frame| [frame.width, frame.height]);
                self.adopt_camera(&topic, &info, size, &mut found.notes, problems);
            }
            None if self.projection.is_none() => {
                let problem = Diagnostic::note(
                    "the log has no CameraInfo beside the images: rays are taken to be those of the sensor",
                );
                found.notes.push(problem.help("if they are not: --projection perspective --fov-y-deg F"));
            }
            _ => {}
        }
        found.sources = sources;
        Ok(Some(found))
    }

    /// Takes the angle and the middle of a perspective camera from its CameraInfo, unless options say them.
    fn adopt_camera(
        &mut self,
        topic: &str,
        info: &CameraInfo,
        size: [usize; 2],
        notes: &mut Diagnostics,
        problems: &mut Diagnostics,
    ) {
        let otherwise = "say it yourself: --projection perspective --fov-y-deg F --pixel-offset=DX,DY";
        self.projection = Some(ProjectionName::Perspective);
        if self.fov_y_deg.is_some() {
            return;
        }
        let CameraInfo { size_px, focal_px: [fx, fy], is_distorted, .. } = *info;
        self.fov_y_deg = Some(info.fov_y_deg());
        let mut wrong = |reason: String| problems.push(Diagnostic::new(format!("{topic}: {reason}")).help(otherwise));
        if size_px != size {
            let [camera, frames] = [size_px, size].map(|[width, height]| format!("{width}x{height}"));
            wrong(format!("it is about images of {camera} px, and the frames have {frames}"));
            return;
        }
        if (fx / fy - 1.0).abs() > MAX_STRETCH {
            wrong(format!("its pixels are not square: focal lengths of {fx} and {fy} px"));
        }
        let [x, y] = info.offset_px();
        if x.abs().max(y.abs()) > 64.0 {
            wrong(format!("its optical axis is {x:.1} and {y:.1} px off the middle, and at most 64 px can be"));
        } else if self.pixel_offset.is_empty() {
            let after_flip = |px: f64, flip: bool| if flip { -px } else { px };
            self.pixel_offset = vec![after_flip(x, self.flip_x), after_flip(y, self.flip_y)];
        }
        if is_distorted {
            let note =
                Diagnostic::note(format!("{topic}: the camera's lens distorts, and the frames are taken as rectified"));
            notes.push(note.help("if they are not, rectify them first (image_proc)"));
        }
    }

    fn frame_rate_hz(&self) -> f64 {
        self.frame_rate_hz.unwrap_or(25.0)
    }

    /// Builds the depth camera from the options. Mistakes go to `problems`.
    fn depth_camera(&self, problems: &mut Diagnostics) -> DepthCamera {
        let mut wrong = |message: String, help: &str| problems.push(Diagnostic::new(message).help(help));
        let is_perspective = self.is_perspective();
        let plane_mm = self.plane_mm.unwrap_or(0.0);
        if self.plane_mm.is_some_and(|mm| !(mm.is_finite() && mm >= 0.0 && (mm > 0.0 || !is_perspective))) {
            let help = "it is a distance: above 0, or 0 where values are heights over the pad and rays are parallel";
            wrong(format!("--plane-mm {plane_mm} is out of range"), help);
        }
        if let Some(mm) = self.max_depth_mm.filter(|mm| mm.is_nan() || *mm <= plane_mm) {
            wrong(format!("--max-depth-mm {mm} is not beyond --plane-mm {plane_mm}"), "the pad is seen as far as that");
        }
        let offset_px = match *self.pixel_offset.as_slice() {
            [] => [0.0; 2],
            [x, y] if x.abs() <= 64.0 && y.abs() <= 64.0 => [x, y],
            _ => {
                wrong(
                    String::from("--pixel-offset is two numbers of -64 to 64"),
                    "for example --pixel-offset=0.5,-0.5",
                );
                [0.0; 2]
            }
        };
        let projection = match (is_perspective, self.fov_y_deg) {
            (false, None) => DepthProjection::Orthographic,
            (true, Some(fov_y_deg)) if fov_y_deg > 0.0 && fov_y_deg <= 170.0 => {
                DepthProjection::Perspective { fov_y_deg }
            }
            (true, Some(fov)) => {
                wrong(format!("--fov-y-deg {fov} is out of range"), "allowed: above 0, up to 170 degrees");
                DepthProjection::Orthographic
            }
            (true, None) => {
                let help = "give the angle between the frame's upper and lower edge: --fov-y-deg F";
                wrong(String::from("--projection perspective needs its angle"), help);
                DepthProjection::Orthographic
            }
            (false, Some(_)) => {
                wrong(
                    String::from("--fov-y-deg belongs to --projection perspective"),
                    "add that, or leave the angle out",
                );
                DepthProjection::Orthographic
            }
        };
        DepthCamera {
            // Where it is missing that is a mistake already.
            unit: self.depth_unit.map_or(DepthUnit::Metre, UnitName::to_unit),
            plane_mm,
            max_depth_mm: self.max_depth_mm,
            background: self.background_value,
            flip: [self.flip_x, self.flip_y],
            offset_px,
            projection,
            along: match self.depth_along {
                AlongName::Axis => DistanceAlong::Axis,
                AlongName::Ray => DistanceAlong::Ray,
            },
        }
    }

    /// Makes the plan for a view of this size, or of the size that `--set` gives.
    fn plan_for_view(&self, resolution_px: [usize; 2], known: &[FrameMetadata]) -> Result<Plan, Report> {
        let set = self.set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        let overrides = Overrides { set, fidelity: self.fidelity };
        let classes: Vec<String> = known.iter().map(|known| known.class.clone()).collect();
        let frames = FrameSettings {
            sensor: &self.sensor,
            resolution_px,
            layers: &self.layers,
            classes: &classes,
            moved: known.iter().any(FrameMetadata::is_moved),
            sequence: self.sequence.is_some(),
            overrides: &overrides,
        };
        let plan = frames.resolve_plan()?;
        self.check_camera_place(plan.simulator.sensor())?;
        if self.sequence.is_some() && (frames.moved || plan.job().shear.has_motion()) {
            let help =
                "leave shear_x_mm, shear_y_mm, twist_deg and [shear] out: in a sequence the poses move the object";
            return Err(user_error("--sequence and motion after the press exclude each other", help));
        }
        if self.sequence.is_some() {
            let model = &plan.simulator.models().gelpad;
            if let Some(strain) = model.strain_settings() {
                let (what, help) = match strain.thorough {
                    true => ("the fidelity level finite-strain", "choose --fidelity high"),
                    false => ("gelpad.elastic.strain_correction", "leave it out"),
                };
                let message = format!("{what} is for single presses, not for the frames of a sequence");
                return Err(user_error(message, help));
            }
            if !model.knows_tractions() {
                let help = "choose --fidelity draft or better";
                return Err(user_error(
                    "this model of the gelpad knows no tractions, which a sequence carries on",
                    help,
                ));
            }
            if model.friction().is_some() {
                let help = "leave gelpad.elastic.friction out";
                return Err(user_error("a sequence has a friction of its own", help));
            }
        }
        match plan.open_fidelity_choice() {
            None => Ok(plan),
            Some(_) => {
                let help = "name a level with --fidelity; gelsim tradeoff shows what each costs";
                Err(user_error("no fidelity level can be chosen by frames: a bound is tried on a job's samples", help))
            }
        }
    }

    /// Checks that the camera's place is said once: by `--plane-mm` on a flat pad, by the sensor's lens on a gel that
    /// has a shape.
    fn check_camera_place(&self, sensor: &Sensor) -> Result<(), Report> {
        let by_lens = sensor.shape.is_some() && (sensor.lens != LensModel::Orthographic || self.is_perspective());
        match (by_lens, self.plane_mm) {
            (false, None) => {
                let help = "give the distance of the undeformed pad's surface from the camera";
                return Err(user_error("--plane-mm is needed for this sensor", help));
            }
            (true, Some(_)) => {
                let message = "--plane-mm is for flat pads, and this sensor's gel has a shape";
                return Err(user_error(message, "leave it out: the frame's camera stands where [sensor.lens] says"));
            }
            _ => {}
        }
        if by_lens && self.projection == Some(ProjectionName::Orthographic) {
            let message = "--projection orthographic is for flat pads, and this sensor's gel has a shape";
            let help = "leave it out for frames of the sensor's own lens; or render a pinhole's in its place, and say \
                        --projection perspective --fov-y-deg F";
            return Err(user_error(message, help));
        }
        Ok(())
    }

    /// Makes the plan for frames of this size. With parallel rays their pixels are the image's.
    fn plan_for_frames(&self, size: Option<[usize; 2]>, known: &[FrameMetadata]) -> Result<Plan, Report> {
        let size = size.filter(|_| !self.is_perspective());
        let plan = self.plan_for_view(size.map_or_else(|| standalone::read_resolution_px(&self.sensor), Ok)?, known)?;
        match size {
            Some([width, height]) if [width, height] != plan.simulator.view().resolution_px => {
                let message = format!("the frames have {width}x{height} px, and --set gives the sensor other ones");
                Err(user_error(message, "leave sensor.resolution_px out: the frames' pixels are the image's"))
            }
            _ => Ok(plan),
        }
    }

    fn render_files(
        self,
        out: &Path,
        found: FoundFrames,
        camera: DepthCamera,
        mut problems: Diagnostics,
    ) -> Result<(), Failure> {
        let log = Log::plain_text(self.quiet);
        let FoundFrames { files, sources, known: of_log, notes } = found;
        match is_log_name(out) {
            true if out.is_dir() => {
                let problem = Diagnostic::new(format!("{} is a folder", out.display()));
                problems.push(problem.help("choose a file with --out"));
            }
            true if files.iter().any(|file| is_within(out, file)) => {
                let problem = Diagnostic::new(format!("{} would be written over", out.display()));
                problems.push(problem.help("choose another file with --out"));
            }
            false if out.exists() && !out.is_dir() => {
                let problem = Diagnostic::new(format!("{} is not a folder", out.display()));
                problems.push(problem.help("choose a folder with --out"));
            }
            _ => {}
        }
        if self.threads.is_some_and(|threads| !(1..=MAX_THREADS).contains(&threads)) {
            let help = format!("give 1 to {MAX_THREADS}, or leave it out for all cores");
            problems.push(Diagnostic::new("--threads is out of range").help(help));
        }
        let known = self.poses.as_ref().map(|path| poses::read_poses(path, &sources)).transpose();
        let known = known.map(|known| known.or(of_log));
        // The size of the first readable frame: the others are checked against it.
        let size = sources.iter().find_map(|source| source.read().ok()).map(|frame| [frame.width, frame.height]);
        let plan =
            self.plan_for_frames(size, known.as_ref().ok().and_then(|known| known.as_deref()).unwrap_or_default());
        let report = Report::new(&problems, &[]);
        let (known, plan) = match (known, plan) {
            (Ok(known), Ok(plan)) => (known, plan),
            (known, plan) => {
                let reports = [known.err(), plan.err()].into_iter().flatten();
                return Err(reports.fold(report, Report::merged_with).into());
            }
        };
        let own = plan.simulator.sensor().resolution_px;
        let reader = match FrameReader::new(camera, &plan.simulator, size.unwrap_or(own)) {
            Ok(reader) => reader,
            Err(problem) => {
                let first = sources.first().map_or_else(PathBuf::new, |source| source.path.clone());
                let message = format!("{}: {}", first.display(), problem.message);
                problems.push(Diagnostic { message, ..problem });
                return Err(Report::new(&problems, &[]).into());
            }
        };
        let request = FrameRequest {
            sources: &sources,
            camera,
            reader,
            metadata: known,
            out,
            frame_rate_hz: self.frame_rate_hz(),
            sequence: self.sequence_options(),
            no_contact_ok: self.no_contact_ok,
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads.unwrap_or(0)).build();
        let pool = pool.map_err(|error| threads_failure(&error))?;
        let reaches = match (pool.install(|| check_frames(&plan, &request)), report.is_empty()) {
            (Ok(reaches), true) => reaches,
            (Ok(_), false) => return Err(report.into()),
            (Err(found), _) => return Err(report.merged_with(found).into()),
        };
        log.print_notes(&Report::new(&notes, &[]));
        log.print_notes(&plan.notes);
        log.print_notes(&collect_notes(&reaches, &sources, plan.thickness_mm()));
        pool.install(|| render_frames(&plan, &request)).map_err(|stopped| match stopped {
            RenderError::Io(path, error) => Failure::from_path(&path, &error),
            RenderError::Changed(path, reason) => {
                Failure::runtime(format!("{} has changed since it was checked: {reason}", path.display()))
            }
            RenderError::Unhealthy(path, reason) => Failure::runtime(format!("{}: {reason}", path.display())),
        })?;
        let touching = reaches.iter().filter(|reach| reach.touches_pad()).count();
        if !self.quiet {
            print_to_stderr(&format!(
                "{}, {touching} in contact -> {}",
                format_frame_count(sources.len()),
                out.display()
            ));
        }
        Ok(())
    }

    fn sequence_options(&self) -> Option<SequenceSettings> {
        self.sequence.map(|friction| SequenceSettings { friction, frame_rate_hz: self.frame_rate_hz() })
    }

    fn is_perspective(&self) -> bool {
        self.projection == Some(ProjectionName::Perspective)
    }
}

/// The frames that are rendered, and what is known of them.
struct FoundFrames {
    /// The files, and the logs.
    files: Vec<PathBuf>,
    sources: Vec<FrameSource>,
    /// What a log tells of the object in each frame.
    known: Option<Vec<FrameMetadata>>,
    notes: Diagnostics,
}

/// The parts that a log has lost of which each is named.
const MAX_LOSSES: usize = 5;

/// The most by which focal lengths along x and y may differ, as a fraction: rays are computed for square pixels.
const MAX_STRETCH: f64 = 0.005;

/// Returns true if a path is a file or in a folder, both of which exist.
fn is_within(path: &Path, other: &Path) -> bool {
    matches!((path.canonicalize(), other.canonicalize()), (Ok(path), Ok(other)) if path.starts_with(&other))
}

impl UnitName {
    fn to_unit(self) -> DepthUnit {
        match self {
            Self::M => DepthUnit::Metre,
            Self::Mm => DepthUnit::Millimetre,
            Self::Um => DepthUnit::Micrometre,
        }
    }

    fn from_unit(unit: DepthUnit) -> Self {
        match unit {
            DepthUnit::Metre => Self::M,
            DepthUnit::Millimetre => Self::Mm,
            DepthUnit::Micrometre => Self::Um,
        }
    }
}

fn format_frame_count(count: usize) -> String {
    if count == 1 { String::from("1 frame") } else { format!("{count} frames") }
}

/// Collects notes on frames that are no mistakes: what goes through the pad, what the camera did not see.
fn collect_notes(reaches: &[FrameReach], sources: &[FrameSource], thickness_mm: f64) -> Report {
    let worst = |count: fn(&FrameReach) -> u64, what: &str, help: String| {
        let with = reaches.iter().filter(|reach| count(reach) > 0).count();
        let (most, source) = reaches.iter().map(count).zip(sources).max_by_key(|(most, _)| *most)?;
        let source = source.path.display();
        let message = format!("{with} of {}: {what}, most in {source} ({most} px)", format_frame_count(reaches.len()));
        (with > 0).then(|| Diagnostic::note(message).help(help))
    };
    let through = worst(
        |reach| reach.through_px,
        "something goes through the pad and is cut off at its thickness",
        format!("press less deep: the pad is {thickness_mm} mm thick (--set sensor.gelpad_thickness_mm=..)"),
    );
    let unseen = worst(
        |reach| reach.unseen_px,
        "parts of the view were hidden from the camera and are taken to be empty",
        String::from("render with parallel rays, or from where all of the view is seen"),
    );
    let mut found = Diagnostics::default();
    found.extend([through, unseen].into_iter().flatten());
    Report::new(&found, &[])
}
