//! Files of a sample that wait on disk for their place in a shard, so that a long sequence takes no memory.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use super::archive::{Bytes, Member};
use gelsim_files::write::create_anew;

/// A file without a name, which the system removes when nobody holds it any more.
pub struct Spool {
    file: Arc<File>,
    end: u64,
}

impl Spool {
    /// Makes one in place of what may be at `path`. Nothing stays there.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = Arc::new(create_anew(path)?);
        fs::remove_file(path)?;
        Ok(Self { file, end: 0 })
    }

    /// Forgets what was put away: nobody may read it any more.
    pub fn clear(&mut self) -> io::Result<()> {
        self.end = 0;
        self.file.set_len(0)
    }

    /// Puts the content of a sample's file away.
    pub fn put(&mut self, Member { suffix, bytes }: Member) -> io::Result<Member> {
        let content = bytes.read()?;
        self.file.write_all_at(&content, self.end)?;
        let (at, length) = (self.end, content.len());
        self.end += length as u64;
        Ok(Member { suffix, bytes: Bytes::Spooled { file: Arc::clone(&self.file), at, length } })
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
            assert_eq!((member.bytes.count(), &*member.bytes.read().expect("a file")), (content.len(), &content[..]));
        }
    }
}
