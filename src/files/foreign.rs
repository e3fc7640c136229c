//! Recognises, by their first bytes, files that are not what their names say: what a failed download, copy or
//! conversion leaves in place of a file.

/// What a file is, as the end of a sentence that begins with "it is", and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForeignFile {
    /// What it is.
    pub what: &'static str,
    /// What to do.
    pub help: &'static str,
}

/// What to do with a scene of a 3D editor.
pub const EXPORT_FROM_BLENDER: &str = "open it in Blender and export it as .glb, .obj, .ply or .stl";
/// What to do with a USD file.
pub const EXPORT_USD: &str = "open it in Blender and export it as .glb, or, for many files, after pip install bpy: python -c \"import bpy; \
     bpy.ops.wm.read_factory_settings(use_empty=True); bpy.ops.wm.usd_import(filepath='IN.usd'); \
     bpy.ops.export_scene.gltf(filepath='OUT.glb')\"";
/// What to do with an archive.
pub const UNPACK_ARCHIVE: &str = "unpack it, and name what is in it";

const FROM_UTF_16: &str = "save it as UTF-8, e.g. iconv -f utf-16 -t utf-8 IN > OUT";

const FROM_PICKLE: &str = "write what is in it with numpy.save, or as a file of the format that belongs here";

/// The first bytes of known kinds of files, what they are, and what to do.
const SIGNATURES: &[(&[u8], &str, &str)] = &[
    (b"\xff\xfe\x00\x00", "UTF-32 text", "save it as UTF-8, e.g. iconv -f utf-32 -t utf-8 IN > OUT"),
    (b"\xff\xfe", "UTF-16 text", FROM_UTF_16),
    (b"\xfe\xff", "UTF-16 text", FROM_UTF_16),
    (b"\x1f\x8b", "packed by gzip", UNPACK_ARCHIVE),
    (b"PK\x03\x04", "a ZIP archive", UNPACK_ARCHIVE),
    (b"PK\x05\x06", "an empty ZIP archive", UNPACK_ARCHIVE),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK_ARCHIVE),
    (b"Rar!\x1a\x07", "a RAR archive", UNPACK_ARCHIVE),
    (b"\xfd7zXZ\x00", "packed by xz", UNPACK_ARCHIVE),
    (b"BZh", "packed by bzip2", UNPACK_ARCHIVE),
    (b"\x28\xb5\x2f\xfd", "packed by zstd", UNPACK_ARCHIVE),
    (b"%PDF-", "a PDF document", "export what belongs here from the program that made it"),
    (b"\x89PNG\r\n\x1a\n", "a PNG picture", "name the file that belongs here"),
    (b"\xff\xd8\xff", "a JPEG picture", "name the file that belongs here"),
    (b"GIF8", "a GIF picture", "save it as PNG"),
    (b"\x00\x00\x01\x00", "an icon", "save it as PNG"),
    (b"\x76\x2f\x31\x01", "an EXR picture", "name the file that belongs here"),
    (b"\x93NUMPY", "a NumPy array", "name the file that belongs here"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file", "write what is in it as files of their own"),
    (b"Kaydara FBX Binary", "an FBX file", EXPORT_FROM_BLENDER),
    (b"BLENDER", "a Blender file", EXPORT_FROM_BLENDER),
    (b"ISO-10303-21", "a STEP file", "open it in a CAD program and export it as .stl or .3mf"),
    (b"SQLite format 3\x00", "an SQLite database", "name the file that belongs here"),
    (b"\x80\x02", "a Python pickle", FROM_PICKLE),
    (b"\x80\x03", "a Python pickle", FROM_PICKLE),
    (b"\x80\x04", "a Python pickle", FROM_PICKLE),
    (b"\x80\x05", "a Python pickle", FROM_PICKLE),
];

