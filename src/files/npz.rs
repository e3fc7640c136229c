//! Named arrays in NumPy's archives: a ZIP file of npy files. Pickled objects are not numbers and are refused.

use std::path::Path;

use super::npy::{self, Numbers};
use super::zip::Zip;
use crate::files::input::{self, MOST_IMAGE_BYTES};

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

    /// Unpacks and reads one array. On failure, what is wrong, with the array's name in it.
    pub fn array(&self, name: &str) -> Result<Numbers, String> {
        let member = self.0.names().find(|member| member.strip_suffix(".npy").unwrap_or(member) == name);
        // A byte may become a number of eight.
        let Some(bytes) = member.and_then(|member| self.0.member(member, 8)) else {
            let names: Vec<String> = self.names().take(20).map(|name| format!("`{}`", name.escape_debug())).collect();
            return Err(format!("it has no array `{name}`, but {}", names.join(", ")));
        };
        let numbers = bytes.and_then(|bytes| npy::decode_numbers(&bytes));
        numbers.map_err(|reason| format!("array `{name}`: {reason}"))
    }
}
