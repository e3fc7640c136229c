//! Finds the meshes that a robot names: relative to its folder and the folders above it, as PyBullet does, and in
//! packages, as ROS does.
//!
//! A package is a folder of that name, or one whose `package.xml` has that name. It is looked for in the folders that
//! the user gives, above the robot and around the folders above it, and where the environment of ROS and Gazebo says.
//! the robot and around the folders above it, and where the environment of ROS and Gazebo says.

use std::collections::{HashMap, VecDeque};
use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Component, Path, PathBuf};

use roxmltree::{Document, Node};

use super::missing_files::MissingReason;
use super::uri::decode_uri;
use super::{Format, is_height_map};
use crate::input;

/// How a robot refers to a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum FileReference {
    /// A path, absolute or relative to the robot's folder.
    Path(String),
    /// A path in a package.
    InPackage {
        /// The package's name.
        package: String,
        /// The path from the package's folder.
        path: String,
    },
    /// An address on the web.
    WebAddress,
    /// A macro, which another program replaces before the file is read.
    Macro,
}

impl FileReference {
    /// Parses a reference as the robot writes it.
    pub(super) fn parse(written: &str) -> Self {
        let written = written.trim();
        // `file:///a`, `file:/a` and, against the rules of URIs, `file://a`.
        let (is_uri, rest) = match written.strip_prefix("file:") {
            Some(rest) => (true, rest.strip_prefix("//").unwrap_or(rest)),
            None => (false, written),
        };
        for (opening, end) in [("package://", '/'), ("model://", '/'), ("$(find ", ')'), ("$(find-pkg-share ", ')')] {
            if let Some(rest) = rest.strip_prefix(opening) {
                let rest = rest.replace('\\', "/");
                let (package, path) = rest.split_once(end).unwrap_or((rest.as_str(), ""));
                let (package, path) = (package.trim().to_owned(), path.trim_start_matches('/').to_owned());
                return Self::InPackage { package, path };
            }
        }
        if rest.contains("$(") || rest.contains("${") {
            return Self::Macro;
        }
        if rest.contains("://") {
            return Self::WebAddress;
        }
        Self::Path(if is_uri { decode_uri(rest) } else { rest.to_owned() })
    }
}

/// Depth to which packages are searched for below a folder of the user or of ROS.
const SEARCH_DEPTH: usize = 4;
/// Depth to which packages are searched for below a folder above the robot.
const ANCESTOR_SEARCH_DEPTH: usize = 2;
/// Most folders above the robot below which packages are searched for.
const MAX_ANCESTORS: usize = 5;
/// Most folders that are listed below one.
const MAX_FOLDERS: usize = 2_000;
/// Most bytes of a `package.xml`; a longer one is ignored.
const MAX_XML: u64 = 1 << 20;

/// Finds files, and remembers where packages are.
pub(super) struct PackageFinder {
    given_folders: Vec<PathBuf>,
    /// For each folder that was searched: the packages below it by the name in their `package.xml`.
    packages_by_folder: HashMap<PathBuf, HashMap<String, Vec<PathBuf>>>,
    /// Packages that were found only through the environment.
    environment_folders: Vec<PathBuf>,
}

impl PackageFinder {
    /// Makes a finder that searches these folders first.
    pub(super) fn new(given: &[String]) -> Self {
        let given = given.iter().map(PathBuf::from).collect();
        Self { given_folders: given, packages_by_folder: HashMap::new(), environment_folders: Vec::new() }
    }

    /// Returns the folders in which all that was found is found again without the environment.
    pub(super) fn required_folders(&self) -> Vec<String> {
        self.given_folders
            .iter()
            .chain(&self.environment_folders)
            .map(|path| path.to_string_lossy().into_owned())
            .collect()
    }

    /// Finds the file to which a robot in `folder` refers.
    pub(super) fn find_file(&mut self, folder: &Path, named: &FileReference) -> Result<PathBuf, MissingReason> {
        match named {
            FileReference::WebAddress => Err(MissingReason::WebAddress),
            FileReference::Macro => Err(MissingReason::NotFound(None)),
            FileReference::Path(path) => {
                let forms = [path.clone(), path.replace('\\', "/")];
                let mut folders = vec![folder.to_owned()];
                folders.extend(list_ancestors(folder).into_iter().skip(1));
                folders.extend(self.given_folders.iter().cloned());
                let mut places = folders.iter().flat_map(|folder| forms.iter().map(|path| folder.join(path)));
                match places.find(|place| place.is_file()) {
                    Some(place) => Ok(place),
                    None => Err(MissingReason::NotFound(suggest_reference(&folder.join(&forms[1]), &forms[1]))),
                }
            }
            FileReference::InPackage { package, path } => self.find_in_package(folder, package, path),
        }
    }

