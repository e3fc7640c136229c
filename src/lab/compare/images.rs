//! The images in a folder: of one sensor, of several sensors, or of a dataset.
//!
//! A sensor's folder has `annotations.csv`, whose presses are its images, or image files in it or in its `images/`. A
//! folder of such folders holds several sensors. From samples of a dataset that lie in a folder, only the tactile
//! images are taken. Images must have 8 bits a channel.

use std::fs;
use std::path::{Path, PathBuf};

use image::{ColorType, RgbImage};

use crate::presses::{self, Circle, PressTable};
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_dataset::sensor_set::SensorSet;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::store::StoreAddress;

/// Name of the table in a sensor's folder.
pub const TABLE_NAME: &str = "annotations.csv";

/// Images in a folder.
pub enum FolderImages {
    /// Sensors by name; a single one if the folder is a sensor's.
    Sensors(Vec<SensorImages>),
    /// A dataset by gelsim.
    Dataset(Box<RecordedDataset>),
}

/// Images of a sensor; at least one.
pub struct SensorImages {
    /// The folder's name.
    pub name: String,
    /// The images.
    pub images: Vec<ImageEntry>,
    /// Table that lists them, if there is one.
    pub table: Option<PressTable>,
}

/// One image.
#[derive(Clone, Debug)]
pub struct ImageEntry {
    /// Path relative to the sensor's folder, as the table has it.
    pub name: String,
    /// Where it can be read.
    pub path: PathBuf,
    /// Where a ball touched, if that is known.
    pub circle: Option<Circle>,
    /// Line in the table.
    line: Option<u64>,
}

impl ImageEntry {
    /// Name without folders.
    pub fn file_name(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or(&self.name)
    }

    /// Name without folders and ending.
    pub fn file_stem(&self) -> &str {
        self.file_name().rsplit_once('.').map_or(self.file_name(), |(stem, _)| stem)
    }
}

/// An image that cannot be used.
#[derive(Clone, Debug)]
pub struct UnusableImage {
    line: Option<u64>,
    problem: Diagnostic,
}

impl UnusableImage {
    /// Creates it from an image and what is wrong with it.
    pub fn new(entry: &ImageEntry, problem: Diagnostic) -> Self {
        Self { line: entry.line, problem }
    }

    /// Returns the problem without the row that lists the image.
    pub fn report(&self) -> Report {
        self.problem.clone().into()
    }
}

impl SensorImages {
    /// Builds a report of unusable images, with their rows if a table lists them.
    pub fn report(&self, unusable: &[UnusableImage]) -> Report {
        let mut problems = Diagnostics::default();
        for UnusableImage { line, problem } in unusable {
            let place = match (&self.table, line) {
                (Some(table), Some(line)) => table.row_problem(*line, "").place,
                _ => None,
            };
            problems.push(problem.clone().at(place));
        }
        match &self.table {
            Some(table) => table.report(&problems),
            None => Report::new(&problems, &[]),
        }
    }
}

/// Finds the images in the folder `root`, without reading them yet.
pub fn find_images(root: &Path) -> Result<FolderImages, Report> {
    let shown = root.display();
    if StoreAddress::is_address(root) {
        let help = "copy it, for example with `aws s3 sync` (docs/how-to/stores.md), and name the copy";
        return Err(user_error(format!("{shown} is in an object store, and is read from a folder"), help));
    }
    if !root.is_dir() {
        let what = if root.exists() { "is no folder" } else { "does not exist" };
        return Err(user_error(
            format!("{shown} {what}"),
            "name a folder with images, a folder of such folders, or a dataset",
        ));
    }
    let is_set = SensorSet::find(root).is_ok_and(|set| set.is_some());
    if is_set || root.join("job.toml").is_file() && root.join("data").is_dir() {
        return RecordedDataset::open(root).map(|dataset| FolderImages::Dataset(Box::new(dataset)));
    }
    if let Some(sensor) = find_sensor(root)? {
        return Ok(FolderImages::Sensors(vec![sensor]));
    }
    let (mut sensors, mut wrong) = (Vec::new(), Report::default());
    for folder in list_folder(root)?.into_iter().filter(|path| path.is_dir()) {
        match find_sensor(&folder) {
            Ok(found) => sensors.extend(found),
            Err(report) => wrong = wrong.merged_with(report),
        }
    }
    if sensors.is_empty() && wrong.is_empty() {
        let help = format!(
            "images are files named like {} in the folder or in images/, or what annotations.csv lists; or the same in its \
             subfolders, one per sensor",
            image_file::FORMAT_NAMES
        );
        return Err(user_error(format!("{shown}: no images in it"), help));
    }
    if wrong.is_empty() { Ok(FolderImages::Sensors(sensors)) } else { Err(wrong) }
}

