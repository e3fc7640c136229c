//! Chooses one mesh of each object where a folder holds several: other formats, other resolutions, collision shapes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::Inspection;
use gelsim_files::mesh::Format;

/// Words in the names of shapes that were made for collision checks.
const COLLISION_WORDS: [&str; 3] = ["collision", "vhacd", "coacd"];

/// Largest relative difference of the sizes of two meshes of one object: reducing a mesh changes it a little.
const ALIKE: f64 = 0.02;

/// A mesh that is one of a set.
#[derive(Clone, Debug)]
pub struct MeshOfSet {
    /// Its file.
    pub path: PathBuf,
    /// Path from the set's folder, with `/` between names.
    pub relative: String,
    /// Format by its ending.
    pub format: Format,
    /// Number of folders in its path that tell which object it is, if what follows recurs in those of other objects.
    told_by: Option<usize>,
}

impl MeshOfSet {
    /// Returns the mesh at `path`, which is in `folder`, if it is named like one.
    pub fn new(folder: &Path, path: PathBuf) -> Option<Self> {
        let format = Format::from_path(&path)?;
        let relative = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().replace('\\', "/");
        Some(Self { path, relative, format, told_by: None })
    }

    /// Splits the path behind this many folders.
    fn split(&self, folders: usize) -> Option<(&str, &str)> {
        self.relative.match_indices('/').nth(folders - 1).map(|(at, _)| self.relative.split_at(at + 1))
    }

    /// The folder that tells which object it is, and the path in it, if that recurs in those of other objects.
    pub fn object_folder(&self) -> Option<(&str, &str)> {
        let (object, rest) = self.split(self.told_by?)?;
        Some((object.trim_end_matches('/').rsplit('/').next().unwrap_or_default(), rest))
    }

    /// The path without the file's name.
    fn folder(&self) -> &str {
        self.relative.rsplit_once('/').map_or("", |(folder, _)| folder)
    }

    /// The file's name without its ending.
    pub fn stem(&self) -> &str {
        let name = self.relative.rsplit('/').next().unwrap_or_default();
        name.rsplit_once('.').map_or(name, |(stem, _)| stem)
    }
}

/// Chooses by the names of files. Robots and collision shapes are taken only if there is nothing else. Where the same
/// paths recur in many folders, as `google_16k/textured.obj` and `tsdf/nontextured.ply` do, each such folder is an
/// object, of which one file is taken.
pub fn choose_by_name(mut left: Vec<MeshOfSet>) -> Vec<MeshOfSet> {
    let is_collision = |mesh: &MeshOfSet| {
        let name = mesh.relative.to_ascii_lowercase();
        COLLISION_WORDS.iter().any(|word| name.contains(word))
    };
    for is_second_choice in [&is_collision as &dyn Fn(&MeshOfSet) -> bool, &|mesh| mesh.format == Format::Urdf] {
        if !left.iter().all(is_second_choice) {
            left.retain(|mesh| !is_second_choice(mesh));
        }
    }
    let deepest = left.iter().map(|mesh| mesh.relative.matches('/').count()).max().unwrap_or(0);
    let mut chosen = Vec::new();
    for folders in 1..=deepest {
        let found = choose_in_folders(&left, folders);
        let mut rest = Vec::new();
        for (at, mesh) in left.into_iter().enumerate() {
            match found.get(&at) {
                Some(true) => chosen.push(MeshOfSet { told_by: Some(folders), ..mesh }),
                Some(false) => {}
                None => rest.push(mesh),
            }
        }
        left = rest;
    }
    chosen.append(&mut left);
    chosen.sort_by(|a, b| a.path.cmp(&b.path));
    chosen
}