    fn find_in_package(&mut self, folder: &Path, package: &str, path: &str) -> Result<PathBuf, MissingReason> {
        let mut first = None;
        let mut look = |folders: Vec<PathBuf>| {
            let found = folders.iter().find(|folder| folder.join(path).is_file()).cloned();
            first = first.take().or_else(|| folders.into_iter().next());
            found
        };
        // The user's folders come first, then folders above the robot by name and by manifest. The environment comes
        // last, so that it matters only if nothing else fits.
        for given in self.given_folders.clone() {
            if let Some(found) = look(self.find_package(&given, package, SEARCH_DEPTH)) {
                return Ok(found.join(path));
            }
        }
        let above = list_ancestors(folder);
        for folder in &above {
            if let Some(found) = look(self.find_by_folder_name(folder, package)) {
                return Ok(found.join(path));
            }
        }
        for folder in above.iter().take(MAX_ANCESTORS).filter(|folder| folder.parent().is_some()) {
            if let Some(found) = look(self.find_by_manifest(folder, package, ANCESTOR_SEARCH_DEPTH)) {
                return Ok(found.join(path));
            }
        }
        for (folder, deep) in read_search_paths() {
            if let Some(found) = look(self.find_package(&folder, package, deep)) {
                let found = std::path::absolute(&found).unwrap_or(found);
                if !self.environment_folders.contains(&found) {
                    self.environment_folders.push(found.clone());
                }
                return Ok(found.join(path));
            }
        }
        Err(match first {
            Some(found) => {
                MissingReason::NotFound(suggest_reference(&found.join(path), &format!("package://{package}/{path}")))
            }
            None => MissingReason::NoPackage(package.to_owned()),
        })
    }

    /// Returns the packages of this name: the folder itself, and those below it.
    fn find_package(&mut self, folder: &Path, package: &str, deep: usize) -> Vec<PathBuf> {
        let mut found = self.find_by_folder_name(folder, package);
        if deep > 0 {
            found.extend(self.find_by_manifest(folder, package, deep));
        }
        found
    }

    /// Returns the packages of this name by the names of folders: the folder itself, and the one in it.
    fn find_by_folder_name(&self, folder: &Path, package: &str) -> Vec<PathBuf> {
        let own = (folder.file_name() == Some(OsStr::new(package))).then(|| folder.to_owned());
        // A name with slashes or dots could lead out of the folder.
        let is_name = Path::new(package).components().all(|part| matches!(part, Component::Normal(_)));
        let inside = Some(folder.join(package)).filter(|inside| is_name && !package.is_empty() && inside.is_dir());
        own.into_iter().chain(inside).collect()
    }

    /// Returns the packages below a folder that have this name in their `package.xml`.
    fn find_by_manifest(&mut self, folder: &Path, package: &str, deep: usize) -> Vec<PathBuf> {
        let listed =
            self.packages_by_folder.entry(folder.to_owned()).or_insert_with(|| list_packages_below(folder, deep));
        listed.get(package).cloned().unwrap_or_default()
    }
}

/// Returns the folder and those above it. If it is reached by a link, the folders where it really lies follow.
fn list_ancestors(folder: &Path) -> Vec<PathBuf> {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let mut plain = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    let mut folders: Vec<PathBuf> = plain.ancestors().map(Path::to_owned).collect();
    let real = absolute.canonicalize().unwrap_or_default();
    let more: Vec<PathBuf> =
        real.ancestors().filter(|path| !folders.iter().any(|known| known == path)).map(Path::to_owned).collect();
    folders.extend(more);
    folders
}

