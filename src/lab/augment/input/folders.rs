//! Images without a table, in a folder for each class, in a folder for each split, or in one folder, as torchvision and
//! Hugging Face read them.
//!
//! What the folders say becomes a table with a row for each image, its class and its split. The output has this table
//! as a file, which also says where each sample comes from, because file names have no room for it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use csv::{StringRecord, WriterBuilder};
use rayon::prelude::*;

use super::columns::{ColumnMap, LabelFacts, SourceLabel, TableHeader};
use super::names::{is_split, lowercase_ending};
use super::{DatasetDraft, InputLayout, LabelFormat, RealSample};
use gelsim_files::csv_table;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file;
use gelsim_files::input::may_be_file;
use gelsim_files::source::SourceText;
use gelsim_job::plan::check::JobChecker;

/// Name of the table in the output.
pub const TABLE_NAME: &str = "augment.csv";
/// Column of the image's file.
const IMAGE_COLUMN: &str = "file_name";
/// Column of the class.
const CLASS_COLUMN: &str = "class";
/// Column of the split.
const SPLIT_COLUMN: &str = "split";
/// Endings of picture formats that are not read.
const UNREAD_ENDINGS: [&str; 12] =
    ["gif", "heic", "heif", "avif", "exr", "npy", "npz", "raw", "ppm", "pgm", "tga", "jp2"];

/// Files in the folder of a set.
#[derive(Default)]
pub struct FolderFiles {
    /// Images, relative to the folder.
    pub images: Vec<PathBuf>,
    /// Other files, relative to the folder.
    pub others: Vec<PathBuf>,
    /// Links to folders, which are not followed.
    pub links: Vec<PathBuf>,
}

/// What the folders of a set mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FolderKind {
    /// The outermost folders are splits.
    pub are_splits: bool,
    /// The folders below are classes.
    pub are_classes: bool,
    /// Images of different splits have the same name.
    pub repeat_names: bool,
}

/// What an image's folders say about it.
struct ImageFolders<'a> {
    split: Option<&'a str>,
    class: Option<&'a str>,
    /// Number of folders below that of the class.
    deeper: usize,
}

impl<'a> ImageFolders<'a> {
    fn from_path(image: &'a Path) -> Self {
        let folders = image.parent().unwrap_or(Path::new("")).iter();
        let mut folders: Vec<&str> = folders.map(|name| name.to_str().unwrap_or_default()).collect();
        let split = folders.first().copied().filter(|name| is_split(name));
        if split.is_some() {
            folders.remove(0);
        }
        Self { split, class: folders.first().copied(), deeper: folders.len().saturating_sub(1) }
    }

    /// Key of the arrangement of folders: equal for images that are arranged alike.
    fn layout_key(&self) -> (bool, bool, usize) {
        (self.split.is_some(), self.class.is_some(), self.deeper)
    }
}

/// Returns the path of an image without the folder of its split.
pub fn without_split(image: &Path) -> PathBuf {
    let first = image.iter().next().and_then(|name| name.to_str());
    let divided = image.iter().count() > 1 && first.is_some_and(is_split);
    image.iter().skip(usize::from(divided)).collect()
}

