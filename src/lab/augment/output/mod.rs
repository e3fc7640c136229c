//! An output in the layout of its input: units of the same form, images beside them.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::input::folders::without_split;
use super::input::images::inside;
use super::input::{Form, Layout, Real, Set};
use super::split::Division;
use gelsim_dataset::archive;
use gelsim_dataset::archive::Member;
use gelsim_files::hash::{hex, sha256};

pub mod labels;
pub mod pictures;
pub mod place;

use labels::Labels;

/// One sample, ready to be written.
#[derive(Default)]
pub struct Piece {
    /// Its unit in the input.
    pub unit: usize,
    /// Its split.
    pub split: usize,
    /// Its key, in a tar.
    pub key: String,
    /// Its files, in a tar.
    pub tar_files: Vec<Member>,
    /// Its files beside a table, from the output's folder, and their contents.
    pub files: Vec<(PathBuf, Vec<u8>)>,
    /// Its line in a table, or its entry among COCO's images.
    pub row: Vec<u8>,
    /// Its annotations, of COCO.
    pub annotations: Vec<Vec<u8>>,
}

/// Where an image goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImagePlacement {
    /// Its file, from the output's folder.
    pub file: PathBuf,
    /// The file's name as labels have it.
    pub name: String,
}

impl ImagePlacement {
    /// The image of another name beside it; `rename` gives the name of a file from this one's.
    fn beside(&self, rename: impl Fn(&str) -> String) -> Self {
        let new = rename(&self.file.file_name().unwrap_or_default().to_string_lossy());
        let at = self.name.rfind('/').map_or(0, |at| at + 1);
        Self { file: self.file.with_file_name(&new), name: format!("{}{new}", &self.name[..at]) }
    }

    /// With `\` between folders in the label, where `written` has it.
    fn spelled_as(mut self, written: &Real) -> Self {
        if written.has_backslashes {
            self.name = self.name.replace('/', "\\");
        }
        self
    }
}

/// Where the samples of a unit and a split go.
pub struct Units<'a> {
    set: &'a Set,
    division: &'a Division,
}

impl<'a> Units<'a> {
    /// Of a set and its splits.
    pub fn new(set: &'a Set, division: &'a Division) -> Self {
        Self { set, division }
    }

    /// The file that labels go to.
    pub fn file(&self, unit: usize, split: usize) -> PathBuf {
        let there = &self.set.units[unit];
        if !self.division.apart {
            return there.file.clone();
        }
        let split = &self.division.names[split];
        let name = if self.set.units.len() > 1 || there.form == Form::Tar {
            format!("{split}-{unit:06}")
        } else {
            split.clone()
        };
        match there.form {
            Form::Tar => there.file.with_file_name(format!("{name}.tar")),
            _ => {
                let folder = if self.set.split_by_unit {
                    there.folder().with_file_name(name)
                } else {
                    there.folder().join(name)
                };
                folder.join(there.file.file_name().unwrap_or_default())
            }
        }
    }

    /// True of a name that is a table's, or of a file that says what an output is: no file of the input's is copied there.
    pub fn reserved(&self, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default();
        let tables = self.set.units.iter().filter_map(|unit| unit.file.file_name());
        tables.chain(place::DESCRIPTIONS.map(OsStr::new)).any(|reserved| reserved == name)
    }

    /// The folder that images go to.
    pub fn folder(&self, unit: usize, split: usize) -> PathBuf {
        let there = &self.set.units[unit];
        if !self.division.apart {
            return there.images.clone();
        }
        let file = self.file(unit, split);
        let folder = file.parent().unwrap_or(Path::new(""));
        match (self.set.layout, there.images.strip_prefix(there.folder())) {
            (Layout::Coco, _) => folder.to_owned(),
            (_, Ok(rest)) => folder.join(rest),
            (_, Err(_)) => folder.join(&there.images),
        }
    }

    /// Where the image of a real sample goes; with a `tag` that of one made of it, which is a PNG.
    pub fn image(&self, real: &Real, split: usize, tag: &str) -> ImagePlacement {
        let placed = self.real(real, split);
        match tag {
            "" => placed.spelled_as(real),
            tag => placed.beside(|name| renamed(name, tag)).spelled_as(real),
        }
    }