/// Returns the meshes whose paths behind this many folders recur in other folders, by their places: true for the one of
/// each folder that is taken.
fn choose_in_folders(meshes: &[MeshOfSet], folders: usize) -> BTreeMap<usize, bool> {
    let mut times: BTreeMap<&str, usize> = BTreeMap::new();
    for (_, rest) in meshes.iter().filter_map(|mesh| mesh.split(folders)) {
        *times.entry(rest).or_default() += 1;
    }
    times.retain(|_, times| *times > 1);
    // Several that recur in one place are objects with the same names in each folder, such as `obj_000001.ply`.
    let place = |rest: &str| -> (String, String) {
        let (name, ending) = rest.rsplit_once('.').unwrap_or((rest, ""));
        (name.rsplit_once('/').map_or("", |(folder, _)| folder).to_owned(), ending.to_owned())
    };
    let mut names: BTreeMap<(String, String), usize> = BTreeMap::new();
    times.keys().for_each(|rest| *names.entry(place(rest)).or_default() += 1);
    let mut best: BTreeMap<&str, (Format, &str, usize)> = BTreeMap::new();
    for (at, mesh) in meshes.iter().enumerate() {
        let Some((object, rest)) = mesh.split(folders) else { continue };
        if names.get(&place(rest)) == Some(&1) && times.contains_key(rest) {
            let this = (mesh.format, rest, at);
            best.entry(object).and_modify(|best| *best = this.min(*best)).or_insert(this);
        }
    }
    let settled = meshes.iter().enumerate().filter_map(|(at, mesh)| {
        let (object, rest) = mesh.split(folders)?;
        let (.., best) = best.get(object).filter(|_| times.contains_key(rest))?;
        Some((at, at == *best))
    });
    settled.collect()
}

/// Leaves out what is there twice: a file beside one of the same name in another format, and a folder all of whose
/// meshes are in other folders, too, with the same names and sizes.
pub fn drop_copies(meshes: Vec<(MeshOfSet, Inspection)>) -> Vec<(MeshOfSet, Inspection)> {
    let mut folders: BTreeMap<(bool, Format, String), Vec<(MeshOfSet, Inspection)>> = BTreeMap::new();
    for (mesh, inspection) in meshes {
        let key = (mesh.told_by.is_none(), mesh.format, mesh.folder().to_owned());
        folders.entry(key).or_default().push((mesh, inspection));
    }
    let mut beside: BTreeSet<(String, String)> = BTreeSet::new();
    let mut sizes: BTreeMap<String, Vec<[f64; 4]>> = BTreeMap::new();
    let mut kept = Vec::new();
    for ((may_be_copy, ..), mut files) in folders {
        files.retain(|(mesh, _)| !beside.contains(&(mesh.folder().to_owned(), mesh.stem().to_owned())));
        let is_copy = |(mesh, inspection): &(MeshOfSet, Inspection)| {
            let twins = sizes.get(mesh.stem()).map_or(&[][..], Vec::as_slice);
            relative_size(inspection).is_some_and(|size| twins.iter().any(|twin| are_alike(size, *twin)))
        };
        if may_be_copy && files.iter().all(is_copy) {
            continue;
        }
        for (mesh, inspection) in &files {
            if let Some(size) = relative_size(inspection) {
                beside.insert((mesh.folder().to_owned(), mesh.stem().to_owned()));
                if may_be_copy {
                    sizes.entry(mesh.stem().to_owned()).or_default().push(size);
                }
            }
        }
        kept.append(&mut files);
    }
    kept.sort_by(|(a, _), (b, _)| a.path.cmp(&b.path));
    kept
}

/// Extents, however the axes are named, and the distance of the farthest vertex from the middle, in coordinates of the
/// file.
fn relative_size(inspection: &Inspection) -> Option<[f64; 4]> {
    let facts = inspection.mesh.as_ref()?;
    let [x, y, z] = facts.size_mm;
    let mut size = [x, y, z, facts.size.radius_mm].map(|mm| mm / facts.mm_per_unit);
    size[..3].sort_by(f64::total_cmp);
    Some(size)
}

fn are_alike(a: [f64; 4], b: [f64; 4]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= ALIKE * a.max(b))
}
