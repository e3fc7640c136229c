//! Files that are something else than their names say, known by how they begin: what people have in place of a file when a
//! download, a copy or a program went another way.

/// What a file is, behind "it is", and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Foreign {
    /// What it is.
    pub what: &'static str,
    /// What to do.
    pub help: &'static str,
}

/// What to do about a scene of an editor.
pub const BLENDER: &str = "open it in Blender and export it as .glb, .obj, .ply or .stl";
/// What to do about an archive.
pub const UNPACK: &str = "unpack it, and name what is in it";

const FROM_PICKLE: &str = "write what is in it with numpy.save, or as a file of the format that belongs here";

/// Beginnings of files, and what they are.
const BEGINNINGS: &[(&[u8], &str, &str)] = &[
    (b"\x1f\x8b", "packed by gzip", UNPACK),
    (b"PK\x03\x04", "a ZIP archive", UNPACK),
    (b"PK\x05\x06", "an empty ZIP archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    (b"\xfd7zXZ\x00", "packed by xz", UNPACK),
    (b"BZh", "packed by bzip2", UNPACK),
    (b"\x28\xb5\x2f\xfd", "packed by zstd", UNPACK),
    (b"%PDF-", "a PDF document", "export what belongs here from the program that made it"),
    (b"\x89PNG\r\n\x1a\n", "a PNG picture", "name the file that belongs here"),
    (b"\xff\xd8\xff", "a JPEG picture", "name the file that belongs here"),
    (b"GIF8", "a GIF picture", "save it as PNG"),
    (b"\x00\x00\x01\x00", "an icon", "save it as PNG"),
    (b"\x76\x2f\x31\x01", "an EXR picture", "name the file that belongs here"),
    (b"\x93NUMPY", "a NumPy array", "name the file that belongs here"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file", "write what is in it as files of their own"),
    (b"Kaydara FBX Binary", "an FBX file", BLENDER),
    (b"BLENDER", "a Blender file", BLENDER),
    (b"ISO-10303-21", "a STEP file", "open it in a CAD program and export it as .stl or .3mf"),
    (b"SQLite format 3\x00", "an SQLite database", "name the file that belongs here"),
    (b"\x80\x02", "a Python pickle", FROM_PICKLE),
    (b"\x80\x03", "a Python pickle", FROM_PICKLE),
    (b"\x80\x04", "a Python pickle", FROM_PICKLE),
    (b"\x80\x05", "a Python pickle", FROM_PICKLE),
];

/// What stands in place of a file of any kind: nothing that is read here is ever one of these.
pub fn placeholder(bytes: &[u8]) -> Option<Foreign> {
    if bytes.starts_with(b"version https://git-lfs.github.com/spec/") {
        let help = "fetch the file itself, in its repository: git lfs pull (git lfs install before, once)";
        return Some(Foreign { what: "a pointer of Git LFS, not the file itself", help });
    }
    if bytes.starts_with(b"\x00\x05\x16\x07") || bytes.starts_with(b"\x00\x05\x16\x00") {
        let help = "remove it: the file itself has the same name without ._ before it";
        return Some(Foreign { what: "a companion file of macOS (._NAME) without any content", help });
    }
    let head = &bytes[..bytes.len().min(256)];
    let text = String::from_utf8_lossy(head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head)).trim_start().to_lowercase();
    if text.starts_with("<!doctype html") || text.starts_with("<html") {
        let help =
            "download the file itself: the page says why it did not come, such as a login or an address that is gone";
        return Some(Foreign { what: "a web page (HTML)", help });
    }
    None
}

/// What a file is that is not what belongs there; `None` if nobody knows.
pub fn recognise(bytes: &[u8]) -> Option<Foreign> {
    if bytes.is_empty() {
        return Some(Foreign { what: "empty", help: "copy or download it again: it has 0 bytes" });
    }
    if let Some(foreign) = placeholder(bytes) {
        return Some(foreign);
    }
    if bytes.get(257..262) == Some(b"ustar") {
        return Some(Foreign { what: "a tar archive", help: UNPACK });
    }
    let known = BEGINNINGS.iter().find(|(beginning, ..)| bytes.starts_with(beginning));
    if let Some((_, what, help)) = known {
        return Some(Foreign { what, help });
    }
    let head = &bytes[..bytes.len().min(512)];
    if head.iter().all(|byte| *byte == 0) {
        return Some(Foreign { what: "all zeros", help: "copy or download it again: nothing of it has arrived" });
    }
    None
}

/// The same where binary data belongs: text is told, too.
pub fn recognise_in_binary(bytes: &[u8]) -> Option<Foreign> {
    recognise(bytes).or_else(|| {
        let head = &bytes[..bytes.len().min(512)];
        let is_text =
            std::str::from_utf8(head).is_ok_and(|text| !text.contains(|c: char| c.is_control() && !c.is_whitespace()));
        is_text.then_some(Foreign { what: "text", help: "it may say itself why it is not what belongs here" })
    })
}

/// In one sentence, as a reason: what it is, and what to do.
impl std::fmt::Display for Foreign {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "it is {}: {}", self.what, self.help)
    }
}

impl std::error::Error for Foreign {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_in_place_of_a_file_is_named() {
        for (bytes, what) in [
            (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n".as_slice(), "a pointer of Git LFS"),
            (b"\xef\xbb\xbf \n<!DOCTYPE html><html>", "a web page"),
            (b"<HTML><head>", "a web page"),
            (b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X", "a companion file of macOS"),
            (b"", "empty"),
            (b"PK\x03\x04rest", "a ZIP archive"),
            (b"\x1f\x8b\x08", "packed by gzip"),
            (b"\xff\xd8\xff\xe0", "a JPEG picture"),
            (&[0; 600], "all zeros"),
        ] {
            let found = recognise(bytes).unwrap_or_else(|| panic!("{what}"));
            assert!(found.what.starts_with(what) && !found.help.is_empty(), "{found}");
        }
        assert_eq!(recognise(b"solid cube"), None);
        assert_eq!(recognise_in_binary(b"{\"message\": \"Not Found\"}\n").map(|foreign| foreign.what), Some("text"));
        assert_eq!(recognise_in_binary(b"\x01\x02\x03"), None);
    }
}
