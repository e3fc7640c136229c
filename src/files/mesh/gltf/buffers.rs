//! Reads the numbers in a glTF file's buffers: in the file itself, in a data URI, or in a file beside it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::document::{Accessor, Document};
use super::{malformed, unsupported};
use crate::mesh::resources::Resources;
use crate::mesh::uri::decode_uri;
use crate::mesh::words::quote_file_name;
use crate::mesh::{MeshFileError, MeshFileProblem, MissingFile, MissingFiles, MissingReason, ResourceKind, quote_word};

/// The buffers of a file. Each is loaded when something in it is needed for the first time.
pub(super) struct Buffers<'a> {
    document: &'a Document,
    binary: Option<&'a [u8]>,
    resources: &'a mut Resources,
    loaded: Vec<Option<Cow<'a, [u8]>>>,
    /// Bytes of all buffers that were loaded so far.
    pub(super) bytes: usize,
}

/// The types of components: their number in glTF, and their bytes.
const COMPONENTS: [(u32, usize); 6] = [(5120, 1), (5121, 1), (5122, 2), (5123, 2), (5125, 4), (5126, 4)];

impl<'a> Buffers<'a> {
    pub(super) fn new(document: &'a Document, binary: Option<&'a [u8]>, others: &'a mut Resources) -> Self {
        Self { document, binary, resources: others, loaded: vec![None; document.buffers.len()], bytes: 0 }
    }

    /// Reads the points of an accessor.
    pub(super) fn read_points(&mut self, number: usize) -> Result<Vec<[f64; 3]>, MeshFileError> {
        let accessor = self.find_accessor(number, "VEC3")?;
        let kind = accessor.component_type;
        // 5125 is u32, which the format allows for indices only.
        if kind == 5125 {
            return malformed(format!("accessor {number} has points of component type 5125"));
        }
        // Whole numbers that stand for -1 to 1 or 0 to 1: a quantized mesh has them.
        let largest = match (accessor.normalized, kind) {
            (true, 5120) => 127.0,
            (true, 5121) => 255.0,
            (true, 5122) => 32767.0,
            (true, 5123) => 65535.0,
            _ => 1.0,
        };
        let component = |bytes: &[u8]| match (kind, bytes) {
            (5120, &[a]) => f64::from(a as i8),
            (5121, &[a]) => f64::from(a),
            (5122, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
            (5123, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
            (_, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
            _ => f64::NAN,
        };
        let is_normalized = largest > 1.0;
        let read = |bytes: &[u8]| {
            let size = bytes.len() / 3;
            // The lowest signed number lies just below -1 and stands for -1.
            let point = [0, 1, 2].map(|k| component(&bytes[k * size..(k + 1) * size]) / largest);
            if is_normalized { point.map(|x| x.max(-1.0)) } else { point }
        };
        self.read_elements(number, 3, read)
    }

    /// Reads the whole numbers of an accessor.
    pub(super) fn read_indices(&mut self, number: usize) -> Result<Vec<u32>, MeshFileError> {
        let kind = self.find_accessor(number, "SCALAR")?.component_type;
        if !matches!(kind, 5121 | 5123 | 5125) {
            return malformed(format!("accessor {number} has indices of component type {kind}"));
        }
        // Little endian: the last byte is the highest.
        self.read_elements(number, 1, |bytes| bytes.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte)))
    }

    /// Returns the number of elements that an accessor claims to have.
    pub(super) fn element_count(&self, number: usize) -> Option<usize> {
        Some(self.document.accessors.get(number)?.count)
    }

    fn find_accessor(&self, number: usize, kind: &str) -> Result<&'a Accessor, MeshFileError> {
        let Some(accessor) = self.document.accessors.get(number) else {
            return malformed(format!("refers to accessor {number}, but there are {}", self.document.accessors.len()));
        };
        if accessor.kind != kind {
            return malformed(format!("accessor {number} is {}, not {kind}", quote_word(accessor.kind.as_bytes())));
        }
        Ok(accessor)
    }

