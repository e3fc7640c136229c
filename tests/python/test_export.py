"""Copies by `gelsim-export`: read by their formats' readers, killed, on full disks, continued, compared, refused."""

import contextlib
import fcntl
import functools
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
from pathlib import Path

import pytest

gelsim = pytest.importorskip("gelsim", reason="the module is not installed: pip install .")
for name in ["OpenEXR", "PIL", "pyarrow", "h5py", "zarr", "datasets"]:
    pytest.importorskip(name, reason="pip install '.[export]' zarr datasets")

import h5py
import numpy as np
import pyarrow.parquet as parquet
import zarr
from gelsim.export import command
from gelsim.export import lerobot as lerobot_format
from PIL import Image
from processes import fill_disk, run

pytestmark = pytest.mark.wheel

INSTALLED = Path(sys.executable).with_name("gelsim-export")
COMMAND = [INSTALLED] if INSTALLED.exists() else [sys.executable, "-m", "gelsim.export.command"]
# What copies are called, and their formats.
FORMATS = {"lerobot": "lerobot", "zarr": "zarr", "zip": "zarr", "hdf5": "hdf5"}
FINGERS = ["left", "right"]
COPIED = ["halves", "steps", "forceless", "tactip", "lamps", "frames", "grips", "lifts"]


@pytest.fixture(params=COPIED)
def kind(request):
    return request.param


@pytest.fixture(params=FORMATS)
def form(request):
    return request.param


def place(folder, name, form):
    return folder / (f"{name}.zarr.zip" if form == "zip" else f"{name}.{form}")


def run_export(*words, status=0, **options):
    """What the command says on standard error."""
    said = run(*COMMAND, *words, status=status, **options).stderr
    assert "Traceback" not in said
    return said


def export(source, form, out, *more, status=0):
    return run_export(source, "--to", FORMATS[form], "--out", out, *more, status=status)


def content(out):
    """All bytes of a copy."""
    if out.is_file():
        return {"": out.read_bytes()}
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


class Copies:
    """Of each dataset a copy in each format, and what was said as it was made, compared, and asked for once more."""

    def __init__(self, every_kind, folder):
        self.every_kind, self.folder = every_kind, folder
        self.said = functools.cache(self.said)

    def said(self, kind, form):
        out, told = place(self.folder, kind, form), []
        for more in [[], ["--check"], ["--quiet"]]:
            with contextlib.redirect_stderr(io.StringIO()) as said:
                line = [self.every_kind.path(kind), "--to", FORMATS[form], "--out", out, *more]
                status = command.main(list(map(str, line)))
            assert status == 0, said.getvalue()
            told.append(said.getvalue())
        return told

    def path(self, kind, form):
        self.said(kind, form)
        return place(self.folder, kind, form)


@pytest.fixture(scope="module")
def copies(every_kind, tmp_path_factory):
    return Copies(every_kind, tmp_path_factory.mktemp("copies"))


def test_a_copy_is_made_compared_and_left_alone(copies, kind, form):
    made, compared, left_alone = copies.said(kind, form)
    assert "samples/s" in made and "bit for bit" in compared and left_alone == ""


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


def dotted(what, finger):
    """What LeRobot's features of a finger begin with."""
    return f"observation.{what}.{finger}" if finger else f"observation.{what}"


class LeRobot:
    """A copy of that format, and what it is to hold."""

    def __init__(self, every_kind, kind, out):
        self.dataset, self.samples, self.out = every_kind.load(kind), every_kind.samples(kind), out
        self.info = json.loads((out / "meta/info.json").read_text())
        # Frames of all samples, and before how many of them each sample begins.
        self.frames = [(sample, number, pads) for sample in self.samples for number, pads in enumerate(frames(sample))]
        self.shards = range(len(self.dataset.shards))

    def tables(self):
        """The table of each shard's frames."""
        path = self.info["data_path"]
        return [parquet.read_table(self.out / path.format(chunk_index=0, file_index=shard)) for shard in self.shards]

    def rows(self):
        """Each frame's row of the tables, beside the frame."""
        rows = [row for table in self.tables() for row in table.to_pylist()]
        return list(zip(rows, self.frames, strict=True))

    def episodes(self):
        """The shard, the row and the sample of each episode."""
        for shard in self.shards:
            for row in parquet.read_table(self.out / f"meta/episodes/chunk-000/file-{shard:03}.parquet").to_pylist():
                yield shard, row, self.samples[row["episode_index"]]


@pytest.fixture
def lerobot(every_kind, copies, kind):
    return LeRobot(every_kind, kind, copies.path(kind, "lerobot"))


def test_lerobots_info_counts_episodes_and_frames(lerobot):
    info = lerobot.info
    assert info["codebase_version"] == "v3.0" and info["video_path"] is None
    assert (info["total_episodes"], info["total_frames"]) == (len(lerobot.samples), len(lerobot.frames))


def test_lerobots_splits_are_ranges_of_episodes(lerobot):
    ends = [0]
    for split, span in lerobot.info["splits"].items():
        begin, end = map(int, span.split(":"))
        assert begin == ends[-1] and end - begin == lerobot.dataset.splits[split]
        assert all(sample["label"]["split"] == split for sample in lerobot.samples[begin:end])
        ends.append(end)
    assert ends[-1] == len(lerobot.samples)


def test_lerobots_episodes_hold_labels_and_where_their_frames_are(lerobot):
    begin = 0
    for shard, row, sample in lerobot.episodes():
        label = sample["label"]
        assert row["gelsim/key"] == sample["key"] and json.loads(row["gelsim/label"]) == label
        assert row["tasks"] == [label["object"]["class"]] and row["gelsim/object"] == label["object"]["id"]
        assert (row["dataset_from_index"], row["length"]) == (begin, len(frames(sample)))
        assert (row["data/chunk_index"], row["data/file_index"]) == (0, shard)
        begin = row["dataset_to_index"]
    assert begin == len(lerobot.frames)


