//! Images without a table in a folder for each class, in a folder for each split or without: as torchvision and Hugging Face
//! read them.
//!
//! What the folders say becomes a table: a row for each image with its class and split. The output has that table as a file,
//! with where each sample comes from, because names of files have no room for it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use csv::{StringRecord, WriterBuilder};
use rayon::prelude::*;

use super::columns::{ColumnMap, Header, LabelFacts, SourceLabel};
use super::names::{ending, is_split};
use super::{Draft, Form, Layout, Real};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file;
use gelsim_files::input::may_be_file;
use gelsim_files::rows;
use gelsim_files::source::Source;
use gelsim_job::plan::check::Check;

/// The table's file, in the output.
pub const TABLE: &str = "augment.csv";
/// Its column of the image.
const IMAGE: &str = "file_name";
/// Its column of the class.
const CLASS: &str = "class";
/// Its column of the split.
const SPLIT: &str = "split";
/// Endings of pictures that are not read.
const UNREAD: [&str; 12] = ["gif", "heic", "heif", "avif", "exr", "npy", "npz", "raw", "ppm", "pgm", "tga", "jp2"];

/// Files in the folder of a set.
#[derive(Default)]
pub struct Files {
    /// Images, from the folder.
    pub images: Vec<PathBuf>,
    /// Other files, from the folder.
    pub others: Vec<PathBuf>,
    /// Links to folders, whose files are not among these.
    pub links: Vec<PathBuf>,
}

/// What the folders of a set are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FolderKind {
    /// The first ones are splits.
    pub are_splits: bool,
    /// Those below are classes.
    pub are_classes: bool,
    /// Images of several splits have one name, apart from the split.
    pub repeat_names: bool,
}

/// What the folders of an image say of it.
struct Folders<'a> {
    split: Option<&'a str>,
    class: Option<&'a str>,
    /// Folders below that of the class.
    deeper: usize,
}

impl<'a> Folders<'a> {
    fn of(image: &'a Path) -> Self {
        let folders = image.parent().unwrap_or(Path::new("")).iter();
        let mut folders: Vec<&str> = folders.map(|name| name.to_str().unwrap_or_default()).collect();
        let split = folders.first().copied().filter(|name| is_split(name));
        if split.is_some() {
            folders.remove(0);
        }
        Self { split, class: folders.first().copied(), deeper: folders.len().saturating_sub(1) }
    }

    /// Which of the layouts of folders it is in.
    fn form(&self) -> (bool, bool, usize) {
        (self.split.is_some(), self.class.is_some(), self.deeper)
    }
}

/// The path of an image without the folder of its split.
pub fn without_split(image: &Path) -> PathBuf {
    let first = image.iter().next().and_then(|name| name.to_str());
    let divided = image.iter().count() > 1 && first.is_some_and(is_split);
    image.iter().skip(usize::from(divided)).collect()
}

/// Reads the images of a draft that has no table. `None` if nothing more can be said after a mistake.
pub(super) fn read(check: &mut Check<'_>, draft: &mut Draft<'_>, files: Files) -> Option<()> {
    for (key, written) in [("input.image", &draft.written.image), ("input.images", &draft.written.images)] {
        if written.is_some() {
            check.error(key, "no table is there that names images", "leave it out: all images in the folder are taken");
        }
    }
    let known_output = ["augment.json", TABLE].iter().any(|name| draft.root.join(name).is_file());
    if known_output {
        let message = format!("{} is an output of gelsim augment already", draft.root.display());
        let help = "name the dataset that it was made of: what was made of it would count as real; or remove augment.json and \
                    augment.csv from it, if that is wanted";
        check.error("input.path", message, help);
        return None;
    }
    let images = samples(check, draft, files.images)?;
    say_what_is_left_out(draft, &images, &files.others, &files.links);
    let folders: Vec<Folders<'_>> = images.iter().map(|image| Folders::of(image)).collect();
    let (has_class, has_split) = (folders.iter().any(|f| f.class.is_some()), folders.iter().any(|f| f.split.is_some()));
    let mut moved = HashSet::new();
    let repeat_names = !images.iter().all(|image| moved.insert(without_split(image)));
    draft.layout = Layout::ClassFolders(FolderKind { are_splits: has_split, are_classes: has_class, repeat_names });

    let columns = [(IMAGE, true), (CLASS, has_class), (SPLIT, has_split)];
    let names: Vec<String> = columns.iter().filter(|(_, there)| *there).map(|(name, _)| (*name).to_owned()).collect();
    let mut text = record(names.iter().map(String::as_str));
    let header = Header::new(names.clone()).ok()?;
    let none = StringRecord::new();
    let map = ColumnMap::find(check, &draft.written.columns, &SourceLabel::Cells(&header, &none));
    for (image, folders) in images.iter().zip(&folders) {
        let name = image.to_str().unwrap_or_default();
        let cells = [
            (name, true),
            (folders.class.unwrap_or_default(), has_class),
            (folders.split.unwrap_or_default(), has_split),
        ];
        let row = record(cells.iter().filter(|(_, there)| *there).map(|(cell, _)| *cell));
        let start = text.len();
        text += &row;
        let cells = rows::rows(&row).next().map(|row| row.cells).unwrap_or_default();
        let (facts, split) = LabelFacts::read(&map, &SourceLabel::Cells(&header, &cells), |_| {});
        draft.reals.push(Real {
            key: name.to_owned(),
            unit: 0,
            image: name.to_owned(),
            path: image.clone(),
            has_backslashes: false,
            text: start..text.len(),
            split: 0,
            facts,
        });
        draft.named.push(split);
    }
    let root = draft.root;
    draft.sizes.extend(images.par_iter().map(|image| image_file::size_of_file(&root.join(image))).collect::<Vec<_>>());
    draft.units[0].form = Form::Csv(names);
    draft.sources.push(Source { name: root.display().to_string(), text, folder: root.to_owned() });
    draft.image = Some(String::from(IMAGE));
    draft.columns = Some(map);
    Some(())
}

