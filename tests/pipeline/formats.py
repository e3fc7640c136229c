"""Datasets loaded in Python and exported: what comes is what the job renders, and nothing ends in a traceback.

    python formats.py GELSIM [PYTHON_WITH_TORCH]    from the project's root, where the wheel, OpenEXR, pillow, datasets, zarr and
                                                    h5py are installed; the second interpreter may have lerobot
    python formats.py GELSIM --speed DIR            how quickly a dataset is loaded and exported
"""

import hashlib
import importlib.util
import json
import multiprocessing
import os
import pickle
import random
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import types
from pathlib import Path

import exports
import gelsim
import numpy as np
from snippet import snippets

LAYERS = ["depth", "surface", "contact", "normal", "pressure", "gap", "markers", "reference", "flow", "untouched"]

# As mixed as samples get: contact and none, relief, markers that move, a lens.
PRESSES = """
dataset = { name = "presses", samples = 11, seed = 5, samples_per_shard = 3, splits = { train = 0.6, val = 0.2, test = 0.2 } }
sensor.resolution_px = [48, 36]
object = [{ path = "OBJECTS/sphere.obj", class = "ball" }, { path = "OBJECTS/gear.obj" }]
texture.amplitude_mm = { choice = [0.0, 0.05] }
markers.pitch_mm = 1.5
shear = { x_mm = [-0.3, 0.3] }
camera.distortion_k1 = { choice = [0.0, -0.1] }
pose = { yaw_deg = [0.0, 360.0], tilt_deg = [0.0, 5.0] }
indentation = { depth_mm = [0.3, 1.0], no_contact = 0.3 }
"""
EVERY_LAYER = f"output.layers={json.dumps(LAYERS)}"
NPY, FOLDER, PNG16 = 'output.depth_format="npy"', 'output.container="folder"', 'output.depth_format="png16"'
LAMPS = 'sensor={ preset = "gelsight-series2", resolution_px = [48, 36] }'
SMALL = "sensor.resolution_px=[40, 30]"
# Two different fingers: other sizes, other markers.
FINGERS = [
    "sensor.resolution_px=[48, 36]",
    "markers.pitch_mm=1.5",
    'gripper.right={ preset = "gelsight-mini", resolution_px = [40, 30], markers = { pitch_mm = 2.0 } }',
]
HALVES = {"depth", "surface", "normal", "gap", "flow", "lamps"}


def datasets():
    """Every kind: name, job, settings and samples."""
    presses, tactip, sequences = Path(root) / "presses.toml", "configs/tactip-edge.toml", "configs/sequences.toml"
    grips, lifts = "configs/gripper.toml", "configs/gripper-lift.toml"
    presses.write_text(PRESSES.replace("OBJECTS", str(Path("objects").resolve())))
    shards = "dataset.samples_per_shard=2"
    # Forces that nobody knows are null in the labels.
    forceless = ['output.layers=["depth", "contact"]', "shear={}"]
    return {
        "halves": (presses, [EVERY_LAYER], None),
        "floats": (presses, [EVERY_LAYER, 'output.exr.pixel="float"', FOLDER], None),
        "npy": (presses, [EVERY_LAYER, NPY], None),
        "steps": (presses, [EVERY_LAYER, PNG16, FOLDER], None),
        "forceless": (presses, [*forceless, 'fidelity="paper"'], 4),
        "lamps": (presses, [LAMPS, 'output.layers=["lamps"]', "markers={}"], 2),
        "tactip": (tactip, ["dataset.samples_per_shard=1"], 3),
        "sequences": (sequences, [SMALL, shards], 3),
        "frames": (sequences, [SMALL, shards, NPY, FOLDER], 3),
        "grips": (grips, [*FINGERS, 'output.layers=["depth", "contact", "markers"]', shards], 5),
        "lifts": (lifts, [*FINGERS, 'output.layers=["slip", "markers"]', shards, "sequence.frame_rate_hz=8.0"], 3),
    }


