"""Makes datasets of every kind and loads them as their users do, with the snippets of README and card as they stand.

    python load.py GELSIM [PYTHON_WITH_TORCH]       from the project's root, where the wheel is installed
"""

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

cache = tempfile.TemporaryDirectory()
os.environ |= {"HF_HOME": cache.name, "HF_HUB_OFFLINE": "1", "HF_DATASETS_DISABLE_PROGRESS_BARS": "1"}
os.environ["WIDS_CACHE"] = cache.name

import hugging_face
import samples
from snippet import snippets

gelsim, torch = Path(sys.argv[1]).resolve(), sys.argv[2] if len(sys.argv) > 2 else None
project, here = Path.cwd(), Path(__file__).resolve().parent
schema = json.load(open(project / "docs/schema/label.json"))

# Kinds of objects, contact and none, markers and relief: labels are as mixed as they get.
MIXED = """
[dataset]
name = "mixed"
samples = 24
seed = 11
samples_per_shard = 3
splits = { train = 0.5, val = 0.25, test = 0.25 }
[sensor]
resolution_px = [96, 72]
"""
MIXED += "".join(f"[[object]]\npath = {json.dumps(str(project / 'objects' / name))}\n" for name in
                 ["sphere.obj", "letter.obj", "gear.obj", "dots.obj"])
MIXED += """
[texture]
amplitude_mm = { choice = [0.0, 0.05] }
[markers]
pitch_mm = 1.5
[pose]
yaw_deg = [0.0, 360.0]
[indentation]
depth_mm = [0.3, 1.0]
no_contact = 0.3
[output]
layers = ["depth", "surface", "contact", "normal", "pressure", "markers", "reference"]
"""


def generate(out, job, *arguments):
    subprocess.run([gelsim, "generate", job, "--quiet", "--out", out, *arguments], check=True)


def run(commands, folder):
    """Runs commands in `folder`, two at a time."""

    def one(command):
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert result.returncode == 0, f"{command}\n{result.stdout}\n{result.stderr}"

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(one, commands))


def in_fresh_interpreters(text):
    """Commands that run each Python snippet of a Markdown file; those with torch only where there is one."""
    pythons = [torch if "import torch" in code else sys.executable for code in snippets(text)]
    assert pythons, f"{text} has no snippet"
    return [[python, here / "snippet.py", text, str(number)] for number, python in enumerate(pythons) if python]


def check(out, workers=False):
    """Every way to read the dataset in `out`, with `workers` also several at a time. Its samples by key."""
    manifest = json.load(open(out / "dataset.json"))
    read = dict(samples.read(out, manifest))
    assert len(read) == manifest["samples"]
    for key, sample in read.items():
        samples.check(key, sample, schema)
    hugging_face.check(out, manifest, {key: sample["json"] for key, sample in read.items()})
    commands = in_fresh_interpreters(out / "README.md")
    print(f"{out.name}: {len(read)} samples, {len(commands)} snippets of the card", flush=True)
    if workers and torch:
        commands.append([torch, here / "batches.py", out])
    run(commands, out)
    return read


with tempfile.TemporaryDirectory() as root:
    root = Path(root)
    if not torch:
        print("no torch: neither DataLoader nor wids nor the snippets with them are tried")

    small = ["--set", "sensor.resolution_px=[160, 120]"]
    generate(root / "out/quickstart", project / "configs/quickstart.toml", *small)
    (root / "configs").symlink_to(project / "configs")
    run(in_fresh_interpreters(project / "README.md"), root)
    check(root / "out/quickstart", workers=True)
    generate(root / "effects", project / "configs/effects.toml", "--samples", "6", *small)
    check(root / "effects")

    job = root / "mixed.toml"
    job.write_text(MIXED)
    by_object = ["--set", 'dataset.split_by="object"', "--fidelity", "paper"]
    generate(root / "blurred", job, *by_object, "--set", 'output.layers=["depth", "markers"]')
    blurred = check(root / "blurred")
    assert all(sample["json"]["contact"]["force_n"] is None for sample in blurred.values())

    generate(root / "exact", job, "--set", 'output.exr.pixel="float"')
    exact = check(root / "exact")
    touching = {sample["json"]["contact"]["in_contact"] for sample in exact.values()}
    assert touching == {True, False}, "a job of which a part does not touch"
    for container in ["tar", "folder"]:
        for form in ["exr", "npy", "png16"]:
            out = root / f"{container}-{form}"
            generate(out, job, "--set", f'output.container="{container}"', "--set", f'output.depth_format="{form}"')
            other = check(out, workers=form == "exr")
            assert other.keys() == exact.keys()
            for key, sample in other.items():
                samples.same_layers(form, exact[key], sample)
                labels = [{**each[key]["json"], "png16": None} for each in (exact, other)]
                assert labels[0] == labels[1], key
    # Several objects in a press: lists of one to three.
    scene = root / "scene.toml"
    places = "[pose]\nx_mm = [-6.0, 6.0]\ny_mm = [-4.0, 4.0]\n"
    scene.write_text("[scene]\nobjects_per_sample = [1, 3]\n" + MIXED.replace("[pose]\n", places).replace(
        '"reference"]', '"instance"]').replace(".obj\"\n", ".obj\"\nscale = 0.3\n"))
    for container in ["tar", "folder"]:
        out = root / f"scene-{container}"
        generate(out, scene, "--set", f'output.container="{container}"')
        several = check(out, workers=container == "folder")
        counts = {len(sample["json"]["objects"]) for sample in several.values()}
        assert counts == {1, 2, 3}, counts
        for key, sample in several.items():
            contact, instance = sample["contact.png"], sample["instance.png"]
            assert ((contact > 0) == (instance > 0)).all(), key
            assert instance.max() <= len(sample["json"]["objects"]), key
print("every container and format is read by webdataset, datasets" + (", torch and wids" if torch else ""))