def test_lerobots_episodes_hold_statistics_of_their_images(lerobot):
    for _, row, sample in lerobot.episodes():
        for pads in zip(*frames(sample), strict=True):
            tactile = np.stack([frame["tactile"] for _, frame, _ in pads]) / 255
            known = {"mean": tactile.mean((0, 1, 2)), "std": tactile.std((0, 1, 2)), "max": tactile.max((0, 1, 2))}
            for name, ours in known.items():
                figure = row[f"stats/{dotted('images', pads[0][0])}.tactile/{name}"]
                assert np.allclose(np.ravel(figure), ours, atol=1e-6), name


IMAGES = {"tactile", "contact", "instance", "reference", "untouched", "slip"}
LENGTHS = {"depth", "surface", "gap"}


def floats(finger, frame):
    """LeRobot's features that are no 8-bit images, of a sensor in a frame: each as it comes, and as the layer has it."""
    found = {}
    for name, value in frame.items():
        if name in LENGTHS:
            found[f"{dotted('images', finger)}.{name}"] = value
        elif name in ("markers", "pins"):
            found |= {f"{dotted(name, finger)}.{key}": np.float32(points) for key, points in value.items()}
        elif getattr(value, "dtype", None) == np.float32:
            found[f"{dotted('layers', finger)}.{name}"] = value if value.ndim == 3 else value[..., None]
    return found


def expected_array(feature, value):
    """What a feature of this shape holds: positions with NaN in rows that the frame does not have."""
    if value.shape[1:] != tuple(feature["shape"][1:]) or len(value) == feature["shape"][0]:
        return value
    return np.concatenate([value, np.full((feature["shape"][0] - len(value), value.shape[1]), np.nan, "float32")])


def stored_array(feature, value):
    """A feature of a row, as its shape says."""
    if feature["dtype"] == "image":
        image = Image.open(io.BytesIO(value["bytes"]), formats=["TIFF"])
        assert image.mode == "F" and image.info["compression"] == "raw" and value["path"].endswith(".tiff")
        return np.asarray(image)
    return np.array(value, "float32")


def test_lerobots_features_are_the_columns(lerobot):
    features = set(lerobot.info["features"])
    assert all(set(table.column_names) == features for table in lerobot.tables())
    assert not any("/" in name for name in features)
    for _, _, pads in lerobot.frames:
        known = {"timestamp", "frame_index", "episode_index", "index", "task_index"}
        for finger, frame, _ in pads:
            known |= {dotted("state", finger), dotted("wrench", finger)}
            known |= {f"{dotted('images', finger)}.{name}" for name in IMAGES.intersection(frame)}
            known |= floats(finger, frame).keys()
        assert features == known


def test_lerobots_rows_hold_float_layers_and_positions_bit_by_bit(lerobot):
    for row, (_, _, pads) in lerobot.rows():
        for finger, frame, _ in pads:
            for name, value in floats(finger, frame).items():
                feature = lerobot.info["features"][name]
                stored, ours = stored_array(feature, row[name]), expected_array(feature, value)
                assert stored.shape == ours.shape and stored.tobytes() == ours.tobytes(), name
                assert list(stored.shape) == feature["shape"][: stored.ndim] and lerobot.info["gelsim"]["units"][name]


def test_lerobots_depth_maps_are_marked_as_it_marks_them(lerobot):
    for name, feature in lerobot.info["features"].items():
        depth = name.startswith("observation.images.") and name.rsplit(".", 1)[1] in LENGTHS
        assert feature.get("info") == ({"is_depth_map": True, "depth_unit": "mm"} if depth else None), name
        if depth:
            assert feature["dtype"] == "image" and feature["shape"][2] == 1, name
            assert feature["names"] == ["height", "width", "channels"], name


def test_lerobots_markers_have_as_many_rows_as_any_frame(lerobot):
    """Where not all frames have as many, the file says what the others hold."""
    counts = {}
    for _, _, pads in lerobot.frames:
        for finger, frame, _ in pads:
            for layer in {"markers", "pins"}.intersection(frame):
                for key, points in frame[layer].items():
                    counts.setdefault(f"{dotted(layer, finger)}.{key}", set()).add(len(points))
    for name, numbers in counts.items():
        assert lerobot.info["features"][name]["shape"][0] == max(numbers)
        assert ("NaN in rows" in lerobot.info["gelsim"]["units"][name]) == (len(numbers) > 1)


def test_a_kind_has_markers_that_are_not_as_many_in_all_frames(every_kind):
    """Otherwise no test would see rows of NaN."""
    assert len({len(sample["markers"]["rest_px"]) for sample in every_kind.samples("halves")}) > 1


def test_lerobots_rows_are_numbered(lerobot):
    for index, (row, (sample, number, _)) in enumerate(lerobot.rows()):
        assert (row["index"], row["frame_index"]) == (index, number)
        assert lerobot.samples[row["episode_index"]] is sample
        assert row["timestamp"] == np.float32(number / lerobot.info["fps"])
        assert lerobot.dataset.classes[row["task_index"]] == sample["label"]["object"]["class"]


def test_lerobots_rows_hold_images_pose_and_wrench(lerobot):
    features = lerobot.info["features"]
    for row, (_, _, pads) in lerobot.rows():
        for finger, frame, part in pads:
            for name in IMAGES.intersection(frame):
                feature = f"{dotted('images', finger)}.{name}"
                image = np.asarray(Image.open(io.BytesIO(row[feature]["bytes"])))
                assert list(image.shape) == features[feature]["shape"], name
                ours = frame[name] if frame[name].ndim == 3 else np.stack([frame[name]] * 3, axis=2)
                assert np.array_equal(image, ours), name
            wrench = dotted("wrench", finger)
            assert row[dotted("state", finger)] == np.array(pose(part), "float32").tolist()
            assert equal(row[wrench][2], np.float32(normal_force(part)))
            assert len(row[wrench]) == features[wrench]["shape"][0]
            if "wrench" in part:
                assert row[wrench] == np.float32(part["wrench"]["force_n"] + part["wrench"]["torque_nmm"]).tolist()


def test_lerobots_tasks_are_the_classes(lerobot):
    tasks, classes = parquet.read_table(lerobot.out / "meta/tasks.parquet").to_pandas(), lerobot.dataset.classes
    assert tasks.index.tolist() == classes and tasks.task_index.tolist() == list(range(len(classes)))