def generate(name, job, settings, samples):
    """The dataset and its job."""
    out = Path(root) / name
    more = ["--samples", str(samples)] if samples else []
    assigned = [word for text in settings for word in ["--set", text]]
    subprocess.run([native, "generate", job, "--quiet", "--out", out, *more, *assigned], check=True)
    return out, gelsim.Job.load(job, set=settings, samples=samples)


def same(where, ours, theirs, job_settings):
    """A loaded frame is a rendered one; half floats are the nearest ones, and of png16 within half a step."""
    assert [name for name in ours if name != "key"] == list(theirs), (where, list(ours), list(theirs))
    for name, value in theirs.items():
        its = ours[name]
        if name == "label":
            assert {**its, "png16": None} == {**value, "png16": None}, where
        elif name in ("left", "right"):
            same((*where, name), its, value, job_settings)
        elif isinstance(value, dict):
            assert all(np.array_equal(its[key], value[key]) and its[key].dtype == value[key].dtype for key in value), where
            assert its.keys() == value.keys()
        else:
            assert its.dtype == value.dtype and its.shape == value.shape and its.flags.writeable, (where, name)
            if PNG16 in job_settings and name in ("depth", "surface"):
                step = ours["label"]["png16"][f"{name}_mm_per_step"]
                assert 0 < step < 1e-3 and np.abs(its.astype("f8") - value).max() <= 0.501 * step, (where, name)
                continue
            halves = NPY not in job_settings and 'output.exr.pixel="float"' not in job_settings and name in HALVES
            expected = value.astype("float16").astype("float32") if halves else value
            assert its.tobytes() == expected.tobytes(), (where, name)


def loading(out, job, settings):
    """All samples, split by split, are those of the job."""
    whole = gelsim.load(out)
    splits = [split for split in ["train", "val", "test"] if job.indices(split)]
    order = [index for split in splits for index in job.indices(split)]
    assert len(whole) == len(job) == len(order) and whole.layers == job.layers and whole.classes == job.classes
    assert whole.fingerprint == job.fingerprint and list(whole.splits) == splits
    for index, ours in zip(order, whole, strict=True):
        theirs = job[index]
        assert ours["key"] == f"{index:09}" == ours["label"]["key"]
        if "frames" in theirs:
            assert len(ours["frames"]) == len(theirs["frames"]) and ours["label"] == theirs["label"]
            for number, (one, other) in enumerate(zip(ours["frames"], theirs["frames"])):
                same((out.name, index, number), one, other, settings)
        else:
            same((out.name, index), ours, theirs, settings)
    for split in splits:
        part = gelsim.load(str(out), split=split)
        assert [part[k]["label"]["index"] for k in range(len(part))] == job.indices(split)
        assert len(part) == whole.splits[split]
    assert whole[-1]["key"] == whole[np.int64(len(whole) - 1)]["key"] == f"{order[-1]:09}"
    for wrong in [len(whole), -len(whole) - 1]:
        assert f"0 to {len(whole) - 1}" in raises(IndexError, lambda: whole[wrong])
    for wrong in ["0", 0.5, slice(1)]:
        raises(TypeError, lambda: whole[wrong])
    assert "tarin" in raises(gelsim.UsageError, lambda: gelsim.load(out, split="tarin"))
    return whole


def digest(sample):
    """Of all that is in a sample; pickled arrays of equal values are equal."""
    return hashlib.sha256(pickle.dumps(sample)).hexdigest()


def digest_at(index):
    return digest(shared[index])


def adopt(dataset):
    global shared
    shared = dataset


def processes(dataset):
    """Pickled, forked and spawned, all see the same."""
    expected = [digest(sample) for sample in dataset]
    for fresh in [dataset, gelsim.load(dataset.path)]:
        again = pickle.loads(pickle.dumps(fresh))
        assert [digest(sample) for sample in again] == expected
        for method in ["fork", "spawn"]:
            with multiprocessing.get_context(method).Pool(2, adopt, [fresh]) as pool:
                assert pool.map(digest_at, range(len(fresh)), chunksize=1) == expected, method


