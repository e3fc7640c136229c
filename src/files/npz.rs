//! Named arrays in NumPy's archives: a ZIP file of npy files. Pickled objects are not numbers and are refused.

use std::path::Path;

use super::npy::{self, Numbers};
use super::zip::Zip;
use crate::input::{self, MOST_IMAGE_BYTES};

/// An archive of arrays.
pub struct Npz(Zip);

impl Npz {
    /// Reads a file of up to 1 GB. On failure, what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, String> {
        Self::open(input::read(path, MOST_IMAGE_BYTES).map_err(|error| error.to_string())?)
    }

    /// Takes the bytes of an archive, and reads its directory but no array yet.
    pub fn open(bytes: Vec<u8>) -> Result<Self, String> {
        Zip::open(bytes).map(Self)
    }

    /// The arrays' names, in the order of the directory.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.names().map(|name| name.strip_suffix(".npy").unwrap_or(name))
    }

    /// The array that is meant where nobody says which: the only one, or the one with such a name, in any case. On failure,
    /// which there are.
    pub fn meant(&self, usual: &[&str]) -> Result<&str, String> {
        let names: Vec<&str> = self.names().collect();
        let known = |name: &&&str| usual.iter().any(|usual| name.eq_ignore_ascii_case(usual));
        match (names.as_slice(), names.iter().find(known)) {
            ([], _) => Err(String::from("it is an archive without arrays")),
            ([name], _) | (_, Some(name)) => Ok(*name),
            (names, None) => {
                let shown: Vec<String> =
                    names.iter().take(20).map(|name| format!("`{}`", name.escape_debug())).collect();
                let more = if names.len() > shown.len() { " and more" } else { "" };
                Err(format!(
                    "it holds {} arrays, {}{more}, and none is called `{}`",
                    names.len(),
                    shown.join(", "),
                    usual[0]
                ))
            }
        }
    }

    /// Unpacks the npy file that one array is, at most 8 bytes of memory for each of its bytes. On failure, what is wrong.
    pub fn file(&self, name: &str) -> Result<Vec<u8>, String> {
        let member = self.0.names().find(|member| member.strip_suffix(".npy").unwrap_or(member) == name);
        let Some(bytes) = member.and_then(|member| self.0.member(member, 8)) else {
            let names: Vec<String> = self.names().take(20).map(|name| format!("`{}`", name.escape_debug())).collect();
            return Err(format!("it has no array `{}`, but {}", name.escape_debug(), names.join(", ")));
        };
        bytes.map_err(|reason| format!("array `{name}`: {reason}"))
    }

    /// Unpacks and reads one array. On failure, what is wrong, with the array's name in it.
    pub fn array(&self, name: &str) -> Result<Numbers, String> {
        npy::decode_numbers(&self.file(name)?).map_err(|reason| format!("array `{name}`: {reason}"))
    }
}
