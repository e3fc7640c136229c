"""Copies by `gelsim-export`: opened with the readers of their formats, killed, on full disks, continued, compared, refused."""

import contextlib
import fcntl
import io
import json
import os
import pty
import shutil
import signal
import struct
import subprocess
import sys
import termios
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
FINGERS = ["left", "right"]


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
    """Of each frame its pads: the finger ("" where there is one sensor), its arrays and what the label says of it."""
    label = sample["label"]
    each = zip(sample["frames"], label["frames"], strict=True) if "frames" in sample else [(sample, label)]
    fingers = FINGERS if "left" in label else []
    return [[(its, frame[its], part[its]) for its in fingers] or [("", frame, part)] for frame, part in each]


def pose(part):
    return [*part["pose"]["translation_mm"], *part["pose"]["quaternion_xyzw"]]


def normal_force(part):
    """The wrench's z, NaN where it is not known."""
    if "wrench" in part:
        return part["wrench"]["force_n"][2]
    contact = part["contact"]
    if contact["force_vector_n"]:
        return contact["force_vector_n"][2]
    return np.nan if contact["total_force_n"] is None else 0.0 - contact["total_force_n"]


def equal(one, other):
    return np.array_equal(one, other, equal_nan=True)


def dotted(kind, finger):
    """What LeRobot's features of a finger begin with."""
    return f"observation.{kind}.{finger}" if finger else f"observation.{kind}"


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
    every = [(sample, number, pads) for sample in samples for number, pads in enumerate(frames(sample))]
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
            for each in zip(*frames(sample), strict=True):
                tactile = np.stack([frame["tactile"] for _, frame, _ in each]) / 255
                known = {"mean": tactile.mean((0, 1, 2)), "std": tactile.std((0, 1, 2)), "max": tactile.max((0, 1, 2))}
                for name, ours in known.items():
                    figure = episode[f"stats/{dotted('images', each[0][0])}.tactile/{name}"]
                    assert np.allclose(np.ravel(figure), ours, atol=1e-6), name
    assert len(rows) == len(every) and begin == len(every)
    for index, (row, (sample, number, pads)) in enumerate(zip(rows, every)):
        assert (row["index"], row["frame_index"]) == (index, number)
        assert samples[row["episode_index"]] is sample and row["timestamp"] == np.float32(number / info["fps"])
        assert dataset.classes[row["task_index"]] == sample["label"]["object"]["class"]
        features = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
        for finger, frame, part in pads:
            for name in {"tactile", "contact", "instance", "reference", "untouched", "slip"}.intersection(frame):
                feature = f"{dotted('images', finger)}.{name}"
                image = np.asarray(Image.open(io.BytesIO(row[feature]["bytes"])))
                assert list(image.shape) == info["features"][feature]["shape"]
                assert np.array_equal(image, frame[name] if frame[name].ndim == 3 else np.stack([frame[name]] * 3, axis=2))
                features.add(feature)
            state, wrench = dotted("state", finger), dotted("wrench", finger)
            assert row[state] == np.array(pose(part), "float32").tolist()
            assert equal(row[wrench][2], np.float32(normal_force(part)))
            assert len(row[wrench]) == info["features"][wrench]["shape"][0]
            if "wrench" in part:
                assert row[wrench] == np.float32(part["wrench"]["force_n"] + part["wrench"]["torque_nmm"]).tolist()
            features |= {state, wrench}
        assert features == row.keys() and not any("/" in name for name in features)
    tasks = parquet.read_table(out / "meta/tasks.parquet").to_pandas()
    assert tasks.index.tolist() == dataset.classes and tasks.task_index.tolist() == list(range(len(dataset.classes)))
    stats = json.loads((out / "meta/stats.json").read_text())
    for state in [dotted("state", finger) for finger, _, _ in every[0][2]]:
        states = np.array([row[state] for row in rows])
        for name, ours in {"mean": states.mean(0), "std": states.std(0), "min": states.min(0), "max": states.max(0)}.items():
            assert np.allclose(stats[state][name], ours, atol=1e-5), name
        assert stats[state]["count"] == [len(rows)]
    assert stats.keys() == info["features"].keys()
    datasets_of_hugging_face(out, every)