def batches(presses, forceless, curved, sequences):
    """What `collate` stacks, pads and leaves alone: arrays of numpy whatever is installed."""
    each = [presses[k] for k in range(5)]
    batch = gelsim.collate(each)
    assert all(isinstance(value, (np.ndarray, list)) for value in batch.values())
    for name in ["tactile", "depth", "contact", "normal", "flow"]:
        assert batch[name].dtype == each[0][name].dtype and np.array_equal(batch[name], [its[name] for its in each])
    assert batch["markers"][3] is each[3]["markers"] and batch["label"] == [its["label"] for its in each]
    assert batch["key"] == [its["key"] for its in each]
    for pose, wrench, its in zip(batch["pose"], batch["wrench"], each, strict=True):
        label = its["label"]
        known = label["pose"]["translation_mm"] + label["pose"]["quaternion_xyzw"]
        assert np.array_equal(pose, np.array(known, "float32"))
        force = [*label["shear"]["force_n"], -label["contact"]["total_force_n"]]
        assert np.array_equal(wrench[:3], np.array(force, "float32")) and np.isnan(wrench[3:]).all()
    assert np.isnan(gelsim.collate([forceless[0]])["wrench"][:, 2:]).all()
    label, wrench = curved[0]["label"]["contact"], gelsim.collate([curved[0]])["wrench"][0]
    assert np.array_equal(wrench, np.array(label["force_vector_n"] + label["torque_nmm"], "float32"))

    each = list(sequences)
    batch = gelsim.collate(each)
    counts = [len(its["frames"]) for its in each]
    assert len(set(counts)) > 1, "sequences of different lengths"
    assert batch["mask"].sum(axis=1).tolist() == counts and "frames" not in batch
    for row, its in enumerate(each):
        for number, frame in enumerate(its["frames"]):
            assert np.array_equal(batch["tactile"][row][number], frame["tactile"]) and batch["mask"][row][number]
            known = its["label"]["frames"][number]["wrench"]
            assert np.array_equal(batch["wrench"][row][number], np.array(known["force_n"] + known["torque_nmm"], "float32"))
        assert not batch["tactile"][row][counts[row] :].any()
        assert batch["markers"][row][0] is its["frames"][0]["markers"]
    assert batch["pose"].shape == (len(each), max(counts), 7)
    for collate in (gelsim.collate, gelsim.collate_torch) if torch_is_there() else (gelsim.collate,):
        assert "samples is empty" in raises(gelsim.UsageError, lambda: collate([]))
    assert "depth" in raises(gelsim.UsageError, lambda: gelsim.collate([presses[0], curved[0]]))


def torch_is_there():
    """Whether tensors can be made here."""
    return importlib.util.find_spec("torch") is not None


def of_another_numpy(presses):
    """No torch, and one that was built for another numpy: it can be imported, and finds none."""

    def from_numpy(array):
        raise RuntimeError("Numpy is not available")

    before, torch = sys.modules.get("torch"), types.ModuleType("torch")
    torch.__version__, torch.from_numpy = "1.13.1", from_numpy
    sys.modules["torch"] = None
    said = raises(ImportError, lambda: gelsim.collate_torch([presses[0]]))
    assert "pip install torch" in said and "gelsim.collate gives arrays" in said, said
    sys.modules["torch"] = torch
    said = raises(ImportError, lambda: gelsim.collate_torch([presses[0]]))
    assert f"torch 1.13.1 cannot use numpy {np.__version__}" in said and "pip install 'numpy<2'" in said, said
    del sys.modules["torch"]
    if before is not None:
        sys.modules["torch"] = before


