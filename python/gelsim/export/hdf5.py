"""HDF5: a group for each sample, of a gripper with one for each finger in it. A shard becomes a file of its own first; the last
step puts them together."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from itertools import zip_longest
from pathlib import Path
from typing import Any, Optional

from gelsim.dataset import Dataset, Pad, Raw
from gelsim.export import content
from gelsim.export.content import Arrays
from gelsim.export.parts import Place
from gelsim.needed import need
from gelsim.sample import Sample
from gelsim.vectors import FINGERS, POSE, WRENCH

LIBRARIES = ["numpy", "PIL.Image", "h5py"]
HAS_FLOATS = True
"""Layers of floats are read for it."""
VERSIONS = ("v110", "v110")
"""HDF5 1.10 or later: before it each array, also one of a single chunk, had a tree of chunks, which takes 18 kB of memory."""
POSE_UNIT = "mm (x, y, z) and quaternion (x, y, z, w); " + content.POSE


def source(out: Path) -> Any:
    """The identity of a finished copy; None if `out` is none."""
    try:
        with need("h5py").File(out, "r") as file:
            return json.loads(file.attrs["gelsim"])
    except (OSError, KeyError, TypeError, ValueError):
        return None


class Lenient(FileIO):
    """A file that takes what it cannot write, and keeps the first error: HDF5 cannot close a file on a full disk, and brings the
    process down when it ends."""

    failed: Optional[OSError] = None

    def write(self, data: Any) -> int:
        """All of it, or nothing from the first failure on."""
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while self.failed is None and len(left) > 0:
                left = left[super().write(left) :]
        except OSError as error:
            self.keep(error)
        return size

    def truncate(self, size: Optional[int] = None) -> int:
        """Makes it longer or shorter."""
        try:
            return super().truncate(size) if self.failed is None else size or 0
        except OSError as error:
            self.keep(error)
            return size or 0

    def keep(self, error: OSError) -> None:
        """Keeps what failed, by the file's name."""
        self.failed = OSError(error.errno, error.strerror, str(self.name))

    def check(self) -> None:
        """Raises what failed."""
        if self.failed is not None:
            raise self.failed


@contextmanager
def created(path: Path) -> Iterator[tuple[Any, Lenient]]:
    """A new HDF5 file, and the file that it is written to."""
    with Lenient(path, "w+") as file:
        try:
            with need("h5py").File(file, "w", libver=VERSIONS) as group:
                yield group, file
        except Exception:
            # Whatever HDF5 makes of it, that comes first.
            file.check()
            raise
        file.check()


