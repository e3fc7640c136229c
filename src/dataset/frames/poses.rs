//! Reads what is known of the objects in depth frames from a CSV file: names for the labels, poses, and motion in the
//! pad's plane.
//!
//! There is one row per frame, found by the frame's name. Columns may be in any order. An empty cell counts as a
//! missing column, except for classes: either every frame has one, or none has.

use std::collections::HashMap;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::source::{FrameSource, frame_stem};
use gelsim_core::gelpad::elastic::shear::Motion;
use gelsim_core::pose::{Angles, Pose};
use gelsim_files::csv_table::{self, TableRow, row_place};
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input;
use gelsim_files::spelling::find_nearest_name;
use gelsim_files::spelling::join_alternatives;

/// Most bytes of a table.
const MAX_BYTES: u64 = 256 << 20;

const FILE: &str = "file";
const ID: &str = "id";
const CLASS: &str = "class";
const QUATERNION: [&str; 4] = ["quaternion_x", "quaternion_y", "quaternion_z", "quaternion_w"];
const POSITION: [&str; 3] = ["x_mm", "y_mm", "z_mm"];
const MOTION: [&str; 3] = ["shear_x_mm", "shear_y_mm", "twist_deg"];
const COLUMNS: [&str; 13] = [
    FILE,
    ID,
    CLASS,
    QUATERNION[0],
    QUATERNION[1],
    QUATERNION[2],
    QUATERNION[3],
    POSITION[0],
    POSITION[1],
    POSITION[2],
    MOTION[0],
    MOTION[1],
    MOTION[2],
];
/// The greatest motion along x and y, mm, and the greatest twist, degrees, as in a job.
const MAX_MOTION: [f64; 3] = [10.0, 10.0, 45.0];

/// What is known of the object in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMetadata {
    /// Its name; the frame's if the table has none.
    pub id: String,
    /// Its class; empty if the table has none for any frame.
    pub class: String,
    /// Its pose in the sensor's frame; without rotation at the origin if the table does not give it.
    pub pose: Pose,
    /// Its motion in the pad's plane, about its origin.
    pub motion: Motion,
}

impl FrameMetadata {
    /// Makes the metadata of a frame of which only the name is known.
    pub fn from_id(id: &str) -> Self {
        let pose = pose_from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0; 3]);
        let motion = Motion { shift_mm: [0.0; 2], twist_rad: 0.0, about_mm: [0.0; 2] };
        Self { id: id.to_owned(), class: String::new(), pose, motion }
    }

    /// Returns true if the object is moved.
    pub fn is_moved(&self) -> bool {
        self.motion.shift_mm != [0.0; 2] || self.motion.twist_rad != 0.0
    }
}

/// Reads the table at `path` and returns what is known of each of `sources`, in their order. The error is a report on
/// all that is wrong with it.
pub fn read_poses(path: &Path, sources: &[FrameSource]) -> Result<Vec<FrameMetadata>, Report> {
    let bytes = input::read(path, MAX_BYTES).map_err(|error| {
        let message = format!("cannot read the poses {}: {error}", path.display());
        user_error(message, format!("a CSV file with the columns {} belongs here", join_alternatives(&COLUMNS)))
    })?;
    parse_poses(path, &bytes, sources)
}

/// Parses the table in the bytes of the file `path`, as [`read_poses`] does.
pub fn parse_poses(path: &Path, bytes: &[u8], sources: &[FrameSource]) -> Result<Vec<FrameMetadata>, Report> {
    let source = csv_table::decode_source(path, bytes)?;
    let mut problems = Diagnostics::default();
    let known = read_table(&source.text, sources, &mut problems);
    if problems.is_empty() { Ok(known) } else { Err(Report::new(&problems, &[source])) }
}