TORCH = """
import sys, gelsim, torch
from torch.utils.data import ConcatDataset, DataLoader
for source in [gelsim.load(sys.argv[1]), gelsim.Job.load(sys.argv[2], samples=6)]:
    for batch in DataLoader(source, batch_size=3, num_workers=2, collate_fn=gelsim.collate_torch):
        n = len(batch["label"])
        assert batch["tactile"].dtype == torch.uint8 and batch["depth"].dtype == torch.float32, batch.keys()
        assert batch["pose"].shape == (n, 7) and batch["wrench"].shape == (n, 6) and batch["pose"].dtype == torch.float32
        assert all(isinstance(value, torch.Tensor) for name, value in batch.items() if name not in ("label", "key", "markers"))
for batch in DataLoader(gelsim.load(sys.argv[3]), batch_size=2, num_workers=2, collate_fn=gelsim.collate_torch):
    assert batch["mask"].dtype == torch.bool and batch["tactile"].shape[:2] == batch["mask"].shape == batch["pose"].shape[:2]
"""


def raises(kind, call):
    """What the exception says, which is of this kind exactly."""
    try:
        call()
    except Exception as error:
        assert type(error) is kind, (type(error), error)
        return str(error)
    raise AssertionError(f"no {kind.__name__}")


def damage(tars, folders):
    """Every damage is a RunError that names the file and the way out; a folder that is no dataset a UsageError."""
    copy = Path(root) / "damaged 'one'"

    def damaged(source, change, kind=gelsim.RunError):
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(source, copy)
        change(copy)
        said = raises(kind, lambda: list(gelsim.load(copy)))
        assert "gelsim verify" in said if kind is gelsim.RunError else "gelsim " in said, said
        # Commands that a shell takes: quotes and a blank are in the path.
        for command in re.findall("`(gelsim [^`]*)`", said):
            words = shlex.split(command)
            assert str(copy) in words or str(copy / "job.toml") in words or "FOLDER" in words, words
        return said

    tar, folder = "data/train-000001.tar", "data/train-000001"
    for change in [
        lambda out: (out / tar).unlink(),
        lambda out: (out / tar).write_bytes((out / tar).read_bytes()[:-2048]),
        lambda out: (out / tar).write_bytes(b""),
        lambda out: (out / tar).write_bytes(bytes((out / tar).stat().st_size)),
        lambda out: (out / tar).write_bytes((out / "data/train-000000.tar").read_bytes()),
    ]:
        assert tar in damaged(tars, change)
    member = next((folders / folder).glob("*.depth.exr")).name
    for change in [
        lambda out: shutil.rmtree(out / folder),
        lambda out: (out / folder / member).unlink(),
        lambda out: (out / folder / member).write_bytes(b""),
        lambda out: (out / folder / member).write_bytes((out / folder / member).read_bytes()[:-9]),
        lambda out: (out / folder / member.replace("depth.exr", "tactile.png")).write_bytes(b"no image"),
        lambda out: (out / folder / member.replace("depth.exr", "json")).write_text("{}"),
        lambda out: (out / folder / member.replace("depth.exr", "json")).unlink(),
    ]:
        assert folder in damaged(folders, change)

    manifest = "dataset.json"
    assert "generate" in damaged(tars, lambda out: (out / manifest).unlink(), gelsim.UsageError)
    for text in ["", "{", "[]", '{"manifest_version": 1}', '{"manifest_version": 99}', "null", "\xff"]:
        assert manifest in damaged(tars, lambda out: (out / manifest).write_text(text, "latin-1"), gelsim.UsageError)
    assert "no dataset" in raises(gelsim.UsageError, lambda: gelsim.load(project / "configs"))
    assert "no folder" in raises(gelsim.UsageError, lambda: gelsim.load(Path(root) / "absent"))

    # Bytes that change anywhere: an exception of ours or none.
    chance, tries = random.Random(3), 0
    shutil.rmtree(copy)
    shutil.copytree(tars, copy)
    whole = (copy / tar).read_bytes()
    for _ in range(150):
        broken = bytearray(whole)
        for _ in range(chance.choice([1, 3, 40])):
            broken[chance.randrange(len(broken))] = chance.randrange(256)
        (copy / tar).write_bytes(broken)
        try:
            list(gelsim.load(copy))
        except gelsim.RunError as error:
            assert tar in str(error)
            tries += 1
    assert 20 < tries, "most changes are found"


