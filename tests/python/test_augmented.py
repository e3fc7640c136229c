"""Small "real" sets in every layout enlarged by `gelsim augment`, and loaded as their users do."""

import collections
import csv
import io
import json

import pytest

for name in ["PIL", "webdataset", "datasets"]:
    pytest.importorskip(name, reason="pip install pillow webdataset datasets")

import webdataset
from datasets import load_dataset
from PIL import Image

SPLITS = {"train": 18, "test": 6}
EXPECTED = {"train": {"real": 1, "photometric": 2, "twin": 1, "synthetic": 1}, "test": {"real": 1}}
SIZE = (96, 72)

JOB = """
sensor.resolution_px = [96, 72]
indentation.depth_mm = [0.3, 1.0]
pose = { x_mm = [-3.0, 3.0], y_mm = [-2.0, 2.0], anchor = "origin" }
output.layers = ["depth"]
object = [{ path = "OBJECTS/sphere.obj" }, { path = "OBJECTS/gear.obj" }]
"""
REAL = 'dataset = { name = "real", samples = 24, samples_per_shard = 5, splits = { train = 0.75, test = 0.25 } }' + JOB
NEW = 'dataset = { name = "new", samples = 1, seed = 5 }' + JOB
RECIPE = """
[input]
path = "REAL"
background = "rendered"
[[photometric]]
copies = 2
exposure_ev = [-0.3, 0.3]
"""
EVERY_SOURCE = RECIPE + """
[paired]
[mixing]
job = "new.toml"
toward = "coverage"
[[object]]
path = "OBJECTS/sphere.obj"
[[object]]
path = "OBJECTS/gear.obj"
"""
COPIES = RECIPE.replace('background = "rendered"\n', "")

each_split = pytest.mark.parametrize("split", SPLITS)


@pytest.fixture(scope="module")
def root(project, tmp_path_factory):
    root = tmp_path_factory.mktemp("augmented")
    for name, text in [("real", REAL), ("new", NEW)]:
        (root / f"{name}.toml").write_text(text.replace("OBJECTS", str(project / "objects")))
    return root


@pytest.fixture(scope="module")
def augment(root, run_gelsim, project):
    """Enlarges the set in a folder of `root`: the folder of the larger one."""

    def augment(real, recipe):
        (root / "augment.toml").write_text(recipe.replace("REAL", real).replace("OBJECTS", str(project / "objects")))
        run_gelsim("augment", "augment.toml", "--out", f"larger-{real}", "--quiet", cwd=root)
        return root / f"larger-{real}"

    return augment


def assert_sources(labels, split):
    """As many of each source as asked for, for training alone, and each traced to a real one of the same split."""
    labels = list(labels)
    counts = collections.Counter(label["source"] for label in labels)
    assert counts == {source: times * SPLITS[split] for source, times in EXPECTED[split].items()}
    keys = {label["source_key"] for label in labels if label["source"] in ("photometric", "twin")}
    assert len(keys) == (SPLITS[split] if split == "train" else 0)
    for label in labels:
        assert (label["augmentation"] in ("", "{}")) == (label["source"] == "real")
        assert label["source"] == "real" or json.loads(label["augmentation"])


def read_tars(folder, split):
    return webdataset.WebDataset(sorted(str(path) for path in folder.glob(f"{split}-*.tar")), shardshuffle=False)


@pytest.fixture(scope="module")
def tars(root, run_gelsim):
    """The real set as tars; the other layouts are made of it."""
    return run_gelsim.generate("real.toml", root / "tars", cwd=root)


@pytest.fixture(scope="module")
def larger_tars(tars, augment):
    return augment("tars", EVERY_SOURCE)


@each_split
def test_tars_are_read_by_webdataset(larger_tars, split):
    samples = list(read_tars(larger_tars / "data", split).decode("rgb8"))
    assert_sources((sample["json"] for sample in samples), split)
    assert all(sample["tactile.png"].shape == (72, 96, 3) and "depth.exr" in sample for sample in samples)


@each_split
def test_tars_are_read_by_datasets(larger_tars, split):
    rows = load_dataset(str(larger_tars))[split]
    assert_sources((row["json"] for row in rows), split)
    assert all(row["tactile.png"].size == SIZE for row in rows)


@pytest.fixture(scope="module")
def larger_folders(root, run_gelsim, augment):
    run_gelsim.generate("real.toml", root / "folders", "--set", 'output.container="folder"', cwd=root)
    return augment("folders", EVERY_SOURCE)


@each_split
def test_folders_are_read_by_datasets(larger_folders, split):
    rows = load_dataset(str(larger_folders))[split]
    assert_sources(rows, split)
    assert all(row["image"].size == SIZE for row in rows)
    assert all((larger_folders / row["depth_path"]).is_file() for row in rows)


@pytest.fixture(scope="module")
def reals(tars):
    """Split, label and PNG of each real sample."""
    samples = [(split, sample) for split in SPLITS for sample in read_tars(tars / "data", split)]
    return [(split, json.loads(sample["json"]), sample["tactile.png"]) for split, sample in samples]


@pytest.fixture(scope="module")
def table(root, reals, augment):
    """A folder of images with a table, and in that a user's column: folder and rows, and those of the larger one."""
    real, rows = root / "table", []
    (real / "images").mkdir(parents=True)
    for split, label, png in reals:
        name = f"images/{label['key']}.png"
        (real / name).write_bytes(png)
        x, y, _ = label["pose"]["translation_mm"]
        rows.append({"file": name, "who": "Ann, B.", "object": label["object"]["id"], "split": split,
                     "depth_mm": label["indentation_depth_mm"], "x_mm": x, "y_mm": y})  # fmt: skip
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0])
    writer.writeheader()
    writer.writerows(rows)
    (real / "labels.csv").write_text(text.getvalue())
    out = augment("table", EVERY_SOURCE)
    return real, rows, out, list(csv.DictReader(open(out / "labels.csv")))


