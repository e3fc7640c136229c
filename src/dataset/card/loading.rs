//! Python code that loads a dataset, for its card. Each snippet runs by itself in the dataset's folder.

use gelsim_job::config::output::{Container, Output};
use gelsim_job::layers::{LayerCoding, OutputLayer};

/// The kind of a dataset's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// Single presses.
    Presses,
    /// Sequences of frames.
    Sequences,
    /// One object between two fingers.
    Grips,
    /// Sequences of grips.
    GripSequences,
}

/// Returns the snippets for a dataset that has samples in `split`.
pub fn loading_snippets(output: &Output, split: &str, kind: SampleKind) -> Vec<String> {
    let fill = |text: String| text.replace("SPLIT", split);
    match (output.container, kind) {
        (Container::Tar, SampleKind::Sequences) => vec![TAR_SEQUENCES.to_owned()],
        (Container::Folder, SampleKind::Sequences) => vec![FOLDER_SEQUENCES.to_owned()],
        // A plan refuses grips in folders.
        (_, SampleKind::GripSequences) => {
            vec![
                TAR_SEQUENCES
                    .replace(".tactile.png", ".left.tactile.png")
                    .replace("[\"wrench\"]", "[\"left\"][\"wrench\"]"),
            ]
        }
        (_, SampleKind::Grips) => vec![TAR_GRIPS.to_owned(), TAR_GRIP_COLUMNS.to_owned()],
        (Container::Tar, SampleKind::Presses) => {
            vec![webdataset_snippet(output), TAR_COLUMNS.to_owned(), TAR_BATCHES.to_owned()]
        }
        (Container::Folder, SampleKind::Presses) => vec![rows_snippet(output), FOLDER_BATCHES.to_owned()],
    }
    .into_iter()
    .map(fill)
    .collect()
}

/// Returns how depth is encoded, or `None` if the dataset has no depth layer.
fn depth_coding(output: &Output) -> Option<LayerCoding> {
    output.layers.contains(&OutputLayer::Depth).then(|| OutputLayer::Depth.coding_for(output.depth_format))
}