/// Reads the images of a draft without a table. `None` after a mistake that leaves nothing more to check.
pub(super) fn read(check: &mut JobChecker<'_>, draft: &mut DatasetDraft<'_>, files: FolderFiles) -> Option<()> {
    for (key, written) in [("input.image", &draft.written.image), ("input.images", &draft.written.images)] {
        if written.is_some() {
            check.report_error(
                key,
                "no table is there that names images",
                "leave it out: all images in the folder are taken",
            );
        }
    }
    let known_output = ["augment.json", TABLE_NAME].iter().any(|name| draft.root.join(name).is_file());
    if known_output {
        let message = format!("{} is an output of gelsim augment already", draft.root.display());
        let help = "name the dataset that it was made of: what was made of it would count as real; or remove augment.json and \
                    augment.csv from it, if that is wanted";
        check.report_error("input.path", message, help);
        return None;
    }
    let images = select_samples(check, draft, files.images)?;
    note_unread_files(draft, &images, &files.others, &files.links);
    let folders: Vec<ImageFolders<'_>> = images.iter().map(|image| ImageFolders::from_path(image)).collect();
    let (has_class, has_split) = (folders.iter().any(|f| f.class.is_some()), folders.iter().any(|f| f.split.is_some()));
    let mut moved = HashSet::new();
    let repeat_names = !images.iter().all(|image| moved.insert(without_split(image)));
    draft.layout =
        InputLayout::ClassFolders(FolderKind { are_splits: has_split, are_classes: has_class, repeat_names });

    let columns = [(IMAGE_COLUMN, true), (CLASS_COLUMN, has_class), (SPLIT_COLUMN, has_split)];
    let names: Vec<String> = columns.iter().filter(|(_, used)| *used).map(|(name, _)| (*name).to_owned()).collect();
    let mut text = encode_csv_record(names.iter().map(String::as_str));
    let header = TableHeader::new(names.clone()).ok()?;
    let none = StringRecord::new();
    let map = ColumnMap::resolve_columns(check, &draft.written.columns, &SourceLabel::Cells(&header, &none));
    for (image, folders) in images.iter().zip(&folders) {
        let name = image.to_str().unwrap_or_default();
        let cells = [
            (name, true),
            (folders.class.unwrap_or_default(), has_class),
            (folders.split.unwrap_or_default(), has_split),
        ];
        let row = encode_csv_record(cells.iter().filter(|(_, used)| *used).map(|(cell, _)| *cell));
        let start = text.len();
        text += &row;
        let cells = csv_table::iter_rows(&row).next().map(|row| row.cells).unwrap_or_default();
        let (facts, split) = LabelFacts::read(&map, &SourceLabel::Cells(&header, &cells), |_| {});
        draft.reals.push(RealSample {
            key: name.to_owned(),
            unit: 0,
            image: name.to_owned(),
            path: image.clone(),
            has_backslashes: false,
            text: start..text.len(),
            split: 0,
            facts,
        });
        draft.label_splits.push(split);
    }
    let root = draft.root;
    draft
        .sizes
        .extend(images.par_iter().map(|image| image_file::read_size_of_file(&root.join(image))).collect::<Vec<_>>());
    draft.units[0].form = LabelFormat::Csv(names);
    draft.sources.push(SourceText { name: root.display().to_string(), text, folder: root.to_owned() });
    draft.image_column = Some(String::from(IMAGE_COLUMN));
    draft.columns = Some(map);
    Some(())
}

/// Selects the images that are samples. `None` after a mistake. Unless the file says that folders are classes, all
/// images must be arranged alike.
fn select_samples(
    check: &mut JobChecker<'_>,
    draft: &mut DatasetDraft<'_>,
    images: Vec<PathBuf>,
) -> Option<Vec<PathBuf>> {
    let background = find_background(check, draft);
    let alone = |image: &Path| images.iter().filter(|other| other.parent() == image.parent()).count() == 1;
    let is_background = |image: &Path| {
        let named_so = background.as_deref().and_then(Path::file_name) == image.file_name();
        let is_it = named_so && draft.root.join(image).canonicalize().ok() == background;
        is_it && (image.iter().count() == 1 || alone(image))
    };
    let images: Vec<PathBuf> = match &background {
        None => images,
        Some(_) => images.iter().filter(|image| !is_background(image)).cloned().collect(),
    };
    let in_folders = images.iter().any(|image| image.iter().count() > 1);
    let (images, outside): (Vec<PathBuf>, Vec<PathBuf>) =
        images.into_iter().partition(|image| !in_folders || image.iter().count() > 1);
    for image in outside {
        let name = image.display().to_string();
        let note = Diagnostic::note(format!("{name} is in no folder of a class, and is left out"));
        let note = note.about(name, "images are in no folder of a class, and are left out");
        draft.notes.push(note.help("move them into the folder of their class, or out of the input"));
    }
    let Some(first) = images.first() else {
        let message = format!("{} holds no image but the background", draft.root.display());
        check.report_error("input.path", message, "name the folder with the images");
        return None;
    };
    if draft.written.labels.is_some() {
        return Some(images);
    }
    let form = ImageFolders::from_path(first).layout_key();
    let explicit = "say labels = \"folders\" under [input] to take the first folder (below that of a split) as the class, or \
                    name a table of labels with input.labels";
    if let Some(deep) = images.iter().find(|image| ImageFolders::from_path(image).deeper > 0) {
        let message = format!("which of the folders of {} is its class is not known", deep.display());
        check.report_error("input.path", message, explicit);
        return None;
    }
    if let Some(other) = images.iter().find(|image| ImageFolders::from_path(image).layout_key() != form) {
        let message = format!("folders lie differently: {} and {}", first.display(), other.display());
        let help = format!("put all images into folders like train/CLASS or all into CLASS; or {explicit}");
        check.report_error("input.path", message, help);
        return None;
    }
    Some(images)
}

