//! Mesh files: OBJ, STL or PLY becomes one cleaned [`Mesh`] in millimetres.
//!
//! Each format has its reader; all of them give vertices and triangles to [`Mesh::new`], which cleans and
//! centres. Readers reserve no memory for what a file claims before they have seen that it has room for it.

mod obj;
mod ply;
mod polygon;
mod stl;

use super::hash::sha256;
use super::input;
use crate::core::mesh::{Cleaned, Mesh, MeshError};
use serde::Serialize;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// A mesh read from a file.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The mesh, in mm.
    pub mesh: Mesh,
    /// What cleaning removed.
    pub cleaned: Cleaned,
    /// SHA-256 of the file's bytes, in lower-case hexadecimal digits.
    pub sha256: String,
    /// What the file held.
    pub given: Given,
}

/// What a file holds, before anything is cleaned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Given {
    /// Its format.
    pub format: Format,
    /// Its size.
    pub bytes: usize,
    /// Vertices: three per triangle in STL.
    pub vertices: usize,
    /// Triangles, with those into which polygons were divided.
    pub triangles: usize,
}

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Wavefront OBJ: `v` and `f` statements; everything else is passed over.
    Obj,
    /// STL, ASCII or binary.
    Stl,
    /// PLY: ASCII or binary of either byte order.
    Ply,
}

impl Format {
    /// The format that the extension of `path` stands for, in any case.
    pub fn from_path(path: &Path) -> Option<Format> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Format::Obj),
            "stl" => Some(Format::Stl),
            "ply" => Some(Format::Ply),
            _ => None,
        }
    }
}

/// Reads `path` (.obj, .stl or .ply, in any case); a coordinate of 1 in the file is `mm_per_unit` mm.
///
/// # Errors
///
/// Every [`MeshFileProblem`] there is, with the path and, in text, the line.
pub fn load(path: &Path, mm_per_unit: f64) -> Result<Loaded, MeshFileError> {
    let in_file = |error: MeshFileError| MeshFileError { path: Some(path.to_path_buf()), ..error };
    let format = Format::from_path(path).ok_or_else(|| in_file(MeshFileProblem::UnknownExtension.into()))?;
    let bytes = input::read(path, input::MOST_MESH_BYTES)
        .map_err(|error| in_file(MeshFileProblem::Unreadable(error).into()))?;
    let sha256 = sha256(&bytes);
    let raw = read(&bytes, format).map_err(in_file)?;
    let given = Given { format, bytes: bytes.len(), vertices: raw.vertices.len(), triangles: raw.triangles.len() };
    drop(bytes);
    let (mesh, cleaned) = raw.mesh(mm_per_unit).map_err(in_file)?;
    Ok(Loaded { mesh, cleaned, sha256, given })
}

/// Reads a mesh from the bytes of a file; a coordinate of 1 in it is `mm_per_unit` mm. Never panics.
///
/// # Errors
///
/// As [`load`], without the path.
pub fn parse(bytes: &[u8], format: Format, mm_per_unit: f64) -> Result<(Mesh, Cleaned), MeshFileError> {
    read(bytes, format)?.mesh(mm_per_unit)
}

fn read(bytes: &[u8], format: Format) -> Result<Raw, MeshFileError> {
    match format {
        Format::Obj => obj::read(bytes),
        Format::Stl => stl::read(bytes),
        Format::Ply => ply::read(bytes),
    }
}

