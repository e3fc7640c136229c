//! A shard read back: the samples in a tar, one after the other, each with its files.

use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::ControlFlow;
use std::path::Path;

/// The files of one sample.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Files {
    /// The sample's key.
    pub key: String,
    /// End of the name, after key and dot, and content of each file, in order.
    pub members: Vec<(String, Vec<u8>)>,
}

impl Files {
    /// The content of the file with the name's end `suffix`.
    pub fn member(&self, suffix: &str) -> Option<&[u8]> {
        self.members.iter().find(|(name, _)| name == suffix).map(|(_, bytes)| bytes.as_slice())
    }
}

/// Reads the tar at `path`; see [`read`].
pub fn open(path: &Path, visit: impl FnMut(Files) -> ControlFlow<()>) -> Result<(), String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    read(BufReader::with_capacity(1 << 18, file), visit)
}

/// Shows every sample of a tar to `visit`, until that breaks off. What follows each other under one key is one sample.
///
/// Takes no more memory than the sample that is largest, whatever a header says.
pub fn read(tar: impl Read, mut visit: impl FnMut(Files) -> ControlFlow<()>) -> Result<(), String> {
    let mut archive = tar::Archive::new(tar);
    let mut files = Files::default();
    for entry in archive.entries().map_err(|error| error.to_string())? {
        let mut entry = entry.map_err(|error| format!("not a tar: {error}"))?;
        let name = entry.path_bytes().into_owned();
        let shown = String::from_utf8_lossy(&name).escape_debug().to_string();
        if !entry.header().entry_type().is_file() {
            return Err(format!("{shown} is no regular file"));
        }
        let split = str::from_utf8(&name).ok().and_then(|name| name.split_once('.'));
        let Some((key, suffix)) = split else { return Err(format!("{shown} is not named KEY.LAYER")) };
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|error| format!("{shown}: {error}"))?;
        if bytes.len() as u64 != entry.size() {
            return Err(format!("{shown} ends after {} of {} bytes", bytes.len(), entry.size()));
        }
        if files.key != key && !files.members.is_empty() && visit(std::mem::take(&mut files)).is_break() {
            return Ok(());
        }
        key.clone_into(&mut files.key);
        files.members.push((suffix.to_owned(), bytes));
    }
    if !files.members.is_empty() {
        // Whether it breaks off makes no difference at the end.
        let _ = visit(files);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tar(files: &[(&str, &str)]) -> Vec<u8> {
        let mut builder = tar::Builder::new(Vec::new());
        for (name, text) in files {
            let mut header = tar::Header::new_ustar();
            header.set_path(name).expect("a name");
            header.set_size(text.len() as u64);
            header.set_cksum();
            builder.append(&header, text.as_bytes()).expect("memory");
        }
        builder.into_inner().expect("memory")
    }

    fn samples(tar: &[u8]) -> Result<Vec<Files>, String> {
        let mut found = Vec::new();
        read(tar, |files| {
            found.push(files);
            ControlFlow::Continue(())
        })?;
        Ok(found)
    }

    #[test]
    fn what_follows_each_other_under_one_key_is_one_sample() {
        let tar = tar(&[("0.png", "a"), ("0.a.exr", "bc"), ("1.png", ""), ("0.json", "d")]);
        let found = samples(&tar).expect("a tar");
        let keys: Vec<&str> = found.iter().map(|files| files.key.as_str()).collect();
        assert_eq!(keys, ["0", "1", "0"]);
        assert_eq!(found[0].member("a.exr"), Some(&b"bc"[..]));
        assert_eq!(found[0].member("json"), None);
        let mut first = None;
        read(tar.as_slice(), |files| {
            first = Some(files);
            ControlFlow::Break(())
        })
        .expect("a tar");
        assert_eq!(first.as_ref(), found.first());
    }

    #[test]
    fn a_cut_tar_is_an_error_wherever_it_is_cut_but_between_files() {
        let whole = tar(&[("0.png", "some bytes"), ("0.json", "{}")]);
        assert_eq!(samples(&whole).expect("a tar").len(), 1);
        for length in (1..1536).filter(|length| length % 1024 != 0) {
            let found = samples(&whole[..length]);
            // The padding after a file's last byte is not missed.
            let padding = (512 + 10..1024).contains(&length);
            assert!(found.is_err() || padding, "{length}: {found:?}");
        }
        assert!(samples(b"").expect("no file").is_empty());
    }

    #[test]
    fn names_that_are_no_samples_are_refused() {
        assert!(samples(&tar(&[("README", "x")])).is_err());
        assert!(samples(&vec![7; 4096]).is_err());
    }
}