const READ_EXR: &str = "\
def read_exr(data):  # rows and columns; with several channels a third axis, in the order of their names
    channels = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
    planes = [channels[name].pixels.astype(\"float32\") for name in sorted(channels)]
    return planes[0] if len(planes) == 1 else numpy.stack(planes, axis=-1)

";

/// Makes the snippet that reads decoded samples with WebDataset. It imports only what the dataset's layers need.
fn webdataset_snippet(output: &Output) -> String {
    let format = output.depth_format;
    let has = |ending: &str| output.layers.iter().any(|layer| layer.coding_for(format).extension() == ending);
    let mut imports = vec!["import glob"];
    let (mut helpers, mut handlers, mut decoders) = (String::new(), String::new(), String::from("\"rgb8\""));
    if has("exr") || has("png16") {
        imports.push("import io");
    }
    imports.extend(["import itertools", ""]);
    if has("exr") || has("png16") {
        imports.push("import numpy");
    }
    if has("exr") {
        imports.push("import OpenEXR  # 3.5 or later");
        helpers += READ_EXR;
        handlers += "exr = wds.handle_extension(\"exr\", read_exr)\n";
        decoders += ", exr";
    }
    imports.push("import webdataset as wds");
    if has("png16") {
        imports.push("from PIL import Image");
        helpers += "def read_png16(data):\n    return numpy.array(Image.open(io.BytesIO(data)))\n\n";
        handlers += "png16 = wds.handle_extension(\"png16\", read_png16)\n";
        decoders += ", png16";
    }
    let depth = match depth_coding(output) {
        None => String::new(),
        Some(coding) => format!(
            "    depth_mm = sample[\"{}\"]{}\n",
            OutputLayer::Depth.file_suffix(format),
            match coding {
                LayerCoding::Png16(scale) => format!(" * label[\"png16\"][\"{}\"]", scale.step_key()),
                _ => String::new(),
            }
        ),
    };
    let deepest = if depth.is_empty() { "" } else { ", depth_mm.shape, depth_mm.max()" };
    format!(
        "{}\n\n{helpers}\
         {handlers}shards = sorted(glob.glob(\"data/SPLIT-*.tar\"))\n\
         samples = wds.WebDataset(shards, shardshuffle=False).decode({decoders})\n\
         for sample in itertools.islice(samples, 3):\n    \
         image, label = sample[\"tactile.png\"], sample[\"json\"]\n{depth}    \
         print(sample[\"__key__\"], label[\"object\"][\"class\"], image.shape{deepest})\n",
        imports.join("\n")
    )
}

const TAR_SEQUENCES: &str = "\
import glob
import itertools

import webdataset as wds

shards = sorted(glob.glob(\"data/SPLIT-*.tar\"))
for sample in itertools.islice(wds.WebDataset(shards, shardshuffle=False).decode(\"rgb8\"), 3):
    label = sample[\"json\"]
    video = [sample[f\"f{k:04d}.tactile.png\"] for k in range(label[\"sequence\"][\"frames\"])]
    force_n = [frame[\"wrench\"][\"force_n\"] for frame in label[\"frames\"]]
    print(sample[\"__key__\"], label[\"object\"][\"class\"], len(video), video[0].shape, force_n[-1], label[\"sequence\"][\"first_slip_s\"])
";

const FOLDER_SEQUENCES: &str = "\
import os

from datasets import load_dataset

frames = load_dataset(os.getcwd(), split=\"SPLIT\")
first = frames[0]
print(first[\"key\"], first[\"frame\"][\"index\"], first[\"image\"].size, first[\"frame\"][\"wrench\"][\"force_n\"])
";

const TAR_GRIPS: &str = "\
import glob

import webdataset as wds

shards = sorted(glob.glob(\"data/SPLIT-*.tar\"))
grips = wds.WebDataset(shards, shardshuffle=False, empty_check=False).decode(\"rgb8\")
for grip in grips:
    label = grip[\"json\"]
    print(grip[\"__key__\"], label[\"gripper\"][\"force_n\"], grip[\"left.tactile.png\"].shape, grip[\"right.tactile.png\"].shape)
    break
";

const TAR_GRIP_COLUMNS: &str = "\
import os

from datasets import load_dataset

grips = load_dataset(os.getcwd(), split=\"SPLIT\")
for grip in grips.take(3):
    left, right, label = grip[\"left.tactile.png\"], grip[\"right.tactile.png\"], grip[\"json\"]
    print(grip[\"__key__\"], label[\"object\"][\"class\"], left.size, right.size, label[\"gripper\"][\"width_mm\"])
";

const TAR_COLUMNS: &str = "\
import os

from datasets import load_dataset

samples = load_dataset(os.getcwd(), split=\"SPLIT\")
for sample in samples.take(3):
    image, label = sample[\"tactile.png\"], sample[\"json\"]
    print(sample[\"__key__\"], label[\"object\"][\"class\"], image.size, label[\"contact\"][\"max_depth_mm\"])
";

const TAR_BATCHES: &str = "\
import glob

import torch
import webdataset as wds
from torch.utils.data import DataLoader

def image_and_depth(sample):
    image = torch.from_numpy(sample[\"tactile.png\"].copy()).permute(2, 0, 1)
    return image, torch.tensor(sample[\"json\"][\"contact\"][\"max_depth_mm\"])

shards = sorted(glob.glob(\"data/SPLIT-*.tar\"))
samples = wds.WebDataset(shards, shardshuffle=len(shards), empty_check=False)  # as many shards as workers, or more
batches = samples.shuffle(100).decode(\"rgb8\").map(image_and_depth).batched(8)
for images, deepest_mm in DataLoader(batches, batch_size=None, num_workers=2):
    print(images.shape, deepest_mm.max())
";

/// Makes the snippet that reads rows of metadata.jsonl with `datasets`, and each depth map from its own file.
fn rows_snippet(output: &Output) -> String {
    let (imports, read) = match depth_coding(output) {
        None => ("", String::new()),
        Some(LayerCoding::Npy) => ("import numpy\n", String::from("numpy.load(sample[\"depth_path\"])")),
        Some(LayerCoding::Png16(scale)) => (
            "import numpy\nfrom PIL import Image\n",
            format!("numpy.array(Image.open(sample[\"depth_path\"])) * sample[\"png16\"][\"{}\"]", scale.step_key()),
        ),
        Some(_) => (
            "import OpenEXR  # 3.5 or later\n",
            String::from("OpenEXR.File(sample[\"depth_path\"], separate_channels=True).channels()[\"Z\"].pixels"),
        ),
    };
    let (depth, deepest) = match read.as_str() {
        "" => (String::new(), ""),
        read => (format!("    depth_mm = {read}\n"), ", depth_mm.shape, depth_mm.max()"),
    };
    format!(
        "import os\n\n{imports}from datasets import load_dataset\n\n\
         samples = load_dataset(os.getcwd(), split=\"SPLIT\")\n\
         for sample in samples.take(3):\n{depth}    \
         print(sample[\"key\"], sample[\"object\"][\"class\"], sample[\"image\"].size{deepest})\n"
    )
}

const FOLDER_BATCHES: &str = "\
import os

import numpy
import torch
from datasets import load_dataset
from torch.utils.data import DataLoader

def images_and_depths(rows):
    images = [torch.from_numpy(numpy.array(row[\"image\"])).permute(2, 0, 1) for row in rows]
    return torch.stack(images), torch.tensor([row[\"contact\"][\"max_depth_mm\"] for row in rows])

samples = load_dataset(os.getcwd(), split=\"SPLIT\")
batches = DataLoader(samples, batch_size=8, shuffle=True, num_workers=2, collate_fn=images_and_depths)
for images, deepest_mm in batches:
    print(images.shape, deepest_mm.max())
";
