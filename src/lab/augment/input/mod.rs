//! A real dataset: its images by name, and what its labels say of them. Three layouts become one list of samples; images
//! stay on disk.
//!
//! A *unit* is what holds labels: a table (CSV or JSON Lines) beside its images, or a tar.

use std::collections::HashMap;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use super::config;
use crate::dataset::archive::{self, Head};
use crate::files::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::files::input::MOST_IMAGE_BYTES;
use crate::files::source::Source;
use crate::job::plan::check::Check;

pub mod columns;
mod find;
pub mod table;
mod tars;

use columns::{ColumnMap, LabelFacts};

/// Largest file of a sample in a tar, bytes.
pub const MOST_MEMBER_BYTES: u64 = 256 << 20;
/// Largest label, as a file in a tar or a row of a table; largest header of a table.
pub const MOST_LABEL_BYTES: u64 = 1 << 20;

/// The most bytes that a file of a sample in a tar may have whose name ends in `suffix`.
pub fn most_bytes(suffix: &str, label: &str) -> u64 {
    if suffix == label { MOST_LABEL_BYTES } else { MOST_MEMBER_BYTES }
}

/// A real dataset that was read.
pub struct Set {
    /// Its folder.
    pub root: PathBuf,
    /// What holds its labels.
    pub units: Vec<Unit>,
    /// Its samples: those of the first unit, of the second, and so on.
    pub reals: Vec<Real>,
    /// Names of its splits, in the order in which they appear.
    pub splits: Vec<String>,
    /// True if a sample's split is its unit's.
    pub split_by_unit: bool,
    /// Columns and rows of every image.
    pub size: [usize; 2],
    /// The column with the image's file; of tars the end of the image's name.
    pub image: String,
    /// The end of the label's name in a tar.
    pub label: String,
    /// What its columns mean.
    pub columns: ColumnMap,
    /// A label of the set, for its keys: of a table in JSON or a tar. A table in CSV has a header.
    pub example: serde_json::Map<String, serde_json::Value>,
    /// The text of each unit that is a table, in their order, for messages and for what is passed through.
    pub sources: Vec<Source>,
    /// Ends of the names in a tar that every sample has.
    pub suffixes: Vec<String>,
}

/// What holds labels.
#[derive(Clone, Debug)]
pub struct Unit {
    /// Its file, from the set's folder.
    pub file: PathBuf,
    /// How it holds them.
    pub form: Form,
    /// Its samples in [`Set::reals`].
    pub reals: Range<usize>,
    /// The split that its name tells.
    pub split: Option<String>,
}

/// How a unit holds labels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Form {
    /// A table with these columns.
    Csv(Vec<String>),
    /// One JSON object a line.
    JsonLines,
    /// A WebDataset tar.
    Tar,
}

impl Unit {
    /// The folder that its images are in, from the set's.
    pub fn folder(&self) -> &Path {
        self.file.parent().unwrap_or(Path::new(""))
    }
}

/// A real sample.
#[derive(Clone, Debug)]
pub struct Real {
    /// Its name in the set: the image's file, or the key in its tar; with the unit's where that alone is not unique.
    pub key: String,
    /// Its unit.
    pub unit: usize,
    /// The image's file, from the unit's folder; of tars the key.
    pub image: String,
    /// Where its label stands in the unit's text; empty for tars.
    pub text: Range<usize>,
    /// Number of its split in [`Set::splits`].
    pub split: usize,
    /// What its label says.
    pub facts: LabelFacts,
}

impl Set {
    /// The text of a sample's label, of a table.
    pub fn text(&self, real: &Real) -> &str {
        self.sources.get(real.unit).map_or("", |source| &source.text[real.text.clone()])
    }

    /// A mistake in a sample's label.
    pub fn problem(&self, real: &Real, message: impl Into<String>) -> Diagnostic {
        match self.units[real.unit].form {
            Form::Tar => Diagnostic::new(format!("{}: {}", self.name(real), message.into())),
            _ => Diagnostic::new(message).at(table::place(real.unit, &self.sources[real.unit].text, real.text.start)),
        }
    }

    /// A sample in messages.
    pub fn name(&self, real: &Real) -> String {
        let unit = self.root.join(&self.units[real.unit].file);
        match self.units[real.unit].form {
            Form::Tar => format!("{}: {}", unit.display(), real.image),
            _ => unit.with_file_name("").join(&real.image).display().to_string(),
        }
    }

    /// The bytes of a sample's image.
    pub fn image(&self, real: &Real) -> Result<Vec<u8>, String> {
        let unit = self.root.join(&self.units[real.unit].file);
        if self.units[real.unit].form != Form::Tar {
            let path = unit.with_file_name("").join(&real.image);
            return crate::files::input::read(&path, MOST_IMAGE_BYTES).map_err(|error| error.to_string());
        }
        let mut found = None;
        let wanted =
            |head: Head<'_>| (head.key == real.image && head.suffix == self.image).then_some(MOST_MEMBER_BYTES);
        archive::open(&unit, wanted, |files| match files.key == real.image {
            true => {
                found = files.members.into_iter().next().map(|(_, bytes)| bytes);
                ControlFlow::Break(())
            }
            false => ControlFlow::Continue(()),
        })?;
        found.ok_or_else(|| String::from("it is not there any more"))
    }

