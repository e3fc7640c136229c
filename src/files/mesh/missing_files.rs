//! Files that a mesh file names and that do not exist.

use std::fmt;

use super::words::quote_file_name;

/// All files that a file names and that do not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingFiles {
    /// What the files are named for.
    pub what: ResourceKind,
    /// The files, each once. There is at least one.
    pub files: Vec<MissingFile>,
}

/// What a file names other files for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResourceKind {
    /// A robot's shape.
    Mesh,
    /// The numbers of a glTF.
    Buffer,
}

/// One file that does not exist.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingFile {
    /// The name as the file writes it.
    pub name: String,
    /// The line on which it is named, in a text.
    pub line: Option<usize>,
    /// Why it is not found.
    pub reason: MissingReason,
}

/// Why a file is not found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MissingReason {
    /// It is not where it is looked for. Holds the name that was perhaps meant.
    NotFound(Option<String>),
    /// There is no package of this name.
    NoPackage(String),
    /// The name is an address on the web.
    WebAddress,
}

impl MissingFiles {
    /// Returns what to do.
    pub(super) fn help(&self) -> String {
        if self.files.iter().all(|file| file.reason == MissingReason::WebAddress) {
            return String::from("nothing is downloaded: fetch it, and write the path of the file in its place");
        }
        let meant = match self.files.as_slice() {
            [MissingFile { reason: MissingReason::NotFound(Some(meant)), .. }] => {
                format!("did you mean {}? ", quote_file_name(meant))
            }
            _ => String::new(),
        };
        let where_else = match self.what {
            ResourceKind::Mesh => {
                "they are looked for in the robot's folder and those above it, and in packages around it; packages = [\"FOLDER\"] \
                 under [[object]] says where else (gelsim inspect: --packages FOLDER), as does ROS_PACKAGE_PATH"
            }
            ResourceKind::Buffer => {
                "a .gltf needs its buffers beside it: copy them there, or export one .glb with all in it"
            }
        };
        meant + where_else
    }
}

impl fmt::Display for MissingFiles {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        /// Most files that are listed.
        const MAX_NAMED: usize = 5;
        let (one, many) = match self.what {
            ResourceKind::Mesh => ("mesh", "meshes"),
            ResourceKind::Buffer => ("buffer", "buffers"),
        };
        if let [MissingFile { name, reason, .. }] = self.files.as_slice() {
            write!(f, "names the {one} {}", quote_file_name(name))?;
            return match reason {
                MissingReason::NotFound(_) => write!(f, ", which is not there"),
                MissingReason::NoPackage(package) => {
                    write!(f, ", and there is no package {}", quote_file_name(package))
                }
                MissingReason::WebAddress => write!(f, ", which is on the web"),
            };
        }
        write!(f, "names {} {many} that are not there: ", self.files.len())?;
        for (i, MissingFile { name, line, .. }) in self.files.iter().take(MAX_NAMED).enumerate() {
            let before = if i > 0 { ", " } else { "" };
            write!(f, "{before}{}", quote_file_name(name))?;
            if let Some(line) = line {
                write!(f, " (line {line})")?;
            }
        }
        match self.files.len().saturating_sub(MAX_NAMED) {
            0 => Ok(()),
            more => write!(f, " and {more} more"),
        }
    }
}
