//! What to know of how a file was read, though it could be.

use std::fmt;

use super::Format;

/// Something unclear that was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remark {
    /// The file's ending says another format than its bytes.
    Misnamed(Format),
    /// A binary STL counts other triangles than it holds.
    Count {
        /// As its header says.
        claimed: u64,
        /// As many fill the file to its end.
        held: u64,
    },
}

impl Remark {
    /// A way out.
    pub fn help(self) -> String {
        match self {
            Self::Misnamed(format) => format!("give it the ending .{}", format.endings()[0]),
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
