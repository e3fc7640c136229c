//! Files that a mesh file names and that are not there.

use std::fmt;

use super::words::named;

/// All that a file names in vain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// What belongs there.
    pub what: Wanted,
    /// The files, each once; never none.
    pub files: Vec<MissingFile>,
}

/// What a file names others for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// A robot its shapes.
    Mesh,
    /// A glTF its numbers.
    Buffer,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingFile {
    /// As the file writes it.
    pub name: String,
    /// Where, in text.
    pub line: Option<usize>,
    /// Why it is not found.
    pub reason: Reason,
}

/// Why a file is not found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reason {
    /// It is not where it is looked for; perhaps another name was meant.
    NotThere(Option<String>),
    /// There is no package of this name.
    NoPackage(String),
    /// It is an address on the web.
    OnTheWeb,
}

impl Missing {
    /// A way out.
    pub(super) fn help(&self) -> String {
        if self.files.iter().all(|file| file.reason == Reason::OnTheWeb) {
            return String::from("nothing is downloaded: fetch it, and write the path of the file in its place");
        }
        let meant = match self.files.as_slice() {
            [MissingFile { reason: Reason::NotThere(Some(meant)), .. }] => format!("did you mean {}? ", named(meant)),
            _ => String::new(),
        };
        let where_else = match self.what {
            Wanted::Mesh => {
                "they are looked for in the robot's folder and those above it, and in packages around it; packages = [\"FOLDER\"] \
                 under [[object]] says where else (gelsim inspect: --packages FOLDER), as does ROS_PACKAGE_PATH"
            }
            Wanted::Buffer => "a .gltf needs its buffers beside it: copy them there, or export one .glb with all in it",
        };
        meant + where_else
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        /// Files that are named.
        const NAMED: usize = 5;
        let (one, many) = match self.what {
            Wanted::Mesh => ("mesh", "meshes"),
            Wanted::Buffer => ("buffer", "buffers"),
        };
        if let [MissingFile { name, reason, .. }] = self.files.as_slice() {
            write!(f, "names the {one} {}", named(name))?;
            return match reason {
                Reason::NotThere(_) => write!(f, ", which is not there"),
                Reason::NoPackage(package) => write!(f, ", and there is no package {}", named(package)),
                Reason::OnTheWeb => write!(f, ", which is on the web"),
            };
        }
        write!(f, "names {} {many} that are not there: ", self.files.len())?;
        for (i, MissingFile { name, line, .. }) in self.files.iter().take(NAMED).enumerate() {
            let before = if i > 0 { ", " } else { "" };
            write!(f, "{before}{}", named(name))?;
            if let Some(line) = line {
                write!(f, " (line {line})")?;
            }
        }
        match self.files.len().saturating_sub(NAMED) {
            0 => Ok(()),
            more => write!(f, " and {more} more"),
        }
    }
}