fn read_table(text: &str, sources: &[FrameSource], problems: &mut Diagnostics) -> Vec<FrameMetadata> {
    let mut rows = csv_table::iter_rows(text);
    let Some(header) = rows.next() else {
        let problem = Diagnostic::new("the table of poses is empty");
        problems.push(problem.help("its first line names the columns, each further one is a frame"));
        return Vec::new();
    };
    let Some(layout) = ColumnLayout::from_header(&header, problems) else { return Vec::new() };
    let frames: HashMap<&str, usize> = sources.iter().enumerate().map(|(at, s)| (s.stem.as_str(), at)).collect();
    let mut known: Vec<Option<(u64, FrameMetadata)>> = vec![None; sources.len()];
    // Even a row with an error is about its frame, which then is not reported as missing.
    let mut mentioned = vec![false; sources.len()];
    let (mut classed, mut unclassed) = (false, Vec::new());
    for row in rows {
        if problems.is_full() {
            break;
        }
        let file = row.cell(layout.file);
        let at = frame_stem(Path::new(file)).and_then(|stem| frames.get(stem.as_str()));
        if let Some(at) = at {
            mentioned[*at] = true;
        }
        let Some(found) = layout.read_row(&row, problems) else { continue };
        classed |= !found.class.is_empty();
        if let Some(index) = layout.column_index(CLASS).filter(|_| found.class.is_empty()) {
            unclassed.push(row.error_in_cell(index, "`class` is empty, and other rows name theirs"));
        }
        match at {
            None => problems.push(
                row.error_in_cell(layout.file, format!("no frame is called `{file}`"))
                    .help("name a file of --depth, with or without its folder and ending; or remove the row"),
            ),
            Some(at) => match &known[*at] {
                Some((line, _)) => problems.push(
                    row.error_in_cell(layout.file, format!("`{file}` is on line {line}, too"))
                        .help("keep one of the two rows"),
                ),
                None => known[*at] = Some((row.line, found)),
            },
        }
    }
    if classed {
        let help = "name a class in every row: an empty cell would count as a class of its own; or leave all empty";
        unclassed.into_iter().for_each(|problem| problems.push(problem.help(help)));
    }
    let without =
        || mentioned.iter().zip(sources).filter(|(mentioned, _)| !**mentioned).map(|(_, source)| &source.stem);
    if let Some(first) = without().next() {
        let count = without().count();
        let more = if count > 1 { format!(" and {} more", count - 1) } else { String::new() };
        let problem = header.error_in_cell(0, format!("no row is about the frame `{first}`{more}"));
        problems.push(problem.help("give every frame a row, or leave --poses out"));
    }
    let named = |(known, source): (Option<(u64, FrameMetadata)>, &FrameSource)| {
        let (_, mut known) = known?;
        if known.id.is_empty() {
            known.id.clone_from(&source.stem);
        }
        Some(known)
    };
    known.into_iter().zip(sources).filter_map(named).collect()
}

/// The columns of the table, by the cells of a row.
struct ColumnLayout {
    file: usize,
    names: Vec<String>,
}

impl ColumnLayout {
    fn from_header(header: &TableRow, problems: &mut Diagnostics) -> Option<Self> {
        let names: Vec<String> = header.cells.iter().map(|name| name.trim().to_owned()).collect();
        for (at, name) in names.iter().enumerate() {
            if !COLUMNS.contains(&name.as_str()) {
                let hint =
                    find_nearest_name(name, COLUMNS).map_or(String::new(), |near| format!("is `{near}` meant? "));
                let problem = header.error_in_cell(at, format!("unknown column `{name}`"));
                problems.push(problem.help(format!("{hint}columns: {}", COLUMNS.join(", "))));
            } else if names[..at].contains(name) {
                problems
                    .push(header.error_in_cell(at, format!("the column `{name}` is there twice")).help("remove one"));
            }
        }
        for (group, what) in [(QUATERNION.as_slice(), "a rotation"), (POSITION.as_slice(), "a position")] {
            let absent: Vec<&str> =
                group.iter().copied().filter(|column| !names.iter().any(|name| name == column)).collect();
            if !absent.is_empty() && absent.len() < group.len() {
                let problem = header
                    .error_in_cell(0, format!("half of {what}: no column is called {}", join_alternatives(&absent)));
                problems.push(problem.help(format!("{what} is {}: all or none", group.join(", "))));
            }
        }
        let file = names.iter().position(|name| name == FILE);
        if file.is_none() {
            problems.push(header.error_in_cell(0, "no column is called `file`").help("it names the frame of each row"));
        }
        Some(Self { file: file?, names })
    }

    fn column_index(&self, column: &str) -> Option<usize> {
        self.names.iter().position(|name| name == column)
    }