    /// True of a set that Hugging Face reads as an imagefolder.
    pub fn is_imagefolder(&self) -> bool {
        self.units.iter().all(|unit| unit.file.file_stem().is_some_and(|stem| stem == "metadata"))
    }

    /// True of a set in tars.
    pub fn in_tars(&self) -> bool {
        self.units.first().is_some_and(|unit| unit.form == Form::Tar)
    }
}

/// What is known while units are read.
struct Draft<'a> {
    root: &'a Path,
    written: &'a config::Input,
    units: Vec<Unit>,
    reals: Vec<Real>,
    /// Split of each sample by its label.
    named: Vec<Option<String>>,
    sources: Vec<Source>,
    image: Option<String>,
    label: String,
    columns: Option<ColumnMap>,
    example: serde_json::Map<String, serde_json::Value>,
    suffixes: Vec<String>,
    /// Size of each image.
    sizes: Vec<Result<[usize; 2], String>>,
    /// Mistakes in the set itself.
    found: Diagnostics,
}

/// Reads the real dataset that `written` names; what is wrong in it is the report, what is wrong with the keys goes to
/// `check`. `None` after a mistake.
pub fn read(check: &mut Check<'_>, written: &config::Input) -> (Option<Set>, Report) {
    let Some(find::Found { root, units }) = find::units(check, written) else { return (None, Report::default()) };
    let mut draft = Draft {
        root: &root,
        written,
        reals: Vec::new(),
        named: Vec::new(),
        sources: Vec::new(),
        image: None,
        label: written.labels.clone().unwrap_or_else(|| String::from("json")),
        columns: None,
        example: serde_json::Map::new(),
        suffixes: Vec::new(),
        sizes: Vec::new(),
        found: Diagnostics::default(),
        units,
    };
    for unit in 0..draft.units.len() {
        let first = draft.reals.len();
        let tar = draft.units[unit].form == Form::Tar;
        let read = if tar { tars::read(check, &mut draft, unit) } else { table::read(check, &mut draft, unit) };
        draft.units[unit].reals = first..draft.reals.len();
        if read.is_none() {
            break;
        }
    }
    qualify(&mut draft);
    let size = sizes(&mut draft);
    let Draft { units, mut reals, named, sources, image, label, columns, example, suffixes, found, .. } = draft;
    if found.is_empty() && check.problems.is_empty() && reals.is_empty() {
        check.error("input.path", format!("{} holds no sample", root.display()), "name a folder with labelled images");
    }
    let report = Report::new(&found, &sources);
    let (Some(columns), Some(image), Some(size), true) = (columns, image, size, found.is_empty()) else {
        return (None, report);
    };
    let split_by_unit = written.columns.split.is_none() && units.iter().all(|unit| unit.split.is_some());
    let mut splits: Vec<String> = Vec::new();
    for (real, named) in reals.iter_mut().zip(named) {
        let of_unit = units[real.unit].split.clone().filter(|_| split_by_unit);
        let name = of_unit.or(named).unwrap_or_default();
        real.split = splits.iter().position(|split| *split == name).unwrap_or_else(|| {
            splits.push(name);
            splits.len() - 1
        });
    }
    let set =
        Set { root, units, reals, splits, split_by_unit, size, image, label, columns, example, sources, suffixes };
    (Some(set), report)
}

/// Names samples with their unit where the same name is in several.
fn qualify(draft: &mut Draft<'_>) {
    let mut known: HashMap<&str, usize> = HashMap::new();
    let shared = draft.reals.iter().any(|real| known.insert(&real.key, real.unit).is_some());
    let tables = draft.units.first().is_some_and(|unit| unit.form != Form::Tar);
    let several = tables && draft.units.len() > 1;
    if !(shared || several) {
        return;
    }
    for real in &mut draft.reals {
        let unit = &draft.units[real.unit];
        let prefix = if unit.form == Form::Tar { unit.file.with_extension("") } else { unit.folder().to_owned() };
        real.key = prefix.join(&real.key).to_string_lossy().into_owned();
    }
}

/// The size that all images have; says which have another one, or cannot be read.
fn sizes(draft: &mut Draft<'_>) -> Option<[usize; 2]> {
    let sizes = std::mem::take(&mut draft.sizes);
    let size = sizes.iter().find_map(|size| size.as_ref().ok()).copied();
    for (real, found) in draft.reals.iter().zip(sizes) {
        let (message, help) = match (found, size) {
            (Err(reason), _) => (
                format!("cannot read the image {}: {reason}", real.image),
                "a PNG belongs here; remove the row if there is no image",
            ),
            (Ok([width, height]), Some([w, h])) if [width, height] != [w, h] => (
                format!("{} is {width}x{height} px, the first image {w}x{h} px", real.image),
                "images of one sensor have one size: divide the set, or leave these out",
            ),
            _ => continue,
        };
        let unit = &draft.units[real.unit];
        let problem = match unit.form {
            Form::Tar => Diagnostic::new(format!("{}: {message}", draft.root.join(&unit.file).display())),
            _ => Diagnostic::new(message).at(table::place(real.unit, &draft.sources[real.unit].text, real.text.start)),
        };
        draft.found.push(problem.help(help));
    }
    size
}