/// What a reader finds in a file, in the file's unit.
#[derive(Default)]
struct Raw {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Raw {
    fn mesh(mut self, mm_per_unit: f64) -> Result<(Mesh, Cleaned), MeshFileError> {
        for coordinate in self.vertices.as_flattened_mut() {
            *coordinate *= mm_per_unit;
        }
        Ok(Mesh::new(self.vertices, self.triangles)?)
    }
}

/// Why a mesh file cannot be used, and where. Its text is one line, such as
/// `objects/a.obj:17: face refers to vertex 9, but the file has 8 so far`.
#[derive(Debug, thiserror::Error)]
pub struct MeshFileError {
    /// The file, where it is known.
    pub path: Option<PathBuf>,
    /// The line in it, counted from 1, in a text format and where one line is to blame.
    pub line: Option<usize>,
    /// What is wrong.
    pub problem: MeshFileProblem,
}

/// What can be wrong with a mesh file.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileProblem {
    /// The file cannot be read from the disk.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// The extension names no format of [`Format`].
    #[error("is not named like a mesh: use .obj, .stl or .ply")]
    UnknownExtension,
    /// What it holds makes no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The file breaks the rules of its format.
    #[error("{0}")]
    Malformed(String),
    /// A header says that there is more (or, in binary STL, less) than there is.
    #[error("says {claimed} {what} but has room for {room}")]
    Room {
        /// Number in the header.
        claimed: u64,
        /// Of what.
        what: String,
        /// At most so many fit in the bytes that follow.
        room: u64,
    },
    /// The file ends before it is complete.
    #[error("ends too early: in {0}")]
    EndsEarly(String),
}

impl MeshFileError {
    /// A way out.
    pub fn help(&self) -> &'static str {
        match &self.problem {
            MeshFileProblem::Unreadable(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                "free some memory, or use a smaller mesh"
            }
            MeshFileProblem::Unreadable(_) => "check the path and who may read it",
            MeshFileProblem::UnknownExtension => "export it as one of these, or give the file the ending of its format",
            _ => "repair the mesh, or leave it out",
        }
    }

    fn at_line(line: usize, problem: MeshFileProblem) -> Self {
        MeshFileError { path: None, line: Some(line), problem }
    }
}

impl From<MeshError> for MeshFileError {
    fn from(error: MeshError) -> Self {
        MeshFileProblem::Mesh(error).into()
    }
}

impl From<MeshFileProblem> for MeshFileError {
    fn from(problem: MeshFileProblem) -> Self {
        MeshFileError { path: None, line: None, problem }
    }
}

impl fmt::Display for MeshFileError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match (&self.path, self.line) {
            (Some(path), Some(line)) => write!(f, "{}:{line}: ", path.display())?,
            (Some(path), None) => write!(f, "{}: ", path.display())?,
            (None, Some(line)) => write!(f, "line {line}: ")?,
            (None, None) => {}
        }
        self.problem.fmt(f)
    }
}

/// Takes text apart into words and counts its lines, in any encoding that contains ASCII.
///
/// A line ends with LF, CR LF or CR. Between words stand blanks, or `\` at the end of a line; `#` starts a comment.
#[derive(Clone, Copy)]
struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Words { bytes: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), at: 0, line: 1 }
    }

    /// The next word of this line, or of the lines that continue it.
    fn word(&mut self) -> Option<&'a [u8]> {
        if !self.has_word() {
            return None;
        }
        let rest = &self.bytes[self.at..];
        let mut end = 1;
        while let Some(byte) = rest.get(end) {
            match byte {
                b' ' | b'\t' | b'\x0b' | b'\x0c' | b'\n' | b'\r' | b'#' => break,
                b'\\' if self.break_len(self.at + end + 1) > 0 => break,
                _ => end += 1,
            }
        }
        self.at += end;
        Some(&rest[..end])
    }

    /// Passes over blanks; whether a word follows in this line.
    fn has_word(&mut self) -> bool {
        loop {
            match self.bytes.get(self.at) {
                Some(b' ' | b'\t' | b'\x0b' | b'\x0c') => self.at += 1,
                Some(b'\\') if self.break_len(self.at + 1) > 0 => {
                    self.at += 1 + self.break_len(self.at + 1);
                    self.line += 1;
                }
                None | Some(b'\n' | b'\r' | b'#') => return false,
                Some(_) => return true,
            }
        }
    }

    /// The next word of this line or any further one.
    fn word_anywhere(&mut self) -> Option<&'a [u8]> {
        loop {
            match self.word() {
                None if self.next_line() => {}
                word => return word,
            }
        }
    }

    /// Passes over the rest of this line; false if no further one follows.
    fn next_line(&mut self) -> bool {
        let rest = &self.bytes[self.at..];
        let len = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
        self.at += len;
        self.at += self.break_len(self.at);
        self.line += 1;
        self.at < self.bytes.len()
    }

    /// Bytes of the line break at `at`: 0 if there is none.
    fn break_len(&self, at: usize) -> usize {
        match (self.bytes.get(at), self.bytes.get(at + 1)) {
            (Some(b'\r'), Some(b'\n')) => 2,
            (Some(b'\r' | b'\n'), _) => 1,
            _ => 0,
        }
    }
}

