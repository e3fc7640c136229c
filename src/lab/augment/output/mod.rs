//! An output in the layout of its input: units of the same form, images beside them.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::input::{Form, Set};
use super::split::Division;
use crate::dataset::archive;
use crate::dataset::archive::Member;
use crate::files::hash::{hex, sha256};

pub mod labels;
pub mod place;

use labels::Labels;

/// One sample, ready to be written.
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
    /// Its line in a table.
    pub row: Vec<u8>,
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
        self.file(unit, split).parent().unwrap_or(Path::new("")).to_owned()
    }
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
    Tar(archive::Writer),
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
            let form = &self.units.set.units[piece.unit].form;
            let unit = self.create(&path, form).map_err(failed)?;
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
            Some(Open::Tar(tar)) => tar.append(&piece.key, &piece.tar_files).map_err(failed),
            None => Ok(()),
        }
    }

    fn create(&mut self, path: &Path, form: &Form) -> io::Result<Open> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        if *form == Form::Tar {
            return archive::Writer::create(path).map(Open::Tar);
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