def datasets_of_hugging_face(out, every):
    """The copy without LeRobot, by what its card says of it: images come as images; each split by itself, too."""
    from datasets import load_dataset

    cache = {"cache_dir": str(out.parent / "cache")}
    whole = load_dataset(str(out), **cache)
    assert list(whole) == ["train"]
    for row, (_, _, pads) in zip(whole["train"], every, strict=True):
        for finger, frame, part in pads:
            assert np.array_equal(np.asarray(row[f"{dotted('images', finger)}.tactile"]), frame["tactile"])
            assert row[dotted("state", finger)] == np.array(pose(part), "float32").tolist()
    parts = load_dataset(str(out), "splits", **cache)
    ours = {}
    for index, (sample, _, _) in enumerate(every):
        ours.setdefault(sample["label"]["split"], []).append(index)
    assert {split: part["index"][:] for split, part in parts.items()} == ours


def zarr_copy(dataset, out):
    """Arrays over all frames, with the ends of episodes."""
    store = zarr.storage.ZipStore(out, mode="r") if out.is_file() else out
    root = zarr.open_group(store, mode="r", zarr_format=2)
    ends = root["meta/episode_ends"][:]
    assert ends.dtype == np.int64 and root.attrs["classes"] == dataset.classes
    lengths = {array.shape[0] for _, array in root["data"].arrays()}
    assert lengths == {int(ends[-1])}, lengths
    fingers = [finger for finger, _, _ in frames(dataset[0])[0]]
    assert root.attrs.get("fingers", {"pad0": ""}) == {f"pad{number}": finger for number, finger in enumerate(fingers)}
    assert root.attrs["pads"].keys() == {name.split("_")[0] for name in root["data"] if name != "timestamp"}
    begin = 0
    for sample, end, kind in zip(dataset, ends, root["meta/class_index"][:], strict=True):
        assert dataset.classes[kind] == sample["label"]["object"]["class"]
        for number, pads in zip(range(begin, end), frames(sample), strict=True):
            for pad, (_, frame, part) in enumerate(pads):
                zarr_pad(root, f"pad{pad}", number, frame, part)
        begin = int(end)
    if out.is_file():
        assert {entry.compress_type for entry in zipfile.ZipFile(out).infolist()} == {zipfile.ZIP_STORED}
        store.close()


def zarr_pad(root, pad, number, frame, part):
    """What the copy holds of one sensor in frame `number` of all."""
    for name, value in frame.items():
        if isinstance(value, np.ndarray):
            array = root[f"data/{pad}_{name}"]
            assert array.chunks == (1, *value.shape) and array.attrs["unit"]
            assert np.array_equal(array[number], value) and array.dtype == value.dtype, name
    its = root[f"data/{pad}_pose"][number]
    known = pose(part)
    points = np.eye(3)
    assert its.shape == (6,) and its[:3].tolist() == known[:3]
    assert np.allclose(turned(its[3:], points), by_quaternion(known[3:], points), atol=1e-12)
    assert equal(root[f"data/{pad}_wrench"][number][2], normal_force(part))
    assert "t_s" not in part or root["data/timestamp"][number] == part["t_s"]
    if "markers" in frame:
        ends = root[f"ragged/{pad}_markers_ends"]
        first = int(ends[number - 1]) if number else 0
        dots = root[f"ragged/{pad}_markers_moved_px"][first : int(ends[number])]
        assert np.array_equal(dots, frame["markers"]["moved_px"]) and len(dots)


