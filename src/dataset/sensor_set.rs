//! The folder of a set: the same presses under several sensors, a dataset in a folder for each.
//!
//! `sensors.json` names the sensors. It is written before their folders, so a folder with datasets and without it is no
//! set.

use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::cleanup;
use super::dataset_error::DatasetError;
use super::versioned::Versioned;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input::{self, MAX_METADATA_BYTES};
use gelsim_files::number_format::format_number;
use gelsim_files::write::write_output;
use gelsim_job::plan::{CALIBRATION_FOLDER, SetMember};

/// Name of the file that names the sensors.
pub const SET_FILE: &str = "sensors.json";

/// Name of the file that describes the set.
const CARD_FILE: &str = "README.md";

/// The content of `sensors.json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SensorSet {
    /// Version of the file's keys and their meaning.
    pub set_version: u32,
    /// Version of gelsim that wrote it.
    pub generator: String,
    /// Whether a sample is the same press under all sensors.
    pub paired: bool,
    /// The sensors, in the order of the job.
    pub sensors: Vec<SetEntry>,
    /// Folder of the set of their calibration presses, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<String>,
}

/// One sensor of a set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetEntry {
    /// Folder of its dataset.
    pub folder: String,
    /// Name of the sensor in the labels.
    pub sensor: String,
    /// Number of the unit that was drawn around it; null if none was.
    pub unit: Option<u32>,
}

impl Versioned for SensorSet {
    const NEWEST: u32 = 1;

    fn from_json(text: &[u8]) -> serde_json::Result<Self> {
        serde_json::from_slice(text)
    }

    fn version(&self) -> u32 {
        self.set_version
    }
}

impl SensorSet {
    fn new(members: &[SetMember], has_calibration: bool) -> Self {
        let entry = |SetMember { folder, unit, plan }: &SetMember| SetEntry {
            folder: folder.clone(),
            sensor: plan.job().sensor.name.clone(),
            unit: *unit,
        };
        let mut seeds = members.iter().map(|member| member.plan.seed());
        let first = seeds.next();
        Self {
            set_version: Self::NEWEST,
            generator: env!("CARGO_PKG_VERSION").to_owned(),
            paired: seeds.all(|seed| Some(seed) == first),
            sensors: members.iter().map(entry).collect(),
            calibration: has_calibration.then(|| CALIBRATION_FOLDER.to_owned()),
        }
    }

    /// Reads the set in `root`; `None` if there is none.
    pub fn find(root: &Path) -> Result<Option<Self>, DatasetError> {
        // What is no folder is no set either.
        let found = if root.is_file() { None } else { Self::read(&root.join(SET_FILE))? };
        // Folders outside of the set's own are not read.
        let is_inside = |folder: &str| {
            let mut parts = Path::new(folder).components();
            matches!((parts.next(), parts.next()), (Some(std::path::Component::Normal(_)), None))
        };
        let is_sound = |set: &Self| !set.sensors.is_empty() && set.folders().all(is_inside);
        Ok(found.filter(is_sound))
    }

    /// Returns the folders of its sensors, and that of their calibration presses.
    pub fn folders(&self) -> impl Iterator<Item = &str> {
        self.sensors.iter().map(|entry| &*entry.folder).chain(self.calibration.as_deref())
    }

    /// Returns its folders that are of another sensor, or of none, in `other`.
    fn folders_not_in(&self, other: &Self) -> impl Iterator<Item = &str> {
        let gone = self.sensors.iter().filter(|entry| !other.sensors.contains(entry)).map(|entry| &*entry.folder);
        gone.chain(self.calibration.as_deref().filter(|_| other.calibration.is_none()))
    }

    /// Finds the folder of the outermost set that has a dataset in `folder`.
    pub fn find_owner(folder: &Path) -> Option<PathBuf> {
        let (mut owner, mut inside) = (None, folder.to_owned());
        while let (Some(name), Some(above)) = (inside.file_name().map(std::ffi::OsStr::to_owned), inside.parent()) {
            let above = if above == Path::new("") { Path::new(".") } else { above };
            match Self::find(above).ok().flatten() {
                Some(set) if set.folders().any(|folder| name == folder) => inside = above.to_owned(),
                _ => break,
            }
            owner = Some(inside.clone());
        }
        owner
    }
}