def test_lerobots_statistics_are_those_of_all_rows(lerobot):
    stats = json.loads((lerobot.out / "meta/stats.json").read_text())
    assert stats.keys() == lerobot.info["features"].keys()
    rows = lerobot.rows()
    for state in [dotted("state", finger) for finger, _, _ in lerobot.frames[0][2]]:
        states = np.array([row[state] for row, _ in rows])
        for name in ["mean", "std", "min", "max"]:
            assert np.allclose(stats[state][name], getattr(states, name)(0), atol=1e-5), name
        assert stats[state]["count"] == [len(rows)]


def test_lerobots_statistics_of_float_layers_are_those_of_all_pixels(lerobot):
    """Of each component in its unit, (1, 1, 1) of depth maps; quantiles of each episode to 1/128."""
    stats = json.loads((lerobot.out / "meta/stats.json").read_text())
    features, values = lerobot.info["features"], {}
    for row, (_, _, pads) in lerobot.rows():
        for name in {name for finger, frame, _ in pads for name in floats(finger, frame)}:
            array = stored_array(features[name], row[name])
            array = array[..., None] if features[name]["dtype"] == "image" else array
            values.setdefault(name, []).append((row["episode_index"], array.reshape(-1, array.shape[-1]).astype("float64")))
    episodes = {row["episode_index"]: row for _, row, _ in lerobot.episodes()}
    for name, frames in values.items():
        shape = (1, 1, 1) if features[name]["dtype"] == "image" else frames[0][1].shape[-1:]
        whole = np.concatenate([each for _, each in frames])
        assert stats[name]["count"] == [len(frames)]
        assert np.shape(stats[name]["q50"]) == shape
        for figure, of in {"min": np.nanmin, "max": np.nanmax}.items():
            assert np.array_equal(np.reshape(stats[name][figure], -1), of(whole, axis=0)), (name, figure)
        if not np.isnan(whole).any():  # Frames with fewer markers weigh as much as others.
            for figure, of in {"mean": np.mean, "std": np.std}.items():
                assert np.allclose(np.reshape(stats[name][figure], -1), of(whole, axis=0), rtol=1e-6, atol=1e-9), (name, figure)
        for episode, row in episodes.items():
            its = np.concatenate([each for at, each in frames if at == episode])
            for figure, of in {"min": np.nanmin, "mean": np.nanmean, "std": np.nanstd}.items():
                found = row[f"stats/{name}/{figure}"]
                assert np.shape(found) == shape
                assert np.allclose(np.reshape(found, -1), of(its, axis=0), rtol=1e-6, atol=1e-9), (name, figure)
            for figure, share in {"q01": 0.01, "q50": 0.5, "q99": 0.99}.items():
                found = np.reshape(row[f"stats/{name}/{figure}"], -1)
                exact = np.nanquantile(its, share, axis=0, method="inverted_cdf")
                assert np.all(np.abs(found - exact) <= np.abs(exact) / 128), (name, figure)


def test_a_lerobot_copy_is_read_by_datasets(lerobot, tmp_path):
    """By what its card says of it: images come as images; each split by itself, too."""
    from datasets import load_dataset

    all_frames = load_dataset(str(lerobot.out), cache_dir=str(tmp_path))
    assert list(all_frames) == ["train"]
    for row, (_, _, pads) in zip(all_frames["train"], lerobot.frames, strict=True):
        for finger, frame, part in pads:
            assert np.array_equal(np.asarray(row[f"{dotted('images', finger)}.tactile"]), frame["tactile"])
            assert row[dotted("state", finger)] == np.array(pose(part), "float32").tolist()
    ours = {}
    for index, (sample, _, _) in enumerate(lerobot.frames):
        ours.setdefault(sample["label"]["split"], []).append(index)
    parts = load_dataset(str(lerobot.out), "splits", cache_dir=str(tmp_path))
    assert {split: part["index"][:] for split, part in parts.items()} == ours


def features_for_datasets(features):
    """What LeRobot makes of its features before it reads the files of frames, after its documentation."""
    from datasets import Array2D, Array3D, Features, Image, Sequence, Value

    made = {}
    for name, its in features.items():
        shape = tuple(its["shape"])
        if its["dtype"] == "image":
            made[name] = Image()
        elif shape == (1,):
            made[name] = Value(its["dtype"])
        elif len(shape) == 1:
            made[name] = Sequence(Value(its["dtype"]), length=shape[0])
        else:
            made[name] = {2: Array2D, 3: Array3D}[len(shape)](shape, its["dtype"])
    return Features(made)


def test_lerobots_features_read_its_files(lerobot, tmp_path):
    """Depth comes as an image of floats, as its reader takes it, and arrays in their shapes."""
    from datasets import Dataset

    files = sorted(map(str, lerobot.out.glob("data/*/*.parquet")))
    features = lerobot.info["features"]
    read = Dataset.from_parquet(files, features=features_for_datasets(features), cache_dir=str(tmp_path))
    for row, (_, _, pads) in zip(read, lerobot.frames, strict=True):
        for finger, frame, _ in pads:
            for name, value in floats(finger, frame).items():
                stored = np.asarray(row[name], "float32")
                assert features[name]["dtype"] != "image" or row[name].mode == "F"
                assert stored.tobytes() == expected_array(features[name], value).tobytes(), name


def in_this_process(source, out, *more):
    with contextlib.redirect_stderr(io.StringIO()) as said:
        status = command.main([str(source), "--to", "lerobot", "--out", str(out), *more])
    return status, said.getvalue()


