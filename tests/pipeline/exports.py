"""Copies by `gelsim-export`: opened with the readers of their formats, killed and continued, compared, refused."""

import contextlib
import fcntl
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as parquet
import zarr
from gelsim.export import command
from PIL import Image

INSTALLED = Path(sys.executable).with_name("gelsim-export")
COMMAND = [INSTALLED] if INSTALLED.exists() else [sys.executable, "-m", "gelsim.export.command"]
KINDS = {"lerobot": "lerobot", "zarr": "zarr", "zip": "zarr", "hdf5": "hdf5"}
"""Formats by what their copies are called."""


def place(folder, name, kind):
    return folder / (f"{name}.zarr.zip" if kind == "zip" else f"{name}.{kind}")


def export(source, kind, out, *more, status=0):
    """What the command says on standard error."""
    arguments = [*COMMAND, source, "--to", KINDS[kind], "--out", out, *more]
    done = subprocess.run([str(word) for word in arguments], capture_output=True, text=True)
    assert done.returncode == status and "Traceback" not in done.stderr, (arguments, done)
    return done.stderr


def content(out):
    """All bytes of a copy."""
    if out.is_file():
        return {"": out.read_bytes()}
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


def frames(sample):
    """Frames and what the label says of each."""
    if "frames" in sample:
        return list(zip(sample["frames"], sample["label"]["frames"], strict=True))
    return [(sample, sample["label"])]


def pose(part):
    return [*part["pose"]["translation_mm"], *part["pose"]["quaternion_xyzw"]]


def turned(vector, points):
    """Points turned by a rotation vector, after Rodrigues."""
    angle = np.linalg.norm(vector)
    axis = vector / angle if angle > 0 else np.array([1.0, 0.0, 0.0])
    along = np.outer(points @ axis, axis)
    return along + np.cos(angle) * (points - along) + np.sin(angle) * np.cross(axis, points)


def by_quaternion(quaternion, points):
    """Points turned by a unit quaternion x, y, z, w."""
    axis, w = np.array(quaternion[:3]), quaternion[3]
    cross = 2 * np.cross(axis, points)
    return points + w * cross + np.cross(axis, cross)


def lerobot(dataset, out):
    """Files and keys of LeRobotDataset v3.0, and a table row for each frame."""
    info = json.loads((out / "meta/info.json").read_text())
    samples = list(dataset)
    every = [(sample, number, *frame) for sample in samples for number, frame in enumerate(frames(sample))]
    assert info["codebase_version"] == "v3.0" and info["video_path"] is None
    assert (info["total_episodes"], info["total_frames"]) == (len(samples), len(every))
    ends = [0]
    for split, span in info["splits"].items():
        begin, end = map(int, span.split(":"))
        assert begin == ends[-1] and end - begin == dataset.splits[split]
        assert all(sample["label"]["split"] == split for sample in samples[begin:end])
        ends.append(end)
    assert ends[-1] == len(samples)
    rows, begin = [], 0
    for number, shard in enumerate(dataset.shards):
        chunk = {"chunk_index": 0, "file_index": number}
        table = parquet.read_table(out / info["data_path"].format(**chunk))
        assert set(table.column_names) == set(info["features"])
        rows += table.to_pylist()
        for episode in parquet.read_table(out / f"meta/episodes/chunk-000/file-{number:03}.parquet").to_pylist():
            sample = samples[episode["episode_index"]]
            assert episode["gelsim/key"] == sample["key"] and json.loads(episode["gelsim/label"]) == sample["label"]
            assert episode["tasks"] == [sample["label"]["object"]["class"]]
            assert episode["gelsim/object"] == sample["label"]["object"]["id"]
            assert (episode["dataset_from_index"], episode["length"]) == (begin, len(frames(sample)))
            assert (episode["data/chunk_index"], episode["data/file_index"]) == (0, number)
            begin = episode["dataset_to_index"]
            tactile = np.stack([frame["tactile"] for frame, _ in frames(sample)]) / 255
            known = {"mean": tactile.mean((0, 1, 2)), "std": tactile.std((0, 1, 2)), "max": tactile.max((0, 1, 2))}
            for name, ours in known.items():
                assert np.allclose(np.ravel(episode[f"stats/observation.images.tactile/{name}"]), ours, atol=1e-6), name
    assert len(rows) == len(every) and begin == len(every)
    for index, (row, (sample, number, frame, part)) in enumerate(zip(rows, every)):
        assert (row["index"], row["frame_index"]) == (index, number)
        assert samples[row["episode_index"]] is sample and row["timestamp"] == np.float32(number / info["fps"])
        assert dataset.classes[row["task_index"]] == sample["label"]["object"]["class"]
        for name in ["tactile", "contact", "instance", "reference", "untouched", "slip"]:
            assert (f"observation.images.{name}" in row) == (name in frame)
            if name in frame:
                image = np.asarray(Image.open(io.BytesIO(row[f"observation.images.{name}"]["bytes"])))
                assert list(image.shape) == info["features"][f"observation.images.{name}"]["shape"]
                assert np.array_equal(image, frame[name] if frame[name].ndim == 3 else np.stack([frame[name]] * 3, axis=2))
        assert row["observation.state"] == np.array(pose(part), "float32").tolist()
        if "wrench" in part:
            assert row["observation.wrench"] == np.float32(part["wrench"]["force_n"] + part["wrench"]["torque_nmm"]).tolist()
    assert len(rows[0]["observation.wrench"]) == info["features"]["observation.wrench"]["shape"][0]
    tasks = parquet.read_table(out / "meta/tasks.parquet").to_pandas()
    assert tasks.index.tolist() == dataset.classes and tasks.task_index.tolist() == list(range(len(dataset.classes)))
    stats = json.loads((out / "meta/stats.json").read_text())
    states = np.array([row["observation.state"] for row in rows])
    for name, ours in {"mean": states.mean(0), "std": states.std(0), "min": states.min(0), "max": states.max(0)}.items():
        assert np.allclose(stats["observation.state"][name], ours, atol=1e-5), name
    assert stats["observation.state"]["count"] == [len(rows)]
    assert stats.keys() == info["features"].keys()
    datasets_of_hugging_face(out, every)