    /// Where the image of a synthetic sample of a class goes that follows a real one.
    pub fn synthetic(&self, follows: &Real, split: usize, class: &str, key: &str) -> ImagePlacement {
        let name = format!("{key}.png");
        let Layout::ClassFolders(kind) = self.set.layout else {
            return self.real(follows, split).beside(|_| name.clone()).spelled_as(follows);
        };
        let split = match (self.division.anew, kind.are_splits) {
            (true, _) => Some(self.division.names[split].clone()),
            (false, true) => follows.path.iter().next().map(|name| name.to_string_lossy().into_owned()),
            (false, false) => None,
        };
        let class = kind.are_classes.then(|| class.to_owned());
        let file: PathBuf = split.into_iter().chain(class).chain([name]).collect();
        ImagePlacement { name: file.to_string_lossy().into_owned(), file }
    }

    fn real(&self, real: &Real, split: usize) -> ImagePlacement {
        match self.set.layout {
            Layout::ClassFolders(kind) if self.division.anew => {
                let rest = without_split(&real.path);
                let of_split = real.path.iter().next().filter(|_| kind.repeat_names && rest != real.path);
                let rest = match (of_split, rest.file_name()) {
                    // Two images of one name were in different splits.
                    (Some(split), Some(name)) => {
                        let (split, name) = (split.to_string_lossy(), name.to_string_lossy());
                        rest.with_file_name(format!("{split}-{name}"))
                    }
                    _ => rest,
                };
                let file = Path::new(&self.division.names[split]).join(rest);
                ImagePlacement { name: file.to_string_lossy().into_owned(), file }
            }
            _ if self.division.apart => {
                let steps = Path::new(&real.image).components();
                let steps_back = |step: &Component<'_>| matches!(step, Component::ParentDir);
                let name = if steps.clone().any(|step| steps_back(&step)) {
                    let steps = steps.filter(|step| !steps_back(step)).collect::<PathBuf>();
                    steps.to_string_lossy().into_owned()
                } else {
                    real.image.clone()
                };
                let folder = self.folder(real.unit, split);
                ImagePlacement { file: inside(&folder, &name).unwrap_or_else(|| folder.join(&name)), name }
            }
            _ => ImagePlacement { file: real.path.clone(), name: real.image.clone() },
        }
    }
}

/// The name of an image made of another one. What is made is a PNG.
fn renamed(image: &str, tag: &str) -> String {
    let stem = Path::new(image).file_stem().unwrap_or_default().to_string_lossy();
    // gelsim's own images are called KEY.tactile.png; the key ends at the first dot.
    let (key, rest) = stem.split_once('.').map_or((&*stem, String::new()), |(key, rest)| (key, format!(".{rest}")));
    format!("{key}{tag}{rest}.png")
}

/// An output that is being written into a folder.
pub struct Writer<'a> {
    root: PathBuf,
    units: &'a Units<'a>,
    labels: &'a Labels<'a>,
    open: BTreeMap<PathBuf, Open>,
    written: BTreeSet<PathBuf>,
    /// SHA-256 of every file, by its path from the folder.
    sums: BTreeMap<PathBuf, String>,
    /// Splits and units that have samples.
    pub filled: BTreeSet<(usize, PathBuf)>,
    /// Bytes so far.
    pub bytes: u64,
}

/// A unit being written.
enum Open {
    Table(BufWriter<File>, Sha256),
    Coco(CocoWriter),
    Tar(archive::Writer),
}

/// COCO annotations being written: images as they come, annotations behind them.
struct CocoWriter {
    file: BufWriter<File>,
    hash: Sha256,
    bytes: u64,
    images: u64,
    annotations: Vec<Vec<u8>>,
}

