//! Writes an output in the layout of its input: units of the same format, with the images beside them.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::input::folders::without_split;
use super::input::images::path_inside;
use super::input::{InputLayout, LabelFormat, RealDataset, RealSample};
use super::split::Division;
use gelsim_dataset::archive;
use gelsim_dataset::archive::Member;
use gelsim_files::hash::{sha256, to_hex};

pub mod folder;
pub mod labels;

use labels::LabelWriter;

/// A sample that is ready to be written.
#[derive(Default)]
pub struct OutputSample {
    /// Unit of the input.
    pub unit: usize,
    /// Number of the split.
    pub split: usize,
    /// Key in a tar.
    pub key: String,
    /// Files in a tar.
    pub tar_files: Vec<Member>,
    /// Files besides a table: paths relative to the output's folder, and contents.
    pub files: Vec<(PathBuf, Vec<u8>)>,
    /// Line in a table, or entry in COCO's list of images.
    pub row: Vec<u8>,
    /// Annotations, for COCO.
    pub annotations: Vec<Vec<u8>>,
}

/// Place of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImagePlacement {
    /// File, relative to the output's folder.
    pub file: PathBuf,
    /// The file's name as labels have it.
    pub name: String,
}

impl ImagePlacement {
    /// Returns the placement in the same folder with another file name; `rename` derives it.
    fn map_file_name(&self, rename: impl Fn(&str) -> String) -> Self {
        let new = rename(&self.file.file_name().unwrap_or_default().to_string_lossy());
        let at = self.name.rfind('/').map_or(0, |at| at + 1);
        Self { file: self.file.with_file_name(&new), name: format!("{}{new}", &self.name[..at]) }
    }

    /// Writes `\` between folders in the label if `written` does.
    fn spelled_as(mut self, written: &RealSample) -> Self {
        if written.has_backslashes {
            self.name = self.name.replace('/', "\\");
        }
        self
    }
}

/// Places of samples by unit and split.
pub struct OutputLayout<'a> {
    set: &'a RealDataset,
    division: &'a Division,
}

impl<'a> OutputLayout<'a> {
    /// Creates the layout of a set with its splits.
    pub fn new(set: &'a RealDataset, division: &'a Division) -> Self {
        Self { set, division }
    }

    /// Returns the file for the labels of a unit and split.
    pub fn label_file(&self, unit: usize, split: usize) -> PathBuf {
        let input = &self.set.units[unit];
        if !self.division.has_own_files {
            return input.file.clone();
        }
        let split = &self.division.names[split];
        let name = if self.set.units.len() > 1 || input.form == LabelFormat::Tar {
            format!("{split}-{unit:06}")
        } else {
            split.clone()
        };
        match input.form {
            LabelFormat::Tar => input.file.with_file_name(format!("{name}.tar")),
            _ => {
                let folder = if self.set.split_by_unit {
                    input.folder().with_file_name(name)
                } else {
                    input.folder().join(name)
                };
                folder.join(input.file.file_name().unwrap_or_default())
            }
        }
    }

    /// Returns true for the name of a table, or of a file that describes an output: no file of the input is copied
    /// there.
    pub fn is_reserved(&self, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default();
        let tables = self.set.units.iter().filter_map(|unit| unit.file.file_name());
        tables.chain(folder::DESCRIPTIONS.map(OsStr::new)).any(|reserved| reserved == name)
    }

    /// Returns the folder for the images of a unit and split.
    pub fn image_folder(&self, unit: usize, split: usize) -> PathBuf {
        let input = &self.set.units[unit];
        if !self.division.has_own_files {
            return input.images.clone();
        }
        let file = self.label_file(unit, split);
        let folder = file.parent().unwrap_or(Path::new(""));
        match (self.set.layout, input.images.strip_prefix(input.folder())) {
            (InputLayout::Coco, _) => folder.to_owned(),
            (_, Ok(rest)) => folder.join(rest),
            (_, Err(_)) => folder.join(&input.images),
        }
    }

    /// Returns the place of a real sample's image; with a `tag`, that of an image derived from it, which is a PNG.
    pub fn place_image(&self, real: &RealSample, split: usize, tag: &str) -> ImagePlacement {
        let placed = self.place_untagged_image(real, split);
        match tag {
            "" => placed.spelled_as(real),
            tag => placed.map_file_name(|name| derived_image_name(name, tag)).spelled_as(real),
        }
    }