def datasets_of_hugging_face(out, every):
    """The same files without LeRobot: images come as images."""
    from datasets import load_dataset

    files = sorted(map(str, out.glob("data/*/*.parquet")))
    rows = load_dataset("parquet", data_files=files, split="train", cache_dir=str(out.parent / "cache"))
    for row, (_, _, frame, _) in zip(rows, every, strict=True):
        assert np.array_equal(np.asarray(row["observation.images.tactile"]), frame["tactile"])


def zarr_copy(dataset, out):
    """Arrays over all frames, with the ends of episodes."""
    store = zarr.storage.ZipStore(out, mode="r") if out.is_file() else out
    root = zarr.open_group(store, mode="r", zarr_format=2)
    ends = root["meta/episode_ends"][:]
    assert ends.dtype == np.int64 and root.attrs["classes"] == dataset.classes
    lengths = {array.shape[0] for _, array in root["data"].arrays()}
    assert lengths == {int(ends[-1])}, lengths
    begin = 0
    for sample, end, kind in zip(dataset, ends, root["meta/class_index"][:], strict=True):
        assert dataset.classes[kind] == sample["label"]["object"]["class"]
        for number, (frame, part) in zip(range(begin, end), frames(sample), strict=True):
            for name, value in frame.items():
                if isinstance(value, np.ndarray):
                    array = root[f"data/pad0_{name}"]
                    assert array.chunks == (1, *value.shape) and array.attrs["unit"]
                    assert np.array_equal(array[number], value) and array.dtype == value.dtype, name
            its = root["data/pad0_pose"][number]
            known = pose(part)
            points = np.eye(3)
            assert its.shape == (6,) and its[:3].tolist() == known[:3]
            assert np.allclose(turned(its[3:], points), by_quaternion(known[3:], points), atol=1e-12)
            if "markers" in frame:
                first = int(root["ragged/pad0_markers_ends"][number - 1]) if number else 0
                dots = root["ragged/pad0_markers_moved_px"][first : int(root["ragged/pad0_markers_ends"][number])]
                assert np.array_equal(dots, frame["markers"]["moved_px"])
        begin = int(end)
    if out.is_file():
        assert {entry.compress_type for entry in zipfile.ZipFile(out).infolist()} == {zipfile.ZIP_STORED}
        store.close()


