"""Enlarges small "real" sets in every layout by `gelsim augment`, and loads the outputs as their users do.

    python augmented.py GELSIM              from the project's root
"""

import collections
import csv
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

cache = tempfile.TemporaryDirectory()
os.environ |= {"HF_HOME": cache.name, "HF_HUB_OFFLINE": "1", "HF_DATASETS_DISABLE_PROGRESS_BARS": "1"}

import webdataset as wds
from datasets import load_dataset
from PIL import Image

gelsim, project = Path(sys.argv[1]).resolve(), Path.cwd()
SPLITS = {"train": 18, "test": 6}
EXPECTED = {"train": {"real": 1, "photometric": 2, "twin": 1, "synthetic": 1}, "test": {"real": 1}}

JOB = """
sensor.resolution_px = [96, 72]
indentation.depth_mm = [0.3, 1.0]
pose = { x_mm = [-3.0, 3.0], y_mm = [-2.0, 2.0], anchor = "origin" }
output.layers = ["depth"]
"""
JOB += f"object = [{{ path = {json.dumps(str(project / 'objects/sphere.obj'))} }}, " \
       f"{{ path = {json.dumps(str(project / 'objects/gear.obj'))} }}]\n"
REAL = 'dataset = { name = "real", samples = 24, samples_per_shard = 5, splits = { train = 0.75, test = 0.25 } }\n' + JOB
NEW = 'dataset = { name = "new", samples = 1, seed = 5 }\n' + JOB
RECIPE = """
[input]
path = "REAL"
background = "rendered"
[[photometric]]
copies = 2
exposure_ev = [-0.3, 0.3]
[paired]
[mixing]
job = "new.toml"
toward = "coverage"
"""
RECIPE += "".join(f"[[object]]\npath = {json.dumps(str(project / 'objects' / name))}\n" for name in
                  ["sphere.obj", "gear.obj"])


def run(root, *arguments):
    subprocess.run([gelsim, *map(str, arguments), "--quiet"], cwd=root, check=True)


def augment(root, real):
    (root / "augment.toml").write_text(RECIPE.replace("REAL", real))
    out = root / f"larger-{real}"
    run(root, "augment", "augment.toml", "--out", out)
    return out


def check(what, labels, split):
    """As many of each source as asked for, for training alone, and each traced to a real one of the same split."""
    labels = list(labels)
    counts = collections.Counter(label["source"] for label in labels)
    assert counts == {source: times * SPLITS[split] for source, times in EXPECTED[split].items()}, (what, split, counts)
    keys = {label["source_key"] for label in labels if label["source"] in ("photometric", "twin")}
    assert len(keys) == (SPLITS[split] if split == "train" else 0), (what, split, keys)
    for label in labels:
        assert (label["augmentation"] == "") == (label["source"] == "real")
        assert label["source"] == "real" or json.loads(label["augmentation"])


def tars(root):
    run(root, "generate", "real.toml", "--out", root / "tars")
    out = augment(root, "tars")
    for split in SPLITS:
        files = sorted(str(path) for path in (out / "data").glob(f"{split}-*.tar"))
        samples = list(wds.WebDataset(files, shardshuffle=False).decode("rgb8"))
        check("webdataset", (sample["json"] for sample in samples), split)
        assert all(sample["tactile.png"].shape == (72, 96, 3) and "depth.exr" in sample for sample in samples)
    dataset = load_dataset(str(out))
    for split in SPLITS:
        check("datasets, tars", (row["json"] for row in dataset[split]), split)
        assert all(row["tactile.png"].size == (96, 72) for row in dataset[split])


def folders(root):
    run(root, "generate", "real.toml", "--out", root / "folders", "--set", 'output.container="folder"')
    out = augment(root, "folders")
    dataset = load_dataset(str(out))
    for split in SPLITS:
        check("datasets, folders", dataset[split], split)
        assert all(row["image"].size == (96, 72) for row in dataset[split])
        assert all((out / row["depth_path"]).is_file() for row in dataset[split])


def table(root):
    """A folder of images with a table: made of the tars, with a column of its user's."""
    real = root / "table"
    (real / "images").mkdir(parents=True)
    rows = []
    for split in SPLITS:
        files = sorted(str(path) for path in (root / "tars/data").glob(f"{split}-*.tar"))
        for sample in wds.WebDataset(files, shardshuffle=False):
            label = json.loads(sample["json"])
            name = f"images/{label['key']}.png"
            (real / name).write_bytes(sample["tactile.png"])
            x, y, _ = label["pose"]["translation_mm"]
            rows.append({"file": name, "who": "Ann, B.", "object": label["object"]["id"], "split": split,
                         "depth_mm": label["indentation_depth_mm"], "x_mm": x, "y_mm": y})
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0].keys())
    writer.writeheader()
    writer.writerows(rows)
    (real / "labels.csv").write_text(text.getvalue())
    out = augment(root, "table")
    found = list(csv.DictReader(open(out / "labels.csv")))
    for split in SPLITS:
        check("csv", (row for row in found if row["split"] == split), split)
    reals = [row for row in found if row["source"] == "real"]
    assert [{name: row[name] for name in rows[0]} for row in reals] == [{k: str(v) for k, v in row.items()} for row in rows]
    for row in found:
        assert Image.open(out / row["file"]).size == (96, 72)
        assert (row["who"] == "") == (row["source"] == "synthetic")
    for row in reals:
        assert (out / row["file"]).read_bytes() == (real / row["file"]).read_bytes()