    /// Reads the elements of an accessor, each of `components` components.
    fn read_elements<T>(
        &mut self,
        number: usize,
        components: usize,
        element: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, MeshFileError> {
        let document = self.document;
        let accessor = &document.accessors[number];
        if accessor.sparse.is_some() {
            return unsupported(format!("accessor {number} is sparse, which is not read"));
        }
        let Some((_, size)) = COMPONENTS.iter().find(|(kind, _)| *kind == accessor.component_type) else {
            return malformed(format!("accessor {number} has component type {}", accessor.component_type));
        };
        let size = size * components;
        let Some(view) = accessor.buffer_view.and_then(|view| document.buffer_views.get(view)) else {
            return malformed(format!("accessor {number} has no buffer view"));
        };
        let stride = view.byte_stride.filter(|stride| *stride > 0).unwrap_or(size);
        if stride < size {
            return malformed(format!("the elements of accessor {number} lie over each other"));
        }
        let bytes = self.load_buffer(view.buffer)?;
        // Saturating sums, since a damaged file may have offsets near the end of the number range.
        let end = view.byte_offset.saturating_add(view.byte_length).min(bytes.len());
        let bytes = bytes.get(view.byte_offset.saturating_add(accessor.byte_offset)..end).unwrap_or_default();
        let room = bytes.len().checked_sub(size).map_or(0, |rest| 1 + rest / stride);
        if accessor.count > room {
            let what = format!("elements in accessor {number}");
            return Err(
                MeshFileProblem::CountMismatch { claimed: accessor.count as u64, what, room: room as u64 }.into()
            );
        }
        Ok((0..accessor.count).map(|i| element(&bytes[i * stride..i * stride + size])).collect())
    }

    fn load_buffer(&mut self, number: usize) -> Result<&[u8], MeshFileError> {
        let Some(buffer) = self.document.buffers.get(number) else {
            return malformed(format!("refers to buffer {number}, but there are {}", self.document.buffers.len()));
        };
        if self.loaded[number].is_none() {
            self.check_files()?;
            let bytes: Cow<'a, [u8]> = match (&buffer.uri, self.binary) {
                (None, Some(binary)) if number == 0 => Cow::Borrowed(binary),
                (None, _) => return malformed(format!("buffer {number} is not in the file and has no name")),
                (Some(uri), _) => Cow::Owned(fetch_uri(uri, self.resources)?),
            };
            if bytes.len() < buffer.byte_length {
                let (claimed, room) = (buffer.byte_length as u64, bytes.len() as u64);
                return Err(MeshFileProblem::CountMismatch {
                    claimed,
                    what: format!("bytes in buffer {number}"),
                    room,
                }
                .into());
            }
            self.bytes += bytes.len();
            self.loaded[number] = Some(bytes);
        }
        Ok(self.loaded[number].as_deref().unwrap_or_default())
    }

    /// Refuses a file that names buffers which are not there. All of them are named at once.
    fn check_files(&self) -> Result<(), MeshFileError> {
        let uris = self.document.buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
        let mut files: Vec<MissingFile> = Vec::new();
        for uri in uris.filter(|uri| !uri.starts_with("data:")) {
            let reason = match self.resources.folder().map(|folder| resolve_uri_path(folder, uri)) {
                _ if uri.contains("://") && !uri.starts_with("file://") => MissingReason::WebAddress,
                Some(path) if !path.exists() => MissingReason::NotFound(None),
                _ => continue,
            };
            let name = decode_uri(uri);
            if !files.iter().any(|file| file.name == name) {
                files.push(MissingFile { name, line: None, reason });
            }
        }
        match files.is_empty() {
            true => Ok(()),
            false => Err(MeshFileProblem::Missing(MissingFiles { what: ResourceKind::Buffer, files }).into()),
        }
    }
}

/// Returns the bytes that a URI stands for: those in it, or those of the file that it names.
fn fetch_uri(uri: &str, others: &mut Resources) -> Result<Vec<u8>, MeshFileError> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((_, base64)) = data.split_once(";base64,") else {
            return unsupported(String::from("has a data URI that is not base64"));
        };
        return STANDARD
            .decode(base64)
            .map_err(|error| MeshFileProblem::Malformed(format!("a buffer is not base64: {error}")).into());
    }
    match others.folder().map(|folder| resolve_uri_path(folder, uri)) {
        Some(path) => others.read_file(uri, &path).map_err(|error| {
            let error = Box::new(error);
            MeshFileProblem::InNamedFile { name: quote_file_name(uri), error }.into()
        }),
        None => unsupported(format!("names another file, {}", quote_file_name(uri))),
    }
}

/// Returns the path that a URI stands for, relative to a folder.
fn resolve_uri_path(folder: &Path, uri: &str) -> PathBuf {
    let name = decode_uri(uri.strip_prefix("file://").unwrap_or(uri));
    let path = folder.join(&name);
    // Some programs on Windows write backslashes.
    if path.exists() { path } else { folder.join(name.replace('\\', "/")) }
}
