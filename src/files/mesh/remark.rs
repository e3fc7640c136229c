//! Remarks on how a file was read: it could be, but something was unclear.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::Format;

/// Something that was unclear and had to be decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Remark {
    /// The file's extension is that of another format than its bytes.
    Misnamed(Format),
    /// The header of a binary STL counts another number of triangles than the file holds.
    Count {
        /// The number in the header.
        claimed: u64,
        /// The number that fills the file to its end.
        held: u64,
    },
}

impl Remark {
    /// Returns what to do.
    pub fn help(self) -> String {
        match self {
            Self::Misnamed(format) => format!("give it the ending .{}", format.extensions()[0]),
            Self::Count { .. } => {
                String::from("look at it with gelsim preview: if a part is missing, copy or export it again")
            }
        }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Misnamed(format) => write!(f, "is {} by its bytes, and read as that", format.name()),
            Self::Count { claimed, held } => {
                write!(f, "says that it has {claimed} triangles and holds {held}, which are read")
            }
        }
    }
}
