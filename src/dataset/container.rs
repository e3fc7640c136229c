//! Containers of a shard's files, a tar ([`archive`]) or a folder ([`imagefolder`]), behind one interface.

use gelsim_files::fail_point::Step;
use gelsim_files::input::{self, MAX_IMAGE_BYTES};
use std::fs;
use std::io::{self, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::archive::{self, Member, MemberHead, SampleFiles};
use super::cleanup;
use super::imagefolder;
use gelsim_files::hash;
use gelsim_job::config::output::Container;
use gelsim_job::label::sample_key;
use gelsim_job::layout::Shard;

/// A container that is being written.
pub enum ContainerWriter {
    /// A tar.
    Tar(archive::TarWriter),
    /// A folder.
    Folder(imagefolder::FolderWriter),
}

impl ContainerWriter {
    /// Appends the files of a sample. Samples must come in the order of the shard.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        match self {
            Self::Tar(tar) => tar.append(key, members),
            Self::Folder(folder) => folder.append(key, members),
        }
    }

    /// Ends the container and brings it to disk. It must still be what is at `path`. Returns its bytes and SHA-256.
    pub fn finish(&mut self, path: &Path) -> io::Result<(u64, String)> {
        match self {
            Self::Tar(tar) => tar.finish(path),
            Self::Folder(folder) => folder.finish(path),
        }
    }
}

/// The operations on a shard's container.
pub trait ShardContainer: Copy {
    /// Returns the name of a shard in the folder `data`.
    fn file_name(self, shard: &Shard) -> String;

    /// Returns the path of a shard from the dataset's folder.
    fn relative_path(self, shard: &Shard) -> String;

    /// Starts a shard at `partial`, replacing what a killed run may have left there. It will be moved to `path`.
    fn create(self, partial: &Path, path: &Path, shard: &Shard) -> io::Result<ContainerWriter>;

    /// Moves what is at `partial` to its final place and replaces what is there. A folder in that place is moved aside
    /// first, since not every disk can exchange two folders in one call.
    fn put_in_place(self, partial: &Path, path: &Path) -> io::Result<()>;

    /// Returns the bytes of the shard at `path`.
    fn measure_bytes(self, path: &Path) -> io::Result<u64>;

    /// Returns the bytes and the SHA-256 of the shard at `path`. Reads all of it.
    fn checksum(self, path: &Path) -> io::Result<(u64, String)>;

    /// Calls `visit` with every sample of the shard at `path`, in order, until that breaks off. Only files for which
    /// `wanted` returns true are read.
    fn visit_samples(
        self,
        path: &Path,
        wanted: impl FnMut(MemberHead<'_>) -> bool,
        visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
    ) -> Result<(), String>;

    /// Returns the bytes that a sample's files take. `label` is the content of its label.
    fn sample_bytes(self, shard: &Shard, index: u64, label: &[u8], members: &[Member]) -> u64;

    /// Returns the bytes of a shard without samples.
    fn empty_bytes(self) -> u64;
}

impl ShardContainer for Container {
    fn file_name(self, shard: &Shard) -> String {
        match self {
            Self::Tar => format!("{}.tar", shard.name()),
            Self::Folder => shard.name(),
        }
    }

    fn relative_path(self, shard: &Shard) -> String {
        format!("data/{}", self.file_name(shard))
    }

    fn create(self, partial: &Path, path: &Path, shard: &Shard) -> io::Result<ContainerWriter> {
        match self {
            Self::Tar => archive::TarWriter::create(partial).map(ContainerWriter::Tar),
            Self::Folder => {
                imagefolder::check_no_foreign_files(path)?;
                cleanup::remove_path(partial)?;
                imagefolder::FolderWriter::create(partial, &shard.name()).map(ContainerWriter::Folder)
            }
        }
    }

    fn put_in_place(self, partial: &Path, path: &Path) -> io::Result<()> {
        let aside = replaced_path(path);
        if self == Self::Folder {
            cleanup::remove_path(&aside)?;
            match fs::rename(path, &aside) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
            Step::OldShardAside.pause_if_requested(path);
        }
        fs::rename(partial, path)?;
        Step::ShardRenamed.pause_if_requested(path);
        if self == Self::Folder { cleanup::remove_path(&aside) } else { Ok(()) }
    }

    fn measure_bytes(self, path: &Path) -> io::Result<u64> {
        match self {
            Self::Tar => input::open_without_links(path).map(|(_, length)| length),
            Self::Folder => imagefolder::measure_bytes(path),
        }
    }

    fn checksum(self, path: &Path) -> io::Result<(u64, String)> {
        match self {
            Self::Tar => {
                let (file, length) = input::open_without_links(path)?;
                // If somebody writes to it meanwhile, read no more than the length that is returned.
                Ok((length, hash::sha256_of_reader(file.take(length))?))
            }
            Self::Folder => imagefolder::checksum_folder(path),
        }
    }

    fn visit_samples(
        self,
        path: &Path,
        mut wanted: impl FnMut(MemberHead<'_>) -> bool,
        visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
    ) -> Result<(), String> {
        match self {
            Self::Tar => archive::visit_tar_file(path, |head| wanted(head).then_some(MAX_IMAGE_BYTES), visit),
            Self::Folder => imagefolder::visit_folder(path, wanted, visit),
        }
    }

    fn sample_bytes(self, shard: &Shard, index: u64, label: &[u8], members: &[Member]) -> u64 {
        match self {
            Self::Tar => archive::tar_bytes_of(members),
            Self::Folder => {
                let suffixes = members.iter().map(|member| member.suffix.as_str());
                let files: usize = members.iter().map(|member| member.bytes.byte_count()).sum();
                (files + imagefolder::build_rows(&shard.name(), &sample_key(index), label, suffixes).len()) as u64
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

/// Returns the name that the folder at `path` has while it is replaced.
fn replaced_path(path: &Path) -> PathBuf {
    let name = path.file_name().expect("a shard's path ends in its name").to_string_lossy();
    path.with_file_name(format!(".{name}.replaced.partial"))
}