def test_lerobots_files_of_frames_end_between_episodes_once_they_are_large(copies, every_kind, tmp_path, monkeypatch):
    """At 0 MB each episode has a file of its own; one that was stopped goes on to the same bytes."""
    from datasets import load_dataset

    monkeypatch.setattr(lerobot_format, "FILE_MB", 0)
    dataset = every_kind.load("forceless")
    whole, stopped = tmp_path / "whole.lerobot", tmp_path / "stopped.lerobot"
    assert in_this_process(dataset.path, whole)[0] == 0
    status, said = in_this_process(dataset.path, whole, "--check")
    assert status == 0 and "bit for bit" in said
    files = sorted(whole.glob("data/*/*.parquet"))
    assert [set(parquet.read_table(path)["episode_index"].to_pylist()) for path in files] == [{at} for at in range(len(dataset))]
    rows = [row for path in sorted(whole.glob("meta/episodes/*/*.parquet")) for row in parquet.read_table(path).to_pylist()]
    assert [row["data/file_index"] for row in rows] == [row["episode_index"] for row in rows] == list(range(len(dataset)))
    splits = load_dataset(str(whole), "splits", cache_dir=str(tmp_path / "cache"))
    assert {split: len(part) for split, part in splits.items()} == dataset.splits
    assert len(files) > len(dataset.shards) > 1

    source = shutil.copytree(dataset.path, tmp_path / "source")
    shard = source / dataset.shards[-1].path.relative_to(dataset.path)
    aside = shard.rename(tmp_path / "aside")
    assert in_this_process(source, stopped)[0] == 1
    aside.rename(shard)
    assert in_this_process(source, stopped)[0] == 0
    assert content(stopped) == content(whole)


def test_lerobots_groups_of_rows_are_small(every_kind, tmp_path, monkeypatch):
    """Readers have whole groups in memory."""
    monkeypatch.setattr(lerobot_format, "BYTES_IN_GROUP", 1)
    path, out = every_kind.path("halves"), tmp_path / "copy"
    assert in_this_process(path, out)[0] == 0 and in_this_process(path, out, "--check")[0] == 0
    for file in out.glob("data/*/*.parquet"):
        about = parquet.ParquetFile(file).metadata
        assert [about.row_group(group).num_rows for group in range(about.num_row_groups)] == [1] * about.num_rows


# Ends with 3 where there is no LeRobot.
LEROBOT = """
import sys
try:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
except ImportError:
    sys.exit(3)
root, frames = sys.argv[1], int(sys.argv[2])
dataset = LeRobotDataset("local/copy", root=root)
assert len(dataset) == frames == sum(dataset.meta.episodes["length"])
assert dataset.num_episodes == len(dataset.meta.episodes)
for index in range(frames):
    item = dataset[index]
    images = [name for name in dataset.features if name.startswith("observation.images.") and name.endswith("tactile")]
    states = [name for name in dataset.features if name.startswith("observation.state")]
    assert len(images) == len(states) > 0
    assert all(item[name].shape[0] == 3 for name in images) and all(item[name].shape == (7,) for name in states)
    for name, its in dataset.features.items():
        height, width, *channels = its["shape"] if len(its["shape"]) == 3 else (0, 0)
        if channels == [1] and its["dtype"] == "image":
            assert item[name].shape == (1, height, width) and str(item[name].dtype) == "torch.float32", name
            assert float(dataset.meta.stats[name]["min"].min()) <= float(item[name].min()), name
        elif len(its["shape"]) > 1 and its["dtype"] == "float32":
            assert item[name].shape == tuple(its["shape"]) and str(item[name].dtype) == "torch.float32", name
    assert item["index"] == index and item["task"] in dataset.meta.tasks.index
depth = [name for name, its in dataset.features.items() if (its.get("info") or {}).get("is_depth_map")]
if hasattr(dataset.meta, "depth_keys"):  # since 0.6
    assert dataset.meta.depth_keys == depth
part = LeRobotDataset("local/copy", root=root, episodes=[1])
assert len(part) == dataset.meta.episodes[1]["length"] and part[0]["episode_index"] == 1
"""


@pytest.mark.parametrize("kind", ["halves", "tactip", "frames", "lifts"])
def test_lerobots_own_class_reads_a_copy(lerobot, torch_python):
    line = [torch_python, "-c", LEROBOT, lerobot.out, str(len(lerobot.frames))]
    done = subprocess.run(line, capture_output=True, text=True)
    if done.returncode == 3:
        pytest.skip(f"{torch_python} has no lerobot: pip install lerobot")
    assert done.returncode == 0, done.stderr


def turned(vector, points):
    """Points turned by a rotation vector, after Rodrigues."""
    angle = np.linalg.norm(vector)
    axis = vector / angle if angle > 0 else np.array([1.0, 0.0, 0.0])
    along = np.outer(points @ axis, axis)
    return along + np.cos(angle) * (points - along) + np.sin(angle) * np.cross(axis, points)


def turned_by_quaternion(quaternion, points):
    """Points turned by a unit quaternion x, y, z, w."""
    axis, w = np.array(quaternion[:3]), quaternion[3]
    cross = 2 * np.cross(axis, points)
    return points + w * cross + np.cross(axis, cross)


@pytest.fixture(params=["zarr", "zip"])
def zarr_root(request, copies, kind):
    out = copies.path(kind, request.param)
    if request.param == "zarr":
        yield zarr.open_group(out, mode="r", zarr_format=2)
    else:
        with zarr.storage.ZipStore(out, mode="r") as store:
            yield zarr.open_group(store, mode="r", zarr_format=2)


@pytest.fixture
def zarr_pads(every_kind, kind):
    """Of each pad of each frame the pad's name, the frame's number among all, its arrays and its part of the label."""
    every = enumerate(pads for sample in every_kind.samples(kind) for pads in frames(sample))
    return [(f"pad{pad}", at, frame, part) for at, pads in every for pad, (_, frame, part) in enumerate(pads)]


def test_zarrs_arrays_have_a_row_for_each_frame(zarr_root, every_kind, kind):
    ends = zarr_root["meta/episode_ends"][:]
    assert ends.dtype == np.int64
    assert ends.tolist() == np.cumsum([len(frames(sample)) for sample in every_kind.samples(kind)]).tolist()
    assert {array.shape[0] for _, array in zarr_root["data"].arrays()} == {int(ends[-1])}


