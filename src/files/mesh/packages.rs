//! Where the meshes of a robot are: from its folder and the folders above it on, as PyBullet looks for them, and in packages,
//! as ROS does.
//!
//! A package is a folder of its name, or one whose `package.xml` has that name: among the folders that the user gives, above
//! the robot and around the folders above it, and where the environment of ROS and Gazebo says.

use std::collections::{HashMap, VecDeque};
use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Component, Path, PathBuf};

use roxmltree::{Document, Node};

use super::missing::Reason;
use super::uri::decoded;
use super::{Format, is_height_map};
use crate::input;

/// What a robot writes in place of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Named {
    /// A path, absolute or from its folder on.
    Path(String),
    /// A path in a package.
    InPackage {
        /// Its name.
        package: String,
        /// From its folder on.
        path: String,
    },
    /// An address.
    OnTheWeb,
    /// Something that a program replaces before anyone reads it.
    Macro,
}

impl Named {
    /// Takes apart what is written.
    pub(super) fn new(written: &str) -> Self {
        let written = written.trim();
        // `file:///a`, `file:/a` and, against the rules, `file://a`.
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
            return Self::OnTheWeb;
        }
        Self::Path(if is_uri { decoded(rest) } else { rest.to_owned() })
    }
}

/// Levels of folders below one of the user's or of ROS in which packages may lie.
const DEEP: usize = 4;
/// The same below a folder above the robot, of which there may be so many.
const AROUND: usize = 2;
const ABOVE: usize = 5;
/// Folders that are listed below one.
const MOST_FOLDERS: usize = 2_000;
/// A longer `package.xml` is none, bytes.
const MOST_XML: u64 = 1 << 20;

/// Looks for files, and remembers where packages are.
pub(super) struct Packages {
    given: Vec<PathBuf>,
    /// Below a folder: the packages by the name in their `package.xml`.
    listed: HashMap<PathBuf, HashMap<String, Vec<PathBuf>>>,
    /// Packages that were found only through the environment.
    of_environment: Vec<PathBuf>,
}

impl Packages {
    /// In these folders first.
    pub(super) fn new(given: &[String]) -> Self {
        let given = given.iter().map(PathBuf::from).collect();
        Self { given, listed: HashMap::new(), of_environment: Vec::new() }
    }

    /// The folders in which all that was found is found again, without the environment.
    pub(super) fn needed(&self) -> Vec<String> {
        self.given.iter().chain(&self.of_environment).map(|path| path.to_string_lossy().into_owned()).collect()
    }

    /// The file that a robot in `folder` names.
    pub(super) fn find(&mut self, folder: &Path, named: &Named) -> Result<PathBuf, Reason> {
        match named {
            Named::OnTheWeb => Err(Reason::OnTheWeb),
            Named::Macro => Err(Reason::NotThere(None)),
            Named::Path(path) => {
                let forms = [path.clone(), path.replace('\\', "/")];
                let mut folders = vec![folder.to_owned()];
                folders.extend(above(folder).into_iter().skip(1));
                folders.extend(self.given.iter().cloned());
                let mut places = folders.iter().flat_map(|folder| forms.iter().map(|path| folder.join(path)));
                match places.find(|place| place.is_file()) {
                    Some(place) => Ok(place),
                    None => Err(Reason::NotThere(meant(&folder.join(&forms[1]), &forms[1]))),
                }
            }
            Named::InPackage { package, path } => self.in_package(folder, package, path),
        }
    }

    fn in_package(&mut self, folder: &Path, package: &str, path: &str) -> Result<PathBuf, Reason> {
        let mut first = None;
        let mut look = |folders: Vec<PathBuf>| {
            let found = folders.iter().find(|folder| folder.join(path).is_file()).cloned();
            first = first.take().or_else(|| folders.into_iter().next());
            found
        };
        for given in self.given.clone() {
            if let Some(found) = look(self.of(&given, package, DEEP)) {
                return Ok(found.join(path));
            }
        }
        let above = above(folder);
        for folder in &above {
            if let Some(found) = look(self.by_name(folder, package)) {
                return Ok(found.join(path));
            }
        }
        for folder in above.iter().take(ABOVE).filter(|folder| folder.parent().is_some()) {
            if let Some(found) = look(self.by_xml(folder, package, AROUND)) {
                return Ok(found.join(path));
            }
        }
        for (folder, deep) in environment() {
            if let Some(found) = look(self.of(&folder, package, deep)) {
                let found = std::path::absolute(&found).unwrap_or(found);
                if !self.of_environment.contains(&found) {
                    self.of_environment.push(found.clone());
                }
                return Ok(found.join(path));
            }
        }
        Err(match first {
            Some(found) => Reason::NotThere(meant(&found.join(path), &format!("package://{package}/{path}"))),
            None => Reason::NoPackage(package.to_owned()),
        })
    }

    /// The packages of this name that a folder is or holds.
    fn of(&mut self, folder: &Path, package: &str, deep: usize) -> Vec<PathBuf> {
        let mut found = self.by_name(folder, package);
        if deep > 0 {
            found.extend(self.by_xml(folder, package, deep));
        }
        found
    }

    /// The same by the folders' own names.
    fn by_name(&self, folder: &Path, package: &str) -> Vec<PathBuf> {
        let own = (folder.file_name() == Some(OsStr::new(package))).then(|| folder.to_owned());
        // A name with slashes or dots leads elsewhere.
        let is_name = Path::new(package).components().all(|part| matches!(part, Component::Normal(_)));
        let inside = Some(folder.join(package)).filter(|inside| is_name && !package.is_empty() && inside.is_dir());
        own.into_iter().chain(inside).collect()
    }