    /// Returns the place of the image of a synthetic sample of a class, which follows a real one.
    pub fn place_synthetic_image(&self, follows: &RealSample, split: usize, class: &str, key: &str) -> ImagePlacement {
        let name = format!("{key}.png");
        let InputLayout::ClassFolders(kind) = self.set.layout else {
            return self.place_untagged_image(follows, split).map_file_name(|_| name.clone()).spelled_as(follows);
        };
        let split = match (self.division.is_new, kind.are_splits) {
            (true, _) => Some(self.division.names[split].clone()),
            (false, true) => follows.path.iter().next().map(|name| name.to_string_lossy().into_owned()),
            (false, false) => None,
        };
        let class = kind.are_classes.then(|| class.to_owned());
        let file: PathBuf = split.into_iter().chain(class).chain([name]).collect();
        ImagePlacement { name: file.to_string_lossy().into_owned(), file }
    }

    fn place_untagged_image(&self, real: &RealSample, split: usize) -> ImagePlacement {
        match self.set.layout {
            InputLayout::ClassFolders(kind) if self.division.is_new => {
                let rest = without_split(&real.path);
                let of_split = real.path.iter().next().filter(|_| kind.repeat_names && rest != real.path);
                let rest = match (of_split, rest.file_name()) {
                    // Two images with this name come from different splits: the old split keeps them apart.
                    (Some(split), Some(name)) => {
                        let (split, name) = (split.to_string_lossy(), name.to_string_lossy());
                        rest.with_file_name(format!("{split}-{name}"))
                    }
                    _ => rest,
                };
                let file = Path::new(&self.division.names[split]).join(rest);
                ImagePlacement { name: file.to_string_lossy().into_owned(), file }
            }
            _ if self.division.has_own_files => {
                let steps = Path::new(&real.image).components();
                let steps_back = |step: &Component<'_>| matches!(step, Component::ParentDir);
                let name = if steps.clone().any(|step| steps_back(&step)) {
                    let steps = steps.filter(|step| !steps_back(step)).collect::<PathBuf>();
                    steps.to_string_lossy().into_owned()
                } else {
                    real.image.clone()
                };
                let folder = self.image_folder(real.unit, split);
                ImagePlacement { file: path_inside(&folder, &name).unwrap_or_else(|| folder.join(&name)), name }
            }
            _ => ImagePlacement { file: real.path.clone(), name: real.image.clone() },
        }
    }
}

/// Returns the name of an image derived from another one, which is a PNG.
fn derived_image_name(image: &str, tag: &str) -> String {
    let stem = Path::new(image).file_stem().unwrap_or_default().to_string_lossy();
    // gelsim's own images are named KEY.tactile.png: the key ends at the first dot.
    let (key, rest) = stem.split_once('.').map_or((&*stem, String::new()), |(key, rest)| (key, format!(".{rest}")));
    format!("{key}{tag}{rest}.png")
}

/// Writes an output into a folder.
pub struct OutputWriter<'a> {
    root: PathBuf,
    units: &'a OutputLayout<'a>,
    labels: &'a LabelWriter<'a>,
    open: BTreeMap<PathBuf, OpenUnit>,
    written: BTreeSet<PathBuf>,
    /// SHA-256 of every file, by its path relative to the folder.
    sums: BTreeMap<PathBuf, String>,
    /// Splits and label files that have samples.
    pub filled: BTreeSet<(usize, PathBuf)>,
    /// Bytes written so far.
    pub bytes: u64,
}

/// A unit that is being written.
enum OpenUnit {
    Table(BufWriter<File>, Sha256),
    Coco(CocoWriter),
    Tar(archive::TarWriter),
}

/// COCO annotations that are being written: images as they come, annotations after the last one.
struct CocoWriter {
    file: BufWriter<File>,
    hash: Sha256,
    bytes: u64,
    images: u64,
    annotations: Vec<Vec<u8>>,
}

impl CocoWriter {
    /// Begins a file with these keys before its images.
    fn create(path: &Path, rest: &Map<String, Value>) -> io::Result<Self> {
        let file = BufWriter::new(File::create_new(path)?);
        let mut writer = Self { file, hash: Sha256::new(), bytes: 0, images: 0, annotations: Vec::new() };
        writer.write_bytes(b"{\n")?;
        for (key, value) in rest {
            writer.write_bytes(format!("{}: {value},\n", Value::from(key.as_str())).as_bytes())?;
        }
        writer.write_bytes(b"\"images\": [")?;
        Ok(writer)
    }