/// The images that are samples. `None` after a mistake: where nobody has said that folders are classes, their layout must be
/// plain.
fn samples(check: &mut Check<'_>, draft: &mut Draft<'_>, images: Vec<PathBuf>) -> Option<Vec<PathBuf>> {
    let background = background(check, draft);
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
        let note = note.of(name, "images are in no folder of a class, and are left out");
        draft.notes.push(note.help("move them into the folder of their class, or out of the input"));
    }
    let Some(first) = images.first() else {
        let message = format!("{} holds no image but the background", draft.root.display());
        check.error("input.path", message, "name the folder with the images");
        return None;
    };
    if draft.written.labels.is_some() {
        return Some(images);
    }
    let form = Folders::of(first).form();
    let explicit = "say labels = \"folders\" under [input] to take the first folder (below that of a split) as the class, or \
                    name a table of labels with input.labels";
    if let Some(deep) = images.iter().find(|image| Folders::of(image).deeper > 0) {
        let message = format!("which of the folders of {} is its class is not known", deep.display());
        check.error("input.path", message, explicit);
        return None;
    }
    if let Some(other) = images.iter().find(|image| Folders::of(image).form() != form) {
        let message = format!("folders lie differently: {} and {}", first.display(), other.display());
        let help = format!("put all images into folders like train/CLASS or all into CLASS; or {explicit}");
        check.error("input.path", message, help);
        return None;
    }
    Some(images)
}

/// The picture of the untouched pad, if one is named: it is no sample.
fn background(check: &Check<'_>, draft: &Draft<'_>) -> Option<PathBuf> {
    let name = draft.written.background.as_ref()?;
    let (beside, inside) = (check.document.folder("input.background").join(name), draft.root.join(name));
    let path = if beside.is_file() { beside } else { inside };
    may_be_file(&path).then(|| path.canonicalize().ok()).flatten()
}

/// Notes on files that belong to samples, by their names, and are not read.
fn say_what_is_left_out(draft: &mut Draft<'_>, images: &[PathBuf], others: &[PathBuf], links: &[PathBuf]) {
    let stems: HashSet<PathBuf> = images.iter().map(|image| image.with_extension("")).collect();
    let folders: HashSet<&Path> = images.iter().filter_map(|image| image.parent()).collect();
    for other in others {
        let name = other.display().to_string();
        let picture = UNREAD.contains(&ending(other).as_str());
        if stems.contains(&other.with_extension("")) {
            let note = Diagnostic::note(format!("{name} belongs to an image by its name, and is not in the output"));
            let note = note.of(name, "files belong to images by their names, and are not in the output");
            draft.notes.push(
                note.help("write a table labels.csv with a column file_name and one for these files to keep them"),
            );
        } else if picture && other.parent().is_some_and(|folder| folders.contains(folder) || folder != Path::new("")) {
            let warning = Diagnostic::warning(format!("{name} is a picture that is not read, and is left out"));
            let warning = warning.of(name, "pictures are of a kind that is not read, and are left out");
            draft.notes.push(
                warning.help(format!("save them as PNG to have them in the set ({} are read)", image_file::NAMES)),
            );
        }
    }
    for link in links {
        let name = link.strip_prefix(draft.root).unwrap_or(link).display().to_string();
        let warning = Diagnostic::warning(format!("{name} is a link to a folder, and is left out"));
        let warning = warning.of(name, "links to folders are left out");
        draft.notes.push(warning.help("put the folder itself there: links may lead in circles"));
    }
}

fn record<'a>(cells: impl Iterator<Item = &'a str>) -> String {
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
            let found = Folders::of(Path::new(image));
            assert_eq!((found.split, found.class, found.deeper), (split, class, deeper), "{image}");
            assert_eq!(without_split(Path::new(image)), Path::new(rest), "{image}");
        }
    }
}
