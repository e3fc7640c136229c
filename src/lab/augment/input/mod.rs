//! A real dataset: its images by name, and what its labels say about them. All layouts become one list of samples;
//! images stay on disk.
//!
//! A *unit* holds labels: a table (CSV or JSON Lines), COCO annotations, or a tar. For images in a folder per class, it
//! is the table that the folders make.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use super::config;
use gelsim_dataset::archive::{self, MemberHead};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::input::MAX_IMAGE_BYTES;
use gelsim_files::source::SourceText;
use gelsim_job::plan::check::JobChecker;

pub mod coco;
pub mod columns;
mod exif;
mod find;
pub mod folders;
pub mod images;
mod json;
mod names;
pub mod table;
mod tars;
mod unread;

use coco::CocoAnnotations;
use columns::{ColumnMap, LabelFacts};
use folders::FolderKind;

/// Largest file of a sample in a tar, bytes.
pub const MAX_MEMBER_BYTES: u64 = 256 << 20;
/// Largest label, as a file in a tar or a row of a table; largest header of a table.
pub const MAX_LABEL_BYTES: u64 = 1 << 20;

/// Most bytes of a sample's file in a tar whose name ends in `suffix`; `label` is the suffix of labels.
pub fn most_member_bytes(suffix: &str, label: &str) -> u64 {
    if suffix == label { MAX_LABEL_BYTES } else { MAX_MEMBER_BYTES }
}

/// A real dataset that was read.
pub struct RealDataset {
    /// Folder of the set.
    pub root: PathBuf,
    /// Layout of the set.
    pub layout: InputLayout,
    /// Units with its labels.
    pub units: Vec<InputUnit>,
    /// Samples: those of the first unit, then of the second, and so on.
    pub reals: Vec<RealSample>,
    /// Names of the splits, in the order in which they appear.
    pub splits: Vec<String>,
    /// Whether a sample's split is that of its unit.
    pub split_by_unit: bool,
    /// Columns and rows of every image.
    pub size: [usize; 2],
    /// Column with the image's file; for tars the suffix of the image's name.
    pub image_column: String,
    /// Suffix of the label's name in a tar.
    pub label_suffix: String,
    /// Meaning of the columns.
    pub columns: ColumnMap,
    /// A label of the set, for its keys, if labels are JSON. A CSV table has a header instead.
    pub example: serde_json::Map<String, serde_json::Value>,
    /// Number of each class, as labels of gelsim tell it.
    pub class_numbers: BTreeMap<String, u64>,
    /// Text of each unit that is a table, in their order, for messages and for what is passed through.
    pub sources: Vec<SourceText>,
    /// Suffixes that every sample in a tar has.
    pub suffixes: Vec<String>,
    /// Annotations of each unit, for COCO.
    pub annotations: Vec<CocoAnnotations>,
}

/// Layout of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputLayout {
    /// Tables that name images.
    Tables,
    /// Images whose folders are labels.
    ClassFolders(FolderKind),
    /// COCO annotations that name images.
    Coco,
    /// WebDataset tars.
    Tars,
}

/// A file that holds labels.
#[derive(Clone, Debug)]
pub struct InputUnit {
    /// File, relative to the set's folder.
    pub file: PathBuf,
    /// Format of the labels.
    pub form: LabelFormat,
    /// Its samples in [`RealDataset::reals`].
    pub reals: Range<usize>,
    /// Split that its name tells.
    pub split: Option<String>,
    /// Folder from which its images' names start, relative to the set's.
    pub images: PathBuf,
}

/// Format of a unit's labels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LabelFormat {
    /// A CSV table with these columns.
    Csv(Vec<String>),
    /// One JSON object a line.
    JsonLines,
    /// One JSON with a list of images.
    Coco,
    /// A WebDataset tar.
    Tar,
}

impl InputUnit {
    /// Folder of the file, relative to the set's.
    pub fn folder(&self) -> &Path {
        self.file.parent().unwrap_or(Path::new(""))
    }
}

/// A real sample.
#[derive(Clone, Debug)]
pub struct RealSample {
    /// Unique name in the set: the image's file or the key in its tar, with that of the unit where needed.
    pub key: String,
    /// Number of its unit.
    pub unit: usize,
    /// File of the image, relative to the unit's images folder, with `/` between folders; for tars the key.
    pub image: String,
    /// File of the image, relative to the set's folder; empty for tars.
    pub path: PathBuf,
    /// Whether its label has `\` between folders.
    pub has_backslashes: bool,
    /// Range of its label in the unit's text; empty for tars.
    pub text: Range<usize>,
    /// Number of its split in [`RealDataset::splits`].
    pub split: usize,
    /// Facts of its label.
    pub facts: LabelFacts,
}

