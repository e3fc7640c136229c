//! Reads named arrays from NumPy's archives, which are ZIP files of npy files. Pickled objects are refused.

use std::path::Path;

use super::npy::{self, NumberArray};
use super::zip::ZipArchive;
use crate::input::{self, MAX_IMAGE_BYTES};

/// An archive of arrays.
pub struct Npz(ZipArchive);

impl Npz {
    /// Reads a file of up to 1 GB. The error says what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, String> {
        Self::open(input::read(path, MAX_IMAGE_BYTES).map_err(|error| error.to_string())?)
    }

    /// Opens the bytes of an archive. Reads its directory, but no array yet.
    pub fn open(bytes: Vec<u8>) -> Result<Self, String> {
        ZipArchive::open(bytes).map(Self)
    }

    /// Iterates over the names of the arrays, in the order of the directory.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.names().map(|name| name.strip_suffix(".npy").unwrap_or(name))
    }

    /// Returns the array to be used if the user names none: the only one, or one with a name in `usual`, in any case.
    /// The error lists the arrays.
    pub fn find_default_array(&self, usual: &[&str]) -> Result<&str, String> {
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

    /// Unpacks the npy file of one array. Reading it takes up to 8 bytes of memory for each of its bytes, which is
    /// checked against the limits. The error says what is wrong.
    pub fn unpack_file(&self, name: &str) -> Result<Vec<u8>, String> {
        let member = self.0.names().find(|member| member.strip_suffix(".npy").unwrap_or(member) == name);
        let Some(bytes) = member.and_then(|member| self.0.unpack_member(member, 8)) else {
            let names: Vec<String> = self.names().take(20).map(|name| format!("`{}`", name.escape_debug())).collect();
            return Err(format!("it has no array `{}`, but {}", name.escape_debug(), names.join(", ")));
        };
        bytes.map_err(|reason| format!("array `{name}`: {reason}"))
    }

    /// Unpacks and reads one array. The error says what is wrong, with the array's name.
    pub fn read_array(&self, name: &str) -> Result<NumberArray, String> {
        npy::decode_numbers(&self.unpack_file(name)?).map_err(|reason| format!("array `{name}`: {reason}"))
    }
}