    fn cell_text<'a>(&self, row: &'a TableRow, column: &str) -> &'a str {
        self.column_index(column).map_or("", |index| row.cell(index))
    }

    /// Reads a row. A missing id stays empty. Returns `None` after an error in it.
    fn read_row(&self, row: &TableRow, problems: &mut Diagnostics) -> Option<FrameMetadata> {
        if row.cells.len() != self.names.len() {
            let message = format!("the row has {} cells, and there are {} columns", row.cells.len(), self.names.len());
            let help = "write a comma for each empty cell, and a cell with a comma in quotes";
            problems.push(Diagnostic::new(message).at(row_place(row.text, row.start)).help(help));
            return None;
        }
        if row.cell(self.file).is_empty() {
            problems.push(row.error_in_cell(self.file, "`file` is empty").help("name the frame, or remove the row"));
            return None;
        }
        let quaternion = self.read_numbers(row, QUATERNION, problems);
        let position = self.read_numbers(row, POSITION, problems);
        let motion = MOTION.map(|column| self.read_number(row, column, problems));
        let quaternion = match quaternion? {
            Some(q) => self.normalise_quaternion(row, q, problems)?,
            None => [0.0, 0.0, 0.0, 1.0],
        };
        let position = position?.unwrap_or([0.0; 3]);
        let [x, y, twist_deg] = self.check_motion(row, motion, problems)?;
        Some(FrameMetadata {
            id: self.cell_text(row, ID).to_owned(),
            class: self.cell_text(row, CLASS).to_owned(),
            pose: pose_from_quaternion(quaternion, position),
            motion: Motion {
                shift_mm: [x, y],
                twist_rad: twist_deg.to_radians(),
                about_mm: [position[0], position[1]],
            },
        })
    }

    /// Reads numbers that have a meaning only together. Returns `Some(None)` if all are missing, and `None` after an
    /// error.
    fn read_numbers<const N: usize>(
        &self,
        row: &TableRow,
        columns: [&str; N],
        problems: &mut Diagnostics,
    ) -> Option<Option<[f64; N]>> {
        let numbers = columns.map(|column| self.read_number(row, column, problems));
        let empty = columns.map(|column| self.cell_text(row, column).is_empty());
        if empty.iter().all(|empty| *empty) {
            return Some(None);
        }
        if let Some(at) = empty.iter().position(|empty| *empty) {
            // A missing column was reported with the header, so only an empty cell is reported here.
            let index = self.column_index(columns[at])?;
            let problem = row.error_in_cell(index, format!("`{}` is empty", columns[at]));
            problems.push(problem.help(format!("{} belong together: all or none", columns.join(", "))));
            return None;
        }
        let mut all = [0.0; N];
        for (to, number) in all.iter_mut().zip(numbers) {
            *to = number??;
        }
        Some(Some(all))
    }

    /// Reads the number in a cell. Returns `Some(None)` if it is empty, and `None` after an error.
    fn read_number(&self, row: &TableRow, column: &str, problems: &mut Diagnostics) -> Option<Option<f64>> {
        let Some(index) = self.column_index(column) else { return Some(None) };
        let text = row.cell(index);
        match text.parse::<f64>() {
            _ if text.is_empty() => Some(None),
            Ok(number) if number.is_finite() => Some(Some(number)),
            _ => {
                let problem = row.error_in_cell(index, format!("`{column}`: `{text}` is not a number"));
                problems.push(problem.help("write a finite number with a point, without its unit"));
                None
            }
        }
    }

    /// Normalises a quaternion, whose length must be nearly 1.
    fn normalise_quaternion(&self, row: &TableRow, q: [f64; 4], problems: &mut Diagnostics) -> Option<[f64; 4]> {
        let length = q.iter().map(|part| part * part).sum::<f64>().sqrt();
        if (length - 1.0).abs() <= 1e-3 {
            return Some(q.map(|part| part / length));
        }
        // The column exists, or no quaternion would have been read.
        let problem =
            row.error_in_cell(self.column_index(QUATERNION[0])?, format!("the quaternion has length {length}"));
        problems.push(problem.help("a rotation is a quaternion of length 1; x, y, z first, then w"));
        None
    }

    /// Checks that a motion is within the limits of a job's shear. An empty cell is no motion.
    fn check_motion(
        &self,
        row: &TableRow,
        motion: [Option<Option<f64>>; 3],
        problems: &mut Diagnostics,
    ) -> Option<[f64; 3]> {
        let mut all = [0.0; 3];
        for (k, number) in motion.into_iter().enumerate() {
            all[k] = number?.unwrap_or(0.0);
            if all[k].abs() > MAX_MOTION[k] {
                let problem = row.error_in_cell(
                    self.column_index(MOTION[k])?,
                    format!("`{}` = {} is out of range", MOTION[k], all[k]),
                );
                problems.push(problem.help(format!("allowed: -{0} to {0}", MAX_MOTION[k])));
                return None;
            }
        }
        Some(all)
    }
}