@each_split
def test_a_table_has_a_row_for_each_image(table, split):
    _, _, _, found = table
    assert_sources((row for row in found if row["split"] == split), split)


def test_a_tables_own_rows_and_images_are_as_they_were(table):
    real, rows, out, found = table
    own = [row for row in found if row["source"] == "real"]
    known = [{name: str(value) for name, value in row.items()} for row in rows]
    assert [{name: row[name] for name in rows[0]} for row in own] == known
    for row in own:
        assert (out / row["file"]).read_bytes() == (real / row["file"]).read_bytes()


def test_a_table_names_images_of_one_size(table):
    _, _, out, found = table
    assert {Image.open(out / row["file"]).size for row in found} == {SIZE}


def test_a_users_column_is_empty_for_synthetic_images_alone(table):
    _, _, _, found = table
    assert all((row["who"] == "") == (row["source"] == "synthetic") for row in found)


def as_jpeg(png):
    out = io.BytesIO()
    Image.open(io.BytesIO(png)).save(out, "JPEG", quality=95)
    return out.getvalue()


@pytest.fixture(scope="module")
def class_folders(root, reals, augment):
    """A folder for each split and class, JPEG: the real set, the larger one, and how many images its folders have."""
    expected = collections.Counter()
    for split, label, png in reals:
        folder = root / "classes" / split / label["object"]["class"]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{label['key']}.jpg").write_bytes(as_jpeg(png))
        expected[split, label["object"]["class"]] += 3 if split == "train" else 1
    return root / "classes", augment("classes", COPIES), expected


def test_folders_of_classes_are_read_by_datasets(class_folders):
    """As it reads them, the class is the folder."""
    _, out, expected = class_folders
    found, dataset = collections.Counter(), load_dataset(str(out))
    for split in SPLITS:
        names = dataset[split].features["label"].names
        for row in dataset[split]:
            assert row["image"].size == SIZE
            found[split, names[row["label"]]] += 1
    assert found == expected


def test_folders_of_classes_have_a_table_of_what_came_of_what(class_folders):
    reals, out, expected = class_folders
    rows = list(csv.DictReader(open(out / "augment.csv")))
    assert collections.Counter((row["split"], row["class"]) for row in rows) == expected
    for row in rows:
        real = reals / row["file_name"]
        assert (row["source"] == "real") == real.is_file()
        assert not real.is_file() or real.read_bytes() == (out / row["file_name"]).read_bytes()


def test_folders_of_classes_without_splits_are_all_for_training(root, reals, augment):
    for _, label, png in reals:
        folder = root / "flat" / label["object"]["class"]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{label['key']}.png").write_bytes(png)
    rows = load_dataset(str(augment("flat", COPIES)))["train"]
    assert len(rows) == 72 and rows.features["label"].names == ["gear", "sphere"]


def test_tars_of_jpeg_stay_jpeg(root, reals, augment):
    """As many public sets are: all samples have the same fields, and what is made is JPEG too."""
    (root / "jpegs").mkdir()
    for split in SPLITS:
        with webdataset.TarWriter(str(root / f"jpegs/{split}-000000.tar")) as tar:
            for of, label, png in reals:
                if of == split:
                    known = {"class": label["object"]["class"]}
                    tar.write({"__key__": label["key"], "jpg": as_jpeg(png), "json": known})
    dataset = load_dataset(str(augment("jpegs", COPIES)))
    for split in SPLITS:
        assert len(dataset[split]) == SPLITS[split] * (3 if split == "train" else 1)
        assert all(row["jpg"].format == "JPEG" for row in dataset[split])


@pytest.fixture(scope="module")
def larger_coco(root, reals, augment):
    """COCO annotations beside their images."""
    for split in SPLITS:
        folder = root / "coco" / split
        folder.mkdir(parents=True)
        images, annotations = [], []
        for of, label, png in reals:
            if of == split:
                name = f"{label['key']}.png"
                (folder / name).write_bytes(png)
                images.append({"id": len(images), "file_name": name, "width": 96, "height": 72})
                annotations.append({"id": len(annotations) + 1, "image_id": images[-1]["id"], "category_id": 1,
                                    "bbox": [len(images), 2, 30, 40.5], "area": 1215.0, "iscrowd": 0})  # fmt: skip
        coco = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "press"}]}
        (folder / "_annotations.coco.json").write_text(json.dumps(coco))
    return augment("coco", COPIES)


@pytest.fixture
def coco(larger_coco, split):
    return json.loads((larger_coco / split / "_annotations.coco.json").read_text())


@each_split
def test_coco_has_every_image_once(coco, split):
    assert len(coco["images"]) == SPLITS[split] * (3 if split == "train" else 1)
    for kind in ["images", "annotations"]:
        assert len({one["id"] for one in coco[kind]}) == len(coco["images"])


@each_split
def test_cocos_images_have_the_size_that_is_said(larger_coco, coco, split):
    for image in coco["images"]:
        with Image.open(larger_coco / split / image["file_name"]) as picture:
            assert picture.size == (image["width"], image["height"])


@each_split
def test_cocos_images_have_the_boxes_of_what_they_come_from(coco, split):
    boxes = {annotation["image_id"]: annotation["bbox"] for annotation in coco["annotations"]}
    real = {f"{split}/{image['file_name']}": image["id"] for image in coco["images"] if image["source"] == "real"}
    for image in coco["images"]:
        if image["source"] != "real":
            assert boxes[image["id"]] == boxes[real[image["source_key"]]]
