//! Recognises layouts of datasets that are not read by what is in their folders, and says how to convert them.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::names::lowercase_ending;
use gelsim_files::input;

/// Largest file that is read to recognise a dataset, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Describes a folder in a layout that is not read, to follow "is", and what to do; `None` for any other folder.
pub fn recognise_dataset(root: &Path) -> Option<(String, String)> {
    let json = |name: &str| -> Option<Value> {
        serde_json::from_slice(&input::read_if_exists(&root.join(name), MAX_BYTES).ok()??).ok()
    };
    if json("meta/info.json").is_some_and(|info| info["codebase_version"].is_string()) {
        let own = json("meta/gelsim.json");
        return Some(describe_copy("a LeRobot dataset", "Parquet or videos", own.as_ref()));
    }
    if let Some(group) = json("zarr.json").or_else(|| json(".zattrs")).or_else(|| json(".zgroup")) {
        let own = group.pointer("/attributes/gelsim").or_else(|| group.get("gelsim"));
        return Some(describe_copy("a Zarr store", "arrays", own));
    }
    if ["state.json", "dataset_dict.json"].iter().any(|name| root.join(name).is_file())
        && json("state.json").is_none_or(|state| state["_data_files"].is_array())
    {
        let help = "save its images as files, and its other columns as metadata.jsonl with their names in the column \
                    file_name (Hugging Face calls this an imagefolder)";
        return Some((String::from("a dataset that Hugging Face's save_to_disk wrote (Arrow)"), String::from(help)));
    }
    None
}

/// Describes a copy in another program's layout; `own` is what `gelsim-export` wrote about the original dataset.
fn describe_copy(what: &str, holds: &str, own: Option<&Value>) -> (String, String) {
    match own.and_then(|own| own["name"].as_str()) {
        Some(name) => (
            format!("{what}, a copy that gelsim-export made of the dataset {name:?}"),
            format!("name the folder of that dataset: the copy's images are in {holds}, its own are files"),
        ),
        None => (
            format!("{what}: its images are in {holds}"),
            String::from(
                "save its images as files, and its labels as a table: labels.csv with their names in the column file_name",
            ),
        ),
    }
}

/// Describes annotations that are not read, to follow "has", and what to do.
pub fn recognise_annotations(root: &Path) -> Option<(String, String)> {
    let help = "export them as COCO, which is read: labelling programs and Roboflow write it; or write a table of labels \
                without boxes";
    let folders = ["", "train", "valid", "val", "test"].map(|folder| root.join(folder));
    let holds = |name: &str, kind: &str| {
        let mut folders = folders.iter().map(|folder| folder.join(name)).filter(|folder| folder.is_dir());
        folders.any(|folder| holds_kind(&folder, kind))
    };
    let yaml = ["data.yaml", "data.yml", "dataset.yaml"].iter().any(|name| root.join(name).is_file());
    if holds("labels", "txt") || yaml && holds("", "txt") {
        return Some((String::from("annotations in the form of YOLO (labels/NAME.txt)"), String::from(help)));
    }
    if holds("Annotations", "xml") || holds("annotations", "xml") || holds("", "xml") {
        return Some((String::from("annotations in the form of Pascal VOC (NAME.xml)"), String::from(help)));
    }
    None
}

/// Returns true if a folder, or a folder in it, holds a file of a kind.
fn holds_kind(folder: &Path, kind: &str) -> bool {
    /// Most entries that are examined.
    const MAX_ENTRIES: usize = 2000;
    let Ok(entries) = fs::read_dir(folder) else { return false };
    let paths: Vec<PathBuf> = entries.take(MAX_ENTRIES).filter_map(|entry| Some(entry.ok()?.path())).collect();
    let named = |path: &Path| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        lowercase_ending(path) == kind
            && !["readme", "classes", "license", "count", "requirements"].contains(&name.as_str())
    };
    paths.iter().any(|path| named(path))
        || paths.iter().filter(|path| path.is_dir()).any(|folder| {
            fs::read_dir(folder)
                .is_ok_and(|entries| entries.take(MAX_ENTRIES).flatten().any(|entry| named(&entry.path())))
        })
}

/// Endings of files that may hold images, what they are, and what to do.
const KINDS: [(&[&str], &str, &str); 7] = [
    (&["parquet", "arrow", "feather"], "Parquet or Arrow tables", "save the images in them as files, with a table"),
    (&["h5", "hdf5", "mat"], "HDF5 files", "save the images in them as PNG, with a table of labels"),
    (
        &["npy", "npz"],
        "NumPy arrays",
        "save each image as PNG (PIL.Image.fromarray(a).save(..)), with a table of labels",
    ),
    (&["pkl", "pickle", "pt", "pth"], "Python pickles", "save the images in them as PNG, with a table of labels"),
    (&["tfrecord", "tfrecords"], "TFRecords", "save the images in them as PNG, with a table of labels"),
    (&["mp4", "avi", "mov", "mkv", "webm"], "videos", "save their frames as PNG: ffmpeg -i press.mp4 press/%04d.png"),
    (&["zip", "gz", "tgz", "bz2", "xz", "zst", "7z", "rar"], "archives", "unpack them"),
];

/// Describes the most frequent kind of files that hold images but are not read.
pub fn recognise_files(files: &[PathBuf]) -> Option<(&'static str, String)> {
    let count =
        |endings: &[&str]| files.iter().filter(|file| endings.contains(&lowercase_ending(file).as_str())).count();
    let kinds = KINDS.iter().map(|(endings, what, help)| (count(endings), what, help));
    let (count, what, help) = kinds.max_by_key(|(count, ..)| *count)?;
    (count > 0).then(|| (*what, (*help).to_owned()))
}