impl RealSample {
    /// Creates a sample of which only the image is known.
    fn from_image(unit: usize, image: &str) -> Self {
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

impl RealDataset {
    /// Returns the text of a sample's label in a table.
    pub fn label_text(&self, real: &RealSample) -> &str {
        self.sources.get(real.unit).map_or("", |source| &source.text[real.text.clone()])
    }

    /// Returns a mistake in a sample's label, at its place if that is a row.
    pub fn label_problem(&self, real: &RealSample, message: impl Into<String>) -> Diagnostic {
        match self.layout {
            InputLayout::Tables => Diagnostic::new(message).at(table::place_of_row(
                real.unit,
                &self.sources[real.unit].text,
                real.text.start,
            )),
            _ => Diagnostic::new(format!("{}: {}", self.sample_name(real), message.into())),
        }
    }

    /// Returns a sample's name for messages.
    pub fn sample_name(&self, real: &RealSample) -> String {
        match self.layout {
            InputLayout::Tars => format!("{}: {}", self.root.join(&self.units[real.unit].file).display(), real.image),
            _ => self.image_path(real).display().to_string(),
        }
    }

    /// Returns the path of a sample's image, unless it is in a tar.
    pub fn image_path(&self, real: &RealSample) -> PathBuf {
        self.root.join(&real.path)
    }

    /// Reads the bytes of a sample's image.
    pub fn read_image(&self, real: &RealSample) -> Result<Vec<u8>, String> {
        if !self.in_tars() {
            return gelsim_files::input::read(&self.image_path(real), MAX_IMAGE_BYTES)
                .map_err(|error| error.to_string());
        }
        let unit = self.root.join(&self.units[real.unit].file);
        let mut found = None;
        let wanted = |head: MemberHead<'_>| {
            (head.key == real.image && head.suffix == self.image_column).then_some(MAX_MEMBER_BYTES)
        };
        archive::visit_webdataset_file(&unit, wanted, |files| {
            if files.key == real.image {
                found = files.members.into_iter().next().map(|(_, bytes)| bytes);
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        })?;
        found.ok_or_else(|| String::from("it is not there any more"))
    }

    /// Returns true for a set that Hugging Face reads as an imagefolder with metadata.
    pub fn is_imagefolder(&self) -> bool {
        self.units.iter().all(|unit| unit.file.file_stem().is_some_and(|stem| stem == "metadata"))
    }

    /// Returns true for a set in tars.
    pub fn in_tars(&self) -> bool {
        self.layout == InputLayout::Tars
    }

    /// Returns true for images whose folders are labels.
    pub fn in_class_folders(&self) -> bool {
        matches!(self.layout, InputLayout::ClassFolders(_))
    }
}

/// State while the units of a set are read.
struct DatasetDraft<'a> {
    root: &'a Path,
    layout: InputLayout,
    written: &'a config::Input,
    units: Vec<InputUnit>,
    reals: Vec<RealSample>,
    /// Split of each sample as its label says.
    label_splits: Vec<Option<String>>,
    sources: Vec<SourceText>,
    image_column: Option<String>,
    label_suffix: String,
    columns: Option<ColumnMap>,
    example: serde_json::Map<String, serde_json::Value>,
    class_numbers: BTreeMap<String, u64>,
    suffixes: Vec<String>,
    annotations: Vec<CocoAnnotations>,
    /// Images that COCO annotations name.
    paths: HashSet<PathBuf>,
    /// Size of each image.
    sizes: Vec<Result<[usize; 2], String>>,
    /// Mistakes in the set itself.
    problems: Diagnostics,
    /// What is left out of the set.
    notes: Diagnostics,
}

/// Reads the real dataset that `written` names. Mistakes in it are returned as a report, mistakes in the keys go to
/// `check`. No set after a mistake.
pub fn read(
    check: &mut JobChecker<'_>,
    written: &config::Input,
    notes: &mut Diagnostics,
) -> (Option<RealDataset>, Report) {
    let Some(find::FoundDataset { root, layout, units, files }) = find::find_units(check, written) else {
        return (None, Report::default());
    };
    let mut draft = DatasetDraft {
        root: &root,
        layout,
        written,
        reals: Vec::new(),
        label_splits: Vec::new(),
        sources: Vec::new(),
        image_column: None,
        label_suffix: written.labels.clone().unwrap_or_else(|| String::from("json")),
        columns: None,
        example: serde_json::Map::new(),
        class_numbers: BTreeMap::new(),
        suffixes: Vec::new(),
        annotations: Vec::new(),
        paths: HashSet::new(),
        sizes: Vec::new(),
        problems: Diagnostics::default(),
        notes: Diagnostics::default(),
        units,
    };
    if layout == InputLayout::Tars && written.images.is_some() {
        check.report_error(
            "input.images",
            "images are in the tars",
            "leave it out; input.image says which files are images",
        );
    }
    if layout == InputLayout::Tars {
        tars::warn_of_missing_tars(&mut draft);
    }
    let mut files = Some(files);
    for unit in 0..draft.units.len() {
        let first = draft.reals.len();
        let read = match layout {
            InputLayout::Tables => table::read(check, &mut draft, unit),
            InputLayout::ClassFolders(_) => folders::read(check, &mut draft, files.take().unwrap_or_default()),
            InputLayout::Coco => coco::read(check, &mut draft, unit),
            InputLayout::Tars => tars::read(check, &mut draft, unit),
        };
        draft.units[unit].reals = first..draft.reals.len();
        if read.is_none() {
            break;
        }
    }
    qualify_keys(&mut draft);
    if layout != InputLayout::Tars {
        images::warn_of_turned_files(&mut draft);
    }
    let size = find_common_image_size(&mut draft);
    let DatasetDraft {
        units,
        mut reals,
        label_splits: named,
        sources,
        image_column: image,
        label_suffix: label,
        columns,
        example,
        class_numbers,
        suffixes,
        problems: found,
        ..
    } = draft;
    let (layout, annotations) = (draft.layout, draft.annotations);
    notes.extend(draft.notes);
    if found.is_empty() && check.problems.is_empty() && reals.is_empty() {
        let help = "write a row for each image, or name another folder: one with labelled images";
        check.report_error("input.path", format!("{} holds no sample", root.display()), help);
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
    let set = RealDataset {
        root,
        layout,
        units,
        reals,
        splits,
        split_by_unit,
        size,
        image_column: image,
        label_suffix: label,
        columns,
        example,
        class_numbers,
        sources,
        suffixes,
        annotations,
    };
    (Some(set), report)
}

/// Qualifies the names of samples with that of their unit where needed to be unique.
fn qualify_keys(draft: &mut DatasetDraft<'_>) {
    let mut known: HashMap<&str, usize> = HashMap::new();
    let shared = draft.reals.iter().any(|real| known.insert(&real.key, real.unit).is_some());
    let in_tars = draft.layout == InputLayout::Tars;
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

/// Finds the common size of all images, and reports images that have another one or cannot be read.
fn find_common_image_size(draft: &mut DatasetDraft<'_>) -> Option<[usize; 2]> {
    let sizes = std::mem::take(&mut draft.sizes);
    let size = sizes.iter().find_map(|size| size.as_ref().ok()).copied();
    // The help is found once per unit and cause, because it searches folders.
    let mut helps: HashMap<(usize, String), String> = HashMap::new();
    for (number, found) in sizes.into_iter().enumerate() {
        let real = &draft.reals[number];
        let problem = match (found, size) {
            (Err(reason), _) => {
                let images::UnreadableImage { message, cause } = images::explain_unreadable(draft, real, &reason);
                let help =
                    helps.entry((real.unit, cause.clone())).or_insert_with(|| images::help_for_image(draft, real));
                Diagnostic::new(message).about(&real.key, cause).help(help.clone())
            }
            (Ok([width, height]), Some([w, h])) if [width, height] != [w, h] => {
                let message = format!("{} is {width}x{height} px, the first image {w}x{h} px", real.key);
                let cause = format!("images have not the first one's size ({w}x{h} px)");
                let problem = Diagnostic::new(message).about(format!("{} ({width}x{height} px)", real.key), cause);
                problem.help("images of one sensor have one size: divide the set, or leave these out")
            }
            _ => continue,
        };
        let place = (draft.layout == InputLayout::Tables)
            .then(|| table::place_of_row(real.unit, &draft.sources[real.unit].text, real.text.start));
        let unit = draft.root.join(&draft.units[real.unit].file);
        let problem = match draft.layout {
            InputLayout::Tars => Diagnostic { message: format!("{}: {}", unit.display(), problem.message), ..problem },
            _ => problem.at(place),
        };
        draft.problems.push(problem);
    }
    size
}