impl CocoWriter {
    /// Begins a file that has these keys before its images.
    fn create(path: &Path, rest: &Map<String, Value>) -> io::Result<Self> {
        let file = BufWriter::new(File::create_new(path)?);
        let mut writer = Self { file, hash: Sha256::new(), bytes: 0, images: 0, annotations: Vec::new() };
        writer.put(b"{\n")?;
        for (key, value) in rest {
            writer.put(format!("{}: {value},\n", Value::from(key.as_str())).as_bytes())?;
        }
        writer.put(b"\"images\": [")?;
        Ok(writer)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes)
    }

    fn append(&mut self, image: &[u8], annotations: Vec<Vec<u8>>) -> io::Result<()> {
        self.put(if self.images == 0 { b"\n" } else { b",\n" })?;
        self.images += 1;
        self.annotations.extend(annotations);
        self.put(image)
    }

    /// Its length and SHA-256.
    fn finish(mut self) -> io::Result<(u64, String)> {
        self.put(b"\n],\n\"annotations\": [")?;
        for (number, annotation) in std::mem::take(&mut self.annotations).iter().enumerate() {
            self.put(if number == 0 { b"\n" } else { b",\n" })?;
            self.put(annotation)?;
        }
        self.put(b"\n]\n}\n")?;
        self.file.flush()?;
        Ok((self.bytes, hex(&self.hash.finalize())))
    }
}

impl<'a> Writer<'a> {
    /// Writes into `root`, which must be there and empty.
    pub fn new(root: &Path, units: &'a Units<'a>, labels: &'a Labels<'a>) -> Self {
        let (open, written, sums, filled) = Default::default();
        Self { root: root.to_owned(), units, labels, open, written, sums, filled, bytes: 0 }
    }

    /// Appends a sample.
    pub fn append(&mut self, piece: Piece) -> Result<(), (PathBuf, io::Error)> {
        let file = self.units.file(piece.unit, piece.split);
        let path = self.root.join(&file);
        let failed = |error| (path.clone(), error);
        if !self.open.contains_key(&file) {
            let unit = self.create(&path, piece.unit).map_err(failed)?;
            self.open.insert(file.clone(), unit);
        }
        self.filled.insert((piece.split, file.clone()));
        for (name, bytes) in &piece.files {
            self.file(name, bytes)?;
        }
        match self.open.get_mut(&file) {
            Some(Open::Table(table, hash)) => {
                self.bytes += piece.row.len() as u64;
                hash.update(&piece.row);
                table.write_all(&piece.row).map_err(failed)
            }
            Some(Open::Coco(coco)) => coco.append(&piece.row, piece.annotations).map_err(failed),
            Some(Open::Tar(tar)) => tar.append(&piece.key, &piece.tar_files).map_err(failed),
            None => Ok(()),
        }
    }

    fn create(&mut self, path: &Path, unit: usize) -> io::Result<Open> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let set = self.units.set;
        let form = &set.units[unit].form;
        match form {
            Form::Tar => return archive::Writer::create(path).map(Open::Tar),
            Form::Coco => return CocoWriter::create(path, &set.annotations[unit].rest).map(Open::Coco),
            Form::Csv(_) | Form::JsonLines => {}
        }
        let header = self.labels.header(form);
        self.bytes += header.len() as u64;
        let mut table = BufWriter::new(File::create_new(path)?);
        table.write_all(&header)?;
        Ok(Open::Table(table, Sha256::new_with_prefix(&header)))
    }

    /// Writes a complete file, unless it is there already.
    pub fn file(&mut self, name: &Path, bytes: &[u8]) -> Result<(), (PathBuf, io::Error)> {
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

    /// Ends what is open, and writes the list of all files with their checksums.
    pub fn finish(&mut self) -> Result<(), (PathBuf, io::Error)> {
        for (name, unit) in std::mem::take(&mut self.open) {
            let path = self.root.join(&name);
            let failed = |error| (path.clone(), error);
            let sum = match unit {
                Open::Table(mut table, hash) => {
                    table.flush().map_err(failed)?;
                    hex(&hash.finalize())
                }
                Open::Coco(coco) => {
                    let (bytes, sum) = coco.finish().map_err(failed)?;
                    self.bytes += bytes;
                    sum
                }
                Open::Tar(mut tar) => {
                    let (bytes, sum) = tar.finish(&path).map_err(failed)?;
                    self.bytes += bytes;
                    sum
                }
            };
            self.sums.insert(name, sum);
        }
        let line = |(name, sum): (&PathBuf, &String)| format!("{sum}  {}\n", name.display());
        let list: String = self.sums.iter().map(line).collect();
        self.file(Path::new(place::FILES), list.as_bytes())
    }
}