def hdf5(dataset, out):
    """A group for each sample."""
    with h5py.File(out) as file:
        assert sorted(file) == sorted(sample["key"] for sample in dataset)
        assert file.attrs["classes"].tolist() == dataset.classes
        for sample in dataset:
            group, sequence = file[sample["key"]], "frames" in sample
            assert json.loads(group["label"][()]) == sample["label"] and group.attrs["split"] == sample["label"]["split"]
            for number, pads in enumerate(frames(sample)):
                for finger, frame, part in pads:
                    hdf5_pad(group[finger] if finger else group, number if sequence else None, frame, part)


def hdf5_pad(group, number, frame, part):
    """What the copy holds of one sensor in frame `number` of a sequence, or in a press."""
    at = ... if number is None else number
    for name, value in frame.items():
        if isinstance(value, np.ndarray):
            assert np.array_equal(group[name][at], value) and group[name].attrs["unit"], name
    assert group["pose"][at].tolist() == pose(part) and equal(group["wrench"][at][2], normal_force(part))
    if "markers" in frame:
        ends = [0, *group["markers/ends"]] if number is not None else [0, None]
        dots = group["markers/moved_px"][ends[number or 0] : ends[(number or 0) + 1]]
        assert np.array_equal(dots, frame["markers"]["moved_px"])


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


FILLED = """
mount -t tmpfs -o size="$SIZE" none "$DISK" || exit 98
"$@"; first=$?
mount -o remount,size=1g "$DISK" || exit 98
[ ! -e "$COPY" ] || [ $first = 0 ] || exit 96
"$@" >&2 || exit 97
cp -r "$COPY" "$AGAIN"
exit $first
"""


def full(source, kind, out):
    """On a disk that fills up at tenths of the copy's size an export ends in words, has no OUT, and goes on once there is room.
    How often that was; none where no disk can be mounted."""
    whole = content(out)
    size, filled = sum(map(len, whole.values())), 0
    for tenths in range(1, 10, 2):
        disk, again = (out.with_name(f"{word}-{tenths}-{out.name}") for word in ["disk", "again"])
        disk.mkdir()
        copy = disk / out.name
        variables = {"SIZE": f"{size * tenths // 10240 + 4}k", "DISK": disk, "COPY": copy, "AGAIN": again}
        arguments = ["unshare", "-rm", "sh", "-c", FILLED, "sh", *COMMAND, source, "--to", KINDS[kind], "--out", copy]
        environment = {**os.environ, **{name: str(value) for name, value in variables.items()}}
        done = subprocess.run(list(map(str, arguments)), env=environment, capture_output=True, text=True)
        if done.returncode in (98, 1) and "mount" in done.stderr + done.stdout or "unshare" in done.stderr:
            return None
        assert done.returncode in (0, 1) and "Traceback" not in done.stderr, (tenths, done)
        if done.returncode == 1:
            filled += 1
            assert "No space left on device" in done.stderr, (tenths, done)
        assert content(again) == whole, tenths
        shutil.rmtree(again) if again.is_dir() else again.unlink()
    return filled