/// Recognises what may stand in place of a file of any kind, such as a pointer of Git LFS. No file that is read here is
/// ever one of these.
pub fn identify_placeholder(bytes: &[u8]) -> Option<ForeignFile> {
    if bytes.starts_with(b"version https://git-lfs.github.com/spec/") {
        let help = "fetch the file itself, in its repository: git lfs pull (git lfs install before, once)";
        return Some(ForeignFile { what: "a pointer of Git LFS, not the file itself", help });
    }
    if bytes.starts_with(b"\x00\x05\x16\x07") || bytes.starts_with(b"\x00\x05\x16\x00") {
        let help = "remove it: the file itself has the same name without ._ before it";
        return Some(ForeignFile { what: "a companion file of macOS (._NAME) without any content", help });
    }
    let head = &bytes[..bytes.len().min(256)];
    let text = String::from_utf8_lossy(head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head)).trim_start().to_lowercase();
    if text.starts_with("<!doctype html") || text.starts_with("<html") {
        let help =
            "download the file itself: the page says why it did not come, such as a login or an address that is gone";
        return Some(ForeignFile { what: "a web page (HTML)", help });
    }
    None
}

/// Recognises a file that is not of a kind that is expected. Returns `None` if the kind is unknown.
pub fn identify_foreign_file(bytes: &[u8]) -> Option<ForeignFile> {
    if bytes.is_empty() {
        return Some(ForeignFile { what: "empty", help: "copy or download it again: it has 0 bytes" });
    }
    if let Some(foreign) = identify_placeholder(bytes) {
        return Some(foreign);
    }
    if bytes.get(257..262) == Some(b"ustar") {
        return Some(ForeignFile { what: "a tar archive", help: UNPACK_ARCHIVE });
    }
    let known = SIGNATURES.iter().find(|(beginning, ..)| bytes.starts_with(beginning));
    if let Some((_, what, help)) = known {
        return Some(ForeignFile { what, help });
    }
    let head = &bytes[..bytes.len().min(512)];
    if head.iter().all(|byte| *byte == 0) {
        return Some(ForeignFile { what: "all zeros", help: "copy or download it again: nothing of it has arrived" });
    }
    None
}

/// Recognises a foreign file where binary data is expected, as [`identify_foreign_file`] does; text is reported, too.
pub fn identify_foreign_binary(bytes: &[u8]) -> Option<ForeignFile> {
    identify_foreign_file(bytes).or_else(|| {
        let head = &bytes[..bytes.len().min(512)];
        let is_text =
            std::str::from_utf8(head).is_ok_and(|text| !text.contains(|c: char| c.is_control() && !c.is_whitespace()));
        is_text.then_some(ForeignFile { what: "text", help: "it may say itself why it is not what belongs here" })
    })
}

/// Decodes a text. The error says where it is not UTF-8, or what it is instead, and what to do.
pub fn decode_text(bytes: Vec<u8>) -> Result<String, String> {
    if let Some(foreign) = identify_foreign_file(&bytes).filter(|_| !bytes.is_empty()) {
        return Err(foreign.to_string());
    }
    String::from_utf8(bytes).map_err(|error| {
        let (before, bytes) = (error.utf8_error().valid_up_to(), error.as_bytes());
        let before = String::from_utf8_lossy(&bytes[..before]);
        let (line, column) =
            (before.matches('\n').count() + 1, before.rsplit('\n').next().unwrap_or("").chars().count() + 1);
        format!("it is not UTF-8 at line {line}, column {column}: save it so, e.g. iconv -f latin1 -t utf-8 IN > OUT")
    })
}

/// Writes one sentence to be used as a reason: what it is, and what to do.
impl std::fmt::Display for ForeignFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "it is {}: {}", self.what, self.help)
    }
}

impl std::error::Error for ForeignFile {}

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
            (b"\xff\xfea\0", "UTF-16 text"),
            (b"\x1f\x8b\x08", "packed by gzip"),
            (b"\xff\xd8\xff\xe0", "a JPEG picture"),
            (&[0; 600], "all zeros"),
        ] {
            let found = identify_foreign_file(bytes).unwrap_or_else(|| panic!("{what}"));
            assert!(found.what.starts_with(what) && !found.help.is_empty(), "{found}");
        }
        assert_eq!(identify_foreign_file(b"solid cube"), None);
        assert_eq!(
            identify_foreign_binary(b"{\"message\": \"Not Found\"}\n").map(|foreign| foreign.what),
            Some("text")
        );
        assert_eq!(identify_foreign_binary(b"\x01\x02\x03"), None);
    }
}