/// Returns the folders of the datasets in `root`: those of its sensors and of their calibration presses if it is a set,
/// else itself.
pub fn list_dataset_folders(root: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let Some(set) = SensorSet::find(root)? else { return Ok(vec![root.to_owned()]) };
    let mut folders: Vec<PathBuf> = set.sensors.iter().map(|entry| root.join(&entry.folder)).collect();
    if let Some(presses) = set.calibration {
        folders.extend(list_dataset_folders(&root.join(presses))?);
    }
    Ok(folders)
}

/// Refuses a folder that a set may not use: what is no folder, holds something else, or holds a set with sensors or
/// calibration presses that this one has not, unless that is replaced. Changes nothing. Returns the set that is there.
pub(crate) fn require_usable_set_folder(
    root: &Path,
    members: &[SetMember],
    has_calibration: bool,
    overwrite: bool,
) -> Result<Option<SensorSet>, DatasetError> {
    let refused = |message: String, help: &str| Err(DatasetError::Usage(user_error(message, help)));
    if root.as_os_str().is_empty() {
        return refused(String::from("the output folder has no name"), "choose a new or empty folder with --out");
    }
    if root.symlink_metadata().is_ok() && !root.is_dir() {
        return refused(format!("{} is not a folder", root.display()), "choose a new or empty folder with --out");
    }
    let set = SensorSet::new(members, has_calibration);
    if let Some(known) = SensorSet::find(root)? {
        let gone: Vec<&str> = known.folders_not_in(&set).collect();
        let what = match *gone {
            [] => return Ok(Some(known)),
            _ if overwrite => return Ok(Some(known)),
            [one] => format!("a folder that this job has not: {one}"),
            [first, ..] => format!("{} folders that this job has not, the first {first}", gone.len()),
        };
        let message = format!("{} holds a set with {what}", root.display());
        return refused(message, "choose another folder with --out, or replace that set with --overwrite");
    }
    if root.join("job.toml").exists() {
        let message = format!("{} holds a dataset of one sensor", root.display());
        return refused(message, "choose a new or empty folder with --out");
    }
    let entries = match std::fs::read_dir(root) {
        Ok(entries) => {
            entries.collect::<io::Result<Vec<_>>>().map_err(|error| DatasetError::Io(root.to_owned(), error))?
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
        Err(error) => return Err(DatasetError::Io(root.to_owned(), error)),
    };
    let names: Vec<String> = entries.iter().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let is_dataset = |name: &String| set.folders().any(|folder| folder == name);
    // Of a set whose sensors.json is lost. Whether its datasets are of this job is looked at in each.
    let is_set = names.iter().any(is_dataset);
    // What a killed run leaves of the file itself does not count.
    let is_ours = |name: &String| {
        let is_file = *name == SET_FILE || name.starts_with(&format!(".{SET_FILE}."));
        is_file || is_set && (is_dataset(name) || *name == CARD_FILE)
    };
    if !names.iter().all(is_ours) {
        // Another process may have begun the set since it was looked for.
        if let Some(known) = SensorSet::find(root)? {
            return Ok(Some(known));
        }
        let message = format!("{} is not empty and holds no set of gelsim", root.display());
        return refused(message, "choose a new or empty folder with --out");
    }
    Ok(None)
}

/// Prepares `root` for a set: a new folder, an empty one, or that of a set whose sensors are among these.
pub(crate) fn prepare_set_folder(
    root: &Path,
    members: &[SetMember],
    has_calibration: bool,
    overwrite: bool,
) -> Result<(), DatasetError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |error| DatasetError::Io(path, error)
    };
    let known = require_usable_set_folder(root, members, has_calibration, overwrite)?;
    let set = SensorSet::new(members, has_calibration);
    for folder in known.iter().flat_map(|known| known.folders_not_in(&set)) {
        remove_member(&root.join(folder))?;
    }
    let path = root.join(SET_FILE);
    let (card, card_text) = (root.join(CARD_FILE), render_set_card(&set, members));
    // A run that was killed between the two may have left the card of the set before.
    let is_card_written =
        input::read_without_links(&card, MAX_METADATA_BYTES).is_ok_and(|found| found == card_text.as_bytes());
    if known.as_ref() != Some(&set) || !is_card_written {
        std::fs::create_dir_all(root).map_err(failed(root))?;
        let mut text = serde_json::to_vec_pretty(&set).map_err(|error| DatasetError::Io(path.clone(), error.into()))?;
        text.push(b'\n');
        write_output(&path, &text).map_err(failed(&path))?;
        write_output(&card, card_text.as_bytes()).map_err(failed(&card))?;
    }
    Ok(())
}