def hdf5(dataset, out):
    """A group for each sample."""
    with h5py.File(out) as file:
        assert sorted(file) == sorted(sample["key"] for sample in dataset)
        assert file.attrs["classes"].tolist() == dataset.classes
        for sample in dataset:
            group, sequence = file[sample["key"]], "frames" in sample
            assert json.loads(group["label"][()]) == sample["label"] and group.attrs["split"] == sample["label"]["split"]
            for number, (frame, part) in enumerate(frames(sample)):
                at = number if sequence else ...
                for name, value in frame.items():
                    if isinstance(value, np.ndarray):
                        assert np.array_equal(group[name][at], value) and group[name].attrs["unit"], name
                assert group["pose"][at].tolist() == pose(part)


READERS = {"lerobot": lerobot, "zarr": zarr_copy, "zip": zarr_copy, "hdf5": hdf5}


def killed(source, kind, out):
    """Kills an export as soon as it has a part, several times, and goes on; the copy is that of one run."""
    whole = content(out)
    again = out.with_name("killed-" + out.name)
    partial = again.with_name(again.name + ".partial")
    for parts in [1, 2]:
        arguments = [*COMMAND, source, "--to", KINDS[kind], "--out", again]
        process = subprocess.Popen([str(word) for word in arguments], stderr=subprocess.DEVNULL)
        while process.poll() is None and len(list(partial.glob("parts/0*.json"))) < parts:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, "it was done before it could be killed"
        assert not again.exists() and len(list(partial.glob("parts/0*.json"))) >= parts
    with open(partial / "export.json") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert "another process is writing it" in export(source, kind, again, status=2)
    # What a kill in the middle of a file leaves.
    for torn in [*partial.glob("parts/*.tmp"), *partial.glob("out/**/*.tmp")]:
        torn.write_bytes(b"torn")
    export(source, kind, again)
    assert content(again) == whole and not partial.exists()


def changed(dataset, kind, out):
    """A copy of which a pixel, a number or a label changed is found, and the sample is named."""
    key = dataset[1]["key"]
    if kind == "hdf5":
        with h5py.File(out, "r+") as file:
            file[key]["tactile"][2, 3, 1] ^= 1
        assert f"sample {key}: tactile differs" in export(dataset.path, kind, out, "--check", status=1)
        with h5py.File(out, "r+") as file:
            file[key]["tactile"][2, 3, 1] ^= 1
            file[key]["wrench"][0] = np.nextafter(file[key]["wrench"][0], 9)
        assert f"sample {key}: wrench differs" in export(dataset.path, kind, out, "--check", status=1)
    elif kind == "zarr":
        root = zarr.open_group(out, mode="r+", zarr_format=2)
        image = root["data/pad0_tactile"][1]
        image[2, 3, 1] ^= 1
        root["data/pad0_tactile"][1] = image
        assert f"sample {key}: tactile differs" in export(dataset.path, kind, out, "--check", status=1)
        (out / "data/pad0_tactile/1.0.0.0").write_bytes(b"no chunk")
        assert f"sample {key}: it cannot be read" in export(dataset.path, kind, out, "--check", status=1)
    elif kind == "zip":
        out.write_bytes(out.read_bytes()[:-30])
        export(dataset.path, kind, out, "--check", status=2)
    else:
        path = out / "data/chunk-000/file-000.parquet"
        table = parquet.read_table(path)
        rows = table.to_pylist()
        image = np.array(Image.open(io.BytesIO(rows[1]["observation.images.tactile"]["bytes"])))
        image[2, 3, 1] ^= 1
        file = io.BytesIO()
        Image.fromarray(image).save(file, "PNG")
        rows[1]["observation.images.tactile"]["bytes"] = file.getvalue()
        parquet.write_table(table.from_pylist(rows, table.schema), path)
        said = export(dataset.path, kind, out, "--check", status=1)
        assert f"sample {key}: observation.images.tactile differs" in said, said
        path.unlink()
        export(dataset.path, kind, out, "--check", status=1)