def test_zarrs_classes_are_those_of_the_samples(zarr_root, every_kind, kind):
    classes = every_kind.load(kind).classes
    assert zarr_root.attrs["classes"] == classes
    for sample, index in zip(every_kind.samples(kind), zarr_root["meta/class_index"][:], strict=True):
        assert classes[index] == sample["label"]["object"]["class"]


def test_zarrs_pads_are_named_by_their_fingers(zarr_root, every_kind, kind):
    fingers = [finger for finger, _, _ in frames(every_kind.samples(kind)[0])[0]]
    known = {f"pad{number}": finger for number, finger in enumerate(fingers)}
    assert zarr_root.attrs.get("fingers", {"pad0": ""}) == known
    assert zarr_root.attrs["pads"].keys() == {name.split("_")[0] for name in zarr_root["data"] if name != "timestamp"}


def test_zarrs_layers_are_the_datasets(zarr_root, zarr_pads):
    for pad, at, frame, _ in zarr_pads:
        for name, value in frame.items():
            if isinstance(value, np.ndarray):
                array = zarr_root[f"data/{pad}_{name}"]
                assert array.chunks == (1, *value.shape) and array.attrs["unit"], name
                assert np.array_equal(array[at], value) and array.dtype == value.dtype, name


def test_zarrs_poses_are_rotation_vectors(zarr_root, zarr_pads):
    points = np.eye(3)
    for pad, at, _, part in zarr_pads:
        its, known = zarr_root[f"data/{pad}_pose"][at], pose(part)
        assert its.shape == (6,) and its[:3].tolist() == known[:3]
        assert np.allclose(turned(its[3:], points), turned_by_quaternion(known[3:], points), rtol=0, atol=1e-12)


def test_zarrs_forces_and_times_are_the_labels(zarr_root, zarr_pads):
    for pad, at, _, part in zarr_pads:
        assert equal(zarr_root[f"data/{pad}_wrench"][at][2], normal_force(part))
        assert "t_s" not in part or zarr_root["data/timestamp"][at] == part["t_s"]


def test_zarrs_markers_are_one_frames_after_anothers(zarr_root, zarr_pads):
    for pad, at, frame, _ in zarr_pads:
        if "markers" in frame:
            ends = zarr_root[f"ragged/{pad}_markers_ends"]
            dots = zarr_root[f"ragged/{pad}_markers_moved_px"][int(ends[at - 1]) if at else 0 : int(ends[at])]
            assert np.array_equal(dots, frame["markers"]["moved_px"]) and len(dots)


SEVERAL = """
dataset = {{ name = "several", samples = 4, seed = 3 }}
sensor = {{ preset = ["gelsight-mini", "geltip"], resolution_px = [48, 36] }}
object = [{{ path = "{objects}/sphere.obj", scale = [0.5, 1.5] }}]
indentation.depth_mm = [0.3, 0.8]
"""


@pytest.fixture(scope="module")
def several(run_gelsim, project, tmp_path_factory):
    """A dataset of flat and curved sensors, the first one flat; and its copies."""
    folder = tmp_path_factory.mktemp("several")
    (folder / "job.toml").write_text(SEVERAL.format(objects=project / "objects"))
    source = run_gelsim.generate(folder / "job.toml", folder / "source")
    for form in ["lerobot", "zarr", "hdf5"]:
        for more in [[], ["--check"]]:
            line = [source, "--to", form, "--out", place(folder, "several", form), "--quiet", *more]
            assert command.main(list(map(str, line))) == 0
    return source, lambda form: place(folder, "several", form)


def test_copies_of_several_sensors_name_them_and_keep_torques(several):
    source, copy = several
    labels = [sample["label"] for sample in gelsim.load(source)]
    assert [label["sensor"]["name"] for label in labels[:2]] == ["gelsight-mini", "geltip"]
    info = json.loads((copy("lerobot") / "meta/info.json").read_text())
    assert info["robot_type"] == "gelsight-mini|geltip" and info["features"]["observation.wrench"]["shape"] == [6]
    rows = parquet.read_table(copy("lerobot") / "data/chunk-000/file-000.parquet")["observation.wrench"].to_pylist()
    for row, label in zip(rows, labels, strict=True):
        torque = label["contact"]["torque_nmm"] or [np.nan] * 3
        assert equal(np.float32(torque), np.float32(row[3:]))
    assert zarr.open_group(copy("zarr"), mode="r", zarr_format=2).attrs["pads"] == {"pad0": "gelsight-mini|geltip"}


def test_poses_say_that_objects_are_scaled(several):
    _, copy = several
    with h5py.File(copy("hdf5")) as file:
        units = [group["pose"].attrs["unit"] for group in file.values()]
    root = zarr.open_group(copy("zarr"), mode="r", zarr_format=2)
    assert all("p = R (scale q) + t" in unit for unit in [*units, root["data/pad0_pose"].attrs["unit"]])


ONE_UNIT = """
dataset = {{ name = "unit", samples = 1, seed = 3 }}
sensors = {{ count = 2 }}
sensor = {{ resolution_px = [48, 36] }}
object = [{{ path = "{objects}/sphere.obj" }}]
indentation.depth_mm = [0.3, 0.8]
"""


def test_sitr_of_one_sensor_names_its_folder_among_the_calibration_presses(run_gelsim, project, tmp_path):
    (tmp_path / "job.toml").write_text(ONE_UNIT.format(objects=project / "objects"))
    presses = run_gelsim.generate(tmp_path / "job.toml", tmp_path / "presses")
    one = sorted(path for path in presses.iterdir() if path.is_dir())[1]
    said = run_export(one, "--to", "sitr", "--calibration", presses, "--out", tmp_path / "copy", status=2)
    assert f"name one sensor's folder in it: {one}" in said


NULLS = """
dataset = {{ name = "nulls", samples = 4, seed = 7, splits = {{ train = 0.5, val = 0.5 }}, split_by = "object" }}
sensor.resolution_px = [48, 36]
object = [
    {{ path = "{objects}/sphere.obj", youngs_modulus_kpa = 400.0, split = "train" }},
    {{ path = "{objects}/cube.obj", split = "val" }},
]
output = {{ container = "folder", layers = ["contact"] }}
indentation.depth_mm = [0.3, 0.8]
"""


