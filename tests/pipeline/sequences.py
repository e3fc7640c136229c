"""Datasets of sequences as their users load them: tars by WebDataset, folders by Hugging Face, both with the snippets of their cards as
they stand, and the Python module.

    python sequences.py GELSIM          from the project's root, where the wheel is installed
"""

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

cache = tempfile.TemporaryDirectory()
os.environ |= {"HF_HOME": cache.name, "HF_HUB_OFFLINE": "1", "HF_DATASETS_DISABLE_PROGRESS_BARS": "1"}

import gelsim
import jsonschema
import numpy
import webdataset
from datasets import load_dataset
from PIL import Image

from snippet import snippets

native = Path(sys.argv[1]).resolve()
project = Path.cwd()
schema = json.load(open(project / "docs/schema/sequence.json"))


def generate(out, *arguments):
    job = project / "configs/sequences.toml"
    small = ["--samples", "3", "--set", "sensor.resolution_px=[80, 60]", "--set", 'output.depth_format="npy"']
    subprocess.run([native, "generate", job, "--quiet", "--out", out, *small, *arguments], check=True)


def look(folder):
    """Runs the snippets of a dataset's card."""
    found = snippets(folder / "README.md")
    for code in found:
        subprocess.run([sys.executable, "-c", code], cwd=folder, check=True)
    return len(found)


def tars(folder):
    generate(folder)
    samples = {}
    for shard in sorted((folder / "data").glob("*.tar")):
        for sample in webdataset.WebDataset(str(shard), shardshuffle=False).decode("rgb8"):
            label = sample["json"]
            jsonschema.validate(label, schema)
            count = label["sequence"]["frames"]
            assert len(label["frames"]) == count == sum(phase["frames"] for phase in label["sequence"]["phases"])
            names = {f"f{k:04d}.{what}" for k in range(count) for what in
                     ["tactile.png", "contact.png", "slip.png", "flow.npy", "markers.json"]}
            assert names | {"json", "__key__", "__url__"} <= set(sample) and f"f{count:04d}.tactile.png" not in sample
            samples[sample["__key__"]] = sample
    assert len(samples) == 3
    print(f"sequences: tars: {len(samples)} samples, {look(folder)} snippet of the card")
    return samples


def folders(folder, samples):
    generate(folder, "--set", 'output.container="folder"')
    count = look(folder)
    rows = load_dataset(str(folder))
    rows = [row for split in rows.values() for row in split]
    assert len(rows) == sum(sample["json"]["sequence"]["frames"] for sample in samples.values())
    for row in rows:
        sample, number = samples[row["key"]], row["frame"]["index"]
        assert numpy.array_equal(numpy.asarray(row["image"]), sample[f"f{number:04d}.tactile.png"])
        assert row["frame"]["wrench"] == sample["json"]["frames"][number]["wrench"]
        assert row["sequence"]["first_slip_s"] == sample["json"]["sequence"]["first_slip_s"]
        flow = numpy.load(folder / row["flow_path"])
        assert flow.shape == (60, 80, 2) and flow.dtype == numpy.float32
    print(f"sequences: folders: {len(rows)} frames, {count} snippet of the card")


def module(samples, folder):
    settings = ["sensor.resolution_px=[80, 60]", 'output.depth_format="npy"']
    job = gelsim.Job.load(project / "configs/sequences.toml", samples=3, set=settings)
    members = {}
    for shard in (folder / "data").glob("*.tar"):
        with tarfile.open(shard) as tar:
            members |= {member.name: tar.extractfile(member).read() for member in tar}
    for index, ours in enumerate(job):
        key = f"{index:09}"
        assert list(ours) == ["frames", "label"] and ours["label"] == samples[key]["json"]
        for number, frame in enumerate(ours["frames"]):
            assert list(frame) == ["tactile", "contact", "markers", "slip", "flow"], list(frame)
            at = f"{key}.f{number:04d}"
            for name in ["tactile", "contact", "slip"]:
                picture = numpy.asarray(Image.open(io.BytesIO(members[f"{at}.{name}.png"])))
                assert numpy.array_equal(frame[name], picture), (at, name)
            assert numpy.array_equal(frame["flow"], numpy.load(io.BytesIO(members[f"{at}.flow.npy"])))
            assert set(numpy.unique(frame["slip"])) <= {0, 128, 255}
            assert numpy.array_equal(frame["slip"] > 0, frame["contact"] > 0)
    print(f"sequences: the module: {len(job)} samples as in the files")


with tempfile.TemporaryDirectory() as temporary:
    found = tars(Path(temporary, "tars"))
    folders(Path(temporary, "folders"), found)
    module(found, Path(temporary, "tars"))