    /// The same by the names in `package.xml`.
    fn by_xml(&mut self, folder: &Path, package: &str, deep: usize) -> Vec<PathBuf> {
        let listed = self.listed.entry(folder.to_owned()).or_insert_with(|| packages_below(folder, deep));
        listed.get(package).cloned().unwrap_or_default()
    }
}

/// The folder and those above it, without links first and then, if it is reached by one, where it really lies.
fn above(folder: &Path) -> Vec<PathBuf> {
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

/// The packages below a folder, or that it is, by name; those in a package are not looked for.
fn packages_below(folder: &Path, deep: usize) -> HashMap<String, Vec<PathBuf>> {
    let mut found: HashMap<String, Vec<PathBuf>> = HashMap::new();
    let mut waiting = VecDeque::from([(folder.to_owned(), 0)]);
    let mut listed = 0;
    while let Some((folder, depth)) = waiting.pop_front() {
        if let Some(name) = package_name(&folder.join("package.xml")) {
            found.entry(name).or_default().push(folder.clone());
            // The folder of a robot lies in its package: others lie beside that.
            if depth > 0 {
                continue;
            }
        }
        listed += 1;
        if depth == deep || listed > MOST_FOLDERS {
            continue;
        }
        let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
        let mut folders: Vec<PathBuf> = entries
            .filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b"."))
            .map(|entry| entry.path())
            .filter(|path| path.is_dir())
            .take(MOST_FOLDERS)
            .collect();
        folders.sort();
        waiting.extend(folders.into_iter().map(|path| (path, depth + 1)));
    }
    found
}

/// The name in a `package.xml`.
fn package_name(path: &Path) -> Option<String> {
    let bytes = input::read_if_there(path, MOST_XML).ok()??;
    let document = Document::parse(str::from_utf8(&bytes).ok()?).ok()?;
    let root = Some(document.root_element()).filter(|root| root.has_tag_name("package"))?;
    let name = root.children().find(|node: &Node| node.has_tag_name("name"))?.text()?.trim();
    (!name.is_empty()).then(|| name.to_owned())
}

/// Where ROS 1, ROS 2 and Gazebo look for packages and models, and how deep.
fn environment() -> Vec<(PathBuf, usize)> {
    let of = |key: &str| -> Vec<PathBuf> {
        let value = env::var_os(key).unwrap_or_default();
        env::split_paths(&value).filter(|path| !path.as_os_str().is_empty()).collect()
    };
    let mut folders: Vec<(PathBuf, usize)> = of("ROS_PACKAGE_PATH").into_iter().map(|path| (path, DEEP)).collect();
    folders.extend(of("AMENT_PREFIX_PATH").into_iter().map(|path| (path.join("share"), 0)));
    for key in ["GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH"] {
        folders.extend(of(key).into_iter().map(|path| (path, 0)));
    }
    folders
}

/// What stands beside a file that is not there and may have been meant, as the robot would write it.
fn meant(missing: &Path, written: &str) -> Option<String> {
    let name = input::meant(missing, |path| Format::from_path(path).is_some() || is_height_map(path))?;
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

    fn found(folder: &Path, robot: &str, given: &[&str], written: &str) -> Result<String, Reason> {
        let given: Vec<String> = given.iter().map(|given| folder.join(given).to_string_lossy().into_owned()).collect();
        let found = Packages::new(&given).find(&folder.join(robot), &Named::new(written))?;
        Ok(above(&found)[0].strip_prefix(above(folder)[0].clone()).unwrap().to_string_lossy().into_owned())
    }

    #[test]
    fn what_is_written_is_taken_apart() {
        let path = |path: &str| Named::Path(path.into());
        let package = |package: &str, path: &str| Named::InPackage { package: package.into(), path: path.into() };
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
            ("https://a/b.stl", Named::OnTheWeb),
            ("${dir}/a.stl", Named::Macro),
            ("$(arg dir)/a.stl", Named::Macro),
            ("", path("")),
        ] {
            assert_eq!(Named::new(written), expected, "{written}");
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
        assert!(Packages::new(&[]).find(&link, &Named::new("meshes/x.stl")).is_ok(), "above where the link leads");
        assert_eq!(found("../meshes/teapot.stl"), Err(Reason::NotThere(None)));
        assert_eq!(found("../meshes/y.obj"), Err(Reason::NotThere(Some("../meshes/y.stl".into()))));
        assert_eq!(found("http://a/b"), Err(Reason::OnTheWeb));
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
        assert_eq!(at("ws/src/arm", &[], tool), Err(Reason::NoPackage("my_tool".into())), "too far away");
        for given in ["ws/far", "ws/far/off/and/on", "ws/far/off/and/on/tool"] {
            assert_eq!(at("ws/src/arm", &[given], tool), Ok("ws/far/off/and/on/tool/a.stl".into()), "{given}");
        }
        assert_eq!(
            at("ws/src/arm", &[], "package://my_arm/m/plat.stl"),
            Err(Reason::NotThere(Some("package://my_arm/m/plate.stl".into())))
        );
        assert_eq!(at("ws/src/arm", &[], "package://../arm/m/a.stl"), Err(Reason::NoPackage("..".into())));
    }

    #[test]
    fn what_is_given_comes_before_what_lies_around() {
        let folder = folder(&["a/arm/a.stl", "b/arm/a.stl"]);
        assert_eq!(found(folder.path(), "a/urdf", &[], "package://arm/a.stl"), Ok("a/arm/a.stl".into()));
        assert_eq!(found(folder.path(), "a/urdf", &["b"], "package://arm/a.stl"), Ok("b/arm/a.stl".into()));
    }
}
