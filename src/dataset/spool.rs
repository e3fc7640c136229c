//! Keeps files of a sample on disk until their place in the shard comes, so that a long sequence takes little memory.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use super::archive::{FileContent, Member};
use gelsim_files::write::recreate_file;

/// A file without a name, which the system removes when nobody holds it open.
pub struct Spool {
    file: Arc<File>,
    end: u64,
}

impl Spool {
    /// Makes a spool. It replaces what is at `path` for a moment and leaves nothing there.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = Arc::new(recreate_file(path)?);
        fs::remove_file(path)?;
        Ok(Self { file, end: 0 })
    }

    /// Forgets all content. Nobody may read it any more.
    pub fn clear(&mut self) -> io::Result<()> {
        self.end = 0;
        self.file.set_len(0)
    }

    /// Writes the content of a sample's file to the spool, and returns the file with a reference to it.
    pub fn put(&mut self, Member { suffix, bytes }: Member) -> io::Result<Member> {
        let content = bytes.read()?;
        self.file.write_all_at(&content, self.end)?;
        let (at, length) = (self.end, content.len());
        self.end += length as u64;
        Ok(Member { suffix, bytes: FileContent::Spooled { file: Arc::clone(&self.file), at, length } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_away_reads_the_same_and_leaves_no_name_behind() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(".0.partial");
        std::fs::write(&path, "what a killed run left").expect("a file");
        let mut spool = Spool::create(&path).expect("a file");
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
        drop(spool.put(Member::new("lost", vec![9; 50])).expect("room"));
        spool.clear().expect("room");
        let contents = [vec![1_u8, 2, 3], Vec::new(), vec![7; 100_000]];
        let put = contents.clone().map(|bytes| spool.put(Member::new("a", bytes)).expect("room"));
        drop(spool);
        for (member, content) in put.iter().zip(&contents) {
            assert_eq!(
                (member.bytes.byte_count(), &*member.bytes.read().expect("a file")),
                (content.len(), &content[..])
            );
        }
    }
}
