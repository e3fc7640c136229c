"""Datasets of every kind as their users load them: by WebDataset, Hugging Face, PyTorch, and the snippets of their cards."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

datasets = pytest.importorskip("datasets", reason="no datasets: pip install datasets")
yaml = pytest.importorskip("yaml", reason="no yaml: pip install pyyaml")

import samples
from snippet import snippets

pytestmark = pytest.mark.wheel

HERE = Path(__file__).parent

# Kinds of objects, contact and none, markers and relief: labels are as mixed as they get.
MIXED = """
object = [{objects}]
sensor.resolution_px = [96, 72]
texture.amplitude_mm = {{ choice = [0.0, 0.05] }}
markers.pitch_mm = 1.5
pose = {{ yaw_deg = [0.0, 360.0]{place} }}
indentation = {{ depth_mm = [0.3, 1.0], no_contact = 0.3 }}
output.layers = ["depth", "surface", "contact", "normal", "pressure", "markers", "{last}"]
{scene}
[dataset]
name = "mixed"
samples = 24
seed = 11
samples_per_shard = 3
splits = {{ train = 0.5, val = 0.25, test = 0.25 }}
"""
ONE = {"scale": 1.0, "place": "", "last": "reference", "scene": ""}
SEVERAL = {
    "scale": 0.3,
    "place": ", x_mm = [-6.0, 6.0], y_mm = [-4.0, 4.0]",
    "last": "instance",
    "scene": "scene.objects_per_sample = [1, 3]",
}
SMALL = ["--set", "sensor.resolution_px=[160, 120]"]
BLURRED = ["--set", 'dataset.split_by="object"', "--fidelity", "paper", "--set", 'output.layers=["depth", "markers"]']
COPIES = {
    f"{container}-{form}": ["--set", f'output.container="{container}"', "--set", f'output.depth_format="{form}"']
    for container in ["tar", "folder"]
    for form in ["exr", "npy", "png16"]
}
# Each dataset: its job and flags. Of the scenes a press has one to three objects.
DATASETS = {
    "quickstart": None,
    "effects": ("configs/effects.toml", ["--samples", "6", *SMALL]),
    "blurred": ("mixed", BLURRED),
    "exact": ("mixed", ["--set", 'output.exr.pixel="float"']),
    **{name: ("mixed", flags) for name, flags in COPIES.items()},
    "scene-tar": ("scene", ["--set", 'output.container="tar"']),
    "scene-folder": ("scene", ["--set", 'output.container="folder"']),
}
SCENES = ["scene-tar", "scene-folder"]
# These are also read by several workers.
SHARED = ["quickstart", "tar-exr", "folder-exr", "scene-folder"]


@pytest.fixture(scope="module")
def made(run_gelsim, project, quickstart, tmp_path_factory):
    """Makes a dataset, once, and reads it."""
    root, found = tmp_path_factory.mktemp("load"), {}
    objects = [project / "objects" / f"{name}.obj" for name in ["sphere", "letter", "gear", "dots"]]
    for job, more in [("mixed", ONE), ("scene", SEVERAL)]:
        tables = ", ".join(f'{{ path = "{path}", scale = {more["scale"]} }}' for path in objects)
        (root / f"{job}.toml").write_text(MIXED.format(objects=tables, **more))

    def make(name):
        if name not in found:
            out = quickstart
            if name != "quickstart":
                job, flags = DATASETS[name]
                out = run_gelsim.generate(project / job if "/" in job else root / f"{job}.toml", root / name, *flags)
            manifest = json.loads((out / "dataset.json").read_text())
            read = dict(samples.read(out, manifest))
            labels = {key: sample["json"] for key, sample in read.items()}
            found[name] = SimpleNamespace(name=name, out=out, manifest=manifest, samples=read, labels=labels)
            found[name].folder = (out / manifest["shards"][0]["file"]).is_dir()
        return found[name]

    return make


@pytest.fixture(scope="module", params=DATASETS)
def dataset(made, request):
    return made(request.param)


def of(*names):
    """A test of these datasets alone."""
    return pytest.mark.parametrize("dataset", names, indirect=True)


def test_every_sample_is_read(dataset):
    assert len(dataset.samples) == dataset.manifest["samples"]


def test_layers_fit_labels_and_labels_the_schema(dataset, project):
    labels = samples.validator(project / "docs/schema/label.json")
    for key, sample in dataset.samples.items():
        samples.check(key, sample, labels)


def test_the_schema_takes_the_bundled_jobs(project):
    toml = pytest.importorskip("tomllib", reason="Python before 3.11")
    schema = samples.validator(project / "docs/schema/job.json")
    jobs = [path for path in (project / "configs").glob("*.toml") if path.name != "augment.toml"]
    assert len(jobs) > 15
    for path in jobs:
        schema.validate(toml.loads(path.read_text()))
    for text in [
        "optics.phong.shadows = 'soft'",
        "optics.led.shadows = { soft = {} }",
        "sensor.rendered_background.dust_per_cm2 = [0, 5]",
        "sensor.led = [{ pattern = { red = [[0.5, 1]], green = [1], blue = [1] } }]",
    ]:
        schema.validate(toml.loads(text))
    assert not schema.is_valid(toml.loads("optics.phong.shadows = 'sft'"))


def pinned(out):
    """The column types that the card gives."""
    front = yaml.safe_load((out / "README.md").read_text().split("---\n")[1])
    # Of folders they stand beside the files of the only configuration.
    place = front.get("dataset_info") or front["configs"][0]
    return datasets.Features._from_yaml_list(place["features"])


def test_hugging_face_loads_splits_and_types_of_the_card(dataset):
    types, loaded = pinned(dataset.out), datasets.load_dataset(str(dataset.out))
    assert {split: len(rows) for split, rows in loaded.items()} == dataset.manifest["splits"]
    for split, rows in loaded.items():
        assert rows.features == types
        for row in rows:
            key = row["key"] if dataset.folder else row["__key__"]
            label = dataset.labels[key]
            found = {name: row[name] for name in label} if dataset.folder else row["json"]
            assert found == label and label["split"] == split, key
            image = row["image"] if dataset.folder else row["tactile.png"]
            assert image.size == (found["sensor"]["width_px"], found["sensor"]["height_px"]) and image.mode == "RGB"
            for name, value in row.items():
                assert not name.endswith("_path") or os.path.isfile(dataset.out / value), value


def test_hugging_face_loads_it_without_the_card(dataset):
    splits = dataset.manifest["splits"]
    if dataset.folder:
        # Splits are known by the folders' names and get names of its own, types are guessed.
        rows = datasets.load_dataset("imagefolder", data_dir=str(dataset.out / "data"))
        names = {"val": "validation"}
        assert {names.get(split, split): count for split, count in splits.items()} == rows.num_rows
        for row in rows["train"]:
            assert row["image"].mode == "RGB" and row["contact"] == dataset.labels[row["key"]]["contact"], row["key"]
        return
    files = {split: str(dataset.out / f"data/{split}-*.tar") for split in splits}
    for types in [None, pinned(dataset.out)]:
        rows = datasets.load_dataset("webdataset", data_files=files, features=types)
        assert rows.num_rows == splits
        for row in rows["train"]:
            assert row["json"] == dataset.labels[row["__key__"]], (types, row["__key__"])


def run_all(commands, folder):
    """Runs programs, two at a time."""

    def run(command):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(run, commands))


def snippets_of_card(dataset, python, with_torch):
    """Commands that run the snippets of the card that need torch, or none."""
    card = dataset.out / "README.md"
    numbers = [number for number, code in enumerate(snippets(card)) if ("import torch" in code) == with_torch]
    assert numbers, f"{card} has no such snippet"
    return [[python, HERE / "snippet.py", card, str(number)] for number in numbers]


def test_the_snippets_of_its_card_run(dataset):
    run_all(snippets_of_card(dataset, sys.executable, with_torch=False), dataset.out)


def test_the_snippets_of_its_card_run_with_torch(dataset, torch_python):
    run_all(snippets_of_card(dataset, torch_python, with_torch=True), dataset.out)


@of(*SHARED)
def test_workers_of_torch_read_each_sample_once(dataset, torch_python):
    run_all([[torch_python, HERE / "batches.py", dataset.out, "workers"]], dataset.out)


@of(*(name for name in SHARED if "folder" not in name))
def test_the_index_of_wids_has_each_sample_once(dataset, torch_python):
    run_all([[torch_python, HERE / "batches.py", dataset.out, "wids"]], dataset.out)


@of("blurred")
def test_the_lowest_level_knows_no_forces(dataset):
    assert all(label["contact"]["force_n"] is None for label in dataset.labels.values())


@of("exact")
def test_a_part_of_the_samples_does_not_touch(dataset):
    assert {label["contact"]["in_contact"] for label in dataset.labels.values()} == {True, False}


@of(*COPIES)
def test_layers_are_the_same_in_every_container_and_format(dataset, made):
    exact = made("exact")
    assert dataset.samples.keys() == exact.samples.keys()
    for key, sample in dataset.samples.items():
        samples.same_layers(dataset.name.split("-")[1], exact.samples[key], sample)
        assert {**dataset.labels[key], "png16": None} == {**exact.labels[key], "png16": None}, key


@of(*SCENES)
def test_a_scene_has_one_to_three_objects(dataset):
    assert {len(label["objects"]) for label in dataset.labels.values()} == {1, 2, 3}


@of(*SCENES)
def test_instances_are_where_the_pad_touches(dataset):
    for key, sample in dataset.samples.items():
        contact, instance = sample["contact.png"], sample["instance.png"]
        assert ((contact > 0) == (instance > 0)).all(), key
        assert instance.max() <= len(sample["json"]["objects"]), key
