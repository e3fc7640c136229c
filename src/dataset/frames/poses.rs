//! What is known of the objects in depth frames, from a CSV file: names for the labels, poses, motion in the pad's plane.
//!
//! A row per frame, told by the frame's name. Columns may stand in any order; an empty cell is as if its column were not
//! there, but for classes: every frame has one, or none has.

use std::collections::HashMap;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::source::{Source, stem};
use gelsim_core::gelpad::elastic::shear::Motion;
use gelsim_core::pose::{Angles, Pose};
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input;
use gelsim_files::rows::{self, Row, row_place};
use gelsim_files::spelling::nearest;
use gelsim_files::spelling::one_of;

/// Largest table, bytes.
const MOST_BYTES: u64 = 256 << 20;

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
/// Largest motion along x and y, mm, and largest twist, degrees: those of a job.
const MOST_MOTION: [f64; 3] = [10.0, 10.0, 45.0];

/// What is known of one frame's object.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMetadata {
    /// Its name; the frame's if the table has none.
    pub id: String,
    /// Its class; empty if the table has none for any frame.
    pub class: String,
    /// Where it is, in the sensor's frame; at the origin, unturned, if the table does not say.
    pub pose: Pose,
    /// How it is moved in the pad's plane, about its origin.
    pub motion: Motion,
}

impl FrameMetadata {
    /// Of a frame of which nothing is known but its name.
    pub fn nothing(id: &str) -> Self {
        let pose = pose([0.0, 0.0, 0.0, 1.0], [0.0; 3]);
        let motion = Motion { shift_mm: [0.0; 2], twist_rad: 0.0, about_mm: [0.0; 2] };
        Self { id: id.to_owned(), class: String::new(), pose, motion }
    }

    /// True if it is moved.
    pub fn is_moved(&self) -> bool {
        self.motion.shift_mm != [0.0; 2] || self.motion.twist_rad != 0.0
    }
}

/// Reads the table at `path` and gives what is known of each of `sources`, in their order.
pub fn read(path: &Path, sources: &[Source]) -> Result<Vec<FrameMetadata>, Report> {
    let bytes = input::read(path, MOST_BYTES).map_err(|error| {
        let message = format!("cannot read the poses {}: {error}", path.display());
        user_error(message, format!("a CSV file with the columns {} belongs here", one_of(&COLUMNS)))
    })?;
    parse(path, &bytes, sources)
}

/// The same from the bytes of the file `path`.
pub fn parse(path: &Path, bytes: &[u8], sources: &[Source]) -> Result<Vec<FrameMetadata>, Report> {
    let source = rows::source(path, bytes)?;
    let mut problems = Diagnostics::default();
    let known = table(&source.text, sources, &mut problems);
    if problems.is_empty() { Ok(known) } else { Err(Report::new(&problems, &[source])) }
}

