//! A real dataset: its images by name, and what its labels say of them. All layouts become one list of samples; images
//! stay on disk.
//!
//! A *unit* is what holds labels: a table (CSV or JSON Lines), COCO annotations, or a tar; of images in a folder for each
//! class the table that their folders make.

use std::collections::{HashMap, HashSet};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use super::config;
use gelsim_dataset::archive::{self, Head};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input::MOST_IMAGE_BYTES;
use gelsim_files::source::Source;
use gelsim_job::plan::check::Check;

pub mod coco;
pub mod columns;
mod find;
pub mod folders;
pub mod images;
mod names;
pub mod table;
mod tars;
mod unread;

use coco::Annotations;
use columns::{ColumnMap, LabelFacts};
use folders::FolderKind;

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
    /// How it is laid out.
    pub layout: Layout,
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
    /// The annotations of each unit, of COCO.
    pub annotations: Vec<Annotations>,
}

/// How a set is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Tables that name images.
    Tables,
    /// Images in folders that say what they are.
    ClassFolders(FolderKind),
    /// COCO annotations that name images.
    Coco,
    /// WebDataset tars.
    Tars,
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
    /// The folder that its images' names start from, from the set's.
    pub images: PathBuf,
}

/// How a unit holds labels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Form {
    /// A table with these columns.
    Csv(Vec<String>),
    /// One JSON object a line.
    JsonLines,
    /// One JSON with a list of images.
    Coco,
    /// A WebDataset tar.
    Tar,
}

impl Unit {
    /// The folder that it is in, from the set's.
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
    /// The image's file, from the unit's folder of images, with `/` between folders; of tars the key.
    pub image: String,
    /// The same from the set's folder; empty for tars.
    pub path: PathBuf,
    /// True if its label has `\` between folders.
    pub has_backslashes: bool,
    /// Where its label stands in the unit's text; empty for tars.
    pub text: Range<usize>,
    /// Number of its split in [`Set::splits`].
    pub split: usize,
    /// What its label says.
    pub facts: LabelFacts,
}

impl Real {
    /// One of which nothing but its image is known.
    fn of_image(unit: usize, image: &str) -> Self {
        Self {
            key: image.to_owned(),
            unit,
            image: image.to_owned(),
            path: PathBuf::new(),
            has_backslashes: false,
            text: 0..0,
            split: 0,
            facts: LabelFacts::default(),
        }
    }
}

impl Set {
    /// The text of a sample's label, of a table.
    pub fn text(&self, real: &Real) -> &str {
        self.sources.get(real.unit).map_or("", |source| &source.text[real.text.clone()])
    }

    /// A mistake in a sample's label.
    pub fn problem(&self, real: &Real, message: impl Into<String>) -> Diagnostic {
        match self.layout {
            Layout::Tables => {
                Diagnostic::new(message).at(table::place(real.unit, &self.sources[real.unit].text, real.text.start))
            }
            _ => Diagnostic::new(format!("{}: {}", self.name(real), message.into())),
        }
    }

    /// A sample in messages.
    pub fn name(&self, real: &Real) -> String {
        match self.layout {
            Layout::Tars => format!("{}: {}", self.root.join(&self.units[real.unit].file).display(), real.image),
            _ => self.path(real).display().to_string(),
        }
    }

    /// A sample's image; not of tars.
    pub fn path(&self, real: &Real) -> PathBuf {
        self.root.join(&real.path)
    }

    /// The bytes of a sample's image.
    pub fn image(&self, real: &Real) -> Result<Vec<u8>, String> {
        if !self.in_tars() {
            return gelsim_files::input::read(&self.path(real), MOST_IMAGE_BYTES).map_err(|error| error.to_string());
        }
        let unit = self.root.join(&self.units[real.unit].file);
        let mut found = None;
        let wanted =
            |head: Head<'_>| (head.key == real.image && head.suffix == self.image).then_some(MOST_MEMBER_BYTES);
        archive::open(&unit, wanted, |files| {
            if files.key == real.image {
                found = files.members.into_iter().next().map(|(_, bytes)| bytes);
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        })?;
        found.ok_or_else(|| String::from("it is not there any more"))
    }

    /// True of a set that Hugging Face reads as an imagefolder with metadata.
    pub fn is_imagefolder(&self) -> bool {
        self.units.iter().all(|unit| unit.file.file_stem().is_some_and(|stem| stem == "metadata"))
    }

    /// True of a set in tars.
    pub fn in_tars(&self) -> bool {
        self.layout == Layout::Tars
    }

    /// True of images in folders that say what they are.
    pub fn in_class_folders(&self) -> bool {
        matches!(self.layout, Layout::ClassFolders(_))
    }
}

/// What is known while units are read.
struct Draft<'a> {
    root: &'a Path,
    layout: Layout,
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
    coco: Vec<Annotations>,
    /// Images that COCO annotations name.
    paths: HashSet<PathBuf>,
    /// Size of each image.
    sizes: Vec<Result<[usize; 2], String>>,
    /// Mistakes in the set itself.
    found: Diagnostics,
    /// What is left out of it.
    notes: Diagnostics,
}