    fn write_bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes)
    }

    fn append_image(&mut self, image: &[u8], annotations: Vec<Vec<u8>>) -> io::Result<()> {
        self.write_bytes(if self.images == 0 { b"\n" } else { b",\n" })?;
        self.images += 1;
        self.annotations.extend(annotations);
        self.write_bytes(image)
    }

    /// Writes the annotations. Returns length and SHA-256 of the file.
    fn finish(mut self) -> io::Result<(u64, String)> {
        self.write_bytes(b"\n],\n\"annotations\": [")?;
        for (number, annotation) in std::mem::take(&mut self.annotations).iter().enumerate() {
            self.write_bytes(if number == 0 { b"\n" } else { b",\n" })?;
            self.write_bytes(annotation)?;
        }
        self.write_bytes(b"\n]\n}\n")?;
        self.file.flush()?;
        Ok((self.bytes, to_hex(&self.hash.finalize())))
    }
}

impl<'a> OutputWriter<'a> {
    /// Creates a writer into `root`, which must exist and be empty.
    pub fn new(root: &Path, units: &'a OutputLayout<'a>, labels: &'a LabelWriter<'a>) -> Self {
        let (open, written, sums, filled) = Default::default();
        Self { root: root.to_owned(), units, labels, open, written, sums, filled, bytes: 0 }
    }

    /// Appends a sample.
    pub fn append_sample(&mut self, piece: OutputSample) -> Result<(), (PathBuf, io::Error)> {
        let file = self.units.label_file(piece.unit, piece.split);
        let path = self.root.join(&file);
        let failed = |error| (path.clone(), error);
        if !self.open.contains_key(&file) {
            let unit = self.open_unit(&path, piece.unit).map_err(failed)?;
            self.open.insert(file.clone(), unit);
        }
        self.filled.insert((piece.split, file.clone()));
        for (name, bytes) in &piece.files {
            self.write_file(name, bytes)?;
        }
        match self.open.get_mut(&file) {
            Some(OpenUnit::Table(table, hash)) => {
                self.bytes += piece.row.len() as u64;
                hash.update(&piece.row);
                table.write_all(&piece.row).map_err(failed)
            }
            Some(OpenUnit::Coco(coco)) => coco.append_image(&piece.row, piece.annotations).map_err(failed),
            Some(OpenUnit::Tar(tar)) => tar.append(&piece.key, &piece.tar_files).map_err(failed),
            None => Ok(()),
        }
    }

    fn open_unit(&mut self, path: &Path, unit: usize) -> io::Result<OpenUnit> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let set = self.units.set;
        let form = &set.units[unit].form;
        match form {
            LabelFormat::Tar => return archive::TarWriter::create(path).map(OpenUnit::Tar),
            LabelFormat::Coco => {
                return CocoWriter::create(path, &set.annotations[unit].other_keys).map(OpenUnit::Coco);
            }
            LabelFormat::Csv(_) | LabelFormat::JsonLines => {}
        }
        let header = self.labels.encode_csv_header(form);
        self.bytes += header.len() as u64;
        let mut table = BufWriter::new(File::create_new(path)?);
        table.write_all(&header)?;
        Ok(OpenUnit::Table(table, Sha256::new_with_prefix(&header)))
    }

    /// Writes a complete file, unless it was written before: several samples may name the same file.
    pub fn write_file(&mut self, name: &Path, bytes: &[u8]) -> Result<(), (PathBuf, io::Error)> {
        if !self.written.insert(name.to_owned()) {
            return Ok(());
        }
        let path = self.root.join(name);
        let write = || {
            fs::create_dir_all(path.parent().unwrap_or(&self.root))?;
            File::create_new(&path)?.write_all(bytes)
        };
        write().map_err(|error| (path.clone(), error))?;
        self.bytes += bytes.len() as u64;
        self.sums.insert(name.to_owned(), sha256(bytes));
        Ok(())
    }

    /// Closes all units, and writes the list of all files with their checksums.
    pub fn finish(&mut self) -> Result<(), (PathBuf, io::Error)> {
        for (name, unit) in std::mem::take(&mut self.open) {
            let path = self.root.join(&name);
            let failed = |error| (path.clone(), error);
            let sum = match unit {
                OpenUnit::Table(mut table, hash) => {
                    table.flush().map_err(failed)?;
                    to_hex(&hash.finalize())
                }
                OpenUnit::Coco(coco) => {
                    let (bytes, sum) = coco.finish().map_err(failed)?;
                    self.bytes += bytes;
                    sum
                }
                OpenUnit::Tar(mut tar) => {
                    let (bytes, sum) = tar.finish(&path).map_err(failed)?;
                    self.bytes += bytes;
                    sum
                }
            };
            self.sums.insert(name, sum);
        }
        let line = |(name, sum): (&PathBuf, &String)| format!("{sum}  {}\n", name.display());
        let list: String = self.sums.iter().map(line).collect();
        self.write_file(Path::new(folder::CHECKSUMS), list.as_bytes())
    }
}