class Writer:
    """Writes the parts."""

    def __init__(self, dataset: Dataset[Sample], folder: Path, out: Path, identity: dict[str, Any]) -> None:
        self.dataset, self.folder, self.identity = dataset, folder, identity
        self.h5py = need("h5py")

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes shard `number`."""
        path = self.folder / f"parts/{number:06}.h5"
        fresh = path.with_suffix(".tmp")
        with created(fresh) as (group, file):
            for raw in samples:
                write(group.create_group(raw.files.key), raw)
                file.check()
        os.replace(fresh, path)
        return {"file": path.name}

    def finish(self, parts: list[dict[str, Any]]) -> Path:
        """Copies all groups into one file."""
        path = self.folder / "whole.h5"
        with created(path) as (group, file):
            group.attrs["frame"] = content.FRAME
            group.attrs["classes"] = self.dataset.classes
            group.attrs["splits"] = json.dumps(self.dataset.splits)
            group.attrs["gelsim"] = json.dumps(self.identity)
            for part in parts:
                with self.h5py.File(self.folder / "parts" / part["file"], "r") as its:
                    for key in its:
                        its.copy(key, group)
                        file.check()
        return path


def write(group: Any, raw: Raw) -> None:
    """Writes a sample."""
    group.attrs["key"] = raw.files.key
    group.attrs["split"] = raw.label["split"]
    group.attrs["class"] = raw.label["object"]["class"]
    group.attrs["class_index"] = raw.label["object"]["class_index"]
    group.attrs["object"] = raw.label["object"]["id"]
    if "sequence" in raw.label:
        group.attrs["frame_rate_hz"] = content.frame_rate_hz(raw)
    text = need("h5py").string_dtype("utf-8", len(raw.label_json))
    group.create_dataset("label", data=raw.label_json, dtype=text).attrs["unit"] = "JSON"
    for pad in raw.pads:
        write_pad(group if pad.finger is None else group.create_group(pad.finger), raw, pad)


def write_pad(group: Any, raw: Raw, pad: Pad) -> None:
    """Writes what one sensor has; arrays of a sequence have the frames as their first axis."""
    numpy = need("numpy")
    sequence, count = "sequence" in raw.label, len(raw)
    for name, rows, parts, unit in [
        ("pose", content.poses(pad), POSE, POSE_UNIT),
        ("wrench", content.wrenches(pad), WRENCH, content.UNITS["wrench"]),
    ]:
        data = group.create_dataset(name, data=rows if sequence else rows[0])
        data.attrs["unit"], data.attrs["components"] = unit, parts
    dots: dict[str, list[Any]] = {}
    for number in range(count):
        for name, array in content.layers(raw, pad, number).items():
            if "/" in name:
                dots.setdefault(name, []).append(array)
                continue
            if name not in group:
                shape = (count, *array.shape) if sequence else array.shape
                chunks = (1, *array.shape) if sequence else array.shape
                made = group.create_dataset(name, shape, array.dtype, chunks=chunks, **PACKED)
                made.attrs["unit"] = content.UNITS[name]
            group[name][number if sequence else ...] = array
    for name, each in dots.items():
        group.create_dataset(name, data=numpy.concatenate(each)).attrs["unit"] = content.UNITS[name]
        if sequence:
            ends = group.require_dataset(name.split("/")[0] + "/ends", (count,), "int64")
            ends[:] = numpy.cumsum([len(of_frame) for of_frame in each])
            ends.attrs["unit"] = "rows before the end of each frame"


PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def expectation(dataset: Dataset[Sample]) -> Any:
    """What a copy holds of each frame of a sample."""

    def frames(raw: Raw, episode: int, first: int) -> Iterator[Arrays]:
        pads = [(pad, content.poses(pad), content.wrenches(pad)) for pad in raw.pads]
        for number in range(len(raw)):
            found: Arrays = {}
            for pad, poses, wrenches in pads:
                its = {**content.layers(raw, pad, number), "pose": poses[number], "wrench": wrenches[number]}
                found |= within(pad.finger, its)
            yield found

    return frames


def episodes(out: Path) -> Iterator[tuple[bytes, Iterator[Arrays]]]:
    """Label and frames of each sample."""
    with need("h5py").File(out, "r") as file:
        splits = {split: number for number, split in enumerate(json.loads(file.attrs["splits"]))}
        for key in sorted(file, key=lambda key: (splits[file[key].attrs["split"]], key)):
            yield bytes(file[key]["label"][()]), frames(file[key])


def within(finger: Optional[str], arrays: Arrays) -> Arrays:
    """What a finger's arrays are called in a sample's group: `left/tactile` and so on."""
    return arrays if finger is None else {f"{finger}/{name}": value for name, value in arrays.items()}


def frames(group: Any) -> Iterator[Arrays]:
    """The frames of a sample."""
    sequence = "frame_rate_hz" in group.attrs
    fingers: list[Optional[str]] = [finger for finger in FINGERS if finger in group] or [None]
    each = [frames_of_pad(group if finger is None else group[finger], sequence) for finger in fingers]
    for of_pads in zip_longest(*each, fillvalue={}):
        found: Arrays = {}
        for finger, its in zip(fingers, of_pads):
            found |= within(finger, its)
        yield found


def frames_of_pad(group: Any, sequence: bool) -> Iterator[Arrays]:
    """The frames of one sensor."""
    numpy = need("numpy")
    for number in range(len(group["pose"]) if sequence else 1):
        found: Arrays = {}
        for name, value in group.items():
            if name == "label":
                continue
            if not hasattr(value, "keys"):
                found[name] = numpy.asarray(value[number] if sequence else value[()])
                continue
            ends = [0, *value["ends"]] if sequence else [0, None]
            for part in value:
                if part != "ends":
                    found[f"{name}/{part}"] = value[part][ends[number] : ends[number + 1]]
        yield found