def docs(python):
    """Commands and snippets of docs/formats.md as they stand; those with torch or lerobot where `python` has them."""
    page = project / "docs/formats.md"
    folder = Path(root) / "docs"
    small = ["--samples", "16", "--set", SMALL, "--quiet", "--out", folder / "out/quickstart"]
    subprocess.run([native, "generate", "configs/quickstart.toml", *small], check=True)
    lines = [line.strip() for line in page.read_text().splitlines() if line.startswith("    gelsim-export ")]
    for to, out in [("zarr", "quickstart.zarr.zip"), ("hdf5", "quickstart.h5")]:
        lines.append(f"gelsim-export out/quickstart --to {to} --out {out}")
    for line in lines:
        subprocess.run([*exports.COMMAND, *line.split()[1:], "--quiet"], cwd=folder, check=True)
    ran = 0
    environment = {**os.environ, "HF_HOME": str(folder / "cache"), "HF_HUB_OFFLINE": "1"}
    for code in snippets(folder / "quickstart.lerobot/README.md"):
        subprocess.run([sys.executable, "-c", code], cwd=folder / "quickstart.lerobot", env=environment, check=True, capture_output=True)
        ran += 1
    for code in snippets(page):
        needed = "lerobot" if "import LeRobot" in code else "torch" if "import DataLoader" in code else None
        with_it = python if needed else sys.executable
        if with_it and subprocess.run([with_it, "-c", f"import {needed or 'gelsim'}"], capture_output=True).returncode == 0:
            subprocess.run([with_it, "-c", code], cwd=folder, env=environment, check=True, capture_output=True)
            ran += 1
        else:
            print(f"no {needed}: its snippet is not tried")
    assert ran >= 6
    print(f"docs: {len(lines)} commands, {ran} snippets", flush=True)


def speed(folder):
    """Prints how many samples a second are loaded, in order and at random, and what each export says of itself."""
    dataset = gelsim.load(folder)
    order = list(range(len(dataset)))
    for how in ["in order", "at random"]:
        start = time.monotonic()
        for index in order:
            dataset[index]
        print(f"load {how}: {len(dataset) / (time.monotonic() - start):.0f} samples/s on one core", flush=True)
        random.Random(1).shuffle(order)
    for kind in exports.KINDS:
        with tempfile.TemporaryDirectory() as temporary:
            out = exports.place(Path(temporary), "copy", kind)
            for more in [[], ["--check"]]:
                arguments = [*exports.COMMAND, folder, "--to", exports.KINDS[kind], "--out", out, *more]
                process = subprocess.Popen(list(map(str, arguments)), stderr=subprocess.PIPE, text=True)
                said = process.stderr.read().rsplit(": ", 1)[-1].strip()
                _, status, used = os.wait4(process.pid, 0)
                assert status == 0, said
                print(f"{kind} {' '.join(more) or 'export'}: {said}, {used.ru_maxrss / 1e3:.0f} MB of memory", flush=True)


if __name__ == "__main__":
    if sys.argv[2:3] == ["--speed"]:
        speed(sys.argv[3])
        sys.exit()
    native, project = Path(sys.argv[1]).resolve(), Path.cwd()
    torch = sys.argv[2] if len(sys.argv) > 2 else None
    with tempfile.TemporaryDirectory() as root:
        made = {}
        for name, (job, settings, samples) in datasets().items():
            out, of_job = generate(name, job, settings, samples)
            made[name] = loading(out, of_job, settings)
        print(f"load: {len(made)} datasets, each sample as its job renders it", flush=True)
        processes(made["halves"])
        processes(made["frames"])
        batches(made["npy"], made["forceless"], made["tactip"], made["sequences"])
        of_another_numpy(made["npy"])
        if torch:
            folders = [made["npy"].path, Path(root) / "presses.toml", made["sequences"].path]
            subprocess.run([torch, "-c", TORCH, *folders], check=True)
        else:
            print("no torch: its DataLoader is not tried")
        damage(made["halves"].path, made["floats"].path)
        print("load: processes, batches, damage", flush=True)
        docs(torch)
        exports.check(made, Path(root) / "copies", torch)
