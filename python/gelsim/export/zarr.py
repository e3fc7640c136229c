"""Zarr v2: arrays over all frames, as replay buffers have them. Images are written where they stay; what is small waits in
the parts of an export and is written at its end."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, Optional

from gelsim.dataset import Dataset, Pad, Raw
from gelsim.export import content
from gelsim.export.content import Arrays
from gelsim.export.parts import Place, write
from gelsim.export.zarr_v2 import Read, Store, Written, make_group
from gelsim.needed import need
from gelsim.sample import Sample
from gelsim.vectors import WRENCH

LIBRARIES = ["numpy", "PIL.Image", "pyarrow"]
HAS_FLOATS = True
"""Layers of floats are read for it."""

PAD = "pad"
"""With a number: the only pad, and of a gripper the left one, is pad0, the right one pad1."""
POSE = ["x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad"]
POSE_UNIT = "mm (x, y, z) and rotation vector in radians; " + content.POSE
META = {
    "episode_ends": "frames before the end of each episode",
    "label_ends": "bytes of label_json before the end of each episode's",
    "label_json": "the labels' JSON, one after another, UTF-8",
    "class_index": "of each episode; the root's attribute classes has the names",
    "index": "the sample's number in its job, of each episode",
}
BYTES_IN_CHUNK = 1 << 18
"""Of arrays of small rows."""


def source(out: Path) -> Any:
    """The identity of a finished copy; None if `out` is none."""
    try:
        return Store(out).attributes()["gelsim"]
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None


class Writer:
    """Writes the parts."""

    def __init__(self, dataset: Dataset[Sample], folder: Path, out: Path, identity: dict[str, Any]) -> None:
        self.dataset, self.folder, self.identity = dataset, folder, identity
        self.zipped = out.suffix.lower() == ".zip"
        self.numpy, self.root = need("numpy"), folder / "out"
        created = folder / "parts/arrays.json"
        if not created.exists():
            shutil.rmtree(self.root, ignore_errors=True)
            self.create()
            write(created, {})

    def create(self) -> None:
        """Makes the arrays of images: of as many frames as the labels name."""
        first = self.dataset.raw(0)
        lengths = len(self.dataset)
        if "sequence" in first.label:
            lengths = sum(len(self.dataset.raw(index)) for index in range(len(self.dataset)))
        make_group(self.root)
        make_group(self.root / "data")
        for name, array in layers(first, 0).items():
            if "/" not in name:
                path = f"data/{name}"
                Written(self.root / path, 1).make((lengths, *array.shape), array.dtype, {"unit": unit(path)})

    def part(self, number: int, samples: Iterator[Raw], at: Place) -> dict[str, Any]:
        """Writes the images of shard `number`, and keeps the rest of it."""
        kept: dict[str, list[Any]] = {}
        images = {name: Written(self.root / f"data/{name}", 1) for name in self.names()}
        frames = count(at.frames)
        for raw in samples:
            small = {"data/" + name: rows for name, rows in vectors_of(raw).items()}
            small["meta/label_json"] = self.numpy.frombuffer(raw.label_json, "uint8")
            small["meta/label_ends"] = self.numpy.array([len(raw.label_json)])
            small["meta/episode_ends"] = self.numpy.array([len(raw)])
            small["meta/class_index"] = self.numpy.array([raw.label["object"]["class_index"]])
            small["meta/index"] = self.numpy.array([raw.label["index"]])
            for name, rows in small.items():
                kept.setdefault(name, []).append(rows)
            for number_in, frame in zip(range(len(raw)), frames):
                for name, array in layers(raw, number_in).items():
                    if name in images:
                        images[name].put(frame, array[None])
                    else:
                        kept.setdefault(ragged(name), []).append(array)
                        ends = kept.setdefault(ragged(name.split("/")[0] + "/ends"), [])
                        if len(ends) <= frame - at.frames:
                            ends.append(self.numpy.array([len(array)]))
        small = {name: self.numpy.concatenate(rows) for name, rows in kept.items()}
        path = self.folder / f"parts/{number:06}.npz"
        with open(path, "wb") as file:
            self.numpy.savez(file, **small)
        return {"file": path.name, "rows": {name: len(rows) for name, rows in small.items()}}

    def names(self) -> list[str]:
        """The layers that are arrays."""
        pads = pads_of(self.dataset.raw(0))
        return [f"{at}_{name}" for at, pad in pads.items() for name in pad.files if name not in ("markers", "pins")]

    def finish(self, parts: list[dict[str, Any]]) -> Path:
        """Writes what is small, and the zip."""
        for name in parts[0]["rows"]:
            make_group(self.root / name.split("/")[0])
            self.join(name, parts)
        first = self.dataset.raw(0)
        pads = pads_of(first)
        about = {
            "gelsim": self.identity,
            "frame": content.FRAME,
            "frame_rate_hz": content.frame_rate_hz(first),
            "classes": self.dataset.classes,
            "splits": self.dataset.splits,
            "pads": dict(zip(pads, content.sensors(self.dataset))),
        }
        if fingers := {at: pad.finger for at, pad in pads.items() if pad.finger is not None}:
            about["fingers"] = fingers
        make_group(self.root, about)
        return packed(self.folder) if self.zipped else self.root

    def join(self, name: str, parts: list[dict[str, Any]]) -> None:
        """Makes one array of those of the parts; ends of parts become ends of the whole."""
        shutil.rmtree(self.root / name, ignore_errors=True)
        array: Optional[Written] = None
        left: Any = None
        number, before = 0, 0
        for part in parts:
            with self.numpy.load(self.folder / "parts" / part["file"]) as file:
                rows = file[name]
            if name.endswith("_ends") and len(rows):
                rows = self.numpy.cumsum(rows) + before
                before = rows[-1]
            if array is None:
                shape = sum(each["rows"][name] for each in parts), *rows.shape[1:]
                row_bytes = int(self.numpy.prod(rows.shape[1:], dtype="int64")) * rows.itemsize
                chunk = max(1, min(shape[0], BYTES_IN_CHUNK // row_bytes))
                array = Written(self.root / name, chunk).make(shape, rows.dtype, attributes(name))
            left = rows if left is None else self.numpy.concatenate([left, rows])
            while len(left) >= array.rows_in_chunk:
                array.put(number, left[: array.rows_in_chunk])
                left, number = left[array.rows_in_chunk :], number + 1
        if array is not None and len(left):
            array.put(number, left)


def attributes(name: str) -> dict[str, Any]:
    """Those of an array of vectors or counts."""
    components = {"pose": POSE, "wrench": WRENCH}.get(name.rsplit("_", 1)[-1])
    return {"unit": unit(name), **({"components": components} if components else {})}


def pads_of(raw: Raw) -> dict[str, Pad]:
    """A sample's sensors by what the names of their arrays begin with."""
    return {f"{PAD}{number}": pad for number, pad in enumerate(raw.pads)}