/// Returns the pose of an object that is rotated by the unit quaternion x, y, z, w. Its angles are those of a job with
/// `face = "-z"`.
fn pose_from_quaternion([x, y, z, w]: [f64; 4], position_mm: [f64; 3]) -> Pose {
    // Split the rotation into a turn about z (twist) and then one about an axis in the plane (swing).
    let yaw = 2.0 * libm::atan2(z, w);
    let tilt = 2.0 * libm::atan2(libm::hypot(x, y), libm::hypot(z, w));
    let (sin, cos) = (libm::sin(yaw / 2.0), libm::cos(yaw / 2.0));
    let axis = [x * cos - y * sin, y * cos + x * sin];
    let azimuth = if tilt == 0.0 { 0.0 } else { libm::atan2(axis[1], axis[0]) };
    let turn = |angle: f64| angle.to_degrees().rem_euclid(360.0);
    Pose {
        rotation: DMat3::from_quat(DQuat::from_xyzw(x, y, z, w)),
        translation_mm: DVec3::from_array(position_mm),
        angles: Angles { yaw_deg: turn(yaw), tilt_deg: tilt.to_degrees(), tilt_azimuth_deg: turn(azimuth) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn sources(names: &[&str]) -> Vec<FrameSource> {
        names
            .iter()
            .map(|name| FrameSource { path: PathBuf::from(name), stem: (*name).to_owned(), message: None })
            .collect()
    }

    fn refused(text: &str) -> String {
        parse_poses(Path::new("poses.csv"), text.as_bytes(), &sources(&["a", "b"])).expect_err("refused").to_string()
    }

    #[test]
    fn rows_are_told_by_the_frames_names_and_empty_cells_are_not_there() {
        let text = "twist_deg,file,id,class,x_mm,y_mm,z_mm\n,frames/b.npy,ball,round,1,2,-0.5\n30,a,,cube,,,\n";
        let known = parse_poses(Path::new("poses.csv"), text.as_bytes(), &sources(&["a", "b"])).expect("a sound table");
        assert_eq!((known[0].id.as_str(), known[0].class.as_str()), ("a", "cube"));
        assert!((known[0].motion.twist_rad - 30_f64.to_radians()).abs() < 1e-15 && known[0].is_moved());
        assert_eq!((known[1].id.as_str(), known[1].class.as_str()), ("ball", "round"));
        assert_eq!(known[1].pose.translation_mm, DVec3::new(1.0, 2.0, -0.5));
        assert_eq!(known[1].motion.about_mm, [1.0, 2.0]);
        assert!(!known[1].is_moved());
    }

    #[test]
    fn every_mistake_is_told_with_its_cell() {
        for (text, part, place) in [
            ("file,yaw\na,1\nb,2\n", "unknown column `yaw`", "poses.csv:1:6"),
            ("file,x_mm\na,1\nb,2\n", "half of a position: no column is called `y_mm` or `z_mm`", "poses.csv:1:1"),
            ("file\na\nb\nc\n", "no frame is called `c`", "poses.csv:4:1"),
            ("file\na\n", "no row is about the frame `b`", "poses.csv:1:1"),
            ("file\na\nb\na.npy\n", "`a.npy` is on line 2, too", "poses.csv:4:1"),
            ("file,twist_deg\na,1\nb,x\n", "`x` is not a number", "poses.csv:3:3"),
            ("file,twist_deg\na,1\nb,50\n", "out of range", "poses.csv:3:3"),
            ("file,x_mm,y_mm,z_mm\na,1,,3\nb,,,\n", "`y_mm` is empty", "poses.csv:2:5"),
            ("file,class\na,ball\nb,\n", "`class` is empty", "poses.csv:3:3"),
            ("id\na\n", "no column is called `file`", "poses.csv:1:1"),
            ("file,id\na\nb,\n", "the row has 1 cells", "poses.csv:2:1"),
        ] {
            let said = refused(text);
            assert!(said.contains(part) && said.contains(place), "{text}: {said}");
        }
        let quaternion = "file,quaternion_x,quaternion_y,quaternion_z,quaternion_w\na,0,0,0,2\nb,0,0,0,1\n";
        assert!(refused(quaternion).contains("length 2"));
        assert!(refused("").contains("empty"));
        let half = refused("file,x_mm\na,1\nb,2\n");
        assert_eq!(half.matches("error").count(), 1, "what the header lacks is not said of each row: {half}");
    }

    #[test]
    fn no_frame_needs_a_class_if_none_has_one() {
        let known = parse_poses(Path::new("poses.csv"), b"file,class\na,\nb,\n", &sources(&["a", "b"])).expect("sound");
        assert!(known.iter().all(|known| known.class.is_empty()));
    }

    #[test]
    fn angles_give_the_rotation_again() {
        for q in [[0.1, 0.2, 0.3, 0.9], [0.0, 0.0, 0.6, -0.8], [-0.5, 0.5, 0.1, 0.2], [0.0, 0.0, 0.0, 1.0]] {
            let length = f64::sqrt(q.iter().map(|part| part * part).sum());
            let pose = pose_from_quaternion(q.map(|part| part / length), [0.0; 3]);
            let [yaw, tilt, azimuth] =
                [pose.angles.yaw_deg, pose.angles.tilt_deg, pose.angles.tilt_azimuth_deg].map(f64::to_radians);
            let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
            let again = DMat3::from_axis_angle(axis, tilt) * DMat3::from_rotation_z(yaw);
            assert!(again.abs_diff_eq(pose.rotation, 1e-12), "{q:?}");
            assert!((0.0..=180.0).contains(&pose.angles.tilt_deg));
        }
    }
}