/// Finds the picture of the untouched pad, if the file names one: it is no sample.
fn find_background(check: &JobChecker<'_>, draft: &DatasetDraft<'_>) -> Option<PathBuf> {
    let name = draft.written.background.as_ref()?;
    let (beside, inside) = (check.document.folder_of("input.background").join(name), draft.root.join(name));
    let path = if beside.is_file() { beside } else { inside };
    may_be_file(&path).then(|| path.canonicalize().ok()).flatten()
}

/// Notes files that belong to samples by their names but are not read.
fn note_unread_files(draft: &mut DatasetDraft<'_>, images: &[PathBuf], others: &[PathBuf], links: &[PathBuf]) {
    let stems: HashSet<PathBuf> = images.iter().map(|image| image.with_extension("")).collect();
    let folders: HashSet<&Path> = images.iter().filter_map(|image| image.parent()).collect();
    for other in others {
        let name = other.display().to_string();
        let picture = UNREAD_ENDINGS.contains(&lowercase_ending(other).as_str());
        if stems.contains(&other.with_extension("")) {
            let note = Diagnostic::note(format!("{name} belongs to an image by its name, and is not in the output"));
            let note = note.about(name, "files belong to images by their names, and are not in the output");
            draft.notes.push(
                note.help("write a table labels.csv with a column file_name and one for these files to keep them"),
            );
        } else if picture && other.parent().is_some_and(|folder| folders.contains(folder) || folder != Path::new("")) {
            let warning = Diagnostic::warning(format!("{name} is a picture that is not read, and is left out"));
            let warning = warning.about(name, "pictures are of a kind that is not read, and are left out");
            draft.notes.push(
                warning
                    .help(format!("save them as PNG to have them in the set ({} are read)", image_file::FORMAT_NAMES)),
            );
        }
    }
    for link in links {
        let name = link.strip_prefix(draft.root).unwrap_or(link).display().to_string();
        let warning = Diagnostic::warning(format!("{name} is a link to a folder, and is left out"));
        let warning = warning.about(name, "links to folders are left out");
        draft.notes.push(warning.help("put the folder itself there: links may lead in circles"));
    }
}

fn encode_csv_record<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    let mut writer = WriterBuilder::new().from_writer(Vec::new());
    writer.write_record(cells).expect("memory takes what is written");
    String::from_utf8(writer.into_inner().expect("memory takes what is written")).expect("cells are UTF-8")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_a_split_and_a_class() {
        for (image, split, class, deeper, rest) in [
            ("ball/0.png", None, Some("ball"), 0, "ball/0.png"),
            ("train/ball/0.png", Some("train"), Some("ball"), 0, "ball/0.png"),
            ("Test/0.png", Some("Test"), None, 0, "0.png"),
            ("test_tube/0.png", None, Some("test_tube"), 0, "test_tube/0.png"),
            ("ball/day 1/0.png", None, Some("ball"), 1, "ball/day 1/0.png"),
            ("0.png", None, None, 0, "0.png"),
        ] {
            let found = ImageFolders::from_path(Path::new(image));
            assert_eq!((found.split, found.class, found.deeper), (split, class, deeper), "{image}");
            assert_eq!(without_split(Path::new(image)), Path::new(rest), "{image}");
        }
    }
}
