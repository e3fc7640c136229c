//! What holds a shard's files, a tar ([`archive`]) or a folder ([`imagefolder`]), behind one set of verbs: created,
//! appended to, finished, put in place; measured, checked, read.

use gelsim_files::fail_point::Step;
use gelsim_files::input::{self, MOST_IMAGE_BYTES};
use std::fs;
use std::io::{self, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::archive::{self, Files, Head, Member};
use super::cleanup;
use super::imagefolder;
use gelsim_files::hash;
use gelsim_job::config::output::Container;
use gelsim_job::label::key;
use gelsim_job::layout::Shard;

/// A container being written.
pub enum Writer {
    /// A tar.
    Tar(archive::Writer),
    /// A folder.
    Folder(imagefolder::Writer),
}

impl Writer {
    /// Appends a sample's files. Samples must come in the order of the shard.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        match self {
            Self::Tar(tar) => tar.append(key, members),
            Self::Folder(folder) => folder.append(key, members),
        }
    }

    /// Brings to disk what was begun at `path`, which must still be there. Its bytes and SHA-256.
    pub fn finish(&mut self, path: &Path) -> io::Result<(u64, String)> {
        match self {
            Self::Tar(tar) => tar.finish(path),
            Self::Folder(folder) => folder.finish(path),
        }
    }
}

/// What a shard is written to and read from.
pub trait ShardContainer: Copy {
    /// The name of a shard in `data`.
    fn file_name(self, shard: &Shard) -> String;

    /// The same from the dataset's folder.
    fn file(self, shard: &Shard) -> String;

    /// Starts a shard at `partial`, in place of what a killed run may have left there, that will go to `path`.
    fn create(self, partial: &Path, path: &Path, shard: &Shard) -> io::Result<Writer>;

    /// Gives what is at `partial` its final name, in place of what is there. A folder that is there goes aside first: no
    /// call exchanges two folders on every disk.
    fn put_in_place(self, partial: &Path, path: &Path) -> io::Result<()>;

    /// Bytes of the shard at `path`.
    fn measure(self, path: &Path) -> io::Result<u64>;

    /// Bytes and SHA-256 of the shard at `path`: reads all of it.
    fn checksum(self, path: &Path) -> io::Result<(u64, String)>;

    /// Shows every sample of the shard at `path` to `visit`, in order, until that breaks off, with the files that are
    /// `wanted`; the others are not read.
    fn read(
        self,
        path: &Path,
        wanted: impl FnMut(Head<'_>) -> bool,
        visit: impl FnMut(Files) -> ControlFlow<()>,
    ) -> Result<(), String>;

    /// Bytes that a sample's files take; `label` is the content of one of them.
    fn bytes_of(self, shard: &Shard, index: u64, label: &[u8], members: &[Member]) -> u64;

    /// Bytes of a shard without samples.
    fn empty_bytes(self) -> u64;
}

impl ShardContainer for Container {
    fn file_name(self, shard: &Shard) -> String {
        match self {
            Self::Tar => format!("{}.tar", shard.name()),
            Self::Folder => shard.name(),
        }
    }

    fn file(self, shard: &Shard) -> String {
        format!("data/{}", self.file_name(shard))
    }

    fn create(self, partial: &Path, path: &Path, shard: &Shard) -> io::Result<Writer> {
        match self {
            Self::Tar => archive::Writer::create(partial).map(Writer::Tar),
            Self::Folder => {
                imagefolder::free_of_others(path)?;
                cleanup::remove(partial)?;
                imagefolder::Writer::create(partial, &shard.name()).map(Writer::Folder)
            }
        }
    }

    fn put_in_place(self, partial: &Path, path: &Path) -> io::Result<()> {
        let aside = aside(path);
        if self == Self::Folder {
            cleanup::remove(&aside)?;
            match fs::rename(path, &aside) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
            Step::OldShardAside.reached(path);
        }
        fs::rename(partial, path)?;
        Step::ShardRenamed.reached(path);
        if self == Self::Folder { cleanup::remove(&aside) } else { Ok(()) }
    }

    fn measure(self, path: &Path) -> io::Result<u64> {
        match self {
            Self::Tar => input::open_inside(path).map(|(_, length)| length),
            Self::Folder => imagefolder::measure(path),
        }
    }

    fn checksum(self, path: &Path) -> io::Result<(u64, String)> {
        match self {
            Self::Tar => {
                let (file, length) = input::open_inside(path)?;
                // What is written to it meanwhile is no longer what was measured.
                Ok((length, hash::sha256_of(file.take(length))?))
            }
            Self::Folder => imagefolder::checksum(path),
        }
    }

    fn read(
        self,
        path: &Path,
        mut wanted: impl FnMut(Head<'_>) -> bool,
        visit: impl FnMut(Files) -> ControlFlow<()>,
    ) -> Result<(), String> {
        match self {
            Self::Tar => archive::open(path, |head| wanted(head).then_some(MOST_IMAGE_BYTES), visit),
            Self::Folder => imagefolder::read(path, wanted, visit),
        }
    }

    fn bytes_of(self, shard: &Shard, index: u64, label: &[u8], members: &[Member]) -> u64 {
        match self {
            Self::Tar => archive::bytes_of(members),
            Self::Folder => {
                let suffixes = members.iter().map(|member| member.suffix.as_str());
                let files: usize = members.iter().map(|member| member.bytes.count()).sum();
                (files + imagefolder::rows(&shard.name(), &key(index), label, suffixes).len()) as u64
            }
        }
    }

    fn empty_bytes(self) -> u64 {
        match self {
            Self::Tar => archive::EMPTY_BYTES,
            Self::Folder => 0,
        }
    }
}

/// Where the folder at `path` goes while another takes its place.
fn aside(path: &Path) -> PathBuf {
    let name = path.file_name().expect("a shard's path ends in its name").to_string_lossy();
    path.with_file_name(format!(".{name}.replaced.partial"))
}