def layers(raw: Raw, number: int) -> Arrays:
    """The arrays of a frame: `pad0_tactile`, `pad0_markers/rest_px` and so on."""
    each = {at: content.layers(raw, pad, number) for at, pad in pads_of(raw).items()}
    return {f"{at}_{name}": array for at, its in each.items() for name, array in its.items()}


def ragged(name: str) -> str:
    """The array of markers or pins of all frames, one after another."""
    return f"ragged/{name.replace('/', '_')}"


def unit(name: str) -> str:
    """What the numbers of an array mean."""
    group, own = name.split("/")
    if group == "meta":
        return META[own]
    own = own.split("_", 1)[1] if own.startswith(PAD) else own
    if own.endswith("_ends"):
        return "rows before the end of each frame"
    known = {"pose": POSE_UNIT, "timestamp": "s since the sequence began; 0 of presses"}
    return known[own] if own in known else content.UNITS[own.replace("_", "/", 1)]


def packed(folder: Path) -> Path:
    """All files of the copy in a stored zip, in their order and without times."""
    path = folder / "out.zip"
    root = folder / "out"
    files = sorted(file for file in root.rglob("*") if file.is_file())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.relative_to(root).as_posix()), file.read_bytes())
    return path


def vectors_of(raw: Raw) -> Arrays:
    """Poses, wrenches and time of each frame."""
    numpy = need("numpy")
    found: Arrays = {}
    for at, pad in pads_of(raw).items():
        poses = content.poses(pad)
        found[f"{at}_pose"] = numpy.concatenate([poses[:, :3], rotation_vectors(poses[:, 3:])], axis=1)
        found[f"{at}_wrench"] = content.wrenches(pad)
    found["timestamp"] = numpy.array([part.get("t_s", 0.0) for part in raw.pads[0].parts], "float64")
    return found


def rotation_vectors(quaternions: Any) -> Any:
    """Axis times angle (radians, 0 to pi) of unit quaternions x, y, z, w (N, 4)."""
    numpy = need("numpy")
    quaternions = numpy.where(quaternions[:, 3:] < 0, -quaternions, quaternions)
    axis, w = quaternions[:, :3], quaternions[:, 3]
    length = numpy.sqrt((axis**2).sum(axis=1))
    turned = length > 0
    factor = numpy.where(turned, 2 * numpy.arctan2(length, w) / numpy.where(turned, length, 1.0), 2.0)
    return axis * factor[:, None]


def expectation(dataset: Dataset[Sample]) -> Any:
    """What a copy holds of each frame of a sample."""

    def frames(raw: Raw, episode: int, first: int) -> Iterator[Arrays]:
        numpy = need("numpy")
        small = vectors_of(raw)
        about = {"class_index": raw.label["object"]["class_index"], "index": raw.label["index"]}
        for number in range(len(raw)):
            yield {
                **{name.replace("/", "_"): array for name, array in layers(raw, number).items()},
                **{name: rows[number] for name, rows in small.items()},
                **{name: numpy.int64(value) for name, value in about.items()},
            }

    return frames


def episodes(out: Path) -> Iterator[tuple[bytes, Iterator[Arrays]]]:
    """Label and frames of each episode."""
    store = Store(out)
    meta = store.arrays("meta")
    ends, label_ends = (meta[name].rows(0, meta[name].shape[0]) for name in ["episode_ends", "label_ends"])
    data, dots = store.arrays("data"), store.arrays("ragged")
    begun, label = 0, 0
    for episode, (end, label_end) in enumerate(zip(ends, label_ends)):
        about = {name: meta[name].row(episode) for name in ["class_index", "index"]}
        yield meta["label_json"].rows(label, label_end).tobytes(), frames(data, dots, range(begun, end), about)
        begun, label = int(end), int(label_end)


def frames(data: dict[str, Read], dots: dict[str, Read], numbers: range, about: Arrays) -> Iterator[Arrays]:
    """Some of the frames."""
    for number in numbers:
        found: Arrays = {name: array.row(number) for name, array in data.items()}
        for name, array in dots.items():
            at, layer, part = name.split("_", 2)
            if part != "ends":
                ends = dots[f"{at}_{layer}_ends"]
                found[name] = array.rows(int(ends.row(number - 1)) if number else 0, int(ends.row(number)))
        yield {**found, **about}