/// Lists the packages below a folder, or that it is, by name. Packages in packages are not looked for.
fn list_packages_below(folder: &Path, deep: usize) -> HashMap<String, Vec<PathBuf>> {
    let mut found: HashMap<String, Vec<PathBuf>> = HashMap::new();
    let mut waiting = VecDeque::from([(folder.to_owned(), 0)]);
    let mut listed = 0;
    while let Some((folder, depth)) = waiting.pop_front() {
        if let Some(name) = read_package_name(&folder.join("package.xml")) {
            found.entry(name).or_default().push(folder.clone());
            // The first folder may be the robot's own package: others may lie below it, too.
            if depth > 0 {
                continue;
            }
        }
        listed += 1;
        if depth == deep || listed > MAX_FOLDERS {
            continue;
        }
        let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
        let mut folders: Vec<PathBuf> = entries
            .filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b"."))
            .map(|entry| entry.path())
            .filter(|path| path.is_dir())
            .take(MAX_FOLDERS)
            .collect();
        folders.sort();
        waiting.extend(folders.into_iter().map(|path| (path, depth + 1)));
    }
    found
}

/// Reads the name in a `package.xml`. Returns `None` if there is no such file or no name in it.
fn read_package_name(path: &Path) -> Option<String> {
    let bytes = input::read_if_exists(path, MAX_XML).ok()??;
    let document = Document::parse(str::from_utf8(&bytes).ok()?).ok()?;
    let root = Some(document.root_element()).filter(|root| root.has_tag_name("package"))?;
    let name = root.children().find(|node: &Node| node.has_tag_name("name"))?.text()?.trim();
    (!name.is_empty()).then(|| name.to_owned())
}

/// Returns the folders in which ROS 1, ROS 2 and Gazebo look for packages and models, each with the depth of the
/// search.
fn read_search_paths() -> Vec<(PathBuf, usize)> {
    let of = |key: &str| -> Vec<PathBuf> {
        let value = env::var_os(key).unwrap_or_default();
        env::split_paths(&value).filter(|path| !path.as_os_str().is_empty()).collect()
    };
    let mut folders: Vec<(PathBuf, usize)> =
        of("ROS_PACKAGE_PATH").into_iter().map(|path| (path, SEARCH_DEPTH)).collect();
    folders.extend(of("AMENT_PREFIX_PATH").into_iter().map(|path| (path.join("share"), 0)));
    for key in ["GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH"] {
        folders.extend(of(key).into_iter().map(|path| (path, 0)));
    }
    folders
}