fn table(text: &str, sources: &[Source], problems: &mut Diagnostics) -> Vec<FrameMetadata> {
    let mut rows = rows::rows(text);
    let Some(header) = rows.next() else {
        let problem = Diagnostic::new("the table of poses is empty");
        problems.push(problem.help("its first line names the columns, each further one is a frame"));
        return Vec::new();
    };
    let Some(layout) = Layout::from_header(&header, problems) else { return Vec::new() };
    let frames: HashMap<&str, usize> = sources.iter().enumerate().map(|(at, s)| (s.stem.as_str(), at)).collect();
    let mut known: Vec<Option<(u64, FrameMetadata)>> = vec![None; sources.len()];
    // A row that cannot be read is about its frame all the same.
    let mut mentioned = vec![false; sources.len()];
    let (mut classed, mut unclassed) = (false, Vec::new());
    for row in rows {
        if problems.is_full() {
            break;
        }
        let file = row.cell(layout.file);
        let at = stem(Path::new(file)).and_then(|stem| frames.get(stem.as_str()));
        if let Some(at) = at {
            mentioned[*at] = true;
        }
        let Some(found) = layout.known(&row, problems) else { continue };
        classed |= !found.class.is_empty();
        if let Some(index) = layout.index(CLASS).filter(|_| found.class.is_empty()) {
            unclassed.push(row.wrong(index, "`class` is empty, and other rows name theirs"));
        }
        match at {
            None => problems.push(
                row.wrong(layout.file, format!("no frame is called `{file}`"))
                    .help("name a file of --depth, with or without its folder and ending; or remove the row"),
            ),
            Some(at) => match &known[*at] {
                Some((line, _)) => problems.push(
                    row.wrong(layout.file, format!("`{file}` is on line {line}, too")).help("keep one of the two rows"),
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
        let problem = header.wrong(0, format!("no row is about the frame `{first}`{more}"));
        problems.push(problem.help("give every frame a row, or leave --poses out"));
    }
    let named = |(known, source): (Option<(u64, FrameMetadata)>, &Source)| {
        let (_, mut known) = known?;
        if known.id.is_empty() {
            known.id.clone_from(&source.stem);
        }
        Some(known)
    };
    known.into_iter().zip(sources).filter_map(named).collect()
}

/// In which cells of a row the columns stand.
struct Layout {
    file: usize,
    names: Vec<String>,
}

impl Layout {
    fn from_header(header: &Row, problems: &mut Diagnostics) -> Option<Self> {
        let names: Vec<String> = header.cells.iter().map(|name| name.trim().to_owned()).collect();
        for (at, name) in names.iter().enumerate() {
            if !COLUMNS.contains(&name.as_str()) {
                let hint = nearest(name, COLUMNS).map_or(String::new(), |near| format!("is `{near}` meant? "));
                let problem = header.wrong(at, format!("unknown column `{name}`"));
                problems.push(problem.help(format!("{hint}columns: {}", COLUMNS.join(", "))));
            } else if names[..at].contains(name) {
                problems.push(header.wrong(at, format!("the column `{name}` is there twice")).help("remove one"));
            }
        }
        for (whole, what) in [(QUATERNION.as_slice(), "a rotation"), (POSITION.as_slice(), "a position")] {
            let absent: Vec<&str> =
                whole.iter().copied().filter(|column| !names.iter().any(|name| name == column)).collect();
            if !absent.is_empty() && absent.len() < whole.len() {
                let problem = header.wrong(0, format!("half of {what}: no column is called {}", one_of(&absent)));
                problems.push(problem.help(format!("{what} is {}: all or none", whole.join(", "))));
            }
        }
        let file = names.iter().position(|name| name == FILE);
        if file.is_none() {
            problems.push(header.wrong(0, "no column is called `file`").help("it names the frame of each row"));
        }
        Some(Self { file: file?, names })
    }

    fn index(&self, column: &str) -> Option<usize> {
        self.names.iter().position(|name| name == column)
    }

    fn text<'a>(&self, row: &'a Row, column: &str) -> &'a str {
        self.index(column).map_or("", |index| row.cell(index))
    }

    /// What a row says, a missing id left empty. None after a mistake in it.
    fn known(&self, row: &Row, problems: &mut Diagnostics) -> Option<FrameMetadata> {
        if row.cells.len() != self.names.len() {
            let message = format!("the row has {} cells, and there are {} columns", row.cells.len(), self.names.len());
            let help = "write a comma for each empty cell, and a cell with a comma in quotes";
            problems.push(Diagnostic::new(message).at(row_place(row.text, row.start)).help(help));
            return None;
        }
        if row.cell(self.file).is_empty() {
            problems.push(row.wrong(self.file, "`file` is empty").help("name the frame, or remove the row"));
            return None;
        }
        let quaternion = self.together(row, QUATERNION, problems);
        let position = self.together(row, POSITION, problems);
        let motion = MOTION.map(|column| self.number(row, column, problems));
        let quaternion = match quaternion? {
            Some(q) => self.unit(row, q, problems)?,
            None => [0.0, 0.0, 0.0, 1.0],
        };
        let position = position?.unwrap_or([0.0; 3]);
        let [x, y, twist_deg] = self.limited(row, motion, problems)?;
        Some(FrameMetadata {
            id: self.text(row, ID).to_owned(),
            class: self.text(row, CLASS).to_owned(),
            pose: pose(quaternion, position),
            motion: Motion {
                shift_mm: [x, y],
                twist_rad: twist_deg.to_radians(),
                about_mm: [position[0], position[1]],
            },
        })
    }

    /// Numbers that only mean something together; `Some(None)` if none is there, `None` after a mistake.
    fn together<const N: usize>(
        &self,
        row: &Row,
        columns: [&str; N],
        problems: &mut Diagnostics,
    ) -> Option<Option<[f64; N]>> {
        let numbers = columns.map(|column| self.number(row, column, problems));
        let empty = columns.map(|column| self.text(row, column).is_empty());
        if empty.iter().all(|empty| *empty) {
            return Some(None);
        }
        if let Some(at) = empty.iter().position(|empty| *empty) {
            // That a column is not there has been said of the header.
            let index = self.index(columns[at])?;
            let problem = row.wrong(index, format!("`{}` is empty", columns[at]));
            problems.push(problem.help(format!("{} belong together: all or none", columns.join(", "))));
            return None;
        }
        let mut all = [0.0; N];
        for (to, number) in all.iter_mut().zip(numbers) {
            *to = number??;
        }
        Some(Some(all))
    }

    /// The number in a cell; `Some(None)` if it is empty, `None` after a mistake.
    fn number(&self, row: &Row, column: &str, problems: &mut Diagnostics) -> Option<Option<f64>> {
        let Some(index) = self.index(column) else { return Some(None) };
        let text = row.cell(index);
        match text.parse::<f64>() {
            _ if text.is_empty() => Some(None),
            Ok(number) if number.is_finite() => Some(Some(number)),
            _ => {
                let problem = row.wrong(index, format!("`{column}`: `{text}` is not a number"));
                problems.push(problem.help("write a finite number with a point, without its unit"));
                None
            }
        }
    }

    /// A quaternion made one of length 1, which it must nearly be.
    fn unit(&self, row: &Row, q: [f64; 4], problems: &mut Diagnostics) -> Option<[f64; 4]> {
        let length = q.iter().map(|part| part * part).sum::<f64>().sqrt();
        if (length - 1.0).abs() <= 1e-3 {
            return Some(q.map(|part| part / length));
        }
        // It is there, or there would be no quaternion.
        let problem = row.wrong(self.index(QUATERNION[0])?, format!("the quaternion has length {length}"));
        problems.push(problem.help("a rotation is a quaternion of length 1; x, y, z first, then w"));
        None
    }

    /// Motion within the limits of a job's shear.
    fn limited(&self, row: &Row, motion: [Option<Option<f64>>; 3], problems: &mut Diagnostics) -> Option<[f64; 3]> {
        let mut all = [0.0; 3];
        for (k, number) in motion.into_iter().enumerate() {
            all[k] = number?.unwrap_or(0.0);
            if all[k].abs() > MOST_MOTION[k] {
                let problem =
                    row.wrong(self.index(MOTION[k])?, format!("`{}` = {} is out of range", MOTION[k], all[k]));
                problems.push(problem.help(format!("allowed: -{0} to {0}", MOST_MOTION[k])));
                return None;
            }
        }
        Some(all)
    }
}

/// The pose of an object turned by a unit quaternion x, y, z, w; its angles are those of a job with `face = "-z"`.
fn pose([x, y, z, w]: [f64; 4], position_mm: [f64; 3]) -> Pose {
    // A turn about z, then one about an axis in the plane: the swing and the twist of the rotation.
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

    fn sources(names: &[&str]) -> Vec<Source> {
        names.iter().map(|name| Source { path: PathBuf::from(name), stem: (*name).to_owned() }).collect()
    }

    fn refused(text: &str) -> String {
        parse(Path::new("poses.csv"), text.as_bytes(), &sources(&["a", "b"])).expect_err("refused").to_string()
    }

    #[test]
    fn rows_are_told_by_the_frames_names_and_empty_cells_are_not_there() {
        let text = "twist_deg,file,id,class,x_mm,y_mm,z_mm\n,frames/b.npy,ball,round,1,2,-0.5\n30,a,,cube,,,\n";
        let known = parse(Path::new("poses.csv"), text.as_bytes(), &sources(&["a", "b"])).expect("a sound table");
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
        let known = parse(Path::new("poses.csv"), b"file,class\na,\nb,\n", &sources(&["a", "b"])).expect("sound");
        assert!(known.iter().all(|known| known.class.is_empty()));
    }

    #[test]
    fn angles_give_the_rotation_again() {
        for q in [[0.1, 0.2, 0.3, 0.9], [0.0, 0.0, 0.6, -0.8], [-0.5, 0.5, 0.1, 0.2], [0.0, 0.0, 0.0, 1.0]] {
            let length = f64::sqrt(q.iter().map(|part| part * part).sum());
            let pose = pose(q.map(|part| part / length), [0.0; 3]);
            let [yaw, tilt, azimuth] =
                [pose.angles.yaw_deg, pose.angles.tilt_deg, pose.angles.tilt_azimuth_deg].map(f64::to_radians);
            let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
            let again = DMat3::from_axis_angle(axis, tilt) * DMat3::from_rotation_z(yaw);
            assert!(again.abs_diff_eq(pose.rotation, 1e-12), "{q:?}");
            assert!((0.0..=180.0).contains(&pose.angles.tilt_deg));
        }
    }
}