/// A number; also the `nan(ind)` of some C libraries.
fn number(word: &[u8]) -> Result<f64, MeshFileProblem> {
    let text = str::from_utf8(word).ok();
    match text.and_then(|text| text.parse().ok()) {
        Some(number) => Ok(number),
        None if text.is_some_and(|text| text.trim_start_matches(['+', '-']).starts_with("nan(")) => Ok(f64::NAN),
        None => Err(MeshFileProblem::Malformed(format!("{} is not a number", quoted(word)))),
    }
}

/// The next three numbers of the line.
fn coordinates(words: &mut Words) -> Result<[f64; 3], MeshFileProblem> {
    let mut point = [0.0; 3];
    for (given, coordinate) in point.iter_mut().enumerate() {
        let word = words
            .word()
            .ok_or_else(|| MeshFileProblem::Malformed(format!("a vertex has {given} coordinates instead of 3")))?;
        *coordinate = number(word)?;
    }
    Ok(point)
}

/// The start of a word for an error message, on one line whatever its bytes are.
fn quoted(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(40)]);
    format!("`{}`", text.escape_debug())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::fs;

    const CORNERS: [[f32; 3]; 8] = [
        [1.5, 2.0, -4.0],
        [5.5, 2.0, -4.0],
        [5.5, 6.0, -4.0],
        [1.5, 6.0, -4.0],
        [1.5, 2.0, 0.0],
        [5.5, 2.0, 0.0],
        [5.5, 6.0, 0.0],
        [1.5, 6.0, 0.0],
    ];
    const FACES: [[u32; 4]; 6] = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

    fn triangles() -> Vec<[u32; 3]> {
        FACES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
    }

    fn cube_obj() -> Vec<u8> {
        let mut text = String::from("# a cube\no cube\n");
        for [x, y, z] in CORNERS {
            text += &format!("v {x} {y} {z}\n");
        }
        for face in FACES {
            let [a, b, c, d] = face.map(|i| i + 1);
            text += &format!("f {a}/1/1 {b}//2 {c}/3 {d}\n");
        }
        text.into_bytes()
    }

    fn cube_stl_ascii() -> Vec<u8> {
        let mut text = String::from("solid cube\n");
        for triangle in triangles() {
            text += "facet normal 0 0 1\n  outer loop\n";
            for [x, y, z] in triangle.map(|i| CORNERS[i as usize]) {
                text += &format!("    vertex {x:e} {y:e} {z:e}\n");
            }
            text += "  endloop\nendfacet\n";
        }
        (text + "endsolid cube\n").into_bytes()
    }

    fn cube_stl_binary() -> Vec<u8> {
        let mut bytes = b"solid this header is binary all the same".to_vec();
        bytes.resize(80, b' ');
        bytes.extend(12u32.to_le_bytes());
        for triangle in triangles() {
            bytes.extend([0; 12]);
            for corner in triangle.map(|i| CORNERS[i as usize]) {
                bytes.extend(corner.map(f32::to_le_bytes).as_flattened());
            }
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn cube_ply_ascii() -> Vec<u8> {
        let mut text = String::from(
            "ply\nformat ascii 1.0\ncomment a cube\nelement vertex 8\nproperty float x\nproperty float y\n\
             property float z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n",
        );
        for [x, y, z] in CORNERS {
            text += &format!("{x} {y} {z}\n");
        }
        for [a, b, c, d] in FACES {
            text += &format!("4 {a} {b} {c} {d}\n");
        }
        text.into_bytes()
    }

    fn cube_ply_binary(big: bool) -> Vec<u8> {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 8\nproperty double z\nproperty uchar red\n\
             property float y\nproperty short x2\nproperty float x\nelement face 6\n\
             property list ushort uint vertex_index\nproperty list uchar float texcoord\nend_header\n"
        )
        .into_bytes();
        let mut put = |value: &[u8]| {
            if big {
                bytes.extend(value.iter().rev());
            } else {
                bytes.extend(value);
            }
        };
        for [x, y, z] in CORNERS {
            put(&f64::from(z).to_le_bytes());
            put(&[200]);
            put(&y.to_le_bytes());
            put(&(-3i16).to_le_bytes());
            put(&x.to_le_bytes());
        }
        for face in FACES {
            put(&4u16.to_le_bytes());
            face.iter().for_each(|i| put(&i.to_le_bytes()));
            put(&[2]);
            put(&0.5f32.to_le_bytes());
            put(&0.5f32.to_le_bytes());
        }
        bytes
    }

    fn cubes() -> [(Format, Vec<u8>); 6] {
        [
            (Format::Obj, cube_obj()),
            (Format::Stl, cube_stl_ascii()),
            (Format::Stl, cube_stl_binary()),
            (Format::Ply, cube_ply_ascii()),
            (Format::Ply, cube_ply_binary(false)),
            (Format::Ply, cube_ply_binary(true)),
        ]
    }

    #[test]
    fn one_cube_is_the_same_mesh_in_every_format() {
        let (expected, _) = parse(&cube_obj(), Format::Obj, 2.0).unwrap();
        assert_eq!(expected.centre_mm, [7.0, 8.0, -4.0]);
        assert_eq!((expected.vertices.len(), expected.triangles.len()), (8, 12));
        assert!(expected.vertices.as_flattened().iter().all(|x| x.abs() == 4.0));
        for (i, (format, bytes)) in cubes().into_iter().enumerate() {
            let (mesh, cleaned) = parse(&bytes, format, 2.0).unwrap();
            assert_eq!(mesh, expected, "{i}");
            assert_eq!(cleaned, Cleaned::default());
        }
    }

    #[test]
    fn a_file_is_read_by_its_extension_in_any_case_and_hashed() {
        let folder = tempfile::tempdir().unwrap();
        for (i, (format, bytes)) in cubes().into_iter().enumerate() {
            let path = folder.path().join(format!("{i}.{format:?}"));
            fs::write(&path, bytes).unwrap();
            assert_eq!(load(&path, 1.0).unwrap().mesh.triangles.len(), 12);
        }
        let path = folder.path().join("abc.Obj");
        fs::write(&path, "abc").unwrap();
        assert_eq!(load(&path, 1.0).unwrap_err().to_string(), format!("{}: no vertex", path.display()));
        fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert_eq!(
            load(&path, 1.0).unwrap().sha256,
            "697b00ab13410c52a542d2e9c63711fcc04e9cbf6c0d3439a9b43cc812e6e713"
        );
    }

    #[test]
    fn errors_name_the_file_and_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        fs::write(&path, "v 0 0 0\nv 1 0 0\nf 1 2 9\n").unwrap();
        assert_eq!(
            load(&path, 1.0).unwrap_err().to_string(),
            format!("{}:3: face refers to vertex 9, but the file has 2 so far", path.display())
        );
        let missing = load(&folder.path().join("no.stl"), 1.0).unwrap_err();
        assert!(matches!(missing.problem, MeshFileProblem::Unreadable(_)));
        assert!(missing.to_string().contains("no.stl: cannot be read: "), "{missing}");
        for name in ["a.step", "obj", ".obj"] {
            assert_eq!(
                load(Path::new(name), 1.0).unwrap_err().to_string(),
                format!("{name}: is not named like a mesh: use .obj, .stl or .ply")
            );
        }
    }

    #[test]
    fn a_unit_that_is_not_finite_leaves_no_finite_vertex() {
        let error = parse(&cube_obj(), Format::Obj, f64::NAN).unwrap_err();
        assert_eq!(error.to_string(), "no vertex with finite coordinates");
    }

    #[test]
    fn words_end_at_blanks_comments_and_continued_lines() {
        let mut words = Words::new(b"\xef\xbb\xbf a\tbc#d\\\n\\e\\\r\n f\\ \r\rg");
        assert_eq!(words.word(), Some(&b"a"[..]));
        assert_eq!(words.word(), Some(&b"bc"[..]));
        assert_eq!(words.word(), None);
        assert!(words.next_line());
        assert_eq!((words.word(), words.line), (Some(&b"\\e"[..]), 2));
        assert_eq!((words.word(), words.line), (Some(&b"f\\"[..]), 3));
        assert_eq!(words.word(), None);
        assert_eq!((words.word_anywhere(), words.line), (Some(&b"g"[..]), 5));
        assert_eq!(words.word_anywhere(), None);
        assert!(!words.next_line());
    }

    #[test]
    fn numbers_may_be_scientific_or_not_finite() {
        for (word, expected) in [("-1.5E+3", -1500.0), (".5", 0.5), ("2.", 2.0), ("+inf", f64::INFINITY)] {
            assert_eq!(number(word.as_bytes()).unwrap(), expected);
        }
        for word in ["nan", "NaN", "-nan(ind)"] {
            assert!(number(word.as_bytes()).unwrap().is_nan());
        }
        assert_eq!(number(b"1,5\xff\n").unwrap_err().to_string(), "`1,5\u{fffd}\\n` is not a number");
    }

    fn parse_all(bytes: &[u8]) {
        for format in [Format::Obj, Format::Stl, Format::Ply] {
            if let Err(error) = parse(bytes, format, 1.0) {
                assert!(!error.to_string().contains('\n'), "{error}");
            }
        }
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            parse_all(&bytes);
            let mut binary = bytes.clone();
            binary.splice(0..0, *b"solid ");
            parse_all(&binary);
            let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty char x\n\
                property char y\nproperty half z\nelement face 9\nproperty list char char vertex_index\n\
                end_header\n".to_vec();
            ply.extend(&bytes);
            parse_all(&ply);
        }

        #[test]
        fn random_statements_never_panic(
            words in prop::collection::vec(
                prop::sample::select(vec![
                    "v", "f", "1", "-1", "2", "3/4", "0", "nan", "1e39", "9999999999", "\n", "\n", "\\\n", "#",
                    "\r", "solid", "facet", "outer loop", "vertex", "vertex 0 1 2", "endfacet", "ply\n",
                    "format ascii 1.0\n", "element vertex 3\n", "element face", "property list uchar int",
                    "property float", "x", "y", "z", "vertex_index", "end_header\n",
                ]),
                0..200,
            ),
        ) {
            parse_all(words.join(" ").as_bytes());
        }

        #[test]
        fn damaged_files_never_panic(
            which in 0usize..6,
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
            len in any::<prop::sample::Index>(),
            is_cut in any::<bool>(),
        ) {
            let mut bytes = cubes()[which].1.clone();
            for (at, value) in edits {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            if is_cut {
                bytes.truncate(len.index(bytes.len()));
            }
            parse_all(&bytes);
        }
    }
}