def refused(dataset, other, folder):
    """Mistakes of the user have status 2 and say what to do; nothing is written over."""
    mine = folder / "mine.zarr"
    mine.mkdir()
    (mine / "notes.txt").write_text("mine")
    assert "name another --out" in export(dataset.path, "zarr", mine, status=2)
    assert content(mine) == {"notes.txt": b"mine"}
    for kind in KINDS:
        out = place(folder, "taken", kind)
        export(other.path, kind, out)
        before = content(out)
        assert "name another --out" in export(dataset.path, kind, out, status=2)
        assert "no " in export(dataset.path, kind, out, "--check", status=2)
        assert "already" in export(other.path, kind, out) and content(out) == before
        absent = place(folder, "absent", kind)
        export(dataset.path, kind, absent, "--check", status=2)
        assert not absent.exists()
    left = folder / "left.hdf5.partial"
    left.mkdir()
    assert "move it away" in export(dataset.path, "hdf5", folder / "left.hdf5", status=2)
    shutil.copy(folder / "taken.hdf5", left / "export.json")
    assert "move it away" in export(dataset.path, "hdf5", folder / "left.hdf5", status=2)
    assert "no dataset" in export(folder, "hdf5", folder / "none.hdf5", status=2)
    assert "invalid choice" in subprocess.run([*COMMAND, "x", "--to", "xml", "--out", "y"], capture_output=True, text=True).stderr
    for module, kind in [("h5py", "hdf5"), ("zarr", "zarr"), ("pyarrow", "lerobot")]:
        program = f"import sys; sys.modules[{module!r}] = None; from gelsim.export.command import main; sys.exit(main())"
        arguments = [sys.executable, "-c", program, dataset.path, "--to", kind, "--out", folder / "none"]
        done = subprocess.run(list(map(str, arguments)), capture_output=True, text=True)
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and "pip install 'gelsim[export]'" in done.stderr, done

    # A damaged source ends the export with status 1; once it is whole again the export goes on.
    source = folder / "source"
    shutil.copytree(dataset.path, source)
    shard = source / dataset.shards[-1].path.relative_to(dataset.path)
    aside = shard.rename(folder / "aside")
    for kind in KINDS:
        out = place(folder, "stopped", kind)
        assert shard.name in export(source, kind, out, status=1) and not out.exists()
    aside.rename(shard)
    for kind in KINDS:
        out = place(folder, "stopped", kind)
        export(source, kind, out)
        assert content(out) == content(place(folder, dataset.path.name, kind))


LEROBOT = """
import sys
try:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
except ImportError:
    sys.exit("no lerobot: its own class is not tried")
for root, frames in zip(sys.argv[1::2], map(int, sys.argv[2::2])):
    dataset = LeRobotDataset("local/copy", root=root)
    assert len(dataset) == frames == sum(dataset.meta.episodes["length"]) and dataset.num_episodes == len(dataset.meta.episodes)
    for index in range(frames):
        item = dataset[index]
        assert item["observation.images.tactile"].shape[0] == 3 and item["observation.state"].shape == (7,)
        assert item["index"] == index and item["task"] in dataset.meta.tasks.index
    part = LeRobotDataset("local/copy", root=root, episodes=[1])
    assert len(part) == dataset.meta.episodes[1]["length"] and part[0]["episode_index"] == 1
print(f"exports: {len(sys.argv[1::2])} copies opened by LeRobot")
"""


def own_class(made, folder, python):
    """LeRobot reads what is written for it."""
    arguments = []
    for name in ["halves", "tactip", "frames"]:
        arguments += [place(folder, name, "lerobot"), sum(len(frames(sample)) for sample in made[name])]
    done = subprocess.run([python, "-c", LEROBOT, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0 or done.stderr.startswith("no lerobot"), done.stderr
    print(done.stdout.strip() or done.stderr.strip(), flush=True)


def check(made, folder, python=None):
    """Every dataset in every format; `python` may have lerobot."""
    folder.mkdir()
    os.environ["HF_DATASETS_DISABLE_PROGRESS_BARS"] = "1"

    work = [(name, kind) for name in ["halves", "steps", "forceless", "tactip", "lamps", "frames"] for kind in KINDS]
    for name, kind in work:
        out = place(folder, name, kind)
        for more, word in [([], "samples/s"), (["--check"], "bit for bit"), (["--quiet"], "")]:
            said = io.StringIO()
            with contextlib.redirect_stderr(said):
                status = command.main([str(made[name].path), "--to", KINDS[kind], "--out", str(out), *more])
            assert status == 0 and word in said.getvalue() and bool(word) == bool(said.getvalue()), (name, kind, said.getvalue())
        READERS[kind](made[name], out)
    print(f"exports: {len(work)} copies, read by pyarrow, datasets, zarr and h5py", flush=True)
    if python:
        own_class(made, folder, python)
    # Two shards and more, of presses and of sequences.
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda kind: killed(made["halves"].path, kind, place(folder, "halves", kind)), KINDS))
    refused(made["halves"], made["forceless"], folder)
    for kind in KINDS:
        changed(made["halves"], kind, place(folder, "halves", kind))
    print("exports: killed, continued, compared, refused")