/// Suggests a file beside a missing one that may have been meant, written as the robot would write it.
fn suggest_reference(missing: &Path, written: &str) -> Option<String> {
    let name = input::suggest_file_name(missing, |path| Format::from_path(path).is_some() || is_height_map(path))?;
    let before = written.rfind('/').map_or("", |at| &written[..=at]);
    Some(format!("{before}{name}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with these files, empty or with a package's name in them.
    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let (path, name) = file.split_once('=').unwrap_or((file, ""));
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, format!("<?xml version=\"1.0\"?>\n<package format=\"2\"><name> {name} </name></package>"))
                .unwrap();
        }
        folder
    }

    fn found(folder: &Path, robot: &str, given: &[&str], written: &str) -> Result<String, MissingReason> {
        let given: Vec<String> = given.iter().map(|given| folder.join(given).to_string_lossy().into_owned()).collect();
        let found = PackageFinder::new(&given).find_file(&folder.join(robot), &FileReference::parse(written))?;
        Ok(list_ancestors(&found)[0]
            .strip_prefix(list_ancestors(folder)[0].clone())
            .unwrap()
            .to_string_lossy()
            .into_owned())
    }

    #[test]
    fn what_is_written_is_taken_apart() {
        let path = |path: &str| FileReference::Path(path.into());
        let package =
            |package: &str, path: &str| FileReference::InPackage { package: package.into(), path: path.into() };
        for (written, expected) in [
            (" meshes/a.stl\n", path("meshes/a.stl")),
            ("..\\meshes\\a.stl", path("..\\meshes\\a.stl")),
            ("file:///tmp/a%20b.stl", path("/tmp/a b.stl")),
            ("file://a.stl", path("a.stl")),
            ("file:/a.stl", path("/a.stl")),
            ("package://arm/m/a.stl", package("arm", "m/a.stl")),
            ("package://arm\\m\\a.stl", package("arm", "m/a.stl")),
            ("model://arm/a.dae", package("arm", "a.dae")),
            ("$(find arm)/m/a.stl", package("arm", "m/a.stl")),
            ("file://$(find arm)/m/a.stl", package("arm", "m/a.stl")),
            ("$(find-pkg-share arm)/a.stl", package("arm", "a.stl")),
            ("package://arm", package("arm", "")),
            ("$(find arm", package("arm", "")),
            ("https://a/b.stl", FileReference::WebAddress),
            ("${dir}/a.stl", FileReference::Macro),
            ("$(arg dir)/a.stl", FileReference::Macro),
            ("", path("")),
        ] {
            assert_eq!(FileReference::parse(written), expected, "{written}");
        }
    }

    #[test]
    fn relative_paths_start_from_the_folder_and_from_those_above_it() {
        let folder = folder(&["a/meshes/x.stl", "a/b/meshes/y.stl", "a/b/c/r.urdf", "elsewhere/z.stl"]);
        let found = |written: &str| found(folder.path(), "a/b/c", &["elsewhere"], written);
        for (written, expected) in [
            ("meshes/x.stl", "a/meshes/x.stl"),
            ("meshes\\x.stl", "a/meshes/x.stl"),
            ("meshes/y.stl", "a/b/meshes/y.stl"),
            ("../meshes/y.stl", "a/b/meshes/y.stl"),
            ("z.stl", "elsewhere/z.stl"),
        ] {
            assert_eq!(found(written), Ok(expected.into()), "{written}");
        }
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(folder.path().join("a/b"), &link).unwrap();
        assert!(
            PackageFinder::new(&[]).find_file(&link, &FileReference::parse("meshes/x.stl")).is_ok(),
            "above where the link leads"
        );
        assert_eq!(found("../meshes/teapot.stl"), Err(MissingReason::NotFound(None)));
        assert_eq!(found("../meshes/y.obj"), Err(MissingReason::NotFound(Some("../meshes/y.stl".into()))));
        assert_eq!(found("http://a/b"), Err(MissingReason::WebAddress));
    }

    #[test]
    fn packages_are_found_by_the_name_of_their_folder_or_in_their_xml() {
        let folder = folder(&[
            "ws/src/arm/package.xml=my_arm",
            "ws/src/arm/m/a.stl",
            "ws/src/arm/m/plate.stl",
            "ws/src/group/hand/package.xml=my_hand",
            "ws/src/group/hand/a.stl",
            "ws/far/off/and/on/tool/package.xml=my_tool",
            "ws/far/off/and/on/tool/a.stl",
            "ws/src/no_xml/a.stl",
        ]);
        let at = |robot: &str, given: &[&str], written: &str| found(folder.path(), robot, given, written);
        for robot in ["ws/src/arm/urdf", "ws/src/arm", "ws/src/group/hand/urdf/deep"] {
            for (written, expected) in [
                ("package://my_arm/m/a.stl", "ws/src/arm/m/a.stl"),
                ("package://arm/m/a.stl", "ws/src/arm/m/a.stl"),
                ("model://my_hand/a.stl", "ws/src/group/hand/a.stl"),
                ("package://no_xml/a.stl", "ws/src/no_xml/a.stl"),
            ] {
                assert_eq!(at(robot, &[], written), Ok(expected.into()), "{robot} {written}");
            }
        }
        let tool = "package://my_tool/a.stl";
        assert_eq!(at("ws/src/arm", &[], tool), Err(MissingReason::NoPackage("my_tool".into())), "too far away");
        for given in ["ws/far", "ws/far/off/and/on", "ws/far/off/and/on/tool"] {
            assert_eq!(at("ws/src/arm", &[given], tool), Ok("ws/far/off/and/on/tool/a.stl".into()), "{given}");
        }
        assert_eq!(
            at("ws/src/arm", &[], "package://my_arm/m/plat.stl"),
            Err(MissingReason::NotFound(Some("package://my_arm/m/plate.stl".into())))
        );
        assert_eq!(at("ws/src/arm", &[], "package://../arm/m/a.stl"), Err(MissingReason::NoPackage("..".into())));
    }

    #[test]
    fn what_is_given_comes_before_what_lies_around() {
        let folder = folder(&["a/arm/a.stl", "b/arm/a.stl"]);
        assert_eq!(found(folder.path(), "a/urdf", &[], "package://arm/a.stl"), Ok("a/arm/a.stl".into()));
        assert_eq!(found(folder.path(), "a/urdf", &["b"], "package://arm/a.stl"), Ok("b/arm/a.stl".into()));
    }
}