def test_folders_with_nulls_in_one_split_are_read_split_by_split(run_gelsim, project, tmp_path):
    """As docs/reference/dataset.md says."""
    from datasets import load_dataset

    (tmp_path / "job.toml").write_text(NULLS.format(objects=project / "objects"))
    path = run_gelsim.generate(tmp_path / "job.toml", tmp_path / "nulls")
    cache = {"cache_dir": str(tmp_path / "cache")}
    for split, stiffness in [("train", 400.0), ("val", None)]:
        samples = load_dataset(str(path), data_files={split: f"data/{split}-*/*"}, split=split, **cache)
        assert samples["split"][:] == [split] * len(samples) and len(samples) == 2
        assert {each["material"]["youngs_modulus_kpa"] for each in samples["object"]} == {stiffness}
    assert [len(gelsim.load(path, split)) for split in ["train", "val"]] == [2, 2]


def test_a_zip_of_zarr_is_stored_without_compression(copies, kind):
    entries = zipfile.ZipFile(copies.path(kind, "zip")).infolist()
    assert {entry.compress_type for entry in entries} == {zipfile.ZIP_STORED}


@pytest.fixture
def hdf5(copies, kind):
    with h5py.File(copies.path(kind, "hdf5")) as file:
        yield file


@pytest.fixture
def hdf5_pads(hdf5, every_kind, kind):
    """Of each pad of each frame its group, the frame's place in it, its arrays and its part of the label."""
    pads = []
    for sample in every_kind.samples(kind):
        group = hdf5[sample["key"]]
        for number, each in enumerate(frames(sample)):
            at = number if "frames" in sample else ...
            pads += [(group[finger] if finger else group, at, frame, part) for finger, frame, part in each]
    return pads


def test_hdf5_has_a_group_with_label_for_each_sample(hdf5, every_kind, kind):
    samples = every_kind.samples(kind)
    assert sorted(hdf5) == sorted(sample["key"] for sample in samples)
    assert hdf5.attrs["classes"].tolist() == every_kind.load(kind).classes
    for sample in samples:
        group = hdf5[sample["key"]]
        assert json.loads(group["label"][()]) == sample["label"] and group.attrs["split"] == sample["label"]["split"]


def test_hdf5s_layers_are_the_datasets(hdf5_pads):
    for group, at, frame, _ in hdf5_pads:
        for name, value in frame.items():
            if isinstance(value, np.ndarray):
                assert np.array_equal(group[name][at], value) and group[name].attrs["unit"], name


def test_hdf5s_poses_and_forces_are_the_labels(hdf5_pads):
    for group, at, _, part in hdf5_pads:
        assert group["pose"][at].tolist() == pose(part) and equal(group["wrench"][at][2], normal_force(part))


def test_hdf5s_markers_are_the_datasets(hdf5_pads):
    for group, at, frame, _ in hdf5_pads:
        if "markers" in frame:
            ends, number = ([0, None], 0) if at is ... else ([0, *group["markers/ends"]], at)
            dots = group["markers/moved_px"][ends[number] : ends[number + 1]]
            assert np.array_equal(dots, frame["markers"]["moved_px"])


# Three shards and more, of one sensor and of two.
@pytest.mark.parametrize("kind, form", [*(("halves", form) for form in FORMATS), ("grips", "zarr")])
def test_an_export_that_was_killed_goes_on_to_the_same_bytes(copies, every_kind, kind, form, tmp_path):
    again = place(tmp_path, "killed", form)
    partial = again.with_name(again.name + ".partial")
    done = lambda: len(list(partial.glob("parts/0*.json")))
    source = every_kind.path(kind)
    for parts in [1, 2]:
        line = [*COMMAND, source, "--to", FORMATS[form], "--out", again]
        process = subprocess.Popen([str(word) for word in line], stderr=subprocess.DEVNULL)
        while process.poll() is None and done() < parts:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, "it was done before it could be killed"
        assert not again.exists() and done() >= parts
    with open(partial / "export.json") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert "another process is writing it" in export(source, form, again, status=2)
    # What a kill in the middle of a file leaves.
    for torn in [*partial.glob("parts/*.tmp"), *partial.glob("out/**/*.tmp")]:
        torn.write_bytes(b"torn")
    export(source, form, again)
    assert content(again) == content(copies.path(kind, form)) and not partial.exists()


