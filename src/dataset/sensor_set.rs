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
        let found = Self::read(&root.join(SET_FILE))?;
        // Folders outside of the set's own are not read.
        let is_inside = |folder: &String| {
            let mut parts = Path::new(folder).components();
            matches!((parts.next(), parts.next()), (Some(std::path::Component::Normal(_)), None))
        };
        let is_sound = |set: &Self| {
            let mut folders = set.sensors.iter().map(|entry| &entry.folder).chain(&set.calibration);
            !set.sensors.is_empty() && folders.all(is_inside)
        };
        Ok(found.filter(is_sound))
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

/// Prepares `root` for a set: a new folder, an empty one, or that of a set whose sensors are among these.
pub(crate) fn prepare_set_folder(
    root: &Path,
    members: &[SetMember],
    has_calibration: bool,
    overwrite: bool,
) -> Result<(), DatasetError> {
    let refused = |message: String, help: &str| Err(DatasetError::Usage(user_error(message, help)));
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |error| DatasetError::Io(path, error)
    };
    if root.as_os_str().is_empty() {
        return refused(String::from("the output folder has no name"), "choose a new or empty folder with --out");
    }
    if root.symlink_metadata().is_ok() && !root.is_dir() {
        return refused(format!("{} is not a folder", root.display()), "choose a new or empty folder with --out");
    }
    let path = root.join(SET_FILE);
    let set = SensorSet::new(members, has_calibration);
    let known = SensorSet::find(root)?;
    match &known {
        Some(known) => {
            let gone: Vec<&SetEntry> = known.sensors.iter().filter(|entry| !set.sensors.contains(entry)).collect();
            if let (Some(first), false) = (gone.first(), overwrite) {
                let message = format!(
                    "{} holds a set with {} that this job has not, the first {}",
                    root.display(),
                    if gone.len() == 1 { String::from("a sensor") } else { format!("{} sensors", gone.len()) },
                    first.folder
                );
                return refused(message, "choose another folder with --out, or replace that set with --overwrite");
            }
            for entry in gone {
                let folder = root.join(&entry.folder);
                match cleanup::remove_dataset(&folder) {
                    Ok(Ok(())) => {}
                    Ok(Err(writer)) => {
                        let message = format!("{} cannot be replaced: {writer}", folder.display());
                        return refused(message, "wait until it is done, or stop it");
                    }
                    Err((path, error)) if error.kind() != io::ErrorKind::NotFound => {
                        return Err(DatasetError::Io(path, error));
                    }
                    Err(_) => {}
                }
            }
        }
        None if root.join("job.toml").exists() => {
            let message = format!("{} holds a dataset of one sensor", root.display());
            return refused(message, "choose a new or empty folder with --out");
        }
        None => {
            let entries = match std::fs::read_dir(root) {
                Ok(entries) => entries.collect::<io::Result<Vec<_>>>().map_err(failed(root))?,
                Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
                Err(error) => return Err(DatasetError::Io(root.to_owned(), error)),
            };
            // What a killed run leaves of the file itself does not count.
            let is_ours = |name: &str| name == SET_FILE || name.starts_with(&format!(".{SET_FILE}."));
            if entries.iter().any(|entry| !is_ours(&entry.file_name().to_string_lossy())) {
                // Another process may have begun the set since it was looked for.
                if SensorSet::find(root)?.is_some() {
                    return prepare_set_folder(root, members, has_calibration, overwrite);
                }
                let message = format!("{} is not empty and holds no set of gelsim", root.display());
                return refused(message, "choose a new or empty folder with --out");
            }
        }
    }
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