def changed(dataset, kind, out, finger=""):
    """A copy of which a pixel, a number or a label changed is found, of presses; the sample and the array are named."""
    key = dataset[1]["key"]
    if kind == "hdf5":
        tactile, wrench = (f"{finger}/{name}".lstrip("/") for name in ["tactile", "wrench"])
        with h5py.File(out, "r+") as file:
            file[key][tactile][2, 3, 1] ^= 1
        assert f"sample {key}: {tactile} differs" in export(dataset.path, kind, out, "--check", status=1)
        with h5py.File(out, "r+") as file:
            file[key][tactile][2, 3, 1] ^= 1
            file[key][wrench][0] = np.nextafter(file[key][wrench][0], 9)
        assert f"sample {key}: {wrench} differs" in export(dataset.path, kind, out, "--check", status=1)
    elif kind == "zarr":
        root = zarr.open_group(out, mode="r+", zarr_format=2)
        tactile = "pad1_tactile" if finger == "right" else "pad0_tactile"
        image = root[f"data/{tactile}"][1]
        image[2, 3, 1] ^= 1
        root[f"data/{tactile}"][1] = image
        assert f"sample {key}: {tactile} differs" in export(dataset.path, kind, out, "--check", status=1)
        (out / f"data/{tactile}/1.0.0.0").write_bytes(b"no chunk")
        assert f"sample {key}: it cannot be read" in export(dataset.path, kind, out, "--check", status=1)
        (out / f"data/{tactile}/1.0.0.0").unlink()
        assert f"sample {key}: {tactile} differs" in export(dataset.path, kind, out, "--check", status=1)
    elif kind == "zip":
        out.write_bytes(out.read_bytes()[:-30])
        export(dataset.path, kind, out, "--check", status=2)
    else:
        path = out / "data/chunk-000/file-000.parquet"
        table = parquet.read_table(path)
        rows = table.to_pylist()
        tactile = f"{dotted('images', finger)}.tactile"
        image = np.array(Image.open(io.BytesIO(rows[1][tactile]["bytes"])))
        image[2, 3, 1] ^= 1
        file = io.BytesIO()
        Image.fromarray(image).save(file, "PNG")
        rows[1][tactile]["bytes"] = file.getvalue()
        parquet.write_table(table.from_pylist(rows, table.schema), path)
        said = export(dataset.path, kind, out, "--check", status=1)
        assert f"sample {key}: {tactile} differs" in said, said
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
    guesses(dataset, folder)
    for modules, kind in [(["h5py"], "hdf5"), (["pyarrow"], "zarr"), (["pyarrow", "PIL"], "lerobot"), (["OpenEXR"], "zarr")]:
        program = f"import sys; sys.modules |= dict.fromkeys({modules!r}); from gelsim.export.command import main; sys.exit(main())"
        arguments = [sys.executable, "-c", program, dataset.path, "--to", kind, "--out", folder / "none"]
        done = subprocess.run(list(map(str, arguments)), capture_output=True, text=True)
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and "not installed: " in done.stderr, done
        wanted = [{"PIL": "pillow"}.get(module, module) for module in modules]
        assert all(f" '{name}>=" in done.stderr for name in wanted) and "pip install '" in done.stderr, done.stderr
        assert not (folder / "none").exists()

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


def guesses(dataset, folder):
    """Formats, places and flags as people guess them."""

    def said(*words, status=2, **more):
        done = subprocess.run([*map(str, COMMAND), *map(str, words)], capture_output=True, text=True, cwd=folder, **more)
        assert done.returncode == status and "Traceback" not in done.stderr, (words, done)
        return done.stderr

    for name, part in [("h5", "did you mean hdf5?"), ("HDF5", "did you mean hdf5?"), ("parquet", "did you mean lerobot?"),
                       ("le-robot", "did you mean lerobot?"), ("zar", "did you mean zarr?"), ("rlds", "no such copy"),
                       ("webdataset", "`gelsim generate` writes it"), ("npz", "gelsim.load"), ("xml", "one of lerobot, zarr or hdf5")]:
        assert part in said("x", "--to", name, "--out", "y"), name
    before = set(folder.iterdir())
    for address in ["s3://b/x", "s3:/b/x", "gs:/b/x", "S3://b/x", "https://example.org/x"]:
        assert "is an address: name a folder" in said(dataset.path, "--to", "hdf5", "--out", address)
        assert "is an address" in said(address, "--to", "hdf5", "--out", "y")
    for address in ["file:/data/x", "file:///data/x"]:
        assert "write the path alone, /data/x" in said(dataset.path, "--to", "hdf5", "--out", address)
    assert "write ./~nobody-of-this-name/x" in said(dataset.path, "--to", "hdf5", "--out", "~nobody-of-this-name/x")
    assert set(folder.iterdir()) == before, "no folder is called after an address"
    home = folder / "home"
    home.mkdir()
    arguments = [dataset.path, "--to", "hdf5", "-q", "-o", "~/x.h5"]
    assert said(*arguments, status=0, env={**os.environ, "HOME": str(home)}) == "" and (home / "x.h5").is_file()
    (folder / "afile").write_text("")
    assert "afile: File exists; it is a file" in said(dataset.path, "--to", "hdf5", "--out", "afile/x", status=1)
    assert "without --check" in said(dataset.path, "--to", "hdf5", "--out", "absent", "--check")
    narrow(dataset, folder)


