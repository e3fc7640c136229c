//! The images that a folder holds: of a sensor, of several, or of a dataset.
//!
//! A sensor's folder has `annotations.csv`, whose presses are its images, or else image files, in it or in `images/`. A
//! folder of such folders is several sensors. Of the samples of a dataset that lie in a folder the tactile images are taken.
//! Only images of 8 bits a channel are read.

use std::fs;
use std::path::{Path, PathBuf};

use image::{ColorType, RgbImage};

use crate::presses::{self, Circle, Table};
use gelsim_dataset::recorded::Recorded;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::store::Address;

/// The table of a sensor's folder.
const TABLE: &str = "annotations.csv";

/// What stands in a folder.
pub enum Images {
    /// Sensors by name; one if the folder is a sensor's.
    Sensors(Vec<SensorImages>),
    /// A dataset by gelsim.
    Dataset(Box<Recorded>),
}

/// The images of a sensor; at least one.
pub struct SensorImages {
    /// The folder's name.
    pub name: String,
    /// The images.
    pub images: Vec<Entry>,
    /// Where they are listed, if they are.
    pub table: Option<Table>,
}

/// One image.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Path relative to the sensor's folder, as the table has it.
    pub name: String,
    /// Where it can be read.
    pub path: PathBuf,
    /// Where a ball touched, if that is known.
    pub circle: Option<Circle>,
    /// Its line in the table.
    line: Option<u64>,
}

impl Entry {
    /// The name without folders.
    pub fn base(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or(&self.name)
    }
}

/// An image that cannot be used.
#[derive(Clone, Debug)]
pub struct Unusable {
    line: Option<u64>,
    problem: Diagnostic,
}

impl Unusable {
    /// Why, with a way out.
    pub fn new(entry: &Entry, problem: Diagnostic) -> Self {
        Self { line: entry.line, problem }
    }

    /// Said without the row in which the image is listed.
    pub fn report(&self) -> Report {
        self.problem.clone().into()
    }
}

impl SensorImages {
    /// Shows what is wrong with its images; with their rows, if a table lists them.
    pub fn report(&self, unusable: &[Unusable]) -> Report {
        let mut problems = Diagnostics::default();
        for Unusable { line, problem } in unusable {
            let place = match (&self.table, line) {
                (Some(table), Some(line)) => table.problem(*line, "").place,
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

/// Finds the images in the folder `root`. No image is read yet.
pub fn find(root: &Path) -> Result<Images, Report> {
    let shown = root.display();
    if Address::is_one(root) {
        let help = "copy it, for example with `aws s3 sync` (docs/stores.md), and name the copy";
        return Err(user_error(format!("{shown} is in an object store, and is read from a folder"), help));
    }
    if !root.is_dir() {
        let what = if root.exists() { "is no folder" } else { "does not exist" };
        return Err(user_error(
            format!("{shown} {what}"),
            "name a folder with images, a folder of such folders, or a dataset",
        ));
    }
    if root.join("job.toml").is_file() && root.join("data").is_dir() {
        return Recorded::open(root).map(|dataset| Images::Dataset(Box::new(dataset)));
    }
    if let Some(sensor) = sensor(root)? {
        return Ok(Images::Sensors(vec![sensor]));
    }
    let (mut sensors, mut wrong) = (Vec::new(), Report::default());
    for folder in listed(root)?.into_iter().filter(|path| path.is_dir()) {
        match sensor(&folder) {
            Ok(found) => sensors.extend(found),
            Err(report) => wrong = wrong.and(report),
        }
    }
    if sensors.is_empty() && wrong.is_empty() {
        let help = format!(
            "images are files named like {} in the folder or in images/, or what annotations.csv lists; or the same in its \
             subfolders, one per sensor",
            image_file::NAMES
        );
        return Err(user_error(format!("{shown}: no images in it"), help));
    }
    if wrong.is_empty() { Ok(Images::Sensors(sensors)) } else { Err(wrong) }
}

/// The sensor in a folder; None if it is no sensor's.
fn sensor(folder: &Path) -> Result<Option<SensorImages>, Report> {
    // Of `.` and `..` the name is that of the folder they stand for.
    let named = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = named.file_name().map_or_else(|| String::from("/"), |name| name.to_string_lossy().into_owned());
    let listing = folder.join(TABLE);
    if listing.exists() {
        let table = presses::read(&listing)?;
        let entry = |press: &presses::Press| Entry {
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
            let pictures =
                listed(&folder)?.into_iter().filter(|path| image_file::is_named_like_one(path) && path.is_file());
            let pictures: Vec<PathBuf> = pictures.collect();
            // Beside these lie other layers of the same samples.
            let of_samples = pictures.iter().any(|path| is_tactile(path));
            let pictures = pictures.into_iter().filter(|path| !of_samples || is_tactile(path));
            images.extend(pictures.map(|path| {
                let file = path.file_name().unwrap_or_default().to_string_lossy();
                Entry { name: format!("{prefix}{file}"), path: path.clone(), circle: None, line: None }
            }));
        }
    }
    Ok((!images.is_empty()).then_some(SensorImages { name, images, table: None }))
}

/// True of the tactile image of a dataset's sample.
fn is_tactile(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(".tactile.png"))
}

/// What stands in a folder, sorted, without hidden files.
fn listed(folder: &Path) -> Result<Vec<PathBuf>, Report> {
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
pub fn read(entry: &Entry) -> Result<RgbImage, Unusable> {
    let decode = || -> Result<RgbImage, String> {
        let bytes = input::read(&entry.path, input::MOST_IMAGE_BYTES).map_err(|error| error.to_string())?;
        match image_file::header(&bytes)?.1 {
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
        Unusable::new(entry, problem.of(path, cause).help(help))
    })
}