/// Reads the real dataset that `written` names; what is wrong in it is the report, what is wrong with the keys goes to
/// `check`. `None` after a mistake.
pub fn read(check: &mut Check<'_>, written: &config::Input, notes: &mut Diagnostics) -> (Option<Set>, Report) {
    let Some(find::Found { root, layout, units, files }) = find::units(check, written) else {
        return (None, Report::default());
    };
    let mut draft = Draft {
        root: &root,
        layout,
        written,
        reals: Vec::new(),
        named: Vec::new(),
        sources: Vec::new(),
        image: None,
        label: written.labels.clone().unwrap_or_else(|| String::from("json")),
        columns: None,
        example: serde_json::Map::new(),
        suffixes: Vec::new(),
        coco: Vec::new(),
        paths: HashSet::new(),
        sizes: Vec::new(),
        found: Diagnostics::default(),
        notes: Diagnostics::default(),
        units,
    };
    if layout == Layout::Tars && written.images.is_some() {
        check.error("input.images", "images are in the tars", "leave it out; input.image says which files are images");
    }
    let mut files = Some(files);
    for unit in 0..draft.units.len() {
        let first = draft.reals.len();
        let read = match layout {
            Layout::Tables => table::read(check, &mut draft, unit),
            Layout::ClassFolders(_) => folders::read(check, &mut draft, files.take().unwrap_or_default()),
            Layout::Coco => coco::read(check, &mut draft, unit),
            Layout::Tars => tars::read(check, &mut draft, unit),
        };
        draft.units[unit].reals = first..draft.reals.len();
        if read.is_none() {
            break;
        }
    }
    qualify(&mut draft);
    let size = measure(&mut draft);
    let Draft { units, mut reals, named, sources, image, label, columns, example, suffixes, found, .. } = draft;
    let (layout, annotations) = (draft.layout, draft.coco);
    notes.extend(draft.notes);
    if found.is_empty() && check.problems.is_empty() && reals.is_empty() {
        let help = "write a row for each image, or name another folder: one with labelled images";
        check.error("input.path", format!("{} holds no sample", root.display()), help);
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
    let set = Set {
        root,
        layout,
        units,
        reals,
        splits,
        split_by_unit,
        size,
        image,
        label,
        columns,
        example,
        sources,
        suffixes,
        annotations,
    };
    (Some(set), report)
}

/// Names samples with their unit where the same name is in several.
fn qualify(draft: &mut Draft<'_>) {
    let mut known: HashMap<&str, usize> = HashMap::new();
    let shared = draft.reals.iter().any(|real| known.insert(&real.key, real.unit).is_some());
    let in_tars = draft.layout == Layout::Tars;
    let several = !in_tars && draft.units.len() > 1;
    if !(shared || several) {
        return;
    }
    for real in &mut draft.reals {
        let unit = &draft.units[real.unit];
        let prefix = if in_tars { unit.file.with_extension("") } else { unit.images.clone() };
        real.key = prefix.join(&real.key).to_string_lossy().into_owned();
    }
}

/// The size that all images have; says which have another one, or cannot be read.
fn measure(draft: &mut Draft<'_>) -> Option<[usize; 2]> {
    let sizes = std::mem::take(&mut draft.sizes);
    let size = sizes.iter().find_map(|size| size.as_ref().ok()).copied();
    // What to do is found out once for each unit and cause: folders are looked through for it.
    let mut helps: HashMap<(usize, String), String> = HashMap::new();
    for (number, found) in sizes.into_iter().enumerate() {
        let real = &draft.reals[number];
        let problem = match (found, size) {
            (Err(reason), _) => {
                let images::Unreadable { message, cause } = images::unreadable(draft, real, &reason);
                let help = helps.entry((real.unit, cause.clone())).or_insert_with(|| images::help(draft, real));
                Diagnostic::new(message).of(&real.key, cause).help(help.clone())
            }
            (Ok([width, height]), Some([w, h])) if [width, height] != [w, h] => {
                let message = format!("{} is {width}x{height} px, the first image {w}x{h} px", real.key);
                let cause = format!("images have not the first one's size ({w}x{h} px)");
                let problem = Diagnostic::new(message).of(format!("{} ({width}x{height} px)", real.key), cause);
                problem.help("images of one sensor have one size: divide the set, or leave these out")
            }
            _ => continue,
        };
        let place = (draft.layout == Layout::Tables)
            .then(|| table::place(real.unit, &draft.sources[real.unit].text, real.text.start));
        let unit = draft.root.join(&draft.units[real.unit].file);
        let problem = match draft.layout {
            Layout::Tars => Diagnostic { message: format!("{}: {}", unit.display(), problem.message), ..problem },
            _ => problem.at(place),
        };
        draft.found.push(problem);
    }
    size
}