def test_an_export_on_a_full_disk_says_so_and_goes_on_once_there_is_room(copies, every_kind, form, tmp_path):
    """On disks that fill up at tenths of the copy's size."""
    out = copies.path("frames", form)
    expected, filled = content(out), 0
    size = sum(map(len, expected.values()))
    for tenths in range(1, 10, 2):
        disk, again = tmp_path / f"disk-{tenths}", tmp_path / f"again-{tenths}-{out.name}"
        disk.mkdir()
        copy = disk / out.name
        line = [*COMMAND, every_kind.path("frames"), "--to", FORMATS[form], "--out", copy]
        filled += fill_disk(line, copy, size * tenths // 10240 + 4, again).returncode
        assert content(again) == expected, tenths
    assert filled > 1, "the disk is rarely full"


def duplicate(copies, kind, form, folder):
    """A copy that may be changed."""
    source = copies.path(kind, form)
    out = folder / source.name
    return shutil.copytree(source, out) if source.is_dir() else Path(shutil.copy(source, out))


# Of two fingers the right one.
each_pad = pytest.mark.parametrize("kind, finger", [("halves", ""), ("grips", "right")])


@pytest.fixture
def second_key(every_kind, kind):
    return every_kind.samples(kind)[1]["key"]


@each_pad
def test_a_changed_pixel_or_number_in_hdf5_is_found(copies, every_kind, second_key, kind, finger, tmp_path):
    out, source = duplicate(copies, kind, "hdf5", tmp_path), every_kind.path(kind)
    tactile, wrench = (f"{finger}/{name}".lstrip("/") for name in ["tactile", "wrench"])
    with h5py.File(out, "r+") as file:
        file[second_key][tactile][2, 3, 1] ^= 1
    assert f"sample {second_key}: {tactile} differs" in export(source, "hdf5", out, "--check", status=1)
    with h5py.File(out, "r+") as file:
        file[second_key][tactile][2, 3, 1] ^= 1
        file[second_key][wrench][0] = np.nextafter(file[second_key][wrench][0], 9)
    assert f"sample {second_key}: {wrench} differs" in export(source, "hdf5", out, "--check", status=1)


@each_pad
def test_a_changed_broken_or_missing_chunk_of_zarr_is_found(copies, every_kind, second_key, kind, finger, tmp_path):
    out, source = duplicate(copies, kind, "zarr", tmp_path), every_kind.path(kind)
    root = zarr.open_group(out, mode="r+", zarr_format=2)
    tactile = "pad1_tactile" if finger == "right" else "pad0_tactile"
    image = root[f"data/{tactile}"][1]
    image[2, 3, 1] ^= 1
    root[f"data/{tactile}"][1] = image
    assert f"sample {second_key}: {tactile} differs" in export(source, "zarr", out, "--check", status=1)
    (out / f"data/{tactile}/1.0.0.0").write_bytes(b"no chunk")
    assert f"sample {second_key}: it cannot be read" in export(source, "zarr", out, "--check", status=1)
    (out / f"data/{tactile}/1.0.0.0").unlink()
    assert f"sample {second_key}: {tactile} differs" in export(source, "zarr", out, "--check", status=1)


@pytest.mark.parametrize("kind", ["halves", "grips"])
def test_a_zip_that_is_cut_off_is_found(copies, every_kind, kind, tmp_path):
    out = duplicate(copies, kind, "zip", tmp_path)
    out.write_bytes(out.read_bytes()[:-30])
    export(every_kind.path(kind), "zip", out, "--check", status=2)


@each_pad
def test_a_changed_pixel_or_missing_file_of_lerobot_is_found(copies, every_kind, second_key, kind, finger, tmp_path):
    out, source = duplicate(copies, kind, "lerobot", tmp_path), every_kind.path(kind)
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
    assert f"sample {second_key}: {tactile} differs" in export(source, "lerobot", out, "--check", status=1)
    path.unlink()
    export(source, "lerobot", out, "--check", status=1)


def changed_depth(stored):
    values = np.array(Image.open(io.BytesIO(stored["bytes"])))
    values[2, 3] = np.nextafter(values[2, 3], np.float32(9))
    file = io.BytesIO()
    Image.fromarray(values).save(file, "TIFF")
    return {**stored, "bytes": file.getvalue()}


def changed_array(stored):
    values = np.array(stored, "float32")
    values.flat[5] = np.nextafter(values.flat[5], np.float32(9))
    return values.tolist()


CHANGES = {"images": changed_depth, "layers": changed_array, "markers": changed_array}


@pytest.mark.parametrize(
    "kind, feature",
    [
        ("halves", "observation.images.depth"),
        ("halves", "observation.layers.traction"),
        ("halves", "observation.layers.pressure"),
        ("halves", "observation.markers.moved_px"),
        ("grips", "observation.images.right.depth"),
        ("grips", "observation.markers.right.rest_px"),
    ],
)
def test_a_changed_float_of_lerobot_is_found(copies, every_kind, second_key, kind, feature, tmp_path):
    out = duplicate(copies, kind, "lerobot", tmp_path)
    path = out / "data/chunk-000/file-000.parquet"
    table = parquet.read_table(path)
    rows = table.to_pylist()
    rows[1][feature] = CHANGES[feature.split(".")[1]](rows[1][feature])
    parquet.write_table(table.from_pylist(rows, table.schema), path)
    assert f"sample {second_key}: {feature} differs" in export(every_kind.path(kind), "lerobot", out, "--check", status=1)


def test_a_copy_of_lerobot_without_float_layers_is_of_an_older_export(copies, every_kind, tmp_path):
    out = duplicate(copies, "halves", "lerobot", tmp_path)
    about = out / "meta/gelsim.json"
    about.write_text(json.dumps({**json.loads(about.read_text()), "exporter": 1}))
    assert "name another --out" in export(every_kind.path("halves"), "lerobot", out, status=2)


def test_a_folder_of_the_users_is_left_alone(every_kind, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert "name another --out" in export(every_kind.path("halves"), "zarr", tmp_path, status=2)
    assert content(tmp_path) == {"notes.txt": b"mine"}


def test_a_copy_of_another_dataset_is_left_alone(copies, every_kind, form):
    taken, mine, other = copies.path("forceless", form), every_kind.path("halves"), every_kind.path("forceless")
    before = content(taken)
    assert "name another --out" in export(mine, form, taken, status=2)
    assert "no " in export(mine, form, taken, "--check", status=2)
    assert "already" in export(other, form, taken)
    assert content(taken) == before


def test_a_copy_that_is_not_there_is_not_compared(every_kind, form, tmp_path):
    absent = place(tmp_path, "absent", form)
    export(every_kind.path("halves"), form, absent, "--check", status=2)
    assert not absent.exists()


@pytest.mark.parametrize("holds", ["nothing", "another file"])
def test_a_partial_copy_that_is_none_is_to_be_moved_away(copies, every_kind, tmp_path, holds):
    left = tmp_path / "left.hdf5.partial"
    left.mkdir()
    if holds == "another file":
        shutil.copy(copies.path("forceless", "hdf5"), left / "export.json")
    assert "move it away" in export(every_kind.path("halves"), "hdf5", tmp_path / "left.hdf5", status=2)


def test_a_folder_that_is_no_dataset_is_refused(tmp_path):
    assert "no dataset" in export(tmp_path, "hdf5", tmp_path / "none.hdf5", status=2)


WITHOUT = """
import sys
sys.modules |= dict.fromkeys(sys.argv.pop(1).split())
from gelsim.export.command import main
sys.exit(main())
"""


LIBRARIES = [("h5py", "hdf5"), ("pyarrow", "zarr"), ("pyarrow PIL", "lerobot"), ("OpenEXR", "zarr"), ("OpenEXR", "lerobot")]


@pytest.mark.parametrize("names, to", LIBRARIES)
def test_libraries_that_are_not_installed_are_named_in_one_line(every_kind, tmp_path, names, to):
    line = [sys.executable, "-c", WITHOUT, names, every_kind.path("halves"), "--to", to, "--out", tmp_path / "none"]
    said = run(*line, status=2).stderr
    assert said.count("\n") == 1 and "not installed: " in said
    wanted = [{"PIL": "pillow"}.get(name, name) for name in names.split()]
    assert all(f" '{name}>=" in said for name in wanted) and "pip install '" in said
    assert not (tmp_path / "none").exists()


def test_an_export_of_a_damaged_dataset_goes_on_once_that_is_repaired(copies, every_kind, form, tmp_path):
    dataset = every_kind.load("halves")
    source, out = shutil.copytree(dataset.path, tmp_path / "source"), place(tmp_path, "stopped", form)
    shard = source / dataset.shards[-1].path.relative_to(dataset.path)
    aside = shard.rename(tmp_path / "aside")
    assert shard.name in export(source, form, out, status=1) and not out.exists()
    aside.rename(shard)
    export(source, form, out)
    assert content(out) == content(copies.path("halves", form))


GUESSES = {
    "h5": "did you mean hdf5?",
    "HDF5": "did you mean hdf5?",
    "parquet": "did you mean lerobot?",
    "le-robot": "did you mean lerobot?",
    "zar": "did you mean zarr?",
    "rlds": "no such copy",
    "webdataset": "`gelsim generate` writes it",
    "npz": "gelsim.load",
    "sparsh": "did you mean tacbench?",
    "T3": "did you mean fota?",
    "xml": "one of lerobot, zarr, hdf5, fota, tacbench, touchd, ftp1 or sitr",
}


@pytest.mark.parametrize("guess", GUESSES)
def test_a_guessed_format_is_answered_with_the_right_one(guess):
    assert GUESSES[guess] in run_export("x", "--to", guess, "--out", "y", status=2)


@pytest.mark.parametrize("address", ["s3://b/x", "s3:/b/x", "gs:/b/x", "S3://b/x", "https://example.org/x"])
def test_an_address_is_no_place_for_a_copy_or_a_dataset(every_kind, tmp_path, address):
    out = run_export(every_kind.path("halves"), "--to", "hdf5", "--out", address, status=2, cwd=tmp_path)
    assert "is an address: name a folder" in out
    assert "is an address" in run_export(address, "--to", "hdf5", "--out", "y", status=2, cwd=tmp_path)
    assert not list(tmp_path.iterdir()), "a folder is called after an address"


@pytest.mark.parametrize("address", ["file:/data/x", "file:///data/x"])
def test_an_address_of_a_file_is_to_be_a_path(every_kind, tmp_path, address):
    said = run_export(every_kind.path("halves"), "--to", "hdf5", "--out", address, status=2, cwd=tmp_path)
    assert "write the path alone, /data/x" in said and not list(tmp_path.iterdir())


def test_the_home_folder_of_nobody_is_refused(every_kind, tmp_path):
    nobody = "~nobody-of-this-name/x"
    said = run_export(every_kind.path("halves"), "--to", "hdf5", "--out", nobody, status=2, cwd=tmp_path)
    assert f"write ./{nobody}" in said and not list(tmp_path.iterdir())


def test_a_tilde_is_the_home_folder_and_quiet_says_nothing(every_kind, tmp_path):
    home = {**os.environ, "HOME": str(tmp_path)}
    assert run_export(every_kind.path("halves"), "--to", "hdf5", "-q", "-o", "~/x.h5", env=home) == ""
    assert (tmp_path / "x.h5").is_file()


def test_a_file_is_no_folder_for_a_copy(every_kind, tmp_path):
    (tmp_path / "afile").write_text("")
    said = run_export(every_kind.path("halves"), "--to", "hdf5", "--out", "afile/x", status=1, cwd=tmp_path)
    assert "afile: File exists; it is a file" in said


@pytest.mark.parametrize("out", [".", "", "/", ".."])
def test_a_copy_has_a_new_name(every_kind, tmp_path, out):
    said = run_export(every_kind.path("halves"), "--to", "zarr", "--out", out, status=2, cwd=tmp_path)
    assert "name a new folder, such as ./copy" in said and not list(tmp_path.iterdir())


def test_a_job_file_is_no_dataset(tmp_path):
    (tmp_path / "j.toml").write_text("")
    said = run_export("j.toml", "--to", "zarr", "--out", "copy", status=2, cwd=tmp_path)
    assert "j.toml is a file: name the folder of a dataset" in said


def test_a_zip_is_one_whatever_the_case_of_its_ending(every_kind, tmp_path):
    run_export(every_kind.path("forceless"), "--to", "zarr", "--out", tmp_path / "z.ZIP")
    assert zipfile.is_zipfile(tmp_path / "z.ZIP")


def test_what_is_to_be_compared_has_to_be_made_first(every_kind, tmp_path):
    said = run_export(every_kind.path("halves"), "--to", "hdf5", "--out", "absent", "--check", status=2, cwd=tmp_path)
    assert "without --check" in said


TELL = """
import sys, time; from gelsim.dataset import Dataset; from gelsim.export.command import Progress
progress = Progress(Dataset(sys.argv[1]), False); progress.told -= 1; progress.begun -= 1e-9; progress.tell(1)
progress.clear(); print('end', file=sys.stderr, flush=True)
"""


def shown_on_a_terminal(every_kind, columns, term):
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    line = [sys.executable, "-c", TELL, every_kind.path("halves")]
    subprocess.run(line, stderr=theirs, env={**os.environ, "TERM": term}, check=True)
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    return shown


@pytest.mark.parametrize("columns", [80, 12])
def test_progress_stays_within_the_terminal(every_kind, columns):
    line = shown_on_a_terminal(every_kind, columns, "xterm").split("\x1b[K")[1]
    assert "2/11" in line and len(line.strip("\r")) < columns


def test_a_dumb_terminal_has_no_progress(every_kind):
    assert shown_on_a_terminal(every_kind, 80, "dumb").strip() == "end"