/// Finds the sensor in a folder; None if there is no image in it.
fn find_sensor(folder: &Path) -> Result<Option<SensorImages>, Report> {
    // The paths `.` and `..` have no name of their own: take that of the folder.
    let named = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = named.file_name().map_or_else(|| String::from("/"), |name| name.to_string_lossy().into_owned());
    let listing = folder.join(TABLE_NAME);
    if listing.exists() {
        let table = presses::read(&listing)?;
        let entry = |press: &presses::PressRow| ImageEntry {
            name: press.file.trim_start_matches("./").to_owned(),
            path: press.path.clone(),
            circle: press.circle,
            line: Some(press.line),
        };
        return Ok(Some(SensorImages { name, images: table.presses.iter().map(entry).collect(), table: Some(table) }));
    }
    let mut images = Vec::new();
    for (prefix, folder) in [("", folder.to_owned()), ("images/", folder.join("images"))] {
        if folder.is_dir() {
            let pictures = list_folder(&folder)?
                .into_iter()
                .filter(|path| image_file::has_image_extension(path) && path.is_file());
            let pictures: Vec<PathBuf> = pictures.collect();
            // In an unpacked dataset the layers of a sample lie next to its tactile image.
            let of_samples = pictures.iter().any(|path| is_tactile(path));
            let pictures = pictures.into_iter().filter(|path| !of_samples || is_tactile(path));
            images.extend(pictures.map(|path| {
                let file = path.file_name().unwrap_or_default().to_string_lossy();
                ImageEntry { name: format!("{prefix}{file}"), path: path.clone(), circle: None, line: None }
            }));
        }
    }
    Ok((!images.is_empty()).then_some(SensorImages { name, images, table: None }))
}

/// Returns true for the tactile image of a dataset's sample.
fn is_tactile(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(".tactile.png"))
}

/// Lists what is in a folder, sorted, without hidden files.
fn list_folder(folder: &Path) -> Result<Vec<PathBuf>, Report> {
    let failed = |error| user_error(format!("cannot list {}: {error}", folder.display()), "make the folder readable");
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        paths.push(entry.map_err(failed)?.path());
    }
    paths.retain(|path| path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with('.')));
    paths.sort();
    Ok(paths)
}

/// Reads an image of 8 bits a channel.
pub fn read_image(entry: &ImageEntry) -> Result<RgbImage, UnusableImage> {
    let decode = || -> Result<RgbImage, String> {
        let bytes = input::read(&entry.path, input::MAX_IMAGE_BYTES).map_err(|error| error.to_string())?;
        match image_file::read_header(&bytes)?.1 {
            ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => image_file::decode_rgb(&bytes),
            _ => Err(String::from("it has more than 8 bits a channel")),
        }
    };
    decode().map_err(|reason| {
        let path = entry.path.display().to_string();
        let (cause, help) = if entry.path.exists() {
            (
                format!("images cannot be read: {reason}"),
                "save them with 8 bits a channel, for example as PNG; or leave them out",
            )
        } else {
            (
                String::from("images do not exist"),
                "put them where annotations.csv says, from its own folder; or leave their rows out",
            )
        };
        let problem = Diagnostic::new(format!("cannot read the image {path}: {reason}"));
        UnusableImage::new(entry, problem.about(path, cause).help(help))
    })
}