/// Removes what gelsim made in the folder of a dataset, or of a set with its datasets, and the folder if nothing else
/// is in it.
fn remove_member(folder: &Path) -> Result<(), DatasetError> {
    if let Some(set) = SensorSet::find(folder)? {
        for name in set.folders() {
            remove_member(&folder.join(name))?;
        }
        for path in [SET_FILE, CARD_FILE].map(|name| folder.join(name)) {
            cleanup::remove_path(&path).map_err(|error| DatasetError::Io(path, error))?;
        }
    } else {
        match cleanup::remove_dataset(folder) {
            Ok(Ok(())) => {}
            Ok(Err(writer)) => {
                let message = format!("{} cannot be replaced: {writer}", folder.display());
                return Err(DatasetError::Usage(user_error(message, "wait until it is done, or stop it")));
            }
            Err((path, error)) if error.kind() != io::ErrorKind::NotFound => return Err(DatasetError::Io(path, error)),
            Err(_) => {}
        }
    }
    match std::fs::remove_dir(folder) {
        Err(error) if !matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::DirectoryNotEmpty) => {
            Err(DatasetError::Io(folder.to_owned(), error))
        }
        _ => Ok(()),
    }
}

/// Renders the set's card: its sensors, what they have in common, and code that loads them.
fn render_set_card(set: &SensorSet, members: &[SetMember]) -> String {
    let folder = |member: &SetMember| member.folder.clone();
    let name = members.first().map_or_else(String::new, |first| {
        let name = first.plan.name();
        name.strip_suffix(&format!("-{}", folder(first))).unwrap_or(name).to_owned()
    });
    let mut text = format!(
        "---\npretty_name: \"{name}\"\ntags: [tactile, synthetic]\n---\n\n# {name}\n\n\
         {} tactile sensors, simulated by gelsim {}. Each folder is a dataset of one of them, with a card of its own.\n\n",
        members.len(),
        set.generator
    );
    text += match set.paired {
        true => {
            "A sample is the same press under every sensor: the same number is the same object, pose, depth in mm, texture \
             and motion.\n\n"
        }
        false => "Each sensor feels presses of its own.\n\n",
    };
    text += "| folder | sensor | image, px | view, mm |\n|---|---|---|---|\n";
    for member in members {
        let sensor = &member.plan.job().sensor;
        let ([width, height], [wide, high]) = (sensor.resolution_px, sensor.field_of_view_mm.map(format_number));
        let _ = writeln!(text, "| {} | {} | {width} x {height} | {wide} x {high} |", member.folder, sensor.name);
    }
    if let Some(presses) = &set.calibration {
        let _ = write!(text, "\n`{presses}/` has the calibration presses of each.\n");
    }
    let (what, load) = match set.paired {
        true => ("a list with a sample of each sensor", "for samples in gelsim.load(\".\").pairs():\n    break"),
        false => ("one sample", "for sample in gelsim.load(\".\"):\n    break"),
    };
    let _ = write!(text, "\n```python\nimport gelsim\n\n# {what}\n{load}\n```\n");
    text
}
