//! The geometry of a job's meshes. Of few files all is held in memory. Of many files a mesh is read when a sample needs
//! it, and kept as long as there is room, so that a set may be larger than the memory.

use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use crate::config::object::{Object, Parts};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::{CleanupReport, Mesh};
use gelsim_files::mesh::{self, LoadedMesh, MeshFileError};

/// Memory for meshes that can be read again, bytes.
const ROOM_BYTES: usize = 256 << 20;

/// The geometry of an object.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// It is in memory.
    Held(Arc<Clusters>),
    /// It is read when it is needed.
    InFile {
        /// The file.
        file: Arc<MeshFile>,
        /// Number of the part in the file.
        part: usize,
    },
}

impl Geometry {
    /// The geometry of a part of a file.
    pub fn in_file(file: &Arc<MeshFile>, part: usize) -> Self {
        Self::InFile { file: Arc::clone(file), part }
    }

    /// Returns the object. If its file can no longer be read, or has changed, it is a triangle that stands for it, and
    /// [`Self::failure`] says why.
    pub fn clusters(&self) -> Arc<Clusters> {
        match self {
            Self::Held(clusters) => Arc::clone(clusters),
            Self::InFile { file, part } => {
                file.clusters().and_then(|parts| parts.get(*part).cloned()).unwrap_or_else(make_stand_in)
            }
        }
    }

    /// Returns a file of the job that could not be read again, and why, if that happened.
    pub fn failure(&self) -> Option<&(PathBuf, String)> {
        match self {
            Self::Held(_) => None,
            Self::InFile { file, .. } => file.store.failure.get(),
        }
    }
}

/// Makes an object that can be pressed, whatever the job. What comes of it is not used.
fn make_stand_in() -> Arc<Clusters> {
    let triangle = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    Arc::new(triangle.map_or_else(|_| Clusters::empty(), |(mesh, _)| Clusters::new(&mesh)))
}

/// A mesh file that can be read again.
pub struct MeshFile {
    path: PathBuf,
    /// How it is read.
    object: Arc<Object>,
    /// SHA-256 of the content that the job was checked with.
    sha256: String,
    /// Its number in the store.
    number: usize,
    store: Arc<MeshStore>,
}

impl MeshFile {
    /// The file at `path`, read as `object` says, whose meshes are kept in `store`.
    pub fn new(path: &Path, object: &Arc<Object>, sha256: &str, store: &Arc<MeshStore>) -> Self {
        Self {
            path: path.to_owned(),
            object: Arc::clone(object),
            sha256: sha256.to_owned(),
            number: store.count.fetch_add(1, Ordering::Relaxed),
            store: Arc::clone(store),
        }
    }

    /// Returns its parts, or `None` if it can no longer be read.
    fn clusters(&self) -> Option<Arc<Vec<Arc<Clusters>>>> {
        if let Some(kept) = self.store.find(self) {
            return Some(kept);
        }
        match self.read() {
            Ok(parts) => Some(self.store.keep(self, parts)),
            Err(reason) => {
                // Only the first failure is told.
                let _ = self.store.failure.set((self.path.clone(), reason));
                None
            }
        }
    }

    fn read(&self) -> Result<Vec<Arc<Clusters>>, String> {
        let built = |sha256: &str, mesh| match sha256 == self.sha256 {
            true => Ok(Arc::new(Clusters::new(mesh))),
            false => Err(String::from("it has changed since the job was read")),
        };
        // The message says what is wrong, and its reader adds the path.
        let without_path = |error: MeshFileError| MeshFileError { path: None, ..error }.to_string();
        match read_file(&self.path, &self.object).map_err(without_path)?.0 {
            FileContent::Plate { mesh, sha256, .. } => Ok(vec![built(&sha256, &mesh)?]),
            FileContent::Parts(parts) => parts.iter().map(|(_, part)| built(&part.sha256, &part.mesh)).collect(),
        }
    }
}

impl fmt::Debug for MeshFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MeshFile").field("path", &self.path).finish_non_exhaustive()
    }
}

/// What a mesh file or height map holds.
pub enum FileContent {
    /// The closed plate that a height map becomes, mm.
    Plate {
        /// Geometry of the plate.
        mesh: Mesh,
        /// What cleaning removed.
        cleaned: CleanupReport,
        /// SHA-256 of the file, in lower-case hex.
        sha256: String,
    },
    /// The meshes, each with the name of its part; the name of a complete file is empty.
    Parts(Vec<(String, LoadedMesh)>),
}

/// Reads a file as `object` says. Also returns whether the content also depends on other files.
pub fn read_file(path: &Path, object: &Object) -> Result<(FileContent, bool), MeshFileError> {
    if let Some(size) = object.plate_size().filter(|_| mesh::is_height_map(path)) {
        let (mesh, cleaned, sha256) = mesh::load_plate(path, size)?;
        return Ok((FileContent::Plate { mesh, cleaned, sha256 }, false));
    }
    let parts = match object.parts {
        Parts::Separate => mesh::load_parts(path, object.read_options())?,
        Parts::Together => vec![(String::new(), mesh::load(path, object.read_options())?)],
    };
    let names_other_files = parts.iter().any(|(_, loaded)| loaded.names_other_files);
    Ok((FileContent::Parts(parts), names_other_files))
}

/// The meshes that were read last.
#[derive(Default)]
pub struct MeshStore {
    kept: Mutex<KeptMeshes>,
    failure: OnceLock<(PathBuf, String)>,
    count: AtomicUsize,
}

/// Meshes by the number of their file.
#[derive(Default)]
struct KeptMeshes {
    files: HashMap<usize, Arc<Vec<Arc<Clusters>>>>,
    /// The numbers, in the order in which they were read.
    order: VecDeque<usize>,
    bytes: usize,
}

impl MeshStore {
    fn find(&self, file: &MeshFile) -> Option<Arc<Vec<Arc<Clusters>>>> {
        // Nobody waits for this lock, since one that another thread held when a process was forked stays locked in the
        // child, which then reads all files itself.
        self.kept.try_lock().ok()?.files.get(&file.number).cloned()
    }

    /// Keeps the parts of a file, in place of those that were read first if there is no more room.
    pub fn keep(&self, file: &MeshFile, parts: Vec<Arc<Clusters>>) -> Arc<Vec<Arc<Clusters>>> {
        let bytes = |parts: &[Arc<Clusters>]| parts.iter().map(|part| part.memory_bytes()).sum::<usize>();
        let parts = Arc::new(parts);
        let Ok(mut kept) = self.kept.try_lock() else { return parts };
        if kept.files.insert(file.number, Arc::clone(&parts)).is_none() {
            kept.order.push_back(file.number);
            kept.bytes += bytes(&parts);
        }
        while kept.bytes > ROOM_BYTES
            && kept.order.len() > 1
            && let Some(first) = kept.order.pop_front()
        {
            let dropped = kept.files.remove(&first).map_or(0, |parts| bytes(&parts));
            kept.bytes -= dropped;
        }
        parts
    }
}