def samples(root):
    """Split, class, key and PNG of each sample of the tars."""
    for split in SPLITS:
        files = sorted(str(path) for path in (root / "tars/data").glob(f"{split}-*.tar"))
        for sample in wds.WebDataset(files, shardshuffle=False):
            label = json.loads(sample["json"])
            yield split, label["object"]["class"], label["key"], sample["tactile.png"]


def photometric(root, real):
    (root / "copies.toml").write_text(f'[input]\npath = "{real}"\n[[photometric]]\ncopies = 2\nexposure_ev = [-0.3, 0.3]\n')
    out = root / f"larger-{real}"
    run(root, "augment", "copies.toml", "--out", out)
    return out


def jpeg(png):
    out = io.BytesIO()
    Image.open(io.BytesIO(png)).save(out, "JPEG", quality=95)
    return out.getvalue()


def class_folders(root):
    """A folder for each split and class, JPEG: as the `datasets` library reads them, the class is the folder."""
    expected = collections.Counter()
    for split, name, key, png in samples(root):
        folder = root / "classes" / split / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{key}.jpg").write_bytes(jpeg(png))
        expected[split, name] += 3 if split == "train" else 1
    out = photometric(root, "classes")
    dataset = load_dataset(str(out))
    found = collections.Counter()
    for split in SPLITS:
        names = dataset[split].features["label"].names
        for row in dataset[split]:
            assert row["image"].size == (96, 72)
            found[split, names[row["label"]]] += 1
    assert found == expected, (found, expected)
    rows = list(csv.DictReader(open(out / "augment.csv")))
    assert collections.Counter((row["split"], row["class"]) for row in rows) == expected
    for row in rows:
        real = root / "classes" / row["file_name"]
        assert (row["source"] == "real") == real.is_file()
        assert not real.is_file() or real.read_bytes() == (out / row["file_name"]).read_bytes()


def flat_class_folders(root):
    """A folder for each class and no splits."""
    for _, name, key, png in samples(root):
        folder = root / "flat" / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{key}.png").write_bytes(png)
    dataset = load_dataset(str(photometric(root, "flat")))
    assert len(dataset["train"]) == 72 and dataset["train"].features["label"].names == ["gear", "sphere"]


def jpeg_tars(root):
    """Tars of JPEG, as many public sets are: all samples have the same fields, and what is made is JPEG too."""
    (root / "jpegs").mkdir()
    for split in SPLITS:
        with wds.TarWriter(str(root / f"jpegs/{split}-000000.tar")) as tar:
            for of, name, key, png in samples(root):
                if of == split:
                    tar.write({"__key__": key, "jpg": jpeg(png), "json": {"class": name}})
    out = photometric(root, "jpegs")
    dataset = load_dataset(str(out))
    for split in SPLITS:
        assert len(dataset[split]) == SPLITS[split] * (3 if split == "train" else 1)
        assert all(row["jpg"].format == "JPEG" for row in dataset[split])


def coco(root):
    """COCO annotations beside their images: every image has the boxes of the one that it comes from."""
    for split in SPLITS:
        folder = root / "coco" / split
        folder.mkdir(parents=True)
        images, annotations = [], []
        for of, _, key, png in samples(root):
            if of == split:
                (folder / f"{key}.png").write_bytes(png)
                images.append({"id": len(images), "file_name": f"{key}.png", "width": 96, "height": 72})
                annotations.append({"id": len(annotations) + 1, "image_id": images[-1]["id"], "category_id": 1,
                                    "bbox": [len(images), 2, 30, 40.5], "area": 1215.0, "iscrowd": 0})
        whole = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "press"}]}
        (folder / "_annotations.coco.json").write_text(json.dumps(whole))
    out = photometric(root, "coco")
    for split in SPLITS:
        whole = json.loads((out / split / "_annotations.coco.json").read_text())
        assert len(whole["images"]) == SPLITS[split] * (3 if split == "train" else 1)
        for kind in ["images", "annotations"]:
            assert len({one["id"] for one in whole[kind]}) == len(whole["images"])
        boxes = {annotation["image_id"]: annotation["bbox"] for annotation in whole["annotations"]}
        real = {f"{split}/{image['file_name']}": image["id"] for image in whole["images"] if image["source"] == "real"}
        for image in whole["images"]:
            with Image.open(out / split / image["file_name"]) as picture:
                assert picture.size == (image["width"], image["height"])
            if image["source"] != "real":
                assert boxes[image["id"]] == boxes[real[image["source_key"]]]


with tempfile.TemporaryDirectory() as root:
    root = Path(root)
    (root / "real.toml").write_text(REAL)
    (root / "new.toml").write_text(NEW)
    tars(root)
    folders(root)
    table(root)
    class_folders(root)
    flat_class_folders(root)
    jpeg_tars(root)
    coco(root)
print("augmented sets of every layout are read by webdataset, datasets and csv")