def narrow(dataset, folder):
    """Progress stays within the terminal, and one that is dumb has none."""
    program = (
        "import sys, time; from gelsim.dataset import Dataset; from gelsim.export.command import Progress\n"
        "progress = Progress(Dataset(sys.argv[1]), False); progress.told -= 1; progress.begun -= 1e-9; progress.tell(1)\n"
        "progress.clear(); print('end', file=sys.stderr, flush=True)"
    )
    for columns, term in [(80, "xterm"), (12, "xterm"), (80, "dumb")]:
        ours, theirs = pty.openpty()
        termios.tcsetwinsize(theirs, (24, columns)) if hasattr(termios, "tcsetwinsize") else fcntl.ioctl(
            theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0)
        )
        environment = {**os.environ, "TERM": term}
        subprocess.run([sys.executable, "-c", program, dataset.path], stderr=theirs, env=environment, check=True)
        os.close(theirs)
        shown = os.read(ours, 1 << 16).decode()
        os.close(ours)
        if term == "dumb":
            assert shown.strip() == "end", repr(shown)
        else:
            line = shown.split("\x1b[K")[1]
            assert "2/11" in line and len(line.strip("\r")) < columns, repr(shown)


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
        images = [name for name in dataset.features if name.startswith("observation.images.") and name.endswith("tactile")]
        states = [name for name in dataset.features if name.startswith("observation.state")]
        assert len(images) == len(states) > 0
        assert all(item[name].shape[0] == 3 for name in images) and all(item[name].shape == (7,) for name in states)
        assert item["index"] == index and item["task"] in dataset.meta.tasks.index
    part = LeRobotDataset("local/copy", root=root, episodes=[1])
    assert len(part) == dataset.meta.episodes[1]["length"] and part[0]["episode_index"] == 1
print(f"exports: {len(sys.argv[1::2])} copies opened by LeRobot")
"""


def own_class(made, folder, python):
    """LeRobot reads what is written for it."""
    arguments = []
    for name in ["halves", "tactip", "frames", "lifts"]:
        arguments += [place(folder, name, "lerobot"), sum(len(frames(sample)) for sample in made[name])]
    done = subprocess.run([python, "-c", LEROBOT, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0 or done.stderr.startswith("no lerobot"), done.stderr
    print(done.stdout.strip() or done.stderr.strip(), flush=True)


def check(made, folder, python=None):
    """Every dataset in every format; `python` may have lerobot."""
    folder.mkdir()
    os.environ["HF_DATASETS_DISABLE_PROGRESS_BARS"] = "1"

    names = ["halves", "steps", "forceless", "tactip", "lamps", "frames", "grips", "lifts"]
    work = [(name, kind) for name in names for kind in KINDS]
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
    # Three shards and more, of one sensor and of two.
    several = [("halves", kind) for kind in KINDS] + [("grips", "zarr")]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda each: killed(made[each[0]].path, each[1], place(folder, *each)), several))
    disks = {kind: full(made["frames"].path, kind, place(folder, "frames", kind)) for kind in KINDS}
    assert all(filled is None or filled > 1 for filled in disks.values()), disks
    print("exports: no disk can be mounted" if None in disks.values() else f"exports: disks filled up: {disks}", flush=True)
    refused(made["halves"], made["forceless"], folder)
    for kind in KINDS:
        changed(made["halves"], kind, place(folder, "halves", kind))
        changed(made["grips"], kind, place(folder, "grips", kind), "right")
    print("exports: killed, continued, compared, refused")
